"""True offsets of Figure 14 (a), and changes of topology, against k-d trees and scipy."""

from collections.abc import Iterator
from typing import Any

import numpy as np

import ilattice as il
from benchmarks import references
from benchmarks.measure import Row, wall
from ilattice._geometry import grid_points
from ilattice._typing import FloatArray
from ilattice.bspline.fit import sites
from ilattice.topology import _kernels_hull
from ilattice.topology.clearance import Clearance
from ilattice.topology.critical import critical_points
from ilattice.topology.windows import Windows

PAPER = "paper: 0.41-1.24 s torus, 3.05-8.73 s duck, one M2 Max core"


def sites_of(spline: il.BSpline) -> FloatArray:
    """Parameters at which the distance is interpolated, one per distinct coefficient."""
    parts = zip(spline.t, spline.k, spline.periodic, strict=True)
    axes = [sites(t, k, "interpolate", periodic) for t, k, periodic in parts]
    return grid_points(*axes)


class Torus:
    """Gyroid in the torus, 16 x 2 x 2 tiles, half-thickness 0.1."""

    repeat = (16, 2, 2)
    through = staticmethod(il.macroshape.torus)
    d = 0.1

    def setup(self) -> None:
        self.space = self.through()
        lattice = self.lattice()
        self.cloud = il.offsets.ClosestPointSearch(lattice).seeds.images
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


class Events:
    """All changes of topology of a bent cell of the gyroid, and the queries of its grid alone.

    The lattice has its spline of the distance and its seeds already.
    """

    def setup(self) -> None:
        space = il.macroshape.cylinder_shell(2.0, 3.0, 1.0, angle=0.4)
        self.lattice = il.Lattice(il.tiles["gyroid"], through=space)
        windows = Windows(Clearance(self.lattice))
        axes = [
            np.linspace(*side, n) for side, n in zip(space.domain.T, windows.shape, strict=True)
        ]
        self.nodes = space.x(grid_points(*axes))
        self.cloud = self.lattice.search.seeds.images

    def time_events(self) -> None:
        critical_points(self.lattice, 0.05, 0.5)

    def time_nearest(self) -> None:
        references.nearest(self.cloud, self.nodes)


class Means:
    """Shortest weighted means of the directions of 64 nodes, as windows of cells need them."""

    count, nodes = 20_000, 64

    def setup(self) -> None:
        vectors = np.random.default_rng(0).normal(size=(self.count * self.nodes, 3))
        vectors[:, 0] += 2.5  # some hulls hold the origin
        self.vectors = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
        self.ends = np.arange(0, len(vectors) + 1, self.nodes)
        self.out = np.empty((self.count, 4), np.int64), np.empty((self.count, 4))

    def time_means(self) -> None:
        pull = np.empty(self.count)
        _kernels_hull.shortest_means(self.count, self.ends, self.vectors, *self.out, pull)

    def time_nnls(self) -> None:
        references.shortest_means(self.ends, self.vectors)


def topology(quick: bool) -> Iterator[Row]:
    """Lines of the table about changes of topology."""
    events, means = Events(), Means()
    if quick:
        means.count //= 10
    events.setup()
    means.setup()
    ours, tree = wall(events.time_events, 3), wall(events.time_nearest, 3)
    yield Row(
        "all changes of topology of a bent gyroid, distance spline given, wall",
        f"{ours:.2f} s",
        f"{tree:.3f} s cKDTree, 2 workers, {len(events.nodes)} nodes",
        ours / tree,
    )
    ours, scipy = wall(means.time_means, 3), wall(means.time_nnls, 1)
    yield Row(
        f"shortest means, {means.count} of {means.nodes} vectors, wall",
        f"{1e6 * ours / means.count:.2f} us each",
        f"{1e6 * scipy / means.count:.2f} us nnls",
        ours / scipy,
    )


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
    yield from topology(quick)
