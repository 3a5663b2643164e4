"""Triangles that get smaller towards the boundary of a surface.

In each round all edges at the boundary are cut in half: the triangles there become a quarter, those
next to them are divided so that no vertex lies within an edge. Sizes grow with the distance from
the boundary, so that what dies out from there is resolved at the price of a few rows of triangles.

Guarantee: neighbours keep whole edges in common, and triangles keep their sides.
"""

from typing import Any

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.minimal.completion import edge_table


def refined(v: FloatArray, faces: IntArray, on: IntArray) -> tuple[FloatArray, IntArray, IntArray]:
    """Triangles of which the edges at the boundary are cut in half.

    Parameters
    ----------
    v : (V, 3) array
        Vertices.
    faces : (F, 3) array
        Corners.
    on : (V, 3) array of int
        On which faces of the octant vertices lie, see `ilattice.shells.octant.Triangles`; the
        boundary of the triangles is what lies on some.

    Returns
    -------
    vertices : (W, 3) array
        The given ones come first, middles of edges follow.
    faces : (G, 3) array
        Corners, in the same sense.
    on : (W, 3) array of int
        As it was given.
    """
    edges, counts, (which, _) = edge_table(faces)
    rim: Any = on.any(axis=1)
    cut = np.flatnonzero(rim[edges].any(axis=1))
    number = np.full(len(edges), -1)
    number[cut] = len(v) + np.arange(len(cut))
    ends = edges[cut]
    middles = 0.5 * (v[ends[:, 0]] + v[ends[:, 1]])
    shared = np.where(on[ends[:, 0]] == on[ends[:, 1]], on[ends[:, 0]], 0)
    shared[counts[cut] != 1] = 0
    points = np.concatenate([v, middles])
    divided = _divided(points, faces, number[which].reshape(-1, 3))
    return points, divided, np.concatenate([on, shared])


def _divided(v: FloatArray, faces: IntArray, middles: IntArray) -> IntArray:
    """Triangles with the middles (F, 3) of edges that start at their corners; -1 for whole ones."""
    cut = middles >= 0
    count = cut.sum(axis=1)
    f = faces[count == 0]
    a, b, c, p, _, _ = _turned(faces, middles, (count == 1), cut.argmax(axis=1))
    halves = [[a, p, c], [p, b, c]]
    d, e, g, _, t, u = _turned(faces, middles, (count == 2), (~cut).argmax(axis=1))
    short = _length(v, d, t) <= _length(v, e, u)  # the edge from d to e is whole
    three = [[g, u, t], [d, e, np.where(short, t, u)], [np.where(short, d, e), t, u]]
    h, i, j, x, y, z = _turned(faces, middles, (count == 3), np.zeros(len(faces), np.int64))
    four = [[h, x, z], [x, i, y], [z, y, j], [x, y, z]]
    parts = [np.stack(part, axis=1) for part in (*halves, *three, *four)]
    return np.concatenate([f, *parts])


def _turned(
    faces: IntArray, middles: IntArray, chosen: AnyArray, first: IntArray
) -> tuple[IntArray, ...]:
    """Corners and middles of chosen triangles, as columns, from a corner on."""
    turn = (first[chosen][:, None] + np.arange(3)) % 3
    corners = np.take_along_axis(faces[chosen], turn, axis=1)
    cuts = np.take_along_axis(middles[chosen], turn, axis=1)
    return (*corners.T, *cuts.T)


def _length(v: FloatArray, a: IntArray, b: IntArray) -> FloatArray:
    """Distances of vertices."""
    lengths: FloatArray = np.linalg.norm(v[a] - v[b], axis=1)
    return lengths
