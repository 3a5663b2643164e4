"""Largest eigenvalues of A x = μ K x, by a solver of K.

By Lanczos' method where K has a factor, and by LOBPCG preconditioned by multigrid (A. Knyazev,
"Toward the optimal preconditioned eigensolver", SIAM J. Sci. Comput. 23, 2001) where the factor
would be too large. One start of Lanczos' method sees one vector of every group of equal values, so
that it is started again beside what is known until nothing more is found.

Guarantee: residuals are computed afresh, and above `tol` raise `ConvergenceError`, unless they are
what rounding K leaves: of bodies on very soft springs that is more than of others, as they move far
by little. Values do not depend on units.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import eigh, orth
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh, lobpcg

from ilattice._typing import FloatArray
from ilattice._validate import as_counts, as_positive
from ilattice.errors import ConvergenceError, InputError

if TYPE_CHECKING:
    from ilattice.cutfem.pencil import Joined
    from ilattice.linalg.solvers import Solver

_Map = Callable[[FloatArray], FloatArray]

#: Vectors that LOBPCG works with beyond those asked for, rounds of it, steps in each.
GUARD = 4
ROUNDS, STEPS = 12, 25
#: Vectors that are looked for beside those that are known; values count as larger from this on.
BESIDE, MORE = 3, 1e-9
#: Part of a vector that is left without known ones, below which it is one of them.
AGAIN = 1e-3
#: Unknowns up to which all pairs are found at once where few cells are asked for many.
DENSE = 3000
#: Steps of power iterations that tell sizes of operators; residuals by rounding, in units of that
#: of one product, and the largest of them that still tell something.
POWERS, ROUNDED, MAX_ROUNDED = 4, 8.0, 1e-2
#: Steps of inverse iteration in the end: the first one leaves rounding of its own.
TWICE = 2


def largest(
    A: Any, solver: Solver | Joined, count: int, starts: FloatArray, tol: float
) -> tuple[FloatArray, FloatArray, float]:
    """Largest μ of A x = μ K x, descending, x (n, count) of unit x K x, and the worst residual.

    Parameters
    ----------
    A : sparse array, shape (n, n)
        Symmetric.
    solver : Solver or Joined
        Of K.
    count : int
        How many.
    starts : ndarray, shape (n, k)
        Motions with little energy, where the search starts.
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
        If the residual is above `tol`, and not by rounding alone.
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
        mu, x = find(A, solver, count, starts, tol)
    order = np.argsort(-mu)[:count]
    mu, x = mu[order], x[:, order]
    residuals = _residuals(A, solver, mu, x)
    residual = float(residuals.max())
    if residual <= tol:
        return mu, x, residual
    rounding = _rounding(A, solver, mu, x)
    if not (residuals <= np.maximum(tol, rounding)).all():
        remedy = "finer cells" if solver.method == "superlu" else "method='superlu'"
        if rounding.max() > tol:
            remedy = "springs that are not so much softer than the solid"
        raise ConvergenceError(
            f"eigenvectors by {solver.method} have a residual of {residual:.1e}, above tol = "
            f"{tol:.1e}; ask for another number of them, or {remedy}"
        )
    return mu, x, residual


def _by_factor(A: Any, solver: Any, count: int, rigid: FloatArray, tol: float) -> Any:
    n = A.shape[0]
    K = LinearOperator((n, n), lambda v: solver.multiply(np.ravel(v)), dtype=float)
    inverse = LinearOperator((n, n), lambda v: solver.precondition(np.ravel(v)), dtype=float)
    rng = np.random.default_rng(0)
    mu, x = _known(A, solver, rigid, 1e-2 * tol)
    wanted = max(count - len(mu), 1)
    for _ in range(count + 2):  # each start but the last finds one of those that are missing
        rest = _without(A, mu, x)
        start = rng.standard_normal(n)
        size = _size(rest, inverse, start)  # ARPACK takes values below 1e-11 for zero
        scaled = _scaled(rest, n, size)
        try:
            more, y = eigsh(scaled, wanted, K, which="LA", Minv=inverse, v0=start, tol=1e-2 * tol)
        except ArpackNoConvergence as e:
            raise ConvergenceError(
                f"Lanczos' method found {len(e.eigenvalues)} of {wanted} modes; ask for fewer"
            ) from e
        more = size * more
        least = np.sort(mu)[-count] if len(mu) >= count else None
        new = np.isfinite(more) if least is None else more > least + MORE * abs(least)
        known = len(mu)
        for value, v in zip(more[new], y[:, new].T, strict=True):
            apart = _apart(A, solver, mu, x, v)
            if apart is not None:
                mu, x = np.append(mu, value), np.column_stack([x, apart])
        if len(mu) == known:
            return _polished(A, solver, *_combined(A, solver, x))
        wanted = min(count, BESIDE)
    raise ConvergenceError(
        f"Lanczos' method finds ever more than {count} modes in {n} unknowns; give another method"
    )


def _known(A: Any, solver: Any, rigid: FloatArray, tol: float) -> tuple[FloatArray, Any]:
    """Those combinations of rigid-body modes that are eigenvectors, of unit x K x."""
    x = orth(rigid)
    if not x.shape[1]:
        return np.zeros(0), x
    mu, x = _combined(A, solver, x)
    gap = np.linalg.norm(A @ x - mu * solver.multiply(x), axis=0)
    good = gap <= tol * np.linalg.norm(A @ x, axis=0)
    return mu[good], x[:, good]


def _combined(A: Any, solver: Any, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The best pairs in the span of x (n, k)."""
    try:
        mu, S = eigh(x.T @ (A @ x), x.T @ solver.multiply(x))
    except np.linalg.LinAlgError as e:
        raise ConvergenceError(
            "rounding leaves no energy in the softest motions; take springs that are not so much "
            "softer than the solid"
        ) from e
    return mu, x @ S


def _polished(A: Any, solver: Any, mu: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pairs after inverse iteration, without what rounding leaves of softer ones.

    That is taken out by A, in which these are large: in K they are nearly nothing.
    """
    order = np.argsort(-np.abs(mu))
    mu, x = mu[order], np.array(x[:, order])
    least = np.finfo(float).eps * np.abs(mu).max(initial=0.0)
    for k in range(int((np.abs(mu) > least).sum())):  # A tells nothing of those without it
        y, softer = x[:, k] / np.linalg.norm(x[:, k]), x[:, :k]
        for _ in range(TWICE):
            y = solver.precondition(A @ y) / abs(mu[k])
            y = y - softer @ (softer.T @ (A @ y) / mu[:k])
        y /= np.sqrt(abs(y @ solver.multiply(y)))
        mu[k], x[:, k] = y @ (A @ y), y
    return mu, x


def _apart(A: Any, solver: Any, mu: FloatArray, x: FloatArray, v: FloatArray) -> Any:
    """A vector v (n,) without its part in known ones, of unit v K v; None where nothing is left.

    Rounding in K finds soft modes again, so what they are is taken out by A.
    """
    some = np.abs(mu) > np.finfo(float).eps * np.abs(mu).max(initial=0.0)
    rest = v
    for _ in range(TWICE):
        rest = rest - x[:, some] @ (x[:, some].T @ (A @ rest) / mu[some])
    square = float(rest @ solver.multiply(np.ascontiguousarray(rest)))
    if np.linalg.norm(rest) <= AGAIN * np.linalg.norm(v) or not square > 0.0:
        return None
    return rest / np.sqrt(square)


def _without(A: Any, mu: FloatArray, x: FloatArray) -> _Map:
    """A with zero instead of known values: v ↦ A v - A x (A x)ᵀ v / μ, of x of unit x K x.

    Not by K x, which is the same but for rounding: soft motions are nearly nothing in K.
    """
    some = np.abs(mu) > np.finfo(float).eps * np.abs(mu).max(initial=0.0)
    Ax, mu = A @ x[:, some], mu[some]
    return lambda v: A @ v - Ax @ (Ax.T @ v / mu)


def _scaled(A: _Map, n: int, size: float) -> LinearOperator:
    """A divided by a number."""
    return LinearOperator((n, n), lambda v: A(v) / size, dtype=float)


def _size(A: _Map, inverse: Any, start: FloatArray) -> float:
    """About the largest |μ| of A x = μ K x; 1 where A is zero."""
    v, size = start, 0.0
    for _ in range(POWERS):
        w = inverse @ A(v)
        size = float(np.linalg.norm(w) / np.linalg.norm(v))
        if not 0.0 < size < np.inf:
            return 1.0
        v = w / np.linalg.norm(w)
    return size


def _by_preconditioner(A: Any, solver: Any, count: int, modes: FloatArray, tol: float) -> Any:
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
        if _residuals(A, solver, mu[:count], x[:, :count]).max() <= tol:
            break
    return mu, x


def _residuals(A: Any, solver: Any, mu: FloatArray, x: FloatArray) -> FloatArray:
    """|A x - μ K x| / |A x| of each pair (count,)."""
    Kx = np.stack([solver.multiply(np.ascontiguousarray(v)) for v in x.T], axis=1)
    Ax = A @ x
    out: FloatArray = np.linalg.norm(Ax - mu * Kx, axis=0) / np.linalg.norm(Ax, axis=0)
    return out


def _rounding(A: Any, solver: Any, mu: FloatArray, x: FloatArray) -> FloatArray:
    """Residuals (count,) that rounding the product K x leaves; zero where they tell nothing."""
    v = np.random.default_rng(0).standard_normal(len(x))
    for _ in range(POWERS):
        v = solver.multiply(v / np.linalg.norm(v))
    noise = ROUNDED * np.finfo(float).eps * np.linalg.norm(v) * np.linalg.norm(x, axis=0)
    out = np.abs(mu) * noise / np.linalg.norm(A @ x, axis=0)
    return np.where(out <= MAX_ROUNDED, out, 0.0)
