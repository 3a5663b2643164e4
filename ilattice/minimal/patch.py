"""`MinimalPatch`: one piece of a minimal surface, with its dual and the group that repeats it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np

from ilattice._typing import FloatArray, IntArray
from ilattice._validate import FrozenCopies, as_real, read_only
from ilattice.errors import ConvergenceError, GeometryError, InputError
from ilattice.mesh import SurfaceMesh
from ilattice.minimal.completion import PeriodicSurface, completed
from ilattice.minimal.disc import Disc, cotangents, opposite_edges, vertex_areas, vertex_normals
from ilattice.minimal.symmetry import Group, Isometry, generated

#: Moves of vertices by more than this part of the mean edge are no small errors.
_SMALL = 0.5
#: Generators of a group, and edges of the cell.
Symmetry = tuple[tuple[Isometry, ...], FloatArray]


@dataclass(frozen=True, eq=False)
class Report(FrozenCopies):
    """How a surface was found, and how good it is.

    Attributes
    ----------
    kind : str
        "conjugate", "direct", "mixed", "associate" or "dual".
    residual : float
        Largest mean curvature times size of the discrete surface that was solved for; of
        conjugates, that of the dual.
    factorizations : int
        Sparse factorizations, all starts included.
    evaluations : int
        Plateau problems.
    lengths : (N,) array
        Lengths of the sides of the dual polygon, of conjugates.
    gap : float
        Largest distance by which vertices of sides were moved into their planes.
    distortion : float
        Relative difference of the areas of a conjugate and its dual, which are equal but for the
        size of the triangles.
    """

    kind: str
    residual: float
    factorizations: int = 0
    evaluations: int = 1
    lengths: FloatArray = field(default_factory=lambda: read_only(np.zeros(0)))
    gap: float = 0.0
    distortion: float = 0.0


@dataclass(frozen=True, eq=False, repr=False)
class MinimalPatch(FrozenCopies):
    """A disc of a minimal surface. Made by `conjugate`, `direct` and `mixed`.

    Attributes
    ----------
    mesh : SurfaceMesh
        Vertices and triangles; a vertex of the finer mesh with twice as many edges lies at the
        same place, up to its error.
    disc : Disc
        How the triangles are numbered: sides, and edges per side.
    partner : (V, 3) array
        Vertices of the dual surface: equal triangles up to discretization, and equal normals.
    report : Report
        How it was found.
    """

    mesh: SurfaceMesh
    disc: Disc
    partner: FloatArray
    report: Report
    _symmetry: Symmetry | None = None
    _again: "Callable[[int], MinimalPatch] | None" = None

    def __repr__(self) -> str:
        """Short form."""
        return (
            f"MinimalPatch({self.report.kind}, {self.disc.sides} sides, n={self.disc.n}, "
            f"area {self.area:.6g})"
        )

    # ------------------------------------------------------------------ measures

    @property
    def vertices(self) -> FloatArray:
        """Vertices, shape (V, 3)."""
        return self.mesh.vertices

    @property
    def area(self) -> float:
        """Area of the triangles; off by some 1 / n² of it."""
        return self.mesh.area

    @cached_property
    def corners(self) -> FloatArray:
        """Corners, shape (N, 3)."""
        corners: FloatArray = read_only(self.vertices[self.disc.side_rows[:, 0]])
        return corners

    @cached_property
    def mean_curvature(self) -> FloatArray:
        """Mean of the principal curvatures at the vertices, shape (V,); zero on the boundary.

        That of the triangles as they are: for a conjugate it vanishes with their size only.
        """
        v, faces = self.vertices, self.disc.faces
        pull = np.einsum("vc,vc->v", cotangents(v, faces) @ v, vertex_normals(v, faces))
        h = 0.5 * pull / vertex_areas(v, faces)
        h[self.disc.boundary :] = 0.0
        return read_only(h)

    # ------------------------------------------------------------------ errors

    @cached_property
    def sharpened(self) -> "tuple[MinimalPatch, float]":
        """The surface nearer to the smooth one, and how far the vertices of this one are off.

        Errors of vertices shrink with the square of the edges: a third of the difference to the
        surface of half as many edges is what is left, and taken away. Tiles are made of this.
        Its triangles have a mean curvature, as those of exact points have.

        Returns
        -------
        patch : MinimalPatch
            With the vertices moved; this one where there is none of half as many edges, or where
            that is another surface.
        off : float
            Estimate of the largest distance of a vertex of this patch from the smooth surface; nan
            if there is none.
        """
        n = self.disc.n
        if self._again is None or n < 4:
            return self, float("nan")
        try:
            fine = self if n % 2 == 0 else self._again(n + 1)
            coarse = self._again(fine.disc.n // 2)
        except (ConvergenceError, GeometryError):
            return self, float("nan")
        move = (fine.vertices[fine.disc.nested] - coarse.vertices) / 3.0
        normals = vertex_normals(coarse.vertices, coarse.disc.faces)
        off = float(np.abs(np.einsum("vc,vc->v", move, normals)).max())
        edge = float(np.linalg.norm(opposite_edges(fine.vertices, fine.disc.faces), axis=2).mean())
        if np.linalg.norm(move, axis=1).max() > _SMALL * edge:
            return self, 3.0 * off
        x = fine.vertices + coarse.disc.finer(fine.disc.n, move)
        what = f"the {self.report.kind} surface"
        better = made(x, fine.disc, fine.partner, fine.report, symmetry=self._symmetry, what=what)
        return better, off

    # ------------------------------------------------------------------ relatives

    @property
    def dual(self) -> "MinimalPatch":
        """The dual (adjoint) surface: every tangent plane turned by 90 degrees."""
        return self._relative(self.partner, -self.vertices, "dual", _dual)

    def associate(self, phi: float) -> "MinimalPatch":
        """Member of the associate family: cos φ times this surface plus sin φ times its dual.

        Parameters
        ----------
        phi : float
            Angle in radians: 0 is this surface, π/2 its dual. The gyroid is at 38.01477 degrees
            from Schwarz D.

        Returns
        -------
        MinimalPatch
            With equal normals, areas up to discretization, and no known symmetry.
        """
        phi = as_real("phi", phi)
        c, s = np.cos(phi), np.sin(phi)
        x, y = self.vertices, self.partner
        return self._relative(
            c * x + s * y, c * y - s * x, "associate", partial(_associate, phi=phi)
        )

    def _relative(
        self, x: FloatArray, partner: FloatArray, kind: str, relative: Any
    ) -> "MinimalPatch":
        report = Report(kind, self.report.residual, self.report.factorizations)
        again = None if self._again is None else partial(_relative_again, relative, self._again)
        return made(
            x, self.disc, partner, report, symmetry=None, what=f"the {kind} surface", again=again
        )

    # ------------------------------------------------------------------ the whole

    def completed(self, group: Group | None = None) -> PeriodicSurface:
        """The periodic surface that a group of isometries makes of this one.

        Parameters
        ----------
        group : Group, optional
            By default that of the region of a conjugate.

        Returns
        -------
        PeriodicSurface
            All images, joined.

        Raises
        ------
        GeometryError
            If there is no group by default.
        InputError
            If `group` is none.
        """
        if group is None:
            if self._symmetry is None:
                raise GeometryError(
                    f"the {self.report.kind} surface has no symmetries that are known; give the "
                    "group, as il.minimal.generated([il.minimal.half_turn(...), ...], cell)"
                )
            group = generated(*self._symmetry)
        if not isinstance(group, Group):
            raise InputError(f"group must be a Group, got {group!r:.80}")
        return completed(self.vertices, self.disc.faces, group, sharper=self._sharper)

    def _sharper(self) -> tuple[FloatArray, IntArray, float]:
        """Vertices and triangles of the sharpened surface, and how far these are off."""
        patch, off = self.sharpened
        return patch.vertices, patch.disc.faces, off


def _dual(patch: MinimalPatch) -> MinimalPatch:
    return patch.dual


def _associate(patch: MinimalPatch, phi: float) -> MinimalPatch:
    return patch.associate(phi)


def _relative_again(relative: Any, again: Any, n: int) -> MinimalPatch:
    """A relative with other edges."""
    out: MinimalPatch = relative(again(n))
    return out


def made(
    x: FloatArray,
    disc: Disc,
    partner: FloatArray,
    report: Report,
    *,
    symmetry: Symmetry | None,
    what: str,
    again: "Callable[[int], MinimalPatch] | None" = None,
) -> MinimalPatch:
    """A patch of arrays, checked for triangles that have collapsed.

    Parameters
    ----------
    x, partner : (V, 3) array
        Vertices of the surface and of its dual.
    disc : Disc
        Triangles.
    report : Report
        How it was found.
    symmetry : tuple or None
        Generators of the group that repeats it, and edges of the cell.
    what : str
        Name, for messages.
    again : callable, optional
        Makes the same surface with another number of edges per side.

    Returns
    -------
    MinimalPatch
        The patch.

    Raises
    ------
    GeometryError
        If the surface has collapsed.
    """
    mesh: Any = SurfaceMesh._adopt(np.ascontiguousarray(x), disc.faces)
    if not mesh.area > 0.0 or not np.isfinite(mesh.area):
        raise GeometryError(f"{what} has collapsed to a curve or a point")
    return MinimalPatch(mesh, disc, read_only(np.array(partner)), report, symmetry, again)
