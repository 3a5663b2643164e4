"""What a mesh has lost of its wall: its volume against that of the wall by cut cells.

Guarantee: meshes whose edges are long against the wall are compared, and others where the volume at
random points is larger. Non-guarantees: losses below 3 % of meshes with short edges are not
seen; the volume of the wall goes by the distance spline (see `ilattice.offsets.Wall.volume`).
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

from ilattice.errors import GeometryError, PrecisionWarning

if TYPE_CHECKING:
    from ilattice.mesh.surface import SurfaceMesh
    from ilattice.offsets.wall import Wall

#: Part of the volume from which on it is told, and from which on it is an error.
TOLD, REFUSED = 0.01, 0.05
#: Random points, and the part of the volume by which they may be off beyond three standard errors.
POINTS, NEAR = 32_768, 0.03
#: Length of edges, relative to the least thickness, from which on volumes are compared, and that
#: which is recommended.
COMPARED, ENOUGH = 0.6, 0.25


def check_loss(wall: Wall, h: float, mesh: SurfaceMesh, *, sheets: bool, allowed: bool) -> None:
    """Compare the volume of a mesh with that of its wall, where edges are long.

    Parameters
    ----------
    wall : Wall
        The wall.
    h : float
        Length of the edges.
    mesh : SurfaceMesh
        Its mesh, closed.
    sheets : bool
        Whether it was made from the mid-surface, so that it loses by bends only, as h².
    allowed : bool
        Whether to warn only, however much is lost.

    Raises
    ------
    GeometryError
        If more than `REFUSED` of the volume is lost or gained, unless that is allowed.
    """
    least = wall.least_thickness
    if h <= COMPARED * least and not _doubtful(wall, mesh.volume):
        return
    whole, got = wall.volume(), mesh.volume
    off = got / whole - 1.0 if whole > 0.0 else 0.0
    if abs(off) <= TOLD:
        return
    told, h = f"{h:g}", min(h, _longest_edge(mesh))  # a grid has at least some planes per tile
    enough = 0.9 * h * (TOLD / abs(off)) ** 0.5 if sheets else ENOUGH * least
    message = (
        f"the mesh with h={told} has the volume {got:.6g}, {100 * abs(off):.2g} % "
        f"{'less' if off < 0.0 else 'more'} than the wall ({whole:.6g}), which is {least:g} thick "
        f"at its thinnest; use h <= {enough:.3g}"
    )
    if abs(off) > REFUSED and not allowed:
        raise GeometryError(f"{message}, or allow_loss=True")
    warnings.warn(message, PrecisionWarning, stacklevel=4)


def _longest_edge(mesh: SurfaceMesh) -> float:
    """Length of the longest edge of a mesh."""
    corners = mesh.vertices[mesh.faces]
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(initial=0.0))


def _doubtful(wall: Wall, volume: float) -> bool:
    """Whether the wall has a larger volume at random points.

    Less is the spline's doing, which rounds off what fills a part.
    """
    lo, hi = wall.lattice.domain
    u = lo + (hi - lo) * np.random.default_rng(0).random((POINTS, 3))
    weight = np.abs(np.linalg.det(wall.lattice.through.jacobian(u))) * (wall.field(u) < 0.0)
    box = float(np.prod(hi - lo))
    mean, error = box * float(weight.mean()), box * float(weight.std()) / POINTS**0.5
    return mean - volume > 3.0 * error + NEAR * mean
