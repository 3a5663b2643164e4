"""How far apart the seeds of closest points are, from place to place.

Guarantee: the spacing told for a query is at least that of the seeds that are nearest to it in
space, and in its eighth of a tile and those next to it, unless that is next to a face on which the
map is singular; and at most that in its tile and the tiles next to it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import maximum_filter

from ilattice._typing import FloatArray, IntArray

if TYPE_CHECKING:
    from ilattice.offsets.space import TileSpace

#: Spacings of seeds on the continuation count up to so many times those in the domain.
STRETCHED = 1.5
#: Parts of a tile along each direction; those next to the one of a query count.
PARTS = 8
#: Of the nearest seeds so many are looked at; others may be so many times farther apart.
LOOKED_AT, WIDER = 64, 1.5


class Spacing:
    """Largest spacing of seeds around places.

    Parameters
    ----------
    space : TileSpace
        The tiles.
    p : ndarray, shape (s, 3)
        Seeds, in tile coordinates.
    size : ndarray, shape (s,)
        Spacings that they would have if none were added along edges and on faces: where these are
        the nearest ones, others are farther apart.
    singular : list of (int, float)
        Faces of the domain to which spacings fall: the direction across, and its coordinate.
    """

    def __init__(
        self, space: TileSpace, p: FloatArray, size: FloatArray, singular: list[tuple[int, float]]
    ) -> None:
        self.count = np.array(space.lattice.repeat)
        self.closed = np.array(space.lattice.through.closed)
        self.size, self.singular = size, singular
        inner = space.within(p)
        if inner.any():  # the continuation may stretch without end
            size = np.minimum(size, STRETCHED * size[inner].max())
        self.tiles = self._largest(p, size, 1)
        self.parts = self._largest(p, size, PARTS)

    def around(self, p: FloatArray, near: IntArray) -> FloatArray:
        """Largest spacing around queries: no more than in their tiles and the tiles next to them.

        Parameters
        ----------
        p : ndarray, shape (n, 3)
            Tile coordinates of the queries.
        near : ndarray of int, shape (n, k)
            Numbers of the seeds that are nearest in space.

        Returns
        -------
        ndarray, shape (n,)
            Lengths in space.
        """
        some = near[:, :: max(1, near.shape[1] // LOOKED_AT)]
        size = self.size[some].max(axis=1)
        beside = self.parts[self._at(p, PARTS)]
        for axis, end in self.singular:
            beside = beside * np.minimum(1.0, PARTS * np.abs(p[:, axis] - end))
        local = WIDER * np.maximum(size, beside)
        out: FloatArray = np.minimum(self.tiles[self._at(p, 1)], local)
        return out

    def _at(self, p: FloatArray, parts: int) -> tuple[IntArray, ...]:
        """Indices of parts of tiles, into an array over all tiles and a ghost layer of them."""
        n = parts * self.count
        at = np.floor(parts * p)
        at = np.where(self.closed, np.mod(at, n), np.clip(at, -parts, n + parts - 1)) + parts
        i, j, k = at.astype(np.int64).T
        return i, j, k

    def _largest(self, p: FloatArray, size: FloatArray, parts: int) -> FloatArray:
        """Largest spacing of the seeds in parts of tiles and those next to them."""
        out: FloatArray = np.zeros(parts * (self.count + 2))
        np.maximum.at(out, self._at(p, parts), size)
        for axis in (int(a) for a in np.flatnonzero(self.closed)):
            n = parts * int(self.count[axis])
            out = np.take(out, parts + np.mod(np.arange(-parts, n + parts), n), axis)
        return np.asarray(maximum_filter(out, 3, mode="nearest"))
