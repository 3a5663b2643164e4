"""Slices of a structure that is never stored (Figure 22).

The vertices of a Kagome structure follow from closed formulas, so that only the blocks that a
plane may meet are made. The number that is checked: the part of the blocks that a slice makes.

    python examples/corner_sharing_slices.py
"""

import numpy as np

import ilattice as il
from ilattice.cost import slicing


def main(resolution: int = 24, height: float = 0.9, out: str = "") -> dict[str, float]:
    """Blocks, edges and area of one slice; with `out`, the slice as a picture."""
    blocks = il.cost.Blocks(resolution, size=2)
    duck = il.macroshape.duck()
    found = list(slicing.crossings(blocks, height, through=duck, margin=0.01))
    used = len(found) / sum(1 for _ in blocks)
    section = slicing.section(blocks, height, 0.01, through=duck)
    if out:
        with open(f"{out}.svg", "w", encoding="utf-8") as file:
            file.write(section.to_svg())
    return {
        "part of the blocks": used,
        "vertices of the whole": blocks.vertices,
        "edges near the plane": float(np.sum([len(e) for e in found])),
        "polygons": len(section.polygons),
        "area": section.area,
    }


if __name__ == "__main__":
    for name, number in main(out="corner_sharing_slices").items():
        print(f"{name}: {number:.5g}")
