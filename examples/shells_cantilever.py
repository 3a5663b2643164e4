"""Figure 20 of Xu, Pan, Wang, Du and Lu: a cantilever of shells, each as stiff as it has to be.

Cells like Neovius' surface have one outer boundary; what varies from cell to cell is the position
of the nodes inside, which makes them stiffer along the axes or in shear, and the thickness of the
wall. Nine cells are homogenized. A beam of their stiffnesses is solved, and each cell becomes the
one with the least energy and mass under its stresses, until nothing changes. Then the shells are
built, with continuous normals from cell to cell, and the lattice itself is analysed on cut cells.
The number that is checked: its compliance over that of equal cells of the same mass. Equal cells
have the position in the middle.

The paper's beam is ``main((20, 10, 2))``, which takes minutes and some 7 GB of memory.

    python examples/shells_cantilever.py
"""

import warnings
from dataclasses import dataclass

import numpy as np

import ilattice as il
from ilattice.bspline.knots import uniform_knots

POSITIONS, DENSITIES = np.linspace(-0.3, 0.3, 5), np.linspace(0.18, 0.5, 17)


@dataclass(frozen=True)
class Menu:
    """Cells to choose from: all pairs of positions and densities."""

    positions: np.ndarray
    densities: np.ndarray
    stiffness: np.ndarray  # (options, 6, 6)
    thickness: np.ndarray


def menu(family: "il.shells.Family", cells: int) -> Menu:
    """Nine homogenized cells, and in between polynomials of the logarithms."""
    at, found = [], []
    for p in (-0.3, 0.0, 0.3):
        lattice = il.Lattice(family(p), through=il.macroshape.cell(), repeat=1)
        for density in (0.18, 0.3, 0.5):
            wall = lattice.offset(relative_density=density)
            C = il.homogenize.elastic(wall, cells, estimate=False).C
            at.append((p, np.log(density)))
            found.append(np.log([C[0, 0], C[0, 1], C[3, 3], wall.thickness.extremes[0]]))
    weights = np.linalg.solve(_terms(np.array(at)), np.array(found))
    p, density = (a.ravel() for a in np.meshgrid(POSITIONS, DENSITIES, indexing="ij"))
    values = np.exp(_terms(np.column_stack([p, np.log(density)])) @ weights)
    C = np.zeros((len(p), 6, 6))
    C[:, :3, :3] = values[:, 1, None, None]
    C[:, range(3), range(3)], C[:, range(3, 6), range(3, 6)] = values[:, :1], values[:, 2:3]
    return Menu(p, density, C, values[:, 3] / 2.0)


def _terms(x: np.ndarray) -> np.ndarray:
    """Products of powers up to two."""
    p, q = (x[:, k, None] ** np.arange(3) for k in (0, 1))
    return (p[:, :, None] * q[:, None, :]).reshape(len(x), 9)


def chosen(
    options: Menu, repeat: tuple[int, int, int], density: float, rounds: int, halved: bool
) -> np.ndarray:
    """The option of each cell, for the least compliance at a mean density."""
    cells = np.indices(repeat).reshape(3, -1).T
    inside = 0.5 + 0.2887 * (2.0 * np.indices((2, 2, 2)).reshape(3, -1).T - 1.0)  # Gauss points
    points = cells[:, None, :] + inside
    softness = np.linalg.inv(options.stiffness)
    pick = np.full(len(cells), np.abs(options.densities - density).argmin())
    for _ in range(rounds):
        now = options.stiffness[pick]
        place = lambda x, now=now: now[np.ravel_multi_index(  # noqa: E731
            tuple(np.clip(x.astype(int), 0, np.array(repeat) - 1).T), repeat)]  # fmt: skip
        solution = loaded(
            il.cutfem.Elasticity(
                lambda u: -np.ones(len(u)), repeat, stiffness=place, degree=2,
                domain=[(0, 0, 0), repeat],
            ),
            halved,
        )  # fmt: skip
        stress = solution.stress(points.reshape(-1, 3)).reshape(len(cells), 8, 6)
        moments = np.einsum("cgi,cgj->cij", stress, stress) / 8.0
        energy = np.einsum("cij,oij->co", moments, softness)
        low, high = 1e-12 * energy.max(), 1e3 * energy.max()
        for _ in range(60):  # the price of mass
            price = np.sqrt(low * high)
            pick = (energy + price * options.densities).argmin(axis=1)
            heavy = options.densities[pick].mean() > density
            low, high = (price, high) if heavy else (low, price)
    return pick


def smooth(values: np.ndarray) -> il.BSpline:
    """Half-thickness over the beam: a quadratic spline with a coefficient per cell, equal in z."""
    c = np.repeat(values.mean(axis=2, keepdims=True), 3, axis=2)
    return il.BSpline([uniform_knots(n - 2, 2) for n in c.shape], c, 2)


def loaded(problem: il.cutfem.Elasticity, halved: bool) -> il.cutfem.Solution:
    """Held at one end, with a force of 1 on the other; of the lower half of the beam."""
    if halved:
        problem = problem.clamp("w=1", components="n")
    force = (0.0, -0.5 if halved else -1.0, 0.0)
    return problem.clamp("u=0").load(force=force, on="u=1").solve(tol=1e-6)


def built(
    family: "il.shells.Family", options: Menu, pick: np.ndarray, repeat: tuple[int, int, int]
) -> il.Wall:
    """The wall of the chosen cells."""
    graded = family.graded(options.positions[pick].reshape(repeat))
    beam = il.macroshape.box(repeat)
    lattice = il.Lattice(graded, through=beam, repeat=repeat, spans_per_tile=8)
    return lattice.offset(smooth(options.thickness[pick].reshape(repeat)))


def main(
    repeat: tuple[int, int, int] = (10, 5, 1), density: float = 0.3, rounds: int = 8,
    per_tile: int = 4, cells: int = 8, n: int = 16, h: float = 0.07, out: str = "",
) -> dict[str, float]:  # fmt: skip
    """Design, build and analyse; write ``OUT.stl`` and ``OUT.png`` if `out` is given."""
    family = il.shells.family("topo_1_rrr", outer=(0.2, 1.5), n=n, layer=0.03, spans=28)
    halved = repeat[2] % 2 == 0  # cells are symmetric: z is a plane of symmetry between them
    part = (*repeat[:2], repeat[2] // 2) if halved else repeat
    size = float(np.prod(part))
    with warnings.catch_warnings():  # both beams are cut with as many cells per tile
        warnings.simplefilter("ignore", il.errors.PrecisionWarning)
        options = menu(family, cells)
        pick = chosen(options, part, density, rounds, halved)
        wall = built(family, options, pick, part)
        volume = wall.volume()
        equal = il.Lattice(
            family(0.0), through=il.macroshape.box(part), repeat=part, spans_per_tile=8
        ).offset(relative_density=volume / size)
        grid = tuple(per_tile * k for k in part)
        works = [loaded(il.cutfem.Elasticity(w, grid), halved).compliance for w in (wall, equal)]
        if halved:
            both = np.concatenate([pick.reshape(part), pick.reshape(part)[:, :, ::-1]], axis=2)
            wall = built(family, options, both.ravel(), repeat)
        mesh = wall.mesh(h=h)
    if out:
        mesh.save(f"{out}.stl")
        _picture(options, pick, part, mesh, f"{out}.png")
    return {
        "compliance over that of equal cells": works[0] / works[1],
        "relative density": volume / size,
        "least density of a cell": options.densities[pick].min(),
        "largest": options.densities[pick].max(),
        "different positions": float(len(np.unique(options.positions[pick]))),
        "closed": float(mesh.is_watertight),
    }


def _picture(
    options: Menu, pick: np.ndarray, repeat: tuple[int, int, int], mesh: "il.SurfaceMesh", path: str
) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 9), layout="constrained")
    upper, lower = figure.subplots(2, 1, height_ratios=(1, 1.35))
    C = options.stiffness[pick]
    young = 1.0 / np.linalg.inv(C)[:, 0, 0]
    shown = upper.imshow(
        young.reshape(repeat)[:, :, 0].T, origin="lower", extent=(0, repeat[0], 0, repeat[1])
    )
    figure.colorbar(shown, label="Young's modulus along the axes, of a solid of 1", shrink=0.9)
    upper.set(xlabel="x", ylabel="y", title="held at the left, pulled down at the right")
    lower.imshow(il.plot.Scene(view=(-65.0, 22.0), size=(1600, 1000)).add(mesh).image())
    lower.set_axis_off()
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    for name, number in main(out="shells_cantilever").items():
        print(f"{name}: {number:.4g}")
