"""Compiled comparison of feet with those of neighbouring queries."""

import numpy as np

from ilattice._kernels import in_ranges, outer


@in_ranges(4096)
@outer(nogil=True, error_model="numpy")
def compare(first, last, x, foot, least, strides, best, pick):
    """Nearest foot (n, 3) of neighbours for the queries x (n, 3), where it is nearer than `best`.

    Queries are compared with those `strides` rows before and behind. Where a foot is nearer than
    best[i] less `least`, `best` becomes its distance, and pick[i] its row.
    """
    n = len(x)
    for i in range(first, last):
        b = best[i] - least[i]
        for s in strides:
            j = i + s
            if j < 0 or j >= n:
                continue
            d0, d1, d2 = x[i, 0] - foot[j, 0], x[i, 1] - foot[j, 1], x[i, 2] - foot[j, 2]
            d = d0 * d0 + d1 * d1 + d2 * d2
            if d < b * b and b > 0.0:
                b = np.sqrt(d)
                best[i] = b
                pick[i] = j
