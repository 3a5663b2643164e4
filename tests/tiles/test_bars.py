"""Straight bars, joined sharply, are homogenized as they are, and not as a spline of them."""

import numpy as np
import pytest
from scipy.stats import qmc

import ilattice as il
from ilattice.errors import PrecisionWarning
from ilattice.homogenize.arguments import as_cell
from ilattice.tiles.bars import solid_of_bars

ONE = np.array([[0.0] * 3, [1.0] * 3])


def cross(radius, **options):
    nodes = [(0.5, 0.5, 0.5), *(np.insert([0.5, 0.5], a, e) for a in range(3) for e in (0, 1))]
    return il.tiles.struts(nodes, [(0, i) for i in range(1, 7)], radius, **options)


@pytest.mark.parametrize("radius", [0.1, 0.2])
def test_volume_of_three_cylinders(radius):
    """3 pi r^2 - 8 sqrt(2) r^3: a spline, which rounds off the edges, has five times the error."""
    exact = 3 * np.pi * radius**2 - 8 * np.sqrt(2) * radius**3
    solid = as_cell(cross(radius), 8)
    assert solid.volume(q=4).integrate() == pytest.approx(exact, rel=3e-5)


@pytest.mark.parametrize("seed", range(4))
def test_random_bars_in_sheared_cells(seed):
    """The same signs as the field of the tile everywhere, also in lattices of several tiles."""
    rng = np.random.default_rng(seed)
    cell = np.eye(3) + 0.3 * rng.standard_normal((3, 3))
    nodes = rng.random((4, 3)) @ cell.T
    tile = il.tiles.struts(nodes, [(0, 1), (1, 2), (2, 3)], rng.uniform(0.05, 0.15, 3), cell=cell)
    tile = tile.with_level(0.02 * rng.standard_normal())
    repeat, box = (1, 2, 3), np.array([[0.2, -1.0, 0.0], [1.2, 1.0, 0.5]])
    solid = solid_of_bars(tile, repeat, box)
    u = qmc.Sobol(3, seed=seed).random(1 << 15)
    values = solid(box[0] + u * np.ptp(box, axis=0))
    exact = tile(u * repeat % 1.0)
    assert ((values < 0) == (exact < 0)).all()
    inside = exact < 0  # outside, bars beyond the box may be nearer
    assert inside.sum() > 300
    np.testing.assert_allclose(values[inside], exact[inside], atol=1e-12)


def test_what_is_no_straight_bar_of_one_radius_is_left():
    nodes, edge = [(0.2, 0.3, 0.4), (0.7, 0.6, 0.5)], [(0, 1)]
    assert solid_of_bars(il.tiles.struts(nodes, edge, 0.1), (1, 1, 1), ONE) is not None
    assert solid_of_bars(il.tiles.struts(nodes, edge, [0.1, 0.2]), (1, 1, 1), ONE) is None
    assert solid_of_bars(cross(0.1, blend=0.05), (1, 1, 1), ONE) is None
    for name in ("gyroid", "sc_plates", "ten_arms"):
        assert solid_of_bars(il.tiles[name], (1, 1, 1), ONE) is None


def test_bars_on_faces_count_once():
    corners = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    edges = [(i, j) for i in range(8) for j in range(i) if bin(i ^ j).count("1") == 1]
    axes = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    once = il.tiles.struts(axes, [(0, i) for i in (1, 2, 3)], 0.1)
    every = il.tiles.struts(corners, edges, 0.1)
    a, b = (as_cell(tile, 6).volume().integrate() for tile in (once, every))
    assert a == pytest.approx(b, rel=1e-6)
    assert a == pytest.approx(3 * np.pi * 0.01 - 8 * np.sqrt(2) * 0.001, rel=3e-5)


def same_signs(solid, tile, repeat, seed):
    """Signs of a solid in the unit cube and of the field of each tile, off the faces of tiles."""
    u = 1e-6 + (1.0 - 2e-6) * qmc.Sobol(3, seed=seed).random(1 << 15)
    p = u * repeat
    u = u[np.abs(p - np.rint(p)).min(axis=1) > 1e-6]
    inside = tile(u * repeat % 1.0) < 0
    assert inside.sum() > 100
    return ((solid(u) < 0) == inside).all()


@pytest.mark.parametrize("faces", ["open", "closed"])
@pytest.mark.parametrize("repeat", [(1, 1, 1), (1, 2, 1), (2, 2, 3)])
def test_bars_that_do_not_repeat_are_those_of_their_tiles(faces, repeat):
    """Tiles cut each other's."""
    cell = np.array([[1.0, 0.2, 0.0], [0.0, 1.1, 0.1], [0.1, 0.0, 0.9]])
    nodes = np.random.default_rng(1).random((4, 3)) @ cell.T
    tile = il.tiles.struts(nodes, [(0, 1), (1, 2), (2, 3)], 0.15, faces=faces, cell=cell)
    assert same_signs(solid_of_bars(tile, repeat, ONE, 1000), tile, repeat, 1)


def test_bars_on_a_line_are_one():
    """Halves of diagonals, and their copies, become the 28 lines that come into the cell."""
    nodes = [(0.5, 0.5, 0.5), *((x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1))]
    tile = il.tiles.struts(nodes, [(0, i) for i in range(1, 9)], 0.1)
    assert len(solid_of_bars(tile, (1, 1, 1), ONE).part.part.parts) == 4 + 4 * 6


@pytest.mark.parametrize("faces", ["open", "closed", {"x": "open", "y": "closed", "z": "periodic"}])
@pytest.mark.parametrize("repeat", [(1, 1, 1), (2, 2, 2)])
def test_bars_that_end_on_faces_are_those_of_the_tiles(faces, repeat):
    """An open face continues them obliquely, as far as the next tile."""
    rng = np.random.default_rng(4)
    for axis in range(3):
        nodes = 0.15 + 0.7 * rng.random((4, 3))
        nodes[[0, 3], axis] = 0.0, 1.0
        tile = il.tiles.struts(nodes, [(0, 1), (1, 2), (2, 3)], 0.12, faces=faces)
        assert same_signs(solid_of_bars(tile, repeat, ONE, 1000), tile, repeat, axis)


R, DEEP = 0.06, 0.03  # radius, and distance of a bar beside a face from it
SLANT, HALF_WIDE = np.sqrt(1.32), np.sqrt(R**2 - DEEP**2)
SECTION = 1.2 * R + np.pi * R**2  # along the axis of a bar of length 0.6
#: Nodes, edges, terms of the union, and the area of two tiles.
OPEN = {
    "straight": ([(0, 0.4, 0.3), (1, 0.4, 0.3)], [(0, 1)], 1, 4 * np.pi * R + 2 * np.pi * R**2),
    "bent at the face": (
        [(0, 0.5, 0.3), (0.5, 0.5, 0.7), (1, 0.5, 0.3)], [(0, 1), (1, 2)], 5, None,
    ),
    "ending at the face": (
        [(0, 0.4, 0.3), (1, 0.8, 0.7)], [(0, 1)], 2, 4 * np.pi * (R + R**2) * SLANT,
    ),
    "beside the face": (
        [(DEEP, 0.5, 0.2), (DEEP, 0.5, 0.8)], [(0, 1)], 2,
        2 * (1.2 * (R * (np.pi - np.arccos(DEEP / R)) + HALF_WIDE)
             + 2 * np.pi * R * (R + DEEP) + np.pi * HALF_WIDE**2),
    ),
    "on the face": (
        [(0, 0, 0.2), (0, 0, 0.8), (1, 0, 0.2), (1, 0, 0.8)], [(0, 1), (2, 3)], 3,
        1.2 * np.pi * R + 4 * np.pi * R**2 + 3 * SECTION,
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", OPEN)
def test_where_bars_meet_at_a_face_there_is_no_surface(case):
    """The area of two tiles, cut by cells that do not end at the face: no formula, a fine mesh."""
    nodes, edges, terms, area = OPEN[case]
    tile = il.tiles.struts(nodes, edges, R, faces="open")
    assert same_signs(solid_of_bars(tile, (2, 1, 1), ONE), tile, (2, 1, 1), 0)
    parts = solid_of_bars(tile, (2, 1, 1), ONE).part.part
    assert len(getattr(parts, "parts", [parts])) == terms
    through = il.macroshape.box((2, 1, 1))
    wall = il.Lattice(tile, through=through, repeat=(2, 1, 1)).offset((np.inf, 0))
    kinds = ("surface", *(f"{a}={i}" for a in "uvw" for i in (0, 1)))
    found = sum(il.cutfem.quadrature(wall, (31, 15, 15), kind=k).integrate() for k in kinds)
    assert found == pytest.approx(wall.mesh(0.01).area if area is None else area, rel=6e-3)


@pytest.mark.parametrize("repeat", [(1, 1, 1), (2, 2, 1), (1, 2, 2)])
@pytest.mark.parametrize("radius", [0.004, 0.01, 0.05])
def test_volumes_and_ends_of_open_bars(radius, repeat):
    """A spline of two tiles of radius 0.004 held 0.6 of the volume; one tile was told to be empty.

    All is what it is of cylinders that planes cut: pi r² L.
    """
    way = np.array([0.35, 0.41, 1.0])
    tile = il.tiles.struts([(0.22, 0.31, 0), (0.57, 0.72, 1)], [(0, 1)], radius, faces="open")
    shear = np.array([[1.3, 0.2, 0.1], [0.0, 0.9, 0.3], [0.1, 0.0, 1.1]])
    for matrix in (np.eye(3), shear):
        corners = np.indices((2, 2, 2)).reshape(3, -1).T * repeat @ matrix.T
        through = il.macroshape.hexahedron(corners.reshape(2, 2, 2, 3))
        wall = il.Lattice(tile, through=through, repeat=repeat).offset((np.inf, 0))
        exact = np.prod(repeat) * np.pi * radius**2 * np.linalg.norm(way) * np.linalg.det(matrix)
        assert wall.volume() == pytest.approx(exact, rel=2e-5)
        assert wall.volume_error < 2e-5 * exact
        assert wall.relative_density() == pytest.approx(exact / through.volume(), rel=2e-5)
    box = il.macroshape.box(np.array(repeat, float))
    wall = il.Lattice(tile, through=box, repeat=repeat).offset((np.inf, 0))
    end = il.cutfem.quadrature(wall, [8 * n for n in repeat], kind="w=0").integrate()
    each = np.pi * radius**2 * np.linalg.norm(way)
    assert end == pytest.approx(repeat[0] * repeat[1] * each, rel=5e-3)
    if repeat[2] == 1:  # vertices at ends within the lattice are off, as is told
        with pytest.warns(PrecisionWarning, match=r"3(\.\d)? % less than the wall"):
            mesh = wall.mesh(radius / 2)
        assert mesh.volume == pytest.approx(wall.volume(), rel=0.04)


def test_bars_that_meet_at_edges_and_corners_of_open_tiles():
    """Halves of diagonals are the same as those of periodic tiles, which are one on each line."""
    nodes = [(0.5, 0.5, 0.5), *((x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1))]
    edges, repeat = [(0, i) for i in range(1, 9)], (2, 2, 1)
    through = il.macroshape.box(np.array(repeat, float))
    found = []
    for faces in ("periodic", "open"):
        tile = il.tiles.struts(nodes, edges, 0.1, faces=faces)
        assert same_signs(solid_of_bars(tile, repeat, ONE), tile, repeat, 2)
        found.append(il.Lattice(tile, through=through, repeat=repeat).offset((np.inf, 0)).volume())
    assert found[0] == pytest.approx(found[1], rel=2e-5)
