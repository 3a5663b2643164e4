"""Figures 1 and 7 of Sitharam, Youngquist, Nolan and Peters: a ball of mapped Kagome structures.

A Kagome structure in a tetrahedron is moved through a Bernstein-Bezier map of degree 5 whose outer
face is close to an eighth of a sphere; eight of them, joined by exact keys, are a ball. The number
that is checked: how far vertices of the outer faces are from the sphere, as a part of its radius.

    python examples/corner_sharing_sphere.py
"""

import numpy as np

import ilattice as il

#: Corners of the octant, and of the octahedron about all eight.
OCTANT = np.array([(0.0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)])
OCTAHEDRON = np.concatenate([OCTANT, -OCTANT[1:]])


def eighth_of_a_ball(degree: int) -> il.cost.BernsteinSimplex:
    """The map that takes as many points of the octant as it has Bezier points along their rays."""
    flat = il.cost.BernsteinSimplex.straight(OCTANT, degree)
    count = len(flat.points)
    units = [il.cost.BernsteinSimplex(degree, np.eye(count)[:, [i]], OCTANT) for i in range(count)]
    values = np.column_stack([unit(flat.points)[:, 0] for unit in units])
    x = flat.points
    far = np.linalg.norm(x, axis=1)
    scaled = x * (x.sum(axis=1) / np.where(far > 0.0, far, 1.0))[:, None]
    return il.cost.BernsteinSimplex(degree, np.linalg.solve(values, scaled), OCTANT)


def octants() -> np.ndarray:
    """The eight tetrahedra of the octahedron."""
    rows = []
    for sign in np.ndindex(2, 2, 2):
        corners = [0, *(i + 1 + 3 * s for i, s in enumerate(sign))]
        rows.append(corners if sum(sign) % 2 == 0 else [corners[i] for i in (0, 2, 1, 3)])
    return np.array(rows)


def main(resolution: int = 5, degree: int = 5, out: str = "") -> dict[str, float]:
    """Distance from the sphere and counts; with `out`, a picture of all steps."""
    through = eighth_of_a_ball(degree)
    one = il.cost.kagome(resolution, corners=OCTANT)
    whole = il.cost.fill(OCTAHEDRON, octants(), resolution=resolution).joined()
    ball = whole.mapped(lambda x: np.sign(x) * through(np.abs(x)))
    outer = np.isclose(np.abs(whole.positions).sum(axis=1), 1.0)
    off = np.abs(np.linalg.norm(ball.positions[outer], axis=1) - 1.0)
    ball.check()
    if out:
        steps = {
            "in a tetrahedron": one,
            "in an eighth of a ball": one.mapped(through),
            "eight of them, joined": ball,
        }
        scenes = [
            il.cost.drawing.drawn(k, filled=True, title=title, view=(35.0, 25.0))
            for title, k in steps.items()
        ]
        il.plot.Panels(scenes, size=(1800, 640)).save(f"{out}.png")
    return {
        "farthest from the sphere": off.max(),
        "vertices": len(ball.positions),
        "tetrahedra": len(ball.simplices),
        "overlaps": len(il.cost.embedding.overlaps(ball)),
    }


if __name__ == "__main__":
    for name, number in main(out="corner_sharing_sphere").items():
        print(f"{name}: {number:.5g}")
