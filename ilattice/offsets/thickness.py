"""Half-thickness in all the forms a user gives it, as splines over the parameter domain.

Guarantee: the splines are finite, not negative, and smaller than the part; how far they are off
what was asked is measured, told above `WARN` and refused above `REFUSE` (`Thickness.deviation`).
Continuous functions with kinks are fitted with knots at the kinks (`ilattice.offsets.kinks`);
polishing and `Wall.thickness_error` go by the function itself where the spline is off by more than
`FIT_TOLERANCE`. Non-guarantee: a function with jumps is refused, unless they are too small to see.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ilattice._field import Field
from ilattice._geometry import grid_points
from ilattice._shown import Shown
from ilattice._typing import AnyArray, ArrayLike, FloatArray
from ilattice._validate import as_array, as_kind, as_points, asked
from ilattice.bspline import BSpline
from ilattice.bspline.fit import fit
from ilattice.bspline.knots import uniform_knots
from ilattice.errors import ConvergenceError, InputError, PrecisionWarning
from ilattice.fields.equation import constant, coordinates_in, equation, names_in
from ilattice.fields.node import Node
from ilattice.offsets.kinks import JumpError, fit_evenly, fit_with_kinks
from ilattice.offsets.scattered import Scattered
from ilattice.tiles.mixture import Mixture

if TYPE_CHECKING:
    from ilattice.macroshape.maps import SplineMap
    from ilattice.macroshape.tiling import Tiling

#: Largest error of a fitted half-thickness, relative to its largest value.
FIT_TOLERANCE = 1e-5
#: Errors relative to the half-thickness that are told, and refused.
WARN, REFUSE = 1e-3, 0.05
#: Coordinates of equations.
PARAMETERS, SPACE = ("u", "v", "w"), ("x", "y", "z")
MIXED = "mixes u, v, w, the parameters, with x, y, z, the place in space; use one kind"
#: Places per direction at which the extremes of a spline are sampled; chosen without measurements.
SAMPLES = 33
#: Half-thickness on a side that is filled altogether.
FULL = 1e30


@dataclass(frozen=True, eq=False)
class Thickness(Shown):
    """Half-thickness on the two sides of the mid-surface.

    Attributes
    ----------
    inner, outer : BSpline
        Scalar trivariate splines over the domain: the extent on the side where the implicit
        function is negative, and positive.
    asked : pair of callable or None
        Functions of the parameters that the splines stand for; None where a spline was asked.
    deviation : float
        Largest deviation of a spline from its function that was found, relative to the value
        there, or to a hundredth of the largest value.
    """

    inner: BSpline
    outer: BSpline
    asked: tuple[Any, Any] = (None, None)
    deviation: float = 0.0

    def side(self, sign: float) -> Any:
        """What vertices of one side are moved by: the spline, or the function that it stands for.

        Parameters
        ----------
        sign : float
            Positive for the outer side.

        Returns
        -------
        BSpline or AskedSide
            With ``jet`` and ``c``.
        """
        spline, f = (self.outer, self.asked[1]) if sign > 0 else (self.inner, self.asked[0])
        exact = f is None or self.deviation <= FIT_TOLERANCE
        return spline if exact else AskedSide(spline, f)

    def at(self, u: FloatArray, sign: AnyArray) -> FloatArray:
        """Asked half-thickness (n,) at parameters (n, 3) on sides of the given signs."""
        values = [
            spline(u) if f is None else np.asarray(f(u), np.float64)
            for spline, f in zip((self.inner, self.outer), self.asked, strict=True)
        ]
        return np.where(sign > 0, values[1], values[0])

    def clearance(self, u: FloatArray, side: AnyArray, distance: FloatArray) -> FloatArray:
        """How far places are beyond the offset surface on a side: distance less half-thickness.

        Parameters
        ----------
        u : ndarray, shape (n, 3)
            Parameters of the places.
        side : ndarray, shape (n,)
            1 for the outer surface, -1 for the inner one.
        distance : ndarray, shape (n,)
            Signed distances there to the mid-surface.

        Returns
        -------
        ndarray, shape (n,)
            Negative within the wall.
        """
        out: FloatArray = side * distance - self.at(u, side)
        return out

    def scaled(self, factor: float) -> Thickness:
        """The same times a factor; the inner side of a solid stays full.

        Parameters
        ----------
        factor : float
            The factor.

        Returns
        -------
        Thickness
            The scaled one.
        """

        def times(f: Any) -> Any:
            return None if f is None else lambda u: factor * np.asarray(f(u), np.float64)

        outer, inner = (
            BSpline(s.t, s.c * factor, s.k, periodic=s.periodic, weights=s.weights)
            for s in (self.outer, self.inner)
        )
        asked = (times(self.asked[0]), times(self.asked[1]))
        if self.symmetric:
            return Thickness(outer, outer, asked, self.deviation)
        return Thickness(self.inner if self.solid else inner, outer, asked, self.deviation)

    @property
    def symmetric(self) -> bool:
        """Whether both sides are one and the same."""
        return self.inner is self.outer

    @property
    def solid(self) -> bool:
        """Whether all of the inner side is filled: the solid of the tile, grown by `outer`."""
        return self.inner.c.size == 1 and float(self.inner.c.item()) >= FULL

    @property
    def unchanged(self) -> bool:
        """Whether it is the solid of the tile, neither grown nor eroded."""
        return self.solid and self.outer.c.size == 1 and float(self.outer.c.item()) == 0.0

    @property
    def constant(self) -> bool:
        """Whether neither side varies."""
        return self.inner.c.size == 1 and self.outer.c.size == 1

    @property
    def extremes(self) -> tuple[float, float]:
        """Least and largest total thickness, up to the sampling; of a solid, of its outer side."""
        total = _samples(self.outer)
        if not self.solid:
            total = total + _samples(self.inner)
        return float(total.min()), float(total.max())


@dataclass(frozen=True, eq=False)
class AskedSide(Field):
    """A function of the parameters with the slopes of the spline that stands for it.

    Attributes
    ----------
    spline : BSpline
        The spline.
    f : callable
        Takes parameters (n, 3), returns values (n,).
    """

    spline: BSpline
    f: Any

    @property
    def c(self) -> FloatArray:
        """Coefficients of the spline."""
        return self.spline.c

    def __call__(self, u: ArrayLike, /) -> FloatArray:
        """Values of the function."""
        return np.asarray(self.f(as_points("u", u)), np.float64)

    def jet(self, u: ArrayLike, order: int = 1) -> tuple[FloatArray, ...]:
        """Values of the function, derivatives of the spline."""
        return (self(u), *self.spline.jet(u, order)[1:])


def as_thickness(d: Any, lattice: Tiling, size: float | None = None) -> Thickness:
    """Thickness from a number, function, equation, spline, name, or a pair (inner, outer) of these.

    Parameters
    ----------
    d : float, callable, Node, BSpline, str, or pair of these
        Half-thickness in units of length; a callable takes parameters (n, 3) and returns (n,); a
        field of `ilattice.fields` is a function of space, unless it is an equation in u, v, w; a
        text is the name of a property of the lattice, or an equation in u, v, w or in x, y, z; an
        inner one of infinity fills that side.
    lattice : Lattice
        Gives the domain, the map and the properties.
    size : float, optional
        Diameter of the part in the units of `d`; by default that of the box around it.

    Returns
    -------
    Thickness
        Both sides.

    Raises
    ------
    InputError
        If `d` is not positive somewhere, not finite, larger than the part, of an unknown form,
        not continuous, or varies so fast that a spline is off by more than 5 %.

    Warns
    -----
    PrecisionWarning
        If a spline is off by more than 0.1 %.
    """
    as_kind("lattice", lattice, "Tiling")
    if size is None:
        size = float(np.linalg.norm(np.diff(lattice.through.bounds, axis=0)))
    if isinstance(d, tuple | list):
        if len(d) != 2:
            raise InputError(
                f"d must be one half-thickness or a pair (inner, outer), got {d!r:.80}"
            )
        if np.ndim(d[0]) == 0 and isinstance(d[0], float | np.floating) and d[0] == np.inf:
            return _solid(_as_side(d[1], lattice, "d[1]"), lattice, size)
        inner, outer = (_as_side(v, lattice, f"d[{i}]") for i, v in enumerate(d))
        _check(inner.spline, size, "d[0]", least=0.0)
        _check(outer.spline, size, "d[1]", least=0.0)
        if not (_samples(inner.spline) + _samples(outer.spline)).min() > 0:
            raise InputError(f"d must leave a wall: both sides vanish somewhere, got {d!r:.80}")
        worst = max(inner.deviation, outer.deviation)
        return Thickness(inner.spline, outer.spline, (inner.asked, outer.asked), worst)
    s = _as_side(d, lattice, "d")
    _check(s.spline, size, "d", least=1e-300)
    return Thickness(s.spline, s.spline, (s.asked, s.asked), s.deviation)


@dataclass(frozen=True)
class _Side:
    """A spline, the function that it stands for, and how far it is off."""

    spline: BSpline
    asked: Any = None
    deviation: float = 0.0


def _solid(outer: _Side, lattice: Tiling, size: float) -> Thickness:
    """The inner side filled; the outer one may be negative, which makes the solid smaller."""
    _check(outer.spline, size, "d[1]", least=-np.inf)
    knots = [lattice.domain[:, a] for a in range(3)]
    full = BSpline(knots, np.full((1, 1, 1), FULL), 0)
    return Thickness(full, outer.spline, (None, outer.asked), outer.deviation)


def _as_side(d: Any, lattice: Tiling, name: str) -> _Side:
    domain = lattice.domain
    if isinstance(d, BSpline):
        if d.ndim != 3 or d.m or not np.allclose(d.domain, domain):
            raise InputError(
                f"{name} must be a scalar trivariate spline over the domain {domain.tolist()}, "
                f"got {d!r} over {d.domain.tolist()}"
            )
        return _Side(d)
    if isinstance(d, str):
        return _named(d, lattice, name)
    if isinstance(d, Node):
        return _fitted(of_parameters(d, lattice.through, name), lattice, name)
    if callable(d):
        return _fitted(d, lattice, name)
    value = as_array(name, d)
    if value.size != 1:
        raise InputError(f"{name} must be a number, callable, spline or name, got {d!r:.80}")
    return _constant(float(value.item()), lattice)


def _constant(value: float, lattice: Tiling) -> _Side:
    knots = [lattice.domain[:, a] for a in range(3)]
    return _Side(BSpline(knots, np.full((1, 1, 1), value), 0))


def _named(name: str, lattice: Tiling, argument: str) -> _Side:
    """Side that a text asks for: a property, or an equation."""
    through = lattice.through
    if name in lattice.tile.properties:
        if isinstance(lattice.tile, Mixture):
            return _fitted(lambda u: lattice.property_at(name, u), lattice, argument)
        return _repeated(name, lattice, argument)
    if name not in through.names:
        known = ", ".join(lattice.property_names) or "none"
        try:
            field = as_equation(name)
        except InputError as e:
            why = "" if name.isidentifier() else f"it is no equation ({e}), and "
            raise InputError(
                f"{argument} is {name!r}, but {why}the lattice has no property of that name; it "
                f"has: {known}"
            ) from e
        if isinstance(field, float):
            return _constant(field, lattice)
        return _fitted(of_parameters(field, lattice.through, argument), lattice, argument)
    s = through.spline
    c = s.c[..., 3 + list(through.names).index(name)]
    if s.weights is None:
        return _Side(BSpline(s.t, c, s.k, periodic=s.periodic))
    rational = BSpline(s.t, c, s.k, periodic=s.periodic, weights=s.weights)
    return _fitted(rational, lattice, argument)


def as_equation(text: str) -> float | Node:
    """A number or a field from a text.

    Parameters
    ----------
    text : str
        Equation in the parameters u, v, w, or in x, y, z of space; see `ilattice.fields.equation`.

    Returns
    -------
    float or Node
        A number where it mentions no coordinate.

    Raises
    ------
    InputError
        For any other text, and for both kinds of coordinates in one.
    """
    names = names_in(text)
    kinds = [k for k in (PARAMETERS, SPACE) if names & set(k)]
    if len(kinds) > 1:
        raise InputError(f"{text!r:.80} {MIXED}")
    if not kinds:
        return constant(text)
    return equation(text, variables=kinds[0])


def of_parameters(field: Node, through: SplineMap | None, name: str) -> Any:
    """A field as a function of the parameters.

    Parameters
    ----------
    field : Node
        Of x, y, z, or an equation in u, v, w.
    through : SplineMap or None
        From parameters to space; without one they are the same.
    name : str
        What it is called in messages.

    Returns
    -------
    callable
        Takes parameters (n, 3), returns values (n,); the field itself where it is one of them.

    Raises
    ------
    InputError
        If it has other coordinates, or both kinds.
    """
    names = coordinates_in(field)
    if names <= set(SPACE):
        return field if through is None else lambda u: field(through.x(u))
    if names <= set(PARAMETERS):
        return field
    if names <= {*PARAMETERS, *SPACE}:
        raise InputError(f"{name}: {field!r:.80} {MIXED}")
    raise InputError(
        f"{name}: {field!r:.80} is an equation in {', '.join(sorted(names))}; take one "
        "in the parameters u, v, w, or in x, y, z of space"
    )


def _repeated(name: str, lattice: Tiling, argument: str) -> _Side:
    """Spline of a tile's property over the whole domain, fitted on one tile."""
    prop = lattice.tile.properties[name]
    cube = _evaluate(prop, _grid_points(np.array([[0.0] * 3, [1.0] * 3]), 9), argument)
    try:
        one = fit(
            lambda u: _evaluate(prop, u, argument), degree=2, method="interpolate", periodic=True,
            tol=FIT_TOLERANCE * max(float(np.abs(cube).max()), 1e-300),
        )  # fmt: skip
    except ConvergenceError:  # kinks, or tiles that do not fit together
        return _fitted(lambda u: lattice.property_at(name, u), lattice, argument)
    c, knots = one.c, []
    for a, count in enumerate(lattice.repeat):
        spans = one.shape[a] - 2
        c = c.take(np.arange(count * spans + 2) % spans, axis=a)
        domain = tuple(lattice.domain[:, a])
        knots.append(uniform_knots(count * spans, 2, domain, periodic=True))
    return _Side(BSpline(knots, c, 2, periodic=lattice.through.wraps))


def _fitted(f: Any, lattice: Tiling, name: str) -> _Side:
    def checked(u: FloatArray) -> FloatArray:
        return _evaluate(f, u, name)

    values = checked(_grid_points(lattice.domain, 9))
    scale = max(float(np.abs(values).max()), 1e-300)
    try:
        tol = f.tolerance if isinstance(f, Scattered) else FIT_TOLERANCE
        fit = fit_evenly if tol > FIT_TOLERANCE else fit_with_kinks
        spline, found = fit(checked, lattice.domain, tol * scale)
    except JumpError as e:
        raise InputError(
            f"{name} jumps {e}; make it continuous, by a ramp as in "
            "np.interp(u[:, 0], [0.49, 0.51], [d1, d2])"
        ) from e
    if spline.c.min() < 0.0 <= values.min():  # between samples, by less than the fit is off
        spline = BSpline(spline.t, np.maximum(spline.c, 0.0), spline.k)
    where = f"at u = {np.round(found.u, 4).tolist()}"
    if found.relative > REFUSE:
        raise InputError(
            f"{name} jumps or varies too fast for a spline, which is off by {found.relative:.2g} "
            f"of it {where}; "
            + (
                "make it continuous, smooth it, or align its kinks with u, v and w"
                if tol == FIT_TOLERANCE
                else "smooth the values: near points differ by more than walls can follow"
            )
        )
    if found.relative > WARN:
        users = "quadrature and analysis go by it, polished meshes and slices by the function"
        warnings.warn(
            f"the spline that stands for {name} is off by {100 * found.relative:.2g} % of it "
            f"{where}; {users if tol == FIT_TOLERANCE else 'all go by it'}",
            PrecisionWarning,
            stacklevel=6,
        )
    return _Side(spline, None if tol > FIT_TOLERANCE else checked, found.relative)


def _evaluate(f: Any, u: FloatArray, name: str) -> FloatArray:
    value = as_array(name, asked(name, f, u), finite=False)
    if value.shape != (len(u),):
        raise InputError(
            f"{name} must return one value per point, shape ({len(u)},), got {value.shape}"
        )
    bad = ~np.isfinite(value)
    if bad.any():
        i = int(np.argmax(bad))
        raise InputError(f"{name} must be finite, but is {value[i]} at {u[i].tolist()}")
    return value


def _check(s: BSpline, size: float, name: str, *, least: float) -> None:
    value = _samples(s)
    low, high = float(value.min()), float(value.max())
    if low < least:
        raise InputError(f"{name} must be positive, but reaches {low:g}")
    if high >= 0.5 * size:
        raise InputError(
            f"{name} reaches {high:g}, which is not smaller than half the part ({0.5 * size:g})"
        )


def _grid_points(domain: FloatArray, n: int) -> FloatArray:
    axes = [np.linspace(domain[0, a], domain[1, a], n) for a in range(3)]
    return grid_points(*axes)


def _samples(s: BSpline) -> FloatArray:
    return s(_grid_points(s.domain, SAMPLES if s.c.size > 1 else 1), extrapolate="clamp")
