r"""IRIT text data (``.itd``): B-spline and Bézier curves, surfaces and trivariates.

Guarantees: orders become degrees; point types E1, E2, ... and P1, P2, ... (weight first,
coordinates multiplied by it) become Cartesian control points and weights; ``KV`` and periodic
``KVP`` knot vectors keep their meaning; further coordinates (E7: colour and thickness) are kept.
Attributes, comments, nested objects and objects of other kinds are passed over; all patches of an
object share its attributes.
Not guaranteed: rational coordinates come back to rounding only, since the format multiplies them;
power bases, trimmed surfaces and multivariates of more than three parameters are skipped.

Grammar, as the IRIT solid modeller (G. Elber) reads and writes it::

    object := "[OBJECT" attribute* name? (object | geometry | attribute)* "]"
    geometry := "[" ("CURVE" | "SURFACE" | "TRIVAR") "BSPLINE" attribute*
                size+ order+ ptype knots+ point+ "]"
              | the same with "MULTIVAR", number of parameters before the sizes
              | the same with "BEZIER", where sizes are orders and there are no knots
    knots := "[KV" number{n + order} "]"  |  "[KVP" number{n + 2 order - 1} "]"
    point := "[" weight? x1 .. xd "]"                          first direction fastest
"""

import io
import math
import os
import re
from dataclasses import dataclass, field

import numpy as np

from ilattice._files import atomic_write, read_text
from ilattice._typing import FloatArray
from ilattice.bspline import BSpline
from ilattice.errors import FormatError, InputError
from ilattice.io._patches import (
    MAX_DEGREE,
    Patch,
    check_count,
    join_names,
    numbered,
    split_names,
    to_rows,
    to_spline,
    to_text,
)
from ilattice.io._scanner import Scanner

_STRING = r'"(?:[^"\\]|\\.?)*+"?'
_COMMENT = re.compile(rf"(?s:{_STRING})|\#[^\n]*")
_TOKEN = rf'(?s:{_STRING})|[\[\]]|[^\s\[\]"]+'
_POINT = re.compile(r"([EP])([0-9]{1,2})", re.IGNORECASE)
_PARAMETERS = {"CURVE": 1, "SURFACE": 2, "TRIVAR": 3, "MULTIVAR": 0}
_WORDS = ("CURVE", "SURFACE", "TRIVAR")
_OTHER = {"TRIMSRF", "TRISRF", "MODEL"}
#: Components of a point type (P9).
LARGEST_POINT = 9
#: What a file may have: levels, names of skipped objects that are told, attributes of one.
MAX_NESTED = 1000
MAX_SKIPPED = 1000
MAX_ATTRIBUTES = 50_000


# --- reading ----------------------------------------------------------------------------------


@dataclass
class _Object:
    """An object whose end has not been read yet."""

    name: str = ""
    at: int = 0
    attributes: dict[str, str] = field(default_factory=dict)  # shared by its patches
    coordinates: str = ""
    names: dict[int, tuple[str, ...]] = field(default_factory=dict)  # by number of components


def read(path: str | os.PathLike[str]) -> tuple[list[Patch], list[str]]:
    """All splines of an IRIT text file, in its order.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    list of Patch
        Volumes, surfaces and curves.
    list of str
        Descriptions of the geometries that were skipped.

    Raises
    ------
    FormatError
        If the file does not follow the grammar.
    """
    scanner = Scanner(_without_comments(read_text(path)), path, _TOKEN)
    if not scanner.left:
        raise FormatError(f"{path}: is empty; expected '[OBJECT'")
    patches: list[Patch] = []
    skipped: list[str] = []
    stack: list[_Object] = []
    while scanner.left:
        _next_item(scanner, stack, patches, skipped)
    if stack:
        scanner.fail("this object is never closed", stack[-1].at)
    return numbered(patches), skipped


def _without_comments(text: str) -> str:
    """The text without comments; a mark within quotes begins none."""
    if "#" not in text:
        return text
    out, at = io.StringIO(), 0
    for match in _COMMENT.finditer(text):
        if text[match.start()] == "#":
            out.write(text[at : match.start()])
            at = match.end()
    out.write(text[at:])
    return out.getvalue()


def _next_item(
    scanner: Scanner, stack: list[_Object], patches: list[Patch], skipped: list[str]
) -> None:
    """One step of the grammar; the objects that are open lie on the stack."""
    token, keyword = scanner.peek(), scanner.peek(1).upper()
    if token == "]" and stack:
        scanner.word("']'")
        stack.pop()
    elif token != "[":
        if not stack or stack[-1].name or token == "]":
            scanner.fail(f"found {token!r:.60}; expected '['")
        stack[-1].name = scanner.word("a name").strip('"')
    elif keyword == "OBJECT":
        if len(stack) == MAX_NESTED:
            scanner.fail(f"objects are nested more than {MAX_NESTED} deep")
        stack.append(_Object(at=scanner.at))
        scanner.at += 2
    elif keyword in _PARAMETERS and _is_ours(scanner, keyword):
        owner = stack[-1] if stack else _Object()
        check_count(scanner.fail, len(patches), scanner.size)
        patches.append(_patch(scanner, owner))
    else:
        ours = keyword in _PARAMETERS or keyword in _OTHER
        if ours and len(skipped) < MAX_SKIPPED:
            skipped.append(f"{keyword} {scanner.peek(2):.20}")
        words = _skip_group(scanner)
        if stack and len(words) == 2 and words[0].upper() == "COORDINATES":
            stack[-1].coordinates, stack[-1].names = words[1].strip('"'), {}
        elif stack and len(words) == 2:
            if len(stack[-1].attributes) == MAX_ATTRIBUTES:
                scanner.fail(f"an object has more than {MAX_ATTRIBUTES} attributes")
            stack[-1].attributes[words[0].upper()] = words[1].strip('"')


def _is_ours(scanner: Scanner, keyword: str) -> bool:
    """Whether the geometry that comes next is of a kind that is read."""
    if keyword == "MULTIVAR" and scanner.peek(3) not in ("1", "2", "3"):
        return False
    return scanner.peek(2).upper() in ("BSPLINE", "BEZIER")


def _patch(scanner: Scanner, owner: _Object) -> Patch:
    """The geometry that comes next, with what its object says."""
    start = scanner.at
    spline = _geometry(scanner)
    extra, m = owner.coordinates, spline.m
    if extra and m not in owner.names:
        owner.names[m] = split_names(lambda text: scanner.fail(text, start), extra, m)
    return Patch(spline, name=owner.name, names=owner.names.get(m, ()), info=owner.attributes)


def _skip_group(scanner: Scanner) -> list[str]:
    """Pass over a bracketed group; its words, if there are no groups in it."""
    start, depth = scanner.at, 0
    words: list[str] = []
    while True:
        if not scanner.left:
            scanner.fail("this '[' is never closed", start)
        word = scanner.word("']'")
        depth += (word == "[") - (word == "]")
        if depth == 0:
            return words[1:]
        if len(words) < 4:  # more are never looked at
            words.append(word)


def _geometry(scanner: Scanner) -> BSpline:
    """The geometry that comes next."""
    start = scanner.at
    scanner.expect("[")
    ndim = _PARAMETERS[scanner.word("a geometry").upper()]
    bezier = scanner.word("BSPLINE or BEZIER").upper() == "BEZIER"
    while scanner.peek() == "[":
        _skip_group(scanner)
    ndim = ndim or scanner.integer("the number of parameters", 1, 3)
    sizes = [scanner.integer("number of control points", 1) for _ in range(ndim)]
    orders = sizes if bezier else [scanner.integer("order", 1, MAX_DEGREE + 1) for _ in range(ndim)]
    rational, dim = _point_type(scanner)
    if math.prod(sizes) > scanner.left:
        scanner.fail(
            f"{' x '.join(map(str, sizes))} control points cannot fit: "
            f"the file holds only {scanner.left} more entries",
            start,
        )
    if bezier:
        periodic = [False] * ndim
        knots = [np.repeat([0.0, 1.0], n) for n in sizes]
    else:
        knots, periodic = _knots(scanner, sizes, orders)
    rows = scanner.rows(math.prod(sizes), dim + rational, "control points")
    scanner.expect("]")
    weights = rows[:, 0] if rational else None
    if weights is not None:
        rows = _divided(scanner, start, rows)
    return to_spline(
        lambda m: scanner.fail(m, start),
        knots,
        rows,
        [n - 1 for n in orders],
        weights=weights,
        periodic=periodic,
    )


def _point_type(scanner: Scanner) -> tuple[bool, int]:
    """Whether points are projective, and how many coordinates they have."""
    word = scanner.word("a point type")
    match = _POINT.fullmatch(word)
    if not match or int(match[2]) == 0:
        scanner.fail(f"found {word!r:.60}; expected a point type such as E3 or P3", scanner.at - 1)
    return match[1].upper() == "P", int(match[2])


def _knots(
    scanner: Scanner, sizes: list[int], orders: list[int]
) -> tuple[list[FloatArray], list[bool]]:
    """Knot vectors, and which of them are periodic."""
    knots, periodic = [], []
    for n, order in zip(sizes, orders, strict=True):
        scanner.expect("[")
        periodic.append(scanner.expect("KV", "KVP", "kv", "kvp").upper() == "KVP")
        count = n + (2 * order - 1 if periodic[-1] else order)
        knots.append(scanner.numbers(count, "knots"))
        scanner.expect("]")
    return knots, periodic


def _divided(scanner: Scanner, start: int, rows: FloatArray) -> FloatArray:
    """Cartesian points (n, d) of projective ones (n, 1 + d)."""
    w = rows[:, :1]
    if not (w > 0).all():
        scanner.fail(f"weights must be positive, the least is {w.min():g}", start)
    with np.errstate(over="ignore"):
        return rows[:, 1:] / w


# --- writing ----------------------------------------------------------------------------------


def write(spline: BSpline, path: str | os.PathLike[str], names: tuple[str, ...] = ()) -> None:
    """Write one spline as an IRIT object.

    Parameters
    ----------
    spline : BSpline
        Curve, surface or volume with at most nine components; a scalar one becomes E1.
        Periodic directions are written as ``KVP``.
    path : path-like
        The file.
    names : tuple of str
        Names of the coordinates after x, y, z, kept in the attribute ``COORDINATES``.

    Raises
    ------
    InputError, FormatError
        If there are more than nine components, or the file cannot be written.
    """
    rows, weights = to_rows(spline, unwrapped=True)
    if rows.shape[1] > LARGEST_POINT:
        raise InputError(
            f"spline has {rows.shape[1]} components, IRIT points have at most {LARGEST_POINT}; "
            "save as .npz or .json"
        )
    point = f"{'E' if weights is None else 'P'}{rows.shape[1]}"
    if weights is not None:
        rows = np.column_stack([weights, rows * weights[:, None]])
    sizes = [
        n - (k if p else 0) for n, k, p in zip(spline.shape, spline.k, spline.periodic, strict=True)
    ]
    numbers = " ".join(map(str, [*sizes, *(k + 1 for k in spline.k)]))
    extra = f' [COORDINATES "{join_names(names)}"]' if names else ""
    with atomic_write(path, text=True) as file:
        file.write(f"[OBJECT{extra} ILATTICE\n")
        file.write(f"    [{_WORDS[spline.ndim - 1]} BSPLINE {numbers} {point}\n")
        for t, p in zip(spline.t, spline.periodic, strict=True):
            file.write(to_text(t[None], "\t[KVP " if p else "\t[KV ", "]\n"))
        file.write(to_text(rows, "\t[", "]") + "\n    ]\n]\n")
