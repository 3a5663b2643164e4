"""A volume that somebody else wrote, filled with I-WP.

`cylinder.xml` comes from G+Smo: a rational, left-handed cylinder shell. It is read, filled and
written for a slicer; the mesh is watertight and in one piece. 3MF files need
`pip install "ilattice[print]"`.

    python examples/gismo_iwp.py [FILE.xml]
"""

import sys
from pathlib import Path

import ilattice as il

FILE = Path(__file__).parents[1] / "tests" / "data" / "gismo" / "cylinder.xml"


def main(
    file: str = str(FILE),
    repeat: tuple[int, int, int] = (8, 1, 8),
    d: float = 0.03,
    h: float = 0.03,
    out: str = "",
) -> dict[str, float]:
    """Build the lattice; write ``OUT`` as STL, 3MF, VTP and PNG if `out` is given."""
    volume = il.macroshape.load(file)
    wall = il.Lattice(il.tiles["iwp"], through=volume, repeat=repeat).offset(d)
    mesh = wall.mesh(h=h)
    if out:
        for ending in ("stl", "3mf", "vtp", "png"):
            mesh.save(f"{out}.{ending}")
    return {
        "open edges": mesh.open_edges,
        "components": mesh.components,
        "filled": mesh.volume / volume.volume(),
    }


if __name__ == "__main__":
    for name, number in main(*sys.argv[1:], out="gismo_iwp").items():
        print(f"{name}: {number:.6g}")
