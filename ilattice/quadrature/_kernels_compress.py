"""Moments of a rule, as weights on the Gauss points of whole cells.

Guarantee: polynomials of the degree of the Gauss points minus one per direction keep their
integral over every cell. The same bits for any number of threads.
"""

from typing import Any

import numpy as np
from numba import njit, prange


@njit(cache=True, error_model="numpy")
def lagrange(t: float, nodes: Any, out: Any) -> None:
    """Values at t of the polynomials that are 1 at one node and 0 at all others."""
    for i in range(len(nodes)):
        v = 1.0
        for j in range(len(nodes)):
            if j != i:
                v *= (t - nodes[j]) / (nodes[i] - nodes[j])
        out[i] = v


@njit(cache=True, error_model="numpy", parallel=True)
def project(points: Any, weights: Any, offsets: Any, boxes: Any, nodes: Any, out: Any) -> None:
    """Weights out (cells, n, n, n) on the tensor grid of nodes that keep the moments."""
    n = len(nodes)
    for cell in prange(len(boxes)):
        a = np.empty(n)
        b = np.empty(n)
        c = np.empty(n)
        for p in range(offsets[cell], offsets[cell + 1]):
            lagrange((points[p, 0] - boxes[cell, 0]) / boxes[cell, 3], nodes, a)
            lagrange((points[p, 1] - boxes[cell, 1]) / boxes[cell, 4], nodes, b)
            lagrange((points[p, 2] - boxes[cell, 2]) / boxes[cell, 5], nodes, c)
            for i in range(n):
                x = weights[p] * a[i]
                for j in range(n):
                    y = x * b[j]
                    for k in range(n):
                        out[cell, i, j, k] += y * c[k]
