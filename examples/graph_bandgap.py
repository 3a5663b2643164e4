"""Heavy balls on thin rods, whose waves leave a wide gap above the sixth band (paper figure 12).

Below the gap are the six motions of balls on springs; the next bands bend the rods or deform the
balls. The number is the width of the gap relative to its middle; above 0.5.

    python examples/graph_bandgap.py
"""

import warnings

import ilattice as il

g = il.graph


def main(cells: int = 8, steps: int = 3, path: str = "GXMRG", out: str = "") -> dict[str, float]:
    """Width of the gap; with `out`, the bands and the cell."""
    structure = g.library["bandgap"]
    root = g.bandgap(structure.voxel_node, curves=8, samples=steps)
    graph = g.Graph(root, structure.within, "balls on rods")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", il.errors.PrecisionWarning)  # the gap is wider than errors
        bands = graph.bandgap(cells, path=path)
    gap = max(bands.gaps, key=lambda one: one.width)
    assert gap.below == 6
    assert gap.width > 0.5
    if out:
        bands.plot().savefig(f"{out}.png", dpi=110)
        graph.plot().savefig(f"{out}_graph.png", dpi=110)
    return {"bands below the gap": gap.below, "relative width of the gap": gap.width}


if __name__ == "__main__":
    for name, number in main(steps=8, out="graph_bandgap").items():
        print(f"{name:>26}  {number:.4g}")
