"""Level sets as Bernstein tensors on the pieces of a grid.

The solid is where all of them are negative. A piece is a box on which each of them is one
polynomial: an element of the splines, or a cell of the grid where that is finer. A wall is the two
sets S - d_outer and -S - d_inner, never the one squared set, which has no slope to stand on.

Guarantees: splines up to degree 4, rational ones too, are represented exactly, up to rounding.
Other fields are interpolated on boxes (see `field_pieces`), with an estimate of the error of the
volume.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import comb
from typing import Any, ClassVar

import numpy as np

from ilattice._field import Field, bounded, owns
from ilattice._memory import need
from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray, Solid
from ilattice._validate import Frozen, as_array, as_points, asked, read_only
from ilattice.bspline import BSpline
from ilattice.bspline._kernels_bezier import restriction
from ilattice.bspline.knots import find_spans, with_planes
from ilattice.errors import InputError
from ilattice.fields.algebra import complement
from ilattice.fields.node import Node
from ilattice.fields.solids import level_sets_of
from ilattice.quadrature import _kernels_drive as kernels
from ilattice.quadrature import _kernels_single as singles
from ilattice.quadrature._filling import Content
from ilattice.quadrature._kernels_scratch import LOW
from ilattice.quadrature.field_pieces import FieldPieces, field_pieces

#: Highest degree of level sets, and numbers of coefficients for which kernels are unrolled.
MAX_DEGREE, UNROLLED = 4, (3, 4)
#: Pieces that are worked on at once.
BATCH = 1 << 14
PER_PIECE = 24  # bytes of memory
#: Coefficients along whole cells, up to which these are looked at before their pieces are.
LONG = 1 << 15


@dataclass(frozen=True, eq=False, repr=False)
class LevelSets(Frozen):
    """One or two level sets, or fields, over a box.

    Attributes
    ----------
    splines : tuple of BSpline
        What the sets are made of.
    factors : ndarray, shape (sets, splines)
        Each set is the sum of the splines times its row,
    shifts : ndarray, shape (sets,)
        plus its number here.
    fields : tuple
        Fields that are interpolated instead; then there are no splines.
    domain : ndarray, shape (2, 3)
        Where they are defined.
    degree : int
        Common degree of the tensors.
    crossing : bool
        Whether zero sets cross, as the sides of a wall do not: rules look for that.
    """

    splines: tuple[BSpline, ...]
    factors: FloatArray
    shifts: FloatArray
    fields: tuple[Any, ...]
    domain: FloatArray
    degree: int
    crossing: bool = False

    def __repr__(self) -> str:
        made = "splines" if self.exact else "fields, interpolated"
        return f"LevelSets({self.count} of {made}, degree={self.degree})"

    @property
    def count(self) -> int:
        """Number of level sets."""
        return len(self.fields) or len(self.factors)

    @property
    def exact(self) -> bool:
        """Whether the tensors are the sets themselves."""
        return not self.fields

    def __call__(self, u: FloatArray) -> FloatArray:
        """Values (n, sets) of the sets themselves."""
        if self.fields:
            values = [as_array("field", asked("field", f, u), finite=False) for f in self.fields]
            for v in values:
                if v.shape != (len(u),):
                    raise InputError(
                        f"field must give one value per point, shape ({len(u)},), got {v.shape}"
                    )
            return np.stack(values, axis=1)
        parts = np.stack([_numerator(s)(u) for s in self.splines], axis=1)
        return parts @ self.factors.T + self.shifts

    def also(self, f: Any, sign: float) -> "LevelSets":
        """The part of the solid where a further function is negative, after these.

        Parameters
        ----------
        f : BSpline, Node or callable
            The function: a spline, where these are splines.
        sign : {1, -1}
            Where f is positive with -1.

        Returns
        -------
        LevelSets
            With one more set, the last one.
        """
        if self.fields:
            g = f if sign > 0 else _negative(f)
            return replace(self, fields=(*self.fields, g), crossing=True)
        m = len(self.factors)
        factors = np.zeros((m + 1, len(self.splines) + 1))
        factors[:m, :-1], factors[m, -1] = self.factors, sign
        return replace(
            self,
            splines=(*self.splines, f),
            factors=factors,
            shifts=np.append(self.shifts, 0.0),
            degree=max(self.degree, *f.k),
            crossing=True,
        )

    @property
    def opaque(self) -> bool:
        """Whether something in a field has neither a formula nor bounds."""
        return not all(map(bounded, self.fields))

    def pieces(self, axes: Sequence[FloatArray]) -> "Pieces | FieldPieces":
        """The level sets on the cells of a grid, cut at the breaks of the splines.

        Parameters
        ----------
        axes : sequence of ndarray
            Planes of the grid in the three directions.

        Returns
        -------
        Pieces or FieldPieces
            Tensors and signs; of fields, boxes that are halved until these are right.
        """
        cuts = []
        for a in range(3):
            edges = np.asarray(axes[a], np.float64)
            for s in self.splines:
                edges = with_planes(edges, s.breaks(a))
            cuts.append(read_only(edges))
        x, y, z = (float(len(edges) - 1) for edges in cuts)
        need(
            PER_PIECE * x * y * z,
            f"a grid of {x:.3g} x {y:.3g} x {z:.3g} cells",
            "use fewer cells per direction",
        )
        if self.fields:
            return field_pieces(self.fields, self.domain, self.degree, tuple(cuts))
        return SplinePieces(self, tuple(cuts))


@dataclass(frozen=True, eq=False)
class Pieces(Frozen):
    """Level sets on the boxes of a tensor grid: their tensors there.

    Attributes
    ----------
    sets : LevelSets
        The level sets.
    axes : tuple of ndarray
        Planes between the pieces.
    """

    sets: LevelSets
    axes: tuple[FloatArray, ...]

    @property
    def project(self) -> bool:
        """Whether rules look for crossings of curves on bases."""
        return self.sets.crossing

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of pieces per direction."""
        a, b, c = (len(x) - 1 for x in self.axes)
        return a, b, c

    @property
    def order(self) -> int:
        """Coefficients per direction."""
        return self.sets.degree + 1

    @property
    def lengths(self) -> Any:
        """A tuple or array of length `order`, for the kernels.

        Those for a tuple have loops that are unrolled, which halves their time: walls are mostly
        quadratic or cubic. All other orders share those for an array.
        """
        return (0,) * self.order if self.order in UNROLLED else np.zeros(self.order, np.int64)

    def tensors(self, index: IntArray) -> FloatArray:
        """Bernstein coefficients.

        Parameters
        ----------
        index : ndarray, shape (n, 3)
            Pieces.

        Returns
        -------
        ndarray, shape (n, sets, (degree + 1)³)
            Coefficients.
        """
        raise NotImplementedError

    def bounds(self) -> FloatArray | None:
        """Rigorous bounds (n0, n1, n2, sets, 2) that cost little, or None."""
        raise NotImplementedError

    @property
    def error(self) -> float:
        """Error of the volume, as a part of it."""
        return 0.0

    #: See `FieldPieces`.
    local: ClassVar[float] = 0.0
    place: ClassVar[int] = 0

    def content(self, index: IntArray) -> Content:
        """Tensors of pieces (n, 3) for rules: the solid is where all are negative."""
        n, m = len(index), self.sets.count
        names = np.tile(np.arange(m), (n, 1))
        return Content(self.tensors(index), np.full(n, m), np.full(n, self.table), names)

    def single(self, signs: AnyArray, starts: list[IntArray], ijk: IntArray) -> AnyArray:
        """Cells in which the solid is certainly in one piece, as far as that is cheap to tell.

        Parameters
        ----------
        signs : ndarray, shape (n0, n1, n2)
            Those of `signs`.
        starts : list of ndarray
            Per direction, the first layer of pieces of each cell, and the number of layers.
        ijk : ndarray, shape (n, 3)
            Cells.

        Returns
        -------
        ndarray of bool, shape (n,)
            Whether it is.
        """
        del signs, starts
        return np.zeros(len(ijk), bool)

    @property
    def table(self) -> int:
        """The table of signs of which all are negative."""
        return int(np.bitwise_and.reduce(~np.array(LOW[: self.sets.count], np.int64)))

    def signs(self, halvings: int = 6) -> AnyArray:
        """-1 for pieces in the solid, 1 for those outside, 0 for all others.

        Parameters
        ----------
        halvings : int
            How often a piece that is not certain is halved.

        Returns
        -------
        ndarray, shape (n0, n1, n2), int8
            Signs; -1 and 1 are certain.
        """
        out = np.zeros(self.shape, np.int8)
        bounds = self.bounds()
        if bounds is not None:
            out[(bounds[..., 1] < 0).all(axis=-1)] = -1
            out[(bounds[..., 0] > 0).any(axis=-1)] = 1
        index = np.argwhere(out == 0)
        for i in range(0, len(index), BATCH):
            part = index[i : i + BATCH]
            sign = np.empty(len(part), np.int64)
            c = self.content(part)
            kernels.signs(len(part), c.tensors, c.many, c.tables, halvings, self.lengths, sign)
            out[tuple(part.T)] = sign
        return out


class SplinePieces(Pieces):
    """Pieces of splines: exact tensors by extraction."""

    @cached_property
    def _operators(self) -> list[list[tuple[FloatArray, IntArray]]]:
        return [
            [_restrictions(s, a, self.axes[a], self.order) for a in range(3)]
            for s in self.sets.splines
        ]

    @cached_property
    def _arrays(self) -> list[FloatArray]:
        return [_coefficients(s, self.order) for s in self.sets.splines]

    def tensors(self, index: IntArray) -> FloatArray:
        """See `Pieces.tensors`."""
        out = np.empty((len(index), self.sets.count, self.order**3))
        out[:] = self.sets.shifts[:, None]
        for c, ops, f in zip(self._arrays, self._operators, self.sets.factors.T, strict=True):
            rows, first = zip(*ops, strict=True)
            kernels.extract(
                len(index), c, *rows, *first, np.ascontiguousarray(index), f.copy(), self.lengths,
                out,
            )  # fmt: skip
        return out

    def signs(self, halvings: int = 6) -> AnyArray:
        """See `Pieces.signs`."""
        splines = self.sets.splines
        if not all(_alike(s, splines[0]) for s in splines):
            return super().signs(halvings)
        rows, first = zip(*self._operators[0], strict=True)
        out = np.empty(self.shape, np.int8)
        kernels.signs_of_splines(
            len(first[0]), np.stack(self._arrays), *rows, *first, self.sets.factors.copy(),
            self.sets.shifts.copy(), self.table, halvings, self.lengths, out,
        )  # fmt: skip
        return out

    def single(self, signs: AnyArray, starts: list[IntArray], ijk: IntArray) -> AnyArray:
        """See `Pieces.single`: for continuous splines that have their knots in common."""
        out = np.zeros(len(ijk), bool)
        rows, first = zip(*self._operators[0], strict=True)
        most = np.array([np.diff(s).max() for s in starts])
        joined = all((np.diff(f) < self.order).all() for f in first)
        alike = all(_alike(s, self.sets.splines[0]) for s in self.sets.splines)
        if joined and alike and np.prod(most * self.order) <= LONG:
            singles.single_cells(
                len(ijk), np.stack(self._arrays), singles.Cuts(*rows, *first, *starts),
                self.sets.factors.copy(), self.sets.shifts.copy(), signs,
                np.ascontiguousarray(ijk), most, out,
            )  # fmt: skip
        return out

    def bounds(self) -> FloatArray | None:
        """See `Pieces.bounds`: extremes of the coefficients of the splines."""
        out = np.empty((*self.shape, self.sets.count, 2))
        out[:] = self.sets.shifts[:, None]
        for s, c, ops, f in zip(self.sets.splines, self._arrays, self._operators,
                                self.sets.factors.T, strict=True):  # fmt: skip
            size = np.array(s.k) + 1
            first = [np.asarray(first) for _, first in ops]
            kernels.windows(len(first[0]), c, *first, size, f.copy(), out)
        slack = kernels.ROUNDING * np.abs(out).max(axis=-1, keepdims=True)
        return out + slack * np.array([-1.0, 1.0])


def as_level_sets(field: Any, domain: FloatArray | None, degree: int) -> LevelSets:
    """Level sets of a solid, a scalar spline, a smooth field, or a pair of fields.

    Parameters
    ----------
    field : Solid, BSpline, callable, or pair of fields
        The solid is where it is negative; of a pair, where both are.
    domain : ndarray, shape (2, 3), optional
        Box, for fields that have no bounds.
    degree : int
        Degree of the interpolation of what is no spline, 1 to 4.

    Returns
    -------
    LevelSets
        The sets.

    Raises
    ------
    InputError
        If it is something else, or there is no domain.
    """
    if isinstance(field, Solid):
        field = level_sets_of(field)
    sums = field.sums() if isinstance(field, Field) else None
    if sums is not None:
        return _of_splines(*sums, (field,), domain, degree)
    parts = tuple(field) if isinstance(field, tuple | list) else (field,)
    if not 1 <= len(parts) <= 2:
        raise InputError(f"field must be one field or a pair, got {len(parts)}")
    for f in parts:
        if isinstance(f, BSpline) and (f.ndim != 3 or f.m):
            raise InputError(f"field must be a scalar spline with 3 parameters, got {f!r}")
        if not callable(f):
            raise InputError(f"field must be a wall, a spline or a callable field, got {f!r:.80}")
    if all(isinstance(f, BSpline) for f in parts):
        return _of_splines(parts, np.eye(len(parts)), parts, domain, degree)
    return _of_fields(parts, domain, degree)


def _of_splines(
    splines: tuple[BSpline, ...], factors: FloatArray, fields: tuple[Any, ...],
    domain: FloatArray | None, degree: int,
) -> LevelSets:  # fmt: skip
    top = max(max(s.k) for s in splines)
    box = _intersection(splines, domain)
    if top > MAX_DEGREE:
        return _of_fields(fields, box, degree)
    splines, factors, shifts = _simplified(splines, factors)
    return LevelSets(splines, factors, shifts, (), box, max(top, 1))


def _of_fields(fields: tuple[Any, ...], domain: FloatArray | None, degree: int) -> LevelSets:
    box = _intersection(fields, domain)
    for f in fields:
        if np.asarray(asked("field", f, box.mean(axis=0, keepdims=True))).dtype == bool:
            raise InputError(
                "field gives booleans, and must give numbers that are negative in the solid"
            )
    return LevelSets((), np.zeros((0, 0)), np.zeros(0), fields, box, degree)


def _simplified(
    splines: tuple[BSpline, ...], factors: FloatArray
) -> tuple[tuple[BSpline, ...], FloatArray, FloatArray]:
    """Splines, factors and shifts of the same sets, with no more splines and sets than it takes.

    Constant splines become shifts, splines with knots in common one per set; last sets that are
    negative everywhere, as the inner one of a solid, do not matter.
    """
    shifts = np.zeros(len(factors))
    if any(s.weights is not None for s in splines):
        return splines, factors, shifts
    vary = np.array([np.ptp(s.c) > 0 for s in splines])
    if vary.any():
        constants = [s.c.flat[0] for s, v in zip(splines, vary, strict=True) if not v]
        shifts = factors[:, ~vary] @ np.array(constants)
        splines = tuple(s for s, v in zip(splines, vary, strict=True) if v)
        factors = factors[:, vary]
    tops = [_top(splines, f) + shift for f, shift in zip(factors, shifts, strict=True)]
    while len(factors) > 1 and tops[len(factors) - 1] < 0:
        factors, shifts = factors[:-1], shifts[:-1]
    s = splines[0]
    if len(splines) > 1 and all(_alike(s, other) for other in splines):
        sums = [sum(f * o.c for f, o in zip(row, splines, strict=True)) for row in factors]
        splines = tuple(BSpline(s.t, c, s.k, periodic=s.periodic) for c in sums)
        factors = np.eye(len(factors))
    return splines, np.ascontiguousarray(factors), shifts


def _top(splines: tuple[BSpline, ...], row: FloatArray) -> float:
    """An upper bound of a sum of splines."""
    return float(sum((f * s.c).max() for f, s in zip(row, splines, strict=True)))


def _alike(a: BSpline, b: BSpline) -> bool:
    """Whether splines have knots in common."""
    return a.k == b.k and a.periodic == b.periodic and all(map(np.array_equal, a.t, b.t))


def _negative(f: Any) -> Any:
    """A field of which the sign is the other one."""
    return complement(f) if isinstance(f, Node) else _Negative(f)


@dataclass(frozen=True)
class _Negative(Field):
    """Minus a function."""

    function: Any

    def __call__(self, u: ArrayLike, /) -> FloatArray:
        """Values (n,) at points (n, 3)."""
        return -np.asarray(self.function(as_points("u", u)), np.float64)


def _intersection(fields: tuple[Any, ...], domain: FloatArray | None) -> FloatArray:
    boxes = [
        np.asarray(f.analysis_box if owns(f, "analysis_box") else f.bounds, np.float64)
        for f in fields
        if owns(f, "bounds")
    ]
    if domain is not None:
        box = domain
        for f in fields:
            if not owns(f, "breaks") and (owns(f, "bounding_box") or not owns(f, "bounds")):
                continue  # formulas and distances hold beyond the box of their solid
            b = np.asarray(f.bounds, np.float64)
            slack = 1e-12 * (b[1] - b[0])
            if (box[0] < b[0] - slack).any() or (box[1] > b[1] + slack).any():
                raise InputError(
                    f"domain {box.tolist()} leaves the bounds {b.tolist()} of the field"
                )
    elif not boxes:
        raise InputError("domain is needed: the field has no bounds")
    else:
        box = np.array([np.max([b[0] for b in boxes], 0), np.min([b[1] for b in boxes], 0)])
        if not np.isfinite(box).all():
            raise InputError(f"domain is needed: the field goes on for ever, {box.tolist()}")
    if not (box[0] < box[1]).all():
        raise InputError(f"domain must have its lower corner below its upper one: {box.tolist()}")
    return read_only(np.array(box))


def _numerator(s: BSpline) -> BSpline:
    """A spline of the same sign without weights."""
    if s.weights is None:
        return s
    return BSpline(s.t, s.c * s.weights, s.k, periodic=s.periodic)


def _coefficients(s: BSpline, order: int) -> FloatArray:
    """Coefficients, with room for a window of `order` per direction."""
    c = s.c if s.weights is None else s.c * s.weights
    room = [(0, order - 1 - k) for k in s.k]
    return read_only(np.pad(c, room) if np.any(room) else np.ascontiguousarray(c))


def _restrictions(s: BSpline, a: int, edges: FloatArray, order: int) -> tuple[FloatArray, IntArray]:
    """Rows (pieces, order, order) and first coefficients (pieces,): Bernstein form on pieces."""
    t, k = np.asarray(s.t[a]), s.k[a]
    p = order - 1
    raised = np.array(
        [[comb(k, j) * comb(p - k, i - j) / comb(p, i) if i >= j else 0.0 for j in range(k + 1)]
         for i in range(p + 1)]
    )  # fmt: skip
    spans = find_spans(t, k, 0.5 * (edges[1:] + edges[:-1]))
    out = np.zeros((len(spans), order, order))
    rows = np.zeros((k + 1, k + 1))
    for i, span in enumerate(spans):
        restriction(t, k, int(span), edges[i], edges[i + 1], rows)
        out[i, :, : k + 1] = raised @ rows
    return out, (spans - k).astype(np.int64)
