"""Tensors of elasticity as 6×6 matrices: order, isotropic ones, rotations.

Voigt order xx, yy, zz, yz, xz, xy with engineering shear, as everywhere in the library. Lengths of
tensors are those of all components, which rotations do not change: shear rows count twice
(Mandel's notation).
"""

from typing import Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice._validate import read_only

#: Pairs of axes in Voigt order.
VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
#: Places of pairs of axes in it.
PLACES = read_only(np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]]))
#: Factors of stress or half of those of strain between Voigt's and Mandel's notation.
MANDEL = read_only(np.array([1.0, 1.0, 1.0, 2.0**0.5, 2.0**0.5, 2.0**0.5]))
#: The unit tensor of rank two.
UNIT = read_only(np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]))
#: Projections on volume and on shape, in Mandel's notation.
VOLUME = read_only(np.outer(UNIT, UNIT) / 3.0)
SHAPE = read_only(np.eye(6) - VOLUME)


def isotropic(lam: Any, mu: Any) -> FloatArray:
    """Stiffness matrices (..., 6, 6) of Lamé constants."""
    lam, mu = np.asarray(lam, np.float64), np.asarray(mu, np.float64)
    out = lam[..., None, None] * np.outer(UNIT, UNIT)
    return out + mu[..., None, None] * np.diag([2.0, 2.0, 2.0, 1.0, 1.0, 1.0])


def tensor(C: FloatArray) -> FloatArray:
    """All components (..., 3, 3, 3, 3) of stiffness matrices (..., 6, 6)."""
    return np.asarray(C[..., PLACES[:, :, None, None], PLACES])


def stress_rotation(Q: FloatArray) -> FloatArray:
    """Matrices (..., 6, 6) that turn stresses in Mandel's notation, of rotations (..., 3, 3)."""
    i, j = np.array(VOIGT).T
    first = Q[..., i[:, None], i] * Q[..., j[:, None], j]
    second = Q[..., i[:, None], j] * Q[..., j[:, None], i]
    return np.asarray(0.5 * (first + second) * np.outer(MANDEL, MANDEL))


def rotated(C: FloatArray, Q: FloatArray) -> FloatArray:
    """Stiffnesses (..., 6, 6) of solids that are turned by orthogonal matrices (..., 3, 3)."""
    R, scale = stress_rotation(Q), np.outer(MANDEL, MANDEL)
    return np.asarray(R @ (C * scale) @ np.swapaxes(R, -1, -2) / scale)


def bulk_and_shear(C: FloatArray) -> tuple[Any, Any]:
    """Moduli (...) of the nearest isotropic tensors: of mean strains, as Voigt has them."""
    M = C * np.outer(MANDEL, MANDEL)
    return (M * VOLUME).sum(axis=(-2, -1)) / 3.0, (M * SHAPE).sum(axis=(-2, -1)) / 10.0


def engineering_strain(gradient: FloatArray) -> FloatArray:
    """Strain (n, 6) of displacement gradients (n, 3, 3), with engineering shear."""
    g = gradient
    out = np.empty((len(g), 6))
    for k, (i, j) in enumerate(VOIGT):
        out[:, k] = g[:, i, i] if i == j else g[:, i, j] + g[:, j, i]
    return out


def times(C: FloatArray, strain: FloatArray) -> FloatArray:
    """Stress (n, 6) of strains (n, 6) by stiffnesses (n, 6, 6) or (1, 6, 6)."""
    return strain @ C[0] if len(C) == 1 else np.einsum("nij,nj->ni", C, strain)


def elastic_stress(gradient: FloatArray, pressure: FloatArray, mu: FloatArray) -> FloatArray:
    """Stress (n, 6) of displacement gradients (n, 3, 3), with λ times the change of volume."""
    e = engineering_strain(gradient)
    out = mu[:, None] * e
    out[:, :3] += mu[:, None] * e[:, :3] + pressure[:, None]
    return out


def complementary(s: FloatArray, lam: FloatArray, mu: FloatArray) -> FloatArray:
    """Product (n,) of stresses (n, 6) with the strains that they cause."""
    square = (s[:, :3] ** 2).sum(axis=1) + 2.0 * (s[:, 3:] ** 2).sum(axis=1)
    trace = s[:, :3].sum(axis=1)
    return (square - lam / (3.0 * lam + 2.0 * mu) * trace**2) / (2.0 * mu)
