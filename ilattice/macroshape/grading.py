"""Graded cell size: a volume whose directions are run through at another pace.

Guarantees: the shape of the volume stays the same; the composed map is refined until its deviation
is at most `tol` of the size of the volume, over the whole volume, at dense sites of the graded
direction; closed directions stay closed; a pace that is not monotone, and a map that folds, are
refused. Non-guarantee: the deviation between those sites.
"""

from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator, PPoly
from scipy.optimize import brentq
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice._validate import as_array, as_positive
from ilattice.bspline import BSpline
from ilattice.bspline.fit_common import sites
from ilattice.bspline.knots import design_matrix
from ilattice.errors import ConvergenceError, InputError
from ilattice.macroshape.certify import check_map
from ilattice.macroshape.maps import SplineMap

__all__ = ["regrade"]

#: Least degree of the new direction where the old one is not linear, how often its spans are
#: halved, and sites per span at which it is checked.
DEGREE, HALVINGS, CHECKS = 5, 5, 7
#: Least slope of the twice differentiable pace, relative to that in the shortest cell.
MIN_SLOPE = 0.2


def regrade(
    volume: SplineMap,
    *,
    u: ArrayLike | None = None,
    v: ArrayLike | None = None,
    w: ArrayLike | None = None,
    tol: float = 1e-9,
) -> SplineMap:
    """The same volume with cells of given sizes.

    Parameters
    ----------
    volume : SplineMap
        The volume; extra coordinates are carried along.
    u, v, w : array_like, optional
        Ends of the cells along a direction, in parameters of `volume`: n + 1 ascending numbers
        for n tiles, from the lower to the upper end of the domain. The new volume has them at
        equal distances, so that with n tiles in ``repeat`` each is a face of tiles.
    tol : float
        Largest deviation from the exact composition, relative to the diagonal of the volume, and
        for extra coordinates to their largest value.

    Returns
    -------
    SplineMap
        The volume on the same domain. A graded direction has degree 3 where it had degree 1,
        and at least 5 otherwise.

    Raises
    ------
    InputError
        If `volume` is no volume, or ends do not ascend or do not span the domain.
    ConvergenceError
        If `tol` is not met.
    GeometryError
        If the volume is folded.

    Notes
    -----
    The pace is the cubic spline through the ends, which is C2, unless that is not monotone or
    nearly not; then it is the monotone cubic of Fritsch and Carlson (1980), which is C1. The
    composition is piecewise polynomial of three times the degree. Its joints become knots, with
    the multiplicities that its smoothness there asks for.

    Examples
    --------
    >>> import ilattice as il
    >>> bar = il.macroshape.regrade(il.macroshape.box((4, 1, 1)), u=[0, 0.1, 0.3, 0.6, 1])
    >>> bar.x([[0.25, 0, 0], [0.75, 0, 0]])[:, 0].round(9)
    array([0.4, 2.4])
    """
    if not isinstance(volume, SplineMap):
        raise InputError(
            f"volume must be a SplineMap, got {volume!r:.80}; il.macroshape makes or loads one"
        )
    tol = as_positive("tol", tol)
    check_map(volume, name="volume")
    spline = volume.spline
    for axis, ends in enumerate((u, v, w)):
        if ends is not None:
            closed = volume.closed[axis]
            pace, smooth = _pace("uvw"[axis], ends, spline.domain[:, axis], closed)
            spline = _Composition(spline, axis, pace, smooth).fitted(tol, closed)
    out = SplineMap(spline, names=volume.names)
    check_map(out, name="the graded volume")
    return out


def _pace(name: str, ends: ArrayLike, domain: FloatArray, closed: bool) -> tuple[PPoly, int]:
    """Monotone function that takes equal distances to the given ends; how smooth it is."""
    y, (lo, hi) = as_array(name, ends, ndim=1), domain
    if len(y) < 2 or (np.diff(y) <= 0).any():
        raise InputError(f"{name} must hold at least two ascending numbers, got {ends!r:.80}")
    if np.abs(y[[0, -1]] - domain).max() > 1e-9 * (hi - lo):
        raise InputError(
            f"{name} must run from {lo:g} to {hi:g}, the ends of the domain, "
            f"got {y[0]:g} to {y[-1]:g}"
        )
    y = np.concatenate([[lo], y[1:-1], [hi]])
    s = np.linspace(lo, hi, len(y))
    pace = _twice(s, y, closed)
    if _least_slope(pace) >= MIN_SLOPE * np.diff(y).min() / (s[1] - s[0]):
        return pace, 2
    return _once(s, y, closed), 1


def _twice(s: FloatArray, y: FloatArray, closed: bool) -> PPoly:
    """Cubic spline through points, which need not be monotone; periodic up to its drift."""
    if not closed:
        return CubicSpline(s, y)
    periodic = y - s
    periodic[-1] = periodic[0]
    c = CubicSpline(s, periodic, bc_type="periodic").c.copy()
    c[2] += 1.0
    c[3] += s[:-1]
    return PPoly(c, s)


def _once(s: FloatArray, y: FloatArray, closed: bool) -> PPoly:
    """Monotone cubic through points; for a closed direction, the middle one of three periods."""
    if not closed:
        return PchipInterpolator(s, y)
    n, period = len(s) - 1, s[-1] - s[0]
    x, z = (np.concatenate([a[:-1] - period, a, a[1:] + period]) for a in (s, y))
    return PPoly(PchipInterpolator(x, z).c[:, n : 2 * n], s)


def _least_slope(pace: PPoly) -> float:
    """Least derivative: at the breaks, or where the second derivative vanishes in between."""
    slope = pace.derivative()
    inner = slope.derivative().roots(extrapolate=False)
    return float(slope(np.concatenate([pace.x, inner[np.isfinite(inner)]])).min())


class _Composition:
    """A spline run through at some pace along one axis.

    The spline is a sum of its basis functions of that axis; these are composed and fitted.
    """

    def __init__(self, spline: BSpline, axis: int, pace: PPoly, smooth: int) -> None:
        self.spline, self.axis, self.pace = spline, axis, pace
        self.k = spline.k[axis]
        self.degree = 3 if self.k == 1 else max(self.k, DEGREE)
        self.domain = spline.domain[:, axis]
        wrapped = self.k if spline.periodic[axis] else 0
        w = None if spline.weights is None else spline.weights[..., None]
        c = spline.c if w is None else np.concatenate([spline.c * w, w], axis=-1)
        self.c = c.take(np.arange(spline.shape[axis] - wrapped), axis)
        self.breaks, self.repeats = self._joints(smooth)

    def _joints(self, smooth: int) -> tuple[FloatArray, IntArray]:
        """Breaks of the composition, and the multiplicities of the inner ones."""
        lo, hi = self.domain
        found = dict.fromkeys(self.pace.x[1:-1].tolist(), self.degree - smooth)
        for knot, count in zip(
            *np.unique(self.spline.t[self.axis], return_counts=True), strict=True
        ):
            if lo < knot < hi:
                x = brentq(
                    lambda s, y=knot: float(self.pace(s)) - y, lo, hi, xtol=1e-15 * (hi - lo)
                )
                near = [b for b in found if abs(b - x) <= 1e-9 * (hi - lo)]
                place = near[0] if near else x
                found[place] = max(found.get(place, 0), self.degree - self.k + int(count))
        places = sorted(found)
        return np.array([lo, *places, hi]), np.array([found[b] for b in places], np.int64)

    def _knots(self, parts: int) -> FloatArray:
        """Clamped knots, with every piece cut into so many spans."""
        a, b, q = self.breaks[:-1, None], self.breaks[1:, None], self.degree
        inner = (a + (b - a) * (np.arange(1, parts) / parts)).ravel()
        lo, hi = self.domain
        return np.sort(
            np.concatenate(
                [[lo] * (q + 1), np.repeat(self.breaks[1:-1], self.repeats), inner, [hi] * (q + 1)]
            )
        )

    def _basis(self, s: FloatArray) -> Any:
        """The composed basis functions at sites, a sparse matrix."""
        t, wraps = self.spline.t[self.axis], self.spline.periodic[self.axis]
        return design_matrix(t, self.k, np.clip(self.pace(s), *self.domain), periodic=wraps)

    def fitted(self, tol: float, closed: bool) -> BSpline:
        """The composition as a spline, its pieces halved until it is right to `tol`."""
        for level in range(HALVINGS + 1):
            t = self._knots(2**level)
            at = sites(t, self.degree, "interpolate")
            matrix = splu(csc_array(design_matrix(t, self.degree, at))).solve(
                self._basis(at).toarray()
            )
            error = self._deviation(t, matrix)
            if error <= tol:
                return self._spline(t, matrix, closed)
        raise ConvergenceError(
            f"the direction {'uvw'[self.axis]}, graded, deviates by {error:.3g} of the size with "
            f"{len(matrix)} coefficients, tol asks for {tol:g}; raise tol or grade less steeply"
        )

    def _deviation(self, t: FloatArray, matrix: FloatArray) -> float:
        """Largest deviation over the volume at dense sites: a bound, by the convex hull."""
        x = np.unique(t)
        s = (x[:-1, None] + np.diff(x)[:, None] * (np.arange(1, CHECKS + 1) / (CHECKS + 1))).ravel()
        off = design_matrix(t, self.degree, s) @ matrix - self._basis(s).toarray()
        error = np.abs(np.tensordot(off, self.c, axes=(1, self.axis))).max(axis=(0, 1, 2))
        m = self.spline.m
        points = self.spline.c.reshape(-1, m)
        size = np.maximum(np.abs(points).max(axis=0), 1e-300)
        if self.spline.weights is not None:  # of a quotient: |dx| <= (|d(wx)| + |x| |dw|) / w
            error = (error[:m] + size * error[m]) / self.spline.weights.min()
        size[:3] = np.linalg.norm(np.ptp(points[:, :3], axis=0))
        return float((error / size).max())

    def _spline(self, t: FloatArray, matrix: FloatArray, closed: bool) -> BSpline:
        """The spline of the fitted basis functions."""
        c = np.moveaxis(np.tensordot(matrix, self.c, axes=(1, self.axis)), 0, self.axis)
        if closed:
            ends = np.moveaxis(c, self.axis, 0)
            ends[-1] = ends[0]
        weights = None
        if self.spline.weights is not None:
            weights, c = c[..., -1], c[..., :-1] / c[..., -1:]
        knots, k = list(self.spline.t), list(self.spline.k)
        wraps = list(self.spline.periodic)
        knots[self.axis], k[self.axis], wraps[self.axis] = t, self.degree, False
        return BSpline(knots, c, k, periodic=wraps, weights=weights)
