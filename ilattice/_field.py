"""`Field`: the base of every class of fields, and what a class that defines less still does.

Guarantee: a combinator that takes one field takes them all. What a class does not define has the
defaults below; `Field.has` tells which of both it is, so that nobody has to guess from attributes.
Non-guarantee: default derivatives are differences, default bounds are those that a Lipschitz
constant gives, or infinite.
"""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from ilattice._geometry import grid_points
from ilattice._shown import Shown
from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import among, as_array, as_items, as_points, as_real
from ilattice.errors import InputError

#: Step of the differences of gradients, relative to coordinates above 1: about the root of the
#: rounding of gradients by closest points.
SLOPE_STEP = 1e-5
#: Step of the differences that stand for derivatives.
STEP = 1e-4
#: What a field can define itself.
ABILITIES = (
    "jet", "grid", "range", "bounds", "lipschitz", "bounding_box", "node", "repeats", "flattened",
    "breaks", "analysis_box", "shown_box", "sums",
)  # fmt: skip
#: Which of them wrappers have only if what they wrap does.
OF_THE_INNER = ("jet", "range")


class Field(Shown):
    """A real function of points, negative inside: the base of every class of fields.

    A class of fields defines `__call__`, and what else it knows better than these defaults:

    ================  ==========================================================================
    `jet`             value, gradient, Hessian: by central differences
    `grid`            values on a tensor grid: at its points
    `range`           bounds on boxes: from `lipschitz`, or infinite
    `bounds`          box of the zero set: all of space
    `bounding_box`    box of a level: `bounds` up to level 0, all of space above
    `lipschitz`       bound of the slope: infinite
    `node`            the same as a node of `ilattice.fields`: none
    `repeats`         axes along which it repeats on the unit cube: not known
    `flattened`       a smoother field for splines: itself
    `breaks`          planes between its smooth pieces: none known
    `analysis_box`    box in which it is analysed: `bounds`
    `shown_box`       box in which pictures show it: `bounds`
    `sums`            sums of splines of which it is the largest: none
    ================  ==========================================================================
    """

    __slots__ = ()

    def __call__(self, p: ArrayLike, /) -> FloatArray:
        """Values, shape (n,), at points ``p`` (n, 3)."""
        raise NotImplementedError

    def has(self, name: str) -> bool:
        """Whether the field defines one of `ABILITIES` itself.

        Parameters
        ----------
        name : str
            Which one.

        Returns
        -------
        bool
            False where it has the default, also because the field that it wraps has.

        Raises
        ------
        InputError
            For another name.
        """
        if not among(name, ABILITIES):
            raise InputError(f"name must be one of {', '.join(ABILITIES)}, got {name!r:.80}")
        return self._has(name)

    def _has(self, name: str) -> bool:
        """`has` for a name that is known; wrappers ask what they wrap."""
        return getattr(type(self), name) is not getattr(Field, name)

    def jet(self, p: ArrayLike, order: int = 2) -> tuple[FloatArray, ...]:
        """Value and derivatives.

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
            For another order.
        """
        if not among(order, (0, 1, 2)):
            raise InputError(f"order must be 0, 1 or 2, got {order!r}")
        points = as_points("p", p)
        value = self(points)
        return (value,) if order == 0 else differences(self, points, value, order)

    def grid(self, axes: Iterable[ArrayLike]) -> Any:
        """Values on a tensor grid.

        Parameters
        ----------
        axes : iterable of array_like
            1-D arrays of coordinates.

        Returns
        -------
        ndarray
            Values, one axis per direction.
        """
        ticks = [as_array(f"axes[{i}]", a, ndim=1) for i, a in enumerate(as_items("axes", axes))]
        if not ticks:
            raise InputError("axes must be 1-D arrays of coordinates, got none")
        points = grid_points(*ticks)
        return self(points).reshape(tuple(len(a) for a in ticks))

    def range(self, lo: ArrayLike, hi: ArrayLike) -> FloatArray:
        """Rigorous bounds of the values on boxes.

        Parameters
        ----------
        lo, hi : array_like, shape (n, 3)
            Corners.

        Returns
        -------
        ndarray, shape (n, 2)
            Lower and upper bounds.

        Raises
        ------
        InputError
            For corners of different shapes, not finite or in the wrong order.
        """
        a, b = as_boxes(lo, hi)
        steep = self.lipschitz
        if not np.isfinite(steep):
            return np.tile([-np.inf, np.inf], (len(a), 1))
        value = self(0.5 * (a + b))
        reach = steep * 0.5 * np.linalg.norm(b - a, axis=1)
        return np.stack((value - reach, value + reach), axis=1)

    @property
    def bounds(self) -> FloatArray:
        """Box (2, 3) that holds the zero set, perhaps infinite."""
        return np.array([[-np.inf] * 3, [np.inf] * 3])

    @property
    def lipschitz(self) -> float:
        """Upper bound of the length of the gradient, perhaps infinite."""
        return np.inf

    def bounding_box(self, level: float = 0.0) -> FloatArray:
        """Box that holds where the field is at most `level`.

        Parameters
        ----------
        level : float
            The level.

        Returns
        -------
        ndarray, shape (2, 3)
            Lower and upper corner.
        """
        if as_real("level", level) <= 0.0:
            return np.array(self.bounds)
        return np.array([[-np.inf] * 3, [np.inf] * 3])

    @property
    def node(self) -> Any:
        """The same as a node of `ilattice.fields`, or None."""
        return None

    @property
    def repeats(self) -> tuple[bool, bool, bool] | None:
        """Axes along which it repeats on the unit cube, or None if that is not known."""
        return None

    def flattened(self, level: float = 0.0) -> Any:  # noqa: ARG002
        """A smoother field of the same zero set {f = level}, for splines, or None.

        Parameters
        ----------
        level : float
            Level of the zero set.

        Returns
        -------
        Field or None
            None where the field is smooth enough itself.
        """
        return None

    def breaks(self, axis: int) -> FloatArray | None:  # noqa: ARG002
        """Planes between which the field is smooth, such as knots of splines.

        Parameters
        ----------
        axis : {0, 1, 2}
            Direction.

        Returns
        -------
        ndarray, shape (n,), or None
            Where they are; None where that is not known.
        """
        return None

    @property
    def analysis_box(self) -> FloatArray:
        """Box (2, 3) in which a solid of the field is analysed."""
        return np.asarray(self.bounds, np.float64)

    @property
    def bounded(self) -> bool:
        """Whether all that it is made of has bounds; else nothing about it is certified."""
        return self.has("range")

    @property
    def approximation(self) -> Any:
        """A spline near the field, which integrals of walls take in its place, or None."""
        return None

    @property
    def shown_box(self) -> FloatArray:
        """Box (2, 3) in which pictures show the field, perhaps infinite."""
        return np.asarray(self.bounds, np.float64)

    def sums(self) -> tuple[tuple[Any, ...], FloatArray] | None:
        """Sums of splines of which the field is the largest; quadrature takes them as they are.

        Returns
        -------
        tuple of (tuple of BSpline, ndarray), or None
            Splines, and factors (sets, splines) by which the sums are made of them; None where
            the field is none of that kind.
        """
        return None


def as_boxes(lo: ArrayLike, hi: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Corners (n, 3) of boxes, checked."""
    a, b = as_points("lo", lo), as_points("hi", hi)
    if a.shape != b.shape or (a > b).any():
        raise InputError(
            f"lo and hi must have one shape and lo <= hi, got shapes {a.shape} and {b.shape}"
        )
    return a, b


def owns(f: Any, name: str) -> bool:
    """Whether a field, or somebody else's callable, defines one of `ABILITIES` itself."""
    return f.has(name) if isinstance(f, Field) else hasattr(f, name)


def bounded(f: Any) -> bool:
    """Whether a field, or somebody else's callable, has bounds in all that it is made of."""
    return f.bounded if isinstance(f, Field) else owns(f, "range")


def differences(
    f: Callable[[FloatArray], FloatArray], points: FloatArray, value: FloatArray, order: int
) -> tuple[FloatArray, ...]:
    """Value and derivatives up to `order`, 1 or 2, of a function by central differences."""
    e = STEP * np.eye(3)
    up = np.stack([f(points + e[k]) for k in range(3)], axis=1)
    down = np.stack([f(points - e[k]) for k in range(3)], axis=1)
    first = (up - down) / (2.0 * STEP)
    if order == 1:
        return value, first
    H = np.empty((len(points), 3, 3))
    for i in range(3):
        H[:, i, i] = (up[:, i] - 2.0 * value + down[:, i]) / STEP**2
        for k in range(i):
            far = f(points + e[i] + e[k]) + f(points - e[i] - e[k])
            ends = up[:, i] + down[:, i] + up[:, k] + down[:, k]
            H[:, i, k] = H[:, k, i] = (far - ends + 2.0 * value) / (2.0 * STEP**2)
    return value, first, H


def hessians(slope: Callable[[FloatArray], FloatArray], points: FloatArray) -> FloatArray:
    """Hessians (n, 3, 3) by central differences of gradients (n, 3), made symmetric."""
    step = SLOPE_STEP * max(1.0, float(np.abs(points).max(initial=0.0)))
    rows = [(slope(points + e) - slope(points - e)) / (2.0 * step) for e in step * np.eye(3)]
    H = np.stack(rows, axis=1)
    out: FloatArray = 0.5 * (H + H.transpose(0, 2, 1))
    return out
