"""Which functions of a problem are looked at between the points of rules; see `sampling`.

Guarantee: loads, springs and supports that are functions of points, and densities and expansions by
which loads are multiplied. Non-guarantee: properties by name, and temperatures from solutions of
heat, are splines, and taken as they are; stiffness is looked at where matrices are made; functions
that cannot be asked at other points than those of rules are not looked at.
"""

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice.cutfem import sampling
from ilattice.cutfem.conditions import Spring, Support, values_at
from ilattice.cutfem.material import OfParameters, Scalar
from ilattice.cutfem.regions import Region
from ilattice.errors import InputError
from ilattice.quadrature.rules import Quadrature, on_cells

if TYPE_CHECKING:
    from ilattice.cutfem.problem import Problem

#: Loads that are numbers, also where displacements are vectors.
SINGLE = ("pressure", "temperature")


def check_functions(problem: "Problem") -> None:
    """Warn of loads and supports that are functions which cells do not see, or refuse them.

    Parameters
    ----------
    problem : Problem
        With supports.

    Raises
    ------
    InputError
        If half of one, or more, is lost or made up.

    Warns
    -----
    PrecisionWarning
        From 2 % on.
    """
    for load in problem.loads:
        if not hasattr(load.value, "evaluate"):
            m = 1 if load.kind in SINGLE else problem.m
            _check(problem, load.kind, load.value, load.on, m)
    for scalar in problem.factors:
        _check_property(problem, scalar)
    for s in problem.in_the_mean:
        _check(problem, "value", s.value, s.on, problem.m)
        if isinstance(s, Spring):
            _check(problem, problem.spring_name, s.stiffness, s.on, problem.m)
    for s in problem.supports:
        if not s.weak and callable(s.value):
            part = _lost(problem, problem.constraints.values, s)
            sampling.check(f"value on {s.on}", part)


def _check(problem: "Problem", name: str, value: Any, on: str | Region, m: int) -> None:
    """The same of a value (n, m) on a place, or in the solid."""
    if callable(value):
        asm, domain = problem.assembly, problem.domain
        rule = domain.edge(asm, on) if on else _solid(problem)
        ask = partial(values_at, name, value, m=m)
        try:
            part = sampling.unseen(asm, rule, partial(domain.denser, on), ask)
        except (
            InputError
        ):  # it knows the points of the rule alone, or fails there, too, and is told
            return
        sampling.check(f"{name} on {on}" if on else name, part)


def _check_property(problem: "Problem", scalar: Scalar) -> None:
    """The same of a property, phase by phase."""
    domain = problem.domain
    parts = domain.of_phases(_solid(problem))
    for s, part, cut in zip(scalar.phases, parts, domain.solids, strict=False):
        if callable(s.value) and not isinstance(s.value, OfParameters):
            ask = partial(values_at, s.name, s.value, m=1)
            denser = partial(domain.denser, "", cut=cut)
            sampling.check(s.name, sampling.unseen(problem.assembly, part, denser, ask))


def _solid(problem: "Problem") -> Quadrature:
    """Rule on the active cells, in parameters."""
    return on_cells(problem.domain.volume, problem.assembly.space.cells)


def _lost(problem: "Problem", c: FloatArray, given: Support) -> float:
    """Part of prescribed values, in the mean square, that coefficients c do not follow."""
    rule = problem.domain.edge(problem.assembly, given.on)
    wanted = values_at("value", given.value, rule.points, problem.m)
    off = np.zeros_like(wanted)
    for rows, value, _ in problem.assembly.on_rule(c, rule):
        off[rows] = value - wanted[rows]
    gap, size = (float(rule.weights @ (v[:, given.mask] ** 2).sum(axis=1)) for v in (off, wanted))
    return float(np.sqrt(gap / size)) if size > 0.0 else 0.0
