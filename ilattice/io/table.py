r"""Tables of sweeps: one line per run, appended and on the disk before the next run begins.

The format is CSV in UTF-8 with ``\n`` ends of lines. Its columns are the parameters of the sweep,
the results, and `KEPT`:

===========  ======================================================================
``file``     what the run has written, or nothing
``message``  why there is nothing
``command``  what was run, in one line: the words and the options that change results
``inputs``   digest of the files that were read, or nothing
``version``  of the library
``output``   digest of ``file``
===========  ======================================================================

Digests are the first 32 hexadecimal digits of SHA-256. Numbers have as many digits as are needed to
read the same numbers back. Where several rows have equal parameters and command, the last holds.

Guarantees: a line that is there stays as it is, whatever is run, and whenever a run is killed; a
line that a killed run has left unfinished is cut off. Files that are no such table, or one with
other columns, are refused and left alone. A sweep that was killed and is run again ends with the
bytes of one that was not. Several sweeps at a time may write to one table where the system has
``flock``. Not guaranteed: that somebody's editor keeps the format; lines that do not fit are
refused by their number.
"""

import csv
import errno
import hashlib
import io
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from ilattice.errors import FormatError
from ilattice.io._common import explained, read_bytes

__all__ = ["KEPT", "Table", "digest"]

#: Columns of every table, behind those of parameters and results.
KEPT = ("file", "message", "command", "inputs", "version", "output")
_DIGITS = 32
_BLOCK = 1 << 20


class Table:
    """The table of a sweep.

    Parameters
    ----------
    path : path-like
        The file; it need not exist.
    parameters, results : sequence of str
        Names of the columns.

    Raises
    ------
    FormatError
        If there is a file that is no table with these columns.
    """

    def __init__(
        self, path: str | os.PathLike[str], parameters: Sequence[str], results: Sequence[str]
    ) -> None:
        self.path = Path(path)
        self.parameters = tuple(parameters)
        self.columns = (*parameters, *results, *KEPT)
        self._rows: dict[tuple[str, ...], dict[str, str]] = {}
        self._read()

    def find(
        self, values: Mapping[str, str], command: str, inputs: str, version: str
    ) -> dict[str, str] | None:
        """The row of a run that need not be repeated.

        Parameters
        ----------
        values : mapping of str to str
            The parameters.
        command, inputs, version : str
            As in the columns of these names.

        Returns
        -------
        dict or None
            The row, as text; None if there is none, if its inputs or its version are others, or if
            its file is not the one that was written.
        """
        row = self._rows.get(self._key({**values, "command": one_line(command)}))
        if row is None or not row["file"] or (row["inputs"], row["version"]) != (inputs, version):
            return None
        with suppress(FormatError):
            return row if digest(row["file"]) == row["output"] else None
        return None

    def append(self, row: Mapping[str, Any]) -> None:
        """Add a row, unless the last one of its parameters and command is the same.

        Parameters
        ----------
        row : mapping of str to object
            Values of the columns; those that are not there stay empty.

        Raises
        ------
        FormatError
            If it cannot be written.
        """
        line = _line([row.get(name, "") for name in self.columns])
        found = self._parsed(line)
        if self._rows.get(self._key(found)) == found:
            return
        with explained(self.path), self._locked() as file:
            start = file.seek(0, os.SEEK_END)
            head = b"" if start else _line(self.columns).encode()
            _write(file, start, head + line.encode())
        if not start:
            _keep_name(self.path)
        self._rows[self._key(found)] = found

    # ------------------------------------------------------------------ inside

    def _key(self, row: Mapping[str, str]) -> tuple[str, ...]:
        return (*(one_line(row[name]) for name in self.parameters), row["command"])

    def _parsed(self, line: str) -> dict[str, str]:
        return dict(zip(self.columns, next(csv.reader([line])), strict=True))

    def _read(self) -> None:
        """The rows that are there; what a killed run has left of a line is cut off."""
        if not self.path.exists():
            return
        with explained(self.path), self._locked() as file:
            whole = self._checked(read_bytes(self.path))
            file.truncate(whole)

    def _checked(self, data: bytes) -> int:
        """Take the rows in; the number of bytes that are whole lines."""
        head = _line(self.columns).encode()
        if not data.startswith(head):
            if head.startswith(data):
                return 0
            raise FormatError(
                f"table {str(self.path)!r} is not one of this sweep, whose columns are "
                f"{','.join(self.columns)}; it is left as it is: name another file, or move it away"
            )
        whole = data.rfind(b"\n") + 1
        lines = data[len(head) : whole].split(b"\n")[:-1]
        for number, line in enumerate(lines, 2):
            try:
                row = self._parsed(line.decode())
            except (ValueError, csv.Error, StopIteration) as e:
                raise FormatError(
                    f"table {str(self.path)!r}, line {number}: is no row of {len(self.columns)} "
                    "columns; mend the line, name another file, or move it away"
                ) from e
            self._rows[self._key(row)] = row
        return whole

    @contextmanager
    def _locked(self) -> Iterator[IO[bytes]]:
        """The file, made if need be, while no other sweep writes to it."""
        handle = os.open(self.path, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666)
        with open(handle, "r+b", buffering=0) as file:
            with suppress(ImportError):
                from fcntl import LOCK_EX, flock

                flock(handle, LOCK_EX)
            yield file


def digest(*paths: str | os.PathLike[str]) -> str:
    """Digest of what files hold, in this order; nothing for no files.

    Parameters
    ----------
    *paths : path-like
        Regular files.

    Returns
    -------
    str
        Hexadecimal digits.

    Raises
    ------
    FormatError
        If a file cannot be read.
    """
    if not paths:
        return ""
    total = hashlib.sha256()
    for path in paths:
        if not os.path.isfile(path):
            raise FormatError(f"{path}: there is no such file")
        own = hashlib.sha256()
        with explained(Path(path), "read"), open(path, "rb") as file:
            while block := file.read(_BLOCK):
                own.update(block)
        total.update(own.digest())
    return total.hexdigest()[:_DIGITS]


def one_line(text: str) -> str:
    """A text without ends of lines and other control characters."""
    return text if text.isprintable() else "".join(map(_plain, text))


def _plain(letter: str) -> str:
    return letter if letter.isprintable() else letter.encode("unicode_escape").decode("ascii")


def _line(values: Sequence[Any]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow([one_line(str(v)) for v in values])
    return text.getvalue()


def _write(file: IO[bytes], start: int, data: bytes) -> None:
    """Append whole lines and wait until they are on the disk, or leave the file as it was."""
    try:
        if file.write(data) != len(data):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        os.fsync(file.fileno())
    except BaseException:
        file.truncate(start)
        raise


def _keep_name(path: Path) -> None:
    """Put the name of a new file on the disk, where the system can."""
    with suppress(OSError):
        handle = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
