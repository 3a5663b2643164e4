"""Discs of least, or stationary, area with a boundary that is fixed or slides.

Two steps of the cotangent iteration make the triangles fair, then Newton's method moves every
vertex along its normal (on the boundary: within what it may slide on) until the mean curvature
vanishes. Normals are kept once steps are short, so that the last steps converge quadratically.

Guarantees: what is returned has the stated residual, measured at the result; else a
`ConvergenceError` says what was reached. Non-guarantees: that no smaller surface exists.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from ilattice._typing import FloatArray, IntArray
from ilattice._validate import read_only
from ilattice.errors import ConvergenceError
from ilattice.minimal.disc import (
    area_hessian,
    area_vectors,
    cotangents,
    unit_rows,
    vertex_areas,
    vertex_normals,
)

#: Largest mean curvature, times the size of the surface, of what counts as solved.
TOLERANCE = 1e-8
#: Steps at most; chosen without measurements.
MAX_STEPS = 24
#: Up to this mean curvature, triangles may be so thin that rounding is all there is.
_ROUNDED = 1e-4
#: Steps longer than this part of the mean edge give new normals.
_SHORT = 0.05
#: Steps that even out triangles, before Newton's method; chosen without measurements.
_FAIR_STEPS = 2


@dataclass(frozen=True, eq=False)
class Motion:
    """Where the vertices may go.

    Attributes
    ----------
    projectors : (V, 3, 3) array
        Onto the directions in which a vertex is free: the identity, a plane, a line or zero.
    """

    projectors: FloatArray

    @classmethod
    def inside(cls, count: int, boundary: int) -> "Motion":
        """All vertices before the boundary are free, the others fixed.

        Parameters
        ----------
        count : int
            Number of vertices.
        boundary : int
            Number of the first vertex of the boundary.

        Returns
        -------
        Motion
            That of Plateau's problem.
        """
        p = np.zeros((count, 3, 3))
        p[:boundary] = np.eye(3)
        return cls(read_only(p))

    def directions(self, v: FloatArray, faces: IntArray) -> FloatArray:
        """One unit vector per vertex: the normal, as far as the vertex is free.

        Parameters
        ----------
        v : (V, 3) array
            Vertices.
        faces : (F, 3) array
            Corners.

        Returns
        -------
        (V, 3) array
            Directions; zero where a vertex is fixed.
        """
        n = vertex_normals(v, faces)
        free = np.einsum("vij,vj->vi", self.projectors, n)
        short = np.linalg.norm(free, axis=1) < 1e-3
        return unit_rows(np.where(short[:, None], 0.0, free))

    def basis(self) -> Any:
        """Free coordinates, as columns of a sparse (3 V, m) array."""
        values, vectors = np.linalg.eigh(self.projectors)
        vertex, column = np.nonzero(values > 0.5)
        rows = 3 * vertex[:, None] + np.arange(3)
        columns = np.repeat(np.arange(len(vertex)), 3)
        data = vectors[vertex, :, column].ravel()
        return sparse.coo_array(
            (data, (rows.ravel(), columns)), shape=(self.projectors.shape[0] * 3, len(vertex))
        ).tocsc()

    @property
    def is_fixed_or_free(self) -> bool:
        """Whether every vertex is free in all directions or in none."""
        trace = np.einsum("vii->v", self.projectors)
        return bool(((trace < 0.5) | (trace > 2.5)).all())


@dataclass(frozen=True, eq=False)
class Solved:
    """A stationary disc and what it took.

    Attributes
    ----------
    vertices : (V, 3) array
        Where the area is stationary.
    residual : float
        Largest mean curvature (mean of the two principal ones) times the size of the surface; above
        `TOLERANCE` only where rounding is, beside triangles with angles near 0.
    factorizations : int
        Sparse factorizations.
    """

    vertices: FloatArray
    residual: float
    factorizations: int


def factorized(matrix: Any) -> Any:
    """Factors of a symmetric sparse matrix.

    Parameters
    ----------
    matrix : sparse array
        Symmetric, in compressed columns.

    Returns
    -------
    object
        Its method ``solve`` takes right-hand sides.
    """
    return splu(
        sparse.csc_array(matrix), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}
    )


def fair_step(v: FloatArray, motion: Motion, matrix: Any) -> FloatArray:
    """Vertices that are harmonic for a given matrix.

    Parameters
    ----------
    v : (V, 3) array
        Vertices, of which the fixed ones stay.
    motion : Motion
        Where vertices may go.
    matrix : (V, V) sparse array
        Symmetric, positive semidefinite.

    Returns
    -------
    (V, 3) array
        The new vertices.
    """
    if motion.is_fixed_or_free:
        free = np.flatnonzero(motion.projectors[:, 0, 0] > 0.5)
        out = v.copy()
        rows = matrix[free]
        out[free] -= factorized(rows[:, free]).solve(rows @ v)
        return out
    basis = motion.basis()
    whole = sparse.kron(matrix, sparse.eye_array(3), format="csc")
    reduced = basis.T @ whole
    y = factorized(reduced @ basis).solve(reduced @ v.ravel())
    return v - (basis @ y).reshape(-1, 3)


def stationary(
    v: FloatArray,
    faces: IntArray,
    motion: Motion,
    *,
    what: str,
    directions: FloatArray | None = None,
    fairing: Motion | None = None,
    most: int = MAX_STEPS,
) -> Solved:
    """Surface of stationary area near a given one.

    Parameters
    ----------
    v : (V, 3) array
        Vertices to start from.
    faces : (F, 3) array
        Corners.
    motion : Motion
        Where vertices may go.
    what : str
        Name of the surface, for messages.
    directions : (V, 3) array, optional
        In which vertices move; then the result depends smoothly on where they start. By default
        normals, after steps that make triangles fair.
    fairing : Motion, optional
        Where vertices may go in steps that make triangles fair, by default the same.
    most : int
        Most steps.

    Returns
    -------
    Solved
        The surface, with its residual.

    Raises
    ------
    ConvergenceError
        If the mean curvature does not vanish; the message says what was reached.
    """
    newton = _Newton(v, faces, motion, directions)
    newton.fairing = motion if fairing is None else fairing
    for step in range(most):
        if newton.solved or newton.torn:
            break
        if (step < _FAIR_STEPS and directions is None) or not newton.step():
            if directions is not None:
                break
            newton.fair()
    if not newton.solved:
        raise ConvergenceError(
            f"{what} does not become minimal: after {newton.factorizations} steps its mean "
            f"curvature times its size is {newton.residual:.3g}, not {TOLERANCE:g}; it may not "
            "exist, or be torn: try another n, or a boundary that turns less"
        )
    return Solved(read_only(newton.v), newton.residual, newton.factorizations)


class _Newton:
    """The iteration: vertices, the directions in which they move, and the gradient."""

    def __init__(
        self, v: FloatArray, faces: IntArray, motion: Motion, directions: FloatArray | None
    ) -> None:
        self.v, self.faces, self.motion, self.fairing = v, faces, motion, motion
        self.size = float(np.linalg.norm(np.ptp(v, axis=0)))
        self.factorizations = 0
        self.torn = False  # triangles have collapsed
        self.kept = directions is not None
        self.fresh = directions is None
        if directions is not None:
            self.directions = directions
        self.free = np.einsum("vii->v", motion.projectors) > 0.5
        self.residual = np.inf
        self._look(v)

    def _look(self, v: FloatArray) -> None:
        """Take a surface, with new directions unless steps are short."""
        self.v = v
        if self.fresh:
            self.directions = self.motion.directions(v, self.faces)
        self.gradient, self.areas = self._gradient(v), vertex_areas(v, self.faces)
        self.residual = self._measured(self.gradient)

    def _gradient(self, v: FloatArray) -> FloatArray:
        g: FloatArray = np.einsum("vc,vc->v", self.directions, cotangents(v, self.faces) @ v)
        return g

    def _measured(self, gradient: FloatArray) -> float:
        if not self.areas.min() > 1e-14 * self.size**2:
            return float("inf")
        return 0.5 * self.size * float(np.abs(gradient / self.areas).max())

    @property
    def solved(self) -> bool:
        """Whether the mean curvature vanishes, or the gradient is what rounding leaves of it."""
        if not TOLERANCE < self.residual < _ROUNDED:
            return self.residual <= TOLERANCE
        rows = np.asarray(abs(cotangents(self.v, self.faces)).sum(axis=1)).ravel()
        rounding = np.finfo(float).eps * self.size * rows
        return bool((np.abs(self.gradient) <= rounding).all())

    def fair(self) -> None:
        """One step of the cotangent iteration."""
        self.factorizations += 1
        self.fresh = True
        matrix = cotangents(self.v, self.faces)
        try:
            v = fair_step(self.v, self.fairing, matrix)
        except RuntimeError:  # singular
            self.torn = True
            return
        away = np.abs(v - self.v).max() if np.isfinite(v).all() else np.inf
        self.torn = bool(away > 10.0 * self.size)
        if not self.torn:
            self._look(v)
            self.torn = not np.isfinite(self.residual)

    def step(self) -> bool:
        """One step of Newton's method; False if none makes the gradient smaller."""
        rows = np.flatnonzero(self.free & (self.directions != 0.0).any(axis=1))
        hessian = area_hessian(self.v, self.faces, self.directions)[rows][:, rows]
        self.factorizations += 1
        try:
            move = factorized(hessian).solve(-self.gradient[rows])
        except RuntimeError:
            return False
        if not np.abs(move).max(initial=0.0) < 1e3 * self.size:
            return False
        shift = np.zeros_like(self.v)
        shift[rows] = move[:, None] * self.directions[rows]
        return self._search(shift)

    def _search(self, shift: FloatArray) -> bool:
        """Go as far as the gradient shrinks and no triangle turns over."""
        edge = np.sqrt(self.areas.mean())
        length = float(np.linalg.norm(shift, axis=1).max())
        before, weight = area_vectors(self.v, self.faces), 1.0 / np.sqrt(self.areas)
        old = np.linalg.norm(weight * self.gradient)
        t = min(1.0, 4.0 * edge / max(length, 1e-300))
        for _ in range(6):
            v = self.v + t * shift
            upright = np.einsum("fc,fc->f", before, area_vectors(v, self.faces)).min() > 0.0
            if upright and np.linalg.norm(weight * self._gradient(v)) < (1.0 - 0.1 * t) * old:
                self.fresh = not self.kept and t * length > _SHORT * edge
                self._look(v)
                return True
            t *= 0.5
        return False
