"""Seeds on the mid-surface of a lattice, from which closest points are searched.

Guarantee: the same seeds for any number of threads. Non-guarantee: parts of the surface that are
smaller than a cell between seeds may have none; see `ilattice.offsets.seeding` for what is done.
"""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ilattice._geometry import grid_array, grid_points
from ilattice._kernels import thread_count
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import as_points, as_whole
from ilattice.errors import GeometryError
from ilattice.macroshape.tiling import Tiling
from ilattice.offsets import _kernels, _kernels_seeds
from ilattice.offsets._kernels_jets import UPRIGHT
from ilattice.offsets._kernels_patches import BELOW, BENT, DISTANCE, PLAIN
from ilattice.offsets.covering import FINER, Covering
from ilattice.offsets.seed_boxes import Boxes, in_order
from ilattice.offsets.seeding import Seeds, apart, between, downhill, layered, sharpest
from ilattice.offsets.space import TileSpace
from ilattice.offsets.spacing import Spacing
from ilattice.tiles.mixture import MixedField

#: Nearest seeds that are looked at first; and where seeds that were missed have been added, which
#: crowd on one sheet so that the nearest ones may hide another.
CANDIDATES, AMONG_ADDED = 8, 32
#: Largest number of rows that may be asked for: larger ones are mistakes, and would overflow.
MAX_ROWS = 1 << 40
#: Last step of a foot that is far away, in spacings of seeds; see `_kernels_newton.converged`.
TOLERANCE = 1e-7
#: Seeds per tile and direction: at least this many, and this many per period of the finest wave.
MIN_SEEDS, SEEDS_PER_WAVE = 8, 6
#: Tiles that are longer along one direction get up to this many times the seeds along it.
MAX_REFINED = 8
#: Half the factor by which a continuation may stretch tiles until they get more seeds.
STRETCHED = 0.75
#: Where tiles meet in creases, surfaces bend sharply next to faces: so many times the seeds per
#: direction; those up to so many cells away from a face do not tell the normals next to them.
MORE, CREASED = 2, 1.5


class SeededSpace(TileSpace):
    """Tile coordinates of a lattice, with seeds on its mid-surface and their k-d tree.

    Parameters
    ----------
    lattice : Lattice
        The tiles, their map and the boundary rule.

    Raises
    ------
    GeometryError
        If the tile has no zero set inside the domain.
    """

    def __init__(self, lattice: Tiling) -> None:
        super().__init__(lattice)
        self.looked_at = CANDIDATES
        count, closed = np.array(lattice.repeat), np.array(lattice.through.closed)
        self.seeds, usual = self._make_seeds(count, closed)
        self.tree = cKDTree(self.seeds.images)
        self.boxes = Boxes.of(*self.seeds[1:])
        self.spacing = Spacing(self, self.seeds.points, usual, self.singular)
        self.least_spacing = float(self.seeds.spacing.min())
        self.cell = 1.0 / self._least_seeds

    def _make_seeds(self, count: IntArray, closed: AnyArray) -> tuple[Seeds, FloatArray]:
        """Seeds, and the spacings (s,) that they would have if none were added between others."""
        ranges = [
            np.arange(0 if c or e else -1, n if c or e else n + 1)
            for n, c, e in zip(count, closed, self.ends, strict=True)
        ]
        tiles = grid_points(*ranges)
        p, cell, self.singular = layered(self, self._least_seeds, *self._tile_seeds(tiles))
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
        x, normal, spacing, rest = (
            np.empty((len(p), 3)), np.empty((len(p), self._columns)), np.empty(len(p)),
            np.empty(len(p)),
        )  # fmt: skip
        _kernels_seeds.place_seeds(
            len(p), self.space, p, cell, self.orient, x, normal, spacing, rest
        )  # fmt: skip
        if self.creased:
            near = (np.abs(p - np.rint(p)) <= CREASED * cell).any(axis=1)
            normal[near, BENT] = np.inf
        keep = np.flatnonzero(rest >= 0.5 * UPRIGHT)  # what just counts has seeds around
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
        p = grid_array(*axes)
        f = self.lattice.implicit(self.from_tile(p.reshape(-1, 3))).reshape(p.shape[:3])
        out = [between(p, f, a) for a in range(3) if a not in held]
        return np.concatenate(out)

    # --- what starts from them

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
        found: Any = self.tree.query(x, k=np.arange(1, k + 1), workers=thread_count())
        distance, idx = found
        return distance, np.ascontiguousarray(idx, dtype=np.int64)

    def _descend(self, x: FloatArray, at: IntArray, start: FloatArray, feet: FloatArray) -> None:
        """Fill in feet that are found downhill from the nearest seeds, where Newton left them."""
        p = downhill(self, x, start)
        y = self.lattice.through.x(self.from_tile(p), extrapolate="extend")
        sign = np.where(feet[at, DISTANCE] < 0.0, -1.0, 1.0)
        feet[at] = np.column_stack([p, y, sign * np.linalg.norm(x - y, axis=1), sign])

    def _run(
        self, x: FloatArray, p: FloatArray, idx: IntArray, feet: FloatArray, counts: IntArray,
        status: IntArray, seeds: Seeds | None = None,
    ) -> None:  # fmt: skip
        """Fill in what the starts of queries lead to, see `_kernels.closest`."""
        closest: Any = _kernels.closest
        closest(
            len(x), self.space, seeds or self.seeds, x, p, idx, self.box, self.orient, TOLERANCE,
            feet[0], feet[1], counts, status,
        )  # fmt: skip


def _cell_centres(m: IntArray) -> FloatArray:
    axes = [(np.arange(n) + 0.5) / n for n in m]
    return grid_points(*axes)
