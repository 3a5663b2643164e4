"""Figure 19 of Xu, Pan, Wang, Du and Lu: a bar of shells that vary inside, and fit each other.

All cells have one outer boundary, of the class of Neovius' surface; positions of the nodes inside
change from cell to cell. The field of the bar is continuous with its gradient across the faces
between cells, and so are the normals of its surface.

    python examples/shells_graded.py
"""

import numpy as np

import ilattice as il


def main(cells: int = 8, n: int = 24, h: float = 0.025, out: str = "") -> dict[str, float]:
    """Build the bar; write ``OUT.stl`` and ``OUT.png`` if `out` is given."""
    family = il.shells.family("topo_1_rrr", outer=(0.2, 1.5), n=n)
    graded = family.graded(lambda cell: np.round(-0.3 + 0.6 * cell[:, 0] / (cells - 1), 6))
    lattice = il.Lattice(graded, through=il.macroshape.box((cells, 1, 1)), repeat=(cells, 1, 1))
    field, jump = lattice.smooth_tile, 0.0
    u = np.random.default_rng(0).random((2000, 3))
    for x in range(1, cells):
        u[:, 0] = x
        before = np.where(np.arange(3) == 0, np.nextafter(float(x), 0.0), u)
        near = np.abs(field(u)) < 0.02
        sides = [field.jet(p[near], 1)[1] for p in (before, u)]
        normals = [g / np.linalg.norm(g, axis=1, keepdims=True) for g in sides]
        jump = max(jump, float(np.abs(normals[0] - normals[1]).max()))
    wall = lattice.offset(0.05)
    mesh = wall.mesh(h=h)
    if out:
        mesh.save(f"{out}.stl")
        mesh.screenshot(f"{out}.png")
    return {
        "jump of normals between cells": jump,
        "relative density": wall.volume() / cells,
        "open edges": float(mesh.open_edges),
    }


if __name__ == "__main__":
    for name, number in main(out="shells_graded").items():
        print(f"{name}: {number:.6g}")
