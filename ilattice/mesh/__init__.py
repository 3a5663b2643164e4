"""Triangle meshes: contouring, `SurfaceMesh` and its measures.

========================  ==================================================================
`SurfaceMesh`             vertices, faces, named data; what `ilattice.io` writes
`load`                    a `SurfaceMesh` from an STL, PLY, OBJ or OFF file
`SolidMesh`               tetrahedra or hexahedra with named regions, for other programs
`hexahedra`               cells of a background grid that are solid enough, as such
`contour`                 from an implicit field on a box to a `SurfaceMesh`
`Slice`, `SliceStack`     contours of a wall at given heights, without a mesh
`slice_field`             such contours of any field
`vent`                    mesh of a wall whose closed voids are opened by channels
`measure`                 volume, area, quality, edge census as functions of plain arrays
========================  ==================================================================
"""

from ilattice.mesh import measure
from ilattice.mesh.contouring import contour
from ilattice.mesh.field_slices import slice_field
from ilattice.mesh.solid_mesh import SolidMesh
from ilattice.mesh.solid_meshing import hexahedra
from ilattice.mesh.surface import SurfaceMesh, load
from ilattice.mesh.venting import vent
from ilattice.slicing.slices import Slice, SliceStack

__all__ = [
    "Slice",
    "SliceStack",
    "SolidMesh",
    "SurfaceMesh",
    "contour",
    "hexahedra",
    "load",
    "measure",
    "slice_field",
    "vent",
]
