"""Values and gradients of separable trigonometric polynomials, many points at a time.

Points are taken in groups of `LANES`, with one loop over the group per operation: such loops
become vector instructions, which makes this several times faster than `_kernels.trig_jet`, even
where only values are asked for.

Guarantees: those of `_kernels`; a point has the same result in any place of any group.
"""

from typing import Any

import numpy as np

from ilattice._kernels import in_ranges, inner, outer
from ilattice.tiles._kernels import _C, _S, CHUNK, FAST, TURNS, TWO_PI

#: Points of a group, one lane of the inner loops each.
LANES = 64
_S1, _S2, _S3, _S4, _S5, _S6, _S7 = _S[1:]
_C1, _C2, _C3, _C4, _C5, _C6, _C7, _C8 = _C[1:]


@inner(fastmath=FAST)
def _sincos(turns: Any, s: Any, c: Any) -> None:
    """`_kernels.sincos_turns` of a group, without branches."""
    for i in range(LANES):
        q = np.rint(4.0 * turns[i])
        r = (turns[i] - 0.25 * q) * TWO_PI
        v = r * r
        v2 = v * v
        v4 = v2 * v2
        x = (_S1 + v * _S2) + v2 * (_S3 + v * _S4) + v4 * ((_S5 + v * _S6) + v2 * _S7)
        x = r + r * v * x
        y = (_C1 + v * _C2) + v2 * (_C3 + v * _C4) + v4 * ((_C5 + v * _C6) + v2 * (_C7 + v * _C8))
        y = 1.0 + v * y
        k = q - 4.0 * np.floor(0.25 * q)
        odd = (k == 1.0) | (k == 3.0)
        s[i] = (-y if k == 3.0 else y) if odd else (-x if k == 2.0 else x)
        c[i] = (-x if k == 1.0 else x) if odd else (-y if k == 2.0 else y)


@inner(fastmath=FAST)
def _axis_rows(rows: Any, w: float, turns: Any) -> None:
    """Fill in the factors of an axis: per code LANES values, then LANES derivatives.

    Code 0, the constant, is there already.
    """
    c1 = rows[2 * LANES : 3 * LANES]
    s1 = rows[4 * LANES : 5 * LANES]
    _sincos(turns, s1, c1)
    for h in range(1, len(rows) // (4 * LANES) + 1):
        now = rows[(4 * h - 2) * LANES : (4 * h + 2) * LANES]
        if h > 1:
            before = rows[(4 * h - 6) * LANES : (4 * h - 2) * LANES]
            for i in range(LANES):
                c, s = before[i], before[2 * LANES + i]
                now[i] = c * c1[i] - s * s1[i]
                now[2 * LANES + i] = s * c1[i] + c * s1[i]
        for i in range(LANES):
            now[LANES + i] = -(h * w) * now[2 * LANES + i]
            now[3 * LANES + i] = (h * w) * now[i]


@inner(fastmath=FAST)
def _add_term(coef: float, x: Any, y: Any, z: Any, out: Any) -> None:
    """Add a term to LANES values, then LANES each of the derivatives along x, y and z."""
    for i in range(LANES):
        yz = coef * y[i] * z[i]
        kx = coef * x[i]
        out[i] += yz * x[i]
        out[LANES + i] += yz * x[LANES + i]
        out[2 * LANES + i] += kx * z[i] * y[LANES + i]
        out[3 * LANES + i] += kx * y[i] * z[LANES + i]


@inner()
def _add_terms(coef: Any, factor: Any, rows: Any, out: Any) -> None:
    """Add all terms: products of three factors, rows (3, .) of values and derivatives."""
    size = 2 * LANES
    for m in range(len(coef)):
        x, y, z = size * factor[m, 0], size * factor[m, 1], size * factor[m, 2]
        _add_term(coef[m], rows[0, x : x + size], rows[1, y : y + size], rows[2, z : z + size], out)


@in_ranges(CHUNK)
@outer(nogil=True, error_model="numpy")
def _gradients(
    first: int, last: int, coef: Any, factor: Any, w: Any, p: Any, f: Any, g: Any
) -> None:
    top = 1
    for i in range(len(factor)):
        for a in range(3):
            top = max(top, (factor[i, a] + 1) // 2)
    rows = np.zeros((3, (2 * top + 1) * 2 * LANES))
    rows[:, :LANES] = 1.0
    turns = np.zeros(LANES)
    out = np.empty(4 * LANES)
    for at in range(first, last, LANES):
        count = min(LANES, last - at)
        for a in range(3):
            for i in range(count):
                turns[i] = p[at + i, a] * (w[a] * TURNS)
            _axis_rows(rows[a], w[a], turns)
        out[:] = 0.0
        _add_terms(coef, factor, rows, out)
        for i in range(count):
            f[at + i] = out[i]
        for i in range(count if len(g) else 0):
            for a in range(3):
                g[at + i, a] = out[(a + 1) * LANES + i]


def values(coef: Any, factor: Any, w: Any, p: Any) -> Any:
    """Values, shape (n,), at points ``p`` (n, 3)."""
    f = np.empty(len(p))
    _gradients(len(p), coef, factor, w, p, f, np.empty((0, 3)))
    return f


def gradients(coef: Any, factor: Any, w: Any, p: Any) -> Any:
    """Values (n,) and gradients (n, 3) at points ``p`` (n, 3)."""
    n = len(p)
    f, g = np.empty(n), np.empty((n, 3))
    _gradients(n, coef, factor, w, p, f, g)
    return f, g
