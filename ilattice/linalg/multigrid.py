"""Multigrid by smoothed aggregation: a preconditioner for stiffness matrices of small blocks.

Nodes are joined into aggregates with their neighbours; on each of these the near-nullspace
(rigid-body modes, or constants) is made orthonormal and becomes the unknowns of the next level,
after one step of damped smoothing (P. Vaněk, J. Mandel, M. Brezina, "Algebraic multigrid by
smoothed aggregation for second and fourth order elliptic problems", Computing 56, 1996). On every
level the matrix is scaled by the Cholesky factors of its diagonal blocks, which have then
disappeared from all else: the Chebyshev smoother of the fourth kind (J. Lottes, "Optimal polynomial
smoothers for multigrid V-cycles", Numerical Linear Algebra with Applications 30, 2023) is block
smoothing. Its blocks are larger where nodes hang on each other, as those of slivers do: few of
their common motions are among those of the next level.

Guarantees: coarse matrices and the factor of the last one are made in double precision, the cycle
runs in single precision; it is symmetric and positive definite up to that rounding. Set-up and
cycle have the same bits for any number of threads. A matrix in which a near-nullspace mode has no
stiffness is refused.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import eigvalsh_tridiagonal

from ilattice._typing import AnyArray, FloatArray
from ilattice.errors import ConvergenceError, InputError
from ilattice.linalg import _kernels_blocks as kb
from ilattice.linalg import _kernels_multigrid as km
from ilattice.linalg import _kernels_patches as kp
from ilattice.linalg import _kernels_products as kq
from ilattice.linalg._kernels_rows import LANES

#: Unknowns of the last level, at most, and when coarsening no longer helps.
COARSEST, DENSE = 900, 4000
#: Degree of the smoother, damping of the prolongation.
DEGREE, DAMPING = 2, 4 / 3
#: Neighbours in an aggregate have couplings above this, relative to the diagonal: in the first
#: level, and in the others, where smoothed modes overlap with many that are far.
WEAK, WEAK_COARSE = 0.02, 0.05
#: And above this part of the greatest coupling of either, so that slivers are joined with each
#: other: they move almost freely, and are not seen in the motions of what they hang on.
STRONG = 0.1
#: And they are nearer than this many times the nearest such node: where cells are stretched, those
#: across the short side are joined first.
FAR = 2.0
#: Nodes hang on each other if their coupling, of a matrix with ones in its diagonal, is above this
#: (Frobenius norm); a patch has as many nodes at most.
TIED, PATCH = 0.6, 16
#: Blocks of a product that is not kept whole, made at a time: some 300 MB of 3 x 6 numbers.
BATCH = 2_000_000
#: Steps of Lanczos' method for a largest eigenvalue: what they miss is within `SAFETY`.
LANCZOS = 16
#: Largest eigenvalues are taken as this much above their estimate.
SAFETY = 1.1
#: A pivot of the last matrix, over its diagonal entry, below which there is a motion for free;
#: each level leaves some 1e-12 there, for its prolongation is in single precision.
SINGULAR = 1e-10
ONE = np.float32(1)


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
        return _offsets(counts), rows[order], order

    def multiply(self, x: AnyArray, y: AnyArray, sign: float) -> None:
        """y += sign A x, or y = A x for sign 0; vectors (n,), or in rows (r, n)."""
        matrix, s = (self.offsets, self.columns, self.blocks), y.dtype.type(sign)
        for rows, given, out in _together(x, y):
            product = kb.multiply_eight if rows else kb.multiply
            product(self.rows, *matrix, given, out, s, *self.sizes)

    def multiply_transposed(self, x: AnyArray, y: AnyArray) -> None:
        """y = Aᵀ x; vectors (n,), or in rows (r, n)."""
        for rows, given, out in _together(x, y):
            product = kb.multiply_eight_transposed if rows else kb.multiply_transposed
            product(self.width, *self.transposed, self.blocks, given, out, *self.sizes)

    def times(self, other: Blocks) -> Blocks:
        """The product, of the type of `other`."""
        offsets, columns = self.pattern(other)
        blocks = np.empty((offsets[-1], *other.blocks.shape[1:]), other.blocks.dtype)
        self.rows_times(other, 0, self.rows, offsets, columns, blocks)
        return Blocks(offsets, columns, blocks, other.width)

    def pattern(self, other: Blocks) -> tuple[AnyArray, AnyArray]:
        """Offsets and columns of the product."""
        return _pattern(self.offsets, self.columns, other.offsets, other.columns, other.width)

    def rows_times(
        self, other: Blocks, first: int, last: int, offsets: AnyArray, columns: AnyArray,
        blocks: AnyArray,
    ) -> None:  # fmt: skip
        """Blocks of some rows of the product, whose pattern is known."""
        kq.product(
            kq.PARTS, self.offsets[first : last + 1], self.columns, self.blocks, other.offsets,
            other.columns, other.blocks, other.width, other.sizes, offsets[first : last + 1],
            columns, blocks,
        )  # fmt: skip


def _pattern(
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


def _together(x: AnyArray, y: AnyArray) -> Iterator[tuple[bool, AnyArray, AnyArray]]:
    """Vectors of x and y: one by itself, or eight side by side (n, 8) and their rows of y."""
    x, y = np.atleast_2d(x), np.atleast_2d(y)
    for first in range(0, len(x), LANES):
        some = x[first : first + LANES]
        if len(x) == 1:
            yield False, np.ascontiguousarray(some[0]), y[first]
        else:
            beside = np.empty((x.shape[1], LANES), x.dtype)
            kb.side_by_side(len(beside), some, beside)
            yield True, beside, y[first : first + LANES]


class Multigrid:
    """Hierarchy of a stiffness matrix, applied as ``z = multigrid(r)``.

    Parameters
    ----------
    K : Blocks
        Symmetric, square blocks (m, m), double precision.
    modes : array_like, shape (n, p)
        Near-nullspace: modes with little energy, such as the rigid-body modes.
    coordinates : ndarray, shape (nodes, 3), optional
        Nodes in space; without them stretched cells are not told from others.

    Raises
    ------
    InputError
        If K has diagonal entries that are not positive.
    ConvergenceError
        If a combination of the modes has no stiffness: K is singular.
    """

    def __init__(self, K: Blocks, modes: FloatArray, coordinates: FloatArray | None = None) -> None:
        self.levels: list[_Level] = []
        A, B, x = K, modes, coordinates
        factors, inverses = _block_factors(A)
        self.scaling = inverses.copy()  # without the factors, which are beside them
        while A.shape[0] > COARSEST:
            scaled = _scaled(A, inverses, np.float32)
            strength = np.empty(len(A.columns), np.float32)
            km.strengths(A.offsets, A.columns, scaled.blocks, A.sizes[0], strength)
            patches = _patches(scaled, strength)
            rho = _largest_eigenvalue(scaled, patches)
            B = _multiply_blocks(factors, B, True, np.empty_like(B))
            home, count = _aggregates(scaled, strength, x, WEAK_COARSE if self.levels else WEAK)
            P, B = _prolongation(scaled, B, rho, home, count)
            x = None if x is None else _means(x, home, count)
            if P.width > 0.7 * A.rows:
                break
            A = _galerkin(A, inverses, P)
            factors, inverses = _block_factors(A)
            kb.scale_columns(len(P.columns), P.columns, P.blocks, inverses, P.sizes)
            self.levels.append(_Level(scaled, P, patches, SAFETY * rho))
        self.factor = _factor(_scaled(A, inverses, np.float64))

    @property
    def nbytes(self) -> int:
        """Bytes that the hierarchy takes, beside K."""
        held = [self.scaling, self.factor]
        for level in self.levels:
            held += [level.A.blocks, level.P.blocks, level.P.columns, *level.P.transposed]
            held += [level.patches.members, level.patches.inverses]
        return sum(a.nbytes for a in held)

    def __call__(self, r: FloatArray) -> FloatArray:
        """Approximate solution of K z = r, in double precision, for vectors (n,) or rows (k, n)."""
        rows = r.reshape(-1, r.shape[-1])
        short, out = np.empty(rows.shape, np.float32), np.empty(rows.shape)
        lengths = [float(np.sqrt(kb.dots(v, v, v)[:, 0].sum())) or 1.0 for v in rows]
        for v, s, length in zip(rows, short, lengths, strict=True):
            _multiply_blocks(self.scaling, (v / length)[:, None], False, s[:, None])
        x = self._cycle(0, short)
        for v, z, length in zip(x, out, lengths, strict=True):
            _multiply_blocks(self.scaling, v[:, None], True, z[:, None])
            z *= length
        return out.reshape(r.shape)

    def _cycle(self, depth: int, r: AnyArray) -> AnyArray:
        """One V-cycle for residuals in rows of r, which is overwritten."""
        x = np.zeros_like(r)
        if depth == len(self.levels):
            km.solve_rows(len(r), self.factor, r, x)
            return x
        level = self.levels[depth]
        level.smooth(r, x, last=False)
        coarse = np.empty((len(r), level.P.shape[1]), np.float32)
        level.P.multiply_transposed(r, coarse)
        step = np.empty_like(r)
        level.P.multiply(self._cycle(depth + 1, coarse), step, 0)
        level.A.multiply(step, r, -1)
        kb.combine(x.size, ONE, step.ravel(), ONE, x.ravel())
        level.smooth(r, x, last=True)
        return x


@dataclass(frozen=True, eq=False)
class _Patches:
    """Sets of nodes, and the inverses of their matrices from `where` on."""

    starts: AnyArray
    members: AnyArray
    where: AnyArray
    inverses: FloatArray

    def solve(self, r: AnyArray, m: int) -> AnyArray:
        """r (k, rows m), on patches multiplied by their inverses: r itself if there are none."""
        if len(self.members) == 0:
            return r
        s = r.copy()
        matrices = (self.starts, self.members, self.where, self.inverses)
        kp.apply(len(self.starts) - 1, *matrices, m, r, s)
        return s


@dataclass(frozen=True, eq=False)
class _Level:
    """A matrix with ones in its diagonal, the prolongation to it, and what its smoother needs.

    `rho` is a bound of the eigenvalues after multiplication by the inverses of the patches.
    """

    A: Blocks
    P: Blocks
    patches: _Patches
    rho: float

    def smooth(self, r: AnyArray, x: AnyArray, *, last: bool) -> None:
        """Add a polynomial in A times r to x; update r, the residual, unless it is the `last`."""
        z = np.zeros_like(r)
        for i in range(1, DEGREE + 1):
            a = np.float32((2 * i - 3) / (2 * i + 1))
            b = np.float32((8 * i - 4) / (2 * i + 1) / self.rho)
            solved = self.patches.solve(r, self.A.blocks.shape[1])
            kb.smooth(z.size, a, z.ravel(), b, solved.ravel(), ONE, x.ravel())
            if not last or i < DEGREE:
                self.A.multiply(z, r, -1)


def _block_factors(A: Blocks) -> tuple[FloatArray, FloatArray]:
    factors, inverses = np.empty((2, A.rows, *A.blocks.shape[1:]))
    state = np.empty(A.rows, np.uint8)
    kb.factors(A.rows, A.offsets, A.columns, A.blocks, A.sizes[0], factors, inverses, state)
    if (state == 2).any():
        i = int(np.argmax(state == 2))
        raise InputError(
            f"K must have a positive diagonal: {int((state == 2).sum())} nodes have not, the "
            f"first is node {i}; drop nodes without stiffness"
        )
    return factors, inverses


def _multiply_blocks(A: FloatArray, x: AnyArray, transposed: bool, y: AnyArray) -> Any:
    kb.multiply_blocks(len(A), A, x, transposed, (0,) * A.shape[1], y)
    return y


def _scaled(A: Blocks, inverses: FloatArray, dtype: Any) -> Blocks:
    out = np.empty(A.blocks.shape, dtype)
    kb.scaled(A.rows, A.offsets, A.columns, A.blocks, inverses, A.sizes[0], out)
    return Blocks(A.offsets, A.columns, out, A.width)


def _patches(A: Blocks, strength: AnyArray) -> _Patches:
    """Nodes that hang on each other, the closest ties first."""
    tied = np.flatnonzero(strength > TIED**2)
    rows = (np.searchsorted(A.offsets, tied, side="right") - 1).astype(np.int32)
    tied, rows = tied[rows < A.columns[tied]], rows[rows < A.columns[tied]]
    order = np.argsort(-strength[tied], kind="stable")
    first = np.empty(A.rows, np.int32)
    kp.join(rows[order], A.columns[tied[order]], PATCH, first)
    size = np.bincount(first, minlength=A.rows)
    inside = np.flatnonzero(size[first] > 1).astype(np.int32)
    members = inside[np.argsort(first[inside], kind="stable")]
    sizes = size[size > 1]
    where = np.concatenate([[0], np.cumsum((A.blocks.shape[1] * sizes) ** 2)])
    out = _Patches(_offsets(sizes), members, where, np.empty(where[-1]))
    matrix = (A.offsets, A.columns, A.blocks)
    kp.invert(len(sizes), *matrix, out.starts, members, where, out.inverses)
    return out


def _largest_eigenvalue(A: Blocks, patches: _Patches) -> float:
    """Estimate from below, for M A, M the inverses of the patches, by steps of Lanczos' method."""
    n, m = A.shape[0], A.blocks.shape[1]
    before, beta = np.zeros(n, np.float32), 0.0
    r = np.sin(1.0 + np.arange(n, dtype=np.float64) ** 2 % 7919).astype(np.float32)
    z = patches.solve(r[None], m)[0]
    length = np.float32(np.sqrt(kb.dots(r, z, z)[:, 0].sum()))
    alphas: list[float] = []
    betas: list[float] = []
    for _ in range(min(LANCZOS, n)):
        v, z = r / length, z / length
        r = np.empty_like(v)
        A.multiply(z, r, 0)
        kb.combine(n, np.float32(-beta), before, ONE, r)
        alphas.append(float(kb.dots(z, r, r)[:, 0].sum()))
        kb.combine(n, np.float32(-alphas[-1]), v, ONE, r)
        z = patches.solve(r[None], m)[0]
        beta = float(np.sqrt(kb.dots(r, z, z)[:, 0].sum()))
        betas.append(beta)
        if beta <= 1e-5 * abs(alphas[0]):
            break
        before, length = v, np.float32(beta)
    return float(eigvalsh_tridiagonal(alphas, betas[: len(alphas) - 1])[-1])


def _aggregates(
    A: Blocks, strength: AnyArray, coordinates: FloatArray | None, least: float
) -> tuple[AnyArray, int]:
    """Aggregate of every node, -1 for nodes without couplings, and their number."""
    strong = np.empty(len(A.columns), np.bool_)
    bound = least**2 * A.blocks.shape[1]
    matrix = (A.offsets, A.columns)
    top = np.empty(A.rows, np.float32)
    km.greatest(A.rows, A.offsets, strength, top)
    km.mark_strong(A.rows, *matrix, strength, top, bound, STRONG**2, strong)
    if coordinates is not None:
        near = np.empty(A.rows)
        km.nearest(A.rows, *matrix, coordinates, strong, near)
        km.unmark_far(A.rows, *matrix, coordinates, near, FAR**2, strong)
    home = np.empty(A.rows, np.int32)
    return home, km.aggregate(A.offsets, A.columns, strength, strong, home)


def _means(coordinates: FloatArray, home: AnyArray, count: int) -> FloatArray:
    """Mean coordinates (count, 3) of the nodes of aggregates."""
    inside = home >= 0
    size = np.bincount(home[inside], minlength=count)
    sums = [np.bincount(home[inside], x[inside], count) for x in coordinates.T]
    return np.stack(sums, axis=1) / size[:, None]


def _prolongation(
    A: Blocks, modes: FloatArray, rho: float, home: AnyArray, count: int
) -> tuple[Blocks, FloatArray]:
    """Smoothed modes on aggregates, single precision, and the modes of the next level."""
    p = modes.shape[1]
    inside = home >= 0
    members = np.argsort(home, kind="stable")[np.count_nonzero(~inside) :]
    blocks, coarse = np.zeros((A.rows, A.blocks.shape[1], p)), np.empty((count * p, p))
    starts = _offsets(np.bincount(home[inside], minlength=count))
    km.tentative(count, starts, members, modes, A.sizes[0], blocks, coarse)
    simple = Blocks(_offsets(inside), home[inside], blocks[inside].astype(np.float32), count)
    P = A.times(simple)
    kq.damp(P.rows, P.offsets, P.columns, P.blocks, simple.offsets, simple.columns, simple.blocks,
            np.float32(-DAMPING / rho))  # fmt: skip
    return P, coarse


def _galerkin(A: Blocks, inverses: FloatArray, P: Blocks) -> Blocks:
    """Pᵀ Â P in double precision, Â the scaled matrix."""
    upper, columns, blocks = _upper_galerkin(A, inverses, P)
    lower = np.bincount(columns, minlength=P.width) - 1
    whole = _offsets(np.diff(upper) + lower)
    full = np.empty((whole[-1], *blocks.shape[1:]))
    out = Blocks(whole, np.empty(whole[-1], np.int32), full, P.width)
    kq.mirror(upper, columns, blocks, P.sizes[1], whole, out.columns, out.blocks)
    return out


def _upper_galerkin(
    A: Blocks, inverses: FloatArray, P: Blocks
) -> tuple[AnyArray, AnyArray, FloatArray]:
    """Offsets, columns and blocks of its upper half, diagonal included."""
    T = Blocks(P.offsets, P.columns, np.empty(P.blocks.shape), P.width)
    kb.scale_rows(P.rows, P.offsets, P.blocks, inverses, P.sizes, T.blocks)
    at, across = A.pattern(T)
    offsets, rows, where = P.transposed
    upper, columns = _pattern(offsets, rows, at, across, P.width, half=True)
    p = P.blocks.shape[2]
    blocks, done = np.zeros((upper[-1], p, p)), offsets[:-1]
    for first, last in _batches(at):
        some = np.empty((at[last] - at[first], *T.blocks.shape[1:]))
        A.rows_times(T, first, last, at, across, some)
        here = P.columns[P.offsets[first] : P.offsets[last]]
        upto = done + np.bincount(here, minlength=P.width).astype(np.int32)
        kq.galerkin(
            kq.PARTS, done, upto, rows, where, T.blocks, at, across, some, int(at[first]),
            P.sizes, upper, columns, blocks,
        )  # fmt: skip
        done = upto
    return upper, columns, blocks


def _batches(offsets: AnyArray) -> Iterator[tuple[int, int]]:
    """Rows, first and behind the last, that have BATCH blocks together, or are one."""
    first, rows = 0, len(offsets) - 1
    while first < rows:
        last = int(np.searchsorted(offsets, offsets[first] + BATCH, side="right")) - 1
        last = max(last, first + 1)
        yield first, last
        first = last


def _factor(A: Blocks) -> FloatArray:
    """Dense Cholesky factor."""
    n = A.shape[0]
    if n > DENSE:
        raise ConvergenceError(
            f"multigrid is left with {n} unknowns that it cannot join: the matrix couples few of "
            "its nodes; use method='superlu'"
        )
    rows, m = np.repeat(np.arange(A.rows), np.diff(A.offsets)), A.blocks.shape[1]
    dense = np.zeros((A.rows, m, A.rows, m))
    dense[rows, :, A.columns, :] = A.blocks
    factor = dense.reshape(n, n)
    least, _ = km.cholesky(factor, 1e-30)
    if not least > SINGULAR:
        raise ConvergenceError(
            f"K is singular: a motion of the whole has {least:.1e} of the stiffness of others; "
            "is every part held against translation and rotation?"
        )
    return factor


def _offsets(counts: AnyArray) -> AnyArray:
    return np.concatenate([[0], np.cumsum(counts, dtype=np.int64)]).astype(np.int32)
