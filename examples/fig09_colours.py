"""Figures 9 to 12 of Hong, Antolin, Elber and Kim: tiles in a torus, a duck and a wing, in colour.

The volumes have seven coordinates: x, y, z, red, green, blue and d, by which the arms of a tile
grow, to first order and as a fraction of a tile. Once d and the colour are the same everywhere,
once they change through the part, each in its own way. The tile is a 3D cross in Figures 9, 10
and 12, the joint of ten arms of Figure 1 in Figure 11. The wing is seen from its root, so that its
aerofoil shows, whose outline is drawn at five places. Arms stay connected, and the colours go
with the mesh into the file; the number that is checked is the volume that the larger d gains.

    python examples/fig09_colours.py
"""

import numpy as np

import ilattice as il

#: Per figure: volume, tile, tiles along u, v, w, direction along the part, most d, edges of meshes.
FIGURES = {
    "fig09": ("torus", "cross", (16, 2, 2), 0, 0.12, 0.06),
    "fig10": ("duck", "cross", (18, 5, 4), 0, 0.12, 0.03),
    "fig11": ("duck", "ten_arms", (10, 5, 4), 0, 0.05, 0.036),
    "fig12": ("wing", "cross", (4, 2, 10), 2, 0.12, 0.015),
}

#: Azimuth and elevation from which a wing shows its aerofoil.
WING = (82.0, 7.0)


def coloured(name: str, along: int, most: float) -> il.SplineMap:
    """Volume in ℝ⁷; d goes from 0 to `most` along the part and back, the colour once through it."""
    shape = il.macroshape.torus(major=4.0, width=2.0) if name == "torus" else None
    shape = shape or getattr(il.macroshape, name)()

    def there_and_back(u: np.ndarray) -> np.ndarray:
        return 0.5 - 0.5 * np.cos(2 * np.pi * u[:, along])

    def through(u: np.ndarray) -> np.ndarray:
        return 0.5 - 0.5 * np.sin(2 * np.pi * u[:, along]) if name == "torus" else u[:, along]

    if most == 0.0:
        return shape.with_extra(r=0.85, g=0.65, b=0.2, d=0.0)
    return shape.with_extra(
        r=through, g=0.35, b=lambda u: 1.0 - through(u), d=lambda u: most * there_and_back(u)
    )


def mesh_of(figure: str, kind: str, coarser: float = 1.0) -> "il.SurfaceMesh":
    """The lattice of a figure, "constant" or "varying"."""
    name, tile, repeat, along, most, width = FIGURES[figure]
    varying = kind == "varying"
    volume = coloured(name, along, most if varying else 0.0)
    lattice = il.Lattice(il.tiles[tile], through=volume, repeat=repeat)
    wall = lattice.offset((np.inf, "d" if varying else 0.0), space="parametric")
    return wall.mesh(coarser * width)


def main(
    figures: tuple[str, ...] = tuple(FIGURES), coarser: float = 1.0, out: str = ""
) -> dict[str, float]:
    """Build both lattices of each figure; write ``OUT_*`` (.vtp, .png) if `out` is given."""
    gained = {}
    for figure in figures:
        meshes = [mesh_of(figure, kind, coarser) for kind in ("constant", "varying")]
        gained[figure] = meshes[1].volume / meshes[0].volume
        if out:
            meshes[0].save(f"{out}_{figure}_constant.vtp")
            meshes[1].save(f"{out}_{figure}_varying.vtp")
            name, along = FIGURES[figure][0], FIGURES[figure][3]
            _picture(meshes, coloured(name, along, 0.0), f"{out}_{figure}.png")
    return gained


def _picture(meshes: list["il.SurfaceMesh"], volume: il.SplineMap, path: str) -> None:
    """The lattice of constant d in the translucent volume, and the one of varying d."""
    x, y, z = np.ptp(volume.bounds, axis=0)
    flat, long = z < 0.2 * y, x < 0.75 * y
    scene = il.plot.Scene(view=WING if flat else (-66.0, 33.0))
    if flat:
        scene = scene.lines(sections(volume), color="black", width=1.5)
    scenes = [scene.add(meshes[0]).ghost(volume), scene.add(meshes[1])]
    il.plot.Panels(scenes, columns=1 if long else 2, size=(1800, 900)).save(path)


def sections(volume: il.SplineMap) -> object:
    """The outline of a wing at its root, its tip, and between them."""
    t, at = np.linspace(0.0, 1.0, 60), np.zeros(60)
    sides = [(t, at), (at + 1.0, t), (t[::-1], at + 1.0), (at, t[::-1])]
    rim = np.vstack([np.column_stack(side) for side in sides])
    outlines = [volume.x(np.insert(rim, 2, w, axis=1)) for w in np.linspace(0.0, 1.0, 5)]
    return il.plot.polylines(outlines, closed=True)


if __name__ == "__main__":
    for name, number in main(out="fig09").items():
        print(f"{name}: {number:.6g}")
