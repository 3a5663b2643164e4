"""Conjugate gradients on periodic grids of voxels, preconditioned by a homogeneous one.

Of a homogeneous material forces and displacements differ by a matrix 3×3 per frequency, so that
transforms invert it exactly. The condition of a porous grid with it does not depend on the number
of voxels. Transforms are made in single precision, sums in double.

Guarantee: the same bits for any number of threads.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import fft

from ilattice._kernels import thread_count
from ilattice._progress import Progress, track
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.errors import ConvergenceError
from ilattice.homogenize import _kernels_voxel as kernels
from ilattice.linalg import _kernels_blocks as kb

#: Chunks of planes that forces are added up in.
CHUNKS = 32
#: Values up to which one thread transforms fastest.
SMALL = 1 << 16
#: Part of the first residual below which single precision preconditions no more.
ROUNDING = 1e-28


@dataclass(frozen=True, eq=False)
class VoxelGrid:
    """A periodic grid of voxels with the material of each.

    Attributes
    ----------
    phase : ndarray of int32, shape (n0, n1, n2)
        Row of `table` of every voxel.
    table : ndarray, shape (phases, 2, 6 or 36)
        Lamé constants, conductivities xx, yy, zz, yz, xz, xy, or stiffnesses, row by row.
    spacing : ndarray, shape (3,)
        Edges of voxels.
    reference : ndarray, shape (2 or 6,)
        Lamé constants, or conductivities, of the material that preconditions.
    """

    phase: AnyArray
    table: FloatArray
    spacing: FloatArray
    reference: FloatArray

    @property
    def m(self) -> int:
        """Components of the field."""
        return 1 if self.table.shape[1] == 6 else 3

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Of fields."""
        return (self.m, *self.phase.shape)

    @cached_property
    def _buffer(self) -> tuple[int, FloatArray]:
        """Planes per chunk, and scratch."""
        m, n0, n1, n2 = self.shape
        chunk = -(-n0 // min(CHUNKS, n0))
        return chunk, np.empty((-(-n0 // chunk), m, n1, n2))

    def forces(self, u: FloatArray) -> FloatArray:
        """Forces (m, n0, n1, n2) of a field of the same shape."""
        chunk, buffer = self._buffer
        out = np.empty(self.shape)
        h = (float(self.spacing[0]), float(self.spacing[1]), float(self.spacing[2]))
        kernels.forces(len(buffer), u, self.phase, self.table, h, chunk, buffer, out)
        kernels.add_planes(len(buffer), chunk, buffer, out)
        return out

    def load(self, stress: FloatArray) -> FloatArray:
        """Minus the forces of stresses (phases, m, 3), constant in every voxel."""
        out = np.zeros(self.shape)
        area = self.spacing.prod() / self.spacing
        for c in range(self.m):
            for a in range(3):
                s = (area[a] * stress[:, c, a])[self.phase]
                s = s - np.roll(s, 1, axis=a)
                for b in range(3):
                    if b != a:
                        s = 0.5 * (s + np.roll(s, 1, axis=b))
                out[c] += s
        return out

    @cached_property
    def _symbols(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Symbols of masses, slopes and both along the three directions, each (3, n)."""
        return symbols(np.array(self.phase.shape), self.spacing, np.zeros(3))

    def precondition(self, r: FloatArray) -> FloatArray:
        """Field of which the homogeneous grid has the forces r."""
        workers = thread_count() if r.size > SMALL else 1
        scale = float(np.abs(r).max()) or 1.0  # single precision has no room for all units
        z = fft.rfftn((r / scale).astype(np.float32), axes=(1, 2, 3), workers=workers)
        kernels.invert(z.shape[1], z, *self._symbols, self.reference / self._unit)
        out = fft.irfftn(z, s=self.phase.shape, axes=(1, 2, 3), workers=workers, overwrite_x=True)
        return np.multiply(out, scale / self._unit, dtype=np.float64)

    @cached_property
    def _unit(self) -> float:
        """Size of the entries of the reference in these units."""
        return float(np.abs(self.reference).max())


def symbols(
    shape: IntArray, spacing: FloatArray, shift: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Symbols of masses, slopes and both, each (3, n), of fields with a phase per voxel."""
    mass, slope, wave = np.zeros((3, 3, int(shape.max())))
    for a, (count, h, more) in enumerate(zip(shape.tolist(), spacing, shift, strict=True)):
        angle = 2.0 * np.pi * np.arange(count) / count + more
        mass[a, :count] = h * (2.0 + np.cos(angle)) / 3.0
        slope[a, :count] = 2.0 * (1.0 - np.cos(angle)) / h
        wave[a, :count] = np.sin(angle)
    return mass, slope, wave


Operator = Callable[[FloatArray], FloatArray]


@dataclass
class Descent:
    """What conjugate gradients came to.

    Attributes
    ----------
    x, residual : ndarray
        Solution, and forces less those of it.
    iterations : int
        Steps.
    left : float
        Residual in the norm of the preconditioner, relative to the first.
    """

    x: FloatArray
    residual: FloatArray
    iterations: int
    left: float


def descend(
    K: Operator, M: Operator, b: FloatArray, tol: float, steps: int, progress: Progress = None
) -> Descent:
    """Solve K x = b up to what translations do, until the preconditioned residual is tol.

    K may be singular, as that of voids without stiffness, where b has no forces either.
    """
    x, r = np.zeros_like(b), b.copy()
    z = M(r)
    rz = first = _dot(r, z)
    if not first > 0.0:
        return Descent(x, r, 0, 0.0)
    p = z.copy()
    bar = _digits(tol, progress)
    for k in range(1, steps + 1):
        q = K(p)
        pq = _dot(p, q)
        if not pq > 0.0:
            raise ConvergenceError("the stiffness of the voxels is not positive; check the phases")
        alpha = rz / pq
        kb.combine(p.size, alpha, p.ravel(), 1.0, x.ravel())
        kb.combine(q.size, -alpha, q.ravel(), 1.0, r.ravel())
        z = M(r)
        old, rz = rz, _dot(r, z)
        left = (max(rz, 0.0) / first) ** 0.5
        bar(left)
        if left <= tol or not rz > ROUNDING * first:
            return Descent(x, r, k, left)
        kb.combine(z.size, 1.0, z.ravel(), -alpha * _dot(z, q) / old, p.ravel())
    raise ConvergenceError(
        f"conjugate gradients stopped after {steps} iterations at a relative residual of "
        f"{left:.1e}, above tol = {tol:.1e}; allow more, or a softer contrast of the phases"
    )


def _dot(x: FloatArray, y: FloatArray) -> float:
    """Sum of products in fixed chunks."""
    y = y.ravel()
    return float(kb.dots(x.ravel(), y, y).sum(axis=0)[0])


def _digits(tol: float, progress: Progress) -> Callable[[float], None]:
    """What advances a bar to where a residual is."""
    bar: Iterator[int] = track(range(100), "solve", progress)
    next(bar)
    done = 0

    def show(left: float) -> None:
        nonlocal done
        part = np.log(max(left, 1e-300)) / np.log(tol)
        while done < min(100, int(100 * part)):
            done += 1
            next(bar, None)

    return show


def prolonged(c: FloatArray) -> FloatArray:
    """Field (m, 2 n0, 2 n1, 2 n2) that interpolates one (m, n0, n1, n2) on voxels twice as long."""
    for a in (1, 2, 3):
        shape = list(c.shape)
        shape[a] *= 2
        out = np.empty(shape)
        view = np.moveaxis(out, a, 0)
        row = np.moveaxis(c, a, 0)
        view[0::2], view[1::2] = row, 0.5 * (row + np.roll(row, -1, axis=0))
        c = out
    return c


def restricted(f: FloatArray) -> FloatArray:
    """Forces on voxels twice as long: the transpose of `prolonged`."""
    for a in (1, 2, 3):
        row = np.moveaxis(f, a, 0)
        odd = row[1::2]
        f = np.moveaxis(row[0::2] + 0.5 * (odd + np.roll(odd, 1, axis=0)), 0, a)
    return np.ascontiguousarray(f)
