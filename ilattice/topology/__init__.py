"""What hangs together, and when that changes: critical points of distances, sweeps, features.

========================  ==================================================================
`Feature`                 thinnest part or narrowest gap of a wall, with its place
========================  ==================================================================

`Wall.topology`, `Wall.minimum_thickness`, `Wall.minimum_gap` and `Lattice.topology_sweep` ask for
what is here.
"""

from ilattice.topology.features import Feature

__all__ = ["Feature"]
