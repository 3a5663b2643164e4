"""Quads that are proved not to cross, against all pairs compared."""

from dataclasses import replace

import numpy as np
import pytest

import ilattice as il
from ilattice.mesh.contouring import contour_arrays
from ilattice.mesh.creases import sharpened
from ilattice.mesh.envelopes import enclosed
from ilattice.mesh.measure import self_intersections

F = il.fields


def thin(rng):
    """Sheets about as thick as the cells, turned, so that cells hold two of them."""
    tile = rng.choice(["gyroid", "d-surface", "p-surface"])
    sheet = F.shell(il.sdf.parse(f"{tile} scale {rng.uniform(0.7, 1.4)}"), rng.uniform(0.05, 0.4))
    return F.rotate(sheet, rng.uniform(0, 3), tuple(rng.standard_normal(3)))


def solids(rng):
    """Primitives off the grid, of which some are cut from the others."""
    parts = []
    for _ in range(6):
        made = (F.sphere, F.box, F.cylinder)[rng.integers(3)](rng.uniform(0.15, 0.5))
        turned = F.rotate(made, rng.uniform(0, 3), tuple(rng.standard_normal(3)))
        parts.append(F.translate(turned, tuple(rng.uniform(-0.8, 0.8, 3))))
    return F.difference(F.union(*parts[:4]), F.union(*parts[4:]))


def noise(rng):
    """Waves much shorter than the cells."""
    way, phase = 40.0 * rng.standard_normal((3, 12)), rng.uniform(0, 6, 12)
    box = [[-1.0] * 3, [1.0] * 3]
    return F.from_callable(lambda p: np.cos(p @ way + phase).sum(axis=1), bounds=box)


def planes(rng):
    """Even ones, or such of which the distances differ by a lot."""
    if rng.random() < 0.5:
        return [np.linspace(-1.0, 1.0, 26)] * 3
    some = [np.sort(np.r_[-1.0, rng.uniform(-1, 1, 4), 1.0]) for _ in range(3)]
    return [np.interp(np.linspace(0, 5, 24), np.arange(6), a) for a in some]


def shaken(rng, made):
    """With a tenth of the vertices moved by up to half a cell and more."""
    free = (made.kind[:, None] >> (2 * np.arange(3))) & 3 == 0
    free &= rng.random((len(free), 1)) < 0.1
    x = made.vertices + np.where(free, 0.08 * rng.uniform(-0.6, 0.6, free.shape), 0.0)
    return replace(made, vertices=np.clip(x, -1.0, 1.0))


def scattered(rng, raw, axes):
    """With vertices anywhere in their cells."""
    x = raw.vertices.copy()
    for a, p in enumerate(axes):
        free = (raw.kind >> (2 * a)) & 3 == 0
        c = np.clip(np.searchsorted(p, x[free, a], "right") - 1, 0, len(p) - 2)
        x[free, a] = p[c] + rng.random(len(c)) * (p[c + 1] - p[c])
    return replace(raw, vertices=x)


def meshes(make, seed):
    """Contours of a field, as they are, sharpened, shaken and scattered, with their planes."""
    rng = np.random.default_rng(seed)
    field, axes = make(rng), planes(rng)
    raw = contour_arrays(field, axes)
    made = raw if make is noise else sharpened(raw, field, axes)
    moved = shaken(rng, made), scattered(rng, raw, axes)
    return [(c, axes) for c in (raw, made, *moved)]


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("make", [thin, solids, noise])
def test_quads_that_are_proved_not_to_cross_do_not(make, seed):
    for made, axes in meshes(make, seed):
        proved = enclosed(made, axes)
        faces = made.faces.reshape(-1, 6)[proved].reshape(-1, 3)
        assert self_intersections(made.vertices, faces)[0] == 0
        # so all pairs are found where only the other quads are compared with all
        pairs, marked = self_intersections(made.vertices, made.faces)
        some, at = self_intersections(made.vertices, made.faces, np.repeat(~proved, 2))
        assert some == pairs
        assert np.array_equal(at, marked)


def level(z, axes):
    """A contour of a horizontal plane."""
    box = [[-1.0] * 3, [1.0] * 3]
    return contour_arrays(F.from_callable(lambda p: p[:, 2] - z, bounds=box), axes)


def test_two_quads_that_came_to_surround_one_edge_are_not_proved():
    """Two planes in layers of cells above each other, of which one is moved to the other."""
    axes = [np.linspace(-1.0, 1.0, 9)] * 3
    one, two = level(0.1, axes), level(0.35, axes)
    x = np.concatenate([one.vertices, two.vertices - [0.0, 0.0, 0.25]])
    x[len(one.vertices) :, 2] += 0.1 * x[len(one.vertices) :, 0]
    faces = np.concatenate([one.faces, two.faces + len(one.vertices)]).astype(one.faces.dtype)
    made = replace(one, vertices=x, faces=faces, kind=np.concatenate([one.kind, two.kind]))
    proved = enclosed(made, axes)
    assert self_intersections(x, faces)[0] > 0
    assert self_intersections(x, faces.reshape(-1, 6)[proved].reshape(-1, 3))[0] == 0


@pytest.mark.parametrize("z", [0.1, 1e-5])
def test_planes_next_to_corners_of_the_grid_are_not_proved(z):
    """On which side of the corners they are may be a matter of rounding."""
    axes = [np.linspace(-1.0, 1.0, 9)] * 3
    made = level(0.1, axes)
    x = made.vertices.copy()
    x[np.abs(x[:, 2] - 0.1) < 1e-6, 2] = z
    on = (x[made.faces].reshape(-1, 18)[:, 2::3] == z).all(axis=1)
    assert on.sum() > 40
    assert (enclosed(replace(made, vertices=x), axes)[on] == (z > 1e-4)).all()


@pytest.mark.parametrize("words", ["gyroid", "gyroid shell 0.45"])
def test_most_quads_are_proved_also_where_cells_hold_two_sheets(words):
    axes = [np.linspace(-1.0, 1.0, 61)] * 3
    made = contour_arrays(il.sdf.parse(words), axes)
    assert enclosed(made, axes).mean() > 0.99


@pytest.mark.parametrize("seed", range(4))
def test_what_crosses_does_not_depend_on_the_order_of_triangles(seed):
    """Over slivers all is flat: they used to lie in one plane with others, or not."""
    rng = np.random.default_rng(seed)
    made = meshes(solids, seed)[1][0]
    pairs, marked = self_intersections(made.vertices, made.faces)
    for _ in range(3):
        order = rng.permutation(len(made.faces))
        some, at = self_intersections(made.vertices, made.faces[order])
        assert some == pairs
        assert np.array_equal(at, marked[order])
