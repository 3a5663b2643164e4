"""Formulas in u, v, w, typed by a user, as vectorised callables: nothing else can be run.

Guarantee: the text is parsed, never evaluated by Python; only numbers, ``u v w pi e``, the
operators ``+ - * / **`` and the functions of `FUNCTIONS` pass. Anything else is an `InputError`
that quotes the offending piece. A value that is not finite is an `InputError` that names the point.

Not guaranteed: that the formula makes sense as a thickness; that is for the caller to check.
"""

import ast
import operator
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import as_points, near_names
from ilattice.errors import InputError

MAX_LENGTH = 500
VARIABLES = {"u": 0, "v": 1, "w": 2}
CONSTANTS = {"pi": np.pi, "e": np.e}
# name: (function, smallest and largest number of arguments)
FUNCTIONS: dict[str, tuple[Callable[..., Any], int, int]] = {
    "abs": (np.abs, 1, 1),
    "acos": (np.arccos, 1, 1),
    "asin": (np.arcsin, 1, 1),
    "atan": (np.arctan, 1, 1),
    "atan2": (np.arctan2, 2, 2),
    "cos": (np.cos, 1, 1),
    "cosh": (np.cosh, 1, 1),
    "exp": (np.exp, 1, 1),
    "floor": (np.floor, 1, 1),
    "hypot": (np.hypot, 2, 2),
    "log": (np.log, 1, 1),
    "max": (np.maximum, 2, 2),
    "min": (np.minimum, 2, 2),
    "sin": (np.sin, 1, 1),
    "sinh": (np.sinh, 1, 1),
    "sqrt": (np.sqrt, 1, 1),
    "tan": (np.tan, 1, 1),
    "tanh": (np.tanh, 1, 1),
}
_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: np.divide,
    ast.Pow: np.power,
}
_Value = Callable[[FloatArray], Any]


@dataclass(frozen=True, eq=False)
class Expression:
    """A formula in u, v, w.

    Parameters
    ----------
    text : str
        The formula, for example ``"0.1 + 0.09*(1 - cos(2*pi*u))"``.

    Raises
    ------
    InputError
        If the text is not such a formula.
    """

    text: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "_value", _compile(self.text))

    def __call__(self, u: ArrayLike) -> FloatArray:
        """Values, shape (n,), at the points `u`, shape (n, 3)."""
        p = as_points("u", u)
        with np.errstate(all="ignore"):
            a = np.asarray(self._value(p), dtype=np.float64)  # type: ignore[attr-defined]
        a = np.array(np.broadcast_to(a, (len(p),)))
        if not np.isfinite(a).all():
            i = int(np.argmin(np.isfinite(a)))
            raise InputError(f"{self.text!r} is {a[i]} at (u, v, w) = {tuple(p[i].tolist())}")
        return a


def parse(text: str) -> float | Expression:
    """A number if the text is one without variables, an `Expression` otherwise.

    Parameters
    ----------
    text : str
        A number or a formula.

    Returns
    -------
    float or Expression
        Constant formulas such as ``"1/8"`` are evaluated at once.

    Raises
    ------
    InputError
        If the text is neither.
    """
    expression = Expression(text)
    names = {n.id for n in ast.walk(_tree(text)) if isinstance(n, ast.Name)}
    if names & VARIABLES.keys():
        return expression
    return float(expression(np.zeros((1, 3)))[0])


def _tree(text: str) -> ast.expr:
    if not isinstance(text, str):
        raise InputError(f"a formula must be text, got {text!r:.80}")
    if len(text) > MAX_LENGTH:
        raise InputError(f"a formula may have {MAX_LENGTH} characters, got {len(text)}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as e:
        raise InputError(f"{text!r} is not a formula in u, v, w: {_reason(e)}") from e


def _reason(e: BaseException) -> str:
    return e.msg if isinstance(e, SyntaxError) else (str(e) or type(e).__name__)


def _compile(text: str) -> _Value:
    tree = _tree(text)
    try:
        return _node(tree, text)
    except RecursionError as e:
        raise InputError(f"the formula {text!r:.80} is nested too deeply") from e


def _node(node: ast.expr, text: str) -> _Value:
    match node:
        case ast.Constant():
            return _constant(node, text)
        case ast.Name(id=name):
            return _name(name, text)
        case ast.UnaryOp(op=ast.USub() | ast.UAdd() as op, operand=operand):
            inner = _node(operand, text)
            return (lambda p: -inner(p)) if isinstance(op, ast.USub) else inner
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
            f, a, b = _BINARY[type(op)], _node(left, text), _node(right, text)
            return lambda p: f(a(p), b(p))
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]):
            return _call(name, args, text)
    piece = ast.get_source_segment(text.strip(), node) or type(node).__name__
    raise InputError(f"{piece!r} may not stand in the formula {text!r}")


def _constant(node: ast.Constant, text: str) -> _Value:
    if isinstance(node.value, bool) or not isinstance(node.value, int | float):
        raise InputError(f"{node.value!r} in the formula {text!r} is not a real number")
    try:
        number = np.float64(node.value)
    except OverflowError as e:
        raise InputError(f"a number in the formula {text!r} is too large") from e
    return lambda _: number


def _name(name: str, text: str) -> _Value:
    if name in CONSTANTS:
        constant = np.float64(CONSTANTS[name])
        return lambda _: constant
    if name in VARIABLES:
        axis = VARIABLES[name]
        return lambda p: p[:, axis]
    known = ", ".join([*VARIABLES, *CONSTANTS])
    raise InputError(f"{name!r} in the formula {text!r} is unknown; known are {known}")


def _call(name: str, args: list[ast.expr], text: str) -> _Value:
    if name not in FUNCTIONS:
        near = near_names(name, list(FUNCTIONS))
        raise InputError(f"function {name!r} in the formula {text!r} is unknown; near are {near}")
    f, least, most = FUNCTIONS[name]
    if not least <= len(args) <= most:
        raise InputError(f"{name}() in the formula {text!r} takes {least}, got {len(args)}")
    inner = [_node(a, text) for a in args]
    return lambda p: f(*(g(p) for g in inner))
