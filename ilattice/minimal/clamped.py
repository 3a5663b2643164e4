"""Surfaces over fixed boundaries that go on smoothly where they are repeated.

A surface of least area over a curve in a mirror meets it at any angle, so that there is a crease
between it and its image. Here it is made to meet the mirror at right angles (or to go on into its
shifted copy) by a resistance against bending, ``area + layer² / 2 ∫ (2 H)² dA`` of the surface with
its images: mean curvatures H are solutions of a screened equation, and die out from the boundary
like ``exp(-distance / layer)``. Where the least surface is smooth across the boundary, H vanishes
and the layer does nothing.

Guarantees: the result is stationary to the stated residual, with normals and areas of vertices as
they are there, else a `ConvergenceError` says what was reached. Non-guarantee: derivatives of the
normals and areas in the bending term are left out (they are of higher order in H).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse

from ilattice._typing import FloatArray, IntArray
from ilattice._validate import read_only
from ilattice.errors import ConvergenceError
from ilattice.minimal.disc import (
    area,
    area_hessian,
    area_vectors,
    cotangents,
    unit_rows,
    vertex_areas,
    vertex_normals,
)
from ilattice.minimal.plateau import Motion, Solved, factorized, fair_step

#: Largest force per area, times the size, of what counts as solved.
TOLERANCE = 1e-6
#: Newton steps at most, and steps before that even out triangles; chosen without measurements.
MAX_STEPS, _FAIR_STEPS = 24, 2
#: Layer, in parts of the size, with which to begin where the wanted one does not get there, and
#: by how much thinner the next one is.
_STIFF, _THINNER = 0.06, np.sqrt(0.5)
#: Shifts of the Hessian, in parts of its diagonal, that are tried one after the other.
_SHIFTS = (0.0, 0.1, 1.0, 10.0)


@dataclass(frozen=True, eq=False)
class Rim:
    """How a surface goes on beyond its fixed boundary.

    Attributes
    ----------
    fixed : (V,) array of bool
        Vertices of the boundary.
    projectors : (V, 3, 3) array
        Onto the mirrors that vertices of the boundary lie in; the identity for others.
    labels : (V,) array
        Equal numbers for vertices that are the same one, shifted.
    """

    fixed: Any
    projectors: FloatArray
    labels: IntArray

    def directions(self, v: FloatArray, faces: IntArray) -> FloatArray:
        """Unit normals of the surface with its images.

        Parameters
        ----------
        v : (V, 3) array
            Vertices.
        faces : (F, 3) array
            Corners.

        Returns
        -------
        (V, 3) array
            Equal, up to their sign, for equal labels.
        """
        n = np.einsum("vij,vj->vi", self.projectors, vertex_normals(v, faces))
        first, rows = self._rows
        sign = np.where(np.einsum("vc,vc->v", n, n[first][rows]) < 0.0, -1.0, 1.0)
        parts = [np.bincount(rows, c) for c in (sign[:, None] * n).T]
        sums = np.stack(parts, axis=1, dtype=float)
        return unit_rows(sums)[rows]

    @cached_property
    def sums(self) -> Any:
        """Sparse (n, V) array that adds up what has one label."""
        rows = self._rows[1]
        at = (rows, np.arange(len(rows)))
        return sparse.coo_array((np.ones(len(rows)), at)).tocsr()

    @cached_property
    def _rows(self) -> tuple[IntArray, IntArray]:
        """First vertex of every label, and the number of the label of every vertex."""
        _, first, rows = np.unique(self.labels, return_index=True, return_inverse=True)
        return first, rows


def clamped(
    v: FloatArray, faces: IntArray, rim: Rim, layer: float, *, what: str, near: bool = False
) -> tuple[Solved, FloatArray]:
    """Surface near a given one that is stationary, and smooth across its boundary.

    Parameters
    ----------
    v : (V, 3) array
        Vertices to start from; those of the boundary stay.
    faces : (F, 3) array
        Corners.
    rim : Rim
        What happens at the boundary.
    layer : float
        Length over which mean curvatures die out; 0 for a surface of least area, with creases.
    what : str
        Name of the surface, for messages.
    near : bool
        Whether the given one is that of coarser triangles: it is not made fair first.

    Returns
    -------
    solved : Solved
        Vertices, with the residual.
    curvature : (V,) array
        Mean curvature (mean of the principal ones) of the surface with its images.

    Raises
    ------
    ConvergenceError
        If forces do not vanish, or triangles collapse.
    """
    problem = _Problem(v, faces, rim, layer)
    inside = Motion(np.where(rim.fixed[:, None, None], 0.0, np.eye(3)))
    steps = 0 if near else _FAIR_STEPS
    for _ in range(steps):
        problem.take(fair_step(problem.v, inside, cotangents(problem.v, faces)))
    start, count = problem.v, steps + problem.solve()
    if not problem.residual <= TOLERANCE and 0.0 < layer < _STIFF * problem.size:
        count += _thinned(problem, start, layer)
    if not problem.residual <= TOLERANCE:
        raise ConvergenceError(
            f"{what} does not become stationary: after {count} steps forces per area times its "
            f"size are {problem.residual:.3g}, not {TOLERANCE:g}; it may tear: take a larger "
            "layer, which stiffens it, or move the boundary"
        )
    return Solved(read_only(problem.v), problem.residual, count), problem.curvature


def _thinned(problem: "_Problem", start: FloatArray, layer: float) -> int:
    """Go from a stiff surface to the wanted one by thinner and thinner layers; factorizations."""
    good, wide, count = start, _STIFF * problem.size, 0
    while wide > layer:
        problem.weight = wide**2
        problem.take(good)
        count += problem.solve()
        if not problem.residual <= TOLERANCE:
            break
        good = problem.v
        wide *= _THINNER
    problem.weight = layer**2
    problem.take(good)
    return count + problem.solve()


class _Problem:
    """The iteration: vertices with their energy and forces."""

    def __init__(self, v: FloatArray, faces: IntArray, rim: Rim, layer: float) -> None:
        self.faces, self.rim, self.weight = faces, rim, layer**2
        self.sums, self.free = rim.sums, np.flatnonzero(~rim.fixed)
        self.size = float(np.linalg.norm(np.ptp(v, axis=0)))
        self.take(v)

    def take(self, v: FloatArray) -> None:
        """Look at a surface."""
        self.v, faces = v, self.faces
        self.directions = self.rim.directions(v, faces)
        self.areas = vertex_areas(v, faces)
        if not self.areas.min() > 1e-14 * self.size**2:
            self.residual = np.inf
            return
        self.masses = self.sums @ self.areas
        pull = np.einsum("vc,vc->v", self.directions, cotangents(v, faces) @ v)
        turn = (self.sums @ pull) / self.masses  # twice the mean curvature
        self.hessian = area_hessian(v, faces, self.directions).tocsr()
        self.forces = (pull + self.weight * (self.hessian @ (self.sums.T @ turn)))[self.free]
        self.energy = area(v, faces) + 0.5 * self.weight * float(turn**2 @ self.masses)
        self.curvature = 0.5 * (self.sums.T @ turn)
        self.residual = 0.5 * self.size * float(np.abs(self.forces / self.areas[self.free]).max())

    def solve(self) -> int:
        """Go on until forces vanish, or nothing gets better; returns the factorizations."""
        count = 0
        for _ in range(MAX_STEPS):
            if self.residual <= TOLERANCE or not np.isfinite(self.residual):
                break
            tried = self._step()
            count += abs(tried)
            if tried <= 0:
                break
        return count

    def _step(self) -> int:
        """One step of the method of Gauss and Newton: its factorizations, negative if in vain."""
        free = self.free
        rows = self.sums @ self.hessian[:, free]
        matrix = self.hessian[free][:, free]
        matrix = matrix + self.weight * (rows.T @ (sparse.diags_array(1.0 / self.masses) @ rows))
        scale = sparse.diags_array(np.abs(matrix.diagonal()))
        for tried, shift in enumerate(_SHIFTS, 1):
            try:
                move = factorized(matrix + shift * scale).solve(-self.forces)
            except RuntimeError:
                continue
            if np.abs(move).max(initial=0.0) < self.size:
                moved = np.zeros_like(self.v)
                moved[free] = move[:, None] * self.directions[free]
                if self._search(moved):
                    return tried
        return -len(_SHIFTS)

    def _search(self, shift: FloatArray) -> bool:
        """Go as far as energy or forces shrink and no triangle turns over."""
        start, before = self.v, area_vectors(self.v, self.faces)
        old = (self.energy, self.residual)
        length = float(np.linalg.norm(shift, axis=1).max())
        t = min(1.0, 4.0 * float(np.sqrt(self.areas.mean())) / max(length, 1e-300))
        for _ in range(6):
            v = start + t * shift
            if np.einsum("fc,fc->f", before, area_vectors(v, self.faces)).min() > 0.0:
                self.take(v)
                if self.residual < 0.9 * old[1] or self.energy < old[0] * (1.0 - 1e-12):
                    return True
            t *= 0.5
        self.take(start)
        return False
