"""Thickness: closest points in Euclidean space, the distance spline, walls.

`offset` makes a `Wall` of a lattice, `parametric_offset` one of first order before the map;
`Lattice.offset` is both as a method. `distance` is the signed distance to any field's surface.
"""

from ilattice.offsets.closest import ClosestPoints, ClosestPointSearch, Statistics
from ilattice.offsets.distance import distance
from ilattice.offsets.first_order import ParametricWall, parametric_offset
from ilattice.offsets.wall import ThicknessReport, Wall, offset
from ilattice.topology.features import Feature

__all__ = [
    "ClosestPointSearch",
    "ClosestPoints",
    "Feature",
    "ParametricWall",
    "Statistics",
    "ThicknessReport",
    "Wall",
    "distance",
    "offset",
    "parametric_offset",
]
