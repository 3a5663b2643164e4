"""Voxels: against assembled systems, laminates, symmetries of the array."""

import base64
import warnings

import naive_homogenize as naive
import numba
import numpy as np
import pytest

import ilattice as il
from ilattice.errors import ConvergenceError, GeometryError, InputError, PrecisionWarning
from ilattice.homogenize import conductive_voxels, voxels
from ilattice.homogenize._spectral import VoxelGrid, prolonged, restricted
from ilattice.homogenize._voxel_errors import FourTimes, left_at_edges, missed

TURN = np.eye(3)[[1, 2, 0]]
#: Of small grids, which is what most tests take; two look at the warnings.
pytestmark = [
    pytest.mark.filterwarnings("ignore:the voxels are too coarse"),
    pytest.mark.filterwarnings("ignore:it is not known by how much"),
]


@pytest.fixture(autouse=True)
def one_thread():
    """Grids here are too small for more."""
    most = numba.get_num_threads()
    numba.set_num_threads(1)
    yield
    numba.set_num_threads(most)


@pytest.fixture(scope="module")
def cell():
    """Random labels without symmetry, off any grid of powers of two, and what they are made of."""
    rng = np.random.default_rng(5)
    labels = rng.integers(0, 3, (5, 4, 6))
    young, poisson, spacing = (1e-3, 1.0, 7.0), (0.1, 0.3, -0.2), (0.3, 0.5, 0.2)
    return labels, young, poisson, spacing


def test_random_phases_are_those_of_the_assembled_system(cell):
    labels, young, poisson, spacing = cell
    table = np.array([naive.isotropic(*p) for p in zip(young, poisson, strict=True)])
    exact = naive.assembled(table[labels], spacing)
    eff = voxels(labels, young=young, poisson=poisson, spacing=spacing, tol=1e-6)
    np.testing.assert_allclose(eff.C, exact, atol=1e-10 * exact.max())
    np.testing.assert_array_equal(eff.C, eff.C.T)
    coarse = voxels(labels, young=young, poisson=poisson, spacing=spacing, tol=1e-2)
    assert 1e-12 < np.abs(coarse.C - exact).max() / exact.max() < 1e-3  # off by squares of tol


def test_random_conductors_are_those_of_the_assembled_system(cell):
    labels, *_, spacing = cell
    k = np.array([0.1, 1.0, 5.0])
    exact = naive.assembled((k[:, None, None] * np.eye(3))[labels], spacing)
    eff = conductive_voxels(labels, conductivity=k, spacing=spacing, tol=1e-6)
    np.testing.assert_allclose(eff.k, exact, atol=1e-10)
    rng = np.random.default_rng(6)
    A = rng.standard_normal((3, 3, 3))
    tensors = A @ A.transpose(0, 2, 1) + 0.1 * np.eye(3)
    exact = naive.assembled(tensors[labels], spacing)
    eff = conductive_voxels(labels, conductivity=tensors, spacing=spacing, tol=1e-6)
    np.testing.assert_allclose(eff.k, exact, atol=1e-9)
    assert eff.bounds.hashin_shtrikman is None
    least, most = eff.bounds.wiener
    assert np.linalg.eigvalsh(eff.k - least).min() > 0
    assert np.linalg.eigvalsh(most - eff.k).min() > 0


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("contrast", [10.0, 1e6])
def test_laminates_are_exact(axis, contrast):
    labels = np.zeros((8, 8, 8), int)
    np.moveaxis(labels, axis, 0)[3:5] = 1
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PrecisionWarning)  # soft layers count as void
        eff = voxels(labels, young=(1.0, contrast), poisson=(0.3, 0.2), spacing=(0.3, 0.1, 0.7))
    phases = [naive.isotropic(1.0, 0.3), naive.isotropic(contrast, 0.2)]
    exact = naive.laminate((0.75, 0.25), phases, np.eye(3)[axis])
    np.testing.assert_allclose(eff.C, exact, atol=1e-10 * exact.max())


def test_one_material_is_itself():
    eff = voxels(np.ones((3, 4, 5), bool), young=2.0, poisson=0.25, spacing=(1.0, 0.2, 3.0))
    np.testing.assert_allclose(eff.C, naive.isotropic(2.0, 0.25), rtol=1e-12, atol=1e-13)
    assert eff.report.iterations == 0
    assert eff.symmetry == "isotropic"
    assert eff.E((1, 2, 3)) == pytest.approx(2.0, rel=1e-12)


def test_the_reference_inverts_a_homogeneous_grid():
    rng = np.random.default_rng(7)
    table = np.array([[0.7, 1.3]])
    grid = VoxelGrid(np.zeros((5, 6, 2), np.int32), table, np.array([0.3, 0.5, 0.2]), table[0])
    u = rng.standard_normal(grid.shape)
    u -= u.mean(axis=(1, 2, 3), keepdims=True)
    np.testing.assert_allclose(grid.precondition(grid.forces(u)), u, atol=3e-6)
    c, f = rng.standard_normal((3, 2, 3, 1)), rng.standard_normal((3, 4, 6, 2))
    assert (prolonged(c) * f).sum() == pytest.approx((c * restricted(f)).sum(), rel=1e-12)


def test_shifts_tilings_turns_and_mirrors(cell):
    labels, young, poisson, _ = cell
    C = voxels(labels, young=young, poisson=poisson, tol=1e-6).C
    scale = 1e-9 * np.abs(C).max()

    def of(array):
        return voxels(array, young=young, poisson=poisson, tol=1e-6).C

    np.testing.assert_allclose(of(np.roll(labels, (2, 1, -1), (0, 1, 2))), C, atol=scale)
    np.testing.assert_allclose(of(np.tile(labels, (2, 2, 2))), C, atol=scale)
    turned = naive.rotated(C, TURN)  # new x is old y
    np.testing.assert_allclose(of(labels.transpose(1, 2, 0)), turned, atol=scale)
    np.testing.assert_allclose(of(labels[::-1]), naive.rotated(C, np.diag([-1, 1, 1])), atol=scale)


def test_void_contrast_and_size_change_no_number_of_iterations():
    steps = []
    for n in (12, 24):
        solid = gyroid(n) < 0.5
        for void in (0.0, 1e-9, 1e-4):
            eff = voxels(solid, young=(void, 1.0), estimate=False)
            steps.append(eff.report.iterations)
    assert max(steps) - min(steps) <= 3
    assert max(steps) < 22


def gyroid(n):
    x = 2 * np.pi * (np.arange(n) + 0.5) / n
    x, y, z = x[:, None, None], x[:, None], x
    return np.abs(np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x))


def test_a_small_spherical_void():
    """Dilute: to first order K falls by f (1 + 3 K / (4 G)), which is 0.98911 K for f = 0.00415."""
    n, f = 64, 0.00415
    x = (np.arange(n) + 0.5) / n - 0.5
    solid = x[:, None, None] ** 2 + x[:, None] ** 2 + x**2 > (3 * f / (4 * np.pi)) ** (2 / 3)
    eff = voxels(solid, poisson=0.3, estimate=False)
    assert pytest.approx(0.98911, abs=5e-4) == eff.K * 3 * 0.4
    assert eff.bounds.bulk[1] > eff.K
    assert eff.distances["cubic"] < 1e-9


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
@pytest.mark.parametrize("seed", range(8))
def test_random_cells_keep_their_bounds(seed):
    """Of Voigt and Reuss always; of Hashin and Shtrikman up to the reported error: 200 cells."""
    rng = np.random.default_rng(seed)
    for _ in range(25):
        n, count = int(rng.choice([4, 6])), int(rng.integers(2, 4))
        labels = rng.integers(0, count, (n, n, n))
        if rng.random() < 0.3:
            labels = labels[:4, :4, :4].repeat(2, 0).repeat(2, 1).repeat(2, 2)
        young, poisson = 10 ** rng.uniform(-2, 1, count), rng.uniform(-0.3, 0.4, count)
        eff = voxels(labels, young=young, poisson=poisson)
        assert eff.margins["voigt"] > -1e-7
        assert eff.margins["reuss"] > -1e-7
        low, high = eff.bounds.bulk
        assert low - 1e-7 * high <= eff.K <= high + eff.errors[:3, :3].sum() / 9
        low, high = eff.bounds.shear
        spread = np.sqrt(np.diag(eff.errors))
        assert low - 1e-7 * high <= eff.G_mean <= high + (spread**2).sum() / 5
        if rng.random() < 0.8:
            continue
        k = conductive_voxels(labels, conductivity=young)
        low, high = k.bounds.hashin_shtrikman
        assert low - 1e-7 * high <= k.mean <= high + np.trace(k.errors) / 3


def test_errors_cover_what_finer_voxels_change():
    """The same material on voxels half as long: a Galerkin method falls, by what was estimated."""
    rng = np.random.default_rng(8)
    labels = np.repeat(np.repeat(np.repeat(rng.integers(0, 2, (3, 3, 3)), 2, 0), 2, 1), 2, 2)
    coarse = voxels(labels, young=(0.1, 1.0))
    fine = voxels(labels.repeat(2, 0).repeat(2, 1).repeat(2, 2), young=(0.1, 1.0))
    fallen = np.linalg.eigvalsh(coarse.C - fine.C)
    assert fallen[0] > -1e-8
    change = np.diag(coarse.C - fine.C)
    assert (change > 0).all()
    assert (change < np.diag(coarse.errors)).all()
    assert (np.diag(coarse.errors) < 9 * change).all()
    assert np.isnan(voxels(labels[:5], young=(0.1, 1.0)).error)
    assert np.isnan(voxels(labels, young=(0.1, 1.0), estimate=False).error)


def chessboard(n):
    i, j, _ = np.indices((n, n, 4))
    return (i // (n // 2) + j // (n // 2)) % 2


@pytest.mark.filterwarnings("ignore:the solid does not go on")
@pytest.mark.parametrize("n", [16, 32])
@pytest.mark.parametrize("ratio", [3.0, 10.0, 100.0, 1e3, 1e6, 1e-3])
def test_errors_of_chessboards(ratio, n):
    """Of which the conductivity is the geometric mean (Dykhne 1970)."""
    found = conductive_voxels(chessboard(n), conductivity=(1.0, ratio))
    true = found.k[0, 0] - np.sqrt(ratio)
    assert 0.7 * true < found.errors[0, 0] < 2.0 * true
    assert (np.diag(found.errors) <= np.diag(found.k - found.bounds.wiener[0])).all()
    assert found.errors[2, 2] < 1e-8 * found.k[2, 2]


def test_errors_of_chessboards_that_few_voxels_do_not_show():
    for n in (4, 6, 8, 10, 20):
        for ratio in (10.0, 1e3):
            found = conductive_voxels(chessboard(n), conductivity=(1.0, ratio))
            true = found.k[0, 0] - np.sqrt(ratio)
            assert 0.5 * true < found.errors[0, 0] < 3.0 * true


def test_errors_do_not_depend_on_where_the_cell_begins():
    blocks = np.random.default_rng(13).integers(0, 2, (4, 4, 4))
    blocks = blocks.repeat(4, 0).repeat(4, 1).repeat(4, 2)
    there = voxels(blocks, young=(0.1, 1.0)).errors
    shifted = voxels(np.roll(blocks, (1, 2, 3), (0, 1, 2)), young=(0.1, 1.0)).errors
    np.testing.assert_allclose(np.diag(shifted), np.diag(there), rtol=0.02)


@pytest.mark.parametrize("numbers", [2, 6, 36])
def test_elements_of_longer_voxels_are_the_short_ones_together(numbers):
    rng = np.random.default_rng(14)
    table = rng.random((3, numbers)) + 0.5
    if numbers == 36:
        table = np.array([(t + t.T).ravel() for t in table.reshape(3, 6, 6)])
    phase = rng.integers(0, 3, (8, 4, 12)).astype(np.int32)
    grid = VoxelGrid(phase, table, np.array([0.3, 0.5, 0.2]), table[0])
    longer = FourTimes(grid)
    u = rng.standard_normal(longer.grid.shape)
    exact = restricted(restricted(grid.forces(prolonged(prolonged(u)))))
    np.testing.assert_allclose(longer.forces(u), exact, atol=1e-13 * np.abs(exact).max())


def test_powers_at_edges_of_chessboards():
    """Kellogg's example: a ratio of 161.4476387975881 for fields that grow with the power 0.1."""
    table = np.array([[1.0, 1.0, 1.0, 0, 0, 0], [161.4476387975881] * 3 + [0] * 3])
    grid = VoxelGrid(chessboard(8).astype(np.int32), table, np.ones(3), table[0])
    assert left_at_edges(grid) == pytest.approx(2.0**-0.2, rel=1e-12)
    layers = np.zeros((4, 4, 4), np.int32)
    layers[1:, :2] = 1
    assert left_at_edges(VoxelGrid(layers, table, np.ones(3), table[0])) == 0.0


def test_errors_of_a_geometric_series_of_inverses():
    for left in (0.5, 0.7, 0.9):
        one, two, four = 1.0 / (1.0 - 0.01 * left ** -np.arange(3.0))
        one, two, four = (np.array([v]) for v in (one, two, four))
        args = two - one, four - two, np.array([5.0]), np.zeros(1), 0.95
        assert missed(one, *args)[0] == pytest.approx(1.3 * (one[0] - 1.0), rel=0.01)
        assert missed(one, *args[:3], one - 1e-3, 0.95)[0] == pytest.approx(1e-3)


@pytest.mark.parametrize("unit", [1e-300, 1e-9, 1e200])
def test_the_unit_of_length_does_not_matter(unit):
    labels, edges = np.random.default_rng(15).integers(0, 2, (4, 4, 4)), np.array([1.0, 3.0, 0.5])
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        eff = voxels(labels, young=(0.1, 1.0), spacing=unit * edges)
    np.testing.assert_allclose(eff.C, voxels(labels, young=(0.1, 1.0), spacing=edges).C, rtol=1e-9)


def test_slender_voxels_are_exact_or_refused():
    labels = np.zeros((4, 4, 4), int)
    labels[:2] = 1
    phases = [naive.isotropic(0.1, 0.3), naive.isotropic(1.0, 0.3)]
    exact = naive.laminate((0.5, 0.5), phases)
    for spacing in ((1e-3, 1e3, 1.0), (1e6, 1.0, 1e3)):
        eff = voxels(labels, young=(0.1, 1.0), spacing=spacing)
        np.testing.assert_allclose(eff.C, exact, atol=1e-10)
    for spacing in ((1e-60, 1e60, 1.0), (1.0, 1.0, 1e-7)):
        with pytest.raises(InputError, match=r"spacing: the longest edge .* 1e\+06 times"):
            voxels(labels, young=(0.1, 1.0), spacing=spacing)


@pytest.mark.parametrize(
    ("of", "name"),
    [
        (lambda a, **o: voxels(a, young=(0.3, 1.0), **o), "the effective stiffness"),
        (lambda a, **o: conductive_voxels(a, conductivity=(0.3, 1.0), **o), "the .* conductivity"),
    ],
)
def test_errors_are_told(of, name):
    """As those of cut cells are: with the number, or why there is none; not of what is exact."""
    random = np.random.default_rng(8).integers(0, 2, (4, 4, 4))
    with pytest.warns(PrecisionWarning, match=f"{name} is off by about .* take cut cells") as told:
        eff = of(random)
    assert told[0].filename == __file__
    assert 0.02 < eff.error < 1.0
    assert f"about {100 * eff.error:.2g} %" in str(told[0].message)
    with pytest.warns(PrecisionWarning, match=f"not known by how much {name} .* 4 x 4 x 3 voxels"):
        of(random[:, :, :3])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        of(random, estimate=False)
        layers = np.ones((6, 5, 4), int)
        assert of(layers).error == 0.0  # nothing to relax: exact for odd numbers, too
        layers = layers[:, :4]
        layers[:2] = 0
        assert of(layers).error < 1e-8


def test_stiffnesses_of_any_size_have_bounds():
    labels = np.zeros((4, 4, 4), int)
    labels[:2] = 1
    with pytest.warns(PrecisionWarning) as told:
        eff = voxels(labels, young=(1.0, 1e300))
    gap, contrast = (str(w.message) for w in told)
    assert "along x: only voids" in gap
    assert "materials differ by a factor of 1e+300" in contrast
    assert np.isfinite([*eff.bounds.bulk, *eff.bounds.shear, *eff.margins.values()]).all()
    assert eff.bounds.shear[1] > 1e299


def test_meanings_of_arrays():
    rng = np.random.default_rng(9)
    solid = rng.random((4, 4, 4)) < 0.7
    pair = voxels(solid, young=(1e-6, 1.0)).C
    np.testing.assert_array_equal(voxels(solid).C, pair)
    np.testing.assert_array_equal(voxels(solid.astype(np.uint8)).C, pair)
    np.testing.assert_array_equal(voxels(solid.astype(float), young=(1e-6, 1.0)).C, pair)
    factors = np.where(solid, 1.0, 1e-6)
    np.testing.assert_allclose(voxels(factors).C, pair, rtol=1e-9, atol=1e-15)
    fill = rng.random((4, 4, 4))
    eff = voxels(fill, young=(1.0, 3.0), poisson=0.2)
    np.testing.assert_allclose(eff.C, voxels(1 + 2 * fill, poisson=0.2).C, rtol=1e-9, atol=1e-12)
    assert eff.density == pytest.approx(fill.mean(), rel=1e-14)
    assert voxels(solid).density == solid.mean()


@pytest.mark.parametrize("void", [0.0, 1e-6])
def test_no_way_through_along_an_axis(void):
    solid = np.zeros((4, 4, 4), bool)
    solid[:, :, 1:3] = True
    with pytest.warns(PrecisionWarning, match="along z: ") as told:
        eff = voxels(solid, young=(void, 1.0), poisson=0.3)
    assert ("nothing is borne" in str(told[0].message)) == (void == 0.0)
    assert eff.percolates == (True, True, False)
    assert eff.E((1, 0, 0)) == pytest.approx(0.5, rel=1e-5)
    assert eff.C[2, 2] <= 3 * void
    if void == 0.0:
        assert not eff.C[2:5].any()
        assert eff.mechanisms == 3


def test_the_same_bits_for_any_number_of_threads():
    labels = np.random.default_rng(10).integers(0, 2, (9, 7, 8))
    found = []
    for count in (1, min(numba.config.NUMBA_NUM_THREADS, 4)):
        numba.set_num_threads(count)
        found.append(voxels(labels, young=(0.1, 1.0)).C)
    np.testing.assert_array_equal(found[0], found[-1])


@pytest.mark.parametrize(
    ("array", "options", "kind", "told"),
    [
        (np.zeros((2, 2)), {}, InputError, "three directions"),
        (np.zeros((2, 2, 0)), {}, InputError, "three directions"),
        (np.array([[["a"]]]), {}, InputError, "three directions"),
        (np.full((2, 2, 2), np.nan), {}, InputError, "finite"),
        (np.zeros((2, 2, 2), bool), {}, GeometryError, "no solid"),
        (np.zeros((2, 2, 2)), {}, GeometryError, "no solid"),
        (np.zeros((2, 3, 2), int), {"young": (0.0, 1.0)}, GeometryError, "young is zero in all"),
        (np.zeros((2, 3, 2)), {"young": (0.0, 1.0)}, GeometryError, "young is zero in all"),
        (np.full((2, 3, 2), 1), {"young": (2.0, 0.0, 1.0)}, GeometryError, "young is zero in all"),
        (np.full((2, 2, 2), 2), {}, InputError, "labels from 2 to 2"),
        (np.full((2, 2, 2), 2), {"young": (1, 2)}, InputError, "labels from 0 to 1"),
        (np.full((2, 2, 2), -1), {"young": (1, 2)}, InputError, "labels from -1"),
        (np.full((2, 2, 2), 1.5), {"young": (1, 2)}, InputError, "fill fractions"),
        (np.full((2, 2, 2), 0.5), {"young": (1, 2, 3)}, InputError, "3 values"),
        (np.ones((2, 2, 2)), {"young": 0.0}, InputError, "not all zero"),
        (np.ones((2, 2, 2)), {"young": -1.0}, InputError, "must not be negative"),
        (np.ones((2, 2, 2)), {"poisson": 0.5}, InputError, "below 0.5"),
        (np.ones((2, 2, 2), int), {"young": (1, 2), "poisson": (0.1,) * 3}, InputError, "or 2"),
        (np.ones((2, 2, 2)), {"spacing": (1, 0, 1)}, InputError, "spacing"),
        (np.ones((2, 2, 2)), {"tol": 0.0}, InputError, "tol"),
        (np.ones((2, 2, 2)), {"max_iterations": 0}, InputError, "max_iterations"),
        ("nowhere.npy", {}, InputError, "no file"),
    ],
)
def test_wrong_arguments(array, options, kind, told):
    with pytest.raises(kind, match=told):
        voxels(array, **options)


def test_size_is_estimated_before_work():
    huge = np.lib.stride_tricks.as_strided(np.ones(1, bool), (1, 1, 1), (0, 0, 0))
    many = np.broadcast_to(huge, (3000, 3000, 3000))
    with pytest.raises(InputError, match=r"3000 x 3000 x 3000 voxels needs about"):
        voxels(many)


def test_too_few_iterations_and_locking():
    labels = np.random.default_rng(11).integers(0, 2, (6, 6, 6))
    with pytest.raises(ConvergenceError, match="after 2 iterations"):
        voxels(labels, young=(1e-6, 1.0), max_iterations=2)
    with pytest.warns(PrecisionWarning, match="trilinear voxels lock"):
        voxels(labels, young=(0.1, 1.0), poisson=0.48)


def test_files_of_voxels(tmp_path):
    import pyvista as pv
    from skimage.io import imsave

    array = np.random.default_rng(12).integers(0, 2, (3, 4, 5)).astype(np.uint8)
    np.save(tmp_path / "a.npy", array)
    image = pv.ImageData(dimensions=(4, 5, 6), spacing=(0.1, 0.2, 0.3))
    image.cell_data["solid"] = array.ravel(order="F")
    image.save(tmp_path / "a.vti")
    imsave(tmp_path / "a.tif", array.transpose(), check_contrast=False)
    for name, spacing in (("a.npy", 1.0), ("a.vti", (0.1, 0.2, 0.3)), ("a.tif", 1.0)):
        read, edges = il.homogenize.read_voxels(tmp_path / name)
        np.testing.assert_array_equal(read, array)
        np.testing.assert_allclose(edges, np.broadcast_to(spacing, 3))
    from_file = voxels(tmp_path / "a.vti", young=(0.1, 1.0)).C
    np.testing.assert_array_equal(
        from_file, voxels(array, young=(0.1, 1.0), spacing=(0.1, 0.2, 0.3)).C
    )
    (tmp_path / "b.npy").write_bytes(b"nothing")
    np.save(tmp_path / "c.npy", np.zeros((2, 2)))
    (tmp_path / "d.xyz").write_text("")
    for name, told in (
        ("b.npy", "cannot be read"),
        ("c.npy", "three directions"),
        ("d.xyz", "end"),
    ):
        with pytest.raises(il.errors.FormatError, match=told):
            il.homogenize.read_voxels(tmp_path / name)


IMAGE = (
    '<VTKFile type="ImageData" byte_order="LittleEndian"{compressor}><ImageData WholeExtent='
    '"0 {n} 0 {n} 0 {n}" Spacing="{spacing}"><Piece><CellData><DataArray type="UInt8" Name="a" '
    'NumberOfComponents="{components}" format="{format}">{values}</DataArray></CellData></Piece>'
    "</ImageData></VTKFile>"
)
USUAL = {
    "compressor": "", "n": 2, "spacing": "1 1 1", "components": 1, "format": "ascii",
    "values": "0 1 1 1 0 1 1 1",
}  # fmt: skip


def test_images_that_lie_take_no_memory(tmp_path):
    import tracemalloc

    file = tmp_path / "a.vti"
    file.write_text(IMAGE.format(**USUAL))
    assert il.homogenize.read_voxels(file)[0][0, 0, 1] == 0
    blocks = base64.b64encode(np.array([1, 1 << 31, 1 << 31, 12], "<u4").tobytes()).decode()
    packed = {"compressor": ' compressor="vtkZLibDataCompressor"', "format": "binary"}
    for change, told in (
        ({"n": 2000}, "do not hold"),
        ({"n": 2**31 - 1}, "do not hold"),
        ({"n": 3}, "8 values of 27"),
        ({"n": "nan"}, "no voxels"),
        ({"components": 100_000_000}, "several components"),
        ({"spacing": "0 -1 nan"}, "above zero"),
        ({"values": "0 1 x"}, "cannot be read"),
        ({**packed, "values": blocks}, "cannot be read"),
        ({**packed, "n": 90, "values": blocks}, "do not hold"),
    ):
        file.write_text(IMAGE.format(**{**USUAL, **change}))
        tracemalloc.start()
        with pytest.raises(il.errors.FormatError, match=told):
            il.homogenize.read_voxels(file)
        assert tracemalloc.get_traced_memory()[1] < 5e6
        tracemalloc.stop()


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.float32, np.float64])
@pytest.mark.parametrize("mode", [0, 1, 2])
@pytest.mark.parametrize("compressor", ["None", "ZLib", "LZMA"])
def test_images_are_read_as_vtk_writes_them(tmp_path, dtype, mode, compressor):
    import pyvista as pv
    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

    rng = np.random.default_rng(3)
    array = rng.integers(0, 99, (13, 9, 7)).astype(dtype)
    image = pv.ImageData(dimensions=array.shape, spacing=(0.1, 0.2, 0.3))
    image.point_data["a"] = array.ravel(order="F")
    for encoded in (False, True):
        writer = vtkXMLImageDataWriter()
        writer.SetInputData(image)
        writer.SetFileName(str(tmp_path / "a.vti"))
        writer.SetDataMode(mode)
        writer.SetEncodeAppendedData(encoded)
        writer.SetBlockSize(1 << 10)
        getattr(writer, f"SetCompressorTypeTo{compressor}")()
        assert writer.Write()
        read, edges = il.homogenize.read_voxels(tmp_path / "a.vti")
        np.testing.assert_array_equal(read, array)
        np.testing.assert_allclose(edges, (0.1, 0.2, 0.3))


def test_damaged_files_of_voxels_end_in_our_errors(tmp_path):
    rng = np.random.default_rng(4)
    np.save(tmp_path / "a.npy", rng.integers(0, 2, (5, 4, 3)))
    (tmp_path / "a.vti").write_text(IMAGE.format(**USUAL))
    refused = 0
    for round in range(300):
        name = "a.npy" if round % 2 else "a.vti"
        data = bytearray((tmp_path / name).read_bytes())
        for at in rng.integers(0, min(len(data), 500), rng.integers(1, 5)):
            data[at] = rng.integers(0, 256)
        if rng.random() < 0.2:
            del data[rng.integers(0, len(data)) :]
        (tmp_path / f"b{name}").write_bytes(bytes(data))
        try:
            il.homogenize.read_voxels(tmp_path / f"b{name}")
        except il.errors.IlatticeError:
            refused += 1
    assert refused > 100


def test_masks_are_not_read():
    masked = np.ma.masked_array(np.ones((3, 3, 3), int), mask=True)
    with pytest.raises(InputError, match="masked"):
        voxels(masked, young=(1e-6, 1.0))
    with pytest.raises(InputError, match="masked"):
        il.homogenize.conductive_voxels(masked, conductivity=(1e-6, 1.0))


def test_conductivities_are_zero_where_nothing_is_borne():
    plate = np.zeros((6, 6, 6), int)
    plate[:, :, 2:4] = 1
    plate[2:4, 2:4, 1] = 1
    with pytest.warns(PrecisionWarning, match="along z"):
        k = conductive_voxels(plate, conductivity=(0.0, 1.0)).k
    assert not k[2].any()
    assert k[0, 0] > 1 / 3
