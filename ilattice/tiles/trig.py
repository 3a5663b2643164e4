"""Fields that are separable trigonometric polynomials: all nodal approximations of the TPMS.

Guarantees: value, gradient and Hessian are those of the polynomial to rounding; `range` is
rigorous, rounding included; `lipschitz` is an upper bound of the gradient everywhere. Results do
not depend on the number of threads. Not guaranteed: `range` is an enclosure, not the exact range
(it converges with the square of the box), and `lipschitz` is not the smallest constant.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from ilattice._field import Field
from ilattice._shown import one_line
from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray
from ilattice._validate import (
    among,
    as_array,
    as_float_type,
    as_items,
    as_points,
    as_triple,
    read_only,
)
from ilattice.errors import InputError
from ilattice.fields.node import Node
from ilattice.tiles import _terms
from ilattice.tiles._kernels import jets
from ilattice.tiles._kernels_gradient import gradients, values
from ilattice.tiles._kernels_grid import tensor_grid
from ilattice.tiles._kernels_range import ranges
from ilattice.tiles._node import TrigNode

_IDENTITY = read_only(np.eye(3))


@dataclass(frozen=True, eq=False)
class TrigField(Field):
    """``f(p) = sum_i coef[i] F[i, 0](X) F[i, 1](Y) F[i, 2](Z)``, with sines and cosines F.

    ``(X, Y, Z) = 2 pi (linear p) / period``. Fields of equal period and `linear` can be added,
    subtracted and multiplied; numbers count as constant fields.

    Parameters
    ----------
    coef : array_like, shape (m,)
        Coefficients.
    factor : array_like of int, shape (m, 3)
        Factor of each term on each axis: 0 is the constant 1, ``2 h - 1`` the cosine and ``2 h``
        the sine of the h-th harmonic, h up to 32. Equal terms are merged.
    period : float or array_like, shape (3,)
        Period along each axis after `linear`; default 1.
    linear : array_like, shape (3, 3), optional
        Matrix applied to the points first. A tile of a hexagonal cell is given in fractional
        coordinates without it; `placed` adds it.

    Raises
    ------
    InputError
        For shapes that do not match, values that are not finite, codes out of range, a period
        that is not positive, or a singular `linear`.

    Examples
    --------
    >>> gyroid = TrigField.parse("sum[cosX sinY]")
    >>> float(gyroid([[0.0, 0.25, 0.0]])[0])
    1.0
    """

    coef: FloatArray
    factor: IntArray
    period: FloatArray = None  # type: ignore[assignment]
    linear: FloatArray | None = None

    def __post_init__(self) -> None:
        coef = as_array("coef", self.coef, ndim=1)
        as_array("factor", self.factor)
        factor = np.asarray(self.factor)
        if factor.size == 0:
            factor = np.zeros((0, 3), np.int64)
        if factor.shape != (len(coef), 3) or not np.issubdtype(factor.dtype, np.integer):
            raise InputError(
                f"factor must hold whole numbers, shape ({len(coef)}, 3) for {len(coef)} "
                f"coefficients, got {factor.dtype} of shape {factor.shape}"
            )
        low, high = factor.min(initial=0), factor.max(initial=0)
        if low < 0 or high > 2 * _terms.MAX_HARMONIC:
            raise InputError(f"factor must lie in 0..{2 * _terms.MAX_HARMONIC}, got {low}..{high}")
        period = as_triple("period", 1.0 if self.period is None else self.period, positive=True)
        self._set(_as_terms(coef, factor), period, _as_linear(self.linear))

    def _set(self, terms: _terms.Terms, period: FloatArray, linear: FloatArray | None) -> None:
        """Write the attributes: terms merged, sorted and read-only."""
        kept = _terms.pruned(terms)
        coef = np.array(list(kept.values()), dtype=np.float64)
        factor = np.array(list(kept), dtype=np.int64).reshape(-1, 3)
        object.__setattr__(self, "coef", read_only(coef))
        object.__setattr__(self, "factor", read_only(factor))
        object.__setattr__(self, "period", read_only(np.array(period)))
        object.__setattr__(self, "linear", linear)

    @classmethod
    def _make(
        cls, terms: _terms.Terms, period: FloatArray, linear: FloatArray | None = None
    ) -> Self:
        """Inner constructor: nothing is checked but the harmonics."""
        if any(max(key) > 2 * _terms.MAX_HARMONIC for key in terms):
            raise InputError(f"the product has harmonics above {_terms.MAX_HARMONIC}")
        self = object.__new__(cls)
        self._set(terms, period, linear)
        return self

    @classmethod
    def parse(cls, text: str, *, period: ArrayLike = 1.0) -> Self:
        """Field of an expression such as ``"2 sum[cosX cosY] - sum[cos2X]"``.

        Parameters
        ----------
        text : str
            Sums and products of numbers, ``sqrt(3)``, ``cosX``, ``sin2Y``, ``cos(3X-Y)``;
            ``sum[...]`` adds the two cyclic shifts X -> Y -> Z -> X.
        period : float or array_like, shape (3,)
            Length of the cell along each axis.

        Returns
        -------
        TrigField
            The expanded polynomial.

        Raises
        ------
        InputError
            For text outside the notation, with the position.
        """
        triple = as_triple("period", period, positive=True)
        if not isinstance(text, str):
            raise InputError(f"text must be an equation, got {text!r:.80}")
        return cls._make(_terms.parse(text), triple)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore from a pickle, which forgets that arrays are read-only."""
        for name, value in state.items():
            object.__setattr__(self, name, value if value is None else read_only(value))

    def __repr__(self) -> str:
        """Short form: the expression, if it is short."""
        text = str(self) if len(self.coef) <= 8 else f"{len(self.coef)} terms"
        return one_line(f"TrigField({text}, period={self.period.tolist()})")

    def __str__(self) -> str:
        """Expression that `parse` understands."""
        return _terms.text(self._terms)

    # ------------------------------------------------------------------ evaluation

    def __call__(self, p: ArrayLike, /) -> FloatArray:
        """Values, shape (n,), at points ``p`` (n, 3)."""
        out: FloatArray = values(self.coef, self.factor, self._frequency, self._inner(p))
        return out

    def jet(self, p: ArrayLike, order: int = 2) -> tuple[FloatArray, ...]:
        """Value and derivatives in one pass.

        Parameters
        ----------
        p : array_like, shape (n, 3)
            Points.
        order : int
            Highest derivative: 0, 1 or 2.

        Returns
        -------
        tuple of arrays
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
        args = self.coef, self.factor, self._frequency, self._inner(p)
        f, g, *hess = gradients(*args) if order == 1 else jets(*args)
        if self.linear is not None:
            g = _product(g, self.linear)
            m = self.linear
            hess = [_product(_product(h, m).transpose(0, 2, 1), m) for h in hess]
        return (f, g, *hess)

    def grid(
        self,
        axes: Iterable[ArrayLike],
        dtype: Any = np.float64,
        *,
        out: AnyArray | None = None,
    ) -> AnyArray:
        """Values on a tensor grid.

        Parameters
        ----------
        axes : iterable of array_like
            Three 1-D arrays of coordinates.
        dtype : numpy.dtype
            ``numpy.float64`` or ``numpy.float32``.
        out : ndarray, optional
            Array to write to, C-contiguous, of the right shape and type.

        Returns
        -------
        ndarray, shape (len(x), len(y), len(z))
            Values, equal to those at single points up to rounding.

        Raises
        ------
        InputError
            For axes that are not three 1-D arrays, another type, or an `out` that does not fit.
        """
        xyz = tuple(as_array(f"axes[{i}]", a, ndim=1) for i, a in enumerate(as_items("axes", axes)))
        if len(xyz) != 3:
            raise InputError(f"axes must be three 1-D arrays, got {len(xyz)}")
        kind = np.dtype(as_float_type("dtype", dtype))
        shape = tuple(len(a) for a in xyz)
        if out is None:
            out = np.empty(shape, kind)
        elif (
            not isinstance(out, np.ndarray)
            or out.shape != shape
            or out.dtype != kind
            or not out.flags.c_contiguous
        ):
            raise InputError(f"out must be a C-contiguous {kind} array of shape {shape}")
        if self.linear is not None:
            for i, x in enumerate(xyz[0]):
                out[i] = self(_plane(x, xyz[1], xyz[2])).reshape(shape[1:])
        elif out.size:
            slot, tx, ty, tz = self._tables(xyz, kind)
            tensor_grid(len(out), self.coef, slot, tx, ty, tz, out)
        return out

    def range(self, lo: ArrayLike, hi: ArrayLike) -> FloatArray:
        """Rigorous bounds of the values on boxes, rounding errors included.

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
        a, b = as_points("lo", lo), as_points("hi", hi)
        if a.shape != b.shape or (a > b).any():
            raise InputError(
                f"lo and hi must have one shape and lo <= hi, got shapes {a.shape} and {b.shape}"
            )
        lin = _IDENTITY if self.linear is None else self.linear
        w = self._frequency
        out: FloatArray = ranges(self.coef, self.factor, w, lin, _own(a), _own(b))
        return out

    # ------------------------------------------------------------------ properties

    @property
    def bounds(self) -> FloatArray:
        """Box (2, 3) that holds one period; the field itself goes on for ever."""
        edges: AnyArray = np.diag(self.period)
        if self.linear is not None:
            edges = np.linalg.solve(self.linear, edges)
        return np.stack([np.minimum(edges, 0).sum(axis=1), np.maximum(edges, 0).sum(axis=1)])

    @property
    def lipschitz(self) -> float:
        """Upper bound of the length of the gradient: sum of amplitude times |k| over all modes."""
        waves, amplitude = self.modes()
        k = (2.0 * np.pi * waves / self.period) @ _matrix(self.linear)
        return float(np.sum(np.abs(amplitude) * np.linalg.norm(k, axis=1)))

    @property
    def node(self) -> Node:
        """The field as instructions, for `ilattice.fields`."""
        return TrigNode(self)

    def modes(self) -> tuple[IntArray, AnyArray]:
        """Fourier series ``f = sum_j amplitude[j] exp(2 pi i waves[j] . (linear p) / period)``.

        Returns
        -------
        waves : ndarray of int, shape (k, 3)
            Wave vectors, each once.
        amplitude : ndarray of complex, shape (k,)
            Amplitudes.
        """
        series: dict[tuple[int, ...], complex] = {}
        for c, codes in zip(self.coef, self.factor, strict=True):
            partial: dict[tuple[int, ...], complex] = {(): complex(c)}
            for code in codes:
                h = int(code + 1) // 2
                ends = {0: 1.0 + 0j} if h == 0 else {h: 0.5 + 0j, -h: 0.5 + 0j}
                if h and code % 2 == 0:
                    ends = {h: -0.5j, -h: 0.5j}
                partial = {(*k, e): v * u for k, v in partial.items() for e, u in ends.items()}
            for k, v in partial.items():
                series[k] = series.get(k, 0j) + v
        top = max((abs(v) for v in series.values()), default=0.0)
        kept = {k: v for k, v in sorted(series.items()) if abs(v) > 1e-15 * top}
        waves = np.array(list(kept), dtype=np.int64).reshape(-1, 3)
        return waves, np.array(list(kept.values()), dtype=np.complex128)

    def placed(self, linear: ArrayLike | None) -> "TrigField":
        """The same polynomial, evaluated at ``linear @ p``.

        Parameters
        ----------
        linear : array_like, shape (3, 3), optional
            Regular matrix that replaces the present one; None removes it.

        Returns
        -------
        TrigField
            The field with that `linear`.

        Raises
        ------
        InputError
            If the matrix is singular or of another shape.
        """
        return TrigField._make(self._terms, self.period, _as_linear(linear))

    def stretched(self, factor: ArrayLike) -> "TrigField":
        """The same polynomial with longer or shorter periods.

        Parameters
        ----------
        factor : float or array_like, shape (3,)
            Positive factors of the periods.

        Returns
        -------
        TrigField
            ``f(p / factor)``, where `linear` is None.
        """
        times = as_triple("factor", factor, positive=True)
        return TrigField._make(self._terms, self.period * times, self.linear)

    # ------------------------------------------------------------------ algebra

    def __add__(self, other: "TrigField | float") -> "TrigField":
        return self._with(_terms.add(self._terms, self._operand(other)))

    def __sub__(self, other: "TrigField | float") -> "TrigField":
        return self._with(_terms.add(self._terms, self._operand(other), -1.0))

    def __mul__(self, other: "TrigField | float") -> "TrigField":
        return self._with(_terms.multiply(self._terms, self._operand(other)))

    def __rsub__(self, other: float) -> "TrigField":
        return self._with(_terms.add(self._operand(other), self._terms, -1.0))

    def __neg__(self) -> "TrigField":
        return self * -1.0

    __radd__ = __add__
    __rmul__ = __mul__

    def _with(self, terms: _terms.Terms) -> "TrigField":
        return TrigField._make(terms, self.period, self.linear)

    def _operand(self, other: "TrigField | float") -> _terms.Terms:
        """Terms of the other operand, which must share period and linear map."""
        if not isinstance(other, TrigField):
            value = as_array("operand", other)
            if value.size != 1:
                raise InputError(f"operand must be a TrigField or one number, got {other!r:.80}")
            return {(0, 0, 0): float(value.ravel()[0])}
        same = np.array_equal(self.period, other.period)
        if self.linear is not None or other.linear is not None:
            same = same and np.array_equal(_matrix(self.linear), _matrix(other.linear))
        if not same:
            raise InputError(
                f"fields of different cells cannot be combined: periods {self.period} and "
                f"{other.period}, linear maps {self.linear} and {other.linear}"
            )
        return other._terms

    # ------------------------------------------------------------------ inner

    @property
    def _terms(self) -> _terms.Terms:
        return _as_terms(self.coef, self.factor)

    @property
    def _frequency(self) -> FloatArray:
        """Angle per length on each axis."""
        return 2.0 * np.pi / self.period

    def _inner(self, p: ArrayLike) -> FloatArray:
        """Checked points after the linear map."""
        points = as_points("p", p)
        return _own(points if self.linear is None else _product(points, self.linear.T))

    def _tables(self, xyz: tuple[FloatArray, ...], kind: Any) -> tuple[AnyArray, ...]:
        """Slots and per-axis tables for `tensor_grid`; only factors that occur."""
        slot = np.empty_like(self.factor)
        tables: list[AnyArray] = []
        for axis in range(3):
            codes, slot[:, axis] = np.unique(self.factor[:, axis], return_inverse=True)
            turns = xyz[axis] / self.period[axis]
            turns = turns - np.rint(turns)
            if axis == 2:
                slot[:, axis] += 0 if codes.size and codes[0] == 0 else 1
                codes = codes[codes > 0]
            angle = 2.0 * np.pi * ((codes + 1) // 2)[:, None] * turns
            sine = (codes > 0) & (codes % 2 == 0)
            tables.append(np.where(sine[:, None], np.sin(angle), np.cos(angle)))
        rows = max(2, len(tables[2]) + len(tables[2]) % 2)
        tz = np.zeros((rows, len(xyz[2])), kind)
        tz[: len(tables[2])] = tables[2]
        return slot, tables[0], tables[1], tz


def _as_terms(coef: FloatArray, factor: IntArray) -> _terms.Terms:
    terms: _terms.Terms = {}
    for value, (a, b, c) in zip(coef.tolist(), factor.tolist(), strict=True):
        terms[a, b, c] = terms.get((a, b, c), 0.0) + value
    return terms


def _as_linear(linear: ArrayLike | None) -> FloatArray | None:
    if linear is None:
        return None
    matrix = np.array(as_array("linear", linear, ndim=2))
    if matrix.shape != (3, 3) or np.linalg.matrix_rank(matrix) < 3:
        raise InputError(f"linear must be a regular matrix of shape (3, 3), got {linear!r:.120}")
    frozen: FloatArray = read_only(matrix)
    return frozen


def _matrix(linear: FloatArray | None) -> FloatArray:
    matrix: FloatArray = _IDENTITY if linear is None else linear
    return matrix


def _product(a: FloatArray, matrix: FloatArray) -> FloatArray:
    """``a @ matrix`` with bits that do not depend on the number of rows (those of BLAS do)."""
    x, y, z = (a[..., i, None] * matrix[i] for i in range(3))
    out: FloatArray = x + y + z
    return out


def _own(a: FloatArray) -> FloatArray:
    """A writable array: kernels are compiled for one type only."""
    return a if a.flags.writeable else a.copy()


def _plane(x: float, y: FloatArray, z: FloatArray) -> FloatArray:
    """Points of one grid plane of constant x, shape (len(y) * len(z), 3)."""
    yy, zz = np.meshgrid(y, z, indexing="ij")
    return np.stack([np.full(yy.size, x), yy.ravel(), zz.ravel()], axis=1)
