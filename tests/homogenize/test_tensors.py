"""Stiffness tensors: against all 81 components."""

import naive_homogenize as naive
import numpy as np
import pytest

from ilattice.errors import InputError
from ilattice.homogenize import tensors


def test_rotations_are_those_of_rank_four():
    rng = np.random.default_rng(1)
    for _ in range(5):
        C, Q = naive.random_stiffness(rng), naive.random_rotation(rng)
        np.testing.assert_allclose(tensors.rotated(C, Q), naive.rotated(C, Q), atol=1e-12)
        assert tensors.size(C) == pytest.approx(np.linalg.norm(naive.full(C)), rel=1e-13)


def test_isotropic_tensors():
    C = naive.isotropic(2.0, 0.3)
    lam, mu = 2 * 0.3 / (1.3 * 0.4), 2 / 2.6
    np.testing.assert_allclose(tensors.isotropic(lam, mu), C, rtol=1e-14, atol=1e-15)
    assert tensors.bulk_and_shear(C) == pytest.approx((2 / (3 * 0.4), mu), rel=1e-13)
    np.testing.assert_allclose(tensors.of_moduli(*tensors.bulk_and_shear(C)), C, atol=1e-14)


@pytest.mark.parametrize(
    "symmetry", ["isotropic", "cubic", "transversely isotropic", "tetragonal", "orthotropic"]
)
def test_projections_are_orthogonal_and_have_the_symmetry(symmetry):
    rng = np.random.default_rng(2)
    C, other = naive.random_stiffness(rng), naive.random_stiffness(rng)
    near, far = tensors.nearest(C, symmetry), tensors.nearest(other, symmetry)
    np.testing.assert_allclose(tensors.nearest(near, symmetry), near, atol=1e-12)
    inner = (naive.full(C - near) * naive.full(far)).sum()
    assert abs(inner) < 1e-11 * tensors.size(C) * tensors.size(far)
    turns = {
        "isotropic": [naive.random_rotation(rng)],
        "cubic": [np.eye(3)[[1, 2, 0]], np.diag([1.0, 1, -1]), np.eye(3)[[1, 0, 2]]],
        "transversely isotropic": [about_z(0.7), np.diag([1.0, 1, -1]), np.diag([1.0, -1, 1])],
        "tetragonal": [about_z(np.pi / 2), np.diag([1.0, 1, -1]), np.diag([1.0, -1, 1])],
        "orthotropic": [np.diag([1.0, 1, -1]), np.diag([1.0, -1, 1]), np.diag([-1.0, 1, 1])],
    }[symmetry]
    for Q in turns:
        np.testing.assert_allclose(naive.rotated(near, Q), near, atol=1e-12)


def about_z(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def test_dimensions_of_the_symmetries():
    """Independent constants: 2, 3, 5, 6, 9 (Nye, Physical properties of crystals)."""
    units = []
    for a in range(6):
        for b in range(a + 1):
            E = np.zeros((6, 6))
            E[a, b] = E[b, a] = 1.0
            units.append(E)
    for symmetry, count in (
        ("isotropic", 2), ("cubic", 3), ("transversely isotropic", 5), ("tetragonal", 6),
        ("orthotropic", 9),
    ):  # fmt: skip
        rows = np.array([tensors.nearest(E, symmetry).ravel() for E in units])
        assert np.linalg.matrix_rank(rows, 1e-9) == count


def test_planes_without_traction():
    rng = np.random.default_rng(3)
    C = naive.random_stiffness(rng)
    n = np.array([[1.0, 2.0, -0.5]]) / np.linalg.norm([1.0, 2.0, -0.5])
    free = naive.full(tensors.without(C, n))
    assert np.abs(np.einsum("ijkl,j->ikl", free, n[0])).max() < 1e-13 * np.abs(C).max()
    along = tensors.without(C, np.eye(3)[[2]])
    assert not along[[2, 3, 4]].any()
    assert not along[:, [2, 3, 4]].any()


def test_wrong_arguments():
    with pytest.raises(InputError, match="rotation must be an orthogonal"):
        tensors.as_rotation(np.ones((3, 3)))
    with pytest.raises(InputError, match="n must not be zero"):
        tensors.as_direction("n", (0, 0, 0))
    with pytest.raises(InputError, match="symmetry"):
        tensors.nearest(np.eye(6), "monoclinic")
