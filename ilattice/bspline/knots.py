"""Knot vectors of one direction: sites, spans, and the sparse matrices that change a basis.

Everything here follows from one device, the polar form (blossom): on a knot span the
coefficient of any B-spline or Bernstein basis of degree k is the polynomial's polar form at
the k inner knots of that basis function (Ramshaw 1987; Lyche and Mørken, "Spline Methods",
ch. 4). `_polar_rows` writes such values as rows that act on the k + 1 coefficients of the
span; collocation, knot insertion, degree elevation and Bézier extraction are choices of its
arguments.

Periodic directions follow the convention of `BSpline`: n = S + k stored coefficients for S
knot intervals per period, the last k repeat the first, the domain is ``[t[k], t[n]]``.

Guarantees: matrices reproduce the same spline to rounding; rows of knots that do not change
are exact unit rows. Non-guarantee: knots that differ by rounding only count as different.
"""

from typing import Any

import numpy as np
from scipy.sparse import csr_array

from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray
from ilattice._validate import as_array, as_knots
from ilattice.errors import InputError

#: Highest degree.
MAX_DEGREE = 8


def as_degree(name: str, k: Any) -> int:
    """Degree 0 to 8, or `InputError`."""
    number = isinstance(k, (int, float, np.number)) and not isinstance(k, bool)
    if not number or not 0 <= k <= MAX_DEGREE or k != int(k):
        raise InputError(f"{name} must be a whole degree from 0 to {MAX_DEGREE}, got {k!r}")
    return int(k)


def as_knot_vector(name: str, t: ArrayLike, k: int, *, periodic: bool = False) -> FloatArray:
    """Checked knot vector of degree k: length at least 2k + 2, non-decreasing, repeats <= k + 1.

    Raises
    ------
    InputError
        If a knot decreases or repeats more than ``k + 1`` times, the domain is empty, or a
        periodic knot vector does not repeat.
    """
    a = as_array(name, t, ndim=1)
    n = len(a) - k - 1
    if n < k + 1:
        raise InputError(f"{name} must hold at least 2k + 2 = {2 * k + 2} knots, got {len(a)}")
    a = as_knots(name, a, n, k)
    values, counts = np.unique(a, return_counts=True)
    if counts.max() > k + 1:
        i = int(np.argmax(counts))
        raise InputError(
            f"{name} repeats the knot {values[i]} {counts[i]} times; degree {k} allows {k + 1}"
        )
    if periodic:
        _check_periodic(name, a, k)
    return a


def _check_periodic(name: str, t: FloatArray, k: int) -> None:
    n = len(t) - k - 1
    period = t[n] - t[k]
    gap = np.abs(t[n - k :] - t[: 2 * k + 1] - period).max()
    if gap > 1e-9 * period:
        raise InputError(
            f"{name} is not periodic: t[n - k + i] - t[i] must be the period {period:g}, "
            f"it is off by {gap:g}"
        )


def uniform_knots(
    n_spans: int, k: int, domain: ArrayLike = (0.0, 1.0), periodic: bool = False
) -> FloatArray:
    """Knot vector with equal spans: clamped, or periodic.

    Parameters
    ----------
    n_spans : int
        Number of spans in the domain.
    k : int
        Degree, 0 to 8.
    domain : array_like, shape (2,)
        Ends of the domain.
    periodic : bool
        Whether the k knots outside each end continue the spacing instead of repeating the
        end.

    Returns
    -------
    ndarray, shape (n_spans + 2k + 1,)
        Knots, for ``n_spans + k`` coefficients.

    Raises
    ------
    InputError
        If there is no span, or the domain is empty.
    """
    k = as_degree("k", k)
    a, b = as_array("domain", domain, ndim=1)
    if n_spans != int(n_spans) or n_spans < 1:
        raise InputError(f"n_spans must be a whole number of at least 1, got {n_spans!r}")
    if not a < b:
        raise InputError(f"domain must be an interval, got [{a}, {b}]")
    n_spans = int(n_spans)
    inner = np.linspace(a, b, n_spans + 1)
    if not periodic:
        return np.concatenate([np.full(k, a), inner, np.full(k, b)])
    return wrapped_knots(inner[:-1], k, float(b))


def wrapped_knots(base: FloatArray, k: int, end: float) -> FloatArray:
    """Periodic knot vector (S + 2k + 1,) from the S knots of one period ``[base[0], end]``."""
    j = np.arange(-k, len(base) + k + 1)
    t = base[j % len(base)] + (j // len(base)) * (end - base[0])
    t[t == base[0] + (end - base[0])] = end  # sums may miss both ends by rounding
    t[t == end - (end - base[0])] = base[0]
    return t


def greville(t: ArrayLike, k: int) -> FloatArray:
    """Greville abscissae, shape (n,): each the mean of k consecutive inner knots.

    A coefficient at its Greville abscissa reproduces linear functions. For ``k = 0`` they
    are the midpoints of the spans.
    """
    k = as_degree("k", k)
    t = as_array("t", t, ndim=1)
    if k == 0:
        return 0.5 * (t[1:] + t[:-1])
    windows = np.lib.stride_tricks.sliding_window_view(t[1:-1], k)
    return np.clip(windows.mean(axis=1), windows[:, 0], windows[:, -1])


def breaks(t: ArrayLike, k: int) -> FloatArray:
    """Distinct knots inside the domain, ends included, shape (spans + 1,)."""
    t = as_array("t", t, ndim=1)
    return np.unique(t[k : len(t) - k])


def with_planes(planes: FloatArray, more: FloatArray) -> FloatArray:
    """Increasing planes and those of `more` between them that do not all but coincide with one."""
    inner = more[(more > planes[0]) & (more < planes[-1])]
    gap = 1e-10 * (planes[-1] - planes[0])
    far = np.abs(inner[:, None] - planes).min(axis=1, initial=np.inf) > gap
    return np.sort(np.concatenate([planes, inner[far]]))


def find_spans(t: ArrayLike, k: int, x: ArrayLike) -> IntArray:
    """Knot spans that hold sites: l with ``t[l] <= x < t[l + 1]``, shape (len(x),).

    The right end belongs to the last span; sites outside belong to the nearest end span.
    """
    t = as_array("t", t, ndim=1)
    n = len(t) - k - 1
    first = np.searchsorted(t, t[k], side="right") - 1
    last = np.searchsorted(t, t[n], side="left") - 1
    spans = np.searchsorted(t, np.asarray(x, np.float64), side="right") - 1
    return np.clip(spans, first, last).astype(np.int64)


def wrap(x: FloatArray, t: FloatArray, k: int) -> FloatArray:
    """Sites moved into the domain ``[t[k], t[n]]`` by whole periods."""
    a, b = t[k], t[len(t) - k - 1]
    return a + np.mod(x - a, b - a)


def _polar_rows(
    t: FloatArray, k: int, spans: IntArray, args: FloatArray, nu: int = 0
) -> FloatArray:
    """Polar forms as rows (N, k+1) on the coefficients ``c[l-k..l]`` of N spans l.

    `args` (N, k - nu) are the arguments; the remaining `nu` ones are differentiated, which
    gives the nu-th derivative where the arguments are equal.
    """
    row = np.ones((len(spans), 1))
    for r in range(1, k + 1):
        j = np.arange(r)
        left = t[spans[:, None] + 1 - r + j]
        right = t[spans[:, None] + 1 + j]
        out = np.zeros((len(spans), r + 1))
        gap = right - left
        if r <= k - nu:
            x = args[:, r - 1 : r]
            out[:, :r] = row * ((right - x) / gap)  # exactly 0 or 1 at the knots
            out[:, 1:] += row * ((x - left) / gap)
        else:
            out[:, :r] = -r * row / gap
            out[:, 1:] += r * row / gap
        row = out
    return row


def _rows_to_csr(rows: FloatArray, spans: IntArray, k: int, n: int, period: int = 0) -> csr_array:
    """Sparse (N, n) matrix of rows on ``c[l-k..l]``; columns modulo `period` if given."""
    cols = spans[:, None] - k + np.arange(k + 1)
    if period:
        cols, n = cols % period, period
    indptr = np.arange(len(rows) + 1) * (k + 1)
    out = csr_array((rows.ravel(), cols.ravel(), indptr), shape=(len(rows), n))
    out.sum_duplicates()
    out.eliminate_zeros()
    return out


def design_matrix(
    t: ArrayLike,
    k: int,
    x: ArrayLike,
    nu: int = 0,
    extrapolate: bool = False,
    *,
    periodic: bool = False,
) -> csr_array:
    """Collocation matrix: basis functions, or their derivatives, at sites.

    Parameters
    ----------
    t : array_like, shape (n + k + 1,)
        Knots.
    k : int
        Degree, 0 to 8.
    x : array_like, shape (N,)
        Sites.
    nu : int
        Order of the derivative.
    extrapolate : bool
        Whether sites outside the domain take the end polynomials instead of being refused.
    periodic : bool
        Whether sites wrap and the columns of wrapped copies are added to those they repeat;
        the matrix then has ``n - k`` columns.

    Returns
    -------
    scipy.sparse.csr_array, shape (N, n) or (N, n - k)
        Rows with at most ``k + 1`` entries.

    Raises
    ------
    InputError
        If a site is outside the domain and neither `extrapolate` nor `periodic` is set.
    """
    k = as_degree("k", k)
    t = as_knot_vector("t", t, k, periodic=periodic)
    x = as_array("x", x, ndim=1)
    n = len(t) - k - 1
    if nu != int(nu) or nu < 0:
        raise InputError(f"nu must be a whole number of at least 0, got {nu!r}")
    if periodic:
        x = wrap(x, t, k)
    elif not extrapolate and len(x) and (x.min() < t[k] or x.max() > t[n]):
        i = int(np.argmax((x < t[k]) | (x > t[n])))
        raise InputError(f"x[{i}] = {x[i]} is outside the domain [{t[k]}, {t[n]}]")
    spans = find_spans(t, k, x)
    if nu > k:
        return csr_array((len(x), n - k if periodic else n))
    rows = _polar_rows(t, k, spans, np.repeat(x[:, None], k - nu, axis=1), int(nu))
    return _rows_to_csr(rows, spans, k, n, n - k if periodic else 0)


def _change_matrix(t: FloatArray, k: int, t2: FloatArray, k2: int, periodic: bool) -> csr_array:
    """Matrix (n2, n) that writes the spline (t, k) in the finer basis (t2, k2), k2 in {k, k+1}.

    Every new coefficient is a polar form on a knot span near the middle of its support, with
    the arguments ordered by their distance from the span.
    """
    n, n2 = len(t) - k - 1, len(t2) - k2 - 1
    i = np.arange(n2)
    home = _nearest_span(t2, k2, i + 0.5 * k2)
    if periodic:  # wrapped copies share one row: that of the copy whose span is more central
        first = i % (n2 - k2)
        off = np.abs(home - i - 0.5 * k2)
        second = np.minimum(first + n2 - k2, n2 - 1)
        wrapped = (first + n2 - k2 < n2) & (off[second] < off[first])
        i = np.where(wrapped, second, first)
        home = home[i]
    spans = find_spans(t, k, 0.5 * (t2[home] + t2[home + 1]))
    args = t2[i[:, None] + 1 + np.arange(k2)]
    distance = np.maximum(t2[home, None] - args, args - t2[home + 1, None])
    args = np.take_along_axis(args, np.argsort(distance, axis=1, kind="stable"), axis=1)
    if k2 == k:
        rows = _polar_rows(t, k, spans, args)
    else:  # the polar form of degree k + 1 is the mean over the argument left out
        kept = [np.delete(args, j, axis=1) for j in range(k2)]
        rows = np.mean([_polar_rows(t, k, spans, a) for a in kept], axis=0)
    return _rows_to_csr(rows, spans, k, n)


def _nearest_span(t: FloatArray, k: int, start: AnyArray) -> IntArray:
    """Nonempty span of the domain nearest to each fractional index."""
    n = len(t) - k - 1
    full = k + np.flatnonzero(np.diff(t[k : n + 1]) > 0)
    upper = np.minimum(np.searchsorted(full, start), len(full) - 1)
    lower = np.maximum(upper - 1, 0)
    nearer = np.abs(full[lower] - start) < np.abs(full[upper] - start)
    return np.where(nearer, full[lower], full[upper]).astype(np.int64)


def insertion_matrix(
    t: ArrayLike, k: int, new_knots: ArrayLike, *, periodic: bool = False
) -> tuple[FloatArray, csr_array]:
    """Knot insertion: finer knots, and the matrix to its coefficients.

    Parameters
    ----------
    t : array_like, shape (n + k + 1,)
        Knots.
    k : int
        Degree, 0 to 8.
    new_knots : array_like, shape (q,)
        Knots inside the domain, in any order; repeat a knot to insert it more than once.
    periodic : bool
        Whether the finer knots stay periodic (a new knot at either end is a knot at the
        seam). Otherwise a knot vector that is not clamped stays as it is outside the domain.

    Returns
    -------
    t2 : ndarray, shape (n + q + k + 1,)
        Finer knots.
    matrix : scipy.sparse.csr_array, shape (n + q, n)
        New coefficients are ``matrix @ c``, wrapped copies included.

    Raises
    ------
    InputError
        If a new knot is outside the domain, or would be repeated more than ``k + 1`` times.

    Notes
    -----
    Row i is the polar form at the new inner knots ``t2[i+1], ..., t2[i+k]`` (Oslo algorithm:
    Cohen, Lyche, Riesenfeld 1980).
    """
    k = as_degree("k", k)
    t = as_knot_vector("t", t, k, periodic=periodic)
    new = as_array("new_knots", new_knots, ndim=1)
    n = len(t) - k - 1
    if len(new) and (new.min() < t[k] or new.max() > t[n]):
        i = int(np.argmax((new < t[k]) | (new > t[n])))
        raise InputError(f"new_knots[{i}] = {new[i]} is outside the domain [{t[k]}, {t[n]}]")
    if periodic:
        base = np.sort(_seam_to_start(np.concatenate([t[k:n], new]), t[k], t[n]))
        t2 = wrapped_knots(base, k, t[n])
    else:
        t2 = np.sort(np.concatenate([t, new]))
    t2 = as_knot_vector("new_knots (with the present knots)", t2, k)
    return t2, _change_matrix(t, k, t2, k, periodic)


def _seam_to_start(x: FloatArray, a: float, b: float) -> FloatArray:
    return np.where(x == b, a, x)


def elevation_matrix(
    t: ArrayLike, k: int, times: int = 1, *, periodic: bool = False
) -> tuple[FloatArray, int, csr_array]:
    """Degree elevation: knots and degree that hold the same spline, and the matrix.

    Parameters
    ----------
    t : array_like, shape (n + k + 1,)
        Knots.
    k : int
        Degree; ``k + times`` may not exceed 8.
    times : int
        How often the degree is raised by one.
    periodic : bool
        Whether the new knots stay periodic.

    Returns
    -------
    t2 : ndarray, shape (n2 + k2 + 1,)
        Knots; every distinct knot in the domain has `times` more copies.
    k2 : int
        The degree ``k + times``.
    matrix : scipy.sparse.csr_array, shape (n2, n)
        New coefficients are ``matrix @ c``, wrapped copies included.

    Raises
    ------
    InputError
        If the degree would exceed 8 or `times` is negative.
    """
    k = as_degree("k", k)
    t = as_knot_vector("t", t, k, periodic=periodic)
    if times != int(times) or times < 0 or k + times > MAX_DEGREE:
        raise InputError(f"times must be a whole number from 0 to {MAX_DEGREE - k}, got {times!r}")
    matrix = csr_array(np.eye(len(t) - k - 1))
    for _ in range(int(times)):
        t2 = _raised_knots(t, k, periodic)
        matrix = csr_array(_change_matrix(t, k, t2, k + 1, periodic) @ matrix)
        t, k = t2, k + 1
    return t, k, matrix


def _raised_knots(t: FloatArray, k: int, periodic: bool) -> FloatArray:
    """Knots of degree k + 1: one more copy of each distinct knot, trimmed to the domain."""
    n = len(t) - k - 1
    a, b = t[k], t[n]
    if periodic:
        base = _seam_to_start(t[k:n], a, b)
        return wrapped_knots(np.sort(np.concatenate([base, np.unique(base)])), k + 1, b)
    t2 = np.sort(np.concatenate([t, np.unique(t)]))
    first = np.searchsorted(t2, a, side="right") - (k + 2)
    last = np.searchsorted(t2, b, side="left") + (k + 2)
    return t2[first:last]


def bezier_rows(t: FloatArray, k: int) -> tuple[IntArray, FloatArray]:
    """Span and row of every Bernstein coefficient, (spans (k+1),) and (spans (k+1), k+1)."""
    full = k + np.flatnonzero(np.diff(t[k : len(t) - k]) > 0)
    spans = np.repeat(full, k + 1)
    j = np.tile(np.arange(k + 1), len(full))[:, None]
    right = np.arange(k)[None, :] >= k - j  # coefficient j: k - j times left end, j times right
    args = np.where(right, t[spans + 1, None], t[spans, None])
    return spans.astype(np.int64), _polar_rows(t, k, spans, args)


def bezier_matrix(t: FloatArray, k: int) -> csr_array:
    """All extraction operators as one sparse matrix, shape (spans (k+1), n)."""
    spans, rows = bezier_rows(t, k)
    return _rows_to_csr(rows, spans, k, len(t) - k - 1)
