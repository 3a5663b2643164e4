"""The command language of solids: words from left to right act on a stack of fields.

``il.sdf.parse("part.stl gyroid scale 2 distance shell 0.4 intersection")`` is a field. The
language is that of Cesogen (Patience, Audet and Blais 2024), with more operations: solids are
pushed, operations replace what is on top, and what is left at the end is intersected.

Guarantees: text is parsed, never evaluated by Python; whatever the words, the result is a field or
an `InputError` (for files: `FormatError`, `GeometryError`) that names the word and its place. A
name stands for a solid or an operation rather than for a file, a file rather than for an equation.

Not guaranteed: that level units are lengths: ``gyroid shell 0.1`` is where the equation of the
gyroid is between -0.05 and 0.05. ``gyroid distance shell 0.1`` has walls 0.1 thick.
"""

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ilattice import fields
from ilattice._shown import one_line
from ilattice._typing import FloatArray
from ilattice._validate import FixedMapping, as_flag, as_items, as_texts, near_names
from ilattice.errors import FileError, InputError
from ilattice.fields.equation import CONSTANTS, FUNCTIONS, VARIABLES, has_coordinates
from ilattice.fields.node import Node
from ilattice.mesh import load
from ilattice.offsets.distance import bind
from ilattice.sdf._tokens import Token, read
from ilattice.sdf._vocabulary import (
    MESHES,
    OPERATIONS,
    OPTIONS,
    Operation,
    Parameter,
    is_solid,
    key,
    known_names,
    solid,
)
from ilattice.sdf.mesh_distance import MeshDistance

__all__ = ["Command", "parse"]

MAX_DEPTH = 150  # of the tree of operations
_NUMBER = re.compile(r"-[\d.]")
_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)
_WORD = re.compile(r"[A-Za-z][\w-]*\Z", re.ASCII)


@dataclass(frozen=True)
class _Item:
    """A solid, or an operation with its operands by name."""

    token: Token
    operation: Operation | None = None
    operands: Mapping[str, Token] = field(default_factory=FixedMapping)


@dataclass(frozen=True, eq=False)
class Command:
    """A command, taken apart but not yet carried out.

    Attributes
    ----------
    items : tuple
        Solids and operations in order.
    options : mapping of str to tuple of Token
        What followed each option, in order.
    """

    items: tuple[_Item, ...]
    options: Mapping[str, tuple[Token, ...]]

    def __repr__(self) -> str:
        words = " ".join(item.token.text for item in self.items)
        options = "".join(f" {name}" for name in self.options)
        return one_line(f"Command({words}{options})")

    @classmethod
    def read(cls, command: str | Sequence[str]) -> "Command":
        """Take a command apart.

        Parameters
        ----------
        command : str or sequence of str
            Words in one text, split as a shell does, or one by one.

        Returns
        -------
        Command
            Its items and options.

        Raises
        ------
        InputError
            For unknown options and operations without their parameters.
        """
        return _Reader(read(command)).command()

    def solid(self, values: Mapping[str, str] | None = None, *, strict: bool = False) -> Node:
        """Carry the command out.

        Parameters
        ----------
        values : mapping of str to str, optional
            Words that stand for others: numbers in equations, solids, files.
        strict : bool
            Refuse meshes that do not bound a solid, in place of a warning.

        Returns
        -------
        Node
            The field.

        Raises
        ------
        InputError
            For everything that is wrong with the command.
        FormatError, GeometryError
            For files that cannot be read, or used.
        """
        known = as_texts("values", {} if values is None else values)
        return _Machine(known, strict).run(self.items)

    def files(self, values: Mapping[str, str]) -> list[str]:
        """The files that the command reads.

        Parameters
        ----------
        values : mapping of str to str
            Words that stand for others.

        Returns
        -------
        list of str
            Paths, in order, each once.
        """
        known = {key(name): text for name, text in as_texts("values", values).items()}
        found: dict[str, None] = {}
        for item in self.items:
            text = item.token.text
            if item.operation is None and solid(text) is None:
                text = known.get(key(text), text)
                if solid(text) is None and text.lower().endswith(MESHES):
                    found[text] = None
        return list(found)

    @property
    def sources(self) -> list[str]:
        """The files from which words of the command were read."""
        tokens = [t for item in self.items for t in (item.token, *item.operands.values())]
        tokens += [t for given in self.options.values() for t in given]
        return sorted({t.file for t in tokens if t.file})

    def check_used(self, values: Mapping[str, Sequence[str]]) -> None:
        """Refuse names that stand for values but occur nowhere.

        Parameters
        ----------
        values : mapping of str to sequence of str
            What each name stands for.

        Raises
        ------
        InputError
            Naming the first such name.
        """
        if not isinstance(values, Mapping):
            raise InputError(f"values must be a mapping of names to texts, got {values!r:.80}")
        for name, several in values.items():
            for text in as_items("values", several):
                as_texts("values", {name: text})
        texts = [t.text for i in self.items for t in (i.token, *i.operands.values())]
        texts += [text for several in values.values() for text in several]
        used = {key(text) for text in texts}
        for text in texts:
            if not text.lower().endswith(MESHES):
                used.update(map(key, _NAME.findall(text)))
        for name in values:
            if key(name) not in used:
                raise InputError(
                    f"{name!r:.80} stands for a value, but the command does not use that name"
                )

    def tree(self) -> list[str]:
        """The tree of operations, one line of text each, as deep as it is indented.

        Returns
        -------
        list of str
            Operations with their operands, above the solids that they are applied to.

        Raises
        ------
        InputError
            If an operation lacks solids.
        """
        stack: list[list[str]] = []
        for item in self.items:
            n = item.operation.solids if item.operation else 0
            if n > len(stack):
                raise InputError(f"{item.token}: needs {n} solids before it, found {len(stack)}")
            below = [f"  {line}" for part in stack[len(stack) - n :] for line in part]
            words = [item.token.text, *(f"{k} {t.text}" for k, t in item.operands.items())]
            stack[len(stack) - n :] = [[" ".join(words), *below]]
        if len(stack) == 1:
            return stack[0]
        return ["intersection", *(f"  {line}" for part in stack for line in part)]


class _Reader:
    """From words to items and options."""

    def __init__(self, tokens: list[Token]) -> None:
        self.tokens, self.next = tokens, 0
        self.items: list[_Item] = []
        self.options: dict[str, list[Token]] = {}

    def command(self) -> Command:
        """Read all words."""
        plain = False
        while self.next < len(self.tokens):
            token = self._word()
            if not plain and token.text == "--":
                plain = True
            elif not plain and token.text.startswith("-") and not _NUMBER.match(token.text):
                self._option(token)
            elif key(token.text) in OPERATIONS:
                self._operation(token, OPERATIONS[key(token.text)])
            else:
                self.items.append(_Item(token))
        options = FixedMapping({name: tuple(found) for name, found in self.options.items()})
        return Command(tuple(self.items), options)

    def _word(self) -> Token:
        self.next += 1
        return self.tokens[self.next - 1]

    def _peek(self) -> str:
        return self.tokens[self.next].text if self.next < len(self.tokens) else ""

    def _option(self, token: Token) -> None:
        name, sign, rest = token.text.partition("=")
        if sign and OPTIONS.get(name):  # --set=a=0.1,0.2
            self.tokens.insert(self.next, Token(rest, token.place))
        if name not in OPTIONS:
            near = near_names(name, list(OPTIONS))
            raise InputError(
                f"{token}: unknown option (near: {near}); put an equation that starts with '-' "
                "in parentheses, or behind '--'"
            )
        if name in self.options and name != "--set":
            raise InputError(f"{token}: the option is given twice")
        if OPTIONS[name] and self.next == len(self.tokens):
            raise InputError(f"{token}: a {OPTIONS[name]} must follow")
        self.options.setdefault(name, []).append(self._word() if OPTIONS[name] else token)

    def _operation(self, token: Token, operation: Operation) -> None:
        wanted = {p.name: p for p in operation.parameters}
        given: dict[str, Token] = {}
        by_name = key(self._peek()) in wanted
        for parameter in operation.parameters:
            name = parameter.name
            if by_name:
                name = key(self._peek())
                if name not in wanted or name in given:
                    missing = " and ".join(n for n in wanted if n not in given)
                    raise InputError(f"{token}: {missing} must follow, got {self._peek()!r}")
                self._word()
            if self.next == len(self.tokens):
                raise InputError(
                    f"{token}: {wanted[name].name}, {_TYPES[parameter.kind]}, must follow"
                )
            given[name] = self._word()
        self.items.append(_Item(token, operation, FixedMapping(given)))


_TYPES = {
    "number": "a number",
    "vector": "three numbers with commas in between",
    "factor": "one number, or three with commas in between",
    "amount": "a number or an equation",
    "field": "an equation",
}


class _Machine:
    """The stack."""

    def __init__(self, values: Mapping[str, str], strict: bool) -> None:
        check_names(values)
        self.values = {key(name): text for name, text in values.items()}
        self.numbers: dict[str, float] = {}
        for name, text in self.values.items():
            try:
                self.numbers[name] = fields.constant(text)
            except InputError:
                continue
        self.strict = as_flag("strict", strict)
        self.stack: list[Node] = []
        self.meshes: dict[str, Node] = {}

    def run(self, items: Sequence[_Item]) -> Node:
        """The intersection of what is left at the end."""
        for item in items:
            if item.operation is None:
                self.stack.append(self._solid(item.token))
            else:
                self._apply(item, item.operation)
        if not self.stack:
            raise InputError("nothing to mesh: the command names no solid, such as sphere or box")
        whole = fields.intersection(*self.stack)
        if whole.program.leaves and np.isfinite(whole.bounds).all():
            bind(whole, whole.bounds)
        return whole

    def _apply(self, item: _Item, operation: Operation) -> None:
        n = operation.solids
        if len(self.stack) < n:
            raise InputError(
                f"{item.token}: needs {n} solid{'s' * (n > 1)} before it, found {len(self.stack)}"
            )
        parts = self.stack[len(self.stack) - n :]
        arguments = {
            p.name: self._operand(item, p, item.operands[p.name]) for p in operation.parameters
        }
        try:
            node = operation.apply(*parts, **arguments)
        except InputError as e:
            raise InputError(f"{item.token}: {e}") from e
        if node.depth > MAX_DEPTH:
            raise InputError(f"{item.token}: more than {MAX_DEPTH} operations are nested")
        self.stack[len(self.stack) - n :] = [node]

    # ------------------------------------------------------------------ operands

    def _operand(self, item: _Item, parameter: Parameter, token: Token) -> Any:
        text = self.values.get(key(token.text), token.text)
        try:
            if parameter.kind in ("amount", "field"):
                return self._amount(text, parameter.kind)
            if parameter.kind == "number":
                return fields.constant(text, names=self.numbers)
            return self._vector(text, parameter.kind)
        except InputError as e:
            raise InputError(f"{item.token}, {parameter.name} at {token}: {e}") from e

    def _amount(self, text: str, kind: str) -> float | Node:
        found = fields.equation(text, names=self.numbers)
        if has_coordinates(found) or kind == "field":
            return found
        return fields.constant(text, names=self.numbers)

    def _vector(self, text: str, kind: str) -> FloatArray:
        values = np.array([fields.constant(t, names=self.numbers) for t in _components(text)])
        if len(values) != 3 and not (kind == "factor" and len(values) == 1):
            raise InputError(f"must be {_TYPES[kind]}, got {len(values)}")
        return values

    # ------------------------------------------------------------------ solids

    def _solid(self, token: Token) -> Node:
        text = token.text
        found = solid(text)
        if found is None and key(text) in self.values:
            text = self.values[key(text)]
            found = solid(text)
        if found is not None:
            return found
        if text.lower().endswith(MESHES):
            return self._mesh(token, text)
        try:
            found = fields.equation(text, names=self.numbers)
        except InputError as e:
            if not _WORD.match(text):
                raise InputError(f"{token}: neither a name nor a file; {e}") from e
        if found is None or not has_coordinates(found):
            near = near_names(key(text).replace("_", "-"), known_names())
            what = "unknown name" if found is None else "unknown name or constant equation"
            raise InputError(f"{token}: {what}; near names: {near}")
        return found

    def _mesh(self, token: Token, path: str) -> Node:
        if path not in self.meshes:
            if not os.path.exists(path):
                raise FileError(f"{token}: there is no file {path!r:.80}")
            self.meshes[path] = fields.from_callable(MeshDistance(load(path), strict=self.strict))
        return self.meshes[path]


def _components(text: str) -> list[str]:
    """Parts of a text between the commas outside of parentheses."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter == "(") - (letter == ")")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return parts


def is_free(name: str) -> bool:
    """Whether a name may stand for a value."""
    taken = {*VARIABLES, *CONSTANTS, *FUNCTIONS, *OPERATIONS}
    return bool(_WORD.match(name)) and key(name) not in taken and not is_solid(name)


def check_names(names: Iterable[str]) -> None:
    """Refuse names that have a meaning already, or that are compared as one."""
    known: dict[str, str] = {}
    for name in names:
        if not is_free(name):
            raise InputError(f"{name!r:.80} cannot stand for a value: it has a meaning already")
        if key(name) in known:
            raise InputError(
                f"{known[key(name)]!r:.80} and {name!r:.80} are the same name, as are capitals and "
                "small letters; rename one of them"
            )
        known[key(name)] = name


def parse(command: str | Sequence[str], *, strict: bool = False, **values: float | str) -> Node:
    """Field of a command, such as ``"box gyroid shell 0.3"``.

    Parameters
    ----------
    command : str or sequence of str
        Solids and operations, without options. Words in one text, split as a shell does, or one
        by one.
    strict : bool
        Refuse meshes that do not bound a solid, in place of a warning.
    **values : float or str
        What names in the command stand for: ``parse("gyroid dilate t", t=0.2)``.

    Returns
    -------
    Node
        The field, negative inside.

    Raises
    ------
    InputError
        For everything that is wrong with the command; the message names the word and its place.
    FormatError, GeometryError
        For meshes that cannot be read, or used.

    Examples
    --------
    >>> ball = parse("sphere scale 2")
    >>> ball([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
    array([-2.,  1.])
    """
    check_names(values)
    found = Command.read(command)
    if found.options:
        raise InputError(f"a field takes no options, got {', '.join(found.options)}")
    texts = {name: str(value) for name, value in values.items()}
    found.check_used({name: [text] for name, text in texts.items()})
    return found.solid(texts, strict=strict)
