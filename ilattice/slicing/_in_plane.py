"""Points in a plane that cuts a wall: moved onto the plane, and onto a side of the wall.

Guarantees: coordinates that faces of the domain fix do not change; points that would move far stay
where they are; where closest points fail, the distance spline holds.
"""

from typing import TYPE_CHECKING

import numpy as np

from ilattice._geometry import cell_sizes
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.offsets._small import least_steps
from ilattice.offsets.polish import distance_jet, inside, shortest

if TYPE_CHECKING:
    from ilattice.offsets.wall import OffsetSolid

#: Most Newton steps onto wall and plane by the distance spline, then by closest points.
STEPS, POLISHING = 6, 3
#: Longest step and longest way of a point, and the step that ends the iteration, in cells.
STEP, WAY, STILL = 0.5, 1.5, 1e-3


class InPlane:
    """Moves points of one wall within parallel planes.

    Parameters
    ----------
    wall : Wall
        The wall.
    axes : three ndarray
        Grid planes in the parameter box; their cells are what lengths of ways refer to.
    frame : ndarray, shape (3, 3)
        Rows: the two directions in the plane and its normal.
    h : float
        Length of the edges of the grid in space.
    polish : bool
        Whether points move onto the exact offset, by closest points.
    """

    def __init__(
        self,
        wall: "OffsetSolid",
        axes: tuple[FloatArray, ...],
        frame: FloatArray,
        h: float,
        polish: bool,
    ) -> None:
        self.wall, self.axes, self.frame, self.h, self.polish = wall, axes, frame, h, polish

    def shortest(self, step: FloatArray) -> FloatArray:
        """Ways between parameters, across the seam of closed directions where that is shorter."""
        return shortest(self.wall.lattice, step)

    def flat(self, u: FloatArray) -> FloatArray:
        """Coordinates (n, 2) in the plane."""
        out: FloatArray = self.wall.lattice.through.x(u) @ self.frame[:2].T
        return out

    def wrapped(self, u: FloatArray) -> FloatArray:
        """Parameters within the domain."""
        return inside(self.wall.lattice, u)

    def projected(self, u: FloatArray, fixed: AnyArray, side: IntArray, level: float) -> FloatArray:
        """Points moved onto the plane and, those on a side of the wall, onto it.

        `fixed` (n, 3) coordinates do not change; `side` is 1 or -1 on a side of the wall, else 0.
        """
        width = cell_sizes(self.axes, u)
        way = self._way(u, width, np.zeros_like(u), (fixed, side, level), exact=False)
        if self.polish:
            way = self._way(u, width, way, (fixed, side, level), exact=True)
        return self.wrapped(u + way * width)

    def _way(
        self,
        u: FloatArray,
        width: FloatArray,
        before: FloatArray,
        conditions: tuple[AnyArray, IntArray, float],
        *,
        exact: bool,
    ) -> FloatArray:
        """How far to go, in cells, after some Newton steps; as `before` where that is too far."""
        fixed, side, level = conditions
        way = before.copy()
        at = np.flatnonzero(side) if exact else np.arange(len(u))
        for _ in range(POLISHING if exact else STEPS):
            now = self.wrapped(u[at] + way[at] * width[at])
            step = self._step(now, fixed[at], side[at], level, exact=exact) / width[at]
            longest = np.abs(step).max(axis=1, initial=0.0)
            way[at] += step * np.minimum(1.0, STEP / np.maximum(longest, STEP))[:, None]
            at = at[longest > STILL]
            if not len(at):
                break
        far = np.abs(way).max(axis=1, initial=0.0) > WAY
        return np.where(far[:, None], before, way)

    def edges(self, u: FloatArray) -> FloatArray:
        """Lengths of the shortest edges of the cells around points, at most those asked for."""
        size = np.linalg.norm(self.wall.lattice.through.jacobian(u), axis=1)
        return np.minimum((size * cell_sizes(self.axes, u)).min(axis=1), self.h)

    def _step(
        self, u: FloatArray, fixed: AnyArray, side: IntArray, level: float, *, exact: bool
    ) -> FloatArray:
        """Shortest step in space onto the linearised conditions."""
        x, jacobian = self.wall.lattice.through.jet(u, 1)
        free = ~fixed
        metric = np.einsum("nca,ncb->nab", jacobian, jacobian) * (free[:, :, None] & free[:, None])
        size = np.einsum("naa->n", metric)
        metric += (fixed * size[:, None] + 1e-12 * size[:, None])[:, :, None] * np.eye(3)
        rows = np.zeros((len(u), 2, 3))
        miss = np.zeros((len(u), 2))
        rows[:, 0] = np.einsum("nca,c->na", jacobian, self.frame[2]) * free
        miss[:, 0] = x @ self.frame[2] - level
        at = np.flatnonzero(side)
        if len(at):
            value, gradient = self._side(u[at], x[at], jacobian[at], side[at], exact)
            rows[at, 1], miss[at, 1] = gradient * free[at], value
        step = least_steps(rows, miss, metric)
        return np.where(np.isfinite(step), step, 0.0)

    def _side(
        self, u: FloatArray, x: FloatArray, jacobian: FloatArray, side: IntArray, exact: bool
    ) -> tuple[FloatArray, FloatArray]:
        """How far points are beyond a side of the wall, and the gradient in u."""
        t = self.wall.thickness
        outer, inner = (t.side(1.0), t.side(-1.0)) if exact else (t.outer, t.inner)
        asked, slope = (np.where(side > 0, a.T, b.T).T for a, b in zip(
            outer.jet(u, 1), inner.jet(u, 1), strict=True
        ))  # fmt: skip
        if exact:
            s, g, lost = distance_jet(self.wall.lattice, u, x, jacobian)
        else:
            s, g = self.wall.distance.jet(u, 1)
            lost = np.zeros(len(u), np.bool_)
        value = np.where(lost, 0.0, side * s - asked)
        return value, side[:, None] * g - slope

    def beyond(self, u: FloatArray, upper: IntArray) -> FloatArray:
        """How far points are beyond the outer, `upper` 1, or the inner side of the wall."""
        s, thickness = self.wall.distance(u), self.wall.thickness
        outer = s - thickness.outer(u)
        inner = outer if upper.all() else -s - thickness.inner(u)
        out: FloatArray = np.where(upper > 0, outer, inner)
        return out
