"""Thermal expansion of cells: Levin's formula, laminates, solids of one material."""

import json

import numpy as np
import pytest

import ilattice as il
from ilattice.homogenize import ElasticCell, elastic

coarse = pytest.mark.filterwarnings("ignore:the cells are too coarse")
pytestmark = [
    pytest.mark.filterwarnings("ignore:the voxels are too coarse"),
    pytest.mark.filterwarnings("ignore:it is not known by how much"),
]
YOUNG, POISSON, ALPHA = (1.0, 10.0), (0.3, 0.2), (1e-5, 4e-5)


def full(u):
    return -np.ones(len(u))


def void(u):
    d = u - (0.47, 0.53, 0.5)
    return 1.0 - (((d - np.rint(d)) / (0.3, 0.24, 0.2)) ** 2).sum(axis=1)


@coarse
def test_one_material_expands_as_it_does_without_voids():
    edges = np.array([[1.0, 0.4, 0.0], [0.0, 0.9, 0.1], [0.0, 0.0, 1.1]])
    eff = elastic(void, 4, through=il.macroshape.cell(edges), expansion=2e-5)
    np.testing.assert_allclose(eff.expansion, 2e-5 * np.array([1, 1, 1, 0, 0, 0]), atol=1e-12)
    assert elastic(void, 4, estimate=False).expansion is None


@coarse
def test_expansion_is_the_compliance_times_what_a_degree_does():
    """Of one material with voids it is that of the material, with half of it at twice C."""
    cell = ElasticCell(void, 4, expansion=2e-5)
    answer = cell.answers("auto", 1e-10, 500, None)
    C = np.asarray(elastic(void, 4, estimate=False).C)
    exact = 2e-5 * np.array([1, 1, 1, 0, 0, 0])
    np.testing.assert_allclose(cell.expanding(C, answer), exact, atol=1e-12)
    np.testing.assert_allclose(cell.expanding(2.0 * C, answer), 0.5 * exact, atol=1e-12)
    assert ElasticCell(void, 4).expanding(C, answer).shape == (0,)


@coarse
@pytest.mark.parametrize("young", [YOUNG, (5.0, 0.2)])
def test_two_phases_follow_levin(young, tmp_path):
    def ball(x):
        return np.linalg.norm(x - 0.5, axis=1) - 0.3

    eff = elastic(
        full, 6, phases=ball, young=young, poisson=POISSON, expansion=ALPHA, estimate=young == YOUNG
    )
    K = np.array(young) / (3.0 - 6.0 * np.array(POISSON))
    part = np.array([4 / 3 * np.pi * 0.3**3, 1 - 4 / 3 * np.pi * 0.3**3])
    slope = (ALPHA[0] - ALPHA[1]) / (1 / K[0] - 1 / K[1])
    levin = part @ ALPHA + slope * (1 / eff.K - part @ (1 / K))
    # exact for the discrete solution, too, but for the volume of the ball
    np.testing.assert_allclose(eff.expansion, levin * np.array([1, 1, 1, 0, 0, 0]), atol=1e-11)
    assert abs(levin - part @ ALPHA) > 1e-6
    if young == YOUNG:
        fine = elastic(full, 9, phases=ball, young=young, poisson=POISSON, expansion=ALPHA,
                       estimate=False)  # fmt: skip
        off = np.abs(eff.expansion - fine.expansion)[:3]
        assert (off < 2 * eff.expansion_errors[:3]).all()
        eff.save(tmp_path / "e.json")
        told = json.loads((tmp_path / "e.json").read_text())
        assert told["expansion"] == eff.expansion.tolist()


@coarse
def test_laminates_expand_by_their_formula():
    eff = elastic(
        full, (12, 8, 8), domain=[[0, 0, 0], [1, 0.5, 0.5]], phases="abs(u - 0.503) - 0.21",
        young=YOUNG, poisson=POISSON, expansion=ALPHA,
    )  # fmt: skip
    part, E, nu = np.array([0.42, 0.58]), np.array(YOUNG), np.array(POISSON)
    plane, alpha = E / (1 - nu), np.array(ALPHA)
    along = (part @ (plane * alpha)) / (part @ plane)  # equal strains in the layers, no mean stress
    # across: free expansion, and Poisson's part of what hinders that along
    across = part @ (alpha + 2 * nu / (1 - nu) * (alpha - along))
    np.testing.assert_allclose(eff.expansion, [across, along, along, 0, 0, 0], atol=1e-13)
    np.testing.assert_array_less(eff.expansion_errors, 1e-11)


def test_two_phases_of_voxels_follow_levin_to_the_tolerance():
    labels = np.random.default_rng(2).integers(0, 2, (6, 4, 8))
    labels[:, :2] |= labels[:, 1:3]  # no symmetry
    eff = il.homogenize.voxels(
        labels, young=YOUNG, poisson=POISSON, expansion=ALPHA, spacing=(1.0, 0.7, 0.8), tol=1e-7
    )
    K = np.array(YOUNG) / (3.0 - 6.0 * np.array(POISSON))
    part = np.array([1 - labels.mean(), labels.mean()])
    slope = (ALPHA[0] - ALPHA[1]) / (1 / K[0] - 1 / K[1])
    unit = np.array([1.0, 1, 1, 0, 0, 0])
    free = 3 * eff.S @ unit  # of any symmetry: B. Rosen and Z. Hashin, 1970
    levin = part @ ALPHA * unit + slope * (free - unit * (part @ (1 / K)))
    np.testing.assert_allclose(eff.expansion, levin, atol=1e-13)
    assert np.ptp(eff.expansion[:3]) > 1e-7
    assert (eff.expansion_errors > 0).all()
    plain = il.homogenize.voxels(labels, young=YOUNG, poisson=POISSON, spacing=(1.0, 0.7, 0.8))
    assert plain.expansion is None
    np.testing.assert_allclose(plain.C, eff.C, rtol=1e-6, atol=1e-6)
    with pytest.raises(il.errors.InputError, match="expansion must be one number or 2"):
        il.homogenize.voxels(labels, young=YOUNG, expansion=(1.0, 2.0, 3.0))
