"""The rigidity matrix, its products, and the rigid motions.

Guarantees: rows are in the order of the edges; products are without the matrix.
"""

from typing import Any

import numpy as np
from scipy.sparse import csr_array

from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice._validate import as_array, as_kind
from ilattice.cost import _kernels_rigidity as kernels
from ilattice.cost._structure import Structure
from ilattice.errors import InputError


def matrix(k: Structure) -> csr_array:
    """Rigidity matrix: half the derivatives of the squared lengths of edges.

    Parameters
    ----------
    k : CornerSharing
        The structure.

    Returns
    -------
    csr_array, shape (e, d n)
        The row of the edge (i, j) has x_i - x_j at i and x_j - x_i at j.
    """
    as_kind("k", k, "CornerSharing")
    e, d, n = len(k.edges), k.dim, len(k.positions)
    indptr, indices = np.empty(e + 1, np.int32), np.empty(2 * d * e, np.int32)
    if 2 * d * e >= 2**31:
        raise InputError(f"{e} edges are too many for one matrix: use products instead")
    data = np.empty(2 * d * e)
    kernels.fill(*_arrays(k), indptr, indices, data)
    return csr_array((data, indices, indptr), shape=(e, d * n))


def stretched(k: Structure, motion: ArrayLike) -> FloatArray:
    """The matrix times a motion (n, d), without the matrix: shape (e,).

    Parameters
    ----------
    k : CornerSharing
        The structure.
    motion : array_like, shape (n, d)
        Velocities of the vertices.

    Returns
    -------
    ndarray, shape (e,)
        Half the rates of the squared lengths.
    """
    u = as_motion(k, "motion", motion)
    out = np.empty(len(k.edges))
    kernels.stretch(*_arrays(k), u, out)
    return out


def gathered(k: Structure, density: ArrayLike) -> FloatArray:
    """The transposed matrix times force densities (e,), without the matrix: shape (n, d).

    Parameters
    ----------
    k : CornerSharing
        The structure.
    density : array_like, shape (e,)
        Forces over lengths, tension positive.

    Returns
    -------
    ndarray, shape (n, d)
        The loads that they hold in balance.
    """
    s = as_array("density", density, ndim=1)
    if len(s) != len(k.edges):
        raise InputError(f"density must have shape ({len(k.edges)},), got {s.shape}")
    out = np.zeros_like(k.positions)
    kernels.gather(*_arrays(k), s, out)
    return out


def _arrays(k: Structure) -> tuple[Any, Any]:
    """Positions and edges as compiled code knows them: views that could be written to."""
    return np.array(k.positions), np.array(k.edges)


def as_motion(k: Structure, name: str, value: ArrayLike) -> FloatArray:
    """Velocities of the vertices, checked."""
    u = as_array(name, value, ndim=2)
    if u.shape != k.positions.shape:
        raise InputError(f"{name} must have shape {k.positions.shape}, got {u.shape}")
    return u


def free_columns(k: Structure) -> IntArray:
    """Columns that are left when the rigid motions are held at two or three far vertices.

    Parameters
    ----------
    k : CornerSharing
        The structure.

    Returns
    -------
    ndarray of int
        Columns of the matrix: all but 3 in the plane, all but 6 in space.
    """
    x, d = k.positions, k.dim
    first = int(np.argmin(x @ np.arange(1.0, d + 1.0)))
    way = x - x[first]
    second = int(np.argmax((way**2).sum(axis=1)))
    a = way[second]
    held = [d * first + i for i in range(d)]
    if d == 2:
        return np.delete(np.arange(2 * len(x)), [*held, 2 * second + int(np.argmin(np.abs(a)))])
    held += [3 * second + i for i in range(3) if i != int(np.argmax(np.abs(a)))]
    normals = np.cross(way, a)
    third = int(np.argmax((normals**2).sum(axis=1)))
    held.append(3 * third + int(np.argmax(np.abs(normals[third]))))
    return np.delete(np.arange(3 * len(x)), held)


def rigid_motions(k: Structure) -> FloatArray:
    """Orthonormal basis of the rigid motions.

    Parameters
    ----------
    k : CornerSharing
        The structure.

    Returns
    -------
    ndarray, shape (d n, t)
        Its t = 3 or 6 columns.
    """
    x, n, d = k.positions - k.positions.mean(axis=0), len(k.positions), k.dim
    out = np.zeros((n, d, k.trivial))
    for a in range(d):
        out[:, a, a] = 1.0
    planes = [(0, 1)] if d == 2 else [(0, 1), (1, 2), (2, 0)]
    for c, (a, b) in enumerate(planes):
        out[:, a, d + c], out[:, b, d + c] = -x[:, b], x[:, a]
    return np.asarray(np.linalg.qr(out.reshape(n * d, -1))[0])
