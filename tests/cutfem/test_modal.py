"""Natural frequencies and buckling against exact solutions."""

import numpy as np
import pytest
from scipy.linalg import eigh

import ilattice as il
from ilattice.cutfem import Elasticity, buckling, natural_modes
from ilattice.errors import ConvergenceError, InputError

#: Numbers on coarse grids are what is tested here.
pytestmark = pytest.mark.filterwarnings("ignore:the cells are too coarse")

COLUMN = [[0.0] * 3, [1.0, 1.0, 10.0]]
#: Free ball of radius 1, E = 1, nu = 0.3, rho = 1: torsion l = 2, (l - 1) j_l(x) = x j_{l+1}(x)
#: with x = omega / c_s, and the spheroidal vibration l = 2; both five-fold.
TORSION, SPHEROIDAL = 1.551135, 1.641114


def ball(u):
    return (u**2).sum(axis=1) - 1.0


def column(cells=(2, 2, 10), **options):
    """A square bar that fills its box."""
    return Elasticity(lambda u: np.abs(u[:, 0] - 0.5) - 0.7, cells, domain=COLUMN, **options)


@pytest.fixture(scope="module")
def balls():
    problems = [Elasticity(ball, n, domain=[[-1.1] * 3, [1.1] * 3]) for n in (5, 8)]
    return [(p, natural_modes(p, 16)) for p in problems]


def test_a_free_ball(balls):
    for _, modes in balls:
        assert np.abs(modes.omega[:6]).max() < 1e-4 * TORSION
    for group, exact in ((slice(6, 11), TORSION), (slice(11, 16), SPHEROIDAL)):
        errors = [np.abs(m.omega[group] / exact - 1).max() for _, m in balls]
        assert errors[1] < 4e-4
        assert np.log(errors[0] / errors[1]) / np.log(8 / 5) > 3.5  # order 2 p = 4


def test_faster_vibrations_of_a_free_ball():
    """An eighth of it has one of seven torsions l = 3, and the breathing l = 0."""
    errors = []
    for n in (4, 6):
        problem = Elasticity(ball, n, domain=[[0.0] * 3, [1.1] * 3])
        for axis, place in enumerate(("u=0", "v=0", "w=0")):
            problem = problem.clamp(place, components=(axis,))
        errors.append(np.abs(natural_modes(problem, 4).omega[2:] / (2.396785, 3.098086) - 1))
    assert (errors[0] < 1e-3).all()
    assert (np.log(errors[0] / errors[1]) / np.log(6 / 4) > 3.5).all()


def test_modes_are_orthonormal_in_the_mass(balls):
    problem, modes = balls[0]
    V = modes.vectors.reshape(len(modes.vectors), -1).T
    np.testing.assert_allclose(V.T @ (problem.mass() @ V), np.eye(16), atol=1e-6)
    K = V.T @ (problem.system.K @ V)
    np.testing.assert_allclose(K, np.diag(modes.omega**2), atol=1e-5)
    np.testing.assert_allclose(modes.frequencies * 2 * np.pi, modes.omega)


def test_multigrid_finds_the_same_modes(balls):
    problem, modes = balls[0]
    found = natural_modes(problem, 8, method="multigrid")
    np.testing.assert_allclose(found.omega[6:], modes.omega[6:8], rtol=1e-6)
    assert found.report.method == "multigrid"
    assert found.report.residual <= 1e-6


@pytest.mark.parametrize("r", [1, 0])
def test_a_cantilever_and_its_density(r):
    modes = natural_modes(column(smoothness=r).clamp("w=0"), 2)
    euler = 1.8751041**2 * np.sqrt(1 / 12 / 10**4)
    np.testing.assert_allclose(modes.omega, euler, rtol=0.01)
    assert modes.report.shift == 0
    heavy = natural_modes(column(density=4.0, smoothness=r).clamp("w=0"), 2)
    np.testing.assert_allclose(heavy.omega, modes.omega / 2, rtol=1e-6)
    held = column(smoothness=r).clamp("w=0")
    fixed = held.constraints.fixed
    assert fixed.any()
    assert (modes.vectors[:, fixed] == 0).all()


@pytest.mark.parametrize(("method", "r"), [("superlu", 1), ("multigrid", 1), ("superlu", 0)])
def test_a_column_buckles(method, r):
    """Clamped and free, with shear and the shortening before a few thousandths off Euler."""
    solution = column(smoothness=r).clamp("w=0").load(traction=(0, 0, -2.0), on="w=1").solve()
    found = buckling(solution, 2, method=method)
    np.testing.assert_allclose(2 * found.factors, np.pi**2 / 12 / 400, rtol=0.01)
    corner = found.vectors[:, -1]  # of the tip, which turns by pi / (2 L) of its deflection
    aside = np.linalg.norm(corner[:, :2], axis=1)
    assert (np.abs(corner[:, 2]) < 1.05 * np.pi / 20 * np.sqrt(0.5) * aside).all()


def test_tension_does_not_buckle():
    pulled = column((1, 1, 6)).clamp("w=0").load(traction=(0, 0, 1.0), on="w=1").solve()
    with pytest.raises(ConvergenceError, match="no load factor is positive"):
        buckling(pulled, 30)


@pytest.mark.parametrize("poisson", [0.0, 0.3])
def test_loads_that_only_pull_are_refused_at_once(poisson, monkeypatch):
    """It took ten seconds to say that Lanczos' method finds ever more than one mode."""
    bar = column((2, 2, 8), poisson=poisson).clamp("w=0")
    pulled = bar.load(force=(0, 0, 1e-3), on="w=1").solve()
    monkeypatch.setattr("ilattice.cutfem.modal.largest", None)
    with pytest.raises(ConvergenceError, match=r"no load factor is positive up to .* loads pull"):
        buckling(pulled, 1)


def test_bad_input():
    problem = column((1, 1, 4)).clamp("w=0")
    for count, match in ((0, "count"), (1.5, "count"), (10_000, r"at most [1-9][0-9]* can")):
        with pytest.raises(InputError, match=match):
            natural_modes(problem, count)
    with pytest.raises(InputError, match="tol"):
        natural_modes(problem, 2, tol=-1.0)
    with pytest.raises(InputError, match="method"):
        natural_modes(problem, 2, method="guess")
    with pytest.raises(InputError, match="density"):
        natural_modes(column((1, 1, 4), density=0.0).clamp("w=0"), 2)
    with pytest.raises(InputError, match=r"no stress.* add loads"):
        buckling(problem.solve(), 2)


def test_no_copy_of_a_repeated_frequency_is_missed():
    """One start of Lanczos' method sees one vector of each group; all are found by LAPACK."""
    cube = lambda u: -np.ones(len(u))  # noqa: E731
    problem = il.cutfem.Elasticity(cube, 3, domain=[[0, 0, 0], [1.0, 1.0, 1.0]])
    K, M = problem.system.K.toarray(), problem.mass().toarray()
    known = np.sqrt(np.maximum(eigh(K, M, eigvals_only=True), 0.0))
    for count in (2, 7, 8, 14, 22):
        found = il.cutfem.natural_modes(problem, count)
        np.testing.assert_allclose(found.omega, known[:count], rtol=1e-6, atol=1e-5)
        x = found.vectors.reshape(count, -1)
        np.testing.assert_allclose(x @ M @ x.T, np.eye(count), atol=1e-6)
    many = il.cutfem.natural_modes(problem, len(known) - 1).omega
    np.testing.assert_allclose(many, known[:-1], rtol=1e-6, atol=1e-5)
    held = problem.clamp("w=0", components="z")
    assert (np.sort(il.cutfem.natural_modes(held, 5).omega)[:5] < 1e-4).sum() == 3
    two = il.fields.union(*(il.fields.translate(il.fields.box((0.2, 0.25, 0.3)), (s, 0.03, 0))
                            for s in (-0.5, 0.5)))  # fmt: skip
    problem = il.cutfem.Elasticity(two, 7, domain=[[-1] * 3, [1] * 3], degree=1)
    omega = il.cutfem.natural_modes(problem, 14).omega
    assert (omega < 1e-3 * omega[-1]).sum() == 12


def bar(length, young, density, cells=(12, 2, 2)):
    """A slender bar that fills its box."""
    edges = np.array([10.0, 0.6, 0.4]) * length
    return Elasticity(
        lambda u: -np.ones(len(u)), cells, domain=[[0.0] * 3, [1.0] * 3],
        through=il.macroshape.box(tuple(edges)), young=young, density=density,
    )  # fmt: skip


@pytest.mark.parametrize("unit", [(1.0, 2.1e5, 7.85e-9), (1e-5, 2.1e11, 7850.0), (1e3, 1e-6, 1.0)])
def test_frequencies_do_not_depend_on_units(unit):
    length, young, density = unit
    plain = natural_modes(bar(1.0, 1.0, 1.0), 9).omega
    omega = natural_modes(bar(*unit), 9).omega * length * np.sqrt(density / young)
    np.testing.assert_allclose(omega[6:], plain[6:], rtol=1e-8)
    assert np.abs(omega[:6]).max() < 1e-4 * plain[6]  # squares are zero to rounding


@pytest.mark.parametrize(("count", "soft"), [(8, 1.0), (10, 0.7), (11, 0.9)])
def test_bodies_on_soft_springs_move_as_rigid_ones(count, soft):
    """Against the frequencies of a rigid block on an elastic foundation under one end."""
    size, k, rho = np.array([10.0, 0.6, 0.4]), 1e-2 * soft, 2.0
    modes = natural_modes(bar(1.0, 1000.0, rho).spring("u=0", k), count)

    def gram(x, weights):  # of the six rigid motions about the middle of the end
        rows = []
        for i in range(3):
            rows.append(np.tile(np.eye(3)[i], (len(x), 1)))
        for i in range(3):
            rows.append(np.cross(np.eye(3)[i], x))
        return np.einsum("ink,jnk,n->ij", np.stack(rows), np.stack(rows), weights)

    nodes, w = np.polynomial.legendre.leggauss(2)  # exact for squares of linear functions
    t = np.stack(np.meshgrid(nodes, nodes, nodes, indexing="ij"), axis=-1).reshape(-1, 3) / 2
    w3 = np.prod(np.stack(np.meshgrid(w, w, w, indexing="ij")), axis=0).ravel() / 8
    solid = t * size + [size[0] / 2, 0.0, 0.0]
    face = t * size * [0.0, 1.0, 1.0]
    stiff, mass = gram(face, k * w3 * size[1] * size[2]), gram(solid, rho * w3 * size.prod())
    rigid = np.sqrt(eigh(stiff, mass, eigvals_only=True))
    np.testing.assert_allclose(modes.omega[:6], rigid, rtol=5e-3)  # the block gives in, too
    assert (modes.omega[:6] <= rigid * (1.0 + 1e-4)).all()
    assert modes.omega[6] > 10 * modes.omega[5]
    assert modes.report.residual < 1e-3  # by rounding: one motion costs 1e-9 of a stretch
