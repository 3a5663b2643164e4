"""Air between solid that is too thin to be resolved, so that it is bridged: where, and how wide.

Guarantee: gaps that are as good as plane in a thirtieth of a cell are found in all directions; what
is told of their width is right to a factor of two; and so is where bodies touch along an edge, in
any direction, of which the width that is told is that of the air beside it; bodies of a hundredth
of a cell or more that hang on the rest by such air alone are told of, too. Non-guarantees: such
bodies count as joined; the tip of a notch in a cell or two is not told if nothing hangs on it, and
of two phases bodies of less than a cell are not.
"""

import warnings

import numpy as np
from scipy.ndimage import label

from ilattice._typing import FloatArray, IntArray
from ilattice.cutfem.connectivity import Parts, connected_parts, falls_apart, links
from ilattice.cutfem.elements import ElementGrid, unbridged
from ilattice.errors import PrecisionWarning
from ilattice.quadrature.cutting import CutGrid
from ilattice.quadrature.rules import Quadrature

#: Cells side by side through which air that is not resolved goes, from which on that is told.
MANY = 3
#: Volume in cells of a body from which on it is told that air that is not resolved is around it.
BODY = 0.01


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
    """Gaps of air that go through many cells, or all if parts or bodies hang together there."""
    gaps = elements.gaps
    cells = gaps[:, 0].astype(np.int64)
    if not len(cells):
        return gaps
    home = elements.home(parts.cells)
    if falls_apart(parts, links(joints), home, cells):
        return gaps
    if isinstance(elements, ElementGrid) and _hangs_on_air(elements, parts, cells):
        return gaps
    alone = gaps[gaps[:, 4] > 0.0]
    cells = alone[:, 0].astype(np.int64)
    mark = np.zeros(cut.grid.shape, bool)
    mark.ravel()[cells] = True
    groups, count = label(mark)
    many = np.bincount(groups[mark], minlength=count + 1)
    return np.asarray(alone[many[groups.ravel()[cells]] >= MANY])


def _hangs_on_air(elements: ElementGrid, parts: Parts, cells: IntArray) -> bool:
    """Whether there would be more bodies if nothing uncertain in some cells joined them."""
    grid, rule = unbridged(elements, parts.solid, cells)
    facets = tuple(grid.divided(elements.cut.faces(axis, 1)) for axis in range(3))
    found = connected_parts(rule, facets)
    counts = []
    for some in (parts, found):
        boxes = some.solid.grid.boxes(some.cells)[:, 3:].prod(axis=1)
        volumes = np.bincount(some.labels, some.solid.integrate_cells() / boxes, len(some))
        counts.append(int((volumes >= BODY).sum()))
    return counts[1] > counts[0]


def across(air: FloatArray) -> FloatArray:
    """Width of a plane gap by its lengths (..., 3) along three directions, 0 if it goes on."""
    slopes = np.divide(1.0, air, out=np.zeros_like(air), where=air > 0.0)
    return np.asarray(1.0 / np.linalg.norm(slopes, axis=-1))
