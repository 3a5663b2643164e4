"""The distance spline with exact distances where it rounds off a kink next to a wall.

A C1 spline rounds off the kinks of the distance, in the middle of pores and throats, over about a
span. A wall that ends there would close pores early, and round off the creases where its surfaces
meet. There the length of the spline's gradient in space is not 1, which tells where to ask for
closest points instead.

Guarantee: values differ from the spline's only within `BAND` spans of the level of a wall, and
within `BAND` of what the spline changes by over a span there: where a map squeezes tiles, spans are
long along directions in which the distance hardly changes.
Non-guarantees: some points at kinks are missed, where the gradient has length 1 by chance; values
jump where exact ones take over, by the error of the spline there; derivatives are those of the
spline, and so are values that come with them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ilattice._field import Field
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import as_points
from ilattice.bspline.knots import find_spans, wrap
from ilattice.offsets._small import solved

if TYPE_CHECKING:
    from ilattice._typing import ArrayLike
    from ilattice.bspline import BSpline
    from ilattice.offsets.mid_surface import MidSurface
    from ilattice.offsets.thickness import Thickness

#: Distances from the level of the wall, in the longest spans, and in changes of the spline over a
#: span around, at which kinks matter: more than the largest error of the spline, a quarter of that.
BAND = 0.3
#: Least deviation of the length of the gradient from 1 at a kink.
BENT = 0.05
#: Places per direction at which the map is looked at for its longest span; chosen without
#: measurements.
SITES = 9


class SharpDistance(Field):
    """Signed distance to a mid-surface, exact at kinks next to a wall.

    Parameters
    ----------
    lattice : Lattice
        Gives exact distances.
    spline : BSpline
        Signed distance as a spline.
    thickness : Thickness
        Half-thickness of the wall.
    """

    def __init__(self, lattice: MidSurface, spline: BSpline, thickness: Thickness) -> None:
        self.lattice, self.spline, self.thickness = lattice, spline, thickness
        self.band = reach(lattice, spline)
        self.bands = np.minimum(BAND * changes(spline), self.band)

    @property
    def bounds(self) -> FloatArray:
        """The parameter domain, under the name that fields have."""
        return self.domain

    @property
    def approximation(self) -> BSpline:
        """The spline."""
        return self.spline

    @property
    def domain(self) -> FloatArray:
        """The parameter domain, shape (2, 3)."""
        return self.spline.domain

    def __call__(self, u: ArrayLike, /) -> FloatArray:
        """Value, shape (n,), at parameters (n, 3)."""
        u = as_points("u", u)
        s = self.spline(u)
        at = np.flatnonzero(self._near(u, s))
        at = at[self._bent(u[at])]
        if len(at):
            s[at] = self.lattice.distance(u[at])
        return s

    def jet(self, u: ArrayLike, order: int = 2) -> tuple[FloatArray, ...]:
        """Value; with derivatives all of the spline, so that they are of one function."""
        return (self(u),) if order == 0 else self.spline.jet(u, order)

    def breaks(self, axis: int) -> FloatArray:
        """Different knots of the spline along an axis."""
        return self.spline.breaks(axis)

    def range(self, lo: ArrayLike, hi: ArrayLike, *, tight: bool = True) -> FloatArray:
        """Bounds, shape (m, 2), on boxes, as far as the spline is wrong by `band` at most."""
        return self.spline.range(lo, hi, tight=tight) + np.array([-self.band, self.band])

    def _near(self, u: FloatArray, s: FloatArray) -> AnyArray:
        """Where the level of the wall is near."""
        inner, outer = self.thickness.inner(u), self.thickness.outer(u)
        band = self.bands[span_of(self.spline, u)]
        near: AnyArray = np.minimum(np.abs(-s - inner), np.abs(s - outer)) < band
        return near

    def _bent(self, u: FloatArray) -> AnyArray:
        """Where the spline is not a distance."""
        _, gradient = self.spline.jet(u, 1)
        jacobian = self.lattice.through.jacobian(u)
        normal = solved(jacobian.transpose(0, 2, 1), gradient[:, :, None])[:, :, 0]
        straight: AnyArray = np.abs(np.linalg.norm(normal, axis=1) - 1.0) <= BENT
        return ~straight


def reach(lattice: MidSurface, spline: BSpline) -> float:
    """How far a distance spline may be off.

    Parameters
    ----------
    lattice : MidSurface
        Domain and map.
    spline : BSpline
        Signed distance as a spline.

    Returns
    -------
    float
        `BAND` of its longest span in space.
    """
    span = [np.diff(spline.breaks(a)).max() for a in range(3)]
    lo, hi = lattice.domain
    sites = [np.linspace(lo[a], hi[a], SITES) for a in range(3)]
    _, slopes = lattice.through.geometry.grid(sites, 1)
    return BAND * float(np.linalg.norm(slopes * span, axis=-2).max())


def changes(spline: BSpline) -> FloatArray:
    """How much a spline changes over a span, at most, around its spans.

    Parameters
    ----------
    spline : BSpline
        A scalar spline of three parameters.

    Returns
    -------
    ndarray, shape (m0, m1, m2)
        By the number of the first coefficient that counts in a span: norms of the largest
        differences of the coefficients that count there, along each direction, for the longest
        span in place of the step between Greville abscissae.
    """
    total = np.zeros([n - k for n, k in zip(spline.shape, spline.k, strict=True)])
    for axis in range(3):
        step = np.maximum(np.diff(spline.greville(axis)), np.finfo(np.float64).tiny)
        slope = np.abs(np.diff(spline.c, axis=axis)) / np.expand_dims(
            step, tuple(a for a in range(3) if a != axis)
        )
        for a, width in enumerate(spline.k):  # of k + 1 coefficients there are k differences
            slope = _greatest(slope, width + (a != axis), a)
        total += (slope * np.diff(spline.breaks(axis)).max()) ** 2
    return np.sqrt(total)


def _greatest(values: FloatArray, width: int, axis: int) -> FloatArray:
    """Largest of so many values that follow each other along an axis."""
    return np.asarray(np.lib.stride_tricks.sliding_window_view(values, width, axis).max(axis=-1))


def span_of(spline: BSpline, u: FloatArray) -> tuple[IntArray, ...]:
    """Numbers (n,), along each axis, of the first coefficients that count at parameters (n, 3)."""
    rows = zip(spline.t, spline.k, u.T, spline.periodic, strict=True)
    return tuple(find_spans(t, k, wrap(x, t, k) if closed else x) - k for t, k, x, closed in rows)
