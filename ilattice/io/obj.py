"""Wavefront OBJ: text, shared vertices, colours after the coordinates; read by everything.

Guarantees: coordinates are written with as many digits as give the same number back; all polygons
are read, as fans of triangles. Not written: named data other than ``r``, ``g``, ``b``. Not read:
anything but vertices and faces.
"""

import os
import re
from collections.abc import Iterator

from ilattice._files import atomic_write, read_text
from ilattice._typing import AnyArray
from ilattice.errors import FormatError
from ilattice.io._mesh import TEXT_BLOCK, MeshArrays, Triangles, blocks, check_mesh, colours
from ilattice.io._polygons import Points, Polygons, checked_mesh, text_lines, words_of
from ilattice.io._scanner import blank_comments

_CORNER = re.compile(r"-?[0-9]{1,18}")


def write_obj(mesh: Triangles, path: str | os.PathLike[str]) -> None:
    """Write a Wavefront OBJ file.

    Parameters
    ----------
    mesh : SurfaceMesh
        The mesh; ``r``, ``g``, ``b`` are written as colours.
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
        file.write("# written by ilattice\n")
        for rows in blocks(len(mesh.vertices), TEXT_BLOCK):
            part = {name: a[rows] for name, a in mesh.point_data.items()}
            colour = colours(part)
            tail = None if colour is None else colour / 255.0
            file.writelines(point_lines(mesh.vertices[rows], tail, "v "))
        for rows in blocks(len(mesh.faces), TEXT_BLOCK):
            file.writelines(f"f {a} {b} {c}\n" for a, b, c in (mesh.faces[rows] + 1).tolist())


def read_obj(path: str | os.PathLike[str]) -> MeshArrays:
    """Read the vertices and faces of a Wavefront OBJ file, of all its objects together.

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
        If the file cannot be read as OBJ.
    """
    text = blank_comments(read_text(path)).replace("\\\n", " ")
    points, polygons = Points(path), Polygons()
    for number, line in text_lines(text):
        match line.split(None, 1):
            case ["v", *rest]:
                points.add(number, *rest or [""])
            case ["f", rest]:
                start = len(polygons.corners)
                polygons.corners.extend(_corners(path, number, rest, len(points)))
                polygons.close(start)
    return checked_mesh(path, points.rows(), *polygons.arrays(), len(text))


def _corners(path: str | os.PathLike[str], number: int, text: str, vertices: int) -> Iterator[int]:
    """Vertices of a face from 0 on; the file counts from 1, or backwards from -1."""
    for token in words_of(text):
        head = token.split("/", 1)[0]
        if not _CORNER.fullmatch(head) or int(head) == 0:
            raise FormatError(f"{path}, line {number}: found {token!r:.60}; expected a corner")
        yield int(head) - 1 if int(head) > 0 else vertices + int(head)


def point_lines(points: AnyArray, tail: AnyArray | None, start: str) -> Iterator[str]:
    """Lines of coordinates, the shortest text that gives the same numbers back.

    Parameters
    ----------
    points : (n, 3) array
        Coordinates.
    tail : (n, 3) array or None
        Further numbers for each line, with four digits.
    start : str
        Beginning of each line.

    Yields
    ------
    str
        A line with its end.
    """
    text = points.astype(str).tolist()
    if tail is None:
        yield from (f"{start}{x} {y} {z}\n" for x, y, z in text)
    else:
        for (x, y, z), (r, g, b) in zip(text, tail.tolist(), strict=True):
            yield f"{start}{x} {y} {z} {r:.4f} {g:.4f} {b:.4f}\n"
