"""Figure 16 of Xu, Pan, Wang, Du and Lu: surface per volume of shells and of sheets of formulas.

Walls of relative density 0.3 in a unit cell: of the formulas of Schwarz P, Schoen's F-RD and
I-WP, and Neovius, and of shells of their topologies, of each the one with the most surface of some
boundaries. Cuts with the faces of the cell are not counted. The numbers that are checked: surface
per volume of both; P-, F-RD- and Neovius-like shells have more of it than the formulas.

    python examples/shells_surface.py
"""

import warnings

import numpy as np

import ilattice as il

KINDS = {
    "P": ("schwarz_p", "topo_19_rrr", [(0.0, 1.7), (0.0, 2.9)]),
    "F-RD": ("frd", "topo_8_rrr", [((0.1, 0.5, 0.3), 1.7), ((-0.6, 0.6, -0.3), 2.5)]),
    "N": ("neovius", "topo_1_rrr", [((0.2, 0.2, 0.0), 1.5), ((-0.2, -0.2, 0.0), 1.2)]),
    "I-WP": ("iwp", "topo_18_rrr", [(0.5, 3.0), (0.7, 3.0)]),
}


def surface_per_volume(tile: "il.Tile", density: float, h: float) -> float:
    """Of a wall in the unit cube."""
    wall = il.Lattice(tile, through=il.macroshape.box(), repeat=1).offset(relative_density=density)
    mesh = wall.mesh(h=h)
    corners = mesh.vertices[mesh.faces]
    flat = ((np.abs(corners) < 1e-6) | (np.abs(corners - 1.0) < 1e-6)).all(axis=1).any(axis=1)
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(0.5 * np.linalg.norm(sides[~flat], axis=1).sum()) / mesh.volume


def main(
    kinds: tuple[str, ...] = tuple(KINDS), density: float = 0.3, n: int = 16, h: float = 0.05,
    out: str = "",
) -> dict[str, float]:  # fmt: skip
    """Surface per volume, in one over the edge of the cell; with `out`, bars as ``OUT.png``."""
    numbers: dict[str, float] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", il.errors.PrecisionWarning)
        for kind in kinds:
            formula, name, boundaries = KINDS[kind]
            numbers[kind] = surface_per_volume(il.tiles[formula], density, h)
            numbers[f"{kind}-like"] = max(
                surface_per_volume(
                    il.shells.cell(name, position=p, derivative=d, n=n, layer=0.03).tile, density, h
                )
                for p, d in boundaries
            )
    if out:
        _picture(numbers, f"{out}.png")
    return numbers


def _picture(numbers: dict[str, float], path: str) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.subplots()
    plain, likes = ([v for k, v in numbers.items() if k.endswith("like") == b] for b in (0, 1))
    at = np.arange(len(plain))
    axes.bar(at - 0.2, plain, 0.38, label="sheets of formulas", color="0.7")
    axes.bar(at + 0.2, likes, 0.38, label="shells over boundaries", color="tab:blue")
    axes.set_xticks(at, [k for k in numbers if not k.endswith("like")])
    axes.set(ylabel="surface per volume, times the edge of the cell")
    axes.legend(frameon=False)
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    for name, number in main(out="shells_surface").items():
        print(f"{name}: {number:.4g}")
