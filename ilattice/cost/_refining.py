"""The rules R0 and R1 of refinement; see `ilattice.cost.refinement`.

Guarantees: both rules keep positions, bars and the deficit.
"""

from typing import Any

import numpy as np

from ilattice._memory import need
from ilattice._typing import IntArray
from ilattice._validate import as_choice, as_kind, asked
from ilattice.cost._kernels_kagome import PAIRS2, PAIRS3
from ilattice.cost._structure import Coarse, K, Structure
from ilattice.errors import InputError


def refined(k: K, rule: str = "R0", *, where: Any = None) -> K:
    """Finer simplices.

    Parameters
    ----------
    k : CornerSharing
        The structure.
    rule : {"R0", "R1"}
        R0 keeps the corners of simplices. R1, in the plane, takes triangles in the corners of voids
        in place of the triangles around them. Edges of these that are not divided, since there is
        no refined void beside them, become bars; vertices with no triangle and two bars go.
    where : callable or array_like of bool, shape (m,), optional
        Which simplices: a mask, or a function that takes their centres (m, d) and returns one. With
        R1 a void is refined if all triangles around it are chosen, and no vertex is left with more
        than two bars and no triangle.

    Returns
    -------
    CornerSharing
        With R0 its `coarse` is this one, so that stresses are found by levels.

    Raises
    ------
    InputError
        For another rule, R1 in space, or a mask of another shape.
    """
    as_kind("k", k, "CornerSharing")
    as_choice("rule", rule, ("R0", "R1"))
    mask = _mask(k, where)
    if rule == "R1":
        return _r1(k, mask)
    return _r0(k, np.flatnonzero(mask))


def _mask(k: Structure, where: Any) -> Any:
    m = len(k.simplices)
    if where is None:
        return np.ones(m, np.bool_)
    if callable(where):
        where = asked("where", where, k.positions[k.simplices].mean(axis=1))
    mask = np.asarray(where)
    if mask.shape != (m,) or mask.dtype.kind != "b":
        raise InputError(
            f"where must give True or False for each of {m} simplices, got {mask.dtype} of shape "
            f"{mask.shape}"
        )
    return mask


def children(d: int) -> tuple[IntArray, IntArray]:
    """Children (d + 1, d + 1) of a simplex, by its own corners, then midpoints; pairs."""
    pairs = PAIRS2 if d == 2 else PAIRS3
    number = {tuple(p): d + 1 + i for i, p in enumerate(pairs.tolist())}
    rows = [
        [i if i == j else number[min(i, j), max(i, j)] for j in range(d + 1)] for i in range(d + 1)
    ]
    return np.array(rows, np.int64), pairs


def _r0(k: K, rows: IntArray) -> K:
    d, n = k.dim, len(k.positions)
    table, pairs = children(d)
    need(400.0 * len(rows) * (d + 1), f"{len(rows)} refined simplices", "refine fewer")
    s = k.simplices[rows]
    middle = k.positions[s[:, pairs]].mean(axis=2).reshape(-1, d)
    own = n + np.arange(len(middle)).reshape(-1, len(pairs))
    local = np.concatenate([s, own], axis=1)
    rest = np.delete(k.simplices, rows, axis=0)
    fine = np.concatenate([rest, local[:, table].reshape(-1, d + 1)])
    x = np.concatenate([k.positions, middle])
    return type(k)(x, fine, k.bars, coarse=Coarse(k, np.array(rows)))


# ------------------------------------------------------------------------------ R1


def voids(k: Structure) -> list[IntArray]:
    """Inner facets of a structure of triangles in the plane that are no triangles of it.

    Parameters
    ----------
    k : CornerSharing
        In the plane, embedded.

    Returns
    -------
    list of ndarray of int
        Vertices around each, counter-clockwise.
    """
    return [f for f in facets(k) if (len(f) > 3 and area(k, f) > 0.0) or _is_void(k, f)]


def _is_void(k: Structure, f: IntArray) -> bool:
    """Whether a facet of three vertices is a gap between triangles."""
    if len(f) != 3 or area(k, f) <= 0.0:
        return False
    first = set(k.incidence[f[0]].tolist()) - {-1}
    return not any(set(f.tolist()) == set(k.simplices[i].tolist()) for i in first)


def area(k: Structure, loop: IntArray) -> float:
    """Signed area of a loop of vertices.

    Parameters
    ----------
    k : CornerSharing
        In the plane.
    loop : ndarray of int
        Vertices.

    Returns
    -------
    float
        Positive if they are counter-clockwise.
    """
    p = k.positions[loop]
    q = np.roll(p, -1, axis=0)
    return 0.5 * float((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum())


def facets(k: Structure) -> list[IntArray]:
    """Facets of the planar drawing: vertices with the facet on their left, the outer one too.

    Parameters
    ----------
    k : CornerSharing
        In the plane; bars do not count.

    Returns
    -------
    list of ndarray of int
        The loops; triangles of the structure are among them.
    """
    if k.dim != 2:
        raise InputError("facets are those of structures in the plane")
    e = k.edges[: 3 * len(k.simplices)]
    tail, head = np.concatenate([e[:, 0], e[:, 1]]), np.concatenate([e[:, 1], e[:, 0]])
    way = k.positions[head] - k.positions[tail]
    order = np.lexsort((np.arctan2(way[:, 1], way[:, 0]), tail))
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    start = np.searchsorted(tail[order], np.arange(len(k.positions) + 1))
    twin = (np.arange(len(tail)) + len(e)) % len(tail)
    place = rank[twin]  # after an edge comes the one clockwise of its twin
    v = head
    back = np.where(place > start[v], place - 1, start[v + 1] - 1)
    after = order[back]
    out, seen = [], np.zeros(len(tail), np.bool_)
    for h in range(len(tail)):
        if seen[h]:
            continue
        loop, at = [], h
        while not seen[at]:
            seen[at] = True
            loop.append(int(tail[at]))
            at = int(after[at])
        out.append(np.array(loop, np.int64))
    return out


def _r1(k: K, mask: Any) -> K:
    """Rule R1: split the edges around voids, join the new vertices; corners become triangles."""
    if k.dim != 2:
        raise InputError("rule R1 is for triangles in the plane; use R0 in space")
    chosen = []
    for f in voids(k):
        pairs = zip(f.tolist(), np.roll(f, -1).tolist(), strict=True)
        around = [(min(a, b), max(a, b)) for a, b in pairs]
        sides = [_triangle_of(k, a, b) for a, b in around]
        if all(mask[t] for t in sides):
            chosen.append((f, around, sides))
    while True:
        gone = {t for _, _, sides in chosen for t in sides}
        lost = _stranded(k, gone, {int(v) for f, _, _ in chosen for v in f})
        if not lost:
            return _with_corners(k, sorted(gone), chosen)
        chosen = [c for c in chosen if lost.isdisjoint(k.simplices[c[2]].ravel().tolist())]


def _stranded(k: Structure, gone: set[int], corners: set[int]) -> set[int]:
    """Vertices that would have no triangle, but more than two bars."""
    rows = sorted(gone)
    around = set(k.simplices[rows].ravel().tolist()) - corners
    alone = [v for v in around if all(t < 0 or t in gone for t in k.incidence[v].tolist())]
    return {v for v in alone if k.valence[v] > 2}


def _triangle_of(k: Structure, a: int, b: int) -> int:
    """The triangle that an edge belongs to."""
    both = set(k.incidence[a].tolist()) & set(k.incidence[b].tolist()) - {-1}
    return int(next(iter(both)))


def _with_corners(k: K, gone: Any, chosen: Any) -> K:
    """Triangles in the corners of refined voids, in place of those around them."""
    table: dict[tuple[int, int], int] = {}
    rows: list[list[int]] = []
    for f, around, _ in chosen:
        mids = [table.setdefault(key, len(k.positions) + len(table)) for key in around]
        rows += [[int(v), mids[i], mids[i - 1]] for i, v in enumerate(f)]
    ends = np.array([*table], np.int64).reshape(-1, 2)
    x = np.concatenate([k.positions, k.positions[ends].mean(axis=1)])
    sides = np.sort(k.simplices[gone][:, PAIRS2].reshape(-1, 2), axis=1)
    whole = [s for s in sides.tolist() if tuple(s) not in table]
    bars = np.concatenate([k.bars, np.array(whole, np.int64).reshape(-1, 2)])
    keep = np.delete(k.simplices, gone, axis=0)
    s = np.concatenate([keep, np.array(rows, np.int64).reshape(-1, 3)])
    used = np.unique(s)
    bars = bars[np.isin(bars, used).all(axis=1)]
    name = np.full(len(x), -1, np.int64)
    name[used] = np.arange(len(used))
    return type(k)(x[used], name[s], name[bars])
