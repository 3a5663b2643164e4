"""Curves and surfaces of critical points: which points belong to one, and what stands for it.

Parallel planes, tubes and honeycombs meet along whole curves or surfaces at once. Newton's method
ends on these at places without number, of which about one per cell of a grid is known. Those with
a common value, which the distance also has half-way between them, belong together.

Guarantee: isolated points with no other point of their value about stay as they are.
Non-guarantee: what changes is told for sets that end at faces of the domain only, like discs, and
for those that go all the way round in a closed direction, like rings. For sets that end inside
(the strip in the middle of a slot) it is that of a point in the middle; sets with holes are not
told from discs, nor sets that touch from one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.offsets.polish import inside, shortest
from ilattice.topology.clearance import Clearance
from ilattice.topology.critical_point import CriticalPoint

#: How far from each other, in cells of the grid, points of a critical curve or surface may be.
LINKED = 5.0
#: Differences of equal values, and from that half-way between two points, per distance.
EQUAL, BETWEEN = 1e-6, 0.05
#: How far from each other, in cells of the grid, points are the same.
DUPLICATES = 0.01


def one_of_each(
    points: list[CriticalPoint], clearance: Clearance, spacing: FloatArray
) -> list[CriticalPoint]:
    """Points with one only of each critical curve or surface.

    Parameters
    ----------
    points : list of CriticalPoint
        Isolated ones, and others.
    clearance : Clearance
        What they are critical points of.
    spacing : ndarray, shape (3,)
        Sizes of cells of the grid.

    Returns
    -------
    list of CriticalPoint
        The isolated ones that lie on no curve or surface, and of each of these the point that is
        most in its middle, with its Euler number.
    """
    points = _without_duplicates(points, clearance, spacing)
    if all(p.isolated for p in points):
        return points
    on, u = np.array([p.on for p in points]), np.array([p.u for p in points])
    near = clearance.tree(u, spacing)[0].query_pairs(LINKED, p=np.inf, output_type="ndarray")
    pairs = _joined(points, clearance, near)
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(u), len(u)))
    _, label = connected_components(graph, directed=False)
    u, ring = _unrolled(u, pairs, label, clearance)
    out = []
    for k in range(label.max() + 1):
        rows = np.flatnonzero(label == k)
        away = np.linalg.norm((u[rows] - np.median(u[rows], axis=0)) / spacing, axis=1)
        first = points[rows[np.lexsort((away, np.count_nonzero(on[rows], axis=1)))[0]]]
        out.append(replace(first, euler=0) if k in ring else first)
    return out


def _unrolled(
    u: FloatArray, pairs: IntArray, label: AnyArray, clearance: Clearance
) -> tuple[FloatArray, set[int]]:
    """Parameters (n, 3) as they are along a set, seams or not, and the labels of rings.

    From the first point of each set along pairs (m, 2); a ring has a pair whose ends, gone to
    along others, are a whole way round from each other.
    """
    n = len(u)
    first = np.unique(label, return_index=True)[1]
    edges = np.concatenate([pairs, np.column_stack([np.full(len(first), n), first])])
    graph = coo_array((np.ones(len(edges)), edges.T), shape=(n + 1, n + 1))
    order, before = breadth_first_order(graph, n, directed=False)
    out = u.copy()
    for k in order[(before[order] >= 0) & (before[order] < n)]:
        out[k] = out[before[k]] + shortest(clearance.lattice, u[k] - u[before[k]])
    a, b = pairs.T
    gap = out[b] - out[a] - shortest(clearance.lattice, u[b] - u[a])
    around = (np.abs(gap) > 0.5 * np.ptp(clearance.domain, axis=0)).any(axis=1)
    return out, set(label[a[around]].tolist())


def _without_duplicates(
    points: list[CriticalPoint], clearance: Clearance, spacing: FloatArray
) -> list[CriticalPoint]:
    """Points without those at isolated ones, to which starts with the same foot twice led."""
    if not points:
        return points
    on = np.array([p.on for p in points])
    isolated = np.array([p.isolated for p in points])
    tree, _ = clearance.tree(np.array([p.u for p in points]), spacing)
    a, b = tree.query_pairs(DUPLICATES, output_type="ndarray").T
    duplicates = (on[a] == on[b]).all(axis=1) & (isolated[a] != isolated[b])
    a, b = a[duplicates], b[duplicates]
    dropped = set(np.where(isolated[a], b, a).tolist())
    return [p for k, p in enumerate(points) if k not in dropped]


def _joined(points: list[CriticalPoint], clearance: Clearance, pairs: IntArray) -> IntArray:
    """Those of pairs (n, 2) of points that belong to one critical curve or surface."""
    value, side = np.array([p.value for p in points]), np.array([p.side for p in points])
    spread = np.array([not p.isolated for p in points])
    u, lattice = np.array([p.u for p in points]), clearance.lattice
    far = np.abs(lattice.distance(u))
    same = np.ptp(value[pairs], axis=1) <= EQUAL * far[pairs].max(axis=1)
    same &= side[pairs[:, 0]] == side[pairs[:, 1]]
    pairs = pairs[same & spread[pairs].any(axis=1)]
    a, b = pairs.T
    middle = inside(lattice, u[a] + 0.5 * shortest(lattice, u[b] - u[a]))
    between = np.abs(lattice.distance(middle)) - clearance.taken(middle, side[a])[0]
    return pairs[np.abs(between - value[a]) <= BETWEEN * far[a]]
