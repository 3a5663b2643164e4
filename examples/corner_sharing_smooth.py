"""Figures 16 and 18 of Sitharam, Youngquist, Nolan and Peters: pipes and box splines.

The edges of a Kagome structure become pipes of biquadratic patches, whose radii grow from one side
to the other; and two box splines, of three directions in the plane and of four in space, have their
zero level sets around its vertices. The number that is checked: how much of space the solid of the
box spline fills inside an endless structure.

    python examples/corner_sharing_smooth.py
"""

import numpy as np

import ilattice as il
from ilattice.cost import boxspline


def simplices(k: il.cost.CornerSharing) -> il.SurfaceMesh:
    """The tetrahedra of a structure as triangles."""
    faces = k.simplices[:, [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]].reshape(-1, 3)
    return il.SurfaceMesh(k.positions, faces)


def main(resolution: int = 4, h: float = 0.015, out: str = "") -> dict[str, float]:
    """Part of space that is solid; with `out`, a picture of all."""
    k = il.cost.kagome(resolution)
    edge = k.lengths.mean()
    pipes = k.pipes(lambda x: edge * (0.05 + 0.1 * x[:, 0]))
    skin = pipes.mesh(6)
    solid = il.sdf.mesh(boxspline.field(k), h)
    plane = il.cost.kagome(resolution + 2, dim=2)
    slab = il.fields.translate(il.fields.box((0.7, 0.7, 0.03)), (0.5, 0.5, 0.0))
    eroded = il.fields.erode(boxspline.field(plane), 0.3)  # at 0 the holes are points
    columns = il.sdf.mesh(il.fields.intersection(eroded, slab), 0.5 * h)
    cell = il.Lattice(boxspline.tile(), through=il.macroshape.box()).offset((np.inf, 0.0))
    if out:
        pipes.save(f"{out}.vtu")
        scenes = [
            il.plot.Scene(view=(-60.0, 18.0), title="pipes").add(skin, color="steelblue"),
            il.plot.Scene(view=(-90.0, 70.0), title="three directions").add(columns),
            il.plot.Scene(view=(-60.0, 18.0), title="four directions")
            .add(simplices(k), color="royalblue")
            .add(solid, color="gold"),
        ]
        il.plot.Panels(scenes, labels=True, size=(1800, 640)).save(f"{out}.png")
    return {
        "solid part of space": cell.volume(),
        "patches": len(pipes.quads) + len(pipes.triangles),
        "watertight": float(skin.is_watertight and solid.is_watertight and columns.is_watertight),
        "crossing triangles": skin.self_intersections,
        "volume of the pipes": skin.volume,
        "volume of the box spline": solid.volume,
    }


if __name__ == "__main__":
    for name, number in main(out="corner_sharing_smooth").items():
        print(f"{name}: {number:.5g}")
