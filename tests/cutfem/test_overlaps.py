"""Supports that hold the same twice, and loads and springs on what is held."""

import numpy as np
import pytest

from ilattice.cutfem import Elasticity, Heat

BOX = [[0.0] * 3, [3.0, 1.0, 0.8]]
STIFFNESS = np.diag([0.8, 0.8, 0.8, 0.4, 0.4, 0.4])
STIFFNESS[:3, :3] += 0.6
pytestmark = pytest.mark.filterwarnings(
    "ignore:.*energy:ilattice.errors.PrecisionWarning",
    "ignore:.*its area:ilattice.errors.PrecisionWarning",
)


def full(u):
    return np.full(len(u), -1.0)


def bar(degree, **material):
    material = material or {"young": 1.0, "poisson": 0.3}
    return Elasticity(full, (4, 3, 2), domain=BOX, degree=degree, **material)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize(
    "material",
    [{"young": 1.0, "poisson": 0.3}, {"young": 1.0, "poisson": 0.48}, {"stiffness": STIFFNESS}],
)
def test_supports_that_overlap_hold_once(degree, material):
    """They held twice: stresses of a bar in tension were off by a tenth, and more."""
    problem = bar(degree, **material)
    for axis, place in zip("xyz", ("x < 0.001", "y < 0.001", "z < 0.001"), strict=True):
        problem = problem.clamp(place, components=axis)
    problem = problem.load(traction=(1.0, 0.0, 0.0), on="u=1")
    expected = problem.solve(tol=1e-12)
    u = np.random.default_rng(degree).random((50, 3)) * BOX[1]
    np.testing.assert_allclose(expected.stress(u)[:, 0], 1.0, atol=1e-6)
    again = problem.clamp("u=0", components="x", where=lambda x: x[:, 1] < 0.4)
    again = again.clamp("u=0", components="n", method="nitsche").clamp("y < 0.001", components="n")
    again = again.clamp(lambda x: x[:, 0] < 0.001, components="x", value=0.0)
    solved = again.solve(tol=1e-12)
    np.testing.assert_allclose(solved.evaluate(u), expected.evaluate(u), atol=1e-6)
    np.testing.assert_allclose(solved.stress(u), expected.stress(u), atol=1e-5)
    np.testing.assert_allclose(sum(solved.reactions.values()), [-0.8, 0.0, 0.0], atol=1e-6)
    assert solved.equilibrium < 1e-9


@pytest.mark.parametrize("degree", [1, 2])
def test_temperatures_that_overlap_are_fixed_once(degree):
    heat = Heat(full, (4, 3, 2), domain=BOX, degree=degree, conductivity=2.0)
    heat = heat.fix("x < 0.001", 1.0).fix("x > 2.999", 2.5)
    for place in ("x < 0.001", lambda x: (x[:, 0] < 0.001) & (x[:, 1] < 0.6)):
        heat = heat.fix(place, 1.0)
    heat = heat.flux("x < 0.001", 7.0).convection("x > 2.999", 5.0, around=9.0)
    solved = heat.solve(tol=1e-12)
    u = np.random.default_rng(degree).random((50, 3)) * BOX[1]
    np.testing.assert_allclose(solved.evaluate(u).ravel(), 1.0 + 0.5 * u[:, 0], atol=1e-8)
    np.testing.assert_allclose(
        solved.inflow["x < 0.001"], -0.8 * (1.0 + 7.0), rtol=1e-6
    )  # what flows through the bar, and what is brought to its end


@pytest.mark.parametrize("act", [
    lambda p, on: p.load(pressure=0.5, on=on),
    lambda p, on: p.load(traction=lambda x: 0.1 + x, on=on),
    lambda p, on: p.load(force=(0.1, 0.2, -0.3), on=on),
    lambda p, on: p.spring(on, 1e3, value=0.1),
])  # fmt: skip
def test_loads_and_springs_on_what_is_held_go_into_the_support(act):
    """They moved it: a spring against a clamped place by more than half of its own way."""
    for degree in (1, 2):
        held = bar(degree).clamp("x < 0.001")
        solved = act(held, "x < 0.001").load(traction=(0.0, 0.02, 0.0), on="u=1").solve(tol=1e-12)
        plain = held.load(traction=(0.0, 0.02, 0.0), on="u=1").solve(tol=1e-12)
        u = np.random.default_rng(degree).random((50, 3)) * BOX[1]
        np.testing.assert_allclose(solved.evaluate(u), plain.evaluate(u), atol=1e-8)
        loads = solved.problem.forces().sum(axis=0)
        np.testing.assert_allclose(sum(solved.reactions.values()), -loads, atol=1e-8)
        assert solved.equilibrium < 1e-9
