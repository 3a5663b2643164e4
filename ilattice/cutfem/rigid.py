"""Rigid connections: places that move as rigid bodies, by as much as the forces on them ask for.

The motion of a place has six unknowns. For each of them the solid is solved once with that motion
prescribed, and once more for the loads; of these the motions follow by which the forces and moments
that each place exerts on the solid are those asked for. All of these solutions share one matrix.

Guarantee: resultants are those asked for, to the tolerance of the solver; with Nitsche's method and
with exact supports alike, since both are symmetric. Natural modes and buckling: see
`ilattice.cutfem.pencil`.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from ilattice._progress import Progress, track
from ilattice._typing import FloatArray
from ilattice._validate import read_only
from ilattice.cutfem import weak
from ilattice.cutfem.conditions import Connection, Support
from ilattice.cutfem.constraints import constraints
from ilattice.cutfem.deformed import Deformed
from ilattice.cutfem.operators import ElasticOperators
from ilattice.cutfem.overlaps import check_agreement
from ilattice.cutfem.places import Motion
from ilattice.errors import InputError
from ilattice.linalg.solvers import Solver, SolveReport
from ilattice.quadrature.rules import NAMES, Quadrature

P = TypeVar("P", bound=ElasticOperators)
#: Tolerance of the solutions of which motions are made, and stiffness against a motion, in that
#: against the stiffest, below which it is free.
TIGHT, FREE = 1e-11, 1e-9


def solved(
    problem: P, method: str, tol: float, max_iterations: int, progress: Progress
) -> tuple[P, FloatArray, SolveReport | None]:
    """A problem with motions of its connections, all coefficients, and what the solver reports."""
    base = held(problem)
    check_apart(base)
    base.prepare(progress, held=True)
    first = len(base.supports) - len(base.connections)
    size = float(np.ptp(base.assembly.coordinates, axis=0).max())
    how = method, min(tol, TIGHT), max_iterations
    units = [
        unit(base, first + j, motion)
        for j, c in enumerate(problem.connections)
        for motion in unit_motions(c.about, size)
    ]
    found = [_solve(p, *how) for p in track([base, *units], "connections", progress)]
    # forces of all connections by their six motions, by the loads and by each unit motion
    parts = np.stack([
        np.concatenate([
            _resultants(p, c, first + j, units[6 * j : 6 * j + 6])
            for j in range(len(problem.connections))
        ])
        for p, c in zip([base, *units], found, strict=True)
    ], axis=1)  # fmt: skip
    asked = np.concatenate([np.append(c.force, c.moment / size) for c in problem.connections])
    q = _motion_of(problem, parts[:, 1:], asked - parts[:, 0]).reshape(-1, 6)
    moved = tuple(
        replace(c, motion=Motion(read_only(v[:3].copy()), read_only(v[3:] / size), c.about))
        for c, v in zip(problem.connections, q, strict=True)
    )
    supports = (*base.supports[:first], *(_support(c) for c in moved))
    last = base._with(supports=supports, connections=moved)
    last._set(assembly=base.assembly)  # which tells what is left out when it is made
    return last, *last._solve(*how, progress)


def _support(connection: Connection) -> Support:
    """The connection as a support that prescribes its motion."""
    assert connection.motion is not None
    weakly = connection.on not in NAMES
    return Support(connection.on, np.ones(3, bool), connection.motion, weakly)


def held(problem: P) -> P:
    """The problem, also one of a solution, with all connections at rest, as its last supports."""
    found = [c.motion for c in problem.connections if c.motion is not None]
    own = (s for s in problem.supports if not any(s.value is motion for motion in found))
    zero = np.zeros(3)
    rest = tuple(replace(c, motion=Motion(zero, zero, c.about)) for c in problem.connections)
    supports = (*own, *(_support(c) for c in rest))
    if [s.on for s in supports] != [s.on for s in problem.supports]:
        return problem._with(supports=supports, connections=rest, _held={})
    new = problem._with(supports=supports, connections=rest)  # with the same matrix
    new._set(assembly=problem.assembly)
    return new


def check_apart(base: ElasticOperators) -> None:
    """Refuse connections that share points with supports or with each other.

    Parameters
    ----------
    base : ElasticOperators
        With connections at rest, as its last supports.

    Raises
    ------
    InputError
        If one cannot move, since a part of it is held.
    """
    first = len(base.supports) - len(base.connections)
    for number in range(first, len(base.supports)):
        mine = replace(base.supports[number], value=(1.0, 1.0, 1.0))
        for other in (*base.supports[:first], *base.supports[number + 1 :]):
            pair = (mine, replace(other, value=(0.0,) * 3))
            try:
                check_agreement(base.domain, base.assembly, pair, 3)
                constraints(base.domain, base.assembly, pair, 3)
            except InputError:
                raise InputError(
                    f"the rigid connection on {mine.on} cannot move: it shares points, such as an "
                    f"edge, with the {'support' if other in base.supports[:first] else 'one'} on "
                    f"{other.on}; leave a part out by where=, or make one place of both"
                ) from None


def unit(base: P, number: int, value: Any) -> P:
    """Without loads, everything at rest but for one support."""
    rest = [replace(s, value=(0.0,) * 3) for s in base.supports]
    rest[number] = replace(rest[number], value=value)
    springs = tuple(replace(s, value=(0.0,) * 3) for s in base.springs)
    new = base._with(supports=tuple(rest), springs=springs, loads=())
    new._set(assembly=base.assembly)
    return new


def unit_motions(about: FloatArray, size: float) -> list[Motion]:
    """Six unit motions, turns by one over the size of the solid."""
    eye, zero = np.eye(3), np.zeros(3)
    return [Motion(e, zero, about) for e in eye] + [Motion(zero, e / size, about) for e in eye]


def _solve(problem: ElasticOperators, method: str, tol: float, max_iterations: int) -> FloatArray:
    """Coefficients, with the factors or levels of all that share a matrix."""
    system = problem.system
    if not len(system.b) or not system.b.any():
        return system.constraints.values
    key = ("solver", method)
    if key not in problem._held:
        problem._held[key] = Solver(
            system._half,
            near_nullspace=system.near_nullspace,
            method=method,
            coordinates=system.coordinates,
        )
    x, _ = problem._held[key].solve(system.b, tol=tol, max_iterations=max_iterations)
    return system.constraints.expand(x.reshape(-1, 3))


def _resultants(
    problem: ElasticOperators, c: FloatArray, number: int, units: Sequence[ElasticOperators]
) -> FloatArray:
    """What a support does to the solid on each of its unit motions, shape (6,)."""
    if problem.supports[number].weak:
        force, rule = _forces_at(problem, c, number)
        motions: list[Any] = [u.supports[number].value for u in units]
        return np.array([(force * m(rule.points)).sum() for m in motions])
    r = _missing(problem, c)
    return np.array([(r * u.constraints.values).sum() for u in units])


def virial(problem: ElasticOperators, c: FloatArray, number: int, about: FloatArray) -> FloatArray:
    """Sum of the forces of a support on the solid times their places, shape (3, 3).

    Parameters
    ----------
    problem : ElasticOperators
        Of a solution.
    c : ndarray, shape (functions, 3)
        Coefficients of it.
    number : int
        Which support.
    about : ndarray, shape (3,)
        Where places are counted from.

    Returns
    -------
    ndarray, shape (3, 3)
        Force by place.
    """
    if problem.supports[number].weak:
        force, rule = _forces_at(problem, c, number)
        return force.T @ (rule.points - about)
    r, out = _missing(problem, c), np.empty((3, 3))
    for a, b in np.ndindex(3, 3):

        def pulled(x: FloatArray, a: int = a, b: int = b) -> FloatArray:
            return np.outer(x[:, b] - about[b], np.eye(3)[a])

        out[a, b] = (r * unit(problem, number, pulled).constraints.values).sum()
    return out


def held_stiffness(
    problem: ElasticOperators, number: int, units: Sequence[ElasticOperators]
) -> FloatArray | float:
    """What is constant in the energy of unit motions (k, k) of a weakly imposed support."""
    support = problem.supports[number]
    if not support.weak:
        return 0.0
    terms = weak.terms_of(problem, support)
    moves: list[Any] = [u.supports[number].value for u in units]
    g = np.stack([move(terms.rule.points) for move in moves])
    return np.einsum("q,jqa,qab,kqb->jk", terms.rule.weights, g, terms.Q, g, optimize=True)


def _forces_at(
    problem: ElasticOperators, c: FloatArray, number: int
) -> tuple[FloatArray, Quadrature]:
    """Forces (n, 3) of a weak support on the solid, and the points at which they act."""
    support = problem.supports[number]
    terms = weak.terms_of(problem, support)
    flux_on = Deformed(problem, c, None)._own_flux_on
    return weak.reaction(problem, terms, support.value, c, flux_on), terms.rule


def _missing(problem: ElasticOperators, c: FloatArray) -> FloatArray:
    """What exact supports do to the solid, as coefficients (functions, 3)."""
    r = problem._times(c) - problem.forces()
    return np.asarray(r - problem._from_supports())


def _motion_of(problem: ElasticOperators, A: FloatArray, b: FloatArray) -> FloatArray:
    """What is solved for the motions, or the error that some are free."""
    A = 0.5 * (A + A.T)
    stiffness = np.linalg.eigvalsh(A)
    if not stiffness[0] > FREE * stiffness[-1]:
        names = ", ".join(str(c.on) for c in problem.connections)
        raise InputError(
            f"the rigid connections on {names} are free to move: nothing else holds the parts that "
            "they are on; add a support"
        )
    return np.asarray(np.linalg.solve(A, b), np.float64)
