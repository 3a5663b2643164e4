"""Run all benchmarks and print one table of ratios: ``python -m benchmarks [--quick]``."""

import argparse
import os
import platform
from dataclasses import replace
from importlib import import_module

import numba

from benchmarks.measure import table

MODULES = (
    "bspline", "offsets", "contouring", "fields", "quadrature", "mesh_distance", "figures",
    "solvers", "analyses", "homogenize", "cost",
)  # fmt: skip


def main() -> None:
    """Parse the arguments, run, print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small sizes, minutes become seconds")
    parser.add_argument("only", nargs="*", default=MODULES, metavar="MODULE", help=str(MODULES))
    arguments = parser.parse_args()
    rows = []
    for name in arguments.only:
        rows += import_module(f"benchmarks.bench_{name}").rows(arguments.quick)
    if arguments.quick:  # the goals are for the full sizes
        rows = [replace(row, goal="") for row in rows]
    print(
        f"{platform.machine()}, {os.cpu_count()} cores, numba on {numba.get_num_threads()} threads"
    )
    print(table(rows))


if __name__ == "__main__":
    main()
