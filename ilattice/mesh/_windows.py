"""Windows: parts of a mesh around what moves, in which all is done that would be done to the whole.

A mesh is made from quads in pairs of rows, and repaired: triangles of some rows then have other
corners, or are gone. Rows that were changed form patches, which are linked by common vertices. The
edge of a patch is the same before and after, so that patches may be made from their quads again one
by one.

Guarantees
----------
- All triangles in marked voxels are in the window, and the patches they belong to as a whole, with
  all that is next to these.
- A window has the same edge before and after it is made anew, if its border is spared then and does
  not move: it fits the rest.
"""

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ilattice._typing import AnyArray, IntArray
from ilattice.mesh._voxels import Voxels, in_marked


class Window(NamedTuple):
    """Part of a mesh, with vertices that are counted in it.

    Attributes
    ----------
    rows : (n,) array
        Rows of the mesh in it, ascending.
    vertices : (m,) array
        Its vertices, ascending.
    quads : (n, 3) array
        The rows before repair.
    fixed : (m,) array of bool
        Vertices of triangles that are not in it, or belong to patches that are not made anew.
    frozen : (n,) array of bool
        Rows that are not made from quads again: of such patches.
    now : (n, 3) array
        The rows after repair, -1 where they are gone.
    mask : (k, k, k) array of bool
        Voxels of which all triangles are in it.
    """

    rows: IntArray
    vertices: IntArray
    quads: AnyArray
    fixed: AnyArray
    frozen: AnyArray
    now: AnyArray
    mask: AnyArray


class Rows(NamedTuple):
    """Rows of a mesh: before repair, and after it, where those that are gone hold -1.

    Attributes
    ----------
    quads, faces : (F, 3) array
        Corners.
    changed : (F,) array of bool
        Rows that repair has changed.
    paired : bool
        Whether two rows are a quad, of which the diagonal is chosen.
    """

    quads: AnyArray
    faces: AnyArray
    changed: AnyArray
    paired: bool


def whole(rows: Rows, vertices: int, grid: Voxels) -> Window:
    """All of a mesh."""
    none = np.zeros(len(rows.quads), np.bool_)
    return Window(
        np.arange(len(rows.quads)), np.arange(vertices), rows.quads,
        np.zeros(vertices, np.bool_), none, rows.quads, np.ones((grid.n,) * 3, np.bool_),
    )  # fmt: skip


def around(x: AnyArray, rows: Rows, grid: Voxels, mask: AnyArray, near: AnyArray) -> Window:
    """What is in marked voxels, and next to it; patches with a vertex in `near` are made anew."""
    now = np.where(rows.faces < 0, rows.quads, rows.faces)
    at, inner = _patches(now, rows, near)
    frozen = np.zeros(len(now), np.bool_)
    frozen[at[~inner]] = True
    voxel = grid.of(x)
    hit = _paired(in_marked(voxel, now, mask) | in_marked(voxel, rows.quads, mask), rows)
    hit[at[inner]] = True
    part = np.flatnonzero(hit)
    part = _paired(any_corner(_at(len(x), rows.quads[part], now[part])[rows.quads]), rows)
    taken = np.flatnonzero(part)
    vertices, (quads, faces) = numbered(len(x), rows.quads[taken], now[taken])
    fixed = _at(len(x), rows.quads[~part], rows.quads[frozen], now[frozen])[vertices]
    faces[rows.faces[taken, 0] < 0] = -1
    return Window(taken, vertices, quads, fixed, _paired(frozen, rows)[taken], faces, mask)


def numbered(vertices: int, *faces: AnyArray) -> tuple[IntArray, list[AnyArray]]:
    """Vertices of faces, ascending, and the faces with corners counted among these."""
    left = np.flatnonzero(_at(vertices, *faces))
    number = np.empty(vertices, faces[0].dtype)
    number[left] = np.arange(len(left))
    return left, [number[corners] for corners in faces]


def marked(x: AnyArray, faces: AnyArray, grid: Voxels) -> AnyArray:
    """Marks of the voxels that triangles touch, and of those next to these."""
    alone = np.arange(faces.size).reshape(-1, 3)
    mask = grid.marked(grid.of(x[faces.ravel()]), alone, np.ones(len(faces), np.bool_))
    at = np.argwhere(mask)
    for way in np.ndindex(3, 3, 3):
        mask[tuple(np.clip(at + np.array(way) - 1, 0, grid.n - 1).T)] = True
    return mask


def any_corner(corners: AnyArray) -> AnyArray:
    """Which triangles have a corner that is marked, (n,), from marks (n, 3)."""
    return np.asarray(corners[:, 0] | corners[:, 1] | corners[:, 2])


def _paired(mask: AnyArray, rows: Rows) -> AnyArray:
    """Rows that are marked, or whose other half of a quad is."""
    return mask.reshape(-1, 2).any(axis=1).repeat(2) if rows.paired else mask


def _at(vertices: int, *faces: AnyArray) -> AnyArray:
    """Marks of the vertices of faces."""
    out = np.zeros(vertices, np.bool_)
    for corners in faces:
        out[corners] = True
    return out


def _patches(now: AnyArray, rows: Rows, near: AnyArray) -> tuple[IntArray, AnyArray]:
    """Rows that are changed, and which of them belong to patches with a marked vertex."""
    at = np.flatnonzero(rows.changed)
    corners = np.concatenate([rows.quads[at], now[at]], axis=1)
    a, b = corners[:, :-1].ravel(), corners[:, 1:].ravel()
    graph = coo_array((np.ones(len(a), np.bool_), (a, b)), shape=(len(near),) * 2)
    count, patch = connected_components(graph, directed=False)
    inner = np.zeros(count, np.bool_)
    inner[patch[near]] = True
    return at, inner[patch[corners[:, 0]]]
