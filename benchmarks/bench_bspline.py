"""Evaluation and fit of splines against SciPy, on the spline that paper-sized lattices need."""

from collections.abc import Iterator

import numba
import numpy as np
from scipy.interpolate import NdBSpline

from benchmarks import references
from benchmarks.measure import Row, cpu, in_turns
from ilattice._typing import FloatArray
from ilattice.bspline import BSpline

SHAPE = (259, 35, 35)


def spline_a(seed: int = 1) -> BSpline:
    """Scalar, degree 2, 259 x 35 x 35 random coefficients, clamped uniform knots."""
    knots = [np.r_[0, 0, np.linspace(0, 1, n - 1), 1, 1] for n in SHAPE]
    return BSpline(knots, np.random.default_rng(seed).standard_normal(SHAPE), 2)


def points(order: str, n: int, seed: int = 2) -> FloatArray:
    """`n` uniform points of the unit cube, "random" or sorted by knot span ("ordered")."""
    p = np.random.default_rng(seed).random((n, 3))
    if order == "ordered":
        cells = [np.minimum((p[:, i] * (SHAPE[i] - 2)).astype(int), SHAPE[i] - 3) for i in range(3)]
        p = p[np.lexsort(cells[::-1])]
    return np.ascontiguousarray(p)


class Points:
    """Value and gradient at scattered points."""

    params = ("random", "ordered")
    param_names = ("order",)
    size = 1_000_000

    def setup(self, order: str) -> None:
        self.spline = spline_a()
        self.reference = NdBSpline(self.spline.t, self.spline.c, self.spline.k)
        self.points = points(order, self.size)

    def time_jet(self, order: str) -> None:
        self.spline.jet(self.points, 1)

    def time_ndbspline(self, order: str) -> None:
        references.ndbspline_jet(self.reference, self.points)


class Grid:
    """Value and gradient on a tensor grid."""

    size = 256

    def setup(self) -> None:
        self.spline = spline_a()
        self.axes = (np.linspace(0, 1, self.size),) * 3

    def time_grid(self) -> None:
        self.spline.grid(self.axes, 1)

    def time_store(self) -> None:
        references.store((4, *(self.size,) * 3))


class Fit:
    """Interpolation of 259 x 35 x 35 samples."""

    def setup(self) -> None:
        from ilattice.bspline.fit import fit_interpolate

        self.spline = spline_a()
        self.values = self.spline.grid([self.spline.greville(i) for i in range(3)])
        self.fit = fit_interpolate

    def time_fit(self) -> None:
        self.fit(self.values, self.spline.t, self.spline.k)

    def time_scipy(self) -> None:
        references.interpolate(self.values, self.spline.t, self.spline.k)


def rows(quick: bool) -> Iterator[Row]:
    """The lines of the table."""
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        yield from _point_rows(quick)
        yield _grid_row(quick)
        yield _fit_row()
    finally:
        numba.set_num_threads(threads)
    if numba.config.NUMBA_NUM_THREADS >= 2:
        yield _thread_row(quick)


def _point_rows(quick: bool) -> Iterator[Row]:
    goals = {"random": ">= 20x", "ordered": ">= 30x"}
    for order in Points.params:
        bench = Points()
        bench.size = 100_000 if quick else 1_000_000
        bench.setup(order)
        ours = bench.size / cpu(lambda b=bench, o=order: b.time_jet(o)) / 1e6
        theirs = bench.size / cpu(lambda b=bench, o=order: b.time_ndbspline(o), 2) / 1e6
        yield Row(
            f"spline value + gradient, {order} points, 1 thread",
            f"{ours:.1f} Mpt/s",
            f"{theirs:.2f} Mpt/s scipy NdBSpline",
            ours / theirs,
            goals[order],
        )


def _grid_row(quick: bool) -> Row:
    bench = Grid()
    bench.size = 128 if quick else 256
    bench.setup()
    ours, store = cpu(bench.time_grid), cpu(bench.time_store)
    n = bench.size**3 / 1e6
    return Row(
        f"spline value + gradient, {bench.size}³ grid, 1 thread",
        f"{n / ours:.0f} Mpt/s",
        f"{n / store:.0f} Mpt/s store of the same bytes",
        store / ours,
        ">= 0.6",
    )


def _fit_row() -> Row:
    bench = Fit()
    bench.setup()
    ours, theirs = cpu(bench.time_fit), cpu(bench.time_scipy)
    return Row(
        "interpolation of 259x35x35 samples, 1 thread",
        f"{1e3 * ours:.0f} ms",
        f"{1e3 * theirs:.0f} ms scipy make_interp_spline per axis",
        theirs / ours,
    )


def _thread_row(quick: bool) -> Row:
    bench = Points()
    bench.size = 100_000 if quick else 1_000_000
    bench.setup("ordered")

    def on(threads: int) -> None:
        numba.set_num_threads(threads)
        bench.time_jet("ordered")

    one, two = in_turns(lambda: on(1), lambda: on(2))
    return Row(
        "spline value + gradient, ordered points, wall",
        f"{1e3 * two:.0f} ms on 2 threads",
        f"{1e3 * one:.0f} ms on 1 thread",
        one / two,
        ">= 1.7x",
    )
