"""Results at points of space, and outside of the solid, where there are none."""

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import InputError

#: Numbers on coarse grids are what is tested here.
pytestmark = pytest.mark.filterwarnings("ignore:the cells are too coarse")

BOX = [[-0.3, 0.1, -0.2], [0.7, 1.3, 1.9]]
A = np.array([[0.02, -0.01, 0.005], [0.003, -0.04, 0.01], [0.0, 0.02, 0.03]])


def affine(x):
    return x @ A.T + [0.1, -0.2, 0.3]


@pytest.fixture(scope="module")
def block():
    """A tilted slab in a box that moves affinely."""
    n = np.array([0.3, -0.2, 1.0])
    problem = il.cutfem.Elasticity(
        lambda u: u @ n / np.linalg.norm(n) - 1.1, (3, 4, 5), domain=BOX, young=3.0, poisson=0.2
    )
    for place in ("u=0", "u=1", "v=0", "v=1", "w=0"):
        problem = problem.clamp(place, value=affine)
    lam, mu = 3.0 * 0.2 / 1.2 / 0.6, 3.0 / 2.4
    e = 0.5 * (A + A.T)
    stress = 2 * mu * e + lam * np.trace(e) * np.eye(3)
    traction = stress @ n / np.linalg.norm(n)
    return problem.load(traction=traction, on="surface").solve(tol=1e-12), stress


def outside(rng, count=300):
    """Points one cell of the box and more away from it, on all sides."""
    lo, hi = np.array(BOX)
    width = (hi - lo) / (3, 4, 5)
    p = lo + (hi - lo) * rng.uniform(-9, 10, (count, 3))
    return p[((p < lo - 1.01 * width) | (p > hi + 1.01 * width)).any(axis=1)]


def test_nothing_is_known_outside_of_the_grid(block):
    solution, _ = block
    p = outside(np.random.default_rng(3))
    assert len(p) > 200
    for values in (solution.evaluate(p), solution.stress(p), solution.principal(p)):
        assert np.isnan(values).all()


def test_points_of_space(block):
    solution, stress = block
    rng = np.random.default_rng(4)
    x = np.array(BOX[0]) + rng.random((200, 3)) * [1.0, 1.2, 0.9]
    found = solution.at(x)
    np.testing.assert_allclose(found.displacement, affine(x), atol=1e-9)
    np.testing.assert_allclose(
        found.stress, np.tile(stress[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]], (200, 1)), atol=1e-8
    )
    assert found.principal.shape == (200, 3)
    np.testing.assert_array_equal(found.x, x)
    np.testing.assert_array_equal(found.u, x)
    with pytest.raises(AttributeError, match="there are displacement"):
        _ = found.temperature


def test_points_outside_are_refused_or_left_out(block):
    solution, _ = block
    x = np.array([[0.0, 0.5, 0.1], [0.0, 0.5, 1.8], [0.0, 0.5, 9.0]])  # in, above the slab, far
    with pytest.raises(InputError, match=r"2 of 3 points .*0.0, 0.5, 1.8"):
        solution.at(x)
    found = solution.at(x, outside="nan")
    assert found.inside.tolist() == [True, False, False]
    assert np.isfinite(found.stress).all(axis=1).tolist() == [True, False, False]
    with pytest.raises(InputError, match="outside"):
        solution.at(x, outside="guess")
    with pytest.raises(InputError, match="x must be"):
        solution.at([1.0, 2.0])


def test_through_a_map_points_are_those_of_space():
    torus = il.macroshape.torus(major=4.0, width=2.0)
    wall = il.Lattice("primitive", through=torus, repeat=(8, 1, 1)).offset(0.25)
    heat = il.cutfem.Heat(wall, (40, 6, 6), degree=1)
    solution = heat.fix("v=0", lambda x: 3.0 + x @ [1.0, 2.0, -1.0]).solve()
    rng = np.random.default_rng(5)
    u = rng.random((4000, 3))
    u = u[wall.field(u) < -0.02]
    x = torus.x(u)
    found = solution.at(x)
    np.testing.assert_allclose(found.temperature, solution.evaluate(u), rtol=1e-6)
    np.testing.assert_allclose(torus.x(found.u), x, atol=1e-8)
    with pytest.raises(InputError, match="outside of the solid"):
        solution.at(u + 20.0)
    mesh = wall.mesh(0.15)
    assert solution.at(mesh.vertices, outside="nan").inside.mean() > 0.99
