"""Where critical points of the distance may be: windows of a grid in which feet pull both ways.

At the nodes of a grid the closest points are known exactly. Feet that are nearest somewhere about a
critical point are nearest at a node of its window, the nodes of a cell and those next to it, but
for feet whose share of the space is thinner than the grid is fine. Where the shortest weighted mean
of their directions is almost zero, Newton's method starts, with the feet that have a weight.

Guarantee: closest points are those of fresh queries. Non-guarantee: shares thinner than a cell.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np

from ilattice._geometry import grid_points
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.topology import _kernels_hull
from ilattice.topology.clearance import Clearance

#: Cells per span of the distance spline.
FINER = 1.5
#: Longest mean at which a window is worth a start, and the least weight of a foot.
PULL, LIGHT = 0.35, 1e-3
#: Cosines of the angles between pulls that may be those of one foot, seen from two nodes.
ALIKE = 0.7, 0.0
#: Nodes next to a cell that belong to its window.
RING = 1
#: Windows that are looked at together.
CHUNK = 1 << 13
#: Points per direction at which the sizes of spans are looked at.
COARSE = 16
#: Feet of an end that are looked at.
MAX_FEET = 4


class Starts(NamedTuple):
    """Starts (n) of Newton's method on one side of the mid-surface.

    In tile coordinates: `p` (n, 3), `feet` (n, 4, 3) of which `number` (n,) are meant, with
    `weights` (n, 4).
    """

    p: FloatArray
    feet: FloatArray
    weights: FloatArray
    number: IntArray
    side: int


class _Table(NamedTuple):
    """Points: feet (n, 3) in tile coordinates, pulls (n, 3) per length, and sides (n,)."""

    foot: FloatArray
    pull: FloatArray
    side: IntArray


class Windows:
    """Grid of closest points of a lattice.

    Parameters
    ----------
    clearance : Clearance
        Distance less half-thickness.

    Attributes
    ----------
    slack : float
        By how much a value may differ from that of the distance spline in the middle of its cell.
    """

    def __init__(self, clearance: Clearance) -> None:
        self.clearance, self.lattice, self.closed = clearance, clearance.lattice, clearance.closed
        self.cells = np.array(self.lattice.repeat) * int(np.ceil(FINER * self.lattice.spans))
        self.shape = tuple((self.cells + ~self.closed).tolist())
        self.spacing = np.ptp(clearance.domain, axis=0) / self.cells
        some = [np.linspace(0.0, n, COARSE) for n in self.cells]
        sizes = clearance.sizes(self._place(grid_points(*some)))
        self.slack = float(np.linalg.norm(sizes * clearance.span, axis=1).max())
        n = int(np.prod(self.shape))
        self.known = np.zeros(n, np.bool_)
        self.table = _Table(np.empty((n, 3)), np.empty((n, 3)), np.zeros(n, np.int64))

    def parts(
        self, on: tuple[int, ...], low: float, high: float, box: FloatArray
    ) -> list[IntArray]:
        """Cells in whose middles the distance spline, less the half-thickness, is in a range.

        Parameters
        ----------
        on : tuple of int
            Those of D (all are 0), or of a face or an edge of it: for each direction -1 or 1 on
            that face of the domain, 0 inside.
        low, high : float
            Range of the values.
        box : ndarray, shape (2, 3)
            Part of the domain that holds the middles.

        Returns
        -------
        list of ndarray, shape (n, 3)
            Cells, in parts that are worked on together.
        """
        ranges = []
        for a in range(3):
            n = int(self.cells[a])
            index = np.arange(n) if on[a] == 0 else np.array([0 if on[a] < 0 else n])
            u = self.clearance.domain[0, a] + self.spacing[a] * (index + 0.5 * (on[a] == 0))
            ranges.append(index[(u >= box[0, a]) & (u <= box[1, a])])
        every = grid_points(*ranges)
        kept = [every[:0]]
        for i in range(0, len(every), CHUNK):
            cells = every[i : i + CHUNK]
            value = self.clearance.on_spline(self._middle(cells, on))[0]
            kept.append(cells[(value >= low) & (value < high)])
        cells = np.concatenate(kept)
        return [cells[i : i + CHUNK] for i in range(0, len(cells), CHUNK)]

    def starts(self, cells: IntArray, on: tuple[int, ...]) -> Iterator[Starts]:
        """Starts from the windows of cells.

        Parameters
        ----------
        cells : ndarray, shape (n, 3)
            Cells.
        on : tuple of int
            Where they are, as for `parts`.

        Yields
        ------
        Starts
            A chunk of them.
        """
        nodes, middle = self._window(cells, on), self._middle(cells, on)
        self._ask(nodes)
        for side in (-1, 1):
            yield _opposed(self.table, nodes, self._to_tile(middle), on, side)

    def starts_about(self, u: FloatArray, on: tuple[int, ...], scale: float) -> Iterator[Starts]:
        """Starts from small windows about points, whole ones and their cells.

        Parameters
        ----------
        u : ndarray, shape (n, 3)
            Parameters of the points.
        on : tuple of int
            Where they are, as for `parts`.
        scale : float
            Size of a cell, in those of the grid.

        Yields
        ------
        Starts
            A chunk of them.
        """
        size = scale * self.spacing
        _, first = np.unique(np.rint(2.0 * u / size), axis=0, return_index=True)
        steps = np.array(list(product(*((-1, 0, 1) if o == 0 else (0,) for o in on))))
        free = np.array(on) == 0
        first_corners = [np.array(c) for c in product(*((-1, 0) if f else (0,) for f in free))]
        cells = [((steps >= c) & (steps <= c + free)).all(axis=1) for c in first_corners]
        for i in range(0, len(first), CHUNK // 8):
            middle = u[np.sort(first)[i : i + CHUNK // 8]]
            nodes = self.clearance.wrapped(middle[:, None] + steps * size)
            table = self._asked(np.clip(nodes, *self.clearance.domain).reshape(-1, 3))
            at = np.arange(len(table.side)).reshape(len(middle), -1)
            for some in [np.ones(len(steps), np.bool_), *cells]:
                for side in (-1, 1):
                    yield _opposed(table, at[:, some], self._to_tile(middle), on, side)

    def _place(self, index: AnyArray) -> FloatArray:
        """Parameters (n, 3) of places of the grid, also between its nodes."""
        lo, hi = self.clearance.domain
        out: FloatArray = np.clip(lo + self.spacing * index, lo, hi)
        return out

    def _middle(self, cells: IntArray, on: tuple[int, ...]) -> FloatArray:
        return self._place(cells + 0.5 * (np.array(on) == 0))

    def _to_tile(self, u: FloatArray) -> FloatArray:
        return self.lattice.search.to_tile(u)

    def _window(self, cells: IntArray, on: tuple[int, ...]) -> IntArray:
        """Nodes (n, m) of cells, and those next to them."""
        flat = np.zeros((len(cells), 1), np.int64)
        for a in range(3):
            steps = np.arange(-RING, 2 + RING) if on[a] == 0 else np.zeros(1, np.int64)
            index = cells[:, a, None] + steps
            n = self.shape[a]
            index = np.mod(index, n) if self.closed[a] else np.clip(index, 0, n - 1)
            flat = (flat[:, :, None] * n + index[:, None, :]).reshape(len(cells), -1)
        return flat

    def _ask(self, nodes: IntArray) -> None:
        """Closest points of nodes that are not known yet."""
        new = np.unique(nodes)
        new = new[~self.known[new]]
        if not len(new):
            return
        u = self._place(np.stack(np.unravel_index(new, self.shape), axis=1))
        for mine, found in zip(self.table, self._asked(u), strict=True):
            mine[new] = found
        self.known[new] = True

    def _asked(self, u: FloatArray) -> _Table:
        """Closest points of parameters (n, 3)."""
        found = self.lattice.closest(u)
        x, jacobian = self.lattice.through.jet(u, 1)
        distance = np.abs(found.distance)
        side = np.where(found.distance < 0.0, -1, 1)
        slope = self.clearance.taken(u, side, 1)[1]
        normal = (x - found.foot) / np.maximum(distance, 1e-300)[:, None]
        pull = np.einsum("nc,nca->na", normal, jacobian) - slope
        pull /= np.linalg.norm(jacobian, axis=1)
        return _Table(self._to_tile(found.u), pull, np.where(distance > 0.0, side, 0))


def _opposed(
    table: _Table, nodes: IntArray, middle: FloatArray, on: tuple[int, ...], side: int
) -> Starts:
    """Starts from those windows (n, m) whose feet, of nodes on one side, pull both ways."""
    mine = table.side[nodes] == side
    some = mine.any(axis=1)
    mine, nodes, middle = mine[some], nodes[some], middle[some]
    ends = np.concatenate([[0], np.cumsum(mine.sum(axis=1))])
    flat = nodes[mine]
    vectors = np.where(np.array(on) == 0, table.pull[flat], 0.0)
    n = len(nodes)
    rows, weights, pull = np.empty((n, MAX_FEET), np.int64), np.empty((n, MAX_FEET)), np.empty(n)
    _kernels_hull.shortest_means(n, ends, vectors, rows, weights, pull)
    good = np.flatnonzero(pull < PULL)
    rows, weights, middle = np.maximum(rows[good], 0), weights[good], middle[good]
    weights[weights < LIGHT] = 0.0
    chosen = flat[rows] if n else rows
    weights, which = _variants(weights, table.pull[chosen], any(on))
    chosen, middle = chosen[which], middle[which]
    heavy = np.argsort(-weights, axis=1, kind="stable")
    weights = np.take_along_axis(weights, heavy, axis=1)
    feet = table.foot[np.take_along_axis(chosen, heavy, axis=1)]
    weights /= weights.sum(axis=1, keepdims=True)
    return Starts(middle, feet, weights, (weights > 0.0).sum(axis=1), side)


def _variants(weights: FloatArray, pull: FloatArray, single: bool) -> tuple[FloatArray, IntArray]:
    """Weights (r, m) of windows (n, m), and others where feet that pull alike may be one foot.

    Also the number of the window of each. A single foot may balance on a face or an edge.
    """
    every, which = [weights], [np.arange(len(weights))]
    for alike in (*ALIKE, -2.0) if single else ALIKE:
        joined = _joined(every[0], pull, alike)
        fewer = (joined > 0.0).sum(axis=1) < (weights > 0.0).sum(axis=1)
        every.append(joined[fewer])
        which.append(np.flatnonzero(fewer))
        weights = joined
    return np.concatenate(every), np.concatenate(which)


def _joined(weights: FloatArray, pull: FloatArray, least: float) -> FloatArray:
    """Weights (n, m) after feet were added to the first one that pulls alike."""
    out = weights.copy()
    pull = pull / np.maximum(np.linalg.norm(pull, axis=2, keepdims=True), 1e-300)
    for i in range(1, out.shape[1]):
        for j in range(i):
            alike = np.einsum("nc,nc->n", pull[:, i], pull[:, j]) > least
            alike &= (out[:, i] > 0.0) & (out[:, j] > 0.0)
            out[alike, j] += out[alike, i]
            out[alike, i] = 0.0
    return out
