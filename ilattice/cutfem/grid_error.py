"""How much of the energy the cells miss: the solution against those on cells twice as long.

What finer cells would add is judged by what the cells at hand have added: the energy of the
difference between the solution and the best one on cells twice as long, and on those four times as
long. Where the two fall by a constant factor, as they do under refinement, the rest is a geometric
series (Richardson, 1911). The coarse spaces are parts of the fine one (see `coarsening`), so that
nothing is integrated again: the best approximation there takes some products with the matrix that
has been solved, a few hundredths of the time of the solution.

Guarantees: zero, up to rounding, for solutions that the coarse splines have, such as those of patch
tests; no smoothness and no recovery is supposed, so it is large where walls are a cell thick, and
estimates by recovered stresses are blind. Non-guarantees: an estimate, and no bound: on grids that
are far too coarse it is off by a factor of two or three, to both sides; errors of the geometry, of
the stabilization and of the map are not in it.
"""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from ilattice._typing import AnyArray, FloatArray
from ilattice.cutfem.coarsening import coarser
from ilattice.cutfem.space import SplineSpace
from ilattice.errors import PrecisionWarning

#: Relative error of the energy above which a solution comes with a warning.
WARNED = 0.02
#: Least factor by which the square of the error falls on half the cells: that of order one.
LEAST = 2.5
#: Steps towards the best approximation, in the energy, and, before, in the mean square of nodes.
STEPS, FIRST = 8, 40
DIGITS = 1e-7
#: Energies below this part of those of nodes that move one by one, relative to their mean, and
#: absolutely, are what equations that are solved to some eight digits leave.
ROUNDING, SOLVED = 1e-12, 1e-16
#: Energies up to this many times more have no digits that count.
FEW = 1e4

Product = Callable[[FloatArray], FloatArray]


def levels(space: SplineSpace) -> list[Any]:
    """Matrices of the splines on cells twice and four times as long, as far as there are such."""
    out: list[Any] = []
    while len(out) < 2:
        found = coarser(space)
        if found is None:
            break
        space, P = found
        out.append(P if not out else (out[0] @ P).tocsr())
    return out


def relative_error(
    levels: list[Any], multiply: Product, diagonal: FloatArray, c: FloatArray, fixed: AnyArray,
    energy: float,
) -> float:  # fmt: skip
    """Part of an energy that finer cells would add, or take away.

    Parameters
    ----------
    levels : list of csr_array
        Of `levels`.
    multiply : callable
        Product of the matrix with displacements (n, m), zero where they are prescribed.
    diagonal : ndarray, shape (n, m)
        Its diagonal, any positive number where they are prescribed.
    c : ndarray, shape (n, m)
        Solution.
    fixed : ndarray of bool, shape (n, m)
        Prescribed components.
    energy : float
        What the error is relative to: twice the energy of the solution.

    Returns
    -------
    float
        The estimate; NaN if there are no coarser cells.
    """
    if not levels:
        return float("nan")
    lost = [_distance(P, multiply, diagonal, c, fixed) for P in levels]
    free = np.where(fixed, 0.0, diagonal)
    noise = ROUNDING * (free * (c - c.mean(axis=0)) ** 2).sum() + SOLVED * (free * c * c).sum()
    if lost[0] <= noise:
        return 0.0
    factor = LEAST
    if len(lost) == 2:
        factor = max((lost[1] - lost[0]) / lost[0], LEAST)
    return lost[0] / (factor - 1.0) / max(energy, FEW * noise)


def warn(error: float, what: str, space: SplineSpace) -> None:
    """Warn of an energy that is off."""
    if not error > WARNED:
        return
    more = ", a higher degree" * (space.degree < 3) + ", smoothness=0" * (space.smoothness > 0)
    many = f"about {100 * error:.2g} %" if error < 1 else "more than its own size"
    warnings.warn(
        f"the cells are too coarse: {what} is off by {many}, estimated from cells twice and four "
        f"times as long; take finer cells{' or'.join(more.rsplit(',', 1))}",
        PrecisionWarning,
        stacklevel=4,
    )


def _distance(
    P: Any, multiply: Product, diagonal: FloatArray, c: FloatArray, fixed: AnyArray
) -> float:
    """Square of the distance, in the energy, from a solution to coarse ones.

    By conjugate gradients, which approach it from above.
    """
    T = P.T.tocsr()
    held = (abs(T) @ fixed.astype(np.float64)) > 0
    weights = np.repeat(diagonal.mean(axis=1, keepdims=True), c.shape[1], axis=1)
    b = np.tile(c.mean(axis=0), (P.shape[1], 1))
    b = _fitted(P, T, weights * fixed, held, c, b)
    b = _fitted(P, T, weights, ~held, c, b)
    gap = np.where(fixed, 0.0, c - P @ b)
    square = P.copy()
    square.data **= 2
    inverse = np.where(held, 0.0, 1.0 / (square.T @ weights))
    return _descend(P, T, multiply, inverse, gap, fixed)


def _descend(
    P: Any, T: Any, multiply: Product, inverse: FloatArray, gap: FloatArray, fixed: AnyArray
) -> float:
    """Least square of gap - P b in the energy after some steps."""
    force = multiply(gap)
    r = T @ force
    p = z = inverse * r
    rz = float((r * z).sum())
    for _ in range(STEPS):
        step = np.where(fixed, 0.0, P @ p)
        pull = multiply(step)
        stiff = float((step * pull).sum())
        if not (stiff > 0 and rz > 0):
            break
        gap, force = gap - rz / stiff * step, force - rz / stiff * pull
        r = T @ force
        z = inverse * r
        old, rz = rz, float((r * z).sum())
        p = z + rz / old * p
    return max(float((gap * force).sum()), 0.0)


def _fitted(
    P: Any, T: Any, weights: FloatArray, free: AnyArray, c: FloatArray, b: FloatArray
) -> FloatArray:
    """Coefficients b with those that are free fitted to P b = c in the weighted mean square."""
    if not free.any():
        return b
    square = P.copy()
    square.data **= 2
    inverse = square.T @ weights
    free = free & (inverse > 0)
    inverse = np.where(free, 1.0 / np.where(free, inverse, 1.0), 0.0)
    r = T @ (weights * (c - P @ b))
    p = z = inverse * r
    rz = first = (r * z).sum(axis=0)
    for _ in range(FIRST):
        if (rz <= DIGITS**2 * first).all():
            break
        q = T @ (weights * (P @ p))
        step = _ratio(rz, (p * q).sum(axis=0))
        b, r = b + step * p, r - step * q
        z = inverse * r
        old, rz = rz, (r * z).sum(axis=0)
        p = z + _ratio(rz, old) * p
    return b


def _ratio(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.where(b > 0, a / np.where(b > 0, b, 1.0), 0.0)
