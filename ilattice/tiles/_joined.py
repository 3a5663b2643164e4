"""Tiles side by side without a zone of transition: equal coefficients on shared faces.

Tiles whose fields are cubic splines of equal knots, and agree on all faces that they share in
values and slopes, are joined as they are, C1: a family of tiles. Others are fitted, and C0.

Guarantees: inside a tile, further than a span from faces shared with other tiles, the spline is
that of the tile alone; a family is not changed at all, but for one factor. On a shared face of
other tiles it is the mean of both. Non-guarantee: the gradient of those jumps there, so that the
zero set has creases.
"""

import math
import warnings

import numpy as np

from ilattice._memory import need
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.bspline import BSpline
from ilattice.bspline.fit import fit_report
from ilattice.bspline.knots import wrapped_knots
from ilattice.errors import PrecisionWarning
from ilattice.tiles._mixed import DEGREE, MAX_SPANS, MIN_SPANS, Blend, MixedField


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
    own = _family(blend)
    if own is not None:
        spans = own[0].shape[0] - DEGREE
        fields = tuple(t.field for t in blend.tiles)
        return MixedField(_assembled(own, blend, spans, smooth=True), fields, 0.0, (spans,) * 3)
    spans = MIN_SPANS
    while True:
        fits = [
            fit_report(t, degree=DEGREE, spans=spans, method="interpolate") for t in blend.tiles
        ]
        error = max(report.error for _, report in fits)
        if error <= tol or spans == MAX_SPANS:
            break
        spans *= 2
    if error > tol:
        warnings.warn(
            f"the spline of a tile deviates by {error:.3g} tile edges (tol asks for {tol:.3g}) "
            f"with {spans} spans: is it smooth?",
            PrecisionWarning,
            stacklevel=4,
        )
    spline = _assembled([s.c for s, _ in fits], blend, spans, smooth=False)
    return MixedField(spline, tuple(t.field for t in blend.tiles), error, (spans, spans, spans))


def _family(blend: Blend) -> list[FloatArray] | None:
    """Coefficients of tiles that agree on shared faces as they are; None if they do not."""
    fields = [t.field for t in blend.tiles]
    if not all(isinstance(f, BSpline) and f.weights is None for f in fields):
        return None
    splines = [f for f in fields if isinstance(f, BSpline)]
    spans = splines[0].shape[0] - DEGREE
    if spans < 2:
        return None
    knots = np.concatenate([[0.0] * DEGREE, np.arange(spans + 1) / spans, [1.0] * DEGREE])
    for s in splines:
        if s.k != (DEGREE,) * 3 or any(s.periodic) or s.shape != splines[0].shape:
            return None
        if any(len(t) != len(knots) or np.abs(t - knots).max() > 1e-12 for t in s.t):
            return None
    slope = float(np.mean([t.slope for t in blend.tiles]))
    parts = [s.c / slope for s in splines]
    return parts if _agree(parts, blend) else None


def _agree(parts: list[FloatArray], blend: Blend) -> bool:
    """Whether neighbours have equal values and slopes on the faces between them."""
    assert blend.cells is not None
    scale = 1e-12 * max(float(np.abs(c).max()) for c in parts)
    for axis in range(3):
        cells = np.moveaxis(blend.cells, axis, 0)
        pairs = np.stack([cells, np.roll(cells, -1, axis=0)], axis=-1)
        pairs = pairs if blend.closed[axis] else pairs[:-1]
        ends = np.stack([cells[[0, -1]]] * 2, axis=-1)  # beyond open ends they are repeated
        pairs = np.concatenate([pairs, ends[:0] if blend.closed[axis] else ends])
        for a, b in np.unique(pairs.reshape(-1, 2), axis=0):
            low, high = np.moveaxis(parts[a], axis, 0), np.moveaxis(parts[b], axis, 0)
            if np.abs(low[-1] - high[0]).max() > scale:
                return False
            if np.abs(low[-1] - low[-2] - high[1] + high[0]).max() > scale:
                return False
    return True


def _assembled(parts: list[FloatArray], blend: Blend, spans: int, *, smooth: bool) -> BSpline:
    """One spline from the coefficients of the tiles: the mean of all that meet at a place.

    Where slopes agree, faces have two knots instead of three, and no coefficients of their own.
    """
    assert blend.cells is not None
    closed = [bool(c) for c in blend.closed]
    cells = np.pad(blend.cells, [(0, 0) if c else (1, 1) for c in closed], mode="edge")
    step = spans + DEGREE - 1
    shape = [n * step + (0 if c else 1) for n, c in zip(cells.shape, closed, strict=True)]
    need(
        16 * math.prod(map(float, shape)),
        f"the spline of {' x '.join(map(str, cells.shape))} tiles with {spans} spans each",
        "use fewer tiles, or tiles with fewer spans",
    )
    c = np.zeros(shape)
    count = np.ones(1) if smooth else np.zeros(shape)
    for at in np.ndindex(*cells.shape):
        place = np.ix_(*(_places(a, step, n) for a, n in zip(at, shape, strict=True)))
        if smooth:  # neighbours have the same
            c[place] = parts[cells[at]]
        else:
            np.add.at(c, place, parts[cells[at]])
            np.add.at(count, place, 1.0)
    c = c if smooth else c / count
    knots = []
    for axis, (n, wraps) in enumerate(zip(cells.shape, closed, strict=True)):
        knots.append(_knots(n, spans, wraps, DEGREE - smooth))
        if smooth:
            c = np.delete(c, np.arange(0 if wraps else step, n * step, step), axis)
        if wraps:  # the first coefficients are those before the knots of the seam
            order = np.arange(-(DEGREE - 1), c.shape[axis] + 1) % c.shape[axis]
            c = c.take(order, axis)
    return BSpline(knots, c, DEGREE, periodic=closed)


def _places(cell: int, step: int, size: int) -> IntArray:
    """Numbers of a tile's coefficients along a direction with so many."""
    out: IntArray = (cell * step + np.arange(step + 1)) % size
    return out


def _knots(n: int, spans: int, wraps: bool, multiplicity: int) -> AnyArray:
    """Knots of n tiles, those at their faces repeated; open ones start at -1."""
    number = np.arange(n * spans + 1)
    repeats = np.where(number % spans == 0, multiplicity, 1)
    if wraps:
        return wrapped_knots(np.repeat(number[:-1] / spans, repeats[:-1]), DEGREE, float(n))
    repeats[[0, -1]] = DEGREE + 1
    return np.repeat(number / spans - 1.0, repeats)
