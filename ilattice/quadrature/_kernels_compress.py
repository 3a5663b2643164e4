"""Moments of a rule, as weights on the Gauss points of whole cells.

Guarantee: polynomials of the degree of the Gauss points minus one per direction keep their
integral over every cell. The same bits for any number of threads.
"""

from typing import Any

import numpy as np

from ilattice._kernels import in_ranges, inner, outer
from ilattice.bspline._kernels_vector import LANES, load, multiply_add, scale, store


@inner(error_model="numpy")
def lagrange(t: float, nodes: Any, factors: Any, out: Any) -> None:
    """Values at t of the polynomials that are 1 at one node and 0 at all others."""
    n = len(nodes)
    v = 1.0
    for i in range(n):
        out[i] = factors[i] * v
        v *= t - nodes[i]
    v = 1.0
    for i in range(n - 1, -1, -1):
        out[i] *= v
        v *= t - nodes[i]


@in_ranges(32)
@outer(nogil=True, error_model="numpy")
def project(
    first: int, last: int, points: Any, weights: Any, starts: Any, ends: Any, boxes: Any,
    nodes: Any, out: Any,
) -> None:  # fmt: skip
    """Weights out (cells, n, n, n) on the tensor grid of nodes that keep the moments.

    Points of a cell are those from its start to its end.
    """
    n = len(nodes)
    wide = (n + LANES - 1) // LANES * LANES
    factors = np.ones(n)  # of the polynomials
    for i in range(n):
        for j in range(n):
            if j != i:
                factors[i] /= nodes[i] - nodes[j]
    a = np.empty(n)
    b = np.empty(n)
    c = np.zeros(wide)  # zeros at the end fill vectors up
    sums = np.empty((n, n, wide))
    for cell in range(first, last):
        sums[:] = 0.0
        for p in range(starts[cell], ends[cell]):
            lagrange((points[p, 0] - boxes[cell, 0]) / boxes[cell, 3], nodes, factors, a)
            lagrange((points[p, 1] - boxes[cell, 1]) / boxes[cell, 4], nodes, factors, b)
            lagrange((points[p, 2] - boxes[cell, 2]) / boxes[cell, 5], nodes, factors, c)
            for k in range(0, wide, LANES):
                row = scale(load(c, k, LANES), weights[p])
                for i in range(n):
                    plane = scale(row, a[i])
                    for j in range(n):
                        at = (i * n + j) * wide + k
                        store(sums, at, multiply_add(plane, b[j], load(sums, at, LANES)))
        for i in range(n):
            for j in range(n):
                for k in range(n):
                    out[cell, i, j, k] = sums[i, j, k]
