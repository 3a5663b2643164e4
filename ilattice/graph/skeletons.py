"""Nodes that are skeletons: lines, surfaces, and what moves, mirrors and groups them.

Guarantees: those of `ilattice.graph.nodes`.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ilattice._validate import (
    as_choice,
    as_flag,
    as_not_negative,
    as_real,
    as_triple,
    as_whole,
)
from ilattice.errors import GraphError, InputError
from ilattice.graph.nodes import (
    EdgeChain,
    Node,
    Vertex,
    as_direction,
    as_profile,
    as_three,
    ends_of,
    joined_way,
    node_of,
    nodes_of,
)
from ilattice.graph.volumes import region_data, region_of
from ilattice.minimal.region import MAX_FACES, Region

#: Thickness of lines and surfaces unless told otherwise, in parts of the cell.
THICKNESS = 0.02
#: Edges per side of a surface, and the most.
EDGES, MAX_EDGES = 16, 256
#: Middle of the unit cell.
CENTRE = (0.5, 0.5, 0.5)
SURFACES = ("conjugate", "mixed", "direct")


class Skeleton(Node):
    """What has a place in the cell and a thickness, but no volume yet: base of such nodes."""

    def mirrored(self, direction: Any, origin: Any = CENTRE, *, copy: bool = True) -> "Mirror":
        """The skeleton with its mirror image.

        Parameters
        ----------
        direction : str or array_like, shape (3,)
            "x", "y", "z" or the normal of the mirror.
        origin : array_like, shape (3,)
            A point of the mirror; by default the middle of the cell.
        copy : bool
            Whether to keep this skeleton beside its image.

        Returns
        -------
        Mirror
            The node.
        """
        return Mirror(self, direction, origin, copy)

    def moved(
        self, translation: Any = (0.0, 0.0, 0.0), *, angle: float = 0.0, axis: Any = "z",
        scale: Any = 1.0, origin: Any = CENTRE, copy: bool = False,
    ) -> "Transform":  # fmt: skip
        """The skeleton scaled, turned, then translated.

        Parameters
        ----------
        translation : array_like, shape (3,)
            Translation.
        angle : float
            Angle in radians.
        axis : str or array_like, shape (3,)
            Axis of the rotation.
        scale : float or array_like, shape (3,)
            Factors; thickness stays.
        origin : array_like, shape (3,)
            The point that scaling and turning leave where it is.
        copy : bool
            Whether to keep this skeleton beside its image.

        Returns
        -------
        Transform
            The node.
        """
        return Transform(self, translation, angle, axis, scale, origin, copy)

    def completed(self, within: Region) -> "Skeleton":
        """All images in the unit cell by mirrors in the faces of a bounding volume.

        Parameters
        ----------
        within : Region
            A cuboid of mirrors, the prism, or the tetrahedron with 48 copies, of which whole
            numbers fill the cell.

        Returns
        -------
        Skeleton
            The last of the mirror nodes.

        Raises
        ------
        GraphError
            For other volumes: mirrors are to be given one by one.
        """
        if not isinstance(within, Region):
            raise GraphError(
                self.word, f"completed needs a bounding volume as g.cuboid(), got {within!r:.80}"
            )
        data = region_data(within)
        size = np.array(data.get("size", [0.5] * 3))
        counts = np.rint(0.5 / size)
        ways: dict[str, tuple[Any, ...]] = {"cuboid": (), "prism": ((1, -1, 0),)}
        ways["tetrahedron"] = ((0, 1, -1), (1, -1, 0), (0, 1, -1))
        even = bool(np.abs(counts * size - 0.5).max() < 1e-9)
        if data["kind"] not in ways or data.get("copies", 48) != 48 or not even:
            raise GraphError(
                self.word,
                "completed needs a cuboid, prism or tetrahedron of mirrors of which whole numbers "
                f"fill the cell, got {within!r}",
            )
        out: Skeleton = self
        for direction in ways[data["kind"]]:
            out = out.mirrored(direction)
        for axis in range(3):
            out = out.mirrored("xyz"[axis], tuple(float(s) for s in size))
            step = 2.0 * float(size[axis]) * np.eye(3)[axis]
            for _ in range(int(counts[axis]) - 1):
                out = out.moved(tuple(step.tolist()), copy=True)
        return out


@dataclass(frozen=True, eq=False, repr=False)
class Line(Skeleton):
    """Beams along chains that make one way without branches.

    Parameters
    ----------
    chains : sequence of EdgeChain
        Each starts or ends where the one before it does. Two vertices at one place are a ball, of
        the largest thickness.
    thickness : float or sequence of (t, thickness)
        Diameter: one number, or values at shares t of the length from 0 to 1, linear between.
    """

    word: ClassVar[str] = "line"
    code: ClassVar[str] = "l"
    takes: ClassVar[tuple[str, ...]] = ("chains",)

    chains: Any
    thickness: Any = THICKNESS

    def _check(self) -> None:
        chains = nodes_of("chains", self.chains, EdgeChain, "chains")
        self._set(chains=chains, thickness=as_profile(self.thickness, 1))
        _ = self.steps

    @cached_property
    def steps(self) -> tuple[tuple[EdgeChain, bool], ...]:
        """Chains, and whether each is run through backwards."""
        return joined_way(self.chains)


@dataclass(frozen=True, eq=False, repr=False)
class Surface(Skeleton):
    """A surface over chains that make one closed loop.

    Parameters
    ----------
    chains : sequence of EdgeChain
        The loop.
    kind : {"conjugate", "mixed", "direct"}
        A minimal surface that meets the faces of the bounding volume at right angles, all along
        its boundary; one whose smooth sides slide on faces, while the others stay; or a soap film,
        or thin shell, over a fixed boundary.
    thickness : float or sequence of ((u, v), thickness)
        One number, or values at places of the regular polygon of the corners, see
        `ilattice.minimal.weights`.
    alpha : float
        Weight of bending, a squared length; for direct surfaces only.
    edges : int
        Edges per side of the triangles.
    within : Region, optional
        Bounding volume, where it is not that of the graph.
    """

    word: ClassVar[str] = "surface"
    code: ClassVar[str] = "s"
    takes: ClassVar[tuple[str, ...]] = ("chains",)

    chains: Any
    kind: str = "direct"
    thickness: Any = THICKNESS
    alpha: float = 0.0
    edges: int = EDGES
    within: Any = None

    def _check(self) -> None:
        chains = nodes_of("chains", self.chains, EdgeChain, "chains")
        self._set(
            chains=chains,
            kind=as_choice("kind", self.kind, SURFACES),
            thickness=as_profile(self.thickness, 2),
            alpha=as_not_negative("alpha", self.alpha) + 0.0,
            edges=as_whole("edges", self.edges, 2, MAX_EDGES),
            within=region_of(self.within),
        )
        if self.alpha > 0.0 and self.kind != "direct":
            raise InputError(f"alpha must be 0 for {self.kind} surfaces, got {self.alpha:g}")
        if self.within is not None and self.kind == "direct":
            raise InputError("within must be left out for direct surfaces: nothing of them slides")
        corners = self.corners
        if not 3 <= len(corners) <= MAX_FACES:
            raise InputError(f"chains must have 3 to {MAX_FACES} vertices, got {len(corners)}")

    @cached_property
    def steps(self) -> tuple[tuple[EdgeChain, bool], ...]:
        """Chains, and whether each is run through backwards."""
        steps = joined_way(self.chains)
        way = [v for chain, back in steps for v in ends_of(chain, back)]
        if way[0] is not way[-1]:
            raise InputError(
                "chains must form a simple closed loop, but the last one does not end where the "
                "first one starts"
            )
        return steps

    @cached_property
    def corners(self) -> tuple[Vertex, ...]:
        """Vertices around the loop, each once."""
        out: list[Vertex] = []
        for chain, back in self.steps:
            way = chain.way[::-1] if back else chain.way
            out += way[:-1]
        if len({id(v) for v in out}) < len(out):
            raise InputError("chains must form a simple closed loop, but meet a vertex twice")
        return tuple(out)


@dataclass(frozen=True, eq=False, repr=False)
class DualSurface(Skeleton):
    """The dual (adjoint) of a conjugate surface.

    Parameters
    ----------
    surface : Surface
        Of kind "conjugate".
    """

    word: ClassVar[str] = "dual"
    code: ClassVar[str] = "dual"
    takes: ClassVar[tuple[str, ...]] = ("surface",)

    surface: Any

    def _check(self) -> None:
        node_of("surface", self.surface, Surface, "a surface")
        if self.surface.kind != "conjugate":
            raise InputError(f"surface must be of kind 'conjugate', got {self.surface.kind!r}")


@dataclass(frozen=True, eq=False, repr=False)
class Mirror(Skeleton):
    """A skeleton reflected.

    Parameters
    ----------
    skeleton : Skeleton
        What is reflected.
    direction : str or array_like, shape (3,)
        Normal of the mirror, or "x", "y", "z".
    origin : array_like, shape (3,)
        A point of the mirror.
    copy : bool
        Whether the skeleton stays beside its image.
    """

    word: ClassVar[str] = "mirror"
    code: ClassVar[str] = "mirror"
    takes: ClassVar[tuple[str, ...]] = ("skeleton",)

    skeleton: Any
    direction: Any
    origin: Any = CENTRE
    copy: bool = True

    def _check(self) -> None:
        node_of("skeleton", self.skeleton, Skeleton, "a skeleton")
        self._set(
            direction=as_direction("direction", self.direction),
            origin=as_three("origin", self.origin),
            copy=as_flag("copy", self.copy),
        )


@dataclass(frozen=True, eq=False, repr=False)
class Transform(Skeleton):
    """A skeleton scaled and turned about an origin, then translated.

    Parameters
    ----------
    skeleton : Skeleton
        What is moved.
    translation : array_like, shape (3,)
        Translation.
    angle : float
        Angle of the rotation in radians.
    axis : str or array_like, shape (3,)
        Its axis.
    scale : float or array_like, shape (3,)
        Positive factors; thickness stays.
    origin : array_like, shape (3,)
        What scaling and turning leave where it is.
    copy : bool
        Whether the skeleton stays beside its image.
    """

    word: ClassVar[str] = "transform"
    code: ClassVar[str] = "t"
    takes: ClassVar[tuple[str, ...]] = ("skeleton",)

    skeleton: Any
    translation: Any = (0.0, 0.0, 0.0)
    angle: float = 0.0
    axis: Any = "z"
    scale: Any = (1.0, 1.0, 1.0)
    origin: Any = CENTRE
    copy: bool = False

    def _check(self) -> None:
        node_of("skeleton", self.skeleton, Skeleton, "a skeleton")
        scale = as_triple("scale", self.scale, positive=True)
        if not (scale.min() >= 1e-3 and scale.max() <= 1e3):
            raise InputError(f"scale must be from 0.001 to 1000, got {self.scale!r:.60}")
        shift = as_three("translation", self.translation)
        if not max(map(abs, shift)) <= 1e3:
            raise InputError(f"translation must be at most 1000, got {self.translation!r:.60}")
        self._set(
            translation=shift,
            angle=as_real("angle", self.angle) + 0.0,
            axis=as_direction("axis", self.axis),
            scale=tuple(float(s) for s in scale),
            origin=as_three("origin", self.origin),
            copy=as_flag("copy", self.copy),
        )


@dataclass(frozen=True, eq=False, repr=False)
class AssociateFamily(Skeleton):
    """Member cos(angle) first + sin(angle) second of the associate family of two surfaces.

    Parameters
    ----------
    first, second : Surface or DualSurface
        A conjugate surface and its dual, in either order.
    angle : float
        In radians.
    """

    word: ClassVar[str] = "associate"
    code: ClassVar[str] = "af"
    takes: ClassVar[tuple[str, ...]] = ("first", "second")

    first: Any
    second: Any
    angle: float = 0.0

    def _check(self) -> None:
        for name in ("first", "second"):
            node_of(
                name, getattr(self, name), (Surface, DualSurface), "a surface or a dual surface"
            )
        self._set(angle=as_real("angle", self.angle) + 0.0)
        one, two = self.first, self.second
        dual = [n.surface.digest for n in (one, two) if isinstance(n, DualSurface)]
        plain = [n.digest for n in (one, two) if isinstance(n, Surface)]
        if len(dual) != 1 or dual != plain:
            raise InputError(
                "first and second must belong to the same associate family: a conjugate surface "
                "and the dual surface of it"
            )

    @property
    def surface(self) -> Surface:
        """The surface that is no dual."""
        return self.first if isinstance(self.first, Surface) else self.second


@dataclass(frozen=True, eq=False, repr=False)
class Group(Skeleton):
    """Several skeletons as one.

    Parameters
    ----------
    skeletons : sequence of Skeleton
        At least one.
    """

    word: ClassVar[str] = "group"
    code: ClassVar[str] = "g"
    takes: ClassVar[tuple[str, ...]] = ("skeletons",)

    skeletons: Any

    def _check(self) -> None:
        self._set(skeletons=nodes_of("skeletons", self.skeletons, Skeleton, "skeletons"))


def thickened(nodes: Iterable[Node], thickness: float | None, factor: float) -> dict[int, Node]:
    """Nodes with another thickness of lines and surfaces.

    Parameters
    ----------
    nodes : iterable of Node
        Each after its inputs.
    thickness : float or None
        Of all; None for their own.
    factor : float
        What all are multiplied by.

    Returns
    -------
    dict of int to Node
        New nodes by the ``id`` of the old ones.
    """
    new: dict[int, Node] = {}
    for node in nodes:
        changes: dict[str, Any] = {}
        for name in node.takes:
            old = getattr(node, name)
            several = isinstance(old, tuple)
            changes[name] = tuple(new[id(n)] for n in old) if several else new[id(old)]
        if isinstance(node, (Line, Surface)):
            own = node.thickness if thickness is None else thickness
            changes["thickness"] = (
                own * factor if isinstance(own, float) else [(p, factor * d) for p, d in own]
            )
        new[id(node)] = replace(node, **changes) if changes else node
    return new
