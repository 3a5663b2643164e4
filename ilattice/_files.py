"""What every reader and writer shares: whole files in, whole files out.

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
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from ilattice._memory import need
from ilattice.errors import FileError, FormatError, InputError

_FULL = {errno.ENOSPC, errno.EDQUOT}
_AT_ONCE = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
#: Bytes of the largest file that is read.
LIMIT = 1 << 33


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
    and pipes are written directly; what a stream of this process (``/dev/stdout``) has been sent to
    is continued, never replaced.

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
    target, number = _target(path), _descriptor(path)
    if number is not None and target.is_file():
        with explained(target), _copied_to(number, target.suffix) as temporary:
            yield temporary
        return
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


def replace(made: Path, path: str | os.PathLike[str]) -> None:
    """Give a file that is on the disk its final name, and the permissions of the one before."""
    target = _target(path)
    with explained(target):
        _set_mode(target, str(made))
        os.replace(made, target)


def write_report(path: str | os.PathLike[str], data: dict[str, Any]) -> None:
    """Write plain data as JSON, whole or not at all."""
    with atomic_write(path, text=True) as file:
        json.dump(data, file, indent=2)
        file.write("\n")


def _target(path: str | os.PathLike[str]) -> Path:
    """Resolve links to the file that will be written; refuse what cannot be one."""
    target = Path(os.path.realpath(as_path("path", path)))
    try:
        folder = target.is_dir()
    except OSError as e:  # a name that is too long
        raise FileError(f"path {str(path)!r:.80}: cannot be written ({e.strerror or e})") from e
    if folder:
        raise FileError(f"path {str(path)!r} is a directory; give the name of a file in it")
    if not target.parent.is_dir():
        raise FileError(f"path {str(path)!r}: there is no directory {str(target.parent)!r}")
    return target


def _descriptor(path: str | os.PathLike[str]) -> int | None:
    """Number of the open file of this process that a path such as ``/dev/stdout`` stands for."""
    name = os.path.abspath(path)
    found = re.fullmatch(r"(?:/dev/fd|/proc/self/fd)/([0-9]{1,6})", name)
    return int(found[1]) if found else {"/dev/stdout": 1, "/dev/stderr": 2}.get(name)


@contextmanager
def _copied_to(number: int, suffix: str) -> Iterator[Path]:
    """Name of an empty file, of which the content is appended to an open one in the end."""
    with tempfile.TemporaryDirectory() as folder:
        temporary = Path(folder) / f"stream{suffix}"
        temporary.touch()
        yield temporary
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:  # as it is where it was closed
                stream.flush()
        with open(temporary, "rb") as file, open(os.dup(number), "ab") as out:
            shutil.copyfileobj(file, out)


@contextmanager
def _temporary(target: Path) -> Iterator[Path]:
    """Create an empty file beside `target` with the permissions that `target` has or would get.

    It is locked while the block runs. Those that are not belong to processes that were killed, and
    are removed first.
    """
    start, end = _hidden(target)
    mark = "[a-z0-9_]{8}"  # of files that were to become hidden ones there are two
    left = re.compile(rf"\.?{re.escape(start)}{mark}(?:\.tmp{mark})?{re.escape(end)}")
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


def _hidden(target: Path) -> tuple[str, str]:
    """How hidden names of a file begin and end, with eight letters in between."""
    return f".{target.stem[:40]}.tmp", target.suffix[:40]


def hidden_name(path: str | os.PathLike[str], mark: str) -> Path:
    """Name, with a mark of eight letters, for a file that is to become `path` by `replace`."""
    target = _target(path)
    start, end = _hidden(target)
    return target.with_name(f"{start}{mark}{end}")


@contextmanager
def held(path: Path) -> Iterator[None]:
    """Keep a hidden file, while the block runs, from being removed as one of a killed process."""
    handle = os.open(path, os.O_RDONLY)
    try:
        _lock(handle, wait=True)
        yield
    finally:
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
        if e.errno == errno.EFBIG:
            raise FormatError(
                f"{target}: not written, it is larger than files may be here ({reason}); raise the "
                "limit (ulimit -f), choose another directory, or write less"
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
