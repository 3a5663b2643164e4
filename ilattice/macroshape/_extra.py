"""Coefficients of extra coordinates: functions of the parameters, interpolated.

Guarantee: functions in the spline space of the volume are reproduced to rounding. Non-guarantee:
how far others are missed is measured at quasi-random parameters, not bounded.
"""

import warnings
from collections.abc import Callable

import numpy as np

from ilattice._geometry import grid_points
from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import as_array, asked
from ilattice.bspline import BSpline
from ilattice.bspline.fit import check_points
from ilattice.bspline.knots import design_matrix
from ilattice.errors import InputError, PrecisionWarning

#: Parameters at which functions are compared with what is stored, and the largest difference
#: without a warning, relative to the range of the function.
CHECKS, MAX_MISSED = 400, 0.01


def interpolated(spline: BSpline, name: str, f: Callable[[FloatArray], ArrayLike]) -> FloatArray:
    """Coefficients, on the knots and weights of a volume, that interpolate a function."""
    sites, systems = zip(*(_collocation(spline, axis) for axis in range(3)), strict=True)
    if any((np.diff(s) <= 0).any() for s in sites):
        raise InputError(f"{name} must be coefficients: the knots of this map allow jumps")
    u = grid_points(*sites)
    values = as_array(name, asked(name, f, u))
    if values.shape != (len(u),):
        raise InputError(f"{name} must return shape ({len(u)},), got {values.shape}")
    c = values.reshape([len(s) for s in sites])
    w = spline.weights
    if w is not None:
        c = c * np.asarray(BSpline(spline.t, w, spline.k, periodic=spline.periodic).grid(sites))
    for axis, system in enumerate(systems):
        c = np.moveaxis(np.tensordot(np.linalg.inv(system), c, axes=(1, axis)), 0, axis)
        if spline.periodic[axis]:
            c = np.take(c, np.arange(spline.shape[axis]) % c.shape[axis], axis=axis)
    return c if w is None else c / w


def warn_missed(spline: BSpline, name: str, f: Callable[[FloatArray], ArrayLike]) -> None:
    """Warn of a function that its interpolating spline misses."""
    u = check_points(spline.domain, CHECKS)
    values = as_array(name, asked(name, f, u))
    missed = float(np.abs(spline(u) - values).max())
    spread = max(float(np.ptp(values)), 1e-9 * float(np.abs(values).max()))
    if missed > MAX_MISSED * spread:
        warnings.warn(
            f"{name} is interpolated in the spline space of the map, and missed by up to "
            f"{100 * missed / spread:.2g} % of its range; give the map more coefficients first, "
            "SplineMap(map.spline.elevate(axis, 2).insert_knots(axis, knots), names=map.names), "
            "and let the function repeat in closed directions",
            PrecisionWarning,
            stacklevel=3,
        )


def _collocation(spline: BSpline, axis: int) -> tuple[FloatArray, FloatArray]:
    """Interpolation sites of one direction, and the basis functions there."""
    t, k, n = spline.t[axis], spline.k[axis], spline.shape[axis]
    lo, hi = spline.domain[:, axis]
    sites = spline.greville(axis)
    if spline.periodic[axis]:
        sites = np.sort(lo + np.mod(sites[: n - k] - lo, hi - lo))
    else:
        sites = lo + (sites - sites[0]) * ((hi - lo) / (sites[-1] - sites[0]))
    sites = np.clip(sites, lo, hi)
    return sites, design_matrix(t, k, sites, periodic=spline.periodic[axis]).toarray()
