"""Copies of pieces in other cells, and a tree of boxes over pieces, as compiled code takes them.

Guarantee: every box of the tree holds the pieces below it, with their radii.
"""

from collections.abc import Sequence
from itertools import product

import numpy as np

from ilattice._typing import FloatArray, IntArray
from ilattice.tiles._kernels_skeleton import CURVE, SURFACE, Tree
from ilattice.tiles._pieces import Pieces

#: Most pieces of a leaf.
LEAF = 2


def images(
    own: Pieces, cell: FloatArray, repeats: Sequence[bool], top: float
) -> tuple[IntArray, FloatArray]:
    """Which pieces, and which copies of them in other cells, are within a distance of this one.

    Parameters
    ----------
    own : Pieces
        Pieces of one cell, which may leave it.
    cell : (3, 3) array
        Edges of the cell as columns.
    repeats : sequence of bool
        Edges along which they repeat.
    top : float
        Pieces that are farther from the cell, less their radius, are left out.

    Returns
    -------
    rows : (n,) array
        Pieces: first those that stay where they are.
    by : (n, 3) array
        By what each is moved.
    """
    unit = np.array(list(product((0.0, 1.0), repeat=3)))
    corners = unit @ cell.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    first, last = own.boxes[:, :3].T.copy(), own.boxes[:, 3:6].T.copy()
    ends = own.boxes[:, None, :3] + unit * (own.boxes[:, None, 3:6] - own.boxes[:, None, :3])
    u = ends.reshape(-1, 3) @ np.linalg.inv(cell).T
    beyond = np.ceil(np.maximum(u.max(axis=0) - 1.0, -u.min(axis=0)) - 1e-6)
    reach = np.where(repeats, 1 + np.maximum(beyond, 0.0), 0).astype(int)
    most = (top + own.boxes[:, 6]) ** 2
    squares: dict[tuple[int, float], FloatArray] = {}  # of gaps along an axis after a shift
    rows, by = [], []
    for factors in sorted(product(*(range(-n, n + 1) for n in reach)), key=any):
        shift = cell @ np.array(factors, np.float64)
        for a, s in enumerate(shift):
            if (a, s) not in squares:
                gap = np.maximum(first[a] + s - high[a], low[a] - s - last[a])
                squares[a, s] = np.maximum(gap, 0.0) ** 2
        near = np.flatnonzero(sum(squares[a, s] for a, s in enumerate(shift)) <= most)
        rows.append(near)
        by.append(np.broadcast_to(shift, (len(near), 3)))
    return np.concatenate(rows), np.concatenate(by)


def tree_of(pieces: Pieces, rows: IntArray | None = None, by: FloatArray | None = None) -> Tree:
    """Tree over pieces, halved at the median along the longest side.

    Parameters
    ----------
    pieces : Pieces
        At least one.
    rows : (n,) array, optional
        Which of them, some perhaps several times; by default each once.
    by : (n, 3) array, optional
        By what each is moved.

    Returns
    -------
    Tree
        The arrays.
    """
    rows = np.arange(len(pieces.rows)) if rows is None else rows
    boxes = pieces.boxes[rows]
    if by is not None:
        boxes[:, :3] += by
        boxes[:, 3:6] += by
    order, node, box = _halved(boxes)
    chosen = pieces.chosen(rows[order], None if by is None else by[order])
    kinds = chosen.rows
    bezier = kinds[(kinds[:, 0] == CURVE) | (kinds[:, 0] == SURFACE), 3:5] + 1
    width = int(bezier.prod(axis=1).max(initial=1))
    return Tree(node, box, kinds, chosen.boxes, chosen.data, 1 + int(kinds[:, 1].max()), width)


def _halved(boxes: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Order of the boxes, nodes and their boxes; all nodes of a level are made at once."""
    middle = boxes[:, :3] + boxes[:, 3:6]
    order = np.arange(len(boxes))
    starts, sizes = np.zeros(1, np.int64), np.array([len(boxes)])
    levels: list[IntArray] = []
    count = 0
    while len(starts):
        count += len(starts)
        big = sizes > LEAF
        node = np.stack([-1 - starts, sizes], axis=1)
        node[big, 0] = count + 2 * np.arange(int(big.sum()))
        node[big, 1] = node[big, 0] + 1
        levels.append(node)
        starts, sizes = starts[big], sizes[big]
        _sort(order, middle, starts, sizes)
        half = sizes // 2
        starts = np.stack([starts, starts + half], axis=1).ravel()
        sizes = np.stack([half, sizes - half], axis=1).ravel()
    return order, np.concatenate(levels), _bounds(boxes[order], levels)


def _sort(order: IntArray, middle: FloatArray, starts: IntArray, sizes: IntArray) -> None:
    """Sort parts of an order along their longest sides; sizes differ by one at most."""
    if not len(starts):
        return
    first = np.cumsum(sizes) - sizes
    owner = np.repeat(np.arange(len(starts)), sizes)
    at = np.arange(len(owner)) + (starts - first)[owner]
    rows = order[at]
    centre = middle[rows]
    spread = np.maximum.reduceat(centre, first) - np.minimum.reduceat(centre, first)
    used = np.arange(int(sizes.max())) < sizes[:, None]
    table = np.full(used.shape, np.inf)
    table[used] = centre[np.arange(len(at)), spread.argmax(axis=1)[owner]]
    order[at] = rows[np.argsort(table, axis=1, kind="stable")[used] + first[owner]]


def _bounds(boxes: FloatArray, levels: list[IntArray]) -> FloatArray:
    """Boxes of nodes: of leaves from what they hold, of others from their children."""
    node = np.concatenate(levels)
    out = np.empty((len(node), boxes.shape[1]))
    leaves = np.flatnonzero(node[:, 0] < 0)
    leaves = leaves[np.argsort(-1 - node[leaves, 0])]
    first = -1 - node[leaves, 0]
    out[leaves, :3] = np.minimum.reduceat(boxes[:, :3], first)
    out[leaves, 3:] = np.maximum.reduceat(boxes[:, 3:], first)
    ends = np.cumsum([len(level) for level in levels])
    for level, end in zip(levels[::-1], ends[::-1], strict=True):
        inner = np.flatnonzero(level[:, 0] >= 0)
        one, two = out[level[inner, 0]], out[level[inner, 1]]
        rows = inner + end - len(level)
        out[rows, :3] = np.minimum(one[:, :3], two[:, :3])
        out[rows, 3:] = np.maximum(one[:, 3:], two[:, 3:])
    return out
