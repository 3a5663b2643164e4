"""Basis functions of tensor B-splines in a cell, fields at points, and integrals of vectors.

A direction is a table (cells, p + 1, p + 1) of centred monomial coefficients: of every function
that lives in a cell, in r = (u - middle) / length. Degrees are at most 3, so that all functions of
a direction fit into one vector. Function (i, j, k) of a cell has the local number
(i (p + 1) + j) (p + 1) + k.

Guarantees: one allocation of scratch per range; a row depends on its own cell only, so results
have the same bits for any number of threads.
"""

from typing import Any

import numpy as np

from ilattice._kernels import in_ranges, inner, outer
from ilattice.bspline._kernels_vector import LANES, load, multiply_add, scale, spread, store

FAST = {"contract"}
INNER: Any = {"cache": True, "fastmath": FAST, "error_model": "numpy"}
#: Points that a thread takes at once: where much is computed for each, and where little is.
CHUNK, LONG = 64, 16384


@inner(**INNER)
def take_table(table: Any, cell: int, T: Any, a: int) -> None:
    """T[a, e, j] = table[cell, j, e]: a row of all functions for every power, in a whole vector."""
    n = table.shape[1]
    for j in range(n):
        for e in range(n):
            T[a, e, j] = table[cell, j, e]


@inner(**INNER)
def take_tables(t0: Any, t1: Any, t2: Any, ijk: Any, e: int, T: Any) -> None:
    """The tables T (3, n, LANES), zeros at first, of the three directions of cell e."""
    take_table(t0, ijk[e, 0], T, 0)
    take_table(t1, ijk[e, 1], T, 1)
    take_table(t2, ijk[e, 2], T, 2)


@inner(**INNER)
def line(T: Any, t: int, r: float, factor: float, B: Any, a: int) -> None:
    """The functions B[a, 0] of table T[t] at r, and derivatives B[a, 1], factor being 1 / length.

    B is (., 2, LANES).
    """
    n = T.shape[1]
    at = (t * n + n - 1) * LANES
    f = load(T, at, LANES)
    g = spread(0.0)
    for _ in range(n - 1):
        at -= LANES
        g = multiply_add(g, r, f)
        f = multiply_add(f, r, load(T, at, LANES))
    store(B, 2 * a * LANES, f)
    store(B, (2 * a + 1) * LANES, scale(g, factor))


@inner(**INNER)
def lines(T: Any, boxes: Any, e: int, u: Any, q: int, B: Any) -> None:
    """Functions B[a, 0] and slopes B[a, 1] of the three directions of cell e at u[q]."""
    for a in range(3):
        x = 1.0 / boxes[e, 3 + a]
        line(T, a, (u[q, a] - boxes[e, a]) * x - 0.5, x, B, a)


@inner(**INNER)
def inverse(J: Any, q: int, G: Any) -> float:
    """The determinant of J[q], and G[k, c] = du_k / dx_c."""
    for k in range(3):
        a = (k + 1) % 3
        b = (k + 2) % 3
        for c in range(3):
            d = (c + 1) % 3
            e = (c + 2) % 3
            G[k, c] = J[q, d, a] * J[q, e, b] - J[q, e, a] * J[q, d, b]
    det = J[q, 0, 0] * G[0, 0] + J[q, 1, 0] * G[0, 1] + J[q, 2, 0] * G[0, 2]
    factor = 1.0 / det
    for k in range(3):
        for c in range(3):
            G[k, c] *= factor
    return det


@in_ranges(LONG)
@outer(nogil=True, **INNER)
def determinants(first: int, last: int, J: Any, out: Any) -> None:
    """Determinants of matrices J (n, 3, 3)."""
    for q in range(first, last):
        out[q] = (
            J[q, 0, 0] * (J[q, 1, 1] * J[q, 2, 2] - J[q, 1, 2] * J[q, 2, 1])
            + J[q, 0, 1] * (J[q, 1, 2] * J[q, 2, 0] - J[q, 1, 0] * J[q, 2, 2])
            + J[q, 0, 2] * (J[q, 1, 0] * J[q, 2, 1] - J[q, 1, 1] * J[q, 2, 0])
        )


@inner(**INNER)
def values_of(B: Any, n: int, N: Any, at: int) -> None:
    """All products of n functions per direction, from flat position `at` of N on.

    Up to LANES numbers behind them are written, too.
    """
    z = load(B, 4 * LANES, LANES)
    for i in range(n):
        for j in range(n):
            store(N, at, scale(z, B[0, 0, i] * B[1, 0, j]))
            at += n


@inner(**INNER)
def gradients_of(B: Any, n: int, G: Any, D: Any, at: int) -> None:
    """Gradients in space of all products: those along x, then y, then z; see `values_of`."""
    z = load(B, 4 * LANES, LANES)
    slope = load(B, 5 * LANES, LANES)
    for c in range(3):
        for i in range(n):
            for j in range(n):
                x = B[0, 1, i] * B[1, 0, j] * G[0, c] + B[0, 0, i] * B[1, 1, j] * G[1, c]
                y = B[0, 0, i] * B[1, 0, j] * G[2, c]
                store(D, at, multiply_add(slope, y, scale(z, x)))
                at += n


@in_ranges(4 * CHUNK)
@outer(nogil=True, **INNER)
def fields(
    begin: int, end: int, t0: Any, t1: Any, t2: Any, ijk: Any, boxes: Any, dofs: Any, owner: Any,
    u: Any, J: Any, c: Any, value: Any, gradient: Any,
) -> None:  # fmt: skip
    """Value (n, m) and gradient in space (n, m, 3) of a field with coefficients c at points u.

    `ijk` (cells, 3) and `boxes` (cells, 6) say where cells are, `dofs` (cells, nb) which
    coefficients belong to them, `owner` in which of the cells each point is; one with -1 gets
    NaN. J is (n, 3, 3), or (1, 3, 3) if it is the same everywhere.
    """
    n = t0.shape[1]
    nb = n * n * n
    step = 0 if len(J) == 1 else 1
    T = np.zeros((3, n, LANES))
    B = np.empty((3, 2, LANES))
    N = np.empty(nb + LANES)
    D = np.empty((4, nb))
    G = np.empty((3, 3))
    last = -1
    for q in range(begin, end):
        e = owner[q]
        value[q] = np.nan if e < 0 else 0.0
        gradient[q] = np.nan if e < 0 else 0.0
        if e >= 0:
            if e != last:
                take_tables(t0, t1, t2, ijk, e, T)
                last = e
            lines(T, boxes, e, u, q, B)
            inverse(J, q * step, G)
            values_of(B, n, N, 0)
            gradients_of(B, n, G, D, 0)
            for a in range(nb):
                for m in range(c.shape[1]):
                    x = c[dofs[e, a], m]
                    value[q, m] += N[a] * x
                    for k in range(3):
                        gradient[q, m, k] += D[k, a] * x


@in_ranges(2 * CHUNK)
@outer(nogil=True, **INNER)
def vectors(
    first: int, last: int, t0: Any, t1: Any, t2: Any, ijk: Any, boxes: Any, offsets: Any, u: Any,
    J: Any, f: Any, P: Any, out: Any,
) -> None:  # fmt: skip
    """Sums out (cells, nb, m) over the points of each cell of N f (n, m) + P (n, m, 3) grad N.

    Weights are in f and P already. Either may have no rows, and is then left out.
    """
    n = t0.shape[1]
    nb = n * n * n
    step = 0 if len(J) == 1 else 1
    T = np.zeros((3, n, LANES))
    B = np.empty((3, 2, LANES))
    N = np.empty(nb + LANES)
    D = np.empty((4, nb))
    G = np.empty((3, 3))
    sums = np.empty((out.shape[2], nb))
    for e in range(first, last):
        sums[:] = 0.0
        take_tables(t0, t1, t2, ijk, e, T)
        for q in range(offsets[e], offsets[e + 1]):
            lines(T, boxes, e, u, q, B)
            if len(f):
                values_of(B, n, N, 0)
                for m in range(out.shape[2]):
                    x = f[q, m]
                    for a in range(nb):
                        sums[m, a] += N[a] * x
            if len(P):
                inverse(J, q * step, G)
                gradients_of(B, n, G, D, 0)
                for m in range(out.shape[2]):
                    x = P[q, m, 0]
                    y = P[q, m, 1]
                    z = P[q, m, 2]
                    for a in range(nb):
                        sums[m, a] += x * D[0, a] + y * D[1, a] + z * D[2, a]
        for a in range(nb):
            for m in range(out.shape[2]):
                out[e, a, m] = sums[m, a]
