"""Blocks of 3 x 3 x 3 cells for a printer, 90 mm wide with walls of 2 mm (paper figure 10).

Of some random graphs of each kind the one that is stiffest for its density is taken, with the least
thickness that can be printed, and written as a watertight mesh of 27 cells. The material in a block
is 27 times that of a cell, within a twentieth, which bends lose. Random shells need not hang
together: of how many parts a block is, is told.

    python examples/graph_printed.py
"""

import warnings

import numpy as np

import ilattice as il

KINDS = ("conjugate", "direct", "truss")


def best(kind: str, seeds: int, thickness: float, cells: int) -> "il.graph.Graph":
    """The random graph of the largest Young's modulus over density."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", il.errors.PrecisionWarning)  # it is the order that counts
        rows = il.graph.explore(kind, seeds, thickness=thickness, cells=cells)
    seed = int(rows["seed"][np.nanargmax(rows["E"] / rows["density"])])
    return il.graph.random_graph(kind, seed, thickness=thickness)


def main(
    seeds: int = 8, cells: int = 24, edge: float = 30.0, wall: float = 2.0, h: float = 0.6,
    kinds: tuple[str, ...] = KINDS, out: str = "",
) -> dict[str, float]:  # fmt: skip
    """Densities of cells, and of the blocks made of them; with `out`, STL files and a picture."""
    numbers, meshes = {}, {}
    for kind in kinds:
        graph = best(kind, seeds, wall / edge, cells)
        block = il.macroshape.box((3.0 * edge,) * 3)
        solid = il.Lattice(graph.solid(), through=block, repeat=3).offset((np.inf, 0.0))
        mesh = solid.mesh(h)
        assert mesh.is_watertight
        density, cell = mesh.volume / (3.0 * edge) ** 3, float(graph.voxels(200).mean())
        assert abs(density / cell - 1.0) < 0.05
        numbers[f"density of the {kind} cell"] = cell
        numbers[f"density of the {kind} block"] = density
        numbers[f"parts of the {kind} block"] = mesh.components
        meshes[kind] = mesh
        if out:
            mesh.save(f"{out}_{kind}.stl")
    if out:
        scenes = [
            il.plot.Scene(view=(-35.0, 22.0), title=k).add(m, color="lightgray")
            for k, m in meshes.items()
        ]
        il.plot.Panels(scenes, size=(1800, 620)).save(f"{out}.png")
    return numbers


if __name__ == "__main__":
    for name, number in main(out="graph_printed").items():
        print(f"{name:>28}  {number:.4g}")
