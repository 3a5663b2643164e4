"""Ranks, stiffening, stresses: against dense linear algebra, counts and known frameworks."""

import warnings

import numpy as np
import pytest
from cost_zoo import octahedron

import ilattice as il
from ilattice.cost import CornerSharing, counting, job, refinement, rigidity, stress
from ilattice.errors import GeometryError, InputError, PrecisionWarning

DENSE = np.linalg.matrix_rank


def naive_matrix(k):
    R = np.zeros((len(k.edges), k.positions.size))
    for row, (i, j) in zip(R, k.edges, strict=True):
        way = k.positions[i] - k.positions[j]
        row[k.dim * i : k.dim * (i + 1)] = way
        row[k.dim * j : k.dim * (j + 1)] = -way
    return R


@pytest.mark.parametrize("dim", [2, 3])
def test_the_matrix_and_its_products(dim):
    k = il.cost.kagome(4, dim=dim).stiffened().perturbed(0.2, seed=3)
    R = naive_matrix(k)
    assert np.array_equal(rigidity.matrix(k).toarray(), R)
    rng = np.random.default_rng(0)
    u, s = rng.standard_normal(k.positions.shape), rng.standard_normal(len(k.edges))
    np.testing.assert_allclose(rigidity.stretched(k, u), R @ u.ravel(), atol=1e-13)
    np.testing.assert_allclose(rigidity.gathered(k, s).ravel(), R.T @ s, atol=1e-13)
    T = rigidity.rigid_motions(k)
    assert np.abs(R @ T).max() < 1e-13
    np.testing.assert_allclose(T.T @ T, np.eye(k.trivial), atol=1e-13)


@pytest.mark.parametrize("dim", [2, 3])
def test_no_rigid_motion_is_left_to_free_columns(dim):
    k = il.cost.kagome(4, dim=dim).stiffened().perturbed(0.2, seed=3)
    free = rigidity.free_columns(k)
    held = np.setdiff1d(np.arange(k.positions.size), free)
    assert len(held) == k.trivial == (3 if dim == 2 else 6)
    assert np.linalg.cond(rigidity.rigid_motions(k)[held]) < 100.0
    R = naive_matrix(k)
    assert DENSE(R[:, free]) == DENSE(R) == len(free)


@pytest.mark.parametrize("level", [3, 4, 5, 6])
def test_regular_kagome_structures_have_no_self_stress(level):
    k = il.cost.kagome(level)
    found = k.rigidity()
    assert found.rank == len(k.edges) == DENSE(naive_matrix(k))
    assert found.self_stresses == 0
    assert found.flexes == k.deficit
    assert not found.rigid


@pytest.mark.parametrize(
    ("level", "edges", "short"), [(5, 378, 11), (6, 630, 12), (9, 1938, 15), (10, 2598, None)]
)
def test_patterns_are_right_for_generic_positions_and_never_for_regular_ones(level, edges, short):
    base = il.cost.kagome(level)
    with pytest.warns(PrecisionWarning, match="short of rigidity"):
        k = base.stiffened("pattern")
    assert len(k.edges) == edges == 3 * len(k.positions) - 6
    bars = np.bincount(k.bars.ravel(), minlength=len(k.positions))
    assert set(bars[(base.origin.integers == 0).any(axis=1)]) == {3}
    generic = k.rigidity(generic=True)
    assert generic.minimal
    assert generic.perturbation == 0.05
    assert not k.is_rigid()
    if short is not None:  # even all bars in the faces do not do it
        assert k.rigidity().flexes >= short
        i = base.origin.integers
        pairs = [np.stack(np.triu_indices(int((i[:, j] == 0).sum()), 1), 1) for j in range(4)]
        faces = [np.flatnonzero(i[:, j] == 0)[p] for j, p in enumerate(pairs)]
        bars = np.concatenate(faces)
        near = np.linalg.norm(np.diff(base.positions[bars], axis=1)[:, 0], axis=1)
        bars = bars[near < 2.01 * base.lengths.mean()]
        with pytest.raises(GeometryError, match="reach a rank of") as error:
            il.cost.stiffening.completed(base, bars)
        assert f"{len(base.edges) + base.deficit - short} of" in str(error.value)


@pytest.mark.parametrize(("level", "reach"), [(5, 2.3), (6, 2.3), (9, 2.7)])
def test_independent_bars_make_regular_structures_rigid(level, reach):
    k = il.cost.kagome(level).stiffened(reach=reach).check()
    found = k.rigidity()
    assert found.minimal
    assert found.least > 1e-4
    way = np.diff(k.positions[k.bars], axis=1)[:, 0]
    assert (
        np.linalg.norm(way, axis=1).max()
        <= reach * k.lengths[: 6 * len(k.simplices)].mean() * 1.001
    )
    if level == 5:
        assert DENSE(naive_matrix(k)) == len(k.edges) == 378


def test_bars_do_not_hang_on_rounding():
    k = il.cost.kagome(3)
    noise = 1e-13 * np.random.default_rng(8).normal(size=k.positions.shape)
    moved = k.mapped(lambda x: x + noise)
    np.testing.assert_array_equal(moved.stiffened().bars, k.stiffened().bars)


def test_bars_out_of_reach_are_told():
    with pytest.raises(GeometryError, match=r"bars up to 1\.2 .* reach a rank of \d+ of 378"):
        il.cost.kagome(5).stiffened(reach=1.2)
    with pytest.raises(InputError, match="needs a resolution l with l mod 4 of 1 or 2, got 4"):
        il.cost.kagome(4).stiffened("pattern")


@pytest.mark.parametrize("level", [5, 10])
def test_rings_stiffen_plane_structures(level):
    with pytest.warns(PrecisionWarning, match="short of rigidity"):
        k = il.cost.kagome(level, dim=2).stiffened("cycle").check()
    assert len(k.bars) == 3 * level - 3
    assert k.rigidity(generic=True).minimal
    assert k.rigidity().flexes == level // 2
    assert counting.pebble_rank(len(k.positions), k.edges)[0] == 2 * len(k.positions) - 3
    if level == 5:
        assert il.cost.kagome(level, dim=2).stiffened("cycle", repair=True).rigidity().minimal


def banana():
    """Two stiffened Kagome structures that share two corners."""
    with pytest.warns(PrecisionWarning):
        k = il.cost.kagome(5).stiffened("pattern")
    i, n = k.origin.integers, len(k.positions)
    pins = [int(np.argmax(i[:, j])) for j in (0, 1)]
    mirror = k.positions.copy()
    axis = k.positions[pins[1]] - k.positions[pins[0]]
    axis /= np.linalg.norm(axis)
    way = mirror - k.positions[pins[0]]
    mirror = k.positions[pins[0]] + 2.0 * np.outer(way @ axis, axis) - way
    rest = np.setdiff1d(np.arange(n), pins)
    name = np.empty(n, int)
    name[pins], name[rest] = pins, n + np.arange(n - 2)
    return CornerSharing(
        np.concatenate([k.positions, mirror[rest]]),
        np.concatenate([k.simplices, name[k.simplices]]),
        np.concatenate([k.bars, name[k.bars]]),
    ).check()


def test_two_bodies_that_share_two_corners_pass_all_counts_and_are_not_rigid():
    k = banana()
    assert (len(k.positions), len(k.edges), k.deficit) == (254, 756, 0)
    assert counting.necessary(k)
    found = k.rigidity(generic=True)
    assert found.rank == 755
    assert not k.is_rigid(generic=True)
    assert not k.is_rigid()
    with pytest.raises(GeometryError, match="not rigid at these positions, though it has enough"):
        k.perturbed().stress(np.zeros_like(k.positions) + 0.0)


def test_an_octahedron_of_kagome_structures_is_stiffened():
    k = octahedron(5).perturbed().stiffened(reach=3.0)
    assert len(k.bars) == 186
    assert k.rigidity().minimal
    with pytest.warns(PrecisionWarning, match="1 of the 480 edges depend on others"):
        regular = octahedron(3).stiffened()
    found = regular.rigidity()
    assert (found.rigid, found.self_stresses) == (True, 1)


def test_ranks_do_not_depend_on_the_way_they_are_found(monkeypatch):
    k = il.cost.kagome(5).perturbed(0.1)
    monkeypatch.setattr(rigidity, "SPARSE", 100)
    flexible = k.with_bars(k.stiffened().bars[:-7])
    redundant = k.with_bars(np.concatenate([k.stiffened().bars, [[0, len(k.positions) - 1]]]))
    for s, rank in ((flexible, len(k.edges) + 65), (redundant, len(k.edges) + 72)):
        assert s.rigidity().rank == rank
        with monkeypatch.context() as m:
            m.setattr(rigidity, "SPARSE", 10**9)
            assert s.rigidity().rank == rank
    with monkeypatch.context() as m:
        m.setattr(rigidity, "DENSE", 100)
        assert k.rigidity().rank == len(k.edges)
        with pytest.raises(InputError, match="1 more than minimal rigidity"):
            redundant.rigidity()


def random_graph(rng):
    n = int(rng.integers(4, 60))
    m = int(rng.integers(n, 2 * n + 6))
    e = np.sort(rng.integers(n, size=(m, 2)), axis=1)
    return n, np.unique(e[e[:, 0] < e[:, 1]], axis=0)


def test_the_pebble_game_finds_ranks_of_random_positions():
    rng = np.random.default_rng(1)
    for _ in range(100):
        n, e = random_graph(rng)
        x = rng.standard_normal((n, 2))
        R = np.zeros((len(e), n, 2))
        rows = np.arange(len(e))
        R[rows, e[:, 0]] = x[e[:, 0]] - x[e[:, 1]]
        R[rows, e[:, 1]] = x[e[:, 1]] - x[e[:, 0]]
        rank, taken = counting.pebble_rank(n, e)
        assert rank == taken.sum() == DENSE(R.reshape(len(e), -1))
        assert DENSE(R[taken].reshape(rank, -1)) == rank


def test_the_pebble_game_agrees_with_pyrigi():
    pyrigi = pytest.importorskip("pyrigi")
    rng = np.random.default_rng(2)
    graphs = [random_graph(rng) for _ in range(100)]
    for level in (5, 10):
        k = il.cost.kagome(level, dim=2).perturbed().stiffened()
        graphs.append((len(k.positions), k.edges))
    for n, e in graphs:
        g = pyrigi.Graph.from_vertices_and_edges(list(range(n)), [tuple(p) for p in e.tolist()])
        rank, _ = counting.pebble_rank(n, e)
        assert g.is_rigid(dim=2) == (rank == 2 * n - 3)
        assert g.is_min_rigid(dim=2) == (rank == 2 * n - 3 == len(e))


@pytest.mark.parametrize("dim", [2, 3])
def test_resistances_sum_to_the_vertices_less_one(dim):
    k = il.cost.kagome(5, dim=dim).stiffened()
    w = np.random.default_rng(0).uniform(0.1, 10.0, len(k.edges))
    r = counting.resistance(k, conductance=w)
    assert (w * r).sum() == pytest.approx(len(k.positions) - 1, rel=1e-8)
    e = k.edges
    L = np.zeros((len(k.positions),) * 2)
    np.add.at(L, (e[:, 0], e[:, 1]), -w)
    L += L.T
    L -= np.diag(L.sum(axis=1))
    P = np.linalg.pinv(L)
    pairs = np.array([(0, 7), (3, 3), (9, 2)])
    naive = (
        P[pairs[:, 0], pairs[:, 0]] + P[pairs[:, 1], pairs[:, 1]] - 2 * P[pairs[:, 0], pairs[:, 1]]
    )
    np.testing.assert_allclose(counting.resistance(k, pairs, conductance=w), naive, atol=1e-10)


def test_motions_keep_lengths_and_can_be_followed():
    k = il.cost.kagome(3, dim=2)
    Z = rigidity.flexes(k)
    assert len(Z) == k.deficit == 6
    assert max(np.abs(rigidity.stretched(k, u)).max() for u in Z) < 1e-13
    flat = Z.reshape(len(Z), -1)
    np.testing.assert_allclose(flat @ flat.T, np.eye(6), atol=1e-12)
    assert np.abs(flat @ rigidity.rigid_motions(k)).max() < 1e-12
    frames = rigidity.swung(k, Z[0], 0.05, frames=4)
    np.testing.assert_allclose(frames[-1].lengths, k.lengths, rtol=1e-9)
    assert np.abs(frames[-1].positions - k.positions).max() > 0.02


# ------------------------------------------------------------------------------ stresses


def loads_on(k, rng, some=None):
    f = rng.standard_normal(k.positions.shape)
    if some is not None:
        f[some:] = 0.0
    return stress.balanced(k, f)


@pytest.mark.parametrize("dim", [2, 3])
def test_forces_balance_loads(dim):
    k = il.cost.kagome(10 if dim == 3 else 8, dim=dim).perturbed().stiffened()
    assert dim == 2 or len(k.positions) == 868
    f = loads_on(k, np.random.default_rng(0))
    found = k.stress(f)
    assert found.residual < 1e-10
    off = rigidity.gathered(k, found.density) - f
    assert np.linalg.norm(off) < 1e-10 * np.linalg.norm(f)
    np.testing.assert_allclose(found.bars, found.density * k.lengths)


def test_a_tripod_under_a_weight():
    """Three bars to the ground under a load: forces and displacement by hand; tension positive."""
    x = np.array([(1.0, 0, 0), (-0.5, np.sqrt(0.75), 0), (-0.5, -np.sqrt(0.75), 0), (0, 0, 2.0)])
    k = CornerSharing(x, [(0, 1, 2, 3)])
    f = np.zeros((4, 3))
    f[3, 2] = -6.0
    s = k.stress(f, supports=[0, 1, 2], stiffness=100.0)
    length = np.sqrt(5.0)
    leg = [i for i, e in enumerate(k.edges.tolist()) if 3 in e]
    np.testing.assert_allclose(s.bars[leg], -2.0 * length / 2.0)
    np.testing.assert_allclose(s.reactions[:3, 2], 2.0)
    down = 6.0 / (3 * 100.0 / length * (2.0 / length) ** 2)
    np.testing.assert_allclose(s.motion[3], (0.0, 0.0, -down), atol=1e-14)
    assert s.compliance == pytest.approx(6.0 * down)


def test_displacements_agree_with_a_dense_stiffness_matrix():
    k = il.cost.kagome(4).stiffened()
    k = k.with_bars([(0, len(k.positions) - 1)])
    rng = np.random.default_rng(4)
    EA = rng.uniform(1.0, 3.0, len(k.edges))
    held = np.array([0, 5, 11, 20])
    f = rng.standard_normal(k.positions.shape)
    s = k.stress(f, supports=held, stiffness=EA)
    R = naive_matrix(k)
    K = R.T @ np.diag(EA / k.lengths**3) @ R
    free = np.setdiff1d(np.arange(K.shape[0]), (3 * held[:, None] + np.arange(3)).ravel())
    u = np.zeros(K.shape[0])
    u[free] = np.linalg.solve(K[np.ix_(free, free)], f.ravel()[free])
    np.testing.assert_allclose(s.motion.ravel(), u, atol=1e-8 * np.abs(u).max())
    np.testing.assert_allclose(s.bars, EA / k.lengths**2 * (R @ u), atol=1e-7)


@pytest.mark.parametrize("size", [1e-9, 1e-3, 1e6])
@pytest.mark.parametrize("EA", [1e-9, 1e9, 1e14])
def test_units_do_not_matter(size, EA):
    k = il.cost.kagome(3).stiffened()
    rng = np.random.default_rng(2)
    f, part = rng.standard_normal(k.positions.shape), rng.uniform(0.5, 2.0, len(k.edges))
    held = [0, 5, 9, 20]
    first = k.stress(f, supports=held, stiffness=part)
    other = k.moved(size * k.positions).stress(f, supports=held, stiffness=EA * part)
    np.testing.assert_allclose(other.bars, first.bars, rtol=1e-9)
    np.testing.assert_allclose(other.motion, size / EA * first.motion, rtol=1e-9)
    assert other.residual < 1e-12


@pytest.mark.parametrize("dim", [2, 3])
def test_forces_by_levels_are_those_of_the_whole(dim):
    coarse = il.cost.kagome(5, dim=dim).perturbed().stiffened()
    low = coarse.positions[:, 0] < np.median(coarse.positions[:, 0])
    k = coarse.refined().refined(where=lambda x: x[:, 0] < np.median(coarse.positions[:, 0]))
    assert low.any()
    assert k.deficit == 0
    f = loads_on(k, np.random.default_rng(1))
    by_levels = k.stress(f)
    flat = il.cost.refinement.forgotten(k).stress(f)
    size = np.abs(flat.density).max()
    np.testing.assert_allclose(by_levels.density, flat.density, atol=1e-9 * size)
    assert by_levels.residual < 1e-10


def test_loads_and_structures_that_do_not_fit_are_refused():
    k = il.cost.kagome(5).stiffened()
    f = np.zeros_like(k.positions)
    f[0, 2] = 1.0
    with pytest.raises(InputError, match=r"their sum is \[0\.0, 0\.0, 1\.0\]"):
        k.stress(f)
    with pytest.raises(GeometryError, match="72 of the 378 edges that it needs are missing"):
        il.cost.kagome(5).stress(0 * f)
    more = k.with_bars([(0, len(k.positions) - 1)])
    with pytest.raises(InputError, match="1 edges more than balance determines"):
        more.stress(0 * f)
    assert more.stress(loads_on(k, np.random.default_rng(0)), stiffness=1.0).residual < 1e-9


def test_small_pivots_are_told_and_counted():
    """Nearly regular structures: the sparse way against a dense factorisation."""
    with pytest.warns(PrecisionWarning, match="short of rigidity"):
        k = il.cost.kagome(14, dim=2).stiffened("cycle").perturbed(1e-8, seed=3)
    with pytest.warns(PrecisionWarning, match="not clear"):
        k.rigidity()
    size = np.linalg.svd(naive_matrix(k), compute_uv=False)
    for tolerance in (1e-3, 1e-6, 1e-12):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PrecisionWarning)
            found = rigidity.analysed(k, tolerance=tolerance)
        assert found.rank == (size > tolerance * size[0]).sum()
    assert found.rank == 627
    assert 1e-11 < found.least < 1e-7
    for null_space in (rigidity.self_stresses, rigidity.flexes):
        with pytest.warns(PrecisionWarning, match="not clear"):
            null_space(k)


def test_one_call_tells_once_that_a_rank_is_not_clear(tmp_path, monkeypatch):
    """`stiffened` and the command told it once and again, beside that the rank is short."""
    k = il.cost.kagome(4, dim=2).perturbed(1e-8, seed=1)
    for options in ({"mode": "cycle"}, {"generic": True}):
        with pytest.warns(PrecisionWarning) as told:
            k.stiffened(**options)
        assert len(told) == 1
        assert "the rank at these positions is 56, 1 short" in str(told[0].message)
        assert "the rank 56 is not clear" in str(told[0].message)
        assert told[0].filename == __file__
    monkeypatch.setattr(rigidity, "UNSURE", 1e12)  # all ranks
    with pytest.warns(PrecisionWarning) as told:
        report = job.run(resolution=2, output=[tmp_path / "a.vtp"], stiffen=True)
    assert len(told) == 1
    assert "not clear" in str(told[0].message)
    assert report["rank"] > 0


def test_only_what_bends_swings():
    """A vertex on the bar across moves to first order only; random motions of rigid ones do not."""
    x = [[0, 0], [0, 1], [-1, 0.5], [2, 0], [2, 1], [3, 0.5], [1, 0.0]]
    k = CornerSharing(x, [[0, 1, 2], [3, 5, 4]], [[0, 3], [1, 4], [0, 4], [0, 6], [6, 3]])
    with pytest.raises(GeometryError, match="rigid body"):
        rigidity.swung(k, rigidity.flexes(k)[0], 0.2, frames=4)
    rigid = il.cost.kagome(3).stiffened()
    with pytest.raises(GeometryError, match="rigid body"):
        rigidity.swung(rigid, np.random.default_rng(0).normal(size=rigid.positions.shape), 0.1)
    turn = rigid.positions @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 0.0]])
    with pytest.raises(InputError, match="rigid body"):
        rigidity.swung(rigid, turn, 0.1)


def test_forces_by_many_levels_are_those_without():
    k = il.cost.kagome(6, dim=2).perturbed(0.1, seed=1).stiffened()
    centre = k.positions[k.simplices[18, 0]]
    for _ in range(30):
        v = int(np.argmin(np.linalg.norm(k.positions - centre, axis=1)))
        k = k.refined(where=(k.simplices == v).any(axis=1))
    f = stress.balanced(k, np.random.default_rng(0).normal(size=k.positions.shape))
    by_levels, whole = k.stress(f), refinement.forgotten(k).stress(f)
    assert by_levels.residual < 1e-11
    np.testing.assert_allclose(by_levels.bars, whole.bars, rtol=1e-8)


def test_masks_of_numbers_are_refused():
    k = il.cost.kagome(3).stiffened()
    low, f = k.positions[:, 2] < 0.3, np.ones_like(k.positions)
    for mask in (low.astype(int), low.astype(float)):
        with pytest.raises(InputError, match="supports has 28 numbers, each 0 or 1: a mask must"):
            k.stress(f, supports=mask, stiffness=1.0)


def test_sizes_beyond_numbers_are_refused():
    k = il.cost.kagome(3)
    for size in (1e160, 1e-160):
        with pytest.raises(InputError, match="change units"):
            k.moved(size * k.positions)
    with pytest.raises(InputError, match="corners must not be flat"):
        il.cost.kagome(3, corners=[(0, 0, 0), (1, 0.05, 0), (0.45, 0.9, 0), (0.4, 0.3, 0)])
    far = np.array([(0, 0, 0), (1, 0.05, 0), (0.45, 0.9, 0), (0.48, 0.32, 0.85)])
    for size in (1e80, 1e-80):
        assert il.cost.kagome(3, corners=size * far).rank == il.cost.kagome(3, corners=far).rank
