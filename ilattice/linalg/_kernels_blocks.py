"""Sparse matrices of small square blocks, and long vectors: products, sums, scaling.

A matrix is `offsets` (rows + 1), `columns` (blocks) and `blocks` (blocks, m, m), as in scipy's BSR
format. `L` is a tuple of length m: the size of a block is then known to the compiler.

Products go through the matrix once for a vector, or for eight side by side.

Kernels of long vectors take slices, as compilers do not know that `first` is not negative: with
that question at every number they would go through them one by one.

Guarantees: every row, and every chunk of a sum, is done by one thread in a fixed order, so the
results have the same bits for any number of threads. Products of single precision stay in it;
sums are kept in double precision.
"""

from typing import Any

import numpy as np

from ilattice._kernels import in_ranges, inner, outer
from ilattice._typing import AnyArray, FloatArray
from ilattice.linalg._kernels_rows import (
    LANES,
    column,
    column_of_eight,
    row,
    row_of_eight,
)

#: Rows of a matrix that are multiplied before they are added to a vector; a multiple of them, of
#: matrices and of vectors, that a thread takes at once.
ROWS, GRAIN, LONG = 32, 1024, 65536
#: Numbers of vectors in a sum.
CHUNK = 4096
FAST = {"contract", "nsz", "reassoc"}
#: A pivot of a diagonal block, scaled to ones on its diagonal, counts as zero below this.
NO_PIVOT = 1e-12


@in_ranges(GRAIN)
@outer(nogil=True, error_model="numpy")
def multiply(
    begin: int, end: int, offsets: Any, columns: Any, blocks: Any, x: Any, y: Any, sign: Any,
    M: Any, P: Any,
) -> None:  # fmt: skip
    """y += sign K x (or y = K x for sign 0), blocks len(M) x len(P)."""
    m = len(M)
    sums = np.empty(m * ROWS, x.dtype)
    for first in range(begin, end, ROWS):
        last = min(end, first + ROWS)
        for i in range(first, last):
            row(
                offsets[i], offsets[i + 1], columns, columns, blocks, x, M, P, sums, m * (i - first)
            )
        for e in range(m * (last - first)):
            if sign == 0:
                y[m * first + e] = sums[e]
            else:
                y[m * first + e] += sign * sums[e]


@in_ranges(GRAIN // 2)
@outer(nogil=True, error_model="numpy")
def multiply_eight(
    begin: int, end: int, offsets: Any, columns: Any, blocks: Any, x: Any, y: Any, sign: Any,
    M: Any, P: Any,
) -> None:  # fmt: skip
    """The same for the first of eight vectors side by side in x (n, 8), and rows of y."""
    m = len(M)
    sums = np.empty((m * ROWS, LANES), x.dtype)
    for first in range(begin, end, ROWS):
        last = min(end, first + ROWS)
        for i in range(first, last):
            row_of_eight(
                offsets[i], offsets[i + 1], columns, columns, blocks, x, M, P, sums, m * (i - first)
            )
        for r in range(len(y)):
            for e in range(m * (last - first)):
                if sign == 0:
                    y[r, m * first + e] = sums[e, r]
                else:
                    y[r, m * first + e] += sign * sums[e, r]


@in_ranges(GRAIN // 2)
@outer(nogil=True, error_model="numpy")
def multiply_transposed(
    first: int, last: int, offsets: Any, rows: Any, where: Any, blocks: Any, x: Any, y: Any,
    M: Any, P: Any,
) -> None:  # fmt: skip
    """y = Pᵀ x, blocks len(M) x len(P); column J has blocks where[k] in rows[k]."""
    p = len(P)
    for J in range(first, last):
        column(offsets[J], offsets[J + 1], rows, where, blocks, x, M, P, y, p * J)


@in_ranges(GRAIN // 4)
@outer(nogil=True, error_model="numpy")
def multiply_eight_transposed(
    begin: int, end: int, offsets: Any, rows: Any, where: Any, blocks: Any, x: Any, y: Any,
    M: Any, P: Any,
) -> None:  # fmt: skip
    """The same for the first of eight vectors side by side in x (n, 8), and rows of y."""
    p = len(P)
    sums = np.empty((p * ROWS, LANES), x.dtype)
    for first in range(begin, end, ROWS):
        last = min(end, first + ROWS)
        for J in range(first, last):
            column_of_eight(
                offsets[J], offsets[J + 1], rows, where, blocks, x, M, P, sums, p * (J - first)
            )
        for r in range(len(y)):
            for e in range(p * (last - first)):
                y[r, p * first + e] = sums[e, r]


@in_ranges(LONG // LANES)
@outer(nogil=True, error_model="numpy")
def side_by_side(first: int, last: int, x: Any, out: Any) -> None:
    """Numbers of vectors (r, n), at most eight, in rows of out (n, 8); zeros for those missing."""
    x, out = x[:, first:last], out[first:last]
    for i in range(len(out)):
        for r in range(LANES):
            out[i, r] = x[r, i] if r < len(x) else 0


@in_ranges(LONG // CHUNK)
@outer(nogil=True, error_model="numpy", fastmath=FAST)
def dots_of_chunks(first: int, last: int, x: Any, y: Any, z: Any, out: Any) -> None:
    """Scalar products x y and x z, one row of out (chunks, 2) per chunk."""
    for chunk in range(first, last):
        begin, end = chunk * CHUNK, min(len(x), (chunk + 1) * CHUNK)
        p, q, r = x[begin:end], y[begin:end], z[begin:end]
        a = 0.0
        b = 0.0
        for i in range(len(p)):
            v = np.float64(p[i])
            a += v * q[i]
            b += v * r[i]
        out[chunk, 0] = a
        out[chunk, 1] = b


def dots(x: AnyArray, y: AnyArray, z: AnyArray) -> FloatArray:
    """Scalar products x y and x z, one row per chunk."""
    out = np.empty((-(-len(x) // CHUNK), 2))
    dots_of_chunks(len(out), x, y, z, out)
    return out


@in_ranges(LONG)
@outer(nogil=True, error_model="numpy", fastmath=FAST)
def combine(first: int, last: int, a: Any, x: Any, b: Any, y: Any) -> None:
    """y = a x + b y."""
    x, y = x[first:last], y[first:last]
    for i in range(len(y)):
        y[i] = a * x[i] + b * y[i]


@in_ranges(LONG)
@outer(nogil=True, error_model="numpy", fastmath=FAST)
def smooth(first: int, last: int, a: Any, z: Any, b: Any, r: Any, c: Any, x: Any) -> None:
    """z = a z + b r, then x += c z."""
    z, r, x = z[first:last], r[first:last], x[first:last]
    for i in range(len(z)):
        v = a * z[i] + b * r[i]
        z[i] = v
        x[i] += c * v


@in_ranges(GRAIN)
@outer(nogil=True, error_model="numpy")
def factors(
    first: int, last: int, offsets: Any, columns: Any, blocks: Any, L: Any, roots: Any,
    inverses: Any, state: Any,
) -> None:  # fmt: skip
    """Cholesky factors (rows, m, m) of the diagonal blocks, and their inverses.

    Where a block has a pivot next to zero, its diagonal alone is used. `state` becomes per row
    whether that was so (1), or a diagonal entry is not positive (2), or neither (0).
    """
    m = len(L)
    for i in range(first, last):
        F = roots[i]
        F[:] = 0.0
        at = -1
        for k in range(offsets[i], offsets[i + 1]):
            if columns[k] == i:
                at = k
        state[i] = 0
        for a in range(m):
            if at < 0 or not blocks[at, a, a] > 0.0:
                state[i] = 2
        if state[i] == 2:
            for a in range(m):
                F[a, a] = 1.0
        else:
            state[i] = _cholesky(blocks[at], F, m)
        _invert(F, inverses[i], m)


@inner(error_model="numpy")
def _cholesky(A: Any, F: Any, m: int) -> int:
    for a in range(m):
        for b in range(a):
            v = A[a, b]
            for c in range(b):
                v -= F[a, c] * F[b, c]
            F[a, b] = v / F[b, b]
        v = A[a, a]
        for c in range(a):
            v -= F[a, c] * F[a, c]
        if not v > NO_PIVOT * A[a, a]:
            F[:] = 0.0
            for b in range(m):
                F[b, b] = np.sqrt(A[b, b])
            return 1
        F[a, a] = np.sqrt(v)
    return 0


@inner(error_model="numpy")
def _invert(F: Any, G: Any, m: int) -> None:
    """G = F⁻¹, lower triangular."""
    for b in range(m):
        for a in range(m):
            if a < b:
                G[a, b] = 0.0
            elif a == b:
                G[a, b] = 1.0 / F[a, a]
            else:
                v = 0.0
                for c in range(b, a):
                    v -= F[a, c] * G[c, b]
                G[a, b] = v / F[a, a]


@in_ranges(GRAIN // 4)
@outer(nogil=True, error_model="numpy")
def scaled(
    first: int, last: int, offsets: Any, columns: Any, blocks: Any, G: Any, L: Any, out: Any
) -> None:
    """out = G_i K_ij G_jᵀ, rounded to what out is."""
    m = len(L)
    half = np.empty((m, m))
    for i in range(first, last):
        for k in range(offsets[i], offsets[i + 1]):
            j = columns[k]
            for a in range(m):
                for b in range(m):
                    v = 0.0
                    for c in range(a + 1):
                        v += G[i, a, c] * blocks[k, c, b]
                    half[a, b] = v
            for a in range(m):
                for b in range(m):
                    v = 0.0
                    for c in range(b + 1):
                        v += half[a, c] * G[j, b, c]
                    out[k, a, b] = v


@in_ranges(LONG // 16)
@outer(nogil=True, error_model="numpy")
def multiply_blocks(
    first: int, last: int, A: Any, x: Any, transposed: bool, L: Any, y: Any
) -> None:
    """y_i = A_i x_i, or A_iᵀ x_i, of vectors or rows (m rows, p)."""
    m = len(L)
    p = x.shape[1]
    A, x, y = A[first:last], x[m * first : m * last], y[m * first : m * last]
    for i in range(len(A)):
        for q in range(p):
            if transposed:
                for a in range(m):
                    v = 0.0
                    for b in range(m):
                        v += A[i, b, a] * x[m * i + b, q]
                    y[m * i + a, q] = v
            else:
                for a in range(m):
                    v = 0.0
                    for b in range(m):
                        v += A[i, a, b] * x[m * i + b, q]
                    y[m * i + a, q] = v


@in_ranges(GRAIN)
@outer(nogil=True, error_model="numpy")
def scale_rows(first: int, last: int, offsets: Any, blocks: Any, G: Any, S: Any, out: Any) -> None:
    """out = G_iᵀ P_ij, G lower triangular."""
    m = len(S[0])
    p = len(S[1])
    for i in range(first, last):
        for k in range(offsets[i], offsets[i + 1]):
            for a in range(m):
                for b in range(p):
                    v = 0.0
                    for c in range(a, m):
                        v += G[i, c, a] * blocks[k, c, b]
                    out[k, a, b] = v


@in_ranges(2 * GRAIN)
@outer(nogil=True, error_model="numpy")
def scale_columns(first: int, last: int, columns: Any, blocks: Any, G: Any, S: Any) -> None:
    """P_ij = P_ij G_jᵀ in place, G lower triangular; items are blocks."""
    m = len(S[0])
    p = len(S[1])
    for k in range(first, last):
        j = columns[k]
        for a in range(m):
            for b in range(p - 1, -1, -1):
                v = 0.0
                for c in range(b + 1):
                    v += blocks[k, a, c] * G[j, b, c]
                blocks[k, a, b] = v
