"""Words of a command: arguments of a process or of a text, with files named by ``@path`` inserted.

Guarantees: files may insert files, relative to themselves, up to `MAX_DEPTH` deep, never in a
circle; more than `MAX_WORDS` words are refused.
"""

import os
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from ilattice.errors import InputError

MAX_DEPTH = 16
MAX_WORDS = 100_000
MAX_BYTES = 10_000_000


class Token(NamedTuple):
    """A word and where it stands."""

    text: str
    place: str

    def __str__(self) -> str:
        """For messages."""
        text = self.text if len(self.text) <= 60 else self.text[:57] + "..."
        return f"{self.place} {text!r}"


def read(command: str | Sequence[str]) -> list[Token]:
    """Words of a command, files inserted.

    Parameters
    ----------
    command : str or sequence of str
        A text is split at white space, with quotes and comments as in a shell; of a sequence each
        item is one word.

    Returns
    -------
    list of Token
        The words.

    Raises
    ------
    InputError
        For quotes that do not close, files that cannot be read, circles, and too many words.
    """
    if isinstance(command, str):
        words = _split(command, "the command")
    elif isinstance(command, Sequence) and all(isinstance(w, str) for w in command):
        words = list(command)
    else:
        raise InputError(f"a command must be text or a sequence of words, got {command!r:.80}")
    out: list[Token] = []
    for token in _expanded(words, "", Path(), ()):
        if len(out) == MAX_WORDS:
            raise InputError(f"the command has more than {MAX_WORDS} words")
        out.append(token)
    return out


def _split(text: str, name: str) -> list[str]:
    try:
        return shlex.split(text, comments=True)
    except ValueError as e:
        raise InputError(f"{name}: {str(e).lower()}; close the quotes") from e


def _expanded(
    words: Sequence[str], source: str, folder: Path, above: tuple[Path, ...]
) -> Iterator[Token]:
    for i, word in enumerate(words, 1):
        place = f"{source}word {i}"
        if not word.startswith("@"):
            yield Token(word, place)
            continue
        path = folder / word[1:]
        name = f"{place} {word!r}"
        real = Path(os.path.realpath(path))
        if real in above:
            raise InputError(f"{name}: the file {str(path)!r} inserts itself")
        if len(above) == MAX_DEPTH:
            raise InputError(f"{name}: {str(path)!r} is more than {MAX_DEPTH} files deep")
        inner = _split(_text(path, name), str(path))
        yield from _expanded(inner, f"{path}: ", path.parent, (*above, real))


def _text(path: Path, name: str) -> str:
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(f"{name}: {str(path)!r} has more than {MAX_BYTES} bytes")
        return path.read_text(encoding="utf-8")
    except (OSError, ValueError) as e:
        reason = getattr(e, "strerror", None) or "it is not text"
        raise InputError(f"{name}: cannot read the file {str(path)!r}: {reason}") from e
