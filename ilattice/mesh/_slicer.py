"""How a wall is cut by planes: a sheet through the crossed cells, and the wall's outline on it.

The height of space is a spline Z(u) = n . x(u) over the parameter box. Where a grid cell is
crossed by the plane, the plane is a sheet of triangles between edges of tetrahedra; the sides of
the wall S = d_outer and S = -d_inner cross its edges, and its rim lies on the faces of the domain.
Both sides are contoured by themselves, because a point is never beyond both; then every crossing
has one segment that comes and one that goes, and the outline closes without tolerances. The map
is never inverted, and no box of space is rasterised: cells that a crossing does not need are
skipped by rigorous ranges of Z and of the wall.

Guarantees: closed loops whatever the signs; memory is that of one slice plus one pair of bounds
per block of 8 x 8 x 8 cells; output is the same for any number of threads.
Non-guarantee: parts of the wall thinner than the grid are seen only where a vertex hits them.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.bspline import BSpline
from ilattice.errors import GeometryError, InputError
from ilattice.mesh import _kernels_slices as kernels
from ilattice.mesh._roots import between

if TYPE_CHECKING:
    from ilattice.offsets.wall import Wall

BLOCK = 8
#: Bisections of the boxes that may hold the highest and the lowest point.
HALVINGS = 24
#: Secants onto the plane, along edges of the grid.
SECANTS = 3
#: Most Newton steps onto wall and plane by the distance spline, then by closest points.
STEPS, POLISHING = 6, 3
#: Longest step and longest way of a point, and the step that ends the iteration, in cells.
STEP, WAY, STILL = 0.5, 1.5, 1e-3
#: Points nearer to each other merge: first those along smooth parts of a contour, relative to the
#: shortest edge of the cells there, then all, relative to the edges asked for.
SPACING, MERGE = 0.35, 1e-3
#: Turn between neighbouring edges, in radians, above which they are halved, and how often at most:
#: chords cut off an area that falls with the square of the turn.
BEND, HALVES = 0.03, 5
#: How far beside a chord, relative to its length, the point in between may be: as at half a circle,
#: less than at the other side of a crease; and how far from its middle.
ASIDE, AHEAD = 0.5, 0.35
#: How far below the asked height planes cut, relative to the largest height: an upper end that is
#: flat is cut as a whole, whatever the rounding of its heights.
BELOW = 1e-11
CHUNK = 1 << 17


class Outline(NamedTuple):
    """Closed loops: points (n, 2), first point of each loop (m + 1,), signed areas (m,)."""

    points: FloatArray
    start: IntArray
    area: FloatArray


class _Points(NamedTuple):
    """Points on the grid: parameters, faces of the domain as bits, side and the two levels."""

    u: FloatArray
    faces: IntArray
    side: IntArray
    beyond: FloatArray  # (n, 2): -S - d_inner, S - d_outer


class Slicer:
    """Cuts one wall by parallel planes.

    Parameters
    ----------
    wall : Wall
        The wall.
    axes : three ndarray
        Grid planes in the parameter box.
    frame : ndarray, shape (3, 3)
        Rows: the two directions in the plane and its normal, right-handed.
    h : float
        Length of the edges of the grid in space.
    polish : bool
        Whether points move onto the exact offset, by closest points.
    """

    def __init__(
        self, wall: "Wall", axes: tuple[FloatArray, ...], frame: FloatArray, h: float, polish: bool
    ) -> None:
        self.wall, self.axes, self.frame, self.polish = wall, axes, frame, polish
        self.h = h
        self.closed = np.array(wall.lattice.through.closed)
        self.height = _component(wall.lattice.through.geometry, frame[2])
        cells = np.array([len(a) - 1 for a in axes])
        self.cells = cells
        self.planes = np.where(self.closed, cells, cells + 1)
        self.blocks, self.low, self.high = self._blocks()

    def _blocks(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """First cells of the blocks that the outline may cross, and their least and most height."""
        counts = [-(-int(c) // BLOCK) for c in self.cells]
        total = int(np.prod(counts))
        parts = []
        for i in range(0, total, CHUNK):
            index = np.arange(i, min(i + CHUNK, total))
            first = BLOCK * np.stack(np.unravel_index(index, counts), axis=1)
            last = np.minimum(first + BLOCK, self.cells)
            lo, hi = self._at(first), self._at(last)
            ends = (~self.closed & ((first == 0) | (last == self.cells))).any(axis=1)
            bound = self.wall.field.range(lo, hi)
            keep = (bound[:, 0] <= 0.0) & (ends | (bound[:, 1] >= 0.0))
            parts.append((first[keep], self.height.range(lo[keep], hi[keep])))
        height = np.concatenate([p[1] for p in parts])
        return np.concatenate([p[0] for p in parts]), height[:, 0].copy(), height[:, 1].copy()

    @property
    def net(self) -> FloatArray:
        """Points whose hull holds the part, shape (n, 3)."""
        net: FloatArray = self.wall.lattice.through.geometry.c.reshape(-1, 3)
        return net

    def _at(self, index: IntArray) -> FloatArray:
        """Parameters of grid vertices."""
        return np.stack([a[index[:, k]] for k, a in enumerate(self.axes)], axis=1)

    # ---------------------------------------------------------------- one slice

    def outline(self, level: float) -> Outline:
        """Loops in which the plane at one height cuts the wall, the wall on their left."""
        level -= BELOW * float(np.abs(self.height.c).max())
        edges, ends = self._sheet(level)
        if not len(edges):
            return _EMPTY
        names, at, vertex = np.unique(edges.ravel(), return_index=True, return_inverse=True)
        points = self._vertices(names, ends.reshape(-1, 2)[at], level)
        segments = np.empty((5 * len(edges), 2), np.int64)
        count = kernels.march(
            np.ascontiguousarray(vertex.reshape(-1, 3)), points.side, points.faces, segments
        )
        if count == 0:
            return _EMPTY
        node, following = _permutation(segments[:count])
        order, start = np.empty(len(node), np.int64), np.empty(len(node) + 1, np.int64)
        loops = kernels.chain(following, order, start)
        return self._place(node[order], start[: loops + 1].copy(), points, level)

    def _sheet(self, level: float) -> tuple[IntArray, FloatArray]:
        """Names (T, 3) of the edges that hold the corners of triangles, heights at their ends."""
        hit = np.flatnonzero((self.low < level) & (self.high >= level))
        turn = 1 if self.wall.lattice.through.orientation >= 0 else -1
        edges, ends = [np.empty((0, 3), np.int64)], [np.empty((0, 3, 2))]
        step = max(1, CHUNK // (BLOCK + 1) ** 3)
        for i in range(0, len(hit), step):
            cells, corner = self._crossed(self.blocks[hit[i : i + step]], level)
            room = 12 * len(cells)
            e, z = np.empty((room, 3), np.int64), np.empty((room, 3, 2))
            n = kernels.sheet(cells, corner, level, self.planes, turn, e, z)
            edges.append(e[:n].copy())
            ends.append(z[:n].copy())
        return np.concatenate(edges), np.concatenate(ends)

    def _crossed(self, blocks: IntArray, level: float) -> tuple[IntArray, FloatArray]:
        """Cells (m, 3) of blocks that the plane crosses, and the heights at their corners."""
        local = np.indices((BLOCK + 1,) * 3).reshape(3, -1).T
        index = np.minimum(blocks[:, None, :] + local, self.cells).reshape(-1, 3)
        height = self.height(self._at(np.where(self.closed, index % self.cells, index)))
        height = height.reshape(-1, *(BLOCK + 1,) * 3)
        found = np.empty((0, 4), np.int64)
        args = (height, blocks, level, self.cells)
        found = np.empty((kernels.crossed_cells(*args, found), 4), np.int64)
        kernels.crossed_cells(*args, found)
        b, i, j, k = found.T
        corner = [height[b, i + (c >> 2), j + (c >> 1 & 1), k + (c & 1)] for c in range(8)]
        return blocks[b] + found[:, 1:], np.stack(corner, axis=1)

    def _vertices(self, names: IntArray, ends: FloatArray, level: float) -> _Points:
        """Places where the plane crosses edges of the grid, and on which side of the wall."""
        direction = names % 8
        low = np.stack(np.unravel_index(names // 8, self.planes), axis=1)
        step = np.stack([direction >> 2, direction >> 1 & 1, direction & 1], axis=1)
        a, b = self._at(low), self._at(low + step)
        t = between(lambda v: self.height(v) - level, a, b, ends - level, SECANTS)
        u = a + t[:, None] * (b - a)
        faces = np.zeros(len(names), np.int64)
        for k in np.flatnonzero(~self.closed):
            on = (step[:, k] == 0) * ((low[:, k] == 0) + 2 * (low[:, k] == self.cells[k]))
            faces |= on.astype(np.int64) << (2 * int(k))
        s = self.wall.distance(u)
        t_ = self.wall.thickness
        beyond = np.stack([-s - t_.inner(u), s - t_.outer(u)], axis=1)
        side = np.where(beyond[:, 1] >= 0.0, 1, np.where(beyond[:, 0] >= 0.0, -1, 0))
        return _Points(u, faces, side, beyond)

    def _place(self, node: IntArray, start: IntArray, points: _Points, level: float) -> Outline:
        """Loops of places: vertices of the sheet, and crossings of its edges."""
        size = len(points.u)
        cross = node >= size
        upper = np.where(cross, (node - size) % 2, 0)
        pair = np.where(cross, (node - size) // 2, 0)
        a, b = np.where(cross, pair // size, node), np.where(cross, pair % size, node)
        fa, fb = points.beyond[a, upper], points.beyond[b, upper]
        t = np.where(cross, fa / np.where(cross, fa - fb, 1.0), 0.0)
        step = self._shortest(points.u[b] - points.u[a])
        u = self._wrapped(points.u[a] + t[:, None] * step)
        side = np.where(cross, 2 * upper - 1, 0)
        faces = points.faces[a] & points.faces[b]
        fixed = np.stack([(faces >> (2 * k)) & 3 for k in range(3)], axis=1) != 0
        sharp = fixed.sum(axis=1) + cross > 1
        keep = np.zeros(len(u), np.bool_)
        kernels.thin_out(self._flat(u), start, SPACING * self._edges(u), sharp, keep)
        start = np.concatenate([[0], np.cumsum(np.add.reduceat(keep, start[:-1], dtype=np.int64))])
        fixed, side = fixed[keep], side[keep]
        u = self._settled(u[keep], fixed, side, level)
        u, start = self._denser(u, start, (fixed, side, level))
        return finished(self._flat(u), start, MERGE * self.h)

    def _denser(
        self, u: FloatArray, start: IntArray, conditions: tuple[AnyArray, IntArray, float]
    ) -> tuple[FloatArray, IntArray]:
        """Loops with more points between neighbours on a side or a face, where they bend."""
        fixed, side, level = conditions
        for _ in range(HALVES):
            after = np.arange(1, len(u) + 1)
            after[start[1:] - 1] = start[:-1]
            p = self._flat(u)
            rim: AnyArray = np.asarray((fixed & fixed[after]).any(axis=1))
            along = rim | (side == side[after])
            turn = _turns(p, after)
            bend = along & along[after] & (rim == rim[after])
            turn[after[~bend]] = 0.0  # corners of the wall, or of the domain
            turn[fixed.sum(axis=1) > 1] = 0.0
            at = np.flatnonzero(along & (np.maximum(turn, turn[after]) > BEND))
            to = after[at]
            on, of = fixed[at] & fixed[to], np.where(rim, 0, side)[at]
            new = self._wrapped(u[at] + 0.5 * self._shortest(u[to] - u[at]))
            new = self._settled(new, on, of, level)
            good = _beside(self._flat(new), p[at], p[to])
            place = at[good] + 1
            start = start + np.searchsorted(place, start, "right")
            u, fixed = np.insert(u, place, new[good], axis=0), np.insert(fixed, place, on[good], 0)
            side = np.insert(side, place, of[good])
        return u, start

    def _shortest(self, step: FloatArray) -> FloatArray:
        """Ways between parameters, across the seam of closed directions where that is shorter."""
        lo, hi = self.wall.lattice.domain
        turns = np.where(self.closed, np.rint(step / (hi - lo)), 0.0)
        return step - turns * (hi - lo)

    def _flat(self, u: FloatArray) -> FloatArray:
        """Coordinates (n, 2) in the plane."""
        out: FloatArray = self.wall.lattice.through.x(u) @ self.frame[:2].T
        return out

    def _wrapped(self, u: FloatArray) -> FloatArray:
        lo, hi = self.wall.lattice.domain
        return np.where(self.closed, lo + np.mod(u - lo, hi - lo), np.clip(u, lo, hi))

    # ---------------------------------------------------------------- onto wall and plane

    def _settled(self, u: FloatArray, fixed: AnyArray, side: IntArray, level: float) -> FloatArray:
        """Points moved onto the plane and, those on a side of the wall, onto it.

        Points that would move far stay; where closest points fail, the distance spline holds.
        """
        width = self._widths(u)
        way = self._way(u, width, np.zeros_like(u), (fixed, side, level), exact=False)
        if self.polish:
            way = self._way(u, width, way, (fixed, side, level), exact=True)
        return self._wrapped(u + way * width)

    def _way(
        self,
        u: FloatArray,
        width: FloatArray,
        before: FloatArray,
        conditions: tuple[AnyArray, IntArray, float],
        *,
        exact: bool,
    ) -> FloatArray:
        """How far to go, in cells, after some Newton steps; as `before` where that is too far."""
        fixed, side, level = conditions
        way = before.copy()
        at = np.flatnonzero(side) if exact else np.arange(len(u))
        for _ in range(POLISHING if exact else STEPS):
            now = self._wrapped(u[at] + way[at] * width[at])
            step = self._step(now, fixed[at], side[at], level, exact=exact) / width[at]
            longest = np.abs(step).max(axis=1, initial=0.0)
            way[at] += step * np.minimum(1.0, STEP / np.maximum(longest, STEP))[:, None]
            at = at[longest > STILL]
            if not len(at):
                break
        far = np.abs(way).max(axis=1, initial=0.0) > WAY
        return np.where(far[:, None], before, way)

    def _widths(self, u: FloatArray) -> FloatArray:
        """Widths of the cells around points along the three directions."""
        out = np.empty_like(u)
        for k, a in enumerate(self.axes):
            d = np.diff(a)
            out[:, k] = d[np.clip(np.searchsorted(a, u[:, k]) - 1, 0, len(d) - 1)]
        return out

    def _edges(self, u: FloatArray) -> FloatArray:
        """Lengths of the shortest edges of the cells around points, at most those asked for."""
        size = np.linalg.norm(self.wall.lattice.through.jacobian(u), axis=1)
        return np.minimum((size * self._widths(u)).min(axis=1), self.h)

    def _step(
        self, u: FloatArray, fixed: AnyArray, side: IntArray, level: float, *, exact: bool
    ) -> FloatArray:
        """Shortest step in space onto the linearised conditions."""
        x, jacobian = self.wall.lattice.through.jet(u, 1)
        free = ~fixed
        metric = np.einsum("nca,ncb->nab", jacobian, jacobian) * (free[:, :, None] & free[:, None])
        size = np.einsum("naa->n", metric)
        metric += (fixed * size[:, None] + 1e-12 * size[:, None])[:, :, None] * np.eye(3)
        rows = np.zeros((len(u), 2, 3))
        miss = np.zeros((len(u), 2))
        rows[:, 0] = np.einsum("nca,c->na", jacobian, self.frame[2]) * free
        miss[:, 0] = x @ self.frame[2] - level
        at = np.flatnonzero(side)
        if len(at):
            value, gradient = self._side(u[at], x[at], jacobian[at], side[at], exact)
            rows[at, 1], miss[at, 1] = gradient * free[at], value
        lifted = np.linalg.solve(metric, rows.transpose(0, 2, 1))
        gram = rows @ lifted
        scale = np.einsum("nii->ni", gram)
        alone = scale[:, 1] == 0.0
        gram[:, 1, 1] += alone
        gram += (1e-9 * scale.max(axis=1))[:, None, None] * np.eye(2)
        step: FloatArray = -(lifted @ np.linalg.solve(gram, miss[:, :, None]))[:, :, 0]
        return np.where(np.isfinite(step), step, 0.0)

    def _side(
        self, u: FloatArray, x: FloatArray, jacobian: FloatArray, side: IntArray, exact: bool
    ) -> tuple[FloatArray, FloatArray]:
        """How far points are beyond a side of the wall, and the gradient in u."""
        from ilattice.offsets.polish import distance_jet

        thickness = self.wall.thickness
        asked, slope = (np.where(side > 0, a.T, b.T).T for a, b in zip(
            thickness.outer.jet(u, 1), thickness.inner.jet(u, 1), strict=True
        ))  # fmt: skip
        if exact:
            s, g, lost = distance_jet(self.wall.lattice, u, x, jacobian)
        else:
            s, g = self.wall.distance.jet(u, 1)
            lost = np.zeros(len(u), np.bool_)
        value = np.where(lost, 0.0, side * s - asked)
        return value, side[:, None] * g - slope


def _turns(points: FloatArray, after: IntArray) -> FloatArray:
    """Angles of closed loops at points (n, 2), given the index of the one after each."""
    ahead = points[after] - points
    turn = np.empty(len(points))
    beyond = ahead[after]
    cross = ahead[:, 0] * beyond[:, 1] - ahead[:, 1] * beyond[:, 0]
    turn[after] = np.abs(np.arctan2(cross, (ahead * beyond).sum(axis=1)))
    return turn


def _beside(new: FloatArray, a: FloatArray, b: FloatArray) -> AnyArray:
    """Which points (n, 2) are near the middle of the way from a to b: not so beside creases."""
    way, gone = b - a, new - a
    square = np.maximum((way * way).sum(axis=1), 1e-300)
    along = (gone * way).sum(axis=1) / square
    across = (way[:, 0] * gone[:, 1] - way[:, 1] * gone[:, 0]) / square
    good: AnyArray = (np.abs(along - 0.5) < AHEAD) & (np.abs(across) < ASIDE)
    return good


def finished(points: FloatArray, start: IntArray, least: float) -> Outline:
    """Loops without points that coincide, and without loops that are smaller than `least`."""
    keep = np.zeros(len(points), np.bool_)
    kernels.thin_out(points, start, np.full(len(points), least), np.zeros_like(keep), keep)
    count = np.add.reduceat(keep, start[:-1], dtype=np.int64)
    points, start = points[keep], np.concatenate([[0], np.cumsum(count)])
    area = np.empty(len(count))
    kernels.areas(points, start, area)
    good = (count >= 3) & (np.abs(area) > least**2)
    points = points[np.repeat(good, count)]
    return Outline(points, np.concatenate([[0], np.cumsum(count[good])]), area[good])


_EMPTY = Outline(np.empty((0, 2)), np.zeros(1, np.int64), np.empty(0))


def _component(spline: BSpline, direction: FloatArray) -> BSpline:
    """Scalar product of a spline with a direction."""
    return BSpline(
        spline.t, spline.c @ direction, spline.k, periodic=spline.periodic, weights=spline.weights
    )


def _permutation(segments: IntArray) -> tuple[IntArray, IntArray]:
    """Names of the ends, sorted, and for each the position of the one that follows it."""
    order = np.argsort(segments[:, 0], kind="stable")
    node, to = segments[order, 0], segments[order, 1]
    following = np.searchsorted(node, to)
    if (np.bincount(following, minlength=len(node)) != 1).any() or (node[following] != to).any():
        raise GeometryError("the outline of a slice does not close; please report this")
    return node, following


def extent(height: BSpline) -> tuple[float, float]:
    """Least and greatest height, to a ten-millionth of their difference: branch and bound."""
    return -_greatest(height, -1.0), _greatest(height, 1.0)


def _greatest(height: BSpline, sign: float) -> float:
    edges = [height.breaks(k) for k in range(3)]
    index = np.indices([len(e) - 1 for e in edges]).reshape(3, -1).T
    lo = np.stack([e[index[:, k]] for k, e in enumerate(edges)], axis=1)
    hi = np.stack([e[index[:, k] + 1] for k, e in enumerate(edges)], axis=1)
    for _ in range(HALVINGS):
        bound = np.sort(sign * height.range(lo, hi), axis=1)[:, 1]
        corners = np.concatenate([lo, hi, 0.5 * (lo + hi)])
        best = float((sign * height(corners)).max())
        if bound.max() <= best + 1e-7 * float(np.ptp(height.c)):
            break
        keep = np.flatnonzero(bound > best)
        if len(keep) > 4096:
            keep = keep[np.argsort(bound[keep], kind="stable")[-4096:]]
        lo, hi = _halved(lo[keep], hi[keep])
    return best


def _halved(lo: FloatArray, hi: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Boxes cut in eight."""
    middle = 0.5 * (lo + hi)
    bits: Iterator[FloatArray] = (np.array([c >> 2, c >> 1 & 1, c & 1]) for c in range(8))
    pairs = [(np.where(b, middle, lo), np.where(b, hi, middle)) for b in bits]
    return np.concatenate([p[0] for p in pairs]), np.concatenate([p[1] for p in pairs])


def as_frame(normal: FloatArray) -> FloatArray:
    """Right-handed rows: two directions in the plane and its unit normal; x, y, z for z."""
    length = float(np.linalg.norm(normal))
    if not length > 0.0:
        raise InputError(f"normal must not vanish, got {normal.tolist()}")
    n = normal / length
    first = np.array([1.0, 0.0, 0.0]) if abs(n[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    first = first - (first @ n) * n
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(n, first), n])
