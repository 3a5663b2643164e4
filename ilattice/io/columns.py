"""Columns of numbers from text files: points with a thickness, a temperature, a stress.

Guarantees: what cannot be read is refused with the number of the line, what is missing with the
names that are there; no value is guessed. Not guaranteed: decimal commas.
"""

import csv
import io
import os
from collections.abc import Sequence

import numpy as np

from ilattice._files import as_path, read_bytes
from ilattice._typing import FloatArray
from ilattice._validate import as_items
from ilattice.errors import FormatError, InputError, printable

DELIMITERS = ",;\t"
SHOWN = 3  # bad lines that a message names


def read_columns(
    path: str | os.PathLike[str], names: Sequence[str] = ("x", "y", "z")
) -> FloatArray:
    r"""Columns of a CSV file with a line of names.

    Parameters
    ----------
    path : path-like
        Text in UTF-8; fields are parted by commas, semicolons or tabs. Lines that are empty or
        begin with # are left out.
    names : sequence of str
        Columns that are wanted, in this order; letters may be of either case.

    Returns
    -------
    ndarray, shape (n, len(names))
        Their numbers.

    Raises
    ------
    InputError
        If no name is asked for.
    FormatError
        If a column is missing or there twice, or numbers are missing, not numbers or not finite:
        the message names the first lines.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "d.csv"
    >>> _ = file.write_text("x,y,z,d\n0,0,0,0.5\n1,0,0,0.7\n")
    >>> read_columns(file, ("d", "x"))
    array([[0.5, 0. ],
           [0.7, 1. ]])
    """
    wanted = [str(n).strip() for n in as_items("names", names)]
    if not wanted or isinstance(names, str):
        raise InputError(f"names must be a sequence of names of columns, got {names!r:.80}")
    file = as_path("path", path)
    try:
        text = read_bytes(file).decode("utf-8-sig")
    except UnicodeDecodeError as e:
        raise FormatError(f"{printable(str(path))} is not text in UTF-8: {e.reason}") from e
    numbered = [(i, line) for i, line in enumerate(io.StringIO(text), 1) if line.strip()]
    numbered = [(i, line) for i, line in numbered if not line.lstrip().startswith("#")]
    if len(numbered) < 2:
        raise FormatError(f"{printable(str(path))} has no line of names and lines of numbers")
    head = numbered[0][1]
    delimiter = max(DELIMITERS, key=head.count)
    try:
        rows = [next(csv.reader([line], delimiter=delimiter)) for _, line in numbered]
    except csv.Error as e:
        raise FormatError(f"{printable(str(path))} is no CSV: {e}") from e
    places = _places([n.strip().lower() for n in rows[0]], wanted, path)
    return _numbers(rows[1:], [i for i, _ in numbered[1:]], places, wanted, len(rows[0]), path)


def _places(head: list[str], wanted: list[str], path: object) -> list[int]:
    """Where the wanted columns are."""
    out = []
    for name in wanted:
        found = [i for i, n in enumerate(head) if n == name.lower()]
        if len(found) != 1:
            what = "no column" if not found else f"{len(found)} columns"
            raise FormatError(
                f"{printable(str(path))} has {what} {name!r}: its columns are "
                f"{printable(', '.join(head))[:200]}"
            )
        out.append(found[0])
    return out


def _numbers(
    rows: list[list[str]], lines: list[int], places: list[int], wanted: list[str], columns: int,
    path: object,
) -> FloatArray:  # fmt: skip
    """The numbers of the rows, or the lines in which there are none."""
    out, bad = np.full((len(rows), len(places)), np.nan), []
    for i, (row, line) in enumerate(zip(rows, lines, strict=True)):
        if any(field.strip() for field in row[columns:]):
            bad.append(f"line {line}: {len(row)} fields for {columns} names")
            continue
        for j, (at, name) in enumerate(zip(places, wanted, strict=True)):
            said = row[at].strip() if at < len(row) else ""
            try:
                out[i, j] = float(said.replace("_", "?"))
            except ValueError:
                out[i, j] = np.nan
            if not np.isfinite(out[i, j]):
                bad.append(f"line {line}: {name} is {printable(said)[:30] or 'missing'}")
    if bad:
        more = f" and {len(bad) - SHOWN} more" if len(bad) > SHOWN else ""
        raise FormatError(
            f"{printable(str(path))} lacks numbers: {'; '.join(bad[:SHOWN])}{more}; drop these "
            "lines or mend them"
        )
    return out
