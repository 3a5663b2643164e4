"""Which boxes make up the cells of a grid: pieces of splines, or boxes within cells.

Guarantees: boxes are sorted by cell; what is not listed is outside of the solid.
"""

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import FrozenCopies, read_only
from ilattice.quadrature import _kernels_drive as kernels
from ilattice.quadrature._filling import Listing
from ilattice.quadrature._kernels_scratch import UNIT
from ilattice.quadrature.field_pieces import FieldPieces
from ilattice.quadrature.grid import CUT, IN, OUT, Grid
from ilattice.quadrature.levelsets import Pieces

#: Length of pieces of splines, over that of cells, up to which their points are thinned even where
#: they are not crowded.
SMALL = 0.125
#: Polynomials and tables of boxes that are cut, their row for each box or -1 for full ones, corners
#: and lengths of boxes in parts of the cell, and their cells.
Insides = tuple[FloatArray, IntArray, IntArray, IntArray, IntArray, IntArray]


class Layout(FrozenCopies):
    """The boxes of a grid, for rules and for elements."""

    def __init__(self, grid: Grid, pieces: Any) -> None:
        self.grid, self.pieces = grid, pieces

    @cached_property
    def status(self) -> AnyArray:
        """Sign of the solid in each cell: -1 in, 0 cut, 1 out; shape of the grid, int8."""
        raise NotImplementedError

    @property
    def per_cell(self) -> float:
        """Number of pieces of splines per cell."""
        return 1.0

    def volume(self, cells: IntArray) -> Listing:
        """Boxes of some cells, given increasing."""
        raise NotImplementedError

    def surface(self) -> Listing:
        """Boxes in which there may be zero sets, or on faces of which."""
        raise NotImplementedError

    def end_faces(self, axis: int, side: int) -> Listing:
        """Faces of boxes on one end of the grid."""
        raise NotImplementedError

    def inner_faces(self, axis: int) -> Listing:
        """Faces of boxes between cells."""
        raise NotImplementedError

    def insides(self, cells: IntArray) -> Insides:
        """What `_kernels_elements.boxes_of` needs of some cells, and the cell of each box."""
        raise NotImplementedError

    def single(self, cells: IntArray) -> AnyArray:
        """Cells in which the solid is certainly in one piece, as far as that is cheap to tell."""
        return np.zeros(len(cells), bool)

    def fine(self, u: FloatArray, cells: IntArray) -> FloatArray:
        """Places (n, 3) of points from the corners of cells, in the parts of `insides`."""
        raise NotImplementedError


class TensorLayout(Layout):
    """Pieces of splines, which make up a tensor grid that is finer than that of the cells."""

    pieces: Pieces

    @cached_property
    def _signs(self) -> AnyArray:
        """Signs of the pieces, not read-only: for compiled code."""
        return self.pieces.signs()

    @cached_property
    def owners(self) -> tuple[IntArray, ...]:
        """Per direction, the cell in which each layer of pieces lies."""
        pairs = zip(self.grid.axes, self.pieces.axes, strict=True)
        return tuple(
            read_only(np.searchsorted(coarse, 0.5 * (fine[1:] + fine[:-1])) - 1)
            for coarse, fine in pairs
        )

    @property
    def per_cell(self) -> float:
        """See `Layout.per_cell`."""
        return float(np.prod(self.pieces.shape) / self.grid.count)

    @cached_property
    def status(self) -> AnyArray:
        """See `Layout.status`."""
        low = high = self._signs
        for a, owner in enumerate(self.owners):
            starts = np.searchsorted(owner, np.arange(self.grid.shape[a]))
            low = np.minimum.reduceat(low, starts, axis=a)
            high = np.maximum.reduceat(high, starts, axis=a)
        return read_only(np.where(low == high, low, CUT).astype(np.int8))

    @cached_property
    def _starts(self) -> list[IntArray]:
        """Per direction, the first layer of pieces of each cell, and the number of layers."""
        pairs = zip(self.owners, self.grid.shape, strict=True)
        return [np.searchsorted(owner, np.arange(n + 1)) for owner, n in pairs]

    def single(self, cells: IntArray) -> AnyArray:
        """See `Layout.single`."""
        ijk = np.stack(np.unravel_index(cells, self.grid.shape), axis=1)
        return self.pieces.single(self._signs, self._starts, ijk)

    def volume(self, cells: IntArray) -> Listing:
        """See `Layout.volume`."""
        low, high, owner = self._boxes_of_cells(cells)
        part = self._signs[tuple(low.T)] == 0
        which = np.where(part, np.cumsum(part) - 1, -1)
        boxes = self._boxes(low, high)
        length = (boxes[:, 3:] / self.grid.boxes(owner)[:, 3:]).max(axis=1) - 1e-9
        # larger pieces, of smooth fields, keep what they have
        return Listing(low[part], which, boxes, np.full(len(low), -1), owner, length, SMALL)

    def surface(self) -> Listing:
        """See `Layout.surface`."""
        bounds = self.pieces.bounds()
        inside = True if bounds is None else ~(bounds[..., 1] < 0).all(axis=-1)
        index = np.argwhere((self._signs == 0) | ((self._signs < 0) & inside))  # zero on a face?
        owner = self._cells_of(index)
        order = np.argsort(owner, kind="stable")
        index, owner = index[order], owner[order]
        sides = np.full(len(index), -1)
        return Listing(index, np.arange(len(index)), self._boxes(index, index + 1), sides, owner)

    def end_faces(self, axis: int, side: int) -> Listing:
        """See `Layout.end_faces`."""
        last = self.pieces.shape[axis] - 1
        index = np.argwhere(self._signs.take([side * last], axis) != OUT)
        index[:, axis] = side * last
        return self._faces(index, np.zeros(len(index), bool), axis, side)

    def inner_faces(self, axis: int) -> Listing:
        """See `Layout.inner_faces`."""
        owner = self.owners[axis]
        ends = np.flatnonzero(np.append(np.diff(owner) > 0, self.grid.closed[axis]))
        lower = self._signs.take(ends, axis)
        upper = self._signs.take((ends + 1) % self._signs.shape[axis], axis)
        index = np.argwhere((lower != OUT) & (upper != OUT))
        whole = ((lower == IN) | (upper == IN))[tuple(index.T)]
        index[:, axis] = ends[index[:, axis]]
        return self._faces(index, whole, axis, 1)

    def insides(self, cells: IntArray) -> Insides:
        """See `Layout.insides`."""
        low, high, owner = self._boxes_of_cells(cells)
        part = self._signs[tuple(low.T)] == 0
        corners = [
            np.searchsorted(o, i)
            for o, i in zip(self.owners, np.unravel_index(owner, self.grid.shape), strict=True)
        ]
        start = (low - np.stack(corners, axis=1)) * UNIT
        content = self.pieces.content(low[part])
        which = np.where(part, np.cumsum(part) - 1, -1)
        return content.tensors, content.tables, which, start, (high - low) * UNIT, owner

    def fine(self, u: FloatArray, cells: IntArray) -> FloatArray:
        """See `Layout.fine`."""
        out, at = np.empty(u.shape), np.empty(u.shape, np.int64)
        for a, i in enumerate(np.unravel_index(cells, self.grid.shape)):
            at[:, a] = i
        planes = tuple(np.array(x) for x in self.pieces.axes)
        kernels.places_in_cells(len(u), np.array(u), at, planes, tuple(self._starts), out)
        return out

    def _faces(self, index: IntArray, whole: AnyArray, axis: int, side: int) -> Listing:
        owner = self._cells_of(index)
        order = np.argsort(owner, kind="stable")
        index, owner, part = index[order], owner[order], ~whole[order]
        sides = np.full(len(index), 2 * axis + side)
        which = np.where(part, np.cumsum(part) - 1, -1)
        return Listing(index[part], which, self._boxes(index, index + 1), sides, owner)

    def _cells_of(self, index: IntArray) -> IntArray:
        cells = tuple(owner[i] for owner, i in zip(self.owners, index.T, strict=True))
        return np.ravel_multi_index(cells, self.grid.shape).astype(np.int64)

    def _boxes_of_cells(self, cells: IntArray) -> tuple[IntArray, IntArray, IntArray]:
        """First and last planes (n, 3) of boxes that are not out, and the cell of each."""
        ijk = np.stack(np.unravel_index(cells, self.grid.shape), axis=1)
        mark = np.zeros(self.pieces.shape, np.int8)
        counts = np.zeros(len(cells), np.int64)
        boxes = np.empty((0, 6), np.int64)
        starts0, starts1, starts2 = self._starts
        for _ in range(2):  # count, then list
            offsets = np.append(0, np.cumsum(counts))
            boxes = np.empty((offsets[-1], 6), np.int64)
            kernels.boxes_of_cells(
                len(ijk), self._signs, mark, ijk, starts0, starts1, starts2, offsets, boxes, counts
            )
        return boxes[:, :3], boxes[:, 3:], np.repeat(cells, counts)

    def _boxes(self, low: IntArray, high: IntArray) -> FloatArray:
        """Lower corners and extents (n, 6) of boxes of pieces."""
        out = np.empty((len(low), 6))
        for a, x in enumerate(self.pieces.axes):
            out[:, a] = x[low[:, a]]
            out[:, 3 + a] = x[high[:, a]] - x[low[:, a]]
        return out


class BoxLayout(Layout):
    """Boxes within cells, from halvings."""

    pieces: FieldPieces

    @cached_property
    def status(self) -> AnyArray:
        """See `Layout.status`."""
        p = self.pieces
        out = np.full(self.grid.count, OUT, np.int8)
        out[p.cell] = CUT
        out[p.cell[p.full & (p.length == UNIT)]] = IN
        return read_only(out.reshape(self.grid.shape))

    def volume(self, cells: IntArray) -> Listing:
        """See `Layout.volume`."""
        chosen = np.zeros(self.grid.count, bool)
        chosen[cells] = True
        rows = np.flatnonzero(chosen[self.pieces.cell])
        part = self.pieces.length[rows] / UNIT
        return replace(self._listing(rows, -1), part=part, halved=True)

    def surface(self) -> Listing:
        """See `Layout.surface`."""
        rows = np.flatnonzero(np.diff(self.pieces.first) > 0)
        boxes = self.pieces.geometry(rows)
        sides = np.full(len(rows), -1)
        return Listing(rows, np.arange(len(rows)), boxes, sides, self.pieces.cell[rows])

    def _listing(self, rows: IntArray, face: int) -> Listing:
        part = ~self.pieces.full[rows]
        if face >= 0:  # is a full box full on its face, too?
            part = (np.diff(self.pieces.first) > 0)[rows]
        which = np.where(part, np.cumsum(part) - 1, -1)
        boxes, sides = self.pieces.geometry(rows), np.full(len(rows), face)
        return Listing(rows[part], which, boxes, sides, self.pieces.cell[rows])

    def _beside(self, axis: int, side: int) -> AnyArray:
        """Whether boxes are on one side of their cells."""
        p = self.pieces
        return p.corner[:, axis] + p.length == UNIT if side else p.corner[:, axis] == 0

    def end_faces(self, axis: int, side: int) -> Listing:
        """See `Layout.end_faces`."""
        ijk = np.unravel_index(self.pieces.cell, self.grid.shape)[axis]
        last = side * (self.grid.shape[axis] - 1)
        rows = np.flatnonzero((ijk == last) & self._beside(axis, side))
        return self._listing(rows, 2 * axis + side)

    def inner_faces(self, axis: int) -> Listing:
        """See `Layout.inner_faces`: faces are those of lower cells, unless upper ones are in."""
        upper = np.roll(self.status, -1, axis).copy()
        if not self.grid.closed[axis]:
            np.moveaxis(upper, axis, 0)[-1] = OUT
        upper = upper.ravel()
        lower = self.status.ravel()
        p = self.pieces
        mine = self._beside(axis, 1) & (upper[p.cell] == CUT) & (lower[p.cell] != OUT)
        part = self._listing(np.flatnonzero(mine), 2 * axis + 1)
        whole = np.flatnonzero((upper == IN) & (lower != OUT))
        cells = np.concatenate([part.cells, whole])
        order = np.argsort(cells, kind="stable")
        which = np.concatenate([part.which, np.full(len(whole), -1)])[order]
        rows = part.rows[which[which >= 0]]
        which[which >= 0] = np.arange(len(rows))
        boxes = np.concatenate([part.boxes, self.grid.boxes(whole)])[order]
        return Listing(rows, which, boxes, np.full(len(cells), 2 * axis + 1), cells[order])

    def insides(self, cells: IntArray) -> Insides:
        """See `Layout.insides`."""
        chosen = np.zeros(self.grid.count, bool)
        chosen[cells] = True
        p = self.pieces
        rows = np.flatnonzero(chosen[p.cell])
        part = ~p.full[rows]
        which = np.where(part, np.cumsum(part) - 1, -1)
        content = p.content(rows[part])
        extent = np.repeat(p.length[rows, None], 3, axis=1)
        return content.tensors, content.tables, which, p.corner[rows], extent, p.cell[rows]

    def fine(self, u: FloatArray, cells: IntArray) -> FloatArray:
        """See `Layout.fine`."""
        box = self.grid.boxes(cells)
        return np.asarray(UNIT * (u - box[:, :3]) / box[:, 3:])


def layout_of(grid: Grid, pieces: Any) -> Layout:
    """The boxes of a grid on which level sets have some pieces."""
    kind = BoxLayout if isinstance(pieces, FieldPieces) else TensorLayout
    return kind(grid, pieces)
