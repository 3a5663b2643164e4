"""Solids: all of the inner side of a tile, grown or eroded."""

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import GeometryError, InputError

RADIUS = 0.3


def ball(u):
    """Distance to a sphere in the middle of the tile."""
    return np.linalg.norm(u - 0.5, axis=1) - RADIUS


@pytest.fixture(scope="module")
def lattice():
    tile = il.Tile(lambda u: ((u - 0.5) ** 2).sum(axis=1) - RADIUS**2, name="ball")
    return il.Lattice(tile, through=il.macroshape.box((1, 1, 1)))


@pytest.mark.parametrize("grown", [0.1, 0.0, -0.1])
def test_a_ball_grows_and_shrinks_by_the_asked_distance(lattice, grown):
    wall = lattice.offset((np.inf, grown))
    mesh = wall.mesh(0.03)
    assert mesh.is_watertight
    assert mesh.genus == 0
    assert mesh.components == 1
    distance = np.linalg.norm(mesh.vertices - 0.5, axis=1)
    np.testing.assert_allclose(distance, RADIUS + grown, rtol=1e-6)
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * (RADIUS + grown) ** 3, rel=0.02)
    np.testing.assert_array_equal(mesh.point_data["side"], 1)


def test_the_growth_may_vary_and_change_sign(lattice):
    wall = lattice.offset((np.inf, lambda u: 0.1 * (u[:, 0] - 0.5)))
    mesh = wall.mesh(0.04)
    asked = 0.1 * (mesh.vertices[:, 0] - 0.5)
    np.testing.assert_allclose(ball(mesh.vertices), asked, atol=1e-6)
    assert wall.thickness_error(mesh).max < 1e-6


def test_varying_positive_growth(lattice):
    mesh = lattice.offset((np.inf, lambda u: 0.05 + 0.05 * u[:, 2])).mesh(0.04)
    np.testing.assert_allclose(ball(mesh.vertices), 0.05 + 0.05 * mesh.vertices[:, 2], atol=1e-6)


def test_the_default_mesh_width_follows_the_volume_by_the_area_of_the_solid(lattice):
    wall = lattice.offset((np.inf, 0.0))
    assert wall.least_thickness == pytest.approx(2 / 3 * RADIUS, rel=0.05)  # 2 V / A of a ball
    mesh = wall.mesh()
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=0.02)


def test_solids_run_into_the_faces_with_caps():
    cross = il.Tile(lambda u: (u[:, 1] - 0.5) ** 2 + (u[:, 2] - 0.5) ** 2 - 0.04, name="rod")
    lattice = il.Lattice(cross, through=il.macroshape.box((2, 1, 1)), repeat=(2, 1, 1))
    mesh = lattice.offset((np.inf, 0.05)).mesh(0.03)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(2 * np.pi * 0.25**2, rel=5e-3)


def test_an_eroded_solid_may_vanish(lattice):
    with pytest.raises(GeometryError, match=r"eroded by 0\.35"):
        lattice.offset((np.inf, -0.35)).mesh(0.05)


def test_the_outer_side_cannot_be_filled(lattice):
    with pytest.raises(InputError, match=r"d\[1\] must be finite"):
        lattice.offset((0.1, np.inf))


def test_errors_of_one_sided_walls_are_relative_to_their_thickness(lattice):
    wall = lattice.offset((0.0, 0.1))
    error = wall.thickness_error()
    assert error.relative_max == pytest.approx(error.max / 0.1, rel=1e-9)
    wall = lattice.offset((np.inf, 0.0))
    solid = wall.thickness_error()
    assert solid.relative_max == pytest.approx(solid.max / wall.least_thickness, rel=1e-9)


def test_a_growth_that_is_barely_negative_between_samples_is_meshed():
    slab = il.Tile(lambda u: u[:, 2] - 0.5, name="slab")
    lattice = il.Lattice(slab, through=il.macroshape.box(), spans_per_tile=4)
    parabola = np.array([0.16, -0.24, 0.36])[:, None, None]  # (u - 0.4)²
    growth = il.BSpline([[0, 0, 0, 1, 1, 1], [0, 1], [0, 1]], parabola - 1e-7, (2, 0, 0))
    mesh = lattice.offset((np.inf, growth)).mesh(0.1)
    assert mesh.volume == pytest.approx(0.5 + 0.16 - 0.4 + 1 / 3, abs=2e-3)
