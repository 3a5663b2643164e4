"""Run all benchmarks and print one table of ratios: ``python -m benchmarks [--quick]``.

With ``--save docs/benchmarks.json`` rows of these modules take the places of older ones in the file
from which the page of the documentation is made.
"""

import argparse
import json
import os
import platform
from dataclasses import asdict, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numba

import ilattice
from benchmarks.measure import Row, table

MODULES = (
    "bspline", "offsets", "contouring", "fields", "quadrature", "mesh_distance", "figures",
    "solvers", "analyses", "accuracy", "homogenize", "cost", "skeletons",
)  # fmt: skip


def main() -> None:
    """Parse the arguments, run, print, and keep."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small sizes, minutes become seconds")
    parser.add_argument("--save", type=Path, help="file for the page of the documentation")
    parser.add_argument("only", nargs="*", default=MODULES, metavar="MODULE", help=str(MODULES))
    arguments = parser.parse_args()
    rows = []
    for name in arguments.only:
        found = list(import_module(f"benchmarks.bench_{name}").rows(arguments.quick))
        if arguments.quick:  # the goals are for the full sizes
            found = [replace(row, goal="") for row in found]
        rows += found
        if arguments.save:
            save(arguments.save, name, found, quick=arguments.quick)
    print(", ".join(str(part) for part in machine().values()))
    print(table(rows))


def machine() -> dict[str, Any]:
    """What the numbers depend on."""
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    return {
        "machine": platform.machine(),
        "cores": f"{os.cpu_count()} cores",
        "threads": f"numba on {numba.get_num_threads()} threads",
        "version": f"ilattice {ilattice.__version__}",
        "load": f"load {load}",
    }


def save(path: Path, module: str, rows: list[Row], *, quick: bool) -> None:
    """Put the rows of a module into a file, in place of older ones."""
    known = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    known[module] = {"quick": quick, **machine(), "rows": [asdict(row) for row in rows]}
    path.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
