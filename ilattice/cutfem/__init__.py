"""Immersed analysis: background grids, cut cells, quadrature, elasticity on them.

`cut` puts a wall on a grid, `quadrature` integrates anything over it::

    rule = il.cutfem.quadrature(wall, q=3)
    volume = rule.integrate()

and `Elasticity` solves on the solid itself, without a mesh of it::

    problem = il.cutfem.Elasticity(wall, cells=(128, 16, 16), young=1.0, poisson=0.3)
    solution = problem.clamp("w=0").load(body=(1e-3, 0, 0)).solve()
    solution.plot()
    solution.save("part.vtu", on="solid")
    il.cutfem.natural_modes(problem.clamp("w=0")).save("modes.pvd")

Which functions: by default splines of degree 2 with a continuous first derivative, the most
accurate per unknown where a wall or a strut is two cells thick or more, and for stresses; of degree
1 on more than 50,000 cells of the solid (80,000 of walls between two surfaces), and from 8,000 on
for struts of two cells or more in cells that are not stretched, where that takes as much time to
the same error of the compliance, or a fraction (``solution.report.splines`` tells which, and why).
Where walls are thinner, and a `PrecisionWarning` says so, smooth splines cannot bend at joints
within a cell: then ``smoothness=0`` on the same cells, at four to six times as many unknowns, is at
least as accurate as degree 1 on twice the cells per direction, which has about as many unknowns and
is solved in a fraction of the time.

Guarantee: cells are called in or out by certificates, never by sampling.
"""

from ilattice.cutfem.anisotropic import Graded, orthotropic
from ilattice.cutfem.elasticity import Elasticity, Recovered, Solution
from ilattice.cutfem.estimate import ErrorEstimate
from ilattice.cutfem.heat import Heat, HeatHistory, HeatSolution, RecoveredHeat
from ilattice.cutfem.law import Law
from ilattice.cutfem.modal import Buckling, EigenReport, Mode, Modes, buckling, natural_modes
from ilattice.cutfem.physics import FieldSolution, Physics, RecoveredField
from ilattice.cutfem.probe import Probe
from ilattice.cutfem.refinement import RefinementStudy, refinement_study
from ilattice.cutfem.space import SplineSpace
from ilattice.linalg.solvers import Solver, SolveReport, rigid_modes
from ilattice.quadrature.cutting import CutGrid, cut, quadrature
from ilattice.quadrature.grid import Grid
from ilattice.quadrature.measures import MassProperties, mass_properties
from ilattice.quadrature.rules import Quadrature

__all__ = [
    "Buckling",
    "CutGrid",
    "EigenReport",
    "Elasticity",
    "ErrorEstimate",
    "FieldSolution",
    "Graded",
    "Grid",
    "Heat",
    "HeatHistory",
    "HeatSolution",
    "Law",
    "MassProperties",
    "Mode",
    "Modes",
    "Physics",
    "Probe",
    "Quadrature",
    "Recovered",
    "RecoveredField",
    "RecoveredHeat",
    "RefinementStudy",
    "Solution",
    "SolveReport",
    "Solver",
    "SplineSpace",
    "buckling",
    "cut",
    "mass_properties",
    "natural_modes",
    "orthotropic",
    "quadrature",
    "refinement_study",
    "rigid_modes",
]
