"""A lattice in tile coordinates: its map and its tiles as kernels take them.

The continuation of a map beyond open ends of the domain counts as far as it is upright: as long as
det J keeps its sign and `_kernels_jets.UPRIGHT` of the size that it has at the point of the domain
next to it, seen in quarters of the way. A polynomial that leaves its domain may fold soon, where
cells are bent or nearly singular, and squeezes the surface before it does. Nor does it count for
points of the domain to which it comes back: those nearer to it than `BESIDE` of the way from the
end of the domain.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ilattice._geometry import determinants, grid_indices
from ilattice._typing import AnyArray, FloatArray
from ilattice._validate import as_array, as_kind, as_points
from ilattice.bspline import BSpline
from ilattice.errors import InputError
from ilattice.offsets import _kernels_seeds
from ilattice.offsets._kernels_jets import (
    CLOSED,
    CREASED,
    ENDS,
    LATTICE_SPLINE,
    ORIGIN,
    STEP,
    TILE_SPLINE,
    TRIGONOMETRIC,
    Space,
)
from ilattice.offsets._kernels_patches import PLAIN, SQUEEZED_TOO
from ilattice.tiles.mixture import MixedField
from ilattice.tiles.trig import TrigField

if TYPE_CHECKING:
    from ilattice.macroshape.tiling import Tiling

#: Tiles with sides of such a ratio are squeezed.
LONG = 4.0
#: Degrees of maps for which kernels are compiled by themselves, a dozen seconds each, which takes a
#: quarter off the time of a search; of the others, with less to add up, about a twentieth.
UNROLLED = {(2, 2, 2), (3, 3, 3)}


class TileSpace:
    """Tile coordinates of a lattice.

    Parameters
    ----------
    lattice : Lattice
        The tiles, their map and the boundary rule.
    """

    def __init__(self, lattice: Tiling) -> None:
        self.lattice = as_kind("lattice", lattice, "Tiling")
        self.space = kernel_space(lattice)
        geom = self.space.geom
        self.lo, self.step = geom[ORIGIN:STEP], geom[STEP:CLOSED]
        self.creased, self.ends = bool(geom[CREASED]), geom[ENDS:] != 0.0
        self.orient = float(lattice.through.orientation)
        count, closed = np.array(lattice.repeat), np.array(lattice.through.closed)
        self.box = np.array([np.where(closed, -np.inf, 0.0), np.where(closed, np.inf, count)])

    def to_tile(self, u: FloatArray) -> FloatArray:
        """Parameters to tile coordinates.

        Parameters
        ----------
        u : ndarray, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n, 3)
            Tile coordinates.
        """
        return (_triples("u", u) - self.lo) / self.step

    def from_tile(self, p: FloatArray) -> FloatArray:
        """Tile coordinates to parameters.

        Parameters
        ----------
        p : ndarray, shape (n, 3)
            Tile coordinates.

        Returns
        -------
        ndarray, shape (n, 3)
            Parameters.
        """
        return self.lo + _triples("p", p) * self.step

    def within(self, p: FloatArray) -> AnyArray:
        """Which points are in the domain, and not beyond an open end of it.

        Parameters
        ----------
        p : ndarray, shape (n, 3)
            Tile coordinates.

        Returns
        -------
        ndarray of bool, shape (n,)
            True there.
        """
        p = _triples("p", p)
        out: AnyArray = ((p >= self.box[0]) & (p <= self.box[1])).all(axis=-1)
        return out

    def _volume(self, p: FloatArray) -> FloatArray:
        """Determinants (n,) of the Jacobian at points (n, 3), positive in the domain."""
        return self.orient * determinants(self._jacobian(p))

    def _jacobian(self, p: FloatArray) -> FloatArray:
        """Derivatives (n, 3, 3) of the map in tile coordinates."""
        jacobian = self.lattice.through.jacobian(self.from_tile(p), extrapolate="extend")
        return np.asarray(jacobian * self.step)

    @property
    def _columns(self) -> int:
        """Of the normals of seeds: more where cells are squeezed, see `_kernels_patches`."""
        middle: Any = grid_indices(self.lattice.repeat) + 0.5
        size = np.linalg.svd(self._jacobian(middle), compute_uv=False)
        squeezed = bool((size[:, 0] > LONG * size[:, 2]).any())
        return SQUEEZED_TOO if squeezed else PLAIN

    def _project(self, p: FloatArray, m: AnyArray, fixed: FloatArray | None = None) -> FloatArray:
        """Points moved onto I = 0; those that move further than 1.2 cells are dropped."""
        moved = np.empty(len(p))
        fixed = np.zeros((len(p), 3)) if fixed is None else fixed
        project: Any = _kernels_seeds.project
        project(len(p), self.space, p, fixed, 0.5 / float(np.min(m)), moved)
        return p[moved <= 1.2 / float(np.min(m))]

    def on_surface(
        self, p: FloatArray, fixed: AnyArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Points moved onto the mid-surface along the gradient.

        Parameters
        ----------
        p : ndarray, shape (n, 3)
            Tile coordinates.
        fixed : ndarray of bool, shape (n, 3), optional
            Coordinates that must not change.

        Returns
        -------
        tuple of ndarray
            Tile coordinates (n, 3), and how far they have moved (n,), infinite where they have not
            got there.
        """
        out = as_points("p", p).copy()
        held = np.zeros(out.shape) if fixed is None else as_array("fixed", fixed)
        if held.shape != out.shape:
            raise InputError(f"fixed must have shape {out.shape}, as p has, got {held.shape}")
        moved = np.empty(len(out))
        project: Any = _kernels_seeds.project
        project(len(out), self.space, out, held, 0.1, moved)
        return out, moved


def _triples(name: str, value: AnyArray) -> FloatArray:
    """Array of which the last axis is one of three numbers, perhaps infinite."""
    a = as_array(name, value, finite=False)
    if a.shape[-1:] != (3,):
        raise InputError(f"{name} must be points as rows, shape (n, 3), got {a.shape}")
    return a


def kernel_space(lattice: Tiling, *, generic: bool = False) -> Space:
    """What the kernels need to know of a lattice.

    Generic ones are for kernels that must not be compiled once per degree of the map.
    """
    spline = lattice.through.spline
    if spline.m > 3:  # extra coordinates play no part in the geometry
        spline = BSpline(
            spline.t, spline.c[..., :3], spline.k, periodic=spline.periodic, weights=spline.weights
        )
    lo, hi = lattice.through.domain
    step = (hi - lo) / np.array(lattice.repeat)
    field = lattice.smooth_tile
    zero = BSpline(([0.0, 1.0],) * 3, np.zeros((1, 1, 1)), 0)
    trig = (np.zeros(1), np.zeros((1, 3), np.int64), np.ones(3))
    if isinstance(field, TrigField):
        kind, trig, tile = TRIGONOMETRIC, (field.coef, field.factor, 2 * np.pi / field.period), zero
    elif isinstance(field, MixedField):
        kind, tile = LATTICE_SPLINE, field.spline
    else:
        kind, tile = TILE_SPLINE, field
    last = [spline.weights is not None, kind, lattice.creased, *lattice.ends]
    geom = np.concatenate([lo, step, lattice.through.closed, lattice.repeat, last]).astype(
        np.float64
    )
    unrolled = spline.k in UNROLLED and not generic
    args = spline.kernel_args if unrolled else spline.generic_kernel_args
    polynomial = (np.array(a) for a in trig)
    return Space._make((*args, geom, *polynomial, *tile.generic_kernel_args))
