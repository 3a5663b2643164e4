"""Phases of any symmetry: laminates, turned crystals, Christoffel's waves, assembled voxels."""

import warnings

import naive_homogenize as naive
import numpy as np
import pytest

import ilattice as il
from ilattice.errors import ConvergenceError, InputError, PrecisionWarning
from ilattice.homogenize import bloch, conductive, conductive_voxels, elastic, voxels

coarse = pytest.mark.filterwarnings("ignore:the cells are too coarse")
pytestmark = [
    pytest.mark.filterwarnings("ignore:the voxels are too coarse"),
    pytest.mark.filterwarnings("ignore:it is not known by how much"),
]
HEXAGONAL = np.array([[1.0, 0.5, 0.0], [0.0, 0.75**0.5, 0.0], [0.0, 0.0, 1.3]])
SHEARED = np.array([[1.0, 0.3, 0.0], [0.1, 0.8, -0.2], [0.0, 0.2, 1.3]])
#: Copper, in GPa and 1000 kg/m³, so that speeds are in km/s.
COPPER = np.zeros((6, 6))
COPPER[:3, :3] = 121.4
COPPER[range(3), range(3)] = 168.4
COPPER[range(3, 6), range(3, 6)] = 75.4


@pytest.fixture
def rng():
    return np.random.default_rng(11)


def full(u):
    return -np.ones(len(u))


def void(u):
    d = u - (0.47, 0.53, 0.5)
    return 1.0 - (((d - np.rint(d)) / (0.33, 0.24, 0.28)) ** 2).sum(axis=1)


@pytest.mark.parametrize(
    ("edges", "scale", "degree"),
    [(np.eye(3), 1.0, 1), (HEXAGONAL * 1e-3, 2e11, 2), (SHEARED * 1e3, 1e-4, 2)],
)
def test_one_crystal_is_itself_however_it_is_turned(rng, edges, scale, degree):
    Q = naive.random_rotation(rng)
    C = scale * naive.rotated(COPPER, Q)
    eff = elastic(full, 3, through=il.macroshape.cell(edges), stiffness=C, degree=degree)
    np.testing.assert_allclose(eff.C, C, atol=1e-12 * C.max())
    np.testing.assert_array_equal(eff.C, eff.C.T)
    np.testing.assert_allclose(eff.rotated(Q.T), scale * COPPER, atol=1e-12 * C.max())
    np.testing.assert_allclose(eff.bounds.voigt, C, atol=1e-12 * C.max())
    np.testing.assert_allclose(eff.bounds.reuss, C, atol=1e-10 * C.max())
    assert eff.bounds.hashin_shtrikman is None
    assert eff.error == 0.0


def test_axes_of_the_map_are_those_of_its_rotation(rng):
    Q = naive.random_rotation(rng)
    stretch = np.diag([1.0, 2.0, 0.5])
    cell = il.macroshape.cell(Q @ stretch)
    turned = elastic(full, 3, through=cell, stiffness=COPPER, axes="map")
    np.testing.assert_allclose(turned.C, naive.rotated(COPPER, Q), atol=1e-11 * COPPER.max())
    space = elastic(full, 3, through=cell, stiffness=COPPER)
    np.testing.assert_allclose(space.C, COPPER, atol=1e-11 * COPPER.max())


@pytest.mark.parametrize("contrast", [3.0, 1e6])
@pytest.mark.parametrize(("axis", "degree"), [(0, 1), (1, 2), (2, 1)])
def test_laminates_of_crystals_are_those_of_backus(rng, axis, degree, contrast):
    soft, hard = naive.random_stiffness(rng), contrast * naive.random_stiffness(rng)
    level = f"abs({'uvw'[axis]} - 0.5) - 0.2371"
    eff = elastic(full, 4, stiffness=(soft, hard), phases=level, degree=degree, estimate=False)
    part = 2 * 0.2371
    exact = naive.laminate((part, 1 - part), (soft, hard), np.eye(3)[axis])
    np.testing.assert_allclose(eff.C, exact, atol=1e-12 * exact.max())
    for better, worse in ((eff.bounds.voigt, eff.C), (eff.C, eff.bounds.reuss)):
        assert np.linalg.eigvalsh(better - worse).min() > -1e-12 * exact.max()
    labels = np.zeros((5, 4, 3), int).swapaxes(0, axis)
    np.moveaxis(labels, axis, 0)[:2] = 1
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PrecisionWarning)  # soft layers count as void
        found = voxels(labels, stiffness=np.stack([soft, hard]), estimate=False, tol=1e-9)
    part = 2 / labels.shape[axis]
    exact = naive.laminate((1 - part, part), (soft, hard), np.eye(3)[axis])
    np.testing.assert_allclose(found.C, exact, atol=1e-10 * exact.max())


@coarse
def test_turning_a_cell_with_a_void_turns_its_stiffness(rng):
    C = naive.random_stiffness(rng)
    one = elastic(void, 5, stiffness=C, estimate=False).C
    P = np.eye(3)[[1, 2, 0]] * [[1.0], [-1.0], [1.0]]  # a turn and a mirror, exact on the grid
    other = elastic(
        lambda u: void(u @ P), 5, domain=np.sort([P @ np.zeros(3), P @ np.ones(3)], axis=0),
        stiffness=naive.rotated(C, P), estimate=False,
    ).C  # fmt: skip
    np.testing.assert_allclose(other, naive.rotated(one, P), atol=2e-5 * one.max())
    assert np.linalg.eigvalsh(C - one).min() > 0


@coarse
def test_isotropic_matrices_are_isotropic_phases():
    names = {"phases": lambda x: np.linalg.norm(x - 0.5, axis=1) - 0.3, "expansion": (1e-5, 4e-5)}
    E, nu = (1.0, 10.0), (0.3, 0.2)
    scalars = elastic(full, 5, young=E, poisson=nu, estimate=False, **names)
    both = tuple(il.cutfem.orthotropic(young=e, poisson=v) for e, v in zip(E, nu, strict=True))
    matrices = elastic(full, 5, stiffness=both, estimate=False, **names)
    np.testing.assert_allclose(matrices.C, scalars.C, atol=3e-3 * scalars.C.max())
    np.testing.assert_allclose(matrices.expansion, scalars.expansion, atol=3e-8)
    one = elastic(void, 5, young=2.0, poisson=0.1, estimate=False)
    other = elastic(void, 5, stiffness=il.cutfem.orthotropic(young=2.0, poisson=0.1),
                    estimate=False)  # fmt: skip
    np.testing.assert_allclose(other.C, one.C, atol=1e-7 * one.C.max())


@coarse
def test_what_varies_from_point_to_point_is_a_laminate_of_many_layers(rng):
    first, second = naive.random_stiffness(rng), naive.random_stiffness(rng)

    def varying(x):
        return first + np.sin(np.pi * x[:, 0])[:, None, None] ** 2 * second

    x = (np.arange(400) + 0.5) / 400
    exact = naive.laminate(np.full(400, 1 / 400), varying(np.stack([x] * 3, 1)), (1, 0, 0))
    off, box = [], [[0, 0, 0], [1, 0.25, 0.25]]
    for n in (12, 18):
        eff = elastic(full, (n, 3, 3), domain=box, stiffness=varying, estimate=False)
        off.append(np.abs(eff.C - exact).max() / exact.max())
    assert off[0] < 5e-5
    assert off[0] / off[1] > 1.5**3


def test_laminates_of_crystals_expand_as_they_must(rng):
    soft, hard = naive.random_stiffness(rng), 4 * naive.random_stiffness(rng)
    alpha = (1e-5, 4e-5)
    unit = np.array([1, 1, 1, 0, 0, 0.0])
    eff = elastic(full, 4, stiffness=(soft, hard), phases="abs(u - 0.5) - 0.21", expansion=alpha,
                  estimate=False)  # fmt: skip
    # tractions N and strains T are the same in both layers, and their means are zero and alpha
    N, T, part = [0, 4, 5], [1, 2, 3], (0.42, 0.58)

    def normal_strain(C, a, plane):
        rest = plane - a * unit[T]
        return a * unit[N] - np.linalg.solve(C[np.ix_(N, N)], C[np.ix_(N, T)] @ rest)

    A = b = 0.0
    for f, C, a in zip(part, (soft, hard), alpha, strict=True):
        D = C[np.ix_(T, T)] - C[np.ix_(T, N)] @ np.linalg.solve(C[np.ix_(N, N)], C[np.ix_(N, T)])
        A, b = A + f * D, b + f * a * D @ unit[T]
    plane = np.linalg.solve(A, b)
    exact = np.empty(6)
    exact[T] = plane
    exact[N] = sum(
        f * normal_strain(C, a, plane) for f, C, a in zip(part, (soft, hard), alpha, strict=True)
    )
    np.testing.assert_allclose(eff.expansion, exact, atol=1e-15)
    labels = np.repeat([0, 0, 1, 1, 1], 12).reshape(5, 3, 4)
    found = voxels(labels, stiffness=np.stack([soft, hard]), expansion=alpha, tol=1e-10)
    twin = elastic(full, 5, stiffness=(soft, hard), phases="abs(u - 0.5) - 0.2", expansion=alpha,
                   estimate=False)  # fmt: skip
    np.testing.assert_allclose(found.expansion, twin.expansion, atol=1e-13)


def test_waves_in_a_crystal_are_those_of_christoffel(rng):
    C = naive.rotated(COPPER, naive.random_rotation(rng))
    k = np.array([0.1, 0.23, -0.07])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PrecisionWarning)
        bands = bloch(full, 4, path=[k], steps=1, count=3, stiffness=C, density=8.96)
        varying = bloch(full, 4, path=[k], steps=1, count=3, density=8.96,
                        stiffness=lambda x: np.broadcast_to(C, (len(x), 6, 6)))  # fmt: skip
    wave = bands.k[0]
    matrix = np.einsum("ijkl,j,l->ik", naive.full(C), wave, wave) / 8.96
    exact = np.sqrt(np.linalg.eigvalsh(matrix))
    np.testing.assert_allclose(bands.omega[0], exact, rtol=1e-9)
    np.testing.assert_allclose(varying.omega[0], exact, rtol=1e-9)
    _, polarization = np.linalg.eigh(matrix)
    speed = np.einsum("ijkl,jm,km,l->mi", naive.full(C), polarization, polarization, wave)
    full_speed = np.stack([
        np.einsum("ijkl,i,k,l->j", naive.full(C), p, p, wave) for p in polarization.T
    ]) / 8.96 / exact[:, None]  # fmt: skip
    np.testing.assert_allclose(bands.velocities[0], full_speed, atol=1e-4 * np.abs(speed).max())


@pytest.fixture(scope="module")
def grains():
    """Turned crystals of copper in voxels without symmetry."""
    rng = np.random.default_rng(5)
    labels = rng.integers(0, 4, (5, 4, 6))
    turned = [naive.rotated(COPPER, naive.random_rotation(rng)) for _ in range(3)]
    return labels, np.stack([*turned, 1e-3 * naive.random_stiffness(rng)]), (0.3, 0.5, 0.2)


def test_grains_are_those_of_the_assembled_system(grains):
    labels, C, spacing = grains
    exact = naive.assembled(C[labels], spacing)
    eff = voxels(labels, stiffness=C, spacing=spacing, tol=1e-6)
    np.testing.assert_allclose(eff.C, exact, atol=1e-10 * exact.max())
    np.testing.assert_array_equal(eff.C, eff.C.T)
    for better, worse in ((eff.bounds.voigt, eff.C), (eff.C, eff.bounds.reuss)):
        assert np.linalg.eigvalsh(better - worse).min() > 0
    assert eff.bounds.bulk is None


def test_one_matrix_of_voxels_is_that_of_their_solid(grains):
    labels, C, spacing = grains
    solid = labels > 0
    eff = voxels(solid, stiffness=C[0], spacing=spacing, tol=1e-6)
    exact = naive.assembled(np.stack([1e-6 * C[0], C[0]])[solid.astype(int)], spacing)
    np.testing.assert_allclose(eff.C, exact, atol=1e-9 * exact.max())
    some = voxels(0.5 + 0.5 * solid, stiffness=C[0], spacing=spacing, tol=1e-6)
    exact = naive.assembled(np.stack([0.5 * C[0], C[0]])[solid.astype(int)], spacing)
    np.testing.assert_allclose(some.C, exact, atol=1e-9 * exact.max())
    none = voxels(labels, stiffness=np.stack([*C[:3], np.zeros((6, 6))]), spacing=spacing, tol=1e-6)
    exact = naive.assembled(np.stack([*C[:3], 1e-9 * COPPER])[labels], spacing)
    np.testing.assert_allclose(none.C, exact, atol=1e-6 * exact.max())


def test_isotropic_voxels_are_the_same_by_matrices():
    labels = np.random.default_rng(5).integers(0, 3, (4, 5, 6))
    E, nu, alpha = (1e-2, 1.0, 7.0), (0.1, 0.3, -0.2), (1.0, 2.0, 3.0)
    C = np.stack([naive.isotropic(*p) for p in zip(E, nu, strict=True)])
    one = voxels(labels, young=E, poisson=nu, expansion=alpha, tol=1e-8)
    other = voxels(labels, stiffness=C, expansion=alpha, tol=1e-8)
    np.testing.assert_allclose(other.C, one.C, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(other.expansion, one.expansion, rtol=1e-10, atol=1e-10)


@coarse
def test_both_routes_agree_where_they_have_the_same_functions(grains):
    labels, C, spacing = grains
    box = np.array([np.zeros(3), np.array(labels.shape) * spacing])

    def at(x):
        return C[labels[tuple(np.minimum(x / spacing, np.array(labels.shape) - 1).astype(int).T)]]

    cut = elastic(full, labels.shape, domain=box, stiffness=at, degree=1, estimate=False, tol=1e-12)
    found = voxels(labels, stiffness=C, spacing=spacing, estimate=False, tol=1e-9)
    np.testing.assert_allclose(cut.C, found.C, atol=1e-9 * found.C.max())
    np.testing.assert_allclose(cut.bounds.reuss, found.bounds.reuss, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("stiffness", "more", "told"),
    [
        (np.eye(6)[:5], {}, "shape"),
        (np.stack([np.eye(6)] * 3), {}, "labels|values"),
        (np.triu(np.ones((6, 6))), {}, "symmetric"),
        (np.stack([np.eye(6), -np.eye(6)]), {}, "positive definite"),
        (np.zeros((6, 6)), {}, "stiffness"),
        (np.eye(6), {"young": 1.0}, "leave out"),
        (np.eye(6), {"poisson": 0.3}, "leave out"),
        (np.full((6, 6), np.inf), {}, "finite"),
    ],
)
def test_wrong_matrices_of_voxels(stiffness, more, told):
    labels = np.zeros((2, 2, 2), int)
    labels[0, 0, 0] = len(stiffness) - 1 if np.ndim(stiffness) == 3 and len(stiffness) == 2 else 5
    with pytest.raises(InputError, match=told):
        voxels(labels, stiffness=stiffness, **more)


# ---------------------------------------------------------------------------- conductivity


def spd(rng, size=1.0):
    a = rng.standard_normal((3, 3))
    return size * (a @ a.T + 0.3 * np.eye(3))


@pytest.mark.parametrize(
    ("edges", "scale", "degree"),
    [(np.eye(3), 1.0, 1), (HEXAGONAL * 1e-3, 2e11, 2), (SHEARED * 1e3, 1e-4, 2)],
)
def test_one_conducting_crystal_is_itself_in_any_cell(rng, edges, scale, degree):
    k = spd(rng, scale)
    eff = conductive(full, 3, through=il.macroshape.cell(edges), conductivity=k, degree=degree)
    np.testing.assert_allclose(eff.k, k, atol=1e-12 * k.max())
    for bound in eff.bounds.wiener:
        np.testing.assert_allclose(bound, k, atol=1e-12 * k.max())
    assert eff.bounds.hashin_shtrikman is None
    assert eff.error == 0.0


@pytest.mark.parametrize("contrast", [3.0, 1e6])
@pytest.mark.parametrize(("axis", "degree"), [(0, 1), (1, 2), (2, 1)])
def test_laminates_of_conducting_crystals_are_exact_on_both_routes(rng, axis, degree, contrast):
    pair = (spd(rng), spd(rng, contrast))
    level = f"abs({'uvw'[axis]} - 0.5) - 0.2371"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        eff = conductive(
            full, 5, conductivity=pair, phases=level, degree=degree, estimate=degree == 1
        )
    part = 2 * 0.2371
    exact = naive.conducting_laminate((part, 1 - part), pair, np.eye(3)[axis])
    np.testing.assert_allclose(eff.k, exact, atol=1e-12 * exact.max())
    np.testing.assert_array_equal(eff.k, eff.k.T)
    low, high = eff.bounds.wiener
    for better, worse in ((high, eff.k), (eff.k, low)):
        assert np.linalg.eigvalsh(better - worse).min() > -1e-12 * exact.max()
    assert not eff.error > 1e-6
    labels = np.zeros((5, 4, 3), int).swapaxes(0, axis)
    np.moveaxis(labels, axis, 0)[:2] = 1
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PrecisionWarning)  # soft layers count as void
        found = conductive_voxels(labels, conductivity=np.stack(pair), estimate=False, tol=1e-9)
    part = 2 / labels.shape[axis]
    exact = naive.conducting_laminate((1 - part, part), pair, np.eye(3)[axis])
    np.testing.assert_allclose(found.k, exact, atol=1e-10 * exact.max())


def test_sheared_laminates_conduct_as_they_must(rng):
    """A crystal and a scalar phase; the layers are parallel to two edges of the cell."""
    pair = (spd(rng), 2.0)
    cell = il.macroshape.cell(SHEARED)
    eff = conductive(
        full, 5, conductivity=pair, phases="abs(u - 0.5) - 0.2371", through=cell, estimate=False
    )
    n = np.linalg.inv(SHEARED)[0]
    exact = naive.conducting_laminate(
        (2 * 0.2371, 1 - 2 * 0.2371), (pair[0], 2.0 * np.eye(3)), n / np.linalg.norm(n)
    )
    np.testing.assert_allclose(eff.k, exact, atol=1e-12 * exact.max())


@coarse
def test_turning_a_conducting_cell_turns_its_conductivity(rng):
    k = spd(rng)
    one = conductive(void, 5, conductivity=k, estimate=False).k
    P = np.eye(3)[[1, 2, 0]] * [[1.0], [-1.0], [1.0]]
    other = conductive(
        lambda u: void(u @ P), 5, domain=np.sort([P @ np.zeros(3), P @ np.ones(3)], axis=0),
        conductivity=P @ k @ P.T, estimate=False,
    ).k  # fmt: skip
    np.testing.assert_allclose(other, P @ one @ P.T, atol=2e-5 * one.max())
    assert np.linalg.eigvalsh(k - one).min() > 0
    scalar = conductive(void, 5, conductivity=2.0, estimate=False).k
    matrix = conductive(void, 5, conductivity=2.0 * np.eye(3), estimate=False).k
    np.testing.assert_allclose(matrix, scalar, atol=1e-12)
    turned = conductive(
        full, 3, through=il.macroshape.cell(P @ np.diag([1.0, 2.0, 0.5])), conductivity=k,
        axes="map",
    ).k  # fmt: skip
    np.testing.assert_allclose(turned, P @ k @ P.T, atol=1e-12 * k.max())


@pytest.mark.parametrize(
    ("conductivity", "told"),
    [
        (np.diag([1.0, 1.0, -0.1]), "must be positive definite"),
        (np.array([[1.0, 0.5, 0], [0, 1, 0], [0, 0, 1]]), "must be symmetric"),
        (np.eye(2), r"a matrix, shape \(3, 3\), got shape \(2, 2\)"),
        (np.full((3, 3), np.nan), "finite"),
        (lambda x: np.tile(-np.eye(3), (len(x), 1, 1)), r"at \(.* must be positive definite"),
        (lambda x: np.ones((len(x), 3, 2)), "one per point"),
        (lambda x: np.ones((len(x), 2)), "one value per point"),
        (np.ones(3), "a number"),
    ],
)
def test_wrong_matrices_of_conductivity(conductivity, told):
    with pytest.raises(InputError, match=told):
        conductive(full, 3, conductivity=conductivity)


# ---------------------------------------------------------------------------- contrast


@coarse
@pytest.mark.parametrize("hard_outside", [True, False])
def test_too_different_phases_are_told(hard_outside):
    """Nobody holds a cell: the reason is the contrast, and no rounding comes without a word."""
    E = (1e12, 1.0)[:: 1 if hard_outside else -1]
    names = {"phases": lambda x: np.linalg.norm(x - 0.5, axis=1) - 0.31, "degree": 1}
    with pytest.raises(ConvergenceError, match=r"differs by a factor of 1e\+12 .* take 1e\+09"):
        elastic(full, 6 if hard_outside else 10, young=E, **names)
    fair = elastic(full, 10, young=(1e6, 1.0), **names)
    told = refused = 0
    for contrast in (1e12, 7e11, 4e11, 2e11, 1e11):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                eff = elastic(full, 10, young=(contrast, 1.0), **names)
            except ConvergenceError as e:
                refused += "differ" in str(e)
                continue
        off = abs(fair.C[0, 0] / eff.C[0, 0] - 1)
        assert off < eff.error < 0.6, f"off by {off} at {contrast:g}, told {eff.error}"
        messages = [str(w.message) for w in caught if w.category is PrecisionWarning]
        told += any("rounding is about" in m or "is off by about" in m for m in messages)
        assert messages or off < 0.02, f"off by {off} without a word"
    assert told, refused
    assert refused
    finer = elastic(full, 16, young=(1e6, 1.0), estimate=False, **names)
    assert 0.0 < fair.C[0, 0] / finer.C[0, 0] - 1 < fair.error < 0.1


@pytest.mark.parametrize("contrast", [1e8, 1e10])
def test_contrasts_beyond_double_precision_are_told(contrast):
    """A laminate bears 2 along its normal; softer than 1e-9 of the rest it counts as nothing."""
    array = np.zeros((8, 2, 2), int)
    array[4:] = 1
    calls = (
        lambda: voxels(array, young=(1.0, contrast), poisson=0.0).E((1, 0, 0)),
        lambda: elastic(full, (8, 4, 4), young=(1.0, contrast), poisson=0.0, degree=1,
                        phases=lambda x: np.abs(x[:, 0] - 0.5) - 0.25).E((1, 0, 0)),
    )  # fmt: skip
    for call in calls:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            found = call()
        told = any("counts as nothing" in str(w.message) for w in caught)
        assert told == (contrast > 1e9)
        assert found == pytest.approx(0.0 if told else 2.0, rel=1e-3)
