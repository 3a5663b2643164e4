"""Walls to a tolerance: the distance spline is refined until the unpolished wall is good enough."""

from dataclasses import replace

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import ConvergenceError, InputError
from ilattice.offsets import tolerance
from ilattice.offsets.distance_spline import distance_spline


@pytest.fixture(scope="module")
def lattice():
    """Gyroid whose focal curves come near to walls of half-thickness 0.14."""
    return il.Lattice(il.tiles["gyroid"], through=il.macroshape.box((1, 1, 1.2)), repeat=(1, 1, 1))


def test_a_tolerance_holds_on_the_unpolished_wall(lattice):
    d = 0.14
    plain = lattice.offset(d).thickness_error()
    assert plain.relative > 0.01
    report = lattice.offset(d, tol=0.01 * d).thickness_error()
    assert report.relative <= 0.01
    assert report.max < plain.max


def test_a_loose_tolerance_changes_nothing(lattice):
    plain = lattice.offset(0.05)
    assert lattice.offset(0.05, tol=0.005).distance is plain.distance


def test_a_tolerance_that_is_not_met_says_what_is(lattice, monkeypatch):
    monkeypatch.setattr(tolerance, "MAX_SPANS_PER_TILE", 20)
    with pytest.raises(ConvergenceError, match=r"tol=0.001 .* 20 spans per tile"):
        lattice.offset(0.14, tol=1e-3)


@pytest.mark.parametrize("tol", [0.0, -1.0, np.nan])
def test_tolerances_are_positive(lattice, tol):
    with pytest.raises(InputError, match="tol"):
        lattice.offset(0.1, tol=tol)


@pytest.mark.parametrize("d", [0.06, 0.14, (np.inf, 0.05)])
def test_few_closest_points_do_as_well_as_all(lattice, d, monkeypatch):
    """32, then 64 spans: the wall is as good as with distances at all of the 64³ sites."""
    asked, least = [], 2.5e-4
    ask = il.Lattice.distance
    monkeypatch.setattr(
        il.Lattice, "distance", lambda self, u: asked.append(len(u)) or ask(self, u)
    )
    wall = lattice.offset(d)
    for spans in (32, 64):
        samples = tolerance._Samples(wall, spans // 2, spans, least)
        asked.clear()
        spline = tolerance.interpolated(lattice, samples, spans, 2)
        wall = replace(wall, distance=spline)
    assert sum(asked) < 0.4 * 64**3
    whole = replace(wall, distance=distance_spline(lattice, 64))
    mesh = whole.mesh(h=0.03, polish=False)
    few, all_ = wall.thickness_error(wall.mesh(h=0.03, polish=False)), whole.thickness_error(mesh)
    assert few.p99 < 1.1 * all_.p99 + 0.1 * least
    assert few.max < 1.1 * all_.max + least


def test_a_tolerance_holds_for_varying_walls_of_closed_maps():
    through = il.macroshape.torus(major=1.0, width=1.0)
    lattice = il.Lattice("schwarz_p", through=through, repeat=(4, 1, 1))
    lo, hi = lattice.domain

    def d(u):
        return 0.12 + 0.08 * np.sin(2 * np.pi * (u[:, 0] - lo[0]) / (hi[0] - lo[0]))

    plain, wall = lattice.offset(d), lattice.offset(d, tol=2e-3)
    assert plain.thickness_error(plain.mesh(h=0.04, polish=False)).p99 > 4e-3
    assert wall.thickness_error(wall.mesh(h=0.04, polish=False)).p99 <= 2e-3


def test_a_wall_that_fills_the_part_needs_no_refinement():
    lattice = il.Lattice("schwarz_p", through=il.macroshape.box(), repeat=(1, 1, 1))
    wall = lattice.offset(0.6)
    assert tolerance.refined(wall, 1e-6) is wall
