"""Least steps onto several linear conditions, against pseudo-inverses by singular values."""

import numpy as np
import pytest

from ilattice.offsets._small import least_steps


@pytest.mark.parametrize("k", [1, 2, 3])
@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e4])
def test_steps_are_the_shortest_ones_by_the_metric(k, scale):
    rng = np.random.default_rng(k)
    rows, miss = rng.normal(size=(50, k, 3)), rng.normal(size=(50, k))
    rows[:10, -1] = 0.7 * rows[:10, 0]  # follows from the first one, or contradicts it
    rows[10:20, -1], miss[10:20, -1] = 0.0, 0.0  # is none
    roots = scale * (np.eye(3) + 0.4 * rng.normal(size=(50, 3, 3)))
    found = least_steps(rows, miss, roots.transpose(0, 2, 1) @ roots)
    for i in range(50):
        back = np.linalg.inv(roots[i])
        step = -back @ np.linalg.pinv(rows[i] @ back, 1e-3) @ miss[i]
        np.testing.assert_allclose(found[i], step, rtol=1e-6, atol=1e-8 * np.abs(step).max())
    plain = least_steps(rows, miss)
    exact = -np.einsum("nik,nk->ni", np.linalg.pinv(rows, 1e-3), miss)
    np.testing.assert_allclose(plain, exact, rtol=1e-6, atol=1e-8)


def test_a_singular_metric_gives_no_step():
    metric = np.stack([np.eye(3), np.diag([1.0, 1.0, 0.0])])
    found = least_steps(np.ones((2, 1, 3)), np.ones((2, 1)), metric)
    np.testing.assert_allclose(found[0], -1.0 / 3.0)
    assert np.isnan(found[1]).all()
