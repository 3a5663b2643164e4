"""Walls thinner than the grid: their mid-surface, moved to both sides and closed at its rims.

A contour sees a wall where it holds points of the grid. Here the mid-surface is contoured instead,
which has no thickness to be lost; its vertices move to both sides of the wall, and triangles along
its rims on the faces of the domain close it. Edges may be longer than the wall is thick by any
factor.

Guarantees: closed, manifold and oriented as the contour of the mid-surface is; the two sheets have
the same triangles, so that they keep their distance where vertices do; vertices of rims stay on the
faces of the domain. Non-guarantees: where walls grow into each other, are thicker than they are
bent, or are in the domain only beside their mid-surface, sheets fail: vertices are lost, triangles
cross, or the volume is not that of the wall. All three are reported.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ilattice._geometry import fixed_coordinates
from ilattice._progress import Progress
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.bspline import BSpline
from ilattice.mesh.contouring import contour_arrays
from ilattice.mesh.uncrossing import Project, Uncrossed, uncrossed
from ilattice.offsets._small import least_steps
from ilattice.offsets.polish import LONGEST, inside, polish

if TYPE_CHECKING:
    from ilattice.offsets.mid_surface import MidSurface
    from ilattice.offsets.wall import OffsetSolid

#: Part of the way from the mid-surface to which vertices are held back at most.
MIN_WAY = 0.1
#: How far, in tiles, vertices of the spline's mid-surface may be from that of the field: the way
#: there is the shortest one in tiles, not in space, so that longer ones also lead along the
#: surface, and triangles cross. Others are moved by closest points.
NEARBY = 2e-3


class Sheets:
    """A mid-surface twice, as the outer and the inner side of a wall, and the rims between them.

    Attributes
    ----------
    u : ndarray, shape (2 n, 3)
        Parameters of vertices of the mid-surface, twice.
    kind : ndarray of uint8, shape (2 n,)
        Constraints, as in `Contour`.
    side : ndarray, shape (2 n,)
        1 for the first half, -1 for the second; 0 where the wall goes on beyond a face of the
        domain, on which the vertex then is.
    faces : ndarray, shape (m, 3)
        Triangles, outwards before the map.
    """

    def __init__(
        self,
        wall: OffsetSolid,
        axes: tuple[FloatArray, ...],
        exactly: bool,
        caps: bool,
        progress: Progress,
    ) -> None:
        lattice = wall.lattice
        middle = contour_arrays(
            wall.distance, axes, caps=False, wrap=lattice.through.closed, progress=progress
        )
        start, kind = middle.vertices, middle.kind

        def project(u: FloatArray, at: IntArray) -> tuple[FloatArray, AnyArray]:
            return _on_middle(wall, u, kind[at], exactly)

        u, _ = project(start, np.arange(len(start)))
        new = uncrossed(lattice, start, u, middle.faces, kind, project, _none)
        kept = new.repair.vertices
        n = len(kept)
        self.u = np.concatenate([new.u[kept]] * 2)
        self.kind = np.concatenate([kind[kept]] * 2)
        self.side = np.repeat([1.0, -1.0], n)
        faces = new.repair.faces.astype(np.int32 if 2 * n < np.iinfo(np.int32).max else np.int64)
        parts = [faces, faces[:, [0, 2, 1]] + n]
        if caps:
            a, b = _rims(faces, n)
            parts.append(np.stack([b, a, a + n, b, a + n, b + n], axis=1).reshape(-1, 3))
        self.faces = np.concatenate(parts, dtype=faces.dtype)

    def moved(self, wall: OffsetSolid, project: Project) -> tuple[Uncrossed, AnyArray]:
        """Vertices on both sides of a wall, and which of them are off it.

        Parameters
        ----------
        wall : Wall
            The wall.
        project : callable
            Moves vertices onto the offset, as `uncrossed` takes it.

        Returns
        -------
        Uncrossed
            New places, the triangles, and what crosses.
        ndarray of bool, shape (2 n,)
            Vertices that could not be moved onto the offset, or were held back.
        """
        goal = beside(wall, self.u, fixed_coordinates(self.kind), self.side)
        goal, cut = to_faces(wall, self.u, goal)
        self.side[cut] = 0.0
        u, lost = project(inside(wall.lattice, self.u + goal), np.arange(len(self.u)))
        near = inside(wall.lattice, self.u + MIN_WAY * goal)
        new = uncrossed(
            wall.lattice, near, u, self.faces, self.kind, project, _none, repaired=True
        )  # fmt: skip
        return new, (new.unconverged | lost) & ~cut


def beside(wall: OffsetSolid, u: FloatArray, fixed: AnyArray, side: FloatArray) -> FloatArray:
    """Ways, of first order, from points of a mid-surface to a side of the wall about it.

    Parameters
    ----------
    wall : Wall
        The wall.
    u : ndarray, shape (n, 3)
        Parameters of the points.
    fixed : ndarray of bool, shape (n, 3)
        Coordinates that must not change.
    side : ndarray, shape (n,)
        +1 or -1.

    Returns
    -------
    ndarray, shape (n, 3)
        Changes of the parameters, no longer than `LONGEST` times the half-thickness.
    """
    _, jacobian = wall.lattice.through.jet(u, 1)
    slope = wall.distance.jet(u, 1)[1]
    asked = side * np.where(side > 0, wall.thickness.outer(u), wall.thickness.inner(u))
    metric = np.einsum("nca,ncb->nab", jacobian, jacobian)
    way, length = _least(metric, slope)
    shortest = length * np.abs(asked)
    free = ~fixed
    metric = metric * (free[:, :, None] & free[:, None, :]) + fixed[:, :, None] * np.eye(3)
    way, length = _least(metric, slope * free)
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.minimum(1.0, LONGEST * shortest / (length * np.abs(asked)))
    out = way * (asked * np.where(np.isfinite(part), part, 0.0))[:, None]
    return np.where(np.isfinite(out), out, 0.0)


def _on_middle(
    wall: OffsetSolid, u: FloatArray, kind: AnyArray, exactly: bool
) -> tuple[FloatArray, AnyArray]:
    """Parameters of vertices moved onto the mid-surface, and which could not be."""
    lattice, fixed = wall.lattice, fixed_coordinates(kind)
    out, lost = u.copy(), np.zeros(len(u), np.bool_)
    rest = np.arange(len(u))
    if exactly and lattice.search.plain:  # where the field vanishes, or else by closest points
        out, there = _on_zero(lattice, u, fixed)
        rest = np.flatnonzero(~there)
    if len(rest):
        zero = BSpline([lattice.domain[:, a] for a in range(3)], np.zeros((1, 1, 1)), 0)
        out[rest], off = polish(
            lattice, u[rest], fixed[rest], np.ones(len(rest)), zero,
            None if exactly else wall.distance,
        )  # fmt: skip
        lost[rest] = np.isinf(off)
    return out, lost


def _on_zero(lattice: MidSurface, u: FloatArray, fixed: AnyArray) -> tuple[FloatArray, AnyArray]:
    """Parameters moved to where the field vanishes nearby, and which got there."""
    search = lattice.search
    p, moved = search.on_surface(search.to_tile(u), fixed)
    there = (moved <= NEARBY) & search.within(p)
    return np.where(there[:, None], inside(lattice, search.from_tile(p)), u), there


def to_faces(wall: OffsetSolid, u: FloatArray, way: FloatArray) -> tuple[FloatArray, AnyArray]:
    """Ways from parameters, as far as the faces of the domain.

    Parameters
    ----------
    wall : Wall
        Gives the domain.
    u, way : ndarray, shape (n, 3)
        Parameters, and the ways from there.

    Returns
    -------
    ndarray, shape (n, 3)
        The ways, shorter where they would leave the domain.
    ndarray of bool, shape (n,)
        Which ones do.
    """
    lo, hi = wall.lattice.domain
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.where(way > 0.0, (hi - u) / way, (lo - u) / way)
    part[:, list(wall.lattice.through.closed)] = np.inf
    part[way == 0.0] = np.inf
    least = part.min(axis=1)
    return way * np.minimum(least, 1.0)[:, None], least < 1.0


def _least(metric: FloatArray, slope: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shortest ways along which functions grow by 1, and their lengths."""
    way = least_steps(slope[:, None], np.full((len(slope), 1), -1.0), metric)
    return way, np.sqrt(np.einsum("na,nab,nb->n", way, metric, way))


def _rims(faces: AnyArray, n: int) -> tuple[IntArray, IntArray]:
    """Edges of one triangle only, as it runs from one end to the other."""
    a = faces.ravel().astype(np.int64)
    b = faces[:, [1, 2, 0]].ravel().astype(np.int64)
    ways, back = a * n + b, np.sort(b * n + a)
    at = np.minimum(np.searchsorted(back, ways), len(back) - 1)
    alone = back[at] != ways
    return a[alone], b[alone]


def _none(u: FloatArray, at: IntArray) -> tuple[FloatArray, AnyArray]:
    """No vertex has another place."""
    return u, np.ones(len(at), np.bool_)
