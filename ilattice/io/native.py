"""Native spline files: ``.npz`` for size, ``.json`` for reading by eye; one spline each.

Guarantees: everything of a `BSpline` comes back bit by bit, also periodic directions, scalar
splines and the names of extra coordinates. Nothing is ever unpickled; members are expanded no
further than they claim, and claims are checked against the size of the file.
Non-guarantee: a compressed ``.npz`` that expands more than `EXPANSION` times, to more than 16 MB,
is refused; so are members that are neither stored nor deflated.

Keys of both: ``format`` ("ilattice spline"), ``version`` (1), ``index_order``, ``degrees``,
``periodic``, ``control_points`` of shape (n0[, n1[, n2]][, m]), ``weights`` of shape
(n0[, n1[, n2]]) where there are any, ``names``; knots in ``knot_vectors`` (JSON) or
``knot_vector_0``, ``knot_vector_1``, ... (npz).
"""

import io
import itertools
import json
import math
import os
import re
import struct
import zipfile
import zlib
from collections.abc import Mapping
from typing import Any, NoReturn

import numpy as np

from ilattice._files import atomic_write, read_bytes, read_text
from ilattice._typing import AnyArray, FloatArray
from ilattice.bspline import BSpline
from ilattice.errors import FormatError
from ilattice.io._patches import (
    Fail,
    Patch,
    check_size,
    check_spans,
    check_weights,
    checked,
    numbered,
)

FORMAT = "ilattice spline"
#: Version of the format.
VERSION = 1
INDEX_ORDER = "uvw, last fastest"
#: Ratio to which an archive may expand, bytes it always may, members, and levels of lists.
EXPANSION = 5
_SMALL = 1 << 24
_MEMBERS = 32
_AXES = 4
_FEW, _PER_LIST = 100_000, 7  # lists that JSON may hold, and letters for each of more
_DEEP = 100  # brackets
_WORD = re.compile("-?(?:NaN|Infinity)")
_POINTS = "control_points"
_ABOUT = {"knot": "knot_vectors", "t ": "knot_vectors", "t[": "knot_vectors", "k ": "degrees",
          "k[": "degrees", "weights": "weights", "periodic": "periodic"}  # fmt: skip
_HEADER = re.compile(
    rb"\{'descr': '([<>|=]?(?:f[248]|[iu][1248]|b1|U[0-9]{1,4}))', 'fortran_order': (True|False), "
    rb"'shape': \(((?:[0-9]{1,15}(?:, ?|(?=\))))*)\),? *\}\s*"
)


# --- reading ----------------------------------------------------------------------------------


def read_npz(path: str | os.PathLike[str]) -> tuple[list[Patch], list[str]]:
    """The spline of a native ``.npz`` file.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    list of Patch
        One patch.
    list of str
        Empty.

    Raises
    ------
    FormatError
        If the file is damaged, or no native spline.
    """
    data = read_bytes(path)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = archive.infolist()
            room = max(EXPANSION * len(data), _SMALL)
            if len(members) > _MEMBERS or sum(m.file_size for m in members) > room:
                raise FormatError(
                    f"{path}: expands more than {EXPANSION} times, or has more than {_MEMBERS} "
                    "members; not read"
                )
            arrays = {
                m.filename.removesuffix(".npy"): _array(path, m, _member(path, archive, m), room)
                for m in members
            }
    except (
        zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, OSError,
        ValueError, OverflowError, KeyError, struct.error,
    ) as e:  # fmt: skip
        raise FormatError(f"{path}: no whole npz archive ({e})") from e
    knots = {k: a for k, a in arrays.items() if k.startswith("knot_vector_")}
    content: dict[str, Any] = {k: a for k, a in arrays.items() if k not in knots}
    content["knot_vectors"] = [knots[k] for k in sorted(knots)]
    for key in {"format", "version", "index_order", "degrees", "periodic", "names"} & set(content):
        try:
            content[key] = content[key].tolist()
        except ValueError as e:
            raise FormatError(f"{path}, entry {key!r}: no text ({e})") from e
    return _patches(path, content)


def _member(
    path: str | os.PathLike[str], archive: zipfile.ZipFile, member: zipfile.ZipInfo
) -> bytes:
    """Bytes of one member, expanded no further than it claims."""
    name = member.filename
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise FormatError(f"{path}, entry {name!r:.60}: is neither stored nor deflated; not read")
    with archive.open(member) as file:
        data = file.read(member.file_size + 1)
    if len(data) != member.file_size:
        raise FormatError(f"{path}, entry {name!r:.60}: is not of the size that it claims")
    return data


def _array(
    path: str | os.PathLike[str], member: zipfile.ZipInfo, data: bytes, room: int
) -> AnyArray:
    """One member of the archive; the size in its header must be the size that is there."""
    name = member.filename
    width = 2 if data[6:7] == b"\1" else 4
    start = 8 + width + int.from_bytes(data[8 : 8 + width], "little")
    header = _HEADER.fullmatch(data[8 + width : min(start, 4096)])
    if not data.startswith(b"\x93NUMPY") or not header:
        raise FormatError(f"{path}, entry {name!r:.60}: no array of numbers or text")
    dtype = np.dtype(header[1].decode())
    shape = tuple(int(n) for n in re.findall(rb"[0-9]+", header[3]))
    if not dtype.itemsize or math.prod(shape) * dtype.itemsize != len(data) - start:
        raise FormatError(
            f"{path}, entry {name!r:.60}: shape {shape} does not fit {len(data) - start} bytes"
        )
    a = np.frombuffer(data, dtype, offset=start)
    if dtype.kind != "U" and 8 * a.size > room:
        raise FormatError(f"{path}, entry {name!r:.60}: expands more than {EXPANSION} times")
    return a.reshape(shape[::-1]).T if header[2] == b"True" else a.reshape(shape)


def read_json(path: str | os.PathLike[str]) -> tuple[list[Patch], list[str]]:
    """The spline of a native ``.json`` file.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    list of Patch
        One patch.
    list of str
        Empty.

    Raises
    ------
    FormatError
        If the file is damaged, or no native spline.
    """
    text = read_text(path)
    if _PER_LIST * (text.count("[") + 3 * text.count("{") - _FEW) > len(text):
        raise FormatError(f"{path}: holds more lists than numbers; not read")
    try:
        content = json.loads(text, parse_constant=_no_constant)
    except json.JSONDecodeError as e:
        raise FormatError(f"{path}, line {e.lineno}: no JSON ({e.msg})") from e
    except (ValueError, RecursionError) as e:
        word = _WORD.search(str(e))
        place = _place(text, re.escape(word[0])) if word else _depth(text)
        raise FormatError(f"{path}{place}: no JSON that can be read ({e})") from e
    if not isinstance(content, dict):
        raise FormatError(f"{path}, line 1: expected an object with the keys of a spline")
    return _patches(path, content, text)


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"number {name} is not finite")


def _place(text: str, pattern: str) -> str:
    """The line of what stands first in a text, for messages."""
    found = re.search(pattern, text)
    return f", line {text.count(chr(10), 0, found.start()) + 1}" if found else ""


def _depth(text: str) -> str:
    """The line in which brackets are open deeper than any spline needs, or numbers too long."""
    depth = 0
    for bracket in re.finditer(r"[][{}]|[0-9]{4000}", text):
        depth += 1 if bracket[0] in "[{" else -1
        if depth > _DEEP or len(bracket[0]) > 1:
            return f", line {text.count(chr(10), 0, bracket.start()) + 1}"
    return ""


def _about(message: str) -> str:
    """The key that a message is about."""
    named = re.match(r"key '(\w+)'", message)
    if named:
        return named[1]
    return next((key for start, key in _ABOUT.items() if message.startswith(start)), _POINTS)


def _patches(
    path: str | os.PathLike[str], content: Mapping[str, Any], text: str = ""
) -> tuple[list[Patch], list[str]]:
    """The patch of a mapping with the keys of the module docstring; `text` tells the lines."""

    def fail(message: str) -> NoReturn:
        line = _place(text, f'"{_about(message)}"\\s*:') or (text and ", line 1")
        raise FormatError(f"{path}{line}: {message}")

    for key, expected in (("format", FORMAT), ("version", VERSION), ("index_order", INDEX_ORDER)):
        if type(content.get(key)) is not type(expected) or content[key] != expected:
            fail(f"key {key!r}: found {content.get(key)!r:.60}; expected {expected!r}")
    spline = _spline(fail, content)
    names = content.get("names", [])
    if not isinstance(names, list) or not all(isinstance(n, str) for n in names):
        fail(f"key 'names': found {names!r:.60}; expected a list of words")
    if names and len(names) != spline.m - 3:
        fail(f"key 'names': {len(names)} names for {spline.m} components; expected {spline.m - 3}")
    return numbered([Patch(spline, names=tuple(names))]), []


def _spline(fail: Fail, content: Mapping[str, Any]) -> BSpline:
    vectors = content.get("knot_vectors")
    if not isinstance(vectors, list) or not 1 <= len(vectors) <= 3:
        fail("knot vectors: expected one to three")
    knots = [_numbers(fail, f"knot vector {i}", t) for i, t in enumerate(vectors)]
    degrees, periodic = content.get("degrees"), content.get("periodic")
    for key, value, kind in (("degrees", degrees, int), ("periodic", periodic, bool)):
        if not isinstance(value, list) or len(value) != len(knots):
            fail(f"key {key!r}: found {value!r:.60}; expected one value per knot vector")
        if not all(type(v) is kind for v in value):
            fail(f"key {key!r}: found {value!r:.60}; expected {kind.__name__} values")
    c = _numbers(fail, "key 'control_points'", content.get("control_points"))
    w = content.get("weights")
    if w is not None:
        w = _numbers(fail, "key 'weights'", w)
        check_weights(fail, w)
    for t in knots:
        check_spans(fail, t)
    if c.size == 0 or any(t.ndim != 1 for t in knots):
        fail("control points and knot vectors must not be empty, knot vectors have one axis")
    return checked(fail, knots, c, degrees or (), periodic or (), w)


def _numbers(fail: Fail, what: str, value: Any) -> FloatArray:
    """Finite numbers in equally long lists."""
    if isinstance(value, list):
        value = _listed(fail, what, value)
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiu" or value.ndim == 0:
        fail(f"{what}: expected an array of numbers, found {_shown(value)}")
    a = value.astype(np.float64)
    check_size(fail, a, what)
    return a


def _listed(fail: Fail, what: str, value: list[Any]) -> FloatArray:
    """Lists of lists of numbers as an array; types are checked one by one, before NumPy."""
    shape, items = [len(value)], value
    while items and isinstance(items[0], list) and len(shape) < _AXES:
        shape.append(len(items[0]))
        if not all(type(i) is list and len(i) == shape[-1] for i in items):
            fail(f"{what}: expected numbers in lists of equal length")
        items = list(itertools.chain.from_iterable(items))
    for item in items:
        if type(item) not in (int, float):
            fail(f"{what}: expected an array of numbers, found {_shown(item)}")
    try:
        return np.fromiter(map(float, items), np.float64, len(items)).reshape(shape)
    except OverflowError:
        fail(f"{what}: a whole number is too large")


def _shown(value: Any) -> str:
    """A foreign value, for messages: short, and made without walking through all of it."""
    return f"{value!r:.60}" if isinstance(value, (int, float)) else f"a {type(value).__name__}"


# --- writing ----------------------------------------------------------------------------------


def write_npz(spline: BSpline, path: str | os.PathLike[str], names: tuple[str, ...] = ()) -> None:
    """Write one spline as ``.npz``.

    Parameters
    ----------
    spline : BSpline
        Curve, surface or volume; scalar or vector.
    path : path-like
        The file.
    names : tuple of str
        Names of the coordinates after x, y, z.

    Raises
    ------
    InputError, FormatError
        If the file cannot be written.
    """
    arrays: dict[str, Any] = {k: v for k, v in _content(spline, names).items() if v is not None}
    for i, t in enumerate(spline.t):
        arrays[f"knot_vector_{i}"] = t
    if not names:
        del arrays["names"]
    with atomic_write(path) as file:
        np.savez(file, allow_pickle=False, **arrays)


def write_json(spline: BSpline, path: str | os.PathLike[str], names: tuple[str, ...] = ()) -> None:
    """Write one spline as ``.json``.

    Parameters
    ----------
    spline : BSpline
        Curve, surface or volume; scalar or vector.
    path : path-like
        The file.
    names : tuple of str
        Names of the coordinates after x, y, z.

    Raises
    ------
    InputError, FormatError
        If the file cannot be written.
    """
    content = {**_content(spline, names), "knot_vectors": list(spline.t)}
    lines = [f" {json.dumps(k)}: {json.dumps(v, default=_as_list)}" for k, v in content.items()]
    with atomic_write(path, text=True) as file:
        file.write("{\n" + ",\n".join(lines) + "\n}\n")


def _as_list(a: AnyArray) -> Any:
    return a.tolist()


def _content(spline: BSpline, names: tuple[str, ...]) -> dict[str, Any]:
    """What both forms share; knots are added by the writers."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "index_order": INDEX_ORDER,
        "degrees": list(spline.k),
        "periodic": list(spline.periodic),
        "names": list(names),
        "control_points": spline.c,
        "weights": spline.weights,
    }
