"""Compiled helpers of vertex refinement, and of choosing diagonals again after vertices moved.

Guarantees: each vertex or quad is handled on its own, so results do not depend on the number of
threads. Non-guarantees: arguments are not checked.
"""

import numpy as np
from numba import njit, prange


@njit(cache=True)
def _cell_of(planes, x):
    """Index of the cell of ``planes`` that holds x."""
    low, high = 0, len(planes) - 1
    while high - low > 1:
        mid = (low + high) // 2
        if x >= planes[mid]:
            low = mid
        else:
            high = mid
    return low


@njit(cache=True, parallel=True)
def free_boxes(points, kind, x, y, z, margin, low, high):
    """Box of each vertex: its cell without the margin, no width where it is constrained."""
    for n in prange(len(points)):
        for a in range(3):
            p = points[n, a]
            planes = x if a == 0 else (y if a == 1 else z)
            if (kind[n] >> (2 * a)) & 3:
                low[n, a] = p
                high[n, a] = p
            else:
                c = _cell_of(planes, p)
                rim = margin * (planes[c + 1] - planes[c])
                low[n, a] = min(p, planes[c] + rim)
                high[n, a] = max(p, planes[c + 1] - rim)


@njit(cache=True, parallel=True)
def newton_step(points, value, gradient, lower, upper, low, high, out, residual):
    """One step onto the nearest bound along the gradient, in the free coordinates, clamped."""
    for n in prange(len(points)):
        r = value[n] - upper
        if value[n] - lower < upper - value[n]:
            r = value[n] - lower
        residual[n] = abs(r)
        s = 0.0
        for a in range(3):
            if high[n, a] > low[n, a]:
                s += gradient[n, a] * gradient[n, a]
        step = r / s if s > 0.0 else 0.0
        for a in range(3):
            p = points[n, a]
            if high[n, a] > low[n, a]:
                p = min(max(p - step * gradient[n, a], low[n, a]), high[n, a])
            out[n, a] = p


@njit(cache=True)
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


@njit(cache=True, parallel=True)
def resplit(points, faces):
    """Take the other diagonal of a quad where it gives the better worst triangle.

    A diagonal with the normals of its triangles less than a right angle apart comes first.
    """
    for q in prange(len(faces) // 2):
        m, n = np.empty(3), np.empty(3)
        p = np.empty((4, 3))
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
