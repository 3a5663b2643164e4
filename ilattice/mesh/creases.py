"""Sharp edges and corners of solids whose fields have kinks: vertices move onto the creases.

Contours of unions, intersections and meshes chamfer edges within a cell. Here every quad tells its
tangent plane, from the gradient of the field where the edge of the grid that it surrounds crosses
the surface; where the planes around a vertex differ, it moves to the point that is nearest to all
of them (dual contouring: Ju, Losasso, Schaefer and Warren, Proc. SIGGRAPH 2002), half a cell beyond
its own at most, and quads fold along the edge. Where triangles cross then, the vertex that moved
farthest goes to such a point in its own cell, and next back. Vertices next to given corners, those
of a mesh that is contoured again, move onto them: on the same grid a mesh becomes nearly itself,
however often.

Guarantees: the same triangles up to the diagonals of quads; vertices stay on the faces of the
domain that they lie on; away from creases nothing changes. Non-guarantees: creases that bend by
less than about 35 degrees stay chamfered, as do several of them in one cell, and wedges thinner
than a cell; after `TRIES` rounds triangles that still cross are left.
"""

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ilattice._geometry import between, fixed_coordinates, least_step
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.mesh import _kernels_creases as kernels
from ilattice.mesh._kernels_cells import CAP as ON_CAP
from ilattice.mesh._tracer import Contour
from ilattice.mesh.measure import self_intersections

__all__ = ["sharpened"]

BENT = np.cos(np.radians(10.0))  # normals farther than this from their mean make a crease
PLAIN = np.cos(np.radians(4.0))  # where quads bend less, there are no creases
OFF = 0.002  # spacings that vertices may be off smooth surfaces
FAR = 0.1  # spacings that places beyond the cells may be off, where places in them are not
SNAP = 0.2  # spacings that a corner may be away from the vertex that moves there
ON_SURFACE = 1e-9  # of the largest coordinate: how far corners on the surface may be off it
STEPS = 10  # of root finding along edges, at most
FOUND = 1e-11  # of the values at the ends of an edge: a value at its crossing that is small enough
BEYOND = 0.5  # widths of its cell that a vertex may be outside, where no triangles cross
TURNS = 30  # between planes and cells
TRIES = 12  # at most, to find places without crossing triangles
MAX_STEPS = 6  # steps at most from where planes meet to the surface
NEAR_ENOUGH = 1e-3  # spacings off it that are near enough
BACK = -0.9  # cosine between normals of triangles that lie on each other
RANK = 0.1  # smaller eigenvalues, as parts of the largest, are directions without a plane


def sharpened(raw: Contour, field: Any, axes: Any, corners: FloatArray | None = None) -> Contour:
    """A contour at level 0 with sharp edges.

    Parameters
    ----------
    raw : Contour
        Of `contour_arrays`, at level 0, before triangles were changed.
    field : object
        With `jet(points, order)`.
    axes : three 1-D arrays
        Planes of the grid.
    corners : (n, 3) array, optional
        Points of which those on the surface may become vertices.

    Returns
    -------
    Contour
        With other places of some vertices, and other diagonals of some quads.
    """
    x = np.ascontiguousarray(raw.vertices, np.float64)
    quads = np.concatenate((raw.faces[::2], raw.faces[1::2, 2:]), axis=1)
    real = _off_caps(raw.kind, quads)
    quads, rows = quads[real], np.flatnonzero(real)
    off, near = _suspects(field, x, raw.kind, quads, axes)
    around = quads[_touched(near, quads) > 0]
    foot, found = _crossings(field, x, around, axes)
    around, foot = around[found], foot[found]
    normal = _normals(field, foot)
    at = np.flatnonzero(off | (_bends(len(x), around, normal) < BENT))
    A, b = _equations(x, at, raw.kind, around, foot, normal)
    held = fixed_coordinates(raw.kind[at])
    wide, tight = (
        _projected(
            field, _kept(field, x[at], _nearest(x[at], A, b, axes, beyond)), x[at], held, axes,
            beyond,
        )
        for beyond in (BEYOND, 0.0)
    )  # fmt: skip
    wide = _nearer(field, wide, tight, axes)
    if corners is not None:
        at, wide, tight = _snapped(x, at, wide, tight, raw.kind, corners, field, axes)
    positions = np.stack([wide, tight, x[at]])
    new, faces = _folded(raw.faces, x, at, positions, quads, rows, field)
    return Contour(new.astype(raw.vertices.dtype), faces, raw.kind, raw.first_vertex)


def _suspects(
    field: Any, x: FloatArray, kind: AnyArray, quads: IntArray, axes: Any
) -> tuple[AnyArray, AnyArray]:
    """Which vertices are off the surface, being bent too much; and those that may be on creases.

    The field is asked only where quads bend.
    """
    facing = np.empty((len(quads), 3))
    kernels.facing(len(quads), x, quads, facing)
    bent = _bends(len(x), quads, facing) < PLAIN
    off, at = np.zeros(len(x), np.bool_), np.flatnonzero(bent & (kind & ON_CAP == 0))
    value, gradient = field.jet(x[at], 1)
    h = min(float(np.diff(planes).min()) for planes in axes)
    off[at] = np.abs(value) > OFF * h * np.linalg.norm(gradient, axis=1)
    some = quads[_touched(bent, quads) > 0]
    normal = _normals(field, x[some].mean(axis=1))
    near = off | (bent & (_bends(len(x), some, normal) < BENT))
    # of two vertices that cut a crease off, one may be on the surface, with quads of one side only
    near[quads[_touched(near, quads) > 0]] = True
    return off, near


def _folded(
    old: IntArray, x: FloatArray, at: IntArray, positions: FloatArray, quads: IntArray,
    rows: IntArray, field: Any,
) -> tuple[FloatArray, IntArray]:  # fmt: skip
    """Vertices and triangles; each takes the first of its positions at which no triangles cross.

    Of those of a triangle that crosses another, the one that has moved farthest takes its next
    place. After the first round only what has changed is folded, and compared with what is near.
    """
    new, faces, row = x.copy(), old.copy(), np.full(len(x), -1)
    row[at] = np.arange(len(at))
    moved, choice, changed = row >= 0, np.zeros(len(at), np.int64), at
    for _ in range(TRIES):
        new[changed] = positions[choice[row[changed]], row[changed]]
        moved[changed] = choice[row[changed]] < len(positions) - 1
        fresh = np.zeros(len(x), np.bool_)
        fresh[changed] = True
        part = _touched(fresh, quads) > 0
        _fold(field, new, moved, quads[part], rows[part], old, faces)
        active = np.zeros(len(faces), np.bool_)
        active[2 * rows[part]] = active[2 * rows[part] + 1] = True
        pairs, crossing = self_intersections(new, faces, active)
        if not pairs:
            break
        corners = faces[crossing]
        free = moved[corners]
        far = np.where(free, np.linalg.norm(new[corners] - x[corners], axis=2), -1.0)
        one = np.take_along_axis(corners, far.argmax(axis=1)[:, None], axis=1)
        changed = np.unique(one[free.any(axis=1)])
        choice[row[changed]] += 1
    return new, faces


def _snapped(
    x: FloatArray, at: IntArray, wide: FloatArray, tight: FloatArray, kind: AnyArray,
    corners: FloatArray, field: Any, axes: Any,
) -> tuple[IntArray, FloatArray, FloatArray]:  # fmt: skip
    """Vertices that move, with those that move onto a corner of the surface that is near."""
    new = x.copy()
    new[at] = wide
    h = min(float(np.diff(planes).min()) for planes in axes)
    size = float(np.abs(corners).max(initial=0.0))
    corners = corners[np.abs(field.jet(corners, 1)[0]) <= ON_SURFACE * size]
    if not len(corners):
        return at, wide, tight
    found: Any = cKDTree(corners).query(new, distance_upper_bound=SNAP * h)
    distance, own = found
    order = np.flatnonzero(np.isfinite(distance))
    order = order[np.argsort(distance[order], kind="stable")]
    more = order[np.unique(own[order], return_index=True)[1]]  # each corner for one vertex
    target = corners[own[more]]
    target = np.where(fixed_coordinates(kind[more]), x[more], target)
    low, high = _cells(new[more], axes)
    inside = ((low <= target) & (target <= high)).all(axis=1)
    new[more[inside]] = target[inside]
    every = np.union1d(at, more[inside])
    old = x.copy()
    old[at] = tight
    return every, new[every], old[every]


def _off_caps(kind: AnyArray, quads: IntArray) -> AnyArray:
    """Quads that do not lie in a face of the domain."""
    a, b, c, d = (kind[corner] for corner in quads.T)
    return np.asarray(a & b & c & d & 63 == 0)


def _touched(mask: AnyArray, quads: IntArray) -> AnyArray:
    """How many vertices of quads are in a mask (V,)."""
    out = np.empty(len(quads), np.uint8)
    kernels.touched(mask, quads, out)
    return out


def _normals(field: Any, x: FloatArray) -> FloatArray:
    """Directions of the gradient; zero where there is none."""
    gradient = field.jet(x, 1)[1]
    length = np.linalg.norm(gradient, axis=1)
    fine = np.isfinite(length) & (length > 0.0)
    return np.where(fine[:, None], gradient, 0.0) / np.where(fine, length, 1.0)[:, None]


def _crossings(
    field: Any, x: FloatArray, quads: IntArray, axes: Any
) -> tuple[FloatArray, AnyArray]:
    """Where the edges of the grid that quads surround cross the surface; if they do."""
    low, high = np.empty((2, len(quads), 3))
    found = np.empty(len(quads), np.bool_)
    kernels.edges(len(quads), x, quads, *axes, low, high, found)
    f, g = field(low), field(high)
    found &= f * g <= 0.0  # not so where corners lie on planes of the grid
    at = np.flatnonzero(found)
    foot, a, b = 0.5 * (low + high), low[at], high[at]
    ends = np.stack([f[at], g[at]], axis=1)
    t = between(field, a, b, ends, STEPS, FOUND * np.abs(ends[:, 0] - ends[:, 1]))
    foot[at] = a + t[:, None] * (b - a)
    return foot, found


def _bends(count: int, quads: IntArray, normal: FloatArray) -> FloatArray:
    """Least cosines between the normals of the quads around vertices and their mean."""
    least = np.ones(count)
    kernels.bends(quads, normal, np.zeros((count, 3)), least)
    return least


def _equations(
    x: FloatArray, at: IntArray, kind: AnyArray, quads: IntArray, foot: FloatArray,
    normal: FloatArray,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Of the vertices `at`: matrices and right sides of the nearest points to their planes."""
    place = np.full(len(x), -1)
    place[at] = np.arange(len(at))
    A, b = np.zeros((len(at), 3, 3)), np.zeros((len(at), 3))
    kernels.gather(quads, foot, normal, x, place, A, b)
    fixed = fixed_coordinates(kind[at])
    for a in range(3):
        A[fixed[:, a], a, :] = A[fixed[:, a], :, a] = b[fixed[:, a], a] = 0.0
    return A, b


def _nearest(x: FloatArray, A: FloatArray, b: FloatArray, axes: Any, beyond: float) -> FloatArray:
    """Points nearest to the planes around x, and to x, in cells that are wider by `beyond`.

    They stay in the grid: beyond it, fields need not be known.
    """
    size, way = np.linalg.eigh(A)
    used = size > RANK * size[:, 2:]
    inverse = np.einsum("nij,nj,nkj->nik", way, used / np.where(used, size, 1.0), way)
    low, high = _room(x, axes, beyond)
    new = np.empty_like(x)
    kernels.approach(len(x), x, A, b, inverse, low, high, TURNS, new)
    return new


def _room(x: FloatArray, axes: Any, beyond: float) -> tuple[FloatArray, FloatArray]:
    """Corners of the cells of points, wider by `beyond` but in the grid."""
    low, high = _cells(x, axes)
    least, most = (np.array([a[i] for a in axes]) for i in (0, -1))
    wider = beyond * (high - low)
    return np.maximum(low - wider, least), np.minimum(high + wider, most)


def _cells(x: FloatArray, axes: Any) -> tuple[FloatArray, FloatArray]:
    """Lower and upper corners of the cells that hold points."""
    low, high = np.empty((2, *x.shape))
    kernels.cells(len(x), x, *axes, low, high)
    return low, high


def _kept(field: Any, old: FloatArray, new: FloatArray) -> FloatArray:
    """`new` where the field there is as near to 0 as such a step allows, otherwise `old`."""
    value, gradient = field.jet(new, 1)
    reach = np.linalg.norm(new - old, axis=1) * np.linalg.norm(gradient, axis=1)
    before = np.abs(field(old))
    fine = np.abs(value) <= np.maximum(before, 0.25 * reach)
    out: FloatArray = np.where(fine[:, None], new, old)
    return out


def _projected(
    field: Any, new: FloatArray, old: FloatArray, held: AnyArray, axes: Any, beyond: float
) -> FloatArray:
    """`new`, moved onto the surface by Newton's steps; `old` where that is no nearer to it.

    Tangent planes of curved surfaces meet beside them: where the surface bends within a cell
    without a crease, by as much as the cell is wide.
    """
    h = min(float(np.diff(planes).min()) for planes in axes)
    low, high = _room(old, axes, beyond)
    out, at = new.copy(), np.arange(len(new))
    for _ in range(MAX_STEPS):
        value, gradient = field.jet(out[at], 1)
        gradient = np.where(held[at], 0.0, gradient)
        off = np.abs(value) > NEAR_ENOUGH * h * _lengths(gradient)
        at, value, gradient = at[off], value[off], gradient[off]
        if not len(at):
            return out
        out[at] = np.clip(out[at] - least_step(value, gradient), low[at], high[at])
    value, gradient = field.jet(out[at], 1)
    worse = np.abs(value) > np.maximum(np.abs(field(old[at])), OFF * h * _lengths(gradient))
    out[at[worse]] = old[at[worse]]
    return out


def _lengths(v: FloatArray) -> FloatArray:
    """Lengths (n,) of vectors (n, 3)."""
    return np.asarray(np.linalg.norm(v, axis=1))


def _nearer(field: Any, wide: FloatArray, tight: FloatArray, axes: Any) -> FloatArray:
    """`wide`, but `tight` where only that is near to the surface: corners out of reach."""
    h = min(float(np.diff(planes).min()) for planes in axes)
    value, gradient = field.jet(wide, 1)
    missed = np.abs(value) > FAR * h * np.linalg.norm(gradient, axis=1)
    missed &= 2.0 * np.abs(field(tight)) < np.abs(value)
    out: FloatArray = np.where(missed[:, None], tight, wide)
    return out


def _fold(
    field: Any, x: FloatArray, moved: AnyArray, quads: IntArray, rows: IntArray, old: IntArray,
    faces: IntArray,
) -> None:  # fmt: skip
    """Split quads with two moved vertices along the diagonal whose middle is nearer to the surface.

    Not along one beside the quad, where it is not convex, as beside curved creases: its triangles
    would lie on each other. Other quads keep their old diagonals.
    """
    faces[2 * rows], faces[2 * rows + 1] = old[2 * rows], old[2 * rows + 1]
    two = _touched(moved, quads) >= 2
    quads, rows = quads[two], rows[two]
    a, b, c, d = quads.T
    turn = np.abs(field(0.5 * (x[b] + x[d]))) < np.abs(field(0.5 * (x[a] + x[c])))
    straight, turned = _back_to_back(x, a, b, c, d), _back_to_back(x, b, c, d, a)
    turn = np.where(straight != turned, straight, turn)
    faces[2 * rows] = np.where(turn[:, None], quads[:, [1, 2, 3]], quads[:, [0, 1, 2]])
    faces[2 * rows + 1] = np.where(turn[:, None], quads[:, [1, 3, 0]], quads[:, [0, 2, 3]])


def _back_to_back(x: FloatArray, a: IntArray, b: IntArray, c: IntArray, d: IntArray) -> AnyArray:
    """Whether the triangles a b c and a c d of quads lie on each other."""
    one, two = np.cross(x[b] - x[a], x[c] - x[a]), np.cross(x[c] - x[a], x[d] - x[a])
    size = np.linalg.norm(one, axis=1) * np.linalg.norm(two, axis=1)
    out: AnyArray = np.einsum("ni,ni->n", one, two) < BACK * size
    return out
