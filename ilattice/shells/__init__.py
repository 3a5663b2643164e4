"""Shells like triply periodic minimal surfaces, from curves on the faces of an octant of the cell.

=======================  ==========================================================================
`enumerate`, `names`     the 20 classes of boundaries, found and named
`topology`, `Topology`   one of them
`Segment`                a piece of a boundary on a face
=======================  ==========================================================================

Source: Y. Xu, H. Pan, R. Wang, Q. Du, L. Lu, New families of triply periodic minimal surface-like
shell lattices, Additive Manufacturing 2023.
"""

from ilattice.shells.topologies import Segment, Topology, names, topology
from ilattice.shells.topologies import enumerated as enumerate

__all__ = ["Segment", "Topology", "enumerate", "names", "topology"]
