"""How far off effective properties are because of the cells: the same problem on fewer cells.

A cell is solved again on three quarters and on half as many cells per direction, which takes as
long again, more or less by a half. Its discrete energy falls to the true one under refinement,
though not evenly, for cells are cut elsewhere each time: what is left is taken from the larger of
both differences, as if errors fell with the orders `ORDERS`, times `SAFETY`. Re-entrant edges and
thin walls leave as much of twice the degree; half as many cells are often too few to show an order
at all, and count less.

Non-guarantee: an estimate, and no bound. Against finer cells (sheets, solids, struts, voids and
inclusions, sixteen cells, 5 to 16 per direction, degrees 1 and 2, 170 comparisons, on which orders
and factor were chosen) estimates for the worst entry of the diagonal were below the true error
twice, at 0.59 of it or more, where that was more than a tenth of the property; the median was three
times the true error. For thin sheets on a few cells they are ten times too large. Where struts are
joined sharply, and at other edges that turn inwards, energies fall with an order from one to two
whatever the degree, next to one at the sharpest (M. Williams, Stress singularities resulting from
various boundary conditions, 1952): where `notched` finds such edges, `SHARP` orders count for both,
and so they do where material jumps between cells whose splines are smooth.
Of five kinds of struts, 8 to 32 cells per direction, degrees 1 and 2, all of 80 estimates of C11
and C44 were above the true error (against tetrahedra of degree 2 that fit the edges, and fits to
finer cells), 1.1 to 5.6 times it. Frequencies of waves (voids, sheets and full cells,
6 to 10 cells, degree 2, six bands each) were off by 0.07 to 1.03 of what is estimated, 0.1 and less
where nothing is cut and errors fall with order four.
Errors of the geometry are not in it.
"""

import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from ilattice._typing import FloatArray
from ilattice.cutfem.discretization import SURE, WARNED
from ilattice.cutfem.jumps import STEEP
from ilattice.cutfem.phases import PhasedDomain
from ilattice.errors import IlatticeError, PrecisionWarning
from ilattice.homogenize._edges import notched
from ilattice.quadrature.cutting import CutGrid
from ilattice.quadrature.grid import Grid

#: Parts of the cells per direction, with what is added before they are rounded down.
COARSER = ((0.75, 0.25), (0.5, 0.5))
#: Orders that are counted on for the error of an energy, for both, per degree, and what estimates
#: are multiplied by.
ORDERS, SAFETY = {1: (1.5, 2.5), 2: (1.75, 2.5), 3: (1.75, 2.5)}, 1.4
#: The same where edges turn inwards.
SHARP, SAFETY_SHARP = (1.0, 1.0), 1.25
#: Tolerance on coarser cells; energies are off by its square.
LOOSE = 1e-5
#: Estimates above which what is left says little.
HALF = 0.5
#: Relative errors of entries below which splines of the cells are exact.
EXACT = 1e-6

D = TypeVar("D", bound=Any)
Diagonal = Callable[[Any, float], FloatArray]


def estimated(problem: Any, fine: FloatArray, diagonal: Diagonal, tol: float) -> FloatArray:
    """Errors of the diagonal of an effective property.

    Parameters
    ----------
    problem : CellProblem
        The cell.
    fine : ndarray, shape (k,)
        Diagonal on its cells.
    diagonal : callable
        Takes another problem and a tolerance, returns its diagonal.
    tol : float
        Tolerance on its cells.

    Returns
    -------
    ndarray, shape (k,)
        NaN where there are too few cells to tell.
    """
    domain, out = problem.domain, np.full(len(fine), np.nan)
    sharp = notched(domain) or problem.step > STEEP
    for order, counts in _coarser(domain, SHARP if sharp else ORDERS[domain.degree]):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", PrecisionWarning)
                found = diagonal(problem._with(domain=_cut(domain, counts), _held={}),
                                 max(tol, LOOSE))  # fmt: skip
        except IlatticeError:
            continue  # what fewer cells do not resolve does not tell anything
        ratio = min(n / m for n, m in zip(domain.cut.grid.shape, counts, strict=True))
        out = np.fmax(out, np.abs(found - fine) / (ratio**order - 1.0))
    return (SAFETY_SHARP if sharp else SAFETY) * out


def _coarser(domain: Any, orders: tuple[float, float]) -> Iterator[tuple[float, tuple[int, ...]]]:
    """Orders, and numbers of fewer cells per direction that splines can be had on."""
    shape = domain.cut.grid.shape
    least = -(-(domain.degree + 1) // (domain.degree - domain.smoothness))
    done = {tuple(shape)}
    # with one more, functions do not meet themselves behind the cell, where phases may end
    for enough in (least + 1,) if isinstance(domain, PhasedDomain) else (least + 1, least):
        for order, (part, more) in zip(orders, COARSER, strict=True):
            counts = tuple(max(int(part * n + more), enough) for n in shape)
            if counts not in done and all(m < n for m, n in zip(counts, shape, strict=True)):
                done.add(counts)
                yield order, counts
        if len(done) > 1:
            return


def _cut(domain: D, counts: tuple[int, ...]) -> D:
    """A solid on fewer cells, planes where those of its grid leave off."""
    x, y, z = (
        np.interp(np.linspace(0.0, len(a) - 1.0, n + 1), np.arange(len(a)), a)
        for a, n in zip(domain.cut.grid.axes, counts, strict=True)
    )
    grid = Grid((x, y, z), domain.cut.grid.closed)

    def on(solid: CutGrid) -> CutGrid:
        return CutGrid(grid, solid.sets, solid.through)

    new: Any = {"cut": on(domain.cut), "_made": {}}
    if isinstance(domain, PhasedDomain):
        new["phases"] = (on(domain.phases[0]), on(domain.phases[1]))
    return replace(domain, **new)


def warn(error: float, what: str, *, unknown: str, how: str, unit: str = "cells") -> None:
    """Warn of a property that is off, or of which it is not known by how much.

    Parameters
    ----------
    error : float
        Relative, or NaN.
    what : str
        The property.
    unknown : str, keyword-only
        What is told where the error is NaN.
    how : str, keyword-only
        Where the estimate comes from, and the remedy.
    unit : str, keyword-only
        What the grid is made of.
    """
    if np.isnan(error):
        told = unknown
    elif error > WARNED:
        much = f"about {100 * error:.2g} % or less"
        if error > SURE:
            much = f"about {100 * error:.2g} %"
        if error > HALF:
            much += " of it, and may be many times too large"
        if error >= 1.0:
            much = "more than its own size"
        told = f"the {unit} are too coarse: {what} is off by {much}, estimated from {how}"
    else:
        return
    warnings.warn(told, PrecisionWarning, stacklevel=outside())


def warn_of_voxels(
    error: float, what: str, shape: tuple[int, ...], remedy: str, longer: str = "twice"
) -> None:
    """`warn` of arrays of voxels, whose estimates are from longer voxels."""
    grid = " x ".join(map(str, shape))
    warn(
        error, what, unit="voxels", how=f"voxels {longer} as long; {remedy}",
        unknown=f"it is not known by how much {what} is off: {grid} voxels are not taken together "
        "by twos; give an even number, 4 or more, in every direction, such as the array twice",
    )  # fmt: skip


def outside() -> int:
    """The `stacklevel` at which a warning of the caller points at who called this package."""
    frame, level = sys._getframe(1), 1
    while frame.f_back is not None and _inside(frame.f_globals.get("__name__", "")):
        frame, level = frame.f_back, level + 1
    return level


def _inside(name: str) -> bool:
    return name.partition(".")[0] == __name__.partition(".")[0]
