"""Stiffness of any symmetry: patch tests, turned axes, a tube of Lekhnitskii, identities."""

import naive_homogenize as naive
import numpy as np
import pytest

import ilattice as il
from ilattice.cutfem import Elasticity, Graded, orthotropic
from ilattice.errors import InputError, PrecisionWarning

rng = np.random.default_rng(7)
C = naive.random_stiffness(rng)
SLOPE = np.random.default_rng(8).standard_normal((3, 3))
STRAIN = np.array([SLOPE[i, j] + (i != j) * SLOPE[j, i] for i, j in naive.VOIGT])
SHEARED = np.array([[1.0, 0.3, 0.0], [0.1, 0.8, -0.2], [0.0, 0.2, 1.3]])
coarse = pytest.mark.filterwarnings("ignore:the cells are too coarse")


def full(u):
    return -np.ones(len(u))


def ball(u):
    return np.linalg.norm(u - 0.5, axis=1) - 0.4


def affine(x):
    return x @ SLOPE.T


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("given", ["constant", "callable", "graded"])
def test_affine_displacements_are_exact_by_nitsche_in_a_sheared_map(degree, given):
    value = {
        "constant": C,
        "callable": lambda x: np.broadcast_to(C, (len(x), 6, 6)),
        "graded": Graded("rho", [0.0, 2.0], [0.5 * C, 1.5 * C]),
    }[given]
    through = il.macroshape.affine(SHEARED).with_extra(rho=1.0)
    options = {"through": through, "domain": [[0.0] * 3, [1.0] * 3], "degree": degree, "q": 8}
    problem = Elasticity(ball, 4, stiffness=value, stabilization="ghost", **options)
    solution = problem.clamp("surface", value=affine).solve(tol=1e-13)
    points = problem.domain.solid(problem.assembly).parameters[::7]
    np.testing.assert_allclose(solution.evaluate(points), affine(through.x(points)), atol=1e-9)
    np.testing.assert_allclose(
        solution.stress(points), np.tile(C @ STRAIN, (len(points), 1)), atol=1e-7
    )
    volume = problem.domain.solid(problem.assembly).integrate()
    assert solution.energy == pytest.approx(0.5 * STRAIN @ C @ STRAIN * volume, rel=1e-8)
    assert np.abs(solution.reactions["surface"]).max() < 1e-8  # what is in equilibrium
    assert solution.error_estimate().relative < 1e-7


def test_an_isotropic_matrix_is_the_isotropic_material():
    same = orthotropic(young=2.0, poisson=0.25)
    np.testing.assert_allclose(same, naive.isotropic(2.0, 0.25), atol=1e-14)
    bent = il.macroshape.torus(major=2.0, width=1.0)
    box = [[0.1, 0.0, 0.0], [0.35, 1.0, 1.0]]
    work = []
    for material in (
        {"young": 2.0, "poisson": 0.25},
        {"stiffness": same, "axes": "map"},
        {"stiffness": lambda x: np.broadcast_to(same, (len(x), 6, 6))},
    ):
        problem = Elasticity(
            lambda u: np.linalg.norm((u - (0.2, 0.5, 0.5)) * (2, 1, 1), axis=1) - 0.45, (4, 4, 4),
            domain=box, through=bent, expansion=1e-3, **material,
        )  # fmt: skip
        problem = problem.clamp("surface", components="xy")
        problem = problem.spring("surface", 1.0)
        problem = problem.load(body=(0.3, 0.1, -1.0), temperature=lambda x: x[:, 0])
        s = problem.solve()
        work.append([s.compliance, s.energy, s.error_estimate().relative, *s.reactions["surface"]])
    # penalties of both kinds of materials differ, and vanish as the solution gets better
    np.testing.assert_allclose(work[1], work[2], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(work[0], work[1], rtol=2e-2, atol=2e-3)


def tube(x, k, a=1.0, b=0.3):
    """Displacement a r^k + b r^-k along the radius (Lekhnitskii)."""
    r = np.hypot(x[:, 0], x[:, 1])[:, None]
    return (a * r**k + b * r**-k) * x * (1, 1, 0) / r


@coarse
def test_a_tube_whose_axes_turn_with_it_is_that_of_lekhnitskii():
    # around, along the radius, along the axis: as the parameters of the map go
    stiff = orthotropic(young=(9.0, 1.0, 2.0), poisson=(0.2, 0.4, 0.1), shear=(0.6, 0.5, 0.7))
    k = (stiff[0, 0] / stiff[1, 1]) ** 0.5
    assert k > 2
    section = il.BSpline(
        [[0, 0, 1, 1], [0, 0, 1, 1]],
        [[[1.0, 0.0, 0.0], [1.0, 0.0, 1.0]], [[2.0, 0.0, 0.0], [2.0, 0.0, 1.0]]],
        1,
    )
    quarter = il.macroshape.revolve(section, angle=np.pi / 2)
    off = []
    for n in (3, 6):
        problem = Elasticity(
            full, (n, n, 2), stiffness=stiff, axes="map", through=quarter,
            domain=[[0.0] * 3, [1.0] * 3],
        )  # fmt: skip
        for place in ("u=0", "u=1", "v=0", "v=1", "w=0", "w=1"):
            problem = problem.clamp(place, value=lambda x: tube(x, k), method="nitsche")
        solution = problem.solve()
        u = np.random.default_rng(1).uniform(0.05, 0.95, (200, 3))
        off.append(np.abs(solution.evaluate(u) - tube(quarter.x(u), k)).max())
    assert off[1] < 2e-3
    assert np.log2(off[0] / off[1]) > 2.3
    wrong = Elasticity(full, (6, 6, 2), stiffness=stiff, through=quarter,
                       domain=[[0.0] * 3, [1.0] * 3])  # fmt: skip
    for place in ("u=0", "u=1", "v=0", "v=1", "w=0", "w=1"):
        wrong = wrong.clamp(place, value=lambda x: tube(x, k), method="nitsche")
    u = np.random.default_rng(1).uniform(0.05, 0.95, (200, 3))
    assert np.abs(wrong.solve().evaluate(u) - tube(quarter.x(u), k)).max() > 20 * off[1]


def test_free_expansion_is_free_and_hindered_expansion_is_the_stiffness_times_it():
    box = {"domain": [[0.0] * 3, [1.0] * 3], "through": il.macroshape.affine(SHEARED)}
    hot = Elasticity(ball, 4, stiffness=C, expansion=2e-3, q=8, **box).load(temperature=50.0)
    free = hot.spring("surface", 1e-9).solve(tol=1e-12)
    u = np.random.default_rng(3).uniform(0.35, 0.65, (50, 3))
    np.testing.assert_allclose(free.stress(u), 0.0, atol=1e-7)
    np.testing.assert_allclose(free.strain(u)[:, :3], 0.1, atol=1e-7)
    held = hot.clamp("surface").solve(tol=1e-12)
    expected = -0.1 * C[:, :3].sum(axis=1)
    np.testing.assert_allclose(held.stress(u), np.tile(expected, (50, 1)), atol=1e-8)
    assert np.abs(held.reactions["surface"]).max() < 1e-8


@pytest.mark.parametrize("degree", [1, 2])
def test_two_phases_share_a_stress_in_series(degree):
    some = np.random.default_rng(9)
    hard = naive.rotated(30.0 * naive.random_stiffness(some), naive.random_rotation(some))
    box = {"domain": [[0.0] * 3, [1.0] * 3]}
    problem = Elasticity(full, 3, stiffness=(C, hard), phases="u - 0.41", degree=degree, **box)
    # the gradient jumps across the layers such that tractions agree
    N = [0, 5, 4]
    jump = -np.linalg.solve(hard[np.ix_(N, N)], ((hard - C) @ STRAIN)[N])

    def exact(x):
        return affine(x) + np.maximum(x[:, :1] - 0.41, 0.0) * jump

    for place in ("u=0", "u=1", "v=0", "v=1", "w=0", "w=1"):
        problem = problem.clamp(place, value=exact, method="nitsche")
    solution = problem.solve(tol=1e-12)
    u = np.random.default_rng(3).uniform(0.0, 1.0, (300, 3))
    np.testing.assert_allclose(solution.evaluate(u), exact(u), atol=1e-8)
    soft = u[:, 0] < 0.41
    np.testing.assert_allclose(solution.stress(u)[soft], np.tile(C @ STRAIN, (soft.sum(), 1)),
                               atol=1e-6)  # fmt: skip
    np.testing.assert_allclose(solution.stress(u)[:, N], np.tile((C @ STRAIN)[N], (300, 1)),
                               atol=1e-6)  # fmt: skip


def test_engineering_constants_are_those_of_the_compliance():
    E, nu, G = (1.0, 2.0, 9.0), (0.2, 0.05, 0.1), (0.6, 0.5, 0.7)
    S = np.linalg.inv(orthotropic(young=E, poisson=nu, shear=G))
    np.testing.assert_allclose(1 / np.diag(S), [*E, *G], rtol=1e-12)
    np.testing.assert_allclose([-S[1, 0] * E[0], -S[2, 0] * E[0], -S[2, 1] * E[1]], nu, rtol=1e-12)


def test_graded_is_between_and_monotone():
    graded = Graded(lambda x: x[:, 0], [0.0, 1.0, 4.0], [C, 2 * C, 9 * C])
    t = np.linspace(0, 4, 50)
    factor = graded.between(t)[:, 0, 0] / C[0, 0]
    assert (np.diff(factor) > 0).all()
    assert factor[[0, -1]] == pytest.approx([1, 9])
    with pytest.raises(InputError, match="from 0 to 4, but its property is 4"):
        graded.between([4.5])
    with pytest.raises(ValueError, match="read-only"):
        graded.C[0, 0, 0] = 1.0


def test_what_changes_its_volume_little_is_said_to_lock():
    stiff = orthotropic(young=1.0, poisson=0.4999)
    problem = Elasticity(full, 2, stiffness=stiff, domain=[[0.0] * 3, [1.0] * 3])
    with pytest.warns(PrecisionWarning, match="stiffness= the solid locks"):
        assert problem.matrix.shape


def test_a_jump_of_the_stiffness_within_a_cell_is_told():
    def jumping(x):
        return np.where((x[:, 0] > 0.3)[:, None, None], 9.0 * C, C)

    problem = Elasticity(full, 2, stiffness=jumping, domain=[[0.0] * 3, [1.0] * 3])
    with pytest.warns(PrecisionWarning, match="by a factor of 9"):
        assert problem.clamp("u=0").matrix.shape


WRONG = [
    ({"stiffness": np.eye(5)}, "shape"),
    ({"stiffness": np.triu(np.ones((6, 6)))}, "symmetric"),
    ({"stiffness": -np.eye(6)}, "positive definite"),
    ({"stiffness": np.zeros((6, 6))}, "positive definite"),
    ({"stiffness": np.full((6, 6), np.nan)}, "finite"),
    ({"stiffness": np.stack([np.eye(6)] * 2)}, "pair"),
    ({"stiffness": np.eye(6), "young": 1.0}, "both given"),
    ({"stiffness": np.eye(6), "poisson": 0.3}, "both given"),
    ({"stiffness": np.eye(6), "axes": "lattice"}, "axes must be one of"),
    ({"axes": "map"}, "stiffness="),
    ({"stiffness": np.eye(6), "dilatation": "projected"}, "dilatation"),
    ({"stiffness": "rho"}, "stiffness"),
    ({"stiffness": Graded("rho", [0, 1], [np.eye(6)] * 2)}, "rho"),
]


@pytest.mark.parametrize(("options", "told"), WRONG)
def test_wrong_arguments(options, told):
    with pytest.raises(InputError, match=told):
        Elasticity(full, 2, domain=[[0.0] * 3, [1.0] * 3], **options)


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (lambda x: np.ones((len(x), 6)), "one matrix per point"),
        (lambda x: np.full((len(x), 6, 6), np.nan), "finite"),
        (lambda x: np.eye(6) - 3.0 * (x[:, :1] > 0.5)[:, :, None] * np.eye(6), r"stiffness at \("),
    ],
)
def test_wrong_values_at_points(value, told):
    problem = Elasticity(full, 2, stiffness=value, domain=[[0.0] * 3, [1.0] * 3])
    with pytest.raises(InputError, match=told):
        problem.clamp("u=0").load(body=(1, 0, 0)).solve()


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"young": -1.0, "poisson": 0.3}, "young"),
        ({"young": (1, 2, 3), "poisson": 0.3}, "shear must be given"),
        ({"young": 1.0, "poisson": 0.6}, "poisson"),
        ({"young": 1.0, "poisson": (0.9, 0.9, 0.9), "shear": 1.0}, "poisson"),
        ({"young": (1, 2), "poisson": 0.3}, "young"),
    ],
)
def test_wrong_moduli(options, told):
    with pytest.raises(InputError, match=told):
        orthotropic(**options)


@pytest.mark.parametrize(
    ("at", "matrices", "told"),
    [
        ([0.0], [np.eye(6)], "two increasing"),
        ([1.0, 0.0], [np.eye(6)] * 2, "two increasing"),
        ([0.0, 1.0], [np.eye(6)] * 3, "one matrix per value"),
        ([0.0, 1.0], [np.eye(6), -np.eye(6)], "positive definite"),
    ],
)
def test_wrong_tables(at, matrices, told):
    with pytest.raises(InputError, match=told):
        Graded("rho", at, matrices)
