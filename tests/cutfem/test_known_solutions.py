"""Elasticity against solutions that are known in closed form: spheres, holes, beams."""

import numpy as np
import pytest
from manufactured import MU

import ilattice as il
from ilattice.cutfem import Elasticity

#: Numbers on coarse grids are what is tested here.
pytestmark = pytest.mark.filterwarnings("ignore:the cells are too coarse")

NU = 0.3


def full(u):
    return -np.ones(len(u))


def symmetric(problem):
    """An eighth of a solid, with its planes of symmetry at u = 0, v = 0 and w = 0."""
    for axis, place in enumerate(("u=0", "v=0", "w=0")):
        problem = problem.clamp(place, components=(axis,))
    return problem


def graded(near, far, n, m):
    """A grid of n cells up to `near`, and m wider ones beyond, in all directions."""
    axis = np.append(np.linspace(0, near, n + 1), np.linspace(near, far, m + 1)[1:])
    return il.cutfem.Grid((axis, axis, axis))


def tensors(stress):
    return stress[:, [[0, 5, 4], [5, 1, 3], [4, 3, 2]]]


def lame(n):
    """Errors of energy, displacement and stress in a sphere, radius 1 to 2, pressed from inside."""
    r2 = lambda u: (u**2).sum(axis=1)  # noqa: E731
    grid = graded(1.3, 2.1, 5 * n, 2 * n)
    problem = Elasticity((lambda u: r2(u) - 4, lambda u: 1 - r2(u)), grid)
    solution = symmetric(problem).load(pressure=1.0, on="inner").solve()
    assert solution.compliance == pytest.approx(2 * solution.energy, rel=1e-4)
    smooth = solution.recovered()
    n = np.array([[1, 1, 1], [1, 0.2, 0.5], [0.3, 0.4, 1], [1, 0, 0]])
    n = n / np.linalg.norm(n, axis=1)[:, None]
    errors = [abs(solution.energy / 0.6283185307 - 1), 0.0, 0.0]
    for r, radial, rr, tt in ((1.0, 0.8, -1, 0.714286), (1.5, 0.415873, -0.195767, 0.312169),
                              (2.0, 0.3, 0, 0.214286)):  # fmt: skip
        displacement = np.einsum("ni,ni->n", solution.evaluate(r * n), n)
        errors[1] = max(errors[1], np.abs(displacement / radial - 1).max())
        s = tensors(smooth.stress(r * n))
        along = np.einsum("nij,ni,nj->n", s, n, n)
        across = 0.5 * (np.trace(s, axis1=1, axis2=2) - along)
        errors[2] = max(errors[2], np.abs(along - rr).max(), np.abs(across - tt).max())
    return errors


def test_the_thick_sphere_under_pressure():
    coarse, fine = np.array([lame(n) for n in (1, 2)])
    assert (fine < 0.01).all()
    assert (fine < 0.5 * coarse).all()


def around_a_cavity(x):
    """Displacement under tension 1 along z around a spherical cavity of radius 1: Goodier, 1933."""
    r, rho = np.linalg.norm(x, axis=1), np.hypot(x[:, 0], x[:, 1])
    k = 1 / (8 * MU * (7 - 5 * NU))
    A, B, C = -(13 - 10 * NU) * k, k, 5 * (1 - 2 * NU) * k
    cos, sin = x[:, 2] / r, rho / r
    double = cos**2 - sin**2
    along = (
        -A / r**2 - 3 * B / r**4 + ((5 - 4 * NU) / (1 - 2 * NU) * C / r**2 - 9 * B / r**4) * double
    )
    turning = -(2 * C / r**2 + 6 * B / r**4) * 2 * sin * cos
    across = (along * sin + turning * cos) / np.where(rho > 0, rho, 1.0)
    out = np.stack([across * x[:, 0], across * x[:, 1], along * cos - turning * sin], axis=1)
    return out + x * [-NU, -NU, 1.0]


def around_a_hole(x):
    """Displacement under tension 1 along x around a round hole along z, in plane strain: Kirsch."""
    r, t = np.hypot(x[:, 0], x[:, 1]), np.arctan2(x[:, 1], x[:, 0])
    k = 3 - 4 * NU
    ux = r * (k + 1) * np.cos(t) + 2 / r * ((1 + k) * np.cos(t) + np.cos(3 * t))
    uy = r * (k - 3) * np.sin(t) + 2 / r * ((1 - k) * np.sin(t) + np.sin(3 * t))
    u = np.stack([ux - 2 / r**3 * np.cos(3 * t), uy - 2 / r**3 * np.sin(3 * t), 0 * r], axis=1)
    return u / (8 * MU)


def cavity(n):
    """Stress at the equator and at a pole."""
    grid = graded(1.25, 2.5, 2 * n, n)
    problem = symmetric(Elasticity(lambda u: 1 - (u**2).sum(axis=1), grid))
    for place in ("u=1", "v=1", "w=1"):
        problem = problem.clamp(place, value=around_a_cavity)
    stress = problem.solve().recovered().stress([[1.0, 0, 0], [0, 0, 1.0]])
    return stress[0, 2], stress[1, 0]


def hole(n):
    """Stress across the tension and along it."""
    box = [[0.0] * 3, [2.5, 2.5, 0.5]]
    problem = Elasticity(lambda u: 1 - (u[:, :2] ** 2).sum(axis=1), (n, n, 1), domain=box)
    problem = symmetric(problem).clamp("w=1", components="z")
    for place in ("u=1", "v=1"):
        problem = problem.clamp(place, value=around_a_hole, components="xy")
    stress = problem.solve().recovered().stress([[0, 1.0, 0.2], [1.0, 0, 0.2]])
    return stress[0, 0], stress[1, 1]


@pytest.mark.parametrize(
    ("solve", "exact", "cells"),
    [
        (cavity, ((27 - 15 * NU) / (14 - 10 * NU), -(3 + 15 * NU) / (14 - 10 * NU)), (3, 4)),
        (hole, (3, -1), (12, 16)),
    ],
)
def test_stress_concentrates_at_holes(solve, exact, cells):
    coarse, fine = (np.abs(np.subtract(solve(n), exact)) / max(exact) for n in cells)
    assert (fine < 0.01).all()
    assert (fine < 0.6 * coarse).all()


def beam(turned):
    """A square beam along w, straight or turned by 30 degrees about its axis, and its side.

    With no contraction across (Poisson's ratio 0) a clamped end is what the theory of beams takes
    it for, and the shear coefficient of Cowper, 10 (1 + ν) / (12 + 11 ν), is 5/6.
    """
    if not turned:
        return full, np.array([1.0, 0, 0])
    c, s = np.cos(np.pi / 6), 0.5
    x = lambda u: (c * u[:, 0] + s * u[:, 1]) ** 2 - 0.25  # noqa: E731
    y = lambda u: (c * u[:, 1] - s * u[:, 0]) ** 2 - 0.25  # noqa: E731
    return (x, y), np.array([c, s, 0.0])


@pytest.mark.parametrize("turned", [False, True])
def test_the_beam_bends_as_timoshenko_says(turned):
    sets, across = beam(turned)
    w = 0.5 if not turned else 0.75
    cells = (4, 4, 20) if not turned else (6, 6, 20)
    box = [[-w, -w, 0], [w, w, 10]]
    problem = Elasticity(sets, cells, domain=box, poisson=0.0)
    problem = problem.clamp("w=0")
    tip = problem.load(traction=across, on="w=1").solve()
    end = np.array([[0.0, 0.0, 10.0]])
    assert tip.evaluate(end)[0] @ across == pytest.approx(4000 + 10 / (5 / 12), rel=0.01)
    own = problem.load(body=across).solve()
    assert own.evaluate(end)[0] @ across == pytest.approx(15000 + 50 / (5 / 12), rel=0.01)
    np.testing.assert_allclose(own.reactions["w=0"], -10 * across, atol=1e-3)
    assert tip.problem._held is own.problem._held  # one factor for both


def test_degree_one_locks_in_bending_and_recovers():
    errors = []
    for n in (2, 4):
        problem = Elasticity(full, (n, n, 10 * n), domain=[[-0.5, -0.5, 0], [0.5, 0.5, 10]],
                             degree=1)  # fmt: skip
        solution = problem.clamp("w=0").load(traction=(1, 0, 0), on="w=1").solve()
        errors.append(1 - solution.evaluate(np.array([[0, 0, 10.0]]))[0, 0] / 4030.6)
    assert errors[0] > 0.1
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.25)
