"""Contouring: from an implicit field on a box to triangles, by dual contouring of pruned blocks.

The solid is ``{field < level}``, or ``{lower < field < upper}`` for a pair of levels, inside the
box D that the grid planes span. One vertex per patch of the surface and cell, one quad per crossed
grid edge, split along the better diagonal. The grid is padded by one ghost layer of outside
samples beyond each face of D, and the vertices of ghost cells are constrained to that face (edge,
corner) of D: caps are exactly planar, and their edges and corners are sharp.

Guarantees
----------
- Closed, manifold (edges and vertices) and consistently oriented outwards, whatever the signs:
  what happens on the face between two cells depends on shared samples only, without tolerances.
- Every vertex lies in its own cell; no triangle is degenerate in the coordinates of the axes.
- Rigorous: a block is skipped only where the bounds of the field exclude the surface.
- Output is the same for any number of threads; memory is proportional to the surface (and one
  slab), of `contour_blocks` to one slab.

Not guaranteed
--------------
- Features thinner than a cell are seen only where they hold a grid point. The outermost samples
  are taken 0.15 of a cell inside the faces of D, so vertices on the edges of caps may be off
  the level set by part of a cell where the surface grazes a face.
- Freedom from self-intersections: none has been found with ``place="linear"``, not even in noise,
  and none in resolved surfaces otherwise; but there is no proof, and refined vertices of sheets
  thinner than a cell may cross.
- Fields without `range` (or `lipschitz`) are sampled everywhere.
"""

from collections.abc import Iterator
from typing import Any, Literal

import numpy as np

from ilattice._progress import Progress
from ilattice._typing import AnyArray, Solid
from ilattice._validate import among, as_array, as_float_type
from ilattice.errors import InputError
from ilattice.fields.solids import field_of
from ilattice.mesh import _kernels_refine
from ilattice.mesh._grid import Grid
from ilattice.mesh._kernels_cells import CAP, LOWER
from ilattice.mesh._samplers import sampler_for
from ilattice.mesh._tracer import Contour, Tracer
from ilattice.mesh.surface import SurfaceMesh

__all__ = [
    "ON_CAP",
    "ON_LOWER",
    "Contour",
    "contour",
    "contour_arrays",
    "contour_blocks",
    "split_quads",
]

ON_CAP = CAP
ON_LOWER = LOWER
RESERVE = 1 << 26  # bytes; memory that is never written costs nothing


def contour(field: Any, axes: Any, **options: Any) -> SurfaceMesh:
    """Surface of the solid where a field is below a level, as a mesh.

    Parameters
    ----------
    field : callable or Solid
        Function of points (n, 3) to values (n,); or a solid, such as a wall, which is contoured
        over its parameters. Used where it has them: `range(lo, hi)` (or a
        number `lipschitz`) to skip empty blocks, `jet(points, order=1)` to place vertices.
        `TrigField` and scalar `BSpline` are sampled in compiled code.
    axes : three 1-D arrays
        Grid planes, increasing, not necessarily evenly spaced. The first and the last ones are
        the faces of the box D.
    **options
        As in `contour_arrays`.

    Returns
    -------
    SurfaceMesh
        Triangles in the coordinates of the axes.

    Raises
    ------
    InputError
        For axes that do not increase, levels that are not finite, fields of the wrong shape.
    GeometryError
        Where there is no surface (the message names the range of the field) or the field is NaN.
    """
    vertices, faces = _join(contour_blocks(field, axes, **options), "vertices", "faces")
    return SurfaceMesh._adopt(vertices, faces)


def contour_arrays(
    field: Any,
    axes: Any,
    *,
    level: float | tuple[float, float] = 0.0,
    scale: Any = None,
    caps: bool = True,
    wrap: bool | tuple[bool, bool, bool] = False,
    place: Literal["refine", "linear"] = "refine",
    dtype: Any = np.float64,
    progress: Progress = None,
) -> Contour:
    """Surface of the solid where a field is below a level, as arrays.

    Parameters
    ----------
    field, axes : callable and three 1-D arrays
        As in `contour`.
    level : float or (float, float)
        The solid is ``field < level``, or ``lower < field < upper``.
    scale : callable, optional
        Positive function of points: the field is divided by it. A wall of half-thickness d(u)
        about the zero set of S is ``contour(S, axes, level=(-1, 1), scale=d)``.
    caps : bool
        Whether the faces of D close the solid. Without caps the surface ends on the faces of D.
    wrap : bool or three
        Directions that are closed: the last plane is the first one. There are no caps, and
        triangles cross the seam; their vertices lie in [first, last).
    place : {"refine", "linear"}
        Vertices at the mean of the linear crossings of their patch; "refine" adds two Newton
        steps onto the level set, inside the cell.
    dtype : float64 or float32
        Type of the vertices.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Returns
    -------
    Contour
        Vertices, faces, and the constraints of the vertices.

    Raises
    ------
    InputError, GeometryError
        As in `contour`.
    """
    pieces = contour_blocks(
        field, axes, level=level, scale=scale, caps=caps, wrap=wrap, place=place, dtype=dtype,
        progress=progress,
    )  # fmt: skip
    vertices, faces, kind = _join(pieces, "vertices", "faces", "kind")
    return Contour(vertices, faces, kind)


def _join(pieces: Iterator[Contour], *names: str) -> list[AnyArray]:
    """Attributes of all pieces, each as one array that grows in place."""
    arrays: list[AnyArray] = []
    ends = [0] * len(names)
    for piece in pieces:
        parts = [getattr(piece, name) for name in names]
        arrays = arrays or [_reserve(part) for part in parts]
        for i, part in enumerate(parts):
            if part.dtype != arrays[i].dtype:  # ids have become too large for 32 bits
                arrays[i] = arrays[i].astype(part.dtype)
            first, ends[i] = ends[i], ends[i] + len(part)
            if ends[i] > len(arrays[i]):
                _resize(arrays[i], ends[i])
            arrays[i][first : ends[i]] = part
        del piece, parts, part  # not to hold them while the next piece is made
    for array, end in zip(arrays, ends, strict=True):
        _resize(array, end)
    return arrays


def _reserve(like: AnyArray) -> AnyArray:
    """A large empty array: as such it lies apart from small ones, and can grow without a copy."""
    row = like.itemsize * int(np.prod(like.shape[1:]))
    return np.empty((RESERVE // row, *like.shape[1:]), like.dtype)


def _resize(a: AnyArray, rows: int) -> None:
    """Change the length of an array in place: the allocator moves pages, not bytes."""
    a.resize((rows, *a.shape[1:]), refcheck=False)


def contour_blocks(
    field: Any,
    axes: Any,
    *,
    level: float | tuple[float, float] = 0.0,
    scale: Any = None,
    caps: bool = True,
    wrap: bool | tuple[bool, bool, bool] = False,
    place: Literal["refine", "linear"] = "refine",
    dtype: Any = np.float64,
    progress: Progress = None,
) -> Iterator[Contour]:
    """`contour_arrays` in pieces, for surfaces larger than memory.

    Parameters
    ----------
    field, axes, level, scale, caps, wrap, place, dtype, progress : optional
        As in `contour_arrays`, of which these are the consecutive pieces.

    Returns
    -------
    iterator of Contour
        Slabs along the first axis. `faces` hold ids that count through all slabs: vertex `i` of a
        piece has id ``first_vertex + i``. A face may name vertices of earlier pieces.

    Raises
    ------
    InputError, GeometryError
        As in `contour`.
    """
    grid = Grid.checked(axes, wrap)
    if isinstance(field, Solid):
        field = field_of(field)
    if not callable(field) or not (scale is None or callable(scale)):
        raise InputError(f"field and scale must be callable, got {field!r:.60}, {scale!r:.60}")
    if not among(place, ("refine", "linear")):
        raise InputError(f"place must be 'refine' or 'linear', got {place!r}")
    sampler = sampler_for(field, grid, _as_levels(level), scale)
    tracer = Tracer(sampler, bool(caps), place == "refine", as_float_type("dtype", dtype))
    return tracer.pieces(progress)


def split_quads(vertices: AnyArray, faces: AnyArray) -> None:
    """Choose the diagonals of a contour's quads again, in place, after its vertices moved.

    Parameters
    ----------
    vertices : (V, 3) array
        The moved vertices, for example mapped to space.
    faces : (F, 3) array of int32 or int64
        Faces of a `Contour`, changed in place.
    """
    _kernels_refine.resplit(len(faces) // 2, vertices, faces)


def _as_levels(level: Any) -> tuple[float, float]:
    pair = as_array("level", level)
    if pair.size == 1:
        return -np.inf, float(pair.ravel()[0])
    if pair.shape != (2,) or not pair[0] < pair[1]:
        raise InputError(f"level must be one number or a pair (lower, upper), got {level!r:.80}")
    return float(pair[0]), float(pair[1])
