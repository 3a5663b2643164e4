"""Periodic surfaces: all images of a patch, joined.

Guarantees: images that coincide count once; vertices that agree up to whole cells have one label,
and Euler numbers are those of the surface in the cell whose opposite faces are glued.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ilattice._typing import FloatArray, IntArray
from ilattice._validate import FrozenCopies, read_only
from ilattice.errors import GeometryError, InputError
from ilattice.mesh import SurfaceMesh
from ilattice.minimal.disc import area_vectors, opposite_edges
from ilattice.minimal.symmetry import Group, wrapped
from ilattice.minimal.tile import signed_tile, warn_coarse
from ilattice.tiles import Tile

#: Most triangles of a completed surface.
MAX_FACES = 5_000_000
#: Vertices closer than this part of the shortest edge become one.
_JOINED = 0.2


@dataclass(frozen=True, eq=False, repr=False)
class PeriodicSurface(FrozenCopies):
    """A surface that repeats with a cell. Made by `MinimalPatch.completed`.

    Attributes
    ----------
    mesh : SurfaceMesh
        The images in one cell, joined in space; open where the surface leaves the cell.
    labels : (V,) array
        Numbers of the vertices up to shifts by whole cells.
    cell : (3,) array
        Edges of the cell.
    two_coloured : bool
        Whether the two sides of all parts are those of one inside and outside.
    """

    mesh: SurfaceMesh
    labels: IntArray
    cell: FloatArray
    two_coloured: bool = False
    _sharper: "Callable[[], tuple[PeriodicSurface, float]] | None" = None

    def __repr__(self) -> str:
        """Short form."""
        return (
            f"PeriodicSurface({len(self.mesh.faces)} triangles, area {self.area:.6g}, "
            f"Euler number {self.euler})"
        )

    @property
    def area(self) -> float:
        """Area per cell."""
        return self.mesh.area

    @cached_property
    def faces(self) -> IntArray:
        """Triangles by labels, shape (F, 3)."""
        faces: IntArray = read_only(self.labels[self.mesh.faces])
        return faces

    @cached_property
    def euler(self) -> int:
        """Euler number per cell."""
        edges = len(edge_table(self.faces)[0])
        return len(np.unique(self.faces)) - edges + len(self.faces)

    @cached_property
    def components(self) -> int:
        """Number of parts that hang together through edges, in the glued cell."""
        return len(np.unique(self._sides[0]))

    @property
    def is_closed(self) -> bool:
        """Whether every edge belongs to two triangles, up to whole cells."""
        return bool((edge_table(self.faces)[1] == 2).all())

    @property
    def is_orientable(self) -> bool:
        """Whether the surface has two sides in the glued cell."""
        return self._sides[1]

    @property
    def genus(self) -> int:
        """Number of handles per cell, summed over all parts.

        Raises
        ------
        GeometryError
            If the surface is open, or has one side only in this cell.
        """
        if not (self.is_closed and self.is_orientable):
            raise GeometryError(
                "genus needs a closed surface with two sides: in this cell it is "
                + ("one-sided; take a cell twice as large" if self.is_closed else "open")
            )
        return self.components - self.euler // 2

    @property
    def flux(self) -> FloatArray:
        """Sum of the area vectors, shape (3,): not zero if sides swap across the cell."""
        return 0.5 * area_vectors(self.mesh.vertices, self.mesh.faces).sum(axis=0)

    @property
    def separates(self) -> bool:
        """Whether the surface parts the repeated cell into an inside and an outside."""
        return not self.objection

    @cached_property
    def objection(self) -> str:
        """Why the surface does not separate the cell; empty if it does."""
        if not self.is_closed:
            counts = edge_table(self.faces)[1]
            return (
                f"it has {int((counts == 1).sum())} open edges and {int((counts > 2).sum())} "
                "with more than two triangles"
            )
        if not self.is_orientable:
            return "its sides swap from cell to cell; take a cell twice as large"
        if self.components > 1 and not self.two_coloured:
            return f"it falls into {self.components} parts, whose sides are not ordered"
        if np.abs(self.flux).max() > 1e-6 * self.area:
            return "it crosses the cell with one side always first; take a cell twice as large"
        return ""

    def tile(self, *, name: str = "minimal", spans: int | None = None) -> Tile:
        """The surface as the zero set of a tile, so that lattices take true offsets of it.

        Parameters
        ----------
        name : str
            Name of the tile.
        spans : int, optional
            Knot spans per axis of the periodic cubic spline; by default as many as the surface
            is resolved with.

        Returns
        -------
        Tile
            Near the surface its field is the signed distance, for a cell of length 1.

        Raises
        ------
        GeometryError
            If the surface does not separate the cell, see `objection`.

        Warns
        -----
        PrecisionWarning
            If the zero set is off the surface by more than 1e-4 of the cell, or vertices, before
            they are sharpened, by more than 5e-4 (see `MinimalPatch.sharpened`).
        """
        if self._sharper is None or self.objection:
            return signed_tile(self, name, spans)
        sharp, off = self._sharper()
        warn_coarse(off / float(self.cell.max()), name)
        return signed_tile(sharp if sharp.separates else self, name, spans)

    @cached_property
    def _sides(self) -> tuple[IntArray, bool]:
        """Part of every triangle, and whether all have two sides."""
        parts, flipped, orientable = _oriented(self.faces)
        if self.two_coloured:  # a part may be turned as a whole
            sums = np.bincount(parts, flipped) * (np.bincount(parts) - np.bincount(parts, flipped))
            return parts, orientable and not sums.any()
        return parts, orientable and not flipped.any()


def completed(
    v: FloatArray, faces: IntArray, group: Group, sides: IntArray | None = None, *,
    sharper: "Callable[[], tuple[FloatArray, IntArray, float]] | None" = None,
    tol: float | None = None,
) -> PeriodicSurface:  # fmt: skip
    """All images of a mesh, joined and oriented.

    Parameters
    ----------
    v : (V, 3) array
        Vertices.
    faces : (F, 3) array
        Triangles.
    group : Group
        The isometries, up to shifts by whole cells.
    sides : (G,) array, optional
        1 for isometries that keep the sides of the mesh, which is oriented, -1 for those that swap
        them; without it, neighbours are oriented alike, part by part.
    sharper : callable, optional
        Gives vertices and triangles nearer to the smooth surface, and how far `v` is off.
    tol : float, optional
        See `glued`.

    Returns
    -------
    PeriodicSurface
        The surface.

    Raises
    ------
    InputError
        If it would have too many triangles.
    """
    if len(group) * len(faces) > MAX_FACES:
        raise InputError(
            f"n must leave at most {MAX_FACES} triangles, but {len(group)} images of "
            f"{len(faces)} are {len(group) * len(faces)}: take fewer edges per side"
        )
    cell = group.cell
    x = np.einsum("gij,vj->gvi", group.matrices, v) + group.shifts[:, None, :]
    middle = x.mean(axis=1)
    x += (wrapped(middle, cell) - middle)[:, None, :]
    x = x.reshape(-1, 3)
    every = np.repeat(faces[None], len(group), axis=0)
    if sides is not None:
        turned = np.linalg.det(group.matrices) * sides < 0.0
        every[turned] = every[turned][:, :, ::-1]
    every = (every + len(v) * np.arange(len(group))[:, None, None]).reshape(-1, 3)
    out = glued(x, every, cell, oriented=sides is not None, tol=tol)
    return out if sharper is None else replace(out, _sharper=partial(_sharp, sharper, group))


def _sharp(sharper: Any, group: Group) -> tuple[PeriodicSurface, float]:
    """The images of a sharper mesh, and how far the first one is off."""
    v, faces, off = sharper()
    return completed(v, faces, group), off


def glued(
    x: FloatArray, every: IntArray, cell: FloatArray, *, oriented: bool = False,
    tol: float | None = None,
) -> PeriodicSurface:  # fmt: skip
    """The periodic surface of triangles some of which agree, or share edges, up to whole cells.

    Parameters
    ----------
    x : (V, 3) array
        Vertices.
    every : (F, 3) array
        Triangles; of those that coincide one is kept.
    cell : (3,) array
        Edges of the cell.
    oriented : bool
        Whether the triangles are oriented as they are wanted; else neighbours are oriented alike.
    tol : float, optional
        Distance up to which vertices become one; by default a fifth of the shortest edge.

    Returns
    -------
    PeriodicSurface
        All triangles that differ, joined.
    """
    if tol is None:
        tol = _JOINED * float(np.linalg.norm(opposite_edges(x, every), axis=2).min())
    labels = _labels(x, cell, tol)
    _, first = np.unique(np.sort(labels[every], axis=1), axis=0, return_index=True)
    every = every[np.sort(first)]
    x, every, labels = _joined(x, every, labels, cell)
    if not oriented:
        _, flipped, _ = _oriented(labels[every])
        every[flipped] = every[flipped][:, ::-1]
    mesh = SurfaceMesh._adopt(x, np.ascontiguousarray(every))
    return PeriodicSurface(mesh, read_only(labels), cell, oriented)


def _labels(x: FloatArray, cell: FloatArray, tol: float) -> IntArray:
    """Equal numbers for points that agree up to whole cells."""
    scale = float(cell.max())
    inside = np.mod(x, cell) / scale
    inside = np.where(inside >= cell / scale, 0.0, inside)
    pairs = cKDTree(inside, boxsize=cell / scale).query_pairs(tol / scale, output_type="ndarray")
    links = sparse.coo_array((np.ones(len(pairs), bool), pairs.T), shape=(len(x), len(x)))
    labels: IntArray = connected_components(links, directed=False)[1].astype(np.int64)
    return labels


def _joined(
    x: FloatArray, faces: IntArray, labels: IntArray, cell: FloatArray
) -> tuple[FloatArray, IntArray, IntArray]:
    """One vertex where several agree in space, at their mean; those without triangles go."""
    used = np.unique(faces)
    _, first = np.unique(labels[used], return_index=True)
    origin = np.zeros((int(labels.max()) + 1, 3))
    origin[labels[used[first]]] = x[used[first]]
    turns = np.rint((x[used] - origin[labels[used]]) / cell)
    keys = np.column_stack([labels[used], turns]).astype(np.int64)
    unique, number = np.unique(keys, axis=0, return_inverse=True)
    offsets = x[used] - origin[labels[used]] - turns * cell
    sums = np.stack([np.bincount(labels[used], o, len(origin)) for o in offsets.T], axis=1)
    mean = sums / np.maximum(np.bincount(labels[used], minlength=len(origin)), 1)[:, None]
    back = np.zeros(len(x), np.int64)
    back[used] = number.ravel()
    _, own = np.unique(unique[:, 0], return_inverse=True)
    points = origin[unique[:, 0]] + mean[unique[:, 0]] + unique[:, 1:] * cell
    return points, back[faces], own.ravel().astype(np.int64)


def edge_table(faces: IntArray) -> tuple[IntArray, IntArray, Any]:
    """Edges of triangles.

    Parameters
    ----------
    faces : (F, 3) array
        Corners.

    Returns
    -------
    edges : (E, 2) array
        Different edges.
    counts : (E,) array
        How many triangles each has.
    starts : tuple
        Number of the edge that each corner starts, shape (3 F,), and whether it runs upwards.
    """
    pairs = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    edges, which, counts = np.unique(
        np.sort(pairs, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    return edges, counts, (which.ravel(), pairs[:, 0] < pairs[:, 1])


def _oriented(faces: IntArray) -> tuple[IntArray, Any, bool]:
    """Parts, which triangles to turn over so that neighbours agree, and whether that works."""
    _, counts, (which, forward) = edge_table(faces)
    order = np.argsort(which, kind="stable")
    order = order[counts[which[order]] == 2].reshape(-1, 2)
    first, second = order[:, 0] // 3, order[:, 1] // 3
    swapped = forward[order[:, 0]] == forward[order[:, 1]]
    count = len(faces)
    rows = np.concatenate([first, first + count])
    columns = np.concatenate(
        [np.where(swapped, second + count, second), np.where(swapped, second, second + count)]
    )
    links = sparse.coo_array((np.ones(len(rows), bool), (rows, columns)), shape=(2 * count,) * 2)
    labels = connected_components(links, directed=False)[1]
    front, back = labels[:count], labels[count:]
    return np.minimum(front, back), front > back, bool((front != back).all())
