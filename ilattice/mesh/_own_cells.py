"""Points of the offset in the cells of a contour, where polishing would lead out of them.

A cell that the contour crosses has corners on both sides of the surface, and the surface lies
between two of them. Vertices that stay in their cells hardly make triangles cross.

Guarantee: points lie in the cells, and on the exact offset where this is reported.
"""

from typing import TYPE_CHECKING

import numpy as np

from ilattice._typing import AnyArray, FloatArray
from ilattice.mesh._roots import between
from ilattice.offsets.polish import inside

if TYPE_CHECKING:
    from ilattice.offsets.wall import Wall

#: Secants, and the distance from the offset, relative to the half-thickness, that is none.
SECANTS, NONE = 12, 1e-6
BITS = np.indices((2, 2, 2)).reshape(3, -1).T


def in_own_cells(
    wall: "Wall", axes: tuple[FloatArray, ...], u: FloatArray, fixed: AnyArray, side: FloatArray
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

    Returns
    -------
    ndarray, shape (n, 3)
        Parameters of points in the cells.
    ndarray of bool, shape (n,)
        Those that are on the offset; the others keep their place.
    """
    asked = _asked(wall, u, side)
    f = _excess(wall, u, side)
    corners = _corners(axes, u, fixed)
    g = _excess(wall, corners.reshape(-1, 3), np.repeat(side, 8)).reshape(-1, 8)
    width = np.ptp(corners, axis=1)
    away = (corners - u[:, None]) / np.where(width > 0.0, width, 1.0)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        way = np.linalg.norm(away, axis=2) * (f[:, None] / (f[:, None] - g))
    way[~(f[:, None] * g < 0.0)] = np.inf
    at = np.flatnonzero(np.isfinite(way.min(axis=1, initial=np.inf)))
    best = way[at].argmin(axis=1)
    b, ends = corners[at, best], np.stack([f[at], g[at, best]], axis=1)
    out = u.copy()
    t = between(lambda v: _excess(wall, v, side[at]), u[at], b, ends, SECANTS)
    out[at] += t[:, None] * (b - u[at])
    return out, np.abs(_excess(wall, out, side)) <= NONE * np.abs(asked)


def _corners(axes: tuple[FloatArray, ...], u: FloatArray, fixed: AnyArray) -> FloatArray:
    """Corners (n, 8, 3) of the cells around points; along fixed coordinates they coincide."""
    out = np.empty((len(u), 8, 3))
    for a, planes in enumerate(axes):
        cell = np.clip(np.searchsorted(planes, u[:, a], side="right") - 1, 0, len(planes) - 2)
        ends = np.where(fixed[:, a, None], u[:, a, None], planes[cell[:, None] + np.arange(2)])
        out[:, :, a] = ends[:, BITS[:, a]]
    return out


def _excess(wall: "Wall", u: FloatArray, side: FloatArray) -> FloatArray:
    """How far points are beyond an offset surface."""
    u = inside(wall.lattice, u)
    asked = _asked(wall, u, side)
    out: FloatArray = side * wall.lattice.distance(u) - asked
    return out


def _asked(wall: "Wall", u: FloatArray, side: FloatArray) -> FloatArray:
    """Half-thickness on the side of each point."""
    outer, inner = wall.thickness.side(1.0), wall.thickness.side(-1.0)
    return np.where(side > 0, outer(u), inner(u))
