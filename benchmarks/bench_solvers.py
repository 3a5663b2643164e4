"""Our multigrid against pyamg's smoothed aggregation, both inside of conjugate gradients.

Each measurement is a process of its own, so that its peak memory is its own:
``python -m benchmarks.bench_solvers METHOD CASE``. ``python -m benchmarks.bench_solvers sizes``
prints what multigrid takes for one part on finer and finer grids, up to five million unknowns.
"""

import json
import sys
import time
from collections.abc import Iterator
from importlib.util import find_spec

from benchmarks import systems
from benchmarks.measure import Row, alone, table, wall
from ilattice._stages import peak_megabytes
from ilattice.cutfem import Solver

MODULE = "benchmarks.bench_solvers"
DUCK, TORUS = (144, 40, 32), (128, 16, 16)
#: Tile, cells, cells per tile, fixed faces.
CASES = {
    "block": (systems.cross, (24, 16, 16), 8, "x0 x1"),
    "torus struts": (systems.cross, TORUS, 8, "z0"),
    "torus sheet": (systems.sheet(0.5), TORUS, 8, "z0"),
    "duck struts": (systems.cross, DUCK, 8, "x0 x1"),
    "duck sheet": (systems.sheet(0.6), DUCK, 8, "x0 x1"),
    "beam": (systems.cross, TORUS, 8, "x0"),
    "sheet 8": (systems.sheet(0.5), TORUS, 8, "z0"),
    "sheet 16": (systems.sheet(0.5), (256, 32, 32), 16, "z0"),
    "sheet 24": (systems.sheet(0.5), (384, 48, 48), 24, "z0"),
    "sheet 36": (systems.sheet(0.5), (576, 72, 72), 36, "z0"),
}


def case(name: str, *, half: bool = False) -> systems.System:
    """One of `CASES`."""
    inside, cells, per_tile, fixed = CASES[name]
    return systems.system(inside, cells, per_tile=per_tile, fixed=fixed, half=half)


def measure(method: str, name: str) -> dict[str, float]:
    """Seconds of set-up and solution to 1e-8, iterations, unknowns, peak memory.

    Multigrid gets the half of the matrix that analyses make, others all of it.
    """
    small = case("block")
    Solver(small.K, near_nullspace=small.modes, method=method).solve(small.f)  # compile or load
    s = case(name, half=method == "multigrid")
    held = peak_megabytes() or 0.0
    start = time.perf_counter()
    solver = Solver(s.K, near_nullspace=s.modes, method=method)
    _, report = solver.solve(s.f)
    return {
        "seconds": time.perf_counter() - start,
        "setup": report.setup_seconds,
        "iterations": report.iterations,
        "unknowns": report.size,
        "entries": s.K.nnz,
        "matrix_megabytes": held,
        "megabytes": peak_megabytes() or 0.0,
    }


class Solve:
    """Set-up and solution."""

    params = (("multigrid", "superlu"), ("block", "torus struts"))
    param_names = ("method", "case")

    def setup(self, method: str, name: str) -> None:
        self.system = case(name)
        self.time_solve(method, name)

    def time_solve(self, method: str, name: str) -> None:
        s = self.system
        Solver(s.K, near_nullspace=s.modes, method=method).solve(s.f)


class Matvec:
    """Product of a matrix with a vector."""

    def __init__(self, name: str = "torus struts") -> None:
        s = case(name)
        self.K, self.x = s.K, s.f
        self.solver = Solver(s.K, near_nullspace=s.modes, method="multigrid")

    def time_ours(self) -> None:
        self.solver.multiply(self.x)

    def time_scipy(self) -> None:
        self.K @ self.x


def rows(quick: bool) -> Iterator[Row]:
    """Lines of the table."""
    bench = Matvec("block" if quick else "duck struts")
    ours, theirs = wall(bench.time_ours, 9), wall(bench.time_scipy, 9)
    yield Row(
        f"product of a matrix of {bench.K.nnz / 1e6:.1f} million entries, wall",
        f"{1e3 * ours:.1f} ms",
        f"{1e3 * theirs:.1f} ms scipy BSR",
        ours / theirs,
        "<= 0.85",
    )
    rival = "pyamg" if find_spec("pyamg") else "superlu"
    for name in ("block",) if quick else ("duck struts", "duck sheet"):
        ours, theirs = (alone(MODULE, method, name) for method in ("multigrid", rival))
        yield Row(
            f"{name}, {ours['unknowns'] / 1e3:.0f} thousand unknowns, set-up and solution, wall",
            f"{ours['seconds']:.1f} s, {ours['iterations']:.0f} it",
            f"{theirs['seconds']:.1f} s, {theirs['iterations']:.0f} it {rival}",
            ours["seconds"] / theirs["seconds"],
            "<= 0.4",
        )


def sizes() -> str:
    """Table of one part on finer and finer grids."""
    found = [alone(MODULE, "multigrid", f"sheet {n}") for n in (8, 16, 24, 36)]
    lines = ["unknowns  iterations  set-up s  solution s  GB of K  GB in all"]
    lines += [
        f"{r['unknowns']:8.0f}  {r['iterations']:10.0f}  {r['setup']:8.1f}  "
        f"{r['seconds'] - r['setup']:10.1f}  {8e-9 * r['entries']:7.2f}  "
        f"{1e-3 * r['megabytes']:9.2f}"
        for r in found
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    if sys.argv[1] == "sizes":
        print(sizes())
    elif sys.argv[1] == "table":
        print(table(rows(quick=False)))
    else:
        print(json.dumps(measure(sys.argv[1], sys.argv[2])))
