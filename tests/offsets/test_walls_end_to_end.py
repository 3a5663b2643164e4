"""Walls end to end: exact cases, both boundary rules, seams, caching, orientation, doors."""

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import GeometryError, InputError, PrecisionWarning
from ilattice.mesh.wall_mesh import parameters_of


def plane(height=0.5):
    """The tile w - height, a linear spline."""
    return il.Tile(il.BSpline([[0, 0, 1, 1]] * 3, np.indices((2, 2, 2))[2] - height, 1))


@pytest.fixture(scope="module")
def torus():
    return il.Lattice("gyroid", through=il.macroshape.torus(), repeat=(12, 1, 1))


def test_distance_through_a_tapered_volume_is_exact():
    lattice = il.Lattice(plane(), through=il.macroshape.tapered(height=2.0))
    u = np.random.default_rng(0).random((200, 3))
    np.testing.assert_allclose(lattice.distance(u), 2 * u[:, 2] - 1, atol=1e-12)


def test_polished_vertices_are_on_the_exact_offset():
    lattice = il.Lattice("diamond", through=il.macroshape.box((1, 1, 1)))
    wall = lattice.offset(0.05)
    error = wall.thickness_error(wall.mesh(h=0.04))
    assert error.relative_max <= 5e-3
    assert error.relative <= 1e-5
    assert wall.thickness_error(wall.mesh(h=0.04, polish=False)).p99 > 100 * error.p99


def test_a_slab_has_the_volume_of_a_slab_on_one_or_both_sides():
    box = il.macroshape.box((2, 1, 1))
    lattice = il.Lattice(plane(), through=box)
    assert lattice.offset(0.1).mesh(h=0.05).volume == pytest.approx(0.4, rel=1e-7)
    assert lattice.offset(0.1).volume() == pytest.approx(0.4, rel=1e-7)
    one_sided = lattice.offset((0.0, 0.3)).mesh(h=0.05)
    assert one_sided.volume == pytest.approx(0.6, rel=1e-7)
    assert one_sided.bounds[:, 2] == pytest.approx([0.5, 0.8], abs=1e-7)


def test_thin_struts_have_their_volume_though_the_mesh_holds_less():
    """Four cylinders of radius 0.08, bent to a quarter of a ring: Pappus."""
    strut = il.Tile(lambda u: (u[:, 1] - 0.5) ** 2 + (u[:, 2] - 0.5) ** 2 - 0.06**2)
    ring = il.macroshape.cylinder_shell(2.0, 3.0, 1.0, angle=0.5 * np.pi)
    lattice = il.Lattice(strut, through=ring, repeat=(4, 1, 1), spans_per_tile=32)
    wall = lattice.offset((np.inf, 0.02))
    exact = np.pi * 0.08**2 * 2.5 * 0.5 * np.pi
    assert wall.volume() == pytest.approx(exact, rel=4e-4)
    with pytest.raises(GeometryError, match="% less than the wall"):
        wall.mesh(0.06)
    with pytest.warns(PrecisionWarning, match="% less than the wall"):
        assert wall.mesh(0.06, allow_loss=True).volume < 0.95 * exact


def test_clipped_distances_end_at_the_edges_of_the_surface():
    square = il.macroshape.box((1, 1, 1))
    i, _, k = np.indices((2, 2, 2))
    tile = il.Tile(il.BSpline([[0, 0, 1, 1]] * 3, i + k - 1.0, 1))  # the plane u + w = 1
    u = np.array([[0.5, 0.5, 0.6], [0.9, 0.5, 0.0], [1.0, 0.5, 0.3], [0.0, 0.5, 0.7]])
    clip = il.Lattice(tile, through=square, boundary="clip").distance(u)
    np.testing.assert_allclose(clip, (u[:, 0] + u[:, 2] - 1) / np.sqrt(2), atol=1e-9)
    sheared = il.macroshape.affine([[1, 0, 0], [0, 1, 0], [0.5, 0, 1]], [0, 0, 0])
    flat = il.Lattice(plane(), through=sheared, boundary="clip")  # x from 0 to 1, z = (1 + x) / 2
    corner = flat.closest([[0.0, 0.5, 1.0]])  # foot of the perpendicular would be at x = 0.2
    assert corner.distance[0] == pytest.approx(0.5 * np.cos(np.arctan(0.5)), abs=1e-9)
    end = flat.closest([[1.0, 0.5, 1.0]])  # the perpendicular from (1, 1.5) ends at x = 1.2
    assert end.distance[0] == pytest.approx(0.5, abs=1e-9)
    assert end.status[0] == 1
    extended = il.Lattice(plane(), through=sheared).closest([[1.0, 0.5, 1.0]])
    assert extended.distance[0] == pytest.approx(0.5 * np.cos(np.arctan(0.5)), abs=1e-9)


def test_a_clipped_surface_ends_at_the_faces():
    lattice = il.Lattice("schwarz_p", through=il.macroshape.box((1, 1, 1)), boundary="clip")
    u = np.array([[0.5, 0.5, 1.0], [0.0, 0.0, 0.0]])
    found = lattice.closest(u)
    assert (found.u >= -1e-12).all()
    assert (found.u <= 1 + 1e-12).all()
    extended = il.Lattice("schwarz_p", through=il.macroshape.box((1, 1, 1))).closest(u)
    assert (np.abs(extended.distance) <= np.abs(found.distance) + 1e-9).all()


def test_closed_directions_have_no_seam(torus):
    s = torus.offset(0.1).distance
    assert s.periodic == (True, False, False)
    v = np.random.default_rng(1).random((50, 2))
    ends = [np.column_stack([np.full(50, a), v]) for a in (0.0, 1.0 - 1e-9)]
    np.testing.assert_allclose(torus.distance(ends[0]), torus.distance(ends[1]), atol=1e-7)
    mesh = torus.offset(0.1).mesh(h=0.1)
    assert mesh.is_watertight
    assert mesh.components == 1


def test_another_thickness_makes_no_further_queries(torus):
    torus.offset(0.1)
    before = torus.statistics.queries
    torus.offset(lambda u: 0.05 + 0.02 * np.sin(2 * np.pi * u[:, 0]))
    torus.offset((0.02, 0.1))
    assert torus.statistics.queries == before
    assert torus.statistics.fallbacks == 0


def test_left_handed_maps_give_outward_meshes():
    box = il.macroshape.box((1, 1, 1)).flipped(2)
    assert box.orientation == -1
    mesh = il.Lattice("schwarz_p", through=box).offset(0.1).mesh(h=0.08)
    assert mesh.is_oriented
    assert mesh.volume > 0


def test_streamed_walls_equal_meshed_ones(tmp_path):
    wall = il.Lattice("gyroid", through=il.macroshape.box((1, 1, 1))).offset(0.08)
    wall.save(tmp_path / "wall.stl", h=0.06)
    trimesh = pytest.importorskip("trimesh")
    streamed = trimesh.load(tmp_path / "wall.stl")
    mesh = wall.mesh(h=0.06)
    assert streamed.volume == pytest.approx(mesh.volume, rel=1e-4)


def test_thickness_may_come_from_the_map():
    box = il.macroshape.box((1, 1, 1)).with_extra(d=lambda u: 0.04 + 0.04 * u[:, 0])
    wall = il.Lattice("gyroid", through=box).offset("d")
    mesh = wall.mesh(h=0.04)
    u, side = parameters_of(mesh)
    on = side != 0
    np.testing.assert_allclose(
        np.abs(wall.lattice.distance(u[on])), 0.04 + 0.04 * u[on, 0], atol=1e-4
    )


@pytest.mark.parametrize("d", [0.0, -0.1, 10.0, np.nan, (0.1, 0.1, 0.1), (0.0, 0.0), "depth", None])
def test_bad_thickness_is_refused_at_the_door(torus, d):
    with pytest.raises(InputError, match=r"\bd\b|d\["):
        torus.offset(d)


@pytest.mark.parametrize("dtype", [int, np.float16, complex, "foo"])
def test_vertices_are_float64_or_float32(torus, dtype):
    with pytest.raises(InputError, match="dtype must be float64 or float32"):
        torus.offset(0.1).mesh(dtype=dtype)


def test_a_thickness_that_is_not_finite_names_the_point(torus):
    with (
        np.errstate(divide="ignore"),
        pytest.raises(InputError, match=r"d must be finite, but is inf at \[0\.0, "),
    ):
        torus.offset(lambda u: 1 / u[:, 0])


def test_bad_lattices_are_refused_at_the_door():
    box = il.macroshape.box((1, 1, 1))
    with pytest.raises(InputError, match="gyroid"):
        il.Lattice("gyriod", through=box)
    with pytest.raises(InputError, match="repeat"):
        il.Lattice("gyroid", through=box, repeat=(1, 0, 1))
    with pytest.raises(InputError, match="boundary"):
        il.Lattice("gyroid", through=box, boundary="open")
    with pytest.raises(InputError, match="through"):
        il.Lattice("gyroid", through="box")
    folded = np.array(
        [
            [0, 0, 0],
            [1, 0, 0],
            [1, 1, 0],
            [0, 1, 0],
            [0, 0, 1],
            [1, 0, 1],
            [0.2, 0.2, 0.2],
            [0, 1, 1],
        ]
    )
    with pytest.raises(GeometryError):
        il.Lattice("gyroid", through=il.macroshape.hexahedron(folded))
