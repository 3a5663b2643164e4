"""Every class of fields, found by the base, against itself; and combinations of all of them."""

import importlib
import pkgutil

import numpy as np
import pytest
from conformance import (
    away_from_kinks,
    check_derivatives,
    check_grid,
    check_range,
    check_values,
)

import ilattice as il
from ilattice._field import Field, owns
from ilattice.errors import InputError
from ilattice.fields.algebra import _Everywhere
from ilattice.graph.body import SetField
from ilattice.offsets.scattered import Scattered
from ilattice.offsets.sharp import SharpDistance
from ilattice.offsets.solid import TileField
from ilattice.offsets.thickness import AskedSide
from ilattice.quadrature.levelsets import _Negative

F = il.fields
BOX = np.array([[-1.1, -1.2, -0.9], [1.0, 1.3, 1.2]])
BALL = F.translate(F.sphere(0.9), (0.2, -0.1, 0.3))
RING = F.rotate(F.torus(1.0, 0.3), 0.7, (1, 2, 3))
BAR = F.translate(F.box((0.9, 0.3, 0.4)), (0.1, 0.05, 0))


def smooth(p):
    """A function that tells nothing of itself."""
    p = np.asarray(p, np.float64)
    return np.sin(p[:, 0]) * np.cos(2.0 * p[:, 1]) + 0.3 * p[:, 2] ** 2 - 0.2


def bent():
    return il.macroshape.hexahedron(
        [[0, 0, 0], [1, 0, 0], [1.1, 1, 0], [0, 1, 0.1], [0, 0, 1.2], [1, 0.2, 1], [1.3, 1.1, 1.2],
         [0.1, 1, 1]]
    )  # fmt: skip


def lattice(tile="schwarz-p", **options):
    return il.Lattice(tile, through=il.macroshape.box((1, 1.2, 0.8)), **options)


def spline():
    t = il.bspline.knots.uniform_knots
    c = np.random.default_rng(3).normal(size=(7, 6, 5))
    return il.BSpline([t(5, 2, (-1, 1)), t(3, 3, (0, 1)), t(2, 3, (0, 3))], c, (2, 3, 3))


def sharp():
    cell = lattice(spans_per_tile=8)
    wall = cell.offset(0.1)
    return SharpDistance(cell, wall.distance, wall.thickness)


def scatter():
    rng = np.random.default_rng(5)
    return Scattered(lattice(), rng.random((30, 3)) * (1, 1.2, 0.8), 1.0 + rng.random(30))


def mesh_distance():
    axes = [np.linspace(-1, 1, 14)] * 3
    return il.sdf.MeshDistance(il.mesh.contour(F.sphere(0.8), axes))


STRUTS = [[(0, 0.5, 0.5), (1, 0.5, 0.5)], [(0.5, 0, 0.5), (0.5, 1, 0.5)]]


def bars_in_box():
    cross = il.tiles.skeleton(STRUTS, radius=0.2, faces="periodic")
    return lattice(cross, repeat=2).offset((np.inf, 0)).bars()


def sets():
    ball = il.tiles.SkeletonField([il.tiles.Ball((0.5, 0.5, 0.5), 0.35)], faces="periodic")
    return SetField((ball, il.tiles.skeleton(STRUTS, radius=0.2, faces="periodic").field), "union")


def asked_side():
    spline = il.bspline.fit.fit(smooth, degree=3, spans=16)
    return AskedSide(spline, spline)


#: Class -> a field of it; where it is tried, and what it does not promise.
EXAMPLES = {
    "BSpline": (spline, {}),
    "_Complement": (lambda: F.complement(BALL), {"box": BOX}),
    "_Everywhere": (_Everywhere, {}),
    "_Extreme": (lambda: F.union(BALL, RING), {"box": BOX, "kinks": True}),
    "_Mixed": (lambda: F.mix(BALL, RING, F.equation("1/(1 + exp(-3*x))")), {"box": BOX}),
    "_Normalized": (
        lambda: F.normalize(F.scale(BALL, (1, 2, 1))), {"box": BOX, "converges": False},
    ),
    "_Offset": (lambda: F.dilate(BALL, 0.1), {"box": BOX}),
    "_Placed": (lambda: F.rotate(BALL, 0.3, (1, 2, 3)), {"box": BOX}),
    "_Bent": (lambda: F.bend(BAR, 0.8), {"box": BOX, "kinks": True}),
    "_Cylindrical": (lambda: F.cylindrical(BALL, 1), {"box": BOX, "kinks": True}),
    "_Repeat": (lambda: F.repeat(F.sphere(0.3), 0.8), {"box": BOX, "kinks": True}),
    "_Twist": (lambda: F.twist(BALL, 1.3), {"box": BOX, "converges": False}),
    "_Equation": (lambda: F.equation("sin(x) + y*z - 0.2"), {"box": BOX}),
    "Leaf": (
        lambda: F.from_callable(smooth), {"box": BOX, "differences": True, "converges": False},
    ),
    "_Box": (lambda: F.box((0.9, 0.7, 0.5)), {"box": BOX, "kinks": True}),
    "_Capsule": (lambda: F.capsule((0, 0, -0.5), (0.6, 0.4, 0.5), 0.3), {"box": BOX}),
    "_Cone": (lambda: F.cone(0.9, 1.7), {"box": BOX, "kinks": True}),
    "_Cylinder": (lambda: F.cylinder(0.6), {"box": BOX}),
    "_HalfSpace": (lambda: F.half_space((1, 2, -1), 0.3), {"box": BOX}),
    "_Sphere": (lambda: F.sphere(0.7), {"box": BOX}),
    "_Torus": (lambda: F.torus(1.0, 0.3), {"box": BOX}),
    "PulledBack": (lambda: F.pull_back(BALL, bent()).f, {"converges": False}),
    "AskedSide": (asked_side, {"box": ((0, 0, 0), (1, 1, 1)), "converges": False}),
    "_Distance": (lambda: il.offsets.distance(BALL, seeds=24), {"box": BOX, "converges": False}),
    "Scattered": (scatter, {"box": ((0, 0, 0), (1, 1, 1)), "differences": True}),
    "SharpDistance": (sharp, {"kinks": True, "converges": False}),
    "TileField": (lambda: TileField(lattice()), {"converges": False}),
    "BarsInBox": (bars_in_box, {"kinks": True}),
    "SetField": (sets, {"kinks": True}),
    "WallField": (lambda: lattice(spans_per_tile=8).offset(0.1).field, {"kinks": True}),
    "_Negative": (lambda: _Negative(smooth), {"box": BOX, "differences": True}),
    "MeshDistance": (mesh_distance, {"box": BOX, "kinks": True, "converges": False}),
    "MixedField": (
        lambda: lattice(il.tiles.mix("gyroid", "diamond", seed=1), repeat=2).smooth_tile, {},
    ),
    "TileNode": (lambda: il.tiles["gyroid"].node, {"box": BOX}),
    "TrigNode": (lambda: il.tiles["gyroid"].field.node, {"box": BOX}),
    "FlattenedField": (
        lambda: il.tiles.skeleton(STRUTS, radius=0.2).field.flattened(), {"kinks": True},
    ),
    "Beams": (
        lambda: il.cost.kagome(2).beams(0.05), {"box": BOX, "kinks": True, "converges": False},
    ),
    "BoxSpline": (
        lambda: il.cost.boxspline.field(il.cost.kagome(2)), {"box": BOX, "converges": False},
    ),
    "_BeamDistance": (
        lambda: il.cost.kagome(2).beams(0.05).part((0, 0, 2)),
        {"box": BOX, "kinks": True, "converges": False},
    ),
    "_BeamQuadric": (lambda: il.cost.kagome(2).beams(0.05).part((1, 0)), {"box": BOX}),
    "SkeletonField": (lambda: il.tiles.skeleton(STRUTS, radius=0.2).field, {"kinks": True}),
    "Tile": (lambda: il.tiles["gyroid"], {}),
    "TrigField": (lambda: il.tiles["gyroid"].field, {}),
}  # fmt: skip
#: Fields of which derivatives are no limits of differences: those of a spline, where values are
#: exact.
WITHOUT_DERIVATIVES = ("SharpDistance",)


def classes():
    """All classes of fields of the package, by the base."""
    for module in pkgutil.walk_packages(il.__path__, "ilattice."):
        if module.name != "ilattice.__main__":
            importlib.import_module(module.name)
    found, left = set(), [Field]
    while left:
        new = [c for c in left.pop().__subclasses__() if c.__module__.startswith("ilattice")]
        found.update(new)
        left += new
    return {c.__name__ for c in found}


def test_no_class_of_fields_is_forgotten():
    assert classes() == set(EXAMPLES) | {
        "Node",
        "Stackable",
        "Union",
        "Whole",
    }  # which are bases, too


@pytest.mark.parametrize("name", EXAMPLES)
def test_fields_keep_what_they_promise(name):
    make, options = EXAMPLES[name]
    field, rng = make(), np.random.default_rng(8)
    assert type(field).__name__ == name
    if name == "_Everywhere":
        return
    box = np.asarray(options.get("box", field.bounds), float)
    p = rng.uniform(box[0] + 1e-3, box[1] - 1e-3, (40, 3))
    check_values(field, p, exact=False)
    for bad in (np.zeros(3), np.zeros((2, 2)), np.full((1, 3), np.nan)):
        with pytest.raises(InputError):
            field(bad)
    if name not in WITHOUT_DERIVATIVES:
        q = away_from_kinks(field, p, box) if "kinks" in options else p
        assert len(q) >= 20
        check_derivatives(field, q, box, 1e-4 if "differences" in options else 1e-5)
    check_range(field, rng, box, converges=options.get("converges", owns(field, "range")))
    check_grid(field, rng, box)
    assert np.asarray(field.bounds).shape == (2, 3)
    assert field.lipschitz > 0.0
    r = 1e-4 * (box[1] - box[0])
    assert np.isfinite(field.range(p - r, p + r)).all() == field.bounded


class Plain(Field):
    """A field of its values alone."""

    def __call__(self, p):
        return smooth(il._validate.as_points("p", p))


def test_a_field_of_its_values_alone_has_the_rest_by_default():
    field, rng = Plain(), np.random.default_rng(3)
    assert not any(field.has(name) for name in ("jet", "grid", "range", "bounds", "lipschitz"))
    p = rng.uniform(*BOX, (50, 3))
    _, g, h = field.jet(p)
    x, y, z = p.T
    slope = np.stack([np.cos(x) * np.cos(2 * y), -2 * np.sin(x) * np.sin(2 * y), 0.6 * z], axis=1)
    np.testing.assert_allclose(g, slope, rtol=0, atol=1e-7)
    np.testing.assert_allclose(h[:, 0, 1], -2 * np.cos(x) * np.sin(2 * y), rtol=0, atol=1e-6)
    check_grid(field, rng, BOX)
    assert np.isinf(field.range(p - 0.1, p + 0.1)).all()
    assert field.sums() is None
    for bad in (-1, 3):
        with pytest.raises(InputError, match="order must be"):
            field.jet(p, bad)


def test_what_is_the_largest_of_sums_of_splines_is_cut_as_these():
    class Both(Plain):
        def sums(self):
            return (spline(),), np.array([[1.0], [-1.0]])

    assert Both().has("sums")
    assert il.cutfem.cut(Both(), 4).sets.exact
    assert not il.cutfem.cut(Plain(), 4, domain=BOX).sets.exact


@pytest.mark.parametrize("wrapper", [il.tiles.Tile, F.from_callable])
def test_wrappers_have_what_their_field_has(wrapper):
    known, unknown = wrapper(il.tiles["gyroid"].field), wrapper(smooth)
    for name in ("jet", "range"):
        assert known.has(name)
        assert not unknown.has(name)
    assert unknown.has("bounding_box") == (wrapper is not il.tiles.Tile)
    p = np.random.default_rng(7).random((9, 3))
    np.testing.assert_array_equal(unknown.range(p, p + 0.1), [[-np.inf, np.inf]] * 9)
    check_range(known, np.random.default_rng(7), np.array([[0.0] * 3, [1.0] * 3]), False)


def test_what_wraps_a_plain_function_may_hide_as_much_as_the_function():
    box = [[-1] * 3, [1] * 3]
    leaf = F.from_callable(smooth)
    turned = F.rotate(leaf, 0.4, (1, 2, 3))
    held = F.pull_back(leaf, il.macroshape.box())
    for f in (smooth, leaf, turned, F.union(F.sphere(0.3), leaf), F.from_callable(turned)):
        assert il.cutfem.cut(f, 4, domain=box).unseen > 0.0
    assert il.cutfem.cut(held, 4, domain=[[0] * 3, [1] * 3]).unseen > 0.0
    assert il.cutfem.cut(F.sphere(0.3), 4, domain=box).unseen == 0.0


def test_a_lipschitz_constant_gives_bounds():
    class Steep(Plain):
        lipschitz = 3.0

    check_range(Steep(), np.random.default_rng(4), BOX, converges=False)


def close(a, b):
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-13)


def test_spline_distances_that_are_exact_at_kinks_have_the_derivatives_of_the_spline():
    field = sharp()
    p = np.random.default_rng(8).uniform(*field.domain, (200, 3))
    assert (field(p) != field.spline(p)).any()
    for mine, same in zip(field.jet(p)[1:], field.spline.jet(p)[1:], strict=True):
        np.testing.assert_array_equal(mine, same)


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_combinator_takes_every_field(name):
    """Two of everything, with a ball: the values are those of the parts, point by point."""
    make, options = EXAMPLES[name]
    field = make()
    box = BOX if name == "_Everywhere" else np.asarray(options.get("box", field.bounds), float)
    p = np.random.default_rng(6).uniform(box[0] + 1e-3, box[1] - 1e-3, (60, 3))
    f, ball = field(p), BALL(p)
    close(F.intersection(field, BALL)(p), np.maximum(f, ball))
    close(F.union(BALL, field)(p), np.minimum(f, ball))
    close(F.complement(field)(p), -f)
    if name != "_Everywhere":
        close(F.shell(field, 0.2)(p), np.abs(f) - 0.1)
    bounds = F.intersection(field, BALL).range(p, p)
    assert (bounds[:, 0] <= np.maximum(f, ball) + 1e-12).all()
    assert (bounds[:, 1] >= np.maximum(f, ball) - 1e-12).all()


def test_the_shell_of_a_distance_to_a_mesh_is_as_thick_as_asked():
    """Volume between the spheres of radii 0.7 and 0.9, up to the triangles."""
    axes = [np.linspace(-1.1, 1.1, 45)] * 3
    ball = il.mesh.contour(F.sphere(0.8), axes)
    mesh = il.mesh.contour(F.shell(il.sdf.MeshDistance(ball), 0.2), axes)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * (0.9**3 - 0.7**3), rel=5e-3)


def test_a_wall_is_cut_by_a_sphere_of_space():
    """Wall inside of a sphere and wall outside of it are the wall."""
    through = bent()
    wall = il.Lattice("schwarz-p", through=through, spans_per_tile=8).offset(0.1)
    ball = F.pull_back(F.translate(F.sphere(0.5), (0.5, 0.5, 0.5)), through)
    parts = F.intersection(wall.field, ball), F.intersection(wall.field, F.complement(ball))
    inside, outside = (
        il.cutfem.cut(part, 10, through=through).volume(3).in_space().integrate() for part in parts
    )
    assert inside > 0.1 * wall.volume()
    assert outside > 0.1 * wall.volume()
    assert inside + outside == pytest.approx(wall.volume(), rel=3e-3)


def test_what_is_no_field_is_refused():
    with pytest.raises(InputError, match="must be a field"):
        F.shell(smooth, 0.1)
    with pytest.raises(InputError, match="three coordinates"):
        F.complement(il.BSpline([[0.0, 1.0]], [1.0], 0))
    with pytest.raises(InputError, match="through must be a map"):
        F.pull_back(BALL, smooth)


# --- solids, and what of them lies in boxes -------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_what_is_clipped_is_in_the_part_and_in_the_box(seed):
    rng = np.random.default_rng(seed)
    ends = np.sort(rng.normal(size=(2, 3)), axis=0) * (1.0, 3.0, 0.5)
    ends[rng.random((2, 3)) < 0.3] *= np.inf
    points = 2.0 * rng.normal(size=(500, 3))
    inside = ((points > ends[0]) & (points < ends[1])).all(axis=1)
    whole = F.rotate(F.cylinder(0.9), 0.4, (1, 2, 3))
    part = F.clipped(whole, ends)
    np.testing.assert_array_equal(part(points) < 0, inside & (whole(points) < 0))


@pytest.mark.parametrize("bounds", [[[0, 0, 0], [1, 1, 0]], [0, 1], [[np.nan, 0, 0], [1, 1, 1]]])
def test_boxes_without_a_width_clip_nothing(bounds):
    with pytest.raises(il.errors.InputError, match="bounds"):
        F.clipped(BALL, bounds)


def test_solids_are_contoured_as_their_fields_are():
    wall = lattice("schwarz_p", repeat=1).offset(0.1)
    axes = [np.linspace(*ends, 20) for ends in wall.through.domain.T]
    mine, same = il.mesh.contour(wall, axes), il.mesh.contour(wall.field, axes)
    np.testing.assert_array_equal(mine.vertices, same.vertices)
    mine = il.sdf.mesh(wall, 0.06)
    same = il.sdf.mesh(wall.field, 0.06, through=wall.through)
    np.testing.assert_array_equal(mine.vertices, same.vertices)
    with pytest.raises(il.errors.InputError, match="has a map already"):
        il.sdf.mesh(wall, 0.06, through=wall.through)


def test_pairs_of_level_sets_are_what_is_negative_in_both():
    class Lens:
        name, through = "lens", None

        def level_sets(self):
            return F.sphere(1.0), F.translate(F.sphere(1.0), (0.7, 0.1, 0.0))

    axes = [np.linspace(-1.1, 1.8, 30)] * 3
    both = il.mesh.contour(F.intersection(*Lens().level_sets()), axes)
    np.testing.assert_array_equal(il.mesh.contour(Lens(), axes).vertices, both.vertices)


def test_what_only_looks_like_a_solid_is_refused():
    class Hollow:
        name, through, level_sets = "hollow", il.macroshape.box(1.0), BALL

    class Empty(Hollow):
        def level_sets(self):
            return None

    axes = [np.linspace(0.0, 1.0, 5)] * 3
    for solid, told in ((Hollow(), "method level_sets"), (Empty(), "got None"), (Empty, "object")):
        for call in (
            lambda s: il.mesh.contour(s, axes),
            lambda s: il.sdf.mesh(s, 0.1),
            lambda s: il.cutfem.cut(s, 4, domain=[[0] * 3, [1] * 3]),
        ):
            with pytest.raises(InputError, match=told):
                call(solid)
    with pytest.raises(InputError, match="map of its own, needs a spacing"):
        il.sdf.mesh(lattice("schwarz_p", repeat=1).offset(0.1))
