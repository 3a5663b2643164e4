"""The unit of repetition: a field on the unit cube with what is known about it.

Guarantees: a tile has a zero set (a change of sign was seen, or is known from the catalogue); it
is immutable. Non-guarantees: derivatives of a tile made from a plain callable are those of a
spline approximation, accurate to `tol` in its values only; a callable with kinks gets a
`PrecisionWarning`. A zero set thinner than 1/64 of the cell may be overlooked.
"""

import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import InitVar, dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np

from ilattice._field import OF_THE_INNER, Field, as_boxes, owns
from ilattice._geometry import grid_points, spread_points
from ilattice._typing import AnyArray, ArrayLike, FloatArray
from ilattice._validate import (
    as_array,
    as_flag,
    as_float_type,
    as_items,
    as_points,
    as_positive,
    as_real,
    as_whole,
    asked,
    check_finite,
    read_only,
)
from ilattice.bspline import BSpline
from ilattice.bspline.fit import fit, fit_report
from ilattice.errors import ConvergenceError, GeometryError, InputError, PrecisionWarning
from ilattice.fields.node import Node
from ilattice.plot.cards import card
from ilattice.plot.quick import show
from ilattice.plot.shapes import frame, isosurface
from ilattice.tiles._node import TileNode
from ilattice.tiles.trig import TrigField

#: Deviation of a spline approximation, as a fraction of the largest value, unless `tol` says
#: otherwise; most spans per direction of the cell, and degree.
SPLINE_TOL = 1e-5
SPLINE_SPANS = 64
SPLINE_DEGREE = 3
_CUBE = read_only(np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]))
_SQRT3 = 3.0**0.5


@dataclass(frozen=True, eq=False, repr=False)
class Tile(Field):
    """A field on [0, 1]³, negative inside, with a name and what is known about it.

    Parameters
    ----------
    field : callable
        Takes points (n, 3) of the unit cube, returns values (n,). A `TrigField`, a scalar
        `BSpline` with domain [0, 1]³, any smooth field, or a plain function.
    name : str
        For messages and reports.
    level : float
        The surface is {field = level}; the solid lies below.
    source : str
        Where the field is from.
    singular_at_zero : bool
        The gradient vanishes somewhere on the surface.
    hexagonal : bool
        The axes are those of a hexagonal cell, see `cell`.
    disconnected : bool
        The solid or its complement falls into several pieces.
    symmetric : bool
        The field does not change when x, y, z are permuted cyclically.
    edges : array_like, shape (3, 3), optional
        Edges of the cell as columns, where it is neither a cube nor hexagonal, see `cell`.
    properties : mapping of str to callable
        Further fields on the unit cube, such as a colour or a material.
    tol : float, optional
        Largest deviation of the spline approximation of a plain function where derivatives
        are needed; default 1e-5 of the largest value.
    check : bool
        Whether to look for a change of sign.

    Raises
    ------
    InputError
        If the field is not callable, is not defined on the unit cube, or returns values of
        another shape or values that are not finite.
    GeometryError
        If the field does not change sign: there is no surface.

    Examples
    --------
    >>> import numpy as np
    >>> slab = Tile(lambda u: np.abs(u[:, 2] - 0.5) - 0.2, name="slab")
    >>> slab([[0.0, 0.0, 0.5]])
    array([-0.2])
    """

    field: Any
    name: str = field(default="custom", kw_only=True)
    level: float = field(default=0.0, kw_only=True)
    source: str = field(default="", kw_only=True)
    singular_at_zero: bool = field(default=False, kw_only=True)
    hexagonal: bool = field(default=False, kw_only=True)
    disconnected: bool = field(default=False, kw_only=True)
    symmetric: bool = field(default=False, kw_only=True)
    edges: Any = field(default=None, kw_only=True)
    properties: Mapping[str, Callable[..., Any]] = field(default_factory=dict, kw_only=True)
    tol: float | None = field(default=None, kw_only=True)
    check: InitVar[bool] = field(default=True, kw_only=True)

    def __post_init__(self, check: bool) -> None:
        _check_field(self.field)
        for told in ("name", "source"):
            if not isinstance(getattr(self, told), str):
                raise InputError(f"{told} must be a text, got {getattr(self, told)!r:.80}")
        for flag in ("singular_at_zero", "hexagonal", "disconnected", "symmetric"):
            object.__setattr__(self, flag, as_flag(flag, getattr(self, flag)))
        object.__setattr__(self, "level", as_real("level", self.level))
        if self.tol is not None:
            object.__setattr__(self, "tol", as_positive("tol", self.tol))
        if self.edges is not None:
            edges = as_array("edges", self.edges, ndim=2)
            if edges.shape != (3, 3) or np.linalg.det(edges) == 0.0:
                raise InputError(f"edges must be three independent columns, got {self.edges!r:.80}")
            object.__setattr__(self, "edges", read_only(np.array(edges)))
        if not isinstance(self.properties, Mapping):
            raise InputError(f"properties must be a mapping, got {self.properties!r:.80}")
        for name, prop in self.properties.items():
            if not callable(prop):
                raise InputError(f"properties[{name!r}] must be callable, got {prop!r:.80}")
        object.__setattr__(self, "properties", MappingProxyType(dict(self.properties)))
        if as_flag("check", check):
            self._check_zero_set()

    @classmethod
    def from_callable(
        cls,
        f: Callable[[FloatArray], Any],
        *,
        tol: float,
        name: str = "custom",
        degree: int = SPLINE_DEGREE,
        method: str = "least-squares",
        periodic: bool | tuple[bool, bool, bool] | None = None,
        max_spans: int | None = None,
    ) -> "Tile":
        """Spline tile that approximates a function.

        Parameters
        ----------
        f : callable
            Takes points (n, 3) of the unit cube, returns values (n,).
        tol : float
            Largest deviation at independent points.
        name : str
            Name of the tile.
        degree, method, periodic, max_spans : optional
            See `fit`.

        Returns
        -------
        Tile
            The tile; its field is a `BSpline`.

        Raises
        ------
        ConvergenceError
            If `tol` is not reached.
        """
        tile = cls(f, name=name)
        return tile.fit(
            tol=tol, degree=degree, method=method, periodic=periodic, max_spans=max_spans
        )

    # ------------------------------------------------------------------ evaluation

    def __call__(self, u: ArrayLike, /) -> FloatArray:
        """Values, shape (n,), at points ``u`` (n, 3) of the unit cube."""
        points = as_points("u", u)
        values = as_array(f"values of tile {self.name!r}", self._asked("", points), finite=False)
        if values.shape != (len(points),):
            raise InputError(
                f"the field of tile {self.name!r} must return values of shape ({len(points)},) "
                f"for {len(points)} points, got shape {values.shape}"
            )
        return check_finite(f"values of tile {self.name!r}", values) - self.level

    def jet(self, u: ArrayLike, order: int = 2) -> tuple[FloatArray, ...]:
        """Value and derivatives: of the field itself, or of its spline approximation.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Points of the unit cube.
        order : int
            Highest derivative: 0, 1 or 2.

        Returns
        -------
        tuple of ndarray
            Values (n,), gradients (n, 3), Hessians (n, 3, 3): the first ``order + 1``.
        """
        if not self.has("jet"):
            return self.kernel_field.jet(u, order)
        value, *rest = self._asked("jet", as_points("u", u), order)
        return (value - self.level, *rest)

    def grid(self, axes: Iterable[ArrayLike], dtype: Any = np.float64) -> AnyArray:
        """Values on a tensor grid of the unit cube.

        Parameters
        ----------
        axes : iterable of array_like
            Three 1-D arrays of coordinates.
        dtype : numpy.dtype
            Type of the result: ``numpy.float64`` or ``numpy.float32``.

        Returns
        -------
        ndarray, shape (len(x), len(y), len(z))
            Values.

        Raises
        ------
        InputError
            For axes that are not three 1-D arrays, or another type.
        """
        kind = as_float_type("dtype", dtype)
        xyz = tuple(as_array(f"axes[{i}]", a, ndim=1) for i, a in enumerate(as_items("axes", axes)))
        if len(xyz) != 3:
            raise InputError(f"axes must be three 1-D arrays, got {len(xyz)}")
        if owns(self.field, "grid"):
            return np.asarray(self._asked("grid", xyz) - self.level, kind)
        out = np.empty(tuple(len(a) for a in xyz), kind)
        for i, x in enumerate(xyz[0]):
            out[i] = self(grid_points([x], xyz[1], xyz[2])).reshape(out.shape[1:])
        return out

    def range(self, lo: ArrayLike, hi: ArrayLike) -> FloatArray:
        """Rigorous bounds of the values on boxes, infinite if the field is a plain function.

        Parameters
        ----------
        lo, hi : array_like, shape (n, 3)
            Corners.

        Returns
        -------
        ndarray, shape (n, 2)
            Lower and upper bounds.

        Raises
        ------
        InputError
            For corners of different shapes, not finite or in the wrong order.

        Notes
        -----
        ``tile.fit(tol=...)`` makes a spline tile of a plain function, which has bounds.
        """
        if not self.has("range"):
            return super().range(lo, hi)
        return self._asked("range", *as_boxes(lo, hi)) - self.level

    def _has(self, name: str) -> bool:
        """See `Field.has`: derivatives that are those of a stand-in do not count."""
        return super()._has(name) and (name not in OF_THE_INNER or owns(self.field, name))

    @cached_property
    def kernel_field(self) -> TrigField | BSpline:
        """The field minus the level as what compiled code evaluates, equal up to `tol`.

        A `TrigField` that repeats on the unit cube and a spline without weights are taken as
        they are; anything else is replaced by a fitted spline. Where its tolerance is not met
        within 64 spans, the best fit is taken and a `PrecisionWarning` says how good it is.
        """
        if isinstance(self.field, TrigField) and _repeats(self.field):
            return self.field if self.level == 0.0 else self.field - self.level
        if isinstance(self.field, BSpline) and self.field.weights is None:
            s = self.field
            return (
                s if self.level == 0.0 else BSpline(s.t, s.c - self.level, s.k, periodic=s.periodic)
            )
        return self._stand_in()

    # ------------------------------------------------------------------ properties

    @cached_property
    def node(self) -> Node:
        """The tile, repeated through space, as a field of `ilattice.fields`; zero at its level."""
        return TileNode(self)

    @property
    def bounds(self) -> FloatArray:
        """The unit cube, shape (2, 3)."""
        cube: FloatArray = _CUBE
        return cube

    @property
    def cell(self) -> FloatArray:
        """Edges of the cell as columns, shape (3, 3): a cube unless the tile says otherwise.

        ``x = cell @ u`` places a hexagonal tile with angles of 120 degrees.
        """
        if self.edges is not None:
            return np.array(self.edges)
        if self.hexagonal:
            return np.array([[1.0, -0.5, 0.0], [0.0, 0.5 * _SQRT3, 0.0], [0.0, 0.0, 1.0]])
        return np.eye(3)

    @cached_property
    def periodic(self) -> tuple[bool, bool, bool]:
        """Whether values and gradients agree on opposite faces, per axis (tried at 64 points).

        A skeleton repeats along its periodic axes; halfway between arms its gradients jump, on
        faces as anywhere.
        """
        if isinstance(self.field, TrigField) and _repeats(self.field):
            return (True, True, True)
        if owns(self.field, "repeats"):
            return self.field.repeats
        x, y, z = (self._matches(axis) for axis in range(3))
        return (x, y, z)

    def __repr__(self) -> str:
        """Short form."""
        return f"Tile({self.name!r}, {type(self.field).__name__}, level={self.level:g})"

    def _repr_html_(self) -> str:
        numbers = {"name": self.name, "field": type(self.field).__name__, "level": self.level}
        return card(self, numbers, n=40)

    # ------------------------------------------------------------------ verbs

    def plot(self, *, n: int = 60, solid: bool | None = None, **options: Any) -> Any:
        """Show one cell in a window or a notebook.

        Parameters
        ----------
        n : int
            Samples along each edge; for the picture only.
        solid : bool, optional
            Show where the field is negative, closed, instead of the surface alone; by default so
            for all but trigonometric and spline tiles.
        **options
            Of `ilattice.plot.show`, such as ``clip``, ``view`` or ``screenshot``.

        Returns
        -------
        object
            What pyvista returns.
        """
        axis = np.linspace(0.0, 1.0, as_whole("n", n, 2, 400))
        if solid is None:
            solid = not isinstance(self.field, TrigField | BSpline)
        shown = isosurface(self.grid([axis] * 3), [axis] * 3, solid=as_flag("solid", solid))
        shown.points = np.asarray(shown.points, float) @ self.cell.T
        return show(shown, lines=frame(self.cell), **{"title": self.name, **options})

    def with_level(self, level: float) -> "Tile":
        """The tile of another level set of the same field.

        Parameters
        ----------
        level : float
            The new level; it replaces the present one.

        Returns
        -------
        Tile
            The new tile. It is not known to be singular, whatever this one is.

        Raises
        ------
        GeometryError
            If the field does not cross that level.
        """
        level = as_real("level", level)
        same = self.singular_at_zero and level == self.level
        return replace(self, level=level, singular_at_zero=same)

    def with_properties(self, **fields: Callable[..., Any]) -> "Tile":
        """The tile with further property fields.

        Parameters
        ----------
        **fields : callable
            Fields on the unit cube by name; they replace those of equal name.

        Returns
        -------
        Tile
            The new tile.
        """
        return replace(self, properties={**self.properties, **fields}, check=False)

    def fit(
        self,
        *,
        tol: float,
        degree: int = SPLINE_DEGREE,
        method: str = "least-squares",
        periodic: bool | tuple[bool, bool, bool] | None = None,
        max_spans: int | None = None,
    ) -> "Tile":
        """The same tile with a spline as its field.

        A skeleton has cones and creases away from its surface, which no spline follows: its
        values are fitted near the zero set only, see `FlattenedField`.

        Parameters
        ----------
        tol : float
            Largest deviation of the values, measured at independent points of the cube and its
            faces; spans are doubled until it is met.
        degree : int
            Degree of the spline in every direction.
        method : str
            Fitting method, see `ilattice.bspline.fit`.
        periodic : bool or tuple of bool, optional
            Directions in which the spline repeats smoothly; default those of `periodic`.
        max_spans : int, optional
            Most spans per direction.

        Returns
        -------
        Tile
            The spline tile. The level is part of its field: the new level is zero.

        Raises
        ------
        ConvergenceError
            If `tol` is not reached.
        """
        ends = self.periodic if periodic is None else periodic
        spline = fit(
            self._fit_target,
            tol=as_positive("tol", tol),
            degree=degree,
            method=method,
            periodic=ends,
            max_spans=max_spans,
        )
        return replace(self, field=spline, level=0.0)

    # ------------------------------------------------------------------ inner

    @property
    def _fit_target(self) -> Any:
        """What a spline is fitted to: the values minus the level, flat away from a skeleton."""
        if owns(self.field, "flattened"):
            return self.field.flattened(self.level)
        return self

    def _stand_in(self) -> BSpline:
        """Spline for a plain function: to tolerance, or the best within 64 spans with a warning."""
        top = float(np.abs(self._samples(16)).max())
        tol = SPLINE_TOL * top if self.tol is None else self.tol
        k, ends, most = SPLINE_DEGREE, self.periodic, SPLINE_SPANS
        try:
            return fit(self._fit_target, degree=k, periodic=ends, tol=tol, max_spans=most)
        except ConvergenceError:
            spline, report = fit_report(self._fit_target, degree=k, periodic=ends, spans=most)
        warnings.warn(
            f"the spline approximation of tile {self.name!r} deviates by {report.error:.3g} "
            f"(asked for {tol:.3g}) with {SPLINE_SPANS} spans per axis: is the field smooth?",
            PrecisionWarning,
            stacklevel=3,
        )
        return spline

    def _samples(self, n: int) -> AnyArray:
        a = (np.arange(n) + 0.37) / n
        return self.grid((a, a, a))

    def _asked(self, method: str, *arguments: Any) -> Any:
        """What the field returns, or one of its methods; errors name the tile."""
        f = getattr(self.field, method) if method else self.field
        told = f"{method} of the field" if method else "the field"
        return asked(f"{told} of tile {self.name!r}", f, *arguments)

    def _check_zero_set(self) -> None:
        """Refuse a field that does not change sign on 24³, then on 64³ samples."""
        for n in (24, 64):
            values = self._samples(n)
            low, high = float(values.min()), float(values.max())
            if low < 0.0 < high:
                return
        raise GeometryError(
            f"tile {self.name!r} has no zero set: on {n}³ samples its values minus the level "
            f"{self.level:g} run from {low:.6g} to {high:.6g}; shift its level"
        )

    def _matches(self, axis: int) -> bool:
        """Whether values and normal derivatives agree on the two faces of an axis."""
        u = spread_points(64)
        h = 3e-3
        ends: list[AnyArray] = []
        for face, sign in ((0.0, 1.0), (1.0, -1.0)):
            layers = []
            for j in range(5):
                u[:, axis] = face + sign * j * h
                layers.append(self(u))
            slope = np.tensordot([-25.0, 48.0, -36.0, 16.0, -3.0], layers, 1) * sign / (12.0 * h)
            ends.append(np.stack([layers[0], slope]))
        scale = np.abs(ends).max(axis=(0, 2)) + np.array([0.0, 1e-300])
        gap = np.abs(ends[0] - ends[1]).max(axis=1)
        return bool(gap[0] <= 1e-9 * scale[0] and gap[1] <= 1e-4 * max(scale[1], scale[0]))

    def __getstate__(self) -> dict[str, Any]:
        state = dict(self.__dict__)
        state["properties"] = dict(self.properties)
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, properties=MappingProxyType(state["properties"]))


def _check_field(f: Any) -> None:
    """Refuse what cannot be a field on the unit cube."""
    if isinstance(f, Tile) or not callable(f):
        raise InputError(
            f"field must be a callable u (n, 3) -> (n,), a TrigField or a BSpline, got {f!r:.80}"
        )
    if isinstance(f, BSpline):
        if f.ndim != 3 or f.c.ndim != 3:
            raise InputError(
                f"field must be a scalar spline of three parameters, got {f.ndim} parameters and "
                f"coefficients of shape {f.c.shape}"
            )
        if not np.allclose(f.domain, _CUBE, rtol=0.0, atol=1e-12):
            raise InputError(f"field must have the domain [0, 1]³, got {f.domain.tolist()}")


def _repeats(f: TrigField) -> bool:
    """Whether a trigonometric field repeats on the unit cube."""
    turns = 1.0 / f.period
    return f.linear is None and bool((np.abs(turns - np.rint(turns)) <= 1e-15 * turns).all())
