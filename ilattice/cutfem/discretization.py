"""How much of the energy the cells miss: the solution against those on cells twice as long.

What finer cells would add is judged by what the cells at hand have added: the energy of the
difference between the solution and the best one on cells twice as long, and on those four times as
long. Where the two fall by a constant factor, as they do under refinement, the rest is a geometric
series (Richardson, 1911): of the whole, where it falls slowly, and of each part of the body, since
what a smooth part lets fall fast hides edges and joints, where it does not. The coarse spaces are
parts of the fine one (see `coarsening`), so that nothing is integrated again: the best
approximation there takes some products with the matrix that has been solved, a few hundredths of
the time of the solution. The energy of the penalty on jumps at cut cells counts in full: by
Galerkin's orthogonality the compliance that is missed is the energy of the error, penalty included,
and the exact solution jumps nowhere (Burman, Ghost penalty, 2010).

Guarantees: zero, up to rounding, for solutions that the coarse splines have, such as those of patch
tests; no smoothness and no recovery is supposed, so it is large where walls are a cell thick, and
estimates by recovered stresses are blind. What cannot be estimated, where a direction has a single
cell, is said and not passed over. Non-guarantees: an estimate, and no bound. It is right to a fifth
for beams and bodies of many cells; for walls of one or two cells at degree 2 it is three to ten
times too large. Above `SURE` it may be several times too small, where bodies hang on a patch of a
cell or two: all cells at hand are then too coarse to see it. Where volumes are kept (Poisson's
ratio 0.45 and above) it is up to fifty times too large from degree 2 on, since coarse splines
cannot follow: it then says that cells are coarse for that, not by how much. On fewer than eight
cells in every direction, which are one when joined twice, it is often four times too large: it has
to hold what such cells do not see. Errors of the geometry, of the map and of integration are not
in it: `CutGrid.error` and ``solution.report.integration_error`` tell the first and last. Splines
that are too stiff by k make the work of loads 1 / (1 + k) of what it should be, and what is seen of
it on coarse cells falls behind where k is large: see `of_work`, and `locking` for thin bars and
walls at degree 1, which look alike on all of these cells.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ilattice._typing import AnyArray, FloatArray
from ilattice.cutfem.coarsening import coarser
from ilattice.cutfem.space import SplineSpace
from ilattice.errors import PrecisionWarning

#: Relative error of the energy above which a solution comes with a warning.
WARNED = 0.02
#: Estimates above this may be too small by several times.
SURE = 0.1
#: Least factor by which the square of the error is taken to fall on half the cells: that of the
#: edges of a body (order two thirds); four, that of order one, is what smooth solutions reach.
MIN_FALL = 2.5
#: The same where it is seen to fall even more slowly; on few cells what is seen counts half.
SLOW = 1.75
#: Part of the energy that cells four times as long may miss: from more than that it cannot be seen
#: how fast the error falls.
SEEN = 0.3
#: The same above which the fall that is seen may only make an estimate larger, where cells four
#: times as long are one in a direction: from cells that miss a whole part of the body, errors seem
#: to fall faster than they go on to do.
TRUSTED = 0.15
#: The same of falls that are faster than order one with a margin, and by what errors are then taken
#: to go on to fall: what made them fall was resolved by one halving, what is left is rough.
HASTY, FASTER, LATER = 0.05, 5.0, 3.0
#: Least multiple, of what cells add, that is left where cells four times as long are one in every
#: direction: bores and necks of a cell are then seen no better by the cells at hand than by longer
#: ones, and a fall of errors between them says nothing. Of 176 random bodies on four to six cells
#: two missed 2.8 times what was seen, the others at most 1.7 times.
FEW_LEFT = 2.0
#: Steps towards the best approximation, in the energy, and, before, in the mean square of nodes.
STEPS, FIRST = 8, 40
#: Part of the distance by which a step must have come nearer for another one to be taken.
WORTH = 5e-3
#: Relative residual, in the norm of the preconditioner, at which a first solve ends.
DIGITS = 1e-7
#: Energies below this part of those of nodes that move one by one, relative to the nearest motion
#: of the whole or to where they were, and the latter alone, are what eight digits leave; where all
#: of the energy is, there is no error to tell.
ROUNDING, SOLVED = 1e-12, 1e-16
#: Energies up to this many times more have no digits that count.
FEW = 10.0

#: Part of the energy that is missed up to which the rest grows with it: splines that are too stiff
#: by k = C h², of an energy 1 / (1 + k), add less and less on coarse cells the stiffer they are, so
#: that what is seen stays below four times an energy, whatever k is.
STIFF = 0.5

Product = Callable[[FloatArray], FloatArray]
#: Displacements (n, m, k) without energy at points (n, 3).
Motions = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class Level:
    """Coarse splines as combinations of fine ones.

    Attributes
    ----------
    P : csr_array, shape (n, coarse)
        The combinations.
    T : csr_array, shape (coarse, n)
        Transposed.
    squares : csr_array, shape (coarse, n)
        Squares of the entries of T.
    shape : tuple of int
        Cells per direction.
    nodes : ndarray, shape (coarse, 3)
        Where the coarse functions are in space.
    """

    P: Any
    T: Any
    squares: Any
    shape: tuple[int, ...] = ()
    nodes: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))

    def moved(self, motions: Motions, c: FloatArray) -> FloatArray:
        """Coarse coefficients of the motion without energy that is nearest to c in the mean."""
        x = self.nodes - self.nodes.mean(axis=0)
        coarse = motions(x / max(float(np.abs(x).max()), np.finfo(np.float64).tiny))
        n, m, k = coarse.shape
        fine = (self.P @ coarse.reshape(n, m * k)).reshape(-1, k)
        q = np.zeros(k)
        for _ in range(2):  # the second time for what rounding has left
            rest = fine.T @ (c.ravel() - fine @ q)
            q += np.linalg.lstsq(fine.T @ fine, rest, rcond=None)[0]
        return np.asarray(coarse @ q)


class Levels:
    """Splines on cells twice and four times as long, made when they are asked for.

    Parameters
    ----------
    space : SplineSpace
        With links.
    nodes : callable
        Where the functions of a space are, (functions, 3).
    """

    def __init__(self, space: SplineSpace, nodes: Callable[[SplineSpace], FloatArray]) -> None:
        self._space, self._nodes = space, nodes

    @cached_property
    def _joined(self) -> tuple[SplineSpace, Any] | None:
        found = coarser(self._space)
        if found is None:
            return None
        pairs = zip(self._space.grid.shape, found[0].grid.shape, strict=True)
        return found if all(coarse < fine for fine, coarse in pairs) else None

    @cached_property
    def first(self) -> Level | None:
        """Cells twice as long.

        None if a direction has cells that cannot be joined: what finer cells in it would add is
        then not to be seen.
        """
        if self._joined is None:
            return None
        space, P = self._joined
        return _of_rows(P.tocsr(), space.grid.shape, self._nodes(space))

    @cached_property
    def second(self) -> Level | None:
        """Cells four times as long, in directions in which cells can be joined twice."""
        found = None if self._joined is None else coarser(self._joined[0])
        if found is None or self.first is None:
            return None
        space, P = found
        return _of_rows((self.first.P @ P).tocsr(), space.grid.shape, self._nodes(space))


def _of_rows(P: Any, *about: Any) -> Level:
    """A level, or some rows of it."""
    T = P.T.tocsr()
    return Level(P, T, T.multiply(T).tocsr(), *about)


def relative_error(
    levels: Levels, multiply: Product, motions: Motions, diagonal: FloatArray, c: FloatArray,
    fixed: AnyArray, energy: float, jumps: float = 0.0,
) -> float:  # fmt: skip
    """Part of an energy that finer cells would add, or take away.

    Parameters
    ----------
    levels : Levels
        The coarse splines.
    multiply : callable
        Product of the matrix with displacements (n, m), zero where they are prescribed.
    motions : callable
        Displacements without energy, or free of stress when heated, where coarse solutions are
        looked for first.
    diagonal : ndarray, shape (n, m)
        Its diagonal, any positive number where they are prescribed.
    c : ndarray, shape (n, m)
        Solution.
    fixed : ndarray of bool, shape (n, m)
        Prescribed components.
    energy : float
        What the error is relative to: twice the energy of the solution.
    jumps : float
        Part of it that the penalty on jumps takes.

    Returns
    -------
    float
        The estimate; NaN if there are no coarser cells.
    """
    if levels.first is None:
        return float("nan")
    free = np.where(fixed, 0.0, diagonal)
    if energy <= SOLVED * (free * c * c).sum():  # parts that move without strain
        return 0.0
    first = _distance(levels.first, multiply, motions, diagonal, c, fixed)
    lost, rest = first.sum(), first.sum() / (MIN_FALL - 1.0)
    # elsewhere longer cells lose more than that, unless errors fall by less than half, or nothing
    if 0.0 < lost < 0.5 * SEEN * energy and levels.second is not None:
        second = _distance(levels.second, multiply, motions, diagonal, c, fixed)
        if second.sum() < SEEN * energy:
            shape = levels.second.shape
            unsure = min(shape) == 1
            seen = _rest(levels.first, first, second, unsure=unsure)
            if second.sum() > max(HASTY * energy, FASTER * lost):
                seen = max(seen, lost / (LATER - 1.0))
            rest = max(seen, rest) if unsure and second.sum() > TRUSTED * energy else seen
            rest = max(rest, FEW_LEFT * lost) if max(shape) == 1 else rest
    whole = levels.first.P @ levels.first.moved(motions, c)
    moved = np.minimum((c - whole) ** 2, c * c)  # nodes of stiff springs stay in place
    noise = ROUNDING * (free * moved).sum() + SOLVED * (free * c * c).sum()
    if lost + jumps <= noise:
        return 0.0
    return float((rest + jumps) / max(energy, FEW * noise))


def of_work(error: float) -> float:
    """An estimate for the work of loads, which too stiff splines make small on all cells.

    Parameters
    ----------
    error : float
        That of `relative_error`.

    Returns
    -------
    float
        What is missed, as a part of the work at hand; next to the same where it is small.
    """
    return error / (1.0 - min(error, STIFF))


def _rest(level: Level, first: FloatArray, second: FloatArray, *, unsure: bool) -> float:
    """What finer cells would add, by what nodes lose on cells twice and four times as long.

    With `unsure` these are one in a direction, and a slow fall that they show counts half.
    """
    lost = first.sum()
    falls = (second.sum() - lost) / lost
    likely = 0.5 * (falls + MIN_FALL) if unsure else falls
    whole = lost / (max(falls, likely, SLOW) - 1.0)
    near, far = (np.maximum(level.T @ part, 0.0) for part in (first, second))
    factor = np.maximum(far - near, MIN_FALL * near) / np.where(near > 0.0, near, 1.0)
    parts = near / np.where(near > 0.0, factor - 1.0, 1.0)
    return float(max(whole, parts.sum() * lost / near.sum()))


def warn(
    error: float, what: str, space: SplineSpace, *, kept: bool = False, varies: bool = False,
    thin: bool = False,
) -> None:  # fmt: skip
    """Warn of an energy that is off, or of which it is not known by how much.

    With `kept` volumes are, which coarse splines cannot do as well as those at hand; a material
    that `varies` may jump at faces of cells, over which smooth splines do not bend. With `thin` it
    is solid parts that are thinner than cells which are too stiff, see `locking`.
    """
    if not (error > WARNED or np.isnan(error)):
        return
    more = ", a higher degree" * (space.degree < 3) + ", smoothness=0" * (space.smoothness > 0)
    if np.isnan(error):
        shape = " x ".join(str(n) for n in space.grid.shape)
        message = (
            f"the cells are too coarse to tell by how much {what} is off: {shape} cells; take two "
            f"or more in every direction, and {2 * (space.degree + 1)} or more in closed ones"
        )
    elif thin:
        much = f"{100 * error:.2g} %" if error < 1.0 else f"{error:.2g} times its own size"
        message = (
            f"the cells are too coarse: {what} is off by about {much}, as solid parts are thinner "
            "than cells, and splines of degree 1 are too stiff there in bending; take degree=2 or "
            "finer cells"
        )
    else:
        much = f"about {100 * error:.2g} % or less"
        if error > SURE or (varies and space.smoothness > 0):
            times = "many" if error > STIFF else "several"
            much = f"about {100 * error:.2g} %, or {times} times that"
        if error >= 1.0:
            much = "more than its own size"
        if kept and space.degree == 2:
            much = (
                f"up to {100 * error:.2g} %, often by a tenth of that as the material keeps volume"
            )
        message = (
            f"the cells are too coarse: {what} is off by {much}, estimated from cells twice and "
            f"four times as long; take finer cells{' or'.join(more.rsplit(',', 1))}"
        )
    warnings.warn(message, PrecisionWarning, stacklevel=4)


def _distance(
    level: Level, multiply: Product, motions: Motions, diagonal: FloatArray, c: FloatArray,
    fixed: AnyArray,
) -> FloatArray:  # fmt: skip
    """Square of the distance, in the energy, from a solution to coarse ones: parts (n,) of nodes.

    By conjugate gradients, which approach it from above.
    """
    held = (abs(level.T) @ fixed.astype(np.float64)) > 0
    weights = np.repeat(diagonal.mean(axis=1, keepdims=True), c.shape[1], axis=1)
    b = level.moved(motions, c)
    rows = np.flatnonzero(fixed.any(axis=1))
    if len(rows):
        b = _fitted(_of_rows(level.P[rows]), (weights * fixed)[rows], held, c[rows], b)
    b = _fitted(level, weights, ~held, c, b)
    gap = np.where(fixed, 0.0, c - level.P @ b)
    inverse = np.where(held, 0.0, 1.0 / (level.squares @ weights))
    return _descend(level, multiply, inverse, gap, fixed)


def _descend(
    level: Level, multiply: Product, inverse: FloatArray, gap: FloatArray, fixed: AnyArray
) -> FloatArray:
    """Least square of gap - P b in the energy after some steps, parts (n,) of nodes."""
    force = multiply(gap)
    energy = float((gap * force).sum())
    r = level.T @ force
    p = z = inverse * r
    rz = float((r * z).sum())
    for _ in range(STEPS):
        step = np.where(fixed, 0.0, level.P @ p)
        pull = multiply(step)
        stiff = float((step * pull).sum())
        if not (stiff > 0 and rz > 0):
            break
        gap, force = gap - rz / stiff * step, force - rz / stiff * pull
        r = level.T @ force
        z = inverse * r
        old, rz = rz, float((r * z).sum())
        p = z + rz / old * p
        energy = float((gap * force).sum())
        if old * old / stiff < WORTH * energy:
            break
    parts = (gap * force).sum(axis=1)
    return np.asarray(parts if energy > 0.0 else np.zeros_like(parts))


def _fitted(
    level: Level, weights: FloatArray, free: AnyArray, c: FloatArray, b: FloatArray
) -> FloatArray:
    """Coefficients b with those that are free fitted to P b = c in the weighted mean square."""
    if not free.any():
        return b
    inverse = level.squares @ weights
    free = free & (inverse > 0)
    inverse = np.where(free, 1.0 / np.where(free, inverse, 1.0), 0.0)
    gap = c - level.P @ b
    r = level.T @ (weights * gap)
    rest = (weights * gap * gap).sum(axis=0)
    p = z = inverse * r
    rz = first = (r * z).sum(axis=0)
    for _ in range(FIRST):
        if (rz <= DIGITS**2 * first).all():
            break
        q = level.T @ (weights * (level.P @ p))
        step = _ratio(rz, (p * q).sum(axis=0))
        b, r, nearer = b + step * p, r - step * q, step * rz
        rest = np.maximum(rest - nearer, 0.0)
        if (nearer <= WORTH * rest).all():  # never where coarse splines have the solution
            break
        z = inverse * r
        old, rz = rz, (r * z).sum(axis=0)
        p = z + _ratio(rz, old) * p
    return b


def _ratio(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.where(b > 0, a / np.where(b > 0, b, 1.0), 0.0)
