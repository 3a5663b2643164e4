"""Figure 22 of Sitharam, Youngquist, Nolan and Peters: slices of a structure that is never stored.

The vertices of a Kagome structure follow from closed formulas, so that only the blocks that a
plane may meet are made. The number that is checked: the part of the blocks that a slice makes.

    python examples/corner_sharing_slices.py
"""

from typing import Any

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
        picture(f"{out}.png")
    return {
        "part of the blocks": used,
        "vertices of the whole": blocks.vertices,
        "edges near the plane": float(np.sum([len(e) for e in found])),
        "polygons": len(section.polygons),
        "area": section.area,
    }


def contours(section: il.slicing.Slice) -> Any:
    """The contours of a slice, in space."""
    return il.plot.shapes.polylines([section.to_space(p) for p in section.loops], closed=True)


def picture(path: str, resolution: int = 9, part: float = 0.12) -> None:
    """A plane through a straight and a mapped structure, and what it cuts."""
    blocks, duck = il.cost.Blocks(resolution), il.macroshape.duck()
    scenes = []
    for title, through, height, way, view in (
        ("across (1, 1, 1)", None, 1.0, (1.0, 1.0, 1.0), (20.0, 8.0)),
        ("z = 0.45 in the duck", duck, 0.45, (0.0, 0.0, 1.0), (-60.0, 30.0)),
    ):
        k = il.cost.kagome(resolution)
        k = k if through is None else k.mapped(through)
        radius = part * float(np.median(k.lengths))
        found = slicing.section(blocks, height, radius, normal=way, through=through)
        cut = contours(found)
        whole = il.plot.shapes.segments(k.positions, k.edges)
        scenes.append(il.plot.Scene(title=title, view=view).add(whole, color="gray", line_width=2.0)
                      .add(cut, color="firebrick", line_width=5.0))  # fmt: skip
        scenes.append(il.plot.Scene(title="its slice", view="top" if through else (45.0, 35.264),
                                    parallel=True, occlusion=False)
                      .add(cut, color="firebrick", line_width=4.0))  # fmt: skip
    il.plot.Panels(scenes, columns=2, size=(1600, 1400)).save(path)


if __name__ == "__main__":
    for name, number in main(out="corner_sharing_slices").items():
        print(f"{name}: {number:.5g}")
