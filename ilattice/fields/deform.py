"""Deformations of fields: twisted, bent, repeated, taken in cylindrical coordinates.

Guarantee: each has the bounding box of its set. Not guaranteed: distances stay distances only
where a map keeps lengths.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice._validate import as_positive, as_triple
from ilattice.errors import InputError
from ilattice.fields import _tables as ops
from ilattice.fields._program import Builder, Point
from ilattice.fields.node import Node, as_node, as_number, everywhere, is_empty, nowhere

__all__ = ["bend", "cylindrical", "repeat", "twist"]


@dataclass(frozen=True, eq=False)
class _Twist(Node):
    part: Node
    rate: float

    def _emit(self, b: Builder, p: Point) -> int:
        angle = b.scaled(self.rate, p[2])
        c, s = b.op(ops.COS, angle), b.op(ops.SIN, angle)
        x = b.add(b.mul(c, p[0]), b.mul(s, p[1]))
        y = b.sub(b.mul(c, p[1]), b.mul(s, p[0]))
        return self.part._emit(b, (x, y, p[2]))

    def _box(self, level: float = 0.0) -> FloatArray:
        inner = self.part._box(level)
        if is_empty(inner):
            return nowhere()
        reach = float(np.linalg.norm(np.abs(inner[:, :2]).max(axis=0)))
        return np.array([[-reach, -reach, inner[0, 2]], [reach, reach, inner[1, 2]]])


@dataclass(frozen=True, eq=False)
class _Repeat(Node):
    part: Node
    period: FloatArray

    def _emit(self, b: Builder, p: Point) -> int:
        x, y, z = (b.op(ops.WRAP, p[i], b.const(self.period[i])) for i in range(3))
        return self.part._emit(b, (x, y, z))

    def _box(self, level: float = 0.0) -> FloatArray:  # noqa: ARG002
        return everywhere()


@dataclass(frozen=True, eq=False)
class _Bent(Node):
    part: Node
    radius: float

    def _emit(self, b: Builder, p: Point) -> int:
        radius = b.const(self.radius)
        up = b.sub(radius, p[1])
        along = b.mul(radius, b.op(ops.ATAN2, p[0], up))
        return self.part._emit(b, (along, b.sub(radius, b.norm(p[0], up)), p[2]))

    def _box(self, level: float = 0.0) -> FloatArray:
        inner = self.part._box(level)
        if is_empty(inner):
            return nowhere()
        far = max(self.radius - inner[0, 1], 0.0)
        return np.array(
            [[-far, self.radius - far, inner[0, 2]], [far, self.radius + far, inner[1, 2]]]
        )


@dataclass(frozen=True, eq=False)
class _Cylindrical(Node):
    part: Node
    count: float

    def _emit(self, b: Builder, p: Point) -> int:
        turn = b.scaled(0.5 * self.count / np.pi, b.op(ops.ATAN2, p[1], p[0]))
        return self.part._emit(b, (b.norm(p[0], p[1]), turn, p[2]))

    def _box(self, level: float = 0.0) -> FloatArray:
        inner = self.part._box(level)
        far = inner[1, 0]
        if is_empty(inner) or far < 0.0:
            return nowhere()
        return np.array([[-far, -far, inner[0, 2]], [far, far, inner[1, 2]]])


def bend(part: Node, radius: float) -> Node:
    """The solid, with its x axis bent to a circle in the plane of x and y.

    Parameters
    ----------
    part : Node
        Field; what lies beyond half a turn along x is cut off.
    radius : float
        Radius of the circle, which is about ``(0, radius)`` and goes through the origin.

    Returns
    -------
    Node
        The bent field: lengths along the circle are kept, others not.
    """
    return _Bent(as_node("part", part), as_positive("radius", radius))


def cylindrical(part: Node, count: int) -> Node:
    """The field in cylindrical coordinates: ``part(r, count angle / (2 pi), z)``.

    Parameters
    ----------
    part : Node
        Field of period 1 along y, such as a tile.
    count : int
        Periods around the z axis.

    Returns
    -------
    Node
        The field about the z axis. Cells are as wide as they should be at the radius
        ``count / (2 pi)`` only.

    Raises
    ------
    InputError
        If the count is not a whole number of at least 1.
    """
    n = as_number("count", count, 1.0)
    if n != np.rint(n):
        raise InputError(f"count must be a whole number, got {count!r:.80}")
    return _Cylindrical(as_node("part", part), n)


def twist(part: Node, rate: float) -> Node:
    """The solid, turned about the z axis by an angle that grows with z; not a distance.

    Parameters
    ----------
    part : Node
        Field.
    rate : float
        Radians per length.

    Returns
    -------
    Node
        The twisted field.
    """
    return _Twist(as_node("part", part), as_number("rate", rate))


def repeat(part: Node, period: Any) -> Node:
    """Copies of the solid at all multiples of a period: what lies in one cell about the origin.

    Parameters
    ----------
    part : Node
        Field.
    period : float or (3,) array
        Distance of the copies along the axes.

    Returns
    -------
    Node
        The periodic field, which jumps between cells unless `part` is symmetric.
    """
    return _Repeat(as_node("part", part), as_triple("period", period, positive=True))
