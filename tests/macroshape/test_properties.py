"""Properties of a lattice: those of the map go through the part, those of the tile repeat."""

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import InputError


def rings(p):
    """A periodic property on the tile."""
    return 0.05 + 0.02 * np.cos(2 * np.pi * p[:, 0]) * np.sin(2 * np.pi * p[:, 2])


@pytest.fixture(scope="module")
def lattice():
    box = il.macroshape.box((2, 1, 1)).with_extra(r=lambda u: u[:, 0], g=0.25, b=0.5)
    tile = il.tiles["primitive"].with_properties(t=rings, place=lambda p: p[:, 1])
    return il.Lattice(tile, through=box, repeat=(2, 1, 3))


def points(n=200):
    return np.random.default_rng(3).uniform(0.0, 1.0, (n, 3))


def test_properties_of_the_map_and_of_the_tile_are_found_by_name(lattice):
    assert lattice.property_names == ("r", "g", "b", "t", "place")
    u = points()
    np.testing.assert_allclose(lattice.property_at("r", u), u[:, 0], atol=1e-14)
    p = u * [2, 1, 3]
    np.testing.assert_allclose(lattice.property_at("t", u), rings(p), atol=1e-14)
    np.testing.assert_allclose(lattice.property_at("place", u), p[:, 1] % 1.0, atol=1e-14)


def test_the_last_face_belongs_to_the_last_tile(lattice):
    np.testing.assert_array_equal(lattice.property_at("place", [[1.0, 1.0, 1.0]]), [1.0])


def test_meshes_carry_all_properties(lattice):
    mesh = lattice.offset(0.05).mesh(0.06)
    u = np.stack([mesh.point_data[n] for n in "uvw"], axis=1)
    for name in lattice.property_names:
        np.testing.assert_array_equal(mesh.point_data[name], lattice.property_at(name, u))


def test_thickness_may_be_a_property_of_the_tile(lattice):
    wall = lattice.offset("t")
    u = points()
    np.testing.assert_allclose(wall.thickness.outer(u), lattice.property_at("t", u), atol=1e-6)
    np.testing.assert_allclose(
        wall.thickness.outer([[1.0, 1.0, 1.0]]),
        lattice.property_at("t", [[1.0, 1.0, 1.0]]),
        atol=1e-6,
    )
    error = wall.thickness_error(wall.mesh(0.03))
    assert error.relative < 1e-3


def test_thickness_of_the_tile_wraps_around_a_closed_map():
    torus = il.macroshape.torus(major=4.0, width=2.0)
    tile = il.tiles["primitive"].with_properties(t=rings)
    wall = il.Lattice(tile, through=torus, repeat=(12, 2, 2)).offset("t")
    assert wall.thickness.outer.periodic == (True, False, False)
    u = points()
    np.testing.assert_allclose(wall.thickness.outer(u), rings(u * [12, 2, 2]), atol=1e-6)


def test_thickness_that_jumps_from_tile_to_tile_is_refused(lattice):
    tile = lattice.tile.with_properties(step=lambda p: 0.02 + 0.05 * p[:, 2])
    steps = il.Lattice(tile, through=lattice.through, repeat=lattice.repeat)
    with pytest.raises(InputError, match=r"d jumps from 0\.07 to 0\.02"):
        steps.offset("step")


def test_unknown_properties_are_named(lattice):
    every = r"it has: r, g, b, t, place$"
    with pytest.raises(InputError, match=f"no property 'red'; {every}"):
        lattice.property_at("red", [[0.0, 0.0, 0.0]])
    with pytest.raises(InputError, match=f"no property of that name; {every}"):
        lattice.offset("plac")


def test_one_name_means_one_property():
    box = il.macroshape.box((1, 1, 1)).with_extra(t=0.1)
    with pytest.raises(InputError, match=r"\['t'\] are given by the tile and by the map"):
        il.Lattice(il.tiles["primitive"].with_properties(t=rings), through=box)


def test_properties_of_another_shape_are_refused():
    tile = il.tiles["primitive"].with_properties(wide=lambda p: p)
    with pytest.raises(InputError, match="one value per point"):
        il.Lattice(tile, through=il.macroshape.box((1, 1, 1))).property_at(
            "wide", [[0.1, 0.2, 0.3]]
        )
