"""Homogenization: effective properties of cells that repeat.

::

    cell = il.Lattice("gyroid", through=il.macroshape.cell(), repeat=1).offset(relative_density=0.3)
    eff = il.homogenize.elastic(cell, cells=16, young=1.0, poisson=0.3)
    print(eff.C, eff.E((1, 1, 0)), eff.error, eff.bounds)

=====================  ============================================================================
`bloch`                waves on cut cells: bands of frequencies, gaps, group velocities
`bloch_voxels`         waves in arrays of voxels
`sweep`                stiffness of many cells: tables that go on where they stopped, fits
`elastic`              stiffness of any solid on cut cells: the reference, and the default
`ElasticCell`          the same cell under mean stresses: stresses inside, first yield
`conductive`           conductivity, likewise
`macro`                the macro-shape of a lattice as a solid with the stiffness of its tiles
`voxels`               stiffness of an array of voxels: tomograms, labels, fill fractions
`conductive_voxels`    conductivity, likewise
`read_voxels`          arrays of voxels from files
=====================  ============================================================================

Guarantees: effective properties come with an estimate of their errors, bounds, and a warning where
nothing is borne. What stands on cut cells comes from above, as energies of admissible fields do.
"""

from ilattice.homogenize._result import HomogenizationReport
from ilattice.homogenize.bands import Bands, BlochMode, BlochReport, Gap
from ilattice.homogenize.bloch import bloch
from ilattice.homogenize.bloch_voxel import bloch_voxels
from ilattice.homogenize.bounds import Bounds, ConductivityBounds
from ilattice.homogenize.conductive import ConductiveCell, conductive
from ilattice.homogenize.conductivity import Conductivity
from ilattice.homogenize.effective import Effective
from ilattice.homogenize.elastic import ElasticCell, elastic
from ilattice.homogenize.images import read_voxels
from ilattice.homogenize.local import LocalFields
from ilattice.homogenize.macro import macro
from ilattice.homogenize.rows import Fit, Rows
from ilattice.homogenize.sweep import sweep
from ilattice.homogenize.voxel import conductive_voxels, voxels
from ilattice.homogenize.waves import BlochCell

__all__ = [
    "Bands",
    "BlochCell",
    "BlochMode",
    "BlochReport",
    "Bounds",
    "ConductiveCell",
    "Conductivity",
    "ConductivityBounds",
    "Effective",
    "ElasticCell",
    "Fit",
    "Gap",
    "HomogenizationReport",
    "LocalFields",
    "Rows",
    "bloch",
    "bloch_voxels",
    "conductive",
    "conductive_voxels",
    "elastic",
    "macro",
    "read_voxels",
    "sweep",
    "voxels",
]
