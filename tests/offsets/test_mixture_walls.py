"""Walls of lattices of different tiles: thickness, closedness, seams, both boundary rules."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

import ilattice as il
from ilattice.errors import InputError
from ilattice.tiles.mixture import MixedField


@pytest.fixture(scope="module")
def bar():
    """A gyroid that turns into a diamond along a bar."""
    mixture = il.tiles.hybrid("gyroid", "diamond", weight=il.tiles.sigmoid(0, 0.5, 0.4))
    return il.Lattice(mixture, through=il.macroshape.box((3, 1, 1)), repeat=(3, 1, 1))


@pytest.fixture(scope="module")
def torus():
    mixture = il.tiles.mix("gyroid", "diamond", cells=lambda *ijk: (ijk[0] // 2) % 2)
    return il.Lattice(mixture, through=il.macroshape.torus(1.5, 0.8), repeat=(8, 1, 1))


@pytest.mark.parametrize("name", ["bar", "torus"])
def test_walls_are_closed_and_as_thick_as_asked(name, request):
    wall = request.getfixturevalue(name).offset(0.06)
    mesh = wall.mesh(h=0.05)
    assert mesh.is_watertight
    assert mesh.is_oriented
    assert wall.thickness_error(mesh).relative <= 1e-6  # of d, at 99 of 100 vertices


def test_feet_are_nearer_than_any_point_of_the_surface(bar):
    u = np.random.default_rng(0).random((500, 3))
    found = bar.closest(u)
    assert (found.status == 0).all()
    inside = ((found.u >= 0) & (found.u <= 1)).all(axis=1)
    assert inside.sum() > 300
    assert np.abs(bar.implicit(found.u[inside])).max() <= 1e-6
    cloud = bar.offset(0.02).mesh(h=0.02).vertices
    near = cKDTree(cloud).query(bar.through.x(u))[0]  # the surface lies within 0.02 of these
    assert (np.abs(found.distance) <= near + 0.02 + 1e-9).all()
    assert (np.abs(found.distance) >= near - 0.02 - 0.02)[inside].all()


@pytest.fixture(scope="module")
def side_by_side():
    """Random tiles that share faces, so that their surfaces meet in creases."""
    mixture = il.tiles.mix("gyroid", "diamond", "schwarz_p", seed=1, blend=0)
    return il.Lattice(mixture, through=il.macroshape.box((2, 2, 1)), repeat=(2, 2, 1))


def test_feet_on_creases_are_found(side_by_side):
    """Surfaces of neighbours are pieces with edges; the nearest point may be on an edge."""
    lattice = side_by_side
    assert lattice.smooth_tile.creased
    rng = np.random.default_rng(6)
    u = rng.random((4000, 3))
    u[2000:, 0] = 0.5 + 0.02 * rng.normal(size=2000)  # next to a face
    found = lattice.closest(u)
    assert (found.status < 2).all()
    on_face = np.abs(found.u[:, :2] - 0.5).min(axis=1) < 1e-9
    assert (found.status[on_face] == 1).mean() > 0.9
    assert on_face.sum() > 20
    tree = cKDTree(lattice.search.seeds.images)
    beyond = np.abs(found.distance) - tree.query(lattice.through.x(u))[0]
    assert beyond.max() <= 1e-7  # no seed is nearer than the foot


def test_walls_of_tiles_that_share_faces_are_closed_and_as_thick_as_asked(side_by_side):
    wall = side_by_side.offset(0.06)
    mesh = wall.mesh(h=0.05)
    assert mesh.is_watertight
    assert mesh.is_oriented
    assert wall.thickness_error(mesh).relative <= 1e-6
    assert side_by_side.statistics.fallbacks == 0


def test_distances_to_a_roof_are_those_to_its_two_planes():
    """Zero sets of cos(z - s x) and its mirror image are planes that meet in ridges, valleys."""
    rise = 0.3

    def tile(slope):
        return il.Tile(lambda p: np.cos(2 * np.pi * (p[:, 2] - slope * p[:, 0] + min(slope, 0.0))))

    mixture = il.tiles.mix(tile(rise), tile(-rise), cells=[[[0]], [[1]]], blend=0, tol=1e-5)
    lattice = il.Lattice(mixture, through=il.macroshape.box((2, 1, 1)), repeat=(2, 1, 1))
    u = np.random.default_rng(8).uniform([0.3, 0.0, 0.0], [0.7, 1.0, 1.0], (2000, 3))
    x, _, z = lattice.through.x(u).T
    exact = np.full(len(u), np.inf)
    for eaves in (-0.75, -0.25, 0.25, 0.75):
        for a, b in (((0.0, eaves), (1.0, eaves + rise)), ((1.0, eaves + rise), (2.0, eaves))):
            exact = np.minimum(exact, to_segment(np.column_stack([x, z]), np.array(a), np.array(b)))
    np.testing.assert_allclose(np.abs(lattice.distance(u)), exact, atol=2e-5)
    assert (lattice.closest(u).status == 1).sum() > 50


def to_segment(p, a, b):
    t = np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    return np.linalg.norm(p - a - t[:, None] * (b - a), axis=1)


def test_blended_tiles_have_no_creases(bar, torus):
    assert not bar.smooth_tile.creased
    assert not torus.smooth_tile.creased


def test_a_mixture_of_one_tile_is_that_tile():
    box = il.macroshape.box((2, 1, 1))
    mixed = il.tiles.mix("gyroid", cells=np.zeros((2, 1, 1), int), tol=1e-4)
    u = np.random.default_rng(1).random((400, 3))
    both = [
        il.Lattice(tile, through=box, repeat=(2, 1, 1)).distance(u) for tile in (mixed, "gyroid")
    ]
    off = np.abs(both[0] - both[1])
    assert 1e-9 < off.max() <= 2e-4


def test_different_tiles_keep_their_own_distances(torus):
    pure = {
        n: il.Lattice(n, through=torus.through, repeat=torus.repeat) for n in ("gyroid", "diamond")
    }
    u = np.random.default_rng(2).random((400, 3)) * [0.125, 1, 1] + [0.0625, 0, 0]
    for shift, name in ((0.0, "gyroid"), (0.25, "diamond")):
        at = u + np.array([shift, 0, 0])
        off = np.abs(torus.distance(at) - pure[name].distance(at))
        # all but the few whose foot is in the zone of transition; both tiles differ by far more
        assert np.percentile(off, 70) <= 3e-3
        other = pure["diamond" if name == "gyroid" else "gyroid"].distance(at)
        assert np.percentile(np.abs(torus.distance(at) - other), 70) > 0.02


def test_a_closed_direction_has_no_seam(torus):
    v = np.random.default_rng(3).random((60, 2))
    ends = [np.column_stack([np.full(60, a), v]) for a in (0.0, 1.0 - 1e-10)]
    np.testing.assert_allclose(torus.distance(ends[0]), torus.distance(ends[1]), atol=1e-8)
    np.testing.assert_allclose(torus.implicit(ends[0]), torus.implicit(ends[1]), atol=1e-8)


def test_clipped_distances_stay_in_the_domain(bar):
    clip = il.Lattice(bar.tile, through=bar.through, repeat=bar.repeat, boundary="clip")
    u = np.random.default_rng(4).random((200, 3))
    found = clip.closest(u)
    assert ((found.u >= -1e-12) & (found.u <= 1 + 1e-12)).all()
    gain = np.abs(found.distance) - np.abs(bar.distance(u))
    assert gain.min() >= -1e-9
    assert gain.max() > 1e-3


@pytest.mark.parametrize("name", ["trigonometric", "spline", "mixed"])
def test_derivatives_of_the_implicit_function_are_with_respect_to_parameters(name, bar):
    if name == "mixed":
        lattice = bar
    else:
        tile = il.tiles["gyroid"] if name == "trigonometric" else il.tiles["gyroid"].fit(tol=1e-3)
        lattice = il.Lattice(tile, through=bar.through, repeat=(3, 2, 1))
    assert isinstance(lattice.smooth_tile, MixedField) == (name == "mixed")
    u = np.random.default_rng(5).uniform(0.01, 0.99, (60, 3))
    f, g, hess = lattice.implicit_jet(u)
    np.testing.assert_allclose(f, lattice.implicit(u), atol=1e-14)
    h = 1e-5
    for a in range(3):
        step = h * np.eye(3)[a]
        up, down = lattice.implicit_jet(u + step, 1), lattice.implicit_jet(u - step, 1)
        np.testing.assert_allclose((up[0] - down[0]) / (2 * h), g[:, a], atol=1e-5 * abs(g).max())
        slope = (up[1] - down[1]) / (2 * h)
        np.testing.assert_allclose(slope, hess[:, a], atol=1e-3 * abs(hess).max())


def test_the_upper_end_of_the_domain_belongs_to_the_last_tile():
    corners = np.indices((2, 2, 2))[0] - 0.25
    lattice = il.Lattice(
        il.Tile(il.BSpline([[0, 0, 1, 1]] * 3, corners, 1)),
        through=il.macroshape.box((3, 1, 1)),
        repeat=(3, 1, 1),
    )
    ends = lattice.implicit([[1.0, 0.5, 0.5], [1.0 - 1e-13, 1, 1], [1 / 3, 0.5, 0.5]])
    np.testing.assert_allclose(ends, [0.75, 0.75, -0.25], atol=1e-9)


def test_a_lattice_refuses_cells_of_another_shape():
    mixture = il.tiles.mix("gyroid", "diamond", cells=np.zeros((2, 2, 1), int))
    lattice = il.Lattice(mixture, through=il.macroshape.box(), repeat=(2, 1, 2))
    with pytest.raises(InputError, match=r"cells must have one entry per tile, shape \(2, 1, 2\)"):
        lattice.offset(0.05)


def test_properties_are_weighed_as_the_fields_are():
    tiles = [
        il.tiles[name].with_properties(stiffness=lambda p, e=e: e + p[:, 2])
        for name, e in (("gyroid", 1.0), ("diamond", 3.0))
    ]
    box = il.macroshape.box((2, 1, 1))
    u = np.array([[0.1, 0.5, 0.25], [0.5, 0.5, 0.25], [0.9, 0.5, 0.25]])
    for blend in (0.5, 0.0):
        mixture = il.tiles.mix(*tiles, cells=[[[0]], [[1]]], blend=blend)
        lattice = il.Lattice(mixture, through=box, repeat=(2, 1, 1))
        assert lattice.property_names == ("stiffness",)
        np.testing.assert_allclose(lattice.property_at("stiffness", u), [1.25, 2.25, 3.25])
    hybrid = il.tiles.hybrid(*tiles, weight=lambda u: u[:, 0])
    lattice = il.Lattice(hybrid, through=box, repeat=(2, 1, 1))
    np.testing.assert_allclose(lattice.property_at("stiffness", u), [1.45, 2.25, 3.05])
    thick = [
        t.with_properties(d=lambda p, d=d: np.full(len(p), d))
        for t, d in zip(tiles, (0.04, 0.06), strict=True)
    ]
    wall = il.Lattice(
        il.tiles.hybrid(*thick, weight=lambda u: u[:, 0]), through=box, repeat=(2, 1, 1)
    ).offset("d")
    np.testing.assert_allclose(wall.thickness.outer(u), [0.042, 0.05, 0.058], atol=1e-6)


def test_properties_that_only_some_tiles_have_are_not_those_of_the_mixture():
    painted = il.tiles["gyroid"].with_properties(red=lambda p: p[:, 0])
    mixture = il.tiles.mix(painted, "diamond", seed=0)
    assert dict(mixture.properties) == {}
    lattice = il.Lattice(mixture, through=il.macroshape.box(), repeat=(2, 1, 1))
    with pytest.raises(InputError, match="no property 'red'"):
        lattice.property_at("red", [[0.5, 0.5, 0.5]])
