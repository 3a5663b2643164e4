"""Surfaces that do not pass through themselves, although their vertices were moved.

Where two sheets meet, or a pore closes, vertices that were moved onto a surface one by one may
make triangles cross. They are moved to where the surface passes through their own cells first,
then slide along the surface; those that still cross are held back, part of the way to where they
came from.

Guarantees
----------
- The triangles do not cross if those of the contour do not, and no two vertices that were apart are
  in one place; pairs that are left are counted.
- Slivers are removed meanwhile (`ilattice.mesh.repair`), with all that this promises.
- Vertices that are not part of a crossing, nor next to one, do not move.
- Deterministic, for any number of threads.

Not guaranteed
--------------
- That unconverged vertices lie on the surface: they are marked.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ilattice._geometry import fixed_coordinates
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.mesh.contouring import split_quads
from ilattice.mesh.measure import self_intersections
from ilattice.mesh.repair import Repair, remove_slivers
from ilattice.offsets.polish import inside, shortest

if TYPE_CHECKING:
    from ilattice.offsets.mid_surface import MidSurface

#: Rounds in which vertices slide, by this part of the way to the mean of their neighbours.
SLIDES, SLIDE = 16, 0.5
#: Many pairs of triangles that cross are given up sliding once they are more than this part of
#: those so many slides before.
MANY, SLOW, STALLED = 100, 0.9, 4
#: Parts of the way back, one after the other.
BACK = np.array([0.0, 0.125, 0.25, 0.5, 1.0])
#: Most rounds of going back.
ROUNDS = 16

#: Direction along which vertices are sorted.
ODD = np.array([0.4339, 0.6617, 0.6113])
#: Vertices so near to each other, relative to the size of all, are in one place.
ONE_PLACE = 1e-12

Project = Callable[[FloatArray, IntArray], tuple[FloatArray, AnyArray]]


class Uncrossed(NamedTuple):
    """A surface that does not cross itself.

    Attributes
    ----------
    u, x : (V, 3) array
        Vertices in parameters and in space, before repair.
    repair : Repair
        Faces, and which vertices are left.
    unconverged : (V,) array of bool
        Which vertices were held back.
    left : int
        Pairs of triangles that still cross.
    """

    u: FloatArray
    x: FloatArray
    repair: Repair
    unconverged: AnyArray
    left: int


class _Surface:
    """Vertices on the move, and the triangles between them."""

    def __init__(
        self,
        lattice: "MidSurface",
        start: FloatArray,
        u: FloatArray,
        faces: AnyArray,
        kind: AnyArray,
        repaired: bool = False,
    ) -> None:
        self.repaired, self.start = repaired, start
        self.lattice, self.u, self.kind, self.quads = lattice, u.copy(), kind, faces
        self.x = lattice.through.x(u)
        self.spared = np.zeros(len(u), np.bool_)
        self.moved = np.zeros(len(u), np.bool_)
        self.before: Any = np.full_like(faces, -1)
        self.retriangulate()

    def retriangulate(self) -> None:
        """Triangles anew: better diagonals, no slivers; `pairs` and `at` tell what crosses.

        Only triangles that were not there before, or have moved, are compared with all others.
        """
        quads = self.quads
        if self.repaired:
            rows = np.arange(len(quads))
            self.repair = Repair(np.arange(len(self.x)), quads, rows, 0, 0, 0)
        else:
            quads = quads.copy()
            split_quads(self.x, quads)
            self.repair = remove_slivers(self.x, quads, self.kind, spared=self.spared)
        faces = self.repair.vertices[self.repair.faces]
        before, self.before = self.before, np.full_like(quads, -1)
        self.before[self.repair.rows] = faces
        active = _any(faces != before[self.repair.rows]) | _any(self.moved[faces])
        self.pairs, crossing = self_intersections(self.x, faces, active, touching=True)
        doubled = self._doubled(self.repair.vertices)
        self.pairs += len(doubled)
        self.at = np.unique(np.concatenate([faces[crossing].ravel(), doubled.ravel()]))
        self.faces, self.moved = faces, np.zeros(len(self.x), np.bool_)
        self.moved[self.at] = True  # what crosses now is to be looked at again

    def _doubled(self, at: IntArray) -> IntArray:
        """Pairs (n, 2) among vertices that are in one place, though they started apart.

        Along a direction that no face of a part is normal to, such vertices follow each other.
        """
        x = self.x[at]
        along = x @ ODD
        order = np.argsort(along)
        near = ONE_PLACE * float(max(np.ptp(column) for column in x.T)) if len(x) else 0.0
        first = np.flatnonzero(np.diff(along[order]) <= 2.0 * near * np.abs(ODD).sum())
        pairs = at[np.stack([order[first], order[first + 1]], axis=1)]
        pairs = pairs[(np.abs(self.x[pairs[:, 0]] - self.x[pairs[:, 1]]) <= near).all(axis=1)]
        began = self.lattice.through.x(self.start[pairs.ravel()]).reshape(-1, 2, 3)
        return pairs[np.abs(began[:, 0] - began[:, 1]).max(axis=1, initial=0.0) > near]

    def move(self, at: IntArray, u: FloatArray) -> None:
        """Move some vertices."""
        self.u[at] = u
        self.x[at] = self.lattice.through.x(u)
        self.moved[at] = True

    def slid(self) -> tuple[IntArray, FloatArray]:
        """Vertices near crossings, and their places part of the way to their neighbours' mean."""
        near = np.zeros(len(self.u), np.bool_)
        near[self.at] = True
        near[self.faces[_any(near[self.faces])]] = True
        at = np.flatnonzero(near)
        rows = self.faces[_any(near[self.faces])]
        total, count = np.zeros((len(self.u), 3)), np.zeros(len(self.u))
        for i, j in ((0, 1), (1, 2), (2, 0), (1, 0), (2, 1), (0, 2)):
            a, b = rows[:, i], rows[:, j]
            np.add.at(total, a, shortest(self.lattice, self.u[b] - self.u[a]))
            np.add.at(count, a, 1.0)
        step = SLIDE * total[at] / np.maximum(count[at], 1.0)[:, None]
        fixed = fixed_coordinates(self.kind[at])
        return at, inside(self.lattice, self.u[at] + np.where(fixed, 0.0, step))


def uncrossed(
    lattice: "MidSurface",
    start: FloatArray,
    moved: FloatArray,
    faces: AnyArray,
    kind: AnyArray,
    project: Project,
    recall: Project,
    *,
    repaired: bool = False,
) -> Uncrossed:
    """Triangles that do not cross, between vertices that were moved.

    Parameters
    ----------
    lattice : Lattice
        Gives the map, and which directions are closed.
    start, moved : (V, 3) array
        Parameters of the vertices of a contour, and after the motion.
    faces : (F, 3) array of int32 or int64
        The quads of the contour, as pairs of triangles.
    kind : (V,) array of uint8
        Constraints of the vertices (see `Contour`).
    project : callable
        Moves parameters (n, 3) of the vertices (n,) onto their surface; returns the new ones, and
        a mask of those that it could not move.
    recall : callable
        Likewise, but only within the cells of the contour from whose vertices (n, 3) it starts.
    repaired : bool
        The faces are triangles that must stay as they are; slivers are left.

    Returns
    -------
    Uncrossed
        New places, triangles, and what was held back.
    """
    s = _Surface(lattice, start, moved, faces, kind, repaired)
    unconverged = np.zeros(len(start), np.bool_)
    if s.pairs:
        u, lost = recall(start[s.at], s.at)
        s.move(s.at[~lost], u[~lost])
        s.retriangulate()
    pairs: list[int] = []
    for _ in range(SLIDES):
        pairs.append(s.pairs)
        if not s.pairs or _stalled(pairs):
            break
        at, u = s.slid()
        u, unconverged[at] = project(u, at)
        s.move(at, u)
        s.retriangulate()
    if s.pairs:
        unconverged |= _held_back(s, start)
    return Uncrossed(s.u, s.x, s.repair, unconverged, s.pairs)


def _any(corners: AnyArray) -> AnyArray:
    """Which triangles have a corner that is marked, (n,), from marks (n, 3)."""
    return np.asarray(corners[:, 0] | corners[:, 1] | corners[:, 2])


def _stalled(pairs: list[int]) -> bool:
    """Whether slides do not help, from the numbers of pairs before each of them."""
    few = len(pairs) <= STALLED or pairs[-1] <= MANY
    return not few and pairs[-1] > SLOW * pairs[-1 - STALLED]


def _held_back(s: _Surface, start: FloatArray) -> AnyArray:
    """Move vertices back until nothing crosses; which were."""
    back = np.zeros(len(start), np.int8)
    goal = s.u.copy()
    for _ in range(ROUNDS):
        at = s.at
        s.spared[at[back[at] == len(BACK) - 1]] = True
        back[at] = np.minimum(back[at] + 1, len(BACK) - 1)
        way = shortest(s.lattice, start[at] - goal[at])
        s.move(at, inside(s.lattice, goal[at] + BACK[back[at], None] * way))
        s.retriangulate()
        if not s.pairs:
            break
    return back > 0
