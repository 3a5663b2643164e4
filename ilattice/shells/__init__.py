"""Shells like triply periodic minimal surfaces, from curves on the faces of an octant of the cell.

::

    shell = il.shells.cell("topo_19_rrr", position=0.1, derivative=1.5)
    wall = il.Lattice(shell.tile, through=part, repeat=(9, 3, 2)).offset(relative_density=0.3)
    model = il.shells.surrogate("topo_19_rrr", samples=200, table="t19.csv")
    model.invert(young=0.06, poisson=0.31, density=0.3)  # parameters, each homogenized

========================  ========================================================================
`cell`, `Shell`           a unit cell: its surface, and a tile of it
`family`, `Family`        shells of one outer boundary, and lattices of them that vary
`boundary`, `Boundary`    closed curves on the octant, with positions and derivatives at nodes
`surface`                 surface over a boundary in the octant, smooth where octants meet
`OctantSurface`           what it returns: area, mean curvature, slopes at mirrors, pieces
`cloud`, `Cloud`          stiffness of many shells, over ranges of their parameters
`space`, `Space`          such ranges
`surrogate`, `Surrogate`  stiffness as a function of parameters, and its inverse
`Solution`                parameters for wanted moduli
`hull_area`               of points in the plane of Young's modulus and Poisson's ratio
`enumerate`, `names`      the 20 classes of boundaries, found and named
`topology`, `Topology`    one of them
`Segment`                 a piece of a boundary on a face
========================  ========================================================================

Guarantees: boundaries do not cross; surfaces are stationary, as smooth across octants as they
report, and have two sides. Non-guarantee: that there is a surface for each boundary, or that it
hangs together: errors and `OctantSurface.bubbles` say so.

Source: Y. Xu, H. Pan, R. Wang, Q. Du, L. Lu, New families of triply periodic minimal surface-like
shell lattices, Additive Manufacturing 2023.
"""

from ilattice.shells.boundary import Boundary, boundary
from ilattice.shells.cell import Shell, cell
from ilattice.shells.family import Family, family
from ilattice.shells.inverse import Solution, Surrogate, surrogate
from ilattice.shells.study import Cloud, Space, cloud, hull_area, space
from ilattice.shells.surface import OctantSurface, surface
from ilattice.shells.topologies import Segment, Topology, names, topology
from ilattice.shells.topologies import enumerated as enumerate

__all__ = [
    "Boundary",
    "Cloud",
    "Family",
    "OctantSurface",
    "Segment",
    "Shell",
    "Solution",
    "Space",
    "Surrogate",
    "Topology",
    "boundary",
    "cell",
    "cloud",
    "enumerate",
    "family",
    "hull_area",
    "names",
    "space",
    "surface",
    "surrogate",
    "topology",
]
