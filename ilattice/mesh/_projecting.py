"""Vertices of a contour moved onto the exact offset, and what is off it in the end.

A vertex that polishing cannot move, or moves too far, goes to where the offset passes through its
own cell, or through the cells around it. What is on a face of the domain and within the wall needs
no offset: it belongs to the cap.

Guarantee: vertices that are not reported are within `MISSED` of the offset, relative to the
half-thickness that was asked for; where that is zero, to the least total thickness.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ilattice._geometry import cell_sizes, fixed_coordinates
from ilattice._typing import AnyArray, FloatArray
from ilattice.mesh._own_cells import at_jumps, in_own_cells, signed
from ilattice.offsets._kernels_newton import FALLBACK
from ilattice.offsets.polish import inside, polish

if TYPE_CHECKING:
    from ilattice.offsets.wall import OffsetSolid

#: A vertex that polishing moves by more cells, and by more than a span of the distance spline, has
#: strayed; one that is still off by more than this part of the half-thickness has missed.
STRAY, MISSED = 3.0, 1e-4
#: Half-thicknesses below this part of the least total thickness count as that.
MIN_HALF = 1e-2
#: Part of the longest edge of a cell by which vertices at creases may be off, and the cosine
#: between normals a cell apart that tells of one.
CUT, TURNED = 0.1, 0.866
#: Vertices that are looked at again together in the end, and the error from which on they are off.
CHECKED, OFF = 20_000, 1e-3
#: How many cells around a vertex are searched for the offset, one after the other.
AROUND = (0, 1)


def projected(
    wall: OffsetSolid,
    axes: tuple[FloatArray, ...],
    u: FloatArray,
    kind: AnyArray,
    side: FloatArray,
    *,
    exactly: bool,
) -> tuple[FloatArray, AnyArray]:
    """Vertices of the offset surfaces moved onto the offset: that of the spline, or the exact one.

    Parameters
    ----------
    wall : Wall
        The wall.
    axes : three 1-D arrays
        The grid planes of its contour.
    u : ndarray, shape (V, 3)
        Parameters of the vertices.
    kind, side : ndarray, shape (V,)
        Constraints (see `Contour`), and which offset surface they belong to, 0 for none.
    exactly : bool
        Go by closest points instead of the distance spline.

    Returns
    -------
    ndarray, shape (V, 3)
        Parameters of the moved vertices.
    ndarray of bool, shape (V,)
        Those that could not be moved, and keep their place.
    """
    fixed = fixed_coordinates(kind)
    out = u.copy()
    lost = np.zeros(len(u), np.bool_)
    for sign in (1.0, -1.0):
        t = wall.thickness
        d = t.side(sign) if exactly else t.outer if sign > 0 else t.inner
        at = np.flatnonzero(side == sign)
        if len(at):
            moved, residual = polish(
                wall.lattice, u[at], fixed[at], side[at], d, None if exactly else wall.drawn,
                wall.distance if exactly else None,
            )  # fmt: skip
            stay = strayed(wall, axes, u[at], moved)
            stay |= residual > MISSED * measure(wall, u[at], side[at])
            out[at] = np.where(stay[:, None], u[at], moved)
            lost[at] = stay
    for cells in AROUND if exactly else ():
        at = np.flatnonzero(lost)
        if len(at):
            within = measure(wall, u[at], side[at])
            out[at], found = in_own_cells(wall, axes, u[at], fixed[at], side[at], within, cells)
            lost[at[found]] = False
    return out, lost


def measure(wall: OffsetSolid, u: FloatArray, side: FloatArray) -> FloatArray:
    """What errors of the half-thickness are compared with at parameters (n, 3): its size (n,)."""
    size, least = np.abs(wall.thickness.at(u, side)), wall.least_thickness
    out: FloatArray = np.where(size < MIN_HALF * least, least, size)
    return out


class Classes(NamedTuple):
    """What vertices that may be off turn out to be, each an array of bool, shape (V,).

    Attributes
    ----------
    off
        Off by more than `MISSED`.
    jump
        Likewise, but where the distance jumps, so that there is no offset to be on.
    crease
        Likewise, but where normals turn within a cell, as at edges of the wall, which triangles
        cut; off by at most `CUT` of the longest edge of their cells.
    cap
        On a face of the domain and within the wall: no vertices of the offset.
    """

    off: AnyArray
    jump: AnyArray
    crease: AnyArray
    cap: AnyArray

    @property
    def unconverged(self) -> AnyArray:
        """Vertices that are off the offset for any reason."""
        out: AnyArray = self.off | self.jump | self.crease
        return out


def classified(
    wall: OffsetSolid,
    axes: tuple[FloatArray, ...],
    u: FloatArray,
    kind: AnyArray,
    side: FloatArray,
    suspect: AnyArray,
) -> Classes:
    """What vertices are that may be off the offset.

    Parameters
    ----------
    wall, axes
        As in `projected`.
    u, kind, side : ndarray, shape (V, 3), (V,) and (V,)
        Vertices, as in `projected`.
    suspect : ndarray of bool, shape (V,)
        Those that may be off.

    Returns
    -------
    Classes
        What they are.
    """
    out = Classes(*np.zeros((4, len(u)), np.bool_))
    at = np.flatnonzero(suspect & (side != 0))
    if len(at) == 0:
        return out
    s, p, fixed = signed(wall, u[at]), u[at], fixed_coordinates(kind[at])
    size = measure(wall, p, side[at])
    sides = np.ones(len(p))
    beyond = np.maximum(*(wall.thickness.clearance(p, e, s) for e in (sides, -sides)))
    out.cap[at] = (beyond < -MISSED * size) & fixed.any(axis=1)
    at, size = at[off := ~(np.abs(beyond) <= MISSED * size) & ~out.cap[at]], size[off]
    jump = at_jumps(wall, axes, u[at], fixed[off], side[at], size)
    crease = ~jump & _at_creases(wall, axes, u[at], side[at])
    out.jump[at], out.crease[at], out.off[at] = jump, crease, ~jump & ~crease
    return out


def _at_creases(
    wall: OffsetSolid, axes: tuple[FloatArray, ...], u: FloatArray, side: FloatArray
) -> AnyArray:
    """Which vertices (n,) are off by a part of their cells, where normals turn within a cell."""
    if len(u) == 0:
        return np.zeros(0, np.bool_)
    cell = cell_sizes(axes, u)
    edges = np.linalg.norm(wall.lattice.through.jacobian(u), axis=1) * cell
    ways = np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    around = inside(wall.lattice, (u[:, None] + ways * cell[:, None]).reshape(-1, 3))
    found = wall.lattice.search.query(around, strict=False)
    normal = (wall.lattice.through.x(around) - found.foot).reshape(len(u), len(ways), 3)
    length = np.abs(found.distance).reshape(len(u), len(ways))
    normal /= np.where(length > 0.0, length, 1.0)[:, :, None]
    turned = np.einsum("na,nka->nk", normal[:, 0], normal).min(axis=1) < TURNED
    off = wall.thickness.clearance(u, side, found.distance.reshape(length.shape)[:, 0])
    out: AnyArray = turned & (np.abs(off) <= CUT * edges.max(axis=1))
    return out


def not_projected(
    wall: OffsetSolid, u: FloatArray, side: FloatArray, free: AnyArray
) -> tuple[AnyArray, float, float]:
    """Vertices that are off the offset by closest points looked for anew, all of them together.

    Parameters
    ----------
    wall : Wall
        The wall.
    u, side : ndarray, shape (V, 3) and (V,)
        Vertices.
    free : ndarray of bool, shape (V,)
        Those that are taken to be on the offset.

    Returns
    -------
    ndarray of bool, shape (V,)
        Those that have missed it, of `CHECKED` of them; where some are off, of all.
    float
        The part of these that is off by more than `OFF`.
    float
        The part whose feet only neighbours have found.
    """
    out = np.zeros(len(u), np.bool_)
    at = np.random.default_rng(0).permutation(np.flatnonzero(free))
    if len(at) == 0:
        return out, 0.0, 0.0
    looked, off, mended = 0, 0, 0
    while looked < len(at) and (looked == 0 or off):  # where some are off, others may be
        part = np.sort(at[looked : looked + CHECKED])
        error, found = _errors(wall, u[part], side[part])
        out[part[error > MISSED]] = True
        looked, off, mended = looked + len(part), off + int((error > OFF).sum()), mended + found
    return out, off / looked, mended / looked


def _errors(wall: OffsetSolid, u: FloatArray, side: FloatArray) -> tuple[FloatArray, int]:
    """How far vertices are off by closest points of all, and how many only neighbours have found.

    Relative to what `measure` says; zero where only a fallback has found closest points.
    """
    before = wall.lattice.statistics.mended
    found = wall.lattice.search.query(u, strict=False, thorough=True)
    error = np.abs(wall.thickness.clearance(u, side, found.distance)) / measure(wall, u, side)
    error = np.where(np.isnan(error), np.inf, error)
    out: FloatArray = np.where(found.status < FALLBACK, error, 0.0)
    return out, wall.lattice.statistics.mended - before


def strayed(
    wall: OffsetSolid, axes: tuple[FloatArray, ...], u: FloatArray, moved: FloatArray
) -> AnyArray:
    """Which vertices moved much further than the distance spline is expected to be wrong.

    That happens next to the places where a mid-surface meets itself.

    Parameters
    ----------
    wall : Wall
        The wall.
    axes : three 1-D arrays
        The grid planes of its contour.
    u, moved : ndarray, shape (n, 3)
        Parameters before and after.

    Returns
    -------
    ndarray of bool, shape (n,)
        True where the move is longer than `STRAY` cells and a span along some direction.
    """
    lo, hi = wall.lattice.domain
    far = np.zeros(len(u), np.bool_)
    for a in range(3):
        move = np.abs(moved[:, a] - u[:, a])
        if wall.lattice.through.closed[a]:
            move = np.minimum(move, np.abs(hi[a] - lo[a] - move))
        size = cell_sizes(axes[a : a + 1], u[:, a : a + 1])[:, 0]
        span = (hi[a] - lo[a]) / (len(wall.distance.breaks(a)) - 1)
        far |= move > np.maximum(span, STRAY * size)
    return far
