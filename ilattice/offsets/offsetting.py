"""Offset solids of a lattice: from a half-thickness, samples of it, or a relative density.

Guarantee: all walls of a lattice share one distance spline, unless `tol` asks for a finer one.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ilattice._progress import Progress, staged
from ilattice._typing import ArrayLike
from ilattice._validate import as_kind, as_positive
from ilattice.errors import InputError
from ilattice.offsets.density import thickness_of_density
from ilattice.offsets.distance_spline import distance_spline
from ilattice.offsets.mid_surface import MidSurface
from ilattice.offsets.scattered import scattered
from ilattice.offsets.solid import tile_solid
from ilattice.offsets.thickness import as_thickness
from ilattice.offsets.tolerance import refined
from ilattice.offsets.wall import OffsetSolid
from ilattice.tiles.mixture import Mixture


def offset_solid(
    lattice: MidSurface,
    d: Any = None,
    *,
    points: ArrayLike | None = None,
    values: ArrayLike | None = None,
    relative_density: Any = None,
    tol: float | None = None,
    progress: Progress = None,
) -> OffsetSolid:
    """Solid of Euclidean half-thickness `d` about the mid-surface of a lattice.

    Parameters
    ----------
    lattice : MidSurface
        Tiles and map.
    d, points, values, relative_density, tol, progress : optional
        As in `ilattice.lattice.offset`.

    Returns
    -------
    OffsetSolid
        The solid.

    Raises
    ------
    InputError
        If `lattice` is none, or as in `ilattice.lattice.offset`.
    """
    as_kind("lattice", lattice, "MidSurface")
    if points is not None or values is not None:
        if d is not None or points is None or values is None:
            raise InputError("give points and values together, in place of d")
        d = scattered(lattice, points, values)
    if d is None and relative_density is None:
        raise InputError("offset needs a half-thickness d, or a relative_density")
    tol = None if tol is None else as_positive("tol", tol)
    if d is None:
        d = 1e-3 * float(np.linalg.norm(np.diff(lattice.through.bounds, axis=0)))
    sides = as_thickness(d, lattice)
    if sides.unchanged and relative_density is None:
        return tile_solid(lattice, sides, tol)
    if isinstance(lattice.tile, Mixture):  # which makes its cells when it is asked first
        staged({"tiles": lambda: lattice.smooth_tile}, progress)
    distance = distance_spline(lattice, progress=progress)
    if relative_density is not None:
        sides = thickness_of_density(lattice, distance, sides, relative_density, progress)
    solid = OffsetSolid(lattice, distance, sides)
    return solid if tol is None else refined(solid, tol, progress)
