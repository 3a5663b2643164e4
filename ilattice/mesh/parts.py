"""Whether the mesh of a solid has as many parts as the solid: webs thinner than edges are lost.

Guarantee: none beyond what points of a grid twice as fine show, joined across corners at most and
by faces at least. Non-guarantee: larger grids than `MAX_POINTS` points are not looked at.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.ndimage import label
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ilattice._geometry import grid_points
from ilattice._typing import AnyArray, FloatArray
from ilattice.errors import PrecisionWarning
from ilattice.mesh.surface import SurfaceMesh

#: Points of the grid per cell of the mesh, most of them, and how many are looked at together.
FINER, MAX_POINTS, TOGETHER = 2, 1 << 22, 1 << 18


def check_parts(
    field: Any, axes: tuple[FloatArray, ...], closed: Sequence[bool], mesh: SurfaceMesh, h: float
) -> None:
    """Warn where a mesh has more or fewer parts than its solid.

    Parameters
    ----------
    field : callable
        Values, negative inside, at parameters (n, 3).
    axes : three 1-D arrays
        The grid planes of the mesh.
    closed : three bools
        Directions in which the domain is closed.
    mesh : SurfaceMesh
        The closed mesh.
    h : float
        Length of its edges.
    """
    ticks = [_centres(a) for a in axes]
    if np.prod([float(len(a)) for a in ticks]) > MAX_POINTS:
        return
    inside = np.empty([len(a) for a in ticks], np.bool_)
    rest = grid_points(*ticks[1:])
    for first in range(0, len(ticks[0]), step := max(1, TOGETHER // len(rest))):
        some = ticks[0][first : first + step]
        u = np.column_stack([np.repeat(some, len(rest)), np.tile(rest, (len(some), 1))])
        inside[first : first + step] = (field(u) < 0.0).reshape(-1, *inside.shape[1:])
    found = solid_parts(mesh)
    least, most = joined(inside, closed, corners=True), joined(inside, closed, corners=False)
    if least <= found <= most:
        return
    warnings.warn(
        f"the mesh has {found} parts where the solid has {least}"
        f"{'' if least == most else f' to {most}'}: webs or gaps are thinner than edges of "
        f"{h:.3g}; use h <= {0.5 * h:.2g}",
        PrecisionWarning,
        stacklevel=5,
    )


def solid_parts(mesh: SurfaceMesh) -> int:
    """Number of closed surfaces that hold material: those of voids have a negative volume.

    Parameters
    ----------
    mesh : SurfaceMesh
        Closed and oriented.

    Returns
    -------
    int
        How many.
    """
    a, b, c = (mesh.vertices[mesh.faces[:, i]] - mesh.vertices[0] for i in range(3))
    six = np.einsum("ij,ij->i", a, np.cross(b, c))
    return int((np.bincount(mesh.component_labels, six) > 0.0).sum())


def joined(inside: AnyArray, closed: Sequence[bool], *, corners: bool) -> int:
    """Number of parts of voxels, joined across the seams of closed directions.

    Parameters
    ----------
    inside : ndarray of bool, three axes
        The voxels.
    closed : three bools
        Directions that are closed.
    corners : bool
        Whether voxels that share only a corner hang together, or only those that share a face.

    Returns
    -------
    int
        How many.
    """
    mark, n = label(inside, np.ones((3, 3, 3)) if corners else None)
    pairs = [np.zeros((2, 0), np.int64)]
    for a in np.flatnonzero(closed):
        ends = np.stack([np.take(mark, 0, a).ravel(), np.take(mark, -1, a).ravel()])
        pairs.append(ends[:, (ends > 0).all(axis=0)].astype(np.int64))
    i, j = np.concatenate(pairs, axis=1)
    graph = coo_array((np.ones(len(i), bool), (i, j)), shape=(n + 1, n + 1))
    return int(connected_components(graph, directed=False)[0]) - 1


def _centres(planes: FloatArray) -> FloatArray:
    """Points `FINER` times as dense as planes, in the middle between them."""
    parts = (np.arange(FINER) + 0.5) / FINER
    out: FloatArray = (planes[:-1, None] + np.diff(planes)[:, None] * parts).ravel()
    return out
