"""Equations as fields: values against Python's own arithmetic, derivatives, bounds, errors."""

import math
import random
import re

import numpy as np
import pytest
from conformance import check_field, check_range

import ilattice as il
from ilattice.errors import InputError
from ilattice.fields import constant, equation

BOX = np.array([[0.2, 0.3, 0.1], [0.9, 0.8, 0.7]])
TEXTS = [
    "x^2 + y^2 + z^2 - 1",
    "cos(tau*x)*sin(tau*y) + cos(tau*y)*sin(tau*z) + cos(tau*z)*sin(tau*x)",
    "-x^2 + 2*-y - -z",
    "2^-x^2",
    "sqrt(x)*exp(-y)/(1 + log(z + 2))",
    "atan2(y, x) + asin(z/2) - acos(x/3) + atan(y)",
    "tanh(x)+sinh(y)*cosh(z) + tan(x*y)",
    "pow(x, 2.5) + (x + 1)**3 - 1e-1*.5 + 3.",
    "exp(x*y)*max(x + 2, y/9, z/9) - min(x, y + 1)",
    "abs(x - 3) + 1/(x + y)",
]
NAMES = {name: getattr(math, name) for name in dir(math) if not name.startswith("_")}
NAMES |= {"abs": abs, "min": min, "max": max, "sign": lambda v: (v > 0) - (v < 0)}
NAMES |= {"mod": lambda a, b: a - b * math.floor(a / b)}


def python(text, point):
    """The value by Python itself, whose grammar agrees where both have one."""
    return eval(text.replace("^", "**"), dict(zip("xyz", point, strict=True)) | NAMES)


@pytest.mark.parametrize("text", TEXTS)
def test_values_are_those_of_python(text):
    p = np.random.default_rng(1).uniform(*BOX, (50, 3))
    expected = [python(text, row) for row in p.tolist()]
    np.testing.assert_allclose(equation(text)(p), expected, rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("text", TEXTS)
def test_equations_keep_the_promises_of_fields(text):
    check_field(equation(text), np.random.default_rng(2), box=BOX, points=40, rtol=1e-4)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2*0.35", 0.7), ("-2^2", -4.0), ("2^3^2", 512.0), ("(-2)^2", 4.0), ("4/100", 0.04),
        ("2**-1", 0.5), ("--3", 3.0), ("2*-3", -6.0), ("7 - 2 - 1", 4.0), ("8/4/2", 1.0),
        ("mod(-1, 3)", 2.0), ("min(3, 1, 2)", 1.0), ("floor(2.5) + ceil(2.5)", 5.0),
        ("PI + tau/2", 2 * math.pi), ("E", math.e), ("sign(-3)", -1.0), ("1e2", 100.0),
        ("a/2", 3.0),
    ],
)  # fmt: skip
def test_constants(text, value):
    assert constant(text, names={"a": 6.0}) == pytest.approx(value, rel=1e-15)


def test_coordinates_may_have_other_names():
    u = np.random.default_rng(1).random((20, 3))
    found = equation("0.1 + U*v^2 - w", variables=("u", "v", "w"))
    np.testing.assert_allclose(found(u), 0.1 + u[:, 0] * u[:, 1] ** 2 - u[:, 2], atol=1e-15)
    with pytest.raises(InputError, match=r"unknown name 'x' .*near names: "):
        equation("u + x", variables=("u", "v", "w"))


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("x + ", "character 5"), ("x ++* y", "character 5"), ("2x", "character 2"),
        ("x $ y", "'$' at character 3"), ("gyriod(x)", "near names"), ("cso(x)", "cos"),
        ("sin x", "character 5"), ("sin(x", "the end"), ("(x", "expected ')'"), ("x)", "')'"),
        ("atan2(x)", "takes 2"), ("max(x)", "2 or more"), ("sin(x, y)", "takes 1"), ("", "the end"),
        ("1e999*x", "too large"), ("(" * 100 + "x" + ")" * 100, "nesting"),
        ("-" * 200 + "x", "nesting"),
        ("x^" * 200 + "x", "nesting"), ("x" * 30_000, "20000"), ("x\u00b2", "character 2"),
        ("__import__('os')", "character"), ("x.real", "character 2"),
        ("x if y else z", "character 3"),
    ],
)  # fmt: skip
def test_errors_say_where(text, where):
    with pytest.raises(InputError) as caught:
        equation(text)
    assert where in str(caught.value)


@pytest.mark.parametrize("text", ["x", "sqrt(-1)", "1/0", "log(0)", "0*y", 3])
def test_what_is_no_constant(text):
    with pytest.raises(InputError):
        constant(text)


def test_long_sums_are_no_problem():
    text = "+".join(["x*y"] * 4000)
    assert equation(text)([[1.0, 2.0, 0.0]])[0] == 8000.0


def test_random_texts_end_in_a_field_or_an_input_error():
    rng, pieces = random.Random(3), ["x", "y", "z", "1", ".5", "2e1", "+", "-", "*", "/", "^", "**"]
    pieces += ["(", ")", ",", "sin(", "atan2(", "min(", "pi", "foo", " ", "?", "e", "log(", "mod("]
    accepted = 0
    for _ in range(2500):
        text = "".join(rng.choice(pieces) for _ in range(rng.randrange(1, 14)))
        try:
            field = equation(text)
        except InputError:
            continue
        assert field([[0.3, 0.4, 0.5]]).shape == (1,)
        accepted += 1
    assert accepted > 50


@pytest.mark.parametrize("name", ["gyroid", "iwp", "c_d", "lidinoid", "q_star", "split_p"])
def test_tiles_become_part_of_the_program(name):
    tile = il.tiles[name]
    node, p = il.fields.from_callable(tile), np.random.default_rng(4).uniform(-1, 1, (200, 3))
    assert not node.program.leaves
    inside = np.mod(p, 1.0)
    np.testing.assert_allclose(node(p), tile(inside), atol=1e-12)
    np.testing.assert_allclose(node.jet(p, 1)[1], tile.jet(inside, 1)[1], atol=1e-10)
    check_range(node, np.random.default_rng(5), np.array([[-1.0] * 3, [1.0] * 3]), converges=False)


def test_struts_repeat_through_space():
    tile = il.tiles.octet(radius=0.1)
    node, p = il.fields.from_callable(tile), np.random.default_rng(6).uniform(-2, 2, (300, 3))
    np.testing.assert_allclose(node(p), tile(np.mod(p, 1.0)), atol=1e-12)
    check_range(node, np.random.default_rng(7), np.array([[-1.0] * 3, [1.5] * 3]), converges=False)


def test_errors_quote_what_was_written():
    """Numbers of NumPy lose their type in messages, but not what somebody wrote."""
    with pytest.raises(InputError, match=re.escape("'x - np.float64(0.5)'")):
        equation("x - np.float64(0.5)")
    assert "got 0.5" in str(InputError(f"d must be a whole number, got {np.float64(0.5)!r}"))
