"""Effective stiffness of cells: Young's modulus and Poisson's ratio, within bounds.

Sheets of four minimal surfaces with three tenths of the volume, and what Hashin and Shtrikman
allow at that density. Every stiffness comes with an estimate of its error. The number that is
checked: the bulk modulus of none is above its bound by more than that error.

    python examples/effective_stiffness.py
"""

import warnings

import ilattice as il

TILES = ("gyroid", "schwarz_p", "diamond", "iwp")


def effective(name: str, cells: int, density: float) -> il.homogenize.Effective:
    """A cell of a sheet with the density that is asked for."""
    lattice = il.Lattice(name, through=il.macroshape.cell(), repeat=1)
    wall = lattice.offset(relative_density=density)
    with warnings.catch_warnings():  # that the cells are coarse, which `error` says
        warnings.simplefilter("ignore", il.errors.PrecisionWarning)
        return il.homogenize.elastic(wall, cells, young=1.0, poisson=0.3)


def main(cells: int = 16, density: float = 0.3, out: str = "") -> dict[str, float]:
    """Moduli of all tiles; with `out`, the spheres of Young's modulus as files and pictures."""
    numbers, excess = {}, []
    for name in TILES:
        eff = effective(name, cells, density)
        numbers[f"{name}: E along an axis"] = eff.E((1, 0, 0))
        numbers[f"{name}: E along a diagonal"] = eff.E((1, 1, 1))
        numbers[f"{name}: nu along an axis"] = eff.nu((1, 0, 0), (0, 1, 0))
        numbers[f"{name}: bulk modulus, part of its bound"] = eff.K / eff.bounds.bulk[1]
        numbers[f"{name}: estimated error"] = eff.error
        excess.append((eff.K - eff.bounds.bulk[1]) / (eff.errors[:3, :3].sum() / 9))
        if out:
            eff.save(f"{out}_{name}.vtp")
            eff.plot(off_screen=True, screenshot=f"{out}_{name}.png")
    return {**numbers, "largest excess over the bound, in errors": max(excess)}


if __name__ == "__main__":
    for name, number in main(out="effective_stiffness").items():
        print(f"{name}: {number:.5g}")
