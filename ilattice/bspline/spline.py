"""The class `BSpline`: curves, surfaces and volumes, scalar or vector, rational or not.

Guarantees: values and derivatives agree with the Cox-de Boor definition to rounding for
degrees 0 to 8, the right end of the domain included; `range` is rigorous; instances are
immutable. Non-guarantees: derivatives at a knot are those of the span on its right (at the
right end: on its left); between knots of full multiplicity a spline may jump.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ilattice._field import Field
from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import (
    among,
    as_array,
    as_axis,
    as_flag,
    as_items,
    as_knots,
    as_own,
    as_points,
    as_whole,
    check_finite,
    per_direction,
    read_only,
)
from ilattice.bspline import _kernels
from ilattice.bspline.bezier import BezierCells, range_on_boxes, to_bezier
from ilattice.bspline.knots import elevation_matrix, greville, insertion_matrix, wrap
from ilattice.errors import InputError

#: Highest degree, and largest finite number.
MAX_DEGREE = 8
LARGEST = np.finfo(np.float64).max
#: Degree triples for which kernels are specialised; all others share one generic kernel.
SPECIALISED = {(1, 1, 1), (2, 2, 2), (3, 3, 3), (3, 1, 1), (2, 1, 1)}


class BSpline(Field):
    """Tensor-product B-spline with one to three parameters.

    Parameters
    ----------
    t : sequence of array_like
        One full, non-decreasing knot vector per parameter, of length ``n + k + 1``.
    c : array_like, shape (n0[, n1[, n2]]) or (n0[, n1[, n2]], m)
        Coefficients: scalar, or vector with `m` components. Cartesian, that is never
        multiplied by the weights.
    k : int or sequence of int
        Degree per parameter, 0 to 8.
    periodic : bool or sequence of bool
        Directions in which the spline is periodic. The wrapped copies are stored: the last
        ``k`` coefficients equal the first ``k``, and the domain is ``[t[k], t[n]]``.
    weights : array_like, shape (n0[, n1[, n2]]), optional
        Positive weights of a rational spline.

    Raises
    ------
    InputError
        If shapes disagree, knots decrease, a value is not finite, a weight is not positive,
        or the wrapped copies of a periodic direction differ.

    Notes
    -----
    Knots, coefficients and degree are named and laid out as in `scipy.interpolate.NdBSpline`.
    """

    file_kind: ClassVar[str] = "spline"
    t: tuple[FloatArray, ...]
    c: FloatArray
    k: tuple[int, ...]
    periodic: tuple[bool, ...]
    weights: FloatArray | None

    def __init__(
        self,
        t: Sequence[ArrayLike],
        c: ArrayLike,
        k: int | Sequence[int],
        *,
        periodic: bool | Sequence[bool] = False,
        weights: ArrayLike | None = None,
    ) -> None:
        nd = len(as_items("t", t))
        if not 1 <= nd <= 3:
            raise InputError(f"t must hold 1 to 3 knot vectors, got {t!r:.80}")
        c = as_own("c", c)
        if c.ndim not in (nd, nd + 1):
            raise InputError(
                f"c must have {nd} or {nd + 1} axes for {nd} knot vectors, got {c.ndim}"
            )
        degree = per_direction("k", k, nd)
        for v in degree:
            number = isinstance(v, (int, float, np.number)) and not isinstance(v, bool)
            if not (number and 0 <= v <= MAX_DEGREE and int(v) == v):
                raise InputError(f"k must be whole degrees from 0 to {MAX_DEGREE}, got {k!r}")
        knots = [np.array(as_knots(f"t[{i}]", t[i], c.shape[i], int(degree[i]))) for i in range(nd)]
        closed = per_direction("periodic", periodic, nd)
        self.__dict__.update(
            t=tuple(read_only(v) for v in knots),
            c=read_only(c),
            k=tuple(int(v) for v in degree),
            periodic=tuple(as_flag("periodic", v) for v in closed),
            weights=None if weights is None else _as_weights(weights, c.shape[:nd]),
        )
        self._check_wrapped()

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"BSpline is immutable: cannot set {name} to {value!r:.40}")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"BSpline is immutable: cannot delete {name}")

    def __reduce__(self) -> tuple[Any, ...]:
        """Made anew by `pickle` and `copy`: arrays that they restore may be written to."""
        return _restored, (self.t, self.c, self.k, self.periodic, self.weights)

    def __repr__(self) -> str:
        kind = "scalar" if self.m == 0 else f"{self.m} components"
        extra = ", rational" if self.weights is not None else ""
        return f"BSpline(shape={self.shape}, k={self.k}, {kind}, periodic={self.periodic}{extra})"

    def _check_wrapped(self) -> None:
        arrays = [self.c] if self.weights is None else [self.c, self.weights]
        for axis in range(self.ndim):
            k, n, t = self.k[axis], self.shape[axis], self.t[axis]
            if not self.periodic[axis] or k == 0:
                continue
            if n < 2 * k:
                raise InputError(
                    f"c has {n} coefficients along periodic axis {axis}: at least 2k = {2 * k} "
                    "are needed, wrapped copies included"
                )
            for a in arrays:
                head, tail = np.take(a, range(k), axis), np.take(a, range(n - k, n), axis)
                if np.abs(head - tail).max(initial=0) > 1e-9 * np.abs(a).max(initial=1e-300):
                    raise InputError(
                        f"c is not periodic along axis {axis}: its last {k} coefficients must "
                        "repeat its first"
                    )
            period = t[n] - t[k]
            if np.abs(t[n - k :][: 2 * k + 1] - t[: 2 * k + 1] - period).max() > 1e-9 * period:
                raise InputError(
                    f"t[{axis}] is not periodic: t[n-k+i] - t[i] must be the period {period:g}"
                )

    @property
    def ndim(self) -> int:
        """Number of parameters."""
        return len(self.t)

    @property
    def m(self) -> int:
        """Number of components; 0 for a scalar spline."""
        return int(self.c.shape[-1]) if self.c.ndim > self.ndim else 0

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of coefficients per parameter, wrapped copies included."""
        return self.c.shape[: self.ndim]

    @cached_property
    def domain(self) -> FloatArray:
        """The parameter box, shape (2, ndim): rows are the lower and the upper corner."""
        ends = [(t[k], t[n]) for t, k, n in zip(self.t, self.k, self.shape, strict=True)]
        return read_only(np.array(ends).T.copy())

    @property
    def bounds(self) -> FloatArray:
        """The domain, under the name that fields have."""
        return self.domain

    # ---------------------------------------------------------------- evaluation

    @cached_property
    def _directions(self) -> tuple[FloatArray, ...]:
        dirs = [
            _kernels.pack_direction(t, k, n)
            for t, k, n in zip(self.t, self.k, self.shape, strict=True)
        ]
        unit = _kernels.pack_direction(np.array([0.0, 1.0]), 0, 1)
        return tuple(dirs + [unit] * (3 - self.ndim))

    @cached_property
    def _lengths(self) -> tuple[Any, Any, Any]:
        k = self.k + (0,) * (3 - self.ndim)
        if k in SPECIALISED:
            return ((0,) * (k[0] + 1), (0,) * (k[1] + 1), (0,) * (k[2] + 1))
        a, b, c = (np.zeros(v + 1, np.int64) for v in k)
        return a, b, c

    @cached_property
    def _components(self) -> FloatArray:
        """Coefficients component first, (M, n0, n1, n2); homogeneous if rational."""
        c = self.c if self.m else self.c[..., None]
        if self.weights is not None:
            w = self.weights[..., None]
            c = np.concatenate([c * w, w], axis=-1)
        c = np.moveaxis(c, -1, 0).reshape((c.shape[-1], *self.shape, *(1,) * (3 - self.ndim)))
        return read_only(np.ascontiguousarray(c))

    @property
    def kernel_args(self) -> tuple[Any, ...]:
        """What compiled code needs: three directions, three lengths, the coefficients."""
        return (*self._directions, *self._lengths, self._components)

    @property
    def generic_kernel_args(self) -> tuple[Any, ...]:
        """As `kernel_args`, for kernels that must not be compiled once per degree."""
        k = self.k + (0,) * (3 - self.ndim)
        lengths = (np.zeros(v + 1, np.int64) for v in k)
        return (*self._directions, *lengths, self._components)

    def _parameters(self, u: ArrayLike, extrapolate: str) -> FloatArray:
        """Points (n, 3) where kernels may evaluate: checked, wrapped, clamped."""
        u = as_array("u", u, finite=False)
        if self.ndim == 1 and u.ndim == 1:
            u = u[:, None]
        u = as_points("u", u, self.ndim, finite=False)
        if not among(extrapolate, ("raise", "clamp", "extend")):
            raise InputError(
                f"extrapolate must be 'raise', 'clamp' or 'extend', got {extrapolate!r}"
            )
        free = np.array(self.periodic) | (extrapolate != "raise")
        lo = np.where(free, -LARGEST, self.domain[0])
        hi = np.where(free, LARGEST, self.domain[1])
        if not _all_inside(u, lo, hi):
            check_finite("u", u)
            for axis in range(self.ndim):
                if not free[axis]:
                    self._check_inside(u[:, axis], axis)
        if self.ndim == 3 and extrapolate != "clamp" and self._in_period(u):
            return u
        out = np.full((len(u), 3), 0.5)
        for axis, (first, last) in enumerate(self.domain.T):
            x = u[:, axis]
            if self.periodic[axis]:
                x = wrap(x, self.t[axis], self.k[axis])
            elif extrapolate == "clamp":
                x = np.clip(x, first, last)
            out[:, axis] = x
        return out

    def _in_period(self, u: FloatArray) -> bool:
        """Whether no point needs to be wrapped."""
        if not any(self.periodic):
            return True
        low = np.where(self.periodic, self.domain[0], -LARGEST)
        high = np.where(self.periodic, np.nextafter(self.domain[1], -np.inf), LARGEST)
        return _all_inside(u, low, high)

    def _check_inside(self, x: FloatArray, axis: int) -> None:
        lo, hi = self.domain[:, axis]
        if x.min() < lo or x.max() > hi:
            i = int(np.argmax((x < lo) | (x > hi)))
            raise InputError(
                f"u[{i}, {axis}] = {x[i]} is outside the domain [{lo}, {hi}]; "
                "extrapolate='clamp' or 'extend' allows it"
            )

    def __call__(self, u: ArrayLike, *, extrapolate: str = "raise") -> FloatArray:
        """Value at points.

        Parameters
        ----------
        u : array_like, shape (n, ndim)
            Parameters; shape (n,) is accepted for a curve.
        extrapolate : {"raise", "clamp", "extend"}
            What happens outside the domain: an error, the value at the nearest point of the
            domain, or the continued end polynomials. Periodic directions always wrap.

        Returns
        -------
        ndarray, shape (n,) or (n, m)
            Values.

        Raises
        ------
        InputError
            If a point is not finite, or outside the domain with ``extrapolate="raise"``.
        """
        return self.jet(u, 0, extrapolate=extrapolate)[0]

    def jet(
        self, u: ArrayLike, order: int = 2, *, extrapolate: str = "raise"
    ) -> tuple[FloatArray, ...]:
        """Value, gradient and Hessian in one pass.

        Parameters
        ----------
        u : array_like, shape (n, ndim)
            Parameters.
        order : {0, 1, 2}
            Highest derivative.
        extrapolate : {"raise", "clamp", "extend"}
            As in `__call__`. With "clamp" derivatives are those of the clamped point.

        Returns
        -------
        tuple of ndarray
            The first ``order + 1`` of value (n,), gradient (n, ndim), Hessian
            (n, ndim, ndim); for a vector spline (n, m), (n, m, ndim), (n, m, ndim, ndim).

        Raises
        ------
        InputError
            If the order is not 0, 1 or 2, or a point is outside the domain.
        """
        if not among(order, (0, 1, 2)):
            raise InputError(f"order must be 0, 1 or 2, got {order!r}")
        p = self._parameters(u, extrapolate)
        n, size = len(p), self._components.shape[0]
        shapes = [(n, size), (n, size, 3), (n, size, 3, 3)][: order + 1]
        out: tuple[FloatArray, ...] = tuple(np.empty(s) for s in shapes)
        if self._components[0].size == 1:
            _fill(self._components, *out)
        else:
            kernel = (_kernels.values, _kernels.jets1, _kernels.jets2)[order]
            kernel(n, *self.kernel_args, p, *out)
        if self.weights is not None:
            out = _quotient(out)
        return tuple(self._trim(a, i) for i, a in enumerate(out))

    def _trim(self, a: FloatArray, order: int) -> FloatArray:
        """Drop the axes of parameters that do not exist, and that of a scalar's component."""
        if order and self.ndim < 3:
            a = a[(slice(None), slice(None)) + (slice(0, self.ndim),) * order]
        return np.ascontiguousarray(a if self.m else a[:, 0])

    def grid(
        self, axes: Iterable[ArrayLike], order: int = 0
    ) -> FloatArray | tuple[FloatArray, FloatArray]:
        """Value, and gradient for ``order=1``, on a tensor grid.

        Parameters
        ----------
        axes : sequence of array_like, shape (n_i,)
            Sample sites per parameter, inside the domain.
        order : {0, 1}
            Whether to return the gradient too.

        Returns
        -------
        ndarray, shape (n0[, n1[, n2]][, m])
            Values; with ``order=1`` a pair with the gradient, one more axis of length ndim.
            Arrays may be strided views.

        Raises
        ------
        InputError
            If the axes do not match the parameters, or leave the domain.
        """
        if not among(order, (0, 1)):
            raise InputError(f"order must be 0 or 1, got {order!r}")
        sites = self._axes(as_items("axes", axes))
        *dirs, k0, k1, k2, comps = self.generic_kernel_args
        tables = [
            _kernels.axis_basis(d, k, x, order)
            for d, k, x in zip(dirs, (k0, k1, k2), sites, strict=True)
        ]
        nx, ny, nz = (len(x) for x in sites)
        out = np.empty((len(comps), nx, 1 + 3 * order, ny, nz))
        flat = [a for pair in tables for a in pair]
        for m in range(len(comps)):
            _kernels.grid(nx, comps[m], *flat, out[m])
        if self.weights is not None:
            out = _quotient_grid(out)
        return self._grid_result(out, order)

    def _axes(self, axes: Sequence[ArrayLike]) -> list[FloatArray]:
        axes = as_items("axes", axes)
        if len(axes) != self.ndim:
            raise InputError(f"axes must hold {self.ndim} arrays, got {len(axes)}")
        sites = []
        for i, a in enumerate(axes):
            x = as_array(f"axes[{i}]", a, ndim=1)
            if self.periodic[i]:
                x = wrap(x, self.t[i], self.k[i])
            elif len(x):
                self._check_inside(x, i)
            sites.append(x)
        return sites + [np.array([0.5])] * (3 - self.ndim)

    def _grid_result(
        self, out: FloatArray, order: int
    ) -> FloatArray | tuple[FloatArray, FloatArray]:
        out = np.moveaxis(out, (0, 2), (-2, -1))
        out = out[(slice(None),) * self.ndim + (0,) * (3 - self.ndim)]  # axes that do not exist
        out = out if self.m else out[..., 0, :]
        return (out[..., 0], out[..., 1 : 1 + self.ndim]) if order else out[..., 0]

    def slabs(
        self, axes: Sequence[ArrayLike], order: int = 0, *, thickness: int = 16
    ) -> Iterator[tuple[int, int, Any]]:
        """Evaluate a tensor grid slab by slab along its first axis.

        Parameters
        ----------
        axes : sequence of array_like, shape (n_i,)
            Sample sites per parameter.
        order : {0, 1}
            As in `grid`.
        thickness : int
            Samples of the first axis per slab.

        Yields
        ------
        tuple
            First and last-plus-one index of the slab, and what `grid` returns for it.
        """
        axes, thickness = as_items("axes", axes), as_whole("thickness", thickness, 1, 2**31)
        if not axes:
            raise InputError(f"axes must hold {self.ndim} arrays, got none")
        first = as_array("axes[0]", axes[0], ndim=1)
        for i in range(0, len(first), thickness):
            stop = min(i + thickness, len(first))
            yield i, stop, self.grid((first[i:stop], *axes[1:]), order)

    def range(
        self, lo: ArrayLike, hi: ArrayLike, *, tight: bool = True, level: float | None = None
    ) -> FloatArray:
        """Rigorous bounds of a scalar spline on boxes, from Bernstein coefficients.

        Parameters
        ----------
        lo, hi : array_like, shape (m, ndim)
            Corners of the boxes; clipped to the domain.
        tight : bool
            Whether elements are restricted to the box; otherwise bounds are faster and wider.
        level : float, optional
            A value of interest: boxes that plainly exclude it keep the faster bounds.

        Returns
        -------
        ndarray, shape (m, 2)
            Lower and upper bounds.
        """
        return range_on_boxes(self, lo, hi, tight=tight, level=level)

    # ---------------------------------------------------------------- structure

    def breaks(self, axis: int) -> FloatArray:
        """Distinct knots inside the domain of one parameter, ends included.

        Parameters
        ----------
        axis : int
            Parameter.

        Returns
        -------
        ndarray, shape (spans + 1,)
            Increasing.
        """
        axis = as_axis("axis", axis, self.ndim)
        k, n = self.k[axis], self.shape[axis]
        return np.unique(self.t[axis][k : n + 1])

    def greville(self, axis: int) -> FloatArray:
        """Greville abscissae of one parameter: the mean of k inner knots each.

        Parameters
        ----------
        axis : int
            Parameter.

        Returns
        -------
        ndarray, shape (n,)
            One per coefficient.
        """
        axis = as_axis("axis", axis, self.ndim)
        return greville(self.t[axis], self.k[axis])

    def _with_axis(self, axis: int, t: FloatArray, k: int, matrix: Any) -> BSpline:
        """Same map, with the (homogeneous) coefficients of one axis multiplied by a matrix."""
        knots, degree = list(self.t), list(self.k)
        knots[axis], degree[axis] = t, k

        def apply(a: FloatArray) -> FloatArray:
            moved = np.moveaxis(a, axis, 0)
            new = matrix @ moved.reshape(len(moved), -1)
            return np.moveaxis(new.reshape(-1, *moved.shape[1:]), 0, axis)

        if self.weights is None:
            return BSpline(knots, apply(self.c), degree, periodic=self.periodic)
        w = apply(self.weights)
        spread = (lambda a: a[..., None]) if self.m else (lambda a: a)
        c = apply(self.c * spread(self.weights)) / spread(w)
        return BSpline(knots, c, degree, periodic=self.periodic, weights=w)

    def insert_knots(self, axis: int, knots: ArrayLike) -> BSpline:
        """Same spline with knots inserted into one parameter.

        Parameters
        ----------
        axis : int
            Parameter.
        knots : array_like, shape (q,)
            Knots inside the domain; repeat a knot to insert it more than once. A periodic
            direction stays periodic.

        Returns
        -------
        BSpline
            The refined spline.
        """
        axis, new = as_axis("axis", axis, self.ndim), as_array("knots", knots, ndim=1)
        t, matrix = insertion_matrix(self.t[axis], self.k[axis], new, periodic=self.periodic[axis])
        return self._with_axis(axis, t, self.k[axis], matrix)

    def elevate(self, axis: int, times: int = 1) -> BSpline:
        """Same spline with the degree of one parameter raised.

        Parameters
        ----------
        axis : int
            Parameter.
        times : int
            By how much.

        Returns
        -------
        BSpline
            Of the same values.
        """
        axis, times = as_axis("axis", axis, self.ndim), as_whole("times", times, 0, MAX_DEGREE)
        t, k, matrix = elevation_matrix(
            self.t[axis], self.k[axis], times, periodic=self.periodic[axis]
        )
        return self._with_axis(axis, t, k, matrix)

    def derivative(self, axis: int) -> BSpline:
        """Exact derivative spline along one parameter.

        Parameters
        ----------
        axis : int
            Parameter.

        Returns
        -------
        BSpline
            Of one degree less along the axis.

        Raises
        ------
        InputError
            If the spline is rational (its derivative is not of the same degree), or of
            degree 0 along the axis.
        """
        axis = as_axis("axis", axis, self.ndim)
        k, n, t = self.k[axis], self.shape[axis], self.t[axis]
        if self.weights is not None:
            raise InputError(
                "weights: the derivative of a rational spline is no such spline; use jet"
            )
        if k == 0:
            raise InputError(
                f"k[{axis}] is 0: a piecewise constant spline has no derivative spline"
            )
        gap = t[k + 1 : n + k] - t[1:n]
        factor = np.divide(k, gap, out=np.zeros_like(gap), where=gap > 0)
        shape = [1] * self.c.ndim
        shape[axis] = n - 1
        c = np.diff(self.c, axis=axis) * factor.reshape(shape)
        knots, degree = list(self.t), list(self.k)
        knots[axis], degree[axis] = t[1:-1], k - 1
        return BSpline(knots, c, degree, periodic=self.periodic)

    def to_bezier(self) -> BezierCells:
        """Bézier elements, one per box of knot spans.

        Returns
        -------
        BezierCells
            Their control points and weights.
        """
        return to_bezier(self)


def _as_weights(weights: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    w = as_own("weights", weights)
    if w.shape != shape:
        raise InputError(f"weights must have the shape of the coefficients {shape}, got {w.shape}")
    if (w <= 0).any():
        raise InputError(f"weights must be positive, the least is {w.min()}")
    return read_only(w)


def _all_inside(u: FloatArray, lo: FloatArray, hi: FloatArray) -> bool:
    """Whether all points u (n, nd) lie in the closed box; NaN does not."""
    out = np.ones(1, np.bool_)
    _kernels.inside(len(u), u, lo, hi, out)
    return bool(out[0])


def _fill(c: FloatArray, value: FloatArray, *derivatives: FloatArray) -> None:
    """The jet of a constant."""
    value[:] = c.ravel()
    for a in derivatives:
        a[:] = 0.0


def _quotient(out: tuple[FloatArray, ...]) -> tuple[FloatArray, ...]:
    """Quotient rule on homogeneous jets; the last component is the weight."""
    w = out[0][:, -1:]
    f = out[0][:, :-1] / w
    result: list[FloatArray] = [f]
    if len(out) > 1:
        w1 = out[1][:, -1:]
        g = (out[1][:, :-1] - f[..., None] * w1) / w[..., None]
        result.append(g)
    if len(out) > 2:
        cross = g[..., :, None] * w1[..., None, :]
        h = (
            out[2][:, :-1]
            - cross
            - np.swapaxes(cross, -1, -2)
            - f[..., None, None] * out[2][:, -1:]
        )
        result.append(h / w[..., None, None])
    return tuple(result)


def _quotient_grid(out: FloatArray) -> FloatArray:
    """Quotient rule on a grid, (M+1, nx, 1 or 4, ...) to (M, nx, 1 or 4, ...)."""
    w = out[-1]
    f = out[:-1, :, :1] / w[:, :1]
    if out.shape[2] == 1:
        return f
    return np.concatenate([f, (out[:-1, :, 1:] - f * w[:, 1:]) / w[:, :1]], axis=2)


def _restored(t: Any, c: FloatArray, k: Any, periodic: Any, weights: FloatArray | None) -> BSpline:
    """Spline of its parts."""
    return BSpline(t, c, k, periodic=periodic, weights=weights)
