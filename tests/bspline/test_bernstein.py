"""All real roots of Bernstein polynomials on [0, 1], for every degree."""

from math import comb

import numpy as np
import pytest

from ilattice.bspline._kernels_bernstein import roots


def to_bernstein(zeros, degree):
    """Bernstein coefficients of the polynomial with the given zeros, and no others in [0, 1]."""
    p = np.polynomial.polynomial.polyfromroots(zeros)
    p = np.append(p, np.zeros(degree + 1 - len(p)))
    return np.array(
        [sum(comb(i, j) / comb(degree, j) * p[j] for j in range(i + 1)) for i in range(degree + 1)]
    )


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_every_root_is_found(degree):
    rng = np.random.default_rng(degree)
    lengths = (0, 0, 0) if degree == 2 else np.zeros(degree + 1, np.int64)
    for trial in range(200):
        zeros = rng.uniform(-0.5, 1.5, degree)
        if trial % 3 == 0:
            zeros[0] = 0.5 + 1e-5 * rng.random()
        work = np.zeros(400)
        work[: degree + 1] = rng.choice([-1, 1]) * to_bernstein(zeros, degree)
        n = roots(work, 0, 10, 0, 40, lengths)
        inside = np.sort(zeros[(zeros > 0) & (zeros < 1)])
        gap = np.diff(inside).min(initial=1.0)
        assert n == len(inside)
        np.testing.assert_allclose(work[10 : 10 + n], inside, atol=1e-13 / gap ** (degree - 1))
