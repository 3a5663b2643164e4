"""Volumes of fields by random points, two in each of many boxes, with their statistical error.

First all boxes of a grid are looked into, next those of one that should be fine enough: points cost
less than bounds. After that boxes that the bounds of the field show to be inside count as a whole,
those outside not at all; the others are halved each way until they would be too many.

Guarantees: no bias, whatever the field; the same points every time. Non-guarantees: the error is
estimated as well; parts smaller than boxes are seen by chance only where a field has no bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from ilattice._geometry import CORNERS, grid_indices, pairs
from ilattice._typing import FloatArray, IntArray

#: Boxes to begin with, the most along an axis then, and the most that are looked into.
FIRST, LONGEST, MAX_BOXES = 18**3, 64, 1 << 18
#: Grids of boxes that are looked into without bounds, and how much finer each is each way at least.
GRIDS, FINER = 3, 1.5
#: Points whose weight the standard error is at least: of rare parts none may be seen.
FEW = 3.0


class Sampled(NamedTuple):
    """A volume by random points.

    Attributes
    ----------
    volume, error : float
        The volume, and its standard error: at least a few points' weight.
    """

    volume: float
    error: float


def volumes(
    field: Any, box: FloatArray, sides: FloatArray, det: Callable[[FloatArray], FloatArray] | None,
    wanted: float,
) -> Iterator[Sampled]:  # fmt: skip
    """Ever better estimates of the volume where a field is negative.

    Parameters
    ----------
    field : Field
        The field.
    box : ndarray, shape (2, 3)
        Where to look.
    sides : ndarray, shape (3,)
        Lengths of its sides in space.
    det : callable, optional
        Volumes in space per volume of the box, shape (n,), at points (n, 3); one if None.
    wanted : float
        Error, as a part of the volume, that is tried for at once.

    Yields
    ------
    Sampled
        The volume.
    """
    rng = np.random.default_rng(0)
    h = (np.prod(sides) / FIRST) ** (1.0 / 3.0)
    first = count = np.clip(np.rint(sides / h), 1, LONGEST).astype(int)
    most = 0
    for _ in range(GRIDS):
        found = _looked_into(field, *_grid(box, count), det, rng)
        yield found
        most = int(np.prod(count))
        more = (found.error / (wanted * found.volume)) ** 0.5 if found.volume > 0.0 else LONGEST
        count = np.ceil(count * max(FINER, min(more, LONGEST))).astype(int)  # as h² in the error
        if np.prod(count) > MAX_BOXES:
            break
    whole, boxes, (lo, size) = 0.0, int(np.prod(first)), _grid(box, first)
    while True:
        bounds = field.range(lo, lo + size)
        inside, cut = bounds[:, 1] < 0.0, (bounds[:, 0] <= 0.0) & (bounds[:, 1] >= 0.0)
        whole += _weights(pairs(lo[inside], lo[inside] + size, rng), size, det).sum()
        lo = lo[cut]
        if boxes > most or len(lo) == 0:
            found = _looked_into(field, lo, size, det, rng)
            yield Sampled(float(whole + found.volume), found.error)
        if len(lo) == 0 or 8 * len(lo) > MAX_BOXES:
            return
        size, boxes = 0.5 * size, 8 * boxes
        lo = (lo[:, None] + CORNERS * size).reshape(-1, 3)


def _grid(box: FloatArray, count: IntArray) -> tuple[FloatArray, FloatArray]:
    """Lower corners (n, 3) and size (3,) of so many boxes each way."""
    size = (box[1] - box[0]) / count
    return box[0] + grid_indices(count) * size, size


def _looked_into(
    field: Any, lo: FloatArray, size: FloatArray, det: Any, rng: np.random.Generator
) -> Sampled:
    """The volume in boxes by two points in each."""
    u = pairs(lo, lo + size, rng)
    weight = _weights(u, size, det)
    part = np.where(field(u) < 0.0, weight, 0.0).reshape(-1, 2)
    error = np.linalg.norm(part[:, 0] - part[:, 1])
    return Sampled(float(part.sum()), float(max(error, FEW * weight.max(initial=0.0))))


def _weights(u: FloatArray, size: FloatArray, det: Any) -> FloatArray:
    """What points (2 n, 3) in boxes stand for."""
    one = 0.5 * float(np.prod(size))
    return np.full(len(u), one) if det is None else one * np.abs(det(u))
