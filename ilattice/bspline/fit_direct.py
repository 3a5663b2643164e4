"""Direct separable fits of samples on a tensor grid: one pass per direction.

========================  ==========================================================  =====
`fit_least_squares`       banded normal equations, two samples per coefficient        k + 1
`fit_interpolate`         banded collocation equations, one sample per coefficient    k + 1
`fit_greville`            coefficients are samples at Greville abscissae              2
`fit_uniform_sampling`    coefficients are samples at i / (n - 1): reproduction only  0.5-1
========================  ==========================================================  =====

The last column is the order of convergence in the spacing of the knots for smooth fields.

Guarantees: least squares and interpolation reproduce every spline of the given knots; the
same bits for any number of threads. Non-guarantees: fields with kinks are approximated to
first order near them, and global fits ring there.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.sparse import csr_array, eye_array

from ilattice._typing import ArrayLike
from ilattice.bspline.fit_common import Direction, as_samples, directions, to_spline
from ilattice.bspline.knots import design_matrix
from ilattice.bspline.lines import LineOperator, apply_all, identity_operator, line_operator
from ilattice.bspline.spline import BSpline
from ilattice.errors import InputError


def fit_least_squares(
    values: ArrayLike,
    t: Any,
    k: int | Sequence[int],
    *,
    periodic: bool | Sequence[bool] = False,
    at: Any = None,
) -> BSpline:
    """Separable least squares.

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
        Ascending sample sites per direction, default ``sites(t, k, "least-squares")``.

    Returns
    -------
    BSpline
        The spline with the least sum of squared deviations at the sites.

    Raises
    ------
    InputError
        If shapes disagree, a sample is not finite, or the sites do not determine the
        coefficients.
    """
    dirs = directions(t, k, periodic, "least-squares", at)
    f = as_samples(values, dirs, [len(d.sites) for d in dirs])
    return to_spline(apply_all([least_squares_operator(d) for d in dirs], f), dirs)


def least_squares_operator(d: Direction) -> LineOperator:
    """Samples of one direction to coefficients: transpose, then banded normal equations."""
    a = design_matrix(d.t, d.k, d.sites, periodic=d.periodic)
    if len(d.sites) < d.n:
        raise InputError(
            f"at must hold at least {d.n} sites for {d.n} coefficients, got {len(d.sites)}"
        )
    transpose = csr_array(a.T)
    return line_operator(transpose, csr_array(transpose @ a))


def fit_interpolate(
    values: ArrayLike,
    t: Any,
    k: int | Sequence[int],
    *,
    periodic: bool | Sequence[bool] = False,
    at: Any = None,
) -> BSpline:
    """Interpolation of samples, one per coefficient.

    Parameters
    ----------
    values : array_like, shape (n0[, n1[, n2]][, m])
        Samples on the grid of sites.
    t : sequence of array_like
        One knot vector per direction; a single knot vector for a curve.
    k : int or sequence of int
        Degrees, 0 to 8.
    periodic : bool or sequence of bool
        Periodic directions, with ``n - k`` samples.
    at : sequence of array_like, optional
        Ascending sample sites per direction, default ``sites(t, k, "interpolate")``.

    Returns
    -------
    BSpline
        The spline through the samples.

    Raises
    ------
    InputError
        If shapes disagree, a sample is not finite, or the sites do not determine the
        coefficients (Schoenberg and Whitney: each needs its own site inside its support).
    """
    dirs = directions(t, k, periodic, "interpolate", at)
    f = as_samples(values, dirs, [len(d.sites) for d in dirs])
    return to_spline(apply_all([interpolation_operator(d) for d in dirs], f), dirs)


def interpolation_operator(d: Direction) -> LineOperator:
    """Samples of one direction to coefficients: banded collocation equations."""
    a = design_matrix(d.t, d.k, d.sites, periodic=d.periodic)
    if len(d.sites) != d.n:
        raise InputError(f"at must hold {d.n} sites, one per coefficient, got {len(d.sites)}")
    if not d.periodic:
        return identity_operator(d.n, a)
    order = _roll(a)
    return line_operator(csr_array(eye_array(d.n)).tocsr()[order], csr_array(a[order]))


def _roll(a: csr_array) -> Any:
    """Cyclic order of the rows that puts the heaviest cyclic diagonal on the main one."""
    n = a.shape[0]
    coo = a.tocoo()
    row, col = coo.coords
    shift = int(np.argmax(np.bincount((col - row) % n, weights=coo.data, minlength=n)))
    return (np.arange(n) - shift) % n


def fit_greville(
    values: ArrayLike,
    t: Any,
    k: int | Sequence[int],
    *,
    periodic: bool | Sequence[bool] = False,
) -> BSpline:
    """Schoenberg's variation-diminishing spline: coefficients are samples at Greville sites.

    Parameters
    ----------
    values : array_like, shape (n0[, n1[, n2]][, m])
        Samples at ``sites(t, k, "greville")``.
    t : sequence of array_like
        One knot vector per direction; a single knot vector for a curve.
    k : int or sequence of int
        Degrees, 0 to 8.
    periodic : bool or sequence of bool
        Periodic directions, with ``n - k`` samples.

    Returns
    -------
    BSpline
        The spline; it stays between the least and the largest sample.

    Raises
    ------
    InputError
        If shapes disagree or a sample is not finite.
    """
    dirs = directions(t, k, periodic, "greville", None)
    f = as_samples(values, dirs, [d.n for d in dirs])
    return to_spline(apply_all([greville_operator(d) for d in dirs], f), dirs)


def greville_operator(d: Direction) -> LineOperator:
    """Samples of one direction as coefficients; wrapped sites return to their order."""
    if not d.periodic:
        return identity_operator(d.n)
    order = _roll(design_matrix(d.t, d.k, d.sites, periodic=True))
    return line_operator(csr_array(eye_array(d.n)).tocsr()[order])


def fit_uniform_sampling(
    values: ArrayLike,
    t: Any,
    k: int | Sequence[int],
    *,
    periodic: bool | Sequence[bool] = False,
) -> BSpline:
    """Coefficients are samples at ``i / (n - 1)``: the literal rule, for reproduction only.

    Parameters
    ----------
    values : array_like, shape (n0[, n1[, n2]][, m])
        Samples at ``sites(t, k, "uniform-sampling")``.
    t : sequence of array_like
        One knot vector per direction; a single knot vector for a curve.
    k : int or sequence of int
        Degrees, 0 to 8.
    periodic : bool or sequence of bool
        Periodic directions, with ``n - k`` samples.

    Returns
    -------
    BSpline
        The spline. On clamped knots not even linear functions are reproduced.

    Raises
    ------
    InputError
        If shapes disagree or a sample is not finite.

    Notes
    -----
    Hong, Antolin, Elber, Kim 2025, section 3.1, read literally.
    """
    dirs = directions(t, k, periodic, "uniform-sampling", None)
    f = as_samples(values, dirs, [d.n for d in dirs])
    return to_spline(f, dirs)
