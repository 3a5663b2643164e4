"""The shortest program: a Schwarz-P lattice in a torus with walls of half-thickness 0.1.

The wall fills 41.0 % of the torus (half a million closest points say the same).

    python examples/schwarz_p_torus.py
"""

import ilattice as il


def main(h: float = 0.05, out: str = "") -> dict[str, float]:
    """Build the lattice; write ``OUT.stl``, ``OUT.vtp`` and ``OUT.png`` if `out` is given."""
    torus = il.macroshape.torus(major=4.0, width=2.0)
    lattice = il.Lattice(il.tiles.schwarz_p(), through=torus, repeat=(16, 2, 2))
    wall = lattice.offset(0.1)
    mesh = wall.mesh(h=h)
    if out:
        mesh.save(f"{out}.stl")
        mesh.save(f"{out}.vtp")
        mesh.screenshot(f"{out}.png")
    return {"filled": mesh.volume / torus.volume(), "error": wall.thickness_error(mesh).p99}


if __name__ == "__main__":
    for name, number in main(out="schwarz_p_torus").items():
        print(f"{name}: {number:.6g}")
