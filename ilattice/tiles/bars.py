"""Solids of straight bars as fields that are split at their edges, in place of splines.

A spline of a skeleton rounds off the edges where its bars meet. That stiffens joints: of
body-centred bars of radius 0.12, with four spans of the spline per radius, it makes C11 five parts
in a hundred larger in the limit of fine cells; on 28 per direction, where sharp edges are not yet
resolved, 1.4.

Guarantee: the solid is that of the tiles, to rounding; bars that follow each other on a line are
one. Non-guarantee: varying radii, curves, plates and smooth unions are not stated here.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice.fields import capsule, half_space, intersection, sphere, translate, union
from ilattice.fields._program import Builder, Point
from ilattice.fields.algebra import placed
from ilattice.fields.node import Node
from ilattice.tiles._tiled_bars import Bar, Joint, tiled
from ilattice.tiles.entities import Ball, Group, Polyline, Segments, Single
from ilattice.tiles.skeleton import SkeletonField
from ilattice.tiles.tile import Tile

__all__ = ["BarsInBox", "solid_of_bars"]

#: Bars above which splines are cheaper (two bcc tiles per direction have 76, and take three times
#: as long as their spline), and copies that are looked at.
MAX_BARS, IMAGES = 100, 20_000
#: Parts of a tile, per direction, in which bars are integrated where no cells are given.
PER_TILE = 8


@dataclass(frozen=True, eq=False)
class BarsInBox(Node):
    """Bars within the box of their tiles.

    Attributes
    ----------
    part : Node
        The bars, which go on beyond the box.
    box : ndarray, shape (2, 3)
        The box.
    repeat : tuple of 3 int
        Tiles in it.
    """

    part: Node
    box: FloatArray
    repeat: tuple[int, ...]

    @property
    def c(self) -> FloatArray:
        """Of the size of its values, in tiles, under the name that coefficients have."""
        return np.ones(1)

    def _emit(self, b: Builder, p: Point) -> int:
        return self.part._emit(b, p)

    def _box(self, level: float = 0.0) -> FloatArray:  # noqa: ARG002
        return self.box

    def breaks(self, axis: int) -> FloatArray:
        """Planes that cut every tile into `PER_TILE` parts.

        Parameters
        ----------
        axis : {0, 1, 2}
            Direction.

        Returns
        -------
        ndarray, shape (n,)
            Where they are.
        """
        lo, hi = self.box[:, axis]
        return np.linspace(lo, hi, PER_TILE * self.repeat[axis] + 1)


def solid_of_bars(
    tile: Tile, repeat: tuple[int, ...], box: FloatArray, most: int = MAX_BARS
) -> BarsInBox | None:
    """Sharply joined straight bars and balls of tiles.

    Parameters
    ----------
    tile : Tile
        Any.
    repeat : tuple of 3 int
        How many of them there are in a box.
    box : ndarray, shape (2, 3)
        The box.
    most : int
        Bars above which there is no solid of them; where two meet at a face of tiles that do not
        repeat, and not on one line, that is one more.

    Returns
    -------
    BarsInBox or None
        What is negative in the solid, at points of the box; None for other tiles.
    """
    field, count = tile.field, np.array(repeat)
    if not isinstance(field, SkeletonField) or field.count > IMAGES:
        return None
    if field.blend > 0.0 and field.count > 1:  # images of one are joined sharply
        return None
    own: list[Bar] = []
    for one in _singles(field):
        found = _bars(one, field.radius, tile.level)
        if found is None:
            return None
        own += found
    copies = tiled(own, field, count, IMAGES) if len(own) * count.prod() <= IMAGES else None
    if copies is None:
        return None
    bars = _merged(copies.bars)
    if len(bars) + len(copies.joints) > most:
        return None
    solids = [_solid(bar, field.cell) for bar in bars]
    solids += [_joint(joint, field.cell) for joint in copies.joints]
    matrix = field.cell @ np.diag(count / np.ptp(box, axis=0))
    solid = placed(union(*solids), matrix, -matrix @ box[0])
    return BarsInBox(solid, np.array(box), repeat)


def _singles(field: SkeletonField) -> list[Single]:
    """Entities without groups."""
    groups = (e.members if isinstance(e, Group) else (e,) for e in field.entities)
    return [one for group in groups for one in group]


def _bars(one: Any, radius: float | None, level: float) -> list[Bar] | None:
    """Ends and radii of an entity, None if it is not straight, or its radius varies."""
    if isinstance(one, Segments):
        ends, radii = one.points, one.at_ends(radius) + level
        if np.ptp(radii, axis=1).any() or not (radii > 0.0).all():
            return None
        return [Bar(a, b, float(r)) for (a, b), r in zip(ends, radii[:, 0], strict=True)]
    r = radius if getattr(one, "radius", None) is None else one.radius
    if not isinstance(one, Polyline | Ball) or r is None or callable(r) or np.size(r) != 1:
        return None
    r = float(np.ravel(r)[0]) + level
    if r <= 0.0:
        return None
    if isinstance(one, Ball):
        return [Bar(one.centre, one.centre, r)]
    found = [(a, b) for a, b in pairwise(one.points) if (a != b).any()]
    first, last = (() if one.closed else (0,)), (() if one.closed else (len(found) - 1,))
    return [Bar(a, b, r, (i in first, i in last)) for i, (a, b) in enumerate(found)]


def _merged(bars: list[Bar]) -> list[Bar]:
    """Those that overlap or touch on one line, with one radius, as one; all others once."""
    lines: dict[Any, list[tuple[float, float, FloatArray, FloatArray]]] = {}
    for a, b, r, _, cuts in bars:
        length = float(np.linalg.norm(b - a))
        if length == 0.0:
            lines.setdefault((*_rounded(a / r), r, cuts), []).append((0.0, 0.0, a, b))
            continue
        way = (b - a) / length
        way = way * np.sign(way[np.abs(way) > 1e-6][0])
        foot = a - (a @ way) * way
        (s, a), (t, b) = sorted(((float(x @ way), x) for x in (a, b)), key=lambda end: end[0])
        lines.setdefault((*_rounded(way), *_rounded(foot / r), r, cuts), []).append((s, t, a, b))
    out: list[Bar] = []
    for (*_, r, cuts), row in lines.items():
        row.sort(key=lambda bar: bar[:2])
        _, high, start, end = row[0]
        for s, t, a, b in row[1:]:
            if s > high + 1e-9 * r:
                out.append(Bar(start, end, r, cuts=cuts))
                high, start, end = t, a, b
            elif t > high:
                high, end = t, b
        out.append(Bar(start, end, r, cuts=cuts))
    return sorted(out, key=lambda bar: [*bar.a, *bar.b])  # rules differ a little with the order


def _rounded(x: FloatArray) -> tuple[float, ...]:
    """Numbers that are equal for equal places, mostly."""
    return tuple((np.round(x, 7) + 0.0).tolist())


def _solid(bar: Bar, cell: FloatArray) -> Node:
    """A bar as far as it is not cut."""
    a, b, r, _, cuts = bar
    whole = capsule(a, b, r) if (a != b).any() else translate(sphere(r), a)
    if not cuts:
        return whole
    return intersection(whole, *(_beside(cut.axis, cut.plane, cut.above, cell) for cut in cuts))


def _joint(joint: Joint, cell: FloatArray) -> Node:
    """What two bars that are cut at a face have in common within half a tile of it."""
    below, above, axis, plane, cuts = joint
    ends = [_beside(axis, plane + side, side < 0.0, cell) for side in (-0.5, 0.5)]
    return intersection(*(_solid(bar._replace(cuts=cuts), cell) for bar in (below, above)), *ends)


def _beside(axis: int, plane: float, above: bool, cell: FloatArray) -> Node:
    """What is below or above a plane along an edge of a cell."""
    normal = np.linalg.inv(cell)[axis]
    sign, size = (-1.0 if above else 1.0), float(np.linalg.norm(normal))
    return half_space(sign * normal, sign * plane / size)
