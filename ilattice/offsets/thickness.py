"""Half-thickness in all the forms a user gives it, as splines over the parameter domain.

Guarantee: the splines are finite, not negative, and smaller than the part. Non-guarantee: a
callable with jumps cannot be fitted and is refused.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice._validate import as_array
from ilattice.bspline import BSpline
from ilattice.bspline.knots import uniform_knots
from ilattice.errors import ConvergenceError, InputError
from ilattice.tiles.mixture import Mixture

if TYPE_CHECKING:
    from ilattice.macroshape.lattice import Lattice

#: Largest error of a fitted half-thickness, relative to its largest value.
FIT_TOLERANCE = 1e-5
SAMPLES = 33
#: Half-thickness on a side that is filled altogether.
FULL = 1e30


@dataclass(frozen=True, eq=False)
class Thickness:
    """Half-thickness on the two sides of the mid-surface.

    Attributes
    ----------
    inner, outer : BSpline
        Scalar trivariate splines over the domain: the extent on the side where the implicit
        function is negative, and positive.
    """

    inner: BSpline
    outer: BSpline

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


def as_thickness(d: Any, lattice: Lattice, size: float | None = None) -> Thickness:
    """Thickness from a number, callable, spline, name, or a pair (inner, outer) of these.

    Parameters
    ----------
    d : float, callable, BSpline, str, or pair of these
        Half-thickness in units of length; a callable takes parameters (n, 3) and returns (n,);
        a name is that of a property of the lattice; an inner one of infinity fills that side.
    lattice : Lattice
        Gives the domain and the properties.
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
        or cannot be fitted.
    """
    if size is None:
        size = float(np.linalg.norm(np.diff(lattice.through.bounds, axis=0)))
    if isinstance(d, tuple | list):
        if len(d) != 2:
            raise InputError(
                f"d must be one half-thickness or a pair (inner, outer), got {d!r:.80}"
            )
        if np.ndim(d[0]) == 0 and isinstance(d[0], float | np.floating) and d[0] == np.inf:
            return _solid(_as_spline(d[1], lattice, "d[1]"), lattice, size)
        sides = [_as_spline(v, lattice, f"d[{i}]") for i, v in enumerate(d)]
        for i, s in enumerate(sides):
            _check(s, size, f"d[{i}]", least=0.0)
        if not (_samples(sides[0]) + _samples(sides[1])).min() > 0:
            raise InputError(f"d must leave a wall: both sides vanish somewhere, got {d!r:.80}")
        return Thickness(*sides)
    s = _as_spline(d, lattice, "d")
    _check(s, size, "d", least=1e-300)
    return Thickness(s, s)


def _solid(outer: BSpline, lattice: Lattice, size: float) -> Thickness:
    """The inner side filled; the outer one may be negative, which makes the solid smaller."""
    _check(outer, size, "d[1]", least=-np.inf)
    knots = [lattice.domain[:, a] for a in range(3)]
    return Thickness(BSpline(knots, np.full((1, 1, 1), FULL), 0), outer)


def _as_spline(d: Any, lattice: Lattice, name: str) -> BSpline:
    domain = lattice.domain
    if isinstance(d, BSpline):
        if d.ndim != 3 or d.m or not np.allclose(d.domain, domain):
            raise InputError(
                f"{name} must be a scalar trivariate spline over the domain {domain.tolist()}, "
                f"got {d!r} over {d.domain.tolist()}"
            )
        return d
    if isinstance(d, str):
        return _named(d, lattice, name)
    if callable(d):
        return _fitted(d, lattice, name)
    value = as_array(name, d)
    if value.size != 1:
        raise InputError(f"{name} must be a number, callable, spline or name, got {d!r:.80}")
    return BSpline([domain[:, a] for a in range(3)], value.reshape(1, 1, 1), 0)


def _named(name: str, lattice: Lattice, argument: str) -> BSpline:
    through = lattice.through
    if name in lattice.tile.properties:
        if isinstance(lattice.tile, Mixture):
            return _fitted(lambda u: lattice.property_at(name, u), lattice, argument)
        return _repeated(name, lattice, argument)
    if name not in through.names:
        known = ", ".join(lattice.property_names) or "none"
        raise InputError(
            f"{argument} is {name!r}, but the lattice has no property of that name; it has: {known}"
        )
    s = through.spline
    c = s.c[..., 3 + list(through.names).index(name)]
    if s.weights is None:
        return BSpline(s.t, c, s.k, periodic=s.periodic)
    rational = BSpline(s.t, c, s.k, periodic=s.periodic, weights=s.weights)
    return _fitted(rational, lattice, argument)


def _repeated(name: str, lattice: Lattice, argument: str) -> BSpline:
    """Spline of a tile's property over the whole domain, fitted on one tile."""
    from ilattice.bspline.fit import fit

    prop = lattice.tile.properties[name]
    cube = _evaluate(prop, _grid_points(np.array([[0.0] * 3, [1.0] * 3]), 9), argument)
    try:
        one = fit(
            prop, degree=2, method="interpolate", periodic=True,
            tol=FIT_TOLERANCE * max(float(np.abs(cube).max()), 1e-300),
        )  # fmt: skip
    except ConvergenceError as e:
        raise InputError(
            f"{argument} is property {name!r} of the tile, which is no smooth periodic function "
            f"on the tile: {e}"
        ) from e
    c, knots = one.c, []
    for a, count in enumerate(lattice.repeat):
        spans = one.shape[a] - 2
        c = c.take(np.arange(count * spans + 2) % spans, axis=a)
        domain = tuple(lattice.domain[:, a])
        knots.append(uniform_knots(count * spans, 2, domain, periodic=True))
    return BSpline(knots, c, 2, periodic=lattice.through.closed)


def _fitted(f: Any, lattice: Lattice, name: str) -> BSpline:
    from ilattice.bspline.fit import fit

    scale = np.abs(_evaluate(f, _grid_points(lattice.domain, 9), name)).max()
    try:
        return fit(
            f, domain=lattice.domain, degree=2, spans=8, method="interpolate",
            tol=FIT_TOLERANCE * max(scale, 1e-300),
        )  # fmt: skip
    except ConvergenceError as e:
        raise InputError(f"{name} varies too roughly for a spline: {e}; smooth it") from e


def _evaluate(f: Any, u: FloatArray, name: str) -> FloatArray:
    value = as_array(name, f(u), finite=False)
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
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _samples(s: BSpline) -> FloatArray:
    return s(_grid_points(s.domain, SAMPLES if s.c.size > 1 else 1), extrapolate="clamp")
