"""Compiled sweep over the seeds around queries, for those that may lie next to a nearer foot.

Boxes are levels of a tree: a box of the lowest one holds what LEAF seeds that follow each other
stand for, one of the others holds FAN boxes of the level below. The arguments `lo`, `hi`, `slab`
and `first` are the corners of all boxes, the slabs that hold the same, and where the levels begin
among them.
"""

import numpy as np

from ilattice._kernels import in_ranges, inner, outer
from ilattice.offsets._kernels_jets import FAST
from ilattice.offsets._kernels_patches import PLAIN, added, in_reach, seed_distance, unlikely

#: Seeds of a box of the lowest level, and boxes in one of the next.
LEAF, FAN = 4, 4
#: Queries that a thread takes at once.
CHUNK = 64
#: Seeds that a query may gather; of more, the nearer half is kept.
MAX_GATHERED = 4096
#: A foot next to a seed whose cell is no guide is within this part of its spacing from it, across.
ACROSS = 0.6
#: Columns of slabs behind their directions: where they begin and end along these.
BEGIN, END = 3, 4


@inner(fastmath=FAST, error_model="numpy")
def beyond(lo, hi, row, x, reach):
    """Whether a box is farther from x than `reach`."""
    d = 0.0
    for a in range(3):
        gap = max(lo[row, a] - x[a], x[a] - hi[row, a], 0.0)
        d += gap * gap
    return d > reach * reach


@inner(fastmath=FAST, error_model="numpy")
def off_slab(slab, row, x, reach):
    """Whether a slab is farther from x than `reach`."""
    s = slab[row, 0] * x[0] + slab[row, 1] * x[1] + slab[row, 2] * x[2]
    return s < slab[row, BEGIN] - reach or s > slab[row, END] + reach


@inner(fastmath=FAST, error_model="numpy")
def away_from(sn, sh, s, d, best):
    """Whether a seed at the distance d, whose cell is no guide, is too far for a nearer foot."""
    told = sn.shape[1] > PLAIN
    if told and abs(sn[s, PLAIN]) + abs(sn[s, PLAIN + 1]) + abs(sn[s, PLAIN + 2]) > 0.0:
        return False
    return d * d > best * best + (ACROSS * sh[s]) ** 2


@inner(owning=True, fastmath=FAST, error_model="numpy")
def halve(away, found, n):
    """Keep the n nearest of what was found, nearest first."""
    rows = np.argsort(away)  # in loops, as arrays of arrays take long to compile
    near, there = np.empty(n), np.empty(n, np.int64)
    for k in range(n):
        near[k], there[k] = away[rows[k]], found[rows[k]]
    for k in range(n):
        away[k], found[k] = near[k], there[k]


@inner(owning=True, fastmath=FAST, error_model="numpy")
def gather(geom, sp, sx, sn, sh, lo, hi, slab, first, x, q, best, stack, away, found):
    """Fill in seeds that may have a foot nearer than `best`, and their distances; how many."""
    n, depth, reach = 0, 1, np.finfo(np.float64).max
    stack[0, 0], stack[0, 1] = len(first) - 2, 0
    while depth > 0:
        depth -= 1
        level, k = stack[depth, 0], stack[depth, 1]
        row = first[level] + k
        if beyond(lo, hi, row, x, best) or off_slab(slab, row, x, best):
            continue
        if level > 0:
            for c in range(FAN * k, min(FAN * k + FAN, first[level] - first[level - 1])):
                stack[depth, 0], stack[depth, 1] = level - 1, c
                depth += 1
            continue
        for j in range(LEAF * k, min(LEAF * k + LEAF, len(sx))):
            d = seed_distance(sx, j, x)
            if d > reach or away_from(sn, sh, j, d, best) or unlikely(x, sx, sn, j, sh[j], best):
                continue
            if not in_reach(geom, sp, sx, sn, j, x, q):
                continue
            if n == len(away):
                n //= 2
                halve(away, found, n)
                reach = away[n - 1]
            away[n], found[n] = d, j
            n += 1
    return n


@in_ranges(CHUNK)
@outer(nogil=True, fastmath=FAST, error_model="numpy")
def sweep(begin, end, geom, sp, sx, sn, sh, lo, hi, slab, first, x, q, best, out):
    """Seeds that may have a foot nearer than `best` (n,) from the queries, one per patch.

    They fill rows of `out` (n, k), nearest first, up to -1.
    """
    stack = np.empty((FAN * len(first), 2), np.int64)
    away, found = np.empty(MAX_GATHERED), np.empty(MAX_GATHERED, np.int64)
    for i in range(begin, end):
        xi, qi = (x[i, 0], x[i, 1], x[i, 2]), (q[i, 0], q[i, 1], q[i, 2])
        n = gather(
            geom, sp, sx, sn, sh, lo, hi, slab, first, xi, qi, best[i], stack, away, found,
        )  # fmt: skip
        count = 0
        for row in np.argsort(away[:n]):
            count = added(geom, sp, sx, sn, sh, found[row], out, i, count)
            if count == out.shape[1]:
                break
        out[i, count:] = -1
