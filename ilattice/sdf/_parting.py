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
from ilattice.mesh.contouring import Contour, contour_arrays
from ilattice.mesh.envelopes import enclosed
from ilattice.mesh.measure import self_intersections, triangle_quality
from ilattice.mesh.repair import Repair, remove_slivers

#: Parts of the way back to the means of crossed edges, one after the other.
BACK = (0.5, 0.5, 1.0, 1.0)
#: Quality below which triangles are removed.
SLIVER = 0.005


def parted(
    field: Any, made: Contour, axes: list[FloatArray], *,
    wrap: tuple[bool, bool, bool] = (False,) * 3,
    image: Callable[[FloatArray], FloatArray] | None = None, slivers: float = 0.0,
) -> tuple[FloatArray, IntArray]:  # fmt: skip
    """Vertices and faces of a contour; where triangles cross nearer to the means of crossed edges.

    There no triangles of a contour are known to cross. It happens where parts, or gaps between
    them, are thinner than a cell, so that vertices of two sheets move past each other. Vertices of
    slivers that cannot be removed go back, too.

    Parameters
    ----------
    field : Field
        What was contoured.
    made : Contour
        All vertices of the contour, in the coordinates of the axes, and its faces.
    axes : list of ndarray
        Planes of the grid.
    wrap : tuple of bool
        Directions in which the last plane is the first one.
    image : callable, optional
        Takes vertices to the space in which triangles are not to cross; by default that of the
        axes, where most quads are known not to cross from the grid (`ilattice.mesh.envelopes`).
    slivers : float
        Quality below which triangles are removed, but where that makes others cross.

    Returns
    -------
    vertices : ndarray, shape (V, 3)
        In the coordinates of the axes.
    faces : ndarray, shape (F, 3)
        Their corners.

    Warns
    -----
    PrecisionWarning
        If triangles cross after all.
    """
    active = None if image else np.repeat(~enclosed(made, axes), 2)
    space = image or np.asarray
    pairs, crossing = self_intersections(space(made.vertices), made.faces, active)
    repair = remove_slivers(made.vertices, made.faces, made.kind, quality=slivers)
    if repair.left:
        poor = triangle_quality(made.vertices[repair.vertices], repair.faces) < slivers
        crossing[repair.rows[poor]] = True
    if crossing.any():
        out, pairs = _moved_back(field, made, axes, wrap, space, pairs, crossing)
        repair = remove_slivers(out, made.faces, made.kind, quality=slivers)
    else:
        out = made.vertices
    out, faces, pairs = _without_slivers(out, made, slivers, space, pairs, repair)
    if pairs:
        warnings.warn(
            f"{pairs} pairs of triangles cross, as where parts or gaps are thinner than the "
            "spacing; use a smaller one",
            PrecisionWarning,
            stacklevel=4,
        )
    return out, faces


def _moved_back(
    field: Any, made: Contour, axes: list[FloatArray], wrap: tuple[bool, bool, bool],
    image: Callable[[FloatArray], FloatArray], pairs: int, crossing: AnyArray,
) -> tuple[FloatArray, int]:  # fmt: skip
    """Vertices, of which those of crossing triangles move back; how many pairs cross then."""
    out, faces = made.vertices.copy(), made.faces
    plain = contour_arrays(field, axes, wrap=wrap, place="linear").vertices
    for part in BACK:
        at = np.zeros(len(out), np.bool_)
        at[faces[crossing]] = True
        out[at] = _between(out[at], plain[at], part, axes, np.array(wrap))
        pairs, crossing = self_intersections(image(out), faces, np.asarray(at[faces].any(axis=1)))
        if not pairs:
            break
    return out, pairs


def _without_slivers(
    x: FloatArray, made: Contour, quality: float, image: Callable[[FloatArray], FloatArray],
    before: int, repair: Repair,
) -> tuple[FloatArray, IntArray, int]:  # fmt: skip
    """Vertices, faces and pairs that cross, of which slivers are left where others would cross."""
    spared = np.zeros(len(x), np.bool_)
    while repair.collapses or repair.flips:
        kept, now = x[repair.vertices], repair.vertices[repair.faces]
        new = (now != made.faces[repair.rows]).any(axis=1)
        pairs, crossing = self_intersections(image(kept), repair.faces, None if before else new)
        at = np.unique(now[crossing])
        if pairs <= before or spared[at].all():
            return kept, repair.faces, pairs
        spared[at] = True
        repair = remove_slivers(x, made.faces, made.kind, quality=quality, spared=spared)
    return x, made.faces, before


def _between(
    a: FloatArray, b: FloatArray, part: float, axes: list[FloatArray], wrap: AnyArray
) -> FloatArray:
    """Points part of the way from a to b, the shorter one around closed directions."""
    lo, hi = np.array([(axis[0], axis[-1]) for axis in axes]).T
    way = b - a
    way -= np.where(wrap, (hi - lo) * np.rint(way / (hi - lo)), 0.0)
    return wrapped(a + part * way, lo, hi, wrap)
