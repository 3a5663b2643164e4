"""Many cells at once: extraction of Bernstein tensors, signs of cells, rules in chunks.

Guarantees: one allocation of scratch per chunk; every row depends on its own cell only, so the
results have the same bits for any number of threads.
"""

from typing import Any

import numpy as np

from ilattice._kernels import in_ranges, inner, outer
from ilattice._kernels_tuples import borrowed
from ilattice.quadrature._kernels_faces import face_rule, whole_face
from ilattice.quadrature._kernels_rules import cell_rule, cell_sign, solid
from ilattice.quadrature._kernels_scratch import (
    EXT,
    INTEGERS,
    LO,
    N_SURFACE,
    N_VOLUME,
    NAMES,
    NORMAL,
    PROJECT,
    SET,
    TABLE,
    TENSORS,
    UNIT,
    WEIGHT,
    numbers,
)
from ilattice.quadrature._kernels_thinning import ROOM, thinned_parts

#: Pieces that a thread takes at once.
CHUNK = 32
FAST = {"contract"}
ROUNDING = 1e-13  # of sums of coefficients, relative
#: Places in what `rules` are asked for: whether crossings of curves are looked for on bases of all
#: boxes, which takes some more points than halving them where curves are nearly parallel; after how
#: many halvings columns with a vertical tangent are accepted; and volume or surface.
CROSSINGS, ACCEPT, WANT = 0, 1, 2


@inner(error_model="numpy", fastmath=FAST)
def add_line(row: Any, f: float, c: Any, at: int, n: int, L: Any, out: Any, to: int) -> None:
    """Add f times the sum of row[t] c[at + t n] to n numbers of out from `to` on."""
    for t in range(len(L)):
        w = f * row[t]
        for r in range(n):
            out[to + r] += w * c[at + t * n + r]


@inner(error_model="numpy", fastmath=FAST)
def add_last(line: Any, at: int, step: int, rows: Any, L: Any, out: Any, to: int) -> None:
    """Transform P² runs of P numbers, `step` apart, by rows (P, P); add them to out."""
    P = len(L)
    for i in range(P * P):
        for r in range(P):
            v = 0.0
            for t in range(P):
                v += rows[r, t] * line[at + i * step + t]
            out[to + i * P + r] += v


@inner(error_model="numpy")
def tensor(
    c: Any, rows0: Any, rows1: Any, rows2: Any, x: int, y: int, z: int, near: Any, a: Any, b: Any,
    L: Any, v: Any,
) -> None:  # fmt: skip
    """Bernstein tensor v (P³,) of a piece of a spline, from coefficient (x, y, z) on."""
    P = len(L)
    for i in range(P):
        for j in range(P):
            for t in range(P):
                near[(i * P + j) * P + t] = c[x + i, y + j, z + t]
    a[:] = 0.0
    b[:] = 0.0
    v[:] = 0.0
    for i in range(P):
        add_line(rows0[i], 1.0, near, 0, P * P, L, a, i * P * P)
    for i in range(P):
        for j in range(P):
            at = i * P * P
            add_line(rows1[j], 1.0, a, at, P, L, b, at + j * P)
    add_last(b, 0, P, rows2, L, v, 0)


@in_ranges(16 * CHUNK)
@outer(nogil=True, error_model="numpy")
def extract(
    first: int, last: int, c: Any, rows0: Any, rows1: Any, rows2: Any, first0: Any, first1: Any,
    first2: Any, pieces: Any, factor: Any, L: Any, out: Any,
) -> None:  # fmt: skip
    """Add factor[k] times the Bernstein tensor of a spline to tensor k of each piece.

    `rows` (pieces, P, P) and `first` (pieces,) say for each direction how coefficients from the
    first one on make those of the piece; out is (n, m, P³).
    """
    size = len(L) * len(L) * len(L)
    rows0, rows1, rows2 = borrowed((rows0, rows1, rows2))
    near = np.empty(size)
    a = np.empty(size)
    b = np.empty(size)
    v = np.empty(size)
    for n in range(first, last):
        i, j, t = pieces[n, 0], pieces[n, 1], pieces[n, 2]
        tensor(c, rows0[i], rows1[j], rows2[t], first0[i], first1[j], first2[t], near, a, b, L, v)
        for k in range(len(factor)):
            for r in range(size):
                out[n, k, r] += factor[k] * v[r]


@inner(error_model="numpy")
def window_sign(low: Any, high: Any, at: int, P: int) -> int:
    """-1 if all sets are negative by bounds of P coefficients each, 1 if one is positive, or 0."""
    full = True
    for k in range(len(low)):
        least = low[k, at]
        most = high[k, at]
        for z in range(at + 1, at + P):
            least = min(least, low[k, z])
            most = max(most, high[k, z])
        slack = ROUNDING * max(-least, most)
        if least > slack:
            return 1
        full = full and most < -slack
    return -1 if full else 0


@inner(error_model="numpy")
def signs_of_slab(
    i: int, c: Any, rows: Any, firsts: Any, factors: Any, shifts: Any, halvings: int, L: Any,
    scratch: Any, out: Any,
) -> None:  # fmt: skip
    """`signs_of_splines` of slab i of pieces along the first direction, out (n1, n2)."""
    Z, N, planes, lines, low, high = scratch
    first0, first1, first2 = firsts
    P = len(L)
    sets = len(factors)
    n = c.shape[3]
    flat = c.reshape(c.size)
    planes[:] = 0.0
    for s in range(len(c)):
        at = (s * c.shape[1] + first0[i]) * c.shape[2] * n
        for a in range(P):
            add_line(rows[0][i, a], 1.0, flat, at, c.shape[2] * n, L, planes[s],
                     a * c.shape[2] * n)  # fmt: skip
    for j in range(len(first1)):
        for k in range(sets):
            lines[k * P * P * n : (k + 1) * P * P * n] = shifts[k]
            for s in range(len(c)):
                if factors[k, s] != 0.0:
                    for a in range(P):
                        for b in range(P):
                            at = (a * c.shape[2] + first1[j]) * n
                            add_line(rows[1][j, b], factors[k, s], planes[s], at, n, L, lines,
                                     ((k * P + a) * P + b) * n)  # fmt: skip
        low[:] = np.inf
        high[:] = -np.inf
        for k in range(sets):
            for a in range(P * P):
                for z in range(n):
                    low[k, z] = min(low[k, z], lines[(k * P * P + a) * n + z])
                    high[k, z] = max(high[k, z], lines[(k * P * P + a) * n + z])
        for r in range(len(first2)):
            out[j, r] = window_sign(low, high, first2[r], P)
            if out[j, r] != 0:
                continue
            size = P * P * P
            Z[TENSORS : TENSORS + sets * size] = 0.0
            for k in range(sets):
                at = k * P * P * n + first2[r]
                add_last(lines, at, n, rows[2][r], L, Z, TENSORS + k * size)
            out[j, r] = cell_sign(Z, N, sets, halvings, L)


@in_ranges(1)
@outer(nogil=True, error_model="numpy")
def signs_of_splines(
    first: int, last: int, c: Any, rows0: Any, rows1: Any, rows2: Any, first0: Any, first1: Any,
    first2: Any, factors: Any, shifts: Any, table: int, halvings: int, L: Any, out: Any,
) -> None:  # fmt: skip
    """`cell_sign` of all pieces, out (n0, n1, n2), of sets `factors` @ splines + `shifts`.

    The splines c (splines, ., ., .) have knots in common. Pieces along the last direction share
    what the first two make of the coefficients.
    """
    P = len(L)
    sets = len(factors)
    n = c.shape[3]
    Z = np.empty(numbers(sets, L))
    N = np.zeros(INTEGERS, np.int64)
    N[TABLE] = table
    planes = np.empty((len(c), P * c.shape[2] * n))
    lines = np.empty(sets * P * P * n)
    low = np.empty((sets, n))
    high = np.empty((sets, n))
    for i in range(first, last):
        signs_of_slab(
            i, c, (rows0, rows1, rows2), (first0, first1, first2), factors, shifts, halvings, L,
            (Z, N, planes, lines, low, high), out[i],
        )  # fmt: skip


@in_ranges(1)
@outer(nogil=True, error_model="numpy")
def windows(
    first: int, last: int, c: Any, first0: Any, first1: Any, first2: Any, size: Any, factor: Any,
    out: Any,
) -> None:  # fmt: skip
    """Add bounds of factor[k] times a spline on all pieces to out (n0, n1, n2, m, 2).

    They are the extremes of the coefficients that matter there.
    """
    for i in range(first, last):
        for j in range(len(first1)):
            for r in range(len(first2)):
                least = np.inf
                most = -np.inf
                for x in range(first0[i], first0[i] + size[0]):
                    for y in range(first1[j], first1[j] + size[1]):
                        for z in range(first2[r], first2[r] + size[2]):
                            least = min(least, c[x, y, z])
                            most = max(most, c[x, y, z])
                for k in range(len(factor)):
                    f = factor[k]
                    out[i, j, r, k, 0] += min(f * least, f * most)
                    out[i, j, r, k, 1] += max(f * least, f * most)


@in_ranges(4 * CHUNK)
@outer(nogil=True, error_model="numpy")
def signs(
    first: int, last: int, tensors: Any, many: Any, tables: Any, halvings: int, L: Any, out: Any
) -> None:
    """`cell_sign` of every row of tensors (n, m, P³), of which the first `many` (n,) count."""
    size = tensors.shape[2]
    Z = np.empty(numbers(tensors.shape[1], L))
    N = np.zeros(INTEGERS, np.int64)
    for n in range(first, last):
        N[TABLE] = tables[n]
        for k in range(many[n]):
            for i in range(size):
                Z[TENSORS + k * size + i] = tensors[n, k, i]
        out[n] = cell_sign(Z, N, many[n], halvings, L)


@inner(owning=True, error_model="numpy")
def grow(signs: Any, mark: Any, end: Any, done: int, box: Any) -> None:
    """Grow box (6,), of one full piece, over full pieces that are not marked `done`; mark it.

    The pieces of its cell stop at `end`; it grows along the last direction first.
    """
    for axis in range(2, -1, -1):
        free = True
        while free and box[3 + axis] < end[axis]:
            low = box[:3].copy()
            high = box[3:].copy()
            low[axis] = box[3 + axis]
            high[axis] = low[axis] + 1
            for i in range(low[0], high[0]):
                for j in range(low[1], high[1]):
                    for k in range(low[2], high[2]):
                        free = free and signs[i, j, k] == -1 and mark[i, j, k] != done
            if free:
                box[3 + axis] += 1
    mark[box[0] : box[3], box[1] : box[4], box[2] : box[5]] = done


@in_ranges(64 * CHUNK)
@outer(nogil=True, error_model="numpy")
def boxes_of_cells(
    first: int, last: int, signs: Any, mark: Any, cells: Any, starts0: Any, starts1: Any,
    starts2: Any, offsets: Any, boxes: Any, counts: Any,
) -> None:  # fmt: skip
    """Boxes that make up cells: pieces that are cut, and as few as can be of all full ones.

    Cell n (n, 3) has pieces starts[cells[n]] to starts[cells[n] + 1]. Without `boxes` they are
    counted; rows of boxes (m, 6) from offsets[n] on get first and last pieces. `mark` is zero at
    first, and passed on.
    """
    done = 2 if len(boxes) else 1
    signs, mark = borrowed((signs, mark))
    begin = np.empty(3, np.int64)
    end = np.empty(3, np.int64)
    box = np.empty(6, np.int64)
    for n in range(first, last):
        x, y, z = cells[n]
        begin[0], end[0] = starts0[x], starts0[x + 1]
        begin[1], end[1] = starts1[y], starts1[y + 1]
        begin[2], end[2] = starts2[z], starts2[z + 1]
        count = 0
        for i in range(begin[0], end[0]):
            for j in range(begin[1], end[1]):
                for k in range(begin[2], end[2]):
                    if signs[i, j, k] == 1 or mark[i, j, k] == done:
                        continue
                    box[0], box[1], box[2] = i, j, k
                    box[3], box[4], box[5] = i + 1, j + 1, k + 1
                    if signs[i, j, k] == -1:
                        grow(signs, mark, end, done, box)
                    if done == 2:
                        boxes[offsets[n] + count] = box
                    count += 1
        counts[n] = count


@in_ranges(4096)
@outer(nogil=True, error_model="numpy")
def places_in_cells(
    first: int, last: int, u: Any, cells: Any, planes: Any, starts: Any, out: Any
) -> None:
    """Places (n, 3) of points u (n, 3) from the corners of cells (n, 3), a piece being UNIT long.

    Pieces of cell i of a direction lie between planes starts[i] and starts[i + 1].
    """
    for n in range(first, last):
        for a in range(3):
            x = planes[a]
            low = starts[a][cells[n, a]]
            here = low
            beyond = starts[a][cells[n, a] + 1]
            while beyond - here > 1:
                middle = (here + beyond) // 2
                if x[middle] <= u[n, a]:
                    here = middle
                else:
                    beyond = middle
            part = (u[n, a] - x[here]) / (x[here + 1] - x[here])
            out[n, a] = UNIT * (here - low + part)


@inner(error_model="numpy")
def rules_of_chunk(
    chunk: int, Z: Any, N: Any, S: Any, polynomials: Any, which: Any, boxes: Any, sides: Any,
    thin: Any, gauss: Any, asked: Any, L: Any, points: Any, feet: Any, counts: Any,
) -> None:  # fmt: skip
    """Rules on the boxes of a chunk, see `rules`; Z, N and S are scratch."""
    tensors, many, tables, names = polynomials
    size = tensors.shape[2]
    N[PROJECT] = asked[CROSSINGS]
    q = 0
    for n in range(chunk * CHUNK, min(len(boxes), (chunk + 1) * CHUNK)):
        first = N[N_VOLUME]
        before = first + N[N_SURFACE]
        if thin[n, 3] != q:
            q = thin[n, 3]
            for i in range(gauss.shape[1]):
                Z[i] = gauss[q - 1, i]
        for i in range(3):
            Z[LO + i] = boxes[n, i]
            Z[EXT + i] = boxes[n, 3 + i]
        if which[n] < 0:
            if sides[n] < 0:
                solid(Z, N, points, q)
            else:
                whole_face(Z, N, points, sides[n] // 2, sides[n] % 2, q)
        else:
            m = many[which[n]]
            N[TABLE] = tables[which[n]]
            for k in range(m):
                N[NAMES + k] = names[which[n], k]
                for i in range(size):
                    Z[TENSORS + k * size + i] = tensors[which[n], k, i]
            if sides[n] < 0:
                cell_rule(Z, N, points, feet, m, asked[ACCEPT], asked[WANT], q, L)
            else:
                face_rule(Z, N, points, m, sides[n] // 2, sides[n] % 2, asked[ACCEPT], q, L)
        end = N[N_VOLUME]
        if thin[n, 1] > 0 and end - first > thin[n, 0] and end <= len(points):
            N[N_VOLUME] = thinned_parts(
                points, first, end, boxes[n], thin[n, 1], thin[n, 0], thin[n, 2], S
            )
        counts[n] = N[N_VOLUME] + N[N_SURFACE] - before


@in_ranges(8)
@outer(nogil=True, error_model="numpy")
def rules(
    first_chunk: int,
    last_chunk: int,
    polynomials: Any,
    which: Any,
    boxes: Any,
    sides: Any,
    thin: Any,
    gauss: Any,
    asked: Any,
    L: Any,
    volume: Any,
    surface: Any,
    room: Any,
    counts: Any,
    used: Any,
) -> None:
    """Rules on boxes (n, 6), given by lower corners and extents.

    Polynomials are the arrays of `Content`. which[n] is the row of the tensors (., m, P³), or -1
    for a full box or face; the first `many` of a row count, `tables` say which of their signs are
    solid, and names (., m) number them on surfaces. What is `asked` for is at `CROSSINGS` and so
    on. sides[n] is -1 for the box itself, or 2 axis + side for one of its faces. In a box with
    more than thin[n, 0] points of a volume these are thinned so that polynomials of degree
    thin[n, 1], if that is positive, keep their integrals over each of thin[n, 2] parts of the box
    per direction. Chunk i writes rows room[i] to room[i + 1] of volume (rows, 4) or of surface
    (rows, 8); used[i] says how many it has, or would have; counts (n,) are those of each box.
    """
    scratch = ROOM if thin[:, 1].any() else 0
    for chunk in range(first_chunk, last_chunk):
        Z = np.empty(numbers(polynomials[0].shape[1], L))
        N = np.zeros(INTEGERS, np.int64)
        S = np.empty(scratch)
        rules_of_chunk(
            chunk, Z, N, S, polynomials, which, boxes, sides, thin, gauss, asked, L,
            volume[room[chunk] : room[chunk + 1]], surface[room[chunk] : room[chunk + 1]], counts,
        )  # fmt: skip
        used[chunk] = N[N_VOLUME] + N[N_SURFACE]


@in_ranges(64)
@outer(nogil=True, error_model="numpy")
def gather(
    first: int, last: int, arena: Any, room: Any, starts: Any, used: Any, points: Any, weights: Any,
    normals: Any, sets: Any,
) -> None:  # fmt: skip
    """Copy the rows of all chunks to where they belong; normals and sets of surfaces only."""
    wide = arena.shape[1] > NORMAL
    for chunk in range(first, last):
        for i in range(used[chunk]):
            row = starts[chunk] + i
            mine = room[chunk] + i
            for j in range(3):
                points[row, j] = arena[mine, j]
            weights[row] = arena[mine, WEIGHT]
            if wide:
                for j in range(3):
                    normals[row, j] = arena[mine, NORMAL + j]
                sets[row] = int(arena[mine, SET])
