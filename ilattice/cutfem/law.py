"""Laws: which flux the gradient of an unknown makes, point by point; all that a physics is.

::

    class Permittivity(il.cutfem.Law):
        def tangent(self, asm, u):
            return 2.0 * np.eye(3).reshape(1, 1, 3, 1, 3)


    il.cutfem.Physics(solid, 16, law=Permittivity()).hold("w=0", 0.0).hold("w=1", 1.0).solve()

Matrices, supports by Nitsche's method, penalties on badly cut cells, recovered fluxes and estimates
of errors follow from the one tensor of a law. `Conduction`, `Isotropic` and `Anisotropic` are laws
that know some of these better.

Guarantees: nothing here knows supports, loads or solutions. Non-guarantee: laws are linear, with a
tensor that is symmetric and positive on gradients that are not those of rigid bodies; `Physics`
looks at some points for that.
"""

from collections.abc import Iterator
from functools import partial
from typing import Any, ClassVar

import numpy as np

from ilattice._shown import Shown
from ilattice._typing import FloatArray, IntArray
from ilattice.bspline import _kernels_basis as basis
from ilattice.cutfem.assembly import Assembly
from ilattice.cutfem.jumps import CALM, jump_within_cells
from ilattice.cutfem.space import IDENTITY
from ilattice.quadrature.rules import Quadrature

#: Part of the largest stiffness below which one is none, as of gradients of rotations.
FREE = 1e-9
#: Unit vectors along the axes and between them; points whose tensors are computed at once; and sets
#: of points whose numbers are kept.
WAYS = np.concatenate([np.eye(3), np.sqrt(0.5) * (1.0 - np.eye(3))])
AT_ONCE, KEPT = 1 << 16, 4


class Law(Shown):
    """A linear law of `m` unknowns per point.

    A class defines `tangent`, and `m` where there is more than one unknown; all else follows from
    these. Parameters u are (n, 3); arrays are of n rows, or of one where all points are alike.
    """

    #: Number of unknowns per point.
    m: ClassVar[int] = 1
    #: What it is called in warnings.
    called: ClassVar[str] = "the law"

    @property
    def entries(self) -> int:
        """Numbers that make up a flux."""
        return 3 * self.m

    def tangent(self, asm: Assembly, u: FloatArray) -> FloatArray:
        """Derivatives of fluxes by gradients, both in space.

        Parameters
        ----------
        asm : Assembly
            Knows the map: ``asm.x(u)`` are points of space.
        u : ndarray, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n, m, 3, m, 3), or (1, m, 3, m, 3)
            What makes flux (i, k) of gradient (j, l).
        """
        raise NotImplementedError

    @property
    def phases(self) -> "tuple[Law, Law]":
        """The law of the first and of the second phase."""
        return self, self

    @property
    def constant(self) -> bool:
        """Whether it is the same everywhere."""
        return False

    @property
    def told(self) -> dict[str, Any]:
        """What reports tell of it: values as they were given, by name."""
        return {}

    def flux(self, asm: Assembly, u: FloatArray, gradient: FloatArray) -> FloatArray:
        """Flux of gradients.

        Parameters
        ----------
        asm, u : Assembly, ndarray
            As in `tangent`.
        gradient : ndarray, shape (n, m, 3)
            In space.

        Returns
        -------
        ndarray, shape (n, entries)
            Component by component; a law may keep fewer numbers, in its own order.
        """
        A = np.broadcast_to(self.tangent(asm, u), (len(u), self.m, 3, self.m, 3))
        return np.einsum("qikjl,qjl->qik", A, gradient).reshape(len(u), -1)

    def components(self, flux: FloatArray) -> FloatArray:
        """All components of fluxes.

        Parameters
        ----------
        flux : ndarray, shape (n, entries)
            As `flux` returns it.

        Returns
        -------
        ndarray, shape (n, m, 3)
            Of each unknown, in space.
        """
        return flux.reshape(len(flux), self.m, 3)

    def through(self, flux: FloatArray, normals: FloatArray) -> FloatArray:
        """What flows through a surface.

        Parameters
        ----------
        flux : ndarray, shape (n, entries)
            As `flux` returns it.
        normals : ndarray, shape (n, 3)
            Unit vectors.

        Returns
        -------
        ndarray, shape (n, m)
            Per area.
        """
        return np.einsum("qik,qk->qi", self.components(flux), normals)

    def stored(self, asm: Assembly, u: FloatArray, flux: FloatArray) -> FloatArray:
        """Products of fluxes with the gradients that make them.

        Parameters
        ----------
        asm, u : Assembly, ndarray
            As in `tangent`.
        flux : ndarray, shape (n, entries)
            As `flux` returns it.

        Returns
        -------
        ndarray, shape (n,)
            Twice an energy per volume.
        """
        size = 3 * self.m
        w, v = np.linalg.eigh(self.tangent(asm, u).reshape(-1, size, size))
        free = w <= FREE * w[:, -1:]  # as gradients of rotations
        w = np.where(free, 0.0, 1.0 / np.where(free, 1.0, w))
        along = np.einsum("qij,qi->qj", np.broadcast_to(v, (len(u), size, size)), flux)
        return np.asarray((w * along**2).sum(axis=1))

    def normal(self, asm: Assembly, u: FloatArray, normals: FloatArray) -> FloatArray:
        """What makes `through` of gradients.

        Parameters
        ----------
        asm, u : Assembly, ndarray
            As in `tangent`.
        normals : ndarray, shape (n, 3)
            Unit vectors.

        Returns
        -------
        ndarray, shape (n, m, m, 3)
            Its product with gradients (n, m, 3) over the last two axes is what flows.
        """
        A = self.tangent(asm, u)
        if len(A) == 1:
            return np.einsum("ikjl,qk->qijl", A[0], normals)
        return np.einsum("qikjl,qk->qijl", A, normals)

    def penalty(self, asm: Assembly, u: FloatArray, normals: FloatArray) -> FloatArray:
        """Stiffness with which values on a surface are held, in heights of cells.

        The square of what flows through a surface, in the inverse of n A n, is at most the product
        of flux and gradient, by Cauchy and Schwarz.

        Parameters
        ----------
        asm, u, normals : Assembly, ndarray, ndarray
            As in `normal`.

        Returns
        -------
        ndarray, shape (n, m, m)
            Symmetric.
        """
        return np.einsum("qijl,ql->qij", self.normal(asm, u, normals), normals)

    def along(self, asm: Assembly, u: FloatArray, normals: FloatArray) -> FloatArray:
        """How stiff the law is along unit vectors, for weights of the two sides of a surface.

        Parameters
        ----------
        asm, u, normals : Assembly, ndarray, ndarray
            As in `normal`.

        Returns
        -------
        ndarray, shape (n,)
            Positive.
        """
        return np.trace(self.penalty(asm, u, normals), axis1=1, axis2=2) / self.m

    def mean(self, asm: Assembly, u: FloatArray) -> FloatArray:
        """How stiff the law is in the mean of all directions, for penalties.

        Parameters
        ----------
        asm, u : Assembly, ndarray
            As in `tangent`.

        Returns
        -------
        ndarray, shape (n,)
            Positive.
        """
        return np.einsum("qikik->q", self.tangent(asm, u)) / (3.0 * self.m)

    def jump(self, asm: Assembly, part: Quadrature, values: FloatArray | None = None) -> FloatArray:
        """By how much the law jumps within cells.

        Parameters
        ----------
        asm, part : Assembly, Quadrature
            As in `add`.
        values : ndarray, shape (n,), optional
            What `mean` is at the points, of laws that are alike in all directions; others are
            looked at along and between the axes, each unknown for itself.

        Returns
        -------
        ndarray, shape (2,)
            See `jump_within_cells`.
        """
        if self.constant or not len(part):
            return CALM
        if values is not None:
            return jump_within_cells(part, values, lambda u: self.mean(asm, u))
        looked = _Looked(self, asm)
        stiff, out = looked(part.points), CALM
        for k in range(stiff.shape[1]):
            if stiff[:, k].min() > FREE * stiff.max():
                found = jump_within_cells(part, stiff[:, k].copy(), partial(looked.along, k))
                out = np.maximum(out, found)
        return out

    def add(self, data: FloatArray, asm: Assembly, part: Quadrature) -> FloatArray:
        """Add the matrix of a part of the solid to blocks.

        Parameters
        ----------
        data : ndarray, shape (blocks, m, m)
            Changed in place.
        asm : Assembly
            Functions.
        part : Quadrature
            In parameters, on active cells of this phase.

        Returns
        -------
        ndarray, shape (2,)
            As `jump` returns it.
        """
        nb = asm.space.dofs.shape[1]
        size, per_cell = self.m * nb, max(len(part) // max(len(part.cells), 1), 1)
        for at, cells, rows in asm.batches(part, max(size, 4 * self.m * per_cell) * size):
            u, owner = part.points[rows], at[part.owners[rows] - cells.start]
            D = functions_at(asm, u, owner)[1]
            weights = part.weights[rows] * np.abs(np.linalg.det(asm.jacobians(u)))
            A = np.broadcast_to(self.tangent(asm, u), (len(u), self.m, 3, self.m, 3))
            P = np.einsum("q,qikjl,qbl->qikbj", weights, A, D)
            out = np.empty((len(at), size, size))
            for e, mine in _cells(part, cells, rows):
                block = np.einsum("qak,qikbj->aibj", D[mine], P[mine], optimize=True)
                out[e] = block.reshape(size, size)
            asm.add_blocks(data, at, 0.5 * (out + out.transpose(0, 2, 1)))
        return self.jump(asm, part)


class _Looked:
    """How stiff a law is along `WAYS`, each unknown for itself; what was asked twice is kept."""

    def __init__(self, law: Law, asm: Assembly) -> None:
        self.law, self.asm = law, asm
        self.kept: dict[bytes, FloatArray] = {}

    def __call__(self, u: FloatArray) -> FloatArray:
        """Numbers (n, 6 m), positive, or zero for what costs no energy."""
        out = np.empty((len(u), len(WAYS) * self.law.m))
        for i in range(0, len(u), AT_ONCE):
            A = self.law.tangent(self.asm, u[i : i + AT_ONCE])
            found = np.einsum("pk,qikil,pl->qip", WAYS, A, WAYS, optimize=True)
            out[i : i + AT_ONCE] = found.reshape(len(A), -1)
        return out

    def along(self, k: int, u: FloatArray) -> FloatArray:
        """One of these numbers (n,)."""
        key = u.tobytes()
        if key not in self.kept:
            self.kept = {**self.kept, key: self(u)} if len(self.kept) < KEPT else {key: self(u)}
        return self.kept[key][:, k]


def _cells(part: Quadrature, cells: slice, rows: slice) -> Iterator[tuple[int, slice]]:
    """Numbers of some cells in their batch, and slices of their points in it."""
    ends = part.offsets[cells.start : cells.stop + 1] - rows.start
    for e in range(len(ends) - 1):
        yield e, slice(int(ends[e]), int(ends[e + 1]))


def functions_at(asm: Assembly, u: FloatArray, elements: IntArray) -> tuple[FloatArray, FloatArray]:
    """Values (n, nb) and gradients in space (n, nb, 3) of the functions of elements at parameters.

    Elements are given by position in the space, one per point.
    """
    space = asm.space
    n, nb = len(u), space.dofs.shape[1]
    N, D = np.empty((n, nb, 1)), np.empty((n, nb, 3))
    at: tuple[Any, ...] = (space.cell_indices[elements], space.boxes[elements])
    where = (*space._tables, *at, np.arange(n + 1), u)
    basis.vectors(n, *where, IDENTITY, np.ones((n, 1)), np.zeros((0, 1, 3)), N)
    unit = np.ascontiguousarray(np.broadcast_to(np.eye(3), (n, 3, 3)))
    basis.vectors(n, *where, asm.jacobians(u), np.zeros((0, 3)), unit, D)
    return N[:, :, 0], D
