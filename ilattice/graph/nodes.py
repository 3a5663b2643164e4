"""Nodes of the procedural graph: what they take, their properties, and their rules.

Nodes hold the nodes that they take, so that graphs made in Python have no cycles. Equal content has
an equal `digest`, whoever made it. What a node may be connected with and what holds for its own
properties is checked here; rules that need the bounding volume are `Graph`'s.

Guarantees: frozen; a node that exists keeps the rules of Table 1 that can be seen without its
bounding volume; else a `GraphError` names the node and the rule. Source: Makatura et al.,
Procedural metamaterials, 2023, Table 1.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from hashlib import blake2b
from typing import Any, ClassVar

import numpy as np

from ilattice._shown import one_line
from ilattice._typing import FloatArray
from ilattice._validate import (
    Frozen,
    as_array,
    as_choice,
    as_flag,
    as_items,
    as_positive,
    as_real,
    as_triple,
)
from ilattice.errors import GraphError, InputError
from ilattice.graph.volumes import region_data
from ilattice.minimal.region import Region

#: Vertices of one node at most.
MAX_VERTICES = 10_000
AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True, eq=False, repr=False)
class Node(Frozen):
    """Base of all nodes of a graph."""

    word: ClassVar[str] = "node"
    code: ClassVar[str] = "n"
    #: Fields that are nodes.
    takes: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        """Check the rules of the node."""
        try:
            self._check()
        except GraphError:
            raise
        except InputError as e:
            raise GraphError(self.word, str(e)) from e
        super().__post_init__()

    def _check(self) -> None:
        """Raise for what breaks a rule."""

    def _set(self, **values: Any) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def inputs(self) -> "tuple[Node, ...]":
        """The nodes that this one takes, in order."""
        out: list[Node] = []
        for name in self.takes:
            value = getattr(self, name)
            out += value if isinstance(value, tuple) else [value]
        return tuple(out)

    @property
    def properties(self) -> dict[str, Any]:
        """Properties as plain data, as files have them."""
        names = (f.name for f in fields(self) if f.name not in self.takes)
        return {name: _plain(getattr(self, name)) for name in names}

    @cached_property
    def digest(self) -> str:
        """Digest of type, properties and inputs; without recursion, as graphs may be long."""
        waiting: list[Node] = [self]
        while waiting:
            node = waiting[-1]
            new = [n for n in node.inputs if "digest" not in n.__dict__]
            if new:
                waiting += new
            elif waiting.pop() is not self:
                _ = node.digest
        told = [self.word, self.properties, [node.digest for node in self.inputs]]
        text = json.dumps(told, sort_keys=True, separators=(",", ":"))
        return blake2b(text.encode(), digest_size=16).hexdigest()

    def __repr__(self) -> str:
        """Short form."""
        told = ", ".join(f"{k}={v!r:.30}" for k, v in self.properties.items())
        return one_line(f"{type(self).__name__}({told})")


def _plain(value: Any) -> Any:
    """A property as JSON has it; -0 is 0."""
    if isinstance(value, Region):
        return region_data(value)
    if isinstance(value, (tuple, list)):
        return [_plain(v) for v in value]
    if isinstance(value, float):
        return value + 0.0
    return value


def nodes_of(name: str, value: Any, kind: type, what: str, least: int = 1) -> tuple[Any, ...]:
    """Nodes of one kind."""
    given = [value] if isinstance(value, Node) else as_items(name, value)
    if len(given) < least or not all(isinstance(v, kind) for v in given):
        wrong = [type(v).__name__ for v in given if not isinstance(v, kind)]
        raise InputError(
            f"{name} must be {'one' if least == 1 else least} or more nodes that are {what}, got "
            + (", ".join(wrong[:5]) if wrong else f"{len(given)}")
        )
    return tuple(given)


def node_of(name: str, value: Any, kind: Any, what: str) -> Any:
    """A node of one kind."""
    if not isinstance(value, kind):
        raise InputError(f"{name} must be {what}, got {value!r:.60}")
    return value


def as_three(name: str, value: Any) -> tuple[float, float, float]:
    """Three finite numbers."""
    x, y, z = (float(v) for v in as_triple(name, value))
    return x, y, z


def as_direction(name: str, value: Any) -> tuple[float, float, float]:
    """A vector, or the name of an axis."""
    if isinstance(value, str):
        return AXES[as_choice(name, value, list(AXES))]
    x, y, z = as_three(name, value)
    if not 1e-9 < max(abs(x), abs(y), abs(z)) < 1e9:
        raise InputError(f"{name} must be a vector that is not zero, got {value!r:.60}")
    return x, y, z


# --- topology ---------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, repr=False)
class Vertex(Node):
    """A point of the unit cube.

    Parameters
    ----------
    position : array_like, shape (3,)
        Where it is.
    """

    word: ClassVar[str] = "vertex"
    code: ClassVar[str] = "v"

    position: Any

    def _check(self) -> None:
        x = as_array("position", self.position, ndim=1)
        if x.shape != (3,) or not (np.abs(x - 0.5) <= 0.5 + 1e-9).all():
            raise InputError(f"position must be a point of the unit cube, got {x.tolist()!r:.80}")
        self._set(position=tuple(float(c) + 0.0 for c in x))


@dataclass(frozen=True, eq=False, repr=False)
class EdgeChain(Node):
    """A way along vertices without branches, open or closed.

    Parameters
    ----------
    vertices : sequence of Vertex
        At least two.
    order : sequence of int, optional
        Numbers of the vertices along the way; by default as given. A closed way ends where it
        starts.
    smooth : bool
        A natural cubic spline instead of straight lines; over three vertices a parabola. Closed
        ways have no corner, and those whose ends are whole cells apart go on smoothly in the next
        cell. As a side of a surface that slides, it may slide.
    """

    word: ClassVar[str] = "chain"
    code: ClassVar[str] = "e"
    takes: ClassVar[tuple[str, ...]] = ("vertices",)

    vertices: Any
    order: Any = None
    smooth: bool = False

    def _check(self) -> None:
        vertices = nodes_of("vertices", self.vertices, Vertex, "vertices", 2)
        count = len(vertices)
        if count > MAX_VERTICES:
            raise InputError(f"vertices must be at most {MAX_VERTICES}, got {count}")
        order = tuple(range(count)) if self.order is None else tuple(as_items("order", self.order))
        if not all(type(k) is int and 0 <= k < count for k in order) or len(order) < 2:
            raise InputError(f"order must be numbers 0 to {count - 1}, two or more, got {order!r}")
        inner = order[:-1] if order[0] == order[-1] else order
        if len(set(inner)) < len(inner) or set(inner) != set(range(count)):
            raise InputError(
                f"order must visit every vertex once, but for a last one that is the first, got "
                f"{order!r:.80}: a way with branches is several chains"
            )
        if len(inner) < 2:
            raise InputError("order must visit two vertices or more")
        self._set(vertices=vertices, order=order, smooth=as_flag("smooth", self.smooth))

    @property
    def closed(self) -> bool:
        """Whether it ends at the vertex where it starts."""
        return bool(self.order[0] == self.order[-1])

    @property
    def way(self) -> tuple[Vertex, ...]:
        """Vertices in order, of closed ways the first again."""
        return tuple(self.vertices[k] for k in self.order)

    @property
    def points(self) -> FloatArray:
        """Their positions, shape (n, 3)."""
        return np.array([v.position for v in self.way])


# --- ways and thickness ----------------------------------------------------------------------


def ends_of(chain: EdgeChain, back: bool) -> tuple[Vertex, Vertex]:
    """First and last vertex of a chain."""
    first, last = chain.way[0], chain.way[-1]
    return (last, first) if back else (first, last)


def joined_way(chains: Sequence[EdgeChain]) -> tuple[tuple[EdgeChain, bool], ...]:
    """Chains as one way: each with whether it is run through backwards.

    Parameters
    ----------
    chains : sequence of EdgeChain
        In the order of the way.

    Returns
    -------
    tuple of (EdgeChain, bool)
        The way.

    Raises
    ------
    InputError
        If one does not go on where the one before it ends, or the way meets itself.
    """
    if len(chains) > 1 and any(c.closed for c in chains):
        raise InputError("chains must form a single branch-free path: a closed one stands alone")
    for start in (False, True):
        steps = [(chains[0], start)]
        for chain in chains[1:]:
            at = ends_of(*steps[-1])[1]
            if at is chain.way[0]:
                steps.append((chain, False))
            elif at is chain.way[-1]:
                steps.append((chain, True))
            else:
                break
        if len(steps) == len(chains):
            break
    else:
        raise InputError(
            "chains must form a single branch-free path: each has to go on from the vertex at "
            "which the one before it ends"
        )
    way = [v for chain, back in steps for v in (chain.way[::-1] if back else chain.way)[1:]]
    if len({id(v) for v in way}) < len(way):
        raise InputError("chains must form a single branch-free path, but meet a vertex twice")
    return tuple(steps)


def as_profile(value: Any, dim: int) -> Any:
    """A thickness: one positive number, or places with numbers, as tuples."""
    if not isinstance(value, (list, tuple, np.ndarray)):
        return as_positive("thickness", value)
    rows: list[tuple[Any, float]] = []
    for row in as_items("thickness", value):
        pair = as_items("thickness", row)
        if len(pair) != 2:
            raise InputError(f"thickness must be pairs of place and thickness, got {row!r:.60}")
        thick = as_positive("thickness", pair[1])
        if dim == 1:
            t = as_real("thickness: t", pair[0])
            if not 0.0 <= t <= 1.0:
                raise InputError(f"thickness: t must be from 0 to 1, got {t:g}")
            rows.append((t + 0.0, thick))
        else:
            uv = as_array("thickness: (u, v)", pair[0], ndim=1)
            if uv.shape != (2,) or not float(uv @ uv) <= 1.0 + 1e-9:
                raise InputError(f"thickness: (u, v) must be in the unit circle, got {pair[0]!r}")
            rows.append((tuple(float(c) + 0.0 for c in uv), thick))
    places = [p for p, _ in rows]
    if not rows or len(set(places)) < len(places) or len(rows) > 1000:
        raise InputError(f"thickness must have 1 to 1000 different places, got {len(rows)}")
    if dim == 1 and places != sorted(places):
        raise InputError("thickness: t must increase")
    return tuple(rows)
