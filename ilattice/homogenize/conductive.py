"""Effective conductivity of a cell by splines on cut cells.

::

    eff = il.homogenize.conductive(cell, cells=16, conductivity=200.0)
    print(eff.k, eff.error)

The same as `elastic` with one unknown per node: three mean gradients are put on the cell. What
holds for heat holds for electricity, diffusion, permittivity and permeability, too.
"""

import time
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ilattice._progress import Progress
from ilattice._typing import FloatArray
from ilattice._validate import as_flag, read_only
from ilattice.cutfem.choosing import USUAL
from ilattice.cutfem.conduction import Conducting, as_matrices
from ilattice.cutfem.heat import Heat
from ilattice.homogenize import tensors
from ilattice.homogenize.arguments import as_cell, check_options, check_phases
from ilattice.homogenize.bounds import ConductivityBounds, conductive_bounds
from ilattice.homogenize.cell import Answer, CellProblem, spread
from ilattice.homogenize.conductivity import Conductivity
from ilattice.homogenize.periodic import FULL


@dataclass(frozen=True, eq=False, init=False, repr=False)
class ConductiveCell(CellProblem, Heat):
    """A conducting cell of a periodic solid, under mean gradients.

    Parameters
    ----------
    field, cells, **options : optional
        As in `conductive`.
    """

    loads_of_cells: ClassVar[FloatArray] = read_only(np.eye(3))

    def __init__(self, field: Any, cells: Any = 16, **options: Any) -> None:
        check_options(type(self).__name__, options, Heat.__init__)
        named = {k: options.pop(k, None) for k in ("domain", "through")}
        Heat.__init__(self, as_cell(field, cells, **named), **{"degree": USUAL, **options})
        check_phases(self.domain)

    def _scale(self) -> float:
        """See `CellProblem._scale`."""
        return float(np.trace(self.moment()) / 3.0 * self.cell_volume ** (-1 / 3))

    def _moduli(self, phase: int, u: FloatArray) -> FloatArray:
        """See `CellProblem._moduli`: principal conductivities (n, 3)."""
        found = as_matrices(self.conductivity.phases[phase].at(self.assembly, u))
        return np.asarray(np.linalg.eigvalsh(found))

    def moment(self) -> FloatArray:
        """Integral of the conductivity over the active solid.

        Returns
        -------
        ndarray, shape (3, 3)
            In space.
        """
        asm, total = self.assembly, np.zeros((3, 3))
        rule = self.domain.stiff_rule(asm, constant=self.conductivity.constant)
        for s, part in zip(self.conductivity.phases, self.domain.of_phases(rule), strict=False):
            total += tensors.weighted(as_matrices(s.at(asm, part.points)), part.weights)
        return abs(float(np.linalg.det(self._jacobian[0]))) * total

    def homogenized(
        self, *, method: str = "auto", tol: float = 1e-8, max_iterations: int = 500,
        progress: Progress = None, estimate: bool = True,
    ) -> Conductivity:  # fmt: skip
        """Solve for the effective conductivity.

        Parameters
        ----------
        method, tol, max_iterations, progress : str, float, int, bool or callable
            As in `Heat.solve`.
        estimate : bool
            Whether to estimate errors, which takes as long again, more or less by a half.

        Returns
        -------
        Conductivity
            With an estimate of its errors.
        """
        as_flag("estimate", estimate)
        start = time.perf_counter()
        self.warn_of_gaps()
        k, errors, answer = np.zeros((3, 3)), np.zeros((3, 3)), None
        if len(self.parts[0]):
            k, answer = _conductivity(self, method, tol, max_iterations, progress)
            errors = spread(self.errors_of(
                k.diagonal(), answer,
                lambda p, t: _conductivity(p, method, t, max_iterations, None)[0].diagonal(), tol,
                estimate=estimate,
            ))  # fmt: skip
        density, bounds = _bounds(self)
        report = self.report(answer, time.perf_counter() - start)
        eff = Conductivity(density, self.percolates, report, k, errors, bounds)
        if answer is not None:
            self.warn_of_contrast()
        if answer is not None and estimate:
            rounding = float(self.rounding(k.diagonal(), answer).max())
            self.warn_of_error(eff.error, "the effective conductivity", rounding)
        return eff


def _conductivity(
    problem: ConductiveCell, method: str, tol: float, max_iterations: int, progress: Progress
) -> tuple[FloatArray, Answer]:
    """Effective conductivity (3, 3), and solutions."""
    answer = problem.answers(method, tol, max_iterations, progress)
    k = (problem.moment() - answer.energies) / problem.cell_volume
    n = problem.free_normals()
    keep = np.eye(3) - np.linalg.pinv(n) @ n
    k = keep @ (0.5 * (k + k.T)) @ keep
    k[np.abs(k) <= 1e-14 * np.abs(k).max()] = 0.0
    return 0.5 * (k + k.T), answer


def conductive(
    field: Any, cells: Any = 16, *, conductivity: Conducting = 1.0, method: str = "auto",
    tol: float = 1e-8, max_iterations: int = 500, progress: Progress = None,
    estimate: bool = True, **options: Any,
) -> Conductivity:  # fmt: skip
    """Effective conductivity of a periodic solid; arrays of voxels go to `voxels`.

    Parameters
    ----------
    field, cells : optional
        As in `elastic`.
    conductivity : float, str, callable, matrix, or pair of these, keyword-only
        As in `ilattice.cutfem.Heat`: matrices, shape (3, 3), where directions differ.
    method, tol, max_iterations, progress : str, float, int, bool or callable, keyword-only
        As in `ilattice.cutfem.Heat.solve`.
    estimate : bool, keyword-only
        As in `elastic`.
    **options
        As in `elastic`, without ``dilatation``.

    Returns
    -------
    Conductivity
        With an estimate of its errors.

    Raises
    ------
    InputError
        If an argument is wrong, or the field does not repeat.
    GeometryError
        If there is no solid.
    ConvergenceError
        If the tolerance is not reached.

    Examples
    --------
    >>> import ilattice as il
    >>> ball = il.fields.translate(il.fields.sphere(0.25), (0.5, 0.5, 0.5))
    >>> eff = il.homogenize.conductive(il.fields.complement(ball), cells=8)
    >>> bool(eff.mean < eff.bounds.hashin_shtrikman[1] + eff.error)
    True
    """
    check_options("conductive", options, Heat.__init__)
    problem = ConductiveCell(field, cells, conductivity=conductivity, **options)
    return problem.homogenized(
        method=method, tol=tol, max_iterations=max_iterations, progress=progress,
        estimate=estimate,
    )  # fmt: skip


def _bounds(problem: ConductiveCell) -> tuple[float, ConductivityBounds]:
    """Part of the cell that is filled, and bounds by what fills it."""
    fractions, known = problem.fractions(), []
    mean, resistance = np.zeros((3, 3)), np.zeros((3, 3))
    phases = zip(
        fractions, problem.conductivity.phases, problem.domain.of_phases(problem.domain.volume),
        strict=False,
    )  # fmt: skip
    for f, s, part in phases:
        k = s.at(problem.assembly_of_all, part.points)
        known.append(float(k[0]) if s.constant and k.ndim == 1 else np.nan)
        k, w = as_matrices(k), f * part.weights / part.weights.sum()
        mean = mean + tensors.weighted(k, w)
        resistance = resistance + tensors.weighted(np.asarray(np.linalg.inv(k)), w)
    density = float(fractions.sum())
    full = density > 1.0 - FULL
    interval = None
    if np.isfinite(known).all():
        f = np.append(fractions, 0.0 if full else 1.0 - density)
        interval = conductive_bounds(f / f.sum(), np.append(known, 0.0))
    least = np.asarray(np.linalg.inv(resistance)) if full else np.zeros((3, 3))
    return density, ConductivityBounds((least, mean), interval)
