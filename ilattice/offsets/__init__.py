"""Thickness: closest points in Euclidean space, the distance spline, walls.

`offset` makes a `Wall` of a lattice; `Lattice.offset` is the same as a method.
"""

from ilattice.offsets.closest import ClosestPoints, ClosestPointSearch, Statistics
from ilattice.offsets.wall import ThicknessReport, Wall, offset

__all__ = [
    "ClosestPointSearch",
    "ClosestPoints",
    "Statistics",
    "ThicknessReport",
    "Wall",
    "offset",
]
