"""Compiled closest-point search on the image of an implicit tile lattice.

Points of the parameter domain are given in *tile coordinates* p: the tile with index
(i, j, k) is the box [i, i+1] x [j, j+1] x [k, k+1]. Where the lattice comes in, functions
take the flat argument list

    d0, d1, d2, k0, k1, k2, c, geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc

the map T as arguments of the B-spline kernels; `geom` (14,) with lo, step (u = lo + p * step),
closed directions, numbers of tiles, whether T is rational, and the kind of tile; the tile as a
trigonometric polynomial (kind 0) or as a spline on the unit cube (kind 1). It is flat because
every array taken out of a tuple costs a counted reference; `b, m, t, tab` is the scratch of one
thread: basis functions, map jet, tile jet, trigonometric table.

The minimiser of 1/2 |T(p) - x|^2 + lambda I(p) is found by Newton's method on the KKT system
with the full Hessian J'J + sum_c r_c Hess(T_c) + lambda Hess(I) (Hong et al., eq. 10-12; the
printed eq. 12 lacks the last term and has x instead of T - x in the middle one), solved in
the null space of grad I, where it is made positive definite if it is not.

Guarantees: no allocation per point, the same result for any number of threads, a status for
every point. Non-guarantees: the minimiser is the global one only as far as the starts cover
the surface.
"""

import numpy as np
from numba import njit, prange

from ilattice.bspline._kernels import basis, contract1, contract2
from ilattice.tiles._kernels import trig_jet, trig_tab

FAST = {"contract", "nsz", "arcp", "reassoc"}
CHUNK = 256
POLISH_STEPS = 12
LOOSE = 0.4
MAX_ITERATIONS = 30
MAX_BACKTRACKS = 4

OK = 0
BOUNDARY = 1
FALLBACK = 2
FAILED = 3
WORSE = 4


@njit(cache=True)
def scratch(factor, c, k0, k1, k2, q0, q1, q2):
    """Work arrays of one thread: basis functions, map jet, tile jet, trigonometric table."""
    k = max(max(len(k0), len(k1), len(k2)), max(len(q0), len(q1), len(q2)))
    return np.zeros((3, 3, k)), np.zeros((c.shape[0], 10)), np.zeros(10), trig_tab(factor)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def wrap(x, lo, length):
    """x moved by whole lengths into [lo, lo + length)."""
    return x - length * np.floor((x - lo) / length)


@njit(cache=True, fastmath=FAST, error_model="numpy", forceinline=True)
def parameter(geom, axis, p):
    """Parameter of a tile coordinate, wrapped in a closed direction."""
    if geom[6 + axis] != 0.0:
        p = wrap(p, 0.0, geom[9 + axis])
    return geom[axis] + p * geom[3 + axis]


@njit(cache=True, fastmath=FAST, error_model="numpy", forceinline=True)
def map_jet(d0, d1, d2, k0, k1, k2, c, geom, p, order, b, m):
    """Map jet in tile coordinates into m (3, 10): rational maps divided through."""
    i0 = basis(d0, k0, parameter(geom, 0, p[0]), order, b, 0)
    j0 = basis(d1, k1, parameter(geom, 1, p[1]), order, b, 1)
    l0 = basis(d2, k2, parameter(geom, 2, p[2]), order, b, 2)
    for axis in range(3):  # derivatives with respect to p
        s = geom[3 + axis]
        for j in range(b.shape[2]):
            b[axis, 1, j] *= s
            b[axis, 2, j] *= s * s
    for a in range(c.shape[0]):
        if order == 1:
            f, fu, fv, fw = contract1(c, a, i0, j0, l0, k0, k1, k2, b)
        else:
            f, fu, fv, fw, fuu, fvv, fww, fvw, fuw, fuv = contract2(
                c, a, i0, j0, l0, k0, k1, k2, b
            )
            m[a, 4] = fuu
            m[a, 5] = fvv
            m[a, 6] = fww
            m[a, 7] = fvw
            m[a, 8] = fuw
            m[a, 9] = fuv
        m[a, 0] = f
        m[a, 1] = fu
        m[a, 2] = fv
        m[a, 3] = fw
    if geom[12] != 0.0:
        divide(m, order)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def divide(m, order):
    """Quotient rule on homogeneous jets, the weight in the last row."""
    w = m.shape[0] - 1
    inv = 1.0 / m[w, 0]
    for a in range(3):
        m[a, 0] *= inv
        for i in range(1, 4):
            m[a, i] = (m[a, i] - m[a, 0] * m[w, i]) * inv
        if order > 1:
            for i in range(1, 4):
                m[a, 3 + i] = (m[a, 3 + i] - 2.0 * m[a, i] * m[w, i] - m[a, 0] * m[w, 3 + i]) * inv
            for n, i, j in ((7, 2, 3), (8, 1, 3), (9, 1, 2)):
                m[a, n] = (
                    m[a, n] - m[a, i] * m[w, j] - m[a, j] * m[w, i] - m[a, 0] * m[w, n]
                ) * inv


@njit(cache=True, fastmath=FAST, error_model="numpy", forceinline=True)
def tile_jet(geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc, p, b, t, tab):
    """Tile jet in tile coordinates into t (10,): f, gradient, xx, yy, zz, yz, xz, xy."""
    if geom[13] == 0.0:
        trig_jet(coef, factor, omega, p[0], p[1], p[2], tab, t)
    else:
        i0 = basis(t0, q0, p[0] - np.floor(p[0]), 2, b, 0)
        j0 = basis(t1, q1, p[1] - np.floor(p[1]), 2, b, 1)
        l0 = basis(t2, q2, p[2] - np.floor(p[2]), 2, b, 2)
        t[0], t[1], t[2], t[3], t[4], t[5], t[6], t[7], t[8], t[9] = contract2(
            tc, 0, i0, j0, l0, q0, q1, q2, b
        )


@njit(cache=True, fastmath=FAST, error_model="numpy")
def sym(h, a, b):
    """a' H b with H as xx, yy, zz, yz, xz, xy and vectors as tuples."""
    return (
        h[0] * a[0] * b[0]
        + h[1] * a[1] * b[1]
        + h[2] * a[2] * b[2]
        + h[3] * (a[1] * b[2] + a[2] * b[1])
        + h[4] * (a[0] * b[2] + a[2] * b[0])
        + h[5] * (a[0] * b[1] + a[1] * b[0])
    )


@njit(cache=True, fastmath=FAST, error_model="numpy")
def metric(m):
    """J'J from a map jet, as xx, yy, zz, yz, xz, xy."""
    return (
        m[0, 1] * m[0, 1] + m[1, 1] * m[1, 1] + m[2, 1] * m[2, 1],
        m[0, 2] * m[0, 2] + m[1, 2] * m[1, 2] + m[2, 2] * m[2, 2],
        m[0, 3] * m[0, 3] + m[1, 3] * m[1, 3] + m[2, 3] * m[2, 3],
        m[0, 2] * m[0, 3] + m[1, 2] * m[1, 3] + m[2, 2] * m[2, 3],
        m[0, 1] * m[0, 3] + m[1, 1] * m[1, 3] + m[2, 1] * m[2, 3],
        m[0, 1] * m[0, 2] + m[1, 1] * m[1, 2] + m[2, 1] * m[2, 2],
    )


@njit(cache=True, fastmath=FAST, error_model="numpy")
def solve_sym(h, b):
    """Solution of H x = b for a 3 x 3 symmetric H, and whether H is regular."""
    c00 = h[1] * h[2] - h[3] * h[3]
    c01 = h[4] * h[3] - h[5] * h[2]
    c02 = h[5] * h[3] - h[4] * h[1]
    det = h[0] * c00 + h[5] * c01 + h[4] * c02
    if not abs(det) > 0.0:
        return (0.0, 0.0, 0.0), False
    inv = 1.0 / det
    c11 = h[0] * h[2] - h[4] * h[4]
    c12 = h[4] * h[5] - h[0] * h[3]
    c22 = h[0] * h[1] - h[5] * h[5]
    return (
        (c00 * b[0] + c01 * b[1] + c02 * b[2]) * inv,
        (c01 * b[0] + c11 * b[1] + c12 * b[2]) * inv,
        (c02 * b[0] + c12 * b[1] + c22 * b[2]) * inv,
    ), True


@njit(cache=True, fastmath=FAST, error_model="numpy")
def cofactor_normal(m, g):
    """Normal cof(J) g = det(J) J^-T g of the image, from a map jet and a parameter gradient."""
    a = (m[1, 2] * m[2, 3] - m[1, 3] * m[2, 2], m[1, 3] * m[2, 1] - m[1, 1] * m[2, 3],
         m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
    b = (m[2, 2] * m[0, 3] - m[2, 3] * m[0, 2], m[2, 3] * m[0, 1] - m[2, 1] * m[0, 3],
         m[2, 1] * m[0, 2] - m[2, 2] * m[0, 1])
    c = (m[0, 2] * m[1, 3] - m[0, 3] * m[1, 2], m[0, 3] * m[1, 1] - m[0, 1] * m[1, 3],
         m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1])
    n0 = a[0] * g[0] + a[1] * g[1] + a[2] * g[2]
    n1 = b[0] * g[0] + b[1] * g[1] + b[2] * g[2]
    n2 = c[0] * g[0] + c[1] * g[1] + c[2] * g[2]
    det = m[0, 1] * a[0] + m[0, 2] * a[1] + m[0, 3] * a[2]
    return (n0, n1, n2), det


@njit(cache=True, fastmath=FAST, error_model="numpy")
def tangents(g, fixed):
    """Two vectors that span the null space of g among the free directions (zero if fewer).

    A fixed direction takes part in neither; with one fixed direction the second is zero.
    """
    zero = (0.0, 0.0, 0.0)
    n = fixed[0] + fixed[1] + fixed[2]
    if n >= 2:
        return zero, zero
    if n == 1:
        if fixed[0]:
            t = (0.0, -g[2], g[1])
        elif fixed[1]:
            t = (g[2], 0.0, -g[0])
        else:
            t = (-g[1], g[0], 0.0)
        s = np.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2]) + 1e-300
        return (t[0] / s, t[1] / s, t[2] / s), zero
    a0, a1, a2 = abs(g[0]), abs(g[1]), abs(g[2])
    if a0 <= a1 and a0 <= a2:
        t = (0.0, -g[2], g[1])
    elif a1 <= a2:
        t = (g[2], 0.0, -g[0])
    else:
        t = (-g[1], g[0], 0.0)
    s = 1.0 / (np.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2]) + 1e-300)
    t = (t[0] * s, t[1] * s, t[2] * s)
    q = (g[1] * t[2] - g[2] * t[1], g[2] * t[0] - g[0] * t[2], g[0] * t[1] - g[1] * t[0])
    s = 1.0 / (np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2]) + 1e-300)
    return t, (q[0] * s, q[1] * s, q[2] * s)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def tangent_step(h, gm, z0, z1, b):
    """Minimiser y of 1/2 y'(Z'HZ)y - b'y in the plane (z0, z1), H shifted by the metric if needed.

    Returns the step in tile coordinates and the lowest eigenvalue of Z'HZ in the metric: 1 for
    a plane, 0 where the query is a centre of curvature of the surface.
    """
    m00, m11, m01 = sym(gm, z0, z0), sym(gm, z1, z1), sym(gm, z0, z1)
    a00, a11, a01 = sym(h, z0, z0), sym(h, z1, z1), sym(h, z0, z1)
    r0 = b[0] * z0[0] + b[1] * z0[1] + b[2] * z0[2]
    if m11 == 0.0:  # a line, or nothing
        if m00 == 0.0:
            return (0.0, 0.0, 0.0), 1.0
        y0 = r0 / max(a00, 0.05 * m00)
        return (y0 * z0[0], y0 * z0[1], y0 * z0[2]), a00 / m00
    r1 = b[0] * z1[0] + b[1] * z1[1] + b[2] * z1[2]
    det_m = max(m00 * m11 - m01 * m01, 1e-30 * m00 * m11)
    tr = (a00 * m11 + a11 * m00 - 2.0 * a01 * m01) / det_m
    det = (a00 * a11 - a01 * a01) / det_m
    low = 0.5 * tr - np.sqrt(max(0.25 * tr * tr - det, 0.0))  # lowest generalised eigenvalue
    if low < 0.02:
        shift = 0.1 - low
        a00 += shift * m00
        a11 += shift * m11
        a01 += shift * m01
    inv = 1.0 / (a00 * a11 - a01 * a01)
    y0 = (a11 * r0 - a01 * r1) * inv
    y1 = (a00 * r1 - a01 * r0) * inv
    return (y0 * z0[0] + y1 * z1[0], y0 * z0[1] + y1 * z1[1], y0 * z0[2] + y1 * z1[2]), low


@njit(cache=True, fastmath=FAST, error_model="numpy")
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


@njit(cache=True, fastmath=FAST, error_model="numpy")
def soft_direction(m, t, x, lam, low):
    """Direction, of unit length in space, in which the distance grows least about a foot.

    From the jets at the foot; `low` is the eigenvalue that belongs to it.
    """
    gm = metric(m)
    h = lagrangian(gm, m, t, (m[0, 0] - x[0], m[1, 0] - x[1], m[2, 0] - x[2]), lam)
    z0, z1 = tangents((t[1], t[2], t[3]), (0, 0, 0))
    a = sym(h, z0, z0) - low * sym(gm, z0, z0)
    b = sym(h, z0, z1) - low * sym(gm, z0, z1)
    c = sym(h, z1, z1) - low * sym(gm, z1, z1)
    y0, y1 = (b, -a) if abs(a) > abs(c) else (c, -b)
    d = (y0 * z0[0] + y1 * z1[0], y0 * z0[1] + y1 * z1[1], y0 * z0[2] + y1 * z1[2])
    s = 1.0 / (np.sqrt(max(sym(gm, d, d), 0.0)) + 1e-300)
    return (s * d[0], s * d[1], s * d[2])


@njit(cache=True, fastmath=FAST, error_model="numpy")
def kkt_step(m, t, r, lam, first, fixed):
    """One Newton step: step, new multiplier, |J step|, and the eigenvalue of `tangent_step`."""
    gm = metric(m)
    g = (t[1] * (1 - fixed[0]), t[2] * (1 - fixed[1]), t[3] * (1 - fixed[2]))
    gg = g[0] * g[0] + g[1] * g[1] + g[2] * g[2] + 1e-300
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
    y, low = tangent_step(h, gm, z0, z1, (-jr[0] - hn[0], -jr[1] - hn[1], -jr[2] - hn[2]))
    d = (n[0] + y[0], n[1] + y[1], n[2] + y[2])
    hd = (
        h[0] * d[0] + h[5] * d[1] + h[4] * d[2],
        h[5] * d[0] + h[1] * d[1] + h[3] * d[2],
        h[4] * d[0] + h[3] * d[1] + h[2] * d[2],
    )
    new = -(g[0] * (jr[0] + hd[0]) + g[1] * (jr[1] + hd[1]) + g[2] * (jr[2] + hd[2])) / gg
    return d, new, np.sqrt(max(sym(gm, d, d), 0.0)), low


@njit(cache=True, fastmath=FAST, error_model="numpy")
def active_set(p, box, jr, t, lam, clip):
    """Directions held at a bound that the gradient of the Lagrangian pushes against."""
    if not clip:
        return (0, 0, 0)
    f0 = jr[0] + lam * t[1]
    f1 = jr[1] + lam * t[2]
    f2 = jr[2] + lam * t[3]
    return (
        1 if (p[0] <= box[0, 0] and f0 > 0.0) or (p[0] >= box[1, 0] and f0 < 0.0) else 0,
        1 if (p[1] <= box[0, 1] and f1 > 0.0) or (p[1] >= box[1, 1] and f1 < 0.0) else 0,
        1 if (p[2] <= box[0, 2] and f2 > 0.0) or (p[2] >= box[1, 2] and f2 < 0.0) else 0,
    )


@njit(cache=True, fastmath=FAST, error_model="numpy")
def near(a, b, h):
    """Whether two points are within h."""
    d0, d1, d2 = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return d0 * d0 + d1 * d1 + d2 * d2 < h * h


@njit(cache=True, fastmath=FAST, error_model="numpy")
def abandon(m, r, size, best, h):
    """Whether an iteration heads for the known foot, or for one that is farther away."""
    if not best[3] < np.inf:
        return False
    if size < 0.1 * h and near((m[0, 0], m[1, 0], m[2, 0]), best, 0.1 * h):
        return True
    dist = np.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    return size < 0.3 * h and dist - 2.0 * size > best[3] + 0.1 * h


@njit(cache=True, fastmath=FAST, error_model="numpy")
def newton(
    d0, d1, d2, k0, k1, k2, c, geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc,
    x, start, best, box, clip, h, tol, b, m, t, tab,
):  # fmt: skip
    """Foot point of x from one start; given up when it cannot beat `best`: a foot and its distance.

    Returns
    -------
    tuple
        Foot in tile coordinates, foot in space, multiplier, lowest eigenvalue, iterations, status.
    """
    p = (start[0], start[1], start[2])
    old = p
    d = (0.0, 0.0, 0.0)
    lam = 0.0
    merit_old = np.inf
    back = 0
    low = 1.0
    last = 0.0
    y = (0.0, 0.0, 0.0)
    for it in range(MAX_ITERATIONS):
        map_jet(d0, d1, d2, k0, k1, k2, c, geom, p, 2, b, m)
        tile_jet(geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc, p, b, t, tab)
        r = (m[0, 0] - x[0], m[1, 0] - x[1], m[2, 0] - x[2])
        half = 0.5 * (r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
        if it > 0:
            merit = half + 2.0 * abs(lam * t[0])
            if merit > merit_old + 1e-12 * h * h and back < MAX_BACKTRACKS:
                back += 1
                d = (0.5 * d[0], 0.5 * d[1], 0.5 * d[2])
                p = (old[0] + d[0], old[1] + d[1], old[2] + d[2])
                continue
        fixed = (0, 0, 0)
        if clip:
            jr = (
                m[0, 1] * r[0] + m[1, 1] * r[1] + m[2, 1] * r[2],
                m[0, 2] * r[0] + m[1, 2] * r[1] + m[2, 2] * r[2],
                m[0, 3] * r[0] + m[1, 3] * r[1] + m[2, 3] * r[2],
            )
            fixed = active_set(p, box, jr, t, lam, clip)
        d, lam, size, low = kkt_step(m, t, r, lam, it == 0, fixed)
        if not np.isfinite(size):
            return p, y, lam, low, it + 1, FAILED
        merit_old = half + 2.0 * abs(lam * t[0])
        back = 0
        # near a centre of curvature convergence is linear, but the distance is flat there
        # and where convergence is quadratic, the next step can be told from the last two
        small = size <= tol * h or (it > 6 and size <= 1e-6 * h)
        small = small or (size <= 3e-5 * h and size * size * size <= tol * h * last * last)
        last = size
        small = small or (it == MAX_ITERATIONS - 1 and size <= 1e-3 * h)
        if it > 0 and not small and abandon(m, r, size, best, h):
            return p, y, lam, low, it + 1, WORSE
        if size > 2.0 * h:
            s = 2.0 * h / size
            d = (s * d[0], s * d[1], s * d[2])
        old = p
        p = (p[0] + d[0], p[1] + d[1], p[2] + d[2])
        if clip:
            p = (
                min(max(p[0], box[0, 0]), box[1, 0]),
                min(max(p[1], box[0, 1]), box[1, 1]),
                min(max(p[2], box[0, 2]), box[1, 2]),
            )
            d = (p[0] - old[0], p[1] - old[1], p[2] - old[2])
        if small:
            y = (
                m[0, 0] + m[0, 1] * d[0] + m[0, 2] * d[1] + m[0, 3] * d[2],
                m[1, 0] + m[1, 1] * d[0] + m[1, 2] * d[1] + m[1, 3] * d[2],
                m[2, 0] + m[2, 1] * d[0] + m[2, 2] * d[1] + m[2, 3] * d[2],
            )
            held = fixed[0] + fixed[1] + fixed[2]
            if held > 2:
                return p, y, lam, low, it + 1, FAILED
            return p, y, lam, low, it + 1, BOUNDARY if held else OK
    return p, y, lam, low, MAX_ITERATIONS, FAILED


@njit(cache=True, fastmath=FAST, error_model="numpy")
def inside(p, box):
    """Whether p lies in the box, up to rounding."""
    for a in range(3):
        if p[a] < box[0, a] - 1e-9 or p[a] > box[1, a] + 1e-9:
            return False
    return True


@njit(cache=True, fastmath=FAST, error_model="numpy")
def outside(geom, p):
    """Whether p lies beyond an open end of the domain, in the continuation."""
    for a in range(3):
        if geom[6 + a] == 0.0 and (p[a] < 0.0 or p[a] > geom[9 + a]):
            return True
    return False


@njit(cache=True, fastmath=FAST, error_model="numpy")
def reachable(geom, p, q):
    """Whether the foot p counts for the query q: a continued foot only for queries near that end."""
    for a in range(3):
        if geom[6 + a] == 0.0 and (p[a] < 0.0 or p[a] > geom[9 + a]) and abs(p[a] - q[a]) > 2.0:
            return False
    return True


@njit(cache=True, fastmath=FAST, error_model="numpy")
def unlikely(x, sx, sn, i, h, best):
    """Cheap rejection of a further start: its patch cannot hold a foot nearer than `best`.

    A foot within h of the seed s has its normal along x - foot, so the tangential part of
    x - s is at most h plus what the normal turns over h; and the patch is nearer than `best`
    only if the normal part is.
    """
    v0, v1, v2 = x[0] - sx[i, 0], x[1] - sx[i, 1], x[2] - sx[i, 2]
    a = v0 * sn[i, 0] + v1 * sn[i, 1] + v2 * sn[i, 2]
    tangential = np.sqrt(max(v0 * v0 + v1 * v1 + v2 * v2 - a * a, 0.0))
    return tangential > 0.6 * h + 0.4 * abs(a) or abs(a) > best + 0.2 * h


@njit(cache=True, fastmath=FAST, error_model="numpy")
def row_near(a, i, j, y, h):
    """Whether the point a[i, j:j+3] is within h of y."""
    d0, d1, d2 = a[i, j] - y[0], a[i, j + 1] - y[1], a[i, j + 2] - y[2]
    return d0 * d0 + d1 * d1 + d2 * d2 < h * h


@njit(cache=True, fastmath=FAST, error_model="numpy")
def tried(sx, idx, row, used, s, h):
    """Whether a start within h of the seed s has been made; `used` has a bit per candidate."""
    for c in range(idx.shape[1]):
        if used & (1 << c) and row_near(sx, idx[row, c], 0, s, h):
            return True
    return False


@njit(cache=True, fastmath=FAST, error_model="numpy")
def store(feet, i, p, y, dist, lam):
    """Fill a foot row."""
    feet[i, 0], feet[i, 1], feet[i, 2] = p[0], p[1], p[2]
    feet[i, 3], feet[i, 4], feet[i, 5] = y[0], y[1], y[2]
    feet[i, 6] = dist
    feet[i, 7] = lam


@njit(cache=True, fastmath=FAST, error_model="numpy")
def same_patch(sx, sn, s, x, feet, i, near_h, far_h):
    """Whether seed s lies on the patch of the foot in row i: close to it, and facing x alike."""
    y = (sx[s, 0], sx[s, 1], sx[s, 2])
    if not row_near(feet, i, 3, y, far_h):
        return False
    if row_near(feet, i, 3, y, near_h):
        return True
    v = (x[0] - feet[i, 3], x[1] - feet[i, 4], x[2] - feet[i, 5])
    a = (x[0] - y[0]) * sn[s, 0] + (x[1] - y[1]) * sn[s, 1] + (x[2] - y[2]) * sn[s, 2]
    turn = v[0] * sn[s, 0] + v[1] * sn[s, 1] + v[2] * sn[s, 2]
    return (turn if a > 0.0 else -turn) > 0.7 * feet[i, 6]


@njit(cache=True, fastmath=FAST, error_model="numpy")
def wanted(sx, sn, idx, row, c, x, feet, seconds, i, used, h):
    """Whether candidate c is worth a start, given the feet found so far."""
    s = idx[row, c]
    y = (sx[s, 0], sx[s, 1], sx[s, 2])
    close = min(0.2 * h, 0.5 * feet[i, 6])
    if same_patch(sx, sn, s, x, feet, i, close, 1.2 * h):
        return False
    if seconds[i, 6] < np.inf and same_patch(sx, sn, s, x, seconds, i, close, 1.2 * h):
        return False
    return not unlikely(x, sx, sn, s, h, feet[i, 6]) and not tried(sx, idx, row, used, y, 0.5 * h)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def accept(geom, box, orient, m, p, y, x, q, lam, st, h, feet, seconds, i, empty):
    """File a converged foot as best or second best: 2 if it is the best now, 1 if not, 0 if void."""
    if st >= FAILED or not inside(p, box) or not reachable(geom, p, q):
        return 0
    if outside(geom, p) and cofactor_normal(m, p)[1] * orient <= 0.0:
        return 0
    dist = np.sqrt((x[0] - y[0]) ** 2 + (x[1] - y[1]) ** 2 + (x[2] - y[2]) ** 2)
    same = row_near(feet, i, 3, y, 0.05 * h) and not empty
    if empty or dist < feet[i, 6]:
        if not empty and not same:
            for j in range(8):
                seconds[i, j] = feet[i, j]
        store(feet, i, p, y, dist, lam)
        return 2
    if dist < seconds[i, 6] and not same:
        store(seconds, i, p, y, dist, lam)
    return 1


@njit(cache=True, fastmath=FAST, error_model="numpy")
def multi_start(
    d0, d1, d2, k0, k1, k2, c, geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc,
    sp, sx, sn, sh, x, q, idx, row, box, clip, orient, tol, feet, seconds, i, b, m, t, tab,
):  # fmt: skip
    """Best and second-best distinct foot of x over the candidate seeds idx[row].

    Rows i of `feet` and `seconds` (n, 8) receive p (3), y (3), distance and multiplier. Returns
    the number of starts, of iterations, and the status.
    """
    starts = 0
    iterations = 0
    status = FALLBACK
    used = 0
    soft = 1.0
    along = (0.0, 0.0, 0.0)
    feet[i, 6] = np.inf
    seconds[i, 6] = np.inf
    first = idx[row, 0]
    reach = seed_distance(sx, first, x)
    for a in range(idx.shape[1] + 2):
        # first the seeds, then both ways along a direction in which the best foot is loose
        h = sh[first]
        if a < idx.shape[1]:
            s = idx[row, a]
            if s < 0:
                continue
            h = sh[s]
            if seed_distance(sx, s, x) > reach + 2.0 * h:
                continue
            if status != FALLBACK and not wanted(sx, sn, idx, row, a, x, feet, seconds, i, used, h):
                continue
            used |= 1 << a
            start = (sp[s, 0], sp[s, 1], sp[s, 2])
        else:
            if status != OK or soft > LOOSE:
                break
            s = min(h, 0.5 * feet[i, 6]) * (1.0 if a == idx.shape[1] else -1.0)
            start = (
                feet[i, 0] + s * along[0], feet[i, 1] + s * along[1], feet[i, 2] + s * along[2],
            )  # fmt: skip
        best = (feet[i, 3], feet[i, 4], feet[i, 5], feet[i, 6])
        p, y, lam, low, n, st = newton(
            d0, d1, d2, k0, k1, k2, c, geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc,
            x, start, best, box, clip, h, tol, b, m, t, tab,
        )  # fmt: skip
        starts += 1
        iterations += n
        filed = accept(
            geom, box, orient, m, p, y, x, q, lam, st, h, feet, seconds, i, status == FALLBACK
        )
        if filed == 2:
            status = st
            soft = low
            if low <= LOOSE:
                along = soft_direction(m, t, x, lam, low)
    if status == FALLBACK:
        p = (sp[first, 0], sp[first, 1], sp[first, 2])
        store(feet, i, p, (sx[first, 0], sx[first, 1], sx[first, 2]), reach, 0.0)
    return starts, iterations, status


@njit(cache=True, fastmath=FAST, error_model="numpy")
def seed_distance(sx, s, x):
    """Distance of x to seed s."""
    return np.sqrt((x[0] - sx[s, 0]) ** 2 + (x[1] - sx[s, 1]) ** 2 + (x[2] - sx[s, 2]) ** 2)


@njit(cache=True, parallel=True, fastmath=FAST, error_model="numpy")
def closest(
    d0, d1, d2, k0, k1, k2, c, geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc,
    sp, sx, sn, sh, x, q, idx, box, clip, orient, tol, feet, seconds, counts, status,
):  # fmt: skip
    """Foot points of many queries.

    Parameters
    ----------
    d0 ... tc
        The lattice, see the module.
    sp, sx, sn, sh
        Seeds: tile coordinates, image, unit normal (s, 3), and spacing (s,).
    x, q
        Queries in space and in tile coordinates, (n, 3).
    idx
        Candidate seeds, nearest first, (n, K), K <= 60; -1 ends a row.
    box, clip, orient, tol
        Admissible box of feet (2, 3), whether it is a constraint, sign of det J, tolerance.
    feet, seconds
        Output (n, 8): foot p, foot in space, distance with the sign of I(q), multiplier.
    counts
        Output (n, 2): starts and iterations.
    status
        Output (n,).
    """
    n = len(x)
    for chunk in prange((n + CHUNK - 1) // CHUNK):
        b, m, t, tab = scratch(factor, c, k0, k1, k2, q0, q1, q2)
        for i in range(chunk * CHUNK, min(n, (chunk + 1) * CHUNK)):
            xi = (x[i, 0], x[i, 1], x[i, 2])
            qi = (q[i, 0], q[i, 1], q[i, 2])
            starts, iterations, st = multi_start(
                d0, d1, d2, k0, k1, k2, c, geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc,
                sp, sx, sn, sh, xi, qi, idx, i, box, clip, orient, tol, feet, seconds, i, b, m, t, tab,
            )  # fmt: skip
            counts[i, 0] = starts
            counts[i, 1] = iterations
            status[i] = st
            tile_jet(geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc, qi, b, t, tab)
            if t[0] < 0.0:
                feet[i, 6] = -feet[i, 6]
                seconds[i, 6] = -seconds[i, 6]
            elif t[0] == 0.0:
                feet[i, 6] = 0.0


@njit(cache=True, fastmath=FAST, error_model="numpy")
def thickness_at(h0, h1, h2, l0, l1, l2, hc, geom, p, hb):
    """Half-thickness and its gradient in tile coordinates at p."""
    i = basis(h0, l0, parameter(geom, 0, p[0]), 1, hb, 0)
    j = basis(h1, l1, parameter(geom, 1, p[1]), 1, hb, 1)
    k = basis(h2, l2, parameter(geom, 2, p[2]), 1, hb, 2)
    f, fu, fv, fw = contract1(hc, 0, i, j, k, l0, l1, l2, hb)
    return f, (fu * geom[3], fv * geom[4], fw * geom[5])


@njit(cache=True, fastmath=FAST, error_model="numpy")
def free_metric(gm, fixed):
    """The metric with fixed directions decoupled."""
    a0, a1, a2 = 1.0 - fixed[0], 1.0 - fixed[1], 1.0 - fixed[2]
    return (
        gm[0] * a0 + fixed[0],
        gm[1] * a1 + fixed[1],
        gm[2] * a2 + fixed[2],
        gm[3] * a1 * a2,
        gm[4] * a0 * a2,
        gm[5] * a0 * a1,
    )


@njit(cache=True, fastmath=FAST, error_model="numpy")
def pull(jac, n, side, dd, fixed):
    """Gradient in tile coordinates, among free directions, of side * distance - thickness."""
    j0, j1, j2 = jac
    return (
        (side * (j0[0] * n[0] + j1[0] * n[1] + j2[0] * n[2]) - dd[0]) * (1 - fixed[0]),
        (side * (j0[1] * n[0] + j1[1] * n[1] + j2[1] * n[2]) - dd[1]) * (1 - fixed[1]),
        (side * (j0[2] * n[0] + j1[2] * n[1] + j2[2] * n[2]) - dd[2]) * (1 - fixed[2]),
    )


@njit(cache=True, fastmath=FAST, error_model="numpy")
def foot_normal(
    d0, d1, d2, k0, k1, k2, c, geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc,
    feet, i, x, sign, h, b, m, t, tab,
):  # fmt: skip
    """Unit gradient of the signed distance at x: along x - foot, or the normal if x is the foot."""
    v0, v1, v2 = x[0] - feet[i, 3], x[1] - feet[i, 4], x[2] - feet[i, 5]
    s = np.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
    if s > 1e-6 * h:
        s = sign / s
        return (s * v0, s * v1, s * v2)
    p = (feet[i, 0], feet[i, 1], feet[i, 2])
    map_jet(d0, d1, d2, k0, k1, k2, c, geom, p, 1, b, m)
    tile_jet(geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc, p, b, t, tab)
    n, det = cofactor_normal(m, (t[1], t[2], t[3]))
    s = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]) + 1e-300
    if det < 0.0:
        s = -s
    return (n[0] / s, n[1] / s, n[2] / s)


@njit(cache=True, fastmath=FAST, error_model="numpy")
def two_step(gm, a, fa, b, fb):
    """Least step, in the metric, with a.step = -fa, and b.step = -fb if the first alone breaks it."""
    ia, _ = solve_sym(gm, a)
    aa = a[0] * ia[0] + a[1] * ia[1] + a[2] * ia[2]
    if not aa > 0.0:
        return (0.0, 0.0, 0.0)
    s = -fa / aa
    d = (s * ia[0], s * ia[1], s * ia[2])
    if not fb < np.inf:
        return d
    ib, _ = solve_sym(gm, b)
    ab = a[0] * ib[0] + a[1] * ib[1] + a[2] * ib[2]
    bb = b[0] * ib[0] + b[1] * ib[1] + b[2] * ib[2]
    det = aa * bb - ab * ab
    if fb + s * ab > 0.0 or det <= 0.001 * aa * bb:
        return d
    s = (-fa * bb + fb * ab) / det
    r = (-fb * aa + fa * ab) / det
    return (s * ia[0] + r * ib[0], s * ia[1] + r * ib[1], s * ia[2] + r * ib[2])


@njit(cache=True, fastmath=FAST, error_model="numpy")
def polish_point(
    d0, d1, d2, k0, k1, k2, c, geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc,
    h0, h1, h2, l0, l1, l2, hc,
    sp, sx, sn, sh, start, fixed, side, idx, row, box, clip, orient, tol, limit,
    feet, seconds, hb, b, m, t, tab,
):  # fmt: skip
    """Move a point onto side * signed distance = thickness; the point and the last residual."""
    p = start
    residual = np.inf
    h = sh[idx[row, 0]]
    for _ in range(POLISH_STEPS):
        map_jet(d0, d1, d2, k0, k1, k2, c, geom, p, 1, b, m)
        x = (m[0, 0], m[1, 0], m[2, 0])
        jac = (
            (m[0, 1], m[0, 2], m[0, 3]), (m[1, 1], m[1, 2], m[1, 3]), (m[2, 1], m[2, 2], m[2, 3]),
        )  # fmt: skip
        gm = free_metric(metric(m), fixed)
        tile_jet(geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc, p, b, t, tab)
        sign = -1.0 if t[0] < 0.0 else 1.0
        _, _, st = multi_start(
            d0, d1, d2, k0, k1, k2, c, geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc,
            sp, sx, sn, sh, x, p, idx, row, box, clip, orient, tol, feet, seconds, 0, b, m, t, tab,
        )  # fmt: skip
        if st >= FALLBACK:
            return start, np.inf
        d, dd = thickness_at(h0, h1, h2, l0, l1, l2, hc, geom, p, hb)
        f = side * sign * feet[0, 6] - d
        residual = abs(f)
        if residual <= limit:
            return p, residual
        n = foot_normal(
            d0, d1, d2, k0, k1, k2, c, geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc,
            feet, 0, x, sign, h, b, m, t, tab,
        )  # fmt: skip
        a = pull(jac, n, side, dd, fixed)
        g, fb = a, np.inf
        if seconds[0, 6] < np.inf:
            n = foot_normal(
                d0, d1, d2, k0, k1, k2, c, geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc,
                seconds, 0, x, sign, h, b, m, t, tab,
            )  # fmt: skip
            g = pull(jac, n, side, dd, fixed)
            fb = side * sign * seconds[0, 6] - d
        step = two_step(gm, a, f, g, fb)
        size = np.sqrt(max(sym(gm, step, step), 0.0))
        if not size > 0.0 or not size < np.inf:
            return p, residual
        s = min(1.0, 0.5 * h / size)
        p = (
            moved(geom, 0, p[0], s * step[0] * (1 - fixed[0])),
            moved(geom, 1, p[1], s * step[1] * (1 - fixed[1])),
            moved(geom, 2, p[2], s * step[2] * (1 - fixed[2])),
        )
    return p, residual


@njit(cache=True, fastmath=FAST, error_model="numpy")
def moved(geom, axis, p, step):
    """A tile coordinate after a step, kept inside the domain."""
    p += step
    return p if geom[6 + axis] != 0.0 else min(max(p, 0.0), geom[9 + axis])


@njit(cache=True, parallel=True, fastmath=FAST, error_model="numpy")
def polish(
    d0, d1, d2, k0, k1, k2, c, geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc,
    h0, h1, h2, l0, l1, l2, hc,
    sp, sx, sn, sh, p, fixed, side, idx, box, clip, orient, tol, limit, residual,
):  # fmt: skip
    """Move points p (n, 3), in place, onto the offset surface; residual (n,), inf if lost.

    `fixed` (n, 3) holds 1 where a coordinate must not move, `side` (n,) is +1 or -1.
    """
    n = len(p)
    for chunk in prange((n + CHUNK - 1) // CHUNK):
        b, m, t, tab = scratch(factor, c, k0, k1, k2, q0, q1, q2)
        hb = np.zeros((3, 3, max(len(l0), len(l1), len(l2))))
        feet = np.empty((1, 8))
        seconds = np.empty((1, 8))
        for i in range(chunk * CHUNK, min(n, (chunk + 1) * CHUNK)):
            start = (p[i, 0], p[i, 1], p[i, 2])
            held = (fixed[i, 0], fixed[i, 1], fixed[i, 2])
            end, residual[i] = polish_point(
                d0, d1, d2, k0, k1, k2, c, geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc,
                h0, h1, h2, l0, l1, l2, hc,
                sp, sx, sn, sh, start, held, side[i], idx, i, box, clip, orient, tol, limit,
                feet, seconds, hb, b, m, t, tab,
            )  # fmt: skip
            p[i, 0], p[i, 1], p[i, 2] = end


@njit(cache=True, parallel=True, error_model="numpy")
def project(
    d0, d1, d2, k0, k1, k2, c, geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc,
    p, fixed, limit, travel,
):  # fmt: skip
    """Move points p (n, 3), in place, onto I = 0 along grad I; the distance moved, or inf."""
    n = len(p)
    for chunk in prange((n + CHUNK - 1) // CHUNK):
        b, m, t, tab = scratch(factor, c, k0, k1, k2, q0, q1, q2)
        for i in range(chunk * CHUNK, min(n, (chunk + 1) * CHUNK)):
            x0, x1, x2 = p[i, 0], p[i, 1], p[i, 2]
            travel[i] = np.inf
            for _ in range(MAX_ITERATIONS):
                tile_jet(geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc, (x0, x1, x2), b, t, tab)
                g0 = t[1] * (1 - fixed[i, 0])
                g1 = t[2] * (1 - fixed[i, 1])
                g2 = t[3] * (1 - fixed[i, 2])
                gg = g0 * g0 + g1 * g1 + g2 * g2
                if not gg > 0.0:
                    break
                s = -t[0] / gg
                size = abs(s) * np.sqrt(gg)
                if size > limit:
                    s *= limit / size
                x0 += s * g0
                x1 += s * g1
                x2 += s * g2
                if size < 1e-13:
                    travel[i] = np.sqrt(
                        (x0 - p[i, 0]) ** 2 + (x1 - p[i, 1]) ** 2 + (x2 - p[i, 2]) ** 2
                    )
                    p[i, 0], p[i, 1], p[i, 2] = x0, x1, x2
                    break


@njit(cache=True, parallel=True, fastmath=FAST, error_model="numpy")
def place_seeds(
    d0, d1, d2, k0, k1, k2, c, geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc,
    p, cell, x, normal, spacing, det,
):  # fmt: skip
    """Image, unit normal, size of the image of a cell (n, 3), and det J at points p (n, 3)."""
    n = len(p)
    for chunk in prange((n + CHUNK - 1) // CHUNK):
        b, m, t, tab = scratch(factor, c, k0, k1, k2, q0, q1, q2)
        for i in range(chunk * CHUNK, min(n, (chunk + 1) * CHUNK)):
            pi = (p[i, 0], p[i, 1], p[i, 2])
            map_jet(d0, d1, d2, k0, k1, k2, c, geom, pi, 1, b, m)
            tile_jet(geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc, pi, b, t, tab)
            v, det[i] = cofactor_normal(m, (t[1], t[2], t[3]))
            s = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) + 1e-300
            big = 0.0
            for a in range(3):
                x[i, a] = m[a, 0]
                normal[i, a] = v[a] / s
                size = m[0, a + 1] ** 2 + m[1, a + 1] ** 2 + m[2, a + 1] ** 2
                big = max(big, size * cell[i, a] ** 2)
            spacing[i] = np.sqrt(big)
