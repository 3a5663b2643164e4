"""Figure 13 of Hong, Antolin, Elber and Kim: a plane through a tapered volume.

The tile is the linear function w - 1/2, the half-thickness 0.15, in the lengths of space. The
mid-surface is the plane at half the height, so that the distance is known exactly: every vertex of
the wall that is not on a face of the volume is at 0.15 from that plane, to 1e-6. The wall runs
straight into the slanted faces and is cut there at full thickness.

    python examples/fig13_tapered.py
"""

import numpy as np

import ilattice as il

#: White at both sides of a wall, brown in the middle.
DEPTH = {"scalars": "depth", "label": "distance / d", "cmap": "depth", "clim": (-1, 1)}


def main(h: float = 0.05, d: float = 0.15, out: str = "") -> dict[str, float]:
    """Build the wall; write ``OUT.vtp`` and ``OUT.png`` if `out` is given."""
    volume = il.macroshape.tapered(base=2.0, top=1.0, height=1.0)
    corners = np.indices((2, 2, 2))[2] - 0.5
    tile = il.Tile(il.BSpline([[0, 0, 1, 1]] * 3, corners, 1), name="w - 1/2")
    mesh = il.Lattice(tile, through=volume).offset(d).mesh(h=h)
    u = volume.inverse(mesh.vertices)
    on_a_side = (np.abs(u[:, :2] - 0.5) > 0.5 - 1e-9).any(axis=1)
    distance = np.abs(mesh.vertices[:, 2] - 0.5)
    if out:
        mesh.save(f"{out}.vtp")
        depth = mesh.point_data["signed_distance"] / mesh.point_data["half_thickness"]
        mesh.with_point_data(depth=depth).screenshot(f"{out}.png", **DEPTH)
    return {
        "error": np.abs(distance[~on_a_side] - d).max(),
        "thickness at the sides": 2 * distance[on_a_side].max(),
    }


if __name__ == "__main__":
    for name, number in main(out="fig13_tapered").items():
        print(f"{name}: {number:.6g}")
