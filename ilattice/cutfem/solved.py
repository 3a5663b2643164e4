"""Results of problems that were solved: flux, recovered flux, estimate of the error.

One for all laws: `Solution` of elasticity and `HeatSolution` say what their fields are called.

Guarantees: fields are those of the splines, evaluated anywhere in the solid, not interpolated; what
goes in comes out, as well as the equations are solved. Non-guarantees: fluxes are the derivatives
of the unknown, an order less accurate, and are not averaged, unless the solution is `recovered`;
outside the solid fields are continued by one cell, then NaN.
"""

from dataclasses import dataclass, field, fields
from typing import Any, Self

import numpy as np

from ilattice._progress import Progress, staged
from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import FixedMapping, as_kind, read_only
from ilattice.cutfem import recovery
from ilattice.cutfem.estimate import ErrorEstimate, error_of
from ilattice.cutfem.output import Result
from ilattice.cutfem.page import Report, report_of
from ilattice.cutfem.problem import Problem
from ilattice.linalg.solvers import SolveReport
from ilattice.quadrature.rules import Quadrature


@dataclass(frozen=True, eq=False)
class Solved(Result):
    """What is there of every problem that was solved.

    Attributes
    ----------
    problem : Problem
        What was solved.
    coefficients : ndarray, shape (functions, m)
        Of the splines.
    solved : SolveReport or None
        What the solver says; None if nothing was free.
    """

    problem: Problem
    coefficients: FloatArray
    solved: SolveReport | None

    @property
    def report(self) -> Report | None:
        """How the system was solved, with an estimate of the error; None if nothing was free.

        It is a function, too: ``solution.report("part.html")`` writes a page about the analysis.
        """
        return report_of(self, self.solved)

    def recovered(self, progress: Progress = None) -> Any:
        """The same solution with a smooth and more accurate flux.

        Parameters
        ----------
        progress : bool or callable, optional
            Of the flux, "masses" and "projection"; see `ilattice._progress.track`.

        Returns
        -------
        Recovered, RecoveredHeat or RecoveredField
            A solution whose flux is projected on smooth splines of the same degree.
        """
        given = {f.name: getattr(self, f.name) for f in fields(self)}
        flux_on, weights = self._own_flux_on, recovery.WEIGHTS
        projected = recovery.smooth_flux(self.problem, flux_on, weights, progress)
        return self._smooth(**given, projected=projected)

    @property
    def _smooth(self) -> "type[Smooth]":
        """What it becomes with a smooth flux."""
        raise NotImplementedError

    def error_estimate(self, progress: Progress = None) -> ErrorEstimate:
        """Estimate of the error in the energy norm, cell by cell.

        Parameters
        ----------
        progress : bool or callable, optional
            Of the flux, "masses" and "projection"; see `ilattice._progress.track`.

        Returns
        -------
        ErrorEstimate
            From the difference between flux and recovered flux.
        """
        return error_of(self, self._own_flux_on, self._squared_norm, progress)

    def gradient(self, u: ArrayLike) -> FloatArray:
        """Gradient of the unknown in space, at parameters.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n, m, 3)
            Of each component; NaN more than a cell away from the solid.
        """
        return self._fields(u)[1]

    @property
    def _coming_in(self) -> FixedMapping[str, FloatArray]:
        """What comes in (m,) through each place of supports and springs: heat, or a force."""
        found = self.problem._reactions(self.coefficients, self._own_flux_on)
        return FixedMapping({on: read_only(flow) for on, flow in found.items()})

    def _flux_on(self, rule: Quadrature) -> FloatArray:
        """Flux (n, entries) at the points of a rule in the active cells."""
        return self._own_flux_on(as_kind("rule", rule, "Quadrature"))

    def _own_flux_on(self, rule: Quadrature) -> FloatArray:
        """The flux of the gradient, also of a solution that is recovered."""
        u = rule.points if rule.parameters is None else rule.parameters
        asm = self.problem.assembly
        out = np.empty((len(rule), self.problem.law.entries))
        owner = asm.owners(rule)
        for rows, _, gradient in asm.on_rule(self.coefficients, rule):
            out[rows] = self._flux(gradient, u[rows], owner[rows])
        return out

    def _squared_norm(self, rule: Quadrature, flux: FloatArray) -> float:
        """Twice the energy of a flux at the points of a rule in space."""
        assert rule.parameters is not None
        owner = self.problem.assembly.owners(rule)
        return float(rule.integrate(self.problem._stored(flux, rule.parameters, owner)))


@dataclass(frozen=True, eq=False, repr=False)
class Smooth(Solved):
    """A solution whose flux is smooth: what `Solved.recovered` makes.

    Unknown, gradient, energies and what comes in are those of the solution; fluxes, in pictures and
    files as well, the recovered ones.

    Attributes
    ----------
    projected : ndarray, shape (functions, entries)
        Coefficients of the recovered flux.
    """

    projected: FloatArray = field(kw_only=True)

    def recovered(self, progress: Progress = None) -> Self:
        """The same: it is recovered already.

        Parameters
        ----------
        progress : bool or callable, optional
            See `ilattice._progress.track`.

        Returns
        -------
        Recovered, RecoveredHeat or RecoveredField
            Itself.
        """
        return staged({self.problem.flux_name: lambda: self}, progress)[0]

    def _flux_at(self, u: FloatArray) -> FloatArray:
        return recovery.smoothest(self.problem).space.evaluate(self.projected, u)[0]

    def _flux_on(self, rule: Quadrature) -> FloatArray:
        as_kind("rule", rule, "Quadrature")
        return recovery.values_on(recovery.smoothest(self.problem), self.projected, rule)
