"""Height-function recursion on Bernstein coefficients: rules on {all polynomials < 0} in a cell.

A box in which every polynomial has a certain sign is full or empty. One in which all others are
monotone along a direction is integrated in columns along it; any other is halved.

Guarantees: as those of the columns. A box whose sign is certain from the coefficients is never
looked at through samples. Up to two polynomials of one degree, 1 to 4.
"""

from typing import Any

from numba import njit

from ilattice.cutfem._kernels_bernstein import bend, extremes, halve, slopes
from ilattice.cutfem._kernels_columns import (
    ACTIVE,
    BOXES,
    CAP,
    EXT,
    INNER,
    LO,
    N_VOLUME,
    NODES,
    SHARE,
    SPANS,
    SURFACE,
    TENSORS,
    TOL,
    UNSURE,
    UP,
    VOLUME,
    WEIGHTS,
    base,
    best_axis,
    no_common_zero,
)

TINY = 1e-15  # coefficients below this part of the largest count as zero


@njit(**INNER)
def touches(c: Any, at: int, eps: float, L: Any) -> bool:
    """Whether a tensor vanishes on one of its faces."""
    P = len(L)
    found = False
    for axis in range(3):
        step = P ** (2 - axis)
        other = P * P if axis else P
        third = 1 if axis < 2 else P
        for side in range(2):
            i = at + side * (P - 1) * step
            zero = True
            for a in range(P):
                for b in range(P):
                    zero = zero and abs(c[i + a * other + b * third]) <= eps
            found = found or zero
    return found


@njit(**INNER)
def height_axis(Z: Any, N: Any, at: int, n: int, L: Any) -> Any:
    """`best_axis` of the n active tensors of those at `at`."""
    P = len(L)
    for i in range(n):
        c = at + N[ACTIVE + i] * P * P * P
        for axis in range(3):
            step = P ** (2 - axis)
            low, high = slopes(Z, c, step, P * P if axis else P, 1 if axis < 2 else P, P, L)
            Z[SPANS + axis * 8 + i * 2] = low
            Z[SPANS + axis * 8 + i * 2 + 1] = high
    return best_axis(Z, N, 3, n, ACTIVE, UP)


@njit(**INNER)
def steepest_axis(Z: Any, n: int) -> int:
    """Direction of the largest difference."""
    best = 0
    top = -1.0
    for axis in range(3):
        for i in range(n):
            at = SPANS + axis * 8 + i * 2
            size = max(Z[at + 1], -Z[at])
            if size > top:
                top = size
                best = axis
    return best


@njit(**INNER)
def solid(Z: Any, N: Any, volume: Any, q: int) -> None:
    """Tensor Gauss rule on the present box."""
    n = N[N_VOLUME]
    N[N_VOLUME] = n + q * q * q
    if n + q * q * q <= len(volume):
        for i in range(q):
            x = Z[LO] + Z[EXT] * Z[NODES + i]
            wx = Z[EXT] * Z[WEIGHTS + i]
            for j in range(q):
                y = Z[LO + 1] + Z[EXT + 1] * Z[NODES + j]
                wy = wx * (Z[EXT + 1] * Z[WEIGHTS + j])
                for k in range(q):
                    volume[n, 0] = x
                    volume[n, 1] = y
                    volume[n, 2] = Z[LO + 2] + Z[EXT + 2] * Z[NODES + k]
                    volume[n, 3] = wy * (Z[EXT + 2] * Z[WEIGHTS + k])
                    n += 1


@njit(**INNER)
def halve_box(Z: Any, N: Any, level: int, m: int, n: int, directed: bool, L: Any) -> None:
    """Halve a box along its most curved direction: upper half here, lower half above."""
    P = len(L)
    cube = P * P * P
    here = TENSORS + level * m * cube
    cut = 0
    top = 0.0
    for axis in range(3):
        step = P ** (2 - axis)
        for i in range(n):
            c = here + N[ACTIVE + i] * cube
            size = bend(Z, c, step, P * P if axis else P, 1 if axis < 2 else P, P, L)
            if size > top * (1.0 + 1e-9):
                top = size
                cut = axis
    step = P ** (2 - cut)
    for k in range(m):
        c = here + k * cube
        halve(Z, c, c + m * cube, step, P * P if cut else P, 1 if cut < 2 else P, P, L)
    box = BOXES + 8 * level
    Z[box + 6] += 1.0
    if directed:
        Z[box + 7] += 1.0
    Z[box + 3 + cut] *= 0.5
    for i in range(8):
        Z[box + 8 + i] = Z[box + i]
    Z[box + cut] += Z[box + 3 + cut]


@njit(**INNER)
def set_tolerances(Z: Any, m: int, L: Any) -> None:
    """What counts as zero of each of the m tensors at the bottom of the stack."""
    cube = len(L) * len(L) * len(L)
    for k in range(m):
        least, most = extremes(Z, TENSORS + k * cube, cube)
        Z[TOL + k] = TINY * max(-least, most)


@njit(**INNER)
def corners_differ(Z: Any, m: int, L: Any) -> bool:
    """Whether a corner of the cell at the bottom of the stack is inside, and another outside."""
    P = len(L)
    inside = False
    outside = False
    for corner in range(8):
        i = (corner // 4 * P * P + corner // 2 % 2 * P + corner % 2) * (P - 1)
        below = True
        for k in range(m):
            v = Z[TENSORS + k * P * P * P + i]
            below = below and v < -Z[TOL + k]
            outside = outside or v > Z[TOL + k]
        inside = inside or below
    return inside and outside


@njit(**INNER)
def cell_sign(Z: Any, N: Any, m: int, halvings: int, L: Any) -> int:
    """-1 if the cell at the bottom of the stack is certainly full, 1 if empty, 0 otherwise.

    Boxes whose sign is not certain are halved at most so many times.
    """
    P = len(L)
    cube = P * P * P
    set_tolerances(Z, m, L)
    if corners_differ(Z, m, L):
        return 0
    Z[BOXES + 6] = 0.0
    full = False
    void = False
    sure = True
    level = 0
    while level >= 0 and sure and not (full and void):
        here = TENSORS + level * m * cube
        n = 0
        empty = False
        for k in range(m):
            least, most = extremes(Z, here + k * cube, cube)
            empty = empty or least >= -Z[TOL + k]
            if most > Z[TOL + k]:
                N[ACTIVE + n] = k
                n += 1
        if empty:
            void = True
            level -= 1
        elif n == 0:
            full = True
            level -= 1
        elif Z[BOXES + 8 * level + 6] < halvings:
            halve_box(Z, N, level, m, n, False, L)
            level += 1
        else:
            sure = False
    if not sure or full == void:
        return 0
    return -1 if full else 1


@njit(**INNER)
def cell_rule(
    Z: Any, N: Any, volume: Any, surface: Any, m: int, accept: int, want: int, q: int, L: Any
) -> None:
    """Rules on the cell Z[LO:], Z[EXT:] with the tensors at the bottom of their stack."""
    P = len(L)
    cube = P * P * P
    set_tolerances(Z, m, L)
    for i in range(6):
        Z[BOXES + i] = Z[LO + i]
    Z[BOXES + 6] = 0.0
    Z[BOXES + 7] = 0.0
    level = 0
    while level >= 0:
        here = TENSORS + level * m * cube
        for i in range(6):
            Z[LO + i] = Z[BOXES + 8 * level + i]
        n = 0
        empty = False
        for k in range(m):
            c = here + k * cube
            least, most = extremes(Z, c, cube)
            eps = Z[TOL + k]
            empty = empty or least >= -eps
            if most > eps or (want & SURFACE and most >= -eps and touches(Z, c, eps, L)):
                N[ACTIVE + n] = k
                n += 1
        if not empty and n == 0 and want & VOLUME:
            solid(Z, N, volume, q)
        if not empty and n:
            axis, score = height_axis(Z, N, here, n, L)
            good = score >= SHARE
            if good and n == 2:
                good = no_common_zero(Z, here, here + cube, cube)
            box = BOXES + 8 * level
            if not good and (axis < 0 or Z[box + 7] < accept) and Z[box + 6] < CAP:
                halve_box(Z, N, level, m, n, axis >= 0, L)
                level += 1
                continue
            N[UNSURE] = 1
            crowd = axis < 0
            if crowd:
                axis = steepest_axis(Z, n)
            base(Z, N, volume, surface, here, n, axis, not good, crowd, accept, want, q, L)
        level -= 1
