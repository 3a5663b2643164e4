"""Building programs: fields write their instructions here, equal ones are written once.

Guarantee: constants are folded with the same arithmetic as at run time.
"""

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import Frozen, read_only
from ilattice.errors import InputError
from ilattice.fields import _kernels_program as kernels
from ilattice.fields import _tables as ops
from ilattice.fields._kernels_blocks import block_bounds, fill_program
from ilattice.fields._kernels_decisions import decide
from ilattice.fields._kernels_ops import value

#: Operations of a field at most.
MAX_INSTRUCTIONS = 200_000
PRUNE_FROM = 24  # instructions from which on shorter programs are looked for
SORT_FROM = 256  # instructions from which on points are put in an order in which near ones follow
_ROOT = 1e-100  # least root in slopes of roots: second derivatives of their inverses are finite
CURVE = 2**21 - 1  # places along each axis of the curve that orders them
Point: TypeAlias = tuple[int, int, int]


class Builder:
    """A program in the making: registers are numbers, `op` and its shorthands add one."""

    def __init__(self) -> None:
        self.code: list[int] = [ops.X, ops.Y, ops.Z]
        self.a, self.b, self.imm = [0, 0, 0], [0, 0, 0], [0.0, 0.0, 0.0]
        self.leaves: list[tuple[Any, Point]] = []
        self._known: dict[tuple[int, int, int, float], int] = {}
        self._derived: dict[tuple[int, Point], Point] = {}
        #: Registers that are below any level up to zero just where others are, which are simpler.
        self.insides: dict[int, int] = {}

    def _append(self, code: int, a: int, b: int, imm: float) -> int:
        key = (code, a, b, imm)
        if key not in self._known:
            if len(self.code) >= MAX_INSTRUCTIONS:
                raise InputError(f"the field has more than {MAX_INSTRUCTIONS} operations")
            self._known[key] = len(self.code)
            self.code.append(code)
            self.a.append(a)
            self.b.append(b)
            self.imm.append(imm)
        return self._known[key]

    def const(self, number: float) -> int:
        """Register of a number."""
        return self._append(ops.CONST, 0, 0, float(number) + 0.0)

    def leaf(self, leaf: Any, point: Point) -> int:
        """Register of a field that is evaluated elsewhere, at the point of three registers."""
        for k, (other, at) in enumerate(self.leaves):
            if other is leaf and at == point:
                return self._append(ops.LEAF, k, 0, 0.0)
        self.leaves.append((leaf, point))
        return self._append(ops.LEAF, len(self.leaves) - 1, 0, 0.0)

    def op(self, code: int, a: int, b: int | None = None) -> int:
        """Register of an instruction."""
        second = a if b is None else b
        if self._is_const(a) and self._is_const(second):
            with np.errstate(all="ignore"):
                return self.const(value(code, self.imm[a], self.imm[second]))
        plain = self._without(code, a, second)
        if plain is not None:
            return plain
        if code in ops.COMMUTES and a > second:
            a, second = second, a
        return self._append(code, a, second, 0.0)

    def _is_const(self, i: int) -> bool:
        return self.code[i] == ops.CONST

    def is_number(self, i: int, number: float) -> bool:
        """Whether a register holds this number at all points."""
        return self._is_const(i) and self.imm[i] == number

    def _without(self, code: int, a: int, b: int) -> int | None:
        """The register that holds the result already: x + 0, 1 x, min(x, x) and so on."""
        left = self.imm[a] if self._is_const(a) else None
        right = self.imm[b] if self._is_const(b) else None
        if (code == ops.ADD and right == 0) or (code == ops.SUB and right == 0):
            return a
        if (code == ops.ADD and left == 0) or (code == ops.MUL and left == 1):
            return b
        if code in (ops.MUL, ops.DIV) and right == 1:
            return a
        if code == ops.MUL and 0.0 in (left, right):
            return self.const(0.0)
        return a if code in (ops.MIN, ops.MAX) and a == b else None

    # shorthands

    def add(self, *terms: int) -> int:
        """Sum."""
        total = terms[0]
        for term in terms[1:]:
            total = self.op(ops.ADD, total, term)
        return total

    def sub(self, a: int, b: int) -> int:
        """Difference."""
        return self.op(ops.SUB, a, b)

    def mul(self, a: int, b: int) -> int:
        """Product."""
        return self.op(ops.MUL, a, b)

    def scaled(self, factor: float, a: int) -> int:
        """Product with a number."""
        return self.op(ops.MUL, self.const(factor), a)

    def norm(self, *parts: int) -> int:
        """Euclidean length."""
        return self.op(ops.SQRT, self.add(*(self.op(ops.SQUARE, p) for p in parts)))

    def extreme(self, code: int, parts: Sequence[int]) -> int:
        """Minimum or maximum of several, as a balanced tree: that of `ops.MIN` or `ops.MAX`."""
        row = list(parts)
        while len(row) > 1:
            pairs = [self.op(code, *row[i : i + 2]) for i in range(0, len(row) - 1, 2)]
            row = pairs + row[len(row) - len(row) % 2 :]
        return row[0]

    def inside(self, a: int, simpler: int) -> int:
        """Register a, which is below any level up to zero just where a simpler one is."""
        if a != simpler:
            self.insides[a] = simpler
        return a

    def linear(self, matrix: FloatArray, p: Point, shift: FloatArray | None = None) -> Point:
        """The point ``matrix @ p + shift``."""
        rows = []
        for i in range(3):
            r = self.add(*(self.scaled(float(matrix[i, k]), p[k]) for k in range(3)))
            rows.append(r if shift is None else self.add(r, self.const(float(shift[i]))))
        return rows[0], rows[1], rows[2]

    # derivatives, as further instructions

    def gradient(self, root: int, p: Point) -> Point:
        """Registers of the derivatives of `root` by the registers of the point `p`."""
        zero, one = self.const(0.0), self.const(1.0)
        known: dict[int, Point] = {}
        for axis in range(3):
            e = [zero, zero, zero]
            e[axis] = one
            known[p[axis]] = (e[0], e[1], e[2])
        for i in sorted(self.ancestors(root, set(p))):
            if i in known:
                continue
            code, a, b = self.code[i], self.a[i], self.b[i]
            if code == ops.LEAF:
                raise InputError("a field without a formula cannot be normalised")
            if code < ops.INPUTS:
                known[i] = (zero, zero, zero)
                continue
            da, db = self._slopes(i)
            x, y, z = (
                self.add(self.mul(da, known[a][k]), self.mul(db, known[b][k])) for k in range(3)
            )
            known[i] = (x, y, z)
        return known[root]

    def ancestors(self, root: int, stop: Collection[int] = ()) -> set[int]:
        """All registers that one is computed from, itself included."""
        seen, todo = set(), [root]
        while todo:
            i = todo.pop()
            if i in seen:
                continue
            seen.add(i)
            if self.code[i] >= ops.INPUTS and i not in stop:
                todo += [self.a[i], self.b[i]]
        return seen

    def _slopes(self, i: int) -> tuple[int, int]:
        """Registers of the derivatives of an instruction by what it reads."""
        code, a, b = self.code[i], self.a[i], self.b[i]
        zero, one = self.const(0.0), self.const(1.0)
        two = {
            ops.ADD: lambda: (one, one),
            ops.SUB: lambda: (one, self.const(-1.0)),
            ops.MUL: lambda: (b, a),
            ops.DIV: lambda: (self.op(ops.DIV, one, b), self.op(ops.NEG, self.op(ops.DIV, i, b))),
            ops.MIN: lambda: self._chosen(self.sub(b, a)),
            ops.MAX: lambda: self._chosen(self.sub(a, b)),
            ops.POW: lambda: self._power_slopes(i, a, b),
            ops.ATAN2: lambda: self._angle_slopes(a, b),
            ops.MOD: lambda: (one, self.op(ops.NEG, self.op(ops.FLOOR, self.op(ops.DIV, a, b)))),
            ops.WRAP: lambda: (one, zero),
        }
        return two[code]() if code in two else (self._slope(i, code, a), zero)

    def _chosen(self, lead: int) -> tuple[int, int]:
        """Weights of two sides, the first of which wins where `lead` is positive."""
        half = self.scaled(0.5, self.op(ops.SIGN, lead))
        return self.add(self.const(0.5), half), self.sub(self.const(0.5), half)

    def _power_slopes(self, i: int, a: int, b: int) -> tuple[int, int]:
        by_base = self.mul(b, self.op(ops.POW, a, self.sub(b, self.const(1.0))))
        if self._is_const(b):
            return by_base, self.const(0.0)
        return by_base, self.mul(i, self.op(ops.LOG, a))

    def _angle_slopes(self, a: int, b: int) -> tuple[int, int]:
        q = self.add(self.op(ops.SQUARE, a), self.op(ops.SQUARE, b))
        return self.op(ops.DIV, b, q), self.op(ops.NEG, self.op(ops.DIV, a, q))

    def _slope(self, i: int, code: int, a: int) -> int:
        one = self.const(1.0)

        def square(r: int) -> int:
            return self.op(ops.SQUARE, r)

        def over(r: int) -> int:
            return self.op(ops.DIV, one, r)

        rules: dict[int, Callable[[], int]] = {
            ops.NEG: lambda: self.const(-1.0),
            ops.ABS: lambda: self.op(ops.SIGN, a),
            ops.SQRT: lambda: over(self.op(ops.MAX, self.scaled(2.0, i), self.const(_ROOT))),
            ops.SQUARE: lambda: self.scaled(2.0, a),
            ops.SIN: lambda: self.op(ops.COS, a),
            ops.COS: lambda: self.op(ops.NEG, self.op(ops.SIN, a)),
            ops.TAN: lambda: self.add(one, square(i)),
            ops.ASIN: lambda: over(self.op(ops.SQRT, self.sub(one, square(a)))),
            ops.ACOS: lambda: self.op(ops.NEG, over(self.op(ops.SQRT, self.sub(one, square(a))))),
            ops.ATAN: lambda: over(self.add(one, square(a))),
            ops.SINH: lambda: self.op(ops.COSH, a),
            ops.COSH: lambda: self.op(ops.SINH, a),
            ops.TANH: lambda: self.sub(one, square(i)),
            ops.EXP: lambda: i,
            ops.LOG: lambda: over(a),
        }
        return rules[code]() if code in rules else self.const(0.0)

    def kept(self, root: int) -> list[int]:
        """Registers of the program of `root`, in order; one more that repeats a coordinate."""
        return [0, 1, 2, len(self.code)] if root < 3 else sorted(self.ancestors(root) | {0, 1, 2})

    def program(self, root: int) -> "Program":
        """What `root` needs, as a program."""
        code, a, b, imm = self.code, self.a, self.b, self.imm
        if root < 3:
            code, a, b, imm = [*code, root], [*a, 0], [*b, 0], [*imm, 0.0]
        keep = self.kept(root)
        new = {old: k for k, old in enumerate(keep)}
        reads = [code[i] >= ops.INPUTS for i in keep]
        used = sorted({a[i] for i in keep if code[i] == ops.LEAF})
        place = {k: j for j, k in enumerate(used)}
        arrays: tuple[AnyArray, ...] = (
            np.array([code[i] for i in keep], np.int64),
            np.array(
                [new[a[i]] if r else place.get(a[i], 0) for i, r in zip(keep, reads, strict=True)]
            ),
            np.array([new[b[i]] if r else 0 for i, r in zip(keep, reads, strict=True)]),
            np.array([imm[i] for i in keep]),
        )
        leaves = tuple(
            (self.leaves[k][0], tuple(self.program(r) for r in self.leaves[k][1])) for k in used
        )
        c, first, second, numbers = (read_only(np.ascontiguousarray(v)) for v in arrays)
        return Program(c, first, second, numbers, leaves)


@dataclass(frozen=True, eq=False)
class Program(Frozen):
    """Instructions that compute one number from a point; see `_kernels_program`."""

    code: IntArray
    a: IntArray
    b: IntArray
    imm: FloatArray
    leaves: tuple[tuple[Any, tuple[Any, ...]], ...] = field(default=())

    @property
    def kinked(self) -> bool:
        """Whether the gradient may jump."""
        return bool(self.leaves) or any(int(c) in ops.KINKED for c in self.code)

    @property
    def bounded(self) -> bool:
        """Whether bounds are finite on finite boxes: all has a formula, or bounds of its own."""
        return all(leaf.bounded for leaf, _ in self.leaves)

    @cached_property
    def prune(self) -> bool:
        """Whether shorter programs for parts of space may pay."""
        choices = np.isin(self.code, (ops.MIN, ops.MAX)).sum()
        return bool(choices >= 2 and len(self.code) >= PRUNE_FROM)

    @property
    def _args(self) -> tuple[AnyArray, ...]:
        return tuple(np.array(v) for v in (self.code, self.a, self.b, self.imm))

    def values(self, points: FloatArray) -> FloatArray:
        """Values (n,) at checked points (n, 3)."""
        return self._in_order(points, 0)[:, 0]

    def jets(self, points: FloatArray, order: int) -> FloatArray:
        """Jets (n, 4) or (n, 10) at checked points."""
        return self._in_order(points, order)

    def _in_order(self, points: FloatArray, order: int) -> FloatArray:
        """Jets (n, 1 or 4 or 10); of long programs near points are taken together."""
        if not self.prune or len(self.code) < SORT_FROM or len(points) <= kernels.WIDE:
            nodes = kernels.follow(len(points), self.prune)
            return self._jets(points, order, nodes)
        places = along_curve(points)
        along = np.argsort(places, kind="stable")
        out = np.empty((len(points), _COUNTS[order]))
        out[along] = self._jets(points[along], order, kernels.divide(places[along]))
        return out

    def _jets(self, points: FloatArray, order: int, nodes: IntArray) -> FloatArray:
        out = np.empty((len(points), _COUNTS[order]))
        leaves = self._leaf_jets(points, order)
        tasks = np.append(np.flatnonzero(nodes[:, 2] <= 1), len(nodes))
        kernel = (kernels.values, kernels.gradients, kernels.jets)[order]
        kernel(len(tasks) - 1, *self._args, _own(points), leaves, nodes, tasks, out)
        return out

    def fill(
        self, planes: Sequence[FloatArray], coords: IntArray, middle: float, samples: AnyArray
    ) -> None:
        """Values less `middle` on blocks of 9 x 9 x 9 grid points; see `_kernels_blocks`."""
        x, y, z = (_own(p) for p in planes)
        along = np.argsort(along_curve(coords[:, [3, 1, 2]].astype(np.float64)), kind="stable")
        fill_program(len(coords), *self._args, x, y, z, _own(coords), along, middle, samples)

    def block_bounds(
        self, ends: Sequence[FloatArray], lower: float, upper: float
    ) -> tuple[FloatArray, FloatArray]:
        """Bounds on blocks with ends (n, 2) along the axes, as far as the levels need them."""
        low = np.empty([len(e) for e in ends])
        high = np.empty_like(low)
        x, y, z = (_own(e) for e in ends)
        boxes = math.prod(-(-len(e) // 8) for e in ends)
        block_bounds(boxes, *self._args, x, y, z, lower, upper, low, high)
        return low, high

    def ranges(self, lo: FloatArray, hi: FloatArray) -> FloatArray:
        """Bounds (n, 2) on checked boxes."""
        out = np.empty((len(lo), 2))
        leaves = self._leaf_ranges(lo, hi)
        kernels.ranges(len(lo), *self._args, _own(lo), _own(hi), leaves, self.prune, out)
        return out

    def decided(
        self, lo: FloatArray, hi: FloatArray, choices: IntArray, states: IntArray
    ) -> FloatArray:
        """Bounds (n, 2) on checked boxes, and states (n, k) of choices; see `decide`."""
        out = np.empty((len(lo), 2))
        leaves = self._leaf_ranges(lo, hi)
        decide(len(lo), *self._args, _own(lo), _own(hi), leaves, choices, out, states)
        return out

    def _leaf_ranges(self, lo: FloatArray, hi: FloatArray) -> FloatArray:
        leaves = np.zeros((len(lo), max(1, len(self.leaves)), 3))
        for k, (leaf, point) in enumerate(self.leaves):
            at = np.stack([p.ranges(lo, hi) for p in point])
            moved = not all(is_axis(p, axis) for axis, p in enumerate(point))
            leaves[:, k] = leaf.bounds_on(at[:, :, 0].T, at[:, :, 1].T, moved)
        return leaves

    def _leaf_jets(self, points: FloatArray, order: int) -> FloatArray:
        """Values, or jets, of what is evaluated elsewhere, (leaves, n, 1 or 4 or 10)."""
        shape = max(1, len(self.leaves)), len(points) if self.leaves else 1, _COUNTS[order]
        out = np.zeros(shape)
        for k, (leaf, point) in enumerate(self.leaves):
            if order == 0:
                at = np.stack([p.values(points) for p in point], axis=1)
                out[k, :, 0] = leaf.values(at)
            else:
                inner = [p.jets(points, order) for p in point]
                at = np.stack([p[:, 0] for p in inner], axis=1)
                out[k] = _chained(leaf.jets(at, order), inner)
        return out


def along_curve(points: FloatArray) -> IntArray:
    """Places (n,) of points along a curve that fills space: near ones are mostly near there."""
    places = np.empty(len(points), np.int64)
    if len(points):
        low = points.min(axis=0)
        size = float((points.max(axis=0) - low).max())
        scale = CURVE / size if size > 1e-300 else 0.0
        kernels.places(len(points), _own(points), low, scale, places)
    return places


_COUNTS = (1, 4, 10)  # numbers of a value, and of jets of the orders 1 and 2


def _own(a: AnyArray) -> AnyArray:
    """A contiguous writable array: kernels are compiled for one type only."""
    a = np.ascontiguousarray(a)
    return a if a.flags.writeable else a.copy()


def is_axis(p: Program, axis: int) -> bool:
    """Whether a program is a coordinate."""
    return len(p.code) == 4 and int(p.code[3]) == axis


_PAIRS = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]


def _chained(outer: tuple[FloatArray, ...], inner: list[FloatArray]) -> FloatArray:
    """Jet of a composition: outer (f, g[, H]) at the points of three inner jets."""
    f, g = outer[:2]
    out = np.empty((len(f), inner[0].shape[1]))
    J = np.stack([p[:, 1:4] for p in inner], axis=1)  # J[:, c, k]
    out[:, 0] = f
    out[:, 1:4] = np.einsum("nc,nck->nk", g, J)
    if len(outer) == 3:
        H = np.einsum("nca,ncd,ndb->nab", J, outer[2], J)
        for k, (r, c) in enumerate(_PAIRS):
            out[:, 4 + k] = H[:, r, c] + sum(g[:, i] * p[:, 4 + k] for i, p in enumerate(inner))
    return out
