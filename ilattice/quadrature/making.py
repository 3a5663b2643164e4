"""Rules on the boxes of a grid: of the solid, of the surfaces that bound it, and of faces.

Guarantee: rules are made cell by cell, in increasing order; cells without points are left out.
"""

from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from ilattice._typing import IntArray
from ilattice._validate import among, read_only
from ilattice.errors import InputError
from ilattice.macroshape.maps import SplineMap
from ilattice.quadrature._filling import MAX_POINTS, SURFACE, VOLUME, Listing, filled
from ilattice.quadrature._layouts import Layout
from ilattice.quadrature.grid import CUT, IN
from ilattice.quadrature.rules import NAMES, Quadrature

TANGENT_DEPTH = 3  # how often nearly tangent boxes are halved


class Laid(Protocol):
    """What rules are made for: a solid on a grid."""

    @property
    def layout(self) -> Layout:
        """Which boxes make up the cells."""

    @property
    def through(self) -> SplineMap | None:
        """The map to space, if there is one."""


def volume_rule(grid: Laid, q: int, tangent_depth: int, only: str) -> Quadrature:
    """See `CutGrid.volume`."""
    q, accept = _as_order(q, tangent_depth)
    if not among(only, ("", "in", "cut")):
        raise InputError(f"only must be '', 'in' or 'cut', got {only!r}")
    wanted = {"": (IN, CUT), "in": (IN,), "cut": (CUT,)}[only]
    cells = np.flatnonzero(np.isin(grid.layout.status.ravel(), wanted))
    return _rule(grid, grid.layout.volume(cells), VOLUME, q, accept)


def surface_rule(grid: Laid, q: int, tangent_depth: int) -> Quadrature:
    """See `CutGrid.surface`."""
    q, accept = _as_order(q, tangent_depth)
    return _rule(grid, grid.layout.surface(), SURFACE, q, accept)


def end_face_rule(grid: Laid, name: str, q: int, tangent_depth: int) -> Quadrature:
    """See `CutGrid.face`."""
    q, accept = _as_order(q, tangent_depth)
    if not among(name, NAMES):
        raise InputError(f"name must be one of {NAMES}, got {name!r}")
    axis, side = divmod(NAMES.index(name), 2)
    if grid.layout.grid.closed[axis]:
        raise InputError(f"name={name!r}: the domain is closed in that direction and has no ends")
    return _faces(grid, grid.layout.end_faces(axis, side), axis, side, q, accept)


def inner_face_rule(
    grid: Laid, axis: int, q: int, tangent_depth: int, cells: IntArray | None = None
) -> Quadrature:
    """See `CutGrid.faces`; those of some lower cells alone, if they are given."""
    q, accept = _as_order(q, tangent_depth)
    if not among(axis, (0, 1, 2)):
        raise InputError(f"axis must be 0, 1 or 2, got {axis!r}")
    listing = grid.layout.inner_faces(axis)
    listing = listing if cells is None else _only(listing, cells)
    rule = _faces(grid, listing, axis, 1, q, accept)
    shape = grid.layout.grid.shape
    i = list(np.unravel_index(rule.cells, shape))
    i[axis] = (i[axis] + 1) % shape[axis]
    return replace(rule, neighbours=read_only(np.ravel_multi_index(tuple(i), shape)))


def rule_on(grid: Laid, place: str, cells: IntArray, q: int) -> Quadrature:
    """Rule with q points per direction on some cells, given increasing, that are in or cut.

    Of the ``"volume"``, of the ``"surface"``, or of an end face by name.
    """
    q, accept = _as_order(q, TANGENT_DEPTH)
    if place == "volume":
        return _rule(grid, grid.layout.volume(cells), VOLUME, q, accept)
    if place == "surface":
        return _rule(grid, _only(grid.layout.surface(), cells), SURFACE, q, accept)
    axis, side = divmod(NAMES.index(place), 2)
    return _faces(grid, _only(grid.layout.end_faces(axis, side), cells), axis, side, q, accept)


def _only(listing: Listing, cells: IntArray) -> Listing:
    """Boxes of some cells."""
    keep = np.isin(listing.cells, cells)
    return replace(
        listing, which=listing.which[keep], boxes=listing.boxes[keep],
        sides=listing.sides[keep], cells=listing.cells[keep],
    )  # fmt: skip


def _faces(grid: Laid, listing: Listing, axis: int, side: int, q: int, accept: int) -> Quadrature:
    rule = _rule(grid, listing, VOLUME, q, accept)
    normals = np.zeros((len(rule), 3))
    normals[:, axis] = 2.0 * side - 1.0
    return replace(rule, normals=read_only(normals))


def _as_order(q: Any, tangent_depth: Any) -> tuple[int, int]:
    for name, value, low, high in (
        ("q", q, 1, MAX_POINTS),
        ("tangent_depth", tangent_depth, 0, 9),
    ):
        if isinstance(value, bool) or not np.isscalar(value) or value not in range(low, high + 1):
            raise InputError(f"{name} must be a whole number from {low} to {high}, got {value!r}")
    return int(q), int(tangent_depth)


def _rule(grid: Laid, listing: Listing, want: int, q: int, accept: int) -> Quadrature:
    """Rows and their counts per box as a rule by cell; cells without points are left out."""
    rows, counts = filled(grid.layout.pieces, listing, want, q, accept)
    keep = counts > 0
    listed, first = np.unique(listing.cells[keep], return_index=True)
    ends = np.append(0, np.cumsum(counts[keep]))
    points, weights, normals, sets = (read_only(a) for a in rows.arrays)
    return Quadrature(
        points,
        weights,
        read_only(np.append(ends[first], ends[-1])),
        read_only(listed),
        2 * q - 1,
        grid.layout.grid,
        grid.through,
        normals if rows.wide else None,
        sets if rows.wide else None,
    )
