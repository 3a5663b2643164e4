"""Smoothed aggregation: aggregates, the modes they carry, and products of block matrices.

Guarantees: aggregates are disjoint and connected; every node with a strong coupling, or with any
to such a node, is in one. Products
are done row by row, so they have the same bits for any number of threads; the Galerkin product is
symmetric to the last bit.
"""

from typing import Any

import numpy as np
from numba import njit, prange

from ilattice.cutfem._kernels_blocks import FAST

PARTS = 64
#: A mode counts as dependent on those before it on an aggregate below this part of its length.
DEPENDENT = 1e-8


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy", parallel=True)
def mark_strong(
    offsets: Any, columns: Any, strength: Any, least: float, share: float, out: Any
) -> None:
    """Which couplings are above `least` and above `share` of the greatest one of either node."""
    n = len(offsets) - 1
    top = np.zeros(n, np.float32)
    for part in prange(PARTS):
        for i in range(n * part // PARTS, n * (part + 1) // PARTS):
            for k in range(offsets[i], offsets[i + 1]):
                top[i] = max(top[i], strength[k])
    for part in prange(PARTS):
        for i in range(n * part // PARTS, n * (part + 1) // PARTS):
            for k in range(offsets[i], offsets[i + 1]):
                out[k] = strength[k] > max(least, share * max(top[i], top[columns[k]]))


@njit(cache=True, error_model="numpy", parallel=True)
def unmark_far(offsets: Any, columns: Any, places: Any, most: float, strong: Any) -> None:
    """Unmark couplings to nodes beyond sqrt(`most`) times the nearest one with a mark.

    The nearest one of that of the two nodes which has it farther away.
    """
    n = len(offsets) - 1
    near = np.full(n, np.inf)
    for part in prange(PARTS):
        for i in range(n * part // PARTS, n * (part + 1) // PARTS):
            for k in range(offsets[i], offsets[i + 1]):
                if strong[k]:
                    near[i] = min(near[i], squared_distance(places, i, columns[k]))
    for part in prange(PARTS):
        for i in range(n * part // PARTS, n * (part + 1) // PARTS):
            for k in range(offsets[i], offsets[i + 1]):
                j = columns[k]
                if squared_distance(places, i, j) > most * max(near[i], near[j]):
                    strong[k] = False


@njit(cache=True, error_model="numpy")
def squared_distance(places: Any, i: int, j: int) -> float:
    """Between two nodes."""
    x = places[i, 0] - places[j, 0]
    y = places[i, 1] - places[j, 1]
    z = places[i, 2] - places[j, 2]
    return x * x + y * y + z * z


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy", parallel=True)
def tentative(offsets: Any, members: Any, modes: Any, L: Any, blocks: Any, coarse: Any) -> None:
    """Orthonormal modes on every aggregate: blocks (nodes, m, p), and coarse modes (n p, p).

    On the members of an aggregate modes = blocks @ coarse. A dependent mode gets a zero column.
    """
    m = len(L)
    p = modes.shape[1]
    for part in prange(PARTS):
        for J in range(part, len(offsets) - 1, PARTS):
            rows = members[offsets[J] : offsets[J + 1]]
            Q = np.empty((p, m * len(rows)))
            R = coarse[p * J : p * (J + 1)]
            R[:] = 0.0
            for c in range(p):
                for k in range(len(rows)):
                    for a in range(m):
                        Q[c, m * k + a] = modes[m * rows[k] + a, c]
                before = np.sqrt((Q[c] * Q[c]).sum())
                for _ in range(2):  # twice is enough
                    for d in range(c):
                        v = (Q[d] * Q[c]).sum()
                        R[d, c] += v
                        Q[c] -= v * Q[d]
                after = np.sqrt((Q[c] * Q[c]).sum())
                if after > DEPENDENT * before:
                    R[c, c] = after
                    Q[c] /= after
                else:
                    Q[c] = 0.0
            for k in range(len(rows)):
                for a in range(m):
                    for c in range(p):
                        blocks[rows[k], a, c] = Q[c, m * k + a]


@njit(cache=True, error_model="numpy", parallel=True)
def count_product(
    a_offsets: Any, a_columns: Any, b_offsets: Any, b_columns: Any, width: int, out: Any
) -> None:
    """out[i + 1] = number of blocks in row i of A B, B of `width` columns."""
    n = len(a_offsets) - 1
    for part in prange(PARTS):
        seen = np.full(width, -1, np.int32)
        for i in range(n * part // PARTS, n * (part + 1) // PARTS):
            count = 0
            for k in range(a_offsets[i], a_offsets[i + 1]):
                j = a_columns[k]
                for e in range(b_offsets[j], b_offsets[j + 1]):
                    J = b_columns[e]
                    if seen[J] != i:
                        seen[J] = i
                        count += 1
            out[i + 1] = count


@njit(cache=True, error_model="numpy", parallel=True, fastmath=FAST)
def product(
    a_offsets: Any,
    a_columns: Any,
    a_blocks: Any,
    b_offsets: Any,
    b_columns: Any,
    b_blocks: Any,
    width: int,
    S: Any,
    offsets: Any,
    columns: Any,
    blocks: Any,
) -> None:
    """A B, blocks len(S[0]) square times len(S[0]) x len(S[1]); columns of a row as they come."""
    m = len(S[0])
    p = len(S[1])
    n = len(a_offsets) - 1
    for part in prange(PARTS):
        slot = np.full(width, -1, np.int32)
        for i in range(n * part // PARTS, n * (part + 1) // PARTS):
            first = offsets[i]
            to = first
            for k in range(a_offsets[i], a_offsets[i + 1]):
                j = a_columns[k]
                A = a_blocks[k]
                for e in range(b_offsets[j], b_offsets[j + 1]):
                    J = b_columns[e]
                    at = slot[J]
                    if at < first or at >= to or columns[at] != J:
                        at = to
                        to += 1
                        slot[J] = at
                        columns[at] = J
                        blocks[at] = 0.0
                    B = b_blocks[e]
                    C = blocks[at]
                    if m % 3 == 0:
                        for c in range(0, m, 3):
                            for a in range(m):
                                u = A[a, c]
                                v = A[a, c + 1]
                                w = A[a, c + 2]
                                for b in range(p):
                                    C[a, b] += u * B[c, b] + v * B[c + 1, b] + w * B[c + 2, b]
                    else:
                        for c in range(m):
                            for a in range(m):
                                for b in range(p):
                                    C[a, b] += A[a, c] * B[c, b]


@njit(cache=True, error_model="numpy", parallel=True)
def damp(
    offsets: Any, columns: Any, blocks: Any, b_offsets: Any, b_columns: Any, b_blocks: Any, f: Any
) -> None:
    """A = f A + B, where A has all blocks of B."""
    n = len(offsets) - 1
    for part in prange(PARTS):
        for i in range(n * part // PARTS, n * (part + 1) // PARTS):
            for k in range(offsets[i], offsets[i + 1]):
                blocks[k] *= f
                for e in range(b_offsets[i], b_offsets[i + 1]):
                    if b_columns[e] == columns[k]:
                        blocks[k] += b_blocks[e]


@njit(cache=True, error_model="numpy", parallel=True)
def count_galerkin(t_offsets: Any, t_rows: Any, b_offsets: Any, b_columns: Any, out: Any) -> None:
    """out[top + 1] = number of blocks on and right of the diagonal in row I of Tᵀ B."""
    n = len(t_offsets) - 1
    for part in prange(PARTS):
        seen = np.full(n, -1, np.int32)
        for top in range(n * part // PARTS, n * (part + 1) // PARTS):
            count = 0
            for k in range(t_offsets[top], t_offsets[top + 1]):
                i = t_rows[k]
                for e in range(b_offsets[i], b_offsets[i + 1]):
                    J = b_columns[e]
                    if J >= top and seen[J] != top:
                        seen[J] = top
                        count += 1
            out[top + 1] = count


@njit(cache=True, error_model="numpy", parallel=True, fastmath=FAST)
def galerkin(
    t_offsets: Any,
    t_rows: Any,
    t_where: Any,
    t_blocks: Any,
    b_offsets: Any,
    b_columns: Any,
    b_blocks: Any,
    S: Any,
    offsets: Any,
    columns: Any,
    blocks: Any,
) -> None:
    """Blocks of Tᵀ B on and right of the diagonal, columns of a row ascending."""
    m = len(S[0])
    p = len(S[1])
    n = len(t_offsets) - 1
    for part in prange(PARTS):
        slot = np.full(n, -1, np.int32)
        for top in range(n * part // PARTS, n * (part + 1) // PARTS):
            first = offsets[top]
            to = first
            for k in range(t_offsets[top], t_offsets[top + 1]):
                i = t_rows[k]
                for e in range(b_offsets[i], b_offsets[i + 1]):
                    J = b_columns[e]
                    at = slot[J]
                    if J >= top and (at < first or at >= to or columns[at] != J):
                        slot[J] = to
                        columns[to] = J
                        to += 1
            columns[first:to].sort()
            for at in range(first, to):
                slot[columns[at]] = at
                blocks[at] = 0.0
            for k in range(t_offsets[top], t_offsets[top + 1]):
                i = t_rows[k]
                T = t_blocks[t_where[k]]
                for e in range(b_offsets[i], b_offsets[i + 1]):
                    J = b_columns[e]
                    if J < top:
                        continue
                    B = b_blocks[e]
                    C = blocks[slot[J]]
                    if m % 3 == 0:
                        for c in range(0, m, 3):
                            for a in range(p):
                                u = T[c, a]
                                v = T[c + 1, a]
                                w = T[c + 2, a]
                                for b in range(p):
                                    C[a, b] += u * B[c, b] + v * B[c + 1, b] + w * B[c + 2, b]
                    else:
                        for c in range(m):
                            for a in range(p):
                                for b in range(p):
                                    C[a, b] += T[c, a] * B[c, b]


@njit(cache=True, error_model="numpy")
def mirror(
    u_offsets: Any, u_columns: Any, u_blocks: Any, L: Any, offsets: Any, columns: Any, blocks: Any
) -> None:
    """The whole symmetric matrix from its blocks on and right of the diagonal.

    `offsets` (n + 1) are those of the whole. Diagonal entries that are zero become one.
    """
    p = len(L)
    n = len(u_offsets) - 1
    to = offsets[:-1].copy()
    for top in range(n):
        for k in range(u_offsets[top], u_offsets[top + 1]):
            J = u_columns[k]
            at = to[top]
            to[top] += 1
            columns[at] = J
            if J == top:
                for a in range(p):
                    for b in range(a, p):
                        blocks[at, a, b] = u_blocks[k, a, b]
                        blocks[at, b, a] = u_blocks[k, a, b]
                    if blocks[at, a, a] == 0.0:
                        blocks[at, a, a] = 1.0
                continue
            blocks[at] = u_blocks[k]
            at = to[J]
            to[J] += 1
            columns[at] = top
            for a in range(p):
                for b in range(p):
                    blocks[at, b, a] = u_blocks[k, a, b]


@njit(cache=True, error_model="numpy", fastmath=FAST)
def cholesky(A: Any) -> Any:
    """Factor in the lower triangle of A; the least pivot over its diagonal entry, and where."""
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
        A[i, i] = np.sqrt(max(A[i, i] - v, 1e-30 * A[i, i]))
    return least, where


@njit(cache=True, error_model="numpy", fastmath=FAST)
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
