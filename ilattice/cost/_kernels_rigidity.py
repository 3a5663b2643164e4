"""Rigidity matrices: rows of all edges, and products without a matrix.

The row of the edge (i, j) has x_i - x_j at i and x_j - x_i at j.

Guarantees: sums are taken in the order of the edges; nothing is allocated per edge.
"""

from typing import Any

from ilattice._kernels import outer

FAST = {"contract", "nsz"}


@outer(fastmath=FAST)
def fill(x: Any, edges: Any, indptr: Any, indices: Any, data: Any) -> None:
    """Rows of the matrix in compressed form, with columns in rising order."""
    d = x.shape[1]
    for e in range(len(edges)):
        i, j = edges[e, 0], edges[e, 1]
        first, second = (i, j) if i < j else (j, i)
        at = 2 * d * e
        indptr[e] = at
        for a in range(d):
            w = x[first, a] - x[second, a]
            indices[at + a], indices[at + d + a] = d * first + a, d * second + a
            data[at + a], data[at + d + a] = w, -w
    indptr[len(edges)] = 2 * d * len(edges)


@outer(fastmath=FAST)
def stretch(x: Any, edges: Any, u: Any, out: Any) -> None:
    """Product with motions u (n, d): half the rates (e,) of squared lengths."""
    if x.shape[1] == 3:
        for e in range(len(edges)):
            i, j = edges[e, 0], edges[e, 1]
            out[e] = (
                (x[i, 0] - x[j, 0]) * (u[i, 0] - u[j, 0])
                + (x[i, 1] - x[j, 1]) * (u[i, 1] - u[j, 1])
                + (x[i, 2] - x[j, 2]) * (u[i, 2] - u[j, 2])
            )
        return
    for e in range(len(edges)):
        i, j = edges[e, 0], edges[e, 1]
        a = (x[i, 0] - x[j, 0]) * (u[i, 0] - u[j, 0])
        out[e] = a + (x[i, 1] - x[j, 1]) * (u[i, 1] - u[j, 1])


@outer(fastmath=FAST)
def gather(x: Any, edges: Any, s: Any, out: Any) -> None:
    """Product of the transposed matrix with force densities s (e,): forces (n, d), added."""
    three = x.shape[1] == 3
    for e in range(len(edges)):
        i, j, w = edges[e, 0], edges[e, 1], s[e]
        f, g = w * (x[i, 0] - x[j, 0]), w * (x[i, 1] - x[j, 1])
        out[i, 0] += f
        out[i, 1] += g
        out[j, 0] -= f
        out[j, 1] -= g
        if three:
            h = w * (x[i, 2] - x[j, 2])
            out[i, 2] += h
            out[j, 2] -= h
