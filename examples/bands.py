"""Waves in a cell that repeats: heavy balls on thin struts, and the frequencies they stop.

Balls move on the springs that struts are: three translations and three rotations make six bands,
and the waves of struts and of the balls' own shapes come much later. In between nothing goes
through, in any direction (compare Figure 12 of the paper on procedural lattices). The number that
is checked: the width of that gap, as a part of the frequency in its middle.

    python examples/bands.py
"""

import warnings

import ilattice as il


def balls_on_struts(radius: float, strut: float) -> il.fields.Node:
    """One ball, and struts through the faces of a unit cell."""
    ball = il.fields.translate(il.fields.sphere(radius), (0.5, 0.5, 0.5))
    rods = [
        il.fields.equation(f"sqrt(({a} - 0.5)^2 + ({b} - 0.5)^2) - {strut}")
        for a, b in ("yz", "xz", "xy")
    ]
    return il.fields.union(ball, *rods)


def main(cells: int = 7, steps: int = 2, out: str = "") -> dict[str, float]:
    """The gap, and the speed of long waves; with `out`, the dispersion plot and a wave."""
    solid = balls_on_struts(0.4, 0.12)
    with warnings.catch_warnings():  # that the cells are coarse, which `errors` say
        warnings.simplefilter("ignore", il.errors.PrecisionWarning)
        bands = il.homogenize.bloch(
            solid, cells, path="GXMRG", count=8, steps=steps, tol=1e-3, modes=bool(out)
        )
    gap = max(bands.gaps, key=lambda g: g.width)
    if out:
        bands.plot().savefig(f"{out}.png", dpi=150)
        bands.save(f"{out}.csv")
        bands.mode(int(bands.corners[1]), 0).plot(
            on="solid", off_screen=True, screenshot=f"{out}_wave.png"
        )
    return {
        "bands below the gap": gap.below,
        "gap from, in omega a / (2 pi c_T)": float(bands.normalised[:, gap.below - 1].max()),
        "gap to": float(bands.normalised[:, gap.below].min()),
        "estimated error of the eighth band": float(bands.errors[-1]),
        "width of the gap": gap.width,
    }


if __name__ == "__main__":
    for name, number in main(steps=10, out="bands").items():
        print(f"{name}: {number:.5g}")
