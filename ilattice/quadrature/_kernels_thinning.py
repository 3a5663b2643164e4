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
from numba import njit

from ilattice._kernels import inner

#: Error of moments, of polynomials of size 1, as a part of the volume, at which points are kept.
KEPT = 1e-10
#: Pivots below this are none: entries of moments of unit points are about 1.
PIVOT = 1e-11
MAX_DEGREE = 5
MAX_MOMENTS = (MAX_DEGREE + 1) * (MAX_DEGREE + 2) * (MAX_DEGREE + 3) // 6
# Places in scratch, behind moments of groups: their weights, sums before and after, polynomials at
# a point and those in one variable, lower corner and extent of a box about all points; its length
WEIGHT = 2 * MAX_MOMENTS * MAX_MOMENTS
BEFORE = WEIGHT + 2 * MAX_MOMENTS
AFTER = BEFORE + MAX_MOMENTS
VALUE = AFTER + MAX_MOMENTS
BASES = VALUE + MAX_MOMENTS
BOX = BASES + 3 * (MAX_DEGREE + 1)
ROOM = BOX + 6


@njit(cache=True)
def moments_of(degree: int) -> int:
    """Number of polynomials in three variables of a total degree at most."""
    return (degree + 1) * (degree + 2) * (degree + 3) // 6


@inner(error_model="numpy")
def polynomials(points: Any, row: int, degree: int, S: Any) -> None:
    """Products of Legendre polynomials at a point, to VALUE."""
    for axis in range(3):
        x = 2.0 * (points[row, axis] - S[BOX + axis]) / S[BOX + 3 + axis] - 1.0
        at = BASES + axis * (MAX_DEGREE + 1)
        S[at] = 1.0
        S[at + 1] = x
        for k in range(1, degree):
            S[at + k + 1] = ((2 * k + 1) * x * S[at + k] - k * S[at + k - 1]) / (k + 1)
    m = VALUE
    for i in range(degree + 1):
        for j in range(degree + 1 - i):
            v = S[BASES + i] * S[BASES + MAX_DEGREE + 1 + j]
            for k in range(degree + 1 - i - j):
                S[m] = v * S[BASES + 2 * MAX_DEGREE + 2 + k]
                m += 1


@inner(error_model="numpy")
def sums(points: Any, first: int, end: int, degree: int, S: Any, to: int) -> float:
    """Moments of some points, to `to`; their weight."""
    M = moments_of(degree)
    for m in range(M):
        S[to + m] = 0.0
    total = 0.0
    for row in range(first, end):
        w = points[row, 3]
        polynomials(points, row, degree, S)
        for m in range(M):
            S[to + m] += w * S[VALUE + m]
        total += w
    return total


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
                for j in range(K):
                    S[i * K + j] -= f * S[rank * K + j]
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
                for i in range(j, K):
                    S[m * K + i] -= f * S[leaves * K + i]


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
        S[BOX + 3 + axis] = saved[:, axis].max() - S[BOX + axis]
        if S[BOX + 3 + axis] <= 0.0:
            return end
    volume = 0.0
    for m in range(M):
        S[BEFORE + m] = 0.0
    stop = end
    while stop - first > M:
        n = stop - first
        K = min(n, 2 * M)
        for g in range(K):
            w = sums(points, first + g * n // K, first + (g + 1) * n // K, degree, S, AFTER)
            S[WEIGHT + g] = w
            for m in range(M):
                S[m * K + g] = S[AFTER + m] / w
            if stop == end:  # all groups of the first round are the whole
                volume += w
                for m in range(M):
                    S[BEFORE + m] += S[AFTER + m]
        old = S[WEIGHT : WEIGHT + K].copy()
        choose_groups(S, K, M, base, free)
        to = first
        for g in range(K):
            if S[WEIGHT + g] <= 0.0:
                continue
            for row in range(first + g * n // K, first + (g + 1) * n // K):
                for i in range(3):
                    points[to, i] = points[row, i]
                points[to, 3] = points[row, 3] * S[WEIGHT + g] / old[g]
                to += 1
        if to - first >= n:
            break
        stop = to
    if stop == end:
        return end
    sums(points, first, stop, degree, S, AFTER)
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
