"""Prescribed coefficients, and systems without them.

On an end face the first layer of functions alone is not zero, so that prescribing its
coefficients prescribes the field. Only functions that matter on the solid part of the face are
taken: those of cells that have area there.

Guarantees: a system keeps its blocks; a node of which all components are prescribed is left out; of
one with some, these rows hold their diagonal entry alone. Symmetric to the bit.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import bsr_array

from ilattice._typing import AnyArray, FloatArray
from ilattice._validate import Frozen, read_only
from ilattice.cutfem import _kernels_assembly as kernels
from ilattice.cutfem.assembly import Assembly
from ilattice.cutfem.conditions import AXES, Support, values_at
from ilattice.cutfem.domain import Domain
from ilattice.errors import InputError
from ilattice.linalg.symmetric import Symmetric
from ilattice.quadrature.rules import NAMES

#: Values that two supports prescribe for one node are the same up to this part of the largest.
SAME = 1e-8


@dataclass(frozen=True, eq=False)
class Constraints(Frozen):
    """Prescribed coefficients of a field with m components.

    Attributes
    ----------
    fixed : ndarray of bool, shape (n, m)
        Which are prescribed.
    values : ndarray, shape (n, m)
        What they are; zero elsewhere.
    owner : ndarray, shape (n, m)
        Number of the support that prescribes each; -1 elsewhere.
    """

    fixed: AnyArray
    values: FloatArray
    owner: AnyArray

    @cached_property
    def nodes(self) -> AnyArray:
        """Nodes with something free."""
        return read_only(np.flatnonzero(~self.fixed.all(axis=1)))

    def reduce(self, K: Any, *, diagonal: bool = True) -> Any:
        """The matrix on free nodes.

        Parameters
        ----------
        K : bsr_array or Symmetric
            Square blocks, sorted columns.
        diagonal : bool
            Whether the rows of prescribed components keep their diagonal entry, as a stiffness
            must, or are zero, as a mass must.

        Returns
        -------
        bsr_array or Symmetric
            On the free nodes, in their order.
        """
        if not self.fixed.any():
            return K
        half = isinstance(K, Symmetric)
        given = (K.offsets, K.columns, K.blocks) if half else (K.indptr, K.indices, K.data)
        nodes, fixed = self.nodes.copy(), self.fixed.copy()  # read-only ones are of another type
        m = fixed.shape[1]
        place = np.full(len(self.fixed), -1, np.int32)
        place[nodes] = np.arange(len(nodes))
        count = np.zeros(len(nodes), np.int64)
        kernels.count_free(len(nodes), *given[:2], nodes, place, count)
        indptr = np.append(0, np.cumsum(count)).astype(np.int32)
        columns, data = np.empty(indptr[-1], np.int32), np.empty((indptr[-1], m, m))
        kernels.take_free(
            len(nodes), *given, nodes, place, fixed, diagonal, indptr, columns, data
        )  # fmt: skip
        if half:
            return Symmetric(indptr, columns, data)
        return bsr_array((data, columns, indptr), shape=(m * len(nodes), m * len(nodes)))

    def split(self, K: Symmetric) -> "Split":
        """The matrix on free nodes, and what it leaves out; K itself need not be kept.

        Parameters
        ----------
        K : Symmetric
            As in `reduce`.

        Returns
        -------
        Split
            Both.
        """
        if not self.fixed.any():
            return Split(K, None, self)
        kept, touched = self._marks(K.offsets, K.columns)
        free = self.reduce(K)
        rest = K.blocks[touched]
        rest[kept[touched]] -= free.blocks[touched[kept]]
        rows = np.append(0, np.cumsum(touched))[K.offsets].astype(K.offsets.dtype)
        return Split(free, bsr_array((rest, K.columns[touched], rows), shape=K.shape), self)

    def _marks(self, indptr: AnyArray, indices: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Which blocks are on free nodes, and which have something prescribed."""
        some: AnyArray = np.any(self.fixed, axis=1)
        every: AnyArray = np.all(self.fixed, axis=1)
        count = np.diff(indptr)
        kept = ~(np.repeat(every, count) | every[indices])
        return kept, np.repeat(some, count) | some[indices]

    def restrict(self, f: FloatArray) -> FloatArray:
        """Free rows (free nodes, m) of coefficients (n, m), zero in prescribed components."""
        return np.where(self.fixed, 0.0, f)[self.nodes]

    def expand(self, x: FloatArray) -> FloatArray:
        """Coefficients (n, m) of free ones (free nodes, m), with the prescribed values."""
        out = self.values.copy()
        out[self.nodes] += np.where(self.fixed[self.nodes], 0.0, x)
        return out


@dataclass(frozen=True, eq=False)
class Split(Frozen):
    """A symmetric matrix in two: free nodes, and the few blocks in which something is prescribed.

    Attributes
    ----------
    free : Symmetric
        On the free nodes; see `Constraints.reduce`.
    rest : bsr_array or None
        On all nodes, blocks on and right of the diagonal of what is missing in `free`; None where
        nothing is prescribed.
    constraints : Constraints
        What is prescribed.
    """

    free: Symmetric
    rest: Any
    constraints: Constraints

    @cached_property
    def _right(self) -> Any:
        """`rest` without its diagonal blocks."""
        rows = np.repeat(np.arange(len(self.rest.indptr) - 1), np.diff(self.rest.indptr))
        right = self.rest.indices > rows
        offsets = np.append(0, np.cumsum(right))[self.rest.indptr]
        kept = self.rest.data[right], self.rest.indices[right], offsets
        return bsr_array(kept, shape=self.rest.shape)

    def times(self, c: FloatArray) -> FloatArray:
        """The product with coefficients (n, m), of the same shape."""
        if self.rest is None:
            return (self.free @ c.ravel()).reshape(c.shape)
        nodes, flat = self.constraints.nodes, c.ravel()
        out = np.asarray(self.rest @ flat + self._right.T @ flat).reshape(c.shape)
        out[nodes] += (self.free @ c[nodes].ravel()).reshape(-1, c.shape[1])
        return out

    def together(self, offsets: AnyArray, columns: AnyArray) -> Symmetric:
        """The matrix again, to the bit, on its pattern of blocks."""
        if self.rest is None:
            return self.free
        kept, touched = self.constraints._marks(offsets, columns)
        data = np.zeros((len(columns), self.free.size, self.free.size))
        data[kept] = self.free.blocks
        data[touched] += self.rest.data
        return Symmetric(offsets, columns, data)


def layer(domain: Domain, asm: Assembly, name: str) -> AnyArray:
    """Active functions that are not zero on the solid part of an end face."""
    axis, side = divmod(NAMES.index(name), 2)
    space = asm.space
    position = np.searchsorted(
        space.cells, np.intersect1d(space.cells, domain.boundary(name).cells)
    )
    local = np.arange((space.degree + 1) ** 3).reshape((space.degree + 1,) * 3)
    face = local.take(0 if side == 0 else -1, axis).ravel()
    return np.unique(space.dofs[position][:, face])


def constraints(
    domain: Domain, asm: Assembly, supports: tuple[Support, ...], m: int
) -> Constraints:
    """Prescribed coefficients of the supports that are not weak.

    Parameters
    ----------
    domain : Domain
        The solid.
    asm : Assembly
        Functions.
    supports : tuple of Support
        Weak ones are passed over.
    m : int
        Number of components.

    Returns
    -------
    Constraints
        What is prescribed.

    Raises
    ------
    InputError
        If two supports prescribe different values where they meet.
    """
    owner = np.full((len(asm.space), m), -1)
    values = np.zeros((len(asm.space), m))
    for number, s in enumerate(supports):
        if s.weak:
            continue
        face = str(s.on)  # whole, since it is held exactly
        axis, side = divmod(NAMES.index(face), 2)
        nodes = layer(domain, asm, face)
        first = 0 if side == 0 else asm.space.shape[axis] - 1

        def f(u: FloatArray, s: Support = s) -> FloatArray:
            return values_at("value", s.value, asm.x(u), m)

        shape = list(asm.space.shape)
        shape[axis] = 1
        c = np.broadcast_to(asm.space.interpolate(f, fixed={axis: first}), (*shape, m))
        index = list(np.unravel_index(asm.space.functions[nodes], asm.space.shape))
        index[axis] = np.zeros_like(index[axis])
        at = np.ix_(nodes, np.flatnonzero(s.mask))
        new = c[tuple(index)][:, s.mask]
        off = np.abs(new - values[at]) > SAME * max(np.abs(c).max(), np.abs(values).max())
        off &= owner[at] >= 0
        if off.any():
            _refuse(asm, supports, owner[at], values[at], new, off, nodes, s)
        owner[at] = number
        values[at] = new
    return Constraints(owner >= 0, values, owner)


def _refuse(
    asm: Assembly, supports: tuple[Support, ...], owner: AnyArray, old: FloatArray,
    new: FloatArray, off: AnyArray, nodes: AnyArray, s: Support,
) -> None:  # fmt: skip
    """Say where two supports prescribe different values."""
    row, column = np.argwhere(off)[0]
    component = AXES[np.flatnonzero(s.mask)[column]] if len(s.mask) > 1 else "the value"
    other = supports[owner[row, column]].on
    raise InputError(
        f"supports on {other!r} and {s.on!r} contradict each other: near the point "
        f"{np.round(asm.coordinates[nodes[row]], 6).tolist()} {component} would be "
        f"{old[row, column]:g} and {new[row, column]:g}; prescribe it once, or equal values"
    )
