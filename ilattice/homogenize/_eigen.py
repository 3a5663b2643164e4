"""Lowest pairs of Hermitian matrices next to each other, by Davidson's method in blocks.

The search space grows by preconditioned residuals, and starts with what is known from other wave
vectors (E. Davidson, The iterative calculation of a few of the lowest eigenvalues, 1975). The
preconditioner is real, the same for all wave vectors, and sees every symmetry of the cell, so that
the start has to hold something of every band: random vectors are among it.

Guarantee: residuals are computed afresh. Non-guarantee: that no eigenvalue has been passed over; a
few vectors beyond those asked for have to settle, too, before pairs count as found.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ilattice._typing import FloatArray

Vectors = NDArray[np.complex128]
Map = Callable[[Vectors], Vectors]

#: Vectors beyond those asked for, random ones in every start, residual of the former that will do.
GUARD, RANDOM, SETTLED = 4, 2, 3e-2
#: Size of the search space, in blocks, from which on it is cut down to so many.
MOST, KEPT = 8, 2
#: Directions below this part of the others, squared, are no new ones.
NEW = 1e-14


@dataclass(frozen=True, eq=False)
class Pairs:
    """Lowest eigenpairs.

    Attributes
    ----------
    values : ndarray, shape (b,)
        Ascending, with the guards.
    vectors : ndarray, shape (n, b)
        Orthonormal in the mass.
    residuals : ndarray, shape (b,)
        |K x - λ M x| / |K x + s M x|.
    steps : int
        How often the space has grown.
    """

    values: FloatArray
    vectors: Vectors
    residuals: FloatArray
    steps: int


def lowest(
    K: Any, mass: Map, precondition: Map, start: Vectors, count: int, shift: float, tol: float,
    most: int,
) -> Pairs:  # fmt: skip
    """The lowest pairs of K x = λ M x; see `Pairs`.

    Parameters
    ----------
    K : sparse array, shape (n, n)
        Hermitian.
    mass, precondition : callable
        Take vectors (n, k), return M, and about (K + s M)^-1, of them.
    start : ndarray, shape (n, k)
        At least count + GUARD vectors.
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
    space = _Space(K, mass, start)
    for step in range(most + 1):
        values, S = np.linalg.eigh(space.H)
        x, Kx, Mx = (A @ S[:, :block] for A in (space.V, space.KV, space.MV))
        values = values[:block]
        r = Kx - values * Mx
        size = np.linalg.norm(Kx + shift * Mx, axis=0)
        residuals = np.linalg.norm(r, axis=0) / size
        wanted = np.where(np.arange(block) < count, tol, SETTLED)
        open_ = np.flatnonzero(residuals > wanted)
        if not len(open_) or step == most:
            break
        w = precondition(r[:, open_])
        if space.V.shape[1] + len(open_) > MOST * block:
            space.cut(S[:, : KEPT * block])
        space.add(w)
    return Pairs(values, x, residuals, step)


class _Space:
    """A search space with its products: V (n, k) orthonormal in the mass, and H = V* K V."""

    def __init__(self, K: Any, mass: Map, start: Vectors) -> None:
        self.K, self.mass = K, mass
        none = np.zeros((start.shape[0], 0), np.complex128)
        self.V, self.KV, self.MV = none, none, none
        self.H: Any = np.zeros((0, 0), np.complex128)
        self.add(start)

    def add(self, w: Vectors) -> None:
        """Take in vectors, as far as they are new."""
        w = w / np.linalg.norm(w, axis=0)
        for _ in range(2):
            w = w - self.V @ (self.MV.conj().T @ w)
            gram = w.conj().T @ self.mass(w)
            values, vectors = np.linalg.eigh(0.5 * (gram + gram.conj().T))
            new = values > NEW * max(float(values[-1]), 1e-300)
            w = w @ (vectors[:, new] / np.sqrt(values[new]))
        Kw = self.K @ w
        side = self.V.conj().T @ Kw
        corner = w.conj().T @ Kw
        corner = 0.5 * (corner + corner.conj().T)
        self.H = np.block([[self.H, side], [side.conj().T, corner]])
        self.V = np.concatenate([self.V, w], axis=1)
        self.KV = np.concatenate([self.KV, Kw], axis=1)
        self.MV = np.concatenate([self.MV, self.mass(w)], axis=1)

    def cut(self, S: Vectors) -> None:
        """Keep combinations of what is there."""
        self.V, self.KV, self.MV = (A @ S for A in (self.V, self.KV, self.MV))
        H = self.V.conj().T @ self.KV
        self.H = 0.5 * (H + H.conj().T)
