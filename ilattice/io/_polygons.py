"""What the mesh readers share: from the numbers of a file to a checked `SurfaceMesh`.

Guarantees: polygons are cut into fans; faces that name a vertex twice are dropped with a warning;
whatever a file claims, memory stays in proportion to its size.
"""

import os
import warnings
from collections.abc import Sequence

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.errors import FormatError, PrecisionWarning
from ilattice.mesh import SurfaceMesh


def fans(sizes: IntArray, corners: IntArray) -> IntArray:
    """Triangles (F, 3) of polygons, given the number of corners of each and all corners."""
    if (sizes == 3).all():
        return corners.reshape(-1, 3)
    first = np.cumsum(sizes) - sizes
    cuts = np.maximum(sizes - 2, 0)
    polygon = np.repeat(np.arange(len(sizes)), cuts)
    step = np.arange(len(polygon)) - np.repeat(np.cumsum(cuts) - cuts, cuts)
    at = first[polygon]
    return np.stack([corners[at], corners[at + step + 1], corners[at + step + 2]], axis=1)


def flattened(polygons: Sequence[Sequence[int]]) -> tuple[IntArray, IntArray]:
    """Sizes and corners of polygons."""
    sizes = np.array([len(p) for p in polygons], np.int64)
    return sizes, np.array([i for p in polygons for i in p], np.int64)


def welded(points: AnyArray) -> tuple[AnyArray, IntArray]:
    """Different points in the order of their first appearance, and the number of each point."""
    points = points + 0.0  # no negative zeros
    order = np.lexsort(points.T)
    ranked = points[order]
    new = np.ones(len(points), np.bool_)
    new[1:] = (ranked[1:] != ranked[:-1]).any(axis=1)
    group = np.cumsum(new) - 1
    first = np.minimum.reduceat(order, np.flatnonzero(new)) if len(points) else order
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    number = np.empty(len(points), np.int64)
    number[order] = rank[group]
    return points[np.sort(first)], number


def checked_mesh(
    path: str | os.PathLike[str], vertices: FloatArray | AnyArray, faces: IntArray
) -> SurfaceMesh:
    """Mesh of what a file holds.

    Parameters
    ----------
    path : path-like
        The file, for messages.
    vertices : (V, 3) array
        Points.
    faces : (F, 3) array
        Corners.

    Returns
    -------
    SurfaceMesh
        Without the faces that name a vertex twice.

    Raises
    ------
    FormatError
        Coordinates that are not finite, corners that do not exist, no triangles.
    """
    finite = np.isfinite(vertices).all(axis=1)
    if not finite.all():
        i = int(np.argmin(finite))
        raise FormatError(f"{path}: vertex {i} is {vertices[i].tolist()}; expected finite numbers")
    wrong = ((faces < 0) | (faces >= len(vertices))).any(axis=1)
    if wrong.any():
        i = int(np.argmax(wrong))
        raise FormatError(
            f"{path}: triangle {i} has the corners {faces[i].tolist()}; expected numbers from 0 "
            f"to {len(vertices) - 1}, counted from zero"
        )
    a, b, c = faces.T
    twice = (a == b) | (b == c) | (c == a)
    if len(faces) == int(twice.sum()):
        raise FormatError(f"{path}: holds no triangles")
    if twice.any():
        warnings.warn(
            f"{path}: {int(twice.sum())} of {len(faces)} triangles have two equal corners and "
            "were dropped",
            PrecisionWarning,
            stacklevel=5,
        )
    return SurfaceMesh(vertices, faces[~twice])
