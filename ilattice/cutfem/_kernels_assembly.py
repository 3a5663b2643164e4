"""Matrices of cells, and sparse matrices from them: row by row, without atomics.

A cell matrix is a sum over points of products of rows, gathered four points and two rows at a time
so that a matrix is read and written a quarter as often, and points half as often. Elasticity keeps
S = sum w dN/dx_i dN/dx_j of all pairs, which holds for any Lamé constants; they come in when rows
are filled.

Guarantees: a row is summed by one thread in the order of its elements, and both halves of a
matrix by the same operations, so matrices are symmetric to the bit and the same for any number
of threads. Room for all patterns is counted before it is filled.
"""

from typing import Any

import numpy as np
from numba import njit, prange

from ilattice.cutfem._kernels_basis import INNER, gradients_of, inverse, lines, values_of

MASS, TENSOR, PAIRS = range(3)  # kinds of cell matrices
SCALAR, ELASTIC, BLOCKS = range(3)  # kinds of blocks
ROWS = 12  # rows of a cell that are multiplied at once


@njit(**INNER)
def add_products(L: Any, R: Any, rows: int, A: Any) -> None:
    """Add R^T L to the upper half of A; the rows up to the next multiple of 4 are cleared.

    Entries just below the diagonal are added to as well.
    """
    n = A.shape[0]
    for q in range(rows, (rows + 3) // 4 * 4):
        L[q] = 0.0
        R[q] = 0.0
    for q in range(0, rows, 4):
        for a in range(0, n - 1, 2):
            r0 = R[q, a]
            r1 = R[q + 1, a]
            r2 = R[q + 2, a]
            r3 = R[q + 3, a]
            s0 = R[q, a + 1]
            s1 = R[q + 1, a + 1]
            s2 = R[q + 2, a + 1]
            s3 = R[q + 3, a + 1]
            for b in range(a, n):
                x = L[q, b]
                y = L[q + 1, b]
                z = L[q + 2, b]
                t = L[q + 3, b]
                A[a, b] += r0 * x + r1 * y + r2 * z + r3 * t
                A[a + 1, b] += s0 * x + s1 * y + s2 * z + s3 * t
        if n % 2:
            for k in range(q, q + 4):
                A[n - 1, n - 1] += R[k, n - 1] * L[k, n - 1]


@njit(**INNER)
def point_rows(kind: int, B: Any, G: Any, w: float, d: Any, D: Any, L: Any, R: Any) -> int:
    """The rows of one point: N, the three of grad N, or grad N of all functions in one."""
    nb = len(D) // 3
    if kind == 0:
        values_of(B, L[0])
        for a in range(nb):
            R[0, a] = w * d[0] * L[0, a]
        return 1
    if kind == 2:
        gradients_of(B, G, L[0])
        for a in range(3 * nb):
            R[0, a] = w * d[0] * L[0, a]
        return 1
    gradients_of(B, G, D)
    for a in range(nb):
        x = D[3 * a]
        y = D[3 * a + 1]
        z = D[3 * a + 2]
        L[0, a] = x
        L[1, a] = y
        L[2, a] = z
        R[0, a] = w * (d[0] * x + d[5] * y + d[4] * z)
        R[1, a] = w * (d[5] * x + d[1] * y + d[3] * z)
        R[2, a] = w * (d[4] * x + d[3] * y + d[2] * z)
    return 3


@njit(parallel=True, **INNER)
def cell_matrices(
    kind: int, t0: Any, t1: Any, t2: Any, places: Any, boxes: Any, offsets: Any, u: Any, w: Any,
    J: Any, d: Any, out: Any,
) -> None:  # fmt: skip
    """Matrices out (cells, n, n) of the points u (n, 3) with weights w in parameters.

    MASS: d (n, 1) times N N; TENSOR: grad N d grad N with the symmetric tensor d (n, 6) in
    Voigt order; PAIRS: d (n, 1) times the products of all derivatives, n = 3 nb. J and d may have
    one row for all points.
    """
    n = t0.shape[1]
    size = out.shape[1]
    J_step = 0 if len(J) == 1 else 1
    d_step = 0 if len(d) == 1 else 1
    for e in prange(len(places)):
        B = np.empty((3, 2, n))
        D = np.empty(3 * n * n * n)
        G = np.empty((3, 3))
        L = np.empty((ROWS, size))
        R = np.empty((ROWS, size))
        A = out[e]
        A[:] = 0.0
        rows = 0
        for q in range(offsets[e], offsets[e + 1]):
            lines(t0, t1, t2, places[e], boxes[e], u[q], B)
            det = inverse(J[q * J_step], G)
            rows += point_rows(kind, B, G, w[q] * abs(det), d[q * d_step], D, L[rows:], R[rows:])
            if rows == ROWS:
                add_products(L, R, rows, A)
                rows = 0
        add_products(L, R, rows, A)
        for a in range(size):
            for b in range(a):
                A[a, b] = A[b, a]


# ---------------------------------------------------------------------------------- patterns


@njit(cache=True)
def incidence(dofs: Any, n: int) -> Any:
    """Per node the places (count,) in the flat list of all nodes of elements, and offsets."""
    start = np.zeros(n + 1, np.int64)
    for i in range(len(dofs)):
        start[dofs[i] + 1] += 1
    for i in range(n):
        start[i + 1] += start[i]
    at = start[:-1].copy()
    out = np.empty(len(dofs), np.int64)
    for i in range(len(dofs)):
        out[at[dofs[i]]] = i
        at[dofs[i]] += 1
    return start, out


@njit(parallel=True, cache=True)
def count_columns(
    start: Any, where: Any, owner: Any, first: Any, dofs: Any, chunks: int, count: Any
) -> None:
    """Number of nodes that share an element with each node, itself included."""
    n = len(start) - 1
    for chunk in prange(chunks):
        mark = np.full(n, -1, np.int32)
        for r in range(chunk * n // chunks, (chunk + 1) * n // chunks):
            found = 0
            for i in range(start[r], start[r + 1]):
                e = owner[where[i]]
                for j in range(first[e], first[e + 1]):
                    if mark[dofs[j]] != r:
                        mark[dofs[j]] = r
                        found += 1
            count[r] = found


@njit(parallel=True, cache=True)
def list_columns(
    start: Any, where: Any, owner: Any, first: Any, dofs: Any, chunks: int, indptr: Any,
    indices: Any,
) -> None:  # fmt: skip
    """The nodes that `count_columns` counts, increasing."""
    n = len(start) - 1
    for chunk in prange(chunks):
        mark = np.full(n, -1, np.int32)
        for r in range(chunk * n // chunks, (chunk + 1) * n // chunks):
            at = indptr[r]
            for i in range(start[r], start[r + 1]):
                e = owner[where[i]]
                for j in range(first[e], first[e + 1]):
                    if mark[dofs[j]] != r:
                        mark[dofs[j]] = r
                        indices[at] = dofs[j]
                        at += 1
            indices[indptr[r] : at].sort()


@njit(**INNER)
def add_block(kind: int, A: Any, a: int, b: int, p: float, q: float, out: Any) -> None:
    """Add the block of functions a and b of one element.

    SCALAR: p A[a, b] on the diagonal; ELASTIC: that of the Lamé constants p and q from the
    products of derivatives; BLOCKS: p times the block of A itself.
    """
    m = out.shape[0]
    if kind == 0:
        for i in range(m):
            out[i, i] += p * A[a, b]
    elif kind == 1:
        trace = q * (A[3 * a, 3 * b] + A[3 * a + 1, 3 * b + 1] + A[3 * a + 2, 3 * b + 2])
        for i in range(3):
            for j in range(3):
                v = p * A[3 * a + i, 3 * b + j] + q * A[3 * a + j, 3 * b + i]
                if i == j:
                    v += trace
                out[i, j] += v
    else:
        for i in range(m):
            for j in range(m):
                out[i, j] += p * A[m * a + i, m * b + j]


@njit(parallel=True, **INNER)
def fill(
    kind: int, start: Any, where: Any, owner: Any, first: Any, dofs: Any, slot: Any, chunks: int,
    indptr: Any, indices: Any, A: Any, p: float, q: float, data: Any,
) -> None:  # fmt: skip
    """Add the matrices A[slot[e]] of all elements e with slot[e] >= 0 to data (blocks, m, m)."""
    n = len(start) - 1
    for chunk in prange(chunks):
        at = np.empty(n, np.int64)
        for r in range(chunk * n // chunks, (chunk + 1) * n // chunks):
            ready = False
            for i in range(start[r], start[r + 1]):
                e = owner[where[i]]
                if slot[e] >= 0:
                    if not ready:
                        ready = True
                        for k in range(indptr[r], indptr[r + 1]):
                            at[indices[k]] = k
                    a = where[i] - first[e]
                    for j in range(first[e], first[e + 1]):
                        add_block(kind, A[slot[e]], a, j - first[e], p, q, data[at[dofs[j]]])
