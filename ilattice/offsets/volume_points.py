"""Volumes of walls at random points, two in each of many boxes: without bias, with their errors.

Guarantees: the same points every time; exact distances are asked for wherever the distance spline
may be on the other side of a surface of the wall. Non-guarantee: standard errors are estimates.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from ilattice._field import Field
from ilattice._geometry import pairs
from ilattice._typing import FloatArray, IntArray
from ilattice.bspline import BSpline
from ilattice.offsets.mid_surface import MidSurface
from ilattice.offsets.sharp import reach
from ilattice.offsets.thickness import Thickness

#: Points whose weight the standard error is at least: of rare parts none may be seen.
FEW = 3.0
#: Boxes whose points are looked at at once: they and their maps take 60 MB.
TOGETHER = 1 << 18
#: Powers of the number of boxes over that of the error they leave, where boxes are smaller than
#: the wall is thick; and the most and the least times as many boxes that are looked into next.
POWER, MAX_MORE, MIN_MORE = 1.5, 32.0, 2.0


class Estimate(NamedTuple):
    """A volume, and how well it is known.

    Attributes
    ----------
    volume, error : float
        The volume, and its standard error: zero if it is not one of random points.
    boxes : int
        Boxes with two random points each; zero likewise.
    """

    volume: float
    error: float
    boxes: int

    def more(self, error: float) -> int:
        """Number of boxes for another error.

        Parameters
        ----------
        error : float
            The standard error that is wanted.

        Returns
        -------
        int
            As many as leave it, as far as this one tells.
        """
        factor = MAX_MORE
        if error * MAX_MORE ** (1.0 / POWER) > self.error:
            factor = max((self.error / error) ** POWER, MIN_MORE)
        return round(factor * self.boxes)


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
        return np.concatenate(list(self._blocks()))

    @cached_property
    def weight(self) -> FloatArray:
        """Volume (2 n,) that each of them stands for."""
        return self._weights(self.u)

    @property
    def filled(self) -> Estimate:
        """The volume of the wall, with no bound of its error where none of them is within it."""
        total = squares = most = 0.0
        for u in self._blocks():
            part = np.zeros(len(u))
            at = np.flatnonzero(self.wall.field(u) < 0.0)
            part[at] = self._weights(u[at])
            total, most = total + float(part.sum()), max(most, float(part.max()))
            squares += float((np.diff(part.reshape(-1, 2)) ** 2).sum())
        error = max(squares**0.5, FEW * most) if total > 0.0 else np.inf
        return Estimate(total, error, self.boxes)

    def _blocks(self) -> Iterator[FloatArray]:
        """The parameters, some at once."""
        lo, hi = self.wall.lattice.domain
        count, rng = self._count, np.random.default_rng(0)
        size = (hi - lo) / count
        total = int(count.prod())
        for first in range(0, total, TOGETHER):
            numbers = np.arange(first, min(first + TOGETHER, total))
            corner = lo + size * np.stack(np.unravel_index(numbers, tuple(count)), axis=1)
            yield pairs(corner, corner + size, rng)

    @property
    def _count(self) -> IntArray:
        """Number of boxes along each direction."""
        tiles = np.array(self.wall.lattice.repeat, float)
        count = np.rint(tiles * (self.boxes / tiles.prod()) ** (1 / 3)).astype(np.int64)
        return np.maximum(1, count)

    def _weights(self, u: FloatArray) -> FloatArray:
        """Volumes (n,) that so many of the points stand for."""
        det: FloatArray = np.abs(np.linalg.det(self.wall.lattice.through.jacobian(u)))
        one = float(np.prod(np.ptp(self.wall.lattice.domain, axis=0))) / (2 * self._count.prod())
        return one * det

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
