"""Nodes that are solids, voxels, and properties of the material that repeats them.

Guarantees: those of `ilattice.graph.nodes`.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from ilattice._validate import as_choice, as_positive, as_real, as_whole
from ilattice.errors import InputError
from ilattice.graph.nodes import EdgeChain, Node, Vertex, node_of, nodes_of
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

#: Voxels per edge of the cell: by default, and at most.
RESOLUTION, MAX_RESOLUTION = 100, 512
EXTRUSIONS = ("spherical", "normal")
SETS = ("union", "intersection", "difference")


class Solid(Node):
    """What has a volume: base of such nodes."""

    @property
    def resolution(self) -> int:
        """Grid points per edge of the cell."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False, repr=False)
class Object(Solid):
    """A skeleton with its thickness: a solid.

    Parameters
    ----------
    skeleton : Skeleton
        The skeleton.
    resolution : int
        Voxels per edge of the cell, where voxels are made of it.
    extrusion : {"spherical", "normal"}
        All that is within half the thickness; or only along the normals, without round rims, of
        closed surfaces: creases, where images meet at an angle, are round all the same.
    """

    word: ClassVar[str] = "object"
    code: ClassVar[str] = "obj"
    takes: ClassVar[tuple[str, ...]] = ("skeleton",)

    skeleton: Any
    resolution: int = RESOLUTION
    extrusion: str = "spherical"

    def _check(self) -> None:
        node_of("skeleton", self.skeleton, Skeleton, "a skeleton")
        self._set(
            resolution=as_whole("resolution", self.resolution, 2, MAX_RESOLUTION),
            extrusion=as_choice("extrusion", self.extrusion, EXTRUSIONS),
        )


@dataclass(frozen=True, eq=False, repr=False)
class CSGBoolean(Solid):
    """Union, intersection, or the first less the others.

    Parameters
    ----------
    objects : sequence of Solid
        Two or more, of equal resolution.
    kind : {"union", "intersection", "difference"}
        What is made of them.
    """

    word: ClassVar[str] = "boolean"
    code: ClassVar[str] = "bool"
    takes: ClassVar[tuple[str, ...]] = ("objects",)

    objects: Any
    kind: str = "union"

    def _check(self) -> None:
        objects = nodes_of("objects", self.objects, Solid, "objects", 2)
        self._set(objects=objects, kind=as_choice("kind", self.kind, SETS))
        counts = sorted({o.resolution for o in objects})
        if len(counts) > 1:
            raise InputError(
                f"objects must have the same grid resolution, got {', '.join(map(str, counts))}"
            )

    @property
    def resolution(self) -> int:
        """That of the objects."""
        return int(self.objects[0].resolution)


@dataclass(frozen=True, eq=False, repr=False)
class Voxel(Node):
    """A solid as voxels, with its material.

    Parameters
    ----------
    solid : Solid
        The solid.
    young : float
        Young's modulus.
    poisson : float
        Poisson's ratio.
    density : float
        Mass per volume.
    """

    word: ClassVar[str] = "voxel"
    code: ClassVar[str] = "vox"
    takes: ClassVar[tuple[str, ...]] = ("solid",)

    solid: Any
    young: float = 1.0
    poisson: float = 0.3
    density: float = 1.0

    def _check(self) -> None:
        node_of("solid", self.solid, Solid, "an object or a Boolean of objects")
        poisson = as_real("poisson", self.poisson)
        if not -1.0 < poisson < 0.5:
            raise InputError(f"poisson must be above -1 and below 0.5, got {poisson:g}")
        self._set(
            young=as_positive("young", self.young),
            poisson=poisson + 0.0,
            density=as_positive("density", self.density),
        )


class Property(Node):
    """What is known of a material of many cells: base of such nodes."""

    voxel: Any


@dataclass(frozen=True, eq=False, repr=False)
class MaterialMatrix(Property):
    """The effective stiffness.

    Parameters
    ----------
    voxel : Voxel
        The solid.
    """

    word: ClassVar[str] = "stiffness"
    code: ClassVar[str] = "mat"
    takes: ClassVar[tuple[str, ...]] = ("voxel",)

    voxel: Any

    def _check(self) -> None:
        node_of("voxel", self.voxel, Voxel, "a voxel node")


@dataclass(frozen=True, eq=False, repr=False)
class PhononicBandgap(Property):
    """Frequencies at which no wave passes.

    Parameters
    ----------
    voxel : Voxel
        The solid.
    curves : int
        Number of dispersion curves.
    samples : int
        Wave vectors per edge of the path.
    tol : float
        Relative residual of the eigenvalue problems.
    """

    word: ClassVar[str] = "bandgap"
    code: ClassVar[str] = "pbg"
    takes: ClassVar[tuple[str, ...]] = ("voxel",)

    voxel: Any
    curves: int = 8
    samples: int = 8
    tol: float = 1e-4

    def _check(self) -> None:
        node_of("voxel", self.voxel, Voxel, "a voxel node")
        self._set(
            curves=as_whole("curves", self.curves, 1, 200),
            samples=as_whole("samples", self.samples, 1, 200),
            tol=as_positive("tol", self.tol),
        )


#: All types of nodes, by their words.
TYPES: dict[str, type[Node]] = {
    t.word: t
    for t in (
        Vertex, EdgeChain, Line, Surface, DualSurface, Mirror, Transform, AssociateFamily, Group,
        Object, CSGBoolean, Voxel, MaterialMatrix, PhononicBandgap,
    )
}  # fmt: skip
