"""Points of the offset in the cells of a contour, where polishing would lead out of them.

A cell that the contour crosses has corners on both sides of the surface, and the surface lies
between two of them. Vertices that stay in their cells hardly make triangles cross.

Guarantee: points lie in the cells, and on the exact offset where this is reported. Where the
distance jumps there is no offset, though the wall ends there: `at_jumps` tells such vertices.
"""

from typing import TYPE_CHECKING

import numpy as np

from ilattice._geometry import CORNERS, between, cells_at
from ilattice._typing import AnyArray, FloatArray
from ilattice.offsets._kernels_newton import FALLBACK
from ilattice.offsets.polish import inside

if TYPE_CHECKING:
    from ilattice.offsets.wall import OffsetSolid

#: Secants, and the distance from the offset, relative to the half-thickness, that is none.
SECANTS, NONE = 12, 1e-6
#: Halvings of a way that find a jump, and how large it is at least, relative to the half-thickness;
#: where the ends differ by less than this part of that, there is none.
HALVINGS, JUMP, SMOOTH = 40, 1e-2, 0.1


def in_own_cells(
    wall: "OffsetSolid",
    axes: tuple[FloatArray, ...],
    u: FloatArray,
    fixed: AnyArray,
    side: FloatArray,
    size: FloatArray,
    around: int = 0,
) -> tuple[FloatArray, AnyArray]:
    """Points of the offset on the shortest ways from vertices to corners of their cells.

    Parameters
    ----------
    wall : Wall
        The wall.
    axes : three 1-D arrays
        The grid planes of its contour.
    u : ndarray, shape (n, 3)
        Parameters of vertices of the contour, each in its cell.
    fixed : ndarray of bool, shape (n, 3)
        Coordinates that must not change.
    side : ndarray, shape (n,)
        Which offset surface they belong to, +1 or -1.
    size : ndarray, shape (n,)
        Half-thickness that distances from the offset are compared with.
    around : int
        How many cells the box around the cell of a vertex is wider on every side.

    Returns
    -------
    ndarray, shape (n, 3)
        Parameters of points in the cells.
    ndarray of bool, shape (n,)
        Those that are on the offset; the others keep their place.
    """
    out = u.copy()
    at, b, ends = _brackets(wall, axes, u, fixed, side, around)
    t = between(lambda v: _clearance(wall, v, side[at]), u[at], b, ends, SECANTS)
    out[at] += t[:, None] * (b - u[at])
    found = np.zeros(len(u), np.bool_)
    end, of = inside(wall.lattice, out[at]), side[at]
    found[at] = np.abs(wall.thickness.clearance(end, of, signed(wall, end))) <= NONE * size[at]
    out[~found] = u[~found]
    return out, found


def at_jumps(
    wall: "OffsetSolid", axes: tuple[FloatArray, ...], u: FloatArray, fixed: AnyArray,
    side: FloatArray, size: FloatArray,
) -> AnyArray:  # fmt: skip
    """Where the wall ends in or next to the cells of vertices because the distance jumps.

    Parameters
    ----------
    wall, axes, u, fixed, side, size
        As in `in_own_cells`.

    Returns
    -------
    ndarray of bool, shape (n,)
        True where halving a way from the vertex to a corner leaves a jump by more than a
        hundredth of `size`, though the foot on either side was looked for on the other, too.
    """
    at, b, ends = _brackets(wall, axes, u, fixed, side, 1)
    out = np.zeros(len(u), np.bool_)
    a = u[at]
    for _ in range(HALVINGS):
        middle = 0.5 * (a + b)
        f = _clearance(wall, middle, side[at])
        same = (f >= 0.0) == (ends[:, 0] >= 0.0)
        a, b = np.where(same[:, None], middle, a), np.where(same[:, None], b, middle)
        ends = np.where(np.stack([same, ~same], axis=1), f[:, None], ends)
        left = np.abs(ends[:, 1] - ends[:, 0]) > SMOOTH * JUMP * size[at]
        at, a, b, ends = at[left], a[left], b[left], ends[left]
        if len(at) == 0:
            return out
    both = np.stack([a, b], axis=1).reshape(-1, 3)  # as neighbours, which share feet
    ends = _clearance(wall, both, np.repeat(side[at], 2)).reshape(-1, 2)
    out[at] = np.abs(ends[:, 1] - ends[:, 0]) > JUMP * size[at]
    return out


def _brackets(
    wall: "OffsetSolid", axes: tuple[FloatArray, ...], u: FloatArray, fixed: AnyArray,
    side: FloatArray, around: int,
) -> tuple[AnyArray, FloatArray, FloatArray]:  # fmt: skip
    """Vertices between which and a corner the offset is, that corner, and how far both are off."""
    f = _clearance(wall, u, side)
    corners = _corners(axes, u, fixed, around)
    some, row = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    some, row = inside(wall.lattice, some), row.ravel()
    distance = wall.lattice.search.query(some, strict=False).distance[row]
    of = np.repeat(side, 8)
    g = wall.thickness.clearance(some[row], of, distance).reshape(-1, 8)
    width = np.ptp(corners, axis=1)
    away = (corners - u[:, None]) / np.where(width > 0.0, width, 1.0)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        way = np.linalg.norm(away, axis=2) * (f[:, None] / (f[:, None] - g))
    way[~(f[:, None] * g < 0.0)] = np.inf
    at = np.flatnonzero(np.isfinite(way.min(axis=1, initial=np.inf)))
    best = way[at].argmin(axis=1)
    return at, corners[at, best], np.stack([f[at], g[at, best]], axis=1)


def _corners(
    axes: tuple[FloatArray, ...], u: FloatArray, fixed: AnyArray, around: int
) -> FloatArray:
    """Corners (n, 8, 3) of the cells around points; along fixed coordinates they coincide."""
    out = np.empty((len(u), 8, 3))
    for a, (planes, cell) in enumerate(zip(axes, cells_at(axes, u).T, strict=True)):
        low, high = np.maximum(cell - around, 0), np.minimum(cell + 1 + around, len(planes) - 1)
        ends = np.where(fixed[:, a, None], u[:, a, None], planes[np.stack([low, high], axis=1)])
        out[:, :, a] = ends[:, CORNERS[:, a]]
    return out


def signed(wall: "OffsetSolid", u: FloatArray) -> FloatArray:
    """Signed distances at parameters (n, 3); NaN where the search fails."""
    found = wall.lattice.search.query(u, strict=False)
    out: FloatArray = np.where(found.status >= FALLBACK, np.nan, found.distance)
    return out


def _clearance(wall: "OffsetSolid", u: FloatArray, side: FloatArray) -> FloatArray:
    """How far points are beyond an offset surface, by the nearest seed where the search fails."""
    u = inside(wall.lattice, u)
    found = wall.lattice.search.query(u, strict=False)
    return wall.thickness.clearance(u, side, found.distance)
