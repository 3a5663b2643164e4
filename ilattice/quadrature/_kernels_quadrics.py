"""Rules on the part of a box inside, or outside, of one quadric: exact columns without halving.

A polynomial of total degree two has at most two roots on a column, and these lie over the part of
the base where its discriminant, which has degree two there as well, is positive. The base is
divided into strips where the order of the ends of columns does not change: by the discriminant and
by the two curves in which the quadric meets the faces across the columns. All of their corners are
roots of quadratic equations, so that a thin cylinder takes as many points as a thick one.

Guarantees: weights are positive, points lie inside the box. Volumes and first moments of a part
that no face of the box cuts are exact up to rounding. Where strips end, what is integrated may go
like a square root; points are taken where that is integrated well.

Non-guarantee: polynomials of other degrees, and those of which no section across the box is an
ellipse, are left to halving.
"""

from typing import Any

import numpy as np

from ilattice._kernels import inner
from ilattice.quadrature._kernels_columns import segment
from ilattice.quadrature._kernels_scratch import (
    ACTIVE,
    ALONG,
    CROSS,
    EXT,
    FACES,
    GAP,
    LO,
    N_SURFACE,
    NAMES,
    NODES,
    NORMAL,
    SET,
    SURFACE,
    VOLUME,
    WEIGHT,
    WEIGHTS,
    X,
)

#: Times the noise of coefficients by which those of a quadric may be off.
QUADRATIC = 1e3
#: Determinant of the second derivatives of a section, over their product, that is taken at least.
ROUNDED = 0.01
#: Parts of the box within which places are the same but for rounding: boxes that mirror each other
#: then have rules that do.
SAME = 1e-10
#: Places of 1, x, y, z, x², y², z², xy, xz, yz; then of three curves on the base, six numbers each:
#: those of 1, y1, y2, y1², y1 y2, y2².
FORM, CURVE = FACES, FACES + 16
#: Flags of the ends of strips, and of intervals in them: behind the ends.
TAGS = 64
VANISHING = -1.0  # of the end where a section vanishes: areas go linearly, whatever else ends there
PLAIN, LOW_END, HIGH_END, CHORD, ARC, ANGLE = 0, 1, 2, 3, 4, 5  # sorts of nodes
#: Middle of the two roots of the discriminant on a line, and half of what is between them.
ROUND = CURVE + 18
#: Angles of more than this are halved; half as large ones where columns outside of the roots count,
#: over which polynomials of places, which are none of the angle, are all of the integrand.
RIGHT = 0.55 * np.pi
#: Lengths of an interval that these roots may be apart for places to be taken by their angle.
WIDE = 1e3


@inner(error_model="numpy")
def is_quadric(Z: Any, at: int, eps: float, L: Any) -> bool:
    """Whether a tensor is a polynomial of total degree two: its coefficients from FORM on."""
    P = len(L)
    p = P - 1
    if P < 3:
        return False
    c = Z[at]
    Z[FORM] = c
    for i in range(3):
        step = P ** (2 - i)
        Z[FORM + 1 + i] = p * (Z[at + step] - c)
        Z[FORM + 4 + i] = 0.5 * p * (p - 1) * (Z[at + 2 * step] - 2.0 * Z[at + step] + c)
        for j in range(i):
            other = P ** (2 - j)
            mixed = (Z[at + step + other] - Z[at + step]) - (Z[at + other] - c)
            Z[FORM + 6 + i + j] = p * p * mixed
    for i in range(P):
        x = i / p
        xx = i * (i - 1) / (p * (p - 1))
        for j in range(P):
            y = j / p
            yy = j * (j - 1) / (p * (p - 1))
            for k in range(P):
                z = k / p
                zz = k * (k - 1) / (p * (p - 1))
                v = c + Z[FORM + 1] * x + Z[FORM + 2] * y + Z[FORM + 3] * z
                v += Z[FORM + 4] * xx + Z[FORM + 5] * yy + Z[FORM + 6] * zz
                v += Z[FORM + 7] * x * y + Z[FORM + 8] * x * z + Z[FORM + 9] * y * z
                if abs(v - Z[at + (i * P + j) * P + k]) > QUADRATIC * eps:
                    return False
    return True


@inner(error_model="numpy")
def column_axes(Z: Any) -> Any:
    """Two directions in which sections of the quadric are the roundest ellipses, or -1.

    Columns go along the first, in which it is more curved; over a line along the second they have
    two ends on an interval at most.
    """
    best = -1
    other = -1
    most = 0.0
    for i in range(3):
        for j in range(3):
            a = Z[FORM + 4 + i]
            b = Z[FORM + 4 + j]
            mixed = Z[FORM + 6 + i + j]
            minor = 4.0 * a * b - mixed * mixed
            if i != j and abs(a) >= abs(b) and minor > most and minor > ROUNDED * 4.0 * a * b:
                best = i
                other = j
                most = minor
    return best, other


@inner(error_model="numpy")
def set_curves(Z: Any, e0: int, e1: int, e2: int) -> None:
    """The discriminant of columns along e0, and the curves on the faces across them."""
    a = Z[FORM + 4 + e0]
    b0 = Z[FORM + 1 + e0]
    b1 = Z[FORM + 6 + e0 + e1]
    b2 = Z[FORM + 6 + e0 + e2]
    C = CURVE + 6
    Z[C] = Z[FORM]
    Z[C + 1] = Z[FORM + 1 + e1]
    Z[C + 2] = Z[FORM + 1 + e2]
    Z[C + 3] = Z[FORM + 4 + e1]
    Z[C + 4] = Z[FORM + 6 + e1 + e2]
    Z[C + 5] = Z[FORM + 4 + e2]
    for i in range(6):
        Z[C + 6 + i] = Z[C + i]
    Z[C + 6] += a + b0
    Z[C + 7] += b1
    Z[C + 8] += b2
    Z[CURVE] = b0 * b0 - 4.0 * a * Z[C]
    Z[CURVE + 1] = 2.0 * b0 * b1 - 4.0 * a * Z[C + 1]
    Z[CURVE + 2] = 2.0 * b0 * b2 - 4.0 * a * Z[C + 2]
    Z[CURVE + 3] = b1 * b1 - 4.0 * a * Z[C + 3]
    Z[CURVE + 4] = 2.0 * b1 * b2 - 4.0 * a * Z[C + 4]
    Z[CURVE + 5] = b2 * b2 - 4.0 * a * Z[C + 5]


@inner(error_model="numpy")
def quadratic_roots(c: float, b: float, a: float) -> Any:
    """The roots of c + b x + a x², the lower one first; NaN where there are none."""
    half = 0.5 * b
    inside = half * half - a * c
    if inside < 0.0 or (a == 0.0 and b == 0.0):
        return np.nan, np.nan
    s = -(half + np.copysign(np.sqrt(inside), half))
    first = s / a if a != 0.0 else np.nan
    second = c / s if s != 0.0 else first
    if a == 0.0:
        return second, np.nan
    return min(first, second), max(first, second)


@inner(error_model="numpy")
def add(Z: Any, to: int, n: int, t: float, tag: float) -> int:
    """Put an end t with its flag into the sorted list of n at `to`, if it lies in [0, 1].

    Ends that are alike but for rounding are one: which comes first would be by chance, and so would
    the flag of the interval beside them. It is flagged if one of them is, unless one has VANISHING.
    """
    if not -SAME <= t <= 1.0 + SAME:
        return n
    for i in range(to, to + n):
        if abs(Z[i] - t) <= SAME:
            vanishes = min(Z[i + TAGS], tag) == VANISHING
            Z[i + TAGS] = VANISHING if vanishes else max(Z[i + TAGS], tag)
            return n
    i = to + n
    while i > to and Z[i - 1] > t:
        Z[i] = Z[i - 1]
        Z[i + TAGS] = Z[i - 1 + TAGS]
        i -= 1
    Z[i] = t
    Z[i + TAGS] = tag
    return n + 1


@inner(error_model="numpy")
def first_ends(Z: Any, to: int) -> int:
    """The ends of an interval that is not divided yet."""
    Z[to] = 0.0
    Z[to + 1] = 1.0
    Z[to + TAGS] = 0.0
    Z[to + 1 + TAGS] = 0.0
    return 2


@inner(error_model="numpy")
def middle(Z: Any, e0: int, e1: int, e2: int, y1: float, y2: float) -> float:
    """Where a column is halfway between its roots."""
    b = Z[FORM + 1 + e0] + Z[FORM + 6 + e0 + e1] * y1 + Z[FORM + 6 + e0 + e2] * y2
    return -0.5 * b / Z[FORM + 4 + e0]


@inner(error_model="numpy")
def is_within(t: float) -> bool:
    """Whether a place is in the box, or on a face of it but for rounding."""
    return -SAME <= t <= 1.0 + SAME


@inner(error_model="numpy")
def across(Z: Any, e0: int, e1: int, e2: int) -> int:
    """Where strips end: their sorted list at CROSS, and its length.

    Flagged where the area of the section there goes like a power 3/2: where the section touches a
    side of the box. Where a section vanishes its area goes linearly, and nothing has to be done.
    """
    n = first_ends(Z, CROSS)
    for j in range(3):
        C = CURVE + 6 * j
        for side in range(2):
            c = Z[C] + side * (Z[C + 1] + Z[C + 3])
            low, high = quadratic_roots(c, Z[C + 2] + side * Z[C + 4], Z[C + 5])
            for k in range(2):
                y2 = low if k == 0 else high
                if j > 0 or is_within(middle(Z, e0, e1, e2, float(side), y2)):
                    n = add(Z, CROSS, n, y2, 1.0 if j == 0 else 0.0)
        if Z[C + 3] == 0.0:
            continue
        low, high = quadratic_roots(
            Z[C + 1] * Z[C + 1] - 4.0 * Z[C + 3] * Z[C],
            2.0 * Z[C + 1] * Z[C + 4] - 4.0 * Z[C + 3] * Z[C + 2],
            Z[C + 4] * Z[C + 4] - 4.0 * Z[C + 3] * Z[C + 5],
        )
        for k in range(2):
            y2 = low if k == 0 else high
            y1 = -0.5 * (Z[C + 1] + Z[C + 4] * y2) / Z[C + 3]
            if is_within(y1) and (j > 0 or is_within(middle(Z, e0, e1, e2, y1, y2))):
                n = add(Z, CROSS, n, y2, VANISHING if j == 0 else 1.0)
    return n


@inner(error_model="numpy")
def along(Z: Any, e0: int, e1: int, e2: int, y2: float) -> int:
    """Where columns over a line change: their sorted list at ALONG, and its length.

    Flagged where columns end in a point inside the box: their length goes like a square root.
    """
    n = first_ends(Z, ALONG)
    Z[ROUND + 1] = 0.0
    for j in range(3):
        C = CURVE + 6 * j
        c = Z[C] + y2 * (Z[C + 2] + y2 * Z[C + 5])
        low, high = quadratic_roots(c, Z[C + 1] + Z[C + 4] * y2, Z[C + 3])
        if j == 0 and Z[C + 3] < 0.0 and low < high:
            Z[ROUND] = 0.5 * (low + high)
            Z[ROUND + 1] = 0.5 * (high - low)
        for k in range(2):
            y1 = low if k == 0 else high
            if j > 0 or is_within(middle(Z, e0, e1, e2, y1, y2)):
                n = add(Z, ALONG, n, y1, 1.0 if j == 0 else 0.0)
    return n


@inner(error_model="numpy")
def node(Z: Any, sort: int, i: int, q: int) -> Any:
    """Node i of q on [0, 1], and its weight.

    PLAIN is Gauss's rule. LOW_END and HIGH_END are for square roots, and their inverses, at one
    end: the substitution of a square. CHORD and ARC are for both ends, and integrate the root of
    x (1 - x), and its inverse, times polynomials exactly. ANGLE is PLAIN, of angles.
    """
    if sort == CHORD:
        angle = np.pi * (i + 1) / (q + 1)
        return 0.5 * (1.0 - np.cos(angle)), 0.5 * np.pi / (q + 1) * np.sin(angle)
    if sort == ARC:
        angle = np.pi * (i + 0.5) / q
        return 0.5 * (1.0 - np.cos(angle)), 0.5 * np.pi / q * np.sin(angle)
    x = Z[NODES + i]
    w = Z[WEIGHTS + i]
    if sort == LOW_END:
        return x * x, 2.0 * x * w
    if sort == HIGH_END:
        return 1.0 - x * x, 2.0 * x * w
    return x, w


@inner(error_model="numpy")
def part_of(Z: Any, to: int, i: int, half: int) -> Any:
    """Lower end, length and sort of nodes of interval i of a list, or of a half of it.

    Intervals with flags at both ends have two halves; the length of the second is 0 in others.
    """
    low = Z[to + i]
    high = Z[to + i + 1]
    first = Z[to + i + TAGS] > 0.0
    second = Z[to + i + 1 + TAGS] > 0.0
    if first and second:
        size = 0.5 * (high - low)
        return low + half * size, size, HIGH_END if half else LOW_END
    sort = LOW_END if first else HIGH_END if second else PLAIN
    return low, high - low if half == 0 else 0.0, sort


@inner(error_model="numpy")
def part_of_line(Z: Any, i: int, half: int, whole: bool, inner: bool, want: int) -> Any:
    """`part_of` interval i over which there are columns with two ends, the `whole` of them or not.

    Between the roots of the discriminant, inside the box or not, its square root is the sine of an
    angle: places are taken by that, and are as good beside a root as far from it.
    """
    a = Z[ALONG + i]
    b = Z[ALONG + i + 1]
    m = Z[ROUND]
    h = Z[ROUND + 1]
    if not 0.0 < h < WIDE * (b - a):
        return part_of(Z, ALONG, i, half)
    first = Z[ALONG + i + TAGS] > 0.0
    second = Z[ALONG + i + 1 + TAGS] > 0.0
    if first and second and whole:
        return a, 0.0 if half else b - a, ARC if want & SURFACE else CHORD
    low = 0.0 if first else np.arccos(min(max((m - a) / h, -1.0), 1.0))
    high = np.pi if second else np.arccos(min(max((m - b) / h, -1.0), 1.0))
    if high - low > (RIGHT if inner or not want & VOLUME else 0.5 * RIGHT):
        size = 0.5 * (high - low)
        return low + half * size, size, ANGLE
    return low, 0.0 if half else high - low, ANGLE


@inner(error_model="numpy")
def evened(Z: Any, start: float, size: float, q: int) -> float:
    """Factor by which weights of angles have the sum of the length that they stand for."""
    total = 0.0
    for g in range(q):
        x, w = node(Z, ANGLE, g, q)
        total += w * size * np.sin(start + size * x)
    return (np.cos(start) - np.cos(start + size)) / total


@inner(error_model="numpy")
def ends(Z: Any, e0: int, e1: int, e2: int, y1: float, y2: float) -> Any:
    """The roots on a column, and the root of its discriminant, which is 0 where there are none."""
    b = Z[FORM + 1 + e0] + Z[FORM + 6 + e0 + e1] * y1 + Z[FORM + 6 + e0 + e2] * y2
    C = CURVE + 6
    c = Z[C] + y1 * (Z[C + 1] + y1 * Z[C + 3] + y2 * Z[C + 4]) + y2 * (Z[C + 2] + y2 * Z[C + 5])
    D = Z[CURVE] + y1 * (Z[CURVE + 1] + y1 * Z[CURVE + 3] + y2 * Z[CURVE + 4])
    D += y2 * (Z[CURVE + 2] + y2 * Z[CURVE + 5])
    if D <= 0.0:
        return 0.0, 0.0, 0.0
    r = np.sqrt(D)
    s = -0.5 * (b + np.copysign(r, b))
    first = s / Z[FORM + 4 + e0]
    second = c / s
    return min(first, second), max(first, second), r


@inner(error_model="numpy")
def foot_on_quadric(
    Z: Any, N: Any, surface: Any, e0: int, e1: int, e2: int, t: float, y1: float, y2: float,
    slope: float, w: float, out: float,
) -> None:  # fmt: skip
    """Point of the surface at t on a column, where the slope along it is known."""
    if not 0.0 <= t <= 1.0:
        return
    at = N[N_SURFACE]
    N[N_SURFACE] = at + 1
    if at >= len(surface):
        return
    C = CURVE + 6
    g0 = slope / Z[EXT + e0]
    g1 = Z[C + 1] + 2.0 * Z[C + 3] * y1 + Z[C + 4] * y2 + Z[FORM + 6 + e0 + e1] * t
    g2 = Z[C + 2] + 2.0 * Z[C + 5] * y2 + Z[C + 4] * y1 + Z[FORM + 6 + e0 + e2] * t
    g1 /= Z[EXT + e1]
    g2 /= Z[EXT + e2]
    length = np.sqrt(g0 * g0 + g1 * g1 + g2 * g2)
    surface[at, e0] = Z[LO + e0] + Z[EXT + e0] * t
    surface[at, e1] = Z[X + e1]
    surface[at, e2] = Z[X + e2]
    surface[at, WEIGHT] = w * length / abs(g0)
    surface[at, NORMAL + e0] = out * g0 / length
    surface[at, NORMAL + e1] = out * g1 / length
    surface[at, NORMAL + e2] = out * g2 / length
    surface[at, SET] = N[NAMES + N[ACTIVE]]


@inner(error_model="numpy")
def line_of_columns(
    Z: Any, N: Any, volume: Any, surface: Any, e0: int, e1: int, e2: int, y2: float, w2: float,
    negative: bool, want: int, q: int,
) -> None:  # fmt: skip
    """Columns over a line of the base, with the weight w2 of that."""
    inner = negative == (Z[FORM + 4 + e0] > 0.0)  # the solid lies between two roots
    n = along(Z, e0, e1, e2, y2)
    for i in range(n - 1):
        if Z[ALONG + i + 1] - Z[ALONG + i] <= GAP:
            continue
        y1 = 0.5 * (Z[ALONG + i] + Z[ALONG + i + 1])
        low, high, r = ends(Z, e0, e1, e2, y1, y2)
        seen = r > 0.0 and high > 0.0 and low < 1.0
        if not seen and (inner or not want & VOLUME):
            continue
        whole = low >= 0.0 and high <= 1.0 and (inner or not want & VOLUME)
        for half in range(2):
            start, size, sort = Z[ALONG + i], Z[ALONG + i + 1] - Z[ALONG + i], PLAIN
            if seen:
                start, size, sort = part_of_line(Z, i, half, whole, inner, want)
            elif half:
                continue
            if size <= 0.0:
                continue
            even = 1.0
            if sort == ANGLE and not inner:  # what is not between the roots is long, and plain
                even = evened(Z, start, size, q)
            for g in range(q):
                x, w = node(Z, sort, g, q)
                y1 = start + size * x
                w *= size
                if sort == ANGLE:
                    w *= Z[ROUND + 1] * np.sin(y1)
                    y1 = Z[ROUND] - Z[ROUND + 1] * np.cos(y1)
                w *= Z[EXT + e1] * w2
                Z[X + e1] = Z[LO + e1] + Z[EXT + e1] * y1
                low, high, r = ends(Z, e0, e1, e2, y1, y2)
                if want & VOLUME:
                    column_between(
                        Z, N, volume, e0, low, high, r > 0.0 and seen, inner, w * even, q
                    )
                if want & SURFACE and r > 0.0:
                    out = 1.0 if negative else -1.0
                    up = r if Z[FORM + 4 + e0] > 0.0 else -r
                    foot_on_quadric(Z, N, surface, e0, e1, e2, low, y1, y2, -up, w, out)
                    foot_on_quadric(Z, N, surface, e0, e1, e2, high, y1, y2, up, w, out)


@inner(error_model="numpy")
def column_between(
    Z: Any, N: Any, volume: Any, e0: int, low: float, high: float, cut: bool, inner: bool,
    w: float, q: int,
) -> None:  # fmt: skip
    """Gauss points on a column between two roots, or on the rest of it."""
    start = Z[LO + e0]
    length = Z[EXT + e0]
    a = min(max(low, 0.0), 1.0) if cut else 0.0
    b = min(max(high, 0.0), 1.0) if cut else 0.0
    if inner:
        if b > a:
            segment(Z, N, volume, a, b, e0, start, length, w, q)
        return
    if a > 0.0:
        segment(Z, N, volume, 0.0, a, e0, start, length, w, q)
    if b < 1.0:
        segment(Z, N, volume, b, 1.0, e0, start, length, w, q)


@inner(error_model="numpy")
def quadric_rule(
    Z: Any, N: Any, volume: Any, surface: Any, e0: int, e1: int, negative: bool, want: int, q: int
) -> None:
    """Rules on the present box with the quadric at FORM, by `column_axes`.

    The solid is where it is `negative`, or else where it is positive.
    """
    e2 = 3 - e0 - e1
    set_curves(Z, e0, e1, e2)
    n = across(Z, e0, e1, e2)
    for i in range(n - 1):
        if Z[CROSS + i + 1] - Z[CROSS + i] <= GAP:
            continue
        for half in range(2):
            start, size, sort = part_of(Z, CROSS, i, half)
            if size <= 0.0:
                continue
            for g in range(q):
                x, w = node(Z, sort, g, q)
                y2 = start + size * x
                Z[X + e2] = Z[LO + e2] + Z[EXT + e2] * y2
                w *= size * Z[EXT + e2]
                line_of_columns(Z, N, volume, surface, e0, e1, e2, y2, w, negative, want, q)
