"""Figure 5 of Patience, Audet and Blais (Cesogen, 2024): a lattice within a lattice within one.

A truncated sphere, a P surface, a finer D surface and an even finer gyroid, intersected one after
the other; the command of the paper is understood as it is printed. At the left are the single
solids, at the right what is left of them together. Every mesh is watertight and has the volume that
counting points of a grid gives.

    python examples/hierarchical.py
"""

from typing import Any

import numpy as np

import ilattice as il

STEPS = (
    "box scale 4,4,4 sphere scale 5,5,5",
    "p-surface scale 4,4,4",
    "d-surface scale 3.75,3.75,3.75",
    "gyroid scale 1.25,1.25,1.25",
)


def counted(field: Any, n: int) -> float:
    """Volume in the box of half-width 4 by counting points of a grid."""
    x = -4.0 + 8.0 * (np.arange(n) + 0.5) / n
    p = np.stack([a.ravel() for a in np.meshgrid(x, x, x, indexing="ij")], axis=1)
    return float((field(p) < 0.0).mean() * 512.0)


def main(h: float = 4 / 60, steps: int = 4, out: str = "") -> dict[str, Any]:
    """Mesh the first steps; write ``OUT.png`` if `out` is given."""
    result: dict[str, Any] = {}
    scenes = []
    for step in range(1, steps + 1):
        field = il.sdf.parse(" ".join(STEPS[:step]))
        mesh = il.sdf.mesh(field, h)
        result[f"step {step}"] = {
            "volume": mesh.volume,
            "counted": counted(field, 80),
            "faces": len(mesh.faces),
            "genus": mesh.genus,
            "watertight": mesh.is_watertight,
        }
        if out:
            single = STEPS[step - 1] if step == 1 else f"box scale 4 {STEPS[step - 1]}"
            model = mesh if step == 1 else il.sdf.mesh(il.sdf.parse(single), h)
            scenes += [il.plot.Scene().add(m) for m in (model, mesh)]
    if out:
        il.plot.Panels(scenes, columns=2, labels=False, size=(1400, 650 * steps)).save(f"{out}.png")
    return result


if __name__ == "__main__":
    for name, numbers in main(h=4 / 130, out="hierarchical").items():
        print(name, numbers)
