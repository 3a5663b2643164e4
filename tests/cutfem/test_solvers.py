"""Solvers: agreement, residuals, refusal of what cannot be solved."""

import gc
import os
import subprocess
import sys
import tracemalloc
import warnings

import numba
import numpy as np
import pytest
from scipy.sparse import bsr_array, csr_array, diags_array, eye_array, kron
from scipy.sparse.linalg import splu, spsolve

import ilattice as il
from benchmarks.systems import cross, modes, sheet, solid, system
from ilattice.cutfem import Elasticity
from ilattice.errors import ConvergenceError, InputError
from ilattice.linalg import _engines, solvers
from ilattice.linalg._engines import factor_size
from ilattice.linalg.solvers import Solver, rigid_modes

METHODS = ("multigrid", "superlu", "pyamg", "pardiso")
PACKAGES = {"pyamg": "pyamg", "pardiso": "pypardiso"}


@pytest.fixture(scope="module")
def struts():
    return system(cross, (16, 8, 8), fixed="z0")


@pytest.fixture(scope="module")
def warm():
    return system(sheet(0.5), (16, 16, 16), fixed="x0", heat=True)


def _available(method):
    if method in PACKAGES:
        pytest.importorskip(PACKAGES[method])
    return method


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["struts", "warm"])
def test_every_method_gives_the_solution(method, name, request):
    s = request.getfixturevalue(name)
    solver = Solver(s.K, near_nullspace=s.modes, method=_available(method))
    x, report = solver.solve(s.f, tol=1e-11)
    exact = spsolve(s.K.tocsc(), s.f)
    assert np.abs(x - exact).max() < 1e-8 * np.abs(exact).max()
    residual = np.linalg.norm(s.f - s.K @ x) / np.linalg.norm(s.f)
    assert residual <= 1e-11
    assert report.residual == pytest.approx(residual, rel=1e-3)
    assert report.method == solver.method == method
    assert report.size == len(s.f)
    assert len(report.history) == report.iterations + 1
    assert report.history[0] == 1
    assert report.megabytes > 0
    if method in ("superlu", "pardiso"):
        assert report.iterations <= 2


@pytest.mark.parametrize("name", ["struts", "warm"])
def test_the_preconditioner_is_symmetric_and_positive(name, request):
    s = request.getfixturevalue(name)
    M = Solver(s.K, near_nullspace=s.modes, method="multigrid").precondition
    x, y = np.random.default_rng(0).standard_normal((2, len(s.f)))
    Mx, My = M(x), M(y)
    assert x @ My == pytest.approx(y @ Mx, rel=1e-5)
    assert x @ Mx > 0
    assert y @ My > 0


@pytest.mark.parametrize("name", ["struts", "warm"])
def test_the_cycle_contracts(name, request):
    """The largest eigenvalue of M K is one, as for every V-cycle whose smoother converges."""
    s = request.getfixturevalue(name)
    solver = Solver(s.K, near_nullspace=s.modes, method="multigrid")
    x = np.random.default_rng(0).standard_normal(len(s.f))
    for _ in range(60):  # power iteration, in the norm in which M K is symmetric
        x = solver.precondition(s.K @ x)
        largest = np.sqrt(x @ (s.K @ x))
        x /= largest
    assert 0.9 < largest < 1 + 1e-3


@pytest.mark.threads
def test_bits_do_not_depend_on_the_number_of_threads(struts):
    before = numba.get_num_threads()
    results = []
    try:
        for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
            numba.set_num_threads(threads)
            solver = Solver(struts.K, near_nullspace=struts.modes, method="multigrid")
            results.append((*solver.solve(struts.f), solver.solve(_loads(struts.f, 5))[0]))
    finally:
        numba.set_num_threads(before)
    (x, a, several), (y, b, again) = results
    assert (x == y).all()
    assert (several == again).all()
    assert (a.history == b.history).all()


def _loads(f, count):
    """The load, and others that are smoother or less."""
    others = np.random.default_rng(5).standard_normal((len(f), count - 1))
    return np.column_stack([f, others * np.abs(f).max()])


@pytest.mark.parametrize("name", ["struts", "warm"])
@pytest.mark.parametrize("method", ["multigrid", "superlu"])
def test_loads_together_stop_one_by_one(method, name, request):
    """Sixteen are more than go together; each takes the steps it takes alone."""
    s = request.getfixturevalue(name)
    solver = Solver(s.K, near_nullspace=s.modes, method=method)
    loads = _loads(s.f, 16)
    loads[:, 3] = 0.0
    x, report = solver.solve(loads, tol=1e-8)
    gaps = np.linalg.norm(loads - s.K @ x, axis=0)
    assert (gaps <= 1e-8 * np.linalg.norm(loads, axis=0)).all()
    assert not x[:, 3].any()
    steps = []
    for i in (0, 1, 15):
        alone, single = solver.solve(loads[:, i], tol=1e-8)
        np.testing.assert_allclose(x[:, i], alone, atol=1e-8 * np.abs(alone).max())
        steps.append(single.iterations)
    assert report.iterations >= max(steps)
    assert abs(report.iterations - max(steps)) <= 1


def test_products_and_preconditioners_of_several_vectors(struts):
    solver = Solver(struts.K, near_nullspace=struts.modes, method="multigrid")
    x = _loads(struts.f, 4)
    for of in (solver.multiply, solver.precondition):
        together = of(x)
        for i in range(4):
            alone = of(x[:, i])
            np.testing.assert_allclose(together[:, i], alone, atol=1e-5 * np.abs(alone).max())
    exact = struts.K @ x
    np.testing.assert_allclose(solver.multiply(x), exact, atol=1e-12 * np.abs(exact).max())


def test_several_loads_share_the_hierarchy(struts):
    loads = np.stack([struts.f, 0 * struts.f, np.roll(struts.f, 1)], axis=1)
    solver = Solver(struts.K, near_nullspace=struts.modes, method="multigrid")
    x, report = solver.solve(loads)
    assert x.shape == loads.shape
    for i in (0, 2):
        gap = np.linalg.norm(loads[:, i] - struts.K @ x[:, i])
        assert gap <= 1e-8 * np.linalg.norm(loads[:, i])
    assert (x[:, 1] == 0).all()
    alone = solver.solve(struts.f)[0]
    np.testing.assert_allclose(x[:, 0], alone, rtol=0, atol=1e-6 * np.abs(alone).max())
    turned, _ = solver.solve(loads[:, ::-1])
    np.testing.assert_array_equal(turned[:, ::-1], x)
    assert report.iterations >= 5


@pytest.mark.parametrize("fixed", ["z0", "x0"])
def test_slivers_cost_few_iterations(fixed):
    counts = []
    for slivers in (0.0, 0.1):
        s = system(cross, (64, 16, 16), fixed=fixed, slivers=slivers)
        solver = Solver(s.K, near_nullspace=s.modes, method="multigrid")
        counts.append(solver.solve(s.f)[1].iterations)
    assert counts[1] <= 1.3 * counts[0]
    assert counts[0] > 5


def test_stretched_cells_cost_few_iterations():
    """Aggregates follow the short sides of cells, where the places of nodes are known."""
    iterations = []
    for length in (1.0, 8.0):
        box = [[0, 0, 0], [1, 1, length]]
        problem = il.cutfem.Elasticity(lambda u: u[:, 0] - 2, (12, 12, 12), domain=box, degree=1)
        s = problem.clamp("w=0").clamp("w=1").load(body=(1, 0.3, 0)).system
        for places in (s.coordinates, None):
            solver = Solver(
                s.K, near_nullspace=s.near_nullspace, coordinates=places, method="multigrid"
            )
            iterations.append(solver.solve(s.b)[1].iterations)
    cubes, _, stretched, blind = iterations
    assert stretched <= 2 * cubes
    assert stretched <= 0.5 * blind


@pytest.mark.parametrize(
    ("inside", "tiles", "fixed"), [(cross, 4, "z0"), (cross, 4, "x0"), (sheet(0.5), 1, "z0")]
)
def test_iterations_do_not_grow_with_refinement(inside, tiles, fixed):
    """The sheet has cells with a single sample, which hold hardly against their inner motions."""
    counts = []
    for n in (8, 12, 16, 18):
        s = system(inside, (tiles * n, n, n), per_tile=n, fixed=fixed)
        solver = Solver(s.K, near_nullspace=s.modes, method="multigrid")
        counts.append(solver.solve(s.f)[1].iterations)
    assert max(counts) <= 1.5 * counts[0]
    assert counts[0] < 40


@pytest.mark.parametrize("method", METHODS[:2])
def test_rows_of_fixed_components_stay_out_of_it(method, struts):
    """Components that are fixed one by one: unit rows, zero modes, zero loads."""
    K, f, B = struts.K.toarray(), struts.f.copy(), struts.modes.copy()
    held = np.arange(0, len(f), 7)
    K[held] = 0
    K[:, held] = 0
    K[held, held] = 1
    f[held] = 0
    B[held] = 0
    x, report = Solver(bsr_array(K, blocksize=(3, 3)), near_nullspace=B, method=method).solve(f)
    assert np.abs(x[held]).max() <= 1e-12 * np.abs(x).max()
    assert report.iterations < 60
    np.testing.assert_allclose(x, np.linalg.solve(K, f), atol=1e-6 * np.abs(x).max())


def test_the_unit_of_stiffness_does_not_matter(struts):
    x, a = Solver(struts.K, near_nullspace=struts.modes, method="multigrid").solve(struts.f)
    stiff = bsr_array((2.0**40 * struts.K.data, struts.K.indices, struts.K.indptr))
    y, b = Solver(stiff, near_nullspace=struts.modes, method="multigrid").solve(struts.f)
    assert a.iterations == b.iterations
    np.testing.assert_allclose(y * 2.0**40, x, rtol=1e-6, atol=1e-6 * np.abs(x).max())


def test_rigid_modes_move_no_strain():
    """Every row of an unsupported stiffness matrix annihilates them."""
    free = system(cross, (8, 8, 8), fixed="")
    B = rigid_modes(free.coordinates)
    assert np.abs(free.K @ B).max() < 1e-13
    assert np.linalg.matrix_rank(np.hstack([B, modes(free.coordinates)])) == 6


@pytest.mark.parametrize("method", METHODS)
def test_bodies_without_support_are_refused(method):
    s = system(solid, (12, 8, 8), per_tile=4, fixed="")
    with pytest.raises(ConvergenceError, match=r"singular|positive definite"):
        Solver(s.K, near_nullspace=s.modes, method=_available(method)).solve(s.f)


@pytest.mark.parametrize("method", METHODS)
def test_a_block_that_hangs_by_an_edge_is_refused(method):
    """Two blocks that share an edge, the lower one fixed: the upper one swings."""

    def blocks(u):
        return (u[:, 2] < 0.5) == (u[:, 0] < 0.5)

    s = system(blocks, (12, 6, 12), per_tile=12, fixed="z0", hanging=True)
    with pytest.raises(ConvergenceError, match=r"singular|positive definite|more iterations"):
        Solver(
            s.K, near_nullspace=s.modes, coordinates=s.coordinates, method=_available(method)
        ).solve(s.f, max_iterations=150)


@pytest.mark.parametrize(
    ("box", "cells", "degree", "chosen"),
    [
        ((1, 1, 1), (12, 12, 12), 2, "multigrid"),
        ((20, 1, 1), (60, 4, 4), 2, "multigrid"),
        ((100, 100, 0.5), (25, 25, 2), 2, "superlu"),  # flat cells
        ((1, 1, 1), (10, 10, 10), 3, "superlu"),  # couple far
        ((1, 1, 1), (6, 6, 6), 1, "superlu"),  # few
    ],
)
def test_the_faster_engine_is_chosen(box, cells, degree, chosen, monkeypatch):
    monkeypatch.setattr(_engines, "find_spec", lambda _: None)  # without PARDISO
    full = lambda u: -np.ones(len(u))  # noqa: E731
    problem = Elasticity(full, cells, domain=[[0, 0, 0], box], degree=degree).clamp("u=0")
    S = problem.load(body=(0, 0, 1.0)).system
    assert _engines.choose(S._half, S.coordinates) == chosen


def test_automatic_choice():
    small = system(cross, (8, 8, 8), fixed="z0")
    assert Solver(small.K).method in ("superlu", "pardiso")
    large = system(solid, (24, 24, 24), per_tile=8, fixed="z0")
    assert Solver(large.K, near_nullspace=large.modes).method == "multigrid"


def test_a_factor_takes_over_where_multigrid_does_not_converge(struts, monkeypatch):
    K, b = struts.K, struts.f
    monkeypatch.setitem(_engines.ENGINES, "multigrid", lambda *_: (lambda r: r.copy(), 0))
    monkeypatch.setattr(solvers, "choose", lambda *_: "multigrid")
    solver = Solver(K, coordinates=struts.coordinates)
    x, report = solver.solve(b, max_iterations=solvers.MANY)
    assert report.method == solver.method == "superlu"
    assert np.linalg.norm(b - K @ x) <= 1e-8 * np.linalg.norm(b)
    for method, steps in (("multigrid", 200), ("auto", solvers.MANY - 1)):
        with pytest.raises(ConvergenceError, match="multigrid stopped"):
            Solver(K, method=method).solve(b, max_iterations=steps)


@pytest.mark.parametrize("seed", range(6))
def test_slender_bodies_are_solved_as_far_as_rounding_lets(seed):
    rng = np.random.default_rng(seed)
    n, tol = int(rng.integers(95, 110)), 2e-9
    ones = np.ones(n)
    D = csr_array(diags_array([ones, -2 * ones, ones], offsets=[0, -1, -2], shape=(n, n)))
    w = 2.0 ** rng.integers(0, 3, n)  # bending stiffness of a cantilever; entries of K are exact
    K = csr_array(D.T @ diags_array(w) @ D)
    f = np.abs(rng.standard_normal(n))
    moment = np.cumsum(np.cumsum(f[::-1].astype(np.longdouble)))[::-1]
    exact = np.cumsum(np.cumsum(moment / w))
    rounded = np.linalg.norm(f - K @ exact.astype(float))
    assert rounded > tol * np.linalg.norm(f)  # no solution in double precision is better
    solver = Solver(K)
    x, report = solver.solve(f, tol=tol)
    left = np.linalg.norm(f - solver.multiply(x)) / np.linalg.norm(f)
    assert report.rounded
    assert report.residual == pytest.approx(left, rel=1e-6)
    assert left > tol
    off = (D @ (x - exact)).astype(float)
    assert off @ (w * off) <= (1e-12) ** 2 * float(exact @ f)  # residuals have more digits than K
    with pytest.raises(ConvergenceError, match="rounding leaves no more digits"):
        Solver(K).solve(f, tol=1e-12)


def test_too_few_iterations_are_an_error_with_a_place(struts):
    solver = Solver(
        struts.K, near_nullspace=struts.modes, method="multigrid", coordinates=struts.coordinates
    )
    with pytest.raises(ConvergenceError, match=r"after 2 iterations.*1\.0e-08.*node \d+ at \["):
        solver.solve(struts.f, max_iterations=2)


def test_progress_counts_to_hundred(struts):
    seen = []
    solver = Solver(struts.K, near_nullspace=struts.modes, method="multigrid")
    solver.solve(struts.f, progress=lambda *a: seen.append(a))
    assert seen[-1][0] == "solve"
    assert [s[1] for s in seen] == list(range(1, 101))


def test_missing_packages_are_named(struts, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "pyamg", None)
    with pytest.raises(InputError, match=r"ilattice\[fem\]"):
        Solver(struts.K, method="pyamg")


def test_bad_input(struts):
    K, n = struts.K, len(struts.f)
    for wrong, match in (
        (K.toarray(), "sparse"),
        (csr_array((3, 4)), "square"),
        (bsr_array(np.ones((6, 6)), blocksize=(2, 3)), "square blocks"),
        (csr_array(np.array([[2.0, 1.0], [0.0, 2.0]])), "symmetric"),
        (csr_array(np.array([[2.0, np.nan], [np.nan, 2.0]])), "finite"),
        (csr_array(np.array([[2.0, 1.0], [1.0, -2.0]])), "positive diagonal"),
    ):
        with pytest.raises(InputError, match=match):
            Solver(wrong)
    for options, match in (
        ({"method": "guess"}, "multigrid"),
        ({"near_nullspace": np.ones((n - 1, 6))}, "near_nullspace"),
        ({"coordinates": np.ones((n, 3))}, "coordinates"),
    ):
        with pytest.raises(InputError, match=match):
            Solver(K, **options)
    solver = Solver(eye_array(4, format="csr"))
    for arguments, options, match in (
        ((np.ones(5),), {}, r"\(4,\)"),
        ((np.full(4, np.inf),), {}, "finite"),
        ((np.ones(4),), {"tol": 0.0}, "tol"),
        ((np.ones(4),), {"max_iterations": 0}, "max_iterations"),
    ):
        with pytest.raises(InputError, match=match):
            solver.solve(*arguments, **options)


@pytest.mark.parametrize(("p", "r", "cells"), [(1, 0, 9), (2, 1, 8), (2, 0, 4), (3, 2, 7)])
def test_the_size_of_a_factor_is_predicted_for_all_functions(p, r, cells):
    ball = Elasticity(lambda u: (u**2).sum(axis=1) - 1, cells, domain=[[-1.05] * 3, [1.05] * 3],
                      degree=p, smoothness=r)  # fmt: skip
    system = ball.clamp("surface").system
    K = system.K
    factor = splu(K.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
                  options={"SymmetricMode": True})  # fmt: skip
    assert 0.9 < factor_size(system._half) / factor.L.nnz < 1.6


# ------------------------------------------------------------------------------ many, anywhere

PROGRAM = """
import hashlib, warnings
import ilattice as il
warnings.simplefilter("ignore")
wall = il.Lattice("gyroid", through=il.macroshape.box((1, 1, 1.2))).offset(0.15)
held = il.cutfem.Elasticity(wall, 6, degree=2).clamp("w=0").load(body=(0.3, 0.2, -1.0))
for method in ("superlu", "multigrid"):
    print(hashlib.sha256(held.solve(method=method).coefficients.tobytes()).hexdigest())
"""


def test_solutions_are_the_same_in_all_processes():
    found = [
        subprocess.run(
            [sys.executable, "-c", PROGRAM], env={**os.environ, "NUMBA_NUM_THREADS": threads},
            capture_output=True, text=True, check=True,
        ).stdout
        for threads in ("1", "2")
    ]  # fmt: skip
    assert found[0].count("\n") == 2
    assert found[0] == found[1]


def test_memory_stays_flat_over_300_solves():
    # the interpreter's free lists fill at first: 400 bytes a solve, then 180, 80, 40 per sixty
    held = il.cutfem.Elasticity(lambda u: -np.ones(len(u)), 2, domain=[[0.0] * 3, [1.0] * 3])
    held = held.clamp("w=0")
    rng = np.random.default_rng(0)

    def solve(times):
        for body in rng.standard_normal((times, 3)):
            held.load(body=body).solve()
        gc.collect()
        return tracemalloc.get_traced_memory()[0]

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        tracemalloc.start()
        try:
            first = solve(80)
            assert (solve(220) - first) / 220 < 500
        finally:
            tracemalloc.stop()


def _grid(n):
    """Stiffness of a square grid of springs, held by its rim."""
    line = 2.0 * eye_array(n) - eye_array(n, k=1) - eye_array(n, k=-1)
    return (kron(line, eye_array(n)) + kron(eye_array(n), line)).tolil()


@pytest.mark.parametrize("method", ["auto", "superlu", "multigrid"])
@pytest.mark.parametrize("stiff", [1.0, 1e9])
def test_soft_parts_that_are_not_symmetric_are_refused(method, stiff):
    """However large other entries are: half of such a matrix has another solution."""
    K = _grid(20)
    K[0, 0] += stiff
    assert Solver(K.tocsr(), method=method).solve(np.ones(400))[1].residual < 1e-8
    K[250, 251] = 0.0
    with pytest.raises(InputError, match=r"symmetric: the entries \(25., 25.\)"):
        Solver(K.tocsr(), method=method)


def test_blocks_on_the_diagonal_must_be_symmetric():
    block = np.array([[4.0, 3.0, 0.0], [-3.0, 4.0, 0.0], [0.0, 0.0, 5.0]])
    K = bsr_array(kron(eye_array(20), block), blocksize=(3, 3))
    with pytest.raises(InputError, match="symmetric"):
        Solver(K)


def test_matrices_must_be_real_and_not_tiny():
    with pytest.raises(InputError, match="real"):
        Solver(csr_array(np.array([[2.0, 1j], [-1j, 2.0]])))
    with pytest.raises(InputError, match="vanish"):
        Solver(1e-200 * _grid(5).tocsr())


@pytest.mark.parametrize("method", ["superlu", "multigrid"])
def test_very_small_and_large_loads(method):
    """Their squares are no numbers; solutions are those of others, times a power of two."""
    solver = Solver(_grid(12).tocsr(), method=method)
    b = np.random.default_rng(0).standard_normal((144, 3))
    x, _ = solver.solve(b)
    for power in (-700, 700):
        y, report = solver.solve(np.ldexp(b, power))
        np.testing.assert_array_equal(np.ldexp(y, -power), x)
        assert report.residual < 1e-8
    with pytest.raises(ConvergenceError, match="too large"):
        Solver(1e-60 * _grid(12).tocsr(), method=method).solve(1e260 * b)


@pytest.mark.parametrize("power", [-400, -250, 250, 400])
def test_very_soft_and_stiff_matrices(power):
    """Multigrid, which is in single precision, takes them as others."""
    K = _grid(50).tocsr()
    b = np.random.default_rng(1).standard_normal((2500, 2))
    x, usual = Solver(K, method="multigrid").solve(b)
    y, report = Solver(K * 2.0**power, method="multigrid").solve(b)
    np.testing.assert_allclose(np.ldexp(y, power), x, rtol=1e-12, atol=1e-12 * np.abs(x).max())
    assert report.iterations == usual.iterations
