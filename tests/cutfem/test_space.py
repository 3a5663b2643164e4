"""B-splines on active cells: identities, a naive one, closed directions, bad input."""

import numpy as np
import pytest
from scipy.interpolate import BSpline as Reference

import ilattice as il
from ilattice.cutfem import Grid, SplineSpace
from ilattice.errors import InputError

AXES = (np.array([0.0, 0.3, 0.5, 1.0, 1.2]), np.linspace(-1, 1, 6), np.linspace(0, 2, 5))


KINDS = [(1, 0), (2, 1), (2, 0), (3, 2), (3, 1), (3, 0)]  # degree and smoothness


def space(p, r, closed=(False, False, False)):
    grid = Grid(AXES, closed)
    return SplineSpace(grid, p, np.arange(np.prod(grid.shape)), r)


def points(rng, n=40):
    lo, hi = Grid(AXES).domain
    return lo + (hi - lo) * rng.random((n, 3))


@pytest.mark.parametrize(("p", "r"), KINDS)
@pytest.mark.parametrize("closed", [(False,) * 3, (True, False, False), (False, True, True)])
def test_functions_are_those_of_scipy(p, r, closed):
    s = space(p, r, closed)
    rng = np.random.default_rng(p)
    u = points(rng)
    for a in range(3):
        places, times = np.unique(s.knots[a], return_counts=True)
        inner = (places > AXES[a][0]) & (places < AXES[a][-1])
        np.testing.assert_array_equal(places[inner], AXES[a][1:-1])
        assert (times[inner] == p - r).all()
    c = rng.normal(size=(len(s), 2))
    full = c.reshape(*s.shape, 2)
    value, gradient = s.evaluate(c, u)
    for nu in range(4):  # the value, then the derivative in each direction
        rows = []
        for a in range(3):
            n = len(s.knots[a]) - p - 1
            one = Reference(s.knots[a], np.eye(n), p)(u[:, a], nu=int(nu == a + 1))
            wrapped = np.zeros((len(u), s.shape[a]))
            np.add.at(wrapped.T, np.arange(n) % s.shape[a], one.T)
            rows.append(wrapped)
        expected = np.einsum("ni,nj,nk,ijkm->nm", *rows, full)
        found = value if nu == 0 else gradient[:, :, nu - 1]
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize(("p", "r"), KINDS)
def test_polynomials_are_reproduced_and_derivatives_continuous_as_asked(p, r):
    s = space(p, r)

    def f(u):
        return np.stack([(1 + u[:, 0]) ** p * u[:, 1] ** p, u[:, 2] ** p - u[:, 0]], axis=1)

    c = s.interpolate(f).reshape(-1, 2)
    u = points(np.random.default_rng(0))
    np.testing.assert_allclose(s.evaluate(c, u)[0], f(u), atol=1e-12)
    rng = np.random.default_rng(1)
    c = rng.normal(size=(len(s), 1))
    t = np.linspace(0.02, 0.18, p + 1)  # off the plane between two cells
    sides = []
    for x in (t, -t):
        v = s.evaluate(c, np.stack([0.5 + x, 0 * x + 0.1, 0 * x + 0.7], axis=1))[0][:, 0]
        sides.append(np.linalg.solve(np.vander(x, p + 1, increasing=True), v))
    jumps = np.abs(sides[0] - sides[1])  # of derivatives
    assert (jumps[: r + 1] < 1e-9).all()
    assert (jumps[r + 1 :] > 1e-2).all()


def test_only_functions_of_active_cells_are_kept():
    grid = Grid((np.arange(6.0),) * 3)
    for p, r in KINDS:
        one = SplineSpace(grid, p, np.array([31]), r)
        assert len(one) == (p + 1) ** 3
        two = SplineSpace(grid, p, np.array([31, 30]), r)  # neighbours in the last direction
        assert len(two) == (p + 1) ** 2 * (2 * p + 1 - r)
        np.testing.assert_array_equal(two.dofs[0].reshape((p + 1,) * 3)[..., p - r :],
                                      two.dofs[1].reshape((p + 1,) * 3)[..., : r + 1])  # fmt: skip
        u = np.array([[1.5, 0.2, 0.3], [1.5, 0.5, 1.8], [4.5, 4.5, 4.5]])
        value = two.evaluate(np.ones((len(two), 1)), u)[0]
        np.testing.assert_allclose(value[:2], 1, atol=1e-13)  # continued by one cell
        assert np.isnan(value[2]).all()


@pytest.mark.parametrize(("p", "r"), KINDS)
def test_the_seam_is_no_place(p, r):
    s = space(p, r, (True, False, False))
    c = np.random.default_rng(2).normal(size=(len(s), 1))
    v = [s.evaluate(c, np.array([[x, 0.2, 0.4]]))[0] for x in (0.0, 1.2, -1e-12)]
    np.testing.assert_allclose(v[1:], [v[0]] * 2, atol=1e-9)

    def wave(u):
        return np.cos(2 * np.pi * u[:, :1] / 1.2)

    fine = SplineSpace(Grid((np.linspace(0, 1.2, 41), *AXES[1:]), (True, False, False)), p,
                       np.arange(40 * 20), r)  # fmt: skip
    c = fine.interpolate(wave).reshape(-1, 1)
    u = points(np.random.default_rng(3))
    np.testing.assert_allclose(fine.evaluate(c, u)[0], wave(u), atol=0.2 * 0.15 ** (p + 1))


def test_bad_spaces_are_refused():
    grid = Grid(AXES, (False, False, True))
    for degree in (0, 4, 1.5, "2", True):
        with pytest.raises(InputError, match="degree"):
            SplineSpace(grid, degree, np.arange(3), 0)
    for cells in ([], [-1], [100]):
        with pytest.raises(InputError, match="cells"):
            SplineSpace(grid, 1, np.array(cells), 0)
    few = Grid((AXES[0], AXES[1], np.linspace(0, 1, 3)), (False, False, True))
    with pytest.raises(InputError, match="closed in direction w"):
        SplineSpace(few, 2, np.arange(3), 1)
    assert len(SplineSpace(few, 2, np.arange(3), 0))
    one = Grid((AXES[0], AXES[1], np.linspace(0, 1, 2)), (False, False, True))
    with pytest.raises(InputError, match="needs at least 2 cells"):
        SplineSpace(one, 2, np.arange(3), 0)
    for smoothness in (-1, 2, 0.5, "0", True):
        with pytest.raises(InputError, match=r"smoothness must be .* degree - 1 = 1"):
            SplineSpace(grid, 2, np.arange(3), smoothness)
    with pytest.raises(InputError, match="shape"):
        space(1, 0).evaluate(np.ones((150, 1)), [1.0, 2.0])
    assert il.cutfem.SplineSpace is SplineSpace
