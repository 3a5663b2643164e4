"""Effective stiffness of a cell by splines on cut cells: the reference, and the default.

::

    cell = il.Lattice("gyroid", through=il.macroshape.cell(), repeat=1).offset(relative_density=0.3)
    eff = il.homogenize.elastic(cell, cells=16, young=1.0, poisson=0.3)

Six mean strains E are put on the cell; its periodic displacement u minimises the energy of E + e(u)
in the solid, and the mean stresses make up the columns of the stiffness. All loads share the
matrix and the solver (Guedes and Kikuchi, Preprocessing and postprocessing for materials based on
the homogenization method, 1990). Errors of order two of the displacement's gradient count as four
in the stiffness.

Guarantees and non-guarantees: those of `CellProblem` and of `Effective`; material that jumps needs
``phases=``, or a grid with planes where it jumps and ``smoothness=0``.
"""

import time
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ilattice._progress import Progress
from ilattice._typing import ArrayLike, FloatArray
from ilattice._validate import as_flag, read_only
from ilattice.cutfem.assembly import Assembly
from ilattice.cutfem.choosing import USUAL
from ilattice.cutfem.elasticity import Elasticity
from ilattice.cutfem.material import AT_ONCE, Elastic, Property
from ilattice.errors import InputError
from ilattice.homogenize import tensors
from ilattice.homogenize._result import SOFT
from ilattice.homogenize._symmetry import group, symmetry_of
from ilattice.homogenize.arguments import as_cell, check_options, check_phases
from ilattice.homogenize.bounds import Bounds, elastic_bounds
from ilattice.homogenize.cell import Answer, CellProblem, spread
from ilattice.homogenize.effective import Effective
from ilattice.homogenize.local import LocalFields, as_stresses, first_yield
from ilattice.homogenize.periodic import FULL


@dataclass(frozen=True, eq=False, init=False, repr=False)
class ElasticCell(CellProblem, Elasticity):
    """An elastic cell of a periodic solid, under mean strains.

    Parameters
    ----------
    field, cells, **options : optional
        As in `elastic`.
    """

    loads_of_cells: ClassVar[FloatArray] = read_only(tensors.strain_matrices())

    def __init__(self, field: Any, cells: Any = 16, **options: Any) -> None:
        check_options(type(self).__name__, options, Elasticity.__init__)
        named = {k: options.pop(k, None) for k in ("domain", "through")}
        Elasticity.__init__(self, as_cell(field, cells, **named), **{"degree": USUAL, **options})
        check_phases(self.domain)

    def _scale(self) -> float:
        """See `CellProblem._scale`."""
        K, G = tensors.bulk_and_shear(self.moments())
        return float((K + 4.0 * G / 3.0) * max(self.cell_volume, 1e-300) ** (-1 / 3))

    def _moduli(self, phase: int, u: FloatArray) -> FloatArray:
        """See `CellProblem._moduli`: P-wave moduli."""
        lam, mu = self.material.phases[phase].lame(self.assembly, u)
        return np.asarray(lam + 2.0 * mu)

    def moments(self) -> FloatArray:
        """Integral of the stiffness over the active solid.

        Returns
        -------
        ndarray, shape (6, 6)
            In space.
        """
        asm = self.assembly
        total = np.zeros((6, 6))
        rule = self.domain.stiff_rule(asm, constant=self.material.constant)
        det = abs(float(np.linalg.det(self._jacobian[0])))
        for m, part in zip(self.material.phases, self.domain.of_phases(rule), strict=False):
            w = det * part.weights
            total += _integral(m, asm, part.points, w)
        return total

    def expanding(self, C: FloatArray, answer: Answer) -> FloatArray:
        """Thermal expansion of the cell, from the solutions for mean strains.

        What a mean strain does on hindered expansion is what a degree does on the mean stress (V.
        Levin, Thermal expansion coefficients of heterogeneous materials, 1967).

        Parameters
        ----------
        C : ndarray, shape (6, 6)
            Effective stiffness.
        answer : Answer
            Solutions.

        Returns
        -------
        ndarray, shape (6,) or (0,)
            Strain per degree; nothing if the material does not expand.
        """
        if self.material.expansion.value == 0.0:
            return np.zeros(0)
        asm, stress = self.assembly, np.zeros(6)
        rule = self.domain.stiff_rule(asm, constant=self.material.constant)
        det = abs(float(np.linalg.det(self._jacobian[0])))
        for m, part in zip(self.material.phases, self.domain.of_phases(rule), strict=False):
            for i in range(0, len(part), AT_ONCE):
                u, w = part.points[i : i + AT_ONCE], part.weights[i : i + AT_ONCE]
                one = m.hindered(asm, u) * m.expansion.at(asm, u)[:, None]
                stress += det * (w[:, None] * one).sum(axis=0)
        done = np.einsum("na,naj->j", self.load(temperature=1.0).forces(), answer.coefficients)
        beta = (stress + done) / self.cell_volume
        return tensors.compliance(C, SOFT) @ beta

    def under(self, stress: ArrayLike) -> LocalFields:
        """The cell under a mean stress.

        Parameters
        ----------
        stress : array_like, shape (6,)
            Mean over the cell, voids included: xx, yy, zz, yz, xz, xy.

        Returns
        -------
        LocalFields
            Displacement and stress inside, with ``plot`` and ``save`` as other results have them.

        Raises
        ------
        InputError
            If the stress is wrong, or the cell does not bear it.
        ConvergenceError
            If the equations are not solved.
        """
        C, c = self._solutions
        means, strains = as_stresses(stress, C)
        if np.ndim(stress) != 1:
            raise InputError(f"stress must be one, shape (6,), got shape {np.shape(stress)}")
        return LocalFields(self, c @ strains[0], means[0], strains[0])

    def first_yield(self, stress: ArrayLike) -> FloatArray:
        """Factors of mean stresses at which the first point of the solid yields.

        Parameters
        ----------
        stress : array_like, shape (6,) or (m, 6)
            Mean stresses, as in `under`: of rows (1, 0, ...), (0, 1, ...) it is the strength.

        Returns
        -------
        ndarray, shape (m,)
            The least strength over von Mises stress at the points of quadrature; infinite where
            that is pressure alone.

        Raises
        ------
        InputError
            If a stress is wrong, the cell does not bear it, or was made without `strength`.
        """
        C, c = self._solutions
        return first_yield(self, c, as_stresses(stress, C)[1])

    @property
    def _solutions(self) -> tuple[FloatArray, FloatArray]:
        """Effective stiffness, and solutions (functions, 3, 6) for unit strains, made once."""
        if "solutions" not in self._held:
            C, _, answer = _properties(self, "auto", 1e-8, 500, None)
            self._held["solutions"] = C, answer.coefficients
        found: tuple[FloatArray, FloatArray] = self._held["solutions"]
        return found

    def homogenized(
        self, *, method: str = "auto", tol: float = 1e-8, max_iterations: int = 500,
        progress: Progress = None, estimate: bool = True,
    ) -> Effective:  # fmt: skip
        """Solve for the effective stiffness.

        Parameters
        ----------
        method, tol, max_iterations, progress : str, float, int, bool or callable
            As in `Elasticity.solve`.
        estimate : bool
            Whether to estimate errors, which takes as long again, more or less by a half.

        Returns
        -------
        Effective
            Stiffness with an estimate of its errors.
        """
        how = (method, tol, max_iterations, progress)
        return homogenized(self, *how, estimate=as_flag("estimate", estimate))


def _integral(
    m: Elastic, asm: Assembly, u: FloatArray, w: FloatArray, *, soft: bool = False
) -> FloatArray:
    """Sum (6, 6) of stiffnesses, or of their inverses, at parameters (n, 3) with weights."""
    if not m.full:
        lam, mu = (np.broadcast_to(v, len(w)) for v in m.lame(asm, u))
        if not soft:
            return tensors.isotropic(float(w @ lam), float(w @ mu))
        K, G = (1.0 / float(w @ (1.0 / v)) for v in (lam + 2.0 * mu / 3.0, mu))
        return np.asarray(np.linalg.inv(tensors.of_moduli(K, G)), np.float64)
    total = np.zeros((6, 6))
    for i in range(0, len(w), AT_ONCE):
        C, part = m.matrices(asm, u[i : i + AT_ONCE]), w[i : i + AT_ONCE]
        C = np.asarray(np.linalg.inv(C), np.float64) if soft else C
        total += tensors.weighted(C, part)
    return total


def elastic(
    field: Any, cells: Any = 16, *, young: Property | None = None,
    poisson: Property | None = None, stiffness: Any = None, axes: str = "space",
    expansion: Property = 0.0, method: str = "auto", tol: float = 1e-8, max_iterations: int = 500,
    progress: Progress = None, estimate: bool = True, **options: Any,
) -> Effective:  # fmt: skip
    """Effective stiffness of a periodic solid, and its thermal expansion.

    Parameters
    ----------
    field : Wall, Tile, str, BSpline, Node, callable, pair of fields, CutGrid or Domain
        The solid in one cell, where it is negative: a wall through `macroshape.cell`, or any level
        set, as in `ilattice.cutfem.cut`, that repeats in the box `domain`. Of a tile, or a name of
        the catalogue, the solid is where the tile is negative: of straight struts that are joined
        sharply as it is, of other skeletons by a spline, which rounds off edges.
    cells : int, sequence of 3 int or Grid
        Background grid; an int is for every direction.
    young, poisson : float, str or callable, keyword-only
        As in `ilattice.cutfem.Elasticity`, also pairs for two `phases`; by default 1 and 0.3.
    stiffness, axes : array_like, shape (6, 6), Graded or callable; str, optional, keyword-only
        Material of any symmetry instead, likewise.
    expansion : float, str or callable, keyword-only
        Thermal expansion per degree, likewise, for `Effective.expansion`.
    method, tol, max_iterations, progress : str, float, int, bool or callable, keyword-only
        As in `ilattice.cutfem.Elasticity.solve`.
    estimate : bool, keyword-only
        Whether to estimate `Effective.errors`, by fewer cells, which takes as long again, more or
        less by a half; NaN without, and with less than four cells in a direction, or five at
        degree 3.
    **options
        ``domain``, the box that repeats, by default the unit cube; ``through``, a map of
        `macroshape.cell`, for fields; and ``degree`` (2 by default), ``smoothness``, ``q``,
        ``stabilization``, ``weight``, ``dilatation``, ``islands``, ``phases`` as in
        `ilattice.cutfem.Elasticity`.

    Returns
    -------
    Effective
        Stiffness with an estimate of its errors, and what follows from it.

    Raises
    ------
    InputError
        If an argument is wrong, or the field does not repeat: the message tells the largest jump.
    GeometryError
        If there is no solid.
    ConvergenceError
        If the tolerance is not reached.

    Warns
    -----
    PrecisionWarning
        If nothing goes on through the cell along one of its edges, islands were left out, or the
        estimated error is more than 2 %.

    Examples
    --------
    >>> import ilattice as il
    >>> ball = il.fields.translate(il.fields.sphere(0.25), (0.5, 0.5, 0.5))
    >>> eff = il.homogenize.elastic(il.fields.complement(ball), cells=8, young=1.0, poisson=0.3)
    >>> eff.symmetry, bool(eff.K < eff.bounds.bulk[1] + eff.error)
    ('cubic', True)
    """
    check_options("elastic", options, Elasticity.__init__)
    problem = ElasticCell(
        field, cells, young=young, poisson=poisson, stiffness=stiffness, axes=axes,
        expansion=expansion, **options,
    )  # fmt: skip
    return problem.homogenized(
        method=method, tol=tol, max_iterations=max_iterations, progress=progress,
        estimate=estimate,
    )  # fmt: skip


def homogenized(
    problem: ElasticCell, method: str, tol: float, max_iterations: int, progress: Progress,
    *, estimate: bool,
) -> Effective:  # fmt: skip
    """Solve a cell; see `ElasticCell.homogenized`."""
    start = time.perf_counter()
    problem.warn_of_gaps()
    C, errors, answer, expansion = np.zeros((6, 6)), np.zeros(6), None, np.zeros(0)
    strains, softest = np.zeros((6, 0)), 0.0
    if len(problem.parts[0]):
        C, expansion, answer = _properties(problem, method, tol, max_iterations, progress)
        strains = _own_strains(C)

        def told(C: FloatArray, expansion: FloatArray) -> FloatArray:
            own = np.einsum("ik,ij,jk->k", strains, C, strains)
            return np.concatenate([C.diagonal(), own, expansion])

        def again(other: ElasticCell, tol: float) -> FloatArray:
            return told(*_properties(other, method, tol, max_iterations, None)[:2])

        values = told(C, expansion)
        errors = problem.errors_of(values, answer, again, tol, estimate=estimate)
        own = slice(6, 6 + strains.shape[1])
        softest = float((errors[own] / values[own]).max(initial=0.0))
    density, bounds = _bounds(problem)
    report = problem.report(answer, time.perf_counter() - start)
    thermal = errors[6 + strains.shape[1] :]
    alpha, off = (expansion, thermal) if len(expansion) else (None, None)
    plain = all(m.constant and not m.full for m in problem.material.phases)
    known = symmetry_of(group(problem.domain, problem._jacobian[0])) if plain else None
    eff = Effective(
        density, problem.percolates, report, C, spread(errors[:6]), bounds, alpha, off, known,
        softest,
    )  # fmt: skip
    if answer is not None:
        problem.warn_of_contrast()
    if answer is not None and estimate:
        rounding = float(problem.rounding(C.diagonal(), answer).max())
        problem.warn_of_error(eff.error, "the effective stiffness", rounding, softest)
    return eff


def _own_strains(C: FloatArray) -> FloatArray:
    """Strains (6, k), eigenvectors of C in Mandel's notation, that meet resistance."""
    values, vectors = np.linalg.eigh(C * np.outer(tensors.MANDEL, tensors.MANDEL))
    return tensors.MANDEL[:, None] * vectors[:, values > max(SOFT * float(values[-1]), 0.0)]


def _properties(
    problem: ElasticCell, method: str, tol: float, max_iterations: int, progress: Progress
) -> tuple[FloatArray, FloatArray, Answer]:
    """Effective stiffness (6, 6) and expansion (6,) or (0,), and solutions."""
    answer = problem.answers(method, tol, max_iterations, progress)
    C = (problem.moments() - answer.energies) / problem.cell_volume
    C = tensors.without(0.5 * (C + C.T), problem.free_normals())
    return C, problem.expanding(C, answer), answer


def _bounds(problem: ElasticCell) -> tuple[float, Bounds]:
    """Part of the cell that is filled, and bounds by what fills it."""
    fractions, materials = problem.fractions(), problem.material.phases
    stiff, soft, moduli = np.zeros((6, 6)), np.zeros((6, 6)), []
    asm = problem.assembly_of_all
    parts = problem.domain.of_phases(problem.domain.volume)
    for f, m, part in zip(fractions, materials, parts, strict=False):
        w = part.weights / part.weights.sum()
        mean = _integral(m, asm, part.points, w)
        stiff, soft = stiff + f * mean, soft + f * _integral(m, asm, part.points, w, soft=True)
        known = m.constant and not m.full
        moduli.append(tuple(map(float, tensors.bulk_and_shear(mean))) if known else None)
    density = float(fractions.sum())
    full = density > 1.0 - FULL
    reuss = np.asarray(np.linalg.inv(soft), np.float64) if full else np.zeros((6, 6))
    intervals: Any = (None, None)
    if None not in moduli:
        K, G = np.array([*moduli, (0.0, 0.0)]).T
        f = np.append(fractions, 0.0 if full else 1.0 - density)
        intervals = elastic_bounds(f / f.sum(), K, G)
    return density, Bounds(stiff, reuss, *intervals)
