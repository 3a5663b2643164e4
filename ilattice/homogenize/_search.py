"""The search for waves along a path: wave vectors one after the other, each with what is known.

Corners of a path come first, then what halves the ways between them: the waves of all of them make
up a basis (`_reduced`), in which those of later wave vectors are soon good enough as they are.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from ilattice._progress import Progress, track
from ilattice._typing import FloatArray
from ilattice.homogenize import _eigen
from ilattice.homogenize._eigen import GUARD, RANDOM, Pairs, Pencil, Vectors, each_part, lowest
from ilattice.homogenize._reduced import Basis
from ilattice.homogenize.paths import Path, reciprocal
from ilattice.homogenize.waves import BlochCell, monomials

#: The preconditioner is made anew where its shift is off by this factor.
OFF = 3.0
#: Squares of frequencies below this part of the shift do not change it.
ZERO = 1e-8
#: By how much sums of the many entries of a row round more than the diagonal.
MANY = 4.0


class Search:
    """Lowest pairs at wave vectors, one after the other, with what was found before."""

    def __init__(self, cell: BlochCell, count: int, method: str, tol: float, most: int) -> None:
        self.cell, self.count, self.tol, self.most, self.method = cell, count, tol, most, method
        mu, mass = cell.inertia
        self.shift = mu / mass * np.pi**2 * cell.cell_volume ** (-2 / 3)
        self.solver = cell.preconditioner(self.shift, method)
        n = cell.matrix.shape[0]
        self.basis = Basis(n, cell.inert, cell.terms, tol)
        self.basis.add(np.tile(np.eye(3), n // 3))  # waves of no frequency
        self.random = np.random.default_rng(0)
        self.diagonal = MANY * np.asarray(cell.matrix.diagonal())

    def at(self, k: FloatArray) -> Pairs:
        """Pairs at one wave vector."""
        basis, block = self.basis, self.count + GUARD
        fresh = RANDOM if len(basis.rows) >= block else block
        real, imaginary = self.random.standard_normal((2, fresh, basis.rows.shape[1]))
        noise = self.precondition(self.mass(real + 1j * imaginary))
        pencil = Pencil(
            self.cell.product(k), self.mass, self.precondition, self.diagonal, self._shifted
        )
        pairs = lowest(
            pencil, basis.rows, basis.at(monomials(k)), noise, self.count, self.tol, self.most
        )
        _eigen.check(
            pairs, self.count, self.tol, k, "ask for another count, or give method='superlu'"
        )
        return pairs

    def slopes(self, k: FloatArray, x: Vectors) -> Vectors:
        """See `BlochCell.slopes`."""
        return self.cell.slopes(k, x)

    def sampled(self, pairs: Pairs, count: int, u: FloatArray) -> Vectors:
        """Values (count, 3 p) of waves at parameters (p, 3)."""
        x = pairs.vectors[:count]
        c = np.concatenate([x.real, x.imag]).reshape(2 * count, -1, 3).transpose(1, 0, 2)
        v = self.cell.assembly.evaluate(c.reshape(len(c), -1), u)[0]
        v = v.reshape(len(u), 2, count, 3).transpose(1, 2, 0, 3).reshape(2, count, -1)
        return np.asarray(v[0] + 1j * v[1])

    def along(self, way: Path, progress: Progress) -> list[Pairs]:
        """Pairs at all wave vectors of a path: corners first, then what halves their ways."""
        k = way.fractions @ reciprocal(self.cell.edges).T
        names = [tuple(np.round(f, 12).tolist()) for f in way.fractions]
        corners = {names[c] for c in way.corners}
        out: dict[tuple[float, ...], Pairs] = {}
        for i in track(list(_order(way.corners.tolist())), "bands", progress):
            if names[i] not in out:
                pairs = self.at(k[i])
                if pairs.steps:
                    self.basis.add(pairs.near if names[i] in corners else pairs.vectors)
                out[names[i]] = replace(pairs, near=pairs.vectors[:0])
        return [out[name] for name in names]

    def _shifted(self, largest: float | None) -> float:
        """The shift, of a preconditioner that is made anew if it is far from what is asked for."""
        part = 1.0 if largest is None else largest / self.shift
        if part > ZERO and not 1 / OFF <= part <= OFF:
            self.shift *= part
            self.solver = self.cell.preconditioner(self.shift, self.method)
        return self.shift

    def mass(self, x: Vectors) -> Vectors:
        """Mass times rows (k, n)."""
        return np.asarray(each_part(self.cell.inert, x))

    def precondition(self, r: Vectors) -> Vectors:
        """Apply it to real and imaginary parts of rows, all together."""
        return np.asarray(each_part(lambda v: self.solver.precondition(v.T).T, r))


def _order(corners: list[int]) -> Iterator[int]:
    """Corners, then the middles between them, then those of what is left, and so on."""
    yield from corners
    ways: Any = list(pairwise(corners))
    while ways:
        middles = [(a, (a + b) // 2, b) for a, b in ways if b - a > 1]
        yield from (m for _, m, _ in middles)
        ways = [way for a, m, b in middles for way in ((a, m), (m, b))]
