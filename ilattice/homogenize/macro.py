"""A lattice as a solid of its effective stiffness: analyses in which no tile is resolved.

::

    wall = il.Lattice("gyroid", through=part, repeat=(40, 8, 8)).offset(0.02)
    problem = il.homogenize.macro(wall, cells=(20, 4, 4), young=70e3)
    solution = problem.clamp("u=0").load(gravity=(0, 0, -9.81)).solve()

The macro-shape is full of a material whose stiffness and density are those of the tile that is
there: of its thickness over its size, interpolated between cells that are homogenized, with axes
that turn with the map. Stresses of the solution are means over tiles.

Guarantees: through an affine map, and of one thickness, the stiffness is that of the true cell;
where tiles are stretched or sheared differently from place to place, those of a mean shape stand
for all, and a warning says by how much they differ. Non-guarantee: tiles must be small: what is off
near supports, loads and free faces, and where stresses change from tile to tile, is of the order of
the size of a tile, and no estimate tells it (`examples/homogenized_beam.py` shows it); the estimate
of solutions is that of the grid alone.
"""

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from ilattice._geometry import grid_points
from ilattice._progress import Progress, track
from ilattice._typing import FloatArray
from ilattice._validate import as_flag, as_kind, as_positive, as_whole
from ilattice.bspline import BSpline
from ilattice.cutfem.anisotropic import Graded, turns
from ilattice.cutfem.elasticity import Elasticity
from ilattice.cutfem.material import OfParameters
from ilattice.errors import InputError, PrecisionWarning
from ilattice.homogenize.arguments import check_options
from ilattice.homogenize.effective import Effective
from ilattice.homogenize.elastic import elastic
from ilattice.lattice import Lattice, ParametricWall, Wall
from ilattice.macroshape.cells import cell
from ilattice.macroshape.maps import SplineMap
from ilattice.offsets.thickness import Thickness
from ilattice.tiles.tile import Tile

#: Points per direction at which sizes and shapes of tiles are looked at.
LOOKED = 13
#: Relative differences of thickness and shape up to which tiles are alike, and from which on a
#: mean shape that stands for all is warned of.
ALIKE, UNLIKE = 1e-4, 0.1


@dataclass(frozen=True, eq=False)
class Tiles:
    """Sizes and shapes of the tiles of a wall.

    Attributes
    ----------
    through : SplineMap
        The map.
    periods : ndarray, shape (3,)
        Of tiles, in parameters.
    outer : BSpline
        Half-thickness of the outer side.
    relative : bool
        Whether that is in units of tiles already.
    """

    through: SplineMap
    periods: FloatArray
    outer: BSpline
    relative: bool

    @classmethod
    def of(cls, wall: Wall) -> "Tiles":
        """Those of a wall."""
        lattice = wall.lattice
        periods = np.ptp(lattice.domain, axis=0) / lattice.repeat
        relative = isinstance(wall, ParametricWall)
        return cls(lattice.through, periods, wall._asked.outer, relative)

    def edges(self, u: FloatArray) -> FloatArray:
        """Edges (n, 3, 3) of tiles at parameters (n, 3) as columns, along axes of the map."""
        J = self.through.jacobian(u)
        return np.asarray(np.swapaxes(turns(J), 1, 2) @ J * self.periods)

    def thickness(self, u: FloatArray) -> FloatArray:
        """Half-thickness (n,), of the outer side, over the cube root of the volume of the tile."""
        d = self.outer(u)
        if not self.relative:
            d = d / np.abs(np.linalg.det(self.edges(u))) ** (1 / 3)
        return np.asarray(d)


@dataclass(frozen=True, eq=False)
class _Clipped:
    """Thickness, at points between those that were looked at too, within what was found."""

    tiles: Tiles
    low: float
    high: float

    def __call__(self, u: FloatArray) -> FloatArray:
        return np.asarray(np.clip(self.tiles.thickness(u), self.low, self.high))


@dataclass(frozen=True, eq=False)
class _Density:
    """Mass per volume of the macro-shape at parameters."""

    thickness: _Clipped
    at: FloatArray
    filled: FloatArray
    density: float

    def __call__(self, u: FloatArray) -> FloatArray:
        return np.asarray(self.density * np.interp(self.thickness(u), self.at, self.filled))


def everywhere(u: FloatArray) -> FloatArray:
    """The field of a full solid."""
    return -np.ones(len(u))


def macro(
    wall: Wall, cells: Any, *, young: float = 1.0, poisson: float = 0.3, density: float = 1.0,
    samples: int = 5, tile_cells: int = 12, estimate: bool = True, progress: Progress = None,
    **options: Any,
) -> Elasticity:  # fmt: skip
    """The macro-shape of a wall as a solid with the effective stiffness of its tiles.

    Parameters
    ----------
    wall : Wall
        Made by `Lattice.offset`, of one tile, of any thickness with sides in one proportion.
    cells : int or sequence of 3 int
        Background grid on the parameter box; it need not know of the tiles.
    young, poisson, density : float, keyword-only
        Of the solid that the wall is made of.
    samples : int, keyword-only
        Number of thicknesses, over the size of the tile, at which cells are homogenized, if tiles
        differ; the stiffness is interpolated in between.
    tile_cells : int, keyword-only
        Grid of each, as in `ilattice.homogenize.elastic`.
    estimate : bool, keyword-only
        Whether to estimate the errors of these, which warns where they are large.
    progress : bool or callable, optional, keyword-only
        "tiles", one by one; see `ilattice._progress.track`.
    **options
        As in `ilattice.cutfem.Elasticity`: ``degree``, ``smoothness``, ``q``.

    Returns
    -------
    Elasticity
        To be clamped, loaded and solved; its `material.stiffness` is what was found.

    Raises
    ------
    InputError
        If an argument is wrong, or the wall is of several tiles, or its sides change differently.
    GeometryError, ConvergenceError
        As in `ilattice.homogenize.elastic`.

    Warns
    -----
    PrecisionWarning
        If tiles differ in shape by more than a tenth of their edges, or a cell is too coarse.

    Examples
    --------
    >>> import ilattice as il
    >>> bar = il.macroshape.box((3.0, 1.0, 1.0))
    >>> wall = il.Lattice("cross", through=bar, repeat=(12, 4, 4)).offset((float("inf"), 0.0))
    >>> bar = il.homogenize.macro(wall, (3, 1, 1), tile_cells=6, estimate=False)
    >>> bar.material.stiffness.value.shape
    (6, 6)
    """
    lattice = as_kind("wall", wall, "Wall").lattice
    if not isinstance(lattice.tile, Tile):
        raise InputError("wall must be of one tile; mixtures have no effective stiffness of theirs")
    check_options("macro", options, Elasticity.__init__)
    wrong = {"stiffness", "axes", "through", "domain", "phases", "strength"} & options.keys()
    if wrong:
        raise InputError(f"{sorted(wrong)} are not there for macro: the wall has its own")
    density = as_positive("density", density)
    count, flag = as_whole("samples", samples, 2, 100), as_flag("estimate", estimate)
    tiles = Tiles.of(wall)
    u = _looked_at(lattice)
    edges, proportion = _mean_edges(tiles.edges(u)), _proportion(wall._asked, u)
    t = tiles.thickness(u)
    low, high = float(t.min()), float(t.max())
    alike = high - low <= ALIKE * max(abs(high), abs(low))
    at = np.array([0.5 * (low + high)]) if alike else np.linspace(low, high, count)
    alone = [_one(wall, edges, proportion, float(d)) for d in at]
    found = [
        elastic(one, tile_cells, young=young, poisson=poisson, estimate=flag)
        for one in track(alone, "tiles", progress)
    ]
    _check_bearing(found)
    local = _Clipped(tiles, low, high)
    filled = np.array([eff.density for eff in found])
    stiffness = found[0].C if alike else Graded(OfParameters(local), at, [e.C for e in found])
    mass = OfParameters(_Density(local, at, filled, density))
    return Elasticity(
        everywhere, cells, through=lattice.through, domain=lattice.domain, stiffness=stiffness,
        axes="map", density=density * filled[0] if alike else mass, **options,
    )  # fmt: skip


def _looked_at(lattice: Lattice) -> FloatArray:
    """Parameters (n, 3) all over the domain, its ends too."""
    lo, hi = lattice.domain
    s = np.linspace(0.0, 1.0, LOOKED)
    return lo + grid_points(s, s, s) * (hi - lo)


def _mean_edges(edges: FloatArray) -> FloatArray:
    """The mean shape of tiles, of volume 1; a warning if they differ."""
    size = np.abs(np.linalg.det(edges)) ** (1 / 3)
    least = size.min()
    if not least > 1e-6 * size.max():
        raise InputError("wall: its map has a degenerate end, where tiles have no size; cut it off")
    shapes = edges / size[:, None, None]
    mean = shapes.mean(axis=0)
    mean = mean / abs(np.linalg.det(mean)) ** (1 / 3)
    off = np.linalg.norm(shapes - mean, ord=2, axis=(1, 2)).max() / np.linalg.norm(mean, ord=2)
    if off > UNLIKE:
        warnings.warn(
            f"tiles differ in shape by up to {100 * off:.2g} % of their edges, and the stiffness "
            "is that of a mean one: it is off by as much or more; repeat tiles so that they are "
            "about as long everywhere",
            PrecisionWarning,
            stacklevel=3,
        )
    return np.asarray(mean)


def _proportion(thickness: Thickness, u: FloatArray) -> float:
    """The inner side over the outer one, which is infinite for solids."""
    if thickness.symmetric:
        return 1.0
    if thickness.solid:
        return np.inf
    outer = thickness.outer(u)
    if not np.abs(outer).min() > 0.0:
        raise InputError("wall: its outer side must be thicker than zero for macro")
    parts = thickness.inner(u) / outer
    if np.ptp(parts) > 1e-6 * np.abs(parts).max():
        raise InputError(
            "wall: its sides change differently, from one place to another in proportion "
            f"{parts.min():.3g} to {parts.max():.3g}; give sides that are multiples of one function"
        )
    return float(parts.mean())


def _one(wall: Wall, edges: FloatArray, proportion: float, d: float) -> Wall:
    """One tile of volume 1 with its wall."""
    lattice = wall.lattice
    alone = Lattice(
        lattice.tile, through=cell(edges), repeat=(1, 1, 1), spans_per_tile=lattice.spans_per_tile
    )
    space = "parametric" if isinstance(wall, ParametricWall) else "euclidean"
    inner = proportion if np.isinf(proportion) else proportion * d
    return alone.offset(d if proportion == 1.0 else (inner, d), space=space)


def _check_bearing(found: list[Effective]) -> None:
    """Refuse tiles that do not bear all stresses: no solid of theirs stands."""
    for eff in found:
        if eff.mechanisms:
            raise InputError(
                f"wall: its tile meets {eff.mechanisms} strains without resistance, so that the "
                "macro-shape would not stand; take a tile that goes on along all of its edges"
            )
