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
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ilattice._geometry import fixed_coordinates
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.mesh._voxels import Voxels, extent, in_marked
from ilattice.mesh._windows import Rows, any_corner, around, marked, numbered, whole
from ilattice.mesh.contouring import split_quads
from ilattice.mesh.measure import self_intersections, triangle_quality
from ilattice.mesh.repair import QUALITY, Repair, remove_slivers
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

#: Most voxels each way in which triangles near what crosses are found.
MAX_VOXELS = 256
#: A window moves once there are less than this part of the triangles that it was chosen for.
FEWER = 0.5
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


class _Made(NamedTuple):
    """Triangles (k, 3) of a window, of which rows they are, and which of all rows are changed.

    `active` ones were not there before, or have moved; `stray` ones of these leave the voxels of
    which all triangles are in the window.
    """

    x: FloatArray
    faces: AnyArray
    rows: IntArray
    changed: AnyArray
    active: AnyArray
    stray: AnyArray
    changes: tuple[int, int]


class _Surface:
    """Vertices on the move, and the triangles between them, in a window around what crosses."""

    def __init__(
        self,
        lattice: "MidSurface",
        start: FloatArray,
        u: FloatArray,
        faces: AnyArray,
        kind: AnyArray,
        repaired: bool = False,
    ) -> None:
        self.lattice, self.start, self.u, self.kind = lattice, start, u.copy(), kind
        self.x = lattice.through.x(u)
        self.spared = np.zeros(len(u), np.bool_)
        self.moved = np.zeros(len(u), np.bool_)
        gone, same = np.full_like(faces, -1), np.zeros(len(faces), np.bool_)
        self.rows = Rows(faces, gone, same, not repaired)
        low, high = extent(self.x) if len(u) else np.zeros((2, 3))
        self.size = float((high - low).max())
        self.grid = Voxels.over(low, np.repeat(self.size, 3), len(faces), MAX_VOXELS)
        self.collapses = self.flips = 0
        self.held: float = np.inf  # triangles for which the window was chosen
        self.window = whole(self.rows, len(u), self.grid)
        self.retriangulate()

    def retriangulate(self) -> None:
        """Triangles anew: better diagonals, no slivers; `pairs` and `at` tell what crosses.

        Only triangles that were not there before, or have moved, are compared with all others.
        """
        new = self._made()
        while new.stray.any():
            stray = self.window.vertices[new.faces[new.stray]]
            self._look(self.window.mask, stray)
            new = self._made()
        w = self.window
        faces = w.vertices[new.faces]
        self.rows.faces[w.rows] = -1
        self.rows.faces[w.rows[new.rows]] = faces
        self.rows.changed[w.rows] = new.changed
        self.collapses += new.changes[0]
        self.flips += new.changes[1]
        self.pairs, crossing = self_intersections(new.x, new.faces, new.active, touching=True)
        used = np.zeros(len(new.x), np.bool_)
        used[new.faces] = True
        doubled = self._doubled(w.vertices[used])
        self.pairs += len(doubled)
        self.at = np.unique(np.concatenate([faces[crossing].ravel(), doubled.ravel()]))
        self.moved = np.zeros(len(self.x), np.bool_)
        self.moved[self.at] = True  # what crosses now is to be looked at again
        if self.pairs:
            self._follow()

    def _made(self) -> _Made:
        """Triangles of the window anew."""
        w = self.window
        x, quads = self.x[w.vertices], w.quads
        rows = np.arange(len(quads))
        repair = Repair(np.arange(len(x)), quads, rows, 0, 0, 0)
        if self.rows.paired:
            quads = quads.copy()
            split_quads(x, quads)
            quads[w.frozen] = w.now[w.frozen]
            rows = np.flatnonzero(quads[:, 0] >= 0)
            spared = self.spared[w.vertices] | w.fixed
            repair = remove_slivers(x, quads[rows], self.kind[w.vertices], spared=spared)
            rows = rows[repair.rows]
        faces = repair.vertices[repair.faces]
        changed = np.ones(len(quads), np.bool_)
        changed[rows] = any_corner(faces != quads[rows])
        changed |= w.frozen & self.rows.changed[w.rows]
        now = w.vertices[faces]
        active = any_corner(now != self.rows.faces[w.rows[rows]]) | any_corner(self.moved[now])
        stray = active & in_marked(self.grid.of(x), faces, ~w.mask)
        return _Made(x, faces, rows, changed, active, stray, (repair.collapses, repair.flips))

    def _look(self, mask: AnyArray | bool, faces: AnyArray) -> None:
        """Move the window to voxels that are marked and those about triangles."""
        self.near[faces] = True
        mask = mask | marked(self.x, faces, self.grid)
        self.window = around(self.x, self.rows, self.grid, mask, self.near)

    def _follow(self) -> None:
        """Move the window if it does not hold all that is next to what crosses, or much more."""
        w, (_, faces) = self.window, self._around()
        alone = np.arange(faces.size).reshape(-1, 3)
        leaves = in_marked(self.grid.of(self.x[faces.ravel()]), alone, ~w.mask)
        fixed = np.zeros(len(self.x), np.bool_)
        fixed[w.vertices[w.fixed]] = True
        if len(faces) < FEWER * self.held or leaves.any() or fixed[faces].any():
            self.near, self.held = np.zeros(len(self.x), np.bool_), len(faces)
            self._look(False, faces)

    def _around(self) -> tuple[AnyArray, AnyArray]:
        """Marks of vertices of what crosses and of those next to it, and the triangles of these."""
        faces = self.rows.faces[self.window.rows]
        faces = faces[faces[:, 0] >= 0]
        near = np.zeros(len(self.u), np.bool_)
        near[self.at] = True
        near[faces[any_corner(near[faces])]] = True
        return near, faces[any_corner(near[faces])]

    @property
    def repair(self) -> Repair:
        """The triangles of the whole surface, and all that was done."""
        rows = np.flatnonzero(self.rows.faces[:, 0] >= 0)
        vertices, (faces,) = numbered(len(self.x), self.rows.faces[rows])
        left = int((triangle_quality(self.x[vertices], faces) < QUALITY).sum())
        return Repair(vertices, faces, rows, self.collapses, self.flips, left)

    def _doubled(self, at: IntArray) -> IntArray:
        """Pairs (n, 2) among vertices that are in one place, though they started apart.

        Along a direction that no face of a part is normal to, such vertices follow each other.
        """
        along = self.x[at] @ ODD
        order = np.argsort(along)
        near = ONE_PLACE * self.size
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
        near, rows = self._around()
        at = np.flatnonzero(near)
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
