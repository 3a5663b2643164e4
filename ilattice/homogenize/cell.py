"""Mean strains or gradients as loads of a periodic cell, solved for together, with their errors.

Guarantees: what is computed is the exact energy of admissible displacements, so that on exact
geometry a stiffness comes from above. Loads that follow from others by a symmetry of the cell are
not solved for, and held to the same tolerance. Non-guarantees: those of `periodic`.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np

from ilattice._typing import FloatArray, IntArray
from ilattice.cutfem import coupling, discretization
from ilattice.cutfem.discretization import WARNED
from ilattice.cutfem.jumps import STEEP
from ilattice.cutfem.sampling import full
from ilattice.errors import ConvergenceError, PrecisionWarning
from ilattice.homogenize._estimate import EXACT, estimated, outside, warn
from ilattice.homogenize._result import SOFT, HomogenizationReport
from ilattice.homogenize._symmetry import USELESS, Way, ways
from ilattice.homogenize.periodic import PeriodicProblem
from ilattice.linalg.solvers import Solver, SolveReport
from ilattice.quadrature.rules import Quadrature

#: Faces between cells, per direction, at which material is compared, and how far beside them, in
#: edges of cells.
FACES, BESIDE = 4096, 1e-6
#: Loads below this part of the largest one are rounding.
ROUNDING = 1e-13
#: Parts of a relaxed energy that coarser cells seem to miss and are rounding, and that rounding
#: leaves in a property at least.
UNSEEN, ROUNDED = 1e-11, 1e-12
#: Part of a property above which what rounding leaves is no longer told but refused.
DROWNED = 0.5
#: Factor between materials up to which cells are solved for in double precision.
CONTRAST = 1e9
#: Unknowns up to which a factor is faster than multigrid; steps from which on it takes over.
SMALL, MANY = 3000, 100


@dataclass(frozen=True, eq=False)
class Answer:
    """Solutions of all loads of a cell.

    Attributes
    ----------
    energies : ndarray, shape (k, k)
        What the loads do on the solutions: the part of the mean stiffness that is relaxed.
    missed : ndarray, shape (k,)
        Part of these that splines on cells twice as long do not have: little in laminates and in
        cells of one material.
    unsolved : ndarray, shape (k,)
        Energies of what solving left of the errors, about, and from above.
    coefficients : ndarray, shape (functions, m, k)
        Solutions.
    report : SolveReport or None
        Of the solver.
    solved : int
        Number of loads that were solved from nothing.
    symmetry : float
        Largest relative residual of the others as they followed by symmetry; NaN without others.
    """

    energies: FloatArray
    missed: FloatArray
    unsolved: FloatArray
    coefficients: FloatArray
    report: SolveReport | None
    solved: int = 0
    symmetry: float = float("nan")


class CellProblem(PeriodicProblem):
    """Mean strains or gradients as loads: to be mixed into `Elasticity` or `Heat`."""

    #: Mean strains (k, 3, 3) or gradients (k, 3) of unit size.
    loads_of_cells: ClassVar[FloatArray]

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
            0 if answer is None else answer.solved,
            float("nan") if answer is None else answer.symmetry,
        )  # fmt: skip

    def _minus_flux(self, load: FloatArray, rule: Quadrature) -> tuple[None, FloatArray]:
        """Flux P (n, m, 3) that a mean gradient loads with at the points of a rule in space."""
        assert rule.parameters is not None
        gradient = np.broadcast_to(load.reshape(self.m, 3), (len(rule), self.m, 3))
        flux = self._flux(gradient, rule.parameters, self.assembly.owners(rule))
        return None, -self.law.components(flux)

    def _seam_force(self, load: FloatArray) -> FloatArray:
        """What the mean flux of a mean gradient adds where two phases meet."""
        asm, seam = self.assembly, self.assembly.seam
        assert seam is not None
        assert seam.parameters is not None
        u = seam.parameters
        gradient = np.broadcast_to(load.reshape(self.m, 3), (len(u), self.m, 3))
        return coupling.mean_force(self, lambda law: law.flux(asm, u, gradient))

    def load_vectors(self) -> FloatArray:
        """Forces of unit mean strains or gradients.

        Returns
        -------
        ndarray, shape (functions, m, k)
            Minus the derivatives of the energy.
        """
        asm = self.assembly
        rule = self.domain.stiff_rule(asm, constant=self.law.constant)
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
        self.prepare(progress)
        F = self.load_vectors()
        k, system = F.shape[2], self.system
        B = np.stack([system.constraints.restrict(F[..., i]).ravel() for i in range(k)], axis=1)
        length = np.linalg.norm(B, axis=0)
        there = np.flatnonzero(length > ROUNDING * max(length.max(), self._scale()))
        U, report, solver, solved, spared = np.zeros_like(B), None, None, 0, float("nan")
        found = self._ways(there)
        first = [a for a in there.tolist() if a not in found]
        how = (method, tol, max_iterations, progress)
        if first:
            U[:, first], report, solver = self._solved(B[:, first], *how)
            residuals = [self._take(b, found[b], U, B, solver) for b in sorted(found)]
            left = [b for b, r in zip(sorted(found), residuals, strict=True) if not r <= tol]
            if left:
                report = self._finish(left, U, B, solver, report, how)
            near = [r for r in residuals if r < USELESS]
            spared, solved = max(near, default=spared), len(there) - len(near)
        coefficients = np.zeros_like(F)
        for i in range(k):
            coefficients[..., i] = system.constraints.expand(U[:, i].reshape(-1, self.m))
        energies, missed, unsolved = np.zeros((k, k)), np.zeros(k), np.zeros(k)
        if solver is not None:
            KU, work = solver.multiply(U), U.T @ B
            energies = work + work.T - 0.5 * (U.T @ KU + KU.T @ U)  # off by squares only
            for a in there.tolist():
                part = 1.0
                if not self.law.constant:
                    part = self._part_missed(coefficients[..., a], float(U[:, a] @ KU[:, a]))
                missed[a] = max(part, UNSEEN)
            R = B - KU
            unsolved = np.maximum((R * solver.precondition(R)).sum(axis=0), 0.0)
            unsolved *= 1.0 if report is None else report.condition
        return Answer(energies, missed, unsolved, coefficients, report, solved, spared)

    def _solved(
        self, B: FloatArray, method: str, tol: float, max_iterations: int, progress: Any
    ) -> tuple[FloatArray, SolveReport, Solver]:
        """Solutions of right-hand sides (n, k), together."""
        loads = np.ascontiguousarray(B)
        try:
            try:
                solver = self._solver(method)
                U, report = solver.solve(
                    loads, tol=tol, max_iterations=max_iterations, progress=progress
                )
            except ConvergenceError:
                if method != "auto" or max_iterations < MANY:
                    raise
                solver = self._solver("superlu")
                U, report = solver.solve(loads, tol=tol)
        except ConvergenceError as e:
            self._explain(e)
            raise
        return U, report, solver

    def _explain(self, error: ConvergenceError) -> None:
        """Raise what it is due to, where it is due to phases that are too different."""
        contrast = self._contrast
        if contrast > CONTRAST:
            raise ConvergenceError(
                f"the equations are too ill-conditioned for double precision: the material's "
                f"stiffness or conductivity differs by a factor of {contrast:.2g} in the cell; "
                f"take {CONTRAST:g} or less, or a void instead of the soft phase"
            ) from error

    @property
    def _contrast(self) -> float:
        """Factor between the largest and the least stiffness or conductivity in the cell."""
        least, most = np.array(self._stiffnesses()).T
        return float(most.max() / least.min())

    def _stiffnesses(self) -> list[tuple[float, float]]:
        """The least and the largest stiffness or conductivity of each phase."""
        rule = self.domain.stiff_rule(self.assembly, constant=self.law.constant)
        found = [self._moduli(k, p.points) for k, p in enumerate(self.domain.of_phases(rule))]
        return [(float(s.min()), float(s.max())) for s in found]

    def _moduli(self, phase: int, u: FloatArray) -> FloatArray:
        """Stiffnesses or conductivities, (n,) or (n, k), of a phase at parameters (n, 3)."""
        raise NotImplementedError

    @cached_property
    def step(self) -> float:
        """By which factor they jump between cells in whose faces splines cannot bend."""
        if self.law.constant or not self.domain.smoothness:
            return 1.0
        parts = self.domain.of_phases(self.domain.volume)
        return max(_step(part, partial(self._moduli, k)) for k, part in enumerate(parts))

    def _ways(self, there: IntArray) -> dict[int, list[Way]]:
        """How loads may follow from others by symmetry, where one function holds one network."""
        fixed = self.constraints.fixed
        if len(self.parts[0]) != 1 or fixed.sum() != self.m or fixed.any(axis=1).sum() != 1:
            return {}
        parts = self.domain.parts
        space = self.assembly.space
        sizes = parts.solid.integrate_cells()[np.searchsorted(parts.cells, space.cells)]
        return ways(space, sizes, self._jacobian[0], self.loads_of_cells, there)

    def _take(
        self, b: int, found: list[Way], U: FloatArray, B: FloatArray, solver: Solver
    ) -> float:
        """Put into U the best of some candidates for a load; its relative residual."""
        con, best = self.constraints, np.inf
        pin = int(np.flatnonzero(con.fixed.any(axis=1))[0])
        for way in found:
            c = way(con.expand(U[:, way.source].reshape(-1, self.m)))
            x = con.restrict(c - c[pin]).ravel()
            rest = B[:, b] - solver.multiply(x)
            off = float(np.linalg.norm(rest) / np.linalg.norm(B[:, b]))
            if off < min(best, USELESS):
                best, U[:, b] = off, x
        return best

    def _finish(
        self, left: list[int], U: FloatArray, B: FloatArray, solver: Solver, report: SolveReport,
        how: tuple[Any, ...],
    ) -> SolveReport:  # fmt: skip
        """Solve for loads that do not follow, from their candidates on."""
        rest = B[:, left] - solver.multiply(np.ascontiguousarray(U[:, left]))
        part = np.linalg.norm(rest, axis=0) / np.linalg.norm(B[:, left], axis=0)
        tol = float(min(how[1] / part.max(), 0.5))
        more, again, _ = self._solved(rest, how[0], tol, *how[2:])
        U[:, left] += more
        return replace(
            report, iterations=max(report.iterations, again.iterations),
            residual=max(report.residual, again.residual * float(part.max())),
        )  # fmt: skip

    def errors_of(
        self, values: FloatArray, answer: Answer, solve: Any, tol: float, *, estimate: bool
    ) -> FloatArray:
        """Estimated errors of effective properties; see `_estimate`.

        What a material may take that jumps or waves within cells, which fewer cells do not tell,
        is added.

        Parameters
        ----------
        values : ndarray, shape (n,)
            Properties, first those of the k loads, then others that follow from all of them.
        answer : Answer
            Where it comes from.
        solve : callable
            Takes another problem and a tolerance, returns its properties.
        tol : float
            Tolerance of the solutions.
        estimate : bool
            Whether to do it.

        Returns
        -------
        ndarray, shape (n,)
            NaN where there is no estimate.
        """
        k = len(answer.energies)
        stored = values[:k] * self.cell_volume
        exact = answer.missed * answer.energies.diagonal() <= EXACT * stored
        errors = np.full(len(values), np.nan)
        if exact.all():
            errors = np.zeros(len(values))
        elif estimate:
            errors = estimated(self, values, solve, tol)
            errors[np.flatnonzero(exact)] = 0.0
        if self.step > STEEP:
            warnings.warn(
                f"the material jumps by a factor of {self.step:.3g} between cells, or from the "
                f"last to the first ones, where splines of smoothness {self.domain.smoothness} "
                "cannot bend; take smoothness=0, or phases= where it jumps",
                PrecisionWarning,
                stacklevel=outside(),
            )
        errors += self.unfollowed * np.abs(values)
        lost = self.rounding(values[:k], answer) * values[:k]
        errors[:k] = np.where(lost > 0.0, np.fmax(errors[:k], lost), errors[:k])
        return errors

    def rounding(self, values: FloatArray, answer: Answer) -> FloatArray:
        """Relative errors that solutions and differences of energies leave.

        Parameters
        ----------
        values : ndarray, shape (k,)
            Properties of the k loads.
        answer : Answer
            Where they come from.

        Returns
        -------
        ndarray, shape (k,)
            Zero where they do not count.
        """
        lost = np.maximum(ROUNDED * answer.energies.diagonal(), answer.unsolved) / self.cell_volume
        there = (lost > EXACT * values) & (values > SOFT * values.max(initial=0.0))
        return np.where(there, lost / np.where(there, values, 1.0), 0.0)

    def warn_of_error(
        self, error: float, what: str, rounding: float = 0.0, softest: float = 0.0
    ) -> None:
        """Warn of a property that is off, and by how much of rounding, or refuse it; relative.

        `softest` is by how much that of one direction may be, which entries do not tell.
        """
        message = (
            f"phases are too different: what is left of rounding is about {100 * rounding:.2g} % "
            f"of the least entry of {what}; let them differ by {CONTRAST:g} or less"
        )
        if rounding > DROWNED:
            raise ConvergenceError(message)
        if rounding > WARNED and not error > rounding:
            warnings.warn(message, PrecisionWarning, stacklevel=outside())
            return
        more = ""
        if softest > max(error, WARNED):
            much = f"{100 * softest:.2g} %" if softest < 1.0 else "more than its own size"
            more = f" (a modulus in which its entries cancel, such as E, by up to {much})"
            if not error > WARNED:
                error, what, more = softest, f"a modulus in which entries of {what} cancel", ""
        step = self.domain.degree - self.domain.smoothness
        least = max(4, 1 + (self.domain.interface is not None) - -(self.domain.degree + 1) // step)
        shape = " x ".join(map(str, self.domain.cut.grid.shape))
        warn(
            error, what,
            how=f"half and three quarters as many cells per direction{more}; take more cells, or a "
            "higher degree",
            unknown=f"the cells are too coarse to tell by how much {what} is off: {shape} cells; "
            f"take {least} or more in every direction",
        )  # fmt: skip

    def _solver(self, method: str) -> Solver:
        """The factor or hierarchy of the cell, made once; periodic ones fill factors more."""
        key, system = ("solver", method), self.system
        if key not in self._held:
            if method == "auto":
                method = "superlu" if system._half.shape[0] <= SMALL else "multigrid"
            self._held[key] = Solver(
                system._half, near_nullspace=system.near_nullspace, method=method,
                coordinates=system.coordinates,
            )  # fmt: skip
        solver: Solver = self._held[key]
        return solver

    def _part_missed(self, c: FloatArray, energy: float) -> float:
        """Estimated part of twice an energy that finer cells would add; nothing is held."""
        asm, K = self.assembly, self._stiffness
        levels = self.domain.once(
            ("coarser", asm.space), lambda: discretization.Levels(asm.space, asm.nodes_of)
        )  # as `Problem` keeps them
        return discretization.relative_error(
            levels, lambda v: (K @ v.ravel()).reshape(v.shape),
            lambda x: np.tile(np.eye(self.m), (len(x), 1, 1)),  # cells that repeat do not turn
            K.diagonal().reshape(-1, self.m), c, np.zeros(c.shape, bool), energy,
            asm.ghost_energy(c, self._ghost_stiffness),
        )  # fmt: skip

    def _scale(self) -> float:
        """Size of loads that would be called large: those without what cancels between cells."""
        raise NotImplementedError

    def warn_of_contrast(self) -> None:
        """See `warn_of_contrast`, of a cell that could be solved for."""
        warn_of_contrast(self._contrast)


def _step(part: Quadrature, moduli: Callable[[FloatArray], FloatArray]) -> float:
    """Largest factor between moduli on both sides of faces of full cells, of a rule by elements."""
    grid, whole = part.grid, full(part)
    cells, shape = grid.home(part.cells[whole]), grid.shape
    index = np.stack(np.unravel_index(cells, shape), axis=1)
    size, corner = (np.ptp(grid.domain, axis=0), grid.domain[0])
    box = grid.boxes(part.cells[whole])
    rng, worst = np.random.default_rng(0), 1.0
    for axis in range(3):
        there = index.copy()
        there[:, axis] = (there[:, axis] + 1) % shape[axis]
        at = np.flatnonzero(np.isin(np.ravel_multi_index(tuple(there.T), shape), cells))
        if not len(at):
            continue
        at = rng.permutation(at)[:FACES]
        t = np.stack([rng.random((len(at), 3))] * 2)
        t[:, :, axis] = 1.0 + BESIDE * np.array([[-1.0], [1.0]])
        u = corner + (box[at, :3] + t * box[at, 3:] - corner) % size
        found = moduli(u.reshape(-1, 3))
        a, b = np.broadcast_to(found, (2 * len(at), *found.shape[1:])).reshape(2, len(at), -1)
        worst = max(worst, float((np.maximum(a, b) / np.minimum(a, b)).max()))
    return worst


def spread(errors: FloatArray) -> FloatArray:
    """Errors (k, k) of a property of those of its diagonal: semidefinite, as those of energies."""
    root = np.sqrt(errors)
    return np.outer(root, root)


def warn_of_contrast(contrast: float) -> None:
    """Warn of materials so different that double precision leaves little of what is soft."""
    if contrast > CONTRAST:
        warnings.warn(
            f"materials differ by a factor of {contrast:.2g} in the cell: what is softer than "
            f"{SOFT:g} of the stiffest direction counts as nothing, and rounding, which `error` "
            f"need not hold, may be {100 * ROUNDED * contrast:.2g} % or more of what is soft; take "
            f"{CONTRAST:g} or less, or a void instead of the soft phase",
            PrecisionWarning,
            stacklevel=outside(),
        )
