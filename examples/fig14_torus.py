"""Figure 14 of Hong, Antolin, Elber and Kim: gyroid and diamond in a torus.

16 x 2 x 2 tiles, walls of constant half-thickness 0.1, or one that goes from 0.1 to 0.28 and back
along each half turn. The walls of constant thickness have 481 and 993 handles; where the varying
wall is thick, pores close, so that it has fewer, and nobody had to look for self-intersections.

    python examples/fig14_torus.py
"""

import numpy as np

import ilattice as il


def varying() -> il.BSpline:
    """Half-thickness that goes linearly from 0.1 to 0.28 and back, twice around the torus."""
    along = np.array([0.1, 0.28, 0.1, 0.28, 0.1])
    knots = [0.0, 0.0, 0.25, 0.5, 0.75, 1.0, 1.0]
    return il.BSpline([knots, [0, 1], [0, 1]], along[:, None, None], (1, 0, 0))


def main(
    h: float = 0.05, repeat: tuple[int, int, int] = (16, 2, 2), out: str = ""
) -> dict[str, int]:
    """Build the four walls; write ``OUT_*.vtp`` and ``OUT_*.png`` if `out` is given."""
    torus = il.macroshape.torus(major=4.0, width=2.0)
    genus = {}
    for name in ("gyroid", "diamond"):
        lattice = il.Lattice(il.tiles[name], through=torus, repeat=repeat)
        for kind, d in (("constant", 0.1), ("varying", varying())):
            mesh = lattice.offset(d).mesh(h=h)
            genus[f"{name} {kind}"] = mesh.genus
            if out:
                mesh.save(f"{out}_{name}_{kind}.vtp")
                depth = mesh.point_data["thickness"] - np.abs(mesh.point_data["signed_distance"])
                painted = mesh.with_point_data(depth=depth)
                painted.screenshot(f"{out}_{name}_{kind}.png", scalars="depth", cmap="YlOrBr")
    return genus


if __name__ == "__main__":
    print(main(out="fig14"))
