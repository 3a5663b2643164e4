import gc
import itertools
import pickle
import tracemalloc

import numpy as np
import pytest
from conformance import check_field
from naive_skeleton import curve_minimum, surface_minimum

import ilattice as il
from ilattice.bspline import BSpline
from ilattice.errors import GeometryError, InputError
from ilattice.tiles import (
    Arc,
    Ball,
    Curve,
    Group,
    Patch,
    Polyline,
    Segments,
    SkeletonField,
    Surface,
    Triangles,
    skeleton,
)
from ilattice.tiles._piece_arrays import PER_PIECE
from ilattice.tiles._radii import as_radius

POINTS = np.random.default_rng(5).random((120, 3))
X_BAR = [(0.0, 0.5, 0.5), (1.0, 0.5, 0.5)]
OBLIQUE = [[1, 0.3, 0], [0, 0.5, 0], [0, 0.1, 0.7]]
Y_BAR = [(0.5, 0.0, 0.5), (0.5, 1.0, 0.5)]


def knots(n, k, corner=False):
    inner = np.linspace(0, 1, n - k + 1)[1:-1]
    if corner:
        inner = np.concatenate([np.repeat(inner[0], k), inner[k:]])
    return np.concatenate([[0.0] * (k + 1), inner, [1.0] * (k + 1)])


def random_curve(k, kind, seed=0):
    rng = np.random.default_rng(100 * k + seed)
    n = k + 6
    weights = rng.uniform(0.5, 2, n) if kind == "rational" else None
    t = knots(n, k, corner=kind == "corner")
    return BSpline([t], rng.random((n, 3)) * 0.8 + 0.1, k, weights=weights)


def random_surface(k, rational=False, seed=0):
    rng = np.random.default_rng(10 * k + seed)
    n = k + 2
    x, y = np.meshgrid(np.linspace(0.15, 0.85, n), np.linspace(0.15, 0.85, n), indexing="ij")
    c = np.stack([x, y, rng.random((n, n)) * 0.8 + 0.1], axis=-1)
    c[..., :2] += rng.uniform(-0.1, 0.1, (n, n, 2))
    weights = rng.uniform(0.6, 1.6, (n, n)) if rational else None
    return BSpline([knots(n, k)] * 2, c, k, weights=weights)


# ------------------------------------------------------------------------------ least distances


@pytest.mark.parametrize("kind", ["smooth", "corner", "rational"])
@pytest.mark.parametrize("k", [1, 2, 3, 4, 5])
def test_distance_to_curves_is_the_least_of_all(k, kind):
    curve = random_curve(k, kind)
    f = SkeletonField([curve], radius=0.05)(POINTS)
    np.testing.assert_allclose(f + 0.05, curve_minimum(POINTS, curve), rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", ["smooth", "rational"])
@pytest.mark.parametrize("k", [1, 3])
def test_varying_radius_gives_the_envelope_of_the_balls(k, kind):
    curve = random_curve(k, kind, seed=1)
    field = SkeletonField([Curve(curve, radius=lambda t: 0.05 + 0.04 * np.sin(7 * t))])
    radius = as_radius("radius", lambda t: 0.05 + 0.04 * np.sin(7 * t), curve.domain)
    np.testing.assert_allclose(radius(np.array([0.3])), 0.05 + 0.04 * np.sin(2.1), atol=1e-7)
    expected = curve_minimum(POINTS, curve, radius)
    np.testing.assert_allclose(field(POINTS), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("k", "rational"), [(1, False), (2, False), (2, True), (3, False)])
def test_distance_to_surfaces_is_the_least_of_all(k, rational):
    surface = random_surface(k, rational)
    f = SkeletonField([surface], radius=0.05)(POINTS)
    np.testing.assert_allclose(f + 0.05, surface_minimum(POINTS, surface), rtol=0, atol=1e-12)


def four_corners(z, low=0.15):
    """Bilinear surface over a square."""
    x, y = np.meshgrid([low, 1.0 - low], [low, 1.0 - low], indexing="ij")
    return BSpline([[0, 0, 1, 1]] * 2, np.stack([x, y, np.broadcast_to(z, (2, 2))], axis=-1), 1)


@pytest.mark.parametrize("radius", [
    [[0.02, 0.05], [0.08, 0.04]], [[0.05, 0.05], [0.051, 0.051]], [[0.03, 0.03], [0.15, 0.15]],
])  # fmt: skip
@pytest.mark.parametrize(
    "surface",
    [random_surface(2), four_corners([[0.3, 0.7], [0.7, 0.3]])],
    ids=["random", "saddle"],
)
def test_distance_to_a_surface_of_varying_thickness(surface, radius):
    linear = BSpline([[0, 0, 1, 1]] * 2, radius, 1)
    points = np.concatenate([POINTS[:40], surface(POINTS[:10, :2])])
    f = SkeletonField([Surface(surface, radius=linear)])(points)
    u = np.stack(np.meshgrid(*[np.linspace(0, 1, 400)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    s, r = surface(u), linear(u)
    dense = np.array([(np.linalg.norm(p - s, axis=1) - r).min() for p in points])
    assert (f <= dense + 1e-14).all()
    assert (dense - f)[:40].max() < 2e-4  # the density of the samples
    assert (dense - f)[40:].max() < 2e-3  # to first order on the surface


@pytest.mark.parametrize("slope", [0.1, 0.5])
def test_a_plate_of_linear_thickness_is_a_wedge(slope):
    plate = four_corners(0.5, 0.0)
    field = SkeletonField([Surface(plate, radius=lambda u: 0.05 + slope * u[:, 0])])
    p = POINTS * [0.6, 1.0, 0.4] + [0.2, 0.0, 0.5]
    p[:20, 2] = 0.5
    height = p[:, 2] - 0.5
    want = height * np.sqrt(1.0 - slope**2) - 0.05 - slope * p[:, 0]
    inside = p[:, 0] + slope * height / np.sqrt(1.0 - slope**2) < 1.0
    assert inside.sum() > 100
    np.testing.assert_allclose(field(p)[inside], want[inside], atol=1e-12)


def test_points_on_and_close_to_the_curve():
    curve = random_curve(3, "smooth")
    t = np.linspace(0, 1, 50)
    tangent = curve.jet(t[:, None], 1)[1][:, :, 0]
    normal = np.cross(tangent, [0.3, 0.5, 0.8])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    field = SkeletonField([curve], radius=0.05)
    for h in (0.0, 1e-9, 1e-5, 1e-3):
        f = field(curve(t) + h * normal)
        np.testing.assert_allclose(f, h - 0.05, rtol=0, atol=1e-12)


def test_segments_arcs_and_polygons_agree_with_splines():
    corners = np.random.default_rng(3).random((5, 3))
    as_curve = BSpline([np.concatenate([[0], np.arange(5), [4]]) / 4.0], corners, 1)
    f = SkeletonField([corners], radius=0.1)(POINTS)
    np.testing.assert_allclose(f + 0.1, curve_minimum(POINTS, as_curve), rtol=0, atol=1e-12)
    u, v = np.array([0.3, 0.0, 0.1]), np.array([-0.1, 0.0, 0.3])
    for angle in (1.0, 4.0, 2 * np.pi):
        arc = Arc([0.5, 0.5, 0.5], u, v, angle)
        exact = SkeletonField([arc], radius=0.05)(POINTS)
        rational = SkeletonField([Arc([0.5, 0.5, 0.5], u, v, angle, radius=lambda a: 0.05 + 0 * a)])
        np.testing.assert_allclose(rational(POINTS), exact, rtol=0, atol=1e-7)
        a = np.linspace(0, angle, 4001)
        dense = np.linalg.norm(POINTS[:, None] - arc.at(a), axis=2).min(axis=1)
        np.testing.assert_allclose(exact + 0.05, dense, rtol=0, atol=1e-5)
    plane = BSpline([[0, 0, 1, 1]] * 2, [[[0, 0, 0.2], [0, 1, 0.6]], [[1, 0, 0.4], [1, 1, 0.8]]], 1)
    quad = [(0, 0, 0.2), (1, 0, 0.4), (1, 1, 0.8), (0, 1, 0.6)]
    a = SkeletonField([Patch(quad)], radius=0.1, faces="periodic")(POINTS)
    b = SkeletonField([plane], radius=0.1, faces="periodic")(POINTS)
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-12)


def test_a_polygon_need_not_be_convex():
    shape = [(0.1, 0.1), (0.9, 0.1), (0.9, 0.9), (0.5, 0.3), (0.1, 0.9)]
    patch = Patch([(x, y, 0.5) for x, y in shape])
    parts = [[0, 1, 3], [1, 2, 3], [0, 3, 4]]
    triangles = [Patch([(*shape[i], 0.5) for i in part]) for part in parts]
    whole = SkeletonField([patch], radius=0.1)(POINTS)
    np.testing.assert_allclose(whole, SkeletonField(triangles, radius=0.1)(POINTS), atol=1e-13)


def test_linear_radius_along_a_segment_is_a_cone():
    line = Polyline([(0.2, 0.5, 0.5), (0.8, 0.5, 0.5)], radius=[0.05, 0.2])
    t = np.linspace(0, 1, 20001)[:, None]
    centres = line.points[0] * (1 - t) + line.points[1] * t
    balls = np.linalg.norm(POINTS[:, None] - centres, axis=2) - (0.05 + 0.15 * t.T)
    f = SkeletonField([line])(POINTS)
    np.testing.assert_allclose(f, balls.min(axis=1), rtol=0, atol=1e-8)
    assert (f <= balls.min(axis=1) + 1e-15).all()
    swallowed = Polyline([(0.4, 0.5, 0.5), (0.5, 0.5, 0.5)], radius=[0.05, 0.2])
    ball = np.linalg.norm(POINTS - [0.5, 0.5, 0.5], axis=1) - 0.2
    np.testing.assert_allclose(SkeletonField([swallowed])(POINTS), ball, atol=1e-15)


def triangle_minimum(points, corners, radii):
    """Least |x - p| - r(p) over a triangle: convex, so that thirds of thirds find it."""

    def value(s, t):
        w = np.stack([1 - s, s * (1 - t), s * t], axis=1)
        return np.linalg.norm(points - w @ corners, axis=1) - w @ radii

    def inner(s):
        low, high = np.zeros(len(points)), np.ones(len(points))
        for _ in range(60):
            a, b = low + (high - low) / 3, high - (high - low) / 3
            left = value(s, a) < value(s, b)
            low, high = np.where(left, low, a), np.where(left, b, high)
        return value(s, low)

    low, high = np.zeros(len(points)), np.ones(len(points))
    for _ in range(60):
        a, b = low + (high - low) / 3, high - (high - low) / 3
        left = inner(a) < inner(b)
        low, high = np.where(left, low, a), np.where(left, b, high)
    return np.min([inner(s) for s in (low, np.zeros(len(points)), np.ones(len(points)))], axis=0)


def test_triangles_are_the_envelope_of_their_balls():
    rng = np.random.default_rng(8)
    v, x = rng.random((9, 3)), POINTS[:60]
    r = rng.uniform(0.02, 0.3, 9)
    r[6:] = (0.05, 0.9, 0.05)  # the ball of one corner swallows the others
    faces = np.arange(9).reshape(3, 3)
    want = np.min([triangle_minimum(x, v[f], r[f]) for f in faces], axis=0)
    np.testing.assert_allclose(SkeletonField([Triangles(v, faces, r)])(x), want, atol=1e-7)
    patches = [Patch(v[f], radius=0.1) for f in faces]
    flat = SkeletonField([Triangles(v, faces)], radius=0.1)(POINTS)
    np.testing.assert_allclose(flat, SkeletonField(patches)(POINTS), atol=1e-14)


def test_what_leaves_through_periodic_faces_comes_in_again():
    rng = np.random.default_rng(9)
    v, faces = rng.uniform(-1.3, 2.6, (5, 3)), np.array([[0, 1, 2], [2, 3, 4]])
    balls = [Ball(p, 0.1) for p in v]
    shifts = np.stack(np.meshgrid(*[np.arange(-4, 5)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    off = POINTS[:, None, None] - v - shifts[:, None]
    want = np.linalg.norm(off, axis=3).min(axis=(1, 2)) - 0.1
    np.testing.assert_allclose(SkeletonField(balls, faces="periodic")(POINTS), want, atol=1e-14)
    field = SkeletonField([Triangles(v, faces)], 0.05, faces="periodic")
    copies = np.concatenate([v + s for s in shifts])
    every = np.concatenate([faces + 5 * i for i in range(len(shifts))])
    near = np.abs(copies[every].mean(axis=1) - 0.5).max(axis=1) < 4.5
    all_in = SkeletonField([Triangles((copies + 6) / 13, every[near], 0.05 / 13)], cell=1.0)
    u = (POINTS[:300] + 6) / 13
    np.testing.assert_allclose(field(POINTS[:300]), 13 * all_in(u), atol=1e-12)
    with pytest.raises(InputError, match="leaves the tile"):
        SkeletonField(balls, faces={"x": "periodic"})


def segment_minimum(points, ends, radii):
    """Least |x - p| - r(p) over round cones: all of them, by the foot in closed form."""
    a, way = ends[:, 0], ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(way, axis=1)
    slope = (radii[:, 1] - radii[:, 0]) / length
    off = points[:, None] - a
    t = (off * way).sum(axis=2) / length
    h = np.linalg.norm(off - (t / length)[..., None] * way, axis=2)
    steep = np.abs(slope) >= 1.0
    mild = np.where(steep, 0.0, slope)
    tilt = np.where(steep, np.inf * np.sign(slope), mild / np.sqrt(1.0 - mild**2))
    t = np.clip(t + np.where(h > 0, h, 1e-300) * tilt, 0.0, length) / length
    foot = a + t[..., None] * way
    gap = np.linalg.norm(points[:, None] - foot, axis=2)
    return (gap - radii[:, 0] - t * (radii[:, 1] - radii[:, 0])).min(axis=1)


def random_segments(n, seed=0):
    """Long and short ones, some the same, one nearly of length zero."""
    rng = np.random.default_rng(seed)
    ends = rng.random((n, 2, 3))
    ends[::2, 1] = 0.95 * ends[::2, 0] + 0.05 * ends[::2, 1]
    ends[0, 1] = ends[0, 0] + 1e-9 * (0.5 - ends[0, 0])
    ends[1], ends[2] = ends[3], ends[3, ::-1]
    return ends, rng.uniform(0.01, 0.1, (n, 2))


@pytest.mark.parametrize("size", [1.0, (1e3, 1.0, 1e-2)])
def test_segments_are_the_least_of_all_of_them(size):
    ends, radii = random_segments(300)
    cell = np.broadcast_to(size, 3)
    field = SkeletonField([Segments(ends * cell, radii)], cell=size, faces="periodic")
    shifts = np.stack(np.meshgrid(*[np.arange(-1, 2)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    every = np.concatenate([(ends + s) * cell for s in shifts])
    want = segment_minimum(POINTS * cell, every, np.tile(radii, (27, 1)))
    np.testing.assert_allclose(field(POINTS), want, rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("blend", [0.0, 0.05])
@pytest.mark.parametrize("faces", ["open", "closed", "periodic", {"y": "periodic"}])
def test_segments_are_as_many_polylines(blend, faces):
    ends, radii = random_segments(50, 1)
    ends[5, 0, 0], ends[7, 1, 2] = 0.0, 1.0  # continued through open faces
    lines = [Polyline(e, r) for e, r in zip(ends, radii, strict=True)]
    one = SkeletonField([Segments(ends, radii)], blend=blend, faces=faces)
    many = SkeletonField(lines, blend=blend, faces=faces)
    assert one.count == many.count == 50
    for a, b in zip(one.jet(POINTS), many.jet(POINTS), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)
    grouped = SkeletonField([Group([Segments(ends, radii)])], blend=blend, faces=faces)
    np.testing.assert_array_equal(grouped(POINTS), SkeletonField(lines, faces=faces)(POINTS))


def test_pairs_of_points_become_arrays():
    ends, _ = random_segments(40, 2)
    arc = Arc([0.5, 0.5, 0.5], [0.3, 0, 0], [0, 0.3, 0])
    field = SkeletonField([*ends[:20].tolist(), arc, *ends[20:]], 0.05, 0.02)
    assert [type(e).__name__ for e in field.entities] == ["Segments", "Arc", "Segments"]
    lines = [Polyline(e) for e in ends]
    same = SkeletonField([*lines[:20], arc, *lines[20:]], 0.05, 0.02)
    np.testing.assert_array_equal(field(POINTS), same(POINTS))
    whole = SkeletonField(ends, 0.05)
    np.testing.assert_array_equal(whole(POINTS), SkeletonField(lines, 0.05)(POINTS))
    ends[33, 1, 0] = 1.5
    with pytest.raises(InputError, match=r"entities\[34\] leaves the tile.*1\.5"):
        SkeletonField([*ends[:20], arc, *ends[20:]], 0.05)
    with pytest.raises(InputError, match=r"entities\[1\]: radius must be given"):
        SkeletonField([Arc([0.5, 0.5, 0.5], [0.3, 0, 0], [0, 0.3, 0], radius=0.1), *lines])


@pytest.mark.parametrize("axes", ["x", "yz", "xyz"])
def test_copies_in_oblique_cells_are_all_that_are_near(axes):
    rng = np.random.default_rng(len(axes))
    cell = np.array([[1.0, 2.3, 0.4], [0.0, 1.0, -1.7], [0.0, 0.0, 1.0]])
    u = rng.random((3, 2, 3)) * np.where([a in axes for a in "xyz"], 1.6, 1.0)
    radii = rng.uniform(0.02, 0.05, (3, 2))
    faces = {a: "periodic" if a in axes else "closed" for a in "xyz"}
    field = SkeletonField([Segments(u @ cell.T, radii)], faces=faces, cell=cell)
    steps = [np.arange(-7, 8) if a in axes else np.arange(1) for a in "xyz"]
    shifts = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
    every = np.concatenate([(u + s) @ cell.T for s in shifts])
    want = segment_minimum(POINTS @ cell.T, every, np.tile(radii, (len(shifts), 1)))
    for i, axis in enumerate("xyz"):
        if axis not in axes:  # the closed faces cut
            height = 1.0 / np.linalg.norm(np.linalg.inv(cell)[i])
            want = np.maximum(want, height * np.maximum(-POINTS[:, i], POINTS[:, i] - 1.0))
    np.testing.assert_allclose(field(POINTS), want, atol=1e-13)


def test_many_entities_are_repeated_without_an_object_each():
    ends, radii = random_segments(20_000, 3)
    segments = Segments(ends, 0.1 * radii)
    SkeletonField([segments], faces="periodic")
    tracemalloc.start()
    before = len(gc.get_objects())
    field = SkeletonField([segments], faces="periodic")
    kept, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(gc.get_objects()) - before < 200
    pieces = len(field._tree.piece)
    assert pieces > 20_000
    assert peak < PER_PIECE * pieces
    assert kept < 0.5 * PER_PIECE * pieces


def test_boxes_of_trees_hold_their_pieces():
    ends, radii = random_segments(500, 4)
    tree = SkeletonField([Segments(ends, radii), *mixed()], 0.05)._tree

    def check(node):
        right, first, count = tree.link[node]
        if count:
            below = tree.piece_box[first : first + count]
        else:
            below = np.concatenate([check(node + 1), check(right)])
        low, high = below[:, :3].min(axis=0), below[:, 3:6].max(axis=0)
        np.testing.assert_array_equal(tree.box[node], [*low, *high, below[:, 6].max()])
        return below

    assert len(check(0)) == len(tree.piece)


# ------------------------------------------------------------------------------ fields


def mixed():
    return [
        random_curve(3, "smooth"),
        Polyline([(0.1, 0.1, 0.9), (0.9, 0.2, 0.8)], radius=[0.03, 0.08]),
        Arc([0.5, 0.5, 0.3], [0.3, 0, 0], [0, 0.3, 0], 4.0),
        Patch([(0.1, 0.1, 0.1), (0.5, 0.1, 0.1), (0.3, 0.4, 0.1)]),
    ]


@pytest.mark.parametrize(
    ("field", "exact"),
    [
        pytest.param(lambda: SkeletonField(mixed(), 0.05), True, id="sharp"),
        pytest.param(lambda: SkeletonField(mixed(), 0.05, 0.15), True, id="smooth"),
        pytest.param(lambda: SkeletonField([X_BAR, Y_BAR], 0.1, 0.1, "periodic"), True, id="bars"),
        pytest.param(lambda: SkeletonField([X_BAR], 0.2, faces="closed"), True, id="closed"),
        pytest.param(lambda: SkeletonField([random_surface(2)], 0.05), True, id="surface"),
        pytest.param(
            lambda: SkeletonField([random_surface(2, True), random_curve(2, "rational")], 0.1, 0.1),
            False, id="rational",
        ),
        pytest.param(
            lambda: SkeletonField([Curve(random_curve(3, "corner"), lambda t: 0.1 - 0.05 * t)]),
            False, id="varying",
        ),
        pytest.param(
            lambda: SkeletonField([[(0, 0, 0), (0.3, 0.5, 0.1)]], 0.1, 0.0, "periodic", OBLIQUE),
            True, id="oblique",
        ),
    ],
)  # fmt: skip
def test_fields_conform(field, exact):
    check_field(field(), np.random.default_rng(2), points=120, rtol=1e-4, exact=exact)


def test_gradients_have_length_one_off_the_skeleton():
    field = SkeletonField(mixed(), 0.05)
    length = np.linalg.norm(field.jet(POINTS, 1)[1], axis=1)
    np.testing.assert_allclose(length, 1.0, rtol=0, atol=1e-14)
    f, g, h = SkeletonField([X_BAR], 0.2).jet([[0.3, 0.5, 0.5]])
    assert f[0] == pytest.approx(-0.2)
    assert not g.any()
    assert not h.any()


def test_the_smooth_union_keeps_to_its_bounds():
    blend, n = 0.2, 4
    sharp = SkeletonField(mixed(), 0.05)(POINTS)
    smooth = SkeletonField(mixed(), 0.05, blend)(POINTS)
    each = np.stack([SkeletonField([e], 0.05)(POINTS) for e in mixed()])
    gap = sharp - smooth
    np.testing.assert_array_equal(sharp, each.min(axis=0))
    assert (gap >= -1e-15).all()
    assert gap.max() <= 0.5 * blend * (1 - 1 / n)
    alone = (each < each.min(axis=0) + blend).sum(axis=0) == 1
    assert 0.1 < alone.mean() < 0.9
    np.testing.assert_array_equal(gap[alone], 0.0)
    assert (gap[~alone] > 0).all()
    two = SkeletonField([X_BAR, Y_BAR], 0.1, blend)([[0.25, 0.25, 0.5]])
    np.testing.assert_allclose(two, 0.15 - blend / 4, atol=1e-15)


def test_a_group_and_a_polyline_are_joined_sharply():
    a, b = [(0.1, 0.5, 0.5), (0.5, 0.5, 0.5)], [(0.5, 0.5, 0.5), (0.9, 0.5, 0.5)]
    whole = SkeletonField([[a[0], b[1]]], 0.1)(POINTS)
    np.testing.assert_allclose(SkeletonField([Group([a, b])], 0.1, 0.2)(POINTS), whole, atol=1e-15)
    bulge = whole - SkeletonField([a, b], 0.1, 0.2)(POINTS)
    assert bulge.max() > 0.03


# ------------------------------------------------------------------------------ faces


def test_periodic_faces_repeat_the_entities():
    entities = mixed()
    field = SkeletonField(entities, 0.05, 0.1, faces={"x": "periodic", "z": "periodic"})
    assert field.repeats == (True, False, True)
    for axis in (0, 2):
        low, high = POINTS.copy(), POINTS.copy()
        low[:, axis], high[:, axis] = 0.0, 1.0
        np.testing.assert_allclose(field(low), field(high), rtol=0, atol=1e-14)
    own = SkeletonField(entities, 0.05)
    shifts = [np.array([i, 0, k]) for i in (-2, -1, 0, 1, 2) for k in (-2, -1, 0, 1, 2)]
    images = np.min([own(POINTS - s) for s in shifts], axis=0)
    sharp = SkeletonField(entities, 0.05, faces={"x": "periodic", "z": "periodic"})
    np.testing.assert_allclose(sharp(POINTS), images, rtol=0, atol=1e-13)


def test_open_faces_let_arms_through():
    end = np.array([0.8, 0.5, 1.0])
    oblique = [(0.5, 0.5, 0.5), tuple(end)]
    direction = (end - 0.5) / np.linalg.norm(end - 0.5)
    field = SkeletonField([oblique], 0.1)
    top = POINTS.copy()
    top[:, 2] = 1.0
    v = top - end
    beyond = v @ direction > -0.3
    axis = np.linalg.norm(v - (v @ direction)[:, None] * direction, axis=1) - 0.1
    np.testing.assert_allclose(field(top)[beyond], axis[beyond], rtol=0, atol=1e-14)
    assert beyond.sum() > 50
    inside = SkeletonField([[(0.5, 0.5, 0.2), (0.5, 0.5, 0.5)]], 0.1)
    assert inside([[0.5, 0.5, 0.9]])[0] == pytest.approx(0.3)


def test_open_faces_let_plates_and_surfaces_through():
    slanted = [(0, 0, 0.2), (1, 0, 0.6), (1, 1, 0.6), (0, 1, 0.2)]
    normal = np.array([-0.4, 0, 1.0]) / np.hypot(0.4, 1.0)
    plane = np.abs((POINTS - [0, 0, 0.2]) @ normal) - 0.05
    middle = np.abs(POINTS[:, 1] - 0.5) < 0.4
    c = np.array(slanted)[[0, 3, 1, 2]].reshape(2, 2, 3)
    for e in (Patch(slanted), BSpline([[0, 0, 1, 1]] * 2, c, 1)):
        f = SkeletonField([e], 0.05)(POINTS)
        np.testing.assert_allclose(f[middle], plane[middle], rtol=0, atol=1e-13)
        cut = SkeletonField([e], 0.05, faces="periodic")
        assert np.ptp(cut(POINTS)[middle] - plane[middle]) > 0.01


def test_closed_faces_cut_the_solid():
    open_, closed = (SkeletonField([X_BAR], 0.2, faces={"x+": kind}) for kind in ("open", "closed"))
    p = np.concatenate([POINTS, POINTS + np.array([0.9, 0, 0])])
    np.testing.assert_allclose(closed(p), np.maximum(open_(p), p[:, 0] - 1), atol=1e-15)
    assert open_([[1.0, 0.5, 0.5]])[0] == pytest.approx(-0.2)
    assert closed([[1.0, 0.5, 0.5]])[0] == 0.0


def test_cells_that_are_no_cubes_measure_lengths():
    tile = skeleton([[(0, 1.0, 0.5), (1, 1.0, 0.5)]], radius=0.2, cell=(1, 2, 1), faces="periodic")
    u = POINTS * 0.5 + 0.25
    expected = np.hypot(2 * u[:, 1] - 1, u[:, 2] - 0.5) - 0.2
    np.testing.assert_allclose(tile(u), expected, atol=1e-14)
    np.testing.assert_array_equal(tile.cell, np.diag([1.0, 2.0, 1.0]))
    np.testing.assert_array_equal(tile.fit(tol=0.02).cell, tile.cell)


# ------------------------------------------------------------------------------ tiles


def test_fits_keep_the_zero_set():
    tile = skeleton([X_BAR, Y_BAR], radius=0.15, blend=0.1, faces="periodic")
    spline = tile.fit(tol=1e-3)
    assert spline.periodic == (True, True, True)
    f = tile(POINTS)
    assert (np.sign(spline(POINTS)) == np.sign(f))[np.abs(f) > 1e-3].all()
    on = POINTS - f[:, None] * tile.jet(POINTS, 1)[1]
    on = np.clip(on - tile(on)[:, None] * tile.jet(on, 1)[1], 0, 1)
    on = on[np.abs(tile(on)) < 1e-4]
    assert len(on) > 50
    assert np.abs(spline(on)).max() < 1.2e-3
    np.testing.assert_allclose(np.linalg.norm(spline.jet(on, 1)[1], axis=1), 1.0, atol=0.05)


def test_the_flattened_field_is_fast_and_the_same():
    field = SkeletonField(mixed(), 0.05, 0.1)
    flat = field.flattened(reach=0.04)
    f = field(POINTS)
    s = np.clip(f / 0.04, -1, 1)
    np.testing.assert_allclose(flat(POINTS), 0.04 * (s - 2 / 3 * s**3 + s**5 / 5), atol=1e-15)
    np.testing.assert_allclose(field.up_to(0.1, POINTS), np.minimum(f, 0.1), rtol=0, atol=1e-14)


def test_a_lattice_takes_a_skeleton():
    tile = skeleton([X_BAR], radius=0.2, faces="periodic")
    through = il.macroshape.box((2, 1, 1))
    lattice = il.Lattice(tile, through=through, repeat=(2, 1, 1))
    solid = lattice.offset((np.inf, 0.0)).mesh(0.03)
    shell = lattice.offset((0.0, 0.1)).mesh(0.03)
    assert solid.is_watertight
    assert shell.is_watertight
    assert solid.volume == pytest.approx(2 * np.pi * 0.04, rel=5e-3)
    assert shell.volume == pytest.approx(2 * np.pi * (0.09 - 0.04), rel=5e-3)
    assert (solid.genus, solid.components) == (0, 1)


def test_skeletons_can_be_pickled():
    field = SkeletonField(mixed(), 0.05)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(field))(POINTS), field(POINTS))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"entities": []}, "at least one curve"),
        ({"entities": "bar"}, "at least one curve"),
        ({"entities": [[(0, 0, 0), (0, 0, 0)]]}, "length zero"),
        ({"entities": [[(0, 0, 0)]]}, "length zero"),
        ({"entities": [BSpline([[0, 0, 1, 1]], np.full((2, 3), 0.5), 1)]}, "length zero"),
        ({"entities": [[(0, 0.5, 0.5), (1.2, 0.5, 0.5)]]}, r"entities\[0\] leaves the tile.*1\.2"),
        ({"entities": [X_BAR, [(0, 0), (1, 1)]]}, r"entities\[1\]"),
        ({"radius": 0.0}, "radius must be one number above zero"),
        ({"radius": -0.1}, "radius"),
        ({"radius": None}, "radius must be given"),
        ({"entities": [Polyline(X_BAR, radius=lambda t: t - 0.5)]}, "radius must be positive"),
        ({"entities": [Polyline(X_BAR, radius=[0.1, 0.2, 0.3])]}, "one per corner"),
        ({"entities": [Polyline(X_BAR, radius=lambda t: 0.1 + 0.05 * (t > 0.3))]}, "too roughly"),
        ({"entities": X_BAR}, r"entities\[0\] .*write \[points\]"),
        ({"entities": [[[0.0], [0.0, 1.0]]]}, r"entities\[0\] must be"),
        ({"blend": -0.1}, "blend"),
        ({"faces": "ajar"}, "faces"),
        ({"faces": {"w": "open"}}, "faces"),
        ({"faces": {"x": "periodic", "x-": "closed"}}, "faces are in conflict"),
        ({"faces": {"x-": "periodic"}}, "faces are in conflict.*periodic together"),
        ({"cell": [[1, 0, 0], [2, 0, 0], [0, 0, 1]]}, "cell"),
        ({"cell": (1, 0, 1)}, "cell"),
    ],
)
def test_bad_input_is_refused(arguments, message):
    given = {"entities": [X_BAR], "radius": 0.1} | arguments
    with pytest.raises(InputError, match=message):
        skeleton(**given)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Arc([0, 0, 0], [1, 0, 0], [1, 0, 0]), "perpendicular"),
        (lambda: Arc([0, 0, 0], [1, 0, 0], [0, 2, 0]), "equally long"),
        (lambda: Arc([0, 0, 0], [1, 0, 0], [0, 1, 0], 7.0), "2 pi radians"),
        (lambda: Patch([(0, 0, 0), (1, 0, 0)]), "three points"),
        (lambda: Patch([(0, 0, 0), (1, 0, 0), (0.5, 0, 0)]), "one line"),
        (lambda: Patch([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0.2)]), "one plane"),
        (lambda: Polyline(X_BAR, radius=[0.1, 0.0]), "radius must be one number above zero"),
        (lambda: Curve(random_surface(2)), "a curve"),
        (lambda: Surface(random_curve(2, "smooth")), "a surface"),
        (lambda: Group([]), "at least one"),
        (lambda: Ball((0, 0)), "three numbers"),
        (lambda: Ball((0, 0, 0), -1.0), "radius"),
        (lambda: Segments(np.zeros((2, 3))), r"shape \(n, 2, 3\)"),
        (lambda: Segments(np.zeros((0, 2, 3))), r"shape \(n, 2, 3\)"),
        (lambda: Segments([X_BAR, [X_BAR[0]] * 2]), r"points\[1\] must be two different points"),
        (lambda: Segments([X_BAR], [0.1, 0.2]), "one per segment"),
        (lambda: Segments([X_BAR], -0.1), "radius must be positive"),
        (lambda: Segments([X_BAR]).at_ends(), "radius must be given"),
        (lambda: Triangles(np.eye(3), [[0, 1, 3]]), "faces must be whole numbers"),
        (lambda: Triangles(np.eye(3), [[0, 1, 1]]), "triangle with an area"),
        (lambda: Triangles(np.eye(3), [[0, 1, 2]], [1.0, 1.0]), "one per vertex"),
        (lambda: Triangles(np.eye(3), [[0, 1, 2]], [1.0, 0.0, 1.0]), "above zero"),
        (lambda: Triangles(np.eye(3), [0, 1, 2]), "shape"),
        (lambda: SkeletonField([X_BAR], 0.1).jet([[0, 0, 0]], 3), "order"),
    ],
)
def test_bad_entities_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_a_solid_that_fills_the_tile_is_refused():
    with pytest.raises(GeometryError, match="fills the cell"):
        skeleton([X_BAR], radius=0.8)


# --- copies --------------------------------------------------------------------------------------


def test_small_pieces_beside_large_ones_have_no_copies():
    both = [Ball((0.5, 0.5, 0.5), radius=2.0), Ball((0.2, 0.2, 0.2), radius=0.1)]
    x = np.random.default_rng(0).random((50, 3))
    near = np.linalg.norm(x - 0.5, axis=1) - 2.0  # the cell is within the large one's own part
    np.testing.assert_allclose(SkeletonField(both, faces="periodic")(x), near, atol=1e-14)
    with pytest.raises(GeometryError, match="fills the cell"):
        il.tiles.skeleton(both, faces="periodic")


@pytest.mark.parametrize("shear", [3.0, 37.0, 300.0])
def test_cells_sheared_far_have_the_copies_of_the_cell_that_they_repeat_like(shear):
    cell = np.array([[1.0, shear, 0.0], [0.0, 1.0, 0.0], [0.3, 0.0, 1.0]])
    ends = np.array([[0.1, 0.2, 0.3], [0.11, 0.21, 0.31]]) @ cell.T
    field = SkeletonField([Polyline(ends, radius=0.001)], faces="periodic", cell=cell)
    u = np.random.default_rng(1).random((200, 3))
    short = cell.copy()
    short[:, 1] -= shear * short[:, 0]  # repeats alike
    short[:, 1] -= np.rint(short[2, 1]) * short[:, 2]
    x = u @ cell.T - ends[0]
    x -= np.rint(x @ np.linalg.inv(short).T) @ short.T
    way, best = ends[1] - ends[0], np.full(len(x), np.inf)
    reach = [range(-2 - int(abs(c)), 3 + int(abs(c))) for c in np.linalg.solve(short, way)]
    for k in itertools.product(*reach):
        p = x - short @ np.array(k)
        t = np.clip(p @ way / (way @ way), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(p - t[:, None] * way, axis=1) - 0.001)
    np.testing.assert_allclose(field(u), best, atol=1e-12)
