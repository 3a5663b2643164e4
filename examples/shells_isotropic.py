"""Figure 14 of Xu, Pan, Wang, Du and Lu: a shell like Schwarz P that is as stiff in all directions.

Among shells of the class of Schwarz P with nodes off the middles of their edges, there is one of
relative density 0.3 with Zener's ratio 1: found by the method of the chord in the derivative of its
boundary. The sheet of Schwarz P itself is twice as stiff along diagonals as a cube of isotropic
material would be.

    python examples/shells_isotropic.py
"""

import numpy as np

import ilattice as il


def zener(tile: "il.Tile", cells: int, density: float = 0.3) -> tuple[float, float]:
    """Zener's ratio and Young's modulus along the axes of a sheet."""
    lattice = il.Lattice(tile, through=il.macroshape.cell(), repeat=1)
    wall = lattice.offset(relative_density=density)
    eff = il.homogenize.elastic(wall, cells, estimate=False)
    return eff.zener, eff.E((1, 0, 0))


def main(position: float = 0.4, n: int = 16, cells: int = 12, out: str = "") -> dict[str, float]:
    """Search for the derivative; write ``OUT.stl`` and ``OUT.png`` if `out` is given."""

    def shell(derivative: float) -> "il.shells.Shell":
        return il.shells.cell(
            "topo_19_rrr", position=position, derivative=derivative, n=n, layer=0.03, spans=64
        )

    a, b = 1.8, 2.3
    fa, fb = (np.log(zener(shell(d).tile, cells)[0]) for d in (a, b))
    for _ in range(2):  # chords
        d = b - fb * (b - a) / (fb - fa)
        a, fa, b = b, fb, d
        found, young = zener(shell(b).tile, cells)
        fb = np.log(found)
    plain, soft = zener(il.tiles["schwarz_p"], cells)
    if out:
        lattice = il.Lattice(shell(b).tile, through=il.macroshape.box(), repeat=1)
        mesh = lattice.offset(relative_density=0.3).mesh(h=0.04)
        mesh.save(f"{out}.stl")
        mesh.screenshot(f"{out}.png")
    return {
        "derivative": float(b),
        "Zener's ratio": found,
        "Zener's ratio of Schwarz P": plain,
        "Young's modulus": young,
        "Young's modulus of Schwarz P": soft,
    }


if __name__ == "__main__":
    for name, number in main(out="shells_isotropic").items():
        print(f"{name}: {number:.6g}")
