"""Compiled passes that join the vertices of the cells around crossed edges to triangles.

The windows are those of `_kernels_cells`. Triangles 2 q and 2 q + 1 come from the same quad
(a, b, c, d) and are written as (a, b, c), (a, c, d).

Guarantees: as `_kernels_cells`; ties between the diagonals are decided by the order of the cells.
"""

import numpy as np
from numba import njit

from ilattice._kernels import in_ranges, inner, outer
from ilattice._typing import AnyArray
from ilattice.mesh._kernels_bits import lowest
from ilattice.mesh._kernels_cells import (
    CHUNK,
    B,
    S,
    extent,
    kept_edges,
    neighbour,
)
from ilattice.mesh._tables import CASES, LABEL, PATCHES

T = 9  # cells of a block and the layer below it, per direction
TIE = 1e-6  # relative difference of shapes that does not count
#: Places in `numbering`: the row before which vertices are those of the previous layers, and what
#: is added to rows before and from there on to make their ids.
SPLIT, BELOW, ABOVE = 0, 1, 2


@inner()
def _index_block(prefix, shape, coords, n, ox, oy, oz, start, place, ids, row_of):
    """Vertices and rows of `CASES` of the cells of block n that block n - (ox, oy, oz) needs.

    They go to the local places of the cells, which begin one layer below the block; of cells with
    several vertices the first one v goes there as -1 - v.
    """
    ni = extent(shape, 0, coords[n, 3])
    nj = extent(shape, 1, coords[n, 1])
    nk = extent(shape, 2, coords[n, 2])
    for i in range(0 if ox == 0 else ni - 1, ni):
        for j in range(0 if oy == 0 else nj - 1, nj):
            local = T * T * (i + 1 if ox == 0 else 0) + T * (j + 1 if oy == 0 else 0)
            r = B * i + j
            for v in range(start[n] + prefix[n, r], start[n] + prefix[n, r + 1]):
                code = np.int64(place[v])
                k = code & 7
                if oz < 0 and k < nk - 1:
                    continue
                at = local + (k + 1 if oz == 0 else 0)
                row = (code >> 3) & 511
                ids[at] = v if CASES[row, PATCHES] == 1 else (code >> 12) - v - 1
                row_of[at] = row


@njit(cache=True, inline="always")
def _square(x, y, z):
    """Square of the length of a vector."""
    return x * x + y * y + z * z


@njit(cache=True, inline="always")
def _shape(square, sides):
    """Square of (2 area / sum of squared sides), from the squares of 2 area and of the sides."""
    return square / (sides * sides) if sides > 0.0 else 0.0


@inner()
def best_diagonal(p, axis):
    """0 to split the quad p (4, 3) along corners 0-2, 1 for 1-3.

    Counter-clockwise about `axis`, the quad winds around the crossed edge. A diagonal that keeps
    both triangles wound that way comes first (one always does), then the better worst triangle.
    The normals of the triangles are the products of the vectors u, v, w from corner 0 to the
    others; that of the triangle without corner 0 follows from the other three.
    """
    ux, uy, uz = p[1, 0] - p[0, 0], p[1, 1] - p[0, 1], p[1, 2] - p[0, 2]
    vx, vy, vz = p[2, 0] - p[0, 0], p[2, 1] - p[0, 1], p[2, 2] - p[0, 2]
    wx, wy, wz = p[3, 0] - p[0, 0], p[3, 1] - p[0, 1], p[3, 2] - p[0, 2]
    ax, ay, az = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx  # 0, 1, 2
    bx, by, bz = vy * wz - vz * wy, vz * wx - vx * wz, vx * wy - vy * wx  # 0, 2, 3
    cx, cy, cz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx  # 0, 1, 3
    dx, dy, dz = ax + bx - cx, ay + by - cy, az + bz - cz  # 1, 2, 3
    a = ax if axis == 0 else (ay if axis == 1 else az)
    b = bx if axis == 0 else (by if axis == 1 else bz)
    c = cx if axis == 0 else (cy if axis == 1 else cz)
    first, second = min(a, b) > 0.0, min(c, a + b - c) > 0.0
    u, v, w = _square(ux, uy, uz), _square(vx, vy, vz), _square(wx, wy, wz)
    x = _square(vx - ux, vy - uy, vz - uz)
    y = _square(wx - ux, wy - uy, wz - uz)
    z = _square(wx - vx, wy - vy, wz - vz)
    q = min(_shape(_square(ax, ay, az), u + v + x), _shape(_square(bx, by, bz), v + w + z))
    r = min(_shape(_square(cx, cy, cz), u + w + y), _shape(_square(dx, dy, dz), x + y + z))
    better = q < (1.0 - TIE) * r
    return np.int64((second > first) | ((first == second) & better))


def _around_edges() -> tuple[AnyArray, AnyArray, AnyArray]:
    """Of the cells around an edge along each axis, counter-clockwise: offsets, and their edge.

    Returns the offsets (3, 4, 3), what they add to a local index, and the edges, (3, 4) each.
    """
    offset, edge = np.zeros((3, 4, 3), np.int64), np.zeros((3, 4), np.int64)
    for axis in range(3):
        b, c = (axis + 1) % 3, (axis + 2) % 3
        for corner, (ob, oc) in enumerate(((1, 1), (0, 1), (0, 0), (1, 0))):
            offset[axis, corner, b], offset[axis, corner, c] = -ob, -oc
            low, high = (ob, oc) if b < c else (oc, ob)
            edge[axis, corner] = 4 * axis + 2 * low + high
    return offset, offset @ np.array([T * T, T, 1]), edge


_OFFSET, _STEP, _EDGE = _around_edges()


@inner()
def _corners(axis, cell, ids, row_of, points, numbering, p, c):
    """Corners of the quad around an edge of a cell: ids to `c`, places to `p`.

    `cell` is local, the edge is its lowest one along `axis`. See `faces` for the ids.
    """
    for corner in range(4):
        local = cell + _STEP[axis, corner]
        v = ids[local]
        if v < 0:
            v = CASES[row_of[local], LABEL + _EDGE[axis, corner]] - 1 - v
        for a in range(3):
            p[corner, a] = points[v, a]
        c[corner] = v + numbering[BELOW if v < numbering[SPLIT] else ABOVE]


@inner()
def _unwrap(axis, i, j, k, shift, p):
    """Move the corners that lie across the seam of a wrapped direction next to the others."""
    for corner in range(4):
        for a in range(3):
            at = i if a == 0 else (j if a == 1 else k)
            if at + _OFFSET[axis, corner, a] < 0:
                p[corner, a] -= shift[a]


@inner()
def _emit_block(
    rows, shape, coords, b, caps, ids, row_of, points, shift, numbering, p, c, faces, at
):
    """Write the triangles of the edges that a block owns."""
    bx = kept_edges(shape, 0, coords[b, 3], caps)
    by = kept_edges(shape, 1, coords[b, 1], caps)
    bz = kept_edges(shape, 2, coords[b, 2], caps)
    bits = (1 << extent(shape, 2, coords[b, 2])) - 1
    seam = shift[0] > 0.0 or shift[1] > 0.0 or shift[2] > 0.0
    for i in range(extent(shape, 0, coords[b, 3])):
        for j in range(extent(shape, 1, coords[b, 1])):
            r = S * i + j
            m = np.int64(rows[b, r])
            for axis in range(3):
                if axis == 0:
                    x = (m ^ np.int64(rows[b, r + S])) & bits if (bx >> i) & 1 else 0
                elif axis == 1:
                    x = (m ^ np.int64(rows[b, r + 1])) & bits if (by >> j) & 1 else 0
                else:
                    x = (m ^ (m >> 1)) & bz
                while x != 0:
                    k = lowest(x)
                    x &= x - 1
                    cell = T * T * (i + 1) + T * (j + 1) + k + 1
                    _corners(axis, cell, ids, row_of, points, numbering, p, c)
                    if seam:
                        _unwrap(axis, i, j, k, shift, p)
                    first = best_diagonal(p, axis)
                    turn = 1 + (2 & (m >> k << 1))  # 3 where the lower end is inside, else 1
                    faces[at, 0] = faces[at + 1, 0] = c[first]
                    faces[at, 1] = c[(first - turn) & 3]
                    faces[at, 2] = faces[at + 1, 1] = c[first + 2]
                    faces[at + 1, 2] = c[(first + turn) & 3]
                    at += 2


@in_ranges(4 * CHUNK)
@outer(nogil=True, error_model="numpy")
def faces(
    first, last, rows, prefix, lookup, shape, coords, blocks, start, caps, points, place, period,
    numbering, quad, out,
):  # fmt: skip
    """Triangles of the listed blocks: block ``blocks[n]`` writes from row ``2 quad[n]`` on.

    ``start[b]`` is the row in `points` and `place` of the first vertex of block b; `numbering`
    makes ids of rows, see `SPLIT`. `period (3,)` is the length of the domain along the wrapped
    directions.
    """
    ids = np.zeros(T * T * T, np.int64)
    row_of = np.zeros(T * T * T, np.int64)
    p = np.empty((4, 3))
    corners = np.empty(4, np.int64)
    shift = np.empty(3)
    for q in range(first, last):
        b = blocks[q]
        if quad[q + 1] == quad[q]:
            continue
        for ox in range(-1, 1):
            for oy in range(-1, 1):
                for oz in range(-1, 1):
                    c = neighbour(lookup, shape, coords, b, ox, oy, oz)
                    if c >= 0:
                        _index_block(
                            prefix, shape, coords, c, ox, oy, oz, start, place, ids, row_of
                        )
        shift[0] = period[0] if coords[b, 3] == 0 else 0.0
        shift[1] = period[1] if coords[b, 1] == 0 else 0.0
        shift[2] = period[2] if coords[b, 2] == 0 else 0.0
        _emit_block(
            rows, shape, coords, b, caps, ids, row_of, points, shift, numbering, p, corners, out,
            2 * quad[q],
        )  # fmt: skip
