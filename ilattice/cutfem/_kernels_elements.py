"""Connected pieces of the solid inside a cell, from Bernstein coefficients.

A table tells for which signs of the polynomials of a box its points are in the solid: bit b is
that of the signs where just the polynomials of the ones in b are negative. A box is left as it is
if it is empty, full, or its solid is certainly connected: where all polynomials must be negative
and are monotone along a direction, the solid is as connected as its projection along it. Any other
box is divided into eight. Boxes hang together through the faces they share, unless these are
certainly empty.

Guarantees: pieces that are told apart are apart; the same numbers for any number of threads.
Non-guarantee: boxes of the last level that are still not certain count as connected.
"""

from typing import Any

import numpy as np
from numba import njit, prange

from ilattice.cutfem._kernels_bernstein import DEEPEST as ROOTS
from ilattice.cutfem._kernels_bernstein import jet, roots

FAST: Any = {"cache": True, "error_model": "numpy"}
EMPTY, FULL, SINGLE, UNSURE = 0, 1, 2, 3
UNIT = 1 << 17  # length of a piece of splines, or of a cell with boxes of its own
LEAST = UNIT >> 5  # boxes of this length are divided no further
DEPTH = 6  # levels of halving, of faces
MOST = 2048  # boxes of a cell, from which on none is divided further
TINY = 1e-15  # coefficients below this part of the largest count as zero
#: Bits of a table in which polynomial k is not negative, for up to 6 of them.
LOW = (
    0x5555555555555555, 0x3333333333333333, 0x0F0F0F0F0F0F0F0F, 0x00FF00FF00FF00FF,
    0x0000FFFF0000FFFF, 0x00000000FFFFFFFF,
)  # fmt: skip
CUTS, LINE = 64, 128  # places of lines, and of scratch, behind the cuts of a line


@njit(**FAST)
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


@njit(**FAST)
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


@njit(**FAST)
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


@njit(**FAST)
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


@njit(**FAST)
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


@njit(**FAST)
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


@njit(**FAST)
def split(c: Any, low: Any, high: Any, axis: int, dim: int, P: int) -> None:
    """Halves of polynomials c (m, P^dim) along a direction, by de Casteljau's algorithm."""
    step = P ** (dim - 1 - axis)
    line = np.empty(P)
    for k in range(len(c)):
        for j in range(P**dim):
            if (j // step) % P == 0:
                for i in range(P):
                    line[i] = c[k, j + i * step]
                low[k, j] = line[0]
                high[k, j + (P - 1) * step] = line[P - 1]
                for r in range(1, P):
                    for i in range(P - r):
                        line[i] = 0.5 * (line[i] + line[i + 1])
                    low[k, j + r * step] = line[0]
                    high[k, j + (P - 1 - r) * step] = line[P - 1 - r]


@njit(**FAST)
def divide(c: Any, dim: int, P: int, out: Any) -> None:
    """The 2^dim parts out (., m, P^dim) of a box, the last direction running fastest."""
    out[0] = c
    count = 1
    for axis in range(dim):
        for i in range(count - 1, -1, -1):
            split(out[i].copy(), out[2 * i], out[2 * i + 1], axis, dim, P)
        count *= 2


@njit(**FAST)
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


@njit(**FAST)
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


@njit(**FAST)
def air_between(c: Any, P: int, table: int) -> float:
    """Least length of air between solid on lines through the middle of a box, 0 if there is none.

    In units of the box, along one of the three directions.
    """
    m = len(c)
    best = 0.0
    half = np.zeros(P)  # the Bernstein basis at one half
    half[0] = 1.0
    for r in range(1, P):
        for i in range(r, 0, -1):
            half[i] = 0.5 * (half[i] + half[i - 1])
        half[0] *= 0.5
    L = np.zeros(P, np.int64)
    Z = np.empty(LINE + (P + 2) * (ROOTS + 2))  # cuts, then the lines, then scratch
    for axis in range(3):
        step = P ** (2 - axis)
        first = P * P if axis else P
        second = 1 if axis < 2 else P
        Z[0] = 0.0
        Z[1] = 1.0
        n = 2
        for k in range(m):
            at = CUTS + k * P
            for i in range(P):
                v = 0.0
                for a in range(P):
                    for b in range(P):
                        v += half[a] * half[b] * c[k, i * step + a * first + b * second]
                Z[at + i] = v
            n = roots(Z, at, 0, n, LINE, L)
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


@njit(**FAST)
def tolerances(c: Any) -> Any:
    """What counts as zero of polynomials c (m, size)."""
    tol = np.empty(len(c))
    for k in range(len(c)):
        tol[k] = TINY * np.abs(c[k]).max()
    return tol


@njit(**FAST)
def boxes_of(c: Any, tables: Any, which: Any, start: Any, extent: Any, P: int) -> Any:
    """Boxes of a cell that are not empty.

    At first these are the boxes from `start` (n, 3) on, of lengths `extent` (n, 3), with the
    polynomials c[which[i]], or full for which[i] < 0. Returned are lower corners, lengths, sorts,
    the rows of their tables, polynomials, and the air between solid in boxes that are not certain.
    """
    m = c.shape[1]
    size = P * P * P
    room = 64
    corner = np.empty((room, 3), np.int64)
    length = np.empty((room, 3), np.int64)
    sort = np.empty(room, np.int64)
    row = np.empty(room, np.int64)
    tensor = np.empty((room, m, size))
    air = np.zeros(room)
    stack = np.empty((7 * DEPTH + 8, m, size))
    at = np.empty((7 * DEPTH + 8, 3), np.int64)
    long = np.empty((7 * DEPTH + 8, 3), np.int64)
    tol = np.empty(m)
    parts = np.empty((8, m, size))
    n = 0
    for piece in range(len(start)):
        long[0] = extent[piece]
        at[0] = start[piece]
        k = which[piece]
        if k >= 0:
            stack[0] = c[k]
            tol = tolerances(c[k])
        top = 1
        while top > 0:
            top -= 1
            found = FULL if k < 0 else sort_of(stack[top], m, P, tol, tables[k])
            if found == EMPTY:
                continue
            if found == UNSURE and long[top].max() > LEAST and n < MOST:
                divide(stack[top].copy(), 3, P, parts)
                x, y, z = at[top]
                a, b, d = long[top] // 2
                for i in range(8):
                    stack[top] = parts[i]
                    at[top, 0] = x + a * (i // 4)
                    at[top, 1] = y + b * (i // 2 % 2)
                    at[top, 2] = z + d * (i % 2)
                    long[top, 0] = a
                    long[top, 1] = b
                    long[top, 2] = d
                    top += 1
                continue
            if n == room:
                room *= 4
                corner = grown(corner, room)
                length = grown(length, room)
                sort = grown(sort, room)
                row = grown(row, room)
                tensor = grown(tensor, room)
                air = grown(air, room)
            corner[n] = at[top]
            length[n] = long[top]
            sort[n] = found
            row[n] = k
            air[n] = 0.0
            if found != FULL:
                tensor[n] = stack[top]
            if found == UNSURE:
                air[n] = long[top].max() * air_between(stack[top], P, tables[k])
            n += 1
    return corner[:n], length[:n], sort[:n], row[:n], tensor[:n], air[:n]


@njit(**FAST)
def grown(a: Any, room: int) -> Any:
    """A longer copy of an array."""
    out = np.empty((room, *a.shape[1:]), a.dtype)
    out[: len(a)] = a
    return out


@njit(**FAST)
def root(parent: Any, i: int) -> int:
    """Representative of a set."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(**FAST)
def meeting(corner: Any, length: Any, i: int, j: int) -> int:
    """Face of box i, 2 axis + side, that a part of a face of box j touches, or -1."""
    for axis in range(3):
        a = (axis + 1) % 3
        b = (axis + 2) % 3
        low = max(corner[i, a], corner[j, a])
        left = max(corner[i, b], corner[j, b])
        if (
            min(corner[i, a] + length[i, a], corner[j, a] + length[j, a]) > low
            and min(corner[i, b] + length[i, b], corner[j, b] + length[j, b]) > left
        ):
            if corner[i, axis] + length[i, axis] == corner[j, axis]:
                return 2 * axis + 1
            if corner[j, axis] + length[j, axis] == corner[i, axis]:
                return 2 * axis
    return -1


@njit(**FAST)
def join(parent: Any, i: int, j: int) -> None:
    """Make one set of two."""
    a = root(parent, i)
    b = root(parent, j)
    parent[max(a, b)] = min(a, b)


@njit(**FAST)
def pieces_of(c: Any, tables: Any, which: Any, start: Any, extent: Any, P: int) -> Any:
    """Boxes of a cell (corners, lengths), the piece of each, the number of pieces, and a gap.

    The gap is the width, in units of `UNIT`, of air that is too thin to be seen as such
    everywhere, but would divide a piece; 0 if there is none.
    """
    corner, length, sort, row, tensor, air = boxes_of(c, tables, which, start, extent, P)
    n = len(sort)
    parent = np.arange(n)
    firm = np.arange(n)  # without boxes that have air between solid
    for i in range(n):
        for j in range(i):
            if root(parent, i) == root(parent, j) and root(firm, i) == root(firm, j):
                continue
            face = meeting(corner, length, i, j)
            if face < 0:
                continue
            axis = face // 2
            side = face % 2
            small = i
            if length[j].prod() * length[i, axis] < length[i].prod() * length[j, axis]:
                small = j
                side = 1 - side
            if sort[small] == FULL or is_open(
                tensor[small], axis, side, P, tolerances(tensor[small]), tables[row[small]]
            ):
                join(parent, i, j)
                if air[i] == 0.0 and air[j] == 0.0:
                    join(firm, i, j)
    label = np.full(n, -1)
    count = 0
    for i in range(n):
        if root(parent, i) == i:
            label[i] = count
            count += 1
    seen = np.full(n, -1)  # per piece, one set of boxes with solid that holds without thin air
    divided = -1
    for i in range(n):
        k = label[root(parent, i)]
        label[i] = k
        if air[i] == 0.0 and (
            sort[i] == FULL
            or has_solid_corner(tensor[i], 3, P, tolerances(tensor[i]), tables[row[i]])
        ):
            if seen[k] < 0:
                seen[k] = root(firm, i)
            elif seen[k] != root(firm, i):
                divided = k
    thin = 0.0
    for i in range(n):
        if label[i] == divided and air[i] > 0.0 and (thin == 0.0 or air[i] < thin):
            thin = air[i]
    return corner, length, label, count, thin / UNIT


@njit(parallel=True, **FAST)
def count_pieces(
    c: Any, tables: Any, which: Any, start: Any, extent: Any, offsets: Any, P: int, counts: Any,
    gaps: Any,
) -> None:  # fmt: skip
    """Numbers of pieces, and gaps, of cells with the boxes from offsets[i] on; see `boxes_of`."""
    for i in prange(len(counts)):
        part = slice(offsets[i], offsets[i + 1])
        mine = which[part]
        k = mine[0] if len(mine) == 1 else -1
        if len(mine) == 1 and (
            k < 0 or sort_of(c[k], c.shape[1], P, tolerances(c[k]), tables[k]) < UNSURE
        ):
            counts[i] = 1
            gaps[i] = 0.0
        else:
            found = pieces_of(c, tables, mine, start[part], extent[part], P)
            counts[i] = found[3]
            gaps[i] = found[4]


@njit(parallel=True, **FAST)
def labels_at(
    x: Any, cell: Any, offsets: Any, corner: Any, length: Any, label: Any, out: Any
) -> None:
    """Label of the box that holds, or is nearest to, every point x (n, 3) of a cell."""
    for q in prange(len(x)):
        best = np.inf
        for i in range(offsets[cell[q]], offsets[cell[q] + 1]):
            far = 0.0
            for a in range(3):
                d = max(max(corner[i, a] - x[q, a], x[q, a] - corner[i, a] - length[i, a]), 0.0)
                far += d * d
            if far < best:
                best = far
                out[q] = label[i]
