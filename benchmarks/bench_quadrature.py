"""Rules on cut cells, one thread, against NumPy evaluating the level set once at their points."""

from collections.abc import Iterator

import numba
import numpy as np

import ilattice as il
from benchmarks import references
from benchmarks.measure import Row, cpu
from ilattice._typing import FloatArray
from ilattice.bspline.fit import fit
from ilattice.quadrature.cutting import CutGrid
from ilattice.quadrature.grid import CUT

#: Microseconds per cut cell of the fastest compiled C++ code that we know, q = 2, 3, 4, one
#: thread of a 2.5 GHz server core, and how much of that we allow ourselves.
LEADER = {"sphere": ((2.8, 4.6, 7.2), 0.9), "gyroid": ((10.4, 16.5, 25.2), 0.35)}

#: With few points per cell the recursion counts, with many the points.
GOALS = {2: "<= 3x", 3: "<= 1x", 4: "<= 0.6x"}


def sphere(n: int) -> CutGrid:
    """Ball of radius 0.4 in a cube of edge 1 with n³ cells."""
    box = [[-0.5] * 3, [0.5] * 3]
    spline = fit(lambda u: (u**2).sum(axis=1) - 0.16, domain=box, degree=2, spans=n)
    return il.cutfem.cut(spline)


def gyroid(n: int, *, sheet: bool) -> CutGrid:
    """Gyroid solid g < 0.3, or sheet |g| < 0.3, as splines on n³ cells."""
    field = il.tiles["gyroid"]
    parts = [lambda u: field(u) - 0.3, lambda u: -field(u) - 0.3][: 1 + sheet]
    splines = [fit(f, degree=2, spans=n, method="interpolate") for f in parts]
    return il.cutfem.cut(tuple(splines))


class Rules:
    """Volume rule of all cut cells, Bernstein tensors included."""

    def __init__(self, cut: CutGrid, q: int) -> None:
        self.cut, self.q = cut, q
        self.cells = len(cut.cells(CUT))
        rule = cut.volume(q, only="cut")
        boxes = cut.grid.boxes(rule.cells)[rule.owners]
        self.local: FloatArray = (rule.points - boxes[:, :3]) / boxes[:, 3:]
        index = np.stack(np.unravel_index(rule.cells, cut.grid.shape), axis=1)
        self.tensors = cut.pieces.tensors(index)[:, 0][rule.owners]

    def time_rule(self) -> None:
        self.cut.volume(self.q, only="cut")

    def time_evaluate(self) -> None:
        references.bernstein(self.tensors, self.local)


def rows(quick: bool) -> Iterator[Row]:
    """Lines of the table."""
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        yield from _rows(8 if quick else 16, 8 if quick else 32)
    finally:
        numba.set_num_threads(threads)


def _rows(n_sphere: int, n_gyroid: int) -> Iterator[Row]:
    cuts = {
        f"sphere n={n_sphere}": sphere(n_sphere),
        f"gyroid n={n_gyroid}": gyroid(n_gyroid, sheet=False),
        f"sheet n={n_gyroid}": gyroid(n_gyroid, sheet=True),
    }
    times: dict[tuple[str, int], float] = {}
    for name, cut in cuts.items():
        for q in (2, 3, 4):
            bench = Rules(cut, q)
            kind = name.split()[0]
            ours = times[kind, q] = cpu(bench.time_rule, 9) / bench.cells * 1e6
            theirs = cpu(bench.time_evaluate, 5) / bench.cells * 1e6
            leader, share = LEADER.get(kind, ((0.0,) * 3, 0.0))
            text = f"{ours:.2f} us per cut cell"
            if share:
                text += f" (C++ {leader[q - 2]} us, we allow {share * leader[q - 2]:.2f})"
            yield Row(f"rule of the {name}, q={q}", text, f"{theirs:.2f} us NumPy values there",
                      ours / theirs, GOALS[q])  # fmt: skip
    for q in (2, 3, 4):
        one, two = times["gyroid", q], times["sheet", q]
        yield Row(f"two level sets, q={q}", f"{two:.2f} us", f"{one:.2f} us for one",
                  two / one, "<= 1.5x")  # fmt: skip
