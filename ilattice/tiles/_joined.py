"""Tiles side by side without a zone of transition: equal coefficients on shared faces, C0.

Guarantees: inside a tile, further than a span from faces shared with other tiles, the spline is
that of the tile alone; on a shared face it is the mean of both. Non-guarantee: its gradient jumps
there, so that the zero set has creases.
"""

import warnings

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.bspline import BSpline
from ilattice.bspline.knots import wrapped_knots
from ilattice.errors import PrecisionWarning
from ilattice.tiles._mixed import DEGREE, LEAST_SPANS, MOST_SPANS, Blend, MixedField


def joined(blend: Blend, tol: float) -> MixedField:
    """Cubic spline of a lattice whose tiles are fitted one by one.

    Parameters
    ----------
    blend : Blend
        The tiles and which is where; its width plays no part.
    tol : float
        Largest deviation of each tile's own spline, in tile edges.

    Returns
    -------
    MixedField
        The spline; its knots at the faces of tiles have full multiplicity.

    Notes
    -----
    Hong et al. 2025, section 3.1: open-end conditions, and identical coefficients on shared faces.
    """
    from ilattice.bspline.fit import fit_report

    spans = LEAST_SPANS
    while True:
        fits = [
            fit_report(t, degree=DEGREE, spans=spans, method="interpolate") for t in blend.tiles
        ]
        error = max(report.error for _, report in fits)
        if error <= tol or spans == MOST_SPANS:
            break
        spans *= 2
    if error > tol:
        warnings.warn(
            f"the spline of a tile deviates by {error:.3g} tile edges (tol asks for {tol:.3g}) "
            f"with {spans} spans: is it smooth?",
            PrecisionWarning,
            stacklevel=4,
        )
    spline = _assembled([s.c for s, _ in fits], blend, spans)
    return MixedField(spline, tuple(t.field for t in blend.tiles), error, (spans, spans, spans))


def _assembled(parts: list[FloatArray], blend: Blend, spans: int) -> BSpline:
    """One spline from the coefficients of the tiles: the mean of all that meet at a place."""
    assert blend.cells is not None
    closed = [bool(c) for c in blend.closed]
    cells = np.pad(blend.cells, [(0, 0) if c else (1, 1) for c in closed], mode="edge")
    step = spans + DEGREE - 1
    shape = [n * step + (0 if c else 1) for n, c in zip(cells.shape, closed, strict=True)]
    total, count = np.zeros(shape), np.zeros(shape)
    for at in np.ndindex(*cells.shape):
        place = np.ix_(*(_places(a, step, n) for a, n in zip(at, shape, strict=True)))
        np.add.at(total, place, parts[cells[at]])
        np.add.at(count, place, 1.0)
    c = total / count
    knots = []
    for axis, (n, wraps) in enumerate(zip(cells.shape, closed, strict=True)):
        knots.append(_knots(n, spans, wraps))
        if wraps:  # the first coefficient is the one before the knots of the seam
            order = np.arange(-(DEGREE - 1), shape[axis] + 1) % shape[axis]
            c = c.take(order, axis)
    return BSpline(knots, c, DEGREE, periodic=closed)


def _places(cell: int, step: int, size: int) -> IntArray:
    """Numbers of a tile's coefficients along a direction with so many."""
    out: IntArray = (cell * step + np.arange(step + 1)) % size
    return out


def _knots(n: int, spans: int, wraps: bool) -> AnyArray:
    """Knots of n tiles, those at their faces repeated; open ones start at -1."""
    number = np.arange(n * spans + 1)
    repeats = np.where(number % spans == 0, DEGREE, 1)
    if wraps:
        return wrapped_knots(np.repeat(number[:-1] / spans, repeats[:-1]), DEGREE, float(n))
    repeats[[0, -1]] = DEGREE + 1
    return np.repeat(number / spans - 1.0, repeats)
