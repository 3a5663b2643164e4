"""Supports along normals that are no axes: planes of symmetry at an angle, frictionless guides."""

import numpy as np
import pytest

import ilattice as il
from ilattice.bspline import BSpline
from ilattice.cutfem import Elasticity
from ilattice.errors import InputError, PrecisionWarning
from ilattice.macroshape import SplineMap

pytestmark = pytest.mark.filterwarnings("ignore:.*energy:ilattice.errors.PrecisionWarning")

CUBE = [[0.0] * 3, [1.0] * 3]
FACES = ("u=0", "v=0", "w=0")


def placed(through, seed):
    """The map turned, moved and scaled at random, and the rotation."""
    rng = np.random.default_rng(seed)
    q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    q *= np.linalg.det(q)
    s = through.spline
    c = 10.0 ** rng.uniform(-2, 2) * s.c @ q.T + rng.normal(size=3)
    return SplineMap(BSpline(s.t, c, s.k, weights=s.weights, periodic=s.periodic)), q


def everywhere(u):
    return np.full(len(u), -1.0)


def guided(problem, places=FACES, **options):
    for place in places:
        problem = problem.clamp(place, components="n", **options)
    return problem


@pytest.mark.parametrize(
    ("degree", "poisson", "full"),
    [(1, 0.3, False), (2, 0.3, False), (2, 0.48, False), (2, 0.3, True)],
)
def test_a_turned_bar_between_planes_of_symmetry_is_in_plain_tension(degree, poisson, full):
    through, q = placed(il.macroshape.box((3.0, 1.0, 0.8)), 10 * degree + full)
    lam, mu = poisson / (1 + poisson) / (1 - 2 * poisson), 0.5 / (1 + poisson)
    C = np.diag([2 * mu] * 3 + [mu] * 3)
    C[:3, :3] += lam
    material = {"stiffness": 70.0 * C} if full else {"young": 70.0, "poisson": poisson}
    problem = Elasticity(
        everywhere, (4, 3, 2), domain=CUBE, through=through, degree=degree, **material
    )
    shift = np.array([0.02, -0.01, 0.03])
    solution = guided(problem, value=shift).load(traction=7.0 * q[:, 0], on="u=1").solve(tol=1e-12)
    u = np.random.default_rng(degree).random((40, 3))
    stress = solution.stress(u)[:, [[0, 5, 4], [5, 1, 3], [4, 3, 2]]]
    expected = 7.0 * np.outer(q[:, 0], q[:, 0])
    np.testing.assert_allclose(stress, np.broadcast_to(expected, stress.shape), atol=1e-6)
    strain = 0.1 * ((1 + poisson) * np.outer(q[:, 0], q[:, 0]) - poisson * np.eye(3))
    x = through.x(u) - through.x([[0.0, 0.0, 0.0]])
    np.testing.assert_allclose(
        solution.evaluate(u), shift + x @ strain, atol=1e-7 * np.abs(x).max() + 1e-9
    )
    area = problem.domain.boundary("u=1").weights.sum()
    np.testing.assert_allclose(
        sum(solution.reactions.values()), -7.0 * area * q[:, 0], atol=1e-6 * area
    )


@pytest.mark.parametrize("poisson", [0.3, 0.48])
def test_a_tube_in_a_frictionless_sleeve(poisson):
    """Lamé: no displacement of the outer surface along its normal, any along the surface."""
    through, q = placed(il.macroshape.cylinder_shell(1.0, 2.0, 0.5, angle=1.1), 5)
    size = np.abs(np.linalg.det(through.jacobian([[0.5] * 3])[0]))
    size = (size / np.abs(np.linalg.det(
        il.macroshape.cylinder_shell(1.0, 2.0, 0.5, angle=1.1).jacobian([[0.5] * 3])[0]
    ))) ** (1 / 3)  # fmt: skip
    lam, mu = poisson / (1 + poisson) / (1 - 2 * poisson), 0.5 / (1 + poisson)
    a = -1.0 / (2 * (lam + mu) + 2 * mu * 4.0)  # u = a r - 4 a / r, for a pressure of one
    errors = []
    for n in (3, 6):
        problem = Elasticity(
            everywhere, (n, 2, n), domain=CUBE, through=through, degree=2, young=1.0,
            poisson=poisson,
        )  # fmt: skip
        held = guided(problem, ("u=0", "u=1", "v=0", "v=1", "w=1"))
        solution = held.load(pressure=1.0, on="w=0").solve(tol=1e-12)
        u = np.random.default_rng(n).random((200, 3))
        plain = il.macroshape.cylinder_shell(1.0, 2.0, 0.5, angle=1.1).x(u)
        r = np.hypot(plain[:, 0], plain[:, 1])
        out = plain * [1.0, 1.0, 0.0] / r[:, None]
        expected = size * (a * r - 4 * a / r)[:, None] * out @ q.T
        errors.append(np.abs(solution.evaluate(u) - expected).max() / np.abs(expected).max())
    assert errors[1] < 4e-3
    assert errors[1] < errors[0] / 5


def test_what_guides_leave_free_is_told():
    tube = placed(il.macroshape.cylinder_shell(1.0, 2.0, 0.5), 2)[0]
    problem = Elasticity(everywhere, (8, 1, 2), domain=tube.domain, through=tube)
    held = guided(problem, ("v=0", "w=1")).load(pressure=1.0, on="w=0")
    with pytest.raises(InputError, match="1 of 6 rigid-body modes"):
        held.solve()
    with pytest.raises(InputError, match="cannot be held exactly"):
        problem.clamp("w=1", components="n", method="strong")
    with pytest.raises(InputError, match="give a vector"):
        problem.clamp("w=1", components="n", value=0.1)


@pytest.mark.parametrize("seed", [3, 8])
def test_guides_that_overlap_contradict_along_the_normal_only(seed):
    """Values along the surface, which guides leave free, and rounded zeros were refused."""
    through, q = placed(il.macroshape.box((3.0, 1.0, 0.8)), seed)
    n, along = q[:, 0], q[:, 1] - 0.7 * q[:, 2]
    problem = Elasticity(everywhere, (3, 2, 2), domain=CUBE, through=through, degree=1)
    held = guided(problem).load(traction=n, on="u=1")
    half = lambda x: (x - through.x([[0.0, 0.5, 0.0]])) @ q[:, 1] < 0.0  # noqa: E731
    part = {"components": "n", "where": half}
    u = np.random.default_rng(seed).random((20, 3))
    expected = held.solve(tol=1e-12).evaluate(u)
    twice = held.clamp("u=0", value=0.3 * along, **part).solve(tol=1e-12)
    np.testing.assert_allclose(twice.evaluate(u), expected, atol=1e-6 * np.abs(expected).max())
    with pytest.raises(InputError, match="contradict each other"):
        held.clamp("u=0", value=0.3 * along + 1e-3 * n, **part).solve()
    held.clamp("u=0", components="x", value=0.1, where=half).solve()
    with pytest.raises(InputError, match="contradict each other"):
        held.clamp("u=0", value=1e-3 * n, where=half).solve()


def test_strips_beside_a_plane_are_told():
    """They are held along their own normals: planes picked by a tolerance stiffen the body."""
    through, q = placed(il.macroshape.box((3.0, 1.0, 0.8)), 4)
    problem = Elasticity(everywhere, (16, 6, 5), domain=CUBE, through=through, degree=1)
    size = np.linalg.norm(through.x([[1.0, 0.0, 0.0]]) - through.x([[0.0, 0.0, 0.0]]))

    def near(x, width):
        return (x - through.x([[0.0, 0.0, 0.0]])) @ q[:, 0] < width * size

    problem.clamp(lambda x: near(x, 1e-9), components="n")
    with (
        pytest.warns(PrecisionWarning, match="its area"),
        pytest.warns(PrecisionWarning, match="not in the plane of the rest"),
    ):
        problem.clamp(lambda x: near(x, 0.02), components="n")
