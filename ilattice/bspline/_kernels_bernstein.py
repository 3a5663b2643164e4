"""Polynomials in Bernstein form, as stretches of flat arrays: bounds, slopes, halves, roots.

A tensor of degree p per direction holds P³ = (p + 1)³ coefficients, a face P², a line P. `L` is
any sized object of length P: a tuple where loops are to be unrolled, an array where not.

Guarantees: no allocation. A polynomial lies between its least and its largest coefficient; it is
monotone in a direction in which all differences have one sign. `roots` finds every root in [0, 1]
that changes the sign, up to pairs closer than 2**-DEEPEST.
"""

from typing import Any

import numpy as np

from ilattice._kernels import inner

#: Times the noise of coefficients by which those of a linear function may be off.
STRAIGHT = 1e3
#: Halvings of a line after which roots that are still not told apart count as one: 1e-12 of it.
DEEPEST = 40


@inner(error_model="numpy")
def extremes(c: Any, at: int, size: int) -> Any:
    """Least and largest of `size` coefficients."""
    least = c[at]
    most = c[at]
    for i in range(at + 1, at + size):
        v = c[i]
        least = min(least, v)
        most = max(most, v)
    return least, most


@inner(error_model="numpy")
def slopes(c: Any, at: int, step: int, other: int, third: int, n: int, L: Any) -> Any:
    """Least and largest difference along the direction of stride `step`.

    `other` is the stride of the second direction, and `third` that of the third, with n entries.
    """
    P = len(L)
    least = np.inf
    most = -np.inf
    for a in range(P):
        for b in range(n):
            i = at + a * other + b * third
            low = c[i]
            for _ in range(P - 1):
                i += step
                high = c[i]
                d = high - low
                least = min(least, d)
                most = max(most, d)
                low = high
    return least, most


@inner(error_model="numpy")
def bend(c: Any, at: int, step: int, other: int, third: int, n: int, L: Any) -> float:
    """Largest second difference along a direction; for degree 1, the largest mixed one."""
    P = len(L)
    most = 0.0
    if P == 2:
        for b in range(n):
            i = at + b * third
            most = max(most, abs(c[i + step + other] - c[i + other] - c[i + step] + c[i]))
        if n == 2:
            for b in range(2):
                i = at + b * other
                most = max(most, abs(c[i + step + third] - c[i + third] - c[i + step] + c[i]))
        return most
    for a in range(P):
        for b in range(n):
            i = at + a * other + b * third
            for _ in range(P - 2):
                most = max(most, abs(c[i] - 2.0 * c[i + step] + c[i + 2 * step]))
                i += step
    return most


@inner(error_model="numpy")
def straight(c: Any, at: int, s: int, t: int, r: int, n: int, noise: float, L: Any) -> bool:
    """Whether coefficients c[at + i s + j t + k r], k below n, are those of a linear function.

    Up to some times the noise of coefficients.
    """
    P = len(L)
    off = 0.0
    for i in range(P):
        for j in range(P):
            for k in range(n):
                v = c[at + i * s + j * t + k * r]
                flat = c[at] + i * (c[at + s] - c[at]) + j * (c[at + t] - c[at])
                if n > 1:
                    flat += k * (c[at + r] - c[at])
                off = max(off, abs(v - flat))
    return off <= STRAIGHT * noise


@inner(error_model="numpy")
def halve_line(c: Any, at: int, d: Any, to: int, step: int, L: Any) -> None:
    """Upper half in place of the line c[at], lower half to d[to], by de Casteljau."""
    P = len(L)
    if P == 3:
        a = 0.5 * (c[at] + c[at + step])
        b = 0.5 * (c[at + step] + c[at + 2 * step])
        m = 0.5 * (a + b)
        d[to] = c[at]
        d[to + step] = a
        d[to + 2 * step] = m
        c[at] = m
        c[at + step] = b
        return
    d[to] = c[at]
    for r in range(1, P):
        for m in range(P - r):
            i = at + m * step
            c[i] = 0.5 * (c[i] + c[i + step])
        d[to + r * step] = c[at]


@inner(error_model="numpy")
def halve(c: Any, at: int, to: int, step: int, other: int, third: int, n: int, L: Any) -> None:
    """`halve_line` on all lines of a tensor (n = P) or face (n = 1)."""
    P = len(L)
    for a in range(P):
        for b in range(n):
            shift = a * other + b * third
            halve_line(c, at + shift, c, to + shift, step, L)


@inner(error_model="numpy")
def basis(t: float, b: Any, at: int, L: Any) -> None:
    """Bernstein basis at t into b[at:]."""
    P = len(L)
    s = 1.0 - t
    if P == 3:
        b[at] = s * s
        b[at + 1] = 2.0 * s * t
        b[at + 2] = t * t
        return
    b[at] = 1.0
    for r in range(1, P):
        carry = 0.0
        for i in range(at, at + r):
            v = b[i]
            b[i] = carry + s * v
            carry = t * v
        b[at + r] = carry


@inner(error_model="numpy")
def basis_slope(t: float, b: Any, at: int, L: Any) -> None:
    """Derivative of the Bernstein basis at t into b[at:]."""
    P = len(L)
    s = 1.0 - t
    b[at] = 1.0
    for r in range(1, P - 1):
        carry = 0.0
        for i in range(at, at + r):
            v = b[i]
            b[i] = carry + s * v
            carry = t * v
        b[at + r] = carry
    below = 0.0
    for i in range(at, at + P - 1):
        v = (P - 1) * b[i]
        b[i] = below - v
        below = v
    b[at + P - 1] = below


@inner(error_model="numpy")
def jet(c: Any, at: int, t: float, L: Any) -> Any:
    """Value and derivative of a line at t."""
    P = len(L)
    s = 1.0 - t
    if P == 2:
        return s * c[at] + t * c[at + 1], c[at + 1] - c[at]
    if P == 3:
        a = s * c[at] + t * c[at + 1]
        b = s * c[at + 1] + t * c[at + 2]
        return s * a + t * b, 2.0 * (b - a)
    # Horner's scheme in both t and s; the derivative likewise, from the differences
    value = c[at] * s
    slope = c[at + 1] - c[at]
    power = 1.0
    binomial = 1.0
    lower = 1.0
    for i in range(1, P - 1):
        power *= t
        binomial = binomial * (P - i) / i
        lower = lower * (P - 1 - i) / i
        value = (value + binomial * power * c[at + i]) * s
        slope = slope * s + lower * power * (c[at + i + 1] - c[at + i])
    return value + power * t * c[at + P - 1], (P - 1) * slope


@inner(error_model="numpy")
def bracketed(c: Any, at: int, a: float, b: float, L: Any) -> float:
    """The root of a line between a and b, where it has different signs: Newton, safeguarded."""
    fa = jet(c, at, a, L)[0]
    fb = jet(c, at, b, L)[0]
    t = a + (b - a) * fa / (fa - fb)
    if not a < t < b:
        t = 0.5 * (a + b)
    for _ in range(60):
        f, df = jet(c, at, t, L)
        if f == 0.0:
            return t
        if (f < 0.0) == (fa < 0.0):
            a = t
        else:
            b = t
        new = t - f / df if df != 0.0 else 0.5 * (a + b)
        if not a < new < b:
            new = 0.5 * (a + b)
        if abs(new - t) <= 4e-16 or not a < new < b:
            return new
        t = new
    return t


@inner(error_model="numpy")
def single_root(c: Any, at: int, L: Any) -> float:
    """The root of a monotone line with different signs at its ends."""
    P = len(L)
    f = c[at]
    if P == 2:
        return f / (f - c[at + 1])
    if P == 3:
        half = c[at + 1] - f
        a = f - 2.0 * c[at + 1] + c[at + 2]
        root = abs(f) / (abs(half) + np.sqrt(max(half * half - a * f, 0.0)))
        return min(root, 1.0)
    return bracketed(c, at, 0.0, 1.0, L)


@inner(error_model="numpy")
def insert(c: Any, to: int, n: int, t: float) -> int:
    """Put t into the sorted list c[to : to + n]; its new length."""
    i = to + n
    while i > to and c[i - 1] > t:
        c[i] = c[i - 1]
        i -= 1
    c[i] = t
    return n + 1


@inner(error_model="numpy")
def _quadratic(c: Any, at: int, to: int, n: int) -> int:
    """Insert the roots inside (0, 1) of a line of degree 2."""
    f = c[at]
    half = c[at + 1] - f
    a = f - 2.0 * c[at + 1] + c[at + 2]
    inside = half * half - a * f
    if inside < 0.0:
        return n
    s = -(half + np.copysign(np.sqrt(inside), half))
    if s != 0.0:
        t = f / s
        if 0.0 < t < 1.0:
            n = insert(c, to, n, t)
    if a != 0.0:
        t = s / a
        if 0.0 < t < 1.0:
            n = insert(c, to, n, t)
    return n


@inner(error_model="numpy")
def roots(c: Any, at: int, to: int, n: int, stack: int, L: Any) -> int:
    """Insert the roots inside (0, 1) into the sorted list c[to : to + n]; its new length.

    From `stack` on there is scratch for P + 2 numbers at each of DEEPEST + 2 levels.
    """
    P = len(L)
    least, most = extremes(c, at, P)
    # Coefficients bound the values; roots of low degrees need no search.
    if least >= 0.0 or most <= 0.0:
        return n
    if P == 2:
        return insert(c, to, n, c[at] / (c[at] - c[at + 1]))
    if P == 3:
        return _quadratic(c, at, to, n)
    width = P + 2
    top = 0
    c[stack] = 0.0
    c[stack + 1] = 1.0
    for i in range(P):
        c[stack + 2 + i] = c[at + i]
    while top >= 0:
        here = stack + top * width
        changes = 0
        last = 0.0
        for i in range(P):
            v = c[here + 2 + i]
            if v != 0.0:
                if v * last < 0.0:
                    changes += 1
                last = v
        a = c[here]
        b = c[here + 1]
        first = c[here + 2]
        end = c[here + 1 + P]
        # No change of sign, no root inside, but a root may lie where two halves meet: their upper
        # ends count, so that none counts twice.
        if changes == 0:
            if end == 0.0 and b < 1.0:
                n = insert(c, to, n, b)
            top -= 1
        # One change and ends of unlike signs: one root, to be bracketed on the whole line.
        elif changes == 1 and first * end < 0.0:
            n = insert(c, to, n, bracketed(c, at, a, b, L))
            top -= 1
        # Roots this near, or a double one, cannot be told from rounding.
        elif b - a < 2.0**-DEEPEST:
            n = insert(c, to, n, 0.5 * (a + b))
            top -= 1
        else:
            middle = 0.5 * (a + b)
            lower = here + width
            halve_line(c, here + 2, c, lower + 2, 1, L)
            c[lower] = a
            c[lower + 1] = middle
            c[here] = middle
            top += 1
    return n
