"""Compiled Newton iteration for the closest point on the image of an implicit surface.

The minimiser of 1/2 |T(p) - x|^2 + lambda I(p) is found by Newton's method on the KKT system
with the full Hessian J'J + sum_c r_c Hess(T_c) + lambda Hess(I) (Hong et al., eq. 10-12; the
printed eq. 12 lacks the last term and has x instead of T - x in the middle one), solved in
the null space of grad I, where it is made positive definite if it is not. There is no line
search: a merit function rejects good steps on curved constraints (the Maratos effect), which
cost more starts than it saved. But a step that ends so far from the surface, by the field there,
that the surface must bend away within it, as beside sharp edges, where fields level off behind
them, is taken back by half.

Guarantee: a status for every start; a converged foot is a local minimum, not a saddle.
Non-guarantee: which local minimum. The arguments are those of `_kernels_jets`.
"""

from typing import Any, NamedTuple

import numpy as np

from ilattice._kernels import inner
from ilattice.offsets._kernels_jets import (
    CLOSED,
    FAST,
    TILES,
    map_jet,
    metric,
    solve_sym,
    sym,
    tangents,
    tile_jet,
)

#: Steps of Newton's method at most.
MAX_ITERATIONS = 30
#: Steps after which the surface is farther away, by the field, than this part of them are taken
#: back by half, down to this length in tile coordinates.
ASTRAY, MIN_STEP = 0.5, 1e-3
#: Where the lowest eigenvalue is less, a stationary point is a saddle, and left; clear ones early.
SADDLE, CLEAR_SADDLE = -1e-3, -0.1
#: Lengths in spacings of seeds: of a first step at most, of a step along a saddle, and below which
#: steps tell that a clear saddle is near.
LONGEST, LEAP, NEARLY = 2.0, 0.3, 0.01
#: Lowest eigenvalues that steps count with, for a plane's of 1, and steps after which each of them
#: begins: far from a foot small ones throw iterations far off, next to it they are what is there.
FLOORS, FLOORED = (0.1, 0.02, 5e-4), (3, 8)
#: Steps at bounds are small below this part of the distance, and of the spacing.
SMALL, SMALLEST = 1e-4, 1e-12
#: Part of the gradient below which its other parts are rounding, as where a face of the domain is
#: tangent to the surface, and below which it is tangent to an edge.
ROUNDING, TANGENT = 1e-12, 1e-5

#: Steps after which an iteration is given up that still makes some longer than this part of the
#: spacing, as back and forth over a sharp edge, where there is a foot already.
PATIENCE, ERRATIC = 12, 0.1
#: An iteration heads for the known foot if it is within this part of the spacing of it, and of the
#: distance, by a step shorter than the first.
CLOSE, PART = 0.1, 0.5
#: One heads for a foot that is farther away if its step is shorter than this part of the spacing,
#: and the distance, less so many such steps, exceeds the known one by this part of the spacing or
#: of that distance. Chosen, like those above, without a study of their own.
SETTLING, STEPS_LEFT, FARTHER = 0.3, 2.0, 0.1
#: The last step of all converges if it is shorter than this part of the spacing, and its square in
#: tile coordinates less than the next number: across tiles that a map squeezes, any step is short.
AT_END, AT_END_SQUARE = 1e-3, 1e-6
#: One before it converges only below the first part, and where the square is less than the other.
ROUGH, ROUGH_SQUARE = 3e-5, 1e-9
#: Feet are asked for as sharply as usual where they are farther than the spacing over this number;
#: nearer ones more sharply, by the root of what is missing, down to this part.
USUAL, SHARPEST = 1e4, 1e-4
#: Steps after which convergence may be linear, and the part of the spacing that ends it then.
LATE, LINEAR = 6, 1e-6

#: How a search ended: inside, on the boundary, with the nearest seed in place of a foot, without
#: foot, given up as it leads to one that is farther away, without foot within the domain all along.
OK = 0
BOUNDARY = 1
FALLBACK = 2
FAILED = 3
WORSE = 4
STUCK = 5


class Known(NamedTuple):
    """A foot that others must be nearer than.

    Attributes
    ----------
    image : tuple of float
        Where it is in space.
    distance, multiplier : float
        How far from the query, and on which side.
    reach : float
        Iterations that come so near to it, in parts of a tenth of the spacing and of half the
        distance, are taken to head for it: 1, or less if it is loose.
    """

    image: Any
    distance: Any
    multiplier: Any
    reach: Any


@inner(fastmath=FAST, error_model="numpy")
def tangent_step(h, gm, z0, z1, b, floor):
    """Minimiser y of 1/2 y'(Z'HZ)y - b'y in the plane (z0, z1).

    H is shifted by the metric if its lowest eigenvalue is below `floor`.

    Returns the step in tile coordinates and the lowest eigenvalue of Z'HZ in the metric: 1 for
    a plane, 0 where the query is a centre of curvature of the surface.
    """
    m00, m11, m01 = sym(gm, z0, z0), sym(gm, z1, z1), sym(gm, z0, z1)
    a00, a11, a01 = sym(h, z0, z0), sym(h, z1, z1), sym(h, z0, z1)
    r0 = b[0] * z0[0] + b[1] * z0[1] + b[2] * z0[2]
    if m11 == 0.0:  # a line, or nothing
        if m00 == 0.0:
            return (0.0, 0.0, 0.0), 1.0
        y0 = r0 / max(a00, floor * m00)
        return (y0 * z0[0], y0 * z0[1], y0 * z0[2]), a00 / m00
    r1 = b[0] * z1[0] + b[1] * z1[1] + b[2] * z1[2]
    det_m = max(m00 * m11 - m01 * m01, 1e-30 * m00 * m11)
    tr = (a00 * m11 + a11 * m00 - 2.0 * a01 * m01) / det_m
    det = (a00 * a11 - a01 * a01) / det_m
    low = 0.5 * tr - np.sqrt(max(0.25 * tr * tr - det, 0.0))  # lowest generalised eigenvalue
    if low < floor:
        shift = 3.0 * floor - low
        a00 += shift * m00
        a11 += shift * m11
        a01 += shift * m01
    inv = 1.0 / (a00 * a11 - a01 * a01)
    y0 = (a11 * r0 - a01 * r1) * inv
    y1 = (a00 * r1 - a01 * r0) * inv
    return (y0 * z0[0] + y1 * z1[0], y0 * z0[1] + y1 * z1[1], y0 * z0[2] + y1 * z1[2]), low


@inner(fastmath=FAST, error_model="numpy")
def lagrangian(gm, m, t, r, lam):
    """Hessian of the Lagrangian: J'J + sum_c r_c Hess(T_c) + lambda Hess(I)."""
    return (
        gm[0] + r[0] * m[0, 4] + r[1] * m[1, 4] + r[2] * m[2, 4] + lam * t[4],
        gm[1] + r[0] * m[0, 5] + r[1] * m[1, 5] + r[2] * m[2, 5] + lam * t[5],
        gm[2] + r[0] * m[0, 6] + r[1] * m[1, 6] + r[2] * m[2, 6] + lam * t[6],
        gm[3] + r[0] * m[0, 7] + r[1] * m[1, 7] + r[2] * m[2, 7] + lam * t[7],
        gm[4] + r[0] * m[0, 8] + r[1] * m[1, 8] + r[2] * m[2, 8] + lam * t[8],
        gm[5] + r[0] * m[0, 9] + r[1] * m[1, 9] + r[2] * m[2, 9] + lam * t[9],
    )


@inner(fastmath=FAST, error_model="numpy")
def soft_direction(m, t, x, lam, low, fixed):
    """Direction, of unit length in space, in which the distance grows least about a foot.

    From the jets at the foot; `low` is the eigenvalue that belongs to it. With a fixed direction
    it is the one that is left.
    """
    gm = metric(m)
    h = lagrangian(gm, m, t, (m[0, 0] - x[0], m[1, 0] - x[1], m[2, 0] - x[2]), lam)
    z0, z1 = tangents((t[1], t[2], t[3]), fixed)
    a = sym(h, z0, z0) - low * sym(gm, z0, z0)
    b = sym(h, z0, z1) - low * sym(gm, z0, z1)
    c = sym(h, z1, z1) - low * sym(gm, z1, z1)
    y0, y1 = (b, -a) if abs(a) > abs(c) else (c, -b)
    if fixed[0] + fixed[1] + fixed[2] > 0:
        y0, y1 = 1.0, 0.0
    d = (y0 * z0[0] + y1 * z1[0], y0 * z0[1] + y1 * z1[1], y0 * z0[2] + y1 * z1[2])
    s = 1.0 / (np.sqrt(max(sym(gm, d, d), 0.0)) + 1e-300)
    return (s * d[0], s * d[1], s * d[2])


@inner(fastmath=FAST, error_model="numpy")
def kkt_step(m, t, r, lam, first, fixed, floor):
    """One Newton step: step, new multiplier, |J step|, and the eigenvalue of `tangent_step`."""
    gm = metric(m)
    g = (t[1] * (1 - fixed[0]), t[2] * (1 - fixed[1]), t[3] * (1 - fixed[2]))
    gg = g[0] * g[0] + g[1] * g[1] + g[2] * g[2]
    if fixed[0] + fixed[1] + fixed[2] == 2:  # tangent to the edge
        whole = t[1] * t[1] + t[2] * t[2] + t[3] * t[3]
        gg = gg if gg > TANGENT * TANGENT * whole else 0.0
    if not gg > 0.0:  # no way back to the surface
        return (0.0, 0.0, 0.0), lam, np.inf, 1.0
    jr = (
        m[0, 1] * r[0] + m[1, 1] * r[1] + m[2, 1] * r[2],
        m[0, 2] * r[0] + m[1, 2] * r[1] + m[2, 2] * r[2],
        m[0, 3] * r[0] + m[1, 3] * r[1] + m[2, 3] * r[2],
    )
    if first:
        a, regular = solve_sym(gm, g)
        if regular:
            ga = g[0] * a[0] + g[1] * a[1] + g[2] * a[2]
            lam = -(a[0] * jr[0] + a[1] * jr[1] + a[2] * jr[2]) / (ga + 1e-300)
        else:
            lam = 0.0
    h = lagrangian(gm, m, t, r, lam)
    s = -t[0] / gg
    n = (s * g[0], s * g[1], s * g[2])
    hn = (
        h[0] * n[0] + h[5] * n[1] + h[4] * n[2],
        h[5] * n[0] + h[1] * n[1] + h[3] * n[2],
        h[4] * n[0] + h[3] * n[1] + h[2] * n[2],
    )
    z0, z1 = tangents(g, fixed)
    y, low = tangent_step(h, gm, z0, z1, (-jr[0] - hn[0], -jr[1] - hn[1], -jr[2] - hn[2]), floor)
    d = (n[0] + y[0], n[1] + y[1], n[2] + y[2])
    hd = (
        h[0] * d[0] + h[5] * d[1] + h[4] * d[2],
        h[5] * d[0] + h[1] * d[1] + h[3] * d[2],
        h[4] * d[0] + h[3] * d[1] + h[2] * d[2],
    )
    new = -(g[0] * (jr[0] + hd[0]) + g[1] * (jr[1] + hd[1]) + g[2] * (jr[2] + hd[2])) / gg
    return d, new, np.sqrt(max(sym(gm, d, d), 0.0)), low


@inner(fastmath=FAST, error_model="numpy")
def active_set(p, box, jr, t, lam, clip):
    """Directions fixed at a bound that the gradient of the Lagrangian pushes against."""
    if not clip:
        return (0, 0, 0)
    f0 = jr[0] + lam * t[1]
    f1 = jr[1] + lam * t[2]
    f2 = jr[2] + lam * t[3]
    e = 1e-9 * (abs(jr[0]) + abs(jr[1]) + abs(jr[2]))  # on planes of symmetry f is rounding
    return (
        1 if (p[0] <= box[0, 0] and f0 > e) or (p[0] >= box[1, 0] and f0 < -e) else 0,
        1 if (p[1] <= box[0, 1] and f1 > e) or (p[1] >= box[1, 1] and f1 < -e) else 0,
        1 if (p[2] <= box[0, 2] and f2 > e) or (p[2] >= box[1, 2] and f2 < -e) else 0,
    )


@inner(fastmath=FAST, error_model="numpy")
def wrongly_bound(p, box, jr, t, lam, fixed):
    """Whether a direction is fixed that the new multiplier would let go, into the box."""
    for a in range(3):
        if fixed[a]:
            f = jr[a] + lam * t[1 + a]
            if p[a] > box[0, a]:
                f = -f
            if f < -1e-9 * (abs(jr[a]) + abs(lam * t[1 + a])):
                return True
    return False


@inner(fastmath=FAST, error_model="numpy")
def at_bounds(p, d, box, fixed):
    """Whether a direction is fixed, or the step d ends outside the box."""
    for a in range(3):
        if fixed[a] or p[a] + d[a] < box[0, a] or p[a] + d[a] > box[1, a]:
            return True
    return False


@inner(fastmath=FAST, error_model="numpy")
def on_bounds(p, box):
    """Whether p is on a face of the box."""
    for a in range(3):
        if p[a] <= box[0, a] or p[a] >= box[1, a]:
            return True
    return False


@inner(fastmath=FAST, error_model="numpy")
def vertex_foot(p, box, jr, t):
    """Whether p, on an edge or at a corner of the box, is a local minimum, and a multiplier.

    It is one if it is on the surface and a multiplier makes the gradient of the Lagrangian vanish
    along the edge, and push against all bounds. Without this test, directions are fixed or let go
    by the multiplier of the last step, and there is none yet where the start is such a point. Edges
    that are tangent to the surface have no such points: curves of the surface may cross there.
    """
    low, high = -np.inf, np.inf
    free = 0
    total = abs(t[1]) + abs(t[2]) + abs(t[3])
    on = t[0] * t[0] <= 1e-18 * total * total
    for a in range(3):
        g = t[1 + a] if abs(t[1 + a]) > ROUNDING * total else 0.0
        if p[a] > box[0, a] and p[a] < box[1, a]:
            free += 1
            if free > 1 or abs(g) <= TANGENT * total:
                return False, 0.0
            on = t[0] * t[0] <= 1e-18 * g * g
            low = max(low, -jr[a] / g)
            high = min(high, -jr[a] / g)
            continue
        s = 1.0 if p[a] <= box[0, a] else -1.0
        if s * g > 0.0:
            low = max(low, -jr[a] / g)
        elif s * g < 0.0:
            high = min(high, -jr[a] / g)
        elif s * jr[a] < 0.0:
            return False, 0.0
    if low > high or not on:
        return False, 0.0
    return True, low if low > -np.inf else high if high < np.inf else 0.0


@inner(fastmath=FAST, error_model="numpy")
def lowest(m, t, r, lam):
    """Lowest eigenvalue of the Hessian over the whole tangent plane, bounds or no bounds."""
    gm = metric(m)
    z0, z1 = tangents((t[1], t[2], t[3]), (0, 0, 0))
    return tangent_step(lagrangian(gm, m, t, r, lam), gm, z0, z1, (0.0, 0.0, 0.0), 0.0)[1]


@inner(fastmath=FAST, error_model="numpy")
def curvature(m, t, normal, lam, gm):
    """Largest principal curvature of the image of I = const, up to sign, in the metric gm.

    From jets of order 2, the unit normal n and lam = 1 / |J^-T grad I|: along a tangent d it is
    d'(lam Hess(I) - sum_c n_c Hess(T_c))d.
    """
    zero = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    z0, z1 = tangents((t[1], t[2], t[3]), (0, 0, 0))
    h = lagrangian(zero, m, t, normal, -lam)
    a = tangent_step(h, gm, z0, z1, (0.0, 0.0, 0.0), 0.0)[1]
    h = (-h[0], -h[1], -h[2], -h[3], -h[4], -h[5])
    b = tangent_step(h, gm, z0, z1, (0.0, 0.0, 0.0), 0.0)[1]
    return max(abs(a), abs(b))


@inner(fastmath=FAST, error_model="numpy")
def clamp(p, box):
    """Point of the box next to p."""
    return (
        min(max(p[0], box[0, 0]), box[1, 0]),
        min(max(p[1], box[0, 1]), box[1, 1]),
        min(max(p[2], box[0, 2]), box[1, 2]),
    )


@inner(fastmath=FAST, error_model="numpy")
def leave(m, t, x, lam, low, p, h, fixed, box, clip):
    """Point next to a saddle p, downhill and in the box."""
    d = soft_direction(m, t, x, lam, low, fixed)
    out = (p[0] + h * d[0], p[1] + h * d[1], p[2] + h * d[2])
    if not clip:
        return out
    back = (p[0] - h * d[0], p[1] - h * d[1], p[2] - h * d[2])
    a, b = clamp(out, box), clamp(back, box)
    lost = abs(a[0] - out[0]) + abs(a[1] - out[1]) + abs(a[2] - out[2])
    return a if lost <= abs(b[0] - back[0]) + abs(b[1] - back[1]) + abs(b[2] - back[2]) else b


@inner(fastmath=FAST, error_model="numpy")
def near(a, b, h):
    """Whether two points are within h."""
    d0, d1, d2 = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return d0 * d0 + d1 * d1 + d2 * d2 < h * h


@inner(fastmath=FAST, error_model="numpy")
def abandon(m, r, lam, size, low, known, h):
    """Whether an iteration heads for the known foot, or for one that is farther away.

    Not so for a saddle, from which it goes on downhill. What is seen from the other side is another
    foot, however near, as on the other face of a thin plate.
    """
    far = known.distance
    if not far < np.inf:
        return False
    close = known.reach * min(CLOSE * h, PART * far)
    behind = lam * known.multiplier < 0.0
    if size < CLOSE * h and not behind and near((m[0, 0], m[1, 0], m[2, 0]), known.image, close):
        return True
    dist = np.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    if size >= SETTLING * h or low < SADDLE:
        return False
    return dist - STEPS_LEFT * size > far + FARTHER * min(h, far)


@inner(fastmath=FAST, error_model="numpy")
def converged(size, last, d, dist, it, h, tol):
    """Whether the step d, of length `size` in space after one of length `last`, is the last one.

    Feet must be sharper where they are near: an error e of the foot is one of e² / (2 dist) of
    the distance, or of e if that is less; `dist` is that before the step. Near a centre of
    curvature convergence is linear, but the distance is flat there; where it is quadratic, the
    next step can be told from the last two. Where det J = 0, a step may be long in tiles and
    bend away from J d.
    """
    square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
    if it == MAX_ITERATIONS - 1:
        return size <= AT_END * h and square <= AT_END_SQUARE
    if size > ROUGH * h or square > ROUGH_SQUARE:
        return False
    sharp = h * max(min(1.0, np.sqrt(USUAL * max(dist - size, 0.0) / h)), SHARPEST)
    if size <= tol * sharp or (it > LATE and size <= LINEAR * sharp):
        return True
    return size * size * size <= tol * sharp * last * last


@inner(fastmath=FAST, error_model="numpy")
def astray(t, moved):
    """Whether the field, of jet t, tells that a step of squared length `moved` was too long."""
    slope = t[1] * t[1] + t[2] * t[2] + t[3] * t[3]
    return moved > MIN_STEP * MIN_STEP and t[0] * t[0] > ASTRAY * ASTRAY * slope * moved


@inner(fastmath=FAST, error_model="numpy")
def at_ends(geom, p):
    """Whether p is on an open end of the domain, or beyond."""
    for a in range(3):
        if geom[CLOSED + a] == 0.0 and (p[a] <= 0.0 or p[a] >= geom[TILES + a]):
            return True
    return False


@inner(fastmath=FAST, error_model="numpy")
def newton(space, x, start, known, clip, h, tol, work):
    """Foot point of x from one start; given up when it cannot beat the known foot.

    With `clip` it stays in ``work.room``. Leaves jets at the last point but one in `work`.

    Returns
    -------
    tuple
        Foot in tile coordinates, foot in space, multiplier, lowest eigenvalue, iterations, status.
    """
    b, m, t, tab, box = work.basis, work.map, work.tile, work.table, work.room
    p = (start[0], start[1], start[2])
    old = p
    d = (0.0, 0.0, 0.0)
    lam = 0.0
    low = 1.0
    last = 0.0
    left = 0
    longest = LONGEST * h
    moved = 0.0
    y = (0.0, 0.0, 0.0)
    failed = STUCK  # unless bounds would have changed it
    for it in range(MAX_ITERATIONS):
        if clip or at_ends(space.geom, p):  # with bounds it may end elsewhere
            failed = FAILED
        map_jet(space, p, 2, b, m)
        tile_jet(space, p, b, t, tab)
        if astray(t, moved):  # no line search: half of the step, and from then on shorter ones
            longest = last = 0.5 * min(longest, last)
            moved *= 0.25
            p = (0.5 * (old[0] + p[0]), 0.5 * (old[1] + p[1]), 0.5 * (old[2] + p[2]))
            continue
        r = (m[0, 0] - x[0], m[1, 0] - x[1], m[2, 0] - x[2])
        fixed = (0, 0, 0)
        jr = r
        if clip:  # which bounds hold is decided anew at every point, so that edges are left again
            jr = (
                m[0, 1] * r[0] + m[1, 1] * r[1] + m[2, 1] * r[2],
                m[0, 2] * r[0] + m[1, 2] * r[1] + m[2, 2] * r[2],
                m[0, 3] * r[0] + m[1, 3] * r[1] + m[2, 3] * r[2],
            )
            found, vertex_lam = vertex_foot(p, box, jr, t)
            if found:  # in a corner there is no direction left to step in
                y = (m[0, 0], m[1, 0], m[2, 0])
                return p, y, vertex_lam, lowest(m, t, r, vertex_lam), it + 1, BOUNDARY
            fixed = active_set(p, box, jr, t, lam, clip)
        since = it - left  # a saddle that was left is a new start
        floor = FLOORS[0] if since < FLOORED[0] else FLOORS[1] if since < FLOORED[1] else FLOORS[2]
        d, lam, size, low = kkt_step(m, t, r, lam, it == 0, fixed, floor)
        if not np.isfinite(size) or (
            since >= PATIENCE and size > ERRATIC * h and known.distance < np.inf
        ):  # back and forth over a sharp edge, or a map without inverse: other starts do better
            return p, y, lam, low, it + 1, failed
        dist = np.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
        small = converged(size, last, d, dist, it, h, tol)
        if clip and small and it < MAX_ITERATIONS - 1 and at_bounds(p, d, box, fixed):
            # multipliers are those before the step, and must keep their signs over it
            small = size <= max(SMALL * dist, SMALLEST * h)
            small = small and not wrongly_bound(p, box, jr, t, lam, fixed)
        last = size
        if it > 0 and not small and abandon(m, r, lam, size, low, known, h):
            # most starts lead to the foot that is known: it costs less to stop than to converge
            return p, y, lam, low, it + 1, WORSE
        if low < SADDLE and (small or (size <= NEARLY * h and low < CLEAR_SADDLE)):
            # stationary, but no minimum: on the medial axis Newton ends there
            if it == MAX_ITERATIONS - 1:
                break
            left = it + 1
            p = leave(m, t, x, lam, low, p, LEAP * h, fixed, box, clip)
            moved = 0.0
            continue
        if size > longest:  # beyond the patch of the seed its tangent plane tells nothing
            s = longest / size
            d = (s * d[0], s * d[1], s * d[2])
        old = p
        p = (p[0] + d[0], p[1] + d[1], p[2] + d[2])
        if clip:  # then the step is what is left of it
            p = clamp(p, box)
            d = (p[0] - old[0], p[1] - old[1], p[2] - old[2])
        moved = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
        if clip and on_bounds(p, box):
            moved = 0.0  # along faces the surface is another one
        if small:  # to first order: no further jet for the last, tiny step
            y = (
                m[0, 0] + m[0, 1] * d[0] + m[0, 2] * d[1] + m[0, 3] * d[2],
                m[1, 0] + m[1, 1] * d[0] + m[1, 2] * d[1] + m[1, 3] * d[2],
                m[2, 0] + m[2, 1] * d[0] + m[2, 2] * d[1] + m[2, 3] * d[2],
            )
            held = fixed[0] + fixed[1] + fixed[2]
            if held == 0:
                return p, y, lam, low, it + 1, OK
            return p, y, lam, lowest(m, t, r, lam), it + 1, BOUNDARY
    return p, y, lam, low, MAX_ITERATIONS, failed
