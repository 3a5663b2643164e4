"""Moments of a rule, as weights on the Gauss points of whole cells.

Guarantee: polynomials of the degree of the Gauss points minus one per direction keep their
integral over every cell. The same bits for any number of threads.
"""

from typing import Any

import numpy as np

from ilattice._kernels import in_ranges, inner, outer

#: Points that are treated at a time, so that loops over them are long enough for vectors.
CHUNK = 128
FAST = {"contract", "reassoc"}


@inner(fastmath=FAST, error_model="numpy")
def lagrange(t: Any, count: int, nodes: Any, factors: Any, out: Any) -> None:
    """Values out (n, .) at points of the polynomials that are 1 at one node and 0 at all others."""
    for i in range(len(nodes)):
        for p in range(count):
            out[i, p] = factors[i]
        for j in range(len(nodes)):
            if j != i:
                x = nodes[j]
                for p in range(count):
                    out[i, p] *= t[p] - x


@in_ranges(32)
@outer(nogil=True, fastmath=FAST, error_model="numpy")
def project(
    first: int, last: int, points: Any, weights: Any, starts: Any, ends: Any, boxes: Any,
    nodes: Any, out: Any,
) -> None:  # fmt: skip
    """Weights out (cells, n, n, n) on the tensor grid of nodes that keep the moments.

    Points of a cell are those from its start to its end.
    """
    n = len(nodes)
    values = np.empty((3, n, CHUNK))
    row = np.empty(CHUNK)
    factors = np.ones(n)
    for i in range(n):
        for j in range(n):
            if j != i:
                factors[i] /= nodes[i] - nodes[j]
    for cell in range(first, last):
        for at in range(starts[cell], ends[cell], CHUNK):
            count = min(CHUNK, ends[cell] - at)
            for axis in range(3):
                low, size = boxes[cell, axis], 1.0 / boxes[cell, 3 + axis]
                for p in range(count):
                    row[p] = (points[at + p, axis] - low) * size
                lagrange(row, count, nodes, factors, values[axis])
            for i in range(n):
                for j in range(n):
                    for p in range(count):
                        row[p] = weights[at + p] * values[0, i, p] * values[1, j, p]
                    for k in range(n):
                        v = 0.0
                        for p in range(count):
                            v += row[p] * values[2, k, p]
                        out[cell, i, j, k] += v
