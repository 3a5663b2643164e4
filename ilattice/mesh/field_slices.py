"""Slices of any field: contours at given heights, without a mesh.

On a grid in each plane the crossed squares are found by bounds of the field and by its values at
the corners; contours go through the points where the field vanishes on the edges of squares, and
points between them where they bend.

Guarantees: contours close and are nested; their points lie on the zero set to 1e-9 of the grid, or
where its sign changes; memory is that of one slice. Where bounds leave room for parts between
corners, points are looked at on finer grids: if any is of another sign the grid is halved, up to
three times; what may be finer still is counted as `Slice.unresolved_area`.
Not guaranteed: contours may touch within cells that are crossed more than twice.
"""

from typing import Any

import numpy as np

from ilattice._geometry import between, grid_points
from ilattice._memory import need
from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray
from ilattice._validate import as_kind, as_positive, as_triple
from ilattice.errors import GeometryError, InputError
from ilattice.fields.node import Node, is_empty
from ilattice.mesh.contouring import contour
from ilattice.mesh.surface import SurfaceMesh
from ilattice.slicing import _kernels_slices as kernels
from ilattice.slicing._loops import EMPTY, MERGE, Outline, apart, crossing, finished
from ilattice.slicing._slicer import as_frame
from ilattice.slicing.slices import SliceStack, stacked

#: Squares along the side of a block that bounds are taken of before its corners are looked at, and
#: blocks that are worked on at once.
BLOCK, BATCH = 2, 16384
#: Times that a grid is halved where something was missed, and steps of the search on edges.
HALVINGS, STEPS = 3, 60
#: Values that are zero, in edges of the grid.
NONE = 1e-12
#: How often contours get points between others, and the turn, in radians, above which they do.
DENSER, BEND = 5, 0.08
#: Bytes for each square of a plane, few of which are looked at, and for each along its side.
PER_SQUARE, PER_SIDE = 0.4, 1e3


class FieldSlicer:
    """Cuts one field.

    Parameters
    ----------
    field : Node
        The solid, with a finite box.
    frame : ndarray, shape (3, 3)
        Rows: the two directions in the plane and its normal.
    h : float
        Sides of the squares.
    """

    def __init__(self, field: Node, frame: FloatArray, h: float) -> None:
        self.field, self.frame, self.h = field, frame, h
        box = np.asarray(field.bounds)
        if is_empty(box):
            raise GeometryError("the solid is empty: there is nothing to slice")
        if not np.isfinite(box).all():
            raise InputError("the solid has no end: intersect it with a box before slicing")
        where = grid_points(*[[0, 1]] * 3)
        self.net = np.take_along_axis(box, where, axis=0)
        flat = self.net @ frame.T
        self.low, self.high = flat.min(axis=0), flat.max(axis=0)
        squares = float(np.prod((self.high - self.low)[:2] / h + 2.0))
        need(
            PER_SQUARE * squares + PER_SIDE * np.sqrt(squares),
            f"{squares:.3g} squares of a slice", "use a larger h",
        )  # fmt: skip

    @property
    def ends(self) -> tuple[float, float]:
        """Least and greatest height."""
        return float(self.low[2]), float(self.high[2])

    def approximation(self) -> SurfaceMesh:
        """A coarse mesh of the whole, for programs that do not know of slices."""
        box = np.asarray(self.field.bounds)
        h = max(self.h, float((box[1] - box[0]).max()) / 200.0)
        axes = [np.arange(a - h, b + 1.5 * h, h) for a, b in box.T]
        return contour(self.field, axes)

    def outline(self, level: float) -> Outline:
        """Loops in which the plane at one height cuts the solid, the solid on their left.

        Parameters
        ----------
        level : float
            The height.

        Returns
        -------
        Outline
            The loops.
        """
        if not self.low[2] <= level <= self.high[2]:
            return EMPTY
        h = self.h
        for k in range(HALVINGS + 1):
            found, missed, unresolved_area = self._attempt(level, h, k < HALVINGS)
            if not missed:
                break
            h *= 0.5
        points, area = found.points, found.area
        return Outline(points, found.start, area, unresolved_area) if len(area) else EMPTY

    # ------------------------------------------------------------------ one grid

    def _space(self, q: FloatArray, level: float) -> FloatArray:
        """Points of the plane (n, 2) in space."""
        return np.asarray(q @ self.frame[:2] + level * self.frame[2])

    def _values(self, q: FloatArray, level: float) -> FloatArray:
        f = self.field(self._space(q, level))
        if np.isnan(f).any():
            raise GeometryError(f"the field is NaN at height {level:g}")
        return np.asarray(f)

    def _ranges(self, lo: FloatArray, hi: FloatArray, level: float) -> FloatArray:
        """Bounds (n, 2) on rectangles of the plane, by boxes in space that hold them."""
        middle = self._space(0.5 * (lo + hi), level)
        reach = 0.5 * (hi - lo) @ np.abs(self.frame[:2])
        return np.asarray(self.field.range(middle - reach, middle + reach))

    def _attempt(self, level: float, h: float, look: bool) -> tuple[Outline, bool, float]:
        """Loops on a grid of width h, whether it missed something, and the unresolved area."""
        count = np.ceil((self.high[:2] - self.low[:2]) / h).astype(np.int64) + 1
        middle = 0.5 * (self.high[:2] + self.low[:2])
        corner = middle - 0.5 * h * count - 1e-3 * np.pi * h * np.array([1.0, 0.7])
        blocks = self._crossed(corner, count, h, level)
        if not len(blocks):
            return EMPTY, False, 0.0
        cells, f, hidden = self._cells(blocks, corner, h, level)
        width = int(count.max()) + 2 * BLOCK
        steps = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)])
        around = (cells[:, None] + steps + 1).reshape(-1, 2) @ np.array([width, 1])
        beside = np.isin((hidden + 1) @ np.array([width, 1]), around)
        missed, unresolved_area = self._hidden(hidden, beside, corner, h, level, look)
        if missed and look:
            return EMPTY, True, unresolved_area
        outline = self._loops(cells, f, corner, count, h, level)
        return outline, False, unresolved_area

    def _crossed(self, corner: FloatArray, count: IntArray, h: float, level: float) -> IntArray:
        """First squares (n, 2) of blocks in which the field may vanish: a quadtree of bounds."""
        size = BLOCK
        while size < count.max():
            size *= 2
        at = np.zeros((1, 2), np.int64)
        while len(at):
            lo = corner + h * at
            r = self._ranges(lo, lo + h * size, level)
            at = at[(r[:, 0] <= 0.0) & (r[:, 1] >= 0.0)]
            if size == BLOCK:
                break
            size //= 2
            steps = size * np.array([(0, 0), (0, 1), (1, 0), (1, 1)])
            at = (at[:, None] + steps).reshape(-1, 2)
            at = at[(at < count).all(axis=1)]
        return at

    def _cells(
        self, blocks: IntArray, corner: FloatArray, h: float, level: float
    ) -> tuple[IntArray, FloatArray, IntArray]:
        """Crossed squares (n, 2), values at their corners (n, 4), and others that may be."""
        grid = grid_points(*[np.arange(BLOCK + 1)] * 2)
        inner = grid_points(*[np.arange(BLOCK)] * 2)
        rows, values, others = [], [], []
        for i in range(0, len(blocks), BATCH):
            at = blocks[i : i + BATCH]
            nodes = (at[:, None] + grid).reshape(-1, 2)
            f = self._values(corner + h * nodes, level).reshape(len(at), BLOCK + 1, BLOCK + 1)
            four = np.stack([f[:, :-1, :-1], f[:, 1:, :-1], f[:, 1:, 1:], f[:, :-1, 1:]], axis=-1)
            four = four.reshape(-1, 4)
            cell = (at[:, None] + inner).reshape(-1, 2)
            solid = four < 0.0
            cut = solid.any(axis=1) & ~solid.all(axis=1)
            rows.append(cell[cut])
            values.append(four[cut])
            others.append(cell[~cut])
        rest = np.concatenate(others)
        if len(rest):
            lo = corner + h * rest
            r = self._ranges(lo, lo + h, level)
            rest = rest[(r[:, 0] < 0.0) & (r[:, 1] > 0.0)]
        return np.concatenate(rows), np.concatenate(values), rest

    def _hidden(
        self, cells: IntArray, beside: AnyArray, corner: FloatArray, h: float, level: float,
        look: bool,
    ) -> tuple[bool, float]:  # fmt: skip
        """Whether points in squares without crossings are of another sign; the unresolved area.

        Of squares `beside` crossed ones, into which contours bulge, only the middle is looked at.
        """
        lo, size = corner + h * cells, h
        if not len(lo):
            return False, 0.0
        sign = self._values(lo, level) < 0.0
        for k in range(HALVINGS):
            middle = lo + 0.5 * size
            other = (self._values(middle, level) < 0.0) != sign
            if look and other.any():
                return True, 0.0
            if k == 0:
                lo, sign = lo[~beside], sign[~beside]
            size *= 0.5
            steps = size * np.array([(0, 0), (0, 1), (1, 0), (1, 1)])
            lo = (lo[:, None] + steps).reshape(-1, 2)
            sign = np.repeat(sign, 4)
            r = self._ranges(lo, lo + size, level)
            keep = (r[:, 0] < 0.0) & (r[:, 1] > 0.0)
            lo, sign = lo[keep], sign[keep]
            if not len(lo):
                break
        return False, float(len(lo) * size * size)

    # ------------------------------------------------------------------ loops

    def _loops(
        self, cells: IntArray, f: FloatArray, corner: FloatArray, count: IntArray, h: float,
        level: float,
    ) -> Outline:  # fmt: skip
        """Contours through crossed squares."""
        comes, goes = self._segments(cells, f, corner, count, h, level)
        names, where = np.unique(comes, return_inverse=True)
        following = np.empty(len(names), np.int64)
        following[where.ravel()] = np.searchsorted(names, goes)
        order, start = np.empty(len(names), np.int64), np.empty(len(names) + 1, np.int64)
        loops = kernels.chain(following, order, start)
        points = self._placed(names, corner, count, h, level)[order]
        start = start[: loops + 1].copy()
        points, start = self._denser(points, start, h, level)
        for part in (MERGE, 1e-2 * MERGE, 0.0):
            keep, first = apart(points, start, np.full(len(points), part * h))
            if not crossing(points[keep], first).any():
                break
        return finished(points[keep], first, 1e-3 * MERGE * h)

    def _segments(
        self, cells: IntArray, f: FloatArray, corner: FloatArray, count: IntArray, h: float,
        level: float,
    ) -> tuple[IntArray, IntArray]:  # fmt: skip
        """Edges of the grid from which contours come and to which they go, the solid on the left.

        Corners of a square run counter-clockwise; side i is that from corner i to the next.
        """
        solid = f < 0.0
        after = np.roll(solid, -1, axis=1)
        leaves, enters = solid & ~after, ~solid & after  # along the boundary
        width = int(count.max()) + BLOCK + 2
        names = np.empty((len(cells), 4), np.int64)
        for side, (di, dj, axis) in enumerate(((0, 0, 0), (1, 0, 1), (0, 1, 0), (0, 0, 1))):
            names[:, side] = ((cells[:, 0] + di) * width + cells[:, 1] + dj) * 2 + axis
        # A contour with the solid on its left enters a square where its boundary leaves the solid.
        twice = leaves.sum(axis=1) == 2
        one = ~twice
        comes = [names[one][leaves[one]]]
        goes = [names[one][enters[one]]]
        if twice.any():
            at = cells[twice]
            middle = self._values(corner + h * (at + 0.5), level) < 0.0
            n, s = names[twice], solid[twice]
            for joined in (True, False):
                for first in (0, 1):  # solid corners 0 and 2, or 1 and 3
                    rows = (middle == joined) & (s[:, 0] == (first == 0))
                    m = n[rows]
                    for c in (first, first + 2):
                        # around a solid corner: from the side that leaves it to the one before it;
                        # joined corners: to the side that enters the other one
                        out = m[:, c]
                        back = m[:, (c + 1) % 4] if joined else m[:, (c - 1) % 4]
                        comes.append(out)
                        goes.append(back)
        return np.concatenate(comes), np.concatenate(goes)

    def _placed(
        self, names: IntArray, corner: FloatArray, count: IntArray, h: float, level: float
    ) -> FloatArray:
        """Points (n, 2) where the field vanishes on edges of the grid."""
        width = int(count.max()) + BLOCK + 2
        axis, place = names % 2, names // 2
        a = corner + h * np.stack([place // width, place % width], axis=1)
        b = a + h * np.eye(2)[axis]
        return self._between(a, b, level)

    def _between(self, a: FloatArray, b: FloatArray, level: float) -> FloatArray:
        """Zeros between points of different signs."""
        ends = np.stack([self._values(a, level), self._values(b, level)], axis=1)
        t = between(lambda p: self._values(p, level), a, b, ends, STEPS, NONE * self.h)
        return a + t[:, None] * (b - a)

    def _denser(
        self, points: FloatArray, start: IntArray, h: float, level: float
    ) -> tuple[FloatArray, IntArray]:
        """Loops with more points where they bend."""
        for _ in range(DENSER):
            after = np.arange(1, len(points) + 1)
            after[start[1:] - 1] = start[:-1]
            way = points[after] - points
            ahead = way[after]
            turn = np.zeros(len(points))
            cross = way[:, 0] * ahead[:, 1] - way[:, 1] * ahead[:, 0]
            turn[after] = np.abs(np.arctan2(cross, (way * ahead).sum(axis=1)))
            size = np.linalg.norm(way, axis=1)
            at = np.flatnonzero((np.maximum(turn, turn[after]) > BEND) & (size > 0.05 * h))
            if not len(at):
                break
            new, good = self._across(points[at], way[at], level)
            at, new = at[good], new[good]
            if not len(at):
                break
            start = start + np.searchsorted(at + 1, start, "right")
            points = np.insert(points, at + 1, new, axis=0)
        return points, start

    def _across(self, p: FloatArray, way: FloatArray, level: float) -> tuple[FloatArray, AnyArray]:
        """Zeros on the normals through the middles of chords, and which there are near them."""
        middle = p + 0.5 * way
        normal = np.stack([way[:, 1], -way[:, 0]], axis=1)  # out of the solid
        f = self._values(middle, level)
        reach = np.where(f < 0.0, 0.5, -0.5)[:, None]
        far = middle + reach * normal
        good = (self._values(far, level) < 0.0) != (f < 0.0)
        out = middle.copy()
        if good.any():
            out[good] = self._between(middle[good], far[good], level)
        return out, good


def slice_field(
    field: Any, z: ArrayLike | None = None, *, h: float, thickness: float | None = None,
    normal: ArrayLike = (0.0, 0.0, 1.0),
) -> SliceStack:  # fmt: skip
    """Slices of the solid where a field is negative.

    Parameters
    ----------
    field : Node
        The field, with a finite box; with `range`, planes are searched by bounds.
    z : array_like, optional
        Heights along the normal, increasing.
    h : float
        Sides of the squares of the grid in the planes.
    thickness : float, optional
        Of the layers, instead of heights.
    normal : array_like, shape (3,)
        Normal of the planes.

    Returns
    -------
    SliceStack
        Slices, each computed when asked for.

    Raises
    ------
    InputError
        As `Wall.slices`, or if the solid has no end.
    GeometryError
        If the solid is empty.
    """
    as_kind("field", field, "Node")
    frame = as_frame(as_triple("normal", normal))
    slicer = FieldSlicer(field, frame, as_positive("h", h))
    return stacked(field, z, thickness, slicer.ends, frame, slicer)
