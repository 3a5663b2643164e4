"""Figure 19 of Sitharam, Youngquist, Nolan and Peters: triangulations and their structures.

Random flips of diagonals change a triangulation of the points of a triangular lattice; the
midpoints of its edges, which stay on another lattice, are the vertices of a corner-sharing
structure. The number that is checked: vertices that are elsewhere if the structure of the first
triangulation is flipped at the same places in place of the triangulation.

    python examples/corner_sharing_bijection.py
"""

import numpy as np

import ilattice as il
from ilattice.cost import flips


def lattice(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles of an equilateral triangle with n edges per side."""
    at = [(i, j) for i in range(n + 1) for j in range(n + 1 - i)]
    number = {p: k for k, p in enumerate(at)}
    rows = [[number[i, j], number[i + 1, j], number[i, j + 1]] for i, j in at if i + j < n]
    rows += [
        [number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]] for i, j in at if i + j < n - 1
    ]
    axes = np.array([(1.0, 0.0), (0.5, np.sqrt(0.75))])
    return np.array(at) @ axes / n, np.array(rows)


def diagonal_flipped(triangles: np.ndarray, a: int, b: int) -> np.ndarray:
    """Triangles after the diagonal from a to b is replaced by the other one."""
    both = np.flatnonzero(np.isin(triangles, (a, b)).sum(axis=1) == 2)
    c, d = (int(t[~np.isin(t, (a, b))][0]) for t in triangles[both])
    out = triangles.copy()
    out[both] = [[c, d, b], [d, c, a]]
    return out


def main(n: int = 8, steps: int = 60, seed: int = 3, out: str = "") -> dict[str, float]:
    """Vertices that differ and flips made; with `out`, a picture of both."""
    x, triangles = lattice(n)
    k, made = il.cost.midpoint(x, triangles), 0
    rng = np.random.default_rng(seed)
    for _ in range(steps):
        v = int(rng.choice(np.flatnonzero(k.incidence[:, 1] >= 0)))
        if not flips.is_balanced(k, v):
            continue
        pairs = x[triangles[:, [(0, 1), (1, 2), (2, 0)]]].mean(axis=2).reshape(-1, 2)
        t, side = divmod(int(np.argmin(np.linalg.norm(pairs - k.positions[v], axis=1))), 3)
        a, b = triangles[t][[side, (side + 1) % 3]].tolist()
        triangles = diagonal_flipped(triangles, a, b)
        k, made = flips.flipped(k, v, kind="modified"), made + 1
    again = il.cost.midpoint(x, triangles)

    def corners(s: il.cost.CornerSharing) -> np.ndarray:
        """Corners of all triangles, sorted."""
        p = np.round(4 * n * s.positions[s.simplices], 6)
        rows = np.array([sorted(map(tuple, t)) for t in p]).reshape(len(p), -1)
        return rows[np.lexsort(rows.T)]

    differ = np.abs(corners(k) - corners(again)).reshape(-1, 2).max(axis=1) > 1e-6
    if out:
        flat = il.SurfaceMesh(np.pad(x, ((0, 0), (0, 1))), triangles)
        ends = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        tubes = il.plot.shapes.segments(flat.vertices, ends).tube(radius=0.004)
        seen = {"view": "top", "parallel": True, "occlusion": False}
        left = il.plot.Scene(title="triangulation", **seen).add(tubes, color="black")
        right = il.cost.drawing.drawn(k, filled=True, title="midpoints of its edges", radius=0.004)
        il.plot.Panels([left, right.add(tubes, color="lightgray")], size=(1600, 760)).save(
            f"{out}.png"
        )
    return {
        "vertices that differ": float(differ.sum()),
        "flips": made,
        "spread of areas": float(np.ptp(np.abs(again.volumes)) / again.volumes.mean()),
        "spread of lengths": float(again.lengths.std() / again.lengths.mean()),
    }


if __name__ == "__main__":
    for name, number in main(out="corner_sharing_bijection").items():
        print(f"{name}: {number:.5g}")
