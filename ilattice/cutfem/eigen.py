"""Largest eigenvalues of A x = μ K x, by a solver of K.

By Lanczos' method where K has a factor, and by LOBPCG preconditioned by multigrid (A. Knyazev,
"Toward the optimal preconditioned eigensolver", SIAM J. Sci. Comput. 23, 2001) where the factor
would be too large. One start of Lanczos' method sees one vector of every group of equal values, so
that it is started again beside what is known until nothing more is found.

Guarantee: residuals are computed afresh, and above `tol` raise `ConvergenceError`.
"""

from __future__ import annotations

import warnings
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

#: Vectors that LOBPCG works with beyond those asked for, rounds of it, steps in each.
GUARD = 4
ROUNDS, STEPS = 12, 25
#: Vectors that are looked for beside those that are known; values count as larger from this on.
BESIDE, MORE = 3, 1e-9
#: Unknowns up to which all pairs are found at once where few cells are asked for many.
DENSE = 3000


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
    unit = _size(A, solver, starts)
    A = A * (1.0 / unit)  # what ARPACK takes for zero is an absolute number
    find = _by_preconditioner if solver.method in ("multigrid", "pyamg") else _by_factor
    if n < 5 * (count + GUARD):
        mu, x = eigh(A.toarray(), solver.multiply(np.eye(n)))
    else:
        mu, x = find(A, solver, count, starts, tol)
    order = np.argsort(-mu)[:count]
    mu, x = mu[order], x[:, order]
    residual = _residual(A, solver, mu, x)
    mu = unit * mu
    if not residual <= tol:
        raise ConvergenceError(
            f"eigenvectors by {solver.method} have a residual of {residual:.1e}, above tol = "
            f"{tol:.1e}; ask for another number of them, or "
            + ("finer cells" if solver.method == "superlu" else "method='superlu'")
        )
    return mu, x, residual


def _size(A: Any, solver: Any, starts: FloatArray) -> float:
    """About the largest eigenvalue: that of motions with little energy, one by one."""
    x = starts[:, np.abs(starts).max(axis=0) > 0]
    if x.shape[1]:
        with np.errstate(divide="ignore", invalid="ignore"):
            found = np.abs((x * (A @ x)).sum(axis=0)) / (x * solver.multiply(x)).sum(axis=0)
        found = found[np.isfinite(found) & (found > 0.0)]
        if len(found):
            return float(found.max())
    return 1.0


def _by_factor(A: Any, solver: Any, count: int, motions: FloatArray, tol: float) -> Any:
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


def _known(A: Any, solver: Any, motions: FloatArray, tol: float) -> tuple[FloatArray, Any]:
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
        if _residual(A, solver, mu[:count], x[:, :count]) <= tol:
            break
    return mu, x


def _residual(A: Any, solver: Any, mu: FloatArray, x: FloatArray) -> float:
    """Largest |A x - μ K x| / |A x|."""
    Kx = np.stack([solver.multiply(np.ascontiguousarray(v)) for v in x.T], axis=1)
    Ax = A @ x
    return float((np.linalg.norm(Ax - mu * Kx, axis=0) / np.linalg.norm(Ax, axis=0)).max())
