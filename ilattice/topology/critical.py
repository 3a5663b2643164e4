"""Critical points of the distance to a mid-surface: where the topology of a wall changes.

The wall ``dist <= d`` changes its topology where d passes a critical value of the distance on the
domain D: at a point whose nearest feet pull in opposite directions, or, on a face or an edge of D,
in directions that cancel along it while the distance grows inwards. Windows of a grid in which feet
pull both ways tell where to look (`ilattice.topology.windows`), and what is found there is solved
for with its feet (`ilattice.topology.balance`); ever smaller windows about what was found, and
beside it on faces, tell critical points next to it. What changes is told by the number of feet, and
by how the common distance to them bends along the sheet on which it is common; where that is not
enough, because more feet are near than are needed, or it does not bend, by
`ilattice.topology.links`, on spheres that hold no second point.

Guarantees: no foot is nearer than what is reported; the feet balance to 1e-5.
Non-guarantees: completeness, because feet with shares of the space that are thinner than a cell of
the grid are seen only where windows get smaller; compare Euler numbers, as `ilattice.mesh.regions`
does. Feet on creases, where tiles meet without a zone of transition, are not followed. Where whole
curves or surfaces are critical (parallel planes), one point stands for each
(`ilattice.topology.critical_sets`).
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from ilattice._progress import Progress, track
from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice._validate import as_array
from ilattice.bspline import BSpline
from ilattice.errors import InputError
from ilattice.topology import _kernels_hull
from ilattice.topology.balance import Balance, Ends
from ilattice.topology.clearance import Clearance
from ilattice.topology.critical_point import CriticalPoint
from ilattice.topology.critical_sets import EQUAL, one_of_each
from ilattice.topology.links import Links
from ilattice.topology.several_feet import Feet, SeveralFeet
from ilattice.topology.windows import MAX_FEET, Windows

if TYPE_CHECKING:
    from ilattice.offsets.mid_surface import MidSurface

#: Sizes of the windows about what was found, in those of the grid, one after the other.
CLOSER = (0.5, 0.25)
#: Further ones, about places to which other feet are nearer, and beside points on faces.
CLOSEST = (0.05, 0.01)
#: How far from each other, in tiles, points inside and on a face may be that give each other away.
BESIDE = 0.05
#: How far, in tiles, points are clear of faces, and from each other; in last steps if these are
#: longer.
NEAR, BLUR = 1e-5, 10.0
#: Length of the least pull of a found point.
BALANCED = 1e-5
#: Weights below which feet play no part, slopes inwards that are none, slopes across the sheet of
#: equal distances that are none, and bends along it, per distance, that are none.
LIGHT, LEVEL, ALIKE, FLAT = 1e-3, 1e-3, 0.02, 1e-3
#: Directions in which the distance falls, by Morse index.
FALLS = (0, 0, False), (2, 0, False), (1, 1, False), (1, 0, True)
#: The same where that is not told.
UNKNOWN = -1, 0, False


def critical_points(
    lattice: MidSurface,
    low: float,
    high: float,
    *,
    inner: BSpline | None = None,
    outer: BSpline | None = None,
    within: ArrayLike | None = None,
    progress: Progress = None,
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
    progress : bool or callable, optional
        See `ilattice._progress.track`.

    Returns
    -------
    list of CriticalPoint
        By increasing value; only those at which a wall changes.

    Raises
    ------
    InputError
        For a mid-surface that ends with the domain, or a box upside down.
    """
    if lattice.ends.any():
        raise InputError(
            "critical points need a mid-surface that goes on outside the part: "
            'boundary="extend", and tiles whose opposite faces are alike'
        )
    box = lattice.domain if within is None else as_array("within", within)
    if box.shape != (2, 3) or not (box[0] < box[1]).all():
        raise InputError(f"within must be a lower and an upper corner, got {within!r:.80}")
    search = CriticalSearch(lattice, inner, outer)
    search.look(low - search.windows.slack, high + search.windows.slack, box, progress)
    return search.changes(low, high, box)


class CriticalSearch:
    """Finds critical points of a lattice, and remembers them.

    Parameters
    ----------
    lattice : Lattice
        The lattice.
    inner, outer : BSpline, optional
        Half-thickness on the sides where the implicit function is negative and positive.

    Attributes
    ----------
    points, spread : list of CriticalPoint
        On D, its faces, edges and corners, whether a wall changes there or not: isolated ones, and
        others, about one in each cell of the grid that critical curves and surfaces pass through.
    """

    def __init__(self, lattice: MidSurface, inner: BSpline | None, outer: BSpline | None) -> None:
        self.lattice = lattice
        self.clearance = Clearance(lattice, inner, outer)
        self.windows, self.balance = Windows(self.clearance), Balance(self.clearance)
        self.feet = SeveralFeet(self.clearance)
        self.link = Links(self.clearance, self.feet)
        self.domain = self.clearance.domain
        self.tile = np.ptp(self.domain, axis=0) / np.array(lattice.repeat)
        self.points: list[CriticalPoint] = []
        self.spread: list[CriticalPoint] = []

    def look(self, low: float, high: float, box: FloatArray, progress: Progress = None) -> None:
        """Add the critical points that windows lead to whose own values are in a range.

        That is, all critical points with values in the range less `Windows.slack` at its ends.

        Parameters
        ----------
        low, high : float
            Range of the values.
        box : ndarray, shape (2, 3)
            Part of the domain to search.
        progress : bool or callable, optional
            See `ilattice._progress.track`.
        """
        sides = product(*((0,) if c else (-1, 0, 1) for c in self.lattice.through.closed))
        strata = sorted(sides, key=np.count_nonzero)
        ends = {on: [] if 0 in on else [self._corner(on)] for on in strata}
        parts = [
            (on, part)
            for on in strata
            if 0 in on
            for part in self.windows.parts(on, low, high, box)
        ]
        for on, part in track(parts, "critical points", progress):
            ends[on] += self._ends(part, on)
        fresh = self._added(ends)
        while fresh:
            beside = {on: self._beside(fresh, on) for on in strata if 0 in on}
            fresh = self._added(
                {on: self._closer(u, on, CLOSER + CLOSEST) for on, u in beside.items()}
            )

    def changes(self, low: float, high: float, box: FloatArray) -> list[CriticalPoint]:
        """Points of a range, and of a box, at which a wall changes, by increasing value.

        Parameters
        ----------
        low, high : float
            Range of the values.
        box : ndarray, shape (2, 3)
            Part of the domain.

        Returns
        -------
        list of CriticalPoint
            With what changes there.
        """
        slack = 1e-9 * np.ptp(box, axis=0)
        asked = [
            p
            for p in self.points + self.spread
            if low <= p.value <= high
            and (np.abs(2.0 * p.u - box.sum(axis=0)) <= np.ptp(box, axis=0) + slack).all()
        ]
        judged = self._judged(one_of_each(asked, self.clearance, self.windows.spacing))
        changing = [p for p in judged if p.closed or (p.parts, p.holes) != (1, 0)]
        return sorted(changing, key=lambda p: (p.value, *p.u.tolist()))

    # ---------------------------------------------------------------- where to look

    def _ends(self, cells: IntArray, on: tuple[int, ...]) -> list[Ends]:
        """Where Newton's method ends, from windows of cells and from those about its ends."""
        ends = [self.balance.ends(s, on) for s in self.windows.starts(cells, on)]
        return ends + self._closer(np.concatenate([e.u for e in ends]), on)

    def _closer(
        self, u: FloatArray, on: tuple[int, ...], scales: tuple[float, ...] = CLOSER
    ) -> list[Ends]:
        """Ends from ever smaller windows about places (n, 3)."""
        ends: list[Ends] = []
        places = u
        for scale in scales:
            new = [self.balance.ends(s, on) for s in self.windows.starts_about(places, on, scale)]
            ends += new
            places = np.concatenate([u, *(e.u for e in new)])
        return ends

    def _beside(self, points: list[CriticalPoint], on: tuple[int, ...]) -> FloatArray:
        """Places (n, 3) on a face, an edge or inside next to points that are found on others."""
        lo, hi = self.domain
        u = np.array([p.u for p in points if p.on != on]).reshape(-1, 3)
        out = np.where(np.array(on) == 0, u, np.where(np.array(on) < 0, lo, hi))
        near = (np.abs(out - u) < BESIDE * self.tile).all(axis=1)
        return out[near]

    def _added(self, ends: dict[tuple[int, ...], list[Ends]]) -> list[CriticalPoint]:
        """Isolated points that are new among ends; these are added, and others."""
        first = len(self.points)
        for on, some in ends.items():
            missed = self._add(some, on)
            if 0 in on:  # feet that are nearer there have small shares of the space
                self._add(self._closer(missed, on, CLOSEST), on)
        return self.points[first:]

    def _add(self, ends: list[Ends], on: tuple[int, ...]) -> FloatArray:
        """Add what is new among ends; returns places (n, 3) to which other feet are nearer."""
        if not ends:
            return np.empty((0, 3))
        every = Ends(*(np.concatenate(a) for a in zip(*ends, strict=True)))
        every = every.of(every.pulled)
        points, missed = self._checked(self._new(every.of(every.isolated), on), on)
        self.points += points
        self.spread += self._checked(self._new_of_spread(every.of(~every.isolated), on), on)[0]
        return missed

    def _corner(self, on: tuple[int, ...]) -> Ends:
        lo, hi = self.domain
        u = np.where(np.array(on) < 0, lo, hi)[None]
        none = np.zeros(1, np.int64)
        sure = np.ones(1, np.bool_)
        return Ends(u, np.zeros(1), np.zeros((1, MAX_FEET, 3)), none, sure, sure)

    def _new(self, ends: Ends, on: tuple[int, ...]) -> Ends:
        """Ends clear of other faces: the sharpest at each place, if new."""
        known = np.array([p.u for p in self.points if p.on == on]).reshape(-1, 3)
        u = np.concatenate([known, ends.u])
        last = np.concatenate([np.zeros(len(known)), ends.last])
        blur = np.maximum(NEAR, BLUR * last)
        room = np.minimum(u - self.domain[0], self.domain[1] - u) / self.tile
        inner = (np.array(on) == 0) & ~self.clearance.closed
        clear = np.flatnonzero((room[:, inner] > blur[:, None]).all(axis=1))
        order = clear[np.argsort(last[clear], kind="stable")]
        if not len(order):
            return ends.of(order)
        tree, p = self.clearance.tree(u[order], self.tile)
        near = tree.query_ball_point(p, blur[order])
        first = order[np.array([min(k) for k in near]) == np.arange(len(near))]
        return ends.of(first[first >= len(known)] - len(known))

    def _new_of_spread(self, ends: Ends, on: tuple[int, ...]) -> Ends:
        """Ends that are not isolated and have no nearer feet: one in each cell, if new."""
        foot = self.clearance.image(ends.feet[:, 0])
        reach = np.linalg.norm(foot - self.lattice.through.x(ends.u), axis=1)
        ends = ends.of(reach <= (1.0 + EQUAL) * np.abs(self.lattice.distance(ends.u)))
        inner = (np.array(on) == 0) & ~self.clearance.closed
        room = np.minimum(ends.u - self.domain[0], self.domain[1] - ends.u) / self.tile
        ends = ends.of((room[:, inner] > NEAR).all(axis=1))
        known = np.array([p.u for p in self.spread if p.on == on]).reshape(-1, 3)
        u = (np.concatenate([known, ends.u]) - self.domain[0]) / self.windows.spacing
        cell = np.floor(u + 1.0 / 3.0)  # many are on nodes
        _, first = np.unique(cell, axis=0, return_index=True)
        return ends.of(np.sort(first[first >= len(known)]) - len(known))

    # ---------------------------------------------------------------- what is found

    def _checked(self, ends: Ends, on: tuple[int, ...]) -> tuple[list[CriticalPoint], FloatArray]:
        """Points in which the feet balance, and places (n, 3) to which other feet are nearer."""
        u = ends.u
        least = np.abs(self.lattice.distance(u)) if len(u) else np.empty(0)
        side = self.clearance.side(u)
        value = least - self.clearance.taken(u, side)[0]
        place, x, out = (on[0], on[1], on[2]), self.lattice.through.x(u), []
        good = np.zeros(len(u), np.bool_)
        for i, feet in enumerate(self.feet(u, ends.feet, ends.number)):
            slack = EQUAL * least[i]
            if abs(feet.value.min(initial=np.inf) - value[i]) > slack:
                continue
            feet = feet.of(np.flatnonzero(feet.value <= value[i] + slack))
            weights, pull = _pull(feet, on)
            good[i] = pull < BALANCED
            if good[i]:
                head = float(value[i]), u[i], x[i], int(side[i]), len(weights), place
                alone = bool(ends.isolated[i])
                falls = self._falls(feet, weights, on, alone)
                out.append(CriticalPoint(*head, *falls, alone))
        return out, u[~good]

    def _falls(
        self, feet: Feet, weights: FloatArray, on: tuple[int, ...], isolated: bool
    ) -> tuple[int, int, bool]:
        """Directions in which the distance falls: parts, holes, and whether they are all.

        Stratified Morse theory, across critical curves and surfaces; `UNKNOWN` where an isolated
        point is degenerate.
        """
        free = np.array(on) == 0
        slopes = feet.gradient / feet.size
        inwards = -(weights @ slopes)[~free] * np.array(on)[~free]
        if (np.abs(inwards) < LEVEL).any() or (weights < LIGHT).any():
            return UNKNOWN
        if (inwards < 0.0).any():
            return 1, 0, False
        across = (slopes[1:] - slopes[0])[:, free]
        if len(across):
            _, spread, axes = np.linalg.svd(across)
            if len(spread) < len(across) or spread.min() < ALIKE:
                return UNKNOWN
            axes = axes[len(across) :]
        else:
            axes = np.eye(int(free.sum()))
        bend = np.einsum("n,nab->ab", weights, feet.hessian) / np.outer(feet.size, feet.size)
        bends = np.linalg.eigvalsh(axes @ bend[np.ix_(free, free)] @ axes.T)
        if isolated and (np.abs(bends) * feet.reach < FLAT).any():
            return UNKNOWN
        bends = bends[np.abs(bends) * feet.reach >= FLAT]
        return FALLS[len(across) + int((bends < 0.0).sum())]

    def _judged(self, points: list[CriticalPoint]) -> list[CriticalPoint]:
        """Degenerate points with what changes there, seen on spheres that hold no other one."""
        unknown = [p for p in points if (p.parts, p.holes, p.closed) == UNKNOWN]
        if not unknown:
            return points
        every = self.points + [p for p in points if not p.isolated]
        tree = cKDTree(np.array([p.x for p in every]))
        gaps = np.asarray(tree.query(np.array([p.x for p in unknown]), 2)[0])[:, 1]
        told = {}
        for point, apart in zip(unknown, gaps.tolist(), strict=True):
            size = self.clearance.sizes(point.u[None])[0]
            room = np.minimum(point.u - self.domain[0], self.domain[1] - point.u) * size
            room = room[(np.array(point.on) == 0) & ~self.clearance.closed]
            radius = min(0.4 * apart, 0.5 * float(room.min(initial=np.inf)))
            place = point.u, point.value, point.side, point.on
            parts, holes, closed = self.link(*place, point.isolated, radius)
            told[id(point)] = replace(point, parts=parts, holes=holes, closed=closed)
        return [told.get(id(p), p) for p in points]


def _pull(feet: Feet, on: tuple[int, ...]) -> tuple[FloatArray, float]:
    """Weights of feet, and the length of their common pull along D, a face or an edge."""
    slopes = np.where(np.array(on) == 0, feet.gradient / feet.size, 0.0)
    n = len(slopes)
    rows, shares, pull = np.empty((1, MAX_FEET), np.int64), np.empty((1, MAX_FEET)), np.empty(1)
    _kernels_hull.shortest_means(1, np.array([0, n]), slopes, rows, shares, pull)
    weights = np.zeros(n)
    weights[rows[rows >= 0]] = shares[rows >= 0]
    return weights, float(pull[0])
