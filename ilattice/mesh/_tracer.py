"""The passes of contouring, slab by slab: sample, count, place vertices, join faces.

A slab is a run of layers of blocks along the first axis. Its signs need one layer of the slab
after it, its faces the vertices of one layer of the slab before it; a wrapped first axis is
closed at the end.

Guarantee: the same arrays for any number of threads and, but for the faces across a wrapped first
axis, in the same order for any size of the slabs.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ilattice._geometry import grid_points
from ilattice._progress import Progress, track
from ilattice._typing import AnyArray, IntArray
from ilattice.errors import GeometryError
from ilattice.mesh import _kernels_cells, _kernels_faces, _kernels_refine
from ilattice.mesh._kernels_cells import CAP, LANES, B, S
from ilattice.mesh._samplers import Sampler

BATCH = 1024  # blocks sampled, or given their vertices, at once
SLAB = 1000  # active blocks that end a slab
PULL = 0.2  # how far vertices are pulled to the centre of their cell before they are refined


@dataclass(frozen=True, eq=False)
class Contour:
    """Triangles in the coordinates of the axes, with the constraints of the vertices.

    Attributes
    ----------
    vertices : (V, 3) array
        Points, float64 or float32.
    faces : (F, 3) array of int32 or int64
        Corners, counter-clockwise seen from outside. Triangles 2 q and 2 q + 1 come from one quad
        (a, b, c, d) and are (a, b, c), (a, c, d): see `split_quads`.
    kind : (V,) array of uint8
        Bit ``2 a + s`` is set for vertices on the lower (s = 0) or upper (s = 1) face of D normal
        to axis a: that coordinate is fixed. Bit 6 (`ON_CAP`) is set for vertices inside caps, on
        no level set; bit 7 (`ON_LOWER`) for those on the lower of two levels.
    first_vertex : int
        Id of the first of `vertices`; not 0 for the pieces of `contour_blocks`.
    """

    vertices: AnyArray
    faces: AnyArray
    kind: AnyArray
    first_vertex: int = 0


@dataclass
class _Layers:
    """Sampled blocks of consecutive layers: what later passes need of them."""

    coords: IntArray  # (n, 4): layer, y, z, layer in the whole grid
    layers: int
    rows: AnyArray
    t: AnyArray
    t_first: IntArray
    prefix: AnyArray
    quads: IntArray
    start: IntArray  # id of the first vertex of each block
    points: AnyArray  # vertices of the blocks, from id `first_vertex` on
    place: AnyArray  # and their codes: see `_kernels_cells.vertices`
    first_vertex: int = 0
    traced: bool = False  # whether the vertices are there

    def part(self, blocks: AnyArray, layer: int) -> "_Layers":
        """The blocks of one layer, as layers of their own; crossings are left behind."""
        at = np.flatnonzero(blocks)
        coords = self.coords[at]
        coords[:, 0] -= layer
        first = int(self.start[at[0]]) if len(at) else 0
        stop = int(self.start[at[-1]] + self.prefix[at[-1], -1]) if len(at) else 0
        own = slice(first - self.first_vertex, stop - self.first_vertex)
        return replace(
            self, coords=coords, layers=1, rows=self.rows[at], prefix=self.prefix[at],
            quads=self.quads[at], start=self.start[at], points=self.points[own].copy(),
            place=self.place[own].copy(), first_vertex=first, t=self.t[:0],
            t_first=self.t_first[:0],
        )  # fmt: skip

    def first_layer(self) -> "_Layers":
        """The first layer alone."""
        return self.part(self.coords[:, 0] == 0, 0)

    def last_layer(self) -> "_Layers":
        """The last layer alone."""
        return self.part(self.coords[:, 0] == self.layers - 1, self.layers - 1)


@dataclass
class _Window:
    """Consecutive layers as one list of blocks, with the place of each block."""

    coords: IntArray
    lookup: AnyArray
    rows: AnyArray


class Tracer:
    """Runs the passes slab by slab: sample, count, place vertices, join faces."""

    def __init__(self, sampler: Sampler, caps: bool, refine: bool, dtype: Any) -> None:
        self.sampler, self.grid = sampler, sampler.grid
        self.caps, self.refine, self.dtype = caps, refine, dtype
        self.total = 0  # vertices so far
        self._samples = np.empty((0, S, S, LANES), np.float32)

    # ---------------------------------------------------------------- slabs

    def pieces(self, progress: Progress) -> Iterator[Contour]:
        """Trace all slabs in order; see `contour_blocks`."""
        seam = self._sample_seam() if self.grid.wrap[0] else None
        previous, current, opening = seam, None, None
        for following in self._slabs(seam, progress):
            if current is not None:
                piece = self.trace(previous, current, following)
                if seam is not None and opening is None:
                    opening = current.first_layer()
                previous = current.last_layer()
                yield piece
                del piece  # not to hold it while the next one is made
            current = following
        assert current is not None
        if seam is None:
            yield self.trace(previous, current, None)
        else:
            last = self.trace(previous, current, opening or current)
            yield self._close(last, current, opening or current)
        if self.total == 0:
            raise GeometryError(self._no_surface())

    def _sample_seam(self) -> _Layers:
        """The last layer of a wrapped grid, which comes first: layer 0 needs its signs."""
        n = self.grid.blocks[0]
        return self.sample(n - 1, self.sampler.active(n - 1, n))

    def _slabs(self, seam: _Layers | None, progress: Progress) -> Iterator[_Layers]:
        """Sampled slabs, in order; the last layer of a wrapped grid is there already."""
        n = self.grid.blocks[0] - (seam is not None)
        first = 0
        masks: list[AnyArray] = []
        for group in track(range(0, n, B), "contour", progress):
            mask = self.sampler.active(group, min(group + B, n))
            for layer in range(len(mask)):
                masks.append(mask[layer : layer + 1])
                full = sum(int(m.sum()) for m in masks) >= SLAB
                if full or len(masks) >= self.sampler.max_layers:
                    yield self.sample(first, np.concatenate(masks))
                    first += len(masks)
                    masks = []
        if masks:
            yield self.sample(first, np.concatenate(masks))
        if seam is not None:
            yield seam

    # ---------------------------------------------------------------- passes

    def sample(self, first: int, mask: AnyArray) -> _Layers:
        """Signs and crossings of the active blocks of layers first.. ."""
        layer, y, z = np.nonzero(mask)
        coords = np.stack((layer, y, z, layer + first), axis=1).astype(np.int64)
        n = len(coords)
        rows = np.zeros((n, S * S), np.uint16)
        lower, upper = self.sampler.lower, self.sampler.upper
        self.sampler.begin(first, first + len(mask), coords)
        if len(self._samples) < min(n, BATCH):
            self._samples = np.empty((min(n, BATCH), S, S, LANES), np.float32)
        fractions, counts = [np.empty(0, np.float32)], [np.zeros(1, np.int64)]
        for i in range(0, n, BATCH):
            part = coords[i : i + BATCH]
            samples = self._samples[: len(part)]
            self.sampler.fill(part, samples)
            crossed = np.empty(len(part), np.int64)
            args = (len(part), samples, part, self.grid.shape, lower, upper, rows[i : i + BATCH])
            _kernels_cells.signs(*args, crossed)
            start = np.concatenate(([0], np.cumsum(crossed)))
            t = np.empty(start[-1], np.float32)
            _kernels_cells.crossings(*args, start, t)
            fractions.append(t)
            counts.append(crossed)
        return _Layers(
            coords, len(mask), rows, np.concatenate(fractions), np.cumsum(np.concatenate(counts)),
            np.zeros((n, B * B + 1), np.uint16), np.zeros(n, np.int64), np.zeros(n, np.int64),
            np.empty((0, 3), self.dtype), np.empty(0, np.uint16),
        )  # fmt: skip

    def trace(
        self, previous: _Layers | None, current: _Layers, following: _Layers | None
    ) -> Contour:
        """Vertices and faces of the slab `current`, between its neighbours."""
        if previous is current:  # wrapped onto itself
            previous = replace(current)
        before = 0 if previous is None else len(previous.coords)
        after = None if following is None else following.first_layer()
        window = self._window([previous, current, after])
        kind = self._vertices(window, before, current)
        blocks = np.arange(before, before + len(current.coords))
        if previous is not None and not previous.traced:  # behind the seam: see `_close`
            blocks = blocks[current.coords[:, 0] > 0]
        faces = self._faces(window, blocks, previous, current)
        return Contour(current.points, faces, kind, current.first_vertex)

    def _window(self, parts: list[_Layers | None]) -> _Window:
        """Layers one after the other."""
        present = [p for p in parts if p is not None]
        shift = np.concatenate(([0], np.cumsum([p.layers for p in present])))
        coords = np.concatenate(
            [p.coords + np.array([s, 0, 0, 0]) for p, s in zip(present, shift[:-1], strict=True)]
        )
        lookup = np.full((int(shift[-1]), *self.grid.blocks[1:]), -1, np.int32)
        lookup[tuple(coords[:, :3].T)] = np.arange(len(coords))
        return _Window(coords, lookup, np.concatenate([p.rows for p in present]))

    def _vertices(self, window: _Window, before: int, current: _Layers) -> AnyArray:
        """Fill in the vertices of `current`; their kinds."""
        n = len(current.coords)
        flips = np.zeros((before + n, B * B), np.uint8)
        prefix = np.zeros((before + n, B * B + 1), np.uint16)
        shape = self.grid.shape
        current.quads = np.empty(n, np.int64)
        _kernels_cells.count(
            n, before, window.rows, window.lookup, shape, window.coords, self.caps, flips, prefix,
            current.quads,
        )  # fmt: skip
        current.prefix = prefix[before:]
        ends = np.cumsum(current.prefix[:, -1], dtype=np.int64)
        local = np.concatenate((np.zeros(before + 1, np.int64), ends))
        size = int(local[-1])
        current.first_vertex = self.total
        current.start = local[before:-1] + self.total
        current.points = np.empty((size, 3), self.dtype)
        current.place = np.empty(size, np.uint16)
        kind = np.empty(size, np.uint8)
        for i in range(before, before + n, BATCH):
            j = min(i + BATCH, before + n)
            part = slice(local[i], local[j])
            cell = np.empty((local[j] - local[i], 3), np.int32)
            alone = np.empty(len(cell), np.bool_)
            _kernels_cells.vertices(
                j - i, window.rows[i:], flips[i:], shape, window.coords[i:], self.caps, current.t,
                current.t_first[i - before :], local[i:], self.grid.cell_table, current.points,
                kind, current.place, cell, alone,
            )  # fmt: skip
            free = np.flatnonzero(alone & (kind[part] & CAP == 0))
            if self.refine and len(free):
                self._refine(current.points[part], kind[part], cell, free)
        current.t = current.t[:0]
        current.traced = True
        self.total += size
        return kind

    def _refine(self, points: AnyArray, kind: AnyArray, cell: AnyArray, at: IntArray) -> None:
        """Two Newton steps of some vertices onto their level, in place.

        The first step starts nearer to the centre of the cell, which spreads the vertices evenly;
        where it ends at the boundary of the cell, the second one starts from the old place.
        Vertices that diverge, or end at the boundary then too, stay where they were: there the
        surface is bent more than the grid can show, and forced vertices would cross it.
        """
        table = self.grid.cell_table
        box = cell, table[_kernels_cells.BOTTOM], table[_kernels_cells.TOP]
        bounds = float(self.sampler.lower), float(self.sampler.upper)
        p = np.empty((len(at), 3))
        miss, stopped = np.empty(len(at)), np.empty(len(at), np.bool_)
        _kernels_refine.pull_to_centre(len(at), points, at, *box, PULL, p)
        for step in (_kernels_refine.first_step, _kernels_refine.second_step):
            step(len(at), points, at, kind, *box, *bounds, *self.sampler.jet(p), p, miss, stopped)

    def _faces(
        self, window: _Window, blocks: IntArray, previous: _Layers | None, current: _Layers
    ) -> AnyArray:
        """Faces of some blocks of the window, in ids of the whole contour."""
        parts = [p for p in (previous, current) if p is not None]
        n = sum(len(p.coords) for p in parts)
        offset = np.cumsum([0] + [len(p.points) for p in parts])
        start = np.concatenate(
            [p.start - p.first_vertex + o for p, o in zip(parts, offset[:-1], strict=True)]
        )
        quads = np.concatenate([p.quads for p in parts])[blocks]
        first = np.concatenate(([0], np.cumsum(quads)))
        ids = np.int32 if self.total < np.iinfo(np.int32).max else np.int64
        out = np.empty((2 * int(first[-1]), 3), ids)
        points = np.concatenate([p.points for p in parts])
        shift = [p.first_vertex - o for p, o in zip(parts, offset[:-1], strict=True)]
        numbering = np.array([offset[-2], shift[0], shift[-1]])
        _kernels_faces.faces(
            len(blocks), window.rows[:n], np.concatenate([p.prefix for p in parts]),
            np.where(window.lookup < n, window.lookup, -1), self.grid.shape, window.coords, blocks,
            start, self.caps, points, np.concatenate([p.place for p in parts]), self.grid.period,
            numbering, first, out,
        )  # fmt: skip
        return out

    def _close(self, last: Contour, current: _Layers, opening: _Layers) -> Contour:
        """`last` with the faces of the first layer of a wrapped grid, which need all vertices."""
        previous = current.last_layer()
        window = self._window([previous, opening])
        before = len(previous.coords)
        blocks = np.arange(before, before + len(opening.coords))
        faces = self._faces(window, blocks, previous, opening)
        return replace(last, faces=np.concatenate((last.faces, faces)))

    def _no_surface(self) -> str:
        """Message that names the range of the field."""
        sparse = [
            np.concatenate((end[:1], a[1 : -1 : max(1, len(a) // 24)], end[1:]))
            for a, end in zip(self.grid.axes, self.grid.ends.T, strict=True)
        ]
        points = grid_points(*sparse)
        f = self.sampler.values(np.ascontiguousarray(points)) + self.sampler.middle
        upper = float(self.sampler.upper) + self.sampler.middle
        lower = float(self.sampler.lower) + self.sampler.middle
        wanted = f"below {upper:g}" if np.isnan(lower) else f"between {lower:g} and {upper:g}"
        return (
            f"there is no surface: the solid is where the field is {wanted}, but on the box "
            f"{self.grid.ends.T.tolist()} it ranges over about "
            f"[{f.min():g}, {f.max():g}]; change the level, or the box"
        )
