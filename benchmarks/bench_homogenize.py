"""Homogenization: voxels against a plain prototype, cut cells against voxels, loads together.

``python -m benchmarks.bench_homogenize memory`` prints the peak memory of six loads at 100³ voxels.
The prototype is what one writes first: an element matrix per voxel, gathered and scattered node by
node, load after load, with a preconditioner of the homogeneous grid in double precision.
"""

import json
import sys
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit, prange

import ilattice as il
from benchmarks.measure import Row, alone, in_turns
from ilattice._stages import peak_megabytes
from ilattice.cutfem import Solver
from ilattice.homogenize import ElasticCell, tensors, voxels
from ilattice.homogenize._spectral import VoxelGrid

MODULE = "benchmarks.bench_homogenize"
#: Stiffness of the sheet, extrapolated from 16³ and 20³ cut cells of degree 2, to tell errors by.
C11 = 0.16066
VOID, TOL = 1e-6, 1e-4


def gyroid(n: int, half: float = 0.92) -> Any:
    """Flags of a sheet of about three tenths on n³ voxels, by their middles."""
    u = (np.arange(n) + 0.5) / n
    x, y, z = 2.0 * np.pi * np.array(np.meshgrid(u, u, u, indexing="ij"))
    f = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)
    return np.abs(f) < half / 2.0


def sheet(cells: int) -> ElasticCell:
    """A sheet of three tenths on cut cells."""
    lattice = il.Lattice("gyroid", through=il.macroshape.cell(), repeat=1)
    return ElasticCell(lattice.offset(relative_density=0.3), cells)


# ------------------------------------------------------------------- prototype


def element(lam: float, mu: float) -> Any:
    """Stiffness (24, 24) of a trilinear unit voxel by eight Gauss points."""
    corners = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    C = tensors.isotropic(lam, mu)
    out = np.zeros((24, 24))
    for g in 0.5 + np.where(corners, 0.5, -0.5) / 3**0.5:
        part = np.where(corners, g, 1.0 - g)
        slope = np.where(corners, 1.0, -1.0)
        grad = np.stack([slope[:, a] * np.delete(part, a, 1).prod(1) for a in range(3)], axis=1)
        B = np.zeros((6, 24))
        for c, (x, y, z) in enumerate(grad):
            B[:, 3 * c : 3 * c + 3] = [
                [x, 0, 0], [0, y, 0], [0, 0, z], [0, z, y], [z, 0, x], [y, x, 0]
            ]  # fmt: skip
        out += B.T @ C @ B / 8.0
    return out


@njit(cache=True, parallel=True)
def forces(u: Any, scale: Any, KE: Any, out: Any) -> None:
    """Forces of every node from the eight voxels around it."""
    n = len(u)
    for i in prange(n):
        for j in range(n):
            for k in range(n):
                f0 = f1 = f2 = 0.0
                for c in range(8):
                    a, b, d = (i - (c >> 2)) % n, (j - (c >> 1 & 1)) % n, (k - (c & 1)) % n
                    s = scale[a, b, d]
                    for e in range(8):
                        v = u[(a + (e >> 2)) % n, (b + (e >> 1 & 1)) % n, (d + (e & 1)) % n]
                        for q in range(3):
                            w = s * v[q]
                            f0 += KE[3 * c, 3 * e + q] * w
                            f1 += KE[3 * c + 1, 3 * e + q] * w
                            f2 += KE[3 * c + 2, 3 * e + q] * w
                out[i, j, k, 0], out[i, j, k, 1], out[i, j, k, 2] = f0, f1, f2


@dataclass
class Prototype:
    """Six loads of a grid of voxels, one after the other."""

    solid: Any

    def __post_init__(self) -> None:
        n = len(self.solid)
        self.scale = np.where(self.solid, 1.0, VOID)
        self.KE = element(0.3 / 0.52, 1.0 / 2.6)
        impulse = np.zeros((3, n, n, n, 3))
        symbol = np.empty((3, n, n, n // 2 + 1, 3), complex)
        for a in range(3):
            impulse[a, 0, 0, 0, a] = 1.0
            out = np.empty((n, n, n, 3))
            forces(impulse[a], np.ones((n, n, n)), self.KE, out)
            symbol[a] = np.fft.rfftn(out, axes=(0, 1, 2))
        symbol[:, 0, 0, 0] = np.eye(3)
        self.inverse = np.linalg.inv(np.moveaxis(symbol, 0, -1))
        self.inverse[0, 0, 0] = 0.0

    def precondition(self, r: Any) -> Any:
        """The homogeneous grid, inverted."""
        z = np.einsum("ijkab,ijkb->ijka", self.inverse, np.fft.rfftn(r, axes=(0, 1, 2)))
        return np.fft.irfftn(z, s=r.shape[:3], axes=(0, 1, 2))

    def __call__(self) -> int:
        """Steps of the load that takes most."""
        corners = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)], float)
        return max(self._solve(corners @ E) for E in tensors.strain_matrices())

    def _solve(self, affine: Any) -> int:
        f = -(self.KE @ affine.ravel()).reshape(8, 3)
        b = np.zeros((*self.scale.shape, 3))
        for c in range(8):
            at = (c >> 2, c >> 1 & 1, c & 1)
            b += np.roll(self.scale[..., None] * f[c], at, axis=(0, 1, 2))
        x, r, q = np.zeros_like(b), b, np.empty_like(b)
        z = self.precondition(r)
        p, rz = z, float((r * z).sum())
        first = rz
        for step in range(1, 500):
            forces(p, self.scale, self.KE, q)
            alpha = rz / float((p * q).sum())
            x, r = x + alpha * p, r - alpha * q
            z = self.precondition(r)
            old, rz = rz, float((r * z).sum())
            if rz <= TOL**2 * first:
                return step
            p = z + rz / old * p
        raise RuntimeError("the prototype does not converge")


# ------------------------------------------------------------------- table


def ours(n: int, young: Any = (VOID, 1.0)) -> il.homogenize.Effective:
    """Six loads of n³ voxels."""
    return voxels(gyroid(n).astype(int), young=young, tol=TOL, estimate=False)


def waves(cells: int, count: int, steps: int) -> tuple[float, Any]:
    """Seconds of CPU of bands over the edges of the zone of a cube, and steps of all of them."""
    domain = sheet(cells).domain
    start = time.process_time()
    found = il.homogenize.bloch(domain, cells, path="GXMRG", count=count, steps=steps)
    return time.process_time() - start, found.report.steps


def together(cells: int) -> tuple[float, float]:
    """Wall times of six right-hand sides of cut cells, and of one."""
    problem = sheet(cells)
    system, F = problem.system, problem.load_vectors()
    B = np.stack([system.constraints.restrict(F[..., i]).ravel() for i in range(6)], axis=1)
    solver = Solver(
        system.K,
        near_nullspace=system.near_nullspace,
        coordinates=system.coordinates,
        method="multigrid",
    )
    return in_turns(lambda: solver.solve(B), lambda: solver.solve(B[:, 0]), 7)


@njit(cache=True, parallel=True)
def copy(a: Any, b: Any) -> None:
    """What memory does at best."""
    for i in prange(len(a)):
        b[i] = a[i]


def of_memory(n: int) -> tuple[float, float]:
    """Seconds of the forces of n³ voxels, and of memory alone for what they must move.

    A field is read, another one written, and the phases are read: 52 bytes per voxel.
    """
    grid = VoxelGrid(
        gyroid(n).astype(np.int32), np.array([[0.0, 0.0], [0.6, 0.4]]), np.full(3, 1.0 / n),
        np.array([0.6, 0.4]),
    )  # fmt: skip
    u, a = np.random.default_rng(0).random(grid.shape), np.ones(1 << 24)
    b = np.zeros_like(a)
    taken, copied = in_turns(lambda: grid.forces(u), lambda: copy(a, b), 5)
    return taken, copied * 52.0 * n**3 / (16.0 * len(a))


def once(work: Any) -> tuple[float, Any]:
    """Wall time of one run, and what it returns."""
    start = time.perf_counter()
    found = work()
    return time.perf_counter() - start, found


def of_voxels(counts: tuple[int, ...]) -> Iterator[tuple[Row, float, Any]]:
    """Against the prototype: lines, wall times, and stiffnesses of ours."""
    ours(8), Prototype(gyroid(8))()  # which compiles
    for n in counts:
        prototype = Prototype(gyroid(n))
        (a, eff), (b, _) = once(lambda n=n: ours(n)), once(prototype)  # type: ignore[misc]
        yield Row(f"six loads of {n}³ voxels, wall", f"{a:.2f} s", f"{b:.2f} s prototype",
                  a / b, "<= 0.55"), a, eff  # fmt: skip


def rows(quick: bool) -> Iterator[Row]:
    """Lines of the table."""
    warnings.simplefilter("ignore", il.errors.PrecisionWarning)
    for row, taken, eff in of_voxels((16, 24) if quick else (60, 100)):
        yield row
        seconds, coarse = taken, eff
    if not quick:
        peak = alone(MODULE, "measure")["megabytes"]
        yield Row("peak memory of six loads of 100³ voxels", f"{peak:.0f} MB", "", peak, "<= 1500")
    n = 32 if quick else 100
    taken, least = of_memory(n)
    yield Row(f"forces of {n}³ voxels, wall: part of the bandwidth bound", f"{1e3 * taken:.1f} ms",
              f"{1e3 * least:.1f} ms memory alone", least / taken)  # fmt: skip
    steps = [ours(n).report.iterations for n in ((12, 24) if quick else (20, 40, 80))]
    steps += [ours(24, (v, 1.0)).report.iterations for v in (1e-3, 1e-6, 1e-9)]
    yield Row("iterations over voxels and contrasts, spread", " ".join(map(str, steps)), "",
              max(steps) - min(steps), "<= 4")  # fmt: skip
    cells = 6 if quick else 10
    sheet(4).homogenized(estimate=False)
    of_cut, fine = once(lambda: sheet(cells).homogenized(estimate=False))
    off = [abs(e.C[0, 0] * 0.3 / e.density / C11 - 1.0) for e in (fine, coarse)]
    yield Row(
        f"gyroid, {cells}³ cut cells against {coarse.report.cells[0]}³ voxels, wall",
        f"{of_cut:.2f} s, off by {100 * off[0]:.2g} %",
        f"{seconds:.2f} s, off by {100 * off[1]:.2g} %", of_cut / seconds, "<= 0.3",
    )  # fmt: skip
    cells, count, steps = (5, 4, 2) if quick else (16, 10, 8)
    seconds, taken = waves(cells, count, steps)
    yield Row(
        f"{count} bands at {len(taken)} wave vectors, {cells}³ cut cells, CPU",
        f"{seconds:.1f} s",
        " ".join(map(str, taken)) + " steps",
        seconds / len(taken),
    )
    cells = 8 if quick else 16
    six, one = together(cells)
    yield Row(f"six right-hand sides of {cells}³ cut cells, wall", f"{1e3 * six:.0f} ms",
              f"{1e3 * one:.0f} ms one", six / one, "<= 2.5")  # fmt: skip


def memory() -> dict[str, float]:
    """Peak megabytes of six loads at 100³ voxels."""
    ours(100)
    return {"megabytes": peak_megabytes() or 0.0}


if __name__ == "__main__":
    if sys.argv[1:] == ["memory"]:
        print(alone(MODULE, "measure"))
    else:
        print(json.dumps(memory()))
