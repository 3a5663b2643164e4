"""Images of VTK (``.vti``), from files that need not be trusted.

Guarantees: of values in text, in base64 or appended, also compressed by zlib or LZMA; no more is
unpacked than the file says that there are, and sizes that so many bytes cannot hold are refused
before. Non-guarantee: files of several pieces, LZ4 and directions that are not those of space are
refused.
"""

import base64
import binascii
import lzma
import re
import zlib
from collections.abc import Callable
from xml.etree import ElementTree

import numpy as np

from ilattice._memory import need
from ilattice._typing import AnyArray, FloatArray
from ilattice.errors import FormatError

#: Times that compressed data grow at most: zlib's limit, which LZMA may pass for voxels all alike.
GROWTH = 1100
_TYPES = {
    "Int8": "i1", "UInt8": "u1", "Int16": "i2", "UInt16": "u2", "Int32": "i4", "UInt32": "u4",
    "Int64": "i8", "UInt64": "u8", "Float32": "f4", "Float64": "f8",
}  # fmt: skip
_UNPACK: dict[str, Callable[[bytes, int], bytes]] = {
    "vtkZLibDataCompressor": lambda data, size: zlib.decompressobj().decompress(data, size + 1),
    "vtkLZMADataCompressor": lambda data, size: lzma.LZMADecompressor().decompress(data, size + 1),
}


def read_vti(data: bytes) -> tuple[AnyArray, FloatArray]:
    """Values of cells, else of points, along x, y, z, and the edges of voxels.

    Parameters
    ----------
    data : bytes
        The file.

    Returns
    -------
    tuple of ndarray, shape (n0, n1, n2), and ndarray, shape (3,)
        Values and edges.

    Raises
    ------
    FormatError
        If it is no such file, or one that is not understood.
    """
    head, mark, tail = data.partition(b"<AppendedData")
    if b"<!DOCTYPE" in head or b"<!ENTITY" in head:
        raise FormatError("document types are not read")
    try:
        root = ElementTree.fromstring(head + b"</VTKFile>" if mark else head)
    except ElementTree.ParseError as e:
        raise FormatError(f"is no XML: {e}") from e
    image = root.find("ImageData")
    pieces = [] if image is None else image.findall("Piece")
    if root.tag != "VTKFile" or image is None or len(pieces) != 1:
        raise FormatError("must hold one ImageData of one Piece")
    edges = _numbers(image, "Spacing", 3, "1 1 1")
    if not (np.isfinite(edges).all() and (edges > 0).all()):
        raise FormatError(f"Spacing must be above zero, got {image.get('Spacing')!r:.60}")
    if not np.array_equal(
        _numbers(image, "Direction", 9, "1 0 0 0 1 0 0 0 1").reshape(3, 3), np.eye(3)
    ):
        raise FormatError("Direction must be that of space")
    extent = _numbers(image, "WholeExtent", 6).reshape(3, 2)
    points = extent[:, 1] - extent[:, 0] + 1
    found, shape = _chosen(pieces[0], points)
    reader = _Reader(root, tail, len(data))
    return reader.values(found, shape).reshape(shape, order="F"), edges


def _numbers(node: ElementTree.Element, name: str, count: int, default: str = "") -> FloatArray:
    try:
        found = np.array([float(v) for v in node.get(name, default).split()])
    except ValueError:
        found = np.zeros(0)
    if len(found) != count:
        raise FormatError(f"{name} must be {count} numbers, got {node.get(name)!r:.60}")
    return found


def _chosen(
    piece: ElementTree.Element, points: FloatArray
) -> tuple[ElementTree.Element, list[int]]:
    """The array that is read, of cells before points, and its shape."""
    for kind in ("CellData", "PointData"):
        data = piece.find(kind)
        arrays = [] if data is None else data.findall("DataArray")
        if data is None or not arrays:
            continue
        name = data.get("Scalars")
        found = next((a for a in arrays if a.get("Name") == name), arrays[0])
        if found.get("NumberOfComponents", "1") != "1":
            raise FormatError(f"{found.get('Name')!r:.60} has several components per voxel")
        shape = np.maximum(points - 1, 1) if kind == "CellData" else points
        if not (np.isfinite(shape).all() and (shape >= 1).all()):
            raise FormatError("WholeExtent holds no voxels")
        return found, [int(n) for n in shape]
    raise FormatError("holds no values")


class _Reader:
    """Bytes of arrays, wherever they are."""

    def __init__(self, root: ElementTree.Element, tail: bytes, size: int) -> None:
        self.order = "<" if root.get("byte_order", "LittleEndian") == "LittleEndian" else ">"
        self.head = np.dtype(self.order + _TYPES.get(root.get("header_type", "UInt32"), "u4"))
        self.compressor = root.get("compressor", "")
        self.size = size
        found = re.match(rb"[^>]*encoding\s*=\s*[\"'](\w+)[\"'][^>]*>\s*_", tail)
        self.encoding = found[1].decode() if found else "raw"
        self.tail = tail[found.end() :] if found else b""

    def values(self, node: ElementTree.Element, shape: list[int]) -> AnyArray:
        """The numbers of an array of this shape, x fastest."""
        kind = _TYPES.get(node.get("type", ""))
        if kind is None:
            raise FormatError(f"numbers of type {node.get('type')!r:.40} are not read")
        dtype = np.dtype(self.order + kind)
        count = shape[0] * shape[1] * shape[2]
        room = count * dtype.itemsize
        if room > self.size * (GROWTH if self.compressor else 4):
            raise FormatError(
                f"says {count:.3g} voxels, which {self.size} bytes do not hold; if they are all "
                "alike, save them without compression"
            )
        need(2 * room, f"{count} voxels", "take fewer of them")
        if node.get("format") == "ascii":
            return _counted(np.array((node.text or "").split(), dtype), count)
        if node.get("format") == "appended":
            at = node.get("offset", "")
            if not at.isdecimal() or int(at) >= len(self.tail):
                raise FormatError(f"the offset {at!r:.40} is none of the appended data")
            data, plain = self.tail[int(at) :], self.encoding == "raw"
        else:
            data, plain = (node.text or "").strip().encode(), False
        found = self._bytes(data, plain, room)
        return _counted(
            np.frombuffer(found[: len(found) // dtype.itemsize * dtype.itemsize], dtype), count
        )

    def _bytes(self, data: bytes, plain: bool, room: int) -> bytes:
        """So many bytes of an array."""
        if self.compressor:
            return self._unpacked(data, plain, room)
        head = self.head.itemsize
        found = data if plain else _decoded(data, head + room)
        length = [int(n) for n in np.frombuffer(found[:head], self.head)]
        return found[head : head + sum(length)]

    def _unpacked(self, data: bytes, plain: bool, room: int) -> bytes:
        """So many bytes of an array in compressed blocks."""
        if self.compressor not in _UNPACK:
            told = f"is compressed by {self.compressor!r:.60}"
            raise FormatError(f"{told}; save it with zlib or without")
        first = 3 * self.head.itemsize
        start = data[:first] if plain else _decoded(data, first)[:first]
        if len(start) < first:
            raise FormatError("ends within the head of an array")
        blocks, size, last = (int(n) for n in np.frombuffer(start, self.head))
        whole = (3 + blocks) * self.head.itemsize
        if blocks * self.head.itemsize > len(data) or min(blocks, size, last) < 0:
            raise FormatError(f"says {blocks} compressed blocks, which the file does not hold")
        if plain:
            table, body = data[first:whole], data[whole:]
        else:
            letters = -(-whole // 3) * 4  # the head is encoded by itself
            table = _decoded(data[:letters], whole)[first:whole]
        lengths = [int(n) for n in np.frombuffer(table, self.head)]
        if not plain:
            body = _decoded(data[letters:], sum(lengths))
        out, at = bytearray(), 0
        for i, length in enumerate(lengths):
            asked = last if last and i == blocks - 1 else size
            out += _UNPACK[self.compressor](body[at : at + length], min(asked, room - len(out)))
            at += length
            if len(out) >= room:
                break
        return bytes(out)


def _decoded(data: bytes, size: int) -> bytes:
    """The first bytes of base64."""
    letters = data[: -(-size // 3) * 4]
    try:
        return base64.b64decode(letters)
    except binascii.Error as e:
        raise FormatError(f"is no base64: {e}") from e


def _counted(values: AnyArray, count: int) -> AnyArray:
    if len(values) != count:
        raise FormatError(f"holds {len(values)} values of {count} voxels")
    return values
