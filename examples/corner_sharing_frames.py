"""Trusses, frames, solids: from which radius on a corner-sharing structure is its truss.

A stiffened Kagome structure stands on a face and carries a load on its top: as a pin-jointed truss,
as a frame of beams that are joined rigidly, and as the solid that is printed. They tend to each
other for thin beams: frames to trusses with the square of radius over length, solids to frames with
the first power, since joints have a size. But structures that are just rigid have motions that
stretch little, and bending holds them long before: here the truss is 8 % off at 1/80 of the length.
The number that is checked: the order at which the frame tends to the truss.

    python examples/corner_sharing_frames.py
"""

from collections.abc import Sequence

import numpy as np

import ilattice as il
from ilattice.cost.frames import frame

CORNERS = np.array([(0, 0, 0), (1, 0.05, 0), (0.45, 0.9, 0), (0.48, 0.32, 0.85)])
RADII = (0.1, 0.05, 0.025, 0.0125, 0.00625, 0.003125, 0.0015625)


def solid(k: il.cost.CornerSharing, r: float, load: np.ndarray, fineness: float) -> float:
    """Compliance of the beams as a solid, held where the grid ends, by cells of some radii."""
    beams = k.beams(r)
    box = np.array(beams.bounds)
    box[:, 2] = k.positions[:, 2].min(), k.positions[:, 2].max()
    cells = np.rint((box[1] - box[0]) / (fineness * r)).astype(int).tolist()
    problem = il.cutfem.Elasticity(beams, cells, domain=box).clamp("w=0")
    return problem.load(force=tuple(load), on="w=1").solve().compliance


def main(
    resolution: int = 3, solids: Sequence[float] = RADII[:3], fineness: float = 1.0, out: str = ""
) -> dict[str, float]:
    """Compliances over that of the truss; with `out`, a picture of them."""
    k = il.cost.kagome(resolution, corners=CORNERS).stiffened()
    held, top = k.positions[:, 2] < 1e-9, int(np.argmax(k.positions[:, 2]))
    loads = np.zeros_like(k.positions)
    loads[top, 2] = -1.0
    length = k.lengths.mean()

    def truss(part: float) -> float:
        area = np.pi * (part * length) ** 2
        return k.stress(loads, supports=held, stiffness=area).compliance

    frames = [frame(k, loads, supports=held, radius=p * length) for p in RADII]
    ratio = np.array([f.compliance / truss(p) for f, p in zip(frames, RADII, strict=True)])
    body = np.array([solid(k, p * length, loads[top], fineness) / truss(p) for p in solids])
    if out:
        picture(k, ratio, dict(zip(solids, body, strict=True)), f"{out}.png")
    gap = 1.0 - body / ratio[: len(body)]
    return {
        "order of the frame": np.log2((1.0 - ratio[-2]) / (1.0 - ratio[-1])),
        "energy in bending of the thinnest, over what it lacks": frames[-1].bending
        / (1.0 - ratio[-1]),
        **{f"frame over truss, r = {p:g} L": r for p, r in zip(RADII, ratio, strict=True)},
        **{f"solid over truss, r = {p:g} L": r for p, r in zip(solids, body, strict=True)},
        "order of the solid": float(np.log2(gap[-2] / gap[-1])),
    }


def picture(
    k: il.cost.CornerSharing, ratio: np.ndarray, solids: dict[float, float], path: str
) -> None:
    """Structure and curves."""
    from matplotlib.figure import Figure

    image = il.cost.drawing.drawn(k, filled=True, view=(-60.0, 18.0), size=(800, 700)).image()
    figure = Figure(figsize=(12, 5), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.imshow(image)
    left.axis("off")
    right.semilogx(RADII, ratio, "o-", label="frame")
    right.semilogx(list(solids), list(solids.values()), "s--", label="solid")
    right.axhline(1.0, c="gray", ls=":", label="truss")
    right.set(xlabel="radius over length", ylabel="compliance over that of the truss")
    right.set_ylim(0, 1.1)
    right.legend()
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    for name, number in main(out="corner_sharing_frames").items():
        print(f"{name}: {number:.5g}")
