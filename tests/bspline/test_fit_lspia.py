"""Progressive iteration against its reference implementation and the direct fit."""

import naive
import numpy as np
import pytest

from ilattice.bspline.fit import fit_least_squares, fit_lspia, sites
from ilattice.bspline.knots import design_matrix, uniform_knots
from ilattice.errors import ConvergenceError, InputError


def problem(spans=(16, 6, 5), k=2):
    t = [uniform_knots(s, k) for s in spans]
    x = [sites(v, k, "lspia") for v in t]
    values = np.random.default_rng(0).standard_normal([len(v) for v in x])
    return t, x, values


def test_first_iterates_agree_with_the_recurrence():
    t, x, values = problem((4, 3), 2)
    matrices = [design_matrix(v, 2, s).toarray() for v, s in zip(t, x, strict=True)]
    for step, wanted in enumerate(naive.lspia(matrices, values, 5), 1):
        found = fit_lspia(values, t, 2, iterations=step).c
        np.testing.assert_allclose(found, wanted, atol=1e-13)


def test_least_eigenvalue_in_one_direction():
    for spans in (16, 64):
        t = uniform_knots(spans, 2)
        a = design_matrix(t, 2, sites(t, 2, "lspia")).toarray()
        eigenvalues = np.linalg.eigvals(a.T @ a / a.sum(axis=0)[:, None]).real
        assert eigenvalues.min() == pytest.approx(0.112, abs=1e-3)
        assert eigenvalues.max() == pytest.approx(1, abs=1e-12)


def test_plain_steps_converge_at_the_rate_of_the_least_eigenvalue():
    t, _, values = problem((16,))
    wanted = fit_least_squares(values, t, 2).c
    errors = [np.abs(fit_lspia(values, t, 2, iterations=i).c - wanted).max() for i in (40, 60, 80)]
    rates = np.diff(np.log(errors)) / 20
    assert rates == pytest.approx(np.log(1 - 0.112), rel=0.15)


def test_plain_steps_reach_the_least_squares_fit():
    t, _, values = problem((16,))
    wanted = fit_least_squares(values, t, 2).c
    found = fit_lspia(values, t, 2, iterations=400).c
    assert np.abs(found - wanted).max() <= 1e-10 * np.abs(wanted).max()


def test_accelerated_steps_reach_the_least_squares_fit():
    t, _, values = problem()
    wanted = fit_least_squares(values, t, 2).c
    found = fit_lspia(values, t, 2, iterations=300, tol=1e-11, accelerate="cg").c
    assert np.abs(found - wanted).max() <= 1e-10 * np.abs(wanted).max()
    plain = fit_lspia(values, t, 2, iterations=100).c
    fast = fit_lspia(values, t, 2, iterations=100, accelerate="cg").c
    assert np.abs(fast - wanted).max() < 0.01 * np.abs(plain - wanted).max()


def test_vectors_and_periodic_directions():
    t = [uniform_knots(8, 3, periodic=True), uniform_knots(5, 1)]
    shape = [len(sites(t[0], 3, "lspia", True)), len(sites(t[1], 1, "lspia"))]
    values = np.random.default_rng(1).standard_normal([*shape, 2])
    options = {"periodic": (True, False)}
    wanted = fit_least_squares(values, t, (3, 1), **options)
    found = fit_lspia(values, t, (3, 1), iterations=200, tol=1e-13, accelerate="cg", **options)
    np.testing.assert_allclose(found.c, wanted.c, atol=1e-10)
    assert found.periodic == (True, False)


@pytest.mark.parametrize("accelerate", [None, "cg"])
def test_masked_samples_do_not_matter_and_unreached_coefficients_keep_their_start(accelerate):
    t, x, values = problem((10, 8))
    keep = (x[0][:, None] < 0.5) & (x[1][None, :] > 0)
    spoiled = np.where(keep, values, 1e6)
    start = fit_lspia(np.full_like(values, 7.0), t, 2, iterations=100, accelerate="cg")
    options = {"weights": keep.astype(float), "start": start, "accelerate": accelerate}
    found = fit_lspia(spoiled, t, 2, iterations=30, **options).c
    assert np.abs(found).max() < 1e3
    np.testing.assert_allclose(found[7:], 7.0, atol=1e-9)
    assert np.array_equal(found[8:], start.c[8:])
    again = fit_lspia(values, t, 2, iterations=30, **options).c
    np.testing.assert_allclose(found, again, atol=1e-8)


def test_weighted_fit_minimises_the_weighted_sum():
    t, x, values = problem((6,))
    w = np.random.default_rng(2).uniform(0.2, 3, len(values))
    a = design_matrix(t[0], 2, x[0]).toarray() * np.sqrt(w)[:, None]
    wanted = np.linalg.lstsq(a, values * np.sqrt(w), rcond=None)[0]
    found = fit_lspia(values, t, 2, weights=w, iterations=200, tol=1e-13, accelerate="cg").c
    np.testing.assert_allclose(found, wanted, atol=1e-11)


def test_tolerance_that_is_not_met_is_an_error():
    t, _, values = problem((16,))
    with pytest.raises(ConvergenceError, match=r"in 5 iterations, tol asks for 1e-10"):
        fit_lspia(values, t, 2, iterations=5, tol=1e-10)
    assert fit_lspia(np.zeros_like(values), t, 2, iterations=5, tol=1e-10).c.max() == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"accelerate": "anderson"}, "accelerate must be None or 'cg'"),
        ({"iterations": -1}, "iterations"),
        ({"weights": [1.0]}, "weights must be non-negative of shape"),
        ({"weights": "minus"}, "weights must be non-negative of shape"),
        ({"start": "other"}, "start must be a spline on the same knots"),
    ],
)
def test_bad_options_are_refused(options, message):
    t, _, values = problem((6,))
    if options.get("weights") == "minus":
        options = {"weights": -np.ones_like(values)}
    if options.get("start") == "other":
        options = {"start": fit_least_squares(np.zeros(18), uniform_knots(7, 2), 2)}
    with pytest.raises(InputError, match=message):
        fit_lspia(values, t, 2, **options)
