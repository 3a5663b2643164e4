"""Every instruction of a program: its value, its derivatives in both ways, its bounds."""

from dataclasses import dataclass

import numpy as np
import pytest
from conformance import check_field

from ilattice.fields import _tables as ops
from ilattice.fields._program import Builder
from ilattice.fields.node import Node, everywhere

#: Instruction, its name in NumPy, and the range of arguments in which it is smooth.
UNARY = [
    ("NEG", np.negative, (-2, 2)), ("ABS", np.abs, (0.1, 2)), ("SQRT", np.sqrt, (0.2, 3)),
    ("SQUARE", np.square, (-2, 2)), ("SIN", np.sin, (-4, 4)), ("COS", np.cos, (-4, 4)),
    ("TAN", np.tan, (-1.2, 1.2)), ("ASIN", np.arcsin, (-0.9, 0.9)),
    ("ACOS", np.arccos, (-0.9, 0.9)), ("ATAN", np.arctan, (-3, 3)), ("SINH", np.sinh, (-2, 2)),
    ("COSH", np.cosh, (-2, 2)), ("TANH", np.tanh, (-2, 2)), ("EXP", np.exp, (-2, 2)),
    ("LOG", np.log, (0.2, 3)), ("SIGN", np.sign, (0.1, 2)), ("FLOOR", np.floor, (1.1, 1.9)),
    ("CEIL", np.ceil, (1.1, 1.9)),
]  # fmt: skip
BINARY = [
    ("ADD", np.add, (-2, 2)), ("SUB", np.subtract, (-2, 2)), ("MUL", np.multiply, (-2, 2)),
    ("DIV", np.divide, (0.3, 2)), ("POW", np.power, (0.3, 2)), ("ATAN2", np.arctan2, (0.2, 2)),
    ("MOD", np.mod, (0.3, 0.5)), ("MIN", np.minimum, (0.3, 2)), ("MAX", np.maximum, (0.3, 2)),
]  # fmt: skip
#: The same over wide boxes, kinks, poles and edges of definition among them: bounds only.
WIDE = [(name, f, (-3.0, 3.0)) for name, f, _ in UNARY + BINARY]


@dataclass(frozen=True, eq=False)
class Instruction(Node):
    """An instruction of x + 0.3 z, and of y for a binary one."""

    code: int

    def _emit(self, b, p):
        first = b.add(p[0], b.scaled(0.3, p[2]))
        return b.op(self.code, first, p[1] if self.code >= ops.BINARY else None)

    def _box(self, level=0.0):  # noqa: ARG002
        return everywhere()


def expected(f, code, p):
    first = p[:, 0] + 0.3 * p[:, 2]
    with np.errstate(all="ignore"):
        return f(first, p[:, 1]) if code >= ops.BINARY else f(first)


def box_of(low, high):
    """Box in which the argument x + 0.3 z runs from low to high; y goes higher than that."""
    margin = 0.1 * (high - low)
    return np.array([[low, high + margin, 0.0], [high - margin, high + 2, margin / 0.3]])


@pytest.mark.parametrize(("name", "f", "ends"), UNARY + BINARY, ids=lambda v: str(v)[:8])
def test_values_derivatives_and_bounds(name, f, ends):
    code = getattr(ops, name)
    field, rng = Instruction(code), np.random.default_rng(5)
    box = box_of(*ends)
    p = rng.uniform(*box, (200, 3))
    np.testing.assert_allclose(field(p), expected(f, code, p), rtol=1e-13, atol=1e-15)
    if np.ptp(expected(f, code, p)) == 0.0:  # a step
        assert not field.jet(p, 1)[1].any()
        return
    sharp = name != "MOD"  # with a divisor that varies, its bounds are those of any remainder
    check_field(field, rng, box=box, points=60, rtol=1e-4, exact=True, converges=sharp)


@pytest.mark.parametrize(
    ("name", "ends"), [(n, e) for n, _, e in UNARY + BINARY], ids=lambda v: str(v)
)
def test_derivatives_as_instructions_are_those_of_the_jet(name, ends):
    """What `normalize` uses."""
    code = getattr(ops, name)
    field, box = Instruction(code), box_of(*ends)
    p = np.random.default_rng(6).uniform(*box, (100, 3))
    b = Builder()
    rows = b.gradient(field._emit(b, (0, 1, 2)), (0, 1, 2))
    by_instructions = np.stack([b.program(r).values(p) for r in rows], axis=1)
    g = field.jet(p, 1)[1]
    np.testing.assert_allclose(by_instructions, g, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize(("name", "f", "ends"), WIDE, ids=lambda v: str(v)[:8])
def test_bounds_hold_at_kinks_poles_and_outside_the_domain_of_definition(name, f, ends):
    code = getattr(ops, name)
    field, rng = Instruction(code), np.random.default_rng(8)
    for size in (0.05, 1.0, 4.0):
        lo = rng.uniform(*ends, (60, 3))
        hi = lo + size * rng.uniform(0.0, 1.0, (60, 3))
        bounds = field.range(lo, hi)
        for t in rng.uniform(0.0, 1.0, (40, 1, 3)):
            value = expected(f, code, lo + t[0] * (hi - lo))
            known = np.isfinite(value)
            slack = 1e-12 * (1.0 + np.abs(np.where(known, value, 0.0)))
            assert (bounds[known, 0] <= (value + slack)[known]).all()
            assert (bounds[known, 1] >= (value - slack)[known]).all()
