"""Whether edges of a mesh are short enough for the law of the thickness: peaks between its planes.

Guarantee: at random points of the domain the half-thickness is compared with that between the
corners of their cells. Non-guarantee: peaks in less than a thousandth of the domain may be missed.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

from ilattice._geometry import CORNERS
from ilattice._typing import FloatArray
from ilattice.errors import PrecisionWarning

if TYPE_CHECKING:
    from ilattice.offsets.wall import OffsetSolid

#: Random points, and the part of the half-thickness that may be lost between planes.
POINTS, TOLD = 4096, 0.1


def warn_between(wall: OffsetSolid, axes: tuple[FloatArray, ...], h: float) -> None:
    """Warn of a thickness that varies within cells of a grid.

    Parameters
    ----------
    wall : OffsetSolid
        The wall.
    axes : three 1-D arrays
        The grid planes.
    h : float
        Length of edges that they are made for.
    """
    if wall.thickness.constant:
        return
    cell = np.stack([np.random.default_rng(a).integers(len(axes[a]) - 1, size=POINTS)
                     for a in range(3)], axis=1)  # fmt: skip
    part = np.random.default_rng(3).random((POINTS, 3))
    lo = np.stack([axes[a][cell[:, a]] for a in range(3)], axis=1)
    size = np.stack([np.diff(axes[a])[cell[:, a]] for a in range(3)], axis=1)
    corners = (lo[:, None] + CORNERS * size[:, None]).reshape(-1, 3)
    weight = np.where(CORNERS, part[:, None], 1.0 - part[:, None]).prod(axis=2)
    worst, off = 0.0, 0.0
    for sign in (1.0,) if wall.thickness.solid else (1.0, -1.0):
        here = wall._asked.at(lo + part * size, np.full(POINTS, sign))
        around = wall._asked.at(corners, np.full(len(corners), sign)).reshape(-1, 8)
        error = np.abs((around * weight).sum(axis=1) - here)
        relative = error / np.maximum(np.abs(here), 0.5 * wall.least_thickness)
        if relative.max() > worst:
            worst, off = float(relative.max()), float(error[relative.argmax()])
    if worst > TOLD:
        warnings.warn(
            f"the half-thickness changes within edges of h={h:.3g}: it is {off:.2g} ({worst:.0%}) "
            "off there if taken from their ends, and narrow peaks are lost; use a smaller h",
            PrecisionWarning,
            stacklevel=4,
        )
