"""Solids from commands and from meshes, as fields.

========================  ==================================================================
`parse`                   field of a command such as ``"box gyroid shell 0.3"``
`mesh`                    watertight mesh of a field, by spacing or tolerance
`run`                     a command with options, as the command line does it
`plan`, `Plan`            box, grid and cost of a mesh
`Command`                 a command with its options, to be carried out with several values
`MeshDistance`            signed distance to any triangle mesh, negative inside
========================  ==================================================================
"""

from ilattice.sdf.job import run
from ilattice.sdf.language import Command, parse
from ilattice.sdf.mesh_distance import ClosestPoints, MeshDistance, MeshFaults
from ilattice.sdf.meshing import Plan, mesh, plan

__all__ = [
    "ClosestPoints", "Command", "MeshDistance", "MeshFaults", "Plan", "mesh", "parse", "plan",
    "run",
]  # fmt: skip
