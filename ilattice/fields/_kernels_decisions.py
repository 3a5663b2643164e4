"""Which sides of minima, maxima and absolute values win on a box, by rigorous bounds.

Guarantees: a side that is called the winner is so in all of the box, or else the sign of the result
does not depend on it. Arguments are not checked.
"""

import numpy as np

import ilattice.fields._tables as ops
from ilattice._kernels import in_ranges, inner, outer
from ilattice.fields._kernels_program import bound

#: States of choices; steps in between numbers have `STEP` + 2 (number + `ORIGIN`), and one more if
#: the next number occurs as well.
OPEN, FIRST, SECOND, DEAD, STEP = 0, 1, 2, 3, 4
ORIGIN = 1 << 40
TASK = 64  # boxes


@inner()
def _live(op, a, b, m, w, cap, floor, live, states):
    """States of all minima and maxima, and `live` registers, for the sign of the result only."""
    live[:m] = 0
    live[m - 1] = 1
    cap[m - 1] = 0.0
    floor[m - 1] = 0.0
    for i in range(m - 1, -1, -1):
        states[i] = DEAD
        if live[i] == 0 or op[i] < ops.INPUTS:
            continue
        states[i] = OPEN
        c, f = np.inf, -np.inf
        p, q = a[i], b[i]
        first, second = True, op[i] >= ops.BINARY
        if op[i] == ops.MIN:
            c, f = min(cap[i], w[i, 1]), floor[i]
            second = w[p, 0] > c or not w[q, 0] > c
            first = not second or not w[p, 0] > c
        elif op[i] == ops.MAX:
            c, f = cap[i], max(floor[i], w[i, 0])
            second = w[p, 1] < f or not w[q, 1] < f
            first = not second or not w[p, 1] < f
        if not (first and second) and op[i] >= ops.BINARY:
            states[i] = FIRST if first else SECOND
        for side in range(2):
            if first if side == 0 else second:
                k = p if side == 0 else q
                if live[k] == 0:
                    live[k], cap[k], floor[k] = 1, c, f
                else:
                    cap[k], floor[k] = max(cap[k], c), min(floor[k], f)


@inner(error_model="numpy")
def _step(o, low, high, period):
    """State of a function with steps, for bounds of what it is taken of."""
    if o == ops.CEIL:
        low, high = np.ceil(low), np.ceil(high)
    else:
        shift = 0.5 if o == ops.WRAP else 0.0
        if o == ops.FLOOR:
            period = 1.0
        low, high = np.floor(low / period + shift), np.floor(high / period + shift)
    if not (period > 0.0 and high - low <= 1.0 and abs(low) < 1e9):
        return OPEN
    return STEP + 2 * (int(low) + ORIGIN) + int(high - low)


@in_ranges(TASK)
@outer(nogil=True)
def decide(first, last, op, a, b, imm, lows, highs, leaves, choices, out, states):
    """Bounds out (n, 2) on boxes with corners (n, 3), and the states (n, k) of some instructions.

    Leaves are those of `ranges`.
    """
    m = len(op)
    w, box = np.empty((m, 10)), np.empty((2, 3))
    cap, floor = np.empty(m), np.empty(m)
    live, state = np.empty(m, np.int64), np.empty(m, np.int64)
    for i in range(first, last):
        box[0], box[1] = lows[i], highs[i]
        bound(op, a, b, imm, m, box, leaves[i], w)
        out[i, 0], out[i, 1] = w[m - 1, 0], w[m - 1, 1]
        _live(op, a, b, m, w, cap, floor, live, state)
        for k in range(len(choices)):
            j = choices[k]
            s = state[j]
            if s != DEAD:
                low, high = w[a[j], 0], w[a[j], 1]
                if op[j] == ops.ABS or op[j] == ops.SIGN:
                    s = FIRST if low >= 0.0 else SECOND if high <= 0.0 else OPEN
                elif op[j] != ops.MIN and op[j] != ops.MAX:
                    period = imm[b[j]] if op[b[j]] == ops.CONST else 0.0
                    s = _step(op[j], low, high, period)
            states[i, k] = s
