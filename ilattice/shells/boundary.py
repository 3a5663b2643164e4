"""Boundaries of shells: closed curves on the faces of an octant, of Hermite arcs between nodes.

Lengths are those of the paper: the octant is the cube [-1, 1]³, an eighth of a cell. A node has a
position on its edge, and derivatives in the two faces that meet there, at right angles to the edge:
so curves go on smoothly where they are reflected. Positions are coordinates along the axis, those
on edges from the corner 111 with the other sign: they count away from the middle of the cell (000)
and from its corner (111).

Guarantees: curves cross neither themselves nor each other, to the resolution of 64 chords per arc,
and stay within their faces. Non-guarantee: that there is a surface over them.

Source: Xu et al. 2023, sections 2.2 and 2.4, equation 2, table A.1.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import Frozen, as_array, as_axis, as_whole, read_only
from ilattice.errors import GeometryError, InputError
from ilattice.shells.topologies import FACES, Segment, Topology, edge_place, home, others, parsed

#: Chords per arc of tests, and of distances.
CHORDS = 64
#: Positions beyond this have next to no curve between them and the corner of the cube.
MAX_POSITION = 0.99
#: Largest derivative of a curve that is taken.
MAX_DERIVATIVE = 100.0
#: Positions and derivatives that are nearer are equal.
_EQUAL = 1e-9
#: Most points of a curve that may be asked for: a bound for mistakes.
_MAX_POINTS = 100_000


@dataclass(frozen=True, eq=False, repr=False)
class Boundary(Frozen):
    """Closed curves on the cube [-1, 1]³. Made by `boundary`.

    Attributes
    ----------
    topology : Topology
        Their class.
    positions : (N,) array
        Of the nodes, in the order of ``topology.nodes``; see the module for their signs.
    derivatives : (N, 2) array
        Of the nodes in the two faces that meet there, the lower axis normal to the face first.
    """

    topology: Topology
    positions: FloatArray
    derivatives: FloatArray

    def __post_init__(self) -> None:
        """Check at the door: refuse curves that cross."""
        if not isinstance(self.topology, Topology):
            raise InputError(f"topology must be a Topology, got {self.topology!r:.80}")
        count = len(self.topology.nodes)
        for name, shape in (("positions", (count,)), ("derivatives", (count, 2))):
            a = as_array(name, getattr(self, name))
            if a.shape != shape:
                raise InputError(f"{name} must have shape {shape}, got {a.shape}")
            object.__setattr__(self, name, read_only(np.array(a)))
        if not (np.abs(self.positions) <= MAX_POSITION).all():
            raise InputError(f"positions must be within edges, got {self.positions.tolist()!r:.80}")
        if not ((self.derivatives > 0.0) & (self.derivatives <= MAX_DERIVATIVE)).all():
            raise InputError(f"derivatives must be positive, and at most {MAX_DERIVATIVE:g}")
        self._check_crossings()

    def __repr__(self) -> str:
        """Short form."""
        name = self.topology.paper or self.topology.name
        return f"Boundary({name}, {len(self.positions)} nodes, {len(self.topology.loops)} loops)"

    @cached_property
    def nodes(self) -> FloatArray:
        """Points of the nodes, shape (N, 3)."""
        out = np.empty((len(self.positions), 3))
        for i, number in enumerate(self.topology.nodes):
            axis, ends = edge_place(number)
            sign = -1.0 if home(number) == 1 else 1.0
            out[i, axis] = sign * self.positions[i]
            for a, end in ends.items():
                out[i, a] = 2.0 * end - 1.0
        return read_only(out)

    @cached_property
    def arcs(self) -> FloatArray:
        """Coefficients of the arcs, shape (S, 4, 3): position is their sum times powers of t."""
        rows = []
        for s in self.topology.segments:
            p, d = zip(*(self._end(s, e) for e in s.edges), strict=True)
            away, back = d[0], -d[1]  # the second end is left towards it
            third = 3.0 * (p[1] - p[0]) - 2.0 * away - back
            last = 2.0 * (p[0] - p[1]) + away + back
            rows.append(np.stack([p[0], away, third, last]))
        return read_only(np.array(rows))

    def points(self, count: int = CHORDS + 1) -> FloatArray:
        """Points of all arcs.

        Parameters
        ----------
        count : int
            Number per arc, ends included, at equal steps of its parameter.

        Returns
        -------
        (S, count, 3) array
            In the order of ``topology.segments``.

        Raises
        ------
        InputError
            If `count` is not from 2 to 100 000.
        """
        count = as_whole("count", count, 2, _MAX_POINTS)
        powers = np.linspace(0.0, 1.0, count)[:, None] ** np.arange(4)
        out: FloatArray = np.einsum("tk,skc->stc", powers, self.arcs)
        for i, s in enumerate(self.topology.segments):
            axis, side = divmod(s.face, 2)
            out[i, :, axis] = 2.0 * side - 1.0
        return out

    def loops(self, count: int = CHORDS + 1) -> list[FloatArray]:
        """Closed curves as polygons.

        Parameters
        ----------
        count : int
            Points per arc, ends included.

        Returns
        -------
        list of (n, 3) array
            The last point is not repeated.
        """
        points, left = self.points(count), dict(enumerate(self.topology.segments))
        out = []
        for loop in self.topology.loops:
            parts = []
            for a, b in zip(loop, (*loop[1:], loop[0]), strict=True):
                k = next(k for k, s in left.items() if set(s.edges) == {a, b})
                way = points[k] if left.pop(k).edges == (a, b) else points[k, ::-1]
                parts.append(way[:-1])
            out.append(np.concatenate(parts))
        return out

    def congruent(self, axis: int) -> int:
        """Whether the curves on the two faces of an axis are those of each other, shifted.

        Parameters
        ----------
        axis : int
            From 0 to 2.

        Returns
        -------
        int
            1 if they are and have the same sides, -1 if they are and sides swap, 0 if not.

        Raises
        ------
        InputError
            If there is no such axis.
        """
        axis = as_axis("axis", axis)
        low, high = (self._on_face(2 * axis + side) for side in (0, 1))
        if len(low) != len(high) or np.abs(low - high).max() > _EQUAL:
            return 0
        colours = np.moveaxis(self.topology.colours, axis, 0)
        return int(colours[0, 0, 0] * colours[1, 0, 0])

    def _on_face(self, face: int) -> FloatArray:
        """Ends and derivatives of the arcs of a face within it, sorted."""
        plane = list(others(face // 2))
        found = []
        for s, arc in zip(self.topology.segments, self.arcs, strict=True):
            if s.face == face:
                ends = [(arc[0], arc[1]), (arc.sum(axis=0), -(arc[1] + 2 * arc[2] + 3 * arc[3]))]
                rows = [np.concatenate([p[plane], d[plane]]) for p, d in ends]
                found.append(np.concatenate(sorted(rows, key=_rounded)))
        return np.array(sorted(found, key=_rounded))

    def _end(self, s: Segment, edge: int) -> tuple[FloatArray, FloatArray]:
        """Point of a node, and derivative with which an arc leaves it."""
        i = self.topology.nodes.index(edge)
        axis = s.face // 2
        along, ends = edge_place(edge)
        across = 3 - axis - along
        d = np.zeros(3)
        first = others(along)[0] == axis
        d[across] = (1.0 - 2.0 * ends[across]) * self.derivatives[i, 0 if first else 1]
        return self.nodes[i], d

    def _check_crossings(self) -> None:
        points = self.points()
        for face in range(6):
            mine = [k for k, s in enumerate(self.topology.segments) if s.face == face]
            flat = points[mine][:, :, list(others(face // 2))]
            what = ""
            if np.abs(flat).max() > 1.0 + 1e-12:
                what = "a curve leaves the face"
            elif any(_crosses(a, a, own=True) for a in flat):
                what = "a curve crosses itself"
            elif len(flat) == 2 and _crosses(flat[0], flat[1], own=False):
                what = "two curves cross"
            if what:
                raise GeometryError(
                    f"{what} on face {FACES[face]} of the octant: take smaller derivatives, or "
                    "positions that are further apart"
                )


def check_range(name: str, values: FloatArray, given: Any) -> None:
    """Refuse positions and derivatives that no boundary has.

    Parameters
    ----------
    name : str
        ``derivative``, or else it is a position.
    values : array
        Some of them.
    given : Any
        What is told.

    Raises
    ------
    InputError
        If one is out of range.
    """
    if name == "derivative":
        if not ((values > 0.0) & (values <= MAX_DERIVATIVE)).all():
            told = f"positive, and at most {MAX_DERIVATIVE:g}"
            raise InputError(f"derivative must be {told}, got {given!r:.80}")
    elif not (np.abs(values) <= MAX_POSITION).all():
        raise InputError(
            f"{name} must be on the edge, from {-MAX_POSITION} to {MAX_POSITION} (the edge "
            f"runs from -1 to 1), got {given!r:.80}"
        )


def boundary(
    name: str | Topology, position: ArrayLike = 0.0, derivative: ArrayLike = 1.5
) -> Boundary:
    """Closed curves on the octant [-1, 1]³.

    Parameters
    ----------
    name : str or Topology
        Class, as ``topo_19``; what follows as ``_rrr`` does not matter.
    position : array_like, shape (), (orbits,) or (N,)
        Positions of the nodes on their edges, in (-1, 1): one for all, one per orbit (see
        `Topology.orbits`), or one per node. On edges from the corners 000 and 111 they count away
        from those, on others along the axis.
    derivative : array_like, shape (), (orbits,), (N,) or (N, 2)
        Length of the derivatives of the arcs at the nodes, positive: larger ones are rounder.
        In two columns, those in the two faces that meet at the edge.

    Returns
    -------
    Boundary
        The curves.

    Raises
    ------
    InputError
        If there is no such class, a position is outside of its edge, a derivative is not positive,
        or their numbers are wrong.
    GeometryError
        If curves cross; the message names the face.

    Examples
    --------
    >>> boundary("topo_19", 0.1, 1.5)
    Boundary(topo_19, 6 nodes, 1 loops)
    """
    topology = parsed(name)[0]
    count = len(topology.nodes)
    positions = _per_node("position", position, topology)
    check_range("position", positions, position)
    d = as_array("derivative", derivative)
    if d.shape != (count, 2):
        d = np.repeat(_per_node("derivative", d, topology)[:, None], 2, axis=1)
    check_range("derivative", d, derivative)
    return Boundary(topology, read_only(np.array(positions)), read_only(np.array(d)))


def check_translations(curves: Boundary, symmetry: str) -> None:
    """Refuse translations along axes on whose two faces curves differ.

    Parameters
    ----------
    curves : Boundary
        The boundary.
    symmetry : str
        r or t for each axis.

    Raises
    ------
    GeometryError
        Naming the axis.
    """
    for axis, letter in enumerate(symmetry):
        if letter == "t" and not curves.congruent(axis):
            low, high = FACES[2 * axis], FACES[2 * axis + 1]
            patterns = curves.topology.patterns[2 * axis : 2 * axis + 2]
            why = (
                f"they are coloured differently ({patterns[0]} and {patterns[1]})"
                if patterns[0] != patterns[1]
                else "their curves have other positions or derivatives"
            )
            raise GeometryError(
                f"t along {'xyz'[axis]}: faces {low} and {high} do not fit each other, {why}; "
                f"reflect along {'xyz'[axis]} (r), or make the curves equal"
            )


def _per_node(name: str, value: Any, topology: Topology) -> FloatArray:
    """One number per node."""
    a = as_array(name, value)
    count, orbits = len(topology.nodes), topology.orbits
    if np.ndim(value) == 0 or a.size == 1:
        return np.full(count, float(a.ravel()[0]))
    if a.shape == (len(orbits),):
        out = np.empty(count)
        for number, orbit in zip(a, orbits, strict=True):
            out[list(orbit)] = number
        return out
    if a.shape != (count,):
        more = f", or ({count}, 2)" if name == "derivative" else ""
        raise InputError(
            f"{name} must be one number, one per orbit, shape ({len(orbits)},), or one per node, "
            f"shape ({count},){more}; got shape {a.shape}"
        )
    return a


def _rounded(row: FloatArray) -> list[float]:
    """What rows are sorted by."""
    rounded: list[float] = np.round(row, 9).tolist()
    return rounded


def _crosses(p: FloatArray, q: FloatArray, *, own: bool) -> bool:
    """Whether two polylines in a plane meet; of one, chords that are not neighbours."""
    a, b, c, d = p[:-1, None], p[1:, None], q[None, :-1], q[None, 1:]
    turns = [_turn(a, b, c), _turn(a, b, d), _turn(c, d, a), _turn(c, d, b)]
    meet = (turns[0] * turns[1] <= 0.0) & (turns[2] * turns[3] <= 0.0)
    meet &= np.max(np.abs(turns), axis=0) > 1e-12  # not within one line
    if own:
        i = np.arange(len(p) - 1)
        meet &= np.abs(i[:, None] - i[None, :]) > 1
    return bool(meet.any())


def _turn(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Twice the signed area of triangles."""
    u, v = b - a, c - a
    area: FloatArray = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
    return area
