"""Sparse matrices of small square blocks, and long vectors: products, sums, scaling.

A matrix is `offsets` (rows + 1), `columns` (blocks) and `blocks` (blocks, m, m), as in scipy's BSR
format. `L` is a tuple of length m: the size of a block is then known to the compiler.

Products take vectors as rows (r, n), and go through the matrix once for all of them.

Guarantees: every row, and every chunk of a sum, is done by one thread in a fixed order, so the
results have the same bits for any number of threads. Products of single precision stay in it;
sums are kept in double precision.
"""

from typing import Any

import numpy as np
from numba import njit, prange

#: Rows that a thread takes at once: of matrices, and of vectors.
ROWS = 32
CHUNK = 4096
FAST = {"contract", "nsz", "reassoc"}
#: A pivot of a diagonal block, scaled to ones on its diagonal, counts as zero below this.
NO_PIVOT = 1e-12


@njit(cache=True, error_model="numpy", parallel=True, fastmath=FAST)
def multiply3(offsets: Any, columns: Any, blocks: Any, x: Any, y: Any, sign: Any) -> None:
    """y += sign K x (or y = K x for sign 0), blocks 3 x 3, vectors in rows of x (r, n)."""
    n = len(offsets) - 1
    threes = len(x) - len(x) % 3
    for chunk in prange((n + ROWS - 1) // ROWS):
        for r in range(0, threes, 3):
            p, q, s = x[r], x[r + 1], x[r + 2]
            f, g, h = y[r], y[r + 1], y[r + 2]
            for i in range(chunk * ROWS, min(n, (chunk + 1) * ROWS)):
                _rows3(offsets, columns, blocks, i, p, q, s, f, g, h, sign)
        for r in range(threes, len(x)):
            p, f = x[r], y[r]
            for i in range(chunk * ROWS, min(n, (chunk + 1) * ROWS)):
                _row3(offsets, columns, blocks, i, p, f, sign)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _row3(offsets: Any, columns: Any, blocks: Any, i: int, x: Any, y: Any, sign: Any) -> None:
    """Row i of the product with one vector."""
    a = x.dtype.type(0)
    b = x.dtype.type(0)
    c = x.dtype.type(0)
    for k in range(offsets[i], offsets[i + 1]):
        j = 3 * columns[k]
        u = x[j]
        v = x[j + 1]
        w = x[j + 2]
        a += blocks[k, 0, 0] * u + blocks[k, 0, 1] * v + blocks[k, 0, 2] * w
        b += blocks[k, 1, 0] * u + blocks[k, 1, 1] * v + blocks[k, 1, 2] * w
        c += blocks[k, 2, 0] * u + blocks[k, 2, 1] * v + blocks[k, 2, 2] * w
    _add3(y, 3 * i, sign, a, b, c)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _rows3(
    offsets: Any, columns: Any, blocks: Any, i: int, x: Any, y: Any, z: Any,
    f: Any, g: Any, h: Any, sign: Any,
) -> None:  # fmt: skip
    """Row i of the products f, g, h with three vectors: nine sums stay in registers."""
    zero = x.dtype.type(0)
    f0, f1, f2, g0, g1, g2, h0, h1, h2 = zero, zero, zero, zero, zero, zero, zero, zero, zero
    for k in range(offsets[i], offsets[i + 1]):
        j = 3 * columns[k]
        for b in range(3):
            u, v, w = blocks[k, 0, b], blocks[k, 1, b], blocks[k, 2, b]
            p, q, r = x[j + b], y[j + b], z[j + b]
            f0 += u * p
            f1 += v * p
            f2 += w * p
            g0 += u * q
            g1 += v * q
            g2 += w * q
            h0 += u * r
            h1 += v * r
            h2 += w * r
    _add3(f, 3 * i, sign, f0, f1, f2)
    _add3(g, 3 * i, sign, g0, g1, g2)
    _add3(h, 3 * i, sign, h0, h1, h2)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _add3(y: Any, i: int, sign: Any, a: Any, b: Any, c: Any) -> None:
    """Three sums into y, as `multiply3` says."""
    if sign == 0:
        y[i] = a
        y[i + 1] = b
        y[i + 2] = c
    else:
        y[i] += sign * a
        y[i + 1] += sign * b
        y[i + 2] += sign * c


@njit(cache=True, error_model="numpy", parallel=True, fastmath=FAST)
def multiply6(offsets: Any, columns: Any, blocks: Any, x: Any, y: Any, sign: Any, L: Any) -> None:
    """y += sign K x (or y = K x for sign 0), blocks 3 x 6 or 6 x 6."""
    m = len(L)
    n = len(offsets) - 1
    for chunk in prange((n + ROWS - 1) // ROWS):
        for r in range(len(x)):
            for i in range(chunk * ROWS, min(n, (chunk + 1) * ROWS)):
                for h in range(0, m, 3):
                    a = x.dtype.type(0)
                    b = x.dtype.type(0)
                    c = x.dtype.type(0)
                    for k in range(offsets[i], offsets[i + 1]):
                        j = 6 * columns[k]
                        s = x[r, j]
                        t = x[r, j + 1]
                        u = x[r, j + 2]
                        v = x[r, j + 3]
                        w = x[r, j + 4]
                        z = x[r, j + 5]
                        A = blocks[k, h]
                        B = blocks[k, h + 1]
                        C = blocks[k, h + 2]
                        a += A[0] * s + A[1] * t + A[2] * u + A[3] * v + A[4] * w + A[5] * z
                        b += B[0] * s + B[1] * t + B[2] * u + B[3] * v + B[4] * w + B[5] * z
                        c += C[0] * s + C[1] * t + C[2] * u + C[3] * v + C[4] * w + C[5] * z
                    e = m * i + h
                    if sign == 0:
                        y[r, e] = a
                        y[r, e + 1] = b
                        y[r, e + 2] = c
                    else:
                        y[r, e] += sign * a
                        y[r, e + 1] += sign * b
                        y[r, e + 2] += sign * c


@njit(cache=True, error_model="numpy", parallel=True, fastmath=FAST)
def multiply(offsets: Any, columns: Any, blocks: Any, x: Any, y: Any, sign: Any, S: Any) -> None:
    """y += sign K x (or y = K x for sign 0), blocks len(S[0]) x len(S[1])."""
    m = len(S[0])
    p = len(S[1])
    n = len(offsets) - 1
    for chunk in prange((n + ROWS - 1) // ROWS):
        for r in range(len(x)):
            for i in range(chunk * ROWS, min(n, (chunk + 1) * ROWS)):
                for a in range(m):
                    v = x.dtype.type(0)
                    for k in range(offsets[i], offsets[i + 1]):
                        j = p * columns[k]
                        for b in range(p):
                            v += blocks[k, a, b] * x[r, j + b]
                    if sign == 0:
                        y[r, m * i + a] = v
                    else:
                        y[r, m * i + a] += sign * v


@njit(cache=True, error_model="numpy", parallel=True, fastmath=FAST)
def multiply_transposed6(
    offsets: Any, rows: Any, where: Any, blocks: Any, x: Any, y: Any, L: Any
) -> None:
    """y = Pᵀ x for blocks len(L) x 6; column J has blocks where[k] in rows[k]."""
    m = len(L)
    n = len(offsets) - 1
    for chunk in prange((n + ROWS - 1) // ROWS):
        for r in range(len(x)):
            for J in range(chunk * ROWS, min(n, (chunk + 1) * ROWS)):
                a = x.dtype.type(0)
                b = x.dtype.type(0)
                c = x.dtype.type(0)
                d = x.dtype.type(0)
                e = x.dtype.type(0)
                f = x.dtype.type(0)
                for k in range(offsets[J], offsets[J + 1]):
                    for q in range(m):
                        v = x[r, m * rows[k] + q]
                        B = blocks[where[k], q]
                        a += B[0] * v
                        b += B[1] * v
                        c += B[2] * v
                        d += B[3] * v
                        e += B[4] * v
                        f += B[5] * v
                y[r, 6 * J] = a
                y[r, 6 * J + 1] = b
                y[r, 6 * J + 2] = c
                y[r, 6 * J + 3] = d
                y[r, 6 * J + 4] = e
                y[r, 6 * J + 5] = f


@njit(cache=True, error_model="numpy", parallel=True, fastmath=FAST)
def multiply_transposed(
    offsets: Any, rows: Any, where: Any, blocks: Any, x: Any, y: Any, S: Any
) -> None:
    """y = Pᵀ x for blocks len(S[0]) x len(S[1]), otherwise like `multiply_transposed6`."""
    m = len(S[0])
    p = len(S[1])
    n = len(offsets) - 1
    for chunk in prange((n + ROWS - 1) // ROWS):
        for r in range(len(x)):
            for J in range(chunk * ROWS, min(n, (chunk + 1) * ROWS)):
                for b in range(p):
                    v = x.dtype.type(0)
                    for k in range(offsets[J], offsets[J + 1]):
                        for a in range(m):
                            v += blocks[where[k], a, b] * x[r, m * rows[k] + a]
                    y[r, p * J + b] = v


@njit(cache=True, error_model="numpy", parallel=True, fastmath=FAST)
def dots(x: Any, y: Any, z: Any) -> Any:
    """Scalar products x y and x z, one row per chunk."""
    n = len(x)
    out = np.empty(((n + CHUNK - 1) // CHUNK, 2))
    for chunk in prange(len(out)):
        a = 0.0
        b = 0.0
        for i in range(chunk * CHUNK, min(n, (chunk + 1) * CHUNK)):
            v = np.float64(x[i])
            a += v * y[i]
            b += v * z[i]
        out[chunk, 0] = a
        out[chunk, 1] = b
    return out


@njit(cache=True, error_model="numpy", parallel=True, fastmath=FAST)
def combine(a: Any, x: Any, b: Any, y: Any) -> None:
    """y = a x + b y."""
    n = len(x)
    for chunk in prange((n + CHUNK - 1) // CHUNK):
        for i in range(chunk * CHUNK, min(n, (chunk + 1) * CHUNK)):
            y[i] = a * x[i] + b * y[i]


@njit(cache=True, error_model="numpy", parallel=True, fastmath=FAST)
def smooth(a: Any, z: Any, b: Any, r: Any, c: Any, x: Any) -> None:
    """z = a z + b r, then x += c z."""
    n = len(x)
    for chunk in prange((n + CHUNK - 1) // CHUNK):
        for i in range(chunk * CHUNK, min(n, (chunk + 1) * CHUNK)):
            v = a * z[i] + b * r[i]
            z[i] = v
            x[i] += c * v


@njit(cache=True, error_model="numpy", parallel=True)
def factors(offsets: Any, columns: Any, blocks: Any, L: Any, roots: Any, inverses: Any) -> Any:
    """Cholesky factors (rows, m, m) of the diagonal blocks, and their inverses.

    Where a block has a pivot next to zero, its diagonal alone is used. Returns per row whether
    that was so (1), or a diagonal entry is not positive (2).
    """
    m = len(L)
    n = len(offsets) - 1
    state = np.zeros(n, np.uint8)
    for chunk in prange((n + ROWS - 1) // ROWS):
        for i in range(chunk * ROWS, min(n, (chunk + 1) * ROWS)):
            F = roots[i]
            F[:] = 0.0
            at = -1
            for k in range(offsets[i], offsets[i + 1]):
                if columns[k] == i:
                    at = k
            for a in range(m):
                if at < 0 or not blocks[at, a, a] > 0.0:
                    state[i] = 2
            if state[i] == 2:
                for a in range(m):
                    F[a, a] = 1.0
            else:
                state[i] = _cholesky(blocks[at], F, m)
            _invert(F, inverses[i], m)
    return state


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy", parallel=True)
def scaled(offsets: Any, columns: Any, blocks: Any, G: Any, L: Any, out: Any) -> None:
    """out = G_i K_ij G_jᵀ, rounded to what out is."""
    m = len(L)
    n = len(offsets) - 1
    for chunk in prange((n + ROWS - 1) // ROWS):
        half = np.empty((m, m))
        for i in range(chunk * ROWS, min(n, (chunk + 1) * ROWS)):
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


@njit(cache=True, error_model="numpy", parallel=True)
def multiply_blocks(A: Any, x: Any, transposed: bool, L: Any, y: Any) -> None:
    """y_i = A_i x_i, or A_iᵀ x_i, of vectors or rows (m rows, p)."""
    m = len(L)
    p = x.shape[1]
    for chunk in prange((len(A) + ROWS - 1) // ROWS):
        for i in range(chunk * ROWS, min(len(A), (chunk + 1) * ROWS)):
            for a in range(m):
                for q in range(p):
                    v = 0.0
                    for b in range(m):
                        v += (A[i, b, a] if transposed else A[i, a, b]) * x[m * i + b, q]
                    y[m * i + a, q] = v


@njit(cache=True, error_model="numpy", parallel=True)
def scale_rows(offsets: Any, blocks: Any, G: Any, S: Any, out: Any) -> None:
    """out = G_iᵀ P_ij, G lower triangular."""
    m = len(S[0])
    p = len(S[1])
    n = len(offsets) - 1
    for chunk in prange((n + ROWS - 1) // ROWS):
        for i in range(chunk * ROWS, min(n, (chunk + 1) * ROWS)):
            for k in range(offsets[i], offsets[i + 1]):
                for a in range(m):
                    for b in range(p):
                        v = 0.0
                        for c in range(a, m):
                            v += G[i, c, a] * blocks[k, c, b]
                        out[k, a, b] = v


@njit(cache=True, error_model="numpy", parallel=True)
def scale_columns(columns: Any, blocks: Any, G: Any, S: Any) -> None:
    """P_ij = P_ij G_jᵀ in place, G lower triangular."""
    m = len(S[0])
    p = len(S[1])
    n = len(columns)
    for chunk in prange((n + ROWS - 1) // ROWS):
        for k in range(chunk * ROWS, min(n, (chunk + 1) * ROWS)):
            j = columns[k]
            for a in range(m):
                for b in range(p - 1, -1, -1):
                    v = 0.0
                    for c in range(b + 1):
                        v += blocks[k, a, c] * G[j, b, c]
                    blocks[k, a, b] = v
