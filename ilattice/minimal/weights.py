"""Quantities over a patch that are known at a few of its points: bounded biharmonic interpolation.

Places on a patch of N sides are those of the regular polygon in the unit circle whose corner k, at
the angle 2 pi k / N, is the corner k of the patch; its centre is the middle of the fan.

Guarantees: the values are met at the given places, and are nowhere beyond the least and the largest
of them. Source: Jacobson et al., Bounded biharmonic weights, 2011; the bounds are put on the
quantity itself, not on a weight per place.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from ilattice._typing import ArrayLike, FloatArray, IntArray
from ilattice._validate import as_array, as_points, read_only
from ilattice.errors import ConvergenceError, InputError
from ilattice.minimal.disc import Disc, cotangents, vertex_areas

#: Rounds of flips towards Delaunay's condition at most.
_MAX_ROUNDS = 60


def located(disc: Disc, places: ArrayLike) -> tuple[IntArray, FloatArray]:
    """Triangles of a disc that hold places of its polygon.

    Parameters
    ----------
    disc : Disc
        The disc.
    places : array_like, shape (k, 2)
        Points of the regular polygon.

    Returns
    -------
    rows : (k, 3) array
        Corners of the triangles.
    weights : (k, 3) array
        Barycentric coordinates.

    Raises
    ------
    InputError
        If a place is outside the polygon.
    """
    uv = as_points("places", places, 2)
    corners = disc.flat[disc.faces][:, :, :2]
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    whole = _cross(b - a, c - a)
    rows = np.empty((len(uv), 3), np.int64)
    weights = np.empty((len(uv), 3))
    for i, p in enumerate(uv):
        w = np.stack([_cross(c - b, p - b), _cross(a - c, p - c), _cross(b - a, p - a)], axis=1)
        w /= whole[:, None]
        best = int(w.min(axis=1).argmax())
        if w[best].min() < -1e-6:
            raise InputError(
                f"places must lie in the regular polygon of {disc.sides} sides in the unit circle, "
                f"got {p.tolist()}"
            )
        rows[i], weights[i] = disc.faces[best], np.clip(w[best], 0.0, 1.0)
    return rows, weights / weights.sum(axis=1, keepdims=True)


def spread(v: FloatArray, disc: Disc, places: ArrayLike, values: Sequence[float]) -> FloatArray:
    """Values at all vertices of a patch from those at some places.

    Parameters
    ----------
    v : (V, 3) array
        Vertices of the patch.
    disc : Disc
        Its triangles.
    places : array_like, shape (k, 2)
        Where values are known, see the top of the module.
    values : sequence of float
        The values.

    Returns
    -------
    (V,) array
        Smooth, and within the bounds of the given values.

    Raises
    ------
    InputError
        If numbers of places and values differ, or a place is outside or there twice.
    ConvergenceError
        If places are so close that one triangle holds too many.
    """
    known = as_array("values", values, ndim=1)
    rows, weights = located(disc, places)
    if known.shape != (len(rows),) or not len(rows):
        raise InputError(f"values must be one per place ({len(rows)}), got {known.shape}")
    low, high = float(known.min()), float(known.max())
    if low == high:
        return read_only(np.full(len(v), low))
    at = (np.repeat(np.arange(len(rows)), 3), rows.ravel())
    held = sparse.coo_array((weights.ravel(), at), shape=(len(rows), len(v))).tocsr()
    K = cotangents(v, disc.faces)
    bending = K @ sparse.diags_array(1.0 / np.maximum(vertex_areas(v, disc.faces), 1e-300)) @ K
    return read_only(_bounded(bending / abs(bending).max(), held, known, low, high))


def _bounded(B: Any, held: Any, known: FloatArray, low: float, high: float) -> FloatArray:
    """The least of x·B x with held x = known and low <= x <= high, by active sets."""
    count, slack = B.shape[0], 1e-9 * (high - low)
    side = np.zeros(count, np.int64)
    for _ in range(_MAX_ROUNDS):
        x, force = _solved(B, held, known, np.where(side < 0, low, high), side != 0)
        new = np.where(x < low - slack, -1, np.where(x > high + slack, 1, side))
        # at a bound the force must push beyond it
        wrong = (side != 0) & (force * side > 1e-12)
        new[wrong] = 0
        if (new == side).all():
            return np.clip(x, low, high)
        side = new
    raise ConvergenceError(
        "bounds of the values at places were not kept: give places farther apart, or fewer"
    )


def _solved(
    B: Any, held: Any, known: FloatArray, bound: FloatArray, fixed: Any
) -> tuple[FloatArray, FloatArray]:
    """Least x·B x where some are fixed, and the forces there."""
    x = np.where(fixed, bound, 0.0)
    free = np.flatnonzero(~fixed)
    part = held[:, free]
    rows = np.flatnonzero(abs(part).sum(axis=1) > 1e-9)
    part = part[rows]
    system = sparse.block_array([[B[free][:, free], part.T], [part, None]]).tocsc()
    right = np.concatenate([-(B @ x)[free], (known - held @ x)[rows]])
    try:
        found = splu(system).solve(right)
    except RuntimeError as e:
        raise ConvergenceError(
            "values at places leave no smooth interpolation within their bounds, as several places "
            "are in one triangle: give places farther apart, or more edges per side"
        ) from e
    x[free] = found[: len(free)]
    force = B @ x
    force += held[rows].T @ found[len(free) :]
    return x, force


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products of vectors in the plane."""
    out: FloatArray = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out
