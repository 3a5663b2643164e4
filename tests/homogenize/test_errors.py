"""Estimates of errors against finer cells, and the lines that warnings point at."""

import warnings

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import InputError, PrecisionWarning
from ilattice.homogenize import conductive, elastic
from ilattice.homogenize._edges import notched
from ilattice.homogenize.elastic import ElasticCell


def void(radius, at=(0.5, 0.5, 0.5)):
    return il.fields.complement(il.fields.translate(il.fields.sphere(radius), at))


TWO = il.fields.complement(il.fields.union(
    il.fields.translate(il.fields.sphere(0.3), (0.4, 0.5, 0.55)),
    il.fields.translate(il.fields.sphere(0.2), (0.75, 0.3, 0.25)),
))  # fmt: skip


def quietly(solve, *args, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PrecisionWarning)
        return solve(*args, **options)


@pytest.mark.parametrize(
    ("field", "fine", "runs"),
    [
        (void(0.3), 12, [(6, 2), (7, 2), (8, 1), (9, 1)]),
        (TWO, 12, [(7, 2), (8, 2), (9, 1)]),
    ],
)
def test_estimates_are_above_true_errors_and_of_their_size(field, fine, runs):
    """Of a solid on cells half as long the error is left out: a tenth of those here."""
    exact = np.diag(quietly(elastic, field, fine, estimate=False).C)
    for cells, degree in runs:
        eff = quietly(elastic, field, cells, degree=degree)
        true = ((np.diag(eff.C) - exact) / np.diag(eff.C)).max()
        assert true < eff.error < 12 * true
        assert np.linalg.eigvalsh(eff.errors)[0] > -1e-12  # as errors of energies are


@pytest.mark.parametrize(
    ("nodes", "radius", "fine", "runs"),
    [
        ([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], 0.12, 16, [(8, 1), (12, 1)]),
        ([(0, 0.5, 0.5), (0.5, 0, 0.5), (0.5, 0.5, 0)], 0.1, 32, [(12, 2)]),
    ],
    ids=["body-centred", "simple cubic"],
)
def test_estimates_hold_edges_that_turn_inwards(nodes, radius, fine, runs):
    """Energies come from above: what the fine cells leave, too, is the least that is true."""
    ends = nodes + [tuple(1 - x if x != 0.5 else x for x in p) for p in nodes if 0.5 in p]
    edges = [(0, i + 1) for i in range(len(ends))]
    tile = il.tiles.struts([(0.5, 0.5, 0.5), *ends], edges, radius)
    exact = np.diag(quietly(elastic, tile, fine, estimate=False).C)
    for cells, degree in runs:
        eff = quietly(elastic, tile, cells, degree=degree)
        least = (np.diag(eff.C) - exact) / np.diag(eff.C)
        assert (least < np.diag(eff.errors) / np.diag(eff.C)).all()
        assert eff.error < 6 * least.max()


def test_estimates_of_conductivities():
    exact = np.diag(quietly(conductive, TWO, 12, estimate=False).k)
    eff = quietly(conductive, TWO, 7)
    true = ((np.diag(eff.k) - exact) / np.diag(eff.k)).max()
    assert true < eff.error < 12 * true


def test_estimates_may_be_left_out():
    eff = elastic(void(0.3), 4, estimate=False)
    assert np.isnan(eff.error)
    assert np.isnan(eff.errors).all()
    with pytest.raises(InputError, match="estimate must be"):
        elastic(void(0.3), 4, estimate="no")


def test_warnings_point_at_the_line_of_the_caller():
    with pytest.warns(PrecisionWarning, match="the effective stiffness is off by about") as told:
        elastic(void(0.45), 5)
    with pytest.warns(PrecisionWarning, match="too coarse to tell .* 4 or more") as blind:
        conductive(void(0.3), 3)
    with pytest.warns(PrecisionWarning, match="nothing is borne") as borne:
        conductive(il.fields.translate(il.fields.sphere(0.3), (0.5, 0.5, 0.5)), 4)
    for warning in (*told, *blind, *borne):
        assert warning.filename == __file__


def test_moduli_in_which_entries_cancel_are_told_to_be_off_by_more():
    """Struts that bend: C11 and C12 are nearly equal, and E is a small part of them."""
    tile = il.tiles.bcc_struts(radius=0.1)
    cell = il.Lattice(tile, through=il.macroshape.cell(np.eye(3))).offset((np.inf, 0.0))
    fine = quietly(elastic, cell, 14)
    with pytest.warns(PrecisionWarning, match="entries cancel, such as E, by up to"):
        eff = elastic(cell, 8)
    off = eff.E((1, 0, 0)) / fine.E((1, 0, 0)) - 1.0
    assert off > 2.0 * (eff.C[0, 0] / fine.C[0, 0] - 1.0)
    assert off < eff.modulus_error
    assert eff.modulus_error > 2.0 * eff.error
    assert eff.as_dict()["modulus_error"] == eff.modulus_error
    stiff = il.Lattice("gyroid", through=il.macroshape.cell(np.eye(3))).offset(0.1)
    eff = quietly(elastic, stiff, 9)
    assert eff.modulus_error < 2.0 * eff.error


@pytest.mark.parametrize("waves", [1, 4, 8, 12, 16])
def test_errors_hold_materials_that_wave_within_cells(waves):
    """Layers across x have a harmonic mean, whatever splines on eight cells see of them."""
    phase = np.random.default_rng(waves).random()

    def young(x):
        return 1.0 + 0.9 * np.sin(2 * np.pi * (waves * x[:, 0] + phase))

    def full(u):
        return -np.ones(len(u))

    exact = np.sqrt(1.0 - 0.9**2)
    eff = quietly(elastic, full, (8, 4, 4), young=young, poisson=0.0)
    assert abs(eff.C[0, 0] - exact) < 1.05 * eff.errors[0, 0]
    heat = quietly(conductive, full, (8, 4, 4), conductivity=young)
    assert abs(heat.k[0, 0] - exact) < 1.05 * heat.errors[0, 0]


def test_errors_hold_materials_that_jump_within_cells():
    """Random layers that end in the midst of cells."""

    def full(u):
        return -np.ones(len(u))

    for seed in range(5):
        rng = np.random.default_rng(seed)
        start, part, soft = rng.random(), rng.uniform(0.2, 0.7), 10.0 ** rng.uniform(-2, -0.5)

        def young(x, start=start, part=part, soft=soft):
            return np.where((x[:, 0] - start) % 1.0 < part, soft, 1.0)

        exact = 1.0 / (part / soft + 1.0 - part)
        eff = quietly(elastic, full, (9, 4, 4), young=young, poisson=0.0)
        assert abs(eff.C[0, 0] - exact) < 1.05 * eff.errors[0, 0]


def test_edges_that_lie_on_planes_of_the_grid_are_told_from_flat_faces():
    """A void of half the width, and layers; bars are convex."""
    box = il.fields.translate(il.fields.box((0.25, 0.25, 0.25)), (0.5, 0.5, 0.5))
    layers = il.fields.equation("abs(x - 0.5) - 0.25")
    bar = il.fields.equation("max(abs(x - 0.5), abs(y - 0.5)) - 0.25")
    for field, sharp in ((il.fields.complement(box), True), (layers, False), (bar, False)):
        assert notched(ElasticCell(field, 8).domain) == sharp
    board = ElasticCell(il.fields.box(9.0), 8, phases=bar, young=(1.0, 2.0))
    assert notched(board.domain)


@pytest.mark.filterwarnings("ignore:the cells are too coarse")
@pytest.mark.parametrize(("steep", "cells"), [(3.0, 16), (9.0, 8), (9.0, 16)])
def test_material_that_jumps_between_cells_is_told_and_estimated(steep, cells):
    """From the last to the first cells: layers have a harmonic mean."""
    full = il.fields.box(1e9)
    options = {"young": lambda x: 1.0 + steep * x[:, 0], "poisson": 0.0}
    with pytest.warns(PrecisionWarning, match="the material jumps by a factor of"):
        eff = elastic(full, cells, **options)
    exact = steep / np.log(1.0 + steep)
    assert eff.C[0, 0] - exact < eff.errors[0, 0] < 12 * (eff.C[0, 0] - exact)
    with warnings.catch_warnings():
        warnings.simplefilter("error", PrecisionWarning)
        bent = elastic(full, cells, smoothness=0, **options)
    assert bent.C[0, 0] == pytest.approx(exact, rel=1e-3)
