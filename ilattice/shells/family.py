"""Shells with one outer boundary and different ones inside, which fit each other in lattices.

The outer boundary is on the faces of the cell: positions of the nodes there, and derivatives on
these faces. What is left are positions of nodes on the edges from the middle of the cell, and
derivatives on the planes through it.

Tiles of a family have equal values on the faces of the cell, to the bit, and no slope across them:
in lattices they are joined C1. Near the faces their fields are those of their own surface, moved
towards the field that they share.

Guarantees: lattices of a family are watertight, with continuous normals, whatever is where; by how
much a tile's zero set is off its surface is told from 2e-3 of the cell on. Non-guarantee:
curvatures jump at faces.

Source: Xu et al. 2023, section 4.1, figure 19.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ilattice._geometry import grid_indices, grid_points
from ilattice._typing import AnyArray, ArrayLike, FloatArray
from ilattice._validate import (
    Frozen,
    as_array,
    as_positive,
    as_real,
    as_whole,
    asked,
)
from ilattice.bspline import BSpline
from ilattice.errors import InputError
from ilattice.minimal.tile import SignedDistance, warn_off, zero_set_error
from ilattice.shells.boundary import boundary
from ilattice.shells.cell import Shell, as_spans, cell, periodic_spline, repeated
from ilattice.shells.surface import MAX_N, MIN_N, N, as_layer
from ilattice.shells.topologies import Topology, edge_place, home, parsed
from ilattice.tiles import Tile
from ilattice.tiles.mixture import TOL, Mixture

#: Length over which mean curvatures die out, which spans resolve; see `surface`.
LAYER = 0.03
#: Spans of the spline of a tile, distance where fields level off, and error that is told.
SPANS, REACH, TOLERANCE = 36, 0.08, 2e-3
#: Different cells of one lattice; each takes about a second.
MAX_CELLS = 500


@dataclass(frozen=True, eq=False, repr=False)
class Family(Frozen):
    """Shells of one outer boundary. Made by `family`; ``family(p)`` is one of them, as a tile.

    Attributes
    ----------
    topology : Topology
        Class of the boundaries.
    outer : tuple of 2 float
        Position and derivative of the outer boundary.
    derivative : float
        Inner derivative, unless another one is given.
    n, layer, spans : int, float, int
        Of the surfaces, and of the splines of tiles.
    """

    topology: Topology
    outer: tuple[float, float]
    derivative: float
    n: int
    layer: float
    spans: int
    _known: dict[tuple[float, ...], Any] = field(default_factory=dict, repr=False)

    def __repr__(self) -> str:
        """Short form."""
        return f"Family({self.name}, outer={self.outer})"

    @property
    def name(self) -> str:
        """As topo_1_rrr."""
        return f"{self.topology.paper or self.topology.name}_rrr"

    @property
    def inner(self) -> tuple[str, ...]:
        """Names of the parameters inside: position, if there are nodes, and derivative."""
        has_nodes = any(home(number) == 0 for number in self.topology.nodes)
        return ("position", "derivative") if has_nodes else ("derivative",)

    def shell(self, *parameters: float) -> Shell:
        """One of the shells, without regard to the others.

        Parameters
        ----------
        *parameters : float
            Those of `inner`, in that order; the derivative may be left out if there is a position.

        Returns
        -------
        Shell
            The shell.

        Raises
        ------
        InputError
            If there are too many or too few parameters, or one is out of its range.
        """
        return self._once(self._key(parameters))[0]

    def __call__(self, *parameters: float) -> Tile:
        """The tile of one of the shells; see `shell` and `graded`."""
        return self._once(self._key(parameters))[1]

    def graded(self, parameters: Callable[[FloatArray], Any] | ArrayLike) -> Mixture:
        """Cells of which the parameters inside vary over a lattice.

        Parameters
        ----------
        parameters : callable or array_like
            A function of the numbers (n, 3) of cells that returns values (n,) of the first of
            `inner`, or rows (n, 2) of all; or an array of the shape of `repeat`, or with a last
            axis for rows.

        Returns
        -------
        Mixture
            To be handed to `Lattice` as its tile; made when the lattice is used first.

        Raises
        ------
        InputError
            If `parameters` is neither of these; by the lattice, if shapes or values are wrong, or
            there are too many different cells.
        """
        given: Any = parameters
        if not callable(given):
            given = as_array("parameters", given)
        return Mixture((), Grading(self, given), None, 0.0, TOL)

    # ------------------------------------------------------------------ inner

    def _key(self, parameters: Any) -> tuple[float, ...]:
        names = self.inner
        if not 1 <= len(parameters) <= len(names):
            raise InputError(
                f"parameters of {self.name} must be {' and '.join(names)}, got {parameters!r:.60}"
            )
        key = tuple(as_real(n, p) for n, p in zip(names, parameters, strict=False))
        if names[0] == "position" and len(key) == 1:
            key = (*key, self.derivative)
        return key

    def _once(self, key: tuple[float, ...]) -> tuple[Shell, Tile]:
        if key not in self._known:
            shell = self._made(key)
            self._known[key] = (shell, self._tile(shell, key))
        return self._known[key]

    def _made(self, key: tuple[float, ...]) -> Shell:
        nodes = self.topology.nodes
        inside = np.array([home(number) == 0 for number in nodes])
        first = key[0] if len(key) == 2 else 0.0
        positions = np.where(inside, first, self.outer[0])
        ends = np.array([list(edge_place(number)[1].values()) for number in nodes])
        derivatives = np.where(ends == 1, self.outer[1], key[-1])
        return cell(
            self.topology, position=positions, derivative=derivatives, n=self.n, layer=self.layer,
            spans=self.spans,
        )  # fmt: skip

    @cached_property
    def _shared(self) -> tuple[FloatArray, FloatArray]:
        """Values of the reference in the octant, and coefficients of it in the cell."""
        middle = (self.outer[0], self.derivative) if len(self.inner) == 2 else (self.derivative,)
        shell = self._made(middle)
        values = _levelled(shell)[0]
        return values, end_coefficients(repeated(values, shell.surface))

    def _tile(self, shell: Shell, key: tuple[float, ...]) -> Tile:
        """Tile with the values of all others on the faces of the cell."""
        values, distance = _levelled(shell)
        reference, faces = self._shared
        a = np.linspace(0.0, 1.0, len(values))
        weight = a * a * (3.0 - 2.0 * a)
        for axis in range(3):
            gap = (reference - values).take([-1], axis)
            values = values + np.moveaxis(weight[:, None, None] * np.ones((1, 1, 1)), 0, axis) * gap
        c = end_coefficients(repeated(values, shell.surface))
        for axis in range(3):
            own, shared = np.moveaxis(c, axis, 0), np.moveaxis(faces, axis, 0)
            own[[0, 1, -2, -1]] = shared[[0, 1, -2, -1]]
        n = self.spans
        knots = np.concatenate([[0.0] * 3, np.arange(n + 1) / n, [1.0] * 3])
        spline = BSpline([knots] * 3, c, 3)
        told = ", ".join(f"{k}={v:g}" for k, v in zip(self.inner, key, strict=True))
        warn_off(zero_set_error(spline, distance), f"{self.name} ({told})", TOLERANCE)
        return Tile(spline, name=self.name, source="Xu et al. 2023")


@dataclass(frozen=True, eq=False)
class Grading:
    """Tiles of a family by the number of the cell: what a `Mixture` asks.

    Attributes
    ----------
    family : Family
        The family.
    parameters : callable or ndarray
        As `Family.graded` takes them.
    """

    family: Family
    parameters: Any

    def __call__(self, repeat: tuple[int, int, int]) -> AnyArray:
        """Tiles, shape `repeat`."""
        rows = self._rows(repeat)
        keys = [self.family._key(row) for row in np.round(rows, 12).tolist()]
        different = dict.fromkeys(keys)
        if len(different) > MAX_CELLS:
            raise InputError(
                f"parameters make {len(different)} different cells, at most {MAX_CELLS} are "
                "allowed: round them, for example to hundredths"
            )
        tiles = {key: self.family(*key) for key in different}
        out = np.empty(len(keys), object)
        out[:] = [tiles[key] for key in keys]
        return out.reshape(repeat)

    def _rows(self, repeat: tuple[int, int, int]) -> FloatArray:
        """Parameters of all cells, as rows."""
        given: Any = self.parameters
        count = int(np.prod(repeat))
        if callable(given):
            cells = grid_indices(repeat).astype(np.float64)
            given = as_array("parameters", asked("parameters", given, cells))
            shape: tuple[int, ...] = (count,)
        else:
            shape = repeat
        most = len(self.family.inner)
        if given.shape != shape and not (
            given.shape[:-1] == shape and 1 <= given.shape[-1] <= most
        ):
            raise InputError(
                f"parameters must be one value per cell, shape {shape}, or a row of up to {most} "
                f"({' and '.join(self.family.inner)}) per cell; got shape {given.shape}"
            )
        return given.reshape(count, -1)


def _levelled(shell: Shell) -> tuple[FloatArray, SignedDistance]:
    """Values in the octant of a field that levels off alike in all shells, and the field."""
    known: SignedDistance = shell._distance
    distance = SignedDistance(known.samples, known.cell, REACH)
    m = shell.spans // 2
    a = 0.5 + np.arange(m + 1) / shell.spans
    u = grid_points(a, a, a)
    return distance(u).reshape((m + 1,) * 3), distance


def end_coefficients(values: FloatArray) -> FloatArray:
    """Coefficients, for knots with full ends, of the spline through values of a mirrored cell.

    Parameters
    ----------
    values : (n, n, n) array
        At multiples of 1 / n, symmetric.

    Returns
    -------
    (n + 3, n + 3, n + 3) array
        The first two along each axis are equal, and so are the last two: no slope at the faces.
    """
    c = periodic_spline(values).c
    for axis in range(3):
        own = np.moveaxis(c, axis, 0)[1:-1]  # those that are centred at knots
        low, high = (2.0 * own[:1] + own[1:2]) / 3.0, (2.0 * own[-1:] + own[-2:-1]) / 3.0
        c = np.moveaxis(np.concatenate([low, low, own[1:-1], high, high]), 0, axis)
    return np.array(c)


def family(
    name: str | Topology, *, outer: tuple[float, float] = (0.0, 1.5),
    derivative: float | None = None, n: int = N, layer: float = LAYER, spans: int = SPANS,
) -> Family:  # fmt: skip
    """Shells of one outer boundary, for lattices of which the cells vary.

    Parameters
    ----------
    name : str
        Class, as ``topo_1_rrr``; octants are reflected along all axes.
    outer : tuple of 2 float
        Position and derivative of all nodes on the faces of the cell; see `boundary`.
    derivative : float, optional
        Inner derivative of cells for which none is given; by default the outer one.
    n, layer : optional
        See `surface`; by default the layer is 0.03, which the spans resolve.
    spans : int
        Spans of the tiles' splines per edge of the cell, even.

    Returns
    -------
    Family
        The family.

    Raises
    ------
    InputError
        If an argument is wrong.
    GeometryError, ConvergenceError
        If there is no shell for the outer boundary.

    Examples
    --------
    >>> import ilattice as il
    >>> il.shells.family("topo_1_rrr", outer=(0.2, 1.5)).inner
    ('position', 'derivative')
    """
    topology, symmetry = parsed(name)
    if symmetry != "rrr":
        raise InputError(
            f"name must end with _rrr in families, got {name!r:.40}: translated octants have their "
            "inner boundary on the faces of cells, too"
        )
    pair = as_array("outer", outer)
    if pair.shape != (2,):
        raise InputError(f"outer must be a position and a derivative, got {outer!r:.80}")
    inner = float(pair[1]) if derivative is None else as_positive("derivative", derivative)
    layer = as_layer(layer)
    boundary(topology, float(pair[0]), float(pair[1]))
    count = as_spans(spans)
    n = as_whole("n", n, MIN_N, MAX_N)
    return Family(topology, (float(pair[0]), float(pair[1])), inner, n, layer, count)
