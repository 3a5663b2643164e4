"""What the mesh of a field has lost or gained: its volume against that of the field.

Guarantee: a mesh whose volume is off by more than `REFUSED`, beyond three standard errors of the
volume at random points (`ilattice.mesh.sampled`), is refused, and told of from `TOLD` on.
Non-guarantee: less than that, and less than those errors: of fields without bounds that fill a
hundredth of their box, about 4 %.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice.errors import GeometryError, PrecisionWarning
from ilattice.mesh.loss import REFUSED
from ilattice.mesh.sampled import volumes

#: Part of the volume from which on it is told.
TOLD = 0.02
#: Standard errors within which volumes are not told apart.
ERRORS = 3.0
#: How much smaller than that part errors should be, so that what a good mesh is off seldom tells.
NEARER = 5.5
#: Part of the volume that a mesh with the recommended spacing may be off by, and the least part of
#: the spacing that is recommended: what is lost altogether tells little of what is enough.
MEANT, MIN_SPACING = 0.01, 0.25


def check_loss(
    field: Any,
    box: FloatArray,
    sides: FloatArray,
    h: float,
    got: float,
    *,
    allowed: bool,
    det: Callable[[FloatArray], FloatArray] | None = None,
) -> None:
    """Compare the volume of a mesh with that of the field it was made of.

    Parameters
    ----------
    field : Field
        The field.
    box : ndarray, shape (2, 3)
        The box that was meshed.
    sides : ndarray, shape (3,)
        Lengths of its sides in space.
    h : float
        Spacing of the mesh.
    got : float
        Volume of the mesh.
    allowed : bool
        Whether to warn only, however much is lost.
    det : callable, optional
        See `ilattice.mesh.sampled.volumes`.

    Raises
    ------
    GeometryError
        If more than `REFUSED` of the volume is lost or gained, unless that is allowed.
    """
    whole, near, off = 0.0, 0.0, 0.0
    for whole, error in volumes(field, box, sides, det, TOLD / NEARER):
        near = ERRORS * error
        off = max(abs(got - whole) - near, 0.0)
        if abs(got - whole) + near <= TOLD * whole:
            return
        if off > REFUSED * whole and near <= TOLD * whole:
            break
    if off <= TOLD * whole:
        return
    part = (got - whole) / whole if whole > 0.0 else np.inf
    enough = h * max(MIN_SPACING, 0.9 * (MEANT / abs(part)) ** 0.5)
    message = (
        f"the mesh with spacing {h:.3g} has the volume {got:.6g}, {100 * abs(part):.2g} % "
        f"{'less' if part < 0.0 else 'more'} than the solid ({whole:.5g} +- {near:.1g} at random "
        "points): parts are thinner than a spacing, or bend within it; "
        f"try a spacing of {enough:.2g}"
    )
    if off > REFUSED * whole and not allowed:
        raise GeometryError(f"{message}, or allow_loss=True")
    warnings.warn(message, PrecisionWarning, stacklevel=4)
