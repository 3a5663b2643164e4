"""Solids from meshes, as fields.

========================  ==================================================================
`MeshDistance`            signed distance to any triangle mesh, negative inside
========================  ==================================================================
"""

from ilattice.sdf.mesh_distance import ClosestPoints, MeshDistance, MeshFaults

__all__ = ["ClosestPoints", "MeshDistance", "MeshFaults"]
