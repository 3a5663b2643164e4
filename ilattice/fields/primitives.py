"""Primitive solids: sphere, box, cylinder, half-space, torus, capsule, cone.

Guarantee: all are true signed distances.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice._validate import as_positive, as_triple
from ilattice.errors import InputError
from ilattice.fields import _tables as ops
from ilattice.fields._program import Builder, Point
from ilattice.fields.node import Node, as_number, everywhere, nowhere

__all__ = ["box", "capsule", "cone", "cylinder", "half_space", "sphere", "torus"]


def _centred(reach: Any) -> FloatArray:
    r = np.broadcast_to(np.asarray(reach, float), (3,))
    return nowhere() if (r < 0).any() else np.stack((-r, r))


@dataclass(frozen=True, eq=False)
class _Sphere(Node):
    radius: float

    def _emit(self, b: Builder, p: Point) -> int:
        return b.sub(b.norm(*p), b.const(self.radius))

    def _box(self, level: float = 0.0) -> FloatArray:
        return _centred(self.radius + level)


@dataclass(frozen=True, eq=False)
class _Box(Node):
    half: FloatArray

    def _emit(self, b: Builder, p: Point) -> int:
        q = [b.sub(b.op(ops.ABS, p[i]), b.const(self.half[i])) for i in range(3)]
        zero = b.const(0.0)
        outside = b.norm(*(b.op(ops.MAX, r, zero) for r in q))
        inside = b.extreme(ops.MAX, q)
        return b.inside(b.add(outside, b.op(ops.MIN, inside, zero)), inside)

    def _box(self, level: float = 0.0) -> FloatArray:
        return _centred(self.half + level)

    @property
    def exact_box(self) -> FloatArray:
        return self._box()


@dataclass(frozen=True, eq=False)
class _Cylinder(Node):
    radius: float

    def _emit(self, b: Builder, p: Point) -> int:
        return b.sub(b.norm(p[0], p[1]), b.const(self.radius))

    def _box(self, level: float = 0.0) -> FloatArray:
        r = self.radius + level
        return _centred((r, r, np.inf))


@dataclass(frozen=True, eq=False)
class _HalfSpace(Node):
    normal: FloatArray
    offset: float

    def _emit(self, b: Builder, p: Point) -> int:
        dot = b.add(*(b.scaled(self.normal[i], p[i]) for i in range(3)))
        return b.sub(dot, b.const(self.offset))

    def _box(self, level: float = 0.0) -> FloatArray:
        out = everywhere()
        for i in np.flatnonzero(np.abs(self.normal) == 1.0):
            sign = self.normal[i]
            out[int(sign > 0), i] = sign * (self.offset + level)
        return out


@dataclass(frozen=True, eq=False)
class _Torus(Node):
    major: float
    minor: float

    def _emit(self, b: Builder, p: Point) -> int:
        ring = b.sub(b.norm(p[0], p[1]), b.const(self.major))
        return b.sub(b.norm(ring, p[2]), b.const(self.minor))

    def _box(self, level: float = 0.0) -> FloatArray:
        r = self.minor + level
        return nowhere() if r < 0 else _centred((self.major + r, self.major + r, r))


@dataclass(frozen=True, eq=False)
class _Capsule(Node):
    first: FloatArray
    second: FloatArray
    radius: float

    def _emit(self, b: Builder, p: Point) -> int:
        axis = self.second - self.first
        q = [b.sub(p[i], b.const(self.first[i])) for i in range(3)]
        square = float(axis @ axis)
        t = b.add(*(b.scaled(axis[i] / square, q[i]) for i in range(3)))
        t = b.op(ops.MIN, b.op(ops.MAX, t, b.const(0.0)), b.const(1.0))
        away = b.norm(*(b.sub(q[i], b.scaled(axis[i], t)) for i in range(3)))
        return b.sub(away, b.const(self.radius))

    def _box(self, level: float = 0.0) -> FloatArray:
        r = self.radius + level
        if r < 0:
            return nowhere()
        ends = np.stack((self.first, self.second))
        return np.stack((ends.min(axis=0) - r, ends.max(axis=0) + r))


@dataclass(frozen=True, eq=False)
class _Cone(Node):
    radius: float
    half: float

    def _emit(self, b: Builder, p: Point) -> int:
        length = float(np.hypot(self.radius, 2.0 * self.half))
        out, up = 2.0 * self.half / length, self.radius / length  # normal of the mantle
        zero, one = b.const(0.0), b.const(1.0)
        r = b.norm(p[0], p[1])
        base = b.sub(b.const(-self.half), p[2])
        above = b.sub(p[2], b.const(self.half))  # from the tip
        mantle = b.add(b.scaled(out, r), b.scaled(up, above))
        inside = b.op(ops.MAX, base, mantle)
        along = b.add(b.scaled(up / length, r), b.scaled(-out / length, above))
        t = b.op(ops.MIN, b.op(ops.MAX, along, zero), one)
        to_mantle = b.norm(
            b.sub(r, b.scaled(up * length, t)), b.add(above, b.scaled(out * length, t))
        )
        to_base = b.norm(b.op(ops.MAX, b.sub(r, b.const(self.radius)), zero), base)
        away = b.op(ops.MIN, to_mantle, to_base)
        share = b.scaled(0.5, b.add(one, b.op(ops.SIGN, inside)))
        return b.inside(b.add(b.op(ops.MIN, inside, zero), b.mul(share, away)), inside)

    def _box(self, level: float = 0.0) -> FloatArray:
        r = self.radius + level
        return _centred((r, r, self.half + level))


def sphere(radius: float = 1.0) -> Node:
    """Ball about the origin.

    Parameters
    ----------
    radius : float
        Its radius.

    Returns
    -------
    Node
        Signed distance.
    """
    return _Sphere(as_positive("radius", radius))


def box(half: Any = 1.0) -> Node:
    """Box about the origin.

    Parameters
    ----------
    half : float or (3,) array
        Half-widths.

    Returns
    -------
    Node
        Signed distance, rounded outside the edges.
    """
    return _Box(as_triple("half", half, positive=True))


def cylinder(radius: float = 1.0) -> Node:
    """Infinite cylinder about the z axis.

    Parameters
    ----------
    radius : float
        Its radius.

    Returns
    -------
    Node
        Signed distance.
    """
    return _Cylinder(as_positive("radius", radius))


def half_space(normal: Any = (0.0, 0.0, 1.0), offset: float = 0.0) -> Node:
    """Points below a plane: ``normal·x < offset`` for the normal of length one.

    Parameters
    ----------
    normal : (3,) array
        Outward direction, of any length.
    offset : float
        Distance of the plane from the origin along the normal.

    Returns
    -------
    Node
        Signed distance.

    Raises
    ------
    InputError
        If the normal is zero.
    """
    return _HalfSpace(as_direction("normal", normal), as_number("offset", offset))


def torus(major: float = 1.0, minor: float = 0.25) -> Node:
    """Ring about the z axis.

    Parameters
    ----------
    major, minor : float
        Radius of the ring and of its section.

    Returns
    -------
    Node
        Signed distance.
    """
    return _Torus(as_positive("major", major), as_positive("minor", minor))


def capsule(first: Any, second: Any, radius: float) -> Node:
    """Points near a line segment.

    Parameters
    ----------
    first, second : (3,) arrays
        Ends of the segment.
    radius : float
        Distance from it.

    Returns
    -------
    Node
        Signed distance.

    Raises
    ------
    InputError
        If both ends are equal.
    """
    a, c = as_triple("first", first), as_triple("second", second)
    if (a == c).all():
        raise InputError(f"first and second must differ, got {a.tolist()} twice; use a sphere")
    return _Capsule(a, c, as_positive("radius", radius))


def cone(radius: float = 1.0, height: float = 2.0) -> Node:
    """Cone about the z axis with its tip up, centred at half its height.

    Parameters
    ----------
    radius : float
        Radius of the base, at ``z = -height / 2``.
    height : float
        From the base to the tip.

    Returns
    -------
    Node
        Signed distance.
    """
    return _Cone(as_positive("radius", radius), 0.5 * as_positive("height", height))


def as_direction(name: str, value: Any) -> FloatArray:
    """A vector of length one."""
    v = as_triple(name, value)
    length = float(np.linalg.norm(v))
    if length == 0.0:
        raise InputError(f"{name} must not be zero")
    return v / length
