"""Relative densities of walls, and walls of a given relative density.

Guarantees: densities come from cut-cell quadrature of the wall, not from counting; one evaluation
computes no closest points; what is returned has the asked density within `TOLERANCE`, as a part of
it (for cells `CELL_TOLERANCE`, and `CELL_PART` of it), or an error is raised. Non-guarantee: the
wall is that of the distance spline; a polished mesh of it differs where the spline is wrong.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ilattice._geometry import between, grid_indices
from ilattice._progress import Progress, track
from ilattice._typing import FloatArray, IntArray
from ilattice._validate import as_array, asked
from ilattice.bspline import BSpline
from ilattice.bspline.knots import uniform_knots, with_planes
from ilattice.errors import ConvergenceError, GeometryError, InputError, PrecisionWarning
from ilattice.macroshape.tiling import Tiling
from ilattice.offsets.thickness import Thickness
from ilattice.offsets.wall_field import WallField
from ilattice.quadrature.cutting import CutGrid, cut
from ilattice.quadrature.grid import Grid

#: Largest error of a density that is solved for, as a part of it, or of what is left of 1 if that
#: is less; and how often it may be evaluated.
TOLERANCE, EVALUATIONS = 6e-4, 20
#: The same for densities per cell; the step is longer than Newton's, because the spline through the
#: half-thicknesses of cells smooths them.
CELL_TOLERANCE, CELL_PART, CELL_EVALUATIONS, CELL_STEP = 1e-3, 1e-2, 40, 1.4
#: Half-thicknesses, zero included, at which densities of cells are tabulated, as a first guess for
#: what solves for them; each costs a volume of all cells. Chosen without measurements.
LEVELS = 8
#: Tiles that are cut at once: half a million cells of splines by default.
TOGETHER = 128
#: Numbers of Gauss points that are tried, and the error of the volume of whole tiles, as a part,
#: that is small enough: that of the volume of walls is about as large.
POINTS, MISSED = (2, 3, 4, 6, 8), 5e-5
#: Cells are first joined, so many along each direction: on these points integrate no better.
JOINED = 2


def tile_volumes(lattice: Tiling) -> FloatArray:
    """Volumes of the tiles in space.

    Parameters
    ----------
    lattice : Tiling
        Tiles and map.

    Returns
    -------
    ndarray, shape (nx, ny, nz)
        Integrals of |det J|.
    """
    lo, hi = lattice.domain
    planes = [np.linspace(lo[a], hi[a], n + 1) for a, n in enumerate(lattice.repeat)]
    return np.abs(lattice.through.box_volumes(planes))


def volumes(
    lattice: Tiling, field: Any, q: int | None = None, *, least: int = POINTS[0]
) -> FloatArray:
    """Volume of a wall in every tile.

    Parameters
    ----------
    lattice : Tiling
        Tiles and map.
    field : WallField or BarsInBox
        Negative in the wall.
    q : int, optional
        Gauss points per direction and piece of a cell; by default as many as the map needs, see
        `MISSED`.
    least : int
        The fewest that are tried by default.

    Returns
    -------
    ndarray, shape (nx, ny, nz)
        Volumes in space.

    Warns
    -----
    PrecisionWarning
        If no number of points integrates the map over tiles to `MISSED`.
    """
    out = np.zeros(lattice.repeat)
    lo, hi = lattice.domain
    for some in _blocks(np.array([[0, 0, 0], lattice.repeat])):
        whole = np.ptp(some, axis=0) == lattice.repeat
        box = None if whole.all() else lo + (hi - lo) * some / np.array(lattice.repeat)
        try:
            grid = cut(field, domain=box, through=lattice.through)
        except GeometryError:  # nothing is filled
            continue
        grid, points = _integrated(grid, lattice, q, least)
        rule = grid.volume(points).in_space()
        cells = np.unravel_index(rule.cells, grid.grid.shape)
        middles = [0.5 * (axis[:-1] + axis[1:]) for axis in grid.grid.axes]
        u = np.stack([m[c] for m, c in zip(middles, cells, strict=True)], axis=1)
        tiles = np.floor(lattice.tile_coordinates(u)).astype(np.int64)
        np.add.at(out, tuple(tiles.T), rule.integrate_cells())
    return out


def _integrated(grid: CutGrid, lattice: Tiling, q: int | None, least: int) -> tuple[CutGrid, int]:
    """Cells and Gauss points with which the map itself is integrated over tiles to `MISSED`."""
    through = lattice.through
    bent = _with_planes(grid, [through.bends(a) for a in range(3)])
    if q is not None:
        return bent, q
    if any(_missed(axes, lattice, least) <= MISSED for axes in _joined(bent, lattice)):
        return bent, least
    split, missed = _with_planes(grid, [through.spline.breaks(a) for a in range(3)]), np.inf
    for points in POINTS[POINTS.index(least) :]:
        missed = _missed(split.grid.axes, lattice, points)
        if missed <= MISSED:
            return split, points
    warnings.warn(
        f"volumes of tiles are off by up to {100 * missed:.2g} %: the map changes too much within "
        "a tile; use more tiles, or a smoother map",
        PrecisionWarning,
        stacklevel=4,
    )
    return split, POINTS[-1]


def _joined(grid: CutGrid, lattice: Tiling) -> list[Sequence[FloatArray]]:
    """Planes between `JOINED` cells each, if tiles end at planes of cells, and those of all cells.

    Planes at which tiles end or the map bends are among both.
    """
    axes, joined = grid.grid.axes, []
    for a, (x, tiles) in enumerate(zip(axes, _tile_planes(axes, lattice), strict=True)):
        if len(with_planes(x, tiles)) > len(x):
            return [axes]
        joined.append(with_planes(with_planes(tiles, lattice.through.bends(a)), x[::JOINED]))
    return [joined, axes]


def _tile_planes(axes: Sequence[FloatArray], lattice: Tiling) -> list[FloatArray]:
    """Planes between the tiles between the first and the last plane of cells, and these."""
    lo, hi = lattice.domain
    return [
        with_planes(x[[0, -1]], np.linspace(lo[a], hi[a], lattice.repeat[a] + 1))
        for a, x in enumerate(axes)
    ]


def _missed(axes: Sequence[FloatArray], lattice: Tiling, points: int) -> float:
    """Largest error of the volume of a tile by rules of so many points on cells, as a part."""
    through, tiles = lattice.through, _tile_planes(axes, lattice)
    found = through.box_volumes(axes, points=points, split=False)
    for a, (x, t) in enumerate(zip(axes, tiles, strict=True)):
        middles = 0.5 * (x[:-1] + x[1:])
        found = np.add.reduceat(found, np.searchsorted(middles, t[:-1]), axis=a)
    return float(np.abs(found / through.box_volumes(tiles) - 1.0).max())


def _with_planes(grid: CutGrid, planes: Sequence[FloatArray]) -> CutGrid:
    """Cells that are cut by more planes."""
    old = grid.grid
    x, y, z = (with_planes(a, b) for a, b in zip(old.axes, planes, strict=True))
    if (len(x) - 1, len(y) - 1, len(z) - 1) == old.shape:
        return grid
    return replace(grid, grid=Grid((x, y, z), old.closed))


def _blocks(tiles: IntArray) -> Iterator[IntArray]:
    """Halves, from the first to the last tile, until they are at most `TOGETHER`."""
    sizes = tiles[1] - tiles[0]
    if sizes.prod() <= TOGETHER:
        yield tiles
        return
    axis, low, high = int(sizes.argmax()), tiles.copy(), tiles.copy()
    low[1, axis] = high[0, axis] = tiles[:, axis].sum() // 2
    yield from _blocks(low)
    yield from _blocks(high)


class _Densities:
    """Relative densities of walls of one lattice and one distance spline."""

    def __init__(self, lattice: Tiling, distance: BSpline) -> None:
        self.lattice, self.distance = lattice, distance
        self.tiles = tile_volumes(lattice)

    def cells(self, thickness: Thickness) -> FloatArray:
        """Part of every tile that is filled."""
        return volumes(self.lattice, WallField(self.distance, thickness)) / self.tiles

    def whole(self, thickness: Thickness) -> float:
        """Part of all that is filled."""
        filled = volumes(self.lattice, WallField(self.distance, thickness))
        return float(filled.sum() / self.tiles.sum())


def thickness_of_density(
    lattice: Tiling, distance: BSpline, profile: Thickness, density: Any,
    progress: Progress = None,
) -> Thickness:  # fmt: skip
    """A thickness, scaled until the wall has the asked density.

    Parameters
    ----------
    lattice : Tiling
        Tiles and map.
    distance : BSpline
        Signed distance to the mid-surface.
    profile : Thickness
        The shape of the thickness; constant if densities are asked for every tile.
    density : float, callable, or array_like of shape (nx, ny, nz)
        Relative density of the whole, or of every tile; a callable takes the parameters (n, 3)
        of the centres of tiles. Of a solid only the growth is scaled: a positive one reaches
        densities above that of the solid itself, a negative one those below, of the whole only.
    progress : bool or callable, optional
        Walls whose "density" is measured; see `ilattice._progress.track`.

    Returns
    -------
    Thickness
        The scaled one.

    Raises
    ------
    InputError
        If a density cannot be reached, the message says which can; or the thickness vanishes
        somewhere, so that it cannot be scaled.
    ConvergenceError
        If the densities of tiles are not met, because neighbours ask for too different ones.
    """
    densities = _Densities(lattice, distance)
    thickest = 1.01 * float(np.abs(distance.c).max()) / _least(profile)
    top = profile.scaled(thickest)
    given = None if callable(density) else as_array("relative_density", density)
    if given is not None and given.size == 1:
        target = float(given.ravel()[0])
        least = densities.whole(profile.scaled(0.0)) if profile.solid else 0.0
        ends = least, densities.whole(top)
        _check_reachable(target, *sorted(ends))
        factor = _solve(densities, profile, target, thickest, ends, progress)
        return profile.scaled(factor)
    if not profile.constant:
        raise InputError("densities of tiles need a constant d, or none; this one varies")
    if profile.solid and profile.outer.c.item() < 0.0:
        raise InputError("densities of tiles need a positive growth in d=(inf, growth)")
    targets = _targets(lattice, density)
    tops = densities.cells(top)
    bottoms = densities.cells(profile.scaled(0.0)) if profile.solid else np.zeros_like(tops)
    for place in (np.argmin(targets - bottoms), np.argmax(targets - tops)):
        _check_reachable(*(float(a.flat[place]) for a in (targets, bottoms, tops)))
    return _solve_cells(densities, profile, targets, thickest, bottoms, progress)


def _solve(
    densities: _Densities,
    profile: Thickness,
    target: float,
    thickest: float,
    ends: tuple[float, float],
    progress: Progress,
) -> float:
    """Factor at which the density is the target; `ends` are those at the factors 0 and `thickest`.

    The last density that is looked at is that of the factor.
    """
    missed = np.array([ends]) - target
    most = TOLERANCE * min(target, 1.0 - target)
    told = iter(track(range(EVALUATIONS), "density", progress))
    last = np.empty(1)

    def miss(factor: FloatArray) -> FloatArray:
        next(told)
        last[:] = densities.whole(profile.scaled(float(factor.item()))) - target
        return last.copy()

    low, high = np.zeros((1, 1)), np.full((1, 1), thickest)
    part = between(miss, low, high, missed, EVALUATIONS, most)
    if abs(last.item()) > most:
        raise ConvergenceError(f"relative_density={target:g} is still missed by {last.item():.2g}")
    return float(thickest * part.item())


def _solve_cells(
    densities: _Densities,
    profile: Thickness,
    targets: FloatArray,
    thickest: float,
    bottoms: FloatArray,
    progress: Progress,
) -> Thickness:
    """Thickness with one coefficient per cell such that every cell has its density.

    `bottoms` are the densities at the factor 0.
    """
    levels = thickest * np.linspace(0.0, 1.0, LEVELS) ** 1.5
    told = track(levels[1:], "densities", progress)
    curves = np.stack([bottoms] + [densities.cells(profile.scaled(s)) for s in told])
    factor = _by_cell(targets, curves, levels)
    slopes = np.gradient(curves, levels, axis=0)
    slope = np.maximum(_by_cell(factor, levels, slopes), 0.2 * slopes.max(axis=0))
    error, most = np.inf, np.minimum(CELL_TOLERANCE, CELL_PART * targets)
    for _ in track(range(CELL_EVALUATIONS), "density", progress):
        thickness = _per_cell(densities.lattice, profile, factor)
        miss = targets - densities.cells(thickness)
        error = float(np.abs(miss).max())
        if (np.abs(miss) <= most).all():
            return thickness
        factor = np.maximum(factor + CELL_STEP * miss / slope, 0.2 * factor)
    raise ConvergenceError(
        f"the relative densities of cells are missed by up to {error:.3g}: neighbours ask for too "
        "different ones; smooth them"
    )


def _by_cell(at: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    """Curve y over x at one place per cell; curves have a leading axis and may differ by cell."""
    flat = [np.broadcast_to(a.T if a.ndim > 1 else a, (*at.T.shape, len(a))) for a in (x, y)]
    rows = [a.reshape(-1, a.shape[-1]) for a in flat]
    found = [np.interp(t, *pair) for t, *pair in zip(at.T.ravel(), *rows, strict=True)]
    return np.array(found).reshape(at.T.shape).T


def _per_cell(lattice: Tiling, profile: Thickness, factor: FloatArray) -> Thickness:
    """The profile times a C1 spline with one coefficient per cell, repeated at open ends."""
    c, knots = factor, []
    for a, closed in enumerate(lattice.through.wraps):
        n = lattice.repeat[a]
        lo, hi = lattice.domain[:, a]
        knots.append(uniform_knots(n, 2, (lo, hi), periodic=closed))
        ends = (c.take([-1], a), c.take([0], a))
        c = np.concatenate([ends[0 if closed else 1], c, ends[1 if closed else 0]], axis=a)
    inner, outer = (
        BSpline(knots, c * float(s.c.item()), 2, periodic=lattice.through.wraps)
        for s in (profile.inner, profile.outer)
    )
    return _sides(profile, inner, outer)


def _targets(lattice: Tiling, density: Any) -> FloatArray:
    if callable(density):
        at = grid_indices(lattice.repeat) + 0.5
        lo, hi = lattice.domain
        u = lo + at / np.array(lattice.repeat) * (hi - lo)
        values = as_array("relative_density", asked("relative_density", density, u))
        if values.shape != (len(at),):
            raise InputError(
                f"relative_density must return one value per tile, shape ({len(at)},), got "
                f"{values.shape}"
            )
        return values.reshape(lattice.repeat)
    values = as_array("relative_density", density)
    if values.shape != lattice.repeat:
        raise InputError(
            f"relative_density must be one number, or one per cell in an array of shape "
            f"{lattice.repeat}, got shape {values.shape}"
        )
    return values


def _check_reachable(target: float, least: float, most: float) -> None:
    if not least < target < most:
        raise InputError(
            f"relative_density={target:g} cannot be reached: with this tile and these sides it "
            f"lies between {least:.4g} and {most:.4g}, ends excluded"
        )


def _sides(profile: Thickness, inner: BSpline, outer: BSpline) -> Thickness:
    """Both sides, symmetric or solid as the profile is."""
    if profile.symmetric:
        return Thickness(outer, outer)
    return Thickness(profile.inner if profile.solid else inner, outer)


def _least(profile: Thickness) -> float:
    """Least half-thickness of the thicker side that may vary; of a solid, least growth."""
    c = profile.outer.c
    if profile.solid:
        least = max(float(c.min()), -float(c.max()))
        remedy = "the growth in d=(inf, growth) must be positive, or negative, everywhere"
    else:
        least = max(float(c.min()), float(profile.inner.c.min()))
        remedy = "one side of d must be positive everywhere"
    if not least > 0.0:
        raise InputError(f"relative_density scales d, which vanishes somewhere: {remedy}")
    return least
