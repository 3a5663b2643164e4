"""Quads of a contour that are proved not to cross each other, without comparing them.

Every quad surrounds an edge of the grid. Its envelope are the four tetrahedra of that edge and two
vertices in cells next to each other (Ju and Udeshi, "Intersection-free contouring on an octree
grid", Proc. Pacific Graphics 2006). The line between two vertices in their cells crosses the face
between these. So where each cell holds one vertex, envelopes of different edges overlap nowhere:
in a cell they are cones from its vertex over triangles in its faces that do not overlap. Where a
cell holds two vertices, the cones of either must be on one side of a plane. Two triangles whose
outlines run around the edge the same way, and that cross it, lie in its envelope.

Cells at the faces of the domain have no width: what is said holds for those of any small width,
with vertices between their ends.

Guarantees: no two triangles of quads that are named pass through each other, nor overlap in one
plane; the margins are wider than any rounding. Linear time and memory: 60 bytes per vertex.
Non-guarantee: that all such quads are named, as where three vertices are in one cell, or where
vertices have left their own.
"""

import numpy as np

from ilattice._typing import AnyArray, FloatArray
from ilattice.mesh import _kernels_envelopes as kernels
from ilattice.mesh._tracer import Contour

__all__ = ["enclosed"]


def enclosed(made: Contour, axes: list[FloatArray]) -> AnyArray:
    """Quads of a contour that lie in the envelopes of their edges of the grid.

    Parameters
    ----------
    made : Contour
        With caps, and without closed directions; vertices may have been moved.
    axes : list of ndarray
        Planes of the grid.

    Returns
    -------
    (Q,) array of bool
        Which pairs of triangles 2 q and 2 q + 1 cross none of each other.
    """
    x, count = np.ascontiguousarray(made.vertices, np.float64), len(made.vertices)
    counts = np.array([len(a) - 1 for a in axes])
    planes = np.empty((3, counts.max() + 3))
    for padded, a in zip(planes, axes, strict=True):
        padded[: len(a) + 2] = np.pad(a, 1, mode="edge")
    number = made.faces.dtype
    cell, other = np.empty(count, np.int64), np.empty(count, number)
    table = np.full(1 << max(4, (2 * count - 1).bit_length()), -1, number)
    kernels.locate(x, made.kind, planes, counts, table, cell, other)
    del table
    far, least = np.full(count, -np.inf), np.array([np.diff(a).min() for a in axes])
    if other.max(initial=-1) >= 0:
        sums = np.zeros((count, 4))
        kernels.add_middles(made.faces, cell, other, planes, sums)
        kernels.reach(x, made.faces, cell, other, planes, sums, least, far)
    out = np.zeros(len(made.faces) // 2, np.bool_)
    kernels.enclosed(x, made.faces, cell, other, far, least, planes, out)
    return out
