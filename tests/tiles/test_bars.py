"""Straight bars, joined sharply, are homogenized as they are, and not as a spline of them."""

import numpy as np
import pytest
from scipy.stats import qmc

import ilattice as il
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


@pytest.mark.parametrize("faces", ["open", "closed"])
def test_bars_that_do_not_repeat_are_those_of_one_tile(faces):
    """The same signs as the field of the tile, and no bars of tiles that cut each other's."""
    cell = np.array([[1.0, 0.2, 0.0], [0.0, 1.1, 0.1], [0.1, 0.0, 0.9]])
    nodes = np.random.default_rng(1).random((4, 3)) @ cell.T
    tile = il.tiles.struts(nodes, [(0, 1), (1, 2), (2, 3)], 0.15, faces=faces, cell=cell)
    u = 0.001 + 0.998 * qmc.Sobol(3, seed=1).random(1 << 14)
    inside = solid_of_bars(tile, (1, 1, 1), ONE)(u) < 0
    assert (inside == (tile(u) < 0)).all()
    assert inside.sum() > 300
    assert solid_of_bars(tile, (1, 2, 1), ONE) is None


def test_bars_on_a_line_are_one():
    """Halves of diagonals, and their copies, become the 28 lines that come into the cell."""
    nodes = [(0.5, 0.5, 0.5), *((x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1))]
    tile = il.tiles.struts(nodes, [(0, i) for i in range(1, 9)], 0.1)
    assert len(solid_of_bars(tile, (1, 1, 1), ONE).part.part.parts) == 4 + 4 * 6


@pytest.mark.parametrize("faces", ["open", "closed", {"x": "open", "y": "closed", "z": "periodic"}])
def test_bars_that_end_on_faces_are_those_of_the_tile_or_none(faces):
    """An open face continues them obliquely: up to three parts in a thousand of the cell."""
    rng = np.random.default_rng(4)
    u = rng.random((1 << 12, 3))
    for axis in range(3):
        nodes = 0.15 + 0.7 * rng.random((4, 3))
        nodes[[0, 3], axis] = 0.0, 1.0
        tile = il.tiles.struts(nodes, [(0, 1), (1, 2), (2, 3)], 0.12, faces=faces)
        bars = solid_of_bars(tile, (1, 1, 1), ONE)
        if bars is not None:
            assert axis == 2
            assert ((bars(u) < 0) == (tile(u) < 0)).all()
        assert (bars is None) == (faces in ("open", "closed") or axis < 2)
