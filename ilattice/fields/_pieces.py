"""Seams of fields that programs evaluate as leaves: unions of many pieces, and stacks of pieces.

Guarantee: what a class promises here, `ilattice.fields._formula` uses; it asks for no attribute.
"""

from collections.abc import Sequence
from typing import Any, Protocol, Self

from ilattice._typing import FloatArray, IntArray
from ilattice.fields.node import Node, Whole


class Stack(Protocol):
    """Several fields, evaluated together."""

    def values(self, which: IntArray, x: FloatArray) -> FloatArray:
        """Values (n, q) of fields (n,) at points (n, q, 3)."""
        ...

    def bounds(self, which: IntArray, lo: FloatArray, hi: FloatArray) -> FloatArray:
        """Bounds (n, 2) of fields (n,) on finite boxes."""
        ...


class Stackable(Whole):
    """A smooth field that is evaluated together with others of its class."""

    @classmethod
    def stacked(cls, pieces: Sequence[Self]) -> Stack:
        """Several, evaluated together."""
        raise NotImplementedError


class Union(Whole):
    """The union of many pieces, of which few matter in a box."""

    def parts_on(self, lo: FloatArray, hi: FloatArray) -> list[Any]:
        """Names of the pieces that matter in boxes (n, 3); None where these are to be halved."""
        raise NotImplementedError

    def part(self, numbers: Any) -> Node:
        """The field of a piece, by its name."""
        raise NotImplementedError
