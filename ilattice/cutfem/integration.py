"""How far an energy is off because cells are integrated by rules of few points.

That is so where curved surfaces cut cells, or knots of the map, at which it bends. Energies of such
cells are compared with those by rules with more points per direction: of all of them, or of some
that are drawn, those with much energy more often.

Guarantee: the same number for the same problem; what drawing leaves open, one standard deviation,
is added. Non-guarantees: an estimate, and no bound; loads on bodies are off likewise, and fields of
points are, by `CutGrid.error`, besides.
"""

import warnings
from dataclasses import replace

import numpy as np

from ilattice._typing import FloatArray, IntArray
from ilattice.cutfem import discretization
from ilattice.cutfem.domain import kinks
from ilattice.cutfem.integrals import Integrals
from ilattice.errors import PrecisionWarning
from ilattice.quadrature.grid import CUT
from ilattice.quadrature.rules import Quadrature, on_cells

#: Points per direction that rules of all cells, and of drawn ones, are compared with have more.
WHOLE, DRAWN = 3, 2
#: Points per direction below which every solve looks at errors; from there on they are below
#: 0.2 % of the energy, also of struts of a cell.
ENOUGH = 4
#: Cells up to which all are compared there; of more, so many are drawn, out of so many whose energy
#: is guessed by one point each.
SOME, KNOWN = 32, 512
#: Part of the draws that is by volume, so that no cell counts for much that is seldom drawn.
ANYWHERE = 0.2
#: Distance of planes between cells from knots, in the whole, from which on these are inside.
INSIDE = 1e-9
#: Cells at once of which energies are compared.
CELLS = 1 << 12


def relative_error(problem: Integrals, c: FloatArray, energy: float) -> float:
    """Part of an energy that rules miss, by all cells.

    Parameters
    ----------
    problem : Integrals
        With supports.
    c : ndarray, shape (functions, m)
        Solution.
    energy : float
        Twice the energy that the error is relative to.

    Returns
    -------
    float
        The estimate.
    """
    cells, off = _inexact_cells(problem), 0.0
    for i in range(0, len(cells), CELLS):
        off += float(_missed(problem, c, cells[i : i + CELLS], WHOLE).sum())
    return abs(off) / max(energy, 1e-300)


def drawn_error(problem: Integrals, c: FloatArray, energy: float) -> float:
    """The same by some cells, with the standard deviation of that, of rules with few points.

    Parameters
    ----------
    problem, c, energy : Integrals, ndarray, float
        As in `relative_error`.

    Returns
    -------
    float
        The estimate; of rules with `ENOUGH` points or more by cells in which the map bends.
    """
    cells = _bent_cells(problem) if problem.domain.q >= ENOUGH else _inexact_cells(problem)
    if len(cells) <= SOME:
        off = abs(float(_missed(problem, c, cells, DRAWN).sum()))
    else:
        off = _drawn(problem, c, cells)
    return off / max(energy, 1e-300)


def _inexact_cells(problem: Integrals) -> IntArray:
    """Cells of the grid with active elements that are cut, or in which the map bends."""
    home = problem.domain.elements.home(problem.assembly.space.cells)
    is_cut = home[problem.domain.status.ravel()[home] == CUT]
    return np.union1d(is_cut, _bent_cells(problem))


def _bent_cells(problem: Integrals) -> IntArray:
    """Cells with active elements inside of which second derivatives of the map may jump."""
    cut, out = problem.domain.cut, []
    home = np.unique(problem.domain.elements.home(problem.assembly.space.cells))
    ijk = np.unravel_index(home, cut.grid.shape)
    if cut.through is None:
        return np.zeros(0, np.int64)
    for a, x in enumerate(cut.grid.axes):
        knots = kinks(cut.through, a)
        knots = knots[np.abs(knots[:, None] - x).min(axis=1) > INSIDE * np.ptp(x)]
        out.append(home[np.isin(ijk[a], np.searchsorted(x, knots) - 1)])
    return np.unique(np.concatenate(out))


def _drawn(problem: Integrals, c: FloatArray, cells: IntArray) -> float:
    """What all cells miss, by some of them, and its standard deviation."""
    rng = np.random.default_rng(len(cells))
    stands_for = 1.0
    if len(cells) > KNOWN:
        stands_for = len(cells) / KNOWN
        at = (stands_for * (np.arange(KNOWN) + rng.random(KNOWN))).astype(np.int64)
        cells = cells[np.unique(np.minimum(at, len(cells) - 1))]
    energy, volume = _guessed(problem, c, cells)
    chance = ANYWHERE * volume / volume.sum()
    chance += (1.0 - ANYWHERE) * (energy / energy.sum() if energy.any() else volume / volume.sum())
    at = np.searchsorted(np.cumsum(chance), (np.arange(SOME) + rng.random(SOME)) / SOME)
    rows, times = np.unique(np.minimum(at, len(cells) - 1), return_counts=True)
    values = _missed(problem, c, cells[rows], DRAWN) * stands_for / chance[rows]
    mean = times @ values / SOME
    spread = times @ (values - mean) ** 2 / (SOME - 1.0)
    return float(abs(mean) + np.sqrt(spread / SOME))


def _guessed(problem: Integrals, c: FloatArray, cells: IntArray) -> tuple[FloatArray, FloatArray]:
    """Energies (n,) of cells by one point of each of their elements, and volumes in parameters."""
    rule, at = _rule_on(problem, problem.domain.volume, cells)
    one, at = by_one_point(rule), at[_middle(rule)]
    return (
        np.abs(np.bincount(at, problem._energies(c, one), len(cells))),
        np.maximum(np.bincount(at, one.weights, len(cells)), 0.0),
    )


def by_one_point(rule: Quadrature) -> Quadrature:
    """A rule in parameters with one point in each cell, the middle one, and all of the weight."""
    return replace(
        rule, points=rule.points[_middle(rule)], weights=rule.integrate_cells(),
        offsets=np.arange(len(rule.offsets)),
    )  # fmt: skip


def _middle(rule: Quadrature) -> IntArray:
    """The row of the middle point of each cell."""
    return np.asarray((rule.offsets[:-1] + rule.offsets[1:]) // 2)


def _missed(problem: Integrals, c: FloatArray, cells: IntArray, more: int) -> FloatArray:
    """What rules miss of twice the energy of cells of the grid, given increasing."""
    out = np.zeros(len(cells))
    domain = problem.domain
    for whole, sign in ((domain.finer(cells, more), 1.0), (domain.volume, -1.0)):
        rule, at = _rule_on(problem, whole, cells)
        out += sign * np.bincount(at, problem._energies(c, rule), len(cells))
    # where functions bend, errors fall with the square of the points, and are of either sign
    rest = (domain.q / (domain.q + more)) ** 2
    return np.where(np.isin(cells, _bent_cells(problem)), np.abs(out) / (1.0 - rest), out)


def _rule_on(problem: Integrals, whole: Quadrature, cells: IntArray) -> tuple[Quadrature, IntArray]:
    """The part of a rule in the active elements of cells, and the row of the cell of each point."""
    mine, elements = problem.assembly.space.cells, problem.domain.elements
    rule = on_cells(whole, mine[np.isin(elements.home(mine), cells)])
    return rule, np.searchsorted(cells, elements.home(rule.cells))[rule.owners]


def warn(rules: float, splines: float, what: str) -> None:
    """Warn of an energy that is off because of both, if it is because of rules that it is told."""
    if splines > discretization.WARNED or not rules + splines > discretization.WARNED:
        return
    warnings.warn(
        f"{what} is off by about {100 * rules:.2g} % because cells that curved surfaces, or knots "
        f"of the map, cut are integrated with few points, and by about {100 * splines:.2g} % "
        "because of the splines; take more points, q=, or finer cells, with planes at these knots",
        PrecisionWarning,
        stacklevel=4,
    )
