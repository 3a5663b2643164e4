"""Parametric offsets: exact for planes, of second order otherwise, and honest about it."""

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import InputError

RADIUS = 0.3
STEPS = np.array([0.02, 0.04, 0.08])


def slope(errors):
    """Fitted order of errors at STEPS."""
    return np.polyfit(np.log(STEPS), np.log(errors), 1)[0]


@pytest.fixture(scope="module")
def ball():
    """Ball of radius 0.3 in units of a tile, in a box that is 2 long per tile."""
    tile = il.Tile(lambda u: 5.0 * (((u - 0.5) ** 2).sum(axis=1) - RADIUS**2), name="ball")
    return il.Lattice(tile, through=il.macroshape.box(2.0))


@pytest.fixture(scope="module")
def gyroid():
    return il.Lattice("gyroid", through=il.macroshape.box(1.0))


def test_planes_are_exact():
    tile = il.Tile(lambda u: 3.0 * (u[:, 2] - 0.5), name="plane")
    lattice = il.Lattice(tile, through=il.macroshape.tapered(), repeat=(1, 1, 1))
    wall = lattice.offset(lambda u: 0.1 + 0.05 * u[:, 0], space="parametric")
    mesh = wall.mesh(0.07)
    u = np.stack([mesh.point_data[n] for n in "uvw"], axis=1)
    on = mesh.point_data["side"] != 0
    np.testing.assert_allclose(np.abs(u[on, 2] - 0.5), 0.1 + 0.05 * u[on, 0], atol=1e-6)
    assert wall.thickness_error(mesh).max < 1e-6


def test_spheres_have_the_error_that_theory_says(ball):
    """The offset of r² - R² by d is at r = d + sqrt(R² + d²) outside."""
    errors = []
    for d in STEPS:
        wall = ball.offset((np.inf, d), space="parametric")
        mesh = wall.mesh(0.08)
        r = np.linalg.norm(mesh.vertices / 2.0 - 0.5, axis=1)
        np.testing.assert_allclose(r, d + np.sqrt(RADIUS**2 + d**2), rtol=1e-5)
        errors.append(wall.thickness_error(mesh).max)
        assert errors[-1] == pytest.approx(np.sqrt(RADIUS**2 + d**2) - RADIUS, rel=1e-2)
    assert slope(errors) == pytest.approx(2.0, abs=0.1)


def test_walls_of_first_order_have_a_name_of_their_own(ball):
    wall = il.lattice.parametric_offset(ball, (np.inf, 0.04))
    r = 2.0 * (0.04 + np.sqrt(RADIUS**2 + 0.04**2))
    assert wall.mesh(0.08).volume == pytest.approx(4 / 3 * np.pi * r**3, rel=0.01)
    with pytest.raises(InputError, match="lattice must be a Lattice"):
        il.lattice.parametric_offset(ball.through, 0.04)


@pytest.mark.parametrize(("name", "order"), [("iwp", 2.0), ("gyroid", 3.0)])
def test_the_error_is_of_second_order_at_least(name, order):
    """Of third where the second derivative along the normal vanishes, as on the gyroid."""
    lattice = il.Lattice(name, through=il.macroshape.box(1.0))
    walls = [lattice.offset(d, space="parametric") for d in STEPS]
    errors = [w.thickness_error(w.mesh(0.02)).rms for w in walls]
    assert slope(errors) == pytest.approx(order, abs=0.3)
    assert errors[1] < 0.1 * STEPS[1]


def test_gyroid_walls_of_a_twentieth_are_off_by_a_thirtieth(gyroid):
    """First-order walls of d = 0.05 reach 0.96 to 0.97 of it."""
    wall = gyroid.offset(0.05, space="parametric")
    error = wall.thickness_error(wall.mesh(0.03))
    assert 0.03 < error.rms / 0.05 < 0.042


def test_the_map_changes_the_thickness():
    torus = il.macroshape.torus(major=4.0, width=2.0)
    lattice = il.Lattice("primitive", through=torus, repeat=(8, 1, 1))
    mesh = lattice.offset(0.05, space="parametric").mesh(0.1)
    assert mesh.is_watertight
    u = np.stack([mesh.point_data[n] for n in "uvw"], axis=1)[mesh.point_data["side"] != 0]
    thickness = np.abs(lattice.distance(u))
    assert thickness.max() > 1.2 * thickness.min()
    assert thickness.min() > 0.05


def test_solids_grow_to_first_order(ball):
    mesh = ball.offset((np.inf, 0.1), space="parametric").mesh(0.08)
    r = np.linalg.norm(mesh.vertices / 2.0 - 0.5, axis=1)
    np.testing.assert_allclose(r, 0.1 + np.sqrt(RADIUS**2 + 0.01), rtol=1e-5)
    assert mesh.genus == 0


@pytest.mark.filterwarnings("ignore:the mesh with h=")  # coarse
def test_thin_tiles_need_no_finer_mesh():
    """Every tile has eight cells along every edge; in a flat box a wide h is no reason to warn."""
    tile = il.Tile(lambda u: ((u - 0.5) ** 2).sum(axis=1) - 0.09, name="ball")
    flat = il.Lattice(tile, through=il.macroshape.box((1, 1, 0.02)))
    wall = flat.offset((np.inf, 0.05), space="parametric")
    assert wall.distance is flat.offset((np.inf, 0.1), space="parametric").distance
    mesh = wall.mesh(0.03)
    assert mesh.genus == 0
    r = 0.05 + np.sqrt(0.09 + 0.05**2)
    assert mesh.volume == pytest.approx(0.02 * 4 / 3 * np.pi * r**3, rel=0.1)


def test_polishing_does_not_make_it_exact(ball):
    wall = ball.offset((0.0, 0.08), space="parametric")
    assert wall.thickness_error(wall.mesh(0.08, polish=True)).max > 0.01
    np.testing.assert_array_equal(wall.mesh(0.08).vertices, wall.mesh(0.08, polish=False).vertices)


def test_unusable_spaces_and_thicknesses(ball):
    with pytest.raises(InputError, match="space must be one of"):
        ball.offset(0.1, space="level")
    with pytest.raises(InputError, match="positive"):
        ball.offset(-0.1, space="parametric")
    with pytest.raises(InputError, match="half the part"):
        ball.offset(0.9, space="parametric")
