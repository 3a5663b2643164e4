"""Words and numbers of text files, with the lines they stand in.

Guarantees: numbers are finite, or a `FormatError` names path and line; memory is taken for what
the text holds, never by a count that it claims.
"""

import os
import re
from collections.abc import Iterator
from typing import NoReturn

import numpy as np

from ilattice._typing import FloatArray
from ilattice.errors import FormatError

_PIECE = 1 << 15  # tokens, or letters, that are taken apart at a time
_SPACE = re.compile(r"\s")
_INTEGER = re.compile(r"[+-]?[0-9]{1,18}")


class Scanner:
    """Tokens of a text file, one after the other, with their lines.

    Parameters
    ----------
    text : str
        The text; comments already blanked with their line ends kept.
    path : path-like
        Name of the file, for messages.
    tokens : str
        Regular expression of one token; what lies between the matches is skipped.
    """

    def __init__(self, text: str, path: str | os.PathLike[str], tokens: str = r"\S+") -> None:
        self._text = text
        self._path = path
        self._pattern = re.compile(tokens)
        kind = np.int32 if len(text) < 2**31 else np.int64
        self._starts = np.fromiter((m.start() for m in self._pattern.finditer(text)), kind)
        self.at = 0

    @property
    def left(self) -> int:
        """Number of tokens that are left."""
        return len(self._starts) - self.at

    @property
    def size(self) -> int:
        """Length of the text."""
        return len(self._text)

    def line(self, at: int | None = None) -> int:
        """Line of token number `at` (default: the next one), or of the end of the file."""
        at = self.at if at is None else at
        end = self._starts[at] if at < len(self._starts) else len(self._text)
        return self._text.count("\n", 0, end) + 1

    def fail(self, message: str, at: int | None = None) -> NoReturn:
        """Raise `FormatError` with path and line of token number `at` (default: the next one)."""
        raise FormatError(f"{self._path}, line {self.line(at)}: {message}")

    def peek(self, ahead: int = 0) -> str:
        """Look at the next token, or the one `ahead` of it, or "" at the end, and stay in place."""
        i = self.at + ahead
        return self._token(i) if i < len(self._starts) else ""

    def word(self, expected: str) -> str:
        """Take the next token."""
        if self.at >= len(self._starts):
            self.fail(f"the file ends; expected {expected}")
        self.at += 1
        return self._token(self.at - 1)

    def expect(self, *words: str) -> str:
        """Take the next token, which must be one of `words` (case matters)."""
        expected = " or ".join(repr(w) for w in words)
        found = self.word(expected)
        if found not in words:
            self.fail(f"found {found!r:.60}; expected {expected}", self.at - 1)
        return found

    def integer(self, what: str, lo: int = 0, hi: int = 10**18) -> int:
        """Take the next token as a whole number within [`lo`, `hi`]."""
        found = self.word(what)
        if not _INTEGER.fullmatch(found) or not lo <= int(found) <= hi:
            self.fail(
                f"found {found!r:.60}; expected {what}, a whole number from {lo}"
                + (f" to {hi}" if hi < 10**18 else ""),
                self.at - 1,
            )
        return int(found)

    def numbers(self, count: int, what: str) -> FloatArray:
        """Take the next `count` tokens as finite numbers, shape (count,)."""
        if count > self.left:
            self.fail(f"expected {count} {what}, the file holds only {self.left} more entries")
        values = np.empty(count)
        for i in range(0, count, _PIECE):
            tokens = self._tokens(self.at + i, self.at + min(i + _PIECE, count))
            told = f"; expected {what}, a finite number"
            values[i : i + len(tokens)] = self._parsed(tokens, self.at + i, told)
        self.at += count
        return values

    def rows(self, count: int, width: int, what: str) -> FloatArray:
        """Take the next `count` groups ``[ x1 .. x_width ]``, shape (count, width)."""
        step = width + 2
        if count * step > self.left:
            self.fail(
                f"expected {count} {what} of {width} numbers in brackets, "
                f"the file holds only {self.left} more entries"
            )
        values = np.empty((count, width))
        at_once = max(1, _PIECE // step)
        for i in range(0, count, at_once):
            part = values[i : i + at_once]
            self._fill(part, self.at + i * step, what)
        self.at += count * step
        return values

    def _fill(self, out: FloatArray, start: int, what: str) -> None:
        """Groups of numbers in brackets from token number `start` on."""
        count, step = len(out), out.shape[1] + 2
        block = self._tokens(start, start + count * step)
        for place, bracket in ((0, "["), (step - 1, "]")):
            column = block[place::step]
            if column.count(bracket) != count:
                row = next(i for i, t in enumerate(column) if t != bracket)
                at = start + row * step + place
                self.fail(f"found {self._token(at)!r:.60} in {what}; expected {bracket!r}", at)
        for i in range(count):
            first = start + i * step + 1
            told = f" in {what}; expected a finite number"
            out[i] = self._parsed(block[i * step + 1 : i * step + step - 1], first, told)

    def _token(self, i: int) -> str:
        """Token number `i`."""
        match = self._pattern.match(self._text, self._starts[i])
        return match[0] if match else ""

    def _tokens(self, first: int, last: int) -> list[str]:
        """Tokens from number `first` to before number `last`."""
        if first >= last:
            return []
        end = self._starts[last] if last < len(self._starts) else len(self._text)
        return self._pattern.findall(self._text, self._starts[first], end)

    def _parsed(self, tokens: list[str], at: int, told: str) -> FloatArray:
        """Finite numbers of tokens, the first of which is token number `at`."""
        values = parse_numbers(tokens)
        if isinstance(values, int):
            self.fail(f"found {tokens[values]!r:.60}{told}", at + values)
        return values


def pieces(text: str) -> Iterator[str]:
    """Parts of a text that are short, cut where there is white space."""
    at = 0
    while at < len(text):
        found = _SPACE.search(text, at + _PIECE)
        end = found.start() if found else len(text)
        yield text[at:end]
        at = end


def parse_text(text: str) -> tuple[FloatArray, str]:
    """Finite numbers of a text up to the first word that is none, and that word, or nothing."""
    parts = [np.empty(0)]
    for piece in pieces(text):
        tokens = piece.split()
        values = parse_numbers(tokens)
        if isinstance(values, int):
            good: FloatArray | int = values
            while isinstance(good, int):
                values, good = good, parse_numbers(tokens[:good])
            return np.concatenate([*parts, good]), tokens[values]
        parts.append(values)
    return np.concatenate(parts), ""


def parse_numbers(tokens: list[str]) -> FloatArray | int:
    """Finite float64 numbers of the tokens, or the index of the first that is not one."""
    try:
        values = np.fromiter(map(float, tokens), np.float64, len(tokens))
    except ValueError:
        return next(i for i, t in enumerate(tokens) if not _is_number(t))
    wrong = np.flatnonzero(~np.isfinite(values))
    if wrong.size:
        return int(wrong[0])
    if any("_" in t for t in tokens):
        return next(i for i, t in enumerate(tokens) if "_" in t)
    return values


def _is_number(token: str) -> bool:
    try:
        float(token)
    except ValueError:
        return False
    return True


def blank_comments(text: str, mark: str = "#") -> str:
    """Drop comments (from `mark` to the end of the line), keep the lines."""
    return re.sub(re.escape(mark) + r"[^\n]*", "", text) if mark in text else text
