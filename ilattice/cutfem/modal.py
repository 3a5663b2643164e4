"""Natural frequencies, vibration modes and linear buckling of problems of elasticity.

::

    modes = natural_modes(problem, count=6)
    modes.frequencies  # cycles per unit of time
    modes[0].plot()
    modes.save("modes.pvd")  # all, for ParaView
    critical = buckling(solution)  # load factors

Both are A x = μ K x with the stiffness K and its `Solver`: frequencies with the mass for A (then
μ = 1 / ω²), buckling with minus the geometric stiffness (then μ = 1 / load factor). How the
largest μ are found is in `ilattice.cutfem.eigen`, what is free of solids with rigid connections in
`ilattice.cutfem.pencil`. A body that is free to move gets a little of its mass added to K, which
moves no mode; its rigid-body modes come first, with frequencies next to zero.

Guarantees: residuals are computed afresh and above `tol` raise `ConvergenceError`; modes are
orthonormal in the mass, or in the stiffness for buckling. Non-guarantee: which vectors come out of
a group of equal frequencies.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ilattice._progress import Progress, staged
from ilattice._shown import Shown
from ilattice._typing import FloatArray
from ilattice._validate import as_kind, read_only
from ilattice.cutfem import locking, rigid
from ilattice.cutfem._voigt import PLACES
from ilattice.cutfem.discretization import WARNED, warn
from ilattice.cutfem.eigen import largest
from ilattice.cutfem.elasticity import Elasticity, Solution
from ilattice.cutfem.output import Result
from ilattice.cutfem.pencil import Joined, Pencil, pencil
from ilattice.cutfem.places import Motion
from ilattice.cutfem.series import Series
from ilattice.cutfem.tractions import Acting
from ilattice.errors import ConvergenceError, InputError
from ilattice.linalg._engines import definite
from ilattice.quadrature.rules import Quadrature

#: Unknowns up to which it is made sure that loads press somewhere.
CERTAIN = 100_000
#: Part of the mass that is added to a free body, in units of the stiffness of simple strains.
SHIFT = 1e-2
#: Squares of frequencies, as a part of what is added, up to which they are rounding: those of a
#: rigid motion, which leave some 1e-13.
AT_REST = 1e-10


@dataclass(frozen=True, eq=False)
class EigenReport(Shown):
    """How an eigenvalue problem was solved.

    Attributes
    ----------
    method : str
        That of the solver of K.
    residual : float
        Largest |A x - μ K x| / |A x| of the pairs.
    shift : float
        Added to the square of all angular frequencies while solving, 0 for supported bodies.
    discretization_error : float
        Estimated part by which squares of frequencies, or load factors, are too large because of
        the cells, of the worst mode; see `discretization`.
    """

    method: str
    residual: float
    shift: float
    discretization_error: float


@dataclass(frozen=True, eq=False)
class Mode(Result):
    """The shape of a mode: one of `Modes` or `Buckling`.

    Attributes
    ----------
    problem : Elasticity
        Of what.
    coefficients : ndarray, shape (functions, 3)
        Of the displacement, whose size means nothing.
    kind : {"frequency", "factor"}
        What the number is.
    number : float
        Frequency, or load factor.
    """

    problem: Elasticity
    coefficients: FloatArray
    kind: str
    number: float
    shown: ClassVar[str] = "displacement"
    written: ClassVar[tuple[tuple[str, str], ...]] = (("displacement", "evaluate"),)

    def __repr__(self) -> str:
        return f"Mode({self.kind} {self.number:.6g})"

    def field_data(self) -> dict[str, float]:
        """Numbers that files hold about the whole.

        Returns
        -------
        dict of str to float
            ``frequency`` or ``factor``.
        """
        return {self.kind: self.number}


@dataclass(frozen=True, eq=False, repr=False)
class Modes(Series[Mode]):
    """Natural frequencies, ascending; a sequence of the modes, such as ``modes[0].plot()``.

    Attributes
    ----------
    problem : Elasticity
        Of what.
    omega : ndarray, shape (count,)
        Angular frequencies; next to zero for rigid-body modes.
    vectors : ndarray, shape (count, functions, 3)
        Coefficients of the modes, of unit mass.
    report : EigenReport
        Method and residual.
    motions : tuple of tuple of Motion
        How the rigid connections move in each, in the order of `Elasticity.rigid`.
    """

    problem: Elasticity
    omega: FloatArray
    vectors: FloatArray
    report: EigenReport
    motions: tuple[tuple[Motion, ...], ...] = ()

    @property
    def frequencies(self) -> FloatArray:
        """Cycles per unit of time, shape (count,)."""
        return self.omega / (2 * np.pi)

    def __len__(self) -> int:
        return len(self.omega)

    def _result(self, number: int) -> Mode:
        frequency = float(self.frequencies[number])
        return Mode(self.problem, self.vectors[number], "frequency", frequency)


@dataclass(frozen=True, eq=False, repr=False)
class Buckling(Series[Mode]):
    """Factors of the loads at which a body buckles, ascending in size; a sequence of the shapes.

    Attributes
    ----------
    problem : Elasticity
        Of what.
    factors : ndarray, shape (count,)
        Load factors, all positive.
    vectors : ndarray, shape (count, functions, 3)
        Coefficients of the shapes, of unit energy x K x.
    report : EigenReport
        Method and residual.
    motions : tuple of tuple of Motion
        How the rigid connections move in each, in the order of `Elasticity.rigid`.
    """

    problem: Elasticity
    factors: FloatArray
    vectors: FloatArray
    report: EigenReport
    motions: tuple[tuple[Motion, ...], ...] = ()

    def __len__(self) -> int:
        return len(self.factors)

    def _result(self, number: int) -> Mode:
        return Mode(self.problem, self.vectors[number], "factor", float(self.factors[number]))


def natural_modes(
    problem: Elasticity, count: int = 6, *, method: str = "auto", tol: float = 1e-6,
    progress: Progress = None,
) -> Modes:  # fmt: skip
    """Lowest natural frequencies of a problem, and the shapes they have.

    Parameters
    ----------
    problem : Elasticity
        Its loads do not matter. Without supports the rigid-body modes are among the modes.
    count : int
        How many.
    method : str
        Of the solver, as in `Solver`.
    tol : float
        Largest residual |M x - μ K x| / |M x|.
    progress : bool or callable, optional
        Stages: "cells", "rules", "matrix", "factor" and "modes"; see `ilattice._progress.track`.

    Returns
    -------
    Modes
        Frequencies and coefficients.

    Raises
    ------
    InputError
        If an argument is wrong, or the solid has no mass.
    ConvergenceError
        If residuals stay above `tol`.
    """
    if as_kind("problem", problem, "Elasticity").connections:
        problem = rigid.held(problem)
        rigid.check_apart(problem)
    problem.prepare(progress)
    mass = problem._mass()
    if not mass.data.any():
        raise InputError("density: the solid has no mass, and no frequencies; give it a density")
    work = {"factor": lambda: _of_frequencies(problem, method, mass)}
    ((mine, shift),) = staged(work, progress)
    M = mine.reduced(mass)
    (found,) = staged({"modes": lambda: largest(M, mine.solver, count, mine.starts, tol)}, progress)
    mu, x, residual = found
    omega = np.sqrt(np.maximum(1 / mu - shift, 0.0))
    stiff, squares = mine.shapes(x)[0], omega**2

    def inertia(k: int) -> Acting | None:
        if not squares[k] > AT_REST * shift:
            return None
        return lambda rule, u, _: (squares[k] * _density(problem, rule)[:, None] * u, None)

    error = _discretization_error(mine, stiff, inertia, "the square of a frequency")
    shapes, motions = mine.shapes(x / np.sqrt(mu))
    report = EigenReport(mine.solver.method, residual, shift, error)
    return Modes(problem, read_only(omega), read_only(shapes), report, motions)


def _of_frequencies(problem: Elasticity, method: str, mass: Any) -> tuple[Pencil, float]:
    """The stiffness of a problem, and the part of the mass that is added where it is free."""
    if not problem.free_modes:
        mine = pencil(problem, method)
        stiff = np.linalg.eigvalsh(mine.S) if len(mine.S) else np.ones(1)
        if stiff[0] > rigid.FREE * stiff[-1]:
            return mine, 0.0
    M = problem.constraints.reduce(mass, diagonal=False)
    shift = SHIFT * _scale(problem.system._half, M, problem.system)
    return pencil(problem, method, shift * mass), shift


def buckling(
    solution: Solution, count: int = 3, *, method: str = "auto", tol: float = 1e-6,
    progress: Progress = None,
) -> Buckling:  # fmt: skip
    """Factors of the loads of a solution at which the body becomes unstable.

    Parameters
    ----------
    solution : Solution
        Under the loads that are to be multiplied.
    count : int
        How many factors, of those that are positive.
    method : str
        Of the solver, as in `Solver`.
    tol : float
        Largest residual |K_g x + μ K x| / |K_g x|.
    progress : bool or callable, optional
        "stress", "factor" and "modes"; see `ilattice._progress.track`.

    Returns
    -------
    Buckling
        Factors and shapes.

    Raises
    ------
    InputError
        If an argument is wrong, or the solution has no stress.
    ConvergenceError
        If residuals stay above `tol`, or fewer than `count` factors are positive: at once where
        loads only pull.
    """
    problem: Any = as_kind("solution", solution, "Solution").problem
    (full,) = staged({"stress": lambda: problem._geometric_stiffness(solution.stress_on)}, progress)
    if not full.data.any():
        raise InputError(
            "solution: it has no stress, and nothing buckles without; add loads, or prescribed "
            "displacements, before solving"
        )
    (mine,) = staged({"factor": lambda: pencil(problem, method)}, progress)
    geometric = mine.reduced(full, mine.second_order(solution))
    _refuse_pulls(geometric, mine.K)
    work = {"modes": lambda: largest(-geometric, mine.solver, count, mine.starts, tol)}
    ((mu, x, residual),) = staged(work, progress)
    if not mu.min() > 0:
        raise ConvergenceError(
            f"only {int((mu > 0).sum())} of {count} load factors are positive: these loads press "
            "on little; ask for fewer"
        )
    shapes, motions = mine.shapes(x)

    def pressing(k: int) -> Acting:
        return lambda rule, _, g: (None, -g @ solution.stress_on(rule)[:, PLACES] / mu[k])

    error = _discretization_error(mine, shapes, pressing, "a load factor")
    report = EigenReport(mine.solver.method, residual, 0.0, error)
    return Buckling(problem, read_only(1 / mu), read_only(shapes), report, motions)


def _refuse_pulls(geometric: Any, K: Any) -> None:
    """Refuse loads under which no factor is positive that leaves stress below stiffness."""
    own, stiff = geometric.diagonal(), K.diagonal()
    if own.min() < 0.0 or K.shape[0] > CERTAIN:  # such a node gives way, or a factor is too large
        return
    far = 1.0 / (own / stiff).max()
    if definite(K + far * geometric):
        raise ConvergenceError(
            f"no load factor is positive up to {far:.2g}, where stress is as large as stiffness: "
            "these loads pull, and nothing buckles; turn them"
        )


def _density(problem: Elasticity, rule: Quadrature) -> FloatArray:
    """Densities (n,) or (1,) at the points of a rule in space."""
    assert rule.parameters is not None
    owner = problem.assembly.owners(rule)
    return problem._scalar_at(problem.material.density, rule.parameters, owner)


def _discretization_error(
    mine: Pencil, shapes: FloatArray, acting: Callable[[int], Acting | None], what: str
) -> float:
    """Worst estimate for some shapes of unit energy, with a warning if it is large.

    `acting` tells what acts on a shape, and None of rigid motions, whose stress is rounding.
    """
    problem = mine.problem
    nodes = mine.solver.nodes if isinstance(mine.solver, Joined) else mine.solver
    error = max(problem._discretization_error(nodes.multiply, c, 1.0) for c in shapes)
    loads = [(c, acting(k)) for k, c in enumerate(shapes)]
    locked = max((locking.relative_error(problem, c, f) for c, f in loads if f), default=0.0)
    thin = locked > (WARNED if np.isnan(error) else error)
    error = float(locked if thin else error)
    warn(error, what, problem.assembly.space, thin=thin)
    return error


def _scale(K: Any, M: Any, system: Any) -> float:
    """Largest ratio of stiffness and mass of displacements that are linear in one coordinate."""
    x = system.coordinates - system.coordinates.mean(axis=0)
    fields = (x[:, :, None, None] * np.eye(3)).transpose(0, 2, 1, 3).reshape(len(x) * 3, 9)
    return float(((fields * (K @ fields)).sum(axis=0) / (fields * (M @ fields)).sum(axis=0)).max())
