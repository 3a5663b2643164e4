"""Rules on balls, cylinders, cones and hyperboloids in one cell, thin and thick; thinned points.

The oracle is the divergence theorem: volumes from the surface and from the faces of the cell, which
are made by other code, and closed formulas.
"""

from math import comb

import numpy as np
import pytest

import ilattice as il
from ilattice.quadrature import _filling

BOX = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
FACES = ("u=0", "u=1", "v=0", "v=1", "w=0", "w=1")


def spline(f, box, degree):
    """A polynomial of one element, by interpolation."""
    x = 0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree)
    B = [[comb(degree, i) * t**i * (1 - t) ** (degree - i) for i in range(degree + 1)] for t in x]
    V = np.linalg.inv(B)
    u = np.stack(np.meshgrid(x, x, x, indexing="ij"), -1).reshape(-1, 3)
    values = f(box[0] + u * (box[1] - box[0])).reshape((degree + 1,) * 3)
    c = np.einsum("ia,jb,kc,abc->ijk", V, V, V, values)
    knots = [np.repeat([box[0][a], box[1][a]], degree + 1) for a in range(3)]
    return il.bspline.BSpline(knots, c, degree)


def quadric(rng, values, center, r, sign=1.0):
    """A polynomial of degree two with turned axes; about the distance near its zero set."""
    R = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    A = R @ np.diag(values) @ R.T

    def f(x):
        return sign * (np.einsum("ni,ij,nj->n", x - center, A, x - center) - r * r) / (2.0 * r)

    return f


def random_case(seed):
    """A quadric in a box of random place and lengths, with the signs of both sorts."""
    rng = np.random.default_rng(seed)
    lo, extent = rng.uniform(-3.0, 3.0, 3), 10.0 ** rng.uniform(-1.0, 1.0, 3)
    values = [
        (1.0, 1.0, 1.0), (1.0, 1.0, 0.0), (1.0, rng.uniform(0.1, 1.0), rng.uniform(0.1, 1.0)),
        (1.0, rng.uniform(0.1, 1.0), -rng.uniform(0.0, 0.05)),
    ][seed % 4]  # fmt: skip
    center = lo + extent * rng.uniform(0.1, 0.9, 3)
    r = 10.0 ** rng.uniform(-2.5, 0.0) * extent.min()
    f = quadric(rng, values, center, r, 1.0 if rng.random() < 0.6 else -1.0)
    return spline(f, np.array([lo, lo + extent]), 2 + seed % 2), center


def test_volumes_are_those_of_the_boundary():
    off, gaps, most = [], [], 0
    for seed in range(60):
        s, center = random_case(seed)
        grid = il.cutfem.cut(s, 1)
        rule = grid.volume(3)
        parts = [grid.surface(3), *(grid.face(name, 6) for name in FACES)]
        found = sum(float(p.weights @ (p.normals * (p.points - center)).sum(1)) for p in parts)
        closed = sum((p.weights[:, None] * p.normals).sum(axis=0) for p in parts)
        off.append(abs(found / 3.0 / rule.weights.sum() - 1.0))
        gaps.append(np.abs(closed).max() / sum(p.weights.sum() for p in parts))
        most = max(most, len(rule))
        values = s(rule.points)
        assert (rule.weights > 0.0).all()
        assert values.max() <= 1e-9 * np.abs(s.c).max()
    assert np.median(off) <= 1e-5
    assert np.quantile(off, 0.9) <= 5e-4
    assert max(off) <= 5e-3
    assert max(gaps) <= 2e-3
    assert most <= 60 * 27  # halving took up to 600,000


def test_voids_of_boxes_that_mirror_each_other_have_the_same_volume():
    """Planes of the grid pass through the middle, so that ends of strips coincide by rounding."""
    radii = (0.3, 0.24, 0.2)
    void = spline(lambda x: 1.0 - (((x - 0.5) / radii) ** 2).sum(axis=1), BOX, 2)
    noise = np.random.default_rng(3).uniform(-1e-14, 1e-14, void.c.shape)
    n = 6
    grid = il.cutfem.Grid([np.arange(n + 1) / n] * 3)
    rule = il.cutfem.cut(il.BSpline(void.t, void.c + noise, 2), grid).volume(2)
    volumes = np.zeros(n**3)
    volumes[rule.cells] = np.add.reduceat(rule.weights, rule.offsets[:-1])
    for axis in range(3):
        flipped = np.flip(volumes.reshape(n, n, n), axis).ravel()
        np.testing.assert_allclose(flipped, volumes, rtol=0, atol=1e-12)


@pytest.mark.parametrize("degree", [2, 3, 4])
def test_balls_and_ellipsoids_are_exact_however_thin(degree):
    rng = np.random.default_rng(degree)
    for r in (0.3, 0.03, 1e-3):
        bound = 1e-12 / r**2  # rounding of coefficients of size 1
        center = rng.uniform(0.35, 0.65, 3)
        ball = il.cutfem.cut(spline(quadric(rng, (1, 1, 1), center, r), BOX, degree), 1)
        volume, surface = ball.volume(2), ball.surface(2)
        assert abs(volume.integrate() / (4.0 / 3.0 * np.pi * r**3) - 1.0) <= bound
        assert np.abs(volume.integrate(lambda x, c=center: x - c)).max() <= bound * r**4
        assert abs(surface.integrate() / (4.0 * np.pi * r**2) - 1.0) <= bound
        void = il.cutfem.cut(spline(quadric(rng, (1, 1, 1), center, r, -1.0), BOX, degree), 1)
        assert abs(void.volume(3).integrate() - 1.0 + 4.0 / 3.0 * np.pi * r**3) <= 2e-4 * r**2
        values = (1.0, rng.uniform(0.3, 1.0), rng.uniform(0.3, 1.0))
        grid = il.cutfem.cut(spline(quadric(rng, values, center, 0.5 * r), BOX, degree), 1)
        exact = 4.0 / 3.0 * np.pi * (0.5 * r) ** 3 / np.sqrt(values[1] * values[2])
        assert abs(grid.volume(2).integrate() / exact - 1.0) <= bound


def test_second_moments_of_a_thin_cylinder():
    rng = np.random.default_rng(5)
    for r in (0.1, 0.01, 1e-3):
        way = np.array([1.0, *rng.uniform(-0.3, 0.3, 2)])
        way /= np.linalg.norm(way)
        center = np.array([0.5, *rng.uniform(0.45, 0.55, 2)])

        def f(x, r=r, way=way, center=center):
            d = x - center
            return ((d * d).sum(axis=1) - (d @ way) ** 2 - r * r) / (2.0 * r)

        rule = il.cutfem.cut(spline(f, BOX, 2), 1).volume(3)
        assert len(rule) <= 4 * 27
        assert abs(rule.integrate() / (np.pi * r * r / way[0]) - 1.0) <= 1e-8
        d = rule.points - center
        across = d - (d @ way)[:, None] * way
        # all of the cylinder between two planes: the second polar moment of its discs
        assert abs(rule.integrate((across**2).sum(1)) / (np.pi * r**4 / 2 / way[0]) - 1) <= 1e-8


def test_the_error_falls_with_the_points():
    found = {q: [] for q in (2, 3, 4, 6)}
    for seed in range(12):
        s, _ = random_case(4 * seed + 1)  # cylinders that end in the faces of the box
        exact = il.cutfem.cut(s, 1).volume(9).integrate()
        for q, errors in found.items():
            errors.append(abs(il.cutfem.cut(s, 1).volume(q).integrate() / exact - 1.0))
    means = [np.mean(e) for e in found.values()]
    assert means[1] <= 0.2 * means[0]
    assert means[3] <= 0.05 * means[1]


def node_of_beams(n, seed):
    """Beams of random directions and radii that meet in one ball."""
    rng = np.random.default_rng(seed)
    ways = rng.standard_normal((n, 3))
    x = np.vstack([[0.03, -0.02, 0.01], 2.0 * ways / np.linalg.norm(ways, axis=1)[:, None]])
    pairs = np.column_stack([np.zeros(n, int), np.arange(1, n + 1)])
    return il.cost.Beams(x, pairs, np.column_stack([np.full(n, 0.09), rng.uniform(0.05, 0.13, n)]))


def test_thinned_points_keep_the_moments(monkeypatch):
    beams = node_of_beams(7, 3)
    grid = il.cutfem.cut(beams, 2, domain=[[-1.0] * 3, [1.0] * 3], degree=2)
    thinned = grid.volume(3)
    monkeypatch.setattr(_filling, "LONG", 10**9)
    whole = grid.volume(3)
    assert len(thinned) <= 0.4 * len(whole)
    assert (thinned.weights > 0.0).all()
    rows = {tuple(x) for x in whole.points.tolist()}
    assert all(tuple(x) in rows for x in thinned.points.tolist())
    for i, j, k in np.ndindex(4, 4, 4):
        if i + j + k <= 3:
            a, b = (r.integrate_cells(np.prod(r.points ** [i, j, k], 1)) for r in (thinned, whole))
            assert np.abs(a - b).max() <= 1e-9 * whole.weights.sum()
    u = np.array([1.3, -0.7, 0.9])  # not a polynomial: as good as the points of a cell
    a, b = (r.integrate(np.cos(r.points @ u)) for r in (thinned, whole))
    assert abs(a / b - 1.0) <= 1e-5


def test_points_in_splines_finer_than_cells_are_thinned(monkeypatch):
    """Struts along diagonals: many spans per cell, of which some boxes have many points."""
    nodes = [(0.0, 0.0, 0.0), (1.0, 1.0, 0.0), (1.0, 0.0, 1.0), (0.0, 1.0, 1.0)]
    tile = il.tiles.struts(nodes, [(0, 1), (0, 2), (0, 3)], 0.05)
    lattice = il.Lattice(tile, through=il.macroshape.cell(), repeat=1)
    wall = lattice.offset((np.inf, 0.0))
    grid = il.cutfem.cut(wall.field, (2, 4, 4), through=wall.through)
    usual = grid.volume(2)
    monkeypatch.setattr(_filling, "FIRST", 1)
    monkeypatch.setattr(_filling, "MANY", 100)
    thinned = grid.volume(2)
    monkeypatch.setattr(_filling, "LONG", 10**9)
    whole = grid.volume(2)
    assert len(usual) == len(whole)  # so few are no burden
    assert len(thinned) <= 0.35 * len(whole)
    assert (thinned.weights > 0.0).all()
    p = np.random.default_rng(0).normal(size=3)
    a, b = (r.integrate_cells((r.points @ p - 0.2) ** 3) for r in (thinned, whole))
    assert np.abs(a - b).max() <= 1e-9 * whole.weights.sum()


def test_crowded_pieces_of_splines_are_thinned_in_cells_of_any_size(monkeypatch):
    """Along diagonals zero sets of pieces cross themselves, and boxes are halved many times."""
    nodes = [(0.0, 0.0, 0.0), (1.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.5, 0.0, 0.5)]
    tile = il.tiles.struts(nodes, [(0, 1), (2, 3), (0, 4)], 0.05)
    wall = il.Lattice(tile, through=il.macroshape.cell(), repeat=1).offset((np.inf, 0.0))
    grid = il.cutfem.cut(wall.field, (12, 18, 14), through=wall.through)
    monkeypatch.setattr(_filling, "FIRST", 1)
    monkeypatch.setattr(_filling, "MANY", 100)
    thinned = grid.volume(2)
    monkeypatch.setattr(_filling, "CROWDED", 10**9)
    whole = grid.volume(2)
    assert len(thinned) <= 0.2 * len(whole)
    assert (thinned.weights > 0.0).all()
    lower, size = np.split(grid.grid.boxes(thinned.cells), 2, axis=1)
    p = np.random.default_rng(0).normal(size=3)
    sums = []
    for r in (thinned, whole):
        t = (r.points - lower[r.owners]) / size[r.owners]
        sums.append(r.integrate_cells((t @ p - 0.2) ** 5))
    assert np.abs(sums[0] - sums[1]).max() <= 1e-9 * np.prod(size, axis=1).max()


def test_who_asks_for_many_points_gets_them(monkeypatch):
    grid = il.cutfem.cut(node_of_beams(5, 4), 2, domain=[[-1.0] * 3, [1.0] * 3], degree=2)
    many = len(grid.volume(6))
    monkeypatch.setattr(_filling, "LONG", 10**9)
    assert many == len(grid.volume(6))


THREES = ((3, 1e-9), (4, 1e-4), (5, 1e-3))  # what analyses of degree 1 and 2 need
SIXES = ((5, 1e-9), (6, 1e-7), (7, 1e-6))  # and of degree 3


@pytest.mark.filterwarnings("ignore:the volume of the field")  # of cells this large
@pytest.mark.parametrize(("q", "moments", "part"), [(4, THREES, 0.1), (5, SIXES, 0.25)])
def test_thin_beams_in_large_cells_take_few_points_that_keep_the_moments(
    q, moments, part, monkeypatch
):
    """Their boxes are as large as cells, and are thinned in parts."""
    rng = np.random.default_rng(11)
    beams = il.cost.Beams(rng.uniform(-0.9, 0.9, (2, 3)), [[0, 1]], [[0.12, 0.1]])
    grid = il.cutfem.cut(beams, 2, domain=[[-1.0] * 3, [1.0] * 3])
    thinned = grid.volume(q)
    monkeypatch.setattr(_filling, "LONG", 10**9)
    whole = grid.volume(q)
    assert len(thinned) <= part * len(whole)
    assert (thinned.weights > 0.0).all()
    low, size = grid.grid.boxes(thinned.cells)[0, :3], grid.grid.boxes(thinned.cells)[0, 3:]
    for total, most in moments:
        for e in np.ndindex(*[total + 1] * 3):
            if sum(e) == total:
                a, b = (
                    r.integrate_cells(np.prod(np.polynomial.legendre.legval(
                        2.0 * ((r.points - low) / size % 1.0) - 1.0, np.eye(total + 1)
                    )[list(e), :, range(3)], 0)) for r in (thinned, whole)
                )  # fmt: skip
                assert np.abs(a - b).max() <= most * whole.weights.sum()
