"""Lowest pairs of Hermitian matrices next to each other, by Davidson's method in blocks.

The search starts in a real basis that holds what is known from other wave vectors (`_reduced`), and
grows by preconditioned residuals (E. Davidson, The iterative calculation of a few of the lowest
eigenvalues, 1975). The preconditioner is real, the same for all wave vectors, and sees every
symmetry of the cell, so that the search has to hold something of every band: where the basis is not
enough, random vectors come into it.

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

from ilattice._typing import FloatArray

Vectors = NDArray[np.complex128]
Map = Callable[[Vectors], Vectors]

#: Vectors beyond those asked for, random ones where a basis is not enough, residual of the former
#: that will do.
GUARD, RANDOM, SETTLED = 4, 2, 3e-2
#: Vectors that are found beside a basis, in blocks, from which on they are cut down to so many.
MOST, KEPT = 16, 3
#: Directions below this part of the others, squared, are no new ones.
NEW = 1e-14


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
        |K x - λ M x| / |K x + s M x|.
    steps : int
        How often the search has grown.
    near : ndarray, shape (c, n)
        Approximations of as many lowest vectors again, and those.
    """

    values: FloatArray
    vectors: Vectors
    residuals: FloatArray
    steps: int
    near: Vectors


def lowest(
    K: Map, mass: Map, precondition: Map, basis: FloatArray, reduced: Vectors, noise: Vectors,
    count: int, shift: float, tol: float, most: int,
) -> Pairs:  # fmt: skip
    """The lowest pairs of K x = λ M x; see `Pairs`.

    Parameters
    ----------
    K, mass, precondition : callable
        Take rows (k, n), return K, M, and about (K + s M)^-1, of them.
    basis : ndarray, shape (d, n)
        Rows, orthonormal in the mass; there may be none.
    reduced : ndarray, shape (d, d)
        K on the basis.
    noise : ndarray, shape (r, n)
        What is taken in where the basis is not enough; with it there must be count + GUARD vectors.
    count : int
        How many.
    shift : float
        s.
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
    space = _Space(K, mass, basis, reduced)
    wanted = np.where(np.arange(block) < count, tol, SETTLED)
    if len(basis) < block:
        space.add(noise)
    for step in range(most + 1):
        values, S = space.solved(block)
        x = space.combined(S)
        Kx, Mx = K(x), mass(x)
        r = Kx - values[:, None] * Mx
        residuals = np.linalg.norm(r, axis=1) / np.linalg.norm(Kx + shift * Mx, axis=1)
        open_ = np.flatnonzero(residuals > wanted)
        if not len(open_) or step == most:
            break
        if len(space.W) + len(open_) > MOST * block:
            space.cut(KEPT * block)
        w = precondition(r[open_])
        space.add(np.concatenate([w, noise]) if step == 0 and len(basis) >= block else w)
    near = x if step == 0 else space.combined(space.solved(2 * block)[1])
    return Pairs(values, x, residuals, step, near)


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
        w = w / np.linalg.norm(w, axis=1)[:, None]
        for _ in range(2):
            Mw = self.mass(w)
            a, b = projected(Mw, self.V), self.W.conj() @ Mw.T
            gram = w.conj() @ Mw.T
            least = NEW * float(gram.diagonal().real.max())
            gram = gram - a.conj().T @ a - b.conj().T @ b
            values, vectors = np.linalg.eigh(0.5 * (gram + gram.conj().T))
            new = values > max(least, 1e-300)
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
