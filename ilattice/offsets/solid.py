"""The solid of the tiles as it is, neither grown nor eroded: ``Lattice.offset((np.inf, 0))``.

It needs no distances: meshes and slices go by the field of the tiles itself, their vertices are
moved onto its zero set by Newton steps. Quadrature and analysis take a few straight bars that are
joined sharply as they are, and splines of all others, fitted to the field, near its zero set only
where the field is that of a skeleton.

Guarantees: any field of a tile will do, also with creases, jumps at faces of tiles, or ends;
vertices are on the zero set to first order, as `Wall.thickness_error` reports; bounds are rigorous
if those of the tile are. Non-guarantees: the spline is off by `TileField.error`; the mesh rounds
off creases over part of a cell, as everywhere.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from ilattice._field import Field, as_boxes
from ilattice._geometry import grid_points, least_step
from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray
from ilattice._validate import as_points, read_only
from ilattice.bspline import BSpline
from ilattice.errors import ConvergenceError, GeometryError, InputError, PrecisionWarning
from ilattice.offsets.density import volumes
from ilattice.offsets.distance_spline import DEGREE, distance_spline, interpolated
from ilattice.offsets.solid_points import POINTS, SolidPoints
from ilattice.offsets.thickness import Thickness
from ilattice.offsets.wall import OffsetSolid
from ilattice.offsets.wall_field import WallField
from ilattice.tiles.bars import MAX_BARS, BarsInBox, solid_of_bars
from ilattice.tiles.mixture import Mixture
from ilattice.tiles.skeleton import FACES, SkeletonField, skeleton_of
from ilattice.tiles.tile import Tile

if TYPE_CHECKING:
    from ilattice.offsets.mid_surface import MidSurface

#: Part of them, nearest to the surface, whose gradients set the unit of the field.
NEAR = 0.1
#: Spans of the spline per radius of the thinnest strut, and the most coefficients.
PER_RADIUS, MAX_IN_TOTAL = 4.0, 1 << 22
#: Error of the spline, relative to the least thickness, from which on there is a warning.
MAX_ERROR = 0.02
#: And from which on nothing is told by the spline any more.
USELESS = 0.3
#: Part of the volume that the spline lacks, or has more, from which on it is told, and refused.
TOLD, REFUSED = 0.01, 0.1
#: Gauss points per piece of a cell for bars, and those that tell the error: with 2 volumes of bars
#: are off by up to two in a thousand, with 4 by less than one in a hundred thousand.
BAR_POINTS, MORE_POINTS, FEWER_POINTS = 4, 6, 2
#: Standard errors below which a difference of volumes is none.
CERTAIN = 2.0


class TileField(Field):
    """Field of the tiles of a lattice over the domain, scaled to lengths in space.

    Parameters
    ----------
    lattice : Lattice
        The lattice.
    tol : float, optional
        Largest error (99th percentile, at the surface) of `spline`, in units of length.
    """

    def __init__(self, lattice: MidSurface, tol: float | None = None) -> None:
        self.lattice, self.tol, self.scale, self.tile = lattice, tol, 1.0, _uncut(lattice.tile)
        u, each = SolidPoints.of(lattice, self.tile, 0)
        f, g = self.jet(u, 1)
        jacobian = lattice.through.jacobian(u)
        slope = np.linalg.norm(_in_space(g, jacobian), axis=1)
        near = np.argsort(np.abs(f), kind="stable")[: int(NEAR * len(f))]
        self.scale = 1.0 / max(float(np.median(slope[near])), 1e-300)
        width = float(np.abs(f[near]).max())
        det = np.abs(np.linalg.det(jacobian))
        area = float((det * slope)[near].sum()) / max(2.0 * width, 1e-300)
        filled = float(det[f < 0.0].sum())
        if filled == 0.0:
            raise GeometryError(
                f"nothing of the solid of tile {lattice.tile.name!r} is in the domain"
            )
        #: The volume, by random points.
        self.filled = filled * each
        #: Twice the volume by the area: the thickness of a plate, the radius of a rod.
        self.width = 2.0 * filled / area if area > 0.0 else np.inf
        self.c = read_only(self.scale * np.array([f.min(), f.max()]))

    @property
    def bounds(self) -> FloatArray:
        """The parameter domain, under the name that fields have."""
        return self.domain

    @property
    def domain(self) -> FloatArray:
        """The parameter domain, shape (2, 3)."""
        return self.lattice.domain

    def breaks(self, axis: int) -> FloatArray:
        """Faces of the tiles and the planes between, as dense as knots of distance splines."""
        n = self.lattice.spans * self.lattice.repeat[axis] + 1
        lo, hi = self.domain[:, axis]
        return np.linspace(lo, hi, n)

    def __call__(self, u: ArrayLike, /) -> FloatArray:
        """Value, shape (n,), at parameters (n, 3)."""
        u = as_points("u", u)
        if isinstance(self.tile, Mixture):
            return self.scale * self.lattice.implicit(u)
        return self.scale * self.tile(self.lattice._in_tile(self.lattice.tile_coordinates(u)))

    def jet(self, u: ArrayLike, order: int = 2) -> tuple[FloatArray, ...]:
        """Value, gradient and Hessian in the parameters: `order` + 1 of them."""
        u = as_points("u", u)
        if order == 0:
            return (self(u),)
        tile, (lo, hi) = self.tile, self.domain
        if isinstance(tile, Mixture):
            return tuple(self.scale * a for a in self.lattice.implicit_jet(u, order))
        p = self.lattice._in_tile(self.lattice.tile_coordinates(u))
        value, *rest = tile.jet(p, order)
        if not tile.has("jet"):
            value = tile(p)
        step = np.array(self.lattice.repeat) / (hi - lo)
        factors = (step, step[:, None] * step)
        parts = (value, *(a * s for a, s in zip(rest, factors, strict=False)))
        return tuple(self.scale * a for a in parts)

    @property
    def bounded(self) -> bool:
        """Whether that of the tile is; of mixtures no bounds are known."""
        return not isinstance(self.tile, Mixture) and self.tile.bounded

    def range(self, lo: ArrayLike, hi: ArrayLike, **_: Any) -> FloatArray:
        """Bounds, shape (m, 2), on boxes; infinite if the field of the tile has none."""
        lo, hi = as_boxes(lo, hi)
        tile = self.tile
        out = np.stack([np.full(len(lo), -np.inf), np.full(len(lo), np.inf)], axis=1)
        if isinstance(tile, Mixture) or not self.bounded:
            return out
        a, b = self.lattice.tile_coordinates(lo), self.lattice.tile_coordinates(hi)
        # a face between tiles has the values of the tile above it, and may be the end of a box
        end = np.where(self.lattice.through.closed, np.inf, np.array(self.lattice.repeat) - 1.0)
        first, last = np.floor(a), np.maximum(np.minimum(np.floor(b), end), np.floor(a))
        few = np.flatnonzero((last - first).max(axis=1, initial=0.0) <= 1.0)
        low, high = np.full(len(few), np.inf), np.full(len(few), -np.inf)
        for upper in product((False, True), repeat=3):
            at, ends = _in_one_tile(a[few], b[few], first[few], last[few], np.array(upper))
            bound = tile.range(*ends)
            low[at] = np.minimum(low[at], bound[:, 0])
            high[at] = np.maximum(high[at], bound[:, 1])
        out[few] = self.scale * np.stack([low, high], axis=1)
        return out

    # ------------------------------------------------------------------ the spline

    @property
    def approximation(self) -> BSpline:
        """The spline."""
        return self.spline

    @cached_property
    def spline(self) -> BSpline:
        """Spline with nearly the same zero set, for what is integrated or solved on."""
        spline = self.fitted
        self._tell(thinnest(self))
        return spline

    @cached_property
    def fitted(self) -> BSpline:
        """The spline, without a word on how good it is."""
        lattice = self.lattice
        spans = np.full(3, lattice.spans) if self.tol is not None else self._spans
        while True:
            spline = interpolated(lattice, lambda u, _: self._smooth(u), spans, DEGREE)
            self.error = self._measured(spline)
            if self.tol is None or self.error <= self.tol:
                break
            more = _affordable(lattice, np.ceil(1.5 * spans))
            if (more <= spans).any():
                raise ConvergenceError(
                    f"tol={self.tol:g} is not met with {spans.tolist()} spans per tile: the spline "
                    f"of the solid is off by {self.error:.3g}; ask for less, or repeat fewer tiles"
                )
            spans = more
        return spline

    def _tell(self, thick: float) -> None:
        """Warn of a spline that is off by much, and refuse one that has lost the solid."""
        off = "the spline that quadrature and analysis go by "
        if abs(self.lost) > TOLD:
            more = "more" if self.lost < 0.0 else "less"
            off += f"has {100 * abs(self.lost):.3g} % {more} volume than the solid, and "
        off += f"is off by {self.error:.2g} from the solid, which is {thick:.2g} thick"
        remedy = f"Use tol, {MAX_BARS} straight bars or fewer, which take no spline"
        wrong = self.tol is None and self.error > USELESS * thick
        if wrong or abs(self.lost) > REFUSED:
            why = "little of it is left" if wrong else f"{100 * REFUSED:g} % are the most"
            raise ConvergenceError(f"{off}: {why}. {remedy}, more spans_per_tile, or fewer tiles")
        if abs(self.lost) > TOLD or (self.tol is None and self.error > MAX_ERROR * thick):
            warnings.warn(
                f"{off}; it rounds off edges: struts joined sharply are up to 5 % too stiff; "
                f"meshes and slices are exact. {remedy}, or fewer tiles",
                PrecisionWarning,
                stacklevel=3,
            )

    #: What the spline is off by at the surface, and the part of the volume that it lacks.
    error: float = 0.0
    lost: float = 0.0

    @property
    def _spans(self) -> IntArray:
        """Spans per tile that resolve the radii of struts, or waves."""
        lattice, field = self.lattice, skeleton_of(self.tile)
        spans = np.full(3, lattice.spans)
        if lattice.spans_per_tile is None and field is not None:
            edges = np.linalg.norm(field.cell, axis=0)
            fine = np.ceil(PER_RADIUS * edges / field.thinnest).astype(np.int64)
            spans = np.maximum(spans, _affordable(lattice, fine))
        return spans

    def _smooth(self, u: FloatArray) -> FloatArray:
        """The values as they are, or those of a skeleton, flat away from it."""
        tile, field = self.tile, skeleton_of(self.tile)
        if isinstance(tile, Mixture) or field is None:
            return self(u)
        p = self.lattice._in_tile(self.lattice.tile_coordinates(u))
        return self.scale * field.flattened(tile.level)(p)

    def _measured(self, spline: BSpline) -> float:
        """Deviation of a spline at the surface: 99th percentile at random points near it."""
        u, _ = SolidPoints.of(self.lattice, self.tile, 1)
        f, s = self(u), spline(u)
        det = np.abs(np.linalg.det(self.lattice.through.jacobian(u)))
        self.lost = _missing(det * (f < 0.0), det * (s < 0.0))
        near = np.argsort(np.abs(f), kind="stable")[: POINTS // 16]
        u, _ = onto_zero(self, u[near])
        return float(np.percentile(np.abs(spline(u)), 99))


def _uncut(tile: Tile | Mixture) -> Tile | Mixture:
    """The tile; a skeleton without the planes of closed faces, where domain and neighbours cut it.

    On these planes its field is zero, and tells nothing of the rims there.
    """
    field = skeleton_of(tile)
    if isinstance(tile, Mixture) or field is None or "closed" not in field.faces:
        return tile
    faces = dict(zip(FACES, (k.replace("closed", "open") for k in field.faces), strict=True))
    open_field = SkeletonField(field.entities, field.radius, field.blend, faces, field.cell)
    return replace(tile, field=open_field, check=False)


def _affordable(lattice: MidSurface, spans: AnyArray) -> IntArray:
    """Spans per tile, or less where the coefficients would be too many."""
    total = float(np.prod(spans * np.array(lattice.repeat, float)))
    share = min(1.0, (MAX_IN_TOTAL / total) ** (1.0 / 3.0))
    return np.maximum(np.floor(spans * share), 2).astype(np.int64)


def _missing(all_of_it: FloatArray, found: FloatArray) -> float:
    """Part of a volume that is not found at random points of it, 0 if that may be chance."""
    change = all_of_it - found
    if abs(change.sum()) <= CERTAIN * np.linalg.norm(change):
        return 0.0
    return float(change.sum() / all_of_it.sum())


def onto_zero(field: TileField, u: FloatArray, steps: int = 8) -> tuple[FloatArray, FloatArray]:
    """Points next to the surface moved onto it along the gradient, and what is left there."""
    lo, hi = field.domain
    out = u
    for _ in range(steps):
        out = np.clip(out - least_step(*field.jet(out, 1)), lo, hi)
    return out, np.abs(field(out))


def thinnest(field: TileField) -> float:
    """Least thickness in space: of struts and plates by their radii, of others `width`."""
    lattice = field.lattice
    skeleton = skeleton_of(lattice.tile)
    if skeleton is None:
        return field.width
    u = _random(lattice, 512, 2)
    step = np.ptp(lattice.domain, axis=0) / np.array(lattice.repeat)
    jacobian = lattice.through.jacobian(u) * step @ np.linalg.inv(skeleton.cell)
    return 2.0 * skeleton.thinnest * float(np.linalg.svd(jacobian, compute_uv=False).min())


#: Bars above which meshes go by the field of tiles.
MAX_DRAWN = 2000
#: Places along each direction of a face at which neighbours are compared, and the difference of
#: their values, as a part of the largest, above which they do not fit.
ON_FACES, APART = 65, 1e-3


@dataclass(frozen=True, eq=False)
class TileSolid(OffsetSolid):
    """The solid of the tiles as it is.

    Attributes
    ----------
    distance : TileField
        The field of the tiles; it takes the place of the distance.
    """

    distance: Any

    _exact = False

    def bars(self, most: int = MAX_BARS) -> BarsInBox | None:
        """The solid itself, where it is one of a few straight bars that are joined sharply.

        Parameters
        ----------
        most : int
            Bars above which there is none.

        Returns
        -------
        BarsInBox or None
            What is negative in the solid, at parameters.
        """
        tile, lattice = self.lattice.tile, self.lattice
        return (
            solid_of_bars(tile, lattice.repeat, lattice.domain, most)
            if isinstance(tile, Tile)
            else None
        )

    @cached_property
    def _bars(self) -> BarsInBox | None:
        return self.bars()

    @cached_property
    def drawn(self) -> Any:
        """What meshes go by: bars as they are where neighbours do not fit, else the field of tiles.

        That field jumps at such faces. Closed directions get a tile more at both ends.
        """
        tile, lattice = self.lattice.tile, self.lattice
        if not isinstance(tile, Tile) or not self._torn.any():
            return self.distance
        more = np.array(lattice.through.closed).astype(int)
        (lo, hi), count = lattice.domain, np.array(lattice.repeat)
        over = more * (hi - lo) / count
        repeat = tuple((count + 2 * more).tolist())
        solid = solid_of_bars(tile, repeat, np.stack([lo - over, hi + over]), MAX_DRAWN)
        return self.distance if solid is None else solid

    def _drawn_distance(self, u: FloatArray) -> FloatArray:
        """See `OffsetSolid._drawn_distance`; bars have lengths in tiles."""
        unit = 1.0 if self.drawn is self.distance else self.distance.scale
        return np.asarray(unit * self.drawn(u))

    @property
    def ragged(self) -> AnyArray:
        """Along which directions the field that meshes go by jumps at faces of tiles."""
        jumps: AnyArray = self._torn & (self.drawn is self.distance)
        return jumps

    @cached_property
    def _torn(self) -> AnyArray:
        """Along which directions neighbours share faces that are not solid alike, shape (3,).

        `Tiling.torn` tells it of surfaces, by a spline of the tile, which bars need not.
        """
        lattice, field = self.lattice, self.distance.tile
        out = np.array(lattice.through.closed) | (np.array(lattice.repeat) > 1)
        if isinstance(field, Mixture):
            return np.zeros(3, np.bool_)
        s = np.linspace(0.0, 1.0, ON_FACES)
        plane = grid_points(s, s)
        for a in np.flatnonzero(out):
            f, g = (field(np.insert(plane, a, end, axis=1)) for end in (0.0, 1.0))
            apart = np.abs(f - g) > APART * max(np.abs(f).max(), np.abs(g).max())
            out[a] = (apart & ((f < 0.0) != (g < 0.0))).any()
        return out

    def level_sets(self) -> Any:
        """See `OffsetSolid.level_sets`: bars as they are, of others the spline."""
        return self.field if self._bars is None else self._bars

    @cached_property
    def least_thickness(self) -> float:
        """Least thickness of struts and plates; of other solids twice the volume by the area."""
        return thinnest(self.distance)

    @property
    def _of_skeleton(self) -> bool:
        return skeleton_of(self.lattice.tile) is not None

    @property
    def _countable(self) -> bool:  # type: ignore[override]
        return not self._of_skeleton

    @property
    def _has_necks(self) -> bool:  # type: ignore[override]
        return not self._of_skeleton

    @property
    def creased(self) -> bool:  # type: ignore[override]
        """Whether it is a skeleton, in a map that is open in all directions."""
        return self._of_skeleton and not any(self.lattice.through.closed)

    def volume(self) -> float:
        """Volume of the solid in space, by cut-cell quadrature of what `level_sets` gives.

        Returns
        -------
        float
            Volume; `volume_error` tells how good it is.

        Warns
        -----
        PrecisionWarning
            If it is that of a spline that lacks more than 1 % of it, or is off by much.
        """
        self._tell_rounded()
        self._known["volume"] = float(self._filled.sum())
        return self._known["volume"]

    def relative_density(self, *, per_cell: bool = False) -> Any:
        """See `OffsetSolid.relative_density`: by the volumes that `volume` adds up."""
        self._tell_rounded()
        return super().relative_density(per_cell=per_cell)

    def _tell_rounded(self) -> None:
        """Have the spline tell how good it is, where there is one."""
        if self._bars is None:
            _ = self.distance.spline

    @cached_property
    def _filled(self) -> FloatArray:
        """Volume in every tile, of the spline also where that is refused."""
        if self._bars is not None:
            return volumes(self.lattice, self._bars, least=BAR_POINTS)
        return volumes(self.lattice, WallField(self.distance.fitted, self.thickness))

    @property
    def _volume(self) -> float:
        """The volume, and what the spline lacks of it: that of exact meshes.

        Where little is left of the spline, or much is added, that by random points.
        """
        filled = float(self._filled.sum())  # first, which makes the spline
        lost = 0.0 if self._bars is not None else self.distance.lost
        if abs(lost) > REFUSED:
            return self.distance.filled
        return filled / (1.0 - lost)

    @cached_property
    def volume_error(self) -> float:
        """How far `volume` may be off: the area times the error of the spline.

        Of bars, for which no spline stands in, what more points change, or, where these do not fit
        the memory, fewer, which is more.
        """
        volume, field = self.volume(), self.distance  # which makes the spline and its error
        if self._bars is not None:
            try:
                other = volumes(self.lattice, self._bars, MORE_POINTS)
            except InputError:  # they do not fit the memory
                other = volumes(self.lattice, self._bars, FEWER_POINTS)
            return abs(float(other.sum()) - volume)
        return float(2.0 * volume / field.width * field.error)

    def _middle(self, most: int) -> tuple[FloatArray, FloatArray]:
        """Points next to the surface, moved onto it; they stand for equal areas."""
        u, _ = SolidPoints.of(self.lattice, self.distance.tile, 3)
        near = np.argsort(np.abs(self.distance(u)), kind="stable")[: min(most, POINTS // 8)]
        out, _ = onto_zero(self.distance, u[near])
        return out, np.ones(len(out))

    def _in_space(self, _name: str) -> OffsetSolid:
        return OffsetSolid(self.lattice, distance_spline(self.lattice), self.thickness)

    def _errors(self, u: FloatArray, _side: AnyArray) -> tuple[FloatArray, FloatArray]:
        """Distance from the zero set to first order, and 0, which it should be."""
        f, g = self.distance.jet(u, 1)
        slope = np.linalg.norm(_in_space(g, self.lattice.through.jacobian(u)), axis=1)
        return np.abs(f) / np.maximum(slope, 1e-3 * np.median(slope)), np.zeros(len(u))


def tile_solid(lattice: MidSurface, thickness: Thickness, tol: float | None = None) -> TileSolid:
    """The solid of the tiles of a lattice as it is.

    Parameters
    ----------
    lattice : Lattice
        Tiles and map.
    thickness : Thickness
        That of ``(np.inf, 0)``.
    tol : float, optional
        As in `ilattice.lattice.offset`.

    Returns
    -------
    TileSolid
        The solid.
    """
    return TileSolid(lattice, TileField(lattice, tol), thickness)


def _random(lattice: MidSurface, n: int, seed: int) -> FloatArray:
    """Random parameters (n, 3)."""
    lo, hi = lattice.domain
    return lo + (hi - lo) * np.random.default_rng(seed).random((n, 3))


def _in_space(g: FloatArray, jacobian: FloatArray) -> FloatArray:
    """Gradients in space from those in the parameters; where the map is flat, zero."""
    with np.errstate(all="ignore"):
        det = np.linalg.det(jacobian)
        flat = np.abs(det) <= 1e-12 * np.abs(det).max()
        safe = np.where(flat[:, None, None], np.eye(3), jacobian)
        out = np.linalg.solve(safe.transpose(0, 2, 1), g[:, :, None])[:, :, 0]
    return np.where(flat[:, None], 0.0, out)


def _in_one_tile(
    a: FloatArray, b: FloatArray, first: FloatArray, last: FloatArray, upper: AnyArray
) -> tuple[AnyArray, tuple[FloatArray, FloatArray]]:
    """Parts of boxes in the lower or upper one of two tiles per axis, in the unit cube."""
    at = np.flatnonzero(((last > first) | ~upper).all(axis=1))
    tile = np.where(upper, last, first)[at]
    return at, (np.clip(a[at] - tile, 0.0, 1.0), np.clip(b[at] - tile, 0.0, 1.0))
