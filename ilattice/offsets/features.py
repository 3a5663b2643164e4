"""Least features of walls: the thinnest wall, and the narrowest gap between walls.

The gap is that of the least ball which cannot pass between walls without touching: twice the least
distance, less the half-thickness, at which growing the wall changes its topology (the weak feature
size of the pores). A wall is nowhere thinner than its two half-thicknesses together, but for webs
where sheets or pores have just closed: these are as thick as the largest ball that fits in where
they close.

The critical points of the distance spline tell where to look, the narrowest first; what is reported
is solved for and measured by exact closest points.

Guarantee: at the place that is reported there is a gap, or a web, of that size: gaps to 1e-6, webs
to 1 % of it.
Non-guarantees: completeness, as in `ilattice.offsets.critical`, and the search ends with 32 places
in a row that are no narrower, webs tried from the one that closed last. The sharp edges along which
a face of the domain cuts a wall, and the crevices in which offset surfaces meet at an angle, have
no size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.errors import GeometryError, InputError
from ilattice.offsets.critical import CriticalPoint, _Search
from ilattice.offsets.polish import inside

if TYPE_CHECKING:
    from ilattice.offsets.wall import Wall

#: Largest pull of the spline's distance along D at which a point counts as critical, how many are
#: solved for at a time, and by how many spans those of the spline may be misplaced.
PULL, BATCH, MISPLACED = 0.1, 32, 0.1
#: Gaps whose sizes differ by less than this part are of one size.
SAME = 1e-6
#: Webs are looked for where sheets have closed by up to this part of the thickness; those that
#: closed longer ago are thicker than the wall.
REACH = 0.25
#: Directions in which the room in a web is measured, at first and in each of ever narrower cones
#: about the best one: distances have ridges, so that it may be a sharp one. Steps along each
#: direction to the first one outside, and halvings of that step.
FIRST, DIRECTIONS, CONES = 256, 64, tuple(0.4 * 0.5**i for i in range(8))
MARCH, HALVINGS = 12, 10


@dataclass(frozen=True)
class Feature:
    """A least feature of a wall.

    Attributes
    ----------
    size : float
        Its width, in units of length; infinite if there is none.
    u, x : ndarray, shape (3,)
        Its parameters, and its place in space; NaN if there is none.
    kind : str
        ``"wall"``: two offset surfaces, as far apart as asked; ``"web"``: a wall that has just
        closed; ``"bridge"``, ``"neck"``, ``"void"``: the gap will close so, see `CriticalPoint`;
        ``"none"``.
    """

    size: float
    u: FloatArray
    x: FloatArray
    kind: str

    def __str__(self) -> str:
        """Size and place in a line."""
        if self.kind == "none":
            return "none"
        place = ", ".join(f"{v:.4g}" for v in self.x)
        return f"{self.size:.4g} ({self.kind} at {place})"


def minimum_gap(wall: Wall) -> Feature:
    """Width of the narrowest gap; see `ilattice.offsets.Wall.minimum_gap`."""
    events = _Events(wall)
    least = Feature(np.inf, np.full(3, np.nan), np.full(3, np.nan), "none")
    for value, start, on in events.batches(0.0, float(np.abs(wall.distance.c).max())):
        if 2.0 * value > least.size:
            break
        new = [p for p in events.solved(start, on) if p.value > 0.0]
        narrower = [p for p in new if 2.0 * p.value < (1.0 - SAME) * least.size]
        if new and not narrower:
            break
        for p in narrower:
            if 2.0 * p.value < least.size:
                least = Feature(2.0 * p.value, p.u, p.x, p.kind)
    return least


def minimum_thickness(wall: Wall) -> Feature:
    """Width of the thinnest part; see `ilattice.offsets.Wall.minimum_thickness`."""
    if wall.thickness.solid:
        raise InputError("solids have no prescribed thickness; minimum_thickness is for walls")
    least = whole = _thinnest(wall)
    events = _Events(wall)
    for _, start, on in events.batches(-REACH * whole.size, 0.0, latest=True):
        webs = [p for p in events.solved(start, on) if p.value < 0.0]
        webs = [p for p in webs if p.kind in ("bridge", "neck")]
        rooms = [(2.0 * _room(wall, p, 0.5 * whole.size), p) for p in webs]
        size, p = min(rooms, key=lambda r: r[0], default=(np.inf, None))
        if p is None or size >= least.size:
            if webs:
                break
            continue
        least = Feature(size, p.u, p.x, "web")
    return least


def check_features(wall: Wall, least_wall: float | None, least_gap: float | None) -> None:
    """Refuse a wall with thinner walls or narrower gaps.

    Parameters
    ----------
    wall : Wall
        The wall.
    least_wall, least_gap : float, optional
        Limits.

    Raises
    ------
    GeometryError
        Naming the size and the place of what is too small.
    """
    for limit, measure, name, remedy in (
        (least_wall, minimum_thickness, "wall", "make it thicker, or its tiles larger"),
        (least_gap, minimum_gap, "gap", "make the wall thinner, or its tiles larger"),
    ):
        found = None if limit is None else measure(wall)
        if limit is not None and found is not None and found.size < limit:
            raise GeometryError(
                f"the least {name} is {found}, less than least_{name}={limit:g}; {remedy}"
            )


def _thinnest(wall: Wall) -> Feature:
    """Where the half-thicknesses together are least: at the middle of a grid of the domain."""
    t = wall.thickness
    lo, hi = wall.lattice.domain
    axes = [np.linspace(lo[a], hi[a], 33) for a in range(3)]
    u = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    total = t.outer(u, extrapolate="clamp") + t.inner(u, extrapolate="clamp")
    i = int(np.argmin(total))
    return Feature(float(total[i]), u[i], wall.lattice.through.x(u[i : i + 1])[0], "wall")


class _Events:
    """Changes of topology if a wall grew or shrank, a batch at a time."""

    def __init__(self, wall: Wall) -> None:
        self.wall = wall
        self.search = _Search(wall.lattice, wall.thickness.inner, wall.thickness.outer)
        self.known: list[CriticalPoint] = []

    def batches(
        self, low: float, high: float, *, latest: bool = False
    ) -> Iterator[tuple[float, FloatArray, IntArray]]:
        """Places where something may change between values, by value, and by faces they are on."""
        value, u, on = self._starts(low, high)
        order = np.argsort(-value if latest else value, kind="stable")
        for i in range(0, len(order), BATCH):
            part = order[i : i + BATCH]
            yield float(value[part[0]]), u[part], on[part]

    def solved(self, start: FloatArray, on: IntArray) -> list[CriticalPoint]:
        """Changes of topology near places that were not known before."""
        first = len(self.known)
        for row in np.unique(on, axis=0):
            here = (int(row[0]), int(row[1]), int(row[2]))
            found = self.search.solve(start[(on == row).all(axis=1)], here)
            self.search.add_new(found, self.known)
        new = self.search.judged(self.known[first:], self.known)
        return [p for p in new if p.closed or (p.parts, p.holes) != (1, 0)]

    def _starts(self, low: float, high: float) -> tuple[FloatArray, FloatArray, IntArray]:
        """Critical points of the distance spline, with exact values."""
        search, excess, through = self.search, self.search.excess, self.search.lattice.through
        values, places, strata = [np.empty(0)], [np.empty((0, 3))], [np.empty((0, 3), np.int64)]
        for on in product(*((0,) if c else (-1, 0, 1) for c in through.closed)):
            cells = search.starts(on, low, high)
            u = self._sparse(search._on_spline(cells, on) if 0 in on else cells)
            size = np.linalg.norm(through.jacobian(u), axis=1)
            flat = np.linalg.norm((excess.on_spline(u, 1)[1] / size)[:, np.array(on) == 0], axis=1)
            flat = flat < PULL
            u, slack = u[flat], MISPLACED * (size[flat] * search.span).max(axis=1, initial=0.0)
            value = excess.value(u)
            keep = (value > low - slack) & (value < high + slack)
            values.append(value[keep])
            places.append(u[keep])
            strata.append(np.tile(np.array(on), (int(keep.sum()), 1)))
        return np.concatenate(values), np.concatenate(places), np.concatenate(strata)

    def _sparse(self, u: FloatArray) -> FloatArray:
        """One point of those within about half a span of each other."""
        _, first = np.unique(np.rint(2.0 * u / self.search.span), axis=0, return_index=True)
        return u[np.sort(first)]


def _room(wall: Wall, point: CriticalPoint, most: float) -> float:
    """Distance from a point inside a web to its surface, or `most` if that is nearer."""
    back = np.linalg.inv(wall.lattice.through.jacobian(point.u[None])[0])
    directions, best = _sphere(FIRST), most
    for cone in (*CONES, 0.0):
        away = _first_exits(wall, point, directions @ back.T, 1.2 * most)
        i = int(np.argmin(away))
        best = min(best, float(away[i]))
        directions = np.vstack([directions[i], directions[i] + cone * _sphere(DIRECTIONS)])
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return best


def _first_exits(
    wall: Wall, point: CriticalPoint, directions: FloatArray, most: float
) -> FloatArray:
    """Distance in space at which straight lines of parameters leave a wall, else infinity."""
    lattice = wall.lattice
    lo, hi = lattice.domain
    opened = ~np.array(lattice.through.closed)
    less = wall.thickness.inner if point.side < 0 else wall.thickness.outer

    def within(t: FloatArray) -> AnyArray:
        u = inside(lattice, point.u + t[:, None] * directions)
        out: AnyArray = np.abs(lattice.distance(u)) < less(u)
        return out

    far = np.full(len(directions), most)
    for t in np.linspace(most, 0.0, MARCH, endpoint=False):
        far = np.where(within(np.full(len(directions), t)), far, t)
    near = far - most / MARCH
    for _ in range(HALVINGS):
        middle = 0.5 * (near + far)
        still = within(middle)
        near, far = np.where(still, middle, near), np.where(still, far, middle)
    ends = point.u + far[:, None] * directions
    beyond = ((ends < lo) | (ends > hi))[:, opened].any(axis=1) | (far == most)
    away = np.linalg.norm(lattice.through.x(inside(lattice, ends)) - point.x, axis=1)
    return np.where(beyond, np.inf, away)


def _sphere(n: int) -> FloatArray:
    """Directions (n, 3) that are spread evenly over the sphere."""
    z = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    angle = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(n)
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)
