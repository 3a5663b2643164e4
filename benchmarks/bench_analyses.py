"""The analyses of Figures 16 and 17 of the paper, from the wall to the solution in memory.

The grids are the paper's, with trilinear functions as there, then degree 2 on half the cells per
direction, of smoothness 1 and 0. Compliances are all too low: the greatest is the most accurate.
Each measurement is a process of its own that has its kernels loaded:
``python -m benchmarks.bench_analyses FIGURE DEGREE SMOOTHNESS COARSER``.
``python -m benchmarks.bench_analyses table`` prints the seconds of the stages.
"""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

from benchmarks.measure import Row, alone, table
from ilattice._stages import peak_megabytes

MODULE = "benchmarks.bench_analyses"
EXAMPLES = Path(__file__).parents[1] / "examples"
#: Seconds that the paper took on one core of an Apple M2 Max, and what part of them we aim at.
PAPER = {
    "fig16c": (11.4, "<= 0.125"),
    "fig16d": (14.5, "<= 0.25"),
    "fig17c": (89.7, "<= 0.1"),
    "fig17d": (143.8, "<= 0.167"),
}
QUICK = ("fig16c",)
#: Degree, smoothness, and how many times fewer cells per direction than the paper has.
SPACES = ((1, 0, 1), (2, 1, 2), (2, 0, 2))


def measure(figure: str, degree: int, smoothness: int, coarser: int) -> dict[str, float]:
    """Seconds of each stage, compliance, unknowns, iterations, and peak memory."""
    sys.path.insert(0, str(EXAMPLES))
    from fig16_bending import solve

    warm, _ = solve(figure, degree, 2 * coarser, smoothness)  # load the kernels
    warm.problem.solve(method="multigrid")
    del warm
    solution, seconds = solve(figure, degree, coarser, smoothness)
    report = solution.report
    return {
        **{name: float(value) for name, value in seconds.items()},
        "compliance": solution.compliance,
        "unknowns": report.size,
        "iterations": report.iterations,
        "megabytes": peak_megabytes() or 0.0,
    }


def rows(quick: bool) -> Iterator[Row]:
    """Lines of the table."""
    for figure in QUICK if quick else PAPER:
        paper, goal = PAPER[figure]
        for degree, smoothness, coarser in SPACES:
            found = alone(MODULE, figure, degree, smoothness, coarser)
            stages = {k: found[k] for k in list(found)[: list(found).index("compliance")]}
            total = sum(stages.values())
            parts = ", ".join(f"{name} {value:.2f}" for name, value in stages.items())
            size = found["unknowns"] / 1e3
            yield Row(
                f"{figure}, degree {degree}, smoothness {smoothness}, {size:.0f} thousand unknowns",
                f"{total:.1f} s ({parts}), {found['iterations']:.0f} it, "
                f"{1e-3 * found['megabytes']:.2f} GB, compliance {found['compliance']:.5g}",
                f"{paper} s of the paper",
                total / paper,
                goal if degree == 1 else "",
            )


if __name__ == "__main__":
    if sys.argv[1] == "table":
        for row in rows(quick=False):
            print(table([row]).splitlines()[-1], flush=True)
    else:
        print(json.dumps(measure(sys.argv[1], *map(int, sys.argv[2:]))))
