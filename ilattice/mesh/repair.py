"""Removal of slivers: local collapses of edges and flips of diagonals, no vertex moves.

Vertices that were moved onto a surface after its mesh was made may come to lie almost upon each
other, or in a row. What is left there are triangles without area, which collapse when they are
rounded to single precision and spoil every finite element.

Guarantees
----------
- Vertices keep their places; some are dropped. Only triangles next to a bad one change.
- Closed, manifold and oriented as before, with the same Euler number.
- Features stay: a vertex is merged only into one that lies on all of its surfaces, along an edge
  that lies on them, and no triangle changes between the wall and a cap, or from cap to cap.
- No triangle turns by more than 60 degrees, and none becomes worse than the worst it replaces.
- Deterministic; linear time and memory, the latter 22 bytes per triangle besides the copies.

Not guaranteed
--------------
- That every bad triangle can be repaired: those on thin features may stay, and are counted.
- Freedom from self-intersections, as before.
"""

from typing import Any, NamedTuple

import numpy as np

from ilattice._typing import AnyArray, IntArray
from ilattice.mesh import _kernels_repair as kernels
from ilattice.mesh.contouring import ON_CAP
from ilattice.mesh.measure import triangle_quality

#: Quality of triangles that are mended: 1 is equilateral, 0 a line.
QUALITY = 0.3
ROUNDS = 10


class Repair(NamedTuple):
    """A mesh without slivers.

    Attributes
    ----------
    vertices : (W,) array
        Which of the old vertices are left, ascending; where anything was repaired, those of faces.
    faces : (G, 3) array of int32 or int64
        Corners, as numbers of rows of `vertices`; of the type of the old ones.
    rows : (G,) array
        Which of the old faces they are, or have come from, ascending.
    collapses, flips : int
        Numbers of collapsed edges and of flipped ones.
    left : int
        Faces that are still bad.
    """

    vertices: IntArray
    faces: AnyArray
    rows: IntArray
    collapses: int
    flips: int
    left: int


def remove_slivers(
    x: AnyArray,
    faces: AnyArray,
    kind: AnyArray | None = None,
    *,
    quality: float = QUALITY,
    spared: AnyArray | None = None,
) -> Repair:
    """Repair triangles of low quality.

    Parameters
    ----------
    x : (V, 3) array
        Vertices.
    faces : (F, 3) array of int32 or int64
        Corners of a manifold, oriented mesh, three different ones each; are not changed.
    kind : (V,) array of uint8, optional
        Constraints of the vertices as in `Contour`; none by default.
    quality : float
        Faces with ``4 sqrt(3) area / sum of squared sides`` below it are bad.
    spared : (V,) array of bool, optional
        Vertices whose faces are left as they are, however bad.

    Returns
    -------
    Repair
        Vertices that are left, new faces, what was done.
    """
    poor = triangle_quality(x, faces) < quality
    if spared is not None:
        poor &= ~spared[faces].any(axis=1)
    bad = np.flatnonzero(poor)
    if len(bad) == 0:
        return Repair(np.arange(len(x)), faces, np.arange(len(faces)), 0, 0, 0)
    faces = faces.copy()
    corner: Any = np.int32 if faces.size < np.iinfo(np.int32).max else np.int64
    head, after = np.full(len(x), -1, corner), np.empty(faces.size, corner)
    kernels.link_corners(faces, head, after)
    on = _surfaces(kind, len(x))
    changed, tried = np.zeros(len(x), corner), np.full(len(faces), -1, corner)
    done, before = np.zeros(2, np.int64), -1
    for _ in range(ROUNDS):
        if len(bad) == 0 or done.sum() == before:
            break
        before = done.sum()
        left = np.zeros(len(faces), np.bool_)
        kernels.repair(x, faces, on, head, after, bad, quality, left, changed, tried, done)
        bad = np.flatnonzero(left)
        if spared is not None:
            bad = bad[~spared[faces[bad]].any(axis=1)]
    kept = np.flatnonzero(head >= 0)
    number = np.full(len(x), -1, faces.dtype)
    number[kept] = np.arange(len(kept), dtype=faces.dtype)
    rows = np.flatnonzero(faces[:, 0] >= 0)
    faces = number[faces[rows]]
    worse = int((triangle_quality(x[kept], faces) < quality).sum())
    return Repair(kept, faces, rows, int(done[0]), int(done[1]), worse)


def _surfaces(kind: AnyArray | None, count: int) -> AnyArray:
    """Surfaces of the vertices, a bit for each, as `_kernels_repair` wants them."""
    if kind is None:
        return np.full(count, kernels.WALL, np.int16)
    wall = np.where(kind & ON_CAP, 0, kernels.WALL)
    return (kind & kernels.CAPS | wall).astype(np.int16)
