"""Compiled search for the shortest weighted mean of vectors, and small linear systems.

Guarantee: nothing is allocated per set of vectors. Non-guarantee: arguments are not checked.
"""

import numpy as np

from ilattice._kernels import in_ranges, inner, outer

#: Sets of vectors that a thread takes at once.
CHUNK = 64
#: Most vectors that join a mean, and weights, gains and pivots that are none.
ROUNDS, NOTHING = 64, 1e-12


@inner(error_model="numpy")
def solve_small(a, y, n, nothing):
    """Solve the first n equations a x = y in place, with pivots; returns the smallest of these.

    Unknowns whose pivots are no larger than `nothing` are zero, and of the equations that are left
    one is dropped for each: if others are not solved by that, the solution is none.
    """
    smallest = np.inf
    for i in range(n):
        p = i
        for j in range(i + 1, n):
            if abs(a[j, i]) > abs(a[p, i]):
                p = j
        smallest = min(smallest, abs(a[p, i]))
        if not abs(a[p, i]) > nothing:
            a[i, :n] = 0.0
            a[i, i], y[i] = 1.0, 0.0
            continue
        if p != i:
            for j in range(n):
                a[i, j], a[p, j] = a[p, j], a[i, j]
            y[i], y[p] = y[p], y[i]
        for j in range(i + 1, n):
            s = a[j, i] / a[i, i]
            if s != 0.0:
                for k in range(i, n):
                    a[j, k] -= s * a[i, k]
                y[j] -= s * y[i]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            y[i] -= a[i, j] * y[j]
        y[i] /= a[i, i]
    return smallest


@inner(error_model="numpy")
def minor_cycle(vectors, active, weight, count, a, y):
    """Weights of least mean over the affine hull of active vectors, less those that would be < 0.

    Returns how many remain, or 0 where the vectors depend on each other.
    """
    while True:
        for i in range(count):
            y[i] = 1.0
            for j in range(count):
                a[i, j] = 1.0
                for c in range(vectors.shape[1]):
                    a[i, j] += vectors[active[i], c] * vectors[active[j], c]
        if not solve_small(a, y, count, NOTHING) > NOTHING:
            return 0
        total = 0.0
        for i in range(count):
            total += y[i]
        theta = 1.0
        for i in range(count):
            y[i] /= total
            if y[i] <= NOTHING:
                theta = min(theta, weight[i] / max(weight[i] - y[i], 1e-300))
        kept = 0
        for i in range(count):
            s = weight[i] + theta * (y[i] - weight[i])
            if s > NOTHING:
                active[kept], weight[kept] = active[i], s
                kept += 1
        if kept == count or kept == 0:
            return kept
        count = kept


@inner(error_model="numpy")
def shortest(vectors, first, last, active, weight, mean, a, y):
    """Weights >= 0 of sum 1 of rows first to last whose weighted mean is shortest (Wolfe 1976).

    Returns how many rows `active` have a `weight`; the mean is left in `mean`.
    """
    k = vectors.shape[1]
    least, count = np.inf, 0
    for i in range(first, last):
        size = 0.0
        for c in range(k):
            size += vectors[i, c] ** 2
        if size < least:
            least = size
            active[0], weight[0], count = i, 1.0, 1
    for _ in range(ROUNDS):
        for c in range(k):
            mean[c] = 0.0
            for i in range(count):
                mean[c] += weight[i] * vectors[active[i], c]
        low, new = -NOTHING, -1
        for i in range(first, last):
            along = 0.0
            for c in range(k):
                along += mean[c] * (vectors[i, c] - mean[c])
            if along < low:
                low, new = along, i
        for i in range(count):
            if active[i] == new:
                new = -1
        if new < 0 or count > k:
            break
        active[count], weight[count] = new, 0.0
        kept = minor_cycle(vectors, active, weight, count + 1, a, y)
        if kept == 0:
            break
        count = kept
    return count


@inner(error_model="numpy")
def heaviest_first(active, weight, count, rows, weights):
    """The rows with the largest of `count` weights into rows (m,), these into weights (m,)."""
    for place in range(min(count, len(rows))):
        best = place
        for i in range(place, count):
            if weight[i] > weight[best]:
                best = i
        active[place], active[best] = active[best], active[place]
        weight[place], weight[best] = weight[best], weight[place]
        rows[place], weights[place] = active[place], weight[place]


@in_ranges(CHUNK)
@outer(nogil=True, error_model="numpy")
def shortest_means(first, last, ends, vectors, rows, weights, pull):
    """Shortest weighted means of rows ends[n] to ends[n + 1] of vectors (r, 3), for each n.

    Into `rows` (n, 4) and `weights` (n, 4) go those with weights, the heaviest first, -1 ends
    them; into `pull` (n,) the length of the mean.
    """
    active, weight = np.empty(8, np.int64), np.empty(8)
    a, y, mean = np.empty((8, 8)), np.empty(8), np.zeros(3)
    for n in range(first, last):
        rows[n], weights[n], pull[n] = -1, 0.0, np.inf
        if ends[n] == ends[n + 1]:
            continue
        count = shortest(vectors, ends[n], ends[n + 1], active, weight, mean, a, y)
        pull[n] = np.sqrt(mean[0] ** 2 + mean[1] ** 2 + mean[2] ** 2)
        heaviest_first(active, weight, count, rows[n], weights[n])
