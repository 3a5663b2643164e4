"""Lattices and walls: data of the rooms below, with verbs of one line.

========================  ==================================================================
`Lattice`                 a tile, repeated through a map
`Wall`                    a lattice with a thickness: a solid
`offset`                  wall of Euclidean half-thickness
`parametric_offset`       wall of first order, before the map
`ParametricWall`          what that gives
`ThicknessReport`         how far a mesh is from the asked thickness
========================  ==================================================================
"""

from ilattice.lattice.lattice import Lattice
from ilattice.lattice.wall import ParametricWall, Wall, offset, parametric_offset
from ilattice.mesh.thickness import ThicknessReport

__all__ = [
    "Lattice",
    "ParametricWall",
    "ThicknessReport",
    "Wall",
    "offset",
    "parametric_offset",
]
