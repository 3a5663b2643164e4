"""Walls to a tolerance: the distance spline is refined until the unpolished wall is good enough."""

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import ConvergenceError, InputError
from ilattice.offsets import wall as wall_module


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
    monkeypatch.setattr(wall_module, "MAX_SPANS_PER_TILE", 20)
    with pytest.raises(ConvergenceError, match=r"tol=1e-09 .* 20 spans per tile"):
        lattice.offset(0.14, tol=1e-9)


@pytest.mark.parametrize("tol", [0.0, -1.0, np.nan])
def test_tolerances_are_positive(lattice, tol):
    with pytest.raises(InputError, match="tol"):
        lattice.offset(0.1, tol=tol)
