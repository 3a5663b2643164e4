"""Climbs to the greatest distances, against exact ones and against the points around."""

import numpy as np
import pytest

import ilattice as il
from ilattice.offsets.critical import critical_points
from ilattice.offsets.excess import Excess
from ilattice.offsets.several_feet import SeveralFeet
from ilattice.offsets.summits import climbed

NODE = np.sqrt(3) / 4  # of Schwarz P in a unit cell: its middle to the flat points
#: Middles of struts of one labyrinth of the gyroid, where its voids close.
MIDDLES = np.array([[0.5, 0.375, 0.25], [0.25, 0.5, 0.875], [0.125, 0.75, 0.5], [0.375, 0.25, 0.5]])


@pytest.fixture(scope="module")
def bent():
    through = il.macroshape.cylinder_shell(2.0, 3.0, 1.0, angle=0.4)
    return il.Lattice("gyroid", through=through, repeat=(1, 1, 1))


def test_the_middle_of_schwarz_p_is_found():
    excess = Excess(il.Lattice("schwarz_p", through=il.macroshape.box()))
    u, value = climbed(excess, np.array([[0.45, 0.53, 0.5], [0.6, 0.6, 0.45]]))
    np.testing.assert_allclose(u, 0.5, atol=1e-6)
    np.testing.assert_allclose(value, NODE, atol=1e-9)


def test_what_is_taken_off_moves_the_summit():
    """Off a distance that is at most NODE - |x| / sqrt(3) next to its greatest value."""
    lattice = il.Lattice("schwarz_p", through=il.macroshape.box())
    wall = lattice.offset(lambda u: 0.1 + 0.02 * u[:, 0])
    excess = Excess(lattice, wall.thickness.inner, wall.thickness.outer)
    u, value = climbed(excess, np.array([[0.45, 0.53, 0.5]]))
    np.testing.assert_allclose(u, 0.5, atol=1e-6)
    np.testing.assert_allclose(value, NODE - 0.11, atol=1e-8)


def test_nothing_around_a_summit_of_a_bent_gyroid_is_higher(bent):
    """Its voids close next to focal curves, where two pairs of feet become two feet."""
    excess = Excess(bent)
    rng = np.random.default_rng(0)
    start = MIDDLES + 0.02 * rng.normal(size=MIDDLES.shape)
    before = excess.value(start)
    u, value = climbed(excess, start)
    assert len(u) == len(start)
    assert (value > before + 1e-4).all()
    assert np.abs(u - MIDDLES).max() < 0.05
    for centre, top in zip(u, value, strict=True):
        for reach in (1e-3, 1e-2):
            around = excess.value(centre + rng.uniform(-reach, reach, (400, 3)))
            assert around.max() <= top + 1e-9


def test_voids_of_a_bent_gyroid_are_reported(bent):
    """Though its feet are too close to each other to be solved for."""
    (u,), (value,) = climbed(Excess(bent), MIDDLES[1:2])
    box = np.stack([u - 0.04, u + 0.04])
    found = critical_points(bent, value - 1e-4, value + 1e-4, within=box)
    assert [p.kind for p in found] == ["void"]
    assert found[0].value == pytest.approx(value, abs=1e-7)
    assert found[0].change == -1


def test_no_start_has_no_end():
    excess = Excess(il.Lattice("schwarz_p", through=il.macroshape.box()))
    u, value = climbed(excess, np.empty((0, 3)))
    assert u.shape == (0, 3)
    assert value.shape == (0,)


@pytest.mark.parametrize("size", [1e-5, 1.0, 1e3])
def test_as_many_feet_are_nearest_in_any_unit(size):
    """Of the middle of a pore all eight; of a point beside it, 0.3 % of a tile nearer to one, 1."""
    lattice = il.Lattice("schwarz_p", through=il.macroshape.box(size))
    beside = 0.5 + 0.01 * np.array([0.3, 0.6, 1.0])
    middle, other = SeveralFeet(Excess(lattice))(np.array([[0.5] * 3, beside]))
    assert middle.nearest.sum() == 8
    assert other.nearest.sum() == 1
