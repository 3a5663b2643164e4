"""Figure 14 of Xu, Pan, Wang, Du and Lu: a shell like Schwarz P that is as stiff in all directions.

Among shells of the class of Schwarz P with nodes off the middles of their edges, there is one of
relative density 0.3 with Zener's ratio 1: found by the method of the chord in the derivative of its
boundary. The sheet of Schwarz P itself is twice as stiff along diagonals as a cube of isotropic
material would be.

    python examples/shells_isotropic.py
"""

import numpy as np

import ilattice as il

DENSITIES = (0.15, 0.2, 0.25, 0.3, 0.35, 0.4)


def effective(tile: "il.Tile", cells: int, density: float = 0.3) -> "il.homogenize.Effective":
    """The stiffness of a sheet."""
    lattice = il.Lattice(tile, through=il.macroshape.cell(), repeat=1)
    wall = lattice.offset(relative_density=density)
    return il.homogenize.elastic(wall, cells, estimate=False)


def main(position: float = 0.4, n: int = 16, cells: int = 12, out: str = "") -> dict[str, float]:
    """Search for the derivative; write ``OUT.stl`` and ``OUT.png`` if `out` is given."""

    def shell(derivative: float) -> "il.shells.Shell":
        return il.shells.cell(
            "topo_19_rrr", position=position, derivative=derivative, n=n, layer=0.03, spans=64
        )

    a, b = 1.8, 2.3
    fa, fb = (np.log(effective(shell(d).tile, cells).zener) for d in (a, b))
    for _ in range(2):  # chords
        d = b - fb * (b - a) / (fb - fa)
        a, fa, b = b, fb, d
        found = effective(shell(b).tile, cells)
        fb = np.log(found.zener)
    plain = effective(il.tiles["schwarz_p"], cells)
    if out:
        lattice = il.Lattice(shell(b).tile, through=il.macroshape.box(), repeat=1)
        mesh = lattice.offset(relative_density=0.3).mesh(h=0.04)
        mesh.save(f"{out}.stl")
        _picture({"P-like": shell(b).tile, "Schwarz P": il.tiles["schwarz_p"]}, cells, f"{out}.png")
    return {
        "derivative": float(b),
        "Zener's ratio": found.zener,
        "Zener's ratio of Schwarz P": plain.zener,
        "Young's modulus": found.E((1, 0, 0)),
        "Young's modulus of Schwarz P": plain.E((1, 0, 0)),
    }


def _picture(tiles: dict[str, "il.Tile"], cells: int, path: str) -> None:
    """Both moduli over density, and Young's modulus of 0.3 in all directions."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 7.5), layout="constrained")
    upper, lower = figure.subplots(2, 2, height_ratios=(1, 1.1))
    found = {k: [effective(tile, cells, d) for d in DENSITIES] for k, tile in tiles.items()}
    at = DENSITIES.index(0.3)
    most = max(f[at].surface().point_data["E"].max() for f in found.values())
    for below, (name, effs) in zip(lower, found.items(), strict=True):
        upper[0].plot(DENSITIES, [eff.E((1, 0, 0)) for eff in effs], "o-", label=name)
        upper[1].plot(DENSITIES, [eff.zener for eff in effs], "o-", label=name)
        scene = il.plot.Scene(axes=True, size=(640, 500)).add(
            effs[at].surface(), scalars="E", label="E", clim=(0.0, most)
        )
        below.imshow(scene.image())
        below.set_axis_off()
        below.set_title(f"{name}: E in all directions, density 0.3")
    upper[0].set(xlabel="relative density", ylabel="Young's modulus along the axes")
    upper[1].set(xlabel="relative density", ylabel="Zener's ratio")
    upper[1].axhline(1.0, color="gray", linewidth=0.8)
    for axes in upper:
        axes.legend()
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    for name, number in main(out="shells_isotropic").items():
        print(f"{name}: {number:.6g}")
