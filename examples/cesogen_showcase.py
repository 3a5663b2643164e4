"""Figures 3 and 4 of Patience, Audet and Blais (Cesogen, 2024): nine surfaces, solids and shells.

Each is one command: ``box S dilate xi`` is the solid on one side of the surface, Figure 3, and
``box S shell 2*xi`` the shell about it, Figure 4, with xi = 0.35 but for OCTO (0.1) and FRD (0.55),
on grids of 60, 85 or 95 intervals as in the paper. Shells are made on grids twice as fine: those of
the paper lose 11 % of the volume of the shell of IWP, which falls into 109 pieces, and more than
5 % of that of Neovius. The number that is checked: every mesh is watertight and has the volume that
counting points gives.

    python examples/cesogen_showcase.py
"""

import numpy as np

import ilattice as il

#: Name of the paper -> word, intervals of the grid, xi.
SURFACES = {
    "Gyroid": ("gyroid", 60, 0.35),
    "D": ("d-surface", 60, 0.35),
    "P": ("p-surface", 60, 0.35),
    "IWP": ("iwp", 85, 0.35),
    "Neovius": ("neovius", 60, 0.35),
    "C(Y)": ("c-y", 85, 0.35),
    "Lidinoid": ("lidinoid", 85, 0.35),
    "OCTO": ("octo", 60, 0.1),
    "FRD": ("frd", 95, 0.55),
}


def words(name: str, figure: int) -> str:
    """The command of a panel, without its grid."""
    word, _, xi = SURFACES[name]
    return f"box {word} dilate {xi}" if figure == 3 else f"box {word} shell {2 * xi}"


def counted(field: "il.fields.Field", n: int = 100) -> float:
    """Volume in the box of half-width 1 by counting points of a grid."""
    x = -1.0 + 2.0 * (np.arange(n) + 0.5) / n
    p = np.stack([a.ravel() for a in np.meshgrid(x, x, x, indexing="ij")], axis=1)
    return float((field(p) < 0.0).mean() * 8.0)


def main(
    names: tuple[str, ...] = tuple(SURFACES), coarser: float = 1.0, out: str = ""
) -> dict[str, float]:
    """Mesh all panels; write ``OUT_solids.png`` and ``OUT_shells.png`` if `out` is given."""
    off, closed = 0.0, True
    for figure, kind in ((3, "solids"), (4, "shells")):
        scenes = []
        for letter, name in zip("abcdefghi", names, strict=False):
            field = il.sdf.parse(words(name, figure))
            mesh = il.sdf.mesh(field, coarser * (5 - figure) / SURFACES[name][1])
            off = max(off, abs(mesh.volume / counted(field) - 1.0))
            closed &= mesh.is_watertight
            scene = il.plot.Scene(view=(-55.0, 28.0), title=f"({letter}) {name}")
            scenes.append(scene.add(mesh))
        if out:
            il.plot.Panels(scenes, columns=3, size=(1500, 1400)).save(f"{out}_{kind}.png")
    return {"watertight": float(closed), "largest part by which volumes differ": off}


if __name__ == "__main__":
    for name, number in main(out="cesogen_showcase").items():
        print(f"{name}: {number:.4g}")
