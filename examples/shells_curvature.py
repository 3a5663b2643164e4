"""Figure 15 of Xu, Pan, Wang, Du and Lu: mean curvatures of shells like P, I-WP and Neovius.

Next to the boundary, where shells are bent to meet their mirrors at right angles, mean curvature is
not zero; the median over the area is below 0.05 for a cell of edge 1 with a thin layer.

    python examples/shells_curvature.py
"""

import numpy as np

import ilattice as il

SHELLS = {
    "P-like": ("topo_19_rrr", 0.0, 1.7),
    "IWP-like": ("topo_18_rrr", 0.6, 3.0),
    "N-like": ("topo_1_rrr", (0.2, 0.2, 0.0), 1.5),
}


def main(n: int = 32, layer: float = 0.01, out: str = "") -> dict[str, float]:
    """Medians; with `out`, meshes with curvatures as ``OUT_P-like.vtp`` ... and histograms."""
    numbers, shells = {}, {}
    for name, (topology, position, derivative) in SHELLS.items():
        curves = il.shells.boundary(topology, position, derivative)
        shells[name] = il.shells.surface(curves, n=n, layer=layer)
        numbers[f"{name}: median of |H|"] = shells[name].curvature_quantile()
        numbers[f"{name}: area"] = shells[name].area
        if out:
            h = shells[name].mean_curvature
            shells[name].mesh.with_point_data(mean_curvature=h).save(f"{out}_{name}.vtp")
    if out:
        _picture(shells, f"{out}.png")
    return numbers


def _picture(shells: dict[str, "il.shells.OctantSurface"], path: str) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3), layout="constrained")
    for axes, (name, shell) in zip(figure.subplots(1, 3, sharey=True), shells.items(), strict=True):
        axes.hist(np.minimum(shell.mean_curvature, 6.0), bins=40, color="steelblue")
        axes.set(title=name, xlabel="|H|, at most 6")
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    for name, number in main(out="shells_curvature").items():
        print(f"{name}: {number:.6g}")
