"""Smooth stresses and heat fluxes: projections on smooth splines.

Derivatives of a solution of degree p are an order less accurate than the solution, and worst at
its surface, in badly cut cells. Their projection on the splines of the same degree and of greatest
smoothness, with the least mean square over the solid, is smooth and defined up to the surface. On
uniform grids it is also more accurate: the error of the derivatives oscillates with the period of
the cells, and these splines are orthogonal to that. Sources: Zienkiewicz and Zhu, 1987, for the
recovery by projection; Burman, Ghost penalty, 2010, for the penalty on jumps, without which a cell
of which little is left would take any value.

Guarantees: stresses in the space of splines, so all that are linear in parameters, are reproduced,
through an affine map or any other; the condition number of the projection does not depend on how
cells are cut. Non-guarantees: where a material jumps, so does the stress, and the projection
overshoots there; at re-entrant edges it grows without bound under refinement, as the stress does.
"""

from dataclasses import replace

import numpy as np

from ilattice._progress import Progress, staged
from ilattice._typing import FloatArray
from ilattice.cutfem import _kernels_assembly as kernels
from ilattice.cutfem.assembly import Assembly
from ilattice.cutfem.domain import Domain
from ilattice.cutfem.pointwise import FluxOn, Pointwise
from ilattice.cutfem.stabilise import ghost_faces
from ilattice.linalg.solvers import Solver
from ilattice.quadrature.rules import Quadrature

#: Weights of the penalty on jumps per degree: the least that keep condition numbers, of diagonally
#: scaled masses, below 30, 400 and 1e5. Ten times as much triples errors where grids are coarse.
WEIGHTS = {1: 1e-2, 2: 1e-3, 3: 3e-4}
#: Relative residual of projections of stresses.
TOLERANCE = 1e-8


def smooth_flux(
    problem: Pointwise, flux_on: FluxOn, weights: dict[int, float], progress: Progress = None
) -> FloatArray:
    """Coefficients (functions, entries) of the projected flux, with weights of jumps per degree."""
    heated = any(load.kind == "temperature" for load in problem.loads)
    constant = problem.law.constant and not heated
    rule = problem.domain.stiff_rule(problem.assembly, constant=constant)
    work = {problem.flux_name: lambda: flux_on(rule)}
    return project(problem, rule, staged(work, progress)[0], weights, progress)


def smoothest(problem: Pointwise) -> Assembly:
    """Splines of greatest smoothness on the active cells: those that are recovered."""
    asm, greatest = problem.assembly, problem.domain.degree - 1
    if asm.space.smoothness == greatest:
        return asm
    return problem.domain.once(
        ("smoothest", asm), lambda: Assembly(replace(asm.space, smoothness=greatest), asm.through)
    )


def project(
    problem: Pointwise, rule: Quadrature, values: FloatArray, weights: dict[int, float],
    progress: Progress = None,
) -> FloatArray:  # fmt: skip
    """Smoothest splines that are closest to a field in the mean square over the solid.

    Parameters
    ----------
    problem : Pointwise
        Its domain keeps the factor of the matrix of masses, for other fields.
    rule : Quadrature
        On the active cells, in parameters.
    values : ndarray, shape (n, m)
        The field at its points.
    weights : dict of int to float
        Weight of the penalty on jumps per degree.
    progress : bool or callable, optional
        "masses" and "projection"; see `ilattice._progress.track`.

    Returns
    -------
    ndarray, shape (functions, m)
        Coefficients.
    """
    domain, weight = problem.domain, weights[problem.domain.degree]
    smooth = smoothest(problem)
    key = ("projection", smooth, rule, weight)
    (solver,) = staged(
        {"masses": lambda: domain.once(key, lambda: _masses(domain, smooth, rule, weight))},
        progress,
    )
    w = rule.weights * np.abs(np.linalg.det(smooth.jacobians(rule.points)))
    f = smooth.vector(rule, w[:, None] * values)
    out = np.zeros_like(f)
    some = f.any(axis=0)
    if some.any():
        work = {"projection": lambda: solver.solve(f[:, some], tol=TOLERANCE)[0]}
        out[:, some] = staged(work, progress)[0]
    return out


def values_on(asm: Assembly, c: FloatArray, rule: Quadrature) -> FloatArray:
    """Values (n, m) of splines at the points of a rule in the active cells."""
    out = np.empty((len(rule), c.shape[1]))
    for rows, value, _ in asm.on_rule(c, rule, in_space=False):
        out[rows] = value
    return out


def _masses(domain: Domain, smooth: Assembly, rule: Quadrature, weight: float) -> Solver:
    """Solver for the masses of functions, with a penalty on their jumps."""
    faces = ghost_faces(domain.status, domain.joints, smooth.space.cells, weight)
    asm = replace(smooth, ghost=faces)
    data = asm.zeros(1)
    asm.add_cells(data, rule, kernels.MASS, np.ones((1, 1)))
    asm.add_ghost(data, None)
    return Solver(asm.pattern.matrix(data), coordinates=smooth.coordinates)
