"""What hangs together, and when that changes: critical points of distances, sweeps, features.

========================  ==================================================================
`critical_points`         where level sets of the distance change their topology
`CriticalPoint`           one of them
`Feature`                 thinnest part or narrowest gap of a wall, with its place
`TopologyReport`          parts, handles, voids and necks of a solid
`TopologySweep`           how these depend on the half-thickness
========================  ==================================================================
"""

from ilattice.topology.critical import CriticalPoint, critical_points
from ilattice.topology.features import Feature

__all__ = ["CriticalPoint", "Feature", "critical_points"]
