"""Least features of walls: the thinnest wall, and the narrowest gap between walls.

The gap is that of the least ball which cannot pass between walls without touching: twice the least
distance, less the half-thickness, at which growing the wall changes its topology (the weak feature
size of the pores). A wall is nowhere thinner than its two half-thicknesses together, but for webs
where sheets or pores have just closed: these are as thick as the largest ball that fits in where
they close.

Both are found among the critical points of the distance (`ilattice.topology.critical`), the next
ones first.

Guarantee: at the place that is reported there is a gap, or a web, of that size: gaps to 1e-6, webs
to 1 % of it.
Non-guarantees: completeness, as in `ilattice.topology.critical`; webs are tried from those that
closed last, until some are no thinner. The sharp edges along which a face of the domain cuts a
wall, and the crevices in which offset surfaces meet at an angle, have no size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ilattice._geometry import grid_points
from ilattice._typing import AnyArray, FloatArray
from ilattice._validate import Frozen
from ilattice.errors import GeometryError, InputError
from ilattice.offsets.polish import inside
from ilattice.topology.critical import CriticalSearch
from ilattice.topology.critical_point import CriticalPoint

if TYPE_CHECKING:
    from ilattice.offsets.wall import OffsetSolid

#: Ranges of values that are searched one after the other.
STAGES = 6
#: Webs are looked for where sheets have closed by up to this part of the thickness; those that
#: closed longer ago are thicker than the wall.
REACH = 0.25
#: Directions in which the room in a web is measured, at first and in each of ever narrower cones
#: about the best one: distances have ridges, so that it may be a sharp one.
FIRST, DIRECTIONS, CONES = 256, 64, tuple(0.4 * 0.5**i for i in range(8))
#: Steps along each direction to the first one outside, and halvings of that step.
MARCH, HALVINGS = 12, 10
#: Directions in which a map stretches by less than this part of the most are none.
FLAT = 1e-9


@dataclass(frozen=True)
class Feature(Frozen):
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


def minimum_gap(wall: OffsetSolid) -> Feature:
    """Width of the narrowest gap; see `ilattice.lattice.Wall.minimum_gap`."""
    for gaps in _events(wall, 0.0, float(np.abs(wall.distance.c).max())):
        p = min((p for p in gaps if p.kind != "part"), key=lambda p: p.value, default=None)
        if p is not None:
            return Feature(2.0 * p.value, p.u.copy(), p.x.copy(), p.kind)
    return Feature(np.inf, np.full(3, np.nan), np.full(3, np.nan), "none")


def minimum_thickness(wall: OffsetSolid) -> Feature:
    """Width of the thinnest part; see `ilattice.lattice.Wall.minimum_thickness`."""
    if wall.thickness.solid:
        raise InputError("solids have no prescribed thickness; minimum_thickness is for walls")
    least = whole = _thinnest(wall)
    for events in _events(wall, 0.0, -REACH * whole.size):
        webs = [p for p in events if p.kind in ("bridge", "neck")]
        rooms = [(2.0 * _room(wall, p, 0.5 * whole.size), p) for p in webs]
        size, p = min(rooms, key=lambda r: r[0], default=(np.inf, None))
        if p is not None and size < least.size:
            least = Feature(size, p.u.copy(), p.x.copy(), "web")
        elif webs:
            break
    return least


def check_features(wall: OffsetSolid, least_wall: float | None, least_gap: float | None) -> None:
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


def _thinnest(wall: OffsetSolid) -> Feature:
    """Where the half-thicknesses together are least: at the middle of a grid of the domain."""
    t = wall.thickness
    lo, hi = wall.lattice.domain
    axes = [np.linspace(lo[a], hi[a], 33) for a in range(3)]
    u = grid_points(*axes)
    total = t.outer(u, extrapolate="clamp") + t.inner(u, extrapolate="clamp")
    i = int(np.argmin(total))
    return Feature(float(total[i]), u[i].copy(), wall.lattice.through.x(u[i : i + 1])[0], "wall")


def _events(wall: OffsetSolid, first: float, last: float) -> Iterator[list[CriticalPoint]]:
    """Changes of topology if a wall grew or shrank, a range of values after the other."""
    search = CriticalSearch(wall.lattice, wall.thickness.inner, wall.thickness.outer)
    box, slack = wall.lattice.domain, np.copysign(search.windows.slack, last - first)
    seen = first - slack
    for a, b in pairwise(np.linspace(first, last, STAGES + 1).tolist()):
        search.look(min(seen, b + slack), max(seen, b + slack), box)
        seen = b + slack
        yield search.changes(min(a, b), max(a, b), box)


def _room(wall: OffsetSolid, point: CriticalPoint, most: float) -> float:
    """Distance from a point inside a web to its surface, or `most` if that is nearer."""
    jacobian = wall.lattice.through.jacobian(point.u[None])[0]
    back = np.linalg.pinv(jacobian, rcond=FLAT)  # maps may be singular where faces collapse
    directions, best = _sphere(FIRST), most
    for cone in (*CONES, 0.0):
        away = _first_exits(wall, point, directions @ back.T, 1.2 * most)
        i = int(np.argmin(away))
        best = min(best, float(away[i]))
        directions = np.vstack([directions[i], directions[i] + cone * _sphere(DIRECTIONS)])
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return best


def _first_exits(
    wall: OffsetSolid, point: CriticalPoint, directions: FloatArray, most: float
) -> FloatArray:
    """Distance in space at which straight lines of parameters leave a wall, else infinity."""
    lattice = wall.lattice
    lo, hi = lattice.domain
    opened = ~np.array(lattice.through.closed)
    less = wall.thickness.inner if point.side < 0 else wall.thickness.outer

    def within(t: FloatArray) -> AnyArray:
        """Which places (n,) at some lengths of way are in the wall."""
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
