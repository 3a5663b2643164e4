"""Volumes of fields by random points, two in each of many boxes, with their statistical error.

Boxes that the bounds of the field show to be inside count as a whole, those outside not at all; the
others are halved each way until the error is small enough, or they would be too many.

Guarantees: no bias, whatever the field; the same points every time. Non-guarantees: the error is
estimated as well; parts smaller than boxes are seen by chance only where a field has no bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from ilattice._geometry import CORNERS, grid_indices, pairs
from ilattice._typing import FloatArray

#: Boxes to begin with, the most along an axis then, and the most that are looked into.
FIRST, LONGEST, MAX_BOXES = 1 << 12, 64, 1 << 18
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
    field: Any, box: FloatArray, sides: FloatArray, det: Callable[[FloatArray], FloatArray] | None
) -> Iterator[Sampled]:
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

    Yields
    ------
    Sampled
        The volume.
    """
    rng = np.random.default_rng(0)
    h = (np.prod(sides) / FIRST) ** (1.0 / 3.0)
    count = np.clip(np.rint(sides / h), 1, LONGEST).astype(int)
    size = (box[1] - box[0]) / count
    lo = box[0] + grid_indices(count) * size
    whole = 0.0
    while True:
        bounds = field.range(lo, lo + size)
        inside, cut = bounds[:, 1] < 0.0, (bounds[:, 0] <= 0.0) & (bounds[:, 1] >= 0.0)
        whole += _weights(pairs(lo[inside], lo[inside] + size, rng), size, det).sum()
        lo = lo[cut]
        u = pairs(lo, lo + size, rng)
        weight = _weights(u, size, det)
        part = np.where(field(u) < 0.0, weight, 0.0).reshape(-1, 2)
        error = np.linalg.norm(part[:, 0] - part[:, 1])
        yield Sampled(float(whole + part.sum()), float(max(error, FEW * weight.max(initial=0.0))))
        if len(lo) == 0 or 8 * len(lo) > MAX_BOXES:
            return
        size = 0.5 * size
        lo = (lo[:, None] + CORNERS * size).reshape(-1, 3)


def _weights(u: FloatArray, size: FloatArray, det: Any) -> FloatArray:
    """What points (2 n, 3) in boxes stand for."""
    one = 0.5 * float(np.prod(size))
    return np.full(len(u), one) if det is None else one * np.abs(det(u))
