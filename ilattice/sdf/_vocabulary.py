"""The words of the language, as data: solids, operations with their parameters, options.

Names are the same in upper and lower case, with ``-`` and ``_`` taken for equal. Amounts of
`dilate`, `erode`, `shell` and of blends may be equations: they vary in space.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

from ilattice import fields, tiles
from ilattice.fields.node import Node
from ilattice.offsets.distance import distance
from ilattice.tiles.catalog import find

#: Endings of files that are read as meshes.
MESHES = (".obj", ".off", ".ply", ".stl")

SOLIDS: Mapping[str, Callable[[], Node]] = {
    "sphere": fields.sphere,
    "cylinder": fields.cylinder,
    "box": fields.box,
    "cone": fields.cone,
    "torus": fields.torus,
    "capsule": lambda: fields.capsule((0.0, 0.0, -1.0), (0.0, 0.0, 1.0), 0.5),
    "half_space": fields.half_space,
}


@dataclass(frozen=True)
class Parameter:
    """A parameter of an operation.

    Attributes
    ----------
    name : str
        Its name.
    kind : {"number", "vector", "factor", "amount", "field"}
        One number, three, one or three, a number or an equation, an equation or a number.
    """

    name: str
    kind: str = "number"


@dataclass(frozen=True)
class Operation:
    """An operation on solids.

    Attributes
    ----------
    solids : int
        How many it takes from the stack.
    parameters : tuple of Parameter
        What follows it.
    apply : callable
        Takes the solids, and the parameters by name.
    """

    solids: int
    parameters: tuple[Parameter, ...]
    apply: Callable[..., Node]


def _smooth(function: Callable[..., Node]) -> Operation:
    return Operation(2, (Parameter("radius"),), function)


def _unary(function: Callable[..., Node], *parameters: Parameter) -> Operation:
    return Operation(1, parameters, function)


OPERATIONS: Mapping[str, Operation] = {
    "complement": _unary(fields.complement),
    "dilate": _unary(fields.dilate, Parameter("offset", "amount")),
    "erode": _unary(fields.erode, Parameter("offset", "amount")),
    "shell": _unary(fields.shell, Parameter("thickness", "amount")),
    "translate": _unary(fields.translate, Parameter("offset", "vector")),
    "scale": _unary(fields.scale, Parameter("factor", "factor")),
    "rotate": _unary(fields.rotate, Parameter("angle"), Parameter("axis", "vector")),
    "distance": _unary(distance),
    "normalize": _unary(fields.normalize),
    "twist": _unary(fields.twist, Parameter("rate")),
    "bend": _unary(fields.bend, Parameter("radius")),
    "repeat": _unary(fields.repeat, Parameter("period", "factor")),
    "cylindrical": _unary(fields.cylindrical, Parameter("count")),
    "union": Operation(2, (), fields.union),
    "intersection": Operation(2, (), fields.intersection),
    "difference": Operation(2, (), fields.difference),
    "smooth_union": _smooth(fields.union),
    "smooth_intersection": _smooth(fields.intersection),
    "smooth_difference": _smooth(fields.difference),
    "mix": Operation(2, (Parameter("weight", "field"),), fields.mix),
}

#: Options and what follows them.
OPTIONS: Mapping[str, str] = {
    "-s": "spacing", "-o": "path", "--tol": "number", "--report": "path", "--slices": "number",
    "--table": "path", "--set": "text", "--memory": "number", "--dry-run": "", "--strict": "",
    "--remove-islands": "", "--allow-loss": "",
    "-h": "", "--help": "", "--version": "",
}  # fmt: skip


def key(name: str) -> str:
    """The form in which names are compared."""
    return name.lower().replace("-", "_")


def is_solid(name: str) -> bool:
    """Whether a name is that of a solid or a tile."""
    return key(name) in SOLIDS or find(name) is not None


def solid(name: str) -> Node | None:
    """The solid of a name, or None."""
    if key(name) in SOLIDS:
        return SOLIDS[key(name)]()
    row = find(name)
    return None if row is None else _tile(row.name)


@cache
def _tile(name: str) -> Node:
    """A tile of the catalogue, made once: cells of struts take a while."""
    return tiles.get(name).node


def known_names() -> list[str]:
    """All names of solids and operations, for suggestions."""
    found = [*SOLIDS, *OPERATIONS, *(n.lower() for n in tiles.names()), "p-surface", "d-surface"]
    return sorted(n.replace("_", "-") for n in found)
