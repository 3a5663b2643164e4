"""The mid-surface of tiles: where their field vanishes, and how far points of space are from it.

Guarantee: seeds, the k-d tree and all that is fitted to distances are computed once and kept.
"""

from __future__ import annotations

from dataclasses import dataclass

from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import as_points, freeze
from ilattice.macroshape.tiling import Tiling
from ilattice.offsets.closest import ClosestPointSearch
from ilattice.offsets.feet import ClosestPoints, Statistics


@dataclass(frozen=True, eq=False)
class MidSurface(Tiling):
    """The zero set of tiles that are repeated through a map, with closest points on it.

    Attributes
    ----------
    tile, through, repeat, boundary, spans_per_tile : optional
        As in `ilattice.macroshape.Tiling`.
    """

    @property
    def search(self) -> ClosestPointSearch:
        """Seeds, k-d tree and solver of the closest-point queries."""
        self._check_count()
        return self._once("search", lambda: ClosestPointSearch(self))

    def closest(self, u: ArrayLike) -> ClosestPoints:
        """Closest points on the mid-surface.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters of the queries; the queries are their images.

        Returns
        -------
        ClosestPoints
            Feet, signed distances and a status per query; their arrays are read-only. Queries are
            compared with the feet of all others asked for together, so that many at once are the
            more reliable.

        Raises
        ------
        ConvergenceError
            If more than one query in a hundred does not converge.
        """
        return freeze(self.search.query(as_points("u", u), thorough=True))

    def distance(self, u: ArrayLike) -> FloatArray:
        """Signed Euclidean distance to the mid-surface at images of parameters.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n,)
            Distances, negative where the implicit function is negative (Hong et al., eq. 5).
        """
        return self.search.query(as_points("u", u), thorough=True).distance

    @property
    def statistics(self) -> Statistics:
        """Counts over all closest-point queries so far."""
        return self.search.statistics
