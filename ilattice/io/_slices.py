"""What the writers of slices share: checks, units, and numbers as text."""

from collections.abc import Iterator, Sequence
from typing import Any, Protocol

import numpy as np

from ilattice._typing import FloatArray
from ilattice._validate import near_names
from ilattice.errors import InputError

#: Millimetres per unit, and its short name.
MILLIMETRES = {
    "micron": (1e-3, "um"),
    "millimeter": (1.0, "mm"),
    "centimeter": (10.0, "cm"),
    "inch": (25.4, "in"),
    "foot": (304.8, "ft"),
    "meter": (1000.0, "m"),
}
_DIGITS = 8


class Section(Protocol):
    """One layer, as writers take it: a `Slice`."""

    @property
    def height(self) -> float:
        """Where the plane cuts."""

    @property
    def bounds(self) -> FloatArray:
        """Box around the polygons, shape (2, 2)."""

    @property
    def top(self) -> float:
        """Upper end of the layer."""

    @property
    def polygons(self) -> Sequence[tuple[FloatArray, Sequence[FloatArray]]]:
        """Outer contour (n, 2) and holes of each part."""


class Stack(Protocol):
    """Layers, as writers take them: a `SliceStack`."""

    @property
    def part(self) -> Any:
        """What is cut."""

    @property
    def slicer(self) -> Any:
        """What cuts it, and gives `Triangles` by its ``approximation()``."""

    @property
    def bounds(self) -> FloatArray:
        """Box around all layers in the directions of `frame`, shape (2, 3)."""

    @property
    def frame(self) -> FloatArray:
        """Two directions in the layers and their normal, shape (3, 3)."""

    @property
    def bottom(self) -> float:
        """Lower end of the lowest layer."""

    def __len__(self) -> int: ...

    def __iter__(self) -> Iterator[Any]: ...


def as_unit(unit: Any) -> str:
    """`unit` itself if it is known."""
    if unit not in MILLIMETRES:
        names = near_names(str(unit), [*MILLIMETRES], 6)
        raise InputError(f"unit {unit!r} is unknown; choose {names}")
    return str(unit)


def decimals(bounds: FloatArray) -> int:
    """Places after the point that keep eight digits of the largest coordinate."""
    largest = max(float(np.abs(bounds).max()), 1e-30)
    return int(np.clip(_DIGITS - 1 - np.floor(np.log10(largest)), 0, 16))


def join(points: FloatArray, places: int, before: str, between: str, after: str) -> str:
    """Text of points (n, 2): `before` x `between` y `after`, one after the other."""
    return (f"{before}%.{places}f{between}%.{places}f{after}" * len(points)) % tuple(points.flat)


def contours(section: Section) -> Iterator[tuple[FloatArray, bool]]:
    """Contours of a slice, and whether they are outer ones."""
    for outer, holes in section.polygons:
        yield outer, True
        for hole in holes:
            yield hole, False
