"""Basis functions of tensor B-splines in a cell, fields at points, and integrals of vectors.

A direction is a table (cells, p + 1, p + 1) of centred monomial coefficients: of every function
that lives in a cell, in r = (u - middle) / length. Function (i, j, k) of a cell has the local
number (i (p + 1) + j) (p + 1) + k.

Guarantees: one allocation of scratch per chunk; a row depends on its own cell only, so results
have the same bits for any number of threads.
"""

from typing import Any

import numpy as np
from numba import njit, prange

FAST = {"contract"}
INNER: Any = {"cache": True, "fastmath": FAST, "error_model": "numpy"}
CHUNK, LONG = 64, 4096


@njit(**INNER)
def line(table: Any, cell: int, r: float, scale: float, B: Any, a: int) -> None:
    """The functions B[a, 0] of one direction, and derivatives B[a, 1], `scale` being 1 / length."""
    n = table.shape[1]
    for j in range(n):
        f = table[cell, j, n - 1]
        g = 0.0
        for e in range(n - 2, -1, -1):
            g = g * r + f
            f = f * r + table[cell, j, e]
        B[a, 0, j] = f
        B[a, 1, j] = g * scale


@njit(**INNER)
def lines(
    t0: Any, t1: Any, t2: Any, places: Any, boxes: Any, e: int, u: Any, q: int, B: Any
) -> None:
    """Functions B[a, 0] and slopes B[a, 1] of the three directions of cell e at u[q]."""
    x = 1.0 / boxes[e, 3]
    y = 1.0 / boxes[e, 4]
    z = 1.0 / boxes[e, 5]
    line(t0, places[e, 0], (u[q, 0] - boxes[e, 0]) * x - 0.5, x, B, 0)
    line(t1, places[e, 1], (u[q, 1] - boxes[e, 1]) * y - 0.5, y, B, 1)
    line(t2, places[e, 2], (u[q, 2] - boxes[e, 2]) * z - 0.5, z, B, 2)


@njit(**INNER)
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


@njit(parallel=True, **INNER)
def determinants(J: Any, out: Any) -> None:
    """Determinants of matrices J (n, 3, 3)."""
    for chunk in prange((len(J) + LONG - 1) // LONG):
        for q in range(chunk * LONG, min(len(J), (chunk + 1) * LONG)):
            out[q] = (
                J[q, 0, 0] * (J[q, 1, 1] * J[q, 2, 2] - J[q, 1, 2] * J[q, 2, 1])
                + J[q, 0, 1] * (J[q, 1, 2] * J[q, 2, 0] - J[q, 1, 0] * J[q, 2, 2])
                + J[q, 0, 2] * (J[q, 1, 0] * J[q, 2, 1] - J[q, 1, 1] * J[q, 2, 0])
            )


@njit(**INNER)
def values_of(B: Any, N: Any) -> None:
    """All products of the functions of the three directions."""
    n = B.shape[2]
    a = 0
    for i in range(n):
        for j in range(n):
            v = B[0, 0, i] * B[1, 0, j]
            for k in range(n):
                N[a] = v * B[2, 0, k]
                a += 1


@njit(**INNER)
def gradients_of(B: Any, G: Any, D: Any) -> None:
    """Gradients in space, D (3, nb), of all products."""
    n = B.shape[2]
    at = 0
    for i in range(n):
        for j in range(n):
            v = B[0, 0, i] * B[1, 0, j]
            x = B[0, 1, i] * B[1, 0, j]
            y = B[0, 0, i] * B[1, 1, j]
            for k in range(n):
                D[0, at] = x * B[2, 0, k]
                D[1, at] = y * B[2, 0, k]
                D[2, at] = v * B[2, 1, k]
                at += 1
    for a in range(at):  # a loop of its own, which becomes vector instructions
        x = D[0, a]
        y = D[1, a]
        v = D[2, a]
        D[0, a] = x * G[0, 0] + y * G[1, 0] + v * G[2, 0]
        D[1, a] = x * G[0, 1] + y * G[1, 1] + v * G[2, 1]
        D[2, a] = x * G[0, 2] + y * G[1, 2] + v * G[2, 2]


@njit(parallel=True, **INNER)
def fields(
    t0: Any, t1: Any, t2: Any, places: Any, boxes: Any, dofs: Any, owner: Any, u: Any, J: Any,
    c: Any, value: Any, gradient: Any,
) -> None:  # fmt: skip
    """Value (n, m) and gradient in space (n, m, 3) of a field with coefficients c at points u.

    `places` (cells, 3) and `boxes` (cells, 6) say where cells are, `dofs` (cells, nb) which
    coefficients belong to them, `owner` in which of the cells each point is; one with -1 gets
    NaN. J is (n, 3, 3), or (1, 3, 3) if it is the same everywhere.
    """
    n = t0.shape[1]
    nb = n * n * n
    step = 0 if len(J) == 1 else 1
    for chunk in prange((len(u) + CHUNK - 1) // CHUNK):
        B = np.empty((3, 2, n))
        N = np.empty(nb)
        D = np.empty((3, nb))
        G = np.empty((3, 3))
        for q in range(chunk * CHUNK, min(len(u), (chunk + 1) * CHUNK)):
            e = owner[q]
            value[q] = np.nan if e < 0 else 0.0
            gradient[q] = np.nan if e < 0 else 0.0
            if e >= 0:
                lines(t0, t1, t2, places, boxes, e, u, q, B)
                inverse(J, q * step, G)
                values_of(B, N)
                gradients_of(B, G, D)
                for a in range(nb):
                    for m in range(c.shape[1]):
                        x = c[dofs[e, a], m]
                        value[q, m] += N[a] * x
                        for k in range(3):
                            gradient[q, m, k] += D[k, a] * x


@njit(parallel=True, **INNER)
def vectors(
    t0: Any, t1: Any, t2: Any, places: Any, boxes: Any, offsets: Any, u: Any, J: Any, f: Any,
    P: Any, out: Any,
) -> None:  # fmt: skip
    """Sums out (cells, nb, m) over the points of each cell of N f (n, m) + P (n, m, 3) grad N.

    Weights are in f and P already. Either may have no rows, and is then left out.
    """
    n = t0.shape[1]
    nb = n * n * n
    step = 0 if len(J) == 1 else 1
    for chunk in prange((len(places) + CHUNK - 1) // CHUNK):
        B = np.empty((3, 2, n))
        N = np.empty(nb)
        D = np.empty((3, nb))
        G = np.empty((3, 3))
        sums = np.empty((out.shape[2], nb))
        for e in range(chunk * CHUNK, min(len(places), (chunk + 1) * CHUNK)):
            sums[:] = 0.0
            for q in range(offsets[e], offsets[e + 1]):
                lines(t0, t1, t2, places, boxes, e, u, q, B)
                if len(f):
                    values_of(B, N)
                    for m in range(out.shape[2]):
                        x = f[q, m]
                        for a in range(nb):
                            sums[m, a] += N[a] * x
                if len(P):
                    inverse(J, q * step, G)
                    gradients_of(B, G, D)
                    for m in range(out.shape[2]):
                        x = P[q, m, 0]
                        y = P[q, m, 1]
                        z = P[q, m, 2]
                        for a in range(nb):
                            sums[m, a] += x * D[0, a] + y * D[1, a] + z * D[2, a]
            for a in range(nb):
                for m in range(out.shape[2]):
                    out[e, a, m] = sums[m, a]
