"""How a wall is cut by planes: a section through the crossed cells, and the wall's outline on it.

The height of space is a spline Z(u) = n . x(u) over the parameter box. Where a grid cell is
crossed by the plane, the plane is a triangulation between edges of tetrahedra; the sides of
the wall S = d_outer and S = -d_inner cross its edges, and its rim lies on the faces of the domain.
Both sides are contoured by themselves, because a point is never beyond both; then every crossing
has one segment that comes and one that goes, and the outline closes without tolerances. The map
is never inverted, and no box of space is rasterised: cells that a crossing does not need are
skipped by rigorous ranges of Z and of the wall.

Guarantees: closed loops whatever the signs; memory is that of one slice plus one pair of bounds
per block of 8 x 8 x 8 cells; output is the same for any number of threads.
Non-guarantee: parts of the wall, or gaps, thinner than the grid are seen where the tangents at its
vertices tell of them, which is nearly always; see `ilattice.slicing._section`.
"""

import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np

from ilattice._geometry import between, fixed_coordinates, grid_indices
from ilattice._typing import FloatArray, IntArray
from ilattice.bspline import BSpline
from ilattice.errors import GeometryError, InputError, PrecisionWarning
from ilattice.slicing import _kernels_slices as kernels
from ilattice.slicing._in_plane import InPlane
from ilattice.slicing._loops import EMPTY, Outline, placed
from ilattice.slicing._section import Section, edges_of, halved, hidden, joined

#: Cells per direction of a block that is skipped, or not, as one.
BLOCK = 8
#: Bisections of the boxes that may hold the highest and the lowest point.
HALVINGS = 24
#: How often edges are halved that may hide a gap or a web.
DEPTH = 3
#: Secants onto the plane, along edges of the grid.
SECANTS = 3
#: How far below the asked height planes cut, relative to the largest height: an upper end that is
#: flat is cut as a whole, whatever the rounding of its heights.
BELOW = 1e-11
#: Blocks that are bounded at once, and nodes of blocks that are evaluated at once: these limit the
#: memory.
CHUNK = 1 << 17
#: Edges of the mesh that stands for all slices, as a part of the thinnest wall.
COARSE = 0.5


class Slicer:
    """Cuts one wall by parallel planes.

    Parameters
    ----------
    plane : InPlane
        Moves points of the wall within such planes.
    """

    def __init__(self, plane: InPlane) -> None:
        self.plane, wall, axes = plane, plane.wall, plane.axes
        self.wall, self.axes = wall, axes
        self.closed = np.array(wall.lattice.through.closed)
        self.period = np.where(self.closed, np.ptp(wall.lattice.domain, axis=0), 0.0)
        self.height = component(wall.lattice.through.geometry, plane.frame[2])
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

    def approximation(self) -> Any:
        """A coarse mesh of the wall, for programs that do not know of slices."""
        wall: Any = self.wall
        with warnings.catch_warnings():  # it is coarse on purpose
            warnings.simplefilter("ignore", PrecisionWarning)
            return wall.mesh(h=COARSE * wall.least_thickness, polish=False)

    def _at(self, index: IntArray) -> FloatArray:
        """Parameters of grid vertices."""
        return np.stack([a[index[:, k]] for k, a in enumerate(self.axes)], axis=1)

    # ---------------------------------------------------------------- one slice

    def outline(self, level: float) -> Outline:
        """Loops in which the plane at one height cuts the wall, the wall on their left."""
        level -= BELOW * float(np.abs(self.height.c).max())
        edges, ends = self._section(level)
        if not len(edges):
            return EMPTY
        names, at, vertex = np.unique(edges.ravel(), return_index=True, return_inverse=True)
        corners = self._corners(names, ends.reshape(-1, 2)[at], level)
        section = self._finer(corners._replace(triangles=vertex.reshape(-1, 3)), level)
        segments = np.empty((5 * len(section.triangles), 2), np.int64)
        count = kernels.march(section.triangles, section.side, section.faces, segments)
        if count == 0:
            return EMPTY
        node, following = _permutation(segments[:count])
        order, start = np.empty(len(node), np.int64), np.empty(len(node) + 1, np.int64)
        loops = kernels.chain(following, order, start)
        out = placed(self.plane, node[order], start[: loops + 1].copy(), section, level)
        return out._replace(unresolved_area=self._unresolved_area(section))

    def _section(self, level: float) -> tuple[IntArray, FloatArray]:
        """Names (T, 3) of the edges that hold the corners of triangles, heights at their ends."""
        hit = np.flatnonzero((self.low < level) & (self.high >= level))
        turn = 1 if self.wall.lattice.through.orientation >= 0 else -1
        edges, ends = [np.empty((0, 3), np.int64)], [np.empty((0, 3, 2))]
        step = max(1, CHUNK // (BLOCK + 1) ** 3)
        for i in range(0, len(hit), step):
            cells, corner = self._crossed(self.blocks[hit[i : i + step]], level)
            room = 12 * len(cells)
            e, z = np.empty((room, 3), np.int64), np.empty((room, 3, 2))
            n = kernels.section(cells, corner, level, self.planes, turn, e, z)
            edges.append(e[:n].copy())
            ends.append(z[:n].copy())
        return np.concatenate(edges), np.concatenate(ends)

    def _crossed(self, blocks: IntArray, level: float) -> tuple[IntArray, FloatArray]:
        """Cells (m, 3) of blocks that the plane crosses, and the heights at their corners."""
        local = grid_indices((BLOCK + 1,) * 3)
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

    def _corners(self, names: IntArray, ends: FloatArray, level: float) -> Section:
        """Places where the plane crosses edges of the grid, without triangles."""
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
        return self._seen(u, faces, 0)

    def _seen(self, u: FloatArray, faces: IntArray, depth: int) -> Section:
        """Corners of a section, and on which side of the wall they are."""
        t_, s = self.wall.thickness, self.wall.distance.jet(u, 1)
        outer = t_.outer.jet(u, 1)
        inner = outer if t_.symmetric else t_.inner.jet(u, 1)
        beyond = np.stack([-s[0] - inner[0], s[0] - outer[0]], axis=1)
        slope = np.stack([-s[1] - inner[1], s[1] - outer[1]], axis=1)
        side = np.where(beyond[:, 1] >= 0.0, 1, np.where(beyond[:, 0] >= 0.0, -1, 0))
        none = np.empty((0, 3), np.int64)
        return Section(none, u, faces, side, beyond, slope, np.full(len(u), depth))

    def _finer(self, section: Section, level: float) -> Section:
        """The section with edges halved that may hide contours."""
        done = []
        for depth in range(1, DEPTH + 1):
            marked = hidden(section, self.period)
            open_ = marked.any(axis=1)
            done.append(section.triangles[~open_])
            ends, edge = edges_of(section.triangles[open_], marked[open_], len(section.u))
            a, b = ends.T
            faces = section.faces[a] & section.faces[b]
            u = section.u[a] + 0.5 * self.plane.shortest(section.u[b] - section.u[a])
            none = np.zeros(len(u), np.int64)
            u = self.plane.projected(self.plane.wrapped(u), fixed_coordinates(faces), none, level)
            new = self._seen(u, faces, depth)
            middle = np.where(edge < 0, -1, len(section.u) + edge)
            triangles = halved(section.triangles[open_], middle)
            section = joined(section, new)._replace(triangles=triangles)
        return section._replace(triangles=np.concatenate([*done, section.triangles]))

    def _unresolved_area(self, section: Section) -> float:
        """Area of the triangles that may still hide contours."""
        p = self.plane.flat(section.u)[section.triangles[hidden(section, self.period).any(axis=1)]]
        a, b = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
        return 0.5 * float(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum())


def component(spline: BSpline, direction: FloatArray) -> BSpline:
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
    index = grid_indices([len(e) - 1 for e in edges])
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
