"""STL: a soup of triangles in single precision, for printers; text is read, too.

Guarantees: the normals are those of the written corners, as readers compute them; a warning if
single precision makes triangles collapse. Read files get their topology back by equal corners;
their normals are left out. Not kept: named data, units.
"""

import os
import re
from array import array
from typing import IO

import numpy as np

from ilattice._files import atomic_write, read_bytes
from ilattice._typing import AnyArray, FloatArray
from ilattice.errors import FormatError
from ilattice.io._kernels_stl import fill_triangles
from ilattice.io._mesh import (
    MeshArrays,
    Triangles,
    blocks,
    check_mesh,
    check_single,
    warn_collapsed,
    warn_rounded,
    write_records,
)
from ilattice.io._polygons import checked_mesh, welded
from ilattice.io._scanner import parse_numbers

_TRIANGLE = np.dtype([("numbers", "<f4", (12,)), ("attribute", "<u2")])
_HEADER = b"binary STL by ilattice"  # must not begin with "solid", the mark of the text form
#: Bytes before the number of triangles, and the largest number that fits there.
_COUNT_AT = 80
_LARGEST = 2**32 - 1
_LONGEST = 4096  # letters from one facet to the next


def write_stl(mesh: Triangles, path: str | os.PathLike[str]) -> None:
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
        If the file cannot be written, or single precision does not hold the coordinates.
    """
    check_mesh(mesh)
    check_single(mesh.vertices, "STL")
    lost = 0
    with atomic_write(path) as file:
        write_header(file, len(mesh.faces))
        for rows in blocks(len(mesh.faces)):
            records, flat = triangle_records(mesh.vertices, mesh.faces[rows])
            write_records(file, records)
            lost += flat
    warn_collapsed(lost, "STL")
    if not lost:
        warn_rounded(mesh, "STL")


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


def read_stl(path: str | os.PathLike[str]) -> MeshArrays:
    """Read an STL file, binary or text; equal corners become one vertex.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    MeshArrays
        Vertices, in double precision, and triangles.

    Raises
    ------
    FormatError
        If the file cannot be read as STL.
    """
    data = read_bytes(path)
    count = int.from_bytes(data[_COUNT_AT : _COUNT_AT + 4], "little")
    size = _COUNT_AT + 4 + _TRIANGLE.itemsize * count
    if len(data) == size:
        records = np.frombuffer(data, _TRIANGLE, count, _COUNT_AT + 4)
        corners = records["numbers"][:, 3:].reshape(-1, 3).astype(np.float64)
        del records
    elif data[:512].lstrip()[:5].lower() == b"solid":
        corners = _text_corners(path, data.decode("latin-1"))
    else:
        raise FormatError(
            f"{path}: is no STL text, and of {len(data)} bytes where its {count} binary triangles "
            f"take {size}; it may be cut short"
        )
    bad = ~np.isfinite(corners).all(axis=1)
    if bad.any():
        i = int(np.argmax(bad))
        raise FormatError(f"{path}: triangle {i // 3} has the corner {corners[i].tolist()}")
    length = len(data)
    del data, bad  # a third of the memory, which welding needs
    vertices, number = welded(corners)
    return checked_mesh(path, vertices, np.full(len(number) // 3, 3), number, length)


def _text_corners(path: str | os.PathLike[str], text: str) -> FloatArray:
    """Corners (n, 3) of all facets of a text file."""
    values = array("d")
    line = at = 0
    for facet in re.finditer(r"\bouter\s+loop\b", text, re.IGNORECASE):
        line += text.count("\n", at, facet.end())
        at = facet.end()
        words = text[at : at + _LONGEST].split(None, 13)
        marks = [w.lower() for w in words[0:13:4]]
        if marks != ["vertex", "vertex", "vertex", "endloop"]:
            found = " ".join(w[:80] for w in words[:13])
            raise FormatError(
                f"{path}, line {line + 1}: found {found!r:.80}; expected three vertices and endloop"
            )
        numbers = parse_numbers(words[1:4] + words[5:8] + words[9:12])
        if isinstance(numbers, int):
            wrong = words[numbers + numbers // 3 + 1]
            raise FormatError(
                f"{path}, line {line + 1}: facet {len(values) // 9} has the coordinate "
                f"{wrong!r:.60}; expected a finite number"
            )
        values.extend(numbers)
    return np.array(values, np.float64).reshape(-1, 3)
