"""Connected pieces of the solid inside a cell, from Bernstein coefficients.

A box is left as it is if it is empty, full, or its solid is certainly connected. Any other box is
divided into eight. Boxes hang together through the faces they share, unless these are certainly
empty.

Guarantees: pieces that are told apart are apart; the same numbers for any number of threads.
Non-guarantee: boxes of the last level that are still not certain count as connected.
"""

from typing import Any

import numpy as np

from ilattice._kernels import in_ranges, inner, outer
from ilattice._kernels_tuples import borrowed
from ilattice.quadrature._kernels_scratch import UNIT
from ilattice.quadrature._kernels_solid import (
    DEPTH,
    EMPTY,
    FAST,
    FULL,
    SINGLE,
    UNSURE,
    air_between,
    divide,
    has_solid_corner,
    is_open,
    sort_of,
    tolerances,
)

MIN_LENGTH = UNIT >> 5  # boxes of this length are divided no further
MAX_BOXES = 2048  # boxes of a cell, from which on none is divided further
AT_ONCE = 4096  # points that are looked for one after the other


@inner(owning=True, **FAST)
def boxes_of(c: Any, tables: Any, which: Any, start: Any, extent: Any, P: int) -> Any:
    """Boxes of a cell that are not empty.

    At first these are the boxes from `start` (n, 3) on, of lengths `extent` (n, 3), with the
    polynomials c[which[i]], or full for which[i] < 0. Returned are lower corners, lengths, sorts,
    the rows of their tables, polynomials, and the air (n, 3) between solid along the directions in
    boxes that are not certain.
    """
    m = c.shape[1]
    size = P * P * P
    room = 64
    corner = np.empty((room, 3), np.int64)
    length = np.empty((room, 3), np.int64)
    sort = np.empty(room, np.int64)
    row = np.empty(room, np.int64)
    tensor = np.empty((room, m, size))
    air = np.zeros((room, 3))
    most = np.empty(3)
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
            # Depth first, so that the stack holds seven boxes per level, and never a whole level.
            if found == UNSURE and long[top].max() > MIN_LENGTH and n < MAX_BOXES:
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
            # Most cells have few boxes: room for MAX_BOXES would be taken for nothing.
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
            # Of full boxes no polynomials are looked at, and from the start they may have none.
            if found != FULL:
                tensor[n] = stack[top]
            # A box that is given up counts as connected: the air that this spans is what is missed.
            if found == UNSURE and air_between(stack[top], P, tables[k], most) > 0.0:
                for a in range(3):
                    air[n, a] = long[top, a] * most[a]
            n += 1
    return corner[:n], length[:n], sort[:n], row[:n], tensor[:n], air[:n]


@inner(owning=True, **FAST)
def grown(a: Any, room: int) -> Any:
    """A longer copy of an array."""
    out = np.empty((room, *a.shape[1:]), a.dtype)
    out[: len(a)] = a
    return out


@inner(**FAST)
def root(parent: Any, i: int) -> int:
    """Representative of a set."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@inner(**FAST)
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


@inner(**FAST)
def join(parent: Any, i: int, j: int) -> None:
    """Make one set of two."""
    a = root(parent, i)
    b = root(parent, j)
    parent[max(a, b)] = min(a, b)


@inner(owning=True, **FAST)
def is_joint(
    corner: Any, length: Any, sort: Any, row: Any, tensor: Any, tables: Any, i: int, j: int, P: int
) -> bool:  # fmt: skip
    """Whether boxes i and j have a face in common that is not certainly empty."""
    face = meeting(corner, length, i, j)
    if face < 0:
        return False
    axis = face // 2
    side = face % 2
    small = i
    a = (axis + 1) % 3
    b = (axis + 2) % 3
    if length[j, a] * length[j, b] < length[i, a] * length[i, b]:  # volumes may overflow
        small = j
        side = 1 - side
    return sort[small] == FULL or is_open(
        tensor[small], axis, side, P, tolerances(tensor[small]), tables[row[small]]
    )


@inner(owning=True, **FAST)
def connect(
    corner: Any, length: Any, sort: Any, row: Any, tensor: Any, tables: Any, mine: Any, P: int,
    parent: Any, firm: Any,
) -> None:  # fmt: skip
    """Join boxes `mine` that hang together, in `firm` those without such as are not certain.

    Boxes are taken by their lower ends along the first axis, and compared with those that have not
    ended there: of n boxes of one length these are some n^(2/3).
    """
    near = np.empty(len(sort), np.int64)
    count = 0
    for i in np.argsort(corner[:, 0]):
        if not mine[i]:
            continue
        left = 0
        for k in range(count):
            j = near[k]
            if corner[j, 0] + length[j, 0] < corner[i, 0]:
                continue
            near[left] = j
            left += 1
            apart = False
            for a in range(1, 3):
                apart |= corner[j, a] + length[j, a] < corner[i, a]
                apart |= corner[i, a] + length[i, a] < corner[j, a]
            if apart or (root(parent, i) == root(parent, j) and root(firm, i) == root(firm, j)):
                continue
            if is_joint(corner, length, sort, row, tensor, tables, max(i, j), min(i, j), P):
                join(parent, i, j)
                if sort[i] != UNSURE and sort[j] != UNSURE:
                    join(firm, i, j)
        near[left] = i
        count = left + 1


@inner(owning=True, **FAST)
def is_air(
    corner: Any, length: Any, sort: Any, row: Any, tensor: Any, tables: Any, air: Any, mine: Any,
    P: int,
) -> bool:  # fmt: skip
    """Whether boxes `mine` hang together only through such as have air between solid."""
    parent = np.arange(len(sort))
    first = -1
    whole = mine.copy()
    for i in range(len(sort)):
        whole[i] = mine[i] and air[i].max() == 0.0
    connect(corner, length, sort, row, tensor, tables, whole, P, parent, parent)
    for i in range(len(sort)):
        if whole[i] and (
            sort[i] == FULL
            or has_solid_corner(tensor[i], 3, P, tolerances(tensor[i]), tables[row[i]])
        ):
            if first < 0:
                first = root(parent, i)
            elif first != root(parent, i):
                return True
    return False


@outer(**FAST)
def pieces_of(
    c: Any, tables: Any, which: Any, start: Any, extent: Any, P: int, certain: bool
) -> Any:
    """Boxes of a cell (corners, lengths), the piece of each, the number of pieces, and a gap.

    Boxes that are not certain join what they touch, but if all has to be `certain`: then they are
    the last piece, which is none.

    The gap is the air, along the three directions, that is too thin to be seen as such everywhere,
    but would divide a piece, and whether it does so alone; 0 if there is none. It is where a piece
    hangs together only through boxes that are not certain, of which some have air between solid:
    where two pieces touch along an edge, others have just one of them, or next to nothing of the
    other.
    """
    corner, length, sort, row, tensor, air = boxes_of(c, tables, which, start, extent, P)
    n = len(sort)
    parent = np.arange(n)
    firm = np.arange(n)  # without boxes that are not certain
    mine = np.ones(n, np.bool_)
    for i in range(n):
        mine[i] = not certain or sort[i] != UNSURE
    connect(corner, length, sort, row, tensor, tables, mine, P, parent, firm)
    label = np.full(n, -1)
    count = 0
    for i in range(n):
        if mine[i] and root(parent, i) == i:
            label[i] = count
            count += 1
    if certain:
        for i in range(n):
            label[i] = label[root(parent, i)] if mine[i] else count
        return corner, length, label, count, np.zeros(4)
    seen = np.full(n, -1)  # per piece, one set of boxes with solid that holds for certain
    divided = np.zeros(n, np.bool_)
    for i in range(n):
        k = label[root(parent, i)]
        label[i] = k
        if sort[i] == FULL or (
            sort[i] == SINGLE
            and has_solid_corner(tensor[i], 3, P, tolerances(tensor[i]), tables[row[i]])
        ):
            if seen[k] < 0:
                seen[k] = root(firm, i)
            elif seen[k] != root(firm, i):
                divided[k] = True
    thin = np.zeros(4)
    for i in range(n):
        for a in range(3):
            if divided[label[i]] and air[i, a] > 0.0 and (thin[a] == 0.0 or air[i, a] < thin[a]):
                thin[a] = air[i, a]
    thin /= UNIT
    if thin.max() > 0.0:
        for k in range(count):
            if divided[k] and is_air(corner, length, sort, row, tensor, tables, air, label == k, P):
                thin[3] = 1.0
    return corner, length, label, count, thin


@in_ranges(64)
@outer(nogil=True, **FAST)
def count_pieces(
    first: int, last: int, c: Any, tables: Any, which: Any, start: Any, extent: Any, offsets: Any,
    P: int, counts: Any, gaps: Any,
) -> None:  # fmt: skip
    """Numbers of pieces, and gaps (n, 4), of cells with boxes from offsets[i]; see `boxes_of`."""
    c, tables, which, start, extent = borrowed((c, tables, which, start, extent))
    for i in range(first, last):
        part = slice(offsets[i], offsets[i + 1])
        mine = which[part]
        k = mine[0] if len(mine) == 1 else -1
        if len(mine) == 1 and (
            k < 0 or sort_of(c[k], c.shape[1], P, tolerances(c[k]), tables[k]) < UNSURE
        ):
            counts[i] = 1
            gaps[i] = 0.0
        else:
            found = pieces_of(c, tables, mine, start[part], extent[part], P, False)
            counts[i] = found[3]
            gaps[i] = found[4]


@inner(**FAST)
def distance_from(x: Any, corner: Any, length: Any) -> float:
    """Squared distance of a point from a box, 0 within."""
    far = 0.0
    for a in range(3):
        d = max(max(corner[a] - x[a], x[a] - corner[a] - length[a]), 0.0)
        far += d * d
    return far


@inner(**FAST)
def is_inside(x: Any, corner: Any, length: Any) -> bool:
    """Whether a point is inside a box, and not on its faces."""
    for a in range(3):
        if not corner[a] < x[a] < corner[a] + length[a]:
            return False
    return True


@in_ranges(AT_ONCE)
@outer(nogil=True, **FAST)
def labels_at(
    first: int, last: int, x: Any, cell: Any, offsets: Any, corner: Any, length: Any, label: Any,
    out: Any,
) -> None:  # fmt: skip
    """Label of the box that holds, or is nearest to, every point x (n, 3) of a cell.

    Points of rules come box by box: that of the one before is looked at first.
    """
    x, corner, length = borrowed((x, corner, length))
    near = -1
    for q in range(first, last):
        begin = offsets[cell[q]]
        end = offsets[cell[q] + 1]
        if begin <= near < end and is_inside(x[q], corner[near], length[near]):
            out[q] = label[near]
            continue
        best = np.inf
        for i in range(begin, end):
            far = distance_from(x[q], corner[i], length[i])
            if far < best:
                best = far
                near = i
                if far == 0.0:
                    break
        out[q] = label[near]
