"""Graded cell size: where cells end, that the shape stays, what is refused."""

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import ConvergenceError, GeometryError, InputError
from ilattice.macroshape import regrade
from ilattice.macroshape.grading import _least_slope, _pace

SHAPES = il.macroshape
GRADED = [0.0, 0.1, 0.25, 0.5, 1.0]
WAVE = [0.0, 0.1, 0.25, 0.55, 0.8, 0.9, 1.0]


def composed(volume, axis, ends, u):
    """The volume at parameters moved along by the pace."""
    pace, _ = _pace("u", ends, volume.domain[:, axis], volume.closed[axis])
    moved = u.copy()
    moved[:, axis] = pace(u[:, axis])
    return moved


def points(volume, n=3000):
    return np.random.default_rng(0).uniform(*volume.domain, (n, 3))


CASES = [
    (SHAPES.box((4, 1, 1)), 0, GRADED),
    (SHAPES.box((4, 1, 1)), 2, [0.0, 0.02, 0.04, 0.5, 1.0]),  # too uneven for a C2 pace
    (SHAPES.duck(), 2, GRADED),
    *((SHAPES.torus(form=form), 0, WAVE) for form in ("periodic", "arcs", "exact")),
    (SHAPES.cylinder_shell(), 0, [0.0, 0.02, 0.04, 0.8, 1.0]),
]


@pytest.mark.parametrize(("volume", "axis", "ends"), CASES)
def test_the_volume_is_the_same_at_another_pace(volume, axis, ends):
    new = regrade(volume, **{"uvw"[axis]: ends})
    u = points(volume)
    size = np.linalg.norm(np.ptp(volume.spline.c[..., :3].reshape(-1, 3), axis=0))
    moved = composed(volume, axis, ends, u)
    assert np.abs(new.x(u) - volume.x(moved)).max() <= 1e-9 * size
    assert new.closed == volume.closed
    assert new.orientation == volume.orientation
    np.testing.assert_array_equal(new.domain, volume.domain)
    assert new.volume() == pytest.approx(volume.volume(), rel=1e-7)


@pytest.mark.parametrize(("volume", "axis", "ends"), CASES)
def test_cells_end_where_asked(volume, axis, ends):
    new = regrade(volume, **{"uvw"[axis]: ends})
    u = points(volume, len(ends))
    u[:, axis] = np.linspace(0, 1, len(ends))
    there = u.copy()
    there[:, axis] = ends
    np.testing.assert_allclose(new.x(u), volume.x(there), atol=1e-8)


def test_tiles_fill_the_graded_cells():
    bar = regrade(SHAPES.box((4, 1, 1)), u=GRADED)
    lattice = il.Lattice("gyroid", through=bar, repeat=(4, 1, 1))
    x = np.random.default_rng(1).random((40, 3))
    at = [bar.inverse(np.column_stack([np.full(40, 4 * g), x[:, 1:]])) for g in GRADED]
    faces = np.stack([lattice.implicit(u) for u in at])
    np.testing.assert_allclose(faces, np.broadcast_to(faces[0], faces.shape), atol=1e-6)
    assert np.abs(faces[0]).max() > 0.5


@pytest.mark.parametrize(
    ("ends", "smooth"), [(GRADED, 2), ([0.0, 0.02, 0.04, 0.5, 1.0], 1), ([0.0, 1.0], 2)]
)
@pytest.mark.parametrize("closed", [False, True])
def test_paces_ascend_and_are_as_smooth_as_they_say(ends, smooth, closed):
    domain = np.array([0.0, 1.0])
    pace, found = _pace("u", ends, domain, closed)
    assert found == smooth
    s = np.linspace(0, 1, 20001)
    assert np.diff(pace(s)).min() > 0
    assert _least_slope(pace) == pytest.approx(pace(s, 1).min(), abs=1e-3)
    np.testing.assert_allclose(pace(pace.x), ends, atol=1e-14)
    for order in range(found + 1):
        jumps = np.diff(
            [pace(np.nextafter(pace.x[1:-1], 0), order), pace(pace.x[1:-1], order)], axis=0
        )
        seam = pace(1.0, order) - pace(0.0, order) - (order == 0)
        assert np.abs(jumps).max(initial=0.0) <= 1e-9
        assert not closed or abs(seam) <= 1e-9


def test_extra_coordinates_are_carried_along():
    volume = SHAPES.torus(form="exact").with_extra(d=lambda u: 0.1 + 0.05 * u[:, 1], r=0.5)
    new = regrade(volume, v=GRADED)
    u = points(volume)
    assert new.names == ("d", "r")
    expected = volume.extra(composed(volume, 1, GRADED, u))
    np.testing.assert_allclose(new.extra(u), expected, atol=1e-9)


def test_several_directions_at_once():
    new = regrade(SHAPES.box((1, 1, 1)), u=GRADED, v=[0.0, 0.3, 1.0])
    x = new.x([[0.25, 0.5, 0.5], [0.75, 0.5, 0.25]])
    np.testing.assert_allclose(x, [[0.1, 0.3, 0.5], [0.5, 0.3, 0.25]], atol=1e-12)


def test_the_tolerance_is_met_or_refused():
    duck = SHAPES.duck()
    coarse = regrade(duck, w=GRADED, tol=1e-3)
    fine = regrade(duck, w=GRADED, tol=1e-11)
    assert coarse.spline.shape[2] < fine.spline.shape[2]
    with pytest.raises(ConvergenceError, match=r"direction w.*raise tol"):
        regrade(duck, w=GRADED, tol=1e-18)


@pytest.mark.parametrize(
    ("ends", "message"),
    [
        ([0.0, 0.5, 0.4, 1.0], "u must hold at least two ascending"),
        ([0.0, 0.5, 0.5, 1.0], "ascending"),
        ([1.0], "at least two"),
        ([0.0, 0.5], "u must run from 0 to 1, the ends of the domain, got 0 to 0.5"),
        ([-0.1, 0.5, 1.0], "u must run from 0 to 1"),
        ([0.0, np.nan, 1.0], "u must be finite"),
        ([[0.0, 1.0]], "u must have 1 axes"),
    ],
)
def test_ends_that_are_no_cells_are_refused(ends, message):
    with pytest.raises(InputError, match=message):
        regrade(SHAPES.box(), u=ends)


@pytest.mark.parametrize("volume", [3, None, "box"])
def test_what_is_no_volume_is_refused(volume):
    with pytest.raises(InputError, match="volume must be a SplineMap"):
        regrade(volume, u=[0.0, 1.0])


def test_a_folded_volume_is_refused():
    s = SHAPES.box((1, 1, 1)).spline.elevate(0)
    c = s.c.copy()
    c[1, :, :, 0] = 1.5
    folded = il.SplineMap(il.BSpline(s.t, c, s.k))
    with pytest.raises(GeometryError, match="volume is folded"):
        regrade(folded, u=GRADED)
