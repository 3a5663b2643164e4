r"""Tables of sweeps: one line per run, appended and on the disk before the next run begins.

The format is CSV in UTF-8 with ``\n`` ends of lines. Its columns are the parameters of the sweep,
the results, and `KEPT`:

===========  ======================================================================
``file``     what the run has written, seen from the folder of the table, or nothing
``message``  why there is nothing
``command``  what was run, in one line: the words and the options that change results
``inputs``   digest of the files that were read, or nothing
``version``  of the library
``output``   digest of ``file``
===========  ======================================================================

Digests are the first 32 hexadecimal digits of SHA-256 of a file; several are joined by ``-``.
Numbers have as many digits as are needed to read the same numbers back. Parameters and command are
the key of a row: a run that is made anew, for it had failed, or because its inputs, the library or
its file have changed, is appended; when the sweep ends it takes the place of the old row. Until
then the last of equal keys holds.

Guarantees: while a sweep runs no line is changed, whenever it is killed; a line that a killed run
has left unfinished is cut off when the next one is appended, and a whole row that has lost its end
of line gets it back. Rows of other keys stay for ever. Files that are no such table, or
one with other columns, are refused and left alone. What a run writes has a hidden name until its
row is on the disk, so that every file that is there has a row; files that are there and have none
in this table are not written over. A sweep that was killed and is run again ends
with the bytes of one that was not. One sweep at a time writes to a table: a second one is refused
where the system has ``flock`` (not on Windows, nor on some network disks).
Not guaranteed: that somebody's editor keeps the format; lines that do not fit are refused by their
number. That `file` is still the one of the row: other commands may have written it since, `output`
tells.
"""

import csv
import errno
import hashlib
import io
import os
import stat
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, NoReturn

from ilattice._files import (
    atomic_write,
    explained,
    held,
    hidden_name,
    read_bytes,
    replace,
)
from ilattice.errors import FileError, FormatError, printable

__all__ = ["KEPT", "Table", "digest"]

#: Columns of every table, behind those of parameters and results.
KEPT = ("file", "message", "command", "inputs", "version", "output")
_DIGITS = 32
_MARK = b"\xef\xbb\xbf"


class Table:
    """The table of a sweep, open for writing; a context manager.

    Parameters
    ----------
    path : path-like
        The file; it need not exist.
    parameters, results : sequence of str
        Names of the columns.

    Raises
    ------
    FormatError
        If there is a file that is no table with these columns, or another sweep writes to it.
    """

    def __init__(
        self, path: str | os.PathLike[str], parameters: Sequence[str], results: Sequence[str]
    ) -> None:
        self.path = Path(path)
        self.parameters = tuple(parameters)
        self.columns = (*parameters, *results, *KEPT)
        self._rows: dict[tuple[str, ...], dict[str, str]] = {}
        self._owners: dict[str, dict[str, str]] = {}
        self._folder = os.path.dirname(os.path.realpath(self.path))
        self._replaced = False
        self._ended = True  # whether the last row has its end of line
        with explained(self.path):
            self._file, self._made = _locked(self.path)
            try:
                self._end = self._checked(read_bytes(self.path))
            except BaseException:
                self._leave()
                raise

    def __enter__(self) -> "Table":
        """The table itself."""
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        """Put rows that were made anew in the places of the old ones, and let others write."""
        try:
            if kind is None and not self._ended:
                with explained(self.path):
                    self._write(b"")
            if kind is None and self._end:
                self._settle()
        finally:
            self._leave()

    def find(
        self, path: str | None, values: Mapping[str, str], command: str, inputs: str, version: str
    ) -> dict[str, str] | None:
        """The row of a run that need not be repeated.

        Parameters
        ----------
        path : str or None
            The file that the run writes; None for runs that write none.
        values : mapping of str to str
            The parameters.
        command, inputs, version : str
            As in the columns of these names.

        Returns
        -------
        dict or None
            The row, as text; None if there is none, if it has failed, if its file, its inputs or
            its version are others, or if its file is not the one that was written.
        """
        row = self._rows.get(self._key({**values, "command": _written(command)}))
        if row is None or (row["inputs"], row["version"]) != (inputs, version):
            return None
        if path is None:
            return None if row["message"] or row["file"] else row
        if not row["file"]:
            return None
        if self._place(row["file"]) != _real(path):
            return None
        with suppress(FormatError):
            return row if digest(path) == row["output"] else None
        return None

    def check_files(self, runs: Mapping[str, Mapping[str, str]], command: str) -> None:
        """Refuse to write over files that the rows of these runs have not written.

        Parameters
        ----------
        runs : mapping of str to mapping of str to str
            The parameters of runs, by the file that each will write.
        command : str
            As in the column of this name.

        Raises
        ------
        FileError
            Naming the first file that is there, and whose it is.
        """
        for path, values in runs.items():
            own = self._rows.get(self._key({**values, "command": _written(command)}))
            row = self._owners.get(_real(path))
            # of a run that has failed nobody knows the file: it may be of an earlier success
            mine = row is own if row else own is not None and not own["file"]
            if mine or not os.path.exists(path):
                continue
            whose = (
                f"is the file of another row of {str(self.path)!r}, {row['command']!r:.200}, and "
                "would be lost; choose another -o"
                if row
                else f"is there, and of no row of {str(self.path)!r}; move it away, choose another "
                "-o, or give the --table that has it"
            )
            raise FileError(f"-o: {str(path)!r} {whose}")

    @contextmanager
    def aside(self, path: str | os.PathLike[str]) -> Iterator[Path]:
        """Provide the hidden name under which a run writes, until `add` gives it the final one.

        Parameters
        ----------
        path : path-like
            The file of the run.

        Yields
        ------
        Path
            A name in the same directory with the same suffix, and the same whenever the run is
            repeated. What is there at the end of the block is removed; what a killed process has
            left, by the next save of that file.
        """
        mark = hashlib.sha256(os.fsencode(os.path.realpath(self.path))).hexdigest()
        hidden = hidden_name(path, mark[:8])
        try:
            yield hidden
        finally:
            with suppress(OSError):
                hidden.unlink()

    def add(self, row: Mapping[str, Any], made: Path) -> dict[str, Any]:
        """Add the row of a run, and give what it has written the name that the row has.

        Parameters
        ----------
        row : mapping of str to object
            As in `append`; of a run that has failed `file` is empty.
        made : Path
            What the run has written, see `aside`.

        Returns
        -------
        dict
            The row with the digest of the file.

        Raises
        ------
        FormatError
            If it cannot be written, or another program has written that file in the meantime.
        """
        if not row["file"]:
            whole = {**row, "output": ""}
            self.append(whole)
            return whole
        with explained(made), held(made):
            whole = {**row, "output": digest(made)}
            self.check_files({row["file"]: row}, row["command"])
            self.append(whole)
            replace(made, row["file"])
        return whole

    def append(self, row: Mapping[str, Any]) -> None:
        """Add a row, unless the one of its parameters and command is the same.

        Parameters
        ----------
        row : mapping of str to object
            Values of the columns; those that are not there stay empty.

        Raises
        ------
        FormatError
            If it cannot be written.
        """
        row = {**row, "file": self._seen(row.get("file", ""))}
        line = _line([row.get(name, "") for name in self.columns])
        found = self._parsed(line)
        if self._rows.get(self._key(found)) == found:
            return
        fresh = not self._end
        with explained(self.path):
            self._write((_line(self.columns) if fresh else "").encode() + line.encode())
        if fresh:
            _keep_name(self.path)
        self._take(found)

    # ------------------------------------------------------------------ inside

    def _leave(self) -> None:
        """Let others write; a file in which nothing has been written is none."""
        if self._made and not self._file.seek(0, os.SEEK_END):
            self.path.unlink(missing_ok=True)
        self._file.close()

    def _seen(self, path: str) -> str:
        """How a row names a file: as it is seen from the folder of the table."""
        if not path or os.path.isabs(path):
            return path
        folder, name = os.path.split(path)
        with suppress(ValueError):  # on another drive
            seen = os.path.relpath(os.path.realpath(folder), self._folder)
            return os.path.normpath(os.path.join(seen, name))
        return os.path.abspath(path)

    def _place(self, file: str) -> str:
        """Where the file of a row is."""
        return _real(os.path.join(self._folder, file))

    def _write(self, data: bytes) -> None:
        """Append whole lines behind the last one and wait until they are on the disk, or none."""
        data = (b"" if self._ended else b"\n") + data
        try:
            self._file.truncate(self._end)
            self._file.seek(self._end)
            left = memoryview(data)
            while left:  # what is written in parts ends in the error of the next part
                left = left[self._file.write(left) :]
            os.fsync(self._file.fileno())
        except BaseException:
            self._file.truncate(self._end)
            raise
        self._end += len(data)
        self._ended = True

    def _key(self, row: Mapping[str, str]) -> tuple[str, ...]:
        return (*(_written(row[name]) for name in self.parameters), row["command"])

    def _take(self, row: dict[str, str]) -> None:
        """Let a row hold, in the place of an older one of its key."""
        key = self._key(row)
        before = self._rows.get(key)
        if before:
            self._replaced = True
            if before["file"]:
                self._owners.pop(self._place(before["file"]), None)
        self._rows[key] = row
        if row["file"]:
            self._owners[self._place(row["file"])] = row

    def _parsed(self, line: str) -> dict[str, str]:
        return dict(zip(self.columns, next(csv.reader([line])), strict=True))

    def _settle(self) -> None:
        """Write the table anew, as a whole or not at all, if a row has been made anew."""
        if not self._replaced:
            return
        with atomic_write(self.path) as file:
            file.write(_line(self.columns).encode())
            for row in self._rows.values():
                file.write(_line(list(row.values())).encode())

    def _checked(self, data: bytes) -> int:
        """Take the rows in; the number of bytes that are whole rows."""
        head = _line(self.columns).encode()
        if not data.startswith(head):
            if head.startswith(data):
                return 0
            self._refuse(data, head)
        *lines, tail = data[len(head) :].split(b"\n")
        for number, line in enumerate(lines, 2):
            try:
                row = self._parsed(line.decode())
            except (ValueError, csv.Error, StopIteration) as e:
                raise FormatError(
                    f"table {str(self.path)!r}, line {number}: is no row of {len(self.columns)} "
                    "columns; mend the line, name another file, or move it away"
                ) from e
            self._take(row)
        with suppress(ValueError, csv.Error, StopIteration):
            row = self._parsed(tail.decode())
            if not row["file"] or len(row["output"]) == _DIGITS:  # nothing is missing at the end
                self._take(row)
                self._ended = False
                return len(data)
        return len(data) - len(tail)

    def _refuse(self, data: bytes, head: bytes) -> NoReturn:
        """Say why a file is not the table of this sweep."""
        plain = data[len(_MARK) :] if data.startswith(_MARK) else data
        first = plain[: len(head) + 1].replace(b"\r\n", b"\n")
        if first.startswith(head):
            raise FormatError(
                f"table {str(self.path)!r} has been saved with a byte order mark or with Windows "
                "ends of lines (CRLF); it is left as it is: save it as plain UTF-8 with ends of "
                "lines LF, or name another file"
            )
        raise FormatError(
            f"table {str(self.path)!r} is not one of this sweep, whose columns are "
            f"{','.join(self.columns)}; it is left as it is: name another file, or move it away"
        )


def _locked(path: Path) -> tuple[IO[bytes], bool]:
    """A file that no other sweep writes to, and whether it had to be made."""
    flags = os.O_RDWR | getattr(os, "O_BINARY", 0)
    while True:
        try:
            handle, made = os.open(path, flags), False
        except FileNotFoundError:
            handle, made = os.open(path, flags | os.O_CREAT, 0o666), True
        file = open(handle, "r+b", buffering=0)  # noqa: SIM115
        try:
            if not stat.S_ISREG(os.fstat(handle).st_mode):
                raise FormatError(f"table {str(path)!r}: is not a regular file; name another one")
            _lock(handle, path)
            if os.path.samestat(os.fstat(handle), os.stat(path)):
                return file, made
        except FileNotFoundError:
            pass  # removed in between
        except BaseException:
            file.close()
            raise
        file.close()  # replaced in between


def _lock(handle: int, path: Path) -> None:
    """Lock an open file, where the system can, or refuse."""
    try:
        from fcntl import LOCK_EX, LOCK_NB, flock

        flock(handle, LOCK_EX | LOCK_NB)
    except ImportError:
        return
    except OSError as e:
        if e.errno in (errno.EWOULDBLOCK, errno.EACCES):
            raise FormatError(
                f"table {str(path)!r}: another sweep is writing to it; wait for it, or give "
                "another --table"
            ) from e


def digest(path: str | os.PathLike[str]) -> str:
    """Digest of what a file holds.

    Parameters
    ----------
    path : path-like
        A regular file.

    Returns
    -------
    str
        The first 32 hexadecimal digits of SHA-256.

    Raises
    ------
    FormatError
        If the file cannot be read.
    """
    if not os.path.isfile(path):
        there = "is not a regular file" if os.path.exists(path) else "there is no such file"
        raise FormatError(f"{path}: {there}")
    with explained(Path(path), "read"), open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:_DIGITS]


def _real(path: str | os.PathLike[str]) -> str:
    """Where a file is, with the letters that a table has for it."""
    name = os.fspath(path)
    with suppress(UnicodeEncodeError):  # of a table, whose letters may be none of this locale
        name = os.fsdecode(name.encode("utf-8", "surrogateescape"))
    return _written(os.path.realpath(name))


def _written(text: str) -> str:
    """A text as it stands in tables: in one line, and the same in every locale."""
    with suppress(UnicodeEncodeError):  # names in UTF-8 that this process does not know as such
        text = text.encode("utf-8", "surrogateescape").decode("utf-8", "surrogateescape")
    return printable(text)


def _line(values: Sequence[Any]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow([_written(str(v)) for v in values])
    return text.getvalue()


def _keep_name(path: Path) -> None:
    """Put the name of a new file on the disk, where the system can."""
    with suppress(OSError):
        handle = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
