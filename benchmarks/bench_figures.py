"""Figures 9 to 12 of the paper, and 14, from the start of a program to a mesh on disk.

Each measurement is a process of its own: ``python -m benchmarks.bench_figures FIGURE KIND``. It
includes imports; kernels are compiled before.
"""

import json
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import ilattice as il
from benchmarks.measure import Row, alone

EXAMPLES = Path(__file__).parents[1] / "examples"
#: What the paper took for marching cubes alone, on 12 threads of an i7-12700, constant and varying.
PAPER = {"fig09": (10, 20), "fig10": (25, 40), "fig11": (25, 40), "fig12": (13, 30)}
KINDS = ("constant", "varying")
MOST, SLOWER = "<= 10", "<= 1.2"


def mesh_of(figure: str, kind: str, coarser: float) -> "il.SurfaceMesh":
    """Mesh of a figure."""
    sys.path.insert(0, str(EXAMPLES))
    import fig09_colours
    import fig14_torus

    if figure in PAPER:
        return fig09_colours.mesh_of(figure, kind, coarser)
    torus = il.macroshape.torus(major=4.0, width=2.0)
    lattice = il.Lattice("gyroid", through=torus, repeat=(16, 2, 2))
    d = 0.1 if kind == "constant" else fig14_torus.varying()
    return lattice.offset(d).mesh(0.05 * coarser)


def rows(quick: bool = False) -> Iterator[Row]:
    """Lines of the table: seconds as the ratio, then varying over constant thickness."""
    coarser = 1.2 if quick else 1.0
    for figure in (*PAPER, "fig14"):
        times = []
        for kind in KINDS:
            run = ("benchmarks.bench_figures", figure, kind, coarser)
            alone(*run)  # compiles, and warms the disk
            start = time.perf_counter()
            faces = alone(*run)["faces"]
            times.append(time.perf_counter() - start)
            paper = f"{PAPER[figure][KINDS.index(kind)]} s" if figure in PAPER else ""
            ours = f"{times[-1]:.2f} s, {int(faces)} triangles"
            yield Row(f"{figure}, {kind}", ours, paper, times[-1], MOST)
        yield Row(f"{figure}, varying", "", "constant", times[1] / times[0], SLOWER)


if __name__ == "__main__":
    mesh = mesh_of(sys.argv[1], sys.argv[2], float(sys.argv[3]))
    with tempfile.TemporaryDirectory() as folder:
        mesh.save(Path(folder) / "mesh.vtp")
    print(json.dumps({"faces": len(mesh.faces)}))
