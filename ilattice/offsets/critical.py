"""Critical points of the distance to a mid-surface: where the topology of a wall changes.

The wall ``dist <= d`` changes its topology where d passes a critical value of the distance on the
domain D: at a point whose nearest feet pull in opposite directions, or, on a face or an edge of D,
in directions that cancel along it while the distance grows inwards. The distance spline tells
where to look: cells in which its gradient may vanish, by rigorous ranges, on D, its faces, edges
and corners. What is found there is solved for with fresh closest points and second derivatives:
equal distances f_i to m feet, and weights l_i >= 0 of sum 1 with sum l_i grad f_i = 0.

What changes is read off the distance on a small sphere about the point, flattened and bent along
the sheet on which its feet are equally near, so that degenerate points (monkey saddles, points on
mirror planes) count right, and necks are not taken for voids.

Guarantees: at what is reported the feet balance to 1e-5, and no foot is nearer.
Non-guarantees: completeness, because the spline rounds off the kinks of the distance and events
much closer to each other than its spans may be taken for one; compare Euler numbers, as
`ilattice.mesh.topology` does. Missed are voids that close on focal curves of the mid-surface,
where feet become one: those of bent gyroids. Where whole curves or surfaces are critical (parallel
planes), what is reported is meaningless.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise, product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter
from scipy.optimize import nnls
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray
from ilattice._validate import as_array
from ilattice.bspline import BSpline
from ilattice.errors import InputError
from ilattice.offsets import _kernels_newton

if TYPE_CHECKING:
    from ilattice.macroshape.lattice import Lattice

#: Steps of Newton's method, and in spans the step at which it ends, the last step of one that
#: converges slowly because curvatures vanish, and how far it may go.
STEPS, STILL, SLOW, FAR = 15, 1e-8, 1e-3, 4.0
#: Feet whose distances differ by less than this, relative to the size of a span, may be one set.
NEARLY, EQUAL = 1.2, 1e-6
#: Length of the least pull up to which a start is worth a try, and of a found point.
PULL, BALANCED = 0.35, 1e-5
#: Segments per edge of the octahedron whose sphere shows what changes; its radius in spans.
LINK, RADIUS = 12, 0.2
#: Part of its radius to which the sphere is flattened across the sheet of equal distances, and
#: least slope across it of the distances to the feet.
FLAT, STEEP = 0.2, 0.05
#: Points nearer than this to each other, in spans, are one.
SAME = 0.02
MOST_SEEDS = 64
#: Rounds of climbing to where the distance is greatest, and tries in each.
CLIMBS, WAYS = 40, 48
#: Weight of the condition that weights sum to 1; weights below which feet play no part.
HEAVY, LIGHT = 1e3, 1e-3
CHUNK = 1 << 16


@dataclass(frozen=True)
class CriticalPoint:
    """A place where the wall ``dist <= d`` changes its topology.

    What changes is told by the directions in which the distance falls, a part of a small sphere
    about the place (inside the domain): none, and a part of the wall appears; all, and a void is
    filled; several, and the wall meets itself; a ring, and a pore is closed.

    Attributes
    ----------
    value : float
        Distance to the mid-surface there (less the half-thickness, if one was given).
    u, x : ndarray, shape (3,)
        Its parameters, and its place in space.
    side : int
        Sign of the implicit function there.
    feet : int
        Number of nearest points of the mid-surface.
    on : tuple of int
        For each direction -1 or 1 on that face of the domain, 0 inside.
    parts, holes : int
        Parts of the directions in which the distance falls, and holes in them.
    closed : bool
        Whether it falls in all directions.
    """

    value: float
    u: FloatArray
    x: FloatArray
    side: int
    feet: int
    on: tuple[int, int, int]
    parts: int = 1
    holes: int = 0
    closed: bool = False

    @property
    def change(self) -> int:
        """By how much the Euler number of the wall jumps as the thickness passes `value`."""
        return 1 - self.parts + self.holes - int(self.closed)

    @property
    def kind(self) -> str:
        """What happens, in a word: ``"part"``, ``"void"``, ``"bridge"`` or ``"neck"``."""
        if self.closed:
            return "void"
        if self.parts == 0:
            return "part"
        return "bridge" if self.parts > 1 else "neck"


class _Feet(NamedTuple):
    """Feet of one point, nearest first: jets in u of the distances to them; lengths at the point.

    `size` (3,) are those of the derivatives of the map, `reach` is about that of a span.
    """

    value: FloatArray
    gradient: FloatArray
    hessian: FloatArray
    size: FloatArray
    reach: float


def critical_points(
    lattice: Lattice,
    low: float,
    high: float,
    *,
    inner: BSpline | None = None,
    outer: BSpline | None = None,
    within: ArrayLike | None = None,
) -> list[CriticalPoint]:
    """Critical points of the distance, or of distance less half-thickness, in a range of values.

    Parameters
    ----------
    lattice : Lattice
        The lattice.
    low, high : float
        Range of the values.
    inner, outer : BSpline, optional
        Half-thickness on the sides where the implicit function is negative and positive, which
        is subtracted from the distance.
    within : array_like, shape (2, 3), optional
        Lower and upper corner of the part of the domain to search, by default all of it.

    Returns
    -------
    list of CriticalPoint
        By increasing value; only those at which a wall changes.

    Raises
    ------
    InputError
        For a lattice with ``boundary="clip"``, or a box upside down.
    """
    if lattice.boundary == "clip":
        raise InputError(
            'critical points need a mid-surface that goes on outside the part: boundary="extend"'
        )
    box = lattice.domain if within is None else as_array("within", within)
    if box.shape != (2, 3) or not (box[0] < box[1]).all():
        raise InputError(f"within must be a lower and an upper corner, got {within!r:.80}")
    search = _Search(lattice, inner, outer)
    found: list[CriticalPoint] = []
    for on in product(*((0,) if c else (-1, 0, 1) for c in lattice.through.closed)):
        cells = search.starts(on, low, high)
        cells = cells[((cells >= box[0]) & (cells <= box[1])).all(axis=1)]
        search.add_new(search.search_from(cells, on), found)
    search.add_new(search.solve(search.summits(box, low, high), (0, 0, 0)), found)
    slack = 1e-9 * np.ptp(box, axis=0)
    found = [
        p
        for p in found
        if low <= p.value <= high
        and (np.abs(2.0 * p.u - box.sum(axis=0)) <= np.ptp(box, axis=0) + slack).all()
    ]
    found = [p for p in found if p.closed or (p.parts, p.holes) != (1, 0)]
    return sorted(found, key=lambda p: (p.value, *p.u.tolist()))


class _Search:
    """Where critical points may be, and Newton's method for them."""

    def __init__(self, lattice: Lattice, inner: BSpline | None, outer: BSpline | None) -> None:
        from ilattice.offsets.distance_spline import distance_spline

        self.lattice, self.search = lattice, lattice.search
        self.distance = distance_spline(lattice)
        self.slopes = [self.distance.derivative(a) for a in range(3)]
        self.less = {-1: inner, 1: outer}
        self.domain = lattice.domain
        breaks = [self.distance.breaks(a) for a in range(3)]
        self.breaks = breaks
        self.span = np.array([np.diff(b).max() for b in breaks])

    # ---------------------------------------------------------------- where to look

    def starts(self, on: tuple[int, ...], low: float, high: float) -> FloatArray:
        """Centres of cells to start from, on D (all `on` are 0), a face, edge or corner of it."""
        found = [np.empty((0, 3))]
        for lo, hi in self._boxes(on):
            jacobian = self.lattice.through.jacobian(0.5 * (lo + hi))
            slack = np.linalg.norm(jacobian * self.span, axis=(1, 2))
            keep = self._may_balance(lo, hi, on, low - slack, high + slack)
            found.append(0.5 * (lo[keep] + hi[keep]))
        return np.concatenate(found)

    def search_from(self, cells: FloatArray, on: tuple[int, ...]) -> list[CriticalPoint]:
        """Critical points near centres of cells, also by way of those of the spline."""
        starts = np.concatenate([self._on_spline(cells, on), cells])
        return self.solve(self._worth_a_try(starts, on), on)

    def summits(self, box: FloatArray, low: float, high: float) -> FloatArray:
        """Places in a box where the value is greatest nearby, climbed from the cells' highest.

        Near them feet come and go, so that Newton's method needs a close start.
        """
        middles = [0.5 * (b[:-1] + b[1:]) for b in self.breaks]
        u = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1)
        shape, u = u.shape[:3], u.reshape(-1, 3)
        height = self._value(u, self.distance)
        modes: list[Any] = ["wrap" if c else "nearest" for c in self.lattice.through.closed]
        top = height == maximum_filter(height.reshape(shape), 3, mode=modes).ravel()
        slack = np.linalg.norm(self.lattice.through.jacobian(u) * self.span, axis=(1, 2))
        top &= (height >= low - slack) & (height <= high + slack)
        u = u[top & (u >= box[0]).all(axis=1) & (u <= box[1]).all(axis=1)]
        best, step = self._value(u, self.lattice.distance), np.full(len(u), 0.5)
        rng = np.random.default_rng(0)
        for _ in range(CLIMBS if len(u) else 0):
            way = rng.normal(size=(len(u), WAYS, 3))
            way *= step[:, None, None] / np.linalg.norm(way, axis=2, keepdims=True)
            there = np.clip(self._wrapped(u[:, None] + way * self.span), *self.domain)
            value = self._value(there.reshape(-1, 3), self.lattice.distance).reshape(len(u), WAYS)
            k = value.argmax(axis=1)
            higher = value.max(axis=1) > best
            u = np.where(higher[:, None], there[np.arange(len(u)), k], u)
            best = np.maximum(best, value.max(axis=1))
            step[~higher] *= 0.6
        return u

    def _value(self, u: FloatArray, distance: Any) -> FloatArray:
        """Distance less the half-thickness of the side."""
        side = self._side(u)
        less = np.where(side > 0, self._less(u, 1), self._less(u, -1))
        value: FloatArray = np.abs(distance(u)) - less
        return value

    def _worth_a_try(self, u: FloatArray, on: tuple[int, ...]) -> FloatArray:
        """Those points at which the feet almost balance."""
        pull = [self._pull(feet, on)[1] if len(feet.value) else np.inf for feet in self._feet(u)]
        return u[np.array(pull) < PULL]

    def _on_spline(self, u: FloatArray, on: tuple[int, ...]) -> FloatArray:
        """Critical points of the distance spline near starts, each once."""
        free = np.flatnonzero(np.array(on) == 0)
        if not len(u) or not len(free):
            return u[:0]
        lo, hi = self.domain
        now = u.copy()
        for _ in range(4):
            _, g, h = self.distance.jet(now, 2)
            for sign, less in self.less.items():
                if less is not None:
                    at = np.flatnonzero(self._side(now) == sign)
                    _, slope, bend = less.jet(now[at], 2)
                    g[at], h[at] = g[at] - sign * slope, h[at] - sign * bend
            h = h[np.ix_(np.arange(len(u)), free, free)]
            step = -(np.linalg.pinv(h, rcond=1e-3) @ g[:, free, None])[:, :, 0]
            now[:, free] += np.clip(step, -0.5 * self.span[free], 0.5 * self.span[free])
            now = np.clip(self._wrapped(now), lo, hi)
        now = now[(self._apart(now, u) < 1.5 * self.span).all(axis=1)]
        _, first = np.unique(np.rint(now / (0.1 * self.span)), axis=0, return_index=True)
        return now[np.sort(first)]

    def _boxes(self, on: tuple[int, ...]) -> list[tuple[FloatArray, FloatArray]]:
        """Cells of the distance spline, those on a face without thickness, in chunks."""
        ends = []
        for a, b in enumerate(self.breaks):
            edge = b[:1] if on[a] < 0 else b[-1:]
            ends.append((b[:-1], b[1:]) if on[a] == 0 else (edge, edge))
        shape = [len(e[0]) for e in ends]
        out = []
        total = int(np.prod(shape))
        for first in range(0, total, CHUNK):
            index = np.unravel_index(np.arange(first, min(first + CHUNK, total)), shape)
            lo = np.stack([e[0][i] for e, i in zip(ends, index, strict=True)], axis=1)
            hi = np.stack([e[1][i] for e, i in zip(ends, index, strict=True)], axis=1)
            out.append((lo, hi))
        return out

    def add_new(self, points: list[CriticalPoint], known: list[CriticalPoint]) -> None:
        """Add those points that differ from all known ones, with what changes there."""
        for point in points:
            least = SAME * self._least_span(point.u)
            if all(np.linalg.norm(point.x - k.x) > least for k in known):
                parts, holes, closed = self._link(point)
                known.append(replace(point, parts=parts, holes=holes, closed=closed))

    def _least_span(self, u: FloatArray) -> float:
        size = np.linalg.norm(self.lattice.through.jacobian(u[None])[0], axis=0)
        return float((size * self.span).min())

    def _may_balance(
        self, lo: FloatArray, hi: FloatArray, on: tuple[int, ...], low: AnyArray, high: AnyArray
    ) -> IntArray:
        """Boxes with a value between the bounds whose free slopes may vanish."""
        bound = self.distance.range(lo, hi)
        keep = np.zeros(len(lo), np.bool_)
        for side in (-1, 1):
            value = side * bound[:, ::side]
            less = self.less[side]
            if less is not None:
                d = less.range(lo, hi)
                value = value - d[:, ::-1]
            good = (
                (value[:, 1] >= low) & (value[:, 0] <= high) & (side * bound[:, ::side][:, 1] > 0)
            )
            for a in range(3):
                if on[a] == 0:
                    slope = self.slopes[a].range(lo, hi)
                    if less is not None and less.c.size > 1:
                        slope = slope - side * less.derivative(a).range(lo, hi)[:, ::-side]
                    good &= (slope[:, 0] <= 0.0) & (slope[:, 1] >= 0.0)
            keep |= good
        return np.flatnonzero(keep)

    # ---------------------------------------------------------------- feet

    def _feet(self, u: FloatArray) -> list[_Feet]:
        """For each point the feet that are about as near as the nearest, with jets."""
        if not len(u):
            return []
        x, jacobian = self.lattice.through.jet(u, 1)
        size = np.linalg.norm(jacobian, axis=1)
        reach = NEARLY * np.linalg.norm(size * self.span, axis=1)
        seeds = self._seeds(x, reach)
        owner = np.repeat(np.arange(len(u)), [len(s) for s in seeds])
        seed = np.concatenate(seeds)
        n = len(seed)
        feet, counts = np.full((2, n, 8), np.nan), np.zeros((n, 2), np.int64)
        status = np.full(n, _kernels_newton.FALLBACK, np.int64)
        q = self.search.to_tile(u)[owner]
        self.search._run(x[owner], q, seed[:, None].copy(), feet, counts, status)
        d = np.abs(feet[0, :, 6])
        good = np.flatnonzero((status == _kernels_newton.OK) & (d > 1e-9))
        good = good[np.lexsort((d[good], owner[good]))]
        keep = good[_first_ones(owner[good], feet[0, good, 3:6], 1e-5 * d[good])]
        value, gradient, hessian = self._jets(
            u, owner[keep], feet[0, keep, :3], feet[0, keep, 3:6], d[keep]
        )
        ends = np.searchsorted(owner[keep], np.arange(len(u) + 1))
        return [
            _Feet(value[i:j], gradient[i:j], hessian[i:j], size[k], float(reach[k]))
            for k, (i, j) in enumerate(pairwise(ends))
        ]

    def _seeds(self, x: FloatArray, reach: FloatArray) -> list[IntArray]:
        """For each point seeds not further than the nearest one and `reach` and two spacings."""
        sx, spacing = self.search.seeds[1], self.search.seeds[3]
        nearest, first = self.search.tree.query(x)
        size = spacing[first]
        near = self.search.tree.query_ball_point(x, nearest + reach + 2.0 * size)
        return [_spread(np.array(v), sx, x[i], 1.5 * size[i]) for i, v in enumerate(near)]

    def _jets(
        self, u: FloatArray, owner: IntArray, p: FloatArray, foot: FloatArray, d: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:  # fmt: skip
        """Distances to feet as functions of u, less the half-thickness if there is one."""
        x, jacobian, bend = (a[owner] for a in self.lattice.through.jet(u, 2))
        normal = (x - foot) / d[:, None]
        gradient = np.einsum("nc,nca->na", normal, jacobian)
        inner = np.eye(3) - normal[:, :, None] * normal[:, None, :]
        inner = (inner - self._foot_motion(p, foot - x)) / d[:, None, None]
        hessian = np.einsum("nca,ncd,ndb->nab", jacobian, inner, jacobian)
        hessian += np.einsum("nc,ncab->nab", normal, bend)
        value = d.copy()
        side = self._side(u)[owner]
        for sign, less in self.less.items():
            at = np.flatnonzero(side == sign)
            if less is not None and len(at):
                v, g, h = less.jet(u[owner[at]], 2)
                value[at], gradient[at], hessian[at] = (
                    value[at] - v, gradient[at] - g, hessian[at] - h,
                )  # fmt: skip
        return value, gradient, hessian

    def _foot_motion(self, p: FloatArray, r: FloatArray) -> FloatArray:
        """Derivatives (n, 3, 3) of feet with respect to the point, from r = foot - point."""
        lattice = self.lattice
        u = self.search.from_tile(p)
        lo, hi = self.domain
        u = np.where(lattice.through.closed, lo + np.mod(u - lo, hi - lo), u)
        _, jacobian, bend = lattice.through.jet(u, 2, extrapolate="extend")
        step = self.search.step
        jacobian, bend = jacobian * step, bend * step * step[:, None]
        _, g, h = lattice.smooth_tile.jet(p - np.floor(p), 2)
        pull = np.einsum("nca,nc->na", jacobian, r)
        weight = -(pull * g).sum(axis=1) / (g * g).sum(axis=1)
        system = np.zeros((len(p), 4, 4))
        system[:, :3, :3] = (
            np.einsum("nca,ncb->nab", jacobian, jacobian)
            + np.einsum("nc,ncab->nab", r, bend)
            + weight[:, None, None] * h
        )
        system[:, :3, 3] = system[:, 3, :3] = g
        right = np.zeros((len(p), 4, 3))
        right[:, :3] = jacobian.transpose(0, 2, 1)
        out: FloatArray = jacobian @ (np.linalg.pinv(system) @ right)[:, :3]
        return out

    def _side(self, u: FloatArray) -> IntArray:
        return np.where(self.lattice.implicit(u) >= 0.0, 1, -1)

    # ---------------------------------------------------------------- balance

    def _pull(
        self, feet: _Feet, on: tuple[int, ...], sharp: float = 1.0
    ) -> tuple[FloatArray, float]:
        """Weights of feet, and the length of their common pull along D, a face or an edge.

        Feet that are later than the nearest count less, and not at all beyond `sharp` x reach.
        """
        slopes = (feet.gradient / feet.size)[:, np.array(on) == 0]
        later = (feet.value - feet.value.min()) / (sharp * feet.reach)
        a = np.vstack([slopes.T, later, np.full(len(later), HEAVY)])
        a[:-1, later > 1.0] = HEAVY
        weights, _ = nnls(a, np.append(np.zeros(len(a) - 1), HEAVY))
        return weights, float(np.linalg.norm(weights @ slopes))

    def solve(self, start: FloatArray, on: tuple[int, ...]) -> list[CriticalPoint]:
        """Newton's method from starts (n, 3); the critical points in which they end."""
        free = np.flatnonzero(np.array(on) == 0)
        u, live = start.copy(), np.arange(len(start) if len(free) else 0)
        ended = np.full(len(start), not len(free))
        lo, hi = self.domain
        slack = 1e-9 * self.span
        sharp = np.ones(len(start))
        for step_number in range(STEPS):
            size = np.full(len(live), np.inf)
            for i, feet in enumerate(self._feet(u[live])):
                if len(feet.value):
                    weights, _ = self._pull(feet, on, float(sharp[live[i]]))
                    step = _newton(feet, np.flatnonzero(weights > LIGHT), free, weights)
                    size[i] = np.abs(step / self.span[free]).max()
                    u[live[i], free] += step * min(1.0, 1.0 / max(size[i], 1e-300))
            sharp[live] = np.clip(2.0 * size, 1e-3, 1.0)
            lost = (self._apart(u[live], start[live]) > FAR * self.span).any(axis=1) | np.isinf(
                size
            )
            u[live] = self._wrapped(u[live])
            lost |= ((u[live] < lo - slack) | (u[live] > hi + slack)).any(axis=1)
            u[live] = np.where(lost[:, None], start[live], np.clip(u[live], lo, hi))
            ended[live] = (size < (STILL if step_number + 1 < STEPS else SLOW)) & ~lost
            live = live[~ended[live] & ~lost]
        return self._checked(u[ended], on)

    def _checked(self, u: FloatArray, on: tuple[int, ...]) -> list[CriticalPoint]:
        """Those points in which the feet balance, and to which no foot is nearer."""
        lo, hi = self.domain
        inner = (np.array(on) == 0) & ~np.array(self.lattice.through.closed)
        near = np.minimum(u - lo, hi - u) <= 1e-7 * self.span
        u = u[~near[:, inner].any(axis=1)]  # the others are found when that face is searched
        if not len(u):
            return []
        least = np.abs(self.lattice.distance(u))
        x, side = self.lattice.through.x(u), self._side(u)
        out = []
        for i, feet in enumerate(self._feet(u)):
            less = self.less[int(side[i])]
            value = least[i] - (0.0 if less is None else float(less(u[i : i + 1])[0]))
            equal = feet.value <= value + EQUAL * least[i]
            if abs(feet.value.min(initial=np.inf) - value) > EQUAL * least[i]:
                continue
            feet = feet._replace(
                value=feet.value[equal], gradient=feet.gradient[equal], hessian=feet.hessian[equal]
            )
            weights, pull = self._pull(feet, on)
            if pull < BALANCED:
                place = (on[0], on[1], on[2])
                out.append(
                    CriticalPoint(float(value), u[i], x[i], int(side[i]), len(weights), place)
                )
        return out

    # ---------------------------------------------------------------- what changes

    def _link(self, point: CriticalPoint) -> tuple[int, int, bool]:
        """Parts and holes of the directions in which the distance falls; if these are all."""
        corners, triangles = _octahedron(LINK)
        size = np.linalg.norm(self.lattice.through.jacobian(point.u[None])[0], axis=0)
        length = RADIUS * float((size * self.span).min())
        steps, inward = self._around(point, corners * length, size)
        u = np.clip(self._wrapped(point.u + steps[inward] / size), *self.domain)
        value = np.abs(self.lattice.distance(u)) - self._less(u, point.side)
        below = np.zeros(len(corners), np.bool_)
        below[inward] = value < point.value - 1e-9 * length
        if below.all():
            return 1, 0, True
        return *_betti(below, triangles), False

    def _around(
        self, point: CriticalPoint, sphere: FloatArray, size: FloatArray
    ) -> tuple[FloatArray, AnyArray]:
        """Steps, in lengths, from a point to those of a small sphere about it; which point inwards.

        The distance may grow along the sheet on which several feet are equally near, and falls
        steeply beside it. The sphere is turned so that its axes lie in the sheet and across,
        flattened across, and bent as the sheet is.
        """
        feet = self._feet(point.u[None])[0]
        equal = feet.value <= feet.value.min() + EQUAL * (1.0 + point.value)
        slopes, bends = feet.gradient[equal] / size, feet.hessian[equal] / np.outer(size, size)
        free = np.flatnonzero(np.array(point.on) == 0)
        _, spread, axes = np.linalg.svd(slopes[:, free])
        rank = int((spread > STEEP).sum())
        frame = np.zeros((3, 3))
        frame[: len(free), free] = axes
        frame[len(free) :] = np.eye(3)[np.array(point.on) != 0]
        along = sphere @ (frame * (np.arange(3) >= rank)[:, None])
        later = along @ slopes.T + 0.5 * np.einsum("na,fab,nb->nf", along, bends, along)
        meet = np.column_stack([slopes @ frame[:rank].T, -np.ones(len(slopes))])
        onto = -(later @ np.linalg.pinv(meet).T)[:, :rank]
        steps = along + (onto + FLAT * sphere[:, :rank]) @ frame[:rank]
        inward = (along * point.on <= 1e-12).all(axis=1)
        return steps, np.asarray(inward)

    def _wrapped(self, u: FloatArray) -> FloatArray:
        lo, hi = self.domain
        return np.where(self.lattice.through.closed, lo + np.mod(u - lo, hi - lo), u)

    def _apart(self, u: FloatArray, v: FloatArray) -> FloatArray:
        """Differences of parameters, the shorter way round in closed directions."""
        gap = np.abs(u - v)
        around = np.abs(self.domain[1] - self.domain[0] - gap)
        return np.where(self.lattice.through.closed, np.minimum(gap, around), gap)

    def _less(self, u: FloatArray, side: int) -> FloatArray:
        less = self.less[side]
        return np.zeros(len(u)) if less is None else less(u)


@cache
def _octahedron(n: int) -> tuple[FloatArray, IntArray]:
    """Sphere of n**2 triangles per octant: corners (m, 3) and triangles; closed on axis planes."""
    face = [(i, j) for i in range(n) for j in range(n - i)]
    up = np.array([[(i, j), (i + 1, j), (i, j + 1)] for i, j in face])
    down = np.array([[(i + 1, j), (i + 1, j + 1), (i, j + 1)] for i, j in face if i + j < n - 1])
    flat = np.concatenate([up, down])
    whole = np.concatenate([flat, n - flat.sum(axis=2, keepdims=True)], axis=2)
    signs = np.array(list(product((-1, 1), repeat=3)))
    every = (signs[:, None, None] * whole).reshape(-1, 3)
    corners, number = np.unique(every, axis=0, return_inverse=True)
    x = corners.astype(np.float64)
    return x / np.linalg.norm(x, axis=1, keepdims=True), number.reshape(-1, 3)


def _betti(inside: AnyArray, triangles: IntArray) -> tuple[int, int]:
    """Parts, and independent loops, of the marked part of a triangulated piece of a sphere."""
    kept = triangles[inside[triangles].all(axis=1)]
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    sides = np.unique(sides[inside[sides].all(axis=1)], axis=0)
    n = len(inside)
    graph = coo_array((np.ones(len(sides)), sides.T), shape=(n, n))
    _, label = connected_components(graph, directed=False)
    parts = len(np.unique(label[inside])) if inside.any() else 0
    return parts, parts - (int(inside.sum()) - len(sides) + len(kept))


def _spread(index: IntArray, sx: FloatArray, x: FloatArray, size: float) -> IntArray:
    """Of the seeds in each box of some size the nearest to a point, nearest first, not too many."""
    away = np.linalg.norm(sx[index] - x, axis=1)
    index = index[np.argsort(away, kind="stable")]
    boxes = np.floor((sx[index] - x) / size).astype(np.int64)
    _, first = np.unique(boxes, axis=0, return_index=True)
    return index[np.sort(first)[:MOST_SEEDS]]


def _first_ones(owner: IntArray, place: FloatArray, reach: FloatArray) -> IntArray:
    """Rows without those that repeat an earlier place of the same owner."""
    keep = np.ones(len(owner), np.bool_)
    ends = np.flatnonzero(np.diff(owner, prepend=-1, append=-1))
    for i, j in pairwise(ends):
        gap = np.linalg.norm(place[i:j, None] - place[None, i:j], axis=2)
        same = np.tril(gap < reach[i:j, None], -1)
        for k in np.flatnonzero(same.any(axis=1)):
            keep[i + k] = not (same[k] & keep[i:j]).any()
    return np.flatnonzero(keep)


def _newton(feet: _Feet, active: IntArray, free: IntArray, weights: FloatArray) -> FloatArray:
    """Step in the free coordinates onto equal distances and balanced pulls of the active feet."""
    m, k = len(active), len(free)
    g, f = feet.gradient[active][:, free], feet.value[active]
    w = weights[active] / weights[active].sum()
    h = np.einsum("n,nab->ab", w, feet.hessian[active])[np.ix_(free, free)]
    r = float(w @ f)
    system = np.zeros((m + k + 1, k + 1 + m))
    system[:m, :k], system[:m, k] = g, -1.0
    system[m : m + k, :k], system[m : m + k, k + 1 :] = h, g.T
    system[-1, k + 1 :] = 1.0
    miss = np.concatenate([f - r, w @ g, [0.0]])
    step: FloatArray = np.linalg.lstsq(system, -miss, rcond=1e-12)[0][:k]
    return step
