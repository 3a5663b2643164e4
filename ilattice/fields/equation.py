"""Equations in x, y, z, or other names of coordinates, as fields: parsed, never run by Python.

::

    expr   = term { ("+" | "-") term }
    term   = factor { ("*" | "/") factor }
    factor = ("+" | "-") factor | power
    power  = atom [ ("^" | "**") factor ]
    atom   = NUMBER | VARIABLE | CONSTANT | FUNCTION "(" expr { "," expr } ")" | "(" expr ")"

Guarantees: powers bind to the right and before signs, ``-x^2 = -(x^2)``; there is no implicit
multiplication; every text ends in a field or in an `InputError` with the place of what is wrong,
in time proportional to its length; constants are folded by the arithmetic of fields.
Not guaranteed: that an equation has values everywhere: ``sqrt(x)`` is NaN for negative x.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ilattice._shown import one_line
from ilattice._typing import FloatArray
from ilattice._validate import near_names
from ilattice.errors import InputError
from ilattice.fields import _tables as ops
from ilattice.fields._program import Builder, Point
from ilattice.fields.node import Node, everywhere

__all__ = ["constant", "equation"]

#: Characters of an equation, and levels of its brackets: the parser calls itself.
MAX_LENGTH = 20_000
MAX_DEPTH = 60
VARIABLES = ("x", "y", "z")
CONSTANTS: Mapping[str, float] = {"pi": np.pi, "tau": 2.0 * np.pi, "e": np.e}
#: Arguments of functions that take any number.
MANY = 1 << 30
#: Name: instruction, least and largest number of arguments.
FUNCTIONS: Mapping[str, tuple[int, int, int]] = {
    "abs": (ops.ABS, 1, 1), "acos": (ops.ACOS, 1, 1), "asin": (ops.ASIN, 1, 1),
    "atan": (ops.ATAN, 1, 1), "atan2": (ops.ATAN2, 2, 2), "ceil": (ops.CEIL, 1, 1),
    "cos": (ops.COS, 1, 1), "cosh": (ops.COSH, 1, 1), "exp": (ops.EXP, 1, 1),
    "floor": (ops.FLOOR, 1, 1), "log": (ops.LOG, 1, 1), "max": (ops.MAX, 2, MANY),
    "min": (ops.MIN, 2, MANY), "mod": (ops.MOD, 2, 2), "pow": (ops.POW, 2, 2),
    "sign": (ops.SIGN, 1, 1), "sin": (ops.SIN, 1, 1), "sinh": (ops.SINH, 1, 1),
    "sqrt": (ops.SQRT, 1, 1), "tan": (ops.TAN, 1, 1), "tanh": (ops.TANH, 1, 1),
}  # fmt: skip
_OPERATORS = {"+": ops.ADD, "-": ops.SUB, "*": ops.MUL, "/": ops.DIV, "^": ops.POW, "**": ops.POW}
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_]\w*)"
    r"|(?P<sign>\*\*|[-+*/^(),]))",
    re.ASCII,
)


class _Token(NamedTuple):
    kind: str  # "number", "name", "sign" or "end"
    text: str
    at: int


class _Step(NamedTuple):
    """One step of a stack machine: push a number or a variable, or apply an instruction."""

    kind: str  # "number", "variable" or "apply"
    value: float
    arguments: int = 0  # how many it is applied to


@dataclass(frozen=True, eq=False)
class _Equation(Node):
    text: str
    steps: tuple[_Step, ...]
    variables: tuple[str, ...] = VARIABLES

    def _emit(self, b: Builder, p: Point) -> int:
        stack: list[int] = []
        for step in self.steps:
            if step.kind == "number":
                stack.append(b.const(step.value))
            elif step.kind == "variable":
                stack.append(p[int(step.value)])
            else:
                first = len(stack) - step.arguments
                stack[first:] = [_applied(b, int(step.value), stack[first:])]
        return stack[0]

    def _box(self, level: float = 0.0) -> FloatArray:  # noqa: ARG002
        return everywhere()

    def __repr__(self) -> str:
        return one_line(f"equation({self.text!r})")


def _applied(b: Builder, code: int, arguments: list[int]) -> int:
    if code in (ops.MIN, ops.MAX):
        return b.extreme(code, arguments)
    if code == ops.POW and b.is_number(arguments[1], 2.0):
        return b.op(ops.SQUARE, arguments[0])
    return b.op(code, *arguments)


class _Parser:
    """Recursive descent to the steps of a stack machine."""

    def __init__(self, text: str, names: Mapping[str, float], variables: Sequence[str]) -> None:
        self.text, self.names, self.variables = text, names, variables
        self.steps: list[_Step] = []
        self.depth = 0
        self.tokens = self._split()
        self.next = 0

    def _split(self) -> list[_Token]:
        tokens, at, end = [], 0, len(self.text.rstrip())
        while at < end:
            found = _TOKEN.match(self.text, at)
            if not found:
                at = end - len(self.text[at:end].lstrip())
                raise self._error(f"unexpected character {self.text[at]!r}", at)
            kind = str(found.lastgroup)
            tokens.append(_Token(kind, found.group(kind), found.start(kind)))
            at = found.end()
        return [*tokens, _Token("end", "", len(self.text))]

    def _error(self, what: str, at: int) -> InputError:
        return InputError(f"equation {_short(self.text)}: {what} at character {at + 1}")

    @property
    def _token(self) -> _Token:
        return self.tokens[self.next]

    def _take(self, *signs: str) -> str:
        """The sign that comes next, if it is one of these; else nothing."""
        token = self._token
        if token.kind != "sign" or token.text not in signs:
            return ""
        self.next += 1
        return token.text

    def _expect(self, sign: str) -> None:
        if not self._take(sign):
            raise self._error(f"expected {sign!r}, found {self._found()}", self._token.at)

    def _found(self) -> str:
        return repr(self._token.text) if self._token.kind != "end" else "the end"

    def parse(self) -> tuple[_Step, ...]:
        """All steps of the text."""
        self._expression()
        if self._token.kind != "end":
            raise self._error(f"expected an operator, found {self._found()}", self._token.at)
        return tuple(self.steps)

    def _apply(self, sign: str) -> None:
        self.steps.append(_Step("apply", _OPERATORS[sign], 2))

    def _expression(self) -> None:
        self._term()
        while sign := self._take("+", "-"):
            self._term()
            self._apply(sign)

    def _term(self) -> None:
        self._factor()
        while sign := self._take("*", "/"):
            self._factor()
            self._apply(sign)

    def _factor(self) -> None:
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise self._error(f"more than {MAX_DEPTH} levels of nesting", self._token.at)
        sign = self._take("+", "-")
        if sign:
            self._factor()
            if sign == "-":
                self.steps.append(_Step("apply", ops.NEG, 1))
        else:
            self._power()
        self.depth -= 1

    def _power(self) -> None:
        self._atom()
        if self._take("^", "**"):
            self._factor()
            self._apply("^")

    def _atom(self) -> None:
        token = self._token
        if self._take("("):
            self._expression()
            self._expect(")")
            return
        if token.kind not in ("number", "name"):
            raise self._error(f"expected a value, found {self._found()}", token.at)
        self.next += 1
        if token.kind == "number":
            self._number(float(token.text), token)
        else:
            self._name(token)

    def _number(self, value: float, token: _Token) -> None:
        if not np.isfinite(value):
            raise self._error(f"the number {token.text} is too large", token.at)
        self.steps.append(_Step("number", value))

    def _name(self, token: _Token) -> None:
        name = token.text.lower()
        if name in self.names:
            self._number(self.names[name], token)
        elif name in self.variables:
            self.steps.append(_Step("variable", self.variables.index(name)))
        elif name in CONSTANTS:
            self._number(CONSTANTS[name], token)
        elif name in FUNCTIONS:
            self._call(name, token)
        else:
            known = sorted({*self.variables, *CONSTANTS, *FUNCTIONS, *self.names})
            near = near_names(name, known)
            raise self._error(f"unknown name {token.text!r} (near names: {near})", token.at)

    def _call(self, name: str, token: _Token) -> None:
        code, least, most = FUNCTIONS[name]
        self._expect("(")
        count = 1
        self._expression()
        while self._take(","):
            count += 1
            self._expression()
        self._expect(")")
        if not least <= count <= most:
            wanted = f"{least} or more" if most == MANY else str(least)
            raise self._error(f"{name}() takes {wanted} arguments, got {count},", token.at)
        self.steps.append(_Step("apply", code, count))


def _short(text: str) -> str:
    return repr(text if len(text) <= 60 else text[:57] + "...")


def _parsed(
    text: str, names: Mapping[str, float] | None, variables: Sequence[str] = VARIABLES
) -> _Equation:
    if not isinstance(text, str):
        raise InputError(f"an equation must be text, got {text!r:.80}")
    told = names is None or (
        isinstance(names, Mapping) and all(isinstance(name, str) for name in names)
    )
    if not told:
        raise InputError(f"names must be a mapping of words to numbers, got {names!r:.80}")
    if not isinstance(variables, (list, tuple)) or not all(isinstance(v, str) for v in variables):
        raise InputError(f"variables must be three words, got {variables!r:.80}")
    if len(text) > MAX_LENGTH:
        raise InputError(f"an equation may have {MAX_LENGTH} characters, got {len(text)}")
    known = _own_names(names or {}, variables)
    return _Equation(text, _Parser(text, known, variables).parse(), tuple(variables))


def _own_names(names: Mapping[str, float], variables: Sequence[str]) -> dict[str, float]:
    """Names in small letters; those that mean something else already are refused."""
    known: dict[str, float] = {}
    for name, value in names.items():
        small = name.lower()
        if small in known or small in variables or small in CONSTANTS or small in FUNCTIONS:
            why = "another name" if small in known else "what has a meaning already"
            raise InputError(
                f"names: {name!r:.80} is {why}, capitals being the same as small letters; rename it"
            )
        known[small] = value
    return known


def equation(
    text: str, *, names: Mapping[str, float] | None = None, variables: Sequence[str] = VARIABLES
) -> Node:
    """Field of an equation such as ``"x^2 + y^2 + z^2 - 1"``; the solid is where it is negative.

    Parameters
    ----------
    text : str
        Numbers, x, y, z, pi, tau, e, ``+ - * / ^ **``, parentheses, and the functions sin cos tan
        asin acos atan atan2 sinh cosh tanh exp log sqrt abs sign floor ceil mod pow min max.
        Upper and lower case are the same.
    names : mapping of str to float, optional
        Further constants, in lower case.
    variables : sequence of str
        Names of the three coordinates, in lower case.

    Returns
    -------
    Node
        The field. It is not a distance; `normalize` makes it one to first order.

    Raises
    ------
    InputError
        For any other text, with the place of the first wrong character.

    Examples
    --------
    >>> float(equation("x^2 + 2*y - 1")([[3.0, 0.5, 0.0]])[0])
    9.0
    """
    return _parsed(text, names, variables)


def constant(text: str, *, names: Mapping[str, float] | None = None) -> float:
    """Value of an equation without x, y and z.

    Parameters
    ----------
    text : str
        As for `equation`, for example ``"2*0.35"``.
    names : mapping of str to float, optional
        Further constants, in lower case.

    Returns
    -------
    float
        The value.

    Raises
    ------
    InputError
        For any other text, for coordinates in it, and for values that are not finite.
    """
    found = _parsed(text, names)
    if has_coordinates(found):
        raise InputError(f"{_short(text)} must be a constant, without x, y and z")
    b = Builder()
    value = b.imm[found._emit(b, (0, 1, 2))]
    if not np.isfinite(value):
        raise InputError(f"{_short(text)} is {value}, not a finite number")
    return value


def has_coordinates(field: Node) -> bool:
    """Whether an equation mentions x, y or z."""
    return isinstance(field, _Equation) and any(s.kind == "variable" for s in field.steps)


def coordinates_in(field: Node) -> set[str]:
    """Names of the coordinates that a field is a function of: x, y, z, unless equations say more.

    Parameters
    ----------
    field : Node
        The field.

    Returns
    -------
    set of str
        Those that its equations mention, and x, y, z for all other fields in it.
    """
    if isinstance(field, _Equation):
        return {field.variables[int(s.value)] for s in field.steps if s.kind == "variable"}
    if not field.children:
        return set(VARIABLES)
    return set().union(*(coordinates_in(child) for child in field.children))


def names_in(text: str) -> set[str]:
    """Names that an equation mentions, in lower case: coordinates, constants and functions."""
    return {t.text.lower() for t in _Parser(text, {}, VARIABLES).tokens if t.kind == "name"}
