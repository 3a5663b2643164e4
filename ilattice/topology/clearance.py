"""The distance to a mid-surface less a half-thickness, exactly and by the distance spline.

Guarantee: values are those of fresh closest points; parameters may lie beyond the seams of closed
directions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from ilattice._geometry import wrapped
from ilattice._typing import FloatArray, IntArray
from ilattice.bspline import BSpline
from ilattice.offsets.distance_spline import distance_spline

if TYPE_CHECKING:
    from ilattice.offsets.mid_surface import MidSurface


class Clearance:
    """How far points are beyond the walls of a lattice.

    Parameters
    ----------
    lattice : Lattice
        The lattice.
    inner, outer : BSpline, optional
        Half-thickness on the sides where the implicit function is negative and positive; by
        default nothing is taken off the distance.
    """

    def __init__(
        self, lattice: MidSurface, inner: BSpline | None = None, outer: BSpline | None = None
    ) -> None:
        self.lattice, self.domain = lattice, lattice.domain
        self.closed = np.array(lattice.through.closed)
        self.spline = distance_spline(lattice)
        self.less = {-1: inner, 1: outer}
        self.breaks = [self.spline.breaks(a) for a in range(3)]
        self.span = np.array([np.diff(b).max() for b in self.breaks])

    def side(self, u: FloatArray) -> IntArray:
        """Sign (n,) of the implicit function at parameters (n, 3)."""
        return np.where(self.lattice.implicit(u) >= 0.0, 1, -1)

    def taken(self, u: FloatArray, side: IntArray, order: int = 0) -> tuple[FloatArray, ...]:
        """Half-thickness on a side, and its derivatives: `order` + 1 of them."""
        out = tuple(np.zeros((len(u), *(3,) * k)) for k in range(order + 1))
        for sign, less in self.less.items():
            at = np.flatnonzero(side == sign)
            if less is not None and len(at):
                for whole, part in zip(out, less.jet(u[at], order), strict=True):
                    whole[at] = part
        return out

    def on_spline(self, u: FloatArray, order: int = 0) -> tuple[FloatArray, ...]:
        """Values by the distance spline, and its derivatives: `order` + 1 of them."""
        jet = self.spline.jet(u, order)
        side = np.where(jet[0] < 0.0, -1, 1)
        taken = self.taken(u, side, order)
        sign = [side.reshape(-1, *(1,) * k) for k in range(order + 1)]
        return tuple(s * a - b for s, a, b in zip(sign, jet, taken, strict=True))

    def wrapped(self, u: FloatArray) -> FloatArray:
        """Parameters moved into the domain along closed directions."""
        lo, hi = self.domain
        return wrapped(u, lo, hi, self.closed)

    def image(self, p: FloatArray) -> FloatArray:
        """Points of space (n, 3) of tile coordinates, also of the continuation."""
        u = self.wrapped(self.lattice.search.from_tile(p))
        return self.lattice.through.x(u, extrapolate="extend")

    def tree(self, u: FloatArray, length: FloatArray) -> tuple[cKDTree, FloatArray]:
        """Tree of parameters (n, 3), and they themselves, in some lengths, across seams."""
        around = np.where(self.closed, np.ptp(self.domain, axis=0) / length, 0.0)
        p = (u - self.domain[0]) / length
        p[:, self.closed] %= around[self.closed]
        return cKDTree(p, boxsize=around), p

    def sizes(self, u: FloatArray) -> FloatArray:
        """Lengths (n, 3) of the derivatives of the map at parameters (n, 3)."""
        out: FloatArray = np.linalg.norm(self.lattice.through.jacobian(u), axis=1)
        return out
