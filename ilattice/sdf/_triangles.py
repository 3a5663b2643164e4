"""Geometry and adjacency of triangles, prepared for the tree.

Guarantee: areas and normals are computed in twice the working precision, so that triangles as thin
as the coordinates allow have normals right to the last digits; flat ones have the normal zero.
"""

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray

_SPLITTER = 134217729.0  # 2**27 + 1


def normals_and_areas(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit normals (F, 3), zero for flat triangles, and areas (F,) of triangles (F, 3, 3)."""
    a = corners[:, 0]
    u, du = _difference(corners[:, 1], a)
    v, dv = _difference(corners[:, 2], a)
    w = np.empty_like(u)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        p, dp = _product(u[:, j], v[:, k])
        q, dq = _product(u[:, k], v[:, j])
        r, dr = _difference(p, q)
        tails = u[:, j] * dv[:, k] + du[:, j] * v[:, k] - u[:, k] * dv[:, j] - du[:, k] * v[:, j]
        w[:, i] = r + (dr + (dp - dq) + tails)
    size = np.abs(w).max(axis=1, initial=0.0)
    unit = w / np.where(size > 0.0, size, 1.0)[:, None]
    length = np.linalg.norm(unit, axis=1)
    return unit / np.where(length > 0.0, length, 1.0)[:, None], 0.5 * size * length


def _difference(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """``a - b`` and its rounding error (Knuth)."""
    s = a - b
    t = s - a
    return s, (a - (s - t)) - (b + t)


def _product(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """``a * b`` and its rounding error (Dekker)."""
    p = a * b
    ah, al = _halves(a)
    bh, bl = _halves(b)
    return p, ((ah * bh - p) + ah * bl + al * bh) + al * bl


def _halves(a: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Upper and lower half of the digits (Veltkamp)."""
    t = _SPLITTER * a
    high = t - (t - a)
    return high, a - high


def twins(faces: AnyArray, vertices: int) -> IntArray:
    """For every side of a closed oriented mesh the triangle beyond it, shape (F, 3).

    Side j of a triangle goes from its corner j to the next.
    """
    start = faces.astype(np.int64)
    end = np.roll(start, -1, axis=1)
    keys = (start * vertices + end).ravel()
    order = np.argsort(keys, kind="stable")
    beyond = np.searchsorted(keys, (end * vertices + start).ravel(), sorter=order)
    return (order[beyond] // 3).reshape(-1, 3)
