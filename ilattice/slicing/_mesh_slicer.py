"""Cuts a closed mesh by parallel planes.

Guarantee: loops close, whatever the mesh that is closed and oriented, and cross only where the mesh
crosses itself; corners that lie on a plane count as above it.
"""

from typing import Protocol

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.errors import GeometryError
from ilattice.slicing import _kernels_slices as kernels
from ilattice.slicing._loops import EMPTY, MERGE, Outline, apart, crossing, finished

#: Where contours cross after points have merged, which are nearer to each other than a part of the
#: edges, so much nearer ones merge, then none.
LESS = 1e-3


class ClosedMesh(Protocol):
    """A mesh that tells whether it is closed: a `SurfaceMesh`."""

    @property
    def vertices(self) -> AnyArray:
        """Points, shape (V, 3)."""

    @property
    def faces(self) -> AnyArray:
        """Corners, shape (F, 3)."""

    @property
    def is_watertight(self) -> bool:
        """Whether every edge has two faces."""

    @property
    def is_oriented(self) -> bool:
        """Whether faces beside each other agree on what is outside."""


class MeshSlicer:
    """Cuts one mesh.

    Parameters
    ----------
    mesh : ClosedMesh
        Closed and oriented.
    frame : ndarray, shape (3, 3)
        Rows: the two directions in the plane and its normal, right-handed.

    Raises
    ------
    GeometryError
        If the mesh is open, or not oriented: its loops would not close.
    """

    def __init__(self, mesh: ClosedMesh, frame: FloatArray) -> None:
        if not (mesh.is_watertight and mesh.is_oriented):
            raise GeometryError("a mesh that is open, or not oriented, has no slices: repair it")
        self.mesh = mesh
        self.net = np.asarray(mesh.vertices, np.float64)
        self._x = self.net @ frame.T
        self._faces = np.asarray(mesh.faces, np.int64)
        corners = self._x[:, 2][self._faces]
        self._low, self._high = corners.min(axis=1), corners.max(axis=1)
        side = self.net[self._faces[:, 0]] - self.net[self._faces[:, 1]]
        self._least = MERGE * float(np.linalg.norm(side, axis=1).mean())

    @property
    def ends(self) -> tuple[float, float]:
        """Least and greatest height."""
        return float(self._low.min()), float(self._high.max())

    def approximation(self) -> ClosedMesh:
        """The mesh, for programs that do not know of slices."""
        return self.mesh

    def outline(self, level: float) -> Outline:
        """Loops in which the plane at one height cuts the mesh, the solid on their left.

        Parameters
        ----------
        level : float
            The height.

        Returns
        -------
        Outline
            The loops.
        """
        hit = self._faces[(self._low < level) & (self._high >= level)]
        if not len(hit):
            return EMPTY
        up = self._edges(hit, level, rising=True)
        down = self._edges(hit, level, rising=False)
        names, where = np.unique(up, axis=0, return_inverse=True)
        at = np.unique(down, axis=0, return_inverse=True)[1]
        following = np.empty(len(names), np.int64)
        following[at.ravel()] = where.ravel()
        order, start = np.empty(len(names), np.int64), np.empty(len(names) + 1, np.int64)
        loops = kernels.chain(following, order, start)
        a, b = self._x[names[order, 0]], self._x[names[order, 1]]
        t = ((level - a[:, 2]) / (b[:, 2] - a[:, 2]))[:, None]
        points = np.ascontiguousarray(((1.0 - t) * a + t * b)[:, :2])
        for least in (self._least, LESS * self._least, 0.0):
            reach = np.full(len(points), least)
            keep, first = apart(points, start[: loops + 1].copy(), reach)
            if not crossing(points[keep], first).any():
                break
        return finished(points[keep], first, self._least)

    def _edges(self, faces: IntArray, level: float, *, rising: bool) -> IntArray:
        """The edge of each triangle along which its boundary rises (or falls) through a plane."""
        above = self._x[:, 2][faces] >= level
        after = np.roll(above, -1, axis=1)
        side = np.argmax(~above & after if rising else above & ~after, axis=1)
        rows = np.arange(len(faces))
        ends = np.stack((faces[rows, side], faces[rows, (side + 1) % 3]), axis=1)
        return np.sort(ends, axis=1)
