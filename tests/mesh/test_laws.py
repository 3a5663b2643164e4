"""Thickness that varies within edges of a mesh, and what is said of it."""

import warnings

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import ConvergenceError, GeometryError, PrecisionWarning

SLAB = il.Tile(lambda u: u[:, 2] - 0.5)
BETWEEN = "the half-thickness changes within edges of h="


def ridge(rng, width):
    """A slab of 0.1 with a ridge of 0.5 across, its law and its volume."""
    along, place = rng.integers(2), rng.uniform(0.3, 0.7)
    lattice = il.Lattice(SLAB, through=il.macroshape.box((1, 1, 1)))

    def law(u):
        return 0.05 + 0.2 * np.exp(-(((u[:, along] - place) / width) ** 2))

    return lattice, law, 0.1 + 0.4 * width * np.sqrt(np.pi)


def told(action):
    """What an action gives, and its error and warnings of precision."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            found, words = action(), []
        except (ConvergenceError, GeometryError) as e:
            found, words = None, [str(e)]
    words += [str(w.message) for w in caught if issubclass(w.category, PrecisionWarning)]
    return found, " | ".join(words)


@pytest.mark.parametrize("seed", range(3))
def test_peaks_between_planes_are_told(seed, tmp_path):
    """They used to vanish from mesh, file and slices without a word."""
    rng = np.random.default_rng(seed)
    width = rng.uniform(0.006, 0.01)
    lattice, law, volume = ridge(rng, width)
    wall = lattice.offset(law)
    h = width * rng.uniform(2.5, 3.5)
    mesh, words = told(lambda: wall.mesh(h))
    assert BETWEEN in words
    if mesh is not None and abs(mesh.volume / volume - 1.0) > 0.02:
        assert "less than the wall" in words
    assert BETWEEN in told(lambda: wall.slices([0.6], h=h))[1]
    assert BETWEEN in told(lambda: wall.save(tmp_path / "a.stl", h))[1]


@pytest.mark.parametrize("seed", range(3))
def test_laws_that_edges_follow_are_not_told(seed):
    rng = np.random.default_rng(seed)
    width = rng.uniform(0.06, 0.08)
    lattice, law, volume = ridge(rng, width)
    mesh, words = told(lambda: lattice.offset(law).mesh(0.4 * width))
    assert words == ""
    assert mesh.volume == pytest.approx(volume, rel=0.02)
    assert told(lambda: lattice.offset(lambda u: 0.05 + 0.1 * u[:, 0]).mesh(0.09))[1] == ""


@pytest.mark.parametrize("h", [0.05, 0.025])
def test_walls_with_edges_are_not_said_to_be_missing(h):
    """Points next to edges of the offset, where walls have met, counted as 16 % missing."""
    wall = il.Lattice("schwarz_p", through=il.macroshape.box((1, 1, 1))).offset(0.3)
    assert wall.thickness_error(wall.mesh(h)).missing < 5e-3


def test_walls_too_thin_for_any_mesh_are_refused_with_a_remedy_that_can_be_followed():
    lattice = il.Lattice("gyroid", through=il.macroshape.box((1, 1, 1)))
    with pytest.raises(GeometryError, match="make the wall thicker"):
        lattice.offset(1e-12).mesh(0.3)
