"""Boundaries: arcs, parameters and crossings."""

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial import cKDTree

import ilattice as il
from ilattice.errors import GeometryError, InputError
from ilattice.shells import topologies as rooms


def test_arcs_are_hermite_splines_at_right_angles_to_edges():
    rng = np.random.default_rng(3)
    for t in rooms.table():
        p, d = rng.uniform(-0.2, 0.2, len(t.nodes)), rng.uniform(0.8, 1.4, (len(t.nodes), 2))
        if t.paper == "topo_18":
            p += 0.6
        b = il.shells.boundary(t, p, d)
        points = b.points(9)
        for s, line in zip(t.segments, points, strict=True):
            axis, side = divmod(s.face, 2)
            ends, slopes = [], []
            for sign, number in zip((1.0, -1.0), s.edges, strict=True):
                i = t.nodes.index(number)
                _, place = rooms.edge_place(number)
                inward = np.zeros(3)
                (other,) = (a for a in place if a != axis)
                inward[other] = 1.0 - 2.0 * place[other]
                column = sorted(place).index(axis)
                ends.append(b.nodes[i])
                slopes.append(sign * d[i, column] * inward)
            exact = CubicHermiteSpline([0.0, 1.0], ends, slopes)(np.linspace(0.0, 1.0, 9))
            assert np.abs(line - exact).max() < 1e-13
            assert (line[:, axis] == 2.0 * side - 1.0).all()
        loops = b.loops(17)
        assert [len(loop) for loop in loops] == [16 * len(loop) for loop in t.loops]
        for loop in loops:  # closed, in small steps
            assert np.linalg.norm(loop - np.roll(loop, -1, axis=0), axis=1).max() < 0.3


def test_positions_count_away_from_the_middle_and_the_corner_of_the_cell():
    t = il.shells.topology("topo_1")
    b = il.shells.boundary(t, (0.1, 0.2, 0.3))
    for i, number in enumerate(t.nodes):
        axis, _ = rooms.edge_place(number)
        assert b.nodes[i, axis] == (0.1, -0.2, 0.3)[rooms.home(number)]
    every = il.shells.boundary(t, b.positions)
    assert (every.nodes == b.nodes).all()


@pytest.mark.parametrize("name", ["topo_1", "topo_3", "topo_8", "topo_18", "topo_19"])
def test_orbits_give_boundaries_that_permuted_axes_keep(name):
    t = il.shells.topology(name)
    b = il.shells.boundary(t, np.linspace(0.3, 0.4, len(t.orbits)), 1.3)
    every = b.points(9).reshape(-1, 3)
    for axes in ([1, 2, 0], [1, 0, 2]):
        assert cKDTree(every).query(every[:, axes])[0].max() < 1e-12


@pytest.mark.parametrize(
    ("name", "position", "derivative", "word"),
    [
        ("c16", 0.0, 6.0, "two curves cross on face x\\+"),
        ("topo_19", 0.0, 20.0, "leaves the face on face x-|crosses itself on face x-"),
        ("topo_1", 0.0, 4.0, "two curves cross on face x-"),
    ],
)
def test_crossings_name_their_face(name, position, derivative, word):
    with pytest.raises(GeometryError, match=word):
        il.shells.boundary(name, position, derivative)


def test_only_the_face_that_is_wrong_is_named():
    t = il.shells.topology("topo_1")
    d = np.full((12, 2), 1.2)
    for s in t.segments:
        if rooms.FACES[s.face] == "y+":
            for number in s.edges:
                _, ends = rooms.edge_place(number)
                d[t.nodes.index(number), sorted(ends).index(1)] = 7.0
    with pytest.raises(GeometryError, match=r"on face y\+"):
        il.shells.boundary(t, 0.0, d)


@pytest.mark.parametrize(
    "bad",
    [
        {"position": 1.0}, {"position": -1.2}, {"position": np.nan}, {"position": (0.1, 0.2)},
        {"derivative": -1.0}, {"derivative": 0.0}, {"derivative": 1e9}, {"derivative": [[1.0]] * 7},
        {"position": "0.1"}, {"derivative": None},
    ],
)  # fmt: skip
def test_bad_parameters(bad):
    with pytest.raises(InputError, match=next(iter(bad))):
        il.shells.boundary("topo_19", **bad)


def test_congruent_faces():
    straight = il.shells.boundary("topo_6", 0.0, 1.2)
    assert [straight.congruent(a) for a in range(3)] == [1, -1, -1]
    assert [il.shells.boundary("topo_1").congruent(a) for a in range(3)] == [-1, -1, -1]
    assert [il.shells.boundary("topo_19").congruent(a) for a in range(3)] == [0, 0, 0]
    t = il.shells.topology("topo_1")
    shifted = np.zeros(12)  # equal coordinates, by their signs, of the edges along x
    shifted[:4] = 0.1 * np.where([rooms.home(e) == 1 for e in t.nodes[:4]], -1.0, 1.0)
    assert [il.shells.boundary(t, shifted).congruent(a) for a in range(3)] == [-1, -1, -1]
    shifted[0] += 1e-3
    assert [il.shells.boundary(t, shifted).congruent(a) for a in range(3)] == [-1, 0, 0]


def test_wrong_numbers_of_points_and_axes_are_told():
    curves = il.shells.boundary("topo_19", 0.1, 1.5)
    for wrong in (-1, 1, 2.5, "x", None):
        with pytest.raises(InputError, match="count must be a whole number"):
            curves.points(wrong)
        with pytest.raises(InputError, match="count must be a whole number"):
            curves.loops(wrong)
    for wrong in (-1, 3, 1.5, "x", None):
        with pytest.raises(InputError, match="axis must be"):
            curves.congruent(wrong)
