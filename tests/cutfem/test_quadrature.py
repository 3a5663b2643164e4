"""Rules on cut cells: accuracy, degenerate cells, identities, a naive one, bad input."""

import itertools
from math import factorial, gamma

import naive_quadrature as naive
import numba
import numpy as np
import pytest

import ilattice as il
from ilattice.bspline import BSpline
from ilattice.errors import InputError
from ilattice.quadrature.grid import CUT, IN
from ilattice.quadrature.levelsets import as_level_sets
from ilattice.quadrature.rules import NAMES as ENDS
from ilattice.tiles.tpms import ROWS

BOX = np.array([[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]])
CUBE = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
V, S = 4 / 3 * np.pi * 0.4**3, 4 * np.pi * 0.4**2
X = np.array([1.0, 0.0, 0.0])


def ball(u):
    return (u**2).sum(axis=1) - 0.16


def sphere(centre, radius):
    """One cell with (x - centre)² - radius², exactly."""
    rows = [np.array([c * c, c * c - c, (1 - c) ** 2]) for c in centre]
    c = rows[0][:, None, None] + rows[1][:, None] + rows[2] - radius**2
    return cell(c)


def cell(c):
    c = np.asarray(c, float)
    return BSpline([np.repeat([0.0, 1.0], n) for n in c.shape], c, [n - 1 for n in c.shape])


def plane(normal, offset, degree=2):
    t = np.linspace(0, 1, degree + 1)
    a, b, c = normal
    return cell(a * t[:, None, None] + b * t[:, None] + c * t - offset)


def square(centre=0.5, shift=0.0):
    """(x - centre)² - shift on one cell."""
    c = centre
    rows = np.array([c * c, c * c - c, (1 - c) ** 2]) - shift
    return cell(rows[:, None, None] + np.zeros((3, 3, 3)))


def negated(s):
    return BSpline(s.t, -s.c, s.k, periodic=s.periodic)


def measures(field, q, cells=None, **options):
    cut = il.cutfem.cut(field, cells, **options)
    return cut.volume(q).integrate(), cut.surface(q).integrate()


# ------------------------------------------------------------------------------ accuracy


def test_full_pieces_of_cut_cells_share_a_rule():
    """A cell of 8³ pieces, of which a plane leaves 7 layers full and one cut."""
    t = [np.r_[0, 0, np.linspace(0, 1, 9), 1, 1]] * 3
    x = np.convolve(t[0][1:-1], [0.5, 0.5], "valid")
    whole = BSpline(t, np.broadcast_to(x[:, None, None] - 0.95, (10, 10, 10)).copy(), 2)
    rule = il.cutfem.cut(whole, 1).volume(2)
    assert len(rule) == 8 * (1 + 64)
    for powers in ((0, 0, 0), (3, 0, 0), (1, 2, 3), (3, 3, 3)):
        i, j, k = powers
        exact = 0.95 ** (i + 1) / (i + 1) / (j + 1) / (k + 1)
        assert rule.integrate(lambda u, p=powers: (u**p).prod(axis=1)) == pytest.approx(exact)


@pytest.mark.parametrize(
    ("q", "volume", "surface"), [(2, 3e-7, 4e-6), (3, 1e-8, 7e-8), (4, 1e-10, 9e-10)]
)
def test_the_sphere_on_16_cells(q, volume, surface):
    v, s = measures(ball, q, 16, domain=BOX, degree=2)
    assert 0 < abs(v / V - 1) < volume
    assert 0 < abs(s / S - 1) < surface


def test_points_are_few():
    cut = il.cutfem.cut(ball, 16, domain=BOX, degree=2)
    for q, most in ((2, 14.8), (3, 50.1), (4, 118.8)):
        assert len(cut.volume(q, only="cut")) / cut.cells(CUT).size < 1.05 * most


@pytest.mark.parametrize("degree", [2, 3, 4])
def test_the_sphere_converges_in_every_degree(degree):
    errors = [np.abs(np.array(measures(ball, 5, n, domain=BOX, degree=degree)) / (V, S) - 1)
              for n in (4, 8)]  # fmt: skip
    assert (errors[0] < (1e-7, 5e-7)).all()
    assert (errors[1] < (1e-9, 5e-9)).all()


def test_moments_of_an_ellipsoid_in_a_flat_box():
    axes = np.array([0.4, 0.3, 0.002])
    box = np.array([[-0.5, -0.5, -0.0025], [0.5, 0.5, 0.0025]])
    centre = np.array([0.01, 0.02, 0.0001])
    cut = il.cutfem.cut(
        lambda u: (((u - centre) / axes) ** 2).sum(axis=1) - 1, 10, domain=box, degree=2
    )
    rule = cut.volume(5)
    volume = 4 / 3 * np.pi * axes.prod()
    assert rule.integrate() == pytest.approx(volume, rel=1e-8)
    np.testing.assert_allclose(rule.integrate(lambda u: u) / volume, centre, atol=1e-9)
    second = rule.integrate(lambda u: (u - centre) ** 2) / volume
    np.testing.assert_allclose(second, axes**2 / 5, rtol=1e-7)


def test_full_cells_and_straight_cuts_are_exact_to_the_promised_degree():
    rng = np.random.default_rng(0)
    for q in (1, 2, 5, 10):
        cut = il.cutfem.cut(lambda u: u[:, 1] - 0.37, 3, domain=CUBE, degree=1)
        rule = cut.volume(q)
        assert rule.exact_to == 2 * q - 1
        for _ in range(5):
            k = rng.integers(0, 2 * q, 3)
            exact = 0.37 ** (k[1] + 1) / (k + 1).prod()
            value = rule.integrate((rule.points**k).prod(axis=1))
            assert value == pytest.approx(exact, rel=1e-12)


def test_moments_of_a_corner_that_a_plane_cuts_off_are_exact():
    grid = il.cutfem.CutGrid(
        il.cutfem.Grid(tuple(CUBE.T)), as_level_sets(plane((1, 1, 1), 1.0), None, 2)
    )
    rule = grid.volume(5)
    for k in itertools.product(range(8), repeat=3):
        if sum(k) <= 7:  # and two more from the slanted side
            exact = np.prod([factorial(i) for i in k]) / factorial(sum(k) + 3)
            assert rule.integrate((rule.points**k).prod(axis=1)) == pytest.approx(exact, abs=1e-13)


# ------------------------------------------------------------------------------ degenerate cells


@pytest.mark.parametrize(
    ("field", "volume", "surface"),
    [
        (plane((1, 0, 0), 0.5), 0.5, 1.0),
        (plane((1, 1, 1), 1.0), 1 / 6, np.sqrt(3) / 2),
        (plane((1, -1, 0), 0.0), 0.5, np.sqrt(2)),
        (plane((1, 0, 0), 0.0), 0.0, 0.0),
        (plane((1, 0, 0), 1.0), 1.0, 1.0),
        (plane((-1, 0, 0), 0.0), 1.0, 1.0),
        (plane((0, 0, -1), -1.0), 0.0, 0.0),
        (square(shift=1e-6), 2e-3, 2.0),
        (negated(square(shift=1e-6)), 1 - 2e-3, 2.0),
        (square(), 0.0, 0.0),
        (cell(np.zeros((3, 3, 3))), 0.0, 0.0),
        (cell(np.full((3, 3, 3), -1e-14)), 1.0, 0.0),
    ],
)
def test_flat_degenerate_cells_are_exact(field, volume, surface):
    for q in (2, 4):
        grid = il.cutfem.CutGrid(il.cutfem.Grid(tuple(CUBE.T)), as_level_sets(field, None, 2))
        assert grid.volume(q).integrate() == pytest.approx(volume, abs=2e-13)
        assert len(grid.volume(q)) <= 8 * q**3  # few boxes: nothing was halved for long
        assert grid.surface(q).integrate() == pytest.approx(surface, abs=2e-13)


@pytest.mark.parametrize(
    ("centre", "radius", "volume", "surface", "rtol"),
    [
        ((0.5, 0.5, 0.5), 0.5, np.pi / 6, np.pi, 1.5e-3),
        ((0, 0, 0), 0.5, np.pi / 48, np.pi / 8, 1.5e-3),
        ((1, 0, 1), 0.5, np.pi / 48, np.pi / 8, 1.5e-3),
        ((0.5, 0.5, 0.5), 0.01, 4 / 3 * np.pi * 1e-6, 4 * np.pi * 1e-4, 1e-2),
        ((0.4, 0.3, 0.61), 0.01, 4 / 3 * np.pi * 1e-6, 4 * np.pi * 1e-4, 1e-2),
        ((0.0625, 0.9, 0.5), 0.01, 4 / 3 * np.pi * 1e-6, 4 * np.pi * 1e-4, 1e-2),
    ],
)
def test_tangent_and_tiny_spheres(centre, radius, volume, surface, rtol):
    v, s = measures(sphere(centre, radius), 4)
    assert v == pytest.approx(volume, rel=rtol)
    assert s == pytest.approx(surface, rel=rtol)


def test_a_deeper_tangent_is_more_accurate():
    rows = [np.array([0.0625, -0.0625, 0.0625, -0.0625, 0.0625])] * 3  # (x - 1/2)^4
    cut = il.cutfem.cut(cell(rows[0][:, None, None] + rows[1][:, None] + rows[2] - 0.4**4))
    exact = 0.8**3 * gamma(1.25) ** 3 / gamma(1.75)  # of a superball
    errors = [abs(cut.volume(6, tangent_depth=d).integrate() / exact - 1) for d in (2, 3, 7)]
    assert errors[2] < 1e-5 < errors[1] < errors[0]


def test_the_cone_at_its_apex():
    c = np.array([0.25, -0.25, 0.25])
    v, s = measures(cell(c[:, None, None] + c[:, None] - c), 4)
    assert v == pytest.approx(np.pi / 12, rel=2e-3)
    assert s == pytest.approx(np.pi / np.sqrt(2), rel=2e-3)


@pytest.mark.parametrize("noise", [1e-16, 1e-13])
def test_noise_in_the_coefficients_moves_nothing(noise):
    rng = np.random.default_rng(1)
    for field in (plane((1, 0, 0), 0.5), plane((1, 1, 1), 1.0), square(shift=1e-6)):
        noisy = cell(field.c + noise * rng.normal(size=(3, 3, 3)))
        np.testing.assert_allclose(measures(noisy, 3), measures(field, 3), atol=1e-9)


def test_a_surface_on_a_face_of_cells_is_counted_once():
    for sign in (1, -1):
        cut = il.cutfem.cut(lambda u, s=sign: s * (u[:, 0] - 0.5), (4, 3, 3), domain=CUBE, degree=2)
        rule = cut.surface(2)
        assert rule.integrate() == pytest.approx(1, rel=1e-14)
        np.testing.assert_allclose(rule.normals, np.outer(np.ones(len(rule)), sign * X), atol=1e-15)
        assert cut.volume(2).integrate() == pytest.approx(0.5, rel=1e-14)
        assert (cut.status[rule.cells[0] // 9] == IN).all()
        inner = cut.faces(0, 2)  # the face at 0.25 or 0.75 is wet, the one at 0.5 is not
        assert inner.integrate() == pytest.approx(1, rel=1e-14)
        assert imbalance(cut, 2)[1] < 1e-14


def test_a_surface_on_the_end_of_the_grid_is_no_face():
    cut = il.cutfem.cut(lambda u: u[:, 0] - 1, 2, domain=CUBE, degree=1)
    assert cut.surface(2).integrate() == pytest.approx(1, rel=1e-14)
    assert len(cut.face("u=1", 2)) == 0
    assert cut.face("v=1", 2).integrate() == pytest.approx(1, rel=1e-14)
    assert imbalance(cut, 2)[1] < 1e-14


# ------------------------------------------------------------------------------ identities


def random_pair(seed, degree=3, n=2):
    rng = np.random.default_rng(seed)
    return [cell(rng.normal(size=(degree + 1,) * 3)) for _ in range(n)]


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_a_solid_and_its_complement_fill_every_cell(degree):
    for seed in range(5):
        s = random_pair(seed, degree)[0]
        for q in (2, 5):
            parts = [il.cutfem.cut(f, 3).volume(q) for f in (s, negated(s))]
            total = np.zeros(27)
            for rule in parts:
                np.add.at(total, rule.cells, rule.integrate_cells())
                assert rule.weights.min() > 0
            np.testing.assert_allclose(total * 27, 1, rtol=0, atol=2e-14)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_reflections_and_permutations_change_nothing(degree):
    s = random_pair(11, degree)[0]
    reference = measures(s, 6, 4)
    for c in (s.c[::-1], s.c[:, ::-1, ::-1], s.c.transpose(1, 2, 0), s.c.transpose(2, 1, 0)):
        np.testing.assert_allclose(measures(cell(c), 6, 4), reference, rtol=2e-6)


@pytest.mark.parametrize("seed", range(4))
def test_the_reference_implementation_agrees(seed):
    for fields in (random_pair(seed, 2, 1), random_pair(seed, 3, 1), random_pair(seed, 2, 2)):
        lipschitz = 3 * max(np.abs(np.diff(s.c, axis=a)).max() for s in fields for a in range(3))

        def f(u, fields=fields):
            return np.max([s(np.clip(u, 0, 1)) for s in fields], axis=0)

        expected = naive.richardson(f, *CUBE, 5, 2 * lipschitz)
        v, s = measures(tuple(fields), 4, 4)
        assert v == pytest.approx(expected[0], rel=1e-3)
        assert s == pytest.approx(expected[1], rel=1e-3 if len(fields) == 1 else 0.02)


def test_the_reference_implementation_knows_the_ball():
    np.testing.assert_allclose(naive.richardson(ball, *BOX, 5, 2.0), (V, S), rtol=2e-4)


def vector(u):
    x, y, z = u.T
    return np.stack([x**2 * y, y * z, x * z**2], axis=1)


def divergence(u):
    x, y, z = u.T
    return 2 * x * y + z + 2 * x * z


def imbalance(cut, q):
    """Divergence theorem on every cell: the largest mismatch over the size of a cell."""
    shape = cut.grid.shape
    total = np.zeros(shape).ravel()
    rule = cut.volume(q)
    total[rule.cells] += rule.integrate_cells(divergence)
    for rule in (cut.surface(q), *(cut.face(name, q) for name in ENDS)):
        total[rule.cells] -= rule.integrate_cells((vector(rule.points) * rule.normals).sum(axis=1))
    for axis in range(3):
        rule = cut.faces(axis, q)
        flux = rule.integrate_cells((vector(rule.points) * rule.normals).sum(axis=1))
        np.add.at(total, rule.cells, -flux)
        np.add.at(total, rule.neighbours, flux)
    return np.abs(total.sum()), np.abs(total).max()


def test_the_divergence_theorem_on_every_cell_of_a_ball():
    whole, worst = imbalance(il.cutfem.cut(ball, 7, domain=BOX, degree=2), 8)
    assert whole < 1e-10
    assert worst < 1e-10


def part_of(tile):
    """A part of the cell, off its planes of symmetry, that the surface runs through."""
    for start in ((0.05, 0.05, 0.05), (0.3, 0.3, 0.3), (0.05, 0.3, 0.55), (0.17, 0.42, 0.77)):
        box = start + np.array([[0.0], [0.21]])
        cut = il.cutfem.CutGrid(
            il.cutfem.Grid(tuple(np.linspace(*box, 11).T)), as_level_sets(tile, box, 4)
        )
        if len(cut.cells(CUT)) > 20:
            return cut
    raise AssertionError("no part of the cell is cut")


@pytest.mark.parametrize("name", [row.name for row in ROWS])
def test_the_divergence_theorem_on_every_tile(name):
    tile = il.tiles[name]
    if tile.singular_at_zero:  # sheets that cross: lower order, and many points near the lines
        tile = tile.with_level(0.05)
    assert imbalance(part_of(tile), 8)[0] < 1e-9


def test_the_divergence_theorem_where_sheets_cross():
    assert 1e-9 < imbalance(part_of(il.tiles["f"]), 2)[0] < 1e-3


def test_known_constants_of_the_gyroid():
    gyroid = il.tiles.gyroid(level=0.3)
    v, s = measures(gyroid, 5, 16)
    assert v == pytest.approx(0.59672406, abs=2e-8)
    assert s == pytest.approx(3.0402570, abs=2e-7)
    sheet = (il.tiles["gyroid"].field - 0.3, -il.tiles["gyroid"].field - 0.3)
    v, s = measures(sheet, 5, 16, domain=CUBE)
    assert v == pytest.approx(0.193448125, abs=2e-8)
    assert s == pytest.approx(2 * 3.0402570, abs=4e-7)


def test_two_level_sets_that_cross():
    lens = (lambda u: ball(u - 0.15 * X), lambda u: ball(u + 0.15 * X))
    h = 0.4 - 0.15
    cut = il.cutfem.cut(lens, 12, domain=BOX, degree=2)
    assert cut.volume(4).integrate() == pytest.approx(2 * np.pi * h**2 * (1.2 - h) / 3, rel=1e-5)
    skin = cut.surface(4)
    assert skin.integrate() == pytest.approx(4 * np.pi * 0.4 * h, rel=1e-3)
    assert set(skin.sets) == {0, 1}
    for k, sign in ((0, 1), (1, -1)):
        p = skin.points[skin.sets == k] - sign * 0.15 * X
        np.testing.assert_allclose(np.linalg.norm(p, axis=1), 0.4, rtol=1e-12)
        np.testing.assert_allclose(skin.normals[skin.sets == k], p / 0.4, atol=1e-10)


# ------------------------------------------------------------------------------ the rules


def test_points_lie_in_their_cells_and_in_the_solid():
    cut = il.cutfem.cut(tuple(random_pair(3, 3)), 4)
    for rule in (cut.volume(4), cut.surface(4), cut.face("v=1", 4), cut.faces(2, 4)):
        assert rule.offsets[0] == 0
        assert rule.offsets[-1] == len(rule) > 0
        assert (np.diff(rule.offsets) > 0).all()
        assert (np.diff(rule.cells) > 0).all()
        assert rule.weights.min() > 0
        box = cut.grid.boxes(rule.cells)[rule.owners]
        t = (rule.points - box[:, :3]) / box[:, 3:]
        assert t.min() > -1e-12
        assert t.max() < 1 + 1e-12
        values = cut.sets(np.clip(rule.points, 0, 1))
        assert values.max() < 1e-12
    skin = cut.surface(4)
    values = cut.sets(np.clip(skin.points, 0, 1))
    assert np.abs(values[np.arange(len(skin)), skin.sets]).max() < 1e-12


def test_parts_add_up():
    cut = il.cutfem.cut(ball, 8, domain=BOX, degree=2)
    full, rest, both = (cut.volume(3, only=o) for o in ("in", "cut", ""))
    np.testing.assert_array_equal(full.cells, cut.cells(IN))
    assert set(rest.cells) <= set(cut.cells(CUT))
    assert full.integrate() + rest.integrate() == pytest.approx(both.integrate(), rel=1e-14)
    assert len(full) + len(rest) == len(both)
    assert both.integrate_cells().sum() == pytest.approx(both.integrate(), rel=1e-13)
    assert both.integrate(np.ones((len(both), 2))).shape == (2,)


def test_faces_of_cells():
    cut = il.cutfem.cut(lambda u: u[:, 0] + u[:, 1] - 0.9, 4, domain=CUBE, degree=1)
    assert cut.face("u=0", 2).integrate() == pytest.approx(0.9, rel=1e-14)
    assert cut.face("w=1", 2).integrate() == pytest.approx(0.405, rel=1e-14)
    assert len(cut.face("u=1", 2)) == 0
    np.testing.assert_array_equal(cut.face("v=0", 2).normals[0], [0, -1, 0])
    rule = cut.faces(0, 2)
    assert rule.integrate() == pytest.approx(0.65 + 0.4 + 0.15, rel=1e-14)
    np.testing.assert_array_equal(rule.neighbours, rule.cells + 16)
    np.testing.assert_array_equal(rule.normals[0], X)


def test_the_seam_of_a_closed_direction_is_an_inner_face():
    torus = il.macroshape.torus(major=4.0, width=2.0)
    wall = il.Lattice("schwarz_p", through=torus, repeat=(4, 1, 1), spans_per_tile=6).offset(0.2)
    cut = il.cutfem.cut(wall, (8, 3, 3))
    axis = cut.grid.closed.index(True)
    rule = cut.faces(axis, 3)
    layers = np.unravel_index(rule.cells, cut.grid.shape)[axis]
    per_layer = np.bincount(layers, rule.integrate_cells(), 8)
    np.testing.assert_allclose(per_layer[1::2], per_layer[1], rtol=1e-3)
    assert (np.unravel_index(rule.neighbours[layers == 7], cut.grid.shape)[axis] == 0).all()
    with pytest.raises(InputError, match="closed"):
        cut.face(f"{'uvw'[axis]}=0")


@pytest.mark.threads
def test_threads_change_no_bit():
    cut = il.cutfem.cut(tuple(random_pair(7, 2)), 8)

    def arrays():
        rules = (cut.volume(3), cut.surface(3), cut.faces(1, 3))
        out = [a for r in rules for a in (r.points, r.weights, r.offsets, r.cells)]
        return [*out, rules[0].compressed().weights, il.cutfem.cut(cut.sets.splines, 8).status]

    many = arrays()
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        one = arrays()
    finally:
        numba.set_num_threads(threads)
    assert all(np.array_equal(a, b) for a, b in zip(one, many, strict=True))


def test_results_do_not_depend_on_what_else_is_on_the_grid():
    s = random_pair(2, 2)[0]
    whole = il.cutfem.cut(s, 2).volume(3)
    x = np.linspace(0, 1, 3)
    corner = il.cutfem.cut(s, il.cutfem.Grid((x[1:], x[:2], x[:2]))).volume(3)
    rows = slice(*whole.offsets[np.flatnonzero(whole.cells == 4)[0] + np.arange(2)])
    np.testing.assert_array_equal(whole.points[rows], corner.points)
    np.testing.assert_array_equal(whole.weights[rows], corner.weights)


def test_cells_with_very_many_points_find_room():
    fine = cell(np.sin(40 * np.arange(125.0)).reshape(5, 5, 5))
    rule = il.cutfem.cut(fine).volume(10)
    assert len(rule) > 32 * 3 * 1000 / 4
    assert rule.integrate() == pytest.approx(il.cutfem.cut(fine, 8).volume(6).integrate(), rel=1e-3)


@pytest.mark.parametrize("degree", [0, 1, 2, 4])
def test_compression_keeps_the_moments(degree):
    rule = il.cutfem.cut(ball, 5, domain=BOX, degree=2).volume(4)
    small = rule.compressed(degree)
    assert np.diff(small.offsets).tolist() == [(degree + 1) ** 3] * len(rule.cells)
    assert small.exact_to == degree
    for power in ((0, 0, 0), (degree, 0, 1 % (degree + 1)), (degree, degree, degree)):
        moments = [r.integrate_cells((r.points**power).prod(axis=1)) for r in (rule, small)]
        np.testing.assert_allclose(*moments, rtol=1e-10, atol=1e-15)


# ------------------------------------------------------------------------------ space


def wall(through, repeat=(1, 1, 1), d=0.05):
    return il.Lattice("schwarz_p", through=through, repeat=repeat, spans_per_tile=8).offset(d)


def test_a_map_scales_volumes_areas_and_turns_normals():
    bent = il.macroshape.torus(major=3.0, width=1.0)
    cut = il.cutfem.cut(wall(bent, (6, 1, 1), 0.1))
    solid, skin = cut.volume(4).in_space(), cut.surface(4).in_space()
    np.testing.assert_allclose(np.linalg.norm(skin.normals, axis=1), 1, rtol=1e-12)
    ends = [cut.face(f"{'uvw'[a]}={s}", 4).in_space() for a in range(3) for s in (0, 1)
            if not cut.grid.closed[a]]  # fmt: skip
    flux = skin.flux(lambda x: x / 3) + sum(r.flux(lambda x: x / 3) for r in ends)
    assert flux == pytest.approx(solid.integrate(), rel=1e-4)
    mesh = wall(bent, (6, 1, 1), 0.1).mesh(0.04, polish=False)
    assert solid.integrate() == pytest.approx(mesh.volume, rel=5e-3)
    np.testing.assert_allclose(solid.points, bent.x(solid.parameters), atol=1e-13)


def test_normals_stay_outward_in_left_handed_maps():
    box = il.macroshape.box((2, 1, 1))
    rules = []
    for through in (box, box.flipped(0)):
        cut = il.cutfem.cut(lambda u: ball(u - 0.5), 6, domain=CUBE, degree=2, through=through)
        rules.append(cut.surface(3).in_space())
    for rule in rules:
        assert rule.flux(lambda x: x / 3) == pytest.approx(2 * V, rel=1e-3)
    assert rules[0].integrate() == pytest.approx(rules[1].integrate(), rel=1e-12)


def test_quadrature_of_a_wall_is_in_space():
    w = wall(il.macroshape.box((1, 1, 2)), (1, 1, 2))
    rule = il.cutfem.quadrature(w, q=2)
    assert rule.parameters is not None
    assert rule.integrate() == pytest.approx(w.mesh(0.03, polish=False).volume, rel=2e-3)
    np.testing.assert_allclose(
        rule.integrate(lambda x: x) / rule.integrate(), [0.5, 0.5, 1.0], atol=1e-6
    )
    skin = il.cutfem.quadrature(w, 8, q=2, kind="surface")
    assert set(skin.sets) == {0, 1}
    end = il.cutfem.quadrature(w, q=2, kind="w=1")
    np.testing.assert_allclose(end.points[:, 2], 2, rtol=1e-14)
    np.testing.assert_allclose(end.normals, [[0, 0, 1]] * len(end), atol=1e-14)


def test_mass_properties_of_a_ball():
    m = il.cutfem.mass_properties(lambda u: ball(u - 0.1 * X), 8, density=2.0, domain=BOX, q=4)
    assert (m.volume, m.area, m.mass) == pytest.approx((V, S, 2 * V), rel=1e-6)
    np.testing.assert_allclose(m.centroid, 0.1 * X, atol=1e-7)
    np.testing.assert_allclose(m.inertia, 0.4 * 2 * V * 0.16 * np.eye(3), atol=1e-6)
    heavy = il.cutfem.mass_properties(ball, 8, density=lambda x: 1 + x[:, 0], domain=BOX)
    assert heavy.mass == pytest.approx(V, rel=1e-5)
    assert heavy.centroid[0] == pytest.approx(0.4**2 / 5, rel=1e-4)


# ------------------------------------------------------------------------------ bad input


def test_bad_orders_are_refused():
    cut = il.cutfem.cut(ball, 4, domain=BOX, degree=2)
    for q in (0, 11, 2.5, "3", True, [3]):
        with pytest.raises(InputError, match="q must"):
            cut.volume(q)
    with pytest.raises(InputError, match="tangent_depth"):
        cut.surface(2, tangent_depth=-1)
    with pytest.raises(InputError, match="only"):
        cut.volume(2, only="all")
    with pytest.raises(InputError, match="name must"):
        cut.face("x=0")
    with pytest.raises(InputError, match="axis"):
        cut.faces(3)
    with pytest.raises(InputError, match="kind"):
        il.cutfem.quadrature(ball, 4, domain=BOX, kind="area")


def test_bad_integrands_are_refused():
    cut = il.cutfem.cut(ball, 4, domain=BOX, degree=2)
    rule = cut.volume(2)
    with pytest.raises(InputError, match="one value for each"):
        rule.integrate(np.ones(3))
    with pytest.raises(InputError, match="normals"):
        rule.flux(lambda x: x)
    with pytest.raises(InputError, match="vectors"):
        cut.surface(2).flux(lambda x: x[:, :2])
    with pytest.raises(InputError, match="through"):
        rule.in_space()
    there = il.cutfem.cut(lambda u: ball(u - 0.5), 4, domain=CUBE).volume(2)
    with pytest.raises(InputError, match="already"):
        there.in_space(il.macroshape.box()).in_space()
    with pytest.raises(InputError, match="compressed"):
        cut.surface(2).compressed()
    with pytest.raises(InputError, match="degree"):
        rule.compressed(10)
    for density, message in ((-1.0, "negative"), (0.0, "positive"), (np.ones(3), "one value")):
        with pytest.raises(InputError, match=message):
            il.cutfem.mass_properties(ball, 4, density=density, domain=BOX)
