"""What a distance must obey: eikonal equation, parallel surfaces, Lipschitz, twins, the oracle."""

import macro_zoo
import naive_closest as nc
import numba
import numpy as np
import pytest

import ilattice as il
from ilattice.offsets.polish import distance_jet

CASES = {
    "torus": ("gyroid", macro_zoo.ZOO["torus"], (6, 2, 1), "extend"),
    "duck": ("iwp", macro_zoo.ZOO["duck"], (4, 2, 2), "extend"),
    "rational": ("primitive", macro_zoo.ZOO["perturbed rational"], (2, 1, 3), "clip"),
    "left-handed": ("gyroid", macro_zoo.ZOO["left-handed"], (4, 2, 2), "extend"),
}
#: Central differences of sixth order: offsets in steps, weights of the first and second derivative.
OFFSETS = np.array([-3, -2, -1, 0, 1, 2, 3])
FIRST = np.array([-1, 9, -45, 0, 45, -9, 1]) / 60
SECOND = np.array([2, -27, 270, -490, 270, -27, 2]) / 180


@pytest.fixture(scope="module", params=CASES)
def lattice(request):
    tile, through, repeat, boundary = CASES[request.param]
    return il.Lattice(tile, through=through, repeat=repeat, boundary=boundary)


def inner_points(lattice, n, seed):
    """Parameters off the ends of the domain."""
    lo, hi = lattice.domain
    return lo + np.random.default_rng(seed).uniform(0.03, 0.97, (n, 3)) * (hi - lo)


def tile_size(lattice, u):
    """Shortest side of the tiles at parameters."""
    return np.linalg.norm(lattice.through.jacobian(u) * lattice.search.step, axis=1).min(axis=1)


def along_lines(lattice, u, e, h):
    """Signed distances at OFFSETS times h from points along directions, and how feet move, (n, 7).

    Points of space are reached by Newton's method on the map.
    """
    x = lattice.through.x(u)[:, None] + (OFFSETS[:, None] * h[:, None, None]) * e[:, None]
    p = np.repeat(u[:, None], len(OFFSETS), axis=1).reshape(-1, 3)
    for _ in range(12):
        y, jac = lattice.through.jet(p, 1, extrapolate="extend")
        p = p - np.linalg.solve(jac, (y - x.reshape(-1, 3))[..., None])[..., 0]
    np.testing.assert_allclose(lattice.through.x(p), x.reshape(-1, 3), atol=1e-12)
    found = lattice.closest(p)
    foot = found.foot.reshape(-1, len(OFFSETS), 3)
    jump = np.linalg.norm(np.diff(foot, axis=1), axis=2).max(axis=1)
    return found.distance.reshape(-1, len(OFFSETS)), jump


def test_the_gradient_has_length_one_off_the_medial_axis(lattice):
    """And is that of `distance_jet`, for x as well as for u."""
    u = inner_points(lattice, 250, 0)
    h = 5e-4 * tile_size(lattice, u)
    gradient, smooth = np.empty_like(u), np.ones(len(u), bool)
    for a in range(3):
        d, jump = along_lines(lattice, u, np.tile(np.eye(3)[a], (len(u), 1)), h)
        gradient[:, a] = d @ FIRST / h
        smooth &= jump < 3.0 * h
    assert smooth.mean() > 0.85
    length = np.linalg.norm(gradient[smooth], axis=1)
    np.testing.assert_allclose(length, 1.0, rtol=0, atol=1e-6)
    x, jac = lattice.through.jet(u, 1)
    value, slope, lost = distance_jet(lattice, u, x, jac)
    assert not lost.any()
    np.testing.assert_array_equal(value, lattice.distance(u))
    by_differences = np.einsum("nc,nca->na", gradient, jac)
    scale = np.linalg.norm(jac, axis=1)
    np.testing.assert_allclose((slope / scale)[smooth], (by_differences / scale)[smooth], atol=2e-6)


def shape_operator(lattice, u):
    """Unit normals (n, 3), two tangents (n, 3, 2) and the shape operator in them, naively."""
    space = nc.NaiveMap(lattice.through.spline, lattice.through.closed, lattice.repeat)
    p = lattice.tile_coordinates(u)
    _, jac, hess = space.jet(p)
    g, bend = nc.tile_jet(lattice.tile.name, p)[1:]
    back = np.linalg.inv(jac)
    n = np.einsum("nka,nk->na", back, g)
    size = np.linalg.norm(n, axis=1)
    n /= size[:, None]
    second = bend / size[:, None, None] - np.einsum("nc,ncij->nij", n, hess)
    in_space = np.einsum("nia,nij,njb->nab", back, second, back)
    t = np.linalg.svd(n[:, None, :])[2][:, 1:].transpose(0, 2, 1)
    return n, t, np.einsum("nai,nab,nbj->nij", t, in_space, t)


def test_second_derivatives_are_those_of_parallel_surfaces(lattice):
    """In the principal directions of the foot they are k / (1 + d k), along the normal 0.

    The few that differ are next to knots, where third derivatives of the map jump.
    """
    u = inner_points(lattice, 250, 1)
    found = lattice.closest(u)
    n, t, shape = shape_operator(lattice, found.u)
    k, w = np.linalg.eigh(shape)
    away = lattice.through.x(u) - found.foot
    inner = found.status == 0
    far = inner & (np.abs(found.distance) > 0.02 * tile_size(lattice, u))
    np.testing.assert_allclose((away / found.distance[:, None])[far], n[far], atol=1e-6)
    stretch = 1.0 + found.distance[:, None] * k
    directions = [n, *(np.einsum("nai,ni->na", t, w[:, :, i]) for i in range(2))]
    expected = [np.zeros(len(u)), *(k / stretch).T]
    h = 4e-3 * tile_size(lattice, u)
    firm = inner & (stretch > 0.5).all(axis=1) & (np.abs(k) * h[:, None] < 0.1).all(axis=1)
    for e, want in zip(directions, expected, strict=True):
        d, jump = along_lines(lattice, u, e, h)
        smooth = firm & (jump < 3.0 * h)
        assert smooth.mean() > 0.5
        got = d @ SECOND / h**2
        error = np.abs(got - want)[smooth] * tile_size(lattice, u)[smooth]
        assert (error < 1e-4).mean() > 0.97
        assert error.max() < 0.5


def test_distances_change_no_faster_than_places(lattice):
    """Anywhere without sign; with sign for neighbours, whose segment crosses the surface."""
    rng = np.random.default_rng(2)
    u = inner_points(lattice, 1500, 3)
    lo, hi = lattice.domain
    near = np.clip(
        u + rng.standard_normal(u.shape) * 10.0 ** rng.uniform(-5, -1.5, (len(u), 1)), lo, hi
    )
    d, d_near = lattice.distance(u), lattice.distance(near)
    x, x_near = lattice.through.x(u), lattice.through.x(near)
    slack = 1e-8 * tile_size(lattice, u).max()
    step = np.linalg.norm(x - x_near, axis=1)
    assert (np.abs(d - d_near) <= step * (1 + 1e-6) + slack).all()
    i, j = rng.integers(len(u), size=(2, 20000))
    apart = np.linalg.norm(x[i] - x[j], axis=1)
    assert (np.abs(np.abs(d[i]) - np.abs(d[j])) <= apart + slack).all()


def test_both_feet_are_known_across_the_medial_axis(lattice):
    """Between two points whose feet differ, the nearest feet trade places."""
    u, v = inner_points(lattice, 300, 4), inner_points(lattice, 300, 5)
    v = u + 0.1 * (v - u)
    foot_u, foot_v = lattice.closest(u).foot, lattice.closest(v).foot
    for _ in range(24):
        middle = 0.5 * (u + v)
        foot = lattice.closest(middle).foot
        left = np.linalg.norm(foot_u - foot, axis=1) > np.linalg.norm(foot - foot_v, axis=1)
        left = left[:, None]
        u, foot_u = np.where(left, u, middle), np.where(left, foot_u, foot)
        v, foot_v = np.where(left, middle, v), np.where(left, foot, foot_v)
    a, b = lattice.closest(u), lattice.closest(v)
    crossed = np.linalg.norm(a.foot - b.foot, axis=1) > 0.1 * tile_size(lattice, u)
    assert crossed.sum() > 10
    a, b = (
        {f: getattr(c, f)[crossed] for f in ("foot", "second", "distance", "second_distance")}
        for c in (a, b)
    )
    np.testing.assert_allclose(a["second_distance"], a["distance"], rtol=1e-5)
    np.testing.assert_allclose(
        a["second"], b["foot"], atol=1e-4 * lattice.search.seeds.spacing.max()
    )
    np.testing.assert_allclose(
        b["second"], a["foot"], atol=1e-4 * lattice.search.seeds.spacing.max()
    )


def test_second_feet_of_a_stack_of_planes():
    """Half-way between planes a third of the part apart, and beyond the last one only one foot."""
    planes = il.Tile(lambda u: np.cos(2 * np.pi * u[:, 0]))
    lattice = il.Lattice(planes, through=il.macroshape.box((1, 1, 1)), boundary="clip")
    x = np.array([0.5, 0.501, 0.44, 0.3])
    found = lattice.closest(np.stack([x, np.full(4, 0.37), np.full(4, 0.61)], axis=1))
    np.testing.assert_allclose(np.abs(found.distance), [0.25, 0.249, 0.19, 0.05], atol=1e-4)
    np.testing.assert_allclose(np.abs(found.second_distance)[:2], [0.25, 0.251], atol=1e-4)


@pytest.mark.threads
def test_results_are_the_same_for_any_number_of_threads_and_order(lattice):
    u = inner_points(lattice, 1500, 6)
    whole = lattice.closest(u)
    order = np.random.default_rng(7).permutation(len(u))
    mixed = lattice.closest(u[order])
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        alone = lattice.closest(u)
    finally:
        numba.set_num_threads(threads)
    for name in ("foot", "u", "distance", "status", "second", "second_distance", "iterations"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(alone, name))
        np.testing.assert_array_equal(getattr(whole, name)[order], getattr(mixed, name))


@pytest.mark.parametrize("case", ["torus", "duck", "rational"])
def test_distances_are_those_of_the_oracle(case):
    """At random points and where it is hard; see `compare_closest_points.py` for larger sets."""
    tile, through, repeat, boundary = CASES[case]
    lattice = il.Lattice(tile, through=through, repeat=repeat, boundary=boundary)
    oracle = nc.Oracle(tile, lattice, 12)
    q = nc.queries(oracle, 150, 8)
    found = lattice.closest(nc.parameters(lattice, q))
    assert (found.status < 2).all()
    np.testing.assert_allclose(np.abs(found.distance), oracle.distance(q)[0], rtol=1e-7, atol=1e-8)
