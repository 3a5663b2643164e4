"""Temperatures of solved problems, steady or in time: heat flux, balance, files, pictures.

Guarantees: fields are those of the splines, evaluated anywhere in the solid, not interpolated; what
enters leaves or is stored, as well as the equations are solved.
Non-guarantees: heat fluxes are derivatives of the temperature, an order less accurate, unless the
solution is `recovered`; outside the solid fields are continued by one cell, then NaN.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ilattice._typing import AnyArray, ArrayLike, FloatArray
from ilattice._validate import FixedMapping, as_points
from ilattice.cutfem.assembly import Assembly
from ilattice.cutfem.conditions import Known
from ilattice.cutfem.series import Series
from ilattice.cutfem.solved import Solved
from ilattice.macroshape.maps import SplineMap
from ilattice.quadrature.rules import Quadrature

if TYPE_CHECKING:
    from ilattice.cutfem.heat import Heat


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


@dataclass(frozen=True, eq=False)
class HeatSolution(Solved, Known):
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

    problem: "Heat"
    time: float | None = field(default=None, kw_only=True)
    step: Step | None = field(default=None, kw_only=True)
    shown: ClassVar[str] = "temperature"

    def __repr__(self) -> str:
        when = "steady" if self.time is None else f"time {self.time:.6g}"
        return f"HeatSolution({len(self.coefficients)} functions, {when})"

    def evaluate(self, u: ArrayLike) -> FloatArray:
        """Temperature at parameters.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n,)
            Temperature; NaN more than a cell away from the solid.
        """
        return self._fields(u)[0][:, 0]

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

    def point_data(self, u: ArrayLike) -> dict[str, AnyArray]:
        """What files hold, at parameters.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.

        Returns
        -------
        dict of str to ndarray
            ``temperature`` (n,), ``heat_flux`` (n, 3).
        """
        return {"temperature": self.evaluate(u), "heat_flux": self.heat_flux(u)}

    def field_data(self) -> dict[str, float]:
        """Numbers that files hold about the whole.

        Returns
        -------
        dict of str to float
            ``time``, unless steady.
        """
        return {} if self.time is None else {"time": self.time}

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

    def _result(self, number: int) -> HeatSolution:
        return self.solutions[number]


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
