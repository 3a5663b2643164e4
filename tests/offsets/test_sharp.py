"""The distance spline with exact values at its kinks, against the exact distance."""

import numpy as np
import pytest

import ilattice as il
from ilattice.offsets.sharp import SharpDistance, changes, span_of


@pytest.fixture(scope="module")
def wall():
    return il.Lattice("neovius", through=il.macroshape.box()).offset(0.05)


def test_kinks_next_to_the_wall_are_exact(wall):
    sharp = SharpDistance(wall.lattice, wall.distance, wall.thickness)
    u = np.random.default_rng(1).random((40000, 3))
    exact, spline, value = wall.lattice.distance(u), wall.distance(u), sharp(u)
    changed = value != spline
    np.testing.assert_array_equal(value[changed], exact[changed])
    assert (np.abs(np.abs(spline[changed]) - 0.05) < sharp.band).all()
    assert 0.0 < changed.mean() < 0.3
    near = np.abs(np.abs(exact) - 0.05) < 0.5 * sharp.band
    before, after = (np.linalg.norm((f - exact)[near]) for f in (spline, value))
    assert after < 0.35 * before
    wrong = [((np.abs(f) < 0.05) != (np.abs(exact) < 0.05)).mean() for f in (spline, value)]
    assert wrong[1] < 0.3 * wrong[0]


def test_bounds_hold_and_derivatives_are_those_of_the_spline(wall):
    sharp = SharpDistance(wall.lattice, wall.distance, wall.thickness)
    rng = np.random.default_rng(2)
    lo = 0.9 * rng.random((300, 3))
    u = lo + 0.1 * rng.random((300, 3))
    bound = sharp.range(lo, lo + 0.1)
    value = sharp(u)
    assert ((bound[:, 0] <= value) & (value <= bound[:, 1])).all()
    for a, b in zip(sharp.jet(u, 1), wall.distance.jet(u, 1), strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(sharp.jet(u, 0)[0], value)
    np.testing.assert_array_equal(sharp.domain, wall.distance.domain)


def test_kinks_next_to_eroded_solids_are_exact():
    lattice = il.Lattice("primitive", through=il.macroshape.box((1.03, 0.97, 1.01)))
    wall = lattice.offset((np.inf, -0.23))
    sharp = SharpDistance(lattice, wall.distance, wall.thickness)
    u = np.random.default_rng(3).random((40000, 3))
    exact, spline, value = lattice.distance(u), wall.distance(u), sharp(u)
    wrong = [((f < -0.23) != (exact < -0.23)).mean() for f in (spline, value)]
    assert wrong[1] < 0.3 * wrong[0]


def test_changes_bound_those_of_the_spline_over_a_span():
    """Tiles are some six times as long as high: most of the distance changes across."""
    wall = il.Lattice("gyroid", through=il.macroshape.torus(4.0, 2.0), repeat=(2, 1, 1)).offset(0.1)
    spline, (lo, hi) = wall.distance, wall.lattice.domain
    u = lo + np.random.default_rng(4).random((4000, 3)) * (hi - lo)
    found = changes(spline)[span_of(spline, u)]
    span = np.array([np.diff(spline.breaks(a)).max() for a in range(3)])
    slope = np.linalg.norm(spline.jet(u, 1)[1] * span, axis=1)
    assert (slope <= found * (1 + 1e-9)).all()
    assert np.median(found / slope) < 3.0
    shifted = u + np.array(wall.lattice.through.closed) * (hi - lo)
    for a, b in zip(span_of(spline, u), span_of(spline, shifted), strict=True):
        assert (a == b).mean() > 0.99  # but for rounding at planes
