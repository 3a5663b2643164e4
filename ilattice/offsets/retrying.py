"""Further starts for queries whose first ones may have missed a nearer foot.

Where a map squeezes tiles, the nearest seeds crowd on one sheet, and seeds that are as near as that
they may count are thousands. Few of these may have a nearer foot: once there is a foot to compare
with, they are swept for in compiled code, through a tree of boxes around what seeds stand for.

Guarantee: in the end no seed is left out that may have a nearer foot, but for patches beyond
`SWEEPS` times `RETRY_CANDIDATES`.
"""

from __future__ import annotations

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.offsets import _kernels, _kernels_newton, _kernels_sweep
from ilattice.offsets._kernels_patches import DISTANCE, PLAIN
from ilattice.offsets.seeded import SeededSpace

#: A retry starts from up to that many of the nearest seeds, one per patch. Where no start has led
#: to a foot, it looks among this many, and four times as many, up to the last number.
RETRY_CANDIDATES, RETRY_NEIGHBOURS, MAX_NEIGHBOURS = 48, 24, 1536
#: Seeds that are looked at together.
RETRIED = 1 << 21
#: Candidates may miss a patch if the last one is within sqrt(d² + c h²) of the query, h the spacing
#: of seeds (the seed next to a foot at distance d is hardly ever farther than that): c is CROWDED
#: if they lie on several patches, so that a second foot is nearer than d + RIVAL h; else it is
#: PILED, where a map squeezes seeds together.
CROWDED, PILED, RIVAL = 0.35, 0.15, 0.1
#: Sweeps, one more where more patches were in reach than a sweep starts from.
SWEEPS = 3


def retried(
    search: SeededSpace, at: IntArray, x: FloatArray, p: FloatArray, feet: FloatArray,
    counts: IntArray, status: IntArray,
) -> None:  # fmt: skip
    """Improve queries from more seeds, until no further one may lie next to a nearer foot.

    Parameters
    ----------
    search : SeededSpace
        Seeds, map and tiles.
    at : ndarray
        Which queries.
    x, p : ndarray, shape (n, 3)
        Queries in space and in tile coordinates.
    feet, counts, status : ndarray, shape (2, n, 8), (n, 2) and (n,)
        What `_kernels.closest` has found; changed in place.
    """
    failed = status[at] >= _kernels_newton.FALLBACK
    rest, m = [at[~failed]], RETRY_NEIGHBOURS
    if search.seeds.normals.shape[1] == PLAIN:  # sweeps look for first feet, not for second
        for i in range(0, len(rest[0]), RETRIED // m):
            _retry(search, rest[0][i : i + RETRIED // m], m, x, p, feet, counts, status)
    at = at[failed]
    while len(at) and m <= MAX_NEIGHBOURS:
        for i in range(0, len(at), RETRIED // m):
            _retry(search, at[i : i + RETRIED // m], m, x, p, feet, counts, status)
        failed = status[at] >= _kernels_newton.FALLBACK
        rest.append(at[~failed])
        at, m = at[failed], 4 * m
    left = np.sort(np.concatenate(rest))
    for _ in range(SWEEPS):
        if len(left) == 0:
            break
        left = _sweep(search, left, x, p, feet, counts, status)


def _retry(
    search: SeededSpace, at: IntArray, m: int, x: FloatArray, p: FloatArray,
    feet: FloatArray, counts: IntArray, status: IntArray,
) -> None:  # fmt: skip
    """Find feet of the queries `at` from more seeds, far apart."""
    _, near = search.candidates(x[at], m)
    idx = np.empty((len(at), RETRY_CANDIDATES), np.int64)
    best = np.where(status[at] < _kernels_newton.FALLBACK, np.abs(feet[0, at, DISTANCE]), np.inf)
    _kernels.spread(len(at), search.space.geom, *search.seeds, x[at], p[at], best, near, idx)
    _start(search, at, idx, x, p, feet, counts, status)


def _sweep(
    search: SeededSpace, at: IntArray, x: FloatArray, p: FloatArray, feet: FloatArray,
    counts: IntArray, status: IntArray,
) -> IntArray:  # fmt: skip
    """Improve the queries `at` from all seeds that may help; those that took only some of them.

    Of these there are none where nothing nearer was found.
    """
    idx = np.empty((len(at), RETRY_CANDIDATES), np.int64)
    best = np.abs(feet[0, at, DISTANCE])
    _kernels_sweep.sweep(
        len(at), search.space.geom, *search.seeds, *search.boxes, x[at], p[at], best, idx
    )
    some = np.flatnonzero(idx[:, 0] >= 0)
    _start(search, at[some], idx[some], x, p, feet, counts, status)
    more: IntArray = at[(idx[:, -1] >= 0) & (np.abs(feet[0, at, DISTANCE]) < best)]
    return more


def _start(
    search: SeededSpace, at: IntArray, idx: IntArray, x: FloatArray, p: FloatArray,
    feet: FloatArray, counts: IntArray, status: IntArray,
) -> None:  # fmt: skip
    """Improve the queries `at` from seeds."""
    f, c, s = feet.take(at, axis=1), counts[at], status[at]
    search._run(x[at], p[at], idx, f, c, s)
    feet[:, at], counts[at], status[at] = f, c, s


def singly(search: SeededSpace, x: FloatArray, p: FloatArray, count: int) -> FloatArray:
    """Nearest of the feet that single starts lead to, as if there were no others.

    Slow, but no start is left out because of what another one has found.

    Parameters
    ----------
    search : SeededSpace
        Seeds, map and tiles.
    x, p : ndarray, shape (n, 3)
        Queries in space and in tile coordinates.
    count : int
        From how many of the nearest seeds to start.

    Returns
    -------
    ndarray, shape (n, 8)
        Feet as in `_kernels.closest`; their distances are infinite where no start leads to any.
    """
    out = np.full((len(x), 8), np.inf)
    for i in range(0, len(x), RETRIED // count):
        part = slice(i, i + RETRIED // count)
        _, near = search.candidates(x[part], count)
        k = near.shape[1]
        feet = np.full((2, near.size, 8), np.nan)
        status = np.full(near.size, _kernels_newton.FALLBACK, np.int64)
        many = np.repeat(x[part], k, axis=0), np.repeat(p[part], k, axis=0)
        counts = np.zeros((near.size, 2), np.int64)
        search._run(*many, near.reshape(-1, 1), feet, counts, status)
        feet[0, status >= _kernels_newton.FALLBACK, DISTANCE] = np.inf
        found = feet[0].reshape(-1, k, 8)
        out[part] = found[np.arange(len(found)), np.abs(found[:, :, DISTANCE]).argmin(axis=1)]
    return out


def unresolved(
    search: SeededSpace, p: FloatArray, distance: FloatArray, near: IntArray,
    feet: FloatArray, status: IntArray,
) -> AnyArray:  # fmt: skip
    """Where no start converged, or a further seed may lie next to a foot that is nearer.

    Parameters
    ----------
    search : SeededSpace
        Seeds and their spacing.
    p : ndarray, shape (n, 3)
        Queries in tile coordinates.
    distance, near : ndarray, shape (n, k)
        Distances and numbers of the seeds looked at, nearest first.
    feet, status : ndarray, shape (2, n, 8) and (n,)
        What `_kernels.closest` has found.

    Returns
    -------
    ndarray of bool, shape (n,)
        True for these.
    """
    failed = status >= _kernels_newton.FALLBACK
    if distance.shape[1] == len(search.seeds.points):
        return failed
    h = search.spacing.around(p, near)
    out: AnyArray = failed | (distance[:, -1] < _within(h, feet))
    return out


def _within(h: FloatArray, feet: FloatArray) -> FloatArray:
    """Within which distance (n,) seeds a spacing apart may lie next to a nearer foot."""
    first, second = np.abs(feet[:, :, DISTANCE])
    several = second < first + RIVAL * h
    out: FloatArray = np.sqrt(first**2 + np.where(several, CROWDED, PILED) * h**2)
    return out
