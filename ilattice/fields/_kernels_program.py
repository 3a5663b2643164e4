"""The interpreter: programs at points, their derivatives, their bounds on boxes.

A program is four arrays of one length: code, first and second register, constant; its result is
the last register. Where the bounds on a box of points decide minima and maxima, a shorter program
without the losing sides is run for them: a deep tree costs what is near.

Guarantees: results do not depend on the number of threads, nor on what else is evaluated: the
dropped side could not have won. Arguments are not checked.
"""

import numpy as np

import ilattice.fields._tables as ops
from ilattice._kernels import in_ranges, inner, outer
from ilattice.fields._kernels_ops import bounds, partials, product, slopes, value

WIDE = 64  # points evaluated at once
FEW = 32  # points whose derivatives are taken at once
LEVELS = 8  # of programs that are ever shorter
TOP = 2  # times that the boxes of the tasks are divided from the box of all points
TASK = 2048  # points or boxes per task
TASKS = 2  # that a thread takes at once
GROUP = 16  # boxes that share a program
INF = np.inf


@inner(owning=True)
def begin(op, a, b, imm, levels):
    """Room for a program and shorter ones, with the program at level 0, for `narrow`.

    Returns codes (levels, 3, n), numbers (levels, n), lengths (levels,), and scratch.
    """
    m = len(op)
    codes, numbers = np.empty((levels, 3, m + 1), np.int64), np.empty((levels, m + 1))
    lengths = np.empty(levels, np.int64)
    codes[0, 0, :m] = op
    codes[0, 1, :m] = a
    codes[0, 2, :m] = b
    numbers[0, :m] = imm
    lengths[0] = m
    return codes, numbers, lengths, np.empty((4, m + 1)), np.empty((3, m + 1), np.int64)


@inner(error_model="numpy")
def narrow(codes, numbers, lengths, level, box, w, maps):
    """Write the program that suffices on a box (2, 3) to the next level; bounds of its result.

    ``w`` (4, n) and ``maps`` (3, n) are scratch.
    """
    op, a, b, imm = codes[level, 0], codes[level, 1], codes[level, 2], numbers[level]
    m, lo, hi = lengths[level], w[0], w[1]
    for i in range(m):
        if op[i] >= ops.INPUTS:
            p, q = a[i], b[i]
            lo[i], hi[i] = bounds(op[i], lo[p], hi[p], lo[q], hi[q])
        elif op[i] < ops.CONST:
            lo[i], hi[i] = box[0, op[i]], box[1, op[i]]
        elif op[i] == ops.CONST:
            lo[i] = hi[i] = imm[i]
        else:
            lo[i], hi[i] = -INF, INF
    low, high = lo[m - 1], hi[m - 1]
    _choose(op, a, b, m, lo, hi, w[2], w[3], maps[0], maps[1])
    c, x = codes[level + 1], numbers[level + 1]
    lengths[level + 1] = _compact(
        op, a, b, imm, m, maps[0], maps[1], maps[2], c[0], c[1], c[2], x
    )  # fmt: skip
    return low, high


@inner()
def _choose(op, a, b, m, lo, hi, cap, floor, to, live):
    """Which registers the result needs, and by which of its sides an extreme can be replaced.

    A register counts only between its floor and its cap: in a union of many, what is above the
    upper bound of the whole never wins, whatever its neighbours in the tree are.
    """
    live[:m] = 0
    live[m - 1], cap[m - 1], floor[m - 1] = 1, INF, -INF
    for i in range(m - 1, 2, -1):
        to[i] = i
        if live[i] == 0 or op[i] < ops.INPUTS:
            continue
        c, f = INF, -INF
        first = second = True
        p, q = a[i], b[i]
        if op[i] == ops.MIN:
            c, f = min(cap[i], hi[i]), floor[i]
            second = lo[p] > c or not lo[q] > c
            first = not second or not lo[p] > c
        elif op[i] == ops.MAX:
            c, f = cap[i], max(floor[i], lo[i])
            second = hi[p] < f or not hi[q] < f
            first = not second or not hi[p] < f
        elif op[i] < ops.BINARY:
            second = False
        if first:
            _need(p, c, f, cap, floor, live)
        if second:
            _need(q, c, f, cap, floor, live)
        if op[i] == ops.MIN or op[i] == ops.MAX:
            to[i] = i if first and second else p if first else q


@inner()
def _need(i, c, f, cap, floor, live):
    """A register is read, and counts between f and c."""
    if live[i] == 0:
        live[i], cap[i], floor[i] = 1, c, f
    else:
        cap[i], floor[i] = max(cap[i], c), min(floor[i], f)


@inner()
def _compact(op, a, b, imm, m, to, live, new, op2, a2, b2, imm2):
    """Copy the coordinates, and the instructions that are read and not replaced."""
    for i in range(3):
        to[i] = i
    for i in range(3, m):
        to[i] = i if to[i] == i else to[to[i]]
    last, k = to[m - 1], 0
    for i in range(last + 1):
        if i > 2 and (live[i] == 0 or to[i] != i):
            continue
        op2[k], imm2[k] = op[i], imm[i]
        compute = op[i] >= ops.INPUTS  # registers of others keep what they are
        a2[k] = new[to[a[i]]] if compute else a[i]
        b2[k] = new[to[b[i]]] if op[i] >= ops.BINARY else a2[k]
        new[i] = k
        k += 1
    if last < 3:  # the result is a coordinate: read it once more
        op2[k], a2[k], b2[k], imm2[k] = op[last], 0, 0, 0.0
        k += 1
    return k


@inner()
def spread(i):
    """The lowest 21 bits of a number, two zeros apart."""
    i &= 0x1FFFFF
    i = (i | i << 32) & 0x1F00000000FFFF
    i = (i | i << 16) & 0x1F0000FF0000FF
    i = (i | i << 8) & 0x100F00F00F00F00F
    i = (i | i << 4) & 0x10C30C30C30C30C3
    return (i | i << 2) & 0x1249249249249249


@in_ranges(8192)
@outer(nogil=True)
def places(first, last, points, low, scale, out):
    """Places of points along a curve that fills space, from whole numbers scale * (p - low)."""
    for n in range(first, last):
        place = 0
        for k in range(3):
            place |= spread(int((points[n, k] - low[k]) * scale)) << k
        out[n] = place


@outer()
def divide(places):
    """Boxes of points along the curve, each divided in eight until it holds few points.

    Returns nodes (n, 4): first and last point, level, whether it is not divided further; those
    within a node follow it. Level 1 has the tasks.
    """
    nodes, count = np.empty((len(places) // WIDE + 64, 4), np.int64), 0
    stack, top = np.empty((8 * (LEVELS + TOP) + 8, 3), np.int64), 1
    stack[0, 0], stack[0, 1], stack[0, 2] = 0, len(places), 1 - TOP
    while top:
        top -= 1
        start, stop, level = stack[top, 0], stack[top, 1], stack[top, 2]
        differ = places[start] ^ places[stop - 1]
        end = stop - start <= WIDE or level == LEVELS - 1 or differ == 0
        if level > 0 or end:
            if count == len(nodes):
                nodes = np.concatenate((nodes, np.empty_like(nodes)))
            nodes[count, 0], nodes[count, 1] = start, stop
            nodes[count, 2], nodes[count, 3] = max(level, 1), 1 if end else 0
            count += 1
        if end:
            continue
        shift = 0
        while differ >> shift > 7:
            shift += 3
        last = stop
        for i in range(stop - 1, start - 1, -1):
            if i == start or places[i - 1] >> shift != places[i] >> shift:
                stack[top, 0], stack[top, 1], stack[top, 2] = i, last, level + 1
                top += 1
                last = i
    return nodes[:count]


@outer()
def follow(n, prune):
    """Nodes like those of `divide`, of points in the order that they have."""
    per = (TASK // WIDE + 1) if prune else 1
    nodes, count = np.empty((((n + TASK - 1) // TASK) * per, 4), np.int64), 0
    for start in range(0, n, TASK):
        stop = min(n, start + TASK)
        nodes[count] = np.array([start, stop, 1 if prune else 0, 0 if prune else 1])
        count += 1
        if prune:
            for i in range(start, stop, WIDE):
                nodes[count] = np.array([i, min(stop, i + WIDE), 2, 1])
                count += 1
    return nodes[:count]


@inner(error_model="numpy")
def apply(op, u, v, w, n):
    """One instruction on n values: ``w = op(u, v)``."""
    if op == ops.ADD:
        for k in range(n):
            w[k] = u[k] + v[k]
    elif op == ops.MUL:
        for k in range(n):
            w[k] = u[k] * v[k]
    elif op == ops.SUB:
        for k in range(n):
            w[k] = u[k] - v[k]
    elif op == ops.SQUARE:
        for k in range(n):
            w[k] = u[k] * u[k]
    elif op == ops.SQRT:
        for k in range(n):
            w[k] = np.sqrt(u[k])
    elif op == ops.MIN:
        for k in range(n):
            s, t = u[k], v[k]
            w[k] = t if t < s or t != t else s
    elif op == ops.MAX:
        for k in range(n):
            s, t = u[k], v[k]
            w[k] = t if t > s or t != t else s
    elif op == ops.ABS:
        for k in range(n):
            w[k] = abs(u[k])
    elif op == ops.NEG:
        for k in range(n):
            w[k] = -u[k]
    else:
        for k in range(n):
            w[k] = value(op, u[k], v[k])


@inner()
def _run(op, a, b, imm, m, points, leaves, i0, i1, buf):
    """Registers of all instructions at points i0..i1, the last one repeated to fill the rows."""
    n = buf.shape[1]
    for i in range(m):
        if op[i] >= ops.INPUTS:
            apply(op[i], buf[a[i]], buf[b[i]], buf[i], n)
        elif op[i] == ops.CONST:
            buf[i, :] = imm[i]
        else:
            for k in range(n):
                at = min(i0 + k, i1 - 1)
                buf[i, k] = points[at, op[i]] if op[i] < ops.CONST else leaves[a[i], at, 0]


@inner()
def _box_of(points, i0, i1, box):
    for axis in range(3):
        box[0, axis] = box[1, axis] = points[i0, axis]
        for i in range(i0 + 1, i1):
            box[0, axis] = min(box[0, axis], points[i, axis])
            box[1, axis] = max(box[1, axis], points[i, axis])


@inner(owning=True)
def _grown(buf, m):
    """Room for m registers."""
    return buf if m <= len(buf) else np.empty((2 * m, buf.shape[1]))


@inner()
def _enter(codes, numbers, lengths, points, node, box, w, maps):
    """Write the program of a node to its level, from that of the node around it; its length."""
    level = node[2]
    if level > 0:
        _box_of(points, node[0], node[1], box)
        narrow(codes, numbers, lengths, level - 1, box, w, maps)
    return level, lengths[level]


@in_ranges(TASKS)
@outer(nogil=True)
def values(first, last, op, a, b, imm, points, leaves, nodes, tasks, out):
    """Values (n, 1) at points (n, 3), which nodes of `divide` or `follow` divide.

    ``leaves`` (leaves, n, 1..) has the values of fields computed elsewhere; task k is the nodes
    from ``tasks[k]`` on.
    """
    codes, numbers, lengths, w, maps = begin(op, a, b, imm, LEVELS)
    buf, box = np.empty((64, WIDE)), np.empty((2, 3))
    for task in range(first, last):
        for node in nodes[tasks[task] : tasks[task + 1]]:
            level, m = _enter(codes, numbers, lengths, points, node, box, w, maps)
            if node[3] == 0:
                continue
            buf = _grown(buf, m)
            c = codes[level]
            for i0 in range(node[0], node[1], WIDE):
                i1 = min(node[1], i0 + WIDE)
                _run(c[0], c[1], c[2], numbers[level], m, points, leaves, i0, i1, buf)
                for k in range(i1 - i0):
                    out[i0 + k, 0] = buf[m - 1, k]


@inner()
def _place(r, c):
    """Place of the second derivative by r and c in a jet."""
    return 4 + (r + c if r == 0 or c == 0 else r + c + 1)


@inner()
def _jet(op, a, b, imm, m, point, leaves, at, jet):
    """Value, gradient and the second derivatives xx xy xz yy yz zz of registers."""
    for i in range(m):
        o = op[i]
        if o < ops.INPUTS:
            jet[i, :10] = 0.0
            if o < ops.CONST:
                jet[i, 0], jet[i, 1 + o] = point[o], 1.0
            elif o == ops.CONST:
                jet[i, 0] = imm[i]
            else:
                for j in range(10):
                    jet[i, j] = leaves[a[i], at, j]
            continue
        p, q = jet[a[i]], jet[b[i]]
        v = value(o, p[0], q[0])
        da, db, d_aa, d_ab, d_bb = partials(o, p[0], q[0], v)
        one = o < ops.BINARY
        jet[i, 0] = v
        for k in range(1, 10):
            jet[i, k] = _scaled(da, p[k]) + (0.0 if one else _scaled(db, q[k]))
        if not (d_aa == 0.0 and d_ab == 0.0 and d_bb == 0.0):
            for r in range(3):
                for c in range(r, 3):
                    cross = p[1 + r] * q[1 + c] + p[1 + c] * q[1 + r]
                    jet[i, _place(r, c)] += (
                        d_aa * p[1 + r] * p[1 + c] + d_ab * cross + d_bb * q[1 + r] * q[1 + c]
                    )


@inner()
def _scaled(slope, d):
    """Product in which what does not move has no slope, however steep the function."""
    return 0.0 if d == 0.0 else slope * d


@inner(error_model="numpy")
def _pull(op, u, v, w, z, du, dv, n):
    """Add what the slope z of a result is worth to the slopes of what it was made from."""
    if op == ops.ADD:
        for k in range(n):
            du[k] += z[k]
        for k in range(n):
            dv[k] += z[k]
    elif op == ops.SUB:
        for k in range(n):
            du[k] += z[k]
        for k in range(n):
            dv[k] -= z[k]
    elif op == ops.MUL:
        for k in range(n):
            du[k] += v[k] * z[k]
        for k in range(n):
            dv[k] += u[k] * z[k]
    elif op == ops.SQUARE:
        for k in range(n):
            du[k] += 2.0 * u[k] * z[k]
    elif op == ops.SQRT:
        for k in range(n):
            du[k] += 0.0 if w[k] == 0.0 else 0.5 / w[k] * z[k]
    elif op == ops.MIN:
        for k in range(n):
            du[k] += 0.0 if v[k] < u[k] else z[k]
        for k in range(n):
            dv[k] += z[k] if v[k] < u[k] else 0.0
    elif op == ops.MAX:
        for k in range(n):
            du[k] += 0.0 if v[k] > u[k] else z[k]
        for k in range(n):
            dv[k] += z[k] if v[k] > u[k] else 0.0
    else:
        for k in range(n):
            da, db, _, _, _ = partials(op, u[k], v[k], w[k])
            du[k] += 0.0 if da == 0.0 or z[k] == 0.0 else da * z[k]
            if op >= ops.BINARY:
                dv[k] += 0.0 if db == 0.0 or z[k] == 0.0 else db * z[k]


@inner()
def _back(op, a, b, m, buf, leaves, i0, i1, slope):
    """Slopes of the result by all registers, from the last one back."""
    n = buf.shape[1]
    slope[:m] = 0.0
    slope[m - 1] = 1.0
    for i in range(m - 1, 2, -1):
        if op[i] >= ops.INPUTS:
            p, q = a[i], b[i]
            _pull(op[i], buf[p], buf[q], buf[i], slope[i], slope[p], slope[q], n)
        elif op[i] == ops.LEAF:
            for k in range(i1 - i0):
                for axis in range(3):
                    slope[axis, k] += slope[i, k] * leaves[a[i], i0 + k, 1 + axis]
        elif op[i] < ops.CONST:  # the result is a coordinate, read once more
            for k in range(n):
                slope[op[i], k] += slope[i, k]


@in_ranges(TASKS)
@outer(nogil=True)
def gradients(first, last, op, a, b, imm, points, leaves, nodes, tasks, out):
    """Values and gradients (n, 4) at points; see `values`."""
    codes, numbers, lengths, w, maps = begin(op, a, b, imm, LEVELS)
    buf, slope, box = np.empty((64, FEW)), np.empty((64, FEW)), np.empty((2, 3))
    for task in range(first, last):
        for node in nodes[tasks[task] : tasks[task + 1]]:
            level, m = _enter(codes, numbers, lengths, points, node, box, w, maps)
            if node[3] == 0:
                continue
            buf, slope = _grown(buf, m), _grown(slope, m)
            c = codes[level]
            for i0 in range(node[0], node[1], FEW):
                i1 = min(node[1], i0 + FEW)
                _run(c[0], c[1], c[2], numbers[level], m, points, leaves, i0, i1, buf)
                _back(c[0], c[1], c[2], m, buf, leaves, i0, i1, slope)
                for k in range(i1 - i0):
                    out[i0 + k, 0] = buf[m - 1, k]
                    for axis in range(3):
                        out[i0 + k, 1 + axis] = slope[axis, k]


@in_ranges(TASKS)
@outer(nogil=True)
def jets(first, last, op, a, b, imm, points, leaves, nodes, tasks, out):
    """Jets (n, 10) at points: value, gradient, second derivatives; see `values`."""
    codes, numbers, lengths, w, maps = begin(op, a, b, imm, LEVELS)
    jet, box = np.empty((64, 10)), np.empty((2, 3))
    for task in range(first, last):
        for node in nodes[tasks[task] : tasks[task + 1]]:
            level, m = _enter(codes, numbers, lengths, points, node, box, w, maps)
            if node[3] == 0:
                continue
            jet = _grown(jet, m)
            c = codes[level]
            for i in range(node[0], node[1]):
                _jet(c[0], c[1], c[2], numbers[level], m, points[i], leaves, i, jet)
                out[i] = jet[m - 1]


# ------------------------------------------------------------------------ bounds


@inner()
def _leaf(bound, w):
    """Bounds of a register that is computed elsewhere; its gradient is known by its length."""
    w[0], w[1], w[2], w[3] = bound[0], bound[1], bound[0], bound[1]
    for k in range(3):
        w[4 + 2 * k], w[5 + 2 * k] = -bound[2], bound[2]


@inner()
def _input(op, imm, box, w):
    w[4:] = 0.0
    if op == ops.CONST:
        w[:4] = imm
        return
    mid = 0.5 * (box[0, op] + box[1, op])
    if not abs(mid) < INF:
        mid = max(min(0.0, box[1, op]), box[0, op])
    w[0], w[1], w[2], w[3] = box[0, op], box[1, op], mid, mid
    w[4 + 2 * op] = w[5 + 2 * op] = 1.0


@inner()
def _sum_of_products(da0, da1, p0, p1, db0, db1, q0, q1):
    s, t = product(da0, da1, p0, p1)
    u, v = product(db0, db1, q0, q1)
    lo, hi = s + u, t + v
    pad = 1e-15 * (abs(s) + abs(t) + abs(u) + abs(v))
    lo, hi = lo - pad, hi + pad
    return (lo if lo == lo else -INF), (hi if hi == hi else INF)


@inner()
def _gradients(o, p, q, w):
    """Bounds of the gradient of an instruction, from those of its arguments."""
    da0, da1, db0, db1 = slopes(o, p[0], p[1], q[0], q[1], w[0], w[1])
    for k in range(4, 10, 2):
        if o == ops.MIN or o == ops.MAX:
            first, second = p[1] < q[0], q[1] < p[0]
            if o == ops.MAX:
                first, second = second, first
            if first:
                w[k], w[k + 1] = p[k], p[k + 1]
            elif second:
                w[k], w[k + 1] = q[k], q[k + 1]
            else:
                w[k], w[k + 1] = min(p[k], q[k]), max(p[k + 1], q[k + 1])
        elif o < ops.BINARY:
            w[k], w[k + 1] = _sum_of_products(da0, da1, p[k], p[k + 1], 0.0, 0.0, 0.0, 0.0)
        else:
            w[k], w[k + 1] = _sum_of_products(da0, da1, p[k], p[k + 1], db0, db1, q[k], q[k + 1])


@inner()
def _sharpen(box, w):
    """Cut the bounds with those of the mean-value form about the centre.

    Widened by what rounding does at the centre, several times: computed values stay inside, too.
    """
    rounding = 4.0 * (w[3] - w[2])
    low, high = w[2] - rounding, w[3] + rounding
    for axis in range(3):
        radius = 0.5 * (box[1, axis] - box[0, axis]) * (1.0 + 1e-15)
        radius += 1e-15 * max(abs(box[0, axis]), abs(box[1, axis]))
        steep = max(abs(w[4 + 2 * axis]), abs(w[5 + 2 * axis]))
        reach = 0.0 if steep == 0.0 else steep * radius * (1.0 + 1e-15)
        low -= reach
        high += reach
    if low > w[0] and low <= w[1]:
        w[0] = low
    if high < w[1] and high >= w[0]:
        w[1] = high


@inner()
def bound(op, a, b, imm, m, box, leaves, w):
    """Bounds of all registers on a box: (low, high, low and high at the centre, gradients)."""
    for i in range(m):
        o = op[i]
        if o == ops.LEAF:
            _leaf(leaves[a[i]], w[i])
            continue
        if o < ops.INPUTS:
            _input(o, imm[i], box, w[i])
            continue
        p, q = w[a[i]], w[b[i]]
        w[i, 0], w[i, 1] = bounds(o, p[0], p[1], q[0], q[1])
        w[i, 2], w[i, 3] = bounds(o, p[2], p[3], q[2], q[3])
        _gradients(o, p, q, w[i])
        _sharpen(box, w[i])


@in_ranges(16 * GROUP)
@outer(nogil=True)
def ranges(first, last, op, a, b, imm, lows, highs, leaves, prune, out):
    """Bounds (n, 2) on boxes with corners (n, 3); leaves (n, leaves, 3): low, high, steepness."""
    level = 2 if prune else 0
    codes, numbers, lengths, scratch, maps = begin(op, a, b, imm, 3)
    w, box = np.empty((64, 10)), np.empty((2, 3))
    for start in range(first, last, 16 * GROUP):
        stop = min(last, start + 16 * GROUP)
        if prune:
            _hull(lows, highs, start, stop, box)
            narrow(codes, numbers, lengths, 0, box, scratch, maps)
        for i0 in range(start, stop, GROUP):
            i1 = min(stop, i0 + GROUP)
            if prune:
                _hull(lows, highs, i0, i1, box)
                narrow(codes, numbers, lengths, 1, box, scratch, maps)
            m = lengths[level]
            w = _grown(w, m)
            c = codes[level]
            for i in range(i0, i1):
                box[0], box[1] = lows[i], highs[i]
                bound(c[0], c[1], c[2], numbers[level], m, box, leaves[i], w)
                out[i, 0], out[i, 1] = w[m - 1, 0], w[m - 1, 1]


@inner()
def _hull(lows, highs, i0, i1, box):
    for axis in range(3):
        box[0, axis], box[1, axis] = lows[i0, axis], highs[i0, axis]
    for i in range(i0 + 1, i1):
        for axis in range(3):
            box[0, axis] = min(box[0, axis], lows[i, axis])
            box[1, axis] = max(box[1, axis], highs[i, axis])
