"""Volume, mass, centroid and inertia of walls and other solids, and the area of their surface.

Guarantee: as accurate as the quadrature, of the wall as its distance spline has it; no mesh.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ilattice._progress import Progress, staged
from ilattice._typing import FloatArray
from ilattice._validate import Frozen, as_array, asked, check_finite
from ilattice.errors import InputError
from ilattice.quadrature.cutting import cut

Density = float | Callable[[FloatArray], Any]


@dataclass(frozen=True, eq=False)
class MassProperties(Frozen):
    """What a solid weighs.

    Attributes
    ----------
    volume, area, mass : float
        Volume; area of the level sets that bound it, end faces excluded; mass.
    centroid : ndarray, shape (3,)
        Centre of mass.
    inertia : ndarray, shape (3, 3)
        Inertia tensor about the centroid.
    """

    volume: float
    area: float
    mass: float
    centroid: FloatArray
    inertia: FloatArray


def mass_properties(
    field: Any, cells: Any = None, *, density: Density = 1.0, q: int = 3, domain: Any = None,
    progress: Progress = None,
) -> MassProperties:  # fmt: skip
    """Volume, area, mass, centroid and inertia: in space for a wall.

    Parameters
    ----------
    field : Wall, BSpline, callable, or pair of fields
        The solid is where it is negative, as in `cut`.
    cells : int, sequence of 3 int or Grid, optional
        Background grid, as in `cut`.
    density : float or callable
        Mass per volume; a callable takes points (n, 3) and returns (n,).
    q : int
        Gauss points per direction and piece of a cell, 1 to 10.
    domain : array_like, shape (2, 3), optional
        Box of the grid; by default the bounds of the field.
    progress : bool or callable, optional
        "cells", "rules" and "surface"; see `ilattice._progress.track`.

    Returns
    -------
    MassProperties
        The numbers.

    Raises
    ------
    InputError
        If an argument is wrong, or the density is negative, or zero everywhere.
    """
    grid = cut(field, cells, domain=domain)
    staged({"cells": lambda: grid.status}, progress)
    work = {"rules": lambda: grid.volume(q), "surface": lambda: grid.surface(q)}
    solid, boundary = staged(work, progress)
    if grid.through is not None:
        solid, boundary = solid.in_space(), boundary.in_space()
    rho = _as_density(density, solid.points)
    mass = solid.integrate(rho)
    if not mass > 0:
        raise InputError("density must be positive somewhere in the solid")
    centroid = solid.integrate(rho[:, None] * solid.points) / mass
    r = solid.points - centroid
    second = (solid.weights * rho) * r.T @ r
    inertia = np.trace(second) * np.eye(3) - second
    return MassProperties(solid.integrate(), boundary.integrate(), mass, centroid, inertia)


def _as_density(density: Density, points: FloatArray) -> FloatArray:
    value = as_array("density", asked("density", density, points) if callable(density) else density)
    if value.size != 1 and value.shape != (len(points),):
        raise InputError(
            f"density must give one value per point, shape ({len(points)},), got {value.shape}"
        )
    if value.min() < 0:
        raise InputError(f"density must not be negative, got {value.min():g}")
    return check_finite("density", np.array(np.broadcast_to(value.ravel(), len(points))))
