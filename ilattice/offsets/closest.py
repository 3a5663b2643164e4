"""Closest points on the mid-surface of a lattice, in Euclidean space.

Definition: with ``boundary="clip"`` the distance is that to the mid-surface in the domain D, its
edges on the faces of D included. With ``boundary="extend"`` it is the lesser of that one and the
distance to the nearest foot on the continuation: a local minimum over the surface continued by
one layer of tiles beyond open ends, as far as that is upright (`ilattice.offsets.space`), and
within two tiles of the query along each direction, so that the continuation of one end has no say
elsewhere. So a wall is never thinner than what the mid-surface in D asks for: where the
continuation folds, is squeezed, ends or comes back, the sheet ends at the face of D, not there.
Tiles that share faces without a zone of transition meet in creases: there the surface is the union
of the pieces in each tile, which end in edges on its faces.

Guarantees: every query returns a foot point and a status; a query whose Newton iterations
all fail falls back to its nearest seed and is counted; more than `MAX_FALLBACK` of them
raise `ConvergenceError`. The sign of the distance is that of the implicit function at the
query, and is checked against the side of the foot from which the query is seen.
Non-guarantees: on the medial axis the foot is one of several; the distance is still unique. The
distance may jump where a foot reaches the edge of the continuation, to that of another foot,
which is at most as far away as the mid-surface in D. The foot is the nearest one as far as seeds
cover the surface: `tests/compare_closest_points.py` compares large sets with a dense search, to
1e-8 of the size of a tile plus 1e-7 of the distance.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ilattice._shown import one_line
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import (
    as_flag,
    as_items,
    as_kind,
    as_points,
    as_whole,
)
from ilattice.errors import ConvergenceError, InputError
from ilattice.macroshape.tiling import Tiling
from ilattice.offsets import _kernels_newton
from ilattice.offsets._kernels_patches import DISTANCE, IMAGE, MULTIPLIER
from ilattice.offsets.feet import ClosestPoints, Statistics
from ilattice.offsets.mending import mended, started
from ilattice.offsets.retrying import retried, singly, unresolved
from ilattice.offsets.seeded import AMONG_ADDED, MAX_ROWS, SeededSpace
from ilattice.offsets.struts import onto_struts, struts_of

#: Single starts where the nearest seed tells that a foot is missed, or none has led to any, and
#: the most queries for which these are made at once.
ALONE, MAX_ALONE = 200, 2000
#: A foot that is farther than a seed by this part of the distance, or of the least spacing, is as
#: near: queries of grids often have seeds for feet.
EVEN = 1e-9
#: Queries that are answered at once: these limit the memory, not the time.
BATCH = 1 << 17
#: Largest part of queries that may fall back, and a number that always may.
MAX_FALLBACK, FEW = 1e-2, 10


class ClosestPointSearch(SeededSpace):
    """Seeds, k-d tree and Newton solver for one lattice.

    Parameters
    ----------
    lattice : Lattice
        The tiles, their map and the boundary rule.

    Raises
    ------
    GeometryError
        If the tile has no zero set inside the domain.

    Notes
    -----
    Hong et al. 2025, section 3.3, with the complete Hessian and several starts per query:
    all seeds within the nearest distance plus two seed spacings, unless their tangent plane
    rules them out.
    """

    def __init__(self, lattice: Tiling) -> None:
        super().__init__(lattice)
        self.struts = struts_of(lattice)
        self.statistics = Statistics()

    def __repr__(self) -> str:
        return one_line(f"ClosestPointSearch({len(self.seeds.points)} seeds, {self.lattice!r})")

    @property
    def plain(self) -> bool:
        """Whether the mid-surface is where one smooth field vanishes that compiled code evaluates.

        It is not where tiles meet in creases, and that of struts is a spline there.
        """
        return self.struts is None and not self.creased

    # ------------------------------------------------------------------ queries

    def query(
        self,
        u: FloatArray,
        *,
        strict: bool = True,
        strides: tuple[int, ...] = (1,),
        known: ClosestPoints | None = None,
        thorough: bool = False,
    ) -> ClosestPoints:
        """Closest points of the images of parameters.

        Parameters
        ----------
        u : ndarray, shape (n, 3)
            Parameters.
        strict : bool
            Whether too many queries that do not converge are an error; else the status tells.
        strides : tuple of int
            Queries so many rows apart are neighbours: their feet are compared.
        known : ClosestPoints, optional
            Feet of points near the queries, one each, from which searches start.
        thorough : bool
            Compare every query with all feet of its batch.

        Returns
        -------
        ClosestPoints
            Feet, distances and what they cost.
        """
        u = as_points("u", u)
        strict, thorough = as_flag("strict", strict), as_flag("thorough", thorough)
        strides = tuple(as_whole("strides", s, 1, MAX_ROWS) for s in as_items("strides", strides))
        if known is not None and len(as_kind("known", known, "ClosestPoints").u) != len(u):
            raise InputError(f"known must hold {len(u)} feet, one per query, got {len(known.u)}")
        n = len(u)
        p, x = self.to_tile(u), self.lattice.through.x(u)
        feet, counts, status = _results(n)
        retried = repaired = 0
        points = None if known is None else self._points(known)
        for i in range(0, n, BATCH):
            s = slice(i, min(i + BATCH, n))
            part = x[s], p[s], feet[:, s], counts[s], status[s]
            if known is not None:
                self._started(*part, self.to_tile(known.start[s]))
            retried += self._search(*part)
            near = None if points is None else points[s]
            repaired += mended(self, *part[:3], part[4], strides, near, thorough)
        self._account(counts, status, retried, repaired, strict)
        return self._found(p, x, feet, counts, status)

    def follow(self, u: FloatArray, known: ClosestPoints) -> ClosestPoints:
        """Feet next to known ones, on the way to closest points of parameters nearby.

        Parameters
        ----------
        u : ndarray, shape (n, 3)
            Parameters.
        known : ClosestPoints
            Feet of points near them, one each.

        Returns
        -------
        ClosestPoints
            The nearer one of the feet that starts from the known foot and from the known second
            one lead to, which need not be the closest point, and the other one.
        """
        as_kind("known", known, "ClosestPoints")
        p, x = self.to_tile(u), self.lattice.through.x(u)
        if len(known.u) != len(p):
            raise InputError(f"known must have a foot for each of {len(p)} u, got {len(known.u)}")
        feet, counts, status = _results(len(u))
        starts = [known.start]
        if np.isfinite(known.second_distance).any():
            starts.append(np.where(np.isfinite(known.second_u), known.second_u, known.start))
        self._started(x, p, feet, counts, status, *map(self.to_tile, starts))
        self.statistics = self.statistics + Statistics(
            0, int(counts[:, 1].sum()), int(counts[:, 0].sum())
        )
        return self._found(p, x, feet, counts, status)

    def _started(
        self, x: FloatArray, p: FloatArray, feet: FloatArray, counts: IntArray, status: IntArray,
        *starts: FloatArray,
    ) -> None:  # fmt: skip
        """Fill in what starts (n, 3), in tile coordinates, lead to, with nothing else looked at."""
        idx = np.arange(len(starts) * len(x)).reshape(len(starts), -1).T.copy()
        self._run(x, p, idx, feet, counts, status, started(self, np.concatenate(starts)))

    def _points(self, known: ClosestPoints) -> FloatArray:
        """Points (n, 6) of what is searched that feet belong to: tile coordinates, and images."""
        if self.struts is None:
            return np.hstack([self.to_tile(known.u), known.foot])
        images = self.lattice.through.x(known.start, extrapolate="extend")
        return np.hstack([self.to_tile(known.start), images])

    def _found(
        self, p: FloatArray, x: FloatArray, feet: FloatArray, counts: IntArray, status: IntArray
    ) -> ClosestPoints:
        first, second = feet
        u = self.from_tile(first[:, :IMAGE])
        out = ClosestPoints(
            first[:, IMAGE:DISTANCE].copy(), u, first[:, DISTANCE].copy(), status,
            counts[:, 1].copy(), counts[:, 0].copy(), second[:, IMAGE:DISTANCE].copy(),
            second[:, DISTANCE].copy(), self.from_tile(second[:, :IMAGE]), u,
        )  # fmt: skip
        return out if self.struts is None else onto_struts(self, self.struts, p, x, out)

    def _search(
        self, x: FloatArray, p: FloatArray, feet: FloatArray, counts: IntArray, status: IntArray
    ) -> int:
        """Fill in the results of queries; how many needed more candidates than the first ones."""
        distance, idx = self.candidates(x, self.looked_at)
        self._run(x, p, idx, feet, counts, status)
        behind = (feet[0, :, DISTANCE] * feet[0, :, MULTIPLIER] < 0) & (
            status == _kernels_newton.OK
        )
        missed = self._missed(distance[:, 0], idx[:, 0], feet[0, :, DISTANCE])
        again = np.flatnonzero(behind | missed | unresolved(self, p, distance, idx, feet, status))
        retried(self, again, x, p, feet, counts, status)
        missed = self._missed(distance[:, 0], idx[:, 0], feet[0, :, DISTANCE])
        at = np.flatnonzero(missed | (status >= _kernels_newton.FALLBACK))[:MAX_ALONE]
        if len(at):  # what led there, or to seeds without a normal, may have kept other starts away
            alone = singly(self, x[at], p[at], ALONE)
            nearer = np.abs(alone[:, DISTANCE]) < np.abs(feet[0, at, DISTANCE])
            feet[0, at[nearer]], status[at[nearer]] = alone[nearer], _kernels_newton.OK
        self._within_domain(x, p, feet, counts, status)
        at = np.flatnonzero(self._missed(distance[:, 0], idx[:, 0], feet[0, :, DISTANCE]))
        if len(at):
            self._descend(x[at], at, self.seeds.points[idx[at, 0]], feet[0])
        return len(again)

    @cached_property
    def _own_seeds(self) -> tuple[IntArray, cKDTree]:
        """Numbers of the seeds in the domain, and their tree."""
        own = np.flatnonzero(self.within(self.seeds.points))
        return own, cKDTree(self.seeds.images[own])

    def _within_domain(
        self, x: FloatArray, p: FloatArray, feet: FloatArray, counts: IntArray, status: IntArray
    ) -> None:
        """Fill in feet in the domain where a continuation that comes back has hidden them."""
        at = np.flatnonzero(status >= _kernels_newton.FALLBACK)
        if len(at) == 0 or len(self._own_seeds[0]) == 0:
            return
        own, tree = self._own_seeds
        k = min(AMONG_ADDED, len(own))
        found: Any = tree.query(x[at], k=k)
        new, spent, state = _results(len(at))
        self._run(x[at], p[at], own[found[1].reshape(len(at), k)], new, spent, state)
        feet[:, at], status[at] = new, state
        counts[at] += spent

    def _missed(self, distance: FloatArray, seed: IntArray, found: FloatArray) -> AnyArray:
        """Where the foot is farther than the nearest seed, and that is in the domain."""
        known = (1.0 + EVEN) * distance + EVEN * self.least_spacing
        out: AnyArray = (np.abs(found) > known) & self.within(self.seeds.points[seed])
        return out

    def _account(
        self, counts: IntArray, status: IntArray, retried: int, repaired: int, strict: bool
    ) -> None:
        failed = np.flatnonzero(status >= _kernels_newton.FALLBACK)
        self.statistics = self.statistics + Statistics(
            len(status), int(counts[:, 1].sum()), int(counts[:, 0].sum()), retried, len(failed),
            repaired,
        )  # fmt: skip
        if strict and len(failed) > max(MAX_FALLBACK * len(status), FEW):
            raise ConvergenceError(
                f"closest points: {len(failed)} of {len(status)} queries did not converge "
                f"(more than {MAX_FALLBACK:.0%}), the first are {failed[:5].tolist()}; the "
                "tile may be singular at level zero, as at the rims of closed faces; its "
                "opposite faces may differ, so that tiles do not fit together (periodic ones "
                "do, and boundary='clip' needs none beyond the domain); or the map may fold"
            )


def _results(n: int) -> tuple[FloatArray, IntArray, IntArray]:
    """Room for first and second feet (2, n, 8), counts (n, 2) and status (n,)."""
    status = np.full(n, _kernels_newton.FALLBACK, np.int64)
    return np.full((2, n, 8), np.nan), np.zeros((n, 2), np.int64), status
