"""Box splines as fields and as tiles: exact polynomials, derivatives, bounds, meshes."""

import numpy as np
import pytest

import ilattice as il
from ilattice.cost import boxspline
from ilattice.cost.boxspline import BoxSpline
from ilattice.errors import InputError


def spline(dim, seed=0, **options):
    rng = np.random.default_rng(abs(seed))
    c = rng.standard_normal((4, 5, 6)[:dim])
    steps = 10.0**seed * rng.standard_normal((dim, 3))
    return BoxSpline(c, origin=rng.standard_normal(3), steps=steps, **options)


def test_values_in_the_plane_are_those_of_the_three_directions():
    # M over (1,0), (0,1), (1,1) doubled is the convolution of two Courant hats, integrated here
    # over a fine grid of midpoints: second order
    s = BoxSpline([[1.0]], outside=0.0, steps=np.eye(3)[:2])

    def hat(p):
        u, v = p[..., 0], p[..., 1]
        return np.maximum(0.0, 1.0 - np.maximum(np.maximum(np.abs(u), np.abs(v)), np.abs(u - v)))

    n = 160
    a = (np.arange(2 * n) + 0.5) / n - 1.0
    q = np.stack(np.meshgrid(a, a, indexing="ij"), -1)
    for x in np.random.default_rng(3).uniform(-1.9, 1.9, (6, 2)):
        mean = (hat(q) * hat(x - q)).sum() / n**2
        assert -s([[*x, 0.7]])[0] == pytest.approx(mean, abs=2e-5)


@pytest.mark.parametrize("dim", [2, 3])
def test_values_are_limits_of_subdivision(dim):
    s = spline(dim)
    c = s.control
    fine, steps = c, 4
    for _ in range(steps):
        fine = boxspline.subdivided(fine)
    ids = np.argwhere(np.ones(fine.shape))
    ids = ids[((ids > 16) & (ids < np.array(fine.shape) - 17)).all(axis=1)][::7]
    x = s.origin + (ids / 2.0**steps) @ s.steps
    off = np.abs(-s(x) - fine[tuple(ids.T)])
    assert 0.0 < off.max() < 0.03 * np.ptp(c)  # controls tend to values by a quarter per step
    coarser = boxspline.subdivided(boxspline.subdivided(c))
    even = ids[(ids % 4 == 0).all(axis=1)]
    before = np.abs(-s(s.origin + (even / 16.0) @ s.steps) - coarser[tuple((even // 4).T)]).max()
    after = np.abs(-s(s.origin + (even / 16.0) @ s.steps) - fine[tuple(even.T)]).max()
    assert after < 0.09 * before


@pytest.mark.parametrize(("dim", "seed"), [(2, 1), (3, 0), (3, -4)])
def test_derivatives_and_bounds(dim, seed):
    s = spline(dim, seed)
    rng = np.random.default_rng(5)
    lattice = rng.uniform(-3.5, 8.0, (200, dim))
    x = s.origin + lattice @ s.steps
    size = np.linalg.norm(s.steps, axis=1).mean()
    _, g, h = s.jet(x)
    e = 1e-5 * size
    for k in range(3):
        dx = np.zeros(3)
        dx[k] = e
        np.testing.assert_allclose((s(x + dx) - s(x - dx)) / (2 * e), g[:, k], atol=1e-7 / size)
        change = (s.jet(x + dx, 1)[1] - s.jet(x - dx, 1)[1]) / (2 * e)
        np.testing.assert_allclose(change, h[:, k], atol=1e-6 / size**2)
    assert np.linalg.norm(g, axis=1).max() <= s.lipschitz
    for wide in (0.01, 0.4, 2.0, 9.0, 60.0):
        hi = x + wide * size * rng.uniform(0.1, 1.0, x.shape)
        low, high = s.range(x, hi).T
        for _ in range(40):
            v = s(x + (hi - x) * rng.random(x.shape))
            assert ((low <= v) & (v <= high)).all()
    assert (np.ptp(s.range(x, x + 1e-6 * size), axis=1) < 1e-4).all()
    far = s.origin + 40.0 * s.steps.sum(axis=0)
    assert s([far])[0] == 1.0


def test_periodic_splines_repeat_and_fill():
    c = np.random.default_rng(1).standard_normal((3, 2, 4))
    s = BoxSpline(c, periodic=True)
    x = np.random.default_rng(2).uniform(-9, 9, (200, 3))
    np.testing.assert_allclose(s(x + np.array([3.0, -2.0, 8.0])), s(x), atol=1e-13)
    np.testing.assert_allclose(s(x), BoxSpline(np.tile(c, (9, 13, 7)), origin=(-12, -12, -12))(x),
                               atol=1e-13)  # fmt: skip
    np.testing.assert_allclose(BoxSpline(np.full((2, 2, 2), 0.3), periodic=True)(x), -0.3)


def test_the_solid_of_a_structure():
    corners = np.array([(0.1, 0, 0), (2, 0.3, 0), (0.4, 1.7, 0.2), (0, 0.5, 1.9)])
    k = il.cost.kagome(5, corners=corners)
    f = boxspline.field(k)
    inner = np.bincount(k.simplices.ravel()) == 2
    assert f(k.positions[inner]).max() < -0.1  # fewer neighbours near faces
    assert f(k.positions[k.simplices].mean(axis=1)).max() < 0.1
    mesh = il.sdf.mesh(f, 0.03)
    assert mesh.is_watertight
    assert np.percentile(np.abs(f(mesh.vertices)), 95) < 1e-4
    moved = f.bounds
    assert (mesh.vertices >= moved[0]).all()
    assert (mesh.vertices <= moved[1]).all()
    fine = boxspline.samples(k, 3)
    part = (fine > 0).sum() / 8.0**3 * abs(np.linalg.det(f.steps))
    assert mesh.volume == pytest.approx(part, rel=0.02)
    flat = boxspline.field(il.cost.kagome(4, dim=2))
    p = np.random.default_rng(0).uniform(0, 1, (50, 3))
    np.testing.assert_array_equal(flat(p), flat(p * (1, 1, -30)))
    assert np.isinf(flat.bounds[:, 2]).all()
    assert np.isfinite(flat.bounds[:, :2]).all()


def test_the_tile_is_the_inside_of_a_structure():
    k = il.cost.kagome(8)
    f, tile = boxspline.field(k), boxspline.tile()
    lattice = np.random.default_rng(0).uniform(3.0, 4.5, (300, 3))  # of 17 in all
    x = f.origin + lattice @ f.steps
    np.testing.assert_allclose(tile(np.mod(0.5 * lattice, 1.0)), f(x), atol=1e-12)
    assert tile.periodic == (True, True, True)
    cell = tile.cell
    np.testing.assert_allclose(cell.T @ cell, 0.5 + 0.5 * np.eye(3), atol=1e-12)
    mesh = il.Lattice(tile, through=il.macroshape.box((1, 1, 1))).offset((np.inf, 0.0)).mesh(0.04)
    assert mesh.is_watertight


def test_odd_arguments():
    for bad, told in (
        ({"control": np.zeros(3)}, "2 or 3 axes"),
        ({"control": np.zeros((2, 0))}, "2 or 3 axes"),
        ({"control": np.full((2, 2), np.nan)}, "control"),
        ({"control": np.ones((2, 2)), "steps": np.eye(3)}, "steps must have shape"),
        ({"control": np.ones((2, 2)), "steps": [[1, 0, 0], [2, 0, 0]]}, "independent"),
        ({"control": np.ones((2, 2)), "origin": (0, 0)}, "origin"),
        ({"control": np.ones((2, 2)), "periodic": "yes"}, "periodic"),
        ({"control": np.ones((2, 2)), "outside": np.inf}, "outside"),
    ):
        with pytest.raises(InputError, match=told):
            BoxSpline(**bad)
    k = il.cost.kagome(3)
    with pytest.raises(InputError, match="affine"):
        boxspline.field(k.mapped(il.macroshape.torus()))
    with pytest.raises(InputError, match="kagome"):
        boxspline.field(k.refined())
