"""What graphs alone tell: the pebble game, necessary conditions, resistances.

Guarantees: in the plane `pebble_rank` is exact for generic positions, by whole numbers. In space
no count decides rigidity (two rigid bodies that share two corners pass all of them): `necessary`
says what must hold, no more.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array, csr_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray
from ilattice._validate import as_array, as_whole
from ilattice.cost import _kernels_pebble as pebble
from ilattice.cost._structure import _numbers
from ilattice.cost.structure import CornerSharing
from ilattice.errors import GeometryError, InputError


def pebble_rank(vertices: int, edges: ArrayLike) -> tuple[int, AnyArray]:
    """Generic rank of a graph in the plane, exactly, by the (2, 3) pebble game.

    Parameters
    ----------
    vertices : int
        Number of vertices.
    edges : array_like of int, shape (e, 2)
        Edges.

    Returns
    -------
    int
        The rank: 2 n - 3 for rigid graphs (Laman; n of 2 or more).
    ndarray of bool, shape (e,)
        Which edges are independent of those before them.
    """
    n = as_whole("vertices", vertices, 1, 2**31)
    e = _numbers("edges", edges, 2, n)
    taken = np.zeros(len(e), np.bool_)
    rank = int(pebble.play(n, e, taken))
    return rank, taken


@dataclass(frozen=True)
class Necessary:
    """What rigidity in d dimensions needs; it is not enough.

    Attributes
    ----------
    count : bool
        Whether there are d n - d (d + 1) / 2 edges at least.
    valences : bool
        Whether all vertices have d edges at least.
    connected : bool
        Whether the graph is connected.
    joints : bool
        Whether it stays so without any one vertex.
    """

    count: bool
    valences: bool
    connected: bool
    joints: bool

    def __bool__(self) -> bool:
        """Whether all hold."""
        return self.count and self.valences and self.connected and self.joints


def necessary(k: CornerSharing) -> Necessary:
    """Conditions that are necessary for rigidity, and not sufficient: quick filters.

    Parameters
    ----------
    k : CornerSharing
        The structure.

    Returns
    -------
    Necessary
        Which hold. Where one fails the structure is not rigid; where all hold see `analysed`.
    """
    n, e = len(k.positions), k.edges
    graph = csr_array((np.ones(len(e)), (e[:, 0], e[:, 1])), shape=(n, n))
    one = connected_components(graph, directed=False)[0] == 1
    # Blocks of the graph hold whole simplices: a vertex that parts it parts simplices and bars.
    m = len(k.simplices)
    body = np.concatenate(
        [np.repeat(np.arange(m), k.dim + 1), np.repeat(m + np.arange(len(k.bars)), 2)]
    )
    pins = np.concatenate([k.simplices.ravel(), k.bars.ravel()])
    return Necessary(
        k.deficit <= 0, bool((k.valence >= k.dim).all()), one, one and not _parts(body, pins, n)
    )


def _parts(body: IntArray, pins: IntArray, n: int) -> bool:
    """Whether the graph of bodies and pins falls apart without some pin."""
    bodies = int(body.max(initial=-1)) + 1
    total = bodies + n
    a = np.concatenate([body, pins + bodies])
    b = np.concatenate([pins + bodies, body])
    order = np.argsort(a, kind="stable")
    start = np.searchsorted(a[order], np.arange(total + 1))
    return bool(_articulated(start, b[order], bodies))


def _articulated(start: IntArray, to: IntArray, bodies: int) -> bool:
    """Whether a node from `bodies` on parts its connected graph (Hopcroft and Tarjan)."""
    total = len(start) - 1
    depth, low = np.full(total, -1), np.zeros(total, np.int64)
    parent, place = np.full(total, -1), start[:-1].copy()
    stack, root_children = [0], 0
    depth[0] = 0
    while stack:
        v = stack[-1]
        if place[v] < start[v + 1]:
            w = int(to[place[v]])
            place[v] += 1
            if depth[w] < 0:
                depth[w] = low[w] = depth[v] + 1
                parent[w] = v
                root_children += v == 0
                stack.append(w)
            elif w != parent[v]:
                low[v] = min(low[v], depth[w])
            continue
        stack.pop()
        p = int(parent[v])
        if p >= 0:
            low[p] = min(low[p], low[v])
            if p >= bodies and low[v] >= depth[p]:
                return True
    return False


# ------------------------------------------------------------------------------ resistance


def resistance(
    k: CornerSharing, pairs: ArrayLike | None = None, *, conductance: ArrayLike = 1.0
) -> FloatArray:
    """Effective resistances between vertices, of the edges as resistors.

    Parameters
    ----------
    k : CornerSharing
        The structure, connected.
    pairs : array_like of int, shape (p, 2), optional
        Vertices; default the ends of all edges.
    conductance : array_like, shape () or (e,)
        Of the edges.

    Returns
    -------
    ndarray, shape (p,)
        Resistances. Over all edges conductance times resistance sums to n - 1 (Foster).

    Raises
    ------
    GeometryError
        If the structure is not connected.
    """
    n, e = len(k.positions), k.edges
    given = as_array("conductance", conductance)
    if given.shape not in ((), (1,), (len(e),)):
        raise InputError(f"conductance must be one number or ({len(e)},), got shape {given.shape}")
    w = np.broadcast_to(given, (len(e),))
    if (w <= 0.0).any():
        raise InputError(f"conductance must be positive, got {w.min():g}")
    at = e if pairs is None else _numbers("pairs", pairs, 2, n)
    both = np.concatenate([e, e[:, ::-1]])
    A = csr_array((np.tile(w, 2), (both[:, 0], both[:, 1])), shape=(n, n))
    L = csc_array(_diagonal(A) - A)[1:, 1:]
    try:
        solved = splu(csc_array(L), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0)
    except RuntimeError as error:
        raise GeometryError("the structure is not connected: resistances are infinite") from error
    sources, place = np.unique(at[:, 0], return_inverse=True)
    out = np.empty(len(at))
    order = np.argsort(place.ravel(), kind="stable")
    ends = np.searchsorted(place.ravel()[order], np.arange(len(sources) + 1))
    diagonal = np.full(n, np.nan)
    for block in range(0, len(sources), 256):
        rows = np.unique(np.concatenate([
            sources[block : block + 256],
            at[order[ends[block] : ends[min(block + 256, len(sources))]], 1],
        ]))  # fmt: skip
        column = {int(v): i for i, v in enumerate(rows)}
        rhs = np.zeros((n - 1, len(rows)))
        inner = rows > 0
        rhs[rows[inner] - 1, np.flatnonzero(inner)] = 1.0
        G = np.zeros((n, len(rows)))
        G[1:] = solved.solve(rhs)
        diagonal[rows] = G[rows, np.arange(len(rows))]
        for i in range(block, min(block + 256, len(sources))):
            some = order[ends[i] : ends[i + 1]]
            a, b = sources[i], at[some, 1]
            out[some] = diagonal[a] + diagonal[b] - 2.0 * G[b, column[int(a)]]
    return out


def _diagonal(A: csr_array) -> csr_array:
    """Sums of rows on a diagonal."""
    n = A.shape[0]
    s = np.asarray(A.sum(axis=1)).ravel()
    return csr_array((s, (np.arange(n), np.arange(n))), shape=(n, n))
