"""A curved beam of tiles under its weight: all of it resolved, and as a homogeneous solid.

The tiles of a Schwarz-P lattice fill an arch, one, two and three of them over its height, and as
many times more along it; their walls are thinner by as much, so that all lattices have the same
relative density, and the same effective stiffness. The arch of that stiffness, with axes that turn
along it, is solved on a grid that knows of no tiles. The number that is checked: by how much the
homogeneous arch is off in the work of its weight, against lattices that are cut out of grids of six
cells per tile; it falls as tiles get smaller. Free faces cut through tiles, which then bear less
than they do inside.

    python examples/homogenized_beam.py
"""

import warnings

import numpy as np

import ilattice as il


def arch() -> il.macroshape.SplineMap:
    """A fifth of a ring, one high and one wide: around, along the radius, along the axis."""
    corners = [[[4.0, 0.0, 0.0], [4.0, 0.0, 1.0]], [[5.0, 0.0, 0.0], [5.0, 0.0, 1.0]]]
    section = il.BSpline([[0, 0, 1, 1], [0, 0, 1, 1]], corners, 1)
    return il.macroshape.revolve(section, axis=(0, 0, 1), angle=0.2 * np.pi)


def work(problem: il.cutfem.Elasticity) -> float:
    """Of the weight, of an arch that is held at one end."""
    held = problem.clamp("u=0").load(gravity=(-0.3, 0.0, -1.0))
    return held.solve(tol=1e-6).compliance


def main(most: int = 3, d: float = 0.11, per_tile: int = 6) -> dict[str, float]:
    """The error of the homogeneous arch over the number of tiles across it."""
    through, out = arch(), {}
    with warnings.catch_warnings():  # both have six cells per tile: what these miss is the same
        warnings.simplefilter("ignore", il.errors.PrecisionWarning)
        for n in range(1, most + 1):
            wall = il.Lattice("schwarz_p", through=through, repeat=(3 * n, n, n)).offset(d / n)
            full = il.cutfem.Elasticity(wall, [per_tile * k for k in (3 * n, n, n)])
            smooth = il.homogenize.macro(
                wall, (12, 4, 4), tile_cells=per_tile, samples=3, estimate=False
            )
            out[f"error with {n} tiles across"] = work(smooth) / work(full) - 1.0
    return out


if __name__ == "__main__":
    for name, number in main().items():
        print(f"{name}: {number:+.3f}")
