"""What a thickness does to the topology, before anything is printed: Schwarz P in a bent pipe.

In a cube all throats of Schwarz P close at one half-thickness. In a bent pipe the cells are wider
outside than inside, and the throats close one after the other: through each that is closed no
powder drains any more, until closed voids are left, which fill one after the other. The sweep finds
every such thickness, and where, from the distance to the mid-surface alone. The number that is
checked: the changes add up, from the handles of the thinnest wall to the one part, without handles
and voids, of the full pipe.

    python examples/topology_sweep.py
"""

import numpy as np

import ilattice as il
from ilattice.topology.sweep import COLOURS


def main(tiles: int = 2, h: float = 0.05, out: str = "") -> dict[str, float]:
    """Sweep; write ``OUT_changes.png`` and ``OUT_places.png`` if `out` is given."""
    pipe = il.macroshape.cylinder_shell(2.0, 3.0, 1.0, angle=0.4 * tiles)
    lattice = il.Lattice("schwarz_p", through=pipe, repeat=(tiles, 1, 1))
    sweep = lattice.topology_sweep([0.05, 0.15, 0.3, 0.5], h=h, progress=True)
    if out:
        sweep.plot().savefig(f"{out}_changes.png", dpi=150)
        _picture(lattice.offset(0.15).mesh(h=h), sweep, f"{out}_places.png")
    values = {kind: [e.value for e in sweep.events if e.kind == kind] for kind in COLOURS}
    return {
        "changes": len(sweep.events),
        "first throat closes at": min(values["neck"]),
        "last throat closes at": max(values["neck"]),
        "last void is filled at": max(values["void"]),
        "Euler number of the thinnest wall": sweep.reports[0].euler,
        "Euler number of the full pipe": int(sweep.euler(sweep.d)[-1]),
    }


def _picture(mesh: "il.SurfaceMesh", sweep: "il.mesh.TopologySweep", path: str) -> None:
    """The wall, and the places of the changes."""
    scene = il.plot.Scene(size=(1400, 900), view=(6.0, 48.0)).ghost(mesh, color="gray")
    for kind, colour in COLOURS.items():
        x = np.array([e.x for e in sweep.events if e.kind == kind])
        if len(x):
            scene = scene.add(x, color=colour, radius=0.03, legend=f"{kind} ({len(x)})")
    scene.save(path)


if __name__ == "__main__":
    for name, number in main(out="topology_sweep").items():
        print(f"{name}: {number:.5g}")
