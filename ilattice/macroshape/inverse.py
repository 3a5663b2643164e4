"""The parameters of points: seeds from a k-d tree, then a damped Newton search.

Where tangents of a map jump, at knots as often as its degree, a search from one side of the knot
may not settle on the other one: what is left then is searched for in each smooth piece by itself.

Guarantees: a row that is found satisfies ``|x(u) - x| <= tol * size`` with ``u`` in the domain.
A point counts as outside only if it lies in none of the rigorous boxes around the pieces of the
image, or if searches from the pieces of every branch whose boxes hold it ended at a place where
the distance is stationary and not zero. All other rows are failures, which are counted.
Non-guarantees: where a map overlaps itself, one of the parameters is returned; inside a folded
map a search may end between the folds; next to places where det J = 0 the parameter is as
ill-determined as the map is flat there.
"""

import warnings
from dataclasses import dataclass

import numpy as np

from ilattice._geometry import within
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice._validate import Frozen, as_positive
from ilattice.errors import InputError, PrecisionWarning
from ilattice.macroshape._seeds import CHUNK, Seeds

__all__ = ["Located", "locate"]

#: What became of a point.
FOUND, OUTSIDE, FAILED = 0, 1, 2
#: Iterations of one search, and searches for one point at most.
_ITERATIONS, _STARTS = 60, 12
#: Starts in each smooth piece of a map with a box that holds the point, where searches across have
#: failed, and how many are made at once.
_IN_PIECES, _TOGETHER = 3, 1 << 15
#: Cosine of the residual to every free direction below which a search has come to its end.
_STATIONARY = 1e-4
#: Coordinates beyond which distances overflow.
FAR = 1e150


@dataclass(frozen=True, eq=False)
class Located(Frozen):
    """What `locate` found.

    Attributes
    ----------
    u : ndarray, shape (n, 3)
        Parameters; NaN unless found.
    status : ndarray of int, shape (n,)
        0 found, 1 outside the image, 2 the search failed.
    distance : ndarray, shape (n,)
        ``|x(u) - x|`` of the best iterate; infinite where the boxes excluded the point and
        nothing was searched.
    iterations : ndarray of int, shape (n,)
        Newton steps, over all starts.
    """

    u: FloatArray
    status: IntArray
    distance: FloatArray
    iterations: IntArray

    def __repr__(self) -> str:
        """One line: how many points, and how many searches failed."""
        return f"Located({len(self.u)} points, {self.failures} failures)"

    def __post_init__(self) -> None:
        """Leave the arrays open to the search; `SplineMap.locate` closes them."""

    @property
    def failures(self) -> int:
        """How many searches failed."""
        return int(np.count_nonzero(self.status == FAILED))

    def warn(self) -> None:
        """Warn of failed searches."""
        if self.failures:
            first = np.flatnonzero(self.status == FAILED)[:5].tolist()
            warnings.warn(
                f"inverse: the search failed for {self.failures} of {len(self.u)} points, "
                f"first rows {first}; these are NaN",
                PrecisionWarning,
                stacklevel=3,
            )


def locate(seeds: Seeds, x: FloatArray, *, tol: float) -> Located:
    """Parameters of points, see `SplineMap.locate`.

    Parameters
    ----------
    seeds : Seeds
        The volume.
    x : ndarray, shape (n, 3)
        Points.
    tol : float
        Relative to ``seeds.size``.

    Returns
    -------
    Located
        One row per point.
    """
    if as_positive("tol", tol) > 1.0:
        raise InputError(f"tol must be at most 1, it is relative to the size, got {tol:g}")
    limit = tol * seeds.size
    n, x = len(x), np.clip(x, -FAR, FAR)
    out = Located(
        np.full((n, 3), np.nan), np.full(n, FAILED), np.full(n, np.inf), np.zeros(n, np.int64)
    )
    if n == 0:
        return out
    distance, nearest = (np.asarray(a) for a in seeds.tree.query(x))
    near = distance <= seeds.reach[nearest] + limit
    left = _attempt(seeds, x, np.flatnonzero(near), nearest[near], limit, out)
    todo = np.concatenate([np.flatnonzero(~near), left])
    tried = np.concatenate([np.full(n - near.sum(), -1), nearest[left]])
    for first in range(0, len(todo), CHUNK):
        part = slice(first, first + CHUNK)
        _attempt_all(seeds, x, todo[part], tried[part], limit, out)
    return out


def _attempt_all(
    seeds: Seeds, x: FloatArray, todo: IntArray, tried: IntArray, limit: float, out: Located
) -> None:
    """Search from one cell of every branch whose box holds the point."""
    row, cell = seeds.candidates(x[todo], limit)
    count = np.bincount(row, minlength=len(todo))
    out.status[todo[count == 0]] = OUTSIDE
    if len(row) == 0:
        return
    cells = np.full((len(todo), count.max()), -1)
    cells[row, np.arange(len(row)) - (np.cumsum(count) - count)[row]] = cell
    keep = count > 0
    _by_branches(seeds, x, todo[keep], cells[keep], tried[keep, None], limit, out)
    if seeds.kinked:
        left = out.status[todo[row]] != FOUND
        _by_pieces(seeds, x, todo[row[left]], cell[left], limit, out)


def _by_branches(
    seeds: Seeds, x: FloatArray, todo: IntArray, cells: IntArray, tried: IntArray, limit: float,
    out: Located,
) -> None:  # fmt: skip
    """Search from one of the cells (n, k) of each branch, but those that have been tried."""
    for _ in range(_STARTS):
        pick, fresh = _next_start(seeds, cells, tried, out.status[todo])
        if not fresh.any():
            return
        todo, cells, tried, pick = todo[fresh], cells[fresh], tried[fresh], pick[fresh]
        left = np.isin(todo, _attempt(seeds, x, todo, pick, limit, out))
        tried = np.concatenate([tried, pick[:, None]], axis=1)
        todo, cells, tried = todo[left], cells[left], tried[left]
    out.status[todo[_next_start(seeds, cells, tried, out.status[todo])[1]]] = FAILED


def _by_pieces(
    seeds: Seeds, x: FloatArray, rows: IntArray, cells: IntArray, limit: float, out: Located
) -> None:
    """Search within smooth pieces for points `rows`, with a cell each whose box holds the point.

    They are sorted by points, nearest cells first. Points are outside where all searches ended.
    """
    if len(rows) == 0:
        return
    order = np.lexsort((np.arange(len(rows)), seeds.piece[cells], rows))
    pair = np.stack([rows, seeds.piece[cells]], axis=1)[order]
    first = np.flatnonzero(np.append(True, (pair[1:] != pair[:-1]).any(axis=1)))
    rank = np.arange(len(pair)) - np.repeat(first, np.diff(np.append(first, len(pair))))
    at = order[rank < _IN_PIECES]
    rows, cells = rows[at], cells[at]
    parts = [slice(i, i + _TOGETHER) for i in range(0, len(rows), _TOGETHER)]
    found = [
        _search(seeds, x[rows[p]], seeds.u[cells[p]], limit, seeds.room[:, seeds.piece[cells[p]]])
        for p in parts
    ]
    u, distance, stalled, steps = (np.concatenate(a) for a in zip(*found, strict=True))
    np.add.at(out.iterations, rows, steps)
    order = np.lexsort((distance, rows))
    row, best = np.unique(rows[order], return_index=True)
    best = order[best]
    nearer = distance[best] < out.distance[row]
    out.distance[row[nearer]] = distance[best[nearer]]
    hit = distance[best] <= limit
    out.u[row[hit]] = u[best[hit]]
    running = np.isin(row, rows[~stalled])
    out.status[row] = np.where(hit, FOUND, np.where(running, FAILED, OUTSIDE))


def _next_start(
    seeds: Seeds, cells: IntArray, tried: IntArray, status: IntArray
) -> tuple[IntArray, np.ndarray]:
    """First cell on another branch than those tried; after a failure any other cell.

    Missing entries are -1. Also whether there is such a cell.
    """
    gap = seeds.apart(cells[:, :, None], tried[:, None, :])
    gap = np.where(tried[:, None, :] < 0, np.iinfo(np.int64).max, gap).min(axis=2)
    fresh = (gap > np.where(status == FAILED, 0, 2)[:, None]) & (cells >= 0)
    pick = np.argmax(fresh, axis=1)
    rows = np.arange(len(cells))
    return cells[rows, pick], fresh[rows, pick]


def _attempt(
    seeds: Seeds, x: FloatArray, rows: IntArray, start: IntArray, limit: float, out: Located
) -> IntArray:
    """Search from the given seeds, enter what was found, and return the rows that are left."""
    u, distance, stalled, count = _search(seeds, x[rows], seeds.u[start], limit)
    out.iterations[rows] += count
    nearer = distance < out.distance[rows]
    out.distance[rows[nearer]] = distance[nearer]
    found = distance <= limit
    out.u[rows[found]] = u[found]
    ended = stalled | (out.status[rows] == OUTSIDE)
    out.status[rows] = np.where(found, FOUND, np.where(ended, OUTSIDE, FAILED))
    return rows[~found]


def _search(
    seeds: Seeds, x: FloatArray, u: FloatArray, limit: float, room: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, np.ndarray, IntArray]:
    """Levenberg-Marquardt on the box for ``|x(u) - x|``, all points side by side.

    In the domain, or where each point may be, `room` (2, n, 3).
    Returns parameters, distances, whether the search ended in a stationary point, and steps.
    """
    n = len(x)
    closed = seeds.closed if room is None else np.zeros(3, np.bool_)
    lo, hi = np.broadcast_to(seeds.domain[:, None], (2, n, 3)) if room is None else room
    u = u.copy()
    y, J = seeds.spline.jet(u, 1)
    r = y - x
    f = (r**2).sum(axis=1)
    damping = np.zeros(n)
    count = np.zeros(n, np.int64)
    stalled = np.zeros(n, dtype=bool)
    polish = np.full(n, 2)  # steps after the limit is met: quadratic convergence to rounding
    live = np.arange(n)
    before = f.copy()
    for i in range(_ITERATIONS):
        bounds = lo[live], hi[live], closed
        step, turn = _step(u[live], J[live], r[live], damping[live], *bounds)
        trial = within(u[live] + step, *bounds)
        y, jac = seeds.spline.jet(trial, 1)
        residual = y - x[live]
        g = (residual**2).sum(axis=1)
        better = g < f[live]
        take = live[better]
        u[take], J[take], r[take], f[take] = trial[better], jac[better], residual[better], g[better]
        damping[live] = np.where(better, 0.1 * damping[live], np.maximum(8 * damping[live], 1e-3))
        damping[damping < 1e-6] = 0
        count[live] += 1
        met = f[live] <= limit**2
        polish[live[met]] -= 1
        stalled[live] = (turn < _STATIONARY) | (damping[live] > 1e12)
        if i % 10 == 9:  # creeping along a face towards a distance that is not zero
            stalled[live] |= f[live] > 0.95 * before[live]
            before[live] = f[live]
        live = live[np.where(met, (polish[live] > 0) & better, ~stalled[live])]
        if len(live) == 0:
            break
    return u, np.sqrt(f), stalled, count


def _step(
    u: FloatArray, J: FloatArray, r: FloatArray, damping: FloatArray, lo: FloatArray,
    hi: FloatArray, closed: AnyArray,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Damped Gauss-Newton step in the directions that the box leaves free.

    Also the largest cosine between the residual and a free direction: zero where the distance
    is stationary.
    """
    g = np.einsum("nck,nc->nk", J, r)
    stuck = ((u <= lo) & (g > 0)) | ((u >= hi) & (g < 0))
    free = ~stuck | closed
    J = np.where(free[:, None, :], J, 0.0)
    N = np.einsum("nck,ncl->nkl", J, J)
    size = np.einsum("nkk->nk", N)
    floor = 1e-15 * size.max(axis=1, keepdims=True) + np.finfo(float).tiny
    added = np.where(free, damping[:, None] * size + floor, 1.0)
    N[:, [0, 1, 2], [0, 1, 2]] += added
    g = np.where(free, g, 0.0)
    length = np.sqrt(size * (r**2).sum(axis=1, keepdims=True))
    turn = np.divide(np.abs(g), length, out=np.zeros_like(g), where=length > 0).max(axis=1)
    return -np.linalg.solve(N, g[..., None])[..., 0], turn
