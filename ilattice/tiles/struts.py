"""Tiles from graphs: round struts between nodes.

Guarantees: a strut is the union of the balls along its axis, whose radii go linearly from one end
to the other: a capsule, or a round cone; what makes no such graph is refused by name. Otherwise
those of `ilattice.tiles.skeleton`.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice._validate import as_array, as_points
from ilattice.errors import InputError
from ilattice.tiles.entities import Segments
from ilattice.tiles.skeleton import skeleton
from ilattice.tiles.tile import Tile

#: Empty room around a graph in space, in radii of its thickest strut.
ROOM = 0.25


def struts(
    nodes: ArrayLike,
    edges: ArrayLike,
    radii: ArrayLike,
    *,
    blend: float = 0.0,
    faces: str | Mapping[str, str] = "periodic",
    cell: ArrayLike = 1.0,
    name: str = "struts",
) -> Tile:
    """Tile whose solid is the struts of a graph.

    Parameters
    ----------
    nodes : array_like, shape (n, 3)
        Points of the cell; its faces, edges and corners belong to it.
    edges : array_like of int, shape (m, 2)
        Numbers of the nodes at the two ends of each strut, from 0.
    radii : array_like of shape (), (n,), (m,) or (m, 2)
        One for all struts, one per node, one per strut, or those at the two ends of each strut;
        between the ends they are linear.
    blend : float
        Width of the smooth union of the struts; 0 joins them sharply.
    faces : str or mapping
        As in `skeleton`. Across periodic faces struts go on in the next cell, so that cells always
        fit together, and struts on a face, an edge or a corner are whole.
    cell : array_like of shape () or (3,) or (3, 3)
        Edges of the cell: lengths, or vectors as columns; nodes and radii are in its lengths.
    name : str
        Name of the tile.

    Returns
    -------
    Tile
        The tile: ``Lattice(tile, through=...).offset((np.inf, 0))`` is its solid; other offsets go
        by a spline, see `skeleton`. For a graph that is no cell but stands for itself see
        `ilattice.Lattice.from_struts`.

    Raises
    ------
    InputError
        If an edge names no node or joins a node with itself, two edges are the same, a node has
        no edge or is outside of the cell, or a radius is not positive.

    Examples
    --------
    >>> tile = struts([(0, 0, 0), (1, 1, 1)], [(0, 1)], 0.1)
    >>> tile([[0.5, 0.5, 0.5]])
    array([-0.1])
    """
    points, ends, r = as_graph(nodes, edges, radii)
    return skeleton([Segments(points[ends], r)], blend=blend, faces=faces, cell=cell, name=name)


def as_graph(
    nodes: ArrayLike, edges: ArrayLike, radii: ArrayLike
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Nodes, ends and radii of a graph, checked.

    Parameters
    ----------
    nodes, edges, radii : array_like
        As in `struts`.

    Returns
    -------
    ndarray, shape (n, 3)
        Nodes.
    ndarray of int, shape (m, 2)
        Numbers of the ends.
    ndarray, shape (m, 2)
        Radii at the ends.

    Raises
    ------
    InputError
        As in `struts`.
    """
    points = as_points("nodes", nodes)
    found = as_array("edges", edges)
    if found.ndim != 2 or found.shape[1] != 2 or not len(found):
        raise InputError(f"edges must be pairs of nodes, shape (m, 2), got shape {found.shape}")
    ends = found.astype(np.int64)
    wrong = ((ends != found) | (ends < 0) | (ends >= len(points))).any(axis=1)
    _refuse(wrong, found, f"must name nodes by numbers from 0 to {len(points) - 1}")
    _refuse(ends[:, 0] == ends[:, 1], found, "joins a node with itself; drop it")
    length = np.linalg.norm(points[ends[:, 1]] - points[ends[:, 0]], axis=1)
    size = float(np.ptp(points, axis=0).max())
    _refuse(length <= 1e-9 * size, found, "joins two nodes at the same place; merge them")
    low, high = ends.min(axis=1), ends.max(axis=1)
    _, first = np.unique(low * len(points) + high, return_index=True)
    again = np.ones(len(ends), np.bool_)
    again[first] = False
    _refuse(again, found, "is there twice; drop one")
    alone = np.flatnonzero(np.bincount(ends.ravel(), minlength=len(points)) == 0)
    if len(alone):
        raise InputError(
            f"nodes[{alone[0]}] has no edge ({len(alone)} of {len(points)} nodes have none); "
            "drop such nodes, or join them"
        )
    return points, ends, _radii(radii, len(points), ends)


def _refuse(wrong: Any, edges: FloatArray, why: str) -> None:
    """Refuse the first edge that is wrong."""
    if wrong.any():
        i = int(np.argmax(wrong))
        raise InputError(f"edges[{i}] is {edges[i].tolist()}: it {why}")


def _radii(radii: ArrayLike, nodes: int, ends: IntArray) -> FloatArray:
    """Radii at the two ends of each strut."""
    r, m = as_array("radii", radii), len(ends)
    if not (r > 0.0).all():
        i = int(np.argmin(r))
        raise InputError(f"radii must be positive, but number {i} is {r.ravel()[i]:g}")
    if np.ndim(radii) == 0:
        return np.full((m, 2), float(r.ravel()[0]))
    if r.shape == (m, 2):
        return np.array(r)
    if r.shape == (nodes,) and nodes == m:
        raise InputError(
            f"radii may be those of the {nodes} nodes or of the {m} edges; give the radii at the "
            "two ends of each edge, shape (m, 2): radii[edges], or np.stack([radii] * 2, axis=1)"
        )
    if r.shape == (nodes,):
        return r[ends]
    if r.shape == (m,):
        return np.stack([r, r], axis=1)
    raise InputError(
        f"radii must be one number, one per node ({nodes},), one per edge ({m},), or those at the "
        f"ends of edges ({m}, 2), got shape {r.shape}"
    )


def box_around(points: FloatArray, ends: IntArray, radii: FloatArray, blend: float) -> FloatArray:
    """Box (2, 3) that holds a graph with its struts, with some room."""
    most = np.zeros(len(points))
    np.maximum.at(most, ends, radii)
    room = (most + 0.5 * blend + ROOM * most.max())[:, None]
    return np.array([(points - room).min(axis=0), (points + room).max(axis=0)])
