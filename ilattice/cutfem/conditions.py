"""Loads and supports, as given: checked at the door, evaluated when a system is made.

Guarantee: values are numbers, vectors, or functions of points of space (n, 3); functions are
checked for shape and for being finite where they are used.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice._validate import Frozen, among, as_array, as_items, asked, check_finite
from ilattice.cutfem.places import Motion, Spot
from ilattice.cutfem.regions import Region
from ilattice.errors import InputError

if TYPE_CHECKING:
    from ilattice.cutfem.assembly import Assembly

Value = float | Sequence[float] | Callable[[FloatArray], Any]
AXES = "xyz"


class Known(ABC):
    """A field that is known in a solid, such as a temperature: a value of loads."""

    @abstractmethod
    def _within(self, asm: "Assembly", u: FloatArray) -> FloatArray:
        """Values (n,) where parameters (n, 3) of another problem are in space; NaN if unknown."""


@dataclass(frozen=True, eq=False)
class Support(Frozen):
    """Prescribed components on a place, exactly or by Nitsche's method.

    Attributes
    ----------
    on : str or Region
        Place.
    mask : ndarray of bool, shape (m,)
        Components that are prescribed.
    value : Value
        What they are.
    weak : bool
        Nitsche's method.
    normal : bool
        Only the part along the normal is prescribed, wherever that points.
    """

    on: str | Region
    mask: Any
    value: Value
    weak: bool
    normal: bool = False


@dataclass(frozen=True, eq=False)
class Spring(Frozen):
    """Stiffness per area towards a value: springs, or convection.

    Attributes
    ----------
    on : str or Region
        Place.
    stiffness : Value
        One number, or one per component.
    value : Value
        Where the spring is at rest; for convection the temperature around.
    """

    on: str | Region
    stiffness: Value
    value: Value


@dataclass(frozen=True, eq=False)
class Load(Frozen):
    """A load of one kind.

    Attributes
    ----------
    kind : str
        "body", "gravity", "traction", "force", "moment", "pressure" or "temperature"; of heat
        "flux" or "source".
    value : Value or Known
        Force per volume, acceleration, force per area, force, moment, pressure; temperature above
        the stress-free one; heat per area and time, heat per volume and time.
    on : str, Region or Spot
        Place of tractions, pressures and fluxes, or point of a force.
    """

    kind: str
    value: "Value | Known"
    on: str | Region | Spot = ""

    def at(self, x: FloatArray, m: int) -> FloatArray:
        """Values (n, m) at points of space, of what is no known field."""
        assert not isinstance(self.value, Known)
        return values_at(self.kind, self.value, x, m)


@dataclass(frozen=True, eq=False)
class Connection(Frozen):
    """A place that moves as a rigid body.

    Attributes
    ----------
    on : str or Region
        Place.
    force, moment : ndarray, shape (3,)
        What acts on it, the moment about `about`.
    about : ndarray, shape (3,)
        Point of space at which the force acts.
    motion : Motion or None
        How it moves, in problems of solutions.
    """

    on: str | Region
    force: FloatArray
    moment: FloatArray
    about: FloatArray
    motion: Motion | None = None

    @property
    def work(self) -> float:
        """That of force and moment on the motion."""
        if self.motion is None:
            return 0.0
        return float(self.force @ self.motion.translation + self.moment @ self.motion.rotation)


def as_mask(components: Any, m: int) -> Any:
    """Components, such as ``"xz"``, ``(0, 2)`` or None for all, as booleans."""
    if components is None:
        return np.ones(m, bool)
    text = isinstance(components, str)
    given = components if text else as_items("components", components)
    listed = [AXES.find(c) if isinstance(c, str) else c for c in given]
    if not listed or not all(among(c, range(m)) for c in listed):
        raise InputError(
            f"components must name some of {AXES[:m]!r}, be 'n' for the one along the normal, or "
            f"numbers below {m}, got {components!r}"
        )
    if len(set(listed)) < len(listed):
        raise InputError(f"components must name each component once, got {components!r}")
    mask = np.zeros(m, bool)
    mask[np.array(listed, int)] = True
    return mask


def as_value(name: str, value: Any, m: int) -> Value:
    """A number, m numbers, or a function; anything else is refused."""
    if callable(value):
        return value
    a = as_array(name, value)
    if a.size not in (1, m):
        raise InputError(
            f"{name} must be {'a number' if m == 1 else f'one number or {m}'}, or a function of "
            f"points (n, 3), got {value!r:.80}"
        )
    return tuple(np.broadcast_to(a.ravel(), (m,)).tolist())


def values_at(name: str, value: Value, x: FloatArray, m: int) -> FloatArray:
    """Values (n, m) at points of space."""
    a = as_array(name, asked(name, value, x) if callable(value) else value, finite=False)
    if callable(value) and a.shape == (len(x),) and m == 1:
        a = a[:, None]
    if callable(value) and a.shape != (len(x), m):
        shape = f"({len(x)},)" if m == 1 else f"({len(x)}, {m})"
        raise InputError(f"{name} must give values of shape {shape}, got {a.shape}")
    return check_finite(name, np.array(np.broadcast_to(a, (len(x), m))))


def stiffness_at(name: str, value: Value, x: FloatArray, m: int) -> FloatArray:
    """Values (n, m) at points of space, of which none may be negative."""
    k = values_at(name, value, x, m)
    if k.min(initial=0.0) < 0:
        worst = int(np.argmin(k.min(axis=1)))
        place = np.round(x[worst], 6).tolist()
        raise InputError(f"{name} must not be negative, got {k[worst].min():g} at {place}")
    return k
