"""The parameters of points: nearest seeds from a k-d tree, then a damped Newton search.

Guarantees: a row that is found satisfies ``|x(u) - x| <= tol * size`` with ``u`` in the domain;
every row carries a status, and failures are counted, never silent. Points outside the rigorous
enclosure of the image (Bernstein ranges of its pieces) are told from its seeds at once.
Non-guarantees: nearness to a seed picks one branch of a map that overlaps itself; next to places
where det J = 0 the parameter is as ill-determined as the map is flat there.
"""

import warnings
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.spatial import KDTree

from ilattice._typing import FloatArray, IntArray
from ilattice._validate import as_positive
from ilattice.bspline import BSpline
from ilattice.errors import PrecisionWarning

__all__ = ["Located", "Seeds", "locate"]

FOUND, OUTSIDE, FAILED = 0, 1, 2
#: Iterations of one search, and nearest seeds among which further starts are chosen.
_ITERATIONS, _NEIGHBOURS, _STARTS = 60, 32, 4
#: Cosine of the residual to every free direction below which a search has come to its end.
_STATIONARY = 1e-4
#: Seeds of one map at most, unless its elements alone are more.
_MOST_SEEDS = 200_000


@dataclass(frozen=True, eq=False)
class Located:
    """What `locate` found.

    Attributes
    ----------
    u : ndarray, shape (n, 3)
        Parameters; NaN unless found.
    status : ndarray of int, shape (n,)
        0 found, 1 outside the image, 2 the search failed.
    distance : ndarray, shape (n,)
        ``|x(u) - x|`` of the last iterate; infinite where the enclosure excluded the point.
    iterations : ndarray of int, shape (n,)
        Newton steps, over all starts.
    """

    u: FloatArray = field(repr=False)
    status: IntArray = field(repr=False)
    distance: FloatArray = field(repr=False)
    iterations: IntArray = field(repr=False)

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


class Seeds:
    """Sample points of a volume with a k-d tree, made once per map.

    Parameters
    ----------
    spline : BSpline
        Volume with three components.
    closed : tuple of bool
        Directions in which parameters wrap around.
    size : float
        Length that tolerances refer to.
    """

    def __init__(self, spline: BSpline, closed: tuple[bool, bool, bool], size: float) -> None:
        self.spline, self.size = spline, size
        self.closed = np.array(closed)
        self.lo, self.hi = spline.domain
        edges = [_cells(spline, axis, fine=True) for axis in range(3)]
        if np.prod([len(e) - 1 for e in edges]) > _MOST_SEEDS:
            edges = [_cells(spline, axis, fine=False) for axis in range(3)]
        self.shape = np.array([len(e) - 1 for e in edges])
        index = np.indices(tuple(self.shape.tolist())).reshape(3, -1)
        self.first = np.stack([e[:-1][i] for e, i in zip(edges, index, strict=True)], axis=1)
        self.last = np.stack([e[1:][i] for e, i in zip(edges, index, strict=True)], axis=1)
        self.index: IntArray = np.ascontiguousarray(index.T)
        self.u = 0.5 * (self.first + self.last)
        self.x = spline(self.u)

    @cached_property
    def tree(self) -> KDTree:
        """Tree of the sample points."""
        return KDTree(self.x)

    @cached_property
    def reach(self) -> float:
        """Every point of the image is at most this far from a seed (rigorous)."""
        s = self.spline
        reach = np.zeros(len(self.u))
        for c in range(3):
            part = BSpline(s.t, s.c[..., c], s.k, periodic=s.periodic, weights=s.weights)
            ends = part.range(self.first, self.last)
            reach += np.max(np.abs(ends - self.x[:, c, None]), axis=1) ** 2
        return float(np.sqrt(reach.max()))

    def wrap(self, u: FloatArray) -> FloatArray:
        """`u` in the domain: closed directions wrap around, others are cut off."""
        period = self.hi - self.lo
        turned = self.lo + np.mod(u - self.lo, period)
        return np.where(self.closed, turned, np.clip(u, self.lo, self.hi))

    def apart(self, i: IntArray, j: IntArray) -> IntArray:
        """Distance of seeds in cells, the largest over the directions."""
        gap = np.abs(self.index[i] - self.index[j])
        gap = np.where(self.closed, np.minimum(gap, self.shape - gap), gap)
        return gap.max(axis=-1)


def _cells(spline: BSpline, axis: int, *, fine: bool) -> FloatArray:
    """Cell edges of the seeds: each element divided a few times."""
    b = spline.breaks(axis)
    parts = max(2 * spline.k[axis], -(-6 // (len(b) - 1))) if fine else 1
    inner = b[:-1, None] + np.diff(b)[:, None] * (np.arange(parts) / parts)
    return np.append(inner.ravel(), b[-1])


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
    limit = as_positive("tol", tol) * seeds.size
    n = len(x)
    out = Located(
        np.full((n, 3), np.nan), np.full(n, OUTSIDE), np.full(n, np.inf), np.zeros(n, np.int64)
    )
    if n == 0:
        return out
    distance, nearest = (np.asarray(a) for a in seeds.tree.query(x))
    todo = np.flatnonzero(distance <= seeds.reach + limit)
    out.status[todo] = FAILED
    todo = _attempt(seeds, x, todo, nearest[todo], limit, out)
    if len(todo):
        near = np.asarray(seeds.tree.query(x[todo], k=min(_NEIGHBOURS, len(seeds.u)))[1])
        near = near.reshape(len(todo), -1)
        tried = near[:, :1]
        for _ in range(_STARTS - 1):
            pick, some = _next_start(seeds, near, tried, out.status[todo])
            if not some.any():
                break
            left = _attempt(seeds, x, todo[some], pick[some], limit, out)
            tried = np.concatenate([tried, pick[:, None]], axis=1)
            stay = np.isin(todo, left) | ~some
            todo, near, tried = todo[stay], near[stay], tried[stay]
    return out


def _next_start(
    seeds: Seeds, near: IntArray, tried: IntArray, status: IntArray
) -> tuple[IntArray, np.ndarray]:
    """Nearest seed on another branch than those tried; after a failure any other seed."""
    gap = seeds.apart(near[:, :, None], tried[:, None, :]).min(axis=2)
    fresh = gap > np.where(status == FAILED, 0, 3)[:, None]
    pick = np.argmax(fresh, axis=1)
    rows = np.arange(len(near))
    return near[rows, pick], fresh[rows, pick]


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
    seeds: Seeds, x: FloatArray, u: FloatArray, limit: float
) -> tuple[FloatArray, FloatArray, np.ndarray, IntArray]:
    """Levenberg-Marquardt on the box for ``|x(u) - x|``, all points side by side.

    Returns parameters, distances, whether the search ended in a stationary point, and steps.
    """
    n = len(x)
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
        step, turn = _step(seeds, u[live], J[live], r[live], damping[live])
        trial = seeds.wrap(u[live] + step)
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
    seeds: Seeds, u: FloatArray, J: FloatArray, r: FloatArray, damping: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Damped Gauss-Newton step in the directions that the box leaves free.

    Also the largest cosine between the residual and a free direction: zero where the distance
    is stationary.
    """
    g = np.einsum("nck,nc->nk", J, r)
    stuck = ((u <= seeds.lo) & (g > 0)) | ((u >= seeds.hi) & (g < 0))
    free = ~stuck | seeds.closed
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
