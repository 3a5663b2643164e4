"""Climb to where the distance to a mid-surface is greatest nearby: there voids are filled.

The distance to each foot that was met on the way is smooth, and no less than the distance to the
surface. The least of them, linearised, is made as great as it gets in a box about the best point;
the feet of the point that is found join in (cutting planes, Kelley 1960). No set of active feet is
needed, so that a climb also ends where feet become one, on focal curves of the mid-surface, where
Newton's method for equal distances has nothing to hold on to.

Guarantee: no end is lower than its start. Non-guarantee: which summit a climb ends on.
"""

from __future__ import annotations

import numpy as np

from ilattice._typing import FloatArray
from ilattice.offsets.excess import Excess
from ilattice.offsets.polish import inside

#: Most steps of a climb. In spans: the first box and the least one, and how far about a start feet
#: are gathered, at so many points.
STEPS, FIRST, LAST, ABOUT, ASKED = 40, 0.5, 1e-5, 0.25, 12
#: Gain of a step, relative to the distance, at which a climb ends, and the most that its last step
#: may still promise; how many feet are remembered.
NONE, LITTLE, KEPT = 1e-9, 1e-6, 48
#: Part of the promised gain below which the box of the next step is halved.
KEEN = 0.1


def climbed(excess: Excess, start: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Climb from points to where the distance, less a half-thickness, is greatest nearby.

    Parameters
    ----------
    excess : Excess
        Distance less half-thickness.
    start : ndarray, shape (n, 3)
        Parameters.

    Returns
    -------
    tuple of ndarray
        Parameters (n, 3) and values (n,) of the ends from which no step leads on.
    """
    if not len(start):
        return start, np.empty(0)
    climbs = [_Climb(u) for u in start]
    spread = np.random.default_rng(0).uniform(-ABOUT, ABOUT, (ASKED, 3)) * excess.span
    for step in [np.zeros(3), *spread]:
        _look(excess, climbs, start + step)
    for climb in climbs:
        climb.box = FIRST
    for _ in range(STEPS):
        live = [c for c in climbs if c.box > LAST and c.promises(NONE)]
        if not live:
            break
        u = np.stack([c.u for c in live])
        x, jacobian = excess.lattice.through.jet(u, 1)
        taken, slope = excess.taken(u, excess.side(u), 1)
        rows = zip(live, x, jacobian * excess.span, taken, slope * excess.span, strict=True)
        steps = [c.step(xi, j, t, s, _room(excess, c.u)) for c, xi, j, t, s in rows]
        _look(excess, live, u + np.array(steps) * excess.span)
    ends = [c for c in climbs if not c.promises(LITTLE)]
    return np.array([c.u for c in ends]).reshape(-1, 3), np.array([c.value for c in ends])


class _Climb:
    """One climb: its best point, the feet that were met, and the box of the next step, in spans."""

    def __init__(self, u: FloatArray) -> None:
        self.u, self.value, self.promise, self.box = u, -np.inf, np.inf, FIRST
        self.feet, self.distance = np.empty((0, 3)), 0.0

    def promises(self, part: float) -> bool:
        """Whether a further step promises more than a part of the distance."""
        return self.promise > part * self.distance

    def add(self, u: FloatArray, value: float, distance: float, feet: FloatArray) -> None:
        """A point that was asked, with its value and feet."""
        self.feet = np.concatenate([feet, self.feet])[:KEPT]
        if value - self.value < KEEN * self.promise:
            self.box *= 0.5
        if value > self.value:
            self.u, self.value, self.distance = u, value, distance

    def step(
        self, x: FloatArray, jacobian: FloatArray, taken: float, slope: FloatArray, room: FloatArray
    ) -> FloatArray:
        """Step in spans to where the least of the distances to feet, linearised, is greatest."""
        from scipy.optimize import linprog  # 10 MB that meshing does without

        away = x - self.feet
        distance = np.linalg.norm(away, axis=1)
        near = distance <= distance.min() + 4.0 * self.box * np.linalg.norm(jacobian)
        normal = away[near] / distance[near, None]
        g = normal @ jacobian - slope
        v = distance[near] - taken - self.value
        low, high = np.clip(room, -self.box, self.box)
        found = linprog(
            [0.0, 0.0, 0.0, -1.0], np.column_stack([-g, np.ones(len(v))]), v,
            bounds=[*zip(low, high, strict=True), (None, None)], method="highs",
        )  # fmt: skip
        if found.x is None:
            return np.zeros(3)
        self.promise = float(found.x[3])
        out: FloatArray = found.x[:3]
        return out


def _look(excess: Excess, climbs: list[_Climb], u: FloatArray) -> None:
    """Ask for distances and feet at one point per climb."""
    u = inside(excess.lattice, u)
    found = excess.lattice.closest(u)
    distance = np.abs(found.distance)
    value = distance - excess.taken(u, np.where(found.distance < 0.0, -1, 1))[0]
    for i, climb in enumerate(climbs):
        feet = [found.foot[i]]
        if np.isfinite(found.second_distance[i]):
            feet.append(found.second[i])
        climb.add(u[i], float(value[i]), float(distance[i]), np.array(feet))


def _room(excess: Excess, u: FloatArray) -> FloatArray:
    """Ways (2, 3), in spans, to lower and upper ends of the domain; closed ones are no ends."""
    ends = np.where(excess.closed, np.array([[-np.inf], [np.inf]]), excess.domain)
    out: FloatArray = (ends - u) / excess.span
    return out
