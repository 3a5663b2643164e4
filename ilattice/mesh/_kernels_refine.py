"""Compiled helpers of vertex refinement, and of choosing diagonals again after vertices moved.

Guarantees: each vertex or quad is handled on its own, so results do not depend on the number of
threads. Non-guarantees: arguments are not checked.
"""

import numpy as np
from numba import njit

from ilattice._kernels import in_ranges, inner, outer

GRAIN = 4096  # vertices or quads that a thread takes at once
LOWER = 128  # bit of `kind`: on the lower of two levels
REACH = 0.25  # longest part of a step along an axis, as a fraction of the cell


@in_ranges(GRAIN)
@outer(nogil=True, error_model="numpy")
def pull_to_centre(first, last, vertices, at, cell, least, most, part, out):
    """Places of the vertices `at`, moved to the centres of their cells by a part of the way."""
    for n in range(first, last):
        v = at[n]
        for a in range(3):
            c = cell[v, a]
            p = np.float64(vertices[v, a])
            out[n, a] = p + part * (0.5 * (least[a, c] + most[a, c]) - p)


@njit(cache=True, inline="always")
def _step(points, n, r, gradient, cell, v, least, most):
    """One Newton step of point n, where the field is r off its level, in place; if it was cut.

    The step goes along the gradient as it is where cells have the size 1, and ends within the
    cell, between `least` and `most`: coordinates on faces of the domain have no room there.
    Coordinates are not traded for one another, for that may send the vertex far along the surface.
    """
    s = 0.0
    for a in range(3):
        s += ((most[a, cell[v, a]] - least[a, cell[v, a]]) * gradient[n, a]) ** 2
    step = r / s if s > 0.0 else 0.0
    cut = False
    for a in range(3):
        low = least[a, cell[v, a]]
        high = most[a, cell[v, a]]
        width = high - low
        if width > 0.0:
            p = points[n, a]
            wanted = p - step * width * width * gradient[n, a]
            q = min(max(wanted, p - REACH * width), p + REACH * width)
            q = min(max(q, low), high)
            cut = cut or q != wanted
            points[n, a] = q
    return cut


@in_ranges(GRAIN)
@outer(nogil=True, error_model="numpy")
def first_step(
    first, last, vertices, at, kind, cell, least, most, lower, upper, value, gradient, points, miss,
    stopped,
):  # fmt: skip
    """Step `points`, the moved vertices `at`, in place; back to the vertices where that is cut.

    `value` and `gradient` are those of the field there; `miss` receives how far it was off.
    """
    for n in range(first, last):
        v = at[n]
        r = value[n] - (lower if kind[v] & LOWER else upper)
        miss[n] = abs(r)
        stopped[n] = _step(points, n, r, gradient, cell, v, least, most)
        if stopped[n]:
            for a in range(3):
                points[n, a] = vertices[v, a]


@in_ranges(GRAIN)
@outer(nogil=True, error_model="numpy")
def second_step(
    first, last, vertices, at, kind, cell, least, most, lower, upper, value, gradient, points, miss,
    stopped,
):  # fmt: skip
    """Step from `points` and move the vertices `at` there, unless that is cut or diverges."""
    for n in range(first, last):
        v = at[n]
        r = value[n] - (lower if kind[v] & LOWER else upper)
        cut = _step(points, n, r, gradient, cell, v, least, most)
        if not cut and (stopped[n] or abs(r) <= miss[n]):
            for a in range(3):
                vertices[v, a] = points[n, a]


@inner()
def _normal(p, a, b, c, n):
    """Twice the vector area of a triangle into n; (2 area / sum of squared sides) squared."""
    ux, uy, uz = p[b, 0] - p[a, 0], p[b, 1] - p[a, 1], p[b, 2] - p[a, 2]
    vx, vy, vz = p[c, 0] - p[a, 0], p[c, 1] - p[a, 1], p[c, 2] - p[a, 2]
    wx, wy, wz = p[c, 0] - p[b, 0], p[c, 1] - p[b, 1], p[c, 2] - p[b, 2]
    n[0] = uy * vz - uz * vy
    n[1] = uz * vx - ux * vz
    n[2] = ux * vy - uy * vx
    s = ux * ux + uy * uy + uz * uz + vx * vx + vy * vy + vz * vz + wx * wx + wy * wy + wz * wz
    return (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]) / (s * s) if s > 0.0 else 0.0


@in_ranges(GRAIN)
@outer(nogil=True, error_model="numpy")
def resplit(first, last, points, faces):
    """Take the other diagonal of a quad where it gives the better worst triangle.

    A diagonal with the normals of its triangles less than a right angle apart comes first.
    """
    m, n = np.empty(3), np.empty(3)
    p = np.empty((4, 3))
    for q in range(first, last):
        a, b, c, d = faces[2 * q, 0], faces[2 * q, 1], faces[2 * q, 2], faces[2 * q + 1, 2]
        for i in range(3):
            p[0, i] = points[a, i]
            p[1, i] = points[b, i]
            p[2, i] = points[c, i]
            p[3, i] = points[d, i]
        now = min(_normal(p, 0, 1, 2, m), _normal(p, 0, 2, 3, n))
        now_flat = m[0] * n[0] + m[1] * n[1] + m[2] * n[2] > 0.0
        then = min(_normal(p, 1, 2, 3, m), _normal(p, 1, 3, 0, n))
        then_flat = m[0] * n[0] + m[1] * n[1] + m[2] * n[2] > 0.0
        if then_flat and (not now_flat or then > now):
            faces[2 * q, 0], faces[2 * q, 1], faces[2 * q, 2] = b, c, d
            faces[2 * q + 1, 0], faces[2 * q + 1, 1], faces[2 * q + 1, 2] = b, d, a
