"""Helpers of geometry that many rooms share."""

from itertools import product

import numpy as np
import pytest

from ilattice._geometry import determinants, grid_points, inverses


@pytest.mark.parametrize("axes", [([0, 1], [5, 6, 7]), ([0.5], [1.0, 2.0], [3.0, 4.0, 5.0])])
def test_points_of_grids_are_in_the_order_of_loops(axes):
    found = grid_points(*axes)
    assert found.tolist() == [list(p) for p in product(*axes)]
    assert found.dtype == np.asarray(axes[0]).dtype


def test_inverses_are_those_of_lapack():
    a = np.random.default_rng(1).standard_normal((200, 3, 3)) * 10.0 ** np.arange(-3, 3, 2)
    np.testing.assert_allclose(inverses(a) @ a, np.broadcast_to(np.eye(3), a.shape), atol=1e-8)
    np.testing.assert_allclose(inverses(a), np.linalg.inv(a), rtol=1e-9)


def test_determinants_are_those_of_lapack():
    a = np.random.default_rng(3).normal(size=(4, 5, 3, 3))
    assert np.allclose(determinants(a), np.linalg.det(a), rtol=1e-12, atol=1e-14)
