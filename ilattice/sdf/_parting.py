"""Vertices that are moved back where triangles of a mesh cross.

Guarantee: what crosses after all is told. Non-guarantee: that nothing does.
"""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from ilattice._geometry import wrapped
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.errors import PrecisionWarning
from ilattice.mesh.contouring import contour_arrays
from ilattice.mesh.measure import self_intersections

#: Parts of the way back to the means of crossed edges, one after the other.
BACK = (0.5, 0.5, 1.0, 1.0)


def parted(
    field: Any, vertices: FloatArray, faces: IntArray, rows: IntArray, axes: list[FloatArray], *,
    wrap: tuple[bool, bool, bool] = (False,) * 3,
    image: Callable[[FloatArray], FloatArray] = np.asarray,
) -> FloatArray:  # fmt: skip
    """Vertices of a contour; where triangles cross nearer to the means of crossed edges.

    There no triangles of a contour are known to cross. It happens where parts, or gaps between
    them, are thinner than a cell, so that vertices of two sheets move past each other.

    Parameters
    ----------
    field : Field
        What was contoured.
    vertices, faces : ndarray, shape (V, 3) and (F, 3)
        The mesh, in the coordinates of the axes.
    rows : ndarray, shape (V,)
        Which vertices of the contour they are.
    axes : list of ndarray
        Planes of the grid.
    wrap : tuple of bool
        Directions in which the last plane is the first one.
    image : callable
        Takes vertices to the space in which triangles are not to cross.

    Returns
    -------
    ndarray, shape (V, 3)
        The vertices.

    Warns
    -----
    PrecisionWarning
        If triangles cross after all.
    """
    pairs, crossing = self_intersections(image(vertices), faces)
    if not pairs:
        return vertices
    out = vertices.copy()
    plain = contour_arrays(field, axes, wrap=wrap, place="linear").vertices[rows]
    for part in BACK:
        at = np.unique(faces[crossing])
        out[at] = _between(out[at], plain[at], part, axes, np.array(wrap))
        pairs, crossing = self_intersections(image(out), faces)
        if not pairs:
            return out
    warnings.warn(
        f"{pairs} pairs of triangles cross, as where parts or gaps are thinner than the spacing; "
        "use a smaller one",
        PrecisionWarning,
        stacklevel=4,
    )
    return out


def _between(
    a: FloatArray, b: FloatArray, part: float, axes: list[FloatArray], wrap: AnyArray
) -> FloatArray:
    """Points part of the way from a to b, the shorter one around closed directions."""
    lo, hi = np.array([(axis[0], axis[-1]) for axis in axes]).T
    way = b - a
    way -= np.where(wrap, (hi - lo) * np.rint(way / (hi - lo)), 0.0)
    return wrapped(a + part * way, lo, hi, wrap)
