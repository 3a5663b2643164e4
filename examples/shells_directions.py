"""Figure 17 of Xu, Pan, Wang, Du and Lu: specimens of a shell along axes, edges and diagonals.

From a block of cells like Schwarz P that is as stiff in all directions (see
``examples/shells_isotropic.py``), cubes are cut of which one edge is along [100], [110] or [111].
They are solids: the wall and a turned cube. The number that is checked: the largest over the least
Young's modulus in these three directions, which is near to 1, and well above it for the sheet of
Schwarz P itself.

    python examples/shells_directions.py
"""

import numpy as np

import ilattice as il

DIRECTIONS = {"[100]": (1, 0, 0), "[110]": (1, 1, 0), "[111]": (1, 1, 1)}


def spread(tile: "il.Tile", cells: int, density: float) -> float:
    """Largest over least Young's modulus in the three directions."""
    lattice = il.Lattice(tile, through=il.macroshape.cell(), repeat=1)
    eff = il.homogenize.elastic(lattice.offset(relative_density=density), cells, estimate=False)
    young = [eff.E(direction) for direction in DIRECTIONS.values()]
    return max(young) / min(young)


def turned(direction: tuple[int, int, int], edge: float, middle: float) -> "il.fields.Node":
    """A cube with an edge along a direction."""
    n = np.array(direction) / np.linalg.norm(direction)
    axis, angle = np.cross((1.0, 0.0, 0.0), n), float(np.arccos(n[0]))
    cube = il.fields.box(edge / 2)
    if angle > 0.0:
        cube = il.fields.rotate(cube, angle, axis)
    return il.fields.translate(cube, (middle,) * 3)


def main(
    tiles: int = 5, density: float = 0.3, cells: int = 10, n: int = 16, h: float = 0.042,
    out: str = "",
) -> dict[str, float]:  # fmt: skip
    """Cut the specimens; write ``OUT_100.stl`` ... and ``OUT.png`` if `out` is given."""
    shell = il.shells.cell("topo_19_rrr", position=0.4, derivative=2.18, n=n, layer=0.03, spans=64)
    block = il.macroshape.box((tiles,) * 3)
    lattice = il.Lattice(shell.tile, through=block, repeat=tiles, spans_per_tile=12)
    wall = lattice.offset(relative_density=density)
    numbers, scenes = {}, []
    edge = 0.57 * tiles  # its diagonal lies within the block
    for name, direction in DIRECTIONS.items():
        cube = il.fields.pull_back(turned(direction, edge, tiles / 2), block)
        mesh = il.sdf.mesh(il.fields.intersection(wall.field, cube), h, through=block)
        numbers[f"{name}: density"] = mesh.volume / edge**3
        numbers[f"{name}: closed"] = float(mesh.is_watertight)
        if out:
            mesh.save(f"{out}_{name[1:-1]}.stl")
            scenes.append(
                il.plot.Scene(view=(-55.0, 25.0), title=f"one edge along {name}").add(mesh)
            )
    if out:
        il.plot.Panels(scenes, columns=3).save(f"{out}.png")
    numbers["largest over least modulus"] = spread(shell.tile, cells, density)
    numbers["that of Schwarz P"] = spread(il.tiles["schwarz_p"], cells, density)
    return numbers


if __name__ == "__main__":
    for name, number in main(out="shells_directions").items():
        print(f"{name}: {number:.4g}")
