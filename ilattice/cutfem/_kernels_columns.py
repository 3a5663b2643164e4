"""Rules on a box in columns along one direction in which all active polynomials are monotone.

All scratch is one array of numbers and one of integers, made once per chunk, in which everything
has the place that is named below: arrays as arguments cost counted references, which here would
take as long as the work itself.

Guarantees: weights are positive; points lie inside the box. Rows that do not fit into the output
are counted, not written. Non-guarantees: columns with a vertical tangent, and bases in which the
zero sets of two polynomials cross, are accepted at the asked depth, and then are of lower order.
"""

from typing import Any

import numpy as np
from numba import njit

from ilattice.cutfem._kernels_bernstein import (
    basis,
    basis_slope,
    bend,
    extremes,
    halve,
    jet,
    roots,
    single_root,
    slopes,
)

#: For what only other kernels call: no wrappers, which take a third of the compilation.
INNER: Any = {
    "cache": True,
    "error_model": "numpy",
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}
CAP = 24  # levels of halving of a box, and of its base
SHARE = 0.05  # least slope along the height, as a part of the largest slope
GAP = 1e-14  # intervals below this are dropped
VOLUME, SURFACE = 1, 2  # what is wanted

# Places in the scratch Z of numbers, for coefficients up to degree 4
NODES, WEIGHTS, SOFT_NODES, SOFT_WEIGHTS = 0, 10, 20, 30
X, LO, EXT, FLAT, TOL = 40, 43, 46, 49, 53
B, D, SPANS = 56, 61, 66  # SPANS: [axis, polynomial, end], 3 x 4 x 2
CROSS, ALONG, UPRIGHT = 90, 154, 218  # breakpoints in three directions
STACK, TEMP = 282, 576
PLANES, LINES = 584, 684  # 4 planes (values, slopes), 6 lines (values, two slopes)
PARTS = 716  # (CAP + 2) x [lower corner, extent, halvings, those of parts with a direction]
BOXES = PARTS + (CAP + 2) * 6  # (CAP + 2) x the same, in three dimensions
FACES = BOXES + (CAP + 2) * 8  # (CAP + 2) x 4 faces
TENSORS = FACES + (CAP + 2) * 4 * 25  # (CAP + 2) x 2 tensors
NUMBERS = TENSORS + (CAP + 2) * 2 * 125

# Places in the scratch N of whole numbers
ACTIVE, UP, CUT_FACES, OWNERS, SENSE = 0, 2, 4, 8, 12
N_VOLUME, N_SURFACE, UNSURE = 16, 17, 18  # rows written, whether any sign is not certain
INTEGERS = 20


@njit(**INNER)
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


@njit(**INNER)
def best_axis(Z: Any, N: Any, axes: int, n: int, which: int, up: int) -> Any:
    """Direction in which n polynomials are monotone, and how steep they are there.

    Their least and largest differences are in SPANS; polynomial i has the tolerance
    Z[TOL + N[which + i]], and the sense N[up + i] along the direction. That is -1 if none will do.
    """
    best = -1
    score = -1.0
    for axis in range(axes):
        worst = 2.0
        for i in range(n):
            low = Z[SPANS + axis * 8 + i * 2]
            high = Z[SPANS + axis * 8 + i * 2 + 1]
            eps = Z[TOL + N[which + i]]
            if max(-low, high) <= eps or (low < -eps and high > eps):
                worst = -1.0
            elif worst >= 0.0:
                top = 0.0
                for other in range(axes):
                    at = SPANS + other * 8 + i * 2
                    top = max(top, max(-Z[at], Z[at + 1]))
                worst = min(worst, max(max(low, -high), 0.0) / top)
        if worst > score:
            best = axis
            score = worst
    if best >= 0:
        for i in range(n):
            at = SPANS + best * 8 + i * 2
            N[up + i] = 1 if Z[at + 1] > -Z[at] else -1
    return best, score


@njit(**INNER)
def foot(
    Z: Any,
    N: Any,
    surface: Any,
    i: int,
    t: float,
    e0: int,
    low: float,
    high: float,
    w: float,
    L: Any,
) -> None:
    """Point of the zero set of active polynomial i, at t on a column, with its normal."""
    P = len(L)
    lines = LINES + i * P
    e1 = 1 if e0 == 0 else 0
    e2 = 1 if e0 == 2 else 2
    g0 = jet(Z, lines, t, L)[1] / Z[EXT + e0]
    g1 = jet(Z, lines + 2 * P, t, L)[0] / Z[EXT + e1]
    g2 = jet(Z, lines + 4 * P, t, L)[0] / Z[EXT + e2]
    length = np.sqrt(g0 * g0 + g1 * g1 + g2 * g2)
    if abs(g0) > 1e-14 * length:  # else a tangent column: no area
        at = N[N_SURFACE]
        N[N_SURFACE] = at + 1
        if at < len(surface):
            surface[at, 0] = Z[X]
            surface[at, 1] = Z[X + 1]
            surface[at, 2] = Z[X + 2]
            surface[at, e0] = low + high * t
            surface[at, 3] = w * length / abs(g0)
            surface[at, 4 + e0] = g0 / length
            surface[at, 4 + e1] = g1 / length
            surface[at, 4 + e2] = g2 / length
            surface[at, 7] = N[ACTIVE + i]


@njit(**INNER, inline="always")
def segment(
    Z: Any,
    N: Any,
    volume: Any,
    a: float,
    b: float,
    e0: int,
    low: float,
    high: float,
    w: float,
    q: int,
) -> None:
    """Gauss points on the part [a, b] of a column."""
    at = N[N_VOLUME]
    N[N_VOLUME] = at + q
    if at + q <= len(volume):
        start = low + high * a
        length = high * (b - a)
        x0 = Z[X]
        x1 = Z[X + 1]
        x2 = Z[X + 2]
        for g in range(q):
            volume[at + g, 0] = x0
            volume[at + g, 1] = x1
            volume[at + g, 2] = x2
            volume[at + g, e0] = start + length * Z[NODES + g]
            volume[at + g, 3] = w * length * Z[WEIGHTS + g]


@njit(**INNER)
def crowded(
    Z: Any, N: Any, volume: Any, surface: Any, n: int, e0: int, w: float, want: int, q: int, L: Any
) -> None:
    """`column` where nothing is known to be monotone: all roots, signs between them."""
    P = len(L)
    Z[UPRIGHT] = 0.0
    Z[UPRIGHT + 1] = 1.0
    count = 2
    for i in range(n):
        count = roots(Z, LINES + i * P, UPRIGHT, count, STACK, L)
    low = Z[LO + e0]
    high = Z[EXT + e0]
    for j in range(count - 1):
        a = Z[UPRIGHT + j]
        b = Z[UPRIGHT + j + 1]
        inside = b - a > GAP
        for i in range(n):
            inside = inside and jet(Z, LINES + i * P, 0.5 * (a + b), L)[0] < 0.0
        if inside and want & VOLUME:
            segment(Z, N, volume, a, b, e0, low, high, w, q)
        if inside and want & SURFACE:
            for i in range(n):
                eps = 1e3 * Z[TOL + N[ACTIVE + i]]
                for t in (a, b):
                    if abs(jet(Z, LINES + i * P, t, L)[0]) <= eps:
                        foot(Z, N, surface, i, t, e0, low, high, w, L)


@njit(**INNER, inline="always")
def column(
    Z: Any,
    N: Any,
    volume: Any,
    surface: Any,
    n: int,
    e0: int,
    low: float,
    high: float,
    w: float,
    want: int,
    q: int,
    L: Any,
) -> None:
    """Points on the part of one line where all active polynomials are negative."""
    P = len(L)
    a = 0.0
    b = 1.0
    ka = -1
    kb = -1
    for i in range(n):
        c = LINES + i * P
        first = Z[c]
        last = Z[c + P - 1]
        if N[UP + i] > 0:
            if first >= 0.0:
                b = -1.0
            elif last > 0.0:
                root = single_root(Z, c, L)
                if root < b:
                    b = root
                    kb = i
            elif b == 1.0 and last >= -Z[TOL + N[ACTIVE + i]]:
                kb = i
        else:
            if last >= 0.0:
                b = -1.0
            elif first > 0.0:
                root = single_root(Z, c, L)
                if root > a:
                    a = root
                    ka = i
            elif a == 0.0 and first >= -Z[TOL + N[ACTIVE + i]]:
                ka = i
    if a < b:
        if want & VOLUME:
            segment(Z, N, volume, a, b, e0, low, high, w, q)
        if want & SURFACE:
            if ka >= 0:
                foot(Z, N, surface, ka, a, e0, low, high, w, L)
            if kb >= 0:
                foot(Z, N, surface, kb, b, e0, low, high, w, L)


@njit(**INNER)
def slice_tensors(
    Z: Any,
    N: Any,
    at: int,
    n: int,
    basis_at: int,
    to: int,
    step0: int,
    step1: int,
    step2: int,
    L: Any,
) -> None:
    """Contract the last direction of the active tensors with a basis: planes from `to` on."""
    P = len(L)
    for k in range(n):
        c = at + N[ACTIVE + k] * P * P * P
        for i in range(P):
            for j in range(P):
                s = 0.0
                for r in range(P):
                    s += Z[basis_at + r] * Z[c + i * step0 + j * step1 + r * step2]
                Z[to + (k * P + i) * P + j] = s


@njit(**INNER)
def strips(
    Z: Any,
    N: Any,
    volume: Any,
    surface: Any,
    at: int,
    n: int,
    face: int,
    n_faces: int,
    e0: int,
    turned: bool,
    soft: bool,
    crowd: bool,
    want: int,
    q: int,
    L: Any,
) -> None:
    """Columns over one accepted part of a base, Z[FLAT:]: its lower corner and its extent.

    Lines run along the first direction of the base, or along the second if it is `turned`.
    """
    P = len(L)
    square = P * P
    u = 1 if e0 == 0 else 0
    v = 1 if e0 == 2 else 2
    e1, e2 = (v, u) if turned else (u, v)
    i1, i2 = (1, 0) if turned else (0, 1)
    step1, step2 = (1, P) if turned else (P, 1)
    long0 = P ** (2 - e0)
    long1 = P ** (2 - e1)
    long2 = P ** (2 - e2)
    low = Z[LO + e0]
    high = Z[EXT + e0]
    nodes, weights = (SOFT_NODES, SOFT_WEIGHTS) if soft else (NODES, WEIGHTS)
    first, second = (2, 4) if e1 < e2 else (4, 2)
    Z[CROSS] = 0.0
    Z[CROSS + 1] = 1.0
    n_cross = 2
    for j in range(n_faces):
        for side in range(2):
            edge = face + N[CUT_FACES + j] * square + side * (P - 1) * step1
            for i in range(P):
                Z[TEMP + i] = Z[edge + i * step2]
            n_cross = roots(Z, TEMP, CROSS, n_cross, STACK, L)
    for m2 in range(n_cross - 1):
        width2 = Z[CROSS + m2 + 1] - Z[CROSS + m2]
        if width2 <= GAP:
            continue
        for g2 in range(q):
            t2 = Z[CROSS + m2] + width2 * Z[nodes + g2]
            y2 = Z[FLAT + i2] + Z[FLAT + 2 + i2] * t2
            Z[X + e2] = Z[LO + e2] + Z[EXT + e2] * y2
            w2 = width2 * Z[weights + g2] * Z[FLAT + 2 + i2] * Z[EXT + e2]
            Z[ALONG] = 0.0
            Z[ALONG + 1] = 1.0
            n_along = 2
            if n_faces:
                basis(t2, Z, B, L)
                for j in range(n_faces):
                    c = face + N[CUT_FACES + j] * square
                    for i in range(P):
                        s = 0.0
                        for r in range(P):
                            s += Z[B + r] * Z[c + i * step1 + r * step2]
                        Z[TEMP + i] = s
                    n_along = roots(Z, TEMP, ALONG, n_along, STACK, L)
            basis(y2, Z, B, L)
            slice_tensors(Z, N, at, n, B, PLANES, long0, long1, long2, L)
            if want & SURFACE:
                basis_slope(y2, Z, D, L)
                slice_tensors(Z, N, at, n, D, PLANES + 2 * square, long0, long1, long2, L)
            for m1 in range(n_along - 1):
                width1 = Z[ALONG + m1 + 1] - Z[ALONG + m1]
                if width1 <= GAP:
                    continue
                for g1 in range(q):
                    y1 = Z[FLAT + i1] + Z[FLAT + 2 + i1] * (Z[ALONG + m1] + width1 * Z[nodes + g1])
                    Z[X + e1] = Z[LO + e1] + Z[EXT + e1] * y1
                    w1 = w2 * width1 * Z[weights + g1] * Z[FLAT + 2 + i1] * Z[EXT + e1]
                    basis(y1, Z, B, L)
                    for i in range(n * P):  # slices follow each other: line i of all of them
                        s = 0.0
                        for j in range(P):
                            s += Z[B + j] * Z[PLANES + i * P + j]
                        Z[LINES + i] = s
                    if want & SURFACE:
                        basis_slope(y1, Z, D, L)
                        for i in range(n * P):
                            s1 = 0.0
                            s2 = 0.0
                            for j in range(P):
                                s1 += Z[D + j] * Z[PLANES + i * P + j]
                                s2 += Z[B + j] * Z[PLANES + 2 * square + i * P + j]
                            Z[LINES + first * P + i] = s1
                            Z[LINES + second * P + i] = s2
                    if crowd:
                        crowded(Z, N, volume, surface, n, e0, w1, want, q, L)
                    else:
                        column(Z, N, volume, surface, n, e0, low, high, w1, want, q, L)


@njit(**INNER)
def first_part(Z: Any) -> None:
    """The whole base as the only part of it."""
    for i in range(6):
        Z[PARTS + i] = 1.0 if i == 2 or i == 3 else 0.0


@njit(**INNER)
def first_faces(Z: Any, N: Any, at: int, n: int, e0: int, L: Any) -> None:
    """The two faces across e0 of all active tensors."""
    P = len(L)
    u = 1 if e0 == 0 else 0
    v = 1 if e0 == 2 else 2
    step1 = P ** (2 - u)
    step2 = P ** (2 - v)
    for k in range(n):
        for side in range(2):
            c = at + N[ACTIVE + k] * P * P * P + side * (P - 1) * P ** (2 - e0)
            f = FACES + (2 * k + side) * P * P
            for i in range(P):
                for j in range(P):
                    Z[f + i * P + j] = Z[c + i * step1 + j * step2]


@njit(**INNER)
def face_axis(Z: Any, N: Any, here: int, n_faces: int, L: Any) -> Any:
    """Direction in which all cut faces are monotone, or -1, and whether they are steep there.

    Faces of different polynomials must not vanish together either.
    """
    P = len(L)
    square = P * P
    for j in range(n_faces):
        c = here + N[CUT_FACES + j] * square
        for k in range(2):
            step = P if k == 0 else 1
            low, high = slopes(Z, c, step, P + 1 - step, 0, 1, L)
            Z[SPANS + k * 8 + j * 2] = low
            Z[SPANS + k * 8 + j * 2 + 1] = high
    axis, score = best_axis(Z, N, 2, n_faces, OWNERS, SENSE)
    good = score >= SHARE
    for i in range(n_faces):
        for j in range(i):
            a = N[CUT_FACES + i]
            b = N[CUT_FACES + j]
            if good and a // 2 != b // 2:
                good = no_common_zero(Z, here + a * square, here + b * square, square)
    return axis, good


@njit(**INNER)
def halve_base(Z: Any, N: Any, level: int, n: int, n_faces: int, directed: bool, L: Any) -> None:
    """Halve a part of a base along its most curved direction: upper half here, lower above."""
    P = len(L)
    square = P * P
    here = FACES + level * 4 * square
    cut = 0
    top = 0.0
    for j in range(n_faces):
        c = here + N[CUT_FACES + j] * square
        for k in range(2):
            step = P if k == 0 else 1
            size = bend(Z, c, step, P + 1 - step, 0, 1, L)
            if size > top * (1.0 + 1e-9):
                top = size
                cut = k
    step = P if cut == 0 else 1
    for f in range(2 * n):
        c = here + f * square
        halve(Z, c, c + 4 * square, step, P + 1 - step, 0, 1, L)
    part = PARTS + 6 * level
    Z[part + 4] += 1.0
    if directed:
        Z[part + 5] += 1.0
    Z[part + 2 + cut] *= 0.5
    for i in range(6):
        Z[part + 6 + i] = Z[part + i]
    Z[part + cut] += Z[part + 2 + cut]


@njit(**INNER)
def base(
    Z: Any,
    N: Any,
    volume: Any,
    surface: Any,
    at: int,
    n: int,
    e0: int,
    soft: bool,
    crowd: bool,
    accept: int,
    want: int,
    q: int,
    L: Any,
) -> None:
    """Rules on a box in columns along e0; halves the base where no direction of it will do."""
    P = len(L)
    square = P * P
    first_faces(Z, N, at, n, e0, L)
    first_part(Z)
    level = 0
    while level >= 0:
        here = FACES + level * 4 * square
        n_faces = 0
        empty = False
        for k in range(n):
            eps = Z[TOL + N[ACTIVE + k]]
            lowest = np.inf
            for side in range(2):
                least, most = extremes(Z, here + (2 * k + side) * square, square)
                lowest = min(lowest, least)
                if least < -eps and most > eps:
                    N[CUT_FACES + n_faces] = 2 * k + side
                    N[OWNERS + n_faces] = N[ACTIVE + k]
                    n_faces += 1
            empty = empty or (lowest >= -eps and not crowd)
        axis = 0
        good = True
        if n_faces and not empty:
            axis, good = face_axis(Z, N, here, n_faces, L)
            part = PARTS + 6 * level
            if not good and (axis < 0 or Z[part + 5] < accept) and Z[part + 4] < CAP:
                halve_base(Z, N, level, n, n_faces, axis >= 0, L)
                level += 1
                continue
        if not empty:
            for i in range(4):
                Z[FLAT + i] = Z[PARTS + 6 * level + i]
            strips(Z, N, volume, surface, at, n, here, n_faces, e0, axis == 1, soft or not good,
                   crowd, want, q, L)  # fmt: skip
        level -= 1
