"""CPU seconds and memory to reach 5, 2 and 1 % of the compliance, by degree and smoothness.

The four analyses of Figures 16 and 17 of the paper, and a thick sphere under pressure from inside.
Each space is solved on ever finer grids. Errors are those against the sphere's exact compliance,
and otherwise against the limit of degree 1 on its finest three grids, with the order that these
show; where they show none, or another space is beyond it, as compliances come from below, cells are
still too long for the body, and there are only compliances and times to read. The time for an error
is that of a power law through the two grids next to it; beyond the grids it is an extrapolation,
and marked ``~``. By default there is the space that is chosen on the cells which it needs for that
error, or on the finest of the grids.
Each measurement is a process of its own that has its kernels loaded:
``python -m benchmarks.bench_accuracy BODY DEGREE SMOOTHNESS COARSER``.
"""

import json
import math
import sys
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq

from benchmarks.measure import Row, alone, table
from ilattice._stages import peak_megabytes

MODULE = "benchmarks.bench_accuracy"
EXAMPLES = Path(__file__).parents[1] / "examples"
#: Numbers of a body per degree and smoothness, and by how much cells are longer.
Found = dict[tuple[int, int], dict[float, dict[str, float]]]
#: Bodies, and cells that are so many times longer than those of the paper, or, of the sphere, than
#: a tenth of 2.03, per degree and smoothness: as fine as 12 GB allow.
GRIDS = {
    "sphere": {(1, 0): (4.0, 2.0, 1.0, 2 / 3), (2, 1): (4.0, 2.0, 1.0), (2, 0): (4.0, 2.0, 4 / 3)},
    "fig16c": {(1, 0): (2 / 3, 1 / 2, 1 / 3), (2, 1): (4 / 3, 1.0, 2 / 3), (2, 0): (2.0, 4 / 3)},
    "fig16d": {(1, 0): (1 / 2, 1 / 3, 1 / 4), (2, 1): (2.0, 4 / 3, 1.0), (2, 0): (2.0, 4 / 3, 1.0)},
    "fig17c": {(1, 0): (2 / 3, 1 / 2, 1 / 3), (2, 1): (2.0, 1.0, 2 / 3), (2, 0): (2.0, 4 / 3, 1.0)},
    "fig17d": {(1, 0): (2 / 3, 1 / 2, 1 / 3), (2, 1): (2.0, 4 / 3, 1.0), (2, 0): (2.0, 4 / 3)},
}
QUICK = ("sphere",)
ERRORS = (0.05, 0.02, 0.01)
#: Orders in the length of cells that compliances may show.
ORDERS = (0.5, 4.0)
#: Compliance of an eighth of the sphere of radii 1 and 2 under pressure 1 from inside, Young's
#: modulus 1 and Poisson's ratio 0.3: its inner surface moves by 0.8.
SPHERE = 0.8 * math.pi / 2.0


def problem(body: str, degree: int, smoothness: int, coarser: float) -> Any:
    """A body with its supports and loads."""
    import ilattice as il

    space = {"degree": degree, "smoothness": smoothness}
    if body == "sphere":
        axis = np.linspace(0.0, 2.03, max(round(10 / coarser), 2) + 1)
        solid = (lambda u: (u**2).sum(axis=1) - 4.0, lambda u: 1.0 - (u**2).sum(axis=1))
        posed = il.cutfem.Elasticity(solid, il.cutfem.Grid((axis,) * 3), **space)
        for k, face in enumerate(("u=0", "v=0", "w=0")):
            posed = posed.clamp(face, components=(k,))
        return posed.load(pressure=1.0, on="inner")
    sys.path.insert(0, str(EXAMPLES))
    from fig16_bending import FIGURES, design

    wall, cells, held = design(body)
    force = FIGURES[body][2]

    def load(x: np.ndarray) -> np.ndarray:
        return np.stack([np.zeros(len(x)), np.zeros(len(x)), force(x)], axis=1)

    posed = il.cutfem.Elasticity(wall, tuple(round(n / coarser) for n in cells), **space)
    for face in held:
        posed = posed.clamp(face)
    return posed.load(body=load)


def measure(body: str, degree: int, smoothness: int, coarser: float) -> dict[str, float]:
    """CPU seconds from the posed problem to its solution, compliance, unknowns and memory."""
    warnings.simplefilter("ignore")
    problem(body, degree, smoothness, 4.0).solve()  # load the kernels
    posed = problem(body, degree, smoothness, coarser)
    start = time.process_time()
    solution = posed.solve()
    return {
        "seconds": time.process_time() - start,
        "compliance": solution.compliance,
        "unknowns": solution.report.size,
        "gigabytes": 1e-3 * (peak_megabytes() or 0.0),
    }


def chosen(body: str, coarser: float) -> dict[str, float]:
    """The degree that a body gets on its cells when nobody says; smoothness is one less."""
    from ilattice.cutfem.choosing import degree_for

    return {"degree": degree_for(problem(body, 1, 0, coarser).domain.cut, True)[0]}


def limit_of(body: str, found: Found) -> float:
    """What compliances of degree 1 lead to; NaN where they show no order, or others are beyond."""
    if body == "sphere":
        return SPHERE
    linear = found[1, 0]
    sizes = np.array(sorted(linear)[:3])
    fine, middle, coarse = (linear[h]["compliance"] for h in sizes)

    def off(order: float) -> float:
        powers = sizes**order
        steps = (middle - coarse) * (powers[1] - powers[0])
        return float((fine - middle) * (powers[2] - powers[1]) - steps)

    if off(ORDERS[0]) * off(ORDERS[1]) >= 0.0:
        return math.nan
    powers = sizes ** float(brentq(off, *ORDERS))
    limit = float(fine + (fine - middle) * powers[0] / (powers[1] - powers[0]))
    best = max(one["compliance"] for some in found.values() for one in some.values())
    return limit if best <= limit else math.nan


def to_reach(error: float, errors: list[float], what: list[float]) -> tuple[float, bool]:
    """Seconds, or the size of cells, for an error, and whether that was extrapolated.

    `errors` and `what` are of grids from coarse to fine.
    """
    best = np.minimum.accumulate(errors)
    k = int(np.clip(np.searchsorted(-best, -error), 1, len(best) - 1))
    x, y = np.log(best[k - 1 : k + 1]), np.log(what[k - 1 : k + 1])
    if x[1] >= x[0]:  # nothing gained by the finest cells
        return math.inf, True
    needed = math.exp(y[1] + (y[1] - y[0]) / (x[1] - x[0]) * (math.log(error) - x[1]))
    return needed, not best[-1] <= error <= best[0]


def rows(quick: bool) -> Iterator[Row]:
    """Lines of the table."""
    for body in QUICK if quick else GRIDS:
        found = {
            space: {h: alone(MODULE, body, *space, h) for h in sizes}
            for space, sizes in GRIDS[body].items()
        }
        limit = limit_of(body, found)
        if math.isnan(limit):
            yield Row(f"{body}, no limit yet", _compliances(found), "none", math.nan)
            continue
        for error in ERRORS:
            yield _row(body, found, limit, error)


def _row(body: str, found: Found, limit: float, error: float) -> Row:
    """The line of a body and an error."""
    times = {space: _needed(error, limit, some, "seconds") for space, some in found.items()}
    cells = {space: _needed(error, limit, some, "h")[0] for space, some in found.items()}
    mine = [
        (p, s)
        for (p, s), h in cells.items()
        if s == p - 1
        and math.isfinite(h)
        and alone(MODULE, body, "chosen", max(h, min(found[p, s])))["degree"] == p
    ]
    usual = min((times[space][0] for space in mine), default=math.inf)
    best = min(times, key=lambda space: times[space][0])
    told = ", ".join(
        f"degree {p} smoothness {s} {'~' * far}{seconds:.3g} s {_memory(found[p, s]):.2g} GB"
        for (p, s), (seconds, far) in times.items()
    )
    return Row(
        f"{body}, compliance {limit:.4g} to {100 * error:.0f} %",
        f"{told}; by default {usual:.3g} s",
        f"degree {best[0]}, smoothness {best[1]}",
        usual / times[best][0],
        "<= 1.3",
    )


def _needed(error: float, limit: float, by_size: dict[float, Any], what: str) -> tuple[float, bool]:
    """What `to_reach` has for a space."""
    some = [{"h": h, **by_size[h]} for h in sorted(by_size, reverse=True)]
    errors = [abs(one["compliance"] / limit - 1.0) for one in some]
    return to_reach(error, errors, [one[what] for one in some])


def _memory(by_size: dict[float, dict[str, float]]) -> float:
    """Gigabytes of a space on its finest grid."""
    return by_size[min(by_size)]["gigabytes"]


def _compliances(found: Found) -> str:
    """Compliances and seconds of spaces, from coarse to fine."""
    return "; ".join(
        f"degree {p} smoothness {s} "
        + ", ".join(
            f"{some[h]['compliance']:.4g} in {some[h]['seconds']:.3g} s"
            for h in sorted(some, reverse=True)
        )
        for (p, s), some in found.items()
    )


if __name__ == "__main__":
    if sys.argv[1] == "table":
        for row in rows(quick=False):
            print(table([row]).splitlines()[-1], flush=True)
    elif sys.argv[2] == "chosen":
        print(json.dumps(chosen(sys.argv[1], float(sys.argv[3]))))
    else:
        body, degree, smoothness, coarser = sys.argv[1:]
        print(json.dumps(measure(body, int(degree), int(smoothness), float(coarser))))
