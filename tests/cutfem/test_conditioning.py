"""Slivers: condition numbers and iterations do not depend on how cells are cut."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import ilattice as il
from ilattice.cutfem import Elasticity
from ilattice.quadrature.grid import CUT

#: Numbers on coarse grids are what is tested here.
pytestmark = pytest.mark.filterwarnings("ignore:the cells are too coarse")


def scaled_condition(problem):
    K = problem.system.K.toarray()
    d = 1 / np.sqrt(np.diag(K))
    values = np.linalg.eigvalsh(d[:, None] * K * d)
    return values[-1] / values[0]


def sliver(kind, eta, cells=4, **options):
    """A cube whose last layer of cells is cut to a part eta, in one direction, two or all.

    On 4 cells the functions of the end are cut, on 5 inner ones.
    """
    end, size = 0.75 + 0.25 * eta, 0.25 * cells
    axes = {"slab": (0,), "edge": (0, 1), "corner": (0, 1, 2)}[kind]
    corner = il.fields.intersection(*(il.fields.half_space(np.eye(3)[a], end) for a in axes))
    cut = il.cutfem.cut(corner, cells, domain=[[0.0] * 3, [size] * 3], degree=1)
    return Elasticity(cut, **options).clamp("u=0")


@pytest.mark.parametrize(("kind", "most"), [("slab", 150), ("corner", 190)])
def test_diagonal_scaling_bounds_the_condition_of_degree_one(kind, most):
    raw = []
    for eta in (0.5, 0.1, 1e-2, 1e-4, 1e-8, 1e-12):
        problem = sliver(kind, eta, degree=1)
        assert scaled_condition(problem) < most
        raw.append(np.linalg.cond(problem.system.K.toarray()))
    assert max(raw) > 1e5  # what is bounded is not bounded by itself


@pytest.mark.parametrize("kind", ["slab", "edge", "corner"])
@pytest.mark.parametrize(("p", "r", "cells"), [(2, 1, 4), (2, 1, 5), (2, 0, 4), (3, 2, 4)])
def test_ghost_penalty_bounds_the_condition_of_higher_degrees(p, r, cells, kind):
    whole = 1 - 1e-9 if cells == 5 else 1.5
    uncut = scaled_condition(sliver(kind, whole, cells, degree=p, smoothness=r))
    for eta in (0.5, 1e-2, 1e-12) if r == 0 else (0.7, 0.5, 0.1, 1e-2, 1e-12):
        assert scaled_condition(sliver(kind, eta, cells, degree=p, smoothness=r)) < 3.5 * uncut
    if p == 3 and kind == "corner":
        bare = sliver(kind, 1e-2, cells, degree=p, stabilization="none")
        assert scaled_condition(bare) > 10 * uncut


def with_slivers(domain):
    """The same grid with a tenth of the cut cells thinned out by up to 1e-6."""
    rule, rng = domain.volume, np.random.default_rng(1)
    chosen = np.isin(rule.cells, domain.cut.cells(CUT)) & (rng.random(len(rule.cells)) < 0.1)
    scale = np.where(chosen, 10.0 ** (-6 * rng.random(len(chosen))), 1.0)
    new = replace(domain, _made={})
    weights = rule.weights * np.repeat(scale, np.diff(rule.offsets))
    new.__dict__["volume"] = replace(rule, weights=weights)
    return new


def sheet(u):
    return np.abs(il.tiles["schwarz_p"](u)) - 0.5


@pytest.mark.parametrize(
    ("solid", "cells", "p", "r"),
    [(il.tiles["schwarz_p"], 16, 1, 0), (sheet, 12, 1, 0), (sheet, 16, 1, 0),
     (il.tiles["schwarz_p"], 6, 2, 1), (il.tiles["schwarz_p"], 6, 2, 0),
     (il.tiles["schwarz_p"], 6, 3, 2)],
)  # fmt: skip
def test_slivers_cost_few_iterations_of_multigrid(solid, cells, p, r):
    box = [[0.0] * 3, [1.0] * 3]
    domain = Elasticity(solid, cells, domain=box, degree=p, smoothness=r).domain
    counts = []
    for where in (domain, with_slivers(domain)):
        problem = Elasticity(where).clamp("u=0").load(body=(0, 0, 1.0))
        counts.append(problem.solve(method="multigrid").report.iterations)
    assert 10 < counts[1] <= 1.3 * counts[0]


# ---------------------------------------------------------------- lone parts


def with_a_lone_cap(seed, degree):
    """A bar, and beside it the tip of a ball on the same support, in a cell or a few."""
    rng = np.random.default_rng(seed)
    bar = il.fields.translate(il.fields.box((0.45, 0.83, 1.1)), (0.47, 0.1, 0.0))
    r = 0.4 * rng.uniform(0.2, 0.8)
    height = 0.4 * 10 ** rng.uniform(-2, -0.6)
    at = (rng.uniform(-0.8, -0.6), rng.uniform(-0.5, 0.5), -1 - r + height)
    body = il.fields.union(bar, il.fields.translate(il.fields.sphere(r), at))
    problem = Elasticity(body, 5, domain=[[-1] * 3, [1] * 3], degree=degree)
    assert len(problem.domain.parts) == 2
    return bar, problem.clamp("w=0").load(body=(0, 0.3, -1.0))


@pytest.mark.parametrize("degree", [2, 3])
@pytest.mark.parametrize("seed", [0, 4, 5])
def test_parts_of_few_badly_filled_cells_hold_themselves(seed, degree):
    bar, problem = with_a_lone_cap(seed, degree)
    alone = Elasticity(bar, 5, domain=[[-1] * 3, [1] * 3], degree=degree)
    alone = alone.clamp("w=0").load(body=(0, 0.3, -1.0)).solve().compliance
    with_cap = problem.solve().compliance
    assert alone < with_cap < alone * (1 + 1e-3)  # the cap carries itself, and next to nothing


def test_what_holds_lone_cells_spares_linear_fields():
    problem = with_a_lone_cap(0, 3)[1]
    space, lone = problem.assembly.space, problem.assembly.lone
    rows, A = lone.matrices(space, problem.assembly.jacobians, None)
    u, h = space.interpolate(lambda u: u).reshape(-1, 3), 0.4
    linear = (1 + u @ [1.0, -2.0, 0.5])[space.functions][space.dofs[rows]]
    assert np.abs(np.einsum("nij,nj->ni", A, linear)).max() < 1e-14 * np.abs(A).max()
    square = space.interpolate(lambda u: u[:, :1] ** 2).ravel()[space.functions][space.dofs[rows]]
    # t² in a cell of height h, of which 1/12 is linear: its square has the mean 1/180
    taken = np.einsum("ni,nij,nj->n", square, A, square)
    np.testing.assert_allclose(
        taken, lone.weights * h**3 * h**4 / 180, rtol=1e-9
    )  # of (t² - 1/12)²


@pytest.mark.parametrize("k", [8, 14, 40, 56])
def test_crumbs_of_opaque_solids_are_held(k):
    """A part of 1e-9 of a cell, held in the mean: K had a negative diagonal."""
    rng = np.random.default_rng(k)
    f = il.fields.rotate(
        il.fields.box(rng.uniform(0.2, 0.6, 3)), rng.uniform(0, 3), rng.normal(size=3)
    )
    f = il.fields.union(
        f, il.fields.translate(il.fields.sphere(rng.uniform(0.2, 0.4)), rng.uniform(-0.4, 0.4, 3))
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        problem = il.cutfem.Elasticity(lambda x: f(x), 6, domain=[[-1.0] * 3, [1.0] * 3])
        problem = problem.clamp("surface").load(body=(0.1, 0.2, 0.3))
        assert problem.matrix.diagonal().min() > 0.0
        assert 0.0 < problem.solve().energy < 1.0


@pytest.mark.parametrize(("degree", "smoothness"), [(1, None), (2, None), (2, 0), (3, None)])
@pytest.mark.parametrize("seed", range(3))
def test_specks_beside_a_body_change_nothing(degree, smoothness, seed):
    """Of a thousandth of a cell and less, 0.2 to 1.5 cells away, held by springs as the body is.

    K was singular at degree 3.
    """
    rng = np.random.default_rng([23, seed])
    h = 2.0 / 5
    n = rng.standard_normal(3) * [1, 1, 0.2]
    n /= np.linalg.norm(n)
    body = il.fields.half_space(tuple(n), rng.uniform(-0.2, 0.1))
    away = rng.uniform(0.2, 1.5) * h
    radius = h * (10 ** rng.uniform(-5, -3) * 0.75 / np.pi) ** (1 / 3)
    foot = n * float(-body([[0.0, 0.0, 0.0]])[0]) + np.cross(n, rng.uniform(-0.5, 0.5, 3))
    speck = il.fields.translate(il.fields.sphere(radius), tuple(foot + (away + radius) * n))
    sunk = []
    for solid in (body, il.fields.union(body, speck)):
        problem = Elasticity(
            solid, 5, domain=[[-1] * 3, [1] * 3], degree=degree, smoothness=smoothness
        )
        problem = problem.clamp("w=0").spring("surface", 1e-2)
        sunk.append(problem.load(traction=(0.3, 0.2, 1.0), on="w=1").solve().compliance)
    assert len(problem.domain.parts) == 2
    assert sunk[1] == pytest.approx(sunk[0], rel=1e-5)
