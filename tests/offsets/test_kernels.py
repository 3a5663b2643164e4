"""Compiled pieces of the closest-point search against differences and dense linear algebra."""

from types import SimpleNamespace

import macro_zoo
import numpy as np
import pytest
from naive_closest import NaiveMap, tile_jet

import ilattice as il
from ilattice.bspline.fit import fit
from ilattice.offsets import _kernels_jets as jets
from ilattice.offsets import _kernels_newton as newton
from ilattice.offsets.space import kernel_space

SIX = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
FREE = (0, 0, 0)


def full(h):
    """Symmetric matrix from xx, yy, zz, yz, xz, xy."""
    out = np.empty((3, 3))
    for value, (i, j) in zip(h, SIX, strict=True):
        out[i, j] = out[j, i] = value
    return out


class Problem:
    """A lattice with kernels as functions of a tile coordinate, and reference implementations."""

    def __init__(self, tile, through, repeat):
        lattice = il.Lattice(tile, through=through, repeat=repeat)
        self.space = kernel_space(lattice)
        self.work = jets.scratch(self.space)
        self.geom = self.space.geom
        self.naive = NaiveMap(through.spline, through.closed, lattice.repeat)
        self.name = lattice.tile.name

    def map(self, p, order=2):
        self.work.map[:] = np.nan
        jets.map_jet(self.space, tuple(p), order, self.work.basis, self.work.map)
        return self.work.map[:3].copy()

    def tile(self, p):
        t = self.work.tile
        t[:] = np.nan
        jets.tile_jet(self.space, tuple(p), self.work.basis, t, self.work.table)
        return t.copy()

    def step(self, p, x, lam, *, first=False, fixed=FREE, floor=1e-9):
        m, t = self.map(p), self.tile(p)
        return newton.kkt_step(m, t, tuple(m[:, 0] - x), lam, first, fixed, floor)

    def lagrangian(self, p, x, lam):
        """1/2 |T(p) - x|² + lambda I(p) by the reference implementations."""
        p = np.atleast_2d(p)
        r = self.naive.jet(p, 0)[0] - x
        return 0.5 * (r * r).sum(axis=1) + lam * tile_jet(self.name, p)[0]


PROBLEMS = {
    "torus": ("gyroid", macro_zoo.ZOO["torus"], (6, 1, 2)),
    "duck": ("iwp", macro_zoo.ZOO["duck"], (3, 2, 4)),
    "rational": ("gyroid", macro_zoo.ZOO["torus exact"], (4, 2, 1)),
    "perturbed rational": ("primitive", macro_zoo.ZOO["perturbed rational"], (2, 1, 3)),
}


@pytest.fixture(scope="module", params=PROBLEMS)
def problem(request):
    return Problem(*PROBLEMS[request.param])


def points(problem, rng, n=20):
    """Tile coordinates inside the domain, off the breaks, and beyond an end."""
    count = problem.geom[jets.TILES : jets.RATIONAL]
    p = rng.uniform(0.02, 0.98, (n, 3)) * count
    closed = problem.geom[jets.CLOSED : jets.TILES] != 0
    p[0] = np.where(closed, -0.3, -0.3)
    p[1] = count + 0.4
    return p


def differences(f, p, h):
    """Central differences along three axes, (n, ..., 3)."""
    e = np.eye(3) * h
    return np.stack([(f(p + e[k]) - f(p - e[k])) / (2 * h) for k in range(3)], axis=-1)


def test_jets_of_maps_agree_with_scipy(problem):
    rng = np.random.default_rng(0)
    p = points(problem, rng)
    x, jac, hess = problem.naive.jet(p)
    for i, q in enumerate(p):
        m = problem.map(q)
        scale = np.abs(hess[i]).max() + np.abs(jac[i]).max()
        np.testing.assert_allclose(m[:, 0], x[i], atol=1e-12 * np.abs(x).max())
        np.testing.assert_allclose(m[:, 1:4], jac[i], atol=1e-11 * scale)
        for column, (a, b) in enumerate(SIX, 4):
            np.testing.assert_allclose(m[:, column], hess[i, :, a, b], atol=1e-10 * scale)
        first = problem.map(q, 1)
        np.testing.assert_allclose(first[:, :4], m[:, :4], atol=1e-13 * scale)


def test_jets_of_tiles_agree_with_sines_and_cosines(problem):
    p = points(problem, np.random.default_rng(1))
    f, g, h = tile_jet(problem.name, p)
    for i, q in enumerate(p):
        t = problem.tile(q)
        assert t[0] == pytest.approx(f[i], abs=1e-12)
        np.testing.assert_allclose(t[1:4], g[i], atol=1e-11)
        np.testing.assert_allclose(full(t[4:]), h[i], atol=1e-10)


def test_jets_of_spline_tiles_repeat_and_are_those_of_the_spline():
    rng = np.random.default_rng(2)
    spline = fit(il.tiles["gyroid"], degree=3, spans=6, periodic=(False, True, False))
    problem = Problem(il.Tile(spline), il.macroshape.box((2.0, 1.0, 3.0)), (2, 1, 3))
    p = rng.uniform(-1.0, 4.0, (30, 3))
    f, g, h = spline.jet(p - np.floor(p))
    for i, q in enumerate(p):
        t = problem.tile(q)
        np.testing.assert_allclose(t[:4], [f[i], *g[i]], atol=1e-11)
        np.testing.assert_allclose(full(t[4:]), h[i], atol=1e-9)
    corner = problem.tile((2.0, 1.0, 3.0))  # the far end of the domain, not the next tile
    np.testing.assert_allclose(corner[0], spline([[1.0, 0.0, 1.0]]), atol=1e-12)
    np.testing.assert_allclose(corner[1:4], spline.jet([[1.0, 0.0, 1.0]], 1)[1][0], atol=1e-10)


def test_gradient_and_hessian_of_the_lagrangian(problem):
    """Both against differences of the naive function: the printed eq. 12 fails here."""
    rng = np.random.default_rng(3)
    p = points(problem, rng)
    x = problem.naive.jet(p, 0)[0] + rng.standard_normal((len(p), 3)) * 0.2
    lam = 0.3 * rng.standard_normal(len(p))

    def gradient(q):
        out = np.empty((len(q), 3))
        for i, a in enumerate(q):
            m, t = problem.map(a), problem.tile(a)
            out[i] = m[:, 1:4].T @ (m[:, 0] - x[i]) + lam[i] * t[1:4]
        return out

    g = gradient(p)
    by_differences = differences(lambda q: problem.lagrangian(q, x, lam), p, 1e-5)
    np.testing.assert_allclose(g, by_differences, atol=1e-7 * np.abs(g).max())
    bend = differences(gradient, p, 1e-5)
    for i, q in enumerate(p):
        m, t = problem.map(q), problem.tile(q)
        h = full(newton.lagrangian(jets.metric(m), m, t, tuple(m[:, 0] - x[i]), lam[i]))
        np.testing.assert_allclose(h, bend[i], atol=1e-6 * np.abs(h).max())


def dense_step(problem, p, x, lam, fixed=FREE):
    """Step and multiplier from the bordered 4 x 4 system, fixed rows taken out."""
    m, t = problem.map(p), problem.tile(p)
    r = m[:, 0] - x
    h = full(newton.lagrangian(jets.metric(m), m, t, tuple(r), lam))
    free = np.flatnonzero(np.array(fixed) == 0)
    g = t[1:4][free]
    n = len(free)
    kkt = np.zeros((n + 1, n + 1))
    kkt[:n, :n], kkt[:n, n], kkt[n, :n] = h[np.ix_(free, free)], g, g
    right = -np.append((m[:, 1:4].T @ r)[free], t[0])
    solved = np.linalg.solve(kkt, right)
    step = np.zeros(3)
    step[free] = solved[:n]
    return step, solved[n], h, m, t


@pytest.mark.parametrize("fixed", [FREE, (1, 0, 0), (0, 1, 0), (0, 0, 1)])
def test_steps_solve_the_bordered_system(problem, fixed):
    rng = np.random.default_rng(4)
    solved = 0
    for p in points(problem, rng, 40):
        x = problem.naive.jet(p[None], 0)[0][0] + rng.standard_normal(3) * 0.05
        lam = 0.002 * rng.standard_normal()
        step, multiplier, _, m, _ = dense_step(problem, p, x, lam, fixed)
        d, new, size, low = problem.step(p, x, lam, fixed=fixed)
        if low < 1e-3:
            continue
        solved += 1
        np.testing.assert_allclose(d, step, atol=1e-8 * np.abs(step).max())
        assert new == pytest.approx(multiplier, rel=1e-7, abs=1e-12)
        assert size == pytest.approx(np.linalg.norm(m[:, 1:4] @ step), rel=1e-7)
    assert solved >= 10


def test_two_fixed_directions_leave_the_constraint(problem):
    p = np.array([0.3, 0.4, 0.45])
    t = problem.tile(p)
    d, _, _, low = problem.step(p, np.zeros(3), 0.0, fixed=(1, 0, 1))
    np.testing.assert_allclose(d, [0.0, -t[0] / t[2], 0.0], rtol=1e-12)
    assert low == 1.0


def test_lowest_eigenvalue_is_that_of_the_reduced_pencil(problem):
    rng = np.random.default_rng(5)
    for p in points(problem, rng):
        x = problem.naive.jet(p[None], 0)[0][0] + rng.standard_normal(3) * 0.3
        _, _, h, m, t = dense_step(problem, p, x, 0.4)
        z = np.linalg.svd(t[None, 1:4])[2][1:].T
        metric = m[:, 1:4].T @ m[:, 1:4]
        pencil = np.linalg.eigvals(np.linalg.solve(z.T @ metric @ z, z.T @ h @ z)).real
        r = tuple(m[:, 0] - x)
        low = newton.kkt_step(m, t, r, 0.4, False, FREE, 1e-9)[3]
        assert low == pytest.approx(pencil.min(), rel=1e-7, abs=1e-9)
        along = newton.soft_direction(m, t, tuple(x), 0.4, low, FREE)
        assert np.dot(along, t[1:4]) == pytest.approx(0, abs=1e-9 * np.linalg.norm(t[1:4]))
        assert along @ metric @ along == pytest.approx(1.0, rel=1e-9)
        assert along @ h @ along == pytest.approx(low, rel=1e-6, abs=1e-8)


def test_steps_are_damped_where_the_reduced_hessian_is_not_positive(problem):
    """Below the floor the Hessian is shifted until its lowest eigenvalue is three floors."""
    rng = np.random.default_rng(6)
    floor, seen = 0.1, 0
    for p in points(problem, rng, 60):
        x = problem.naive.jet(p[None], 0)[0][0] + rng.standard_normal(3) * 0.5
        _, _, h, m, t = dense_step(problem, p, x, 0.2)
        r = tuple(m[:, 0] - x)
        d, _, _, low = newton.kkt_step(m, t, r, 0.2, False, FREE, floor)
        if low > floor:
            continue
        seen += 1
        metric = m[:, 1:4].T @ m[:, 1:4]
        g = t[1:4]
        shifted = h + (3 * floor - low) * metric
        z = np.linalg.svd(g[None])[2][1:].T
        normal = -t[0] / (g @ g) * g
        right = -z.T @ (m[:, 1:4].T @ np.array(r) + h @ normal)
        y = np.linalg.solve(z.T @ shifted @ z, right)
        np.testing.assert_allclose(d, normal + z @ y, atol=1e-8 * np.abs(d).max())
    assert seen > 10


def test_first_multiplier_is_the_one_of_the_metric(problem):
    """lambda = -(g.G⁻¹J'r) / (g.G⁻¹g), not the projection in the lengths of the parameters."""
    p = np.array([0.31, 0.42, 0.53])
    x = problem.naive.jet(p[None], 0)[0][0] + [0.1, -0.05, 0.08]
    m, t = problem.map(p), problem.tile(p)
    jac, g = m[:, 1:4], t[1:4]
    a = np.linalg.solve(jac.T @ jac, g)
    lam = -(a @ (jac.T @ (m[:, 0] - x))) / (a @ g)
    given = problem.step(p, x, lam)
    made = problem.step(p, x, 123.0, first=True)
    np.testing.assert_allclose(made[0], given[0], rtol=1e-9)
    assert made[1] == pytest.approx(given[1], rel=1e-9)


def test_convergence_is_quadratic(problem):
    rng = np.random.default_rng(7)
    rates = []
    for p in points(problem, rng, 12)[2:]:
        f, g, _ = (a[0] for a in tile_jet(problem.name, p[None]))
        p = p - f / (g @ g) * g
        x = problem.naive.jet(p[None], 0)[0][0] + 0.03 * rng.standard_normal(3)
        lam, trail = 0.0, [p]
        for i in range(12):
            d, lam, _, low = problem.step(trail[-1], x, lam, first=i == 0, floor=0.02)
            trail.append(trail[-1] + np.array(d))
        error = np.linalg.norm(np.array(trail[:-1]) - trail[-1], axis=1)
        used = (error[:-1] < 0.03) & (error[1:] > 1e-13)
        if low > 0.2 and used.sum() >= 2:
            rates.append((error[1:][used] / error[:-1][used] ** 2).max())
    assert len(rates) >= 5
    assert np.median(rates) < 50


def test_symmetric_systems():
    rng = np.random.default_rng(8)
    for _ in range(20):
        a = rng.standard_normal((3, 3))
        a = a + a.T
        h = tuple(a[i, j] for i, j in SIX)
        b, c = rng.standard_normal((2, 3))
        x, regular = jets.solve_sym(h, tuple(b))
        assert regular
        np.testing.assert_allclose(a @ x, b, atol=1e-9)
        assert jets.sym(h, tuple(b), tuple(c)) == pytest.approx(b @ a @ c)
    assert not jets.solve_sym((1.0, 0.0, 1.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0))[1]


@pytest.mark.parametrize("hand", [1, -1])
def test_normals_are_those_of_the_image(hand):
    rng = np.random.default_rng(9)
    m = np.zeros((3, 10))
    m[:, 1:4] = rng.standard_normal((3, 3))
    jac = m[:, 1:4]
    jac[:, 0] *= hand * np.sign(np.linalg.det(jac))
    g = rng.standard_normal(3)
    normal, det = jets.cofactor_normal(m, tuple(g))
    assert det == pytest.approx(np.linalg.det(jac))
    assert det * hand > 0
    np.testing.assert_allclose(normal, det * np.linalg.solve(jac.T, g), rtol=1e-10)


def test_bounds_hold_where_the_gradient_pushes_out():
    box = np.array([[0.0, 0.0, -np.inf], [2.0, 2.0, np.inf]])
    t = np.zeros(10)
    t[1:4] = 1.0
    ask = SimpleNamespace(lam=0.5)

    def held(p, jr):
        return newton.active_set(p, box, jr, t, ask.lam, True)

    assert held((0.0, 2.0, 5.0), (1.0, -1.0, 1.0)) == (1, 1, 0)
    assert held((0.0, 2.0, 5.0), (-1.0, 1.0, 1.0)) == (0, 0, 0)
    assert held((1.0, 1.0, 0.0), (1.0, -1.0, 1.0)) == (0, 0, 0)
    ask.lam = -3.0  # the multiplier turns both
    assert held((0.0, 2.0, 5.0), (1.0, -1.0, 1.0)) == (0, 1, 0)
    assert newton.active_set((0.0, 2.0, 0.0), box, (1.0, -1.0, 0.0), t, 0.5, False) == FREE
