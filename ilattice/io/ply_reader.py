"""PLY files of all three encodings: text, little and big endian.

Guarantees: vertices and faces are found whatever other elements and properties there are, and the
file holds all that its header claims and nothing more, also after the faces; all polygons are read,
as fans of triangles; binary single precision stays single. Not read: named data.
"""

import itertools
import os
import re
import struct
from array import array
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NoReturn

import numpy as np

from ilattice._files import read_bytes
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.errors import FormatError
from ilattice.io._polygons import checked_mesh
from ilattice.io._scanner import parse_text
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
_ROWS = 1 << 16  # numbers that are checked at a time


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
    source = _Binary(path, data, start, order) if order else _Text(path, data, start)
    found: dict[str, dict[str, Any]] = {}
    for element in elements:
        table = source.table(element)
        if element.name in ("vertex", "face"):
            found[element.name] = table
    source.end()
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
    vertices = np.stack(columns, axis=1)
    del found, columns, vertex
    return checked_mesh(path, vertices, sizes, values, len(data))


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
    names = [element.name for element in elements]
    if any(names.count(name) > 1 for name in ("vertex", "face")):
        raise FormatError(f"{path}: names vertices or faces twice")
    if order is None:
        raise FormatError(f"{path}: names no known format; expected {' or '.join(_ORDERS)} 1.0")
    return order, elements, stop + 1


def _are_types(elements: list[_Element], *names: str) -> bool:
    """Whether a property may stand here: after an element, of known types."""
    return bool(elements) and all(name in _CODES for name in names)


class _Binary:
    """Tables of a binary file."""

    def __init__(self, path: str | os.PathLike[str], data: bytes, start: int, order: str) -> None:
        self._path, self._data, self._order, self._at = path, data, order, start

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
            lengths = np.full(element.count, size, np.int32)
            table[c.name] = (lengths, values.ravel()) if c.length else values
        self._at += element.count * width
        return table

    def _ragged(self, element: _Element) -> dict[str, Any]:
        """The table row by row."""
        parts = [bytearray() for _ in element.columns]
        codes = [_STRUCT.get(c.length, "i") for c in element.columns]
        lengths = [array("i" if code in "fd" else code) for code in codes]
        try:
            for _ in range(element.count):
                for c, values, counts in zip(element.columns, parts, lengths, strict=True):
                    count = 1
                    if c.length:
                        code = self._order + _STRUCT[c.length]
                        count = int(struct.unpack(code, self._take(int(c.length[1])))[0])
                        counts.append(count)  # negative ones end below
                    values += self._take(int(c.code[1]) * count)
        except (struct.error, ValueError, OverflowError) as e:
            raise FormatError(f"{self._path}: ends within {element.name!r:.60}") from e
        numbers = [
            np.frombuffer(values, self._order + c.code).astype(c.code, copy=False)
            for c, values in zip(element.columns, parts, strict=True)
        ]
        return _columns(element, lengths, numbers)

    def end(self) -> None:
        """Refuse what comes after the last table."""
        rest = len(self._data) - self._at
        if rest and not self._data[self._at :].isspace():
            raise FormatError(f"{self._path}: holds {rest} bytes more than its header claims")

    def _take(self, size: int) -> bytes:
        """The next bytes."""
        if size < 0 or self._at + size > len(self._data):
            raise ValueError
        self._at += size
        return self._data[self._at - size : self._at]


class _Text:
    """Tables of a text file: one row after the other, wherever the lines end."""

    def __init__(self, path: str | os.PathLike[str], data: bytes, start: int) -> None:
        self._path, self._at = path, 0
        self._data, self._start = data, start
        self._values, self._wrong = parse_text(data[start:].decode("latin-1"))

    def table(self, element: _Element) -> dict[str, Any]:
        """Columns by name; lists as their lengths and all values."""
        if not element.columns:
            return {}
        left = len(self._values) - self._at
        if element.count * len(element.columns) > left and not self._wrong:
            raise FormatError(
                f"{self._path}: claims {element.count} of {element.name!r:.60}, more than fit"
            )
        places = [array(_whole_kind(self._values)) for _ in element.columns]
        lengths = [array("i") for _ in element.columns]
        if not any(c.length for c in element.columns):
            width, start = len(element.columns), self._at
            self._move(element, element.count * width)
            block = self._values[start : self._at].reshape(-1, width)
            checked = [
                self._typed(block[:, i], c, element, range(start + i, self._at, width).__getitem__)
                for i, c in enumerate(element.columns)
            ]
        else:
            self._walk(element, places, lengths)
            checked = []
            for c, p, n in zip(element.columns, places, lengths, strict=True):
                at = _spread(p, n if c.length else None)
                checked.append(self._typed(self._values[at], c, element, at.__getitem__))
        return _columns(element, lengths, checked)

    def end(self) -> None:
        """Refuse what comes after the last table."""
        if self._at < len(self._values) or self._wrong:
            raise FormatError(
                f"{self._path}, line {self._line(self._at)}: holds more than its header claims"
            )

    def _line(self, number: int) -> int:
        """The line of a number of the tables, or the last one."""
        places = re.finditer(rb"\S+", memoryview(self._data)[self._start :])
        place = next((m.start() for m in itertools.islice(places, number, None)), 0)
        return self._data.count(b"\n", 0, self._start + place) + 1

    def _walk(
        self, element: _Element, places: list["array[int]"], lengths: list["array[int]"]
    ) -> None:
        """Places and lengths of the values of all rows, one row after the other."""
        for _ in range(element.count):
            for c, starts, counts in zip(element.columns, places, lengths, strict=True):
                count = 1
                if c.length:
                    count = self._length(element)
                    counts.append(count)
                starts.append(self._at)
                self._move(element, count)

    def _move(self, element: _Element, count: int) -> None:
        """Pass over numbers, which must be there."""
        if self._at + count > len(self._values):
            if self._wrong:
                self._refuse(self._wrong, element, "finite numbers", len(self._values))
            raise FormatError(f"{self._path}: ends within {element.name!r:.60}")
        self._at += count

    def _length(self, element: _Element) -> int:
        """The next number, as the length of a list."""
        start = self._at
        self._move(element, 1)
        value = float(self._values[start])
        if not (value >= 0 and value == int(value)):
            self._refuse(f"{value:g}", element, "the length of a list", start)
        return int(min(value, len(self._values)))

    def _refuse(self, word: str, element: _Element, expected: str, at: int) -> NoReturn:
        raise FormatError(
            f"{self._path}, line {self._line(at)}: found {word!r:.60} in {element.name!r:.60}; "
            f"expected {expected}"
        )

    def _typed(
        self,
        values: FloatArray,
        column: _Property,
        element: _Element,
        place: Callable[[int], int],
    ) -> AnyArray:
        """Values of a column; reals with all their digits, whatever precision the file names."""
        if column.code[0] == "f":
            return values
        limits = np.iinfo(column.code)
        out = np.empty(len(values), column.code)
        for i in range(0, len(values), _ROWS):
            part = values[i : i + _ROWS]
            whole = (part == np.rint(part)) & (part >= limits.min) & (part <= limits.max)
            if not whole.all():
                bad = int(np.argmin(whole))
                expected = f"finite numbers of type {column.code}"
                self._refuse(f"{part[bad]:g}", element, expected, int(place(i + bad)))
            out[i : i + _ROWS] = part
        return out


def _as_numbers(counts: "array[int]") -> IntArray:
    """The same numbers, not copied."""
    return np.frombuffer(counts, counts.typecode) if len(counts) else np.zeros(0, np.int64)


def _whole_kind(values: FloatArray) -> str:
    """Type of places among values."""
    return "i" if len(values) < 2**31 else "q"


def _spread(places: "array[int]", lengths: "array[int] | None") -> IntArray:
    """Places of all values of lists, given those of the first ones."""
    first = np.array(places)
    if lengths is None:
        return first
    counts = _as_numbers(lengths)
    first, counts = first[counts > 0], counts[counts > 0].astype(np.int64)
    out = np.repeat(first - (np.cumsum(counts) - counts), counts)
    out += np.arange(len(out))
    return out


def _columns(
    element: _Element, lengths: list["array[int]"], parts: list[AnyArray]
) -> dict[str, Any]:
    """Columns by name; lists as their lengths and all values."""
    return {
        c.name: (_as_numbers(counts), values) if c.length else values
        for c, counts, values in zip(element.columns, lengths, parts, strict=True)
    }
