"""Material that may vary from point to point.

A property is a number, a function of points of space, or the name of a property of the lattice:
an extra coordinate of its map, or a property of its tile; of solids of two phases a pair of these,
or one for both.

Guarantee: every value is checked where it is used; what is negative, zero where it must not be,
or not finite ends in an error that tells where.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Self

import numpy as np

from ilattice._shown import Shown
from ilattice._typing import FloatArray, NamedProperties
from ilattice._validate import as_array, asked, check_finite
from ilattice.cutfem import _kernels_assembly as kernels
from ilattice.cutfem import _voigt
from ilattice.cutfem.assembly import Assembly
from ilattice.cutfem.domain import Domain
from ilattice.cutfem.jumps import CALM
from ilattice.cutfem.law import Law
from ilattice.errors import InputError
from ilattice.macroshape.maps import SplineMap
from ilattice.quadrature.rules import Quadrature, some_cells

Single = float | str | Callable[[FloatArray], Any]
Property = Single | tuple[Single, Single]
#: Points at which full matrices are held at a time.
AT_ONCE = 8192


def named_properties(domain: Domain) -> NamedProperties | None:
    """Where properties of a solid come from by name: itself, or extra coordinates of its map."""
    through = domain.cut.through
    if domain.named is None and through is not None and through.names:
        return MapProperties(through)
    return domain.named


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
    """Extra coordinates of a map as properties of a solid that has none of its own.

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


class PerPhase(Shown):
    """What is one for all of a solid, or a pair, one for each of two phases: a dataclass."""

    value: Any
    phased: bool

    @property
    def paired(self) -> bool:
        """Whether each phase has its own."""
        return isinstance(self.value, tuple | list)

    @property
    def phases(self) -> tuple[Self, Self]:
        """What the first and what the second phase has."""
        if not self.paired:
            return self, self
        first, second = (replace(self, value=v, phased=False) for v in self.value)  # type: ignore[type-var]
        return first, second


@dataclass(frozen=True, eq=False)
class Scalar(PerPhase):
    """One property of a material.

    Attributes
    ----------
    name : str
        What it is called in messages.
    value : float, str, callable, or pair of these
        The property; of both phases.
    low, high : float
        Values must lie strictly between; with `closed`, low itself is allowed.
    lattice : NamedProperties or None
        Where named properties come from.
    phased : bool
        Whether there are two phases, so that the value may be a pair.
    """

    name: str
    value: Property
    low: float = 0.0
    high: float = np.inf
    closed: bool = False
    lattice: NamedProperties | None = None
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
                    f"{self.name}={self.value!r}: only walls, other solids with "
                    "`named_properties`, and maps with extra coordinates have some"
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
        points = u if isinstance(self.value, OfParameters) else asm.x(u)
        value = as_array(self.name, asked(self.name, self.value, points), finite=False)
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


class Elastic(Law):
    """Linear elastic materials: three components of displacement, six of stress.

    A class is a dataclass of its properties, and defines `matrices`, and what it knows better than
    the defaults. Stresses are in Voigt's order, see `_voigt`.
    """

    m: ClassVar[int] = 3
    entries: ClassVar[int] = 6
    #: Whether the stiffness is any, so that its change of volume is not apart; see `add_shape`.
    full: ClassVar[bool] = True
    density: Scalar
    expansion: Scalar
    strength: Scalar | None

    @property
    def phases(self) -> tuple[Self, Self]:
        """The material of the first and of the second phase."""
        parts = self._properties.values()
        first, second = ([s and s.phases[k] for s in parts] for k in (0, 1))
        return type(self)(*first), type(self)(*second)

    @property
    def told(self) -> dict[str, Any]:
        """See `Law.told`."""
        return {name: one.value for name, one in self._properties.items() if one is not None}

    @property
    def _properties(self) -> dict[str, Any]:
        """What it is made of, by name."""
        return {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]

    def matrices(self, asm: Assembly, u: FloatArray) -> FloatArray:
        """Stiffness (n, 6, 6) or (1, 6, 6) at parameters (n, 3)."""
        raise NotImplementedError

    def lame(self, asm: Assembly, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Lamé constants (n,) or (1,) of the nearest isotropic stiffness: scales of penalties."""
        if self.constant:
            K, G = _voigt.bulk_and_shear(self.matrices(asm, u))
        else:
            parts = [u[i : i + AT_ONCE] for i in range(0, max(len(u), 1), AT_ONCE)]
            moduli = [np.stack(_voigt.bulk_and_shear(self.matrices(asm, p))) for p in parts]
            K, G = np.concatenate(moduli, axis=1)
        return K - 2.0 * G / 3.0, G

    def ratio(self, asm: Assembly, u: FloatArray) -> FloatArray:
        """Poisson's ratio (n,) or (1,), that of the nearest isotropic stiffness."""
        lam, mu = self.lame(asm, u)
        return np.asarray(0.5 * lam / (lam + mu))

    def hindered(self, asm: Assembly, u: FloatArray) -> FloatArray:
        """Stress (n, 6) or (1, 6) of a unit strain in all directions."""
        return self.matrices(asm, u) @ _voigt.UNIT

    def units(self, asm: Assembly, u: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Stiffnesses (6, 6), and factors (n,) or (1,) by which `matrices` is their sum."""
        C = self.matrices(asm, u)
        for i in range(6):
            for j in range(i, 6):
                unit = np.zeros((6, 6))
                unit[i, j] = unit[j, i] = 1.0
                yield unit, C[:, i, j]

    def softer(self, poisson: float) -> Self:
        """As stiff against a change of shape, with another Poisson's ratio, if it has one."""
        del poisson
        return self

    def tangent(self, asm: Assembly, u: FloatArray) -> FloatArray:
        """See `Law.tangent`."""
        return _voigt.tensor(self.matrices(asm, u))

    def flux(self, asm: Assembly, u: FloatArray, gradient: FloatArray) -> FloatArray:
        """Stress (n, 6) of gradients of displacements."""
        return _voigt.times(self.matrices(asm, u), _voigt.engineering_strain(gradient))

    def stored(self, asm: Assembly, u: FloatArray, flux: FloatArray) -> FloatArray:
        """Product (n,) of stresses (n, 6) with the strains that they cause."""
        out = np.empty(len(u))
        for i in range(0, len(u), AT_ONCE):
            part = slice(i, i + AT_ONCE)
            strain = np.linalg.solve(self.matrices(asm, u[part]), flux[part, :, None])[..., 0]
            out[part] = (flux[part] * strain).sum(axis=1)
        return out

    def components(self, flux: FloatArray) -> FloatArray:
        """See `Law.components`."""
        return flux[:, _voigt.PLACES]

    def penalty(self, asm: Assembly, u: FloatArray, normals: FloatArray) -> FloatArray:
        """Twice that of `Law.penalty`: no larger tractions can be had from the energy."""
        return 2.0 * super().penalty(asm, u, normals)

    def along(self, asm: Assembly, u: FloatArray, normals: FloatArray) -> FloatArray:
        """λ + 2 μ."""
        lam, mu = self.lame(asm, u)
        return np.broadcast_to(lam + 2.0 * mu, len(normals))

    def mean(self, asm: Assembly, u: FloatArray) -> FloatArray:
        """2 μ."""
        return 2.0 * self.lame(asm, u)[1]

    def add(self, data: FloatArray, asm: Assembly, part: Quadrature) -> FloatArray:
        """See `Law.add`."""
        if self.constant:
            C = np.array(self.matrices(asm, part.points[:1]).reshape(1, 36))  # the writable type
            asm.add_cells(data, part, kernels.STIFFNESS, C)
            return CALM
        count = len(part.cells)
        step = max(AT_ONCE * count // max(len(part), 1), 1)
        for i in range(0, count, step):
            some = some_cells(part, slice(i, min(i + step, count)))
            C = self.matrices(asm, some.points).reshape(-1, 36)
            asm.add_cells(data, some, kernels.STIFFNESS, np.ascontiguousarray(C))
        return self.jump(asm, part)

    def add_shape(self, data: FloatArray, asm: Assembly, part: Quadrature) -> FloatArray:
        """`add` without the change of volume, λ, where that is projected; of what is not `full`."""
        raise NotImplementedError

    def normal_of_shape(self, asm: Assembly, u: FloatArray, normals: FloatArray) -> FloatArray:
        """`normal` likewise."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class Isotropic(Elastic):
    """Isotropic linear elastic material.

    Attributes
    ----------
    young, poisson, density, expansion : Scalar
        Young's modulus, Poisson's ratio, mass per volume, thermal expansion per degree.
    strength : Scalar or None
        Von Mises stress at which the material yields.
    """

    full: ClassVar[bool] = False
    called: ClassVar[str] = "young"
    young: Scalar
    poisson: Scalar
    density: Scalar
    expansion: Scalar
    strength: Scalar | None = None

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

    def matrices(self, asm: Assembly, u: FloatArray) -> FloatArray:
        """See `Elastic.matrices`."""
        return _voigt.isotropic(*self.lame(asm, u))

    def ratio(self, asm: Assembly, u: FloatArray) -> FloatArray:
        """Poisson's ratio (n,) or (1,)."""
        return self.poisson.at(asm, u)

    def hindered(self, asm: Assembly, u: FloatArray) -> FloatArray:
        """See `Elastic.hindered`: 3 λ + 2 μ on the diagonal."""
        lam, mu = self.lame(asm, u)
        return np.multiply.outer(3 * lam + 2 * mu, _voigt.UNIT)

    def units(self, asm: Assembly, u: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
        """See `Elastic.units`: those of λ and of μ."""
        lam, mu = self.lame(asm, u)
        yield _voigt.isotropic(1.0, 0.0), lam
        yield _voigt.isotropic(0.0, 1.0), mu

    def softer(self, poisson: float) -> Self:
        """See `Elastic.softer`."""
        return replace(self, poisson=replace(self.poisson, value=poisson))

    def flux(self, asm: Assembly, u: FloatArray, gradient: FloatArray) -> FloatArray:
        """Stress (n, 6) of gradients of displacements."""
        lam, mu = self.lame(asm, u)
        return _voigt.elastic_stress(gradient, lam * np.trace(gradient, axis1=1, axis2=2), mu)

    def stored(self, asm: Assembly, u: FloatArray, flux: FloatArray) -> FloatArray:
        """Product (n,) of stresses (n, 6) with the strains that they cause."""
        return _voigt.complementary(flux, *self.lame(asm, u))

    def normal(self, asm: Assembly, u: FloatArray, normals: FloatArray) -> FloatArray:
        """See `Law.normal`."""
        return self._normal(asm, u, normals, 1.0)

    def normal_of_shape(self, asm: Assembly, u: FloatArray, normals: FloatArray) -> FloatArray:
        """See `Elastic.normal_of_shape`."""
        return self._normal(asm, u, normals, 0.0)

    def _normal(
        self, asm: Assembly, u: FloatArray, normals: FloatArray, whole: float
    ) -> FloatArray:
        """`Law.normal`; λ counts by a factor."""
        lam, mu = (v[:, None, None, None] for v in self.lame(asm, u))
        one, n = np.eye(3), normals
        out = whole * lam * np.einsum("qi,jl->qijl", n, one)
        out = out + mu * (np.einsum("ql,ij->qijl", n, one) + np.einsum("qj,il->qijl", n, one))
        return np.asarray(out)

    def penalty(self, asm: Assembly, u: FloatArray, normals: FloatArray) -> FloatArray:
        """2 μ u·v + λ (u·n)(v·n)."""
        lam, mu = (v[:, None, None] for v in self.lame(asm, u))
        return 2 * mu * np.eye(3) + lam * (normals[:, :, None] * normals[:, None, :])

    def add(self, data: FloatArray, asm: Assembly, part: Quadrature) -> FloatArray:
        """See `Law.add`."""
        return self._add(data, asm, part, 1.0)

    def add_shape(self, data: FloatArray, asm: Assembly, part: Quadrature) -> FloatArray:
        """See `Elastic.add_shape`."""
        return self._add(data, asm, part, 0.0)

    def _add(self, data: FloatArray, asm: Assembly, part: Quadrature, whole: float) -> FloatArray:
        """`Law.add`; λ counts by a factor."""
        lame = self.lame(asm, part.points)
        if self.constant:
            lam, mu = (float(v[0]) for v in lame)
            asm.add_cells(data, part, kernels.PAIRS, np.ones((1, 1)), whole * lam, mu)
            return CALM
        for v, p, q in zip(lame, (whole, 0.0), (0.0, 1.0), strict=True):
            if p or q:
                d = np.broadcast_to(v, len(part))[:, None].copy()
                asm.add_cells(data, part, kernels.PAIRS, d, p, q)
        return self.jump(asm, part, 2.0 * lame[1])
