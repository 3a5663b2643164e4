"""The whole catalogue on one sheet: a cell of every tile.

Solids (struts, plates, honeycombs) are where the field of the tile is negative, surfaces are drawn
as sheets that fill a fifth of their cells, most of them at a constant level; cells that are not
cubes are drawn as they are. The numbers that are checked: how many tiles there are, and that the
mesh of each has the volume that counting points gives, for which the grids of some are up to four
times as fine.

    python examples/catalogue.py
"""

from collections.abc import Sequence

import numpy as np

import ilattice as il

#: Tiles whose sheets at a constant level get thinner than a grid sees.
UNEVEN = (
    "c_d",
    "c_g",
    "c_i2y",
    "c_s",
    "honeycomb_lidinoid",
    "i2y",
    "lidinoid",
    "pm_y",
    "s",
    "w",
    "y",
)


def cell(name: str, n: int, part: float = 0.2) -> tuple["il.SurfaceMesh", float]:
    """One cell of a tile in its own shape, and the part of it that points say is filled."""
    tile = il.tiles[name]
    points = np.random.default_rng(0).random((20_000, 3))
    values = tile(points)
    filled = float((values < 0).mean())
    field = tile
    if not is_solid(name):
        inverse = np.linalg.inv(tile.cell)

        def size(u: np.ndarray) -> np.ndarray:
            """Of the field; of uneven ones over their slope, about the distance to the surface."""
            value, slope = tile.jet(u, 1)
            steep = np.linalg.norm(slope @ inverse, axis=-1).clip(1e-9) if name in UNEVEN else 1.0
            return np.abs(value) / steep

        level, filled = float(np.quantile(size(points), part)), part

        def field(u: np.ndarray) -> np.ndarray:
            return size(u) - level

    for finer in (1, 2, 3, 4):
        mesh = il.mesh.contour(field, [np.linspace(0.0, 1.0, finer * n + 1)] * 3)
        if abs(mesh.volume - filled) < 0.006:
            break
    return il.SurfaceMesh(mesh.vertices @ tile.cell.T, mesh.faces), filled


def is_solid(name: str) -> bool:
    """Whether a tile of the catalogue is made of struts, plates or combs."""
    return il.tiles[name].node.polynomial is None


def main(names: Sequence[str] = (), n: int = 40, out: str = "") -> dict[str, float]:
    """Volumes of cells; write ``OUT.png`` if `out` is given."""
    names = list(names) or list(il.tiles)
    scenes, off = [], []
    for name in names:
        mesh, filled = cell(name, n)
        whole = abs(np.linalg.det(il.tiles[name].cell))
        off.append(abs(mesh.volume / whole - filled))
        scenes.append(il.plot.Scene(title=name.replace("_", " "), view=(-58.0, 25.0)).add(mesh))
    if out:
        rows = -(-len(names) // 8)
        il.plot.Panels(scenes, columns=8, size=(2800, 340 * rows)).save(f"{out}.png")
    return {"tiles": len(names), "largest difference of filled parts": max(off)}


if __name__ == "__main__":
    for name, number in main(out="catalogue").items():
        print(f"{name}: {number:.4g}")
