"""Object File Format (OFF): the plainest text form of a mesh.

Guarantees: coordinates are written with as many digits as give the same number back; all polygons
are read, as fans of triangles. Not kept: named data and colours.
"""

import itertools
import os
import re
from typing import NoReturn

from ilattice._files import atomic_write, read_text
from ilattice.errors import FormatError
from ilattice.io._mesh import TEXT_BLOCK, MeshArrays, Triangles, blocks, check_mesh
from ilattice.io._polygons import Points, Polygons, checked_mesh, text_lines, words_of
from ilattice.io._scanner import blank_comments
from ilattice.io.obj import point_lines

_WHOLE = re.compile(r"-?[0-9]{1,18}")


def write_off(mesh: Triangles, path: str | os.PathLike[str]) -> None:
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
    check_mesh(mesh)
    with atomic_write(path, text=True) as file:
        file.write(f"OFF\n{len(mesh.vertices)} {len(mesh.faces)} 0\n")
        for rows in blocks(len(mesh.vertices), TEXT_BLOCK):
            file.writelines(point_lines(mesh.vertices[rows], None, ""))
        for rows in blocks(len(mesh.faces), TEXT_BLOCK):
            file.writelines(f"3 {a} {b} {c}\n" for a, b, c in mesh.faces[rows].tolist())


def read_off(path: str | os.PathLike[str]) -> MeshArrays:
    """Read an OFF file, also COFF, NOFF and the like, whose further columns are left out.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    MeshArrays
        Vertices and triangles.

    Raises
    ------
    FormatError
        If the file cannot be read as OFF.
    """
    text = blank_comments(read_text(path))
    lines = text_lines(text)
    number, head = next(lines, (1, ""))
    words = head.split(None, 1)
    mark, rest = [*words, "", ""][:2]
    if re.fullmatch(r"(ST)?C?N?OFF", mark) is None:
        raise FormatError(f"{path}: begins with {mark!r:.60}; expected 'OFF'")
    if "BINARY" in rest[:60].split():
        raise FormatError(f"{path}: is binary OFF, of which only the text form is read")
    if not rest.strip():
        number, rest = next(lines, (number, ""))
    counts = _whole(path, number, rest.split(None, 3)[:3], "the numbers of vertices and faces")
    if len(counts) < 2 or min(counts) < 0 or 2 * (counts[0] + counts[1]) > len(text):
        _refuse(path, counts, sum(1 for _ in lines))
    points, polygons = Points(path), Polygons()
    for number, line in itertools.islice(lines, counts[0]):
        points.add(number, line)
    found = len(points)
    for number, line in itertools.islice(lines, counts[1]):
        _polygon(path, number, line, polygons)
        found += 1
    if found < counts[0] + counts[1]:
        _refuse(path, counts, found)
    return checked_mesh(path, points.rows(), *polygons.arrays(), len(text))


def _refuse(path: str | os.PathLike[str], counts: list[int], lines: int) -> NoReturn:
    raise FormatError(
        f"{path}: expected the numbers of vertices and faces, and as many lines; found "
        f"{counts} and {lines} lines"
    )


def _polygon(path: str | os.PathLike[str], number: int, line: str, polygons: Polygons) -> None:
    """Take a face in: its number of corners, the corners; what follows is left out."""
    words = words_of(line)
    size = _whole(path, number, [next(words)], "a number of corners")[0]
    start, left = len(polygons.corners), max(size, 0)
    while left and (tokens := list(itertools.islice(words, min(left, 1 << 15)))):
        polygons.corners.extend(_whole(path, number, tokens, "corners"))
        left -= len(tokens)
    if left or size < 0:
        raise FormatError(f"{path}, line {number}: expected {size} corners")
    polygons.close(start)


def _whole(path: str | os.PathLike[str], number: int, tokens: list[str], what: str) -> list[int]:
    """The tokens of a line as whole numbers."""
    if not all(map(_WHOLE.fullmatch, tokens)):
        found = " ".join(t[:60] for t in tokens[:9])
        raise FormatError(f"{path}, line {number}: found {found!r:.60}; expected {what}")
    return [int(t) for t in tokens]
