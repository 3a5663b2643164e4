"""Array aliases and the protocols of the seams between rooms.

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
class Solid(Protocol):
    """What can be meshed, sliced, analysed and homogenized: walls, and every other source.

    The seam between sources and what is done with them: level sets over a box of parameters, the
    map to space, a name.
    """

    @property
    def name(self) -> str:
        """Name for messages and reports."""

    @property
    def through(self) -> Any:
        """Map from the parameters to space, or None if they are coordinates of space."""

    def level_sets(self) -> Any:
        """What is negative in the solid: a field, or a pair of fields."""


@runtime_checkable
class NamedProperties(Protocol):
    """What has properties with names, as functions of parameters: a lattice, or what is like it.

    A solid says by `named_properties` where those of its material come from.
    """

    @property
    def domain(self) -> FloatArray:
        """The box of parameters, shape (2, 3)."""

    def property_at(self, name: str, u: FloatArray) -> FloatArray:
        """Values (n,) at parameters (n, 3), or an error of a name that is not known."""


@runtime_checkable
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

    def boxes(self, lo: ArrayLike, hi: ArrayLike) -> FloatArray:
        """Boxes of space, shape (m, 2, 3), that hold the images of boxes with corners (m, 3)."""

    def inverse(self, x: ArrayLike) -> FloatArray:
        """Parameters, shape (n, 3); rows of NaN where ``x`` is outside the image."""
