"""Figure 21 of Sitharam, Youngquist, Nolan and Peters: how structures with defects break.

A plane structure, made irregular by random flips that prefer edges of equal lengths, with more bars
than it needs and some weak edges, is pulled until nothing holds any more: edges break one after the
other, where force over strength is largest. The number that is checked: what is left of the
stiffness in the end; and the largest load, with and without defects.

    python examples/corner_sharing_fracture.py
"""

from typing import Any

import numpy as np

import ilattice as il
from ilattice.cost import flips, stiffening
from ilattice.cost.fracture import Fracture, fracture


def specimen(n: int, seed: int) -> il.cost.CornerSharing:
    """A rectangle with self-stresses, of which lengths are a little irregular."""
    x = np.stack(np.meshgrid(np.arange(n + 1.0), np.arange(n + 1.0)), -1)
    x[1::2, :, 0] += 0.5
    number = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    rows = []
    for i, j in np.ndindex(n, n):
        a, b, c, d = number[i, j], number[i, j + 1], number[i + 1, j], number[i + 1, j + 1]
        rows += [[a, b, c], [b, d, c]] if i % 2 == 0 else [[a, b, d], [a, d, c]]
    k = il.cost.midpoint(x.reshape(-1, 2) * (1.0, np.sqrt(0.75)), np.array(rows))
    k = flips.randomised(
        k, 20 * len(k.simplices), seed=seed, target=lambda e: (e - 1.0) ** 2, temperature=0.05
    )
    k = k.stiffened()
    near = stiffening.candidates(k, np.arange(len(k.positions)), 1.6 * k.lengths.mean(), k.bars)
    return k.with_bars(near[::3])


def main(n: int = 8, weak: float = 0.15, seed: int = 1, out: str = "") -> dict[str, float]:
    """Loads and edges that break, without and with defects; with `out`, a picture of both."""
    k = specimen(n, seed)
    x = k.positions
    held, top = x[:, 1] < 1e-9, x[:, 1] > x[:, 1].max() - 1e-9
    pull = np.zeros_like(x)
    pull[top, 1] = 1.0 / top.sum()
    rng = np.random.default_rng(seed)
    strength = np.where(rng.random(len(k.edges)) < weak, 0.3, 1.0)
    runs = {
        title: fracture(k, pull, supports=held, strength=s, steps=200)
        for title, s in (("no defects", np.ones(len(k.edges))), ("defects", strength))
    }
    if out:
        picture(runs, strength, f"{out}.png")
    whole, defects = runs.values()
    first, *_, least = defects.load / defects.displacement
    return {
        "stiffness in the end, over that at first": least / first,
        "collapsed": float(whole.collapsed and defects.collapsed),
        "edges that break": len(defects.broken),
        "largest load": defects.load.max(),
        "largest load without defects": whole.load.max(),
    }


def picture(runs: dict[str, Fracture], strength: np.ndarray, path: str) -> None:
    """Where edges break, numbered, and loads over displacements."""
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure

    def lines(axes: Any, ends: np.ndarray, color: str, width: float, label: str) -> None:
        axes.add_collection(LineCollection(list(ends), colors=color, lw=width, label=label))

    figure = Figure(figsize=(12, 5.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    found = runs["defects"]
    k = found.structure
    ends = k.positions[k.edges]
    lines(left, ends, "#bbbbbb", 1.0, "edges")
    lines(left, ends[strength < 1.0], "#4477aa", 1.5, "weak ones")
    order = LineCollection(list(ends[found.broken]), cmap="autumn", lw=3.0)
    order.set_array(np.arange(1, len(found.broken) + 1))
    left.add_collection(order)
    figure.colorbar(order, ax=left, label="broken, in this order", shrink=0.6)
    left.autoscale()
    left.set(aspect="equal", title="fracture path")
    left.axis("off")
    left.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=2, frameon=False)
    for title, run in runs.items():
        right.plot(np.append(0, run.displacement), np.append(0, run.load), "o-", ms=3, label=title)
    right.set(xlabel="displacement", ylabel="load", title="states in which an edge breaks")
    right.legend()
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    for name, number in main(out="corner_sharing_fracture").items():
        print(f"{name}: {number:.5g}")
