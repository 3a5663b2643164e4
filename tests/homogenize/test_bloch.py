"""Waves: exact speeds and laminates, slopes, foldings, symmetries, what the search finds."""

import csv
import json
import pickle
import warnings

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq

import ilattice as il
from ilattice.errors import ConvergenceError, FormatError, InputError, PrecisionWarning
from ilattice.homogenize import bloch, elastic
from ilattice.homogenize.paths import path_of, points_of, reciprocal, system_of
from ilattice.homogenize.waves import BlochCell

coarse = pytest.mark.filterwarnings("ignore:the cells are too coarse")
rounding = pytest.mark.filterwarnings("ignore:rounding leaves")
MU, LAM = 0.5 / 1.3, 0.3 / 1.3 / 0.4
SHEAR, PRESSURE = MU**0.5, (LAM + 2 * MU) ** 0.5
#: A thin bar, in which waves along it come first.
BAR = [[0, 0, 0], [1, 0.1, 0.1]]


def full(u):
    return -np.ones(len(u))


def void(centre=(0.5, 0.5, 0.5), radii=(0.3, 0.24, 0.2)):
    def field(u):
        d = np.asarray(u) - centre
        return 1.0 - (((d - np.rint(d)) / radii) ** 2).sum(axis=1)

    return field


def free_waves(k, count, periods=(1.0, 1.0, 1.0)):
    """Angular frequencies of plane waves in a homogeneous solid, folded back."""
    n = np.stack(np.meshgrid(*[np.arange(-3, 4)] * 3), -1).reshape(-1, 3)
    size = np.linalg.norm(k + 2 * np.pi * n / periods, axis=1)
    return np.sort(np.concatenate([SHEAR * size, SHEAR * size, PRESSURE * size]))[:count]


@coarse
def test_plane_waves_are_exact_and_folded_ones_have_the_order_of_the_space():
    corners = [(0.25, 0, 0), (0.5, 0, 0), (0.5, 0.25, 0), (0.5, 0.5, 0), (0.5, 0.5, 0.5), (0, 0, 0)]
    bands = bloch(full, 4, path=corners, count=3, steps=1)
    first = [free_waves(k, 3)[0] for k in bands.k]
    np.testing.assert_allclose(bands.omega[:, 0], first, rtol=1e-9, atol=1e-5)
    np.testing.assert_allclose(bands.omega[0], [0.97417, 0.97417, 1.82250], atol=5e-6)
    np.testing.assert_allclose(
        np.linalg.norm(bands.velocities[0], axis=1), [SHEAR, SHEAR, PRESSURE], rtol=1e-6
    )
    for degree, order in ((1, 2), (2, 4)):
        off = []
        for n in (8, 14):
            found = bloch(
                full, (n, 3, 3), path=[(0.25, 0, 0)], count=9, steps=1, domain=BAR, degree=degree
            )
            exact = free_waves(found.k[0], 9, (1.0, 0.1, 0.1))
            off.append(found.omega[0] / exact - 1)
        assert off[1].min() > -1e-9
        assert np.log(off[0].max() / off[1].max()) > (order - 0.3) * np.log(14 / 8)


def rytov(k, young, density, polarisation):
    """Exact frequencies of waves through two layers of half the period each."""
    mu = np.array(young) / 2.6
    c = np.sqrt(np.array([mu, mu * (LAM + 2 * MU) / MU])[polarisation] / density)
    Z = c * density
    mean = 0.5 * (Z[0] / Z[1] + Z[1] / Z[0])

    def f(w):
        a, b = 0.5 * w / c[0], 0.5 * w / c[1]
        return np.cos(k) - np.cos(a) * np.cos(b) + mean * np.sin(a) * np.sin(b)

    w = np.linspace(1e-6, 40, 20001)
    at = np.flatnonzero(f(w[:-1]) * f(w[1:]) < 0)
    return [brentq(f, w[i], w[i + 1]) for i in at]


@pytest.mark.parametrize("way", ["phases", "planes"])
@coarse
def test_a_laminate_is_that_of_rytov(way):
    E, rho, k = (10.0, 1.0), np.array([2.0, 1.0]), 1.0
    exact = np.sort([w for p in (0, 0, 1) for w in rytov(k, E, rho, p)])[:8]
    if way == "phases":  # cut anywhere
        options = {"phases": "abs(u - 0.503) - 0.25", "young": E, "density": (2.0, 1.0)}
        cells = (11, 3, 3)
    else:
        options = {
            "young": lambda x: np.where(x[:, 0] < 0.5, *E), "smoothness": 0,
            "density": lambda x: np.where(x[:, 0] < 0.5, *rho),
        }  # fmt: skip
        cells = (10, 3, 3)
    bands = bloch(full, cells, path=[(k / 2 / np.pi, 0, 0)], steps=1, domain=BAR, **options)
    np.testing.assert_allclose(bands.omega[0], exact, rtol=1e-3)
    assert bands.speed == pytest.approx((5.5 / 2.6 / 1.5) ** 0.5)


@coarse
def test_long_waves_are_those_of_the_effective_stiffness():
    n = np.array([2.0, -1.0, 3.0]) / 14**0.5
    C = np.asarray(elastic(void(), 6).C)
    bands = bloch(void(), 6, path=[0.002 * n], steps=1, count=3, density=2.5, modes=True)
    full_C = np.zeros((3, 3, 3, 3))
    pairs = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]
    for a, (i, j) in enumerate(pairs):
        for b, (r, s) in enumerate(pairs):
            for p, q in ((i, j), (j, i)):
                full_C[p, q, r, s] = full_C[p, q, s, r] = C[a, b]
    christoffel = np.einsum("ijkl,j,l->ik", full_C, n, n)
    part = 1 - 4 / 3 * np.pi * 0.3 * 0.24 * 0.2
    speeds = np.sqrt(np.linalg.eigvalsh(christoffel) / (2.5 * part))
    size = np.linalg.norm(bands.k[0])
    np.testing.assert_allclose(bands.omega[0] / size, speeds, rtol=1e-4)
    np.testing.assert_allclose(bands.velocities[0] @ n, speeds, rtol=1e-4)


@coarse
def test_the_search_finds_what_a_dense_solver_does():
    cell = BlochCell(void(), (4, 3, 3), domain=[[0, 0, 0], [1, 1, 1]])
    k = np.array([1.1, -0.4, 2.3])
    K, M = cell.stiffness(k).toarray(), cell.masses.toarray()
    np.testing.assert_allclose(K, K.conj().T, atol=1e-14)
    np.testing.assert_allclose(cell.stiffness(-k).toarray(), K.conj(), atol=1e-14)
    exact = np.sqrt(eigh(K, M, eigvals_only=True, subset_by_index=[0, 9]))
    bands = bloch(cell.domain, path=[k / 2 / np.pi, -k / 2 / np.pi], count=10, steps=1)
    np.testing.assert_allclose(bands.omega[0], exact, rtol=1e-8)
    np.testing.assert_allclose(bands.omega[1], exact, rtol=1e-8)
    assert bands.residuals.max() <= 1e-4
    step = 1e-4
    for j, e in enumerate(np.eye(3)):  # Hellmann and Feynman against differences
        up, down = (
            np.sqrt(eigh(cell.stiffness(k + s * e).toarray(), M, eigvals_only=True)[:10])
            for s in (step, -step)
        )
        slope = (up - down) / (2 * step)
        np.testing.assert_allclose(bands.velocities[0, :, j], slope, atol=2e-5)


@coarse
def test_products_with_the_mass_go_by_components():
    cell = BlochCell(void(), (4, 3, 3), domain=[[0, 0, 0], [1, 1, 1]])
    M = cell.masses.toarray()
    x = np.random.default_rng(1).normal(size=(5, len(M))) + 0.3j
    np.testing.assert_allclose(cell.inert(x), x @ M, atol=1e-15)


@coarse
def test_few_waves_are_a_basis_for_a_path_and_no_band_is_passed_over():
    cell = BlochCell(void((0.5, 0.5, 0.5), (0.31, 0.31, 0.31)), 4)  # bands of many symmetries
    bands = bloch(cell.domain, path="GXM", count=7, steps=8)
    assert (bands.report.steps[[7, 9, 15]] < bands.report.steps[[0, 8, 16]]).all()
    assert bands.report.steps.sum() < 0.5 * 17 * bands.report.steps[8]
    M = cell.masses.toarray()
    for i in (0, 3, 8, 11, 16):
        K = cell.stiffness(bands.k[i]).toarray()
        exact = eigh(K, M, eigvals_only=True, subset_by_index=[0, 6])
        np.testing.assert_allclose(bands.omega[i] ** 2, exact, rtol=1e-6, atol=1e-8)


@coarse
def test_errors_are_told_from_fewer_cells():
    for n in (6, 7):
        bands = bloch(full, n, path=[(0.5, 0.5, 0.4)], steps=1, count=16)
        true = bands.omega[0] / free_waves(bands.k[0], 16) - 1
        off = true > 1e-4  # waves without a factor exp(2 pi i x) are exact
        assert 4 < off.sum() < 16
        ratio = bands.errors[off] / true[off]
        assert ratio.min() > 0.5
        assert np.median(ratio) < 15
        np.testing.assert_array_less(bands.errors[~off], 1e-3)


@coarse
@pytest.mark.parametrize("n", [6, 8])
def test_errors_are_those_of_the_worst_corner(n):
    """Of a full cube it is M, not R, where waves are shorter."""
    bands = bloch(full, n, path="GXMRG", count=8, steps=1, degree=1)
    for c in bands.corners:
        exact = free_waves(bands.k[c], 8)
        off = np.where(exact > 1e-6, bands.omega[c] / np.maximum(exact, 1e-6) - 1, 0.0)
        np.testing.assert_array_less(off, 1.05 * bands.errors + 1e-9)


@coarse
def test_residuals_are_those_of_the_matrix_and_tell_how_far_off_frequencies_are():
    cell = BlochCell(void(), (5, 4, 4))
    bands = bloch(cell.domain, path=[[0.2, 0, 0], [0.5, 0, 0]], count=4, steps=5, modes=True)
    mu, mass = cell.inertia
    shift = mu / mass * np.pi**2
    assert (np.abs(np.log(bands.omega[:, 3] ** 2 / shift)) < np.log(3)).all()  # it was kept
    M = cell.masses.toarray()
    P = np.linalg.inv(cell.stiffness(np.zeros(3)).toarray() + shift * M)
    for i in range(6):
        K = cell.stiffness(bands.k[i]).toarray()
        exact = eigh(K, M, eigvals_only=True, subset_by_index=[0, 7])
        for n in range(4):
            c = bands.mode(i, n).coefficients
            x = (c[:, :3] + 1j * c[:, 3:]).ravel()
            square = bands.omega[i, n] ** 2
            r = K @ x - square * (M @ x)
            found = np.sqrt((r.conj() @ P @ r).real / square) * max(1, np.sqrt(shift / exact[7]))
            assert found == pytest.approx(bands.residuals[i, n], rel=1e-2)
            assert found <= 1e-4
            assert abs(square / exact[n] - 1) <= 4 * found**2 + 1e-12


@coarse
@pytest.mark.parametrize("degree", [1, 2])
def test_slow_waves_of_soft_layers_are_found(degree):
    """Frequencies are far below the largest of the grid, which residuals do not count with."""
    options = {"phases": "abs(u - 0.5) - 0.25", "young": (1e-6, 1.0), "degree": degree}
    k = (0.1, 0.0, 0.0)
    bands = bloch(full, (10, 3, 3), path=[k], steps=1, count=3, **options)
    cell = BlochCell(full, (10, 3, 3), **options)
    K, M = cell.stiffness(bands.k[0]).toarray(), cell.masses.toarray()
    exact = eigh(K, M, eigvals_only=True, subset_by_index=[0, 2])
    np.testing.assert_allclose(bands.omega[0] ** 2, exact, rtol=1e-4)
    if degree == 2:
        soft = 2e-6 * np.array([MU, MU, LAM + 2 * MU])  # two springs in a row
        np.testing.assert_allclose(bands.omega[0] / bands.k[0, 0], np.sqrt(soft), rtol=2e-2)


@coarse
def test_errors_are_those_of_the_same_waves_on_fewer_cells():
    """Bands change places between grids: a plane wave is exact, its neighbours are not."""
    rng = np.random.default_rng(136)
    most = np.log(rng.choice([3, 10, 30]))
    Q = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    C = Q @ np.diag(np.exp(rng.uniform(0, most, 6))) @ Q.T
    edges = rng.normal(size=(3, 3)) * 0.4 + 2 * np.eye(3)
    bands = bloch(full, 6, path=rng.uniform(-0.5, 0.5, (2, 3)), steps=1, count=4, stiffness=C,
                  through=il.macroshape.cell(edges))  # fmt: skip
    n = np.stack(np.meshgrid(*[np.arange(-3, 4)] * 3), -1).reshape(-1, 3) @ reciprocal(edges).T
    voigt = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])
    full_C = C[voigt[:, :, None, None], voigt]
    sure = np.zeros(4)
    for k, omega in zip(bands.k, bands.omega, strict=True):
        squares = np.linalg.eigvalsh(np.einsum("ijkl,nj,nl->nik", full_C, n + k, n + k))
        sure = np.maximum(sure, omega / np.sqrt(np.sort(squares.ravel())[:4]) - 1)
    assert sure.max() > 1e-2
    np.testing.assert_array_less(bands.errors[sure < 1e-6], 1e-3)
    np.testing.assert_array_less(sure, 1.05 * bands.errors + 1e-9)


@coarse
@rounding
def test_what_rounding_leaves_is_told_and_is_no_gap():
    bands = bloch(full, 4, path=[(1e-5, 0, 0), (0, 0, 0), (1e-7, 0, 0)], steps=1, count=3)
    exact = np.array([SHEAR, SHEAR, PRESSURE]) * bands.k[:, :1]
    off = np.abs(bands.omega[0] / exact[0] - 1)
    np.testing.assert_array_less(off, 1e-3)
    off = np.maximum(off, np.abs(bands.omega[2] / exact[2] - 1))
    np.testing.assert_array_less(off, bands.errors)
    np.testing.assert_array_equal(bands.omega[1], 0.0)
    assert np.isnan(bands.velocities[1]).all()
    with pytest.warns(PrecisionWarning, match=r"rounding leaves .* % of the square of a freq"):
        bloch(full, 4, path=[(1e-7, 0, 0)], steps=1, count=3)
    at_rest = bloch(full, 4, path="G", steps=1, count=5)
    assert all(gap.below == 3 for gap in at_rest.gaps)


@coarse
def test_sheared_cells_are_homogeneous_too():
    edges = np.array([[1.0, 0.5, 0.0], [0.0, 0.9, 0.2], [0.0, 0.0, 1.1]])
    bands = bloch(full, 4, through=il.macroshape.cell(edges), path=[(0.2, 0.1, 0.3)], count=2,
                  steps=1)  # fmt: skip
    np.testing.assert_allclose(bands.k[0], 2 * np.pi * np.linalg.inv(edges).T @ (0.2, 0.1, 0.3),
                               atol=1e-14)  # fmt: skip
    np.testing.assert_allclose(bands.omega[0], SHEAR * np.linalg.norm(bands.k[0]), rtol=1e-9)


@coarse
def test_shifts_turns_foldings_and_the_reciprocal_lattice():
    k = np.array([0.21, 0.13, 0.34])
    options = {"steps": 1, "count": 6}
    bands = bloch(void(), 6, path=[k], **options)
    error = 0.01
    assert error < bands.error < 0.1
    known = bands.omega[0]
    far = bloch(void(), 6, path=[k - np.array([0, 0, 1]), k + 1000.0], modes=True, **options)
    np.testing.assert_allclose(far.omega, [known, known], rtol=1e-7)
    np.testing.assert_allclose(far.error, bands.error, rtol=1e-3)
    np.testing.assert_allclose(far.mode(1, 2).k, 2 * np.pi * k, rtol=1e-9)  # of the first zone
    moved = bloch(void((0.13, 0.77, 0.41)), 6, path=[k], **options)
    np.testing.assert_allclose(moved.omega[0], known, rtol=error)
    turned = bloch(void(radii=(0.24, 0.3, 0.2)), 6, path=[(-k[1], k[0], k[2])], **options)
    np.testing.assert_allclose(turned.omega[0], known, rtol=1e-7)
    two = [[0, 0, 0], [2, 1, 1]]
    double = bloch(void(), (12, 6, 6), domain=two, path=[(2 * k[0], k[1], k[2])], **options)
    other = bloch(void(), 6, path=[k - np.array([0.5, 0, 0])], **options)
    folded = np.sort(np.append(known, other.omega))[:6]
    np.testing.assert_allclose(double.omega[0], folded, rtol=error)


@coarse
def test_paths_share_what_they_meet_again_and_homogeneous_cells_have_no_gap():
    bands = bloch(full, 4, path="GXMRG", count=4, steps=2)
    assert bands.k.shape == (9, 3)
    assert bands.labels == tuple("GXMRG")
    np.testing.assert_array_equal(bands.omega[0], bands.omega[-1])
    assert bands.gaps == ()
    assert [name for name, _ in bands.directional_gaps] == ["GX", "XM", "MR", "RG"]
    assert np.isnan(bands.velocities[0, 0]).all()
    np.testing.assert_allclose(np.linalg.norm(bands.velocities[1, 0]), SHEAR, rtol=1e-6)
    assert np.abs(bands.normalised[1, 0] - np.linalg.norm(bands.k[1]) / 2 / np.pi) < 1e-9


@coarse
def test_stiff_layers_stop_waves_and_files_tell_so(tmp_path):
    E, rho = (10.0, 1.0), np.array([2.0, 1.0])
    bands = bloch(
        full, (11, 3, 3), path="GX", steps=2, count=4, domain=BAR, system="orthorhombic",
        young=E, density=(2.0, 1.0), phases="abs(u - 0.5) - 0.25", modes=True,
    )  # fmt: skip
    edges = [rytov(np.pi, E, rho, 0)[i] for i in (0, 1)]
    lowest = bands.omega[:, 0].max(), bands.omega[-1, 2:].min()
    assert lowest[0] == pytest.approx(edges[0], rel=1e-3)
    assert lowest[1] < edges[1] * 0.999  # waves of another kind are in the gap of these
    assert 2 not in [g.below for g in bands.gaps]
    bands.save(tmp_path / "b.csv")
    with open(tmp_path / "b.csv") as file:
        rows = list(csv.DictReader(file))
    assert [r["label"] for r in rows] == ["G", "", "X"]
    assert float(rows[-1]["omega4"]) == bands.omega[-1, 3]
    bands.save(tmp_path / "b.json")
    told = json.loads((tmp_path / "b.json").read_text())
    assert told["labels"] == ["G", "X"]
    assert len(told["velocities"][1]) == 4
    with pytest.raises(FormatError, match=r"\.csv or \.json"):
        bands.save(tmp_path / "b.txt")
    figure = bands.plot()
    assert len(figure.axes[0].lines) == 4 + 2
    again = pickle.loads(pickle.dumps(bands))
    np.testing.assert_array_equal(again.omega, bands.omega)
    with pytest.raises(ValueError, match="read-only"):
        again.omega[0, 0] = 1.0
    wave = bands.mode(1, 1)
    u = np.array([[0.999999, 0.03, 0.02], [0.000001, 0.03, 0.02]])
    v = wave.evaluate(u)
    later = bands.mode(1, 1, phase=-float(bands.k[1, 0])).evaluate(u[1:])
    np.testing.assert_allclose(v[:1], later, atol=1e-4 * np.abs(v).max() + 1e-5)
    wave.save(tmp_path / "wave.vtu", on="solid")
    assert (tmp_path / "wave.vtu").stat().st_size > 500


def test_points_of_lattices():
    assert system_of(np.eye(3)) == "cubic"
    assert system_of(np.diag([1.0, 1.0, 2.0])) == "tetragonal"
    assert system_of(np.diag([1.0, 3.0, 2.0])) == "orthorhombic"
    for angle in (60, 120):
        a = np.radians(angle)
        edges = np.array([[1, np.cos(a), 0], [0, np.sin(a), 0], [0, 0, 0.7]])
        assert system_of(edges) == "hexagonal"
        b = reciprocal(edges)
        np.testing.assert_allclose(edges.T @ b, 2 * np.pi * np.eye(3), atol=1e-12)
        K = b @ points_of(edges)["K"]
        lattice = [b @ (i, j, 0) for i in (-1, 0, 1) for j in (-1, 0, 1)]
        near = np.sort([np.linalg.norm(K - g) for g in lattice])
        np.testing.assert_allclose(near[:3], 4 * np.pi / 3, rtol=1e-12)  # a corner of the zone
    way = path_of("GXG", np.eye(3), 2)
    np.testing.assert_allclose(way.fractions[:, 0], [0, 0.25, 0.5, 0.25, 0])
    np.testing.assert_array_equal(way.corners, [0, 2, 4])


#: How many points of the reciprocal lattice are next to points of symmetry.
NEXT = {
    "cubic": {"G": 1, "X": 2, "M": 4, "R": 8},
    "fcc": {"G": 1, "X": 2, "L": 2, "W": 4, "K": 3, "U": 3},
    "bcc": {"G": 1, "H": 6, "N": 2, "P": 4},
    "tetragonal": {"G": 1, "X": 2, "M": 4, "Z": 2, "R": 4, "A": 8},
    "orthorhombic": {"G": 1, "X": 2, "Y": 2, "Z": 2, "S": 4, "T": 4, "U": 4, "R": 8},
    "hexagonal": {"G": 1, "M": 2, "K": 3, "A": 2, "L": 4, "H": 6},
}
ROOT = 0.75**0.5
EDGES = {
    "cubic": np.eye(3),
    "fcc": 0.5 * np.array([[0, 1, 1], [1, 0, 1], [1, 1, 0]]),
    "bcc": 0.5 * np.array([[-1, 1, 1], [1, -1, 1], [1, 1, -1]]),
    "tetragonal": np.diag([1, 1, 1.7]),
    "orthorhombic": np.diag([1, 1.3, 1.7]),
    "hexagonal": np.array([[1, -0.5, 0], [0, ROOT, 0], [0, 0, 0.7]]),
}


@pytest.mark.parametrize("system", NEXT)
def test_points_have_as_many_neighbours_as_their_names_say(system):
    rng = np.random.default_rng(2)
    orders = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1]]
    for order in orders:
        edges = 3.7 * np.linalg.qr(rng.normal(size=(3, 3)))[0] @ EDGES[system][:, order]
        if system in ("cubic", "fcc", "bcc"):
            edges = edges @ np.array([[1, 1, 0], [0, 1, 0], [0, 1, 1]])
        assert system_of(edges) == system
        b = reciprocal(edges)
        lattice = np.stack(np.meshgrid(*[np.arange(-5, 6)] * 3), -1).reshape(-1, 3) @ b.T
        found = points_of(edges)
        assert found.keys() == NEXT[system].keys()
        for name, near in NEXT[system].items():
            size = np.linalg.norm(lattice - b @ found[name], axis=1)
            assert (size < size.min() * (1 + 1e-6) + 1e-9).sum() == near, name
    if system in ("fcc", "bcc"):  # W. Setyawan and S. Curtarolo, tables 3 and 4
        known = {"fcc": ("W", (0.5, 0.25, 0.75)), "bcc": ("H", (0.5, -0.5, 0.5))}[system]
        np.testing.assert_allclose(points_of(EDGES[system])[known[0]], known[1], atol=1e-12)


def test_names_of_other_lattices_are_refused():
    oblique = np.array([[1.0, 0.3, 0.3], [0.3, 1.0, 0.3], [0.3, 0.3, 1.0]])
    with pytest.raises(InputError, match=r"'X' in 'GX' .* has G alone; give points in parts"):
        path_of("GX", oblique, 1)
    np.testing.assert_array_equal(path_of("GX", oblique, 1, "triclinic").fractions[1], [0.5, 0, 0])
    for edges, system in (
        (np.diag([1.0, 2.0, 3.0]), "hexagonal"),
        (np.diag([1.0, 1.0, 2.0]), "cubic"),
        (np.diag([1.0, 1.3, 2.0]), "tetragonal"),
        (EDGES["fcc"], "cubic"),
        (oblique, "fcc"),
    ):
        for path in ("G", [(0.1, 0, 0)]):
            with pytest.raises(InputError, match=f"make up a .* lattice, not '{system}'"):
                path_of(path, edges, 1, system)
    with pytest.raises(InputError, match="system must be one of"):
        path_of([(0.1, 0, 0)], np.eye(3), 1, "round")
    assert points_of(np.eye(3), "tetragonal")["Z"].tolist() == [0, 0, 0.5]


@pytest.mark.parametrize(
    ("field", "options", "told"),
    [
        (lambda u: u[:, 0] - 0.5, {}, r"between the faces u=0 and u=1 it jumps by up to 2"),
        (full, {"path": "GXQ"}, "'Q' in 'GXQ' is no point of a cubic lattice, which has G, X, M"),
        (full, {"path": ""}, "path is empty"),
        (full, {"path": "GG"}, "from G to itself"),
        (full, {"path": [(0, 0)]}, r"got shape \(1, 2\)"),
        (full, {"path": [(0, np.nan, 0)]}, "path must be finite"),
        (full, {"system": "round"}, "system must be one of"),
        (full, {"count": 0}, "count must be"),
        (full, {"count": 300}, "count = 300 is too many for 81 unknowns"),
        (full, {"steps": 0}, "steps must be"),
        (full, {"tol": 0.0}, "tol must be"),
        (full, {"tol": 1.0}, "tol must be between 1e-12 and 0.1, got 1.0"),
        (full, {"pathh": "GX"}, "bloch has no option 'pathh'"),
        (full, {"modes": "yes"}, "modes must be"),
        (full, {"density": 0.0}, "density: the solid has no mass"),
        (full, {"density": np.nan}, "density must be"),
        (full, {"dilatation": "projected"}, "dilatation must be 'full'"),
    ],
)
def test_wrong_arguments(field, options, told):
    with pytest.raises(InputError, match=told):
        bloch(field, 3, **{"path": "GX", **options})


def test_what_cannot_be_found_is_said():
    with pytest.raises(il.errors.GeometryError, match="empty"):
        bloch(lambda u: np.ones(len(u)), 3)
    with pytest.raises(ConvergenceError, match=r"have a residual of .* after 1 steps"):
        bloch(void(), 4, path="GX", count=3, max_iterations=1)
    ball = il.fields.translate(il.fields.sphere(0.3), (0.5, 0.5, 0.5))
    with pytest.raises(il.errors.GeometryError, match="islands"):
        bloch(ball, 4)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PrecisionWarning)
        bands = bloch(full, 4, path="GX", count=1, steps=1)
    with pytest.raises(InputError, match="modes=True"):
        bands.mode(0, 0)
    with pytest.raises(InputError, match="band must be"):
        bands.mode(0, 1)
