"""Volumes of walls at random points, two in each of many boxes: without bias, with their errors.

Guarantees: the same points every time; exact distances are asked for wherever the distance spline
may be on the other side of a surface of the wall. Non-guarantee: standard errors are estimates.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from ilattice._field import Field
from ilattice._geometry import grid_indices, pairs
from ilattice._typing import FloatArray
from ilattice.bspline import BSpline
from ilattice.offsets.mid_surface import MidSurface
from ilattice.offsets.sharp import reach
from ilattice.offsets.thickness import Thickness

#: Points whose weight the standard error is at least: of rare parts none may be seen.
FEW = 3.0


class Rounded(NamedTuple):
    """What exact distances add to the volume by the distance spline.

    Attributes
    ----------
    volume, error : float
        The volume, and its standard error.
    rough : bool
        Whether the spline is off by more than is usual, so that many points are asked for.
    """

    volume: float
    error: float
    rough: bool

    def decides(self, volume: float) -> bool:
        """Whether the error does not matter for whether a part of a volume is lost.

        Parameters
        ----------
        volume : float
            That part.

        Returns
        -------
        bool
            Whether two standard errors more or less are on the same side of it.
        """
        return abs(abs(self.volume) - volume) > 2.0 * self.error


class _Wall(Protocol):
    """What is looked at of an `OffsetSolid`."""

    _exact: bool

    @property
    def lattice(self) -> MidSurface: ...
    @property
    def distance(self) -> BSpline: ...
    @property
    def field(self) -> Field: ...
    @property
    def _asked(self) -> Thickness: ...
    def _true_distance(self, u: FloatArray) -> FloatArray: ...


class VolumePoints:
    """Random points of the domain of a wall, and the volumes they stand for.

    Parameters
    ----------
    wall : OffsetSolid
        The wall.
    boxes : int
        Number of boxes, about.
    """

    def __init__(self, wall: _Wall, boxes: int) -> None:
        self.wall, self.boxes = wall, boxes

    @cached_property
    def u(self) -> FloatArray:
        """Parameters (2 n, 3), those of the same box one after the other."""
        lo, hi = self.wall.lattice.domain
        tiles = np.array(self.wall.lattice.repeat, float)
        count = np.maximum(1, np.rint(tiles * (self.boxes / tiles.prod()) ** (1 / 3))).astype(int)
        corner = grid_indices(count)
        rng = np.random.default_rng(0)
        return pairs(lo + (hi - lo) * corner / count, lo + (hi - lo) * (corner + 1) / count, rng)

    @cached_property
    def weight(self) -> FloatArray:
        """Volume (2 n,) that each of them stands for."""
        det = np.abs(np.linalg.det(self.wall.lattice.through.jacobian(self.u)))
        out: FloatArray = det * (
            float(np.prod(np.ptp(self.wall.lattice.domain, axis=0))) / len(det)
        )
        return out

    def near(self, volume: float, part: float) -> bool:
        """Whether the wall has about that volume, as far as these points tell.

        Parameters
        ----------
        volume : float
            The volume.
        part : float
            By which part of it may be off, less three standard errors, and half of it at least.

        Returns
        -------
        bool
            Whether it is.
        """
        filled = (self.weight * (self.wall.field(self.u) < 0.0)).reshape(-1, 2)
        mean, error = float(filled.sum()), float(np.linalg.norm(filled[:, 0] - filled[:, 1]))
        return abs(mean - volume) <= max(part * mean - 3.0 * error, 0.5 * part * mean)

    @property
    def rounded(self) -> Rounded:
        """What exact distances add to the volume by the distance spline."""
        wall, one = self.wall, np.ones(len(self.u))
        inner, outer = wall._asked.at(self.u, -one), wall._asked.at(self.u, one)
        s = wall.distance(self.u)
        near, band = np.minimum(np.abs(s - outer), np.abs(s + inner)), 0.0
        usual = wider = reach(wall.lattice, wall.distance)
        while wider > band:  # splines of few spans are off by more than is usual
            band = wider
            at = np.flatnonzero((near < band) | ~np.array(wall._exact))
            exact = wall._true_distance(self.u[at])
            wider = 2.0 * float(np.abs(s[at] - exact).max(initial=0.0))
        inside = (exact < outer[at]) & (-exact < inner[at])
        change = np.zeros(len(self.u))
        change[at] = self.weight[at] * (inside * 1.0 - (wall.field(self.u[at]) < 0.0))
        one_box = change.reshape(-1, 2)
        error = float(np.linalg.norm(one_box[:, 0] - one_box[:, 1]))
        error = max(error, FEW * float(self.weight.max()))
        return Rounded(float(change.sum()), error, band > usual)
