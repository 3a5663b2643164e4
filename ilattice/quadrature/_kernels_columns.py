"""Points of rules on columns over an accepted part of a base: volumes and surfaces.

Guarantees: weights are positive; points lie inside the box. Rows that do not fit into the output
are counted, not written.
"""

from typing import Any

import numpy as np
from numba import njit

from ilattice._kernels import inner
from ilattice.bspline._kernels_bernstein import basis, basis_slope, jet, roots, single_root
from ilattice.quadrature._kernels_crossings import add_crossings
from ilattice.quadrature._kernels_scratch import (
    ACTIVE,
    ALONG,
    CROSS,
    CUT_FACES,
    EMIT,
    EXT,
    FLAT,
    GAP,
    LINES,
    LO,
    MAX_SETS,
    N_SURFACE,
    N_VOLUME,
    NAMES,
    NODES,
    NORMAL,
    PLANES,
    SET,
    SOFT_NODES,
    SOFT_WEIGHTS,
    STACK,
    SURFACE,
    TABLE,
    TEMP,
    TOL,
    UP,
    UPRIGHT,
    VOLUME,
    WEIGHT,
    WEIGHTS,
    B,
    D,
    X,
)


@inner(error_model="numpy")
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
    out: float,
    L: Any,
) -> None:
    """Point of the zero set of active polynomial i, at t on a column, with its normal.

    That is the gradient times `out`, 1 or -1.
    """
    P = len(L)
    lines = LINES + i * P
    e1 = 1 if e0 == 0 else 0
    e2 = 1 if e0 == 2 else 2
    g0 = jet(Z, lines, t, L)[1] / Z[EXT + e0]
    g1 = jet(Z, lines + MAX_SETS * P, t, L)[0] / Z[EXT + e1]
    g2 = jet(Z, lines + 2 * MAX_SETS * P, t, L)[0] / Z[EXT + e2]
    length = np.sqrt(g0 * g0 + g1 * g1 + g2 * g2)
    wanted = N[EMIT] >> N[ACTIVE + i] & 1
    if wanted and abs(g0) > 1e-14 * length:  # else a tangent column: no area
        at = N[N_SURFACE]
        N[N_SURFACE] = at + 1
        if at < len(surface):
            surface[at, 0] = Z[X]
            surface[at, 1] = Z[X + 1]
            surface[at, 2] = Z[X + 2]
            surface[at, e0] = low + high * t
            surface[at, WEIGHT] = w * length / abs(g0)
            surface[at, NORMAL + e0] = out * g0 / length
            surface[at, NORMAL + e1] = out * g1 / length
            surface[at, NORMAL + e2] = out * g2 / length
            surface[at, SET] = N[NAMES + N[ACTIVE + i]]


@njit(cache=True, error_model="numpy", inline="always")
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


@inner(error_model="numpy")
def signs_at(Z: Any, N: Any, n: int, t: float, L: Any) -> int:
    """Signs of the active polynomials at t on a column, as a place in a table."""
    signs = 0
    for i in range(n):
        if jet(Z, LINES + i * len(L), t, L)[0] < 0.0:
            signs |= 1 << N[ACTIVE + i]
    return signs


@inner(error_model="numpy")
def boundary(
    Z: Any, N: Any, surface: Any, n: int, t: float, inside: int, outside: int, e0: int, w: float,
    L: Any,
) -> None:  # fmt: skip
    """Foot at t of the first polynomial whose sign differs on both sides of the surface."""
    for i in range(n):
        k = N[ACTIVE + i]
        if (inside ^ outside) >> k & 1:
            out = 1.0 if inside >> k & 1 else -1.0
            foot(Z, N, surface, i, t, e0, Z[LO + e0], Z[EXT + e0], w, out, L)
            return


@inner(error_model="numpy")
def beyond(Z: Any, N: Any, n: int, t: float, signs: int, L: Any) -> int:
    """Signs beyond an end t of a column: others for polynomials that vanish there."""
    for i in range(n):
        k = N[ACTIVE + i]
        eps = 1e3 * Z[TOL + k]
        if abs(jet(Z, LINES + i * len(L), t, L)[0]) <= eps:
            signs ^= 1 << k
    return signs


@inner(error_model="numpy")
def crowded(
    Z: Any, N: Any, volume: Any, surface: Any, n: int, e0: int, w: float, want: int, q: int, L: Any
) -> None:
    """`column` for any table, and where nothing is known to be monotone: all roots."""
    P = len(L)
    Z[UPRIGHT] = 0.0
    Z[UPRIGHT + 1] = 1.0
    count = 2
    for i in range(n):
        count = roots(Z, LINES + i * P, UPRIGHT, count, STACK, L)
    low = Z[LO + e0]
    high = Z[EXT + e0]
    table = N[TABLE]
    begin = 0.0  # of the solid that is not written yet
    last = -1
    for j in range(count - 1):
        a = Z[UPRIGHT + j]
        b = Z[UPRIGHT + j + 1]
        if b - a <= GAP:
            continue
        signs = signs_at(Z, N, n, 0.5 * (a + b), L)
        before = last if last >= 0 else beyond(Z, N, n, 0.0, signs, L)
        is_in = table >> signs & 1
        was_in = table >> before & 1
        if is_in and (last < 0 or not was_in):
            begin = a
        if last >= 0 and was_in and not is_in and want & VOLUME:
            segment(Z, N, volume, begin, a, e0, low, high, w, q)
        if is_in != was_in and (is_in or last >= 0) and want & SURFACE:
            inside, outside = (signs, before) if is_in else (before, signs)
            boundary(Z, N, surface, n, a, inside, outside, e0, w, L)
        last = signs
    if last >= 0:
        is_in = table >> last & 1
        if is_in and want & VOLUME:
            segment(Z, N, volume, begin, 1.0, e0, low, high, w, q)
        after = beyond(Z, N, n, 1.0, last, L)
        if is_in and not table >> after & 1 and want & SURFACE:
            boundary(Z, N, surface, n, 1.0, last, after, e0, w, L)


@njit(cache=True, error_model="numpy", inline="always")
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
        # The solid is where all are negative: one that rises ends it above, one that falls below.
        if N[UP + i] > 0:
            if first >= 0.0:
                b = -1.0
            elif last > 0.0:
                root = single_root(Z, c, L)
                if root < b:
                    b = root
                    kb = i
            # Zero at the end up to rounding: surface, though there is no root.
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
            # As above, at the lower end.
            elif a == 0.0 and first >= -Z[TOL + N[ACTIVE + i]]:
                ka = i
    # One that is negative nowhere left b = -1; roots the wrong way round leave nothing.
    if a < b:
        if want & VOLUME:
            segment(Z, N, volume, a, b, e0, low, high, w, q)
        if want & SURFACE:
            # Without a polynomial that vanishes there, the segment ends at a side of the box.
            if ka >= 0:
                foot(Z, N, surface, ka, a, e0, low, high, w, 1.0, L)
            if kb >= 0:
                foot(Z, N, surface, kb, b, e0, low, high, w, 1.0, L)


@inner(error_model="numpy")
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


@inner(error_model="numpy")
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

    With `crowd` all roots in columns are looked for. Lines run along the first direction of the
    base, or along the second if it is `turned`.
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
    first, second = (MAX_SETS, 2 * MAX_SETS) if e1 < e2 else (2 * MAX_SETS, MAX_SETS)
    Z[CROSS] = 0.0
    Z[CROSS + 1] = 1.0
    n_cross = 2
    # What columns stand on changes where curves on the ends of the box enter or leave the part:
    # integrands are smooth only between such places.
    for j in range(n_faces):
        for side in range(2):
            edge = face + N[CUT_FACES + j] * square + side * (P - 1) * step1
            for i in range(P):
                Z[TEMP + i] = Z[edge + i * step2]
            n_cross = roots(Z, TEMP, CROSS, n_cross, STACK, L)
    n_cross = add_crossings(Z, N, face, n_faces, turned, n_cross, L)
    for m2 in range(n_cross - 1):
        width2 = Z[CROSS + m2 + 1] - Z[CROSS + m2]
        # Places that coincide but for rounding.
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
            # Along each line of the base, columns change sort where it meets such a curve.
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
            # Normals, and so weights of surfaces, need slopes; volumes do not.
            if want & SURFACE:
                basis_slope(y2, Z, D, L)
                slice_tensors(Z, N, at, n, D, PLANES + MAX_SETS * square, long0, long1, long2, L)
            for m1 in range(n_along - 1):
                width1 = Z[ALONG + m1 + 1] - Z[ALONG + m1]
                # As across.
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
                                s2 += Z[B + j] * Z[PLANES + MAX_SETS * square + i * P + j]
                            Z[LINES + first * P + i] = s1
                            Z[LINES + second * P + i] = s2
                    # Only where all are monotone does a column have one piece of solid.
                    if crowd:
                        crowded(Z, N, volume, surface, n, e0, w1, want, q, L)
                    else:
                        column(Z, N, volume, surface, n, e0, low, high, w1, want, q, L)
