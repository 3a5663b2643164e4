"""True distances to any field against exact ones, and against lattices."""

import numpy as np
import pytest
from conformance import check_range

import ilattice as il
from ilattice.errors import GeometryError, InputError
from ilattice.offsets.distance import bind, distance

F = il.fields
P = np.random.default_rng(1).uniform(-1.2, 1.2, (400, 3))
BALL = F.equation("x^2 + y^2 + z^2 - 0.49")
ROOM = [[-1.0] * 3, [1.0] * 3]


def test_the_distance_of_a_ball_from_its_equation():
    f = distance(BALL, box=ROOM, seeds=24)
    exact = np.linalg.norm(P, axis=1) - 0.7
    np.testing.assert_allclose(f(P), exact, atol=1e-9)
    value, gradient = f.jet(P, 1)
    np.testing.assert_allclose(gradient, P / np.linalg.norm(P, axis=1)[:, None], atol=1e-6)
    np.testing.assert_array_equal(value, f(P))
    check_range(f, np.random.default_rng(2), np.array([[-1.2] * 3, [1.2] * 3]), converges=False)


def test_edges_are_found():
    """``max`` of a stretched cube is no distance outside of its edges and corners."""
    half = np.array([1.0, 0.7, 0.5])
    gap = distance(F.scale(F.box(), half), seeds=32)(P) - F.box(half)(P)
    at_corners = (np.abs(P) > half).all(axis=1)
    np.testing.assert_allclose(gap[~at_corners], 0.0, atol=1e-9)
    assert gap[at_corners].min() > -1e-12
    assert gap[at_corners].max() < 0.1 * 2 / 32


def test_distances_of_a_tile_are_those_of_a_lattice():
    f = distance(F.scale(F.from_callable(il.tiles["primitive"]), 0.8))
    lattice = il.Lattice("primitive", through=il.macroshape.box(2.4), repeat=(3, 3, 3))
    u = np.random.default_rng(3).uniform(0.35, 0.65, (300, 3))
    np.testing.assert_allclose(f(2.4 * u), lattice.distance(u), atol=1e-9)


def test_a_field_without_end_needs_a_box():
    wave = F.equation("sin(3*x) + z")
    with pytest.raises(InputError, match="box"):
        distance(wave)(P)
    whole = il.sdf.parse("'sin(3*x) + z' distance shell 0.2 box")
    np.testing.assert_allclose(whole([[0.0, 0.0, 0.0]]), -0.1, atol=1e-9)
    other = distance(wave)
    bind(other, np.array(ROOM))
    far = distance(wave, box=[[-2.0] * 3, [2.0] * 3])
    q = 0.8 * P
    np.testing.assert_allclose(other(q), far(q), atol=1e-7)


def test_beyond_the_band_nothing_is_computed():
    f = distance(BALL, box=ROOM, band=0.1, seeds=24)
    exact = np.linalg.norm(P, axis=1) - 0.7
    np.testing.assert_allclose(f(P), np.clip(exact, -0.1, 0.1), atol=1e-9)


@pytest.mark.parametrize(("name", "t"), [("gyroid", 0.1), ("iwp", 0.1), ("neovius", 0.05)])
def test_walls_of_the_language_are_as_thick_as_asked(name, t):
    found = il.mesh.contour(il.sdf.parse(f"{name} distance shell {t}"), [np.linspace(0, 1, 49)] * 3)
    x = np.asarray(found.vertices, float)
    wall = x[((x > 0.02) & (x < 0.98)).all(axis=1)]
    lattice = il.Lattice(name, through=il.macroshape.box(), repeat=(1, 1, 1))
    gap = np.abs(lattice.distance(wall))
    assert np.percentile(np.abs(2 * gap - t), 99) <= 0.005 * t


def test_boxes_hold_the_grown_solid():
    f = distance(F.scale(F.box(), (1.0, 0.7, 0.5)))
    np.testing.assert_allclose(f.bounding_box(0.2), [[-1.2, -0.9, -0.7], [1.2, 0.9, 0.7]])


@pytest.mark.parametrize(
    "make",
    [
        lambda: distance(3),
        lambda: distance(BALL, band=0.0),
        lambda: distance(BALL, seeds=2),
        lambda: distance(BALL, box=[0, 1]),
        lambda: distance(BALL, box=[[1.0] * 3, [0.0] * 3]),
    ],
)
def test_bad_input_is_refused(make):
    with pytest.raises(InputError):
        make()


def test_no_surface_is_an_error():
    with pytest.raises(GeometryError, match="no surface"):
        distance(F.equation("x^2 + 1"), box=ROOM)(P)
