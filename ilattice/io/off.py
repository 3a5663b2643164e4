"""Object File Format (OFF): the plainest text form of a mesh.

Guarantees: coordinates are written with as many digits as give the same number back; all polygons
are read, as fans of triangles. Not kept: named data and colours.
"""

import os
import re

from ilattice.errors import FormatError
from ilattice.io._common import atomic_write, blank_comments, read_text
from ilattice.io._mesh import TEXT_BLOCK, blocks, check_not_empty
from ilattice.io._polygons import checked_mesh, fans, flattened
from ilattice.io.obj import point_lines, point_rows
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


def read_off(path: str | os.PathLike[str]) -> SurfaceMesh:
    """Read an OFF file, also COFF, NOFF and the like, whose further columns are left out.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    SurfaceMesh
        Vertices and triangles.

    Raises
    ------
    FormatError
        If the file cannot be read as OFF.
    """
    lines = [
        (number, line.split())
        for number, line in enumerate(blank_comments(read_text(path)).split("\n"), 1)
        if not line.isspace() and line
    ]
    head = lines[0][1] if lines else [""]
    if re.fullmatch(r"(ST)?C?N?OFF", head[0]) is None:
        raise FormatError(f"{path}: begins with {head[0]!r:.60}; expected 'OFF'")
    if "BINARY" in head:
        raise FormatError(f"{path}: is binary OFF, of which only the text form is read")
    lines = [(lines[0][0], head[1:]), *lines[1:]] if len(head) > 1 else lines[1:]
    counts = _whole(path, lines[0], "the numbers of vertices and faces") if lines else []
    if len(counts) < 2 or min(counts) < 0 or counts[0] + counts[1] > len(lines) - 1:
        raise FormatError(
            f"{path}: expected the numbers of vertices and faces, and as many lines; found "
            f"{counts} and {max(len(lines) - 1, 0)} lines"
        )
    points, rows = lines[1 : 1 + counts[0]], lines[1 + counts[0] : 1 + counts[0] + counts[1]]
    vertices = point_rows(path, [(number, tokens[:3]) for number, tokens in points])
    polygons = []
    for row in rows:
        size = _whole(path, (row[0], row[1][:1]), "a number of corners")[0]
        polygons.append(_whole(path, (row[0], row[1][1 : 1 + size]), "corners"))
        if size != len(polygons[-1]):
            raise FormatError(f"{path}, line {row[0]}: expected {size} corners")
    return checked_mesh(path, vertices, fans(*flattened(polygons)))


def _whole(path: str | os.PathLike[str], line: tuple[int, list[str]], what: str) -> list[int]:
    """The tokens of a line as whole numbers."""
    number, tokens = line
    if not all(re.fullmatch(r"-?[0-9]{1,18}", t) for t in tokens):
        raise FormatError(f"{path}, line {number}: found {' '.join(tokens)!r:.60}; expected {what}")
    return [int(t) for t in tokens]
