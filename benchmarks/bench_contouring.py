"""Boxed gyroid of 2 x 2 x 2 cells on n³ samples against NumPy tables + vtkFlyingEdges3D.

Both sides sample, and store their vertices, in single precision. VTK places vertices by linear
interpolation; so does the row "as VTK". By default ours are moved onto the surface.
VTK works on one thread; ours uses all, which costs CPU time while threads wait for each other.
Each measurement is a process of its own, so that its CPU time and peak memory are all its own:
``python -m benchmarks.bench_contouring METHOD KIND N``. Where microgen, and the package ``sdf`` of
github.com/fogleman/sdf, are installed, there are lines against these, too.
"""

import importlib.util
import json
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measure import Row, alone
from ilattice._stages import peak_megabytes

GOALS = {"network": ("<= 0.35", "<= 0.18"), "sheet": ("<= 0.5", "<= 0.2")}
LEVELS = {"network": 0.0, "sheet": (-0.3, 0.3)}


class Contouring:
    """CPU time and peak memory of one contour of each kind, by each method."""

    params = (("network", "sheet"), (101, 201))
    param_names = ("kind", "n")

    def time_blocks(self, kind: str, n: int) -> None:
        blocks(kind, n)

    def peakmem_blocks(self, kind: str, n: int) -> None:
        blocks(kind, n)

    def time_flying_edges(self, kind: str, n: int) -> None:
        flying_edges(kind, n)

    def peakmem_flying_edges(self, kind: str, n: int) -> None:
        flying_edges(kind, n)


def problem(n: int) -> tuple[Any, tuple[Any, ...]]:
    """The gyroid as a field and the planes of the grid."""
    import ilattice as il

    return il.tiles["gyroid"].field, (np.linspace(-1, 1, n),) * 3


def blocks(kind: str, n: int, place: str = "refine") -> int:
    """Number of triangles of our mesh."""
    from ilattice.mesh import contour

    field, axes = problem(n)
    return len(contour(field, axes, level=LEVELS[kind], place=place, dtype=np.float32).faces)


def linear(kind: str, n: int) -> int:
    """Number of triangles of our mesh, with vertices where linear interpolation puts them."""
    return blocks(kind, n, "linear")


def one_thread(kind: str, n: int) -> int:
    """Number of triangles of our mesh, made on one thread as VTK makes its own."""
    import numba

    numba.set_num_threads(1)
    return blocks(kind, n)


def streamed(kind: str, n: int) -> int:
    """Number of triangles of our mesh, written to a file piece by piece."""
    from ilattice.io import StreamedMeshWriter
    from ilattice.mesh.contouring import contour_blocks

    field, axes = problem(n)
    count = 0
    with (
        tempfile.TemporaryDirectory() as folder,
        StreamedMeshWriter(Path(folder) / "gyroid.ply") as writer,
    ):
        for piece in contour_blocks(field, axes, level=LEVELS[kind], dtype=np.float32):
            writer.append(piece.vertices, piece.faces)
            count += len(piece.faces)
            del piece  # not to hold it while the next one is made
    return count


def flying_edges(kind: str, n: int) -> int:
    """Number of triangles of VTK's mesh."""
    from benchmarks import references

    return references.flying_edges(*references.gyroid_box(n, sheet=kind == "sheet"))[1]


def microgen(kind: str, n: int) -> int:
    """Number of triangles of microgen's mesh."""
    from benchmarks import references

    return references.microgen_gyroid(n, sheet=kind == "sheet")


def fogleman(kind: str, n: int) -> int:
    """Number of triangles of the mesh of fogleman/sdf."""
    from benchmarks import references

    return references.fogleman_gyroid(n, sheet=kind == "sheet")


MODULE = "benchmarks.bench_contouring"
METHODS = {
    f.__name__: f for f in (blocks, linear, one_thread, streamed, flying_edges, microgen, fogleman)
}
#: Method, module that it needs, kind, samples, and the ratio asked for.
OTHERS = (
    ("microgen", "microgen", "sheet", 201, "<= 0.04"),
    ("fogleman", "sdf", "network", 401, "<= 0.05"),
)


def main(method: str, kind: str, n: str) -> None:
    """Measure one method: kernels are loaded and warm, the clock starts, one contour is made."""
    METHODS[method](kind, 33)
    start, wall = time.process_time(), time.perf_counter()
    triangles = METHODS[method](kind, int(n))
    result = {
        "cpu": time.process_time() - start,
        "wall": time.perf_counter() - wall,
        "megabytes": peak_megabytes(),
        "triangles": triangles,
    }
    print(json.dumps(result))


def rows(quick: bool) -> Iterator[Row]:
    """Lines of the table."""
    n = 201 if quick else 801
    for kind, (cpu_goal, memory_goal) in GOALS.items():
        methods = ("blocks", "linear", "one_thread", "flying_edges")
        ours, plain, single, theirs = (alone(MODULE, m, kind, n) for m in methods)
        vtk = f"NumPy + vtkFlyingEdges3D, {theirs['triangles']:.0f} triangles"
        runs = {"": ours, ", placed as VTK does": plain, ", on one thread as VTK": single}
        for how, found in runs.items():
            yield Row(
                f"gyroid {kind} at {n}³{how}, CPU",
                f"{found['cpu']:.2f} s, wall {found['wall']:.2f} s, "
                f"{found['triangles']:.0f} triangles",
                f"{theirs['cpu']:.2f} s {vtk}",
                found["cpu"] / theirs["cpu"],
                cpu_goal,
            )
        yield Row(
            f"gyroid {kind} at {n}³, peak memory",
            f"{ours['megabytes']:.0f} MB",
            f"{theirs['megabytes']:.0f} MB NumPy + vtkFlyingEdges3D",
            ours["megabytes"] / theirs["megabytes"],
            memory_goal,
        )
    for method, module, kind, samples, goal in OTHERS:
        if importlib.util.find_spec(module) is None:
            continue
        ours, theirs = (alone(MODULE, m, kind, samples) for m in ("blocks", method))
        yield Row(
            f"gyroid {kind} at {samples}³ against {method}, CPU",
            f"{ours['cpu']:.2f} s, {ours['triangles']:.0f} triangles",
            f"{theirs['cpu']:.2f} s, {theirs['triangles']:.0f} triangles",
            ours["cpu"] / theirs["cpu"],
            goal,
        )
    small, large = (alone(MODULE, "streamed", "network", m) for m in (n, 2 * n - 1))
    yield Row(
        f"gyroid network streamed at {2 * n - 1}³, peak memory",
        f"{large['megabytes']:.0f} MB, {large['cpu']:.1f} s CPU",
        f"{small['megabytes']:.0f} MB at {n}³",
        large["megabytes"] / small["megabytes"],
        "<= 1.5x",
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
