"""Evaluation of nodes: each once, for what it is rather than where it stands.

Results are kept by the digest of a node, which is that of all that it depends on, and of the
bounding volume: a graph that is evaluated again, or shares nodes with another one, computes what is
new.

Guarantees: no recursion, so that long graphs do no harm; sizes are counted before work. What cannot
be made raises a `GraphError` that names the node and says why.
"""

from collections import OrderedDict
from collections.abc import Iterable, Sequence
from hashlib import blake2b
from threading import RLock
from typing import Any

import numpy as np

from ilattice._typing import FloatArray
from ilattice.errors import GraphError, IlatticeError
from ilattice.graph.body import Body
from ilattice.graph.curves import shape_of
from ilattice.graph.nodes import Node
from ilattice.graph.patches import patch_of, sheet_of
from ilattice.graph.shapes import Shape
from ilattice.graph.skeletons import (
    AssociateFamily,
    DualSurface,
    Group,
    Line,
    Mirror,
    Skeleton,
    Surface,
    Transform,
)
from ilattice.graph.solids import CSGBoolean, Object, Solid
from ilattice.graph.volumes import region_data
from ilattice.minimal import MinimalPatch, Region
from ilattice.minimal.symmetry import reflection

#: Most pieces (beams, triangles) of a skeleton, and most results that are kept.
MAX_PIECES, MAX_KEPT = 1_000_000, 512
_kept: "OrderedDict[tuple[str, str], Any]" = OrderedDict()
_lock = RLock()
_counts = {"computed": 0}


def computed() -> int:
    """How many results of nodes have been computed, in this process, so far.

    Returns
    -------
    int
        Results that were at hand do not count.
    """
    return _counts["computed"]


def forget() -> None:
    """Drop all results that are kept."""
    with _lock:
        _kept.clear()


def kept(key: tuple[str, str], make: Any) -> Any:
    """The result with a key, made where there is none.

    Parameters
    ----------
    key : tuple of 2 str
        Digest, and what else the result depends on.
    make : callable
        Makes it.

    Returns
    -------
    object
        The result.
    """
    with _lock:
        if key in _kept:
            _kept.move_to_end(key)
            return _kept[key]
    made = make()
    with _lock:
        _counts["computed"] += 1
        _kept[key] = made
        while len(_kept) > MAX_KEPT:
            _kept.popitem(last=False)
    return made


def ordered(roots: Iterable[Node]) -> tuple[Node, ...]:
    """All nodes that some depend on, each after its inputs.

    Parameters
    ----------
    roots : iterable of Node
        The nodes.

    Returns
    -------
    tuple of Node
        Each once.
    """
    out: list[Node] = []
    seen: set[int] = set()
    for root in roots:
        stack = [(root, False)]
        while stack:
            node, left = stack.pop()
            if left:
                out.append(node)
            elif id(node) not in seen:
                seen.add(id(node))
                stack.append((node, True))
                stack += [(n, False) for n in reversed(node.inputs)]
    return tuple(out)


class Evaluation:
    """Results of the nodes of one graph in its bounding volume.

    Parameters
    ----------
    within : Region or None
        The bounding volume of the graph.
    names : mapping of int to str
        Names of nodes by their ``id``, for messages.
    sharp : bool
        Whether vertices of surfaces are corrected, see `ilattice.minimal.MinimalPatch.sharpened`.
    """

    def __init__(
        self, within: Region | None, names: dict[int, str], *, sharp: bool = False
    ) -> None:
        self.within, self.names, self.sharp = within, names, sharp
        data = "" if within is None else repr(region_data(within))
        self.place = blake2b(data.encode(), digest_size=8).hexdigest() + "sharp" * sharp

    def told(self, node: Node) -> str:
        """Name of a node in messages."""
        name = self.names.get(id(node), "")
        return f"{node.word} {name!r}" if name else node.word

    def of(self, node: Node) -> Any:
        """Result of a node: a `Shape` of a skeleton, a `Body` of a solid.

        Parameters
        ----------
        node : Node
            A skeleton or a solid.

        Returns
        -------
        Shape or Body
            What it makes.

        Raises
        ------
        GraphError
            If it cannot be made.
        """
        nodes = [n for n in ordered([node]) if isinstance(n, (Skeleton, Solid))]
        self._check_sizes(nodes)
        done: dict[int, Any] = {}
        for n in nodes:
            inputs = [done[id(i)] for i in n.inputs if id(i) in done]
            done[id(n)] = self._made(n, inputs)
        return done[id(node)]

    def _made(self, node: Node, inputs: list[Any]) -> Any:
        try:
            return kept((node.digest, self.place), lambda: self._result(node, inputs))
        except GraphError:
            raise
        except IlatticeError as e:
            raise GraphError(self.told(node), str(e)) from e

    def _result(self, node: Node, inputs: list[Any]) -> Any:
        """The result of a node from those of its inputs."""
        if isinstance(node, Line):
            return shape_of(node)
        if isinstance(node, (Surface, DualSurface, AssociateFamily)):
            patch, thickness = self._patch(node)
            patch = patch.sharpened[0] if self.sharp else patch
            return Shape(sheets=(sheet_of(patch, thickness),))
        if isinstance(node, (Mirror, Transform)):
            image = inputs[0].moved(*isometry(node))
            return inputs[0] + image if node.copy else image
        if isinstance(node, Group):
            out = Shape()
            for shape in inputs:
                out = out + shape
            return out
        if isinstance(node, Object):
            return Body.of(inputs[0], node.extrusion)
        assert isinstance(node, CSGBoolean)
        return Body.joined(inputs, node.kind)

    def _patch(self, node: Any) -> tuple[MinimalPatch, Any]:
        """Triangles of a surface, or of a relative of one, and the thickness."""
        if isinstance(node, Surface):
            region = node.within or self.within
            key = (f"patch {node.digest}", self.place)
            return kept(key, lambda: patch_of(node, region)), node.thickness
        patch, thickness = self._patch(node.surface)
        if isinstance(node, DualSurface):
            return patch.dual, thickness
        turned = node.first is not node.surface
        return patch.associate(0.5 * np.pi - node.angle if turned else node.angle), thickness

    def patch(self, node: Any) -> MinimalPatch:
        """The surface of a node that is one.

        Parameters
        ----------
        node : Surface, DualSurface or AssociateFamily
            The node.

        Returns
        -------
        MinimalPatch
            With its report.

        Raises
        ------
        GraphError
            If it cannot be made.
        """
        try:
            return self._patch(node)[0]
        except GraphError:
            raise
        except IlatticeError as e:
            raise GraphError(self.told(node), str(e)) from e

    def off(self, node: Node, wanted: float = 0.0) -> float:
        """How far vertices of the surfaces of a solid are off smooth ones, in parts of the cell.

        Parameters
        ----------
        node : Solid
            The solid.
        wanted : float
            Surfaces are passed over whose sides were moved by less than half of that into their
            planes: such are found to be off by at most twice as much. So are all that are no
            conjugates.

        Returns
        -------
        float
            Estimate of the largest distance; nan if there is none of one of them.
        """
        most = 0.0
        nodes = ordered([node])
        scale = dict.fromkeys(map(id, nodes), 0.0) | {id(node): 1.0}
        for n in reversed(nodes):
            own = max(n.scale) if isinstance(n, Transform) else 1.0
            own *= scale[id(n)]
            if isinstance(n, (Surface, DualSurface, AssociateFamily)):
                base = n if isinstance(n, Surface) else n.surface
                if own > 0.0 and own * self._patch(base)[0].report.gap >= 0.5 * wanted:
                    most = float(np.maximum(most, own * self._patch(n)[0].sharpened[1]))
                continue  # what it takes is not in the solid
            for i in n.inputs:
                scale[id(i)] = max(scale[id(i)], own)
        return most

    def _check_sizes(self, nodes: Sequence[Node]) -> None:
        """Refuse skeletons of too many pieces."""
        sizes: dict[int, int] = {}
        for node in nodes:
            inner = sum(sizes[id(i)] for i in node.inputs if id(i) in sizes)
            if isinstance(node, Surface):
                inner = len(node.corners) * node.edges**2
            elif isinstance(node, (DualSurface, AssociateFamily)):
                inner = len(node.surface.corners) * node.surface.edges**2
            elif isinstance(node, Line):
                inner = sum(len(c.order) for c in node.chains)
            elif isinstance(node, (Mirror, Transform)) and node.copy:
                inner *= 2
            sizes[id(node)] = inner
            if inner > MAX_PIECES:
                raise GraphError(
                    self.told(node),
                    f"a skeleton must have at most {MAX_PIECES} pieces, but this one has {inner}: "
                    "take fewer copies, or fewer edges per side",
                )


def isometry(node: Any) -> tuple[FloatArray, FloatArray]:
    """Matrix (3, 3) and shift (3,) of a mirror or transform.

    Parameters
    ----------
    node : Mirror or Transform
        The node.

    Returns
    -------
    tuple of ndarray
        ``x -> matrix x + shift``.
    """
    origin = np.array(node.origin)
    if isinstance(node, Mirror):
        direction = np.array(node.direction)
        mirror = reflection(direction, float(direction @ origin))
        return mirror.matrix, mirror.shift
    axis = np.array(node.axis) / np.linalg.norm(node.axis)
    K = np.cross(np.eye(3), axis)
    c, s = np.cos(node.angle), np.sin(node.angle)
    turn = np.eye(3) + s * K + (1.0 - c) * (K @ K)
    whole = np.rint(turn)
    turn = np.where(np.abs(turn - whole) < 1e-14, whole, turn)
    matrix = turn * np.array(node.scale)
    return matrix, origin - matrix @ origin + np.array(node.translation)
