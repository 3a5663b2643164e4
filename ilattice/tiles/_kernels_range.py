"""Rigorous bounds of trigonometric polynomials on boxes.

Two enclosures are intersected: the natural interval extension with the exact interval of each
sine and cosine, nested by axis; and a Taylor form about the centre, whose remainder is bounded
with the largest second derivatives on the box. The second converges with the square of the box.

Guarantee: both the exact and the computed value of the polynomial at every point of the box lie
within the bounds, which are widened by a bound of all rounding errors.
"""

from typing import Any

import numpy as np

from ilattice._kernels import in_ranges, inner, outer
from ilattice.tiles._kernels import TURNS, sincos_turns, trig_jet, trig_tab

#: Boxes that a thread takes at once, and the rounding of a double.
CHUNK = 256
EPS = 2.220446049250313e-16


@inner()
def _cos_bounds(u0: float, u1: float, c0: float, c1: float) -> Any:
    """Exact interval of cos(2 pi u) on [u0, u1], with its values at the ends."""
    low, high = min(c0, c1), max(c0, c1)
    if np.floor(u1) >= u0:
        high = 1.0
    if np.floor(u1 - 0.5) >= u0 - 0.5:
        low = -1.0
    return low, high


@inner()
def _axis_bounds(box: Any, top: Any, axis: int, w: float, lo: float, hi: float) -> None:
    """Fill the interval of each factor, and the largest size of its first three derivatives.

    ``box[axis, code]`` is (low, high); ``top[axis, code]`` the sizes of derivatives 0, 1, 2.
    """
    t0, t1 = lo * (w * TURNS), hi * (w * TURNS)
    s0, c0 = sincos_turns(t0)
    s1, c1 = sincos_turns(t1)
    box[axis, 0, 0] = box[axis, 0, 1] = 1.0
    top[axis, 0, 0], top[axis, 0, 1], top[axis, 0, 2] = 1.0, 0.0, 0.0
    sa, ca, sb, cb = s0, c0, s1, c1
    for h in range(1, (box.shape[1] + 1) // 2):
        u0, u1 = h * t0, h * t1
        c_low, c_high = _cos_bounds(u0, u1, ca, cb)
        s_low, s_high = _cos_bounds(u0 - 0.25, u1 - 0.25, sa, sb)
        box[axis, 2 * h - 1, 0], box[axis, 2 * h - 1, 1] = c_low, c_high
        box[axis, 2 * h, 0], box[axis, 2 * h, 1] = s_low, s_high
        c_top, s_top = max(-c_low, c_high), max(-s_low, s_high)
        hw = h * w
        top[axis, 2 * h - 1, 0] = c_top
        top[axis, 2 * h - 1, 1] = hw * s_top
        top[axis, 2 * h - 1, 2] = hw * hw * c_top
        top[axis, 2 * h, 0] = s_top
        top[axis, 2 * h, 1] = hw * c_top
        top[axis, 2 * h, 2] = hw * hw * s_top
        sa, ca = sa * c0 + ca * s0, ca * c0 - sa * s0
        sb, cb = sb * c1 + cb * s1, cb * c1 - sb * s1


@inner()
def _times(a0: float, a1: float, b0: float, b1: float) -> Any:
    """Interval product."""
    p, q, r, s = a0 * b0, a0 * b1, a1 * b0, a1 * b1
    return min(p, q, r, s), max(p, q, r, s)


@inner()
def _natural(coef: Any, factor: Any, box: Any) -> Any:
    """Interval extension, nested: terms must be sorted by z code, then y code."""
    low = high = 0.0
    y_low = y_high = x_low = x_high = 0.0
    m = coef.shape[0]
    for i in range(m):
        a, b, c = factor[i, 0], factor[i, 1], factor[i, 2]
        k = coef[i]
        if k >= 0:
            x_low += k * box[0, a, 0]
            x_high += k * box[0, a, 1]
        else:
            x_low += k * box[0, a, 1]
            x_high += k * box[0, a, 0]
        last_z = i == m - 1 or factor[i + 1, 2] != c
        if last_z or factor[i + 1, 1] != b:
            p, q = _times(x_low, x_high, box[1, b, 0], box[1, b, 1])
            y_low += p
            y_high += q
            x_low = x_high = 0.0
        if last_z:
            p, q = _times(y_low, y_high, box[2, c, 0], box[2, c, 1])
            low += p
            high += q
            y_low = y_high = 0.0
    return low, high


@inner()
def _remainder(coef: Any, factor: Any, top: Any, r: Any) -> float:
    """Bound of the second-order Taylor remainder on a box of half-widths r (3,)."""
    total = 0.0
    for i in range(coef.shape[0]):
        x, y, z = top[0, factor[i, 0]], top[1, factor[i, 1]], top[2, factor[i, 2]]
        second = x[2] * y[0] * z[0] * r[0] * r[0]
        second += x[0] * y[2] * z[0] * r[1] * r[1]
        second += x[0] * y[0] * z[2] * r[2] * r[2]
        second += 2.0 * x[0] * y[1] * z[1] * r[1] * r[2]
        second += 2.0 * x[1] * y[0] * z[1] * r[0] * r[2]
        second += 2.0 * x[1] * y[1] * z[0] * r[0] * r[1]
        total += abs(coef[i]) * second
    return 0.5 * total


@inner()
def _rounding(coef: Any, factor: Any, w: Any, reach: Any) -> float:
    """Bound of the rounding of values, slopes, angles and of the bounds themselves."""
    angle = w[0] * reach[0] + w[1] * reach[1] + w[2] * reach[2]
    m = coef.shape[0]
    total = 0.0
    for i in range(m):
        h = 0
        for a in range(3):
            h = max(h, (factor[i, a] + 1) // 2)
        total += abs(coef[i]) * (32.0 + 2.0 * m + h * (16.0 + (8.0 + 2.0 * m) * angle))
    return EPS * total


@in_ranges(CHUNK)
@outer(nogil=True, error_model="numpy")
def _ranges(
    first: int, last: int, coef: Any, factor: Any, w: Any, lin: Any, lo: Any, hi: Any, out: Any
) -> None:
    tab = trig_tab(factor)
    box, top = np.zeros((3, tab.shape[1], 2)), np.zeros((3, tab.shape[1], 3))
    jet, mid, r, reach = np.empty(10), np.empty(3), np.empty(3), np.empty(3)
    for i in range(first, last):
        for a in range(3):
            c = rad = far = 0.0
            for b in range(3):
                m = 0.5 * (lo[i, b] + hi[i, b])
                c += lin[a, b] * m
                rad += abs(lin[a, b]) * max(hi[i, b] - m, m - lo[i, b])
                far += abs(lin[a, b]) * max(abs(lo[i, b]), abs(hi[i, b]))
            mid[a], r[a], reach[a] = c, rad * (1.0 + 8.0 * EPS), far
            _axis_bounds(box, top, a, w[a], c - r[a], c + r[a])
        low, high = _natural(coef, factor, box)
        trig_jet(coef, factor, w, mid[0], mid[1], mid[2], tab, jet)
        spread = _remainder(coef, factor, top, r)
        for b in range(3):
            slope = jet[1] * lin[0, b] + jet[2] * lin[1, b] + jet[3] * lin[2, b]
            spread += abs(slope) * 0.5 * (hi[i, b] - lo[i, b])
        spread *= 1.0 + 64.0 * EPS
        pad = _rounding(coef, factor, w, reach)
        out[i, 0] = max(low, jet[0] - spread) - pad
        out[i, 1] = min(high, jet[0] + spread) + pad


def ranges(coef: Any, factor: Any, w: Any, lin: Any, lo: Any, hi: Any) -> Any:
    """Bounds, shape (n, 2), of ``f(lin @ p)`` on boxes with corners ``lo``, ``hi`` (n, 3)."""
    out = np.empty((len(lo), 2))
    _ranges(len(lo), coef, factor, w, lin, lo, hi, out)
    return out
