"""What the writers of slices share: checks, units, and numbers as text."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice._validate import near_names
from ilattice.errors import InputError
from ilattice.slicing.slices import Slice

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


def contours(section: Slice) -> Iterator[tuple[FloatArray, bool]]:
    """Contours of a slice, and whether they are outer ones."""
    for outer, holes in section.polygons:
        yield outer, True
        for hole in holes:
            yield hole, False
