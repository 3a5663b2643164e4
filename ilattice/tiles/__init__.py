"""Sources of fields on the unit cube: surfaces, struts and plates, curves, own functions.

`Tile` wraps any field; the catalogue is at hand by subscript and by attribute::

    il.tiles["gyroid"]  # or "G", "schoen-gyroid", ...
    il.tiles.schwarz_p(level=0.2)
    il.tiles.octet(radius=0.05)
    il.tiles.skeleton([curve, surface, [(0, 0.5, 0.5), (1, 0.5, 0.5)]], radius=0.1)
    il.tiles.names()

Different tiles in one lattice: `mix` chooses one per cell, `hybrid` changes from one to another
over the part, by the weights of `sigmoid` or others.

Guarantee: importing expands no equation.
"""

import sys
from collections.abc import Callable, Iterator
from types import ModuleType

from ilattice.errors import InputError
from ilattice.tiles.catalog import get, identifiers, maker, names, row
from ilattice.tiles.entities import (
    Arc,
    Ball,
    Curve,
    Group,
    Patch,
    Polyline,
    Segments,
    Surface,
    Triangles,
)
from ilattice.tiles.mixture import Mixture, hybrid, mix, sigmoid
from ilattice.tiles.skeleton import SkeletonField, skeleton
from ilattice.tiles.struts import struts
from ilattice.tiles.tile import Tile
from ilattice.tiles.trig import TrigField

__all__ = [
    "Arc",
    "Ball",
    "Curve",
    "Group",
    "Mixture",
    "Patch",
    "Polyline",
    "Segments",
    "SkeletonField",
    "Surface",
    "Tile",
    "Triangles",
    "TrigField",
    "get",
    "hybrid",
    "mix",
    "names",
    "row",
    "sigmoid",
    "skeleton",
    "struts",
]


class _Catalog(ModuleType):
    """The module itself, with the catalogue as its items."""

    def __getitem__(self, name: str) -> Tile:
        return get(name)

    def __contains__(self, name: object) -> bool:
        try:
            row(name)  # type: ignore[arg-type]
        except InputError:
            return False
        return True

    def __iter__(self) -> Iterator[str]:
        return iter(names())


def __getattr__(name: str) -> Callable[..., Tile]:
    if name.startswith("__"):
        raise AttributeError(f"module 'ilattice.tiles' has no attribute {name!r}")
    try:
        return maker(name)
    except InputError as e:
        raise AttributeError(f"module 'ilattice.tiles' has no attribute {name!r}: {e}") from None


def __dir__() -> list[str]:
    return sorted({*__all__, *identifiers()})


sys.modules[__name__].__class__ = _Catalog
