"""How far volumes of walls are off, against volumes that are known exactly."""

import warnings

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import PrecisionWarning
from ilattice.offsets import volume_points
from ilattice.offsets.volume_points import Estimate, Rounded, VolumePoints
from ilattice.offsets.wall import BOXES

SIDES = np.array([1.1, 0.9, 1.3])


def planes(d, **options):
    """Two planes per tile, a quarter and three quarters up; their walls leave slits."""
    tile = il.Tile(lambda u: np.cos(2.0 * np.pi * u[:, 2]))
    return il.Lattice(tile, through=il.macroshape.box(SIDES), **options).offset(d)


@pytest.mark.parametrize("slit", [0.02, 0.033, 0.05, 0.12])
def test_volumes_are_off_by_what_is_told(slit):
    d = SIDES[2] * (0.25 - 0.5 * slit)
    wall = planes(d)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        volume = wall.volume()
    off = abs(volume - SIDES.prod() * (1.0 - 2.0 * slit))
    assert off <= wall.volume_error <= 1.6 * off + 3e-3 * volume
    assert [w.category for w in told] == ([PrecisionWarning] if off > 0.013 * volume else [])


def test_the_remedy_helps():
    d = SIDES[2] * 0.24
    with pytest.warns(PrecisionWarning, match=r"exact distances give .* less: .* spans_per_tile"):
        planes(d).volume()
    fine = planes(d, spans_per_tile=96)
    assert fine.volume() == pytest.approx(SIDES.prod() * 0.96, rel=2e-3)


def test_exact_distances_are_asked_for_near_the_surfaces_only(monkeypatch):
    """And give what they give everywhere."""
    wall = il.Lattice("c_y", through=il.macroshape.duck(), repeat=(2, 1, 1)).offset(0.11)
    points, asked = VolumePoints(wall, 1 << 11), []
    exact = type(wall)._true_distance
    monkeypatch.setattr(
        type(wall), "_true_distance", lambda w, u: (asked.append(len(u)), exact(w, u))[1]
    )
    few = points.rounded
    s = exact(wall, points.u)
    change = points.weight * ((np.abs(s) < 0.11) * 1.0 - (wall.field(points.u) < 0.0))
    assert few.volume == pytest.approx(change.sum(), rel=1e-12)
    assert 0 < sum(asked) < 0.7 * len(points.u)


@pytest.mark.parametrize(
    ("rough", "change", "asked"),
    [(True, 0.1, [1]), (True, 0.0101, [1, 4, 16]), (False, 0.1, [1, 16])],
)
def test_few_points_are_asked_for_where_they_are_slow_and_decide(monkeypatch, rough, change, asked):
    wall, boxes = planes(0.1), []
    volume = wall.volume()

    def found(points):
        boxes.append(points.boxes)
        return Rounded(change * volume, 2e-3 * volume, rough)

    monkeypatch.setattr(VolumePoints, "rounded", property(found))
    del wall.__dict__["_rounded"]
    assert wall.volume_error == pytest.approx((change + 4e-3) * volume)
    assert boxes == [BOXES * n // 16 for n in asked]


def test_estimates_are_off_by_their_standard_errors():
    """Walls thicker and thinner than boxes, through maps of which one squeezes."""
    shapes = [
        ("gyroid", il.macroshape.box((1, 1, 1)), 0.1),
        ("diamond", il.macroshape.duck(), (0.0, 0.03)),
        ("schwarz_p", il.macroshape.torus(), lambda u: 0.01 + 0.01 * u[:, 0]),
        ("primitive", il.macroshape.cylinder_shell(), 0.004),
    ]
    off = []
    for tile, through, d in shapes:
        wall = il.Lattice(tile, through=through, repeat=(3, 1, 1)).offset(d)
        found = [VolumePoints(wall, boxes).filled for boxes in (1 << 12, 1 << 15)]
        assert found[1].error < 0.5 * found[0].error < 0.1 * found[0].volume
        off += [(f.volume - wall.volume()) / f.error for f in found]
    assert max(map(abs, off)) < 3.0
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.5


def test_estimates_do_not_change_with_the_points_that_are_looked_at_at_once(monkeypatch):
    wall = il.Lattice("gyroid", through=il.macroshape.duck()).offset(0.1)
    whole, u = VolumePoints(wall, 4096).filled, VolumePoints(wall, 4096).u
    monkeypatch.setattr(volume_points, "TOGETHER", 77)
    some = VolumePoints(wall, 4096)
    np.testing.assert_array_equal(some.u, u)
    assert some.filled == pytest.approx(whole, rel=1e-12)
    part = np.where(wall.field(u) < 0.0, some.weight, 0.0)
    assert whole.volume == pytest.approx(part.sum(), rel=1e-12)


def test_little_is_known_of_walls_that_few_points_are_in():
    wall = il.Lattice("gyroid", through=il.macroshape.box((1, 1, 1))).offset(1e-4)
    assert VolumePoints(wall, 8).filled == Estimate(0.0, np.inf, 8)
    points = VolumePoints(wall, 4096)
    hit = points.weight[wall.field(points.u) < 0.0]
    assert 0 < len(hit) < 9
    assert points.filled.error == pytest.approx(3.0 * hit.max())  # more than their root


def test_more_boxes_are_asked_for_the_smaller_the_error_should_be():
    estimate = Estimate(1.0, 0.01, 1000)
    assert estimate.more(0.0025) == 8000
    assert estimate.more(0.009) == 2000
    assert [estimate.more(e) for e in (1e-5, 0.0)] == [32000, 32000]
    assert estimate._replace(error=np.inf).more(0.01) == 32000


def test_solids_as_they_are_are_off_by_their_splines():
    wall = il.Lattice("schwarz_p", through=il.macroshape.box(SIDES)).offset((np.inf, 0.0))
    assert abs(wall.volume() - 0.5 * SIDES.prod()) <= wall.volume_error < 5e-3
