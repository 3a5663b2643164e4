"""What a search for closest points finds, and what it costs.

Guarantee: rows belong to queries, in their order. Non-guarantee: the other foot of a query is the
nearest of those that were met on the way, not of all there are.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

from ilattice._shown import Shown
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import FrozenCopies, as_kind, as_rows
from ilattice.errors import InputError


@dataclass(frozen=True)
class ClosestPoints(FrozenCopies):
    """Feet of queries on the mid-surface.

    Attributes
    ----------
    foot : ndarray, shape (n, 3)
        Feet in space.
    u : ndarray, shape (n, 3)
        Feet in the parameter domain; beyond it for feet on the continuation.
    distance : ndarray, shape (n,)
        Signed distance, negative where the implicit function is negative.
    status : ndarray, shape (n,)
        0 converged, 1 converged on a face of the domain, or of a tile, where that is an edge of the
        mid-surface or a crease of it, 2 fell back to the nearest seed.
    iterations, starts : ndarray, shape (n,)
        Newton iterations and starts spent.
    second : ndarray, shape (n, 3)
        Another foot, the nearest of those that were met on the way; NaN where there is none.
    second_distance : ndarray, shape (n,)
        Its signed distance; infinite where there is none.
    second_u : ndarray, shape (n, 3)
        That foot in the parameter domain; NaN where there is none.
    start : ndarray, shape (n, 3)
        Where searches for feet of points nearby start from, in the parameter domain: the foot on
        what compiled code evaluates, which of struts is a spline.
    """

    foot: FloatArray
    u: FloatArray
    distance: FloatArray
    status: IntArray
    iterations: IntArray
    starts: IntArray
    second: FloatArray
    second_distance: FloatArray
    second_u: FloatArray
    start: FloatArray

    def rows(self, at: AnyArray) -> ClosestPoints:
        """Some of the queries.

        Parameters
        ----------
        at : ndarray
            Which ones: a mask, or numbers.

        Returns
        -------
        ClosestPoints
            Their feet.
        """
        chosen = as_rows("at", at, len(self.u))
        return ClosestPoints(*(getattr(self, f.name)[chosen] for f in fields(self)))

    def replaced(self, at: AnyArray, new: ClosestPoints) -> ClosestPoints:
        """The feet with some of them replaced.

        Parameters
        ----------
        at : ndarray
            Which ones: a mask, or numbers.
        new : ClosestPoints
            Feet, one for each of these.

        Returns
        -------
        ClosestPoints
            New feet where there are some, and those here elsewhere.
        """
        at = as_rows("at", at, len(self.u))
        if len(as_kind("new", new, "ClosestPoints").u) != len(self.u[at]):
            raise InputError(f"new must hold {len(self.u[at])} feet, as at does, got {len(new.u)}")
        parts = [getattr(self, f.name).copy() for f in fields(self)]
        for part, f in zip(parts, fields(self), strict=True):
            part[at] = getattr(new, f.name)
        return ClosestPoints(*parts)


@dataclass(frozen=True)
class Statistics(Shown):
    """Counts over all closest-point queries of a lattice.

    Attributes
    ----------
    queries : int
        Points asked for.
    iterations, starts : int
        Newton iterations and starts spent.
    retries : int
        Queries that needed more than the nearest candidates.
    fallbacks : int
        Queries that ended at their nearest seed.
    mended : int
        Queries whose feet were farther than those of their neighbours, and were replaced.
    """

    queries: int = 0
    iterations: int = 0
    starts: int = 0
    retries: int = 0
    fallbacks: int = 0
    mended: int = 0

    @property
    def mean_iterations(self) -> float:
        """Newton iterations per query."""
        return self.iterations / max(self.queries, 1)

    def __add__(self, other: Statistics) -> Statistics:
        """Sum of two counts."""
        return Statistics(
            self.queries + other.queries,
            self.iterations + other.iterations,
            self.starts + other.starts,
            self.retries + other.retries,
            self.fallbacks + other.fallbacks,
            self.mended + other.mended,
        )
