"""Channels that open the closed voids of a wall, so that powder or resin can get out.

From each void the channel goes straight to the nearest place of the outer surface of the part
around it, through nothing but wall, and ends a radius beyond. It is taken away from the wall's
implicit function, so that walls and channels are contoured as one.

Guarantees: those of `Wall.mesh`, and that no void is left, or `GeometryError`. Non-guarantees:
triangles do not follow the edge at which a channel leaves the wall; a void in the hollow of
another one is opened into it; what is thinner than the mesh is not seen.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ilattice._progress import Progress
from ilattice._typing import FloatArray
from ilattice._validate import as_positive
from ilattice.errors import GeometryError, InputError
from ilattice.fields.algebra import complement, union
from ilattice.fields.node import Node
from ilattice.fields.primitives import capsule
from ilattice.fields.pulled import pull_back
from ilattice.macroshape.maps import SplineMap
from ilattice.mesh.regions import owners, topology_of
from ilattice.mesh.surface import SurfaceMesh
from ilattice.mesh.wall_mesh import parameters_of, wall_mesh
from ilattice.offsets.wall import OffsetSolid

#: Fewest edges of the mesh across a channel.
ACROSS = 3.0


def vent(
    wall: OffsetSolid, diameter: float, *, h: float | None = None, progress: Progress = None
) -> SurfaceMesh:
    """Mesh of a wall whose closed voids are opened by straight channels.

    Parameters
    ----------
    wall : Wall
        The wall.
    diameter : float
        Diameter of the channels, in units of length.
    h : float, optional
        Length of edges; by default a quarter of the least thickness, or of the diameter if that
        is less.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Returns
    -------
    SurfaceMesh
        As from `Wall.mesh`, with side 0 in channels; without voids. Where there are none, it is
        the mesh of the wall.

    Raises
    ------
    InputError
        If `wall` is no wall, or `diameter` is not positive, less than three edges, or so large
        that nothing of the wall is left.
    GeometryError
        If a void is left.
    """
    if not isinstance(wall, OffsetSolid):
        raise InputError(
            f"wall must be a Wall, as lattice.offset(d) makes, got {type(wall).__name__}; "
            "channels are cut before it is meshed"
        )
    diameter = as_positive("diameter", diameter)
    h = 0.25 * min(wall.least_thickness, diameter) if h is None else as_positive("h", h)
    if diameter < ACROSS * h:
        raise InputError(
            f"diameter={diameter:g} is less than {ACROSS:g} edges of h={h:g}, too narrow to be "
            f"meshed; use h <= {diameter / ACROSS:g}"
        )
    mesh = wall_mesh(wall, h, polish=wall._exact, caps=True, dtype=np.float64, progress=progress)
    ends = channels(mesh, 0.5 * diameter)
    if not len(ends):
        return mesh
    cut = channel_field(wall.lattice.through, ends, 0.5 * diameter)
    if (cut(parameters_of(mesh)[0]) > 0.0).all():
        raise InputError(
            f"diameter={diameter:g} is too large for the part: nothing of the wall is left; "
            "use a smaller one"
        )
    mesh = wall_mesh(
        wall, h, polish=wall._exact, caps=True, dtype=np.float64, progress=progress, cut=cut
    )
    left = topology_of(mesh).voids
    if left:
        raise GeometryError(
            f"{len(left)} of {len(ends)} voids are still closed, the first at "
            f"{left[0].centre.round(6).tolist()}; use a smaller h or a larger diameter"
        )
    return mesh


def channels(mesh: SurfaceMesh, beyond: float) -> FloatArray:
    """Shortest ways out of the voids of a mesh.

    Parameters
    ----------
    mesh : SurfaceMesh
        Closed and oriented outwards.
    beyond : float
        By how much ways go on at both ends.

    Returns
    -------
    ndarray, shape (n, 2, 3)
        Ends of a way for each void.
    """
    report = topology_of(mesh)
    labels = np.asarray(mesh.component_labels)
    out = np.empty((len(report.voids), 2, 3))
    for i, label in enumerate(owners(mesh, report.parts, report.voids)):
        void, outer = (
            np.asarray(mesh.vertices, np.float64)[np.unique(mesh.faces[labels == k])]
            for k in (report.voids[i].label, label)
        )
        found: Any = cKDTree(outer).query(void)
        start = int(np.argmin(found[0]))
        a, b = void[start], outer[found[1][start]]
        step = beyond * (b - a) / np.linalg.norm(b - a)
        out[i] = a - step, b + step
    return out


def channel_field(through: SplineMap, ends: FloatArray, radius: float) -> Node:
    """Field over the domain of a map: positive in straight channels, negative elsewhere.

    Parameters
    ----------
    through : SplineMap
        The map.
    ends : ndarray, shape (n, 2, 3)
        Ends of the axes of the channels in space.
    radius : float
        Their radius, also of the round ends.

    Returns
    -------
    Node
        Radius less distance to the nearest axis.
    """
    return pull_back(complement(union(*(capsule(a, b, radius) for a, b in ends))), through)
