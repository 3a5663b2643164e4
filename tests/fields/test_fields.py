"""Fields as compiled programs: values by hand, derivatives, bounds, boxes, meshes."""

import numpy as np
import pytest
from conformance import check_field, check_range
from scipy.spatial import cKDTree

import ilattice as il
from ilattice.errors import InputError
from ilattice.fields import _kernels_program as kernels

F = il.fields

BOX = np.array([[-1.7, -1.6, -1.8], [1.5, 1.9, 1.6]])
NEAR = np.array([[0.55, 0.72, 0.61], [0.65, 0.82, 0.71]])
BALL = F.translate(F.sphere(0.9), (0.2, -0.1, 0.3))
RING = F.rotate(F.torus(1.0, 0.3), 0.7, (1, 2, 3))


class Elsewhere:
    """A field without a formula, but with all else."""

    def __init__(self, field):
        self.jet, self.range, self.call = field.jet, field.range, field.__call__

    def __call__(self, p):
        return self.call(p)


WAVE = F.from_callable(Elsewhere(il.tiles["gyroid"].field))
ZOO = {
    "sphere": BALL,
    "box": F.box((0.9, 0.7, 0.5)),
    "cylinder": F.cylinder(0.6),
    "half_space": F.half_space((1, 2, -1), 0.3),
    "torus": RING,
    "capsule": F.capsule((0, 0, -0.5), (0.6, 0.4, 0.5), 0.3),
    "union": F.union(BALL, RING),
    "blend": F.union(BALL, RING, F.box(0.5), radius=0.3),
    "intersection": F.intersection(BALL, RING),
    "difference": F.difference(F.box(1.0), BALL, radius=0.2),
    "shell": F.shell(BALL, 0.2),
    "graded": F.shell(BALL, F.dilate(F.half_space((1, 0, 0)), 2.0)),
    "erode": F.erode(F.complement(BALL), 0.1),
    "scale": F.scale(BALL, (1.0, -2.0, 0.5)),
    "twist": F.twist(F.translate(F.box(0.6), (0.4, 0, 0)), 1.3),
    "cone": F.translate(F.cone(0.9, 1.7), (0.1, 0, 0.2)),
    "bend": F.bend(F.translate(F.box((0.9, 0.3, 0.4)), (0.1, 0, 0)), 0.8),
    "cylindrical": F.cylindrical(F.translate(F.sphere(0.3), (0.8, 0, 0)), 1),
    "mix": F.mix(BALL, RING, F.equation("1/(1 + exp(-3*x))")),
    "repeat": F.repeat(F.sphere(0.3), 0.8),
    "normalize": F.normalize(F.scale(F.torus(1.0, 0.3), (1, 2, 1))),
    "outside": F.intersection(F.translate(WAVE, (0.1, 0.2, 0.3)), F.box(1.0)),
}
KINKED = {
    "box",
    "shell",
    "graded",
    "union",
    "intersection",
    "difference",
    "repeat",
    "capsule",
    "cone",
    "bend",
}


def _naive(points):
    p = points - [0.2, -0.1, 0.3]
    return np.linalg.norm(p, axis=1) - 0.9


@pytest.mark.parametrize("name", ZOO)
def test_every_field_keeps_its_promises(name):
    rng = np.random.default_rng(7)
    box = NEAR if name in KINKED else BOX
    check_field(ZOO[name], rng, box=box, points=60, rtol=1e-4, exact=name != "outside")
    check_range(ZOO[name], rng, BOX, converges=False)


def test_operations_are_what_their_formulas_say():
    p = np.random.default_rng(1).uniform(-2, 2, (300, 3))
    f, g = _naive(p), RING(p)
    np.testing.assert_allclose(BALL(p), f, atol=1e-14)
    np.testing.assert_array_equal(F.union(BALL, RING)(p), np.minimum(BALL(p), g))
    np.testing.assert_array_equal(F.difference(BALL, RING)(p), np.maximum(BALL(p), -g))
    np.testing.assert_allclose(F.shell(BALL, 0.2)(p), abs(f) - 0.1, atol=1e-14)
    np.testing.assert_allclose(F.dilate(BALL, 0.2)(p), f - 0.2, atol=1e-14)
    np.testing.assert_allclose(F.erode(BALL, 0.2)(p), f + 0.2, atol=1e-14)
    a = np.array([1.0, -2.0, 0.5])
    np.testing.assert_allclose(F.scale(BALL, a)(p), 0.5 * _naive(p / a), atol=1e-14)


def _many(rng, count):
    """Balls, their union with other things, and its values from theirs alone."""
    balls = [
        F.translate(F.sphere(r), c)
        for r, c in zip(rng.uniform(0.05, 0.2, count), rng.uniform(-1, 1, (count, 3)), strict=True)
    ]
    third = count // 3
    drilled = [
        F.difference(F.union(a, b), c)
        for a, b, c in zip(balls[:third], balls[third : 2 * third], balls[2 * third :], strict=True)
    ]
    tree = F.union(*drilled, F.shell(F.union(*balls[:7]), 0.02), F.intersection(*balls[3:5]))

    def values(p):
        v = np.stack([ball(p) for ball in balls])
        parts = np.maximum(np.minimum(v[:third], v[third : 2 * third]), -v[2 * third :])
        shell = np.abs(v[:7].min(axis=0)) - 0.5 * 0.02
        return np.minimum(np.minimum(parts.min(axis=0), shell), v[3:5].max(axis=0))

    return tree, values


def test_what_is_left_out_of_a_deep_tree_does_not_matter():
    """Exactly: in points far and near, in any order, and derivatives from both sides."""
    rng = np.random.default_rng(3)
    tree, values = _many(rng, 90)
    near = [c + 0.1 * rng.uniform(-1, 1, (300, 3)) for c in rng.uniform(-1, 1, (12, 3))]
    p = np.concatenate([*near, rng.uniform(-3, 3, (2000, 3))])
    for q in (p, rng.permutation(p), p[:7]):
        np.testing.assert_array_equal(tree(q), values(q))
    q, e = p[:200], 1e-7
    slopes = [(values(q + e * d) - values(q - e * d)) / (2 * e) for d in np.eye(3)]
    f, g = tree.jet(q, 1)
    np.testing.assert_array_equal(f, values(q))
    assert (np.abs(g - np.stack(slopes, axis=1)).max(axis=1) < 1e-5).mean() > 0.98  # but at kinks
    np.testing.assert_allclose(tree.jet(q, 2)[1], g, atol=1e-12)


def test_solids_out_of_reach_are_left_out_wherever_they_are_in_the_tree():
    tree, _ = _many(np.random.default_rng(3), 90)
    program = tree.program
    codes, numbers, lengths, w, maps = kernels.begin(*program._args, 2)
    box = np.array([[0.1] * 3, [0.15] * 3])
    kernels.narrow(codes, numbers, lengths, 0, box, w, maps)
    assert lengths[1] < len(program.code) / 10


def test_a_cone_is_a_distance():
    """Against the least distance to many points of its surface."""
    rng = np.random.default_rng(9)
    t, turn = np.sqrt(rng.uniform(0, 1, 400_000)), rng.uniform(0, 2 * np.pi, 400_000)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1) * 0.7 * t[:, None]
    base, mantle = np.full(len(t), -0.6), 0.6 - 1.2 * t
    points = np.concatenate([np.column_stack([ring, z]) for z in (base, mantle)])
    p = rng.uniform(-1.5, 1.5, (300, 3))
    f = F.cone(0.7, 1.2)(p)
    np.testing.assert_allclose(np.abs(f), cKDTree(points).query(p)[0], atol=2e-2, rtol=2e-3)
    r, (lower, upper) = np.hypot(p[:, 0], p[:, 1]), (p[:, 2] > -0.6, p[:, 2] < 0.6)
    np.testing.assert_array_equal(f < 0, lower & upper & (r < 0.7 * (0.6 - p[:, 2]) / 1.2))


@pytest.mark.parametrize("solid", [F.box((1.0, 0.5, 2.0)), F.cone()])
def test_normals_of_the_surface_have_length_one(solid):
    p = [[1.0, 0.2, 0.3], [0.3, 0.1, -1.0], [-0.1, 0.5, 0.9], [0.2, -0.2, 2.0], [0.0, 0.5, 0.0]]
    on = np.array(p)[solid(p) == 0.0]
    assert len(on) >= 1
    np.testing.assert_allclose(np.linalg.norm(solid.jet(on, 1)[1], axis=1), 1.0, atol=1e-12)


def test_bending_keeps_lengths_along_the_circle():
    bar = F.bend(F.translate(F.sphere(0.1), (0.5 * np.pi * 2.0, 0.0, 0.0)), 2.0)
    np.testing.assert_allclose(bar([[2.0, 2.0, 0.0]]), -0.1, atol=1e-14)


def test_cylindrical_coordinates_repeat_a_tile_around_the_axis():
    f = F.cylindrical(F.from_callable(il.tiles["gyroid"]), 12)
    r, turn, z = np.random.default_rng(3).uniform(0.1, 2.0, (3, 50))
    p = np.column_stack([r * np.cos(turn), r * np.sin(turn), z])
    u = np.column_stack([r, 12 * turn / (2 * np.pi), z])
    np.testing.assert_allclose(f(p), il.tiles["gyroid"].field(u), atol=1e-12)


def test_mixtures_are_what_they_mix_where_the_weight_says_so():
    f = F.mix(BALL, RING, F.equation("2*x"))
    p = np.random.default_rng(3).uniform(-2, 2, (300, 3))
    w = np.clip(2 * p[:, 0], 0, 1)
    np.testing.assert_allclose(f(p), (1 - w) * BALL(p) + w * RING(p), atol=1e-14)


def test_rotation_turns_the_solid_by_the_right_hand_rule():
    moved = F.rotate(F.translate(F.sphere(0.1), (1, 0, 0)), np.pi / 2, (0, 0, 5))
    assert moved([[0.0, 1.0, 0.0]])[0] == pytest.approx(-0.1)


def test_normalized_fields_have_unit_gradients_on_the_surface():
    f = F.normalize(F.scale(F.sphere(), (1.0, 2.0, 0.5)))
    rng = np.random.default_rng(2)
    u = rng.normal(size=(50, 3))
    p = u / np.linalg.norm(u, axis=1)[:, None] * [1.0, 2.0, 0.5]
    np.testing.assert_allclose(np.linalg.norm(f.jet(p, 1)[1], axis=1), 1.0, atol=1e-9)


def test_normalized_boxes_have_second_derivatives_inside():
    p = np.random.default_rng(0).uniform(-0.45, 0.45, (100, 3))
    solids = F.box(1.0), F.dilate(F.box(1.0), 0.1), F.shell(F.box(1.0), 0.1), F.scale(F.box(1.0), 2)
    for solid in solids:
        np.testing.assert_array_equal(F.normalize(solid).jet(p, 2)[2], np.zeros((100, 3, 3)))


@pytest.mark.parametrize("level", [-0.2, 0.0, 0.3])
@pytest.mark.parametrize("name", ZOO)
def test_boxes_hold_their_level_sets(name, level):
    p = np.random.default_rng(3).uniform(-4, 4, (4000, 3))
    box = ZOO[name].bounding_box(level)
    inside = p[ZOO[name](p) <= level]
    assert ((inside >= box[0] - 1e-12) & (inside <= box[1] + 1e-12)).all()


def test_boxes_are_those_of_the_solids():
    np.testing.assert_allclose(F.dilate(F.box(1.0), 0.5).bounds, [[-1.5] * 3, [1.5] * 3])
    np.testing.assert_allclose(
        F.scale(F.dilate(F.sphere(), 0.5), (1, 2, 4)).bounds, [[-1.5, -3, -6], [1.5, 3, 6]]
    )
    assert np.isinf(F.cylinder().bounds[:, 2]).all()
    assert np.isfinite(F.intersection(F.cylinder(), F.box()).bounds).all()


def test_pruned_and_plain_evaluation_agree_to_the_bit(monkeypatch):
    rng = np.random.default_rng(4)
    parts = [F.translate(F.sphere(0.2), rng.uniform(-1, 1, 3)) for _ in range(60)]
    p = np.sort(rng.uniform(-1.5, 1.5, (3000, 3)), axis=0)
    many = F.union(*parts)
    assert many.program.prune
    expected = np.min([part(p) for part in parts], axis=0)
    np.testing.assert_array_equal(many(p), expected)
    jets = many.jet(p, 1)[1]
    monkeypatch.setattr(type(many.program), "prune", property(lambda _: False))
    np.testing.assert_array_equal(many(p), expected)
    np.testing.assert_array_equal(many.jet(p, 1)[1], jets)


def test_contours_are_closed_and_have_the_volume():
    axes = [np.linspace(-1.0, 1.0, 41)] * 3
    part = F.difference(F.box(1.5), F.cylinder(0.5))
    mesh = il.mesh.contour(part, axes)
    assert mesh.is_watertight
    assert mesh.genus == 1
    assert mesh.volume == pytest.approx(8 - 2 * np.pi * 0.25, rel=5e-3)


def test_a_field_works_as_a_tile():
    tile = il.Tile(F.translate(F.sphere(0.4), (0.5, 0.5, 0.5)))
    assert tile([[0.5, 0.5, 0.5]])[0] == pytest.approx(-0.4)


@pytest.mark.parametrize(
    "make",
    [
        lambda: F.sphere(-1.0),
        lambda: F.shell(F.sphere(), -0.1),
        lambda: F.scale(F.sphere(), (1, 0, 1)),
        lambda: F.rotate(F.sphere(), 1.0, (0, 0, 0)),
        lambda: F.translate(F.sphere(), (1, np.nan, 0)),
        lambda: F.cone(0.0),
        lambda: F.bend(F.sphere(), -1.0),
        lambda: F.cylindrical(F.sphere(), 1.5),
        lambda: F.mix(F.sphere(), F.sphere(), 0.5),
        lambda: F.union(),
        lambda: F.union(F.sphere(), 3.0),
        lambda: F.half_space((0, 0, 0)),
        lambda: F.capsule((0, 0, 0), (0, 0, 0), 1.0),
        lambda: F.from_callable(3),
        lambda: F.from_callable(np.sin, bounds=[0, 1]),
        lambda: F.normalize(F.from_callable(_naive)).program,
        lambda: F.from_callable(lambda _: np.zeros(2))([[0.0, 0.0, 0.0]]),
    ],
)
def test_bad_input_is_refused(make):
    with pytest.raises(InputError):
        make()
