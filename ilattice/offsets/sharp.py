"""The distance spline with exact distances where it rounds off a kink next to a wall.

A C1 spline rounds off the kinks of the distance, in the middle of pores and throats, over about a
span. A wall that ends there would close pores early, and round off the creases where its surfaces
meet. There the length of the spline's gradient in space is not 1, which tells where to ask for
closest points instead.

Guarantee: values differ from the spline's only within `BAND` spans of the level of a wall.
Non-guarantees: some points at kinks are missed, where the gradient has length 1 by chance; values
jump where exact ones take over, by the error of the spline there; derivatives are those of the
spline.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ilattice._field import Field
from ilattice._typing import AnyArray, FloatArray
from ilattice._validate import as_points
from ilattice.offsets._small import solved

if TYPE_CHECKING:
    from ilattice._typing import ArrayLike
    from ilattice.bspline import BSpline
    from ilattice.offsets.mid_surface import MidSurface
    from ilattice.offsets.thickness import Thickness

#: Distances from the level of the wall, in the longest spans, at which kinks matter: more than the
#: largest error of the spline, a quarter of a span.
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

    @property
    def bounds(self) -> FloatArray:
        """The parameter domain, under the name that fields have."""
        return self.domain

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
        """Value, and derivatives of the spline: `order` + 1 of them."""
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
        return np.minimum(np.abs(-s - inner), np.abs(s - outer)) < self.band

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
