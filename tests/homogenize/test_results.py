"""What is asked of effective stiffnesses and conductivities, and their files."""

import csv
import json

import naive_homogenize as naive
import numpy as np
import pytest

import ilattice as il
from ilattice.errors import FormatError, InputError, PrecisionWarning
from ilattice.homogenize import Effective, conductive_voxels, voxels


@pytest.fixture(scope="module")
def eff():
    """Three phases without any symmetry."""
    labels = np.random.default_rng(1).integers(0, 3, (4, 4, 4))
    labels[:2, :, 2:] = 2
    with pytest.warns(PrecisionWarning, match="voxels are too coarse"):
        return voxels(labels, young=(0.01, 1.0, 5.0), poisson=(0.1, 0.3, 0.4))


def with_stiffness(C, eff):
    return Effective(
        eff.density, eff.percolates, eff.report, np.array(C), np.zeros((6, 6)), eff.bounds
    )


def frames(count):
    rng = np.random.default_rng(2)
    return [naive.random_rotation(rng) for _ in range(count)]


def test_moduli_are_those_of_the_turned_compliance(eff):
    for Q in frames(5):
        S = np.linalg.inv(naive.rotated(eff.C, Q))  # rows of Q are the new axes
        n, m, t = Q
        assert eff.E(n) == pytest.approx(1 / S[0, 0], rel=1e-10)
        assert eff.nu(n, m) == pytest.approx(-S[0, 1] * eff.E(n), rel=1e-9, abs=1e-12)
        assert eff.G(m, t) == pytest.approx(1 / S[3, 3], rel=1e-10)
    np.testing.assert_allclose(eff.S @ eff.C, np.eye(6), atol=1e-10)
    rows = np.array(frames(3))[:, 0]
    assert eff.E(3.7 * rows) == pytest.approx([eff.E(r) for r in rows], rel=1e-12)


def test_numbers_of_isotropic_and_cubic_tensors(eff):
    iso = with_stiffness(naive.isotropic(2.0, 0.3), eff)
    assert iso.E((1, 2, 3)) == pytest.approx(2.0, rel=1e-12)
    assert iso.nu((1, 2, 3), (3, 0, -1)) == pytest.approx(0.3, rel=1e-12)
    assert iso.G((1, 2, 3), (3, 0, -1)) == pytest.approx(2 / 2.6, rel=1e-12)
    assert (iso.K, iso.G_mean) == pytest.approx((2 / 1.2, 2 / 2.6), rel=1e-12)
    assert iso.zener == pytest.approx(1.0, rel=1e-12)
    assert iso.universal_anisotropy == pytest.approx(0.0, abs=1e-12)
    assert iso.symmetry == "isotropic"
    C = naive.isotropic(2.0, 0.3)
    C[range(3, 6), range(3, 6)] *= 1.7
    cubic = with_stiffness(C, eff)
    assert cubic.symmetry == "cubic"
    assert cubic.zener == pytest.approx(1.7, rel=1e-12)
    r = 1.7  # Ranganathan and Ostoja-Starzewski, 2008: 6/5 (sqrt A - 1 / sqrt A)²
    assert cubic.universal_anisotropy == pytest.approx(6 / 5 * (r**0.5 - r**-0.5) ** 2, rel=1e-10)
    turned = with_stiffness(naive.rotated(C, frames(1)[0]), eff)
    assert turned.symmetry == "anisotropic"
    assert turned.universal_anisotropy == pytest.approx(cubic.universal_anisotropy, rel=1e-9)
    np.testing.assert_allclose(cubic.nearest("cubic"), C, atol=1e-13)


def test_surfaces_of_directions(eff):
    mesh = eff.surface(3)
    assert mesh.is_watertight
    assert mesh.volume > 0
    n = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), eff.E(n), rtol=1e-9)
    for name in ("nu", "G"):
        assert (mesh.point_data[f"{name}_min"] <= mesh.point_data[f"{name}_max"]).all()
    Q = frames(1)[0]
    row = int(np.argmax(n @ Q[0]))
    m = np.cross(n[row], [0.3, -0.2, 1.0])
    assert mesh.point_data["nu_min"][row] - 5e-3 < eff.nu(n[row], m)
    assert eff.nu(n[row], m) < mesh.point_data["nu_max"][row] + 5e-3
    assert mesh.point_data["G_min"][row] * 0.995 < eff.G(n[row], m)
    ball = with_stiffness(naive.isotropic(2.0, 0.3), eff).surface(4)
    assert ball.volume == pytest.approx(4 / 3 * np.pi * 8, rel=1e-2)


def test_files(eff, tmp_path):
    eff.save(tmp_path / "a.json")
    found = json.loads((tmp_path / "a.json").read_text())
    np.testing.assert_array_equal(found["C"], eff.C)
    assert found["E_x"] == eff.E((1, 0, 0))
    assert found["report"]["route"] == "voxels"
    assert found["bounds"]["bulk"] == list(eff.bounds.bulk)
    eff.save(tmp_path / "a.csv")
    rows = dict(csv.reader((tmp_path / "a.csv").read_text().splitlines()))
    assert float(rows["C13"]) == eff.C[0, 2]
    assert float(rows["density"]) == eff.density
    eff.save(tmp_path / "a.vtp")
    import pyvista as pv

    assert "nu_max" in pv.read(tmp_path / "a.vtp").point_data
    for wrong in ("a", "a.nothing"):
        with pytest.raises(FormatError):
            eff.save(tmp_path / wrong)


def test_pictures(eff, monkeypatch):
    shown = {}

    def plot(mesh, **options):
        shown.update(options, n=len(mesh.vertices))

    monkeypatch.setattr(il.mesh.SurfaceMesh, "plot", plot)
    eff.plot(cmap="gray")
    assert shown["scalars"] == "E"
    assert shown["cmap"] == "gray"
    assert shown["n"] > 1000


def test_conductivities():
    labels = np.random.default_rng(3).integers(0, 2, (4, 4, 4))
    with pytest.warns(PrecisionWarning, match="voxels are too coarse"):
        k = conductive_voxels(labels, conductivity=(0.1, 2.0))
    Q = frames(1)[0]
    np.testing.assert_allclose(k.rotated(Q), Q @ k.k @ Q.T, atol=1e-14)
    mesh = k.surface(2)
    n = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    np.testing.assert_allclose(mesh.point_data["k"], [v @ k.k @ v for v in n], rtol=1e-9)
    assert k.mean == pytest.approx(np.trace(k.k) / 3)
    assert k.as_dict()["k"] == k.k.tolist()
    assert "error" in repr(k)


def test_wrong_arguments(eff):
    for moduli in (eff.nu, eff.G):
        with pytest.raises(InputError, match="m must be one direction or as many as n, got 2 with"):
            moduli(np.eye(3), np.eye(3)[:2])
    with pytest.raises(InputError, match="m must be orthogonal"):
        eff.nu((1, 0, 0), (1, 1, 0))
    with pytest.raises(InputError, match="n must be a vector"):
        eff.E((1, 0))
    with pytest.raises(InputError, match="symmetry must be one of"):
        eff.nearest("none")
    with pytest.raises(InputError, match="rotation"):
        eff.rotated(2 * np.eye(3))
    with pytest.raises(InputError, match="level"):
        eff.surface(20)
    assert il.homogenize.Effective is Effective


def test_stiffnesses_are_positive_and_pictures_have_titles(eff, monkeypatch):
    C = np.diag([1.0, 1.0, 1.0, 1.0, 1.0, -0.1])
    with pytest.raises(InputError, match="negative eigenvalues"):
        with_stiffness(C, eff)
    C[0, 1] = 0.5
    with pytest.raises(InputError, match="symmetric matrix"):
        with_stiffness(C, eff)
    shown = {}
    monkeypatch.setattr(il.mesh.SurfaceMesh, "plot", lambda _, **options: shown.update(options))
    eff.plot(unit="MPa")
    assert (shown["label"], shown["unit"]) == ("Young's modulus E", "MPa")
