"""Height-function recursion on Bernstein coefficients: rules on the solid in a cell.

A box in which every polynomial has a certain sign is full or empty. One in which all others are
monotone along a direction is integrated in columns along it; any other is halved.

Guarantees: as those of the columns. A box whose sign is certain from the coefficients is never
looked at through samples. Up to six polynomials of one degree, 1 to 4, with a table of the signs
that are solid (see `_kernels_scratch`).
"""

from typing import Any

from ilattice._kernels import inner
from ilattice.bspline._kernels_bernstein import bend, extremes, halve, slopes, straight
from ilattice.quadrature._kernels_bases import base, best_axis
from ilattice.quadrature._kernels_crossings import project_seams, rising
from ilattice.quadrature._kernels_pairs import pair_axis
from ilattice.quadrature._kernels_quadrics import column_axes, is_quadric, quadric_rule
from ilattice.quadrature._kernels_scratch import (
    ACTIVE,
    BOX,
    BOX_DIRECTED,
    BOX_HALVED,
    BOXES,
    CAP,
    EMIT,
    EXT,
    LO,
    LOW,
    MIN_SLOPE,
    N_VOLUME,
    NODES,
    PROJECT,
    ROW,
    SEAMS,
    SPANS,
    SURFACE,
    TABLE,
    TENSORS,
    TINY,
    TOL,
    UNSURE,
    UP,
    VOLUME,
    WEIGHT,
    WEIGHTS,
    with_sign,
)


@inner(error_model="numpy")
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


@inner(error_model="numpy")
def height_axis(Z: Any, N: Any, at: int, n: int, flat: bool, L: Any) -> Any:
    """`best_axis` of the n active tensors of those at `at`."""
    P = len(L)
    for i in range(n):
        c = at + N[ACTIVE + i] * P * P * P
        for axis in range(3):
            step = P ** (2 - axis)
            low, high = slopes(Z, c, step, P * P if axis else P, 1 if axis < 2 else P, P, L)
            Z[SPANS + axis * ROW + i * 2] = low
            Z[SPANS + axis * ROW + i * 2 + 1] = high
    return best_axis(Z, N, 3, n, ACTIVE, UP, flat)


@inner(error_model="numpy")
def all_rise(Z: Any, N: Any, n: int) -> bool:
    """Whether each active polynomial depends on some direction in which all are monotone."""
    found = 0
    wanted = 0
    for axis in range(3):
        found |= rising(Z, N, n, axis)
    for i in range(n):
        wanted |= 1 << N[ACTIVE + i]
    return found == wanted


@inner(error_model="numpy")
def shares(Z: Any, N: Any, n: int) -> Any:
    """Bits of the active polynomials whose least slope is largest along each direction.

    Of directions in which all are monotone.
    """
    rise0 = rising(Z, N, n, 0)
    rise1 = rising(Z, N, n, 1)
    rise2 = rising(Z, N, n, 2)
    out0, out1, out2 = 0, 0, 0
    for i in range(n):
        bit = 1 << N[ACTIVE + i]
        best = -1
        top = -1.0
        for axis in range(3):
            rise = rise0 if axis == 0 else rise1 if axis == 1 else rise2
            at = SPANS + axis * ROW + i * 2
            slope = max(max(Z[at], -Z[at + 1]), 0.0)
            if rise & bit and slope > top:
                top = slope
                best = axis
        out0 |= bit if best == 0 else 0
        out1 |= bit if best == 1 else 0
        out2 |= bit if best == 2 else 0
    return out0, out1, out2


@inner(error_model="numpy")
def surfaces_by_axes(
    Z: Any, N: Any, volume: Any, surface: Any, here: int, n: int, soft: bool, accept: int, q: int,
    L: Any,
) -> None:  # fmt: skip
    """Feet of polynomials on columns in all directions, each polynomial in the one of `shares`.

    For those of which some do not depend on a direction, as the sides of boxes along the axes.
    """
    mine0, mine1, mine2 = shares(Z, N, n)
    for axis in range(3):
        mine = mine0 if axis == 0 else mine1 if axis == 1 else mine2
        if mine:
            height_axis(Z, N, here, n, True, L)
            N[EMIT] = mine
            project_seams(Z, N, here, n, axis, L)
            base(Z, N, volume, surface, here, n, axis, soft, True, accept, SURFACE, q, L)
    N[EMIT] = -1


@inner(error_model="numpy")
def bent(Z: Any, N: Any, here: int, n: int, L: Any) -> bool:
    """Whether an active polynomial is not linear: planes have no square roots at their ends."""
    P = len(L)
    for i in range(n):
        k = N[ACTIVE + i]
        if not straight(Z, here + k * P * P * P, P * P, P, 1, P, Z[TOL + k], L):
            return True
    return False


@inner(error_model="numpy")
def steepest_axis(Z: Any, n: int) -> int:
    """Direction of the largest difference."""
    best = 0
    top = -1.0
    for axis in range(3):
        for i in range(n):
            at = SPANS + axis * ROW + i * 2
            size = max(Z[at + 1], -Z[at])
            if size > top:
                top = size
                best = axis
    return best


@inner(error_model="numpy")
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
                    volume[n, WEIGHT] = wy * (Z[EXT + 2] * Z[WEIGHTS + k])
                    n += 1


@inner(error_model="numpy")
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
    box = BOXES + BOX * level
    Z[box + BOX_HALVED] += 1.0
    if directed:
        Z[box + BOX_DIRECTED] += 1.0
    Z[box + 3 + cut] *= 0.5
    for i in range(BOX):
        Z[box + BOX + i] = Z[box + i]
    Z[box + cut] += Z[box + 3 + cut]


@inner(error_model="numpy")
def set_tolerances(Z: Any, m: int, far: float, L: Any) -> None:
    """What counts as zero of each of the m tensors at the bottom of the stack.

    Tensors that are interpolated are off by the rounding of places `far` lengths of the box away.
    """
    cube = len(L) * len(L) * len(L)
    for k in range(m):
        least, most = extremes(Z, TENSORS + k * cube, cube)
        Z[TOL + k] = TINY * far * max(-least, most)


@inner(error_model="numpy")
def lengths_from_zero(Z: Any) -> float:
    """How far the present box is from zero, in its own lengths, and at least a few of them."""
    far = 0.0
    for axis in range(3):
        far = max(far, abs(Z[LO + axis]) / Z[EXT + axis])
    return far + 4.0


@inner(error_model="numpy")
def corners_differ(Z: Any, N: Any, m: int, L: Any) -> bool:
    """Whether a corner of the cell at the bottom of the stack is inside, and another outside."""
    P = len(L)
    inside = False
    outside = False
    for corner in range(8):
        i = (corner // 4 * P * P + corner // 2 % 2 * P + corner % 2) * (P - 1)
        surely = 0
        perhaps = 0
        for k in range(m):
            v = Z[TENSORS + k * P * P * P + i]
            if v < -Z[TOL + k]:
                surely |= 1 << k
            if v <= Z[TOL + k]:
                perhaps |= 1 << k
        first = N[TABLE] >> surely & 1
        second = N[TABLE] >> perhaps & 1
        inside = inside or (first == 1 and second == 1)
        outside = outside or (first == 0 and second == 0)
    return inside and outside


@inner(error_model="numpy")
def choose(Z: Any, N: Any, here: int, m: int, table: int, want: int, L: Any) -> Any:
    """Table of a box, and the number of polynomials whose signs matter there; they are ACTIVE.

    For a rule on surfaces those that vanish on a face of the solid matter, too.
    """
    cube = len(L) * len(L) * len(L)
    n = 0
    for k in range(m):
        least, most = extremes(Z, here + k * cube, cube)
        eps = Z[TOL + k]
        if least >= -eps:
            touching = want & SURFACE != 0 and least <= eps and with_sign(table, k, False) != 0
        else:
            touching = want & SURFACE != 0 and most >= -eps
        crosses = least < -eps and most > eps
        if crosses or (touching and touches(Z, here + k * cube, eps, L)):
            N[ACTIVE + n] = k
            n += 1
        else:
            table = with_sign(table, k, least < -eps)
    count = 0
    for i in range(n):
        k = N[ACTIVE + i]
        if ((table >> (1 << k)) ^ table) & LOW[k]:
            N[ACTIVE + count] = k
            count += 1
    return table, count


@inner(error_model="numpy")
def cell_sign(Z: Any, N: Any, m: int, halvings: int, L: Any) -> int:
    """-1 if the cell at the bottom of the stack is certainly full, 1 if empty, 0 otherwise.

    Its table is N[TABLE]. Boxes whose sign is not certain are halved at most so many times.
    """
    P = len(L)
    cube = P * P * P
    set_tolerances(Z, m, 1.0, L)
    if corners_differ(Z, N, m, L):
        return 0
    Z[BOXES + BOX_HALVED] = 0.0
    full = False
    void = False
    sure = True
    level = 0
    while level >= 0 and sure and not (full and void):
        here = TENSORS + level * m * cube
        table, n = choose(Z, N, here, m, N[TABLE], 0, L)
        if n == 0:
            if table == 0:
                void = True
            else:
                full = True
            level -= 1
        elif Z[BOXES + BOX * level + BOX_HALVED] < halvings:
            halve_box(Z, N, level, m, n, False, L)
            level += 1
        else:
            sure = False
    if not sure or full == void:
        return 0
    return -1 if full else 1


@inner(error_model="numpy")
def cell_rule(
    Z: Any, N: Any, volume: Any, surface: Any, m: int, accept: int, want: int, q: int, L: Any
) -> None:
    """Rules on the cell Z[LO:], Z[EXT:] with the tensors at the bottom of their stack.

    Its table is N[TABLE].
    """
    P = len(L)
    cube = P * P * P
    whole = N[TABLE]
    N[EMIT] = -1
    set_tolerances(Z, m, lengths_from_zero(Z), L)
    for i in range(6):
        Z[BOXES + i] = Z[LO + i]
    Z[BOXES + BOX_HALVED] = 0.0
    Z[BOXES + BOX_DIRECTED] = 0.0
    level = 0
    while level >= 0:
        here = TENSORS + level * m * cube
        for i in range(6):
            Z[LO + i] = Z[BOXES + BOX * level + i]
        table, n = choose(Z, N, here, m, whole, want, L)
        # No sign matters in the box: it is full, unless its table is empty.
        if n == 0 and table != 0 and want & VOLUME:
            solid(Z, N, volume, q)
        if n:
            axis, score = height_axis(Z, N, here, n, False, L)
            flat = axis < 0 and n > 1 and N[PROJECT] == 1
            if flat:
                axis, score = height_axis(Z, N, here, n, True, L)
                # Each needs feet along a direction that it depends on and all are monotone in.
                if want & SURFACE and not all_rise(Z, N, n):
                    axis = -1
                flat = axis >= 0
            good = score >= MIN_SLOPE and axis >= 0
            N[SEAMS] = 0
            # Quadrics have rules of their own, which need no monotone direction.
            if n == 1 and not good:
                k = N[ACTIVE]
                e0, e1 = -1, -1
                if is_quadric(Z, here + k * cube, Z[TOL + k], L):
                    e0, e1 = column_axes(Z)
                if e0 >= 0:
                    N[UNSURE] = 1
                    negative = with_sign(table, k, True) != 0
                    quadric_rule(Z, N, volume, surface, e0, e1, negative, want, q)
                    level -= 1
                    continue
            pair = -1
            # With two well parted roots on every line, it need not be halved either.
            if axis < 0 and n == 1:
                pair = pair_axis(Z, here + N[ACTIVE] * cube, Z[TOL + N[ACTIVE]], L)
            # Columns end on another polynomial beyond a seam, so that the base is divided there.
            if n > 1 and axis >= 0:
                good = project_seams(Z, N, here, n, axis, L) and good
            box = BOXES + BOX * level
            small = Z[box + BOX_HALVED] >= CAP or (axis >= 0 and Z[box + BOX_DIRECTED] >= accept)
            # Smaller boxes are straighter; those with a direction are halved `accept` times only.
            if not good and pair < 0 and not small:
                halve_box(Z, N, level, m, n, axis >= 0, L)
                level += 1
                continue
            N[UNSURE] = 1
            crowd = axis < 0
            # Nothing is monotone: pairs of roots, or a box too small to halve; all roots count.
            if crowd:
                axis = pair if pair >= 0 else steepest_axis(Z, n)
            N[TABLE] = table
            soft = not good and pair < 0 and bent(Z, N, here, n, L)
            # Polynomials that do not depend on the height have no feet along it.
            if flat and want & SURFACE:
                surfaces_by_axes(Z, N, volume, surface, here, n, soft, accept, q, L)
            else:
                base(
                    Z,
                    N,
                    volume,
                    surface,
                    here,
                    n,
                    axis,
                    soft,
                    crowd or flat,
                    accept,
                    want,
                    q,
                    L,
                )
        level -= 1
    N[TABLE] = whole
