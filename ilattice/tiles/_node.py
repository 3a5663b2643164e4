"""Tiles as nodes of the algebra on fields, repeated through all of space.

Guarantee: a trigonometric polynomial becomes part of the program of a tree: harmonics that several
terms share are computed once, and bounds are those of the program. Not guaranteed: the digits of
`TrigField` more than some thousand periods from the origin.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ilattice._field import owns
from ilattice._typing import FloatArray, IntArray
from ilattice.fields import _tables as ops
from ilattice.fields import from_callable
from ilattice.fields._program import Builder, Point
from ilattice.fields.node import Node, everywhere


@dataclass(frozen=True, eq=False)
class TrigNode(Node):
    """A `TrigField` as instructions."""

    field: Any

    def _emit(self, b: Builder, p: Point) -> int:
        f = self.field
        q = p if f.linear is None else b.linear(f.linear, p)
        total: list[int] = []
        for last in np.unique(f.factor[:, 2]):  # what depends on x and y first, in common
            at = f.factor[:, 2] == last
            plane = [
                self._product(b, q, code, c)
                for c, code in zip(f.coef[at], f.factor[at, :2], strict=True)
            ]
            total.append(b.mul(b.add(*plane), self._factor(b, q, 2, int(last))))
        return b.add(*total) if total else b.const(0.0)

    def _product(self, b: Builder, q: Point, codes: IntArray, coef: float) -> int:
        x, y = (self._factor(b, q, axis, int(code)) for axis, code in enumerate(codes))
        return b.scaled(float(coef), b.mul(x, y))

    def _factor(self, b: Builder, q: Point, axis: int, code: int) -> int:
        if code == 0:
            return b.const(1.0)
        turn = 2.0 * np.pi * ((code + 1) // 2) / float(self.field.period[axis])
        return b.op(ops.COS if code % 2 else ops.SIN, b.scaled(turn, q[axis]))

    def _box(self, level: float = 0.0) -> FloatArray:  # noqa: ARG002
        return everywhere()

    @property
    def polynomial(self) -> Any:
        return self.field if self.field.linear is None else None


@dataclass(frozen=True, eq=False)
class TileNode(Node):
    """A tile less its level: a field of the unit cube, repeated."""

    tile: Any

    def _emit(self, b: Builder, p: Point) -> int:
        field = self.tile.field
        level = b.const(self.tile.level)
        if owns(field, "node"):
            return b.sub(field.node._emit(b, p), level)
        zero, one = b.const(0.0), b.const(1.0)
        within = [b.op(ops.MAX, b.op(ops.MIN, b.op(ops.MOD, r, one), one), zero) for r in p]
        return b.sub(self._leaf._emit(b, (within[0], within[1], within[2])), level)

    @cached_property
    def _leaf(self) -> Node:
        return from_callable(self.tile.field)

    def _box(self, level: float = 0.0) -> FloatArray:  # noqa: ARG002
        return everywhere()

    @property
    def polynomial(self) -> Any:
        field = self.tile.field
        p = field.node.polynomial if owns(field, "node") else None
        return None if p is None else p - self.tile.level
