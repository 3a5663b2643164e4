"""Figure 12 of Sitharam, Youngquist, Nolan and Peters: refinement, local and of all.

Every tetrahedron, or only those on one side, is replaced by four at its corners. What is refined
keeps its positions, its rigidity and its uniform lengths. The number that is checked: the volume
of the tetrahedra per level, which halves where all are refined.

    python examples/corner_sharing_refined.py
"""

import numpy as np

import ilattice as il


def main(resolution: int = 3, levels: int = 2, out: str = "") -> dict[str, float]:
    """Volumes, deficits and lengths; with `out`, a picture of all levels."""
    first = il.cost.kagome(resolution)
    local, whole = [first], [first]
    for _ in range(levels):
        local.append(local[-1].refined(where=lambda c: c[:, 0] > 0.55))
        whole.append(whole[-1].refined())
    if out:
        scenes = [
            il.cost.drawing.drawn(
                k, filled=True, title=f"{what}, {i}", radius=0.006, view=(-60.0, 18.0)
            )
            for what, series in (("where x > 0.55", local), ("everywhere", whole))
            for i, k in enumerate(series)
        ]
        il.plot.Panels(scenes, columns=levels + 1, size=(1800, 1200)).save(f"{out}.png")
    mass = np.array([k.mass for k in whole])
    return {
        "volume per level, over that before": float(np.max(mass[1:] / mass[:-1])),
        "deficit at first": first.deficit,
        "deficit at the end": whole[-1].deficit,
        "deficit where only one side is refined": local[-1].deficit,
        "spread of lengths": float(np.ptp(whole[-1].lengths) / whole[-1].lengths.mean()),
        "tetrahedra where only one side is refined": len(local[-1].simplices),
    }


if __name__ == "__main__":
    for name, number in main(out="corner_sharing_refined").items():
        print(f"{name}: {number:.5g}")
