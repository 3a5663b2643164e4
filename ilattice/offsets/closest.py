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

from dataclasses import dataclass, fields
from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numba
import numpy as np
from scipy.spatial import cKDTree

from ilattice._geometry import grid_points
from ilattice._shown import Shown, one_line
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import (
    FrozenCopies,
    as_flag,
    as_items,
    as_kind,
    as_points,
    as_rows,
    as_whole,
)
from ilattice.errors import ConvergenceError, GeometryError, InputError
from ilattice.offsets import _kernels, _kernels_newton, _kernels_seeds
from ilattice.offsets._kernels_jets import UPRIGHT
from ilattice.offsets._kernels_patches import BELOW, BENT, DISTANCE, IMAGE, MULTIPLIER, PLAIN
from ilattice.offsets.covering import FINER, Covering
from ilattice.offsets.mending import mended, started
from ilattice.offsets.retrying import Boxes, doubtful, in_order, retried, singly
from ilattice.offsets.seeding import Seeds, apart, between, downhill, layered, sharpest
from ilattice.offsets.space import TileSpace
from ilattice.offsets.spacing import Spacing
from ilattice.offsets.struts import onto_struts, struts_of
from ilattice.tiles.mixture import MixedField

if TYPE_CHECKING:
    from ilattice.macroshape.tiling import Tiling

#: Nearest seeds that are looked at first; and where seeds that were missed have been added, which
#: crowd on one sheet so that the nearest ones may hide another.
CANDIDATES, AMONG_ADDED = 8, 32
#: Single starts where the nearest seed tells that a foot is missed, or none has led to any, and
#: the most queries for which these are made at once.
ALONE, MAX_ALONE = 200, 2000
BATCH = 1 << 17
MAX_ROWS = 1 << 40
#: Last step of a foot that is far away, in spacings of seeds; see `_kernels_newton.converged`.
TOLERANCE = 1e-7
#: Largest part of queries that may fall back, and a number that always may.
MAX_FALLBACK, FEW = 1e-2, 10
#: Seeds per tile and direction: at least this many, and this many per period of the finest wave.
MIN_SEEDS, SEEDS_PER_WAVE = 8, 6
#: Tiles that are longer along one direction get up to this many times the seeds along it.
MAX_REFINED = 4
#: Half the factor by which a continuation may stretch tiles until they get more seeds.
STRETCHED = 0.75
#: Where tiles meet in creases, surfaces bend sharply next to faces: so many times the seeds per
#: direction; those up to so many cells away from a face do not tell the normals next to them.
MORE, CREASED = 2, 1.5


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


class ClosestPointSearch(TileSpace):
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
        self.looked_at = CANDIDATES
        self.struts = struts_of(lattice)
        self.singular: list[tuple[int, float]] = []
        count, closed = np.array(lattice.repeat), np.array(lattice.through.closed)
        self.seeds, usual = self._make_seeds(count, closed)
        self.tree = cKDTree(self.seeds.images)
        self.boxes = Boxes.of(*self.seeds[1:])
        self.spacing = Spacing(self, self.seeds.points, usual, self.singular)
        self.least_spacing = float(self.seeds.spacing.min())
        self.cell = 1.0 / self._least_seeds
        self.statistics = Statistics()

    def __repr__(self) -> str:
        return one_line(f"ClosestPointSearch({len(self.seeds.points)} seeds, {self.lattice!r})")

    # ------------------------------------------------------------------ seeds

    def _make_seeds(self, count: IntArray, closed: AnyArray) -> tuple[Seeds, FloatArray]:
        """Seeds, and the spacings (s,) that they would have if none were added between others."""
        ranges = [
            np.arange(0 if c or e else -1, n if c or e else n + 1)
            for n, c, e in zip(count, closed, self.ends, strict=True)
        ]
        tiles = grid_points(*ranges)
        p, cell = layered(self, *self._tile_seeds(tiles))
        if self.ends.any():
            inside = ((p >= self.box[0]) & (p <= self.box[1]))[:, self.ends].all(axis=1)
            p, cell = p[inside], cell[inside]
        if self.ends.any() or self.creased:
            faces, face_cell = self._face_seeds(count, closed)
            p, cell = np.concatenate([p, faces]), np.concatenate([cell, face_cell])
        if len(p) == 0:
            raise GeometryError(
                f"tile {self.lattice.tile.name!r} has no zero set: its field does not change "
                "sign on the unit cube; shift its level"
            )
        x, normal, spacing, det = (
            np.empty((len(p), 3)), np.empty((len(p), self._columns)), np.empty(len(p)),
            np.empty(len(p)),
        )  # fmt: skip
        _kernels_seeds.place_seeds(len(p), self.space, p, cell, x, normal, spacing, det)
        if self.creased:
            near = (np.abs(p - np.rint(p)) <= CREASED * cell).any(axis=1)
            normal[near, BENT] = np.inf
        keep = np.flatnonzero(self._upright(p, 0.5 * UPRIGHT))  # what just counts has seeds around
        keep = keep[in_order(p[keep], x[keep], normal[keep])]
        if normal.shape[1] == PLAIN:
            normal[keep, BENT] = sharpest(x[keep], normal[keep, BENT], spacing[keep])
        usual = spacing[keep] / (self._least_seeds * cell[keep].max(axis=1))
        return Seeds(*(np.ascontiguousarray(a[keep]) for a in (p, x, normal, spacing))), usual

    @property
    def _least_seeds(self) -> int:
        least = max(MIN_SEEDS, SEEDS_PER_WAVE * self.lattice.finest_wave)
        return MORE * least if self.creased else least

    def _tile_seeds(self, tiles: IntArray) -> tuple[FloatArray, FloatArray]:
        """Seeds of tiles and their cells, more along the directions in which a tile is long.

        A continuation that stretches tiles has as many seeds per length as the domain has: others
        would be so far apart that a sheet which bends back is behind nearer seeds of another one.
        """
        stretch = np.linalg.norm(self._jacobian(tiles.astype(np.float64) + 0.5), axis=1)
        least = np.maximum(stretch.min(axis=1, keepdims=True), 1e-3 * stretch.max())
        count = np.array(self.lattice.repeat)
        beyond = np.asarray(((tiles < 0) | (tiles >= count)).any(axis=1))
        usual = STRETCHED * np.median(stretch[~beyond], axis=0)
        least = np.where(beyond[:, None], np.minimum(least, usual), least)
        factor = np.clip(np.ceil(stretch / (2.0 * least)), 1, MAX_REFINED).astype(np.int64)
        out = [np.empty((0, 3))]
        cells = [np.empty((0, 3))]
        for f in np.unique(factor, axis=0):
            m = self._least_seeds * f
            shift = tiles[(factor == f).all(axis=1)][:, None, :]
            centres = _cell_centres(m)
            if isinstance(self.lattice.smooth_tile, MixedField):
                out.append(self._project((centres + shift).reshape(-1, 3), m))
                cells.append(np.broadcast_to(1.0 / m, out[-1].shape))
                continue
            covering = Covering.of(self, self._project(centres, m), m)
            if covering.crowded:
                self.looked_at = AMONG_ADDED
            for part, p in ((1, covering.plain), *covering.sharp.items()):
                out.append((p + shift).reshape(-1, 3))
                cells.append(np.broadcast_to(1.0 / (part * m), out[-1].shape))
        return np.concatenate(out), np.concatenate(cells)

    def _face_seeds(self, count: IntArray, closed: AnyArray) -> tuple[FloatArray, FloatArray]:
        """Seeds on curves and points in which the surface meets faces and edges, or has creases."""
        out = [np.empty((0, 3))]
        m = 2 * self._least_seeds
        ends = [a for a in range(3) if self.creased or self.ends[a]]
        for held in (h for n in (1, 2) for h in combinations(ends, n)):
            axes = [(np.arange(n * m) + 0.5) / m for n in count]
            for a in held:
                planes = np.arange(count[a] + (0.0 if closed[a] else 1.0))
                axes[a] = planes if self.creased else planes[[0, -1]]
                if self.lattice.torn[a]:  # the upper faces of tiles are others than the lower ones
                    upper = planes[1:-1] if not closed[a] else planes + 1.0
                    axes[a] = np.concatenate([planes, upper - BELOW])
            p = grid_points(*axes)
            out.append(self._onto_faces(p, held, m))
            more = self._onto_faces(self._face_crossings(axes, held, m), held, m)
            out.append(more[apart(more, out[-1], m)])
        seeds = np.concatenate(out)
        return seeds, np.full(seeds.shape, 1.0 / m)

    def _onto_faces(self, p: FloatArray, held: tuple[int, ...], m: int) -> FloatArray:
        """Points moved onto the surface with coordinates held, less those that leave the domain."""
        fixed = np.zeros((len(p), 3))
        fixed[:, held] = 1.0
        p = self._project(p, np.full(3, m), fixed)
        inside = np.clip(p, *self.box)
        return inside[(np.abs(inside - p) < 1e-12).all(axis=1)]

    def _face_crossings(
        self, centres: list[FloatArray], held: tuple[int, ...], m: int
    ) -> FloatArray:
        """Points next to the surface on faces and edges, between centres of cells and beyond."""
        count = self.lattice.repeat
        axes = [
            centres[a] if a in held else np.linspace(0.0, count[a], FINER * count[a] * m // 2 + 1)
            for a in range(3)
        ]
        p = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        f = self.lattice.implicit(self.from_tile(p.reshape(-1, 3))).reshape(p.shape[:3])
        out = [between(p, f, a) for a in range(3) if a not in held]
        return np.concatenate(out)

    # ------------------------------------------------------------------ queries

    def candidates(self, x: FloatArray, k: int) -> tuple[FloatArray, IntArray]:
        """Nearest seeds of points, nearest first.

        Parameters
        ----------
        x : ndarray, shape (n, 3)
            Points of space.
        k : int
            How many; all if there are fewer.

        Returns
        -------
        tuple of ndarray, shape (n, k)
            Distances and numbers of the seeds.
        """
        x = as_points("x", x)
        k = min(as_whole("k", k, 1, MAX_ROWS), len(self.seeds.points))
        found: Any = self.tree.query(x, k=np.arange(1, k + 1), workers=numba.get_num_threads())
        distance, idx = found
        return distance, np.ascontiguousarray(idx, dtype=np.int64)

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
        return out if self.struts is None else onto_struts(self, p, x, out)

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
        again = np.flatnonzero(behind | missed | doubtful(self, p, distance, idx, feet, status))
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

    def _descend(self, x: FloatArray, at: IntArray, start: FloatArray, feet: FloatArray) -> None:
        """Fill in feet that are found downhill from the nearest seeds, where Newton left them."""
        p = downhill(self, x, start)
        y = self.lattice.through.x(self.from_tile(p), extrapolate="extend")
        sign = np.where(feet[at, DISTANCE] < 0.0, -1.0, 1.0)
        feet[at] = np.column_stack([p, y, sign * np.linalg.norm(x - y, axis=1), sign])

    def _missed(self, distance: FloatArray, seed: IntArray, found: FloatArray) -> AnyArray:
        """Where the foot is farther than the nearest seed, and that is in the domain."""
        out: AnyArray = (np.abs(found) > distance) & self.within(self.seeds.points[seed])
        return out

    def _run(
        self, x: FloatArray, p: FloatArray, idx: IntArray, feet: FloatArray, counts: IntArray,
        status: IntArray, seeds: Seeds | None = None,
    ) -> None:  # fmt: skip
        closest: Any = _kernels.closest
        closest(
            len(x), self.space, seeds or self.seeds, x, p, idx, self.box, self.orient, TOLERANCE,
            feet[0], feet[1], counts, status,
        )  # fmt: skip

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


def _cell_centres(m: IntArray) -> FloatArray:
    axes = [(np.arange(n) + 0.5) / n for n in m]
    return grid_points(*axes)
