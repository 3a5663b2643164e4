"""Families: equal outer boundaries, cells that vary, and lattices of them."""

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import InputError


@pytest.fixture(scope="module")
def family():
    return il.shells.family("topo_1_rrr", outer=(0.2, 1.5), n=16, spans=32, layer=0.03)


def test_cells_share_the_outer_boundary_to_the_bit(family):
    a, b = family(-0.2), family(0.2)
    u = np.random.default_rng(0).random((300, 3))
    assert np.abs(a(u) - b(u)).max() > 0.01
    for axis in range(3):
        for end in (0.0, 1.0):
            u[:, axis] = end
            ja, jb = a.jet(u, 1), b.jet(u, 1)
            assert all(np.abs(p - q).max() < 1e-12 for p, q in zip(ja, jb, strict=True))
            assert np.abs(ja[1][:, axis]).max() < 1e-12
        ends = [np.moveaxis(t.field.c, axis, 0)[[0, 1, -2, -1]] for t in (a, b)]
        assert (ends[0] == ends[1]).all()
    outer = [family.shell(p).surface.boundary for p in (-0.2, 0.2)]
    for s, p, q in zip(family.topology.segments, *(o.points() for o in outer), strict=True):
        assert (np.abs(p - q).max() < 1e-12) == (s.face % 2 == 1)


def test_zero_sets_are_those_of_the_shells(family):
    for p in (-0.2, 0.2):
        v = family.shell(p).periodic.mesh.vertices
        assert np.abs(family(p)(np.mod(v, 1.0))).max() < 5e-3
        u = np.random.default_rng(1).random((100, 3))
        other = u[:, [1, 2, 0]]
        assert np.abs(family(p)(u) - family(p)(other)).max() < 2e-3  # cubic symmetry


def test_graded_lattices_are_watertight_with_continuous_normals(family):
    count = 20
    graded = family.graded(lambda cell: np.round(-0.2 + 0.4 * cell[:, 0] / (count - 1), 1))
    beam = il.macroshape.box((count, 1, 1))
    lattice = il.Lattice(graded, through=beam, repeat=(count, 1, 1))
    spline_field = lattice.smooth_tile
    assert not spline_field.creased
    q = np.random.default_rng(2).random((2000, 3))
    for x in np.arange(1.0, count):
        q[:, 0] = x
        before = q.copy()
        before[:, 0] = np.nextafter(x, 0.0)
        near = np.abs(spline_field(q)) < 0.02
        normals = []
        for p in (before, q):
            g = spline_field.jet(p[near], 1)[1]
            normals.append(g / np.linalg.norm(g, axis=1, keepdims=True))
        assert near.any()
        assert np.abs(normals[0] - normals[1]).max() < 1e-6
    short = il.Lattice(
        family.graded([[[-0.2]], [[0.2]]]), through=il.macroshape.box((2, 1, 1)), repeat=(2, 1, 1)
    )
    mesh = short.offset(0.05).mesh(h=0.05)
    assert mesh.is_watertight
    assert mesh.is_oriented


def test_without_nodes_inside_it_is_the_derivative_that_varies():
    family = il.shells.family("topo_19_rrr", outer=(0.1, 1.5), n=12, spans=24)
    assert family.inner == ("derivative",)
    a, b = family.shell(1.2).surface.boundary, family.shell(1.8).surface.boundary
    for s, p, q in zip(family.topology.segments, a.points(), b.points(), strict=True):
        assert (np.abs(p - q).max() < 1e-12) == (s.face % 2 == 1)
    with pytest.raises(InputError, match="parameters of topo_19_rrr must be derivative"):
        family(0.1, 1.5)


def test_bad_arguments(family):
    for bad in ("topo_1_rtr", "topo_99_rrr", 3):
        with pytest.raises(InputError, match="name"):
            il.shells.family(bad)
    for outer in (0.2, (0.2,), (2.0, 1.5), (0.2, -1.0), "ab"):
        with pytest.raises(InputError, match=r"outer|position|derivative"):
            il.shells.family("topo_1_rrr", outer=outer)
    box = il.macroshape.box((3, 1, 1))
    for wrong, word in (
        (lambda cell: cell, "one value per cell"),
        (np.zeros((2, 1, 1)), "one value per cell, shape \\(3, 1, 1\\)"),
        (lambda cell: cell[:, 0], "position"),
        (lambda cell: cell[:, 9], "parameters raised IndexError"),
    ):
        with pytest.raises(InputError, match=word):
            _ = il.Lattice(family.graded(wrong), through=box, repeat=(3, 1, 1)).smooth_tile
    long, many = il.macroshape.box((600, 1, 1)), family.graded(lambda c: c[:, 0] / 1e4)
    with pytest.raises(InputError, match="600 different cells"):
        _ = il.Lattice(many, through=long, repeat=(600, 1, 1)).smooth_tile
