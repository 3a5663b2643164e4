"""Sparse matrices of a space: the pattern once, cell matrices in batches, rows filled in parallel.

Guarantees: matrices are symmetric to the bit and the same for any number of threads; one pattern
serves stiffness, mass, geometric stiffness, conduction and every design with the same active
cells; besides the matrix, memory is bounded by `BATCH_BYTES`. Quadrature rules are made by the
caller, once.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ilattice._geometry import grid_points
from ilattice._memory import need
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import Frozen, read_only
from ilattice.bspline import _kernels_basis as basis
from ilattice.cutfem import _kernels_assembly as kernels
from ilattice.cutfem.space import IDENTITY, SplineSpace
from ilattice.cutfem.stabilise import GhostFaces, LoneCells, Stiffness
from ilattice.errors import InputError
from ilattice.linalg.symmetric import Symmetric
from ilattice.macroshape.maps import SplineMap
from ilattice.quadrature.grid import DividedGrid
from ilattice.quadrature.rules import Quadrature, compressed_cells, in_space, some_cells

BATCH_BYTES = 1 << 24  # the allocator keeps arrays of this size, so that they are warm
CHUNKS = 64  # of rows, each with scratch for all columns
#: Rows per function, and kind of blocks, of each kind of cell matrices.
KINDS = {
    kernels.MASS: (1, kernels.SCALAR),
    kernels.TENSOR: (1, kernels.SCALAR),
    kernels.PAIRS: (3, kernels.ELASTIC),
    kernels.JETS: (4, kernels.ENTRIES),
    kernels.STIFFNESS: (3, kernels.ENTRIES),
}

Density = Callable[[Quadrature], tuple[FloatArray | None, FloatArray | None]]


@dataclass(frozen=True, eq=False)
class Pattern(Frozen):
    """Which nodes couple: those that share an element.

    Attributes
    ----------
    half : bool
        Whether rows have the columns on and right of the diagonal only.
    start, where : ndarray
        The places of node i in `dofs` are where[start[i]:start[i + 1]].
    owner : ndarray
        Element of every place.
    first : ndarray
        The nodes of element e are dofs[first[e]:first[e + 1]].
    dofs : ndarray
        Nodes, element by element.
    indptr, indices : ndarray, int32
        Compressed rows, with increasing columns.
    """

    half: bool
    start: IntArray
    where: IntArray
    owner: AnyArray
    first: IntArray
    dofs: AnyArray
    indptr: AnyArray
    indices: AnyArray

    @classmethod
    def of(cls, groups: list[AnyArray], n: int, *, half: bool = True) -> "Pattern":
        """Pattern of elements, given as arrays (elements, nodes), on n nodes."""
        dofs = np.concatenate([g.ravel() for g in groups]).astype(np.int32)
        sizes = np.concatenate([np.full(len(g), g.shape[1]) for g in groups])
        first = np.append(0, np.cumsum(sizes))
        owner = np.repeat(np.arange(len(sizes), dtype=np.int32), sizes)
        start, where = kernels.incidence(dofs, n)
        count = np.zeros(n, np.int64)
        elements = (half, start, where, owner, first, dofs, CHUNKS)
        kernels.count_columns(CHUNKS, *elements, count)
        indptr = np.append(0, np.cumsum(count)).astype(np.int32)
        indices = np.empty(indptr[-1], np.int32)
        kernels.list_columns(CHUNKS, *elements, indptr, indices)
        return cls(half, start, where, owner, first, dofs, indptr, indices)

    @cached_property
    def _reach(self) -> int:
        """Largest distance of two columns of one row, and one."""
        last = self.indices[self.indptr[1:] - 1]
        return int((last - self.indices[self.indptr[:-1]]).max(initial=0)) + 1

    def add(
        self, data: FloatArray, blocks: int, elements: IntArray, A: FloatArray, p: float, q: float
    ) -> None:
        """Add the matrices A of some elements; see `_kernels_assembly.add_block`."""
        if not len(elements):
            return
        slot = np.full(len(self.first) - 1, -1, np.int32)
        slot[elements] = np.arange(len(elements))
        near = self.dofs[self.first[elements.min()] : self.first[elements.max() + 1]]
        low, high = int(near.min()), int(near.max()) + 1
        kernels.fill(
            high - low, blocks, self.start[low:], self.where, self.owner, self.first, self.dofs,
            slot, self._reach, self.indptr[low:], self.indices, A, p, q, data,
        )  # fmt: skip

    def matrix(self, data: FloatArray) -> Symmetric:
        """The symmetric matrix of blocks (count, m, m), of a pattern that is one half."""
        assert self.half
        offsets, columns = (np.require(a, requirements="W") for a in (self.indptr, self.indices))
        return Symmetric(offsets, columns, data)


@dataclass(frozen=True, eq=False)
class Assembly(Frozen):
    """What integrals over cells need: functions, map, ghost faces.

    Attributes
    ----------
    space : SplineSpace
        Functions.
    through : SplineMap or None
        Map to space.
    ghost : GhostFaces or None
        Faces on which jumps are penalised.
    lone : LoneCells or None
        Cells in which what is beyond linear is penalised.
    seam : Quadrature or None
        Rule in space on the surface between phases, by pairs of elements, which couple there.
    half : bool
        Whether matrices are symmetric, and their upper halves are made only.
    """

    space: SplineSpace
    through: SplineMap | None = None
    ghost: GhostFaces | None = None
    lone: LoneCells | None = None
    seam: Quadrature | None = None
    half: bool = True

    @cached_property
    def pattern(self) -> Pattern:
        """Couplings through cells, and through ghost faces where there are any."""
        couplings = float((2 * self.space.degree + 1) ** 3) * len(self.space)
        couplings *= 0.5 if self.half else 1.0
        need(8.0 * couplings, _told(self.space, 1), "use fewer cells, or a lower degree")
        faces = self.ghost.dofs(self.space) if self.ghost is not None else []
        pairs = np.concatenate([self.space.dofs[at] for at in self.sides], axis=1)
        return Pattern.of([self.space.dofs, *faces, pairs], len(self.space), half=self.half)

    @cached_property
    def sides(self) -> tuple[IntArray, IntArray]:
        """Positions in the space of the elements on both sides of each pair of the seam."""
        if self.seam is None:
            return read_only(np.zeros(0, np.int64)), read_only(np.zeros(0, np.int64))
        assert self.seam.neighbours is not None
        low, high = (
            np.searchsorted(self.space.cells, c) for c in (self.seam.cells, self.seam.neighbours)
        )
        return read_only(low), read_only(high)

    def zeros(self, m: int) -> FloatArray:
        """Blocks of a matrix with m components per node, all zero."""
        count = len(self.pattern.indices)
        need(8.0 * m * m * count, _told(self.space, m), "use fewer cells, or a lower degree")
        return np.zeros((count, m, m))

    # ---------------------------------------------------------------- the map

    @cached_property
    def affine(self) -> FloatArray | None:
        """The Jacobian (1, 3, 3) of the map if it is the same everywhere, else None."""
        return IDENTITY if self.through is None else constant_jacobian(self.through)

    def jacobians(self, u: FloatArray) -> FloatArray:
        """Jacobians (n, 3, 3), or (1, 3, 3) if they are all the same."""
        if self.affine is not None:
            return self.affine
        assert self.through is not None
        return self.through.jacobian(u)

    def x(self, u: FloatArray) -> FloatArray:
        """Points of space."""
        return u if self.through is None else self.through.x(u)

    @cached_property
    def coordinates(self) -> FloatArray:
        """Coefficients (functions, 3) of x: where nodes are; exact if the map is in the space.

        Where the grid is closed but the map is not, x jumps at the seam, and no spline follows it:
        nodes are at the Greville abscissae then.
        """
        return self.nodes_of(self.space)

    def nodes_of(self, space: SplineSpace) -> FloatArray:
        """The `coordinates` of the functions of a space on the same box."""
        ring = (False,) * 3 if self.through is None else self.through.closed
        if any(g and not r for g, r in zip(space.grid.closed, ring, strict=True)):
            at = np.unravel_index(space.functions, space.shape)
            sites = [x[i] for x, i in zip(space.sites, at, strict=True)]
            return read_only(np.array(self.x(np.stack(sites, axis=1))))
        c = space.interpolate(self.x)
        return read_only(c.reshape(-1, 3)[space.functions])

    # ---------------------------------------------------------------- integrals

    def batches(self, rule: Quadrature, entries: int) -> Iterator[tuple[IntArray, slice, slice]]:
        """Parts of a rule: positions of the cells in the space, slices of cells and of points."""
        position = np.searchsorted(self.space.cells, rule.cells)
        size = max(BATCH_BYTES // (8 * entries), 64)
        for i in range(0, len(rule.cells), size):
            part = slice(i, min(i + size, len(rule.cells)))
            rows = slice(int(rule.offsets[part.start]), int(rule.offsets[part.stop]))
            yield position[part], part, rows

    def owners(self, rule: Quadrature) -> IntArray:
        """Position in the space of the cell of each point of a rule, (n,).

        Of rules by cells, not elements, in cells with several that in which the point is.
        """
        space = self.space
        at = np.minimum(np.searchsorted(space.cells, rule.cells), len(space.cells) - 1)
        out = at[rule.owners]
        missing = space.cells[at] != rule.cells
        if isinstance(space.grid, DividedGrid) and rule.grid is not space.grid:
            beside = missing | np.isin(rule.cells, space.grid.several)
            rows = np.flatnonzero(beside[rule.owners])
            u = rule.points if rule.parameters is None else rule.parameters
            out[rows] = space.locate(u[rows])
            missing = np.array(out < 0)
        if missing.any():
            raise InputError(
                "rule has points in cells without functions, such as those of parts that nothing "
                "holds; take a rule of the problem, as problem.domain.solid(problem.assembly)"
            )
        return out

    def add_cells(
        self, data: FloatArray, rule: Quadrature, kind: int, d: FloatArray, p: float = 1.0,
        q: float = 0.0,
    ) -> None:  # fmt: skip
        """Add integrals over the cells of a rule in parameters.

        Parameters
        ----------
        data : ndarray, shape (blocks, m, m)
            Where to add; m is 4 for ``JETS``: products of the three derivatives and the value.
        rule : Quadrature
            Points in parameters, in active cells.
        kind : int
            See `_kernels_assembly.cell_matrices`.
        d : ndarray, shape (n, 1), (n, 6), (n, 36), or one row for all
            Coefficients at the points.
        p, q : float
            Factor, or Lamé constants for pairs of derivatives.
        """
        nb = self.space.dofs.shape[1]
        directions, blocks = KINDS[kind]
        size = directions * nb
        for at, part, rows in self.batches(rule, size * size):
            A = np.empty((len(at), size, size))
            u = rule.points[rows]
            kernels.cell_matrices(
                len(at), kind, *self.space._tables, self.space.cell_indices[at],
                self.space.boxes[at], rule.offsets[part.start : part.stop + 1] - rows.start, u,
                rule.weights[rows], self.jacobians(u), d if len(d) == 1 else d[rows], A,
            )  # fmt: skip
            self.pattern.add(data, blocks, at, A, p, q)

    def add_blocks(self, data: FloatArray, cells: IntArray, A: FloatArray) -> None:
        """Add matrices (cells, m nb, m nb) of active cells, given by position."""
        self.pattern.add(data, kernels.BLOCKS, cells, A, 1.0, 0.0)

    def add_pairs(self, data: FloatArray, first: int, A: FloatArray) -> None:
        """Add matrices (pairs, 2 m nb, 2 m nb) of pairs of the seam from a first one on."""
        assert self.seam is not None
        begin = len(self.pattern.first) - 1 - len(self.seam.cells) + first
        self.pattern.add(data, kernels.BLOCKS, begin + np.arange(len(A)), A, 1.0, 0.0)

    def add_ghost(self, data: FloatArray, stiffness: Stiffness | None) -> None:
        """Add the penalties: scaled with a stiffness, or those for masses."""
        if self.lone is not None and len(self.lone.cells):
            rows, A = self.lone.matrices(self.space, self.jacobians, stiffness)
            self.pattern.add(data, kernels.SCALAR, rows, A, 1.0, 0.0)
        if self.ghost is None:
            return
        first = len(self.space.cells)
        for at, A in self.ghost.matrices(self.space, self.jacobians, stiffness, BATCH_BYTES):
            self.pattern.add(data, kernels.SCALAR, first + at, A, 1.0, 0.0)

    def ghost_energy(self, c: FloatArray, stiffness: Stiffness) -> float:
        """Twice the energy that the penalties take of coefficients (functions, m)."""
        total = 0.0
        if self.lone is not None and len(self.lone.cells):
            rows, A = self.lone.matrices(self.space, self.jacobians, stiffness)
            near = c[self.space.dofs[rows]]
            total += float((near * (A @ near)).sum())
        if self.ghost is None:
            return total
        dofs = np.concatenate(self.ghost.dofs(self.space))
        for at, A in self.ghost.matrices(self.space, self.jacobians, stiffness, BATCH_BYTES):
            near = c[dofs[at]]
            total += float((near * (A @ near)).sum())
        return total

    def vector(
        self, rule: Quadrature, f: FloatArray | None, P: FloatArray | None = None
    ) -> FloatArray:
        """Integrals of N f + P grad N as coefficients (functions, m); weights are in f and P.

        `rule` is in parameters, or in space with `parameters`.
        """
        return self.gathered(rule, self.per_cell(rule, f, P))

    def per_cell(
        self, rule: Quadrature, f: FloatArray | None, P: FloatArray | None = None
    ) -> FloatArray:
        """`vector` before it is summed over cells: (cells of the rule, nb, m)."""
        m = (f if f is not None else P).shape[1]  # type: ignore[union-attr]
        out = np.empty((len(rule.cells), self.space.dofs.shape[1], m))
        self._vectors(rule, f, P, out)
        return out

    def vector_by_parts(self, rule: Quadrature, m: int, density: Density) -> FloatArray:
        """`vector` (functions, m) of what is computed part by part: nothing is kept at all points.

        Parameters
        ----------
        rule : Quadrature
            In parameters, or in space with `parameters`.
        m : int
            Number of components.
        density : callable
            Takes a part of the rule, in space with `parameters`, and returns f (n, m) and
            P (n, m, 3) there, one of which may be None, both without weights.

        Returns
        -------
        ndarray, shape (functions, m)
            Coefficients.
        """
        out = np.empty((len(rule.cells), self.space.dofs.shape[1], m))
        per_cell = max(len(rule) // max(len(rule.cells), 1), 1)
        for _, cells, _ in self.batches(rule, per_cell * (12 + 4 * m)):
            part = in_space(some_cells(rule, cells))
            f, P = density(part)
            w = part.weights
            f = None if f is None else w[:, None] * f
            P = None if P is None else w[:, None, None] * P
            self._vectors(part, f, P, out[cells])
        return self.gathered(rule, out)

    def _vectors(
        self, rule: Quadrature, f: FloatArray | None, P: FloatArray | None, out: FloatArray
    ) -> None:
        """Integrals of N f + P grad N over the cells of a rule, out (cells, nb, m)."""
        u = rule.points if rule.parameters is None else rule.parameters
        m = out.shape[2]
        f = np.zeros((0, m)) if f is None else f
        P = np.zeros((0, m, 3)) if P is None else P
        at = np.searchsorted(self.space.cells, rule.cells)
        J = self.jacobians(u) if len(P) else IDENTITY
        basis.vectors(
            len(at), *self.space._tables, self.space.cell_indices[at], self.space.boxes[at],
            rule.offsets, u, J, np.ascontiguousarray(f), np.ascontiguousarray(P), out,
        )  # fmt: skip

    def gathered(self, rule: Quadrature, parts: FloatArray) -> FloatArray:
        """Sums (functions, m) of what is given per cell of a rule and function, (cells, nb, m)."""
        nodes = self.space.dofs[np.searchsorted(self.space.cells, rule.cells)].ravel()
        m = parts.shape[2]
        columns = [np.bincount(nodes, parts[..., k].ravel(), len(self.space)) for k in range(m)]
        return np.stack(columns, axis=1)

    def on_rule(
        self, c: FloatArray, rule: Quadrature, *, in_space: bool = True
    ) -> Iterator[tuple[slice, FloatArray, FloatArray]]:
        """Values and gradients at the points of a rule, in batches with their rows.

        Gradients are those in space, or, which needs no Jacobians, in parameters.
        """
        u = rule.points if rule.parameters is None else rule.parameters
        m, c = c.shape[1], np.array(c, order="C")  # writable: read-only ones are of another type
        per_cell = max(len(rule) // max(len(rule.cells), 1), 1)
        owners = self.owners(rule)
        for _, _, rows in self.batches(rule, per_cell * (4 * m + 9)):
            owner = owners[rows]
            value, gradient = np.empty((len(owner), m)), np.empty((len(owner), m, 3))
            basis.fields(
                len(owner), *self.space._tables, self.space._ijk, self.space._boxes,
                self.space.dofs, owner, u[rows], self.jacobians(u[rows]) if in_space else IDENTITY,
                c, value, gradient,
            )  # fmt: skip
            yield rows, value, gradient

    def evaluate(self, c: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values (n, m) and gradients in space (n, m, 3) of a field."""
        return self.space.evaluate(c, u, self.jacobians(u))


def _told(space: SplineSpace, m: int) -> str:
    """What a matrix is, for messages."""
    return f"the matrix of {m * len(space)} unknowns on {len(space.cells)} cells"


def constant_jacobian(through: SplineMap) -> FloatArray | None:
    """The Jacobian (1, 3, 3) of an affine map, None for others."""
    spline = through.geometry
    if spline.weights is not None and np.ptp(spline.weights) > 0:
        return None
    axes = []
    for a in range(3):
        b = spline.breaks(a)
        t = (np.arange(spline.k[a] + 1) + 0.5) / (spline.k[a] + 1)
        axes.append((b[:-1, None] + np.diff(b)[:, None] * t).ravel())
    u = grid_points(*axes)
    J = through.jacobian(u)
    middle = J.mean(axis=0, keepdims=True)
    return read_only(middle) if np.abs(J - middle).max() <= 1e-13 * np.abs(J).max() else None


def compressed_where_long(rule: Quadrature, degree: int, least: float) -> Quadrature:
    """A rule whose cells have moments of a degree instead of more points than that takes.

    Cells that are filled by less than the part `least` are left as they are.
    """
    most = (degree + 1) ** 3
    counts = np.diff(rule.offsets)
    full = rule.grid.boxes(rule.cells)[:, 3:].prod(axis=1)
    long = (counts > most) & (rule.integrate_cells() >= least * full)
    if not long.any():
        return rule
    kept = np.where(long, most, counts)
    offsets = np.append(0, np.cumsum(kept))
    points, weights = np.empty((offsets[-1], 3)), np.empty(offsets[-1])
    rows = offsets[:-1][long, None] + np.arange(most)
    points[rows], weights[rows] = compressed_cells(rule, long, degree)
    old, new = (np.repeat(~long, n) for n in (counts, kept))
    points[new], weights[new] = rule.points[old], rule.weights[old]
    return replace(
        rule, points=read_only(points), weights=read_only(weights), offsets=read_only(offsets)
    )
