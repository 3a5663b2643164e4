"""Heat conduction on a solid that is cut out of a grid, steady or in time.

::

    problem = il.cutfem.Heat(wall, cells=(64, 8, 8), conductivity=200.0)
    problem = problem.fix("w=0", 20.0).convection("surface", 50.0, around=80.0)
    temperature = problem.solve()
    problem.evolve(60.0, steps=30, initial=80.0).save("cooling.pvd")

The same functions, rules and stabilization as for `Elasticity`, with one unknown per node.

Guarantees: heat that enters leaves or is stored, to the tolerance of the solver; no oscillation
in time with the default, the implicit method of Euler, beyond that of the space. Non-guarantee:
conductivity and capacity do not depend on temperature; near walls that heat has not reached yet
consistent masses may undershoot by a fraction of the step.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from ilattice._memory import need
from ilattice._progress import Progress, track
from ilattice._typing import FloatArray
from ilattice._validate import FixedMapping, as_choice, as_kind, as_positive, as_whole
from ilattice.cutfem import _kernels_assembly as kernels
from ilattice.cutfem import discretization, integration, watching
from ilattice.cutfem.conditions import as_value, values_at
from ilattice.cutfem.conduction import Conducting, Conduction
from ilattice.cutfem.material import Property, Scalar, named_properties
from ilattice.cutfem.phases import as_phased
from ilattice.cutfem.problem import ISLANDS, Problem
from ilattice.cutfem.series import Series
from ilattice.cutfem.solved import Smooth
from ilattice.cutfem.temperature import Step, Temperature
from ilattice.errors import InputError
from ilattice.linalg.solvers import LARGEST, Solver
from ilattice.quadrature.rules import on_cells

#: Bytes of a solution besides its coefficients, and the largest number of steps in time.
PER_STEP, MAX_STEPS = 1000, 10**9


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Heat(Problem):
    """Heat conduction in a solid.

    Parameters
    ----------
    field : Wall, BSpline, callable, pair of fields, CutGrid, or Domain
        The solid, as in `cut`. The `domain` of another problem shares its rules and pattern.
    cells : int, sequence of 3 int or Grid, optional
        Background grid, as in `cut`.
    conductivity, capacity : float, str or callable, keyword-only
        Heat per length, time and degree; heat per volume and degree. A callable takes points of
        space (n, 3); a name is that of a property of the lattice. Where directions differ, the
        conductivity is a symmetric matrix, shape (3, 3), or a callable that returns (n, 3, 3).
    axes : {"space", "map"}, keyword-only
        Which axes matrices have, as in `Elasticity`.
    degree, smoothness, q, stabilization, weight, islands, domain, through, phases : keyword-only
        As in `Elasticity`; properties are pairs likewise.

    Raises
    ------
    InputError
        If an argument is wrong.
    GeometryError
        If the solid is empty.

    Examples
    --------
    >>> import numpy as np
    >>> import ilattice as il
    >>> bar = lambda u: -np.ones(len(u))
    >>> problem = il.cutfem.Heat(bar, 2, domain=[[0, 0, 0], [1, 1, 4]])
    >>> steady = problem.fix("w=0", 0.0).fix("w=1", 8.0).solve()
    >>> float(round(steady.evaluate([[0.5, 0.5, 1.0]])[0], 9))
    2.0
    """

    m: ClassVar[int] = 1
    spring_name: ClassVar[str] = "transfer"
    flux_name: ClassVar[str] = "heat flux"
    energy_name: ClassVar[str] = "the energy of the temperature, and heat that flows by it,"
    lack: ClassVar[str] = "nothing fixes the temperature: add fix or convection before solving"
    conductivity: Conduction
    capacity: Scalar

    def __init__(
        self, field: Any, cells: Any = None, *, conductivity: Conducting = 1.0,
        capacity: Property = 1.0, axes: str = "space", degree: int | str = "auto",
        smoothness: int | None = None, q: int | None = None, stabilization: str = "auto",
        weight: float | None = None, islands: str = "drop", domain: Any = None,
        through: Any = None, phases: Any = None,
    ) -> None:  # fmt: skip
        as_choice("islands", islands, ISLANDS)
        where = as_phased(
            field, cells, degree=degree, smoothness=smoothness, q=q, stabilization=stabilization,
            weight=weight, domain=domain, through=through, phases=phases, bends=False,
        )  # fmt: skip
        known: dict[str, Any] = {"lattice": named_properties(where), "phased": where.phased}
        properties = {
            "conductivity": Conduction.of(conductivity, axes, where.cut.through, **known),
            "capacity": Scalar("capacity", capacity, **known),
        }
        super().__init__(where, islands)
        self._set(**properties)

    # ---------------------------------------------------------------- verbs

    def fix(self, on: Any, value: Any, *, method: str = "auto", where: Any = None) -> Self:
        """Prescribe the temperature on an end face, a level set or a region.

        Parameters
        ----------
        on : str, callable, (2, 3) array-like, Field or SurfaceMesh
            As in `Elasticity.clamp`.
        value : float or callable
            Temperature; a callable takes points of space (n, 3).
        method : {"auto", "strong", "nitsche"}
            As in `Elasticity.clamp`.
        where : str, callable, (2, 3) array-like, Field or SurfaceMesh, optional
            As in `Elasticity.clamp`.

        Returns
        -------
        Heat
            A new problem.
        """
        return self._supported(on, None, value, method, "value", where)

    def convection(self, on: Any, transfer: Any, *, around: Any, where: Any = None) -> Self:
        """Exchange heat with what is around.

        Parameters
        ----------
        on : str, callable, (2, 3) array-like, Field or SurfaceMesh
            As in `fix`.
        transfer : float or callable
            Heat per area, time and degree.
        around : float or callable
            Temperature around.
        where : str, callable, (2, 3) array-like, Field or SurfaceMesh, optional
            As in `fix`.

        Returns
        -------
        Heat
            A new problem.
        """
        return self._sprung(on, transfer, around, "transfer", where)

    def flux(self, on: Any, value: Any, *, where: Any = None) -> Self:
        """Let heat flow in through an end face, a level set or a region.

        Parameters
        ----------
        on : str, callable, (2, 3) array-like, Field or SurfaceMesh
            As in `fix`.
        value : float or callable
            Heat per area and time into the solid.
        where : str, callable, (2, 3) array-like, Field or SurfaceMesh, optional
            As in `fix`.

        Returns
        -------
        Heat
            A new problem.
        """
        return self._loaded("flux", value, 1, on, where)

    def source(self, value: Any) -> Self:
        """Generate heat in the solid.

        Parameters
        ----------
        value : float or callable
            Heat per volume and time.

        Returns
        -------
        Heat
            A new problem.
        """
        return self._loaded("source", value, 1)

    def solve(
        self, *, method: str = "auto", tol: float = 1e-8, max_iterations: int = 500,
        progress: Progress = None,
    ) -> "HeatSolution":  # fmt: skip
        """Solve for the steady temperature.

        Parameters
        ----------
        method, tol, max_iterations, progress : str, float, int, bool or callable
            As in `Elasticity.solve`.

        Returns
        -------
        HeatSolution
            Temperature, flux, heat through every place.

        Raises
        ------
        InputError
            If nothing fixes the temperature.
        ConvergenceError
            If the tolerance is not reached.

        Warns
        -----
        PrecisionWarning
            If the energy of the temperature is off by more than 2 % because of the cells, by
            estimate: see `SolveReport.discretization_error`.
        """
        c, report = self._solve(method, tol, max_iterations, progress)
        return HeatSolution(self, c, report)

    def evolve(
        self, duration: float, *, steps: int, initial: Any = 0.0, theta: float = 1.0,
        method: str = "auto", tol: float = 1e-8, max_iterations: int = 500,
        progress: Progress = None,
    ) -> "HeatHistory":  # fmt: skip
        """Temperature in time, with supports and sources that stay as they are.

        Parameters
        ----------
        duration : float
            Length of time.
        steps : int
            Equal steps; one factor serves all.
        initial : float or callable
            Temperature at the start; a callable is interpolated on the grid.
        theta : float
            1 for the implicit method of Euler, of first order; 1/2 for the trapezoidal rule, of
            second, which may oscillate.
        method, tol, max_iterations : str, float, int
            As in `Elasticity.solve`.
        progress : bool or callable, optional
            See `ilattice._progress.track`.

        Returns
        -------
        HeatHistory
            A sequence of steps + 1 solutions, the start included. The reports of the first and of
            the last step estimate by how much the cells are off; what the steps are off is not
            estimated.

        Raises
        ------
        InputError
            If an argument is wrong.
        ConvergenceError
            If the tolerance is not reached.
        """
        steps, theta = as_steps(steps), as_positive("theta", theta)
        dt = as_positive("duration", duration) / steps
        if not 0.5 <= theta <= 1.0:
            raise InputError(f"theta must be from 1/2 to 1, got {theta:g}")
        asm, con = self.assembly, self.constraints
        size = float(con.values.nbytes + PER_STEP)
        need(size * steps, f"{steps} steps of {size:.3g} bytes each", "use fewer steps")
        M, K = self._capacity, self._stiffness
        A = asm.pattern.matrix(M.blocks + theta * dt * K.blocks)
        solver = Solver(
            con.reduce(A), near_nullspace=self.system.near_nullspace, method=method,
            coordinates=self.system.coordinates,
        )  # fmt: skip
        c = np.where(con.fixed, con.values, self._initial(initial))
        f = (self.forces() + self._from_supports()).ravel()
        out, told = [HeatSolution(self, c, None, time=0.0)], []
        for n in track(range(1, steps + 1), "evolve", progress):
            old = c.ravel()
            b = M @ old - (1.0 - theta) * dt * (K @ old) + dt * f - A @ con.values.ravel()
            b = con.restrict(b[:, None]).ravel()
            x, report = np.zeros_like(b), None
            if b.any():
                x, report = solver.solve(b, tol=tol, max_iterations=max_iterations)
            c = con.expand(x[:, None])
            if report is not None and n in (1, steps):
                splines, rules = self._transient_error(c)
                told.append((splines, rules))
                report = replace(report, discretization_error=splines + rules)
            step = Step(out[-1].coefficients, dt, theta)
            out.append(HeatSolution(self, c, report, time=n * dt, step=step))
        self._warn_of(told)
        return HeatHistory(tuple(out))

    def _transient_error(self, c: FloatArray) -> tuple[float, float]:
        """See `discretization` and `integration`, of the temperature at one time."""
        K = self.system._half
        energy = self._energy_of(lambda x: K @ x, c)
        splines = self._discretization_error(lambda x: K @ x, c, energy)
        return splines, self._rules_error(c, energy)

    def _warn_of(self, errors: list[tuple[float, float]]) -> None:
        """Warn once of the worst of some times."""
        if errors:
            what = f"{self.energy_name} at one time or more"
            splines, rules = map(float, np.max(errors, axis=0))
            discretization.warn(splines, what, self.assembly.space)
            integration.warn(rules, splines, what)

    # ---------------------------------------------------------------- operators

    @property
    def law(self) -> Conduction:
        """See `Problem.law`."""
        return self.conductivity

    @property
    def _told(self) -> dict[str, Any]:
        return {**super()._told, "capacity": self.capacity.value}

    @cached_property
    def _capacity(self) -> Any:
        asm = self.assembly
        data = asm.zeros(1)
        watching.check_property(self, self.capacity)
        rule = on_cells(self.domain.volume, asm.space.cells)
        capacity = self._scalar_at(self.capacity, rule.points, asm.owners(rule))
        asm.add_cells(data, rule, kernels.MASS, capacity[:, None])
        return asm.pattern.matrix(data)

    def _initial(self, initial: Any) -> FloatArray:
        value, asm = as_value("initial", initial, 1), self.assembly
        c = asm.space.interpolate(lambda u: values_at("initial", value, asm.x(u), 1))
        if not np.abs(c).max() <= LARGEST:
            raise InputError(
                f"initial={initial!r:.80}: squares of such temperatures overflow; use another "
                f"unit, so that they are below {LARGEST:g}"
            )
        c = c.reshape(-1, 1)[asm.space.functions]
        watching.check_followed(self, c, "initial", value)
        return c

    def inflow(self, solution: "HeatSolution") -> dict[str, float]:
        """Heat per time that enters through places of fixed temperature and of convection.

        Parameters
        ----------
        solution : HeatSolution
            Steady temperature, or one that a step in time leads to; then the mean over the step.

        Returns
        -------
        dict of str to float
            Sums over all conditions of each place.

        Raises
        ------
        InputError
            At the start of `evolve`.
        """
        mine = self._own(as_kind("solution", solution, "HeatSolution"))
        c, stored = self._balance(mine)
        found = self._reactions(c, replace(mine, coefficients=c)._own_flux_on, stored)
        return {on: float(heat[0]) for on, heat in found.items()}

    def _balance(self, solution: "HeatSolution") -> tuple[FloatArray, FloatArray | float]:
        """Coefficients at which conduction counts, and what goes into storage, both (n, 1)."""
        c, step = solution.coefficients, solution.step
        if step is None and solution.time is not None:
            raise InputError("inflow: no step leads to the start of evolve; ask the next solution")
        if step is None:
            return c, 0.0
        middle = step.theta * c + (1.0 - step.theta) * step.before
        return middle, self._capacity @ ((c - step.before) / step.duration)


@dataclass(frozen=True, eq=False, repr=False)
class HeatSolution(Temperature):
    """Temperature of a solid: made by `Heat.solve` and `Heat.evolve`.

    Attributes
    ----------
    problem : Heat
        What was solved.
    coefficients : ndarray, shape (functions, 1)
        Of the splines.
    solved : SolveReport or None
        What the solver says; None if nothing was free.
    time : float or None
        Since the start of `Heat.evolve`; None if steady.
    step : Step or None
        The step that leads here; None if steady, and at the start.
    """

    problem: Heat

    def __repr__(self) -> str:
        when = "steady" if self.time is None else f"time {self.time:.6g}"
        return f"HeatSolution({len(self.coefficients)} functions, {when})"

    @property
    def _smooth(self) -> "type[RecoveredHeat]":
        return RecoveredHeat

    @cached_property
    def inflow(self) -> Mapping[str, float]:
        """Heat per time that enters through places of fixed temperature and of convection.

        In time the mean over the step that leads here; with sources and fluxes it is what is stored
        in the step, over its length. At the start of `evolve` an `InputError`.
        """
        return FixedMapping(self.problem.inflow(self))

    @cached_property
    def stored(self) -> float:
        """Heat in the solid: the integral of capacity times temperature."""
        problem = self.problem
        rule = problem.domain.solid(problem.assembly)
        assert rule.parameters is not None
        asm, total = problem.assembly, 0.0
        c = problem._scalar_at(problem.capacity, rule.parameters, asm.owners(rule))
        for rows, T, _ in asm.on_rule(self.coefficients, rule):
            total += float((rule.weights[rows] * (c if len(c) == 1 else c[rows])) @ T[:, 0])
        return total


@dataclass(frozen=True, eq=False, repr=False)
class RecoveredHeat(Smooth, HeatSolution):
    """Temperature with a smooth heat flux: made by `HeatSolution.recovered`.

    Attributes
    ----------
    projected : ndarray, shape (functions, 3)
        Coefficients of minus the recovered heat flux.
    """

    @property
    def fluxes(self) -> FloatArray:
        """Coefficients (functions, 3) of the recovered heat flux."""
        return -self.projected


@dataclass(frozen=True, eq=False, repr=False)
class HeatHistory(Series[HeatSolution]):
    """Temperatures in time: made by `Heat.evolve`, a sequence from the start to the end.

    Attributes
    ----------
    solutions : tuple of HeatSolution
        One per time.
    """

    solutions: tuple[HeatSolution, ...]

    def __len__(self) -> int:
        return len(self.solutions)

    @property
    def times(self) -> FloatArray:
        """Times since the start, shape (len,)."""
        return np.array([s.time for s in self.solutions], np.float64)

    def _result(self, number: int) -> "HeatSolution":
        return self.solutions[number]


def as_steps(steps: Any) -> int:
    """A whole number of at least 1, or `InputError`."""
    return as_whole("steps", steps, 1, MAX_STEPS)
