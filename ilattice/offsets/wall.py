"""Walls as solids: the part of a lattice within a given distance of its mid-surface.

Guarantees: the wall is the pair of level sets S < d_outer and S > -d_inner of one distance
spline S; another thickness does not compute distances again; where offset surfaces meet, the
topology follows by itself. Non-guarantee: between sites S is exact to its fit only; `tol`
refines it, and `mesh(polish=True)` moves vertices onto the exact offset.

What can be done with walls (`mesh`, `slices`, `topology`) is in `ilattice.lattice.Wall`.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ilattice._shown import Shown
from ilattice._typing import AnyArray, FloatArray
from ilattice._validate import as_flag
from ilattice.bspline import BSpline
from ilattice.errors import GeometryError, InputError, PrecisionWarning
from ilattice.macroshape.maps import SplineMap
from ilattice.offsets.density import tile_volumes, volumes
from ilattice.offsets.local_thickness import depths_of, least_of, points
from ilattice.offsets.mid_surface import MidSurface
from ilattice.offsets.thickness import Thickness
from ilattice.offsets.volume_points import Estimate, Rounded, VolumePoints
from ilattice.offsets.wall_field import WallField

#: Boxes with random points at which exact distances are asked for, and the part of the volume from
#: which on it is told that they give another one.
BOXES, TOLD = 1 << 14, 0.01
#: What parts of these boxes may do where the spline is off by more than is usual: exact distances
#: are slow there, and needed far from the surfaces.
PARTS = (16, 4)
#: Boxes with random points by which volumes are estimated first; so many take a tenth of a second.
#: And the most per cell of the spline, one of which takes quadrature as long as two boxes or more.
FIRST, PER_CELL = 1 << 16, 2
#: Length of edges over the least thickness from which on there is a warning, and the one that is
#: advised; chosen without measurements.
COARSE, ADVISED = 0.6, 0.5


@dataclass(frozen=True, eq=False)
class OffsetSolid(Shown):
    """The part of a lattice within a thickness of its mid-surface: what a wall is.

    Attributes
    ----------
    lattice : MidSurface
        Where it comes from.
    distance : BSpline
        Signed distance to the mid-surface as a function of the parameters.
    thickness : Thickness
        Half-thickness on both sides.
    """

    lattice: MidSurface
    distance: BSpline
    thickness: Thickness

    @cached_property
    def field(self) -> WallField:
        """The implicit function, negative in the wall."""
        return WallField(self.distance, self.thickness)

    @property
    def drawn(self) -> Any:
        """What meshes go by in place of the distance."""
        return self.distance

    def _drawn_distance(self, u: FloatArray) -> FloatArray:
        """What meshes go by, as a length in space, shape (n,), at parameters (n, 3)."""
        found: FloatArray = self.distance(u)
        return found

    @property
    def ragged(self) -> AnyArray:
        """Along which directions what meshes go by jumps at faces between tiles, shape (3,)."""
        return np.zeros(3, np.bool_)

    @property
    def through(self) -> SplineMap:
        """Map from the parameters to space."""
        return self.lattice.through

    @property
    def name(self) -> str:
        """Name of the tiles."""
        return self.lattice.tile.name

    @property
    def named_properties(self) -> MidSurface:
        """Where properties come from that are given by name."""
        return self.lattice

    def level_sets(self) -> WallField:
        """What is negative in the solid, for quadrature.

        Returns
        -------
        WallField
            Two level sets of one distance spline.
        """
        return self.field

    @cached_property
    def least_thickness(self) -> float:
        """Least total thickness, less where one side meets itself, as in struts thinner than it.

        Of what meets itself, and of solids, the thinnest tenth of what is left does not count.
        """
        least = self.thickness.extremes[0]
        depth = -float(self.distance.c.min())
        if not self.thickness.solid:
            return self._least_filled(least, depth)
        u, depths, area = depths_of(self.lattice, depth)
        local = depths + self.thickness.outer(u)
        left = local > 0.0
        if left.any():  # of eroded ones, surfaces hold less the less is left behind them
            rest = np.minimum(1.0, local[left] / depths[left])
            return 2.0 * least_of(local[left], area[left] * rest)
        if least + depth > 0.0:
            return 2.0 * (least + depth)
        raise GeometryError(
            f"nothing is left of the solid: it is {depth:g} deep and eroded by {-least:g}"
        )

    def _least_filled(self, least: float, depth: float) -> float:
        """Least total thickness of a wall that may fill what is behind its surface."""
        inner, outer = self.thickness.inner, self.thickness.outer
        most = float(inner.c.max())
        # where the outer side is as thick, what meets itself is no thinner than the two of them
        if self.thickness.symmetric or depth <= 0.0 or most <= float(outer.c.min()):
            return least
        u, depths, area = depths_of(self.lattice, min(depth, most))
        local = np.where(depths < inner(u), 2.0 * (depths + outer(u)), np.inf)
        return min(least, least_of(local, area)) if len(u) else least

    def _in_space(self, name: str) -> OffsetSolid:
        if not self._exact:
            raise InputError(f"{name} is for walls in space, this one is parametric")
        return self

    def volume(self) -> float:
        """Volume of the wall in space, by cut-cell quadrature.

        Returns
        -------
        float
            Volume, as the distance spline has it, which `volume_error` is about: see `tol` of
            `offset`. Meshes hold less or, of thin walls on coarse grids, more: those of struts that
            are two cells thick one to three parts in a hundred less.

        Warns
        -----
        PrecisionWarning
            If exact distances give another volume by more than 1 %.
        """
        if "told" not in self._known:
            self._tell_rounded()
            self._known["told"] = 1.0
        return self._volume

    @property
    def _volume(self) -> float:
        """The volume, without a word on how good the spline is."""
        if "volume" not in self._known:
            self._known["volume"] = float(self._filled.sum())
        return self._known["volume"]

    @cached_property
    def _filled(self) -> FloatArray:
        """Volume in every tile."""
        return volumes(self.lattice, self.level_sets())

    @cached_property
    def _estimates(self) -> list[Estimate]:
        """Volumes by ever more random points, as far as they were asked for."""
        return [VolumePoints(self, min(FIRST, self._most_boxes)).filled]

    @property
    def _most_boxes(self) -> int:
        """Boxes with random points that take no longer than the exact volume, about."""
        return PER_CELL * math.prod(len(self.distance.breaks(axis)) - 1 for axis in range(3))

    def _estimated(self, error: float) -> Estimate:
        """The volume to about a standard error; the exact one where points would be too many."""
        if self.known_volume is None:
            last = self._estimates[-1]
            if last.error <= error:
                return last
            boxes = last.more(error)
            if boxes <= self._most_boxes:
                self._estimates.append(VolumePoints(self, boxes).filled)
                return self._estimates[-1]
        return Estimate(self._volume, 0.0, 0)

    @cached_property
    def volume_error(self) -> float:
        """How far `volume` may be off, because splines approximate distances or fields.

        Of walls: the volume that exact distances change at random points, and two standard errors.
        Of solids of tiles as they are: their area times the error of the spline.
        """
        return abs(self._rounded.volume) + 2.0 * self._rounded.error

    @cached_property
    def _rounded(self) -> Rounded:
        """What exact distances add to the volume; of few points where they are slow and decide."""
        for part in PARTS:
            found = VolumePoints(self, BOXES // part).rounded
            if not found.rough:
                break
            if found.decides(TOLD * self._volume):
                return found
        return VolumePoints(self, BOXES).rounded

    def _tell_rounded(self) -> None:
        """Warn of a volume that is off."""
        if not self._exact:
            return
        whole, (change, error, _) = self._volume, self._rounded
        if abs(change) - 2.0 * error > TOLD * whole:
            warnings.warn(
                f"the volume {whole:.6g} is that of the distance spline; exact distances give "
                f"{100 * abs(change) / whole:.2g} % {'more' if change > 0.0 else 'less'}: use tol, "
                f"or spans_per_tile > {self.lattice.spans}",
                PrecisionWarning,
                stacklevel=3,
            )

    @property
    def known_volume(self) -> float | None:
        """What `volume` has returned, also to `mesh`; None if none asked for the exact one."""
        return self._known.get("volume")

    def relative_density(self, *, per_cell: bool = False) -> Any:
        """Part of the macro-shape that the wall fills, by cut-cell quadrature.

        Parameters
        ----------
        per_cell : bool
            Whether to give one number per tile.

        Returns
        -------
        float, or ndarray of shape (nx, ny, nz)
            Relative density.
        """
        per_cell = as_flag("per_cell", per_cell)
        filled, tiles = self._filled, tile_volumes(self.lattice)
        return filled / tiles if per_cell else float(filled.sum() / tiles.sum())

    @cached_property
    def _known(self) -> dict[str, float]:
        """What has been computed already."""
        return {}

    def _middle(self, most: int) -> tuple[FloatArray, FloatArray]:
        """Parameters (n, 3) of points of the mid-surface, and areas (n,), up to a factor."""
        u, _, _, area = points(self.lattice, most)
        return u, area

    #: Whether vertices can be polished onto an exact offset.
    _exact = True
    #: Whether necks can be found: where the distance has critical points.
    _has_necks = True
    _countable = False  # whether its parts can be counted by many values of its field
    #: Whether edges of meshes are made sharp where the gradient of the field jumps.
    creased = False

    @property
    def _asked(self) -> Thickness:
        """The half-thickness as it was asked for, in the units of `_true_distance`."""
        return self.thickness

    def _true_distance(self, u: FloatArray) -> FloatArray:
        """Signed distance to the mid-surface by fresh closest points."""
        return self.lattice.distance(u)

    def _errors(self, u: FloatArray, side: AnyArray) -> tuple[FloatArray, FloatArray]:
        """Errors of the half-thickness at points of the offset surfaces, and what it should be."""
        off = self._asked.clearance(u, side, self._true_distance(u))
        return np.abs(off), self._asked.at(u, side)


def warn_coarse(h: float, least: float) -> None:
    """Warn of a mesh that is too coarse for the wall."""
    if h > COARSE * least:
        warnings.warn(
            f"h={h:g} is coarse for a wall that is {least:g} thick at its thinnest: thinner "
            f"parts may be lost; use h <= {ADVISED * least:g}",
            PrecisionWarning,
            stacklevel=4,
        )
