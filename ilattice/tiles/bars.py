"""Solids of straight bars as fields that are split at their edges, in place of splines.

A spline of a skeleton rounds off the edges where its bars meet. That stiffens joints: of
body-centred bars of radius 0.12, with four spans of the spline per radius, it makes C11 five parts
in a hundred larger.

Guarantee: the solid is that of the tiles, to rounding. Non-guarantee: varying radii, curves, plates
and smooth unions are not stated here.
"""

from itertools import pairwise, product
from typing import Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice.fields import capsule, sphere, translate, union
from ilattice.fields.algebra import placed
from ilattice.fields.node import Node
from ilattice.tiles.entities import Ball, Group, Polyline, Single
from ilattice.tiles.skeleton import SkeletonField
from ilattice.tiles.tile import Tile

__all__ = ["solid_of_bars"]

#: Bars above which splines are cheaper.
MOST = 1000

#: Ends and radius.
Bar = tuple[FloatArray, FloatArray, float]


def solid_of_bars(tile: Tile, repeat: tuple[int, ...], box: FloatArray) -> Node | None:
    """Sharply joined straight bars and balls of a tile that repeats in all directions.

    Parameters
    ----------
    tile : Tile
        Any.
    repeat : tuple of 3 int
        How many of them there are in a box.
    box : ndarray, shape (2, 3)
        The box.

    Returns
    -------
    Node or None
        What is negative in the solid, at points of the box; None for other tiles.
    """
    field = tile.field
    if not isinstance(field, SkeletonField) or not all(field.repeats):
        return None
    if field.blend > 0.0 and len(field.entities) > 1:  # images of one are joined sharply
        return None
    bars: dict[Any, Bar] = {}
    for one in _singles(field):
        found = _bars(one, field.radius, tile.level)
        if found is None:
            return None
        for bar in found:
            _add_images(bars, bar, field.cell, repeat)
    if len(bars) > MOST:
        return None
    matrix = field.cell @ np.diag(np.array(repeat) / np.ptp(box, axis=0))
    return placed(union(*(_solid(bar) for bar in bars.values())), matrix, -matrix @ box[0])


def _singles(field: SkeletonField) -> list[Single]:
    """Entities without groups."""
    groups = (e.members if isinstance(e, Group) else (e,) for e in field.entities)
    return [one for group in groups for one in group]


def _bars(one: Any, radius: float | None, level: float) -> list[Bar] | None:
    """Ends and radii of an entity, None if it is not straight, or its radius varies."""
    r = radius if getattr(one, "radius", None) is None else one.radius
    if not isinstance(one, Polyline | Ball) or r is None or callable(r) or np.size(r) != 1:
        return None
    r = float(np.ravel(r)[0]) + level
    if r <= 0.0:
        return None
    if isinstance(one, Ball):
        return [(one.centre, one.centre, r)]
    return [(a, b, r) for a, b in pairwise(one.points) if (a != b).any()]


def _add_images(bars: dict[Any, Bar], bar: Bar, cell: FloatArray, repeat: tuple[int, ...]) -> None:
    """Add the copies of a bar that reach into the tiles, each once."""
    a, b, r = bar
    back = np.linalg.inv(cell)
    reach = r * np.linalg.norm(back, axis=1)  # of a ball, in edges of the tile
    ends = np.stack([a, b]) @ back.T
    first = np.ceil(-ends.max(axis=0) - reach).astype(int)
    last = np.floor(np.array(repeat) - ends.min(axis=0) + reach).astype(int)
    for step in product(*(range(m, n + 1) for m, n in zip(first, last, strict=True))):
        x = np.stack([a, b]) + cell @ np.array(step, float)
        # those on opposite faces are each other's images
        places = sorted(map(tuple, (np.round(x / r, 9) + 0.0).tolist()))
        bars.setdefault((*places, r), (x[0], x[1], r))


def _solid(bar: Bar) -> Node:
    a, b, r = bar
    return capsule(a, b, r) if (a != b).any() else translate(sphere(r), a)
