"""Entities from what users write.

Guarantee: pairs of points that follow each other become arrays, without an object each.
"""

from itertools import groupby
from typing import Any

import numpy as np

from ilattice._validate import as_array
from ilattice.errors import InputError
from ilattice.tiles.entities import Entity, Group, Segments, as_single


def as_entities(given: Any) -> tuple[tuple[Entity, ...], tuple[range, ...]]:
    """Entities from what users write, and the items of the list that each is.

    Parameters
    ----------
    given : sequence of Entity, BSpline or array_like, or array_like of shape (n, 2, 3)
        What is given; pairs of points that follow each other become one `Segments`.

    Returns
    -------
    tuple of Entity
        The entities.
    tuple of range
        Numbers of the items: one, or one per segment.

    Raises
    ------
    InputError
        If there is none, or an item is none of these.
    """
    if isinstance(given, np.ndarray) and given.ndim == 3:
        if given.shape[1] == 2 and (joined := _joined(given)) is not None:
            return (joined,), (range(len(given)),)
        given = list(given)
    if not isinstance(given, list | tuple) or not given:
        raise InputError(
            f"entities must be a list of at least one curve or surface, or segments (n, 2, 3), got "
            f"{given!r:.80}"
        )
    out: list[Entity] = []
    items: list[range] = []
    stop = 0
    for pairs, group in groupby(given, _is_pair):
        run = list(group)
        start, stop = stop, stop + len(run)
        if pairs and (joined := _joined(run)) is not None:
            out.append(joined)
            items.append(range(start, stop))
        else:
            out += [as_entity(f"entities[{i}]", e) for i, e in enumerate(run, start)]
            items += [range(i, i + 1) for i in range(start, stop)]
    return tuple(out), tuple(items)


def _is_pair(item: Any) -> bool:
    """Whether an item may be two points."""
    return isinstance(item, (list, tuple, np.ndarray)) and len(item) == 2


def _joined(pairs: Any) -> Segments | None:
    """Pairs of points as one entity; none where one of them is none."""
    try:
        return Segments(as_array("entities", pairs, 3)) if len(pairs) > 1 else None
    except InputError:
        return None


def as_entity(name: str, value: Any) -> Entity:
    """Entity from what users write: an entity, a spline, or corners of a polyline.

    Parameters
    ----------
    name : str
        Name for messages.
    value : Entity, BSpline or array_like of shape (n, 3)
        What is given.

    Returns
    -------
    Entity
        The entity.

    Raises
    ------
    InputError
        If it is none of these.
    """
    return value if isinstance(value, Group) else as_single(name, value)
