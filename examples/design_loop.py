"""A closed loop of design and analysis: walls grow where stress is high, until stiff enough.

An arch of Schwarz-P tiles, held at both feet, bears a load on its back. The half-thickness starts
as one number and becomes a spline: after every analysis it grows, box by box, with the root of the
recovered stress, so far that the energies of all boxes predict the compliance that is asked for.
The number that is checked: within three rounds it is met to 1 %. Distances to the mid-surface are
computed once, for the first wall: the count of closest-point queries stays as it is. Four cells
per tile keep the loop short, and are coarse: ``compliance too low by about`` says by how much, by
estimate; take twice as many for the last round of a design.

    python examples/design_loop.py
"""

import numpy as np
from scipy.optimize import brentq

import ilattice as il
from ilattice.bspline.knots import uniform_knots

BOXES = (11, 3, 3)  # of the domain, with a coefficient of the half-thickness each


def thickness(c: np.ndarray) -> il.BSpline:
    """Half-thickness over the domain: a quadratic spline with a coefficient per box."""
    return il.BSpline([uniform_knots(n - 2, 2) for n in c.shape], c, 2)


def solve(wall: il.Wall, cells: tuple[int, int, int]) -> il.cutfem.Solution:
    """The arch under a load of 1, whatever the area of its back."""
    problem = il.cutfem.Elasticity(wall, cells, poisson=0.3).clamp("u=0").clamp("u=1")
    area = problem.domain.boundary("w=1").integrate()
    return problem.load(traction=(0.0, -1.0 / area, 0.0), on="w=1").solve()


def energies(solution: il.cutfem.Solution) -> tuple[np.ndarray, np.ndarray]:
    """Squared recovered stress, integrated over the solid in each box, and the volume there."""
    rule = solution.problem.domain.solid(solution.problem.assembly)
    stress = solution.recovered().von_mises(rule.parameters)
    at = np.minimum(rule.parameters * BOXES, np.array(BOXES) - 1).astype(int)
    flat = np.ravel_multi_index(tuple(at.T), BOXES)
    sums = [np.bincount(flat, rule.weights * v, np.prod(BOXES)) for v in (stress**2, stress**0)]
    return sums[0].reshape(BOXES), sums[1].reshape(BOXES)


def better(
    c: np.ndarray, solution: il.cutfem.Solution, target: float, limits: tuple[float, float]
) -> np.ndarray:
    """Coefficients for which the compliance should be the target, if forces stay where they are."""
    energy, volume = energies(solution)
    stress = np.sqrt(energy / volume)

    def grown(allowed: float) -> np.ndarray:
        return np.clip(c * np.sqrt(stress / allowed), *limits)

    def excess(allowed: float) -> float:
        share = (energy * c / grown(allowed)).sum() / energy.sum()
        return float(share * solution.compliance - target)

    ends = (c**2 * stress).min() / limits[1] ** 2, (c**2 * stress).max() / limits[0] ** 2
    if excess(ends[0]) > 0:
        raise il.errors.InputError(f"no thickness up to {limits[1]} reaches target={target}")
    return grown(brentq(excess, *ends))


def main(
    d: float = 0.15,
    most: float = 0.33,
    part: float = 0.65,
    tiles: tuple[int, int, int] = (11, 1, 1),
    cells: tuple[int, int, int] = (44, 4, 4),
    h: float = 0.05,
    out: str = "",
) -> dict[str, float]:
    """Lower the compliance to a part of what it is; write ``OUT_*.png`` if `out` is given."""
    arch = il.macroshape.cylinder_shell(3.0, 4.0, height=1.0, angle=np.pi)
    lattice = il.Lattice("schwarz_p", through=arch, repeat=tiles, spans_per_tile=12)
    c = np.full(BOXES, d)
    first = solution = solve(lattice.offset(thickness(c)), cells)
    target, queries = part * first.compliance, lattice.statistics.queries
    rounds = 0
    while abs(solution.compliance / target - 1.0) > 0.01 and rounds < 3:
        c = better(c, solution, target, (d, most))
        solution = solve(lattice.offset(thickness(c)), cells)
        rounds += 1
    if out:
        limit = float(np.quantile(first.recovered().surface(h).point_data["von_mises"], 0.99))
        for name, s in (("before", first), ("after", solution)):
            s.recovered().surface(h).screenshot(
                f"{out}_{name}.png", scalars="von_mises", cmap="turbo", clim=(0, limit),
                view=(-75.0, 60.0),
            )  # fmt: skip
    before, after = (s.problem.domain.volume.in_space().integrate() for s in (first, solution))
    return {
        "compliance before": first.compliance,
        "compliance asked for": target,
        "compliance": solution.compliance,
        "compliance too low by about": solution.report.discretization_error,
        "rounds": rounds,
        "material added": after / before - 1.0,
        "thickest": float(c.max()),
        "new distances": lattice.statistics.queries - queries,
    }


if __name__ == "__main__":
    for name, number in main(out="design_loop").items():
        print(f"{name}: {number:.4g}")
