"""Boolean expressions of the signs of smooth fields, and their tables.

Guarantee: tables are exact. Non-guarantee: expressions are not made as short as possible.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

#: Fields with signs of their own in one box.
MAX_ACTIVE = 6
#: Bits of tables in which field k is negative.
NEGATIVE = tuple(sum(1 << i for i in range(64) if i >> k & 1) for k in range(MAX_ACTIVE))
ALL = (1 << 64) - 1

Expression: TypeAlias = Any  # bool, or a tuple of a word and its operands


def negation(e: Expression) -> Expression:
    """Not e."""
    if isinstance(e, bool):
        return not e
    return e[1] if e[0] == "not" else ("not", e)


def both(e: Expression, f: Expression) -> Expression:
    """The intersection of two expressions."""
    if isinstance(e, bool):
        return f if e else False
    if isinstance(f, bool):
        return e if f else False
    return e if e == f else ("and", e, f)


def either(e: Expression, f: Expression) -> Expression:
    """The union of two expressions."""
    return negation(both(negation(e), negation(f)))


def choice(s: Expression, e: Expression, f: Expression) -> Expression:
    """e where s, else f."""
    return e if e == f else either(both(s, e), both(negation(s), f))


@dataclass(frozen=True, eq=False)
class Formula:
    """A Boolean function of the signs of smooth fields.

    Attributes
    ----------
    expression : bool or tuple
        It: a truth value, ("leaf", number), ("not", e) or ("and", e, f).
    leaves : tuple of int
        Numbers of its fields.
    """

    expression: Expression
    leaves: tuple[int, ...]

    def restricted(self, signs: Sequence[int]) -> tuple[tuple[int, ...], int] | None:
        """What is left where some fields have certain signs.

        Parameters
        ----------
        signs : sequence of int
            -1, 0 or 1 for each of the leaves: negative, open, not negative.

        Returns
        -------
        tuple or None
            Numbers of the fields whose signs matter, and a table of 64 bits: bit b tells whether
            points are in the solid where just the fields of the ones in b are negative. None if
            there are more than `MAX_ACTIVE`.
        """
        known: dict[int, bool] = {
            leaf: s < 0 for leaf, s in zip(self.leaves, signs, strict=True) if s
        }
        rest = _simplified(self.expression, known, {})
        leaves = leaves_of(rest)
        if len(leaves) > MAX_ACTIVE:
            return None
        table = _table(rest, {leaf: NEGATIVE[k] for k, leaf in enumerate(leaves)})
        matter = tuple(
            leaf for k, leaf in enumerate(leaves)
            if (table >> (1 << k)) & ~NEGATIVE[k] & ALL != table & ~NEGATIVE[k] & ALL
        )  # fmt: skip
        if len(matter) < len(leaves):
            bits = dict.fromkeys(leaves, 0) | {leaf: NEGATIVE[k] for k, leaf in enumerate(matter)}
            table = _table(rest, bits)
        return matter, table


def leaves_of(e: Expression) -> tuple[int, ...]:
    """Numbers of the fields of an expression, in the order in which they occur."""
    found: dict[int, None] = {}
    seen: set[int] = set()
    todo = [e]
    while todo:
        part = todo.pop()
        if isinstance(part, bool) or id(part) in seen:
            continue
        seen.add(id(part))
        if part[0] == "leaf":
            found[part[1]] = None
        else:
            todo += part[:0:-1]
    return tuple(found)


def _simplified(e: Expression, known: dict[int, bool], memo: dict[int, Expression]) -> Expression:
    if isinstance(e, bool):
        return e
    if id(e) not in memo:
        if e[0] == "leaf":
            memo[id(e)] = known.get(e[1], e)
        elif e[0] == "not":
            memo[id(e)] = negation(_simplified(e[1], known, memo))
        else:
            memo[id(e)] = both(*(_simplified(part, known, memo) for part in e[1:]))
    return memo[id(e)]


def _table(e: Expression, bits: dict[int, int]) -> int:
    if isinstance(e, bool):
        return ALL if e else 0
    if e[0] == "leaf":
        return bits[e[1]]
    if e[0] == "not":
        return ALL ^ _table(e[1], bits)
    return _table(e[1], bits) & _table(e[2], bits)
