"""Cut cells and voxels of equal geometry, extrapolated: ``python -m benchmarks.routes [names]``.

Ten cells of struts that are joined sharply, and ten sheets. Errors of the stiffness fall with
`SHARP` where edges turn inwards: twice the exponent of the displacement at a notch of 90 degrees
(Williams, 1952), which the struts have, more or less; how much the limits depend on it is printed,
too. Sheets have the orders of the spaces. Parts of voxels are from distances, to which a number is
added so that the density is that of the cut cells.

Fewer cells of struts than those here are no help: 12 per direction, where what falls faster still
counts, put the limit of C44 of three crossing bars 2.5 % below that of tetrahedra that fit the
edges.
"""

import itertools
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import ilattice as il
from ilattice._geometry import grid_points
from ilattice.homogenize import elastic, voxels

#: Orders in struts: the one that counts, and the limits of what it may be.
SHARP = (1.09, 1.0, 1.2)
#: Orders in sheets, of cut cells of degree 2 and of voxels.
SMOOTH = (3.5, 2.0)
#: Cells and voxels per direction: of struts, of sheets, and of those that need more.
GRIDS = {
    "struts": ((16, 24, 32), (48, 64, 96)),
    "sheets": ((10, 14, 18), (40, 60, 80)),
    "frd": ((18, 22, 28), (48, 64, 96)),
    "y": ((24, 30, 36), (64, 96, 128)),
    "octet": ((24, 32, 40), (64, 96, 128)),
}
PARTS = 2 * np.array(list(np.ndindex(2, 2, 2))) - 1

CORNERS = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
FCC = [(0, 0, 0), (0, 0.5, 0.5), (0.5, 0, 0.5), (0.5, 0.5, 0)]
AXES = [(1, 0, 0), (0, 1, 0), (0, 0, 1)]


def near(nodes: Sequence[Any], length: float) -> list[Any]:
    """Struts between nodes, and their copies, that are as far from each other."""
    out = []
    for p, s, q in itertools.product(nodes, itertools.product((-1, 0, 1), repeat=3), nodes):
        end = np.array(q) + s
        if abs(np.linalg.norm(end - p) - length) < 1e-9:
            out.append([p, tuple(end)])
    return out


def star(at: Any, ways: Sequence[Any]) -> list[Any]:
    """Struts from a node to its copies."""
    return [[at, tuple(np.array(at) + w)] for w in ways]


KELVIN = [
    tuple(np.roll((0, 0.5, z), a)) for a in range(3) for z in (0.25, 0.75)
] + [tuple(np.roll((0, z, 0.5), a)) for a in range(3) for z in (0.25, 0.75)]  # fmt: skip
MIDDLE = [[(0.5, 0.5, 0.5), c] for c in CORNERS]
DIAMOND = FCC + [tuple(np.array(p) + 0.25) for p in FCC]
STRUTS = {
    "sc": (star((0.5, 0.5, 0.5), AXES), 0.15),
    "bcc": (MIDDLE, 0.12),
    "bccz": (MIDDLE + star((0, 0, 0), AXES[2:]), 0.1),
    "octet": (near(FCC, 2**-0.5), 0.08),
    "diamond struts": (near(DIAMOND, 3**0.5 / 4), 0.1),
    "kelvin": (near(KELVIN, 8**-0.5), 0.08),
    "sc and bcc": (MIDDLE + star((0.5, 0.5, 0.5), AXES), 0.09),
    "sc and dual": (star((0.5, 0.5, 0.5), AXES) + star((0.1, 0.0, 0.2), AXES)
                    + [[(0.5, 0.5, 0.5), (0.1, 0.0, 0.2)]], 0.1),
    "skew": (star((0.3, 0.6, 0.2), [(1, 0, 0), (1, 1, 0), (0, 1, 1)]), 0.14),
    "planar": (star((0.4, 0.5, 0.5), AXES) + star((0.4, 0.5, 0.5), [(1, 1, 0), (1, -1, 0)]), 0.12),
}  # fmt: skip
SHEETS = ("primitive", "gyroid", "diamond", "iwp", "neovius", "octo", "frd", "lidinoid", "s", "y")
#: About that of the sheets.
DENSITY = 0.35


def filled(distance: Callable[[Any], Any], n: int, density: float) -> Any:
    """Parts of n³ voxels that a solid fills, from distances in the middles of their eighths."""
    x, far = (np.arange(n) + 0.5) / n, np.zeros((8, n, n * n))
    for i in range(n):
        u = grid_points(x[i : i + 1], x, x)
        for k, s in enumerate(PARTS):
            far[k, i] = 0.5 - 2 * n * distance((u + 0.25 / n * s) % 1.0)
    low, high = -1.0, 1.0
    for _ in range(20):
        shift = 0.5 * (low + high)
        if np.mean(np.clip(far + shift, 0, 1)) < density:
            low = shift
        else:
            high = shift
    return np.rint(256 * np.clip(far + shift, 0, 1).mean(axis=0)).reshape(n, n, n) / 256


def limit(counts: Sequence[int], values: Any, order: float) -> Any:
    """Constants (k,) of least squares of ``c + a n^-order``."""
    A = np.stack([np.ones(len(counts)), np.array(counts, float) ** -order], axis=1)
    return np.linalg.lstsq(A, np.array(values), rcond=None)[0][0]


def numbers(eff: Any, density: float) -> Any:
    """Means of C11, C12, C44 over the axes at another density."""
    C = eff.C * density / eff.density
    return [np.mean(C[[0, 1, 2], [0, 1, 2]]), np.mean(C[[0, 0, 1], [1, 2, 2]]),
            np.mean(C[[3, 4, 5], [3, 4, 5]])]  # fmt: skip


def compared(name: str) -> None:
    """Print a line of the table."""
    start = time.process_time()
    counts, parts = GRIDS.get(name, GRIDS["struts" if name in STRUTS else "sheets"])
    if name in STRUTS:
        solid: Any = il.tiles.skeleton(STRUTS[name][0], radius=STRUTS[name][1], faces="periodic")
        distance, orders = solid, [(p, p) for p in SHARP]
    else:
        tile = il.tiles[name]
        values = np.abs(tile(np.random.default_rng(0).random((200_000, 3))))
        half = float(np.quantile(values, DENSITY))
        solid, orders = il.fields.shell(tile.node, 2.0 * half), [SMOOTH]

        def distance(u: Any) -> Any:
            f, slope = tile.jet(u, 1)
            steep = np.linalg.norm(slope, axis=1)
            return (np.abs(f) - half) / np.maximum(steep, np.quantile(steep, 0.02))

    fine = [elastic(solid, n, estimate=False, tol=1e-6) for n in counts]
    density = fine[-1].density
    cut = [numbers(e, density) for e in fine]
    of = [voxels(filled(distance, n, density), young=(1e-6, 1.0), estimate=False) for n in parts]
    vox = [numbers(e, density) for e in of]
    ends = np.array([(limit(counts, cut, p), limit(parts, vox, q)) for p, q in orders])
    apart = np.abs(ends[:, 1] / ends[:, 0] - 1.0)
    last = 100 * np.abs(np.array(vox[-1]) / cut[-1] - 1)
    print(
        f"{name:14s} rho {density:.4f} cut {ends[0, 0].round(6)} voxels {ends[0, 1].round(6)} "
        f"apart {(100 * apart[0]).round(2)} %, at other orders {(100 * apart[1:]).round(2)}; "
        f"finest apart {last.round(1)}, {time.process_time() - start:.0f} s",
        flush=True,
    )


if __name__ == "__main__":
    warnings.simplefilter("ignore", il.errors.PrecisionWarning)
    for one in sys.argv[1:] or (*STRUTS, *SHEETS):
        compared(one)
