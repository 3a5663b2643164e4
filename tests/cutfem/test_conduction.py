"""Heat in solids that conduct differently along directions: exact polynomials, axes, two phases."""

import numpy as np
import pytest

import ilattice as il
from ilattice.cutfem import Heat
from ilattice.errors import InputError

K = np.array([[3.0, 0.7, -0.4], [0.7, 2.0, 0.3], [-0.4, 0.3, 1.0]])
BOX = [[-1.0, -1, -1], [1, 1, 1]]
H = np.array([[1.0, 0.2, -0.3], [0.2, -2.0, 0.5], [-0.3, 0.5, 0.4]])  # of a quadratic temperature


def ball(u):
    return (u**2).sum(axis=1) - 0.83**2


def quadratic(x):
    return 1.0 + x @ (0.5, -1.0, 2.0) + 0.5 * np.einsum("ni,ij,nj->n", x, H, x)


def test_quadratic_temperatures_are_exact_where_they_are_held_weakly_imposed():
    problem = Heat(ball, 6, domain=BOX, conductivity=K).fix("surface", quadratic)
    solved = problem.source(-float((K * H).sum())).solve(tol=1e-12)
    x = np.random.default_rng(0).uniform(-0.45, 0.45, (50, 3))
    np.testing.assert_allclose(solved.evaluate(x), quadratic(x), atol=2e-5)
    flux = -((0.5, -1.0, 2.0) + x @ H) @ K
    np.testing.assert_allclose(solved.heat_flux(x), flux, atol=2e-3)
    volume = problem.domain.volume.weights.sum()
    assert solved.inflow["surface"] == pytest.approx(float((K * H).sum()) * volume, rel=1e-4)
    smooth = solved.recovered()
    np.testing.assert_allclose(smooth.heat_flux(x), flux, atol=2e-3)
    assert solved.error_estimate().relative < 2e-3


def test_matrices_may_vary_and_are_numbers_where_directions_are_alike():
    def varying(x):
        return K + 0.3 * x[:, :1, None] * np.eye(3)

    source = -float((K * H).sum())

    def more(x):  # what the slope of the conductivity adds
        return source - 0.3 * (x[:, 0] * np.trace(H) + 0.5 + x @ H[:, 0])

    problem = Heat(ball, 6, domain=BOX, conductivity=varying)
    solved = problem.fix("surface", quadratic).source(more).solve(tol=1e-12)
    x = np.random.default_rng(1).uniform(-0.45, 0.45, (50, 3))
    np.testing.assert_allclose(solved.evaluate(x), quadratic(x), atol=2e-5)
    both = [
        Heat(ball, 5, domain=BOX, conductivity=k).convection("surface", 2.0, around=quadratic)
        .source(1.0).solve(tol=1e-12).evaluate(x)
        for k in (2.0, 2.0 * np.eye(3))
    ]  # fmt: skip
    np.testing.assert_allclose(*both, atol=1e-9)


def test_axes_follow_the_map():
    """In a tube, what conducts along one axis of the map does so along circles in space."""
    torus = il.macroshape.torus(major=2.0, width=1.0)
    along = np.diag([5.0, 1.0, 0.5])

    def full(u):
        return -np.ones(len(u))

    problem = Heat(
        full, (8, 2, 2), domain=torus.domain, through=torus, conductivity=along, axes="map"
    )
    u = np.random.default_rng(2).uniform(0.1, 0.9, (20, 3))
    k = problem.conductivity.at(problem.assembly, u)
    J = problem.assembly.jacobians(u)
    t = J[:, :, 0] / np.linalg.norm(J[:, :, 0], axis=1, keepdims=True)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", k, t), 5.0 * t, atol=2e-3)
    np.testing.assert_allclose(np.linalg.eigvalsh(k), np.tile([0.5, 1.0, 5.0], (20, 1)), atol=1e-12)
    with pytest.raises(InputError, match="axes must be one of"):
        Heat(full, 2, domain=BOX, conductivity=along, axes="maps")
