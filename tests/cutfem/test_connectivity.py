"""Parts of a solid: pieces that share an edge or a node only are not held by each other."""

import warnings

import numpy as np
import pytest

import ilattice as il
from ilattice.cutfem.connectivity import connected_parts

CUBE = [[0.0] * 3, [1.0] * 3]


def box(lo, hi):
    lo, hi = np.array(lo, float), np.array(hi, float)
    return lambda u: np.maximum(lo - u, u - hi).max(axis=1)


def union(*fields):
    return lambda u: np.min([f(u) for f in fields], axis=0)


def parts(field, cells=8, **options):
    cut = il.cutfem.cut(field, cells, domain=CUBE, degree=1, **options)
    return connected_parts(cut.volume(2), tuple(cut.faces(a, 1) for a in range(3)))


def test_cells_that_share_an_edge_only_are_apart():
    edge = union(box([0, 0, 0], [0.5, 0.5, 1]), box([0.5, 0.5, 0], [1, 1, 0.25]))
    found = parts(edge)
    for part, volume, centroid in ((0, 0.25, [0.25, 0.25, 0.5]), (1, 0.0625, [0.75, 0.75, 0.125])):
        measured = found.measure(part)
        assert measured[0] == pytest.approx(volume, rel=1e-12)
        np.testing.assert_allclose(measured[1], centroid, rtol=1e-12)
    assert "volume 0.0625 at (0.75, 0.75, 0.125)" in found.describe(np.array([1]))
    face = union(box([0, 0, 0], [0.5, 0.5, 1]), box([0.375, 0, 0], [1, 1, 0.25]))
    assert len(parts(face)) == 1


def test_a_dry_face_joins_nothing():
    gap = lambda u: 0.06 - np.abs(u[:, 0] - 0.55)  # noqa: E731
    found = parts(gap, 20)
    assert len(found) == 2
    assert sum(found.measure(i)[0] for i in (0, 1)) == pytest.approx(0.88, abs=0.02)


def test_slivers_belong_to_what_they_grow_on():
    for eta in (1e-2, 1e-4, 1e-6):
        corner = box([-1] * 3, [0.875 + 0.125 * eta] * 3)
        found = parts(corner)
        assert len(found) == 1
        assert len(found.cells) == 512


@pytest.mark.parametrize("size", [1e-13, 1e-3])
def test_parts_that_rounding_leaves_are_not_told(size):
    """A ball of next to no volume was left out with a warning, and islands='refuse' refused it."""
    speck = il.fields.translate(il.fields.sphere(size), (0.71, 0.83, 0.77))
    body = il.fields.union(il.fields.half_space((0.1, 0.2, 1.0), 0.4), speck)
    problem = il.cutfem.Elasticity(body, 4, domain=CUBE, islands="refuse").clamp("w=0")
    found = problem.domain.parts
    rest = found.seen(np.arange(len(found)))
    assert len(rest) == 1 + (size > 1e-6)
    if size > 1e-6:
        with pytest.raises(il.errors.GeometryError, match=r"nothing holds 1 part: volume 4\.1"):
            problem.assembly  # noqa: B018
    else:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert len(problem.assembly.space)


def test_a_closed_direction_joins_its_ends():
    ring = il.macroshape.torus(major=3.0, width=1.0)
    axis = ring.closed.index(True)
    ends = lambda u: 0.25 - np.abs(u[:, axis] - 0.5)  # noqa: E731
    cut = il.cutfem.cut(ends, 8, domain=CUBE, degree=1, through=ring)
    grid = il.cutfem.Grid(cut.grid.axes, ring.closed)
    for g, count in ((cut.grid, 2), (grid, 1)):
        open_or_closed = il.cutfem.cut(ends, g, degree=1, through=ring)
        solid = open_or_closed.volume(3)
        found = connected_parts(solid, tuple(open_or_closed.faces(a, 1) for a in range(3)))
        assert len(found) == (1 if g.closed[axis] else count)
        volume = sum(found.measure(i)[0] for i in range(len(found)))
        assert volume == pytest.approx(solid.in_space().integrate(), rel=1e-12)
