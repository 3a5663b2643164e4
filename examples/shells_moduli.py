"""Figure 12 of Xu, Pan, Wang, Du and Lu: stiffnesses of shells, and of sheets between level sets.

Shells like Schwarz P and Neovius at points of a Sobol sequence in ranges of their parameters, and
the sheets `c1 < f < c2` of the two formulas with all levels in between which their topology stays;
all have relative density 0.3. The numbers that are checked: areas of the convex hulls of both in
the plane of Young's modulus (along the axes) and Poisson's ratio. The curve of Hashin and Shtrikman
is for isotropic cells: those that are softer in shear may be above it along their axes, and coarse
cells of the analysis make all somewhat too stiff.

    python examples/shells_moduli.py
"""

import warnings

import numpy as np

import ilattice as il

KINDS = {
    "P": (
        "schwarz_p", "topo_19_rrr", {"position": (-0.6, 0.6), "derivative": (0.5, 3.5)},
    ),
    "N": (
        "neovius", "topo_1_rrr",
        {
            "position_1": (-0.4, 0.4), "position_2": (-0.4, 0.4), "position_3": (-0.2, 0.2),
            "derivative": (1.0, 1.8),
        },
    ),
}  # fmt: skip


def sheets(name: str, density: float, count: int, cells: int) -> np.ndarray:
    """Young's modulus and Poisson's ratio of sheets between two level sets, shape (m, 2)."""
    tile, rows = il.tiles[name], []
    values = tile(np.random.default_rng(0).random((200_000, 3)))
    saddles = tile([(0.0, 0.0, 0.5), (0.0, 0.5, 0.5)])
    ends = (values[:, None] < np.sort(saddles)).mean(axis=0)  # parts of the cell below both
    for least in np.linspace(ends[0], ends[1] - density, count):
        low, high = np.quantile(values, [least, least + density])
        eff = il.homogenize.elastic(
            (lambda u, most=high: tile(u % 1.0) - most, lambda u, least=low: least - tile(u % 1.0)),
            cells, domain=[(0, 0, 0), (1, 1, 1)], estimate=False,
        )  # fmt: skip
        if all(eff.percolates):
            rows.append((eff.E((1, 0, 0)), eff.nu((1, 0, 0), (0, 1, 0))))
    return np.array(rows)


def most(density: float, nu: np.ndarray) -> np.ndarray:
    """Largest Young's moduli that Hashin and Shtrikman allow, of a solid with E = 1, ν = 0.3."""
    parts = np.array([density, 1.0 - density])
    bulk, shear = il.homogenize.bounds.elastic_bounds(
        parts, np.array([1 / 1.2, 0.0]), np.array([1 / 2.6, 0.0])
    )
    return np.minimum(3.0 * bulk[1] * (1.0 - 2.0 * nu), 2.0 * shear[1] * (1.0 + nu))


def main(
    count: int = 16,
    levels: int = 5,
    cells: int = 8,
    density: float = 0.3,
    seed: int = 0,
    out: str = "",
) -> dict[str, float]:
    """Areas of hulls; with `out`, the plane as ``OUT.png``."""
    numbers, drawn = {}, {}
    with warnings.catch_warnings():  # that cells are coarse
        warnings.simplefilter("ignore", il.errors.PrecisionWarning)
        for kind, (tile, shell, ranges) in KINDS.items():
            cloud = il.shells.cloud(
                shell, count, ranges=ranges, density=density, seed=seed, cells=cells
            )
            plain = sheets(tile, density, levels, cells)
            drawn[kind] = (np.column_stack([cloud.young, cloud.poisson]), plain)
            numbers[f"{kind}-like: shells"] = float(len(cloud.young))
            numbers[f"{kind}-like: area of the hull"] = cloud.hull_area
            numbers[f"{kind}: area of the hull"] = il.shells.hull_area(*plain.T)
    if out:
        _picture(drawn, density, f"{out}.png")
    return numbers


def _picture(drawn: dict[str, tuple[np.ndarray, np.ndarray]], density: float, path: str) -> None:
    from matplotlib.figure import Figure
    from scipy.spatial import ConvexHull

    figure = Figure(figsize=(6.4, 4.8), layout="constrained")
    axes = figure.subplots()
    ends = [np.concatenate([p[:, 1] for pair in drawn.values() for p in pair])]
    nu = np.linspace(ends[0].min() - 0.02, ends[0].max() + 0.02, 100)
    axes.plot(nu, most(density, nu), "k--", lw=1, label="Hashin and Shtrikman")
    for (kind, pair), color in zip(drawn.items(), ("tab:blue", "tab:orange"), strict=True):
        for points, mark, face, label in zip(
            pair, "os", (color, "none"), (f"{kind}-like shells", f"{kind}, level sets"), strict=True
        ):
            axes.plot(points[:, 1], points[:, 0], mark, color=color, mfc=face, ms=5, label=label)
            if len(points) > 2:
                hull = points[ConvexHull(points).vertices]
                axes.fill(hull[:, 1], hull[:, 0], color=color, alpha=0.12 if face == color else 0.3)
    axes.set_xlabel("Poisson's ratio along the axes")
    axes.set_ylabel("Young's modulus along the axes, that of the solid being 1")
    axes.legend(frameon=False, fontsize="small")
    figure.savefig(path, dpi=130)


if __name__ == "__main__":
    for name, number in main(out="shells_moduli").items():
        print(f"{name}: {number:.4g}")
