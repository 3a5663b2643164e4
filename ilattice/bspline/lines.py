"""Linear operators that act along one axis of a coefficient or sample tensor.

A separable fit is one `LineOperator` per direction: a sparse matrix (average, transpose of the
collocation matrix, permutation or stencil), followed by a banded solve. They commute, so samples
may be reduced slab by slab.

Guarantees: the same bits for any number of threads; a singular or nearly singular solve is
refused when the operator is made. Non-guarantee: no pivoting; matrices that are neither
totally positive nor positive definite can be refused although they are regular.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import prod

import numpy as np
from scipy.sparse import csr_array, eye_array

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.bspline import _kernels_fit
from ilattice.errors import InputError

#: Least pivot of the equations, relative to their largest entry: below, data do not fix the spline.
_PIVOT = 1e-13


@dataclass(frozen=True)
class BandLU:
    """Factors of a banded matrix with dense last rows and columns, as `_kernels_fit` has them."""

    band: FloatArray
    rows: FloatArray
    cols: FloatArray
    lower: int


NO_SOLVE = BandLU(np.zeros((0, 1)), np.zeros((0, 0)), np.zeros((0, 0)), 0)


@dataclass(frozen=True)
class LineOperator:
    """Sparse matrix (n, N), then a banded solve (n, n), along one axis."""

    shape: tuple[int, int]
    indptr: IntArray
    indices: IntArray
    data: FloatArray
    lu: BandLU

    def along(self, x: FloatArray, axis: int) -> FloatArray:
        """Apply to one axis of a tensor, which gets length n instead of N."""
        x = np.ascontiguousarray(x, np.float64)
        n, size = self.shape
        lead, tail = x.shape[:axis], x.shape[axis + 1 :]
        out = np.empty((prod(lead), n, prod(tail)))
        if out.size:
            lu = self.lu
            _kernels_fit.apply_lines(
                len(out) * out.shape[2],
                frozen(x.reshape(len(out), size, -1)),
                frozen(self.indptr),
                frozen(self.indices),
                frozen(self.data),
                frozen(lu.band),
                frozen(lu.rows),
                frozen(lu.cols),
                lu.lower,
                out,
            )
        return out.reshape((*lead, n, *tail))


def frozen(a: AnyArray) -> AnyArray:
    """A read-only view: kernels are compiled for this type only."""
    view = a.view()
    view.flags.writeable = False
    return view


def apply_all(operators: Sequence[LineOperator], x: FloatArray, first: int = 0) -> FloatArray:
    """Apply one operator per axis, the axes from `first` on, the last axis first."""
    for axis in range(len(operators) - 1, first - 1, -1):
        x = operators[axis].along(x, axis)
    return x


def line_operator(matrix: csr_array, solve: csr_array | None = None) -> LineOperator:
    """Multiplication by `matrix`, followed by the inverse of `solve`.

    Raises
    ------
    InputError
        If `solve` is singular or too near to it.
    """
    m = csr_array(matrix)
    m.sort_indices()
    return LineOperator(
        (int(m.shape[0]), int(m.shape[1])),
        m.indptr.astype(np.int64),
        m.indices.astype(np.int64),
        np.ascontiguousarray(m.data, np.float64),
        NO_SOLVE if solve is None else band_lu(csr_array(solve)),
    )


def identity_operator(n: int, solve: csr_array | None = None) -> LineOperator:
    """The inverse of `solve`, or nothing at all."""
    return line_operator(csr_array(eye_array(n)), solve)


def band_lu(a: csr_array) -> BandLU:
    """Factorise a banded or cyclically banded matrix without pivoting.

    Raises
    ------
    InputError
        If it is singular or too near to it.
    """
    n = a.shape[0]
    coo = a.tocoo()
    i, j = coo.coords[0].astype(np.int64), coo.coords[1].astype(np.int64)
    cyclic = (j - i + n // 2) % n - n // 2
    wraps = bool((np.abs(j - i) > n // 2).any()) and np.abs(cyclic).max() < np.abs(j - i).max()
    shift = cyclic if wraps else j - i
    q = int(np.abs(shift).max(initial=0)) if wraps else 0  # the border takes all that wraps
    core = n - q
    inside = (i < core) & (j < core)
    lower = int(np.maximum(-shift[inside], 0).max(initial=0))
    upper = int(np.maximum(shift[inside], 0).max(initial=0))
    band, rows, cols = np.zeros((n, lower + 1 + upper)), np.zeros((q, n)), np.zeros((n, q))
    band[i[inside], shift[inside] + lower] = coo.data[inside]
    low, right = i >= core, j >= core
    rows[i[low] - core, j[low]] = coo.data[low]
    cols[i[right], j[right] - core] = coo.data[right]
    least = _kernels_fit.factor(band, rows, cols, lower)
    if not least > _PIVOT:
        raise InputError(
            "sites: the equations are singular: every coefficient needs its own site inside the "
            "support of its basis function; take the sites of ilattice.bspline.fit.sites, or "
            "fewer knots"
        )
    return BandLU(band, rows, cols, lower)
