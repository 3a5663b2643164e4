"""Bars that make corner-sharing structures minimally rigid.

Three ways: ``matroid`` picks bars whose rows of the rigidity matrix are independent of what is
there and of each other, at the positions given; ``pattern`` puts three bars of nearest neighbours
at every vertex of the outer faces of Kagome structures (a spanning 3-regular graph, Section 4.4 of
the paper); ``cycle`` joins the outer vertices of a plane structure to a ring.

Guarantees: what `matroid` picks is independent at these positions; a rank that stays short is told.
Not guaranteed: `pattern` and `cycle` are right for generic positions, and never for the regular
Kagome structures, whose rows in the planes of faces depend on each other; nor that bars do not
cross.
"""

import warnings
from functools import lru_cache

import numpy as np
from scipy.linalg import qr
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ilattice._memory import need
from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice._validate import as_choice, as_flag, as_kind, as_positive, as_whole
from ilattice.cost._refining import area, facets
from ilattice.cost._structure import K, Structure, _numbers
from ilattice.cost.joining import boundary_faces
from ilattice.cost.rigidity import Rigidity, counted, extended, motions
from ilattice.errors import GeometryError, IlatticeError, InputError, PrecisionWarning

#: Rate at which a bar of unit length must be stretched by a motion that is left, to be picked:
#: motions that are found by elimination may be off by 1e-7.
PICKED = 1e-6
#: Part by which the last of the bars offered is taken to be worse than the first: among equals, as
#: in regular structures, the choice does not hang on rounding, which differs between processors.
EQUAL = 1e-2
#: Lengths of bars that are tried in turn, in mean lengths of edges.
REACHES = (2.3, 2.7, 3.2, 4.0, 6.0, 12.0)


def stiffened(
    k: K, mode: str = "matroid", *, reach: float | None = None, generic: bool = False,
    repair: bool = False, seed: int = 0,
) -> K:  # fmt: skip
    """The structure with bars that make it minimally rigid.

    Parameters
    ----------
    k : CornerSharing
        The structure.
    mode : {"matroid", "pattern", "cycle"}
        See the module. `pattern` is for Kagome structures in space of resolutions l with l mod 4 of
        1 or 2, `cycle` for the plane.
    reach : float, optional
        Longest bar of `matroid`, in mean lengths of edges; by default it grows until the rank is
        full: 2.3, 2.7, 3.2, 4, 6, 12. Where bars between vertices that lack edges do not suffice,
        those between all vertices are tried.
    generic : bool
        Pick bars at positions that are perturbed at random, by 0.05 mean lengths of edges. The rank
        at the true positions may then be lower.
    repair : bool
        Of the bars of `pattern` or `cycle` keep independent ones only, and complete them as
        `matroid` does.
    seed : int
        Of random numbers: of the perturbation, and of the pattern.

    Returns
    -------
    CornerSharing
        With more `bars`.

    Raises
    ------
    InputError
        If a mode is not for this structure.
    GeometryError
        If no bars within reach make it rigid: the message tells the rank that they reach.

    Warns
    -----
    PrecisionWarning
        If the rank at these positions stays short of rigidity (`pattern`, `cycle`, `generic`) or is
        not clear, or edges depended on each other before, so that there are more bars than the
        count asks for.
    """
    out = braced(k, mode, reach=reach, generic=generic, repair=repair, seed=seed)
    tell_rank(out, mode)
    return out


def braced(
    k: K, mode: str = "matroid", *, reach: float | None = None, generic: bool = False,
    repair: bool = False, seed: int = 0,
) -> K:  # fmt: skip
    """What `stiffened` makes, of which the rank is not looked at."""
    as_kind("k", k, "CornerSharing")
    as_choice("mode", mode, ("matroid", "pattern", "cycle"))
    seed = as_whole("seed", seed, 0, 2**31)
    at = k.perturbed(seed=seed) if as_flag("generic", generic) else k
    if mode == "matroid":
        out = k.with_bars(_matroid(at, None, reach))
    else:
        bars = _pattern(k, seed) if mode == "pattern" else _cycle(k)
        out = k.with_bars(_matroid(at, bars, reach) if repair else bars)
    return out


def tell_rank(k: Structure, mode: str) -> Rigidity | None:
    """The rank at these positions, with one warning where it is short, not clear, or not known."""
    try:
        r = counted(k)
    except IlatticeError as e:
        warnings.warn(f"the rank is not known: {e}", PrecisionWarning, stacklevel=4)
        return None
    told = r.caution
    if not r.rigid:
        remedy = "move the vertices (`perturbed`, `mapped`)"
        if k.deficit > 0:
            remedy = f"{k.deficit} edges are missing by count; use the mode 'matroid', or repair"
        elif mode != "matroid":
            remedy = f"the bars are right for generic positions only; {remedy}, or use 'matroid'"
        told = (
            f"the rank at these positions is {r.rank}, {r.flexes} short of rigidity, with "
            f"{r.self_stresses} self-stresses: {remedy}{'; ' * bool(told)}{told}"
        )
    if told:
        warnings.warn(told, PrecisionWarning, stacklevel=4)
    return r


# ------------------------------------------------------------------------------ matroid


def completed(k: K, bars: ArrayLike) -> K:
    """The structure with independent ones of given bars, which must make it rigid.

    Parameters
    ----------
    k : CornerSharing
        The structure.
    bars : array_like of int, shape (b, 2)
        Bars to choose from.

    Returns
    -------
    CornerSharing
        Rigid.

    Raises
    ------
    GeometryError
        If they do not suffice at these positions: the message tells the rank that they reach.
    """
    found = _numbers("bars", bars, 2, len(k.positions))
    ends = np.unique(np.concatenate([_deficient(k), found.ravel()]))
    Z, rank = motions(k, ends)
    wanted = k.positions.size - k.trivial - rank
    picked = _pivots(_rows(k, found, ends, Z), wanted)
    if len(picked) < wanted:
        raise GeometryError(
            f"these {len(found)} bars reach a rank of {rank + len(picked)} of {rank + wanted}, "
            f"{wanted - len(picked)} short: offer more"
        )
    return k.with_bars(found[np.sort(picked)])


def _deficient(k: Structure) -> IntArray:
    """Vertices with fewer edges than two simplices give."""
    return np.flatnonzero(k.valence < 2 * k.dim)


def _matroid(k: Structure, first: IntArray | None, reach: float | None) -> IntArray:
    """Independent bars, some of `first` if given, then the best-conditioned of others."""
    if k.deficit < 0:
        raise InputError(f"the structure has {-k.deficit} edges too many already")
    ends = _deficient(k)
    Z, rank = motions(k, ends)
    if rank + Z.shape[1] < k.positions.size:  # motions that leave these vertices alone
        ends = np.arange(len(k.positions))
        Z, rank = motions(k, ends)
    wanted = k.positions.size - k.trivial - rank
    if k.deficit < wanted:
        warnings.warn(
            f"{wanted - k.deficit} of the {len(k.edges)} edges depend on others at these "
            "positions: so many bars more than the count are needed, and self-stresses stay; "
            "move the vertices (`perturbed`), or use generic=True",
            PrecisionWarning,
            stacklevel=5,
        )
    kept = np.zeros((0, 2), np.int64)
    if first is not None:
        rows = _rows(k, first, ends, Z)
        some = _pivots(rows, wanted)
        kept = first[some]
        Z = _without(Z, rows[some])
    missing = wanted - len(kept)
    if missing == 0:
        return kept
    reaches = REACHES if reach is None else (as_positive("reach", reach),)
    bars, Z = _reached(k, ends, Z, kept, missing, reaches)
    if len(bars) < missing and len(ends) < len(k.positions):  # inner vertices take part, too
        kept, everywhere = np.concatenate([kept, bars]), np.arange(len(k.positions))
        missing -= len(bars)
        bars, Z = _reached(k, everywhere, extended(k, ends, Z), kept, missing, reaches)
    if len(bars) < missing:
        parts = _parts(k)
        apart = f"; the structure has {parts} parts that share no vertex" if parts > 1 else ""
        raise GeometryError(
            f"bars up to {reaches[-1]:g} mean lengths of edges reach a rank of "
            f"{rank + wanted - missing + len(bars)} of {rank + wanted}{apart}: give a larger "
            "reach, or use generic=True if the positions are regular"
        )
    return np.concatenate([kept, bars])


def _parts(k: Structure) -> int:
    """How many parts there are that no edge joins."""
    n, (a, b) = len(k.positions), k.edges.T
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(n, n))
    return int(connected_components(graph, directed=False)[0])


def _reached(
    k: Structure, ends: IntArray, Z: FloatArray, kept: IntArray, missing: int,
    reaches: tuple[float, ...],
) -> tuple[IntArray, FloatArray]:  # fmt: skip
    """As many independent bars as are missing, or as the last reach has, and motions left."""
    for r in reaches:
        new = candidates(k, ends, r * float(k.lengths.mean()), kept)
        need(24.0 * len(new) * Z.shape[1], f"a choice from {len(new)} bars", "give a smaller reach")
        rows = _rows(k, new, ends, Z)
        picked = np.sort(_pivots(rows, missing))
        if len(picked) == missing:
            break
    return new[picked], _without(Z, rows[picked])


def candidates(k: Structure, ends: IntArray, reach: float, known: IntArray) -> IntArray:
    """Pairs of vertices within reach that are no edges yet, shortest first."""
    pairs = cKDTree(k.positions[ends]).query_pairs(reach * (1.0 + 1e-9), output_type="ndarray")
    pairs = np.sort(ends[pairs.astype(np.int64)], axis=1)
    n = len(k.positions)
    there = np.sort(np.concatenate([k.edges, known]), axis=1)
    new = ~np.isin(pairs[:, 0] * n + pairs[:, 1], there[:, 0] * n + there[:, 1])
    pairs = pairs[new]
    way = k.positions[pairs[:, 1]] - k.positions[pairs[:, 0]]
    length = np.round(np.linalg.norm(way, axis=1) / reach, 9)
    return np.asarray(pairs[np.lexsort((pairs[:, 1], pairs[:, 0], length))])


def _rows(k: Structure, bars: IntArray, ends: IntArray, Z: FloatArray) -> FloatArray:
    """Rates (b, z) at which motions at some vertices change half the squared lengths, scaled."""
    place = np.searchsorted(ends, bars)
    way = k.positions[bars[:, 0]] - k.positions[bars[:, 1]]
    way /= np.maximum(np.linalg.norm(way, axis=1), 1e-300)[:, None]
    M = Z.reshape(len(ends), k.dim, -1)
    out = np.zeros((len(bars), Z.shape[1]))
    for a in range(k.dim):
        out += way[:, a, None] * (M[place[:, 0], a] - M[place[:, 1], a])
    return out


def _pivots(rows: FloatArray, most: int) -> IntArray:
    """Rows of size about 1 that are independent, best-conditioned first, at most so many."""
    if not len(rows) or most == 0:
        return np.zeros(0, np.int64)
    fade = 1.0 - np.linspace(0.0, EQUAL, len(rows))
    upper, order = qr(rows.T * fade, mode="r", pivoting=True, check_finite=False)
    p = np.abs(np.diag(upper))
    return np.asarray(order[: min(int((p > PICKED).sum()), most)])


def _without(Z: FloatArray, rows: FloatArray) -> FloatArray:
    """Motions that leave some lengths alone, too."""
    if not len(rows):
        return Z
    Q = qr(rows.T)[0]
    return np.asarray(Z @ Q[:, len(rows) :])


# ------------------------------------------------------------------------------ pattern


def _pattern(k: Structure, seed: int) -> IntArray:
    """Three bars at every vertex of the outer faces of Kagome structures."""
    o = k.origin
    if k.dim != 3 or o is None:
        raise InputError("the mode 'pattern' is for Kagome structures in space (kagome, fill)")
    rows = []
    for c, j in zip(*boundary_faces(o.cells), strict=True):
        level = int(o.resolution[c])
        at = np.flatnonzero((o.cell == c) & (o.integers[:, j] == 0))
        halves = (np.delete(o.integers[at], j, axis=1) - 1) // 2
        ids = np.full((level, level), -1, np.int64)
        ids[halves[:, 0], halves[:, 1]] = at
        for i, (p, q) in enumerate(three_regular(level, seed)):
            a, b = ids[p], ids[q]
            if a < 0 or b < 0:
                raise InputError(f"cell {c} has vertices missing on its face (bar {i}): join first")
            rows.append((a, b))
    return np.array(rows, np.int64).reshape(-1, 2)


@lru_cache(maxsize=64)
def three_regular(level: int, seed: int) -> tuple[tuple[tuple[int, int], tuple[int, int]], ...]:
    """Edges of a 3-regular spanning graph of nearest neighbours in a triangular lattice.

    Parameters
    ----------
    level : int
        Vertices along a side; the corners are left out.
    seed : int
        Which one of many.

    Returns
    -------
    tuple of pairs
        First two halved integers of both ends.

    Raises
    ------
    InputError
        If there is none: N = C(l + 1, 2) - 3 is odd for l mod 4 of 0 and 3.
    """
    if level % 4 not in (1, 2):
        raise InputError(
            f"the mode 'pattern' needs a resolution l with l mod 4 of 1 or 2, got {level}: take "
            f"{level + (1 if level % 4 == 0 else 2)}, or the mode 'matroid'"
        )
    n = level - 1
    points = [(a, b) for a in range(level) for b in range(level - a) if n not in (a, b) and a + b]
    name = {p: i for i, p in enumerate(points)}
    pairs = [
        (name[a, b], name[q]) for a, b in points
        for q in ((a + 1, b), (a, b + 1), (a + 1, b - 1)) if q in name
    ]  # fmt: skip
    if not points:
        return ()
    at = np.array(pairs)
    A = csr_array(
        (np.ones(2 * len(at)), (at.ravel(), np.repeat(np.arange(len(at)), 2))),
        shape=(len(points), len(at)),
    )
    cost = np.random.default_rng(seed).random(len(at))
    found = milp(
        cost, constraints=LinearConstraint(A, 3, 3), integrality=np.ones(len(at), np.int64),
        bounds=Bounds(0, 1), options={"mip_rel_gap": 1.0},
    )  # fmt: skip
    if found.x is None:
        raise InputError(f"no 3-regular graph was found for resolution {level}: {found.message}")
    return tuple((points[i], points[j]) for i, j in at[found.x > 0.5].tolist())


# ------------------------------------------------------------------------------ cycle


def _cycle(k: Structure) -> IntArray:
    """A ring through the outer vertices of a plane structure, less three bars."""
    if k.dim != 2:
        raise InputError("the mode 'cycle' is for structures in the plane")
    outer = min(facets(k), key=lambda f: area(k, f))
    ring = outer[k.incidence[outer, 1] < 0]
    _, first = np.unique(ring, return_index=True)
    ring = ring[np.sort(first)]
    if len(ring) < 4:
        return np.zeros((0, 2), np.int64)
    bars = np.sort(np.stack([ring, np.roll(ring, -1)], axis=1), axis=1)
    n = len(k.positions)
    there = np.sort(k.edges, axis=1)
    new = ~np.isin(bars[:, 0] * n + bars[:, 1], there[:, 0] * n + there[:, 1])
    extra = max(0, 3 - int((~new).sum()))
    bars = bars[new]
    return bars[: len(bars) - extra] if extra else bars
