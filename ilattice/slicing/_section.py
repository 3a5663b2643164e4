"""The triangulation in which a plane cuts the grid, made finer where it would hide contours.

Along an edge with both ends on one side of a surface, a gap or a web may pass between them unseen.
It does if the function would come to the surface by growing, from both ends, as it does there; its
tangents bound a function that is concave, as distances in gaps and webs are. Such edges are halved,
and the triangles beside them with them, which stays conforming because an edge is halved for what
happens along it alone.

Guarantee: the section stays a surface with the same rim. Non-guarantee: that nothing is hidden: an
edge that crosses a whole gap and the web behind it does not show.
"""

from typing import NamedTuple

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.slicing import _kernels_slices as kernels


class Section(NamedTuple):
    """Triangles and their corners, with what is known of the wall there."""

    triangles: IntArray  # (T, 3), counter-clockwise
    u: FloatArray  # (V, 3) parameters
    faces: IntArray  # (V,) faces of the domain as bits
    side: IntArray  # (V,) 0 in the wall, 1 beyond its outer side, -1 beyond its inner one
    beyond: FloatArray  # (V, 2): -S - d_inner, S - d_outer
    slope: FloatArray  # (V, 2, 3) their gradients
    depth: IntArray  # (V,) how often the edge was halved of which it is the middle


def hidden(section: Section, period: FloatArray) -> AnyArray:
    """Which edges (T, 3), from each corner of triangles to the next, may hide a gap or a web.

    Parameters
    ----------
    section : Section
        The section.
    period : ndarray, shape (3,)
        Lengths of the closed directions, 0 for the others.

    Returns
    -------
    ndarray of bool, shape (T, 3)
        True where the tangents at the ends meet beyond a side of the wall.
    """
    out = np.empty(section.triangles.shape, np.bool_)
    at = (section.u, section.side, section.beyond, section.slope)
    kernels.hidden(section.triangles, *at, period, out)
    return out


def edges_of(triangles: IntArray, marked: AnyArray, size: int) -> tuple[IntArray, IntArray]:
    """Marked edges (E, 2) of triangles with `size` corners, lower first; where they are (T, 3).

    There the number of the edge from each corner to the next, and -1 where it is not marked.
    """
    a, b = triangles[marked], np.roll(triangles, -1, axis=1)[marked]
    names, edge = np.unique(np.minimum(a, b) * size + np.maximum(a, b), return_inverse=True)
    out = np.full(triangles.shape, -1)
    out[marked] = edge
    return np.stack([names // size, names % size], axis=1), out


def halved(triangles: IntArray, middle: IntArray) -> IntArray:
    """Triangles with some edges halved, given the `middle` (T, 3) of each edge, or -1."""
    out = np.empty((4 * len(triangles), 3), np.int64)
    count = kernels.halve(triangles, middle, out)
    return out[:count].copy()


def joined(section: Section, new: Section) -> Section:
    """Corners of one section and of another one, with the triangles of the first."""
    pairs = zip(section[1:], new[1:], strict=True)
    return Section._make([section.triangles, *(np.concatenate(pair) for pair in pairs)])
