"""How far an energy is off because cells that surfaces cut are integrated by rules of few points.

Energies of these cells are compared with those by rules with `MORE` points per direction more: of
all, or, where they are many, of some that are drawn, at random, cells with much energy more often.

Guarantee: the same number for the same problem; what drawing leaves open, one standard deviation,
is added. Non-guarantees: an estimate, and no bound; loads on bodies are off likewise, and fields of
points are, by `CutGrid.error`, besides.
"""

import warnings
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ilattice._typing import FloatArray, IntArray
from ilattice.cutfem import discretization
from ilattice.errors import PrecisionWarning
from ilattice.quadrature.grid import CUT
from ilattice.quadrature.rules import Quadrature, on_cells

if TYPE_CHECKING:
    from ilattice.cutfem.problem import Problem

#: Cells up to which all are compared; of more, so many are drawn, out of so many whose energy is
#: guessed by one point each.
SOME, KNOWN = 96, 1024
#: Part of the draws that are by volume, so that no cell counts for much that is seldom drawn.
ANYWHERE = 0.2


def relative_error(problem: "Problem", c: FloatArray, energy: float) -> float:
    """Part of an energy that rules miss.

    Parameters
    ----------
    problem : Problem
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
    mine = problem.assembly.space.cells
    home = problem.domain.elements.home(mine)
    cells = np.unique(home[problem.domain.status.ravel()[home] == CUT])
    if not len(cells):
        return 0.0
    if len(cells) <= SOME:
        off = abs(float(_missed(problem, c, cells).sum()))
    else:
        off = _drawn(problem, c, cells)
    return off / max(energy, 1e-300) if off > 0.0 else 0.0


def _drawn(problem: "Problem", c: FloatArray, cells: IntArray) -> float:
    """What all cells miss, by some of them, and its standard deviation."""
    rng = np.random.default_rng(len(cells))
    share = 1.0
    if len(cells) > KNOWN:
        share = len(cells) / KNOWN
        at = (share * (np.arange(KNOWN) + rng.random(KNOWN))).astype(np.int64)
        cells = cells[np.unique(np.minimum(at, len(cells) - 1))]
    energy, volume = _guessed(problem, c, cells)
    chance = ANYWHERE * volume / volume.sum()
    chance += (1.0 - ANYWHERE) * (energy / energy.sum() if energy.any() else volume / volume.sum())
    at = np.searchsorted(np.cumsum(chance), (np.arange(SOME) + rng.random(SOME)) / SOME)
    rows, times = np.unique(np.minimum(at, len(cells) - 1), return_counts=True)
    values = _missed(problem, c, cells[rows]) * share / chance[rows]
    mean = times @ values / SOME
    spread = times @ (values - mean) ** 2 / (SOME - 1.0)
    return float(abs(mean) + np.sqrt(spread / SOME))


def _guessed(
    problem: "Problem", c: FloatArray, cells: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Energies (n,) of cells by one point of each of their elements, and volumes in parameters."""
    rule, at = _rule_on(problem, problem.domain.volume, cells)
    volume = rule.integrate_cells()
    middle = (rule.offsets[:-1] + rule.offsets[1:]) // 2
    one = replace(
        rule, points=rule.points[middle], weights=volume, offsets=np.arange(len(middle) + 1)
    )
    at = at[middle]
    return (
        np.abs(np.bincount(at, problem._energies(c, one), len(cells))),
        np.maximum(np.bincount(at, volume, len(cells)), 0.0),
    )


def _missed(problem: "Problem", c: FloatArray, cells: IntArray) -> FloatArray:
    """What rules miss of twice the energy of cells of the grid, given increasing."""
    out = np.zeros(len(cells))
    domain = problem.domain
    for whole, sign in ((domain.finer(cells), 1.0), (domain.volume, -1.0)):
        rule, at = _rule_on(problem, whole, cells)
        out += sign * np.bincount(at, problem._energies(c, rule), len(cells))
    return out


def _rule_on(
    problem: "Problem", whole: Quadrature, cells: IntArray
) -> tuple[Quadrature, IntArray]:
    """The part of a rule in the active elements of cells, and the row of the cell of each point."""
    mine, elements = problem.assembly.space.cells, problem.domain.elements
    rule = on_cells(whole, mine[np.isin(elements.home(mine), cells)])
    return rule, np.searchsorted(cells, elements.home(rule.cells))[rule.owners]


def warn(rules: float, splines: float, what: str) -> None:
    """Warn of an energy that is off because of both, if it is because of rules that it is told."""
    if splines > discretization.WARNED or not rules + splines > discretization.WARNED:
        return
    warnings.warn(
        f"{what} is off by about {100 * rules:.2g} % because cells that curved surfaces cut are "
        f"integrated with few points, and by about {100 * splines:.2g} % because of the splines; "
        "take more points, q=, or finer cells",
        PrecisionWarning,
        stacklevel=4,
    )
