"""How thick a solid is from place to place: twice the radius of the balls that touch it inside.

From points of the surface balls grow inwards until they touch it elsewhere (the shrinking-ball
algorithm: Ma, Bae and Choi, The Visual Computer 28, 2012). Their radii are distances to the medial
axis: half the thickness of plates, the radius of struts and necks.

Guarantee: radii come from closest points, not from the distance spline. Non-guarantees: `FRACTION`
of the surface may be thinner than what `least_of` says, as it is next to sharp edges; balls that
reach the faces of the domain first do not count.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ilattice._typing import FloatArray
from ilattice.offsets.polish import inside

if TYPE_CHECKING:
    from ilattice.offsets.mid_surface import MidSurface

#: Points of the surface at most, how often balls shrink, and steps of the way to their centres.
POINTS, SHRINKS, STEPS = 2000, 12, 6
#: Part of the surface that may be thinner.
FRACTION = 0.1
#: Part of a radius by which a ball may be cut, and that a centre may be off.
TOUCH, OFF = 0.01, 0.02


def depths_of(lattice: MidSurface, deepest: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Radii of the largest balls inside of the tiles' solid that touch its surface.

    Parameters
    ----------
    lattice : Lattice
        The lattice.
    deepest : float
        About the largest radius there is.

    Returns
    -------
    tuple of ndarray
        Parameters (n, 3) of points of the surface, radii (n,), and the areas (n,) that the points
        stand for, up to a factor.
    """
    key = f"depths {deepest!r}"
    if key not in lattice._cache:
        lattice._cache[key] = _depths(lattice, deepest)
    found: tuple[FloatArray, FloatArray, FloatArray] = lattice._cache[key]
    return found


def _depths(lattice: MidSurface, deepest: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """As `depths_of`, anew."""
    u, x, inward, area = points(lattice, POINTS)
    radius = np.full(len(u), 1.2 * deepest)
    done = np.zeros(len(u), np.bool_)
    for _ in range(SHRINKS):
        at = np.flatnonzero(~done)
        if len(at) == 0:
            break
        centre = x[at] + radius[at, None] * inward[at]
        c = _parameters(lattice, centre, u[at])
        off = np.linalg.norm(lattice.through.x(c) - centre, axis=1) > OFF * radius[at]
        radius[at[off]] *= 0.7  # the ball leaves the domain
        at, c = at[~off], c[~off]
        if len(at) == 0:
            continue
        found = lattice.closest(c)
        way = x[at] - found.foot
        with np.errstate(divide="ignore", invalid="ignore"):
            smaller = -(way * way).sum(axis=1) / (2.0 * (way * inward[at]).sum(axis=1))
        touches = np.abs(found.distance) < (1.0 - TOUCH) * radius[at]
        touches &= (smaller > 0.0) & (smaller < radius[at])
        done[at[~touches]] = True
        radius[at[touches]] = smaller[touches]
    return u[done], radius[done], area[done]


def least_of(thickness: FloatArray, area: FloatArray) -> float:
    """Thickness that all but `FRACTION` of the area exceeds.

    Parameters
    ----------
    thickness, area : ndarray, shape (n,)
        Thickness at points, and what area they stand for.

    Returns
    -------
    float
        A quantile by area.
    """
    order = np.argsort(thickness, kind="stable")
    below = np.cumsum(area[order])
    return float(thickness[order][np.searchsorted(below, FRACTION * below[-1])])


def points(lattice: MidSurface, most: int) -> tuple[FloatArray, ...]:
    """Points of the mid-surface in the domain, evenly chosen among seeds.

    Parameters
    ----------
    lattice : Lattice
        The lattice.
    most : int
        How many at most.

    Returns
    -------
    tuple of ndarray
        Parameters (n, 3), places (n, 3), inward normals (n, 3), and areas (n,), up to a factor.
    """
    p, x, _, spacing = lattice.search.seeds
    at = np.flatnonzero(((p >= 0.0) & (p <= np.array(lattice.repeat))).all(axis=1))
    at = at[np.unique(np.linspace(0, len(at) - 1, min(most, len(at))).astype(np.int64))]
    u, x = lattice.search.from_tile(p[at]), x[at]
    area = spacing[at] ** 2
    if lattice.search.struts is not None:  # seeds are on their spline
        found = lattice.closest(u)
        u, x = inside(lattice, found.u), found.foot
    g = lattice.implicit_jet(u, 1)[1]
    jacobian = lattice.through.jacobian(u)
    sound = np.abs(np.linalg.det(jacobian)) > 0.0
    u, x, area, g, jacobian = (a[sound] for a in (u, x, area, g, jacobian))
    n = np.linalg.solve(jacobian.transpose(0, 2, 1), g[:, :, None])[:, :, 0]
    n /= -np.maximum(np.linalg.norm(n, axis=1, keepdims=True), np.finfo(np.float64).tiny)
    return u, x, n, area


def _parameters(lattice: MidSurface, x: FloatArray, u: FloatArray) -> FloatArray:
    """Parameters in the domain whose images are next to points (n, 3), by Newton from others."""
    for _ in range(STEPS):
        y, jacobian = lattice.through.jet(u, 1)
        sound = np.abs(np.linalg.det(jacobian)) > 0.0
        step = np.linalg.solve(
            np.where(sound[:, None, None], jacobian, np.eye(3)), (x - y)[:, :, None]
        )[:, :, 0]
        u = inside(lattice, u + np.where(sound[:, None], step, 0.0))
    return u
