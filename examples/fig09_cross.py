"""Figures 9, 10 and 12 of Hong, Antolin, Elber and Kim: a cross in a torus, a duck and a wing.

The tile is a 3D cross of round arms; the volumes have seven coordinates: x, y, z, red, green, blue
and d, by which the cross grows, to first order and as a fraction of a tile. Once d is the same
everywhere, once it changes through the part; the arms stay connected and the colours go with it.
Where d is larger the lattice is denser: the number that is checked is the volume gained.

    python examples/fig09_cross.py
"""

import numpy as np

import ilattice as il

REPEAT = {"torus": (16, 2, 2), "duck": (6, 4, 10), "wing": (4, 2, 10)}
WIDTH = {"torus": 0.06, "duck": 0.03, "wing": 0.015}


def volume(name: str, low: float, high: float) -> il.SplineMap:
    """Volume in ℝ⁷: its d goes from `low` to `high` along the part, its colour from blue to red."""
    shape = {
        "torus": lambda: il.macroshape.torus(major=4.0, width=2.0),
        "duck": il.macroshape.duck,
        "wing": il.macroshape.wing,
    }[name]()
    along = 0 if name == "torus" else 2

    def wave(u: np.ndarray) -> np.ndarray:
        t = u[:, along]
        return 0.5 - 0.5 * np.cos(2 * np.pi * t) if name == "torus" else t

    return shape.with_extra(
        r=wave, g=0.3, b=lambda u: 1.0 - wave(u), d=lambda u: low + (high - low) * wave(u)
    )


def main(
    parts: tuple[str, ...] = ("torus", "duck", "wing"), coarser: float = 1.0, out: str = ""
) -> dict[str, float]:
    """Build both lattices of each part; write ``OUT_*.vtp`` and ``OUT_*.png`` if `out` is given."""
    cross = il.tiles.cross(radius=0.12)
    gained = {}
    for part in parts:
        volumes = []
        for kind, high in (("constant", 0.0), ("varying", 0.12)):
            lattice = il.Lattice(cross, through=volume(part, 0.0, high), repeat=REPEAT[part])
            d = "d" if kind == "varying" else 0.0
            mesh = lattice.offset((np.inf, d), space="parametric").mesh(coarser * WIDTH[part])
            volumes.append(mesh.volume)
            if out:
                mesh.save(f"{out}_{part}_{kind}.vtp")
                mesh.screenshot(f"{out}_{part}_{kind}.png", scalars="r", cmap="coolwarm")
        gained[part] = volumes[1] / volumes[0]
    return gained


if __name__ == "__main__":
    print(main(out="fig09"))
