"""Places and motions that are more than a name: patches of meshes, points, rigid-body modes.

Guarantees: points of a patch are those with their foot in a triangle, not beyond its rim; a force
at a point has that point for its line of action. Non-guarantee: fields under a force at a point
grow without bound under refinement.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ilattice._typing import AnyArray, FloatArray
from ilattice._validate import Frozen, as_array, read_only
from ilattice.cutfem.probe import NEAR
from ilattice.errors import GeometryError, InputError
from ilattice.mesh import SurfaceMesh
from ilattice.quadrature.rules import Quadrature

if TYPE_CHECKING:
    from ilattice.cutfem.assembly import Assembly

#: How far from a patch points of it may be, in its size; where it is curved, in its usual edge, per
#: angle between neighbouring triangles (chords are an eighth of that away from arcs) and at most.
FLAT, BENT, CURVED = 1e-5, 0.5, 0.25
#: Part of the angles that may be larger, as those at sharp edges are.
SHARP = 0.1
#: Distances, in the tolerance, that count as equal.
ALIKE = 1e-6


@dataclass(frozen=True, eq=False)
class Patch(Frozen):
    """Whether points are on triangles: a condition for regions.

    Attributes
    ----------
    mesh : SurfaceMesh
        Some faces of the solid, as `SurfaceMesh.select` takes them out of a mesh, or of its
        surroundings; of a closed mesh all of its surface counts.
    """

    mesh: SurfaceMesh

    @cached_property
    def tolerance(self) -> float:
        """How far from the triangles points may be."""
        x = np.asarray(self.mesh.vertices, np.float64)[self.mesh.faces]
        size = float(np.linalg.norm(np.ptp(x.reshape(-1, 3), axis=0)))
        edge = float(np.median(np.linalg.norm(x - np.roll(x, 1, axis=1), axis=2)))
        turns = _turns(x, np.asarray(self.mesh.faces))
        bent = float(np.quantile(turns, 1.0 - SHARP)) if len(turns) else 0.0
        return max(min(BENT * bent, CURVED) * edge, FLAT * size)

    def __call__(self, x: FloatArray) -> AnyArray:
        """Booleans, shape (n,)."""
        tol, v = self.tolerance, np.asarray(self.mesh.vertices, np.float64)
        near = ((x >= v.min(axis=0) - tol) & (x <= v.max(axis=0) + tol)).all(axis=1)
        away, rim = self._distances(x[near])
        found = np.zeros(len(x), bool)
        found[near] = (away <= tol) & ((rim > away + ALIKE * tol) | (away <= FLAT * tol))
        return found

    def away(self, x: FloatArray) -> FloatArray:
        """Distances (n,) of points from the triangles."""
        return self._distances(x)[0]

    def _distances(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distances (n,) of points from the triangles, and from their rim; infinite without."""
        surface = self.mesh.to_pyvista()
        rim = surface.extract_feature_edges(
            boundary_edges=True, feature_edges=False, manifold_edges=False,
            non_manifold_edges=False,
        )  # fmt: skip
        return _away(surface, x), _away(rim, x)


def _turns(x: FloatArray, faces: AnyArray) -> FloatArray:
    """Angles (e,) between triangles, corners x (n, 3, 3), at the edges that two of them share."""
    normals = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    pairs = np.flatnonzero((edges[order[1:]] == edges[order[:-1]]).all(axis=1))
    a, b = normals[order[pairs] // 3], normals[order[pairs + 1] // 3]
    across = np.linalg.norm(np.cross(a, b), axis=1)
    return np.asarray(np.arctan2(across, (a * b).sum(axis=1)))


def _away(data: Any, x: FloatArray) -> FloatArray:
    """Distances (n,) of points from the cells of a dataset of pyvista."""
    from vtkmodules.vtkCommonCore import reference
    from vtkmodules.vtkCommonDataModel import vtkStaticCellLocator

    if not data.n_cells:
        return np.full(len(x), np.inf)
    locator = vtkStaticCellLocator()
    locator.SetDataSet(data)
    locator.BuildLocator()
    foot: Any = [0.0] * 3
    cell: Any = reference(0)
    part: Any = reference(0)
    square: Any = reference(0.0)
    out = np.empty(len(x))
    for i, p in enumerate(x.tolist()):
        locator.FindClosestPoint(p, foot, cell, part, square)
        out[i] = square.get()
    return np.sqrt(out)


@dataclass(frozen=True, eq=False)
class Inside(Frozen):
    """Whether a field is not positive: a condition for regions."""

    field: Any

    def __call__(self, x: FloatArray) -> AnyArray:
        """Booleans, shape (n,)."""
        return np.asarray(self.field(x) <= 0.0)

    def away(self, x: FloatArray) -> FloatArray:
        """Values (n,) of the field, which are distances if it is one."""
        return np.asarray(self.field(x), np.float64)


@dataclass(frozen=True, eq=False)
class Spot(Frozen):
    """A point of the solid where a force acts.

    Attributes
    ----------
    x, u : ndarray, shape (3,)
        In space and in parameters.
    """

    x: FloatArray
    u: FloatArray

    def __str__(self) -> str:
        return f"point {np.round(self.x, 6).tolist()}"

    def rule(self, asm: "Assembly") -> Quadrature:
        """A rule in space of this point alone, of weight one.

        Parameters
        ----------
        asm : Assembly
            Functions on the parts that are held.

        Returns
        -------
        Quadrature
            With `parameters`.

        Raises
        ------
        GeometryError
            If the point is on a part that nothing holds.
        """
        u = self.u[None]
        element = asm.space.cells[asm.space.locate(u)]
        grid = asm.space.grid
        box = grid.boxes(element)
        beyond = np.maximum(box[:, :3] - u, u - box[:, :3] - box[:, 3:]) / box[:, 3:]
        if (beyond[:, ~np.array(grid.closed)] > NEAR).any():
            raise GeometryError(f"at={self.x.tolist()}: that part of the solid is held by nothing")
        return Quadrature(
            read_only(self.x[None]), np.ones(1), np.array([0, 1]), element, 0, grid,
            through=asm.through, parameters=read_only(u),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Motion(Frozen):
    """A small motion of a rigid body: ``translation + rotation x (x - about)``.

    Attributes
    ----------
    translation, rotation, about : ndarray, shape (3,)
        A vector, an axis times an angle in radians, and the point that is only translated.
    """

    translation: FloatArray
    rotation: FloatArray
    about: FloatArray

    def __call__(self, x: FloatArray) -> FloatArray:
        """Displacements, shape (n, 3)."""
        return self.translation + np.cross(self.rotation, x - self.about)

    def __str__(self) -> str:
        t, r, a = (
            "(" + ", ".join(f"{v:.5g}" for v in w) + ")"
            for w in (self.translation, self.rotation, self.about)
        )
        return f"{t} and a turn by {r} about {a}"


def as_vector(name: str, value: Any) -> FloatArray:
    """Three numbers.

    Parameters
    ----------
    name : str
        In messages.
    value : array_like, shape (3,)
        The numbers.

    Returns
    -------
    ndarray, shape (3,)
        Read-only.

    Raises
    ------
    InputError
        If they are not three.
    """
    a = as_array(name, value)
    if a.shape != (3,):
        raise InputError(f"{name} must be a vector of 3 numbers, got {value!r:.80}")
    return read_only(a.copy())
