"""The interpreter: programs at points, their derivatives, their bounds on boxes.

A program is four arrays of one length: code, first and second register, constant; its result is
the last register. Where the bounds of a chunk of points decide a minimum or maximum, a shorter
program without the losing side is run for that chunk: a deep tree costs what is near.

Guarantees: results do not depend on the number of threads, nor on what else is evaluated: the
dropped side could not have won. Arguments are not checked.
"""

import numpy as np
from numba import njit, prange

import ilattice.fields._tables as ops
from ilattice.fields._kernels_ops import bounds, partials, product, slopes, value

WIDE = 128  # points evaluated at once
FEW = 32  # points whose derivatives are taken with one program
TASK = 2048  # points or boxes per task
GROUP = 16  # boxes that share a program
INF = np.inf


@njit(cache=True, error_model="numpy")
def shorten(op, a, b, imm, m, box, lo, hi, maps, op2, a2, b2, imm2):
    """Write the program that suffices on a box (2, 3) to op2.. ; return its length.

    ``lo``, ``hi`` and ``maps`` (2, m) are scratch.
    """
    return shorten_bounded(op, a, b, imm, m, box, lo, hi, maps, op2, a2, b2, imm2)[0]


@njit(cache=True, error_model="numpy")
def shorten_bounded(op, a, b, imm, m, box, lo, hi, maps, op2, a2, b2, imm2):
    """`shorten`, and bounds of the result on the box."""
    to = maps[0]
    for i in range(m):
        to[i] = i
        if op[i] < ops.INPUTS:
            if op[i] < ops.CONST:
                lo[i], hi[i] = box[0, op[i]], box[1, op[i]]
            elif op[i] == ops.CONST:
                lo[i] = hi[i] = imm[i]
            else:
                lo[i], hi[i] = -INF, INF
            continue
        p, q = a[i], b[i]
        lo[i], hi[i] = bounds(op[i], lo[p], hi[p], lo[q], hi[q])
        if op[i] == ops.MIN or op[i] == ops.MAX:
            if hi[p] < lo[q]:
                to[i] = to[p] if op[i] == ops.MIN else to[q]
            elif hi[q] < lo[p]:
                to[i] = to[q] if op[i] == ops.MIN else to[p]
    low, high = lo[m - 1], hi[m - 1]
    return _compact(op, a, b, imm, m, lo, to, maps[1], op2, a2, b2, imm2), low, high


@njit(cache=True)
def _compact(op, a, b, imm, m, live, to, new, op2, a2, b2, imm2):
    """Copy the instructions that the last one needs, and the coordinates."""
    live[:m] = 0.0
    live[to[m - 1]] = 1.0
    live[:3] = 1.0
    for i in range(m - 1, 2, -1):
        if live[i] > 0.0 and op[i] >= ops.INPUTS:
            live[to[a[i]]] = 1.0
            if op[i] >= ops.BINARY:
                live[to[b[i]]] = 1.0
    last, k = to[m - 1], 0
    for i in range(last + 1):
        if live[i] == 0.0:
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


@njit(cache=True, error_model="numpy")
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


@njit(cache=True)
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


@njit(cache=True)
def _box_of(points, i0, i1, box):
    for axis in range(3):
        box[0, axis] = box[1, axis] = points[i0, axis]
        for i in range(i0 + 1, i1):
            box[0, axis] = min(box[0, axis], points[i, axis])
            box[1, axis] = max(box[1, axis], points[i, axis])


@njit(cache=True, parallel=True)
def values(op, a, b, imm, points, leaves, prune, out):
    """Values (n,) at points (n, 3); ``leaves`` (leaves, n, 1..) holds those computed elsewhere."""
    n, size = len(points), len(op)
    for task in prange((n + TASK - 1) // TASK):
        start, stop = task * TASK, min(n, (task + 1) * TASK)
        lo, hi, to = np.empty(size), np.empty(size), np.empty((2, size), np.int64)
        codes, numbers = np.empty((6, size + 1), np.int64), np.empty((2, size + 1))
        buf, box = np.empty((size + 1, WIDE)), np.empty((2, 3))
        op1, a1, b1, imm1 = codes[0], codes[1], codes[2], numbers[0]
        op2, a2, b2, imm2 = codes[3], codes[4], codes[5], numbers[1]
        m1 = size
        if prune:
            _box_of(points, start, stop, box)
            m1 = shorten(op, a, b, imm, size, box, lo, hi, to, op1, a1, b1, imm1)
        for i0 in range(start, stop, WIDE):
            i1 = min(stop, i0 + WIDE)
            if prune:
                _box_of(points, i0, i1, box)
                m = shorten(op1, a1, b1, imm1, m1, box, lo, hi, to, op2, a2, b2, imm2)
                _run(op2, a2, b2, imm2, m, points, leaves, i0, i1, buf)
            else:
                m = size
                _run(op, a, b, imm, m, points, leaves, i0, i1, buf)
            for k in range(i1 - i0):
                out[i0 + k] = buf[m - 1, k]


@njit(cache=True)
def _place(r, c):
    """Place of the second derivative by r and c in a jet."""
    return 4 + (r + c if r == 0 or c == 0 else r + c + 1)


@njit(cache=True)
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
                jet[i, :10] = leaves[a[i], at, :10]
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


@njit(cache=True)
def _scaled(slope, d):
    """Product in which what does not move has no slope, however steep the function."""
    return 0.0 if d == 0.0 else slope * d


@njit(cache=True, error_model="numpy")
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


@njit(cache=True)
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


@njit(cache=True, parallel=True)
def gradients(op, a, b, imm, points, leaves, prune, out):
    """Values and gradients (n, 4) at points."""
    n, size = len(points), len(op)
    for task in prange((n + TASK - 1) // TASK):
        start, stop = task * TASK, min(n, (task + 1) * TASK)
        lo, hi, to = np.empty(size), np.empty(size), np.empty((2, size), np.int64)
        codes, numbers = np.empty((6, size + 1), np.int64), np.empty((2, size + 1))
        buf, slope = np.empty((size + 1, FEW)), np.empty((size + 1, FEW))
        op1, a1, b1, imm1 = codes[0], codes[1], codes[2], numbers[0]
        op2, a2, b2, imm2 = codes[3], codes[4], codes[5], numbers[1]
        box, m1 = np.empty((2, 3)), size
        if prune:
            _box_of(points, start, stop, box)
            m1 = shorten(op, a, b, imm, size, box, lo, hi, to, op1, a1, b1, imm1)
        for i0 in range(start, stop, FEW):
            i1 = min(stop, i0 + FEW)
            m = size
            if prune:
                _box_of(points, i0, i1, box)
                m = shorten(op1, a1, b1, imm1, m1, box, lo, hi, to, op2, a2, b2, imm2)
                _run(op2, a2, b2, imm2, m, points, leaves, i0, i1, buf)
                _back(op2, a2, b2, m, buf, leaves, i0, i1, slope)
            else:
                _run(op, a, b, imm, m, points, leaves, i0, i1, buf)
                _back(op, a, b, m, buf, leaves, i0, i1, slope)
            for k in range(i1 - i0):
                out[i0 + k, 0] = buf[m - 1, k]
                for axis in range(3):
                    out[i0 + k, 1 + axis] = slope[axis, k]


@njit(cache=True, parallel=True)
def jets(op, a, b, imm, points, leaves, prune, out):
    """Jets (n, 10) at points: value, gradient, second derivatives."""
    n, size = len(points), len(op)
    for task in prange((n + TASK - 1) // TASK):
        start, stop = task * TASK, min(n, (task + 1) * TASK)
        lo, hi, to = np.empty(size), np.empty(size), np.empty((2, size), np.int64)
        codes, numbers = np.empty((6, size + 1), np.int64), np.empty((2, size + 1))
        jet, box = np.empty((size + 1, 10)), np.empty((2, 3))
        op1, a1, b1, imm1 = codes[0], codes[1], codes[2], numbers[0]
        op2, a2, b2, imm2 = codes[3], codes[4], codes[5], numbers[1]
        m1 = size
        if prune:
            _box_of(points, start, stop, box)
            m1 = shorten(op, a, b, imm, size, box, lo, hi, to, op1, a1, b1, imm1)
        for i0 in range(start, stop, FEW):
            i1 = min(stop, i0 + FEW)
            m = size
            if prune:
                _box_of(points, i0, i1, box)
                m = shorten(op1, a1, b1, imm1, m1, box, lo, hi, to, op2, a2, b2, imm2)
            for i in range(i0, i1):
                if prune:
                    _jet(op2, a2, b2, imm2, m, points[i], leaves, i, jet)
                else:
                    _jet(op, a, b, imm, m, points[i], leaves, i, jet)
                out[i] = jet[m - 1]


# ------------------------------------------------------------------------ bounds


@njit(cache=True)
def _leaf(bound, w):
    """Bounds of a register that is computed elsewhere; its gradient is known by its length."""
    w[0], w[1], w[2], w[3] = bound[0], bound[1], bound[0], bound[1]
    for k in range(3):
        w[4 + 2 * k], w[5 + 2 * k] = -bound[2], bound[2]


@njit(cache=True)
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


@njit(cache=True)
def _sum_of_products(da0, da1, p0, p1, db0, db1, q0, q1):
    s, t = product(da0, da1, p0, p1)
    u, v = product(db0, db1, q0, q1)
    lo, hi = s + u, t + v
    pad = 1e-15 * (abs(s) + abs(t) + abs(u) + abs(v))
    lo, hi = lo - pad, hi + pad
    return (lo if lo == lo else -INF), (hi if hi == hi else INF)


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True, parallel=True)
def ranges(op, a, b, imm, lows, highs, leaves, prune, out):
    """Bounds (n, 2) on boxes with corners (n, 3); leaves (n, leaves, 3): low, high, steepness."""
    n, size = len(lows), len(op)
    for task in prange((n + 16 * GROUP - 1) // (16 * GROUP)):
        start, stop = task * 16 * GROUP, min(n, (task + 1) * 16 * GROUP)
        lo, hi, to = np.empty(size), np.empty(size), np.empty((2, size), np.int64)
        codes, numbers = np.empty((6, size + 1), np.int64), np.empty((2, size + 1))
        w, box = np.empty((size + 1, 10)), np.empty((2, 3))
        op1, a1, b1, imm1 = codes[0], codes[1], codes[2], numbers[0]
        op2, a2, b2, imm2 = codes[3], codes[4], codes[5], numbers[1]
        m1 = size
        if prune:
            _hull(lows, highs, start, stop, box)
            m1 = shorten(op, a, b, imm, size, box, lo, hi, to, op1, a1, b1, imm1)
        for i0 in range(start, stop, GROUP):
            i1, m = min(stop, i0 + GROUP), size
            if prune:
                _hull(lows, highs, i0, i1, box)
                m = shorten(op1, a1, b1, imm1, m1, box, lo, hi, to, op2, a2, b2, imm2)
            for i in range(i0, i1):
                box[0], box[1] = lows[i], highs[i]
                if prune:
                    bound(op2, a2, b2, imm2, m, box, leaves[i], w)
                else:
                    bound(op, a, b, imm, m, box, leaves[i], w)
                out[i, 0], out[i, 1] = w[m - 1, 0], w[m - 1, 1]


@njit(cache=True)
def _hull(lows, highs, i0, i1, box):
    box[0], box[1] = lows[i0], highs[i0]
    for i in range(i0 + 1, i1):
        for axis in range(3):
            box[0, axis] = min(box[0, axis], lows[i, axis])
            box[1, axis] = max(box[1, axis], highs[i, axis])
