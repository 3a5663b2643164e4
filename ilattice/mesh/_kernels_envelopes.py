"""Compiled search for quads of a contour that lie in the envelopes of their edges of the grid.

Cells are numbered from 1 along an axis; those at the ends, 0 and n + 1, have no width: cell c lies
between ``planes[a, c]`` and ``planes[a, c + 1]``, and its code holds 21 bits per axis.

Guarantees: see `ilattice.mesh.envelopes`, which says what is proved; one thread, linear time.
Non-guarantees: arguments are not checked.
"""

from typing import Any

import numpy as np

from ilattice._kernels import inner, outer

#: Part of the edge, and of its cells, by which triangles pass well inside.
MARGIN = 1e-3
#: Of the square of the size of cells: how far what two vertices hold may overlap by rounding.
ROUNDING = 1e-12
CLOSE = 1e-2  # sizes of cells between middles of edges that tell no way
BITS = 21  # of the number of a cell along an axis: three of them fill a code
MASK = (1 << BITS) - 1
NOWHERE = -1  # code of vertices that are off the face that they should lie on
ALONE, CROWDED = -1, -2  # instead of the other vertex in the cell
SPREAD = 0x9E3779B97F4A7C15 >> 1  # 2**64 over the golden ratio, halved: spreads codes over slots


@inner()
def _cell(planes: Any, a: int, n: int, scale: float, p: float, side: int) -> int:
    """Cell of a coordinate; that without width for vertices on the lower or upper end."""
    if side != 0:
        c = 0 if side == 1 else n + 1
        return c if p == planes[a, c] else NOWHERE
    c = min(max(int((p - planes[a, 0]) * scale) + 1, 1), n)
    while c > 1 and p < planes[a, c]:
        c -= 1
    while c < n and p >= planes[a, c + 1]:
        c += 1
    return c if planes[a, c] <= p <= planes[a, c + 1] else NOWHERE


@outer(error_model="numpy")
def locate(x: Any, kind: Any, planes: Any, counts: Any, table: Any, cell: Any, other: Any) -> None:
    """Codes (V,) of the cells of vertices, and which other vertex is in the same one.

    ``counts`` (3,) are numbers of cells. ``table`` comes filled with -1; its length is a power of
    two, above that of ``x``.
    """
    last = len(table) - 1
    n0, n1, n2 = counts[0], counts[1], counts[2]
    s0 = n0 / (planes[0, n0 + 1] - planes[0, 0])
    s1 = n1 / (planes[1, n1 + 1] - planes[1, 0])
    s2 = n2 / (planes[2, n2 + 1] - planes[2, 0])
    for v in range(len(x)):
        sides = np.int64(kind[v])
        i = _cell(planes, 0, n0, s0, x[v, 0], sides & 3)
        j = _cell(planes, 1, n1, s1, x[v, 1], (sides >> 2) & 3)
        k = _cell(planes, 2, n2, s2, x[v, 2], (sides >> 4) & 3)
        other[v] = ALONE
        if min(i, j, k) < 0:
            cell[v] = NOWHERE
            continue
        code = ((i << BITS | j) << BITS) | k
        cell[v] = code
        slot = ((code * SPREAD) >> 32) & last
        while table[slot] >= 0 and cell[table[slot]] != code:
            slot = (slot + 1) & last
        w = table[slot]
        if w < 0:
            table[slot] = v
        elif other[w] == ALONE:
            other[v], other[w] = w, v
        else:
            if other[w] >= 0:
                other[other[w]] = CROWDED
            other[v] = other[w] = CROWDED


@inner()
def _axis(step: int) -> int:
    """Axis of a step from a cell to one that shares a face with it; -1 for others."""
    step = abs(step)
    z, y, x = step == 1, step == 1 << BITS, step == 1 << 2 * BITS
    return 3 * z + 2 * y + x - 1


@inner()
def _edge(cell: Any, a: int, b: int, c: int, d: int, planes: Any, low: Any) -> Any:
    """Axis and upper end of the edge that four cells surround, its lower end to `low`; -1 if none.

    The cells follow each other around it.
    """
    p, q, r, s = cell[a], cell[b], cell[c], cell[d]
    first, second = _axis(q - p), _axis(r - q)
    if min(p, q, r, s) < 0 or first < 0 or second < 0 or first == second or s - r != p - q:
        return -1, 0.0
    axis = 3 - first - second
    own = p >> BITS * (2 - first) & MASK
    low[first] = planes[first, own + (q > p)]
    own = p >> BITS * (2 - second) & MASK
    low[second] = planes[second, own + (r > q)]
    own = p >> BITS * (2 - axis) & MASK
    low[axis] = planes[axis, own]
    return axis, planes[axis, own + 1]


@outer(error_model="numpy")
def add_middles(faces: Any, cell: Any, other: Any, planes: Any, sums: Any) -> None:
    """Add to sums (V, 4) the middles, and number, of edges around vertices that share cells."""
    low = np.empty(3)
    for i in range(0, len(faces), 2):
        a, b, c, d = faces[i, 0], faces[i, 1], faces[i, 2], faces[i + 1, 2]
        if max(other[a], other[b], other[c], other[d]) < 0:
            continue
        axis, high = _edge(cell, a, b, c, d, planes, low)
        if axis < 0:
            continue
        low[axis] = 0.5 * (low[axis] + high)
        for v in (a, b, c, d):
            for k in range(3):
                sums[v, k] += low[k]
            sums[v, 3] += 1.0


@inner()
def _way_out(x: Any, cell: Any, v: int, w: int, planes: Any, way: Any) -> float:
    """How far along a way the line from v to w gets in the cell of v, next to that of w."""
    up = cell[w] > cell[v]
    axis = _axis(cell[w] - cell[v])
    face = planes[axis, (cell[v] >> BITS * (2 - axis) & MASK) + up]
    step = x[w, axis] - x[v, axis]
    part = (face - x[v, axis]) / step if step != 0.0 else 0.0
    start, out = 0.0, 0.0
    for k in range(3):
        start += way[k] * x[v, k]
        out += way[k] * (x[v, k] + part * (x[w, k] - x[v, k]))
    return max(start, out)


@outer(error_model="numpy")
def reach(
    x: Any, faces: Any, cell: Any, other: Any, planes: Any, sums: Any, least: Any, far: Any
) -> None:
    """How far envelopes get in cells towards the other vertex there; ``far`` comes as -inf.

    As far as can be where middles of edges tell no way. ``least`` (3,) are the smallest sizes of
    cells.
    """
    close = (CLOSE * min(least[0], least[1], least[2])) ** 2
    low, way = np.empty(3), np.empty(3)
    for i in range(0, len(faces), 2):
        a, b, c, d = faces[i, 0], faces[i, 1], faces[i, 2], faces[i + 1, 2]
        if max(other[a], other[b], other[c], other[d]) < 0:
            continue
        axis, high = _edge(cell, a, b, c, d, planes, low)
        if axis < 0:
            continue
        for u, v, w in ((d, a, b), (a, b, c), (b, c, d), (c, d, a)):
            o = other[v]
            if o < 0:
                continue
            bottom, square = 0.0, 0.0
            for k in range(3):
                way[k] = sums[o, k] / max(sums[o, 3], 1.0) - sums[v, k] / sums[v, 3]
                bottom += way[k] * low[k]
                square += way[k] * way[k]
            if square < close:
                far[v] = np.inf
                continue
            far[v] = max(
                far[v], bottom, bottom + way[axis] * (high - low[axis]),
                _way_out(x, cell, v, u, planes, way), _way_out(x, cell, v, w, planes, way),
            )  # fmt: skip


@inner()
def _apart(other: Any, far: Any, v: int, most: float) -> bool:
    """Whether the envelopes of a vertex are on one side of a plane in its cell."""
    w = other[v]
    return w == ALONE or (w >= 0 and far[v] + far[w] <= most)


@inner()
def _crosses(u: float, v: float, w: float, p: float, q: float, r: float, length: float) -> bool:
    """Whether a triangle crosses an edge well inside.

    Its corners have the weights u, v, w where it does, and the heights p, q, r.
    """
    area, height = u + v + w, u * p + v * q + w * r
    if area < 0.0:
        area, height = -area, -height
    return MARGIN * area * length < height < (1.0 - MARGIN) * area * length


@outer(error_model="numpy")
def enclosed(
    x: Any, faces: Any, cell: Any, other: Any, far: Any, least: Any, planes: Any, out: Any
) -> None:
    """Which quads lie in the envelopes of their edges, beside all those of other edges.

    ``least`` (3,) are the smallest sizes of cells.
    """
    low = np.empty(3)
    most = ROUNDING * max(least[0], least[1], least[2]) ** 2
    for i in range(len(out)):
        a, b, c, d = faces[2 * i, 0], faces[2 * i, 1], faces[2 * i, 2], faces[2 * i + 1, 2]
        axis, high = _edge(cell, a, b, c, d, planes, low)
        if axis < 0:
            continue
        k, m = (axis + 1) % 3, (axis + 2) % 3
        ak, bk, ck, dk = x[a, k] - low[k], x[b, k] - low[k], x[c, k] - low[k], x[d, k] - low[k]
        am, bm, cm, dm = x[a, m] - low[m], x[b, m] - low[m], x[c, m] - low[m], x[d, m] - low[m]
        ab, bc, ca = ak * bm - am * bk, bk * cm - bm * ck, ck * am - cm * ak
        cd, da = ck * dm - cm * dk, dk * am - dm * ak
        one, two, area = ab + bc + ca, cd + da - ca, MARGIN * least[k] * least[m]
        if not (min(one, two) > area or max(one, two) < -area):
            continue
        bottom, length = low[axis], high - low[axis]
        pa, pb, pc = x[a, axis] - bottom, x[b, axis] - bottom, x[c, axis] - bottom
        if length > 0.0 and not (
            _crosses(bc, ca, ab, pa, pb, pc, length)
            and _crosses(cd, da, -ca, pa, pc, x[d, axis] - bottom, length)
        ):
            continue
        out[i] = (
            _apart(other, far, a, most)
            and _apart(other, far, b, most)
            and _apart(other, far, c, most)
            and _apart(other, far, d, most)
        )
