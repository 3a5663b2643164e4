"""Quantities over patches that are known at a few places."""

import numpy as np
import pytest

from ilattice.errors import InputError
from ilattice.minimal import Disc
from ilattice.minimal.weights import located, spread

DISC = Disc(5, 12)


def bent(uv):
    return np.column_stack([uv[:, :2], 0.3 * uv[:, 0] ** 2 - 0.2 * uv[:, 1]])


def test_places_are_found_in_their_triangles():
    rng = np.random.default_rng(0)
    uv = DISC.flat[rng.integers(0, DISC.count, 20), :2] * 0.97
    rows, weights = located(DISC, uv)
    assert np.abs(np.einsum("ka,kac->kc", weights, DISC.flat[rows][:, :, :2]) - uv).max() < 1e-14
    with pytest.raises(InputError, match="regular polygon of 5"):
        located(DISC, [(-0.99, 0.0)])


def test_values_are_met_and_kept_within_bounds():
    v = bent(DISC.flat)
    places = np.array([(0.0, 0.0), (0.9, 0.0), (-0.3, 0.5), (-0.2, -0.7)])
    values = np.array([1.0, 3.0, 3.0, 1.0])
    x = spread(v, DISC, places, values)
    rows, weights = located(DISC, places)
    assert np.abs((weights * x[rows]).sum(axis=1) - values).max() < 1e-9
    assert x.min() >= 1.0
    assert x.max() <= 3.0
    assert np.ptp(x) == pytest.approx(2.0)
    assert (spread(v, DISC, places, [0.2] * 4) == 0.2).all()
    smooth = np.abs(np.diff(x[DISC.side_rows], axis=1)).max()
    assert smooth < 0.4  # no spikes at the places


def test_a_linear_function_of_a_flat_patch_is_kept():
    places = np.array([(0.9, 0.1), (-0.6, 0.4), (0.0, -0.8), (0.1, 0.1)])
    plane = lambda p: 2.0 + p[:, 0] - 0.5 * p[:, 1]  # noqa: E731
    low = spread(
        DISC.flat, DISC, [*places, (0.25, -0.75), (-0.8, 0.55)], [*plane(places), 2.6, 0.9]
    )
    inside = np.abs(low - plane(DISC.flat)).max()
    assert inside < 0.4
    for values in ([1.0, 2.0], [1.0] * 5):
        with pytest.raises(InputError, match="one per place"):
            spread(DISC.flat, DISC, places, values)
