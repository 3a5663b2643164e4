"""Values, derivatives and bounds of box splines, polynomial by polynomial.

The planes of a box spline cut each cell of the lattice into d! simplices, one per order of the
fractional coordinates; on each the spline is a Bernstein polynomial whose coefficients are sums of
control values times a table. The directions do not change when axes are permuted, so that one
table, that of t0 >= t1 >= ..., serves all.

Shape of arguments: control values less the value outside (flat, last axis fastest) and their
shape (d,); `turn` (d, 4): lattice coordinates are turn[:, :3] @ x + turn[:, 3]; `offsets` (K, d),
`powers` (E, d + 1) and `table` (K, E): Bernstein coefficients for bounds, for values and
derivatives times multinomials.

Guarantee: bounds hold every value, as rounding may change them by 1e-13 of the largest control.
"""

import math
from typing import Any

import numpy as np

from ilattice._kernels import in_ranges, inner, outer

#: Most cells of a box whose polynomials are looked at one by one, and whose controls are.
FEW_CELLS, MANY_CELLS = 8, 4096


@inner()
def _control(c: Any, shape: Any, wrap: bool, cell: Any, order: Any, offset: Any) -> float:
    """The control value at a cell plus a permuted offset."""
    d = len(shape)
    flat = 0
    for axis in range(d):
        at = cell[axis]
        for j in range(d):
            if order[j] == axis:
                at += offset[j]
        if wrap:
            at %= shape[axis]
        elif at < 0 or at >= shape[axis]:
            return 0.0
        flat = flat * shape[axis] + at
    return float(c[flat])


@inner()
def _gathered(
    c: Any, shape: Any, wrap: bool, cell: Any, order: Any, offsets: Any, table: Any, out: Any
) -> bool:
    """Coefficients of the polynomial on one simplex of a cell; whether one is not zero."""
    out[:] = 0.0
    found = False
    for k in range(len(offsets)):
        w = _control(c, shape, wrap, cell, order, offsets[k])
        if w != 0.0:
            found = True
            for e in range(len(out)):
                out[e] += w * table[k, e]
    return found


@inner()
def _located(x: Any, turn: Any, cell: Any, t: Any, order: Any) -> None:
    """Cell of a point, and its fractional coordinates from large to small."""
    d = len(turn)
    for a in range(d):
        s = turn[a, 0] * x[0] + turn[a, 1] * x[1] + turn[a, 2] * x[2] + turn[a, 3]
        low = math.floor(s)
        cell[a] = int(low)
        value = s - low
        j = a
        while j > 0 and t[j - 1] < value:
            t[j], order[j] = t[j - 1], order[j - 1]
            j -= 1
        t[j], order[j] = value, a


@in_ranges(256)
@outer(nogil=True)
def jets(
    first: int, last: int, points: Any, turn: Any, c: Any, shape: Any, wrap: bool,
    offsets: Any, powers: Any, table: Any, order: int, f: Any, g: Any, h: Any,
) -> None:  # fmt: skip
    """Values (n,), gradients (n, 3) and Hessians (n, 3, 3) up to an order, in space."""
    d, degree = len(shape), int(powers[0].sum())
    cell, axes, t = np.empty(d, np.int64), np.empty(d, np.int64), np.empty(d)
    b, power = np.empty(len(powers)), np.ones((d + 1, degree + 1))
    slope, bend = np.empty(d + 1), np.empty((d + 1, d + 1))
    rows = np.empty((d + 1, 3))  # gradients of the barycentric coordinates
    for i in range(first, last):
        f[i] = 0.0
        if order > 0:
            g[i] = 0.0
        if order > 1:
            h[i] = 0.0
        _located(points[i], turn, cell, t, axes)
        if not _gathered(c, shape, wrap, cell, axes, offsets, table, b):
            continue  # no control within reach: the value outside, and flat
        for j in range(d + 1):
            bary = (1.0 if j == 0 else t[j - 1]) - (t[j] if j < d else 0.0)
            for n in range(degree):
                power[j, n + 1] = power[j, n] * bary
            for k in range(3):
                rows[j, k] = (0.0 if j == 0 else turn[axes[j - 1], k]) - (
                    turn[axes[j], k] if j < d else 0.0
                )
        slope[:] = 0.0
        bend[:] = 0.0
        for e in range(len(powers)):
            _term(powers[e], b[e], power, order, i, f, slope, bend)
        for j in range(d + 1 if order > 0 else 0):
            for k in range(3):
                g[i, k] += slope[j] * rows[j, k]
        for j in range(d + 1 if order > 1 else 0):
            for m in range(d + 1):
                for k in range(3):
                    for q in range(3):
                        h[i, k, q] += bend[j, m] * rows[j, k] * rows[m, q]


@inner()
def _term(e: Any, b: float, power: Any, order: int, i: int, f: Any, slope: Any, bend: Any) -> None:
    """Add one term of a Bernstein polynomial and its derivatives by barycentric coordinates."""
    d = len(e)
    term = b
    for j in range(d):
        term *= power[j, e[j]]
    f[i] += term
    for j in range(d if order > 0 else 0):
        if e[j] == 0:
            continue
        once = b * e[j]
        for q in range(d):
            once *= power[q, e[q] - (1 if q == j else 0)]
        slope[j] += once
        for m in range(d if order > 1 else 0):
            left = e[m] - (1 if m == j else 0)
            if left == 0:
                continue
            twice = b * e[j] * left
            for q in range(d):
                twice *= power[q, e[q] - (1 if q == j else 0) - (1 if q == m else 0)]
            bend[j, m] += twice


@inner()
def _cells(lo: Any, hi: Any, turn: Any, ends: Any) -> float:
    """First and last cells (2, d) of a box in space; how many there are."""
    count = 1.0
    for a in range(len(turn)):
        low = high = turn[a, 3]
        for k in range(3):
            u, v = turn[a, k] * lo[k], turn[a, k] * hi[k]
            if turn[a, k] != 0.0:
                low += min(u, v)
                high += max(u, v)
        slack = 1e-12 * (1.0 + abs(low) + abs(high))
        low, high = math.floor(low - slack), math.floor(high + slack)
        count *= high - low + 1.0
        if count > MANY_CELLS:
            return count
        ends[0, a], ends[1, a] = int(low), int(high)
    return count


@in_ranges(64)
@outer(nogil=True)
def bounds(
    first: int, last: int, lo: Any, hi: Any, turn: Any, c: Any, shape: Any, wrap: bool,
    offsets: Any, powers: Any, table: Any, orders: Any, ends: Any, out: Any,
) -> None:  # fmt: skip
    """Lower and upper bounds (n, 2) on boxes.

    In few cells those of the Bernstein coefficients, in more those of the controls within reach,
    in many those of all controls (`ends`).
    """
    d = len(shape)
    span, cell = np.empty((2, d), np.int64), np.empty(d, np.int64)
    b = np.empty(len(powers))
    for i in range(first, last):
        count = _cells(lo[i], hi[i], turn, span)
        if count > MANY_CELLS:
            out[i, 0], out[i, 1] = ends[0], ends[1]
            continue
        low, high = np.inf, -np.inf
        for number in range(int(count)):
            rest = number
            for a in range(d):
                wide = span[1, a] - span[0, a] + 1
                cell[a] = span[0, a] + rest % wide
                rest //= wide
            for p in range(len(orders) if count <= FEW_CELLS else 0):
                _gathered(c, shape, wrap, cell, orders[p], offsets, table, b)
                for e in range(len(b)):
                    low, high = min(low, b[e]), max(high, b[e])
            for p in range(0 if count <= FEW_CELLS else len(orders)):
                for k in range(len(offsets)):
                    w = _control(c, shape, wrap, cell, orders[p], offsets[k])
                    low, high = min(low, w), max(high, w)
        out[i, 0], out[i, 1] = low, high
