"""Compiled line operators: a sparse matrix and a band solve along one axis of a tensor.

The matrix of the solve is banded, with `q` dense last rows and columns (the border) that
take the wrap-around of a periodic direction. Its LU factors, without pivoting, lie in

    band (n, lower + 1 + upper)   band[i, j - i + lower], factors of the first n - q rows
    rows (q, n)                   the dense last rows of L, left of the diagonal
    cols (n, q)                   the dense last columns, U right of and on the diagonal

Lines are gathered WIDTH at a time into scratch, so that every inner loop is contiguous and
of fixed length whatever the axis.

Guarantee: the same bits for any number of threads. Non-guarantees: arguments are not
checked; without pivoting a matrix must be totally positive or positive definite.
"""

from typing import Any

import numpy as np

from ilattice._kernels import in_ranges, inner, outer

FAST = {"contract", "nsz", "arcp", "reassoc"}
#: Lines of coefficients that are solved together.
WIDTH = 32


@outer()
def factor(band: Any, rows: Any, cols: Any, lower: int) -> float:
    """LU factorisation in place; the least pivot relative to its original diagonal entry."""
    n, q = cols.shape
    core = n - q
    upper = band.shape[1] - lower - 1
    diagonal = np.empty(n)
    for i in range(n):
        diagonal[i] = abs(band[i, lower]) if i < core else abs(cols[i, i - core])
    least = np.inf
    for i in range(n):
        pivot = band[i, lower] if i < core else cols[i, i - core]
        ratio = abs(pivot) / diagonal[i] if diagonal[i] > 0.0 else 0.0
        if not ratio > 0.0:
            return 0.0
        least = min(least, ratio)
        if i < core:
            for r in range(i + 1, min(i + lower, core - 1) + 1):
                f = band[r, i - r + lower] / pivot
                band[r, i - r + lower] = f
                for c in range(i + 1, min(i + upper, core - 1) + 1):
                    band[r, c - r + lower] -= f * band[i, c - i + lower]
                for b in range(q):
                    cols[r, b] -= f * cols[i, b]
        for a in range(max(0, i + 1 - core), q):
            f = rows[a, i] / pivot if i < core else cols[core + a, i - core] / pivot
            rows[a, i] = f
            if i < core:
                for c in range(i + 1, min(i + upper, core - 1) + 1):
                    rows[a, c] -= f * band[i, c - i + lower]
            for b in range(max(0, i + 1 - core), q):
                cols[core + a, b] -= f * cols[i, b]
    return least


@inner(fastmath=FAST)
def subtract(y: Any, i: int, j: int, f: float) -> None:
    """Row i minus f times row j."""
    for w in range(WIDTH):
        y[i, w] -= f * y[j, w]


@inner(fastmath=FAST)
def solve_lines(band: Any, rows: Any, cols: Any, lower: int, y: Any) -> None:
    """Solve in place for WIDTH right-hand sides y (n, WIDTH)."""
    n, q = cols.shape
    core = n - q
    upper = band.shape[1] - lower - 1
    for i in range(core):
        for j in range(max(0, i - lower), i):
            subtract(y, i, j, band[i, j - i + lower])
    for a in range(q):
        for j in range(core + a):
            subtract(y, core + a, j, rows[a, j])
    for i in range(n - 1, -1, -1):
        for b in range(max(0, i + 1 - core), q):
            subtract(y, i, core + b, cols[i, b])
        if i < core:
            for j in range(i + 1, min(i + upper, core - 1) + 1):
                subtract(y, i, j, band[i, j - i + lower])
            d = 1.0 / band[i, lower]
        else:
            d = 1.0 / cols[i, i - core]
        for w in range(WIDTH):
            y[i, w] *= d


@in_ranges(8 * WIDTH)
@outer(nogil=True, error_model="numpy", fastmath=FAST)
def apply_lines(
    first: int,
    last: int,
    x: Any,
    indptr: Any,
    indices: Any,
    data: Any,
    band: Any,
    rows: Any,
    cols: Any,
    lower: int,
    out: Any,
) -> None:
    """Multiply axis 1 of x (outer, N, inner) by a sparse matrix, then solve, into out.

    Of the outer * inner lines those from `first` to below `last`, a multiple of WIDTH. `out` is
    (outer, n, inner); the sparse matrix (n, N) comes as CSR; there is no solve where `cols` has no
    rows.
    """
    size, inner = x.shape[1], x.shape[2]
    n = out.shape[1]
    source = x.reshape(-1)
    target = out.reshape(-1)
    for start in range(first, last, WIDTH):
        count = min(WIDTH, last - start)
        f = np.zeros((size, WIDTH))
        y = np.zeros((n, WIDTH))
        offset = np.zeros(WIDTH, np.int64)
        for w in range(count):
            line = start + w
            offset[w] = (line // inner) * size * inner + line % inner
        for j in range(size):
            for w in range(count):
                f[j, w] = source[offset[w] + j * inner]
        for i in range(n):
            for p in range(indptr[i], indptr[i + 1]):
                a = data[p]
                j = indices[p]
                for w in range(WIDTH):
                    y[i, w] += a * f[j, w]
        if cols.shape[0]:
            solve_lines(band, rows, cols, lower, y)
        for w in range(count):
            line = start + w
            offset[w] = (line // inner) * n * inner + line % inner
        for i in range(n):
            for w in range(count):
                target[offset[w] + i * inner] = y[i, w]
