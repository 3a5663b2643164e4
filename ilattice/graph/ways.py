"""All closed ways along the faces of a bounding volume, for conjugate surfaces.

Guarantee: each way comes once, up to where it starts, its direction, and the symmetries of the
volume that permute and turn over axes. Non-guarantee: that a surface exists.
"""

from collections.abc import Iterator
from itertools import permutations, product
from typing import Any

import numpy as np

from ilattice._validate import as_whole
from ilattice.errors import InputError
from ilattice.minimal import FaceLoop, Region

#: Sides of a loop at most: all are listed, and their number is exponential in it.
MAX_SIDES = 10


def ways(within: Region, sides: int) -> tuple[FaceLoop, ...]:
    """Closed ways of a number of sides.

    Parameters
    ----------
    within : Region
        The bounding volume.
    sides : int
        Number of sides, 4 to 10.

    Returns
    -------
    tuple of FaceLoop
        Neighbours share an edge of the volume, and a polygon of the normals closes.

    Examples
    --------
    >>> from ilattice.minimal import tetrahedron
    >>> [" ".join(w.names) for w in ways(tetrahedron(), 4)]
    ['z=0 y=z x=y x=1/2', 'z=0 y=z x=1/2 x=y', 'z=0 x=y y=z x=1/2']
    """
    if not isinstance(within, Region):
        raise InputError(f"within must be a bounding volume, got {within!r:.60}")
    count = as_whole("sides", sides, 4, MAX_SIDES)
    beside = _beside(within)
    turns = _symmetries(within)
    seen: set[tuple[int, ...]] = set()
    out = []
    for way in _closed(beside, count):
        if way != _least(way, [range(len(beside))]):  # the same way from elsewhere
            continue
        least = _least(way, turns)
        if least in seen:
            continue
        seen.add(least)
        try:
            out.append(FaceLoop(within, least))
        except InputError:  # no polygon of its normals closes
            continue
    return tuple(out)


def _beside(region: Region) -> list[list[int]]:
    """For every face those with which it shares an edge."""
    faces = range(len(region.normals))
    return [[b for b in faces if b != a and len(region.edge(a, b)) == 2] for a in faces]


def _closed(beside: list[list[int]], count: int) -> Iterator[tuple[int, ...]]:
    """Ways of which the first face is the least."""
    for first in range(len(beside)):
        stack: list[tuple[int, ...]] = [(first,)]
        while stack:
            way = stack.pop()
            if len(way) == count:
                if way[0] in beside[way[-1]]:
                    yield way
                continue
            stack += [(*way, b) for b in reversed(beside[way[-1]]) if b >= first]


def _least(way: tuple[int, ...], turns: list[Any]) -> tuple[int, ...]:
    """The least of all ways that are the same one."""
    best = None
    for turn in turns:
        image = tuple(int(turn[f]) for f in way)
        low = min(image)
        for one in (image, image[::-1]):
            for k, face in enumerate(one):
                if face == low:
                    new = one[k:] + one[:k]
                    best = new if best is None or new < best else best
    assert best is not None
    return best


def _symmetries(region: Region) -> list[Any]:
    """Permutations of the faces by isometries that permute axes and turn them over."""
    middle = 0.5 * (region.corners.min(axis=0) + region.corners.max(axis=0))
    rows = np.column_stack([region.normals, region.offsets - region.normals @ middle])
    found = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            image = rows.copy()
            image[:, :3] = rows[:, order] * signs
            off = np.abs(image[:, None] - rows[None]).max(axis=2)
            if (off.min(axis=1) < 1e-9).all():
                found.append(off.argmin(axis=1))
    return found
