"""Conjugate gradients in double precision, for any preconditioner.

Guarantees: the residual at the end is that of the solution, computed afresh, not the one that the
recursion believes in. Sums are taken in fixed chunks: the same bits for any number of threads.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import eigvalsh_tridiagonal

from ilattice._progress import Progress, track
from ilattice._typing import FloatArray
from ilattice.cutfem import _kernels_blocks as kb

Operator = Callable[[FloatArray], FloatArray]
RESTARTS = 5
#: The condition of the preconditioned matrix is looked at every so many steps, and taken for
#: that of a singular matrix above HOPELESS.
LOOK, HOPELESS = 50, 1e12


@dataclass
class Run:
    """What came out.

    Attributes
    ----------
    x : ndarray, shape (n,)
        Solution.
    history : list of float
        Relative residual before the first and after every step.
    residual : float
        Relative residual |b - K x| / |b| of x.
    condition : float
        Estimate, from below, of the condition number of the preconditioned matrix.
    trouble : str
        Why it stopped early, or nothing.
    """

    x: FloatArray
    history: list[float] = field(default_factory=list)
    residual: float = 0.0
    condition: float = 1.0
    trouble: str = ""


class _Bar:
    """Percent of the digits that are asked for."""

    def __init__(self, tol: float, progress: Progress) -> None:
        self.tol = tol
        self.done = 0
        self.bar: Iterator[int] = track(range(100), "solve", progress)
        next(self.bar)

    def show(self, residual: float) -> None:
        """Advance to where this residual is."""
        part = np.log(max(residual, 1e-300)) / np.log(self.tol)
        while self.done < min(100, int(100 * part)):
            self.done += 1
            next(self.bar, None)


def conjugate_gradients(
    K: Operator, M: Operator, b: FloatArray, tol: float, steps: int, progress: Progress
) -> Run:
    """Solve K x = b to |b - K x| <= tol |b|, or say why not.

    The flexible variant, which forgives a preconditioner that is only nearly symmetric: the
    cycle rounds to single precision.
    """
    run = Run(np.zeros_like(b))
    length = np.sqrt(_dots(b, b)[0])
    if length == 0:
        return run
    run.residual = 1.0
    run.history.append(1.0)
    bar = _Bar(tol, progress)
    for _ in range(RESTARTS):
        r = b - K(run.x) if len(run.history) > 1 else b.copy()
        _descend(run, K, M, r, length, tol, steps, bar)
        run.residual = float(np.sqrt(_dots(*(b - K(run.x),) * 2)[0]) / length)
        if run.trouble or run.residual <= tol or len(run.history) > steps:
            break
    return run


def _descend(
    run: Run, K: Operator, M: Operator, r: FloatArray, length: float, tol: float, steps: int,
    bar: _Bar,
) -> None:  # fmt: skip
    """Go on from run.x with residual r, which is overwritten."""
    z = M(r)
    p = z.copy()
    rz = _dots(r, z)[0]
    alphas: list[float] = []
    betas: list[float] = []
    while len(run.history) <= steps:
        q = K(p)
        pq = _dots(p, q)[0]
        if not (pq > 0 and rz > 0):
            run.trouble = "the matrix or its preconditioner is not positive definite"
            return
        alpha = rz / pq
        kb.combine(alpha, p, 1.0, run.x)
        kb.combine(-alpha, q, 1.0, r)
        run.history.append(float(np.sqrt(_dots(r, r)[0]) / length))
        bar.show(run.history[-1])
        alphas.append(alpha)
        if len(alphas) % LOOK == 0:
            run.condition = max(run.condition, _condition(alphas, betas))
            if run.condition > HOPELESS:
                run.trouble = "the matrix is singular to working precision"
                return
        if run.history[-1] <= tol:
            break
        z = M(r)
        rz_new, qz = _dots(z, r, q)
        betas.append(-alpha * qz / rz)
        rz = rz_new
        kb.combine(1.0, z, betas[-1], p)
    run.condition = max(run.condition, _condition(alphas, betas))


def _dots(x: FloatArray, y: FloatArray, z: FloatArray | None = None) -> tuple[float, float]:
    a, b = kb.dots(x, y, y if z is None else z).sum(axis=0)
    return float(a), float(b)


def _condition(alphas: list[float], betas: list[float]) -> float:
    """Ratio of the extreme Ritz values of Lanczos' matrix, which the coefficients make up."""
    if not alphas:
        return 1.0
    a = np.array(alphas)
    b = np.maximum(betas[: len(a) - 1], 0.0)
    diagonal = 1 / a
    diagonal[1:] += b / a[:-1]
    ritz = eigvalsh_tridiagonal(diagonal, np.sqrt(b) / a[:-1])
    return float(ritz[-1] / ritz[0]) if ritz[0] > 0 else np.inf
