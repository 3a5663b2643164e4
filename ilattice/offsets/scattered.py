"""Half-thickness from values at scattered points of space.

Between the points values are interpolated by thin-plate splines (by radial functions |r| where all
points are in a plane), clipped to the range of the values: no overshoot, and none beyond the
points, where the interpolant goes on until it reaches the range. Points in space are related to
parameters by the map, x(u), which is never inverted.

Guarantees: interpolates, to `TOLERANCE` of the largest value where the map and the clipping allow
(a warning tells of a thousandth of the half-thickness and more); within the range of the values;
continuous for up to `GLOBAL` points.
Non-guarantees: of more points only the `NEAREST` ones act at a place, so that there are small
jumps; where the part reaches far beyond the points (`FAR`) values are guesses, of which a warning
tells.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial import cKDTree

from ilattice._field import Field
from ilattice._geometry import grid_points
from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import as_array, as_points
from ilattice.errors import InputError, PrecisionWarning

if TYPE_CHECKING:
    from ilattice.macroshape.tiling import Tiling

#: Up to so many points all of them act everywhere, of more so many.
GLOBAL, NEAREST = 1500, 64
#: A place is beyond the points where the nearest one is farther than this many times the largest
#: distance of neighbouring points; samples per direction, and the part of them that is told of.
FAR, SITES, MAX_BEYOND = 1.5, 17, 0.01
#: Places at which values are interpolated at once: each takes a row as long as there are points.
BATCH = 1 << 14
#: Error of the spline over the domain, relative to the largest value.
TOLERANCE = 2e-3


class Scattered(Field):
    """Function of the parameters that interpolates values at points of space.

    Parameters
    ----------
    lattice : Lattice
        Gives the map.
    p, v : ndarray, shape (n, 3) and (n,)
        Different points of space, and values.
    """

    tolerance = TOLERANCE

    def __init__(self, lattice: Tiling, p: FloatArray, v: FloatArray) -> None:
        sizes = np.linalg.svd(p - p.mean(axis=0), compute_uv=False)
        flat = len(p) < 5 or not sizes[-1] > 1e-6 * sizes[0]
        self.lattice, self.ends = lattice, (float(v.min()), float(v.max()))
        self.inside = RBFInterpolator(
            p, v, neighbors=None if len(p) <= GLOBAL else NEAREST, degree=0 if flat else 1,
            kernel="linear" if flat else "thin_plate_spline",
        )  # fmt: skip

    def __call__(self, u: ArrayLike, /) -> FloatArray:
        """Values (n,) at parameters (n, 3)."""
        x = self.lattice.through.x(as_points("u", u))
        if not len(x):
            return np.empty(0)
        parts = [self.inside(x[i : i + BATCH]) for i in range(0, len(x), BATCH)]
        return np.clip(np.concatenate(parts), *self.ends)


def scattered(lattice: Tiling, points: ArrayLike, values: ArrayLike) -> Scattered | float:
    """Function of the parameters from values at points of space.

    Parameters
    ----------
    lattice : Lattice
        Gives the map.
    points : array_like, shape (n, 3)
        Points of space.
    values : array_like, shape (n,)
        Half-thickness there, positive.

    Returns
    -------
    Scattered or float
        The function; a number where all values are equal.

    Raises
    ------
    InputError
        If shapes disagree, a value is not positive, or a point has two values.

    Warns
    -----
    PrecisionWarning
        If more than 1 % of the part is far from all points.
    """
    p, v = _merged(as_points("points", points), as_array("values", values))
    _warn_beyond(lattice, p)
    return Scattered(lattice, p, v) if np.ptp(v) > 0.0 else float(v[0])


def _merged(p: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points and values, checked; equal points once."""
    if v.shape != (len(p),) or not len(p):
        raise InputError(
            "points and values must be as many, shapes (n, 3) and (n,), got "
            f"{p.shape} and {v.shape}"
        )
    if not (v > 0.0).all():
        i = int(np.argmin(v))
        raise InputError(f"values must be positive, but values[{i}] is {v[i]:g}")
    own, first, number = np.unique(p, axis=0, return_index=True, return_inverse=True)
    two = np.flatnonzero(v != v[first][number.ravel()])
    if len(two):
        i = int(two[0])
        raise InputError(
            f"points[{i}] = {p[i].tolist()} is there twice, with values {v[i]:g} and "
            f"{v[first][number.ravel()][i]:g}; keep one, or their mean"
        )
    return own, v[first]


def _warn_beyond(lattice: Tiling, p: FloatArray) -> None:
    """Warn of a part that reaches far beyond the points."""
    if len(p) < 2:
        return
    tree = cKDTree(p)
    near: Any = tree.query(p, k=2)[0]
    apart = float(near[:, 1].max())
    lo, hi = lattice.domain
    axes = [np.linspace(lo[a], hi[a], SITES) for a in range(3)]
    u = grid_points(*axes)
    away: Any = tree.query(lattice.through.x(u))[0]
    beyond = away > FAR * apart
    if beyond.mean() > MAX_BEYOND:
        warnings.warn(
            f"{beyond.mean():.0%} of the part is farther from all points, by up to {away.max():.3g}"
            f", than these are from each other ({apart:.3g}): the half-thickness there is a guess "
            "within the range of the values",
            PrecisionWarning,
            stacklevel=5,
        )
