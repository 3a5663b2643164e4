"""Roots along segments, points of grids and in boxes, and coordinates that faces of a box fix."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ilattice._typing import AnyArray, FloatArray, IntArray


def between(
    f: Callable[[FloatArray], FloatArray],
    a: FloatArray,
    b: FloatArray,
    ends: FloatArray,
    steps: int,
) -> FloatArray:
    """Where along segments from `a` to `b` a function vanishes: bracketed secants.

    Parameters
    ----------
    f : callable
        Takes points (n, 3), one per segment; returns values (n,).
    a, b : ndarray, shape (n, 3)
        Ends of the segments.
    ends : ndarray, shape (n, 2)
        Values at the ends, of unlike signs.
    steps : int
        How often `f` is called.

    Returns
    -------
    ndarray, shape (n,)
        Parts of the way from `a` to `b`.
    """
    lo, hi = np.zeros(len(a)), np.ones(len(a))
    p, q = ends[:, 0].copy(), ends[:, 1].copy()
    t = p / (p - q)
    before = np.zeros(len(a), np.int64)
    for _ in range(steps):
        value = f(a + t[:, None] * (b - a))
        low = (value >= 0.0) == (p >= 0.0)
        lo, hi = np.where(low, t, lo), np.where(low, hi, t)
        again = np.where(low == (before > 0), 0.5, 1.0)  # the other end is stuck
        p, q = np.where(low, value, again * p), np.where(low, again * q, value)
        before = np.where(low, 1, -1).astype(np.int8)
        gap = p - q
        t = np.where(gap == 0.0, t, lo + (hi - lo) * p / np.where(gap == 0.0, 1.0, gap))
    return t


def grid_points(*axes: Any) -> Any:
    """Points of a tensor grid as rows.

    Parameters
    ----------
    *axes : array_like
        Coordinates along the directions, n of them.

    Returns
    -------
    ndarray, shape (points, n)
        The last coordinate changes first; of the type that the axes have in common.
    """
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


def fixed_coordinates(kind: IntArray) -> AnyArray:
    """Which coordinates faces of D fix.

    Parameters
    ----------
    kind : ndarray of int, shape (n,)
        Constraints, as `Contour.kind`.

    Returns
    -------
    ndarray of bool, shape (n, 3)
        True for coordinates normal to a face that the vertex is on.
    """
    out: AnyArray = np.stack([(kind >> (2 * a)) & 3 for a in range(3)], axis=1) != 0
    return out


def pairs(lo: FloatArray, hi: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Two random points in each of n boxes.

    Parameters
    ----------
    lo, hi : ndarray, shape (n, 3)
        Corners of the boxes.
    rng : Generator
        Where they come from.

    Returns
    -------
    ndarray, shape (2 n, 3)
        Those of the same box one after the other.
    """
    out: FloatArray = np.repeat(lo, 2, axis=0)
    return out + np.repeat(hi - lo, 2, axis=0) * rng.random((2 * len(lo), 3))
