"""Which copies of pieces in other cells are near a cell, as arrays.

Guarantee: where a copy is nearest to a point of the cell, it, or one as near, is among them.
"""

from collections.abc import Sequence
from itertools import permutations

import numpy as np

from ilattice._geometry import CORNERS
from ilattice._memory import need
from ilattice._typing import FloatArray, IntArray
from ilattice.tiles._piece_arrays import PER_PIECE, Pieces

#: Rounding of places, in cells, and cosines between edges that count as perpendicular.
SLACK, SQUARE = 1e-6, 1e-12
#: Rounds in which edges are made shorter.
REDUCED = 50


def copies(
    own: Pieces, cell: FloatArray, repeats: Sequence[bool], top: float
) -> tuple[IntArray, FloatArray]:
    """Copies of pieces, they themselves among them, that are within a distance of the cell.

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
    which : (n,) array
        Pieces.
    by : (n, 3) array
        By what each is moved.

    Raises
    ------
    InputError
        If memory does not suffice.
    """
    first, last = _cells(own, cell, repeats, top)
    sizes = np.maximum(last - first + 1, 0)  # none of what is nowhere near, as beside large balls
    counts = sizes.prod(axis=1)
    total = float(counts.sum(dtype=np.float64))
    need(
        0.25 * PER_PIECE * total,
        f"looking at {total:.3g} copies of pieces",
        "use fewer entities, or a less oblique cell",
    )
    which = np.repeat(np.arange(len(counts)), counts)
    at = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
    factors = np.empty((len(which), 3))
    for axis in (2, 1, 0):
        at, rest = np.divmod(at, sizes[which, axis])
        factors[:, axis] = first[which, axis] + rest
    by = np.einsum("ij,nj->ni", cell, factors)
    corners = CORNERS @ cell.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    boxes = own.boxes[which]
    gap = np.maximum(np.maximum(boxes[:, :3] + by - high, low - boxes[:, 3:6] - by), 0.0)
    near = np.sqrt((gap**2).sum(axis=1)) <= top + boxes[:, 6]
    return which[near], by[near]


def covering_radius(cell: FloatArray) -> float:
    """How far points can be, at most, from the nearest of the places to which a cell repeats one.

    Parameters
    ----------
    cell : (3, 3) array
        Edges of the cell as columns.

    Returns
    -------
    float
        A bound, from edges that are made as short as pairs of them allow.
    """
    edges = cell.T.copy()
    for _ in range(REDUCED):
        before = edges.copy()
        for i, j in permutations(range(3), 2):
            edges[i] -= np.rint(edges[i] @ edges[j] / (edges[j] @ edges[j])) * edges[j]
        if (edges == before).all():
            break
    return 0.5 * float(np.linalg.norm(edges))


def _cells(
    own: Pieces, cell: FloatArray, repeats: Sequence[bool], top: float
) -> tuple[IntArray, IntArray]:
    """First and last cells (n, 3) into which copies may have to be moved."""
    inverse = np.linalg.inv(cell)
    low, high = own.boxes[:, :3], own.boxes[:, 3:6]
    u = np.einsum("ij,nj->ni", inverse, 0.5 * (low + high))
    extent = np.einsum("ij,nj->ni", np.abs(inverse), 0.5 * (high - low))
    edges = cell / np.linalg.norm(cell, axis=0)
    oblique = np.abs(edges.T @ edges - np.eye(3)).max(axis=0) > SQUARE
    # Where an edge is at right angles to the others, a copy that is more than one edge away from a
    # point along it is farther than the next one.
    reach = (top + own.boxes[:, 6:]) * np.linalg.norm(inverse, axis=1)
    reach = extent + SLACK + np.where(oblique, reach, np.minimum(reach, 1.0))
    first = np.where(repeats, np.ceil(-u - reach), 0.0)
    last = np.where(repeats, np.floor(1.0 - u + reach), 0.0)
    return first.astype(np.int64), last.astype(np.int64)
