"""Formulas of the command line: right values, and nothing but formulas passes."""

import string
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ilattice._expression import FUNCTIONS, Expression, parse
from ilattice.errors import InputError

P = np.random.default_rng(1).random((50, 3))
U, V, W = P.T


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0.1 + 0.09*(1 - cos(2*pi*u))", 0.1 + 0.09 * (1 - np.cos(2 * np.pi * U))),
        ("u - v/(1 + w)**2", U - V / (1 + W) ** 2),
        ("-u**2", -(U**2)),
        ("2**-1*u", 0.5 * U),
        ("max(u, min(v, w))", np.maximum(U, np.minimum(V, W))),
        ("hypot(u, v) + atan2(v, u) + e", np.hypot(U, V) + np.arctan2(V, U) + np.e),
        ("sqrt(abs(sin(u)*exp(v)) + tanh(w))", np.sqrt(np.abs(np.sin(U) * np.exp(V)) + np.tanh(W))),
        ("  +u\n", U),
    ],
)
def test_values(text, expected):
    np.testing.assert_allclose(Expression(text)(P), expected, rtol=1e-14)


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_every_function_is_callable(name):
    _, n, _ = FUNCTIONS[name]
    values = Expression(f"{name}({', '.join(['0.5*u + 0.2'] * n)})")(P)
    assert values.shape == (50,)
    assert np.ptp(values) > 0 or name in ("floor", "atan2")


def test_constants_are_numbers():
    assert parse("0.1") == 0.1
    assert parse("1/8") == 0.125
    assert isinstance(parse("1/8"), float)
    assert isinstance(parse("0*u"), Expression)
    np.testing.assert_array_equal(Expression("2")(P), np.full(50, 2.0))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "x",
        "u +",
        "u;v",
        "u if v else w",
        "u < v",
        "u and v",
        "True",
        "'a'",
        "1j",
        "[u]",
        "u.real",
        "u[0]",
        "(lambda: 1)()",
        "__import__('os')",
        "sin",
        "sinus(u)",
        "sin(u, v)",
        "min(u)",
        "sin(u=1)",
        "sin(*u)",
        "f'{u}'",
        "u := 1",
        "9" * 400,
        "u" + "+u" * 400,
        "~u",
        "u // v",
        "u % v",
        "\0",
    ],
)
def test_everything_else_is_refused(text):
    with pytest.raises(InputError):
        Expression(text)


def test_text_only():
    with pytest.raises(InputError, match="text"):
        Expression(0.1)


@pytest.mark.parametrize("text", ["1/u", "log(u - 2)", "1e308*1e308", "10**1000"])
def test_values_that_are_not_finite_name_the_point(text):
    with pytest.raises(InputError, match=r"\(u, v, w\) = \(0\.0, 0\.25, 0\.5\)"):
        Expression(text)([[0, 0.25, 0.5]])


def test_near_names_are_offered():
    with pytest.raises(InputError, match=r"near are .*sin"):
        Expression("sinn(u)")


PIECES = [*FUNCTIONS, "u", "v", "w", "pi", "0.1", "1e9", "(", ")", ",", "+", "-", "*", "/", "**"]
NOISE = st.one_of(
    st.text(max_size=40),
    st.text(alphabet=string.printable, max_size=60),
    st.lists(
        st.sampled_from([*PIECES, "[", "]", ".", "lambda", ":", "if", "'", "="]), max_size=30
    ).map("".join),
)


@given(NOISE)
def test_noise_gives_values_or_an_input_error(text):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            values = Expression(text)(P)
        except InputError:
            return
    assert values.shape == (50,)
    assert np.isfinite(values).all()
