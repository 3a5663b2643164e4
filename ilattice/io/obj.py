"""Wavefront OBJ: text, shared vertices, colours after the coordinates; read by everything.

Guarantees: coordinates are written with as many digits as give the same number back. Not kept:
named data other than ``r``, ``g``, ``b``.
"""

import os
from collections.abc import Iterator

from ilattice._typing import AnyArray
from ilattice.io._common import atomic_write
from ilattice.io._mesh import TEXT_BLOCK, blocks, check_not_empty, colours
from ilattice.mesh import SurfaceMesh


def write_obj(mesh: SurfaceMesh, path: str | os.PathLike[str]) -> None:
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
    check_not_empty(mesh)
    with atomic_write(path, text=True) as file:
        file.write("# written by ilattice\n")
        for rows in blocks(len(mesh.vertices), TEXT_BLOCK):
            part = {name: a[rows] for name, a in mesh.point_data.items()}
            colour = colours(part)
            tail = None if colour is None else colour / 255.0
            file.writelines(point_lines(mesh.vertices[rows], tail, "v "))
        for rows in blocks(len(mesh.faces), TEXT_BLOCK):
            file.writelines(f"f {a} {b} {c}\n" for a, b, c in (mesh.faces[rows] + 1).tolist())


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
