"""Compiled local changes of a triangle mesh: edge collapses and flips that remove slivers.

Guarantees: one thread and a fixed order, so results are reproducible. A manifold mesh stays
manifold, with the same Euler number and orientation. No vertex moves.
Not guaranteed: anything for edges of more than two triangles or several fans at one vertex, except
that they are left alone where they are met.

Corner ``h = 3 f + j`` is corner j of face f. The corners at a vertex form a linked list: `head` of
the vertex, then `after` of the corner, -1 at the end. Removed faces hold -1. `on` of a vertex has a
bit for every surface that it lies on: bits 0 to 5 are the faces of the domain, `WALL` is the level
set. A face lies on the faces of the domain that its corners share, or else on the wall.
"""

from typing import Any

import numpy as np

from ilattice._kernels import inner, outer

#: Bits of labels: the level set, and all faces of the domain.
WALL, CAPS = 64, 63
STEEPEST = 0.5  # least cosine between a triangle and what replaces it
FAIR = 0.3  # a quality that is good enough: above it, the change of volume decides
SLIVER = 0.02  # a quality below which the normal of a triangle says nothing
#: Quality of changes that are not made, and the number of the change that flips an edge.
REJECTED, FLIP = -1.0, 2


@outer()
def link_corners(faces: Any, head: Any, after: Any) -> None:
    """Lists of the corners at every vertex, ascending; `head` comes filled with -1."""
    for h in range(faces.size - 1, -1, -1):
        v = faces[h // 3, h % 3]
        after[h] = head[v]
        head[v] = h


@inner()
def _shape(x: Any, a: int, b: int, c: int) -> Any:
    """Quality of a triangle, and the cross product of two of its sides."""
    ux, uy, uz = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
    vx, vy, vz = x[c, 0] - x[a, 0], x[c, 1] - x[a, 1], x[c, 2] - x[a, 2]
    wx, wy, wz = vx - ux, vy - uy, vz - uz
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    s = ux * ux + uy * uy + uz * uz + vx * vx + vy * vy + vz * vz + wx * wx + wy * wy + wz * wz
    q = 2.0 * np.sqrt(3.0) * np.sqrt(nx * nx + ny * ny + nz * nz) / s if s > 0.0 else 0.0
    return q, (nx, ny, nz)


@inner()
def _dot(n: Any, m: Any) -> float:
    return n[0] * m[0] + n[1] * m[1] + n[2] * m[2]


@inner()
def _turned(n: Any, m: Any, cosine: float) -> bool:
    """Whether the angle between two vectors is too large, or cannot be told."""
    return not _dot(n, m) > cosine * np.sqrt(_dot(n, n) * _dot(m, m))


@inner()
def _others(faces: Any, h: int) -> Any:
    """Vertices after and before corner `h` in its face."""
    f, j = h // 3, h % 3
    return faces[f, (j + 1) % 3], faces[f, (j + 2) % 3]


@inner()
def _label(on: Any, a: int, b: int, c: int) -> int:
    """Faces of the domain on which a triangle lies."""
    return on[a] & on[b] & on[c] & CAPS


@inner()
def _edge(faces: Any, on: Any, head: Any, after: Any, a: int, b: int, without: int) -> Any:
    """Triangles at the edge from a to b, both ways, and what those without a vertex lie on."""
    forward = backward = surfaces = 0
    h = head[a]
    while h >= 0:
        p, q = _others(faces, h)
        if p == b or q == b:
            forward += p == b
            backward += q == b
            if p != without and q != without:
                label = _label(on, a, p, q)
                surfaces |= label if label else WALL
        h = after[h]
    return forward, backward, surfaces


@inner()
def _is_neighbour(faces: Any, head: Any, after: Any, a: int, b: int) -> bool:
    """Whether there is an edge between two vertices."""
    h = head[a]
    while h >= 0:
        p, q = _others(faces, h)
        if p == b or q == b:
            return True
        h = after[h]
    return False


@inner()
def _may_collapse(faces: Any, on: Any, head: Any, after: Any, a: int, b: int) -> bool:
    """Whether vertex a may be merged into b: curves of surfaces, link condition, valence."""
    forward, backward, surfaces = _edge(faces, on, head, after, a, b, -1)
    if forward != 1 or backward != 1:
        return False
    if on[a] & (on[a] - 1) and surfaces != on[a]:  # a lies on a curve that the edge leaves
        return False
    common = valence = 0
    h = head[a]
    while h >= 0:
        p, _ = _others(faces, h)
        valence += 1
        forward, backward, surfaces = _edge(faces, on, head, after, a, p, b)
        if forward != 1 or backward != 1:
            return False
        if p != b:
            forward, backward, more = _edge(faces, on, head, after, b, p, a)
            common += forward + backward > 0
            if on[b] & on[p] & CAPS & ~(surfaces | more):  # a chord across a face of the domain
                return False
        h = after[h]
    if common != 2:
        return False
    h = head[b]
    while h >= 0:
        valence += 1
        h = after[h]
    return valence > 6


@inner()
def _patch(x: Any, faces: Any, head: Any, after: Any, a: int, b: int) -> Any:
    """Sum of the normals around two vertices: what stands for that of triangles that have none."""
    patch = (0.0, 0.0, 0.0)
    for v in (a, b):
        h = head[v]
        while h >= 0:
            p, q = _others(faces, h)
            _, n = _shape(x, v, p, q)
            patch = (patch[0] + n[0], patch[1] + n[1], patch[2] + n[2])
            h = after[h]
    return patch


@inner()
def _try_collapse(
    x: Any, faces: Any, on: Any, head: Any, after: Any, a: int, b: int, floor: float
) -> Any:
    """Worst quality around a vertex after it is merged into b, and the change of the volume x 6.

    `REJECTED` where that is not allowed, worse than before, or below a floor.
    """
    if on[a] & ~on[b]:
        return REJECTED, 0.0
    least = most = np.inf
    volume = 0.0
    step = (x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2])
    h = head[a]
    while h >= 0:
        p, q = _others(faces, h)
        old, n = _shape(x, a, p, q)
        least = min(least, old)
        volume += _dot(step, n)
        if p != b and q != b:
            new, m = _shape(x, b, p, q)
            most = min(most, new)
            if most < floor or _label(on, a, p, q) != _label(on, b, p, q):
                return REJECTED, 0.0
            if old >= SLIVER:
                if _turned(n, m, STEEPEST):
                    return REJECTED, 0.0
            elif _turned(_patch(x, faces, head, after, a, b), m, 0.0):
                return REJECTED, 0.0
        h = after[h]
    if most < least or not _may_collapse(faces, on, head, after, a, b):
        return REJECTED, 0.0
    return most, abs(volume)


@inner()
def _across(faces: Any, head: Any, after: Any, a: int, b: int) -> int:
    """Corner at b of the triangle in which a follows b, or -1."""
    h = head[b]
    while h >= 0:
        p, _ = _others(faces, h)
        if p == a:
            return h
        h = after[h]
    return -1


@inner()
def _try_flip(x: Any, faces: Any, on: Any, head: Any, after: Any, f: int, j: int) -> Any:
    """Worst quality of the two triangles at edge j of face f with the other diagonal.

    The second value is the change of the volume x 6; `REJECTED` as in `_try_collapse`.
    """
    a, b, c = faces[f, j], faces[f, (j + 1) % 3], faces[f, (j + 2) % 3]
    forward, backward, _ = _edge(faces, on, head, after, a, b, -1)
    if forward != 1 or backward != 1:
        return REJECTED, 0.0
    _, d = _others(faces, _across(faces, head, after, a, b))
    label = _label(on, a, b, c)
    if (
        label != _label(on, a, b, d)
        or label != _label(on, a, d, c)
        or label != _label(on, d, b, c)
        or on[c] & on[d] & CAPS & ~label
        or _is_neighbour(faces, head, after, c, d)
    ):
        return REJECTED, 0.0
    q0, n0 = _shape(x, a, b, c)
    q1, n1 = _shape(x, b, a, d)
    r0, m0 = _shape(x, a, d, c)
    r1, m1 = _shape(x, d, b, c)
    n = (n0[0] + n1[0], n0[1] + n1[1], n0[2] + n1[2])
    if _turned(m0, m1, STEEPEST) or _turned(n, m0, STEEPEST) or _turned(n, m1, STEEPEST):
        return REJECTED, 0.0
    step = (x[d, 0] - x[a, 0], x[d, 1] - x[a, 1], x[d, 2] - x[a, 2])
    new = min(r0, r1)
    return (new, abs(_dot(step, n0))) if new > min(q0, q1) else (REJECTED, 0.0)


@inner()
def _unlink(head: Any, after: Any, v: int, h: int) -> None:
    """Take corner `h` out of the list of vertex `v`."""
    if head[v] == h:
        head[v] = after[h]
        return
    g = head[v]
    while after[g] != h:
        g = after[g]
    after[g] = after[h]


@inner()
def _put(faces: Any, head: Any, after: Any, h: int, v: int) -> None:
    """Give corner `h` to vertex `v`."""
    faces[h // 3, h % 3] = v
    after[h] = head[v]
    head[v] = h


@inner()
def _collapse(faces: Any, head: Any, after: Any, a: int, b: int) -> None:
    """Merge vertex a into b."""
    h = head[a]
    head[a] = -1
    while h >= 0:
        following = after[h]
        p, q = _others(faces, h)
        f = h // 3
        if p == b or q == b:
            for j in range(3):
                if faces[f, j] != a:
                    _unlink(head, after, faces[f, j], 3 * f + j)
            faces[f, :] = -1
        else:
            _put(faces, head, after, h, b)
        h = following


@inner()
def _flip(faces: Any, head: Any, after: Any, f: int, j: int) -> int:
    """Replace edge j of face f by the other diagonal; returns the face across."""
    h = 3 * f + (j + 1) % 3
    a, b, c = faces[f, j], faces[f, (j + 1) % 3], faces[f, (j + 2) % 3]
    g = _across(faces, head, after, a, b)  # the corner at b of (b, a, d)
    i = g - g % 3 + (g + 1) % 3  # the corner at a
    _, d = _others(faces, g)
    _unlink(head, after, b, h)
    _put(faces, head, after, h, d)  # (a, d, c)
    _unlink(head, after, a, i)
    _put(faces, head, after, i, c)  # (b, c, d)
    return g // 3


@inner()
def _repair_face(x: Any, faces: Any, on: Any, head: Any, after: Any, f: int) -> Any:
    """Do the best of nine changes to a bad face: 3 j + 0, 1 collapse edge j, 3 j + FLIP flips it.

    Returns the change, or -1, and a vertex whose faces hold all that changed.
    """
    best, gain, loss = -1, REJECTED, np.inf
    for change in range(9):
        j, way = change // 3, change % 3
        if way == FLIP:
            new, volume = _try_flip(x, faces, on, head, after, f, j)
        else:
            a, b = faces[f, (j + way) % 3], faces[f, (j + 1 - way) % 3]
            new, volume = _try_collapse(x, faces, on, head, after, a, b, gain)
        new = min(new, FAIR)
        if new > gain or (new == gain and volume < loss and new >= 0.0):
            best, gain, loss = change, new, volume
    if best < 0:
        return -1, -1
    j, way = best // 3, best % 3
    if way == FLIP:
        v = faces[f, (j + 2) % 3]
        _flip(faces, head, after, f, j)
        return best, v
    a, v = faces[f, (j + way) % 3], faces[f, (j + 1 - way) % 3]
    _collapse(faces, head, after, a, v)
    return best, v


@inner()
def _mark(
    x: Any, faces: Any, head: Any, after: Any, v: int, quality: float, left: Any, changed: Any,
    clock: int,
) -> None:  # fmt: skip
    """Mark the bad faces at a vertex, and the vertices of all of its faces as changed."""
    changed[v] = clock
    h = head[v]
    while h >= 0:
        p, q = _others(faces, h)
        changed[p] = changed[q] = clock
        left[h // 3] |= _shape(x, v, p, q)[0] < quality
        h = after[h]


@outer()
def repair(
    x: Any, faces: Any, on: Any, head: Any, after: Any, bad: Any, quality: float, left: Any,
    changed: Any, tried: Any, done: Any,
) -> None:  # fmt: skip
    """Change every bad face once, in place, unless it was tried and nothing about it has changed.

    Parameters
    ----------
    x : (V, 3) array
        Vertices.
    faces : (F, 3) integer array
        Corners; removed faces become (-1, -1, -1).
    on : (V,) int16 array
        Surfaces of the vertices.
    head, after : integer arrays
        From `link_corners`.
    bad : (n,) integer array
        The faces to change, if they still are below `quality`.
    quality : float
        Faces below it are bad.
    left : (F,) array of bool, all False
        Receives True for faces that stayed bad, became bad, or are bad next to a change.
    changed : (V,) integer array, 0 at first
        Number of the last change of a face at a vertex.
    tried : (F,) integer array, -1 at first
        Number of changes when a face was tried last.
    done : (2,) integer array
        Numbers of collapses and flips, which are added to.
    """
    for f in bad:
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if a < 0 or _shape(x, a, b, c)[0] >= quality:
            continue
        left[f] = True
        if tried[f] >= max(changed[a], changed[b], changed[c]):
            continue
        tried[f] = done[0] + done[1]
        change, v = _repair_face(x, faces, on, head, after, f)
        if change < 0:
            continue
        left[f] = False
        done[1 if change % 3 == FLIP else 0] += 1
        _mark(x, faces, head, after, v, quality, left, changed, done[0] + done[1])
