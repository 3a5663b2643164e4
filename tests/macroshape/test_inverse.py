"""Parameters of points: round trips, points outside, seams, failures that are counted."""

from pathlib import Path

import macro_zoo
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from macro_zoo import ZOO, parameters

from ilattice import macroshape as ms
from ilattice.bspline import BSpline
from ilattice.errors import InputError, PrecisionWarning
from ilattice.macroshape import SplineMap
from ilattice.macroshape import inverse as module

DATA = Path(__file__).parents[1] / "data" / "gismo"


@pytest.mark.parametrize("volume", ZOO.values(), ids=ZOO)
def test_inverse_undoes_the_map(volume):
    u = parameters(volume, 400)
    found = volume.locate(volume.x(u))
    assert (found.status == 0).all()
    assert found.failures == 0
    gap = np.abs(found.u - u)
    period = np.diff(volume.domain, axis=0)
    gap = np.where(volume.closed, np.minimum(gap, period - gap), gap)  # either end of the seam
    assert gap.max() < 1e-9
    assert found.iterations.max() < 30


@given(
    seed=st.integers(0, 10_000),
    k=st.tuples(*[st.integers(1, 4)] * 3),
    spans=st.tuples(*[st.integers(1, 3)] * 3),
    rational=st.booleans(),
)
@settings(max_examples=20)
def test_inverse_undoes_perturbed_maps(seed, k, spans, rational):
    n = tuple(a + b for a, b in zip(k, spans, strict=True))
    volume = macro_zoo.perturbed(n, k, 0.08, seed=seed, rational=rational)
    u = parameters(volume, 60, seed)
    np.testing.assert_allclose(volume.inverse(volume.x(u)), u, atol=1e-9)


@pytest.mark.parametrize("seed", [44, 106, 114])
def test_points_in_thin_maps_whose_tangents_jump_are_inside(seed):
    rng = np.random.default_rng(seed)
    k = tuple(rng.integers(1, 4, 3))
    n = tuple(d + 1 + int(m) for d, m in zip(k, rng.integers(0, 3, 3), strict=True))
    knots = [
        np.r_[[0.0] * (d + 1), np.sort(rng.uniform(0.2, 0.8, m - d - 1)), [1.0] * (d + 1)]
        for d, m in zip(k, n, strict=True)
    ]
    sites = [
        [t[i + 1 : i + d + 1].mean() for i in range(m)] for t, d, m in zip(knots, k, n, strict=True)
    ]
    net = np.stack(np.meshgrid(*sites, indexing="ij"), axis=-1)
    net = (net + rng.normal(size=net.shape) * 0.06) * [1.0, 0.01, 1.0]
    volume = SplineMap(BSpline(knots, net, k))
    assert volume.certificate.status == "VALID"
    x = volume.x(rng.uniform(0.01, 0.99, (20_000, 3)))
    found = volume.locate(x)
    assert (found.status == 0).all()
    np.testing.assert_allclose(volume.x(found.u), x, atol=1e-10)


@pytest.mark.parametrize("name", ["torus", "torus exact", "duck", "tapered", "left-handed"])
def test_inside_and_outside_add_up_to_the_volume(name):
    volume = ZOO[name]
    lo, hi = volume.bounds
    x = lo + np.random.default_rng(0).random((6000, 3)) * (hi - lo)
    found = volume.locate(x)
    assert found.failures == 0
    inside = found.status == 0
    part = inside.mean()
    sigma = np.sqrt(part * (1 - part) / len(x))
    assert part == pytest.approx(volume.volume() / np.prod(hi - lo), abs=4 * sigma)
    np.testing.assert_allclose(volume.x(found.u[inside]), x[inside], atol=1e-10)
    assert np.isnan(found.u[~inside]).all()
    searched = found.iterations[~inside & (found.iterations > 0)]
    assert searched.mean() < 9  # ended where the distance is stationary, not by creeping


def test_inside_of_the_exact_torus_is_known():
    volume = ms.torus(4.0, 2.0, form="exact")
    x = np.random.default_rng(3).uniform(-6, 6, (4000, 3))
    r = np.hypot(x[:, 0], x[:, 1])
    inside = (np.abs(r - 4) <= 1) & (np.abs(x[:, 2]) <= 1)
    assert 100 < inside.sum() < 1000
    np.testing.assert_array_equal(~np.isnan(volume.inverse(x)[:, 0]), inside)


def test_points_far_outside_cost_no_search():
    found = ms.duck().locate([[100.0, 0, 0], [0, 0, -50]])
    assert (found.status == 1).all()
    assert np.isinf(found.distance).all()
    assert (found.iterations == 0).all()


def test_points_just_outside_are_outside_by_the_tolerance():
    volume = ms.box((1, 1, 1))
    x = np.array([[0.5, 0.5, 1 + 1e-7]])
    assert np.isnan(volume.inverse(x)).all()
    np.testing.assert_allclose(volume.inverse(x, tol=1e-6), [[0.5, 0.5, 1]], atol=1e-15)


def test_the_seam_of_closed_directions_is_crossed():
    for form in ("periodic", "arcs", "exact"):
        volume = ms.torus(form=form)
        u = np.full((200, 3), 0.5)
        u[:, 0] = np.mod(np.linspace(-1e-3, 1e-3, 200), 1)
        seeds = volume._seeds
        across = np.full((200, 3), 0.5)
        for start in (np.where(u[:, 0] < 0.5, 0.97, 0.03), 0.0, 1.0):  # beyond the seam, on it
            across[:, 0] = start
            v, distance, _, _ = module._search(seeds, volume.x(u), across, 1e-10)
            assert distance.max() < 1e-12
            gap = np.abs(v - u)[:, 0]
            assert np.minimum(gap, 1 - gap).max() < 1e-9


def test_two_arms_near_each_other_are_told_apart():
    """A letter C that nearly closes, with many seeds in one arm only: these are the nearest."""
    coarse = ms.cylinder_shell(0.5, 1.5, 1.0, angle=2 * np.pi - 0.02)
    volume = SplineMap(coarse.spline.insert_knots(0, np.linspace(0.01, 0.2, 20)))
    u = parameters(volume, 500)
    u[:, 0] = 1 - 0.001 * u[:, 0]
    x = volume.x(u)
    _, nearest = volume._seeds.tree.query(x)
    assert (volume._seeds.u[nearest, 0] < 0.2).mean() > 0.5
    np.testing.assert_allclose(volume.inverse(x), u, atol=1e-9)


def test_a_volume_with_singular_corners_is_inverted():
    volume = ms.load(DATA / "GshapedVolume.xml")
    u = parameters(volume, 2000)
    found = volume.locate(volume.x(u))
    assert found.failures == 0
    assert (found.status == 0).all()
    assert found.distance.max() < 1e-10
    np.testing.assert_allclose(found.u, u, atol=1e-6)


def test_failures_are_counted_and_named(monkeypatch):
    monkeypatch.setattr(module, "_ITERATIONS", 1)
    volume = ms.duck()
    x = volume.x(parameters(volume, 50))
    with pytest.warns(PrecisionWarning, match=r"failed for \d+ of 58 points, first rows"):
        u = volume.inverse(x)
    found = volume.locate(x)
    assert found.failures == np.isnan(u[:, 0]).sum() > 0
    assert (found.status == 2).sum() == found.failures


@pytest.mark.parametrize("name", ["duck", "torus", "torus exact", "perturbed rational"])
def test_every_point_is_in_the_box_of_its_cell(name):
    volume = ZOO[name]
    seeds = volume._seeds
    u = parameters(volume, 3000)
    row, cell = seeds.candidates(volume.x(u), 1e-12)
    own = ((seeds.first[cell] <= u[row]) & (u[row] <= seeds.last[cell])).all(axis=1)
    assert set(row[own]) == set(range(len(u)))
    spread = np.bincount(row)
    assert spread.mean() < 30  # of hundreds or thousands


def test_no_points_are_no_error():
    assert ms.duck().inverse(np.empty((0, 3))).shape == (0, 3)


@pytest.mark.parametrize("x", [[0.0, 0, 0], [[0.0, 0]], [[np.nan, 0, 0]], [["a", 0, 0]]])
def test_bad_points_are_refused(x):
    with pytest.raises(InputError, match="x"):
        ms.box().inverse(x)


@pytest.mark.parametrize("tol", [0, -1e-3, np.nan, "fine"])
def test_bad_tolerances_are_refused(tol):
    with pytest.raises(InputError, match="tol"):
        ms.box().inverse([[0.5, 0.5, 0.5]], tol=tol)
