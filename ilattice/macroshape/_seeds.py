"""Sample points of a volume with rigorous boxes around the image of their cells.

Guarantee: a point of the image lies in the box of at least one cell, so that `Seeds.candidates`
names a cell of every branch that passes through it.
"""

from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from ilattice._geometry import grid_indices, grid_points
from ilattice._typing import FloatArray, IntArray
from ilattice.bspline import BSpline

#: Seeds of one map at most, unless its elements alone are more.
_MAX_SEEDS = 200_000
#: How far below its upper end a smooth piece is left, where the next one has other tangents, as a
#: part of the domain.
BELOW = 1e-15
#: Points whose candidates are gathered at once.
CHUNK = 1024


class Seeds:
    """Sample points of a volume with a k-d tree, made once per map.

    Parameters
    ----------
    spline : BSpline
        Volume with three components.
    closed : tuple of bool
        Directions in which parameters wrap around.
    size : float
        Length that tolerances refer to.
    """

    def __init__(self, spline: BSpline, closed: tuple[bool, bool, bool], size: float) -> None:
        self.spline, self.size = spline, size
        self.closed = np.array(closed)
        self.domain = np.asarray(spline.domain)
        edges = [_cells(spline, axis, fine=True) for axis in range(3)]
        if np.prod([len(e) - 1 for e in edges]) > _MAX_SEEDS:
            edges = [_cells(spline, axis, fine=False) for axis in range(3)]
        self.shape = np.array([len(e) - 1 for e in edges])
        index = grid_indices(self.shape.tolist()).T
        self.first = np.stack([e[:-1][i] for e, i in zip(edges, index, strict=True)], axis=1)
        self.last = np.stack([e[1:][i] for e, i in zip(edges, index, strict=True)], axis=1)
        self.index: IntArray = np.ascontiguousarray(index.T)
        self.u = 0.5 * (self.first + self.last)
        self.x = spline(self.u)

    @cached_property
    def _pieces(self) -> list[FloatArray]:
        """Ends of smooth pieces along each direction."""
        ends = self.domain.T
        return [np.unique(np.append(bends(self.spline, a), ends[a])) for a in range(3)]

    @property
    def kinked(self) -> bool:
        """Whether there is more than one smooth piece, or one whose ends meet."""
        return any(len(p) > 2 for p in self._pieces) or bool(self.closed.any())

    @cached_property
    def piece(self) -> IntArray:
        """Number of the smooth piece of each seed, shape (N,)."""
        at = [np.searchsorted(p, self.u[:, a]) - 1 for a, p in enumerate(self._pieces)]
        return np.ravel_multi_index(at, [len(p) - 1 for p in self._pieces])

    @cached_property
    def room(self) -> FloatArray:
        """Corners of smooth pieces, shape (2, pieces, 3), upper ones just before the next piece."""
        lo = grid_points(*(p[:-1] for p in self._pieces))
        hi = grid_points(*(p[1:] for p in self._pieces))
        hi = np.where(hi < self.domain[1], hi - BELOW * (self.domain[1] - self.domain[0]), hi)
        return np.stack([lo, hi])

    @cached_property
    def tree(self) -> KDTree:
        """Tree of the sample points."""
        return KDTree(self.x)

    @cached_property
    def boxes(self) -> FloatArray:
        """Bounds of the image of each cell, shape (N, 3, 2)."""
        s = self.spline
        parts = [
            BSpline(s.t, s.c[..., c], s.k, periodic=s.periodic, weights=s.weights) for c in range(3)
        ]
        return np.stack([p.range(self.first, self.last) for p in parts], axis=1)

    @cached_property
    def reach(self) -> FloatArray:
        """Distance of each seed to the farthest corner of its box, shape (N,)."""
        return np.sqrt((np.abs(self.boxes - self.x[..., None]).max(axis=2) ** 2).sum(axis=1))

    @cached_property
    def _levels(self) -> list[tuple[IntArray, KDTree, float]]:
        """Seeds of like reach, a factor of two apart, each with a tree and the largest reach."""
        level = np.floor(np.log2(np.maximum(self.reach, 1e-12 * self.size)))
        groups = [np.flatnonzero(level == v) for v in np.unique(level)]
        return [(g, KDTree(self.x[g]), float(self.reach[g].max())) for g in groups]

    def candidates(self, x: FloatArray, slack: float) -> tuple[IntArray, IntArray]:
        """Pairs of point and cell whose box, widened by `slack`, holds the point.

        Sorted by point, then by distance to the seed in terms of its reach.
        """
        rows, cells = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
        for first in range(0, len(x), CHUNK):
            part = x[first : first + CHUNK]
            for group, tree, radius in self._levels:
                found: Any = tree.query_ball_point(part, radius + 2 * slack)
                counts = np.array([len(f) for f in found], dtype=np.int64)
                row = np.repeat(np.arange(len(part)), counts)
                cell = group[np.concatenate([np.array(f, dtype=np.int64) for f in found])]
                box = self.boxes[cell]
                inside = (part[row] >= box[..., 0] - slack) & (part[row] <= box[..., 1] + slack)
                rows.append(first + row[inside.all(axis=1)])
                cells.append(cell[inside.all(axis=1)])
        i, j = np.concatenate(rows), np.concatenate(cells)
        order = np.lexsort((np.linalg.norm(x[i] - self.x[j], axis=1) / self.reach[j], i))
        return i[order], j[order]

    def apart(self, i: IntArray, j: IntArray) -> IntArray:
        """Distance of seeds in cells, the largest over the directions."""
        gap = np.abs(self.index[i] - self.index[j])
        gap = np.where(self.closed, np.minimum(gap, self.shape - gap), gap)
        return gap.max(axis=-1)


def bends(spline: BSpline, axis: int) -> FloatArray:
    """Inner knots of one parameter that repeat as often as the degree says, or more often."""
    lo, hi = spline.domain[:, axis]
    knots, counts = np.unique(spline.t[axis], return_counts=True)
    out: FloatArray = knots[(counts >= spline.k[axis]) & (knots > lo) & (knots < hi)]
    return out


def _cells(spline: BSpline, axis: int, *, fine: bool) -> FloatArray:
    """Cell edges of the seeds: each element divided a few times."""
    b = spline.breaks(axis)
    parts = max(2 * spline.k[axis], -(-6 // (len(b) - 1))) if fine else 1
    inner = b[:-1, None] + np.diff(b)[:, None] * (np.arange(parts) / parts)
    return np.append(inner.ravel(), b[-1])
