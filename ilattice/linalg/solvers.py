"""Solve K u = f for stiffness matrices: multigrid or a factor, made once, used for many loads.

::

    solver = Solver(K, near_nullspace=modes)
    u, report = solver.solve(f)

Whatever the method, its approximate inverse preconditions conjugate gradients in double precision:
a factor then takes one or two steps, which are its iterative refinement. Several right-hand sides
go through the matrix and the preconditioner together, so that these are read once for all.

Guarantees: a solution comes with a relative residual below `tol`, computed afresh from K, or
`ConvergenceError` is raised. Slender bodies are moved far by small loads: rounding x alone then
leaves |K| |x| times 1e-16, which may be more than `tol` of the load. Such a solution is returned
if its error in the energy norm, relative to it, is below `tol`, and the report says so (`rounded`).
A matrix that is singular to working precision is refused. Multigrid gives the same bits for any
number of threads. Non-guarantee: a body that hangs by a hinge is found only by not converging.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import bsr_array, issparse

from ilattice._progress import Progress
from ilattice._typing import AnyArray, ArrayLike, FloatArray
from ilattice._validate import (
    Frozen,
    as_array,
    as_choice,
    as_points,
    as_positive,
    as_whole,
    check_finite,
    read_only,
)
from ilattice.errors import ConvergenceError, InputError
from ilattice.linalg._engines import ENGINES, LIMIT, SINGULAR, choose, factor_size
from ilattice.linalg._krylov import Run, conjugate_gradients
from ilattice.linalg.symmetric import Symmetric

#: Largest entry of a matrix, and what that must be at least.
LARGEST, SMALLEST = 1e140, 1e-140
#: Part of the geometric mean of two diagonal entries by which those between them may differ.
ASYMMETRY = 1e-11
#: Steps that are allowed from which on a factor takes over where they are not enough.
MANY = 100
#: Right-hand sides that are solved together, at most.
TOGETHER = 12
#: Rows of blocks that are multiplied with longer numbers at once.
FINE = 1 << 14


@dataclass(frozen=True, eq=False)
class SolveReport(Frozen):
    """How a system was solved.

    Attributes
    ----------
    method : str
        "multigrid", "pyamg", "pardiso" or "superlu".
    iterations : int
        Steps of conjugate gradients, of the right-hand side that took most.
    residual : float
        Relative residual |b - K x| / |b|, recomputed, of the worst right-hand side.
    history : ndarray, shape (iterations + 1,)
        Relative residuals of the right-hand side that took most steps, as the recursion has them.
    condition : float
        Condition number of the preconditioned matrix as the steps show it.
    setup_seconds, solve_seconds : float
        Wall time of the factor or hierarchy, which is shared by all solves, and of this solve.
    size : int
        Number of unknowns.
    megabytes : float
        What the factor or hierarchy takes.
    discretization_error : float
        Estimated part of the energy by which it is off because of the cells, see `discretization`;
        NaN where there is no estimate. How far integrals over cells that curved surfaces cut are
        off is in it, from some of these cells, where rules have two or three points per direction,
        as they have at degree 1; else it is not, and ``solution.report.integration_error`` tells.
    rounded : bool
        Whether the residual is above `tol` only because x is rounded: the error in the energy norm
        is below `tol`.
    """

    method: str
    iterations: int
    residual: float
    history: FloatArray
    condition: float
    setup_seconds: float
    solve_seconds: float
    size: int
    megabytes: float
    discretization_error: float = float("nan")
    rounded: bool = False


class Solver:
    """A factor or multigrid hierarchy of a stiffness matrix, for many right-hand sides.

    Parameters
    ----------
    K : sparse array, shape (n, n), or Symmetric
        Symmetric positive definite, as BSR with square blocks m x m, one per node; other formats
        count as blocks 1 x 1. Its half is copied. A `Symmetric` one is not: do not change it.
    near_nullspace : array_like, shape (n, p), optional
        Modes with little energy: p = 6 of a rigid body in space, or ones for heat. By default the
        rigid-body modes of `coordinates` for m = 3, or constants per component.
    method : str
        "multigrid" (our own), "pyamg", "pardiso" (each needs its extra, ``fem`` or ``pardiso``),
        "superlu", or "auto": by the predicted size of a factor, which also takes over where
        multigrid has not converged.
    coordinates : array_like, shape (n / m, 3), optional
        Nodes in space: for the rigid-body modes, for messages, and for multigrid to see where cells
        are stretched.

    Raises
    ------
    InputError
        If an argument is wrong, K is not symmetric or has a diagonal entry that is not positive,
        or the package of the method is missing.
    ConvergenceError
        If K is singular to working precision.
    """

    def __init__(
        self,
        K: Any,
        *,
        near_nullspace: ArrayLike | None = None,
        method: str = "auto",
        coordinates: ArrayLike | None = None,
    ) -> None:
        as_choice("method", method, ("auto", *ENGINES))
        start = time.perf_counter()
        self._K = K if isinstance(K, Symmetric) else _half(_as_blocks(K))
        self._coordinates = None if coordinates is None else as_points("coordinates", coordinates)
        if self._coordinates is not None and len(self._coordinates) != self._K.rows:
            raise InputError(
                f"coordinates must have {self._K.rows} rows, got {len(self._coordinates)}"
            )
        modes = self._modes(near_nullspace)
        self._near_nullspace = near_nullspace
        self._method = choose(self._K, self._coordinates) if method == "auto" else method
        self._replaceable = method == "auto" and self._method == "multigrid"
        self._engine, self._bytes = ENGINES[self._method](self._K, modes, self._coordinates)
        self._setup_seconds = time.perf_counter() - start

    def __repr__(self) -> str:
        return f"Solver({self._method!r}, {self._K.shape[0]} unknowns)"

    @property
    def method(self) -> str:
        """The method, also if it was chosen automatically."""
        return self._method

    def __reduce__(self) -> tuple[Any, ...]:
        """For `pickle` and `copy`, without factors, which are made again."""
        method = "auto" if self._replaceable else self._method
        return _again, (self._K, self._near_nullspace, method, self._coordinates)

    def precondition(self, r: ArrayLike) -> FloatArray:
        """Approximate solution of K z = r by one application of the method.

        Parameters
        ----------
        r : array_like, shape (n,) or (n, k)
            One or several right-hand sides.

        Returns
        -------
        ndarray, shape of r
            z; a symmetric positive definite function of r.
        """
        rows = np.ascontiguousarray(self._as_load(r, "r").T)
        return np.ascontiguousarray(self._engine(rows).T).reshape(np.shape(r))

    def multiply(self, x: ArrayLike) -> FloatArray:
        """K x by all threads.

        Parameters
        ----------
        x : array_like, shape (n,) or (n, r)
            One or several vectors.

        Returns
        -------
        ndarray, shape of x
            The products.
        """
        rows = np.ascontiguousarray(self._as_load(x, "x").T)
        return np.ascontiguousarray(self._multiply(rows).T).reshape(np.shape(x))

    def _multiply(self, x: FloatArray) -> FloatArray:
        """K x for a vector (n,), or rows (r, n)."""
        y = np.empty_like(x)
        self._K.multiply(x, y, 0)
        return y

    def solve(
        self, b: ArrayLike, *, tol: float = 1e-8, max_iterations: int = 500,
        progress: Progress = None,
    ) -> tuple[FloatArray, SolveReport]:  # fmt: skip
        """Solve K x = b.

        Parameters
        ----------
        b : array_like, shape (n,) or (n, r)
            One or several right-hand sides; each stops where it alone would.
        tol : float
            Largest relative residual |b - K x| / |b|, or, where rounding x leaves more than that,
            error in the energy norm.
        max_iterations : int
            Largest number of steps of conjugate gradients.
        progress : bool or callable, optional
            Per cent of the digits asked for; see `ilattice._progress.track`.

        Returns
        -------
        x : ndarray, shape of b
            Solutions.
        report : SolveReport
            Iterations, residual, times.

        Raises
        ------
        InputError
            If an argument is wrong.
        ConvergenceError
            If the residual stays above `tol`, and not because of rounding alone.
        """
        loads = self._as_load(b, "b")
        tol = as_positive("tol", tol)
        if not 1e-15 <= tol < 1:
            raise InputError(f"tol must be between 1e-15 and 1, got {tol:g}")
        steps = as_whole("max_iterations", max_iterations, 1, 2**31)
        start = time.perf_counter()
        # powers of two, so that squares of very small or large loads neither vanish nor overflow
        power = np.frexp(np.abs(loads).max(axis=0))[1]
        rows = np.ascontiguousarray(np.ldexp(loads, -power).T)
        runs: list[Run] = []
        for i in range(0, len(rows), TOGETHER):
            runs += self._run(rows[i : i + TOGETHER], tol, steps, progress)
        longest = max(runs, key=lambda run: len(run.history))
        report = SolveReport(
            self._method,
            max(len(longest.history) - 1, 0),
            max(run.residual for run in runs),
            read_only(np.array(longest.history)),
            max(run.condition for run in runs),
            self._setup_seconds,
            time.perf_counter() - start,
            self._K.shape[0],
            self._bytes / 1e6,
            rounded=any(run.rounded for run in runs),
        )
        with np.errstate(over="ignore"):
            x = np.ldexp(np.stack([run.x for run in runs], axis=1), power)
        if not np.isfinite(x).all():
            raise ConvergenceError(
                "x is too large for floating-point numbers: loads are too large for K; use other "
                "units"
            )
        return x.reshape(np.shape(b)), report

    def _run(self, b: FloatArray, tol: float, steps: int, progress: Progress) -> list[Run]:
        """Solve for rows of b, if need be with another method."""
        runs = conjugate_gradients(
            self._multiply, self._engine, b, tol, steps, progress, self._residuals
        )
        for run, row in zip(runs, b, strict=True):
            if run.rounded and not self._weight(run.x) <= SINGULAR * float(run.x @ row):
                run.trouble = "the matrix is singular to working precision"
        failed = [
            i for i, run in enumerate(runs)
            if run.trouble or not (run.residual <= tol or run.rounded)
        ]  # fmt: skip
        if not failed:
            return runs
        if not (self._replaceable and steps >= MANY and factor_size(self._K) <= LIMIT):
            raise ConvergenceError(self._complaint(runs[failed[0]], tol))
        self._replace()
        for i, run in zip(failed, self._run(b[failed], tol, steps, progress), strict=True):
            runs[i] = run
        return runs

    def _residuals(self, b: FloatArray, x: FloatArray) -> FloatArray:
        """Rows b - K x in the longest floating-point numbers there are, rounded at the end."""
        K, graph = self._K, self._K.graph()
        nodes = x.reshape(len(x), -1, K.size).astype(np.longdouble)
        out = b.reshape(nodes.shape).astype(np.longdouble)
        for lo in range(0, K.rows, FINE):
            start = graph.offsets[lo : lo + FINE + 1].astype(np.int64)
            some = slice(start[0], start[-1])
            blocks = K.taken(graph.which[some]).astype(np.longdouble)
            for row, node in zip(out, nodes, strict=True):
                parts = (blocks * node[graph.columns[some]][:, None, :]).sum(axis=2)
                row[lo : lo + FINE] -= np.add.reduceat(parts, start[:-1] - start[0], axis=0)
        return np.ascontiguousarray(out.reshape(b.shape).astype(np.float64))

    def _weight(self, x: FloatArray) -> float:
        """What would be the energy of x if all nodes moved alone."""
        return float(self._K.diagonal() @ (x * x))

    def _replace(self) -> None:
        """Take a factor from now on, in place of multigrid that does not converge."""
        start = time.perf_counter()
        self._engine, self._bytes = ENGINES["superlu"](self._K, np.zeros((0, 0)), self._coordinates)
        self._method, self._replaceable = "superlu", False
        self._setup_seconds += time.perf_counter() - start

    def _complaint(self, run: Run, tol: float) -> str:
        node = int(np.argmax(np.abs(run.x))) // self._K.size
        where = "" if self._coordinates is None else f" at {np.round(self._coordinates[node], 6)}"
        return (
            f"{self._method} stopped after {len(run.history) - 1} iterations at a relative "
            f"residual of {run.residual:.1e}, above tol = {tol:.1e}: "
            f"{run.trouble or 'it needs more iterations'}. The preconditioned condition number is "
            f"about {run.condition:.1e}; the largest value is that of node {node}{where}: is the "
            "part there held by more than an edge or a corner, and not hundreds of times as long "
            "as what holds it is wide?"
        )

    def _as_load(self, b: ArrayLike, name: str) -> FloatArray:
        load = as_array(name, b)
        n = self._K.shape[0]
        if load.ndim not in (1, 2) or load.shape[0] != n or load.size == 0:
            raise InputError(f"{name} must have shape ({n},) or ({n}, r), got {load.shape}")
        return load.reshape(n, -1)

    def _modes(self, given: ArrayLike | None) -> FloatArray:
        n, m = self._K.shape[0], self._K.size
        if given is None:
            if m == 3 and self._coordinates is not None:
                return rigid_modes(self._coordinates)
            return np.tile(np.eye(m), (n // m, 1))
        modes = as_array("near_nullspace", given)
        if modes.ndim != 2 or modes.shape[0] != n or modes.shape[1] == 0:
            raise InputError(f"near_nullspace must have shape ({n}, p), got {modes.shape}")
        return modes


def rigid_modes(coordinates: ArrayLike) -> FloatArray:
    """Translations along, and rotations about, the three axes.

    Parameters
    ----------
    coordinates : array_like, shape (n, 3)
        Points in space.

    Returns
    -------
    ndarray, shape (3 n, 6)
        Displacements of the points, one mode per column; rotations are about the centroid, by
        the inverse of the largest distance from it.
    """
    x = as_points("coordinates", coordinates)
    if not len(x):
        raise InputError("coordinates must hold at least one point")
    x = x - x.mean(axis=0)
    x = x / (np.abs(x).max() or 1.0)
    out = np.zeros((len(x), 3, 6))
    out[:, :, :3] = np.eye(3)
    for i in range(3):
        out[:, :, 3 + i] = np.cross(np.eye(3)[i], x)
    return out.reshape(-1, 6)


def _as_blocks(given: Any) -> bsr_array:
    if not issparse(given):
        raise InputError(f"K must be a square sparse array, got {given!r:.80}")
    K: Any = given
    if K.ndim != 2 or K.shape[0] != K.shape[1] or K.shape[0] == 0:
        raise InputError(f"K must be square and not empty, got shape {K.shape}")
    if K.format != "bsr":
        K = K.tobsr(blocksize=(1, 1))
    if K.blocksize[0] != K.blocksize[1]:
        raise InputError(f"K must have square blocks, got {K.blocksize}")
    if not K.has_sorted_indices or not K.has_canonical_format:
        K = K.copy()
        K.sum_duplicates()
    if len(K.data) >= 2**31:
        raise InputError(f"K has {len(K.data)} blocks, more than 32-bit indices can count")
    if np.iscomplexobj(K.data):
        raise InputError(
            f"K must be real, got {K.data.dtype}; split it into real and imaginary parts"
        )
    data = np.ascontiguousarray(check_finite("K.data", np.asarray(K.data, np.float64)))
    largest = max(float(data.max(initial=0.0)), -float(data.min(initial=0.0)))
    if largest > LARGEST:
        raise InputError(
            f"K has entries of {largest:.3g}, of which squares overflow; use other units, so that "
            f"they are below {LARGEST:g}"
        )
    if 0.0 < largest < SMALLEST:
        raise InputError(
            f"K has entries of {largest:.3g} at most, of which squares vanish; use other units, so "
            f"that they are above {SMALLEST:g}"
        )
    indices, indptr = (np.asarray(a, np.int32) for a in (K.indices, K.indptr))
    return bsr_array((data, indices, indptr), shape=K.shape)


def _half(K: bsr_array) -> Symmetric:
    """The half of a matrix, which must be symmetric and have blocks on its diagonal."""
    rows = np.repeat(np.arange(len(K.indptr) - 1, dtype=np.int32), np.diff(K.indptr))
    there = np.zeros(len(K.indptr) - 1, np.bool_)
    there[rows[rows == K.indices]] = True
    if not there.all():
        raise InputError(
            f"K must have a positive diagonal: it has no entry for node {int(np.argmin(there))}; "
            "drop nodes without stiffness"
        )
    _check_symmetric(K, rows)
    return Symmetric.of(K)


def _check_symmetric(K: bsr_array, rows: AnyArray) -> None:
    """Compare entries with those across the diagonal, relative to what is on it in both rows."""
    across = np.argsort(K.indices, kind="stable")  # in the order of columns
    if not (np.array_equal(K.indices, rows[across]) and np.array_equal(rows, K.indices[across])):
        _check_symmetric(*_filled_up(K))
        return
    size = np.sqrt(np.abs(K.diagonal())).reshape(-1, K.blocksize[0])
    for lo in range(0, len(across), FINE):
        some = slice(lo, lo + FINE)
        gap = np.abs(K.data[some] - K.data[across[some]].transpose(0, 2, 1))
        least = ASYMMETRY * size[rows[some], :, None] * size[K.indices[some], None, :]
        if (gap > least).any():
            k, a, b = np.argwhere(gap > least)[0]
            m, at = K.blocksize[0], lo + k
            raise InputError(
                f"K must be symmetric: the entries ({m * rows[at] + a}, {m * K.indices[at] + b}) "
                f"and across the diagonal differ by {gap[k, a, b]:.2e}"
            )


def _filled_up(K: bsr_array) -> tuple[bsr_array, AnyArray]:
    """The same matrix with zero blocks where others are across the diagonal, and rows of blocks."""
    n, m = len(K.indptr) - 1, K.blocksize[0]
    rows = np.repeat(np.arange(n), np.diff(K.indptr))
    i, j = np.concatenate([rows, K.indices]), np.concatenate([K.indices, rows])
    key, slot = np.unique(i.astype(np.int64) * n + j, return_inverse=True)
    data = np.zeros((len(key), m, m))
    data[slot[: len(rows)]] = K.data
    rows = (key // n).astype(np.int32)
    offsets = np.append(0, np.cumsum(np.bincount(rows, minlength=n))).astype(np.int32)
    return bsr_array((data, (key % n).astype(np.int32), offsets), shape=K.shape), rows


def _again(K: Any, near_nullspace: Any, method: str, coordinates: Any) -> Solver:
    """A solver from a pickle."""
    return Solver(K, near_nullspace=near_nullspace, method=method, coordinates=coordinates)
