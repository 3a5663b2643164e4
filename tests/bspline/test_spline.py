"""`BSpline` against scipy and the reference implementations."""

from itertools import combinations_with_replacement

import naive
import numba
import numpy as np
import pytest
from scipy.interpolate import NdBSpline

from ilattice.bspline import BSpline, _kernels
from ilattice.bspline.knots import uniform_knots
from ilattice.errors import InputError


def random_knots(rng, k, spans, repeats=True):
    """Clamped knots with inner knots of random multiplicity up to k (a jump for degree 0)."""
    inner = np.sort(rng.uniform(0.1, 0.9, spans - 1))
    times = rng.integers(1, max(k, 1) + 1, len(inner)) if repeats else 1
    return np.r_[np.zeros(k + 1), np.repeat(inner, times), np.ones(k + 1)]


def random_spline(rng, degrees, m=0, *, repeats=True, rational=False):
    t = [random_knots(rng, k, 4, repeats) for k in degrees]
    shape = [len(v) - k - 1 for v, k in zip(t, degrees, strict=True)]
    w = rng.uniform(0.5, 2.0, shape) if rational else None
    return BSpline(t, rng.standard_normal(shape + [m] * bool(m)), degrees, weights=w)


def sample(rng, spline, n=200):
    """Random points, and points made of knots and domain ends."""
    lo, hi = spline.domain
    u = rng.uniform(lo, hi, (n, spline.ndim))
    knots = np.stack([rng.choice(spline.breaks(a), n) for a in range(spline.ndim)], axis=1)
    mixed = np.where(rng.random(u.shape) < 0.5, u, knots)
    return np.concatenate([u, knots, mixed, spline.domain])


def scipy_jet(spline, u):
    """Value, gradient and Hessian from one NdBSpline call per derivative."""
    ref = NdBSpline(spline.t, spline.c, spline.k)
    nd = spline.ndim

    def d(*axes):
        return ref(u, nu=[axes.count(i) for i in range(nd)])

    g = np.stack([d(i) for i in range(nd)], axis=-1)
    h = np.empty((*g.shape, nd))
    for i, j in combinations_with_replacement(range(nd), 2):
        h[..., i, j] = h[..., j, i] = d(i, j)
    return d(), g, h


def assert_close(found, wanted, tol=1e-12):
    assert found.shape == wanted.shape
    assert np.abs(found - wanted).max() <= tol * max(np.abs(wanted).max(), 1e-300)


CASES = [(k,) for k in range(9)]
CASES += [(0, 3), (2, 2), (1, 4), (8, 1), (5, 7)]
CASES += [(1, 1, 1), (2, 2, 2), (3, 3, 3), (3, 1, 1), (2, 1, 1)]
CASES += [(0, 1, 2), (4, 0, 3), (1, 3, 2), (5, 2, 0), (2, 6, 1), (8, 2, 7)]


@pytest.mark.parametrize("m", [0, 3])
@pytest.mark.parametrize("degrees", CASES, ids=str)
def test_jet_agrees_with_scipy(degrees, m):
    rng = np.random.default_rng([*degrees, m])
    spline = random_spline(rng, degrees, m)
    u = sample(rng, spline)
    reference = scipy_jet(spline, u)
    for order in range(3):
        jet = spline.jet(u, order)
        assert len(jet) == order + 1
        for found, wanted in zip(jet, reference, strict=False):
            assert_close(found, wanted)
    assert_close(spline(u), reference[0])


def test_scipy_comparison_at_large_scale():
    rng = np.random.default_rng(5)
    t = [uniform_knots(s, 2, (0, d)) for s, d in ((65, 16.0), (17, 2.0), (17, 2.0))]
    spline = BSpline(t, 1e3 * rng.standard_normal((67, 19, 19)), 2)
    u = sample(rng, spline, 3000)
    for found, wanted in zip(spline.jet(u), scipy_jet(spline, u), strict=True):
        assert_close(found, wanted)


@pytest.mark.parametrize("degrees", [(0,), (3,), (2, 1), (1, 2, 2)], ids=str)
def test_values_agree_with_naive_sum(degrees):
    rng = np.random.default_rng(1)
    spline = random_spline(rng, degrees)
    u = sample(rng, spline, 4)
    wanted = np.array([naive.evaluate(spline.t, spline.c, spline.k, p) for p in u])
    assert_close(spline(u), wanted, 1e-13)


@pytest.mark.parametrize("m", [0, 2])
@pytest.mark.parametrize("degrees", [(3,), (2, 1), (2, 2, 1)], ids=str)
def test_rational_jet_agrees_with_naive_quotient_rule(degrees, m):
    rng = np.random.default_rng(2)
    spline = random_spline(rng, degrees, m, rational=True, repeats=False)
    nd = spline.ndim
    u = rng.random((3, nd))
    f, g, h = spline.jet(u)

    def reference(*axes):
        nu = [axes.count(i) for i in range(nd)]
        return np.array(
            [
                naive.evaluate_rational(spline.t, spline.c, spline.k, spline.weights, p, nu)
                for p in u
            ]
        )

    assert_close(f, reference())
    assert_close(g, np.stack([reference(i) for i in range(nd)], axis=-1))
    rows = [np.stack([reference(i, j) for j in range(nd)], axis=-1) for i in range(nd)]
    assert_close(h, np.stack(rows, axis=-2))


def test_rational_arc_is_a_circle():
    w = np.array([1.0, np.sqrt(0.5), 1.0])
    arc = BSpline([[0, 0, 0, 1, 1, 1]], [[1.0, 0], [1, 1], [0, 1]], 2, weights=w)
    x, g = arc.jet(np.linspace(0, 1, 50), 1)
    assert np.abs(np.linalg.norm(x, axis=1) - 1).max() < 1e-15
    assert np.abs(np.sum(x * g[..., 0], axis=1)).max() < 1e-14


@pytest.mark.parametrize("k", range(1, 9))
def test_periodic_direction_wraps_and_is_smooth_at_the_seam(k):
    rng = np.random.default_rng(k)
    n = k + 6
    c = rng.standard_normal(n)[np.arange(n + k) % n]
    t = uniform_knots(n, k, (1.0, 3.0), periodic=True)
    spline = BSpline([t], c, k, periodic=True)
    u = rng.uniform(1, 3, 50)
    assert_close(spline(u + 2.0), spline(u))
    assert_close(spline(u - 6.0), spline(u), 1e-11)
    plain = BSpline([t], c, k)
    ends = plain.jet([1.0, 3.0], min(k - 1, 2))
    for d in ends:
        assert np.abs(d[0] - d[1]).max() <= 1e-12 * np.abs(d).max()


@pytest.mark.parametrize("order", [0, 1])
@pytest.mark.parametrize("m", [0, 2])
@pytest.mark.parametrize("degrees", [(3,), (2, 4), (2, 2, 2), (1, 3, 0)], ids=str)
def test_grid_and_slabs_agree_with_points(degrees, m, order):
    rng = np.random.default_rng(3)
    spline = random_spline(rng, degrees, m, rational=order == 1)
    axes = [np.sort(np.r_[0, rng.random(5 + i), 1]) for i in range(spline.ndim)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, spline.ndim)
    shape = tuple(len(a) for a in axes)
    wanted = [a.reshape(shape + a.shape[1:]) for a in spline.jet(points, order)]
    grid = spline.grid(axes, order) if order else (spline.grid(axes),)
    for found, w in zip(grid, wanted, strict=True):
        assert_close(found, w)
    for i, j, part in spline.slabs(axes, order, thickness=3):
        part = part if order else (part,)
        for found, w in zip(part, wanted, strict=True):
            assert_close(found, w[i:j])


def test_derivative_spline_is_exact():
    rng = np.random.default_rng(4)
    spline = random_spline(rng, (3, 2, 2), 2, repeats=False)
    u = sample(rng, spline)
    g = spline.jet(u, 1)[1]
    for axis in range(3):
        assert_close(spline.derivative(axis)(u), g[..., axis])


@pytest.mark.parametrize("rational", [False, True])
@pytest.mark.parametrize("m", [0, 3])
def test_insertion_and_elevation_leave_the_spline_unchanged(m, rational):
    rng = np.random.default_rng(6)
    spline = random_spline(rng, (2, 3, 1), m, rational=rational, repeats=False)
    u = sample(rng, spline)
    fine = spline.insert_knots(1, [0.3, 0.3, 0.7]).insert_knots(0, [0.5])
    assert fine.shape == (spline.shape[0] + 1, spline.shape[1] + 3, spline.shape[2])
    assert_close(fine(u), spline(u), 1e-13)
    high = spline.elevate(0, 2).elevate(2)
    assert high.k == (4, 3, 2)
    assert_close(high(u), spline(u), 1e-13)
    assert_close(spline.elevate(1, 0)(u), spline(u), 0)


def test_insertion_and_elevation_of_a_periodic_spline():
    rng = np.random.default_rng(7)
    c = rng.standard_normal(7)[np.arange(9) % 7]
    spline = BSpline([uniform_knots(7, 2, periodic=True)], c, 2, periodic=True)
    u = np.linspace(0, 1, 41)
    assert_close(spline.insert_knots(0, [0.0, 0.35])(u), spline(u), 1e-13)
    assert_close(spline.elevate(0)(u), spline(u), 1e-13)


def test_extrapolation():
    spline = BSpline([[0, 0, 0, 1, 1, 1]], [0.0, 0.0, 1.0], 2)  # u squared
    with pytest.raises(InputError, match=r"u\[1, 0\] = 2.0 is outside the domain \[0.0, 1.0\]"):
        spline([0.5, 2.0])
    assert spline([2.0, -1.0], extrapolate="clamp").tolist() == [1.0, 0.0]
    np.testing.assert_allclose(spline([2.0, -3.0], extrapolate="extend"), [4.0, 9.0], rtol=1e-14)
    with pytest.raises(InputError, match="extrapolate"):
        spline([0.5], extrapolate="wrap")


def test_immutable():
    spline = BSpline([[0, 0, 1, 1]], [0.0, 1.0], 1)
    with pytest.raises(AttributeError, match="immutable"):
        spline.k = (2,)
    with pytest.raises(ValueError, match="read-only"):
        spline.c[0] = 3.0
    source = np.array([0.0, 1.0])
    held = BSpline([[0, 0, 1, 1]], source, 1)
    source[0] = 5.0
    assert held([0.0])[0] == 0.0


@pytest.mark.parametrize(
    ("t", "c", "k", "options", "message"),
    [
        ([[0, 0, 1, 1]], [0.0, 1.0, 2.0], 1, {}, r"t\[0\].* 5 knots, got 4"),
        ([[0, 0, 1, 0.5]], [0.0, 1.0], 1, {}, r"t\[0\] must not decrease: knot 3"),
        ([[0, 0, 0, 0]], [0.0, 1.0], 1, {}, r"t\[0\] spans no domain"),
        ([[0, 0, 1, np.nan]], [0.0, 1.0], 1, {}, r"t\[0\] must be finite"),
        ([[0, 0, 1, 1]], [0.0, np.inf], 1, {}, "c must be finite"),
        ([[0, 0, 1, 1]], [0.0, 1.0], 9, {}, "degrees from 0 to 8"),
        ([[0, 0, 1, 1]], [0.0, 1.0], 1.5, {}, "degrees from 0 to 8"),
        ([[0, 0, 1, 1]] * 4, np.zeros((2,) * 4), 1, {}, "1 to 3 knot vectors"),
        ([[0, 0, 1, 1]], np.zeros((2, 2, 2)), 1, {}, "c must have 1 or 2 axes"),
        ([[0, 0, 1, 1]], [0.0, 1.0], 1, {"weights": [1.0, 0.0]}, "weights must be positive"),
        ([[0, 0, 1, 1]], [0.0, 1.0], 1, {"weights": [1.0]}, "weights must have the shape"),
        ([[-1, 0, 1, 2, 3]], [0.0, 1.0, 2.0], 1, {"periodic": True}, "c is not periodic"),
        ([[-1, 0, 1, 2, 4]], [0.0, 1.0, 0.0], 1, {"periodic": True}, r"t\[0\] is not periodic"),
    ],
)
def test_bad_construction_is_refused(t, c, k, options, message):
    with pytest.raises(InputError, match=message):
        BSpline(t, c, k, **options)


def test_bad_queries_are_refused():
    spline = BSpline([[0, 0, 1, 1]] * 3, np.zeros((2, 2, 2)), 1)
    with pytest.raises(InputError, match="shape"):
        spline(np.zeros((4, 2)))
    with pytest.raises(InputError, match="finite"):
        spline([[0.0, np.nan, 0.0]])
    with pytest.raises(InputError, match="order"):
        spline.jet(np.zeros((1, 3)), 3)
    with pytest.raises(InputError, match="axes must hold 3"):
        spline.grid([[0.0], [1.0]])
    assert spline(np.zeros((0, 3))).shape == (0,)


@pytest.mark.threads
def test_threads_do_not_change_a_bit():
    rng = np.random.default_rng(8)
    spline = random_spline(rng, (2, 2, 2), repeats=False)
    u = rng.random((20000, 3))
    axes = [np.linspace(0, 1, 33)] * 3
    many = [*spline.jet(u), *spline.grid(axes, 1), spline.range(u[:999] * 0.5, u[:999])]
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        one = [*spline.jet(u), *spline.grid(axes, 1), spline.range(u[:999] * 0.5, u[:999])]
    finally:
        numba.set_num_threads(before)
    for a, b in zip(many, one, strict=True):
        assert np.array_equal(a, b)


@pytest.mark.parametrize("degrees", [(2, 2, 2), (3, 1, 1), (1, 5, 4)], ids=str)
def test_a_point_does_not_depend_on_its_neighbours(degrees):
    rng = np.random.default_rng(9)
    spline = random_spline(rng, degrees, 2)
    u = sample(rng, spline)
    order = rng.permutation(len(u))
    for whole, shuffled in zip(spline.jet(u), spline.jet(u[order]), strict=True):
        assert np.array_equal(whole[order], shuffled)
    for i in range(5):
        for whole, single in zip(spline.jet(u), spline.jet(u[i : i + 1]), strict=True):
            assert np.array_equal(whole[i], single[0])


def test_grid_of_high_degree_at_unsorted_sites():
    rng = np.random.default_rng(10)
    spline = random_spline(rng, (1, 8, 5))
    axes = [rng.random(3), rng.random(4), rng.random(9)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    f, g = spline.grid(axes, 1)
    wanted = spline.jet(points, 1)
    assert_close(f, wanted[0].reshape(3, 4, 9))
    assert_close(g, wanted[1].reshape(3, 4, 9, 3))
    empty = spline.grid((axes[0], [], axes[2]), 1)
    assert [a.shape for a in empty] == [(3, 0, 9), (3, 0, 9, 3)]


@pytest.mark.parametrize("u", [np.nan, np.inf, -np.inf, 1e300, -1e300])
def test_every_number_has_a_knot_span(u):
    t, k, n = np.array([0, 0, 0, 1, 1.5, 4, 4, 4.0]), 2, 5
    d = _kernels.pack_direction(t, k, n)
    size = _kernels.TABLE + (k + 1) ** 2
    rows = len(d) - size * np.arange(3, 0, -1)
    assert d[rows + _kernels.FIRST].tolist() == [0, 1, 2]
    row = _kernels.find_row(d, size, u)
    assert row in rows
    if not np.isnan(u):
        assert row == rows[2 if u > 0 else 0]


def test_infinite_parameters_are_refused_wherever_points_may_lie():
    spline = BSpline([[-1, 0, 1, 2]], [0.0, 0.0], 1, periodic=True)
    for u, option in ((np.inf, "raise"), (np.nan, "clamp"), (-np.inf, "extend")):
        with pytest.raises(InputError, match="u must be finite"):
            spline([u], extrapolate=option)
