"""Different tiles in one lattice: a choice per cell, or a smooth transition over the part.

`mix` chooses a tile for every cell, by an array, a function or at random, and blends neighbours
that differ in a zone about their common face; `hybrid` weighs tiles by functions of the parameters.
Either is handed to `ilattice.Lattice` in place of a tile.

Tiles are made comparable before they are blended: each field is divided by the mean length of its
gradient, in tile coordinates, on its zero set. Fields are then about distances in tile edges.

Guarantees: outside the zones a field is that of its tile, up to `tol`; the spline is C2 (C0 with
``blend=0``); the weights of a point add
up to one; a random choice depends on the seed only. Non-guarantees: which pieces a blend connects
is not controlled; two tiles of opposite sense (solid where the other is void) blend to a surface in
between; `level` and ``-field`` change the sense of one.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray
from ilattice._validate import (
    as_array,
    as_choice,
    as_counts,
    as_flag,
    as_not_negative,
    as_points,
    as_positive,
    asked,
    per_direction,
)
from ilattice.errors import InputError
from ilattice.tiles._joined import joined
from ilattice.tiles._mixed import Blend, Component, MixedField, fitted
from ilattice.tiles.catalog import get
from ilattice.tiles.tile import Tile

__all__ = ["MixedField", "Mixture", "hybrid", "mix", "sigmoid"]

Cells = Callable[[tuple[int, int, int]], AnyArray]
Weight = Callable[[FloatArray], Any]

#: Width of the zone in which neighbours are blended, and largest deviation of the fitted spline
#: from the blend, both in tile edges.
BLEND, TOL = 0.5, 1e-3


@dataclass(frozen=True, eq=False, repr=False)
class Mixture:
    """Several tiles and where they are: made by `mix` and `hybrid`, taken by `Lattice`.

    Attributes
    ----------
    tiles : tuple of Tile
        Tiles that indices and weights refer to.
    cells : callable or None
        Takes the number of tiles (nx, ny, nz), returns an array of that shape that holds indices,
        names or tiles.
    weight : callable or None
        Takes parameters (n, 3), returns weights; instead of `cells`.
    blend : float
        Width of the zone about a face between different tiles, in tile edges; 0 for shared faces.
    tol : float
        Largest deviation of the fitted spline, in tile edges.
    """

    tiles: tuple[Tile, ...]
    cells: Cells | None
    weight: Weight | None
    blend: float
    tol: float

    def __post_init__(self) -> None:
        if not (isinstance(self.tiles, tuple) and all(isinstance(t, Tile) for t in self.tiles)):
            raise InputError(f"tiles must be a tuple of Tiles, got {self.tiles!r:.80}")
        given = [f for f in (self.cells, self.weight) if f is not None]
        if len(given) != 1 or not callable(given[0]):
            raise InputError("either cells or weight must be a function, the other one None")
        if as_not_negative("blend", self.blend) > 1.0:
            raise InputError(f"blend must be at most 1, got {self.blend!r:.80}")
        as_positive("tol", self.tol)

    @property
    def name(self) -> str:
        """Names of the tiles, for messages."""
        return "+".join(tile.name for tile in self.tiles) or "mixture"

    @property
    def properties(self) -> Mapping[str, Callable[..., Any]]:
        """Properties that all `tiles` have, as those of the first; a lattice weighs them all."""
        first, *others = self.tiles or (None,)
        if first is None:
            return MappingProxyType({})
        shared = {
            n: f for n, f in first.properties.items() if all(n in t.properties for t in others)
        }
        return MappingProxyType(shared)

    def __repr__(self) -> str:
        how = "cells" if self.weight is None else "weights"
        return f"Mixture({self.name}, by {how})"

    def blended(
        self, repeat: tuple[int, int, int], domain: FloatArray, closed: Sequence[bool]
    ) -> tuple[list[Tile], Blend]:
        """Tiles in use, and the exact blend of them, with its weights.

        Parameters
        ----------
        repeat : tuple of int
            Number of tiles per direction.
        domain : ndarray, shape (2, 3)
            Corners of the parameter box.
        closed : sequence of 3 bool
            Directions whose two ends coincide.

        Returns
        -------
        tuple of list of Tile, and Blend
            In the same order.
        """
        repeat = as_counts("repeat", repeat)
        domain = as_array("domain", domain, ndim=2)
        if domain.shape != (2, 3) or not (domain[0] < domain[1]).all():
            raise InputError(f"domain must be a lower and an upper corner, got {domain.tolist()}")
        closed = [as_flag("closed", c) for c in per_direction("closed", closed, 3)]
        tiles, numbers = list(self.tiles), None
        if self.weight is None:
            assert self.cells is not None
            tiles, numbers = _numbered(self.tiles, self.cells(repeat))
        return tiles, Blend(
            tuple(Component.of(t) for t in tiles), numbers, self.weight, self.blend, repeat,
            domain, np.array(closed),
        )  # fmt: skip

    def field(
        self, repeat: tuple[int, int, int], domain: FloatArray, closed: Sequence[bool]
    ) -> MixedField:
        """The implicit function of a whole lattice as one spline in tile coordinates.

        Parameters
        ----------
        repeat : tuple of int
            Number of tiles per direction.
        domain : ndarray, shape (2, 3)
            Corners of the parameter box, for `weight`.
        closed : sequence of 3 bool
            Directions whose two ends coincide.

        Returns
        -------
        MixedField
            The spline over the tiles and a layer of tiles around them in open directions, with
            the error that it reached. It holds 4 to 260 kB per tile (8 to 32 spans per edge).

        Raises
        ------
        InputError
            If the choice of tiles or the weights do not fit the lattice.

        Warns
        -----
        PrecisionWarning
            If `tol` is not met with 32 spans per tile edge.
        """
        _, blend = self.blended(repeat, domain, closed)
        blend.check_seams()
        return fitted(blend, self.tol) if self.blend > 0.0 else joined(blend, self.tol)


def mix(
    *tiles: Tile | str,
    cells: Any = None,
    seed: int | None = None,
    probabilities: ArrayLike | None = None,
    blend: float = BLEND,
    tol: float = TOL,
) -> Mixture:
    """Different tiles from cell to cell, blended at the faces between them.

    Parameters
    ----------
    *tiles : Tile or str
        The tiles that indices refer to; not needed if `cells` holds tiles or names.
    cells : array_like or callable, optional
        Array of the shape of `repeat` with the tile of every cell: an index, a name or a `Tile`;
        or a function of (i, j, k) that returns one of these. Without it the choice is random.
    seed : int, optional
        Seed of the random choice: the same one gives the same lattice.
    probabilities : array_like, optional
        One per tile, of the random choice; they are scaled to add up to one. Equal by default.
    blend : float
        Width of the zone of transition about a face between different tiles, in tile edges, at
        most 1. Below about 0.2 the surface bends more sharply than a wall of some thickness can
        follow. With 0 there is no zone: neighbours share the mean of their coefficients on the
        face and meet there in creases (see Notes).
    tol : float
        Largest deviation of the fitted spline from the blended fields, in tile edges.

    Returns
    -------
    Mixture
        To be handed to `Lattice` as its tile.

    Raises
    ------
    InputError
        If a name is unknown, an argument is wrong, or none or both of `cells` and `seed` are
        given. An array of another shape than `repeat` is refused by the lattice.

    Notes
    -----
    Hong et al. 2025, section 3.3: a single spline for the entire lattice gives any continuity
    between its tiles; here it is C2. In the zone the fields of both tiles are continued, by
    repetition or, where a tile does not repeat smoothly, by point reflection in the face, and
    weighed by a fifth-degree smooth step.

    With ``blend=0`` the spline is only C0 at faces (section 3.1): the surface of each tile ends in
    an edge on the face, where that of its neighbour goes on. Distances are those to the union of
    these pieces, edges included, so that a wall is round about a crease on its outer side and has a
    crease on its inner one. Where the fields of two tiles differ in sign on a face, the surface
    follows that face, within a span of the spline.

    Tiles that are cubic splines with equal knots, full at the ends, and agree on all faces that
    they share in values and slopes, are joined as they are, but for one factor, and C1.

    Examples
    --------
    >>> import ilattice as il
    >>> mixture = il.tiles.mix("gyroid", "diamond", cells=lambda i, j, k: (i + j + k) % 2)
    >>> il.Lattice(mixture, through=il.macroshape.box((2, 1, 1)), repeat=(2, 1, 1)).tile
    Mixture(gyroid+diamond, by cells)
    """
    known = tuple(_as_tile(t) for t in tiles)
    width = as_array("blend", blend)
    if width.size != 1 or not 0.0 <= width.ravel()[0] <= 1.0:
        raise InputError(f"blend must be one number from 0 (shared faces) to 1, got {blend!r:.80}")
    if (cells is None) == (seed is None):
        raise InputError(
            "cells or seed must be given, and not both: an array or a function that says which "
            "tile is where, or the seed of a random choice"
        )
    if cells is None:
        rule = _random_rule(len(known), seed, probabilities)
    elif probabilities is not None:
        raise InputError("probabilities go with a random choice (seed), not with cells")
    elif callable(cells):
        rule = partial(_called, cells)
    else:
        rule = partial(_given, _as_cells(cells))
    return Mixture(known, rule, None, float(width.ravel()[0]), as_positive("tol", tol))


def hybrid(*tiles: Tile | str, weight: Weight, tol: float = TOL) -> Mixture:
    """Smooth transition between tiles over the part.

    Parameters
    ----------
    *tiles : Tile or str
        Two or more tiles.
    weight : callable
        Takes parameters (n, 3) of the map, returns weights (n, m), one column per tile, none
        negative, which are scaled to add up to one; for two tiles also the share (n,) of the
        second, between 0 and 1. `sigmoid` makes one. It is called inside the domain only and must
        agree on the two ends of a closed direction.
    tol : float
        Largest deviation of the fitted spline from the weighed fields, in tile edges.

    Returns
    -------
    Mixture
        To be handed to `Lattice` as its tile.

    Raises
    ------
    InputError
        If a name is unknown or there are fewer than two tiles. Weights of a wrong shape,
        negative ones, and ones that vanish together are refused by the lattice.

    Examples
    --------
    >>> import ilattice as il
    >>> il.tiles.hybrid("gyroid", "diamond", weight=il.tiles.sigmoid(0, centre=0.5, width=0.3))
    Mixture(gyroid+diamond, by weights)
    """
    if len(tiles) < 2:
        raise InputError(f"tiles must be at least two, got {len(tiles)}")
    if not callable(weight):
        raise InputError(f"weight must be a function of parameters (n, 3), got {weight!r:.80}")
    known = tuple(_as_tile(t) for t in tiles)
    return Mixture(known, None, weight, BLEND, as_positive("tol", tol))


@dataclass(frozen=True)
class sigmoid:  # noqa: N801  (a function to its users)
    """Weights that change from tile to tile along one direction, by logistic functions.

    Parameters
    ----------
    axis : {0, 1, 2}
        Direction of the parameters.
    centre : float or sequence of float
        Parameters at which two tiles have equal shares: one fewer than there are tiles, ascending.
    width : float
        Length over which a line of the steepest slope rises from 0 to 1, in parameters. The share
        itself rises from 12 % to 88 % there.

    Raises
    ------
    InputError
        If an argument is wrong.

    Examples
    --------
    >>> sigmoid(0, centre=0.5, width=0.2)([[0.5, 0.0, 0.0]])
    array([0.5])
    """

    axis: int
    centre: Any
    width: float

    def __post_init__(self) -> None:
        as_choice("axis", self.axis, (0, 1, 2))
        centres = np.atleast_1d(as_array("centre", self.centre))
        if centres.ndim != 1 or len(centres) == 0 or (np.diff(centres) <= 0).any():
            raise InputError(f"centre must be ascending numbers, got {self.centre!r:.80}")
        object.__setattr__(self, "centre", tuple(float(c) for c in centres))
        object.__setattr__(self, "width", as_positive("width", self.width))

    def __call__(self, u: ArrayLike) -> FloatArray:
        """Share (n,) of the second of two tiles, or weights (n, m), at parameters (n, 3)."""
        x = as_points("u", u)[:, self.axis, None]
        rise = 0.5 + 0.5 * np.tanh((x - np.array(self.centre)) * (2.0 / self.width))
        if len(self.centre) == 1:
            return rise[:, 0]
        ends = np.ones((len(x), 1))
        return -np.diff(np.concatenate([ends, rise, 0.0 * ends], axis=1), axis=1)


def _as_tile(tile: Any) -> Tile:
    if isinstance(tile, Tile):
        return tile
    if isinstance(tile, str):
        return get(tile)
    raise InputError(f"tiles must be Tiles or names of the catalogue, got {tile!r:.80}")


def _random_rule(count: int, seed: Any, probabilities: Any) -> Cells:
    """Random choice among so many tiles."""
    if count == 0:
        raise InputError("tiles must be given for a random choice")
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or seed < 0:
        raise InputError(f"seed must be a whole number of at least 0, got {seed!r}")
    p = as_array("probabilities", np.ones(count) if probabilities is None else probabilities)
    if p.shape != (count,) or (p < 0).any() or not p.sum() > 0:
        raise InputError(
            f"probabilities must be {count} numbers, one per tile, none negative, not all zero, "
            f"got {probabilities!r:.80}"
        )
    return partial(_drawn, int(seed), p / p.sum())


def _drawn(seed: int, p: FloatArray, repeat: tuple[int, int, int]) -> AnyArray:
    return np.random.default_rng(seed).choice(len(p), size=repeat, p=p)


def _as_cells(cells: Any) -> AnyArray:
    try:
        return np.array(cells)
    except ValueError as e:
        raise InputError(f"cells must be an array of the shape of repeat: {e}") from e


def _given(cells: AnyArray, repeat: tuple[int, int, int]) -> AnyArray:
    if cells.shape != tuple(repeat):
        raise InputError(
            f"cells must have one entry per tile, shape {tuple(repeat)} as repeat, "
            f"got shape {cells.shape}"
        )
    return cells


def _called(choose: Callable[..., Any], repeat: tuple[int, int, int]) -> AnyArray:
    out = np.empty(repeat, dtype=object)
    for at in np.ndindex(*repeat):
        out[at] = asked("cells", choose, *at)
    return out


def _numbered(tiles: Sequence[Tile], cells: AnyArray) -> tuple[list[Tile], IntArray]:
    """All tiles in use, and per cell the number of its own."""
    found: dict[Any, int] = {}
    used: list[Tile] = []
    out = np.empty(cells.shape, np.int64)
    for at in np.ndindex(*cells.shape):
        value = cells[at]
        key = value if isinstance(value, (str, int, np.integer)) else id(value)
        if key not in found:
            found[key] = len(used)
            used.append(_entry(tiles, value, at))
        out[at] = found[key]
    return used, out


def _entry(tiles: Sequence[Tile], value: Any, at: tuple[int, ...]) -> Tile:
    """The tile that an entry of the cells stands for."""
    if isinstance(value, (Tile, str)):
        return _as_tile(value)
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise InputError(f"cells{list(at)} must be an index, a name or a Tile, got {value!r:.80}")
    if not 0 <= value < len(tiles):
        raise InputError(
            f"cells{list(at)} is tile number {value}, but there are {len(tiles)}, counted from 0"
        )
    return tiles[int(value)]
