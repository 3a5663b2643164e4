"""Compiled loops of slicing: march the height through cells, the wall through its section.

A cell is cut into the six tetrahedra of Kuhn and Freudenthal: a corner is a bit pattern
``4 dx + 2 dy + dz``, the edges run from a corner to one whose pattern contains its own. So an
edge is named by its lower grid vertex and a direction 1 to 7, the same in all cells that share it.

Guarantees: serial, one pass; combinatorics only, no tolerances. Non-guarantee: arguments are not
checked.
"""

import numpy as np

from ilattice._kernels import inner, outer
from ilattice.quadrature._kernels_kuhn import KUHN

#: Corners of the tetrahedra of a cell as bits; then their handedness.
_PATHS = np.column_stack([KUHN @ (4, 2, 1), (1, 1, 1, -1, -1, -1)])
_EVEN = np.array(  # even orders of four corners, by the bit pattern of those that come first
    [
        [-1, -1, -1, -1],
        [0, 1, 2, 3],
        [1, 0, 3, 2],
        [0, 1, 2, 3],
        [2, 3, 0, 1],
        [0, 2, 3, 1],
        [1, 2, 0, 3],
        [3, 2, 1, 0],
        [3, 2, 1, 0],
        [0, 3, 1, 2],
        [1, 3, 2, 0],
        [2, 3, 0, 1],
        [2, 3, 0, 1],
        [1, 0, 3, 2],
        [0, 1, 2, 3],
        [-1, -1, -1, -1],
    ],
    np.int64,
)


@outer()
def crossed_cells(height, cells, first, limit, out):
    """Cells of a block, (B, B, B) of B + 1 samples each way, that a level crosses.

    `height` (n, B+1, B+1, B+1); `cells` (n, 3) first cell of each block; `limit` (3,) cells of the
    grid. Fills `out` (m, 4) with block and cell within it when it is long enough; the count.
    """
    count = 0
    size = height.shape[1] - 1
    for b in range(len(height)):
        for i in range(min(size, limit[0] - cells[b, 0])):
            for j in range(min(size, limit[1] - cells[b, 1])):
                for k in range(min(size, limit[2] - cells[b, 2])):
                    above = 0
                    for c in range(8):
                        if height[b, i + (c >> 2), j + (c >> 1 & 1), k + (c & 1)] >= first:
                            above += 1
                    if 0 < above < 8:
                        if count < len(out):
                            out[count, 0] = b
                            out[count, 1] = i
                            out[count, 2] = j
                            out[count, 3] = k
                        count += 1
    return count


@inner()
def _edge(cell, low, high, planes):
    """Name of the edge between two corners of a cell."""
    if low > high:
        low, high = high, low
    i = (cell[0] + (low >> 2)) % planes[0]
    j = (cell[1] + (low >> 1 & 1)) % planes[1]
    k = (cell[2] + (low & 1)) % planes[2]
    return ((i * planes[1] + j) * planes[2] + k) * 8 + (high - low)


@outer()
def section(cells, corner, level, planes, turn, edges, ends):
    """Triangles in which the level crosses the tetrahedra of cells.

    `cells` (m, 3); `corner` (m, 8) heights; `planes` (3,) different grid planes per direction (one
    less than all where it wraps); `turn` -1 where the map reverses handedness. Fills `edges`
    (12 m, 3), the names of the crossed edges, counter-clockwise seen from above the level, and
    `ends` (12 m, 3, 2), the heights at their two ends. Returns the number of triangles.
    """
    count = 0
    loop = np.empty((4, 2), np.int64)
    for m in range(len(cells)):
        for path in range(6):
            below = 0
            for v in range(4):
                if corner[m, _PATHS[path, v]] < level:
                    below |= 1 << v
            if below == 0 or below == 15:
                continue
            order = _EVEN[below]
            size = 4
            n = (below & 1) + (below >> 1 & 1) + (below >> 2 & 1) + (below >> 3)
            hand = _PATHS[path, 4] * turn
            if n == 2:
                loop[0, 0], loop[0, 1] = order[0], order[2]
                loop[1, 0], loop[1, 1] = order[0], order[3]
                loop[2, 0], loop[2, 1] = order[1], order[3]
                loop[3, 0], loop[3, 1] = order[1], order[2]
            else:
                size = 3
                for v in range(3):
                    loop[v, 0], loop[v, 1] = order[0], order[v + 1]
                if n == 3:
                    hand = -hand
            for t in range(size - 2):
                for v in range(3):
                    at = 0 if v == 0 else t + v
                    a = _PATHS[path, loop[at, 0]]
                    b = _PATHS[path, loop[at, 1]]
                    to = v if hand > 0 else 2 - v
                    edges[count, to] = _edge(cells[m], a, b, planes)
                    ends[count, to, 0] = corner[m, min(a, b)]
                    ends[count, to, 1] = corner[m, max(a, b)]
                count += 1
    return count


@inner()
def _crossing(a, b, size, upper):
    """Name of the place where a side of the wall crosses an edge of the section."""
    low, high = min(a, b), max(a, b)
    return size + 2 * (low * size + high) + upper


@outer()
def march(triangles, side, faces, out):
    """Directed segments, the wall on their left, of the boundary of a wall on a section.

    `triangles` (T, 3) counter-clockwise; `side` (V,) 0 in the wall, 1 beyond its outer side, -1
    beyond its inner one; `faces` (V,) bits of the faces of the domain a vertex lies on. Fills
    `out` (5 T, 2) with names of ends: a vertex, or a crossing. Returns their number.
    """
    size = len(side)
    count = 0
    for t in range(len(triangles)):
        for upper in range(2):
            beyond = 1 if upper else -1
            leave, enter = -1, -1
            for v in range(3):
                a, b = triangles[t, v], triangles[t, (v + 1) % 3]
                if (side[a] == beyond) != (side[b] == beyond):
                    if side[b] == beyond:
                        leave = _crossing(a, b, size, upper)
                    else:
                        enter = _crossing(a, b, size, upper)
            if leave >= 0:
                out[count, 0], out[count, 1] = leave, enter
                count += 1
        for v in range(3):
            a, b = triangles[t, v], triangles[t, (v + 1) % 3]
            if faces[a] & faces[b] == 0 or (side[a] == side[b] and side[a] != 0):
                continue
            out[count, 0] = a if side[a] == 0 else _crossing(a, b, size, (side[a] + 1) // 2)
            out[count, 1] = b if side[b] == 0 else _crossing(a, b, size, (side[b] + 1) // 2)
            count += 1
    return count


@outer()
def chain(following, order, start):
    """Cycles of a permutation: fills `order` (n,) and `start` (n + 1,), returns their number."""
    n = len(following)
    seen = np.zeros(n, np.bool_)
    count, at = 0, 0
    for i in range(n):
        if seen[i]:
            continue
        start[count] = at
        j = i
        while not seen[j]:
            seen[j] = True
            order[at] = j
            at += 1
            j = following[j]
        count += 1
    start[count] = at
    return count


@inner()
def _near(points, i, j, least):
    x, y = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1]
    return x * x + y * y < least * least


@outer()
def thin_out(points, start, least, sharp, keep):
    """Marks points of closed loops to keep: no two in a row nearer than `least` (n,) of the later.

    Sharp ones stay.
    """
    for loop in range(len(start) - 1):
        a, b = start[loop], start[loop + 1]
        last = a
        keep[a] = True
        for i in range(a + 1, b):
            near = _near(points, i, last, least[i])
            keep[i] = sharp[i] or not near
            if keep[i]:
                if near and sharp[i] and last > a and not sharp[last]:
                    keep[last] = False
                last = i
        if last > a and not sharp[last] and _near(points, last, a, least[last]):
            keep[last] = False


@outer()
def areas(points, start, out):
    """Signed areas of closed loops, positive for counter-clockwise ones."""
    for loop in range(len(start) - 1):
        a, b = start[loop], start[loop + 1]
        total = 0.0
        for i in range(a, b):
            j = i + 1 if i + 1 < b else a
            x, y = points[i, 0] - points[a, 0], points[i, 1] - points[a, 1]
            total += x * (points[j, 1] - points[a, 1]) - y * (points[j, 0] - points[a, 0])
        out[loop] = 0.5 * total


@outer()
def owners(points, start, area, box, out):
    """For each clockwise loop the smallest counter-clockwise one around its first point, or -1."""
    for hole in range(len(area)):
        out[hole] = -1
        if area[hole] >= 0:
            continue
        x, y = points[start[hole], 0], points[start[hole], 1]
        best = np.inf
        for loop in range(len(area)):
            if area[loop] <= 0 or area[loop] >= best or area[loop] < -area[hole]:
                continue
            if x < box[loop, 0] or x > box[loop, 2] or y < box[loop, 1] or y > box[loop, 3]:
                continue
            odd = False
            a, b = start[loop], start[loop + 1]
            j = b - 1
            for i in range(a, b):
                if (points[i, 1] > y) != (points[j, 1] > y):
                    s = (y - points[i, 1]) / (points[j, 1] - points[i, 1])
                    if x < points[i, 0] + s * (points[j, 0] - points[i, 0]):
                        odd = not odd
                j = i
            if odd:
                best = area[loop]
                out[hole] = loop


@outer()
def hidden(triangles, u, side, beyond, slope, period, out):
    """Edges (T, 3), from each corner to the next, between whose ends a side may be crossed twice.

    Corners have parameters `u` (V, 3), `side` (V,), `beyond` (V, 2) and its gradient `slope`
    (V, 2, 3). Both ends are on one side, both tangents rise towards the surface, and meet beyond.
    """
    step = np.empty(3)
    for t in range(len(triangles)):
        for v in range(3):
            i, j = triangles[t, v], triangles[t, (v + 1) % 3]
            a, b = min(i, j), max(i, j)
            out[t, v] = False
            if side[a] != side[b]:
                continue
            for k in range(3):
                step[k] = u[b, k] - u[a, k]
                if period[k] > 0.0:
                    step[k] -= period[k] * np.rint(step[k] / period[k])
            for m in range(2):
                sign = 1.0 if beyond[a, m] < 0.0 else -1.0
                rise, fall = 0.0, 0.0
                for k in range(3):
                    rise += sign * slope[a, m, k] * step[k]
                    fall -= sign * slope[b, m, k] * step[k]
                if rise > 0.0 and fall > 0.0:
                    meet = (fall * beyond[a, m] + rise * beyond[b, m]) * sign + rise * fall
                    out[t, v] |= meet > 0.0


@inner()
def _put(out, count, a, b, c):
    out[count, 0], out[count, 1], out[count, 2] = a, b, c
    return count + 1


@outer()
def halve(triangles, middle, out):
    """Triangles with some edges halved, of the same orientation; returns their number.

    `middle` (T, 3) is that of the edge from each corner to the next, -1 where it stays whole.
    Fills `out` (4 T, 3).
    """
    count = 0
    for t in range(len(triangles)):
        first = 0
        for v in range(3):  # start so that edges to halve come first
            if middle[t, v] >= 0 and middle[t, (v + 2) % 3] < 0:
                first = v
        a, b, c = triangles[t, first], triangles[t, (first + 1) % 3], triangles[t, (first + 2) % 3]
        p, q, r = middle[t, first], middle[t, (first + 1) % 3], middle[t, (first + 2) % 3]
        if p < 0:
            count = _put(out, count, a, b, c)
        elif q < 0:
            count = _put(out, count, a, p, c)
            count = _put(out, count, p, b, c)
        else:
            count = _put(out, count, p, b, q)
            count = _put(out, count, p, q, c if r < 0 else r)
            count = _put(out, count, a, p, c if r < 0 else r)
            if r >= 0:
                count = _put(out, count, r, q, c)
    return count


@inner()
def _left(a, b, c, least):
    """Side of c as seen from a to b: 1, -1, or 0 within rounding."""
    turn = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    return 0 if abs(turn) <= least else (1 if turn > 0 else -1)


@inner()
def _meet(a, b, c, d, least):
    """Whether two edges, whose boxes meet, cross or touch."""
    return (
        _left(a, b, c, least) * _left(a, b, d, least) <= 0
        and _left(c, d, a, least) * _left(c, d, b, least) <= 0
    )


@inner()
def _folded(a, b, c, least):
    """Whether an edge runs back along the one before it."""
    ahead = (b[0] - a[0]) * (c[0] - b[0]) + (b[1] - a[1]) * (c[1] - b[1])
    return ahead < 0.0 and _left(a, b, c, least) == 0


@outer()
def crossings(points, after, order, out):
    """Marks edges, from each point to the one after it, that cross or touch others.

    `order` (n,) by their least x: a sweep. Neighbours may touch at the point they share.
    """
    size = 0.0
    for p in points:
        size = max(size, abs(p[0]), abs(p[1]))
    for k in range(len(order)):
        i = order[k]
        a, b = points[i], points[after[i]]
        right = max(a[0], b[0])
        low, high = min(a[1], b[1]), max(a[1], b[1])
        for m in range(k + 1, len(order)):
            j = order[m]
            c, d = points[j], points[after[j]]
            if min(c[0], d[0]) > right:
                break
            if min(c[1], d[1]) > high or max(c[1], d[1]) < low:
                continue
            reach = abs(b[0] - a[0]) + abs(b[1] - a[1]) + abs(d[0] - c[0]) + abs(d[1] - c[1])
            least = 1e-15 * size * reach
            if after[i] == j:
                meets = _folded(a, b, d, least)
            elif after[j] == i:
                meets = _folded(c, d, b, least)
            else:
                meets = _meet(a, b, c, d, least)
            if meets:
                out[i], out[j] = True, True
