"""Compiled bounds of scalar tensor-product B-splines on boxes.

On the part of a box inside one Bézier element the polynomial is written in the Bernstein
basis of that part: coefficient j of a direction is the polar form at k - j times the lower and j
times the upper end. The extreme coefficients bound the polynomial. With arguments inside the knot
span every step is a convex combination, so rounding stays within a few units in the last place of
the largest coefficient; results are widened by that.

Splines with fewer parameters are seen as trivariate, with degree 0 and one span.

Guarantees: no allocation per box, the same bits for any number of threads. Non-guarantees:
arguments are not checked; boxes must lie in the domain.
"""

from typing import Any, NamedTuple

import numpy as np

from ilattice._kernels import in_ranges, inner, outer
from ilattice._kernels_tuples import borrowed

#: Elements that a thread takes at once.
CHUNK = 64
MAX = 9  # coefficients per direction of the highest degree


@inner()
def span_below(t: Any, k: int, x: float, strict: bool) -> int:
    """Largest l in [k, n) with t[l] <= x, or t[l] < x; k if there is none."""
    lo = k
    hi = len(t) - k - 1
    while hi - lo > 1:
        mid = (lo + hi) // 2
        if t[mid] < x or (t[mid] == x and not strict):
            lo = mid
        else:
            hi = mid
    return lo


@inner()
def span_range(t: Any, k: int, lo: float, hi: float) -> Any:
    """First and last span that a closed interval of the domain meets.

    A span that it meets at a knot only counts if the spline may jump there.
    """
    end = t[len(t) - k - 1]
    first = span_below(t, k, lo, lo >= end)
    last = span_below(t, k, hi, hi >= end)
    if last > first and t[last] == hi and t[last - k] != hi:
        last = span_below(t, k, hi, True)
    return first, max(first, last)


@outer()
def restriction(t: Any, k: int, span: int, lo: float, hi: float, out: Any) -> None:
    """Bernstein coefficients on [lo, hi] from those of the span: out (>= k+1, >= k+1)."""
    for j in range(k + 1):
        out[j, 0] = 1.0
        for r in range(1, k + 1):
            x = lo if r <= k - j else hi
            carry = 0.0
            for i in range(r):
                left = t[span + 1 - r + i]
                right = t[span + 1 + i]
                f = out[j, i] / (right - left)
                out[j, i] = carry + f * (right - x)
                carry = f * (x - left)
            out[j, r] = carry


@inner()
def bernstein(c: Any, first: Any, k: Any, rows: Any, work: Any, out: Any) -> None:
    """Bernstein coefficients of one part of an element, flat, into out.

    `first` (3,) is the corner of the coefficient window, `rows` (3, MAX, MAX) the restrictions.
    """
    k0 = k[0] + 1
    k1 = k[1] + 1
    k2 = k[2] + 1
    for i in range(k0):
        for j in range(k1):
            line = c[first[0] + i, first[1] + j]
            for q in range(k2):
                s = 0.0
                for p in range(k2):
                    s += rows[2, q, p] * line[first[2] + p]
                work[j, q] = s
        for j in range(k1):
            for q in range(k2):
                s = 0.0
                for p in range(k1):
                    s += rows[1, j, p] * work[p, q]
                out[0, (i * k1 + j) * k2 + q] = s
    size = k1 * k2
    for i in range(k0):
        for j in range(size):
            s = 0.0
            for p in range(k0):
                s += rows[0, i, p] * out[0, p * size + j]
            out[1, i * size + j] = s


@inner()
def window(c: Any, a: Any, b: Any) -> Any:
    """Least and largest coefficient with indices a <= index < b."""
    least = np.inf
    most = -np.inf
    for i in range(a[0], b[0]):
        for j in range(a[1], b[1]):
            line = c[i, j]
            for q in range(a[2], b[2]):
                v = line[q]
                least = min(least, v)
                most = max(most, v)
    return least, most


class Spline(NamedTuple):
    """A scalar spline of three parameters for the kernels of bounds.

    Attributes
    ----------
    t0, t1, t2, k
        Knots and degrees (3,).
    c, num, w
        Coefficients (n0, n1, n2), the same times their weights, and the weights.
    rational
        Whether the weights count.
    """

    t0: Any
    t1: Any
    t2: Any
    k: Any
    c: Any
    num: Any
    w: Any
    rational: bool


@inner()
def element_range(spline: Any, first: Any, rows: Any, work: Any, out: Any) -> Any:
    """Least and largest Bernstein coefficient on one part of an element."""
    k = spline.k
    size = (k[0] + 1) * (k[1] + 1) * (k[2] + 1)
    least = np.inf
    most = -np.inf
    if spline.rational:
        bernstein(spline.num, first, k, rows, work, out[:2])
        bernstein(spline.w, first, k, rows, work, out[2:])
        for i in range(size):
            v = out[1, i] / out[3, i]
            least = min(least, v)
            most = max(most, v)
    else:
        bernstein(spline.c, first, k, rows, work, out[:2])
        for i in range(size):
            v = out[1, i]
            least = min(least, v)
            most = max(most, v)
    return least, most


@inner(owning=True)
def box_range(
    spline: Any, lo: Any, hi: Any, span: Any, first: Any, rows: Any, work: Any, out: Any,
    pad: float, least: float, most: float,
) -> Any:  # fmt: skip
    """Union of the bounds on all elements that a box meets; [least, most] is known to be met."""
    t0, t1, t2, k = spline.t0, spline.t1, spline.t2, spline.k
    stop = np.empty(3, np.int64)
    for i0 in range(span[0, 0], span[0, 1] + 1):
        if t0[i0 + 1] <= t0[i0]:
            continue
        restriction(t0, k[0], i0, max(lo[0], t0[i0]), min(hi[0], t0[i0 + 1]), rows[0])
        first[0] = i0 - k[0]
        for i1 in range(span[1, 0], span[1, 1] + 1):
            if t1[i1 + 1] <= t1[i1]:
                continue
            restriction(t1, k[1], i1, max(lo[1], t1[i1]), min(hi[1], t1[i1 + 1]), rows[1])
            first[1] = i1 - k[1]
            for i2 in range(span[2, 0], span[2, 1] + 1):
                if t2[i2 + 1] <= t2[i2]:
                    continue
                first[2] = i2 - k[2]
                for d in range(3):
                    stop[d] = first[d] + k[d] + 1
                a, b = window(spline.c, first, stop)
                widen = pad * max(abs(a), abs(b))
                if a - widen >= least and b + widen <= most:  # the whole element adds nothing
                    continue
                restriction(t2, k[2], i2, max(lo[2], t2[i2]), min(hi[2], t2[i2 + 1]), rows[2])
                x, y = element_range(spline, first, rows, work, out)
                least = min(least, max(a, x) - widen)
                most = max(most, min(b, y) + widen)
    return least, most


@in_ranges(CHUNK)
@outer(nogil=True, error_model="numpy")
def ranges(
    first: int, last: int, spline: Any, lo: Any, hi: Any, tight: bool, has_level: bool,
    level: float, pad: float, out: Any,
) -> None:  # fmt: skip
    """Bounds on boxes lo, hi (m, 3) into out (m, 2).

    First the extremes of all coefficients that matter; these stay if `tight` is false, or if there
    is a level that they exclude. Otherwise the union over Bézier elements, restricted to the box.
    """
    spline = borrowed(spline)
    t0, t1, t2, k = spline.t0, spline.t1, spline.t2, spline.k
    span = np.empty((3, 2), np.int64)
    a = np.empty(3, np.int64)
    b = np.empty(3, np.int64)
    rows = np.zeros((3, MAX, MAX))
    work = np.zeros((MAX, MAX))
    flat = np.zeros((4, (k[0] + 1) * (k[1] + 1) * (k[2] + 1)))
    for p in range(first, last):
        span[0, 0], span[0, 1] = span_range(t0, k[0], lo[p, 0], hi[p, 0])
        span[1, 0], span[1, 1] = span_range(t1, k[1], lo[p, 1], hi[p, 1])
        span[2, 0], span[2, 1] = span_range(t2, k[2], lo[p, 2], hi[p, 2])
        for d in range(3):
            a[d] = span[d, 0] - k[d]
            b[d] = span[d, 1] + 1
        least, most = window(spline.c, a, b)
        widen = pad * max(abs(least), abs(most))
        least -= widen
        most += widen
        if tight and not (has_level and (least > level or most < level)):
            x, y = box_range(spline, lo[p], hi[p], span, a, rows, work, flat, pad, np.inf, -np.inf)
            least = max(least, x)
            most = min(most, y)
        out[p, 0] = least
        out[p, 1] = most
