"""Fields made fit for splines: the same zero set, with neither cones nor creases away from it.

Guarantee: values and slopes on the zero set are those of the field, whatever the reach.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ilattice._field import Field
from ilattice._geometry import grid_points
from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import as_array, as_items
from ilattice.errors import InputError


class Limited(Protocol):
    """A field on the unit cube that is found as far as it is below a limit: a `SkeletonField`."""

    @property
    def bounds(self) -> FloatArray:
        """The unit cube, shape (2, 3)."""

    def up_to(self, limit: float, u: ArrayLike) -> FloatArray:
        """Values (n,) at points (n, 3) as far as they are below a limit."""


@dataclass(frozen=True, eq=False)
class FlattenedField(Field):
    """A field with the same zero set and slope there, constant away from it.

    With s = (f - level) / reach it is ``reach (s - 2 s³/3 + s⁵/5)`` for |s| <= 1, constant beyond.
    A skeleton is no place for a spline: distances have cones there, and creases halfway between
    arms. This function has neither if `reach` is at most the radius.

    Attributes
    ----------
    field : SkeletonField
        The field.
    level : float
        Level of the zero set.
    reach : float
        Distance from the zero set at which it becomes constant.
    """

    field: Limited
    level: float
    reach: float

    def __call__(self, u: ArrayLike, /) -> FloatArray:
        """Values, shape (n,), at points ``u`` (n, 3)."""
        return self._flat(self.field.up_to(self.level + self.reach, u))

    @property
    def bounds(self) -> FloatArray:
        """The unit cube, shape (2, 3)."""
        return self.field.bounds

    def grid(self, axes: Iterable[ArrayLike]) -> FloatArray:
        """Values on a tensor grid.

        Parameters
        ----------
        axes : iterable of array_like
            Three 1-D arrays of coordinates.

        Returns
        -------
        ndarray
            Values.
        """
        p, shape = points_of_grid(axes)
        return self(p).reshape(shape)

    def _flat(self, f: FloatArray) -> FloatArray:
        s = np.clip((f - self.level) / self.reach, -1.0, 1.0)
        q = s * s
        return self.reach * s * (1.0 - q * (2.0 / 3.0 - 0.2 * q))


def points_of_grid(axes: Iterable[ArrayLike]) -> tuple[FloatArray, tuple[int, ...]]:
    """Points of a tensor grid, and its shape."""
    xyz = [as_array(f"axes[{i}]", a, ndim=1) for i, a in enumerate(as_items("axes", axes))]
    if len(xyz) != 3:
        raise InputError(f"axes must be three 1-D arrays, got {len(xyz)}")
    p = grid_points(*xyz)
    return p, tuple(len(a) for a in xyz)
