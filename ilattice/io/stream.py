"""Writers for meshes larger than memory: STL and PLY, block by block.

Guarantees: memory does not grow with the number of blocks; the file appears under its name only
when it is complete. Meanwhile an unnamed file on the same disk holds what comes too early: for PLY
the faces (the format wants all vertices first), for STL the vertices (later faces may name them).
"""

import os
import shutil
import tempfile
from collections import deque
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from types import TracebackType
from typing import IO, Protocol, Self

import numpy as np

from ilattice._files import as_path, atomic_write
from ilattice._shown import one_line
from ilattice._typing import AnyArray
from ilattice.errors import FormatError, GeometryError, InputError
from ilattice.io import ply, stl
from ilattice.io._mesh import blocks, check_single, warn_collapsed, write_records

#: Bytes kept for a header; bytes copied at once; blocks of vertices that faces may name.
_HEADER_SIZE = 4096
_COPY = 1 << 24
_RECENT = 2


class StreamedMeshWriter:
    """Write a mesh to STL or PLY as its blocks arrive.

    Parameters
    ----------
    path : path-like
        File to create or to replace, ending in ``.stl`` or ``.ply``.
    precision : {"single", "double"}, optional
        PLY only: type of coordinates and real data; by default that of the first block.

    Raises
    ------
    FormatError
        Another ending, or the file cannot be written.

    Examples
    --------
    >>> with StreamedMeshWriter("large.ply") as writer:  # doctest: +SKIP
    ...     for vertices, faces in slabs:
    ...         writer.append(vertices, faces)
    """

    def __init__(self, path: str | os.PathLike[str], *, precision: str | None = None) -> None:
        self._path = as_path("path", path)
        suffix = self._path.suffix.lower()
        if suffix not in (".stl", ".ply"):
            raise FormatError(f"cannot stream to {str(path)!r}: the ending must be .stl or .ply")
        if precision is not None and not isinstance(precision, str):
            raise InputError(f"precision must be a word, got {precision!r:.80}")
        if suffix == ".stl" and precision not in (None, "single"):
            raise InputError(f"STL is in single precision, got precision={precision!r:.80}")
        self._precision = precision
        self._stack = ExitStack()
        self._sink: _Sink | None = None
        self.vertex_count = 0
        self.face_count = 0

    def __repr__(self) -> str:
        return one_line(f"StreamedMeshWriter({str(self._path)!r}, {self.face_count} faces)")

    def __enter__(self) -> Self:
        """Open a temporary file beside the target."""
        with ExitStack() as stack:
            file = stack.enter_context(atomic_write(self._path))
            spill = tempfile.TemporaryFile(dir=self._path.resolve().parent)
            stack.enter_context(spill)
            if self._path.suffix.lower() == ".stl":
                self._sink = _StlSink(file, spill)
            else:
                self._sink = _PlySink(file, spill, self._precision)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Complete the file and give it its name, or after an error leave nothing behind."""
        with self._stack:
            if error is not None:
                raise error
            if self._sink is None or self.face_count == 0:
                raise GeometryError("the mesh has no triangles: nothing to write")
            self._sink.finish((self.vertex_count, self.face_count))

    def append(
        self,
        vertices: AnyArray,
        faces: AnyArray,
        point_data: Mapping[str, AnyArray] | None = None,
    ) -> None:
        """Write a block.

        Parameters
        ----------
        vertices : (n, 3) array
            New vertices; they are numbered on from those of the blocks before.
        faces : (m, 3) array of integers
            New faces, in the numbers of the whole mesh.
        point_data : mapping of str to (n,) or (n, c) array, optional
            PLY only: data on the new vertices, the same names and types in every block.

        Raises
        ------
        InputError
            If a face names a vertex that is not there yet.
        FormatError
            If the file cannot be written.
        """
        if self._sink is None:
            raise InputError("append works inside of 'with StreamedMeshWriter(...)' only")
        vertices, faces = np.asarray(vertices), np.asarray(faces)
        for name, block in (("vertices", vertices), ("faces", faces)):
            if block.ndim != 2 or block.shape[1] != 3:
                raise InputError(f"{name} must have shape (n, 3), got {block.shape}")
        for name, a in (point_data or {}).items():
            if len(a) != len(vertices):
                raise InputError(
                    f"point_data[{name!r}] has {len(a)} rows for {len(vertices)} vertices"
                )
        known = self.vertex_count + len(vertices)
        if len(faces) and not 0 <= int(faces.min()) <= int(faces.max()) < known:
            wrong = int(faces.max()) if faces.max() >= known else int(faces.min())
            raise InputError(
                f"a face names vertex {wrong}, there are {known} so far; append vertices first"
            )
        self._sink.write(vertices, faces, self.vertex_count, point_data or {})
        self.vertex_count += len(vertices)
        self.face_count += len(faces)


def write_stream(
    path: str | os.PathLike[str],
    blocks: Iterable[tuple[AnyArray, AnyArray]],
    *,
    precision: str | None = None,
) -> tuple[int, int]:
    """Write all blocks of an iterable.

    Parameters
    ----------
    path : path-like
        File to create or to replace, ending in ``.stl`` or ``.ply``.
    blocks : iterable of (vertices, faces)
        As for `StreamedMeshWriter.append`.
    precision : {"single", "double"}, optional
        As for `StreamedMeshWriter`.

    Returns
    -------
    vertices, faces : int
        How many were written.
    """
    told = "blocks must be an iterable of pairs (vertices, faces)"
    if not isinstance(blocks, Iterable) or (isinstance(blocks, np.ndarray) and not blocks.ndim):
        raise InputError(f"{told}, got {blocks!r:.80}")
    with StreamedMeshWriter(path, precision=precision) as writer:
        for block in blocks:
            if not isinstance(block, (tuple, list)) or len(block) != 2:
                raise InputError(f"{told}, got {block!r:.80} in it")
            writer.append(*block)
    return writer.vertex_count, writer.face_count


class _Sink(Protocol):
    """A format under construction."""

    def write(
        self,
        vertices: AnyArray,
        faces: AnyArray,
        first: int,
        point_data: Mapping[str, AnyArray],
    ) -> None:
        """Take a block whose vertices are numbered from `first`."""

    def finish(self, counts: tuple[int, int]) -> None:
        """Complete the file of so many vertices and faces."""


class _StlSink:
    """Triangles as they come; all vertices go to an unnamed file, the latest stay in memory."""

    def __init__(self, file: IO[bytes], spill: IO[bytes]) -> None:
        self._file = file
        self._spill = spill
        self._recent: deque[AnyArray] = deque(maxlen=_RECENT)
        self._collapsed = 0
        stl.write_header(file, 0)

    def write(
        self,
        vertices: AnyArray,
        faces: AnyArray,
        first: int,
        point_data: Mapping[str, AnyArray],
    ) -> None:
        if point_data:
            raise InputError("STL holds no point data; stream to .ply")
        check_single(vertices, "STL", 0.0)
        narrow = np.array(vertices, dtype=np.float32, order="C")
        write_records(self._spill, narrow)
        self._recent.append(narrow)
        known = np.concatenate(self._recent)
        oldest = first + len(narrow) - len(known)
        for rows in blocks(len(faces)):
            records, lost = stl.triangle_records(*self._near(faces[rows], known, oldest))
            write_records(self._file, records)
            self._collapsed += lost

    def _near(self, faces: AnyArray, known: AnyArray, oldest: int) -> tuple[AnyArray, AnyArray]:
        """Vertices and faces numbered in them; those before number `oldest` are on the disk."""
        early = faces < oldest
        if not early.any():
            return known, faces - oldest
        self._spill.flush()
        stored = np.memmap(self._spill, np.float32, mode="r", shape=(oldest, 3))
        corners = known[np.maximum(faces - oldest, 0)]
        corners[early] = stored[faces[early]]
        return corners.reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)

    def finish(self, counts: tuple[int, int]) -> None:
        self._file.seek(0)
        stl.write_header(self._file, counts[1])
        warn_collapsed(self._collapsed, "STL")


class _PlySink:
    """Vertices into the file behind room for a header, faces into an unnamed file."""

    def __init__(self, file: IO[bytes], spill: IO[bytes], precision: str | None) -> None:
        self._file = file
        self._precision = precision
        self._vertex: ply.VertexRecords | None = None
        self._face = ply.FaceRecords()
        self._spill = spill
        file.write(b" " * _HEADER_SIZE)

    def write(
        self,
        vertices: AnyArray,
        faces: AnyArray,
        first: int,
        point_data: Mapping[str, AnyArray],
    ) -> None:
        ply.check_count(first + len(vertices))
        layout = ply.VertexRecords(vertices, point_data, self._precision)
        if self._vertex is None:
            self._head(layout, (2**31 - 1, 2**62))  # refuse what will not fit before the work
            self._vertex = layout
        if layout.dtype != self._vertex.dtype:
            raise InputError(
                f"point_data must have the names and types of the first block, "
                f"{self._vertex.dtype.names}, got {layout.dtype.names}"
            )
        for rows in blocks(len(vertices)):
            write_records(self._file, layout.block(vertices, point_data, rows))
        for rows in blocks(len(faces)):
            write_records(self._spill, self._face.block(faces, {}, rows))

    def finish(self, counts: tuple[int, int]) -> None:
        assert self._vertex is not None
        self._spill.seek(0)
        shutil.copyfileobj(self._spill, self._file, _COPY)
        self._file.seek(0)
        self._file.write(self._head(self._vertex, counts))

    def _head(self, vertex: ply.VertexRecords, counts: tuple[int, int]) -> bytes:
        head = ply.header(vertex.dtype, counts[0], self._face.dtype, counts[1], _HEADER_SIZE)
        if len(head) != _HEADER_SIZE:
            raise InputError("too many or too long names of point data for a streamed PLY file")
        return head
