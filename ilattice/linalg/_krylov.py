"""Conjugate gradients in double precision, for any preconditioner.

Guarantees: the residual at the end is that of the solution, computed afresh, not the one that the
recursion believes in; and what the last step changed in the energy norm is below the tolerance,
too: in slender bodies residuals are small while they still sink. Where rounding keeps a residual
up, which it does by |K| |x| however good x is, the steps from there on tell how far x is off in the
energy norm (Hestenes and Stiefel, Methods of conjugate gradients, 1952). Sums are taken in fixed
chunks: the same bits for any number of threads.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import eigvalsh_tridiagonal

from ilattice._progress import Progress, track
from ilattice._typing import FloatArray
from ilattice.linalg import _kernels_blocks as kb

Operator = Callable[[FloatArray], FloatArray]
Residuals = Callable[[FloatArray, FloatArray], FloatArray]
#: Times that iterations begin again, from residuals with more digits.
RESTARTS = 5
#: The condition of the preconditioned matrix is looked at every so many steps, and taken for
#: that of a singular matrix above HOPELESS.
LOOK, HOPELESS = 50, 1e12
#: Rounding keeps a residual up that is above this part of the one before, though the recursion,
#: which began from that, ended below the tolerance.
STALLED = 0.5
#: What the last steps changed in the energy norm, over the tolerance, at most: rounding leaves an
#: error of about this size, not just this one.
SURE = 0.5
#: Part of the tolerance below which a residual is small enough whatever steps change, as after the
#: first one of a factor.
NEAR = 1e-4
#: What rounding of products with the matrix would change in the energy norm, over the tolerance, at
#: most: entries of the matrix are rounded as well, so that its solution is off by about as much.
DIGITS = 2.0


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
    rounded : bool
        Whether the residual is above the tolerance only because of rounding: the error of x in the
        energy norm, relative to x, is not.
    energy : float
        Square of the energy norm of all that steps have changed.
    """

    x: FloatArray
    history: list[float] = field(default_factory=list)
    residual: float = 0.0
    condition: float = 1.0
    trouble: str = ""
    rounded: bool = False
    energy: float = 0.0


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
    K: Operator, M: Operator, b: FloatArray, tol: float, steps: int, progress: Progress,
    residuals: Residuals,
) -> list[Run]:  # fmt: skip
    """Solve K x = b for rows of b (r, n) to |b - K x| <= tol |b|, or say why not.

    The flexible variant, which forgives a preconditioner that is only nearly symmetric: the
    cycle rounds to single precision. Rows go together through the matrix and the preconditioner,
    each with coefficients of its own, until they are solved. Where they go on after a restart,
    they do so from `residuals`, which have more digits than K has: else what rounding leaves of
    them, times the condition of the matrix, would be what is left of the error.
    """
    x = np.zeros_like(b)
    runs = [Run(row) for row in x]
    lengths = [float(np.sqrt(_dots(row, row)[0])) for row in b]
    left = [i for i, length in enumerate(lengths) if length != 0]
    for i in left:
        runs[i].residual = 1.0
        runs[i].history.append(1.0)
    bar = _Bar(tol, progress)
    for turn in range(RESTARTS):
        if not left:
            break
        r = residuals(b[left], x[left]) if turn else b[left]
        rows = [_Row(runs[i], lengths[i]) for i in left]
        _descend(rows, K, M, r, tol, steps, bar)
        r = b[left] - K(x[left])
        for i, row, new in zip(left, rows, r, strict=True):
            before, run = runs[i].residual, runs[i]
            run.residual = float(np.sqrt(_dots(new, new)[0]) / lengths[i])
            if run.residual > max(tol, STALLED * before) and run.history[-1] <= tol:
                size = _dots(x[i], b[i])[0]
                noise = new - residuals(b[i : i + 1], x[i : i + 1])[0]
                digits = _dots(noise, M(noise[None])[0])[0]
                run.rounded = (
                    row.gain <= (SURE * tol) ** 2 * size and digits <= (DIGITS * tol) ** 2 * size
                )
        left = [i for i in left if not _is_done(runs[i], tol, steps)]
    for i in left:
        runs[i].trouble = (
            "rounding leaves no more digits, as where stiffnesses are many powers of ten apart; "
            "take a larger tol"
        )
    return runs


def _is_done(run: Run, tol: float, steps: int) -> bool:
    """Whether there is nothing more to do, or to hope for."""
    return bool(run.trouble) or run.residual <= tol or run.rounded or len(run.history) > steps


@dataclass
class _Row:
    """One right-hand side on its way: its length, and the coefficients of its steps.

    `gain` is the square of the energy norm of what they have changed, which that of the error was
    before, but for what is left of it, and `last` that of the last step.
    """

    run: Run
    length: float
    rz: float = 0.0
    gain: float = 0.0
    last: float = 0.0
    alphas: list[float] = field(default_factory=list)
    betas: list[float] = field(default_factory=list)

    def advance(self, p: FloatArray, q: FloatArray, r: FloatArray) -> bool:
        """Take a step along p, of which q is the product; False where there is none."""
        pq = _dots(p, q)[0]
        if not (pq > 0 and self.rz > 0):
            self.run.trouble = "the matrix or its preconditioner is not positive definite"
            return False
        alpha = self.rz / pq
        self.last = alpha * self.rz
        self.gain += self.last
        self.run.energy += self.last
        kb.combine(len(p), alpha, p, 1.0, self.run.x)
        kb.combine(len(q), -alpha, q, 1.0, r)
        self.run.history.append(float(np.sqrt(_dots(r, r)[0]) / self.length))
        self.alphas.append(alpha)
        if len(self.alphas) % LOOK == 0:
            self.look()
            if self.run.condition > HOPELESS:
                self.run.trouble = "the matrix is singular to working precision"
                return False
        return True

    def is_near(self, tol: float) -> bool:
        """Whether the residual is small enough, and so is what the last step changed."""
        residual = self.run.history[-1]
        still = self.last <= tol * tol * self.run.energy
        return residual <= NEAR * tol or (residual <= tol and still)

    def turn(self, z: FloatArray, r: FloatArray, q: FloatArray, p: FloatArray) -> None:
        """Make p the next direction."""
        rz, qz = _dots(z, r, q)
        self.betas.append(-self.alphas[-1] * qz / self.rz)
        self.rz = rz
        kb.combine(len(z), 1.0, z, self.betas[-1], p)

    def look(self) -> None:
        """Update the condition number."""
        self.run.condition = max(self.run.condition, _condition(self.alphas, self.betas))


def _descend(
    rows: list[_Row], K: Operator, M: Operator, r: FloatArray, tol: float, steps: int, bar: _Bar
) -> None:
    """Go on from where runs are with residuals r (rows, n), which are overwritten."""
    p = np.ascontiguousarray(M(r))
    for row, z, one in zip(rows, p, r, strict=True):
        row.rz = _dots(one, z)[0]
    while rows:
        q = K(p)
        going = []
        for i, row in enumerate(rows):
            there = row.advance(p[i], q[i], r[i]) and not row.is_near(tol)
            if there and len(row.run.history) <= steps:
                going.append(i)
            else:
                row.look()
        bar.show(max(row.run.history[-1] for row in rows))
        if len(going) < len(rows):
            rows, p, q, r = [rows[i] for i in going], p[going], q[going], r[going]
        if rows:
            z = np.ascontiguousarray(M(r))
            for i, row in enumerate(rows):
                row.turn(z[i], r[i], q[i], p[i])


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
