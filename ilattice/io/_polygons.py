"""What the mesh readers share: from the numbers of a file to a checked `MeshArrays`.

Guarantees: polygons are cut into fans; faces that name a vertex twice are dropped with a warning;
whatever a file claims, memory stays in proportion to its size.
"""

import os
import re
import warnings
from array import array
from collections.abc import Iterator

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.errors import FormatError, PrecisionWarning
from ilattice.io._mesh import MeshArrays
from ilattice.io._scanner import parse_numbers, pieces

_BLOCK = 1 << 14  # triangles that are checked at a time
_LINE = re.compile(r"[^\n]+")


def text_lines(text: str) -> Iterator[tuple[int, str]]:
    """Lines that are not blank, one at a time, with their numbers."""
    number, at = 1, 0
    for match in _LINE.finditer(text):
        if match[0].isspace():
            continue
        number += text.count("\n", at, match.start())
        at = match.start()
        yield number, match[0]


class Points:
    """Points of the lines of a text file."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path, self._values = path, array("d")

    def __len__(self) -> int:
        return len(self._values) // 3

    def add(self, number: int, line: str) -> None:
        """Take the first three words of a line in; refuse it if they are no numbers."""
        tokens = line.split(None, 3)[:3]
        values = parse_numbers(tokens)
        if isinstance(values, int) or len(tokens) != 3:
            found = " ".join(t[:60] for t in tokens)
            raise FormatError(
                f"{self._path}, line {number}: found {found!r:.60}; expected coordinates"
            )
        self._values.extend(values)

    def rows(self) -> FloatArray:
        """The points, shape (n, 3)."""
        return np.array(self._values, np.float64).reshape(-1, 3)


class Polygons:
    """Polygons of the lines of a text file; those of less than three corners are left out."""

    def __init__(self) -> None:
        self.sizes, self.corners = array("q"), array("q")

    def close(self, start: int) -> None:
        """End a polygon whose corners have been put behind the first `start`."""
        size = len(self.corners) - start
        if size < 3:
            del self.corners[start:]
        else:
            self.sizes.append(size)

    def arrays(self) -> tuple[IntArray, IntArray]:
        """Numbers of corners, and all corners."""
        sizes, corners = (
            np.frombuffer(a, np.int64) if len(a) else np.zeros(0, np.int64)
            for a in (self.sizes, self.corners)
        )
        return sizes, corners


def words_of(line: str) -> Iterator[str]:
    """Words of a line, however long it is."""
    for piece in pieces(line):
        yield from piece.split()


def fans(sizes: AnyArray, corners: AnyArray) -> Iterator[IntArray]:
    """Triangles (n, 3) of polygons, some at a time, given their numbers of corners and corners."""
    first = np.cumsum(sizes, dtype=np.int64)
    first -= sizes
    keep = sizes > 2
    first, cuts = first[keep], sizes[keep].astype(np.int64) - 2
    ends = np.cumsum(cuts)
    total = int(ends[-1]) if len(ends) else 0
    for i in range(0, total, _BLOCK):
        step = np.arange(i, min(i + _BLOCK, total))
        polygon = np.searchsorted(ends, step, side="right")
        step -= ends[polygon] - cuts[polygon]
        at = first[polygon]
        yield np.stack([corners[at], corners[at + step + 1], corners[at + step + 2]], axis=1)


def count_triangles(sizes: AnyArray) -> int:
    """Number of triangles of all fans."""
    return int(np.maximum(sizes, 2).sum(dtype=np.int64)) - 2 * len(sizes)


def welded(points: AnyArray) -> tuple[AnyArray, IntArray]:
    """Different points in the order of their first appearance, and the number of each point."""
    points = points + 0.0  # no negative zeros
    order = np.lexsort(points.T)
    ranked = points[order]
    new = np.ones(len(points), np.bool_)
    new[1:] = (ranked[1:] != ranked[:-1]).any(axis=1)
    del ranked
    group = np.cumsum(new) - 1
    first = np.minimum.reduceat(order, np.flatnonzero(new)) if len(points) else order
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    number = np.empty(len(points), np.int64)
    number[order] = rank[group]
    return points[np.sort(first)], number


def checked_mesh(
    path: str | os.PathLike[str],
    vertices: FloatArray | AnyArray,
    sizes: AnyArray,
    corners: AnyArray,
    room: int = 0,
) -> MeshArrays:
    """Mesh of what a file holds.

    Parameters
    ----------
    path : path-like
        The file, for messages.
    vertices : (V, 3) array
        Points, given away.
    sizes : (P,) integer array
        Number of corners of each polygon.
    corners : (C,) integer array
        All corners, one polygon after the other.
    room : int
        Size of the file; faces that would take more than twelve times that are stored as int32.

    Returns
    -------
    MeshArrays
        Of the fans of all polygons, without the triangles that name a vertex twice.

    Raises
    ------
    FormatError
        Coordinates that are not finite, corners that do not exist, no triangles.
    """
    finite = np.isfinite(vertices).all(axis=1)
    if not finite.all():
        i = int(np.argmin(finite))
        raise FormatError(f"{path}: vertex {i} is {vertices[i].tolist()}; expected finite numbers")
    total = count_triangles(sizes)
    narrow = 24 * total > 12 * max(room, 1 << 20) and len(vertices) < 2**31
    faces = np.empty((total, 3), np.int32 if narrow else np.int64)
    seen = kept = 0
    for part in fans(sizes, corners):
        wrong = ((part < 0) | (part >= len(vertices))).any(axis=1)
        if wrong.any():
            i = int(np.argmax(wrong))
            raise FormatError(
                f"{path}: triangle {seen + i} has the corners {part[i].tolist()}; expected numbers "
                f"from 0 to {len(vertices) - 1}, counted from zero"
            )
        a, b, c = part.T
        part = part[(a != b) & (b != c) & (c != a)]
        faces[kept : kept + len(part)] = part
        seen, kept = seen + len(a), kept + len(part)
    if not kept:
        raise FormatError(f"{path}: holds no triangles")
    if kept < total:
        warnings.warn(
            f"{path}: {total - kept} of {total} triangles have two equal corners and were dropped",
            PrecisionWarning,
            stacklevel=5,
        )
    return MeshArrays(np.ascontiguousarray(vertices), faces[:kept])
