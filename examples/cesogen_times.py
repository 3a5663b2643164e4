"""Figure 11 of Patience, Audet and Blais (Cesogen, 2024): how long meshes of a gyroid take.

A gyroid in a box, on grids of i x i x i points. The paper needs 7.4 minutes for i = 801, with 16
million triangles, and says that finer ones do not fit in 16 GiB. Blocks of the grid in which a
bound of the field says that no surface is are not looked at, so that time grows with the surface,
like i squared, rather than with the grid. The numbers that are checked: the exponent of the
triangles is two, and that of the time below three. Times are those of the machine it runs on.

    python examples/cesogen_times.py
"""

import time
from collections.abc import Sequence

import numpy as np

import ilattice as il


def main(points: Sequence[int] = (26, 51, 101, 201, 301), out: str = "") -> dict[str, float]:
    """Seconds and triangles; write ``OUT.png`` if `out` is given."""
    gyroid = il.sdf.parse("box gyroid")
    il.sdf.mesh(gyroid, 2 / 10)  # kernels are loaded, once
    seconds, triangles = [], []
    for i in points:
        start = time.perf_counter()
        mesh = il.sdf.mesh(gyroid, 2 / (i - 1))
        seconds.append(time.perf_counter() - start)
        triangles.append(len(mesh.faces))
    if out:
        _draw(points, seconds, triangles).savefig(f"{out}.png", dpi=150)
    ends = np.log(np.asarray(points, float)[[-2, -1]])
    slopes = [np.diff(np.log(a[-2:]))[0] / np.diff(ends)[0] for a in (triangles, seconds)]
    return {
        f"seconds for {points[-1]} points": seconds[-1],
        f"triangles for {points[-1]} points": triangles[-1],
        "exponent of the triangles": slopes[0],
        "exponent of the time": slopes[1],
    }


def _draw(points: Sequence[int], seconds: list[float], triangles: list[int]) -> object:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    axes = figure.subplots()
    axes.loglog(points, seconds, "o-", color="#8a4b14", label="time")
    axes.loglog(points, seconds[-1] * (np.array(points) / points[-1]) ** 2, "k:", label="i², i³")
    axes.loglog(points, seconds[-1] * (np.array(points) / points[-1]) ** 3, "k:")
    for i, s, n in zip(points, seconds, triangles, strict=True):
        axes.annotate(f"{n:,}", (i, s), (-4, 6), textcoords="offset points", ha="right", fontsize=8)
    axes.set_xlim(left=0.5 * points[0])
    axes.set_xticks(points, [str(i) for i in points])
    axes.tick_params(axis="x", which="minor", bottom=False, labelbottom=False)
    axes.set_xlabel("points i of the grid, in each of three directions")
    axes.set_ylabel("seconds, numbers are triangles")
    axes.legend(frameon=False)
    return figure


if __name__ == "__main__":
    for name, number in main(out="cesogen_times").items():
        print(f"{name}: {number:.5g}")
