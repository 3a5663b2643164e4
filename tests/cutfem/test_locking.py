"""Degree 1 does not bend bars and walls thinner than cells: that is told, and by how much."""

import warnings

import numpy as np
import pytest

import ilattice as il
from ilattice.cutfem import Elasticity, discretization, locking
from ilattice.cutfem.choosing import FEW, MANY, degree_for
from ilattice.cutfem.modal import buckling, natural_modes
from ilattice.cutfem.tractions import transmitted
from ilattice.errors import PrecisionWarning

F = il.fields


def bar(tilt, thick, n, *, turn=0.3, about=0.7, at=(0.0, 0.0)):
    """A square bar that crosses a box of height one, inclined: the problem, its axis and length."""
    axis = np.array([np.cos(about), np.sin(about), 0.0])
    side = 0.55 * np.tan(tilt) + 0.1
    body = F.rotate(F.rotate(F.box((thick / 2, thick / 2, 4)), turn, (0, 0, 1)), tilt, axis)
    k = max(2, round(2 * side * n))
    box = [[-side, -side, -0.5], [side, side, 0.5]]
    body = F.translate(body, (*at, 0.0))
    problem = Elasticity(body, (k, k, n), domain=box, young=1.0, poisson=0.0, degree=1)
    along = np.array([np.sin(tilt) * axis[1], -np.sin(tilt) * axis[0], np.cos(tilt)])
    return problem.clamp("w=0"), axis, along, 1.0 / np.cos(tilt)


def bent(thick, long):
    """What a unit force at its end bends a square bar by (Euler and Bernoulli)."""
    return 4.0 * long**3 / thick**4


def told(problem):
    """A solution, and the warnings that come with it."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        solution = problem.solve()
    return solution, " ".join(str(w.message) for w in caught)


@pytest.mark.parametrize(("tilt", "thick", "n"), [(0.5, 0.005, 16), (0.62, 0.01, 16)])
def test_inclined_bars_are_told_to_be_twice_too_stiff(tilt, thick, n):
    """It was said that they were 1 to 2 % off, as cells twice as long are too stiff alike."""
    held, axis, _, long = bar(tilt, thick, n)
    solution, words = told(held.load(force=axis, on="w=1"))
    missed = bent(thick, long) / solution.compliance - 1.0
    assert 0.8 < missed < 1.1
    assert 0.8 * missed < solution.report.discretization_error < 1.25 * missed
    assert "solid parts are thinner than cells" in words
    assert "degree=2" in words
    assert "or less" not in words


@pytest.mark.parametrize("seed", range(6))
def test_bars_of_any_inclination_and_thickness(seed):
    rng = np.random.default_rng([18, seed])
    n, tilt = 12, rng.uniform(0.0, 0.8) * (seed > 1)
    thick = np.exp(rng.uniform(np.log(0.05), np.log(0.7))) / n
    held, axis, along, long = bar(
        tilt, thick, n, turn=rng.uniform(0, 1), about=rng.uniform(0, 6),
        at=rng.uniform(-0.02, 0.02, 2),
    )  # fmt: skip
    solution, words = told(held.load(force=axis, on="w=1"))
    missed = bent(thick, long) / solution.compliance - 1.0
    assert missed > 0.3
    assert 0.6 * missed < solution.report.discretization_error < 2.0 * missed
    assert words
    guided, words = told(held.clamp("w=1", value=tuple(0.01 * axis)))
    missed = 2.0 * guided.energy * bent(thick, long) / 4.0 / 1e-4 - 1.0
    assert 0.6 * missed < guided.report.discretization_error < 2.0 * missed
    assert words
    pulled, words = told(held.load(force=tuple(along), on="w=1"))
    np.testing.assert_allclose(pulled.compliance, long / thick**2, rtol=5e-3)
    assert pulled.report.discretization_error < 0.01
    assert not words


@pytest.mark.parametrize("angle", [0.0, 0.37])
def test_plates_that_are_a_hundred_times_too_stiff(angle):
    """Cells twice as long never tell more than four times an energy."""
    thick, wide, n = 0.005, 0.12, 12
    plate = F.rotate(F.box((wide, thick / 2, 4)), angle, (0, 0, 1))
    box = [[-0.2, -0.2, 0.0], [0.2, 0.2, 1.0]]
    problem = Elasticity(plate, (5, 5, n), domain=box, young=1.0, poisson=0.0, degree=1)
    normal = (-np.sin(angle), np.cos(angle), 0.0)
    solution, words = told(problem.clamp("w=0").load(force=normal, on="w=1"))
    missed = 4.0 / (2 * wide * thick**3) / solution.compliance - 1.0
    assert missed > 50
    assert 0.7 * missed < solution.report.discretization_error < 1.4 * missed
    assert "times its own size" in words


@pytest.mark.parametrize(
    ("tilt", "thick", "n"), [(0.5, 0.005, 16), (0.0, 0.01, 16), (0.65, 0.046, 12)]
)
def test_frequencies_and_load_factors_of_thin_bars(tilt, thick, n):
    """They were told to be 2 % off, or a tenth of what they are."""
    held, _, along, long = bar(tilt, thick, n)
    with pytest.warns(PrecisionWarning, match="a frequency .* solid parts are thinner than cells"):
        modes = natural_modes(held, 2)
    lowest = 1.875104**4 * thick**2 / 12.0 / long**4
    missed = (modes.omega**2 / lowest - 1.0).max()
    assert missed > 2.0
    assert 0.7 * missed < modes.report.discretization_error < 1.4 * missed
    pressed, _ = told(held.load(force=tuple(-along), on="w=1"))
    with pytest.warns(PrecisionWarning, match="a load factor .* solid parts are thinner"):
        found = buckling(pressed, 1)
    missed = found.factors[0] * 48.0 * long**2 / (np.pi**2 * thick**4) - 1.0
    assert missed > 0.5
    assert 0.7 * missed < found.report.discretization_error < 1.4 * missed


def test_rigid_motions_of_thin_bars_miss_nothing():
    """Their stress is rounding, of which any part may be missing; what bends is told."""
    thick, long, n = 0.02, 0.9, 12
    body = F.rotate(F.box((thick / 2, thick / 2, long / 2)), 0.4, (1, 0.3, 0))
    box = [[-0.5] * 3, [0.5] * 3]
    problem = Elasticity(body, n, domain=box, young=1.0, poisson=0.0, degree=1)
    assert natural_modes(problem, 4).report.discretization_error < 1e-6
    with pytest.warns(PrecisionWarning, match="solid parts are thinner than cells"):
        modes = natural_modes(problem, 8)
    missed = modes.omega[7] ** 2 / (4.73004**4 * thick**2 / 12.0 / long**4) - 1.0
    assert missed > 5.0
    assert 0.7 * missed < modes.report.discretization_error < 1.4 * missed


def test_tractions_are_in_equilibrium_with_loads():
    held, _, _, _ = bar(0.4, 0.03, 10)
    problem = held.load(body=(0.3, -0.2, 1.0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        c = problem.solve(tol=1e-11).coefficients
    inner = np.flatnonzero(locking._without_supports(problem))
    tractions = transmitted(problem, c, inner)
    ((rule, f, _),) = tractions.loads
    for element in inner:
        x, force = tractions.around(np.array([element]))
        rows = locking._rows_in(rule, problem.assembly.space.cells[[element]])
        x, force = np.concatenate([x, rule.points[rows]]), np.concatenate([force, f[rows]])
        size = 1e-4 * np.abs(force).sum()
        assert np.abs(force.sum(axis=0)).max() < size
        assert np.abs(np.cross(x, force).sum(axis=0)).max() < size


def test_uniform_stress_has_its_own_tractions():
    stress = np.array([[0.3, 0.1, -0.2], [0.1, -0.4, 0.5], [-0.2, 0.5, 0.2]])
    normal = np.array([0.3, 0.5, 0.81]) / np.linalg.norm([0.3, 0.5, 0.81])
    problem = Elasticity(
        lambda u: u @ normal - 0.2, 6, domain=[[-1.0] * 3, [1.0] * 3], young=1.0, poisson=0.0,
        degree=1,
    ).load(traction=tuple(stress @ normal), on="surface")  # fmt: skip
    for face in ("u=0", "u=1", "v=0", "v=1", "w=0", "w=1"):
        problem = problem.clamp(face, value=lambda x: x @ stress)
    space, domain = problem.assembly.space, problem.domain
    inner = np.flatnonzero(locking._without_supports(problem))
    assert (domain.status.ravel()[space.cells[inner]] == 0).sum() > 10
    tractions = transmitted(problem, problem.assembly.coordinates @ stress, inner)
    for axis in range(3):
        faces = domain.joints[axis]
        sides = np.searchsorted(space.cells, [faces.cells, faces.neighbours])
        for low, high, area in zip(*sides, faces.weights, strict=True):
            if low in inner or high in inner:
                on = (tractions.low == low) & (tractions.high == high)
                got = tractions.forces[on].sum(axis=0)
                np.testing.assert_allclose(got, area * stress[axis], rtol=1e-4, atol=1e-6)


def test_errors_beyond_half_may_be_many_times_larger():
    space = bar(0.4, 0.03, 10)[0].assembly.space
    with pytest.warns(PrecisionWarning, match="99 %, or many times that"):
        discretization.warn(0.99, "it", space)
    with pytest.warns(PrecisionWarning, match="20 %, or several times that"):
        discretization.warn(0.2, "it", space)


@pytest.mark.filterwarnings("ignore:the spline that quadrature")
def test_struts_thinner_than_cells_get_degree_two_where_they_bend():
    lattice = il.Lattice(
        il.tiles.bcc_struts(radius=0.02), through=il.macroshape.box((4.0,) * 3), repeat=4
    )
    solid = il.cutfem.cut(lattice.offset((np.inf, 0.0)), 32)
    assert FEW < (solid.status <= 0).sum() < MANY
    assert degree_for(solid, True)[0] == 2
    assert "thinner than cells" in degree_for(solid, True)[1]
    assert degree_for(solid, False)[0] == 1
