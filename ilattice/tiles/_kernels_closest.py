"""Kernels of the least distance to one Bézier curve or surface of varying thickness.

A piece has homogeneous Bézier points ``(x w, y w, z w, r w, w)``. Wanted is the least
``F(t) = |x - C(t)| - r(t)`` below a bound ``b``. Relative to the query,
``q = (P - x w, (r + b) w)`` has the Lorentz square ``N = |q_1|² + |q_2|² + |q_3|² - q_4²``, a
polynomial that is negative exactly where F < b (as far as r + b > 0). Its Bernstein coefficients
bound it, those of its derivatives tell where it has one minimum only; there Newton finds it,
elsewhere the piece is halved.

Guarantees: no minimum is lost: a part is dropped only if its coefficients prove that F >= b there.
Of a surface the minima in its interior are sought: its four boundary curves are pieces of their
own. For a constant radius and equal weights the result does not depend on the bound.
"""

import math
from typing import Any

import numpy as np

from ilattice._kernels import inner
from ilattice.bspline._kernels_bernstein import halve_line

# Without "reassoc": sums over a few terms keep their order.
FAST = {"contract", "nsz", "arcp"}
#: Most entries on the stack of parts yet to be looked at.
DEPTH = 96
#: Highest degree of a piece, that of its radius included; N has twice that.
MAX_DEGREE = 12
_N = 2 * MAX_DEGREE + 1
BINOMIAL = np.array([[math.comb(n, k) for k in range(_N)] for n in range(_N)], dtype=np.float64)
#: Rounding of the coefficients of N, relative to the largest square.
EPS = 8e-15
#: Parts of a piece, by parameter, below which no proof is waited for: their error of the foot is
#: squared in the distance, and so below rounding.
SHORTEST = 1e-9
#: Columns of a hit: F, foot (3), parameters (2).
F, FOOT, AT = 0, 1, 4


@inner(fastmath=FAST)
def _load(data: Any, start: int, step: int, n: int, x: float, y: float, z: float, out: Any) -> None:
    """Bézier points, `step` apart, relative to the query."""
    for i in range(n):
        a = start + step * i
        w = data[a + 4]
        out[5 * i] = data[a] - x * w
        out[5 * i + 1] = data[a + 1] - y * w
        out[5 * i + 2] = data[a + 2] - z * w
        out[5 * i + 3] = data[a + 3]
        out[5 * i + 4] = w


@inner(fastmath=FAST)
def casteljau(c: Any, first: int, step: int, p: int, t: float, work: Any, jet: Any) -> None:
    """Value and two derivatives of p + 1 points `step` apart: ``jet[0:5, 5:10, 10:15]``."""
    s = 1.0 - t
    for m in range(5):
        for i in range(p + 1):
            work[i] = c[first + i * step + m]
        d1 = d2 = 0.0
        for level in range(p, 0, -1):
            if level == 2:
                d2 = p * (p - 1) * (work[2] - 2.0 * work[1] + work[0])
            elif level == 1:
                d1 = p * (work[1] - work[0])
            for i in range(level):
                work[i] = s * work[i] + t * work[i + 1]
        jet[m] = work[0]
        jet[5 + m] = d1
        jet[10 + m] = d2


@inner(fastmath=FAST)
def _lorentz(jet: Any, a: int, c: int, b: float) -> float:
    """Product of two derivatives of q, at offsets a and c of the jet."""
    return (
        jet[a] * jet[c]
        + jet[a + 1] * jet[c + 1]
        + jet[a + 2] * jet[c + 2]
        - (jet[a + 3] + b * jet[a + 4]) * (jet[c + 3] + b * jet[c + 4])
    )


@inner(fastmath=FAST)
def _root(q: Any, p: int, b: float, t: float, work: Any, jet: Any) -> float:
    """Zero of N' between a negative and a positive end, by Newton kept in the bracket."""
    low, high = 0.0, 1.0
    casteljau(q, 0, 5, p, 0.0, work, jet)
    if _lorentz(jet, 0, 5, b) >= 0.0:
        return 0.0
    casteljau(q, 0, 5, p, 1.0, work, jet)
    if _lorentz(jet, 0, 5, b) <= 0.0:
        return 1.0
    for _ in range(80):
        casteljau(q, 0, 5, p, t, work, jet)
        e = _lorentz(jet, 0, 5, b)
        slope = _lorentz(jet, 5, 5, b) + _lorentz(jet, 0, 10, b)
        if e > 0.0:
            high = t
        else:
            low = t
        new = t - e / slope if slope > 0.0 else -1.0
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - t) <= 2e-16 or high - low <= 2e-16:
            return new
        t = new
    return t


@inner(fastmath=FAST)
def _accept(jet: Any, t: float, s: float, x: float, y: float, z: float, hit: Any) -> bool:
    """Keep the point in `jet` if it is nearer than ``hit[F]``: F, foot, parameters."""
    w = 1.0 / jet[4]
    dx, dy, dz = jet[0] * w, jet[1] * w, jet[2] * w
    f = math.sqrt(dx * dx + dy * dy + dz * dz) - jet[3] * w
    if not f < hit[F]:
        return False
    hit[F] = f
    hit[FOOT] = x + dx
    hit[FOOT + 1] = y + dy
    hit[FOOT + 2] = z + dz
    hit[AT] = t
    hit[AT + 1] = s
    return True


@inner(fastmath=FAST)
def _slopes(q: Any, p: int, b: float, e: Any) -> Any:
    """Bernstein coefficients of N' / 2p; returns (least N, sizes of q and of its differences)."""
    for k in range(2 * p):
        e[k] = 0.0
    size = step = 0.0
    for j in range(p):
        a = 5 * j
        dx, dy, dz = q[a + 5] - q[a], q[a + 6] - q[a + 1], q[a + 7] - q[a + 2]
        dr = (q[a + 8] - q[a + 3]) + b * (q[a + 9] - q[a + 4])
        step = max(step, dx * dx + dy * dy + dz * dz + dr * dr)
        for i in range(p + 1):
            c = 5 * i
            v = q[c] * dx + q[c + 1] * dy + q[c + 2] * dz - (q[c + 3] + b * q[c + 4]) * dr
            e[i + j] += BINOMIAL[p, i] * BINOMIAL[p - 1, j] * v
    n = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] - (q[3] + b * q[4]) ** 2
    least = n
    for k in range(2 * p):
        e[k] /= BINOMIAL[2 * p - 1, k]
        n += e[k]
        least = min(least, n)
    for i in range(p + 1):
        a = 5 * i
        r = q[a + 3] + b * q[a + 4]
        size = max(size, q[a] * q[a] + q[a + 1] * q[a + 1] + q[a + 2] * q[a + 2] + r * r)
    return least, size, step


@inner(fastmath=FAST)
def _thick(q: Any, n: int, b: float) -> int:
    """1 where r + b > 0 at all points, -1 where at none, 0 otherwise."""
    count = 0
    for i in range(n):
        if q[5 * i + 3] + b * q[5 * i + 4] > 0.0:
            count += 1
    return 1 if count == n else (-1 if count == 0 else 0)


@inner(fastmath=FAST)
def _pattern(e: Any, n: int, tol: float) -> Any:
    """Sign changes of the coefficients, the first sign, and where the polygon rises through 0."""
    changes, first, last, start = 0, 0, 0, 0.5
    previous = 0
    for k in range(n):
        sign = 1 if e[k] > tol else (-1 if e[k] < -tol else 0)
        if sign == 0:
            continue
        if first == 0:
            first = sign
        if last != 0 and sign != last:
            changes += 1
            if sign > 0 and n > 1:
                part = e[previous] / (e[previous] - e[k])
                start = (previous + part * (k - previous)) / (n - 1)
        last, previous = sign, k
    return changes, first, start


@inner(fastmath=FAST)
def closest_on_curve(
    data: Any,
    start: int,
    step: int,
    p: int,
    plain: int,
    x: float,
    y: float,
    z: float,
    hit: Any,
    stack: Any,
    span: Any,
    work: Any,
) -> None:
    """Nearest point of a curve piece, if it is nearer than ``hit[F]``.

    Parameters
    ----------
    data, start, step, p
        Array with the Bézier points, where they begin, how far they are apart, and the degree.
    plain
        Whether the radius is constant and all weights are equal.
    x, y, z
        The query.
    hit
        F, foot (3), parameter: overwritten if a nearer point is found.
    stack, span, work
        Scratch: (DEPTH, >= 5 (p + 1)), (DEPTH, 4), (>= 5 p + 40,).
    """
    e, tmp, jet = work[: 2 * p + 1], work[2 * p + 1 : 4 * p + 4], work[4 * p + 4 : 4 * p + 20]
    _load(data, start, step, p + 1, x, y, z, stack[0])
    span[0, 0], span[0, 1] = 0.0, 1.0
    top = 1
    while top > 0:
        top -= 1
        q = stack[top]
        a, size = span[top, 0], span[top, 1]
        b = hit[F]
        thick = _thick(q, p + 1, b)
        if thick < 0:
            continue
        again = False
        simple = False
        if thick > 0 or size < SHORTEST:
            least, large, large_step = _slopes(q, p, b, e)
            if thick > 0 and least >= EPS * large:
                continue
            changes, first, t = _pattern(e, 2 * p, 1e-15 * math.sqrt(large * large_step))
            simple = changes < 2 or size < SHORTEST
            if simple:
                if first > 0 and changes > 0:
                    for end in (0.0, 1.0):
                        casteljau(q, 0, 5, p, end, tmp, jet)
                        again |= _accept(jet, a + end * size, 0.0, x, y, z, hit)
                else:
                    t = _root(q, p, b, t, tmp, jet)
                    casteljau(q, 0, 5, p, t, tmp, jet)
                    again = _accept(jet, a + t * size, 0.0, x, y, z, hit)
        if simple:
            if again and plain == 0 and hit[F] < b - 1e-15 * (1.0 + abs(b)):
                top += 1
            continue
        _push_halves(stack, span, top, p)
        top += 2


@inner(fastmath=FAST)
def _push_halves(stack: Any, span: Any, top: int, p: int) -> None:
    """Replace a part of a curve by its halves, the one with the nearer end on top."""
    q, lower = stack[top], stack[top + 1]
    near = q[0] ** 2 + q[1] ** 2 + q[2] ** 2
    c = 5 * p
    far = q[c] ** 2 + q[c + 1] ** 2 + q[c + 2] ** 2
    a, h = span[top, 0], 0.5 * span[top, 1]
    for m in range(5):
        halve_line(q, m, lower, m, 5, range(p + 1))
    if near < far:
        span[top + 1, 0], span[top, 0] = a, a + h
    else:
        for k in range(5 * (p + 1)):
            q[k], lower[k] = lower[k], q[k]
        span[top + 1, 0], span[top, 0] = a + h, a
    span[top, 1] = span[top + 1, 1] = h


# ------------------------------------------------------------------------------ surfaces


@inner(fastmath=FAST)
def _square(q: Any, p: int, r: int, b: float, n: Any) -> float:
    """Bernstein coefficients of N of a surface, degrees (2p, 2r); returns the largest square."""
    rows, cols = 2 * p + 1, 2 * r + 1
    for k in range(rows * cols):
        n[k] = 0.0
    size = 0.0
    count = (p + 1) * (r + 1)
    for i in range(count):
        iu, iv = i // (r + 1), i % (r + 1)
        a = 5 * i
        x, y, z, t = q[a], q[a + 1], q[a + 2], q[a + 3] + b * q[a + 4]
        size = max(size, x * x + y * y + z * z + t * t)
        scale = BINOMIAL[p, iu] * BINOMIAL[r, iv]
        for j in range(i, count):
            ju, jv = j // (r + 1), j % (r + 1)
            c = 5 * j
            v = x * q[c] + y * q[c + 1] + z * q[c + 2] - t * (q[c + 3] + b * q[c + 4])
            f = scale * BINOMIAL[p, ju] * BINOMIAL[r, jv]
            n[(iu + ju) * cols + iv + jv] += f * v if i == j else 2.0 * f * v
    for k in range(rows):
        for m in range(cols):
            n[k * cols + m] /= BINOMIAL[2 * p, k] * BINOMIAL[2 * r, m]
    return size


@inner(fastmath=FAST)
def _apart(q: Any, n: int, b: float) -> bool:
    """Whether the points are farther along the direction of their mean than r + b is long.

    Then F >= b. Where r + b changes its sign, N says nothing: it is negative in both cones.
    """
    x = y = z = 0.0
    for i in range(n):
        x += q[5 * i]
        y += q[5 * i + 1]
        z += q[5 * i + 2]
    size = math.sqrt(x * x + y * y + z * z)
    for i in range(n):
        a = 5 * i
        if x * q[a] + y * q[a + 1] + z * q[a + 2] < size * (q[a + 3] + b * q[a + 4]):
            return False
    return size > 0.0


@inner(fastmath=FAST)
def _bounds(n: Any, rows: int, cols: int, tol: float) -> int:
    """What the coefficients prove: 2 no minimum inside, 1 convex, 0 nothing; -1 drop it."""
    least = n[0]
    for k in range(rows * cols):
        least = min(least, n[k])
    if least >= tol:
        return -1
    low_u = low_v = np.inf
    high_u = high_v = -np.inf
    for i in range(rows):
        for j in range(cols):
            a = n[i * cols + j]
            if i + 1 < rows:
                d = n[(i + 1) * cols + j] - a
                low_u, high_u = min(low_u, d), max(high_u, d)
            if j + 1 < cols:
                d = n[i * cols + j + 1] - a
                low_v, high_v = min(low_v, d), max(high_v, d)
    if low_u > tol or high_u < -tol or low_v > tol or high_v < -tol:
        return 2
    uu = vv = np.inf
    uv = 0.0
    for i in range(rows):
        for j in range(cols):
            a = i * cols + j
            if i + 2 < rows:
                uu = min(uu, n[a + 2 * cols] - 2.0 * n[a + cols] + n[a])
            if j + 2 < cols:
                vv = min(vv, n[a + 2] - 2.0 * n[a + 1] + n[a])
            if i + 1 < rows and j + 1 < cols:
                uv = max(uv, abs(n[a + cols + 1] - n[a + cols] - n[a + 1] + n[a]))
    du, dv = rows - 1, cols - 1
    uu *= du * (du - 1)
    vv *= dv * (dv - 1)
    uv *= du * dv
    return 1 if uu > tol and vv > tol and uu * vv > uv * uv else 0


@inner(fastmath=FAST)
def surface_jet(
    q: Any, first: int, p: int, r: int, u: float, v: float, work: Any, jet: Any
) -> None:
    """Homogeneous value and derivatives u, v, uu, uv, vv of a surface: 30 numbers in `jet`.

    Parameters
    ----------
    q, first
        Array with the Bézier points, and where they begin.
    p, r
        Degrees.
    u, v
        Parameters.
    work
        Scratch, at least ``15 (p + 1) + p + r + 20``.
    jet
        Overwritten.
    """
    rows = work[: 15 * (p + 1)]
    tmp = work[15 * (p + 1) + 16 :]
    row = work[15 * (p + 1) : 15 * (p + 1) + 16]
    for i in range(p + 1):
        casteljau(q, first + 5 * (r + 1) * i, 5, r, v, tmp, row)
        for m in range(15):
            rows[15 * i + m] = row[m]
    casteljau(rows, 0, 15, p, u, tmp, row)
    for m in range(5):
        jet[m], jet[5 + m], jet[15 + m] = row[m], row[5 + m], row[10 + m]
    casteljau(rows, 5, 15, p, u, tmp, row)
    for m in range(5):
        jet[10 + m], jet[20 + m] = row[m], row[5 + m]
    casteljau(rows, 10, 15, p, u, tmp, row)
    for m in range(5):
        jet[25 + m] = row[m]


@inner(fastmath=FAST)
def _newton_in_box(
    q: Any, p: int, r: int, b: float, tol: float, work: Any, jet: Any, at: Any
) -> bool:
    """Minimum of a convex N over the unit square, by projected Newton with halved steps."""
    u, v = 0.5, 0.5
    surface_jet(q, 0, p, r, u, v, work, jet)
    n = _lorentz(jet, 0, 0, b)
    for _ in range(60):
        gu, gv = _lorentz(jet, 0, 5, b), _lorentz(jet, 0, 10, b)
        uu = _lorentz(jet, 5, 5, b) + _lorentz(jet, 0, 15, b)
        uv = _lorentz(jet, 5, 10, b) + _lorentz(jet, 0, 20, b)
        vv = _lorentz(jet, 10, 10, b) + _lorentz(jet, 0, 25, b)
        # Held at a side that the descent points out of; on a side it points into, it is left.
        fixed_u = (u <= 0.0 and gu >= 0.0) or (u >= 1.0 and gu <= 0.0)
        fixed_v = (v <= 0.0 and gv >= 0.0) or (v >= 1.0 and gv <= 0.0)
        du = dv = 0.0
        if not fixed_u and not fixed_v:
            # Convex by its coefficients, but not to rounding: halving goes on instead.
            det = uu * vv - uv * uv
            if det <= 0.0:
                return False
            du, dv = (uv * gv - vv * gu) / det, (uv * gu - uu * gv) / det
            # A full step would leave by the side it is on, though the descent does not: along it.
            if not 0.0 <= u + du <= 1.0 and u in (0.0, 1.0):
                du, dv = 0.0, -gv / vv
            elif not 0.0 <= v + dv <= 1.0 and v in (0.0, 1.0):
                du, dv = -gu / uu, 0.0
        elif not fixed_u:
            du = -gu / uu
        elif not fixed_v:
            dv = -gv / vv
        done = True
        for _ in range(40):
            new_u, new_v = min(max(u + du, 0.0), 1.0), min(max(v + dv, 0.0), 1.0)
            if abs(new_u - u) <= 2e-16 and abs(new_v - v) <= 2e-16:
                break
            surface_jet(q, 0, p, r, new_u, new_v, work, jet)
            new = _lorentz(jet, 0, 0, b)
            # Where values differ by rounding only, short steps count by their length.
            if new < n or (new <= n + 1e-2 * tol and abs(du) + abs(dv) < 1e-7):
                done = abs(new_u - u) <= 1e-15 and abs(new_v - v) <= 1e-15
                u, v, n = new_u, new_v, new
                break
            du *= 0.5
            dv *= 0.5
        if done:
            at[0], at[1] = u, v
            return True
    return False


@inner(fastmath=FAST)
def _search_surface(
    data: Any, start: int, p: int, r: int, plain: int, x: float, y: float, z: float, hit: Any,
    stack: Any, span: Any, work: Any,
) -> None:  # fmt: skip
    """Minima in the interior of a surface piece, those that are nearer than ``hit[F]``."""
    count = (2 * p + 1) * (2 * r + 1)
    n, jet, at, tmp = work[:count], work[count : count + 30], work[count + 30 :], work[count + 32 :]
    _load(data, start, 5, (p + 1) * (r + 1), x, y, z, stack[0])
    span[0, 0], span[0, 1], span[0, 2], span[0, 3] = 0.0, 1.0, 0.0, 1.0
    top = 1
    while top > 0:
        top -= 1
        q = stack[top]
        b = hit[F]
        thick = _thick(q, (p + 1) * (r + 1), b)
        if thick < 0 or (thick == 0 and _apart(q, (p + 1) * (r + 1), b)):
            continue
        tiny = span[top, 1] * span[top, 3] < SHORTEST * SHORTEST or top + 3 > DEPTH
        if thick > 0:
            tol = EPS * _square(q, p, r, b, n)
            proof = _bounds(n, 2 * p + 1, 2 * r + 1, tol)
            if proof in (-1, 2):
                continue
            if proof == 1 and _newton_in_box(q, p, r, b, tol, tmp, jet, at):
                surface_jet(q, 0, p, r, at[0], at[1], tmp, jet)
                u = span[top, 0] + at[0] * span[top, 1]
                v = span[top, 2] + at[1] * span[top, 3]
                better = _accept(jet, u, v, x, y, z, hit)
                if better and plain == 0 and hit[F] < b - 1e-15 * (1.0 + abs(b)):
                    top += 1
                continue
        if tiny:
            surface_jet(q, 0, p, r, 0.5, 0.5, tmp, jet)
            u, v = span[top, 0] + 0.5 * span[top, 1], span[top, 2] + 0.5 * span[top, 3]
            _accept(jet, u, v, x, y, z, hit)
            continue
        _push_parts(stack, span, top, p, r)
        top += 2


@inner(fastmath=FAST)
def closest_on_surface(
    data: Any,
    start: int,
    p: int,
    r: int,
    plain: int,
    x: float,
    y: float,
    z: float,
    hit: Any,
    stack: Any,
    span: Any,
    work: Any,
) -> None:
    """Nearest point in the interior of a surface piece, if it is nearer than ``hit[F]``.

    Parameters
    ----------
    data, start, p, r
        Array with the Bézier points, where they begin, and the degrees.
    plain
        Whether the radius is constant and all weights are equal.
    x, y, z
        The query.
    hit
        F, foot (3), parameters (2): overwritten if a nearer point is found.
    stack, span, work
        Scratch: (DEPTH, >= 5 (p + 1) (r + 1)), (DEPTH, 4),
        (>= (2 p + 1) (2 r + 1) + 15 (p + 1) + p + r + 60,).
    """
    if plain == 1:
        _search_surface(data, start, p, r, plain, x, y, z, hit, stack, span, work)
        return
    # That N falls towards a boundary proves nothing about F for a varying radius, unless no
    # boundary is nearer than the bound, and the bound stays: hence boundaries first, and again.
    bound = hit[F]
    a = 5 * (r + 1)
    edge = work[:8]
    edge[0] = bound
    rest = work[8:]
    closest_on_curve(data, start, 5, r, 0, x, y, z, edge, stack, span, rest)
    closest_on_curve(data, start + a * p, 5, r, 0, x, y, z, edge, stack, span, rest)
    closest_on_curve(data, start, a, p, 0, x, y, z, edge, stack, span, rest)
    closest_on_curve(data, start + 5 * r, a, p, 0, x, y, z, edge, stack, span, rest)
    least = hit[F] = edge[0]
    while True:
        before = hit[F]
        _search_surface(data, start, p, r, plain, x, y, z, hit, stack, span, work)
        if not hit[F] < before - 1e-15 * (1.0 + abs(before)):
            break
    if not hit[F] < least:
        hit[F] = bound


@inner(fastmath=FAST)
def _push_parts(stack: Any, span: Any, top: int, p: int, r: int) -> None:
    """Replace a part of a surface by its halves across the longer side, the nearer one on top."""
    q = stack[top]
    along_u = along_v = 0.0
    cols = r + 1
    for i in range(p + 1):
        for j in range(r + 1):
            a = 5 * (i * cols + j)
            for m in range(3):
                if i < p:
                    along_u += (q[a + 5 * cols + m] - q[a + m]) ** 2
                if j < r:
                    along_v += (q[a + 5 + m] - q[a + m]) ** 2
    axis = 0 if p * along_u >= r * along_v else 2
    other = stack[top + 1]
    for m in range(5):
        if axis == 0:
            for j in range(cols):
                halve_line(q, 5 * j + m, other, 5 * j + m, 5 * cols, range(p + 1))
        else:
            for i in range(p + 1):
                halve_line(q, 5 * cols * i + m, other, 5 * cols * i + m, 5, range(r + 1))
    for m in range(4):
        span[top + 1, m] = span[top, m]
    h = 0.5 * span[top, axis + 1]
    span[top, axis + 1] = span[top + 1, axis + 1] = h
    span[top, axis] += h
    if _middle(other, (p + 1) * cols) > _middle(q, (p + 1) * cols):
        for k in range(5 * (p + 1) * cols):
            q[k], other[k] = other[k], q[k]
        for m in range(4):
            span[top, m], span[top + 1, m] = span[top + 1, m], span[top, m]


@inner(fastmath=FAST)
def _middle(q: Any, n: int) -> float:
    """Square of the distance of the mean of the points, times n²."""
    x = y = z = 0.0
    for i in range(n):
        x += q[5 * i]
        y += q[5 * i + 1]
        z += q[5 * i + 2]
    return x * x + y * y + z * z
