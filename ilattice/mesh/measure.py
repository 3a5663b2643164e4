"""Measures of triangle meshes: volume, area, triangle quality, census of edges, self-intersections.

Guarantees: linear memory and, but for sorting, linear time. The topology is that of the index
table: vertices at equal places with different numbers are different vertices.
Not guaranteed: self-intersections that rounding decides may be missed.
"""

from typing import NamedTuple

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import read_only, seen
from ilattice.mesh import _kernels_crossings as crossings
from ilattice.mesh import _kernels_surface as kernels
from ilattice.mesh._voxels import Voxels, extent, in_marked

#: Most voxels each way in which triangles near others are found.
MAX_VOXELS = 128


class Topology(NamedTuple):
    """What the edge table of a mesh says.

    Attributes
    ----------
    vertices : int
        Vertices that belong to a face.
    edges : int
        Different edges.
    faces : int
        Faces.
    open_edges : int
        Edges of one face.
    nonmanifold_edges : int
        Edges of three or more faces.
    twisted_edges : int
        Edges of several faces that do not run through them equally often both ways.
    fans : int
        Fans of faces around the vertices; more than `vertices` where surfaces touch in a point.
    components : int
        Parts connected through edges, as slicers count them.
    labels : (F,) integer array
        Number of the part of every face, by first appearance.
    """

    vertices: int
    edges: int
    faces: int
    open_edges: int
    nonmanifold_edges: int
    twisted_edges: int
    fans: int
    components: int
    labels: AnyArray


def volume_and_area(vertices: AnyArray, faces: AnyArray) -> tuple[float, float]:
    """Signed volume (positive for outward faces) and area.

    Parameters
    ----------
    vertices : (V, 3) array
        Points, float64 or float32.
    faces : (F, 3) integer array
        Corners.

    Returns
    -------
    volume, area : float
        In the cube and the square of the unit of `vertices`. The volume of an open mesh is that
        of the cone over it from the centre of its bounding box.
    """
    if len(faces) == 0:
        return 0.0, 0.0
    centre = 0.5 * extent(vertices).sum(axis=0)
    volume, area = kernels.volume_and_area(vertices, faces, centre).sum(axis=0)
    return float(volume / 6.0), float(area / 2.0)


def triangle_quality(vertices: AnyArray, faces: AnyArray) -> FloatArray:
    """Quality ``4 sqrt(3) area / sum of squared sides`` of every triangle.

    Parameters
    ----------
    vertices : (V, 3) array
        Points.
    faces : (F, 3) integer array
        Corners.

    Returns
    -------
    (F,) array
        1 for an equilateral triangle, 0 for a degenerate one.
    """
    return kernels.triangle_quality(vertices, faces)


def self_intersections(
    vertices: AnyArray, faces: AnyArray, active: AnyArray | None = None, *, touching: bool = False
) -> tuple[int, AnyArray]:
    """Triangles that pass through each other, or overlap in one plane.

    Parameters
    ----------
    vertices : (V, 3) array
        Points.
    faces : (F, 3) integer array
        Corners.
    active : (F,) array of bool, optional
        Only pairs with one of these triangles are compared; by default all are.
    touching : bool
        Whether those count, too, of which a corner of one is inside the other or an edge of it.

    Returns
    -------
    pairs : int
        Number of pairs of triangles.
    marked : (F,) array of bool
        Which triangles belong to a pair. Memory meanwhile: 30 bytes per triangle.
    """
    if len(vertices) < 2**31:  # as in meshes, and read-only, so that there is one kernel
        faces = faces.astype(np.int32, copy=False)
    vertices, faces = seen(vertices), seen(faces)
    marked = np.zeros(len(faces), np.bool_)
    if len(faces) == 0 or (active is not None and not active.any()):
        return 0, marked
    low, high = extent(vertices)
    if active is None:
        return _crossings(vertices, faces, np.ones(len(faces), np.bool_), touching, low, high)
    grid = Voxels.over(low, high - low, len(faces), MAX_VOXELS)
    voxel = grid.of(vertices)
    near = np.flatnonzero(in_marked(voxel, faces, grid.marked(voxel, faces, active)))
    pairs, found = _crossings(vertices, seen(faces[near]), active[near], touching, low, high)
    marked[near[found]] = True
    return pairs, marked


def _crossings(
    vertices: AnyArray, faces: AnyArray, active: AnyArray, touching: bool, low: FloatArray,
    high: FloatArray,
) -> tuple[int, AnyArray]:  # fmt: skip
    """Pairs of triangles, one of them active, that cross, and their triangles (F,)."""
    marked = np.zeros(len(faces), np.bool_)
    size = max(float((high - low).max()), np.finfo(np.float64).tiny)
    codes = np.empty(len(faces), np.int64)
    crossings.morton(len(faces), vertices, faces, low, size, codes)
    order = np.argsort(codes, kind="stable").astype(np.int32 if len(faces) < 2**31 else np.int64)
    del codes
    leaves = 1 << max(0, (len(faces) - 1) // crossings.LEAF).bit_length()
    boxes = np.empty((2 * leaves, 6))
    crossings.fill_leaves(leaves, vertices, faces, order, boxes)
    crossings.fill_nodes(boxes)
    pairs = np.zeros(-(-len(faces) // crossings.LEAF), np.int64)
    tree = vertices, faces, order, boxes, active, bool(active.all()), touching
    crossings.mark_crossings(len(pairs), *tree, marked, pairs)
    return int(pairs.sum()), marked


def topology(faces: AnyArray, n_vertices: int) -> Topology:
    """Census of vertices, edges, fans and components.

    Parameters
    ----------
    faces : (F, 3) integer array
        Corners; no face names a vertex twice.
    n_vertices : int
        Number of vertices, also of those that belong to no face.

    Returns
    -------
    Topology
        The counts. Memory meanwhile: 24 bytes per face and 9 per vertex (indices below 2**31).
    """
    start, order = _sorted_half_edges(faces, n_vertices)
    parent = np.empty_like(order)
    edges, opened, crowded, twisted, fans = kernels.census(faces, start, order, parent)
    del order
    labels = np.empty(len(faces), np.int32)
    components = kernels.label_components(parent, labels)
    return Topology(
        vertices=kernels.mark_vertices(faces, np.zeros(n_vertices, np.bool_)),
        edges=edges,
        faces=len(faces),
        open_edges=opened,
        nonmanifold_edges=crowded,
        twisted_edges=twisted,
        fans=fans,
        components=components,
        labels=read_only(labels),
    )


def faulty_edges(faces: AnyArray, n_vertices: int) -> IntArray:
    """Edges that do not belong to exactly two faces.

    Parameters
    ----------
    faces : (F, 3) integer array
        Corners.
    n_vertices : int
        Number of vertices.

    Returns
    -------
    (n, 2) array
        Vertex pairs, sorted by their lower vertex; empty for a watertight mesh.
    """
    start, order = _sorted_half_edges(faces, n_vertices)
    count = kernels.faulty_edges(faces, start, order, np.empty((0, 2), np.int64))
    pairs = np.empty((count, 2), np.int64)
    kernels.faulty_edges(faces, start, order, pairs)
    return pairs


def _sorted_half_edges(faces: AnyArray, n_vertices: int) -> tuple[AnyArray, AnyArray]:
    start = np.zeros(n_vertices + 1, np.int64)
    order = np.empty(faces.size, np.int32 if faces.size < 2**31 else np.int64)
    kernels.sort_half_edges(faces, start, order)
    return start, order
