"""Figure 6 of Hong, Antolin, Elber and Kim: offsets of varying distance, inside one tile.

A Schwarz P surface, fitted by least squares in the progressive and iterative way (LSPIA), and a
cross from the distance to three lines, both with 10 x 10 x 10 coefficients. Equation 3 moves their
zero sets outwards by d(u), which grows from 0.02 to 0.1 across the tile. That is right to first
order: halving d divides the error of the Schwarz P offset by four.

    python examples/fig06_variable_offsets.py
"""

import numpy as np

import ilattice as il
from ilattice.bspline.fit import fit


def tiles() -> dict[str, il.Tile]:
    """The two tiles, as splines of degree two with ten coefficients per direction."""
    fields = {"schwarz_p": il.tiles.schwarz_p(), "cross": il.tiles.cross(radius=0.12)}
    methods = {"schwarz_p": "lspia", "cross": "interpolate"}
    return {
        name: il.Tile(fit(field, degree=2, spans=8, method=methods[name], periodic=True), name=name)
        for name, field in fields.items()
    }


def main(low: float = 0.02, high: float = 0.1, h: float = 0.02, out: str = "") -> dict[str, float]:
    """Make both offsets; write ``OUT_*.vtp`` and ``OUT_*.png`` if `out` is given."""
    axes = [np.linspace(0.0, 1.0, int(np.ceil(1.0 / h)) + 1)] * 3
    numbers = {}
    for name, tile in tiles().items():
        lattice = il.Lattice(tile, through=il.macroshape.box())
        moved = []
        for part in (1.0, 0.5):
            along = part * np.array([low, high])[:, None, None]
            d = il.BSpline([[0, 0, 1, 1], [0, 1], [0, 1]], along, (1, 0, 0))
            wall = lattice.offset((np.inf, d), space="parametric")
            moved.append(wall.mesh(h))
            numbers[f"{name}: error at {part:g} d"] = wall.thickness_error(moved[-1]).rms
        if out:
            moved[0].save(f"{out}_{name}.vtp")
            base = il.mesh.contour(tile.kernel_field, axes, caps=False)
            _picture(base, without_ends(moved[0]), f"{out}_{name}.png")
    return numbers


def without_ends(mesh: "il.SurfaceMesh") -> "il.SurfaceMesh":
    """The offset surface alone, without the faces of the cube."""
    flat = (mesh.vertices == 0.0) | (mesh.vertices == 1.0)
    return mesh.select(~flat[mesh.faces].all(axis=1).any(axis=1))


def _picture(base: "il.SurfaceMesh", moved: "il.SurfaceMesh", path: str) -> None:
    """The zero set, its offset, and both."""
    titles = ("tile", "its offset, of varying distance", "both")
    tile, offset, both = (il.plot.Scene(view=(-58.0, 25.0), title=title) for title in titles)
    scenes = [
        tile.add(base, color="firebrick"),
        offset.add(moved, color="gold"),
        both.add(base, color="firebrick").add(moved, color="gold", opacity=0.45),
    ]
    il.plot.Panels(scenes, size=(1800, 640)).save(path)


if __name__ == "__main__":
    for name, number in main(out="fig06").items():
        print(f"{name}: {number:.6g}")
