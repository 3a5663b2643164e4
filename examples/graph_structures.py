"""Structures of one graph language: trusses, shells, solids, minimal surfaces (paper figure 1).

Graphs of the library are evaluated and drawn, one of them with all its stages. The octet truss,
from a way over three vertices, two turns and three mirrors, is the cell of the catalogue: the
largest difference of their distance fields is 0.

    python examples/graph_structures.py
"""

import numpy as np

import ilattice as il

NAMES = (
    "schwarz_p", "neovius", "schoen_iwp", "gyroid", "schwarz_d", "schwarz_p_neovius",
    "schwarz_p_cubic_open", "polyhedral_cell", "octet", "auxetic3d", "assembled2", "kelvin",
    "bandgap", "fcc_solid", "bcc_6_hole",
)  # fmt: skip


def main(points: int = 20_000, out: str = "") -> dict[str, float]:
    """Numbers of nodes, and how far the octet is off; with `out`, two pictures."""
    library = il.graph.library
    numbers: dict[str, float] = {f"nodes of {n}": library[n].count for n in NAMES}
    u = np.random.default_rng(0).random((points, 3))
    octet = library["octet"].thickened(0.08)
    want = il.tiles.octet(radius=0.04, blend=0.0)
    numbers["largest difference of the octets"] = float(np.abs(octet.solid()(u) - want(u)).max())
    assert numbers["largest difference of the octets"] < 1e-12
    if out:
        il.graph.contact_sheet([library[n] for n in NAMES]).savefig(f"{out}.png", dpi=110)
        library["schwarz_p"].plot().savefig(f"{out}_stages.png", dpi=110)
    return numbers


if __name__ == "__main__":
    for name, number in main(out="graph_structures").items():
        print(f"{name:>34}  {number:.6g}")
