"""PLY files of all three encodings: text, little and big endian.

Guarantees: vertices and faces are found whatever other elements and properties there are; all
polygons are read, as fans of triangles; binary single precision stays single. Not read: named
data.
"""

import os
import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ilattice._typing import AnyArray, IntArray
from ilattice.errors import FormatError
from ilattice.io._common import parse_numbers, read_bytes
from ilattice.io._polygons import checked_mesh, fans
from ilattice.mesh import SurfaceMesh

_CODES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8",
}  # fmt: skip
_STRUCT = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "f4": "f", "f8": "d"}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_CORNERS = ("vertex_indices", "vertex_index")
_EVEN = 255  # corners; longer lists are read row by row
_HEAD = 1 << 20  # bytes; no header is longer


@dataclass(frozen=True)
class _Property:
    """One column: its type, and for lists that of the length before it."""

    name: str
    code: str
    length: str = ""


@dataclass(frozen=True)
class _Element:
    """One table of the file."""

    name: str
    count: int
    columns: list[_Property] = field(default_factory=list)


def read_ply(path: str | os.PathLike[str]) -> SurfaceMesh:
    """Read the vertices and faces of a PLY file.

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
        If the file cannot be read as PLY.
    """
    data = read_bytes(path)
    order, elements, start = _header(path, data)
    source = _Text(path, data[start:]) if not order else _Binary(path, data[start:], order)
    found: dict[str, dict[str, Any]] = {}
    for element in elements:
        found[element.name] = source.table(element)
        if "vertex" in found and "face" in found:
            break
    vertex = found.get("vertex", {})
    if not all(isinstance(vertex.get(c), np.ndarray) for c in "xyz"):
        raise FormatError(f"{path}: has no vertices with x, y and z")
    corners = [c for c in _CORNERS if isinstance(found.get("face", {}).get(c), tuple)]
    if not corners:
        raise FormatError(f"{path}: has no faces with {' or '.join(_CORNERS)}")
    single = all(vertex[c].dtype == np.float32 for c in "xyz")
    columns = [vertex[c].astype(np.float32 if single else np.float64) for c in "xyz"]
    sizes, values = found["face"][corners[0]]
    if values.dtype.kind not in "iu":
        raise FormatError(f"{path}: {corners[0]} must be whole numbers, not {values.dtype}")
    return checked_mesh(path, np.stack(columns, axis=1), fans(sizes, values.astype(np.int64)))


def _header(path: str | os.PathLike[str], data: bytes) -> tuple[str, list[_Element], int]:
    """Byte order ("" for text), elements, and where the tables begin."""
    end = data.find(b"end_header", 0, _HEAD)
    stop = data.find(b"\n", end)
    if data[:3] != b"ply" or end < 0 or stop < 0:
        raise FormatError(f"{path}: has no header from 'ply' to 'end_header'")
    order = None
    elements: list[_Element] = []
    lines = data[:end].decode("latin-1").splitlines()
    for number, line in enumerate(lines[1:], 2):
        match line.split():
            case [] | ["comment" | "obj_info", *_]:
                continue
            case ["format", name, "1.0"] if name in _ORDERS:
                order = _ORDERS[name]
            case ["element", name, count] if count.isascii() and count.isdigit():
                elements.append(_Element(name, int(count[:19])))
            case ["property", "list", length, code, name] if _are_types(elements, length, code):
                elements[-1].columns.append(_Property(name, _CODES[code], _CODES[length]))
            case ["property", code, name] if _are_types(elements, code):
                elements[-1].columns.append(_Property(name, _CODES[code]))
            case _:
                raise FormatError(f"{path}, line {number}: found {line!r:.60}; expected a property")
    if order is None:
        raise FormatError(f"{path}: names no known format; expected {' or '.join(_ORDERS)} 1.0")
    return order, elements, stop + 1


def _are_types(elements: list[_Element], *names: str) -> bool:
    """Whether a property may stand here: after an element, of known types."""
    return bool(elements) and all(name in _CODES for name in names)


class _Binary:
    """Tables of a binary file."""

    def __init__(self, path: str | os.PathLike[str], data: bytes, order: str) -> None:
        self._path, self._data, self._order, self._at = path, data, order, 0

    def table(self, element: _Element) -> dict[str, Any]:
        """Columns by name; lists as their lengths and all values."""
        if not element.columns:
            return {}
        sizes = self._first_sizes(element)
        least = sum(int((c.length or c.code)[1]) for c in element.columns)
        if element.count * least > len(self._data) - self._at:
            raise FormatError(
                f"{self._path}: claims {element.count} of {element.name!r:.60}, more than fit"
            )
        return self._even(element, sizes) or self._ragged(element)

    def _first_sizes(self, element: _Element) -> list[int]:
        """Lengths of the lists in the first row."""
        at, sizes = self._at, []
        for c in element.columns:
            size = 1
            if c.length:
                kind = np.dtype(self._order + c.length)
                raw = self._data[at : at + kind.itemsize]
                size = int(np.frombuffer(raw, kind)[0]) if len(raw) == kind.itemsize else 0
                at += kind.itemsize
            sizes.append(min(max(size, 0), len(self._data)))
            at += sizes[-1] * int(c.code[1])
        return sizes

    def _even(self, element: _Element, sizes: list[int]) -> dict[str, Any] | None:
        """The table if all its rows have lists as long as the first, else None."""
        fields: list[tuple[str, str, tuple[int, ...]]] = []
        for i, (c, size) in enumerate(zip(element.columns, sizes, strict=True)):
            if c.length:
                fields.append((f"n{i}", self._order + c.length, ()))
            fields.append((f"v{i}", self._order + c.code, (size,) if c.length else ()))
        width = sum(np.dtype(f[1:]).itemsize for f in fields)
        if max(sizes) > _EVEN or element.count * width > len(self._data) - self._at:
            return None
        rows = np.frombuffer(self._data, np.dtype(fields), element.count, self._at)
        table: dict[str, Any] = {}
        for i, (c, size) in enumerate(zip(element.columns, sizes, strict=True)):
            values = rows[f"v{i}"].astype(c.code)
            if c.length and not (rows[f"n{i}"] == size).all():
                return None
            lengths = np.full(element.count, size, np.int64)
            table[c.name] = (lengths, values.ravel()) if c.length else values
        self._at += element.count * width
        return table

    def _ragged(self, element: _Element) -> dict[str, Any]:
        """The table row by row."""
        parts: list[list[Any]] = [[] for _ in element.columns]
        lengths: list[list[int]] = [[] for _ in element.columns]
        try:
            for _ in range(element.count):
                for c, values, counts in zip(element.columns, parts, lengths, strict=True):
                    count = int(self._take(c.length, 1)[0]) if c.length else 1
                    values.extend(self._take(c.code, count))
                    counts.append(count)
        except (struct.error, ValueError, OverflowError) as e:
            raise FormatError(f"{self._path}: ends within {element.name!r:.60}") from e
        return _columns(element, lengths, parts)

    def _take(self, code: str, count: int) -> tuple[Any, ...]:
        size = int(code[1]) * count
        if count < 0 or self._at + size > len(self._data):
            raise ValueError
        values = struct.unpack_from(f"{self._order}{count}{_STRUCT[code]}", self._data, self._at)
        self._at += size
        return values


class _Text:
    """Tables of a text file: one row after the other, wherever the lines end."""

    def __init__(self, path: str | os.PathLike[str], data: bytes) -> None:
        self._path = path
        self._tokens = data.decode("latin-1").split()
        self._at = 0

    def table(self, element: _Element) -> dict[str, Any]:
        """Columns by name; lists as their lengths and all values."""
        if not element.columns:
            return {}
        if element.count * len(element.columns) > len(self._tokens) - self._at:
            raise FormatError(
                f"{self._path}: claims {element.count} of {element.name!r:.60}, more than fit"
            )
        parts: list[list[str]] = [[] for _ in element.columns]
        lengths: list[list[int]] = [[] for _ in element.columns]
        for _ in range(element.count):
            for c, values, counts in zip(element.columns, parts, lengths, strict=True):
                count = self._length() if c.length else 1
                values += self._tokens[self._at : self._at + count]
                counts.append(count)
                self._at += count
        if self._at > len(self._tokens):
            raise FormatError(f"{self._path}: ends within {element.name!r:.60}")
        numbers = [
            self._numbers(values, c, element)
            for values, c in zip(parts, element.columns, strict=True)
        ]
        return _columns(element, lengths, numbers)

    def _length(self) -> int:
        token = self._tokens[self._at] if self._at < len(self._tokens) else ""
        if not (token.isascii() and token.isdigit() and len(token) < 19):
            raise FormatError(f"{self._path}: found {token!r:.60}; expected the length of a list")
        self._at += 1
        return int(token)

    def _numbers(self, tokens: list[str], column: _Property, element: _Element) -> AnyArray:
        """Values of a column; reals with all their digits, whatever precision the file names."""
        values = parse_numbers(tokens)
        if not isinstance(values, int) and column.code[0] != "f":
            limits = np.iinfo(column.code)
            whole = (values == np.rint(values)) & (values >= limits.min) & (values <= limits.max)
            if whole.all():
                return values.astype(column.code)
            values = int(np.argmin(whole))
        if isinstance(values, int):
            raise FormatError(
                f"{self._path}: found {tokens[values]!r:.60} in {element.name!r:.60}; expected "
                f"finite numbers of type {column.code}"
            )
        return values


def _columns(element: _Element, lengths: list[list[int]], parts: list[Any]) -> dict[str, Any]:
    """Columns by name; lists as their lengths and all values."""
    table: dict[str, tuple[IntArray, AnyArray] | AnyArray] = {}
    for c, counts, values in zip(element.columns, lengths, parts, strict=True):
        column = values if isinstance(values, np.ndarray) else np.array(values, c.code)
        table[c.name] = (np.array(counts, np.int64), column) if c.length else column
    return table
