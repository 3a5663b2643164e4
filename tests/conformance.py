"""One suite for every class of fields: what a field promises by the methods it has.

`check_field` looks at values, derivatives, bounds, Lipschitz constants and grids, as far as the
field has them, and at the treatment of bad input. Call it from a test of every field class::

    check_field(field, rng)  # smooth fields on their bounds
    check_field(field, rng, box=((0, 0, 0), (1, 1, 1)), rtol=1e-5)
"""

from itertools import product

import numba
import numpy as np
import pytest

from ilattice._field import owns
from ilattice.errors import InputError


def check_field(field, rng, *, box=None, points=200, rtol=1e-6, converges=True, exact=True):
    """Check a field of three variables against itself.

    Parameters
    ----------
    field : Field
        The field; what it has of ``jet``, ``range``, ``lipschitz``, ``grid`` is checked too.
    rng : numpy.random.Generator
        Source of points.
    box : array_like, shape (2, 3), optional
        Where to try it; default its bounds.
    points : int
        Number of points.
    rtol : float
        Tolerance of derivatives against differences, relative to the largest of them. Points
        near the ``breaks`` of a spline are left out.
    converges : bool
        Whether the bounds of most small boxes are sharp up to a factor of two.
    exact : bool
        Whether a point gives the same bits alone and among others.
    """
    box = np.asarray(field.bounds if box is None else box, dtype=float)
    assert box.shape == (2, 3)
    assert (box[0] < box[1]).all()
    p = _inner_points(field, rng, box, points)
    check_values(field, p, exact)
    check_bad_points(field)
    check_threads(field, rng, box)
    if owns(field, "jet"):
        check_derivatives(field, p, box, rtol)
    if owns(field, "range"):
        check_range(field, rng, box, converges)
    if owns(field, "lipschitz"):
        check_lipschitz(field, p)
    if owns(field, "grid"):
        check_grid(field, rng, box)


def _step(box):
    return 1e-5 * (box[1] - box[0])


def _inner_points(field, rng, box, count):
    """Random points off the faces and off the breaks, by some steps of the differences."""
    h = 3 * _step(box)
    p = rng.uniform(box[0] + h, box[1] - h, (count, 3))
    if owns(field, "breaks"):
        for axis in range(3):
            gap = np.abs(p[:, axis, None] - np.asarray(field.breaks(axis))).min(axis=1)
            p = p[gap > h[axis]]
    assert len(p) > count / 2, "most points lie on breaks"
    return p


def check_values(field, p, exact):
    """Shape, type, purity, and independence of what else is asked for."""
    before = p.copy()
    f = field(p)
    assert isinstance(f, np.ndarray)
    assert f.shape == (len(p),)
    assert f.dtype == np.float64
    assert np.isfinite(f).all()
    assert np.ptp(f) > 0, "a constant field tests nothing"
    assert np.array_equal(p, before), "the points were written to"
    assert field(p) is not f
    tol = 0.0 if exact else 1e-13 * np.abs(f).max()
    alone = np.concatenate([field(row[None]) for row in p[:5]])
    np.testing.assert_allclose(alone, f[:5], rtol=0, atol=tol)
    np.testing.assert_allclose(field(p[::-2]), f[::-2], rtol=0, atol=tol)
    np.testing.assert_allclose(field(np.asfortranarray(p)), f, rtol=0, atol=tol)
    np.testing.assert_allclose(field(p[:3].tolist()), f[:3], rtol=0, atol=tol)
    locked = p.copy()
    locked.flags.writeable = False
    np.testing.assert_allclose(field(locked), f, rtol=0, atol=tol)
    assert field(np.empty((0, 3))).shape == (0,)


def check_bad_points(field):
    """Wrong shapes and values that are not finite are refused at the door."""
    for bad in (np.zeros(3), np.zeros((2, 2)), np.full((1, 3), np.nan), np.full((1, 3), np.inf)):
        with pytest.raises(InputError):
            field(bad)
        if owns(field, "jet"):
            with pytest.raises(InputError):
                field.jet(bad)


def check_threads(field, rng, box):
    """The same bits for one thread and for all."""
    p = rng.uniform(box[0], box[1], (5000, 3))
    ask = field.jet if owns(field, "jet") else lambda q: (field(q),)
    before, found = numba.get_num_threads(), []
    try:
        for threads in (1, numba.config.NUMBA_NUM_THREADS):
            numba.set_num_threads(threads)
            found.append(ask(p))
    finally:
        numba.set_num_threads(before)
    one, many = found
    assert all(np.array_equal(a, b) for a, b in zip(one, many, strict=True))


def check_derivatives(field, p, box, rtol):
    """Orders agree; gradient and Hessian against central differences of the order below."""
    f, g, hess = field.jet(p, 2)
    assert f.shape == (len(p),)
    assert g.shape == (len(p), 3)
    assert hess.shape == (len(p), 3, 3)
    scale = np.abs(f).max()
    np.testing.assert_allclose(f, field(p), rtol=0, atol=1e-13 * scale)
    for order in (0, 1):
        lower = field.jet(p, order)
        assert len(lower) == order + 1
        for a, b in zip(lower, (f, g), strict=False):
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-13 * np.abs(b).max())
    for bad in (-1, 3):
        with pytest.raises(InputError):
            field.jet(p, bad)
    np.testing.assert_allclose(hess, hess.transpose(0, 2, 1), rtol=0, atol=1e-13 * _top(hess))
    h = _step(box)
    for axis in range(3):
        e = h[axis] * np.eye(3)[axis]
        up, down = field.jet(p + e, 1), field.jet(p - e, 1)
        slope = (up[0] - down[0]) / (2 * h[axis])
        np.testing.assert_allclose(g[:, axis], slope, rtol=0, atol=rtol * _top(g))
        bend = (up[1] - down[1]) / (2 * h[axis])
        np.testing.assert_allclose(hess[:, axis], bend, rtol=0, atol=rtol * _top(hess))
    empty = field.jet(np.empty((0, 3)), 2)
    assert [a.shape for a in empty] == [(0,), (0, 3), (0, 3, 3)]


def away_from_kinks(field, p, box):
    """Those of the points where values and gradients change alike on both sides, in all directions.

    What the field says of its derivatives at a point is not asked, but for how gradients change.
    The steps are twice those of `check_derivatives`.
    """
    f, g = field(p), field.jet(p, 1)[1]
    keep, h = np.ones(len(p), bool), 2.0 * _step(box)
    for axis in range(3):
        e = h[axis] * np.eye(3)[axis]
        for here, up, down in (
            (f[:, None], field(p + e)[:, None], field(p - e)[:, None]),
            (g, field.jet(p + e, 1)[1], field.jet(p - e, 1)[1]),
        ):
            ahead, behind = (up - here) / h[axis], (here - down) / h[axis]
            typical = max(np.median(np.abs(ahead)), np.median(np.abs(behind)), 1.0)
            keep &= (np.abs(ahead - behind) < 0.01 * typical).all(axis=1)
    return p[keep]


def _top(a):
    return max(np.abs(a).max(), 1e-12)


def check_range(field, rng, box, converges):
    """Bounds hold at corners and random points of boxes of all sizes, and get sharp."""
    unit = np.concatenate([np.array(list(product((0.0, 0.5, 1.0), repeat=3))), rng.random((60, 3))])
    for size in (1.0, 0.3, 0.1, 0.03, 0.01, 1e-3, 0.0):
        extent = size * (box[1] - box[0])
        lo = box[0] + rng.random((20, 3)) * (1.0 - size) * (box[1] - box[0])
        hi = np.minimum(lo + extent, box[1])
        bounds = field.range(lo, hi)
        assert bounds.shape == (20, 2)
        p = np.clip(lo[:, None] + unit * (hi - lo)[:, None], lo[:, None], hi[:, None])
        f = field(p.reshape(-1, 3)).reshape(20, -1)
        assert (bounds[:, 0] <= f.min(axis=1)).all(), f"lower bound violated at size {size}"
        assert (bounds[:, 1] >= f.max(axis=1)).all(), f"upper bound violated at size {size}"
        if converges and 0.0 < size <= 1e-3:
            spread, width = np.ptp(f, axis=1), bounds[:, 1] - bounds[:, 0]
            assert np.median(width) <= 2 * np.median(spread), f"bounds not sharp at size {size}"
    with pytest.raises(InputError):
        field.range(box[1][None], box[0][None])
    with pytest.raises(InputError):
        field.range(box[:1], np.full((1, 3), np.nan))


def check_lipschitz(field, p):
    """The constant bounds differences and gradients."""
    bound = field.lipschitz
    assert np.isfinite(bound)
    f, g = field.jet(p, 1)
    assert np.linalg.norm(g, axis=1).max() <= bound * (1 + 1e-12)
    gap = np.linalg.norm(p[1:] - p[:-1], axis=1)
    assert (np.abs(np.diff(f)) <= bound * gap * (1 + 1e-12)).all()


def check_grid(field, rng, box):
    """Tensor grids agree with single points; axes may have any order and length."""
    for sizes in ((7, 5, 9), (1, 2, 33), (3, 1, 1)):
        axes = [rng.uniform(box[0, i], box[1, i], n) for i, n in enumerate(sizes)]
        p = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        f = field(p).reshape(sizes)
        values = field.grid(axes)
        assert values.shape == sizes
        np.testing.assert_allclose(values, f, rtol=0, atol=1e-12 * max(np.abs(f).max(), 1e-3))
    with pytest.raises(InputError):
        field.grid(axes[:2])
