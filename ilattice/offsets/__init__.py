"""Thickness: closest points in Euclidean space, the distance spline, offset solids.

========================  ==================================================================
`MidSurface`              the zero set of tiles in space, with closest points on it
`OffsetSolid`             the part of space within a thickness of it: what a wall is
`offset_solid`            one of Euclidean half-thickness
`ClosestPointSearch`      seeds, k-d tree and solver of the closest points
`distance`                signed distance to any field's surface
========================  ==================================================================

`ilattice.lattice` has `Lattice` and `Wall`, with all that can be done with them.
"""

from ilattice.offsets.closest import ClosestPointSearch
from ilattice.offsets.distance import distance
from ilattice.offsets.feet import ClosestPoints, Statistics
from ilattice.offsets.mid_surface import MidSurface
from ilattice.offsets.offsetting import offset_solid
from ilattice.offsets.wall import OffsetSolid

__all__ = [
    "ClosestPointSearch",
    "ClosestPoints",
    "MidSurface",
    "OffsetSolid",
    "Statistics",
    "distance",
    "offset_solid",
]
