"""Operations on fields: sets, offsets, placement, smooth blends.

Guarantee: each has the bounding box of its set. Amounts of `dilate`, `erode` and `shell` are in
the units of the field: lengths for distances, level units for others.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice._validate import as_array, as_triple
from ilattice.errors import InputError
from ilattice.fields import _tables as ops
from ilattice.fields._program import Builder, Point
from ilattice.fields.node import Node, as_node, as_number, everywhere, is_empty, nowhere
from ilattice.fields.primitives import as_direction, box, half_space

__all__ = [
    "complement", "difference", "dilate", "erode", "intersection", "mix", "normalize", "rotate",
    "scale", "shell", "translate", "union",
]  # fmt: skip

#: Least factor of `scale`: the inverse of smaller ones overflows.
_MIN_FACTOR = 1e-300


@dataclass(frozen=True, eq=False)
class _Extreme(Node):
    """Union (ops.MIN) or intersection (ops.MAX) of several, blended over a radius."""

    code: int = field(repr=False)
    parts: tuple[Node, ...]
    radius: float

    @property
    def _kind(self) -> str:
        return "Union" if self.code == ops.MIN else "Intersection"

    def _emit(self, b: Builder, p: Point) -> int:
        regs = [part._emit(b, p) for part in self.parts]
        if self.radius == 0.0:
            return b.extreme(self.code, regs)
        total = regs[0]
        for r in regs[1:]:
            total = self._blend(b, total, r)
        return total

    def _blend(self, b: Builder, f: int, g: int) -> int:
        gap = b.sub(b.const(self.radius), b.op(ops.ABS, b.sub(f, g)))
        bump = b.op(ops.SQUARE, b.op(ops.MAX, gap, b.const(0.0)))
        sign = -0.25 if self.code == ops.MIN else 0.25
        return b.add(b.op(self.code, f, g), b.scaled(sign / self.radius, bump))

    def _box(self, level: float = 0.0) -> FloatArray:
        if self.code == ops.MAX:
            boxes = np.stack([part._box(level) for part in self.parts])
            return np.stack((boxes[:, 0].max(axis=0), boxes[:, 1].min(axis=0)))
        grown = level + 0.25 * self.radius * (len(self.parts) - 1)
        boxes = np.stack([part._box(grown) for part in self.parts])
        kept = boxes[[not is_empty(k) for k in boxes]]
        if not len(kept):
            return nowhere()
        return np.stack((kept[:, 0].min(axis=0), kept[:, 1].max(axis=0)))


@dataclass(frozen=True, eq=False)
class _Everywhere(Node):
    """All of space."""

    def _emit(self, b: Builder, p: Point) -> int:  # noqa: ARG002
        return b.const(-1.0)

    def _box(self, level: float = 0.0) -> FloatArray:  # noqa: ARG002
        return everywhere()


@dataclass(frozen=True, eq=False)
class _Complement(Node):
    part: Node

    def _emit(self, b: Builder, p: Point) -> int:
        return b.op(ops.NEG, self.part._emit(b, p))

    def _box(self, level: float = 0.0) -> FloatArray:  # noqa: ARG002
        return everywhere()

    @property
    def polynomial(self) -> Any:
        p = self.part.polynomial
        return None if p is None else -p


@dataclass(frozen=True, eq=False)
class _Offset(Node):
    """``f - amount``, or ``|f| - amount`` for a shell."""

    part: Node
    amount: float | Node
    sign: float = field(repr=False)
    shell: bool = field(default=False, repr=False)

    @property
    def _kind(self) -> str:
        return "Shell" if self.shell else "Dilation" if self.sign > 0 else "Erosion"

    def _emit(self, b: Builder, p: Point) -> int:
        f = self.part._emit(b, p)
        if self.shell:
            f = b.op(ops.ABS, f)
        amount = self.amount
        by = amount._emit(b, p) if isinstance(amount, Node) else b.const(amount)
        return b.sub(f, b.scaled(self.sign, by))

    def _box(self, level: float = 0.0) -> FloatArray:
        if isinstance(self.amount, Node):
            low, high = self.amount.program.ranges(*everywhere()[:, None])[0]
            most = max(self.sign * low, self.sign * high)
        else:
            most = self.sign * self.amount
        return self.part._box(level + most) if most < np.inf else everywhere()

    @property
    def polynomial(self) -> Any:
        p, amount = self.part.polynomial, self.amount
        if p is None or self.shell or isinstance(amount, Node):
            return None
        return p - self.sign * amount


@dataclass(frozen=True, eq=False)
class _Placed(Node):
    """``factor f(matrix x + shift)``; the matrix is regular."""

    part: Node
    matrix: FloatArray = field(repr=False)
    shift: FloatArray = field(repr=False)
    factor: float

    def _emit(self, b: Builder, p: Point) -> int:
        inner = b.linear(self.matrix, p, self.shift)
        return b.scaled(self.factor, self.part._emit(b, inner))

    def _box(self, level: float = 0.0) -> FloatArray:
        inner = self.part._box(level / self.factor)
        if is_empty(inner):
            return nowhere()
        back = np.linalg.inv(self.matrix)
        low, high = np.zeros(3), np.zeros(3)
        with np.errstate(invalid="ignore"):
            for k in range(3):
                column = back[:, k, None] * (inner[:, k] - self.shift[k])
                column = np.where(back[:, k, None] == 0.0, 0.0, column)
                low, high = low + column.min(axis=1), high + column.max(axis=1)
        return np.stack((low, high))

    @property
    def exact_box(self) -> FloatArray | None:
        straight = np.count_nonzero(self.matrix) == 3
        return self._box() if straight and self.part.exact_box is not None else None

    @property
    def polynomial(self) -> Any:
        p, stretch = self.part.polynomial, np.diag(self.matrix)
        straight = np.count_nonzero(self.matrix) == 3 and (stretch > 0.0).all()
        plain = p is not None and straight and not self.shift.any()
        return p.stretched(1.0 / stretch) * self.factor if plain else None


@dataclass(frozen=True, eq=False)
class _Mixed(Node):
    """``(1 - w) first + w second`` for the weight w, held between 0 and 1."""

    first: Node
    second: Node
    weight: Node

    def _emit(self, b: Builder, p: Point) -> int:
        w = b.op(ops.MIN, b.op(ops.MAX, self.weight._emit(b, p), b.const(0.0)), b.const(1.0))
        f, g = self.first._emit(b, p), self.second._emit(b, p)
        return b.add(b.mul(b.sub(b.const(1.0), w), f), b.mul(w, g))

    def _box(self, level: float = 0.0) -> FloatArray:
        return _Extreme(ops.MIN, (self.first, self.second), 0.0)._box(level)


@dataclass(frozen=True, eq=False)
class _Normalized(Node):
    part: Node

    def _emit(self, b: Builder, p: Point) -> int:
        f = self.part._emit(b, p)
        steepness = b.norm(*b.gradient(f, p))
        return b.op(ops.DIV, f, b.op(ops.MAX, steepness, b.const(1e-12)))

    def _box(self, level: float = 0.0) -> FloatArray:
        return self.part._box(0.0) if level <= 0.0 else everywhere()


def _several(name: str, code: int, parts: tuple[Any, ...], radius: Any) -> Node:
    if not parts:
        raise InputError(f"{name} needs at least one field")
    blend = as_number("radius", radius, 0.0)
    flat: list[Node] = []
    for i, part in enumerate(parts):
        node = as_node(f"parts[{i}]", part)
        same = isinstance(node, _Extreme) and node.code == code and node.radius == blend == 0.0
        flat += node.parts if isinstance(node, _Extreme) and same else [node]
    return flat[0] if len(flat) == 1 else _Extreme(code, tuple(flat), blend)


def clipped(part: Node, bounds: Any) -> Node:
    """What of a solid lies in a box along the axes.

    Parameters
    ----------
    part : Node
        A field.
    bounds : array_like, shape (2, 3)
        Lower and upper corner, such as the ``bounds`` of a field or a mesh, or the ``domain`` of a
        map; infinite where there is no end.

    Returns
    -------
    Node
        The intersection; of a field without an end one that can be meshed.

    Raises
    ------
    InputError
        If `bounds` is no box, or has no width along an axis.

    Examples
    --------
    >>> import ilattice as il
    >>> half = il.fields.clipped(il.fields.sphere(1.0), [[-2, -2, 0], [2, 2, 2]])
    >>> half([[0.0, 0.0, 0.5], [0.0, 0.0, -0.5]]) < 0
    array([ True, False])
    """
    lo, hi = _corners(bounds)
    if np.isfinite([lo, hi]).all():
        return intersection(part, translate(box(0.5 * (hi - lo)), 0.5 * (lo + hi)))
    sides = [half_space(-e, -a) for e, a in zip(np.eye(3), lo, strict=True) if np.isfinite(a)]
    sides += [half_space(e, a) for e, a in zip(np.eye(3), hi, strict=True) if np.isfinite(a)]
    return intersection(part, *sides)


def _corners(bounds: Any) -> FloatArray:
    out = as_array("bounds", bounds, finite=False)
    if out.shape != (2, 3) or not (out[0] < out[1]).all():
        raise InputError(
            "bounds must be a lower and an upper corner, shape (2, 3), the upper one above the "
            f"lower one along each axis, got {bounds!r:.80}"
        )
    return out


def split_box(solid: Node) -> tuple[Node, FloatArray | None]:
    """A solid as what lies in a box: the rest of an intersection with boxes, and that box.

    Parameters
    ----------
    solid : Node
        Any field.

    Returns
    -------
    tuple
        The field of the rest, -1 where nothing is left, and the box (2, 3); the solid itself and
        None if it is no intersection with a box.
    """
    sharp = isinstance(solid, _Extreme) and solid.code == ops.MAX and solid.radius == 0.0
    parts = solid.parts if isinstance(solid, _Extreme) and sharp else (solid,)
    boxes = [part.exact_box for part in parts]
    found = [box for box in boxes if box is not None]
    if not found:
        return solid, None
    low, high = np.stack(found).max(axis=0)[0], np.stack(found).min(axis=0)[1]
    rest = [part for part, box in zip(parts, boxes, strict=True) if box is None]
    return intersection(*rest) if rest else _Everywhere(), np.stack((low, high))


def union(*parts: Node, radius: float = 0.0) -> Node:
    """Points in any of the solids: the least of the fields.

    Parameters
    ----------
    *parts : Node
        Fields.
    radius : float
        Blend, in units of the fields: 0 keeps the sharp seam.

    Returns
    -------
    Node
        The union; blends add at most ``radius / 4`` per seam.
    """
    return _several("union", ops.MIN, parts, radius)


def intersection(*parts: Node, radius: float = 0.0) -> Node:
    """Points in all of the solids: the largest of the fields.

    Parameters
    ----------
    *parts : Node
        Fields.
    radius : float
        Blend, in units of the fields: 0 keeps the sharp edge.

    Returns
    -------
    Node
        The intersection.
    """
    return _several("intersection", ops.MAX, parts, radius)


def difference(first: Node, second: Node, *, radius: float = 0.0) -> Node:
    """Points in the first solid and not in the second.

    Parameters
    ----------
    first, second : Node
        Fields.
    radius : float
        Blend, in units of the fields.

    Returns
    -------
    Node
        ``max(first, -second)``.
    """
    return intersection(first, complement(second), radius=radius)


def complement(part: Node) -> Node:
    """Points not in the solid.

    Parameters
    ----------
    part : Node
        Field.

    Returns
    -------
    Node
        ``-part``.
    """
    return _Complement(as_node("part", part))


def _amount(name: str, value: Any) -> float | Node:
    return value if isinstance(value, Node) else as_number(name, value, 0.0)


def dilate(part: Node, offset: float | Node) -> Node:
    """The solid grown by an offset.

    Parameters
    ----------
    part : Node
        Field.
    offset : float or Node
        In units of the field, not negative; a field varies in space.

    Returns
    -------
    Node
        ``part - offset``.
    """
    return _Offset(as_node("part", part), _amount("offset", offset), 1.0)


def erode(part: Node, offset: float | Node) -> Node:
    """The solid shrunk by an offset.

    Parameters
    ----------
    part : Node
        Field.
    offset : float or Node
        In units of the field, not negative; a field varies in space.

    Returns
    -------
    Node
        ``part + offset``.
    """
    return _Offset(as_node("part", part), _amount("offset", offset), -1.0)


def shell(part: Node, thickness: float | Node) -> Node:
    """A wall about the surface.

    Parameters
    ----------
    part : Node
        Field.
    thickness : float or Node
        From side to side, in units of the field: a length only for distances.

    Returns
    -------
    Node
        ``abs(part) - thickness / 2``.
    """
    return _Offset(as_node("part", part), _amount("thickness", thickness), 0.5, shell=True)


def translate(part: Node, offset: Any) -> Node:
    """The solid, moved.

    Parameters
    ----------
    part : Node
        Field.
    offset : (3,) array
        Motion.

    Returns
    -------
    Node
        ``part(x - offset)``.
    """
    return _Placed(as_node("part", part), np.eye(3), -as_triple("offset", offset), 1.0)


def scale(part: Node, factor: Any) -> Node:
    """The solid, stretched along the axes.

    Parameters
    ----------
    part : Node
        Field.
    factor : float or (3,) array
        Factors, none of them zero; negative ones mirror.

    Returns
    -------
    Node
        ``min|factor| part(x / factor)``: never steeper than `part`.
    """
    a = as_triple("factor", factor)
    if (np.abs(a) < _MIN_FACTOR).any():
        raise InputError(f"factor must not be zero, nor below {_MIN_FACTOR:g}, got {a.tolist()}")
    return _Placed(as_node("part", part), np.diag(1.0 / a), np.zeros(3), float(np.abs(a).min()))


def rotate(part: Node, angle: float, axis: Any) -> Node:
    """The solid, turned about an axis through the origin by the right-hand rule.

    Parameters
    ----------
    part : Node
        Field.
    angle : float
        In radians.
    axis : (3,) array
        Direction, of any length but zero.

    Returns
    -------
    Node
        ``part(R^T x)``. (Cesogen's eq. (8) is printed with R and would turn the other way.)
    """
    v, t = as_direction("axis", axis), as_number("angle", angle)
    cross = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    R = np.eye(3) + np.sin(t) * cross + (1.0 - np.cos(t)) * cross @ cross
    return _Placed(as_node("part", part), R.T, np.zeros(3), 1.0)


def placed(part: Node, matrix: FloatArray, shift: FloatArray) -> Node:
    """A field after a regular affine map, which may shear: ``part(matrix x + shift)``.

    Parameters
    ----------
    part : Node
        Field.
    matrix : ndarray, shape (3, 3)
        From points to those of the field.
    shift : ndarray, shape (3,)
        What is added.

    Returns
    -------
    Node
        Also where the field is a distance, this is none.
    """
    return _Placed(as_node("part", part), matrix, shift, 1.0)


def normalize(part: Node) -> Node:
    """First-order distance ``f / |grad f|``.

    Parameters
    ----------
    part : Node
        Field with a formula.

    Returns
    -------
    Node
        The normalised field; at places without gradient, `part` times 1e12.
    """
    return _Normalized(as_node("part", part))


def mix(first: Node, second: Node, weight: Node) -> Node:
    """A solid that changes from one field to another through space.

    Parameters
    ----------
    first, second : Node
        Fields, of like steepness: what is mixed are their values.
    weight : Node
        Where it is 0 or less the first one holds, where it is 1 or more the second one.

    Returns
    -------
    Node
        ``(1 - w) first + w second``.
    """
    nodes = as_node("first", first), as_node("second", second), as_node("weight", weight)
    return _Mixed(*nodes)
