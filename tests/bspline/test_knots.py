"""Knot vectors, collocation, insertion, elevation, extraction."""

import naive
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BSpline as ScipyBSpline

from ilattice.bspline.knots import (
    as_knot_vector,
    bezier_matrix,
    bezier_rows,
    breaks,
    design_matrix,
    elevation_matrix,
    find_spans,
    greville,
    insertion_matrix,
    uniform_knots,
    wrap,
)
from ilattice.errors import InputError


def knot_vectors(k, rng):
    """Clamped, repeated, discontinuous, unclamped and periodic knots of degree k."""
    inner = np.sort(rng.uniform(0.1, 0.9, 5))
    ends = np.zeros(k + 1), np.ones(k + 1)
    yield np.r_[ends[0], inner, ends[1]]
    yield np.r_[ends[0], np.repeat(inner[:3], [1, max(k, 1), (k + 1) // 2 or 1]), ends[1]]
    yield np.r_[ends[0], np.repeat(0.5, k + 1), ends[1]]
    yield np.r_[-np.sort(rng.random(k))[::-1], 0, inner, 1, 1 + np.sort(rng.random(k))]
    yield uniform_knots(9, k, (-1, 2), periodic=True)


def sites_of(t, k):
    """Random sites, all knots of the domain, and its ends."""
    domain = t[k : len(t) - k]
    return np.r_[np.random.default_rng(0).uniform(domain[0], domain[-1], 20), domain]


DEGREES = range(9)


@pytest.mark.parametrize("k", DEGREES)
def test_design_matrix_agrees_with_scipy(k):
    rng = np.random.default_rng(k)
    for t in knot_vectors(k, rng):
        c = rng.standard_normal(len(t) - k - 1)
        x = sites_of(t, k)
        for nu in range(min(k, 3) + 1):
            wanted = ScipyBSpline(t, c, k)(x, nu)
            found = design_matrix(t, k, x, nu) @ c
            assert np.abs(found - wanted).max() <= 1e-12 * np.abs(wanted).max()
        assert design_matrix(t, k, x, k + 1).nnz == 0


@pytest.mark.parametrize("k", [0, 1, 2, 3, 5])
def test_design_matrix_agrees_with_the_recursion(k):
    for t in list(knot_vectors(k, np.random.default_rng(k)))[:4]:
        x = sites_of(t, k)[::2]
        for nu in range(min(k, 2) + 1):
            wanted = np.array([naive.basis_row(t, k, v, nu) for v in x])
            found = design_matrix(t, k, x, nu).toarray()
            assert np.abs(found - wanted).max() <= 1e-12 * np.abs(wanted).max()


@pytest.mark.parametrize("k", DEGREES)
def test_partition_of_unity_and_linear_precision(k):
    for t in knot_vectors(k, np.random.default_rng(k)):
        x = sites_of(t, k)
        a = design_matrix(t, k, x)
        assert a.data.min() >= 0
        assert np.abs(a.sum(axis=1) - 1).max() < 1e-14
        if k:
            assert np.abs(a @ greville(t, k) - x).max() < 1e-14


def test_linear_precision_at_ten_coefficients():
    t = uniform_knots(8, 2)
    x = np.linspace(0, 1, 1001)
    assert np.abs(design_matrix(t, 2, x) @ greville(t, 2) - x).max() <= 4e-16


def test_periodic_design_matrix_folds_the_copies():
    t = uniform_knots(6, 3, (1, 4), periodic=True)
    x = np.r_[np.linspace(1, 4, 13), 5.2, -7.7]
    a = design_matrix(t, 3, x, periodic=True)
    assert a.shape == (15, 6)
    c = np.arange(6.0) ** 2
    plain = design_matrix(t, 3, wrap(x, t, 3)) @ c[np.arange(9) % 6]
    np.testing.assert_allclose(a @ c, plain, atol=1e-13)
    np.testing.assert_allclose(a[0].toarray(), a[12].toarray(), atol=1e-15)


def test_extrapolation_continues_the_end_polynomials():
    t = np.r_[np.zeros(3), 0.5, np.ones(3)]
    with pytest.raises(InputError, match=r"x\[1\] = 1.5 is outside the domain \[0.0, 1.0\]"):
        design_matrix(t, 2, [0.5, 1.5])
    square = t[1:5] * t[2:6]  # the polar form of x squared
    out = design_matrix(t, 2, [-2.0, 3.0], extrapolate=True) @ square
    np.testing.assert_allclose(out, [4.0, 9.0], rtol=1e-14)


def test_find_spans_is_half_open_with_the_right_end_in_the_last_span():
    t = np.array([0, 0, 0, 1, 1, 2, 3, 3, 3.0])
    x = [-1, 0, 0.5, 1, 1.5, 2, 2.5, 3, 4]
    assert find_spans(t, 2, x).tolist() == [2, 2, 2, 4, 4, 5, 5, 5, 5]


def test_uniform_knots_and_greville_by_hand():
    assert uniform_knots(2, 2, (0, 4)).tolist() == [0, 0, 0, 2, 4, 4, 4]
    assert uniform_knots(2, 1, (0, 4), periodic=True).tolist() == [-2, 0, 2, 4, 6]
    assert greville(uniform_knots(2, 2, (0, 4)), 2).tolist() == [0, 1, 3, 4]
    assert greville([0.0, 1, 3], 0).tolist() == [0.5, 2.0]
    assert breaks(uniform_knots(2, 1, (0, 4), periodic=True), 1).tolist() == [0, 2, 4]
    third = uniform_knots(3, 4, (0.1, 0.3))
    assert greville(third, 4)[[0, -1]].tolist() == [0.1, 0.3]  # not beyond the ends by rounding
    for a, b in ((0.1, 0.3), (0.2, 0.9), (0.4, 1.7)):  # a + (b - a) may miss b by rounding
        ends = uniform_knots(7, 3, (a, b), periodic=True)
        assert (ends[3], ends[10]) == (a, b)


@pytest.mark.parametrize("k", DEGREES)
def test_insertion_leaves_the_spline_unchanged(k):
    rng = np.random.default_rng(k)
    for t in knot_vectors(k, rng):
        c = rng.standard_normal(len(t) - k - 1)
        x = sites_of(t, k)
        lo, hi = t[k], t[len(t) - k - 1]
        new = rng.uniform(lo, hi, 3)
        new = np.r_[new, new[: min(k, 1)]]
        t2, matrix = insertion_matrix(t, k, new)
        assert np.array_equal(t2, np.sort(np.r_[t, new]))
        wanted = design_matrix(t, k, x) @ c
        assert np.abs(design_matrix(t2, k, x) @ (matrix @ c) - wanted).max() <= 1e-13
        assert np.abs(matrix.sum(axis=1) - 1).max() <= 1e-13


def test_insertion_agrees_with_boehm():
    rng = np.random.default_rng(9)
    for k in range(1, 6):
        t = np.r_[np.zeros(k + 1), np.sort(rng.random(6)), np.ones(k + 1)]
        c = rng.standard_normal(len(t) - k - 1)
        wanted_t, wanted = t, c
        for x in (0.3, 0.3, 0.85)[: k + 1]:
            wanted_t, wanted = naive.insert_knot(wanted_t, wanted, k, x)
        t2, matrix = insertion_matrix(t, k, (0.3, 0.3, 0.85)[: k + 1])
        assert np.array_equal(t2, wanted_t)
        np.testing.assert_allclose(matrix @ c, wanted, atol=1e-13)
        assert matrix.data.min() > -1e-15  # convex combinations


def test_rows_far_from_the_new_knot_are_exact_unit_rows():
    t = np.r_[np.zeros(4), np.sort(np.random.default_rng(3).random(30)), np.ones(4)]
    _, matrix = insertion_matrix(t, 3, [0.5])
    touched = np.flatnonzero(np.diff(matrix.indptr) > 1)
    assert len(touched) <= 3
    assert np.all(np.delete(matrix.max(axis=1).toarray().ravel(), touched) == 1.0)


def test_insertion_up_to_full_multiplicity_and_not_beyond():
    t = uniform_knots(4, 2)
    t2, matrix = insertion_matrix(t, 2, [0.3, 0.3, 0.3])
    c = np.arange(6.0)
    x = np.linspace(0, 1, 21)
    assert np.abs(design_matrix(t2, 2, x) @ (matrix @ c) - design_matrix(t, 2, x) @ c).max() < 1e-14
    with pytest.raises(InputError, match=r"repeats the knot 0.3 4 times; degree 2 allows 3"):
        insertion_matrix(t, 2, [0.3] * 4)
    with pytest.raises(InputError, match=r"repeats the knot 0.0 4 times"):
        insertion_matrix(t, 2, [0.0])
    with pytest.raises(InputError, match=r"new_knots\[0\] = 1.5 is outside the domain"):
        insertion_matrix(t, 2, [1.5])


@pytest.mark.parametrize("k", range(1, 9))
def test_periodic_insertion_and_elevation_stay_periodic(k):
    rng = np.random.default_rng(k)
    spans = k + 4
    t = uniform_knots(spans, k, (0, 2), periodic=True)
    c = rng.standard_normal(spans)[np.arange(spans + k) % spans]
    x = sites_of(t, k)
    wanted = design_matrix(t, k, x) @ c
    new = [0.0, 0.3, 1.7, t[k + 1]]
    results = [(k, *insertion_matrix(t, k, new, periodic=True))]
    results.append((k, *insertion_matrix(t, k, [2.0, 0.3], periodic=True)))
    for times in range(1, min(9 - k, 4)):
        t2, k2, matrix = elevation_matrix(t, k, times, periodic=True)
        results.append((k2, t2, matrix))
    for k2, t2, matrix in results:
        as_knot_vector("t2", t2, k2, periodic=True)
        c2 = matrix @ c
        assert np.array_equal(c2[:k2], c2[len(c2) - k2 :])
        assert (t2[k2], t2[len(c2)]) == (0.0, 2.0)
        assert np.abs(design_matrix(t2, k2, x) @ c2 - wanted).max() <= 1e-13


@pytest.mark.parametrize("k", range(8))
def test_elevation_leaves_the_spline_unchanged(k):
    rng = np.random.default_rng(k)
    for t in knot_vectors(k, rng):
        c = rng.standard_normal(len(t) - k - 1)
        x = sites_of(t, k)
        wanted = design_matrix(t, k, x) @ c
        for times in range(9 - k):
            t2, k2, matrix = elevation_matrix(t, k, times)
            assert k2 == k + times
            assert np.abs(design_matrix(t2, k2, x) @ (matrix @ c) - wanted).max() <= 1e-13


def test_elevation_of_one_bezier_segment_by_hand():
    t2, k2, matrix = elevation_matrix([0, 0, 0, 1, 1, 1.0], 2)
    assert t2.tolist() == [0, 0, 0, 0, 1, 1, 1, 1]
    assert k2 == 3
    rows = [[1, 0, 0], [1 / 3, 2 / 3, 0], [0, 2 / 3, 1 / 3], [0, 0, 1]]
    np.testing.assert_allclose(matrix.toarray(), rows, atol=1e-15)
    with pytest.raises(InputError, match="times must be a whole number from 0 to 6"):
        elevation_matrix([0, 0, 0, 1, 1, 1.0], 2, 7)


@pytest.mark.parametrize("k", DEGREES)
def test_extraction_gives_bernstein_coefficients(k):
    rng = np.random.default_rng(k)
    for t in knot_vectors(k, rng):
        c = rng.standard_normal(len(t) - k - 1)
        operators = bezier_rows(t, k)[1].reshape(-1, k + 1, k + 1)
        edges = breaks(t, k)
        spans = find_spans(t, k, 0.5 * (edges[1:] + edges[:-1]))
        assert operators.shape == (len(edges) - 1, k + 1, k + 1)
        assert operators.min() > -1e-14
        stacked = (bezier_matrix(t, k) @ c).reshape(-1, k + 1)
        for e, span in enumerate(spans):
            b = operators[e] @ c[span - k : span + 1]
            np.testing.assert_allclose(stacked[e], b, atol=1e-15)
            x = edges[e] + 0.3 * (edges[e + 1] - edges[e])
            assert abs(naive.de_casteljau(b, 0.3) - (design_matrix(t, k, [x]) @ c)[0]) < 1e-13


@given(
    k=st.integers(0, 8),
    inner=st.lists(st.floats(0.01, 0.99), max_size=6),
    x=st.lists(st.floats(0, 1), min_size=1, max_size=5),
)
def test_basis_is_a_partition_of_unity_on_any_knots(k, inner, x):
    values, counts = np.unique(inner, return_counts=True)
    inner = np.repeat(values, np.minimum(counts, k + 1))
    t = np.r_[np.zeros(k + 1), inner, np.ones(k + 1)]
    a = design_matrix(t, k, x)
    assert np.abs(a.sum(axis=1) - 1).max() < 1e-12
    assert a.data.min() >= 0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: uniform_knots(0, 2), "n_spans must be"),
        (lambda: uniform_knots(2.5, 2), "n_spans must be"),
        (lambda: uniform_knots(2, 9), "k must be a whole degree from 0 to 8"),
        (lambda: uniform_knots(2, 2, (1, 1)), "domain must be an interval"),
        (lambda: design_matrix([0, 0, 1], 1, [0.5]), "t must hold at least 2k"),
        (lambda: design_matrix([0, 0, 2, 1, 3, 3], 1, [0.5]), "t must not decrease: knot 3"),
        (lambda: design_matrix([0, 0, np.nan, 1, 1], 1, [0.5]), "t must be finite"),
        (lambda: design_matrix([0, 0, 0, 1, 1, 1], 1, [0.5]), "repeats the knot 0.0 3 times"),
        (lambda: design_matrix([0, 0, 1, 1], 1, [0.5], -1), "nu must be"),
        (lambda: design_matrix([0, 0, 1, 1], 1, [np.nan]), "x must be finite"),
        (lambda: design_matrix([-1, 0, 1, 2, 2.5], 1, [0.5], periodic=True), "t is not periodic"),
    ],
)
def test_bad_input_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()
