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
from typing import Any

import numpy as np
from scipy.linalg import eigvalsh_tridiagonal

from ilattice._typing import AnyArray, FloatArray
from ilattice.errors import ConvergenceError, InputError
from ilattice.linalg import _kernels_blocks as kb
from ilattice.linalg import _kernels_multigrid as km
from ilattice.linalg import _kernels_patches as kp
from ilattice.linalg import _kernels_products as kq
from ilattice.linalg.blocks import Blocks, offsets_of, product_pattern
from ilattice.linalg.symmetric import Graph, Symmetric

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
#: Blocks of a product that is not kept whole, made at a time: some 70 MB of 3 x 6 numbers.
BATCH = 500_000
#: Steps of Lanczos' method for a largest eigenvalue: what they miss is within `SAFETY`.
LANCZOS = 16
#: Largest eigenvalues are taken as this much above their estimate.
SAFETY = 1.1
#: A pivot of the last matrix, over its diagonal entry, below which there is a motion for free;
#: each level leaves some 1e-12 there, for its prolongation is in single precision.
SINGULAR = 1e-10
ONE = np.float32(1)
#: Powers of two up to which a matrix, and the roots of its entries, fit into single precision.
LARGE = 100


class Multigrid:
    """Hierarchy of a stiffness matrix, applied as ``z = multigrid(r)``.

    Parameters
    ----------
    K : Symmetric
        Double precision.
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

    def __init__(
        self, K: Symmetric, modes: FloatArray, coordinates: FloatArray | None = None
    ) -> None:
        self.levels: list[_Level] = []
        A, B, x = K, modes, coordinates
        power = int(np.frexp(np.abs(K.diagonal()).max(initial=0.0))[1])
        self._unit = 1.0
        if abs(power) > LARGE:
            self._unit = float(np.ldexp(1.0, -power))
            A = Symmetric(K.offsets, K.columns, K.blocks * self._unit)
        factors, inverses = _block_factors(A)
        self.scaling = inverses
        while A.shape[0] > COARSEST:
            scaled = _scaled(A, inverses, np.float32)
            strength = _strengths(scaled)
            patches, graph = _patches(scaled, strength), A.graph()
            strength = strength[graph.blocks]
            rho = _largest_eigenvalue(scaled, patches)
            B = _multiply_blocks(factors, B, True, np.empty_like(B))
            weak = A.size * (WEAK_COARSE if self.levels else WEAK) ** 2
            home, count = _aggregates(graph, strength, x, weak)
            P, B = _prolongation(scaled, graph, B, rho, home, count)
            x = None if x is None else _means(x, home, count)
            if P.width > 0.7 * A.rows:
                break
            del strength, factors, home, scaled  # which would be beside products of three matrices
            coarse = _galerkin(A, graph, inverses, P)
            scaled, A = _scaled(A, inverses, np.float32), coarse
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
            z *= length * self._unit
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

    A: Symmetric
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


def _block_factors(A: Symmetric) -> tuple[FloatArray, FloatArray]:
    shape = (A.rows, *A.blocks.shape[1:])
    factors, inverses = np.empty(shape), np.empty(shape)  # not views of one that is kept with both
    state = np.empty(A.rows, np.uint8)
    kb.factors(A.rows, A.offsets, A.columns, A.blocks, A.L, factors, inverses, state)
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


def _scaled(A: Symmetric, inverses: FloatArray, dtype: Any) -> Symmetric:
    out = np.empty(A.blocks.shape, dtype)
    kb.scaled(A.rows, A.offsets, A.columns, A.blocks, inverses, A.L, out)
    return Symmetric(A.offsets, A.columns, out)


def _strengths(A: Symmetric) -> AnyArray:
    out = np.empty(len(A.columns), np.float32)
    km.strengths(A.offsets, A.columns, A.blocks, A.L, out)
    return out


def _patches(A: Symmetric, strength: AnyArray) -> _Patches:
    """Nodes that hang on each other, the closest ties first."""
    tied = np.flatnonzero(strength > TIED**2)
    rows = (np.searchsorted(A.offsets, tied, side="right") - 1).astype(np.int32)
    order = np.argsort(-strength[tied], kind="stable")
    first = np.empty(A.rows, np.int32)
    kp.join(rows[order], A.columns[tied[order]], PATCH, first)
    size = np.bincount(first, minlength=A.rows)
    inside = np.flatnonzero(size[first] > 1).astype(np.int32)
    members = inside[np.argsort(first[inside], kind="stable")]
    sizes = size[size > 1]
    where = np.concatenate([[0], np.cumsum((A.blocks.shape[1] * sizes) ** 2)])
    out = _Patches(offsets_of(sizes), members, where, np.empty(where[-1]))
    matrix = (A.offsets, A.columns, A.blocks)
    kp.invert(len(sizes), *matrix, out.starts, members, where, out.inverses)
    return out


def _largest_eigenvalue(A: Symmetric, patches: _Patches) -> float:
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
    graph: Graph, strength: AnyArray, coordinates: FloatArray | None, weak: float
) -> tuple[AnyArray, int]:
    """Aggregate of every node, -1 for nodes without couplings, and their number.

    They are in the order of their first nodes, so that couplings are between near numbers.
    """
    strong, rows = np.empty(len(graph.columns), np.bool_), len(graph.offsets) - 1
    matrix = (graph.offsets, graph.columns)
    top = np.empty(rows, np.float32)
    km.greatest(rows, graph.offsets, strength, top)
    km.mark_strong(rows, *matrix, strength, top, weak, STRONG**2, strong)
    if coordinates is not None:
        near = np.empty(rows)
        km.nearest(rows, *matrix, coordinates, strong, near)
        km.unmark_far(rows, *matrix, coordinates, near, FAR**2, strong)
    home = np.empty(rows, np.int32)
    count = km.aggregate(*matrix, strength, strong, home)
    inside = np.flatnonzero(home >= 0)
    first, number = np.empty((2, count), np.int32)
    first[home[inside[::-1]]] = inside[::-1]
    number[np.argsort(first)] = np.arange(count)
    home[inside] = number[home[inside]]
    return home, count


def _means(coordinates: FloatArray, home: AnyArray, count: int) -> FloatArray:
    """Mean coordinates (count, 3) of the nodes of aggregates."""
    inside = home >= 0
    size = np.bincount(home[inside], minlength=count)
    sums = [np.bincount(home[inside], x[inside], count) for x in coordinates.T]
    return np.stack(sums, axis=1) / size[:, None]


def _prolongation(
    A: Symmetric, graph: Graph, modes: FloatArray, rho: float, home: AnyArray, count: int
) -> tuple[Blocks, FloatArray]:
    """Smoothed modes on aggregates, single precision, and the modes of the next level."""
    p = modes.shape[1]
    inside = home >= 0
    members = np.argsort(home, kind="stable")[np.count_nonzero(~inside) :]
    blocks, coarse = np.zeros((A.rows, A.size, p)), np.empty((count * p, p))
    starts = offsets_of(np.bincount(home[inside], minlength=count))
    km.tentative(count, starts, members, modes, A.L, blocks, coarse)
    simple = Blocks(offsets_of(inside), home[inside], blocks[inside].astype(np.float32), count)
    P = A.times(simple, graph)
    kq.damp(P.rows, P.offsets, P.columns, P.blocks, simple.offsets, simple.columns, simple.blocks,
            np.float32(-DAMPING / rho))  # fmt: skip
    return P, coarse


def _galerkin(A: Symmetric, graph: Graph, inverses: FloatArray, P: Blocks) -> Symmetric:
    """Tᵀ A T in double precision; zeros on its diagonal become ones.

    T is Gᵀ P of the inverse factors G, rounded to single precision as P is: about Pᵀ Â P of the
    scaled matrix Â, and positive definite as A is.
    """
    T = Blocks(P.offsets, P.columns, np.empty_like(P.blocks), P.width)
    kb.scale_rows(P.rows, P.offsets, P.blocks, inverses, P.sizes, T.blocks)
    at, across = graph.pattern(T)
    offsets, rows, where = P.transposed
    upper, columns = product_pattern(offsets, rows, at, across, P.width, half=True)
    p = P.blocks.shape[2]
    blocks, done = np.zeros((upper[-1], p, p)), offsets[:-1]
    for first, last in _batches(at):
        some = np.empty((at[last] - at[first], *T.blocks.shape[1:]))  # double precision
        A.rows_times(T, graph, first, last, at, across, some)
        here = P.columns[P.offsets[first] : P.offsets[last]]
        upto = done + np.bincount(here, minlength=P.width).astype(np.int32)
        kq.galerkin(
            kq.PARTS, done, upto, rows, where, T.blocks, at, across, some, int(at[first]),
            P.sizes, upper, columns, blocks,
        )  # fmt: skip
        done = upto
    own = blocks[upper[:-1]]
    own = np.triu(own) + np.triu(own, 1).transpose(0, 2, 1)
    own[(own == 0.0) & np.eye(p, dtype=bool)] = 1.0
    blocks[upper[:-1]] = own
    return Symmetric(upper, columns, blocks)


def _batches(offsets: AnyArray) -> Iterator[tuple[int, int]]:
    """Rows, first and behind the last, that have BATCH blocks together, or are one."""
    first, rows = 0, len(offsets) - 1
    while first < rows:
        last = int(np.searchsorted(offsets, offsets[first] + BATCH, side="right")) - 1
        last = max(last, first + 1)
        yield first, last
        first = last


def _factor(A: Symmetric) -> FloatArray:
    """Dense Cholesky factor."""
    n = A.shape[0]
    if n > DENSE:
        raise ConvergenceError(
            f"multigrid is left with {n} unknowns that it cannot join: the matrix couples few of "
            "its nodes; use method='superlu'"
        )
    rows, m = np.repeat(np.arange(A.rows), np.diff(A.offsets)), A.size
    dense = np.zeros((A.rows, m, A.rows, m))
    dense[A.columns, :, rows, :] = A.blocks.transpose(0, 2, 1)  # of which the lower half is read
    factor = dense.reshape(n, n)
    least, _ = km.cholesky(factor, 1e-30)
    if not least > SINGULAR:
        raise ConvergenceError(
            f"K is singular: a motion of the whole has {least:.1e} of the stiffness of others; "
            "is every part held against translation and rotation?"
        )
    return factor
