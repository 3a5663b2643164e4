"""Direct fits, and fits of fields with a tolerance."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline, make_lsq_spline

from ilattice.bspline import BSpline
from ilattice.bspline.fit import (
    METHODS,
    check_points,
    fit,
    fit_greville,
    fit_interpolate,
    fit_least_squares,
    fit_lspia,
    fit_quasi,
    fit_report,
    fit_uniform_sampling,
    sites,
)
from ilattice.bspline.fit_common import wrap
from ilattice.bspline.knots import design_matrix, uniform_knots, wrapped_knots
from ilattice.errors import ConvergenceError, InputError

FITS = {
    "least-squares": fit_least_squares,
    "interpolate": fit_interpolate,
    "greville": fit_greville,
    "uniform-sampling": fit_uniform_sampling,
    "quasi": fit_quasi,
}


class Gyroid:
    """One cell on the unit cube, amplitude 1.5; evaluates grids without points."""

    def __call__(self, p):
        x, y, z = 2 * np.pi * p.T
        return np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)

    def grid(self, axes):
        (sx, sy, sz), (cx, cy, cz) = ([f(2 * np.pi * a) for a in axes] for f in (np.sin, np.cos))
        xy = sx[:, None, None] * cy[None, :, None]
        yz = sy[None, :, None] * cz[None, None, :]
        return xy + yz + sz[None, None, :] * cx[:, None, None]


# Largest error on a 61^3 grid for 8, 16, 32, 64 spans, and the range of the fitted order.
TABLE = {
    (2, "uniform-sampling"): ([6.1e-1, 3.1e-1, 2.3e-1, 1.4e-1], 0.5, 1.0),
    (2, "greville"): ([2.2e-1, 5.7e-2, 1.4e-2, 3.6e-3], 1.9, 2.1),
    (2, "interpolate"): ([1.3e-2, 1.5e-3, 1.4e-4, 1.8e-5], 3.0, 3.4),
    (2, "least-squares"): ([2.5e-2, 3.1e-3, 4.3e-4, 5.6e-5], 2.8, 3.1),
    (2, "quasi"): ([2.5e-2, 2.8e-3, 2.6e-4, 3.7e-5], 2.9, 3.4),
    (3, "uniform-sampling"): ([1.0, 5.8e-1, 3.9e-1, 2.4e-1], 0.5, 0.9),
    (3, "greville"): ([2.8e-1, 7.5e-2, 1.9e-2, 4.8e-3], 1.9, 2.1),
    (3, "interpolate"): ([3.5e-3, 1.9e-4, 1.0e-5, 7.2e-7], 3.8, 4.3),
    (3, "least-squares"): ([1.8e-3, 8.8e-5, 4.6e-6, 3.4e-7], 3.8, 4.4),
    (3, "quasi"): ([4.4e-2, 2.1e-3, 1.3e-4, 8.4e-6], 3.8, 4.3),
}


@pytest.mark.parametrize(("degree", "method"), TABLE, ids=str)
def test_error_table_of_the_gyroid(degree, method):
    wanted, low, high = TABLE[degree, method]
    x = np.linspace(0, 1, 61)
    exact = Gyroid().grid((x, x, x))
    spans = np.array([8, 16, 32, 64])
    splines = [fit(Gyroid(), degree=degree, spans=int(s), method=method) for s in spans]
    errors = np.array([np.abs(s.grid((x, x, x)) - exact).max() for s in splines])
    assert np.all(errors < 1.1 * np.array(wanted))
    assert np.all(errors > 0.9 * np.array(wanted))
    assert low < -np.polyfit(np.log(spans), np.log(errors), 1)[0] < high


@pytest.mark.parametrize(
    ("degree", "method", "order"),
    [
        *((2, "least-squares", 3), (2, "interpolate", 3), (2, "quasi", 3), (2, "greville", 2)),
        *((3, "least-squares", 4), (3, "interpolate", 4), (3, "quasi", 4), (3, "greville", 2)),
        *((1, "quasi", 2), (4, "interpolate", 5), (5, "least-squares", 6), (0, "interpolate", 1)),
    ],
)
def test_periodic_orders(degree, method, order):
    spans = np.array([8, 16, 32, 64])
    x = np.random.default_rng(0).random(500)
    wave = np.sin(2 * np.pi * x) + 0.5 * np.cos(4 * np.pi * x)
    errors = []
    for s in spans:
        t = uniform_knots(s, degree, periodic=True)
        y = 2 * np.pi * sites(t, degree, method, periodic=True)
        spline = FITS[method](np.sin(y) + 0.5 * np.cos(2 * y), t, degree, periodic=True)
        errors.append(np.abs(spline(x) - wave).max())
    slope = -np.polyfit(np.log(spans[1:]), np.log(errors[1:]), 1)[0]
    assert order - 0.3 < slope < order + 0.6


def knots_of_kinds(k, rng):
    yield uniform_knots(9, k, (-1, 2)), False
    yield np.r_[np.zeros(k + 1), np.sort(rng.random(8)), np.ones(k + 1)], False
    yield np.r_[np.zeros(k + 1), np.repeat([0.1, 0.5, 0.6], max(k, 1)), np.ones(k + 1)], False
    yield (
        np.r_[np.zeros(k + 1), np.repeat(0.1, k + 1), np.linspace(0.2, 1, 9)[:-1], np.ones(k + 1)],
        False,
    )
    yield uniform_knots(12, k, (0.5, 2), periodic=True), True
    yield wrapped_knots(np.r_[0, np.sort(rng.random(11))], k, 1.0), True


@pytest.mark.parametrize("method", ["least-squares", "interpolate"])
@pytest.mark.parametrize("k", range(9))
def test_splines_of_the_space_are_reproduced(k, method):
    rng = np.random.default_rng(k)
    for t, periodic in knots_of_kinds(k, rng):
        n = len(t) - k - 1 - (k if periodic else 0)
        c = rng.standard_normal(n)
        a = design_matrix(t, k, sites(t, k, method, periodic), periodic=periodic)
        spline = FITS[method](a @ c, t, k, periodic=periodic)
        x = rng.uniform(*spline.domain[:, 0], 200)
        wanted = design_matrix(t, k, x, periodic=periodic) @ c
        assert np.abs(spline(x) - wanted).max() < 1e-11
        if periodic:
            assert np.array_equal(spline.c[:k], spline.c[n:])


@pytest.mark.parametrize("method", METHODS)
def test_which_polynomials_each_method_reproduces(method):
    for k in (1, 2, 3):
        highest = {"greville": 1, "uniform-sampling": 0}.get(method, k)
        highest = k if method == "uniform-sampling" and k == 1 else highest
        t = [uniform_knots(6, k), uniform_knots(5, k, (1, 2))]
        axes = [sites(v, k, method) for v in t]
        u = np.random.default_rng(k).uniform((0, 1), (1, 2), (50, 2))
        for p in range(k + 1):
            options = {"iterations": 400, "tol": 1e-12, "accelerate": "cg"}
            values = np.add.outer(axes[0] ** p, 2 * axes[1] ** p)
            if method == "lspia":
                spline = fit_lspia(values, t, k, **options)
            else:
                spline = FITS[method](values, t, k)
            error = np.abs(spline(u) - u[:, 0] ** p - 2 * u[:, 1] ** p).max()
            assert error < 1e-10 if p <= highest else error > 1e-3


def test_interpolation_agrees_with_scipy():
    rng = np.random.default_rng(0)
    for k in (1, 2, 3, 5):
        t = np.r_[np.zeros(k + 1), np.sort(rng.random(10)), np.ones(k + 1)]
        x = sites(t, k, "interpolate")
        y = rng.standard_normal((len(x), 2))
        wanted = make_interp_spline(x, y, k=k, t=t).c
        np.testing.assert_allclose(fit_interpolate(y, t, k).c, wanted, rtol=1e-9, atol=1e-10)


def test_periodic_interpolation_agrees_with_scipy():
    rng = np.random.default_rng(1)
    x = np.linspace(0, 2, 13)
    y = rng.standard_normal(13)
    y[-1] = y[0]
    wanted = make_interp_spline(x, y, k=3, bc_type="periodic")
    t = uniform_knots(12, 3, (0, 2), periodic=True)
    np.testing.assert_allclose(sites(t, 3, "interpolate", True), x[:-1], atol=1e-14)
    found = fit_interpolate(y[:-1], t, 3, periodic=True)
    u = np.linspace(0, 2, 101)
    np.testing.assert_allclose(found(u), wanted(u), atol=1e-12)


def test_least_squares_agrees_with_scipy():
    rng = np.random.default_rng(2)
    for k in (1, 2, 3, 5):
        t = np.r_[np.zeros(k + 1), np.sort(rng.random(6)), np.ones(k + 1)]
        x = np.sort(rng.random(80))
        y = rng.standard_normal(80)
        wanted = make_lsq_spline(x, y, t, k).c
        found = fit_least_squares(y, t, k, at=x).c
        np.testing.assert_allclose(found, wanted, rtol=1e-8, atol=1e-9 * np.abs(wanted).max())


def test_mixed_directions_and_vectors_are_tensor_products():
    rng = np.random.default_rng(3)
    k, periodic = (2, 3, 1), (True, False, True)
    t = [uniform_knots(7, 2, (0, 3), True), uniform_knots(4, 3), uniform_knots(5, 1, (1, 2), True)]
    for method in ("least-squares", "interpolate"):
        axes = [sites(v, d, method, p) for v, d, p in zip(t, k, periodic, strict=True)]
        values = rng.standard_normal([*(len(x) for x in axes), 2])
        found = FITS[method](values, t, k, periodic=periodic)
        assert (found.k, found.periodic, found.m, found.shape) == (k, periodic, 2, (9, 7, 6))
        dense = values
        for i in range(3):
            a = design_matrix(t[i], k[i], axes[i], periodic=periodic[i]).toarray()
            dense = np.moveaxis(np.tensordot(np.linalg.pinv(a), dense, (1, i)), 0, i)
        np.testing.assert_allclose(found.c[:7, :, :5], dense, atol=1e-11)
        one = FITS[method](values[..., 0], t, k, periodic=periodic)
        np.testing.assert_allclose(one.c, found.c[..., 0], atol=1e-14)


def test_periodic_fit_has_a_smooth_seam():
    t = uniform_knots(10, 2, periodic=True)
    y = np.cos(2 * np.pi * (sites(t, 2, "least-squares", True) + 0.13))
    spline = fit_least_squares(y, t, 2, periodic=True)
    value, slope = BSpline(spline.t, spline.c, 2).jet([0.0, 1.0], 1)
    assert abs(np.diff(value[:, ...])[0]) < 1e-14
    assert abs(slope[1, 0] - slope[0, 0]) < 1e-10


def test_literal_sampling_rule_distorts_the_boundary():
    t = uniform_knots(8, 2)  # 10 coefficients
    x = np.linspace(0, 1, 1001)
    line = fit_uniform_sampling(sites(t, 2, "uniform-sampling"), t, 2)
    assert np.abs(line(x) - x).max() == pytest.approx(0.0425, abs=1e-4)
    assert line.jet([0.0, 1.0], 1)[1].ravel() == pytest.approx([1.78, 1.78], abs=0.005)
    jumps = {}
    for method in ("uniform-sampling", "greville", "least-squares"):
        y = np.cos(2 * np.pi * (sites(t, 2, method) + 0.13))
        slope = FITS[method](y, t, 2).jet([0.0, 1.0], 1)[1].ravel()
        jumps[method] = abs(slope[1] - slope[0])
    assert jumps["uniform-sampling"] == pytest.approx(5.1, abs=0.05)
    assert jumps["greville"] == pytest.approx(1.7, abs=0.05)
    assert 1e-3 < jumps["least-squares"] < 0.1


def test_greville_stays_between_the_samples():
    rng = np.random.default_rng(4)
    t = [uniform_knots(7, 3, periodic=True), uniform_knots(6, 2)]
    y = rng.standard_normal((7, 8))
    spline = fit_greville(y, t, (3, 2), periodic=(True, False))
    values = spline.grid([np.linspace(0, 1, 50)] * 2)
    assert y.min() <= values.min()
    assert values.max() <= y.max()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("periodic", [False, True])
def test_sites_are_ascending_and_inside(method, periodic):
    for k in range(1, 4) if method == "quasi" else range(9):
        t = uniform_knots(11, k, (-2, 1), periodic=periodic)
        x = sites(t, k, method, periodic)
        assert (np.diff(x) > 0).all()
        assert x[0] >= -2
        assert x[-1] <= 1 - (1e-9 if periodic else 0)
    if method in ("interpolate", "greville"):
        even, odd = (uniform_knots(4, k, periodic=True) for k in (2, 3))
        assert sites(even, 2, method, True).tolist() == [0.125, 0.375, 0.625, 0.875]
        assert sites(odd, 3, method, True).tolist() == [0, 0.25, 0.5, 0.75]


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("k", [2, 3])
def test_sites_of_nearly_equal_spans_are_near_those_of_equal_ones(k, periodic):
    base = np.arange(12) / 12
    base[5] += 1e-3
    t = wrapped_knots(base, k, 1.0) if periodic else np.r_[np.zeros(k), base, np.ones(k + 1)]
    n = 12 if periodic else 12 + k
    x = sites(t, k, "least-squares", periodic)
    assert len(x) == 2 * n
    if periodic:
        gaps = np.diff(np.r_[x, x[0] + 1])
        assert np.abs(gaps - 1 / 24).max() < 1e-3
    per_span = np.histogram(x, np.r_[base, 1])[0]
    assert per_span.min() >= 2 if not periodic else set(per_span) == {2}


# ------------------------------------------------------------------------------ fields


def test_fit_refines_until_the_tolerance_is_met_at_fresh_points():
    u = np.random.default_rng(5).random((20000, 3))
    for tol in (1e-2, 1e-3, 1e-4):
        spline, report = fit_report(Gyroid(), tol=tol, spans=4)
        assert report.error <= tol
        assert report.history[-1] == (report.spans, report.error)
        assert [e > tol for _, e in report.history[:-1]] == [True] * (len(report.history) - 1)
        assert np.abs(spline(u) - Gyroid()(u)).max() < 1.5 * tol
        assert report.rms < report.error
        last = check_points(np.array([[0.0] * 3, [1] * 3]), 4096, len(report.history) - 1)
        assert report.error == np.abs(spline(last) - Gyroid()(last)).max()
        same = fit(Gyroid(), tol=tol, spans=4)
        assert np.array_equal(same.c, spline.c)


def test_check_points_are_fresh_fill_the_box_and_reach_its_faces():
    box = np.array([[0.0, -2, 1], [1, 3, 1.5]])
    first, second = check_points(box, 4096, 0), check_points(box, 4096, 1)
    both = np.concatenate([first, second])
    inner = np.all((both > box[0]) & (both < box[1]), axis=1)
    assert len(np.unique(both[inner], axis=0)) == inner.sum()
    s = (both - box[0]) / (box[1] - box[0])
    assert 0 <= s.min() <= s.max() <= 1
    assert np.abs((s == 0).mean(axis=0) - 0.024).max() < 0.005
    assert np.abs((s == 1).mean(axis=0) - 0.024).max() < 0.005
    cells = np.histogramdd(s, bins=4)[0]
    assert cells.min() > 0.5 * len(s) / 64


def test_fit_refines_only_the_directions_that_need_it():
    def field(p):
        return np.sin(8 * p[:, 0]) + p[:, 1] + 0.1 * p[:, 2] ** 2

    _, report = fit_report(field, tol=1e-5, spans=2)
    assert report.spans[1:] == (2, 2)
    assert report.spans[0] >= 64


def test_grids_and_points_give_the_same_spline_slab_by_slab(monkeypatch):
    whole = fit(Gyroid(), spans=(12, 5, 7))
    points = fit(Gyroid().__call__, spans=(12, 5, 7))
    np.testing.assert_allclose(points.c, whole.c, atol=1e-13)
    monkeypatch.setattr("ilattice.bspline.fit.SLAB_POINTS", 500)
    assert np.array_equal(fit(Gyroid(), spans=(12, 5, 7)).c, whole.c)


@pytest.mark.parametrize("method", METHODS)
def test_fit_of_every_method_periodic_and_clamped(method):
    bound = {"uniform-sampling": 0.6, "greville": 0.2}.get(method, 0.02)
    for periodic in (False, True, (True, False, True)):
        spline, report = fit_report(Gyroid(), spans=16, method=method, periodic=periodic)
        assert spline.shape == (18, 18, 18)
        assert report.error < bound
        assert report.spans == (16, 16, 16)


def test_fit_of_curves_and_vector_fields():
    def circle(p):
        return np.stack([np.cos(p[:, 0]), np.sin(p[:, 0])], axis=1)

    domain = [[0], [2 * np.pi]]
    spline, report = fit_report(circle, domain=domain, degree=3, periodic=True, tol=1e-6)
    assert (spline.ndim, spline.m) == (1, 2)
    assert report.error <= 1e-6
    refit = fit(spline, domain=domain, degree=3, spans=report.spans, periodic=True)
    np.testing.assert_allclose(refit.c, spline.c, atol=1e-12)


def test_a_kink_ends_in_a_convergence_error_that_says_how_far_it_got():
    with pytest.raises(ConvergenceError, match=r"reached an error of 0.003\d* with \(64,\) spans"):
        fit(lambda p: np.abs(p[:, 0] - 0.3), domain=[[0], [1]], tol=1e-6, max_spans=64)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: fit_interpolate(np.zeros(5), uniform_knots(4, 2), 2), r"shape \(6,\)"),
        (
            lambda: fit_interpolate(np.full(6, np.nan), uniform_knots(4, 2), 2),
            "values must be finite",
        ),
        (
            lambda: fit_interpolate(np.zeros(5), uniform_knots(4, 2), 2, at=np.linspace(0, 1, 5)),
            "one per",
        ),
        (
            lambda: fit_interpolate(np.zeros(6), uniform_knots(4, 2), 2, at=np.linspace(0, 0.4, 6)),
            "singular",
        ),
        (
            lambda: fit_least_squares(
                np.zeros(9), uniform_knots(4, 2), 2, at=np.linspace(0, 0.4, 9)
            ),
            "singular",
        ),
        (
            lambda: fit_least_squares(np.zeros(3), uniform_knots(4, 2), 2, at=[0, 0.5, 1]),
            "at least 6",
        ),
        (
            lambda: fit_least_squares(np.zeros(3), uniform_knots(4, 2), 2, at=[0, 0.5, 2]),
            r"inside \[0.0",
        ),
        (
            lambda: fit_least_squares(np.zeros(3), uniform_knots(4, 2), 2, at=[0, 0.7, 0.5]),
            "ascending",
        ),
        (lambda: fit_least_squares(np.zeros((3, 3)), [uniform_knots(4, 2)] * 4, 2), "1 to 3 knot"),
        (
            lambda: fit_least_squares(np.zeros((3, 3)), [uniform_knots(4, 2)] * 2, (2, 2, 2)),
            "k must be one",
        ),
        (lambda: fit_greville(np.zeros(4), [0, 0, 0, 1, 0.5, 1, 1], 2), "must not decrease"),
        (lambda: sites(uniform_knots(4, 2), 2, "spline"), "method must be one of least-squares"),
        (lambda: fit(lambda p: p[:, 0], tol=-1), "tol must be one number above zero"),
        (lambda: fit(lambda p: p[:, 0], tol=1e-3, checks=0), "checks"),
        (lambda: fit(lambda p: p[:, 0], domain=[[0, 0], [0, 1]]), "domain must hold"),
        (lambda: fit(lambda p: p[:, 0], spans=0), "n_spans must be"),
        (lambda: fit(lambda p: p[:, 0], method="best"), "method must be one of"),
        (lambda: fit(lambda p: p[:3, 0]), "field must return values of shape"),
        (
            lambda: fit(lambda p: np.where(p[:, 0] > 0.5, np.nan, 0)),
            "values of field must be finite",
        ),
    ],
)
def test_bad_input_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_wrap_moves_sites_by_whole_periods():
    t = uniform_knots(4, 2, (1, 3), periodic=True)
    np.testing.assert_allclose(wrap(np.array([0.5, 1.0, 3.0, 6.2]), t, 2), [2.5, 1.0, 1.0, 2.2])
