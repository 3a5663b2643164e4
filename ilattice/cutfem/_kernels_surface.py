"""Matrices of conditions on surfaces: springs, convection, and Nitsche's method.

Guarantees: a matrix depends on its own cell only; both halves come from the same operations; the
same bits for any number of threads.
"""

from typing import Any

import numpy as np
from numba import njit, prange

from ilattice.bspline._kernels_basis import (
    INNER,
    gradients_of,
    inverse,
    lines,
    take_tables,
    values_of,
)
from ilattice.bspline._kernels_vector import LANES


@njit(**INNER)
def traction(D: Any, a: int, n: Any, lam: float, mu: float, T: Any) -> None:
    """T[a, i, j]: component i of the traction of function a times the unit vector j."""
    normal = D[0, a] * n[0] + D[1, a] * n[1] + D[2, a] * n[2]
    for i in range(3):
        for j in range(3):
            T[a, i, j] = lam * n[i] * D[j, a] + mu * D[i, a] * n[j]
        T[a, i, i] += mu * normal


@njit(parallel=True, **INNER)
def surface_blocks(
    t0: Any, t1: Any, t2: Any, places: Any, boxes: Any, offsets: Any, u: Any, w: Any, J: Any,
    normals: Any, Q: Any, lame: Any, mask: Any, out: Any,
) -> None:  # fmt: skip
    """Matrices out (cells, 3 nb, 3 nb) of w (N Q N - N mask t(N) - its transpose).

    u are parameters, w weights in space; Q (n, 3, 3) is a symmetric stiffness per area, lame
    (n, 2) the Lamé constants of the tractions t, zero for springs; mask (3,) is 1 in components
    that are held.
    """
    n = t0.shape[1]
    nb = n * n * n
    step = 0 if len(J) == 1 else 1
    for e in prange(len(places)):
        T = np.zeros((3, n, LANES))
        B = np.empty((3, 2, LANES))
        N = np.empty(nb + LANES)
        D = np.empty((4, nb))
        G = np.empty((3, 3))
        t = np.empty((nb, 3, 3))
        A = out[e]
        A[:] = 0.0
        take_tables(t0, t1, t2, places, e, T)
        for q in range(offsets[e], offsets[e + 1]):
            lines(T, boxes, e, u, q, B)
            inverse(J, q * step, G)
            values_of(B, n, N, 0)
            gradients_of(B, n, G, D, 0)
            for a in range(nb):
                traction(D, a, normals[q], lame[q, 0], lame[q, 1], t)
            for a in range(nb):
                for b in range(a, nb):
                    for i in range(3):
                        for j in range(3):
                            v = N[a] * N[b] * Q[q, i, j]
                            v -= N[a] * mask[i] * t[b, i, j] + N[b] * mask[j] * t[a, j, i]
                            A[3 * a + i, 3 * b + j] += w[q] * v
        for a in range(3 * nb):
            for b in range(a // 3 * 3):
                A[a, b] = A[b, a]


@njit(parallel=True, **INNER)
def seam_blocks(offsets: Any, w: Any, N: Any, T: Any, Q: Any, out: Any) -> None:
    """Matrices out (pairs, m nb, m nb) of w (N Q N - N T - its transpose) on pairs of elements.

    N (n, nb) are the jumps of the functions of both elements, T (n, m, nb, m) the mean tractions of
    function b along direction j at [:, :, b, j], Q (n, m, m) a symmetric stiffness per area.
    """
    nb = N.shape[1]
    m = Q.shape[1]
    for e in prange(len(out)):
        A = out[e]
        A[:] = 0.0
        for q in range(offsets[e], offsets[e + 1]):
            for a in range(nb):
                for b in range(a, nb):
                    for i in range(m):
                        for j in range(m):
                            v = N[q, a] * N[q, b] * Q[q, i, j]
                            v -= N[q, a] * T[q, i, b, j] + N[q, b] * T[q, j, a, i]
                            A[m * a + i, m * b + j] += w[q] * v
        for a in range(m * nb):
            for b in range(a // m * m):
                A[a, b] = A[b, a]


@njit(parallel=True, **INNER)
def surface_scalars(
    t0: Any, t1: Any, t2: Any, places: Any, boxes: Any, offsets: Any, u: Any, w: Any, J: Any,
    normals: Any, Q: Any, k: Any, out: Any,
) -> None:  # fmt: skip
    """Matrices out (cells, nb, nb) of w (Q N N - N k dN/dn - its transpose); k and Q are (n,)."""
    n = t0.shape[1]
    nb = n * n * n
    step = 0 if len(J) == 1 else 1
    for e in prange(len(places)):
        T = np.zeros((3, n, LANES))
        B = np.empty((3, 2, LANES))
        N = np.empty(nb + LANES)
        D = np.empty((4, nb))
        G = np.empty((3, 3))
        F = np.empty(nb)
        A = out[e]
        A[:] = 0.0
        take_tables(t0, t1, t2, places, e, T)
        for q in range(offsets[e], offsets[e + 1]):
            lines(T, boxes, e, u, q, B)
            inverse(J, q * step, G)
            values_of(B, n, N, 0)
            gradients_of(B, n, G, D, 0)
            for a in range(nb):
                F[a] = D[0, a] * normals[q, 0] + D[1, a] * normals[q, 1]
                F[a] = k[q] * (F[a] + D[2, a] * normals[q, 2])
            for a in range(nb):
                for b in range(a, nb):
                    A[a, b] += w[q] * (Q[q] * N[a] * N[b] - N[a] * F[b] - N[b] * F[a])
        for a in range(nb):
            for b in range(a):
                A[a, b] = A[b, a]
