"""Walls thinner than the edges of their meshes, and what meshes lose."""

import re

import numpy as np
import pytest
from scipy.optimize import brentq

import ilattice as il
from ilattice.errors import GeometryError, PrecisionWarning
from ilattice.mesh import _tracer, wall_mesh
from ilattice.mesh.contouring import contour_blocks
from ilattice.mesh.coverage import merged_part
from ilattice.mesh.loss import Extent
from ilattice.offsets.local_thickness import depths_of

box = il.macroshape.box


def sound(mesh, parts=1):
    assert mesh.is_watertight
    assert mesh.is_oriented
    assert mesh.nonmanifold_edges == 0
    assert mesh.nonmanifold_vertices == 0
    assert mesh.self_intersections == 0
    assert mesh.components == parts


def off_faces(mesh, volume):
    """Largest distance of vertices with side 0 from the faces of a box."""
    x = mesh.vertices[mesh.point_data["side"] == 0]
    lo, hi = volume.bounds
    return np.minimum(np.abs(x - lo), np.abs(x - hi)).min(axis=1).max(initial=0.0)


def affine(a):
    """Map u -> a u of the unit cube."""
    corners = np.stack(np.meshgrid(*[[0.0, 1.0]] * 3, indexing="ij"), axis=-1)
    return il.SplineMap(il.BSpline([[0.0, 0.0, 1.0, 1.0]] * 3, corners @ a.T, 1))


@pytest.mark.parametrize("seed", range(4))
def test_walls_of_schwarz_p_far_thinner_than_the_mesh_are_whole(seed):
    rng = np.random.default_rng(seed)
    scale = 10.0 ** rng.uniform(-6, 6)
    lo = rng.normal(size=3) * scale
    volume = box(lo=lo, hi=lo + scale * rng.uniform(0.8, 1.3, 3))
    d = scale * 10.0 ** rng.uniform(-4, -2.3)
    wall = il.Lattice("primitive", through=volume).offset(d)
    h = scale * rng.uniform(0.025, 0.045)
    assert h > 3 * d
    mesh = wall.mesh(h)
    sound(mesh)
    assert mesh.volume == pytest.approx(wall.volume(), rel=0.01)
    distance = np.abs(wall.lattice.distance(np.stack([mesh.point_data[k] for k in "uvw"], axis=1)))
    off = np.abs(distance / d - 1.0)[mesh.point_data["side"] != 0]
    assert np.percentile(off, 99) < 1e-3
    assert mesh.point_data["unconverged"].mean() < 1e-3
    assert off_faces(mesh, volume) < 1e-9 * scale
    assert wall.thickness_error(mesh).missing == 0.0


def test_the_volume_of_a_thin_wall_is_area_times_thickness():
    d, lattice = 2e-3, il.Lattice("primitive", through=box())
    mesh = lattice.offset(d).mesh(0.02)
    area = lattice.offset((np.inf, 0.0)).mesh(0.02)
    on_surface = (area.point_data["side"] != 0)[area.faces].all(axis=1)
    a, b, c = (area.vertices[area.faces[on_surface, i]] for i in range(3))
    size = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    # triangles with all corners on the surface; those that lie in faces of the box are few
    assert mesh.volume == pytest.approx(2 * d * size, rel=0.02)


@pytest.mark.parametrize("seed", range(6))
def test_slabs_in_sheared_boxes_are_exact(seed):
    rng = np.random.default_rng(10 + seed)
    a = np.eye(3) + rng.uniform(-0.3, 0.3, (3, 3))
    place = rng.uniform(0.4, 0.6)
    inner, outer = rng.uniform(0.001, 0.004, 2) * np.array([seed % 2, 1.0])
    tile = il.Tile(lambda u: np.sin(2.0 * (u[:, 0] - place)), name="slab")
    lattice = il.Lattice(tile, through=affine(a), spans_per_tile=8)
    mesh = lattice.offset((inner, outer)).mesh(rng.uniform(0.04, 0.08))
    sound(mesh)
    n = np.cross(a[:, 1], a[:, 2])  # faces of the domain cut a parallelepiped out of the slab
    assert mesh.volume == pytest.approx((inner + outer) * np.linalg.norm(n), rel=1e-6)
    n *= np.sign(n @ a[:, 0]) / np.linalg.norm(n)
    side = mesh.point_data["side"]
    assert (side != 0).all()
    asked = np.where(side > 0, outer, -inner)
    np.testing.assert_allclose(
        (mesh.vertices - place * a[:, 0]) @ n, asked, atol=2e-6
    )  # the spline of the tile
    u = np.linalg.solve(a, mesh.vertices.T)[1:]
    assert u.min() > -1e-12
    assert u.max() < 1 + 1e-12


@pytest.mark.parametrize(
    ("tile", "through", "repeat", "d", "h"),
    [
        ("gyroid", box((2, 1, 1)), (2, 1, 1), 0.0031, 0.06),
        ("gyroid", box((2, 1, 1)), (2, 1, 1), (0.0, 0.013), 0.06),
        ("iwp", il.macroshape.torus(), (6, 1, 1), 0.011, 0.2),
        ("diamond", il.macroshape.cylinder_shell(), (4, 1, 1), 0.0042, 0.07),
    ],
)
@pytest.mark.filterwarnings("ignore:the mesh with h")  # of long edges
def test_thin_walls_in_other_shapes(tile, through, repeat, d, h):
    wall = il.Lattice(tile, through=through, repeat=repeat).offset(d)
    mesh = wall.mesh(h)
    sound(mesh)
    assert mesh.volume == pytest.approx(wall.volume(), rel=0.05)
    assert mesh.point_data["unconverged"].mean() <= 1e-3
    report = wall.thickness_error(mesh)
    assert report.relative < 1e-3
    assert report.missing < 5e-3  # tips in corners of the domain


def test_thickness_may_vary_and_the_domain_may_end_the_surface():
    lattice = il.Lattice("gyroid", through=box((2, 1, 1)), repeat=(2, 1, 1), boundary="clip")
    wall = lattice.offset(lambda u: 0.002 + 0.006 * u[:, 0])
    mesh = wall.mesh(0.05)
    sound(mesh)
    assert mesh.volume == pytest.approx(wall.volume(), rel=0.03)
    assert wall.thickness_error(mesh).relative < 1e-3


@pytest.mark.parametrize("seed", range(3))
def test_walls_that_have_merged_are_not_meshed_from_their_mid_surface(seed, monkeypatch):
    """Two planes a gap apart: the sides of the wall that face each other are half of all."""
    rng = np.random.default_rng(20 + seed)
    a = np.eye(3) + rng.uniform(-0.2, 0.2, (3, 3))
    half = rng.uniform(0.05, 0.1)
    tile = il.Tile(lambda u: (u[:, 0] - 0.5) ** 2 - half**2, name="planes")
    lattice = il.Lattice(tile, through=affine(a), spans_per_tile=24)
    gap = 2.0 * half / np.linalg.norm(np.linalg.inv(a)[0])
    assert merged_part(lattice.offset(0.5 * gap)) == 0.0
    inner = lattice.offset((0.0, 3.0 * gap)), lattice.offset((1.2 * gap, 0.0))
    assert [merged_part(w) for w in inner] == [0.0, pytest.approx(1.0, abs=0.1)]
    wall = lattice.offset(rng.uniform(0.8, 1.4) * gap)
    assert merged_part(wall) == pytest.approx(0.5, abs=0.1)  # but for rims
    monkeypatch.setattr(wall_mesh, "Sheets", lambda *_, **__: pytest.fail("began"))
    for h in (0.7, 1.0):
        job = wall_mesh._Job.of(wall, h * wall.least_thickness, True, None)
        assert job.thin
        assert wall_mesh._of_sheets(job, True) is None


def test_open_sheets_and_streams(tmp_path):
    wall = il.Lattice("primitive", through=box()).offset(0.002)
    assert wall.mesh(0.05, caps=False).open_edges > 0
    wall.save(tmp_path / "a.ply", 0.05)
    mesh = il.mesh.load(tmp_path / "a.ply")
    assert mesh.components == 1
    assert mesh.volume == pytest.approx(wall.volume(), rel=0.02)
    assert wall.topology(0.05, necks=0.0).parts[0].volume == pytest.approx(mesh.volume, rel=1e-6)


@pytest.mark.filterwarnings("ignore:.*vertices could not be moved")
def test_a_mesh_that_has_lost_much_is_refused_unless_that_is_allowed():
    wall = il.Lattice("octet", through=box()).offset((np.inf, 0.0))
    with pytest.raises(GeometryError, match=r"% less than the wall .* use h <= .* allow_loss=True"):
        wall.mesh(0.15)
    with pytest.warns(PrecisionWarning, match="less than the wall"):
        mesh = wall.mesh(0.15, allow_loss=True)
    assert mesh.volume < 0.95 * wall.volume()


@pytest.mark.parametrize(("tile", "d", "h"), [("c_y", 0.113, 0.085), ("q_star", 0.152, 0.13)])
def test_a_mesh_that_has_gained_much_is_refused_unless_that_is_allowed(tile, d, h, tmp_path):
    """Chords cut through narrow pores, with edges shorter than half of the wall is thick."""
    lattice = il.Lattice(tile, through=box((0.97, 1.02, 1.01)))
    wall = lattice.offset(lambda u: d * (0.9 + 0.1 * u[:, 0]))
    assert h < 0.52 * wall.least_thickness
    with pytest.raises(GeometryError, match=r"% more than the wall .* use h <= .* allow_loss=True"):
        wall.mesh(h)
    with pytest.warns(PrecisionWarning, match=r"% more than the wall") as told:
        mesh = wall.mesh(h, allow_loss=True)
    u = np.random.default_rng(7).random((40_000, 3))
    inside = np.abs(lattice.distance(u)) < d * (0.9 + 0.1 * u[:, 0])
    gained = 100 * (mesh.volume / (inside.mean() * np.prod((0.97, 1.02, 1.01))) - 1)
    number = next(float(m.group(1)) for w in told if (m := re.search(r"([\d.]+) % more", str(w))))
    assert number == pytest.approx(gained, abs=1.0)
    with pytest.raises(GeometryError, match=r"% more than the wall .* use h <= .* allow_loss=True"):
        wall.save(tmp_path / "pieces.ply", h)
    assert list(tmp_path.iterdir()) == []
    with pytest.warns(PrecisionWarning, match=r"% more than the wall"):
        wall.save(tmp_path / "pieces.ply", h, allow_loss=True)
    assert il.mesh.load(tmp_path / "pieces.ply").volume == pytest.approx(mesh.volume, rel=5e-3)


@pytest.mark.parametrize("wrap", [False, True])
def test_pieces_have_the_volume_and_the_longest_edge_of_the_whole(wrap, monkeypatch):
    monkeypatch.setattr(_tracer, "SLAB", 4)
    axes = [np.linspace(0.0, 2.0, 90), np.linspace(0.0, 0.9, 30), np.linspace(-0.4, 0.7, 40)]

    def f(u):
        return np.cos(np.pi * u[:, 0]) + np.sin(7 * u[:, 1]) * np.cos(5 * u[:, 2]) - 0.1

    pieces = list(contour_blocks(f, axes, wrap=(wrap, False, False)))
    assert len(pieces) > 2
    extent = Extent()
    for piece in pieces:
        extent.add(piece.vertices, piece.faces)
    vertices = np.concatenate([p.vertices for p in pieces]) - pieces[0].vertices[0]
    a, b, c = vertices[np.concatenate([p.faces for p in pieces])].transpose(1, 0, 2)
    volume = (a * np.cross(b, c)).sum() / 6.0
    edges = np.linalg.norm(np.concatenate([a - b, b - c, c - a]), axis=1)
    assert extent.longest == pytest.approx(edges.max(), rel=1e-12)
    assert extent.volume == pytest.approx(volume, rel=1e-9)


def test_volumes_are_compared_with_those_of_exact_distances():
    """Where the distance spline rounds off what it should not, the mesh is not to blame."""
    lattice = il.Lattice("primitive", through=box((1.03, 0.97, 1.01)), spans_per_tile=4)
    wall = lattice.offset((np.inf, -0.2))
    u = np.random.default_rng(8).random((100_000, 3))
    inside = (lattice.distance(u) < -0.2).mean() * 1.03 * 0.97 * 1.01
    with pytest.warns(PrecisionWarning, match=r"exact distances give .* more"):
        assert abs(wall.volume() / inside - 1.0) > 0.2
    with pytest.warns(PrecisionWarning, match=r"% less than the wall .* and spans_per_tile > 4"):
        mesh = wall.mesh(0.04)
    assert mesh.volume == pytest.approx(inside, rel=0.05)


def test_what_a_mesh_lacks_is_measured():
    wall = il.Lattice("primitive", through=box()).offset(0.003)
    mesh = wall.mesh(0.03)
    assert wall.thickness_error(mesh).missing == 0.0
    part = mesh.select(mesh.vertices[mesh.faces].mean(axis=1)[:, 0] < 0.7)
    assert 0.2 < wall.thickness_error(part).missing < 0.4


def test_plates_whose_field_levels_off_are_found():
    off, half, n = 0.513, 0.023, 96
    knots = np.concatenate([[0.0, 0.0], np.linspace(0.0, 1.0, n - 1), [1.0, 1.0]])
    middle = 0.5 * (knots[1 : n + 1] + knots[2 : n + 2])
    c = np.clip((np.abs(middle - off) - half) / half, -0.9, 0.6)  # flat two cells away
    line = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]
    field = il.BSpline([knots, line, line], np.tile(c[:, None, None], (1, 3, 3)), 2)

    def root(a, b):
        return brentq(lambda x: float(field([[x, 0.5, 0.5]])[0]), a, b, xtol=1e-14)

    low, high = root(off - 2 * half, off), root(off, off + 2 * half)
    lattice = il.Lattice(il.Tile(field, name="plate"), through=box())
    u = np.random.default_rng(3).random((2000, 3))
    faces = np.array([low - 1, high - 1, low, high, low + 1, high + 1])
    exact = np.abs(u[:, :1] - faces).min(axis=1)
    np.testing.assert_allclose(np.abs(lattice.distance(u)), exact, atol=1e-9)
    _, depth, _ = depths_of(lattice, 3.0 * half)
    np.testing.assert_allclose(depth, 0.5 * (high - low), rtol=0.02)


def test_default_meshes_of_grown_and_eroded_solids_keep_their_volume():
    for tile, grown in (("gyroid", -0.031), ("sc_struts", -0.013)):
        wall = il.Lattice(tile, through=box()).offset((np.inf, grown))
        mesh = wall.mesh()
        sound(mesh)
        assert mesh.volume == pytest.approx(wall.volume(), rel=0.03)


def test_bends_that_edges_cut_off_are_told_of_though_the_volume_is_right():
    wall = il.Lattice("y", through=il.macroshape.box((1, 0.7, 1))).offset(0.1)
    with pytest.warns(PrecisionWarning, match=r"is far from [\d.]+ % of the surfaces of the wall"):
        mesh = wall.mesh(0.03)
    assert mesh.volume == pytest.approx(wall.volume(), rel=0.005)
    assert 0.2 < wall.thickness_error(mesh).missing < 0.4
    neovius = il.Lattice("neovius", through=il.macroshape.box((1, 0.7, 1))).offset(0.05)
    assert neovius.thickness_error(neovius.mesh()).missing < 0.01  # and without a warning


def test_narrow_pores_that_default_edges_cut_off_are_told_of():
    wall = il.Lattice("diamond", through=il.macroshape.box((1, 1, 1))).offset(0.15)
    with pytest.warns(PrecisionWarning, match=r"is far from [\d.]+ % of the surfaces of the wall"):
        mesh = wall.mesh()
    assert wall.thickness_error(mesh).missing > 0.05
