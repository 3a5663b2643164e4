"""Kagome structures: of one simplex, of a mesh of simplices, and part by part.

Guarantees: numbers follow from closed formulas, so that any part can be made alone (`Blocks`); in
three dimensions the four corner tetrahedra are left out. Source: Definition 4 of the paper,
corrected: entries sum to 2 l + d - 2 with just one even, and none reaches 2 l - 1 in space.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import comb
from typing import Any

import numpy as np

from ilattice._geometry import CORNERS, grid_points
from ilattice._memory import need
from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice._validate import (
    Frozen,
    as_array,
    as_choice,
    as_counts,
    as_triple,
    as_whole,
    read_only,
)
from ilattice.cost import _kernels_kagome as kernels
from ilattice.cost._structure import Origin
from ilattice.cost.structure import CornerSharing
from ilattice.errors import GeometryError, InputError

#: Largest resolution: numbers of vertices stay below 2^31.
MAX_RESOLUTION = 1400
#: A regular tetrahedron in the unit cube, and an equilateral triangle of side 1.
TETRAHEDRON = read_only(np.array([(0.0, 0, 0), (1.0, 0, 1), (1.0, 1, 0), (0.0, 1, 1)]))
TRIANGLE = read_only(np.array([(0.0, 0.0), (1.0, 0.0), (0.5, np.sqrt(0.75))]))


def as_resolution(name: str, value: Any) -> int:
    """A resolution, or the error that says what it must be."""
    return as_whole(name, value, 2, MAX_RESOLUTION)


def integers_of(resolution: int, dim: int) -> IntArray:
    """Barycentric integers (n, d + 1) of the vertices, in their order."""
    n = resolution - 1
    count = comb(n + dim, dim)
    if dim == 2:
        out = np.empty((3 * count, 3), np.int64)
        kernels.vertices2(n, count, out)
    else:
        out = np.empty((4 * count - 12, 4), np.int64)
        kernels.vertices3(n, count, 1, out)
    return out


def simplices_of(resolution: int, dim: int) -> IntArray:
    """Corners (m, d + 1) of the simplices."""
    n = resolution - 1
    count = comb(n + dim, dim)
    if dim == 2:
        out = np.empty((resolution**2, 3), np.int64)
        kernels.simplices2(n, count, out)
    else:
        out = np.empty((count - 4 + comb(n + 2, 3), 4), np.int64)
        kernels.simplices3(n, count, 1, out)
    return out


def _corners(corners: ArrayLike | None, dim: int) -> FloatArray:
    if corners is None:
        return TRIANGLE if dim == 2 else TETRAHEDRON
    c = as_array("corners", corners, ndim=2)
    if c.shape != (dim + 1, dim):
        raise InputError(f"corners must have shape ({dim + 1}, {dim}), got {c.shape}")
    sides = c[1:] - c[0]
    widest = float(np.abs(sides).max())
    if not widest > 0.0 or abs(np.linalg.det(sides / widest)) <= 1e-12:
        raise InputError(f"corners must not be flat, got {c.tolist()!r:.160}")
    return c


def kagome(resolution: int, *, dim: int = 3, corners: ArrayLike | None = None) -> CornerSharing:
    """Kagome structure in a triangle or a tetrahedron.

    Parameters
    ----------
    resolution : int
        Simplices along an edge, l: 2 or more.
    dim : {2, 3}
        Dimension.
    corners : array_like, shape (d + 1, d), optional
        Corners of the simplex that is filled; default an equilateral triangle of side 1, or the
        regular tetrahedron in the unit cube, with edges of length sqrt(2).

    Returns
    -------
    CornerSharing
        In the plane 3 C(l + 1, 2) vertices and l² triangles; in space, where the four corner
        tetrahedra are left out, 4 C(l + 2, 3) - 12 vertices.

    Raises
    ------
    InputError
        For a resolution below 2 or too large, or corners of another shape, or in one line or plane.
    GeometryError
        If the corners are inverted.

    Examples
    --------
    >>> kagome(5)
    CornerSharing(51 tetrahedra, 128 vertices, 0 bars)
    """
    as_choice("dim", dim, (2, 3))
    c = _corners(corners, dim)
    return fill(c, np.arange(dim + 1)[None], resolution=resolution)


def fill(vertices: ArrayLike, simplices: ArrayLike, *, resolution: Any) -> CornerSharing:
    """Kagome structures in all simplices of a mesh, each by itself; `joined` makes them one.

    Parameters
    ----------
    vertices : array_like, shape (n, d)
        Vertices of the mesh.
    simplices : array_like of int, shape (c, d + 1)
        Its triangles or tetrahedra, all of one orientation: positive.
    resolution : int or array_like of int, shape (c,)
        Simplices along the edges of each.

    Returns
    -------
    CornerSharing
        With `origin`.

    Raises
    ------
    InputError
        For wrong shapes, numbers or resolutions.
    GeometryError
        If a simplex of the mesh is flat or inverted; the message names it.
    """
    mesh = CornerSharing(as_array("vertices", vertices), np.asarray(simplices))
    cells, x, dim = mesh.simplices, mesh.positions, mesh.dim
    if not len(cells):
        raise InputError("simplices must not be empty")
    _check_volumes(mesh)
    levels = np.asarray(resolution)
    if levels.ndim > 1 or (levels.ndim == 1 and len(levels) != len(cells)):
        raise InputError(
            f"resolution must be one number or one per simplex ({len(cells)},), "
            f"got shape {levels.shape}"
        )
    each = [as_resolution("resolution", r) for r in np.atleast_1d(levels).tolist()]
    each = each * len(cells) if len(each) == 1 else each
    total = sum((dim + 1) * comb(r + dim - 1, dim) for r in each)
    need(200.0 * total, f"a structure of {total} vertices", "use a lower resolution, or Blocks")
    made = {r: (integers_of(r, dim), simplices_of(r, dim)) for r in set(each)}
    places, rows, integers, owner, first = [], [], [], [], 0
    for i, r in enumerate(each):
        ints, corners = made[r]
        places.append((ints / (2 * r + dim - 2)) @ x[cells[i]])
        rows.append(corners + first)
        integers.append(ints)
        owner.append(np.full(len(ints), i))
        first += len(ints)
    origin = Origin(
        np.concatenate(integers), np.concatenate(owner), np.array(cells), np.array(each, np.int64)
    )
    return CornerSharing(np.concatenate(places), np.concatenate(rows), origin=origin)


def _check_volumes(mesh: CornerSharing) -> None:
    """Refuse simplices that are flat or inverted."""
    unit = float(np.ptp(mesh.positions, axis=0).max()) or 1.0
    size = (np.ptp(mesh.positions[mesh.simplices], axis=1).max(axis=1) / unit) ** mesh.dim
    v = CornerSharing(mesh.positions / unit, mesh.simplices).volumes
    bad = v <= 1e-12 * size
    if bad.any():
        i = int(np.argmax(bad))
        what = "inverted" if v[i] < -1e-12 * size[i] else "flat"
        raise GeometryError(
            f"simplices[{i}] {mesh.simplices[i].tolist()} is {what}: its volume is "
            f"{mesh.volumes[i]:.3g} "
            f"({int(bad.sum())} of {len(bad)} are so); swap two of its corners"
            if what == "inverted"
            else f"simplices[{i}] {mesh.simplices[i].tolist()} is flat: drop it"
        )


def divided_box(
    cells: Any = (1, 1, 1), *, lo: ArrayLike = (0.0, 0.0, 0.0), hi: ArrayLike = (1.0, 1.0, 1.0)
) -> tuple[FloatArray, IntArray]:
    """Tetrahedra that fill a box: five per cell, mirrored from cell to cell so that they meet.

    Parameters
    ----------
    cells : int or (3,) ints
        Cells per direction.
    lo, hi : array_like, shape (3,)
        Corners of the box, such as the domain of a map.

    Returns
    -------
    ndarray, shape (n, 3)
        Vertices, for `fill`.
    ndarray of int, shape (c, 4)
        Tetrahedra, positive. The middle one of each cell is regular if the cells are cubes.
    """
    counts = as_counts("cells", cells)
    need(1e3 * float(np.prod(counts)), f"{counts} cells", "use fewer")
    a, b = as_triple("lo", lo), as_triple("hi", hi)
    if not (a < b).all():
        raise InputError(f"hi must be above lo, got {a.tolist()} and {b.tolist()}")
    grid = grid_points(*[np.linspace(0, 1, n + 1) for n in counts])
    even = [(0, 3, 5, 6), (1, 0, 3, 5), (2, 0, 3, 6), (4, 0, 5, 6), (7, 3, 5, 6)]
    rows = []
    for at in np.ndindex(*counts):
        flip = np.array([sum(at) % 2, 0, 0])
        corner = np.array(at) + (CORNERS ^ flip)
        ids = np.ravel_multi_index(tuple(corner.T), tuple(n + 1 for n in counts))
        rows += [ids[list(t)] for t in even]
    tets = np.array(rows, np.int64)
    x = a + grid * (b - a)
    flipped = CornerSharing(x, tets).volumes < 0
    tets[flipped] = tets[flipped][:, [1, 0, 2, 3]]
    return x, tets


@dataclass(frozen=True, eq=False)
class Blocks(Frozen):
    """A Kagome structure in space that is never stored: its tetrahedra come block by block.

    Attributes
    ----------
    resolution : int
        Tetrahedra along an edge.
    corners : ndarray, shape (4, 3)
        Corners of the simplex that is filled.
    size : int
        Compositions along the sides of a block.
    """

    resolution: int
    corners: FloatArray = field(default_factory=lambda: TETRAHEDRON)
    size: int = 32

    def __post_init__(self) -> None:
        """Check the arguments."""
        put = object.__setattr__
        put(self, "resolution", as_resolution("resolution", self.resolution))
        corners = _corners(self.corners, 3)
        put(self, "corners", np.array(corners))
        put(self, "size", as_whole("size", self.size, 1, 256))
        super().__post_init__()

    @property
    def total(self) -> int:
        """Barycentric integers of a vertex sum to this."""
        return 2 * self.resolution + 1

    @property
    def vertices(self) -> int:
        """Number of vertices of the whole."""
        return 4 * comb(self.resolution + 2, 3) - 12

    def hull(self, lo: IntArray) -> FloatArray:
        """Corners of a box that holds a block.

        Parameters
        ----------
        lo : ndarray of int, shape (3,)
            Lower corner of the block, as iteration gives it.

        Returns
        -------
        ndarray, shape (8, 4)
            Barycentric integers.
        """
        n = self.resolution - 1
        lo = self._block(lo)
        hi = np.minimum(lo + self.size, n + 1)
        ends = np.stack([2 * lo, 2 * hi]).astype(np.float64)
        where = grid_points(*[[0, 1]] * 3)
        first = np.take_along_axis(ends, where, axis=0)
        return np.column_stack([first, self.total - first.sum(axis=1)])

    def __iter__(self) -> Iterator[IntArray]:
        """Lower corners (3,) of the blocks that hold tetrahedra."""
        n = self.resolution - 1
        for a in range(0, n + 1, self.size):
            for b in range(0, n + 1 - a, self.size):
                for c in range(0, n + 1 - a - b, self.size):
                    yield np.array([a, b, c])

    def edges(self, lo: IntArray) -> IntArray:
        """Edges of a block.

        Parameters
        ----------
        lo : ndarray of int, shape (3,)
            Lower corner of the block, as iteration gives it.

        Returns
        -------
        ndarray of int, shape (e, 2, 4)
            Barycentric integers of their ends.
        """
        n = self.resolution - 1
        lo = self._block(lo)
        hi = np.minimum(lo + self.size, n + 1)
        out = np.empty((2 * int(np.prod(hi - lo)), 5), np.int64)
        found = out[: kernels.block3(n, lo, hi, 1, out)]
        ends = found[:, None, :4] - found[:, None, 4:] * np.eye(4, dtype=np.int64)
        return np.asarray(ends[:, kernels.PAIRS3].reshape(-1, 2, 4))

    def places(self, integers: FloatArray | IntArray) -> FloatArray:
        """Positions of barycentric integers.

        Parameters
        ----------
        integers : ndarray, shape (..., 4)
            Integers that sum to `total`.

        Returns
        -------
        ndarray, shape (..., 3)
            Positions.
        """
        whole = as_array("integers", integers)
        if whole.ndim == 0 or whole.shape[-1] != 4:
            raise InputError(f"integers must have shape (..., 4), got {whole.shape}")
        return np.asarray((whole / self.total) @ self.corners)

    def _block(self, lo: IntArray) -> IntArray:
        """The lower corner of a block, checked."""
        corner = as_array("lo", lo)
        if (
            corner.shape != (3,)
            or (corner != np.rint(corner)).any()
            or ((corner < 0) | (corner >= self.resolution)).any()
        ):
            raise InputError(
                f"lo must be three whole numbers from 0 to {self.resolution - 1}, as iteration "
                f"gives them, got {lo!r:.80}"
            )
        return corner.astype(np.int64)
