"""Lowest pairs of Hermitian matrices next to each other, by Davidson's method in blocks.

The search starts in a real basis that holds what is known from other wave vectors (`_reduced`), and
grows by preconditioned residuals (E. Davidson, The iterative calculation of a few of the lowest
eigenvalues, 1975). The preconditioner is real, the same for all wave vectors, and sees every
symmetry of the cell, so that the search has to hold something of every band: where the basis is not
enough, random vectors come into it.

Residuals r are measured by r* P r, with the preconditioner P, relative to λ itself: that is about
the part by which λ is too high, however far below the largest eigenvalue it lies. Where P is less
than the inverse, it is corrected by as much. Rounding leaves a part of the energy that x has with
the diagonal of K.

Guarantee: residuals are computed afresh, from the matrix. Non-guarantee: that no eigenvalue has
been passed over; a few vectors beyond those asked for have to settle, too, before pairs count as
found.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from ilattice._typing import AnyArray, FloatArray
from ilattice.errors import ConvergenceError

Vectors = NDArray[np.complex128]
Map = Callable[[Vectors], Vectors]

#: Vectors beyond those asked for, random ones where a basis is not enough, residual of the former
#: with which they have converged.
GUARD, RANDOM, CONVERGED = 4, 2, 3e-2
#: Vectors that are found beside a basis, in blocks, from which on they are cut down to so many.
MAX_VECTORS, KEPT = 16, 3
#: Directions below this part of the others, squared, are no new ones.
NEW = 1e-14
#: Part of the energy of the diagonal that rounding leaves.
ROUNDING = 4.0 * float(np.finfo(float).eps)
#: Values below this many times what rounding leaves are next to zero.
NOISE = 10.0


@dataclass(frozen=True, eq=False)
class Pairs:
    """Lowest eigenpairs.

    Attributes
    ----------
    values : ndarray, shape (b,)
        Ascending, with the guards.
    vectors : ndarray, shape (b, n)
        Rows, orthonormal in the mass.
    residuals : ndarray, shape (b,)
        Root of r* P r / λ, or more: λ is too high by about the square of it, relatively.
    rounding : ndarray, shape (b,)
        Absolute parts of the values that rounding leaves.
    steps : int
        How often the search has grown.
    near : ndarray, shape (c, n)
        Approximations of as many lowest vectors again, and those.
    """

    values: FloatArray
    vectors: Vectors
    residuals: FloatArray
    rounding: FloatArray
    steps: int
    near: Vectors

    def moving(self, count: int) -> AnyArray:
        """Which of the values (count,) are not next to zero."""
        return np.asarray(self.values[:count] > NOISE * self.rounding[:count])

    def lost(self, count: int, rest: bool) -> FloatArray:
        """Parts (count,) of the values that rounding leaves: all, and more, of what it hides.

        Values next to zero are zero at rest.
        """
        values, rounding = self.values[:count], self.rounding[:count]
        part = np.where(values > rounding, rounding / np.maximum(values, 1e-300), 2.0)
        return np.where(self.moving(count) | (not rest), part, 0.0)


@dataclass(frozen=True, eq=False)
class Pencil:
    """Matrices of a search.

    Attributes
    ----------
    K, mass, precondition : callable
        Take rows (k, n), return K, M, and about (K + s M)^-1, of them.
    diagonal : ndarray, shape (n,)
        That of K, or more.
    shift : callable
        Told the largest of the settled values that are asked for, returns s, which may be another
        one from then on.
    part : float
        Of K, in every vector, over the inverse of the preconditioner without s, or less.
    """

    K: Map
    mass: Map
    precondition: Map
    diagonal: FloatArray
    shift: Callable[[float | None], float]
    part: float = 1.0


def lowest(
    pencil: Pencil, basis: FloatArray, reduced: Vectors, noise: Vectors, count: int, tol: float,
    most: int,
) -> Pairs:  # fmt: skip
    """The lowest pairs of K x = λ M x; see `Pairs`.

    Parameters
    ----------
    pencil : Pencil
        K and M.
    basis : ndarray, shape (d, n)
        Rows, orthonormal in the mass; there may be none.
    reduced : ndarray, shape (d, d)
        K on the basis.
    noise : ndarray, shape (r, n)
        What is taken in where the basis is not enough; with it there must be count + GUARD vectors.
    count : int
        How many.
    tol : float
        Residual of those asked for.
    most : int
        Steps.

    Returns
    -------
    Pairs
        Also where `tol` is not reached.
    """
    block = count + GUARD
    space = _Space(pencil.K, pencil.mass, basis, reduced)
    wanted = np.where(np.arange(block) < count, tol, CONVERGED)
    if len(basis) < block:
        space.add(noise)
    measure = _Measure(pencil, count)
    for step in range(most + 1):
        values, S = space.solved(block)
        x = space.combined(S)
        r = pencil.K(x) - values[:, None] * pencil.mass(x)
        w = pencil.precondition(r)
        residuals, rounding = measure.of(values, x, r, w)
        open_ = np.flatnonzero(residuals > allowed(wanted[: len(values)], values, rounding))
        if step == most or not len(open_):
            break
        if len(space.W) + len(open_) > MAX_VECTORS * block:
            space.cut(KEPT * block)
        if measure.moved():
            w = pencil.precondition(r)
        w = w[open_]
        space.add(np.concatenate([w, noise]) if step == 0 and len(basis) >= block else w)
    near = x if step == 0 else space.combined(space.solved(2 * block)[1])
    return Pairs(values, x, residuals, rounding, step, near)


def allowed(tol: Any, values: FloatArray, rounding: FloatArray) -> FloatArray:
    """Residuals that will do: the tolerance, or what rounding leaves of values."""
    return np.fmax(tol, rounding / np.maximum(np.abs(values), 1e-300))


def check(pairs: Pairs, count: int, tol: float, k: FloatArray, remedy: str) -> None:
    """Refuse pairs above the tolerance."""
    if len(pairs.values) < count:
        raise ConvergenceError(
            f"bands at k = {np.round(k, 4).tolist()}: rounding leaves {len(pairs.values)} waves "
            f"apart, fewer than count = {count}; take edges of cells that differ by less"
        )
    bound = allowed(tol, pairs.values, pairs.rounding)
    over = np.flatnonzero(pairs.residuals[:count] > bound[:count])
    if len(over):
        raise ConvergenceError(
            f"bands at k = {np.round(k, 4).tolist()} have a residual of "
            f"{pairs.residuals[over].max():.1e} after {pairs.steps} steps, above tol = {tol:.1e}; "
            f"allow more max_iterations, {remedy}"
        )


class _Measure:
    """How far off values are, by residuals and what the preconditioner makes of them."""

    def __init__(self, pencil: Pencil, count: int) -> None:
        self.pencil, self.count = pencil, count
        self.shift = pencil.shift(None)
        self.last = np.zeros(0), np.zeros(0)

    def of(
        self, values: FloatArray, x: Vectors, r: Vectors, w: Vectors
    ) -> tuple[FloatArray, FloatArray]:
        """Residuals of rows, and what rounding leaves of their values."""
        rounding = ROUNDING * ((np.abs(x) ** 2) @ self.pencil.diagonal)
        energy = np.maximum(np.einsum("ij,ij->i", r.conj(), w).real, 0.0)
        least = np.maximum(np.maximum(values, rounding), 1e-300)
        self.last = least, energy
        factor = max(1.0, self.shift / float(least[-1])) / self.pencil.part
        return np.sqrt(factor * energy / least), rounding

    def moved(self) -> bool:
        """Whether values made another preconditioner: those that are settled by this one."""
        values, energy = (v[: self.count] for v in self.last)
        if len(values) < self.count or (energy > CONVERGED**2 * values).any():
            return False
        before, self.shift = self.shift, self.pencil.shift(float(values[-1]))
        return self.shift != before


class _Space:
    """A basis, and rows W that are found beside it; orthonormal in the mass. H is K on both."""

    def __init__(self, K: Map, mass: Map, basis: FloatArray, reduced: Vectors) -> None:
        self.K, self.mass, self.V, self.H = K, mass, basis, reduced
        self.W: Vectors = np.zeros((0, basis.shape[1]), np.complex128)

    def solved(self, count: int) -> tuple[FloatArray, Vectors]:
        """Lowest pairs of H."""
        last = min(count, len(self.H)) - 1
        found: Any = eigh(self.H, subset_by_index=[0, last], check_finite=False)
        return found[0], found[1]

    def combined(self, S: Vectors) -> Vectors:
        """Combinations of what is there, by the columns of S."""
        d = len(self.V)
        return expanded(S[:d], self.V) + S[d:].T @ self.W

    def add(self, w: Vectors) -> None:
        """Take in rows, as far as they are new."""
        w = w / np.maximum(np.linalg.norm(w, axis=1), 1e-300)[:, None]
        for _ in range(2):
            Mw = self.mass(w)
            a, b = projected(Mw, self.V), self.W.conj() @ Mw.T
            gram = w.conj() @ Mw.T
            least = NEW * float(gram.diagonal().real.max())
            gram = gram - a.conj().T @ a - b.conj().T @ b
            values, vectors = np.linalg.eigh(0.5 * (gram + gram.conj().T))
            new = values > max(least, 1e-300)
            if not new.any():
                return
            w = w - expanded(a, self.V) - b.T @ self.W
            w = (vectors[:, new] / np.sqrt(values[new])).T @ w
        Kw = self.K(w)
        side = np.concatenate([projected(Kw, self.V), self.W.conj() @ Kw.T])
        corner = w.conj() @ Kw.T
        corner = 0.5 * (corner + corner.conj().T)
        self.H = np.block([[self.H, side], [side.conj().T, corner]])
        self.W = np.concatenate([self.W, w])

    def cut(self, count: int) -> None:
        """Of W keep what the lowest vectors have in it."""
        d = len(self.V)
        Q = np.linalg.qr(self.solved(count)[1][d:])[0]
        self.W = Q.T @ self.W
        side, corner = self.H[:d, d:] @ Q, Q.conj().T @ self.H[d:, d:] @ Q
        corner = 0.5 * (corner + corner.conj().T)
        self.H = np.block([[self.H[:d, :d], side], [side.conj().T, corner]])


def projected(x: Vectors, V: FloatArray) -> Vectors:
    """Products (d, k) of real rows V (d, n) and rows x (k, n)."""
    both = V @ np.concatenate([x.real, x.imag]).T
    return np.asarray(both[:, : len(x)] + 1j * both[:, len(x) :])


def expanded(S: Vectors, V: FloatArray) -> Vectors:
    """Combinations (k, n) of real rows V (d, n) by the columns of S (d, k)."""
    both = np.concatenate([S.real, S.imag], axis=1).T @ V
    return np.asarray(both[: S.shape[1]] + 1j * both[S.shape[1] :])


def each_part(function: Callable[[Any], Any], x: Any) -> Any:
    """A real map of complex rows (k, n)."""
    both = function(np.concatenate([x.real, x.imag]))
    return both[: len(x)] + 1j * both[len(x) :]
