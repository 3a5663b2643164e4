"""Signs of cells are certain, for any grid, spline or field; bad input ends at the door."""

import warnings

import numpy as np
import pytest

import ilattice as il
from ilattice.bspline import BSpline
from ilattice.bspline.fit import fit
from ilattice.errors import GeometryError, InputError
from ilattice.quadrature.grid import CUT, IN, OUT
from ilattice.quadrature.levelsets import Pieces

BOX = np.array([[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]])


def ball(u):
    return (u**2).sum(axis=1) - 0.16


def spline(degree=2, spans=5, field=ball, domain=BOX):
    return fit(field, domain=domain, degree=degree, spans=spans, method="interpolate")


def random_spline(rng, degree, shape=(4, 5, 6)):
    t = [np.r_[[0.0] * degree, np.linspace(0, 1, n - degree + 1), [1.0] * degree] for n in shape]
    return BSpline(t, rng.normal(size=shape), degree)


def inside(sets, grid, cell, n=9):
    """Whether each of n³ points of a cell, faces included, is in the solid."""
    box = grid.boxes(np.array([cell]))[0]
    t = np.linspace(0, 1, n)
    u = box[:3] + box[3:] * np.stack(np.meshgrid(t, t, t, indexing="ij"), -1).reshape(-1, 3)
    return (sets(np.clip(u, *grid.domain)) < 0).all(axis=1)


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_tensors_are_the_spline(degree):
    rng = np.random.default_rng(degree)
    s = random_spline(rng, degree, (degree + 2, degree + 3, degree + 1))
    pieces = il.cutfem.cut(s, (3, 2, 4)).pieces
    for _ in range(20):
        index = np.array([[rng.integers(n) for n in pieces.shape]])
        c = pieces.tensors(index).reshape((degree + 1,) * 3)
        at = rng.random(3)
        u = [
            x[i] + t * (x[i + 1] - x[i]) for x, i, t in zip(pieces.axes, index[0], at, strict=True)
        ]
        local = BSpline([np.repeat([0.0, 1.0], degree + 1)] * 3, c, degree)
        assert local(at[None])[0] == pytest.approx(s(np.array([u]))[0], abs=1e-13)


def test_degrees_may_differ_and_weights_only_scale():
    rng = np.random.default_rng(5)
    t = [np.repeat([0.0, 1.0], k + 1) for k in (1, 3, 2)]
    c = rng.normal(size=(2, 4, 3))
    w = rng.uniform(0.5, 2, c.shape)
    plain = il.cutfem.cut(BSpline(t, c * w, (1, 3, 2)), 4)
    rational = il.cutfem.cut(BSpline(t, c, (1, 3, 2), weights=w), 4)
    assert plain.sets.degree == 3
    np.testing.assert_array_equal(plain.status, rational.status)
    assert plain.volume(3).integrate() == rational.volume(3).integrate()
    box = il.cutfem.cut((plain.sets.splines[0], BSpline(t, c, (1, 3, 2), weights=w)), 4)
    assert box.volume(3).integrate() == pytest.approx(plain.volume(3).integrate(), rel=1e-4)


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_rows_of_pieces_have_the_signs_of_single_ones(degree):
    rng = np.random.default_rng(degree)
    pair = tuple(random_spline(rng, degree, (7, 8, 9)) for _ in range(2))
    shifted = tuple(BSpline(s.t, s.c - 0.4, s.k) for s in pair)
    cut = il.cutfem.cut(shifted, (9, 5, 7))
    expected = Pieces.signs(cut.pieces)
    assert set(np.unique(expected)) == {IN, CUT, OUT}
    np.testing.assert_array_equal(cut.pieces.signs(), expected)


def test_sets_of_walls_take_no_more_splines_than_they_need():
    lattice = il.Lattice("gyroid", through=il.macroshape.box((1, 1, 1)))
    u = np.random.default_rng(2).random((50, 3))
    for d, count, splines in (
        (0.05, 2, 1), (lambda u: 0.05 + 0.02 * u[:, 0], 2, 2), ((np.inf, 0.03), 1, 1)
    ):  # fmt: skip
        field = lattice.offset(d).field
        sets = il.cutfem.cut(lattice.offset(d), 4).sets
        assert (sets.count, len(sets.splines)) == (count, splines)
        outer = field.distance(u) - field.thickness.outer(u)
        inner = -field.distance(u) - field.thickness.inner(u)
        expected = np.stack([outer, inner], axis=1)[:, :count]
        np.testing.assert_allclose(sets(u), expected, atol=1e-14)


@pytest.mark.parametrize("cells", [(7, 7, 7), (2, 9, 5), None])
def test_signs_are_those_of_points(cells):
    rng = np.random.default_rng(1)
    kinds = set()
    for degree in (1, 2, 3):
        cut = il.cutfem.cut(random_spline(rng, degree), cells)
        for cell, status in enumerate(cut.status.ravel()):
            points = inside(cut.sets, cut.grid, cell)
            kinds.add(int(status))
            if status == IN:
                assert points[_strictly_inside()].all()
            elif status == OUT:
                assert not points.any()
    assert kinds >= ({IN, CUT} if cells is None else {IN, CUT, OUT})


def _strictly_inside(n=9):
    t = (np.arange(n) > 0) & (np.arange(n) < n - 1)
    return (t[:, None, None] & t[None, :, None] & t[None, None, :]).ravel()


def test_what_sampling_misses_is_cut():
    def speck(u):
        return ((u - [0.3, 0.41, 0.27]) ** 2).sum(axis=1) - 1e-6

    cut = il.cutfem.cut(speck, 4, domain=[[0] * 3, [1] * 3], degree=2)
    assert 21 in cut.cells(CUT)
    assert cut.cells(OUT).size >= 60
    np.testing.assert_array_equal(cut.volume(3).cells, [21])


def test_signs_are_sharp_on_smooth_solids():
    cut = il.cutfem.cut(ball, 16, domain=BOX, degree=2)
    assert [cut.cells(s).size for s in (IN, CUT, OUT)] == [696, 776, 2624]


def test_coarse_cells_hold_several_elements():
    s = spline(spans=10, field=lambda u: np.cos(7 * u).sum(axis=1))
    fine, coarse, odd = (il.cutfem.cut(s, n) for n in (10, 5, 3))
    assert fine.pieces.shape == coarse.pieces.shape == (10, 10, 10)
    assert odd.pieces.shape == (12, 12, 12)
    volumes = [c.volume(6).integrate() for c in (fine, coarse, odd)]
    assert volumes[1:] == pytest.approx(volumes[:1] * 2, rel=1e-8)
    assert coarse.status.shape == (5, 5, 5)
    blocks = fine.status.reshape(5, 2, 5, 2, 5, 2)
    low, high = blocks.min(axis=(1, 3, 5)), blocks.max(axis=(1, 3, 5))
    np.testing.assert_array_equal(coarse.status, np.where(low == high, low, CUT))


def test_fields_are_interpolated_with_a_stated_error():
    def wavy(u):
        return np.sin(5 * u + [0.1, 0.2, 0.3]).sum(axis=1) - 0.2

    exact = il.cutfem.cut(wavy, 20, domain=BOX, degree=4).volume(4).integrate()
    for n, degree in ((3, 2), (5, 2), (4, 3), (4, 4), (8, 4)):
        cut = il.cutfem.cut(wavy, n, domain=BOX, degree=degree)
        assert 0 < abs(cut.volume(5).integrate() / exact - 1) < 3 * cut.error + 1e-7
        assert cut.error < 2e-3
    assert il.cutfem.cut(spline(), 4).error == 0.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("degree", [2, 4])
def test_specks_and_voids_are_seen_down_to_the_size_that_is_stated(degree, sign):
    """Balls in functions that tell nothing of themselves, by the volume."""
    rng = np.random.default_rng([5, degree])
    known = il.cutfem.cut(il.fields.sphere(0.8), 4, domain=[[-1] * 3, [1] * 3])
    assert known.unseen == 0.0
    for _ in range(12):
        c, n = rng.uniform(-0.4, 0.4, 3), rng.standard_normal(3)
        n /= np.linalg.norm(n)
        side = -1.0 if sign > 0 else 1.0  # a void in a half space, or a speck beside it

        def field(u, c=c, n=n, r=0.0, side=side):
            ball = np.linalg.norm(u - c, axis=1) - r
            plane = (u - c) @ n + 0.55 * side
            return np.maximum(plane, -ball) if side < 0 else np.minimum(plane, ball)

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            grid = il.cutfem.cut(field, 4, domain=[[-1] * 3, [1] * 3], degree=degree)
            r = 0.525 * grid.unseen * 0.5  # cells are half a unit long
            without = grid.volume().integrate()
            found = il.cutfem.cut(
                lambda u, r=r: field(u, r=r), 4, domain=[[-1] * 3, [1] * 3], degree=degree
            )
            volume = found.volume().integrate()
        exact = without + side * 4 / 3 * np.pi * r**3
        assert abs(volume - exact) < 2e-3 * exact


def test_fields_with_bounds_are_certified_by_them():
    gyroid = il.tiles["gyroid"]
    cut = il.cutfem.cut(gyroid, 10, degree=2)
    box = cut.grid.boxes(np.arange(1000))
    ranges = gyroid.range(box[:, :3], box[:, :3] + box[:, 3:])
    status = cut.status.ravel()
    assert (status[ranges[:, 1] < 0] == IN).all()
    assert (status[ranges[:, 0] > 0] == OUT).all()
    assert (ranges[:, 1] < 0).any()


def test_periodic_splines_and_closed_maps():
    shell = il.macroshape.torus(major=4.0, width=2.0)
    wall = il.Lattice("schwarz_p", through=shell, repeat=(4, 1, 1), spans_per_tile=6).offset(0.2)
    cut = il.cutfem.cut(wall)
    assert cut.grid.shape == (24, 6, 6)
    assert cut.grid.closed == shell.closed
    assert cut.through is shell
    values = cut.sets(np.array([[0.1, 0.2, 0.3]]))[0]
    s = wall.distance(np.array([[0.1, 0.2, 0.3]]))[0]
    np.testing.assert_allclose(values, [s - 0.2, -s - 0.2])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"cells": 0}, "cells"),
        ({"cells": (2, 2)}, "cells"),
        ({"cells": 2.5}, "cells"),
        ({}, "cells is needed"),
        ({"cells": 4, "degree": 5}, "degree"),
        ({"cells": 4, "through": "torus"}, "through"),
        ({"cells": 4, "domain": [[0, 0, 0], [1, 0, 1]]}, "domain"),
        ({"cells": 4, "domain": None}, "domain is needed"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(InputError, match=message):
        il.cutfem.cut(ball, **{"domain": BOX, **arguments})


def test_bad_fields_are_refused():
    s = spline()
    with pytest.raises(InputError, match="leaves the bounds"):
        il.cutfem.cut(s, 4, domain=[[-1, -0.5, -0.5], [0.5, 0.5, 0.5]])
    with pytest.raises(InputError, match="scalar spline"):
        il.cutfem.cut(il.macroshape.box((1, 1, 1)).spline, 4)
    with pytest.raises(InputError, match="one field or a pair"):
        il.cutfem.cut((s, s, s), 4)
    with pytest.raises(InputError, match="callable"):
        il.cutfem.cut("gyroid", 4, domain=BOX)
    with pytest.raises(InputError, match="finite"):
        il.cutfem.cut(lambda u: ball(u) * np.nan, 4, domain=BOX)
    with pytest.raises(InputError, match="values for"):
        il.cutfem.cut(lambda u: u, 4, domain=BOX)
    with pytest.raises(GeometryError, match="empty"):
        il.cutfem.cut(lambda u: ball(u) + 1, 4, domain=BOX)
    with pytest.raises(InputError, match="its own"):
        il.cutfem.cut(s, il.cutfem.Grid((np.arange(2),) * 3), domain=BOX)


def test_distances_to_meshes_hold_beyond_the_box_of_the_mesh():
    """As formulas do: the box is that of the solid, and not of what is known."""
    box = [[-0.93, -1.1, -0.87], [0.95, 0.9, 1.2]]
    body = il.fields.rotate(il.fields.box((0.5, 0.4, 0.6)), 0.4, (1, 2, 3.0))
    mesh = il.sdf.MeshDistance(il.sdf.mesh(body, 0.07))
    cut = il.cutfem.cut(mesh, 8, domain=box)
    assert cut.volume(3).integrate() == pytest.approx(8 * 0.5 * 0.4 * 0.6, rel=0.01)
    assert (cut.volume(3).cells == il.cutfem.cut(body, 8, domain=box).volume(3).cells).mean() > 0.9


def test_grids_are_checked():
    for axes in ([[0, 1]] * 2, [[0, 1], [0, 1], [0]], [[0, 1], [1, 0], [0, 1]]):
        with pytest.raises(InputError, match="axes"):
            il.cutfem.Grid(tuple(axes))
    grid = il.cutfem.Grid(([0, 1, 3], [0, 2], [1, 2, 4]))
    assert grid.shape == (2, 1, 2)
    np.testing.assert_array_equal(grid.boxes(np.array([3])), [[1, 0, 2, 2, 2, 2]])
    uneven = il.cutfem.cut(lambda u: u[:, 0] - 2, grid, degree=1)
    assert uneven.volume(1).integrate() == pytest.approx(2 * 2 * 3, rel=1e-14)


@pytest.mark.parametrize("seed", range(4))
def test_balls_far_smaller_than_cells_are_found_by_where_their_distance_leads(seed):
    """Distances as functions of points: specks and voids of a hundredth of a cell vanished."""
    rng = np.random.default_rng([6, seed])
    for _ in range(4):
        c, n = rng.uniform(-0.6, 0.6, 3), int(rng.integers(4, 9))
        r, sign = 10 ** rng.uniform(-2.3, -1.0) * 2 / n, rng.choice([-1.0, 1.0])

        def field(u, c=c, r=r, sign=sign):
            return sign * (np.linalg.norm(u - c, axis=1) - r)

        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            grid = il.cutfem.cut(field, n, domain=[[-1] * 3, [1] * 3])
        on = grid.surface(2).points
        assert len(on)
        assert (np.linalg.norm(on - c, axis=1) < 3 * r).all()
        said = [str(w.message) for w in told]
        if sign > 0:  # a speck is all there is; a void is next to nothing of the rest
            assert grid.error > 2e-3
            assert len(said) == 1
            assert "the volume of the field is known to" in said[0]
        else:
            assert said == []
            assert grid.error < 2e-3
