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

from ilattice._field import Field
from ilattice._progress import Progress
from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import as_points, as_positive
from ilattice.errors import GeometryError, InputError
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
    cut = Channels(wall.lattice.through, ends, 0.5 * diameter)
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


class Channels(Field):
    """Field over the domain of a map: positive in straight channels, negative elsewhere.

    Parameters
    ----------
    through : Map
        The map.
    ends : ndarray, shape (n, 2, 3)
        Ends of the axes of the channels in space.
    radius : float
        Their radius, also of the round ends.
    """

    def __init__(self, through: SplineMap, ends: FloatArray, radius: float) -> None:
        self.through, self.ends, self.radius = through, ends, radius

    def __call__(self, u: ArrayLike, /) -> FloatArray:
        """Radius less distance to the nearest axis, shape (n,), at parameters (n, 3)."""
        return self.jet(u, 0)[0]

    def jet(self, u: ArrayLike, order: int = 1) -> tuple[FloatArray, ...]:
        """Value, and for `order` 1 the gradient (n, 3)."""
        x, jacobian = self.through.jet(as_points("u", u), 1)
        away = self._away(x)
        distance = np.linalg.norm(away, axis=1)
        if order == 0:
            return (self.radius - distance,)
        normal = away / np.where(distance > 0.0, distance, 1.0)[:, None]
        return self.radius - distance, -np.einsum("nc,nca->na", normal, jacobian)

    def range(self, lo: ArrayLike, hi: ArrayLike) -> FloatArray:
        """Rigorous bounds, shape (m, 2), on boxes."""
        sides = self.through.boxes(lo, hi).transpose(0, 2, 1)
        distance = np.linalg.norm(self._away(sides.mean(axis=2)), axis=1)
        reach = 0.5 * np.linalg.norm(np.ptp(sides, axis=2), axis=1)
        low = self.radius - distance - reach
        return np.stack([low, self.radius - np.maximum(distance - reach, 0.0)], axis=1)

    def _away(self, x: FloatArray) -> FloatArray:
        """Ways (n, 3) from the nearest point of the axes to points of space."""
        best = np.full((len(x), 3), np.inf)
        for a, b in self.ends:
            t = np.clip((x - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
            away = x - a - t[:, None] * (b - a)
            nearer = (away**2).sum(axis=1) < (best**2).sum(axis=1)
            best = np.where(nearer[:, None], away, best)
        return best
