"""What problems look at before they are solved: functions between the points of rules, lost loads.

Guarantees: a load on parts that nothing holds, which is lost, is refused, or told of from 2 % of
its area on where it also acts on others. Functions that are looked at, see `sampling`, are loads,
springs and supports that are functions of points, densities and expansions by which loads are
multiplied, densities and capacities in masses, and temperatures at the start of a transient.
Non-guarantee: properties by name, and temperatures from solutions of
heat, are splines, and taken as they are; stiffness is looked at where matrices are made; functions
that cannot be asked at other points than those of rules are not looked at.
"""

import warnings
from functools import partial
from typing import Any

import numpy as np

from ilattice._typing import AnyArray, FloatArray
from ilattice.cutfem import sampling
from ilattice.cutfem.conditions import Known, Load, Spring, values_at
from ilattice.cutfem.material import OfParameters, Scalar
from ilattice.cutfem.places import Spot
from ilattice.cutfem.pointwise import Pointwise
from ilattice.cutfem.regions import Region
from ilattice.errors import GeometryError, InputError, PrecisionWarning
from ilattice.quadrature.rules import Quadrature, on_cells

#: Loads that are numbers, also where displacements are vectors.
SINGLE = ("pressure", "temperature")
#: Loads of which the sum is given.
RESULTANTS = ("force", "moment")
#: Part of the area of a load that may be on parts that are left out without a word.
LOST = 0.02


def check_functions(problem: Pointwise, prescribed: FloatArray) -> None:
    """Warn of loads and supports that are functions which cells do not see, or refuse them.

    Parameters
    ----------
    problem : Pointwise
        With supports.
    prescribed : ndarray, shape (functions, m)
        Coefficients that exact supports have fixed.

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
        if not isinstance(load.value, Known):
            m = 1 if load.kind in SINGLE else problem.m
            _check(problem, load.kind, load.value, load.on, m)
    for scalar in problem.factors:
        check_property(problem, scalar)
    for s in problem.weakly_imposed:
        _check(problem, "value", s.value, s.on, problem.m)
        if isinstance(s, Spring):
            _check(problem, problem.spring_name, s.stiffness, s.on, problem.m)
    for s in problem.supports:
        if not s.weak:
            name = f"value on {s.on}"
            check_followed(problem, prescribed, name, s.value, s.on, s.mask)


def _check(problem: Pointwise, name: str, value: Any, on: Any, m: int) -> None:
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


def check_reached(problem: Pointwise, load: Load) -> None:
    """Refuse a load that acts on nothing but parts that were left out; warn if it does so partly.

    Parameters
    ----------
    problem : Pointwise
        With supports.
    load : Load
        One of its loads.

    Raises
    ------
    GeometryError
        If nothing is held where it acts.

    Warns
    -----
    PrecisionWarning
        If that is 2 % of the area or more.
    """
    if not load.on or isinstance(load.on, Spot) or not len(problem.parts[1]):
        return
    whole, mine = problem.domain.boundary(load.on), problem.domain.edge(problem.assembly, load.on)
    total = whole.integrate()
    lost = 1.0 - mine.integrate() / total if len(mine) else 1.0
    if lost < LOST:
        return
    cells = np.setdiff1d(whole.cells, mine.cells)
    loose = problem.domain.parts.describe(problem.domain.parts.touching(cells))
    if not len(mine):
        raise GeometryError(
            f"{load.kind} on {load.on}: that part of the solid is held by nothing, and is left out "
            f"({loose}), so that the load would be lost; hold it, or load another place"
        )
    fate = "acts on the rest" if load.kind in RESULTANTS else "is not there"
    warnings.warn(
        f"{load.kind} on {load.on}: {100 * lost:.2g} % of the area is on parts that were left out, "
        f"because nothing holds them ({loose}), and what is asked for there {fate}; hold them, or "
        "name the place more narrowly",
        PrecisionWarning,
        stacklevel=4,
    )


def check_property(problem: Pointwise, scalar: Scalar) -> None:
    """The same of a property that is integrated, phase by phase.

    Parameters
    ----------
    problem : Pointwise
        With supports.
    scalar : Scalar
        A factor of loads or of masses.

    Raises
    ------
    InputError
        If half of it, or more, is lost or made up.

    Warns
    -----
    PrecisionWarning
        From 2 % on.
    """
    domain = problem.domain
    parts = domain.of_phases(_solid(problem))
    for s, part, cut in zip(scalar.phases, parts, domain.solids, strict=False):
        if callable(s.value) and not isinstance(s.value, OfParameters):
            ask = partial(values_at, s.name, s.value, m=1)
            denser = partial(domain.denser, "", cut=cut)
            sampling.check(s.name, sampling.unseen(problem.assembly, part, denser, ask))


def check_followed(
    problem: Pointwise, c: FloatArray, name: str, value: Any, on: str | Region = "",
    mask: AnyArray | slice = slice(None),
) -> None:  # fmt: skip
    """The same of values that are interpolated: the part, in the mean square, that is not followed.

    Parameters
    ----------
    problem : Pointwise
        With supports.
    c : ndarray, shape (functions, m)
        Coefficients that should follow the values.
    name : str
        What they are in messages.
    value : float, sequence or callable
        The values.
    on : str or Region
        Where, or ``""`` for the solid.
    mask : ndarray, shape (m,), or slice
        Which components count.

    Raises
    ------
    InputError
        If half of them, or more, is lost or made up.

    Warns
    -----
    PrecisionWarning
        From 2 % on.
    """
    if not callable(value):
        return
    asm, domain = problem.assembly, problem.domain
    rule = domain.edge(asm, on) if on else _solid(problem)
    ask = partial(values_at, "value", value, m=problem.m)
    try:
        u, weights = sampling.between(asm, rule, partial(domain.denser, on), ask)
        wanted = ask(asm.x(u))[:, mask]
    except InputError:  # as in `_check`
        return
    off = asm.evaluate(c, u)[0][:, mask] - wanted
    there = np.isfinite(off).all(axis=1)  # not on parts that are left out
    gap, size = (weights[there] @ (v[there] ** 2).sum(axis=1) for v in (off, wanted))
    sampling.check(name, float(np.sqrt(gap / size)) if size > 0.0 else 0.0)


def _solid(problem: Pointwise) -> Quadrature:
    """Rule on the active cells, in parameters."""
    return on_cells(problem.domain.volume, problem.assembly.space.cells)
