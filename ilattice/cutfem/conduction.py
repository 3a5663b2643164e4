"""Conductivity of a solid: a number, or a symmetric matrix where directions differ.

::

    il.cutfem.Heat(solid, 16, conductivity=np.diag([3.0, 1.0, 1.0]))  # along x, y, z
    il.cutfem.Heat(solid, 16, through=torus, conductivity=np.diag([9, 1, 1]), axes="map")

Axes that follow a map are those of its rotation, as in `anisotropic`.

Guarantee: every matrix is checked to be symmetric and positive definite where it is used.
"""

from typing import Any, ClassVar

import numpy as np

from ilattice._typing import FloatArray
from ilattice._validate import as_array, asked, check_finite, read_only
from ilattice.cutfem import _kernels_assembly as kernels
from ilattice.cutfem._voigt import VOIGT
from ilattice.cutfem.anisotropic import MIN_EIGENVALUE, ODD, Tensor, turns
from ilattice.cutfem.assembly import Assembly
from ilattice.cutfem.law import Law
from ilattice.cutfem.material import OfParameters, Scalar, Single
from ilattice.errors import InputError
from ilattice.quadrature.rules import Quadrature

NAME = "conductivity"
One = Single | FloatArray
#: A number, name, function of points with numbers or matrices, or matrix; or a pair of these.
Conducting = One | tuple[One, One]


class Conduction(Tensor, Law):
    """A conductivity as it was given: the law of heat, of which the flux has the other sign.

    It is a number, a name, a matrix (3, 3), a callable, or a pair of these.
    """

    called: ClassVar[str] = NAME

    @property
    def constant(self) -> bool:
        """Whether it is one number or matrix."""
        fixed = not (self.paired or isinstance(self.value, str) or callable(self.value))
        return fixed and (self.axes == "space" or not isinstance(self.value, np.ndarray))

    @staticmethod
    def _checked(value: Any, lattice: Any, turn: FloatArray | None) -> Any:
        """See `Tensor._checked`."""
        if callable(value):
            return value
        if isinstance(value, str) or np.ndim(value) != 2:
            Scalar(NAME, value, lattice=lattice)
            return value if isinstance(value, str) else float(np.ravel(value)[0])
        k = _matrices(as_array(NAME, value)[None], None)[0]
        return read_only(k if turn is None else turn @ k @ turn.T)

    @property
    def told(self) -> dict[str, Any]:
        """See `Law.told`."""
        return {NAME: self.value}

    def at(self, asm: Assembly, u: FloatArray) -> FloatArray:
        """Numbers (n,) or matrices (n, 3, 3) of what is no pair; one of a constant."""
        assert not self.paired
        value = self.value
        if callable(value):
            points = u if isinstance(value, OfParameters) else asm.x(u)
            found = asked(NAME, value, points)
            if np.ndim(found) == 3:
                return self._turned(asm, u, _matrices(found, asm.x(u)))
            value = OfParameters(lambda _: found)
        if isinstance(value, np.ndarray):
            return self._turned(asm, u, value[None])
        return Scalar(NAME, value, lattice=self.lattice).at(asm, u)

    def tangent(self, asm: Assembly, u: FloatArray) -> FloatArray:
        """See `Law.tangent`."""
        return as_matrices(self.at(asm, u))[:, None, :, None, :]

    def flux(self, asm: Assembly, u: FloatArray, gradient: FloatArray) -> FloatArray:
        """See `Law.flux`."""
        return _product(self.at(asm, u), gradient[:, 0])

    def stored(self, asm: Assembly, u: FloatArray, flux: FloatArray) -> FloatArray:
        """See `Law.stored`."""
        k = self.at(asm, u)
        resistance = np.asarray(1.0 / k if k.ndim == 1 else np.linalg.inv(k), np.float64)
        return np.asarray((flux * _product(resistance, flux)).sum(axis=1))

    def mean(self, asm: Assembly, u: FloatArray) -> FloatArray:
        """See `Law.mean`."""
        return mean(self.at(asm, u))

    def add(self, data: FloatArray, asm: Assembly, part: Quadrature) -> FloatArray:
        """See `Law.add`."""
        k = self.at(asm, part.points)
        asm.add_cells(data, part, kernels.TENSOR, rows(k))
        return self.jump(asm, part, k if k.ndim == 1 else None)

    def _turned(self, asm: Assembly, u: FloatArray, k: FloatArray) -> FloatArray:
        """Matrices along axes of space."""
        if self.axes == "space":
            return k
        Q = turns(asm.jacobians(u))
        return np.asarray(Q @ k @ Q.transpose(0, 2, 1))


def _matrices(value: Any, x: FloatArray | None) -> FloatArray:
    """Symmetric positive definite matrices (n, 3, 3), at points x (n, 3), or `InputError`."""
    k = as_array(NAME, value, finite=False)
    if k.shape[1:] != (3, 3) or (x is not None and len(k) != len(x)):
        what = "a matrix, shape (3, 3)" if x is None else f"one per point, shape ({len(x)}, 3, 3)"
        got = k.shape[1:] if x is None else k.shape
        raise InputError(f"{NAME} must be a number or {what}, got shape {got}")
    check_finite(NAME, k)
    top = np.abs(k).max(axis=(1, 2))
    odd = np.abs(k - k.transpose(0, 2, 1)).max(axis=(1, 2)) > ODD * top
    values = np.linalg.eigvalsh(k)
    bad = odd | ~(values[:, 0] > MIN_EIGENVALUE * np.maximum(values[:, 2], 0.0))
    if bad.any():
        i = int(bad.argmax())
        at = "" if x is None else f" at ({', '.join(f'{c:.4g}' for c in x[i])})"
        why = "symmetric" if odd[i] else "positive definite"
        raise InputError(f"{NAME}{at} must be {why}, got {k[i].tolist()}")
    return 0.5 * (k + k.transpose(0, 2, 1))


def as_matrices(k: FloatArray) -> FloatArray:
    """Matrices (n, 3, 3) of numbers (n,) or matrices."""
    return k if k.ndim == 3 else k[:, None, None] * np.eye(3)


def _product(k: FloatArray, g: FloatArray) -> FloatArray:
    """Products (n, 3) of numbers (n,) or matrices (n, 3, 3), or one of these, and vectors."""
    if k.ndim == 1:
        return k[:, None] * g
    return np.einsum("qij,qj->qi", np.broadcast_to(k, (len(g), 3, 3)), g)


def mean(k: FloatArray) -> FloatArray:
    """Mean over directions (n,)."""
    return np.trace(k, axis1=1, axis2=2) / 3.0 if k.ndim == 3 else k


def rows(k: FloatArray) -> FloatArray:
    """Entries (n, 6) in Voigt order."""
    i, j = np.array(VOIGT).T
    return np.ascontiguousarray(as_matrices(k)[:, i, j])
