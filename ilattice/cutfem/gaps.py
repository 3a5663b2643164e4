"""Air between solid that is too thin to be resolved, so that it is bridged: where, and how wide.

Guarantee: gaps that are as good as plane in a thirtieth of a cell are found in all directions; what
is told of their width is right to a factor of two; and so is where bodies touch along an edge, in
any direction, of which the width that is told is that of the air beside it. Non-guarantees: such
bodies count as joined; the tip of a notch in a cell or two is not told if nothing hangs on it.
"""

import warnings

import numpy as np
from scipy.ndimage import label

from ilattice._typing import FloatArray
from ilattice.cutfem.connectivity import Parts, falls_apart, links
from ilattice.cutfem.elements import ElementGrid
from ilattice.errors import PrecisionWarning
from ilattice.quadrature.cutting import CutGrid
from ilattice.quadrature.rules import Quadrature

#: Cells side by side through which air that is not resolved goes, from which on that is told.
MANY = 3


def warn(cut: CutGrid, elements: ElementGrid, parts: Parts, joints: tuple[Quadrature, ...]) -> None:
    """Warn of the widest gap of a solid, with place and width.

    Parameters
    ----------
    cut, elements, parts, joints
        Those of a `Domain`.

    Warns
    -----
    PrecisionWarning
        If there is one.
    """
    gaps = long(cut, elements, parts, joints)
    if not len(gaps):
        return
    widest = int(np.argmax(across(gaps[:, 1:4])))
    box = cut.grid.boxes(gaps[[widest], 0].astype(np.int64))
    middle, extent, through = box[:, :3] + 0.5 * box[:, 3:], box[0, 3:], cut.through
    x = middle if through is None else through.x(middle)
    edges = np.eye(3) if through is None else through.jacobian(middle)[0]
    air = np.linalg.norm(edges, axis=0) * extent * gaps[widest, 1:4]
    place = ", ".join(f"{c:.4g}" for c in x[0])
    warnings.warn(
        f"a gap of {across(air):.2g}, {across(gaps[widest, 1:4]):.2g} cells, near ({place}) is too "
        f"thin to be resolved, in {len(gaps)} {'cell' if len(gaps) == 1 else 'cells'}: the solid "
        "on both sides is taken as one; widen the gap, close it, or take finer cells",
        PrecisionWarning,
        stacklevel=6,
    )


def long(
    cut: CutGrid, elements: ElementGrid, parts: Parts, joints: tuple[Quadrature, ...]
) -> FloatArray:
    """Gaps of air that go through many cells, or all gaps if parts hang together there."""
    gaps = elements.gaps
    cells = gaps[:, 0].astype(np.int64)
    if not len(cells):
        return gaps
    home = elements.home(parts.cells)
    if falls_apart(parts, links(joints), home, cells):
        return gaps
    alone = gaps[gaps[:, 4] > 0.0]
    cells = alone[:, 0].astype(np.int64)
    mark = np.zeros(cut.grid.shape, bool)
    mark.ravel()[cells] = True
    groups, count = label(mark)
    many = np.bincount(groups[mark], minlength=count + 1)
    return np.asarray(alone[many[groups.ravel()[cells]] >= MANY])


def across(air: FloatArray) -> FloatArray:
    """Width of a plane gap by its lengths (..., 3) along three directions, 0 if it goes on."""
    slopes = np.divide(1.0, air, out=np.zeros_like(air), where=air > 0.0)
    return np.asarray(1.0 / np.linalg.norm(slopes, axis=-1))
