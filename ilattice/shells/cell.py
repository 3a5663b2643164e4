"""Unit cells of shells, as tiles.

The cell is [0, 1]³, its octant [1/2, 1]³: the corner 000 of the octant is the middle of the cell.
The field of a tile is the signed distance to the shell near it, as a cubic spline with values that
are found in the octant and repeated: it has the symmetry of the cell to the bit.

Guarantees: the sides of a tile are the colours of its octants, and it is negative where they are
-1; how far its zero set is off triangles that are curved with the normals at their corners is
measured, and told from 1e-3 of the cell on.
Non-guarantee: where a boundary turns more sharply than the spans of the spline, so does the tile
not.

Source: Xu et al. 2023, sections 2.1 to 2.4.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ilattice._geometry import grid_points
from ilattice._progress import Progress
from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import FixedMapping, Frozen, as_flag, as_whole, read_only
from ilattice.bspline import BSpline
from ilattice.bspline.fit import fit_interpolate
from ilattice.bspline.knots import uniform_knots
from ilattice.errors import GeometryError, InputError
from ilattice.minimal.completion import PeriodicSurface
from ilattice.minimal.tile import (
    Samples,
    SignedDistance,
    sampled,
    spans_for,
    warn_off,
    zero_set_error,
)
from ilattice.shells.boundary import boundary
from ilattice.shells.surface import EDGE, N, OctantSurface, surface
from ilattice.shells.topologies import Topology, parsed
from ilattice.tiles import Tile

#: Spans of a cell.
MIN_SPANS, MAX_SPANS = 8, 128
#: Distance of the zero set from the curved triangles, in cells, that is told.
TOLERANCE = 1e-3
_REACH = 2.5  # spans
_SAMPLES = 20_000  # in the octant


@dataclass(frozen=True, eq=False, repr=False)
class Shell(Frozen):
    """A unit cell of a shell. Made by `cell`.

    Attributes
    ----------
    surface : OctantSurface
        The shell in an octant, with its boundary.
    parameters : mapping
        Position and derivative, as they were given.
    spans : int
        Spans of the tile's spline per edge of the cell.
    """

    surface: OctantSurface
    parameters: FixedMapping[str, Any]
    spans: int

    def __repr__(self) -> str:
        """Short form."""
        given = ", ".join(f"{k}={v}" for k, v in self.parameters.items())
        return f"Shell({self.name}, {given})"

    @property
    def topology(self) -> Topology:
        """Class of the boundary."""
        return self.surface.boundary.topology

    @property
    def name(self) -> str:
        """As topo_19_rrr."""
        return f"{self.topology.paper or self.topology.name}_{self.surface.symmetry}"

    @property
    def area(self) -> float:
        """Area per cell."""
        return self.surface.area

    @cached_property
    def periodic(self) -> PeriodicSurface:
        """The shell in the whole cell, as triangles."""
        return self.surface.completed()

    @cached_property
    def values(self) -> FloatArray:
        """Values of the field at the nodes of the octant, shape (m + 1,) * 3, for 2 m spans.

        Near the shell they are signed distances, and they level off 2.5 spans away from it.
        """
        count = self.spans // 2
        a = 0.5 + np.arange(count + 1) / self.spans
        u = grid_points(a, a, a)
        values = self._distance(u).reshape((count + 1,) * 3)
        for axis, kind in enumerate(self.surface.symmetry):
            if kind == "t":  # both faces are one
                ends = np.moveaxis(values, axis, 0)
                sign = self.surface.signs[axis]
                ends[0] = 0.5 * (ends[0] + sign * ends[-1])
                ends[-1] = sign * ends[0]
        return read_only(values)

    @cached_property
    def tile(self) -> Tile:
        """The shell as the zero set of a tile, so that lattices take true offsets of it.

        Warns
        -----
        PrecisionWarning
            If the zero set is off the shell by more than 1e-3 of the cell, see `tile_error`.
        """
        spline = periodic_spline(repeated(self.values, self.surface))
        warn_off(zero_set_error(spline, self._distance), self.name, TOLERANCE)
        return Tile(spline, name=self.name, source="Xu et al. 2023")

    @property
    def tile_error(self) -> float:
        """Largest distance found of the zero set of the tile from the shell, in cells.

        The shell is curved triangles through the vertices, with `OctantSurface.normals` there; what
        flat ones are off it, most where it is bent within the layer, is not part of this.
        """
        field: Any = self.tile.field
        return zero_set_error(field, self._distance)

    @cached_property
    def _distance(self) -> SignedDistance:
        """Signed distance in the octant: to what lies in it, and to shifted images next to it."""
        octant, reach = self.surface, _REACH / self.spans
        own = sampled(octant.vertices, octant.faces, octant.normals, _SAMPLES)[0]
        points, normals, shapes = own.points, own.normals, own.shapes
        for axis, kind in enumerate(octant.symmetry):
            if kind == "r":  # what is reflected is not nearer than what it is the image of
                continue
            for shift in (-0.5, 0.5):
                x = points[:, axis] + shift
                near = np.flatnonzero((x > 0.5 - 2.0 * reach) & (x < 1.0 + 2.0 * reach))
                moved = points[near] + shift * (np.arange(3) == axis)
                points = np.concatenate([points, moved])
                normals = np.concatenate([normals, octant.signs[axis] * normals[near]])
                shapes = np.concatenate([shapes, octant.signs[axis] * shapes[near]])
        return SignedDistance(Samples(points, normals, shapes), np.ones(3), reach)


def repeated(values: FloatArray, octant: OctantSurface) -> FloatArray:
    """Values at the nodes of the cell from those in the octant.

    Parameters
    ----------
    values : (m + 1, m + 1, m + 1) array
        In the octant.
    octant : OctantSurface
        How it is repeated.

    Returns
    -------
    (2 m, 2 m, 2 m) array
        At multiples of 1 / (2 m).
    """
    m = len(values) - 1
    for axis, kind in enumerate(octant.symmetry):
        own, mirrored = values.take(np.arange(m), axis), values.take(np.arange(m, 0, -1), axis)
        other = mirrored if kind == "r" else octant.signs[axis] * own
        values = np.concatenate([other, own], axis)
    return values


def periodic_spline(values: FloatArray) -> BSpline:
    """Periodic cubic spline on the unit cube through values at its knots.

    Parameters
    ----------
    values : (n, n, n) array
        At multiples of 1 / n.

    Returns
    -------
    BSpline
        The spline.
    """
    knots = uniform_knots(len(values), 3, periodic=True)
    at = np.arange(len(values)) / len(values)
    return fit_interpolate(values, [knots] * 3, 3, periodic=True, at=[at] * 3)


def cell(
    name: str | Topology, *, position: ArrayLike = 0.0, derivative: ArrayLike = 1.5, n: int = N,
    method: str = "harmonic", layer: float | None = None, spans: int | None = None,
    bubbles: bool = False, progress: Progress = None,
) -> Shell:  # fmt: skip
    """Unit cell of a shell over a boundary.

    Parameters
    ----------
    name : str
        Class, and r or t for each axis, as ``topo_19_rrr``: whether octants are reflected or
        translated.
    position, derivative : array_like
        Of the nodes of the boundary; see `boundary`.
    n, method, layer : optional
        See `surface`.
    spans : int, optional
        Spans of the tile's spline per edge of the cell, even; by default as many as triangles and
        layer ask for.
    bubbles : bool
        Whether pieces are allowed that nothing holds.
    progress : bool or callable, optional
        As in `surface`.

    Returns
    -------
    Shell
        The cell; `Shell.tile` is for lattices.

    Raises
    ------
    InputError
        If an argument is wrong.
    GeometryError
        If curves cross, octants cannot be translated, or pieces of the shell are bubbles.
    ConvergenceError
        If no stationary surface is found.

    Examples
    --------
    >>> import ilattice as il
    >>> shell = il.shells.cell("topo_19_rrr", position=0.1, derivative=1.5)
    >>> round(shell.area, 2), shell.periodic.genus
    (2.34, 3)
    """
    topology, symmetry = parsed(name)
    curves = boundary(topology, position, derivative)
    allowed = as_flag("bubbles", bubbles)
    count = None if spans is None else as_spans(spans)
    octant = surface(curves, symmetry, n=n, method=method, layer=layer, progress=progress)
    if octant.bubbles and not allowed:
        raise GeometryError(
            f"{octant.bubbles} of {int(octant.pieces.max()) + 1} pieces of the shell {name} are "
            "bubbles that nothing holds: move nodes so that their loops come nearer to others, or "
            "ask for bubbles=True"
        )
    if count is None:
        count = spans_for(min(EDGE / n, 2.0 * octant.layer or 1.0))
    given = FixedMapping({"position": _plain(position), "derivative": _plain(derivative)})
    return Shell(octant, given, count)


def as_spans(spans: Any) -> int:
    """A number of spans per edge of the cell, of which octants take halves.

    Parameters
    ----------
    spans : int
        The number.

    Returns
    -------
    int
        The same.

    Raises
    ------
    InputError
        If it is odd, or out of range.
    """
    count = as_whole("spans", spans, MIN_SPANS, MAX_SPANS)
    if count % 2:
        raise InputError(f"spans must be even, got {count}: take {count + 1}")
    return count


def _plain(value: Any) -> Any:
    """A number, or tuples of numbers."""
    a = np.asarray(value, np.float64)
    return float(a) if a.ndim == 0 else tuple(map(_plain, a))
