"""Critical points of the distance to a mid-surface: where the topology of a wall changes.

The wall ``dist <= d`` changes its topology where d passes a critical value of the distance on the
domain D: at a point whose nearest feet pull in opposite directions, or, on a face or an edge of D,
in directions that cancel along it while the distance grows inwards. The distance spline tells
where to look: cells in which its gradient may vanish, by rigorous ranges, on D, its faces, edges
and corners. What is found there is solved for with fresh closest points and second derivatives:
equal distances f_i to m feet, and weights l_i >= 0 of sum 1 with sum l_i grad f_i = 0. Voids are
climbed to (`ilattice.offsets.summits`), because their feet may be one, on focal curves. Points on
faces and points next to them give each other away: where the distance falls inwards from a critical
point of a face, the one that counts is beside it. What changes is told by `ilattice.offsets.links`,
on spheres that hold no second point.

Guarantees: no foot is nearer than what is reported; the feet balance to 1e-5, or, in voids, a
further step promises no more than 1e-6 of the distance.
Non-guarantees: completeness, because the spline rounds off the kinks of the distance and events
closer to each other than a fiftieth of its spans are taken for one, or, a void behind a face and
the neck on it, for none; compare Euler numbers, as `ilattice.mesh.topology` does. Necks that close
on focal curves may be missed. Where whole curves or surfaces are critical (parallel planes), what
is reported is meaningless.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.ndimage import maximum_filter
from scipy.spatial import cKDTree

from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray
from ilattice._validate import as_array
from ilattice.bspline import BSpline
from ilattice.errors import InputError
from ilattice.offsets.excess import Excess
from ilattice.offsets.links import Links
from ilattice.offsets.several_feet import Feet, SeveralFeet
from ilattice.offsets.summits import climbed

if TYPE_CHECKING:
    from ilattice.macroshape.lattice import Lattice

#: Steps of Newton's method, and in spans the step at which it ends, the last step of one that
#: converges slowly because curvatures vanish, and how far it may go.
STEPS, STILL, SLOW, FAR = 15, 1e-8, 1e-3, 2.0
#: Parts of the reach within which feet count at first, in one try after the other; the longest
#: step, in spans, and the relative size of slopes and curvatures that are nothing beyond it.
FIRST, LONGEST, ALIKE = (0.3, 0.05), 0.5, 0.03
#: Parts into which spans are cut inside, and on faces and edges.
PIECES = 2, 4
#: How far, in spans, points are clear of faces.
NEAR = 1e-4
#: How far from each other, in spans, points inside and on a face may be that give each other away.
BESIDE = 0.25
#: Relative difference of equal distances.
EQUAL = 1e-6
#: Length of the least pull up to which a start is worth a try, and of a found point.
PULL, BALANCED = 0.35, 1e-5
#: Points nearer than this to each other, in spans, are one.
SAME = 0.02
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
    sides = product(*((0,) if c else (-1, 0, 1) for c in lattice.through.closed))
    strata = sorted(sides, key=np.count_nonzero, reverse=True)
    for on in strata:
        cells = search.starts(on, low, high)
        cells = cells[((cells >= box[0]) & (cells <= box[1])).all(axis=1)]
        starts = np.concatenate([cells, search.beside(found, on)])
        search.add_new(search.search_from(starts, on), found)
    search.add_new(search.voids(box, low, high), found)
    for on in strata[:-1]:
        search.add_new(search.solve(search.beside(found, on), on), found)
    slack = 1e-9 * np.ptp(box, axis=0)
    asked = [
        p
        for p in found
        if low <= p.value <= high
        and (np.abs(2.0 * p.u - box.sum(axis=0)) <= np.ptp(box, axis=0) + slack).all()
    ]
    found = search.judged(asked, found)
    found = [p for p in found if p.closed or (p.parts, p.holes) != (1, 0)]
    return sorted(found, key=lambda p: (p.value, *p.u.tolist()))


class _Search:
    """Where critical points may be, and Newton's method for them."""

    def __init__(self, lattice: Lattice, inner: BSpline | None, outer: BSpline | None) -> None:
        self.lattice = lattice
        self.excess = Excess(lattice, inner, outer)
        self.feet = SeveralFeet(self.excess)
        self.link = Links(self.excess, self.feet)
        self.domain, self.span = self.excess.domain, self.excess.span
        self.slopes = [self.excess.spline.derivative(a) for a in range(3)]

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

    def beside(self, points: list[CriticalPoint], on: tuple[int, ...]) -> FloatArray:
        """Places on a face, an edge or inside next to points that are found on others, (n, 3)."""
        ends = np.where(np.array(on) < 0, *self.domain)
        found = [np.where(np.array(on) == 0, p.u, ends) for p in points if p.on != on]
        u = np.array([p.u for p in points if p.on != on]).reshape(-1, 3)
        out = np.array(found).reshape(-1, 3)
        near = (np.abs(out - u) < BESIDE * self.span).all(axis=1)
        return out[near]

    def voids(self, box: FloatArray, low: float, high: float) -> list[CriticalPoint]:
        """Places in a box where the value is greatest nearby: climbs from the highest cells."""
        excess = self.excess
        middles = [0.5 * (b[:-1] + b[1:]) for b in excess.breaks]
        u = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1)
        shape, u = u.shape[:3], u.reshape(-1, 3)
        height = excess.on_spline(u)[0]
        modes: list[Any] = ["wrap" if c else "nearest" for c in excess.closed]
        top = height == maximum_filter(height.reshape(shape), 3, mode=modes).ravel()
        slack = np.linalg.norm(excess.sizes(u) * self.span, axis=1)
        top &= (height >= low - slack) & (height <= high + slack)
        u = u[top & (u >= box[0]).all(axis=1) & (u <= box[1]).all(axis=1)]
        u, value = climbed(excess, u)
        off = self._off_faces(u, (0, 0, 0), SAME)
        u, value = u[off], value[off]
        feet = np.array([f.nearest.sum() for f in self.feet(u)], np.int64)
        return self.solve(u, (0, 0, 0)) + self._points(u, value, (0, 0, 0), feet)

    def _worth_a_try(self, u: FloatArray, on: tuple[int, ...]) -> FloatArray:
        """Those points at which the feet almost balance."""
        pull = [self._pull(feet, on)[1] if len(feet.value) else np.inf for feet in self.feet(u)]
        return u[np.array(pull) < PULL]

    def _on_spline(self, u: FloatArray, on: tuple[int, ...]) -> FloatArray:
        """Critical points of the distance spline near starts, each once."""
        free = np.flatnonzero(np.array(on) == 0)
        if not len(u) or not len(free):
            return u[:0]
        lo, hi = self.domain
        now = u.copy()
        for _ in range(4):
            _, g, h = self.excess.on_spline(now, 2)
            h = h[np.ix_(np.arange(len(u)), free, free)]
            step = -(np.linalg.pinv(h, rcond=1e-3) @ g[:, free, None])[:, :, 0]
            now[:, free] += np.clip(step, -0.5 * self.span[free], 0.5 * self.span[free])
            now = np.clip(self.excess.wrapped(now), lo, hi)
        now = now[(self.excess.apart(now, u) < 1.5 * self.span).all(axis=1)]
        _, first = np.unique(np.rint(now / (0.1 * self.span)), axis=0, return_index=True)
        return now[np.sort(first)]

    def _boxes(self, on: tuple[int, ...]) -> list[tuple[FloatArray, FloatArray]]:
        """Cells of the distance spline, those on a face without thickness, in chunks."""
        ends = []
        pieces = PIECES[any(on)]
        for a, b in enumerate(self.excess.breaks):
            edge = b[:1] if on[a] < 0 else b[-1:]
            b = np.interp(np.arange(pieces * (len(b) - 1) + 1) / pieces, np.arange(len(b)), b)
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
        """Add those points that differ from all known ones."""
        for point in points:
            span = self.excess.least_span(point.u)
            if all(
                np.linalg.norm(point.x - k.x) > (SAME if k.on == point.on else NEAR) * span
                for k in known
            ):
                known.append(point)

    def judged(
        self, points: list[CriticalPoint], among: list[CriticalPoint]
    ) -> list[CriticalPoint]:
        """Points with what changes there, seen on spheres that hold no other of those found."""
        if not points:
            return []
        tree = cKDTree(np.array([p.x for p in among]))
        gap = np.asarray(tree.query(np.array([p.x for p in points]), 2)[0])[:, 1]
        out = []
        for point, apart in zip(points, gap.tolist(), strict=True):
            size = self.excess.sizes(point.u[None])[0]
            room = np.minimum(point.u - self.domain[0], self.domain[1] - point.u) * size
            room = room[(np.array(point.on) == 0) & ~self.excess.closed]
            radius = min(0.4 * apart, 0.5 * float(room.min(initial=np.inf)))
            parts, holes, closed = self.link(point.u, point.value, point.side, point.on, radius)
            out.append(replace(point, parts=parts, holes=holes, closed=closed))
        return self._without_pairs(out)

    def _without_pairs(self, points: list[CriticalPoint]) -> list[CriticalPoint]:
        """Points without voids that are next to a face, and the necks on it that close them."""
        gone = set()
        for i, void in enumerate(points):
            room = np.stack([void.u - self.domain[0], self.domain[1] - void.u]) / self.span
            room[:, self.excess.closed] = np.inf
            if void.closed and room.min() < SAME:
                end, axis = np.unravel_index(room.argmin(), room.shape)
                least = 2.0 * SAME * self.excess.least_span(void.u)
                necks = [
                    (float(np.linalg.norm(p.x - void.x)), k)
                    for k, p in enumerate(points)
                    if p.on[axis] == 2 * end - 1 and p.change == 1
                ]
                gone.add(i)
                gone |= {k for gap, k in sorted(necks)[:1] if gap < least}
        return [p for i, p in enumerate(points) if i not in gone]

    def _may_balance(
        self, lo: FloatArray, hi: FloatArray, on: tuple[int, ...], low: AnyArray, high: AnyArray
    ) -> IntArray:
        """Boxes with a value between the bounds whose free slopes may vanish."""
        bound = self.excess.spline.range(lo, hi)
        keep = np.zeros(len(lo), np.bool_)
        for side in (-1, 1):
            value = side * bound[:, ::side]
            less = self.excess.less[side]
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

    # ---------------------------------------------------------------- balance

    def _pull(
        self, feet: Feet, on: tuple[int, ...], sharp: float = 1.0
    ) -> tuple[FloatArray, float]:
        """Weights of feet, and the length of their common pull along D, a face or an edge.

        Feet that are later than the nearest count less, and not at all beyond `sharp` x reach.
        """
        from scipy.optimize import nnls  # 10 MB that meshing does without

        slopes = (feet.gradient / feet.size)[:, np.array(on) == 0]
        later = (feet.value - feet.value.min()) / (sharp * feet.reach)
        a = np.vstack([slopes.T, later, np.full(len(later), HEAVY)])
        a[:-1, later > 1.0] = HEAVY
        weights, _ = nnls(a, np.append(np.zeros(len(a) - 1), HEAVY))
        return weights, float(np.linalg.norm(weights @ slopes))

    def solve(self, start: FloatArray, on: tuple[int, ...]) -> list[CriticalPoint]:
        """Newton's method from starts (n, 3); the critical points in which they end.

        What fails with all feet about a start is tried again with the very nearest ones only.
        """
        if on.count(0) == 0:
            return self._checked(start, on, NEAR)
        out = []
        for first in FIRST:
            u, size = self._iterate(start, on, first)
            out += self._checked(u[size < STILL], on, NEAR)
            out += self._checked(u[(size >= STILL) & (size < SLOW)], on, SLOW)
            start = start[size >= SLOW]
        return out

    def _iterate(
        self, start: FloatArray, on: tuple[int, ...], first: float
    ) -> tuple[FloatArray, FloatArray]:
        """Places (n, 3) in which Newton's method from starts ends, and the last step, in spans."""
        free = np.flatnonzero(np.array(on) == 0)
        u, live, last = start.copy(), np.arange(len(start)), np.full(len(start), np.inf)
        lo, hi = self.domain
        slack = 1e-9 * self.span
        sharp = np.full(len(start), first)
        for _ in range(STEPS):
            size = np.full(len(live), np.inf)
            for i, feet in enumerate(self.feet(u[live])):
                if len(feet.value):
                    weights, _ = self._pull(feet, on, float(sharp[live[i]]))
                    active = np.flatnonzero(weights > LIGHT)
                    step = _newton(feet, active, free, weights, self.span)
                    size[i] = np.abs(step).max()
                    step *= self.span[free] * min(1.0, LONGEST / max(size[i], 1e-300))
                    u[live[i], free] += step
            sharp[live] = np.clip(2.0 * size, 1e-3, first)
            far = self.excess.apart(u[live], start[live]) > FAR * self.span
            u[live] = self.excess.wrapped(u[live])
            lost = far.any(axis=1) | np.isinf(size)
            lost |= ((u[live] < lo - slack) | (u[live] > hi + slack)).any(axis=1)
            u[live] = np.where(lost[:, None], start[live], np.clip(u[live], lo, hi))
            last[live] = np.where(lost, np.inf, size)
            live = live[(size >= STILL) & ~lost]
        return u, last

    def _checked(self, u: FloatArray, on: tuple[int, ...], room: float) -> list[CriticalPoint]:
        """Those points in which the feet balance, and to which no foot is nearer."""
        u = u[self._off_faces(u, on, room)]
        least = np.abs(self.lattice.distance(u))
        value = least - self.excess.taken(u, self.excess.side(u))[0]
        count = np.zeros(len(u), np.int64)
        for i, feet in enumerate(self.feet(u)):
            slack = EQUAL * least[i]
            if abs(feet.value.min(initial=np.inf) - value[i]) > slack:
                continue
            equal = feet.value <= value[i] + slack
            feet = feet._replace(
                value=feet.value[equal], gradient=feet.gradient[equal], hessian=feet.hessian[equal]
            )
            if self._pull(feet, on)[1] < BALANCED:
                count[i] = equal.sum()
        good = np.flatnonzero(count)
        return self._points(u[good], value[good], on, count[good])

    def _points(
        self, u: FloatArray, value: FloatArray, on: tuple[int, ...], feet: IntArray
    ) -> list[CriticalPoint]:
        """Points at parameters (n, 3), with their values and numbers of feet."""
        place = (on[0], on[1], on[2])
        rows = zip(
            value.tolist(), u, self.lattice.through.x(u), self.excess.side(u).tolist(),
            feet.tolist(), strict=True,
        )  # fmt: skip
        return [CriticalPoint(*row, place) for row in rows]

    def _off_faces(self, u: FloatArray, on: tuple[int, ...], least: float) -> AnyArray:
        """Which points are clear of other faces: those on them are found there."""
        room = np.minimum(u - self.domain[0], self.domain[1] - u) / self.span
        inner = (np.array(on) == 0) & ~self.excess.closed
        return np.asarray((room[:, inner] > least).all(axis=1))


def _newton(
    feet: Feet, active: IntArray, free: IntArray, weights: FloatArray, span: FloatArray
) -> FloatArray:
    """Step, in spans, in the free coordinates onto equal distances and balanced pulls of feet.

    Where that is far, distances that differ by little along the domain need not become equal.
    """
    m, k = len(active), len(free)
    scale = span[free]
    g = feet.gradient[active][:, free] * scale / feet.reach
    f = feet.value[active] / feet.reach
    w = weights[active] / weights[active].sum()
    h = np.einsum("n,nab->ab", w, feet.hessian[active])[np.ix_(free, free)]
    r = float(w @ f)
    system = np.zeros((m + k + 1, k + 1 + m))
    system[:m, :k], system[:m, k] = g, -1.0
    system[m : m + k, :k], system[m : m + k, k + 1 :] = h * np.outer(scale, scale) / feet.reach, g.T
    system[-1, k + 1 :] = 1.0
    miss = np.concatenate([f - r, w @ g, [0.0]])
    step: FloatArray = np.linalg.lstsq(system, -miss, rcond=1e-12)[0][:k]
    if np.abs(step).max() > LONGEST:
        step = np.linalg.lstsq(system, -miss, rcond=ALIKE)[0][:k]
    return step
