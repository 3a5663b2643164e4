"""Tiles of minimal surfaces: their zero sets and walls against exact points."""

import exact_schwarz as exact
import numpy as np
import pytest

import ilattice as il
from ilattice.errors import GeometryError, InputError, PrecisionWarning
from ilattice.minimal.disc import Disc, vertex_normals

M = il.minimal
D = 0.05


@pytest.fixture(scope="module")
def tile():
    patch = M.conjugate(M.cuboid().faces("X+ z- Y+ x- Z+ y-"), 24)
    return patch.completed().tile(name="P", spans=24)


def exact_points(count=400):
    """Points of Schwarz P within the octant, away from its faces, with normals."""
    r, a = np.random.default_rng(1).random((2, count))
    s = 0.7 * np.sqrt(r) * np.exp(2j * np.pi * a)
    x, n = exact.placed(s), exact.normal(s)
    inside = ((x > 0.0) & (x < 0.5)).all(axis=1)
    return x[inside], n[inside]


def test_the_wall_of_the_tile_is_that_of_weierstrass(tile):
    """Both sides are where exact points, moved along exact normals, say; in parts of d."""
    x, n = exact_points()
    lattice = il.Lattice(tile, through=il.macroshape.cell(), repeat=1)
    for side in (-1.0, 1.0):
        found = np.abs(lattice.distance(np.mod(x + side * D * n, 1.0)))
        assert np.abs(found - D).max() < 1e-3 * D
    assert tile.periodic == (True, True, True)


def off_wall(tile, count=400):
    """How far walls of a tile are off those of exact points, in parts of d."""
    x, n = exact_points(count)
    lattice = il.Lattice(tile, through=il.macroshape.cell(), repeat=1)
    sides = [np.abs(lattice.distance(np.mod(x + t * n, 1.0))) for t in (-D, D)]
    return np.abs(np.concatenate(sides) / D - 1.0).max()


def test_walls_of_sixteen_edges_are_within_a_third_of_a_thousandth():
    patch = M.conjugate(M.cuboid().faces("X+ z- Y+ x- Z+ y-"), 16)
    assert off_wall(patch.completed().tile()) < 3e-4
    assert off_wall(il.graph.library["schwarz_p"].tile()) < 3e-4


def test_sharpened_vertices_are_of_higher_order_and_tell_the_error():
    found = {}
    for n in (7, 8, 16):
        patch = M.conjugate(M.cuboid().faces("X+ z- Y+ x- Z+ y-"), n)
        sharp, off = patch.sharpened
        found[n] = exact.distances(sharp.vertices).max()
        fine = M.conjugate(M.cuboid().faces("X+ z- Y+ x- Z+ y-"), n + n % 2)
        assert off == pytest.approx(exact.distances(fine.vertices).max(), rel=0.1)
        assert np.abs(sharp.vertices[sharp.disc.side_rows[0], 0] - 0.5).max() < 1e-15
    assert found[7] == found[8]
    assert np.log2(found[8] / found[16]) > 3.0
    petrie = np.array([(1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1), (1, 0, 1)]) / 4
    twin, finer = (M.direct(petrie, n).associate(0.7) for n in (8, 32))
    sharp = twin.sharpened[0]
    rows = finer.disc.nested[Disc(6, 16).nested]
    normals = vertex_normals(finer.vertices, finer.disc.faces)[rows]
    away = [p.vertices - finer.vertices[rows] for p in (twin, sharp)]
    errors = [np.abs(np.einsum("vc,vc->v", a, normals)).max() for a in away]
    assert errors[1] < 0.3 * errors[0]


def test_triangles_that_are_too_large_for_a_tile_are_told():
    size = np.array([0.845, 0.244, 0.515])
    patch = M.conjugate(M.cuboid(size).faces("X+ z- Y+ x- Z+ y-"), 8)
    fine = M.conjugate(M.cuboid(size).faces("X+ z- Y+ x- Z+ y-"), 32)
    rows = fine.disc.nested[Disc(6, 16).nested]
    normals = vertex_normals(patch.vertices, patch.disc.faces)
    true = np.einsum("vc,vc->v", fine.vertices[rows] - patch.vertices, normals)
    assert patch.sharpened[1] == pytest.approx(np.abs(true).max(), rel=0.4)
    with pytest.warns(PrecisionWarning, match="more edges per side"):
        patch.completed().tile()
    few = M.conjugate(M.cuboid().faces("X+ z- Y+ x- Z+ y-"), 3).completed()
    with pytest.warns(PrecisionWarning) as told:
        few.tile()
    assert "by an unknown part" in str(told[0].message)


def test_the_tile_tells_both_sides_apart(tile):
    x, n = exact_points()
    sides = [tile(np.mod(x + t * n, 1.0)) for t in (-D, D)]
    assert (np.sign(sides[0]) == -np.sign(sides[1])).all()
    assert len({*np.sign(sides[0])}) == 1
    u = np.random.default_rng(0).random((200_000, 3))
    assert (tile(u) < 0.0).mean() == pytest.approx(0.5, abs=0.005)


def test_a_wall_of_the_tile_through_a_torus_is_watertight(tile):
    torus = il.macroshape.torus(major=4.0, width=2.0)
    mesh = il.Lattice(tile, through=torus, repeat=(6, 1, 1)).offset(0.2).mesh(0.22)
    assert mesh.is_watertight
    assert mesh.is_oriented
    assert mesh.components == 1


def test_what_does_not_separate_is_no_tile():
    flat = M.direct(np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]) / 2, 2)
    mirrors = [M.reflection(np.eye(3)[k], h) for k in (0, 1) for h in (0.0, 0.5)]
    sheet = flat.completed(M.generated(mirrors, 1.0))
    assert (sheet.euler, sheet.is_orientable, sheet.separates) == (0, True, False)
    with pytest.raises(GeometryError, match="one side always first"):
        sheet.tile()
    with pytest.raises(GeometryError, match="open edges"):
        flat.completed(M.generated([], 1.0)).tile()


BAD = {
    "neighbours": lambda: M.cuboid().faces("x+ x- y+ z-"),
    "closing": lambda: M.prism().faces("x=1/2 y=0 x=y z=0"),
    "flat": lambda: M.cuboid().faces("x+ y+ x- y-"),
    "unknown": lambda: M.cuboid().faces("x+ q- y+ x-"),
    "n": lambda: M.conjugate(M.tetrahedron().faces("z=0 x=1/2 y=z x=y"), 1),
    "size": lambda: M.conjugate(M.tetrahedron().faces("z=0 x=1/2 y=z x=y"), 10_000),
    "loop": lambda: M.conjugate("x+ y+", 4),
    "nan": lambda: M.direct([[0, 0, 0], [1, 0, 0], [0, np.nan, 0]], 4),
    "open": lambda: M.direct(
        [[[0, 0, 0], [1, 0, 0]], [[1, 1, 0], [0, 1, 0]], [[0, 1, 0], [0, 0, 0]]]
    ),
    "off": lambda: M.mixed(M.cuboid(), np.eye(3), ["x-", None, None], 4),
    "copies": lambda: M.tetrahedron(96),
    "unbounded": lambda: M.Region(-np.eye(3)[[0, 1, 2, 2]], np.zeros(4), 1.0),
    "empty": lambda: M.Region(np.vstack([np.eye(3), -np.eye(3)]), -np.ones(6), 1.0),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_refused_at_the_door(name):
    with pytest.raises(InputError, match=r"must|number|there are"):
        BAD[name]()


def test_faces_that_generate_no_lattice_are_refused():
    normals = np.vstack([-np.eye(3), [1.0, 0.3, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    region = M.Region(normals, [0, 0, 0, 0.5, 0.5, 0.5], 1.0)
    with pytest.raises(GeometryError, match="repeat"):
        _ = region.group


def test_sliding_sides_do_not_leave_the_region():
    """Behind an obtuse angle, where a side would have to slide on a third face."""
    cuts = [[0.77, 0.56, 0.3], [-0.65, -0.67, 0.36]]
    far = [0.9, 0.9, 0.9, -0.1, -0.1, -0.1, 1.22, -0.05]
    region = M.Region([*np.eye(3), *-np.eye(3), *cuts], far, 1.0)
    corners = [[0.54, 0.1, 0.34], [0.1, 0.1, 0.19], [0.1, 0.59, 0.64], [0.26, 0.5, 0.52]]
    with pytest.raises(GeometryError, match=r"leaves the region by .* name that face"):
        M.mixed(region, corners, ["y-", "x-", None, None], 8)
