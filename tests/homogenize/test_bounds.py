"""Bounds of effective properties."""

import numpy as np
import pytest

from ilattice.homogenize.bounds import conductive_bounds, elastic_bounds


def spheres(K, G, f):
    """Hashin's coated spheres: matrix K[0], G[0], inclusions K[1], part f of the volume."""
    return K[0] + f / (1 / (K[1] - K[0]) + 3 * (1 - f) / (3 * K[0] + 4 * G[0]))


def test_two_phases_are_those_of_hashin_and_shtrikman():
    K, G = np.array([1.3, 4.0]), np.array([0.6, 2.2])
    for f in (0.1, 0.37, 0.8):
        bulk, shear = elastic_bounds(np.array([1 - f, f]), K, G)
        assert bulk[0] == pytest.approx(spheres(K, G, f), rel=1e-13)
        assert bulk[1] == pytest.approx(spheres(K[::-1], G[::-1], 1 - f), rel=1e-13)
        beta = 6 * (K + 2 * G) / (5 * G * (3 * K + 4 * G))
        low = G[0] + f / (1 / (G[1] - G[0]) + (1 - f) * beta[0])
        high = G[1] + (1 - f) / (1 / (G[0] - G[1]) + f * beta[1])
        assert shear == pytest.approx((low, high), rel=1e-13)


def test_voids_and_conductivity():
    bulk, shear = elastic_bounds(np.array([0.3, 0.7]), np.array([0.0, 2.0]), np.array([0.0, 1.0]))
    assert bulk[0] == shear[0] == 0.0
    assert bulk[1] == pytest.approx(4 * 2.0 * 1.0 * 0.7 / (4 * 1.0 + 3 * 2.0 * 0.3), rel=1e-13)
    assert conductive_bounds(np.array([0.3, 0.7]), np.array([0.0, 5.0])) == pytest.approx(
        (0.0, 5.0 * 2 * 0.7 / (3 - 0.7)), rel=1e-13
    )


def test_one_phase_is_its_own_bound_and_absent_phases_do_not_count():
    bulk, shear = elastic_bounds(np.array([1.0, 0.0]), np.array([2.0, 9.0]), np.array([1.0, 0.0]))
    assert bulk == pytest.approx((2.0, 2.0), rel=1e-14)
    assert shear == pytest.approx((1.0, 1.0), rel=1e-14)
