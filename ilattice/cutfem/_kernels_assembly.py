"""Matrices of cells, and sparse matrices from them: row by row, without atomics.

A cell matrix is a sum over points of products of rows, gathered in tiles that stay in registers.
Elasticity keeps
S = sum w dN/dx_i dN/dx_j of all pairs, which holds for any Lamé constants; they come in when rows
are filled.

Guarantees: a row is summed by one thread in the order of its elements, and both halves of a
matrix by the same operations, so matrices are symmetric to the bit and the same for any number
of threads. Room for all patterns is counted before it is filled.
"""

from typing import Any

import numpy as np

from ilattice._kernels import in_ranges, inner, outer
from ilattice.bspline._kernels_basis import (
    CHUNK,
    INNER,
    gradients_of,
    inverse,
    lines,
    take_tables,
    values_of,
)
from ilattice.bspline._kernels_vector import LANES, load, multiply_add, scale, store

MASS, TENSOR, PAIRS, JETS, STIFFNESS = range(5)  # kinds of cell matrices
SCALAR, ELASTIC, BLOCKS, ENTRIES = range(4)  # kinds of blocks
ROWS = 48  # rows of a cell that are multiplied at once
TILE = 2 * LANES  # columns that are
SHORT = 512  # rows of a sparse matrix that one thread fills at a time
LONG = 4096  # and that it counts


@inner(**INNER)
def add_products(L: Any, R: Any, rows: int, A: Any) -> None:
    """Add R^T L to the upper half of A, in tiles of 4 rows and `TILE` columns.

    L, R and A have a multiple of `TILE` columns; entries just below the diagonal are added to.
    """
    n = A.shape[1]
    for a in range(0, A.shape[0], 4):
        for b in range(a // TILE * TILE, n, TILE):
            at = a * n + b
            a0 = load(A, at, LANES)
            b0 = load(A, at + LANES, LANES)
            a1 = load(A, at + n, LANES)
            b1 = load(A, at + n + LANES, LANES)
            a2 = load(A, at + 2 * n, LANES)
            b2 = load(A, at + 2 * n + LANES, LANES)
            a3 = load(A, at + 3 * n, LANES)
            b3 = load(A, at + 3 * n + LANES, LANES)
            for q in range(rows):
                x = load(L, q * n + b, LANES)
                y = load(L, q * n + b + LANES, LANES)
                r = R[q, a]
                s = R[q, a + 1]
                t = R[q, a + 2]
                u = R[q, a + 3]
                a0 = multiply_add(x, r, a0)
                b0 = multiply_add(y, r, b0)
                a1 = multiply_add(x, s, a1)
                b1 = multiply_add(y, s, b1)
                a2 = multiply_add(x, t, a2)
                b2 = multiply_add(y, t, b2)
                a3 = multiply_add(x, u, a3)
                b3 = multiply_add(y, u, b3)
            store(A, at, a0)
            store(A, at + LANES, b0)
            store(A, at + n, a1)
            store(A, at + n + LANES, b1)
            store(A, at + 2 * n, a2)
            store(A, at + 2 * n + LANES, b2)
            store(A, at + 3 * n, a3)
            store(A, at + 3 * n + LANES, b3)


@inner(**INNER)
def tensor_rows(D: Any, w: float, d: Any, i: int, L: Any, R: Any, row: int) -> None:
    """The three rows of one point from `row` on: grad N, and w d grad N."""
    for a in range(D.shape[1]):
        x = D[0, a]
        y = D[1, a]
        z = D[2, a]
        L[row, a] = x
        L[row + 1, a] = y
        L[row + 2, a] = z
        R[row, a] = w * (d[i, 0] * x + d[i, 5] * y + d[i, 4] * z)
        R[row + 1, a] = w * (d[i, 5] * x + d[i, 1] * y + d[i, 3] * z)
        R[row + 2, a] = w * (d[i, 4] * x + d[i, 3] * y + d[i, 2] * z)


@inner(**INNER)
def strain_rows(D: Any, w: float, d: Any, i: int, L: Any, R: Any, row: int) -> None:
    """The six rows of one point from `row` on: strains of functions along x, then y, then z.

    R is w times the stresses that a stiffness d[i], (36,), makes of them. Rows of L are zero where
    no component has a part in a strain, before and after.
    """
    n = D.shape[1]
    for a in range(n):
        x = D[0, a]
        y = D[1, a]
        z = D[2, a]
        L[row, a] = x
        L[row + 1, n + a] = y
        L[row + 2, 2 * n + a] = z
        L[row + 3, n + a] = z
        L[row + 3, 2 * n + a] = y
        L[row + 4, a] = z
        L[row + 4, 2 * n + a] = x
        L[row + 5, a] = y
        L[row + 5, n + a] = x
        for r in range(6):
            c = 6 * r
            R[row + r, a] = w * (d[i, c] * x + d[i, c + 4] * z + d[i, c + 5] * y)
            R[row + r, n + a] = w * (d[i, c + 1] * y + d[i, c + 3] * z + d[i, c + 5] * x)
            R[row + r, 2 * n + a] = w * (d[i, c + 2] * z + d[i, c + 3] * y + d[i, c + 4] * x)


@inner(**INNER)
def weigh(L: Any, W: Any, rows: int, R: Any) -> None:
    """R[r] = W[r] L[r]."""
    for r in range(rows):
        w = W[r]
        for at in range(r * L.shape[1], (r + 1) * L.shape[1], LANES):
            store(R, at, scale(load(L, at, LANES), w))


@in_ranges(CHUNK)
@outer(nogil=True, **INNER)
def cell_matrices(
    first: int, last: int, kind: int, t0: Any, t1: Any, t2: Any, ijk: Any, boxes: Any,
    offsets: Any, u: Any, w: Any, J: Any, d: Any, out: Any,
) -> None:  # fmt: skip
    """Matrices out (cells, n, n) of the points u (n, 3) with weights w in parameters.

    MASS: d (n, 1) times N N; TENSOR: grad N d grad N with the symmetric tensor d (n, 6) in
    Voigt order; PAIRS: d (n, 1) times the products of all derivatives, that of function a in
    direction i at i nb + a; JETS: likewise with the values as a fourth direction; STIFFNESS:
    strains times the stiffness d (n, 36) times strains, function a along i at i nb + a. J and d
    may have one row for all points.
    """
    n = t0.shape[1]
    size = out.shape[1]
    wide = (size + TILE - 1) // TILE * TILE
    J_step = 0 if len(J) == 1 else 1
    d_step = 0 if len(d) == 1 else 1
    T = np.zeros((3, n, LANES))
    B = np.empty((3, 2, LANES))
    D = np.empty((4, n * n * n))
    G = np.empty((3, 3))
    L = np.zeros((ROWS + 1, wide))  # one more, for what basis functions write behind a row
    R = np.zeros((ROWS, wide))
    W = np.empty(ROWS)
    A = np.empty((wide, wide))
    for e in range(first, last):
        A[:] = 0.0
        rows = 0
        take_tables(t0, t1, t2, ijk, e, T)
        for q in range(offsets[e], offsets[e + 1]):
            lines(T, boxes, e, u, q, B)
            weight = w[q] * abs(inverse(J, q * J_step, G))
            if kind == 1:
                gradients_of(B, n, G, D, 0)
                tensor_rows(D, weight, d, q * d_step, L, R, rows)
                rows += 3
            elif kind == 4:
                gradients_of(B, n, G, D, 0)
                strain_rows(D, weight, d, q * d_step, L, R, rows)
                rows += 6
            else:
                W[rows] = weight * d[q * d_step, 0]
                at = rows * wide
                if kind != 0:
                    gradients_of(B, n, G, L, at)
                    at += 3 * n * n * n
                if kind != 2:
                    values_of(B, n, L, at)
                rows += 1
            if rows == ROWS or q + 1 == offsets[e + 1]:
                if kind != 1 and kind != 4:
                    weigh(L, W, rows, R)
                add_products(L, R, rows, A)
                rows = 0
        for a in range(size):
            for b in range(a, size):
                out[e, a, b] = A[a, b]
                out[e, b, a] = A[a, b]


# ---------------------------------------------------------------------------------- patterns


@outer()
def incidence(dofs: Any, n: int) -> Any:
    """Per node the places (count,) in the flat list of all nodes of elements, and offsets."""
    start = np.zeros(n + 1, np.int64)
    for i in range(len(dofs)):
        start[dofs[i] + 1] += 1
    for i in range(n):
        start[i + 1] += start[i]
    at = start[:-1].copy()
    out = np.empty(len(dofs), np.int64)
    for i in range(len(dofs)):
        out[at[dofs[i]]] = i
        at[dofs[i]] += 1
    return start, out


@in_ranges(1)
@outer(nogil=True)
def count_columns(
    begin: int, end: int, half: bool, start: Any, where: Any, owner: Any, first: Any, dofs: Any,
    chunks: int, count: Any,
) -> None:  # fmt: skip
    """Number of nodes that share an element with each node, itself included.

    With `half` only of those that are not before it. Items are the `chunks` that nodes are cut
    into, each with scratch of their number.
    """
    n = len(start) - 1
    mark = np.full(n, -1, np.int32)
    for chunk in range(begin, end):
        for r in range(chunk * n // chunks, (chunk + 1) * n // chunks):
            found = 0
            for i in range(start[r], start[r + 1]):
                e = owner[where[i]]
                for j in range(first[e], first[e + 1]):
                    if mark[dofs[j]] != r and (dofs[j] >= r or not half):
                        mark[dofs[j]] = r
                        found += 1
            count[r] = found


@in_ranges(1)
@outer(nogil=True)
def list_columns(
    begin: int, end: int, half: bool, start: Any, where: Any, owner: Any, first: Any, dofs: Any,
    chunks: int, indptr: Any, indices: Any,
) -> None:  # fmt: skip
    """The nodes that `count_columns` counts, increasing."""
    n = len(start) - 1
    mark = np.full(n, -1, np.int32)
    for chunk in range(begin, end):
        for r in range(chunk * n // chunks, (chunk + 1) * n // chunks):
            at = indptr[r]
            for i in range(start[r], start[r + 1]):
                e = owner[where[i]]
                for j in range(first[e], first[e + 1]):
                    if mark[dofs[j]] != r and (dofs[j] >= r or not half):
                        mark[dofs[j]] = r
                        indices[at] = dofs[j]
                        at += 1
            indices[indptr[r] : at].sort()


@inner(**INNER)
def add_block(
    kind: int, A: Any, e: int, a: int, b: int, p: float, q: float, out: Any, to: int
) -> None:
    """Add the block of functions a and b of element e to out[to].

    SCALAR: p A[e, a, b] on the diagonal; ELASTIC: that of the Lamé constants p and q from the
    products of derivatives; BLOCKS: p times the block of A itself; ENTRIES: that of A by
    directions, as in PAIRS and JETS.
    """
    m = out.shape[1]
    if kind == 0:
        for i in range(m):
            out[to, i, i] += p * A[e, a, b]
    elif kind == 1:
        n = A.shape[1] // 3
        trace = q * (A[e, a, b] + A[e, n + a, n + b] + A[e, 2 * n + a, 2 * n + b])
        for i in range(3):
            for j in range(3):
                v = p * A[e, i * n + a, j * n + b] + q * A[e, j * n + a, i * n + b]
                if i == j:
                    v += trace
                out[to, i, j] += v
    elif kind == 2:
        for i in range(m):
            for j in range(m):
                out[to, i, j] += p * A[e, m * a + i, m * b + j]
    else:
        n = A.shape[1] // m
        for i in range(m):
            for j in range(m):
                out[to, i, j] += p * A[e, i * n + a, j * n + b]


@in_ranges(SHORT)
@outer(nogil=True, **INNER)
def fill(
    begin: int, end: int, kind: int, start: Any, where: Any, owner: Any, first: Any, dofs: Any,
    slot: Any, reach: int, indptr: Any, indices: Any, A: Any, p: float, q: float, data: Any,
) -> None:  # fmt: skip
    """Add the matrices A[slot[e]] of all elements e with slot[e] >= 0 to data (blocks, m, m).

    `start` and `indptr` are those from the first row on that they add to; no row is longer than
    `reach`, gaps included. What is left of the first column of a row is not kept.
    """
    at = np.empty(reach, np.int64)
    for r in range(begin, end):
        ready = False
        left = indices[indptr[r]]
        for i in range(start[r], start[r + 1]):
            e = owner[where[i]]
            if slot[e] >= 0:
                if not ready:
                    ready = True
                    for k in range(indptr[r], indptr[r + 1]):
                        at[indices[k] - left] = k
                a = where[i] - first[e]
                for j in range(first[e], first[e + 1]):
                    if dofs[j] >= left:
                        to = at[dofs[j] - left]
                        add_block(kind, A, slot[e], a, j - first[e], p, q, data, to)


# ---------------------------------------------------------------------------------- reduction


@in_ranges(LONG)
@outer(nogil=True)
def count_free(
    first: int, last: int, indptr: Any, indices: Any, nodes: Any, place: Any, count: Any
) -> None:
    """Number of blocks of the rows `nodes` in columns with a place."""
    for r in range(first, last):
        for k in range(indptr[nodes[r]], indptr[nodes[r] + 1]):
            count[r] += place[indices[k]] >= 0


@in_ranges(SHORT)
@outer(nogil=True)
def take_free(
    first: int, last: int, indptr: Any, indices: Any, data: Any, nodes: Any, place: Any,
    fixed: Any, diagonal: bool, offsets: Any, columns: Any, blocks: Any,
) -> None:  # fmt: skip
    """The blocks that `count_free` counts, zero in rows and columns of `fixed` components.

    Of these the diagonal entry is kept, or not.
    """
    m = fixed.shape[1]
    for r in range(first, last):
        i = nodes[r]
        to = offsets[r]
        for k in range(indptr[i], indptr[i + 1]):
            j = indices[k]
            if place[j] >= 0:
                columns[to] = place[j]
                for a in range(m):
                    for b in range(m):
                        keep = not (fixed[i, a] or fixed[j, b])
                        keep = keep or (diagonal and i == j and a == b)
                        blocks[to, a, b] = data[k, a, b] if keep else 0.0
                to += 1
