"""Products of block matrices: smoothed prolongations and the matrices of the next level.

Products are done row by row, so they have the same bits for any number of threads; the Galerkin
product is symmetric to the last bit.
"""

from typing import Any

import numpy as np
from numba import njit

from ilattice._kernels import in_ranges, outer
from ilattice.linalg._kernels_blocks import FAST, GRAIN
from ilattice.linalg._kernels_rows import add_product, add_product_transposed

#: Parts that rows are cut into for threads, each with scratch as long as a row.
PARTS = 64


@njit(inline="always")
def clear(C: Any, at: int, rows: Any, columns: Any) -> None:
    """C[at] = 0, blocks len(rows) x len(columns)."""
    for a in range(len(rows)):
        for b in range(len(columns)):
            C[at, a, b] = 0.0


@in_ranges(1)
@outer(nogil=True, error_model="numpy")
def pattern(
    begin: int, end: int, a_offsets: Any, a_columns: Any, b_offsets: Any, b_columns: Any,
    width: int, half: bool, offsets: Any, columns: Any,
) -> None:  # fmt: skip
    """Columns of row i of A B from columns[offsets[i]] on, B of `width` columns, as they come.

    If there is no room for any, offsets[i + 1] becomes their number. Of a symmetric product `half`
    is enough: those on and right of the diagonal, ascending.
    """
    n = len(a_offsets) - 1
    counting = len(columns) == 0
    seen = np.full(width, -1, np.int32)
    for part in range(begin, end):
        for i in range(n * part // PARTS, n * (part + 1) // PARTS):
            to = 0 if counting else offsets[i]
            for k in range(a_offsets[i], a_offsets[i + 1]):
                j = a_columns[k]
                for e in range(b_offsets[j], b_offsets[j + 1]):
                    J = b_columns[e]
                    if (half and J < i) or seen[J] == i:
                        continue
                    seen[J] = i
                    if not counting:
                        columns[to] = J
                    to += 1
            if counting:
                offsets[i + 1] = to
            elif half:
                columns[offsets[i] : to].sort()


@in_ranges(1)
@outer(nogil=True, error_model="numpy", fastmath=FAST)
def product(
    begin: int,
    end: int,
    a_offsets: Any,
    a_columns: Any,
    which: Any,
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
    """Rows of A B with known columns, blocks len(S[0]) square times len(S[0]) x len(S[1]).

    Block k of A is a_blocks[which[k]], or a_blocks[~which[k]] transposed if that is negative. The
    first of `blocks` is number offsets[0].
    """
    L, R = S
    n = len(a_offsets) - 1
    slot = np.empty(width, np.int64)
    for part in range(begin, end):
        for i in range(n * part // PARTS, n * (part + 1) // PARTS):
            for at in range(offsets[i] - offsets[0], offsets[i + 1] - offsets[0]):
                slot[columns[at + offsets[0]]] = at
                clear(blocks, at, L, R)
            for k in range(a_offsets[i], a_offsets[i + 1]):
                j = a_columns[k]
                w = which[k]
                for e in range(b_offsets[j], b_offsets[j + 1]):
                    at = slot[b_columns[e]]
                    if w >= 0:
                        add_product(blocks, at, a_blocks, w, b_blocks, e, L, L, R)
                    else:
                        add_product_transposed(blocks, at, a_blocks, ~w, b_blocks, e, L, L, R)


@in_ranges(GRAIN)
@outer(nogil=True, error_model="numpy")
def damp(
    first: int, last: int, offsets: Any, columns: Any, blocks: Any, b_offsets: Any,
    b_columns: Any, b_blocks: Any, f: Any,
) -> None:  # fmt: skip
    """A = f A + B, where A has all blocks of B."""
    for i in range(first, last):
        for k in range(offsets[i], offsets[i + 1]):
            for a in range(blocks.shape[1]):
                for b in range(blocks.shape[2]):
                    blocks[k, a, b] *= f
            for e in range(b_offsets[i], b_offsets[i + 1]):
                if b_columns[e] == columns[k]:
                    for a in range(blocks.shape[1]):
                        for b in range(blocks.shape[2]):
                            blocks[k, a, b] += b_blocks[e, a, b]


@in_ranges(1)
@outer(nogil=True, error_model="numpy", fastmath=FAST)
def galerkin(
    begin: int,
    end: int,
    begins: Any,
    ends: Any,
    t_rows: Any,
    t_where: Any,
    t_blocks: Any,
    b_offsets: Any,
    b_columns: Any,
    b_blocks: Any,
    base: int,
    S: Any,
    offsets: Any,
    columns: Any,
    blocks: Any,
) -> None:
    """Add blocks of Tᵀ B with known columns, from the rows begins[I] to ends[I] of column I of T.

    The first of `b_blocks` is number `base`.
    """
    L, R = S
    n = len(begins)
    slot = np.empty(n, np.int64)
    for part in range(begin, end):
        for top in range(n * part // PARTS, n * (part + 1) // PARTS):
            if begins[top] == ends[top]:
                continue
            for at in range(offsets[top], offsets[top + 1]):
                slot[columns[at]] = at
            for k in range(begins[top], ends[top]):
                i = t_rows[k]
                q = t_where[k]
                for e in range(b_offsets[i], b_offsets[i + 1]):
                    J = b_columns[e]
                    if J < top:
                        continue
                    e0 = e - base
                    add_product_transposed(blocks, slot[J], t_blocks, q, b_blocks, e0, R, L, R)
