"""Bands of waves in arrays of voxels: the second route, for tomograms and labels.

::

    il.homogenize.bloch_voxels(array, young=70e3, density=2.7e-9, path="GXM", count=6)

A wave u = exp(i k.x) v takes the phases of its nodes with it, so that trilinear voxels are those of
`voxels`, and nothing is assembled. Masses are lumped at the nodes. The preconditioner is a
homogeneous grid, inverted by Fourier transforms whose frequencies are shifted by the wave vector,
so that steps do not grow with the number of voxels. Voids have no nodes, and no waves of their own.

Guarantees: matrices are Hermitian; residuals are true; group velocities are derivatives of the
discrete frequencies. Non-guarantee: frequencies come neither from above nor from below, for masses
are lumped; `Bands.errors` are what changes on voxels twice as long, of mean material, and NaN where
numbers of voxels are odd; what voxels miss of a smooth geometry is not in them. Cut cells (`bloch`)
reach the same with far fewer unknowns where the geometry is known.
"""

import time
from functools import partial
from typing import Any

import numpy as np
from scipy import fft

from ilattice._memory import need
from ilattice._progress import Progress, track
from ilattice._typing import AnyArray, FloatArray
from ilattice._validate import as_array, as_whole, read_only
from ilattice.cutfem import _voigt
from ilattice.errors import InputError
from ilattice.homogenize import _kernels_voxel as kernels
from ilattice.homogenize._eigen import GUARD, MAX_VECTORS, Pairs, Pencil, Vectors, check, lowest
from ilattice.homogenize._estimate import warn_of_voxels
from ilattice.homogenize._matching import farthest, overlaps
from ilattice.homogenize._spectral import VoxelGrid, prolonged, symbols
from ilattice.homogenize.bands import Bands, BlochReport
from ilattice.homogenize.bloch import (
    as_residual,
    distinct,
    frequencies,
    rounded,
    velocities_of,
    warn_of_rounding,
)
from ilattice.homogenize.paths import path_of, reciprocal
from ilattice.homogenize.tensors import isotropic
from ilattice.homogenize.voxel import REMEDY, as_voxels, elastic_phases

#: Residual of waves on voxels twice as long.
COARSE = 1e-2
#: Vectors of the last wave vector that are taken on with random ones, so many.
FRESH = 2


class VoxelWaves:
    """Stiffness and mass of a periodic grid of voxels, for waves v of a wave vector.

    Parameters
    ----------
    phase : ndarray of int, shape (n0, n1, n2)
        Row of `table` of every voxel.
    table : ndarray, shape (phases, 2 or 36)
        Lamé constants, or stiffnesses; zero for voids.
    density : ndarray, shape (phases,)
        Mass per volume; zero for voids.
    size : ndarray, shape (3,)
        Edges of voxels.
    """

    def __init__(
        self, phase: AnyArray, table: FloatArray, density: FloatArray, size: FloatArray
    ) -> None:
        self.shape, self.size, self.density = np.array(phase.shape), size, density
        wide = np.full(self.shape + 1, len(table), np.int32)
        wide[:-1, :-1, :-1] = phase
        self.parts = np.bincount(phase.ravel(), minlength=len(table)) / phase.size
        mean = self.parts @ table
        if len(mean) == 36:
            K, G = _voigt.bulk_and_shear(mean.reshape(6, 6))
            mean = np.array([K - 2.0 * G / 3.0, G])
        self.reference = mean
        self.grid = VoxelGrid(wide, np.vstack([table, np.zeros_like(table[:1])]), size, mean)
        self.part = _least_part(table, mean)
        self.volume = float(size.prod())
        mass, there = density[phase], np.abs(table).max(axis=1)[phase] > 0
        for a in range(3):
            mass = 0.5 * (mass + np.roll(mass, 1, axis=a))
            there = there | np.roll(there, 1, axis=a)
        self.weights, self.there = self.volume * mass, there
        self.inertia = float(self.parts @ density)
        stiff = np.abs(table).sum(axis=1)[phase]
        for a in range(3):
            stiff = stiff + np.roll(stiff, 1, axis=a)
        self.diagonal = self.volume / 9.0 * (1.0 / size**2).sum() * stiff

    @property
    def edges(self) -> FloatArray:
        """Edges (3, 3) of the cell as columns."""
        return np.diag(self.shape * self.size)

    def at(self, k: FloatArray) -> "VoxelOperator":
        """What there is of one wave vector."""
        return VoxelOperator(self, k)

    def coarser(self) -> "VoxelWaves":
        """The same on voxels twice as long, with the means of what was in them."""
        a, b, c = self.shape // 2
        of = self.grid.phase[:-1, :-1, :-1].reshape(a, 2, b, 2, c, 2)
        parts = of.transpose(0, 2, 4, 1, 3, 5).reshape(-1, 8)
        table, density = self.grid.table[parts].mean(axis=1), self.density[parts].mean(axis=1)
        return VoxelWaves(np.arange(len(parts)).reshape(a, b, c), table, density, 2.0 * self.size)


def _least_part(table: FloatArray, mean: FloatArray) -> float:
    """Least stiffness of phases with any, for a strain, as a part of a mean one; at most 1."""
    full = np.zeros((len(table) + 1, 6, 6))
    for C, row in zip(full, [*table, mean], strict=True):
        C += row.reshape(6, 6) if len(row) == 36 else isotropic(*row)
    solid = full[np.abs(full).max(axis=(1, 2)) > 0]
    root = np.linalg.inv(np.linalg.cholesky(solid[-1]))
    return float(min(1.0, np.linalg.eigvalsh(root @ solid @ root.T).min()))


class VoxelOperator:
    """Products of rows (b, n) at one wave vector, on the nodes that solid voxels have."""

    def __init__(self, waves: VoxelWaves, k: FloatArray) -> None:
        self.waves = waves
        x = [np.arange(n + 1) * h for n, h in zip(waves.shape, waves.size, strict=True)]
        self.x = np.stack(np.meshgrid(*x, indexing="ij"))
        self.turn = np.exp(1j * np.tensordot(k, self.x, 1))
        self.keep = np.broadcast_to(waves.there, (3, *waves.there.shape))
        self.symbols = symbols(waves.shape, waves.size, k * waves.size)
        self.unknowns = int(self.keep.sum())

    # ---------------------------------------------------------------- rows and fields

    def field(self, row: Vectors) -> Vectors:
        """Values (3, n0, n1, n2) at all nodes of one row."""
        out = np.zeros(self.keep.shape, np.complex128)
        out[self.keep] = row
        return out

    def row(self, field: Vectors) -> Vectors:
        """The transpose of `field`."""
        return np.asarray(field[self.keep])

    def _forces(self, u: Vectors) -> Vectors:
        """Forces of padded fields (3, n0 + 1, n1 + 1, n2 + 1)."""
        grid = self.waves.grid
        real, imaginary = (np.ascontiguousarray(part) for part in (u.real, u.imag))
        return np.asarray(grid.forces(real) + 1j * grid.forces(imaginary))

    def _padded(self, v: Vectors) -> Vectors:
        return np.pad(v, ((0, 0), (0, 1), (0, 1), (0, 1)), mode="wrap") * self.turn

    def _folded(self, f: Vectors) -> Vectors:
        f = f * self.turn.conj()
        for a in (1, 2, 3):
            f = np.moveaxis(f, a, 0)
            f[0] += f[-1]
            f = np.moveaxis(f[:-1], 0, a)
        return f

    @property
    def constants(self) -> Vectors:
        """Rows (3, unknowns) of v that is one along x, y and z."""
        axes = np.eye(3)[:, :, None, None, None] * np.ones(self.keep.shape)
        return np.stack([self.row(v) for v in axes]).astype(np.complex128)

    @property
    def diagonal(self) -> FloatArray:
        """At least the diagonal of K."""
        return np.asarray(np.broadcast_to(self.waves.diagonal, self.keep.shape)[self.keep])

    def prolonged(self, coarse: "VoxelOperator", rows: Vectors) -> Vectors:
        """Rows of what rows on voxels twice as long are in between."""
        fields = [coarse.field(row) for row in rows]
        return np.stack([self.row(prolonged(v.real) + 1j * prolonged(v.imag)) for v in fields])

    # ---------------------------------------------------------------- products

    def stiffness(self, rows: Vectors) -> Vectors:
        """K of rows."""
        return np.stack([self.row(self._stressed(self.field(v))) for v in rows])

    def _stressed(self, v: Vectors) -> Vectors:
        """Forces of a field."""
        return self._folded(self._forces(self._padded(v)))

    def mass(self, rows: Vectors) -> Vectors:
        """M of rows."""
        return np.stack([self.row(self.waves.weights * self.field(v)) for v in rows])

    def slopes(self, rows: Vectors) -> Vectors:
        """Products (3, b, b) of rows with the derivatives of K by the wave vector."""
        out = np.empty((3, len(rows), len(rows)), np.complex128)
        for b, v in enumerate(rows):
            u = self._padded(self.field(v))
            f = self._forces(u)
            for j in range(3):
                one = 1j * self.row(self._folded(self._forces(self.x[j] * u) - self.x[j] * f))
                out[j, :, b] = rows.conj() @ one
        return out

    def precondition(self, shift: float, rows: Vectors) -> Vectors:
        """About (K + shift M)^-1 of rows, by that of a homogeneous grid."""
        scale = float(np.abs(self.waves.reference).max())
        mean = self._mean_inverse(shift)
        out = np.empty_like(rows)
        for b, r in enumerate(rows):
            field = self.field(r)
            size = float(np.abs(r).max()) or 1.0
            z = fft.fftn((field / size).astype(np.complex64), axes=(1, 2, 3))
            first = mean @ z[:, 0, 0, 0].astype(np.complex128)
            kernels.invert(z.shape[1], z, *self.symbols, self.waves.reference / scale)
            z[:, 0, 0, 0] = first * scale
            field = fft.ifftn(z, axes=(1, 2, 3), overwrite_x=True)
            out[b] = field[self.keep].astype(np.complex128) * (size / scale)
        return out

    def _mean_inverse(self, shift: float) -> FloatArray:
        """What the mean of v is divided by: zero without the shift where k is."""
        mass, slope, wave = (s[:, 0] for s in self.symbols)
        lam, mu = self.waves.reference
        D = np.empty((3, 3))
        for i in range(3):
            for j in range(3):
                a = 3 - i - j if i != j else 0
                others = [mass[b] for b in range(3) if b != i]
                D[i, j] = slope[i] * np.prod(others) if i == j else wave[i] * wave[j] * mass[a]
        mean = self.waves.inertia * self.waves.volume
        S = (lam + mu) * D + (mu * np.trace(D) + shift * mean) * np.eye(3)
        return np.asarray(np.linalg.inv(S))


class _Search:
    """Lowest pairs at wave vectors, one after the other, from the last one on."""

    def __init__(self, waves: VoxelWaves, count: int, tol: float, most: int) -> None:
        self.waves, self.count, self.tol, self.most = waves, count, tol, most
        speed2 = waves.reference[1] / waves.inertia
        self.shift = float(speed2 * np.pi**2 * np.prod(waves.shape * waves.size) ** (-2 / 3))
        self.random = np.random.default_rng(0)

    def at(self, k: FloatArray, start: Vectors | None = None) -> Pairs:
        """Pairs at one wave vector, of the first zone."""
        one, block = self.waves.at(k), self.count + GUARD
        precondition = partial(one.precondition, self.shift)
        n, fresh = one.unknowns, block if start is None else FRESH
        real, imaginary = self.random.standard_normal((2, fresh, n))
        noise = precondition(one.mass(real + 1j * imaginary))
        if start is not None:
            noise = np.concatenate([start, noise])
        noise = np.concatenate([one.constants, noise])
        none = np.zeros((0, 0), np.complex128)
        pencil = Pencil(
            one.stiffness, one.mass, precondition, one.diagonal, lambda _: 0.0, self.waves.part
        )
        pairs = lowest(pencil, np.zeros((0, n)), none, noise, self.count, self.tol, self.most)
        check(pairs, self.count, self.tol, k, "or ask for another count")
        return pairs

    def slopes(self, k: FloatArray, x: Vectors) -> Vectors:
        """See `VoxelOperator.slopes`."""
        return self.waves.at(k).slopes(x)

    def errors(self, k: FloatArray, pairs: Pairs) -> FloatArray:
        """Estimated parts (count,) by which frequencies are off, by voxels twice as long."""
        values, there = pairs.values[: self.count], pairs.moving(self.count)
        if (self.waves.shape % 2).any() or self.waves.shape.min() < 4:
            return np.full(self.count, np.nan)
        other = _Search(self.waves.coarser(), self.count, max(self.tol, COARSE), self.most)
        found, one = other.at(k), self.waves.at(k)
        root = np.sqrt(one.row(np.broadcast_to(self.waves.weights, one.keep.shape)))
        rows = root * one.prolonged(other.waves.at(k), found.vectors)
        shares = overlaps(root * pairs.vectors[: self.count], rows)
        off = np.abs(farthest(values, found.values, shares) - values)
        return np.where(there, 0.5 * off / np.where(there, values, 1.0), 0.0)


def bloch_voxels(
    array: Any, *, path: Any = "GXMRG", count: int = 8, steps: int = 8, system: str | None = None,
    young: Any = None, poisson: Any = None, stiffness: Any = None, density: Any = 1.0,
    spacing: Any = None, tol: float = 1e-3, max_iterations: int = 500, progress: Progress = None,
) -> Bands:  # fmt: skip
    """Frequencies of waves in an array of voxels that repeats, over a path of wave vectors.

    Parameters
    ----------
    array : array_like, shape (n0, n1, n2), or path-like
        As in `voxels`. Voids are without stiffness and mass.
    path, count, steps, system : optional
        As in `bloch`.
    young, poisson, stiffness : optional
        As in `voxels`; of voids zero.
    density : float, or sequence of floats
        Mass per volume of the solid, or of every phase, above zero where there is a stiffness.
    spacing : float, or sequence of 3 floats, optional
        Edges of voxels; by default 1, or those of the file.
    tol : float
        Largest residual of a pair, see `Bands.residuals`; frequencies are right to about its
        square, relative to themselves, as far as rounding allows.
    max_iterations : int
        Steps at one wave vector.
    progress : bool or callable, optional
        Wave vectors; see `ilattice._progress.track`.

    Returns
    -------
    Bands
        Frequencies, group velocities, gaps; without modes.

    Raises
    ------
    InputError
        If an argument is wrong, or the work does not fit into memory.
    GeometryError
        If there is no solid.
    ConvergenceError
        If the tolerance is not reached.

    Warns
    -----
    PrecisionWarning
        If the square of a frequency is off by more than 2 %, by estimate or by rounding, or it is
        not known by how much.

    Notes
    -----
    Davidson's method, as `bloch` has it; the shifted symbol is that of M. Hussein, M. Leamy and M.
    Ruzzene, Dynamics of phononic materials and structures (2014), of a homogeneous grid.

    Examples
    --------
    >>> import numpy as np
    >>> import ilattice as il
    >>> solid = np.ones((8, 4, 4), bool)  # waves of one speed
    >>> way = [[0, 0, 0], [0.25, 0, 0]]
    >>> bands = il.homogenize.bloch_voxels(solid, path=way, count=3, steps=1, poisson=0.25)
    >>> (bands.omega[1] / bands.omega[1, 0]).round(4)
    array([1.    , 1.    , 1.7321])
    """
    begin = time.perf_counter()
    count = as_whole("count", count, 1, 500)
    steps = as_whole("steps", steps, 1, 10_000)
    most, tol = as_whole("max_iterations", max_iterations, 1, 10**6), as_residual(tol)
    voxels, size = as_voxels(array, spacing, 3)
    cells, given, table = elastic_phases(voxels, young, poisson, stiffness, void=0.0)
    rho = cells.mixed(_densities(density, given)[:, None])[:, 0]
    waves = VoxelWaves(cells.phase, table, rho, size)
    unknowns = 3 * int(waves.there.sum())
    if unknowns < 3 * (count + GUARD):
        raise InputError(
            f"count = {count} is too many for {unknowns} unknowns: ask for fewer, or give more "
            "voxels"
        )
    need(
        16.0 * unknowns * (MAX_VECTORS + 6) * (count + GUARD),
        f"{count} waves of {unknowns} unknowns", "use fewer voxels, or a smaller count",
    )  # fmt: skip
    way = path_of(path, waves.edges, steps, system)
    search = _Search(waves, count, tol, most)
    k = way.fractions @ reciprocal(waves.edges).T
    zone = way.reduced().fractions @ reciprocal(waves.edges).T
    tangents = np.diff(k, axis=0, append=k[-1:] + (k[-1:] - k[-2:-1] if len(k) > 1 else 1.0))
    found: list[Pairs] = []
    velocities = []
    for i in track(range(len(k)), "bands", progress):
        step = np.linalg.norm(zone[i] - zone[i - 1]) if i else np.inf
        near = step < 2.0 * np.linalg.norm(k[i] - k[i - 1])
        found.append(search.at(zone[i], found[-1].vectors if near else None))
        velocities.append(velocities_of(search, zone[i], tangents[i], found[-1])[0])
    errors = np.max([search.errors(zone[c], found[c]) for c in distinct(way)], axis=0)
    lost = rounded(found, way, count)
    a, b, c = (int(n) for n in waves.shape)
    off = 2.0 * float(errors.max())
    warn_of_voxels(off, "the square of a frequency", (a, b, c), REMEDY.replace("elastic", "bloch"))
    warn_of_rounding(lost)
    report = BlochReport(
        (a, b, c), unknowns, "fourier", read_only(np.array([p.steps for p in found])),
        time.perf_counter() - begin,
    )  # fmt: skip
    return Bands(
        k, way.fractions, way.corners, way.labels, frequencies(found, way, count),
        np.stack(velocities), np.stack([p.residuals[:count] for p in found]),
        errors + lost,
        float(np.prod(waves.shape * size) ** (1 / 3)),
        float(np.sqrt(waves.reference[1] / waves.inertia)), report, None, None,
    )  # fmt: skip


def _densities(density: Any, given: FloatArray) -> FloatArray:
    """Mass per volume of the given phases, zero for voids."""
    solid = np.abs(given).max(axis=(1, 2)) > 0
    rho = as_array("density", density).ravel()
    if np.ndim(density) > 1 or len(rho) not in (1, len(given)):
        raise InputError(f"density must be one number or {len(given)}, got {density!r:.80}")
    rho = np.where(solid, np.broadcast_to(rho, len(given)), 0.0)
    if not (rho[solid] > 0).all():
        raise InputError(
            f"density must be above zero where there is stiffness, got {density!r:.80}"
        )
    return rho
