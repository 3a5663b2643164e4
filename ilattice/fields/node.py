"""`Node`: an implicit field, negative inside, that compiles to one program.

Guarantees: immutable; `range` is rigorous; `bounding_box(c)` holds {f <= c}; values are the same
bits for any number of threads. Not guaranteed: that a field is a distance; see each constructor.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ilattice._field import OF_THE_INNER, Field, as_boxes, bounded, differences, owns
from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import Frozen, among, as_array, as_points, asked, read_only
from ilattice.errors import InputError
from ilattice.fields._program import Builder, Point, Program

__all__ = ["Node"]

INF = np.inf
#: Room about a solid in pictures, in units of its size.
AROUND = 0.1


class Node(Field, Frozen):
    """Base of all fields of this room; made by the functions of `ilattice.fields`."""

    def _emit(self, b: Builder, p: Point) -> int:
        """Write the instructions of the field at registers of the coordinates; the value's."""
        raise NotImplementedError

    def _box(self, level: float = 0.0) -> FloatArray:
        """`bounding_box` of a level that is known to be a number."""
        raise NotImplementedError

    def bounding_box(self, level: float = 0.0) -> FloatArray:
        """Box that holds the points where the field is at most `level`.

        Parameters
        ----------
        level : float
            The level.

        Returns
        -------
        ndarray, shape (2, 3)
            Corners; infinite where nothing better is known, the lower one above the upper one
            where there are no such points.

        Raises
        ------
        InputError
            For a level that is not one finite number.
        """
        return self._box(as_number("level", level))

    @property
    def exact_box(self) -> FloatArray | None:
        """The box (2, 3) that is the solid, or None where the solid is none along the axes."""
        return None

    @property
    def polynomial(self) -> Any:
        """The trigonometric polynomial that the field is (a `TrigField`), or None."""
        return None

    @property
    def children(self) -> "tuple[Node, ...]":
        """The fields that this one is made of."""
        rows = (v if isinstance(v, tuple) else (v,) for v in vars(self).values())
        return tuple(v for row in rows for v in row if isinstance(v, Node))

    @cached_property
    def depth(self) -> int:
        """Levels of the tree of fields."""
        return 1 + max((child.depth for child in self.children), default=0)

    @cached_property
    def program(self) -> Program:
        """The compiled field."""
        b = Builder()
        return b.program(self._emit(b, (0, 1, 2)))

    @property
    def bounds(self) -> FloatArray:
        """Box (2, 3) of the solid, perhaps infinite."""
        box: FloatArray = read_only(self._box(0.0))
        return box

    @property
    def bounded(self) -> bool:
        """Whether its bounds are finite on finite boxes."""
        return self.program.bounded

    @property
    def shown_box(self) -> FloatArray:
        """The box of the solid with room about it, which is outside."""
        box = self.bounds
        if not np.isfinite(box).all():
            return box
        around = AROUND * float(np.ptp(box, axis=0).max())
        return box + np.array([[-around], [around]])

    def __call__(self, p: ArrayLike, /) -> FloatArray:
        """Values, shape (n,), at points ``p`` (n, 3)."""
        return self.program.values(as_points("p", p))

    def jet(self, p: ArrayLike, order: int = 2) -> tuple[FloatArray, ...]:
        """Value and derivatives; at kinks those of one side.

        Parameters
        ----------
        p : array_like, shape (n, 3)
            Points.
        order : int
            Highest derivative: 0, 1 or 2.

        Returns
        -------
        tuple of ndarray
            Values (n,), gradients (n, 3), Hessians (n, 3, 3): the first ``order + 1``.

        Raises
        ------
        InputError
            For points of another shape or not finite, or another order.
        """
        if not among(order, (0, 1, 2)):
            raise InputError(f"order must be 0, 1 or 2, got {order!r}")
        if order == 0:
            return (self(p),)
        jets = self.program.jets(as_points("p", p), order)
        f, g = np.ascontiguousarray(jets[:, 0]), np.ascontiguousarray(jets[:, 1:4])
        if order == 1:
            return f, g
        return f, g, jets[:, [4, 5, 6, 5, 7, 8, 6, 8, 9]].reshape(-1, 3, 3)

    def range(self, lo: ArrayLike, hi: ArrayLike) -> FloatArray:
        """Rigorous bounds of the values on boxes.

        Parameters
        ----------
        lo, hi : array_like, shape (n, 3)
            Corners, ``lo <= hi``.

        Returns
        -------
        ndarray, shape (n, 2)
            Lower and upper bounds.

        Raises
        ------
        InputError
            For corners of different shapes, not finite or in the wrong order.
        """
        return self.program.ranges(*as_boxes(lo, hi))


class Whole(Node):
    """A field that programs ask for values, derivatives and bounds, which have no formula of it."""

    @property
    def bounded(self) -> bool:
        """Whether its bounds are finite on finite boxes."""
        return True

    @property
    def halved(self) -> bool:
        """Whether quadrature may halve its boxes often: pieces of solids fill boxes of any size."""
        return False

    def _emit(self, b: Builder, p: Point) -> int:
        return b.leaf(self, p)


@dataclass(frozen=True, eq=False)
class Leaf(Whole):
    """A field computed elsewhere.

    Attributes
    ----------
    f : callable
        The field.
    box : ndarray, shape (2, 3)
        Box that holds where it is not positive.
    """

    f: Any
    box: FloatArray

    def _box(self, level: float = 0.0) -> FloatArray:
        if owns(self.f, "bounding_box"):
            return np.array(asked("bounding_box of the field", self.f.bounding_box, level))
        return np.array(self.box) if level <= 0.0 else everywhere()

    def _has(self, name: str) -> bool:
        return super()._has(name) and (name not in OF_THE_INNER or owns(self.f, name))

    @property
    def bounded(self) -> bool:
        """Whether those of the field are."""
        return bounded(self.f)

    @property
    def halved(self) -> bool:
        """Whether the field is bounded: boxes are halved where bounds say so."""
        return self.bounded

    def values(self, points: FloatArray) -> FloatArray:
        """Values, checked for their shape."""
        out = as_array("values of the field", asked("field", self.f, points), finite=False)
        if out.shape != (len(points),):
            raise InputError(
                f"field must give {len(points)} values for {len(points)} points, "
                f"got shape {out.shape}"
            )
        return out

    def jets(self, points: FloatArray, order: int) -> tuple[FloatArray, ...]:
        """Value and derivatives, by differences where the field has none."""
        if owns(self.f, "jet"):
            return tuple(asked("jet of the field", self.f.jet, points, order))
        return differences(self.values, points, self.values(points), order)

    def bounds_on(self, lo: FloatArray, hi: FloatArray, moved: bool) -> FloatArray:
        """Bounds and steepness (n, 3); the latter only where the point is not `moved`."""
        out = np.tile([-np.inf, np.inf, np.inf], (len(lo), 1))
        finite = np.isfinite(lo).all(axis=1) & np.isfinite(hi).all(axis=1)
        if owns(self.f, "range") and finite.any():
            told = "range of the field"
            out[finite, :2] = asked(told, self.f.range, lo[finite], hi[finite])
        if not moved:
            out[:, 2] = self.f.lipschitz if owns(self.f, "lipschitz") else np.inf
        return out


def as_node(name: str, field: Any) -> Node:
    """The field itself, any other `Field` as a leaf, or `InputError`."""
    if isinstance(field, Node):
        return field
    if not isinstance(field, Field):
        raise InputError(
            f"{name} must be a field of ilattice.fields, got {field!r:.80}; "
            "fields.from_callable wraps others"
        )
    if field.node is not None:
        node: Node = field.node
        return node
    box = np.array(field.bounds)
    if box.shape != (2, 3):
        raise InputError(f"{name} must be a field of three coordinates, got {field!r:.80}")
    return Leaf(field, box)


def as_number(name: str, value: Any, least: float = -INF) -> float:
    """One finite number of at least `least`."""
    a = as_array(name, value)
    if a.size != 1 or a.ravel()[0] < least:
        bound = "" if least == -INF else f" of at least {least:g}"
        raise InputError(f"{name} must be one number{bound}, got {value!r:.80}")
    return float(a.ravel()[0])


def everywhere() -> FloatArray:
    """The box without ends."""
    return np.array([[-INF] * 3, [INF] * 3])


def nowhere() -> FloatArray:
    """The empty box."""
    return np.array([[INF] * 3, [-INF] * 3])


def is_empty(box: FloatArray) -> bool:
    """Whether no point lies in a box."""
    return bool((box[0] > box[1]).any())
