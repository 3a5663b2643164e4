"""Least-squares progressive-iterative approximation: the fit by repeated correction.

Every coefficient is moved by the mean deviation of the samples under its basis function,
weighted by it: ``c += D^-1 A^T (f - A c)`` with ``D = diag(A^T 1)`` (Deng and Lin 2014; Hu and
Lin 2021 for implicit trivariate splines). A tensor grid keeps A separable.

Guarantees: the eigenvalues of ``D^-1 A^T A`` lie in [0, 1], so that it converges for any samples,
to the least-squares fit where that is unique. Non-guarantee: speed; on complete grids
`fit_least_squares` costs as much as one step. It pays off with masked samples, or stopped early.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import among, as_array
from ilattice.bspline.fit_common import Direction, as_samples, directions, to_spline
from ilattice.bspline.knots import design_matrix
from ilattice.bspline.lines import apply_all, line_operator
from ilattice.bspline.spline import BSpline
from ilattice.errors import ConvergenceError, InputError


class _Normal:
    """The weighted normal equations of a separable collocation matrix."""

    def __init__(self, dirs: Sequence[Direction], f: FloatArray, weights: FloatArray | None):
        a = [design_matrix(d.t, d.k, d.sites, periodic=d.periodic) for d in dirs]
        self.forward = [line_operator(m) for m in a]
        self.backward = [line_operator(csr_array(m.T)) for m in a]
        self.extra = (1,) * (f.ndim - len(dirs))
        shape = tuple(len(d.sites) for d in dirs)
        w = np.ones(shape) if weights is None else weights
        self.w = w.reshape(shape + self.extra)
        sums = apply_all(self.backward, w)
        self.reached = (sums > 0).reshape(sums.shape + self.extra)
        self.diagonal = np.where(sums > 0, sums, 1.0).reshape(sums.shape + self.extra)

    def gather(self, r: FloatArray) -> FloatArray:
        """A^T W r."""
        return apply_all(self.backward, self.w * r)

    def spread(self, c: FloatArray) -> FloatArray:
        """A c."""
        return apply_all(self.forward, c)

    def dot(self, a: FloatArray, b: FloatArray) -> float:
        """Sum of products, in an order that does not depend on threads."""
        return float(np.sum(a * b))


def fit_lspia(
    values: ArrayLike,
    t: Any,
    k: int | Sequence[int],
    *,
    periodic: bool | Sequence[bool] = False,
    at: Any = None,
    weights: ArrayLike | None = None,
    start: BSpline | None = None,
    iterations: int = 100,
    tol: float | None = None,
    accelerate: str | None = None,
) -> BSpline:
    """Least squares by progressive iteration.

    Parameters
    ----------
    values : array_like, shape (N0[, N1[, N2]][, m])
        Samples on the grid of sites.
    t : sequence of array_like
        One knot vector per direction; a single knot vector for a curve.
    k : int or sequence of int
        Degrees, 0 to 8.
    periodic : bool or sequence of bool
        Periodic directions.
    at : sequence of array_like, optional
        Ascending sample sites per direction, default ``sites(t, k, "lspia")``.
    weights : array_like, shape (N0[, N1[, N2]]), optional
        Non-negative weight per sample; zero masks it. Coefficients that no sample reaches
        keep their start.
    start : BSpline, optional
        Spline on the same knots to start from, default zero.
    iterations : int
        Number of steps, at most.
    tol : float, optional
        Stop when the scaled gradient ``D^-1/2 A^T (f - A c)`` has fallen below `tol` times
        its size at ``c = 0``.
    accelerate : {None, "cg"}
        Plain steps, or conjugate gradients preconditioned by D.

    Returns
    -------
    BSpline
        The last iterate.

    Raises
    ------
    InputError
        If shapes disagree, a sample is not finite, or a weight is negative.
    ConvergenceError
        If `tol` is given and not met within `iterations`.
    """
    if not among(accelerate, (None, "cg")):
        raise InputError(f"accelerate must be None or 'cg', got {accelerate!r}")
    if iterations != int(iterations) or iterations < 0:
        raise InputError(f"iterations must be a whole number of at least 0, got {iterations!r}")
    dirs = directions(t, k, periodic, "lspia", at)
    f = as_samples(values, dirs, [len(d.sites) for d in dirs])
    normal = _Normal(dirs, f, _as_weights(weights, f.shape[: len(dirs)]))
    c = _start(start, dirs, f.shape[len(dirs) :])
    step = _conjugate_gradients if accelerate else _plain
    c, ratio = step(normal, f, c, int(iterations), 0.0 if tol is None else tol)
    if tol is not None and not ratio <= tol:
        raise ConvergenceError(
            f"the scaled gradient fell to {ratio:.3g} of its start in {iterations} iterations, "
            f"tol asks for {tol:.3g}; raise iterations, or accelerate='cg'"
        )
    return to_spline(c, dirs)


def _as_weights(weights: ArrayLike | None, shape: tuple[int, ...]) -> FloatArray | None:
    if weights is None:
        return None
    w = as_array("weights", weights)
    if w.shape != shape or (w < 0).any():
        raise InputError(f"weights must be non-negative of shape {shape}, got shape {w.shape}")
    return w


def _start(start: BSpline | None, dirs: Sequence[Direction], extra: tuple[int, ...]) -> FloatArray:
    shape = tuple(d.n for d in dirs)
    if start is None:
        return np.zeros(shape + extra)
    same = len(start.t) == len(dirs) and all(
        np.array_equal(a, d.t) for a, d in zip(start.t, dirs, strict=True)
    )
    if not same or start.c.shape[len(dirs) :] != extra:
        raise InputError("start must be a spline on the same knots, with as many components")
    return np.array(start.c[tuple(slice(0, n) for n in shape)])


def _plain(
    normal: _Normal, f: FloatArray, c: FloatArray, iterations: int, tol: float
) -> tuple[FloatArray, float]:
    """Plain steps; the iterate and how far the scaled gradient has fallen."""
    b = normal.gather(f)
    size = normal.dot(b, b / normal.diagonal) or 1.0
    ratio = np.inf
    for i in range(iterations + 1):
        g = normal.gather(f - normal.spread(c))
        ratio = (normal.dot(g, g / normal.diagonal) / size) ** 0.5
        if ratio <= tol or i == iterations:
            break
        c = c + np.where(normal.reached, g / normal.diagonal, 0.0)
    return c, ratio


def _conjugate_gradients(
    normal: _Normal, f: FloatArray, c: FloatArray, iterations: int, tol: float
) -> tuple[FloatArray, float]:
    """Conjugate gradients on the normal equations, preconditioned by D."""
    b = normal.gather(f)
    size = normal.dot(b, b / normal.diagonal) or 1.0
    r = f - normal.spread(c)
    g = normal.gather(r)
    z = g / normal.diagonal
    rho = normal.dot(g, z)
    p = z
    for _ in range(iterations):
        if rho <= tol * tol * size:
            break
        q = normal.spread(p)
        alpha = rho / normal.dot(normal.w * q, q)
        c = c + alpha * p
        r = r - alpha * q
        g = normal.gather(r)
        z = g / normal.diagonal
        rho, old = normal.dot(g, z), rho
        p = z + (rho / old) * p
    return c, (rho / size) ** 0.5
