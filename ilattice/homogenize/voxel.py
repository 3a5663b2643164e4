"""Effective properties of arrays of voxels: for tomograms, labels, and very many cheap cells.

::

    il.homogenize.voxels(array, young=(1e-6, 1.0), poisson=0.3).C

Every voxel is a trilinear element, the array repeats in all directions. Nothing is assembled; the
preconditioner is a homogeneous material of the same grid, inverted by Fourier transforms, so that
the iterations depend neither on the number of voxels nor on how soft voids are. `errors` compares
with the best fields on voxels twice as long in the same material (for even numbers of voxels), and
four times as long (for numbers that four divides); by how much voxels miss a smooth geometry is not
in them. They are parts of what was found, which is above what is true: 0.8 says five times too
large.

Guarantees: laminates along the axes are exact; what is computed comes from above, for the voxels as
they are; the same bits for any number of threads. Non-guarantee: thin walls need many voxels;
solids of which the geometry is known are for `elastic`.
"""

import time
import warnings
from os import PathLike
from typing import Any

import numpy as np
from scipy.ndimage import label

from ilattice._memory import need
from ilattice._progress import Progress
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import as_array, as_flag, as_positive, as_triple, as_whole
from ilattice.cutfem._voigt import PLACES
from ilattice.cutfem.anisotropic import as_matrices
from ilattice.errors import InputError, PrecisionWarning
from ilattice.homogenize import tensors
from ilattice.homogenize._estimate import outside, warn_of_voxels
from ilattice.homogenize._result import SOFT, HomogenizationReport
from ilattice.homogenize._spectral import Descent, VoxelGrid, descend
from ilattice.homogenize._voxel_errors import (
    FourTimes,
    Twice,
    aligned,
    left_at_edges,
    missed,
    relaxed,
)
from ilattice.homogenize.bounds import (
    Bounds,
    ConductivityBounds,
    conductive_bounds,
    elastic_bounds,
)
from ilattice.homogenize.cell import warn_of_contrast
from ilattice.homogenize.conductivity import Conductivity
from ilattice.homogenize.effective import Effective
from ilattice.homogenize.images import read_voxels
from ilattice.homogenize.percolation import percolation
from ilattice.homogenize.periodic import warn_of_axes
from ilattice.homogenize.phases import SOLID, VOID, Labelled, labelled

#: Bytes per voxel and component of a field: solutions and residuals of all loads, and work.
PER_VALUE = 200
#: Largest ratio of two edges of voxels, up to which transforms in single precision precondition.
SLENDER = 1e6
#: Loads below this part of the stresses that make them are rounding.
ROUNDING = 1e-13
#: What helps against too coarse voxels.
REMEDY = "divide them, or take cut cells (il.homogenize.elastic) where the geometry is known"
#: What errors are estimated from, as far as voxels can be joined.
LONGER = "twice and four times"
#: Poisson's ratio from which trilinear voxels lock.
LOCKING = 0.45


def voxels(
    array: Any, *, young: Any = None, poisson: Any = None, stiffness: Any = None,
    expansion: Any = None, spacing: Any = None, tol: float = 1e-4, estimate: bool = True,
    max_iterations: int = 500, progress: Progress = None,
) -> Effective:  # fmt: skip
    """Effective stiffness of an array of voxels that repeats.

    Parameters
    ----------
    array : array_like, shape (n0, n1, n2), or path-like
        Flags (solid or not), labels of phases, fill fractions or factors of the stiffness: see
        `ilattice.homogenize.phases`; or a file of `read_voxels`. The axes are x, y, z.
    young : float, or sequence of floats
        Young's modulus of the solid (voids then have 1e-6 of it), or of every phase; may be zero;
        by default 1.
    poisson : float, or sequence of floats
        Poisson's ratio of all phases, or of each; by default 0.3.
    stiffness : array_like, shape (6, 6) or (phases, 6, 6), optional
        Instead of both, of any symmetry: of the solid, or of every phase, such as the grains of a
        polycrystal; in Voigt order xx, yy, zz, yz, xz, xy with engineering shear.
    expansion : float, or sequence of floats, optional
        Thermal expansion per degree of all phases, or of each, for `Effective.expansion`: one more
        load.
    spacing : float, or sequence of 3 floats, optional
        Edges of voxels, one up to 1e6 times as long as another; by default 1, or those of the file.
    tol : float
        Of the fields; errors of the stiffness are of the order of its square.
    estimate : bool
        Whether to estimate `Effective.errors`, which takes about half as long again. NaN without,
        and where a direction has an odd number of voxels, or less than 4 (unless all are alike);
        best where four divides the numbers.
    max_iterations : int
        Of conjugate gradients.
    progress : bool or callable, optional
        Per cent of the digits asked for, load by load; see `ilattice._progress.track`.

    Returns
    -------
    Effective
        Stiffness and what follows from it.

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
        If no solid goes on through the cell along an axis, voxels lock, or the stiffness is off by
        more than 2 %, by estimate, or it is not known by how much.

    Notes
    -----
    Moulinec and Suquet (1998) for Fourier transforms in homogenization; Schneider, Merkert and
    Kabel (2017) for trilinear elements with them.
    """
    array, size = as_voxels(array, spacing, 3)
    cells, given, table = elastic_phases(array, young, poisson, stiffness)
    stiff = cells.mixed(given.reshape(-1, 36)).reshape(-1, 6, 6)
    stress = stiff[:, PLACES].transpose(3, 0, 1, 2)
    heat, hot = np.zeros((0, len(stiff), 6)), np.zeros(0)
    if expansion is not None:
        alpha = as_array("expansion", expansion).ravel()
        if np.ndim(expansion) > 1 or len(alpha) not in (1, len(given)):
            raise InputError(f"expansion must be one number or {len(given)}, got {expansion!r:.80}")
        heat = cells.mixed(alpha[:, None] * (given @ tensors.UNIT))[None]
        hot = np.array([_hindered(cells.fractions, stiff, heat[0])])
        stress = np.concatenate([stress, heat[:, :, PLACES]])
    run = _Run(cells, table, size, stress, tol, max_iterations, progress)
    mean = np.einsum("p,pij->ij", cells.fractions, stiff)
    bounds = _elastic_bounds(cells, stiff, mean, isotropic=table.shape[1] == 2)
    whole, least = np.append(mean.diagonal(), hot), np.append(bounds.reuss.diagonal(), 0.0 * hot)
    done, errors, solid, report = run.all(whole, least, as_flag("estimate", estimate))
    C = mean - done[:6, :6]
    if not np.abs(stiff).max(axis=(1, 2)).min() > 0.0:
        C = tensors.without(C, np.eye(3)[~np.array(solid)])
    _warn_of(solid, table)
    C = 0.5 * (C + C.T)
    thermal: tuple[Any, Any] = (None, None)
    for a, one in enumerate(heat, 6):
        hindered = cells.fractions @ one - done[:6, a]
        thermal = _expansion(C, errors[:6, :6], hindered, errors[:6, a])
    eff = Effective(cells.filled, solid, report, C, errors[:6, :6], bounds, *thermal)
    if estimate:
        warn_of_voxels(eff.error, "the effective stiffness", report.cells, REMEDY, LONGER)
    return eff


def elastic_phases(
    array: Any, young: Any, poisson: Any, stiffness: Any, *, void: float = VOID
) -> tuple[Labelled, FloatArray, FloatArray]:
    """Voxels by phases, the given stiffnesses (k, 6, 6), and the table of a grid."""
    if stiffness is not None:
        if young is not None or poisson is not None:
            raise InputError("stiffness is given, and young or poisson, too: leave out one of them")
        C = _as_stiffnesses(stiffness)
        known = C[:, range(6), range(6)].sum(axis=1)
        cells = labelled(array, "stiffness", known if len(C) > 1 else known[0], void=void)
        factors = cells.values / known if len(C) == 1 else np.ones(len(C))
        given = factors[:, None, None] * C
        return cells, given, cells.mixed(given.reshape(-1, 36))
    cells = labelled(array, "young", 1.0 if young is None else young, void=void)
    E, told = cells.values, 0.3 if poisson is None else poisson
    nu = as_array("poisson", told).ravel()
    if np.ndim(told) > 1 or len(nu) not in (1, len(E)):
        raise InputError(f"poisson must be one number or {len(E)}, got {told!r:.80}")
    if not ((nu > -1.0) & (nu < 0.5)).all():
        raise InputError(f"poisson must be above -1 and below 0.5, got {told!r:.80}")
    if (nu >= LOCKING).any():
        warnings.warn(
            f"poisson={nu.max():g}: trilinear voxels lock from about {LOCKING} on, and are too "
            "stiff; take cut cells (il.homogenize.elastic)",
            PrecisionWarning,
            stacklevel=outside(),
        )
    nu = np.broadcast_to(nu, len(E))
    lame = np.stack([E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))], axis=1)
    return cells, tensors.isotropic(*lame.T), cells.mixed(lame)


def _as_stiffnesses(stiffness: Any) -> FloatArray:
    """Matrices (k, 6, 6) of phases; of voids they may be zero."""
    C = as_array("stiffness", stiffness)
    if C.ndim not in (2, 3) or C.shape[-2:] != (6, 6) or not len(C):
        raise InputError(
            f"stiffness must be a matrix, shape (6, 6), or one per phase, got shape {C.shape}"
        )
    C = np.array(C.reshape(-1, 6, 6))
    there = C.any(axis=(1, 2))
    C[there] = as_matrices("stiffness", C[there])
    return C


def _hindered(fractions: FloatArray, stiff: FloatArray, stress: FloatArray) -> float:
    """Mean of twice the energy of thermal stresses (phases, 6) where nothing moves."""
    strain = (tensors.compliance(C, SOFT) @ s for C, s in zip(stiff, stress, strict=True))
    return float(sum(f * (s @ e) for f, s, e in zip(fractions, stress, strain, strict=True)))


def _expansion(
    C: FloatArray, errors: FloatArray, hindered: FloatArray, off: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Free expansion (6,), and its errors, of a stiffness and hindered stresses with theirs."""
    S = tensors.compliance(C, SOFT)
    alpha = S @ hindered
    return alpha, np.abs(S) @ (off + errors @ np.abs(alpha))


def conductive_voxels(
    array: Any, *, conductivity: Any = 1.0, spacing: Any = None, tol: float = 1e-4,
    estimate: bool = True, max_iterations: int = 500, progress: Progress = None,
) -> Conductivity:  # fmt: skip
    """Effective conductivity of an array of voxels that repeats.

    Parameters
    ----------
    array : array_like, shape (n0, n1, n2), or path-like
        As in `voxels`.
    conductivity : float, or sequence of floats, or of matrices, shape (phases, 3, 3)
        Of the solid (voids then have 1e-6 of it), or of every phase; tensors of labelled phases
        only.
    spacing, tol, estimate, max_iterations, progress : optional
        As in `voxels`.

    Returns
    -------
    Conductivity
        With an estimate of its errors.

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
        As `voxels` does.

    Examples
    --------
    >>> import numpy as np
    >>> import ilattice as il
    >>> layers = np.zeros((4, 4, 4), bool)
    >>> layers[2:] = True
    >>> il.homogenize.conductive_voxels(layers, conductivity=(1.0, 3.0)).k.diagonal().round(9)
    array([1.5, 2. , 2. ])
    """
    array, size = as_voxels(array, spacing, 1)
    tensor = _as_tensors(conductivity)
    known = conductivity if tensor is None else np.trace(tensor, axis1=1, axis2=2) / 3.0
    cells = labelled(array, "conductivity", known)
    if tensor is None:
        unit = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
        table = cells.mixed(cells.values[:, None] * unit)
    else:
        table = np.stack([tensor[:, i, j] for i, j in tensors.PAIRS], axis=1)
    k = table[:, [[0, 5, 4], [5, 1, 3], [4, 3, 2]]]
    stress = k.transpose(1, 0, 2)[:, :, None]
    run = _Run(cells, table, size, stress, tol, max_iterations, progress)
    mean = np.einsum("p,pij->ij", cells.fractions, k)
    bounds = _conductive_bounds(cells, k, mean, scalar=tensor is None)
    whole, least = mean.diagonal(), bounds.wiener[0].diagonal()
    done, errors, solid, report = run.all(whole, least, as_flag("estimate", estimate))
    out = mean - done
    if not table[:, :3].max(axis=1).min() > 0.0:  # where nothing is borne, what is left is noise
        keep = np.array(solid, float)
        out = out * np.outer(keep, keep)
    _warn_of(solid, table)
    found = Conductivity(cells.filled, solid, report, 0.5 * (out + out.T), errors, bounds)
    if estimate:
        warn_of_voxels(found.error, "the effective conductivity", report.cells, REMEDY, LONGER)
    return found


def _as_tensors(conductivity: Any) -> FloatArray | None:
    """Symmetric positive matrices (phases, 3, 3), or None where numbers are given."""
    if np.ndim(conductivity) != 3:
        return None
    k = as_array("conductivity", conductivity)
    if k.shape[1:] != (3, 3) or np.abs(k - k.transpose(0, 2, 1)).max() > 1e-12 * np.abs(k).max():
        raise InputError(
            f"conductivity must be symmetric matrices, shape (phases, 3, 3), got shape {k.shape}"
        )
    if np.linalg.eigvalsh(k).min() < 0:
        raise InputError("conductivity must be positive definite, a matrix is not")
    return k


def as_voxels(array: Any, spacing: Any, m: int) -> tuple[AnyArray, FloatArray]:
    """The array, and the edges of voxels, if fields of m components fit into memory."""
    given: Any = 1.0
    if isinstance(array, (str, PathLike)):
        array, given = read_voxels(array)
    size = as_triple("spacing", given if spacing is None else spacing, positive=True)
    if size.min() < size.max() / SLENDER:
        raise InputError(
            f"spacing: the longest edge of voxels must be at most {SLENDER:g} times the shortest, "
            f"got {size.tolist()}; join voxels along the short edges"
        )
    if np.ma.isMaskedArray(array):
        raise InputError("array is masked, and masks are not read; fill it: array.filled(0)")
    try:
        found = np.asarray(array)
    except ValueError as e:
        raise InputError(f"array must hold voxels in three directions, got {array!r:.80}") from e
    need(
        PER_VALUE * m * float(found.size),
        f"a grid of {' x '.join(map(str, found.shape))} voxels",
        "use fewer voxels",
    )
    return found, size


class _Run:
    """The loads of a grid of voxels, solved one after the other."""

    def __init__(
        self, cells: Labelled, table: FloatArray, size: FloatArray, stress: FloatArray,
        tol: float, steps: int, progress: Progress,
    ) -> None:  # fmt: skip
        self.tol = as_positive("tol", tol)
        if not 1e-12 <= self.tol < 1.0:
            raise InputError(f"tol must be between 1e-12 and 1, got {tol!r:.80}")
        self.start = time.perf_counter()
        self.steps = as_whole("max_iterations", steps, 1, 2**31)
        self.cells, self.stress, self.progress = cells, stress, progress
        reference = cells.fractions @ table
        if table.shape[1] == 36:
            K, G = tensors.bulk_and_shear(reference.reshape(6, 6))
            reference = np.array([K - 2.0 * G / 3.0, G])
        size = np.ldexp(size, -int(np.frexp(size.max())[1]))  # the unit of length does not matter
        self.grid = VoxelGrid(cells.phase, np.ascontiguousarray(table), size, reference)

    def all(
        self, whole: FloatArray, least: FloatArray, estimate: bool
    ) -> tuple[FloatArray, FloatArray, tuple[bool, bool, bool], HomogenizationReport]:
        """What is relaxed, errors, whether solid goes on, and a report.

        Of mean energies (k,) where nothing is relaxed, and lower bounds of what is left.
        """
        grid, count = self.grid, len(self.stress)
        runs = [self._fine(self._load(a, grid)) for a in range(count)]
        done = self._energies(runs)
        steps, left = max(run.iterations for run in runs), max(run.left for run in runs)
        solved = sum(run.iterations > 0 for run in runs)
        del runs  # estimating needs room
        errors = np.full((count, count), np.nan if solved else 0.0)
        shape = np.array(self.cells.phase.shape)
        if estimate and solved and not (shape % 2).any() and shape.min() >= 4:
            root = np.sqrt(self._missed(done.diagonal(), whole, least))
            errors = np.outer(root, root)  # energies: no entry is farther off than that
        solid = _going_on(self.cells, grid)
        a, b, c = (int(n) for n in shape)
        seconds = time.perf_counter() - self.start
        report = HomogenizationReport(
            "voxels", (a, b, c), int(np.prod(grid.shape)), steps, left, seconds,
            solved,
        )  # fmt: skip
        return done, errors, solid, report

    def _load(self, a: int, grid: VoxelGrid) -> FloatArray:
        """Forces of a unit strain or gradient, zero if they are rounding."""
        b = grid.load(self.stress[a])
        area = grid.spacing.prod() / grid.spacing.min()
        small = np.abs(b).max() <= ROUNDING * area * np.abs(self.stress[a]).max()
        return np.zeros_like(b) if small else b

    def _fine(self, b: FloatArray) -> Descent:
        return descend(
            self.grid.forces, self.grid.precondition, b, self.tol, self.steps, self.progress
        )

    def _missed(self, done: FloatArray, whole: FloatArray, least: FloatArray) -> FloatArray:
        """By how much what is left of energies (k,) is too large."""
        grid = aligned(self.grid)
        volume = float(grid.spacing.prod() * grid.phase.size)

        def on(longer: Twice | FourTimes) -> FloatArray:
            loads = (self._load(a, grid) for a in range(len(done)))
            return relaxed(longer, loads, self.tol, self.steps) / volume

        twice = on(Twice(grid))
        more = None if (np.array(grid.phase.shape) % 4).any() else twice - on(FourTimes(grid))
        return missed(whole - done, done - twice, more, done, least, left_at_edges(grid))

    def _energies(self, runs: list[Descent]) -> FloatArray:
        """What loads relax: off by the squares of errors of the fields only."""
        count, volume = len(runs), float(self.grid.spacing.prod() * self.cells.phase.size)
        work, rest = np.empty((count, count)), np.empty((count, count))
        flat = [run.x.reshape(-1) for run in runs]
        for a in range(count):
            b, r = self._load(a, self.grid).reshape(-1), runs[a].residual.reshape(-1)
            for c in range(count):
                work[a, c], rest[a, c] = flat[c] @ b, flat[c] @ r
        out = work + rest.T
        return np.asarray(0.5 * (out + out.T) / volume)


def _going_on(cells: Labelled, grid: VoxelGrid) -> tuple[bool, bool, bool]:
    """Whether solid voxels go on through the cell along the axes, through their faces."""
    stiff = np.abs(grid.table).max(axis=1)
    used = np.bincount(cells.phase.ravel(), minlength=len(stiff)) > 0
    solid = (stiff > SOLID * stiff[used].max())[cells.phase]
    piece, count = label(solid)
    low, high, steps = [], [], []
    for a in range(3):
        last, first = piece.take(-1, axis=a).ravel(), piece.take(0, axis=a).ravel()
        pairs = np.unique(np.stack([last, first], axis=1)[(last > 0) & (first > 0)], axis=0) - 1
        low.append(pairs[:, 0])
        high.append(pairs[:, 1])
        steps.append(np.tile(np.eye(3, dtype=np.int64)[a], (len(pairs), 1)))
    both: tuple[IntArray, IntArray] = (np.concatenate(low), np.concatenate(high))
    return percolation(int(count), *both, np.concatenate(steps)).axes


def _warn_of(solid: tuple[bool, bool, bool], table: FloatArray) -> None:
    """Warn of axes along which there is no way through solid voxels, and of contrasts."""
    soft = np.abs(table).max(axis=1).min() > 0
    warn_of_axes(solid, "xyz", "voids, which are soft here," if soft else "")
    most = np.abs(table).max(axis=1)
    warn_of_contrast(float(most.max() / most[most > 0.0].min(initial=most.max())))


def _elastic_bounds(
    cells: Labelled, stiff: FloatArray, mean: FloatArray, *, isotropic: bool
) -> Bounds:
    f = cells.fractions
    there = f > 0
    f, C = f[there], stiff[there]
    reuss = np.zeros((6, 6))
    if np.abs(C).max(axis=(1, 2)).min() > 0:
        reuss = np.linalg.inv(np.einsum("p,pij->ij", f, np.linalg.inv(C)))
    K, G = tensors.bulk_and_shear(C)
    return Bounds(mean, reuss, *(elastic_bounds(f, K, G) if isotropic else (None, None)))


def _conductive_bounds(
    cells: Labelled, k: FloatArray, mean: FloatArray, *, scalar: bool
) -> ConductivityBounds:
    f = cells.fractions
    there = f > 0
    f, k = f[there], k[there]
    least = np.zeros((3, 3))
    if np.linalg.eigvalsh(k).min() > 0:
        least = np.linalg.inv(np.einsum("p,pij->ij", f, np.linalg.inv(k)))
    interval = conductive_bounds(f, k[:, 0, 0]) if scalar else None
    return ConductivityBounds((least, mean), interval)
