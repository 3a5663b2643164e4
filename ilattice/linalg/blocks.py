"""Sparse matrices of small blocks, not square in general: prolongations, and products with them.

Guarantees: products have the same bits for any number of threads, and wherever a vector is among
several.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ilattice._typing import AnyArray
from ilattice.linalg import _kernels_blocks as kb
from ilattice.linalg import _kernels_products as kq
from ilattice.linalg._kernels_rows import LANES


@dataclass(frozen=True, eq=False)
class Blocks:
    """Sparse matrix of blocks (k, m, p), rows as in the BSR format."""

    offsets: AnyArray
    columns: AnyArray
    blocks: AnyArray
    width: int

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of scalar rows and columns."""
        return self.blocks.shape[1] * self.rows, self.blocks.shape[2] * self.width

    @property
    def rows(self) -> int:
        """Number of block rows."""
        return len(self.offsets) - 1

    @cached_property
    def sizes(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Tuples of the lengths of a block, which tell the compiler its size."""
        return (0,) * self.blocks.shape[1], (0,) * self.blocks.shape[2]

    @cached_property
    def transposed(self) -> tuple[AnyArray, AnyArray, AnyArray]:
        """Offsets of the columns, and the row and the index of each of their blocks."""
        order = np.argsort(self.columns, kind="stable").astype(np.int32)
        rows = np.repeat(np.arange(self.rows, dtype=np.int32), np.diff(self.offsets))
        counts = np.bincount(self.columns, minlength=self.width)
        return offsets_of(counts), rows[order], order

    def multiply(self, x: AnyArray, y: AnyArray, sign: float) -> None:
        """y += sign A x, or y = A x for sign 0; vectors (n,), or in rows (r, n)."""
        matrix, s = (self.offsets, self.columns, self.blocks), y.dtype.type(sign)
        for given, out in together(x, y):
            if given.shape[1] == 1:
                kb.multiply(self.rows, *matrix, given[:, 0], out[0], s, *self.sizes)
            else:
                kb.multiply_eight(self.rows, *matrix, given, out, s, *self.sizes)

    def multiply_transposed(self, x: AnyArray, y: AnyArray) -> None:
        """y = Aᵀ x; vectors (n,), or in rows (r, n)."""
        matrix = (*self.transposed, self.blocks)
        for given, out in together(x, y):
            if given.shape[1] == 1:
                kb.multiply_transposed(self.width, *matrix, given[:, 0], out[0], *self.sizes)
            else:
                kb.multiply_eight_transposed(self.width, *matrix, given, out, *self.sizes)


def product_pattern(
    a_offsets: AnyArray, a_columns: AnyArray, b_offsets: AnyArray, b_columns: AnyArray,
    width: int, *, half: bool = False,
) -> tuple[AnyArray, AnyArray]:  # fmt: skip
    """Offsets and columns of a product, counted first; see `_kernels_products.pattern`."""
    both = (a_offsets, a_columns, b_offsets, b_columns, width, half)
    starts, none = np.zeros(len(a_offsets), np.int64), np.empty(0, np.int32)
    kq.pattern(kq.PARTS, *both, starts, none)
    starts = np.cumsum(starts)
    columns = np.empty(starts[-1], np.int32)
    kq.pattern(kq.PARTS, *both, starts, columns)
    return starts.astype(np.int32), columns


def together(x: AnyArray, y: AnyArray) -> Iterator[tuple[AnyArray, AnyArray]]:
    """Vectors of x: one as a column (n, 1), or eight side by side (n, 8); and their rows of y."""
    x, y = np.atleast_2d(x), np.atleast_2d(y)
    if len(x) == 1:
        yield np.ascontiguousarray(x[0])[:, None], y
        return
    for first in range(0, len(x), LANES):
        beside = np.empty((x.shape[1], LANES), x.dtype)
        kb.side_by_side(len(beside), x[first : first + LANES], beside)
        yield beside, y[first : first + LANES]


def offsets_of(counts: AnyArray) -> AnyArray:
    """Where rows of so many begin, and where the last one ends."""
    return np.concatenate([[0], np.cumsum(counts, dtype=np.int64)]).astype(np.int32)
