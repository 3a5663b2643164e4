"""Vibrations and buckling of solids with rigid connections, by rods, posts and full matrices."""

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq

import ilattice as il
from ilattice.cutfem import Elasticity, buckling, natural_modes
from ilattice.errors import InputError

pytestmark = pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")

LENGTH, SHEAR, MASS = 2.93, 40.0, 1.7
SPEED = np.sqrt(SHEAR / MASS)
AXIS = np.array([0.013, -0.021, 0.0])
HEIGHT = 10.0
ROD = il.fields.translate(il.fields.cylinder(0.5), AXIS)


@pytest.fixture(scope="module")
def rod():
    """A round rod along z, between planes of the grid, held by nothing."""
    grid = il.cutfem.cut(ROD, (6, 6, 6), domain=[[-0.57, -0.59, 0], [0.6, 0.55, LENGTH]])
    return Elasticity(grid, young=2.6 * SHEAR, poisson=0.3, density=MASS)


def column(**options):
    """A square column of 10 x 1 x 1 that fills its box."""
    box = [[0.0] * 3, [1.0, 1.0, HEIGHT]]
    fills = lambda u: np.abs(u[:, 0] - 0.5) - 0.7  # noqa: E731
    return Elasticity(fills, (2, 2, 10), domain=box, poisson=0.0, **options).clamp("w=0")


@pytest.mark.parametrize("on", ["w=1", "z > 2.9299999"])
def test_rods_with_rigid_ends_turn_as_without(rod, on):
    """Torsion leaves round ends as they are: a quarter of a wave of a held rod, half of a free."""
    held = natural_modes(rod.clamp("w=0").rigid(on), 4)
    assert held.omega[2] == pytest.approx(np.pi / 2 / LENGTH * SPEED, rel=1e-4)
    (turn,) = held.motions[2]
    along = held.vectors[2] @ [0, 0, 1.0]
    assert np.abs(along).max() < 1e-2 * np.abs(held.vectors[2]).max()
    amplitude = 2 / np.sqrt(MASS * LENGTH * np.pi * 0.5**4)  # of unit mass
    assert abs(turn.rotation[2]) == pytest.approx(amplitude, rel=1e-3)
    np.testing.assert_allclose(turn.rotation[:2], 0.0, atol=1e-3 * amplitude)
    bent = natural_modes(rod.clamp("w=0"), 2).omega
    np.testing.assert_allclose(held.omega[:2], bent, rtol=1e-3)
    assert (held.omega[:2] > bent).all()
    free = natural_modes(rod.rigid(on), 9)
    assert np.abs(free.omega[:6]).max() < 1e-4
    assert free.report.shift > 0
    torsion = np.pi / LENGTH * SPEED
    assert np.abs(free.omega[6:] / torsion - 1).min() < 1e-3


def test_modes_are_those_of_the_full_matrices():
    """Motions as unknowns beside the nodes, nothing condensed, by LAPACK."""
    grid = il.cutfem.cut(ROD, 4, domain=[[-0.57, -0.59, 0], [0.6, 0.55, 1.1]])
    body = Elasticity(grid, young=2.6 * SHEAR, density=MASS).spring("w=0", 30.0)
    found = natural_modes(body.rigid("w=1"), 7)
    base = found.problem
    fixed = base.constraints.fixed.any(axis=1)
    x = base.assembly.coordinates[fixed] - base.connections[0].about
    free = np.flatnonzero(~fixed)
    count = 3 * len(fixed)
    T = np.zeros((count, 3 * len(free) + 6))
    for i, node in enumerate(free):
        T[3 * node : 3 * node + 3, 3 * i : 3 * i + 3] = np.eye(3)
    rows = (3 * np.flatnonzero(fixed)[:, None] + np.arange(3)).ravel()
    for k in range(3):
        T[rows, -6 + k] = np.tile(np.eye(3)[k], len(x))
        T[rows, -3 + k] = np.cross(np.eye(3)[k], x).ravel()
    K, M = T.T @ (base.matrix @ T), T.T @ (base._mass() @ T)
    known = np.sqrt(eigh(K, M, eigvals_only=True, subset_by_index=(0, 6)))
    np.testing.assert_allclose(found.omega, known, rtol=1e-7)
    flat = found.vectors.reshape(7, -1)
    np.testing.assert_allclose(flat @ (base._mass() @ flat.T), np.eye(7), atol=1e-7)


def test_two_rods_that_a_rigid_place_joins_turn_as_one():
    """A gap between them takes no part in torsion; the outer rod hangs on the inner one."""
    gap = 0.31
    parts = [(-0.4, 1.31), (1.31 + gap, 1.31 + gap + 1.62)]
    rods = il.fields.intersection(
        il.fields.translate(il.fields.cylinder(0.5), AXIS),
        il.fields.union(*(
            il.fields.translate(il.fields.box((2.0, 2.0, (b - a) / 2)), (0, 0, (a + b) / 2))
            for a, b in parts
        )),
    )  # fmt: skip
    domain = [[-0.57, -0.59, 0], [0.6, 0.55, parts[1][1] + 0.2]]
    problem = Elasticity(rods, (5, 5, 10), domain=domain, young=2.6 * SHEAR, density=MASS)
    box = [[-1, -1, parts[0][1] - 0.01], [1, 1, parts[1][0] + 0.01]]
    modes = natural_modes(problem.clamp("w=0").rigid(box), 6)
    whole = np.pi / 2 / (1.31 + 1.62) * SPEED
    assert np.abs(modes.omega / whole - 1).min() < 3e-3


@pytest.mark.parametrize("on", ["w=1", "z > 9.9999"])
@pytest.mark.parametrize("arm", [0.0, 3.0, -2.0])
def test_posts_on_columns_buckle_as_euler_has_it(on, arm):
    """The force acts on a rigid post: 1 = a k tan(k L); shear makes it less, by Engesser.

    Without the work of the forces on turns of second order the arm would not matter.
    """
    loaded = column().rigid(on, force=(0, 0, -1e-3), about=(0.5, 0.5, HEIGHT + arm)).solve()
    found = buckling(loaded, 2)
    gap = lambda k: np.cos(k * HEIGHT) - arm * k * np.sin(k * HEIGHT)  # noqa: E731
    k = brentq(gap, 0.02, 0.2 if arm < 0 else np.pi / 20 + 1e-9)
    euler = k * k / 12
    np.testing.assert_allclose(1e-3 * found.factors, euler / (1 + euler / (0.5 * 5 / 6)), rtol=7e-3)
    (motion,) = found.motions[0]
    aside = np.linalg.norm(motion.translation[:2])
    turn = np.linalg.norm(motion.rotation)
    above = 1 - np.cos(k * HEIGHT) + arm * k * np.sin(k * HEIGHT)  # of the force, amplitude one
    assert turn / aside == pytest.approx(k * np.sin(k * HEIGHT) / above, rel=0.03)


def test_multigrid_finds_the_same_with_connections():
    problem = column().rigid("w=1", force=(0, 0, -1e-3), about=(0.5, 0.4, HEIGHT + 1))
    for find in (lambda m: natural_modes(problem, 4, method=m).omega,
                 lambda m: buckling(problem.solve(), 2, method=m).factors):  # fmt: skip
        np.testing.assert_allclose(find("multigrid"), find("superlu"), rtol=1e-6)


def test_problems_of_solutions_are_solved_again():
    """With more loads, and with another support, which comes after those of connections."""
    problem = column().rigid("w=1", force=(0, 0, -1e-3))
    load = {"force": (1e-4, 0, 0), "on": "u=1"}
    whole = problem.load(**load).solve()
    again = problem.solve().problem.load(**load).solve()
    np.testing.assert_allclose(again.coefficients, whole.coefficients, rtol=1e-9, atol=1e-12)
    held = [
        p.clamp("z < 1.001 and y < 1e-6", components="y")
        for p in (problem, problem.solve().problem)
    ]
    a, b = (p.load(**load).solve() for p in held)
    np.testing.assert_allclose(a.coefficients, b.coefficients, rtol=1e-9, atol=1e-12)
    assert len(a.motions) == len(b.motions) == 1
    np.testing.assert_allclose(natural_modes(whole.problem, 3).omega,
                               natural_modes(problem, 3).omega, rtol=1e-9)  # fmt: skip


def test_matrices_on_nodes_are_refused():
    problem = column().rigid("w=1")
    for ask in (lambda: problem.system, problem.mass):
        with pytest.raises(InputError, match="motions of its own"):
            ask()


def test_stages_are_told():
    seen = []
    told = lambda label, *_: seen.append(label)  # noqa: E731
    solved = column().rigid("w=1", force=(0, 0, -1.0)).solve()
    buckling(solved, 1, progress=told)
    assert seen == ["stress", "factor", "modes"]
