"""Feet that are checked against those of neighbouring queries, and mended where these are nearer.

Every foot of a query is a point of the surface, and so no other query next to it may have a foot
that is farther away. That finds feet which no seed has led to, at the cost of a subtraction.

Guarantee: no query keeps a foot that is farther than one it was compared with, where that counts
for it. Non-guarantee: a part of the surface that none of the queries has found is not found.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.offsets import _kernels_mending, _kernels_newton, _kernels_seeds
from ilattice.offsets._kernels_patches import DISTANCE, IMAGE
from ilattice.offsets.seeded import SeededSpace
from ilattice.offsets.seeding import Seeds

#: Rounds in which better feet spread to neighbours, and by how much they must be nearer, relative
#: to the distance and to the spacing of seeds.
ROUNDS, NEARER, CLEARLY = 20, 1e-7, 1e-6


def mended(
    search: SeededSpace, x: FloatArray, p: FloatArray, feet: FloatArray, status: IntArray,
    strides: tuple[int, ...], known: FloatArray | None, thorough: bool,
) -> int:  # fmt: skip
    """Replace feet by nearer ones of neighbours; how many queries that concerns.

    Parameters
    ----------
    search : SeededSpace
        Seeds, map and tiles.
    x, p : ndarray, shape (n, 3)
        Queries in space and in tile coordinates.
    feet, status : ndarray, shape (2, n, 8) and (n,)
        What `_kernels.closest` has found; changed in place.
    strides : tuple of int
        Neighbours are the queries so many rows before and behind.
    known : ndarray, shape (n, 6), optional
        A point of the surface for each query: tile coordinates, and its image.
    thorough : bool
        Also compare with the nearest of all feet.

    Returns
    -------
    int
        Queries that were mended.
    """
    changed = np.zeros(len(x), np.bool_)
    both = np.array([s for t in strides for s in (t, -t)], np.int64)
    if known is not None:
        _replace(search, x, p, known[:, :3], known[:, 3:], feet, status, changed)
    if thorough and len(x) > 1:
        near = _nearest(feet[0], x)
        found = feet[0, near, :IMAGE], feet[0, near, IMAGE:DISTANCE]
        _replace(search, x, p, *found, feet, status, changed)
    for _ in range(ROUNDS):
        best = np.abs(feet[0, :, DISTANCE])
        pick = np.full(len(x), -1)
        mine = feet[0, :, IMAGE:DISTANCE], _least(search, best)
        _kernels_mending.compare(len(x), x, *mine, both, best, pick)
        at = np.flatnonzero(pick >= 0)
        start = feet[0, pick[at], :IMAGE]
        fits = _reachable(search, start, p[at])
        if not fits.any():
            break
        at, start = at[fits], start[fits]
        better = _restart(search, x, p, at, start, feet, status)
        changed[at[better]] = True
        if not better.any():
            break
    return int(changed.sum())


def _nearest(feet: FloatArray, x: FloatArray) -> IntArray:
    """Numbers of the feet nearest to queries; any one where none is nearer than their own."""
    tree = cKDTree(feet[:, IMAGE:DISTANCE], balanced_tree=False)
    most = np.abs(feet[:, DISTANCE]).max()
    found: Any = tree.query(x, distance_upper_bound=most if most > 0.0 else np.inf)
    out: IntArray = np.minimum(found[1], len(feet) - 1)
    return out


def started(search: SeededSpace, start: FloatArray) -> Seeds:
    """Points of the surface as seeds.

    Parameters
    ----------
    search : SeededSpace
        Map and tiles.
    start : ndarray, shape (n, 3)
        Tile coordinates.

    Returns
    -------
    Seeds
        One each.
    """
    n = len(start)
    start = np.ascontiguousarray(start)
    y, spacing, rest = np.empty((n, 3)), np.empty(n), np.empty(n)
    normal = np.empty((n, search.seeds.normals.shape[1]))
    place: Any = _kernels_seeds.place_seeds
    cell = np.full((n, 3), search.cell)
    place(n, search.space, start, cell, search.orient, y, normal, spacing, rest)
    return Seeds(start, y, normal, spacing)


def _least(search: SeededSpace, distance: FloatArray) -> FloatArray:
    """By how much (n,) feet must be nearer."""
    out: FloatArray = np.maximum(NEARER * distance, CLEARLY * search.least_spacing)
    return out


def _replace(
    search: SeededSpace, x: FloatArray, p: FloatArray, q: FloatArray, y: FloatArray,
    feet: FloatArray, status: IntArray, changed: AnyArray,
) -> None:  # fmt: skip
    """Feet where points of the surface are nearer: one for each query, and its image."""
    best = np.abs(feet[0, :, DISTANCE])
    at = np.flatnonzero(np.linalg.norm(x - y, axis=1) < best - _least(search, best))
    at = at[_reachable(search, q[at], p[at])]
    if len(at):
        changed[at[_restart(search, x, p, at, q[at], feet, status)]] = True


def _reachable(search: SeededSpace, p: FloatArray, q: FloatArray) -> AnyArray:
    """Which feet p (n, 3) count for the queries q (n, 3), see `_kernels_patches.reachable`."""
    count, closed = np.array(search.lattice.repeat), np.array(search.lattice.through.closed)
    outside = (((p < 0.0) | (p > count)) & ~closed).any(axis=1)
    d = np.where(closed, p - q - count * np.rint((p - q) / count), p - q)
    out: AnyArray = ~outside | (np.abs(d) <= 2.0).all(axis=1)
    return out


def _restart(
    search: SeededSpace, x: FloatArray, p: FloatArray, at: IntArray, start: FloatArray,
    feet: FloatArray, status: IntArray,
) -> AnyArray:  # fmt: skip
    """Feet of the queries `at` from points of the surface nearer than those they have.

    Tells which of them have become nearer.
    """
    n = len(at)
    seeds = started(search, start)
    start, y = seeds.points, seeds.images
    new, counts = np.full((2, n, 8), np.nan), np.zeros((n, 2), np.int64)
    state = np.full(n, _kernels_newton.FALLBACK, np.int64)
    number = np.arange(n)[:, None]
    search._run(x[at], p[at], number, new, counts, state, seeds)
    bound = np.linalg.norm(x[at] - y, axis=1)
    bad = ~(np.abs(new[0, :, DISTANCE]) <= bound) | (state >= _kernels_newton.FALLBACK)
    bad = np.flatnonzero(bad & search.within(start))  # points of the continuation are no feet
    if len(bad):
        search._descend(x[at[bad]], bad, start[bad], new[0])
        state[bad] = _kernels_newton.OK
    old = feet[0, at].copy()
    sign = np.where(old[:, DISTANCE] < 0.0, -1.0, 1.0)
    new[0, :, DISTANCE] = sign * np.abs(new[0, :, DISTANCE])
    better: AnyArray = np.abs(new[0, :, DISTANCE]) < np.abs(old[:, DISTANCE])
    better &= state < _kernels_newton.FALLBACK
    at, new, state = at[better], new[:, better], state[better]
    feet[0, at], feet[1, at], status[at] = new[0], old[better], state
    return better
