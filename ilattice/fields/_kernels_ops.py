"""One instruction: its value, its derivatives, its bounds, on single numbers.

Guarantees: `bounds` holds the exact value and the one that `value` computes, for all arguments in
the given intervals; `slopes` holds all generalised derivatives there, or everything where the
instruction jumps. NaN stays NaN; where an argument leaves the domain of a function, bounds are
those of the part inside it. ``wrap(a, b)`` is ``a`` less the nearest multiple of b.
"""

import numpy as np

import ilattice.fields._tables as ops
from ilattice._kernels import inner, outer

INF = np.inf
#: Relative widening of a range for the rounding of its ends, and one for ends near zero.
PAD = 8.0 * 2.220446049250313e-16
TINY = 1e-300
HALF_PI = 0.5 * np.pi
FAR = 1e9  # angles beyond this are not reduced


@outer(error_model="numpy")
def value(op, a, b):
    """Value of an instruction."""
    if op == ops.ADD:
        return a + b
    if op == ops.MUL:
        return a * b
    if op == ops.SUB:
        return a - b
    if op == ops.MIN:
        return b if b < a or b != b else a
    if op == ops.MAX:
        return b if b > a or b != b else a
    if op == ops.SQUARE:
        return a * a
    if op == ops.SQRT:
        return np.sqrt(a)
    if op == ops.NEG:
        return -a
    if op == ops.ABS:
        return abs(a)
    if op == ops.DIV:
        return a / b
    return _rare(op, a, b)


@inner(error_model="numpy")
def _rare(op, a, b):
    if op == ops.SIN:
        return np.sin(a)
    if op == ops.COS:
        return np.cos(a)
    if op == ops.TAN:
        return np.tan(a)
    if op == ops.ASIN:
        return np.arcsin(a)
    if op == ops.ACOS:
        return np.arccos(a)
    if op == ops.ATAN:
        return np.arctan(a)
    if op == ops.SINH:
        return np.sinh(a)
    if op == ops.COSH:
        return np.cosh(a)
    if op == ops.TANH:
        return np.tanh(a)
    if op == ops.EXP:
        return np.exp(a)
    if op == ops.LOG:
        return np.log(a)
    if op == ops.SIGN:
        return np.sign(a)
    if op == ops.FLOOR:
        return np.floor(a)
    if op == ops.CEIL:
        return np.ceil(a)
    if op == ops.POW:
        return np.power(a, b)
    if op == ops.ATAN2:
        return np.arctan2(a, b)
    if op == ops.MOD:
        return a - b * np.floor(a / b)
    return a - b * np.floor(a / b + 0.5)


@inner(error_model="numpy")
def partials(op, a, b, v):
    """Derivatives by a and b, then by aa, ab and bb; zero at the tip of a square root."""
    if op == ops.ADD:
        return 1.0, 1.0, 0.0, 0.0, 0.0
    if op == ops.SUB:
        return 1.0, -1.0, 0.0, 0.0, 0.0
    if op == ops.MUL:
        return b, a, 0.0, 1.0, 0.0
    if op == ops.DIV:
        r = 1.0 / b
        return r, -v * r, 0.0, -r * r, 2.0 * v * r * r
    if op == ops.MIN:
        return (0.0, 1.0, 0.0, 0.0, 0.0) if b < a else (1.0, 0.0, 0.0, 0.0, 0.0)
    if op == ops.MAX:
        return (0.0, 1.0, 0.0, 0.0, 0.0) if b > a else (1.0, 0.0, 0.0, 0.0, 0.0)
    if op == ops.POW:
        return _partials_power(a, b, v)
    if op == ops.ATAN2:
        q = a * a + b * b
        if q == 0.0:
            return 0.0, 0.0, 0.0, 0.0, 0.0
        s = 2.0 * a * b / (q * q)
        return b / q, -a / q, -s, (a * a - b * b) / (q * q), s
    if op == ops.MOD:
        return 1.0, -np.floor(a / b), 0.0, 0.0, 0.0
    if op == ops.WRAP:
        return 1.0, -np.floor(a / b + 0.5), 0.0, 0.0, 0.0
    d, dd = _derivatives(op, a, v)
    return d, 0.0, dd, 0.0, 0.0


@inner(error_model="numpy")
def _partials_power(a, b, v):
    da = 0.0 if b == 0.0 else b * a ** (b - 1.0)
    d_aa = 0.0 if b == 0.0 or b == 1.0 else b * (b - 1.0) * a ** (b - 2.0)
    if not a > 0.0:  # the logarithm does not exist; constant exponents need none of it
        return da, 0.0, d_aa, 0.0, 0.0
    log = np.log(a)
    return da, v * log, d_aa, (v + b * v * log) / a, v * log * log


@inner(error_model="numpy")
def _derivatives(op, a, v):
    """First and second derivative of a function of one argument."""
    if op == ops.SQUARE:
        return 2.0 * a, 2.0
    if op == ops.NEG:
        return -1.0, 0.0
    if op == ops.ABS:
        return np.sign(a), 0.0
    if op == ops.SQRT:
        if v == 0.0:
            return 0.0, 0.0
        return 0.5 / v, -0.25 / (v * a)
    if op == ops.SIN:
        return np.cos(a), -v
    if op == ops.COS:
        return -np.sin(a), -v
    if op == ops.TAN:
        return 1.0 + v * v, 2.0 * v * (1.0 + v * v)
    if op == ops.ASIN:
        r = 1.0 / np.sqrt(1.0 - a * a)
        return r, a * r * r * r
    if op == ops.ACOS:
        r = 1.0 / np.sqrt(1.0 - a * a)
        return -r, -a * r * r * r
    if op == ops.ATAN:
        r = 1.0 / (1.0 + a * a)
        return r, -2.0 * a * r * r
    if op == ops.SINH:
        return np.cosh(a), v
    if op == ops.COSH:
        return np.sinh(a), v
    if op == ops.TANH:
        return 1.0 - v * v, -2.0 * v * (1.0 - v * v)
    if op == ops.EXP:
        return v, v
    if op == ops.LOG:
        return 1.0 / a, -1.0 / (a * a)
    return 0.0, 0.0


# ------------------------------------------------------------------------ bounds


@inner()
def _wide(lo, hi):
    """An interval, widened by the rounding of a few operations; everything instead of NaN."""
    lo, hi = lo - PAD * abs(lo) - TINY, hi + PAD * abs(hi) + TINY
    return (lo if lo == lo else -INF), (hi if hi == hi else INF)


@inner()
def _times(a, b):
    """Product of ends of intervals: zero times infinity is zero."""
    return 0.0 if a == 0.0 or b == 0.0 else a * b


@inner()
def product(al, ah, bl, bh):
    """Product of two intervals."""
    p, q, r, s = _times(al, bl), _times(al, bh), _times(ah, bl), _times(ah, bh)
    return min(min(p, q), min(r, s)), max(max(p, q), max(r, s))


@inner(error_model="numpy")
def _quotient(al, ah, bl, bh):
    if bl <= 0.0 <= bh:
        return -INF, INF
    return product(al, ah, *_wide(1.0 / bh, 1.0 / bl))


@inner()
def _sine(lo, hi):
    """Bounds of the sine."""
    if not (abs(lo) < FAR and abs(hi) < FAR and hi - lo < 2.0 * np.pi):
        return -1.0, 1.0
    slack = PAD * (1.0 + max(abs(lo), abs(hi)))
    a, b = np.sin(lo), np.sin(hi)
    low, high = min(a, b) - slack, max(a, b) + slack
    t = (lo - HALF_PI - slack) / (2.0 * np.pi)
    if (np.ceil(t - PAD * (1.0 + abs(t))) * 2.0 * np.pi) + HALF_PI <= hi + slack:
        high = 1.0
    t = (lo + HALF_PI - slack) / (2.0 * np.pi)
    if (np.ceil(t - PAD * (1.0 + abs(t))) * 2.0 * np.pi) - HALF_PI <= hi + slack:
        low = -1.0
    return max(low, -1.0), min(high, 1.0)


@inner()
def _cosine(lo, hi):
    slack = PAD * (1.0 + max(abs(lo), abs(hi)))
    return _sine(lo + HALF_PI - slack, hi + HALF_PI + slack)


@inner(error_model="numpy")
def _arc_tangent(al, ah, bl, bh):
    """Bounds of atan2(a, b)."""
    if bl > 0.0 or al > 0.0 or ah < 0.0:  # does not cross the cut
        p, q = np.arctan2(al, bl), np.arctan2(al, bh)
        r, s = np.arctan2(ah, bl), np.arctan2(ah, bh)
        return _wide(min(min(p, q), min(r, s)), max(max(p, q), max(r, s)))
    return _wide(-np.pi, np.pi)


@inner(error_model="numpy")
def _power(al, ah, bl, bh):
    if bl == bh and bl == np.floor(bl) and abs(bl) < 1e6:
        return _whole_power(al, ah, bl)
    if al < 0.0 and not (bl == bh and bl > 0.0):
        return -INF, INF
    a0 = max(al, 0.0)  # a negative base has no real power
    if a0 == 0.0 and bl <= 0.0:
        return 0.0, INF
    p, q, r, s = a0**bl, a0**bh, ah**bl, ah**bh
    return _wide(min(min(p, q), min(r, s)), max(max(p, q), max(r, s)))


@inner(error_model="numpy")
def _whole_power(al, ah, b):
    if b < 0.0:
        lo, hi = _whole_power(al, ah, -b)
        if lo <= 0.0 <= hi:
            return -INF, INF
        return _wide(1.0 / hi, 1.0 / lo)
    p, q = al**b, ah**b
    lo, hi = min(p, q), max(p, q)
    if b % 2.0 == 0.0 and al < 0.0 < ah:
        lo = 1.0 if b == 0.0 else 0.0
    return _wide(lo, hi)


@inner(error_model="numpy")
def _remainder(op, al, ah, bl, bh):
    """Bounds of mod and wrap, tight for a constant positive divisor and one turn."""
    top = max(abs(bl), abs(bh))
    shift = 0.5 if op == ops.WRAP else 0.0
    if bl == bh and bl > 0.0 and abs(al) < INF and abs(ah) < INF:
        k = np.floor(_wide(al / bl + shift, 0.0)[0])
        if k == np.floor(_wide(0.0, ah / bl + shift)[1]):
            slack = PAD * (abs(al) + abs(ah) + top)
            return al - bl * k - slack, ah - bl * k + slack
    slack = PAD * (top + (max(abs(al), abs(ah))))
    if op == ops.WRAP:
        return -0.5 * top - slack, 0.5 * top + slack
    return (0.0 if bl > 0.0 else -top) - slack, (0.0 if bh < 0.0 else top) + slack


@inner(error_model="numpy")
def bounds(op, al, ah, bl, bh):
    """Bounds of an instruction on intervals of its arguments."""
    if op == ops.ADD:
        return _wide(al + bl, ah + bh)
    if op == ops.SUB:
        return _wide(al - bh, ah - bl)
    if op == ops.MUL:
        lo, hi = product(al, ah, bl, bh)
        return _wide(lo, hi)
    if op == ops.MIN:
        return min(al, bl), min(ah, bh)
    if op == ops.MAX:
        return max(al, bl), max(ah, bh)
    if op == ops.NEG:
        return -ah, -al
    if op == ops.ABS or op == ops.SQUARE:
        lo, hi = (0.0 if al <= 0.0 <= ah else min(abs(al), abs(ah))), max(abs(al), abs(ah))
        if op == ops.ABS:
            return lo, hi
        return max(lo * lo * (1.0 - PAD) - TINY, 0.0), hi * hi * (1.0 + PAD) + TINY
    if op == ops.SQRT:
        lo = np.sqrt(max(al, 0.0)) * (1.0 - PAD)
        return lo, (np.sqrt(ah) * (1.0 + PAD) if ah >= 0.0 else INF)
    if op == ops.DIV:
        lo, hi = _quotient(al, ah, bl, bh)
        return _wide(lo, hi)
    return _rare_bounds(op, al, ah, bl, bh)


@inner(error_model="numpy")
def _rare_bounds(op, al, ah, bl, bh):
    if op == ops.SIN:
        return _sine(al, ah)
    if op == ops.COS:
        return _cosine(al, ah)
    if op == ops.TAN:
        if ah - al >= np.pi or not (abs(al) < FAR and abs(ah) < FAR):
            return -INF, INF
        lo, hi = _cosine(al, ah)
        if lo <= 0.0 <= hi:
            return -INF, INF
        slack = 1.0 + max(abs(al), abs(ah))
        p, q = np.tan(al), np.tan(ah)
        return p - PAD * slack * (1.0 + p * p), q + PAD * slack * (1.0 + q * q)
    if op == ops.ASIN:
        return _wide(np.arcsin(min(max(al, -1.0), 1.0)), np.arcsin(min(max(ah, -1.0), 1.0)))
    if op == ops.ACOS:
        return _wide(np.arccos(min(max(ah, -1.0), 1.0)), np.arccos(min(max(al, -1.0), 1.0)))
    if op == ops.ATAN:
        return _wide(np.arctan(al), np.arctan(ah))
    if op == ops.SINH:
        return _wide(np.sinh(al), np.sinh(ah))
    if op == ops.COSH:
        lo = 0.0 if al <= 0.0 <= ah else min(abs(al), abs(ah))
        return _wide(np.cosh(lo), np.cosh(max(abs(al), abs(ah))))
    if op == ops.TANH:
        return _wide(np.tanh(al), np.tanh(ah))
    if op == ops.EXP:
        return _wide(np.exp(al), np.exp(ah))
    if op == ops.LOG:
        lo = np.log(al) if al > 0.0 else -INF
        hi = np.log(ah) if ah > 0.0 else INF
        return lo - PAD * (1.0 + abs(lo)), hi + PAD * (1.0 + abs(hi))
    if op == ops.SIGN:
        return np.sign(al), np.sign(ah)
    if op == ops.FLOOR:
        return np.floor(al), np.floor(ah)
    if op == ops.CEIL:
        return np.ceil(al), np.ceil(ah)
    if op == ops.POW:
        return _power(al, ah, bl, bh)
    if op == ops.ATAN2:
        return _arc_tangent(al, ah, bl, bh)
    return _remainder(op, al, ah, bl, bh)


@inner(error_model="numpy")
def slopes(op, al, ah, bl, bh, vl, vh):
    """Bounds of the derivatives by a and by b; those of min and max are joined elsewhere."""
    if op == ops.ADD:
        return 1.0, 1.0, 1.0, 1.0
    if op == ops.SUB:
        return 1.0, 1.0, -1.0, -1.0
    if op == ops.MUL:
        return bl, bh, al, ah
    if op == ops.DIV:
        rl, rh = _quotient(1.0, 1.0, bl, bh)
        sl, sh = product(vl, vh, rl, rh)
        return rl, rh, -sh, -sl
    if op == ops.ATAN2:
        if not (bl > 0.0 or al > 0.0 or ah < 0.0):
            return -INF, INF, -INF, INF
        q0, q1 = bounds(ops.SQUARE, al, ah, 0.0, 0.0)
        r0, r1 = bounds(ops.SQUARE, bl, bh, 0.0, 0.0)
        s, t = _quotient(bl, bh, q0 + r0, q1 + r1)
        u, v = _quotient(-ah, -al, q0 + r0, q1 + r1)
        return s, t, u, v
    if op == ops.POW:
        if bl != bh:
            return -INF, INF, -INF, INF
        if bl == 0.0:
            return 0.0, 0.0, 0.0, 0.0
        lo, hi = _power(al, ah, bl - 1.0, bl - 1.0)
        lo, hi = product(lo, hi, bl, bl)
        return lo, hi, 0.0, 0.0
    if op == ops.MOD or op == ops.WRAP:
        lo, hi = (al / bl, ah / bl) if op == ops.MOD else (al / bl + 0.5, ah / bl + 0.5)
        lo, hi = _wide(lo, hi)
        if bl == bh and bl > 0.0 and np.floor(lo) == np.floor(hi):
            return 1.0, 1.0, 0.0, 0.0
        return -INF, INF, -INF, INF
    lo, hi = _slopes_of_one(op, al, ah, vl, vh)
    return lo, hi, 0.0, 0.0


@inner(error_model="numpy")
def _slopes_of_one(op, al, ah, vl, vh):
    if op == ops.SQUARE:
        return 2.0 * al, 2.0 * ah
    if op == ops.NEG:
        return -1.0, -1.0
    if op == ops.ABS:
        return (1.0 if al > 0.0 else -1.0), (-1.0 if ah < 0.0 else 1.0)
    if op == ops.SQRT:
        return 0.5 / vh, (0.5 / vl if vl > 0.0 else INF)
    if op == ops.SIN:
        return _cosine(al, ah)
    if op == ops.COS:
        lo, hi = _sine(al, ah)
        return -hi, -lo
    if op == ops.EXP:
        return vl, vh
    if op == ops.SINH:
        return bounds(ops.COSH, al, ah, 0.0, 0.0)
    if op == ops.COSH:
        return bounds(ops.SINH, al, ah, 0.0, 0.0)
    if op == ops.TANH or op == ops.TAN:
        lo, hi = bounds(ops.SQUARE, vl, vh, 0.0, 0.0)
        return (1.0 - hi, 1.0 - lo) if op == ops.TANH else (1.0 + lo, 1.0 + hi)
    if op == ops.ATAN:
        lo, hi = bounds(ops.SQUARE, al, ah, 0.0, 0.0)
        return 1.0 / (1.0 + hi), 1.0 / (1.0 + lo)
    if op == ops.LOG:
        return (1.0 / ah, 1.0 / al) if al > 0.0 else (-INF, INF)
    if (op == ops.ASIN or op == ops.ACOS) and -1.0 < al and ah < 1.0:
        lo, hi = bounds(ops.SQUARE, al, ah, 0.0, 0.0)
        lo, hi = 1.0 / np.sqrt(1.0 - lo), (1.0 / np.sqrt(1.0 - hi) if hi < 1.0 else INF)
        return (lo, hi) if op == ops.ASIN else (-hi, -lo)
    if vl == vh and (op == ops.SIGN or op == ops.FLOOR or op == ops.CEIL):
        return 0.0, 0.0
    return -INF, INF
