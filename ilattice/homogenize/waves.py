"""A cell of a periodic solid, for waves: stiffness, mass and their derivatives by wave vectors.

A wave u = exp(i k.x) v has a v that repeats with the cell (Bloch, 1929). Its gradient is exp(i k.x)
times grad v + i k v, so that the stiffness is a polynomial of degree two in k, of ten real matrices
of the cell: no unknown has a phase, splines stay smooth over the faces of the cell, and derivatives
by k are exact. The mass does not depend on k.

Guarantee: matrices are Hermitian. The penalty on jumps at cut cells is that of v. Splines of the
highest smoothness jump in their highest derivatives alone, and there it is, up to a phase, that of
u for every k; with less smoothness it is another penalty that vanishes for what does not jump, as
consistent as the first.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import bsr_array, csr_array

from ilattice._typing import FloatArray
from ilattice._validate import read_only
from ilattice.cutfem import _kernels_assembly as kernels
from ilattice.cutfem import coupling
from ilattice.cutfem.assembly import Assembly
from ilattice.cutfem.constraints import Constraints
from ilattice.cutfem.material import Elastic
from ilattice.errors import InputError
from ilattice.homogenize import tensors
from ilattice.homogenize._eigen import Map, Vectors, each_part
from ilattice.homogenize.elastic import ElasticCell
from ilattice.linalg.blocks import Blocks
from ilattice.linalg.solvers import Solver

#: Unknowns up to which a factor is the better preconditioner.
SMALL = 4_000
#: Which products of components of wave vectors there are.
PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def monomials(k: FloatArray) -> Vectors:
    """What the ten matrices of `BlochCell.terms` are multiplied by.

    Parameters
    ----------
    k : ndarray, shape (3,)
        Wave vector.

    Returns
    -------
    ndarray, shape (10,)
        1, i k_j, and k_i k_j, twice for i < j.
    """
    squares = [(1.0 + (i != j)) * k[i] * k[j] for i, j in PAIRS]
    return np.concatenate([[1.0], 1j * k, squares])


@dataclass(frozen=True, eq=False, init=False, repr=False)
class BlochCell(ElasticCell):
    """An elastic cell of a periodic solid, for waves.

    Parameters
    ----------
    field, cells, **options : optional
        As in `bloch`.
    """

    def __init__(self, field: Any, cells: Any = 12, **options: Any) -> None:
        if options.get("dilatation", "full") != "full":
            raise InputError("dilatation must be 'full' for waves; leave it out")
        super().__init__(field, cells, **{**options, "dilatation": "full"})

    @cached_property
    def constraints(self) -> Constraints:
        """Nothing is held."""
        shape = (len(self.assembly.space), 3)
        return Constraints(np.zeros(shape, bool), np.zeros(shape), np.full(shape, -1))

    @cached_property
    def matrix(self) -> Any:
        """The whole stiffness without waves, which those of waves share the pattern of."""
        return self._stiffness.whole()

    @cached_property
    def _both(self) -> Assembly:
        """Of matrices that are not symmetric."""
        return replace(self.assembly, half=False)

    @cached_property
    def edges(self) -> FloatArray:
        """Edges (3, 3) of the cell as columns."""
        box = np.ptp(self.domain.cut.grid.domain, axis=0)
        return read_only(self._jacobian[0] * box)

    @cached_property
    def masses(self) -> Any:
        """Mass matrix, or `InputError` where there is none."""
        M = self.mass()
        if not M.data.any():
            raise InputError("density: the solid has no mass, and no waves; give it a density")
        return M

    @cached_property
    def inert(self) -> Callable[[FloatArray], FloatArray]:
        """Product of the mass, the same for all components, with rows (b, n)."""
        M = self.masses
        n = M.shape[0] // 3
        one = csr_array((M.data[:, 0, 0].copy(), M.indices, M.indptr), shape=(n, n))

        def multiply(x: FloatArray) -> FloatArray:
            flat = x.reshape(-1, n, 3).transpose(1, 0, 2).reshape(n, -1)
            return np.asarray((one @ flat).reshape(n, -1, 3).transpose(1, 0, 2).reshape(x.shape))

        return multiply

    @cached_property
    def inertia(self) -> tuple[float, float]:
        """Integrals of the shear modulus and of the density over the active solid."""
        one = np.tile([1.0, 0.0, 0.0], len(self.assembly.space))
        return float(tensors.bulk_and_shear(self.moments())[1]), float(one @ (self.masses @ one))

    # ---------------------------------------------------------------- matrices

    @cached_property
    def _terms(self) -> list[tuple[FloatArray, FloatArray, FloatArray, FloatArray]]:
        """Stiffnesses (3, 3, 3, 3), and integrals of grad N N, N grad N (blocks, 3), N N (blocks,).

        Where the material varies, its values are in the integrals, and the stiffnesses are those of
        units: of λ and of μ, or of the 21 entries of a matrix.
        """
        asm, phases = self._both, self.material.phases
        out: list[tuple[FloatArray, FloatArray, FloatArray, FloatArray]] = []
        uniform = all(m.constant for m in phases)
        only = 1 if self.domain.interface is None else 2
        for m, number in zip(phases[:only], range(only), strict=True):
            jets: dict[bytes, tuple[FloatArray, FloatArray]] = {}
            for rule in self.domain.stiff_rules(asm, constant=uniform):
                part = self.domain.of_phases(rule)[number]
                for C, d in _factors(m, asm, part.points, uniform=uniform):
                    if C.tobytes() not in jets:
                        jets[C.tobytes()] = C, asm.zeros(4)
                    asm.add_cells(jets[C.tobytes()][1], part, kernels.JETS, d)
            for C, J in jets.values():
                parts = J[:, :3, 3].copy(), J[:, 3, :3].copy(), J[:, 3, 3].copy()
                out.append((tensors.tensor(C), *parts))
        return out

    @cached_property
    def _seam(self) -> FloatArray | None:
        """What couples two phases, per direction of k (3, blocks, 3, 3)."""
        if self._both.seam is None:
            return None
        data = np.stack([self._both.zeros(3) for _ in range(3)])
        coupling.add_waves(data, self, self._both)
        return data

    def _linear(self, k: FloatArray) -> FloatArray:
        """Blocks of the real, skew matrix that i times is the linear part of the stiffness."""
        flat = np.zeros((len(self.matrix.indices), 9))
        for C, a, b, _ in self._terms:
            flat += a @ np.einsum("ipjq,q->pij", C, k).reshape(3, 9)
            flat -= b @ np.einsum("ipjq,p->qij", C, k).reshape(3, 9)
        out = flat.reshape(-1, 3, 3)
        if self._seam is not None:
            out += np.einsum("j,jbmn->bmn", k, self._seam)
        return out

    def _square(self, k: FloatArray, other: FloatArray) -> FloatArray:
        """Blocks of the quadratic part, as a symmetric function of two vectors."""
        out = np.zeros((len(self.matrix.indices), 9))
        for C, _, _, c in self._terms:
            one = np.einsum("ipjq,p,q->ij", C, k, other)
            out += np.outer(c, 0.5 * (one + one.T))
        return out.reshape(-1, 3, 3)

    def stiffness(self, k: FloatArray) -> Any:
        """The Hermitian matrix of a wave vector.

        Parameters
        ----------
        k : ndarray, shape (3,)
            In space.

        Returns
        -------
        bsr_array
            Complex.
        """
        real = self.matrix.data + self._square(k, k)
        return self._blocks(real + 1j * self._linear(k))

    def _blocks(self, data: Any) -> Any:
        K = self.matrix
        return bsr_array((data, K.indices, K.indptr), shape=K.shape)

    def slopes(self, k: FloatArray, x: Vectors) -> Vectors:
        """Products with the derivatives of the matrix by the wave vector.

        Parameters
        ----------
        k : ndarray, shape (3,)
            In space.
        x : ndarray, shape (b, n)
            Vectors.

        Returns
        -------
        ndarray, shape (3, b, b)
            x* dK/dk_j x.
        """
        out = np.empty((3, len(x), len(x)), np.complex128)
        both = np.concatenate([x.real, x.imag])
        squares = self._squares(both)
        for j, e in enumerate(np.eye(3)):
            even, odd = 2.0 * squares(k, e), self._odd[j](both)
            real, imaginary = (v[: len(x)] + 1j * v[len(x) :] for v in (even, odd))
            out[j] = x.conj() @ (real + 1j * imaginary).T
        return out

    def product(self, k: FloatArray) -> Map:
        """The matrix of a wave vector as a map of rows.

        Parameters
        ----------
        k : ndarray, shape (3,)
            In space.

        Returns
        -------
        callable
            Takes vectors (b, n), returns K(k) of them.
        """
        even = self.rows(self.matrix.data + self._square(k, k))
        odd = self.rows(self._linear(k))
        return lambda x: each_part(even, x) + 1j * each_part(odd, x)

    def rows(self, data: FloatArray) -> Callable[[FloatArray], FloatArray]:
        """Products of blocks (blocks, 3, 3) where the stiffness has them with rows (b, n).

        Parameters
        ----------
        data : ndarray, shape (blocks, 3, 3)
            Blocks.

        Returns
        -------
        callable
            Takes real vectors (b, n), returns those.
        """
        K = self.matrix
        offsets, columns = (np.require(a, requirements="W") for a in (K.indptr, K.indices))
        blocks = Blocks(
            offsets, columns, np.require(data, requirements=("C", "W")), len(offsets) - 1
        )

        def multiply(x: FloatArray) -> FloatArray:
            y = np.empty(x.shape)
            blocks.multiply(np.ascontiguousarray(x), y, 0)
            return y

        return multiply

    def terms(self, x: FloatArray) -> Iterator[tuple[FloatArray, int]]:
        """Products of the real matrices whose sum, each times its `monomials`, is the stiffness.

        Parameters
        ----------
        x : ndarray, shape (b, n)
            Real vectors.

        Yields
        ------
        ndarray, shape (b, n)
            A x.
        int
            1 for symmetric A, -1 for skew ones.
        """
        yield self.rows(self.matrix.data)(x), 1
        for odd in self._odd:
            yield odd(x), -1
        squares, axes = self._squares(x), np.eye(3)
        for i, j in PAIRS:
            yield squares(axes[i], axes[j]), 1

    @cached_property
    def _odd(self) -> list[Callable[[FloatArray], FloatArray]]:
        """Products of the linear part, for unit wave vectors."""
        return [self.rows(self._linear(e)) for e in np.eye(3)]

    def _squares(self, x: FloatArray) -> Callable[[FloatArray, FloatArray], FloatArray]:
        """Products of the quadratic part with rows, as a function of two wave vectors."""
        K = self.matrix
        n = K.shape[0] // 3
        flat = x.reshape(-1, n, 3).transpose(1, 0, 2).reshape(n, -1)
        parts = [
            (C, csr_array((c, K.indices, K.indptr), shape=(n, n)) @ flat)
            for C, _, _, c in self._terms
        ]

        def at(k: FloatArray, other: FloatArray) -> FloatArray:
            out = np.zeros((flat.size // 3, 3))
            for C, y in parts:
                one = np.einsum("ipjq,p,q->ij", C, k, other)
                out += y.reshape(-1, 3) @ (0.5 * (one + one.T))
            return np.asarray(out.reshape(n, -1, 3).transpose(1, 0, 2).reshape(x.shape))

        return at

    # ---------------------------------------------------------------- solving

    def preconditioner(self, shift: float, method: str) -> Solver:
        """Factor or hierarchy of the stiffness without k, and a little of the mass.

        Parameters
        ----------
        shift : float
            What the mass is multiplied by.
        method : str
            As in `bloch`.

        Returns
        -------
        Solver
            Real.
        """
        K = self.matrix
        if method == "auto":
            method = "superlu" if K.shape[0] <= SMALL else "multigrid"
        A = bsr_array((K.data + shift * self.masses.data, K.indices, K.indptr), shape=K.shape)
        system = self.system
        return Solver(
            A, near_nullspace=system.near_nullspace, method=method, coordinates=system.coordinates
        )


def _factors(
    m: Elastic, asm: Assembly, u: FloatArray, *, uniform: bool
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Stiffnesses (6, 6), and factors (n, 1) or (1, 1) of them at parameters, to be summed up."""
    if uniform:
        yield m.matrices(asm, u[:1])[0], np.ones((1, 1))
        return
    for unit, factors in m.units(asm, u):
        yield unit, np.broadcast_to(factors, len(u))[:, None].copy()
