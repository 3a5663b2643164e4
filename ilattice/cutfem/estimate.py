"""How wrong a solution is: the energy of the difference between its stress and the recovered one.

::

    estimate = solution.error_estimate()
    print(f"{estimate.relative:.1%} in the energy norm")

Source: Zienkiewicz and Zhu, 1987, with the recovery of `recovery`; the effectivity index, the
estimate divided by the true error, tends to one where the recovered stress converges faster than
the other, which it does for smooth solutions on uniform grids.

Guarantee: what is measured is the whole solid, cut cells included, with positive weights.
Non-guarantees: it is an estimate, and no bound. Errors of the geometry, of the stabilization and of
weakly imposed supports are not in it. In walls of one or two cells splines can follow the
error itself, so that a third of it may be missing; degree 3 is off by a factor of two on grids that
are coarse for it. With smoothness 0 errors are smaller than those of what is recovered there, and
the estimate is a fifth too large.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ilattice._progress import Progress
from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import Frozen, as_points, read_only
from ilattice.cutfem.output import Result, save_cells
from ilattice.cutfem.pointwise import FluxOn
from ilattice.cutfem.recovery import smooth_flux, smoothest, values_on
from ilattice.cutfem.shapes import shape_of
from ilattice.plot.quick import show
from ilattice.quadrature.rules import Quadrature

if TYPE_CHECKING:
    from os import PathLike

#: Takes a rule in space and a flux at its points; returns twice its energy.
SquaredNorm = Callable[[Quadrature, FloatArray], float]
#: Weights of jumps per degree, ten times those of recovered stresses: a field that is smoother is
#: less accurate, but hides less of the error. Measured on a ball, a thick shell and a lattice.
WEIGHTS = {1: 1e-1, 2: 1e-2, 3: 3e-3}


@dataclass(frozen=True, eq=False, repr=False)
class ErrorEstimate(Frozen):
    """Estimated error in the energy norm: made by `Solution.error_estimate`.

    The energy norm of a displacement is the root of twice its strain energy; that of a temperature
    the root of the integral of conductivity times its gradient squared.

    Attributes
    ----------
    solution : Solution, HeatSolution or FieldSolution
        What is estimated.
    squares : ndarray, shape (cells,)
        Squared error of each active cell, those of ``problem.assembly.space.cells``.
    volumes : ndarray, shape (cells,)
        Volume of the solid in each of them.
    norm : float
        Energy norm of the solution.
    """

    solution: Result
    squares: FloatArray
    volumes: FloatArray
    norm: float

    def __repr__(self) -> str:
        return f"ErrorEstimate({self.relative:.2%} in the energy norm)"

    @cached_property
    def total(self) -> float:
        """Error in the energy norm."""
        return float(np.sqrt(self.squares.sum()))

    @property
    def relative(self) -> float:
        """Error over the norm of the exact solution, of which the square is the sum of both."""
        return self.total / max(float(np.hypot(self.norm, self.total)), 1e-300)

    @property
    def energy(self) -> float:
        """By how much the energy is too low: half the squared error.

        That is so where supports are at rest and nothing is heated. The compliance is too low by
        twice as much. Add it to get a better value, or to know how many digits to believe.
        """
        return 0.5 * self.total**2

    def density(self, u: ArrayLike) -> FloatArray:
        """Root mean square, over the cell, of the error of which `squares` is the integral.

        Parameters
        ----------
        u : array_like, shape (n, 3)
            Parameters.

        Returns
        -------
        ndarray, shape (n,)
            Constant in each cell; NaN where no active cell is near.
        """
        at = self.solution.problem.assembly.space.locate(as_points("u", u))
        root = np.sqrt(self.squares / self.volumes)
        return np.where(at < 0, np.nan, root[at])

    def plot(self, **options: Any) -> Any:
        """Show where the error is, on the solid, in a window or a notebook.

        Parameters
        ----------
        **options
            Of `ilattice.plot.show`, such as ``clip``, ``view`` or ``screenshot``.

        Returns
        -------
        object
            What pyvista returns.
        """
        grid = self.solution.to_pyvista("solid")
        shape = shape_of(self.solution.problem, "solid", None)
        grid.point_data["error_density"] = self.density(shape.u)
        usual = {"scalars": "error_density", "cmap": "YlOrRd", "title": repr(self)}
        return show(grid, **{**usual, **options})

    def save(self, path: "str | PathLike[str]") -> None:
        """Write the active cells with errors, solution and level sets.

        Parameters
        ----------
        path : path-like
            File ending in ``.vtu``.

        Raises
        ------
        FormatError
            Another ending, or the file cannot be written.
        """
        home = self.solution.problem.assembly.space.homes[1]
        squares, volumes = np.bincount(home, self.squares), np.bincount(home, self.volumes)
        errors = {"error": np.sqrt(squares), "error_density": np.sqrt(squares / volumes)}
        save_cells(self.solution, path, 0.0, errors)


def error_of(
    solution: Result, flux_on: FluxOn, squared_norm: SquaredNorm, progress: Progress = None
) -> ErrorEstimate:
    """See `Solved.error_estimate`."""
    problem = solution.problem
    asm = problem.assembly
    rule = problem.domain.solid(asm)
    assert rule.parameters is not None
    raw = flux_on(rule)
    c = smooth_flux(problem, flux_on, WEIGHTS, progress)
    gap = values_on(smoothest(problem), c, rule) - raw
    density = problem._stored(gap, rule.parameters, asm.owners(rule))
    return _estimate(solution, rule, density, np.sqrt(squared_norm(rule, raw)))


def _estimate(
    solution: Result, rule: Quadrature, density: FloatArray, norm: float
) -> ErrorEstimate:
    """Sums per active cell of a squared error at the points of a rule in space."""
    cells = solution.problem.assembly.space.cells
    at = np.searchsorted(cells, rule.cells)[rule.owners]
    sums = np.zeros((2, len(cells)))
    np.add.at(sums[0], at, rule.weights * density)
    np.add.at(sums[1], at, rule.weights)
    return ErrorEstimate(solution, read_only(sums[0]), read_only(sums[1]), float(norm))
