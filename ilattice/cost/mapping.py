"""Maps of structures: spline volumes, Bernstein-Bezier simplices, functions.

Guarantee: vertices are where the map takes them, edges stay straight, and simplices that the map
turns inside out are refused by number. The paper's formula of Bernstein-Bezier maps omits the
multinomial factor; here it is kept, so that control points are Bezier points.
"""

from dataclasses import dataclass
from math import factorial
from typing import Any

import numpy as np

from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice._validate import Frozen, as_array, as_whole, asked, read_only
from ilattice.cost._structure import K, Structure
from ilattice.errors import GeometryError, InputError
from ilattice.macroshape import SplineMap

#: How far outside of the domain of a map a vertex may be, as a part of its size.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class BernsteinSimplex(Frozen):
    """Polynomial map of a simplex of total degree n: sum of n!/alpha! c_alpha xi^alpha.

    Attributes
    ----------
    degree : int
        Total degree n.
    points : ndarray, shape (C(n + d, d), k)
        Bezier points, in the order of `exponents`.
    corners : ndarray, shape (d + 1, d)
        Corners of the simplex whose barycentric coordinates are xi.
    """

    degree: int
    points: FloatArray
    corners: FloatArray

    def __post_init__(self) -> None:
        """Check the arguments."""
        n = as_whole("degree", self.degree, 1, 20)
        corners = as_array("corners", self.corners, ndim=2)
        d = corners.shape[1]
        if d not in (2, 3) or len(corners) != d + 1:
            raise InputError(f"corners must have shape (3, 2) or (4, 3), got {corners.shape}")
        sides = corners[1:] - corners[0]
        if np.linalg.svd(sides)[1][-1] <= 1e-12 * np.abs(sides).max():
            raise InputError(f"corners must not be flat, got {corners.tolist()!r:.120}")
        points = as_array("points", self.points, ndim=2)
        count = len(exponents(n, d))
        if len(points) != count:
            raise InputError(f"points must be {count} rows for degree {n}, got {points.shape}")
        put = object.__setattr__
        put(self, "degree", n)
        put(self, "points", np.array(points))
        put(self, "corners", np.array(corners))
        super().__post_init__()

    @property
    def dim(self) -> int:
        """Dimension of the simplex."""
        return self.corners.shape[1]

    def barycentric(self, x: ArrayLike) -> FloatArray:
        """Barycentric coordinates of points in the simplex.

        Parameters
        ----------
        x : array_like, shape (n, d)
            Points.

        Returns
        -------
        ndarray, shape (n, d + 1)
            They sum to 1, and are not negative inside.
        """
        p = as_array("x", x, ndim=2)
        if p.shape[1] != self.dim:
            raise InputError(f"x must have shape (n, {self.dim}), got {p.shape}")
        sides = self.corners[1:] - self.corners[0]
        xi = np.linalg.solve(sides.T, (p - self.corners[0]).T).T
        return np.column_stack([1.0 - xi.sum(axis=1), xi])

    def __call__(self, x: ArrayLike, /) -> FloatArray:
        """Images (n, k) of points (n, d)."""
        xi = self.barycentric(x)
        out = np.zeros((len(xi), self.points.shape[1]))
        for alpha, c in zip(exponents(self.degree, self.dim), self.points, strict=True):
            factor = factorial(self.degree) / np.prod([float(factorial(a)) for a in alpha])
            out += factor * np.prod(xi**alpha, axis=1)[:, None] * c
        return out

    @classmethod
    def straight(cls, corners: ArrayLike, degree: int) -> "BernsteinSimplex":
        """The identity of a simplex, as a map of some degree: a start for moving its points.

        Parameters
        ----------
        corners : array_like, shape (d + 1, d)
            Corners of the simplex.
        degree : int
            Degree of the map.

        Returns
        -------
        BernsteinSimplex
            Its points are the domain points sum of alpha / n times corners.
        """
        c = as_array("corners", corners, ndim=2)
        n = as_whole("degree", degree, 1, 20)
        return cls(n, exponents(n, c.shape[1]) / n @ c, c)


def exponents(degree: int, dim: int) -> IntArray:
    """Exponents alpha of Bernstein polynomials.

    Parameters
    ----------
    degree : int
        Total degree n.
    dim : int
        Dimension d.

    Returns
    -------
    ndarray of int, shape (C(n + d, d), d + 1)
        Rows that sum to n, in falling lexicographic order.
    """
    rows = [(*a, degree - sum(a)) for a in np.ndindex(*[degree + 1] * dim) if sum(a) <= degree]
    return np.asarray(read_only(np.array(rows[::-1], np.int64)))


def mapped(k: K, through: Any) -> K:
    """A structure moved through a map; see `CornerSharing.mapped`."""
    new = _images(k, through)
    if new.ndim != 2 or len(new) != len(k.positions) or new.shape[1] not in (2, 3):
        raise InputError(
            f"through must give one point per vertex, shape ({len(k.positions)}, d), "
            f"got {new.shape}"
        )
    out = type(k)(new, k.simplices, k.bars, k.origin) if new.shape[1] == k.dim else None
    if out is None:
        raise InputError(f"through must keep the dimension {k.dim}, got points of {new.shape[1]}")
    turned = np.flatnonzero(np.sign(k.volumes) * out.volumes <= 0.0)
    if len(turned):
        raise GeometryError(
            f"the map inverts {len(turned)} of {len(k.simplices)} simplices: numbers "
            f"{turned[:8].tolist()}{' and more' if len(turned) > 8 else ''}; unfold it, or refine"
        )
    return out


def _images(k: Structure, through: Any) -> FloatArray:
    x = k.positions
    if isinstance(through, SplineMap):
        lo, hi = np.asarray(through.domain)
        if k.dim != len(lo):
            raise InputError(f"through is a map of {len(lo)} parameters, the structure has {k.dim}")
        slack = ROUNDING * (hi - lo)
        out = np.flatnonzero(((x < lo - slack) | (x > hi + slack)).any(axis=1))
        if len(out):
            raise InputError(
                f"vertex {out[0]} at {x[out[0]].tolist()} is outside of the domain "
                f"{lo.tolist()} to {hi.tolist()} of the map ({len(out)} are): positions are its "
                "parameters; see `fitted(map.domain)`"
            )
        return np.asarray(through.x(np.clip(x, lo, hi)))
    if isinstance(through, BernsteinSimplex):
        low = through.barycentric(x).min(axis=1)
        out = np.flatnonzero(low < -ROUNDING)
        if len(out):
            raise InputError(
                f"vertex {out[0]} at {x[out[0]].tolist()} is outside of the simplex of the map, "
                f"with a barycentric coordinate of {low[out[0]]:.3g} ({len(out)} are outside)"
            )
    if not callable(through):
        raise InputError(f"through must be a map or a function, got {through!r:.80}")
    return as_array("values of through", asked("through", through, np.array(x)))
