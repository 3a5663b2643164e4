"""Corner-sharing tetrahedra in a curved volume: printed, sliced, and rigid.

The unit cube is cut into tetrahedra, each filled with a Kagome structure, joined by exact keys, and
moved through the map of the duck. The number that is checked: the structure is minimally rigid,
so its rank is three times the vertices less six, without self-stress.

    python examples/corner_sharing_duck.py
"""

import numpy as np

import ilattice as il


def main(resolution: int = 3, h: float = 0.014, out: str = "") -> dict[str, float]:
    """Rank and size; with `out`, beams, mesh, slices and pictures."""
    vertices, tets = il.cost.divided_box(1)
    duck = il.macroshape.duck()
    k = il.cost.fill(vertices, tets, resolution=resolution).joined().mapped(duck)
    k = k.stiffened()
    found = k.rigidity()
    beams = k.beams(0.03)
    mesh = beams.mesh(h)
    if out:
        beams.save(f"{out}.3mf")
        mesh.save(f"{out}.stl")
        mesh.screenshot(f"{out}.png")
        beams.slices(np.linspace(*beams.bounds[:, 2], 12)[1:-1]).save(f"{out}.cli")
        k.plot(filled=True, screenshot=f"{out}_graph.png")
    return {
        "rank less three vertices and six": found.rank - 3 * len(k.positions) + 6,
        "self-stresses": found.self_stresses,
        "beams": len(k.edges),
        "volume": mesh.volume,
        "watertight": float(mesh.is_watertight),
    }


if __name__ == "__main__":
    for name, number in main(out="corner_sharing_duck").items():
        print(f"{name}: {number:.5g}")
