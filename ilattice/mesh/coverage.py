"""Whether a mesh has all of a wall: from points of the exact offset surfaces to its triangles.

Guarantee: none of the points is where walls have merged or the domain ends, and distances are those
to triangles. Non-guarantee: holes smaller than the spacing of the points are not seen.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary, ref

import numpy as np
from scipy.spatial import cKDTree

from ilattice._typing import AnyArray, FloatArray
from ilattice.mesh.loss import Loss
from ilattice.mesh.sheets import beside, to_faces
from ilattice.offsets.polish import inside

if TYPE_CHECKING:
    from ilattice.mesh.surface import SurfaceMesh
    from ilattice.offsets.wall import OffsetSolid

#: Part of the surfaces that a mesh may lack without a warning, with edges longer than by default,
#: and as long.
TOLD, TOLD_BY_DEFAULT = 0.02, 0.05
#: Points of the mid-surface at most, and vertices of the mesh next to each that are looked at.
POINTS, VERTICES = 4000, 6
#: Of a wall: along the normal and against it.
SIDES = (1.0, -1.0)
#: Distance from a triangle, relative to its longest edge, within which it covers a point.
NEAR = 0.25
#: Farther away than points are off the offset they may be where it has an edge.
SLACK = 2.0
#: Part of the half-thickness that points of the offset may be off, and that which is left of it
#: where walls have merged: other parts of the mid-surface are nearer. Points looked at for that.
OFF, MERGED, SOME = 0.05, 0.5, 1000


#: What meshes lack, and of which wall: it is told when they are made, and in their report.
_known: WeakKeyDictionary[SurfaceMesh, tuple[ref[OffsetSolid], float]] = WeakKeyDictionary()


def missing_part(wall: OffsetSolid, mesh: SurfaceMesh) -> float:
    """Part of the offset surfaces of a wall that a mesh lacks.

    Parameters
    ----------
    wall : OffsetSolid
        The wall.
    mesh : SurfaceMesh
        A mesh of it.

    Returns
    -------
    float
        From 0 to 1, by area of the mid-surface.
    """
    whose, part = _known.get(mesh, (None, 0.0))
    if whose is None or whose() is not wall:
        part = _missing_part(wall, mesh)
        _known[mesh] = ref(wall), part
    return part


def _missing_part(wall: OffsetSolid, mesh: SurfaceMesh) -> float:
    """See `missing_part`."""
    both = [_beside(wall, side, POINTS) for side in ((1.0,) if wall.thickness.solid else SIDES)]
    there, area, sides = (np.concatenate(parts) for parts in zip(*both, strict=True))
    error, asked = wall._errors(there, sides)
    fine = error <= OFF * np.maximum(np.abs(asked), wall.least_thickness)
    far = ~covered(mesh, wall.lattice.through.x(there[fine]), SLACK * error[fine])
    total = float(area[fine].sum())
    return float(area[fine][far].sum()) / total if total > 0.0 else 0.0


def missing(wall: OffsetSolid, mesh: SurfaceMesh, h: float, *, coarse: bool) -> Loss | None:
    """What to tell of a mesh whose triangles cut off bends of the offset surfaces.

    Parameters
    ----------
    wall : OffsetSolid
        The wall.
    mesh : SurfaceMesh
        Its mesh.
    h : float
        Length of its edges.
    coarse : bool
        Whether these are longer than they are by default.

    Returns
    -------
    Loss or None
        None if it has them.
    """
    part = missing_part(wall, mesh)
    if part <= (TOLD if coarse else TOLD_BY_DEFAULT):
        return None
    message = (
        f"the mesh with h={h:g} is far from {100 * part:.2g} % of the surfaces of the wall, "
        f"by more than a quarter of the edges there: it cuts off bends and creases that are "
        f"shorter than these; use h <= {0.5 * h:.3g}"
    )
    return Loss(part, message, most=np.inf)


def merged_part(wall: OffsetSolid) -> float:
    """Part of the sides of a wall that are within it, for walls have grown into each other.

    Parameters
    ----------
    wall : OffsetSolid
        The wall, not a solid.

    Returns
    -------
    float
        From 0 to 1, by area of the mid-surface.
    """
    total = lost = 0.0
    for side in SIDES:
        there, area, sides = _beside(wall, side, SOME)
        asked = wall._asked.at(there, sides)
        near = (side * wall._true_distance(there) < MERGED * asked) & (asked > 0.0)
        total += float(area[asked > 0.0].sum())
        lost += float(area[near].sum())
    return lost / total if total > 0.0 else 0.0


def _beside(wall: OffsetSolid, side: float, most: int) -> tuple[FloatArray, ...]:
    """Points next to the mid-surface, to first order on a side of a wall and in the domain.

    Their parameters (n, 3), the areas (n,) they stand for, and the side (n,).
    """
    u, area = wall._middle(most)
    sides = np.full(len(u), side)
    way, cut = to_faces(wall, u, beside(wall, u, np.zeros((len(u), 3), np.bool_), sides))
    at = np.flatnonzero(~cut)
    return inside(wall.lattice, u[at] + way[at]), area[at], sides[at]


def covered(mesh: SurfaceMesh, x: FloatArray, slack: FloatArray) -> AnyArray:
    """Which points (n, 3) are next to a triangle, as far as its size goes.

    Parameters
    ----------
    mesh : SurfaceMesh
        The triangles.
    x : ndarray, shape (n, 3)
        Points of space.
    slack : ndarray, shape (n,)
        Lengths by which they may be farther away.

    Returns
    -------
    ndarray of bool, shape (n,)
        True where one is within `NEAR` of its longest edge, and the slack.
    """
    if len(x) == 0:
        return np.zeros(0, np.bool_)
    tree = cKDTree(mesh.vertices, balanced_tree=False, compact_nodes=False)
    found: Any = tree.query(x, k=min(VERTICES, len(mesh.vertices)))
    near = found[1].reshape(len(x), -1)
    met = np.zeros(len(mesh.vertices), np.bool_)
    met[near] = True
    corner = np.asarray(mesh.faces).ravel()
    at = np.flatnonzero(met[corner])  # the others are next to no point
    order = at[np.argsort(corner[at], kind="stable")]
    first = np.searchsorted(corner[order], np.arange(len(mesh.vertices) + 1))
    count = np.diff(first)[near].ravel()
    point = np.repeat(np.repeat(np.arange(len(x)), near.shape[1]), count)
    start = np.repeat(first[near.ravel()] - (np.cumsum(count) - count), count)
    triangle = order[start + np.arange(len(start))] // 3
    corners = mesh.vertices[mesh.faces[triangle]].astype(np.float64)
    edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    out = np.zeros(len(x), np.bool_)
    out[point[_distance(x[point], corners) <= NEAR * edge + slack[point]]] = True
    return out


def _distance(x: FloatArray, corners: FloatArray) -> FloatArray:
    """Distances (n,) from points (n, 3) to triangles (n, 3, 3)."""
    best = np.full(len(x), np.inf)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    over = np.ones(len(x), np.bool_)
    for i in range(3):
        a, b = corners[:, i], corners[:, (i + 1) % 3]
        along, way = b - a, x - a
        square = np.maximum((along * along).sum(axis=1), np.finfo(np.float64).tiny)
        t = np.clip((way * along).sum(axis=1) / square, 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(way - t[:, None] * along, axis=1))
        over &= (np.cross(along, way) * normal).sum(axis=1) >= 0.0
    length = np.maximum(np.linalg.norm(normal, axis=1), np.finfo(np.float64).tiny)
    height = np.abs(((x - corners[:, 0]) * normal).sum(axis=1)) / length
    return np.where(over, height, best)
