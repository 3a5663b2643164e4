"""Grids, level sets, cut cells and the rules on them.

========================  ==================================================================
`cut`                     a solid on a background grid: `CutGrid`
`Grid`                    tensor grid of boxes
`quadrature`              rule over a solid: `Quadrature`
`mass_properties`         volume, area, mass, centroid and inertia: `MassProperties`
========================  ==================================================================

Guarantee: nothing here knows of walls; a solid is any `ilattice._typing.Solid`, or level sets.
"""

from ilattice.quadrature.cutting import CutGrid, cut, quadrature
from ilattice.quadrature.grid import Grid
from ilattice.quadrature.measures import MassProperties, mass_properties
from ilattice.quadrature.rules import Quadrature

__all__ = [
    "CutGrid",
    "Grid",
    "MassProperties",
    "Quadrature",
    "cut",
    "mass_properties",
    "quadrature",
]
