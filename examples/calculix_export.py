"""A lattice analysed by another program: decks for CalculiX and Abaqus.

A bar of gyroid walls, 2 mm thick, is held at one end and pulled down at the other by 50 N. Two
decks of it run as they are, ``ccx calculix_export_tetrahedra``: one of quadratic tetrahedra, which
TetGen (``pip install "ilattice[tetrahedra]"``) fits to the mesh of the wall, and one of the cells
of a background grid that are at least half solid, which needs nothing, and is approximate. CalculiX
2.20 finds a strain energy of 38.4 N mm for the tetrahedra and 40.3 for the hexahedra (39.5 if they
are smaller, ``cells=30``); `il.cutfem.Elasticity` on 36 x 12 x 12 cells has 38.3. The numbers that
are checked: the volume of the elements, and that the forces on their nodes add up.

    python examples/calculix_export.py
"""

from importlib.util import find_spec

import numpy as np

import ilattice as il

FORCE = np.array([0.0, 0.0, -50.0])
MATERIAL = {"young": 2000.0, "poisson": 0.35}  # MPa: millimetres and newtons


def bar() -> il.Wall:
    """Three cells of 10 mm in a row."""
    block = il.macroshape.box((30.0, 10.0, 10.0))
    return il.Lattice("gyroid", through=block, repeat=(3, 1, 1)).offset(1.0)


def main(h: float = 0.6, cells: int = 20, out: str = "") -> dict[str, float]:
    """How far volumes and resultants are off; with `out`, decks and a picture."""
    wall = bar()
    solids = {"hexahedra": il.mesh.hexahedra(wall, (3 * cells, cells, cells))}
    if find_spec("tetgen"):
        solids["tetrahedra"] = wall.mesh(h).remove_islands().tetrahedra()
    found = {}
    for name, solid in solids.items():
        solid = solid.with_regions(held="x < 0", pulled="x > 30")
        if out:
            deck = f"{out}_{name}.inp"
            solid.save(deck, **MATERIAL, fixed="held", forces={"pulled": FORCE})
        forces = solid.nodal_forces("pulled", FORCE)
        found[f"volume of {name} over that of the wall"] = solid.volume / wall.volume()
        found[f"resultant of {name}, off by"] = float(np.abs(forces.sum(axis=0) - FORCE).max())
    if out:
        scenes = [
            il.plot.Scene(title=f"{len(solid.cells)} {name}").add(solid, show_edges=True)
            for name, solid in solids.items()
        ]
        il.plot.Panels(scenes, columns=1, size=(1100, 620 * len(scenes))).save(f"{out}.png")
    return found


if __name__ == "__main__":
    for name, number in main(out="calculix_export").items():
        print(f"{name}: {number:.4g}")
