"""Stiffness tensors as 6×6 matrices: rotations, moduli, symmetries, nearest tensors.

Voigt order xx, yy, zz, yz, xz, xy with engineering shear, as everywhere in the library. Distances
between tensors are those of all 81 components, which rotations do not change: shear rows count
twice (Mandel's notation).

Guarantees: projections on tensors of a symmetry are orthogonal in that distance. Non-guarantee:
the axes of the symmetry are those given, they are not looked for.
"""

import itertools
from typing import Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice._validate import as_array
from ilattice.cutfem._voigt import MANDEL as MANDEL
from ilattice.cutfem._voigt import SHAPE as SHAPE
from ilattice.cutfem._voigt import UNIT as UNIT
from ilattice.cutfem._voigt import VOIGT
from ilattice.cutfem._voigt import VOLUME as VOLUME
from ilattice.cutfem._voigt import bulk_and_shear as bulk_and_shear
from ilattice.cutfem._voigt import isotropic as isotropic
from ilattice.cutfem._voigt import rotated as rotated
from ilattice.cutfem._voigt import tensor as tensor
from ilattice.errors import InputError

#: Pairs of axes in Voigt order.
PAIRS = VOIGT
#: Names of symmetries, the highest first.
SYMMETRIES = ("isotropic", "cubic", "transversely isotropic", "tetragonal", "orthotropic")


def compliance(C: FloatArray, soft: float) -> FloatArray:
    """Pseudo-inverse of a stiffness (6, 6), without what is below a part of its largest value."""
    values, vectors = np.linalg.eigh(C * np.outer(MANDEL, MANDEL))
    firm = values > max(soft * float(values[-1]), 0.0)
    inverse = np.where(firm, 1.0 / np.where(firm, values, 1.0), 0.0)
    S = (vectors * inverse) @ vectors.T * np.outer(MANDEL, MANDEL)
    return np.asarray(0.5 * (S + S.T))


def strain_matrices() -> FloatArray:
    """The six unit strains as symmetric matrices, (6, 3, 3)."""
    out = np.zeros((6, 3, 3))
    for a, (i, j) in enumerate(PAIRS):
        out[a, i, j] = out[a, j, i] = 1.0 if i == j else 0.5
    return out


def as_rotation(matrix: Any) -> FloatArray:
    """An orthogonal matrix (3, 3), or `InputError`."""
    Q = as_array("rotation", matrix)
    if Q.shape != (3, 3) or np.abs(Q @ Q.T - np.eye(3)).max() > 1e-9:
        raise InputError(f"rotation must be an orthogonal matrix, shape (3, 3), got {matrix!r:.80}")
    return Q


def as_direction(name: str, value: Any) -> FloatArray:
    """Unit vectors (n, 3), of one or of many that are not zero."""
    a = as_array(name, value)
    if np.ndim(value) not in (1, 2) or a.shape[-1] != 3:
        raise InputError(f"{name} must be a vector, shape (3,), or rows (n, 3), got {value!r:.80}")
    a = a.reshape(-1, 3)
    scale = np.abs(a).max(axis=1, keepdims=True)
    if not (scale > 0).all():
        raise InputError(f"{name} must not be zero, got {value!r:.80}")
    a = a / scale
    return np.asarray(a / np.linalg.norm(a, axis=1, keepdims=True))


def size(C: FloatArray) -> float:
    """Square root of the sum of squares of all 81 components."""
    return float(np.linalg.norm(C * np.outer(MANDEL, MANDEL)))


def weighted(C: FloatArray, weights: FloatArray) -> FloatArray:
    """Sum of matrices (n, k, k), or of one for all, times weights (n,)."""
    out = weights.sum() * C[0] if len(C) == 1 else np.einsum("n,nij->ij", weights, C)
    return np.asarray(out)


def of_moduli(bulk: float, shear: float) -> FloatArray:
    """Isotropic stiffness of two moduli."""
    return isotropic(bulk - 2.0 * shear / 3.0, shear)


def groups() -> dict[str, list[FloatArray]]:
    """Orthogonal matrices of the symmetries with axes along x, y, z, by name."""
    signs = [np.diag(s) for s in itertools.product((1.0, -1.0), repeat=3)]
    turns = [np.eye(3)[list(p)] for p in itertools.permutations(range(3))]
    swap = np.eye(3)[[1, 0, 2]]
    return {
        "cubic": [s @ p for s in signs for p in turns],
        "tetragonal": [s @ p for s in signs for p in (np.eye(3), swap)],
        "orthotropic": signs,
    }


def nearest(C: FloatArray, symmetry: str) -> FloatArray:
    """The nearest tensor that has a symmetry, with axes along x, y, z."""
    if symmetry == "isotropic":
        return of_moduli(*bulk_and_shear(C))
    known = groups()
    if symmetry == "transversely isotropic":
        return _about_z(C)
    if symmetry not in known:
        names = ("isotropic", "transversely isotropic", *known)
        raise InputError(f"symmetry must be one of {names}, got {symmetry!r:.80}")
    return np.mean([rotated(C, Q) for Q in known[symmetry]], axis=0)


def _about_z(C: FloatArray) -> FloatArray:
    """Mean over rotations about z and mirrors; eight angles are exact for tensors of rank four."""
    total = np.zeros((6, 6))
    for k in range(8):
        s, c = np.sin(k * np.pi / 4.0), np.cos(k * np.pi / 4.0)
        Q = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        for z in (1.0, -1.0):
            total += rotated(C, np.diag([1.0, 1.0, z]) @ Q)
            total += rotated(C, np.diag([1.0, -1.0, z]) @ Q)
    return total / 32.0


def without(C: FloatArray, normals: FloatArray) -> FloatArray:
    """A stiffness without tractions on planes with some normals (k, 3), to the bit along axes."""
    if not len(normals):
        return C
    M = C * np.outer(MANDEL, MANDEL)
    dyads = np.array([np.outer(n, e) for n in normals for e in np.eye(3)])
    dyads = 0.5 * (dyads + dyads.transpose(0, 2, 1))
    rows = np.stack([dyads[:, i, j] for i, j in PAIRS], axis=1) * MANDEL
    vectors, values, _ = np.linalg.svd(rows.T, full_matrices=False)
    lost = vectors[:, values > 1e-9]
    keep = np.eye(6) - lost @ lost.T
    M = keep @ M @ keep
    M[np.abs(M) <= 1e-14 * np.abs(M).max()] = 0.0
    return 0.5 * (M + M.T) / np.outer(MANDEL, MANDEL)
