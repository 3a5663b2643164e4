"""Binary PLY (little endian): shared vertices with named data and colours, the compact choice.

Guarantees: numbers keep their type, or become single precision on request; ``r``, ``g``, ``b``
become the byte colours that every reader knows. Data of several components ``v`` become ``v_0``,
``v_1``, ...; blanks in names become ``_``. Integers wider than 32 bits become doubles.
"""

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from ilattice._files import atomic_write
from ilattice._typing import AnyArray
from ilattice.errors import FormatError, InputError
from ilattice.io._mesh import (
    Triangles,
    blocks,
    check_mesh,
    check_single,
    colours,
    without_colours,
    write_records,
)

_TYPES = {
    "i1": "char",
    "u1": "uchar",
    "i2": "short",
    "u2": "ushort",
    "i4": "int",
    "u4": "uint",
    "f4": "float",
    "f8": "double",
}
_NARROW = {"b1": "u1", "i8": "f8", "u8": "f8", "f2": "f4"}


def write_ply(
    mesh: Triangles, path: str | os.PathLike[str], *, precision: str | None = None
) -> None:
    """Write a binary PLY file.

    Parameters
    ----------
    mesh : SurfaceMesh
        The mesh; all data are written.
    path : path-like
        File to create or to replace.
    precision : {"single", "double"}, optional
        Type of the coordinates and of real data; by default as they are.

    Raises
    ------
    GeometryError
        If the mesh is empty.
    InputError
        Unknown precision.
    FormatError
        If the file cannot be written.
    """
    check_mesh(mesh)
    vertex = VertexRecords(mesh.vertices, mesh.point_data, precision)
    face = FaceRecords(mesh.cell_data, precision)
    with atomic_write(path) as file:
        file.write(header(vertex.dtype, len(mesh.vertices), face.dtype, len(mesh.faces)))
        for rows in blocks(len(mesh.vertices)):
            write_records(file, vertex.block(mesh.vertices, mesh.point_data, rows))
        for rows in blocks(len(mesh.faces)):
            write_records(file, face.block(mesh.faces, mesh.cell_data, rows))


class VertexRecords:
    """Layout of the vertices of a file.

    Parameters
    ----------
    vertices : (V, 3) array
        Points, for their type.
    point_data : mapping of str to array
        Named data, for their names and types.
    precision : {"single", "double"}, optional
        Type of all reals.
    """

    def __init__(
        self, vertices: AnyArray, point_data: Mapping[str, AnyArray], precision: str | None
    ) -> None:
        kind = _type(vertices.dtype, precision)
        if kind == "<f4":
            check_single(vertices, "PLY in single precision", 0.0)
        fields = [(name, kind) for name in "xyz"]
        if colours(_heads(point_data)) is not None:
            fields += [(name, "u1") for name in ("red", "green", "blue")]
        fields += _fields(without_colours(point_data), precision)
        self.dtype = _checked(fields)

    def block(
        self, vertices: AnyArray, point_data: Mapping[str, AnyArray], rows: slice
    ) -> AnyArray:
        """Records of some vertices.

        Parameters
        ----------
        vertices : (V, 3) array
            Points.
        point_data : mapping of str to array
            Named data, as in the constructor.
        rows : slice
            Which ones.

        Returns
        -------
        structured array
            The bytes of the file.
        """
        part = {name: a[rows] for name, a in point_data.items()}
        columns = [*vertices[rows].T]
        colour = colours(part)
        if colour is not None:
            columns += [*colour.T]
        return _filled(self.dtype, columns + _columns(without_colours(part)))


class FaceRecords:
    """Layout of the faces of a file.

    Parameters
    ----------
    cell_data : mapping of str to array
        Named data, for their names and types.
    precision : {"single", "double"}, optional
        Type of all reals.
    """

    def __init__(
        self, cell_data: Mapping[str, AnyArray] | None = None, precision: str | None = None
    ) -> None:
        corner = [("corners", "u1"), ("a", "<i4"), ("b", "<i4"), ("c", "<i4")]
        self.dtype = _checked(corner + _fields(cell_data or {}, precision))

    def block(self, faces: AnyArray, cell_data: Mapping[str, AnyArray], rows: slice) -> AnyArray:
        """Records of some faces.

        Parameters
        ----------
        faces : (F, 3) integer array
            Corners.
        cell_data : mapping of str to array
            Named data, as in the constructor.
        rows : slice
            Which ones.

        Returns
        -------
        structured array
            The bytes of the file.
        """
        part = {name: a[rows] for name, a in cell_data.items()}
        corners = faces[rows]
        return _filled(self.dtype, [np.full(len(corners), 3), *corners.T, *_columns(part)])


def header(
    vertex: "np.dtype[Any]", vertices: int, face: "np.dtype[Any]", faces: int, size: int = 0
) -> bytes:
    """Everything before the records.

    Parameters
    ----------
    vertex, face : dtype
        Layouts from `VertexRecords` and `FaceRecords`.
    vertices, faces : int
        Their numbers.
    size : int
        Length in bytes to fill up to with a comment, at least.

    Returns
    -------
    bytes
        The header with its last line end.

    Raises
    ------
    FormatError
        If there are more vertices than 32-bit indices can name.
    """
    check_count(vertices)
    lines = ["ply", "format binary_little_endian 1.0", "comment written by ilattice", "comment "]
    lines += [f"element vertex {vertices}", *_properties(vertex, vertex.names or ())]
    lines += [f"element face {faces}", "property list uchar int vertex_indices"]
    lines += [*_properties(face, (face.names or ())[4:]), "end_header", ""]
    short = sum(len(line.encode()) + 1 for line in lines) - 1
    lines[3] = lines[3] + "." * max(0, size - short)
    return "\n".join(lines).encode()


def check_count(vertices: int) -> None:
    """Refuse more vertices than 32-bit indices can name.

    Parameters
    ----------
    vertices : int
        Number of vertices.

    Raises
    ------
    FormatError
        If there are too many.
    """
    if vertices > 2**31 - 1:
        raise FormatError(f"PLY names at most {2**31 - 1} vertices, not {vertices}; write pieces")


def _properties(dtype: "np.dtype[Any]", names: tuple[str, ...]) -> list[str]:
    return [f"property {_TYPES[dtype[name].str[1:]]} {name}" for name in names]


def _type(dtype: "np.dtype[Any]", precision: str | None) -> str:
    """Little-endian type of the file for numbers of type `dtype`."""
    if precision not in (None, "single", "double"):
        raise InputError(f'precision must be "single", "double" or None, got {precision!r:.80}')
    kind = dtype.str[1:]
    kind = _NARROW.get(kind, kind)
    if precision and kind in ("f4", "f8"):
        kind = "f4" if precision == "single" else "f8"
    return "<" + kind


def _fields(data: Mapping[str, AnyArray], precision: str | None) -> list[tuple[str, str]]:
    fields = []
    for name, a in data.items():
        safe = "_".join(name.split())
        names = [safe] if a.ndim == 1 else [f"{safe}_{i}" for i in range(a.shape[1])]
        fields += [(n, _type(a.dtype, precision)) for n in names]
    return fields


def _checked(fields: list[tuple[str, str]]) -> "np.dtype[Any]":
    names = [name for name, _ in fields]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"two data would be called {name!r} in the PLY file; rename one")
        if not name.isascii():
            raise InputError(f"PLY names must be ASCII, got {name!r:.80}; rename it")
    return np.dtype(fields)


def _columns(data: Mapping[str, AnyArray]) -> list[AnyArray]:
    return [column for a in data.values() for column in (a[:, None] if a.ndim == 1 else a).T]


def _filled(dtype: "np.dtype[Any]", columns: list[AnyArray]) -> AnyArray:
    records = np.empty(len(columns[0]), dtype)
    for name, column in zip(dtype.names or (), columns, strict=True):
        records[name] = column
    return records


def _heads(data: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
    """The same names and types without the rows."""
    return {name: a[:0] for name, a in data.items()}
