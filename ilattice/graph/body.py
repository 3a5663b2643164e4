"""Solids of a cell that repeats: the exact field of a skeleton, sets of those, tiles, voxels.

Guarantees: spherical extrusions are the envelope of balls along the skeleton, to rounding, and
repeat exactly. Non-guarantees: sets of solids have the right sign everywhere, but are no distances
beside their edges; sheets are triangles, off the smooth surface as their edges are long.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ilattice._field import Field
from ilattice._geometry import grid_indices, grid_points
from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray
from ilattice._validate import Frozen, as_points
from ilattice.errors import GeometryError, InputError, PrecisionWarning
from ilattice.fields import difference, from_callable, intersection, union
from ilattice.fields.node import Node
from ilattice.graph.shapes import SAME, Shape
from ilattice.minimal.completion import PeriodicSurface, glued
from ilattice.tiles import SkeletonField, Tile
from ilattice.tiles.flattened import FlattenedField
from ilattice.tiles.skeleton import SPLINE_ERROR

#: Values above this are not needed where a sign is asked for.
_SIGN = 1e-9
#: Cells that a part of a skeleton may reach over.
MAX_CELLS = 8.0
#: Voxels along the edges of blocks of which one value may tell all signs.
_BLOCK = 8


@dataclass(frozen=True, eq=False, repr=False)
class SetField(Field, Frozen):
    """Union, intersection or difference of fields that repeat with the unit cube.

    Parameters
    ----------
    parts : sequence of fields
        As `SkeletonField`.
    kind : {"union", "intersection", "difference"}
        What is made of them; the first less the others.
    """

    parts: tuple[Any, ...]
    kind: str

    @cached_property
    def node(self) -> Node:
        """The field in the algebra of fields, not repeated."""
        leaves = [from_callable(p.node if isinstance(p, SetField) else p) for p in self.parts]
        if self.kind == "union":
            return union(*leaves)
        if self.kind == "intersection":
            return intersection(*leaves)
        others = leaves[1:]
        return difference(leaves[0], union(*others) if len(others) > 1 else others[0])

    def __call__(self, u: ArrayLike, /) -> FloatArray:
        """Values, shape (n,), at points ``u`` (n, 3) of the unit cube."""
        return self.node(u)

    def jet(self, u: ArrayLike, order: int = 2) -> tuple[FloatArray, ...]:
        """Value and derivatives, as those of `SkeletonField`."""
        return self.node.jet(u, order)

    def range(self, lo: ArrayLike, hi: ArrayLike) -> FloatArray:
        """Rigorous bounds (m, 2) of the values on boxes (m, 3)."""
        return self.node.range(lo, hi)

    def up_to(self, limit: float, u: ArrayLike) -> FloatArray:
        """Values as far as they are below a limit that is not negative."""
        u = as_points("u", u)
        if self.kind != "union":
            return np.minimum(self(u), limit)
        return np.min([p.up_to(limit, u) for p in self.parts], axis=0)

    def flattened(self, level: float = 0.0, reach: float | None = None) -> FlattenedField:
        """A smoother field with the same zero set, for splines; see `SkeletonField`."""
        return FlattenedField(self, level, self.thinnest if reach is None else reach)

    @property
    def repeats(self) -> tuple[bool, bool, bool]:
        """All axes."""
        return (True, True, True)

    @property
    def lipschitz(self) -> float:
        """Bound of the gradient."""
        return 1.0

    @property
    def thinnest(self) -> float:
        """A lower bound of all radii."""
        return float(min(p.thinnest for p in self.parts))

    @property
    def bounds(self) -> FloatArray:
        """The unit cube, shape (2, 3)."""
        return np.array([[0.0] * 3, [1.0] * 3])


@dataclass(frozen=True, eq=False, repr=False)
class Body(Frozen):
    """A solid in the unit cell.

    Attributes
    ----------
    field : SkeletonField or SetField
        Negative inside, repeated over the faces of the cell.
    shape : Shape or None
        The skeleton of an object.
    """

    field: Any
    shape: Shape | None = None

    @classmethod
    def of(cls, shape: Shape, extrusion: str) -> "Body":
        """Give a skeleton its volume."""
        if not shape.extent <= MAX_CELLS:
            raise InputError(
                f"skeleton must have parts that reach over at most {MAX_CELLS:g} cells, but one "
                f"is {shape.extent:.3g} long: scale it less"
            )
        body = cls(SkeletonField(list(shape.entities), faces="periodic"), shape)
        if extrusion == "normal" and body.rims:
            raise InputError(
                "extrusion along normals is made where it is the spherical one: of closed surfaces "
                f"of one thickness, but this skeleton has {body.rims}; take extrusion='spherical'"
            )
        return body

    @classmethod
    def joined(cls, bodies: "Sequence[Body]", kind: str) -> "Body":
        """Set of several."""
        return cls(SetField(tuple(b.field for b in bodies), kind))

    @cached_property
    def surface(self) -> PeriodicSurface | None:
        """The completed surface of an object that is nothing but sheets, or None."""
        if self.shape is None or not self.shape.sheets:
            return None
        if len(self.shape.struts) or len(self.shape.balls) or self.shape.bends:
            return None
        v, faces, _ = self.shape.triangles
        return glued(v, faces, np.ones(3))

    @property
    def rims(self) -> str:
        """Why extrusion along normals is another one than the spherical; empty if it is not."""
        if self.surface is None:
            return "lines"
        if self.half_thickness is None:
            return "a thickness that varies"
        return "" if self.surface.is_closed else "rims"

    @cached_property
    def half_thickness(self) -> float | None:
        """Half the thickness, where it is the same everywhere."""
        if self.shape is None:
            return None
        radii = self.shape.radii
        same = float(np.ptp(radii)) <= SAME * float(radii.max())
        return float(radii[0]) if same else None

    @property
    def objection(self) -> str:
        """Why the solid is no wall of a surface with two sides; empty if it is."""
        if self.surface is None:
            return "it is not made of surfaces alone"
        if self.half_thickness is None:
            return "its thickness varies"
        return self.surface.objection

    def tile(self, name: str) -> Tile:
        """The surface where that has two sides, else the solid."""
        if self.objection:
            return self.solid(name)
        assert self.surface is not None
        return self.surface.tile(name=name)

    def solid(self, name: str) -> Tile:
        """The solid as a tile, negative inside."""
        source = "procedural graph"
        tol = SPLINE_ERROR * self.field.thinnest
        tile = Tile(self.field, name=name, source=source, tol=tol, check=False)
        for n in (24, 64):
            a = (np.arange(n) + 0.37) / n
            u = grid_points(a, a, a)
            if (self.field.up_to(_SIGN, u) > 0.0).any():
                return tile
        raise GeometryError(f"solid {name!r} fills the cell: its thickness is too large")

    def voxels(self, count: int) -> AnyArray:
        """Whether the middles of voxels are inside, (count, count, count)."""
        out = np.zeros((count,) * 3, bool)
        starts = np.arange(0, count, _BLOCK)
        y, z = np.meshgrid(starts, starts, indexing="ij")
        for x in starts:
            blocks = np.stack([np.full(y.size, x), y.ravel(), z.ravel()], axis=1)
            self._fill(out, blocks)
        return out

    def _fill(self, out: AnyArray, blocks: IntArray) -> None:
        """Mark the voxels of blocks, and halve the blocks that the boundary may cross."""
        count, size = len(out), _BLOCK
        while len(blocks):
            middles = 0.5 * (blocks + np.minimum(blocks + size, count)) / count
            if size == 1:
                out[tuple(blocks.T)] = self.field.up_to(_SIGN, middles) < 0.0
                return
            reach = self.field.lipschitz * 0.5 * np.sqrt(3.0) * (size - 1) / count + _SIGN
            value = self.field.up_to(1.01 * reach, middles)
            full = blocks[value < -reach][:, None] + _corners(size)
            full = full[(full < count).all(axis=2)]
            out[tuple(full.T)] = True
            size //= 2
            blocks = (blocks[np.abs(value) <= reach][:, None] + size * _corners(2)).reshape(-1, 3)
            blocks = blocks[(blocks < count).all(axis=1)]


def warn_empty(voxels: AnyArray, name: str) -> None:
    """Warn of voxels none of which is inside.

    Parameters
    ----------
    voxels : (n, n, n) array
        Whether they are inside.
    name : str
        Name of the solid.
    """
    if not voxels.any():
        warnings.warn(
            f"no voxel of {len(voxels)} per edge has its middle in the solid {name!r}: it is "
            "empty, or thinner than they are; take more",
            PrecisionWarning,
            stacklevel=3,
        )


def _corners(size: int) -> IntArray:
    """Whole numbers of three coordinates below a size, (size³, 3)."""
    return grid_indices((size,) * 3)
