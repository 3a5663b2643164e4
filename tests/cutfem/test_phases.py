"""Solids of two materials: cut by the surface between them, against exact solutions."""

import warnings

import numpy as np
import pytest

import ilattice as il
from ilattice.cutfem import Elasticity, Grid, Heat, natural_modes, quadrature
from ilattice.errors import GeometryError, InputError, PrecisionWarning

pytestmark = pytest.mark.filterwarnings("ignore:the cells are too coarse")
CUBE = [[0.0] * 3, [1.0] * 3]
FACES = ("u=0", "u=1", "v=0", "v=1", "w=0", "w=1")


def whole(u):
    return -np.ones(len(u))


def plane(n, at):
    return lambda x: x @ np.asarray(n) - at


def lame(E, nu):
    return E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))


def held(problem, exact):
    for on in FACES:
        problem = problem.clamp(on, value=exact)
    return problem


# ------------------------------------------------------------------------------ exact solutions


@pytest.mark.parametrize("p", [1, 2, 3])
@pytest.mark.parametrize(("n", "at"), [(4, 0.5), (4, 0.37), (5, 0.5), (3, 0.993)])
def test_laminates_in_series_are_exact(p, n, at):
    problem = Elasticity(
        whole, n, domain=CUBE, degree=p, young=(1.0, 100.0), poisson=0.0, phases=f"z - {at}"
    )
    problem = problem.clamp("w=0", components="z").clamp("u=0", components="x")
    problem = problem.clamp("v=0", components="y").load(traction=(0, 0, 1.0), on="w=1")
    solution = problem.solve(tol=1e-12)
    assert solution.compliance == pytest.approx(at + (1 - at) / 100, rel=1e-9)
    top = solution.evaluate([[0.3, 0.2, at]])[0, 2]
    assert top == pytest.approx(at, rel=1e-9)
    assert solution.reactions["w=0"][2] == pytest.approx(-1.0, rel=1e-9)
    np.testing.assert_allclose(
        solution.stress([[0.2, 0.3, 0.9 * at], [0.2, 0.3, 1.0]])[:, 2], 1.0, atol=1e-8
    )


def sheared(n, at, E, nu):
    """Displacement that is linear on both sides of a plane, with equal tractions."""
    n = np.asarray(n) / np.linalg.norm(n)
    first, second = lame(E[0], nu[0]), lame(E[1], nu[1])
    g = np.random.default_rng(5).standard_normal((3, 3))

    def traction(material, g):
        lam, mu = material
        return (lam * np.trace(g) * np.eye(3) + mu * (g + g.T)) @ n

    # g + a n^T on the other side: continuous on the plane; a from equal tractions
    basis = np.stack([traction(second, np.outer(e, n)) for e in np.eye(3)], axis=1)
    a = np.linalg.solve(basis, traction(first, g) - traction(second, g))

    def exact(x):
        height = x @ n - at
        return x @ g.T + np.maximum(height, 0.0)[:, None] * a

    return n, exact


@pytest.mark.parametrize("p", [1, 2, 3])
@pytest.mark.parametrize("seed", range(3))
def test_a_kink_at_any_plane_is_exact(p, seed):
    rng = np.random.default_rng(10 * p + seed)
    E = tuple(10.0 ** rng.uniform(-3, 3, 2))
    nu = tuple(rng.uniform(-0.3, 0.4, 2))
    n = rng.standard_normal(3)
    unit = n / np.linalg.norm(n)
    at = float(unit @ rng.uniform(0.3, 0.7, 3))
    _, exact = sheared(n, at, E, nu)
    axes = [np.append(0.0, np.cumsum(rng.uniform(0.5, 1.5, 4))) for _ in range(3)]
    grid = Grid([a / a[-1] for a in axes])
    # faces hold functions with a kink only where they are interpolated on both sides: in the mean
    problem = Elasticity(
        whole, grid, degree=p, young=E, poisson=nu, phases=plane(unit, at), q=p + 2
    )
    for on in FACES:
        problem = problem.clamp(on, value=exact, method="nitsche")
    solution = problem.solve(tol=1e-12)
    x = rng.random((500, 3))
    u = exact(x)
    np.testing.assert_allclose(solution.evaluate(x), u, atol=1e-7 * np.abs(u).max())


def inclusion(E, nu, a, centre):
    """A ball in an infinite solid that is stretched alike in all directions far away."""
    (l1, m1), (l2, m2) = lame(E[0], nu[0]), lame(E[1], nu[1])
    K1, K2 = l1 + 2 * m1 / 3, l2 + 2 * m2 / 3
    b = 3 * (K2 - K1) / (3 * K1 + 4 * m2)

    def exact(x):
        d = x - centre
        r = np.maximum(np.linalg.norm(d, axis=1), 0.5 * a)
        return d * np.where(r < a, 1 + b, 1 + b * (a / r) ** 3)[:, None]

    return exact


@pytest.mark.parametrize("E", [(1.0, 100.0), (100.0, 1.0)])
@pytest.mark.parametrize(("p", "cells"), [(1, (6, 12)), (2, (5, 10))])
def test_errors_of_an_inclusion_fall_with_the_order_of_the_space(E, p, cells):
    centre, a = np.array([0.481, 0.533, 0.507]), 0.31
    exact = inclusion(E, (0.3, 0.2), a, centre)
    x = np.random.default_rng(1).random((2000, 3))
    off = []
    for n in cells:
        problem = Elasticity(
            whole, n, domain=CUBE, degree=p, young=E, poisson=(0.3, 0.2),
            phases=lambda x: ((x - centre) ** 2).sum(axis=1) - a * a,
        )  # fmt: skip
        u = held(problem, exact).solve(tol=1e-10).evaluate(x)
        off.append(np.sqrt(((u - exact(x)) ** 2).mean() / (exact(x) ** 2).mean()))
    assert off[1] < 0.02 / p**3
    assert np.log(off[0] / off[1]) / np.log(cells[1] / cells[0]) > p + 0.5


def test_heat_through_a_laminate_and_around_a_ball():
    wall = Heat(whole, (3, 3, 4), domain=CUBE, conductivity=(0.5, 20.0), phases="z - 0.41")
    steady = wall.fix("w=0", 0.0).fix("w=1", 1.0).solve(tol=1e-12)
    flux = 1.0 / (0.41 / 0.5 + 0.59 / 20.0)
    assert abs(steady.inflow["w=1"]) == pytest.approx(flux, rel=1e-9)
    assert steady.evaluate([[0.5, 0.5, 0.41]])[0] == pytest.approx(flux * 0.41 / 0.5, rel=1e-9)
    centre, a, (k1, k2) = np.array([0.48, 0.53, 0.51]), 0.3, (30.0, 1.0)
    b = (k1 - k2) / (k1 + 2 * k2)

    def exact(x):
        d = x - centre
        r = np.maximum(np.linalg.norm(d, axis=1), 0.5 * a)
        return d[:, 2] * np.where(r < a, 1 - b, 1 - b * (a / r) ** 3)

    x, off = np.random.default_rng(1).random((2000, 3)), []
    for cells in (5, 10):
        problem = Heat(
            whole, cells, domain=CUBE, conductivity=(k1, k2),
            phases=il.fields.translate(il.fields.sphere(a), centre),
        )  # fmt: skip
        for on in FACES:
            problem = problem.fix(on, exact)
        error = problem.solve().evaluate(x) - exact(x)
        off.append(np.sqrt((error**2).mean() / (exact(x) ** 2).mean()))
    assert off[1] < 2e-3
    assert np.log2(off[0] / off[1]) > 2.5


def test_two_materials_bend_when_they_are_heated():
    """Timoshenko, 1925: a bimetal strip."""
    E, alpha, at, L = (3.0, 1.0), (1.0e-3, 4.0e-3), 0.43, 12.0
    strip = Elasticity(
        whole, (3, 1, 24), domain=[[0, 0, 0], [1, 0.7, L]], young=E, poisson=0.0,
        expansion=alpha, phases=f"u - {at}",
    )  # fmt: skip
    strip = strip.clamp("w=0", components="z").clamp("u=0", components="x", method="nitsche")
    free = Elasticity(strip.domain, young=E, poisson=0.0, expansion=alpha)
    free = free.clamp("w=0").clamp("v=0", components="y").load(temperature=2.0)
    solution = free.solve()
    t1, t2 = at, 1 - at
    m, n = t1 / t2, E[0] / E[1]
    turn = 6 * (alpha[1] - alpha[0]) * 2.0 * (1 + m) ** 2
    turn /= 3 * (1 + m) ** 2 + (1 + m * n) * (m * m + 1 / (m * n))
    z = np.array([4.0, 6.0, 8.0])
    x = np.column_stack([np.full(3, 0.5), np.full(3, 0.35), z])
    bend = np.diff(solution.evaluate(x)[:, 0], 2)[0] / 4.0
    assert abs(bend) == pytest.approx(turn, rel=2e-3)


# ------------------------------------------------------------------------------ walls, parts, modes


def test_masses_and_volumes_of_phases_add_up_in_a_wall():
    torus = il.macroshape.torus(major=2.0, width=1.0)
    wall = il.Lattice("schwarz_p", through=torus, repeat=(8, 1, 1)).offset(0.12)
    problem = Elasticity(wall, (32, 4, 4), density=(2.0, 7.0), phases="x - 0.3")
    domain = problem.domain
    solid = il.cutfem.quadrature(wall, (32, 4, 4))
    for k, sign in enumerate((1.0, -1.0)):
        rule = domain.volume.in_space()
        mine = domain.elements.second[domain.volume.cells][domain.volume.owners] == bool(k)
        found = rule.weights[mine].sum()
        fine = quadrature(wall, (96, 12, 12))
        side = sign * (fine.points[:, 0] - 0.3) < 0
        assert found == pytest.approx(fine.weights[side].sum(), rel=0.02)
    assert domain.volume.in_space().integrate() == pytest.approx(solid.integrate(), rel=1e-4)
    np.testing.assert_allclose(domain.interface.points[:, 0], 0.3, atol=1e-5)
    np.testing.assert_allclose(domain.interface.normals[:, 0], 1.0, atol=1e-4)
    assert len(domain.parts) == 1


def test_a_wall_of_one_material_is_the_same_when_it_is_divided():
    wall = il.Lattice("gyroid", through=il.macroshape.box((1, 1, 1.2))).offset(0.15)
    answers = []
    for options in ({}, {"phases": "x + 0.3*y - 0.61"}):
        problem = Elasticity(wall, 10, stabilization="ghost", **options)
        problem = problem.clamp("w=0").load(traction=(0.2, 0, -1.0), on="w=1")
        answers.append(problem.solve())
    # stiffer ghost penalties on one side, further functions on the other
    assert answers[1].compliance == pytest.approx(answers[0].compliance, rel=0.02)
    assert answers[1].report.discretization_error > 0.0


def test_phases_that_touch_are_one_part_and_gaps_stay_open():
    bar = Elasticity(whole, 4, domain=CUBE, phases="x - 0.5")
    assert len(bar.domain.parts) == 1
    apart = il.fields.union(
        il.fields.box((1.0, 1.0, 0.2)), il.fields.translate(il.fields.box((1, 1, 0.2)), (0, 0, 0.6))
    )
    grid = Grid([np.linspace(-0.5, 0.5, 5), np.linspace(-0.5, 0.5, 5), np.linspace(-0.3, 0.8, 7)])
    two = Elasticity(apart, grid, phases="x - 0.11", young=(1.0, 3.0))
    assert len(two.domain.parts) == 2


def test_modes_of_a_composite_rod_are_those_of_its_parts():
    """Axial waves: a stiff half and a heavy half of a rod, held at one end."""
    E, rho, at, L = (4.0, 1.0), (1.0, 2.5), 1.3, 3.0
    rod = Elasticity(
        whole, (1, 1, 12), domain=[[0, 0, 0], [0.4, 0.4, L]], young=E, poisson=0.0, density=rho,
        phases=f"z - {at}", degree=3,
    )  # fmt: skip
    rod = rod.clamp("w=0").clamp("u=0", components="x").clamp("v=0", components="y")
    rod = rod.clamp("u=1", components="x").clamp("v=1", components="y")
    found = natural_modes(rod, 2).omega
    c = np.sqrt(np.array(E) / rho)
    z = np.sqrt(np.array(E) * rho)

    def lack(w):
        return z[0] * np.cos(w * at / c[0]) * np.cos(w * (L - at) / c[1]) - z[1] * np.sin(
            w * at / c[0]
        ) * np.sin(w * (L - at) / c[1])

    w = np.linspace(0.01, 6.0, 60001)
    roots = w[:-1][np.diff(np.sign(lack(w))) != 0]
    np.testing.assert_allclose(found, roots[:2], rtol=1e-3)


# ------------------------------------------------------------------------------ doors


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"young": (1.0, 2.0)}, "pair of them with phases="),
        ({"young": (1.0, 2.0, 3.0), "phases": "x-0.5"}, "pair of them with phases="),
        ({"young": (1.0, -2.0), "phases": "x-0.5"}, "young must be above 0"),
        ({"phases": "0.5"}, "is a number"),
        ({"phases": 3}, "phases must be a level set"),
        ({"phases": "x + u"}, "mixes"),
        ({"phases": lambda x: x}, "one value per point"),
        ({"phases": lambda x: np.full(len(x), np.nan)}, "phases"),
        ({"phases": "x-0.5", "stabilization": "void"}, "'auto' or 'ghost'"),
    ],
)
def test_wrong_phases_are_refused(options, words):
    with pytest.raises(InputError, match=words):
        Elasticity(whole, 3, domain=CUBE, **options)


@pytest.mark.parametrize(("at", "which"), [(2.0, "second"), (-1.0, "first")])
def test_empty_phases_are_refused(at, which):
    with pytest.raises(GeometryError, match=f"{which} phase"):
        Elasticity(whole, 3, domain=CUBE, phases=f"x - ({at})")


@pytest.mark.parametrize("waves", [0.7, 0.9, 1.0, 2.0, 3.5])
def test_materials_that_wave_inside_of_cells_are_told(waves):
    def property_of(x):
        return 1.2 + np.sin(2 * np.pi * 5 * waves * x[:, 0] + 0.3)

    for degree in (1, 2):
        problem = Elasticity(whole, (5, 2, 2), domain=CUBE, young=property_of, degree=degree)
        with pytest.warns(PrecisionWarning, match=r"young jumps or waves .* within a cell"):
            assert problem.clamp("u=0").matrix.shape
        heat = Heat(whole, (5, 2, 2), domain=CUBE, conductivity=property_of, degree=degree)
        with pytest.warns(PrecisionWarning, match="conductivity jumps or waves"):
            assert heat.fix("u=0", 0.0).matrix.shape


def test_jumps_inside_of_cells_are_warned_of():
    jumping = Elasticity(
        whole, 5, domain=CUBE, young=lambda x: np.where(x[:, 2] < 0.43, 1.0, 100.0)
    ).clamp("w=0")
    with pytest.warns(PrecisionWarning, match=r"young jumps .* within a cell.*phases="):
        jumping.load(traction=(0, 0, 1.0), on="w=1").solve()
    graded = Elasticity(whole, 5, domain=CUBE, young=lambda x: np.exp(6 * x[:, 2])).clamp("w=0")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "the cells are too coarse")
        graded.load(traction=(0, 0, 1.0), on="w=1").solve()
    melting = Heat(whole, 5, domain=CUBE, conductivity=lambda x: np.where(x[:, 0] < 0.3, 1, 9))
    with pytest.warns(PrecisionWarning, match="conductivity jumps"):
        melting.fix("w=0", 0.0).fix("w=1", 1.0).solve()


@pytest.mark.parametrize("seed", range(4))
def test_volumes_of_slabs_in_and_around_boxes_add_up(seed):
    """Pairs of functions and a tree: three level sets, of which bounds decide the last one."""
    rng = np.random.default_rng(seed)
    n = rng.standard_normal(3)
    n /= np.linalg.norm(n)
    middle, t, half = rng.uniform(0.4, 0.6, 3), 0.17, rng.uniform(0.2, 0.3, 3)
    slab = (lambda u: (u - middle) @ n - t, lambda u: (middle - u) @ n - t)
    inner = il.fields.translate(il.fields.box(tuple(half)), tuple(middle))
    domain = Elasticity(slab, 4, domain=CUBE, phases=inner).domain
    u = np.random.default_rng(9).random((400_000, 3))
    solid, first = (slab[0](u) < 0) & (slab[1](u) < 0), inner(u) < 0
    second = domain.elements.second[domain.volume.cells][domain.volume.owners]
    for k in (0, 1):
        found = domain.volume.weights[second == bool(k)].sum()
        assert found == pytest.approx((solid & (first != bool(k))).mean(), abs=4e-3)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["function", "equation"])
def test_a_level_set_at_a_step_of_the_solid_joins_what_touches(seed, kind):
    """The phases hung together nowhere: all points were said to lie on the solid's own face."""
    rng = np.random.default_rng(seed)
    wide, narrow = rng.uniform(0.5, 0.7, 2), rng.uniform(0.15, 0.4, 2)
    low, top, z = rng.uniform(-0.9, -0.3), rng.uniform(0.6, 0.9), rng.uniform(-0.1, 0.4)
    wide_z, narrow_z = ((low, z), (0.5 * (low + z), top))
    if rng.random() < 0.5:  # the wide one above
        wide_z, narrow_z = ((z, top), (low, 0.5 * (z + top)))

    def block(half, ends):
        size, centre = 0.5 * (ends[1] - ends[0]), 0.5 * (ends[0] + ends[1])
        return il.fields.translate(il.fields.box((*half, size)), (0, 0, centre))

    solid = il.fields.union(block(wide, wide_z), block(narrow, narrow_z))
    phases = f"z-({z!r})" if kind == "equation" else lambda x: x[:, 2] - z
    domain = [[-1.0] * 3, [1.0] * 3]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PrecisionWarning)
        held = Elasticity(
            solid, tuple(rng.integers(4, 8, 3)), domain=domain, phases=phases, young=(1.0, 2.0)
        )  # fmt: skip
        between = held.domain.interface
    area = 4.0 * narrow.prod()
    assert between.weights.sum() == pytest.approx(area, rel=1e-9)
    assert np.allclose(between.normals, (0, 0, 1), atol=1e-9)


def test_areas_that_a_step_makes_uncertain_are_told():
    solid = il.fields.union(
        il.fields.box((0.6, 0.6, 0.313)),
        il.fields.translate(il.fields.box((0.2, 0.2, 0.3)), (0, 0, 0.4)),
    )
    options = {"domain": [[-1.0] * 3, [1.0] * 3], "young": (1.0, 2.0)}
    with pytest.warns(PrecisionWarning, match="level set lies on faces of the solid"):
        held = Elasticity(solid, 6, phases="z - 0.313", **options)
    assert len(held.domain.interface)


# ------------------------------------------------------------------------------ hard and soft


def composite(kind, seed, contrast, **options):
    """A cube in which a wavy surface between a soft and a hard phase cuts the cells anyhow."""
    rng = np.random.default_rng(seed)
    s, k = rng.uniform(0, 6, 3), rng.uniform(5.0, 7.0)
    x, y, z = (f"({k:.4f}*{v}+{t:.4f})" for v, t in zip("xyz", s, strict=True))
    wavy = f"sin{x}*cos{y} + sin{y}*cos{z} + sin{z}*cos{x} - 0.2"
    axes = [np.append(0.0, np.cumsum(rng.uniform(0.5, 1.5, n))) for n in (3, 4, 3)]
    grid = Grid([a / a[-1] for a in axes])
    pair = {name: (v, v * contrast) for name, v in options.pop("soft").items()}
    return kind(whole, grid, phases=wavy, **pair, **options), rng


def of_the_first(problem, values):
    """Coefficients of a field that is there in the first phase, and zero in the second."""
    space = problem.assembly.space
    second = problem.domain.elements.second[space.cells]
    c = np.array(values, np.float64)
    c[np.unique(space.dofs[second])] = 0.0
    assert c.any()
    return c


def volumes_of(problem):
    return [float(r.weights.sum()) for r in problem.domain.of_phases(problem.domain.volume)]


@pytest.mark.parametrize(("seed", "contrast"), [(0, 1e6), (1, 1e9), (2, 1e9)])
@pytest.mark.parametrize("full", [False, True])
def test_what_is_soft_stays_soft_beside_what_is_hard(seed, contrast, full):
    """Points of rules may be on the other side by rounding: an element has one material."""
    soft = {"density": 2.0, "strength": 3.0, "expansion": 1e-2}
    C = il.cutfem.orthotropic(young=1.3, poisson=0.3)
    if full:
        problem, rng = composite(Elasticity, seed, contrast, soft=soft, stiffness=(C, contrast * C))
    else:
        problem, rng = composite(
            Elasticity, seed, contrast, soft={**soft, "young": 1.3}, poisson=0.3
        )
    problem = problem.clamp("w=0", method="nitsche")
    heated = problem.load(temperature=2.0)
    G, V = rng.standard_normal((3, 3)), volumes_of(problem)[0]
    c = of_the_first(problem, problem.assembly.coordinates @ G.T)
    solution = il.cutfem.Solution(problem, c, None)
    e = 0.5 * (G + G.T)[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]] * [1, 1, 1, 2, 2, 2]
    stress = C @ e
    assert solution.energy == pytest.approx(0.5 * V * e @ stress, rel=1e-9)
    rule = problem.domain.solid(problem.assembly)
    first = ~problem.domain.elements.second[rule.cells][rule.owners]
    expected = np.where(first[:, None], stress, 0.0)
    np.testing.assert_allclose(solution.stress_on(rule), expected, atol=1e-9)
    yields = il.cutfem.stresses.von_mises(stress[None])[0]
    assert solution.safety_factor == pytest.approx(3.0 / yields, rel=1e-9)
    assert solution.error_estimate().relative < 1e-6
    free = il.cutfem.Solution(heated, c, None)
    strain = e - 2.0 * 1e-2 * np.array([1, 1, 1, 0, 0, 0])
    # what is held and heated in the hard phase has energy of its own
    hard = il.cutfem.Solution(heated, 0.0 * c, None)
    held = 0.5 * 0.02**2 * C[:3, :3].sum() * V
    assert free.energy - hard.energy == pytest.approx(
        0.5 * V * strain @ C @ strain - held, rel=1e-6, abs=1e-9 * abs(hard.energy)
    )
    one = of_the_first(problem, np.ones((len(c), 3)))
    assert (one.ravel() @ (problem.mass() @ one.ravel())) == pytest.approx(6.0 * V, rel=1e-9)
    weight = (problem.load(gravity=(1.0, 2.0, -3.0)).forces() * one).sum(axis=0)
    np.testing.assert_allclose(weight, 2.0 * V * np.array([1.0, 2.0, -3.0]), rtol=1e-9)
    # a support in the mean pulls the soft part of it with soft springs
    pulled = problem.matrix @ one.ravel()
    far = np.abs(pulled).max()
    assert far < 1e3 * 1.3


@pytest.mark.parametrize(("seed", "contrast"), [(0, 1e6), (3, 1e9)])
def test_heat_of_what_conducts_little_beside_what_conducts_well(seed, contrast):
    problem, rng = composite(
        Heat, seed, contrast, soft={"conductivity": 1.3, "capacity": 0.7}, degree=2
    )
    problem = problem.fix("w=0", 0.0, method="nitsche")
    g, V = rng.standard_normal(3), volumes_of(problem)[0]
    c = of_the_first(problem, (problem.assembly.coordinates @ g)[:, None])
    solution = il.cutfem.HeatSolution(problem, c, None)
    rule = problem.domain.solid(problem.assembly)
    first = ~problem.domain.elements.second[rule.cells][rule.owners]
    expected = np.where(first[:, None], -1.3 * g, 0.0)
    np.testing.assert_allclose(solution.heat_flux_on(rule), expected, atol=1e-9)
    assert problem._solid_energy(c) == pytest.approx(1.3 * V * g @ g, rel=1e-9)
    assert solution.error_estimate().relative < 1e-6
    one = il.cutfem.HeatSolution(problem, of_the_first(problem, np.ones((len(c), 1))), None)
    assert one.stored == pytest.approx(0.7 * V, rel=1e-9)


@pytest.mark.parametrize("p", [1, 2])
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("soft", ["first", "second"])
def test_thin_coats_leave_what_they_cover_as_it_is(p, seed, soft):
    """Tractions of a thin layer were weighed as if it were a cell deep: K was not positive."""
    rng = np.random.default_rng([seed, p])
    d, contrast = 10.0 ** rng.uniform(-4.5, -2.7), 10.0 ** rng.uniform(1, 2)
    n = (6, 2, int(rng.integers(2, 4)))
    box = [[0, 0, 0], [4, 1, 1]]
    young = (1.0, contrast) if soft == "first" else (contrast, 1.0)
    at = f"{1 - d!r} - z" if soft == "first" else f"z - {1 - d!r}"
    coated = Elasticity(whole, n, domain=box, degree=p, young=young, phases=at)
    bare = Elasticity(whole, n, domain=box, degree=p, young=contrast, stabilization="ghost")
    coated, bare = (
        q.clamp("u=0").load(body=(0.1, 0.2, -1.0)).solve() for q in (coated, bare)
    )  # fmt: skip
    assert coated.compliance == pytest.approx(bare.compliance, rel=8 * d + 0.01 * (p == 1))
    K = coated.problem.matrix.toarray()
    scale = 1.0 / np.sqrt(K.diagonal())
    assert np.linalg.eigvalsh(K * scale * scale[:, None])[0] > -1e-12
    k = (1.0, contrast) if soft == "first" else (contrast, 1.0)
    warm = Heat(whole, n, domain=box, degree=p, conductivity=k, phases=at)
    flow = warm.fix("u=0", 0.0).fix("u=1", 1.0).solve().inflow["u=1"]
    assert flow == pytest.approx(contrast / 4 * (1 - d) + d / 4, rel=1e-6)
