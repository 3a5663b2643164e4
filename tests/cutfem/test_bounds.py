"""Effective stiffness of a cell with mirror planes: Hill's lemma, bounds of Voigt and Hashin.

In a cell between mirror planes the periodic motions are those with normal displacements
prescribed on its faces where they stretch it, tangential ones where they shear it. With the
stiffness on the void that the paper prescribes, a wall can be stiffer than any solid of its weight.
"""

from functools import cache

import numpy as np
import pytest

import ilattice as il
from ilattice.cutfem import Elasticity

#: Numbers on coarse grids are what is tested here.
pytestmark = pytest.mark.filterwarnings("ignore:the cells are too coarse")

BULK, SHEAR = 1 / (3 * (1 - 2 * 0.3)), 1 / 2.6
STRETCHING, SHEARING = np.diag([1.0, 0.0, 0.0]), np.array([[0, 0.5, 0], [0.5, 0, 0], [0, 0, 0]])


@cache
def cell(half):
    """An eighth of a cell of Schwarz' primitive surface with a wall of `half` field units."""
    p = il.tiles["schwarz_p"]
    sides = (lambda u: p(u) - half, lambda u: -p(u) - half)
    return il.cutfem.cut(sides, 8, domain=[[0.0] * 3, [0.5] * 3])


def deformed(half, strain, **options):
    """Solution for a mean strain, and the rule of the solid."""
    problem = Elasticity(cell(half), **options)
    for axis, name in enumerate("uvw"):
        sheared = strain[axis].any() and not strain[axis, axis]
        fixed = [c for c in range(3) if (c == axis) != sheared]
        for side in "01":
            problem = problem.clamp(
                f"{name}={side}", components=fixed, value=lambda x: x @ strain.T
            )
    solution = problem.solve(tol=1e-12)
    return solution, problem.domain.solid(problem.assembly)


def moduli(half, **options):
    """Fraction of solid, C11, C12 and C44."""
    pull, rule = deformed(half, STRETCHING, **options)
    twist, _ = deformed(half, SHEARING, **options)
    volume = 0.5**3
    c12 = rule.integrate(pull.stress_on(rule))[1] / volume
    return rule.integrate() / volume, 2 * pull.energy / volume, c12, 2 * twist.energy / volume


@pytest.mark.parametrize(("strain", "component"), [(STRETCHING, 0), (SHEARING, 5)])
@pytest.mark.parametrize("degree", [1, 2])
def test_the_mean_energy_is_that_of_the_mean_stress(strain, component, degree):
    solution, rule = deformed(1.0, strain, degree=degree, stabilization="none")
    mean = rule.integrate(solution.stress_on(rule))[component]
    assert 2 * solution.energy == pytest.approx(mean, rel=1e-8)
    assert mean > 0.0


def hashin_shtrikman(f):
    """Greatest bulk and shear modulus of a porous solid, f of it solid (Z. Hashin, 1963)."""
    k, g = BULK, SHEAR
    bulk = k + (1 - f) / (-1 / k + 3 * f / (3 * k + 4 * g))
    return bulk, g + (1 - f) / (-1 / g + 6 * f * (k + 2 * g) / (5 * g * (3 * k + 4 * g)))


@pytest.mark.parametrize("half", [0.3, 1.0])
def test_moduli_are_below_the_bounds_of_voigt_and_of_hashin_and_shtrikman(half):
    f, c11, c12, c44 = moduli(half)
    reuss = 5 * (c11 - c12) * c44 / (4 * c44 + 3 * (c11 - c12))
    most = hashin_shtrikman(f)
    assert 0.3 * f * BULK < (c11 + 2 * c12) / 3 <= most[0] < f * BULK
    assert 0.1 * f * SHEAR < reuss <= most[1] < f * SHEAR


def test_stiffness_on_the_void_breaks_the_bound_of_hashin_and_shtrikman():
    f, c11, c12, _ = moduli(1.0, degree=1, stabilization="void", weight=1.0)
    assert (c11 + 2 * c12) / 3 > 1.05 * hashin_shtrikman(f)[0]
