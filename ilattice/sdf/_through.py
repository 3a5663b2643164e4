"""Meshes of solids that are given in the parameters of a map: walls, trimmed and joined.

Guarantees: closed, oriented surfaces; closed directions of the map have no seam; volumes are
compared (`ilattice.sdf._loss`). Not guaranteed: features thinner than an edge, and walls to more
than the distance spline knows them: a wall alone is meshed better by `Wall.mesh`, which moves
vertices onto the exact offset.
"""

import numpy as np

from ilattice._field import Field
from ilattice._geometry import grid_points
from ilattice._memory import need
from ilattice._progress import Progress
from ilattice._typing import FloatArray
from ilattice._validate import as_positive
from ilattice.errors import InputError
from ilattice.fields.node import as_node
from ilattice.macroshape.maps import SplineMap
from ilattice.mesh import SurfaceMesh
from ilattice.mesh.contouring import contour_arrays
from ilattice.mesh.creases import sharpened
from ilattice.sdf._loss import check_loss
from ilattice.sdf._parting import SLIVER, parted

SAMPLES = 9  # per direction, of the lengths of parameter lines
PER_POINT = 60.0  # bytes of memory per point of the grid


def mesh_through(
    solid: Field, through: SplineMap, h: float, progress: Progress, *, allow_loss: bool = False
) -> SurfaceMesh:
    """Mesh in space of a field of the parameters of a map, with edges of about `h`."""
    node = as_node("solid", solid)
    lengths = _lengths(through)
    counts = np.maximum(np.ceil(lengths / as_positive("spacing", h)), 2.0)
    if counts.max() > 1e5:
        raise InputError(f"spacing {h:g} makes {counts.max():.3g} cells along one direction")
    need(PER_POINT * float(np.prod(counts)), f"spacing {h:g}", "take a larger one")
    domain = through.domain
    axes = [np.linspace(a, b, int(n) + 1) for (a, b), n in zip(domain.T, counts, strict=True)]
    raw = contour_arrays(node, axes, wrap=through.closed, progress=progress)
    edged = node.program.kinked and not any(through.closed)
    made = sharpened(raw, node, axes) if edged else raw

    def image(u: FloatArray) -> FloatArray:
        return through.x(np.clip(u, *domain))

    u, faces = parted(
        node, made, axes, wrap=through.closed, image=image, slivers=SLIVER if edged else 0.0
    )
    mesh = SurfaceMesh(image(u), faces if through.orientation > 0 else faces[:, ::-1])
    check_loss(
        node, domain, lengths, h, mesh.volume, allowed=allow_loss,
        det=lambda u: np.linalg.det(through.jacobian(u)),
    )  # fmt: skip
    return mesh


def _lengths(through: SplineMap) -> FloatArray:
    """Longest parameter line in each direction, shape (3,), from samples of its speed."""
    ticks = [np.linspace(a, b, SAMPLES) for a, b in through.domain.T]
    u = grid_points(*ticks)
    speed = np.linalg.norm(through.jacobian(u), axis=1).max(axis=0)
    return speed * (through.domain[1] - through.domain[0])
