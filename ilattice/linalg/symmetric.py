"""Symmetric matrices of small blocks, of which the half on and right of the diagonal is kept.

Guarantees: products have the same bits for any number of threads; what goes in as a whole matrix
comes out of `whole` to the bit if that is symmetric to the bit. Every row has a diagonal block,
which is its first one. Non-guarantee: that matrices given as whole ones are symmetric; see
`ilattice.linalg.solvers`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import bsr_array

from ilattice._typing import AnyArray, FloatArray
from ilattice.linalg import _kernels_products as kq
from ilattice.linalg import _kernels_symmetric as kernels
from ilattice.linalg.blocks import Blocks, offsets_of, product_pattern, together

#: Most parts that rows are cut into for threads; nodes of their sums, over those of the matrix, at
#: most, and rows of a part at least.
PARTS, OVERLAP, ROWS = 64, 2.0, 512


class Graph(NamedTuple):
    """Rows of a whole symmetric matrix.

    Attributes
    ----------
    offsets, columns : ndarray of int32
        As in the BSR format; columns ascend.
    which : ndarray of int32
        Block of each, in the half that is kept, or ~k where it is block k transposed.
    """

    offsets: AnyArray
    columns: AnyArray
    which: AnyArray

    @property
    def blocks(self) -> AnyArray:
        """Block of each column, transposed or not."""
        return np.where(self.which < 0, ~self.which, self.which)

    def pattern(self, other: Blocks) -> tuple[AnyArray, AnyArray]:
        """Offsets and columns of the product with a matrix of blocks."""
        return product_pattern(
            self.offsets, self.columns, other.offsets, other.columns, other.width
        )


@dataclass(frozen=True, eq=False)
class Symmetric:
    """Upper half of a symmetric matrix of blocks.

    Attributes
    ----------
    offsets, columns : ndarray of int32
        As in the BSR format, of blocks on and right of the diagonal, ascending.
    blocks : ndarray, shape (k, m, m)
        The blocks.
    """

    offsets: AnyArray
    columns: AnyArray
    blocks: AnyArray

    @classmethod
    def of(cls, K: Any) -> Symmetric:
        """Half of a whole matrix with sorted columns and a diagonal block in every row.

        Parameters
        ----------
        K : bsr_array
            Square blocks.

        Returns
        -------
        Symmetric
            A copy.
        """
        upper = K.indices >= np.repeat(
            np.arange(len(K.indptr) - 1, dtype=np.int32), np.diff(K.indptr)
        )
        counts = np.add.reduceat(upper, K.indptr[:-1], dtype=np.int32)
        return cls(offsets_of(counts), K.indices[upper], K.data[upper])

    @property
    def rows(self) -> int:
        """Number of block rows."""
        return len(self.offsets) - 1

    @property
    def size(self) -> int:
        """Number of rows and columns of a block."""
        return int(self.blocks.shape[1])

    @property
    def L(self) -> tuple[int, ...]:
        """Tuple of the length of a block, which tells the compiler its size."""
        return (0,) * self.size

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of scalar rows and columns."""
        return self.size * self.rows, self.size * self.rows

    @property
    def couplings(self) -> int:
        """Number of blocks of the whole matrix."""
        return 2 * len(self.columns) - self.rows

    @property
    def nnz(self) -> int:
        """Number of entries of the whole matrix."""
        return self.couplings * self.size**2

    @property
    def diagonal_blocks(self) -> AnyArray:
        """Those on the diagonal (rows, m, m), copied."""
        return self.blocks[self.offsets[:-1]]

    def diagonal(self) -> FloatArray:
        """Entries on the diagonal, shape (n,)."""
        return np.einsum("kaa->ka", self.diagonal_blocks).ravel()

    @cached_property
    def _parts(self) -> tuple[AnyArray, AnyArray]:
        """First rows of parts, and first nodes of their sums; both with one more at the end."""
        last = self.columns[self.offsets[1:] - 1] + 1
        for count in (PARTS >> i for i in range(PARTS.bit_length())):
            shares = np.linspace(0, len(self.columns), count + 1)
            cuts = np.unique(np.searchsorted(self.offsets, shares))
            cuts[0], cuts[-1] = 0, self.rows
            starts = np.append(0, np.cumsum(np.maximum.reduceat(last, cuts[:-1]) - cuts[:-1]))
            if count == 1 or (self.rows >= count * ROWS and starts[-1] <= OVERLAP * self.rows):
                break
        return cuts, starts

    def multiply(self, x: AnyArray, y: AnyArray, sign: float) -> None:
        """y += sign K x, or y = K x for sign 0; vectors (n,), or in rows (r, n)."""
        cuts, starts = self._parts
        count = len(cuts) - 1
        matrix, s = (self.offsets, self.columns, self.blocks), y.dtype.type(sign)
        for given, out in together(x, y):
            sums = np.empty((self.size * int(starts[-1]), given.shape[1]), self.blocks.dtype)
            kernels.multiply(count, cuts, starts, *matrix, given, self.L, sums)
            kernels.add_parts(count, cuts, starts, self.size, sums, s, out)

    def __matmul__(self, x: FloatArray) -> FloatArray:
        """K x for a vector (n,) or columns (n, k)."""
        rows = np.ascontiguousarray(x.T)
        y = np.empty_like(rows)
        self.multiply(rows, y, 0)
        return np.ascontiguousarray(y.T)

    def graph(self) -> Graph:
        """Rows of the whole matrix."""
        counts = np.zeros(self.rows, np.int32)
        kernels.count_whole(self.offsets, self.columns, counts)
        offsets = offsets_of(counts)
        columns, which = np.empty((2, offsets[-1]), np.int32)
        kernels.list_whole(self.offsets, self.columns, offsets[:-1].copy(), columns, which)
        return Graph(offsets, columns, which)

    def times(self, other: Blocks, graph: Graph) -> Blocks:
        """The product, of the type of `other`; `graph` is that of this matrix."""
        offsets, columns = graph.pattern(other)
        blocks = np.empty((offsets[-1], *other.blocks.shape[1:]), other.blocks.dtype)
        self.rows_times(other, graph, 0, self.rows, offsets, columns, blocks)
        return Blocks(offsets, columns, blocks, other.width)

    def rows_times(
        self, other: Blocks, graph: Graph, first: int, last: int, offsets: AnyArray,
        columns: AnyArray, blocks: AnyArray,
    ) -> None:  # fmt: skip
        """Blocks of some rows of the product, whose pattern is known."""
        kq.product(
            kq.PARTS, graph.offsets[first : last + 1], graph.columns, graph.which, self.blocks,
            other.offsets, other.columns, other.blocks, other.width, other.sizes,
            offsets[first : last + 1], columns, blocks,
        )  # fmt: skip

    def whole(self) -> Any:
        """The whole matrix as a `bsr_array`."""
        offsets, columns, which = self.graph()
        return bsr_array((self.taken(which), columns, offsets), shape=self.shape)

    def taken(self, which: AnyArray) -> AnyArray:
        """Blocks of a `Graph`, transposed where they are."""
        below = which < 0
        out = self.blocks[np.where(below, ~which, which)]
        out[below] = out[below].transpose(0, 2, 1)
        return out
