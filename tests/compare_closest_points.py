"""Compare closest points with the naive oracle in large sets: minutes each, not part of the suite.

    python tests/compare_closest_points.py [--queries 10000] [--seed 0] [SHAPE/TILE/BOUNDARY ...]

Without arguments all sets: three maps, three tiles, continued and clipped. Prints a line per set,
and every query that differs; ends with an error if one does.
"""

import argparse
import sys
import time
import warnings
from itertools import product

import naive_closest as nc
import numpy as np

from ilattice.errors import PrecisionWarning

SETS = ["/".join(s) for s in product(nc.MAPS, nc.TERMS, ("extend", "clip"))]


def compare(name, n, seed):
    """Queries of one set whose distance differs from the oracle's by more than rounding."""
    shape, tile, boundary = name.split("/")
    lattice = nc.lattice_of(shape, tile, boundary)
    oracle = nc.Oracle(tile, lattice)
    q = nc.queries(oracle, n, seed)
    u = nc.parameters(lattice, q)
    start = time.process_time()
    found = lattice.closest(u)
    middle = time.process_time()
    known, foot = oracle.distance(q)
    ends = time.process_time()
    size = np.linalg.norm(lattice.through.jacobian(u) * lattice.search.step, axis=1).max(axis=1)
    distance = np.abs(found.distance)
    slack = 1e-8 * size + 1e-7 * known
    wrong, missed = distance > known + slack, distance < known - slack
    print(
        f"{name}: {wrong.sum()} of {n} too far, {missed.sum()} nearer than the oracle, "
        f"{(found.status == 2).sum()} fell back; {middle - start:.1f} s, oracle "
        f"{ends - middle:.0f} s",
        flush=True,
    )
    p = lattice.tile_coordinates(found.u)
    for i in np.flatnonzero(wrong | missed):
        print(f"  {q[i]} -> {p[i]}, {distance[i]:.9g}; oracle {foot[i]}, {known[i]:.9g}")
    return int(wrong.sum() + missed.sum())


def main():
    """Parse the arguments, compare, report."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("sets", nargs="*", default=SETS, metavar="SET", help=", ".join(SETS))
    parser.add_argument("--queries", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    warnings.simplefilter("ignore", PrecisionWarning)
    sys.exit(int(sum(compare(s, arguments.queries, arguments.seed) for s in arguments.sets) > 0))


if __name__ == "__main__":
    main()
