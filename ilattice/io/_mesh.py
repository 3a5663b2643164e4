"""What the mesh formats share: triangles as arrays, blocks, colours, the narrow numbers of files.

Guarantee: nothing here copies a whole mesh; writers go through it block by block.
"""

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import IO, ClassVar, Protocol, runtime_checkable

import numpy as np

from ilattice._typing import AnyArray
from ilattice._validate import Frozen
from ilattice.errors import FormatError, GeometryError, InputError, PrecisionWarning

#: Rows that are written at once: as numbers, and as text.
BLOCK = 1 << 18
TEXT_BLOCK = 1 << 14
_COLOUR = ("r", "g", "b")
#: Sizes of coordinates that single precision holds with its seven digits.
_SINGLE = 1e-30, 3e38


@runtime_checkable
class Triangles(Protocol):
    """Triangles with named data, as writers take them: a `SurfaceMesh`, or `MeshArrays`."""

    @property
    def vertices(self) -> AnyArray:
        """Points, shape (V, 3)."""

    @property
    def faces(self) -> AnyArray:
        """Corners, shape (F, 3)."""

    @property
    def point_data(self) -> Mapping[str, AnyArray]:
        """Named data on the vertices."""

    @property
    def cell_data(self) -> Mapping[str, AnyArray]:
        """Named data on the faces."""


class BeamArrays(Protocol):
    """Beams between points, as writers take them."""

    @property
    def vertices(self) -> AnyArray:
        """Points, shape (V, 3)."""

    @property
    def pairs(self) -> AnyArray:
        """Ends of the beams, shape (e, 2)."""

    @property
    def radii(self) -> AnyArray:
        """Radii at the ends, shape (e, 2)."""


class PatchArrays(Protocol):
    """Bezier patches of degree 2, as writers take them."""

    @property
    def quads(self) -> AnyArray:
        """Controls, shape (q, 3, 3, 3)."""

    @property
    def triangles(self) -> AnyArray:
        """Controls, shape (t, 6, 3): corners, then sides 01, 12, 20."""


@dataclass(frozen=True, eq=False)
class MeshArrays(Frozen):
    """Triangles as a file has them.

    Attributes
    ----------
    vertices : (V, 3) array
        Points.
    faces : (F, 3) array of integers
        Corners.
    point_data, cell_data : mapping of str to array
        Named data on vertices and faces.
    """

    file_kind: ClassVar[str] = "mesh"
    vertices: AnyArray
    faces: AnyArray
    point_data: Mapping[str, AnyArray] = field(default_factory=dict)
    cell_data: Mapping[str, AnyArray] = field(default_factory=dict)


#: Triangles that are looked at for rounding, and the part of an edge from which it is told.
SAMPLED, ROUNDED = 20_000, 0.01


def blocks(count: int, size: int = BLOCK) -> Iterator[slice]:
    """Slices that cover ``range(count)`` in order."""
    for lo in range(0, count, size):
        yield slice(lo, min(count, lo + size))


def check_mesh(mesh: Triangles) -> None:
    """Refuse to write what is no mesh, or one without triangles, which no reader takes.

    Raises
    ------
    InputError
        If vertices or faces are no arrays as they should be, or faces name no vertices.
    GeometryError
        If there are no triangles.
    """
    x, corners = mesh.vertices, mesh.faces
    for name, a, kinds, told in (
        ("vertices", x, "f", "reals"),
        ("faces", corners, "iu", "integers"),
    ):
        if (
            not isinstance(a, np.ndarray)
            or a.ndim != 2
            or a.shape[1] != 3
            or a.dtype.kind not in kinds
        ):
            raise InputError(f"{name} must be an array (n, 3) of {told}, got {a!r:.80}")
    if len(corners) == 0:
        raise GeometryError("the mesh has no triangles: nothing to write")
    least, most = int(corners.min()), int(corners.max())
    if least < 0 or most >= len(x):
        raise InputError(f"faces must name vertices from 0 to {len(x) - 1}, got {least} to {most}")


def check_single(
    vertices: AnyArray, name: str, least: float = _SINGLE[0], most: float = _SINGLE[1]
) -> None:
    """Refuse coordinates that single precision, or the format, does not hold.

    Raises
    ------
    FormatError
        If the largest of them is below `least` or above `most`.
    """
    size = float(max(vertices.max(initial=0.0), -vertices.min(initial=0.0)))
    if least <= size <= most:
        return
    raise FormatError(
        f"{name} holds coordinates from {least:g} to {most:g}, and the largest is "
        f"{size:.3g}; scale the part, or write .vtp"
    )


def colours(point_data: Mapping[str, AnyArray]) -> AnyArray | None:
    """The data ``r``, ``g``, ``b`` as bytes, shape (V, 3), or None if they are not all there.

    Numbers from 0 to 1 are scaled to 0 to 255, and clipped; bytes are taken as they are.
    """
    if not all(name in point_data for name in _COLOUR):
        return None
    channels = [point_data[name] for name in _COLOUR]
    if any(c.ndim != 1 for c in channels):
        raise InputError("colours r, g, b must be one number per vertex, shape (V,)")
    bad = int((~np.isfinite(np.stack(channels))).any(axis=0).sum())
    if bad:
        raise InputError(
            f"colours r, g, b are not finite at {bad} of {len(channels[0])} vertices: use 0 to 1"
        )
    return np.stack([_as_byte(c) for c in channels], axis=1)


def without_colours(point_data: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
    """The data that are not colours."""
    if not all(name in point_data for name in _COLOUR):
        return dict(point_data)
    return {name: a for name, a in point_data.items() if name not in _COLOUR}


def write_records(file: IO[bytes], records: AnyArray) -> None:
    """Append the bytes of an array (unlike ``tofile`` also to pipes, and with the true error)."""
    file.write(records.view(np.uint8).data)


def _as_byte(channel: AnyArray) -> AnyArray:
    if channel.dtype == np.uint8:
        return channel
    return np.rint(np.clip(channel, 0.0, 1.0) * 255.0).astype(np.uint8)


def collapsed(corners: AnyArray) -> int:
    """Number of triangles (n, 3, 3) with two equal corners."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    return int(((a == b).all(1) | (b == c).all(1) | (c == a).all(1)).sum())


def warn_rounded(mesh: Triangles, name: str) -> None:
    """Tell that single precision moves vertices by a part of the length of edges that counts."""
    some = mesh.faces[:: max(len(mesh.faces) // SAMPLED, 1)]
    x = np.asarray(mesh.vertices, np.float64)[some]
    off = float(np.abs(x - x.astype(np.float32)).max())
    edge = float(np.median(np.linalg.norm(x[:, 0] - x[:, 1], axis=1)))
    if off > ROUNDED * edge:
        warnings.warn(
            f"{name} holds single precision: vertices move by up to {off:.2g}, "
            f"{100 * off / edge:.2g} % of the length of an edge; move the part to the origin",
            PrecisionWarning,
            stacklevel=5,
        )


def warn_collapsed(count: int, name: str) -> None:
    """Tell that rounding to the file's numbers made triangles degenerate."""
    if count:
        warnings.warn(
            f"{count} triangles collapse in the single precision of {name}, readers will have to "
            "repair them; move the part to the origin, or mesh with a larger h",
            PrecisionWarning,
            stacklevel=5,
        )
