"""Different tiles in one lattice: choices, blends, transitions, the spline of all."""

import pickle

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import InputError, PrecisionWarning
from ilattice.tiles._mixed import Blend, Component, continued, mean_slope, smooth_step

UNIT = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
OPEN, CLOSED = (False,) * 3, (True,) * 3
RIGHT = np.array([1.0, 0.0, 0.0])


def points(n, lo=0.0, hi=1.0, seed=0):
    return np.random.default_rng(seed).uniform(lo, hi, (n, 3))


def linear(normal, level):
    """The tile normal . u - level, which does not repeat smoothly across its normal."""
    corners = np.tensordot(normal, np.indices((2, 2, 2)), axes=1) - level
    return il.Tile(il.BSpline([[0, 0, 1, 1]] * 3, corners, 1), name="linear")


def blend_of(tiles, cells, width=0.5, closed=OPEN):
    cells = np.asarray(cells)
    components = tuple(Component.of(t) for t in tiles)
    return Blend(components, cells, None, width, cells.shape, UNIT, np.array(closed))


def checkerboard(i, j, k):
    return (i + j + k) % 2


@pytest.fixture(scope="module")
def pair():
    """Spline of a gyroid and a diamond side by side."""
    return il.tiles.mix("gyroid", "diamond", cells=[[[0]], [[1]]]).field((2, 1, 1), UNIT, OPEN)


# ---------------------------------------------------------------- scale and blending


def test_the_slope_of_a_tile_is_that_of_its_zero_set():
    assert mean_slope(linear((0.0, 0.0, 7.0), 3.0).kernel_field) == pytest.approx(7.0)
    wave = il.tiles.TrigField.parse("5 * cos(X) + 0 * sin(Y)")
    assert mean_slope(wave) == pytest.approx(10 * np.pi, rel=1e-3)


def test_a_zero_set_in_a_corner_is_scaled_too():
    ball = il.Tile(lambda u: (u**2).sum(axis=1) - 0.01)
    assert mean_slope(ball.kernel_field) == pytest.approx(0.2, rel=0.15)


def test_equal_tiles_blend_to_themselves():
    gyroid, same = il.tiles["gyroid"], il.tiles.gyroid()
    for closed in (OPEN, CLOSED):
        blend = blend_of([gyroid, same], np.indices((3, 2, 2)).sum(axis=0) % 2, closed=closed)
        p = points(500, -0.9, 2.9)
        np.testing.assert_allclose(
            blend(p), gyroid(np.mod(p, 1)) / mean_slope(gyroid.field), atol=1e-12
        )


def test_fields_are_those_of_the_tiles_outside_the_zones_and_their_mean_on_the_face():
    tiles = il.tiles["gyroid"], il.tiles["schwarz_p"]
    blend = blend_of(tiles, [[[0]], [[1]]], width=0.3)
    scaled = [lambda q, t=t: t(q) / mean_slope(t.field) for t in tiles]
    q = points(300)
    left, right = q * [0.84, 1, 1], q * [0.84, 1, 1] + [0.16, 0, 0]
    np.testing.assert_allclose(blend(left), scaled[0](left), atol=1e-12)
    np.testing.assert_allclose(blend(right + RIGHT), scaled[1](right), atol=1e-12)
    face = q * [0, 1, 1]
    mean = 0.5 * (scaled[0](face) + scaled[1](face))
    np.testing.assert_allclose(blend(face + RIGHT), mean, atol=1e-12)


def test_the_step_is_smooth_twice():
    t = np.array([-1.0, 0.0, 0.5, 1.0, 2.0])
    np.testing.assert_array_equal(smooth_step(t), [0, 0, 0.5, 1, 1])
    h = 1e-3
    for end in (0.0, 1.0):
        a, b, c = smooth_step(np.array([end - h, end, end + h]))
        assert abs(a - 2 * b + c) <= 11 * h**3


@pytest.mark.parametrize("closed", [OPEN, CLOSED])
def test_tiles_that_do_not_repeat_still_blend_to_a_c1_field(closed):
    blend = blend_of([linear((1.0, 0, 0.2), 0.4), linear((0, 0, 1.0), 0.5)], [[[0]], [[1]], [[0]]])
    blend = Blend(*(getattr(blend, n) for n in list(blend.__annotations__)[:-1]), np.array(closed))
    p, h = points(200, 0, 3), 1e-6
    p[:100, 0] = np.repeat([1.0, 2.0], 50)
    p[100:150, 2] = 1.0
    for axis in (0, 2):
        step = h * np.eye(3)[axis]
        a, b, c = blend(p - step), blend(p), blend(p + step)
        assert np.abs(c - a).max() <= 20 * h
        assert np.abs(a - 2 * b + c).max() <= 200 * h**2 + 1e-14


def test_continuation_keeps_linear_functions_and_stays_inside():
    seen = []

    def f(p):
        seen.append(p.copy())
        return 1.0 + p @ [1.0, -2.0, 3.0]

    p = points(300, -0.4, 1.4)
    np.testing.assert_allclose(continued(f, p, UNIT[0], UNIT[1]), f(p), atol=1e-13)
    inner = np.concatenate(seen[:-1])
    assert inner.min() >= 0.0
    assert inner.max() <= 1.0


# ---------------------------------------------------------------- one spline


def test_value_and_gradient_do_not_jump_across_a_face(pair):
    q = points(400) * [0, 1, 1] + [1, 0, 0]
    below = q.copy()
    below[:, 0] = np.nextafter(1.0, 0.0)
    for a, b in zip(pair.jet(below, 1), pair.jet(q, 1), strict=True):
        assert np.abs(a - b).max() <= 1e-12


def test_a_closed_direction_has_no_seam():
    mixture = il.tiles.mix("gyroid", "diamond", "schwarz_p", seed=3)
    field = mixture.field((3, 1, 2), UNIT, (True, False, True))
    q = points(200, 0, 1) * [0, 1, 1]
    for a, b in zip(field.jet(q, 1), field.jet(q + np.array([3, 0, 2]), 1), strict=True):
        assert np.abs(a - b).max() <= 1e-12
    assert field.spline.periodic == (True, False, True)
    np.testing.assert_array_equal(field.spline.domain, [[0, -1, 0], [3, 2, 2]])


def test_the_spline_is_as_good_as_it_says(pair):
    blend = blend_of([il.tiles["gyroid"], il.tiles["diamond"]], [[[0]], [[1]]])
    p = 1 + points(20000, -1, 1, seed=9)
    worst = np.abs(pair(p) - blend(p)).max()
    assert worst <= 1e-3
    assert 0.5 * worst <= pair.error <= 2 * worst
    assert pair.nbytes == pair.spline.c.nbytes


def test_a_tighter_tolerance_takes_more_spans(pair):
    mixture = il.tiles.mix("gyroid", "diamond", cells=[[[0]], [[1]]], tol=5e-5)
    finer = mixture.field((2, 1, 1), UNIT, OPEN)
    assert finer.error <= 5e-5
    assert min(np.array(finer.spans) - pair.spans) >= 0
    assert max(np.array(finer.spans) - pair.spans) > 0


def test_kinks_are_warned_of():
    roof = il.Tile(lambda u: np.abs(u[:, 2] - 0.4) - 0.2, tol=1.0)
    with pytest.warns(PrecisionWarning, match="32 spans"):
        il.tiles.mix(roof, "gyroid", seed=0, tol=1e-9).field((1, 1, 1), UNIT, CLOSED)


# ---------------------------------------------------------------- shared faces


@pytest.mark.parametrize("closed", [OPEN, CLOSED, (True, False, True)])
def test_shared_faces_are_continuous_with_a_crease_between_different_tiles(closed):
    cells = [[[0, 0]], [[1, 1]], [[0, 0]]]
    field = il.tiles.mix("gyroid", "diamond", cells=cells, blend=0).field((3, 1, 2), UNIT, closed)
    tiles = [il.tiles["gyroid"], il.tiles["diamond"]]
    scaled = [lambda q, t=t: t(q) / mean_slope(t.field) for t in tiles]
    q = points(300)
    for x, number in enumerate((0, 1, 0)):  # inside
        inner = (q * 0.7 + 0.15) + x * RIGHT
        np.testing.assert_allclose(field(inner), scaled[number](inner), atol=1e-3)
    for x, axis, crease in ((1.0, 0, True), (1.0, 2, False), (2.0, 0, True)):
        face = q * [2.0, 1.0, 1.0]
        face[:, axis] = x
        before = face.copy()
        before[:, axis] = np.nextafter(x, 0.0)
        (f, g), (f2, g2) = field.jet(before, 1), field.jet(face, 1)
        assert np.abs(f - f2).max() <= 1e-12
        assert (np.abs(g - g2).max() > 0.3) == crease
        if crease:
            mean = 0.5 * (scaled[0](face) + scaled[1](face))
            np.testing.assert_allclose(f2, mean, atol=1e-3)
    for axis in np.flatnonzero(closed):
        ends = [np.where(np.arange(3) == axis, end, q) for end in (0.0, (3.0, 1.0, 2.0)[axis])]
        np.testing.assert_allclose(*map(field, ends), atol=1e-12)


def test_shared_faces_tell_a_tolerance_that_is_not_met():
    with pytest.warns(PrecisionWarning, match="32 spans"):
        il.tiles.mix("gyroid", seed=0, tol=1e-9, blend=0).field((1, 1, 1), UNIT, CLOSED)


# ---------------------------------------------------------------- which tile is where


def test_cells_may_be_indices_names_tiles_or_a_function():
    gyroid, diamond = il.tiles["gyroid"], il.tiles["diamond"]
    board = np.indices((2, 2, 1)).sum(axis=0) % 2
    ways = [
        il.tiles.mix("gyroid", "diamond", cells=board),
        il.tiles.mix(cells=np.array(["gyroid", "diamond"])[board]),
        il.tiles.mix(cells=np.array([gyroid, diamond], dtype=object)[board]),
        il.tiles.mix(gyroid, diamond, cells=checkerboard),
        il.tiles.mix(cells=lambda i, j, k: "diamond" if (i + j + k) % 2 else gyroid),
    ]
    splines = [way.field((2, 2, 1), UNIT, CLOSED).spline.c for way in ways]
    for c in splines[1:]:
        np.testing.assert_array_equal(c, splines[0])
    other = il.tiles.mix("diamond", "gyroid", cells=board).field((2, 2, 1), UNIT, CLOSED)
    assert np.abs(other.spline.c - splines[0]).max() > 0.01


def test_a_seed_gives_the_same_lattice_again():
    def cells(seed, **more):
        return il.tiles.mix("gyroid", "diamond", "iwp", seed=seed, **more).cells((10, 10, 10))

    np.testing.assert_array_equal(cells(4), cells(4))
    assert (cells(4) != cells(5)).any()
    share = np.bincount(cells(4, probabilities=[1, 0, 3]).ravel(), minlength=3) / 1000
    assert share == pytest.approx([0.25, 0.0, 0.75], abs=0.06)
    assert np.bincount(cells(4).ravel()) / 1000 == pytest.approx([1 / 3] * 3, abs=0.06)


def test_mixtures_survive_pickling():
    mixture = il.tiles.hybrid("gyroid", "iwp", weight=il.tiles.sigmoid(1, 0.5, 0.2))
    again = pickle.loads(pickle.dumps(mixture))
    assert repr(again) == repr(mixture) == "Mixture(gyroid+iwp, by weights)"
    drawn = pickle.loads(pickle.dumps(il.tiles.mix("gyroid", "iwp", seed=1)))
    np.testing.assert_array_equal(
        drawn.cells((2, 2, 2)), il.tiles.mix("gyroid", "iwp", seed=1).cells((2, 2, 2))
    )


# ---------------------------------------------------------------- transitions


def test_a_hybrid_is_the_weighed_mean_of_its_tiles():
    tiles = [il.tiles[n] for n in ("gyroid", "diamond", "schwarz_p")]
    domain = np.array([[-1.0, 0.0, 0.0], [3.0, 1.0, 2.0]])
    weight = il.tiles.sigmoid(0, (0.0, 2.0), 0.5)
    mixture = il.tiles.hybrid(*tiles, weight=lambda u: 7.0 * weight(u))
    field = mixture.field((4, 1, 1), domain, OPEN)
    p = points(500) * [4, 1, 1]
    values = np.stack([t(np.mod(p, 1)) / mean_slope(t.field) for t in tiles], axis=1)
    expected = (weight(p * [1, 1, 2] + domain[0]) * values).sum(axis=1)
    np.testing.assert_allclose(field(p), expected, atol=1.5e-3)


def test_weights_go_on_smoothly_beyond_open_ends():
    mixture = il.tiles.hybrid("gyroid", "diamond", weight=lambda u: 0.3 + 0.4 * u[:, 0])
    tiles = tuple(Component.of(t) for t in mixture.tiles)
    blend = Blend(tiles, None, mixture.weight, 0.5, (2, 1, 1), UNIT, np.array(OPEN))
    p = points(50, -1, 0) * [1, 0, 0]
    np.testing.assert_allclose(blend.shares(p)[:, 1], 0.3 + 0.2 * p[:, 0], atol=1e-12)


def test_weights_wrap_around_closed_directions():
    tiles = tuple(Component.of(il.tiles[n]) for n in ("gyroid", "diamond"))
    blend = Blend(tiles, None, lambda u: u[:, 0] ** 2, 0.5, (2, 1, 1), UNIT, np.array(CLOSED))
    p = points(50)
    shares = blend.shares(p)
    np.testing.assert_allclose(shares[:, 1], (p[:, 0] / 2) ** 2, atol=1e-12)
    for turns in (-2.0, 2.0):
        np.testing.assert_allclose(blend.shares(p + turns * RIGHT), shares, atol=1e-12)


def test_sigmoids_add_up_to_one_and_have_the_stated_width():
    s = il.tiles.sigmoid(2, 0.4, 0.2)
    u = np.zeros((5, 3))
    u[:, 2] = [0.3, 0.4 - 1e-6, 0.4, 0.4 + 1e-6, 0.5]
    w = s(u)
    assert w[2] == 0.5
    assert (w[3] - w[1]) / 2e-6 == pytest.approx(1 / 0.2, rel=1e-6)
    assert w[[0, 4]] == pytest.approx([0.12, 0.88], abs=1e-3)
    three = il.tiles.sigmoid(0, (0.2, 0.6), 0.1)(points(50))
    np.testing.assert_allclose(three.sum(axis=1), 1, atol=1e-15)
    assert three.min() >= 0
    ends = il.tiles.sigmoid(0, (0.2, 0.6), 0.1)([[0.4, 0, 0], [1.0, 0, 0]])
    np.testing.assert_allclose(ends, [[3.35e-4, 0.99933, 3.35e-4], [0, 0, 1]], atol=1e-6)


# ---------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: il.tiles.mix("gyroide", seed=1), "near names: .*gyroid"),
        (lambda: il.tiles.mix(3, seed=1), "tiles must be Tiles or names"),
        (lambda: il.tiles.mix("gyroid"), "cells or seed must be given"),
        (lambda: il.tiles.mix("gyroid", cells=checkerboard, seed=1), "and not both"),
        (lambda: il.tiles.mix(seed=1), "tiles must be given"),
        (lambda: il.tiles.mix("gyroid", seed=-1), "seed must be"),
        (lambda: il.tiles.mix("gyroid", seed=True), "seed must be"),
        (lambda: il.tiles.mix("gyroid", seed=1, probabilities=[1, 1]), "must be 1 numbers"),
        (lambda: il.tiles.mix("gyroid", "iwp", seed=1, probabilities=[2, -1]), "negative"),
        (lambda: il.tiles.mix("gyroid", "iwp", seed=1, probabilities=[0, 0]), "not all zero"),
        (lambda: il.tiles.mix("gyroid", cells=checkerboard, probabilities=[1]), "with a random"),
        (lambda: il.tiles.mix("gyroid", seed=1, blend=1.2), "blend must be one number from 0"),
        (lambda: il.tiles.mix("gyroid", seed=1, blend=-0.1), "blend must be one number from 0"),
        (lambda: il.tiles.mix("gyroid", seed=1, blend=[0.1, 0.2]), "blend must be one number"),
        (lambda: il.tiles.mix("gyroid", seed=1, tol=-1), "tol must be"),
        (lambda: il.tiles.mix("gyroid", cells=[[0], [1, 2]]), "cells must be an array"),
        (lambda: il.tiles.hybrid("gyroid", weight=checkerboard), "at least two"),
        (lambda: il.tiles.hybrid("gyroid", "iwp", weight=0.5), "weight must be a function"),
        (lambda: il.tiles.sigmoid(3, 0.5, 0.1), "axis must be"),
        (lambda: il.tiles.sigmoid(0, (0.5, 0.4), 0.1), "centre must be ascending"),
        (lambda: il.tiles.sigmoid(0, 0.5, 0.0), "width must be"),
    ],
)
def test_bad_mixtures_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        (np.zeros((1, 2, 1), int), r"shape \(2, 1, 1\) as repeat, got shape \(1, 2, 1\)"),
        ([[[0]], [[2]]], r"cells\[1, 0, 0\] is tile number 2, but there are 2"),
        ([[[0]], [[-1]]], "tile number -1"),
        ([[[0.0]], [[1.0]]], "must be an index, a name or a Tile, got .*0.0"),
        (np.array([[["gyroid"]], [["diamonds"]]]), "near names: .*diamond"),
        (lambda *_: None, "got None"),
    ],
)
def test_bad_cells_are_refused(cells, message):
    mixture = il.tiles.mix("gyroid", "iwp", cells=cells)
    with pytest.raises(InputError, match=message):
        mixture.field((2, 1, 1), UNIT, OPEN)


@pytest.mark.parametrize(
    ("weight", "closed", "message"),
    [
        (lambda u: u, OPEN, r"one column per tile, shape .*, 2\)"),
        (lambda u: u[:, :1], OPEN, "got .*, 1"),
        (lambda u: np.zeros((len(u), 2)), OPEN, "not all vanish; at u ="),
        (lambda u: 2 * u[:, 0], OPEN, "shares between 0 and 1"),
        (lambda u: np.full(len(u), np.nan), OPEN, "finite weights"),
        (il.tiles.sigmoid(1, 0.5, 0.1), CLOSED, "direction 1, which is closed"),
    ],
)
def test_bad_weights_are_refused(weight, closed, message):
    mixture = il.tiles.hybrid("gyroid", "iwp", weight=weight)
    with pytest.raises(InputError, match=message):
        mixture.field((2, 1, 1), UNIT, closed)


@pytest.mark.parametrize("closed", [OPEN, CLOSED, (True, False, True)])
def test_splines_that_agree_on_faces_in_values_and_slopes_are_joined_smoothly(closed):
    rng = np.random.default_rng(5)
    shared, n = rng.normal(size=(9, 9, 9)), 6
    for axis in range(3):  # it repeats: equal values, and no slope, on all faces
        c = np.moveaxis(shared, axis, 0)
        c[1], c[-2], c[-1] = c[0], c[0], c[0]
    knots = np.concatenate([[0.0] * 3, np.arange(n + 1) / n, [1.0] * 3])
    tiles = []
    for _ in range(2):
        c = shared.copy()
        c[2:-2, 2:-2, 2:-2] = rng.normal(size=(5, 5, 5))
        tiles.append(il.Tile(il.BSpline([knots] * 3, c, 3)))
    cells = [[[0, 1]], [[1, 1]], [[0, 0]]]
    field = il.tiles.mix(*tiles, cells=cells, blend=0).field((3, 1, 2), UNIT, closed)
    assert not field.creased
    q = points(200)
    ratio = field(q[:1] * 0.5 + 0.2) / tiles[0](q[:1] * 0.5 + 0.2)
    for at in np.ndindex(3, 1, 2):
        mine = tiles[cells[at[0]][at[1]][at[2]]]
        np.testing.assert_allclose(field(q + at), ratio * mine(q), atol=1e-12)
    for axis, x in ((0, 1.0), (0, 2.0), (2, 1.0)):
        face = q * [3.0, 1.0, 2.0]
        face[:, axis] = x
        before = face.copy()
        before[:, axis] = np.nextafter(x, 0.0)
        assert np.abs(field.jet(before, 1)[1] - field.jet(face, 1)[1]).max() < 1e-10
    for axis, end in enumerate((3.0, 1.0, 2.0)):
        ends = [np.where(np.arange(3) == axis, x, q) for x in (0.0, end)]
        a, b = (np.column_stack(field.jet(x, 1)) for x in ends)
        assert np.abs(a - b).max() < 1e-10
    other = il.BSpline([knots] * 3, rng.normal(size=(9, 9, 9)), 3)  # of other values there
    assert (
        il.tiles.mix(tiles[0], il.Tile(other), cells=cells, blend=0, tol=100.0)
        .field((3, 1, 2), UNIT, OPEN)
        .creased
    )
