"""Stresses inside of cells under mean stresses: full cells, laminates, means, first yield."""

import warnings

import numpy as np
import pytest

from ilattice.cutfem.stresses import von_mises
from ilattice.errors import InputError
from ilattice.homogenize import ElasticCell

STRESS = np.array([1.0, -0.4, 0.3, 0.2, -0.5, 0.7])


def full(u):
    return -np.ones(len(u))


def void(u):
    d = u - (0.47, 0.53, 0.5)
    return 1.0 - (((d - np.rint(d)) / (0.3, 0.24, 0.2)) ** 2).sum(axis=1)


def test_a_full_cell_has_the_mean_stress_everywhere(tmp_path):
    cell = ElasticCell(full, 3, young=2.0, poisson=0.2, strength=5.0)
    local, u = cell.under(STRESS), np.random.default_rng(0).random((20, 3))
    np.testing.assert_allclose(local.stress(u), np.tile(STRESS, (20, 1)), atol=1e-12)
    equivalent = float(von_mises(STRESS[None])[0])
    np.testing.assert_allclose(local.von_mises(u), equivalent, rtol=1e-12)
    np.testing.assert_allclose(cell.first_yield([STRESS, 2 * STRESS]) * equivalent, [5.0, 2.5])
    strain = local.strain(u)[0]
    np.testing.assert_allclose(strain[0], (1.0 + 0.2 * 0.1) / 2.0, rtol=1e-12)
    shift = local.evaluate(u) - local.evaluate(u[::-1])
    E = np.array([[strain[0], strain[5] / 2, strain[4] / 2],
                  [strain[5] / 2, strain[1], strain[3] / 2],
                  [strain[4] / 2, strain[3] / 2, strain[2]]])  # fmt: skip
    np.testing.assert_allclose(shift, (u - u[::-1]) @ E, atol=1e-12)
    local.save(tmp_path / "local.vtu", on="solid")
    assert (tmp_path / "local.vtu").stat().st_size > 500


@pytest.mark.parametrize("poisson", [(0.3, 0.2), (0.0, 0.0)])
def test_layers_share_a_stress_by_their_stiffness(poisson):
    E, nu, part = np.array([1.0, 10.0]), np.array(poisson), np.array([0.42, 0.58])
    cell = ElasticCell(
        full, (8, 3, 3), domain=[[0, 0, 0], [1, 0.5, 0.5]], phases="abs(u - 0.503) - 0.21",
        young=tuple(E), poisson=poisson, strength=(3.0, 2.0),
    )  # fmt: skip
    u = np.array([[0.5, 0.1, 0.2], [0.05, 0.3, 0.4]])
    across = cell.under((1.0, 0, 0, 0, 0, 0)).stress(u)
    np.testing.assert_allclose(across[:, 0], 1.0, atol=1e-7)
    equal = cell.under((0, 1.0, 1.0, 0, 0, 0)).stress(u)  # equal strains along the layers
    plane = E / (1 - nu)
    np.testing.assert_allclose(equal[:, 1], plane / (part @ plane), rtol=1e-6)
    np.testing.assert_allclose(equal[:, 0], 0.0, atol=1e-6)
    least = (np.array([3.0, 2.0]) / (plane / (part @ plane))).min()
    np.testing.assert_allclose(cell.first_yield((0, 1.0, 1.0, 0, 0, 0)), least, rtol=1e-6)


@pytest.mark.parametrize("poisson", [0.3, 0.47])
def test_means_are_those_asked_for_and_yield_is_the_worst_point(poisson):
    cell = ElasticCell(void, 4, poisson=poisson, strength=lambda x: 2.0 + x[:, 0])
    local = cell.under(STRESS)
    rule = cell.domain.solid(cell.assembly)
    stress = local.stress(rule.parameters)
    np.testing.assert_allclose(rule.weights @ stress, STRESS, atol=2e-3)
    used = von_mises(stress) / (2.0 + rule.parameters[:, 0])
    np.testing.assert_allclose(cell.first_yield(STRESS), 1.0 / used.max(), rtol=1e-6)


def test_what_a_cell_does_not_bear_is_refused():
    plate = ElasticCell(lambda u: abs(u[:, 2] - 0.5) - 0.2, 4, strength=1.0)
    assert plate.first_yield((1.0, 0, 0, 0, 0, 0)) == pytest.approx(0.4, rel=1e-6)
    with pytest.raises(InputError, match="bears nothing of"):
        plate.under((0, 0, 1.0, 0, 0, 0))
    with pytest.raises(InputError, match="bears nothing of"):
        plate.first_yield(np.zeros(6))
    with pytest.raises(InputError, match=r"got shape \(3,\)"):
        plate.under((1.0, 0, 0))
    with pytest.raises(InputError, match="must be one"):
        plate.under(np.eye(6)[:2])
    with pytest.raises(InputError, match="no strength"):
        ElasticCell(full, 3).first_yield(STRESS)
    with pytest.raises(InputError, match=r"give ElasticCell\(\.\.\., strength"):
        ElasticCell(full, 3).under(STRESS).margin([[0.5, 0.5, 0.5]])


def test_first_yield_of_stresses_of_any_size():
    cell = ElasticCell(full, 3, strength=3.0)
    stress = np.outer([1e200, 1.0, 1e-200], [1.0, 0, 0, 0, 0, 0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_allclose(cell.first_yield(stress), [3e-200, 3.0, 3e200], rtol=1e-9)
        assert cell.first_yield([1.0, 1.0, 1.0, 0, 0, 0])[0] == np.inf
        slightly = cell.first_yield([1.0, 1.0, 1.0 + 1e-6, 0, 0, 0])
    np.testing.assert_allclose(slightly, 3e6, rtol=1e-6)
