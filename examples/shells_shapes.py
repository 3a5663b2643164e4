"""Figure 13 of Xu, Pan, Wang, Du and Lu: level sets of a formula, and shells over boundaries.

Four level sets of the formula of Neovius' surface, between those where its topology changes, and
four shells of that topology over boundaries with other positions and derivatives; all as walls of
relative density 0.3. The numbers that are checked: largest over least area, which shells vary
several times as much.

    python examples/shells_shapes.py
"""

import warnings

import numpy as np

import ilattice as il

SHELLS = (
    ((-0.3, -0.3, 0.0), 1.2), ((0.0, 0.0, 0.0), 1.5), ((0.3, 0.3, 0.0), 1.2),
    ((0.1, 0.4, 0.2), 1.4),
)  # fmt: skip
LEVELS = (-0.5, -0.2, 0.2, 0.5)


def walls(density: float, n: int) -> dict[str, "il.Wall"]:
    """Both groups."""
    formula, found = il.tiles["neovius"], {}
    for level in LEVELS:
        tile = il.Tile(lambda u, level=level: formula(u % 1.0) - level)
        found[f"f = {level}"] = tile
    for position, derivative in SHELLS:
        shell = il.shells.cell(
            "topo_1_rrr", position=position, derivative=derivative, n=n, layer=0.02
        )
        found[f"{position}, {derivative}"] = shell.tile
    return {
        name: il.Lattice(tile, through=il.macroshape.box(), repeat=1).offset(
            relative_density=density
        )
        for name, tile in found.items()
    }


def curved_area(mesh: "il.SurfaceMesh") -> float:
    """Area of a wall in the unit cube but for its cuts with the faces of the cube."""
    corners = mesh.vertices[mesh.faces]
    flat = ((np.abs(corners) < 1e-6) | (np.abs(corners - 1.0) < 1e-6)).all(axis=1).any(axis=1)
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(0.5 * np.linalg.norm(sides[~flat], axis=1).sum())


def main(density: float = 0.3, n: int = 20, h: float = 0.045, out: str = "") -> dict[str, float]:
    """Areas; with `out`, the walls as ``OUT.png``."""
    with warnings.catch_warnings():  # that splines stand in for functions
        warnings.simplefilter("ignore", il.errors.PrecisionWarning)
        meshes = {name: wall.mesh(h=h) for name, wall in walls(density, n).items()}
    areas = [curved_area(mesh) for mesh in meshes.values()]
    if out:
        scenes = [
            il.plot.Scene(view=(-55.0, 25.0), title=name).add(mesh) for name, mesh in meshes.items()
        ]
        il.plot.Panels(scenes, columns=4).save(f"{out}.png")
    return {
        "level sets: largest over least area": max(areas[:4]) / min(areas[:4]),
        "shells: largest over least area": max(areas[4:]) / min(areas[4:]),
    }


if __name__ == "__main__":
    for name, number in main(out="shells_shapes").items():
        print(f"{name}: {number:.4g}")
