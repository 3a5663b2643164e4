"""Placement of tiles in the parameter domain of a map, one repeated or several mixed.

Guarantees: the map has been certified not to fold (a warning names isolated points with
det J = 0); everything expensive (seeds, k-d tree, distance spline) is computed once and kept.
Non-guarantees: neighbouring tiles fit together only as smoothly as the tile is periodic; a
mixture is one C2 spline for the entire lattice, which deviates from its tiles by up to its `tol`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from ilattice._geometry import grid_points
from ilattice._memory import need
from ilattice._shown import Shown, one_line
from ilattice._typing import AnyArray, ArrayLike, FloatArray
from ilattice._validate import (
    as_array,
    as_choice,
    as_counts,
    as_points,
    as_positive,
    asked,
)
from ilattice.errors import InputError
from ilattice.macroshape.certify import check_map
from ilattice.macroshape.maps import SplineMap
from ilattice.tiles.catalog import get
from ilattice.tiles.mixture import MixedField, Mixture
from ilattice.tiles.tile import Tile
from ilattice.tiles.trig import TrigField

BOUNDARIES = ("extend", "clip")
#: Surfaces that are so far apart on a face, in tile edges, do not fit together; and places along
#: each direction of a face where they are looked at.
APART, ON_FACES = 1e-3, 129
#: Angle between surfaces of neighbours, about, from which on they meet in a crease.
BENT = 0.02
PER_TILE = 2000  # bytes of memory


@dataclass(frozen=True, eq=False)
class Tiling(Shown):
    """Tiles repeated through a map.

    Parameters
    ----------
    tile : Tile or Mixture
        The unit cell; a name of the catalogue or a callable is accepted. For different tiles
        in one lattice see `ilattice.tiles.mix` and `ilattice.tiles.hybrid`.
    through : SplineMap
        Macro-shape: the map from the parameter box to space.
    repeat : int or sequence of 3 int
        Number of tiles along u, v and w.
    boundary : {"extend", "clip"}
        What distances near the ends of the domain refer to: the mid-surface continued by one
        layer of tiles, so that a wall runs into the end face at full thickness, or only its
        part inside the domain, even where that is one point, as in two corners of gyroids, around
        which walls are parts of balls. Closed directions always wrap. Along directions in which
        tiles do not fit together (see `fits`) there is nothing to go on with, and "extend" is like
        "clip".
    spans_per_tile : int, optional
        Spans of the fitted distance spline per tile and direction; by default 16, and 12 per
        period of the finest wave of a trigonometric tile.

    Raises
    ------
    InputError
        If an argument is of the wrong kind.
    GeometryError
        If the map folds.

    Examples
    --------
    >>> import ilattice as il
    >>> tiling = il.macroshape.Tiling("gyroid", through=il.macroshape.identity(), repeat=2)
    >>> tiling.repeat
    (2, 2, 2)
    """

    tile: Tile | Mixture
    through: SplineMap
    repeat: tuple[int, int, int] = (1, 1, 1)
    boundary: str = "extend"
    spans_per_tile: int | None = None
    _cache: dict[str, Any] = field(default_factory=dict, init=False, repr=False)

    def __repr__(self) -> str:
        tiles = " x ".join(map(str, self.repeat))
        return one_line(f"{self._kind}({self.tile.name!r}, {tiles} tiles through {self.through!r})")

    def __post_init__(self) -> None:
        object.__setattr__(self, "tile", _as_tile(self.tile))
        if not isinstance(self.through, SplineMap):
            raise InputError(
                f"through must be a SplineMap, got {type(self.through).__name__}; "
                "il.macroshape makes or loads one"
            )
        object.__setattr__(self, "repeat", as_counts("repeat", self.repeat))
        as_choice("boundary", self.boundary, BOUNDARIES)
        spans = self.spans_per_tile
        if spans is not None and not as_positive("spans_per_tile", spans) >= 2:
            raise InputError(f"spans_per_tile must be at least 2, got {spans!r}")
        check_map(self.through)
        both = set(self.through.names) & set(self.tile.properties)
        if both:
            raise InputError(
                f"properties {sorted(both)} are given by the tile and by the map; rename one"
            )

    def _once(self, name: str, make: Any) -> Any:
        if name not in self._cache:
            self._cache[name] = make()
        return self._cache[name]

    # ------------------------------------------------------------------ geometry

    @property
    def domain(self) -> FloatArray:
        """The parameter box, shape (2, 3)."""
        return self.through.domain

    @property
    def smooth_tile(self) -> Any:
        """The field in a form that compiled code evaluates.

        Trigonometric or a spline on the unit cube; for a mixture, a `MixedField`.
        """
        return self._once("smooth_tile", self._make_field)

    def _make_field(self) -> Any:
        if isinstance(self.tile, Mixture):
            self._check_count()
            return self.tile.field(self.repeat, self.domain, self.through.wraps)
        return self.tile.kernel_field

    @property
    def fits(self) -> AnyArray:
        """Along which directions tiles fit together, shape (3,): where surfaces of neighbours meet.

        Surfaces in two neighbours may be so far apart on the face that they share: `APART`.
        """
        out: AnyArray = self._once("faces", self._look_at_faces)[0]
        return out

    @property
    def ends(self) -> AnyArray:
        """Along which open directions the mid-surface ends with the domain, shape (3,)."""
        return ~np.array(self.through.closed) & ((self.boundary == "clip") | ~self.fits)

    @property
    def torn(self) -> AnyArray:
        """Along which directions there are neighbours that do not fit together, shape (3,)."""
        return ~self.fits & (np.array(self.through.closed) | (np.array(self.repeat) > 1))

    @property
    def creased(self) -> bool:
        """Whether surfaces of neighbours meet in creases on faces, or not at all."""
        if isinstance(self.smooth_tile, MixedField):
            return self.smooth_tile.creased
        meet = np.array(self.through.closed) | (np.array(self.repeat) > 1) | ~self.ends
        bent = self._once("faces", self._look_at_faces)[1]
        return bool(self.torn.any() or (meet & bent).any())

    def _look_at_faces(self) -> tuple[AnyArray, AnyArray]:
        """Along which directions tiles fit together, and their surfaces meet at an angle."""
        field, fits, bent = self.smooth_tile, np.ones(3, np.bool_), np.zeros(3, np.bool_)
        if isinstance(field, (MixedField, TrigField)):
            return fits, bent
        axis = np.linspace(0.0, 1.0, ON_FACES)
        plane = grid_points(axis, axis)
        for a in range(3):
            (f, df), (g, dg) = (_on_face(field, plane, a, end) for end in (0.0, 1.0))
            near = np.minimum(np.abs(f), np.abs(g)) <= 1.0 / ON_FACES
            f, g, df, dg = f[near], g[near], df[near], dg[near]
            fits[a] = not (np.minimum(np.abs(f - g), np.abs(f + g)) > APART).any()
            turn = np.minimum(*(np.linalg.norm(df + s * dg, axis=1) for s in (-1.0, 1.0)))
            bent[a] = (turn > BENT).any()
        return fits, bent

    @property
    def finest_wave(self) -> int:
        """Waves per tile of the finest term of trigonometric tiles; 2 for any other."""
        if isinstance(self.tile, Tile) and not isinstance(self.tile.field, TrigField):
            return 2
        f = self.smooth_tile
        return max(map(_waves, f.fields)) if isinstance(f, MixedField) else _waves(f)

    @property
    def spans(self) -> int:
        """Spans of the distance spline per tile and direction."""
        if self.spans_per_tile is not None:
            return int(self.spans_per_tile)
        return max(16, 12 * self.finest_wave)

    def tile_coordinates(self, u: ArrayLike) -> FloatArray:
        """Coordinates in which tile (i, j, k) is the box from (i, j, k) to (i+1, j+1, k+1).

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n, 3)
            From 0 to `repeat`.
        """
        lo, hi = self.domain
        return (as_points("u", u) - lo) / (hi - lo) * np.array(self.repeat)

    def implicit(self, u: ArrayLike) -> FloatArray:
        """Value of the field of the tiles.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n,)
            Values, negative inside.
        """
        return self.implicit_jet(u, 0)[0]

    def implicit_jet(self, u: ArrayLike, order: int = 2) -> tuple[FloatArray, ...]:
        """Value and derivatives of the field of the tiles.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters; up to a tile beyond the ends of the domain.
        order : int
            Highest derivative: 0, 1 or 2.

        Returns
        -------
        tuple of ndarray
            Values (n,), gradients (n, 3) and Hessians (n, 3, 3) with respect to the parameters:
            the first ``order + 1``.
        """
        p = self.tile_coordinates(u)
        if not isinstance(self.smooth_tile, MixedField):
            p = self._in_tile(p)
        lo, hi = self.domain
        scale = np.array(self.repeat) / (hi - lo)
        value, *rest = self.smooth_tile.jet(p, order)
        factors = (scale, scale[:, None] * scale)
        return (value, *(a * s for a, s in zip(rest, factors, strict=False)))

    def _in_tile(self, p: FloatArray) -> FloatArray:
        """Coordinates in the unit cube of points given in tile coordinates."""
        count = np.array(self.repeat)
        last = ~np.array(self.through.closed) & (np.abs(p - count) < 1e-9)
        return np.minimum(p - np.where(last, count - 1.0, np.floor(p)), 1.0)

    # ------------------------------------------------------------------ properties

    @property
    def property_names(self) -> tuple[str, ...]:
        """Names of the properties: extra coordinates of the map, then those of the tile."""
        return (*self.through.names, *self.tile.properties)

    def property_at(self, name: str, u: ArrayLike) -> FloatArray:
        """Value of a property: colour, material, thickness.

        Parameters
        ----------
        name : str
            One of `property_names`.
        u : array_like, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n,)
            Values: of an extra coordinate of the map, which goes through the part as a whole, or
            of a property of the tile, which repeats in every tile; in mixtures of tiles, the mean
            of those of the tiles, weighed as their fields are.

        Raises
        ------
        InputError
            If there is no such property, or one of the tile returns values of another shape.

        Notes
        -----
        Hong et al. 2025, section 3: T into ℝ^l, l > 3, and the tile's fields I^r, r > 1.
        """
        u = as_points("u", u)
        if not isinstance(name, str):
            raise InputError(f"name must be the name of a property, got {name!r:.80}")
        if name in self.through.names:
            return self.through.extra(u)[:, self.through.names.index(name)]
        if name not in self.tile.properties:
            known = ", ".join(self.property_names) or "none"
            raise InputError(f"the lattice has no property {name!r}; it has: {known}")
        p = self.tile_coordinates(u)
        if isinstance(self.tile, Tile):
            return _values(name, self.tile, self._in_tile(p))
        mixture, closed = self.tile, self.through.wraps
        make = partial(mixture.blended, self.repeat, self.domain, closed)
        tiles, blend = self._once("blend", make)
        weights, out = blend.weights(p), np.zeros(len(u))
        for number, tile in enumerate(tiles):
            at = np.flatnonzero(weights[:, number])
            out[at] += weights[at, number] * _values(name, tile, self._in_tile(p[at]))
        return out

    def _check_count(self) -> None:
        """Refuse so many tiles that what is kept of each does not fit."""
        need(
            PER_TILE * math.prod(map(float, self.repeat)),
            f"a lattice of {' x '.join(map(str, self.repeat))} tiles",
            "use fewer tiles",
        )


def _values(name: str, tile: Tile, p: FloatArray) -> FloatArray:
    """Values of a property of a tile at points of the unit cube, checked."""
    if name not in tile.properties:
        raise InputError(f"tile {tile.name!r} of the mixture has no property {name!r}; give it one")
    told = f"property {name!r}"
    values = as_array(told, asked(told, tile.properties[name], p))
    if values.shape != (len(p),):
        raise InputError(
            f"property {name!r} must return one value per point, shape ({len(p)},), got "
            f"{values.shape}"
        )
    return values


def _waves(f: Any) -> int:
    return int(f.factor.max(initial=1) + 1) // 2 if isinstance(f, TrigField) else 2


def _as_tile(tile: Any) -> Tile | Mixture:
    if isinstance(tile, (Tile, Mixture)):
        return tile
    if isinstance(tile, str):
        return get(tile)
    if callable(tile):
        return Tile(tile)
    raise InputError(
        f"tile must be a Tile, a Mixture, a name of the catalogue or a callable, got {tile!r:.80}"
    )


def _on_face(field: Any, plane: FloatArray, axis: int, end: float) -> tuple[FloatArray, FloatArray]:
    """How far points (n, 2) of a face are from the surface in it, about, and unit normals there."""
    f, g = field.jet(np.insert(plane, axis, end, axis=1), 1)
    inside = np.linalg.norm(np.delete(g, axis, axis=1), axis=1)
    away = np.divide(f, inside, out=np.full(len(f), np.inf), where=inside > 0.0)
    return away, g / np.maximum(np.linalg.norm(g, axis=1), np.finfo(np.float64).tiny)[:, None]
