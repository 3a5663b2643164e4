"""Local quasi-interpolants of degrees 1 to 3: every coefficient from k + 1 samples nearby.

Each coefficient is the polar form, at its inner knots, of the polynomial of degree k through
k + 1 neighbouring samples (de Boor and Fix 1973; Lyche and Schumaker 1975). On equal spans the
inner rules are (-1, 10, -1)/8 for degree 2 and (-1, 8, -1)/6 for degree 3; the first
rules of degree 2 on clamped knots are (1) and (-2, 9, -1)/6.

Guarantees: polynomials of degree k are reproduced; order k + 1 for smooth fields; a sample
moves the spline only in its neighbourhood, so kinks do not ring. Non-guarantee: the spline does not
pass through the samples.
"""

from collections.abc import Sequence
from itertools import combinations
from math import comb
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice.bspline.fit_common import Direction, as_samples, directions, to_spline
from ilattice.bspline.knots import breaks, greville
from ilattice.bspline.lines import LineOperator, apply_all, line_operator
from ilattice.bspline.spline import BSpline
from ilattice.errors import InputError


def fit_quasi(
    values: ArrayLike,
    t: Any,
    k: int | Sequence[int],
    *,
    periodic: bool | Sequence[bool] = False,
) -> BSpline:
    """Local quasi-interpolant of samples at the sites of ``sites(t, k, "quasi")``.

    Parameters
    ----------
    values : array_like, shape (N0[, N1[, N2]][, m])
        Samples.
    t : sequence of array_like
        One knot vector per direction.
    k : int or sequence of int
        Degrees, 1 to 3.
    periodic : bool or sequence of bool
        Periodic directions.

    Returns
    -------
    BSpline
        The spline.

    Raises
    ------
    InputError
        If shapes disagree, a degree is not 1, 2 or 3, inner knots repeat, or a direction has fewer
        than ``k + 1`` samples.

    Notes
    -----
    Degree 2 reads samples at the span midpoints and both ends, degrees 1 and 3 at the knots.
    """
    dirs = directions(t, k, periodic, "quasi", None)
    f = as_samples(values, dirs, [len(d.sites) for d in dirs])
    return to_spline(apply_all([quasi_operator(d) for d in dirs], f), dirs)


def quasi_operator(d: Direction) -> LineOperator:
    """The stencils of one direction, as a line operator (n, N)."""
    if not 1 <= d.k <= 3:
        raise InputError(f"k must be 1, 2 or 3 for quasi-interpolation, got {d.k}")
    size = len(d.sites)
    if len(breaks(d.t, d.k)) - 1 != d.n - (0 if d.periodic else d.k):
        raise InputError("t must have simple inner knots for quasi-interpolation")
    if size < d.k + 1:
        raise InputError(f"t has too few spans: degree {d.k} needs {d.k + 1} samples, got {size}")
    centre = greville(d.t, d.k)[: d.n]
    index = _nearest_windows(d, centre)
    x = d.sites[index % size] + (index // size) * (d.t[-d.k - 1] - d.t[d.k])
    args = d.t[np.arange(d.n)[:, None] + 1 + np.arange(d.k)]
    weights = _polar_weights(x, args)
    rows = np.repeat(np.arange(d.n), d.k + 1)
    entries = (weights.ravel(), (rows, (index % size).ravel()))
    return line_operator(csr_array(entries, shape=(d.n, size)))


def _nearest_windows(d: Direction, centre: FloatArray) -> IntArray:
    """Indices (n, k+1) of the samples next to each centre; they run over the ends to wrap."""
    size = len(d.sites)
    if d.periodic:
        period = d.t[-d.k - 1] - d.t[d.k]
        x = np.concatenate([d.sites - period, d.sites, d.sites + period])
    else:
        x = d.sites
    nearest = np.argmin(np.abs(centre[:, None] - x[None, :]), axis=1)
    first = nearest - d.k // 2
    first = first - size if d.periodic else np.clip(first, 0, size - d.k - 1)
    return first[:, None] + np.arange(d.k + 1)


def _polar_weights(x: FloatArray, args: FloatArray) -> FloatArray:
    """Weights (n, k+1) on samples at x (n, k+1) that give the polar form at args (n, k)."""
    k = args.shape[1]
    origin = x.mean(axis=1, keepdims=True)
    scale = np.ptp(x, axis=1)[:, None]
    y, u = (x - origin) / scale, (args - origin) / scale
    polar = np.stack([_polar_power(u, r) for r in range(k + 1)], axis=1)
    powers = y[:, None, :] ** np.arange(k + 1)[None, :, None]
    return np.linalg.solve(powers, polar[..., None])[..., 0]


def _polar_power(u: FloatArray, r: int) -> FloatArray:
    """Polar form of x**r, as a polynomial of degree k, at u (n, k)."""
    k = u.shape[1]
    terms = [u[:, list(s)].prod(axis=1) for s in combinations(range(k), r)]
    return np.sum(terms, axis=0) / comb(k, r)
