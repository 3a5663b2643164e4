"""Cells in which the solid of splines is certainly in one piece.

Splines with knots in common are written along whole cells: per direction the Bernstein
coefficients of all pieces one after the other, of which neighbours share one. Where level sets
are monotone along a direction, the solid of a cell is as connected as its projection along it, and
this again as its projection to an edge, where signs are counted (see `_kernels_solid`). Where they
rise along all rays from one point, the solid is a star around it. Else its pieces are asked in the
same way, one by one, and whether they hang together. No boxes are made.

Guarantees: what is called single is so; the same answers for any number of threads.
"""

from typing import Any, NamedTuple

import numpy as np

from ilattice._kernels import in_ranges, inner, outer
from ilattice._kernels_tuples import borrowed
from ilattice.quadrature._kernels_solid import TINY, one_interval

#: Pieces that a thread takes at once.
CHUNK = 64
MATH = {"contract", "nsz"}  # for vectors
FAST: Any = {"error_model": "numpy", "fastmath": MATH}


@inner(**FAST)
def along_last(
    c: Any, x: int, wide: int, y: int, deep: int, rows: Any, first: Any, begin: int, many: int,
    out: Any,
) -> None:  # fmt: skip
    """Coefficients along the last direction: out (wide, deep, .) of `many` pieces from `begin` on.

    Those of the spline c (., ., .) matter from (x, y, .) on.
    """
    P = rows.shape[1]
    to = 0
    for i in range(wide):
        for j in range(deep):
            line = c[x + i, y + j]
            for piece in range(begin, begin + many):
                at = first[piece]
                ends = P if piece == begin + many - 1 else P - 1
                if P == 4:  # cubic, as walls are: in registers
                    a, b, d, e = line[at], line[at + 1], line[at + 2], line[at + 3]
                    for k in range(ends):
                        f = rows[piece, k]
                        out[to + k] = f[0] * a + f[1] * b + f[2] * d + f[3] * e
                else:
                    for k in range(ends):
                        value = 0.0
                        for t in range(P):
                            value += rows[piece, k, t] * line[at + t]
                        out[to + k] = value
                to += ends


@inner(**FAST)
def along(
    a: Any, before: int, wide: int, step: int, rows: Any, first: Any, begin: int, many: int,
    out: Any,
) -> None:  # fmt: skip
    """The same along the middle of a (before, wide, step): out (before, ., step)."""
    P = rows.shape[1]
    to = 0
    for b in range(before):
        for piece in range(begin, begin + many):
            start = (b * wide + first[piece] - first[begin]) * step
            for k in range(P if piece == begin + many - 1 else P - 1):
                f = rows[piece, k]
                if P == 4:  # one way through the numbers instead of four
                    for i in range(start, start + step):
                        out[to + i - start] = (
                            f[0] * a[i] + f[1] * a[i + step] + f[2] * a[i + 2 * step]
                            + f[3] * a[i + 3 * step]
                        )  # fmt: skip
                else:
                    for i in range(step):
                        out[to + i] = f[0] * a[start + i]
                    for t in range(1, P):
                        for i in range(step):
                            out[to + i] += f[t] * a[start + t * step + i]
                to += step


@inner(**FAST)
def sense_of(
    c: Any, signs: Any, along: int, n0: int, n1: int, n2: int, P: int, tol: float
) -> int:  # fmt: skip
    """1 if a polynomial never falls in a direction in pieces of sign 0, -1 if it never rises.

    0 if it does both. Its coefficients c are those of n0 x n1 x n2 pieces; of polynomials in two
    variables n2 is 0.
    """
    p = P - 1
    s1 = n2 * p + 1
    s0 = (n1 * p + 1) * s1
    many = max(n2, 1)
    step = s0 if along == 0 else (s1 if along == 1 else 1)
    e0 = p if along == 0 else P
    e1 = p if along == 1 else P
    e2 = 1 if n2 == 0 else (p if along == 2 else P)
    least = 0.0
    most = 0.0
    for x in range(n0):
        for y in range(n1):
            for z in range(many):
                if signs[(x * n1 + y) * many + z] != 0:
                    continue
                at = x * p * s0 + y * p * s1 + z * p
                for i in range(e0):
                    for j in range(e1):
                        for k in range(at + i * s0 + j * s1, at + i * s0 + j * s1 + e2):
                            d = c[k + step] - c[k]
                            least = min(least, d)
                            most = max(most, d)
                if least < -tol and most > tol:
                    return 0
    return 1 if least >= -tol else -1


@inner(**FAST)
def senses_of(
    c: Any, which: Any, n: int, size: int, signs: Any, along: int, n0: int, n1: int, n2: int,
    P: int, tol: Any, out: Any,
) -> bool:  # fmt: skip
    """Senses out (n,) of polynomials c[which] along a direction; see `_kernels_solid.senses`."""
    for i in range(n):
        out[i] = sense_of(c[which[i]], signs, along, n0, n1, n2, P, tol[which[i]])
        if out[i] == 0:
            return False
    for i in range(n):
        for j in range(i):
            if out[i] != out[j]:
                for s in range(size):
                    if c[which[i], s] + c[which[j], s] >= 0.0:
                        return False
    return True


@inner(**FAST)
def mattering(c: Any, m: int, size: int, tol: Any, which: Any) -> int:
    """How many of m polynomials have no certain sign; -1 if one is negative nowhere."""
    n = 0
    for k in range(m):
        least = np.inf
        most = -np.inf
        for j in range(size):
            least = min(least, c[k, j])
            most = max(most, c[k, j])
        if least >= -tol[k]:
            return -1
        if most > tol[k]:
            which[n] = k
            n += 1
    return n


@inner(**FAST)
def take_end(c: Any, before: int, many: int, step: int, first: bool, out: Any) -> None:
    """The first or the last slice (before, step) of an array (before, many, step)."""
    for b in range(before):
        at = (b * many + (0 if first else many - 1)) * step
        for i in range(step):
            out[b * step + i] = c[at + i]


@inner(owning=True, **FAST)
def is_single(
    c: Any, m: int, n0: int, n1: int, n2: int, signs: Any, P: int, tol: Any, face: Any,
    sides: Any, edge: Any,
) -> bool:  # fmt: skip
    """Whether the solid of m polynomials c on n0 x n1 x n2 pieces is certainly in one piece.

    Of one polynomial just the pieces of sign 0 matter; of several, all signs must be 0.
    """
    p = P - 1
    a, b, d = n0 * p + 1, n1 * p + 1, n2 * p + 1
    which = np.empty(m, np.int64)
    sense = np.empty(m, np.int64)
    eps = np.empty(m)
    n = mattering(c, m, a * b * d, tol, which)
    if n <= 0:
        return n == 0
    for axis in range(3):
        if not senses_of(c, which, n, a * b * d, signs, axis, n0, n1, n2, P, tol, sense):
            continue
        before = 1 if axis == 0 else (a if axis == 1 else a * b)
        many = a if axis == 0 else (b if axis == 1 else d)
        step = b * d if axis == 0 else (d if axis == 1 else 1)
        for i in range(n):
            take_end(c[which[i]], before, many, step, sense[i] > 0, face[i])
            eps[i] = tol[which[i]]
        before = 1 if axis == 0 else (n0 if axis == 1 else n0 * n1)
        many = n0 if axis == 0 else (n1 if axis == 1 else n2)
        step = n1 * n2 if axis == 0 else (n2 if axis == 1 else 1)
        take_end(signs, before, many, step, sense[0] > 0, sides)
        long, short = (n1 if axis == 0 else n0), (n1 if axis == 2 else n2)
        if is_single_face(face, n, long, short, sides, P, eps, edge):
            return True
    return False


@inner(owning=True, **FAST)
def is_single_face(
    c: Any, m: int, n0: int, n1: int, signs: Any, P: int, tol: Any, edge: Any
) -> bool:
    """`is_single` of polynomials c in two variables on n0 x n1 pieces."""
    p = P - 1
    a, b = n0 * p + 1, n1 * p + 1
    which = np.empty(m, np.int64)
    sense = np.empty(m, np.int64)
    n = mattering(c, m, a * b, tol, which)
    if n <= 0:
        return n == 0
    for axis in range(2):
        if not senses_of(c, which, n, a * b, signs, axis, n0, n1, 0, P, tol, sense):
            continue
        before, many, step = (1, a, b) if axis == 0 else (a, b, 1)
        good = True
        for i in range(n):
            first = sense[i] > 0
            take_end(c[which[i]], before, many, step, first, edge)
            pieces, stride = (n1, 1) if axis == 0 else (n0, n1)
            at = 0 if first else (n0 - 1) * n1 if axis == 0 else n1 - 1
            for j in range(pieces):
                sign = signs[at + j * stride]
                if sign != 0:
                    for k in range(j * p, (j + 1) * p + 1):
                        edge[k] = np.inf if sign > 0 else -np.inf
            good = good and one_interval(edge, before * step, tol[which[i]])
        if good:
            return True
    return False


@inner(**FAST)
def is_star(
    c: Any, m: int, n0: int, n1: int, n2: int, signs: Any, P: int, tol: Any, one: Any, star: Any
) -> bool:  # fmt: skip
    """Whether the solid of m polynomials c is certainly a star around a point that is likely.

    That is the middle of negative coefficients, weighted by their squares, and then one half-way
    from there to the nearest corner, where struts meet. Otherwise as in `is_single`.
    """
    p = P - 1
    s1 = n2 * p + 1
    s0 = (n1 * p + 1) * s1
    x, y, z, total = 0.0, 0.0, 0.0, 0.0  # in parts of a piece, p to each
    for i in range((n0 * p + 1) * s0):
        deep = np.inf
        for k in range(m):
            deep = min(deep, -c[k, i])
        if deep > 0.0:
            weight = deep * deep
            x += weight * (i // s0)
            y += weight * (i // s1 % (n1 * p + 1))
            z += weight * (i % s1)
            total += weight
    if total == 0.0:
        return False
    x, y, z = x / total, y / total, z / total
    if is_star_around(c, m, n0, n1, n2, signs, P, tol, x, y, z, one, star):
        return True
    x = 0.5 * (x + (0.0 if 2.0 * x < n0 * p else n0 * p))
    y = 0.5 * (y + (0.0 if 2.0 * y < n1 * p else n1 * p))
    z = 0.5 * (z + (0.0 if 2.0 * z < n2 * p else n2 * p))
    return is_star_around(c, m, n0, n1, n2, signs, P, tol, x, y, z, one, star)


@inner(**FAST)
def is_star_around(
    c: Any, m: int, n0: int, n1: int, n2: int, signs: Any, P: int, tol: Any, x0: float, y0: float,
    z0: float, one: Any, star: Any,
) -> bool:  # fmt: skip
    """Whether all points of the solid are certainly seen from one, in parts of a piece.

    Times the way from there, the derivative along rays is a polynomial of the same degree. If, in
    each piece of sign 0, it is no less than some number times the polynomial itself, it is not
    negative at the surface, so that a ray that has left the solid never enters it again. Convex
    level sets pass, with 1 for the number. `one` and `star` (P³,) are scratch.
    """
    p = P - 1
    s1 = n2 * p + 1
    s0 = (n1 * p + 1) * s1
    for x in range(n0):
        for y in range(n1):
            for z in range(n2):
                if signs[(x * n1 + y) * n2 + z] != 0:
                    continue
                begin = p * (x * s0 + y * s1 + z)
                a, b, d = p * x - x0, p * y - y0, p * z - z0
                for k in range(m):
                    _along_rays(c[k], begin, s0, s1, P, a, b, d, one, star)
                    least = -np.inf
                    most = np.inf
                    for i in range(P * P * P):
                        f = one[i]
                        if f > tol[k]:
                            most = min(most, star[i] / f)
                        elif f < -tol[k]:
                            least = max(least, star[i] / f)
                        elif star[i] < -tol[k]:
                            return False
                    if least > most:
                        return False
    return True


@inner(**FAST)
def _along_rays(
    c: Any, at: int, s0: int, s1: int, P: int, a: float, b: float, d: float, one: Any, out: Any
) -> None:  # fmt: skip
    """Derivatives out (P³,) of a piece along rays, times the way from where they start and P - 1.

    That way is (a, b, d), in parts of which a piece has P - 1, to the piece's first corner. The
    coefficients of the piece, c[at + i s0 + j s1 + k], are written to `one` (P³,).
    """
    p = P - 1
    for i in range(P):
        for j in range(P):
            for k in range(P):
                one[(i * P + j) * P + k] = c[at + i * s0 + j * s1 + k]
    for i in range(P):
        for j in range(P):
            for k in range(P):
                q = (i * P + j) * P + k
                f = one[q]
                total = 0.0
                if i > 0:
                    total += i * (a + p) * (f - one[q - P * P])
                if i < p:
                    total += (p - i) * a * (one[q + P * P] - f)
                if j > 0:
                    total += j * (b + p) * (f - one[q - P])
                if j < p:
                    total += (p - j) * b * (one[q + P] - f)
                if k > 0:
                    total += k * (d + p) * (f - one[q - 1])
                if k < p:
                    total += (p - k) * d * (one[q + 1] - f)
                out[q] = total


@inner(**FAST)
def corners_are_solid(c: Any, m: int, at: int, s: int, t: int, tol: Any) -> bool:
    """Whether at one of the four corners at, at + s, at + t, at + s + t all are negative."""
    for corner in range(4):
        i = at + corner // 2 * s + corner % 2 * t
        good = True
        for k in range(m):
            good = good and c[k, i] < -tol[k]
        if good:
            return True
    return False


@inner(owning=True, **FAST)
def hangs_together(
    c: Any, m: int, n0: int, n1: int, n2: int, signs: Any, P: int, tol: Any, one: Any, none: Any,
    face: Any, sides: Any, edge: Any, parent: Any,
) -> bool:  # fmt: skip
    """Whether the solid is single in each piece, and pieces hang together at solid corners.

    `one` (m, P³) and `parent` are scratch, none[0] is 0. As in `is_single` otherwise.
    """
    p = P - 1
    s1 = n2 * p + 1
    s0 = (n1 * p + 1) * s1
    which = np.empty(m, np.int64)
    parts = 0
    for x in range(n0):
        for y in range(n1):
            for z in range(n2):
                q = (x * n1 + y) * n2 + z
                at = p * (x * s0 + y * s1 + z)
                parent[q] = -1
                if signs[q] > 0:
                    continue
                if signs[q] == 0:
                    for k in range(m):
                        for i in range(P):
                            for j in range(P):
                                for r in range(P):
                                    one[k, (i * P + j) * P + r] = c[k, at + i * s0 + j * s1 + r]
                    n = mattering(one, m, P * P * P, tol, which)
                    if n < 0:
                        continue
                    if n and not is_single(one, m, 1, 1, 1, none, P, tol, face, sides, edge):
                        return False
                parent[q] = q
                parts += 1
                for axis in range(3):
                    before = x if axis == 0 else (y if axis == 1 else z)
                    step = n1 * n2 if axis == 0 else (n2 if axis == 1 else 1)
                    if before == 0 or parent[q - step] < 0:
                        continue
                    s = p * (s1 if axis == 0 else s0)
                    t = p * (s1 if axis == 2 else 1)
                    if corners_are_solid(c, m, at, s, t, tol):
                        parts -= joined(parent, q, q - step)
    return parts == 1


@inner(**FAST)
def joined(parent: Any, i: int, j: int) -> int:
    """Make one set of two; 1 if they were not one yet."""
    while parent[i] != i:
        i = parent[i]
    while parent[j] != j:
        j = parent[j]
    parent[max(i, j)] = min(i, j)
    return 1 if i != j else 0


class Cuts(NamedTuple):
    """Pieces per direction, and which of them the cells have.

    Attributes
    ----------
    rows0, rows1, rows2, first0, first1, first2
        Operators that restrict splines to pieces, see `signs_of_splines`.
    starts0, starts1, starts2
        Cell i has the pieces from starts[i] on.
    """

    rows0: Any
    rows1: Any
    rows2: Any
    first0: Any
    first1: Any
    first2: Any
    starts0: Any
    starts1: Any
    starts2: Any


@in_ranges(CHUNK)
@outer(nogil=True, error_model="numpy", fastmath=MATH)
def single_cells(
    begin: int, end: int, c: Any, cuts: Any, factors: Any, shifts: Any, signs: Any, ijk: Any,
    most: Any, out: Any,
) -> None:  # fmt: skip
    """Whether the solid in cells `ijk` (n, 3) is certainly in one piece, out (n,).

    That is where all sets `factors` @ splines + `shifts` are negative; the splines c are
    (splines, ., ., .). Cells have `most` (3,) pieces along a direction or fewer; `signs` are those
    of all pieces, 0 where they are not certain.
    """
    cuts = borrowed(cuts)
    rows0, rows1, rows2 = cuts.rows0, cuts.rows1, cuts.rows2
    first0, first1, first2 = cuts.first0, cuts.first1, cuts.first2
    starts0, starts1, starts2 = cuts.starts0, cuts.starts1, cuts.starts2
    p = rows0.shape[1] - 1
    m = len(factors)
    long = most * p + 1
    a = np.empty(long[0] * long[1] * long[2])
    b = np.empty(len(a))
    v = np.empty(len(a))
    F = np.empty((m, len(a)))
    face = np.empty((m, long.max() ** 2))
    edge = np.empty(long.max())
    tol = np.empty(m)
    inside = np.zeros(most[0] * most[1] * most[2], np.int8)
    sides = np.zeros(most.max() ** 2, np.int8)
    none = np.zeros(1, np.int8)
    one = np.empty((m, (p + 1) ** 3))
    star = np.empty((p + 1) ** 3)
    parent = np.empty(len(inside), np.int64)
    for n in range(begin, end):
        x, y, z = starts0[ijk[n, 0]], starts1[ijk[n, 1]], starts2[ijk[n, 2]]
        n0 = starts0[ijk[n, 0] + 1] - x
        n1 = starts1[ijk[n, 1] + 1] - y
        n2 = starts2[ijk[n, 2] + 1] - z
        a0, a1, a2 = n0 * p + 1, n1 * p + 1, n2 * p + 1
        size = a0 * a1 * a2
        # With several sets, the signs of pieces of one say nothing about all.
        if m == 1:
            for i in range(n0):
                for j in range(n1):
                    for k in range(n2):
                        inside[(i * n1 + j) * n2 + k] = signs[x + i, y + j, z + k]
        wide = first0[x + n0 - 1] + p + 1 - first0[x]
        deep = first1[y + n1 - 1] + p + 1 - first1[y]
        # Directions one after the other: a piece takes P numbers of a line, not P³ of a box.
        for s in range(len(c)):
            along_last(c[s], first0[x], wide, first1[y], deep, rows2, first2, z, n2, a)
            along(a, wide, deep, a2, rows1, first1, y, n1, b)
            along(b, 1, wide, a1 * a2, rows0, first0, x, n0, v)
            for k in range(m):
                f = factors[k, s]
                if s == 0:
                    for i in range(size):
                        F[k, i] = shifts[k] + f * v[i]
                else:
                    for i in range(size):
                        F[k, i] += f * v[i]
        for k in range(m):
            top = 0.0
            for i in range(size):
                top = max(top, abs(F[k, i]))
            tol[k] = TINY * top
        # Dearer proofs come later, and are tried where cheaper ones fail.
        out[n] = (
            is_single(F, m, n0, n1, n2, inside, p + 1, tol, face, sides, edge)
            or is_star(F, m, n0, n1, n2, inside, p + 1, tol, one[0], star)
            or hangs_together(
                F, m, n0, n1, n2, inside, p + 1, tol, one, none, face, sides, edge, parent
            )
        )
