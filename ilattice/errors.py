"""The errors that `ilattice` raises on purpose.

::

    IlatticeError
    ├── InputError (ValueError)   an argument is wrong: which one, its value, the remedy
    │   └── GraphError            a node of a procedural graph breaks a rule: which node, which rule
    ├── GeometryError             the input is well-formed, but its geometry cannot be used
    ├── ConvergenceError          a numerical method failed on more than the stated fraction
    └── FormatError               a file cannot be read or written as the named format
        └── FileError             an argument names a file that cannot be (an InputError, too)

Guarantee: bad input ends in one of these, before anything on disk is touched. A message is one
line of at most `LONGEST` characters, and shows numbers as numbers, whatever their type.
"""

import re

#: Characters of the longest message; of longer ones the middle is left out.
LONGEST = 1000
#: Numbers of NumPy, but for those in quotes: these are what somebody wrote.
_NUMPY = re.compile(r"('[^']*')|\bnp\.(?:float|int|uint|bool|str)[0-9_]*\(([^()]*)\)")
_BREAK = re.compile(r"\s*\n\s*")


class IlatticeError(Exception):
    """Base class of every error raised on purpose."""

    def __init__(self, message: str = "") -> None:
        super().__init__(shortened(str(message)))


class InputError(IlatticeError, ValueError):
    """An argument is wrong; the message names it, its value and the remedy."""


class GraphError(InputError):
    """A node of a procedural graph breaks a rule; the message names both.

    Attributes
    ----------
    node : str
        Type of the node, and its name where it has one.
    rule : str
        What is required, what there is, and the remedy.
    """

    def __init__(self, node: str, rule: str = "") -> None:
        self.node, self.rule = shortened(str(node)), shortened(str(rule))
        super().__init__(f"{node}: {rule}" if rule else node)

    def __reduce__(self) -> tuple[type, tuple[str, str]]:
        return type(self), (self.node, self.rule)


class GeometryError(IlatticeError):
    """The input is well-formed, but its geometry cannot be used (folded map, no zero set)."""


class ConvergenceError(IlatticeError):
    """A numerical method failed on more points than the stated fraction."""


class FormatError(IlatticeError):
    """A file cannot be read or written as the named format."""


class FileError(FormatError, InputError):
    """An argument names a file that is missing, or cannot be made; caught as either base."""


class PrecisionWarning(UserWarning):
    """The result is usable, but less accurate or less complete than asked."""


def shortened(message: str) -> str:
    """A message of bounded length.

    Parameters
    ----------
    message : str
        Any text.

    Returns
    -------
    str
        The text in one line, with the middle left out if it is long.
    """
    return _short(printable(_BREAK.sub(" ", message)))


def printable(text: str) -> str:
    """A text with its control characters as their codes, so that none acts on a terminal.

    Parameters
    ----------
    text : str
        Any text.

    Returns
    -------
    str
        What can be printed, in one line.
    """
    return text if text.isprintable() else "".join(map(_plain, text))


def _plain(letter: str) -> str:
    return letter if letter.isprintable() else letter.encode("unicode_escape").decode("ascii")


def _short(line: str) -> str:
    if "np." in line:
        line = _NUMPY.sub(lambda m: m[1] or m[2] or "", line)
    if len(line) > LONGEST:
        line = f"{line[: LONGEST * 2 // 3]} ... {line[-LONGEST // 4 :]}"
    return line
