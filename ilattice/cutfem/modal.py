"""Natural frequencies, vibration modes and linear buckling of problems of elasticity.

::

    modes = natural_modes(problem, count=6)
    modes.frequencies  # cycles per unit of time
    modes[0].plot()
    modes.save("modes.pvd")  # all, for ParaView
    critical = buckling(solution)  # load factors

Both are A x = μ K x with the stiffness K and its `Solver`: frequencies with the mass for A (then
μ = 1 / ω²), buckling with minus the geometric stiffness (then μ = 1 / load factor). The largest μ
are found by Lanczos' method where K has a factor, and by LOBPCG preconditioned by multigrid
(A. Knyazev, "Toward the optimal preconditioned eigensolver", SIAM J. Sci. Comput. 23, 2001) where
the factor would be too large. One start of Lanczos' method sees one vector of every group of equal
values, so that it is started again beside what is known until nothing more is found. A body that
is free to move gets a little of its mass added to K, which moves no mode; its rigid motions come
first, with frequencies next to zero.

Guarantees: residuals are computed afresh and above `tol` raise `ConvergenceError`; modes are
orthonormal in the mass, or in the stiffness for buckling. Non-guarantee: which vectors come out of
a group of equal frequencies.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from scipy.linalg import eigh, orth
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh, lobpcg

from ilattice._progress import Progress
from ilattice._typing import AnyArray, ArrayLike, FloatArray
from ilattice._validate import as_counts, as_kind, as_points, as_positive, read_only
from ilattice.cutfem.discretization import warn
from ilattice.cutfem.output import Result, Series
from ilattice.errors import ConvergenceError, InputError
from ilattice.linalg._engines import definite
from ilattice.linalg.solvers import Solver

if TYPE_CHECKING:
    from ilattice.cutfem.elasticity import Elasticity
    from ilattice.cutfem.solution import Solution

#: Vectors that LOBPCG works with beyond those asked for, rounds of it, steps in each.
GUARD = 4
ROUNDS, STEPS = 12, 25
#: Vectors that are looked for beside those that are known; values count as larger from this on.
BESIDE, MORE = 3, 1e-9
#: Unknowns up to which all pairs are found at once where few cells are asked for many.
DENSE = 3000
#: Unknowns up to which it is made sure that loads press somewhere.
CERTAIN = 100_000
#: Part of the mass that is added to a free body, in units of the stiffness of simple strains.
SHIFT = 1e-2


@dataclass(frozen=True, eq=False)
class EigenReport:
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

    def __repr__(self) -> str:
        return f"Mode({self.kind} {self.number:.6g})"

    def evaluate(self, u: ArrayLike) -> FloatArray:
        """Displacement at parameters.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n, 3)
            Displacement; NaN more than a cell away from the solid.
        """
        return self.problem.assembly.evaluate(self.coefficients, as_points("u", u))[0]

    def point_data(self, u: ArrayLike) -> dict[str, AnyArray]:
        """What files hold, at parameters.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.

        Returns
        -------
        dict of str to ndarray
            ``displacement`` (n, 3).
        """
        return {"displacement": self.evaluate(u)}

    def field_data(self) -> dict[str, float]:
        """Numbers that files hold about the whole.

        Returns
        -------
        dict of str to float
            ``frequency`` or ``factor``.
        """
        return {self.kind: self.number}


@dataclass(frozen=True, eq=False)
class Modes(Series[Mode]):
    """Natural frequencies, ascending; a sequence of the modes, such as ``modes[0].plot()``.

    Attributes
    ----------
    problem : Elasticity
        Of what.
    omega : ndarray, shape (count,)
        Angular frequencies; next to zero for rigid motions.
    vectors : ndarray, shape (count, functions, 3)
        Coefficients of the modes, of unit mass.
    report : EigenReport
        Method and residual.
    """

    problem: Elasticity
    omega: FloatArray
    vectors: FloatArray
    report: EigenReport

    @property
    def frequencies(self) -> FloatArray:
        """Cycles per unit of time, shape (count,)."""
        return self.omega / (2 * np.pi)

    def __len__(self) -> int:
        return len(self.omega)

    def _result(self, number: int) -> Mode:
        frequency = float(self.frequencies[number])
        return Mode(self.problem, self.vectors[number], "frequency", frequency)


@dataclass(frozen=True, eq=False)
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
    """

    problem: Elasticity
    factors: FloatArray
    vectors: FloatArray
    report: EigenReport

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
        Its loads do not matter. Without supports the rigid motions are among the modes.
    count : int
        How many.
    method : str
        Of the solver, as in `Solver`.
    tol : float
        Largest residual |M x - μ K x| / |M x|.
    progress : bool or callable, optional
        Stages up to the matrix; see `ilattice._progress.track`.

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
    as_kind("problem", problem, "Elasticity").prepare(progress)
    system = problem.system
    M = problem.mass()
    if not M.data.any():
        raise InputError("density: the solid has no mass, and no frequencies; give it a density")
    K, shift = system.K, 0.0
    if problem.free_motions:
        shift = SHIFT * _scale(K, M, system)
        K = K + shift * M
    solver = _solver(K, system, method)
    mu, x, residual = largest(M, solver, count, system, tol)
    omega = np.sqrt(np.maximum(1 / mu - shift, 0.0))
    shapes = _expand(problem, x)
    error = _discretization_error(problem, solver, shapes, "the square of a frequency")
    report = EigenReport(solver.method, residual, shift, error)
    return Modes(problem, read_only(omega), read_only(shapes / np.sqrt(mu)[:, None, None]), report)


def buckling(
    solution: Solution, count: int = 3, *, method: str = "auto", tol: float = 1e-6
) -> Buckling:
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
    geometric = problem.geometric_stiffness(solution)
    if not geometric.data.any():
        raise InputError(
            "solution: it has no stress, and nothing buckles without; add loads, or prescribed "
            "displacements, before solving"
        )
    system = problem.system
    solver = _solver(system.K, system, method)
    _refuse_pulls(geometric, system.K)
    mu, x, residual = largest(-geometric, solver, count, system, tol)
    if not mu.min() > 0:
        raise ConvergenceError(
            f"only {int((mu > 0).sum())} of {count} load factors are positive: these loads press "
            "on little; ask for fewer"
        )
    shapes = _expand(problem, x)
    error = _discretization_error(problem, solver, shapes, "a load factor")
    report = EigenReport(solver.method, residual, 0.0, error)
    return Buckling(problem, read_only(1 / mu), read_only(shapes), report)


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


def largest(
    A: Any, solver: Solver, count: int, system: Any, tol: float
) -> tuple[FloatArray, FloatArray, float]:
    """Largest μ of A x = μ K x, descending, x (n, count) of unit x K x, and the worst residual.

    Parameters
    ----------
    A : sparse array, shape (n, n)
        Symmetric.
    solver : Solver
        Of K.
    count : int
        How many.
    system : System
        For the near-nullspace, where the search starts.
    tol : float
        Largest |A x - μ K x| / |A x|.

    Returns
    -------
    mu : ndarray, shape (count,)
        Eigenvalues.
    x : ndarray, shape (n, count)
        Eigenvectors.
    residual : float
        The largest.

    Raises
    ------
    InputError
        If `count` or `tol` is wrong.
    ConvergenceError
        If the residual is above `tol`.
    """
    count, tol = as_counts("count", count)[0], as_positive("tol", tol)
    n = A.shape[0]
    most = n if n <= DENSE else n // 5 - GUARD
    if count > most:
        raise InputError(
            f"count = {count} is too many for {n} unknowns: at most {most} can be found; ask for "
            "fewer, or take more cells"
        )
    find = _by_preconditioner if solver.method in ("multigrid", "pyamg") else _by_factor
    if n < 5 * (count + GUARD):
        mu, x = eigh(A.toarray(), solver.multiply(np.eye(n)))
    else:
        mu, x = find(A, solver, count, system.near_nullspace, tol)
    order = np.argsort(-mu)[:count]
    mu, x = mu[order], x[:, order]
    residual = _residual(A, solver, mu, x)
    if not residual <= tol:
        raise ConvergenceError(
            f"eigenvectors by {solver.method} have a residual of {residual:.1e}, above tol = "
            f"{tol:.1e}; ask for another number of them, or "
            + ("finer cells" if solver.method == "superlu" else "method='superlu'")
        )
    return mu, x, residual


def _by_factor(A: Any, solver: Solver, count: int, motions: FloatArray, tol: float) -> Any:
    n = A.shape[0]
    K = LinearOperator((n, n), lambda v: solver.multiply(np.ravel(v)), dtype=float)
    inverse = LinearOperator((n, n), lambda v: solver.precondition(np.ravel(v)), dtype=float)
    rng = np.random.default_rng(0)
    mu, x = _known(A, solver, motions, 1e-2 * tol)
    wanted = max(count - len(mu), 1)
    for _ in range(count + 2):  # each start but the last finds one of those that are missing
        rest = _without(A, solver.multiply(x), mu) if len(mu) else A
        start = rng.standard_normal(n)
        try:
            more, y = eigsh(rest, wanted, K, which="LA", Minv=inverse, v0=start, tol=1e-2 * tol)
        except ArpackNoConvergence as e:
            raise ConvergenceError(
                f"Lanczos' method found {len(e.eigenvalues)} of {wanted} modes; ask for fewer"
            ) from e
        least = np.sort(mu)[-count] if len(mu) >= count else None
        new = np.isfinite(more) if least is None else more > least + MORE * abs(least)
        if not new.any():
            return mu, x
        mu, x = np.append(mu, more[new]), np.concatenate([x, y[:, new]], axis=1)
        wanted = min(count, BESIDE)
    raise ConvergenceError(
        f"Lanczos' method finds ever more than {count} modes in {n} unknowns; give another method"
    )


def _known(A: Any, solver: Solver, motions: FloatArray, tol: float) -> tuple[FloatArray, Any]:
    """Those combinations of rigid motions that are eigenvectors, of unit x K x."""
    x = orth(motions)
    if not x.shape[1]:
        return np.zeros(0), x
    mu, S = eigh(x.T @ (A @ x), x.T @ solver.multiply(x))
    x = x @ S
    gap = np.linalg.norm(A @ x - mu * solver.multiply(x), axis=0)
    good = gap <= tol * np.linalg.norm(A @ x, axis=0)
    return mu[good], x[:, good]


def _without(A: Any, Kx: FloatArray, mu: FloatArray) -> LinearOperator:
    """A with zero instead of known values: v ↦ A v - K x μ (K x)ᵀ v."""
    return LinearOperator(A.shape, lambda v: A @ v - Kx @ (mu * (Kx.T @ v)), dtype=float)


def _by_preconditioner(A: Any, solver: Solver, count: int, modes: FloatArray, tol: float) -> Any:
    n = A.shape[0]

    def each(function: Any) -> LinearOperator:
        def block(V: FloatArray) -> FloatArray:
            columns = np.asarray(V).reshape(n, -1).T
            return np.stack([function(np.ascontiguousarray(v)) for v in columns], axis=1)

        return LinearOperator((n, n), matvec=block, matmat=block, dtype=float)

    M, K = each(solver.precondition), each(solver.multiply)
    x = M @ (A @ np.random.default_rng(0).standard_normal((n, count + GUARD)))
    known = modes[:, np.abs(modes).max(axis=0) > 0][:, : count + GUARD]
    x[:, : known.shape[1]] += known * (np.abs(x).max() / np.abs(known).max())
    for _ in range(ROUNDS):
        length = np.sqrt((x * (K @ x)).sum(axis=0))
        least = float((np.linalg.norm(A @ x, axis=0) / length)[:count].min())
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the residuals are computed below
            found: Any = lobpcg(A, x, K, M, tol=0.3 * tol * least, maxiter=STEPS, largest=True)
        mu, x = found
        if _residual(A, solver, mu[:count], x[:, :count]) <= tol:
            break
    return mu, x


def _residual(A: Any, solver: Solver, mu: FloatArray, x: FloatArray) -> float:
    """Largest |A x - μ K x| / |A x|."""
    Kx = np.stack([solver.multiply(np.ascontiguousarray(v)) for v in x.T], axis=1)
    Ax = A @ x
    return float((np.linalg.norm(Ax - mu * Kx, axis=0) / np.linalg.norm(Ax, axis=0)).max())


def _solver(K: Any, system: Any, method: str) -> Solver:
    return Solver(K, near_nullspace=system.near_nullspace, method=method, places=system.places)


def _expand(problem: Any, x: FloatArray) -> FloatArray:
    """All coefficients of vectors on free nodes, zero where the body is held."""
    con = problem.constraints
    shapes = [con.expand(np.ascontiguousarray(v).reshape(-1, 3)) - con.values for v in x.T]
    return np.stack(shapes)


def _discretization_error(problem: Any, solver: Solver, shapes: FloatArray, what: str) -> float:
    """Worst estimate for some shapes of unit energy, with a warning if it is large."""
    error = max(problem._discretization_error(solver.multiply, c, 1.0) for c in shapes)
    warn(error, what, problem.assembly.space)
    return float(error)


def _scale(K: Any, M: Any, system: Any) -> float:
    """Largest ratio of stiffness and mass of displacements that are linear in one coordinate."""
    x = system.places - system.places.mean(axis=0)
    fields = (x[:, :, None, None] * np.eye(3)).transpose(0, 2, 1, 3).reshape(len(x) * 3, 9)
    return float(((fields * (K @ fields)).sum(axis=0) / (fields * (M @ fields)).sum(axis=0)).max())
