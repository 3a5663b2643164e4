"""Problems on one cell of a periodic solid: mean strains or gradients as loads, copies all around.

`CellProblem` makes periodic what problems of `cutfem` share: functions and rules go on over the
faces of the cell, pieces of the solid are held at one function each instead of supports, and
islands, which bear nothing, are left out.

Guarantees: what is computed is the exact energy of admissible displacements, so that on exact
geometry a stiffness comes from above; what holds a piece changes no strain. Non-guarantee: cells
are boxes, or images of boxes under affine maps.
"""

import warnings
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np

from ilattice._typing import FloatArray, IntArray
from ilattice._validate import as_counts, read_only
from ilattice.cutfem import discretization
from ilattice.cutfem.assembly import Assembly, constant_jacobian
from ilattice.cutfem.connectivity import links
from ilattice.cutfem.constraints import Constraints
from ilattice.cutfem.domain import Domain
from ilattice.cutfem.grid import CutGrid, Grid, cut
from ilattice.cutfem.phases import PhasedDomain
from ilattice.cutfem.problem import Problem
from ilattice.cutfem.rules import Quadrature
from ilattice.cutfem.solvers import Solver, SolveReport
from ilattice.errors import ConvergenceError, GeometryError, InputError, PrecisionWarning
from ilattice.homogenize._result import HomogenizationReport
from ilattice.homogenize.percolation import Percolation, percolation
from ilattice.macroshape.cells import CellMap, cell
from ilattice.macroshape.lattice import Lattice
from ilattice.macroshape.maps import SplineMap
from ilattice.offsets.wall import Wall
from ilattice.tiles.catalog import get
from ilattice.tiles.mixture import Mixture
from ilattice.tiles.tile import Tile

#: Points per direction at which opposite faces of a cell are compared, and by what part of its
#: largest value there a field may jump between them.
COMPARED, JUMP = 33, 1e-3
#: A cell that lacks less than this part is full.
FULL = 1e-9
#: Loads below this part of the largest one are rounding.
ROUNDING = 1e-13
EDGES = "uvw"
#: Unknowns up to which a factor is faster than multigrid; steps from which on it takes over.
SMALL, MANY = 3000, 100


@dataclass(frozen=True, eq=False)
class Answer:
    """Solutions of all loads of a cell.

    Attributes
    ----------
    energies : ndarray, shape (k, k)
        What the loads do on the solutions: the part of the mean stiffness that is relaxed.
    errors : ndarray, shape (k,)
        Estimated errors of its diagonal.
    coefficients : ndarray, shape (functions, m, k)
        Solutions.
    report : SolveReport or None
        Of the solver.
    """

    energies: FloatArray
    errors: FloatArray
    coefficients: FloatArray
    report: SolveReport | None


class CellProblem(Problem):
    """What makes a problem one of a periodic cell: to be mixed into `Elasticity` or `Heat`."""

    #: Mean strains (k, 3, 3) or gradients (k, 3) of unit size.
    loads_of_cells: ClassVar[FloatArray]

    @property
    def cell_volume(self) -> float:
        """Volume of the cell with its voids."""
        box = np.ptp(self.domain.cut.grid.domain, axis=0)
        return float(abs(np.linalg.det(self._jacobian[0])) * np.prod(box))

    @property
    def _through(self) -> SplineMap | None:
        return self.domain.cut.through

    @property
    def _jacobian(self) -> FloatArray:
        """The Jacobian (1, 3, 3) of the affine map."""
        J = np.eye(3)[None] if self._through is None else constant_jacobian(self._through)
        assert J is not None
        return J

    # ---------------------------------------------------------------- pieces

    @cached_property
    def network(self) -> Percolation:
        """Pieces of the solid: their numbers are those of `Domain.parts`."""
        domain, parts = self.domain, self.domain.parts
        low, high = links(domain.joints)
        axis = np.repeat(np.arange(3), [len(rule.cells) for rule in domain.joints])
        grid, n = domain.elements, np.array(domain.cut.grid.shape)
        apart = grid.places(high) - grid.places(low)
        steps = (apart <= 0) & (axis[:, None] == np.arange(3))  # from the last cell to the first
        if domain.interface is not None:
            seam = (domain.interface.cells, domain.interface.neighbours)
            apart = grid.places(seam[1]) - grid.places(seam[0])
            steps = np.concatenate([steps, np.where(apart < -(n // 2), 1, 0) - (apart > n // 2)])
            low, high = (np.concatenate(pair) for pair in zip((low, high), seam, strict=True))
        keep = np.isin(low, parts.cells) & np.isin(high, parts.cells)
        low, high = (np.searchsorted(parts.cells, c[keep]) for c in (low, high))
        return percolation(len(parts.cells), low, high, steps[keep].astype(np.int64))

    @cached_property
    def parts(self) -> tuple[IntArray, IntArray]:
        """Numbers of the parts that go on in some direction, and of islands."""
        labels, ranks = self.domain.parts.labels, self.network.ranks
        rank = np.zeros(len(self.domain.parts), np.int64)
        rank[labels] = ranks[self.network.labels]
        return read_only(np.flatnonzero(rank > 0)), read_only(np.flatnonzero(rank == 0))

    @property
    def percolates(self) -> tuple[bool, bool, bool]:
        """Whether the solid goes on through the cell along each of its edges."""
        return self.network.axes

    def check_held(self) -> None:
        """Nothing: every piece is held by `constraints`."""

    @cached_property
    def assembly(self) -> Assembly:
        """Functions on the parts that go on.

        Raises
        ------
        GeometryError
            If there are only islands, or some with ``islands="refuse"``.
        """
        held, loose = self.parts
        what = self.domain.parts
        sizes = np.bincount(what.labels, what.solid.integrate_cells())
        loose = loose[sizes[loose] > FULL * sizes.sum()]  # the others are rounding
        if len(loose) and (not len(held) or self.islands == "refuse"):
            raise GeometryError(f"nothing is borne by islands, {what.describe(loose)}")
        if len(loose):
            warnings.warn(
                f"left out, because islands bear nothing: {what.describe(loose)}",
                PrecisionWarning,
                stacklevel=5,
            )
        self.domain.warn_gaps()
        return self.domain.assembly(held, weak=False)

    @cached_property
    def assembly_of_all(self) -> Assembly:
        """Functions on all parts, for the map alone."""
        return self.domain.assembly(np.arange(len(self.domain.parts)), weak=False)

    def fractions(self) -> FloatArray:
        """Parts of the cell that phases fill, islands too.

        Returns
        -------
        ndarray, shape (phases,)
            Of one phase or two.
        """
        whole = float(np.prod(np.ptp(self.domain.cut.grid.domain, axis=0)))
        phases = self.domain.of_phases(self.domain.volume)
        return np.array([rule.weights.sum() for rule in phases]) / whole

    def free_normals(self) -> FloatArray:
        """Normals (k, 3) of the faces of the cell through which nothing goes on.

        Returns
        -------
        ndarray, shape (k, 3)
            Unit vectors in space.
        """
        n = np.linalg.inv(self._jacobian[0])
        n = n / np.linalg.norm(n, axis=1, keepdims=True)
        return np.asarray(n[~np.array(self.percolates)])

    def report(self, answer: Answer | None, seconds: float) -> HomogenizationReport:
        """How it was solved.

        Parameters
        ----------
        answer : Answer or None
            Solutions, if there was a system.
        seconds : float
            Wall time.

        Returns
        -------
        HomogenizationReport
            In numbers.
        """
        solved = None if answer is None else answer.report
        return HomogenizationReport(
            "cut cells", self.domain.cut.grid.shape, 0 if solved is None else solved.size,
            0 if solved is None else solved.iterations,
            0.0 if solved is None else float(solved.residual), seconds,
        )  # fmt: skip

    @cached_property
    def constraints(self) -> Constraints:
        """One function of every piece, and of rods one that keeps them from turning."""
        asm = self.assembly
        fixed = np.zeros((len(asm.space), self.m), bool)
        for part in self.parts[0]:
            self._hold(fixed, asm, int(part))
        return Constraints(fixed, np.zeros(fixed.shape), np.where(fixed, 0, -1))

    def _hold(self, fixed: Any, asm: Assembly, part: int) -> None:
        """Mark the components that hold a piece."""
        parts, network = self.domain.parts, self.network
        rows = np.flatnonzero(parts.labels == part)
        filled = parts.solid.integrate_cells()[rows]
        cells = parts.cells[rows]
        middle = asm.space.dofs.shape[1] // 2
        held = int(np.argmax(filled))
        at = np.searchsorted(asm.space.cells, cells)
        fixed[asm.space.dofs[at[held], middle]] = True
        ways = network.ways[int(network.labels[rows[0]])]
        if self.m == 1 or len(ways) != 1:
            return
        box = self.domain.elements.boxes(cells)
        period = np.ptp(self.domain.cut.grid.domain, axis=0)
        u = box[:, :3] + 0.5 * box[:, 3:] + network.shifts[rows] * period
        x = (u - u[held]) @ self._jacobian[0].T
        turn = np.cross(self._jacobian[0] @ (ways[0] * period), x)
        best = np.abs(turn) * np.sqrt(filled / filled.max())[:, None]
        element, component = divmod(int(best.argmax()), 3)
        fixed[asm.space.dofs[at[element], middle], component] = True

    # ---------------------------------------------------------------- loads

    @property
    def _constant(self) -> bool:
        """Whether the material is the same everywhere in each phase."""
        raise NotImplementedError

    def _minus_flux(self, load: FloatArray, rule: Quadrature) -> tuple[None, FloatArray]:
        """What a mean strain or gradient loads with, (n, m, 3), at points of a rule in space."""
        raise NotImplementedError

    def _seam_force(self, load: FloatArray) -> FloatArray:
        """What the mean traction or flux of a load adds where two phases meet (functions, m)."""
        raise NotImplementedError

    def load_vectors(self) -> FloatArray:
        """Forces of unit mean strains or gradients.

        Returns
        -------
        ndarray, shape (functions, m, k)
            Minus the derivatives of the energy.
        """
        asm = self.assembly
        rule = self.domain.stiff_rule(asm, constant=self._constant)
        out = np.empty((len(asm.space), self.m, len(self.loads_of_cells)))
        for a, load in enumerate(self.loads_of_cells):
            out[..., a] = asm.vector_by_parts(rule, self.m, partial(self._minus_flux, load))
            if asm.seam is not None:
                out[..., a] += self._seam_force(load)
        return out

    def answers(self, method: str, tol: float, max_iterations: int, progress: Any) -> Answer:
        """Solve for all loads with one solver.

        Parameters
        ----------
        method, tol, max_iterations, progress : str, float, int, bool or callable
            As in `Elasticity.solve`.

        Returns
        -------
        Answer
            Solutions, and what they relax.
        """
        F = self.load_vectors()
        k, system = F.shape[2], self.system
        B = np.stack([system.constraints.restrict(F[..., i]).ravel() for i in range(k)], axis=1)
        length = np.linalg.norm(B, axis=0)
        there = np.flatnonzero(length > ROUNDING * max(length.max(), self._scale()))
        U, report, solver = np.zeros_like(B), None, None
        if len(there):
            solver = self._solver(method)
            loads = np.ascontiguousarray(B[:, there])
            try:
                U[:, there], report = solver.solve(
                    loads, tol=tol, max_iterations=max_iterations, progress=progress
                )
            except ConvergenceError:
                if method != "auto" or max_iterations < MANY:
                    raise
                solver = self._solver("superlu")
                U[:, there], report = solver.solve(loads, tol=tol)
        coefficients = np.zeros_like(F)
        for i in range(k):
            coefficients[..., i] = system.constraints.expand(U[:, i].reshape(-1, self.m))
        energies, errors = np.zeros((k, k)), np.zeros(k)
        if solver is not None:
            KU = np.stack([solver.multiply(np.ascontiguousarray(u)) for u in U.T], axis=1)
            work = U.T @ B
            energies = work + work.T - 0.5 * (U.T @ KU + KU.T @ U)  # off by squares only
            for a in there.tolist():
                whole = float(U[:, a] @ KU[:, a])
                errors[a] = whole * self._part_missed(coefficients[..., a], whole)
        return Answer(energies, errors, coefficients, report)

    def _solver(self, method: str) -> Solver:
        """The factor or hierarchy of the cell, made once; periodic ones fill factors more."""
        key, system = ("solver", method), self.system
        if key not in self._held:
            if method == "auto":
                method = "superlu" if system.K.shape[0] <= SMALL else "multigrid"
            self._held[key] = Solver(
                system.K, near_nullspace=system.near_nullspace, method=method,
                places=system.places,
            )  # fmt: skip
        solver: Solver = self._held[key]
        return solver

    def _part_missed(self, c: FloatArray, energy: float) -> float:
        """Estimated part of twice an energy that finer cells would add; nothing is held."""
        asm, K = self.assembly, self.matrix
        levels = self.domain.once(
            ("coarser", asm.space), lambda: discretization.levels(asm.space)
        )  # as `Problem` keeps them
        return discretization.relative_error(
            levels, lambda v: (K @ v.ravel()).reshape(v.shape),
            K.diagonal().reshape(-1, self.m), c, np.zeros(c.shape, bool), energy,
            asm.ghost_energy(c, self._ghost_stiffness),
        )  # fmt: skip

    def _scale(self) -> float:
        """Size of loads that would be called large: those without what cancels between cells."""
        raise NotImplementedError

    def warn_of_gaps(self) -> None:
        """Warn of edges of the cell along which nothing is borne, and refuse nothing."""
        warn_of_axes(self.percolates)


def warn_of_axes(percolates: tuple[bool, bool, bool], names: str = EDGES, rest: str = "") -> None:
    """Warn of edges of the cell along which the solid does not go on; `rest` is what bears then."""
    missing = [names[a] for a in range(3) if not percolates[a]]
    if missing:
        borne = f"only {rest} bear anything" if rest else "nothing is borne"
        warnings.warn(
            f"the solid does not go on through the cell along {', '.join(missing)}: {borne} "
            f"there{'' if rest else ', and the effective stiffness or conductivity is zero'}",
            PrecisionWarning,
            stacklevel=4,
        )


# -------------------------------------------------------------------- arguments


def as_cell(field: Any, cells: Any, *, domain: Any = None, through: Any = None) -> CutGrid | Domain:
    """A cell of a periodic solid on a grid that is closed in all directions.

    Parameters
    ----------
    field : Wall, Tile, str, BSpline, Node, callable, pair of these, CutGrid or Domain
        The solid; see `ilattice.homogenize.elastic`.
    cells : int, sequence of 3 int or Grid
        Background grid.
    domain : array_like, shape (2, 3), optional
        The box that repeats; by default the unit cube.
    through : CellMap, optional
        Affine map to space.

    Returns
    -------
    CutGrid or Domain
        The level sets on the grid.

    Raises
    ------
    InputError
        If an argument is wrong, or the field does not repeat.
    """
    if isinstance(field, (CutGrid, Domain)):
        grid = field.grid if isinstance(field, CutGrid) else field.cut.grid
        if not all(grid.closed):
            raise InputError(f"field: its grid must be closed in all directions, got {grid.closed}")
        return field
    field, through = _as_solid(field, through)
    if through is not None and not isinstance(through, CellMap):
        affine = isinstance(through, SplineMap) and constant_jacobian(through) is not None
        if not affine:
            raise InputError(
                f"through must be a cell that repeats, of il.macroshape.cell(), got {through!r:.80}"
            )
    if isinstance(cells, Grid):
        grid = Grid(cells.axes, (True,) * 3)
    else:
        box = np.array([[0.0] * 3, [1.0] * 3]) if domain is None else np.asarray(domain, float)
        if domain is None and through is not None:
            box = through.domain
        if box.shape != (2, 3) or not (box[0] < box[1]).all():
            raise InputError(f"domain must be a lower and an upper corner, got {domain!r:.80}")
        counts = as_counts("cells", cells)
        x, y, z = (np.linspace(box[0, a], box[1, a], counts[a] + 1) for a in range(3))
        grid = Grid((x, y, z), (True,) * 3)
    out = cut(field, grid, through=through)
    check_repeats(out, field)
    return out


def _as_solid(field: Any, through: Any) -> tuple[Any, Any]:
    """What is cut, and its map."""
    if isinstance(field, str):
        field = get(field)
    if isinstance(field, Tile):
        through = cell(field.cell) if through is None else through
        field = Lattice(field, through=through).offset((np.inf, 0.0))
    if isinstance(field, (Lattice, Mixture)):
        raise InputError(
            "field must be a solid: give a lattice through il.macroshape.cell() a thickness by "
            f".offset(...), got {field!r:.80}"
        )
    if isinstance(field, Wall):
        if through is not None and through is not field.lattice.through:
            raise InputError("through: a wall has its own map; make the lattice through the cell")
        return field, field.lattice.through
    return field, through


def check_repeats(solid: CutGrid, field: Any) -> None:
    """Refuse a field whose opposite faces do not fit together.

    Parameters
    ----------
    solid : CutGrid
        Level sets on the grid.
    field : object
        What they come from.

    Raises
    ------
    InputError
        With the largest jump, and its place.
    """
    tile = getattr(getattr(field, "lattice", None), "tile", None)
    sets: list[Any] = [solid.sets]
    if isinstance(tile, Tile):
        lattice = field.lattice
        sets.append(lambda u: tile(lattice._in_tile(lattice.tile_coordinates(u)))[:, None])
    _refuse_jumps("field", sets, solid)


def check_phases(domain: Domain) -> None:
    """Refuse phases that meet on faces of the cell, where no level set joins them.

    Parameters
    ----------
    domain : Domain
        Of one phase or two.

    Raises
    ------
    InputError
        With the largest jump of the level set, and its place.
    """
    if isinstance(domain, PhasedDomain):
        level, solid = domain.level, domain.cut
        _refuse_jumps("phases", [lambda u: level(u)[:, None]], solid)


def _refuse_jumps(name: str, sets: list[Any], solid: CutGrid) -> None:
    """Refuse functions (n, sets) that change their signs from a face of the cell to the other."""
    lo, hi = solid.grid.domain
    s = np.linspace(0.0, 1.0, COMPARED)[:-1] + 0.31 / COMPARED
    flat = np.stack(np.meshgrid(s, s, indexing="ij"), -1).reshape(-1, 2)
    ends = np.zeros((3, 2, len(flat), 3))
    for a in range(3):
        ends[a] = np.insert(flat, a, 0.0, axis=1) * (hi - lo) + lo
        ends[a, 1, :, a] = hi[a]
    worst, place, axis = 0.0, lo, 0
    for f in sets:
        values = f(ends.reshape(-1, 3)).reshape(3, 2, len(flat), -1)
        scale = np.maximum(np.abs(values).max(axis=(0, 1, 2)), 1e-300)
        first, last = values[:, 0], values[:, 1]
        jump = np.where((first < 0) != (last < 0), np.abs(first - last) / scale, 0.0).max(axis=2)
        if jump.max() > worst:
            axis, i = (int(k) for k in np.unravel_index(jump.argmax(), jump.shape))
            worst, place = float(jump.max()), ends[axis, 0, i]
    if worst > JUMP:
        told = ", ".join(f"{c:.4g}" for c in place)
        raise InputError(
            f"{name} does not repeat: between the faces {EDGES[axis]}=0 and {EDGES[axis]}=1 it "
            f"jumps by up to {worst:.2g} of its largest value on them, at ({told}); give one that "
            "is the same on opposite faces"
        )
