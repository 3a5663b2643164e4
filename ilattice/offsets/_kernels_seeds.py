"""Compiled placing of the seeds from which closest points are searched: see `_kernels_patches`.

Guarantee: the same result for any number of threads.
"""

import numpy as np

from ilattice._kernels import in_ranges, inner, outer
from ilattice._kernels_tuples import borrowed
from ilattice.offsets._kernels import CHUNK
from ilattice.offsets._kernels_jets import (
    BESIDE,
    FAST,
    at_end,
    cofactor_normal,
    map_jet,
    metric,
    scratch,
    tile_jet,
    upright_part,
)
from ilattice.offsets._kernels_newton import MAX_ITERATIONS, curvature
from ilattice.offsets._kernels_patches import (
    AROUND,
    BENT,
    BULGE,
    BULGED,
    CLEAR,
    PLAIN,
    outside,
    seed_distance,
)

#: Cells that bend by more than they are wide may bend so many times farther than it seems.
BEND_MARGIN = 2.0


@in_ranges(CHUNK)
@outer(nogil=True, error_model="numpy")
def project(first, last, space, p, fixed, limit, travel):
    """Move points p (n, 3), in place, onto I = 0 along grad I; the distance moved, or inf."""
    space = borrowed(space)
    b, _, t, tab, _ = scratch(space)
    for i in range(first, last):
        x0, x1, x2 = p[i, 0], p[i, 1], p[i, 2]
        travel[i] = np.inf
        for _ in range(MAX_ITERATIONS):
            tile_jet(space, (x0, x1, x2), b, t, tab)
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
                travel[i] = np.sqrt((x0 - p[i, 0]) ** 2 + (x1 - p[i, 1]) ** 2 + (x2 - p[i, 2]) ** 2)
                p[i, 0], p[i, 1], p[i, 2] = x0, x1, x2
                break


@inner(fastmath=FAST, error_model="numpy")
def squeezed(m, det, cell, out):
    """Fill in by rows the matrix that takes space to cells, and how far these bend away from that.

    Where they bend by more than a cell is wide it tells less, and False; by more than it is long,
    nothing: all zero.
    """
    bend = sagitta(m, cell)
    most, least = 0.0, np.inf
    if det == 0.0:
        out[:] = 0.0
        return False
    for k in range(3):
        a, b = 1 + (k + 1) % 3, 1 + (k + 2) % 3
        s = 1.0 / (det * cell[k])
        length = 0.0
        for c in range(3):
            d, e = (c + 1) % 3, (c + 2) % 3
            row = s * (m[d, a] * m[e, b] - m[e, a] * m[d, b])
            out[3 * k + c] = row
            length += row * row
        most, least = max(most, np.sqrt(length)), min(least, np.sqrt(length))
    out[9] = bend
    if bend * most <= 1.0:
        return True
    out[9] = BEND_MARGIN * bend
    if not BEND_MARGIN * bend * least <= 1.0:
        out[:] = 0.0
    return False


@inner(fastmath=FAST, error_model="numpy")
def across(m, v, cell):
    """Size of the image of a cell along the unit normal v, from jets of the map."""
    out = 0.0
    for a in range(3):
        side = v[0] * m[0, a + 1] + v[1] * m[1, a + 1] + v[2] * m[2, a + 1]
        out += (side * cell[a]) ** 2
    return np.sqrt(out)


@inner(fastmath=FAST, error_model="numpy")
def sagitta(m, cell):
    """How far the image of the cells that a seed stands for bends away from a parallelepiped."""
    out = 0.0
    for a in range(3):
        s = abs(m[a, 4]) * cell[0] ** 2 + abs(m[a, 5]) * cell[1] ** 2 + abs(m[a, 6]) * cell[2] ** 2
        s += 2.0 * abs(m[a, 7]) * cell[1] * cell[2]
        s += 2.0 * abs(m[a, 8]) * cell[0] * cell[2]
        s += 2.0 * abs(m[a, 9]) * cell[0] * cell[1]
        out += s * s
    return 0.5 * AROUND * AROUND * np.sqrt(out)


@in_ranges(CHUNK)
@outer(nogil=True, fastmath=FAST, error_model="numpy")
def place_seeds(first, last, space, p, cell, orient, x, normal, spacing, rest):
    """Image (n, 3), normal (n, 5), size of the image of a cell, at points p (n, 3) in tiles.

    The rest (n,) is what is left of det J on the way there from the domain: 1 within it, and not
    positive where that is less than half of `UPRIGHT`.

    Normals are those along which I grows, whatever the orientation of the map, followed by the
    largest curvature times that size, and how far away queries must be, see `upright`.
    """
    space = borrowed(space)
    geom = space.geom
    b, m, t, tab, _ = scratch(space)
    for i in range(first, last):
        pi = (p[i, 0], p[i, 1], p[i, 2])
        end = (at_end(geom, 0, pi[0]), at_end(geom, 1, pi[1]), at_end(geom, 2, pi[2]))
        beyond = outside(geom, pi)
        map_jet(space, end, 1, b, m)
        x[i, 0], x[i, 1], x[i, 2] = m[0, 0], m[1, 0], m[2, 0]
        rest[i] = 1.0
        if beyond:
            whole = orient * cofactor_normal(m, (0.0, 0.0, 0.0))[1]
            rest[i] = 0.0
            if whole > 0.0:
                rest[i] = upright_part(space, orient, end, pi, whole, b, m)
        map_jet(space, pi, 2, b, m)
        tile_jet(space, pi, b, t, tab)
        v, det = cofactor_normal(m, (t[1], t[2], t[3]))
        s = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) + 1e-300
        s = s if det > 0.0 else -s
        v = (v[0] / s, v[1] / s, v[2] / s)
        big = 0.0
        way = seed_distance(x, i, (m[0, 0], m[1, 0], m[2, 0]))
        normal[i, CLEAR] = BESIDE * way if beyond else 0.0
        for a in range(3):
            x[i, a] = m[a, 0]
            normal[i, a] = v[a]
            size = m[0, a + 1] ** 2 + m[1, a + 1] ** 2 + m[2, a + 1] ** 2
            big = max(big, size * cell[i, a] ** 2)
        spacing[i] = np.sqrt(big)
        bent = curvature(m, t, v, abs(det / s), metric(m))
        normal[i, BENT] = spacing[i] * bent
        if normal.shape[1] > PLAIN:
            of = cell[i]
            cells = (of[0] ** -2, of[1] ** -2, of[2] ** -2, 0.0, 0.0, 0.0)
            sag = curvature(m, t, v, abs(det / s), cells)
            normal[i, BULGED] = np.inf
            if squeezed(m, det, of, normal[i, PLAIN:]):
                normal[i, BENT] = min(normal[i, BENT], np.sqrt(bent * sag))
                normal[i, BULGED] = max(AROUND * AROUND * sag, BULGE * across(m, v, of))
