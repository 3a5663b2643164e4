"""Compiled Newton iteration for points whose feet pull in opposite directions.

Unknown are the point, its m feet with their multipliers, weights l_i of sum 1, and the common
value r. Each foot is a stationary point of the distance on the surface, the distances less the
half-thickness are r, and sum l_i grad (distance_i - half-thickness) = 0 along the free directions.
The feet are unknowns of their own, not functions of the point: these have no derivative on focal
curves, where feet become one, and Newton's method goes on across them.

Guarantee: nothing is allocated per start; the same result for any number of threads.
Non-guarantee: which critical point a start ends in, and whether no other foot is nearer there. The
lattice is that of `_kernels_jets`; so is `less`, the map of which is the half-thickness.
"""

import numpy as np

from ilattice._kernels import in_ranges, inner, outer
from ilattice._kernels_tuples import borrowed
from ilattice.offsets._kernels_jets import FAST, map_jet, metric, scratch, tile_jet
from ilattice.offsets._kernels_newton import lagrangian, lowest
from ilattice.topology._kernels_hull import solve_small

#: Points that a thread takes at once, and feet that a balance has: those of a simplex.
CHUNK, MAX_FEET = 32, 4
#: Steps of a search, and steps without gain after which it ends.
STEPS, PATIENCE = 25, 9
#: Longest steps of the point and of feet, and the step that is the last one, in tiles.
LONGEST, WANDER, STILL = 0.06, 0.15, 1e-11
#: Pivots up to this are those of critical points that are not isolated: no step is made there.
SINGULAR = 1e-9
#: Residuals up to this, in tiles, are none.
LEFT = 1e-6
#: First pivots up to this may be those near them, where steps along them are damped.
SMALL = 1e-2
#: Weight of the square of a step against that of its residual where a step is too long.
DAMPING = 1e-4


@inner(fastmath=FAST, error_model="numpy")
def second(m, a, i, j):
    """Second derivative i, j of row a of a jet."""
    if i == j:
        return m[a, 4 + i]
    return m[a, 10 - i - j]


@inner(fastmath=FAST, error_model="numpy")
def column(m, i, v):
    """v' times column i of the Jacobian of a jet."""
    return v[0] * m[0, 1 + i] + v[1] * m[1, 1 + i] + v[2] * m[2, 1 + i]


@inner(fastmath=FAST, error_model="numpy")
def look(space, less, p, feet, m, work):
    """Jets of the map and of the half-thickness at a point, and of map and tile at its m feet.

    Those of the tile are divided by the length of its gradient at the first place of a foot, as the
    unit of its values means nothing.
    """
    b, x, tab, h, taken, f, t, unit = work
    map_jet(space, (p[0], p[1], p[2]), 2, b, x)
    map_jet(less, (p[0], p[1], p[2]), 2, taken, h)
    for i in range(m):
        at = (feet[i, 0], feet[i, 1], feet[i, 2])
        map_jet(space, at, 2, b, f[i])
        tile_jet(space, at, b, t[i], tab)
        if unit[i] == 0.0:
            unit[i] = np.sqrt(t[i, 1] ** 2 + t[i, 2] ** 2 + t[i, 3] ** 2)
        for k in range(t.shape[1]):
            t[i, k] /= unit[i]


@inner(fastmath=FAST, error_model="numpy")
def away(x, f):
    """From a point to its foot, from their jets."""
    return f[0, 0] - x[0, 0], f[1, 0] - x[1, 0], f[2, 0] - x[2, 0]


@inner(fastmath=FAST, error_model="numpy")
def estimate(m, work, weights, length, mult):
    """First multipliers of feet; the mean of the distances to them, less the half-thickness."""
    _, x, _, h, _, f, t, _ = work
    common = 0.0
    for i in range(m):
        r = away(x, f[i])
        g = (t[i, 1], t[i, 2], t[i, 3])
        along = 0.0
        for j in range(3):
            along += column(f[i], j, r) * g[j]
        mult[i] = -along / ((g[0] * g[0] + g[1] * g[1] + g[2] * g[2]) * length * length)
        d = np.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
        common += weights[i] * (d - h[0, 0]) / length
    return common


@inner(fastmath=FAST, error_model="numpy")
def add_foot(a, y, i, m, x, f, t, h, weight, mult, common, length, fixed):
    """Add the equations of foot i of m: jets x of the map at the point and f at the foot, t, h."""
    o, q, n = 3 + 4 * i, 3 + 4 * m + i, 3 + 5 * m
    r = away(x, f)
    d = np.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    v = (-r[0] / d, -r[1] / d, -r[2] / d)
    square = length * length
    bend = lagrangian(metric(f), f, t, r, mult * square)
    full = ((bend[0], bend[5], bend[4]), (bend[5], bend[1], bend[3]), (bend[4], bend[3], bend[2]))
    for j in range(3):
        y[o + j] = column(f, j, r) / square + mult * t[1 + j]
        a[o + j, o + 3] = a[o + 3, o + j] = t[1 + j]
        for k in range(3):
            a[o + j, o + k] = full[j][k] / square
    y[o + 3] = t[0]
    y[q] = (d - h[0, 0]) / length - common
    a[q, n], a[n, q] = -1.0, 1.0
    for j in range(3):
        a[q, o + j] = -column(f, j, v) / length
        if fixed[j]:
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
            if not fixed[k]:
                inner = (column(x, k, xj) - along * column(x, k, v)) / d - second(h, 0, j, k)
                for c in range(3):
                    inner += v[c] * second(x, c, j, k)
                a[j, k] += weight * inner / length


@inner(fastmath=FAST, error_model="numpy")
def assemble(a, y, m, work, weights, mult, common, length, fixed):
    """Equations of a point and its m feet."""
    _, x, _, h, _, f, t, _ = work
    n = 4 + 5 * m
    a[:n, :n] = 0.0
    y[:n] = 0.0
    y[n - 1] = -1.0
    for i in range(m):
        add_foot(a, y, i, m, x, f[i], t[i], h, weights[i], mult[i], common, length, fixed)
        y[n - 1] += weights[i]
    for j in range(3):
        if fixed[j]:
            a[j, j] = 1.0


@inner(fastmath=FAST, error_model="numpy")
def solved(a, y, m, work, weights, mult, common, length, fixed):
    """Whether all equations are, those too that a step leaves out as their pivots are none."""
    assemble(a, y, m, work, weights, mult, common, length, fixed)
    most = 0.0
    for i in range(4 + 5 * m):
        most = max(most, abs(y[i]))
    return most < LEFT


@inner(fastmath=FAST, error_model="numpy")
def too_long(y, m):
    """Size of a step, in tiles, and by what factor it is longer than is allowed, or 1."""
    point, feet = 0.0, 0.0
    for j in range(3):
        point = max(point, abs(y[j]))
        for i in range(m):
            feet = max(feet, abs(y[3 + 4 * i + j]))
    return max(point, feet), max(1.0, point / LONGEST, feet / WANDER)


@inner(fastmath=FAST, error_model="numpy")
def solve_damped(a, y, n, square, right):
    """Short solution of the first n equations a x = y, in y: of least residual and x together."""
    for i in range(n):
        right[i] = 0.0
        for k in range(n):
            right[i] += a[k, i] * y[k]
        for j in range(i + 1):
            total = DAMPING if i == j else 0.0
            for k in range(n):
                total += a[k, i] * a[k, j]
            square[i, j] = square[j, i] = total
    solve_small(square, right, n, 0.0)
    for i in range(n):
        y[i] = right[i]


@inner(fastmath=FAST, error_model="numpy")
def move(y, m, p, feet, weights, mult):
    """Subtract a step from all unknowns but the common value."""
    for j in range(3):
        p[j] -= y[j]
        for i in range(m):
            feet[i, j] -= y[3 + 4 * i + j]
    for i in range(m):
        mult[i] -= y[6 + 4 * i]
        weights[i] -= y[3 + 4 * m + i]


@inner(fastmath=FAST, error_model="numpy")
def lowest_of_feet(m, work, mult, square):
    """Least eigenvalue of `lowest` at m feet."""
    _, x, _, _, _, f, t, _ = work
    low = np.inf
    for i in range(m):
        low = min(low, lowest(f[i], t[i], away(x, f[i]), mult[i] * square))
    return low


@inner(fastmath=FAST, error_model="numpy")
def solve(
    space, less, p, feet, weights, m, fixed, reach, damping, work, a, y, square, right, mult
):  # fmt: skip
    """Newton's method from one start, in place: the last step, `lowest_of_feet`, least pivot.

    With damping, steps that are too long, because the equations are nearly singular, are replaced.
    Where the method is lost, the pivot is that of the first step.
    """
    s0, s1, s2 = p[0], p[1], p[2]
    n = 4 + 5 * m
    _, x, _, _, _, _, _, unit = work
    unit[:] = 0.0
    look(space, less, p, feet, m, work)
    g = metric(x)
    length = np.sqrt((g[0] + g[1] + g[2]) / 3.0)
    common, first = estimate(m, work, weights, length, mult), 0.0
    for step in range(STEPS):
        assemble(a, y, m, work, weights, mult, common, length, fixed)
        pivot = solve_small(a, y, n, SINGULAR)
        first = pivot if step == 0 else first
        size, factor = too_long(y, m)
        if damping and factor > 1.0:  # others are almost as good, and shorter
            assemble(a, y, m, work, weights, mult, common, length, fixed)
            solve_damped(a, y, n, square, right)
            _, factor = too_long(y, m)
        if not size < np.inf:
            break
        for i in range(n):
            y[i] /= factor
        move(y, m, p, feet, weights, mult)
        common -= y[n - 1]
        far = max(abs(p[0] - s0), abs(p[1] - s1), abs(p[2] - s2))
        if far > reach or (step > PATIENCE and size > 0.01):
            break
        look(space, less, p, feet, m, work)
        if size < STILL or step == STEPS - 1:
            if pivot <= SINGULAR and not solved(
                a, y, m, work, weights, mult, common, length, fixed
            ):
                break
            return size, lowest_of_feet(m, work, mult, length * length), pivot
    return np.inf, -np.inf, first


@in_ranges(CHUNK)
@outer(nogil=True, fastmath=FAST, error_model="numpy")
def balance(begin, end, space, less, p, feet, weights, count, fixed, reach, last, low, pivot):
    """Newton's method from many starts, in place.

    Parameters
    ----------
    begin, end
        Which of them.
    space
        The lattice, generic.
    less
        The same with the half-thickness, a spline over the same domain, in place of the map.
    p
        Points (n, 3) in tile coordinates.
    feet, weights, count
        Their feet (n, 4, 3) in tile coordinates, weights (n, 4), and numbers of feet (n,).
    fixed
        Which directions of a point are fixed (3,).
    reach
        How far points may go, in tiles.
    last
        Output (n,): the last step, in tiles; infinite where the method is lost.
    low
        Output (n,): the least eigenvalue of `lowest` at the feet; saddles have negative ones.
    pivot
        Output (n,): the smallest pivot of the last step, or of the first one where the method is
        lost; at most `SINGULAR` where critical points are not isolated.
    """
    p, feet, weights = borrowed((p, feet, weights))
    b, x, _, tab, _ = scratch(space)
    taken, h, _, _, _ = scratch(less)
    f, t, unit = np.zeros((MAX_FEET, len(x), 10)), np.zeros((MAX_FEET, 10)), np.zeros(MAX_FEET)
    work = (b, x, tab, h, taken, f, t, unit)
    n = 4 + 5 * MAX_FEET
    a, square, y, right = np.zeros((n, n)), np.zeros((n, n)), np.zeros(n), np.zeros(n)
    mult = np.zeros(MAX_FEET)
    q, more, old_weights = np.zeros(3), np.zeros((MAX_FEET, 3)), np.zeros(MAX_FEET)
    for s in range(begin, end):
        q[:], more[:], old_weights[:] = p[s], feet[s], weights[s]
        for damping in (False, True):
            last[s], low[s], pivot[s] = solve(
                space, less, p[s], feet[s], weights[s], count[s], fixed, reach, damping, work,
                a, y, square, right, mult,
            )  # fmt: skip
            if damping or last[s] < np.inf or pivot[s] > SMALL:
                break
            p[s], feet[s], weights[s] = q, more, old_weights
