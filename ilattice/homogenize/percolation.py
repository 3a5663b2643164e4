"""Which pieces of a periodic solid go on for ever, and in which directions.

A piece hangs together through faces, of which some are those of the cell: going around through
these leads to the same piece in another cell. The ways between copies of a piece span nothing (an
island), a line (a rod), a plane (a sheet) or all of space (a network).

Guarantee: found by following faces, not by solving; a piece may go on along no edge of the cell,
but along a diagonal.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ilattice._typing import IntArray
from ilattice._validate import Frozen, read_only


@dataclass(frozen=True, eq=False)
class Percolation(Frozen):
    """Pieces of a periodic solid.

    Attributes
    ----------
    labels : ndarray, shape (n,)
        Piece of each of its elements.
    shifts : ndarray, shape (n, 3)
        Cell, relative to that of the piece, in which an element is when one follows the piece.
    ways : tuple of ndarray, shape (k, 3)
        Per piece the independent ways, in cells, to its copies, k from 0 to 3.
    """

    labels: IntArray
    shifts: IntArray
    ways: tuple[IntArray, ...]

    @property
    def ranks(self) -> IntArray:
        """Dimension of what the copies of each piece span."""
        return np.array([len(w) for w in self.ways], np.int64)

    @property
    def axes(self) -> tuple[bool, bool, bool]:
        """Per edge of the cell, whether a piece gets ahead along it."""
        found = np.concatenate([np.zeros((1, 3), np.int64), *self.ways]) != 0
        a, b, c = (bool(v) for v in found.any(axis=0))
        return a, b, c


def percolation(count: int, low: IntArray, high: IntArray, steps: IntArray) -> Percolation:
    """Pieces of elements that hang together.

    Parameters
    ----------
    count : int
        Number of elements.
    low, high : ndarray, shape (m,)
        Elements on both sides of faces.
    steps : ndarray, shape (m, 3)
        Cells that one goes ahead from low to high.

    Returns
    -------
    Percolation
        Pieces, numbered by their first elements.
    """
    inner = ~steps.any(axis=1)
    pairs = (low[inner], high[inner])
    graph = coo_array((np.ones(len(pairs[0]), np.int8), pairs), shape=(count, count))
    several, piece = connected_components(graph, directed=False)
    seams = np.column_stack([piece[low[~inner]], piece[high[~inner]], steps[~inner]])
    root, shift, ways = _joined(several, np.unique(seams, axis=0))
    _, first, number = np.unique(root[piece], return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first, kind="stable")] = np.arange(len(first))
    labels = rank[number]
    names = root[piece[np.sort(first)]]
    return Percolation(
        read_only(labels), read_only(shift[piece]),
        tuple(read_only(_independent(ways.get(int(n), []))) for n in names),
    )  # fmt: skip


def _joined(count: int, seams: IntArray) -> tuple[IntArray, IntArray, dict[int, list[IntArray]]]:
    """Root and shift of every piece of a cell, and ways around by root."""
    near: dict[int, list[tuple[int, IntArray]]] = {}
    for row in seams:
        low, high, step = int(row[0]), int(row[1]), row[2:]
        near.setdefault(low, []).append((high, step))
        near.setdefault(high, []).append((low, -step))
    root, shift = np.arange(count), np.zeros((count, 3), np.int64)
    ways: dict[int, list[IntArray]] = {}
    seen: set[int] = set()
    for start in near:
        if start in seen:
            continue
        seen.add(start)
        left = [start]
        while left:
            here = left.pop()
            for other, step in near[here]:
                there = shift[here] + step
                if other not in seen:
                    seen.add(other)
                    root[other], shift[other] = start, there
                    left.append(other)
                elif (shift[other] != there).any():
                    ways.setdefault(start, []).append(there - shift[other])
    return root, shift, ways


def _independent(ways: list[IntArray]) -> IntArray:
    """Linearly independent ones of some ways, the shortest first."""
    out = np.zeros((0, 3), np.int64)
    for way in sorted(ways, key=lambda w: (int((w * w).sum()), (-w).tolist())):
        more = np.concatenate([out, way[None]])
        if np.linalg.matrix_rank(more) == len(more):
            out = more
        if len(out) == 3:
            break
    return out
