"""Volumes from surfaces: the surfaces are in them, closed forms hold, bad input is named."""

import numpy as np
import pytest
from macro_zoo import parameters, patch

from ilattice import macroshape as ms
from ilattice.bspline import BSpline
from ilattice.bspline.knots import uniform_knots
from ilattice.errors import GeometryError, InputError

LINE = [0.0, 0, 1, 1]


def quarter_disc():
    """Rational quarter of an annulus in the plane z = 0, radii 1 and 2."""
    s = np.sqrt(0.5)
    arc = np.array([(1, 0), (1, 1), (0, 1)], dtype=float)
    c = np.stack([arc, 2 * arc], axis=1)
    return BSpline([[0, 0, 0, 1, 1, 1], LINE], c, (2, 1), weights=[[1, 1], [s, s], [1, 1]])


def wavy(seed=0, knots=(0.0, 0, 0, 0, 0.3, 1, 1, 1, 1), height=1.0):
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.linspace(0, 1, len(knots) - 4), [0, 1], indexing="ij")
    z = height + 0.1 * rng.standard_normal(x.shape)
    return BSpline([knots, LINE], np.stack([x, y, z], axis=-1), (3, 1))


def tube(height):
    """Periodic surface: a ring of width 1/2."""
    a = 2 * np.pi * np.arange(6) / 6
    ring = np.stack([np.cos(a), np.sin(a)], axis=-1)
    ring = np.concatenate([ring, ring[:3]])
    c = np.concatenate([ring[:, None] * [[1.0], [1.5]], np.full((9, 2, 1), height)], axis=-1)
    return BSpline([np.arange(-3, 10) / 6, LINE], c, (3, 1), periodic=(True, False))


def along(w):
    """Parameters of a surface, and of a volume at its level w."""
    u = np.random.default_rng(0).random((100, 2))
    return u, np.column_stack([u, np.full(100, w)])


def in_space(s, u):
    x = s(u)
    return x if x.shape[1] > 2 else np.column_stack([x, np.zeros(len(u))])


# ------------------------------------------------------------------------------ extrude, ruled


@pytest.mark.parametrize("surface", [patch(), quarter_disc(), wavy(), tube(0.0)])
def test_extruded_surfaces_are_moved_along(surface):
    v = np.array([0.1, 0.2, 3.0])
    volume = ms.extrude(surface, v)
    for w in (0.0, 0.4, 1.0):
        u2, u3 = along(w)
        np.testing.assert_allclose(volume.x(u3), in_space(surface, u2) + w * v, atol=1e-13)
    assert volume.closed == (*surface.periodic, False)


def test_extruded_volume_is_area_times_height():
    volume = ms.extrude(quarter_disc(), (5, 0, 2))
    assert volume.volume() == pytest.approx(2 * np.pi / 4 * 3, rel=1e-9)
    assert volume.orientation == -1  # angle, radius, height
    assert volume.fix_orientation().orientation == 1


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (patch(), wavy()),
        (wavy(), wavy(1, (0.0, 0, 0, 0, 0.3, 0.3, 0.7, 1, 1, 1, 1), height=2)),
        (quarter_disc(), wavy(height=4)),
        (tube(0), tube(1)),
        (tube(0), wavy(height=3)),
        (wavy(), BSpline([[2, 2, 5, 5]] * 2, [[(0, 0, 3), (0, 1, 3)], [(1, 0, 3), (1, 1, 4)]], 1)),
    ],
)
def test_ruled_volumes_hold_both_surfaces_and_straight_lines(first, second):
    volume = ms.ruled(first, second)
    u2, low = along(0.0)
    high, mid = low + np.array([0, 0, 1]), low + np.array([0, 0, 0.5])
    lo, hi = second.domain
    np.testing.assert_allclose(volume.x(low), in_space(first, u2), atol=1e-12)
    np.testing.assert_allclose(volume.x(high), in_space(second, lo + u2 * (hi - lo)), atol=1e-12)
    a, b, c = volume.x(low), volume.x(high), volume.x(mid)
    assert np.abs(np.cross(b - a, c - a)).max() < 1e-12
    assert volume.spline.k[2] == 1


def test_equal_knots_are_not_refined_and_periodic_ones_stay():
    assert ms.ruled(tube(0), tube(1)).spline.periodic == (True, False, False)
    assert ms.ruled(tube(0), tube(1)).spline.shape == (9, 2, 2)
    assert ms.ruled(wavy(0), wavy(1)).spline.shape == (5, 2, 2)


def test_near_knots_are_merged():
    volume = ms.ruled(wavy(0), wavy(1, (0.0, 0, 0, 0, 0.3 + 1e-11, 1, 1, 1, 1)))
    assert volume.spline.shape == (5, 2, 2)
    volume = ms.ruled(wavy(0), wavy(1, (0.0, 0, 0, 0, 0.3 + 1e-6, 1, 1, 1, 1)))
    assert volume.spline.shape == (6, 2, 2)


def test_ruled_box():
    low = BSpline([LINE, LINE], [[(0, 0), (0, 2)], [(1, 0), (1, 2)]], 1)
    high = BSpline([LINE, LINE], [[(0, 0, 3), (0, 2, 3)], [(1, 0, 3), (1, 2, 3)]], 1)
    volume = ms.ruled(low, high)
    assert volume.volume() == pytest.approx(6)
    assert volume.orientation == 1


def test_further_coordinates_are_carried_along():
    s = patch()
    heat = np.arange(12.0).reshape(4, 3, 1)
    warm = BSpline(s.t, np.concatenate([s.c, heat], axis=-1), s.k)
    u2, u3 = along(0.7)
    for volume in (ms.extrude(warm), ms.ruled(warm, warm)):
        np.testing.assert_allclose(volume.extra(u3)[:, 0], warm(u2)[:, 3], atol=1e-12)
    turned = ms.revolve(warm, angle=1.0, center=(-2, 0, 0))
    np.testing.assert_allclose(turned.extra(u3[:, [2, 0, 1]])[:, 0], warm(u2)[:, 3], atol=1e-12)


# ------------------------------------------------------------------------------ revolve


@pytest.mark.parametrize("surface", [patch(), quarter_disc(), wavy()])
@pytest.mark.parametrize("angle", [0.5, 2.0, 2 * np.pi])
def test_revolved_points_keep_distance_and_height(surface, angle):
    axis, center = np.array([1.0, 2.0, 2.0]) / 3, np.array([-3.0, 1, 0])
    volume = ms.revolve(surface, axis * 7, angle, center=center)
    u2, _ = along(0)
    start = in_space(surface, u2) - center
    height, radius = start @ axis, np.linalg.norm(np.cross(axis, start), axis=1)
    for u in (0.0, 0.3, 1.0):
        x = volume.x(np.column_stack([np.full(100, u), u2])) - center
        np.testing.assert_allclose(x @ axis, height, atol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(np.cross(axis, x), axis=1), radius, rtol=1e-12)
    turned = np.cross(start, np.broadcast_to(axis, start.shape))  # end of the turn, Rodrigues
    c, s = np.cos(angle), np.sin(angle)
    expected = c * start - s * turned + (1 - c) * height[:, None] * axis
    np.testing.assert_allclose(x, expected, atol=1e-12)
    assert volume.closed[0] == (angle == 2 * np.pi)


def test_revolved_volume_follows_pappus():
    section = BSpline([LINE, LINE], [[(2, 0, 0), (3, 0, 0)], [(2, 0, 1), (3, 0, 2)]], 1)
    exact = 2 * np.pi * (1.0 * 2.5 + 0.5 * (2 + 2 / 3))  # a square and a triangle
    assert ms.revolve(section).volume() == pytest.approx(exact, rel=1e-9)
    assert ms.revolve(section, angle=1.0).volume() == pytest.approx(exact / (2 * np.pi), rel=1e-9)
    assert ms.revolve(section).orientation == 1


# ------------------------------------------------------------------------------ loft


def test_a_loft_passes_through_its_sections():
    sections = [wavy(i, height=h) for i, h in enumerate((0, 1, 2.5, 3, 5))]
    sections[2] = patch_at(2.5)
    volume = ms.loft(sections)
    assert volume.spline.k == (3, 2, 3)
    mean = [np.mean(np.linalg.norm(b.c - a.c, axis=-1)) for a, b in unified_pairs(sections)]
    at = np.concatenate([[0], np.cumsum(mean)]) / np.sum(mean)
    for w, s in zip(at, sections, strict=True):
        u2, u3 = along(min(w, 1.0))
        np.testing.assert_allclose(volume.x(u3), in_space(s, u2), atol=1e-11)


def patch_at(height):
    s = patch()
    return BSpline(s.t, s.c + np.array([0, 0, height]), s.k)


def unified_pairs(sections):
    """Neighbours as the loft compares them: on common knots."""
    from itertools import pairwise

    from ilattice.macroshape.sweeps import _unified

    return pairwise(_unified({str(i): s for i, s in enumerate(sections)}))


def test_a_loft_of_two_is_ruled():
    a, b = patch(), wavy(height=2)
    ruled, loft = ms.ruled(a, b), ms.loft([a, b])
    u = parameters(ruled, 100)
    np.testing.assert_allclose(loft.x(u), ruled.x(u), atol=1e-12)


def test_a_loft_reproduces_cubics_of_the_stations():
    at = np.array([0.0, 0.2, 0.5, 0.9, 1.0])
    base = BSpline([LINE, LINE], [[(0, 0, 0), (0, 1, 0)], [(1, 0, 0), (1, 1, 0)]], 1)

    def spine(w):
        return np.stack([w**3 - w, w**2, 4 * w], axis=-1)

    volume = ms.loft([BSpline(base.t, base.c + spine(w), 1) for w in at], at=at)
    u = parameters(volume, 100)
    flat = np.column_stack([u[:, :2], np.zeros(len(u))])
    np.testing.assert_allclose(volume.x(u), flat + spine(u[:, 2]), atol=1e-13)


def test_a_closed_loft_comes_back():
    angles = 2 * np.pi * np.arange(8) / 8
    square = np.array([[(3, 0, -1), (5, 0, -1)], [(3, 0, 1), (5, 0, 1)]], dtype=float)
    sections = []
    for a in angles:
        turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
        sections.append(BSpline([LINE, LINE], square @ turn.T, 1))
    volume = ms.loft(sections, closed=True)
    assert volume.closed == (False, False, True)
    assert volume.spline.shape == (2, 2, 11)
    for i, s in enumerate(sections):
        u2, u3 = along(i / 8)
        np.testing.assert_allclose(volume.x(u3), s(u2), atol=1e-12)
    assert volume.volume() == pytest.approx(2 * np.pi * 4 * 4, rel=5e-3)


def test_rational_sections_are_held_exactly():
    s = quarter_disc()
    lifted = [
        BSpline(s.t, np.concatenate([s.c, np.full((3, 2, 1), h)], axis=-1), s.k, weights=s.weights)
        for h in (0.0, 1.0, 3.0)
    ]
    volume = ms.loft(lifted)
    x = volume.x(parameters(volume, 200))
    r = np.hypot(x[:, 0], x[:, 1])
    u = parameters(volume, 200)
    np.testing.assert_allclose(r, 1 + u[:, 1], rtol=1e-12)
    assert volume.volume() == pytest.approx(3 * 3 * np.pi / 4, rel=1e-9)


# ------------------------------------------------------------------------------ bad arguments


CURVE = BSpline([LINE], [(0.0, 0, 0), (1, 0, 0)], 1)


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: ms.extrude(CURVE), "surface"),
        (lambda: ms.extrude(None), "surface"),
        (lambda: ms.extrude(patch(), (0, 0, 0)), "vector"),
        (lambda: ms.extrude(patch(), (0, 1)), "vector"),
        (lambda: ms.ruled(patch(), CURVE), "second"),
        (lambda: ms.ruled(patch(), ms.box().spline), "second"),
        (lambda: ms.ruled(patch(), BSpline(patch().t, np.ones((4, 3, 4)), 2)), "surfaces"),
        (lambda: ms.revolve(patch(), (0, 0, 0)), "axis"),
        (lambda: ms.revolve(patch(), angle=-1), "angle"),
        (lambda: ms.revolve(patch(), angle=6.3), "angle"),
        (lambda: ms.revolve("disc"), "surface"),
        (lambda: ms.loft([]), "sections"),
        (lambda: ms.loft([patch()]), "sections"),
        (lambda: ms.loft([patch(), patch_at(1)], closed=True), "sections"),
        (lambda: ms.loft([patch(), CURVE]), r"sections\[1\]"),
        (lambda: ms.loft([patch(), patch_at(1)], degree=0), "degree"),
        (lambda: ms.loft([patch(), patch_at(1)], degree=2.5), "degree"),
        (lambda: ms.loft([patch(), patch_at(1)], at=[0, 0]), "at"),
        (lambda: ms.loft([patch(), patch_at(1)], at=[0, 0.5, 1]), "at"),
    ],
)
def test_bad_arguments_are_named(make, name):
    with pytest.raises(InputError, match=f"^{name}"):
        make()


def test_equal_neighbours_are_refused():
    with pytest.raises(GeometryError, match=r"sections\[1\] and the next one coincide"):
        ms.loft([patch(), patch_at(1), patch_at(1)])


def test_weights_that_turn_negative_are_refused():
    s = quarter_disc()
    sections = [
        BSpline(
            s.t,
            np.concatenate([s.c, np.full((3, 2, 1), h)], axis=-1),
            s.k,
            weights=np.full((3, 2), w),
        )
        for h, w in ((0, 1.0), (1, 0.01), (1.2, 1.0), (3, 0.01), (4, 1.0))
    ]
    with pytest.raises(GeometryError, match="weights"):
        ms.loft(sections)


def test_uniform_knots_are_those_of_the_kernel():
    from ilattice.macroshape.sweeps import clamped

    np.testing.assert_allclose(clamped(10, 2), uniform_knots(8, 2))
