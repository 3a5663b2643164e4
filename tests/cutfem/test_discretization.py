"""Coarse spaces are parts of fine ones; what finer cells add is estimated, and warned of."""

import warnings

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import ilattice as il
from ilattice.cutfem import Elasticity, Grid, Heat, buckling, integration, natural_modes
from ilattice.cutfem.coarsening import coarser
from ilattice.cutfem.discretization import Levels, of_work, relative_error
from ilattice.errors import PrecisionWarning

BOX = [[-1.0] * 3, [1.0] * 3]


def whole(u):
    return -np.ones(len(u))


def space_of(p, r, shape, closed=(False, False, False), field=whole, seed=0):
    """Functions on a grid with planes at random places."""
    rng = np.random.default_rng(seed)
    axes = tuple(np.append(0.0, np.cumsum(0.5 + rng.random(n))) for n in shape)
    problem = Elasticity(field, Grid(axes, closed), degree=p, smoothness=r)
    return problem.assembly.space


# ------------------------------------------------------------------------------ coarse spaces

KINDS = [(1, 0), (2, 1), (2, 0), (3, 2), (3, 1), (3, 0)]


@pytest.mark.parametrize(("p", "r"), KINDS)
@pytest.mark.parametrize("closed", [(False,) * 3, (True, False, True)])
def test_coarse_splines_are_combinations_of_fine_ones(p, r, closed):
    space = space_of(p, r, (9, 5, 8), closed, seed=p + 3 * r)
    coarse, P = coarser(space)
    rng = np.random.default_rng(1)
    b = rng.standard_normal((len(coarse), 2))
    lo, hi = space.grid.domain
    u = lo + (hi - lo) * rng.random((200, 3))
    np.testing.assert_allclose(
        space.evaluate(P @ b, u)[0], coarse.evaluate(b, u)[0], rtol=0, atol=1e-11
    )


@pytest.mark.parametrize(("p", "r"), KINDS)
def test_an_odd_number_of_cells_and_few_closed_ones_are_no_trouble(p, r):
    space = space_of(p, r, (1, 3, 2), (False, False, False))
    coarse, P = coarser(space)
    assert coarse.grid.shape == (1, 1, 1)
    np.testing.assert_allclose(P @ np.ones(len(coarse)), 1.0, atol=1e-12)
    ring = space_of(p, r, (5, 1, 1), (True, False, False))
    half = coarser(ring)
    if 2 * (p - r) <= p:  # splines on two closed cells would overlap themselves
        assert half is None
    else:
        assert half[0].grid.shape == (2, 1, 1)
        np.testing.assert_allclose(half[1] @ np.ones(len(half[0])), 1.0, atol=1e-12)
    assert coarser(space_of(p, r, (1, 1, 1))) is None


def apart(u):
    """Two blocks with an oblique slit of about a cell between."""
    s = (u @ np.array([0.2, -0.1, 0.97]) + 0.03) / 0.07
    return 1.0 - s * s


def pieces(space):
    """How many sets of functions there are that no element has in common with others."""
    n = len(space)
    first = np.broadcast_to(space.dofs[:, :1], space.dofs.shape)
    pairs = (first.ravel(), space.dofs.ravel())
    return connected_components(coo_array((np.ones(len(pairs[0])), pairs), (n, n)), False)[0]


@pytest.mark.parametrize("p", [1, 2, 3])
def test_gaps_stay_open_on_coarse_cells(p):
    space = Elasticity(apart, 14, domain=BOX, degree=p).assembly.space
    assert pieces(space) == 2
    for _ in range(3):
        space, P = coarser(space)
        assert pieces(space) == 2
        np.testing.assert_allclose(P @ np.ones(len(space)), 1.0, atol=1e-12)


# ------------------------------------------------------------------------------ the estimate


def ball(u):
    return (u**2).sum(axis=1) - 0.8**2


def bar(n, p, **options):
    grid = (n, n, 4 * n)
    return Elasticity(whole, grid, domain=[[0, 0, 0], [1, 1, 4]], degree=p, **options)


@pytest.mark.parametrize("p", [1, 2])
def test_the_coarse_approximation_is_the_best_one(p):
    problem = bar(3, p, poisson=0.2).clamp("w=0").load(traction=(1.0, 0.3, 0.0), on="w=1")
    c, con, K = solved(problem), problem.constraints, problem.matrix.toarray()
    P = Levels(problem.assembly.space, problem.assembly.nodes_of)
    P.second = None
    free = ~con.fixed.ravel()
    wide = np.kron(P.first.P.toarray(), np.eye(3))
    wide = wide[:, np.abs(wide[~free]).max(axis=0) == 0][free]
    K, u = K[np.ix_(free, free)], c.ravel()[free]
    e = u - wide @ np.linalg.solve(wide.T @ K @ wide, wide.T @ K @ u)
    exact = e @ K @ e
    full = problem.matrix

    def multiply(v):
        return np.where(con.fixed, 0.0, (full @ v.ravel()).reshape(v.shape))

    energy = u @ K @ u
    diagonal = full.diagonal().reshape(c.shape)
    found = relative_error(P, multiply, problem._rigid_modes, diagonal, c, con.fixed, energy)
    assert 0.999 * exact < 1.5 * found * energy < 1.2 * exact  # of one level alone: over 1.5


def solved(problem):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PrecisionWarning)
        return problem.solve(tol=1e-10).coefficients


def stretched(x):
    return x @ np.array([[0.1, 0.2, 0.0], [0.0, -0.3, 0.1], [0.4, 0.0, 0.2]]) + 7.0


@pytest.mark.parametrize("p", [1, 2, 3])
def test_nothing_is_off_for_solutions_that_coarse_cells_have(p):
    problem = Elasticity(lambda u: u @ [0.3, 0.5, 0.81] - 0.2, 5, domain=BOX, degree=p, q=p + 2,
                         stabilization="ghost")  # fmt: skip
    for on in ("u=0", "u=1", "v=0", "v=1", "w=0", "w=1"):
        problem = problem.clamp(on, value=stretched)
    held = problem.load(traction=traction_of, on="surface")
    assert held.solve(tol=1e-11).report.discretization_error < 1e-6
    moved = bar(3, p).clamp("w=0", value=(1.0, 2.0, 3.0))
    assert moved.solve().report.discretization_error == 0.0
    warm = Heat(ball, 6, domain=BOX, degree=p).convection("surface", 1.0, around=20.0)
    assert warm.solve().report.discretization_error == 0.0


def traction_of(x):
    """Traction of the stretched state on the tilted plane, for Young's modulus 1 and ν = 0.3."""
    g = np.array([[0.1, 0.2, 0.0], [0.0, -0.3, 0.1], [0.4, 0.0, 0.2]]).T
    strain = 0.5 * (g + g.T)
    lam, mu = 0.3 / (1.3 * 0.4), 1 / 2.6
    n = np.array([0.3, 0.5, 0.81])
    s = lam * np.trace(strain) * np.eye(3) + 2 * mu * strain
    return np.broadcast_to(s @ n / np.linalg.norm(n), x.shape)


def value(problem):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PrecisionWarning)
        s = problem.solve()
    return s.compliance, s.report.discretization_error


@pytest.mark.parametrize("seed", range(6))
def test_twice_as_many_cells_change_no_more_than_twice_the_estimate(seed):
    rng = np.random.default_rng(seed)
    n, p = int(rng.integers(5, 8)), int(rng.integers(1, 3))
    centre, tilt = 0.2 * rng.random(3), rng.standard_normal(3)
    load, thick = rng.standard_normal(3), 0.3 + 0.3 * rng.random()

    def body(u):
        s = (u - centre) @ (tilt / np.linalg.norm(tilt))
        return np.abs(s + 0.2 * np.sin(3 * u[:, 0])) - thick  # a bent sheet

    def pair(u):
        s = (u - centre) @ (tilt / np.linalg.norm(tilt)) + 0.2 * np.sin(3 * u[:, 0])
        return s - thick

    def other(u):
        s = (u - centre) @ (tilt / np.linalg.norm(tilt)) + 0.2 * np.sin(3 * u[:, 0])
        return -s - thick

    def made(cells):
        problem = Elasticity((pair, other), cells, domain=BOX, degree=p)
        held, _ = problem.parts
        assert len(held)
        return problem.clamp(place(body)).load(body=load)

    coarse, error = value(made(n))
    fine, _ = value(made(2 * n))
    assert abs(fine / coarse - 1.0) <= 2.0 * error


@pytest.mark.parametrize(("p", "r"), [(2, 1), (2, 0), (3, 2)])
def test_what_the_penalty_on_jumps_takes_is_in_the_estimate(p, r):
    rng = np.random.default_rng([p, r])
    n, m = rng.standard_normal((2, 3))
    problems = {}
    for how in ("ghost", "none"):
        made = Elasticity(
            lambda u: np.abs(u @ n / np.linalg.norm(n)) - 0.3, 5, domain=BOX, degree=p,
            smoothness=r, young=3e4, stabilization=how,
        )  # fmt: skip
        problems[how] = made.clamp(place(lambda u: np.abs(u @ n) - 0.3)).load(body=m)
    problem = problems["ghost"]
    c = solved(problem)
    energy = float(c.ravel() @ (problem.matrix @ c.ravel()))
    jumps = energy - float(c.ravel() @ (problems["none"].matrix @ c.ravel()))
    assert jumps > 1e-4 * energy
    found = problem.assembly.ghost_energy(c, problem._ghost_stiffness)
    np.testing.assert_allclose(found, jumps, rtol=1e-6)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PrecisionWarning)
        report = problem.solve(tol=1e-10).report
    con, full = problem.constraints, problem.matrix

    def multiply(v):
        return np.where(con.fixed, 0.0, (full @ v.ravel()).reshape(v.shape))

    coarse = Levels(problem.assembly.space, problem.assembly.nodes_of)
    diagonal = full.diagonal().reshape(c.shape)
    rest = relative_error(coarse, multiply, problem._rigid_modes, diagonal, c, con.fixed, energy)
    known = of_work(rest + jumps / energy)
    np.testing.assert_allclose(report.discretization_error, known, rtol=1e-4)


def place(body):
    """An end face that the body meets."""
    t = np.linspace(-1, 1, 21)
    face = np.stack(np.meshgrid(t, t, indexing="ij"), -1).reshape(-1, 2)
    wet = [
        (body(np.insert(face, axis, side, axis=1)) < 0).mean()
        for axis in range(3)
        for side in (-1.0, 1.0)
    ]
    return ("u=0", "u=1", "v=0", "v=1", "w=0", "w=1")[int(np.argmax(wet))]


@pytest.mark.parametrize(("n", "p"), [(4, 1), (8, 1), (2, 2)])
def test_the_estimate_of_a_beam_is_near_what_is_missing(n, p):
    def loaded(cells, degree):
        return bar(cells, degree).clamp("w=0").load(traction=(1.0, 0, 0), on="w=1")

    found, error = value(loaded(n, p))
    exact, _ = value(loaded(8, 2))
    missing = exact / found - 1.0
    assert 0.5 * missing < error < 2.0 * missing


CSG = il.fields.difference(
    il.fields.box((0.55, 0.6, 1.2)),
    il.fields.union(
        il.fields.translate(il.fields.sphere(0.4), (0.3, -0.35, 0.1)),
        il.fields.capsule((-1.5, 0.2, -0.4), (1.6, -0.1, 0.3), 0.2),
    ),
)


@pytest.mark.parametrize("seed", range(3))
def test_the_estimate_sees_edges_beside_what_is_smooth(seed):
    """Bodies with edges: a smooth part let the estimate of the whole fall three times too low."""
    rng = np.random.default_rng(seed)
    n, load = rng.integers(5, 8, 3), rng.standard_normal(3)
    box = np.array([-1.1 + 0.2 * rng.random(3), 1.0 + 0.2 * rng.random(3)])

    def solve(cells):
        held = Elasticity(CSG, tuple(cells), domain=box).clamp("w=0")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PrecisionWarning)
            return held.load(body=lambda x: load + 0.3 * np.sin(2 * x)).solve()

    coarse, fine = solve(n), solve(2 * n)
    off = fine.compliance / coarse.compliance - 1.0
    assert off < 2.0 * coarse.report.discretization_error


# ------------------------------------------------------------------------------ warnings


@pytest.mark.parametrize(("shape", "closed"), [((6, 5, 1), ()), ((5, 6, 7), (0,)), ((1, 9, 9), ())])
def test_what_cannot_be_estimated_is_said(shape, closed):
    axes = [np.linspace(0.0, 1.0, n + 1) for n in shape]
    grid = Grid(axes, tuple(a in closed for a in range(3)))
    problem = Elasticity(whole, grid, degree=2 + len(closed)).clamp("w=0")
    with pytest.warns(PrecisionWarning, match="too coarse to tell by how much the strain energy"):
        solution = problem.load(traction=(1.0, 0.3, 0.0), on="w=1").solve()
    assert np.isnan(solution.report.discretization_error)


@pytest.mark.parametrize(("n", "p"), [(6, 2), (8, 1)])
def test_walls_of_a_cell_or_two_are_warned_of(n, p):
    wall = il.Lattice("schwarz_p", through=il.macroshape.box((1, 1, 1))).offset(0.1)
    problem = Elasticity(wall, n, degree=p).clamp("w=0").load(traction=(0, 0, -1.0), on="w=1")
    with pytest.warns(PrecisionWarning, match="too coarse: the strain energy is off by about"):
        solution = problem.solve()
    assert solution.report.discretization_error > 0.05


def test_struts_in_any_solid_are_warned_of_and_stout_bodies_are_not():
    rod = Elasticity(lambda u: (u[:, :2] ** 2).sum(axis=1) - 0.04, (2, 2, 9), degree=1,
                     domain=[[-0.3, -0.3, 0], [0.3, 0.3, 3]])  # fmt: skip
    rod = rod.clamp("w=0").load(traction=(1.0, 0, 0), on="w=1")
    with pytest.warns(PrecisionWarning, match="too coarse"):
        rod.solve()
    quiet = bar(3, 2).clamp("w=0").load(traction=(1.0, 0, 0), on="w=1")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        quiet.solve()


def test_heat_is_warned_of_too():
    thin = Heat(whole, (2, 2, 3), domain=[[0, 0, 0], [1, 1, 4]], degree=1, q=5).fix("w=0", 0.0)
    with pytest.warns(PrecisionWarning, match="the temperature"):
        thin.source(lambda x: np.exp(-6 * ((x - [0.5, 0.5, 3.0]) ** 2).sum(axis=1))).solve()


def test_frequencies_and_load_factors_have_estimates():
    fine = natural_modes(bar(6, 2).clamp("w=0"), 3).omega ** 2
    with pytest.warns(PrecisionWarning, match="square of a frequency"):
        modes = natural_modes(bar(3, 1).clamp("w=0"), 3)
    missing = (modes.omega**2 / fine - 1.0).max()
    assert 0.5 * missing < modes.report.discretization_error < 2.0 * missing
    pressed = bar(3, 1).clamp("w=0").load(traction=(0, 0, -1.0), on="w=1")
    with pytest.warns(PrecisionWarning, match="load factor"):
        factors = buckling(pressed.solve(), 1)
    better = buckling(bar(4, 2).clamp("w=0").load(traction=(0, 0, -1.0), on="w=1").solve(), 1)
    missing = float(factors.factors[0] / better.factors[0] - 1.0)
    assert 0.5 * missing < factors.report.discretization_error < 2.5 * missing


@pytest.mark.filterwarnings("ignore:the cells are too coarse")
@pytest.mark.parametrize("p", [1, 2])
def test_stiff_springs_hide_no_error(p):
    bar = il.cutfem.Elasticity(
        lambda u: -np.ones(len(u)), (3, 2, 4), domain=[[0, 0, 0], [1, 0.8, 2]], degree=p
    )
    bar = bar.load(body=(0.3, 0.2, 0.1))
    errors = [
        bar.spring("w=0", k).solve().report.discretization_error for k in (1e5, 1e9, 1e12, 1e14)
    ]
    np.testing.assert_allclose(errors, errors[0], rtol=0.05)
    assert errors[0] > 0.02


@pytest.mark.filterwarnings("ignore:the cells are too coarse")
@pytest.mark.parametrize("p", [1, 2])
@pytest.mark.parametrize("far", [(3e3, -7e4, 2e4), (1e6, 2e6, -3e6)])
def test_far_from_the_origin_the_estimate_is_the_same(far, p):
    def error(move):
        box = np.add([[0.0, 0.0, 0.0], [0.7, 1.1, 1.9]], move)
        bar = il.cutfem.Elasticity(lambda u: -np.ones(len(u)), (5, 6, 7), domain=box, degree=p)
        return bar.clamp("w=0").load(body=(0.1, 0.3, -1.0)).solve().report.discretization_error

    assert error(far) == pytest.approx(error((0.0, 0.0, 0.0)), rel=0.01)


@pytest.mark.filterwarnings("ignore:the cells are too coarse")
def test_errors_of_thermal_stress_are_parts_of_its_energy():
    ball = il.cutfem.Elasticity(
        il.fields.sphere(0.8), 5, domain=[[-0.9] * 3, [0.9] * 3], expansion=1e-3
    )
    held = ball.clamp("surface").load(temperature=100.0).solve()
    assert held.report.discretization_error < 1e-6  # nothing moves
    cube = il.cutfem.Elasticity(
        lambda u: -np.ones(len(u)), 3, domain=[[0] * 3, [1] * 3], expansion=1e-3
    )
    free = cube
    for on, c in zip(("u=0", "v=0", "w=0"), "xyz", strict=True):
        free = free.clamp(on, components=c)
    free = free.load(temperature=100.0).solve()
    assert free.report.discretization_error < 1e-6  # a stretch is what coarse splines have
    coarse = cube.clamp("w=0").load(temperature=100.0).solve()
    fine = il.cutfem.Elasticity(
        lambda u: -np.ones(len(u)), 9, domain=[[0] * 3, [1] * 3], expansion=1e-3
    )
    fine = fine.clamp("w=0").load(temperature=100.0).solve()
    missed = coarse.energy / fine.energy - 1.0
    assert missed < coarse.report.discretization_error < 6.0 * missed


@pytest.mark.filterwarnings("ignore:the cells are too coarse")
def test_the_error_of_solids_that_keep_their_volume_does_not_grow_with_their_bulk_modulus():
    for poisson in (0.49, 0.4999, 0.499999):
        beam = il.cutfem.Elasticity(
            il.fields.box((0.4, 0.45, 3.0)), (4, 4, 4), poisson=poisson,
            domain=[[-0.5, -0.5, 0], [0.5, 0.5, 2]],
        )  # fmt: skip
        beam = beam.clamp("w=0").load(body=(1.0, 0, 0)).solve()
        assert 0.01 < beam.report.discretization_error < 0.2  # about 0.013


def turned_block(rng):
    """Half spaces with random normals meet in a box at a random place: field, middle, box."""
    middle = rng.uniform(-5.0, 5.0, 3)
    planes = []
    for depth in (0.4, 0.3):
        n = rng.standard_normal(3)
        n /= np.linalg.norm(n)
        planes.append(il.fields.half_space(tuple(n), float(n @ middle + depth)))
    return il.fields.intersection(*planes), middle, [middle - 1.0, middle + 1.0]


@pytest.mark.filterwarnings("ignore:on=")
@pytest.mark.parametrize("p", [2, 3])
def test_solids_that_expand_freely_are_not_said_to_be_off(p):
    for seed in range(4):
        rng = np.random.default_rng([seed, p, 16])
        field, middle, box = turned_block(rng)
        slope = rng.standard_normal(3)

        def freely(x, middle=middle, slope=slope):
            y = x - middle
            rise = (3.0 + y @ slope)[:, None] * y
            return 1e-4 * (rise - 0.5 * (y * y).sum(axis=1)[:, None] * slope)

        def warmth(x, middle=middle, slope=slope):
            return 3.0 + (x - middle) @ slope

        cells = tuple(int(k) for k in rng.integers(3, 6, 3))
        solid = Elasticity(field, cells, domain=box, degree=p, expansion=1e-4)
        held = solid.clamp(f"z < {middle[2] - 0.2:.12g}", value=freely)
        with warnings.catch_warnings():
            warnings.filterwarnings("error", "the cells are too coarse")
            solution = held.load(temperature=warmth).solve(tol=1e-12)
        stress = solution.stress(solution.problem.domain.solid(solid.assembly).parameters)
        assert np.abs(stress).max() < 1e-9


@pytest.mark.filterwarnings("ignore:on=")
@pytest.mark.parametrize("p", [1, 2, 3])
def test_turning_a_solid_as_a_whole_is_no_error(p):
    for seed in range(4):
        rng = np.random.default_rng([seed, p, 17])
        field, middle, box = turned_block(rng)
        cells = tuple(int(k) for k in rng.integers(3, 6, 3))
        held = Elasticity(field, cells, domain=box, degree=p).clamp(
            f"z < {middle[2] - 0.2:.12g}",
            value=tuple(rng.standard_normal(3)), rotation=tuple(rng.standard_normal(3)),
        )  # fmt: skip
        assert held.solve(tol=1e-12).report.discretization_error == 0.0


@pytest.mark.filterwarnings("ignore:the cells are too coarse")
@pytest.mark.parametrize("slender", [50, 100, 200])
def test_errors_of_slender_bars_are_not_taken_for_rounding(slender):
    bar = Elasticity(
        whole, (2, 2, slender), domain=[[0.0] * 3, [1.0, 1.0, slender]], degree=1, poisson=0.0
    )
    bent = bar.clamp("w=0").load(traction=(1e-6, 0.0, 0.0), on="w=1").solve(tol=1e-5)
    known = 1e-12 * (4.0 * slender**3 + 2.4 * slender)
    missed = known / bent.compliance - 1.0
    assert 0.4 < missed < 2.0 * bent.report.discretization_error


def rod(rng, cells):
    """A round rod of a radius in cells, anywhere, its section, and the boxes of both."""
    radius, (x, y) = rng.uniform(0.35, 1.8), rng.uniform(-0.5, 0.5, 2)
    field = il.fields.equation(f"(x-({x:.17g}))^2+(y-({y:.17g}))^2-{radius**2:.17g}")
    n = 2 * int(np.ceil(radius + 1.0))
    box = [[-0.5 * n] * 2 + [0.0], [0.5 * n] * 2 + [3.0]]
    return field, (n, n, cells), box, np.pi * radius**2


@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("kind", ["one", "two", "heat", "anisotropic"])
def test_what_rules_of_curved_cells_miss_is_told(kind, degree):
    """Tension, which splines have exactly: 1.6 % off at degree 1, where nothing was told."""
    rng = np.random.default_rng([16, degree, len(kind)])
    for _ in range(3):
        field, cells, box, area = rod(rng, 4)
        stiff, at, long = 10 ** rng.uniform(-2, 2, 2), rng.uniform(0.5, 2.5), 3.0
        options = {"domain": box, "degree": degree}
        if kind == "two":
            options["phases"] = il.fields.half_space((0, 0, 1.0), at)
        else:
            stiff[1] = stiff[0]
        if kind == "heat":
            body = il.cutfem.Heat(field, cells, conductivity=stiff[0], **options)
            held = body.fix("w=0", 0.0).fix("w=1", 1.0)
        elif kind == "anisotropic":
            C = stiff[0] * np.diag([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])
            held = il.cutfem.Elasticity(field, cells, stiffness=C, **options)
        else:
            young = tuple(stiff) if kind == "two" else stiff[0]
            held = il.cutfem.Elasticity(field, cells, young=young, poisson=0.0, **options)
        if kind != "heat":
            held = held.clamp("w=0").clamp("w=1", value=(0, 0, 1.0))
        s = held.solve(tol=1e-12)
        exact = area / (at / stiff[0] + (long - at) / stiff[1])
        got = s.inflow["w=1"] if kind == "heat" else s.reactions["w=1"][2]
        told, off = s.report.integration_error, abs(got / exact - 1)
        assert 0.5 * off - 1e-10 < told < 2 * off + 1e-10
        if degree == 1:  # where that is up to 2 %, every solve tells
            assert off < 1.5 * s.report.discretization_error + 1e-10


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
@pytest.mark.parametrize("seed", range(4))
def test_some_cells_tell_what_rules_of_all_miss(seed):
    """In tension, and where energy is in few cells, under loads that bend; 1,000 cells and more."""
    rng = np.random.default_rng([17, seed])
    field, _, box, area = rod(rng, 4)
    n = rng.integers(9, 14) if seed % 2 else 4
    body = il.cutfem.Elasticity(field, (n, n, 240 // n), domain=box, degree=1, poisson=0.0)
    held = body.clamp("w=0").clamp("w=1", value=(0, 0, 1.0))
    s = held.solve(tol=1e-12)
    told, off = s.report.discretization_error, abs(s.reactions["w=1"][2] / area * 3 - 1)
    assert 0.5 * off < told < 2 * off
    push = rng.standard_normal(3)
    bent = body.clamp("w=0").load(body=lambda x: np.exp(-3 * x[:, 2:]) * push)
    s = bent.solve()
    energy = bent._solid_energy(s.coefficients)
    some = integration.drawn_error(bent, s.coefficients, energy)
    assert len(integration._inexact_cells(bent)) > integration.SOME
    whole = integration.relative_error(bent, s.coefficients, energy)
    assert 0.5 * whole < some < 3 * whole


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
@pytest.mark.parametrize("degree", [1, 2, 3])
def test_knots_of_a_map_inside_of_cells_are_told(degree):
    """A ring of four arcs on cells that do not end there: of 2e-4 to 3e-3, up to 1e-9 was told."""
    low, high, tall = 0.63, 1.3, 0.7
    ring = il.macroshape.cylinder_shell(r0=low, r1=high, height=tall)
    exact = 2 * np.pi * tall / np.log(high / low)
    for around in (7, 9, 10, 13, 14):
        if around > 2 * degree + 1:
            cells = (around, 3, 6)
            body = Heat(whole, cells, domain=ring.domain, through=ring, degree=degree)
            s = body.fix("w=0", 1.0).fix("w=1", 0.0).solve(tol=1e-12)
            off = abs(s.inflow["w=0"] / exact - 1)
            assert off < 2 * s.report.discretization_error
            if degree > 1:
                assert off < 2 * s.report.integration_error
                assert off > 1e-5


def test_rules_of_a_twisted_ellipse_are_told():
    """Warping is a quadratic: 1.7e-5 off, where 1.1e-6 was told."""
    a, b, angle, o = 0.8, 0.42, 0.9, np.array([0.07, -0.05])
    c, s = np.cos(angle), np.sin(angle)
    long, turn = f"({c}*(x-({o[0]}))+{s}*(y-({o[1]})))", f"({c}*(y-({o[1]}))-{s}*(x-({o[0]})))"
    field = il.fields.equation(f"({long}/{a})^2+({turn}/{b})^2-1")

    def value(x):
        return 1e-3 * x[:, 2:] * np.column_stack([-x[:, 1], x[:, 0], 0 * x[:, 0]])

    body = il.cutfem.Elasticity(field, (6, 6, 2), domain=[[-1, -1, 0], [1, 1, 0.6]], degree=2)
    for end in ("w=0", "w=1"):
        body = body.clamp(end, components="xy", value=value)
    got = body.spring("surface", (0, 0, 1e-8)).solve(tol=1e-11)
    exact = 0.5 / 2.6 * np.pi * (a * b) ** 3 / (a * a + b * b) * 1e-6 * 0.6
    report, off = got.report, abs(got.energy / exact - 1)
    assert off > 5 * report.discretization_error
    assert off < 1.5 * report.integration_error < 3 * off
