"""Conditions in words: half-spaces by linear conditions in x, y and z, and by boxes.

Guarantee: a condition is read as arithmetic, never run. Non-guarantee: of texts that are no
conditions, only the first mistake is told.
"""

import ast
import operator
import re
from typing import Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice._validate import as_array
from ilattice.errors import InputError

_LINEAR: dict[type, Any] = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul,
           ast.Div: operator.truediv, ast.USub: operator.neg, ast.UAdd: operator.pos}  # fmt: skip
#: How numbers of NumPy write themselves into texts.
_NUMPY = re.compile(r"\bnp\.float\d+\(([-+.\w]*)\)")
_FORM = "write it like 'y > 0', 'x + y < 2' or 'x > 0 and z <= 1', or give a box (lowest, highest)"


def as_planes(clip: Any, name: str = "clip", *, flat: bool = False) -> FloatArray:
    """Half-spaces of which what is in all of them is kept.

    Parameters
    ----------
    clip : str or (2, 3) array-like
        Linear conditions in x, y, z joined by ``and``, or the lowest and highest corner of a box.
    name : str
        What it is called in messages.
    flat : bool
        Whether boxes may be flat.

    Returns
    -------
    ndarray, shape (m, 4)
        ``a``, ``b``: kept is where ``a·x + b >= 0``; ``a`` has length one.

    Raises
    ------
    InputError
        If it is neither.
    """
    if isinstance(clip, str):
        try:
            node = ast.parse(_NUMPY.sub(r"(\1)", clip.strip()), mode="eval").body
        except (SyntaxError, ValueError):
            raise InputError(f"{name} {clip!r:.80} cannot be read; {_FORM}") from None
        try:
            return _parsed(node)
        except _UnknownError as error:
            raise InputError(f"{name} {clip!r:.80} {error}; {_FORM}") from None
    box = as_array(name, clip)
    if box.shape != (2, 3):
        raise InputError(f"{name} must be a condition or two corners, got {clip!r:.80}; {_FORM}")
    if not ((box[0] <= box[1]).all() if flat else (box[0] < box[1]).all()):
        raise InputError(
            f"{name}: the first corner of a box must be below the second in all of x, y and z, got "
            f"{clip!r:.80}"
        )
    eye = np.eye(3)
    return np.vstack([np.column_stack([eye, -box[0]]), np.column_stack([-eye, box[1]])])


class _UnknownError(Exception):
    """What is wrong with a condition."""


def _parsed(node: ast.expr) -> FloatArray:
    if isinstance(node, ast.BoolOp) and isinstance(node.op, ast.And):
        return np.vstack([_parsed(value) for value in node.values])
    if not isinstance(node, ast.Compare):
        raise _UnknownError("has no condition")
    rows, left = [], node.left
    for op, right in zip(node.ops, node.comparators, strict=True):
        sign = {ast.Gt: 1.0, ast.GtE: 1.0, ast.Lt: -1.0, ast.LtE: -1.0}.get(type(op))
        if sign is None:
            raise _UnknownError("must compare by <, <=, > or >=")
        row = sign * (_affine(left) - _affine(right))
        size = np.linalg.norm(row[:3])
        if not size > 0.0 or not np.isfinite(row).all():
            raise _UnknownError("has a condition without x, y or z")
        rows.append(row / size)
        left = right
    return np.array(rows)


def as_affine(node: ast.expr, what: str, form: str) -> FloatArray:
    """Coefficients of x, y, z and 1 of a linear expression.

    Parameters
    ----------
    node : ast.expr
        The expression.
    what, form : str
        What it is called in messages, and how it should be written.

    Returns
    -------
    ndarray, shape (4,)
        Finite.

    Raises
    ------
    InputError
        If it is not linear.
    """
    try:
        return _affine(node)
    except _UnknownError as error:
        raise InputError(f"{what} {error}; {form}") from None


def _affine(node: ast.expr) -> FloatArray:
    """Coefficients of x, y, z and 1."""
    at = np.vstack([np.eye(3), np.zeros(3), np.ones(3), np.full(3, 2.0)])
    value = np.broadcast_to(_value(node, dict(zip("xyz", at.T, strict=True))), 6)
    if not np.isfinite(value).all():
        raise _UnknownError("is not finite")
    row = np.append(value[:3] - value[3], value[3])
    told = at @ row[:3] + row[3]
    if not np.allclose(told, value, rtol=1e-9, atol=1e-9 * np.abs(value).max(initial=1e-300)):
        raise _UnknownError("is not linear in x, y, z")
    return row


def _value(node: ast.expr, names: dict[str, FloatArray]) -> Any:
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        number: Any = node.value
        return float(number)
    if isinstance(node, ast.Name) and node.id in names:
        return names[node.id]
    if isinstance(node, ast.BinOp) and type(node.op) in _LINEAR:
        left, right = (_value(side, names) for side in (node.left, node.right))
        with np.errstate(all="ignore"):
            return _LINEAR[type(node.op)](np.asarray(left), np.asarray(right))
    if isinstance(node, ast.UnaryOp) and type(node.op) in _LINEAR:
        return _LINEAR[type(node.op)](_value(node.operand, names))
    raise _UnknownError("may contain only numbers, x, y, z, +, -, * and /")
