"""Figure 8 of Sitharam, Youngquist, Nolan and Peters: flips, random ones and those of a hole.

Vertices stay where they are while random flips change which triangles share them; a hole is made
by six flips and relaxation. The number that is checked: the largest radius of the hole over the
least one, which is nearly that of a circle.

    python examples/corner_sharing_flips.py
"""

import numpy as np

import ilattice as il
from ilattice.cost import flips, refinement, shaping


def main(resolution: int = 12, out: str = "") -> dict[str, float]:
    """Shape of the hole, and how flips change lengths; with `out`, pictures."""
    k = il.cost.kagome(resolution, dim=2)
    centre = k.positions.mean(axis=0)
    voids = np.array([k.positions[f].mean(axis=0) for f in refinement.voids(k)])
    near = voids[np.argmin(np.linalg.norm(voids - centre, axis=1))]
    hole = shaping.opened(k, near)
    ring = hole.positions[max(refinement.voids(hole), key=len)]
    r = np.linalg.norm(ring - ring.mean(axis=0), axis=1)
    wild = flips.randomised(k, 40 * len(k.simplices), seed=1)
    tame = flips.randomised(wild, 80 * len(k.simplices), seed=2, target=lambda e: e**2)
    if out:
        for name, what in (("hole", hole), ("random", wild), ("short", tame)):
            what.plot(filled=True, screenshot=f"{out}_{name}.png")
    return {
        "largest radius over the least": r.max() / r.min(),
        "corners of the hole": len(ring),
        "spread of lengths, random": wild.lengths.std() / wild.lengths.mean(),
        "spread of lengths, short ones preferred": tame.lengths.std() / tame.lengths.mean(),
        "overlaps": float(len(il.cost.embedding.overlaps(tame))),
    }


if __name__ == "__main__":
    for name, number in main(out="corner_sharing_flips").items():
        print(f"{name}: {number:.5g}")
