"""Heat conduction against exact solutions, balances and rates."""

import manufactured as known
import numpy as np
import pytest

import ilattice as il
from ilattice.cutfem import Elasticity, Heat
from ilattice.errors import InputError, PrecisionWarning

CUBE = [[0.0] * 3, [1.0] * 3]
SHELL = (lambda u: (u**2).sum(axis=1) - 4, lambda u: 1 - (u**2).sum(axis=1))


def full(u):
    return -np.ones(len(u))


def ball(u):
    return (u**2).sum(axis=1) - 0.8123**2


def test_the_hollow_sphere():
    problem = Heat(SHELL, 8, domain=[[0.0] * 3, [2.1] * 3])
    solution = problem.fix("inner", 1.0).fix("outer", 0.0).solve()
    u = np.array([[1, 1, 1], [1, 0.2, 0.5], [0.3, 0.4, 1]])
    u = 1.5 * u / np.linalg.norm(u, axis=1)[:, None]
    np.testing.assert_allclose(solution.evaluate(u), 1 / 3, rtol=2e-3)
    np.testing.assert_allclose(
        np.einsum("ni,ni->n", solution.heat_flux(u), u / 1.5), 2 / 1.5**2, rtol=1e-2
    )
    assert 8 * solution.inflow["inner"] == pytest.approx(25.132741, rel=1e-3)
    assert sum(solution.inflow.values()) == pytest.approx(0, abs=1e-8)


@pytest.mark.filterwarnings("ignore:the cells are too coarse")
@pytest.mark.parametrize(
    ("p", "r", "cells", "caps"),
    [
        (1, 0, (6, 8, 12), (1.5e-3, 0.09)),
        (2, 1, (4, 6, 8), (2.5e-4, 6.5e-3)),
        (2, 0, (4, 6, 8), (2.5e-4, 6.5e-3)),
        (3, 2, (4, 6, 8), (7e-6, 1.6e-4)),
    ],
)
def test_errors_fall_at_the_order_of_the_space(p, r, cells, caps):
    errors = []
    for n in cells:
        problem = Heat(ball, n, domain=[[-1.0] * 3, [1.0] * 3], degree=p, smoothness=r)
        problem = problem.fix("surface", known.temperature).source(known.source)
        solution = problem.solve(tol=1e-11)
        errors.append(known.errors_of(solution, known.temperature, known.slope_of_temperature))
    rates = -np.polyfit(np.log(cells), np.log(errors), 1)[0]
    assert (rates > np.array([p + 1, p]) - 0.15).all()
    assert (errors[-1] < caps).all()


def test_linear_temperatures_are_exact_through_a_map():
    through = il.macroshape.box((2.0, 1.0, 0.5))
    line = lambda x: 0.01 * (1 + 2 * x[:, 0] - x[:, 1])  # noqa: E731
    for p in (1, 2):
        sphere = lambda u: ((u - 0.5) ** 2).sum(axis=1) - 0.16  # noqa: E731
        problem = Heat(sphere, 5, domain=CUBE, degree=p, q=8, through=through, conductivity=3.0)
        solution = problem.fix("surface", line).solve(tol=1e-13)
        rule = problem.domain.volume
        error = solution.evaluate(rule.points) - line(through.x(rule.points))
        assert np.sqrt(rule.weights @ error**2) < 1e-9
        np.testing.assert_allclose(solution.heat_flux([[0.5] * 3]), [[-0.06, 0.03, 0]], atol=1e-8)


def test_what_enters_leaves():
    problem = Heat(ball, 6, domain=[[-1.0, -1, -1], [1, 1, 0]], conductivity=lambda x: 2 + x[:, 0])
    problem = problem.fix("w=1", 5.0).convection("surface", 0.7, around=1.0)
    solution = problem.source(0.3).flux("surface", lambda x: x[:, 2]).solve(tol=1e-11)
    skin = problem.domain.boundary("surface")
    into = 0.3 * problem.domain.volume.integrate() + skin.integrate(lambda x: x[:, 2])
    assert set(solution.inflow) == {"w=1", "surface"}
    assert sum(solution.inflow.values()) == pytest.approx(-into, abs=1e-9)


@pytest.mark.filterwarnings("ignore:the cells are too coarse")
@pytest.mark.parametrize(("theta", "order"), [(1.0, 1), (0.5, 2)])
def test_a_mode_decays_at_its_rate(theta, order):
    wave = lambda x: np.cos(np.pi * x[:, 2])  # noqa: E731
    problem = Heat(full, (1, 1, 8), domain=CUBE, degree=3, conductivity=0.5, capacity=2.0)
    u = np.array([[0.5, 0.5, 0.0]])
    decay = np.exp(-0.25 * np.pi**2 * 1.0)
    errors = []
    for steps in (10, 20, 40):
        last = problem.evolve(1.0, steps=steps, initial=wave, theta=theta)[-1]
        errors.append(abs(last.evaluate(u)[0] - decay))
    assert -np.polyfit(np.log([10, 20, 40]), np.log(errors), 1)[0] == pytest.approx(order, abs=0.15)
    assert errors[-1] < 0.1 * decay


@pytest.mark.filterwarnings("ignore:the cells are too coarse")
@pytest.mark.parametrize("theta", [1.0, 0.5])
def test_what_enters_in_a_step_is_stored(theta):
    """Through a fixed end, weakly held and convective ones, with a source and a flux."""
    box = [[-1.0, -1, -1], [1, 1, 0]]
    problem = Heat(ball, 5, domain=box, conductivity=lambda x: 2 + x[:, 0], capacity=3.0)
    problem = problem.fix("w=1", lambda x: 5 + x[:, 1]).convection("surface", 0.7, around=1.0)
    problem = problem.source(0.3).flux("surface", lambda x: x[:, 2])
    into = 0.3 * problem.domain.volume.integrate()
    into += problem.domain.boundary("surface").integrate(lambda x: x[:, 2])
    weak = problem.fix("surface", 2.0)
    for which, places in ((problem, {"w=1", "surface"}), (weak, {"w=1", "surface"})):
        told = []
        history = which.evolve(0.2, steps=3, initial=1.5, theta=theta, tol=1e-12,
                               progress=lambda *a, told=told: told.append(a))  # fmt: skip
        assert told == [("evolve", k, 3) for k in (1, 2, 3)]
        np.testing.assert_allclose(history.times, np.linspace(0, 0.2, 4))
        start, *steps = history
        before = start.stored
        for step in steps:
            assert set(step.inflow) == places
            change = (step.stored - before) / (0.2 / 3)
            assert sum(step.inflow.values()) + into == pytest.approx(change, rel=1e-8)
            before = step.stored
        with pytest.raises(InputError, match="no step"):
            start.inflow  # noqa: B018


def test_heat_is_stored():
    problem = Heat(ball, 5, domain=[[-1.0] * 3, [1.0] * 3], capacity=3.0).source(2.0)
    history = problem.evolve(0.5, steps=4, initial=1.0)
    volume = problem.domain.volume.integrate()
    stored = [h.stored for h in history]
    np.testing.assert_allclose(stored, volume * (3 + 2.0 * np.linspace(0, 0.5, 5)), rtol=1e-7)
    held = problem.fix("surface", 1.0)
    late = held.evolve(1e4, steps=3, initial=1.0)[-1]
    steady = held.solve()
    u = problem.domain.volume.points[::40]
    np.testing.assert_allclose(late.evaluate(u), steady.evaluate(u), rtol=1e-3)


def test_temperatures_load_elastic_solids():
    heat = Heat(full, 2, domain=CUBE).fix("w=0", 0.0).fix("w=1", 10.0)
    solid = Elasticity(full, 2, domain=CUBE, expansion=1e-2, poisson=0.0)
    solid = solid.clamp("w=0", components="z").clamp("u=0", components="x")
    solid = (
        solid.clamp("v=0", components="y").clamp("w=1", components="z").clamp("u=1", components="x")
    )
    solution = solid.clamp("v=1", components="y").load(temperature=heat.solve()).solve()
    u = np.array([[0.3, 0.4, 0.25], [0.9, 0.1, 0.5]])
    np.testing.assert_allclose(solution.stress(u)[:, 0], [-0.025, -0.05], atol=1e-9)


@pytest.mark.filterwarnings("ignore:the cells are too coarse")
def test_temperatures_are_written(tmp_path):
    import pyvista as pv

    lattice = il.Lattice("schwarz_p", through=il.macroshape.box((2.0, 1.0, 1.0)), spans_per_tile=6)
    problem = Heat(lattice.offset(0.2), 6).fix("u=0", 0.0).fix("u=1", 1.0)
    solution = problem.solve()
    for on in ("surface", "cells"):
        solution.save(tmp_path / f"{on}.vtu", on=on, h=0.15)
        data = pv.read(tmp_path / f"{on}.vtu")
        u = np.array(data.points) / [2.0, 1.0, 1.0]
        np.testing.assert_allclose(data["temperature"], solution.evaluate(u), atol=1e-9)
        np.testing.assert_allclose(data["heat_flux"], solution.heat_flux(u), atol=1e-8)
    np.testing.assert_allclose(solution.surface(0.15).point_data["temperature"].min(), 0, atol=1e-6)


def test_bad_heat_problems_are_refused():
    problem = Heat(full, 2, domain=CUBE)
    for call, message in (
        (lambda: Heat(full, 2, domain=CUBE, conductivity=0.0), "conductivity"),
        (lambda: Heat(full, 2, domain=CUBE, capacity=-1.0), "capacity"),
        (lambda: problem.solve(), "nothing fixes"),
        (lambda: problem.convection("w=0", -1.0, around=0.0), "transfer"),
        (lambda: problem.convection("w=0", lambda x: x[:, 0] - 1, around=0).solve(), "transfer"),
        (lambda: problem.fix("w=0", (1, 2)), "value"),
        (lambda: problem.evolve(0.0, steps=3), "duration"),
        (lambda: problem.evolve(1.0, steps=0), "steps"),
        (lambda: problem.evolve(1.0, steps=2.5), "steps"),
        (lambda: problem.evolve(1.0, steps=2, theta=0.2), "theta"),
    ):
        with pytest.raises(InputError, match=message):
            call()


def test_the_cells_of_a_transient_are_judged_at_its_first_and_last_step():
    rod = il.cutfem.Heat(lambda u: -np.ones(len(u)), (3, 3, 6), domain=[[0] * 3, [1, 1, 3]])
    with pytest.warns(PrecisionWarning, match="by it, at one time or more is off by"):
        history = rod.fix("w=0", 1.0).fix("w=1", 0.0).evolve(0.04, steps=4)
    errors = [s.report.discretization_error for s in history[1:]]
    assert errors[0] > errors[-1] > 1e-3  # the front is a fifth of a cell wide at first
    assert np.isnan(errors[1:-1]).all()
    slow = rod.fix("w=0", 1.0).fix("w=1", 0.0).evolve(400.0, steps=4)
    assert slow[-1].report.discretization_error < 1e-8  # linear
