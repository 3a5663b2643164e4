"""Where zero sets of two polynomials cross: on boxes, seams on their bases; on bases, points.

The value of one polynomial on the zero set of the other, along the height of a box, vanishes where
they cross. It is interpolated on the base, as one more polynomial there; likewise along one
direction of a base.

Guarantees: exact for planes and lines. An interpolant is compared in between, and said to be good
only if it is right to a part `WELL` of its values there.
"""

from typing import Any

import numpy as np

from ilattice._kernels import inner
from ilattice.bspline._kernels_bernstein import (
    basis,
    extremes,
    insert,
    jet,
    roots,
    single_root,
    slopes,
)
from ilattice.quadrature._kernels_scratch import (
    ACTIVE,
    ALONG,
    CROSS,
    CURVES,
    CUT_FACES,
    FACES,
    INVERSE,
    LEVEL,
    LINE,
    MAX_CROSSINGS,
    MAX_SETS,
    NEAR,
    OWNERS,
    ROW,
    SEAM,
    SEAMS,
    SITES,
    SPANS,
    STACK,
    TEMP,
    TINY,
    TOL,
    WELL,
    B,
    D,
)


@inner(error_model="numpy")
def no_common_zero(c: Any, at: int, to: int, size: int) -> bool:
    """Whether some a f + b g with constants a, b has one strict sign: f and g vanish nowhere both.

    The pairs of coefficients must fit into an open half-plane; what is kept is the cone that they
    span, from the direction (ax, ay) to the left as far as (bx, by).
    """
    ax = c[at]
    ay = c[to]
    bx = ax
    by = ay
    fits = ax != 0.0 or ay != 0.0
    for i in range(1, size):
        x = c[at + i]
        y = c[to + i]
        left = ax * y - ay * x
        right = x * by - y * bx
        if left >= 0.0 and right >= 0.0:
            fits = fits and (left + right > 0.0 or ax * x + ay * y > 0.0)
        elif left < 0.0 and right > 0.0:
            ax = x
            ay = y
        elif right < 0.0 and left > 0.0:
            bx = x
            by = y
        else:
            fits = False
    return fits


@inner(error_model="numpy")
def on_root(Z: Any, f: int, g: int, L: Any) -> float:
    """Value of line g at the root of the monotone line f, or about where that is beyond [0, 1].

    NaN where f is flat.
    """
    P = len(L)
    first = Z[f]
    last = Z[f + P - 1]
    if (first < 0.0) != (last < 0.0):
        return jet(Z, g, single_root(Z, f, L), L)[0]
    t = 0.0 if abs(first) < abs(last) else 1.0
    for _ in range(4):
        v, dv = jet(Z, f, t, L)
        if dv != 0.0:
            t = min(max(t - v / dv, -1.0), 2.0)
    v, dv = jet(Z, f, t, L)
    w, dw = jet(Z, g, t, L)
    return w - v / dv * dw if dv != 0.0 else np.nan  # to first order farther away


@inner(error_model="numpy")
def crossing_at(Z: Any, a: int, b: int, turned: bool, t: float, L: Any) -> float:
    """Value of polynomial b of a base where polynomial a vanishes, at t in the outer direction."""
    P = len(L)
    step1, step2 = (1, P) if turned else (P, 1)
    basis(t, Z, B, L)
    for k in range(2):
        c = b if k else a
        for i in range(P):
            s = 0.0
            for r in range(P):
                s += Z[B + r] * Z[c + i * step1 + r * step2]
            Z[LINE + k * P + i] = s
    return on_root(Z, LINE, LINE + P, L)


@inner(error_model="numpy")
def may_cross(Z: Any, N: Any, here: int, i: int, j: int, L: Any) -> bool:
    """Whether two cut faces of different polynomials may vanish together."""
    square = len(L) * len(L)
    a = N[CUT_FACES + i]
    b = N[CUT_FACES + j]
    return N[OWNERS + i] != N[OWNERS + j] and not no_common_zero(
        Z, here + a * square, here + b * square, square
    )


@inner(error_model="numpy")
def crossing(Z: Any, N: Any, here: int, i: int, j: int, turned: bool, L: Any) -> bool:
    """Where two cut faces vanish together, as roots of a line that is left in TEMP.

    Whether there is any, and that is exact enough: it is interpolated, and compared in between.
    """
    P = len(L)
    a = here + N[CUT_FACES + i] * P * P
    b = here + N[CUT_FACES + j] * P * P
    step, other = (1, P) if turned else (P, 1)
    for k in range(2):
        c = b if k else a
        low, high = slopes(Z, c, step, other, 0, 1, L)
        least, most = slopes(Z, c, other, step, 0, 1, L)
        eps = max(Z[TOL + N[OWNERS + (j if k else i)]], LEVEL * max(-least, most))
        if max(-low, high) <= eps:
            Z[TEMP : TEMP + P] = 1.0  # along the lines: found at their ends
            return True
    top = 0.0
    known = True
    for r in range(P):
        Z[SEAM + r] = crossing_at(Z, a, b, turned, Z[SITES + r], L)
        top = max(top, abs(Z[SEAM + r]))
        known = known and Z[SEAM + r] == Z[SEAM + r]
    for r in range(P):
        s = 0.0
        for k in range(P):
            s += Z[INVERSE + r * P + k] * Z[SEAM + k]
        Z[TEMP + r] = s
    off = abs(jet(Z, TEMP, 0.37, L)[0] - crossing_at(Z, a, b, turned, 0.37, L))
    if not known or top <= 1e2 * Z[TOL + N[OWNERS + j]]:
        Z[TEMP : TEMP + P] = 1.0
        return known  # they are one
    least, most = extremes(Z, TEMP, P)
    return least < 0.0 < most and off <= WELL * top


@inner(error_model="numpy")
def add_crossings(Z: Any, N: Any, here: int, n_faces: int, turned: bool, n: int, L: Any) -> int:
    """Insert the crossings of all cut faces into the sorted list at CROSS; its new length."""
    for i in range(n_faces * N[CURVES]):
        for j in range(i):
            if may_cross(Z, N, here, i, j, L):
                crossing(Z, N, here, i, j, turned, L)
                Z[ALONG] = 0.0
                count = roots(Z, TEMP, ALONG, 0, STACK, L)
                for r in range(count):
                    t = Z[ALONG + r]
                    new = n < MAX_CROSSINGS
                    for k in range(n):
                        new = new and abs(Z[CROSS + k] - t) > NEAR
                    if new:
                        n = insert(Z, CROSS, n, t)
    return n


@inner(error_model="numpy")
def steepest(Z: Any, i: int, axes: int) -> float:
    """Largest difference of polynomial i in SPANS."""
    top = 0.0
    for axis in range(axes):
        at = SPANS + axis * ROW + i * 2
        top = max(top, max(-Z[at], Z[at + 1]))
    return top


@inner(error_model="numpy")
def least_slope(Z: Any, i: int, axes: int, eps: float) -> float:
    """Difference along a direction up to which polynomial i does not depend on it."""
    return max(eps, LEVEL * steepest(Z, i, axes))


@inner(error_model="numpy")
def rising(Z: Any, N: Any, n: int, axis: int) -> int:
    """Bits of the active polynomials that depend on a direction, or 0 if one is not monotone."""
    out = 0
    for i in range(n):
        low = Z[SPANS + axis * ROW + i * 2]
        high = Z[SPANS + axis * ROW + i * 2 + 1]
        eps = least_slope(Z, i, 3, Z[TOL + N[ACTIVE + i]])
        if low < -eps and high > eps:
            return 0
        if max(-low, high) > eps:
            out |= 1 << N[ACTIVE + i]
    return out


@inner(error_model="numpy")
def seam_at(Z: Any, f: int, g: int, e0: int, s: float, t: float, L: Any) -> float:
    """Value of tensor g on the zero set of tensor f, in the column at (s, t) along e0."""
    P = len(L)
    step0 = P ** (2 - e0)
    step1 = P ** (2 - (1 if e0 == 0 else 0))
    step2 = P ** (2 - (1 if e0 == 2 else 2))
    basis(s, Z, B, L)
    basis(t, Z, D, L)
    for k in range(2):
        c = g if k else f
        for i in range(P):
            v = 0.0
            for a in range(P):
                for b in range(P):
                    v += Z[B + a] * Z[D + b] * Z[c + i * step0 + a * step1 + b * step2]
            Z[LINE + k * P + i] = v
    return on_root(Z, LINE, LINE + P, L)


@inner(error_model="numpy")
def project_seam(Z: Any, f: int, g: int, e0: int, to: int, eps: float, L: Any) -> Any:
    """Face `to` that vanishes below the crossings of two tensors that are monotone along e0.

    Whether there may be any, whether it is exact enough, and its largest value. It is interpolated,
    and compared in between.
    """
    P = len(L)
    top = 0.0
    known = True
    for a in range(P):
        for b in range(P):
            v = seam_at(Z, f, g, e0, Z[SITES + a], Z[SITES + b], L)
            known = known and v == v
            top = max(top, abs(v))
            Z[SEAM + a * P + b] = v
    if not known or top <= 1e2 * eps:  # they are one
        return False, known, 0.0
    least = np.inf
    most = -np.inf
    for i in range(P):
        for j in range(P):
            v = 0.0
            for a in range(P):
                for b in range(P):
                    v += Z[INVERSE + i * P + a] * Z[INVERSE + j * P + b] * Z[SEAM + a * P + b]
            Z[to + i * P + j] = v
            least = min(least, v)
            most = max(most, v)
    off = 0.0
    for k in range(2):
        s = 0.37 if k else 0.81
        t = 0.59 if k else 0.23
        v = seam_at(Z, f, g, e0, s, t, L)
        basis(s, Z, B, L)
        basis(t, Z, D, L)
        for i in range(P):
            for j in range(P):
                v -= Z[B + i] * Z[D + j] * Z[to + i * P + j]
        off = max(off, abs(v))
    return least < 0.0 < most, off <= WELL * top, top


@inner(error_model="numpy")
def project_seams(Z: Any, N: Any, here: int, n: int, e0: int, L: Any) -> bool:
    """Put the seams of all pairs of the n active tensors behind their faces; SEAMS of them.

    Whether all are exact enough. Where there are none, halving will tell the two apart.
    """
    P = len(L)
    cube = P * P * P
    count = 0
    good = True
    upright = rising(Z, N, n, e0)  # all others are found by their faces
    for i in range(n):
        for j in range(i):
            if not (upright >> N[ACTIVE + i] & 1 and upright >> N[ACTIVE + j] & 1):
                continue
            f = here + N[ACTIVE + i] * cube
            g = here + N[ACTIVE + j] * cube
            if no_common_zero(Z, f, g, cube):
                continue
            eps = Z[TOL + N[ACTIVE + j]]
            to = FACES + (2 * n + count) * P * P
            there, exact, top = project_seam(Z, f, g, e0, to, eps, L)
            good = good and exact and (there or top == 0.0)
            if there:
                Z[TOL + MAX_SETS + count] = 10.0 * (eps + TINY * top)
                count += 1
    N[SEAMS] = count
    return good
