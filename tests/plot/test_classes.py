"""``plot()`` of every class, by what must be in its picture: never by stored pixels."""

import numpy as np
import pytest
from PIL import Image

import ilattice as il

SIZE = (260, 200)
pytestmark = pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")


@pytest.fixture(scope="module")
def things():
    """One of each class, made when it is asked for."""
    box = il.macroshape.box((2.0, 1.0, 1.0)).with_extra(r=lambda u: u[:, 0], g=0.0, b=0.4)
    lattice = il.Lattice("schwarz_p", through=box, repeat=(2, 1, 1), spans_per_tile=6)
    wall = lattice.offset(0.15)
    problem = il.cutfem.Elasticity(wall, (8, 4, 4), density=1.0, degree=1).clamp("u=0")
    solution = problem.load(gravity=(0, 0, -1)).solve()
    heat = il.cutfem.Heat(wall, (8, 4, 4), degree=1).fix("u=0", 0.0).source(1.0)
    cell = il.fields.complement(il.fields.translate(il.fields.sphere(0.35), (0.5, 0.5, 0.5)))
    k = il.cost.kagome(3).stiffened()
    load = il.cost.stress.balanced(k, np.random.default_rng(0).normal(size=k.positions.shape))
    return {
        "tile": il.tiles.gyroid,
        "solid tile": lambda: il.tiles.octet(radius=0.1),
        "shell tile": lambda: il.shells.cell("topo_19_rrr", n=10).tile,
        "map": il.macroshape.torus,
        "lattice": lambda: lattice,
        "wall": lambda: wall,
        "mesh": lambda: wall.mesh(0.12),
        "solid mesh": lambda: il.mesh.hexahedra(wall, (12, 6, 6)),
        "slices": lambda: wall.slices(z=[0.2, 0.5, 0.8]),
        "cells": lambda: il.cutfem.cut(wall, (32, 16, 16)),  # some inside on the end faces
        "solution": lambda: solution,
        "recovered": solution.recovered,
        "estimate": solution.error_estimate,
        "mode": lambda: il.cutfem.natural_modes(problem, 1)[0],
        "modes": lambda: il.cutfem.natural_modes(problem, 2),
        "temperature": heat.solve,
        "history": lambda: heat.evolve(1.0, steps=3),
        "stiffness": lambda: il.homogenize.elastic(cell, 4, degree=1, estimate=False),
        "conductivity": lambda: il.homogenize.conductive(cell, 4, degree=1, estimate=False),
        "structure": lambda: k,
        "forces": lambda: k.stress(load),
    }


NAMES = ("tile", "solid tile", "shell tile", "map", "lattice", "wall", "mesh", "solid mesh",
         "slices", "cells", "solution", "recovered", "estimate", "mode", "modes", "temperature",
         "history", "stiffness", "conductivity", "structure", "forces")  # fmt: skip
#: What is coloured by its data or by red, green and blue of its own.
COLOURED = {"wall", "mesh", "cells", "solution", "recovered", "estimate", "mode", "modes",
            "temperature", "history", "stiffness", "conductivity", "forces"}  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_pictures_are_filled_and_coloured(things, name, tmp_path):
    """At least 60 per cent of the short side; several colours where they are data."""
    size = (3 * SIZE[0], SIZE[1]) if name in ("modes", "history") else SIZE
    things[name]().plot(screenshot=tmp_path / "a.png", size=size, off_screen=True)
    picture = np.asarray(Image.open(tmp_path / "a.png"))[..., :3].astype(int)
    assert picture.shape == (size[1], size[0], 3)
    part = picture[:, : int(0.84 * size[0])]  # beside it is the bar of colours
    rows, columns = (part.sum(axis=2) < 3 * 245).nonzero()
    high, wide = np.ptp(rows) / size[1], np.ptp(columns) / size[0]
    assert max(high, wide * size[0] / size[1]) >= 0.6
    away = part - part.mean(axis=2, keepdims=True)
    hues = np.unique((away[np.abs(away).max(axis=2) > 25] > 0).astype(int), axis=0)
    assert len(hues) >= (2 if name in COLOURED else 1)


@pytest.mark.parametrize("name", ["wall", "mesh"])
def test_clips_of_classes_show_the_colour_of_caps(things, name, tmp_path):
    caps = []
    for clip in (None, "y > 0.437"):
        options = {"cap": "lime", "view": "front", "occlusion": False, "clip": clip}
        things[name]().plot(screenshot=tmp_path / "a.png", size=SIZE, off_screen=True, **options)
        p = np.asarray(Image.open(tmp_path / "a.png"))[..., :3].astype(int)
        caps.append(((p[..., 1] > 2 * p[..., 0]) & (p[..., 1] > 2 * p[..., 2])).mean())
    assert caps[0] == 0.0
    assert caps[1] > 0.02


def test_colours_of_a_part_are_seen_where_they_are(things, tmp_path):
    """Red grows along x, and x points to the right."""
    things["wall"]().plot(screenshot=tmp_path / "a.png", size=SIZE, view="front", off_screen=True)
    p = np.asarray(Image.open(tmp_path / "a.png"))[..., :3].astype(int)
    red, blue = p[..., 0] > p[..., 2] + 50, p[..., 2] > p[..., 0] + 50
    assert red.mean() > 0.05
    assert blue.mean() > 0.02
    assert np.nonzero(red)[1].min() > np.nonzero(blue)[1].mean()


def test_figures_have_what_is_in_them(things):
    """Curves and areas by matplotlib: bands, slices, graphs."""
    layer = things["slices"]()[1]
    (patch, *_) = layer.plot().axes[0].patches
    assert len(patch.get_path().vertices) >= len(layer.loops[0])
    graph = il.graph.library["octet"].plot(stages=False)
    assert graph.axes
    ball = il.fields.translate(il.fields.sphere(0.3), (0.5, 0.5, 0.5))
    cell = il.fields.complement(ball)
    bands = il.homogenize.bloch(cell, cells=4, path="GX", count=3, steps=1, degree=1)
    lines = bands.plot().axes[0].lines
    assert len(lines) >= 3


def test_bars_of_numbers_without_signs_begin_at_zero(things):
    from ilattice.cost.drawing import drawn

    k = things["structure"]()
    values = np.zeros(len(k.edges))
    values[:3] = 1.0
    for sign, low in ((1.0, 0.0), (-1.0, -1.0)):
        layers = drawn(k, values=sign * values, label="broken").layers
        assert {layer.style["clim"] for layer in layers} == {(low, 1.0)}
