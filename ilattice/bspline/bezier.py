"""Bézier elements of a spline, and rigorous bounds from their coefficients.

Guarantees: a polynomial lies between its extreme Bernstein coefficients, so `BezierCells.ranges`
and `range_on_boxes` contain every value, up to rounding, for which `range_on_boxes` widens its
bounds by some 10 units in the last place of the largest coefficient nearby, per degree.
Non-guarantee: tightness; bounds on a box of size h exceed the true range by O(h^2).
"""

from dataclasses import dataclass
from math import comb
from typing import Protocol

import numpy as np

from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice._validate import as_array, as_points, read_only
from ilattice.bspline import _kernels_bezier
from ilattice.bspline.knots import bezier_matrix, breaks
from ilattice.bspline.lines import apply_all, frozen, line_operator
from ilattice.errors import InputError


class _SplineLike(Protocol):
    """What a tensor-product spline tells of itself, as `BSpline` does."""

    t: tuple[FloatArray, ...]
    c: FloatArray
    k: tuple[int, ...]
    weights: FloatArray | None
    periodic: tuple[bool, ...]

    @property
    def ndim(self) -> int: ...
    @property
    def m(self) -> int: ...
    @property
    def shape(self) -> tuple[int, ...]: ...
    @property
    def domain(self) -> FloatArray: ...


@dataclass(frozen=True)
class BezierCells:
    """Bézier elements of a tensor-product spline, one per box of knot spans.

    Attributes
    ----------
    breaks : tuple of ndarray, shape (e_i + 1,)
        Element boundaries per parameter.
    coefficients : ndarray, shape (e0[, e1[, e2]], k0 + 1[, k1 + 1[, k2 + 1]][, m])
        Bernstein coefficients per element; Cartesian if rational.
    weights : ndarray, shape (e0[, e1[, e2]], k0 + 1[, k1 + 1[, k2 + 1]]), or None
        Positive weights of rational elements.
    """

    breaks: tuple[FloatArray, ...]
    coefficients: FloatArray
    weights: FloatArray | None = None

    @property
    def ndim(self) -> int:
        """Number of parameters."""
        return len(self.breaks)

    @property
    def k(self) -> tuple[int, ...]:
        """Degrees."""
        return tuple(s - 1 for s in self.coefficients.shape[self.ndim : 2 * self.ndim])

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of elements per parameter."""
        return self.coefficients.shape[: self.ndim]

    def ranges(self) -> FloatArray:
        """Least and largest coefficient of each element, (e0[, e1[, e2]][, m], 2)."""
        inner = tuple(range(self.ndim, 2 * self.ndim))
        ends = [self.coefficients.min(axis=inner), self.coefficients.max(axis=inner)]
        return np.stack(ends, axis=-1)


def bernstein(degree: int, t: ArrayLike) -> FloatArray:
    """Bernstein polynomials.

    Parameters
    ----------
    degree : int
        Their degree.
    t : array_like, shape (n,)
        Points of [0, 1].

    Returns
    -------
    ndarray, shape (n, degree + 1)
        Values of all of them at each point.
    """
    t, i = np.asarray(t, np.float64)[:, None], np.arange(degree + 1)
    out: FloatArray = np.array([comb(degree, k) for k in i]) * t**i * (1.0 - t) ** (degree - i)
    return out


def to_bezier(spline: _SplineLike) -> BezierCells:
    """Bézier elements of a spline.

    Parameters
    ----------
    spline : BSpline
        With one to three parameters, scalar or vector, rational or not.

    Returns
    -------
    BezierCells
        One element per box of nonempty knot spans of the domain.
    """
    operators = [
        line_operator(bezier_matrix(t, k)) for t, k in zip(spline.t, spline.k, strict=True)
    ]
    nd = spline.ndim
    edges = tuple(read_only(breaks(t, k)) for t, k in zip(spline.t, spline.k, strict=True))

    def extract(c: FloatArray) -> FloatArray:
        c = apply_all(operators, c)
        split = [v for e, k in zip(edges, spline.k, strict=True) for v in (len(e) - 1, k + 1)]
        order = [*range(0, 2 * nd, 2), *range(1, 2 * nd, 2), *range(2 * nd, nd + c.ndim)]
        return np.ascontiguousarray(c.reshape(*split, *c.shape[nd:]).transpose(order))

    if spline.weights is None:
        return BezierCells(edges, read_only(extract(spline.c)))
    w = extract(spline.weights)
    spread = (..., None) if spline.m else ()
    c = extract(spline.c * spline.weights[spread]) / w[spread]
    return BezierCells(edges, read_only(c), read_only(w))


def range_on_boxes(
    spline: _SplineLike,
    lo: ArrayLike,
    hi: ArrayLike,
    *,
    tight: bool = True,
    level: float | None = None,
) -> FloatArray:
    """Rigorous bounds of a scalar spline on boxes.

    Parameters
    ----------
    spline : BSpline
        Scalar, with one to three parameters.
    lo, hi : array_like, shape (m, ndim)
        Corners of the boxes, ``lo <= hi``. They are clipped to the domain (as evaluation with
        ``extrapolate="clamp"``); in periodic directions they wrap.
    tight : bool
        Whether each Bézier element is restricted to the box. Otherwise the extremes of the
        coefficients are returned: several times faster, and wider.
    level : float, optional
        A value of interest, 0 for a level set: boxes whose coefficients already exclude it keep
        those bounds.

    Returns
    -------
    ndarray, shape (m, 2)
        Lower and upper bounds.

    Raises
    ------
    InputError
        If the spline is not scalar, or a box is upside down.
    """
    if spline.m:
        raise InputError(f"spline must be scalar, got one with {spline.m} components")
    lo, hi = _as_boxes(lo, hi, spline.ndim)
    a, b, owner = _in_domain(spline, lo, hi)
    out = np.empty((len(a), 2))
    c = spline.c.reshape(spline.shape + (1,) * (3 - spline.ndim))
    w = c if spline.weights is None else spline.weights.reshape(c.shape)
    num = c if spline.weights is None else c * w
    missing = 3 - spline.ndim
    t0, t1, t2 = (frozen(v) for v in (*spline.t, *[np.array([0.0, 1.0])] * missing))
    k = np.array(spline.k + (0,) * missing, np.int64)
    pad = 16 * (3 + int(k.sum())) * np.finfo(float).eps
    bounded = _kernels_bezier.Spline(
        t0, t1, t2, k, frozen(c), frozen(num), frozen(w), spline.weights is not None
    )
    _kernels_bezier.ranges(
        len(a), bounded, a, b,
        bool(tight), level is not None, 0.0 if level is None else float(level), pad, out,
    )  # fmt: skip
    if owner is None:
        return out
    result = np.stack([np.full(len(lo), np.inf), np.full(len(lo), -np.inf)], axis=1)
    np.minimum.at(result[:, 0], owner, out[:, 0])
    np.maximum.at(result[:, 1], owner, out[:, 1])
    return result


def _as_boxes(lo: ArrayLike, hi: ArrayLike, nd: int) -> tuple[FloatArray, FloatArray]:
    """Corners as points; plain arrays of numbers are intervals of a curve."""
    corners = []
    for name, value in (("lo", lo), ("hi", hi)):
        a = as_array(name, value)
        corners.append(as_points(name, a[:, None] if nd == 1 and a.ndim == 1 else a, nd))
    a, b = corners
    if a.shape != b.shape:
        raise InputError(f"lo and hi must have the same shape, got {a.shape} and {b.shape}")
    if (a > b).any():
        i = int(np.argmax((a > b).any(axis=1)))
        raise InputError(f"lo must not exceed hi: box {i} is {a[i]} to {b[i]}")
    return a, b


def _in_domain(
    spline: _SplineLike, lo: FloatArray, hi: FloatArray
) -> tuple[FloatArray, FloatArray, IntArray | None]:
    """Boxes (m', 3) inside the domain; if some were cut at a seam, which box each belongs to."""
    pieces = [(lo, hi, np.arange(len(lo)))]
    for axis in range(spline.ndim):
        start, end = spline.domain[:, axis]
        if spline.periodic[axis]:
            pieces = [p for piece in pieces for p in _wrapped(*piece, axis, start, end)]
    cut = len(pieces) > 1
    lo, hi, owner = (np.concatenate(v) for v in zip(*pieces, strict=True))
    missing = ((0, 0), (0, 3 - spline.ndim))
    a, b = (np.clip(v, *spline.domain) for v in (lo, hi))
    a, b = np.pad(a, missing, constant_values=0.5), np.pad(b, missing, constant_values=0.5)
    return np.ascontiguousarray(a), np.ascontiguousarray(b), owner if cut else None


def _wrapped(
    lo: FloatArray, hi: FloatArray, owner: IntArray, axis: int, start: float, end: float
) -> list[tuple[FloatArray, FloatArray, IntArray]]:
    """Boxes moved by whole periods along an axis, cut in two at the seam."""
    period = end - start
    low, high = lo[:, axis], hi[:, axis]
    shift = np.floor((low - start) / period) * period
    over = high - shift > end
    exact = (shift == 0) & ~over if start == 0 else False  # wrapping a site is free of rounding
    rounding = 4 * np.finfo(float).eps * (np.abs(low) + np.abs(high) + abs(start) + abs(end))
    slack = np.where(exact, 0.0, rounding)
    whole = high - low >= period
    a, b = lo.copy(), hi.copy()
    a[:, axis] = np.where(whole, start, np.maximum(low - shift - slack, start))
    b[:, axis] = np.where(whole, end, np.minimum(high - shift + slack, end))
    if not over.any():
        return [(a, b, owner)]
    a2, b2 = a[over], b[over]
    a2[:, axis] = start
    b2[:, axis] = np.minimum((high - shift + slack)[over] - period, end)
    return [(a, b, owner), (a2, b2, owner[over])]
