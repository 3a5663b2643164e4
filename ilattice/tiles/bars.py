"""Solids of straight bars as fields that are split at their edges, in place of splines.

A spline of a skeleton rounds off the edges where its bars meet. That stiffens joints: of
body-centred bars of radius 0.12, with four spans of the spline per radius, it makes C11 five parts
in a hundred larger in the limit of fine cells; on 28 per direction, where sharp edges are not yet
resolved, 1.4.

Guarantee: the solid is that of the tiles, to rounding; bars that follow each other on a line are
one. Non-guarantee: varying radii, curves, plates and smooth unions are not stated here.
"""

from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any

import numpy as np

from ilattice._typing import FloatArray, IntArray
from ilattice.fields import capsule, sphere, translate, union
from ilattice.fields._program import Builder, Point
from ilattice.fields.algebra import placed
from ilattice.fields.node import Node
from ilattice.tiles.entities import Ball, Group, Polyline, Segments, Single
from ilattice.tiles.skeleton import ON_FACE, SkeletonField
from ilattice.tiles.tile import Tile

__all__ = ["BarsInBox", "solid_of_bars"]

#: Bars above which splines are cheaper (two bcc tiles per direction have 76, and take three times
#: as long as their spline), and copies that are looked at.
MAX_BARS, IMAGES = 100, 20_000
#: Parts of a tile, per direction, in which bars are integrated where no cells are given.
PER_TILE = 8

#: Ends and radius.
Bar = tuple[FloatArray, FloatArray, float]


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
        Bars above which there is no solid of them.

    Returns
    -------
    BarsInBox or None
        What is negative in the solid, at points of the box; None for other tiles, and where tiles
        follow each other in a direction in which they do not repeat, or bars end on faces across
        which they do not: an open face continues them.
    """
    field, count = tile.field, np.array(repeat)
    if not isinstance(field, SkeletonField) or not (field.repeats | (count == 1)).all():
        return None
    if field.blend > 0.0 and field.count > 1:  # images of one are joined sharply
        return None
    bars: list[Bar] = []
    if field.count > IMAGES:
        return None
    for one in _singles(field):
        found = _bars(one, field.radius, tile.level)
        if found is None:
            return None
        if any(_ends_on_faces(bar, field) for bar in found):
            return None
        for bar in found:
            bars += _images(bar, field, count)
        if len(bars) > IMAGES:
            return None
    bars = _merged(bars)
    if len(bars) > most:
        return None
    matrix = field.cell @ np.diag(count / np.ptp(box, axis=0))
    solid = placed(union(*map(_solid, bars)), matrix, -matrix @ box[0])
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
        return [(a, b, float(r)) for (a, b), r in zip(ends, radii[:, 0], strict=True)]
    r = radius if getattr(one, "radius", None) is None else one.radius
    if not isinstance(one, Polyline | Ball) or r is None or callable(r) or np.size(r) != 1:
        return None
    r = float(np.ravel(r)[0]) + level
    if r <= 0.0:
        return None
    if isinstance(one, Ball):
        return [(one.centre, one.centre, r)]
    return [(a, b, r) for a, b in pairwise(one.points) if (a != b).any()]


def _ends_on_faces(bar: Bar, field: SkeletonField) -> bool:
    """Whether a bar ends on a face across which nothing repeats."""
    ends = np.stack(bar[:2]) @ np.linalg.inv(field.cell).T
    on = (np.abs(ends) <= ON_FACE) | (np.abs(ends - 1.0) <= ON_FACE)
    return bool((on & ~np.array(field.repeats)).any())


def _images(bar: Bar, field: SkeletonField, count: IntArray) -> list[Bar]:
    """The copies of a bar that reach into the tiles."""
    a, b, r = bar
    back = np.linalg.inv(field.cell)
    reach = r * np.linalg.norm(back, axis=1)  # of a ball, in edges of the tile
    ends = np.stack([a, b]) @ back.T
    first = np.where(field.repeats, np.ceil(-ends.max(axis=0) - reach), 0.0).astype(int)
    last = np.where(field.repeats, np.floor(count - ends.min(axis=0) + reach), 0.0).astype(int)
    steps = product(*(range(m, n + 1) for m, n in zip(first, last, strict=True)))
    moves = [field.cell @ np.array(step, float) for step in steps]
    return [(a + x, b + x, r) for x in moves]


def _merged(bars: list[Bar]) -> list[Bar]:
    """Those that overlap or touch on one line, with one radius, as one; all others once."""
    lines: dict[Any, list[tuple[float, float, FloatArray, FloatArray]]] = {}
    for a, b, r in bars:
        length = float(np.linalg.norm(b - a))
        if length == 0.0:
            lines.setdefault((*_rounded(a / r), r), []).append((0.0, 0.0, a, b))
            continue
        way = (b - a) / length
        way = way * np.sign(way[np.abs(way) > 1e-6][0])
        foot = a - (a @ way) * way
        (s, a), (t, b) = sorted(((float(x @ way), x) for x in (a, b)), key=lambda end: end[0])
        lines.setdefault((*_rounded(way), *_rounded(foot / r), r), []).append((s, t, a, b))
    out: list[Bar] = []
    for key, row in lines.items():
        row.sort(key=lambda bar: bar[:2])
        _, high, start, end = row[0]
        for s, t, a, b in row[1:]:
            if s > high + 1e-9 * key[-1]:
                out.append((start, end, key[-1]))
                high, start, end = t, a, b
            elif t > high:
                high, end = t, b
        out.append((start, end, key[-1]))
    return sorted(out, key=lambda bar: [*bar[0], *bar[1]])  # rules differ a little with the order


def _rounded(x: FloatArray) -> tuple[float, ...]:
    """Numbers that are equal for equal places, mostly."""
    return tuple((np.round(x, 7) + 0.0).tolist())


def _solid(bar: Bar) -> Node:
    a, b, r = bar
    return capsule(a, b, r) if (a != b).any() else translate(sphere(r), a)
