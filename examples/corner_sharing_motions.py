"""Corner-sharing structures that move, refined at voids, exchanged, and as a net of resistors.

A plane Kagome structure without stiffening swings along one of its motions, by steps that keep all
lengths; rule R1 refines the voids on one side of another one; two tetrahedra are exchanged for
stiffened Kagome structures, which keeps the whole minimally rigid; and the resistances between the
ends of edges tell which of them are hard to bypass. The number that is checked: the largest change
of a length during the motion.

    python examples/corner_sharing_motions.py
"""

import numpy as np

import ilattice as il
from ilattice.cost import counting, refinement, rigidity


def main(resolution: int = 4, frames: int = 12, out: str = "") -> dict[str, float]:
    """Changes of lengths, ranks, sums; with `out`, a picture and a film of the motion."""
    k = il.cost.kagome(resolution, dim=2)
    motion = rigidity.flexes(k)[0]
    swing = rigidity.swung(k, motion, 0.15, frames=frames)
    change = max(np.abs(s.lengths / k.lengths - 1.0).max() for s in swing)
    right = il.cost.kagome(7, dim=2).refined("R1", where=lambda c: c[:, 0] > 0.45)
    rigid = il.cost.kagome(3).stiffened()
    exchanged = refinement.substituted(rigid, [0, 5], 3)
    net = il.cost.kagome(5).stiffened()
    resistance = counting.resistance(net)
    if out:
        first = il.cost.drawing.drawn(k, title="a motion", radius=0.004)
        ghosts = il.plot.shapes.segments(np.pad(swing[-1].positions, ((0, 0), (0, 1))), k.edges)
        scenes = [
            first.add(ghosts.tube(radius=0.004), color="#cc3311"),
            il.cost.drawing.drawn(right, filled=True, title="rule R1 where x > 0.45", radius=0.003),
            il.cost.drawing.drawn(exchanged, filled=True, title="two exchanged", radius=0.008,
                                  view=(-60.0, 18.0)),
            il.cost.drawing.drawn(net, values=resistance, label="resistance", view=(-60.0, 18.0),
                                  title="resistances"),
        ]  # fmt: skip
        il.plot.Panels(scenes, columns=2, size=(1600, 1400), labels=True).save(f"{out}.png")
        there = [k, *swing]
        film = [il.cost.drawing.drawn(s, filled=True, size=(500, 440)) for s in there]
        il.plot.animate([*film, *film[-2:0:-1]], f"{out}.gif", fps=12)
    return {
        "largest change of a length": change,
        "largest displacement": np.abs(swing[-1].positions - k.positions).max(),
        "self-stresses after the exchange": exchanged.rigidity().self_stresses,
        "motions after the exchange": exchanged.rigidity().flexes,
        "triangles by R1": len(right.simplices),
        "deficit by R1": right.deficit,
        "resistances less vertices but one": resistance.sum() - (len(net.positions) - 1),
    }


if __name__ == "__main__":
    for name, number in main(out="corner_sharing_motions").items():
        print(f"{name}: {number:.5g}")
