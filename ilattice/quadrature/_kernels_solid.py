"""Whether the solid in one box is connected, and where it goes on, from Bernstein coefficients.

A table tells for which signs of the polynomials of a box its points are in the solid: bit b is
that of the signs where just the polynomials of the ones in b are negative. Where all polynomials
must be negative and are monotone along a direction, the solid is as connected as its projection
along it.

Guarantee: what is called empty, full or single is so; anything else is unsure.
"""

from typing import Any

import numpy as np

from ilattice._kernels import inner
from ilattice.bspline._kernels_bernstein import DEEPEST as ROOTS
from ilattice.bspline._kernels_bernstein import halve_line, jet, roots

FAST: Any = {"cache": True, "error_model": "numpy"}
#: What a box is.
EMPTY, FULL, SINGLE, UNSURE = 0, 1, 2, 3
DEPTH = 6  # levels of halving, of faces
TINY = 1e-15  # coefficients below this part of the largest count as zero
#: Bits of a table in which polynomial k is not negative, for up to 6 of them.
LOW = (
    0x5555555555555555, 0x3333333333333333, 0x0F0F0F0F0F0F0F0F, 0x00FF00FF00FF00FF,
    0x0000FFFF0000FFFF, 0x00000000FFFFFFFF,
)  # fmt: skip
CUTS, LINE = 64, 128  # places of lines, and of scratch, behind the cuts of a line


@inner(**FAST)
def one_interval(c: Any, P: int, eps: float) -> bool:
    """Whether a polynomial in one variable is certainly negative on one interval at most."""
    changes = 0
    first = 0
    last = 0
    for i in range(P):
        s = 1 if c[i] > eps else (-1 if c[i] < -eps else 0)
        if s != 0:
            if first == 0:
                first = s
            elif s != last:
                changes += 1
            last = s
    return changes <= 1 or (changes == 2 and first > 0)


@inner(**FAST)
def senses(c: Any, which: Any, n: int, size: int, step: int, P: int, tol: Any, out: Any) -> bool:
    """Senses out (n,) in which polynomials c[which] (size,) are monotone along a stride.

    False if one is not, or one that rises and one that falls may be positive at the same place.
    """
    for i in range(n):
        k = which[i]
        up = True
        down = True
        for j in range(size):
            if (j // step) % P < P - 1:
                d = c[k, j + step] - c[k, j]
                up = up and d >= -tol[k]
                down = down and d <= tol[k]
        if not up and not down:
            return False
        out[i] = 1 if up else -1
    for i in range(n):
        for j in range(i):
            if out[i] != out[j]:
                for s in range(size):
                    if c[which[i], s] + c[which[j], s] >= 0.0:
                        return False
    return True


@inner(**FAST)
def reduced(c: Any, m: int, size: int, tol: Any, table: int, which: Any) -> Any:
    """The part of a table that is possible in a box, and the number of polynomials that matter."""
    for k in range(m):
        least = np.inf
        most = -np.inf
        for j in range(size):
            least = min(least, c[k, j])
            most = max(most, c[k, j])
        if least >= -tol[k] or most <= tol[k]:
            half = (table if least >= -tol[k] else table >> (1 << k)) & LOW[k]
            table = half | (half << (1 << k))
    n = 0
    for k in range(m):
        if ((table >> (1 << k)) & LOW[k]) != (table & LOW[k]):
            which[n] = k
            n += 1
    return table, n


@inner(**FAST)
def signs_asked(table: int, which: Any, n: int, out: Any) -> bool:
    """Factors out (n,), 1 or -1, with which a table asks for negative signs of n polynomials.

    False if it does not ask for one sign of each.
    """
    wanted = -1
    for i in range(n):
        low = LOW[which[i]]
        if table & low == 0:
            out[i] = 1.0
            wanted &= ~low
        else:
            out[i] = -1.0
            wanted &= low
    return bool(wanted == table)


@inner(owning=True, **FAST)
def sort_of(c: Any, m: int, P: int, tol: Any, table: int) -> int:
    """EMPTY, FULL, SINGLE or UNSURE: the solid of polynomials c (m, P³) in a box."""
    dim = 3
    size = P**dim
    which = np.empty(m, np.int64)
    table, n = reduced(c, m, size, tol, table, which)
    if n == 0:
        return FULL if table else EMPTY
    factor = np.empty(n)
    if not signs_asked(table, which, n, factor):
        return UNSURE
    mine = np.empty((n, size))
    eps = np.empty(n)
    for i in range(n):
        mine[i] = factor[i] * c[which[i]]
        eps[i] = tol[which[i]]
        which[i] = i
    sense = np.empty(n, np.int64)
    for axis in range(dim):
        step = P ** (dim - 1 - axis)
        if senses(mine, which, n, size, step, P, eps, sense):
            face = np.empty((n, P ** (dim - 1)))
            for i in range(n):
                side = 0 if sense[i] > 0 else P - 1
                at = 0
                for j in range(size):
                    if (j // step) % P == side:
                        face[i, at] = mine[i, j]
                        at += 1
            found = sort_of_face(face, n, dim - 1, P, eps)
            if found != UNSURE:
                return EMPTY if found == EMPTY else SINGLE
    return UNSURE


@inner(owning=True, **FAST)
def sort_of_face(c: Any, m: int, dim: int, P: int, tol: Any) -> int:
    """`sort_of` of what is left after a projection."""
    size = P**dim
    which = np.empty(m, np.int64)
    table = -1
    for k in range(m):
        table &= ~LOW[k]
    table, n = reduced(c, m, size, tol, table, which)
    if n == 0:
        return FULL if table else EMPTY
    sense = np.empty(n, np.int64)
    edge = np.empty(P)
    for axis in range(dim):
        step = P ** (dim - 1 - axis)
        if dim == 1 or senses(c, which, n, size, step, P, tol, sense):
            good = True
            for i in range(n):
                k = which[i]
                for j in range(P):
                    if dim == 1:
                        edge[j] = c[k, j]
                    else:
                        edge[j] = c[k, (0 if sense[i] > 0 else P - 1) * step + j * (P + 1 - step)]
                good = good and one_interval(edge, P, tol[k])
            if good:
                return SINGLE
    return UNSURE


@inner(owning=True, **FAST)
def split(c: Any, low: Any, high: Any, axis: int, dim: int, P: int) -> None:
    """Halves of polynomials c (m, P^dim) along a direction, by de Casteljau's algorithm."""
    step = P ** (dim - 1 - axis)
    high[:] = c
    for k in range(len(c)):
        for j in range(P**dim):
            if (j // step) % P == 0:
                halve_line(high[k], j, low[k], j, step, range(P))


@inner(owning=True, **FAST)
def divide(c: Any, dim: int, P: int, out: Any) -> None:
    """The 2^dim parts out (., m, P^dim) of a box, the last direction running fastest."""
    out[0] = c
    count = 1
    for axis in range(dim):
        for i in range(count - 1, -1, -1):
            split(out[i].copy(), out[2 * i], out[2 * i + 1], axis, dim, P)
        count *= 2


@inner(**FAST)
def has_solid_corner(c: Any, dim: int, P: int, tol: Any, table: int) -> bool:
    """Whether a corner of a box is certainly solid."""
    for corner in range(1 << dim):
        j = 0
        for axis in range(dim):
            j = j * P + (P - 1) * ((corner >> axis) & 1)
        signs = 0
        for k in range(len(c)):
            if c[k, j] < -tol[k]:
                signs |= 1 << k
        if table >> signs & 1:
            return True
    return False


@inner(owning=True, **FAST)
def is_open(c: Any, axis: int, side: int, P: int, tol: Any, table: int) -> bool:
    """Whether a face of a box may be solid somewhere: not if that is certain after halvings."""
    m = len(c)
    step = P ** (2 - axis)
    stack = np.empty((3 * DEPTH + 4, m, P * P))
    level = np.empty(3 * DEPTH + 4, np.int64)
    at = 0
    for j in range(P * P * P):
        if (j // step) % P == side * (P - 1):
            stack[0, :, at] = c[:, j]
            at += 1
    which = np.empty(m, np.int64)
    parts = np.empty((4, m, P * P))
    level[0] = 0
    top = 1
    while top > 0:
        top -= 1
        here = level[top]
        found, n = reduced(stack[top], m, P * P, tol, table, which)
        if n == 0 and found == 0:
            continue
        if n == 0 or here == DEPTH or has_solid_corner(stack[top], 2, P, tol, table):
            return True
        divide(stack[top].copy(), 2, P, parts)
        for i in range(4):
            stack[top] = parts[i]
            level[top] = here + 1
            top += 1
    return False


@inner(owning=True, **FAST)
def air_between(c: Any, P: int, table: int, best: Any) -> float:
    """Least lengths of air between solid on lines in a box, along each direction, 0 for none.

    In units of the box. Lines go through the middle, or, if there is none on these, along the
    edges: of two pieces of solid that air as good as plane parts, edges join corners. Where three
    corners or more are in this air they may not; it is then as long as the box. Returned is the
    least of the three that is not 0.
    """
    m = len(c)
    best[:] = 0.0
    half = np.zeros(P)  # the Bernstein basis at one half
    half[0] = 1.0
    for r in range(1, P):
        for i in range(r, 0, -1):
            half[i] = 0.5 * (half[i] + half[i - 1])
        half[0] *= 0.5
    L = np.zeros(P, np.int64)
    Z = np.empty(LINE + (P + 2) * (ROOTS + 2))  # cuts, then the lines, then scratch
    for way in range(2):
        for axis in range(3):
            step = P ** (2 - axis)
            first = P * P if axis else P
            second = 1 if axis < 2 else P
            for line in range(4 if way else 1):
                for k in range(m):
                    for i in range(P):
                        v = 0.0
                        if way:
                            v = c[k, i * step + (P - 1) * (line // 2 * first + line % 2 * second)]
                        else:
                            for a in range(P):
                                for b in range(P):
                                    v += half[a] * half[b] * c[k, i * step + a * first + b * second]
                        Z[CUTS + k * P + i] = v
                air = air_on(Z, m, P, table, L)
                if air > 0.0 and (best[axis] == 0.0 or air < best[axis]):
                    best[axis] = air
        if best.max() > 0.0:
            break
    if best.max() == 0.0 and apart(c, P, table):
        best[:] = 1.0
    least = 0.0
    for axis in range(3):
        if best[axis] > 0.0 and (least == 0.0 or best[axis] < least):
            least = best[axis]
    return least


@inner(owning=True, **FAST)
def apart(c: Any, P: int, table: int) -> bool:
    """Whether corners of a box that are solid are not joined by edges between such."""
    tol = tolerances(c)
    group = np.full(8, -1)
    for corner in range(8):
        j = 0
        for axis in range(3):
            j = j * P + (P - 1) * ((corner >> axis) & 1)
        signs = 0
        for k in range(len(c)):
            if c[k, j] < -tol[k]:
                signs |= 1 << k
        if table >> signs & 1:
            group[corner] = corner
    for _ in range(7):
        for corner in range(8):
            for axis in range(3):
                other = corner ^ (1 << axis)
                if group[corner] >= 0 and group[other] >= 0:
                    group[corner] = group[other] = min(group[corner], group[other])
    return group.max() >= 0 and (group[group >= 0] != group.max()).any()


@inner(**FAST)
def air_on(Z: Any, m: int, P: int, table: int, L: Any) -> float:
    """Least length of air between solid on a line, of which the polynomials are in Z."""
    Z[0] = 0.0
    Z[1] = 1.0
    n = 2
    for k in range(m):
        n = roots(Z, CUTS + k * P, 0, n, LINE, L)
    best = 0.0
    air = 0.0
    state = 0  # nothing, solid, air after solid
    for s in range(n - 1):
        signs = 0
        for k in range(m):
            if jet(Z, CUTS + k * P, 0.5 * (Z[s] + Z[s + 1]), L)[0] < 0.0:
                signs |= 1 << k
        if table >> signs & 1:
            if state == 2 and (best == 0.0 or air < best):
                best = air
            state = 1
            air = 0.0
        elif state > 0:
            state = 2
            air += Z[s + 1] - Z[s]
    return best


@inner(owning=True, **FAST)
def tolerances(c: Any) -> Any:
    """What counts as zero of polynomials c (m, size)."""
    tol = np.empty(len(c))
    for k in range(len(c)):
        tol[k] = TINY * np.abs(c[k]).max()
    return tol
