"""Radii of entities: numbers, or functions of parameters as splines.

Guarantee: radii are positive. Non-guarantee: a radius given as a function is replaced by a cubic
spline, within 1e-6 of its largest value.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from ilattice._geometry import grid_points
from ilattice._typing import FloatArray
from ilattice._validate import as_array, as_positive, asked
from ilattice.bspline import BSpline
from ilattice.bspline.fit import fit
from ilattice.errors import ConvergenceError, InputError

#: Largest error of the spline that replaces a radius given as a function, relative to its top.
RADIUS_TOL = 1e-6


def as_radius(name: str, value: Any, domain: FloatArray) -> float | BSpline:
    """Positive number, or positive spline over a parameter domain (2, nd).

    Parameters
    ----------
    name : str
        Name for messages.
    value : float, callable or BSpline
        What is given; a function of parameters (n,), or (n, nd) for a surface.
    domain : ndarray, shape (2, nd)
        Parameter domain.

    Returns
    -------
    float or BSpline
        The radius.

    Raises
    ------
    InputError
        If it is not positive, or too rough for a spline.
    """
    if not isinstance(value, BSpline) and not callable(value):
        return as_positive(name, value)
    nd = domain.shape[1]
    spline = value if isinstance(value, BSpline) else _fitted(name, value, domain)
    if spline.ndim != nd or spline.m or spline.weights is not None:
        raise InputError(f"{name} must be a scalar, polynomial spline of {nd} parameters")
    if not np.allclose(spline.domain, domain, rtol=0.0, atol=1e-12 * np.abs(domain).max()):
        raise InputError(
            f"{name} must have the domain {domain.tolist()}, got {spline.domain.tolist()}"
        )
    least = float(spline.c.min())
    if not least > 0.0:
        raise InputError(f"{name} must be positive, but its coefficients reach {least:g}")
    return spline


def _fitted(name: str, f: Callable[..., Any], domain: FloatArray) -> BSpline:
    nd = domain.shape[1]

    def values(t: FloatArray) -> FloatArray:
        return as_array(name, asked(name, f, t[:, 0] if nd == 1 else t))

    axes = [np.linspace(domain[0, i], domain[1, i], 17) for i in range(nd)]
    sample = values(grid_points(*axes))
    if sample.shape != (17**nd,):
        raise InputError(f"{name} must return one value per parameter, got shape {sample.shape}")
    if not sample.min() > 0.0:
        raise InputError(f"{name} must be positive, but reaches {sample.min():g}")
    try:
        return fit(values, domain=domain, degree=3, spans=4, tol=RADIUS_TOL * sample.max())
    except ConvergenceError as e:
        raise InputError(f"{name} varies too roughly for a spline: {e}; give a BSpline") from e


def check_radius(radius: Any) -> None:
    """Refuse what is no radius: of numbers, those that are not positive."""
    if radius is None or callable(radius) or isinstance(radius, BSpline):
        return
    several = isinstance(radius, (list, tuple)) or (
        isinstance(radius, np.ndarray) and radius.ndim > 0
    )
    if not several:
        as_positive("radius", radius)
    elif not (values := as_array("radius", radius, ndim=1)).size or not values.min() > 0.0:
        least = values.min() if values.size else "none"
        raise InputError(f"radius must be one number above zero each, got {least}")
