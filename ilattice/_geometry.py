"""Roots along segments and gradients, points of grids and in boxes, coordinates that faces fix."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ilattice._typing import AnyArray, ArrayLike, FloatArray, IntArray


def between(
    f: Callable[[FloatArray], FloatArray],
    a: FloatArray,
    b: FloatArray,
    ends: FloatArray,
    steps: int,
    small: AnyArray | float | None = None,
) -> FloatArray:
    """Where along segments from `a` to `b` a function vanishes: bracketed secants (Illinois).

    Parameters
    ----------
    f : callable
        Takes points (m, 3), one per segment that is left; returns values (m,).
    a, b : ndarray, shape (n, 3)
        Ends of the segments.
    ends : ndarray, shape (n, 2)
        Values at the ends, of unlike signs.
    steps : int
        How often `f` is called, at most.
    small : float or ndarray, shape (n,), optional
        Values that count as zero: segments with such a one are not looked at again. By default `f`
        is called with all of them every time.

    Returns
    -------
    ndarray, shape (n,)
        Parts of the way from `a` to `b`.
    """
    at = np.arange(len(a))
    lo, hi = np.zeros(len(a)), np.ones(len(a))
    p, q = ends[:, 0].copy(), ends[:, 1].copy()
    gap = p - q
    t = np.where(gap == 0.0, 0.5, p / np.where(gap == 0.0, 1.0, gap))
    out, before = t.copy(), np.zeros(len(a), np.int8)
    for _ in range(steps):
        value = f(a[at] + t[:, None] * (b[at] - a[at]))
        if small is not None:
            left = np.abs(value) > np.broadcast_to(small, len(a))[at]
            at, value, t = at[left], value[left], t[left]
            lo, hi, p, q, before = lo[left], hi[left], p[left], q[left], before[left]
            if not len(at):
                break
        low = (value >= 0.0) == (p >= 0.0)
        lo, hi = np.where(low, t, lo), np.where(low, hi, t)
        again = np.where(low == (before > 0), 0.5, 1.0)  # the other end is stuck
        p, q = np.where(low, value, again * p), np.where(low, again * q, value)
        before = np.where(low, 1, -1).astype(np.int8)
        gap = p - q
        t = np.where(gap == 0.0, t, lo + (hi - lo) * p / np.where(gap == 0.0, 1.0, gap))
        out[at] = t
    return out


def grid_array(*axes: Any) -> Any:
    """Points of a tensor grid.

    Parameters
    ----------
    *axes : array_like
        Coordinates along the directions, n of them.

    Returns
    -------
    ndarray, shape (len(axes[0]), ..., n)
        Of the type that the axes have in common.
    """
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


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
    return grid_array(*axes).reshape(-1, len(axes))


def grid_indices(counts: Any) -> IntArray:
    """Indices of the cells of a tensor grid as rows.

    Parameters
    ----------
    counts : sequence of int
        How many there are along the directions, n of them.

    Returns
    -------
    ndarray, shape (cells, n)
        The last index changes first.
    """
    return np.indices(tuple(counts)).reshape(len(counts), -1).T


#: Corners of the unit cube, the last coordinate changes first.
CORNERS = grid_indices((2, 2, 2))
#: Steps of points that fill the unit cube evenly: the first two powers of the reciprocal of the
#: plastic number, and a third number that was chosen without measurements.
SPREAD = (0.7548776662, 0.5698402910, 0.3028)


def spread_points(count: int) -> FloatArray:
    """Points of the unit cube of low discrepancy, the same every time.

    Parameters
    ----------
    count : int
        How many.

    Returns
    -------
    ndarray, shape (count, 3)
        Multiples of `SPREAD` less their whole parts.
    """
    return np.mod(np.arange(1.0, count + 1.0)[:, None] * SPREAD, 1.0)


def least_step(f: FloatArray, gradient: FloatArray) -> FloatArray:
    """The shortest step to where a function is zero, were it linear: it is to be taken off.

    Parameters
    ----------
    f : ndarray, shape (n,)
        Values.
    gradient : ndarray, shape (n, 3)
        Where they are; without one there is no step.

    Returns
    -------
    ndarray, shape (n, 3)
        Along the gradients.
    """
    square = np.maximum(np.einsum("ni,ni->n", gradient, gradient), 1e-300)
    return np.asarray((f / square)[:, None] * gradient)


def wrapped(u: FloatArray, lo: FloatArray, hi: FloatArray, closed: ArrayLike) -> FloatArray:
    """Points moved into a box along its closed directions, by whole periods.

    Parameters
    ----------
    u : ndarray, shape (..., 3)
        Points.
    lo, hi : ndarray, shape (3,)
        Corners of the box.
    closed : array_like of bool, shape (3,)
        Directions in which its ends are one.

    Returns
    -------
    ndarray, shape (..., 3)
        As they were in the other directions.
    """
    return np.where(np.asarray(closed), lo + np.mod(u - lo, hi - lo), u)


def within(u: FloatArray, lo: FloatArray, hi: FloatArray, closed: ArrayLike) -> FloatArray:
    """Points `wrapped` into a box, and cut off at its faces in the other directions.

    Parameters
    ----------
    u, lo, hi, closed : ndarray
        As in `wrapped`.

    Returns
    -------
    ndarray, shape (..., 3)
        In the box.
    """
    return np.where(np.asarray(closed), wrapped(u, lo, hi, closed), np.clip(u, lo, hi))


def cells_at(axes: Sequence[FloatArray], u: FloatArray) -> IntArray:
    """Indices of the cells of a tensor grid that points are in, the nearest cells beyond its ends.

    Parameters
    ----------
    axes : sequence of ndarray
        Planes of the grid, increasing, of each direction.
    u : ndarray, shape (n, len(axes))
        The points; those on a plane are in the cell above it.

    Returns
    -------
    ndarray, shape (n, len(axes))
        The indices.
    """
    at = [np.searchsorted(x, u[:, k], side="right") - 1 for k, x in enumerate(axes)]
    return np.stack([np.clip(i, 0, len(x) - 2) for i, x in zip(at, axes, strict=True)], axis=1)


def cell_sizes(axes: Sequence[FloatArray], u: FloatArray) -> FloatArray:
    """Sizes (n, len(axes)) of the cells that points are in; arguments as of `cells_at`."""
    at = cells_at(axes, u)
    return np.stack([np.diff(x)[at[:, k]] for k, x in enumerate(axes)], axis=1)


def determinants(a: AnyArray) -> FloatArray:
    """Determinants of many 3 x 3 matrices; LAPACK takes ten times as long.

    Parameters
    ----------
    a : ndarray, shape (..., 3, 3)
        The matrices.

    Returns
    -------
    ndarray, shape (...,)
        Their determinants.
    """
    x, y, z = np.moveaxis(a, (-2, -1), (0, 1))
    out: FloatArray = x[0] * (y[1] * z[2] - y[2] * z[1]) + x[1] * (y[2] * z[0] - y[0] * z[2])
    return out + x[2] * (y[0] * z[1] - y[1] * z[0])


def inverses(a: AnyArray) -> FloatArray:
    """Inverses of many regular 3 x 3 matrices; LAPACK takes several times as long.

    Parameters
    ----------
    a : ndarray, shape (n, 3, 3)
        The matrices.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        Their inverses, of the accuracy of Cramer's rule.
    """
    out = np.empty(a.shape)
    for i in range(3):
        one, other = a[:, (i + 1) % 3], a[:, (i + 2) % 3]
        out[:, 0, i] = one[:, 1] * other[:, 2] - one[:, 2] * other[:, 1]
        out[:, 1, i] = one[:, 2] * other[:, 0] - one[:, 0] * other[:, 2]
        out[:, 2, i] = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    out /= np.einsum("na,na->n", a[:, 0], out[:, :, 0])[:, None, None]
    return out


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
