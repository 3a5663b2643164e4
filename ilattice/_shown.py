"""`Shown`: objects that show in a console as what they are: in one short line.

Guarantee: `repr` is one line of at most `WIDTH` characters, without addresses in memory and without
the numbers of arrays. Non-guarantee: that the line is Python that would make the object again.
"""

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np

__all__ = ["WIDTH", "Shown", "one_line"]

#: Characters of a line at most.
WIDTH = 119
#: Things within things that are still shown, members of sequences, and numbers of arrays.
_DEPTH, _MEMBERS, _NUMBERS = 3, 3, 3


class Shown:
    """Objects that show as their kind and what they are made of.

    Classes that write a `__repr__` keep it, and their subclasses do. Dataclasses write none of
    their own, which would show all numbers of arrays; what they declare with ``repr=False``, or
    with a name that begins with ``_``, is not shown.
    """

    __slots__ = ()

    def __init_subclass__(cls, **arguments: Any) -> None:
        """Give a class the `repr` that it inherits, so that `dataclass` adds none."""
        super().__init_subclass__(**arguments)
        if "__repr__" not in vars(cls):
            cls.__repr__ = cls.__repr__  # type: ignore[method-assign]

    @property
    def _kind(self) -> str:
        """What it is called."""
        return type(self).__name__.lstrip("_")

    def __repr__(self) -> str:
        """One line."""
        return one_line(_text(self, 0))


def one_line(text: str) -> str:
    """A text in one line of at most `WIDTH` characters.

    Parameters
    ----------
    text : str
        The text.

    Returns
    -------
    str
        The text, with "..." for the middle of a long one.
    """
    line = " ".join(text.split())
    half = (WIDTH - 3) // 2
    return line if len(line) <= WIDTH else f"{line[:half]}...{line[-half:]}"


def _text(thing: Any, depth: int) -> str:
    """A thing within others, in words."""
    if isinstance(thing, Shown) and type(thing).__repr__ is Shown.__repr__:
        inside = "..." if depth >= _DEPTH else ", ".join(_attributes(thing, depth + 1))
        return f"{thing._kind}({inside})"
    if isinstance(thing, Enum):
        return str(thing.name)
    if isinstance(thing, (float, np.floating)):
        return f"{thing:.6g}"
    if isinstance(thing, np.ndarray):
        return _array(thing)
    if isinstance(thing, Mapping):
        return f"{{{', '.join(_members(list(thing), depth))}}}"
    if type(thing) in (tuple, list):
        return f"({', '.join(_members(thing, depth))})"
    text = repr(thing)
    return str(getattr(thing, "__name__", type(thing).__name__)) if " at 0x" in text else text


def _attributes(thing: Any, depth: int) -> Iterator[str]:
    """What a dataclass is made of, by name."""
    for field in fields(thing) if is_dataclass(thing) else ():
        if field.repr and not field.name.startswith("_") and hasattr(thing, field.name):
            yield f"{field.name}={_text(getattr(thing, field.name), depth)}"


def _members(things: Any, depth: int) -> Iterator[str]:
    """The first of a sequence, and how many there are."""
    yield from (_text(thing, depth) for thing in things[:_MEMBERS])
    if len(things) > _MEMBERS:
        yield f"... {len(things)} in all"


def _array(a: Any) -> str:
    """A vector of few numbers as these, any other array as its shape."""
    if a.ndim == 1 and a.size <= _NUMBERS and a.dtype.kind in "biuf":
        return f"[{', '.join(f'{v:.6g}' for v in a.tolist())}]"
    return f"shape ({', '.join(map(str, a.shape))}{',' if a.ndim == 1 else ''})"
