"""The 20 ways in which closed curves pass through all faces of a cube.

A curve meets edges of the cube in nodes, and runs from node to node on faces. On a face it cuts off
corners, or separates two opposite edges: eight patterns per face, 8⁶ for the cube. In 256 of these
every node is the end of two segments; up to the 48 symmetries of the cube they are 20 classes.

Classes have our names c1 to c20, in the order of their numbers of nodes and loops. The numbers of
the paper are known for some: 1, 3, 6, 18 and 19 follow from what it says, 8, 11 and 14 are our
choice among those that fit.

Guarantees: `enumerated` finds classes from nothing but the patterns; what the table says of each is
checked against it by tests.

Source: Y. Xu, H. Pan, R. Wang, Q. Du, L. Lu, New families of triply periodic minimal surface-like
shell lattices, Additive Manufacturing 2023, section 2.2, figures 3 to 5.
"""

import re
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import permutations, product

import numpy as np

from ilattice._geometry import grid_points
from ilattice._typing import IntArray
from ilattice._validate import FrozenCopies, near_names, read_only
from ilattice.errors import InputError

#: Faces in the order of patterns.
FACES = ("x-", "x+", "y-", "y+", "z-", "z+")
_CORNERS = ("00", "01", "10", "11")
_DOUBLE = ("00+11", "01+10")
_WORD = re.compile(r"(topo_\d+|c\d+)(?:_([rt]{3}))?")
#: Our name, the paper's, its family, and patterns.
_TABLE = """
c1  topo_1  N    01+10 01+10 01+10 01+10 01+10 01+10
c2  -       -    00+11 00+11 00+11 01+10 01+10 00+11
c3  -       -    00+11 00+11 00+11 00+11 01+10 00+11
c4  -       -    00+11 01+10 00+11 01+10 01+10 00+11
c5  topo_3  FRD  00+11 00+11 00+11 00+11 00+11 00+11
c6  -       -    00+11 00+11 01+10 00+11 01+10 00+11
c7  topo_8  FRD  01+10 00+11 01+10 00+11 01+10 00+11
c8  -       -    00+11 00 00+11 00 01+10 00
c9  topo_11 P    00+11 00 00+11 00 00+11 00
c10 -       -    00+11 00 01+10 00 01+10 00
c11 topo_14 P    01+10 00 01+10 00 01+10 00
c12 -       -    00 00 00+11 |x 01+10 |x
c13 -       -    00+11 01+10 |z |z |y |y
c14 -       -    00 00 00+11 |x 00+11 |x
c15 topo_6  -    00+11 00+11 |z |z |y |y
c16 -       -    00 01+10 |z 11 |y 11
c17 -       -    00 00+11 |z 11 |y 11
c18 -       -    00 01 |z |x 01 11
c19 topo_19 P    11 00 11 00 11 00
c20 topo_18 IWP  00 11 00 11 00 11
"""


def edge_number(axis: int, ends: tuple[int, int]) -> int:
    """Number of an edge of the cube.

    Parameters
    ----------
    axis : int
        Its direction.
    ends : tuple of int
        Which ends, 0 or 1, it lies at in the two other directions.

    Returns
    -------
    int
        From 0 to 11.
    """
    return 4 * axis + 2 * ends[0] + ends[1]


def edge_place(number: int) -> tuple[int, dict[int, int]]:
    """Direction of an edge, and at which ends of the other two it lies.

    Parameters
    ----------
    number : int
        From 0 to 11.

    Returns
    -------
    tuple of int and dict
        As `edge_number` takes them, by direction.
    """
    axis, rest = divmod(number, 4)
    first, second = others(axis)
    return axis, {first: rest // 2, second: rest % 2}


def home(number: int) -> int:
    """Which of the corners 000 and 111 an edge has.

    Parameters
    ----------
    number : int
        The edge.

    Returns
    -------
    int
        0 for 000, 1 for 111, 2 for neither.
    """
    ends = set(edge_place(number)[1].values())
    return ends.pop() if len(ends) == 1 else 2


def others(axis: int) -> tuple[int, int]:
    """The two other directions, in ascending order.

    Parameters
    ----------
    axis : int
        From 0 to 2.

    Returns
    -------
    tuple of int
        Two of 0, 1, 2.
    """
    first, second = (a for a in range(3) if a != axis)
    return first, second


@dataclass(frozen=True)
class Segment(FrozenCopies):
    """A piece of a curve on a face, from an edge to another.

    Attributes
    ----------
    face : int
        Number in `FACES`.
    edges : tuple of int
        The two edges that it joins, the smaller number first.
    corners : tuple of tuple
        Corners of the face, by their ends in its two directions, on one side of it: one, or two.
    """

    face: int
    edges: tuple[int, int]
    corners: tuple[tuple[int, int], ...]


@cache
def segments(face: int, pattern: str) -> tuple[Segment, ...]:
    """Segments of a pattern.

    Parameters
    ----------
    face : int
        Number in `FACES`.
    pattern : str
        Corners that are cut off, by their ends in the two directions of the face, as ``01+10``; or
        ``|x`` for a segment between x- and x+.

    Returns
    -------
    tuple of Segment
        One or two.
    """
    axis, side = divmod(face, 2)
    b, c = others(axis)

    def edge(along: int, at: int) -> int:
        across = c if along == b else b
        place = {axis: side, across: at}
        first, second = others(along)
        return edge_number(along, (place[first], place[second]))

    if pattern[0] == "|":
        a = "xyz".index(pattern[1])
        low = tuple((0, k) if a == b else (k, 0) for k in (0, 1))
        return (Segment(face, _sorted(edge(a, 0), edge(a, 1)), low),)
    out = []
    for word in pattern.split("+"):
        u, v = int(word[0]), int(word[1])
        out.append(Segment(face, _sorted(edge(b, v), edge(c, u)), ((u, v),)))
    return tuple(out)


def _sorted(a: int, b: int) -> tuple[int, int]:
    return (a, b) if a < b else (b, a)


def patterns(face: int) -> tuple[str, ...]:
    """The eight patterns of a face (figure 3).

    Parameters
    ----------
    face : int
        Number in `FACES`.

    Returns
    -------
    tuple of str
        As `segments` takes them.
    """
    b, c = others(face // 2)
    return (*_CORNERS, f"|{'xyz'[b]}", f"|{'xyz'[c]}", *_DOUBLE)


@dataclass(frozen=True)
class Topology(FrozenCopies):
    """A class of closed curves on a cube. Made by `topology` and `enumerated`.

    Attributes
    ----------
    name : str
        Ours, c1 to c20.
    paper : str
        That of the paper, as topo_19; empty where it is not known.
    family : str
        Surface that the outer boundary of cells is like: P, IWP, FRD, N, or none.
    patterns : tuple of str
        One per face, in the order of `FACES`, as `segments` takes them.
    """

    name: str
    paper: str
    family: str
    patterns: tuple[str, ...]

    def __repr__(self) -> str:
        """Short form."""
        also = f" = {self.paper}" if self.paper else ""
        return f"Topology({self.name}{also}: {'; '.join(self.patterns)})"

    @cached_property
    def segments(self) -> tuple[Segment, ...]:
        """All segments, face by face."""
        return _segments_of(self.patterns)

    @cached_property
    def nodes(self) -> tuple[int, ...]:
        """Edges of the cube on which there is a node, in ascending order."""
        return tuple(sorted({e for s in self.segments for e in s.edges}))

    @cached_property
    def loops(self) -> tuple[tuple[int, ...], ...]:
        """Closed curves, each as its edges in order; longer ones last."""
        return _loops(self.segments)

    @cached_property
    def colours(self) -> IntArray:
        """Side of the corners of the cube, shape (2, 2, 2): +1 or -1; +1 at the corner 000."""
        sign = np.zeros((2, 2, 2), np.int64)
        sign[0, 0, 0] = 1
        for corner in sorted(product((0, 1), repeat=3), key=sum):
            for axis in np.flatnonzero(corner):
                below = tuple(c - (a == axis) for a, c in enumerate(corner))
                first, second = others(int(axis))
                edge = edge_number(int(axis), (corner[first], corner[second]))
                sign[corner] = -sign[below] if edge in self.nodes else sign[below]
        colours: IntArray = read_only(sign)
        return colours

    @cached_property
    def symmetries(self) -> tuple["Symmetry", ...]:
        """Those of the 48 symmetries of the cube that keep it: axes, and which are turned."""
        own = _key(self.segments)
        return tuple(g for g in _group() if _key(_moved(self.segments, g)) == own)

    @cached_property
    def orbits(self) -> tuple[tuple[int, ...], ...]:
        """Nodes, by their numbers in `nodes`, that share a parameter in cells of cubic symmetry.

        Those that permutations of the axes take into each other; the corner 000 of the cube is the
        middle of the cell, which stays where it is. First come those on edges from the corner 000,
        then from 111, then others.
        """
        kept = [axes for axes, turned in self.symmetries if not any(turned)]
        rows: dict[int, int] = {}
        for i, node in enumerate(self.nodes):
            images = [_edge_image(node, (axes, (0, 0, 0))) for axes in kept]
            rows[i] = min(self.nodes.index(e) for e in images)
        heads = sorted(set(rows.values()), key=lambda h: (home(self.nodes[h]), h))
        return tuple(tuple(i for i, head in rows.items() if head == h) for h in heads)

    @cached_property
    def is_cubic(self) -> bool:
        """Whether the three axes can be alike."""
        return sum(not any(turned) for _, turned in self.symmetries) >= 3

    @property
    def is_translational(self) -> bool:
        """Whether opposite faces have equal patterns."""
        return self.patterns[::2] == self.patterns[1::2]


@cache
def table() -> tuple[Topology, ...]:
    """All classes, c1 to c20.

    Returns
    -------
    tuple of Topology
        As this module lists them.
    """
    rows = [line.split() for line in _TABLE.strip().splitlines()]
    return tuple(
        Topology(name, paper.strip("-"), like.strip("-"), tuple(rest))
        for name, paper, like, *rest in rows
    )


def names() -> list[str]:
    """Names of all classes.

    Returns
    -------
    list of str
        Those of the paper where they are known, else ours.
    """
    return [t.paper or t.name for t in table()]


def topology(name: str) -> Topology:
    """A class by its name.

    Parameters
    ----------
    name : str
        Ours, as ``c19``, or that of the paper, as ``topo_19``.

    Returns
    -------
    Topology
        The class.

    Raises
    ------
    InputError
        If there is none of that name; the message lists near ones.
    """
    return parsed(name)[0]


def parsed(name: str | Topology) -> tuple[Topology, str]:
    """A class, and how its octants make up a cell.

    Parameters
    ----------
    name : str or Topology
        As ``topo_19_rrr`` or ``c19``.

    Returns
    -------
    tuple of Topology and str
        The class, and r or t for each axis; "rrr" where nothing is said.

    Raises
    ------
    InputError
        If there is no such class, or the letters are others.
    """
    if isinstance(name, Topology):
        return name, "rrr"
    if not isinstance(name, str):
        raise InputError(f"name must be that of a topology, as topo_19_rrr, got {name!r:.80}")
    known = {n: t for t in table() for n in (t.name, t.paper) if n}
    match = _WORD.fullmatch(name.strip().lower())
    if match is None or match[1] not in known:
        raise InputError(
            f"name: there is no topology {name!r:.40}; near names: "
            f"{near_names(name, list(known))}; a suffix as _rrr or _rtr tells of each axis whether "
            "octants are reflected or translated; il.shells.names() lists all"
        )
    return known[match[1]], match[2] or "rrr"


# -------------------------------------------------------------------- enumeration


def enumerated() -> list[Topology]:
    """Find the classes: all patterns of all faces, closed curves, up to symmetries of the cube.

    Returns
    -------
    list of Topology
        One of each class, in the order of nodes (more first) and loops (longer first), with the
        names of the table; that is, with other patterns than those of the table, but the same
        classes.
    """
    closed = closed_patterns()
    by_key = {_key(_segments_of(p)): p for p in closed}
    named = {_key(t.segments): t for t in table()}
    found = []
    left = dict(by_key)
    while left:
        first = left[min(left)]
        orbit = images(_segments_of(first))
        row = next(t for key, t in named.items() if key in orbit)
        found.append(Topology(row.name, row.paper, row.family, first))
        for image in orbit:
            left.pop(image, None)
    return sorted(found, key=lambda t: int(t.name[1:]))


def closed_patterns() -> list[tuple[str, ...]]:
    """All choices of patterns on the six faces of which the segments close.

    Returns
    -------
    list of tuple of str
        256 of 8⁶ = 262144.
    """
    used = np.zeros((6, 8, 12), bool)
    for face in range(6):
        for row, pattern in enumerate(patterns(face)):
            for s in segments(face, pattern):
                used[face, row, list(s.edges)] = True
    at = grid_points(*[np.arange(8)] * 6)
    degree = np.sum([used[face, at[:, face]] for face in range(6)], axis=0)
    rows = at[(degree != 1).all(axis=1)]
    return [tuple(patterns(f)[k] for f, k in enumerate(row)) for row in rows.tolist()]


#: Axes that take the places of x, y, z, and which of these are turned.
Symmetry = tuple[tuple[int, int, int], tuple[int, int, int]]
#: Segments of a cube by faces and edges: what tells classes apart.
Key = tuple[tuple[int, int, int], ...]


@cache
def _group() -> tuple[Symmetry, ...]:
    """The 48 symmetries of the cube."""
    every: list[Symmetry] = []
    for a, b, c in permutations(range(3)):
        every += [((a, b, c), (i, j, k)) for i, j, k in product((0, 1), repeat=3)]
    return tuple(every)


def images(parts: tuple[Segment, ...]) -> set[Key]:
    """All images of segments under the symmetries of the cube.

    Parameters
    ----------
    parts : tuple of Segment
        Segments.

    Returns
    -------
    set of tuple
        Their faces and edges, sorted.
    """
    return {_key(_moved(parts, g)) for g in _group()}


def _segments_of(chosen: tuple[str, ...]) -> tuple[Segment, ...]:
    return tuple(s for face, p in enumerate(chosen) for s in segments(face, p))


def _key(parts: tuple[Segment, ...]) -> Key:
    return tuple(sorted((s.face, *s.edges) for s in parts))


def _moved(parts: tuple[Segment, ...], g: Symmetry) -> tuple[Segment, ...]:
    """Images of segments, without their corners."""
    return tuple(_segment_image(s, g) for s in parts)


@cache
def _segment_image(s: Segment, g: Symmetry) -> Segment:
    """Where a symmetry takes a segment."""
    axis, side = divmod(s.face, 2)
    to = g[0].index(axis)
    a, b = (_edge_image(e, g) for e in s.edges)
    return Segment(2 * to + (side ^ g[1][to]), _sorted(a, b), ())


@cache
def _edge_image(number: int, g: Symmetry) -> int:
    """Where a symmetry takes an edge."""
    axis, ends = edge_place(number)
    place = {g[0].index(a): end ^ g[1][g[0].index(a)] for a, end in ends.items()}
    first, second = others(g[0].index(axis))
    return edge_number(g[0].index(axis), (place[first], place[second]))


def _loops(parts: tuple[Segment, ...]) -> tuple[tuple[int, ...], ...]:
    """Closed curves of segments."""
    left = [s.edges for s in parts]
    out = []
    while left:
        way = list(left.pop(0))
        while way[0] != way[-1]:
            step = next(e for e in left if way[-1] in e)
            left.remove(step)
            way.append(step[0] if step[1] == way[-1] else step[1])
        out.append(tuple(way[:-1]))
    return tuple(sorted(out, key=lambda loop: (len(loop), loop)))
