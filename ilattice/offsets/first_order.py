"""Parametric offsets: walls of first order in the thickness, measured in tiles before the map.

Equations 2 and 3 of Hong et al. 2025: the offset of {I = 0} by d is {I - d |grad I| = 0}, with the
gradient in the coordinates of a tile, so that d is a fraction of a tile. No closest points are
computed; through the map the wall becomes as thick as the map makes it.

Guarantee: exact for planes; the error against the true distance before the map is of second order
in d, and `thickness_error` reports it. Non-guarantee: where grad I vanishes near the wall the
first-order offset means nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ilattice._geometry import grid_indices
from ilattice._progress import Progress
from ilattice._typing import FloatArray
from ilattice._validate import as_kind
from ilattice.bspline import BSpline
from ilattice.macroshape.primitives import box
from ilattice.offsets.distance_spline import interpolated
from ilattice.offsets.mid_surface import MidSurface
from ilattice.offsets.thickness import Thickness, as_thickness
from ilattice.offsets.wall import OffsetSolid

#: Degree of the spline.
DEGREE = 3
#: Thickness of a solid, in the largest edges of tiles, as far as the width of meshes goes: small
#: tiles get no fewer cells than `mesh` gives every tile.
MIN_SOLID = 0.25
#: Least norm of a gradient, as a part of the largest one: zero would divide.
TINY = 1e-6


@dataclass(frozen=True, eq=False)
class ParametricOffset(OffsetSolid):
    """The solid between first-order offsets: what a parametric wall is.

    Attributes
    ----------
    distance : BSpline
        The implicit function I itself; it takes the place of the distance.
    thickness : Thickness
        d |grad I|, in units of I.
    asked : Thickness
        d, in tiles.
    """

    asked: Thickness

    _exact = False
    _has_necks = False

    @property
    def _asked(self) -> Thickness:
        return self.asked

    @cached_property
    def least_thickness(self) -> float:
        """Least total thickness times the least edge of a tile; for solids, see `MIN_SOLID`."""
        lattice = self.lattice
        u = grid_indices(lattice.repeat) + 0.5
        lo, hi = lattice.domain
        step = (hi - lo) / np.array(lattice.repeat)
        edges = np.linalg.norm(lattice.through.jacobian(lo + u * step) * step, axis=1)
        if self.asked.solid:
            return float(MIN_SOLID * edges.max())
        return float(self.asked.extremes[0] * edges.min())

    @cached_property
    def _flat(self) -> MidSurface:
        """The same tiles before the map."""
        lattice = self.lattice
        return MidSurface(lattice.tile, through=box(lattice.repeat), repeat=lattice.repeat)

    def _true_distance(self, u: FloatArray) -> FloatArray:
        """Signed distance to the mid-surface before the map, in tiles."""
        return self._flat.distance(self.lattice.tile_coordinates(u) / np.array(self.lattice.repeat))


def parametric_solid(lattice: MidSurface, d: Any, *, progress: Progress = None) -> ParametricOffset:
    """Wall between the first-order offsets of the mid-surface by `d`, in tiles.

    Parameters
    ----------
    lattice : MidSurface
        Tiles and map.
    d : float, callable, BSpline, str, or pair of these
        Half-thickness as in `offset`, but as a fraction of a tile before the map.
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Returns
    -------
    ParametricOffset
        The solid; `thickness_error` compares it with the true distance before the map.

    Raises
    ------
    InputError
        If `d` is not positive or larger than the part.

    Notes
    -----
    Hong et al. 2025, eq. 2 and 3.
    """
    as_kind("lattice", lattice, "MidSurface")
    asked = as_thickness(d, lattice, float(np.linalg.norm(lattice.repeat)))

    def fitted(f: Callable[[FloatArray], FloatArray]) -> BSpline:
        return interpolated(lattice, lambda u, _: f(u), lattice.spans, DEGREE, progress)

    edges = np.ptp(lattice.domain, axis=0) / np.array(lattice.repeat)

    def in_units_of_the_field(side: BSpline) -> BSpline:
        if side is asked.inner and asked.solid:
            return side
        s = fitted(
            lambda u: side(u) * np.linalg.norm(lattice.implicit_jet(u, 1)[1] * edges, axis=1)
        )
        if not side.c.min() > 0:
            return s
        # at critical points of I the norm has a kink, next to which the spline could turn negative
        return BSpline(s.t, np.maximum(s.c, TINY * s.c.max()), s.k, periodic=s.periodic)

    outer = in_units_of_the_field(asked.outer)
    inner = outer if asked.symmetric else in_units_of_the_field(asked.inner)
    field = lattice._once("implicit_spline", lambda: fitted(lattice.implicit))
    return ParametricOffset(lattice, field, Thickness(inner, outer), asked)
