"""What problems on a solid share: systems of equations, and how they are solved.

Guarantees: a body that is held, but free to move as a whole, is found before its matrix is made,
and reported with volume and place. Nothing is changed in place: every verb returns a new problem,
which shares rules, patterns and, where supports and material are the same, matrices. A solve that
does not reach its tolerance raises.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, TypeVar

import numpy as np

from ilattice._progress import Progress, staged
from ilattice._typing import FloatArray
from ilattice._validate import FixedMapping, Frozen, as_choice, as_flag, read_only
from ilattice.cutfem import discretization, integration, watching, weak
from ilattice.cutfem.conditions import Support, stiffness_at
from ilattice.cutfem.constraints import Constraints, Split, constraints
from ilattice.cutfem.discretization import Product
from ilattice.cutfem.integrals import Integrals
from ilattice.cutfem.overlaps import check_agreement
from ilattice.cutfem.pointwise import FluxOn
from ilattice.errors import InputError
from ilattice.linalg._engines import ENGINES
from ilattice.linalg.solvers import LARGEST, Solver, SolveReport
from ilattice.linalg.symmetric import Symmetric

R = TypeVar("R", bound=Any)
ISLANDS = ("drop", "refuse")
#: Weight of void above which what it takes of the energy is estimated.
HEAVY = 1e-6
#: Energies below this part of those of nodes that move one by one are those of rigid-body modes.
AT_REST = 1e-13
#: A motion is free if the part of it in what is held is below this.
FREE = 1e-10


@dataclass(frozen=True, eq=False)
class System(Frozen):
    """Linear equations of a problem, on the nodes that are not prescribed.

    Attributes
    ----------
    b : ndarray, shape (n,)
        Right-hand side.
    near_nullspace : ndarray, shape (n, k)
        Rigid-body modes, or the constant, at the nodes in space.
    coordinates : ndarray, shape (nodes, 3)
        Where the nodes are, in space.
    constraints : Constraints
        What is prescribed, to go back to all coefficients.
    """

    _half: Symmetric
    b: FloatArray
    near_nullspace: FloatArray
    coordinates: FloatArray
    constraints: Constraints

    @property
    def K(self) -> Any:
        """The whole matrix as a `bsr_array`, put together at every call."""
        return self._half.whole()


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Problem(Integrals):
    """A solid with supports and loads, and its equations; use `Elasticity` or `Heat`.

    Attributes are those of `Posed`.
    """

    lack: ClassVar[str] = "nothing holds the solid: add a support before solving"
    energy_name: ClassVar[str] = "the strain energy"

    def _own(self, solution: R) -> R:
        """A solution that has the functions of this problem, or `InputError`."""
        found, wanted = solution.coefficients.shape, (len(self.assembly.space), self.m)
        if found != wanted:
            raise InputError(
                f"solution must be one of this problem, with coefficients of shape {wanted}, got "
                f"{found}"
            )
        return solution

    @cached_property
    def constraints(self) -> Constraints:
        """Prescribed coefficients."""
        check_agreement(self.domain, self.assembly, self.supports, self.m)
        return constraints(self.domain, self.assembly, self.supports, self.m)

    def _strong_reactions(
        self, c: FloatArray, stored: FloatArray | float = 0.0
    ) -> dict[str, FloatArray]:
        """Sums (m,) of what is missing in the equations of prescribed coefficients, by place.

        `stored` (functions, m) is what goes into storage.
        """
        out: dict[str, FloatArray] = {}
        r = self._times(c) - self.forces() - self._from_supports() + stored
        for number, s in enumerate(self.supports):
            if not s.weak:
                mine = np.where(self.constraints.owner == number, r, 0.0).sum(axis=0)
                out[str(s.on)] = out.get(str(s.on), 0.0) + mine
        return out

    def _reactions(
        self, c: FloatArray, flux_on: FluxOn, stored: FloatArray | float = 0.0
    ) -> dict[str, FloatArray]:
        """What comes in (m,) through places of supports and springs; see `_strong_reactions`."""
        out = self._strong_reactions(c, stored)
        for support in self.weakly_imposed:
            terms = weak.terms_of(self, support)
            found = weak.reaction(self, terms, support.value, c, flux_on).sum(axis=0)
            out[str(support.on)] = out.get(str(support.on), 0.0) + found
        return out

    def _rigid_modes(self, x: FloatArray) -> FloatArray:
        """Rigid-body modes (n, m, k) at points of space; constants, of what does not turn."""
        return np.tile(np.eye(self.m), (len(x), 1, 1))

    def _starts(self, x: FloatArray) -> FloatArray:
        """Displacements (n, m, k) at which coarse solutions are looked for first."""
        return self._rigid_modes(x)

    @cached_property
    def system(self) -> System:
        """The equations, prescribed coefficients eliminated."""
        self._check_solvable()
        watching.check_functions(self, self.constraints.values)
        con, x = self.constraints, self.assembly.coordinates
        f = self.forces() + self._from_supports()
        if con.values.any():
            f -= self._times(con.values)
        size = np.ptp(x, axis=0).max()
        modes = self._rigid_modes((x - x.mean(axis=0)) / size)
        modes = np.where(con.fixed[:, :, None], 0.0, modes)[con.nodes]
        return System(
            self._reduced(), con.restrict(f).ravel(), modes.reshape(-1, modes.shape[2]),
            x[con.nodes], con,
        )  # fmt: skip

    def _check_solvable(self) -> None:
        """Refuse equations that are not all of the problem."""

    @property
    def _stiffness(self) -> Symmetric:
        """See `matrix`.

        Once there is a `system`, it is put together from that and what that leaves out: one of both
        takes most of the memory that an analysis needs.
        """
        if "split" not in self._held:
            return super()._stiffness
        pattern = self.assembly.pattern
        return self._held["split"].together(pattern.indptr, pattern.indices)

    @property
    def _split(self) -> Split:
        if "split" not in self._held:
            self._held["split"] = self.constraints.split(self._stiffness)
            self._held.pop("matrix", None)
        made: Split = self._held["split"]
        return made

    def _times(self, c: FloatArray) -> FloatArray:
        """The matrix times coefficients (functions, m)."""
        return self._split.times(c)

    def _reduced(self) -> Symmetric:
        return self._split.free

    def prepare(self, progress: Progress = None, *, held: bool = False) -> None:
        """What solving begins with, in stages that have names.

        Parameters
        ----------
        progress : bool or callable, optional
            "cells", "rules", "supports" and "matrix"; see `ilattice._progress.track`.
        held : bool
            Refuse a body that is free to move, before its matrix is made.
        """
        domain = self.domain
        work: dict[str, Any] = {"cells": lambda: domain.cut.status, "rules": lambda: domain.volume}
        if as_flag("held", held):
            work["supports"] = self.check_held
        staged(work | {"matrix": lambda: self._split}, progress)

    def _check_supports(self) -> None:
        if not self.supports and not self.springs:
            raise InputError(self.lack)

    def check_held(self) -> None:
        """Refuse a body that is free to move.

        Raises
        ------
        InputError
            If there is no support, or a motion of a part without energy is free.
        """
        self._check_supports()
        for part, (free, most) in self.free_modes.items():
            raise InputError(
                f"{free} of {most} rigid-body modes are free, or nearly so, in "
                f"{self.domain.parts.describe(np.array([part]))}; hold more components, or a place "
                "that is not 1e4 times smaller than the part"
            )

    @cached_property
    def free_modes(self) -> FixedMapping[int, tuple[int, int]]:
        """Parts with free rigid-body modes: how many, and how many there are."""
        out = {}
        for part in self.parts[0]:
            gram = self._held_modes(int(part))
            values = np.linalg.eigvalsh(gram / max(np.trace(gram), 1e-300))
            free = int((values < FREE).sum())
            if free:
                out[int(part)] = free, len(values)
        return FixedMapping(out)

    def _held_modes(self, part: int) -> FloatArray:
        """Products (k, k) of rigid-body modes of a part in what is held, in units of its size."""
        asm, parts = self.assembly, self.domain.parts
        mine = np.searchsorted(asm.space.cells, parts.cells[parts.labels == part])
        near = np.zeros(len(asm.space), bool)
        near[asm.space.dofs[mine]] = True
        nodes = np.flatnonzero(near)
        x = asm.coordinates
        centre, size = x[nodes].mean(axis=0), np.ptp(x[nodes], axis=0).max()
        held = self._rigid_modes((x[nodes] - centre) / size)[self.constraints.fixed[nodes]]
        gram = held.T @ held
        for s in self.weakly_imposed:
            rule = self.domain.edge(asm, s.on)
            inside = np.isin(rule.cells, asm.space.cells[mine])[rule.owners]
            x = rule.points[inside]
            mask = np.broadcast_to(s.mask, (len(x), self.m)) if isinstance(s, Support) else (
                stiffness_at(self.spring_name, s.stiffness, x, self.m) > 0
            )  # fmt: skip
            at = self._rigid_modes((x - centre) / size)
            if isinstance(s, Support) and s.normal:
                assert rule.normals is not None
                at = np.einsum("qi,qik->qk", rule.normals[inside], at)
            else:
                at = at[mask]
            gram += at.T @ at
        return gram

    def _solve(
        self, method: str, tol: float, max_iterations: int, progress: Progress
    ) -> tuple[FloatArray, SolveReport | None]:
        """All coefficients, and what the solver reports."""
        as_choice("method", method, ("auto", *ENGINES))
        self._check_supports()
        self.prepare(progress, held=True)
        system = self.system
        if not len(system.b):
            return system.constraints.values, None
        key = ("solver", method)
        if key not in self._held:
            self._held[key] = Solver(
                system._half, near_nullspace=system.near_nullspace, method=method,
                coordinates=system.coordinates,
            )  # fmt: skip
        if not system.b.any():
            return system.constraints.values, _at_rest(self._held[key].method, len(system.b))
        if not np.abs(system.b).max() <= LARGEST:
            raise InputError(
                "loads: forces or prescribed values are so large that their squares overflow; use "
                f"other units, so that those of a node are below {LARGEST:g}"
            )
        solver = self._held[key]
        x, report = solver.solve(
            system.b, tol=tol, max_iterations=max_iterations, progress=progress
        )
        c = system.constraints.expand(x.reshape(-1, self.m))
        energy = self._energy_of(solver.multiply, c)
        error = discretization.of_work(self._discretization_error(solver.multiply, c, energy))
        locked = self._locked(c) if error != 0.0 else 0.0  # where rounding is all that is left
        thin = locked > (discretization.WARNED if np.isnan(error) else error)
        error = locked if thin else error
        discretization.warn(
            error, self.energy_name, self.assembly.space, kept=self._keeps_volume, thin=thin,
            varies=any(not phase.constant for phase in self.law.phases),
        )  # fmt: skip
        rules = self._rules_error(c, energy)
        integration.warn(rules, error, self.energy_name)
        return c, replace(report, discretization_error=error + rules)

    def _energy_of(self, product: Product, c: FloatArray) -> float:
        """What errors are relative to: twice the energy of a solution."""
        con = self.constraints
        if (
            con.values.any()
            or self.weakly_imposed
            or any(f.kind == "temperature" for f in self.loads)
        ):
            return self._solid_energy(c)
        x = c[con.nodes].ravel()
        return float(x @ product(x))

    def _discretization_error(self, product: Product, c: FloatArray, energy: float) -> float:
        """Part of an energy that the cells miss of c (functions, m); see `relative_error`."""
        space, con = self.assembly.space, self.constraints
        levels = self.domain.once(
            ("coarser", space), lambda: discretization.Levels(space, self.assembly.nodes_of)
        )
        diagonal = np.ones_like(c)
        diagonal[con.nodes] = self._reduced().diagonal().reshape(-1, self.m)

        def multiply(v: FloatArray) -> FloatArray:
            out = np.zeros_like(v)
            out[con.nodes] = product(v[con.nodes].ravel()).reshape(-1, self.m)
            return np.where(con.fixed, 0.0, out)

        jumps = self.assembly.ghost_energy(c, self._ghost_stiffness)
        domain = self.domain
        if domain.stabilization == "void" and (domain.weight or 0.0) > HEAVY:
            void = (self._energy_on(c, rule) for rule in domain.void_rules(self.assembly))
            jumps += 2.0 * sum(void)  # it is missing in the solid, and makes it too stiff
        return discretization.relative_error(
            levels, multiply, self._starts, diagonal, c, con.fixed, energy, jumps
        )

    def _rules_error(self, c: FloatArray, energy: float) -> float:
        """Part of an energy that rules miss; none of one that rounding leaves of a rigid motion."""
        con = self.constraints
        nodes = self._reduced().diagonal() @ np.where(con.fixed, 0.0, c * c)[con.nodes].ravel()
        return integration.drawn_error(self, c, energy) if energy > AT_REST * nodes else 0.0

    def _locked(self, c: FloatArray) -> float:
        """By how much thin parts are too stiff in bending, of what bends; see `locking`."""
        del c
        return 0.0

    @property
    def _keeps_volume(self) -> bool:
        """Whether estimates are those of a solid that gives in, since the material does not."""
        return False


def _at_rest(method: str, size: int) -> SolveReport:
    """How a system without any load was solved."""
    none = read_only(np.zeros(1))
    return SolveReport(method, 0, 0.0, none, 1.0, 0.0, 0.0, size, 0.0, discretization_error=0.0)
