"""Curves and surfaces of critical points: which points belong to one, and what stands for it.

Parallel planes, tubes and honeycombs meet along whole curves or surfaces at once. Newton's method
ends on these at places without number, of which about one per cell of a grid is known. Those with
a common value, which the distance also has half-way between them, belong together.

Guarantee: isolated points stay as they are. Non-guarantee: the Euler number of a set is that of a
disc, or of a ring if it goes all the way round in a closed direction; sets with holes, and several
ones closer than `LINKED`, are not told.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.offsets.excess import Excess
from ilattice.offsets.polish import inside, shortest

if TYPE_CHECKING:
    from ilattice.offsets.critical import CriticalPoint

#: How far from each other, in cells of the grid, points of a critical curve or surface may be.
LINKED = 5.0
#: Relative difference of equal values, and of the distance half-way between two points.
EQUAL, BETWEEN = 1e-6, 0.05
#: How far from each other, in cells of the grid, points are the same.
TWINS = 0.01


def one_of_each(
    points: list[CriticalPoint], excess: Excess, spacing: FloatArray
) -> list[CriticalPoint]:
    """Points with one only of each critical curve or surface.

    Parameters
    ----------
    points : list of CriticalPoint
        Isolated ones, and others.
    excess : Excess
        What they are critical points of.
    spacing : ndarray, shape (3,)
        Sizes of cells of the grid.

    Returns
    -------
    list of CriticalPoint
        The isolated ones that lie on no curve or surface, and of each of these the point that is
        most in its middle, with its Euler number.
    """
    points = _without_twins(points, excess, spacing)
    if all(p.isolated for p in points):
        return points
    on = np.array([p.on for p in points])
    tree, u = excess.tree(np.array([p.u for p in points]), spacing)
    ends = _joined(points, excess, tree.query_pairs(LINKED, p=np.inf, output_type="ndarray"))
    graph = coo_array((np.ones(len(ends)), ends.T), shape=(len(u), len(u)))
    _, label = connected_components(graph, directed=False)
    members = [np.flatnonzero(label == k) for k in range(label.max() + 1)]
    middle = np.array([np.median(u[m], axis=0) for m in members])
    away = np.linalg.norm(u - middle[label], axis=1)
    first = [m[np.lexsort((away[m], np.count_nonzero(on[m], axis=1)))[0]] for m in members]
    around = np.ptp(excess.domain, axis=0) / spacing
    rings = [_is_ring(u[m], around, excess.closed) for m in members]
    return [
        replace(points[k], euler=0) if ring else points[k]
        for k, ring in zip(first, rings, strict=True)
    ]


def _is_ring(u: FloatArray, around: FloatArray, closed: AnyArray) -> bool:
    """Whether points (n, 3), in cells, go all the way round in a closed direction."""
    for a in np.flatnonzero(closed):
        p = np.sort(u[:, a])
        if np.diff(p, append=p[0] + around[a]).max() <= LINKED:
            return True
    return False


def _without_twins(
    points: list[CriticalPoint], excess: Excess, spacing: FloatArray
) -> list[CriticalPoint]:
    """Points without those at isolated ones, to which starts with the same foot twice led."""
    if not points:
        return points
    on = np.array([p.on for p in points])
    isolated = np.array([p.isolated for p in points])
    tree, _ = excess.tree(np.array([p.u for p in points]), spacing)
    a, b = tree.query_pairs(TWINS, output_type="ndarray").T
    twins = (on[a] == on[b]).all(axis=1) & (isolated[a] != isolated[b])
    a, b = a[twins], b[twins]
    dropped = set(np.where(isolated[a], b, a).tolist())
    return [p for k, p in enumerate(points) if k not in dropped]


def _joined(points: list[CriticalPoint], excess: Excess, pairs: IntArray) -> IntArray:
    """Those of pairs (n, 2) of points that belong to one critical curve or surface."""
    value, side = np.array([p.value for p in points]), np.array([p.side for p in points])
    spread = np.array([not p.isolated for p in points])
    same = np.ptp(value[pairs], axis=1) <= EQUAL * np.abs(value[pairs]).max(axis=1)
    pairs = pairs[same & spread[pairs].any(axis=1)]
    a, b = pairs.T
    u, lattice = np.array([p.u for p in points]), excess.lattice
    middle = inside(lattice, u[a] + 0.5 * shortest(lattice, u[b] - u[a]))
    between = np.abs(lattice.distance(middle)) - excess.taken(middle, side[a])[0]
    return pairs[np.abs(between - value[a]) <= BETWEEN * np.abs(value[a])]
