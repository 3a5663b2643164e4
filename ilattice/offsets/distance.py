"""The true signed distance to the zero set of any field, by closest points.

Trigonometric polynomials, and so the catalogue of surfaces, use the search of lattices on one
period; all other fields are searched on a box, from seeds on their zero set.

Guarantees: the sign is that of the field; a distance is that of a point of the zero set, never
less than the true one beyond rounding; values do not depend on what else is asked for.
Not guaranteed: that the nearest point is found where the zero set has details finer than the
seeds, whose spacing is `seeds` to a side; parts of it outside the box are not seen; on edges of
intersections feet are found by descent, which is slower, and at corners right to a tenth of the
spacing of the seeds only.
"""

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from scipy.spatial import cKDTree

from ilattice._field import hessians
from ilattice._geometry import CORNERS, grid_indices, least_step
from ilattice._typing import AnyArray, FloatArray
from ilattice._validate import as_array
from ilattice.errors import GeometryError, InputError
from ilattice.fields.node import Node, Whole, as_node, is_empty, nowhere
from ilattice.macroshape.primitives import box as box_map
from ilattice.offsets._small import least_steps
from ilattice.offsets.mid_surface import MidSurface
from ilattice.tiles.tile import Tile

__all__ = ["bind", "distance"]

SEEDS = 96  # per side of a box
STARTS = 3  # seeds from which feet are looked for
NEAR = 24  # seeds among which starts are chosen
#: Steps of Newton's method onto a surface, steps along it, and points that are taken at once.
STEPS, SLIDES, BATCH = 12, 12, 1 << 15
#: How far a seed may be from the middle of its cell, in widths of cells: more than half a diagonal.
ASTRAY = 1.2
#: Steps to the zero set below this part of the box count as none; and where feet are right, how far
#: they are from it, and how far off the normal through the query.
ZERO, ON_SURFACE, ACROSS = 1e-9, 1e-10, 1e-8
MARGIN = 0.25  # of a box about which distances are asked for, where the zero set goes on


class _Search(Protocol):
    def feet(self, points: FloatArray) -> FloatArray:
        """Nearest points of the zero set, shape (n, 3)."""


class _Periodic:
    """Feet on a trigonometric polynomial: those of a lattice of one tile that goes on."""

    def __init__(self, polynomial: Any) -> None:
        self.period = np.array(polynomial.period)
        tile = Tile(polynomial.stretched(1.0 / self.period), name="polynomial")
        self.lattice = MidSurface(tile, through=box_map(self.period))

    def feet(self, points: FloatArray) -> FloatArray:
        turns = np.floor(points / self.period)
        u = np.clip(points / self.period - turns, 0.0, 1.0)
        lo, hi = self.lattice.domain
        found: FloatArray = self.lattice.closest(lo + u * (hi - lo)).foot
        return found + turns * self.period


class _Boxed:
    """Feet on any field, by Newton's method from seeds in a box."""

    def __init__(self, part: Node, box: FloatArray, seeds: int) -> None:
        self.part = part
        self.size = float((box[1] - box[0]).max())
        self.h = self.size / seeds
        self.seeds = self._seeds(box)
        self.tree = cKDTree(self.seeds)

    def _seeds(self, box: FloatArray) -> FloatArray:
        """Points of the zero set, one per cell that it may cross."""
        counts = np.maximum(1, np.ceil((box[1] - box[0]) / self.size))
        corners = grid_indices(counts.astype(int))
        lo, width = box[0] + corners * self.size, self.size
        while width > self.h:
            width *= 0.5
            lo = (lo[:, None] + width * CORNERS).reshape(-1, 3)
            lo = lo[(lo <= box[1]).all(axis=1)]
            bounds = self.part.program.ranges(lo, lo + width)
            lo = lo[(bounds[:, 0] <= 0.0) & (bounds[:, 1] >= 0.0)]
        centres = lo + 0.5 * width
        p = self._onto(centres)
        near = np.linalg.norm(p - centres, axis=1) <= ASTRAY * width
        p = p[near & self._on(p)]
        if not len(p):
            raise GeometryError(
                f"there is no surface to be distant from in the box {box.tolist()}: the field does "
                "not change sign there"
            )
        return p

    def _slack(self, p: FloatArray) -> FloatArray:
        """Values that count as zero."""
        g = self.part.program.jets(p, 1)[:, 1:4]
        return np.asarray(ZERO * self.size * np.linalg.norm(g, axis=1))

    def _onto(self, p: FloatArray, steps: int = 8) -> FloatArray:
        """Points moved along the gradient onto the zero set."""
        p = p.copy()
        for _ in range(steps):
            jets = self.part.program.jets(p, 1)
            step = least_step(jets[:, 0], jets[:, 1:4])
            length = np.linalg.norm(step, axis=1, keepdims=True)
            p -= np.where(np.isfinite(step), step, 0.0) * np.minimum(
                1.0, self.h / (length + 1e-300)
            )
        return p

    def feet(self, points: FloatArray) -> FloatArray:
        parts = [self._feet(points[i : i + BATCH]) for i in range(0, len(points), BATCH)]
        return np.concatenate(parts) if parts else np.empty((0, 3))

    def _feet(self, x: FloatArray) -> FloatArray:
        starts = self._starts(x)
        best, least = starts[:, 0].copy(), np.linalg.norm(starts[:, 0] - x, axis=1)
        settled = np.zeros(len(x), bool)
        for k in range(STARTS):
            y, good = self._newton(x, starts[:, k])
            gap = np.linalg.norm(y - x, axis=1)
            better = good & (gap <= least + 1e-12 * self.size)
            best[better], least[better] = y[better], np.minimum(gap, least)[better]
            settled |= better
        rest = np.flatnonzero(~settled)
        if len(rest):
            best[rest] = self._slide(x[rest], best[rest])
        return best

    def _starts(self, x: FloatArray) -> FloatArray:
        """The nearest seed, and near ones apart from it, (n, STARTS, 3)."""
        count = min(NEAR, len(self.seeds))
        found: Any = self.tree.query(x, k=np.arange(1, count + 1))
        gap, at = found
        out = np.repeat(self.seeds[at[:, :1]], STARTS, axis=1)
        rows = np.arange(len(x))
        away = np.full((len(x), count), np.inf)
        for k in range(1, STARTS):
            away = np.minimum(away, np.linalg.norm(self.seeds[at] - out[:, k - 1 : k], axis=2))
            worth = np.where(gap <= gap[:, :1] + 2.0 * self.h, away, -1.0)
            out[:, k] = self.seeds[at[rows, np.argmax(worth, axis=1)]]
        return out

    def _newton(self, x: FloatArray, start: FloatArray) -> tuple[FloatArray, AnyArray]:
        """Points of the zero set at which the way to x is normal, and where that was found."""
        y, good = start.copy(), np.zeros(len(x), bool)
        lam = np.full(len(x), np.nan)
        left = np.arange(len(x))
        for _ in range(STEPS):
            if not len(left):
                break
            step, moved, done = self._step(x[left], y[left], lam[left])
            good[left[done]] = True
            y[left] += np.where(done[:, None], 0.0, step)
            lam[left] = moved
            left = left[~done & np.isfinite(step).all(axis=1)]
        return y, good

    def _step(
        self, x: FloatArray, y: FloatArray, lam: FloatArray
    ) -> tuple[FloatArray, FloatArray, AnyArray]:
        """A Newton step of feet, their multipliers after it, and which feet are right already."""
        jets = self.part.program.jets(y, 2)
        f, g = jets[:, 0], jets[:, 1:4]
        H = jets[:, [4, 5, 6, 5, 7, 8, 6, 8, 9]].reshape(-1, 3, 3)
        square = np.maximum(np.einsum("ni,ni->n", g, g), 1e-300)
        lam = np.where(np.isnan(lam), np.einsum("ni,ni->n", x - y, g) / square, lam)
        steep = np.sqrt(square)
        across = np.linalg.norm(np.cross(x - y, g), axis=1) / steep
        done = (np.abs(f) <= ON_SURFACE * self.size * steep) & (across <= ACROSS * self.size)
        system = np.zeros((len(x), 4, 4))
        system[:, :3, :3] = np.eye(3) + lam[:, None, None] * H
        system[:, :3, 3] = system[:, 3, :3] = g
        right = np.column_stack((x - y - lam[:, None] * g, -f))
        step = _solved(system, right)
        length = np.linalg.norm(step[:, :3], axis=1)
        cut = np.minimum(1.0, self.h / np.maximum(length, 1e-300))
        return cut[:, None] * step[:, :3], lam + cut * step[:, 3], done

    def _slide(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Descent along the zero set, and to where up to three of its tangent planes meet."""
        least = np.linalg.norm(y - x, axis=1)
        pace = np.ones(len(x))
        normals, offsets = np.zeros((len(x), 3, 3)), np.zeros((len(x), 3))
        for _ in range(SLIDES):
            before, trial = least, y
            for k in range(3):
                normals[:, k] = self._normal(trial)
                offsets[:, k] = np.einsum("ni,ni->n", normals[:, k], trial)
                if k == 0:
                    height = np.einsum("ni,ni->n", x - y, normals[:, 0])
                    way = x - y - height[:, None] * normals[:, 0]
                    trial = self._onto(y + pace[:, None] * way, steps=4)
                else:
                    trial = self._onto(_meeting(x, normals, offsets, k + 1))
                gap = np.linalg.norm(trial - x, axis=1)
                better = (gap < least) & self._on(trial)
                y, least = np.where(better[:, None], trial, y), np.where(better, gap, least)
            pace = np.where(least < before, np.minimum(1.0, 2.0 * pace), 0.5 * pace)
        return y

    def _normal(self, p: FloatArray) -> FloatArray:
        g = self.part.program.jets(p, 1)[:, 1:4]
        return np.asarray(g / np.maximum(np.linalg.norm(g, axis=1), 1e-300)[:, None])

    def _on(self, p: FloatArray) -> AnyArray:
        return np.asarray(np.abs(self.part.program.values(p)) <= self._slack(p))


def _meeting(x: FloatArray, normals: FloatArray, offsets: FloatArray, count: int) -> FloatArray:
    """The points nearest to x on the first planes at once."""
    N = normals[:, :count]
    out: FloatArray = x + least_steps(N, np.einsum("nki,ni->nk", N, x) - offsets[:, :count])
    return out


def _solved(system: FloatArray, right: FloatArray) -> FloatArray:
    """Solutions of small systems; NaN where there is none."""
    finite = np.isfinite(system).all(axis=(1, 2)) & np.isfinite(right).all(axis=1)
    known = np.where(finite.reshape(-1, 1, 1), system, np.eye(4))
    regular = finite & np.asarray(np.linalg.cond(known) < 1e14)
    out = np.full(right.shape, np.nan)
    out[regular] = np.linalg.solve(system[regular], right[regular][:, :, None])[:, :, 0]
    return out


@dataclass(frozen=True, eq=False)
class _Distance(Whole):
    part: Node
    region: FloatArray | None
    seeds: int
    band: float
    cache: dict[str, Any] = field(default_factory=dict)

    @property
    def bounded(self) -> bool:
        """Whether the field is: its bounds tell where there is a surface to be distant from."""
        return self.part.bounded

    def _box(self, level: float = 0.0) -> FloatArray:
        inner = self.part._box(0.0)
        if is_empty(inner):
            return nowhere()
        margin = max(level, 0.0)
        return inner + np.array([[-margin] * 3, [margin] * 3])

    @property
    def search(self) -> _Search:
        """The search, made when first needed."""
        if "search" not in self.cache:
            self.cache["search"] = self._make()
        found: _Search = self.cache["search"]
        return found

    def _make(self) -> _Search:
        polynomial = self.part.polynomial
        if polynomial is not None:
            return _Periodic(polynomial)
        box = self.cache.get("region", self.region)
        if box is None or not np.isfinite(box).all():
            box = self.part._box(0.0)
        if not np.isfinite(box).all():
            raise InputError(
                "the distance to a field without end needs a box: give box=, or intersect the "
                "field with a box, a sphere or a mesh"
            )
        if is_empty(box):
            raise GeometryError("there is no surface to be distant from: the solid is empty")
        pad = 1e-3 * float((box[1] - box[0]).max()) + 1e-12
        return _Boxed(self.part, box + np.array([[-pad], [pad]]), self.seeds)

    # ------------------------------------------------------------------ as a leaf

    def values(self, points: FloatArray) -> FloatArray:
        """Signed distances at points; beyond the band those of its edge."""
        f = self.part.program.values(points)
        far = np.zeros(len(points), bool)
        if self.band < np.inf:
            far = self._beyond(points)
        out = np.full(len(points), self.band)
        near = points[~far]
        out[~far] = np.linalg.norm(near - self.search.feet(near), axis=1)
        return np.where(f < 0.0, -1.0, 1.0) * np.minimum(out, self.band)

    def _beyond(self, points: FloatArray) -> AnyArray:
        """Points surely beyond the band: no zero in the cube about them."""
        bounds = self.part.program.ranges(points - self.band, points + self.band)
        return (bounds[:, 0] > 0.0) | (bounds[:, 1] < 0.0)

    def jets(self, points: FloatArray, order: int) -> tuple[FloatArray, ...]:
        """Values, unit gradients, and Hessians by differences of the gradients."""
        f, g = self._first(points)
        if order == 1:
            return f, g
        return f, g, hessians(lambda p: self._first(p)[1], points)

    def _first(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        inner = self.part.program.jets(points, 1)
        side = np.where(inner[:, 0] < 0.0, -1.0, 1.0)
        way = points - self.search.feet(points)
        gap = np.linalg.norm(way, axis=1)
        steep = np.linalg.norm(inner[:, 1:4], axis=1)
        on = gap <= 1e-9 * max(1.0, float(np.abs(points).max(initial=0.0)))
        unit = np.where(
            on[:, None],
            inner[:, 1:4] / np.maximum(steep, 1e-300)[:, None],
            (side / np.where(on, 1.0, gap))[:, None] * way,
        )
        held = gap > self.band
        unit[held] = 0.0
        return side * np.minimum(gap, self.band), unit

    def bounds_on(self, lo: FloatArray, hi: FloatArray, moved: bool) -> FloatArray:
        """Bounds on boxes, and the steepness 1: distances change no faster."""
        out = np.tile([-np.inf, np.inf, np.inf], (len(lo), 1))
        known = np.isfinite(lo).all(axis=1) & np.isfinite(hi).all(axis=1)
        if known.any():
            middle = 0.5 * (lo[known] + hi[known])
            radius = np.linalg.norm(hi[known] - middle, axis=1)
            value = self.values(middle)
            radius += 1e-6 * (radius + np.abs(value))
            out[known, 0], out[known, 1] = value - radius, value + radius
        if not moved:
            out[:, 2] = 1.0
        return out


def distance(part: Node, *, box: Any = None, band: float = np.inf, seeds: int = SEEDS) -> Node:
    """True signed distance to the surface of a solid.

    Parameters
    ----------
    part : Node
        Field; its zero set is the surface.
    box : (2, 3) array, optional
        Where the surface is looked for. By default the box of the solid; surfaces without end
        need one, but for trigonometric polynomials (tiles of the catalogue, scaled, and offset by
        constants), which are searched on one period.
    band : float
        Distances beyond are not computed: their absolute value is the band.
    seeds : int
        Points per side of the box from which the surface is looked for.

    Returns
    -------
    Node
        The distance, negative inside.

    Raises
    ------
    InputError
        For something that is no field, or no box.

    Notes
    -----
    Closest points by Newton's method on the conditions of first order, with the curvature of the
    field, from several seeds; see Hong et al. 2025, section 3.3.
    """
    node = as_node("part", part)
    width = as_array("band", band, finite=False)  # may be infinite
    if width.size != 1 or not width.ravel()[0] > 0.0:
        raise InputError(f"band must be a number above zero, got {band!r:.80}")
    if not (isinstance(seeds, int) and 4 <= seeds <= 2000):
        raise InputError(f"seeds must be a whole number from 4 to 2000, got {seeds!r:.80}")
    region = None
    if box is not None:
        region = np.array(as_array("box", box, ndim=2))
        if region.shape != (2, 3) or not (region[0] < region[1]).all():
            raise InputError(f"box must be two corners (2, 3), lower one first, got {box!r:.80}")
    return _Distance(node, region, seeds, float(width.ravel()[0]))


def bind(field: Node, box: FloatArray) -> None:
    """Tell the distances in a tree where they will be asked for.

    Parameters
    ----------
    field : Node
        Any field. Distances to surfaces without end, and without a box of their own, look for
        them in the image of `box` in their coordinates, and a quarter of its size beyond.
    box : ndarray, shape (2, 3)
        Where the field will be evaluated.
    """
    for leaf, point in field.program.leaves:
        if not isinstance(leaf, _Distance):
            continue
        ends = np.stack([p.ranges(box[:1], box[1:])[0] for p in point], axis=1)
        bind(leaf.part, ends)
        if leaf.region is None and np.isfinite(ends).all():
            inner = leaf.part._box(0.0)
            margin = MARGIN * float((ends[1] - ends[0]).max())
            reach = ends + np.array([[-margin], [margin]])
            leaf.cache["region"] = np.stack(
                (np.maximum(inner[0], reach[0]), np.minimum(inner[1], reach[1]))
            )
