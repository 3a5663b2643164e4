"""Kernels of the multigrid against NumPy and SciPy, its levels against their algebra."""

import numba
import numpy as np
import pytest
from scipy.sparse import block_diag, bsr_array, csr_array
from scipy.sparse.csgraph import connected_components

from benchmarks.systems import cross, sheet, system
from ilattice.errors import ConvergenceError, InputError
from ilattice.linalg import _kernels_blocks as kb
from ilattice.linalg import _kernels_multigrid as km
from ilattice.linalg import _kernels_patches as kp
from ilattice.linalg.blocks import Blocks
from ilattice.linalg.multigrid import (
    Multigrid,
    _aggregates,
    _block_factors,
    _galerkin,
    _largest_eigenvalue,
    _patches,
    _prolongation,
    _scaled,
    _strengths,
)
from ilattice.linalg.solvers import rigid_modes
from ilattice.linalg.symmetric import Symmetric


def symmetric(m, rows, seed, dtype=float, density=0.2):
    """A random symmetric matrix, all of it and its half."""
    rng = np.random.default_rng(seed)
    there = np.triu(rng.random((rows, rows)) < density) | np.eye(rows, dtype=bool)
    there |= there.T
    D = rng.standard_normal((rows, m, rows, m)) * there[:, None, :, None]
    D = (D.reshape(rows * m, -1) + D.reshape(rows * m, -1).T).astype(dtype)
    return D, Symmetric.of(bsr_array(D, blocksize=(m, m)))


def dense(A):
    """A matrix of blocks, spelled out."""
    m, p = A.blocks.shape[1:]
    out = np.zeros((A.rows * m, A.width * p))
    for i in range(A.rows):
        for k in range(A.offsets[i], A.offsets[i + 1]):
            j = A.columns[k]
            out[m * i : m * (i + 1), p * j : p * (j + 1)] += A.blocks[k]
    return out


def random_blocks(m, p, rows, width, seed, dtype=float):
    rng = np.random.default_rng(seed)
    mask = rng.random((rows, width)) < 0.2
    mask[:, 0] |= ~mask.any(axis=1)
    mask[np.arange(min(rows, width)), np.arange(min(rows, width))] = True
    offsets = np.concatenate([[0], np.cumsum(mask.sum(axis=1))]).astype(np.int32)
    blocks = rng.standard_normal((offsets[-1], m, p)).astype(dtype)
    return Blocks(offsets, np.nonzero(mask)[1].astype(np.int32), blocks, width)


@pytest.fixture(scope="module")
def struts():
    return system(cross, (24, 8, 8), fixed="x0")


@pytest.fixture(scope="module")
def hierarchy(struts):
    return Multigrid(Symmetric.of(struts.K), struts.modes)


SIZES = [(1, 1), (3, 3), (3, 6), (6, 6), (2, 2), (3, 4)]


@pytest.mark.parametrize("size", SIZES)
def test_products_with_vectors(size):
    for dtype, tolerance in ((np.float64, 1e-13), (np.float32, 1e-5)):
        A = random_blocks(*size, 70, 50, 3, dtype)
        rng = np.random.default_rng(4)
        x, y = (rng.standard_normal(n).astype(dtype) for n in A.shape[::-1])
        D = dense(A)
        for sign, expected in ((0, D @ x), (1, y + D @ x), (-1, y - D @ x)):
            z = y.copy()
            A.multiply(x, z, sign)
            np.testing.assert_allclose(z, expected, atol=tolerance * 20)
        z = np.empty_like(x)
        A.multiply_transposed(y, z)
        np.testing.assert_allclose(z, D.T @ y, atol=tolerance * 20)


@pytest.mark.parametrize("size", [(1, 1), (3, 3), (3, 6), (6, 6), (5, 7)])
@pytest.mark.parametrize("count", [2, 6, 8, 9, 19])
def test_products_with_several_vectors(size, count):
    """Bits do not depend on how many vectors go together, nor on where they are."""
    for dtype, tolerance in ((np.float64, 1e-13), (np.float32, 1e-5)):
        A = random_blocks(*size, 70, 50, 3, dtype)
        rng = np.random.default_rng(4)
        x, y = (rng.standard_normal((count, n)).astype(dtype) for n in A.shape[::-1])
        D = dense(A)
        for sign, expected in ((0, x @ D.T), (1, y + x @ D.T), (-1, y - x @ D.T)):
            z = y.copy()
            A.multiply(x, z, sign)
            np.testing.assert_allclose(z, expected, atol=tolerance * 20)
        A.multiply(x[::-1], z[::-1], 0)
        again = np.empty_like(z)
        A.multiply(x, again, 0)
        np.testing.assert_array_equal(z[:2], again[:2])
        z = np.empty_like(x)
        A.multiply_transposed(y, z)
        np.testing.assert_allclose(z, y @ D, atol=tolerance * 20)


@pytest.mark.parametrize("m", [1, 2, 3, 6])
@pytest.mark.parametrize("count", [1, 2, 8, 11])
def test_products_of_halves_with_vectors(m, count):
    """Those of the whole matrix, with the same bits in other company and at other places."""
    for dtype, tolerance in ((np.float64, 1e-12), (np.float32, 1e-4)):
        D, A = symmetric(m, 90, 3, dtype)
        rng = np.random.default_rng(4)
        x, y = rng.standard_normal((2, count, len(D))).astype(dtype)
        for sign, expected in ((0, x @ D), (1, y + x @ D), (-1, y - x @ D)):
            z = y.copy()
            A.multiply(x, z, sign)
            np.testing.assert_allclose(z, expected, atol=tolerance)
        A.multiply(x[::-1], z[::-1], 0)
        again = np.empty_like(z)
        A.multiply(x, again, 0)
        np.testing.assert_array_equal(z, again)


def parts_of(A):
    return [int(b - a) for a, b in zip(A._parts[0][:-1], A._parts[0][1:], strict=True)]


@pytest.mark.threads
@pytest.mark.parametrize("heat", [False, True])
def test_products_in_parts(heat):
    """Banded matrices are cut into parts that overlap, and have the same bits on any threads."""
    s = system(sheet(0.5), (48, 16, 16), fixed="x0", heat=heat)
    A = Symmetric.of(s.K)
    assert len(parts_of(A)) > 4, parts_of(A)
    assert min(parts_of(A)) > 50
    x = np.random.default_rng(1).standard_normal((3, len(s.f)))
    found = {}
    for threads in (1, 2):
        before = numba.get_num_threads()
        numba.set_num_threads(threads)
        try:
            for rows in (1, 3):
                y = np.empty_like(x[:rows])
                A.multiply(x[:rows], y, 0)
                found[threads, rows] = y
        finally:
            numba.set_num_threads(before)
    for rows in (1, 3):
        np.testing.assert_allclose(found[1, rows], (s.K @ x[:rows].T).T, atol=1e-13)
        np.testing.assert_array_equal(found[1, rows], found[2, rows])


def test_parts_do_not_take_more_room_than_the_matrix():
    """Where the last rows meet the first, and where anything meets anything."""
    rng = np.random.default_rng(2)
    n = 20_000
    i = np.arange(n)
    ring = csr_array(
        (np.ones(3 * n), (np.tile(i, 3), np.concatenate([i, (i + 1) % n, (i - 1) % n])))
    )
    far = csr_array((np.ones(4 * n), (np.tile(i, 4), rng.integers(0, n, 4 * n))), shape=(n, n))
    for K in (ring, far + far.T + 20.0 * ring):
        K.sum_duplicates()
        A = Symmetric.of(bsr_array(K, blocksize=(1, 1)))
        x = rng.standard_normal(n)
        y = np.empty(n)
        A.multiply(x, y, 0)
        np.testing.assert_allclose(y, K @ x, atol=1e-11)
        assert A._parts[1][-1] <= 2 * n, A._parts[1][-1]
    assert len(parts_of(A)) <= 2  # of the last one


@pytest.mark.parametrize("m", [1, 3])
def test_halves_make_the_whole_again(m):
    D, A = symmetric(m, 70, 5)
    whole = A.whole()
    np.testing.assert_array_equal(whole.toarray(), D)
    assert whole.has_sorted_indices
    assert (A.couplings, A.nnz) == (len(whole.indices), whole.nnz)
    np.testing.assert_array_equal(A.diagonal(), np.diag(D))
    offsets, columns, which = A.graph()
    np.testing.assert_array_equal(A.taken(which[: offsets[3]]), whole.data[: offsets[3]])
    np.testing.assert_array_equal(columns, whole.indices)


@pytest.mark.parametrize("size", SIZES)
def test_products_of_matrices(size):
    m, p = size
    D, A = symmetric(m, 50, 5)
    B = random_blocks(m, p, 50, 30, 6)
    C = A.times(B, A.graph())
    np.testing.assert_allclose(dense(C), D @ dense(B), atol=1e-11)
    for i in range(C.rows):  # every column once
        row = C.columns[C.offsets[i] : C.offsets[i + 1]]
        assert len(set(row)) == len(row)


def test_sums_and_updates():
    rng = np.random.default_rng(7)
    x, y, z = rng.standard_normal((3, 10_000))
    np.testing.assert_allclose(kb.dots(x, y, z).sum(axis=0), [x @ y, x @ z], atol=1e-10)
    w = y.copy()
    kb.combine(len(x), 2.0, x, -3.0, w)
    np.testing.assert_allclose(w, 2 * x - 3 * y, atol=1e-14)
    v, w = z.copy(), x.copy()
    kb.smooth(len(v), 0.5, v, 2.0, y, 1.0, w)
    np.testing.assert_allclose(v, 0.5 * z + 2 * y, atol=1e-14)
    np.testing.assert_allclose(w, x + v, atol=1e-14)


def test_scaled_matrices_have_unit_diagonal_blocks(struts):
    K = Symmetric.of(struts.K)
    factors, inverses = _block_factors(K)
    np.testing.assert_allclose(
        factors @ inverses, np.broadcast_to(np.eye(3), factors.shape), atol=1e-12
    )
    out = _scaled(K, inverses, np.float64).blocks
    rows = np.repeat(np.arange(K.rows), np.diff(K.offsets))
    diagonal = out[rows == K.columns]
    np.testing.assert_allclose(diagonal, np.broadcast_to(np.eye(3), diagonal.shape), atol=1e-12)
    k = 100
    expected = inverses[rows[k]] @ K.blocks[k] @ inverses[K.columns[k]].T
    np.testing.assert_allclose(out[k], expected, atol=1e-12)


def test_blocks_without_a_pivot_are_scaled_by_their_diagonal():
    block = np.array([[2.0, 2.0, 0.0], [2.0, 2.0, 0.0], [0.0, 0.0, 3.0]])
    A = Symmetric(np.array([0, 1], np.int32), np.array([0], np.int32), block[None])
    factors, _ = _block_factors(A)
    np.testing.assert_allclose(factors[0], np.diag(np.sqrt([2.0, 2.0, 3.0])))
    block[2, 2] = 0
    with pytest.raises(InputError, match="node 0"):
        _block_factors(A)


@pytest.mark.parametrize("least", [0.0, 0.02, 0.1, 1.0])
def test_aggregates_are_disjoint_connected_and_complete(least, struts):
    K = Symmetric.of(struts.K)
    graph = K.graph()
    strength = _strengths(Symmetric(K.offsets, K.columns, K.blocks.astype(np.float32)))
    strength = strength[graph.blocks]
    rows = np.repeat(np.arange(K.rows), np.diff(graph.offsets))
    expected = (K.taken(graph.which) ** 2).sum(axis=(1, 2)) * (rows != graph.columns)
    np.testing.assert_allclose(strength, expected, rtol=1e-5)
    strong = strength > least * strength.max()
    home = np.empty(K.rows, np.int32)
    count = km.aggregate(graph.offsets, graph.columns, strength, strong, home)
    assert set(home[home >= 0]) == set(range(count))
    assert ((home >= 0) == strong.any()).all()  # it all hangs together
    inside = (strength > 0) & (home[rows] == home[graph.columns]) & (home[rows] >= 0)
    edges = np.ones(inside.sum()), (rows[inside], graph.columns[inside])
    together = csr_array(edges, shape=(K.rows, K.rows))
    assert connected_components(together, directed=False)[0] == count + (home < 0).sum()
    if least < 0.1:
        assert K.rows / count > 5


@pytest.mark.parametrize("most", [2, 3, 16])
def test_patches_hold_the_closest_ties(most):
    """As Kruskal's algorithm has it: every set below `most` that one tie makes is made."""
    rng = np.random.default_rng(11)
    ends = rng.integers(0, 60, (70, 2)).astype(np.int32)
    first = np.empty(60, np.int32)
    kp.join(ends[:, 0], ends[:, 1], most, first)
    sets = [{i} for i in range(60)]
    for i, j in ends:
        if sets[i] is not sets[j] and len(sets[i]) + len(sets[j]) <= most:
            both = sets[i] | sets[j]
            for k in both:
                sets[k] = both
    assert first.tolist() == [min(s) for s in sets]
    assert max(len(s) for s in sets) <= most
    apart = [(i, j) for i, j in ends if sets[i] is not sets[j]]
    assert apart  # what ties still join would be too large
    assert all(len(sets[i]) + len(sets[j]) > most for i, j in apart)


@pytest.mark.parametrize("m", [1, 3, 6])
def test_patches_are_solved_exactly_and_bound_the_eigenvalues(m):
    """Nodes in twos and threes that share nearly all their stiffness, among others that do not."""
    rng = np.random.default_rng(12)
    A = np.eye(40 * m)
    tied = [(0, 7), (3, 20, 31), (5, 6)]
    for nodes in tied:
        rows = (m * np.array(nodes)[:, None] + np.arange(m)).ravel()
        for a, b in ((0, 1), (1, 2))[: len(nodes) - 1]:
            part = np.linalg.qr(rng.standard_normal((m, m)))[0] * (0.7 if len(nodes) > 2 else 0.999)
            A[np.ix_(rows[a * m : a * m + m], rows[b * m : b * m + m])] = part
            A[np.ix_(rows[b * m : b * m + m], rows[a * m : a * m + m])] = part.T
    A[m * 30, m * 31] = A[m * 31, m * 30] = 1e-3
    K = Symmetric.of(bsr_array(A.astype(np.float32), blocksize=(m, m)))
    patches = _patches(K, _strengths(K))
    found = [
        tuple(patches.members[a:b])
        for a, b in zip(patches.starts[:-1], patches.starts[1:], strict=True)
    ]
    assert found == tied
    r = rng.standard_normal(40 * m)
    s = patches.solve(r[None], m)[0]
    whole = np.eye(40 * m)
    for nodes in tied:
        rows = (m * np.array(nodes)[:, None] + np.arange(m)).ravel()
        whole[np.ix_(rows, rows)] = A[np.ix_(rows, rows)]
    np.testing.assert_allclose(s, np.linalg.solve(whole, r), rtol=1e-3, atol=1e-3)
    exact = np.linalg.eigvals(np.linalg.solve(whole, A)).real.max()
    assert _largest_eigenvalue(K, patches) == pytest.approx(exact, rel=1e-3)
    assert np.linalg.eigvalsh(A).max() > 1.5 * exact


def test_couplings_are_strong_for_both_nodes_and_near():
    A = random_blocks(1, 1, 40, 40, 9)
    S = dense(A) + dense(A).T
    A = csr_array(S)
    rng = np.random.default_rng(10)
    places = rng.random((40, 3))
    S = np.where(np.eye(40), 0, S * S).astype(np.float32)
    top = S.max(axis=1)
    expected = (S > 0.2) & (0.5 * np.maximum(top[:, None], top) < S)
    rows, columns = np.repeat(np.arange(40), np.diff(A.indptr)), A.indices
    strong = np.empty(A.nnz, np.bool_)
    most = np.empty(40, np.float32)
    km.greatest(40, A.indptr, S[rows, columns], most)
    np.testing.assert_array_equal(most, top)
    km.mark_strong(40, A.indptr, columns, S[rows, columns], most, 0.2, 0.5, strong)
    np.testing.assert_array_equal(strong, expected[rows, columns])
    assert 40 < strong.sum() < 0.5 * A.nnz
    far = ((places[:, None] - places) ** 2).sum(axis=2)
    near = np.where(expected, far, np.inf).min(axis=1)
    expected &= far <= 1.5 * np.maximum(near[:, None], near)
    before = strong.sum()
    least = np.empty(40)
    km.nearest(40, A.indptr, columns, places, strong, least)
    np.testing.assert_array_equal(least, near)
    km.unmark_far(40, A.indptr, columns, places, least, 1.5, strong)
    np.testing.assert_array_equal(strong, expected[rows, columns])
    assert 0 < strong.sum() < before


def test_nodes_that_stand_alone_need_no_levels():
    K = bsr_array(block_diag([np.diag([1.0, 2.0, 3.0])] * 500, format="bsr"))
    mesh = Multigrid(Symmetric.of(K), np.tile(np.eye(3), (500, 1)))
    r = np.arange(1500.0)
    np.testing.assert_allclose(mesh(r), K.diagonal() ** -1 * r, rtol=1e-2)


def test_nodes_without_couplings_are_in_no_aggregate():
    A = Blocks(np.arange(4, dtype=np.int32), np.arange(3, dtype=np.int32), np.ones((3, 1, 1)), 3)
    home = np.empty(3, np.int32)
    none = np.zeros(3, np.bool_)
    assert km.aggregate(A.offsets, A.columns, np.zeros(3, np.float32), none, home) == 0
    assert (home == -1).all()


def test_tentative_modes_are_orthonormal_and_give_the_modes_back():
    rng = np.random.default_rng(8)
    places = rng.random((40, 3))
    modes = rigid_modes(places)
    home = np.repeat(np.arange(5), 8)
    home[:3] = 0, 0, 1
    starts = np.concatenate([[0], np.cumsum(np.bincount(home))]).astype(np.int32)
    members = np.argsort(home, kind="stable")
    for used in (modes, np.hstack([modes[:, :5], modes[:, :1]])):  # the second: a mode twice
        blocks, coarse = np.empty((40, 3, 6)), np.empty((30, 6))
        km.tentative(5, starts, members, used, (0,) * 3, blocks, coarse)
        for J in range(5):
            rows = np.flatnonzero(home == J)
            Q = blocks[rows].reshape(-1, 6)
            R = coarse[6 * J : 6 * J + 6]
            np.testing.assert_allclose(
                Q @ R, used.reshape(40, 3, 6)[rows].reshape(-1, 6), atol=1e-12
            )
            gram = Q.T @ Q
            np.testing.assert_allclose(gram, np.diag(np.diag(gram)), atol=1e-12)
            np.testing.assert_allclose(np.diag(gram), np.round(np.diag(gram)), atol=1e-12)
    assert gram[5, 5] == 0


@pytest.mark.parametrize("batch", [1, 700, 5000])
def test_galerkin_products_in_batches_have_the_same_bits(struts, hierarchy, batch, monkeypatch):
    K = Symmetric.of(struts.K)
    _, inverses = _block_factors(K)
    whole = _galerkin(K, K.graph(), inverses, hierarchy.levels[0].P)
    monkeypatch.setattr("ilattice.linalg.multigrid.BATCH", batch)
    parts = _galerkin(K, K.graph(), inverses, hierarchy.levels[0].P)
    assert len(whole.columns) > 100
    for name in ("offsets", "columns", "blocks"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))


def test_galerkin_products(struts, hierarchy):
    """The coarse matrix is Tᵀ K T, symmetric to the last bit, with ascending columns.

    T is Gᵀ P, rounded to the precision of P.
    """
    K = Symmetric.of(struts.K)
    _, inverses = _block_factors(K)
    level = hierarchy.levels[0]
    coarse = _galerkin(K, K.graph(), inverses, level.P)
    D = coarse.whole().toarray()
    rows = np.arange(K.rows)
    G = dense(Blocks(np.arange(K.rows + 1), rows, inverses, K.rows))
    P = dense(level.P).astype(float)
    T = (G.T @ P).astype(np.float32).astype(float)
    expected = T.T @ K.whole() @ T
    np.testing.assert_allclose(D, expected, atol=1e-12)
    np.testing.assert_allclose(D, P.T @ G @ K.whole() @ G.T @ P, atol=1e-6)
    assert (D == D.T).all()
    for i in range(coarse.rows):
        assert (np.diff(coarse.columns[coarse.offsets[i] : coarse.offsets[i + 1]]) > 0).all()


def test_the_next_level_carries_the_modes():
    """What a body without support does for free stays free: P coarse = modes."""
    s = system(sheet(0.5), (12, 12, 12), fixed="")
    K = Symmetric.of(s.K)
    with pytest.raises(ConvergenceError, match="singular"):
        Multigrid(K, s.modes)
    factors, inverses = _block_factors(K)
    scaled = _scaled(K, inverses, np.float32)
    modes = np.einsum("iba,ibq->iaq", factors, s.modes.reshape(-1, 3, 6)).reshape(-1, 6)
    graph = K.graph()
    strength = _strengths(scaled)[graph.blocks]
    found = _aggregates(graph, strength, None, 3 * 0.02**2)
    P, coarse = _prolongation(scaled, graph, modes, 3.0, *found)
    np.testing.assert_allclose(dense(P) @ coarse, modes, atol=1e-5 * np.abs(modes).max())
    assert P.width < K.rows / 10
