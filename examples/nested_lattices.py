"""A lattice in the wall of a lattice: a fine gyroid fills the walls of a coarse Schwarz P.

Both walls have the half-thickness that is asked for in space. Their fields are functions of the
same parameters, so that their intersection is a field, too: it is contoured in the domain and
mapped. The fine lattice fills as much of the coarse wall as it fills of everything, to a few
percent, for it knows nothing of the other one; of it, crumbs are cut off, which are removed.

    python examples/nested_lattices.py
"""

import numpy as np

import ilattice as il


def main(
    coarse: float = 0.12, fine: float = 0.015, finer: int = 4, cells: int = 12, out: str = ""
) -> dict[str, float]:
    """Build the part; write ``OUT.vtp`` and ``OUT.png`` if `out` is given."""
    arch = il.macroshape.cylinder_shell(1.0, 2.0, 1.0, angle=0.75 * np.pi)
    walls = [
        il.Lattice("schwarz_p", through=arch, repeat=(4, 1, 1)).offset(coarse),
        il.Lattice(
            "gyroid", through=arch, repeat=(4 * finer, finer, finer), spans_per_tile=8
        ).offset(fine),
    ]
    both = il.fields.intersection(*[il.fields.from_callable(wall.field) for wall in walls])
    axes = [np.linspace(0.0, 1.0, cells * n + 1) for n in walls[1].lattice.repeat]
    flat = il.mesh.contour(both, axes)
    faces = flat.faces if arch.orientation > 0 else flat.faces[:, ::-1]
    whole = il.SurfaceMesh(arch.x(np.clip(flat.vertices, 0.0, 1.0)), faces)
    mesh = whole.remove_islands()
    if out:
        mesh.save(f"{out}.vtp")
        mesh.screenshot(f"{out}.png", view=(200.0, 35.0))
    filled = walls[0].relative_density()
    return {
        "open edges": mesh.open_edges,
        "crumbs": whole.volume / mesh.volume - 1.0,
        "filled by the coarse one": filled,
        "filled by the fine one": walls[1].relative_density(),
        "of the coarse wall": mesh.volume / (filled * arch.volume()),
    }


if __name__ == "__main__":
    print(main(out="nested_lattices"))
