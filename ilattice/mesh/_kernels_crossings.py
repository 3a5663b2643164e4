"""Compiled search for triangles that pass through each other, over a tree of boxes.

Guarantees: triangles are marked if and only if one of two pierces the other by more than rounding,
or both lie in one plane and overlap there; if asked for, also where a corner of one is inside the
other or an edge of it, as where vertices on an edge of the domain changed places, or tips touch
its faces. The marks do not depend on the number of threads, nor on the order of the triangles.

The triangles are sorted along a curve that fills space. Leaf i of the tree holds the `LEAF`
triangles from ``LEAF * i``, node n has the children ``2 n`` and ``2 n + 1``, the root is 1.
"""

from typing import Any

import numpy as np

from ilattice._kernels import in_ranges, inner, outer
from ilattice.fields._kernels_program import spread

#: Triangles per leaf of the tree.
LEAF = 8
CHUNK = 64  # leaves that a thread takes at once
GRAIN = 4096  # triangles, or leaves where there is less to do
BITS = 21  # of a coordinate in the order along the curve
ROUNDING = 4e-15  # error of six volumes, relative to the cube of the size
COPLANAR = 1e-9  # height of triangles over one plane, relative to their size
ON_EDGE = 1e-10  # how far corners on an edge are away from it, relative to the size
TOUCHING = 1e-13  # height of corners that touch a triangle, relative to the size
#: Nodes that wait at most: one per level, of which there are fewer than bits in a number.
DEEPEST = 64


@in_ranges(GRAIN)
@outer(nogil=True, error_model="numpy")
def morton(first: int, last: int, x: Any, faces: Any, low: Any, size: float, out: Any) -> None:
    """Morton codes of triangles: along a curve that fills the cube at `low` with edges `size`."""
    scale = (2**BITS - 1) / (3.0 * size)
    for f in range(first, last):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        place = 0
        for k in range(3):
            s = (x[a, k] - low[k]) + (x[b, k] - low[k]) + (x[c, k] - low[k])
            place |= spread(int(s * scale)) << k
        out[f] = place


@outer()
def extent(x: Any, out: Any) -> None:
    """Least and largest coordinates (2, 3) of vertices."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for v in range(len(x)):
        for k in range(3):
            low[k], high[k] = min(low[k], x[v, k]), max(high[k], x[v, k])
    for k in range(3):
        out[0, k], out[1, k] = low[k], high[k]


@outer()
def voxels(x: Any, low: Any, scale: Any, n: int, out: Any) -> None:
    """Voxels (V, 3) of vertices, of n each way from `low` on; ``scale`` (3,) is their inverse."""
    for v in range(len(x)):
        for k in range(3):
            out[v, k] = min(max(int((x[v, k] - low[k]) * scale[k]), 0), n - 1)


@inner()
def _span(voxel: Any, faces: Any, f: int, k: int) -> Any:
    """First and last voxel of a triangle along an axis."""
    a, b, c = voxel[faces[f, 0], k], voxel[faces[f, 1], k], voxel[faces[f, 2], k]
    return min(a, b, c), max(a, b, c)


@outer()
def mark_voxels(voxel: Any, faces: Any, active: Any, mask: Any) -> None:
    """Mark the voxels that the boxes of the active triangles touch."""
    for f in range(len(faces)):
        if active[f]:
            i0, i1 = _span(voxel, faces, f, 0)
            j0, j1 = _span(voxel, faces, f, 1)
            k0, k1 = _span(voxel, faces, f, 2)
            for i in range(i0, i1 + 1):
                for j in range(j0, j1 + 1):
                    for k in range(k0, k1 + 1):
                        mask[i, j, k] = True


@inner()
def _any(mask: Any, voxel: Any, faces: Any, f: int) -> bool:
    """Whether a voxel of the box of a triangle is marked."""
    i0, i1 = _span(voxel, faces, f, 0)
    j0, j1 = _span(voxel, faces, f, 1)
    k0, k1 = _span(voxel, faces, f, 2)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            for k in range(k0, k1 + 1):
                if mask[i, j, k]:
                    return True
    return False


@in_ranges(GRAIN)
@outer(nogil=True)
def in_voxels(first: int, last: int, voxel: Any, faces: Any, mask: Any, out: Any) -> None:
    """Which triangles may touch an active one: those in marked voxels."""
    for f in range(first, last):
        out[f] = _any(mask, voxel, faces, f)


@inner()
def _box(x: Any, faces: Any, f: int, out: Any) -> None:
    """Least and largest coordinates of a triangle."""
    for k in range(3):
        a, b, c = x[faces[f, 0], k], x[faces[f, 1], k], x[faces[f, 2], k]
        out[k] = min(a, b, c)
        out[3 + k] = max(a, b, c)


@in_ranges(GRAIN)
@outer(nogil=True, error_model="numpy")
def fill_leaves(first: int, last: int, x: Any, faces: Any, order: Any, boxes: Any) -> None:
    """Boxes of the leaves; those beyond the last triangle hold nothing."""
    leaves = len(boxes) // 2
    box = np.empty(6)
    for leaf in range(first, last):
        for k in range(3):
            boxes[leaves + leaf, k] = np.inf
            boxes[leaves + leaf, 3 + k] = -np.inf
        for i in range(LEAF * leaf, min(LEAF * leaf + LEAF, len(order))):
            _box(x, faces, order[i], box)
            for k in range(3):
                boxes[leaves + leaf, k] = min(boxes[leaves + leaf, k], box[k])
                boxes[leaves + leaf, 3 + k] = max(boxes[leaves + leaf, 3 + k], box[3 + k])


@outer()
def fill_nodes(boxes: Any) -> None:
    """Boxes of the nodes above the leaves."""
    for n in range(len(boxes) // 2 - 1, 0, -1):
        for k in range(3):
            boxes[n, k] = min(boxes[2 * n, k], boxes[2 * n + 1, k])
            boxes[n, 3 + k] = max(boxes[2 * n, 3 + k], boxes[2 * n + 1, 3 + k])


@inner()
def _apart(p: Any, i: int, q: Any, j: int) -> bool:
    """Whether two boxes have no point in common."""
    for k in range(3):
        if p[i, k] > q[j, 3 + k] or q[j, k] > p[i, 3 + k]:
            return True
    return False


@inner()
def _volume(x: Any, a: int, b: int, c: int, d: int) -> float:
    """Six times the volume of a tetrahedron."""
    ux, uy, uz = x[a, 0] - x[d, 0], x[a, 1] - x[d, 1], x[a, 2] - x[d, 2]
    vx, vy, vz = x[b, 0] - x[d, 0], x[b, 1] - x[d, 1], x[b, 2] - x[d, 2]
    wx, wy, wz = x[c, 0] - x[d, 0], x[c, 1] - x[d, 1], x[c, 2] - x[d, 2]
    return ux * (vy * wz - vz * wy) + uy * (vz * wx - vx * wz) + uz * (vx * wy - vy * wx)


@inner()
def _heights(x: Any, faces: Any, f: int, g: int, out: Any) -> Any:
    """Volumes above triangle f of the corners of g, zero for those that are corners of f.

    Returns the least and the largest of them.
    """
    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
    for j in range(3):
        v = faces[g, j]
        out[j] = 0.0 if v == a or v == b or v == c else _volume(x, a, b, c, v)
    return min(out[0], out[1], out[2]), max(out[0], out[1], out[2])


@inner()
def _pierced(x: Any, faces: Any, f: int, g: int, heights: Any, least: float) -> bool:
    """Whether an edge of g passes through the inside of f."""
    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
    for j in range(3):
        i = (j + 1) % 3
        above, below = max(heights[i], heights[j]), min(heights[i], heights[j])
        if above > least and below < -least:
            p, q = faces[g, i], faces[g, j]
            u, v = _volume(x, p, q, a, b), _volume(x, p, q, b, c)
            w = _volume(x, p, q, c, a)
            if min(u, v, w) > least or max(u, v, w) < -least:
                return True
    return False


@inner()
def _flat(x: Any, k: int, m: int, a: int, b: int, c: int) -> float:
    """Twice the area of a triangle in the plane of the coordinates k and m."""
    return (x[b, k] - x[a, k]) * (x[c, m] - x[a, m]) - (x[b, m] - x[a, m]) * (x[c, k] - x[a, k])


@inner()
def _beside(x: Any, faces: Any, k: int, m: int, f: int, g: int, least: float) -> bool:
    """Whether an edge of f has all of g on its outer side, in the plane."""
    area = _flat(x, k, m, faces[f, 0], faces[f, 1], faces[f, 2])
    turn = 1.0 if area > 0.0 else -1.0
    for i in range(3):
        p, q = faces[f, i], faces[f, (i + 1) % 3]
        most = -np.inf
        for j in range(3):
            v = faces[g, j]
            if v != p and v != q:
                most = max(most, turn * _flat(x, k, m, p, q, v))
        if most <= least:
            return True
    return False


@inner()
def _overlap(x: Any, faces: Any, f: int, g: int, size: float) -> bool:
    """Whether two triangles in one plane overlap."""
    k, m, most = 0, 1, -1.0
    for axis in range(3):
        p, q = (axis + 1) % 3, (axis + 2) % 3
        area = abs(_flat(x, p, q, faces[f, 0], faces[f, 1], faces[f, 2]))
        area += abs(_flat(x, p, q, faces[g, 0], faces[g, 1], faces[g, 2]))
        if area > most:
            k, m, most = p, q, area
    least = COPLANAR * size * size
    return not (_beside(x, faces, k, m, f, g, least) or _beside(x, faces, k, m, g, f, least))


@inner()
def _aside(faces: Any, f: int, g: int, heights: Any, least: float) -> bool:
    """Whether g is on one side of f, but for the corners that it shares with it."""
    low, high = np.inf, -np.inf
    for j in range(3):
        v = faces[g, j]
        if v != faces[f, 0] and v != faces[f, 1] and v != faces[f, 2]:
            low, high = min(low, heights[j]), max(high, heights[j])
    return low > least or high < -least


@inner()
def _within(x: Any, faces: Any, f: int, v: int, size: float) -> bool:
    """Whether the vertex v is inside the triangle f, unless that is a sliver."""
    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
    s0, s1, s2 = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
    t0, t1, t2 = x[c, 0] - x[a, 0], x[c, 1] - x[a, 1], x[c, 2] - x[a, 2]
    n0, n1, n2 = s1 * t2 - s2 * t1, s2 * t0 - s0 * t2, s0 * t1 - s1 * t0
    r0, r1, r2 = x[v, 0] - x[a, 0], x[v, 1] - x[a, 1], x[v, 2] - x[a, 2]
    square = n0 * n0 + n1 * n1 + n2 * n2
    if square <= (COPLANAR * size * size) ** 2:
        return False
    if abs(n0 * r0 + n1 * r1 + n2 * r2) > TOUCHING * size * np.sqrt(square):
        return False
    second = n0 * (s1 * r2 - s2 * r1) + n1 * (s2 * r0 - s0 * r2) + n2 * (s0 * r1 - s1 * r0)
    first = n0 * (r1 * t2 - r2 * t1) + n1 * (r2 * t0 - r0 * t2) + n2 * (r0 * t1 - r1 * t0)
    least = COPLANAR * square
    return first > least and second > least and first + second < square - least


@inner()
def _touched(x: Any, faces: Any, f: int, g: int, heights: Any, size: float) -> bool:
    """Whether a corner of g, of such a height over f, is inside f or an edge of it."""
    for j in range(3):
        v = faces[g, j]
        if (
            abs(heights[j]) > COPLANAR * size * size * size
            or v == faces[f, 0]
            or v == faces[f, 1]
            or v == faces[f, 2]
        ):
            continue
        if _within(x, faces, f, v, size):
            return True
        for i in range(3):
            p, q = faces[f, i], faces[f, (i + 1) % 3]
            along, square, area = 0.0, 0.0, 0.0
            for k in range(3):
                m = (k + 1) % 3
                d, e = x[q, k] - x[p, k], x[v, k] - x[p, k]
                along += d * e
                square += d * d
                area += (d * (x[v, m] - x[p, m]) - e * (x[q, m] - x[p, m])) ** 2
            room = ON_EDGE * size * size
            if along > room and along < square - room and area <= (ON_EDGE * size) ** 2 * square:
                return True
    return False


@inner()
def _cross(x: Any, faces: Any, f: int, g: int, size: float, touching: bool, heights: Any) -> bool:
    """Whether one of two triangles pierces the other, or both overlap in one plane."""
    least = ROUNDING * size * size * size
    low, high = _heights(x, faces, f, g, heights)
    if max(high, -low) <= COPLANAR * size * size * size:
        f, g = g, f  # all is flat over slivers, which themselves are not over others
        low, high = _heights(x, faces, f, g, heights)
    if max(high, -low) <= COPLANAR * size * size * size:
        return _overlap(x, faces, f, g, size)
    if _aside(faces, f, g, heights, COPLANAR * size * size * size):
        return False
    if touching and _touched(x, faces, f, g, heights, size):
        return True
    pierces = low < -least and high > least
    if not (touching or pierces):
        return False
    if pierces and _pierced(x, faces, f, g, heights, least):
        return True
    _heights(x, faces, g, f, heights)
    if touching and _touched(x, faces, g, f, heights, size):
        return True
    return pierces and _pierced(x, faces, g, f, heights, least)


@inner()
def _compare(
    x: Any, faces: Any, order: Any, active: Any, tree: Any, leaf: int, other: int, touching: bool,
    boxes: Any, marked: Any,
) -> int:  # fmt: skip
    """Mark the triangles of two leaves that cross; how many pairs do."""
    found = 0
    for j in range(LEAF * other, min(LEAF * other + LEAF, len(order))):
        g = order[j]
        _box(x, faces, g, boxes[LEAF])
        if _apart(tree, len(tree) // 2 + leaf, boxes, LEAF):
            continue
        for i in range(LEAF * leaf, min(LEAF * leaf + LEAF, len(order))):
            f, n = order[i], i - LEAF * leaf
            if not active[f] or (active[g] and i >= j) or _apart(boxes, n, boxes, LEAF):
                continue
            size = 0.0
            for k in range(3):
                size = max(size, boxes[n, 3 + k] - boxes[n, k], boxes[LEAF, 3 + k] - boxes[LEAF, k])
            if _cross(x, faces, f, g, size, touching, boxes[LEAF + 1]):
                marked[f] = marked[g] = True
                found += 1
    return found


@inner()
def _from(node: int, stack: Any) -> int:
    """Put on the stack the nodes that together hold a leaf and all leaves after it."""
    stack[0], depth = node, 1
    while node > 1:
        if node % 2 == 0:
            stack[depth] = node + 1
            depth += 1
        node //= 2
    return depth


@in_ranges(CHUNK)
@outer(nogil=True, error_model="numpy")
def mark_crossings(
    first: int,
    last: int,
    x: Any,
    faces: Any,
    order: Any,
    boxes: Any,
    active: Any,
    whole: bool,
    touching: bool,
    marked: Any,
    pairs: Any,
) -> None:
    """Mark the triangles that pass through others.

    Parameters
    ----------
    first, last : int
        Leaves.
    x : (V, 3) array
        Vertices.
    faces : (F, 3) integer array
        Corners.
    order : (F,) integer array
        The triangles along the curve.
    boxes : (2 n, 6) array
        The tree; n is a power of two, at least F / `LEAF`.
    active : (F,) array of bool
        Only pairs with one of these are compared.
    whole : bool
        Whether all are active: then every pair is met from the first of its leaves.
    touching : bool
        Whether triangles that a corner of another one touches are marked, too.
    marked : (F,) array of bool, all False
        Receives True for triangles that cross another one.
    pairs : (leaves,) integer array
        Receives their number.
    """
    start = len(boxes) // 2
    scratch = np.empty((LEAF + 2, 6))  # boxes of a leaf and of one more, heights
    stack = np.empty(DEEPEST, np.int64)
    for leaf in range(first, last):
        awake = 0
        for i in range(LEAF * leaf, min(LEAF * leaf + LEAF, len(order))):
            _box(x, faces, order[i], scratch[i - LEAF * leaf])
            awake += active[order[i]]
        stack[0], depth, count = 1, 1 if awake else 0, 0
        if whole:
            depth = _from(start + leaf, stack)
        while depth > 0:
            depth -= 1
            n = stack[depth]
            if _apart(boxes, start + leaf, boxes, n):
                continue
            if n < start:
                stack[depth], stack[depth + 1] = 2 * n, 2 * n + 1
                depth += 2
            else:
                count += _compare(
                    x, faces, order, active, boxes, leaf, n - start, touching, scratch, marked
                )  # fmt: skip
        pairs[leaf] = count
