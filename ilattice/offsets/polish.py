"""Move points onto the surface at a given distance from the mid-surface of a lattice.

Guarantees: fixed coordinates do not change; a point whose closest point is lost keeps its place
and is reported. Near a crease, where two feet are equally near, a step satisfies both.
Non-guarantee: in the narrow gap of two facing sheets a point may stop short.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ilattice._geometry import within
from ilattice._typing import AnyArray, FloatArray, IntArray
from ilattice.bspline import BSpline
from ilattice.offsets._kernels_newton import FALLBACK
from ilattice.offsets._small import solved
from ilattice.offsets.feet import ClosestPoints

if TYPE_CHECKING:
    from ilattice.offsets.mid_surface import MidSurface

#: Searches for closest points where a spline has told about where feet are, and for the rest; after
#: each of them but the last, and the very first of the rest, steps that go by the feet known then.
TOLD, ROUNDS, FOLLOWED = 2, 4, 4
#: Part of the distance by which a point may be off by the foot that was told, or it is another one.
AGREES = 0.1
#: Searches for what is left.
STEPS = 12
#: Residual at which a point is left alone, relative to the largest distance.
LIMIT = 1e-7
#: Least sine squared of the angle between two feet that are both satisfied.
APART = 1e-3
#: Longest step, relative to the residual.
LONGEST = 5.0


def polish(
    lattice: MidSurface,
    u: FloatArray,
    fixed: AnyArray,
    side: FloatArray,
    d: BSpline,
    distance: BSpline | None = None,
    near: BSpline | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Move points onto the surface at distance `d` from the mid-surface.

    Parameters
    ----------
    lattice : Lattice
        The lattice.
    u : ndarray, shape (n, 3)
        Parameters, near that surface.
    fixed : ndarray of bool, shape (n, 3)
        Coordinates that must not change.
    side : ndarray, shape (n,)
        +1 or -1: the sign of the distance.
    d : BSpline
        Asked distance as a function of the parameters.
    distance : BSpline, optional
        Signed distance spline to go by instead of closest points.
    near : BSpline, optional
        Signed distance spline that tells about where closest points are.

    Returns
    -------
    tuple of ndarray
        New parameters (n, 3), wrapped into the domain in closed directions, and the last
        | |distance| - d | (n,), infinite where a point was lost and kept its place.
    """
    out = u.copy()
    residual = np.full(len(u), np.inf)
    scale = lattice.search.seeds.spacing.min() if distance is None else np.abs(distance.c).max()
    limit = LIMIT * max(float(np.abs(d.c).max()), 1e-3 * float(scale))
    # in each but the first one the rest again, from the start
    stages = ((TOLD, FOLLOWED), (ROUNDS, FOLLOWED), (STEPS, 0))
    told = near is not None
    for rounds, followed in stages[2 if distance is not None else 0 if told else 1 :]:
        at = np.flatnonzero(~(residual <= limit))
        known: ClosestPoints | None = None
        out[at] = u[at]
        if told and near is not None:
            at, out, known = _told(lattice, u, fixed, side, d, near)
        for i in range(rounds):
            if len(at) == 0:
                break
            here = out[at], fixed[at], side[at], d
            step, error, known = _step(lattice, *here, distance, known, thorough=i == 0)
            residual[at] = error
            out[at[np.isinf(error)]] = u[at[np.isinf(error)]]
            go = np.isfinite(error) & (error > limit)
            at = at[go]
            known = None if known is None else known.rows(go)
            out[at] = inside(lattice, out[at] + step[go])
            if followed and (told or i > 0) and i < rounds - 1 and len(at) and known is not None:
                out[at], known = _followed(lattice, out[at], fixed[at], side[at], d, known, limit)
        told = False
    return out, residual


def _told(
    lattice: MidSurface, u: FloatArray, fixed: AnyArray, side: FloatArray, d: BSpline, near: BSpline
) -> tuple[IntArray, FloatArray, ClosestPoints]:
    """Points after a step by the feet to which those lead that a distance spline tells.

    Which of them have such feet, all of them, of which others stay, and these feet.
    """
    value, gradient = near.jet(u, 1)
    jacobian = lattice.through.jacobian(u)
    way = solved(np.einsum("nca,ncb->nab", jacobian, jacobian), gradient[:, :, None])[:, :, 0]
    slope = np.sqrt((gradient * way).sum(axis=1))
    with np.errstate(divide="ignore", invalid="ignore"):
        way *= (value / slope)[:, None]
    start = inside(lattice, u - np.where(np.isfinite(way), way, 0.0))
    none = np.full((len(u), 3), np.nan), np.full(len(u), np.inf), np.zeros(len(u), np.int64)
    known = ClosestPoints(
        none[0], start, none[1], none[2], none[2], none[2], none[0], none[1], none[0], start
    )
    step, error, found = _step(lattice, u, fixed, side, d, None, known, follow=True)
    assert found is not None
    at = np.flatnonzero(error <= AGREES * np.abs(d(u)))
    out = u.copy()
    out[at] = inside(lattice, u[at] + step[at])
    return at, out, found.rows(at)


def _followed(
    lattice: MidSurface, u: FloatArray, fixed: AnyArray, side: FloatArray, d: BSpline,
    known: ClosestPoints, limit: float,
) -> tuple[FloatArray, ClosestPoints]:  # fmt: skip
    """Points moved on as if no feet were nearer than those that are known, and these feet."""
    least = np.full(len(u), np.inf)
    at = np.arange(len(u))
    for _ in range(FOLLOWED):
        here = u[at], fixed[at], side[at], d, None
        step, error, found = _step(lattice, *here, known.rows(at), follow=True)
        assert found is not None
        known = known.replaced(at, found)
        go = (error > limit) & (error < least[at])
        least[at] = np.minimum(least[at], error)
        at = at[go]
        if len(at) == 0:
            break
        u[at] = inside(lattice, u[at] + step[go])
    return u, known


def distance_jet(
    lattice: MidSurface, u: FloatArray, x: FloatArray, jacobian: FloatArray
) -> tuple[FloatArray, FloatArray, AnyArray]:
    """Signed distance by closest points, its gradient in u, and where there is none.

    Parameters
    ----------
    lattice : Lattice
        The lattice.
    u : ndarray, shape (n, 3)
        Parameters.
    x, jacobian : ndarray, shape (n, 3) and (n, 3, 3)
        Their images and the derivatives of the map there.

    Returns
    -------
    tuple of ndarray
        Distances (n,), gradients (n, 3), and True (n,) where the search failed.
    """
    found = lattice.search.query(u, strict=False, thorough=True)
    values, gradients = _by_closest_points(lattice, found, x, jacobian)
    lost = found.status >= FALLBACK
    return values[0], gradients[0], lost


def inside(lattice: MidSurface, u: FloatArray) -> FloatArray:
    """Parameters wrapped in closed directions, and clipped in the others.

    Parameters
    ----------
    lattice : Lattice
        Gives the domain, and which directions are closed.
    u : ndarray, shape (n, 3)
        Parameters.

    Returns
    -------
    ndarray, shape (n, 3)
        Parameters in the domain.
    """
    lo, hi = lattice.domain
    return within(u, lo, hi, np.array(lattice.through.closed))


def shortest(lattice: MidSurface, way: FloatArray) -> FloatArray:
    """Ways (n, 3) between parameters, across the seam of closed directions where shorter."""
    closed = np.array(lattice.through.closed)
    period = np.ptp(lattice.domain, axis=0)
    out: FloatArray = np.where(closed, way - period * np.round(way / period), way)
    return out


def _step(
    lattice: MidSurface,
    u: FloatArray,
    fixed: AnyArray,
    side: FloatArray,
    d: BSpline,
    distance: BSpline | None,
    known: ClosestPoints | None,
    *,
    follow: bool = False,
    thorough: bool = False,
) -> tuple[FloatArray, FloatArray, ClosestPoints | None]:
    """Least step in space, within the free coordinates, the residual before it, and feet."""
    x, jacobian = lattice.through.jet(u, 1)
    asked, slope = d.jet(u, 1)
    found, lost = None, np.zeros(len(u), bool)
    if distance is None:
        found = (
            lattice.search.follow(u, known)
            if follow and known is not None
            else lattice.search.query(u, strict=False, known=known, thorough=thorough)
        )
        values, gradients = _by_closest_points(lattice, found, x, jacobian)
        lost = found.status >= FALLBACK
    else:
        value, gradient = distance.jet(u, 1)
        values, gradients = [value], [gradient]
    free = ~fixed
    metric = np.einsum("nca,ncb->nab", jacobian, jacobian)
    metric *= free[:, :, None] & free[:, None, :]
    metric += fixed[:, :, None] * np.eye(3)
    f = [side * v - asked for v in values]
    a = [(side[:, None] * g - slope) * free for g in gradients]
    step = _least_step(metric, a[0], f[0], a[-1], f[1] if len(f) > 1 else np.full(len(u), np.inf))
    size = np.sqrt(np.maximum(np.einsum("na,nab,nb->n", step, metric, step), 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        step *= np.minimum(1.0, LONGEST * np.abs(f[0]) / size)[:, None]
    return np.where(np.isfinite(step), step, 0.0), np.where(lost, np.inf, np.abs(f[0])), found


def _by_closest_points(
    lattice: MidSurface, found: ClosestPoints, x: FloatArray, jacobian: FloatArray
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Signed distances to the two nearest feet, and their gradients in u."""
    apart = np.flatnonzero(np.isfinite(found.second_distance))  # few: the rest has one foot
    first = np.einsum("nca,nc->na", jacobian, _gradients(lattice, found, x))
    away = (x[apart] - found.second[apart]) / found.second_distance[apart, None]
    other = np.zeros_like(first)
    other[apart] = np.einsum("nca,nc->na", jacobian[apart], away)
    second = np.full(len(x), np.inf)
    second[apart] = found.second_distance[apart]
    return [found.distance, second], [first, other]


def _gradients(lattice: MidSurface, found: ClosestPoints, x: FloatArray) -> FloatArray:
    """Gradient of the signed distance in space: along x - foot; on the mid-surface, its normal."""
    tiny = np.abs(found.distance) <= 1e-6 * lattice.search.seeds.spacing.min()
    out: FloatArray = (x - found.foot) / np.where(tiny, 1.0, found.distance)[:, None]
    if tiny.any():
        u = found.u[tiny]
        g = lattice.implicit_jet(u, 1)[1]
        jacobian = lattice.through.jacobian(u, extrapolate="extend")
        n = solved(jacobian.transpose(0, 2, 1), g[:, :, None])[:, :, 0]
        size = np.linalg.norm(n, axis=1, keepdims=True)
        out[tiny] = n / np.where(size > 0.0, size, 1.0)  # singular points have no normal
    return out


def _least_step(
    metric: FloatArray, a: FloatArray, f: FloatArray, b: FloatArray, g: FloatArray
) -> FloatArray:
    """Least step s with a.s = -f, and b.s = -g where the first alone would leave b.s < -g.

    There is no second condition where g is not finite.
    """
    near, ib = np.flatnonzero(np.isfinite(g)), np.zeros_like(b)
    with np.errstate(divide="ignore", invalid="ignore"):
        ia = solved(metric, a[:, :, None])[:, :, 0]
        ib[near] = solved(metric[near], b[near, :, None])[:, :, 0]
        aa, ab, bb = ((v * w).sum(axis=1) for v, w in ((a, ia), (a, ib), (b, ib)))
        alone = -f / aa
        det = aa * bb - ab * ab
        both = np.isfinite(g) & (g + alone * ab < 0.0) & (det > APART * aa * bb)
        p = np.where(both, (-f * bb + g * ab) / det, alone)
        q = np.where(both, (-g * aa + f * ab) / det, 0.0)
        step: FloatArray = p[:, None] * ia + np.where(both, q, 0.0)[:, None] * np.where(
            both[:, None], ib, 0.0
        )
    return step
