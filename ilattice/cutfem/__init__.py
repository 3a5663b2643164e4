"""Immersed analysis: background grids, cut cells, quadrature, splines on them.

`cut` puts a wall on a grid, `quadrature` integrates anything over it::

    rule = il.cutfem.quadrature(wall, q=3)
    volume = rule.integrate()

Guarantee: cells are called in or out by certificates, never by sampling.
"""

from ilattice.cutfem.grid import CutGrid, Grid, cut
from ilattice.cutfem.measures import MassProperties, mass_properties
from ilattice.cutfem.rules import Quadrature, quadrature
from ilattice.cutfem.solvers import Solver, SolveReport, rigid_modes
from ilattice.cutfem.space import SplineSpace

__all__ = [
    "CutGrid",
    "Grid",
    "MassProperties",
    "Quadrature",
    "SolveReport",
    "Solver",
    "SplineSpace",
    "cut",
    "mass_properties",
    "quadrature",
    "rigid_modes",
]
