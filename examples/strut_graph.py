"""Struts of an own graph, with a radius per node, meshed and sliced.

A pylon: legs and rings as nodes and edges in space, thick at its foot and slim at its top. The
number that is checked: by how much the mesh is off the round cones between the nodes.

    python examples/strut_graph.py
"""

import numpy as np

import ilattice as il


def pylon(levels: int = 4) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes (n, 3), edges (m, 2) and radii (n,)."""
    nodes, edges, radii = [], [], []
    for k in range(levels + 1):
        for j in range(4):
            turn, reach = 0.5 * np.pi * j + 0.25 * np.pi * k, 10.0 - 1.6 * k
            nodes.append((reach * np.cos(turn), reach * np.sin(turn), 9.0 * k))
            radii.append(1.4 - 0.2 * k)
            own = 4 * k + j
            edges.append((own, 4 * k + (j + 1) % 4))
            if k:
                edges += [(own, own - 4), (own, 4 * (k - 1) + (j + 1) % 4)]
    return np.array(nodes), np.array(edges), np.array(radii)


def main(h: float = 0.4, out: str = "") -> dict[str, float]:
    """Errors of radii, and volume; with `out`, a mesh, slices and a picture."""
    nodes, edges, radii = pylon()
    solid = il.Lattice.from_struts(nodes, edges, radii).offset((np.inf, 0.0))
    mesh = solid.mesh(h)
    a, way = nodes[edges[:, 0]], nodes[edges[:, 1]] - nodes[edges[:, 0]]
    t = np.einsum("nmi,mi->nm", mesh.vertices[:, None] - a, way) / (way**2).sum(axis=1)
    inner = (t > 0.25) & (t < 0.75)
    t = np.clip(t, 0.0, 1.0)
    r = radii[edges[:, 0]] + t * (radii[edges[:, 1]] - radii[edges[:, 0]])
    far = np.linalg.norm(mesh.vertices[:, None] - a - t[..., None] * way, axis=2)
    nearest = (far - r).argmin(axis=1)
    row = np.arange(len(far))
    off = np.abs(far[row, nearest] / r[row, nearest] - 1.0)[inner[row, nearest]]
    if out:
        mesh.save(f"{out}.stl")
        solid.slices(thickness=0.5, h=0.15).save(f"{out}.cli")
        il.plot.Scene(view=(-55.0, 18.0)).add(mesh, color="steelblue").save(f"{out}.png")
    return {
        "largest part by which radii are off": float(np.percentile(off, 99)),
        "watertight": float(mesh.is_watertight),
        "pieces": mesh.components,
        "volume": mesh.volume,
        "handles": mesh.genus,
    }


if __name__ == "__main__":
    for name, number in main(out="strut_graph").items():
        print(f"{name}: {number:.4g}")
