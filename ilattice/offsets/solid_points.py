"""Random points of tiles at and in their solids, however thin these are.

Guarantees: the same points for the same seed; all stand for the same volume of parameters; they are
everywhere in the solid of a skeleton and within a part of its radius of it, for cells are halved,
and those left out that are proven to be farther away. Non-guarantee: of many such cells some are
taken at random.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ilattice._geometry import CORNERS, grid_indices
from ilattice._typing import FloatArray
from ilattice.tiles.skeleton import SkeletonField, skeleton_of

if TYPE_CHECKING:
    from ilattice.offsets.mid_surface import MidSurface

#: Points, about.
POINTS = 1 << 15
#: Cells per direction of a tile at first, and the most that are halved.
FIRST, CELLS = 8, 1 << 13
#: How small cells become: half their diagonal over the thinnest radius; and how often at most, for
#: radii of a millionth of the tile.
SMALL, HALVINGS = 0.5, 20
#: How far from the solid cells may be, in halves of their diagonals: points next to it, outside,
#: are as dense as those inside.
BESIDE = 0.25


class SolidPoints(NamedTuple):
    """Points at and in the solid of tiles; anywhere where these are no skeletons.

    Attributes
    ----------
    u : ndarray, shape (n, 3)
        Parameters.
    each : float
        Volume of parameters that each stands for.
    """

    u: FloatArray
    each: float

    @classmethod
    def of(cls, lattice: MidSurface, tile: Any, seed: int) -> SolidPoints:
        """Those of a lattice.

        Parameters
        ----------
        lattice : MidSurface
            Gives the tiles in the domain.
        tile : Tile or Mixture
            Its tile, or the same without closed faces.
        seed : int
            Of the random numbers.

        Returns
        -------
        SolidPoints
            The points.
        """
        rng, field = np.random.default_rng(seed), skeleton_of(tile)
        lo, hi = lattice.domain
        size = float(np.prod(hi - lo))
        if field is None:
            return cls(lo + (hi - lo) * rng.random((POINTS, 3)), size / POINTS)
        corners, side, part = _cells(tile, field, rng)
        n = -(-POINTS // len(corners)) * len(corners)
        p = np.resize(corners, (n, 3)) + side * rng.random((n, 3))
        count = np.array(lattice.repeat)
        return cls(lo + (hi - lo) * (rng.integers(0, count, (n, 3)) + p) / count, size * part / n)


def _cells(
    tile: Any, field: SkeletonField, rng: np.random.Generator
) -> tuple[FloatArray, float, float]:
    """Lower corners (n, 3) of cells of a tile at its solid, their side, and their part of it."""
    side = 1.0 / FIRST
    corners = _at_solid(tile, side * grid_indices((FIRST,) * 3), side)
    part = len(corners) * side**3
    diagonal = float(np.linalg.norm((2.0 * CORNERS - 1.0) @ field.cell.T, axis=1).max())
    for _ in range(HALVINGS):
        if 0.5 * side * diagonal <= SMALL * field.thinnest:
            break
        if len(corners) > CELLS:
            corners = corners[np.sort(rng.choice(len(corners), CELLS, replace=False))]
        side *= 0.5
        halves = (corners[:, None] + side * CORNERS).reshape(-1, 3)
        corners = _at_solid(tile, halves, side)
        part *= len(corners) / len(halves)
    return corners, side, part


def _at_solid(tile: Any, corners: Any, side: float) -> FloatArray:
    """Those of cells that may hold points in the solid or next to it; all if none do."""
    low, high = tile.range(corners, np.minimum(corners + side, 1.0)).T
    at = low <= 0.5 * BESIDE * (high - low)
    out: FloatArray = corners[at] if at.any() else corners
    return out
