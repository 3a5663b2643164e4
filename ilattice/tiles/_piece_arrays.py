"""Pieces that compiled code measures distances to, as arrays: straight ones, plates, copies, trees.

Guarantees: no object per piece or copy; every box of a tree holds the pieces below it, and its
largest radius is that of those. A tree takes at most `PER_PIECE` bytes per straight piece while it
is built, and half of that afterwards; curves and surfaces take that of their numbers besides.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ilattice._memory import need
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.fields import _kernels_boxes as boxes_kernels
from ilattice.tiles._kernels_skeleton import (
    ARC,
    BALL,
    CURVE,
    KINDS,
    POLYGON,
    SEGMENT,
    SURFACE,
    TRIANGLE,
    Tree,
)

#: Bytes that a piece takes while a tree is built over it.
PER_PIECE = 1000.0
#: Where coordinates begin among the numbers of a piece.
FIRST = {SEGMENT: 2, ARC: 3, POLYGON: 11, TRIANGLE: 10, BALL: 1}
#: Groups of pieces: one for all, or one each.
Groups = int | IntArray
#: Whether directions (n, 3) leave the cell at points (n, 3).
Outward = Callable[[FloatArray, FloatArray], AnyArray]


@dataclass(frozen=True, eq=False)
class Pieces:
    """Many pieces.

    Attributes
    ----------
    rows : (n, 6) array
        Kind, group, first of its numbers, degrees, plain: as the kernels take them.
    boxes : (n, 7) array
        Lower corner, upper corner, largest radius.
    data : (m,) array
        Numbers of all pieces, one after the other.
    least : float
        A lower bound of all radii.
    """

    rows: IntArray
    boxes: FloatArray
    data: FloatArray
    least: float

    @classmethod
    def of(cls, parts: "Sequence[Pieces]") -> "Pieces":
        """Join pieces in their order."""
        counts = np.cumsum([0] + [len(p.data) for p in parts])
        rows = [p.rows + n * (np.arange(6) == 2) for p, n in zip(parts, counts, strict=False)]
        boxes, data = (np.concatenate([getattr(p, k) for p in parts]) for k in ("boxes", "data"))
        return cls(np.concatenate(rows), boxes, data, min(p.least for p in parts))

    def tree(self, which: IntArray | None = None, by: FloatArray | None = None) -> Tree:
        """Tree over pieces.

        Parameters
        ----------
        which : (n,) array, optional
            Some of them, perhaps several times; by default each once.
        by : (n, 3) array, optional
            By what each is moved.

        Returns
        -------
        Tree
            The arrays.

        Raises
        ------
        InputError
            If memory does not suffice.
        """
        which = np.arange(len(self.rows)) if which is None else which
        by = np.zeros((len(which), 3)) if by is None else by
        n = len(which)
        need(PER_PIECE * n, f"a skeleton of {n} pieces, copies included", "use fewer entities")
        lo, hi = self.boxes[which, :3] + by, self.boxes[which, 3:6] + by
        order, box, link = np.arange(n), np.empty((2 * n, 6)), np.empty((2 * n, 3), np.int64)
        costly = np.isin(self.rows[:, 0], (CURVE, SURFACE)).any()
        most = 1 if costly else boxes_kernels.LEAF
        count = boxes_kernels.build(lo, hi, order, box, link, most)
        link, which, by = link[:count].copy(), which[order], by[order]
        radius = self.boxes[which, 6]
        piece_box = np.column_stack([lo[order], hi[order], radius])
        greatest = np.empty(count)
        boxes_kernels.greatest(link, radius, greatest)
        rows, data = self._moved(which, by)
        bezier = rows[(rows[:, 0] == CURVE) | (rows[:, 0] == SURFACE), 3:5] + 1
        width = int(bezier.prod(axis=1).max(initial=1))
        box = np.column_stack([box[:count], greatest])
        groups, turns = 1 + int(rows[:, 1].max()), 1 + int((rows[:, 0] == SURFACE).any())
        return Tree(link, box, rows, piece_box, data, groups, width, turns)

    def _moved(self, which: IntArray, by: FloatArray) -> tuple[IntArray, FloatArray]:
        """Rows and numbers of some pieces, each translated by a row of `by`."""
        sizes = np.diff(np.append(self.rows[:, 2], len(self.data)))[which]
        rows, first = self.rows[which], self.rows[which, 2]
        rows[:, 2] = np.cumsum(sizes) - sizes
        data = np.empty(int(sizes.sum()))
        sorts = rows[:, 0] + KINDS * sizes
        for sort in np.unique(sorts):
            at = np.flatnonzero(sorts == sort)
            column = np.arange(sizes[at[0]])
            block = self.data[first[at, None] + column]
            _move(block, int(rows[at[0], 0]), by[at])
            data[rows[at, 2:3] + column] = block
        return rows, data


def _move(block: FloatArray, kind: int, by: FloatArray) -> None:
    """Translate pieces of a kind, the numbers of which are rows of a block."""
    if kind in (CURVE, SURFACE):
        h = block.reshape(len(block), -1, 5)
        h[:, :, :3] += h[:, :, 4:] * by[:, None]
        return
    last = 6 if kind == ARC else block.shape[1]
    for first in range(FIRST[kind], last, 3):
        block[:, first : first + 3] += by


def alike(
    kind: int, group: Groups, data: FloatArray, points: FloatArray, radii: FloatArray,
    degree: tuple[int, int] = (0, 0), plain: Any = True,
) -> Pieces:  # fmt: skip
    """Pieces of one kind with as many numbers each.

    Parameters
    ----------
    kind : int
        Which.
    group : int or (n,) array
        Their groups in the smooth union.
    data : (n, m) array
        Their numbers.
    points : (n, k, 3) array
        Points whose box holds a piece.
    radii : (n, l) array
        Numbers between which its radii are.
    degree : (int, int)
        Degrees, or the number of corners.
    plain : bool or (n,) array
        Whether weights and radius are constant.

    Returns
    -------
    Pieces
        The arrays.
    """
    n, width = data.shape
    rows = np.empty((n, 6), np.int64)
    rows[:, 0], rows[:, 1], rows[:, 2] = kind, group, width * np.arange(n)
    rows[:, 3:5], rows[:, 5] = degree, plain
    boxes = np.column_stack([points.min(axis=1), points.max(axis=1), radii.max(axis=1)])
    return Pieces(rows, boxes, data.ravel(), float(radii.min(initial=np.inf)))


def segments(group: Groups, ends: FloatArray, radii: FloatArray) -> Pieces:
    """Straight pieces between ends (n, 2, 3) with linear radii (n, 2)."""
    return alike(SEGMENT, group, np.hstack([radii, ends.reshape(-1, 6)]), ends, radii)


def continued(
    group: Groups, p: FloatArray, direction: FloatArray, r: Any, outward: Outward, far: float
) -> Pieces:
    """Straight continuations of ends (n, 3) that are on an open face."""
    d = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    out = outward(p, d)
    group, r = (np.broadcast_to(a, len(p))[out] for a in (group, r))
    ends = np.stack([p[out], p[out] + far * d[out]], axis=1)
    return segments(group, ends, np.stack([r, r], axis=1))


def polygons(group: Groups, corners: FloatArray, radius: FloatArray) -> Pieces:
    """Plane polygons with corners (n, m, 3) and radii (n,)."""
    n, m, _ = corners.shape
    middle = corners.mean(axis=1, keepdims=True)
    axes = np.linalg.svd(corners - middle, full_matrices=False)[2]
    e1, e2 = axes[:, 0], axes[:, 1]
    r = radius[:, None]
    data = np.hstack([r, r, np.cross(e1, e2), e1, e2, corners.reshape(n, 3 * m)])
    return alike(POLYGON, group, data, corners, r, (m, 0))
