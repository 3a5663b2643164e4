"""Array aliases and the protocols of the few central types.

Guarantee: every public function states shapes in terms of these. Points are rows.
"""

from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
AnyArray = npt.NDArray[Any]
ArrayLike = npt.ArrayLike


@runtime_checkable
class Field(Protocol):
    """A real function of space, negative inside."""

    def __call__(self, p: ArrayLike, /) -> FloatArray:
        """Value, shape (n,), at points ``p`` of shape (n, 3)."""

    @property
    def bounds(self) -> FloatArray:
        """Box that holds the zero set, shape (2, 3): rows are the lower and the upper corner."""


@runtime_checkable
class SmoothField(Field, Protocol):
    """A field with derivatives."""

    def jet(self, p: ArrayLike, order: int = 2) -> tuple[FloatArray, ...]:
        """Value (n,), gradient (n, 3) and Hessian (n, 3, 3): the first ``order + 1`` of them."""


@runtime_checkable
class BoundedField(Field, Protocol):
    """A field with rigorous bounds of its values on boxes."""

    def range(self, lo: ArrayLike, hi: ArrayLike) -> FloatArray:
        """Lower and upper bound, shape (m, 2), on boxes with corners ``lo``, ``hi`` (m, 3)."""


class Map(Protocol):
    """A map from the parameter box D to space, with optional further coordinates."""

    @property
    def domain(self) -> FloatArray:
        """The box D, shape (2, 3): rows are the lower and the upper corner."""

    def x(self, u: ArrayLike) -> FloatArray:
        """Points of space, shape (n, 3)."""

    def jacobian(self, u: ArrayLike) -> FloatArray:
        """First derivatives, shape (n, 3, 3): ``J[:, c, k] = dx_c / du_k``."""

    def hessian(self, u: ArrayLike) -> FloatArray:
        """Second derivatives, shape (n, 3, 3, 3), component first."""

    def inverse(self, x: ArrayLike) -> FloatArray:
        """Parameters, shape (n, 3); rows of NaN where ``x`` is outside the image."""
