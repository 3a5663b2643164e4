"""Where a surface is that the seeds of closest points have missed.

Seeds come from the centres of cells, by Newton's method. A field that levels off away from its zero
set, as that of thin struts and plates does, tells nothing there, and whole plates between the
centres stay without seeds. Here they are found by changes of sign on a fine grid.

Guarantee: every part of the surface that separates points of the fine grid has a seed on its own
side of the solid within about a cell. Non-guarantee: parts between those points.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ilattice._geometry import grid_array, grid_points
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.offsets._kernels_patches import SHARP
from ilattice.offsets._small import solved
from ilattice.offsets.space import TileSpace

#: Cells within which a seed that faces alike must be, the least cosine between normals that are
#: alike, and seeds that are looked at.
NEAR, ALIKE, LOOKED_AT = 0.9, 0.75, 8
#: Gradients below this part of the median one are none, unless they are more than MIN_SLOPE of it
#: and surfaces that meet, with gradients falling towards there, would do so farther away than this.
FLAT, MIN_SLOPE, MEETING = 1e-2, 1e-4, 2e-3
#: Part of det J on faces next to which seeds are placed in layers, so many of them at most, and
#: places along each direction of a face where it is looked at.
FALLEN, MAX_LAYERS, ACROSS = 0.1, 12, 64
#: Sharp seeds that are looked at next to a seed.
BESIDE = 6
#: Steps downhill.
DOWNHILL = 24
#: Points of which Hessians are held at a time.
TOGETHER = 1 << 15


class Seeds(NamedTuple):
    """Points of the mid-surface from which closest points are searched, as kernels take them.

    Attributes
    ----------
    points, images : ndarray, shape (s, 3)
        In tile coordinates and in space.
    normals : ndarray, shape (s, 5) or (s, 16)
        Unit normals, and what bounds the surface around: see `_kernels_patches.BENT`.
    spacing : ndarray, shape (s,)
        Size in space of the cells that they stand for.
    """

    points: FloatArray
    images: FloatArray
    normals: FloatArray
    spacing: FloatArray


def crossings(field: Any, n: int) -> FloatArray:
    """Points near the zero set of a field on the unit cube.

    Parameters
    ----------
    field : object
        With `grid(axes)`.
    n : int
        Planes per direction.

    Returns
    -------
    ndarray, shape (k, 3)
        Linear roots along the edges of the grid whose ends differ in sign.
    """
    axis = np.linspace(0.0, 1.0, n)
    points = grid_array(axis, axis, axis)
    values = field.grid([axis] * 3)
    return np.concatenate([between(points, values, a) for a in range(3)])


def between(points: FloatArray, values: FloatArray, axis: int) -> FloatArray:
    """Linear roots between neighbours of a grid that differ in sign.

    Parameters
    ----------
    points : ndarray, shape (a, b, c, 3)
        The grid.
    values : ndarray, shape (a, b, c)
        Values on it.
    axis : int
        Direction in which neighbours are compared.

    Returns
    -------
    ndarray, shape (k, 3)
        The roots.
    """
    n = values.shape[axis]
    low, high = (np.take(values, part, axis) for part in (np.arange(n - 1), np.arange(1, n)))
    at = np.nonzero((low < 0.0) != (high < 0.0))
    f, g = low[at], high[at]
    p = points[at]
    ahead = points[tuple(i + (b == axis) for b, i in enumerate(at))]
    return p + (f / (f - g))[:, None] * (ahead - p)


def apart(points: FloatArray, others: FloatArray, m: int) -> AnyArray:
    """Of the points (n, 3) in each cell of size 1/m, the first one, where no other point is near.

    Parameters
    ----------
    points, others : ndarray, shape (n, 3) and (k, 3)
        Points in tile coordinates.
    m : int
        Cells per tile.

    Returns
    -------
    ndarray of bool, shape (n,)
        True for some that are half a cell from all others.
    """
    out = np.zeros(len(points), np.bool_)
    if len(points) == 0:
        return out
    cells = np.floor(2.0 * m * points).astype(np.int64)
    out[np.unique(cells, axis=0, return_index=True)[1]] = True
    if len(others):
        near: Any = cKDTree(others).query(points)
        out &= near[0] > 0.5 / m
    return out


def gaps(field: Any, points: FloatArray, seeds: FloatArray, m: IntArray) -> FloatArray:
    """Points of a surface that are far from all seeds on their side, at most a few per cell.

    Parameters
    ----------
    field : object
        With `jet(points, order)`; tells by its gradient which side faces where.
    points : ndarray, shape (k, 3)
        Points of its zero set, in the unit cube.
    seeds : ndarray, shape (s, 3)
        Seeds there are.
    m : ndarray of int, shape (3,)
        Cells per direction.

    Returns
    -------
    ndarray, shape (r, 3)
        Some of `points`, of every cell and octant of normals the one next to the middle.
    """
    points = points[regular(field, points)]
    normal = _normals(field, points)
    far = np.ones(len(points), np.bool_)
    if len(seeds) and len(points):
        tree = cKDTree(seeds * m)
        found: Any = tree.query(points * m, k=min(LOOKED_AT, len(seeds)), distance_upper_bound=NEAR)
        number = found[1].reshape(len(points), -1)
        facing = np.concatenate([_normals(field, np.clip(seeds, 0.0, 1.0)), np.zeros((1, 3))])
        far = ~(np.einsum("na,nka->nk", normal, facing[number]) > ALIKE).any(axis=1)
    points, normal = points[far], normal[far]
    cell = np.clip(np.floor(points * m), 0, m - 1)
    off = ((points * m - cell - 0.5) ** 2).sum(axis=1)  # planes may lie between cells
    octant = ((normal > 0.0) * np.array([4, 2, 1])).sum(axis=1)
    key = np.column_stack([cell.astype(np.int64), octant])
    order = np.lexsort([off, *key.T])
    _, first = np.unique(key[order], axis=0, return_index=True)
    return points[order[first]]


def layered(
    space: TileSpace, m: int, p: FloatArray, cell: FloatArray
) -> tuple[FloatArray, FloatArray, list[tuple[int, float]]]:
    """Seeds, and more, closer and closer to faces of the domain on which the map is singular.

    Parameters
    ----------
    space : TileSpace
        Gives the surface and its domain.
    m : int
        Seeds per tile and direction.
    p, cell : ndarray, shape (n, 3)
        Seeds, in tile coordinates, and the cells that they stand for.

    Returns
    -------
    p, cell : ndarray, shape (k, 3)
        More of them, on both sides of the faces; cells end at faces next to them.
    singular : list of (int, float)
        These faces: the direction across, and its coordinate.
    """
    cell = cell.copy()
    count, closed = space.lattice.repeat, np.array(space.lattice.through.closed)
    out, cells = [p], [cell]
    singular: list[tuple[int, float]] = []
    centres = [(np.arange(n * m) + 0.5) / m for n in count]
    for axis, end in ((int(a), e) for a in np.flatnonzero(~closed) for e in (0, count[a])):
        fixed = np.arange(3) == axis
        layers = layers_needed(space, centres, axis, float(end))
        if layers:
            singular.append((axis, float(end)))
            least = np.maximum(np.abs(p[:, axis] - end), 0.5**layers / m)
            cell[:, axis] = np.minimum(cell[:, axis], least)
        for k in range(layers):
            size = 0.5**k / m
            for plane in (end - size, end + size):
                axes = [np.array([plane]) if b == axis else centres[b] for b in range(3)]
                sites = grid_points(*axes)
                held = np.broadcast_to(fixed, sites.shape).astype(np.float64)
                out.append(space._project(sites, np.full(3, m), held))
                cells.append(np.where(fixed, size, np.full(out[-1].shape, 1.0 / m)))
    return np.concatenate(out), np.concatenate(cells), singular


def layers_needed(space: TileSpace, axes: list[FloatArray], axis: int, end: float) -> int:
    """How many layers of seeds, each half as far away, a face of the domain needs.

    Where det J falls on the way to it, cells shrink, and seeds as far apart as elsewhere tell
    nothing of the surface next to it.

    Parameters
    ----------
    space : TileSpace
        Gives the map.
    axes : list of ndarray
        Coordinates across the face; those along `axis` do not matter.
    axis : int
        Direction across the face.
    end : float
        Its coordinate.

    Returns
    -------
    int
        None unless det J falls to `FALLEN` of what it is half a tile away.
    """
    inner = abs(end - 0.5)
    places = [a if b == axis else a[:: max(1, len(a) // ACROSS)] for b, a in enumerate(axes)]
    there, here = (
        np.abs(space._volume(grid_points(*p)))
        for p in ([*places[:axis], np.array([x]), *places[axis + 1 :]] for x in (inner, end))
    )
    rest = float((here / np.maximum(there, np.finfo(np.float64).tiny)).min())
    if rest > FALLEN:
        return 0
    return min(MAX_LAYERS, 1 + int(np.ceil(-np.log2(max(rest, 1e-12)))))


def sharpest(x: FloatArray, turn: FloatArray, spacing: FloatArray) -> FloatArray:
    """How much normals of seeds turn, at most, over their spacing or that of seeds beside them.

    A seed on a plate may be the only one from which the foot on its rim, next to it, is found.

    Parameters
    ----------
    x : ndarray, shape (s, 3)
        Seeds in space.
    turn, spacing : ndarray, shape (s,)
        How much their normals turn, and their spacings.

    Returns
    -------
    ndarray, shape (s,)
        At least `turn`; more next to seeds that turn by more than `SHARP`.
    """
    out = turn.copy()
    sharp = np.flatnonzero(turn > SHARP)
    if 0 < len(sharp) < len(x):
        near: Any = cKDTree(x[sharp]).query(x, k=BESIDE, distance_upper_bound=spacing.max())
        other = np.append(turn[sharp], 0.0)[near[1]]
        other[near[0] > spacing[:, None]] = 0.0
        out = np.maximum(out, other.max(axis=1))
    return out


def downhill(space: TileSpace, x: FloatArray, p: FloatArray) -> FloatArray:
    """Points of the surface nearer and nearer to some points of space, by tangential steps.

    Parameters
    ----------
    space : TileSpace
        Gives the surface.
    x : ndarray, shape (n, 3)
        Points of space.
    p : ndarray, shape (n, 3)
        Points of the surface to start from, in tile coordinates.

    Returns
    -------
    ndarray, shape (n, 3)
        Points of the surface, in tile coordinates; none is farther than its start.
    """
    lattice = space.lattice
    p, part = p.copy(), np.ones(len(p))
    y = lattice.through.x(space.from_tile(p), extrapolate="extend")
    for _ in range(DOWNHILL):
        u = space.from_tile(p)
        jacobian = lattice.through.jacobian(u, extrapolate="extend") * space.step
        g = lattice.implicit_jet(u, 1)[1] * space.step
        metric = np.einsum("nca,ncb->nab", jacobian, jacobian)
        pull = np.einsum("nca,nc->na", jacobian, x - y)
        both = solved(metric, np.stack([pull, g], axis=2))
        gg = np.maximum((g * both[:, :, 1]).sum(axis=1), np.finfo(np.float64).tiny)
        step = both[:, :, 0] - ((g * both[:, :, 0]).sum(axis=1) / gg)[:, None] * both[:, :, 1]
        step = np.where(np.isfinite(step), step, 0.0)
        q, moved = space.on_surface(np.clip(p + part[:, None] * step, *space.box))
        z = lattice.through.x(space.from_tile(q), extrapolate="extend")
        better = ((x - z) ** 2).sum(axis=1) < ((x - y) ** 2).sum(axis=1)
        better &= np.isfinite(moved) & ((q >= space.box[0]) & (q <= space.box[1])).all(axis=1)
        p[better], y[better] = q[better], z[better]
        part = np.where(better, np.minimum(1.0, 2.0 * part), 0.5 * part)
    return p


def regular(field: Any, points: FloatArray) -> AnyArray:
    """Which points of a surface have a normal, and are not where surfaces meet.

    Parameters
    ----------
    field : object
        With `jet(points, order)`.
    points : ndarray, shape (n, 3)
        Points of its zero set, in the unit cube or next to it.

    Returns
    -------
    ndarray of bool, shape (n,)
        True where the gradient is not much less than the median one, or not so for the Hessian;
        True everywhere if the median is zero.
    """
    if len(points) == 0:
        return np.ones(0, np.bool_)
    points = np.clip(points, 0.0, 1.0)
    slope = np.linalg.norm(field.jet(points, 1)[1], axis=1)
    usual = np.median(slope)
    out: AnyArray = slope >= FLAT * usual
    low = np.flatnonzero(~out & (slope > MIN_SLOPE * usual))
    if len(low):  # as far from where surfaces meet as the gradient by the Hessian, up to a factor
        bend = np.linalg.norm(field.jet(points[low], 2)[2], axis=(1, 2))
        out[low] = slope[low] > MEETING * bend
    return out


def bends(field: Any, points: FloatArray) -> FloatArray:
    """How much normals of a surface turn per unit of length, at most, up to the root of two.

    Parameters
    ----------
    field : object
        With `jet(points, order)`.
    points : ndarray, shape (n, 3)
        Points of its zero set, in the unit cube.

    Returns
    -------
    ndarray, shape (n,)
        Norms of their curvatures, in tile coordinates; infinite where there is no normal.
    """
    out = np.empty(len(points))
    for i in range(0, len(points), TOGETHER):
        _, gradient, hessian = field.jet(points[i : i + TOGETHER], 2)
        length = np.linalg.norm(gradient, axis=1)
        normal = gradient / np.where(length > 0.0, length, 1.0)[:, None]
        along = np.eye(3) - normal[:, :, None] * normal[:, None, :]
        bend = np.linalg.norm(along @ hessian @ along, axis=(1, 2))
        out[i : i + TOGETHER] = np.divide(
            bend, length, out=np.full(len(length), np.inf), where=length > 0.0
        )
    return out


def falls(field: Any, points: FloatArray, m: IntArray) -> FloatArray:
    """How fast fields lose their slope along their surface, as where that meets itself.

    There it is one by the distance in cells.

    Parameters
    ----------
    field : object
        With `jet(points, order)`.
    points : ndarray, shape (n, 3)
        Points of its zero set, in the unit cube.
    m : ndarray of int, shape (3,)
        Cells per direction.

    Returns
    -------
    ndarray, shape (n,)
        Relative to the slope there; infinite where that is zero.
    """
    out = np.empty(len(points))
    for i in range(0, len(points), TOGETHER):
        _, gradient, hessian = field.jet(np.clip(points[i : i + TOGETHER], 0.0, 1.0), 2)
        gradient, hessian = gradient / m, hessian / np.outer(m, m)
        length = np.linalg.norm(gradient, axis=1)
        normal = gradient / np.where(length > 0.0, length, 1.0)[:, None]
        change = np.einsum("nab,nb->na", hessian, normal)
        change -= (change * normal).sum(axis=1)[:, None] * normal
        lost = np.linalg.norm(change, axis=1)
        out[i : i + TOGETHER] = np.divide(
            lost, length, out=np.full(len(length), np.inf), where=length > 0.0
        )
    return out


def _normals(field: Any, points: FloatArray) -> FloatArray:
    gradient = field.jet(points, 1)[1]
    length = np.linalg.norm(gradient, axis=1, keepdims=True)
    return gradient / np.where(length > 0.0, length, 1.0)
