"""Closest points of surfaces with sharp edges, against samples of them that are close together."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

import ilattice as il

#: Planes per direction of the grid on whose edges the surface is sampled.
PLANES = 97


def samples(field):
    """Points of the zero set of a field on the unit cube: where edges of a grid cross it."""
    axis = np.linspace(0.0, 1.0, PLANES)
    values = field.grid([axis] * 3)
    out = []
    for a in range(3):
        f = np.moveaxis(values, a, 0)
        at = np.nonzero((f[:-1] < 0.0) != (f[1:] < 0.0))
        low = np.empty((len(at[0]), 3))
        low[:, [a, *(b for b in range(3) if b != a)]] = axis[np.column_stack(at)]
        high, negative = low + np.eye(3)[a] / (PLANES - 1), f[at] < 0.0
        for _ in range(20):
            middle = 0.5 * (low + high)
            below = ((field(middle) < 0.0) == negative)[:, None]
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        out.append(0.5 * (low + high))
    return np.concatenate(out)


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
@pytest.mark.parametrize(
    ("tile", "count"), [("re_entrant_honeycomb", 8000), ("fcc_plates", 10_000)]
)
def test_no_sample_of_a_surface_with_sharp_edges_is_nearer(tile, count):
    sides = np.array([0.8, 1.7, 0.65])
    lattice = il.Lattice(tile, through=il.macroshape.box(sides))
    u = np.random.default_rng(7).random((count, 3))
    found = lattice.closest(u)
    assert (found.status < 2).all()
    near = cKDTree(samples(lattice.smooth_tile) * sides).query(u * sides)[0]
    too_far = np.abs(found.distance) / near - 1.0
    assert too_far.max() <= 1e-5
    assert np.median(too_far) > -5e-2  # samples are as close together as they should be


@pytest.mark.parametrize(
    ("tile", "sides"),
    [
        ("f", (1.07, 0.94, 0.16)),
        ("f", (0.8, 1.7, 0.65)),
        ("honeycomb_diamond", (0.16, 1.07, 0.94)),
        ("honeycomb_gyroid", (0.14, 1.07, 0.94)),
    ],
)
def test_no_sample_of_a_surface_that_meets_itself_is_nearer(tile, sides):
    """Where fields have no slope, seeds used to be far away, and other sheets took their place."""
    lattice = il.Lattice(tile, through=il.macroshape.box(sides))
    u = np.random.default_rng(7).random((8000, 3))
    near = cKDTree(samples(lattice.smooth_tile) * sides).query(u * sides)[0]
    too_far = np.abs(lattice.closest(u).distance) / near - 1.0
    assert too_far.max() <= 1e-5


def _ball(centre, radius):
    return lambda u: np.linalg.norm((u - centre) * [1.0, 1.2, 0.8], axis=1) - radius


def _waves(normal, phase):
    return lambda u: (
        (u - 0.5) @ normal + 0.1 * np.sin(7 * u[:, 0] + phase) * np.cos(5 * u[:, 1] - phase)
    )


def _octahedron(_centre, radius):
    return lambda u: np.abs(u - 0.5).sum(axis=1) - 0.45 - 0.5 * radius


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
@pytest.mark.parametrize("boundary", ["extend", "clip"])
@pytest.mark.parametrize("make", [_ball, _waves, _octahedron])
def test_no_sample_of_tiles_that_do_not_fit_is_nearer(make, boundary):
    """Where surfaces of neighbours do not meet, or at an angle; there is no continuation then."""
    rng = np.random.default_rng([1, len(make.__name__), len(boundary)])
    repeat, sides = rng.permutation([1, 2, 3]), rng.uniform(0.5, 2.0, 3)
    tile = il.Tile(make(rng.uniform(0.2, 0.8, 3), rng.uniform(0.3, 0.6)))
    size = repeat * sides
    lattice = il.Lattice(
        tile, through=il.macroshape.box(size), repeat=tuple(repeat.tolist()), boundary=boundary
    )
    lower, upper = np.where(lattice.ends, 0, -1), repeat + np.where(lattice.ends, 0, 1)
    axes = [np.arange(a, b) for a, b in zip(lower, upper, strict=True)]
    tiles = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    surface = (samples(lattice.smooth_tile) + tiles).reshape(-1, 3) * sides
    u = rng.random((3000, 3))
    found = lattice.closest(u)
    assert (found.status < 2).all()
    near = cKDTree(surface).query(u * size)[0]
    distance = np.abs(found.distance)
    assert (distance <= near * (1 + 1e-5) + 1e-7).all()
    assert (near - distance).max() < 0.02 * sides.max()  # samples are as close as they should be


def test_surfaces_of_one_layer_end_with_it():
    lattice = il.Lattice("pyramidal", through=il.macroshape.box((1, 1.3, 0.8)))
    assert lattice.ends.tolist() == [False, False, True]
    assert lattice.fits.tolist() != [True] * 3
    found = lattice.closest(np.random.default_rng(5).random((4000, 3)))
    assert (found.status < 2).all()
    assert (found.u[:, 2] >= 0.0).all()
    assert (found.u[:, 2] <= 1.0).all()
