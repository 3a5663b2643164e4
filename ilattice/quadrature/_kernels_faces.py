"""Rules on the part of a face of a cell in the solid, by the same recursion.

Guarantees: as those of the columns. A face on which a polynomial vanishes altogether is in
the solid only if that has both sides of it.
"""

from typing import Any

from ilattice._kernels import inner
from ilattice.bspline._kernels_bernstein import basis, extremes, jet, roots
from ilattice.quadrature._kernels_bases import face_axis, first_part, halve_base
from ilattice.quadrature._kernels_crossings import add_crossings
from ilattice.quadrature._kernels_rules import lengths_from_zero, set_tolerances
from ilattice.quadrature._kernels_scratch import (
    ACTIVE,
    ALONG,
    CAP,
    CROSS,
    CURVES,
    CUT_FACES,
    DIRECTED,
    EXT,
    FACES,
    FLAT,
    GAP,
    HALVED,
    LINE,
    LO,
    LOW,
    N_VOLUME,
    NODES,
    OWNERS,
    PART,
    PARTS,
    SLOTS,
    SOFT_NODES,
    SOFT_WEIGHTS,
    STACK,
    TABLE,
    TEMP,
    TENSORS,
    TOL,
    WEIGHT,
    WEIGHTS,
    B,
    X,
    with_sign,
)


@inner(error_model="numpy")
def emit(Z: Any, N: Any, out: Any, e1: int, a: float, b: float, w: float, q: int) -> None:
    """Gauss points on the part [a, b] of a line of the present box along e1."""
    at = N[N_VOLUME]
    N[N_VOLUME] = at + q
    if at + q <= len(out):
        start = Z[LO + e1] + Z[EXT + e1] * a
        length = Z[EXT + e1] * (b - a)
        for g in range(q):
            for i in range(3):
                out[at + g, i] = Z[X + i]
            out[at + g, e1] = start + length * Z[NODES + g]
            out[at + g, 3] = w * length * Z[WEIGHTS + g]


@inner(error_model="numpy")
def face_strips(
    Z: Any,
    N: Any,
    out: Any,
    face: int,
    n_faces: int,
    e0: int,
    turned: bool,
    soft: bool,
    q: int,
    L: Any,
) -> None:
    """Points on one accepted part of a face, Z[FLAT:]: its lower corner and its extent."""
    P = len(L)
    u = 1 if e0 == 0 else 0
    v = 1 if e0 == 2 else 2
    e1, e2 = (v, u) if turned else (u, v)
    i1, i2 = (1, 0) if turned else (0, 1)
    step1, step2 = (1, P) if turned else (P, 1)
    nodes, weights = (SOFT_NODES, SOFT_WEIGHTS) if soft else (NODES, WEIGHTS)
    Z[CROSS] = 0.0
    Z[CROSS + 1] = 1.0
    n_cross = 2
    # Lines meet other curves beyond where a curve leaves the part by the ends of lines.
    for j in range(n_faces):
        for side in range(2):
            edge = face + N[CUT_FACES + j] * P * P + side * (P - 1) * step1
            for i in range(P):
                Z[TEMP + i] = Z[edge + i * step2]
            n_cross = roots(Z, TEMP, CROSS, n_cross, STACK, L)
    n_cross = add_crossings(Z, N, face, n_faces, turned, n_cross, L)
    for m2 in range(n_cross - 1):
        width = Z[CROSS + m2 + 1] - Z[CROSS + m2]
        if width <= GAP:
            continue
        for g2 in range(q):
            t = Z[CROSS + m2] + width * Z[nodes + g2]
            Z[X + e2] = Z[LO + e2] + Z[EXT + e2] * (Z[FLAT + i2] + Z[FLAT + 2 + i2] * t)
            w = width * Z[weights + g2] * Z[FLAT + 2 + i2] * Z[EXT + e2]
            Z[ALONG] = 0.0
            Z[ALONG + 1] = 1.0
            n_along = 2
            basis(t, Z, B, L)
            for j in range(n_faces):
                c = face + N[CUT_FACES + j] * P * P
                for i in range(P):
                    s = 0.0
                    for r in range(P):
                        s += Z[B + r] * Z[c + i * step1 + r * step2]
                    Z[LINE + j * P + i] = s
                n_along = roots(Z, LINE + j * P, ALONG, n_along, STACK, L)
            for m1 in range(n_along - 1):
                a = Z[ALONG + m1]
                b = Z[ALONG + m1 + 1]
                if b - a <= GAP:
                    continue
                # Between breakpoints no curve changes its sign: the middle tells.
                signs = 0
                for j in range(n_faces):
                    if jet(Z, LINE + j * P, 0.5 * (a + b), L)[0] < 0.0:
                        signs |= 1 << N[OWNERS + j]
                if N[TABLE] >> signs & 1:
                    low = Z[FLAT + i1]
                    high = Z[FLAT + 2 + i1]
                    emit(Z, N, out, e1, low + high * a, low + high * b, w, q)


@inner(error_model="numpy")
def whole_face(Z: Any, N: Any, out: Any, e0: int, side: int, q: int) -> None:
    """Tensor Gauss rule on one face (across e0) of the present box."""
    u = 1 if e0 == 0 else 0
    v = 1 if e0 == 2 else 2
    for i in range(q):
        for j in range(q):
            n = N[N_VOLUME]
            N[N_VOLUME] = n + 1
            if n < len(out):
                out[n, e0] = Z[LO + e0] + side * Z[EXT + e0]
                out[n, u] = Z[LO + u] + Z[EXT + u] * Z[NODES + i]
                out[n, v] = Z[LO + v] + Z[EXT + v] * Z[NODES + j]
                out[n, WEIGHT] = Z[EXT + u] * Z[WEIGHTS + i] * (Z[EXT + v] * Z[WEIGHTS + j])


@inner(error_model="numpy")
def face_rule(
    Z: Any, N: Any, out: Any, m: int, e0: int, side: int, accept: int, q: int, L: Any
) -> None:
    """Rule on one face (across e0) of the cell at the bottom of the stacks in Z."""
    P = len(L)
    square = P * P
    u = 1 if e0 == 0 else 0
    v = 1 if e0 == 2 else 2
    set_tolerances(Z, m, lengths_from_zero(Z), L)
    for k in range(m):
        c = TENSORS + k * P * square + side * (P - 1) * P ** (2 - e0)
        for i in range(P):
            for j in range(P):
                Z[FACES + 2 * k * square + i * P + j] = Z[c + i * P ** (2 - u) + j * P ** (2 - v)]
    Z[X + e0] = Z[LO + e0] + side * Z[EXT + e0]
    first_part(Z)
    whole = N[TABLE]
    N[CURVES] = 1
    level = 0
    while level >= 0:
        here = FACES + level * SLOTS * square
        part = PARTS + PART * level
        table = whole
        n = 0
        for k in range(m):
            least, most = extremes(Z, here + 2 * k * square, square)
            eps = Z[TOL + k]
            # One that is zero all over has solid only where either sign has: on both sides.
            if max(-least, most) <= eps:
                table = with_sign(table, k, False) & with_sign(table, k, True)
            elif least >= -eps or most <= eps:
                table = with_sign(table, k, most <= eps)
            else:
                N[ACTIVE + n] = k
                n += 1
        n_faces = 0
        for i in range(n):
            k = N[ACTIVE + i]
            # Others change sign where the solid does not.
            if ((table >> (1 << k)) ^ table) & LOW[k]:
                N[CUT_FACES + n_faces] = 2 * k
                N[OWNERS + n_faces] = k
                n_faces += 1
        axis = 0
        good = True
        if n_faces:
            axis, good = face_axis(Z, N, here, n_faces, L)
            # As of bases: smaller parts are straighter, those with a direction only `accept` times.
            if not good and (axis < 0 or Z[part + DIRECTED] < accept) and Z[part + HALVED] < CAP:
                halve_base(Z, N, level, 2 * m, n_faces, axis >= 0, L)
                level += 1
                continue
        # Without curves the part is all in the solid, or all outside.
        if n_faces or table != 0:
            for i in range(4):
                Z[FLAT + i] = Z[part + i]
            N[TABLE] = table
            face_strips(Z, N, out, here, n_faces, e0, axis == 1, not good, q, L)
            N[TABLE] = whole
        level -= 1
