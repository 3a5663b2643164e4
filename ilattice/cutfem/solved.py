"""Results of problems that were solved: flux, recovered flux, estimate of the error.

One for all laws: `Solution` of elasticity and `HeatSolution` say what their fields are called.

Guarantees: fields are those of the splines, evaluated anywhere in the solid, not interpolated; what
goes in comes out, as well as the equations are solved. Non-guarantees: fluxes are the derivatives
of the unknown, an order less accurate, and are not averaged, unless the solution is `recovered`;
outside the solid fields are continued by one cell, then NaN.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ilattice._progress import Progress
from ilattice._typing import FloatArray
from ilattice._validate import as_kind
from ilattice.cutfem.output import Result
from ilattice.quadrature.rules import Quadrature

if TYPE_CHECKING:
    from ilattice.cutfem.estimate import ErrorEstimate
    from ilattice.cutfem.page import Report
    from ilattice.cutfem.problem import Problem
    from ilattice.linalg.solvers import SolveReport


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

    problem: "Problem"
    coefficients: FloatArray
    solved: "SolveReport | None"

    @property
    def report(self) -> "Report | None":
        """How the system was solved, with an estimate of the error; None if nothing was free.

        It is a function, too: ``solution.report("part.html")`` writes a page about the analysis.
        """
        from ilattice.cutfem.page import report_of

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
        from ilattice.cutfem.recovery import recovered

        return recovered(self, progress)

    def error_estimate(self, progress: Progress = None) -> "ErrorEstimate":
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
        from ilattice.cutfem.estimate import error_of

        return error_of(self, progress)

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
