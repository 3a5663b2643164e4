"""Files out and in, one module per format.

========================  ==================================================================
`save`                    write a mesh or a volume; the ending names the format
`read_mesh`               a triangle mesh from STL, PLY, OBJ or OFF, as arrays
`read_columns`            columns of numbers from CSV, such as points with a thickness
`save_grid`               fields on a grid as VTI, or through a map as VTS
`write_vtu`               cells of one kind with named data
`write_pvd`               files that follow each other in time, as one for ParaView
`save_bezier_vtu`         a spline volume as exact Bezier cells
`StreamedMeshWriter`      meshes larger than memory, to STL or PLY block by block
`write_stream`            the same for an iterable of blocks
========================  ==================================================================

Guarantee: a file is replaced as a whole or not at all.
"""

from ilattice.io.columns import read_columns
from ilattice.io.registry import endings, read_mesh, save
from ilattice.io.stream import StreamedMeshWriter, write_stream
from ilattice.io.vtk import save_bezier_vtu, save_grid, write_pvd, write_vtu

__all__ = [
    "StreamedMeshWriter",
    "endings",
    "read_columns",
    "read_mesh",
    "save",
    "save_bezier_vtu",
    "save_grid",
    "write_pvd",
    "write_stream",
    "write_vtu",
]
