"""Figures 10 and 17 of Sitharam, Youngquist, Nolan and Peters: flips that open a hole in a stack.

Six flips around a void of a plane Kagome structure and relaxation make a round hole; the same flips
in all layers of a stack make a cylindrical one. The number that is checked: the largest radius of
the hole over the least one, which is nearly that of a circle, in every layer.

    python examples/corner_sharing_holes.py
"""

import numpy as np

import ilattice as il
from ilattice.cost import embedding, flips, refinement, shaping


def middle_void(k: il.cost.CornerSharing) -> np.ndarray:
    """Vertices around the void that is nearest to the middle of a plane structure."""
    voids = refinement.voids(k)
    far = [np.linalg.norm(k.positions[f].mean(axis=0) - k.positions.mean(axis=0)) for f in voids]
    return voids[int(np.argmin(far))]


def outer_corners(k: il.cost.CornerSharing, ring: np.ndarray) -> list[int]:
    """Corners, away from a void, of the triangles around it: where the flips are."""
    rows = np.isin(k.simplices, ring).sum(axis=1) == 2
    return [int(v) for v in k.simplices[rows].ravel() if v not in ring]


def main(resolution: int = 9, layers: int = 7, out: str = "") -> dict[str, float]:
    """Shape of the hole, and of the stack; with `out`, a picture of layer and stack."""
    k = il.cost.kagome(resolution, dim=2)
    ring = middle_void(k)
    hole = shaping.opened(k, k.positions[ring].mean(axis=0))
    x, step = hole.positions, 0.8 * k.lengths.mean()
    places = [np.column_stack([x, np.full(len(x), i * step)]) for i in range(layers)]
    stack = flips.layer_flipped(k, places, outer_corners(k, ring)).check()
    edge = max(refinement.voids(hole), key=len)
    radii = np.linalg.norm(x[edge] - x[edge].mean(axis=0), axis=1)
    beams = stack.beams(0.08 * k.lengths.mean())
    middle = beams.slices([2 * step])[0]
    if out:
        scenes = [
            il.cost.drawing.drawn(k, filled=True, title="before"),
            il.cost.drawing.drawn(hole, filled=True, title="six flips, relaxed"),
            il.cost.drawing.drawn(stack, filled=True, title=f"{layers} layers", view=(-80.0, 62.0)),
        ]
        cut = il.plot.shapes.polylines([middle.to_space(p) for p in middle.loops], closed=True)
        flat = il.plot.Scene(title="slice in a layer", view="top", parallel=True, occlusion=False)
        scenes.append(flat.add(cut, color="black", line_width=2.0))
        il.plot.Panels(scenes, columns=2, size=(1600, 1400)).save(f"{out}.png")
    return {
        "largest radius over the least": radii.max() / radii.min(),
        "corners of the hole": len(edge),
        "tetrahedra": len(stack.simplices),
        "overlaps": len(embedding.overlaps(stack)),
        "contours of the slice in a layer": len(middle.polygons),
    }


if __name__ == "__main__":
    for name, number in main(out="corner_sharing_holes").items():
        print(f"{name}: {number:.5g}")
