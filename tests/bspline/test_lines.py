"""Operators along one axis against dense linear algebra."""

import numba
import numpy as np
import pytest
from scipy.sparse import csr_array

from ilattice.bspline.lines import apply_all, band_lu, identity_operator, line_operator
from ilattice.errors import InputError


def band_matrix(rng, n, lower, upper, cyclic):
    a = np.zeros((n, n))
    for i in range(n):
        for s in range(-lower, upper + 1):
            if cyclic:
                a[i, (i + s) % n] += rng.random()
            elif 0 <= i + s < n:
                a[i, i + s] = rng.random()
    return a + (lower + upper) * np.eye(n)


CASES = [(10, 2, 1, 0), (10, 2, 2, 1), (3, 2, 2, 1), (5, 2, 2, 1), (6, 1, 2, 1), (40, 4, 3, 1)]
CASES += [(40, 8, 8, 0), (40, 8, 8, 1), (17, 8, 8, 1), (1, 0, 0, 0), (2, 1, 1, 1), (64, 0, 2, 0)]


@pytest.mark.parametrize("case", CASES, ids=str)
@pytest.mark.parametrize("shape", [(1, 1), (1, 50), (50, 1), (4, 13)], ids=str)
def test_product_and_solve_agree_with_dense_algebra(case, shape):
    rng = np.random.default_rng(case[0])
    n = case[0]
    a, b = band_matrix(rng, *case), rng.standard_normal((n, 2 * n))
    x = rng.standard_normal((shape[0], 2 * n, shape[1]))
    found = line_operator(csr_array(b), csr_array(a)).along(x, 1)
    wanted = np.einsum("ij,ajb->aib", np.linalg.solve(a, b), x)
    np.testing.assert_allclose(found, wanted, atol=1e-12 * np.abs(wanted).max())


def test_border_stays_narrow_for_wrapped_bands():
    rng = np.random.default_rng(0)
    assert band_lu(csr_array(band_matrix(rng, 200, 2, 2, True))).cols.shape == (200, 2)
    assert band_lu(csr_array(band_matrix(rng, 200, 2, 2, False))).cols.shape == (200, 0)


def test_axes_commute_and_strided_input_is_accepted():
    rng = np.random.default_rng(1)
    ops = [
        line_operator(
            csr_array(rng.random((n, n + 2))), csr_array(band_matrix(rng, n, 1, 1, False))
        )
        for n in (4, 5, 6)
    ]
    x = rng.random((8, 7, 6)).transpose(2, 1, 0)
    first = apply_all(ops, x)
    second = ops[2].along(ops[1].along(ops[0].along(x.copy(), 0), 1), 2)
    assert first.shape == (4, 5, 6)
    np.testing.assert_allclose(first, second, rtol=1e-12)
    np.testing.assert_allclose(ops[0].along(apply_all(ops, x, first=1), 0), first, rtol=1e-12)


def test_empty_and_identity():
    assert identity_operator(3).along(np.zeros((3, 0)), 0).shape == (3, 0)
    x = np.random.default_rng(2).random((3, 4))
    assert np.array_equal(identity_operator(3).along(x, 0), x)


@pytest.mark.parametrize(
    "a",
    [
        np.zeros((3, 3)),
        np.ones((4, 4)),
        np.diag([1.0, 0.0, 2.0]),
        [[1.0, 2.0, 0], [0.5, 1.0, 0], [0, 0, 1]],
    ],
)
def test_singular_matrices_are_refused(a):
    with pytest.raises(InputError, match="singular"):
        line_operator(csr_array(np.eye(len(a))), csr_array(np.array(a)))


@pytest.mark.threads
def test_threads_do_not_change_a_bit():
    rng = np.random.default_rng(3)
    op = line_operator(csr_array(rng.random((30, 40))), csr_array(band_matrix(rng, 30, 2, 2, True)))
    x = rng.random((17, 40, 33))
    many = op.along(x, 1)
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        one = op.along(x, 1)
    finally:
        numba.set_num_threads(before)
    assert np.array_equal(many, one)
