"""Shells like triply periodic minimal surfaces, from curves on the faces of an octant of the cell.

::

    shell = il.shells.cell("topo_19_rrr", position=0.1, derivative=1.5)
    wall = il.Lattice(shell.tile, through=part, repeat=(9, 3, 2)).offset(relative_density=0.3)

=======================  ==========================================================================
`cell`, `Shell`          a unit cell: its surface, and a tile of it
`family`, `Family`       shells of one outer boundary, and lattices of them that vary
`boundary`, `Boundary`   closed curves on the octant, with positions and derivatives at nodes
`surface`                surface over a boundary in the octant, smooth where octants meet
`OctantSurface`          what it returns: area, mean curvature, slopes at mirrors, pieces
`enumerate`, `names`     the 20 classes of boundaries, found and named
`topology`, `Topology`   one of them
`Segment`                a piece of a boundary on a face
=======================  ==========================================================================

Guarantees: boundaries do not cross; surfaces are stationary, as smooth across octants as they
report, and have two sides. Non-guarantee: that there is a surface for each boundary, or that it
hangs together: errors and `OctantSurface.bubbles` say so.

Source: Y. Xu, H. Pan, R. Wang, Q. Du, L. Lu, New families of triply periodic minimal surface-like
shell lattices, Additive Manufacturing 2023.
"""

from ilattice.shells.boundary import Boundary, boundary
from ilattice.shells.cell import Shell, cell
from ilattice.shells.family import Family, family
from ilattice.shells.surface import OctantSurface, surface
from ilattice.shells.topologies import Segment, Topology, names, topology
from ilattice.shells.topologies import enumerated as enumerate

__all__ = [
    "Boundary",
    "Family",
    "OctantSurface",
    "Segment",
    "Shell",
    "Topology",
    "boundary",
    "cell",
    "enumerate",
    "family",
    "names",
    "surface",
    "topology",
]
