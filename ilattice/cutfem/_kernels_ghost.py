"""Matrices of the jumps of normal derivatives across faces between cells.

Guarantees: a matrix depends on its own face only; the same bits for any number of threads.
"""

from typing import Any

import numpy as np

from ilattice._kernels import in_ranges, inner, outer
from ilattice.bspline._kernels_basis import INNER, line, take_table
from ilattice.bspline._kernels_vector import LANES


@in_ranges(32)
@outer(nogil=True, **INNER)
def ghost_matrices(
    first: int, last: int, axis: int, t1: Any, t2: Any, ijk: Any, nodes: Any, weights: Any,
    products: Any, out: Any,
) -> None:  # fmt: skip
    """Matrices out (faces, n, n), n = m (p + 1)², of penalties on jumps.

    t1 and t2 are the tables of the two directions along the faces, in rising order, and `ijk`
    (faces, 2) the cells there; `weights` (faces, q, q) are those at the tensor points of `nodes`;
    `products` (faces, m, m) are those of the jumps of the functions across.
    """
    n = t1.shape[1]
    m = products.shape[1]
    q = len(nodes)
    across = np.empty(n * n * m, np.int64)
    along = np.empty(n * n * m, np.int64)
    for a in range(n * n * m):
        across[a], along[a] = split(a, axis, n, m)
    T = np.zeros((2, n, LANES))
    B = np.empty((2 * q, 2, LANES))
    M = np.empty((n * n, n * n))
    N = np.empty(n * n)
    for e in range(first, last):
        take_table(t1, ijk[e, 0], T, 0)
        take_table(t2, ijk[e, 1], T, 1)
        for g in range(q):
            line(T, 0, nodes[g] - 0.5, 1.0, B, g)
            line(T, 1, nodes[g] - 0.5, 1.0, B, q + g)
        M[:] = 0.0
        for g in range(q):
            for h in range(q):
                for j in range(n):
                    for k in range(n):
                        N[j * n + k] = B[g, 0, j] * B[q + h, 0, k]
                for a in range(n * n):
                    v = weights[e, g, h] * N[a]
                    for b in range(a, n * n):
                        M[a, b] += v * N[b]
        for a in range(n * n):
            for b in range(a):
                M[a, b] = M[b, a]
        for a in range(n * n * m):
            for b in range(n * n * m):
                out[e, a, b] = products[e, across[a], across[b]] * M[along[a], along[b]]


@inner(**INNER)
def split(a: int, axis: int, n: int, m: int) -> Any:
    """Number across, and number along, of local function a of a face."""
    if axis == 0:
        return a // (n * n), a % (n * n)
    if axis == 1:
        return (a // n) % m, a // (n * m) * n + a % n
    return a % m, a // m
