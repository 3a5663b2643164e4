"""Object File Format (OFF): the plainest text form of a mesh.

Guarantees: coordinates are written with as many digits as give the same number back. Not kept:
named data and colours.
"""

import os

from ilattice.io._common import atomic_write
from ilattice.io._mesh import TEXT_BLOCK, blocks, check_not_empty
from ilattice.io.obj import point_lines
from ilattice.mesh import SurfaceMesh


def write_off(mesh: SurfaceMesh, path: str | os.PathLike[str]) -> None:
    """Write an OFF file.

    Parameters
    ----------
    mesh : SurfaceMesh
        The mesh.
    path : path-like
        File to create or to replace.

    Raises
    ------
    GeometryError
        If the mesh is empty.
    FormatError
        If the file cannot be written.
    """
    check_not_empty(mesh)
    with atomic_write(path, text=True) as file:
        file.write(f"OFF\n{len(mesh.vertices)} {len(mesh.faces)} 0\n")
        for rows in blocks(len(mesh.vertices), TEXT_BLOCK):
            file.writelines(point_lines(mesh.vertices[rows], None, ""))
        for rows in blocks(len(mesh.faces), TEXT_BLOCK):
            file.writelines(f"3 {a} {b} {c}\n" for a, b, c in mesh.faces[rows].tolist())
