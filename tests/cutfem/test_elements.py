"""Pieces of solid inside cells, and functions that no air carries: a second body changes nothing.

The reference is the same body alone on the same grid, or a rigid motion that is known.
"""

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy import linalg, ndimage

import ilattice as il
from ilattice.cutfem.elements import elements_of
from ilattice.cutfem.space import SplineSpace
from ilattice.errors import PrecisionWarning
from ilattice.linalg.solvers import Solver
from ilattice.quadrature import _kernels_solid as boxes

#: Numbers on coarse grids are what is tested here.
pytestmark = pytest.mark.filterwarnings("ignore:the cells are too coarse")

H = 1 / 8
GRID = il.cutfem.Grid((np.linspace(0, 0.375, 4),) * 2 + (np.linspace(0, 1, 9),))
SPACES = [(1, None), (2, None), (2, 0), (3, None)]


def gap(rng, cells, oblique):
    """Two blocks with air of some cells between, as one polynomial."""
    n = np.array([0, 0, 1.0]) + oblique * rng.uniform(-0.6, 0.6, 3)
    n /= np.linalg.norm(n)
    c = np.array([0.1875, 0.1875, 0.4]) @ n + rng.random() * H
    return lambda u: (u @ n - c) * (c + cells * H - u @ n)


class Turned:
    """The same anywhere in space, along x, y or z, and from below or from above."""

    def __init__(self, rng, oblique):
        self.axis, self.turned = (int(k) for k in rng.integers((3, 2)))
        across = [k for k in range(3) if k != self.axis]
        shape = np.full(3, 8)
        shape[across] = rng.integers(2, 5, 2)
        self.size = shape * H * rng.uniform(0.8, 1.25, 3)
        self.low = rng.uniform(-2, 2, 3)
        self.grid = il.cutfem.Grid(
            tuple(self.low[k] + np.linspace(0, self.size[k], shape[k] + 1) for k in range(3))
        )
        self.n = np.eye(3)[self.axis]
        if oblique:
            self.n[across] = rng.uniform(-0.6, 0.6, 2)
        self.n /= np.linalg.norm(self.n)
        h = self.size[self.axis] / 8
        self.width = rng.uniform(1.0 if oblique else 0.5, 2.2) * h
        middle = self.low + np.where(self.n == self.n.max(), 0.4, 0.5) * self.size
        self.at = middle @ self.n + rng.uniform(-0.5, 0.5) * h
        ends = tuple(f"{'uvw'[self.axis]}={k}" for k in (0, 1))
        self.held, self.free = ends[::-1] if self.turned else ends
        self.push = np.eye(3)[self.axis] * (1.0 if self.turned else -1.0)

    def __call__(self, u):
        return (u @ self.n - self.at) * (self.at + self.width - u @ self.n)

    def points(self, rng, at):
        """Random points at a height, 0 where it is held, 1 where it is free."""
        x = rng.uniform(0.1, 0.9, (4, 3))
        x[:, self.axis] = 1.0 - at if self.turned else at
        return self.low + x * self.size

    def swings(self, k):
        """Frequencies of the free block as a rigid one, on springs of k per area of its end."""
        x, w = np.polynomial.legendre.leggauss(6)
        t = np.stack(np.meshgrid(x, x, x, indexing="ij"), axis=-1).reshape(-1, 3) / 2 + 0.5
        area = np.delete(self.size, self.axis).prod()
        weights = (w[:, None, None] * w[:, None] * w).ravel() / 8 * area
        p, end = self.low + t * self.size, self.low.copy()
        end[self.axis] += 0.0 if self.turned else self.size[self.axis]
        side = self.at + (0.0 if self.turned else self.width)
        rest = np.where(np.arange(3) == self.axis, 0.0, p)
        start = (side - rest @ self.n) / self.n[self.axis]
        inner, outer = p.copy(), p.copy()
        outer[:, self.axis] = end[self.axis]
        inner[:, self.axis] = start + t[:, self.axis] * (end[self.axis] - start)
        mass, spring = (
            np.einsum("p,pij,pik->jk", f * weights, m, m)
            for f, m in (
                (np.abs(end[self.axis] - start), rigid(inner - end)), (k, rigid(outer - end))
            )
        )  # fmt: skip
        return np.sqrt(linalg.eigh(spring, mass, eigvals_only=True))


def rigid(x):
    """Displacements (n, 3, 6) of points by motions of a rigid body."""
    turns = [np.cross(e, x) for e in np.eye(3)]
    moves = [np.broadcast_to(e, x.shape) for e in np.eye(3)]
    return np.stack([*moves, *turns], axis=-1)


@pytest.mark.parametrize(("degree", "smoothness"), SPACES)
@pytest.mark.parametrize("seed", range(10))
def test_a_body_across_a_gap_hangs_on_its_springs_alone(degree, smoothness, seed):
    """At twenty random offsets and directions for every space."""
    rng = np.random.default_rng([7, seed])
    for oblique in (0, 1):
        field = Turned(rng, oblique)
        problem = il.cutfem.Elasticity(field, field.grid, degree=degree, smoothness=smoothness)
        load = problem.clamp(field.held).spring(field.free, 1e-3)
        solution = load.load(traction=tuple(field.push), on=field.free).solve()
        sunk = solution.evaluate(field.points(rng, 0.999)) @ field.push
        np.testing.assert_allclose(sunk, 1000.0, rtol=1e-2)
        assert len(problem.domain.parts) == 2
        warm = il.cutfem.Heat(field, field.grid, degree=degree, smoothness=smoothness)
        warm = warm.fix(field.held, 1.0).convection(field.free, 1e-3, around=5.0).solve()
        for at, known in ((0.01, 1.0), (0.99, 5.0)):
            np.testing.assert_allclose(warm.evaluate(field.points(rng, at)), known, rtol=1e-9)


@pytest.mark.parametrize(("degree", "smoothness"), SPACES)
def test_a_body_across_a_gap_swings_on_its_springs_alone(degree, smoothness):
    for oblique in (0, 1):
        field = Turned(np.random.default_rng([8, degree, oblique]), oblique)
        problem = il.cutfem.Elasticity(field, field.grid, degree=degree, smoothness=smoothness)
        problem = problem.clamp(field.held).spring(field.free, 1e-3)
        found = il.cutfem.natural_modes(problem, 6).omega
        np.testing.assert_allclose(found, field.swings(1e-3), rtol=1e-2)


def columns(only, degree, smoothness, along):
    """Two columns whose gap of 0.55 cells is not parallel to the grid; or one of them."""
    order = [(k - along + 2) % 3 for k in range(3)]  # the last of three stands up

    def field(u):
        v = np.empty_like(u)
        v[:, order] = u
        x = v[:, 0] - 0.03 * v[:, 2] + 0.1 * v[:, 1]
        low, high = x - 0.272, 0.341 - x
        return {"low": low, "high": high, "both": low * high}[only]

    axes = np.linspace(0, 0.625, 6), np.linspace(0, 0.25, 3), np.linspace(0, 1, 5)
    problem = il.cutfem.Elasticity(
        field, il.cutfem.Grid(tuple(axes[k] for k in order)), density=2.0, degree=degree,
        smoothness=smoothness,
    )  # fmt: skip
    return problem.clamp(f"{'uvw'[along]}=0"), order


@pytest.mark.parametrize(("degree", "smoothness"), SPACES)
def test_a_second_column_beside_it_changes_neither_modes_nor_buckling(degree, smoothness):
    modes, factors, c = {}, {}, {}
    points = np.array([[0.1, 0.1, 0.9], [0.24, 0.2, 0.5]])
    along = degree - 1
    for only in ("low", "high", "both"):
        problem, order = columns(only, degree, smoothness, along)
        modes[only] = il.cutfem.natural_modes(problem, 3).omega
        load = problem.load(traction=tuple(-np.eye(3)[along]), on=f"{'uvw'[along]}=1")
        solution = load.solve(tol=1e-11)
        factors[only] = il.cutfem.buckling(solution, 2).factors
        c[only] = solution.evaluate(points[:, order])
    close = 1e-5 if degree == 1 else 1e-7  # the void has a weight of 4e-9
    np.testing.assert_allclose(c["both"], c["low"], rtol=close, atol=1e-2 * close)
    for found in (modes, factors):
        known = np.sort(np.concatenate([found["low"], found["high"]]))[: len(found["both"])]
        np.testing.assert_allclose(found["both"], known, rtol=10 * close)


@pytest.mark.parametrize("seed", range(4))
def test_what_bounds_decide_of_a_solid_does_not_depend_on_signs(seed):
    rng = np.random.default_rng([13, seed])
    slope = rng.standard_normal((2, 3)) + 2.0
    t = np.stack(np.meshgrid(*[np.linspace(0, 1, 4)] * 3, indexing="ij"), -1).reshape(-1, 3)
    c = t @ slope.T
    c = (c - c.mean(axis=0) + 0.1 * rng.standard_normal(2)).T.copy()  # linear: the coefficients
    tol = boxes.tolerances(c)

    def sort(c, signs):
        """With solid where polynomial k is negative if bit k is set, positive if not."""
        table = sum(1 << b for b in range(64) if b % 4 == signs)
        return boxes.sort_of(c, 2, 4, tol, table - (table >> 63 << 64))

    sorts = [sort(c, signs) for signs in range(4)]
    flipped = [sort(c * [[1 - 2 * (1 - i % 2)], [1 - 2 * (1 - i // 2)]], 3) for i in range(4)]
    assert sorts == flipped
    assert boxes.SINGLE in sorts


@pytest.mark.parametrize("seed", range(6))
def test_pieces_of_cells_are_those_that_fine_samples_find(seed):
    rng = np.random.default_rng([11, seed])
    c = rng.standard_normal((6, 6, 6))
    t = np.concatenate([[0, 0], np.linspace(0, 1, 5), [1, 1]])
    field = il.BSpline((t,) * 3, c, 2)
    cut = il.cutfem.cut(field, 2)
    rule = cut.volume(3)
    grid, by_elements = elements_of(cut, rule)
    again = grid.divided(rule)
    np.testing.assert_array_equal(by_elements.points, again.points)
    np.testing.assert_array_equal(by_elements.cells, again.cells)
    np.testing.assert_array_equal(by_elements.offsets, again.offsets)
    n = 65
    x = np.linspace(0, 0.5, n)
    for cell in range(8):
        low = grid.boxes(np.array([cell]))[0, :3]
        u = np.stack(np.meshgrid(*(low[a] + x for a in range(3)), indexing="ij"), -1).reshape(-1, 3)
        inside = (field(u) < 0).reshape(n, n, n)
        labels, count = ndimage.label(inside)
        found = grid.element_at(u, np.full(len(u), cell)).reshape(n, n, n)
        for k in range(1, count + 1):  # what hangs together stays together
            assert len(np.unique(found[labels == k])) == 1
        wide = ndimage.label(ndimage.binary_dilation(inside, iterations=3))[0]
        for k in np.unique(wide[np.isin(labels, np.flatnonzero(np.bincount(labels.ravel()) > 40))]):
            others = found[inside & (wide > 0) & (wide != k)]  # what is clearly apart is so
            assert k == 0 or not np.isin(found[inside & (wide == k)], others).any()


@pytest.mark.parametrize("seed", range(3))
def test_bodies_beside_each_other_are_two_whatever_their_gap_is(seed):
    """Unions have boxes of many sizes within cells."""
    rng = np.random.default_rng([19, seed])
    fields = il.fields
    for _ in range(8):
        n = rng.standard_normal(3)
        n /= np.linalg.norm(n)
        cells = int(rng.integers(2, 6))
        g, at = rng.uniform(0.05, 0.9) * 2 / cells, rng.uniform(-0.2, 0.2)
        sides = [fields.half_space(tuple(s * n), s * at - g / 2) for s in (1.0, -1.0)]
        kept = [fields.intersection(side, fields.rotate(fields.box(0.7), 0.5, (1, 2, 3.0)))
                for side in sides]  # fmt: skip
        for two in (fields.union(*sides), fields.union(*kept)):
            domain = il.cutfem.Elasticity(two, cells, domain=[[-1] * 3, [1] * 3]).domain
            measured = np.bincount(domain.parts.labels, domain.volume.integrate_cells())
            assert (measured > 1e-3).sum() == 2


def rough(rng, kind):
    """Random field on two cells per direction, each of three pieces: a plane, a valley in it."""
    n, m = rng.standard_normal((2, 3))
    t = np.concatenate([[0, 0], np.linspace(0, 1, 7), [1, 1]])
    x = np.stack(np.meshgrid(*[np.linspace(0, 1, 8)] * 3, indexing="ij"), -1) - 0.5
    valley = -3.0 * (x @ m - 0.2 * rng.standard_normal()) ** 2
    c = x @ n + (kind == "valley") * valley
    if kind == "joint":  # round struts along the axes, which meet
        far = np.stack([np.delete((x + 0.05 * m) ** 2, a, axis=-1).sum(axis=-1) for a in range(3)])
        c = -np.log(np.exp(-20.0 * far).sum(axis=0)) / 20.0
    c += (0.3 if kind == "noise" else 0.01) * rng.standard_normal(c.shape)
    return il.BSpline((t,) * 3, c - np.quantile(c, rng.uniform(0.3, 0.7)), 2)


def bounded_by(rng, kind):
    """Random solids that splines with the same knots bound: one, a band, or two of them."""
    f = rough(rng, {"bands": "valley", "two": "valley"}.get(kind, kind))
    if kind.startswith("band"):
        d = rng.uniform(0.1, 0.6)
        return tuple(il.BSpline(f.t, s * f.c - d, f.k) for s in (1.0, -1.0))
    if kind == "facing":  # nearly the same zero set, seen from both sides
        g = 0.03 * rng.standard_normal(f.c.shape) - rng.uniform(0, 0.05) - f.c
        return f, il.BSpline(f.t, g, f.k)
    return (f, il.BSpline(f.t, rough(rng, "plane").c - 0.8, f.k)) if kind == "two" else f


#: Part of the cells in which the short way must do.
KINDS = {"plane": 0.9, "valley": 0.5, "noise": 0, "band": 0.9, "bands": 0.3, "two": 0.3}
KINDS |= {"facing": 0, "joint": 0.9}
#: Kinds of solids that are one piece in every cell.
WHOLE = ("plane", "band", "joint")


@pytest.mark.parametrize("kind", KINDS)
def test_solid_that_stands_on_one_end_of_its_cell_is_one_piece(kind, monkeypatch):
    rng = np.random.default_rng([17, len(kind)])
    accepted, several = [], 0
    for _ in range(12):
        cut = il.cutfem.cut(bounded_by(rng, kind), 2)
        cells, rule = cut.cells(il.quadrature.grid.CUT), cut.volume(2)
        single, short = cut.layout.single(cells), elements_of(cut, rule)[0]
        with monkeypatch.context() as m:
            m.setattr(type(cut.layout), "single", lambda _, cells: np.zeros(len(cells), bool))
            plain = elements_of(cut, rule)[0]
        np.testing.assert_array_equal(short.several, plain.several)
        np.testing.assert_array_equal(short.parents, plain.parents)
        assert not np.isin(plain.several, cells[single]).any()
        accepted.append(single)
        several += len(plain.several)
    assert np.concatenate(accepted).mean() >= KINDS[kind]
    assert several == 0 if kind in WHOLE else several > 2


def test_air_that_is_too_thin_is_told_with_place_and_width():
    z = 0.5 + 0.37 * H
    for width in (1e-3, 1e-5):
        g = width * H
        field = lambda u, g=g: (u[:, 2] - z) * (z + g - u[:, 2])  # noqa: E731
        problem = il.cutfem.Elasticity(field, GRID).clamp("w=0").load(body=(0, 0, 1))
        told = rf"gap of \S+, {width:.2g} cells, near .*0.5625\)"
        with pytest.warns(PrecisionWarning, match=told):
            problem.assembly  # noqa: B018


NUMBERS = re.compile(r"-?\d[\d.]*(?:e[+-]?\d+)?")


def solid_at(n, c):
    """The half space below a plane."""
    return il.fields.half_space(tuple(n), float(n @ c))


@pytest.mark.parametrize("kind", ["gap", "one function", "point", "edge"])
@pytest.mark.parametrize("seed", range(2))
def test_oblique_air_that_is_too_thin_is_told_in_all_scales(kind, seed):
    """Nothing was told where neither the middle lines of boxes, nor the axes, cross the gap."""
    rng = np.random.default_rng([33, seed, len(kind)])
    size, cells = 10.0 ** rng.choice([-3, 0, 3]), int(rng.integers(4, 8))
    low = size * rng.uniform(-20, 20, 3) * (seed % 2)
    c, h = low + size * rng.uniform(0.42, 0.58, 3), size / cells
    n = rng.standard_normal(3)
    n *= np.sign(n[2])
    n[2] += 0.7
    n /= np.linalg.norm(n)
    g = 0.0 if kind in ("point", "edge") else h * 10 ** rng.uniform(-4, -1.6)
    if kind == "gap":
        solid = il.fields.union(solid_at(n, c), solid_at(-n, c + g * n))
    elif kind == "one function":
        plane = "+".join(f"({v:.17g})*{x}" for v, x in zip(n, "xyz", strict=True))
        solid = il.fields.equation(f"{g / 2:.17g}-abs({plane}-({n @ (c + g / 2 * n):.17g}))")
    elif kind == "edge":
        a = np.cross(n, rng.standard_normal(3))
        a /= np.linalg.norm(a)
        sides = [(solid_at(s * n, c), solid_at(s * a, c)) for s in (1, -1)]
        solid = il.fields.union(*(il.fields.intersection(*side) for side in sides))
    else:
        balls = [il.fields.sphere(0.9 * size)] * 2
        places = [c + s * 0.9 * size * n for s in (1, -1)]
        solid = il.fields.union(*map(il.fields.translate, balls, map(tuple, places)))
    problem = il.cutfem.Elasticity(solid, cells, domain=[low, low + size])
    with pytest.warns(PrecisionWarning, match="too thin to be resolved") as told:
        problem.spring("surface", 1.0).load(body=(0, 0, 1)).assembly  # noqa: B018
    assert len(told) == 1
    width, part, *place = map(float, NUMBERS.findall(str(told[0].message))[:5])
    assert abs((place - c) @ n) < 1.2 * h
    assert part == pytest.approx(width / h, rel=0.1)
    if g:
        assert g / 2 < width < 2 * g
    else:
        assert width < h / 20


def test_a_slit_that_ends_inside_the_solid_divides_nothing_and_warns_of_nothing():
    field = lambda u: 0.1**2 - (u[:, 2] - 0.47) ** 2 * 60 - (u[:, 0] - 0.19) ** 2  # noqa: E731
    problem = il.cutfem.Elasticity(field, GRID).clamp("w=0").load(body=(0, 0, 1))
    assert len(problem.domain.parts) == 1
    assert problem.solve().residual < 1e-7


def test_pictures_and_estimates_know_the_pieces(tmp_path):
    rng = np.random.default_rng(3)
    problem = il.cutfem.Elasticity(gap(rng, 0.6, 0), GRID)
    solution = problem.clamp("w=0").spring("w=1", 1e-3).load(traction=(0, 0, -1), on="w=1").solve()
    solid = solution.to_pyvista("solid")
    sunk = solid.point_data["displacement"][:, 2]
    upper = solid.points[:, 2] > 0.5 + H
    np.testing.assert_allclose(sunk[upper], -1000.0, rtol=1e-2)
    assert np.abs(sunk[solid.points[:, 2] < 0.4]).max() < 1.0
    estimate = solution.error_estimate()
    assert np.isfinite(estimate.relative)
    estimate.save(tmp_path / "error.vtu")
    assert solution.recovered().stress([[0.1, 0.1, 0.1]]).shape == (1, 6)


@pytest.mark.parametrize("degree", [2, 3])
def test_nodes_of_a_closed_grid_without_a_closed_map_stay_in_the_box(degree):
    axes = (np.linspace(0, 2, 9), np.linspace(0, 1, 5), np.linspace(0, 1, 5))
    slab = lambda u: (u[:, 1] - 0.83) * (u[:, 1] - 0.13)  # noqa: E731
    steps = {}
    for closed in (False, True):
        grid = il.cutfem.Grid(axes, (closed, False, False))
        problem = il.cutfem.Elasticity(slab, grid, degree=degree).clamp("w=0")
        x = problem.assembly.coordinates
        assert x.min() >= -1e-12
        assert (x.max(axis=0) <= [2 + 1e-12, 1 + 1e-12, 1 + 1e-12]).all()
        report = problem.load(body=(0, 1.0, 0)).solve(method="multigrid").report
        steps[closed] = report.iterations
    assert steps[True] <= 1.5 * steps[False]


def test_files_show_every_cell_once_and_foreign_rules_find_the_pieces(tmp_path):
    rng = np.random.default_rng(11)
    field = gap(rng, 0.7, 1)
    problem = il.cutfem.Elasticity(field, GRID, density=3.0)
    solution = problem.clamp("w=0").spring("w=1", 2.0).load(gravity=(0.3, 0, -1.0)).solve()
    assert len(problem.domain.elements.several)
    problem = solution.problem
    tetrahedra = solution.to_pyvista(on="solid", scale=0.0)
    sizes = tetrahedra.compute_cell_sizes()["Volume"]
    assert np.abs(sizes).sum() == pytest.approx(problem.domain.volume.integrate(), rel=0.05)
    solution.error_estimate().save(tmp_path / "a.vtu")
    boxes = np.unique(GRID.home(problem.domain.elements.home(problem.assembly.space.cells)))
    assert solution.to_pyvista(on="cells").n_cells == len(boxes)
    rule = problem.domain.cut.volume(2)
    stress = solution.stress_on(rule)
    assert np.abs(stress).max() > 0.1
    np.testing.assert_allclose(stress, solution.stress(rule.points), atol=1e-9)


def test_rules_beside_what_is_held_are_refused():
    problem = il.cutfem.Elasticity(gap(np.random.default_rng(2), 2.0, 0), GRID).clamp("w=0")
    with pytest.warns(PrecisionWarning, match="left out"):
        solution = problem.load(gravity=(0, 0, -1.0)).solve()
    with pytest.raises(il.errors.InputError, match="cells without functions"):
        solution.stress_on(problem.domain.cut.volume(2))


@pytest.fixture(scope="module")
def lattices():
    """A wall and struts in a torus, and struts in a duck, at four cells per tile."""
    torus, duck = il.macroshape.torus(major=4.0, width=2.0), il.macroshape.duck()
    wall = il.Lattice("schwarz_p", through=torus, repeat=(8, 2, 2), spans_per_tile=8)
    struts = il.Lattice("cross", through=torus, repeat=(8, 2, 2), spans_per_tile=8)
    beak = il.Lattice("cross", through=duck, repeat=(5, 2, 2), spans_per_tile=8)
    return {
        "wall": (wall.offset(0.0492), (32, 8, 8)),
        "struts": (struts.offset((np.inf, 0.064), space="parametric"), (32, 8, 8)),
        "duck": (beak.offset((np.inf, 0.0), space="parametric"), (20, 8, 8)),
    }


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
def test_two_sides_of_one_wall_get_few_more_unknowns_by_being_apart(lattices):
    """It was 16 % at degree 2 in the wall, and 12 % at degree 3 in the struts."""
    for name, (wall, cells) in lattices.items():
        domain = il.cutfem.Elasticity(wall, cells).domain
        for degree, smoothness in ((1, 0), (2, 1), (2, 0), (3, 2), (3, 0)):
            one = replace(domain, degree=degree, smoothness=smoothness, _made={})
            space = one.assembly(np.arange(len(one.parts)), weak=False).space
            known = len(np.unique(space.functions))
            assert len(space) <= 1.05 * known, (name, degree, smoothness, len(space), known)


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("name", ["torus", "duck"])
def test_copies_cost_few_iterations_of_multigrid(name, degree, monkeypatch):
    """Against one function on both sides of an oblique slit, two thirds of a cell wide."""
    through = il.macroshape.duck() if name == "duck" else il.macroshape.torus(major=4.0, width=2.0)
    low, high = through.domain
    cells = np.array([14, 7, 7] if degree == 3 else [20, 9, 9])

    def field(u):
        t = (u - low) / (high - low) * cells
        x = t[:, 1] + 0.2 * t[:, 2] + 0.3 * np.sin(2 * np.pi * t[:, 0] / cells[0])
        return 0.33**2 - (x - 4.03) ** 2 - 0.003 * (t[:, 0] - 0.53 * cells[0]) ** 2

    def iterations():
        problem = il.cutfem.Elasticity(
            field, tuple(cells), domain=through.domain, through=through, degree=degree
        )
        system = problem.clamp("v=0").clamp("v=1").load(body=(0.2, -0.1, 1e-3)).system
        how = {"near_nullspace": system.near_nullspace, "coordinates": system.coordinates}
        report = Solver(system.K, method="multigrid", **how).solve(system.b)[1]
        return report.iterations, len(problem.assembly.space)

    apart, more = iterations()
    monkeypatch.setattr("ilattice.cutfem.domain.SplineSpace", lambda *a: SplineSpace(*a[:4]))
    alone, known = iterations()
    assert more > 1.01 * known  # there are copies
    assert apart <= 1.2 * alone


WAVES = (
    "(-0.43792214807476765)*x+0.4840840288572748*y+0.7575531963043192*z-0.13666346780338937"
    "+0.10392007820516357*sin(4.386883476219584*(0.5286028297559082*x+0.8202465965106915*y"
    "-0.21857394466558194*z))*cos(4.386883476219584*((-0.7271885866813554)*x"
    "+0.3047263918959691*y-0.6150923389885754*z))"
)
SHIFTED = [
    [-1.5458983966654891, -1.4507228370615939, -1.518593083360026],
    [1.4541016033345109, 1.5492771629384061, 1.481406916639974],
]


def wavy(u):
    return u[:, 2] - 0.03 + 0.12 * np.sin(5 * u[:, 0]) * np.cos(5 * u[:, 1])


def sliced(u):
    """A ball with an air gap of a fifth of a cell, or somewhat less."""
    return np.maximum(np.linalg.norm(u, axis=1) - 0.95, np.minimum(wavy(u), 0.05 - wavy(u)))


def by_sides(problem, side):
    """Volume in cells of each part on both sides of a gap."""
    domain = problem.domain
    rule, parts = domain.volume, domain.parts
    label = parts.labels[np.searchsorted(parts.cells, rule.cells)][rule.owners]
    low = side(rule.points)
    cell = np.prod(domain.cut.grid.boxes(np.array([0]))[0, 3:])
    return np.stack([np.bincount(label, rule.weights * s, len(parts)) for s in (low, ~low)]) / cell


@pytest.mark.parametrize("kind", ["field", "function"])
def test_pieces_without_points_join_nothing(kind):
    """Slivers beyond a gap, in which rules have no points, have facets in whole cells beside."""
    fields = il.fields
    if kind == "field":
        low, high = fields.equation(WAVES), fields.equation(f"0.0375-({WAVES})")
        body = fields.intersection(fields.sphere(0.95), fields.union(low, high))
        problem = il.cutfem.Heat(body, 12, domain=SHIFTED, degree=1)
        sides = by_sides(problem, lambda u: low(u) < 0.01875)
    else:
        box = [[-1.0, -1.0, -1.0], [1.03, 1.0, 1.02]]
        problem = il.cutfem.Heat(sliced, 8, domain=box, degree=1)
        sides = by_sides(problem, lambda u: wavy(u) < 0.025)
    assert (sides.max(axis=1) > 20).all()
    assert sides.min(axis=0).max() == 0.0
    elements = problem.domain.elements
    small = elements.divided_cells[~np.isin(elements.divided_cells, elements.several)]
    assert len(small)  # cells with such pieces, which have one element
    for axis, rule in enumerate(problem.domain.interior_facets):
        assert np.isin(rule.cells, problem.domain.volume.cells).all()
        assert len(rule) == len(rule.cells)  # one point each, with the area
        whole = elements.divided(problem.domain.cut.faces(axis, 1))
        np.testing.assert_array_equal(whole.cells, rule.cells)
        np.testing.assert_allclose(rule.weights, whole.integrate_cells(), rtol=1e-14)
        assert (np.diff(whole.offsets) > 0).all()
    lost = problem.domain.cut.surface(2)
    kept = elements.divided(lost)
    assert 0.0 < lost.integrate() - kept.integrate() < 1e-4 * lost.integrate()


def test_parts_at_their_own_temperatures_have_no_error_to_tell():
    fields, box = il.fields, [[-1.0, -1.0, -1.0], [1.03, 1.0, 1.02]]
    low = "z - 0.03 + 0.12*sin(5*x)*cos(5*y)"
    sides = fields.union(fields.equation(low), fields.equation(f"0.05 - ({low})"))
    body = fields.intersection(fields.sphere(0.95), sides)
    for degree in (2, 3):
        problem = il.cutfem.Heat(body, 8, domain=box, degree=degree)
        solution = problem.fix("z < -0.5", 0.0).fix("z > 0.6", 1.0).solve()
        assert max(map(abs, solution.inflow.values())) < 1e-10
        assert solution.report.discretization_error == 0.0


@pytest.mark.parametrize("seed", [1, 103, 216, 467])
def test_small_bodies_behind_gaps_are_told_of_or_apart(seed):
    """Balls and ellipsoids of less than a cell, with air of .05 to .15 of a cell around them."""
    rng = np.random.default_rng(seed)
    shape = tuple(int(n) for n in rng.integers(3, 6, 3))
    lengths = rng.uniform(0.7, 2, 3)
    h = lengths / shape
    middle = lengths * rng.uniform(0.4, 0.6, 3)
    radius, gap = rng.uniform(0.5, 1.0) * h.min(), rng.uniform(0.05, 0.25) * h.min()
    stretch = rng.uniform(0.8, 1.25, 3) if rng.random() < 0.5 else np.ones(3)
    squares = "+".join(
        f"(({v}-{m!r})*{s!r})^2"
        for v, m, s in zip("xyz", middle.tolist(), stretch.tolist(), strict=True)
    )
    body = il.fields.equation(f"{gap / 2}-abs(sqrt({squares})-{radius})")
    problem = il.cutfem.Heat(body, shape, domain=[[0, 0, 0], lengths], degree=1)
    inside = lambda u: np.linalg.norm((u - middle) * stretch, axis=1) < radius  # noqa: E731
    joined = by_sides(problem, inside).min(axis=0).max() > 0.0
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        problem.domain.warn_gaps()
    assert joined == any("too thin to be resolved" in str(w.message) for w in told)
