"""Waves of a few wave vectors as a basis for those of all others.

Matrices that are polynomials of the wave vector are reduced to a basis term by term, once; at every
wave vector a small dense matrix then gives waves that are off by little (M. Hussein, Reduced Bloch
mode expansion for periodic media band structure calculations, 2009). The basis holds real and
imaginary parts by themselves, so that waves of k are there for -k, too.

Non-guarantee: how good the reduced waves are; `lowest` computes their residuals.
"""

from collections.abc import Callable, Iterable

import numpy as np

from ilattice._typing import AnyArray, FloatArray
from ilattice.homogenize._eigen import Vectors

Map = Callable[[FloatArray], FloatArray]
Terms = Callable[[FloatArray], Iterable[tuple[FloatArray, int]]]
#: Vectors that a basis has at most.
FULL = 600
#: Vectors that have less than this length are none.
NONE = 1e-10


class Basis:
    """Real rows, orthonormal in the mass, and the terms of a polynomial of matrices on them.

    Parameters
    ----------
    n : int
        Unknowns.
    mass : callable
        Takes rows (k, n), returns M of them.
    terms : callable
        Takes rows, returns an iterable of the products of the terms with them, with 1 or -1 for
        symmetric and skew ones.
    part : float
        Vectors are left out of which less than this part is new.
    """

    def __init__(self, n: int, mass: Map, terms: Terms, part: float) -> None:
        self.rows, self.mass, self.terms, self.part = np.zeros((0, n)), mass, terms, part
        self.reduced: FloatArray = np.zeros((0, 0, 0))

    def at(self, monomials: Vectors) -> Vectors:
        """The polynomial on the basis, of values (t,) of the monomials."""
        if not len(self.rows):
            return np.zeros((0, 0), np.complex128)
        return np.asarray(np.tensordot(monomials, self.reduced, 1))

    def add(self, x: AnyArray) -> None:
        """Take in the real and the imaginary parts of rows, as far as they are new."""
        room = FULL - len(self.rows)
        w = np.concatenate([x.real, x.imag])
        length = np.linalg.norm(w, axis=1)
        w = w[length > NONE * length.max()]
        for turn in range(2):
            Mw = self.mass(w)
            a = self.rows @ Mw.T
            gram = w @ Mw.T
            size = np.sqrt(np.maximum(gram.diagonal(), 1e-300)) if turn == 0 else np.ones(len(w))
            gram = (gram - a.T @ a) / np.outer(size, size)
            values, vectors = np.linalg.eigh(0.5 * (gram + gram.T))
            new = np.flatnonzero(values > (self.part**2 if turn == 0 else 0.5))[-max(room, 1) :]
            w = (vectors[:, new] / np.sqrt(values[new])).T @ ((w - a.T @ self.rows) / size[:, None])
        if room > 0 and len(w):
            self._grow(np.ascontiguousarray(w))

    def _grow(self, w: FloatArray) -> None:
        """Add rows, and what the terms are on them."""
        old, rows = self.reduced, np.concatenate([self.rows, w])
        n, m, reduced = len(self.rows), len(rows), []
        for number, (product, sign) in enumerate(self.terms(w)):
            A = np.empty((m, m))
            A[:n, :n] = old[number] if n else 0.0
            side = rows @ product.T
            A[:, n:] = side
            A[n:, :n] = sign * side[:n].T
            A[n:, n:] = 0.5 * (side[n:] + sign * side[n:].T)
            reduced.append(A)
        self.rows, self.reduced = rows, np.stack(reduced)
