"""Three surfaces over one annotated boundary: direct, mixed and conjugate (paper figure 5).

A hexagon in the octant of the unit cell is kept as it is, may slide along one of its sides, or
along all of them: the more it may, the smaller is the surface. What slides everywhere is Schwarz P,
of area 2.3451 per cell.

    python examples/graph_surfaces.py
"""

import ilattice as il

g = il.graph
HEXAGON = (
    (0.5, 0, 0.25), (0.5, 0.25, 0), (0.25, 0.5, 0), (0, 0.5, 0.25), (0, 0.25, 0.5), (0.25, 0, 0.5),
)  # fmt: skip


def surfaces(edges: int) -> dict[str, "il.graph.Graph"]:
    """The three graphs."""
    v = [g.vertex(p) for p in HEXAGON]
    straight, bent = g.chain([*v[1:], v[0]]), g.chain(v[:2], smooth=True)
    out = {}
    for kind in ("direct", "mixed", "conjugate"):
        patch = g.surface([bent, straight], kind=kind, thickness=0.05, edges=edges)
        out[kind] = g.Graph(g.object(patch.completed(g.cuboid())), g.cuboid(), kind)
    return out


def main(edges: int = 16, out: str = "") -> dict[str, float]:
    """Areas per cell; with `out`, a picture."""
    numbers = {}
    graphs = surfaces(edges)
    for kind, graph in graphs.items():
        coarse = surfaces(edges // 2)[kind]
        fine, rough = (8.0 * one.patches()[0].area for one in (graph, coarse))
        numbers[f"area of the {kind} surface"] = (4.0 * fine - rough) / 3.0
    areas = list(numbers.values())
    assert areas == sorted(areas, reverse=True)
    assert abs(areas[-1] - 2.34511) < 1e-3
    if out:
        g.contact_sheet(graphs.values(), columns=3).savefig(f"{out}.png", dpi=110)
    return numbers


if __name__ == "__main__":
    for name, number in main(out="graph_surfaces").items():
        print(f"{name:>30}  {number:.6g}")
