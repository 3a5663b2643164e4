"""Material that may vary from point to point.

A property is a number, a function of points of space, or the name of a property of the lattice:
an extra coordinate of its map, or a property of its tile; of solids of two phases a pair of these,
or one for both.

Guarantee: every value is checked where it is used; what is negative, zero where it must not be,
or not finite ends in an error that tells where.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ilattice._typing import FloatArray
from ilattice._validate import as_array, asked, check_finite, read_only
from ilattice.cutfem.assembly import Assembly
from ilattice.cutfem.sampling import DRAWN, WATCHED, full, layers
from ilattice.errors import InputError, PrecisionWarning
from ilattice.macroshape.maps import SplineMap
from ilattice.macroshape.tiling import Tiling
from ilattice.quadrature.rules import Quadrature

if TYPE_CHECKING:
    from ilattice.cutfem.anisotropic import Material

#: Factor by which a stiffness may jump within a cell without a warning; cells that are searched,
#: steps of the search, and the part of the range that one of them takes where there is a jump.
STEEP, SEARCHED, STEPS, ABRUPT = 1.2, 20, 16, 0.4
#: Root mean square of what is left of a linear course, over the mean, that splines do not follow.
WAVY = 0.15
#: Factor and part lost of a stiffness that neither jumps nor waves within cells.
CALM = read_only(np.array([1.0, 0.0]))

Single = float | str | Callable[[FloatArray], Any]
Property = Single | tuple[Single, Single]


@dataclass(frozen=True, eq=False)
class OfParameters:
    """A property as a function of parameters (n, 3), not of points of space.

    Attributes
    ----------
    function : callable
        Returns values (n,).
    """

    function: Callable[[FloatArray], FloatArray]

    def __call__(self, u: FloatArray, /) -> FloatArray:
        """Values (n,) at parameters (n, 3)."""
        return self.function(u)


@dataclass(frozen=True, eq=False)
class MapProperties:
    """Extra coordinates of a map as properties of a solid that is no wall.

    Attributes
    ----------
    through : SplineMap
        The map.
    """

    through: SplineMap

    @property
    def domain(self) -> FloatArray:
        """Of the map."""
        return self.through.domain

    def property_at(self, name: str, u: FloatArray) -> FloatArray:
        """Value (n,) of an extra coordinate at parameters (n, 3), as `Lattice.property_at`."""
        if name not in self.through.names:
            known = ", ".join(self.through.names)
            raise InputError(f"the map has no extra coordinate {name!r}; it has: {known}")
        return self.through.extra(u)[:, self.through.names.index(name)]


@dataclass(frozen=True, eq=False)
class Scalar:
    """One property of a material.

    Attributes
    ----------
    name : str
        What it is called in messages.
    value : float, str, callable, or pair of these
        The property; of both phases.
    low, high : float
        Values must lie strictly between; with `closed`, low itself is allowed.
    lattice : Lattice, MapProperties or None
        Where named properties come from.
    phased : bool
        Whether there are two phases, so that the value may be a pair.
    """

    name: str
    value: Property
    low: float = 0.0
    high: float = np.inf
    closed: bool = False
    lattice: "Tiling | MapProperties | None" = None
    phased: bool = False

    def __post_init__(self) -> None:
        if self.paired:
            if not self.phased or len(self.value) != 2:  # type: ignore[arg-type]
                raise InputError(
                    f"{self.name} must be one property, or a pair of them with phases=, got "
                    f"{self.value!r:.80}"
                )
            _ = self.phases
        elif isinstance(self.value, str):
            if self.lattice is None:
                raise InputError(
                    f"{self.name}={self.value!r}: only walls, and maps with extra "
                    "coordinates, have named properties"
                )
            middle = self.lattice.domain.mean(axis=0, keepdims=True)
            self.lattice.property_at(self.value, middle)
        elif not callable(self.value):
            value = as_array(self.name, self.value)
            if value.size != 1:
                raise InputError(
                    f"{self.name} must be a number, a function of points (n, 3) or the name of a "
                    f"property, got shape {value.shape}"
                )
            self._check(value.ravel())

    @property
    def paired(self) -> bool:
        """Whether each phase has its own."""
        return isinstance(self.value, tuple | list)

    @property
    def phases(self) -> "tuple[Scalar, Scalar]":
        """The property of the first and of the second phase."""
        if not self.paired:
            return self, self
        first, second = self.value  # type: ignore[misc,str-unpack]
        return replace(self, value=first, phased=False), replace(self, value=second, phased=False)

    @property
    def constant(self) -> bool:
        """Whether it is one number."""
        return not (isinstance(self.value, str) or callable(self.value) or self.paired)

    def at(self, asm: Assembly, u: FloatArray) -> FloatArray:
        """Values at parameters, of what is no pair.

        Of a pair those of the phase of the element count, see `Domain.by_phase`: a point of a rule
        may seem to be on the other side of the surface between phases, by rounding.

        Parameters
        ----------
        asm : Assembly
            Knows the map.
        u : ndarray, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n,), or (1,) for a constant
            Values.

        Raises
        ------
        InputError
            If a value is out of range, or there is not one per point.
        """
        assert not self.paired
        if isinstance(self.value, str):
            assert self.lattice is not None
            return self._check(self.lattice.property_at(self.value, u))
        if not callable(self.value):
            return np.array([float(np.ravel(self.value)[0])])  # type: ignore[arg-type]
        places = u if isinstance(self.value, OfParameters) else asm.x(u)
        value = as_array(self.name, asked(self.name, self.value, places), finite=False)
        if value.shape != (len(u),):
            raise InputError(
                f"{self.name} must give one value per point, shape ({len(u)},), got {value.shape}"
            )
        return self._check(check_finite(self.name, value))

    def _check(self, value: FloatArray) -> FloatArray:
        good = (value >= self.low) if self.closed else (value > self.low)
        good &= value < self.high
        if not good.all():
            sign = "not less than" if self.closed else "above"
            limit = "" if self.high == np.inf else f" and below {self.high:g}"
            raise InputError(
                f"{self.name} must be {sign} {self.low:g}{limit}, got {value[~good][0]:g}"
            )
        return value


def jump_within_cells(
    rule: Quadrature, values: FloatArray, at: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    """By how much positive values jump or wave within a cell: a factor, and a part that is lost.

    `values` (n,) are those at the points of the rule, `at` gives them at any parameters: the cells
    in which they vary most are searched between the points of the least and the largest one. The
    part is that by which the harmonic mean in a cell is below the one that the rule sees, and so do
    splines that cannot bend there: about what an energy may be off by. `CALM` where none is seen.
    """
    if len(values) < len(rule) or not len(rule):
        return CALM
    return np.maximum(_jump(rule, values, at), _wave(rule, values, at))


def _wave(
    rule: Quadrature, values: FloatArray, at: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    """Largest of both in full cells in which values, or their inverses, are far from linear.

    Points of rules may all lie where a wave is high, or beside a thin soft layer; these do not.
    """
    whole = full(rule)
    if not len(whole):
        return CALM
    some = whole[np.unique(np.linspace(0, len(whole) - 1, WATCHED // 4).astype(int))]
    box = rule.grid.boxes(rule.cells[some])
    t = layers(DRAWN)
    u = box[:, None, :3] + t * box[:, None, 3:]
    found = np.broadcast_to(at(u.reshape(-1, 3)), len(some) * DRAWN).reshape(len(some), DRAWN)
    linear = np.column_stack([np.ones(DRAWN), t])
    off = np.zeros(len(some))
    for v in (found, 1.0 / found):  # stiffness counts across layers, compliance along
        left = v - v @ np.linalg.pinv(linear).T @ linear.T
        off = np.maximum(off, np.sqrt((left**2).mean(axis=1)) / v.mean(axis=1))
    factor = found.max(axis=1) / found.min(axis=1)
    wavy = off > WAVY
    if not wavy.any():
        return CALM
    seen = (rule.integrate_cells(values) / rule.integrate_cells())[some[wavy]]
    one, all_of_them = _lost(found[wavy], seen), _lost(found[wavy].reshape(1, -1), seen.mean())
    return np.array([factor[wavy].max(), max(one, all_of_them)])  # cells may take turns


def _lost(values: FloatArray, seen: Any) -> float:
    """Largest relative distance of the means that rules see from those of rows of values."""
    arithmetic, harmonic = values.mean(axis=1), 1.0 / (1.0 / values).mean(axis=1)
    return float(np.maximum(arithmetic / seen - 1.0, 1.0 - harmonic / seen).max())


def _jump(
    rule: Quadrature, values: FloatArray, at: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    """See `jump_within_cells`."""
    starts = rule.offsets[:-1][np.diff(rule.offsets) > 0]
    ratio = np.maximum.reduceat(values, starts) / np.minimum.reduceat(values, starts)
    worst = np.argsort(-ratio, kind="stable")[:SEARCHED]
    worst = worst[ratio[worst] > STEEP]
    if not len(worst):
        return CALM
    u, ends = rule.points, np.append(starts, len(rule))
    pairs = [
        (b + values[b:e].argmin(), b + values[b:e].argmax())
        for b, e in zip(ends[worst], ends[worst + 1], strict=True)
    ]
    low, high = np.array(pairs).T
    t = np.linspace(0.0, 1.0, STEPS + 1)[:, None]
    line = u[low][:, None] + t * (u[high] - u[low])[:, None]
    found = at(line.reshape(-1, 3)).reshape(len(worst), STEPS + 1)
    steps = np.abs(np.diff(found, axis=1)).max(axis=1)
    jumps = steps > ABRUPT * np.ptp(found, axis=1)
    w, starts = rule.weights, starts.astype(np.int64)
    means = [np.add.reduceat(w * v, starts) for v in (values, 1.0 / values)]
    lost = 1.0 - np.add.reduceat(w, starts) ** 2 / (means[0] * means[1])
    return np.array([ratio[worst][jumps].max(initial=1.0), lost[worst][jumps].max(initial=0.0)])


def warn_of_jump(name: str, jump: FloatArray) -> None:
    """Warn of a material that jumps within cells, see `jump_within_cells`."""
    factor = float(jump[0])
    if factor > STEEP:
        warnings.warn(
            f"{name} jumps or waves by a factor of {factor:.3g} within a cell, where splines "
            "cannot bend; divide the solid by phases= where it jumps, and give a pair, or let it "
            "change over several cells",
            PrecisionWarning,
            stacklevel=5,
        )


@dataclass(frozen=True, eq=False)
class Isotropic:
    """Isotropic linear elastic material.

    Attributes
    ----------
    young, poisson, density, expansion : Scalar
        Young's modulus, Poisson's ratio, mass per volume, thermal expansion per degree.
    strength : Scalar or None
        Von Mises stress at which the material yields.
    """

    full: ClassVar[bool] = False
    young: Scalar
    poisson: Scalar
    density: Scalar
    expansion: Scalar
    strength: Scalar | None = None

    @property
    def phases(self) -> "tuple[Material, Material]":
        """The material of the first and of the second phase."""
        scalars = [getattr(self, f.name) for f in fields(self)]
        first, second = ([s and s.phases[k] for s in scalars] for k in (0, 1))
        return Isotropic(*first), Isotropic(*second)

    @property
    def constant(self) -> bool:
        """Whether the stiffness is the same everywhere."""
        return self.young.constant and self.poisson.constant

    def lame(self, asm: Assembly, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Lamé constants at parameters.

        Parameters
        ----------
        asm : Assembly
            Knows the map.
        u : ndarray, shape (n, 3)
            Parameters.

        Returns
        -------
        tuple of ndarray, shape (n,) or (1,)
            λ and μ.
        """
        E, nu = self.young.at(asm, u), self.poisson.at(asm, u)
        return E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
