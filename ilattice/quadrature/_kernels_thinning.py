"""Fewer points of a rule on a small box, with the moments that they have together.

Of n points with positive weights, as many as there are polynomials of a degree can be chosen so
that positive weights on them integrate all of these as the n do (Tchakaloff). Points are taken in
groups, by halves of their number each time: groups are given new weights until as many of them as
there are polynomials are left (Lyons and Litterer, High order recombination, 2012).

Guarantees: weights are positive, points are some of those given, moments keep to `KEPT` of the
volume, or nothing is changed. Non-guarantee: of points in several pieces all may lose their weight
in a piece that holds little.
"""

from typing import Any

import numpy as np

from ilattice._kernels import inner, outer
from ilattice.quadrature._kernels_scratch import WEIGHT as POINT_WEIGHT

#: Error of moments, of polynomials of size 1, as a part of the volume, at which points are kept.
KEPT = 1e-10
#: Pivots below this are none: entries of moments of unit points are about 1.
PIVOT = 1e-11
#: Highest total degree of polynomials whose integrals can be kept, and how many these are: scratch
#: is laid out for them.
MAX_DEGREE = 5
MAX_MOMENTS = (MAX_DEGREE + 1) * (MAX_DEGREE + 2) * (MAX_DEGREE + 3) // 6
#: Groups whose sums are made at once.
LANES = 16
# Places in scratch, behind moments of groups: their weights, sums before and after; of a group in
# each lane sums, polynomials in one variable, weights of points and products with polynomials in
# one and two variables; lower corner of a box about all points, 2 over its extent; its length
WEIGHT = 2 * MAX_MOMENTS * MAX_MOMENTS
BEFORE = WEIGHT + 2 * MAX_MOMENTS
AFTER = BEFORE + MAX_MOMENTS
SUMS = AFTER + MAX_MOMENTS
BASES = SUMS + MAX_MOMENTS * LANES
WEIGHTS = BASES + 3 * (MAX_DEGREE + 1) * LANES
X = WEIGHTS + LANES
Y = X + LANES
BOX = Y + LANES
ROOM = BOX + 6


@outer()
def moments_of(degree: int) -> int:
    """Number of polynomials in three variables of a total degree at most."""
    return (degree + 1) * (degree + 2) * (degree + 3) // 6


@inner(error_model="numpy")
def multiply(row: Any, one: Any, other: Any) -> None:
    """Products of two rows: of slices, since loops over these are vectorized."""
    for lane in range(LANES):
        row[lane] = one[lane] * other[lane]


@inner(error_model="numpy")
def add_product(row: Any, one: Any, other: Any) -> None:
    """Products of two rows, added to a third one."""
    for lane in range(LANES):
        row[lane] += one[lane] * other[lane]


@inner(error_model="numpy")
def legendre(x: Any, older: Any, old: Any, new: Any, k: int) -> None:
    """Legendre polynomials of degree k + 1 by those of degrees k and k - 1."""
    for lane in range(LANES):
        new[lane] = ((2 * k + 1) * x[lane] * old[lane] - k * older[lane]) / (k + 1)


@inner(error_model="numpy")
def look(points: Any, row: int, last: int, S: Any, lane: int) -> None:
    """A point within the box about all, from -1 to 1, and its weight; none if it is the last."""
    S[WEIGHTS + lane] = points[row, POINT_WEIGHT] if row < last else 0.0
    for axis in range(3):
        x = 0.0
        if row < last:
            x = S[BOX + 3 + axis] * (points[row, axis] - S[BOX + axis]) - 1.0
        S[BASES + (axis * (MAX_DEGREE + 1) + 1) * LANES + lane] = x
        S[BASES + axis * (MAX_DEGREE + 1) * LANES + lane] = 1.0


@inner(error_model="numpy")
def add_polynomials(degree: int, S: Any) -> None:
    """Products of Legendre polynomials at a point of each lane, times their weights, to SUMS."""
    for axis in range(3):
        at = BASES + axis * (MAX_DEGREE + 1) * LANES
        for k in range(1, degree):
            here = at + (k - 1) * LANES
            legendre(
                S[at + LANES : at + 2 * LANES], S[here : here + LANES],
                S[here + LANES : here + 2 * LANES], S[here + 2 * LANES : here + 3 * LANES], k,
            )  # fmt: skip
    m = SUMS
    for i in range(degree + 1):
        x = BASES + i * LANES
        multiply(S[X:Y], S[WEIGHTS:X], S[x : x + LANES])
        for j in range(degree + 1 - i):
            y = BASES + (MAX_DEGREE + 1 + j) * LANES
            multiply(S[Y:BOX], S[X:Y], S[y : y + LANES])
            for k in range(degree + 1 - i - j):
                z = BASES + (2 * MAX_DEGREE + 2 + k) * LANES
                add_product(S[m : m + LANES], S[Y:BOX], S[z : z + LANES])
                m += LANES


@inner(error_model="numpy")
def moments(points: Any, first: int, n: int, K: int, degree: int, S: Any) -> None:
    """Moments of K groups of n points over their weights, to 0 of S, and these weights.

    A lane is a group, so that sums of several are made at once.
    """
    M = moments_of(degree)
    for g in range(0, K, LANES):
        lanes = min(LANES, K - g)
        S[SUMS : SUMS + M * LANES] = 0.0
        for i in range(-(-n // K)):
            for lane in range(LANES):
                row = first + (g + lane) * n // K + i
                look(points, row, first + min(g + lane + 1, K) * n // K, S, lane)
            add_polynomials(degree, S)
        for lane in range(lanes):
            S[WEIGHT + g + lane] = S[SUMS + lane]  # the first polynomial is 1
            for m in range(M):
                S[m * K + g + lane] = S[SUMS + m * LANES + lane] / S[SUMS + lane]


@inner(error_model="numpy")
def subtract(row: Any, other: Any, factor: float) -> None:
    """Take a multiple of another row away: of slices, since loops over these are vectorized."""
    for j in range(len(row)):
        row[j] -= factor * other[j]


@inner(error_model="numpy")
def solved(S: Any, K: int, M: int, base: Any, free: Any) -> int:
    """Gauss-Jordan elimination of the moments (M, K) at 0 of S; the rank.

    Columns base[: rank] are unit vectors then, in rows that have been swapped to the top.
    """
    for j in range(K):
        free[j] = 1
    rank = 0
    for m in range(M):
        best = -1
        top = PIVOT
        for j in range(K):
            if free[j] and abs(S[m * K + j]) > top:
                top = abs(S[m * K + j])
                best = j
        if best < 0:
            continue  # this moment is a combination of others here
        factor = 1.0 / S[m * K + best]
        for j in range(K):
            v = S[m * K + j] * factor
            S[m * K + j] = S[rank * K + j]
            S[rank * K + j] = v
        for i in range(M):
            f = S[i * K + best]
            if i != rank and f != 0.0:
                subtract(S[i * K : i * K + K], S[rank * K : rank * K + K], f)
        free[best] = 0
        base[rank] = best
        rank += 1
    return rank


@inner(error_model="numpy")
def choose_groups(S: Any, K: int, M: int, base: Any, free: Any) -> None:
    """New weights of K groups, at WEIGHT, of which as many as there are moments stay positive.

    The weight of one after the other goes to those of a basis; where one of these would become
    negative, it leaves the basis in exchange.
    """
    rank = solved(S, K, M, base, free)
    for j in range(K):
        if not free[j]:
            continue
        free[j] = 0
        left = S[WEIGHT + j]
        leaves = -1
        for m in range(rank):
            c = S[m * K + j]
            if c < -PIVOT and -S[WEIGHT + base[m]] / c < left:
                left = -S[WEIGHT + base[m]] / c
                leaves = m
        for m in range(rank):
            at = WEIGHT + base[m]
            S[at] = max(S[at] + left * S[m * K + j], 0.0)
        S[WEIGHT + j] = 0.0 if leaves < 0 else S[WEIGHT + j] - left
        if leaves < 0:
            continue
        S[WEIGHT + base[leaves]] = 0.0
        base[leaves] = j
        factor = 1.0 / S[leaves * K + j]
        for i in range(j, K):
            S[leaves * K + i] *= factor
        for m in range(rank):
            f = S[m * K + j]
            if m != leaves and f != 0.0:
                subtract(S[m * K + j : m * K + K], S[leaves * K + j : leaves * K + K], f)


@inner(error_model="numpy")
def total(S: Any, K: int, M: int, to: int) -> float:
    """Moments of all groups together, to `to`; their weight."""
    weight = 0.0
    for g in range(K):
        weight += S[WEIGHT + g]
    for m in range(M):
        S[to + m] = 0.0
        for g in range(K):
            S[to + m] += S[WEIGHT + g] * S[m * K + g]
    return weight


@inner(owning=True, error_model="numpy")
def thinned(points: Any, first: int, end: int, degree: int, S: Any) -> int:
    """Fewer of the points (n, 4) from `first` to `end`, in place; the new end.

    S is scratch of ROOM numbers.
    """
    M = moments_of(degree)
    base = np.empty(M, np.int64)
    free = np.empty(2 * M, np.int64)
    saved = points[first:end].copy()
    for axis in range(3):
        S[BOX + axis] = saved[:, axis].min()
        extent = saved[:, axis].max() - S[BOX + axis]
        if extent <= 0.0:
            return end
        S[BOX + 3 + axis] = 2.0 / extent
    volume = 0.0
    stop = end
    while stop - first > M:
        n = stop - first
        K = min(n, 2 * M)
        moments(points, first, n, K, degree, S)
        if stop == end:  # all groups of the first round are the whole
            volume = total(S, K, M, BEFORE)
        old = S[WEIGHT : WEIGHT + K].copy()
        choose_groups(S, K, M, base, free)
        to = first
        for g in range(K):
            if S[WEIGHT + g] <= 0.0:
                continue
            for row in range(first + g * n // K, first + (g + 1) * n // K):
                for i in range(3):
                    points[to, i] = points[row, i]
                points[to, POINT_WEIGHT] = points[row, POINT_WEIGHT] * S[WEIGHT + g] / old[g]
                to += 1
        if to - first >= n:
            break
        stop = to
    if stop == end:
        return end
    n = stop - first
    moments(points, first, n, min(n, M), degree, S)
    total(S, min(n, M), M, AFTER)
    for m in range(M):
        if not abs(S[AFTER + m] - S[BEFORE + m]) <= KEPT * volume:
            points[first:end] = saved
            return end
    return stop


@inner(owning=True, error_model="numpy")
def thinned_parts(
    points: Any, first: int, end: int, box: Any, degree: int, most: int, parts: int, S: Any
) -> int:
    """Those in each of so many parts of a box per direction thinned, if more than `most` are."""
    if parts == 1:
        return thinned(points, first, end, degree, S)
    count = np.zeros(parts * parts * parts + 1, np.int64)
    home = np.empty(end - first, np.int64)
    for row in range(first, end):
        at = 0
        for i in range(3):
            k = int(parts * (points[row, i] - box[i]) / box[3 + i])
            at = at * parts + min(max(k, 0), parts - 1)
        home[row - first] = at
        count[at + 1] += 1
    start = np.cumsum(count)
    place = start.copy()
    saved = points[first:end].copy()
    for n in range(end - first):
        points[first + place[home[n]]] = saved[n]
        place[home[n]] += 1
    to = first
    for k in range(parts * parts * parts):
        a = first + start[k]
        b = first + start[k + 1]
        if b - a > most:
            b = thinned(points, a, b, degree, S)
        for row in range(a, b):
            points[to] = points[row]
            to += 1
    return to
