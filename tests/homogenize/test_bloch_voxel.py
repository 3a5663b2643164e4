"""Waves in voxels: dispersion of the grid, assembled matrices, laminates, crystals, voids."""

import naive_homogenize as naive
import numpy as np
import pytest
from scipy.linalg import eigh

import ilattice as il
from ilattice.errors import ConvergenceError, GeometryError, InputError, PrecisionWarning
from ilattice.homogenize import bloch_voxels, voxels
from ilattice.homogenize._spectral import VoxelGrid
from ilattice.homogenize.bloch_voxel import VoxelWaves

#: Of small grids, which is what tests take; one looks at the warnings.
pytestmark = [
    pytest.mark.filterwarnings("ignore:the voxels are too coarse"),
    pytest.mark.filterwarnings("ignore:it is not known by how much"),
    pytest.mark.filterwarnings("ignore:rounding leaves"),
]
MU, LAM = 0.5 / 1.3, 0.3 / 1.3 / 0.4


def test_homogeneous_waves_have_the_dispersion_of_the_grid():
    """Lumped linear elements: omega = 2 c / h sin(k h / 2), below c k by (k h)² / 24."""
    for n in (4, 8):
        bands = bloch_voxels(
            np.ones((n, 3, 2), bool), path=[(0.25, 0, 0)], steps=1, count=3, tol=1e-6,
            spacing=(1 / n, 0.4, 0.7),
        )  # fmt: skip
        c = np.sqrt([MU, MU, LAM + 2 * MU])
        k = bands.k[0, 0]
        assert k == pytest.approx(np.pi / 2)
        np.testing.assert_allclose(bands.omega[0], 2 * c * n * np.sin(k / n / 2), rtol=1e-9)
        np.testing.assert_allclose(
            bands.velocities[0], np.outer(c * np.cos(k / n / 2), [1, 0, 0]), atol=1e-5
        )


def assembled(labels, C, density, spacing, k):
    """Lowest frequencies by dense matrices with phases on wrapped nodes."""
    waves = VoxelWaves(labels, C.reshape(-1, 36), density, np.array(spacing))
    one = waves.at(np.asarray(k, float))
    n = one.unknowns
    K = one.stiffness(np.eye(n, dtype=complex)).T
    M = one.mass(np.eye(n, dtype=complex)).T
    assert np.abs(K - K.conj().T).max() < 1e-12 * np.abs(K).max()
    assert M.diagonal().real.sum() / 3 == pytest.approx(
        density[labels].sum() * np.prod(spacing), rel=1e-12
    )
    return np.sqrt(np.abs(eigh(K, M, eigvals_only=True)))


@pytest.fixture(scope="module")
def cell():
    rng = np.random.default_rng(5)
    labels = rng.integers(0, 3, (4, 3, 5))
    C = np.stack([naive.random_stiffness(rng) for _ in range(3)])
    return labels, C, np.array([1.0, 2.0, 0.5]), (0.3, 0.5, 0.2)


def test_the_matrix_without_a_wave_is_that_of_voxels(cell):
    labels, C, density, spacing = cell
    one = VoxelWaves(labels, C.reshape(-1, 36), density, np.array(spacing)).at(np.zeros(3))
    x = np.random.default_rng(1).standard_normal((1, one.unknowns)).astype(complex)
    grid = VoxelGrid(labels.astype(np.int32), C.reshape(-1, 36), np.array(spacing), np.ones(2))
    expected = grid.forces(x.real.reshape(3, *labels.shape)).ravel()
    np.testing.assert_allclose(one.stiffness(x)[0], expected, atol=1e-12)


def test_the_search_finds_what_a_dense_solver_does(cell):
    labels, C, density, spacing = cell
    where = [(0.13, -0.3, 0.4), (0.2, -0.2, 0.4), (0.0, 0.0, 0.0)]
    bands = bloch_voxels(labels, path=where, steps=1, count=7, stiffness=C, density=density,
                         spacing=spacing, tol=1e-6)  # fmt: skip
    for k, omega in zip(bands.k, bands.omega, strict=True):
        exact = assembled(labels, C, density, spacing, k)[:7]
        np.testing.assert_allclose(omega, exact, rtol=1e-7, atol=1e-5)
    assert np.isnan(bands.errors).all()  # odd numbers of voxels


def test_group_velocities_are_differences(cell):
    labels, C, density, spacing = cell
    k = np.array([1.1, -0.4, 2.0])
    box = np.array(labels.shape) * spacing

    def omega(k):
        way = [k * box / (2 * np.pi)]
        return bloch_voxels(labels, path=way, steps=1, count=4, stiffness=C, density=density,
                            spacing=spacing, tol=1e-8)  # fmt: skip

    h, found = 1e-4, omega(k)
    for j, e in enumerate(np.eye(3)):
        slope = (omega(k + h * e).omega - omega(k - h * e).omega)[0] / (2 * h)
        np.testing.assert_allclose(found.velocities[0, :, j], slope, atol=2e-5)


def test_a_laminate_is_that_of_rytov():
    """Halves: cos(k d) = cos a cos b - (Z + 1/Z) sin a sin b / 2."""
    n, k = 64, 1.0
    labels = np.tile(np.repeat([0, 1], n // 2).reshape(n, 1, 1), (1, 4, 4))
    bands = bloch_voxels(labels, path=[(k / (2 * np.pi), 0, 0)], steps=1, count=8,
                         young=(10.0, 1.0), poisson=0.3, density=(2.0, 1.0), spacing=1 / n,
                         tol=1e-5)  # fmt: skip
    exact = []
    for modulus in (MU, MU, LAM + 2 * MU):
        c = np.sqrt([10 * modulus / 2, modulus])
        Z = 2 * c[0] / c[1]
        w = np.linspace(1e-3, 12, 400_001)
        a, b = 0.5 * w / c[0], 0.5 * w / c[1]
        f = np.cos(a) * np.cos(b) - 0.5 * (Z + 1 / Z) * np.sin(a) * np.sin(b) - np.cos(k)
        exact.append(w[:-1][np.diff(np.sign(f)) != 0])
    exact = np.sort(np.concatenate(exact))[:8]
    np.testing.assert_allclose(bands.omega[0], exact, rtol=1e-3)
    assert (np.abs(bands.omega[0] / exact - 1) < bands.errors + 1e-4).all()


def test_long_waves_are_those_of_the_effective_stiffness_and_voids_have_none():
    rng = np.random.default_rng(3)
    solid = rng.random((6, 6, 6)) < 0.8
    C = voxels(solid, young=1.0, poisson=0.2, tol=1e-6, estimate=False).C
    way = [np.array([0.3, 0.8, -0.5]) * 5e-3]
    bands = bloch_voxels(solid, path=way, steps=1, count=3, young=1.0, poisson=0.2, tol=1e-7)
    k = bands.k[0]
    christoffel = np.einsum("ijkl,j,l->ik", naive.full(C), k, k) / solid.mean()
    np.testing.assert_allclose(bands.omega[0], np.sqrt(np.linalg.eigvalsh(christoffel)), rtol=2e-4)


def dispersed(bands, count, spacing):
    """Exact frequencies of the grid for waves along x."""
    c = np.sqrt([MU, MU, LAM + 2 * MU])[:count]
    return c * 2 / spacing * np.sin(bands.k[:, :1] * spacing / 2)


@pytest.mark.parametrize("length", [300.0, 1e4, 1e6])
def test_slow_waves_of_long_voxels_are_found(length):
    """Frequencies are far below the largest of the grid, which residuals do not count with."""
    bands = bloch_voxels(np.ones((6, 6, 6), bool), spacing=(length, 1, 1), path=[(0.3, 0, 0)],
                         count=3, steps=1)  # fmt: skip
    off = np.abs(bands.omega / dispersed(bands, 3, length) - 1)[0]
    np.testing.assert_array_less(off, bands.errors)
    np.testing.assert_array_less(off, 0.03 if length > 1e5 else 1e-5)


def test_long_waves_are_found_as_far_as_rounding_allows():
    way = [(1e-3, 0, 0), (1e-5, 0, 0), (1e-6, 0, 0)]
    bands = bloch_voxels(np.ones((6, 6, 6), bool), path=way, count=3, steps=1)
    off = np.abs(bands.omega / dispersed(bands, 3, 1.0) - 1)
    np.testing.assert_array_less(off.max(axis=1), [1e-8, 1e-4, 1e-2])
    np.testing.assert_array_less(off.max(axis=0), bands.errors)
    with pytest.warns(PrecisionWarning, match="all of the square of a frequency open: that of b"):
        bands = bloch_voxels(np.ones((6, 6, 6), bool), path=[(1e-9, 0, 0)], count=3, steps=1)
    assert bands.error >= 1.0


@pytest.mark.parametrize(
    ("kind", "young"),
    [("layers", 1e-3), ("layers", 1e-6), ("ball", 1e-5), ("ball", 1e6), ("mixed", 1e-4)],
)
def test_slow_waves_of_different_phases_are_found(kind, young):
    x = (np.arange(6) + 0.5) / 6 - 0.5
    labels = {
        "layers": np.repeat([0, 1], 4).reshape(8, 1, 1) * np.ones((1, 3, 3), int),
        "ball": ((x[:, None, None] ** 2 + x[:, None] ** 2 + x**2) < 0.3**2).astype(int),
        "mixed": np.random.default_rng(3).integers(0, 2, (6, 5, 4)),
    }[kind]
    bands = bloch_voxels(labels, young=(young, 1.0), path=[(0.1, 0.05, 0.02)], count=3, steps=1)
    E = np.array([young, 1.0])
    table = np.column_stack([LAM * E, MU * E])
    waves = VoxelWaves(labels, table, np.ones(2), np.ones(3)).at(bands.k[0])
    one = np.eye(waves.unknowns, dtype=complex)
    exact = np.sqrt(eigh(waves.stiffness(one).T, waves.mass(one).T, eigvals_only=True)[:3])
    np.testing.assert_allclose(bands.omega[0], exact, rtol=1e-5)


def test_gaps_of_unknown_errors_say_so():
    labels = np.repeat([0, 1], 6).reshape(12, 1, 1)
    options = {"young": (1.0, 50.0), "density": (1, 5), "path": [(0, 0, 0), (0.5, 0, 0)]}
    for array, known in ((labels, False), (np.tile(labels, (1, 4, 4)), True)):
        gaps = bloch_voxels(array, steps=4, count=7, **options).gaps
        assert gaps
        assert all(gap.narrowed == known for gap in gaps)


def test_steps_do_not_grow_with_the_number_of_voxels():
    steps = []
    for n in (6, 12):
        x = (np.arange(n) + 0.5) / n - 0.5
        solid = (x[:, None, None] ** 2 + x[:, None] ** 2 + x**2) > 0.3**2
        bands = bloch_voxels(solid, path=[(0.5, 0, 0)], steps=1, count=4, tol=1e-3, spacing=1 / n)
        steps.append(int(bands.report.steps[0]))
    assert steps[1] <= steps[0] + 4
    assert (bands.errors < 0.2).all()


@pytest.mark.parametrize(
    ("array", "options", "kind", "told"),
    [
        (np.zeros((2, 2, 2), bool), {}, GeometryError, "no solid"),
        (np.ones((1, 1, 1), bool), {"count": 8}, InputError, "count = 8 is too many"),
        (np.ones((4, 4, 4), bool), {"density": 0.0}, InputError, "density"),
        (np.ones((4, 4, 4), bool), {"density": (1, 2, 3)}, InputError, "density"),
        (np.ones((4, 4, 4), bool), {"path": "GQ"}, InputError, "Q"),
        (np.ones((4, 4, 4), bool), {"tol": -1}, InputError, "tol"),
        (np.ones((4, 4, 4), bool), {"tol": 1.0}, InputError, "tol must be between 1e-12 and 0.1"),
        (np.ones((4, 4), bool), {}, InputError, "array"),
    ],
)
def test_wrong_arguments(array, options, kind, told):
    with pytest.raises(kind, match=told):
        bloch_voxels(array, **{"count": 3, "steps": 1, **options})


def test_errors_are_told():
    solid = np.ones((4, 4, 4), bool)
    with pytest.warns(
        PrecisionWarning, match=r"square of a frequency .* \(il.homogenize.bloch\)"
    ) as w:
        bands = bloch_voxels(solid, path=[(0.5, 0, 0)], steps=1, count=3)
    assert f"about {200 * bands.error:.2g} %" in str(w[0].message)
    with pytest.warns(PrecisionWarning, match="not known by how much the square of a frequency"):
        bloch_voxels(solid[:3], path=[(0.5, 0, 0)], steps=1, count=3)


def test_what_cannot_be_found_is_said_and_modes_are_not_kept():
    solid = np.random.default_rng(1).random((6, 6, 6)) < 0.7
    with pytest.raises(ConvergenceError, match="residual"):
        bloch_voxels(solid, path=[(0.5, 0, 0)], steps=1, count=6, tol=1e-9, max_iterations=2)
    bands = bloch_voxels(np.ones((4, 4, 4), bool), path=[(0.5, 0, 0)], steps=1, count=3)
    with pytest.raises(InputError, match="voxels keep none"):
        bands.mode(0, 0)
    assert not il.homogenize.bloch_voxels(
        np.ones((4, 4, 4), bool), path="GXM", steps=2, count=4
    ).gaps
