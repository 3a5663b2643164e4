"""Binary STL: a soup of triangles in single precision, for printers.

Guarantees: the normals are those of the written corners, as readers compute them; a warning if
single precision makes triangles collapse. Not kept: topology, named data, units.
"""

import os
from typing import IO

import numpy as np

from ilattice._typing import AnyArray
from ilattice.errors import FormatError
from ilattice.io._common import atomic_write
from ilattice.io._kernels_stl import fill_triangles
from ilattice.io._mesh import blocks, check_not_empty, warn_collapsed, write_records
from ilattice.mesh import SurfaceMesh

_TRIANGLE = np.dtype([("numbers", "<f4", (12,)), ("attribute", "<u2")])
_HEADER = b"binary STL by ilattice"  # must not begin with "solid", the mark of the text form
_COUNT_AT = 80
_LARGEST = 2**32 - 1


def write_stl(mesh: SurfaceMesh, path: str | os.PathLike[str]) -> None:
    """Write a binary STL file, 50 bytes per triangle.

    Parameters
    ----------
    mesh : SurfaceMesh
        The triangles.
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
    lost = 0
    with atomic_write(path) as file:
        write_header(file, len(mesh.faces))
        for rows in blocks(len(mesh.faces)):
            records, flat = triangle_records(mesh.vertices, mesh.faces[rows])
            write_records(file, records)
            lost += flat
    warn_collapsed(lost, "STL")


def write_header(file: IO[bytes], count: int) -> None:
    """Write the 84 bytes before the triangles.

    Parameters
    ----------
    file : binary file
        Positioned at its beginning.
    count : int
        Number of triangles.

    Raises
    ------
    FormatError
        If there are more triangles than the format can count.
    """
    if count > _LARGEST:
        raise FormatError(f"STL holds at most {_LARGEST} triangles, not {count}; write PLY")
    file.write(_HEADER.ljust(_COUNT_AT, b"\0"))
    file.write(np.uint32(count).astype("<u4").tobytes())


def triangle_records(vertices: AnyArray, faces: AnyArray) -> tuple[AnyArray, int]:
    """Triangles as the bytes of the file.

    Parameters
    ----------
    vertices : (V, 3) array
        Points.
    faces : (n, 3) integer array
        Corners.

    Returns
    -------
    records : (n,) structured array
        Fifty bytes each.
    collapsed : int
        How many have lost a side to rounding.
    """
    numbers = np.empty((len(faces), 12), np.float32)
    collapsed = fill_triangles(vertices, faces, numbers)
    records = np.zeros(len(faces), _TRIANGLE)
    records["numbers"] = numbers
    return records, collapsed
