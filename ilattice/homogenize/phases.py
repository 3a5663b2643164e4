"""What arrays of voxels mean: labels, fill fractions, or factors of a property.

=====================  =====================  ================================================
array                  property               a voxel has
=====================  =====================  ================================================
bool, or 0 and 1       one number             it, or `VOID` times it
bool, or integers      two or more            that of its label
numbers from 0 to 1    a pair                 the mean of both, weighed by the fill fraction
numbers from 0 on      one number             it times the number
=====================  =====================  ================================================

The mean of stiffnesses in partly filled voxels is Voigt's: it comes from above, and so does what is
computed with it.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ilattice._typing import AnyArray, FloatArray
from ilattice._validate import as_array, check_finite
from ilattice.errors import GeometryError, InputError

#: What voids have of the property of the solid, where one number is given.
VOID = 1e-6
#: Voxels count as solid with more than this part of the largest property.
SOLID = 1e-4
#: Largest number of labels.
MAX_LABELS = 1 << 20


@dataclass(frozen=True, eq=False)
class Labelled:
    """Voxels by phases.

    Attributes
    ----------
    phase : ndarray of int32, shape (n0, n1, n2)
        Number of the phase of every voxel.
    weights : ndarray, shape (phases, k)
        Parts of the k given properties in each phase.
    values : ndarray, shape (k,)
        The properties: the first one that was given.
    filled : float
        Part of all voxels that is solid.
    """

    phase: AnyArray
    weights: FloatArray
    values: FloatArray
    filled: float

    @property
    def fractions(self) -> FloatArray:
        """Part of all voxels that is of each phase."""
        counts = np.bincount(self.phase.ravel(), minlength=len(self.weights))
        return counts / self.phase.size

    def mixed(self, properties: FloatArray) -> FloatArray:
        """Rows of phases of rows (k, m) of the given properties."""
        return self.weights @ properties


def labelled(
    array: Any, name: str, value: Any, *, zero: bool = True, void: float = VOID
) -> Labelled:
    """An array of voxels by phases.

    Parameters
    ----------
    array : array_like, shape (n0, n1, n2)
        As in the table above.
    name : str
        Of the property.
    value : float, or sequence of floats
        The property, of phases.
    zero : bool
        Whether it may be zero.
    void : float
        What voids have of the property of the solid, where one number is given.

    Returns
    -------
    Labelled
        Phases and what they are.

    Raises
    ------
    InputError
        If array and property do not fit together.
    GeometryError
        If there is no solid.
    """
    a = np.asarray(array)
    if a.ndim != 3 or a.size == 0 or a.dtype.kind not in "biuf":
        raise InputError(
            f"array must hold numbers or flags of voxels in three directions, got shape {a.shape} "
            f"of {a.dtype}"
        )
    values = as_array(name, value).ravel()
    if np.ndim(value) > 1 or not len(values):
        raise InputError(f"{name} must be one number or one per phase, got {value!r:.80}")
    if (values < 0).any() or not (zero or (values > 0).all()) or not values.max() > 0:
        raise InputError(f"{name} must not be negative, and not all zero, got {value!r:.80}")
    if a.dtype.kind == "f":
        check_finite("array", a)
        if len(values) > 2 and (a == np.rint(a)).all():
            a = a.astype(np.int64)
    number = a.dtype.kind == "f"
    out = _of_numbers(a, name, values) if number else _of_labels(a, name, values, void)
    if not (out.fractions @ out.mixed(out.values) > 0.0):
        raise GeometryError(
            f"array has no solid: {name} is zero in all voxels, of {name}={value!r:.80}"
        )
    return out


def _of_labels(a: AnyArray, name: str, values: FloatArray, void: float) -> Labelled:
    least, most = int(a.min()), int(a.max())
    if len(values) == 1:
        if least < 0 or most > 1:
            raise InputError(
                f"{name} is one number, but array has labels from {least} to {most}: give one per "
                "label, or an array of flags"
            )
        if most == 0:
            raise GeometryError("array has no solid: all voxels are void")
        values = np.array([void, 1.0]) * values
    if least < 0 or most >= min(len(values), MAX_LABELS):
        raise InputError(
            f"array has labels from {least} to {most}, but {name} has {len(values)} values, of "
            f"labels from 0 to {len(values) - 1}"
        )
    phase = np.ascontiguousarray(a, np.int32)
    used = np.bincount(phase.ravel(), minlength=len(values)) > 0
    solid = values > SOLID * values[used].max()
    return Labelled(phase, np.eye(len(values)), values, float(solid[phase].mean()))


def _of_numbers(a: AnyArray, name: str, values: FloatArray) -> Labelled:
    least, most = float(a.min()), float(a.max())
    if least < 0 or (len(values) == 2 and most > 1) or len(values) > 2:
        told = "fill fractions from 0 to 1" if len(values) == 2 else "factors from 0 on"
        raise InputError(
            f"array of numbers from {least:g} to {most:g} with {len(values)} values of {name}: "
            f"give {told}, or an array of integers for labels"
        )
    if not most * values.max() > 0 and len(values) == 1:
        raise GeometryError("array has no solid: all voxels are zero")
    found, phase = np.unique(a.astype(np.float64), return_inverse=True)
    phase = np.ascontiguousarray(phase.reshape(a.shape), np.int32)
    if len(values) == 1:
        filled = float((a > SOLID * most).mean())
        return Labelled(phase, found[:, None], values, filled)
    return Labelled(phase, np.stack([1.0 - found, found], axis=1), values, float(a.mean()))
