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
    """Medians; with `out`, ``OUT_P-like.vtp`` ..., and all with histograms as ``OUT.png``."""
    numbers, shells = {}, {}
    for name, (topology, position, derivative) in SHELLS.items():
        curves = il.shells.boundary(topology, position, derivative)
        shells[name] = il.shells.surface(curves, n=n, layer=layer)
        numbers[f"{name}: median of |H|"] = shells[name].curvature_quantile()
        numbers[f"{name}: area"] = shells[name].area
        if out:
            whole(shells[name]).save(f"{out}_{name}.vtp")
    if out:
        _picture(shells, f"{out}.png")
    return numbers


def whole(shell: "il.shells.OctantSurface") -> "il.SurfaceMesh":
    """The eight octants of a shell that meets its mirrors, with mean curvatures."""
    vertices, faces = [], []
    for sides in np.ndindex(2, 2, 2):
        faces.append(shell.faces[:, :: (-1) ** sum(sides)] + len(shell.vertices) * len(faces))
        vertices.append(np.where(sides, 1.0 - shell.vertices, shell.vertices))
    mesh = il.SurfaceMesh(np.concatenate(vertices), np.concatenate(faces))
    return mesh.with_point_data(mean_curvature=np.tile(shell.mean_curvature, 8))


def _picture(shells: dict[str, "il.shells.OctantSurface"], path: str) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 6.4), layout="constrained")
    rows = figure.subplots(2, 3, height_ratios=(1.5, 1))
    for (upper, lower), (name, shell) in zip(rows.T, shells.items(), strict=True):
        scene = il.plot.Scene(size=(600, 500)).add(
            whole(shell), scalars="mean_curvature", label="mean curvature", clim=(0.0, 1.0)
        )
        upper.imshow(scene.image())
        upper.set_axis_off()
        upper.set_title(name)
        corners = shell.vertices[shell.faces]
        sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.bincount(shell.faces.ravel(), np.repeat(np.linalg.norm(sides, axis=1), 3))
        half = shell.curvature_quantile()
        lower.hist(
            np.maximum(shell.mean_curvature, 1e-4), weights=100.0 * area / area.sum(),
            bins=np.logspace(-4, 2, 25), color="steelblue",
        )  # fmt: skip
        lower.axvline(half, color="black", linewidth=1, label=f"half of the area: {half:.2g}")
        lower.set(xscale="log", xlabel="|H| times the edge of the cell")
        lower.legend(loc="upper right")
    rows[1, 0].set_ylabel("per cent of the area")
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    for name, number in main(out="shells_curvature").items():
        print(f"{name}: {number:.6g}")
