"""Clocks, fresh processes and the table."""

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from statistics import median
from typing import Any


@dataclass(frozen=True)
class Row:
    """One line of the table: `value` is better than `goal` if it is above (or below) it."""

    name: str
    ours: str
    reference: str
    value: float
    goal: str = ""

    @property
    def met(self) -> str:
        """Yes, no, or nothing where there is no goal."""
        if not self.goal:
            return ""
        sign, bound = self.goal.split()[:2]
        limit = float(bound.rstrip("x"))
        return "yes" if (self.value >= limit if sign == ">=" else self.value <= limit) else "NO"


def cpu(work: Callable[[], Any], repeats: int = 5) -> float:
    """Least process CPU time of some runs, in seconds, after one run to warm up."""
    return _least(work, time.process_time, repeats)


def wall(work: Callable[[], Any], repeats: int = 5) -> float:
    """Least wall time of some runs, in seconds, after one run to warm up."""
    return _least(work, time.perf_counter, repeats)


def in_turns(
    a: Callable[[], Any], b: Callable[[], Any], repeats: int = 15,
    clock: Callable[[], float] = time.perf_counter,
) -> tuple[float, float]:  # fmt: skip
    """Median times of two works that take turns, so that a change of clock meets both."""
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(repeats + 1):
        for work, taken in zip((a, b), times, strict=True):
            start = clock()
            work()
            taken.append(clock() - start)
    return median(times[0][1:]), median(times[1][1:])


def _least(work: Callable[[], Any], clock: Callable[[], float], repeats: int) -> float:
    work()
    times = []
    for _ in range(repeats):
        start = clock()
        work()
        times.append(clock() - start)
    return min(times)


def alone(module: str, *arguments: object) -> dict[str, float]:
    """Run ``python -m module arguments`` in a fresh process; it prints JSON on its last line."""
    command = [sys.executable, "-m", module, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)} failed:\n{done.stderr}")
    return dict(json.loads(done.stdout.splitlines()[-1]))


def table(rows: Iterable[Row]) -> str:
    """The rows as text, columns aligned."""
    head = ("benchmark", "ours", "reference", "ratio", "goal", "met")
    body = [(r.name, r.ours, r.reference, f"{r.value:.3g}", r.goal, r.met) for r in rows]
    widths = [max(len(line[i]) for line in [head, *body]) for i in range(len(head))]
    rule = tuple("-" * w for w in widths)
    return "\n".join(
        "  ".join(cell.ljust(w) for cell, w in zip(line, widths, strict=True)).rstrip()
        for line in [head, rule, *body]
    )
