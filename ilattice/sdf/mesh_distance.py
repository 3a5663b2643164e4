"""Triangle meshes as fields: the signed distance to any mesh, negative inside.

The nearest triangle is found in a tree of boxes. Its side is told by the angle-weighted normal of
the nearest face, edge or vertex (Baerentzen and Aanaes 2005), which is exact for closed, oriented
meshes without crossings; for all others, and where flat triangles leave it open, by the
generalised winding number (Jacobson et al. 2013; dipoles of Barill et al. 2018): inside is where
it exceeds one half.

Guarantees
----------
- The distance is exact up to rounding, for triangles of any shape: slivers and flat triangles
  cost no digits.
- `range` is rigorous: the distance is 1-Lipschitz.
- The same bits for any number of threads, and for a point alone or among others.

Not guaranteed
--------------
- A side for meshes with gaps: the winding number closes them in a reasonable way, and the field
  jumps there. A warning says so, ``strict=True`` refuses.
- Overlapping coplanar triangles do not count as crossings.
"""

import warnings
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ilattice._field import Field
from ilattice._shown import Shown, one_line
from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray
from ilattice._validate import Frozen, among, as_array, as_flag, as_points, read_only
from ilattice.errors import GeometryError, InputError, PrecisionWarning
from ilattice.fields._kernels_boxes import LEAF, build
from ilattice.mesh import SurfaceMesh
from ilattice.sdf import _kernels_bvh as kernels
from ilattice.sdf._triangles import normals_and_areas, twins

__all__ = ["ClosestPoints", "MeshDistance", "MeshFaults"]

#: Height of a triangle, as part of the largest coordinate, below which normals near it do not tell.
THIN = 1e-9
ON_MESH = 4e-15  # of the coordinates: points that are nearer to an edge have no side
#: Sizes of meshes of which products of three coordinates are numbers.
_LARGEST, _SMALLEST = 1e100, 1e-100


class ClosestPoints(NamedTuple):
    """Feet of points on a mesh.

    Attributes
    ----------
    points : (n, 3) array
        The nearest points of the mesh.
    faces : (n,) array
        Numbers of triangles that hold them; the least one where several do.
    distances : (n,) array
        Signed distances, negative inside.
    """

    points: FloatArray
    faces: IntArray
    distances: FloatArray

    def __repr__(self) -> str:
        return f"ClosestPoints({len(self.points)} points)"

    def __reduce__(self) -> tuple[Any, ...]:
        """For `pickle` and `copy`, which forget that arrays are read-only."""
        return _feet, tuple(self)


def _feet(*arrays: AnyArray) -> ClosestPoints:
    """Closest points with arrays that cannot be written to."""
    return ClosestPoints(*(read_only(a) for a in arrays))


@dataclass(frozen=True)
class MeshFaults(Shown):
    """What keeps a mesh from bounding a solid.

    Attributes
    ----------
    open_edges : int
        Edges of a single triangle.
    nonmanifold_edges : int
        Edges of three or more triangles.
    twisted_edges : int
        Edges whose two triangles disagree on which side is out.
    crossings : int
        Edges that go through another triangle; looked for only if there are no other faults.
    """

    open_edges: int
    nonmanifold_edges: int
    twisted_edges: int
    crossings: int

    def __bool__(self) -> bool:
        """Whether there are any."""
        counts = (self.open_edges, self.nonmanifold_edges, self.twisted_edges, self.crossings)
        return any(counts)

    def __str__(self) -> str:
        """All counts in words."""
        return (
            f"{self.open_edges} open, {self.nonmanifold_edges} non-manifold and "
            f"{self.twisted_edges} wrongly oriented edges, and {self.crossings} edges that cross "
            "other triangles"
        )


@dataclass(frozen=True)
class _Search:
    """Nearest triangles of points, in the order of the tree."""

    square: FloatArray
    face: IntArray
    feature: AnyArray
    foot: FloatArray
    height: FloatArray
    side: AnyArray

    @property
    def distance(self) -> FloatArray:
        return np.sqrt(self.square) * self.side


class MeshDistance(Field, Frozen):
    """Signed distance to a triangle mesh, a field like any other.

    Parameters
    ----------
    mesh : SurfaceMesh
        Any triangles. A closed, oriented mesh that is inside out is turned over, with a warning.
    strict : bool
        Refuse meshes that do not bound a solid, in place of a warning.

    Raises
    ------
    GeometryError
        Without triangles, with coordinates beyond 1e100 or all below 1e-100; with ``strict=True``
        also for meshes with open, non-manifold, wrongly oriented or crossing edges (the message
        counts them) and for those inside out.

    Warns
    -----
    PrecisionWarning
        The same faults without ``strict``.

    Examples
    --------
    >>> import ilattice as il
    >>> part = il.sdf.MeshDistance(il.mesh.load("part.stl"))  # doctest: +SKIP
    >>> part([[0.0, 0.0, 0.0]])  # doctest: +SKIP
    """

    def __init__(self, mesh: SurfaceMesh, *, strict: bool = False) -> None:
        if not isinstance(mesh, SurfaceMesh):
            raise InputError(f"mesh must be a SurfaceMesh, got {mesh!r:.80}; see il.mesh.load")
        if len(mesh.faces) == 0:
            raise GeometryError("mesh has no triangles: there is no distance to it")
        self._mesh = mesh
        corners = np.asarray(mesh.vertices, np.float64)[mesh.faces]
        self._bounds = read_only(np.stack([corners.min((0, 1)), corners.max((0, 1))]))
        self._scale = float(np.abs(self._bounds).max())
        if not _SMALLEST < self._scale < _LARGEST:
            raise GeometryError(
                f"the largest coordinate of the mesh is {self._scale:.3g}; scale it to "
                f"between {_SMALLEST:g} and {_LARGEST:g}"
            )
        self._plant(corners)
        self._faults = self._examine()
        self._turn = -1 if self._volume < 0.0 and not self._faults else 1
        self._judge(as_flag("strict", strict))
        if not self._faults:
            self._prepare_normals()
        self._sealed = True

    def __setattr__(self, name: str, value: Any) -> None:
        if "_sealed" in vars(self):
            raise AttributeError(f"MeshDistance is immutable: cannot set {name} to {value!r:.40}")
        super().__setattr__(name, value)

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"MeshDistance is immutable: cannot delete {name}")

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore from a pickle, which forgets that arrays are read-only."""
        super().__setstate__(state)
        read_only(self._bounds)

    # --- construction -------------------------------------------------------------------------

    def _plant(self, corners: FloatArray) -> None:
        """Build the tree, and lay the triangles out in the order of its leaves."""
        count = len(corners)
        order = np.arange(count)
        box, link = np.empty((2 * count, 6)), np.empty((2 * count, 3), np.int64)
        nodes = build(corners.min(axis=1), corners.max(axis=1), order, box, link, LEAF)
        self._box, self._link = box[:nodes].copy(), link[:nodes].copy()
        self._number = order
        normals, areas = normals_and_areas(corners[order])
        self._tri = np.concatenate([corners[order].reshape(-1, 9), normals], axis=1)
        self._corners = self._mesh.faces[order].astype(np.int64)
        self._thin = self._near_thin(corners[order], areas)
        self._moment = np.empty((nodes, 7))
        kernels.dipoles(self._box, self._link, self._tri, areas, self._moment)
        self._volume = float(areas @ np.einsum("fi,fi->f", normals, corners[order, 0])) / 3.0

    def _near_thin(self, corners: FloatArray, areas: FloatArray) -> AnyArray:
        """Triangles with a corner of one so thin that rounding decides which of them is nearest."""
        longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        thin = np.asarray(2.0 * areas <= THIN * self._scale * longest)
        touched = np.zeros(len(self._mesh.vertices), np.bool_)
        touched[self._corners[thin]] = True
        return np.asarray(touched[self._corners].any(axis=1))

    def _examine(self) -> MeshFaults:
        """Count what is wrong; crossings only if the topology is right."""
        topology = self._mesh.topology
        counts = (topology.open_edges, topology.nonmanifold_edges, topology.twisted_edges)
        crossings = np.zeros(len(self._tri), np.int64)
        if not any(counts):
            tree = (self._box, self._link, self._tri)
            kernels.crossings(len(crossings), *tree, self._corners, crossings)
        return MeshFaults(*counts, int(crossings.sum()))

    def _judge(self, strict: bool) -> None:
        """Warn of faults, or refuse them."""
        if self._faults:
            trouble = f"mesh has {self._faults}"
            remedy = "inside is where its winding number exceeds one half"
        elif self._turn < 0:
            trouble, remedy = "mesh is inside out", "its faces are turned over"
        else:
            return
        if strict:
            raise GeometryError(f"{trouble}; repair it, or allow it with strict=False")
        warnings.warn(f"{trouble}: {remedy}", PrecisionWarning, stacklevel=3)

    def _prepare_normals(self) -> None:
        """Angle-weighted normals and neighbours of a mesh without faults."""
        vertices = np.asarray(self._mesh.vertices, np.float64)
        self._normals = np.zeros_like(vertices)
        kernels.vertex_normals(vertices, self._corners, self._tri[:, 9:], self._normals)
        self._twin = twins(self._corners, len(vertices))

    # --- what it is ---------------------------------------------------------------------------

    @property
    def mesh(self) -> SurfaceMesh:
        """The mesh, as given."""
        return self._mesh

    @property
    def faults(self) -> MeshFaults:
        """What keeps the mesh from bounding a solid; false if nothing does."""
        return self._faults

    @property
    def bounds(self) -> FloatArray:
        """Bounding box of the triangles, shape (2, 3)."""
        return self._bounds

    def __repr__(self) -> str:
        """One line: the mesh, or its faults if there are any."""
        if self._faults:
            return f"MeshDistance({self._faults})"
        return one_line(f"MeshDistance({self._mesh!r})")

    def bounding_box(self, level: float = 0.0) -> FloatArray:
        """Box that holds where the field is at most `level`.

        Parameters
        ----------
        level : float
            The level; below zero the box is that of the mesh.

        Returns
        -------
        (2, 3) array
            Lower and upper corner.
        """
        margin = max(float(as_array("level", level, ndim=0)[0]), 0.0)
        return self._bounds + np.array([[-margin], [margin]])

    # --- values -------------------------------------------------------------------------------

    def __call__(self, p: ArrayLike, /) -> FloatArray:
        """Signed distance, shape (n,), at points ``p`` of shape (n, 3)."""
        return self._search(as_points("p", p)).distance

    def closest(self, p: ArrayLike, /) -> ClosestPoints:
        """Nearest points of the mesh.

        Parameters
        ----------
        p : (n, 3) array_like
            Points.

        Returns
        -------
        ClosestPoints
            Feet, triangles and signed distances.
        """
        found = self._search(as_points("p", p))
        return _feet(found.foot, self._number[found.face], found.distance)

    def jet(self, p: ArrayLike, order: int = 2) -> tuple[FloatArray, ...]:
        """Signed distance and derivatives.

        On the medial axis the derivatives are those of the nearest triangle of least number; on
        the mesh itself, to 1e-12 of the coordinates, the gradient is the normal of that triangle;
        on it exactly the Hessian is zero.

        Parameters
        ----------
        p : (n, 3) array_like
            Points.
        order : int
            0, 1 or 2.

        Returns
        -------
        tuple of array
            Value (n,), gradient (n, 3), Hessian (n, 3, 3): the first ``order + 1`` of them.
        """
        if not among(order, (0, 1, 2)):
            raise InputError(f"order must be 0, 1 or 2, got {order!r:.80}")
        points = as_points("p", p)
        found = self._search(points)
        value = found.distance
        if order == 0:
            return (value,)
        gradient = np.empty_like(points)
        kernels.gradients(
            points, found.square, found.face, found.feature, found.foot, found.height, found.side,
            self._tri, self._turn, gradient,
        )  # fmt: skip
        if order == 1:
            return value, gradient
        hessian = np.empty((len(points), 3, 3))
        kernels.hessians(
            found.square, found.face, found.feature, found.side, self._tri, gradient, hessian
        )
        return value, gradient, hessian

    def range(self, lo: ArrayLike, hi: ArrayLike) -> FloatArray:
        """Bounds of the field on boxes.

        Parameters
        ----------
        lo, hi : (m, 3) array_like
            Lower and upper corners.

        Returns
        -------
        (m, 2) array
            Lower and upper bounds: distance at the centre, less and plus half the diagonal. For
            meshes with open edges, where the sign may jump, the bounds hold for either sign.
        """
        low, high = as_points("lo", lo), as_points("hi", hi)
        if low.shape != high.shape or (low > high).any():
            raise InputError(f"lo and hi must be corners with lo <= hi, got {lo!r:.60}, {hi!r:.60}")
        middle = 0.5 * (low + high)
        radius = np.linalg.norm(high - middle, axis=1)
        radius += 1e-14 * (self._scale + np.abs(middle).max(axis=1, initial=0.0) + radius)
        value = self(middle)
        if self._jumps:
            value = np.abs(value)
            return np.stack([-value - radius, value + radius], axis=1)
        return np.stack([value - radius, value + radius], axis=1)

    def winding_number(self, p: ArrayLike, /) -> FloatArray:
        """Generalised winding number, exact up to rounding.

        Parameters
        ----------
        p : (n, 3) array_like
            Points.

        Returns
        -------
        (n,) array
            For closed meshes how often the mesh goes around each point, one inside and zero
            outside of a solid; between them near gaps of open meshes.
        """
        points = as_points("p", p)
        out = np.empty(len(points))
        tree = (self._box, self._link, self._tri)
        kernels.windings(len(points), points, *tree, self._moment, out)
        return out

    # --- how ----------------------------------------------------------------------------------

    @property
    def _jumps(self) -> bool:
        """Whether the sign may change away from the mesh: only for chains with a boundary."""
        f = self._faults
        return bool(f.open_edges or f.nonmanifold_edges or f.twisted_edges)

    def _search(self, points: FloatArray) -> _Search:
        n = len(points)
        found = _Search(
            np.empty(n), np.empty(n, np.int64), np.empty(n, np.int64), np.empty((n, 3)),
            np.empty(n), np.zeros(n, np.int64),
        )  # fmt: skip
        tree = (self._box, self._link, self._tri)
        kernels.closest(
            n, points, *tree, self._number, self._scale, found.square, found.face, found.feature,
            found.foot, found.height,
        )  # fmt: skip
        if not self._faults:
            kernels.sides_by_normals(
                n, points, found.square, found.face, found.feature, found.foot, found.height,
                self._tri, self._twin, self._corners, self._normals, self._scale,
                self._turn, found.side,
            )  # fmt: skip
            found.side[self._thin[found.face]] = 0
        slack = ON_MESH * (self._scale + np.abs(points).sum(axis=1))
        found.side[(found.side == 0) & (found.square <= slack**2)] = 1
        kernels.sides_by_winding(n, points, *tree, self._moment, self._turn, found.side)
        return found
