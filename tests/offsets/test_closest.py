"""Closest points that were missed once, and counted failures."""

import combinations as cb
import naive_closest as nc
import numpy as np
import pytest

import ilattice as il
from ilattice.errors import ConvergenceError
from ilattice.offsets import closest
from ilattice.offsets.retrying import singly
from ilattice.offsets.seeding import Seeds


def tile_sizes(lattice, u):
    return np.linalg.norm(lattice.through.jacobian(u) * lattice.search.step, axis=1).max(axis=1)


#: Queries and points of the surface that are nearer than feet found at one time: a sheet behind
#: another one, ridges that the map makes, minima just inside a face, edges and corners of the
#: domain, faces beyond which the map folds, minima beyond saddles; last, faces next to which the
#: surface is at 1e-8.
MISSED = [
    ("G", "gyroid", "extend", (13.9501, 0.0352, 6.6110), (13.89715, 0.03196, 6.60981)),
    ("G", "gyroid", "clip", (13.9501, 0.0352, 6.6110), (13.89715, 0.03196, 6.60981)),
    ("G", "gyroid", "clip", (16.0, 0.81015, 7.0), (16.0, 1.0, 7.0)),
    ("G", "gyroid", "clip", (16.0, 0.84794, 7.0), (16.0, 1.0, 7.0)),
    ("G", "primitive", "clip", (13.703232, 0.044554, 2.961352), (13.4987, 0.1408, 2.8097)),
    ("G", "primitive", "clip", (13.167744, 0.001226, 0.078874), (13.4993, 0.0, 0.25)),
    ("G", "primitive", "clip", (1.0, 0.5, 7.0), (0.75499, 0.49514, 6.95974)),
    ("G", "iwp", "clip", (14.0, 0.25, 6.0), (14.0291, 0.2874, 6.0)),
    ("G", "iwp", "extend", (13.6712485, 0.0, 7.0), (13.71392257, 0.0, 7.0)),
    ("G", "gyroid", "extend", (14.2413379, 0.0406459, 2.6717941), (13.758451, 0.0, 2.624888)),
    ("G", "primitive", "extend", (14.0287413, 0.0113555, 4.5960809), (13.721747, 0.0, 4.596034)),
    ("G", "gyroid", "extend", (13.4973992, 0.0003203, 6.1206675), (13.69758111, 0.0, 6.12060573)),
    ("duck", "primitive", "extend", (18.0, 5.0, 2.65775585), (17.991538, 4.750154, 2.495265)),
    ("duck", "primitive", "extend", (18.0, 0.0, 2.67446036), (17.991569, 0.24981, 2.496745)),
    ("duck", "gyroid", "clip", (18.0, 0.82313223, 4.0), (18.0, 1.0, 4.0)),
    ("torus", "primitive", "clip", (10.125, 0.375, 0.0), (10.24593, 0.43912, 0.07098)),
    ("torus", "primitive", "clip", (11.85081, 0.0, 0.49208), (11.76402, 0.06745, 0.49502)),
    ("torus", "primitive", "clip", (0.11373, 1.50229, 0.00165), (0.23147, 1.50111, 0.07748)),
    ("torus", "primitive", "clip", (13.24332, 0.86752, 0.00099), (13.34283, 0.70415, 0.09278)),
    ("torus", "iwp", "clip", (11.75, 2.0, 1.5), (11.75011942, 1.87518857, 1.62518835)),
    ("torus", "iwp", "clip", (12.25, 2.0, 1.5), (12.24988058, 1.87518857, 1.62518835)),
    ("G", "iwp", "clip", (15.28607748, 1 - 3e-8, 4 + 5e-8), (15.28607743, 1 - 7e-8, 4 + 5e-8)),
]


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
@pytest.mark.parametrize(("shape", "tile", "boundary", "q", "near"), MISSED)
def test_feet_that_were_missed_once(shape, tile, boundary, q, near):
    lattice = nc.lattice_of(shape, tile, boundary)
    u = nc.parameters(lattice, np.array([q]))
    p = np.array([near])
    for _ in range(5):
        f, g, _ = nc.tile_jet(tile, p)
        g = np.where((p == 0) | (p == np.array(lattice.repeat)), 0.0, g)
        p = p - (f / np.maximum((g * g).sum(axis=1), 1e-300))[:, None] * g
    space = nc.NaiveMap(lattice.through.spline, lattice.through.closed, lattice.repeat)
    assert abs(nc.tile_jet(tile, p)[0][0]) < 1e-12
    known = np.linalg.norm(space.jet(p, 0)[0] - lattice.through.x(u))
    slack = 1e-9 * tile_sizes(lattice, u)[0]
    assert abs(lattice.distance(u)[0]) <= known * (1 + 1e-9) + slack


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
def test_dense_seeds_on_faces_hide_no_sheet_farther_apart():
    """Next to the middle of a cage on a face the nearest seeds are all on the curves of that."""
    lattice = nc.lattice_of("torus", "iwp", "clip")
    rng = np.random.default_rng(5)
    q = np.array([[i, *a] for i in range(16) for a in ((1, 0), (0, 1), (1, 2), (2, 1))] * 12, float)
    q += rng.uniform(-0.002, 0.002, q.shape)
    q[:, 0] %= 16.0
    q[:, 1:] = 2.0 - np.abs(2.0 - np.abs(q[:, 1:]))
    known, _ = nc.Oracle("iwp", lattice).distance(q)
    distance = np.abs(lattice.closest(nc.parameters(lattice, q)).distance)
    np.testing.assert_allclose(distance, known, rtol=1e-9)


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
def test_feet_next_to_faces_lie_on_the_surface():
    """Steps that end beyond a face are cut off there; that must not be the last step."""
    lattice = nc.lattice_of("G", "gyroid", "clip")
    rng, count = np.random.default_rng(0), np.array(lattice.repeat)
    on = nc.tile_samples("gyroid", 8)
    p = rng.integers(0, count, (6000, 3)) + on[rng.integers(len(on), size=6000)]
    p = p[((p == 0) | (p == count)).any(axis=1)]
    p += 10.0 ** rng.uniform(-9, -6, (len(p), 1)) * rng.standard_normal(p.shape)
    found = lattice.closest(nc.parameters(lattice, np.clip(p, 0, count)))
    assert (found.status == 1).sum() > 100
    assert (found.status == 0).sum() > 100
    foot = lattice.tile_coordinates(found.u)
    assert ((foot >= 0) & (foot <= count)).all()
    assert np.abs(nc.tile_jet("gyroid", foot)[0]).max() < 1e-8


@pytest.mark.parametrize(("tile", "repeat"), [("schwarz_p", (2, 2, 1)), ("frd", (1, 3, 1))])
@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
def test_feet_in_a_thin_tail_lie_on_the_surface(tile, repeat):
    """Tiles there are a few hundred times as long as they are high: all is near in space."""
    lattice = il.Lattice(tile, through=il.macroshape.wing(), repeat=repeat, boundary="clip")
    u = np.random.default_rng(0).random((6000, 3)) * (0.03, 1.0, 1.0) + (0.97, 0.0, 0.0)
    found = lattice.closest(u)
    assert np.abs(lattice.implicit(found.u)[found.status < 2]).max() < 1e-6
    assert (found.status >= 2).sum() < 0.01 * len(u)


def test_folds_within_the_spacing_of_seeds_are_searched():
    """Of tiles of 13 x 33 x 1437, against minima from close samples of the surface."""
    box = il.macroshape.box((26.26770515, 33.37872207, 1437.49673449))
    lattice = il.Lattice("split_p", through=box, repeat=(2, 1, 1), boundary="clip")
    u = [[0.20568725, 0.44187698, 0.90616236], [0.95446999, 0.64708581, 0.9844642]]
    distance = np.abs(lattice.search.query(u).distance)
    np.testing.assert_array_less(distance, np.array([1.8336742, 2.3948779]) * (1 + 1e-7))


def test_critical_points_of_the_tile_are_no_feet():
    """At the corners of the domain grad I = 0, and a step from there goes nowhere."""
    lattice = nc.lattice_of("duck", "primitive", "clip")
    corners = np.stack(np.meshgrid(*zip((0, 0, 0), lattice.repeat, strict=True)), -1).reshape(-1, 3)
    u = nc.parameters(lattice, corners.astype(float))
    assert (lattice.distance(u) > 0.1 * tile_sizes(lattice, u) * 0.1).all()


@pytest.fixture
def box():
    return il.Lattice("gyroid", through=il.macroshape.box((2, 1, 1)), repeat=(2, 1, 1))


def test_searches_are_counted(box):
    u = np.random.default_rng(5).random((300, 3))
    a = box.closest(u[:200])
    b = box.closest(u[200:])
    s = box.statistics
    assert s.queries == 300
    assert s.iterations == a.iterations.sum() + b.iterations.sum()
    assert s.starts == a.starts.sum() + b.starts.sum()
    assert s.mean_iterations == s.iterations / 300
    assert s.fallbacks == 0
    assert (a.starts >= 1).all()
    assert (a.iterations >= a.starts).all()


def test_queries_that_fail_are_told_and_counted(box):
    """No start that is not a number leads anywhere."""
    search = box.search
    u = np.random.default_rng(6).random((closest.FEW, 3)) * [0.1, 1, 1]
    whole = box.closest(u)
    search.seeds.points[:] = np.nan
    found = box.closest(u)
    assert (whole.status == 0).all()
    assert (found.status == 2).all()
    assert box.statistics.fallbacks == closest.FEW
    nearest, _ = search.tree.query(box.through.x(u))
    np.testing.assert_allclose(np.abs(found.distance), nearest, rtol=1e-12)
    far = np.random.default_rng(7).random((20, 3)) * [0.3, 1, 1]
    with pytest.raises(ConvergenceError, match=r"20 of 20 queries did not converge.*fit together"):
        box.closest(far)
    assert box.statistics.fallbacks == closest.FEW + 20


@pytest.mark.parametrize(
    ("shape", "repeat", "boundary"),
    [
        ("perturbed", (2, 2, 1), "extend"),
        ("gismo/cylinder.xml", (2, 1, 2), "extend"),
        ("mfem/cube-nurbs-deformed.mesh", (3, 2, 3), "clip"),
    ],
)
@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
def test_surfaces_that_meet_have_seeds_next_to_where_they_do(shape, repeat, boundary):
    """Planes of the F surface went unnoticed next to each other: up to a tenth of a tile off."""
    lattice = il.Lattice("f", through=cb._map(shape), repeat=repeat, boundary=boundary)
    lo, hi = lattice.domain
    u = lo + (hi - lo) * np.random.default_rng(0).random((300, 3))
    oracle = nc.Oracle(cb.tile_function(lattice), lattice, m=24, coarse=8)
    distance, _ = oracle.distance(lattice.tile_coordinates(u))
    farther = np.abs(lattice.closest(u).distance) - distance
    assert (farther <= 1e-8 * tile_sizes(lattice, u)).all()


def pyramid():
    """A block whose upper face is a point."""
    c = np.stack(np.meshgrid(*[[0.0, 1.0]] * 3, indexing="ij"), axis=-1) * [1.03, 0.97, 1.21]
    c[:, :, 1] = [0.47, 0.47, 1.21]
    return il.SplineMap(il.BSpline([[0.0, 0.0, 1.0, 1.0]] * 3, c, 1))


@pytest.mark.parametrize("boundary", ["extend", "clip"])
@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
def test_surfaces_reach_into_the_tips_of_cells(boundary):
    """Seeds as far apart as elsewhere missed a third of the feet there."""
    lattice = il.Lattice("gyroid", through=pyramid(), boundary=boundary)
    rng = np.random.default_rng(5)
    u = rng.random((80, 3))
    u[:, 2] = 1.0 - 10.0 ** rng.uniform(-3.5, -0.5, 80)
    distance, _ = nc.Oracle(cb.tile_function(lattice), lattice, m=24).distance(u)
    farther = np.abs(lattice.search.query(u, strides=()).distance) - distance
    assert (farther <= 1e-7 * distance + 1e-10).all()


SQUEEZED = [("wing", (1, 1, 6), "gyroid"), ("gismo/GshapedVolume.xml", (2, 1, 1), "primitive")]


@pytest.mark.parametrize(("shape", "repeat", "tile"), SQUEEZED)
@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
def test_feet_in_squeezed_cells_and_beyond_them(shape, repeat, tile):
    """Continuations that fold, are squeezed or come back over the domain do not count."""
    lattice = il.Lattice(tile, through=cb._map(shape), repeat=repeat)
    lo, hi = lattice.domain
    u = lo + (hi - lo) * np.random.default_rng(3).random((150, 3))
    found = lattice.search.query(u, thorough=True)
    oracle = nc.Oracle(cb.tile_function(lattice), lattice, m=24)
    p = lattice.tile_coordinates(found.u)
    beyond = oracle._beyond(p)
    assert 5 < beyond.sum() < 50
    y, jac = oracle.map.jet(p[beyond], 1)
    assert oracle._admissible(p[beyond], jac).all()
    assert not oracle._back(lattice.through.x(u)[beyond], p[beyond], y).any()
    np.testing.assert_allclose(y, found.foot[beyond], atol=1e-9)
    distance, _ = oracle.distance(lattice.tile_coordinates(u))
    farther = np.abs(found.distance) - distance
    assert (farther <= 1e-8 * tile_sizes(lattice, u)).all()


def test_feet_without_a_seed_come_from_neighbours():
    """Of a search with hardly any seeds most feet are still right, for neighbours have them."""
    shape = il.macroshape.cylinder_shell(angle=2.0)
    whole = il.Lattice("gyroid", through=shape, repeat=(2, 2, 1))
    poor = il.Lattice("gyroid", through=shape, repeat=(2, 2, 1))
    keep = np.random.default_rng(3).random(len(poor.search.seeds.points)) < 0.02
    poor.search.seeds = Seeds(*(np.ascontiguousarray(a[keep]) for a in poor.search.seeds))
    poor.search.tree = closest.cKDTree(poor.search.seeds.images)
    n = 25
    axes = [np.linspace(*whole.domain[:, a], n) for a in range(3)]
    u = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    right = whole.distance(u)

    def wrong(**options):
        found = poor.search.query(u, strict=False, **options).distance
        return (np.abs(found - right) > 1e-7).mean()

    alone = wrong(strides=())
    assert poor.statistics.mended == 0
    assert alone > 0.02
    assert wrong(strides=(1, n, n * n)) < 0.2 * alone
    assert poor.statistics.mended > 0
    assert wrong(thorough=True) < 0.2 * alone
    assert wrong(strides=(), known=whole.search.query(u)) == 0.0


def test_crossings_on_edges_of_the_domain_are_no_feet_where_a_curve_goes_on():
    """On the face w = 1 a surface has the line u = 1/4; a curve crosses it on the edge v = 0."""
    through = il.macroshape.load(cb.DATA / "mfem/cube-nurbs-deformed.mesh")
    lattice = il.Lattice("tubular_gyroid", through=through, boundary="clip")
    v = np.linspace(0.0, 0.1, 4001)
    line = np.stack([np.full_like(v, 0.25), v, np.ones_like(v)], axis=1)
    assert np.abs(lattice.implicit(line)).max() < 1e-12
    rng = np.random.default_rng(3)
    u = np.array([0.267, 0.0, 0.953]) + rng.uniform(-1.0, 1.0, (300, 3)) * [0.015, 0.0, 0.012]
    away = np.linalg.norm(through.x(u)[:, None] - through.x(line), axis=2)
    assert (away.argmin(axis=1) > 0).sum() > 30  # not the crossing itself
    found = np.abs(lattice.distance(u))
    assert (found <= away.min(axis=1) * (1.0 + 1e-6)).all()


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
def test_points_next_to_the_surface_start_from_themselves():
    """Beside sharp edges all seeds led to other sheets, up to 21 times as far."""
    lattice = il.Lattice("re_entrant_honeycomb", through=cb._map("swept"))
    lo, hi = lattice.domain
    u = lo + np.random.default_rng(1).random((2500, 3)) * (hi - lo)
    u = u[np.abs(lattice.implicit(u)) < 0.2]
    found = np.abs(lattice.distance(u))
    alone = singly(lattice.search, lattice.through.x(u), lattice.search.to_tile(u), 200)[:, 6]
    farther = found / np.abs(alone)
    assert len(u) > 1000
    assert farther.max() < 1.5
    assert (farther > 1.0 + 1e-6).mean() < 2e-3
