"""Smoothed aggregation: aggregates, the modes they carry, and the factor of the last matrix.

Guarantees: aggregates are disjoint and connected; every node with a strong coupling, or with any
to such a node, is in one.
"""

from typing import Any

import numpy as np

from ilattice._kernels import in_ranges, inner, outer
from ilattice.linalg._kernels_blocks import FAST, GRAIN

#: A mode counts as dependent on those before it on an aggregate below this part of its length.
DEPENDENT = 1e-8


@outer(error_model="numpy")
def strengths(offsets: Any, columns: Any, blocks: Any, L: Any, out: Any) -> None:
    """Squared Frobenius norm of every block outside the diagonal, 0 on it."""
    m = len(L)
    for i in range(len(offsets) - 1):
        for k in range(offsets[i], offsets[i + 1]):
            v = np.float32(0)
            if columns[k] != i:
                for a in range(m):
                    for b in range(m):
                        v += blocks[k, a, b] * blocks[k, a, b]
            out[k] = v


@in_ranges(4 * GRAIN)
@outer(nogil=True, error_model="numpy")
def greatest(first: int, last: int, offsets: Any, strength: Any, out: Any) -> None:
    """out[i] = greatest strength of the couplings of node i."""
    for i in range(first, last):
        out[i] = 0.0
        for k in range(offsets[i], offsets[i + 1]):
            out[i] = max(out[i], strength[k])


@in_ranges(4 * GRAIN)
@outer(nogil=True, error_model="numpy")
def mark_strong(
    first: int, last: int, offsets: Any, columns: Any, strength: Any, top: Any, least: float,
    share: float, out: Any,
) -> None:  # fmt: skip
    """Which couplings are above `least` and above `share` of the greatest one, `top`, of either."""
    for i in range(first, last):
        for k in range(offsets[i], offsets[i + 1]):
            out[k] = strength[k] > max(least, share * max(top[i], top[columns[k]]))


@in_ranges(2 * GRAIN)
@outer(nogil=True, error_model="numpy")
def nearest(
    first: int, last: int, offsets: Any, columns: Any, points: Any, strong: Any, out: Any
) -> None:
    """out[i] = squared distance of the nearest node with a mark from node i, or infinity."""
    for i in range(first, last):
        out[i] = np.inf
        for k in range(offsets[i], offsets[i + 1]):
            if strong[k]:
                out[i] = min(out[i], squared_distance(points, i, columns[k]))


@in_ranges(2 * GRAIN)
@outer(nogil=True, error_model="numpy")
def unmark_far(
    first: int, last: int, offsets: Any, columns: Any, points: Any, near: Any, most: float,
    strong: Any,
) -> None:  # fmt: skip
    """Unmark couplings to nodes beyond sqrt(`most`) times the nearest one with a mark.

    The nearest one, see `nearest`, of that of the two nodes which has it farther away.
    """
    for i in range(first, last):
        for k in range(offsets[i], offsets[i + 1]):
            j = columns[k]
            if squared_distance(points, i, j) > most * max(near[i], near[j]):
                strong[k] = False


@inner(error_model="numpy")
def squared_distance(points: Any, i: int, j: int) -> float:
    """Between two nodes."""
    x = points[i, 0] - points[j, 0]
    y = points[i, 1] - points[j, 1]
    z = points[i, 2] - points[j, 2]
    return x * x + y * y + z * z


@outer(error_model="numpy")
def aggregate(offsets: Any, columns: Any, strength: Any, strong: Any, out: Any) -> int:
    """Aggregate of every node, -1 for nodes without couplings; the number of them.

    First whole neighbourhoods of strong couplings; then every other node joins the one to which
    its strong coupling is strongest; then what is left, by any coupling in the end: all nodes must
    take part in the motions of the whole.
    """
    n = len(offsets) - 1
    out[:] = -1
    count = 0
    for i in range(n):
        free = out[i] == -1
        size = 0
        for k in range(offsets[i], offsets[i + 1]):
            if strong[k]:
                size += 1
                free = free and out[columns[k]] == -1
        if free and size > 0:
            count = found(i, offsets, columns, strong, count, out)
    for i in range(n):
        if out[i] == -1:
            join = strongest(i, offsets, columns, strength, strong, True, out)
            if join >= 0:
                out[i] = -2 - join
    for i in range(n):
        if out[i] < -1:
            out[i] = -2 - out[i]
    for i in range(n):
        if out[i] == -1:
            out[i] = strongest(i, offsets, columns, strength, strong, True, out)
            if out[i] == -1:
                count = found(i, offsets, columns, strong, count, out)
    for i in range(n):
        if out[i] == -1:
            out[i] = strongest(i, offsets, columns, strength, strong, False, out)
    return count


@inner(error_model="numpy")
def found(i: int, offsets: Any, columns: Any, strong: Any, count: int, out: Any) -> int:
    """Number `count`, for node i and those with strong couplings to it; the number after it."""
    some = False
    for k in range(offsets[i], offsets[i + 1]):
        if strong[k] and out[columns[k]] == -1:
            out[columns[k]] = count
            some = True
    if some:
        out[i] = count
    return count + some


@inner(error_model="numpy")
def strongest(
    i: int, offsets: Any, columns: Any, strength: Any, strong: Any, only: bool, home: Any
) -> int:
    """Aggregate to which a coupling, maybe `only` strong ones, of node i is strongest, or -1."""
    best = np.float32(0)
    out = -1
    for k in range(offsets[i], offsets[i + 1]):
        if (strong[k] or not only) and strength[k] > best and home[columns[k]] >= 0:
            best = strength[k]
            out = home[columns[k]]
    return out


@in_ranges(16)
@outer(nogil=True, error_model="numpy")
def tentative(
    first: int, last: int, offsets: Any, members: Any, modes: Any, L: Any, blocks: Any, coarse: Any
) -> None:
    """Orthonormal modes on every aggregate: blocks (nodes, m, p), and coarse modes (n p, p).

    On the members of an aggregate modes = blocks @ coarse. A dependent mode gets a zero column.
    """
    m = len(L)
    p = modes.shape[1]
    for J in range(first, last):
        rows = members[offsets[J] : offsets[J + 1]]
        n = m * len(rows)
        Q = np.empty((p, n))
        R = coarse[p * J : p * (J + 1)]
        R[:] = 0.0
        for c in range(p):
            for k in range(len(rows)):
                for a in range(m):
                    Q[c, m * k + a] = modes[m * rows[k] + a, c]
            before = np.sqrt(product(Q, c, c))
            for _ in range(2):  # twice is enough
                for d in range(c):
                    v = product(Q, d, c)
                    R[d, c] += v
                    for e in range(n):
                        Q[c, e] -= v * Q[d, e]
            after = np.sqrt(product(Q, c, c))
            if after > DEPENDENT * before:
                R[c, c] = after
                for e in range(n):
                    Q[c, e] /= after
            else:
                Q[c] = 0.0
        for k in range(len(rows)):
            for a in range(m):
                for c in range(p):
                    blocks[rows[k], a, c] = Q[c, m * k + a]


@inner(error_model="numpy")
def product(Q: Any, c: int, d: int) -> float:
    """Scalar product of two rows."""
    out = 0.0
    for e in range(Q.shape[1]):
        out += Q[c, e] * Q[d, e]
    return out


@outer(error_model="numpy", fastmath=FAST)
def cholesky(A: Any, floor: float) -> Any:
    """Factor in the lower triangle of A; the least pivot over its diagonal entry, and where.

    Pivots are at least `floor` times their diagonal entry.
    """
    least = np.inf
    where = -1
    for i in range(len(A)):
        for j in range(i):
            v = 0.0
            for k in range(j):
                v += A[i, k] * A[j, k]
            A[i, j] = (A[i, j] - v) / A[j, j]
        v = 0.0
        for k in range(i):
            v += A[i, k] * A[i, k]
        ratio = (A[i, i] - v) / A[i, i]
        if not ratio >= least:
            least = ratio
            where = i
        A[i, i] = np.sqrt(max(A[i, i] - v, floor * A[i, i]))
    return least, where


@inner(owning=True, error_model="numpy", fastmath=FAST)
def solve_cholesky(F: Any, b: Any, x: Any) -> None:
    """x = (F Fᵀ)⁻¹ b, F lower triangular."""
    n = len(F)
    y = np.empty(n)
    for i in range(n):
        v = 0.0
        for k in range(i):
            v += F[i, k] * y[k]
        y[i] = (b[i] - v) / F[i, i]
    for i in range(n - 1, -1, -1):
        v = y[i] / F[i, i]
        x[i] = v
        for k in range(i):
            y[k] -= v * F[i, k]


@in_ranges(1)
@outer(nogil=True, error_model="numpy")
def solve_rows(first: int, last: int, F: Any, b: Any, x: Any) -> None:
    """As `solve_cholesky`, for all rows of b (r, n)."""
    for r in range(first, last):
        solve_cholesky(F, b[r], x[r])
