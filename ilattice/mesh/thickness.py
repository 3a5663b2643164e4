"""How far meshes of walls are from the asked thickness.

Guarantee: errors are those of closest points that are searched anew. Non-guarantee: between
vertices of a mesh nothing is measured but whether it is there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ilattice._shown import Shown
from ilattice.mesh.coverage import missing_part
from ilattice.mesh.surface import SurfaceMesh
from ilattice.mesh.wall_mesh import parameters_of
from ilattice.offsets.wall import OffsetSolid


@dataclass(frozen=True)
class ThicknessReport(Shown):
    """Error | |distance| - d | of the half-thickness over the vertices of a wall's mesh.

    Attributes
    ----------
    max, p99, rms : float
        Largest, 99th percentile, root mean square, in units of length.
    relative : float
        99th percentile relative to d; on sides where d is zero, to the least total thickness.
    relative_max : float
        Largest, likewise.
    count : int
        Number of vertices measured: those of the offset surfaces, caps excluded.
    missing : float
        Part of the offset surfaces, by area, next to which the mesh has no triangle.
    """

    max: float
    p99: float
    rms: float
    relative: float
    relative_max: float
    count: int
    missing: float


def thickness_report(wall: OffsetSolid, mesh: SurfaceMesh) -> ThicknessReport:
    """How far the vertices of a mesh are from the asked thickness.

    Parameters
    ----------
    wall : OffsetSolid
        The wall.
    mesh : SurfaceMesh
        A mesh of it.

    Returns
    -------
    ThicknessReport
        Errors over the vertices of the offset surfaces, caps excluded, and what part of these
        surfaces the mesh lacks.
    """
    u, side = parameters_of(mesh)
    if not side.any():  # the wall fills the part
        return ThicknessReport(0.0, 0.0, 0.0, 0.0, 0.0, 0, 0.0)
    error, asked = wall._errors(u[side != 0], side[side != 0])
    relative = error / np.where(asked != 0.0, np.abs(asked), wall.least_thickness)
    return ThicknessReport(
        float(error.max()), float(np.percentile(error, 99)),
        float(np.sqrt(np.mean(error**2))), float(np.percentile(relative, 99)),
        float(relative.max()), len(error), missing_part(wall, mesh),
    )  # fmt: skip
