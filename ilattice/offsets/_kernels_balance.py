"""Compiled Newton iteration for points whose feet pull in opposite directions.

Unknown are the point, its m feet with their multipliers, weights l_i of sum 1, and the common
value r. Each foot is a stationary point of the distance on the surface, the distances less the
half-thickness are r, and sum l_i grad (distance_i - half-thickness) = 0 along the free directions.
The feet are unknowns of their own, not functions of the point: these have no derivative on focal
curves, where feet become one, and Newton's method goes on across them.

Guarantee: nothing is allocated per start; the same result for any number of threads.
Non-guarantee: which critical point a start ends in, and whether no other foot is nearer there. The
arguments are those of `_kernels_jets`; e0 ... ec is the half-thickness, as a spline.
"""

import numpy as np
from numba import njit, prange

from ilattice.offsets._kernels_hull import solve_small
from ilattice.offsets._kernels_jets import FAST, map_jet, metric, scratch, tile_jet
from ilattice.offsets._kernels_newton import lagrangian, lowest

CHUNK, MOST = 32, 4
STEPS, PATIENCE = 25, 9
#: Longest steps of the point and of feet, and the step that is the last one, in tiles.
LONGEST, WANDER, STILL = 0.06, 0.15, 1e-11


@njit(cache=True, fastmath=FAST, error_model="numpy")
def second(m, a, i, j):
    """Second derivative i, j of row a of a jet."""
    if i == j:
        return m[a, 4 + i]
    return m[a, 10 - i - j]


@njit(cache=True, fastmath=FAST, error_model="numpy")
def column(m, i, v):
    """v' times column i of the Jacobian of a jet."""
    return v[0] * m[0, 1 + i] + v[1] * m[1, 1 + i] + v[2] * m[2, 1 + i]


@njit(cache=True, fastmath=FAST, error_model="numpy")
def add_foot(a, y, i, m, x, f, t, h, weight, mult, value, length, held, first):
    """Equations of foot i: jets x of the map at the point and f at the foot, t of the tile, h.

    Returns the multiplier, estimated if this is the first step, and the distance.
    """
    o, q, n = 3 + 4 * i, 3 + 4 * m + i, 3 + 5 * m
    r = (f[0, 0] - x[0, 0], f[1, 0] - x[1, 0], f[2, 0] - x[2, 0])
    d = np.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    v = (-r[0] / d, -r[1] / d, -r[2] / d)
    square = length * length
    pull = (column(f, 0, r), column(f, 1, r), column(f, 2, r))
    if first:
        gg = t[1] * t[1] + t[2] * t[2] + t[3] * t[3]
        mult = -(pull[0] * t[1] + pull[1] * t[2] + pull[2] * t[3]) / (gg * square)
        value = (d - h[0, 0]) / length
    bend = lagrangian(metric(f), f, t, r, mult * square)
    full = ((bend[0], bend[5], bend[4]), (bend[5], bend[1], bend[3]), (bend[4], bend[3], bend[2]))
    for j in range(3):
        y[o + j] = pull[j] / square + mult * t[1 + j]
        a[o + j, o + 3] = a[o + 3, o + j] = t[1 + j]
        for k in range(3):
            a[o + j, o + k] = full[j][k] / square
    y[o + 3] = t[0]
    y[q] = (d - h[0, 0]) / length - value
    a[q, n], a[n, q] = -1.0, 1.0
    for j in range(3):
        a[q, o + j] = -column(f, j, v) / length
        if held[j]:
            continue
        xj = (x[0, 1 + j], x[1, 1 + j], x[2, 1 + j])
        along = column(x, j, v)
        slope = (along - h[0, 1 + j]) / length
        a[q, j] = a[j, q] = slope
        y[j] += weight * slope
        for k in range(3):
            cross = column(f, k, xj) - along * column(f, k, v)
            a[o + k, j] = -column(f, k, xj) / square
            a[j, o + k] = -weight * cross / (d * length)
            if not held[k]:
                inner = (column(x, k, xj) - along * column(x, k, v)) / d - second(h, 0, j, k)
                for c in range(3):
                    inner += v[c] * second(x, c, j, k)
                a[j, k] += weight * inner / length
    return mult, value


@njit(cache=True, fastmath=FAST, error_model="numpy")
def shortened(y, m):
    """Size of a step, in tiles, after it was made no longer than is allowed."""
    point, feet = 0.0, 0.0
    for j in range(3):
        point = max(point, abs(y[j]))
        for i in range(m):
            feet = max(feet, abs(y[3 + 4 * i + j]))
    size = max(point, feet)
    if not size < np.inf:
        return np.inf
    s = min(1.0, LONGEST / (point + 1e-300), WANDER / (feet + 1e-300))
    if s < 1.0:
        for j in range(3 + 5 * m + 1):
            y[j] *= s
    return size


@njit(cache=True, parallel=True, fastmath=FAST, error_model="numpy")
def balance(
    d0, d1, d2, k0, k1, k2, c, geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc,
    e0, e1, e2, l0, l1, l2, ec, p, feet, weights, count, held, reach, last, low,
):  # fmt: skip
    """Newton's method from many starts, in place.

    Parameters
    ----------
    d0 ... tc
        The lattice, see `_kernels_jets`; all lengths generic.
    e0 ... ec
        Half-thickness, a spline over the same domain.
    p
        Points (n, 3) in tile coordinates.
    feet, weights, count
        Their feet (n, 4, 3) in tile coordinates, weights (n, 4), and numbers of feet (n,).
    held
        Which directions of a point are held (3,).
    reach
        How far points may go, in tiles.
    last
        Output (n,): the last step, in tiles; infinite where the method is lost.
    low
        Output (n,): the least eigenvalue of `lowest` at the feet; saddles have negative ones.
    """
    plain = geom.copy()
    plain[12] = 0.0
    for chunk in prange((len(p) + CHUNK - 1) // CHUNK):
        b, x, t, tab = scratch(factor, c, k0, k1, k2, q0, q1, q2)
        more = scratch(factor, ec, l0, l1, l2, l0, l1, l2)
        taken, h, f = more[0], more[1], np.zeros_like(x)
        a, y = np.zeros((4 + 5 * MOST, 4 + 5 * MOST)), np.zeros(4 + 5 * MOST)
        mult, value = np.zeros(MOST), np.zeros(MOST)
        for s in range(chunk * CHUNK, min(len(p), (chunk + 1) * CHUNK)):
            m = count[s]
            n = 4 + 5 * m
            start = (p[s, 0], p[s, 1], p[s, 2])
            common = 0.0
            length = 1.0
            last[s] = np.inf
            for step in range(STEPS):
                at = (p[s, 0], p[s, 1], p[s, 2])
                map_jet(d0, d1, d2, k0, k1, k2, c, geom, at, 2, b, x)
                map_jet(e0, e1, e2, l0, l1, l2, ec, plain, at, 2, taken, h)
                if step == 0:
                    g = metric(x)
                    length = np.sqrt((g[0] + g[1] + g[2]) / 3.0)
                a[:n, :n] = 0.0
                y[:n] = 0.0
                for i in range(m):
                    at = (feet[s, i, 0], feet[s, i, 1], feet[s, i, 2])
                    map_jet(d0, d1, d2, k0, k1, k2, c, geom, at, 2, b, f)
                    tile_jet(
                        geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc, at, b, t, tab
                    )  # fmt: skip
                    mult[i], value[i] = add_foot(
                        a, y, i, m, x, f, t, h, weights[s, i], mult[i], common, length, held,
                        step == 0,
                    )  # fmt: skip
                if step == 0:
                    for i in range(m):
                        common += weights[s, i] * value[i]
                    for i in range(m):
                        y[3 + 4 * m + i] = value[i] - common
                y[n - 1] = -1.0
                for i in range(m):
                    y[n - 1] += weights[s, i]
                for j in range(3):
                    if held[j]:
                        a[j, j] = 1.0
                solve_small(a, y, n)
                size = shortened(y, m)
                if not size < np.inf:
                    break
                for j in range(3):
                    p[s, j] -= y[j]
                    for i in range(m):
                        feet[s, i, j] -= y[3 + 4 * i + j]
                for i in range(m):
                    mult[i] -= y[6 + 4 * i]
                    weights[s, i] -= y[3 + 4 * m + i]
                common -= y[n - 1]
                away = max(
                    abs(p[s, 0] - start[0]), abs(p[s, 1] - start[1]), abs(p[s, 2] - start[2])
                )
                if away > reach or (step > PATIENCE and size > 0.01):
                    break
                if size < STILL or step == STEPS - 1:
                    last[s], low[s] = size, np.inf
                    for i in range(m):
                        at = (feet[s, i, 0], feet[s, i, 1], feet[s, i, 2])
                        map_jet(d0, d1, d2, k0, k1, k2, c, geom, at, 2, b, f)
                        tile_jet(
                            geom, coef, factor, omega, t0, t1, t2, q0, q1, q2, tc, at, b, t, tab
                        )  # fmt: skip
                        r = (f[0, 0] - x[0, 0], f[1, 0] - x[1, 0], f[2, 0] - x[2, 0])
                        low[s] = min(low[s], lowest(f, t, r, mult[i] * length * length))
                    break
