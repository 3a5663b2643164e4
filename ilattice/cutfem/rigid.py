"""Rigid connections: places that move as rigid bodies, by as much as the forces on them ask for.

The motion of a place has six unknowns. For each of them the solid is solved once with that motion
prescribed, and once more for the loads; of these the motions follow by which the forces and moments
that each place exerts on the solid are those asked for. All of these solutions share one matrix.

Guarantees: resultants are those asked for, to the tolerance of the solver; with Nitsche's method
and with exact supports alike, since both are symmetric. Non-guarantee: natural modes and buckling
of such solids are refused, not found.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ilattice._progress import Progress, track
from ilattice._typing import FloatArray
from ilattice._validate import Frozen, read_only
from ilattice.cutfem import weak
from ilattice.cutfem.conditions import Support
from ilattice.cutfem.places import Motion
from ilattice.cutfem.regions import Region
from ilattice.errors import InputError
from ilattice.linalg.solvers import Solver
from ilattice.quadrature.rules import NAMES

if TYPE_CHECKING:
    from ilattice.cutfem.elasticity import Elasticity
    from ilattice.cutfem.solution import Solution

#: Tolerance of the solutions of which motions are made, and stiffness against a motion, in that
#: against the stiffest, below which it is free.
TIGHT, FREE = 1e-11, 1e-9


@dataclass(frozen=True, eq=False)
class Connection(Frozen):
    """A place that moves as a rigid body.

    Attributes
    ----------
    on : str or Region
        Place.
    force, moment : ndarray, shape (3,)
        What acts on it, the moment about `about`.
    about : ndarray, shape (3,)
        Point of space at which the force acts.
    motion : Motion or None
        How it moves, in problems of solutions.
    """

    on: str | Region
    force: FloatArray
    moment: FloatArray
    about: FloatArray
    motion: Motion | None = None

    @property
    def work(self) -> float:
        """That of force and moment on the motion."""
        if self.motion is None:
            return 0.0
        return float(self.force @ self.motion.translation + self.moment @ self.motion.rotation)


def solved(
    problem: "Elasticity", method: str, tol: float, max_iterations: int, progress: Progress
) -> "Solution":
    """The solution of a problem with connections."""
    from ilattice.cutfem.solution import Solution

    base = _held(problem)
    base.prepare(progress, held=True)
    first = len(problem.supports)
    size = float(np.ptp(base.assembly.coordinates, axis=0).max())
    how = method, min(tol, TIGHT), max_iterations
    units = [
        _unit(base, first + j, motion)
        for j, c in enumerate(problem.connections)
        for motion in _motions(c.about, size)
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
    supports = (*problem.supports, *(_support(c) for c in moved))
    last = base._with(supports=supports, connections=moved)
    last._set(assembly=base.assembly)  # which tells what is left out when it is made
    c, report = last._solve(method, tol, max_iterations, progress)
    return Solution(last, c, report)


def _support(connection: Connection) -> Support:
    """The connection as a support that prescribes its motion, or none."""
    zero = np.zeros(3)
    motion = connection.motion or Motion(zero, zero, connection.about)
    return Support(connection.on, np.ones(3, bool), motion, connection.on not in NAMES)


def _held(problem: "Elasticity") -> "Elasticity":
    """The problem with all connections at rest."""
    supports = (*problem.supports, *(_support(c) for c in problem.connections))
    return problem._with(supports=supports, connections=(), _held={})


def _unit(base: "Elasticity", number: int, motion: Motion) -> "Elasticity":
    """Without loads, everything at rest but for one support."""
    rest = [replace(s, value=(0.0,) * 3) for s in base.supports]
    rest[number] = replace(rest[number], value=motion)
    springs = tuple(replace(s, value=(0.0,) * 3) for s in base.springs)
    unit = base._with(supports=tuple(rest), springs=springs, loads=())
    unit._set(assembly=base.assembly)
    return unit


def _motions(about: FloatArray, size: float) -> list[Motion]:
    """Six unit motions, turns by one over the size of the solid."""
    eye, zero = np.eye(3), np.zeros(3)
    return [Motion(e, zero, about) for e in eye] + [Motion(zero, e / size, about) for e in eye]


def _solve(problem: "Elasticity", method: str, tol: float, max_iterations: int) -> FloatArray:
    """Coefficients, with the factors or levels of all that share a matrix."""
    system = problem.system
    if not len(system.b) or not system.b.any():
        return system.constraints.values
    key = ("solver", method)
    if key not in problem._held:
        problem._held[key] = Solver(
            system.K, near_nullspace=system.near_nullspace, method=method, places=system.places
        )
    x, _ = problem._held[key].solve(system.b, tol=tol, max_iterations=max_iterations)
    return system.constraints.expand(x.reshape(-1, 3))


def _resultants(
    problem: "Elasticity", c: FloatArray, number: int, units: list["Elasticity"]
) -> FloatArray:
    """What a support does to the solid on each of its unit motions, shape (6,)."""
    from ilattice.cutfem.solution import Solution

    support = problem.supports[number]
    if support.weak:
        terms = weak.elastic_terms(problem, support)
        force = weak.elastic_reaction(problem, terms, support.value, Solution(problem, c, None))
        motions: list[Any] = [u.supports[number].value for u in units]
        return np.array([(force * m(terms.rule.points)).sum() for m in motions])
    r = (problem.matrix @ c.ravel()).reshape(c.shape) - problem.forces()
    r -= problem._from_supports()
    return np.array([(r * u.constraints.values).sum() for u in units])


def _motion_of(problem: "Elasticity", A: FloatArray, b: FloatArray) -> FloatArray:
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
