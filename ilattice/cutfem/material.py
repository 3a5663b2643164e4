"""Material that may vary from point to point.

A property is a number, a function of points of space, or the name of a property of the lattice:
an extra coordinate of its map, or a property of its tile.

Guarantee: every value is checked where it is used; what is negative, zero where it must not be,
or not finite ends in an error that tells where.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice._validate import as_array, check_finite
from ilattice.cutfem.assembly import Assembly
from ilattice.errors import InputError
from ilattice.macroshape.lattice import Lattice

Property = float | str | Callable[[FloatArray], Any]


@dataclass(frozen=True, eq=False)
class Scalar:
    """One property of a material.

    Attributes
    ----------
    name : str
        What it is called in messages.
    value : float, str or callable
        The property.
    low, high : float
        Values must lie strictly between; with `closed`, low itself is allowed.
    lattice : Lattice or None
        Where named properties come from.
    """

    name: str
    value: Property
    low: float = 0.0
    high: float = np.inf
    closed: bool = False
    lattice: Lattice | None = None

    def __post_init__(self) -> None:
        if isinstance(self.value, str):
            if self.lattice is None:
                raise InputError(f"{self.name}={self.value!r}: only walls have named properties")
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
        return not (isinstance(self.value, str) or callable(self.value))

    def at(self, asm: Assembly, u: FloatArray) -> FloatArray:
        """Values at parameters.

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
        if isinstance(self.value, str):
            assert self.lattice is not None
            return self._check(self.lattice.property_at(self.value, u))
        if not callable(self.value):
            return np.array([float(np.ravel(self.value)[0])])
        value = as_array(self.name, self.value(asm.x(u)), finite=False)
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
