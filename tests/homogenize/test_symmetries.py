"""Loads that follow from others by symmetry: as many as there are, and never a wrong one."""

import warnings
from dataclasses import replace

import naive_homogenize as naive
import numpy as np
import pytest

import ilattice as il
from ilattice.errors import PrecisionWarning
from ilattice.homogenize import ConductiveCell, ElasticCell, cell, elastic

pytestmark = pytest.mark.filterwarnings("ignore:the cells are too coarse")
GYROID = "sin(2*pi*x)*cos(2*pi*y) + sin(2*pi*y)*cos(2*pi*z) + {}*sin(2*pi*z)*cos(2*pi*x) - 0.2"


def ellipsoid(a, b, c, at=(0.5, 0.5, 0.5)):
    axes, at = np.array([a, b, c]), np.array(at)
    return lambda u: 1.0 - (((u - at) / axes) ** 2).sum(axis=1)


def solved(field, cells, monkeypatch=None, kind=ElasticCell, **options):
    """With or, if it may patch, without symmetries."""
    if monkeypatch is not None:
        monkeypatch.setattr(cell, "ways", lambda *_: {})
    eff = kind(field, cells, **options).homogenized(estimate=False)
    return (eff.C if kind is ElasticCell else eff.k), eff.report


@pytest.mark.parametrize(
    ("field", "cells", "options", "loads"),
    [
        (il.fields.equation(GYROID.format(1)), 6, {}, 2),
        (ellipsoid(0.3, 0.3, 0.2), 6, {}, 4),
        (ellipsoid(0.3, 0.25, 0.2), 6, {}, 6),
        (ellipsoid(0.3, 0.3, 0.3), (6, 6, 5), {}, 4),
        (ellipsoid(0.3, 0.3, 0.3, (0.5, 0.52, 0.5)), 6, {}, 4),
        (ellipsoid(0.3, 0.3, 0.3), 6, {"degree": 1}, 2),
        (ellipsoid(0.3, 0.3, 0.3), 4, {"smoothness": 0}, 2),
    ],
)
def test_loads_follow_where_the_cell_is_symmetric(field, cells, options, loads, monkeypatch):
    C, report = solved(field, cells, **options)
    assert report.loads == loads
    assert np.isnan(report.symmetry) if loads == 6 else report.symmetry < 1e-3
    whole, report = solved(field, cells, monkeypatch, **options)
    assert report.loads == 6
    np.testing.assert_allclose(C, whole, atol=1e-9 * whole.max())


@pytest.mark.parametrize(
    ("field", "told"),
    [
        (ellipsoid(0.3, 0.303, 0.3), 1e-4),
        (ellipsoid(0.3, 0.3, 0.3, (0.501, 0.5, 0.5)), 1e-6),
        (ellipsoid(0.3, 0.3 + 1e-7, 0.3), 1e-9),
        (il.fields.equation(GYROID.format(1.01)), 1e-4),
    ],
)
def test_cells_that_are_nearly_symmetric_are_not_taken_for_symmetric(field, told, monkeypatch):
    """Solutions are what they are without symmetries; the difference of directions is seen."""
    C, _ = solved(field, 6)
    whole, _ = solved(field, 6, monkeypatch)
    np.testing.assert_allclose(C, whole, atol=1e-10 * whole.max())
    apart = np.ptp(np.diag(whole)[:3]) / whole.max()
    assert apart > told / 10
    assert np.ptp(np.diag(C)[:3]) / whole.max() == pytest.approx(apart, rel=1e-2)


def test_a_wrong_symmetry_costs_steps_only(monkeypatch):
    """All cells are said to be alike: candidates are wrong, and solutions are not."""
    field = ellipsoid(0.32, 0.27, 0.2)
    whole, _ = solved(field, 6, monkeypatch)
    monkeypatch.undo()
    monkeypatch.setattr("ilattice.homogenize._symmetry.ALIKE", 10.0)
    C, report = solved(field, 6)
    assert report.loads > 2
    np.testing.assert_allclose(C, whole, atol=1e-9 * whole.max())


def test_conduction_and_two_phases(monkeypatch):
    field = ellipsoid(0.3, 0.3, 0.2)
    k, report = solved(field, 6, kind=ConductiveCell)
    assert report.loads == 2
    np.testing.assert_allclose(k, solved(field, 6, monkeypatch, ConductiveCell)[0], atol=1e-10)
    monkeypatch.undo()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PrecisionWarning)
        options = {"young": (1.0, 9.0), "phases": ellipsoid(0.3, 0.3, 0.3)}
        C, report = solved(lambda u: -np.ones(len(u)), 5, **options)
    assert np.ptp(np.diag(C)[:3]) < 1e-4 * C.max()
    assert report.loads == 6  # cells of two phases have two elements


@pytest.mark.parametrize(
    ("field", "symmetry"),
    [("diamond", "cubic"), ("gyroid", "cubic"), (lambda x: 0.2 + np.sin(2 * np.pi * x) @ [1, 2, 3],
     "orthotropic"), (lambda x: np.cos(2 * np.pi * x) @ [1, 1, 2] - 0.4, "tetragonal"),
     (lambda x: 0.3 - np.sin(2 * np.pi * x) @ [1, 1, 1] - 0.5 * np.sin(
         2 * np.pi * (x[:, 0] + x[:, 1] - 2 * x[:, 2])), "anisotropic")],
)  # fmt: skip
def test_cells_do_not_hide_the_symmetry_of_the_solid(field, symmetry):
    """Five and six cells have no planes where screw axes of the diamond's are."""
    nearly_isotropic = isinstance(field, str)
    if nearly_isotropic:
        field = il.Lattice(field, through=il.macroshape.cell(), repeat=1)
        field = field.offset(relative_density=0.3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PrecisionWarning)
        eff = elastic(field, 6)
    assert eff.of_solid == eff.symmetry == symmetry
    turned = replace(eff, C=eff.rotated(naive.random_rotation(np.random.default_rng(3))))
    if nearly_isotropic:  # by less than the estimate: turned ones may still pass for cubic
        assert eff.error > min(turned.distances.values())
    else:
        assert turned.symmetry == "anisotropic"
