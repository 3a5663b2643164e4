"""Solids as Boolean functions of the signs of smooth fields.

A program with `abs`, `min`, `max`, `sign` and steps is smooth between its kinks. Which side wins on
a box is decided by bounds; what is left open there is split exactly:

- {min(f, g) < c} is {f < c} or {g < c}, {max(f, g) < c} both, and {|f| < c} is {f < c} and not
  {f <= -c}. Monotone functions of one number move to the other side: {sqrt(f) < c} is {f < c²}.
- What rises with a minimum or maximum below other operations is a minimum or maximum itself:
  min(f, g) + h = min(f + h, g + h).
- Fields without a formula that are unions of many pieces are asked for those of a box.
- Anything else is taken apart by a switch: where f < g with f in place of min(f, g), else with g.

Guarantees: a formula has the sign of the field in its box, but for sets without volume.
Non-guarantees: square roots count as smooth where they vanish, and so do powers, angles and fields
without a formula; blends stay what they are between their seams.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import read_only
from ilattice.fields import _tables as ops
from ilattice.fields._kernels_decisions import FIRST, OPEN, ORIGIN, SECOND, STEP
from ilattice.fields._logic import Expression, Formula, both, choice, either, leaves_of, negation
from ilattice.fields._pieces import Stackable, Union
from ilattice.fields._program import Builder, Program, is_axis
from ilattice.fields.node import Node

#: Smooth fields of one formula, and splits that lead to them, above which a box is to be halved.
MAX_LEAVES = 48
MAX_SPLITS = 400
#: Places at which smooth fields that vanish everywhere are told from others: those of any other
#: field are hardly zero at all of them. Eight were chosen without measurements.
PROBES = np.random.default_rng(0).uniform(-1.0, 1.0, (8, 3))


class _TooManyError(Exception):
    """A formula grew beyond its limits."""


@dataclass(frozen=True, eq=False)
class Leaf:
    """A smooth field: a program less a number.

    Attributes
    ----------
    program : Program
        The program.
    level : float
        The number.
    """

    program: Program
    level: float

    def values(self, points: FloatArray) -> FloatArray:
        """Values (n,) at points (n, 3)."""
        return self.program.values(points) - self.level

    def ranges(self, lo: FloatArray, hi: FloatArray) -> FloatArray:
        """Bounds (n, 2) on boxes with corners (n, 3)."""
        return self.program.ranges(lo, hi) - self.level

    @property
    def halved(self) -> bool:
        """Whether boxes may be halved often: formulas, and what bounds itself for that."""
        return all(leaf.halved for leaf, _ in self.program.leaves)

    @cached_property
    def piece(self) -> Stackable | None:
        """The piece of a union that it is, if its kind takes many together; else None."""
        p = self.program
        if len(p.code) != 4 or int(p.code[3]) != ops.LEAF:
            return None
        piece, point = p.leaves[0]
        bare = all(is_axis(q, axis) for axis, q in enumerate(point))
        return piece if bare and isinstance(piece, Stackable) else None


class Splitter:
    """The formulas of a solid where all of some fields are negative."""

    def __init__(self, fields: Sequence[Node]) -> None:
        self.builder = Builder()
        self.roots = [f._emit(self.builder, (0, 1, 2)) for f in fields]
        self.root = self.builder.extreme(ops.MAX, self.roots)
        self.program = self.builder.program(self.root)
        self.leaves: list[Leaf] = []
        self._vanish: dict[int, bool] = {}
        self.owners: list[int] = []  # of the smooth fields: the first field that has them
        self._keys: dict[tuple[int, float], int] = {}
        self._formulas: dict[bytes, Formula | None] = {}
        registers = self.builder.kept(self.root)
        self._choices = [
            (i, r) for i, r in enumerate(registers) if int(self.program.code[i]) in CHOICES
        ]
        leaves = [(r, *self.builder.leaves[self.builder.a[r]]) for r in registers
                  if self.builder.code[r] == ops.LEAF]  # fmt: skip
        self._unions = [
            (r, leaf, tuple(self.builder.program(x) for x in point))
            for r, leaf, point in leaves if isinstance(leaf, Union)
        ]  # fmt: skip
        self._parts: dict[tuple[int, ...], int] = {}
        self.parts: list[tuple[int, ...]] = []
        self.pieces: dict[tuple[int, int, float, bool], Expression] = {}  # of single ones

    def values(self, leaf: IntArray, points: FloatArray) -> FloatArray:
        """Values (n, q) of smooth fields (n,), each at points (n, q, 3) of its own."""
        out = np.empty(points.shape[:2])
        for rows, one, stack, which in self._kinds(leaf):
            x = points[rows]
            if stack is None:
                out[rows] = one.values(x.reshape(-1, 3)).reshape(x.shape[:2])
            else:
                out[rows] = (
                    stack.values(which, x)
                    - np.array([self.leaves[k].level for k in leaf[rows].tolist()])[:, None]
                )
        return out

    def ranges(self, leaf: IntArray, lo: FloatArray, hi: FloatArray) -> FloatArray:
        """Bounds (n, 2) of smooth fields (n,), each on a box of its own."""
        out = np.empty((len(leaf), 2))
        for rows, one, stack, which in self._kinds(leaf):
            if stack is None:
                out[rows] = one.ranges(lo[rows], hi[rows])
            else:
                level = np.array([self.leaves[k].level for k in leaf[rows].tolist()])
                out[rows] = stack.bounds(which, lo[rows], hi[rows]) - level[:, None]
        return out

    def _kinds(self, leaf: IntArray) -> Iterator[tuple[IntArray, Leaf, Any, IntArray]]:
        """Rows of smooth fields (n,) that are one, or pieces of one kind, stacked."""
        found, place = np.unique(leaf, return_inverse=True)
        order = np.argsort(place, kind="stable")
        ends = np.searchsorted(place[order], np.arange(len(found) + 1))
        stacks: dict[Any, list[int]] = {}
        for j, k in enumerate(found.tolist()):
            piece = self.leaves[k].piece
            if piece is None:
                yield order[ends[j] : ends[j + 1]], self.leaves[k], None, place[:0]
            else:
                stacks.setdefault(type(piece), []).append(j)
        for kind, members in stacks.items():
            pieces = [self.leaves[int(found[j])].piece for j in members]
            rows = np.concatenate([order[ends[j] : ends[j + 1]] for j in members])
            which = np.searchsorted(members, place[rows])
            yield rows, self.leaves[int(found[members[0]])], kind.stacked(pieces), which

    @cached_property
    def whole(self) -> Formula:
        """The formula that takes the field as it is, with all its kinks."""
        return Formula(("leaf", self.leaf(self.root, 0.0)), (self.leaf(self.root, 0.0),))

    def leaf(self, register: int, level: float, owner: int = 0) -> int:
        """Number of a smooth field."""
        key = (register, level)
        if key not in self._keys:
            self._keys[key] = len(self.leaves)
            self.leaves.append(Leaf(self.builder.program(register), level))
            self.owners.append(owner)
        return self._keys[key]

    def vanishes(self, number: int) -> bool:
        """Whether a smooth field is zero everywhere: |x| + x for negative x, split."""
        if number not in self._vanish:
            leaf = self.leaves[number]
            known = not leaf.program.leaves
            self._vanish[number] = known and bool((leaf.values(PROBES) == 0.0).all())
        return self._vanish[number]

    def decided(self, lo: FloatArray, hi: FloatArray) -> tuple[FloatArray, IntArray]:
        """Bounds (n, 2) of the field on boxes (n, 3), and the states (n, k) of its choices."""
        choices = np.array([i for i, _ in self._choices], np.int64)
        states = np.empty((len(lo), len(choices)), np.int64)
        bounds = self.program.decided(lo, hi, choices, states)
        open_ = np.flatnonzero(~((bounds[:, 0] > 0.0) | (bounds[:, 1] < 0.0)))
        more = np.full((len(lo), len(self._unions)), -1, np.int64)
        for k, (_, leaf, point) in enumerate(self._unions):
            more[open_, k] = self._asked(leaf, point, lo[open_], hi[open_])
        return bounds, np.column_stack([states, more])

    def _asked(
        self, leaf: Any, point: tuple[Program, ...], lo: FloatArray, hi: FloatArray
    ) -> IntArray:
        """Which pieces of a union matter in boxes: numbers in `parts`; -1 where there are many."""
        at = np.stack([p.ranges(lo, hi) for p in point])
        out = np.empty(len(lo), np.int64)
        for i, found in enumerate(leaf.parts_on(at[:, :, 0].T, at[:, :, 1].T)):
            if found is not None and found not in self._parts:
                self._parts[found] = len(self.parts)
                self.parts.append(found)
            out[i] = -1 if found is None else self._parts[found]
        return out

    def formula(self, states: IntArray) -> Formula | None:
        """The formula of boxes with these states, or None if these are to be halved."""
        key = states.tobytes()
        if key not in self._formulas:
            names = [r for _, r in self._choices] + [r for r, _, _ in self._unions]
            known = {r: int(s) for r, s in zip(names, states, strict=True)}
            try:
                e = _Case(self, known).whole()
                self._formulas[key] = Formula(e, leaves_of(e))
            except _TooManyError:
                self._formulas[key] = None
        return self._formulas[key]


CHOICES = frozenset({ops.ABS, ops.MIN, ops.MAX, ops.SIGN, ops.FLOOR, ops.CEIL, ops.MOD, ops.WRAP})
NEVER_NEGATIVE = frozenset({ops.SQRT, ops.SQUARE, ops.ABS, ops.EXP, ops.COSH})
RISING = frozenset({ops.SINH, ops.TANH, ops.EXP, ops.ATAN})


class _Case:
    """Splitting a program for boxes on which some of its choices are made."""

    def __init__(self, splitter: Splitter, states: dict[int, int]) -> None:
        self.splitter, self.states = splitter, states
        self.b = splitter.builder
        self.memo: dict[tuple[int, float, bool], Expression] = {}
        self.found: set[int] = set()
        self.splits = 0
        self.owner = 0

    def whole(self) -> Expression:
        """Where all fields are negative."""
        out: Expression = True
        last = len(self.splitter.roots) - 1
        state = self.states.get(self.splitter.root, OPEN) if last else OPEN
        for k, root in enumerate(self.splitter.roots):  # the largest of all but the last, and it
            self.owner = k
            if not ((state == FIRST and k == last) or (state == SECOND and k < last)):
                out = both(out, self.solid(root, 0.0, False))
        return out

    def solid(self, i: int, level: float, closed: bool) -> Expression:
        """Where a register is below a level, or at most as large if `closed`."""
        key = (i, level, closed)
        if key not in self.memo:
            self.memo[key] = self._solid(i, level, closed)
        return self.memo[key]

    def _solid(self, i: int, level: float, closed: bool) -> Expression:
        b = self.b
        code, first, second = b.code[i], b.a[i], b.b[i]
        if i in b.insides and level <= 0.0:
            return self.solid(b.insides[i], level, closed)
        if code == ops.CONST:
            return bool(b.imm[i] <= level if closed else b.imm[i] < level)
        if code == ops.LEAF and i in self.states:
            return self._union(i, level, closed)
        if code in (ops.MIN, ops.MAX):
            return self._extreme(i, level, closed)
        if code == ops.NEG:
            return self._above(first, -level, closed)
        if code in (ops.ADD, ops.SUB, ops.MUL, ops.DIV):
            moved = self._moved(code, first, second, level, closed)
            if moved is not None:
                return moved
        if code in (ops.ABS, ops.SQUARE, ops.SQRT, ops.EXP):
            return self._of_one(i, level, closed)
        return self._split(i, level, closed)

    def _above(self, i: int, level: float, closed: bool) -> Expression:
        """Where a register is above a level, or at least as large if `closed`."""
        return negation(self.solid(i, level, not closed))

    def _extreme(self, i: int, level: float, closed: bool) -> Expression:
        state = self.states.get(i, OPEN)
        first, second = self.b.a[i], self.b.b[i]
        if state in (FIRST, SECOND):
            return self.solid(first if state == FIRST else second, level, closed)
        e, f = self.solid(first, level, closed), self.solid(second, level, closed)
        return either(e, f) if self.b.code[i] == ops.MIN else both(e, f)

    def _union(self, i: int, level: float, closed: bool) -> Expression:
        """Where one of the pieces of a union is below a level, of those that matter here."""
        if self.states[i] < 0:
            raise _TooManyError
        leaf, point = self.b.leaves[self.b.a[i]]
        out: Expression = False
        for part in self.splitter.parts[self.states[i]]:
            key = (i, part, level, closed)
            if key not in self.splitter.pieces:
                piece = self.solid(leaf.part(part)._emit(self.b, point), level, closed)
                self.splitter.pieces[key] = piece
            out = either(out, self.splitter.pieces[key])
            self.found.update(leaves_of(self.splitter.pieces[key]))
            if len(self.found) > MAX_LEAVES:
                raise _TooManyError
        return out

    def _moved(self, code: int, p: int, q: int, level: float, closed: bool) -> Expression | None:
        """Sums and products with a number, which goes to the other side; else None."""
        b = self.b
        if b.code[q] == ops.CONST:
            number = b.imm[q]
            if code in (ops.ADD, ops.SUB):
                return self.solid(p, level - number if code == ops.ADD else level + number, closed)
            scale = 1.0 / number if code == ops.MUL else number
            return (self.solid if scale > 0.0 else self._above)(p, level * scale, closed)
        if b.code[p] == ops.CONST:
            number = b.imm[p]
            if code == ops.ADD:
                return self.solid(q, level - number, closed)
            if code == ops.SUB:
                return self._above(q, number - level, closed)
            if code == ops.MUL:
                scale = 1.0 / number
                return (self.solid if scale > 0.0 else self._above)(q, level * scale, closed)
        if code == ops.DIV and level == 0.0 and self._never_negative(q):
            return self.solid(p, 0.0, closed)
        if code == ops.SUB and p > q:  # one field for f - g and g - f
            return self._above(b.sub(q, p), -level, closed)
        return None

    def _never_negative(self, i: int) -> bool:
        b = self.b
        if b.code[i] == ops.MAX:
            return self._never_negative(b.a[i]) or self._never_negative(b.b[i])
        if b.code[i] in (ops.ADD, ops.MUL):
            return self._never_negative(b.a[i]) and self._never_negative(b.b[i])
        return b.code[i] in NEVER_NEGATIVE or (b.code[i] == ops.CONST and b.imm[i] >= 0.0)

    def _of_one(self, i: int, level: float, closed: bool) -> Expression:
        """Where |f|, f², sqrt(f) or exp(f) are below a level."""
        code, p = self.b.code[i], self.b.a[i]
        state = self.states.get(i, OPEN)
        if code == ops.ABS and state in (FIRST, SECOND):
            return (
                self.solid(p, level, closed) if state == FIRST else self._above(p, -level, closed)
            )
        if level < 0.0 or (level == 0.0 and code == ops.EXP):
            return False
        if code == ops.EXP:
            return self.solid(p, float(np.log(level)), closed)
        if code == ops.SQRT:
            return self.solid(p, level * level, closed)
        reach = level if code == ops.ABS else float(np.sqrt(level))
        return both(self.solid(p, reach, closed), self._above(p, -reach, closed))

    def _split(self, i: int, level: float, closed: bool) -> Expression:
        """Take a register apart at one of its choices; a leaf if there is none."""
        self.splits += 1
        if self.splits > MAX_SPLITS:
            raise _TooManyError
        new = self._rebuilt(i, {})
        if new != i:
            return self.solid(new, level, closed)
        inner = [
            j for j in sorted(self.b.ancestors(i))
            if self.b.code[j] in CHOICES and self._sides(j) is not None
        ]  # fmt: skip
        if not inner:
            return self._leaf(i, level, closed)
        for j in reversed(inner):
            if self.b.code[j] in (ops.MIN, ops.MAX, ops.ABS):
                sense = self._sense(i, j)
                if sense:
                    e, f = (
                        self.solid(self._rebuilt(i, {j: side}), level, closed)
                        for side in self._ends(j)
                    )
                    lower = (self.b.code[j] == ops.MIN) == (sense > 0)
                    return either(e, f) if lower else both(e, f)
        sides = self._sides(inner[0])
        assert sides is not None
        switch, first, second = sides
        e, f = (
            self.solid(self._rebuilt(i, {inner[0]: side}), level, closed)
            for side in (first, second)
        )
        return choice(switch(), e, f)

    def _leaf(self, i: int, level: float, closed: bool) -> Expression:
        number = self.splitter.leaf(i, level, self.owner)
        self.found.add(number)
        if len(self.found) > MAX_LEAVES:
            raise _TooManyError
        if self.splitter.vanishes(number):
            return closed
        return ("leaf", number)

    def _ends(self, j: int) -> tuple[int, int]:
        """The two numbers of which a choice is the least or the largest."""
        p = self.b.a[j]
        return (p, self.b.op(ops.NEG, p)) if self.b.code[j] == ops.ABS else (p, self.b.b[j])

    def _sides(self, j: int) -> tuple[Callable[[], Expression], int, int] | None:
        """Where the first of two registers replaces a choice, and these; None if it is no choice.

        That is a step between too many numbers.
        """
        b, code, p = self.b, self.b.code[j], self.b.a[j]
        if code in (ops.MIN, ops.MAX):
            q = b.b[j]
            low, high = (p, q) if code == ops.MIN else (q, p)
            return lambda: self.solid(b.sub(low, high), 0.0, False), p, q
        if code == ops.ABS:
            return lambda: self.solid(p, 0.0, False), b.op(ops.NEG, p), p
        if code == ops.SIGN:
            return lambda: self.solid(p, 0.0, False), b.const(-1.0), b.const(1.0)
        state = self.states.get(j, OPEN)
        if state < STEP:
            return None
        k = (state - STEP) // 2 - ORIGIN
        at, first, second = self._stairs(j, k)
        return lambda: self.solid(p, at, False), first, second

    def _stairs(self, j: int, k: int) -> tuple[float, int, int]:
        """Where a step from number k to the next one is, and what is there before and behind."""
        b, code, p = self.b, self.b.code[j], self.b.a[j]
        if code == ops.FLOOR:
            return k + 1.0, b.const(float(k)), b.const(k + 1.0)
        if code == ops.CEIL:
            return float(k), b.const(float(k)), b.const(k + 1.0)
        period = b.imm[b.b[j]]
        first, second = (b.sub(p, b.const(period * n)) for n in (k, k + 1))
        return period * (k + (0.5 if code == ops.WRAP else 1.0)), first, second

    def _rebuilt(self, i: int, replaced: dict[int, int]) -> int:
        """A register with all choices that are made, and some others, replaced."""
        b = self.b
        new = dict(replaced)
        for j in sorted(b.ancestors(i)):
            if j in new:
                continue
            if b.code[j] < ops.INPUTS:
                new[j] = j
                continue
            side = self._made(j)
            if side is not None:
                new[j] = new[side] if side in new else self._rebuilt(side, replaced)
                continue
            p, q = new[b.a[j]], new[b.b[j]]
            same = p == b.a[j] and q == b.b[j]
            new[j] = j if same else b.op(b.code[j], p, q if b.code[j] >= ops.BINARY else None)
            if new[j] != j and j in self.states and new[j] not in self.states:
                self.states[new[j]] = self.states[j]
        return new[i]

    def _made(self, j: int) -> int | None:
        """The register that a choice is, if it is made."""
        b, state = self.b, self.states.get(j, OPEN)
        code, p = b.code[j], b.a[j]
        if code in (ops.MIN, ops.MAX) and state in (FIRST, SECOND):
            return p if state == FIRST else b.b[j]
        if code == ops.ABS and state in (FIRST, SECOND):
            return p if state == FIRST else b.op(ops.NEG, p)
        if code == ops.SIGN and state in (FIRST, SECOND):
            return b.const(1.0 if state == FIRST else -1.0)
        if state >= STEP and (state - STEP) % 2 == 0:
            return self._stairs(j, (state - STEP) // 2 - ORIGIN)[1]
        return None

    def _sense(self, i: int, j: int) -> int:
        """1 if register i rises with register j, -1 if it falls, 0 if that is not known."""
        b = self.b
        sense: dict[int, int | None] = {j: 1}  # None where it does not depend on j
        for k in sorted(b.ancestors(i)):
            if k == j:
                continue
            code, p, q = b.code[k], b.a[k], b.b[k]
            if code < ops.INPUTS:
                sense[k] = None
                continue
            s = sense[p]
            t = sense[q] if code >= ops.BINARY else None
            if s is None and t is None:
                sense[k] = None
            elif code in (ops.ADD, ops.MIN, ops.MAX):
                sense[k] = _joint(s, t)
            elif code == ops.SUB:
                sense[k] = _joint(s, None if t is None else -t)
            elif code == ops.NEG:
                sense[k] = -int(s or 0)
            elif code in RISING:
                sense[k] = s
            elif code == ops.MUL and t is None and self._signed(q):
                sense[k] = int(s or 0) * self._signed(q)
            elif code == ops.MUL and s is None and self._signed(p):
                sense[k] = int(t or 0) * self._signed(p)
            elif code == ops.DIV and t is None and self._signed(q):
                sense[k] = int(s or 0) * self._signed(q)
            else:
                sense[k] = 0
        return int(sense[i] or 0)

    def _signed(self, i: int) -> int:
        """1 or -1 for a register that is never negative, or never positive; 0 for others."""
        if self.b.code[i] == ops.CONST:
            return 1 if self.b.imm[i] >= 0.0 else -1
        return int(self._never_negative(i))


def _joint(s: int | None, t: int | None) -> int:
    """Sense of a sum of two."""
    if s is None or t is None:
        return int((t if s is None else s) or 0)
    return s if s == t else 0


def signature(states: AnyArray) -> tuple[IntArray, IntArray]:
    """First rows and group (n,) of equal rows of states (n, k)."""
    if not states.shape[1]:
        return np.zeros(min(len(states), 1), np.int64), np.zeros(len(states), np.int64)
    rows = np.ascontiguousarray(states).view(np.dtype((np.void, states.itemsize * states.shape[1])))
    _, first, group = np.unique(rows.ravel(), return_index=True, return_inverse=True)
    return read_only(first), read_only(group.ravel())
