"""Flips: local changes of which vertices two simplices have that share one.

At a vertex v with simplices A and B a flip swaps a vertex of A for one of B, neither of them v
(paper, Definitions 6 and 7). A *graph* flip keeps the conditions of corner sharing; a *CoST* flip
keeps positions, too, and is refused if simplices then overlap; a *modified* one, in the plane, also
moves v to where the midpoint of the new diagonal of the triangulation is.

Guarantees: a flip twice is nothing; all flips keep the number of edges, and of simplices at every
vertex. In the plane a vertex is balanced just where the flip of the planar order keeps an
embedding.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from ilattice._geometry import grid_points
from ilattice._progress import Progress, track
from ilattice._typing import FloatArray, IntArray
from ilattice._validate import (
    as_array,
    as_choice,
    as_kind,
    as_not_negative,
    as_numbers,
    as_rows,
    as_whole,
    asked,
)
from ilattice.cost import _kernels_flips as kernels
from ilattice.cost.embedding import EPS
from ilattice.cost.midpoint import coloured_stack, two_coloured
from ilattice.cost.structure import CornerSharing
from ilattice.errors import GeometryError, InputError

KINDS = ("graph", "cost", "modified")


def options(k: CornerSharing, vertex: int) -> IntArray:
    """All pairs of vertices that a flip at a vertex may swap.

    Parameters
    ----------
    k : CornerSharing
        The structure.
    vertex : int
        Where the flip is.

    Returns
    -------
    ndarray of int, shape (d², 2)
        A vertex of its first simplex and one of its second; none if it has one only.
    """
    v = _vertex(k, vertex)
    A, B = k.incidence[v]
    if B < 0:
        return np.zeros((0, 2), np.int64)
    a, b = (s[s != v] for s in k.simplices[[A, B]])
    return grid_points(a, b)


def _vertex(k: CornerSharing, vertex: Any) -> int:
    as_kind("k", k, "CornerSharing")
    return int(as_numbers("vertex", [vertex], len(k.positions))[0])


def planar_pair(k: CornerSharing, vertex: int) -> tuple[int, int]:
    """The swap at a vertex in the plane that keeps the cyclic order around it.

    Parameters
    ----------
    k : CornerSharing
        The structure, in the plane.
    vertex : int
        Where the flip is.

    Returns
    -------
    tuple of int
        A vertex of its first triangle, and one of its second.

    Raises
    ------
    GeometryError
        If the vertex has one triangle only, or the triangles cross there.
    """
    v = _vertex(k, vertex)
    if k.dim != 2:
        raise InputError("planar_pair is for structures in the plane")
    pairs = options(k, v)
    if not len(pairs):
        raise GeometryError(f"vertex {v} has one triangle only: there is nothing to flip")
    a, b = pairs[::2, 0], pairs[:2, 1]
    around = np.concatenate([a, b])
    way = k.positions[around] - k.positions[v]
    order = np.argsort(np.arctan2(way[:, 1], way[:, 0]), kind="stable")
    first = order < 2
    if first[0] != first[1] and first[1] != first[2]:
        raise GeometryError(f"the triangles at vertex {v} cross")
    turn = next(i for i in range(4) if first[i] and first[(i + 1) % 4])
    ring = around[np.roll(order, -turn)]  # a1, a2, b1, b2 counter-clockwise
    return int(ring[0]), int(ring[2])


def is_balanced(k: CornerSharing, vertex: int) -> bool:
    """Whether no closed half-plane, or half-space, holds all edges at a vertex.

    Parameters
    ----------
    k : CornerSharing
        The structure.
    vertex : int
        The vertex.

    Returns
    -------
    bool
        True in the plane if no gap between edges is of 180 degrees or more.
    """
    v = _vertex(k, vertex)
    rows = k.incidence[v]
    ends = np.unique(k.simplices[rows[rows >= 0]])
    way = k.positions[ends[ends != v]] - k.positions[v]
    way = way / np.linalg.norm(way, axis=1)[:, None]
    if k.dim == 2:
        angle = np.sort(np.arctan2(way[:, 1], way[:, 0]))
        gaps = np.diff(np.append(angle, angle[0] + 2.0 * np.pi))
        return bool(gaps.max() < np.pi - 1e-12)
    i, j = np.triu_indices(len(way), 1)
    normals = np.cross(way[i], way[j])
    side = normals[np.linalg.norm(normals, axis=1) > 1e-9] @ way.T
    one = (side >= -1e-12).all(axis=1) | (side <= 1e-12).all(axis=1)
    return not bool(one.any())


def flipped(
    k: CornerSharing, vertex: int, swap: Any = None, *, kind: str = "cost"
) -> CornerSharing:
    """The structure after one flip.

    Parameters
    ----------
    k : CornerSharing
        The structure.
    vertex : int
        Vertex with two simplices.
    swap : pair of int, optional
        A vertex of its first simplex and one of its second; default, in the plane, the pair of
        `planar_pair`.
    kind : {"cost", "graph", "modified"}
        With "graph" overlaps do not matter; "modified", in the plane, moves the vertex.

    Returns
    -------
    CornerSharing
        The structure, without `origin` and `coarse`.

    Raises
    ------
    GeometryError
        If simplices would share two vertices, or, but for "graph", be flat or overlap.
    """
    v = _vertex(k, vertex)
    as_choice("kind", kind, KINDS)
    if swap is None:
        if k.dim == 3:
            raise InputError("swap must be given in space: one of `options`")
        swap = planar_pair(k, v)
    found = as_numbers("swap", list(swap), len(k.positions)).tolist()
    if len(found) != 2:
        raise InputError(f"swap must be two vertices, got {swap!r:.80}")
    a, b = found
    s, vt = np.array(k.simplices), np.array(k.incidence)
    x = np.array(k.positions)
    if kind == "modified":
        if k.dim != 2:
            raise InputError("modified flips are for structures in the plane")
        corners = s[vt[v]]
        x[v] = 0.5 * (x[corners[corners != v]].sum(axis=0)) - x[v]
    if not kernels.swap(s, vt, v, a, b):
        raise GeometryError(
            f"the flip at vertex {v} that swaps {a} and {b} is none, or simplices would then share "
            "two vertices"
        )
    if _doubles(s[vt[v]], _barred(k)):
        raise GeometryError(
            f"the flip at vertex {v} that swaps {a} and {b} makes an edge where a bar is: flip "
            "first, and stiffen then"
        )
    if kind != "graph":
        for t in vt[v]:
            if kernels.overlaps_any(x, s, t, EPS):
                raise GeometryError(
                    f"after the flip at vertex {v} that swaps {a} and {b} simplex {int(t)} is flat "
                    "or overlaps another one; see `is_balanced`, or kind='graph'"
                )
    return CornerSharing(x, s, k.bars)


def layer_flipped(
    layer: CornerSharing, layers: Any, vertices: Any, apices: Any = None
) -> CornerSharing:
    """A stack after the same planar flips in all its layers (layer-induced flips of the paper).

    Triangles keep the colours that they have before the flips, so that the same ones get apices:
    a vertex that is moved to a triangle of its other colour has both of its tetrahedra on one side
    of its layer then, or none at the first or the last one, where it is left out.

    Parameters
    ----------
    layer : CornerSharing
        The structure of a layer, in the plane.
    layers, apices : array_like
        As in `ilattice.cost.stacked`.
    vertices : int or sequence of int
        Vertices of the layer, flipped one after the other.

    Returns
    -------
    CornerSharing
        The stack.

    Raises
    ------
    GeometryError
        If the triangles cannot be coloured, or a flip is not possible; see `flipped`.

    Examples
    --------
    >>> import numpy as np
    >>> import ilattice as il
    >>> layer = il.cost.kagome(5, dim=2)
    >>> flat = np.pad(layer.positions, ((0, 0), (0, 1)))
    >>> layers = [flat, flat + [0, 0, 0.16], flat + [0, 0, 0.32]]
    >>> inner = np.flatnonzero(layer.valence == 4)[0]
    >>> il.cost.flips.layer_flipped(layer, layers, int(inner))
    CornerSharing(50 tetrahedra, 144 vertices, 0 bars)
    """
    as_kind("layer", layer, "CornerSharing")
    colour = two_coloured(layer)
    for vertex in np.atleast_1d(vertices).tolist():
        layer = flipped(layer, vertex)
    return coloured_stack(layer, layers, apices, colour)


# ------------------------------------------------------------------------------ at random


def randomised(
    k: CornerSharing, steps: int, *, seed: int = 0, kind: str = "cost", target: Any = None,
    temperature: float = 0.0, fixed: Any = (), progress: Progress = None,
) -> CornerSharing:  # fmt: skip
    """Random flips: all that are possible, or those that lead to a distribution of lengths.

    A Markov chain by Metropolis' rule: a vertex and a swap are drawn; the flip is made if it is
    possible and lowers the energy, or else with probability exp(-change / temperature).

    Parameters
    ----------
    k : CornerSharing
        The structure.
    steps : int
        How many flips are tried.
    seed : int
        Of the random numbers: the same gives the same structure.
    kind : {"cost", "graph"}
        As in `flipped`.
    target : callable, optional
        Distribution of the lengths of edges: a function of lengths (n,) over their mean at the
        start that gives an energy per edge (n,), such as minus the logarithm of a density. Without
        it all flips that are possible are made.
    temperature : float
        Of the rule; 0 takes only flips that do not raise the energy.
    fixed : array_like of int, or mask
        Vertices where nothing is flipped.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Returns
    -------
    CornerSharing
        The structure.
    """
    as_kind("k", k, "CornerSharing")
    as_choice("kind", kind, KINDS[:2])
    count, heat = as_whole("steps", steps, 0, 10**9), as_not_negative("temperature", temperature)
    rng = np.random.default_rng(as_whole("seed", seed, 0, 2**63 - 1))
    x, s, vt = np.array(k.positions), np.array(k.simplices), np.array(k.incidence)
    inner = np.flatnonzero(vt[:, 1] >= 0)
    fixed = fixed if isinstance(fixed, np.ndarray) else list(fixed)
    inner = np.setdiff1d(inner, as_rows("fixed", fixed, len(x)))
    barred = _barred(k)
    if not len(inner) or count == 0:
        return k
    mean = float(k.lengths.mean())
    pick = inner[rng.integers(len(inner), size=count)]
    place = rng.integers(k.dim, size=(count, 2))
    luck = rng.random(count)
    tries = zip(pick.tolist(), place.tolist(), luck.tolist(), strict=True)
    for v, (i, j), chance in track(tries, "flips", progress, total=count):
        A, B = vt[v]
        a, b = (int(c[c != v][m]) for c, m in ((s[A], i), (s[B], j)))
        before = _energy(x, s[vt[v]], target, mean)
        if not kernels.swap(s, vt, v, a, b):
            continue
        bad = _doubles(s[vt[v]], barred)
        bad = bad or (kind == "cost" and any(kernels.overlaps_any(x, s, t, EPS) for t in vt[v]))
        rise = 0.0 if bad else _energy(x, s[vt[v]], target, mean) - before
        lucky = heat > 0.0 and chance < np.exp(-rise / heat)
        if bad or (rise > 0.0 and not lucky):
            A, B = vt[v]
            now_a, now_b = (a, b) if a in s[A] else (b, a)
            kernels.swap(s, vt, v, now_a, now_b)
    return replace(k, simplices=s, origin=None, coarse=None)


def _barred(k: CornerSharing) -> frozenset[tuple[int, int]]:
    """Ends of the bars, lower ones first."""
    return frozenset((min(a, b), max(a, b)) for a, b in k.bars.tolist())


def _doubles(simplices: IntArray, barred: frozenset[tuple[int, int]]) -> bool:
    """Whether an edge of some simplices is a bar, too."""
    if not barred:
        return False
    i, j = np.triu_indices(simplices.shape[1], 1)
    ends = np.sort(np.stack([simplices[:, i], simplices[:, j]], -1).reshape(-1, 2), axis=1)
    return any((a, b) in barred for a, b in ends.tolist())


def _energy(x: FloatArray, simplices: IntArray, target: Any, mean: float) -> float:
    """Energy of the edges of some simplices."""
    if target is None:
        return 0.0
    i, j = np.triu_indices(simplices.shape[1], 1)
    ends = x[simplices[:, i]] - x[simplices[:, j]]
    lengths = np.linalg.norm(ends, axis=2).ravel() / mean
    return float(as_array("target", asked("target", target, lengths)).sum())
