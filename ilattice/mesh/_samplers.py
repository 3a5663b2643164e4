"""How contouring reads fields: pruning of blocks, samples of blocks, values and gradients.

A sampler stands for ``value = field / scale - middle``, and the solid is ``lower < value < upper``
(`lower` may be NaN: no lower bound). `GridSampler` takes any field; `ProgramSampler`, `TrigSampler`
and `SplineSampler` sample in compiled code.

Guarantee: a grid point has bitwise the same value in all blocks that share it; blocks are pruned
only where rigorous bounds, widened by the rounding of the samples, exclude the surface.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.interpolate import BSpline as SciPyBSpline

from ilattice._field import owns
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import as_array, asked
from ilattice.bspline import BSpline
from ilattice.errors import GeometryError, InputError
from ilattice.fields.node import Node
from ilattice.mesh import _kernels_sampling as kernels
from ilattice.mesh._grid import Grid
from ilattice.mesh._kernels_cells import LANES, B, S
from ilattice.tiles.trig import TrigField

POINTS = 1 << 17  # points per call of a field
DENSE = 0.3  # part of the points of a plane from which on the whole plane is evaluated
SINGLE = 4e-6  # rounding of sums in single precision, as a part of the sum of the magnitudes
GROUP = 8  # blocks per direction in a box of the coarse pruning


class Sampler:
    """Values of any field at any points; the base of all samplers."""

    max_layers = 1 << 30  # layers of blocks that can be sampled at once
    rounding = 0.0  # how far samples may be from the exact values

    def __init__(self, field: Any, grid: Grid, level: tuple[float, float], scale: Any) -> None:
        low, high = level
        self.field, self.grid, self.scale = field, grid, scale
        self.middle = high if low == -np.inf else 0.5 * (low + high)
        self.upper = np.float32(high - self.middle)
        self.lower = np.float32(np.nan) if low == -np.inf else np.float32(low - self.middle)

    # ---------------------------------------------------------------- points

    def values(self, points: FloatArray) -> FloatArray:
        """``field / scale - middle`` at points (n, 3); NaN is refused with its place."""
        f = _call(self.field, points, "field")
        if self.scale is not None:
            f = f / self._divisor(points)
        return f - self.middle

    def _divisor(self, points: FloatArray) -> FloatArray:
        s = _call(self.scale, points, "scale")
        if len(s) and not s.min() > 0:
            i = int(np.argmin(s))
            raise GeometryError(f"scale must be positive, but is {s[i]} at {points[i].tolist()}")
        return s

    def jet(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Value (n,) and gradient (n, 3)."""
        f, g = self._jet(self.field, points)
        if self.scale is not None:
            s, ds = self._jet(self.scale, points)
            f = f / s
            g = (g - f[:, None] * ds) / s[:, None]
        return f - self.middle, g

    def _jet(self, field: Any, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        if owns(field, "jet"):
            f, g = asked("jet of the field", field.jet, points, 1)
            return f, g
        f = _call(field, points, "field")
        g = np.empty((len(points), 3))
        for axis in range(3):
            step = 1e-4 * float(np.diff(self.grid.axes[axis]).min())
            moved = points.copy()
            beyond = points[:, axis] + step > self.grid.ends[1, axis]
            moved[:, axis] += np.where(beyond, -step, step)
            g[:, axis] = (_call(field, moved, "field") - f) / (moved[:, axis] - points[:, axis])
        return f, g

    # ---------------------------------------------------------------- pruning

    def bounds(self, lo: FloatArray, hi: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Bounds of ``value`` on boxes, or None when the field tells nothing."""
        out = _field_range(self.field, lo, hi)
        if out is not None and self.scale is not None:
            by = _field_range(self.scale, lo, hi)
            if by is None:
                return None
            out = np.stack(_quotient_range(out.T, by.T), axis=1)
        return None if out is None else (out[:, 0] - self.middle, out[:, 1] - self.middle)

    def crossed(self, low: FloatArray, high: FloatArray, faces: AnyArray) -> AnyArray:
        """Boxes that may hold a piece of the surface; `faces`: those that touch a face of D."""
        slack = self.rounding + 1e-9 * np.maximum(np.abs(low), np.abs(high))
        outside = (low >= self.upper + slack) | (high <= self.lower - slack)
        inside = high < self.upper - slack
        if not np.isnan(self.lower):
            inside &= low > self.lower + slack
        return ~outside & (faces | ~inside)

    def active(self, first: int, last: int) -> AnyArray:
        """Which blocks of the layers first..last may be crossed, (layers, by, bz)."""
        _, by, bz = self.grid.blocks
        coarse = self._boxes(np.array([[first, last]]), _groups(by), _groups(bz))
        if coarse is None:
            return np.ones((last - first, by, bz), dtype=bool)
        keep = np.repeat(np.repeat(coarse, GROUP, axis=1), GROUP, axis=2)[:, :by, :bz]
        blocks = np.argwhere(np.broadcast_to(keep, (last - first, by, bz)))
        out = np.zeros((last - first, by, bz), dtype=bool)
        shift = np.array([first, 0, 0])
        for i in range(0, len(blocks), POINTS):
            part = blocks[i : i + POINTS]
            out[tuple(part.T)] = self._box_list(part + shift, part + shift)
        return out

    def _boxes(self, *spans: IntArray) -> AnyArray | None:
        """`crossed` on the tensor grid of spans of blocks [first, last) along each axis."""
        index = np.meshgrid(*(np.arange(len(s)) for s in spans), indexing="ij")
        first = np.stack([s[i, 0].ravel() for s, i in zip(spans, index, strict=True)], axis=1)
        last = np.stack([s[i, 1].ravel() - 1 for s, i in zip(spans, index, strict=True)], axis=1)
        out = self._box_list(first, last)
        return None if out is None else out.reshape(index[0].shape)

    def _box_list(self, first: IntArray, last: IntArray) -> Any:
        ends = [self.grid.box_ends(a, first[:, a], last[:, a]) for a in range(3)]
        faces = np.zeros(len(first), dtype=bool)
        for a in range(3):
            faces |= self.grid.touches_faces(a, first[:, a], last[:, a])
        low_high = self.bounds(
            np.stack([e[0] for e in ends], axis=1), np.stack([e[1] for e in ends], axis=1)
        )
        return None if low_high is None else self.crossed(*low_high, faces)

    def _near_faces(self, spans: tuple[IntArray, ...]) -> AnyArray:
        """Which blocks of a tensor grid of blocks touch a face of D."""
        x, y, z = (self.grid.touches_faces(a, spans[a], spans[a]) for a in range(3))
        return x[:, None, None] | y[None, :, None] | z[None, None, :]

    # ---------------------------------------------------------------- samples

    def begin(self, first: int, last: int, coords: IntArray) -> None:
        """Prepare the blocks `coords` of the layers first..last."""

    def fill(self, coords: IntArray, samples: AnyArray) -> None:
        """Samples of blocks."""
        raise NotImplementedError


class GridSampler(Sampler):
    """Any field: each needed grid point of a slab is evaluated once."""

    def __init__(self, field: Any, grid: Grid, level: tuple[float, float], scale: Any) -> None:
        super().__init__(field, grid, level, scale)
        plane = len(grid.axes[1]) * len(grid.axes[2])
        self.max_layers = max(1, (1 << 24) // (B * plane))
        self._known: dict[int, AnyArray] = {}  # planes shared with slabs to come
        self._pinned: dict[int, AnyArray] = {}  # those of the seam
        self._slab = np.empty((0, 0, 0), np.float32)
        self._local = np.empty(0, np.int64)
        self._first = 0

    def begin(self, first: int, last: int, coords: IntArray) -> None:
        """Evaluate the points of the blocks that no earlier slab has."""
        planes = self.grid.planes[0][B * first : B * last + 1]
        real = np.unique(planes)
        self._first = first
        self._local = np.searchsorted(real, planes)
        if not self.grid.wrap[0]:  # ghost samples need no values
            s = np.arange(B * first, B * last + 1)
            self._local[(s == 0) | (s >= self.grid.cells[0])] = -1
        shape = (len(real), len(self.grid.axes[1]), len(self.grid.axes[2]))
        self._slab = np.full(shape, np.nan, np.float32)
        for row, plane in enumerate(real):
            if int(plane) in self._known:
                self._slab[row] = self._known[int(plane)]
        mark = np.zeros(shape, np.uint8)
        kernels.mark_points(
            len(coords), coords, first, self._local, *self.grid.planes[1:], mark
        )  # fmt: skip
        self._evaluate(real, mark)
        ends = {int(p): self._slab[np.searchsorted(real, p)].copy() for p in planes[[0, -1]]}
        if self.grid.wrap[0] and not self._known:
            self._pinned = ends
        self._known = self._pinned | ends

    def _evaluate(self, planes: IntArray, mark: AnyArray) -> None:
        """Values at the marked points of the slab that are not known."""
        mark *= np.isnan(self._slab)
        x, y, z = self.grid.axes
        if owns(self.field, "grid") and self.scale is None:
            for row in np.flatnonzero(mark.mean(axis=(1, 2)) > DENSE):
                at = mark[row] == 1
                axes = (x[planes[row]][None], y, z)
                values = np.asarray(asked("grid of the field", self.field.grid, axes))[0]
                self._slab[row][at] = _checked(values[at], "field") - self.middle
                mark[row] = 0
        wanted = np.flatnonzero(mark)
        flat = self._slab.reshape(-1)
        for i in range(0, len(wanted), POINTS):
            at = wanted[i : i + POINTS]
            ix, iy, iz = np.unravel_index(at, self._slab.shape)
            points = np.stack((x[planes[ix]], y[iy], z[iz]), axis=1)
            flat[at] = self.values(points)

    def fill(self, coords: IntArray, samples: AnyArray) -> None:
        """Samples of blocks of the slab."""
        places = self._local, *self.grid.planes[1:]
        kernels.gather(len(coords), self._slab, coords, self._first, *places, samples)


class ProgramSampler(Sampler):
    """A `Node` without fields from elsewhere: the program that each block needs, on its grid."""

    def __init__(self, field: Node, grid: Grid, level: tuple[float, float]) -> None:
        super().__init__(field, grid, level, None)
        self._planes = [grid.axes[a][grid.planes[a]] for a in range(3)]

    def active(self, first: int, last: int) -> AnyArray:
        """From large boxes down to blocks, each with the program that it needs."""
        spans = (np.arange(first, last), *(np.arange(n) for n in self.grid.blocks[1:]))
        ends = [np.stack(self.grid.box_ends(a, s, s), axis=1) for a, s in enumerate(spans)]
        slack = 1e-8 * (1.0 + abs(self.middle))
        lower = -np.inf if np.isnan(self.lower) else self.middle + float(self.lower) + slack
        upper = self.middle + float(self.upper) - slack
        low, high = self.field.program.block_bounds(ends, lower, upper)
        return self.crossed(low - self.middle, high - self.middle, self._near_faces(spans))

    def fill(self, coords: IntArray, samples: AnyArray) -> None:
        """Samples of blocks."""
        self.field.program.fill(self._planes, coords, self.middle, samples)
        if np.isnan(samples).any():
            block = coords[int(np.argmax(np.isnan(samples).any(axis=(1, 2, 3))))]
            near = [t[B * i] for t, i in zip(self._planes, block[[3, 1, 2]], strict=True)]
            raise GeometryError(f"field is NaN near {near}")


class TrigSampler(Sampler):
    """A `TrigField`, from tables of its factors along the axes."""

    def __init__(self, field: TrigField, grid: Grid, level: tuple[float, float]) -> None:
        super().__init__(field, grid, level, None)
        coef = np.append(field.coef, -self.middle)
        factor = np.vstack((field.factor, np.zeros((1, 3), np.int64)))
        order = np.argsort(factor[:, 2], kind="stable")
        self._coef = coef[order]
        used = [np.unique(factor[:, a], return_inverse=True) for a in range(3)]
        self._code = np.stack([u[1][order] for u in used], axis=1).astype(np.int64)
        self._factors = [u[0] for u in used]
        self._tables = [self._table(a).astype(np.float32) for a in range(3)]
        self._single = self._coef.astype(np.float32)
        self.rounding = SINGLE * float(np.abs(coef).sum())

    def _table(self, axis: int) -> FloatArray:
        turns = self.grid.axes[axis] / self.field.period[axis]
        turns -= np.rint(turns)
        angle = 2.0 * np.pi * turns * ((self._factors[axis] + 1) // 2)[:, None]
        sine = (self._factors[axis] % 2 == 0) & (self._factors[axis] > 0)
        table = np.where(sine[:, None], np.sin(angle), np.cos(angle))
        return np.ascontiguousarray(table[:, self.grid.planes[axis]])

    def active(self, first: int, last: int) -> AnyArray:
        """Bounds of the factors along the axes, then interval arithmetic on the tensor grid.

        A twentieth of the time of `TrigField.range`, whose bounds are a fifth narrower.
        """
        spans = (np.arange(first, last), *(np.arange(n) for n in self.grid.blocks[1:]))
        intervals = [self._intervals(a, spans[a]) for a in range(3)]
        shape = tuple(len(s) for s in spans)
        low, high = np.empty(shape), np.empty(shape)
        columns = low.shape[0] * low.shape[1]
        kernels.ranges_trig(columns, self._coef, self._code, *intervals, low, high)
        return self.crossed(low, high, self._near_faces(spans))

    def _intervals(self, axis: int, blocks: IntArray) -> FloatArray:
        """Range of each factor on each block of an axis, (factors, blocks, 2)."""
        a, b = self.grid.box_ends(axis, blocks, blocks)
        code = self._factors[axis][:, None]
        h = (code + 1) // 2
        shift = np.where((code % 2 == 0) & (code > 0), 0.25, 0.0)  # sin x = cos(x - pi / 2)
        u = h * (a / self.field.period[axis]) - shift
        v = h * (b / self.field.period[axis]) - shift
        ends = np.cos(2.0 * np.pi * np.stack((u, v)))
        low = np.where(np.floor(v - 0.5) >= np.ceil(u - 0.5), -1.0, ends.min(axis=0))
        high = np.where(np.floor(v) >= np.ceil(u), 1.0, ends.max(axis=0))
        return np.stack((low, high), axis=-1)

    def fill(self, coords: IntArray, samples: AnyArray) -> None:
        """Samples of blocks."""
        kernels.fill_trig(len(coords), self._single, self._code, *self._tables, coords, samples)


class SplineSampler(Sampler):
    """A scalar B-spline, divided by another one where there is a scale."""

    def __init__(self, field: BSpline, grid: Grid, level: tuple[float, float], scale: Any) -> None:
        super().__init__(field, grid, level, scale)
        self._tables = [_spline_tables(f, grid) for f in (field, scale) if f is not None]
        self._hulls = [_spline_hull(t, grid) for t in self._tables]
        self._buffer = np.empty((0, S, S, LANES), np.float32)
        least = 1.0 if scale is None else float(np.min(scale.c))
        self.rounding = SINGLE * (float(np.abs(field.c).max()) / least + abs(self.middle))

    def active(self, first: int, last: int) -> AnyArray:
        """From the coefficients that act on each block: far cheaper than the tighter `range`."""
        bounds = [
            _hull_of_layers(t, h, first, last)
            for t, h in zip(self._tables, self._hulls, strict=True)
        ]
        low, high = bounds[0] if len(bounds) == 1 else _quotient_range(*bounds)
        spans = (np.arange(first, last), *(np.arange(n) for n in self.grid.blocks[1:]))
        return self.crossed(low - self.middle, high - self.middle, self._near_faces(spans))

    def fill(self, coords: IntArray, samples: AnyArray) -> None:
        """Samples of blocks."""
        kernels.fill_spline(len(coords), *self._tables[0], coords, samples)
        if len(self._tables) == 2:
            if len(self._buffer) < len(samples):
                self._buffer = np.empty_like(samples)
            divisor = self._buffer[: len(samples)]
            kernels.fill_spline(len(coords), *self._tables[1], coords, divisor)
            kernels.divide(len(samples), samples, divisor)
        if self.middle != 0.0:
            samples -= np.float32(self.middle)


def sampler_for(field: Any, grid: Grid, level: tuple[float, float], scale: Any) -> Sampler:
    """The fastest sampler that reads `field` and `scale`."""
    if isinstance(field, Node) and field.polynomial is not None:
        field = field.polynomial
    if isinstance(field, TrigField) and field.linear is None and scale is None:
        return TrigSampler(field, grid, level)
    if isinstance(field, Node) and not field.program.leaves and scale is None:
        return ProgramSampler(field, grid, level)
    if _is_plain(field, grid) and (scale is None or _is_plain(scale, grid, positive=True)):
        return SplineSampler(field, grid, level, scale)
    return GridSampler(field, grid, level, scale)


def _is_plain(field: Any, grid: Grid, positive: bool = False) -> bool:
    """Whether a field is a scalar B-spline that `fill_spline` takes."""
    if not isinstance(field, BSpline) or field.ndim != 3 or field.m or field.weights is not None:
        return False
    inside = all(
        field.domain[0, a] <= grid.ends[0, a] and grid.ends[1, a] <= field.domain[1, a]
        for a in range(3)
    )
    closed = all(
        not grid.wrap[a]
        or (field.periodic[a] and np.array_equal(field.domain[:, a], grid.ends[:, a]))
        for a in range(3)
    )
    return inside and closed and (not positive or bool((field.c > 0).all()))


def _spline_tables(s: BSpline, grid: Grid) -> tuple[AnyArray, ...]:
    """Coefficients, basis functions and their places at the padded samples."""
    c = s.c
    out: list[AnyArray] = []
    for a in range(3):
        basis, start = _basis(s, a, grid.axes[a])
        basis, start = basis[grid.planes[a]], start[grid.planes[a]]
        if grid.wrap[a]:  # the last plane is the first one, one turn later
            start[len(grid.axes[a]) - 1 :] = s.shape[a] - s.k[a]
            c = np.concatenate((c, np.take(c, [s.k[a]], axis=a)), axis=a)
        out += [basis.astype(np.float32), start]
    out[4] = np.ascontiguousarray(out[4].T)
    return np.ascontiguousarray(c, dtype=np.float32), *out


def _windows(args: tuple[AnyArray, ...], axis: int, first: int, last: int) -> IntArray:
    """Range of the coefficients that act on each of the blocks first..last of an axis, (n, 2)."""
    start = args[2 + 2 * axis]
    order = args[1].shape[1] if axis == 0 else args[3].shape[1] if axis == 1 else args[5].shape[0]
    b = B * np.arange(first, last)
    return np.stack((start[b], start[b + B] + order), axis=1)


def _spline_hull(args: tuple[AnyArray, ...], grid: Grid) -> tuple[AnyArray, AnyArray]:
    """Least and largest coefficients that act on each block in y and z, (n0, by, bz) each."""
    low = high = args[0]
    for axis in (2, 1):
        windows = _windows(args, axis, 0, grid.blocks[axis])
        low = np.stack([low.take(range(*w), axis).min(axis) for w in windows], axis)
        high = np.stack([high.take(range(*w), axis).max(axis) for w in windows], axis)
    return low, high


def _hull_of_layers(
    args: tuple[AnyArray, ...], hull: tuple[AnyArray, AnyArray], first: int, last: int
) -> tuple[FloatArray, FloatArray]:
    """Least and largest coefficients that act on each block of some layers."""
    windows = _windows(args, 0, first, last)
    low = np.stack([hull[0][i:j].min(axis=0) for i, j in windows])
    high = np.stack([hull[1][i:j].max(axis=0) for i, j in windows])
    return low.astype(np.float64), high.astype(np.float64)


def _basis(s: BSpline, axis: int, x: FloatArray) -> tuple[FloatArray, IntArray]:
    """Basis functions (n, k + 1) at x and the index of the first of them."""
    t, k = s.t[axis], s.k[axis]
    matrix = SciPyBSpline.design_matrix(x, t, k)
    start = matrix.indices.reshape(len(x), k + 1)[:, 0].astype(np.int64)
    return matrix.data.reshape(len(x), k + 1), start


def _groups(blocks: int) -> IntArray:
    """Spans of `GROUP` blocks."""
    first = np.arange(0, blocks, GROUP)
    return np.stack((first, np.minimum(first + GROUP, blocks)), axis=1)


def _call(field: Callable[[FloatArray], Any], points: FloatArray, name: str) -> FloatArray:
    """Values of a callable, checked."""
    f = as_array(name, asked(name, field, points), finite=False)
    if f.shape != (len(points),):
        raise InputError(
            f"{name} must give {len(points)} values for {len(points)} points, got shape {f.shape}"
        )
    return _checked(f, name, points)


def _checked(f: FloatArray, name: str, points: FloatArray | None = None) -> FloatArray:
    """`f` itself, or `GeometryError` where it is NaN."""
    bad = np.isnan(f)
    if bad.any():
        place = "" if points is None else f" at {points[int(np.argmax(bad))].tolist()}"
        raise GeometryError(f"{name} is NaN{place} ({int(bad.sum())} of {f.size} points there)")
    return f


def _field_range(field: Any, lo: FloatArray, hi: FloatArray) -> FloatArray | None:
    """Bounds (n, 2) from `range` or `lipschitz`, or None."""
    if owns(field, "range"):
        told = "range of the field"
        return as_array(told, asked(told, field.range, lo, hi), finite=False)
    if not owns(field, "lipschitz"):
        return None
    f = _call(field, 0.5 * (lo + hi), "field")
    reach = float(field.lipschitz) * 0.5 * np.linalg.norm(hi - lo, axis=1)
    return np.stack((f - reach, f + reach), axis=1)


def _quotient_range(f: Any, s: Any) -> tuple[FloatArray, FloatArray]:
    """Bounds of f / s from bounds (low, high) of both, for s > 0; loose where s may not be."""
    least = np.maximum(s[0], np.finfo(float).tiny)
    corners = np.stack((f[0] / least, f[0] / s[1], f[1] / least, f[1] / s[1]))
    return corners.min(axis=0), corners.max(axis=0)
