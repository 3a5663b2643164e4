"""True offsets of the lattice of Figure 14 (a) against a k-d tree with the same queries."""

from collections.abc import Iterator
from typing import Any

import numpy as np

import ilattice as il
from benchmarks import references
from benchmarks.measure import Row, wall
from ilattice._typing import FloatArray
from ilattice.bspline.fit import sites

PAPER = "paper: 0.41-1.24 s torus, 3.05-8.73 s duck, one M2 Max core"


def sites_of(spline: il.BSpline) -> FloatArray:
    """Parameters at which the distance is interpolated, one per distinct coefficient."""
    parts = zip(spline.t, spline.k, spline.periodic, strict=True)
    axes = [sites(t, k, "interpolate", periodic) for t, k, periodic in parts]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


class Torus:
    """Gyroid in the torus, 16 x 2 x 2 tiles, half-thickness 0.1."""

    repeat = (16, 2, 2)
    through = staticmethod(il.macroshape.torus)
    d = 0.1

    def setup(self) -> None:
        self.space = self.through()
        lattice = self.lattice()
        self.cloud = il.offsets.ClosestPointSearch(lattice).seeds[1]
        self.queries = self.space.x(sites_of(lattice.offset(self.d).distance))

    def lattice(self) -> Any:
        """A new lattice, nothing cached."""
        return il.Lattice(il.tiles["gyroid"], through=self.space, repeat=self.repeat)

    def time_offset(self) -> None:
        self.lattice().offset(self.d)

    def time_nearest(self) -> None:
        references.nearest(self.cloud, self.queries)


class Duck(Torus):
    """Gyroid in the duck, 18 x 5 x 4 tiles, half-thickness 0.01."""

    repeat = (18, 5, 4)
    through = staticmethod(il.macroshape.duck)
    d = 0.01


def rows(quick: bool) -> Iterator[Row]:
    """Lines of the table."""
    for kind, goal in ((Torus, "<= 8x"), (Duck, "")):
        bench = kind()
        if quick:
            bench.repeat = tuple(max(1, n // 4) for n in bench.repeat)
        bench.setup()
        ours, tree = wall(bench.time_offset, 3), wall(bench.time_nearest, 3)
        yield Row(
            f"offset of the {kind.__name__.lower()}, {len(bench.queries)} sites, wall",
            f"{ours:.2f} s ({PAPER})" if kind is Torus else f"{ours:.2f} s",
            f"{tree:.2f} s cKDTree, 2 workers, {len(bench.cloud)} points",
            ours / tree,
            goal,
        )
