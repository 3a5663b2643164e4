"""Critical points of the distance: the least means and Newton's method under them, and voids."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

import ilattice as il
from ilattice.topology import _kernels_balance, _kernels_hull, critical_sets, windows
from ilattice.topology.balance import Balance
from ilattice.topology.clearance import Clearance
from ilattice.topology.critical import CriticalSearch, critical_points
from ilattice.topology.several_feet import SeveralFeet
from ilattice.topology.windows import Starts, Windows

NODE = np.sqrt(3) / 4  # of Schwarz P in a unit cell: its middle to the flat points
#: Middles of struts of one labyrinth of the gyroid, where its voids close.
MIDDLES = np.array([[0.5, 0.375, 0.25], [0.25, 0.5, 0.875], [0.125, 0.75, 0.5], [0.375, 0.25, 0.5]])


def bent(name):
    return il.Lattice(name, through=il.macroshape.cylinder_shell(2.0, 3.0, 1.0, angle=0.4))


def box():
    return il.macroshape.box()


def straight(name="schwarz_p"):
    return il.Lattice(name, through=box())


# --- shortest means ---------------------------------------------------------------------------


def shortest(vectors):
    n = len(vectors)
    rows, weights, pull = np.empty((1, 4), np.int64), np.empty((1, 4)), np.empty(1)
    _kernels_hull.shortest_means(1, np.array([0, n]), vectors, rows, weights, pull)
    out = np.zeros(n)
    out[rows[rows >= 0]] = weights[rows >= 0]
    return out, pull[0]


def naive_shortest(vectors):
    """Non-negative least squares, with a heavy row for the sum of the weights."""
    a = np.vstack([vectors.T, np.full(len(vectors), 1e4)])
    return nnls(a, np.append(np.zeros(3), 1e4))[0]


@settings(max_examples=60, deadline=None)
@given(
    st.integers(1, 30), st.integers(0, 10**6), st.sampled_from([0.0, 0.3, 0.8, 2.0]), st.booleans()
)
def test_shortest_means_are_those_of_least_squares(n, seed, shift, flat):
    """Of unit vectors about a direction: the hull holds the origin, or not."""
    v = np.random.default_rng(seed).normal(size=(n, 3))
    v[:, 2] = 0.0 if flat else v[:, 2]
    v = v / np.linalg.norm(v, axis=1, keepdims=True) + [shift, 0.0, 0.0]
    weights, pull = shortest(v)
    assert weights.min() >= 0.0
    assert weights.sum() == pytest.approx(1.0, abs=1e-12)
    assert pull == pytest.approx(np.linalg.norm(weights @ v), abs=1e-12)
    assert pull == pytest.approx(np.linalg.norm(naive_shortest(v) @ v), abs=1e-5)
    assert ((v @ (weights @ v)) >= pull**2 - 1e-9).all()  # no vector points further back


@pytest.mark.parametrize("copies", [2, 5])
def test_vectors_may_repeat(copies):
    v = np.repeat([[1.0, 0.0, 0.0], [-0.5, 0.8, 0.0], [-0.5, -0.8, 0.1]], copies, axis=0)
    weights, pull = shortest(v)
    assert pull == pytest.approx(np.linalg.norm(naive_shortest(v) @ v), abs=1e-6)
    assert weights.sum() == pytest.approx(1.0, abs=1e-12)


def test_no_vectors_have_no_mean():
    rows, weights, pull = np.empty((1, 4), np.int64), np.empty((1, 4)), np.empty(1)
    _kernels_hull.shortest_means(1, np.array([0, 0]), np.empty((0, 3)), rows, weights, pull)
    assert np.isinf(pull[0])
    assert (rows == -1).all()


def test_many_means_are_those_of_each():
    rng = np.random.default_rng(1)
    ends = np.concatenate([[0], np.cumsum(rng.integers(0, 12, 300))])
    vectors = rng.normal((0.5, 0.0, 0.0), 1.0, (ends[-1], 3))
    rows, weights, pull = np.empty((300, 4), np.int64), np.empty((300, 4)), np.empty(300)
    _kernels_hull.shortest_means(len(pull), ends, vectors, rows, weights, pull)
    for n, (i, j) in enumerate(pairwise(ends.tolist())):
        if j > i:
            each, least = shortest(vectors[i:j])
            assert least == pull[n]
            np.testing.assert_array_equal(each[rows[n][rows[n] >= 0] - i], weights[n][rows[n] >= 0])
    assert np.isinf(pull[np.diff(ends) == 0]).all()


@pytest.mark.parametrize("n", [1, 4, 9, 24])
def test_small_systems_are_solved(n):
    rng = np.random.default_rng(n)
    a, y = rng.normal(size=(n, n)), rng.normal(size=n)
    x = y.copy()
    assert _kernels_hull.solve_small(a.copy(), x, n, 1e-12) > 1e-6
    np.testing.assert_allclose(a @ x, y, atol=1e-10)


def test_unknowns_that_nothing_determines_are_zero():
    a, x = np.diag([2.0, 0.0, 4.0]), np.array([2.0, 0.0, 2.0])
    assert _kernels_hull.solve_small(a, x, 3, 1e-12) == 0.0
    np.testing.assert_array_equal(x, [1.0, 0.0, 0.5])


def test_damped_steps_solve_the_normal_equations():
    rng = np.random.default_rng(0)
    a, y = rng.normal(size=(2, 9, 9))
    a[:, 3] = a[:, 4] + 1e-9  # singular
    want = np.linalg.solve(a.T @ a + 1e-4 * np.eye(9), a.T @ y[0])
    x = y[0].copy()
    _kernels_balance.solve_damped(a, x, 9, np.empty((9, 9)), np.empty(9))
    np.testing.assert_allclose(x, want, atol=1e-8)


# --- Newton's method --------------------------------------------------------------------------


def start(lattice, u, feet, weights, side=1):
    whole, heavy = np.zeros((1, 4, 3)), np.zeros((1, 4))
    whole[0, : len(feet)], heavy[0, : len(feet)] = lattice.search.to_tile(feet), weights
    p = lattice.search.to_tile(np.array([u], float))
    return Starts(p, whole, heavy, np.array([len(feet)]), side)


def test_the_neck_of_schwarz_p_is_found_from_two_feet_beside_it():
    """cos X + cos Y + cos Z = 0 on the plane X = pi, nearest to the axis at Y = Z = pi / 3."""
    lattice = straight()
    feet = 0.5 + np.array([[0.46, 0.17, 0.16], [0.47, -0.15, -0.18]])
    ends = Balance(Clearance(lattice)).ends(
        start(lattice, [1.0, 0.51, 0.47], feet, [0.6, 0.4]), (1, 0, 0)
    )
    np.testing.assert_allclose(ends.u, [[1.0, 0.5, 0.5]], atol=1e-10)
    assert ends.pulled.all()
    assert ends.last[0] < 1e-9


def test_starts_that_leave_the_domain_have_no_end():
    lattice = straight()
    feet = np.array([[0.95, 0.5, 0.75], [0.95, 0.5, 0.25]])
    far = start(lattice, [0.9, 0.2, 0.2], feet, [0.5, 0.5])
    assert len(Balance(Clearance(lattice)).ends(far, (0, 0, 0)).u) == 0


def test_ends_balance_whatever_the_map_and_the_thickness():
    """Against exact closest points: equal values at all feet, whose slopes have a mean of zero."""
    lattice = bent("gyroid")
    wall = lattice.offset(lambda u: 0.02 + 0.01 * u[:, 0])
    clearance = Clearance(lattice, wall.thickness.inner, wall.thickness.outer)
    search, feet = CriticalSearch(lattice, wall.thickness.inner, wall.thickness.outer), None
    search.look(0.15, 0.25, np.array([[0.0, 0.0, 0.0], [0.6, 0.6, 0.6]]))
    inside = [p for p in search.points if p.on == (0, 0, 0)]
    assert len(inside) > 10
    step = 1e-5
    for p in inside[:10]:
        value = abs(lattice.distance(p.u[None])[0]) - (0.02 + 0.01 * p.u[0])
        assert value == pytest.approx(p.value, abs=1e-10)
        feet = SeveralFeet(clearance)(p.u[None])[0]
        near = np.flatnonzero(feet.value <= value + 1e-7)
        slopes = np.zeros((len(near), 3))
        for a in range(3):  # slopes by differences of the distances to the feet
            e = step * np.eye(3)[a]
            up, down = (SeveralFeet(clearance)((p.u + s * e)[None])[0] for s in (1, -1))
            for i, k in enumerate(near):
                guess = feet.value[k] + step * feet.gradient[k, a] * np.array([1.0, -1.0])
                after = up.value[np.abs(up.value - guess[0]).argmin()]
                before = down.value[np.abs(down.value - guess[1]).argmin()]
                slopes[i, a] = (after - before) / (2 * step)
        assert shortest(slopes)[1] < 1e-3


# --- windows ----------------------------------------------------------------------------------


def every_start(lattice, low, high):
    grid = Windows(Clearance(lattice))
    parts = grid.parts((0, 0, 0), low, high, lattice.domain)
    return np.concatenate([s.p for part in parts for s in grid.starts(part, (0, 0, 0))])


def test_windows_start_where_feet_pull_both_ways():
    """Of a flat sheet's distance nowhere; of Schwarz P about the middle of the cell."""
    flat = il.Lattice(il.Tile(lambda u: u[:, 2] - 0.5), through=il.macroshape.box())
    assert len(every_start(flat, 0.1, 0.4)) == 0
    assert np.abs(every_start(straight(), 0.3, 0.5) - 0.5).max(axis=1).min() < 0.05


def test_events_do_not_depend_on_the_grid(monkeypatch):
    eighth = np.array([[0.0, 0.0, 0.0], [0.5, 0.5, 0.5]])
    found = []
    for finer in (1.5, 2.5):
        monkeypatch.setattr(windows, "FINER", finer)
        events = critical_points(bent("diamond"), 0.1, 0.3, within=eighth)
        found.append(sorted((round(p.value, 7), p.change) for p in events))
    assert len(found[0]) > 10
    np.testing.assert_allclose(found[0], found[1], atol=2e-7)


# --- critical curves and surfaces -------------------------------------------------------------


def told(points):
    return [(p.kind, p.feet, p.change, p.isolated) for p in points]


def test_one_point_stands_for_a_critical_plane():
    lattice = il.Lattice(il.Tile(lambda u: (u[:, 2] - 0.3) * (u[:, 2] - 0.7)), through=box())
    (point,) = critical_points(lattice, 0.05, 0.4, within=[[0.3, 0.3, 0.0], [0.7, 0.7, 1.0]])
    assert told([point]) == [("bridge", 2, -1, False)]
    assert point.value == pytest.approx(0.2, abs=1e-9)
    assert point.u[2] == pytest.approx(0.5, abs=1e-9)


def test_one_point_stands_for_the_axis_of_a_tube():
    lattice = il.Lattice(
        il.Tile(lambda u: ((u[:, :2] - 0.5) ** 2).sum(axis=1) - 0.09), through=box()
    )
    (point,) = critical_points(lattice, 0.1, 0.35)
    assert (point.kind, point.change, point.isolated) == ("neck", 1, False)
    assert point.value == pytest.approx(0.3, abs=1e-9)
    np.testing.assert_allclose(point.u[:2], 0.5, atol=1e-6)


def test_walls_of_honeycombs_meet_along_lines():
    """Of four sheets one block: by Euler numbers 4 - 4 + 1 = 1."""
    points = critical_points(straight("honeycomb_iwp"), 0.05, 0.4)
    assert told(points) == 4 * [("bridge", 2, -1, False)] + [("neck", 4, 1, False)]
    np.testing.assert_allclose([p.value for p in points], [1 / 6] * 4 + [0.125**0.5], atol=1e-9)
    places = sorted(p.u[:2].round(6).tolist() for p in points)
    assert places == [[0.0, 0.5], [0.5, 0.0], [0.5, 0.5], [0.5, 1.0], [1.0, 0.5]]


def test_a_channel_through_a_shell_closes_along_a_line():
    """Between two flat sheets, above and below: the same gap at every radius."""
    shell = il.macroshape.cylinder_shell(2.0, 3.0, 1.0)
    lattice = il.Lattice("honeycomb_iwp", through=shell, repeat=(12, 2, 2))
    (line,) = critical_points(lattice, 0.1, 0.17, within=[[0.24, 0.4, 0.0], [0.26, 0.6, 1.0]])
    assert told([line]) == [("neck", 2, 1, False)]
    assert line.value == pytest.approx(1 / 6, abs=1e-9)


def test_shells_that_meet_all_the_way_round_change_no_euler_number():
    """Two rings become one."""
    shell = il.macroshape.cylinder_shell(2.0, 3.0, 1.0)
    tile = il.Tile(lambda u: (u[:, 2] - 0.3) * (u[:, 2] - 0.7))
    lattice, part = il.Lattice(tile, through=shell), [[0.0, 0.45, 0.4], [1.0, 0.55, 0.6]]
    (point,) = critical_points(lattice, 0.19, 0.21, within=part)
    assert told([point]) == [("bridge", 2, 0, False)]
    assert point.value == pytest.approx(0.2, abs=1e-9)


def test_bent_sheets_that_touch_meet_once():
    """The half-thickness at which they do leaves nothing to which values could be relative."""
    shell = il.macroshape.cylinder_shell(2.0, 3.0, 1.0)
    tile = il.Tile(lambda u: (u[:, 2] - 0.3) * (u[:, 2] - 0.7))
    wall = il.Lattice(tile, through=shell, repeat=(2, 1, 1)).offset(0.2)
    taken = {"inner": wall.thickness.inner, "outer": wall.thickness.outer}
    part = [[0.1, 0.2, 0.0], [0.4, 0.8, 1.0]]
    (point,) = critical_points(wall.lattice, -0.01, 0.1, **taken, within=part)
    assert told([point]) == [("bridge", 2, -1, False)]
    assert point.value == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("x", "y", "w"), [(0.463, 0.427, 0.2637), (0.551, 0.42, 0.2935)])
def test_channels_anywhere_have_an_axis(x, y, w):
    """The planes half-way between opposite walls come near to the axis, and hide it not."""

    def sides(u):
        return ((u[:, :2] - [x, y] + w) * (u[:, :2] - [x, y] - w)).prod(axis=1)

    part = [[x - w, y - w, 0.0], [x + w, y + w, 1.0]]
    (point,) = critical_points(il.Lattice(il.Tile(sides), through=box()), 0.15, 0.35, within=part)
    assert told([point]) == [("neck", 4, 1, False)]
    assert point.value == pytest.approx(w, abs=1e-6)


def test_the_unit_of_the_tile_means_nothing():
    tile = il.tiles["schwarz_p"]
    tiles = [il.Tile(lambda u, s=s: s * tile(u)) for s in (1.0, 1e-6)]
    one, other = (critical_points(il.Lattice(t, through=box()), 0.2, 0.5) for t in tiles)
    assert told(one) == told(other)
    np.testing.assert_allclose([p.value for p in other], [p.value for p in one], atol=1e-9)


def links(u):
    """Pairs of points next to each other."""
    return np.column_stack([np.arange(len(u) - 1), np.arange(1, len(u))])


def test_rings_close_and_helices_do_not():
    shell = il.Lattice("gyroid", through=il.macroshape.cylinder_shell(2.0, 3.0, 1.0))
    clearance = Clearance(shell)
    turn = np.linspace(0.8, 1.7, 19)
    arc = np.column_stack([np.mod(turn, 1.0), 0.5 + 0.0 * turn, turn - 0.8])
    label = np.zeros(len(arc), np.int64)
    along, rings = critical_sets._unrolled(arc, links(arc), label, clearance)
    assert rings == set()
    np.testing.assert_allclose(along[:, 0], turn, atol=1e-12)
    closed = np.concatenate([links(arc), [[len(arc) - 1, 0]]])
    assert critical_sets._unrolled(arc, closed, label, clearance)[1] == {0}


# --- voids ------------------------------------------------------------------------------------


def test_the_middle_of_schwarz_p_is_a_void():
    middle = [[0.4, 0.4, 0.4], [0.6, 0.6, 0.6]]
    (void,) = critical_points(straight(), 0.4, 0.5, within=middle)
    np.testing.assert_allclose(void.u, 0.5, atol=1e-9)
    assert (void.kind, void.feet) == ("void", 8)
    assert void.value == pytest.approx(NODE, abs=1e-10)


def test_what_is_taken_off_lowers_the_void():
    """Off a distance that is at most NODE - |x| / sqrt(3) next to its greatest value."""
    lattice = straight()
    t = lattice.offset(lambda u: 0.1 + 0.02 * u[:, 0]).thickness
    middle = [[0.4, 0.4, 0.4], [0.6, 0.6, 0.6]]
    (void,) = critical_points(lattice, 0.3, 0.4, inner=t.inner, outer=t.outer, within=middle)
    np.testing.assert_allclose(void.u, 0.5, atol=1e-6)
    assert void.value == pytest.approx(NODE - 0.11, abs=1e-8)


def test_nothing_around_voids_of_a_bent_gyroid_is_higher():
    """They close next to focal curves, where two pairs of feet become two feet."""
    lattice = bent("gyroid")
    voids = [p for p in critical_points(lattice, 0.2, 0.25) if p.kind == "void"]
    for middle in MIDDLES:
        assert min(np.abs(p.u - middle).max() for p in voids) < 0.05
    rng = np.random.default_rng(0)
    for reach in (1e-4, 1e-3):
        steps = rng.uniform(-reach, reach, (200, 3))
        around = np.clip([p.u + steps for p in voids], *lattice.domain)
        value = np.abs(lattice.distance(around.reshape(-1, 3))).reshape(len(voids), -1)
        assert (value.max(axis=1) <= [p.value + 1e-9 for p in voids]).all()


@pytest.mark.parametrize("size", [1e-5, 1.0, 1e3])
def test_as_many_feet_are_nearest_in_any_unit(size):
    """Of the middle of a pore all eight; of a point beside it, 0.3 % of a tile nearer to one, 1."""
    lattice = il.Lattice("schwarz_p", through=il.macroshape.box(size))
    beside = 0.5 + 0.01 * np.array([0.3, 0.6, 1.0])
    middle, other = SeveralFeet(Clearance(lattice))(np.array([[0.5] * 3, beside]))
    assert middle.nearest.sum() == 8
    assert other.nearest.sum() == 1


def test_events_follow_the_unit_of_length():
    small, large = (
        critical_points(il.Lattice("schwarz_p", through=il.macroshape.box(s)), 0.2 * s, 0.5 * s)
        for s in (1e-3, 1e3)
    )
    assert [p.kind for p in small] == [p.kind for p in large] == 6 * ["neck"] + ["void"]
    np.testing.assert_allclose([p.value * 1e6 for p in small], [p.value for p in large], rtol=1e-9)


def test_progress_is_told():
    told = []
    critical_points(straight(), 0.2, 0.25, progress=lambda *a: told.append(a))
    assert told[-1][1] == told[-1][2] == len(told) > 2
