"""Splines for continuous functions with kinks, and how far off they are.

A function of three parameters is taken apart along lines. Where a line has a kink, halving finds
it; kinks that all lines share get a knot of their own, at which the spline may bend, so that
functions which are smooth between planes u = const are fitted as well as smooth ones. Elsewhere
spans are halved where a parabola does not fit, which makes them finer towards roots and peaks, as
long as the coefficients are not too many.

Guarantee: quadratic, continuous, interpolates at one site per coefficient; the deviation is the
largest one that was found at points which the fit has not seen, and by a search from the worst of
them. Non-guarantees: kinks across all directions, such as that of ``|u - v|``, are rounded off over
a span; peaks so narrow that no sample meets them are not seen.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ilattice._geometry import grid_array
from ilattice._typing import AnyArray, FloatArray
from ilattice.bspline import BSpline
from ilattice.bspline.fit import fit_interpolate, sites

#: Degree between kinks.
DEGREE = 2
#: Random lines along each direction, and intervals into which they are cut at first.
LINES, FIRST = 20, 16
#: A kink is where parabolas miss by more than this part of the largest value times the width,
#: relative to the line, down to this width, on this part of the lines; most intervals in a search.
BENT, NARROW, SHARED, MAX_INTERVALS = 1e-4, 1e-9, 0.3, 500
#: How far intervals reach over their ends, in widths, not to miss kinks there.
OVER = 0.1
#: Most coefficients, and most halvings of a span.
MAX_COEFFICIENTS, DEEPEST = 1 << 17, 24
#: Points that tell the deviation, of which the worst are followed, and how far: rounds, trials.
POINTS, WORST, ROUNDS, TRIALS = 6000, 24, 14, 24
#: Fits, each with lines through the worst points of the one before.
REFITS = 3
#: A jump, relative to the largest value.
JUMP = 1e-3
#: Values below this part of the largest one count as that, where errors are relative.
SMALL = 0.01

Function = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Deviation:
    """Largest deviation of a spline from what was asked that was found.

    Attributes
    ----------
    absolute : float
        In units of the values.
    relative : float
        Largest one relative to the value there, or to a hundredth of the largest value.
    u : ndarray, shape (3,)
        Where it is largest relatively.
    """

    absolute: float
    relative: float
    u: FloatArray


class JumpError(Exception):
    """A function is not continuous; the place and the values on both sides."""


def fit_with_kinks(f: Function, domain: FloatArray, tol: float) -> tuple[BSpline, Deviation]:
    """Quadratic spline of a continuous function over a box.

    Parameters
    ----------
    f : callable
        Takes points (n, 3) of the box, returns values (n,).
    domain : ndarray, shape (2, 3)
        The box.
    tol : float
        Deviation that is small enough.

    Returns
    -------
    BSpline
        The spline; closer than `tol` where that takes no more than `MAX_COEFFICIENTS` coefficients.
    Deviation
        How far it is off.

    Raises
    ------
    JumpError
        If values jump at a plane across an axis.
    """
    lo, hi = domain
    places = lo + (hi - lo) * np.random.default_rng(0).random((POINTS, 3))
    largest = float(np.abs(f(places)).max())
    places = places[:LINES]
    worst = np.empty((0, 3))
    fits: list[tuple[BSpline, Deviation]] = []
    for _ in range(REFITS):
        lines = [np.delete(places, a, axis=1) for a in range(3)]
        kinks = [_kinks(f, lines[a], a, domain) for a in range(3)]
        for a in range(3):
            _check_jumps(f, lines[a], a, kinks[a], float(hi[a] - lo[a]), largest)
        breaks = [np.concatenate([[lo[a]], kinks[a], [hi[a]]]) for a in range(3)]
        seen = [np.unique(np.concatenate([b, worst[:, a]])) for a, b in enumerate(breaks)]
        fine = _halved(f, lines, seen, domain, tol)
        spline = _through(f, fine, kinks)
        found, worst = deviation(f, spline)
        fits.append((spline, found))
        if found.absolute <= tol:
            return fits[-1]
        worst = worst[:4]
        places = np.concatenate([places, worst])
    spline = _through(f, _even(breaks, seen, fine), kinks)
    fits.append((spline, deviation(f, spline)[0]))
    return min(fits, key=lambda fit: fit[1].relative)


def fit_evenly(f: Function, domain: FloatArray, tol: float) -> tuple[BSpline, Deviation]:
    """Quadratic spline with equal spans, for functions that take long and have no kinks.

    Parameters
    ----------
    f, domain, tol : callable, ndarray and float
        As in `fit_with_kinks`.

    Returns
    -------
    BSpline
        The spline; closer than `tol` where that takes no more than half of `MAX_COEFFICIENTS`.
    Deviation
        How far it is off.
    """
    n = FIRST
    while True:
        breaks = [np.linspace(domain[0, a], domain[1, a], n + 1) for a in range(3)]
        spline = _through(f, breaks, [np.empty(0)] * 3)
        found, _ = deviation(f, spline)
        n = 3 * n // 2
        if found.absolute <= tol or (n + 2.0) ** 3 > MAX_COEFFICIENTS / 2:
            return spline, found


def deviation(f: Function, spline: BSpline) -> tuple[Deviation, FloatArray]:
    """How far a spline is off a function, and the worst points, worst first.

    Parameters
    ----------
    f : callable
        Takes points (n, 3), returns values (n,).
    spline : BSpline
        Scalar, of three parameters.

    Returns
    -------
    Deviation
        The largest one that was found.
    ndarray, shape (WORST, 3)
        The worst points.
    """
    lo, hi = spline.domain
    rng = np.random.default_rng(1)
    u = lo + (hi - lo) * rng.random((POINTS, 3))
    asked = f(u)
    floor = max(SMALL * float(np.abs(asked).max()), 1e-300)

    def measured(u: FloatArray, asked: FloatArray) -> FloatArray:
        return np.abs(spline(u) - asked) / np.maximum(np.abs(asked), floor)

    off = measured(u, asked)
    order = np.argsort(-off, kind="stable")[:WORST]
    u, off, reach = u[order], off[order], 0.05 * (hi - lo)
    for _ in range(ROUNDS):
        trial = u[:, None] + reach * rng.uniform(-1.0, 1.0, (len(u), TRIALS, 3))
        trial = np.clip(trial, lo, hi).reshape(-1, 3)
        now = measured(trial, f(trial)).reshape(len(u), TRIALS)
        at = now.argmax(axis=1)
        better = now.max(axis=1) > off
        u = np.where(better[:, None], trial.reshape(len(u), TRIALS, 3)[np.arange(len(u)), at], u)
        off, reach = np.maximum(off, now.max(axis=1)), 0.6 * reach
    order = np.argsort(-off, kind="stable")
    u, asked = u[order], f(u[order])
    return Deviation(float(np.abs(spline(u) - asked).max()), float(off.max()), u[0]), u


def _misfits(f: Function, lines: FloatArray, axis: int, a: FloatArray, b: FloatArray) -> FloatArray:
    """How far parabolas through three points of intervals miss two others: (lines, intervals)."""
    part = np.array([0.0, 0.27, 0.5, 0.72, 1.0])
    t = (a[:, None] + (b - a)[:, None] * part).ravel()
    u = np.insert(np.repeat(lines, len(t), axis=0), axis, np.tile(t, len(lines)), axis=1)
    v = f(u).reshape(len(lines), len(a), 5)
    out = np.zeros(v.shape[:2])
    for i in (1, 3):
        s = part[i]
        weights = (2 * s - 1) * (s - 1), 4 * s * (1 - s), s * (2 * s - 1)
        parabola = sum(w * v[..., j] for w, j in zip(weights, (0, 2, 4), strict=True))
        out = np.maximum(out, np.abs(v[..., i] - parabola))
    return out


def _kinks(f: Function, lines: FloatArray, axis: int, domain: FloatArray) -> FloatArray:
    """Coordinates of the inner kinks that lines along an axis share."""
    lo, hi = domain[:, axis]
    edges = np.concatenate([[0.0], (np.arange(FIRST) + 0.3719) / FIRST, [1.0]])
    a, b = lo + (hi - lo) * edges[:-1], lo + (hi - lo) * edges[1:]
    scale = 0.0
    while len(a):
        width = b - a
        first, last = np.maximum(a - OVER * width, lo), np.minimum(b + OVER * width, hi)
        off = _misfits(f, lines, axis, first, last)
        scale = scale or float(off.max())
        bent = off > BENT * scale * width / (hi - lo)
        shared = bent.mean(axis=0) >= SHARED
        keep = bent.any(axis=0) if width.max() > 1e-3 * (hi - lo) else shared
        a, b = a[keep], b[keep]
        if len(a) > MAX_INTERVALS or not scale:
            return np.empty(0)
        if not len(a) or width.max() < NARROW * (hi - lo):
            break
        middle = 0.5 * (a + b)
        a, b = np.sort(np.concatenate([a, middle])), np.sort(np.concatenate([middle, b]))
    found = np.sort(0.5 * (a + b))
    apart = np.diff(found, prepend=lo) > 10.0 * NARROW * (hi - lo)
    return found[apart & (hi - found > 10.0 * NARROW * (hi - lo))]


def _check_jumps(
    f: Function, lines: FloatArray, axis: int, kinks: FloatArray, length: float, largest: float
) -> None:
    """Refuse kinks at which the values jump, which are small at a kink next to zero."""
    for kink in kinks:
        sides = kink + np.array([-3.0, 3.0]) * NARROW * length
        u = [np.insert(lines, axis, t, axis=1) for t in sides]
        below, above = f(u[0]), f(u[1])
        step = np.abs(above - below)
        i = int(np.argmax(step))
        if step[i] > JUMP * max(largest, np.abs(below).max(), np.abs(above).max()):
            raise JumpError(f"from {below[i]:g} to {above[i]:g} at {np.round(u[1][i], 6).tolist()}")


def _halved(
    f: Function, lines: list[FloatArray], breaks: list[FloatArray], domain: FloatArray, tol: float
) -> list[FloatArray]:
    """Spans per direction, halved as often as it takes or as there may be more."""
    for _ in range(3 * DEEPEST):
        off = [_worst(f, lines[a], a, breaks[a], domain, tol) for a in range(3)]
        wrong = [o > 0.5 * tol for o in off]
        if not any(w.any() for w in wrong):
            break
        if _size(breaks, wrong) > MAX_COEFFICIENTS:
            top = [o.max() for o in off]
            axis = int(np.argmax(top))
            wrong = [(o >= 0.5 * top[axis]) & (a == axis) for a, o in enumerate(off)]
            if _size(breaks, wrong) > MAX_COEFFICIENTS:
                break
        breaks = [np.sort(np.concatenate([b, 0.5 * (b[:-1] + b[1:])[w]]))
                  for b, w in zip(breaks, wrong, strict=True)]  # fmt: skip
    return breaks


def _even(
    breaks: list[FloatArray], seen: list[FloatArray], fine: list[FloatArray]
) -> list[FloatArray]:
    """Breaks with equal spans between them, where spans had to be halved."""
    vary = np.array([len(b) > len(a) for a, b in zip(seen, fine, strict=True)])
    fixed = np.prod([len(b) + 1.0 for b, v in zip(breaks, vary, strict=True) if not v])
    n = int((MAX_COEFFICIENTS / fixed) ** (1.0 / max(vary.sum(), 1))) - max(len(b) for b in breaks)
    out = []
    for b, v in zip(breaks, vary, strict=True):
        even = np.linspace(b[0], b[-1], max(n, 2))
        far = np.abs(even[:, None] - b).min(axis=1) > 0.2 * (b[-1] - b[0]) / max(n, 2)
        out.append(np.sort(np.concatenate([b, even[far]])) if v else b)
    return out


def _worst(
    f: Function, lines: FloatArray, axis: int, breaks: FloatArray, domain: FloatArray, tol: float
) -> FloatArray:
    """Misfit in each span, the largest of all lines; none in the narrowest spans."""
    length = float(np.ptp(domain[:, axis]))
    inner = 2.0 * NARROW * length
    width = np.diff(breaks)
    rim = np.minimum(inner, 0.01 * width)
    off = _misfits(f, lines, axis, breaks[:-1] + rim, breaks[1:] - rim).max(axis=0)
    narrow = width < length * 0.5**DEEPEST
    return np.where(narrow, np.minimum(off, 0.5 * tol), off)


def _size(breaks: list[FloatArray], wrong: list[AnyArray]) -> float:
    """Coefficients of a spline with some spans halved."""
    return float(np.prod([len(b) + 1.0 + w.sum() for b, w in zip(breaks, wrong, strict=True)]))


def _through(f: Function, breaks: list[FloatArray], kinks: list[FloatArray]) -> BSpline:
    """Spline that interpolates a function, with knots of multiplicity two at kinks."""
    knots = [
        np.sort(np.concatenate([b[:1], b[:1], b, k, b[-1:], b[-1:]]))
        for b, k in zip(breaks, kinks, strict=True)
    ]
    axes = [sites(t, DEGREE, "interpolate") for t in knots]
    values = np.empty([len(x) for x in axes])
    for i, x in enumerate(axes[0]):
        u = grid_array([x], axes[1], axes[2])
        values[i] = f(u.reshape(-1, 3)).reshape(values.shape[1:])
    return fit_interpolate(values, knots, DEGREE)
