"""Figure 21 of Sitharam, Youngquist, Nolan and Peters: forces in a minimally rigid structure.

A stiffened Kagome structure is refined; its forces under a load on one corner are found by one
small factorisation and a local rule per level. The number that is checked: how far they are from
the forces by a factorisation of the whole, as a part of the largest one.

    python examples/corner_sharing_stress.py
"""

import numpy as np

import ilattice as il

VIEW = (-60.0, 18.0)


def pushed(k: il.cost.CornerSharing, force: tuple[float, float, float]) -> np.ndarray:
    """A force on the vertex that is farthest against it, balanced by others on all vertices."""
    load = np.zeros_like(k.positions)
    load[np.argmin(k.positions @ np.array(force))] = force
    return il.cost.stress.balanced(k, load)


def main(resolution: int = 5, levels: int = 2, out: str = "") -> dict[str, float]:
    """Differences of forces; with `out`, pictures."""
    first = k = il.cost.kagome(resolution).stiffened()
    for _ in range(levels):
        k = k.refined()
    load = pushed(k, (-1.0, -1.0, -1.0))
    by_levels, flat = k.stress(load), il.cost.refinement.forgotten(k).stress(load)
    off = np.abs(by_levels.bars - flat.bars).max() / np.abs(flat.bars).max()
    if out:
        panels = [("a force along (-1, -1, -1)", first, (-1.0, -1.0, -1.0)),
                  ("a force along -z", first, (0.0, 0.0, -1.0)),
                  (f"the first one, {levels} levels finer", k, (-1.0, -1.0, -1.0))]  # fmt: skip
        scenes = [il.cost.drawing.drawn(first, title="structure and stiffening", view=VIEW)]
        scenes += [
            il.cost.drawing.drawn(s, values=s.stress(pushed(s, f)).bars, title=title, view=VIEW)
            for title, s, f in panels
        ]
        il.plot.Panels(scenes, columns=2, size=(1600, 1400), labels=True).save(f"{out}.png")
    return {
        "difference of the levels": off,
        "residual": by_levels.residual,
        "edges": len(k.edges),
    }


if __name__ == "__main__":
    for name, number in main(levels=3, out="corner_sharing_stress").items():
        print(f"{name}: {number:.5g}")
