"""Clouds of homogenized shells, and surrogates with known inverses."""

import warnings

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import GeometryError, InputError, PrecisionWarning
from ilattice.homogenize.rows import Rows
from ilattice.shells import Cloud, Surrogate, space
from ilattice.shells.inverse import Surrogate as Inner
from ilattice.shells.study import sampled


def exact(parameters):
    """Moduli of a made-up shell: the position counts twice."""
    p, d, rho = parameters.T
    young = rho**1.5 * np.exp(0.5 * (d - 1.5) + p**2)
    poisson = 0.3 + 0.2 * p**2 - 0.05 * (d - 1.5)
    return np.column_stack([young, poisson, 1.0 + 0.1 * p])


@pytest.fixture(scope="module")
def model():
    of = space("topo_19_rrr")
    x = of.points(200)
    young, poisson, zener = exact(x).T
    return Surrogate(Cloud(of, x, young, poisson, zener, x[:, 2], Rows(())), 8, 0.03, 4)


def test_predictions_are_those_of_the_samples_and_near_them(model):
    x = model.cloud.space.points(256)[200:]
    for row in x[:20]:
        found = model.predict(model.cloud.space.named(row))
        young, poisson, zener = exact(row[None])[0]
        assert found["young"] == pytest.approx(young, rel=0.01)
        assert found["poisson"] == pytest.approx(poisson, abs=2e-3)
        assert found["zener"] == pytest.approx(zener, rel=2e-3)
    for wrong in ({"position": 0.0, "derivative": 3.0, "density": 0.3}, {"position": 0.0}, 3):
        with pytest.raises(InputError, match=r"derivative must be from 1 to 2|parameters"):
            model.predict(wrong)
    own = model.cloud.parameters[3]
    assert model.predict(model.cloud.space.named(own))["young"] == pytest.approx(
        model.cloud.young[3], rel=1e-9
    )
    errors = model.errors()
    assert errors["young"] < 0.01
    assert errors["poisson"] < 2e-3


def test_inversion_finds_all_solutions(model):
    young, poisson, _ = exact(np.array([[0.25, 1.4, 0.3]]))[0]
    found = model.invert(young=young, poisson=poisson, density=0.3, count=4, verify=False)
    best = [s for s in found if s.distance < 5e-3]
    assert sorted(np.sign(s.parameters["position"]) for s in best) == [-1.0, 1.0]
    for s in best:
        assert abs(s.parameters["position"]) == pytest.approx(0.25, abs=0.02)
        assert s.parameters["derivative"] == pytest.approx(1.4, abs=0.02)
        assert s.parameters["density"] == 0.3
        assert not s.verified


def test_what_no_shell_has_is_told_by_its_distance(model):
    with pytest.warns(PrecisionWarning, match="out of reach"):
        found = model.invert(young=10.0, poisson=0.3, density=0.3, verify=False)
    assert min(s.distance for s in found) > 0.9


def test_verification_corrects_once(model, monkeypatch):
    calls = []

    def biased(self, x):
        calls.append(x)
        young, poisson, zener = exact(self.cloud.space.placed(x)[None])[0]
        return np.array([1.03 * young, poisson + 0.004, zener])

    monkeypatch.setattr(Inner, "_homogenized", biased)
    young, poisson, _ = exact(np.array([[0.25, 1.4, 0.3]]))[0]
    found = model.invert(young=young, poisson=poisson, density=0.3, count=1)
    assert len(calls) == 2
    assert found[0].verified
    assert found[0].distance < 5e-3  # without correction 0.03

    def fails(*_):
        raise GeometryError("curves cross")

    monkeypatch.setattr(Inner, "_homogenized", fails)
    with pytest.raises(GeometryError, match="no shell is found for these moduli: curves cross"):
        model.invert(young=young, poisson=poisson, density=0.3)


@pytest.mark.parametrize(
    "bad",
    [{"young": -1.0}, {"poisson": 0.7}, {"density": 0.9}, {"count": 0}, {"young": None}],
)
def test_bad_targets(model, bad):
    with pytest.raises(InputError, match=next(iter(bad))):
        model.invert(**{"young": 0.06, "poisson": 0.31, "density": 0.3, **bad})


def test_bad_ranges():
    for ranges, density, word in (
        (None, 0.3, "ranges must be given for c13"),
        ({"position": (0, 1)}, 0.3, "names position and derivative"),
        ({"position": (0.2, 0.1), "derivative": (1, 2)}, 0.3, "position must be a range"),
        ({"position": (0.1, 0.2), "derivative": (1, 2)}, 1.3, "density must be between"),
    ):
        with pytest.raises(InputError, match=word):
            space("c13_rrr", ranges, density)
    with pytest.raises(InputError, match="cubic symmetry"):
        il.shells.cloud("topo_1_ttt", 2)


def test_points_are_kept_when_there_are_more(model):
    of = model.cloud.space
    assert (of.points(5) == of.points(100)[:5]).all()
    assert (of.points(64) >= of.low).all()
    assert (of.points(64) <= of.high).all()


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
def test_clouds_are_homogenized_cells_and_go_on_with_their_table(tmp_path):
    table = tmp_path / "t.csv"
    how = {"n": 8, "cells": 4, "density": 0.5, "table": table}
    one = il.shells.cloud("topo_19_rrr", 1, **how)
    two = il.shells.cloud("topo_19_rrr", 2, **how)
    assert len(table.read_text().splitlines()) == 3
    assert two.young[0] == one.young[0]
    wall = sampled(space=two.space, seed=0, n=8, layer=0.03, sample=1)
    eff = il.homogenize.elastic(wall, 4, estimate=False)
    assert two.young[1] == pytest.approx(eff.E((1, 0, 0)), rel=1e-9)
    assert two.poisson[1] == pytest.approx(eff.nu((1, 0, 0), (0, 1, 0)), rel=1e-6)
    assert two.density == pytest.approx(0.5, abs=1e-3)
    with pytest.raises(GeometryError, match="a surrogate of 3 parameters needs 18"):
        il.shells.surrogate("topo_19_rrr", 2, **how)


def test_hulls():
    square = np.array([[0, 0], [1, 0], [1, 2], [0, 2], [0.5, 1]], np.float64)
    assert il.shells.hull_area(*square.T) == pytest.approx(2.0)
    assert il.shells.hull_area(np.arange(4.0), np.arange(4.0)) == 0.0


def made_up(ranges, density=(0.2, 0.4), count=60):
    of = space("topo_19_rrr", ranges, density)
    x = of.points(count)
    young, poisson, zener = exact(x).T
    return Surrogate(Cloud(of, x, young, poisson, zener, x[:, 2], Rows(())), 8, 0.03, 4)


def test_fixed_parameters_make_no_different_solutions():
    model = made_up({"position": (0.1, 0.1), "derivative": (1.0, 2.0)})
    young, poisson, _ = exact(np.array([[0.1, 1.4, 0.3]]))[0]
    found = model.invert(young=young, poisson=poisson, density=0.3, count=5, verify=False)
    assert len(found) == 1
    assert found[0].parameters["derivative"] == pytest.approx(1.4, abs=0.01)
    both = made_up({"position": (0.1, 0.1), "derivative": (1.5, 1.5)})
    young, poisson, _ = exact(np.array([[0.1, 1.5, 0.3]]))[0]
    found = both.invert(young=young, poisson=poisson, density=0.3, count=5, verify=False)
    assert len(found) == 1
    assert found[0].distance < 0.01
    with pytest.raises(InputError, match="ranges must not all be fixed"):
        made_up({"position": (0.1, 0.1), "derivative": (1.5, 1.5)}, 0.3)


def test_moduli_out_of_reach_are_told(model):
    young, poisson, _ = exact(np.array([[0.25, 1.4, 0.3]]))[0]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.invert(young=young, poisson=poisson, density=0.3, verify=False)
    with pytest.warns(PrecisionWarning, match=r"out of reach.* off by .*young"):
        found = model.invert(young=0.29, poisson=poisson, density=0.3, verify=False)
    assert found[0].distance > 0.1
    with pytest.warns(PrecisionWarning, match=r"out of reach.*poisson"):
        model.invert(young=young, poisson=-0.3, density=0.3, verify=False)


def test_too_few_shells_for_parts_are_told():
    few = made_up(None, count=18)
    assert few.errors(folds=3)["young"] < 0.1
    with pytest.raises(InputError, match="folds must leave 10 shells"):
        few.errors(folds=2)


def test_wrong_spaces_points_and_seeds_are_told():
    of = space("topo_19_rrr")
    for wrong in (-3, 2.5, "a"):
        with pytest.raises(InputError, match="count must be"):
            of.points(wrong)
    for wrong in (-1, 1.5, None):
        with pytest.raises(InputError, match="seed must be a whole number from 0"):
            of.points(3, wrong)
        with pytest.raises(InputError, match="seed must be a whole number from 0"):
            il.shells.cloud("topo_19_rrr", 1, seed=wrong)
    for wrong in (np.zeros((2, 2)), "a", np.full((1, 3), 1.5)):
        with pytest.raises(InputError, match="unit"):
            of.placed(wrong)
    for wrong in (np.zeros(2), "abc"):
        with pytest.raises(InputError, match="row"):
            of.named(wrong)
    for wrong in (([0.0, np.nan, 1.0], [0.0, 1.0, 1.0]), ([0.0, 1.0], [0.0, 1.0, 2.0]), ("a", [1])):
        with pytest.raises(InputError, match=r"x|y"):
            il.shells.hull_area(*wrong)


@pytest.mark.parametrize(
    ("ranges", "told"),
    [
        ({"position": (-2.0, 0.2), "derivative": (1.0, 2.0)}, "position must be .*-0.99 to 0.99"),
        ({"position": (-0.2, 0.2), "derivative": (0.0, 2.0)}, "derivative must be .*100"),
        ({"position": (-0.2, 0.2), "derivative": (1.0, 200.0)}, "derivative must be .*100"),
    ],
)
def test_ranges_that_no_boundary_has_are_refused_before_any_work(ranges, told):
    with pytest.raises(InputError, match=told):
        space("topo_19_rrr", ranges)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [({"n": 4}, "n must be"), ({"layer": -1.0}, "layer must be"), ({"cells": 1}, "cells must be")],
)
def test_wrong_arguments_of_clouds_are_no_failed_rows(wrong, told):
    with pytest.raises(InputError, match=told):
        il.shells.cloud("topo_19_rrr", 1, **wrong)
