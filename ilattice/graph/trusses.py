"""Topologies of beams with cubic symmetry: graphs on the nodes of a tetrahedron with 48 images.

Nodes are the vertices of the tetrahedron, the middles of its edges and faces, and its own middle,
15 in all. A topology is a set of at most three of the 105 edges between them that

1. hangs together, with all its images: one piece, which meets all four faces of the tetrahedron;
2. has no two edges that meet elsewhere than at a common node;
3. does not hold an edge of the tetrahedron and a half of it;
4. has no free ends: no node with one beam, images counted;
5. has at most seven beams at a node, images counted.

Source of the nodes: Panetta et al., Elastic textures for additive fabrication, 2015, section 4; the
rules are those of the program with which its authors count them.
"""

from collections.abc import Iterator
from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice._validate import as_positive, as_whole
from ilattice.graph import build
from ilattice.graph.graph import Graph
from ilattice.graph.skeletons import THICKNESS
from ilattice.minimal import tetrahedron

#: Edges of an enumerated truss, and edges that meet at a vertex, at most.
MAX_EDGES, MAX_VALENCE = 3, 7
Edge = tuple[int, int]


@lru_cache(maxsize=1)
def nodes() -> FloatArray:
    """The 15 nodes.

    Returns
    -------
    ndarray, shape (15, 3)
        Vertices, middles of edges, of faces, and the middle.
    """
    corners = tetrahedron().corners
    rows = [c for k in range(1, 5) for c in combinations(range(4), k)]
    out: FloatArray = np.array([corners[list(row)].mean(axis=0) for row in rows])
    out.flags.writeable = False
    return out


@lru_cache(maxsize=1)
def topologies() -> tuple[tuple[Edge, ...], ...]:
    """All topologies, as edges between nodes.

    Returns
    -------
    tuple of tuple of (int, int)
        In order of their numbers of edges.
    """
    on, count = _planes(), len(nodes())
    faces = [sum(1 << int(f) for f in np.flatnonzero(row)) for row in on]
    every = list(combinations(range(count), 2))
    vertices = [e for e in every if e[1] < 4]
    bad = _crossing(every) | {(a, b) for a in vertices for b in every if _halves(a, b)}
    beams = [[_images(k, n) if n != k else 0 for n in range(count)] for k in range(count)]
    bad |= {(b, a) for a, b in bad}
    kept = [sorted(edges) for edges in _connected() if _valid(edges, faces, bad, beams)]
    return tuple(tuple(edges) for edges in sorted(kept, key=lambda edges: (len(edges), edges)))


def truss(number: int, *, thickness: float = THICKNESS) -> Graph:
    """The graph of a topology.

    Parameters
    ----------
    number : int
        Which one, from 0.
    thickness : float
        Diameter of its beams.

    Returns
    -------
    Graph
        With all its images in the unit cell.
    """
    many = topologies()
    edges = many[as_whole("number", number, 0, len(many) - 1)]
    p = nodes()
    made = {k: build.vertex(p[k]) for k in sorted({k for edge in edges for k in edge})}
    d = as_positive("thickness", thickness)
    lines = [build.line(build.chain([made[a], made[b]]), thickness=d) for a, b in edges]
    region = tetrahedron()
    skeleton = build.group(lines) if len(lines) > 1 else lines[0]
    return Graph(build.object(skeleton.completed(region)), region, f"truss_{number}")


def _connected() -> Iterator[frozenset[Edge]]:
    """Sets of edges that hang together."""
    every = list(combinations(range(len(nodes())), 2))
    found: set[frozenset[Edge]] = {frozenset([e]) for e in every}
    for count in range(1, MAX_EDGES + 1):
        yield from found
        if count == MAX_EDGES:
            return
        more: set[frozenset[Edge]] = set()
        for edges in found:
            ends = {k for e in edges for k in e}
            more |= {
                edges | {e} for e in every if e not in edges and (e[0] in ends or e[1] in ends)
            }
        found = more


def _valid(
    edges: frozenset[Edge], faces: list[int], bad: set[tuple[Edge, Edge]], beams: list[list[int]]
) -> bool:
    """Whether a set of edges that hangs together keeps the other rules."""
    met, valence = 0, [0] * 15
    for a, b in edges:
        met |= faces[a] | faces[b]
        valence[a] += beams[a][b]
        valence[b] += beams[b][a]
    if met != 15 or 1 in valence or max(valence) > MAX_VALENCE:
        return False
    fine = True
    for one in edges:
        for other in edges:
            fine &= (one, other) not in bad
    return fine


@lru_cache(maxsize=1)
def _planes() -> Any:
    """Which nodes lie on which faces, (15, 4)."""
    region = tetrahedron()
    return np.abs(nodes() @ region.normals.T - region.offsets) < 1e-12


@lru_cache(maxsize=64)
def _order(faces: tuple[int, ...]) -> int:
    """Number of isometries that reflections in faces through one point generate."""
    normals = tetrahedron().normals[list(faces)]
    turns = [np.eye(3) - 2.0 * np.outer(n, n) for n in normals]
    found = {_key(np.eye(3)): np.eye(3)}
    fresh = list(found.values())
    while fresh:
        new = {_key(t @ m): t @ m for t in turns for m in fresh}
        fresh = [m for key, m in new.items() if key not in found]
        found |= new
    return len(found)


def _key(m: FloatArray) -> tuple[int, ...]:
    return tuple(np.rint(m.ravel() * 1e6).astype(int).tolist())


def _images(k: int, other: int) -> int:
    """Number of beams at node k that are images of the one to another node."""
    on = _planes()
    here = tuple(np.flatnonzero(on[k]).tolist())
    both = tuple(np.flatnonzero(on[k] & on[other]).tolist())
    return _order(here) // _order(both)


def _crossing(every: list[Edge]) -> set[tuple[Edge, Edge]]:
    """Pairs of edges without a common node that meet."""
    i, j = np.triu_indices(len(every), 1)
    E, p = np.array(every), nodes()
    apart = ~(E[i][:, :, None] == E[j][:, None, :]).any(axis=(1, 2))
    i, j = i[apart], j[apart]
    p0, q0 = p[E[i, 0]], p[E[j, 0]]
    d, e, w = p[E[i, 1]] - p0, p[E[j, 1]] - q0, q0 - p0
    n, dd = np.cross(d, e), (d * d).sum(axis=1)
    nn = (n * n).sum(axis=1)
    parallel = nn < 1e-18
    size = np.where(parallel, 1.0, nn)
    s = (np.cross(w, e) * n).sum(axis=1) / size
    t = (np.cross(w, d) * n).sum(axis=1) / size
    low, top = -1e-9, 1.0 + 1e-9
    plane = np.abs((w * n).sum(axis=1)) <= 1e-9
    meet = ~parallel & plane & (low < s) & (s < top) & (low < t) & (t < top)
    ends = np.stack([(w * d).sum(axis=1), ((w + e) * d).sum(axis=1)]) / dd
    line = np.linalg.norm(np.cross(d, w), axis=1) <= 1e-9
    meet |= parallel & line & (ends.min(axis=0) < top) & (ends.max(axis=0) > low)
    return {(every[a], every[b]) for a, b in zip(i[meet].tolist(), j[meet].tolist(), strict=True)}


def _halves(whole: Edge, half: Edge) -> bool:
    """Whether an edge joins two vertices, and another one of these with the middle."""
    if max(whole) > 3 or min(half) not in whole or not 4 <= max(half) < 10:
        return False
    middle = 0.5 * nodes()[list(whole)].sum(axis=0)
    return bool(np.abs(nodes()[max(half)] - middle).max() < 1e-12)
