"""A lattice between two faces: a core that follows a flat plate and a curved skin.

Two surfaces are joined by straight lines (a ruled volume), and tiles follow both of them: two
layers of walls of a true thickness of 0.8 mm, however far the faces are apart. The number that is
checked: by how much the walls differ from that, measured at random vertices.

    python examples/conformal_layer.py
"""

import numpy as np

import ilattice as il
from ilattice.bspline import BSpline


def face(height: np.ndarray) -> BSpline:
    """A surface of degree 2 over 60 x 40 mm with control points at given heights (n, m)."""
    n, m = height.shape
    knots = [
        np.concatenate([[0.0] * 2, np.linspace(0, 1, count - 1), [1.0] * 2]) for count in (n, m)
    ]
    ticks = [0.5 * (t[1:-2] + t[2:-1]) for t in knots]  # where a control stands
    x, y = np.meshgrid(60.0 * ticks[0], 40.0 * ticks[1], indexing="ij")
    return BSpline(knots, np.stack([x, y, height], axis=-1), (2, 2))


def main(h: float = 0.6, out: str = "") -> dict[str, float]:
    """Errors of the walls and volumes; with `out`, a mesh and a picture."""
    flat, curved = np.zeros((6, 5)), np.full((6, 5), 14.0)
    curved[2:4, 1:4] += 8.0
    curved[0] -= 4.0
    core = il.macroshape.ruled(face(flat), face(curved))
    wall = il.Lattice("schwarz_p", through=core, repeat=(6, 4, 2)).offset(0.4)
    mesh = wall.mesh(h)
    error = wall.thickness_error(mesh)
    if out:
        mesh.save(f"{out}.stl")
        scene = il.plot.Scene(view=(-60.0, 22.0)).ghost(core)
        scene.add(mesh, color="steelblue").save(f"{out}.png")
    return {
        "99th percentile of errors of the thickness": error.p99,
        "watertight": float(mesh.is_watertight),
        "volume of the mesh over that of the wall": mesh.volume / wall.volume(),
        "least height": float(core.x(np.random.default_rng(0).random((2000, 3)))[:, 2].min()),
    }


if __name__ == "__main__":
    for name, number in main(out="conformal_layer").items():
        print(f"{name}: {number:.4g}")
