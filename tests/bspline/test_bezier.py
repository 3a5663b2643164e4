"""Bézier elements and rigorous ranges."""

import naive
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from ilattice.bspline import BSpline
from ilattice.bspline.bezier import range_on_boxes, to_bezier
from ilattice.bspline.knots import uniform_knots
from ilattice.errors import InputError


def random_spline(rng, degrees, m=0, *, rational=False, jumps=False):
    t = []
    for k in degrees:
        inner = np.sort(rng.uniform(0.1, 0.9, 3))
        times = [1, max(k, 1), k + 1 if jumps else 1]
        t.append(np.r_[np.zeros(k + 1), np.repeat(inner, times), np.ones(k + 1)])
    shape = [len(v) - k - 1 for v, k in zip(t, degrees, strict=True)]
    w = rng.uniform(0.3, 3.0, shape) if rational else None
    return BSpline(t, rng.standard_normal(shape + [m] * bool(m)), degrees, weights=w)


def random_boxes(rng, spline, count, size):
    lo, hi = spline.domain
    a = rng.uniform(lo, hi, (count, spline.ndim))
    b = np.minimum(a + size * rng.random(a.shape) * (hi - lo), hi)
    knots = np.stack([rng.choice(spline.breaks(i), count) for i in range(spline.ndim)], 1)
    snap = rng.random(a.shape) < 0.3
    other = np.where(snap, knots, b)
    return np.minimum(a, other), np.maximum(a, other)


def samples_of_boxes(rng, lo, hi, count=30):
    """Random points, corners and knots-free edges of every box, (count, m, nd)."""
    s = rng.random((count, *lo.shape))
    s = np.where(rng.random(s.shape) < 0.3, np.rint(s), s)
    return np.clip(lo + s * (hi - lo), lo, hi)


DEGREES = [(0,), (1,), (2,), (3,), (8,), (2, 2), (0, 3), (1, 4), (2, 2, 2), (3, 1, 1), (1, 0, 3)]


@pytest.mark.parametrize("m", [0, 2])
@pytest.mark.parametrize("rational", [False, True])
@pytest.mark.parametrize("degrees", [(3,), (2, 3), (2, 1, 2), (0, 1, 4)], ids=str)
def test_elements_agree_with_the_spline(degrees, rational, m):
    rng = np.random.default_rng(len(degrees))
    spline = random_spline(rng, degrees, m, rational=rational)
    cells = to_bezier(spline)
    nd = spline.ndim
    assert cells.k == degrees
    assert cells.shape == tuple(len(spline.breaks(a)) - 1 for a in range(nd))
    for _ in range(20):
        e = tuple(rng.integers(0, cells.shape))
        s = rng.random(nd)
        u = [b[i] + f * (b[i + 1] - b[i]) for b, i, f in zip(cells.breaks, e, s, strict=True)]
        c = cells.coefficients[e]
        if rational:
            w = cells.weights[e]
            c = c * w.reshape(w.shape + (1,) * bool(m))
        for f in s:
            c = naive.de_casteljau(c, f)
            if rational:
                w = naive.de_casteljau(w, f)
        np.testing.assert_allclose(c / w if rational else c, spline([u])[0], atol=1e-13)


def test_cells_are_read_only_and_ranges_hold_the_coefficients():
    spline = random_spline(np.random.default_rng(0), (2, 2, 2), 3)
    cells = spline.to_bezier()
    assert cells.ranges().shape == (*cells.shape, 3, 2)
    assert cells.ranges()[1, 2, 0, 2, 1] == cells.coefficients[1, 2, 0, ..., 2].max()
    with pytest.raises(ValueError, match="read-only"):
        cells.coefficients[0] = 0


@pytest.mark.parametrize("rational", [False, True])
@pytest.mark.parametrize("jumps", [False, True])
@pytest.mark.parametrize("degrees", DEGREES, ids=str)
def test_ranges_contain_all_values(degrees, jumps, rational):
    rng = np.random.default_rng([*degrees, jumps])
    spline = random_spline(rng, degrees, rational=rational, jumps=jumps)
    for size in (1e-3, 0.1, 2.0):
        lo, hi = random_boxes(rng, spline, 60, size)
        u = samples_of_boxes(rng, lo, hi)
        f = spline(u.reshape(-1, spline.ndim)).reshape(u.shape[:2])
        for options in ({}, {"tight": False}, {"level": 0.1}):
            r = range_on_boxes(spline, lo, hi, **options)
            assert (r[:, 0] <= f.min(axis=0)).all()
            assert (f.max(axis=0) <= r[:, 1]).all()


@given(
    c=hnp.arrays(float, (5, 5), elements=st.floats(-1e3, 1e3)),
    corners=hnp.arrays(float, (2, 2), elements=st.floats(0, 1)),
    s=hnp.arrays(float, (6, 2), elements=st.floats(0, 1)),
)
def test_ranges_contain_all_values_of_any_spline(c, corners, s):
    spline = BSpline([uniform_knots(3, 2)] * 2, c, 2)
    lo, hi = corners.min(axis=0), corners.max(axis=0)
    f = spline(np.clip(lo + s * (hi - lo), lo, hi))
    (a, b) = spline.range([lo], [hi])[0]
    assert a <= f.min()
    assert f.max() <= b


def test_level_and_tight_only_trade_width():
    rng = np.random.default_rng(1)
    i = 0.2 * np.arange(10)
    waves = np.sin(np.add.outer(i, np.add.outer(i, i)))
    spline = BSpline([uniform_knots(8, 2)] * 3, waves, 2)
    lo, hi = random_boxes(rng, spline, 500, 0.2)
    tight = range_on_boxes(spline, lo, hi)
    loose = range_on_boxes(spline, lo, hi, tight=False)
    level = range_on_boxes(spline, lo, hi, level=0.0)
    assert (loose[:, 0] <= tight[:, 0]).all()
    assert (tight[:, 1] <= loose[:, 1]).all()
    decided = (loose[:, 0] > 0) | (loose[:, 1] < 0)
    assert 0 < decided.sum() < 500
    assert np.array_equal(level, np.where(decided[:, None], loose, tight))


def test_bounds_on_whole_elements_are_those_of_their_coefficients():
    spline = random_spline(np.random.default_rng(9), (2, 3, 1))
    cells = spline.to_bezier()
    e = np.indices(cells.shape).reshape(3, -1)
    lo, hi = (np.stack([b[i + s] for b, i in zip(cells.breaks, e, strict=True)], 1) for s in (0, 1))
    wanted = cells.ranges().reshape(-1, 2)
    np.testing.assert_allclose(range_on_boxes(spline, lo, hi), wanted, atol=1e-12)
    spans = [v.searchsorted(b, side="right") - 1 for v, b in zip(spline.t, lo.T, strict=True)]
    loose = range_on_boxes(spline, lo, hi, tight=False)
    for i, (r, span) in enumerate(zip(loose, zip(*spans, strict=True), strict=True)):
        window = spline.c[tuple(slice(s - k, s + 1) for s, k in zip(span, spline.k, strict=True))]
        np.testing.assert_allclose(r, [window.min(), window.max()], atol=1e-12, err_msg=f"{i}")


def test_bounds_are_tight_to_second_order():
    rng = np.random.default_rng(2)
    spline = random_spline(rng, (2, 2, 2))
    centre = rng.uniform(0.1, 0.9, (50, 3))
    excess = []
    for h in (2e-2, 1e-2, 5e-3):
        lo, hi = centre - h, centre + h
        u = np.stack(np.meshgrid(*[np.linspace(-h, h, 11)] * 3), -1).reshape(-1, 3)
        f = spline((centre[:, None] + u).reshape(-1, 3)).reshape(50, -1)
        r = spline.range(lo, hi)
        gap = (r[:, 1] - r[:, 0]) - np.ptp(f, axis=1)
        assert gap.min() > -1e-12
        excess.append(gap.mean())
    slope = np.polyfit(np.log([2e-2, 1e-2, 5e-3]), np.log(excess), 1)[0]
    assert slope > 1.8
    assert excess[-1] < 2e-3 * np.ptp(spline.c)


def test_linear_functions_and_points_have_exact_bounds():
    t = [uniform_knots(4, 2), uniform_knots(3, 3)]
    spline = BSpline(t, np.add.outer(*[np.r_[0, 1, 3, 5, 7, 8] / 8, np.zeros(6)]), (2, 3))
    r = spline.range([[0.1, 0.2]], [[0.7, 0.9]])
    np.testing.assert_allclose(r, [[0.1, 0.7]], atol=1e-13)
    other = random_spline(np.random.default_rng(3), (3, 2, 1))
    u = np.random.default_rng(4).random((20, 3))
    np.testing.assert_allclose(other.range(u, u), other(u)[:, None].repeat(2, 1), atol=1e-12)


def test_boxes_are_clipped_to_the_domain():
    spline = random_spline(np.random.default_rng(5), (2, 2))
    whole = spline.range([[0, 0]], [[1, 1]])
    assert np.array_equal(spline.range([[-5, -1]], [[3, 2]]), whole)
    beyond = spline.range([[1.5, 0.2]], [[2.0, 0.2]])
    edge = spline([[1.7, 0.2]], extrapolate="clamp")
    np.testing.assert_allclose(beyond[0], edge[0], atol=1e-12)


@pytest.mark.parametrize("start", [0.0, 0.7])
def test_periodic_boxes_wrap(start):
    rng = np.random.default_rng(6)
    c = rng.standard_normal((8, 6))[np.arange(10) % 8]
    t = [uniform_knots(8, 2, (start, start + 2), periodic=True), uniform_knots(4, 2)]
    spline = BSpline(t, c, 2, periodic=(True, False))
    a = np.stack([rng.uniform(-7, 7, 300), rng.uniform(0, 0.9, 300)], 1)
    a[:20, 0] = start + 2 * rng.integers(-3, 3, 20)
    b = a + rng.choice([0.0, 0.05, 0.5, 2.5], a.shape)
    b[:, 1] = np.minimum(b[:, 1], 1)
    u = samples_of_boxes(rng, a, b, 60)
    f = spline(u.reshape(-1, 2)).reshape(u.shape[:2])
    r = spline.range(a, b)
    assert (r[:, 0] <= f.min(axis=0)).all()
    assert (f.max(axis=0) <= r[:, 1]).all()
    shifted = spline.range(a + np.array([2, 0]), b + np.array([2, 0]))
    np.testing.assert_allclose(r, shifted, atol=1e-11)
    assert np.ptp(r, axis=1).mean() < 0.9 * np.ptp(c)


def test_wrapping_far_from_zero_stays_rigorous():
    c = np.random.default_rng(10).standard_normal(64)[np.arange(65) % 64]
    spline = BSpline([uniform_knots(64, 1, (1000.3, 1016.4), periodic=True)], c, 1, periodic=True)
    u = np.random.default_rng(11).uniform(-1e5, 1e5, 2000)
    r, f = spline.range(u, u), spline(u)
    assert (r[:, 0] <= f).all()
    assert (f <= r[:, 1]).all()
    assert np.ptp(r, axis=1).max() < 1e-7


def test_bad_boxes_are_refused():
    spline = random_spline(np.random.default_rng(7), (2, 2))
    with pytest.raises(InputError, match="lo must not exceed hi: box 1 is"):
        spline.range([[0, 0], [0.5, 0.5]], [[1, 1], [0.6, 0.4]])
    with pytest.raises(InputError, match="finite"):
        spline.range([[0, np.nan]], [[1, 1]])
    with pytest.raises(InputError, match="same shape"):
        spline.range([[0, 0]], [[1, 1], [1, 1]])
    with pytest.raises(InputError, match="scalar"):
        random_spline(np.random.default_rng(8), (2,), 3).range([[0]], [[1]])
    assert spline.range(np.zeros((0, 2)), np.zeros((0, 2))).shape == (0, 2)
