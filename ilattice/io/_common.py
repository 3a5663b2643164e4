"""What every reader and writer shares: whole files in, whole files out, tokens with positions.

Guarantees: a writer replaces a file as a whole or not at all, also when it is interrupted or the
disk is full; a reader allocates at most 20 times the size of the file and 100 MB, never by a count
that the file claims; what cannot be read ends in a `FormatError` with the path and the line.
Only regular files are read, and never more than `LIMIT` bytes.
Not guaranteed: a killed process (SIGKILL, power cut) may leave a temporary file ``.*.tmp*`` beside
the untouched old file; the next save of the same name removes it.
"""

import errno
import json
import os
import re
import stat
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, NoReturn

import numpy as np

from ilattice._memory import need
from ilattice._typing import FloatArray
from ilattice.errors import FileError, FormatError, InputError

_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_AT_ONCE = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
#: Bytes of the largest file that is read.
LIMIT = 1 << 33
_PIECE = 1 << 15  # tokens, or letters, that are taken apart at a time
_SPACE = re.compile(r"\s")
_INTEGER = re.compile(r"[+-]?[0-9]{1,18}")


# --- paths ------------------------------------------------------------------------------------


def as_path(name: str, value: str | os.PathLike[str]) -> Path:
    """`value` as a path, or `InputError` that names the argument."""
    try:
        path = Path(value)
    except TypeError as e:
        raise InputError(f"{name} must be a file name, got {value!r:.80}") from e
    if not path.name or "\0" in str(path):
        raise FileError(f"{name} must name a file, got {str(path)!r:.80}")
    return path


def check_outputs(paths: Sequence[str | os.PathLike[str]]) -> None:
    """Refuse, before any work, to write where nothing can be written.

    Parameters
    ----------
    paths : sequence of path-like
        Files that will be written.

    Raises
    ------
    FileError
        Naming the first that is a directory, or whose directory is missing or read-only.
    """
    for path in paths:
        folder = _target(path).parent
        if not os.access(folder, os.W_OK):
            raise FileError(f"path {str(path)!r}: the directory is not writable")


def check_distinct(named: Mapping[str, Sequence[str | os.PathLike[str]]]) -> None:
    """Refuse, before any work, to write two things to one file, or over what is read.

    Parameters
    ----------
    named : mapping of str to sequence of path-like
        Paths by what they are for.

    Raises
    ------
    InputError
        Naming the first two that are the same file; devices may be.
    """
    seen: dict[str, str] = {}
    for name, paths in named.items():
        for path in paths:
            real = os.path.realpath(path)
            if real in seen and not (os.path.exists(real) and not os.path.isfile(real)):
                both = (
                    f"{seen[real]} and {name} name" if seen[real] != name else f"{name} names twice"
                )
                raise InputError(f"{both} the same file, {str(path)!r}; choose another")
            seen[real] = name


# --- writing ----------------------------------------------------------------------------------


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Provide a temporary name that becomes `path` when the block ends without an error.

    For writers that insist on a file name (VTK, lib3mf); it keeps the suffix of `path`. Devices
    and pipes (``/dev/stdout``) are written directly.

    Parameters
    ----------
    path : path-like
        The file to create or to replace. Symbolic links are followed.

    Yields
    ------
    Path
        Name of an existing, empty file in the same directory.

    Raises
    ------
    FileError
        If `path` is a directory, or its directory does not exist.
    FormatError
        If the file cannot be written: no permission, disk full.
    """
    target = _target(path)
    if target.exists() and not target.is_file():
        with explained(target):
            yield target
        return
    with explained(target), _temporary(target) as temporary:
        yield temporary
        _flush_to_disk(temporary)
        os.replace(temporary, target)


@contextmanager
def atomic_write(path: str | os.PathLike[str], *, text: bool = False) -> Iterator[IO[Any]]:
    r"""Open a file that becomes `path` when the block ends without an error.

    Parameters
    ----------
    path : path-like
        The file to create or to replace.
    text : bool
        Open as UTF-8 text with ``\n`` line ends instead of binary.

    Yields
    ------
    file
        Writable file object.

    Raises
    ------
    InputError, FormatError
        As `atomic_path`; whatever the block itself raises is passed on, `OSError` as `FormatError`.
    """
    with (
        atomic_path(path) as temporary,
        open(
            temporary,
            "w" if text else "wb",
            encoding="utf-8" if text else None,
            newline="\n" if text else None,
        ) as file,
    ):
        yield file


def write_report(path: str | os.PathLike[str], data: dict[str, Any]) -> None:
    """Write plain data as JSON, whole or not at all."""
    with atomic_write(path, text=True) as file:
        json.dump(data, file, indent=2)
        file.write("\n")


def _target(path: str | os.PathLike[str]) -> Path:
    """Resolve links to the file that will be written; refuse what cannot be one."""
    target = Path(os.path.realpath(as_path("path", path)))
    if target.is_dir():
        raise FileError(f"path {str(path)!r} is a directory; give the name of a file in it")
    if not target.parent.is_dir():
        raise FileError(f"path {str(path)!r}: there is no directory {str(target.parent)!r}")
    return target


@contextmanager
def _temporary(target: Path) -> Iterator[Path]:
    """Create an empty file beside `target` with the permissions that `target` has or would get.

    It is locked while the block runs. Those that are not belong to processes that were killed, and
    are removed first.
    """
    start, end = f".{target.stem[:40]}.tmp", target.suffix[:40]
    left = re.compile(re.escape(start) + "[a-z0-9_]{8}" + re.escape(end))
    for name in os.listdir(target.parent):
        if left.fullmatch(name):
            _remove_unlocked(target.parent / name)
    while True:
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=start, suffix=end)
        locked = _lock(handle, wait=True)
        if not locked:
            os.close(handle)
        if not locked or os.path.exists(name):  # not removed before it was locked
            break
        os.close(handle)
    try:
        _set_mode(target, name)
        yield Path(name)
    finally:
        with suppress(OSError):
            os.unlink(name)  # unless it has become the target
        if locked:
            os.close(handle)


def _lock(handle: int, *, wait: bool) -> bool:
    """Whether this process has the lock of an open file now; never where there are none."""
    try:
        import fcntl

        fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except (ImportError, OSError):
        return False
    return True


def _remove_unlocked(path: Path) -> None:
    """Remove a temporary file that no process is writing."""
    with suppress(OSError):
        handle = os.open(path, os.O_RDWR | _AT_ONCE)
        try:
            if _lock(handle, wait=False):
                path.unlink()
        finally:
            os.close(handle)


def _set_mode(target: Path, name: str) -> None:
    """Give a new file the permissions that `target` has or would get."""
    if target.exists():
        mode = stat.S_IMODE(target.stat().st_mode)
    else:
        mask = os.umask(0)
        os.umask(mask)
        mode = 0o666 & ~mask
    os.chmod(name, mode)


def _flush_to_disk(path: Path) -> None:
    """Wait until the file is on the disk, so that a full disk is noticed before the rename."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextmanager
def explained(target: Path, done: str = "written") -> Iterator[None]:
    """`OSError` as a `FormatError` that says what to do."""
    try:
        yield
    except OSError as e:
        reason = e.strerror or str(e)
        if e.errno in _FULL:
            raise FormatError(
                f"{target}: not written, the disk is full ({reason}); "
                "free some space or choose another directory"
            ) from e
        raise FormatError(f"{target}: cannot be {done} ({reason})") from e


# --- reading ----------------------------------------------------------------------------------


def read_bytes(path: str | os.PathLike[str], *, limit: int = LIMIT) -> bytes:
    """Read the whole file, if it is a regular one of at most `limit` bytes.

    Raises
    ------
    FormatError
        If there is no such regular file, it is larger, or it cannot be read.
    """
    source = as_path("path", path)
    try:
        handle = os.open(source, os.O_RDONLY | _AT_ONCE)  # a pipe must not be waited for
        try:
            if not stat.S_ISREG(os.fstat(handle).st_mode):
                raise FormatError(f"{source}: is not a regular file")
            size = os.fstat(handle).st_size
            if size <= limit:
                need(4 * size, f"{source}: reading {size} bytes", "close other programs")
                with open(handle, "rb", closefd=False) as file:
                    data = file.read(size + 1)
                if len(data) > size:
                    raise FormatError(f"{source}: grows while it is read")
        finally:
            os.close(handle)
    except OSError as e:
        raise FormatError(f"{source}: cannot be read ({e.strerror or e})") from e
    if size > limit:
        raise FormatError(f"{source}: has more than {limit} bytes; not read")
    return data


def read_text(path: str | os.PathLike[str]) -> str:
    """Read the whole file as text: UTF-8, or UTF-16 with a byte order mark, else Latin-1.

    Raises
    ------
    FormatError
        If the file cannot be read, or holds zero bytes (a binary file).
    """
    data = read_bytes(path)
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        text = data.decode("utf-16", errors="replace")
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("latin-1")
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise FormatError(f"{path}, line {line}: zero byte; expected a text file")
    return text


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
