"""From the outline of a wall on a section to loops of points in the plane.

Where a contour crosses an edge of the section is bracketed first, so that points do not stray onto
another contour; then they move onto plane and wall, those close together merge, and bends get
points in between. All that may make contours cross, at creases and in narrow gaps. What does goes
back to the crossings with the edges, unmerged: there contours are simple, because the section is.

Guarantee: contours that are simple and do not touch each other, unless the map folds the section.
Non-guarantee: at creases, contours are rounded over part of a cell.
"""

from typing import NamedTuple

import numpy as np

from ilattice._geometry import between, fixed_coordinates
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.slicing import _kernels_slices as kernels
from ilattice.slicing._in_plane import InPlane
from ilattice.slicing._section import Section

#: Secants onto the wall, along edges of the section.
SECANTS = 4
#: Points nearer to each other merge: first those along smooth parts of a contour, relative to the
#: shortest edge of the cells there, then all, relative to the edges asked for; and those that have
#: been brought back.
SPACING, MERGE, SAME = 0.35, 1e-3, 1e-9
#: Turn between neighbouring edges, in radians, above which they are halved, and how often at most:
#: chords cut off an area that falls with the square of the turn.
BEND, HALVES = 0.03, 5
#: How far beside a chord, relative to its length, the point in between may be: as at half a circle,
#: less than at the other side of a crease; and how far from its middle.
ASIDE, AHEAD = 0.5, 0.35


class Outline(NamedTuple):
    """Closed loops: points (n, 2), first point of each loop (m + 1,), signed areas (m,).

    And the area in which there may be others, that are finer than the grid.
    """

    points: FloatArray
    start: IntArray
    area: FloatArray
    unresolved_area: float = 0.0


EMPTY = Outline(np.empty((0, 2)), np.zeros(1, np.int64), np.empty(0))


class _Loops(NamedTuple):
    """Loops of parameters (n, 3) with what is known of them.

    That is: which coordinates faces fix, the side of the wall, and the place (n,) among the nodes
    that the loops had at first, with fractions for points in between.
    """

    u: FloatArray
    fixed: AnyArray
    side: IntArray
    place: FloatArray
    start: IntArray


def placed(
    plane: InPlane, node: IntArray, start: IntArray, section: Section, level: float
) -> Outline:
    """Loops of points in the plane.

    Parameters
    ----------
    plane : InPlane
        Moves points.
    node : ndarray, shape (n,)
        Corners of the section, and crossings of its edges as `kernels.march` names them.
    start : ndarray, shape (m + 1,)
        First node of each loop.
    section : Section
        The section.
    level : float
        Height of the plane.

    Returns
    -------
    Outline
        The loops.
    """
    size = len(section.u)
    cross = node >= size
    upper = np.where(cross, (node - size) % 2, 0)
    pair = np.where(cross, (node - size) // 2, 0)
    a, b = np.where(cross, pair // size, node), np.where(cross, pair % size, node)
    t = np.zeros(len(node))
    at = np.flatnonzero(cross)
    t[at] = _crossings(plane, section, a[at], b[at], upper[at])
    u = plane.wrapped(section.u[a] + t[:, None] * plane.shortest(section.u[b] - section.u[a]))
    flat = plane.flat(section.u)
    rough = flat[a] + t[:, None] * (flat[b] - flat[a])
    fixed = fixed_coordinates(section.faces[a] & section.faces[b])
    side = np.where(cross, 2 * upper - 1, 0)
    keep = np.zeros(len(u), np.bool_)
    spacing = SPACING * plane.edges(u) * 0.5 ** np.maximum(section.depth[a], section.depth[b])
    kernels.thin_out(rough, start, spacing, fixed.sum(axis=1) + cross > 1, keep)
    first = _first(keep, start)
    fixed, side = fixed[keep], side[keep]
    moved = plane.projected(u[keep], fixed, side, level)
    loops = _Loops(moved, fixed, side, np.flatnonzero(keep).astype(np.float64), first)
    loops = _denser(plane, loops, level)
    return _simple(plane, loops, rough, start)


def _crossings(
    plane: InPlane, section: Section, a: IntArray, b: IntArray, upper: IntArray
) -> FloatArray:
    """Parts of the ways between corners of the section where sides of the wall cross."""
    ends = np.stack([section.beyond[a, upper], section.beyond[b, upper]], axis=1)
    low, step = section.u[a], plane.shortest(section.u[b] - section.u[a])
    return between(lambda u: plane.beyond(plane.wrapped(u), upper), low, low + step, ends, SECANTS)


def _denser(plane: InPlane, loops: _Loops, level: float) -> _Loops:
    """Loops with more points between neighbours on a side or a face, where they bend."""
    u, fixed, side, place, start = loops
    for _ in range(HALVES):
        after = _after(start)
        p = plane.flat(u)
        rim: AnyArray = np.asarray((fixed & fixed[after]).any(axis=1))
        along = rim | (side == side[after])
        turn = _turns(p, after)
        bend = along & along[after] & (rim == rim[after])
        turn[after[~bend]] = 0.0  # corners of the wall, or of the domain
        turn[fixed.sum(axis=1) > 1] = 0.0
        at = np.flatnonzero(along & (np.maximum(turn, turn[after]) > BEND))
        to = after[at]
        on, of = fixed[at] & fixed[to], np.where(rim, 0, side)[at]
        new = plane.wrapped(u[at] + 0.5 * plane.shortest(u[to] - u[at]))
        new = plane.projected(new, on, of, level)
        good = _beside(plane.flat(new), p[at], p[to])
        behind = np.where(to > at, place[to], np.floor(place[at]) + 1.0)
        middle = 0.5 * (place[at] + behind)
        index = at[good] + 1
        start = start + np.searchsorted(index, start, "right")
        u, fixed = np.insert(u, index, new[good], axis=0), np.insert(fixed, index, on[good], 0)
        side = np.insert(side, index, of[good])
        place = np.insert(place, index, middle[good])
    return _Loops(u, fixed, side, place, start)


def _simple(plane: InPlane, loops: _Loops, rough: FloatArray, first: IntArray) -> Outline:
    """Loops in the plane; what crosses goes back to where it was, `rough` (n, 2)."""
    points, place, start = plane.flat(loops.u), loops.place, loops.start
    back = np.zeros(len(rough), np.bool_)
    while True:
        least = np.where(np.isin(place, np.flatnonzero(back)), SAME, MERGE) * plane.h
        keep, start = apart(points, start, least)
        points, place = points[keep], place[keep]
        now = back | _between(place, start, crossing(points, start), first)
        if (now == back).all():
            return finished(points, start, MERGE * plane.h)
        back = now
        low, up = (f(place).astype(np.int64) for f in (np.floor, np.ceil))
        loop = np.searchsorted(first, low, "right") - 1
        up = np.where(up < first[loop + 1], up, first[loop])
        keep = ~(back[low] & back[up])
        place = np.concatenate([place[keep], np.flatnonzero(back)])
        order = np.argsort(place, kind="stable")
        points, place = np.concatenate([points[keep], rough[back]])[order], place[order]
        start = np.searchsorted(place, first)


def _between(place: FloatArray, start: IntArray, edges: AnyArray, first: IntArray) -> AnyArray:
    """Which of the first nodes are at an end of one of `edges` (n,), or between its ends."""
    at = np.flatnonzero(edges)
    low = np.floor(place[at]).astype(np.int64)
    high = np.ceil(place[_after(start)[at]]).astype(np.int64)
    loop = np.searchsorted(first, low, "right") - 1
    wraps = (high < low) | (high >= first[loop + 1])
    high = np.where(wraps, first[loop + 1] - 1, high)
    low, high = (np.concatenate([v, first[loop[wraps]]]) for v in (low, high))
    steps = np.zeros(first[-1] + 1, np.int64)
    np.add.at(steps, low, 1)
    np.add.at(steps, high + 1, -1)
    out: AnyArray = np.cumsum(steps)[:-1] > 0
    return out


def crossing(points: FloatArray, start: IntArray) -> AnyArray:
    """Which edges (n,) of closed loops, from each point to the next, cross or touch others."""
    after = _after(start)
    order = np.argsort(np.minimum(points[:, 0], points[after, 0]), kind="stable")
    out = np.zeros(len(points), np.bool_)
    kernels.crossings(points, after, order, out)
    return out


def _after(start: IntArray) -> IntArray:
    """Index of the point after each one of closed loops."""
    after = np.arange(1, start[-1] + 1)
    after[start[1:] - 1] = start[:-1]
    return after


def apart(points: FloatArray, start: IntArray, least: FloatArray) -> tuple[AnyArray, IntArray]:
    """Which points (n,) of loops are not nearer to the one before than `least`; first of each."""
    keep = np.zeros(len(points), np.bool_)
    kernels.thin_out(points, start, least, np.zeros_like(keep), keep)
    return keep, _first(keep, start)


def _first(keep: AnyArray, start: IntArray) -> IntArray:
    """First point of each loop, once only those to keep are left."""
    count = np.add.reduceat(keep, start[:-1], dtype=np.int64)
    return np.concatenate([[0], np.cumsum(count)])


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
    """Outline of loops, without those smaller than `least` squared."""
    count, area = np.diff(start), np.empty(len(start) - 1)
    kernels.areas(points, start, area)
    good = (count >= 3) & (np.abs(area) > least**2)
    points = points[np.repeat(good, count)]
    return Outline(points, np.concatenate([[0], np.cumsum(count[good])]), area[good])
