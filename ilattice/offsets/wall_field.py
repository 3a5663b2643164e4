"""The implicit function of a wall: the larger one of two level sets of the distance.

Guarantee: value, derivatives and bounds are those of the splines it is made of.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ilattice._field import Field
from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import as_points
from ilattice.bspline import BSpline
from ilattice.offsets.thickness import Thickness

#: Boxes of up to so many spans per direction are bounded element by element, wider ones by the
#: extremes of their coefficients: contouring asks for boxes of hundreds of elements.
NARROW = 4


@dataclass(frozen=True, eq=False)
class WallField(Field):
    """The implicit function of a wall, negative in the wall: max(S - d_outer, -S - d_inner).

    Attributes
    ----------
    distance : BSpline
        Signed distance S.
    thickness : Thickness
        Half-thickness on both sides.
    """

    distance: BSpline
    thickness: Thickness

    @property
    def bounds(self) -> FloatArray:
        """The parameter domain, shape (2, 3)."""
        return self.distance.domain

    def __call__(self, u: ArrayLike, /) -> FloatArray:
        """Value, shape (n,), at parameters (n, 3)."""
        return self.jet(u, 0)[0]

    def jet(self, u: ArrayLike, order: int = 2) -> tuple[FloatArray, ...]:
        """Value, gradient and Hessian of the side that bounds the wall: `order` + 1 of them."""
        u = as_points("u", u)
        s = self.distance.jet(u, order)
        outer = self.thickness.outer.jet(u, order)
        inner = outer if self.thickness.symmetric else self.thickness.inner.jet(u, order)
        out = s[0] - outer[0] >= -s[0] - inner[0]
        pick = [out.reshape(-1, *(1,) * (a.ndim - 1)) for a in s]
        return tuple(
            np.where(p, a - b, -a - c) for p, a, b, c in zip(pick, s, outer, inner, strict=True)
        )

    def range(self, lo: ArrayLike, hi: ArrayLike) -> FloatArray:
        """Rigorous bounds, shape (m, 2), on boxes; looser ones on boxes of many spans."""
        lo, hi = as_points("lo", lo), as_points("hi", hi)
        spans = np.array([np.diff(self.distance.breaks(a)).max() for a in range(3)])
        narrow = (hi - lo <= NARROW * spans).all(axis=1)
        out = np.empty((len(lo), 2))
        for tight in (False, True):
            at = np.flatnonzero(narrow == tight)
            out[at] = self._bounds(lo[at], hi[at], tight)
        return out

    def _bounds(self, lo: FloatArray, hi: FloatArray, tight: bool) -> FloatArray:
        s = self.distance.range(lo, hi, tight=tight)
        outer = self.thickness.outer.range(lo, hi, tight=tight)
        symmetric = self.thickness.symmetric
        inner = outer if symmetric else self.thickness.inner.range(lo, hi, tight=tight)
        low = np.maximum(s[:, 0] - outer[:, 1], -s[:, 1] - inner[:, 1])
        high = np.maximum(s[:, 1] - outer[:, 0], -s[:, 0] - inner[:, 0])
        return np.stack([low, high], axis=1)

    def side(self, u: FloatArray) -> FloatArray:
        """+1 where the outer level set bounds the wall, -1 where the inner one does."""
        s = self.distance(u)
        return np.where(s - self.thickness.outer(u) >= -s - self.thickness.inner(u), 1.0, -1.0)

    def sums(self) -> tuple[tuple[Any, ...], FloatArray]:
        """Splines, and factors (2, splines) by which the two level sets are sums of them."""
        t = self.thickness
        distance = self.distance.approximation or self.distance
        if t.symmetric:
            return (distance, t.outer), np.array([[1.0, -1.0], [-1.0, -1.0]])
        factors = np.array([[1.0, -1.0, 0.0], [-1.0, 0.0, -1.0]])
        return (distance, t.outer, t.inner), factors
