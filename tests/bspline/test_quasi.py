"""Local quasi-interpolants: stencils, reproduction, locality, order."""

import numpy as np
import pytest

from ilattice.bspline.fit import fit_quasi, sites
from ilattice.bspline.fit_common import directions
from ilattice.bspline.knots import uniform_knots, wrapped_knots
from ilattice.bspline.quasi import quasi_operator
from ilattice.errors import InputError


def dense(t, k, periodic=False):
    """Stencils of one direction as a matrix: the fit of unit samples."""
    (d,) = directions(t, k, periodic, "quasi", None)
    return quasi_operator(d).along(np.eye(len(d.sites)), 0)


def test_quadratic_stencils_on_equal_spans():
    a = dense(uniform_knots(6, 2), 2)
    assert a.shape == (8, 8)
    wanted = np.zeros((8, 8))
    wanted[0, 0] = wanted[7, 7] = 1
    wanted[1, :3] = wanted[6, :4:-1] = -1 / 3, 3 / 2, -1 / 6
    for i in range(2, 6):
        wanted[i, i - 1 : i + 2] = -1 / 8, 5 / 4, -1 / 8
    np.testing.assert_allclose(a, wanted, atol=1e-14)
    assert np.abs(a).sum(axis=1).max() == pytest.approx(2)  # bound; the operator norm is lower


def test_cubic_stencils_on_equal_spans():
    a = dense(uniform_knots(8, 3), 3)
    assert a.shape == (11, 9)
    assert a[0] == pytest.approx(np.eye(9)[0], abs=1e-14)
    for i in range(3, 8):
        row = np.zeros(9)
        row[i - 2 : i + 1] = -1 / 6, 8 / 6, -1 / 6
        np.testing.assert_allclose(a[i], row, atol=1e-13)
    np.testing.assert_allclose(a, a[::-1, ::-1], atol=1e-13)


@pytest.mark.parametrize("k", [1, 2, 3])
def test_periodic_stencils_are_the_inner_rule_everywhere(k):
    a = dense(uniform_knots(9, k, periodic=True), k, periodic=True)
    assert a.shape == (9, 9)
    for i in range(9):
        np.testing.assert_allclose(np.roll(a[0], i), a[i], atol=1e-13)
    side = {1: 0, 2: -1 / 8, 3: -1 / 6}[k]
    assert np.sort(a[0])[[0, 1, -1]] == pytest.approx([side, side, 1 - 2 * side], abs=1e-13)


def test_quasi_norm_of_the_quadratic_rule():
    """The largest value of the spline of worst samples between -1 and 1 is about 1.47."""
    from ilattice.bspline.knots import design_matrix

    t = uniform_knots(32, 2)
    lebesgue = np.abs(design_matrix(t, 2, np.linspace(0, 1, 4001)) @ dense(t, 2)).sum(axis=1)
    assert lebesgue.max() == pytest.approx(1.47, abs=0.01)


@pytest.mark.parametrize("k", [1, 2, 3])
@pytest.mark.parametrize("spacing", ["equal", "random"])
def test_polynomials_are_reproduced(k, spacing):
    rng = np.random.default_rng(k)
    inner = np.linspace(0, 1, 9)[1:-1] if spacing == "equal" else np.sort(rng.random(7))
    t = np.r_[np.zeros(k + 1), inner, np.ones(k + 1)]
    x, u = sites(t, k, "quasi"), rng.random(100)
    for p in range(k + 1):
        assert np.abs(fit_quasi(x**p, t, k)(u) - u**p).max() < 1e-12


@pytest.mark.parametrize("k", [1, 2, 3])
def test_unequal_periodic_knots_converge(k):
    errors = []
    u = np.random.default_rng(0).random(400)
    for n in (16, 32, 64):
        i = np.arange(n) / n
        t = wrapped_knots(3 * i + 0.3 * np.sin(2 * np.pi * i), k, 3.0)
        w = 2 * np.pi / 3
        spline = fit_quasi(np.sin(w * sites(t, k, "quasi", periodic=True)), t, k, periodic=True)
        errors.append(np.abs(spline(3 * u) - np.sin(w * 3 * u)).max())
    assert -np.polyfit(np.log([16, 32, 64]), np.log(errors), 1)[0] > k + 0.7


def test_cubic_periodic_sine_anchors():
    u = np.linspace(0, 1, 2001)
    for n, wanted in ((8, 1.0e-2), (16, 7.0e-4), (32, 4.5e-5), (64, 2.8e-6)):
        t = uniform_knots(n, 3, periodic=True)
        spline = fit_quasi(np.sin(2 * np.pi * np.arange(n) / n), t, 3, periodic=True)
        assert np.abs(spline(u) - np.sin(2 * np.pi * u)).max() == pytest.approx(wanted, rel=0.1)


def test_a_sample_acts_locally():
    t = [uniform_knots(20, 2), uniform_knots(20, 3)]
    values = np.zeros((22, 21))
    values[10, 10] = 1
    c = fit_quasi(values, t, (2, 3)).c
    i, j = np.nonzero(np.abs(c) > 1e-12)
    assert np.ptp(i) <= 2
    assert np.ptp(j) <= 3
    assert np.abs(c).max() == pytest.approx(5 / 4 * 8 / 6)


@pytest.mark.parametrize(
    ("t", "k", "periodic", "message"),
    [
        (uniform_knots(6, 4), 4, False, "k must be 1, 2 or 3"),
        (uniform_knots(2, 3), 3, False, "too few spans: degree 3 needs 4 samples, got 3"),
        ([0, 0, 0, 0.5, 0.5, 1, 1, 1], 2, False, "simple inner knots"),
    ],
)
def test_bad_knots_are_refused(t, k, periodic, message):
    size = len(sites(t, k, "quasi", periodic))
    with pytest.raises(InputError, match=message):
        fit_quasi(np.zeros(size), t, k, periodic=periodic)
