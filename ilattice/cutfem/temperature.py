"""Temperatures of solved problems, steady or in time: heat flux, files, pictures.

Guarantee: fields are those of the splines, evaluated anywhere in the solid, not interpolated.
Non-guarantees: heat fluxes are derivatives of the temperature, an order less accurate, unless the
solution is `recovered`; outside the solid fields are continued by one cell, then NaN.
"""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import as_points
from ilattice.cutfem.assembly import Assembly
from ilattice.cutfem.conditions import Known
from ilattice.cutfem.problem import Problem
from ilattice.cutfem.solved import Solved
from ilattice.macroshape.maps import SplineMap
from ilattice.quadrature.rules import Quadrature


@dataclass(frozen=True, eq=False)
class Step:
    """A step in time.

    Attributes
    ----------
    before : ndarray, shape (functions, 1)
        Coefficients where it starts.
    duration : float
        Length of time.
    theta : float
        Weight of the end, as in `Heat.evolve`.
    """

    before: FloatArray
    duration: float
    theta: float


@dataclass(frozen=True, eq=False, repr=False)
class Temperature(Solved, Known):
    """What is there of the temperature of a solid: what a `HeatSolution` is made of.

    Attributes
    ----------
    problem : Problem
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

    problem: Problem
    time: float | None = field(default=None, kw_only=True)
    step: Step | None = field(default=None, kw_only=True)
    shown: ClassVar[str] = "temperature"
    written: ClassVar[tuple[tuple[str, str], ...]] = (
        ("temperature", "evaluate"),
        ("heat_flux", "heat_flux"),
    )

    def heat_flux(self, u: ArrayLike) -> FloatArray:
        """Heat flux at parameters.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n, 3)
            Minus conductivity times the gradient of the temperature in space.
        """
        return -self._flux_at(as_points("u", u))

    def heat_flux_on(self, rule: Quadrature) -> FloatArray:
        """Heat flux at the points of a rule in the active cells.

        Parameters
        ----------
        rule : Quadrature
            In parameters, or in space with `parameters`.

        Returns
        -------
        ndarray, shape (n, 3)
            As `heat_flux`.
        """
        return -self._flux_on(rule)

    def _within(self, asm: Assembly, u: FloatArray) -> FloatArray:
        """See `Known._within`: also through another map."""
        if _same(self.problem.assembly.through, asm.through):
            return self.evaluate(u)
        return np.asarray(self.at(asm.x(u), outside="nan").temperature)

    def field_data(self) -> dict[str, float]:
        """Numbers that files hold about the whole.

        Returns
        -------
        dict of str to float
            ``time``, unless steady.
        """
        return {} if self.time is None else {"time": self.time}


def _same(a: SplineMap | None, b: SplineMap | None) -> bool:
    """Whether maps are sure to take equal parameters to equal points."""
    if a is b or a is None or b is None:
        return a is b
    s, t = a.spline, b.spline
    weights = [np.ones(1) if one.weights is None else one.weights for one in (s, t)]
    return (
        (s.k, s.periodic) == (t.k, t.periodic)
        and all(map(np.array_equal, s.t, t.t))
        and np.array_equal(s.c[..., :3], t.c[..., :3])
        and np.array_equal(weights[0], weights[1])
    )
