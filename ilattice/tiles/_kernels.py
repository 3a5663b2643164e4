"""Kernels of separable trigonometric polynomials.

A polynomial is ``f(p) = sum_i coef[i] * F(factor[i, 0], X) * F(factor[i, 1], Y) *
F(factor[i, 2], Z)`` with the angles ``X = w[0] x`` and so on, ``w = 2 pi / period``. The codes of
``F`` are 0: 1, ``2h - 1``: ``cos h.``, ``2h``: ``sin h.``.

Guarantees: nothing is allocated per point; results do not depend on the number of threads; NaN
in, NaN out; angles are reduced in turns, so a field of period 1 repeats exactly as far as
``x + 1`` is exact. Not guaranteed: accuracy for more than 2**50 turns.
"""

import math
from typing import Any

import numpy as np
from numba import njit

from ilattice._kernels import in_ranges, inner, outer

#: Points that a thread takes at once.
CHUNK = 1024
# Without "reassoc": sums over a few terms must not be vectorised, and keep their order.
FAST = {"contract", "nsz", "arcp"}
TWO_PI = 2.0 * math.pi
TURNS = 1.0 / TWO_PI

# Taylor coefficients: |r| <= pi / 4 leaves 5e-17 (sine) and 2e-18 (cosine).
_S = tuple((-1.0) ** i / math.factorial(2 * i + 1) for i in range(8))
_C = tuple((-1.0) ** i / math.factorial(2 * i) for i in range(9))
_S1, _S2, _S3, _S4, _S5, _S6, _S7 = _S[1:]
_C1, _C2, _C3, _C4, _C5, _C6, _C7, _C8 = _C[1:]


@inner(fastmath={"contract", "nsz"})
def sincos_turns(t: float) -> Any:
    """Sine and cosine of ``2 pi t``, within about one unit in the last place."""
    q = np.rint(4.0 * t)
    r = (t - 0.25 * q) * TWO_PI
    v = r * r
    v2 = v * v
    v4 = v2 * v2
    s = (_S1 + v * _S2) + v2 * (_S3 + v * _S4) + v4 * ((_S5 + v * _S6) + v2 * _S7)
    s = r + r * v * s
    c = (_C1 + v * _C2) + v2 * (_C3 + v * _C4) + v4 * ((_C5 + v * _C6) + v2 * (_C7 + v * _C8))
    c = 1.0 + v * c
    k = int(q) & 3
    if k & 1:
        s, c = c, s
    if k & 2:
        s = -s
    if (k + 1) & 2:
        c = -c
    return s, c


@inner(owning=True)
def trig_tab(factor: Any) -> Any:
    """Scratch for `trig_jet`, to be allocated once per chunk: shape (3, 2 H + 1, 3).

    ``H`` is the highest harmonic in ``factor`` (m, 3).
    """
    top = 2
    for i in range(factor.shape[0]):
        for a in range(3):
            top = max(top, factor[i, a])
    return np.zeros((3, 2 * ((top + 1) // 2) + 1, 3))


@njit(cache=True, fastmath=FAST, inline="always")
def _axis_table(tab: Any, axis: int, w: float, x: float) -> None:
    """Fill ``tab[axis, code]`` with value, first and second derivative of each factor at x."""
    s1, c1 = sincos_turns(x * (w * TURNS))
    tab[axis, 0, 0] = 1.0
    tab[axis, 0, 1] = 0.0
    tab[axis, 0, 2] = 0.0
    s, c = s1, c1
    hw = w
    for h in range(1, (tab.shape[1] + 1) // 2):
        tab[axis, 2 * h - 1, 0] = c
        tab[axis, 2 * h - 1, 1] = -hw * s
        tab[axis, 2 * h - 1, 2] = -hw * hw * c
        tab[axis, 2 * h, 0] = s
        tab[axis, 2 * h, 1] = hw * c
        tab[axis, 2 * h, 2] = -hw * hw * s
        s, c = s * c1 + c * s1, c * c1 - s * s1
        hw += w


@inner(fastmath=FAST)
def trig_jet(
    coef: Any,
    factor: Any,
    two_pi_over_period: Any,
    x: float,
    y: float,
    z: float,
    tab: Any,
    out: Any,
) -> None:
    """Value, gradient and Hessian of a trigonometric polynomial at one point, in one pass.

    Parameters
    ----------
    coef, factor
        The polynomial: (m,) float64 and (m, 3) int64.
    two_pi_over_period
        Angle per length on each axis, (3,) float64.
    x, y, z
        The point.
    tab
        Scratch of `trig_tab`, overwritten.
    out
        At least 10 float64, overwritten: value, gx, gy, gz, hxx, hyy, hzz, hyz, hxz, hxy.
    """
    _axis_table(tab, 0, two_pi_over_period[0], x)
    _axis_table(tab, 1, two_pi_over_period[1], y)
    _axis_table(tab, 2, two_pi_over_period[2], z)
    f = gx = gy = gz = 0.0
    hxx = hyy = hzz = hyz = hxz = hxy = 0.0
    for i in range(coef.shape[0]):
        a, b, c = factor[i, 0], factor[i, 1], factor[i, 2]
        k = coef[i]
        x0, x1, x2 = tab[0, a, 0], tab[0, a, 1], tab[0, a, 2]
        y0, y1, y2 = tab[1, b, 0], tab[1, b, 1], tab[1, b, 2]
        z0, z1, z2 = tab[2, c, 0], tab[2, c, 1], tab[2, c, 2]
        yz = k * y0 * z0
        kx = k * x0
        xz = kx * z0
        xy = kx * y0
        kx1 = k * x1
        f += yz * x0
        gx += yz * x1
        hxx += yz * x2
        gy += xz * y1
        hyy += xz * y2
        gz += xy * z1
        hzz += xy * z2
        hyz += kx * y1 * z1
        hxz += kx1 * y0 * z1
        hxy += kx1 * y1 * z0
    out[0] = f
    out[1], out[2], out[3] = gx, gy, gz
    out[4], out[5], out[6] = hxx, hyy, hzz
    out[7], out[8], out[9] = hyz, hxz, hxy


@in_ranges(CHUNK)
@outer(nogil=True, error_model="numpy")
def _jets(
    first: int, last: int, coef: Any, factor: Any, w: Any, p: Any, f: Any, g: Any, h: Any
) -> None:
    tab = trig_tab(factor)
    out = np.empty(10)
    for i in range(first, last):
        trig_jet(coef, factor, w, p[i, 0], p[i, 1], p[i, 2], tab, out)
        f[i] = out[0]
        g[i, 0], g[i, 1], g[i, 2] = out[1], out[2], out[3]
        h[i, 0, 0], h[i, 1, 1], h[i, 2, 2] = out[4], out[5], out[6]
        h[i, 1, 2] = h[i, 2, 1] = out[7]
        h[i, 0, 2] = h[i, 2, 0] = out[8]
        h[i, 0, 1] = h[i, 1, 0] = out[9]


def jets(coef: Any, factor: Any, w: Any, p: Any) -> Any:
    """Values (n,), gradients (n, 3) and Hessians (n, 3, 3) at points ``p``."""
    n = len(p)
    f, g, h = np.empty(n), np.empty((n, 3)), np.empty((n, 3, 3))
    _jets(n, coef, factor, w, p, f, g, h)
    return f, g, h
