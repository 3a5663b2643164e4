"""Lattices as homogeneous solids: affine maps are exact, densities, what is refused."""

import pickle
import warnings

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import InputError, PrecisionWarning
from ilattice.homogenize import elastic, macro

coarse = pytest.mark.filterwarnings("ignore:the cells are too coarse", "ignore:tiles differ")
SHEARED = np.array([[2.0, 0.3, 0.0], [0.2, 1.0, 0.1], [0.0, 0.0, 1.3]])
QUICK = {"tile_cells": 6, "estimate": False}


def lattice(through, repeat, tile="schwarz_p"):
    return il.Lattice(tile, through=through, repeat=repeat)


@coarse
@pytest.mark.parametrize(
    ("tile", "d", "space", "off"),
    [
        ("schwarz_p", 0.04, "euclidean", 1e-9),
        ("schwarz_p", (0.02, 0.06), "euclidean", 1e-9),
        ("gyroid", 0.1, "parametric", 1e-9),
        # its kinks lie in diagonals of cells: rounding decides what is subdivided there
        ("cross", (np.inf, 0.0), "euclidean", 1e-7),
    ],
)
def test_through_an_affine_map_it_is_the_true_cell(tile, d, space, off):
    repeat = (4, 2, 3)
    through = il.macroshape.affine(SHEARED)
    wall = lattice(through, repeat, tile).offset(d, space=space)
    problem = macro(wall, 2, young=2.0, poisson=0.2, density=3.0, **QUICK)
    cell = lattice(il.macroshape.cell(SHEARED / repeat), 1, tile).offset(d, space=space)
    true = elastic(cell, 6, young=2.0, poisson=0.2, estimate=False)
    found = problem.material.stiffness
    assert found.axes == "space"
    np.testing.assert_allclose(found.value, true.C, atol=off * true.C.max())
    assert problem.material.density.value == pytest.approx(3.0 * true.density, rel=1e-9)
    bar = problem.clamp("u=0").load(gravity=(0, 0, -1.0)).solve()
    weight = 3.0 * true.density * np.linalg.det(SHEARED)
    assert bar.reactions["u=0"][2] == pytest.approx(weight, rel=1e-9)


@coarse
def test_what_changes_from_tile_to_tile_is_that_of_the_tile_there():
    ring = il.macroshape.torus(major=3.0, width=1.0)
    wall = lattice(ring, (18, 2, 2)).offset(lambda u: 0.04 + 0.03 * u[:, 1])
    problem = macro(wall, (6, 2, 2), samples=3, tile_cells=4, estimate=False)
    u = np.array([[0.13, 0.4, 0.3], [0.62, 0.9, 0.75]])
    asm = problem.domain.assembly(np.arange(len(problem.domain.parts)), weak=False)
    C = problem.material.matrices(asm, u)
    for one, p in zip(C, u, strict=True):
        J = ring.jacobian(p[None])[0]
        edges = J * np.ptp(ring.domain, axis=0) / (18, 2, 2)
        size = np.linalg.det(edges) ** (1 / 3)
        U, _, V = np.linalg.svd(J)
        shapes = problem_edges(ring, (18, 2, 2))
        d = (0.04 + 0.03 * p[1]) / size
        cell = il.Lattice("schwarz_p", through=il.macroshape.cell(U @ V @ shapes), repeat=1)
        true = elastic(cell.offset(d), 4, estimate=False)
        np.testing.assert_allclose(one, true.C, atol=1e-2 * true.C.max())
    whole = problem.clamp("v=0").load(gravity=(0, 0, -1.0))
    weight = whole.solve().reactions["v=0"][2]
    assert weight == pytest.approx(wall.volume(), rel=0.04)  # of the mean shape of tiles


def problem_edges(ring, repeat):
    """Mean shape of tiles along the axes of the map, of volume 1."""
    s = np.linspace(0, 1, 13)
    lo, hi = ring.domain
    u = lo + np.stack(np.meshgrid(s, s, s, indexing="ij"), -1).reshape(-1, 3) * (hi - lo)
    J = ring.jacobian(u)
    U, _, V = np.linalg.svd(J)
    edges = np.swapaxes(U @ V, 1, 2) @ J * (np.ptp(ring.domain, axis=0) / repeat)
    edges = edges / np.linalg.det(edges)[:, None, None] ** (1 / 3)
    mean = edges.mean(axis=0)
    return mean / np.linalg.det(mean) ** (1 / 3)


def test_tiles_of_different_shapes_are_told():
    thick = il.macroshape.torus(major=1.5, width=1.0)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        macro(lattice(thick, (9, 2, 2)).offset(0.06), (6, 2, 2), samples=2, **QUICK)
    assert any(
        issubclass(w.category, PrecisionWarning) and "tiles differ in shape" in str(w.message)
        and w.filename == __file__ for w in told
    )  # fmt: skip


def test_what_is_found_can_be_sent_to_other_processes():
    box = il.macroshape.box((2.0, 1.0, 1.0))
    wall = lattice(box, (4, 2, 2)).offset("0.05 + 0.02*u")
    problem = macro(wall, 2, samples=2, tile_cells=4, estimate=False)
    again = pickle.loads(pickle.dumps(problem))
    u = np.array([[0.3, 0.2, 0.6], [0.9, 0.1, 0.4]])
    C, D = (p.material.matrices(p.domain.assembly(np.zeros(1, int), weak=False), u)
            for p in (problem, again))  # fmt: skip
    np.testing.assert_array_equal(C, D)
    assert np.linalg.eigvalsh(C[1] - C[0]).min() > 0


@pytest.mark.filterwarnings("ignore:the solid does not go on")
def test_wrong_arguments():
    box = il.macroshape.box((2.0, 1.0, 1.0))
    wall = lattice(box, (4, 2, 2)).offset(0.05)
    for given, told in (
        ({"stiffness": np.eye(6)}, "stiffness"),
        ({"samples": 1}, "samples"),
        ({"smothness": 1}, "macro has no option 'smothness'; names like it: smoothness"),
        ({"density": -1.0}, "density"),
        ({"estimate": 3}, "estimate"),
        ({"young": -1.0}, "young"),
    ):
        with pytest.raises(InputError, match=told):
            macro(wall, 2, **{**QUICK, **given})
    with pytest.raises(InputError, match="wall"):
        macro(lattice(box, (4, 2, 2)), 2)
    sides = lattice(box, (2, 1, 1)).offset((lambda u: 0.05 + 0.05 * u[:, 0], 0.05))
    with pytest.raises(InputError, match="sides change differently"):
        macro(sides, 2, **QUICK)
    mixed = il.Lattice(il.tiles.mix("gyroid", "diamond", seed=1), through=box, repeat=(2, 1, 1))
    with pytest.raises(InputError, match="one tile"):
        macro(mixed.offset(0.05), 2, **QUICK)
    rods = il.tiles.skeleton([[(0, 0.5, 0.5), (1, 0.5, 0.5)]], radius=0.2)
    slack = il.Lattice(rods, through=box, repeat=(2, 1, 1))
    with pytest.raises(InputError, match="without resistance"):
        macro(slack.offset((np.inf, 0.0)), 2, **QUICK)
