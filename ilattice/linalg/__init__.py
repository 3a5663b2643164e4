"""Solvers of sparse symmetric systems: direct, multigrid, conjugate gradients.

========================  ==================================================================
`Solver`                  a matrix that is solved with many times
`SolveReport`             how a solution came about
`rigid_modes`             rigid-body modes at nodes, which multigrid wants of elasticity
========================  ==================================================================

Guarantees: nothing here knows of lattices, grids or physics; the same bits for any number of
threads.
"""

from ilattice.linalg.solvers import Solver, SolveReport, rigid_modes

__all__ = ["SolveReport", "Solver", "rigid_modes"]
