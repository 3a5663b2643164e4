"""A minimal surface from a loop on a prism, step by step (paper figure 3).

The way of the loop along the faces gives the directions of the sides of a dual polygon, whose
lengths are sought; a soap film over it is the dual surface, and its conjugate meets the faces at
right angles: Schoen's I-WP. The lengths found are as 1, the root of 2, and 2.

    python examples/graph_conjugate_steps.py
"""

import numpy as np

import ilattice as il

LOOP = ((0.25, 0, 0), (0.25, 0.25, 0), (0.5, 0.5, 0.25), (0.5, 0.25, 0.5), (0.25, 0.25, 0.5),
        (0, 0, 0.25))  # fmt: skip
g = il.graph


def main(edges: int = 24, out: str = "") -> dict[str, float]:
    """Lengths of the dual polygon, and the area of the cell; with `out`, a picture of the steps."""
    chain = g.chain([g.vertex(p) for p in LOOP], closed=True)
    surface = g.surface(chain, kind="conjugate", thickness=0.04, edges=edges)
    graph = g.Graph(g.object(surface.completed(g.prism())), within=g.prism(), name="I-WP")
    patch = graph.patches()[0]
    lengths = patch.report.lengths[:3] / patch.report.lengths[0]
    wanted = np.array([1.0, np.sqrt(2.0), 2.0])
    off = float(np.abs(lengths / wanted - 1.0).max())
    assert off < 1e-3
    area = 16.0 * patch.area
    assert abs(area - 3.46410) < 0.01
    if out:
        _picture(patch, graph, f"{out}.png")
    return {"side 2 over side 1": lengths[1], "side 3 over side 1": lengths[2], "area": area}


def _picture(patch: "il.minimal.MinimalPatch", graph: "il.graph.Graph", path: str) -> None:
    region, loop = graph.within, np.array([*LOOP, LOOP[0]])
    frame = [c for a in range(5) for b in range(a) if len(c := region.edge(a, b)) == 2]
    edges = il.plot.polylines(frame)
    corners = patch.partner[patch.disc.side_rows[:, 0]]
    dual = il.plot.polylines([np.vstack([corners, corners[:1]])])
    film = il.SurfaceMesh(patch.partner, patch.disc.faces)
    view = (-60.0, 20.0)
    scenes = [
        il.plot.Scene(view=view, title="loop").lines(edges).lines(
            il.plot.polylines([loop]), color="firebrick", width=4.0),
        il.plot.Scene(view=view, title="dual polygon").lines(dual, color="firebrick", width=4.0),
        il.plot.Scene(view=view, title="dual surface").add(film, color="goldenrod").lines(dual),
        il.plot.Scene(view=view, title="conjugate").add(patch.mesh, color="goldenrod").lines(edges),
        il.plot.Scene(view=(-60.0, 25.0), title="cell").add(
            graph.body.surface.mesh, color="goldenrod", backface_params={"color": "steelblue"}),
    ]  # fmt: skip
    il.plot.Panels(scenes, size=(2400, 520)).save(path)


if __name__ == "__main__":
    for name, number in main(out="graph_conjugate_steps").items():
        print(f"{name:>20}  {number:.6g}")
