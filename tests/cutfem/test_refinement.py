"""Refinement studies: orders and limits that are known."""

import numpy as np
import pytest

from ilattice.cutfem import Heat, RefinementStudy, refinement_study
from ilattice.cutfem.refinement import observed_order
from ilattice.errors import InputError


def full(u):
    return -np.ones(len(u))


def rod(n, degree=1):
    """Heat cos(x) is made along a rod, and none passes its end x = 0: T = cos(x)."""
    problem = Heat(full, n, domain=[[0.0] * 3, [1.0, 0.5, 0.5]], degree=degree)
    return problem.fix("u=1", np.cos(1.0)).source(lambda x: np.cos(x[:, 0])).solve(tol=1e-12)


NORM2 = 0.25 * (0.5 - np.sin(2.0) / 4.0)  # the integral of sin² over the rod


@pytest.mark.parametrize("ratios", [(1.0, 0.5, 0.25), (1.0, 0.7, 0.3)])
@pytest.mark.parametrize("p", [1.0, 2.5, 4.0])
def test_orders_of_powers_are_found(p, ratios):
    h = 0.3 * np.array(ratios)
    assert observed_order(h, 7.0 - 2.0 * h**p) == pytest.approx(p, rel=1e-9)
    assert np.isnan(observed_order(h, np.array([1.0, 2.0, 1.5])))
    assert np.isnan(observed_order(h, np.array([1.0, 2.0, 2.0])))
    assert np.isnan(observed_order(h, np.array([1.0, 1.1, 2.0])))


@pytest.mark.parametrize(("degree", "rel"), [(1, 1e-4), (2, 1e-7)])
def test_order_and_limit_of_a_known_energy(degree, rel):
    calls = []
    study = refinement_study(
        lambda n: rod(n, degree),
        [(4, 2, 2), (6, 3, 3), (8, 4, 4)],
        {"norm2": lambda s: s.error_estimate().norm ** 2},
        error_estimate=True,
        progress=lambda *done: calls.append(done),
    )
    assert study.order("norm2")[-1] == pytest.approx(2.0 * degree, abs=0.15)
    assert np.isnan(study.order("norm2")[:2]).all()
    assert study.limit("norm2") == pytest.approx(NORM2, rel=rel)
    np.testing.assert_allclose(
        study.error("norm2"), np.abs(study.values["norm2"] / NORM2 - 1), rtol=0.15
    )
    estimated = -np.polyfit(np.log(study.cells[:, 0]), np.log(study.estimates), 1)[0]
    assert estimated == pytest.approx(degree, abs=0.15)
    np.testing.assert_allclose(study.h, 1.0 / study.cells[:, 0])
    assert study.functions.tolist() == [np.prod(np.array(n) + degree) for n in study.cells.tolist()]
    assert [done[1:] for done in calls] == [(1, 3), (2, 3), (3, 3)]


def test_studies_are_printed_and_drawn(tmp_path):
    values = {"work": np.array([1.2, 1.1, 1.05]), "noise": np.array([1.0, 2.0, 1.5])}
    cells = np.array([[2, 1, 1], [4, 2, 2], [8, 4, 4]])
    study = RefinementStudy(
        cells, 1.0 / cells[:, 0], cells.prod(axis=1), values, np.full(3, np.nan)
    )
    lines = str(study).splitlines()
    assert lines[0].split() == ["cells", "h", "functions", "work", "order", "noise", "order"]
    assert lines[3].split() == ["8x4x4", "0.125", "128", "1.05", "1.00", "1.5"]
    assert lines[4] == "work: tends to 1; the finest grid is off by 5 %"
    assert "no order" in lines[5]
    study.plot().savefig(tmp_path / "study.png")
    assert (tmp_path / "study.png").stat().st_size > 5000
    with pytest.raises(InputError, match="work, noise"):
        study.limit("energy")


@pytest.mark.parametrize(
    ("cells", "quantities", "message"),
    [
        ([4, 8], {"e": len}, "three"),
        ([4, 8, 8], {"e": len}, "same factor"),
        ([(4, 2, 2), (6, 2, 2), (8, 4, 4)], {"e": len}, "same factor"),
        ([4, 6, 8], {}, "quantities"),
        ([4, 6, 8.5], {"e": len}, "cells"),
    ],
)
def test_bad_studies_are_refused(cells, quantities, message):
    with pytest.raises(InputError, match=message):
        refinement_study(rod, cells, quantities)
