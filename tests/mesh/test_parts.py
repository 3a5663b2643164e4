"""Parts of meshes of solids against those of their fields."""

import warnings

import combinations as cb
import numpy as np
import pytest

import ilattice as il
from ilattice.errors import PrecisionWarning
from ilattice.mesh.parts import joined


@pytest.mark.parametrize("seed", range(8))
def test_voxels_are_joined_as_by_walking_through_them(seed):
    rng = np.random.default_rng(seed)
    inside = rng.random(rng.integers(3, 9, 3)) < rng.uniform(0.1, 0.5)
    closed = rng.random(3) < 0.5
    for corners in (True, False):
        expected = cb._joined(inside, closed, np.ones((3, 3, 3)) if corners else None)
        assert joined(inside, closed, corners=corners) == expected


def test_webs_that_are_lost_are_told():
    """The default length of edges goes by the volume and the area, and webs are thinner."""
    through = il.macroshape.cylinder_shell(angle=1.1)
    solid = il.Lattice("honeycomb_lidinoid", through=through).offset((np.inf, 0.0))
    with pytest.warns(PrecisionWarning, match=r"has 3 parts where the solid has 2: .*; use h <= "):
        mesh = solid.mesh(0.06)
    assert cb.solid_parts(mesh) == 3
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert cb.solid_parts(solid.mesh()) == 2


def test_bars_of_a_seam_are_one_part():
    """Cut open, each of the pieces would be counted."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        lattice = il.Lattice("gyroid", through=il.macroshape.torus(), repeat=(6, 1, 1))
        assert lattice.offset((np.inf, 0.0)).mesh().components == 1
