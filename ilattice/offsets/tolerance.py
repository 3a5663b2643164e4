"""Walls to a tolerance: the distance spline, refined where the wall is not right yet.

Smaller spans need the distance at many more sites. Closest points give it only where it matters:
near the offset surfaces, where the second derivatives of the last spline jump, which they do about
the creases and focal curves of the distance. Elsewhere the last spline does.

Guarantee: the error is measured by fresh closest points on the level sets of the spline itself,
and 99 of 100 are at most the tolerance. Non-guarantees: the hundredth may be off by more; away
from its walls the spline stays as it was before.
"""

from __future__ import annotations

from dataclasses import replace
from math import ceil
from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy.ndimage import maximum_filter

from ilattice._geometry import grid_indices, grid_points, least_step
from ilattice._memory import available, readable
from ilattice._progress import Progress
from ilattice._typing import AnyArray, FloatArray
from ilattice.errors import ConvergenceError
from ilattice.macroshape.planes import grid_axes
from ilattice.offsets.distance_spline import DEGREE, interpolated

if TYPE_CHECKING:
    from ilattice.offsets.wall import OffsetSolid

#: Spans per tile at most: nearly a million coefficients each.
MAX_SPANS_PER_TILE = 96
CHECKED = 1 << 15  # points of the offset surfaces at which the error is measured
ORDER = 1.5  # of the 99th percentile in the size of spans: 1.3 to 2 at creases, 3 elsewhere
SMOOTH_ORDER = 3.0  # of distances without creases
HOPELESS = 1.5  # times as many spans as are allowed, needed even so
BATCHES = 64  # of random points, of which some are near enough
SAFE = 0.85  # part of the tolerance to be reached there, for meshes have their vertices elsewhere
MIN_FACTOR = 1.4  # times as many spans at once, for every step costs about the same
MAX_FACTOR = 2.0  # times as many spans at once: creases stand out in splines right elsewhere
NEAR = 0.1  # cells of a mesh that they may be off before they are moved onto the surfaces
STEPS = 4  # of Newton's method, with which these points follow the spline
REACH = 2.0  # spans from an offset surface within which samples act on it
BLUR = 0.15  # spans of the last spline by which its level sets may be off at creases
SMOOTH = 0.25  # part of the tolerance by which a spline that is taken over may be off
JUMP = 0.05  # error of a spline at a crease, per jump of its second derivative times span squared


def refined(wall: OffsetSolid, tol: float, progress: Progress = None) -> OffsetSolid:
    """The wall with a distance spline of which 99 of 100 errors are at most a tolerance.

    Parameters
    ----------
    wall : Wall
        Where refinement begins.
    tol : float
        Error of the half-thickness, in units of length.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Returns
    -------
    Wall
        With another distance spline, or the same wall where it was good enough.

    Raises
    ------
    ConvergenceError
        If `tol` is not met with `MAX_SPANS_PER_TILE` spans per tile; at once where even a smooth
        distance would need far more.
    """
    spans = wall.lattice.spans
    u = _probes(wall)
    while len(u):
        u = _onto(wall, u)
        reached = float(np.percentile(wall._errors(u, wall.field.side(u))[0], 99))
        if reached <= SAFE * tol:
            break
        if spans >= MAX_SPANS_PER_TILE:
            raise ConvergenceError(
                f"tol={tol:g} is not met: the half-thickness is still off by {reached:g} with "
                f"{spans} spans per tile; ask for less, or polish the mesh"
            )
        least = spans * (reached / tol) ** (1 / SMOOTH_ORDER)
        if least > HOPELESS * MAX_SPANS_PER_TILE:
            raise ConvergenceError(_too_fine(wall, tol, reached, spans, least))
        more = min(max((reached / tol) ** (1 / ORDER), MIN_FACTOR), MAX_FACTOR)
        finer = min(4 * ceil(0.25 * spans * more), MAX_SPANS_PER_TILE)
        samples = _Samples(wall, spans, finer, SMOOTH * tol)
        spline = interpolated(wall.lattice, samples, finer, DEGREE, progress)
        wall, spans = replace(wall, distance=spline), finer
    return wall


def _too_fine(wall: OffsetSolid, tol: float, reached: float, spans: int, least: float) -> str:
    """What a tolerance would need, even if the distance were smooth."""
    size = 8.0 * least**3 * float(np.prod(np.array(wall.lattice.repeat, float)))
    best = reached * (spans / MAX_SPANS_PER_TILE) ** ORDER
    return (
        f"tol={tol:g} needs at least {least:.3g} spans per tile, {readable(size)} of memory, of "
        f"which {readable(available())} are free; at most {MAX_SPANS_PER_TILE} spans are allowed: "
        f"the half-thickness is off by {reached:.2g} with {spans}; use tol >= {best:.1g}"
    )


def _probes(wall: OffsetSolid) -> FloatArray:
    """Random points near the offset surfaces, as dense as the vertices of a mesh."""
    axes = grid_axes(wall.lattice, wall.least_thickness)
    random = np.random.default_rng(0)
    found = np.empty((0, 3))
    for _ in range(BATCHES):
        place = [random.random(CHECKED) * (len(a) - 1) for a in axes]
        u = np.stack([np.interp(p, np.arange(len(a)), a) for p, a in zip(place, axes, strict=True)])
        cell = np.stack([np.diff(a)[p.astype(int)] for p, a in zip(place, axes, strict=True)])
        f, g = wall.field.jet(u.T, 1)
        slope = np.linalg.norm(g * cell.T, axis=1)
        found = np.concatenate((found, u.T[np.abs(f) <= NEAR * slope]))[:CHECKED]
        if len(found) == CHECKED:
            break
    return found


def _onto(wall: OffsetSolid, u: FloatArray) -> FloatArray:
    """Points moved along the gradient, in tiles, onto the level sets of a wall."""
    lo, hi = wall.lattice.domain
    tile = _tile(wall)
    most = 0.5 * tile / wall.lattice.spans
    for _ in range(STEPS):
        f, g = wall.field.jet(u, 1)
        step = least_step(f, g * tile) * tile
        u = np.clip(u - np.clip(step, -most, most), lo, hi)
    return u


def _tile(wall: OffsetSolid) -> FloatArray:
    """Lengths of a tile in the parameters."""
    lo, hi = wall.lattice.domain
    size: FloatArray = (hi - lo) / np.array(wall.lattice.repeat)
    return size


class _Samples:
    """Distances at the sites of a finer spline, by closest points where these are needed."""

    def __init__(self, wall: OffsetSolid, spans: int, finer: int, smooth: float) -> None:
        self.wall, self.spans = wall, spans
        self.rough = _rough(wall, smooth)
        self.span = _tile(wall) / finer
        self.least = 0.5 * _least_edges(wall) / finer  # at creases, where gradients cancel
        self.reach = REACH + BLUR * finer / spans

    def _box(self, u: FloatArray, per_tile: int) -> tuple[AnyArray, ...]:
        """Places of parameters in a grid of so many boxes per tile and direction."""
        lo, hi = self.wall.lattice.domain
        count = per_tile * np.array(self.wall.lattice.repeat)
        return tuple(np.clip(((u - lo) / (hi - lo) * count).astype(np.int64), 0, count - 1).T)

    def __call__(self, u: FloatArray, _strides: tuple[int, ...]) -> FloatArray:
        """Distances, shape (n,), at parameters (n, 3)."""
        s: FloatArray
        wall = self.wall
        s, g = wall.distance.jet(u, 1)
        gap = np.abs(s - wall.thickness.outer(u))
        gap = np.minimum(gap, np.abs(s + wall.thickness.inner(u)))
        rise = np.maximum(np.linalg.norm(g * self.span, axis=1), self.least[self._box(u, 1)])
        near = gap <= self.reach * rise
        at = np.flatnonzero(near & self.rough[self._box(u, self.spans)])
        s[at] = wall.lattice.distance(u[at])
        return s


def _rough(wall: OffsetSolid, least: float) -> AnyArray:
    """Spans in or next to which the distance spline may be off by more than `least`."""
    spline, closed = wall.distance, wall.lattice.through.closed
    shape = tuple(len(spline.breaks(a)) - 1 for a in range(3))
    rough = np.zeros(shape, dtype=bool)
    for a in range(3):
        bend = spline.derivative(a).derivative(a).c
        bend = bend[tuple(slice(None) if b == a else slice(1, -1) for b in range(3))]
        width = np.diff(spline.breaks(a)).max()
        jump = np.abs(np.diff(bend, axis=a)) * (JUMP * width**2) > least
        for side in (slice(None, -1), slice(1, None)):
            rough[tuple(side if b == a else slice(None) for b in range(3))] |= jump
    modes: list[Literal["wrap", "nearest"]] = ["wrap" if c else "nearest" for c in closed]
    out: AnyArray = maximum_filter(rough, size=3, mode=modes)
    return out


def _least_edges(wall: OffsetSolid) -> FloatArray:
    """Shortest edges of the tiles in space, at their corners and centres, (nx, ny, nz)."""
    lattice, lo, tile = wall.lattice, wall.lattice.domain[0], _tile(wall)
    corners = grid_points([0, 1], [0, 1], [0, 1])
    size = np.full(int(np.prod(lattice.repeat)), np.inf)
    for place in [*corners, np.full(3, 0.5)]:
        u = lo + (grid_indices(lattice.repeat) + place) * tile
        edges = np.linalg.norm(lattice.through.jacobian(u) * tile, axis=1)
        size = np.minimum(size, edges.min(axis=1))
    return size.reshape(lattice.repeat)
