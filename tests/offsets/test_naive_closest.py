"""The oracle of the closest-point search against differences and dense samples."""

import macro_zoo
import naive_closest as nc
import numpy as np
import pytest

import ilattice as il


def differences(f, p, h=1e-6):
    e = np.eye(3) * h
    return np.stack([(f(p + e[k]) - f(p - e[k])) / (2 * h) for k in range(3)], axis=-1)


@pytest.fixture(scope="module", params=["extend", "clip"])
def oracle(request):
    lattice = il.Lattice(
        "gyroid", through=macro_zoo.ZOO["duck"], repeat=(2, 2, 1), boundary=request.param
    )
    return nc.Oracle("gyroid", lattice, 12)


@pytest.fixture(scope="module")
def answers(oracle):
    q = nc.queries(oracle, 100, 3)
    return q, *oracle.distance(q)


@pytest.mark.parametrize("name", nc.TERMS)
def test_tiles_are_those_of_the_catalogue_and_have_their_derivatives(name):
    p = np.random.default_rng(0).uniform(-1, 2, (40, 3))
    f, g, h = nc.tile_jet(name, p)
    tile = il.tiles[name]
    np.testing.assert_allclose(f, tile(p - np.floor(p)), atol=1e-12)
    np.testing.assert_allclose(differences(lambda x: nc.tile_jet(name, x)[0], p), g, atol=1e-6)
    np.testing.assert_allclose(differences(lambda x: nc.tile_jet(name, x)[1], p), h, atol=1e-5)


@pytest.mark.parametrize("name", ["torus", "duck", "perturbed rational"])
def test_maps_have_their_derivatives_and_wrap(name):
    through = macro_zoo.ZOO[name]
    space = nc.NaiveMap(through.spline, through.closed, (3, 2, 2))
    p = np.random.default_rng(1).uniform(0.05, 0.95, (30, 3)) * (3, 2, 2)
    x, jac, hess = space.jet(p)
    scale = np.abs(hess).max()
    np.testing.assert_allclose(differences(lambda q: space.jet(q, 0)[0], p), jac, atol=1e-8 * scale)
    np.testing.assert_allclose(
        differences(lambda q: space.jet(q, 1)[1], p), hess, atol=1e-6 * scale
    )
    if through.closed[0]:
        np.testing.assert_allclose(space.jet(p + np.array([3.0, 0.0, 0.0]), 0)[0], x, atol=1e-12)


@pytest.mark.parametrize("name", nc.TERMS)
def test_samples_lie_on_the_surface_and_hit_corners(name):
    p = nc.tile_samples(name, 6)
    assert np.abs(nc.tile_jet(name, p)[0]).max() < 1e-12
    assert ((p >= 0) & (p <= 1)).all()
    corner = np.zeros((1, 3))
    assert (np.abs(p).max(axis=1) == 0).any() == (abs(nc.tile_jet(name, corner)[0][0]) < 1e-13)


def test_distances_are_those_of_feet_on_the_surface(oracle, answers):
    q, distance, foot = answers
    x, y = oracle.map.jet(q, 0)[0], oracle.map.jet(foot, 0)[0]
    np.testing.assert_allclose(np.linalg.norm(x - y, axis=1), distance, atol=1e-12)
    assert np.abs(nc.tile_jet("gyroid", foot)[0]).max() < 1e-11
    if oracle.clip:
        assert ((foot > -1e-9) & (foot < oracle.box[1] + 1e-9)).all()


def test_distances_are_those_to_dense_samples(oracle, answers):
    """At most those, and at least those less what a grid cell can hide."""
    q, distance, _ = answers
    x = oracle.map.jet(q, 0)[0]
    p, y, size = oracle.samples(np.arange(len(oracle.tiles)), 24)[:3]
    for i in range(0, len(q), 2):
        usable = oracle._reached(p, np.broadcast_to(q[i], p.shape))
        d = np.linalg.norm(y[usable] - x[i], axis=1)
        k = np.argmin(d)
        assert distance[i] <= d[k] + 1e-12
        assert distance[i] >= d[k] - size[usable][k]


def test_feet_are_perpendicular(oracle, answers):
    q, distance, foot = answers
    x = oracle.map.jet(q, 0)[0]
    y, jac = oracle.map.jet(foot, 1)
    n = np.linalg.solve(jac.transpose(0, 2, 1), nc.tile_jet("gyroid", foot)[1][:, :, None])[:, :, 0]
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    inner = ((foot > 1e-6) & (foot < np.array(oracle.lattice.repeat) - 1e-6)).all(axis=1)
    off = np.linalg.norm(np.cross(x - y, n), axis=1)
    assert inner.sum() > 30
    assert (off[inner] <= 1e-5 * distance[inner] + 1e-9).all()


def test_queries_are_of_all_kinds(oracle):
    q = nc.queries(oracle, 700, 0)
    count = np.array(oracle.lattice.repeat)
    assert ((q >= 0) & (q <= count)).all()
    f, g, _ = nc.tile_jet("gyroid", q)
    assert (np.abs(f) < 1e-12).sum() >= 40
    assert ((np.abs(f) > 1e-12) & (np.abs(f) < 0.05)).sum() >= 40
    assert (np.linalg.norm(g, axis=1) < 1e-9).sum() >= 20
    faces = (q == 0) | (q == count)
    assert faces.any(axis=1).sum() >= 40
    assert (faces.sum(axis=1) >= 2).sum() >= 20
    assert (np.abs(q - np.round(q)).max(axis=1) < 0.01).sum() >= 40
    det = np.abs(np.linalg.det(oracle.map.jet(q, 1)[1]))
    assert (det < np.quantile(det[:350], 0.02)).sum() >= 40


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
def test_sheets_that_do_not_count_hide_none_that_do():
    """In a bend of the G, the hundred samples next to a query are of the fold of another part."""
    oracle = nc.Oracle("primitive", nc.lattice_of("G", "primitive", "extend"), 20)
    q = np.array([[14.99861541, 0.0, 2.99977835], [14.01, 0.3, 2.9]])
    x = oracle.map.jet(q[:1], 0)[0]
    foot, step = oracle._descend(x, np.array([[14.5484, -0.2436, 2.9334]]), ())
    assert step[0] < 1e-9
    known = oracle._measure(x, q[:1], foot, ())[1]
    assert oracle.distance(q)[0][0] <= known[0] * (1 + 1e-9)
