"""A map of Young's modulus and Poisson's ratio: all cells of the catalogue at one density.

Sheets `|f| < c` and solids `f < c` of all tiles in a cubic cell, with the level c at which three
tenths of the cell are filled; moduli are those of the nearest isotropic tensor, and no cell can be
above the curve of Hashin and Shtrikman (compare Figure 12 of the paper on procedural lattices).
Stiffnesses come from above: thin sheets that the grid does not resolve seem to be beyond the curve,
and are drawn hollow. The number that is checked: the part of the bound that the bulk modulus of the
gyroid takes.

About two minutes on two cores, for all of them.

    python examples/young_poisson_map.py
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np

import ilattice as il

SOLIDS = ("struts", "plates", "honeycomb", "octet", "kelvin", "cuboctahedron", "kagome", "chiral")


def filled(name: str, part: float) -> Callable[[np.ndarray], np.ndarray]:
    """The sheet or the solid of a tile that fills a part of the cell."""
    tile = il.tiles[name]
    values = tile(np.random.default_rng(0).random((200_000, 3)))
    if any(word in name for word in SOLIDS):
        c = np.quantile(values, part)
        return lambda u: tile(u % 1.0) - c
    c = float(np.quantile(np.abs(values), part))
    if tile.node.polynomial is not None:  # a formula, whose kinks are known
        return il.fields.shell(tile.node, 2.0 * c)
    return lambda u: np.abs(tile(u % 1.0)) - c


def most(density: float, nu: np.ndarray) -> np.ndarray:
    """Largest Young's moduli that Hashin and Shtrikman allow, of a solid with E = 1, ν = 0.3."""
    (_, K), (_, G) = (
        il.homogenize.bounds.elastic_bounds(
            np.array([density, 1 - density]), np.array([1 / 1.2, 0.0]), np.array([1 / 2.6, 0.0])
        )[k]
        for k in (0, 1)
    )
    return np.minimum(3 * K * (1 - 2 * nu), 2 * G * (1 + nu))


def main(
    names: Sequence[str] = (), cells: int = 8, density: float = 0.3, out: str = "",
    executor: Executor | None = None,
) -> dict[str, float]:  # fmt: skip
    """Parts of the bound; with `out`, the map and its table."""
    cubic = [n for n in il.tiles if np.allclose(il.tiles[n].cell, np.eye(3))]
    cubic.sort(key=lambda n: n != "gyroid")
    with warnings.catch_warnings():  # that cells are coarse, and some do not go on everywhere
        warnings.simplefilter("ignore", il.errors.PrecisionWarning)
        rows = il.homogenize.sweep(
            filled, name=list(names) or cubic, part=density, cells=cells,
            options={"estimate": False, "tol": 1e-5}, table=f"{out}.csv" if out else None,
            executor=executor,
        )  # fmt: skip
    there = [r for r in rows if r["percolates"] == "uvw"]
    if out:
        _draw(there, density).savefig(f"{out}.png", dpi=150)
    return {
        "cells that bear in all directions": len(there),
        "largest Young's modulus": max(r["E"] for r in there),
        "least Poisson's ratio": min(r["nu"] for r in there),
        "cells beyond the bounds, not resolved": sum(not _resolved(r) for r in there),
        "bulk modulus of the first, part of its bound": there[0]["K"] / there[0]["K_most"],
    }


def _resolved(row: Mapping[str, float]) -> bool:
    return row["K"] < row["K_most"] and row["G"] < row["G_most"]


def _draw(rows: list, density: float) -> object:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.8), layout="constrained")
    axes = figure.subplots()
    nu = np.linspace(min(-0.1, min(r["nu"] for r in rows)), 0.5, 200)
    axes.plot(nu, most(density, nu), "k--", lw=1, label="Hashin and Shtrikman")
    for kind, mark in (("sheets", "o"), ("solids", "s")):
        mine = [r for r in rows if any(w in r["name"] for w in SOLIDS) == (kind == "solids")]
        for seen, color in ((True, None), (False, "none")):
            some = [r for r in mine if _resolved(r) == seen]
            label = kind if seen else f"{kind}, not resolved"
            at = ([r["nu"] for r in some], [r["E"] for r in some])
            axes.plot(*at, mark, ms=4, mfc=color, label=label)
    for r in rows:
        at = (r["nu"], r["E"])
        axes.annotate(r["name"], at, (3, 2), textcoords="offset points", fontsize=4.5)
    axes.set_xlabel("Poisson's ratio of the nearest isotropic material")
    axes.set_ylabel("its Young's modulus, that of the solid being 1")
    axes.legend(frameon=False, fontsize="small")
    return figure


if __name__ == "__main__":
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as two:
        numbers = main(out="young_poisson_map", executor=two)
    for name, number in numbers.items():
        print(f"{name}: {number:.5g}")
