"""Words of a command: arguments of a process or of a text, with files named by ``@path`` inserted.

Guarantees: files may insert files, relative to themselves, up to `MAX_DEPTH` deep, never in a
circle; more than `MAX_WORDS` words, or `MAX_BYTES` bytes in all files, are refused.
"""

import os
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from ilattice._files import read_bytes
from ilattice.errors import FileError, FormatError, InputError

#: What a command may have: files within files, words, and bytes in all of them.
MAX_DEPTH = 16
MAX_WORDS = 100_000
MAX_BYTES = 2_000_000
_PER_FILE = 100  # bytes that a file counts for beside its own, so that empty ones end too


class Token(NamedTuple):
    """A word and where it stands; `file` is the one it was read from, or nothing."""

    text: str
    place: str
    file: str = ""

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
    for token in _expanded(words, "", Path(), (), [MAX_BYTES]):
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
    words: Sequence[str], source: str, folder: Path, above: tuple[Path, ...], left: list[int]
) -> Iterator[Token]:
    """The words with their places; `left` holds the bytes that files may still have."""
    for i, word in enumerate(words, 1):
        place = f"{source}word {i}"
        if not word.startswith("@"):
            yield Token(word, place, str(above[-1]) if above else "")
            continue
        path = folder / word[1:]
        name = f"{place} {word!r}"
        real = Path(os.path.realpath(path))
        if real in above:
            raise InputError(f"{name}: the file {str(path)!r:.80} inserts itself")
        if len(above) == MAX_DEPTH:
            raise InputError(f"{name}: {str(path)!r:.80} is more than {MAX_DEPTH} files deep")
        inner = _split(_text(path, name, left), str(path))
        yield from _expanded(inner, f"{path}: ", path.parent, (*above, real), left)


def _text(path: Path, name: str, left: list[int]) -> str:
    try:
        data = read_bytes(path, limit=left[0])
        left[0] = max(left[0] - len(data) - _PER_FILE, 0)
        return data.decode("utf-8")
    except FormatError as e:
        raise FileError(f"{name}: cannot read the file: {e}") from e
    except ValueError as e:
        raise InputError(f"{name}: cannot read the file {str(path)!r:.80}: it is not text") from e
