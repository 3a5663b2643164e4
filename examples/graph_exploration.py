"""Random trusses and shells, and their stiffness over density (paper figures 9 and 11).

Random graphs of three kinds are made voxels and homogenized; all are below the bound of Hashin and
Shtrikman. Rows go to tables that an interrupted exploration goes on with. The number is the largest
part of the bound that one of them reaches.

    python examples/graph_exploration.py
"""

import warnings

import numpy as np

import ilattice as il

KINDS = ("truss", "direct", "conjugate")
#: Densities that are written below the picture.
TICKS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)


def main(seeds: int | tuple[int, ...] = 40, cells: int = 40, out: str = "") -> dict[str, float]:
    """Parts of the bound that are reached; with `out`, tables and pictures."""
    numbers = {}
    found = {}
    for kind in KINDS:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", il.errors.PrecisionWarning)  # some do not hang together
            found[kind] = il.graph.explore(
                kind, seeds, thickness=(0.06, 0.12), cells=cells,
                table=f"{out}_{kind}.csv" if out else None,
            )  # fmt: skip
        rows = found[kind]
        part = rows["E"] / rows["E_most"]
        assert np.nanmax(part) < 1.0
        numbers[f"largest part of the bound, {kind}"] = float(np.nanmax(part))
    if out:
        _picture(found, f"{out}.png")
        many = [il.graph.random_graph("conjugate", s, thickness=0.06) for s in range(20)]
        il.graph.contact_sheet(_solved(many)).savefig(f"{out}_surfaces.png", dpi=110)
    return numbers


def _solved(graphs: list["il.graph.Graph"]) -> list["il.graph.Graph"]:
    """Those whose surfaces exist."""
    out = []
    for graph in graphs:
        try:
            graph.patches()
            out.append(graph)
        except il.errors.GraphError as e:
            print(f"{graph.name}: {e.rule[:90]}")
    return out[:15]


def _picture(found: dict[str, "il.homogenize.Rows"], path: str) -> None:
    from matplotlib.figure import Figure
    from matplotlib.ticker import FixedLocator, NullFormatter

    figure = Figure(figsize=(5.6, 4.4), layout="constrained")
    axes = figure.subplots()
    for kind, rows in found.items():
        axes.loglog(rows["density"], rows["E"], "o", ms=3, label=kind)
    density = np.concatenate([rows["density"] for rows in found.values()])
    most = np.concatenate([rows["E_most"] for rows in found.values()])
    order = np.argsort(density)
    axes.loglog(density[order], most[order], "k--", lw=1, label="Hashin-Shtrikman")
    axes.set(xlabel="relative density", ylabel="relative Young's modulus", ylim=(1e-4, 1))
    axes.xaxis.set(major_locator=FixedLocator(TICKS), major_formatter="{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.legend(frameon=False, fontsize="small")
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    for name, number in main(out="graph_exploration").items():
        print(f"{name:>38}  {number:.4g}")
