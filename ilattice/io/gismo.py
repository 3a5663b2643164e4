"""G+Smo XML: TensorBSpline and TensorNurbs geometries of one to three parameters.

Guarantees: knots, coefficients and weights are those of the file; control points are Cartesian,
the first direction runs fastest. XML is read without a document type, entities or links to
other files. Files with a comment before the XML declaration, which strict parsers refuse, are
read. What is written is read back bit by bit, but for periodic directions, which become clamped.
Not guaranteed: interfaces and boundaries of a MultiPatch are not interpreted; geometries of other
types (hierarchical, trimmed) are skipped.

Format: `gsXml` of G+Smo (https://gismo.github.io), nested Basis elements, ``coefs`` with
``geoDim``, numbers as text (also fractions ``a/b``) or Base64.
"""

import base64
import binascii
import io
import os
import re
from bisect import bisect_left, bisect_right
from dataclasses import dataclass, field
from typing import NoReturn
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

import numpy as np

from ilattice._files import atomic_write, read_text
from ilattice._typing import FloatArray
from ilattice.bspline import BSpline
from ilattice.errors import FormatError
from ilattice.io._patches import (
    MAX_DEGREE,
    Patch,
    check_count,
    clamped,
    join_names,
    numbered,
    split_names,
    to_rows,
    to_spline,
    to_text,
)
from ilattice.io._scanner import parse_numbers, pieces

#: Levels of elements that are followed.
DEPTH = 64
_TYPE = re.compile(r"(BSpline|Nurbs|Tensor(?:BSpline|Nurbs)([1-9]))")
_ID = re.compile(r"[0-9]{1,9}")
_ATTRIBUTES = (
    "type", "id", "label", "names", "index", "degree", "mode", "csize", "geoDim", "format",
)  # fmt: skip
_TAGS: dict[str, tuple[str, ...]] = {
    "xml": ("Geometry", "MultiPatch"),
    "Geometry": ("Basis", "coefs"),
    "Basis": ("Basis", "KnotVector", "weights"),
    "MultiPatch": ("patches",),
}
#: What a file may have that is read: children, multi-patches, names of skipped elements, letters.
MAX_CHILDREN = 64
MAX_MULTIPATCHES = 1000
MAX_SKIPPED = 1000
MAX_IN_TAG = 60_000
_LONG_TAG = re.compile(rf"<[^!?>][^>]{{{MAX_IN_TAG}}}")
_BASE64 = {"b64float32": "<f4", "b64float64": "<f8"}


# --- reading ----------------------------------------------------------------------------------


def read(path: str | os.PathLike[str]) -> tuple[list[Patch], list[str]]:
    """All splines of a G+Smo file, in its order.

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
        If the file is no G+Smo XML, or holds a malformed geometry.
    """
    found = _Found()
    _parse(path, read_text(path), found)
    whole = sorted({int(i) for i in found.ids if _ID.fullmatch(i)})
    for node in found.multipatches:
        _check_multipatch(node, found.ids, whole)
    return numbered(found.patches), found.skipped


@dataclass
class _Found:
    """What has been read so far."""

    patches: list[Patch] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)
    ids: set[str] = field(default_factory=set)
    multipatches: list["_Node"] = field(default_factory=list)

    def take(self, node: "_Node") -> None:
        """Take in an element below the root that has ended."""
        if node.tag == "MultiPatch":
            self.multipatches.append(node)
            if len(self.multipatches) > MAX_MULTIPATCHES:
                node.fail(f"is one of more than {MAX_MULTIPATCHES}; not read")
        elif node.tag == "Geometry":
            self.ids.add(node.attributes.get("id", "").strip())
            spline = _geometry(node)
            if spline is None:
                if len(self.skipped) < MAX_SKIPPED:
                    kind = node.attributes.get("type")
                    self.skipped.append(f"{kind:.40} in line {node.line}")
            else:
                check_count(node.fail, len(self.patches), node.room)
                self.patches.append(_patch(node, spline))


def _patch(node: "_Node", spline: BSpline) -> Patch:
    info = {"line": node.line, "type": node.attributes["type"]}
    if "id" in node.attributes:
        info["id"] = node.attributes["id"].strip()
    extra = node.attributes.get("names", "")
    names = split_names(node.fail, extra, spline.m) if extra else ()
    return Patch(spline, name=node.attributes.get("label", ""), names=names, info=info)


def _geometry(node: "_Node") -> BSpline | None:
    """Spline of a Geometry element, or None if its type is not one of ours."""
    match = _TYPE.fullmatch(node.attribute("type"))
    ndim = int(match[2] or 1) if match else 0
    if not 1 <= ndim <= 3:
        return None
    basis = node.child("Basis")
    weights = None
    if "Nurbs" in node.attributes["type"]:
        weights = basis.child("weights")
        basis = basis.child("Basis")
    lines = basis.all("Basis") if ndim > 1 or basis.all("Basis") else [basis]
    if len(lines) != ndim:
        basis.fail(f"found {len(lines)} bases of one direction; expected {ndim}")
    degrees, knots = [], []
    for axis, line in enumerate(lines):
        if line.attributes.get("index", str(axis)).strip() != str(axis):
            line.fail(f"index is {line.attributes['index']:.20}; expected {axis}, in order")
        k, t = _knots(line.child("KnotVector"), node.room)
        degrees.append(k)
        knots.append(t)
    size = 1
    for k, t in zip(degrees, knots, strict=True):
        size *= max(len(t) - k - 1, 0)
    coefs = node.child("coefs")
    dim = coefs.integer("geoDim", 1, 10**6)
    rows = coefs.numbers(size * dim, f"numbers, {size} control points of {dim} coordinates")
    w = None if weights is None else weights.numbers(size, "weights")
    return to_spline(node.fail, knots, rows.reshape(-1, dim), degrees, weights=w)


def _knots(node: "_Node", room: int) -> tuple[int, FloatArray]:
    """Degree and knots; `room` bounds the number of knots that the file can mean."""
    k = node.integer("degree", 0, MAX_DEGREE)
    if node.attributes.get("mode") != "uniform":
        return k, node.numbers(None, "knots")
    n = node.integer("csize", k + 1, max(room, k + 1))
    inner = np.linspace(0.0, 1.0, n - k + 1)
    return k, np.concatenate([np.zeros(k), inner, np.ones(k)])


def _check_multipatch(node: "_Node", ids: set[str], whole: list[int]) -> None:
    """Every patch that the MultiPatch names must be there."""
    patches = node.child("patches")
    words = patches.text.split()
    kind = patches.attribute("type")
    if kind == "id_range":
        if len(words) != 2 or not all(map(_ID.fullmatch, words)):
            patches.fail(f"found {patches.text.strip()!r:.40}; expected first and last id")
        first, last = int(words[0]), int(words[1])
        if bisect_right(whole, last) - bisect_left(whole, first) != last - first + 1:
            patches.fail(f"ids {first} to {last}: not every one names a Geometry of this file")
    elif kind == "id_index":
        for word in words:
            if word not in ids:
                patches.fail(f"id {word!r:.40} names no Geometry of this file")
    else:
        patches.fail(f"type is {kind!r:.40}; expected 'id_range' or 'id_index'")


# --- a small XML tree with lines ------------------------------------------------------------------


@dataclass(slots=True)
class _Node:
    """One element, with the line of its start; below it only what is known here."""

    path: str | os.PathLike[str]
    tag: str
    attributes: dict[str, str]
    line: int
    room: int
    children: list["_Node"] = field(default_factory=list)
    data: io.StringIO = field(default_factory=io.StringIO)

    @property
    def text(self) -> str:
        """Character data between the tags."""
        return self.data.getvalue()

    def fail(self, message: str, line: int | None = None) -> NoReturn:
        """Raise `FormatError` with path and line."""
        raise FormatError(f"{self.path}, line {line or self.line}: <{self.tag:.40}>: {message}")

    def all(self, tag: str) -> list["_Node"]:
        """All children of that tag."""
        return [c for c in self.children if c.tag == tag]

    def child(self, tag: str) -> "_Node":
        """The one child of that tag."""
        found = self.all(tag)
        if len(found) != 1:
            self.fail(f"holds {len(found)} elements <{tag}>; expected one")
        return found[0]

    def attribute(self, name: str) -> str:
        """Value of an attribute that must be there."""
        if name not in self.attributes:
            self.fail(f"has no attribute {name!r}")
        return self.attributes[name].strip()

    def integer(self, name: str, lo: int, hi: int) -> int:
        """Value of an attribute as a whole number."""
        value = self.attribute(name)
        if not re.fullmatch(r"[0-9]{1,18}", value) or not lo <= int(value) <= hi:
            self.fail(f"{name} is {value!r:.40}; expected a whole number from {lo} to {hi}")
        return int(value)

    def numbers(self, count: int | None, what: str) -> FloatArray:
        """The text as `count` numbers (None: any count), shape (count,)."""
        form = self.attributes.get("format", "ascii").lower()
        values = self._ascii(what) if form == "ascii" else self._decoded(form)
        if count is not None and len(values) != count:
            self.fail(f"found {len(values)} numbers; expected {count} {what}")
        return values

    def _ascii(self, what: str) -> FloatArray:
        text, done = self.text, 0
        parts = [np.empty(0)]
        for piece in pieces(text):
            tokens = piece.split()
            values = parse_numbers(tokens)
            if isinstance(values, int):
                tokens = [_quotient(t) for t in tokens]
                values = parse_numbers(tokens)
            if isinstance(values, int):
                at = done + [m.start() for m in re.finditer(r"\S+", piece)][values]
                line = self.line + text.count("\n", 0, at)
                self.fail(f"found {tokens[values]!r:.40}; expected {what}, finite", line)
            parts.append(values)
            done += len(piece)
        return np.concatenate(parts)

    def _decoded(self, form: str) -> FloatArray:
        if form not in _BASE64:
            self.fail(f"format is {form!r:.40}; expected ASCII or one of {', '.join(_BASE64)}")
        try:
            data = base64.b64decode("".join(self.text.split()), validate=True)
            values = np.frombuffer(data, _BASE64[form]).astype(np.float64)
        except (binascii.Error, ValueError) as e:
            self.fail(f"is no {form} data ({e})")
        if not np.isfinite(values).all():
            self.fail(f"number {int(np.argmin(np.isfinite(values))) + 1} is not finite")
        return values


def _quotient(token: str) -> str:
    """A fraction, which G+Smo allows wherever a number stands, as a decimal number."""
    parts = token.split("/")
    if len(parts) != 2:
        return token
    pair = parse_numbers(parts)
    if isinstance(pair, int) or pair[1] == 0:
        return token
    with np.errstate(over="ignore"):
        return repr(float(pair[0] / pair[1]))


def _parse(path: str | os.PathLike[str], text: str, found: _Found) -> None:
    """Take the elements below the root in, one after the other.

    Refuses a document type, more than `DEPTH` levels, and more than `MAX_CHILDREN` known elements
    in one. Elements and attributes that are not known here are passed over.
    """
    if long := _LONG_TAG.search(text):
        line = text.count("\n", 0, long.start()) + 1
        raise FormatError(f"{path}, line {line}: a tag has more than {MAX_IN_TAG} letters")
    parser = expat.ParserCreate("utf-8")
    parser.buffer_text = True
    stack: list[_Node | None] = []  # None where elements are passed over

    def fail(message: str) -> NoReturn:
        raise FormatError(f"{path}, line {parser.CurrentLineNumber}: {message}")

    def start(tag: str, attributes: dict[str, str]) -> None:
        if len(stack) >= DEPTH:
            fail(f"elements are nested more than {DEPTH} deep")
        above = stack[-1] if stack else None
        node = None
        if not stack or (above is not None and tag in _TAGS.get(above.tag, ())):
            known = {k: attributes[k] for k in _ATTRIBUTES if k in attributes}
            node = _Node(path, tag, known, parser.CurrentLineNumber, len(text))
        if not stack and tag != "xml" and node is not None:
            node.fail(f"root element is <{tag:.40}>; expected <xml>, as G+Smo has it")
        if len(stack) > 1 and above is not None and node is not None:
            above.children.append(node)
            if len(above.children) > MAX_CHILDREN:
                above.fail(f"holds more than {MAX_CHILDREN} elements; not read")
        stack.append(node)

    def end(_: str) -> None:
        node = stack.pop()
        if len(stack) == 1 and node is not None:
            found.take(node)

    def add(data: str) -> None:
        if len(stack) > 1 and stack[-1] is not None:
            stack[-1].data.write(data)

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = add
    parser.CommentHandler = lambda data: add("\n" * data.count("\n"))
    parser.StartDoctypeDeclHandler = lambda *_: fail("a document type is not allowed here")
    try:
        parser.Parse(_without_declaration(text), True)
    except (expat.ExpatError, UnicodeEncodeError) as e:
        line = getattr(e, "lineno", 1)
        raise FormatError(f"{path}, line {line}: not well-formed XML ({e})") from e


def _without_declaration(text: str) -> str:
    """The text with the XML declaration blanked, also where comments precede it."""
    at = 0
    while (at := len(text) - len(text[at:].lstrip())) < len(text) and text.startswith("<!--", at):
        end = text.find("-->", at)
        if end < 0:
            return text
        at = end + 3
    if not text.startswith("<?xml", at) or (end := text.find("?>", at)) < 0:
        return text
    return text[:at] + "\n" * text.count("\n", at, end) + text[end + 2 :]


# --- writing ----------------------------------------------------------------------------------


def write(spline: BSpline, path: str | os.PathLike[str], names: tuple[str, ...] = ()) -> None:
    """Write one spline as a G+Smo geometry with id 0.

    Parameters
    ----------
    spline : BSpline
        Curve, surface or volume; a scalar spline becomes one with one coordinate. Periodic
        directions are written clamped.
    path : path-like
        The file.
    names : tuple of str
        Names of the coordinates after x, y, z, kept in an attribute that G+Smo ignores.

    Raises
    ------
    InputError, FormatError
        If the file cannot be written.
    """
    spline = clamped(spline, only_periodic=True)
    rows, weights = to_rows(spline)
    extra = f" names={quoteattr(join_names(names))}" if names else ""
    number = str(spline.ndim) if spline.ndim > 1 else ""
    tensor = "Tensor" if spline.ndim > 1 else ""
    kind = "BSpline" if weights is None else "Nurbs"
    basis = _basis_text(spline, tensor, number)
    if weights is not None:
        inner = f"<weights>\n{to_text(weights[:, None])}\n</weights>\n{basis}"
        basis = f'<Basis type="{tensor}NurbsBasis{number}">\n{inner}\n</Basis>'
    with atomic_write(path, text=True) as file:
        file.write('<?xml version="1.0" encoding="UTF-8"?>\n<xml>\n')
        file.write(f'<Geometry type="{tensor}{kind}{number}" id="0"{extra}>\n{basis}\n')
        file.write(f'<coefs geoDim="{rows.shape[1]}">\n{to_text(rows)}\n</coefs>\n')
        file.write("</Geometry>\n</xml>\n")


def _basis_text(spline: BSpline, tensor: str, number: str) -> str:
    lines = []
    for axis, (t, k) in enumerate(zip(spline.t, spline.k, strict=True)):
        index = f' index="{axis}"' if tensor else ""
        knots = to_text(t[None])
        lines.append(
            f'<Basis type="BSplineBasis"{index}>\n'
            f'<KnotVector degree="{k}">{knots}</KnotVector>\n</Basis>'
        )
    text = "\n".join(lines)
    return f'<Basis type="TensorBSplineBasis{number}">\n{text}\n</Basis>' if tensor else text
