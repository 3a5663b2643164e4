"""Fields of space in the parameters of a map: f(x(u)).

Guarantee: derivatives follow by the chain rule, bounds from those of the map: both are as good as
the field's. Non-guarantee: a field of space that is a distance is none in the parameters.
"""

from dataclasses import dataclass

import numpy as np

from ilattice._field import Field, as_boxes
from ilattice._typing import ArrayLike, FloatArray, Map
from ilattice._validate import Frozen, among, as_points
from ilattice.errors import InputError
from ilattice.fields.node import Node, as_node

__all__ = ["pull_back"]


@dataclass(frozen=True, eq=False)
class PulledBack(Field, Frozen):
    """A field of space as a function of the parameters of a map.

    Attributes
    ----------
    part : Node
        The field.
    through : Map
        From the parameters to space.
    """

    part: Node
    through: Map

    def __call__(self, u: ArrayLike, /) -> FloatArray:
        """Values, shape (n,), at parameters ``u`` (n, 3)."""
        return self.part(self.through.x(as_points("u", u)))

    def jet(self, u: ArrayLike, order: int = 2) -> tuple[FloatArray, ...]:
        """See `Field.jet`: derivatives with respect to the parameters."""
        if not among(order, (0, 1, 2)):
            raise InputError(f"order must be 0, 1 or 2, got {order!r}")
        u = as_points("u", u)
        value, *rest = self.part.jet(self.through.x(u), order)
        if order == 0:
            return (value,)
        jacobian = self.through.jacobian(u)
        slope = np.einsum("nc,nca->na", rest[0], jacobian)
        if order == 1:
            return value, slope
        bend = np.einsum("nca,ncd,ndb->nab", jacobian, rest[1], jacobian)
        bend += np.einsum("nc,ncab->nab", rest[0], self.through.hessian(u))
        return value, slope, 0.5 * (bend + bend.transpose(0, 2, 1))

    @property
    def bounded(self) -> bool:
        """As of the field."""
        return self.part.bounded

    def range(self, lo: ArrayLike, hi: ArrayLike) -> FloatArray:
        """See `Field.range`: on the boxes of space that hold the images."""
        box = self.through.boxes(*as_boxes(lo, hi))
        return self.part.range(box[:, 0], box[:, 1])

    @property
    def bounds(self) -> FloatArray:
        """The parameter box, shape (2, 3)."""
        return self.through.domain


def pull_back(part: Field, through: Map) -> Node:
    """A field of space as a function of the parameters of a map: f(x(u)).

    Parameters
    ----------
    part : Field
        Any field; negative inside.
    through : Map
        From parameters to space, such as a `SplineMap`.

    Returns
    -------
    Node
        Over the domain of the map, to be combined with fields of the parameters: that of a wall
        is ``wall.field``.

    Raises
    ------
    InputError
        If `part` is no field, or `through` no map.

    Examples
    --------
    >>> import ilattice as il
    >>> wall = il.Lattice("gyroid", through=il.macroshape.box((2, 2, 2)), repeat=2).offset(0.1)
    >>> sphere = il.fields.translate(il.fields.sphere(0.9), (1, 1, 1))
    >>> ball = il.fields.pull_back(sphere, wall.through)
    >>> part = il.fields.intersection(wall.field, ball)
    >>> rule = il.cutfem.cut(part, 16, through=wall.through).volume()
    >>> 0.0 < rule.in_space().integrate() < wall.volume()
    True
    """
    if not isinstance(through, Map):
        raise InputError(f"through must be a map such as a SplineMap, got {through!r:.80}")
    return as_node("part", PulledBack(as_node("part", part), through))
