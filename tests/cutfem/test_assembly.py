"""Sparse matrices: reference implementations, identities, the same bits for any threads."""

import itertools
from dataclasses import replace

import numba
import numpy as np
import pytest
from scipy.interpolate import BSpline as Reference
from scipy.sparse import csr_array, triu

import ilattice as il
from ilattice.cutfem import SplineSpace
from ilattice.cutfem import _kernels_assembly as kernels
from ilattice.cutfem.assembly import Assembly, compressed_where_long
from ilattice.cutfem.stabilise import ghost_faces, void_rule
from ilattice.quadrature.rules import on_cells

CUBE = [[0.0] * 3, [1.0] * 3]
ONE = np.ones((1, 1))


KINDS = [(1, 0), (2, 1), (2, 0), (3, 2), (3, 1), (3, 0)]  # degree and smoothness


def ball(u):
    return ((u - 0.45) ** 2).sum(axis=1) - 0.42**2


def made(p, cells=4, through=None, closed=None, weight=0.1, field=ball, smoothness=None):
    cut = il.cutfem.cut(field, cells, domain=CUBE, degree=2, through=through)
    if closed is not None:
        grid = il.cutfem.Grid(cut.grid.axes, closed)
        cut = il.cutfem.cut(field, grid, degree=2, through=through)
    rule = cut.volume(p + 1)
    r = p - 1 if smoothness is None else smoothness
    space = SplineSpace(cut.grid, p, rule.cells, r)
    faces = ghost_faces(
        cut.status, tuple(cut.faces(a, 1) for a in range(3)), rule.cells, weight, rule
    )
    return cut, rule, Assembly(space, through, faces)


def matrix(asm, rule, kind, d=ONE, p=1.0, q=0.0, m=1):
    data = asm.zeros(m)
    asm.add_cells(data, rule, kind, d, p, q)
    return asm.pattern.matrix(data).whole()


def ghosts(asm, m=1):
    data = asm.zeros(m)
    asm.add_ghost(data, lambda *_: np.ones(1))
    return asm.pattern.matrix(data).whole()


def naive_lines(space, u, nu):
    """Values (n, functions) of all active functions, differentiated as nu says, by SciPy.

    Copies of functions are zero in cells that do not have them.
    """
    rows = []
    for a in range(3):
        n = len(space.knots[a]) - space.degree - 1
        one = Reference(space.knots[a], np.eye(n), space.degree)(u[:, a], nu=nu[a])
        wrapped = np.zeros((len(u), space.shape[a]))
        np.add.at(wrapped.T, np.arange(n) % space.shape[a], one.T)
        rows.append(wrapped)
    here = np.zeros((len(u), len(space)))
    np.put_along_axis(here, space.dofs[space.locate(u)], 1.0, axis=1)
    return here * np.einsum("ni,nj,nk->nijk", *rows).reshape(len(u), -1)[:, space.functions]


def naive_basis(asm, rule):
    N = naive_lines(asm.space, rule.points, (0, 0, 0))
    du = [naive_lines(asm.space, rule.points, tuple(np.eye(3, dtype=int)[a])) for a in range(3)]
    J = np.broadcast_to(asm.jacobians(rule.points), (len(rule), 3, 3))
    return N, np.einsum("qna,qac->qnc", np.stack(du, -1), np.linalg.inv(J)), np.linalg.det(J)


@pytest.mark.parametrize("p", [1, 2, 3])
def test_cell_matrices_are_those_of_the_reference_implementation(p):
    bent = il.macroshape.torus(major=3.0, width=1.0)
    _, rule, asm = made(p, (4, 3, 3), bent)
    N, g, det = naive_basis(asm, rule)
    w = rule.weights * np.abs(det)
    rng = np.random.default_rng(p)
    rho = rng.random((len(rule), 1))
    M = matrix(asm, rule, kernels.MASS, rho).toarray()
    np.testing.assert_allclose(M, np.einsum("q,qa,qb->ab", w * rho[:, 0], N, N), atol=1e-13)
    d = rng.random((len(rule), 6))
    D = d[:, [[0, 5, 4], [5, 1, 3], [4, 3, 2]]]
    T = matrix(asm, rule, kernels.TENSOR, d).toarray()
    np.testing.assert_allclose(T, np.einsum("q,qai,qij,qbj->ab", w, g, D, g), atol=1e-12)
    lam, mu = 0.7, 0.4
    S = np.einsum("q,qai,qbj->aibj", w, g, g)
    trace = np.einsum("akbk->ab", S)
    expected = lam * S + mu * S.transpose(0, 3, 2, 1)
    expected += mu * trace[:, None, :, None] * np.eye(3)[:, None, :]
    K = matrix(asm, rule, kernels.PAIRS, ONE, lam, mu, m=3).toarray()
    np.testing.assert_allclose(K, expected.reshape(K.shape), atol=1e-12)
    jets = np.concatenate([g, N[:, :, None]], axis=2)
    Q = np.einsum("q,qai,qbj->aibj", w * rho[:, 0], jets, jets)
    J = matrix(asm, rule, kernels.JETS, rho, m=4).toarray()
    np.testing.assert_allclose(J, Q.reshape(J.shape), atol=1e-12)


def naive_need(cut, rule, wet, enough):
    """Square of what a cell lacks, times its nearness to solid, in tenths per cell."""
    full = {c: v / cut.grid.boxes(np.array([c]))[0, 3:].prod()
            for c, v in zip(rule.cells, rule.integrate_cells(), strict=True)}  # fmt: skip
    near = dict(full)
    sides = [s for f in wet for s in zip(f.cells, f.neighbours, strict=True)]
    for _ in range(len(full)):
        for i, j in sides:
            near[i], near[j] = max(near[i], 0.1 * near[j]), max(near[j], 0.1 * near[i])
    near = {c: min(max(10 * v, 0.01), 1.0) for c, v in near.items()}
    need = {c: max(1 - v / enough, 0) ** 2 * near[c] for c, v in full.items()}
    return lambda i, j: need[i if full[i] < full[j] else j]


def corner(u):
    """Slivers on three faces, smaller ones on three edges, and one at the corner."""
    return (u - [0.62, 0.7, 0.75]).max(axis=1)


@pytest.mark.parametrize(("p", "r"), KINDS)
@pytest.mark.filterwarnings("ignore:the volume of the field")
@pytest.mark.parametrize("enough", [1.0, 0.2])
def test_ghost_penalty_is_that_of_the_reference_implementation(p, r, enough):
    axes = (np.array([0, 0.3, 0.6, 1.0]), np.linspace(0, 1, 4), np.array([0, 0.2, 0.7, 1.0]))
    cut = il.cutfem.cut(corner, il.cutfem.Grid(axes), degree=2)
    rule = cut.volume(2)
    space = SplineSpace(cut.grid, p, rule.cells, r)
    wet = tuple(cut.faces(a, 1) for a in range(3))
    asm = Assembly(space, None, ghost_faces(cut.status, wet, rule.cells, 0.3, rule, enough))
    c = np.random.default_rng(p).normal(size=len(space))
    total = 0.0
    x, w = np.polynomial.legendre.leggauss(p + 1)
    need = naive_need(cut, rule, wet, enough)
    for axis, faces in enumerate(wet):
        b, c2 = (a for a in range(3) if a != axis)
        for low, high in zip(faces.cells, faces.neighbours, strict=True):
            if 0 not in cut.status.ravel()[[low, high]]:
                continue
            weight = 0.3 * need(low, high)
            box, other = cut.grid.boxes(np.array([low, high]))
            h = 0.5 * (box[3 + axis] + other[3 + axis])
            for s, t in itertools.product(range(p + 1), repeat=2):
                u = np.empty((2, 3))
                u[:, axis] = box[axis] + box[3 + axis] + np.array([-1e-9, 1e-9])
                u[:, b] = box[b] + box[3 + b] * 0.5 * (x[s] + 1)
                u[:, c2] = box[c2] + box[3 + c2] * 0.5 * (x[t] + 1)
                area = 0.25 * w[s] * w[t] * box[3 + b] * box[3 + c2]
                for k in range(r + 1, p + 1):
                    nu = [0, 0, 0]
                    nu[axis] = k
                    jump = np.diff(naive_lines(space, u, tuple(nu)) @ c)[0] * h**k
                    total += weight / {1: 1, 2: 3, 3: 20}[k] * area / h * jump**2
    assert c @ (ghosts(asm) @ c) == pytest.approx(total, rel=1e-7)


@pytest.mark.parametrize(("p", "r"), KINDS)
def test_ghost_penalty_spares_polynomials_and_counts_in_space(p, r):
    _, _, asm = made(p, smoothness=r)
    G = ghosts(asm)
    smooth = asm.space.interpolate(lambda u: u[:, :1] ** p * u[:, 1:2] ** p + u[:, 2:] ** p)
    c = smooth.ravel()[asm.space.functions]
    rough = np.random.default_rng(0).normal(size=len(c))
    assert abs(c @ (G @ c)) < 1e-10 * (rough @ (G @ rough))
    large = il.macroshape.box((3.0, 3.0, 3.0))
    _, _, same = made(p, through=large, smoothness=r)
    np.testing.assert_allclose(ghosts(same).toarray(), 3.0 * G.toarray(), atol=1e-11)


@pytest.mark.parametrize(("p", "r"), KINDS)
def test_rigid_motions_have_no_energy_and_functions_add_up_to_one(p, r):
    turned = il.macroshape.box((1.0, 2.0, 0.5))
    _, rule, asm = made(p, through=turned, smoothness=r)
    K = matrix(asm, rule, kernels.PAIRS, ONE, 0.58, 0.38, m=3) + ghosts(asm, 3)
    x = asm.coordinates
    np.testing.assert_allclose(asm.evaluate(x, rule.points)[0], turned.x(rule.points), atol=1e-12)
    motions = [np.broadcast_to(e, x.shape) for e in np.eye(3)]
    motions += [np.cross(e, x) for e in np.eye(3)]
    for v in motions:
        assert np.abs(K @ v.ravel()).max() < 1e-12 * np.abs(K.data).max()
    volume = rule.in_space().integrate()
    one = np.ones(len(x))
    assert one @ (matrix(asm, rule, kernels.MASS) @ one) == pytest.approx(volume, rel=1e-12)
    laplace = matrix(asm, rule, kernels.TENSOR, np.array([[1.0, 1, 1, 0, 0, 0]]))
    np.testing.assert_allclose(x.T @ (laplace @ x), volume * np.eye(3), atol=1e-12)


@pytest.mark.parametrize("kind", ["slab", "corner"])
@pytest.mark.parametrize("p", [1, 2, 3])
def test_one_cell_has_the_rigid_motions_and_no_others_however_it_is_cut(p, kind):
    axes = (0,) if kind == "slab" else (0, 1, 2)
    for eta in (0.5, 0.1, 1e-2, 1e-6, 1e-12):
        planes = [il.fields.half_space(np.eye(3)[a], eta) for a in axes]
        cut = il.cutfem.cut(il.fields.intersection(*planes), 1, domain=CUBE, degree=1)
        rule = cut.volume(p + 1)
        asm = Assembly(SplineSpace(cut.grid, p, rule.cells, p - 1))
        K = matrix(asm, rule, kernels.PAIRS, ONE, 0.58, 0.38, m=3).toarray()
        assert (K == K.T).all()
        x = asm.coordinates
        motions = [np.broadcast_to(e, x.shape) for e in np.eye(3)]
        motions += [np.cross(e, x) for e in np.eye(3)]
        for v in motions:
            assert np.abs(K @ v.ravel()).max() < 1e-12 * np.abs(K).max()
        if eta == 0.5 and p == 1:
            values = np.linalg.eigvalsh(K) / np.abs(K).max()
            assert values[5] < 1e-13 < 1e-9 < values[6]


@pytest.mark.parametrize(("p", "r"), KINDS)
def test_gradients_integrate_to_normals(p, r):
    """What patch tests live on; boxes that are tangent to the surface leave a few millionths."""
    bent = il.macroshape.cylinder_shell(1.0, 2.0, angle=1.0)
    cut = il.cutfem.cut(ball, 4, domain=CUBE, degree=2, through=bent)
    rule, skin = cut.volume(10).in_space(), cut.surface(10).in_space()
    asm = Assembly(SplineSpace(cut.grid, p, rule.cells, r), bent)
    P = rule.weights[:, None, None] * np.eye(3)
    around = asm.vector(skin, skin.weights[:, None] * skin.normals)
    np.testing.assert_allclose(asm.vector(rule, None, P), around, rtol=0, atol=1e-5)


@pytest.mark.parametrize("r", [1, 0])
@pytest.mark.parametrize("closed", [(False,) * 3, (True, False, True)])
def test_the_pattern_is_that_of_shared_elements(closed, r):
    _, rule, asm = made(2, 5, closed=closed, smoothness=r)
    rows = []
    for group in (asm.space.dofs, *asm.ghost.dofs(asm.space)):
        e = np.repeat(np.arange(len(group)), group.shape[1])
        rows.append(csr_array((np.ones(group.size), (e, group.ravel())),
                              shape=(len(group), len(asm.space))))  # fmt: skip
    expected = sum(r.T @ r for r in rows).tocsr()
    expected.sort_indices()
    for half, whole in ((True, triu(expected, format="csr")), (False, expected)):
        pattern = replace(asm, half=half).pattern
        np.testing.assert_array_equal(whole.indptr, pattern.indptr)
        np.testing.assert_array_equal(whole.indices, pattern.indices)
    K = matrix(asm, rule, kernels.PAIRS, ONE, 0.6, 0.4, m=3) + ghosts(asm, 3)
    assert abs(K - K.T).max() == 0.0


@pytest.mark.parametrize("p", [1, 2])
def test_compressed_rules_give_the_same_matrices(p):
    cut, _, asm = made(p, 4, field=il.tiles["gyroid"])
    rule = cut.volume(6)
    full = matrix(asm, rule, kernels.PAIRS, ONE, 0.6, 0.4, m=3)
    few = compressed_where_long(rule, 2 * p, 0.0)
    assert len(few) < 0.7 * len(rule)
    np.testing.assert_allclose(few.integrate_cells(), rule.integrate_cells(), rtol=1e-11)
    small = matrix(asm, few, kernels.PAIRS, ONE, 0.6, 0.4, m=3)
    assert abs(full - small).max() < 1e-13 * abs(full).max()
    assert compressed_where_long(cut.volume(2), 4, 0.0) is not rule


def test_compression_through_a_curved_map_costs_next_to_nothing():
    bent = il.macroshape.torus(major=3.0, width=1.0)
    errors = []
    for cells in ((8, 4, 4), (16, 8, 8)):
        cut, _, asm = made(2, cells, bent)
        rule = cut.volume(6)
        full = matrix(asm, rule, kernels.PAIRS, ONE, 0.6, 0.4, m=3)
        small = matrix(asm, compressed_where_long(rule, 4, 0.0), kernels.PAIRS, ONE, 0.6, 0.4, m=3)
        errors.append(abs(full - small).max() / abs(full).max())
    assert errors[0] < 1e-4
    assert errors[1] < errors[0] / 2


def test_matrices_of_slivers_through_curved_maps_are_positive():
    """Moments of whole cells are off by more than what is in a sliver, which is left as it is."""
    lattice = il.Lattice("gyroid", through=il.macroshape.torus(), repeat=(4, 1, 1),
                         spans_per_tile=5)  # fmt: skip
    domain = il.cutfem.Elasticity(lattice.offset(0.1), (7, 2, 2), q=4).domain
    asm = domain.assembly(np.arange(1), weak=False)
    few = domain.stiff_rule(asm, constant=True)
    assert len(few) < 0.7 * len(domain.volume)
    K = matrix(asm, few, kernels.PAIRS, ONE, 0.6, 0.4, m=3) + ghosts(asm, 3)
    K = K.toarray()
    d = np.sqrt(np.diag(K))
    assert np.linalg.eigvalsh(K / np.outer(d, d))[0] > -1e-12


def test_the_void_is_weighted():
    cut, rule, asm = made(1)
    solid, whole = rule.integrate(), len(rule.cells) / 64
    assert void_rule(cut, rule, 2, 0.25, 0.75).integrate() == pytest.approx(
        0.75 * solid + 0.25 * whole, rel=1e-12
    )
    cells = np.intersect1d(rule.cells, cut.cells(0))
    void = void_rule(cut, on_cells(rule, cells), 2, 1.0, -1.0)
    assert void.integrate() == pytest.approx(whole - solid, rel=1e-12)
    heavy = void_rule(cut, rule, 2, 1.0, 0.0)
    assert matrix(asm, heavy, kernels.MASS).sum() == pytest.approx(whole, rel=1e-12)


def test_forces_add_up_and_gradients_are_those_of_fields():
    _, rule, asm = made(2)
    f = asm.vector(rule, rule.weights[:, None] * rule.points)
    np.testing.assert_allclose(f.sum(axis=0), rule.integrate(lambda u: u), rtol=1e-12)
    P = np.random.default_rng(0).normal(size=(len(rule), 2, 3))
    c = np.random.default_rng(1).normal(size=(len(asm.space), 2))
    gradient = np.empty((len(rule), 2, 3))
    for rows, _, g in asm.on_rule(c, rule):
        gradient[rows] = g
    assert (asm.vector(rule, None, P) * c).sum() == pytest.approx((P * gradient).sum(), rel=1e-11)
    np.testing.assert_allclose(asm.evaluate(c, rule.points)[1], gradient, atol=1e-12)


@pytest.mark.threads
def test_threads_change_no_bit():
    bent = il.macroshape.torus(major=3.0, width=1.0)
    results = []
    threads = numba.get_num_threads()
    try:
        for n in (1, threads):
            numba.set_num_threads(n)
            _, rule, asm = made(2, 5, bent)
            K = matrix(asm, rule, kernels.PAIRS, ONE, 0.6, 0.4, m=3) + ghosts(asm, 3)
            f = asm.vector(rule, rule.weights[:, None] * rule.points)
            results.append((K.data, K.indices, f, asm.evaluate(f, rule.points)[1]))
    finally:
        numba.set_num_threads(threads)
    assert all(np.array_equal(a, b) for a, b in zip(*results, strict=True))


def test_maps_are_affine_only_if_their_jacobian_is_constant():
    from ilattice.cutfem.assembly import constant_jacobian

    np.testing.assert_allclose(constant_jacobian(il.macroshape.box((1, 2, 3)))[0],
                               np.diag([1, 2, 3]))  # fmt: skip
    assert constant_jacobian(il.macroshape.torus(major=3.0, width=1.0)) is None


def test_surface_matrices_are_those_of_the_reference_implementation():
    from ilattice.cutfem import Elasticity, Heat, weak

    bent = il.macroshape.torus(major=3.0, width=1.0)
    for degree in (1, 2):
        problem = Elasticity(ball, 4, domain=CUBE, degree=degree, through=bent, poisson=0.2)
        problem = problem.clamp("surface", components="xz").spring("outer", (1.0, 2.0, 3.0))
        asm = problem.assembly
        rule = problem.domain.edge(asm, "surface")
        u = rule.parameters
        N = naive_lines(asm.space, u, (0, 0, 0))
        du = [naive_lines(asm.space, u, tuple(np.eye(3, dtype=int)[a])) for a in range(3)]
        g = np.einsum("qna,qac->qnc", np.stack(du, -1), np.linalg.inv(asm.jacobians(u)))
        n, w, eye = rule.normals, rule.weights, np.eye(3)
        for condition in problem.weakly_imposed:
            terms = weak.terms_of(problem, condition)
            mask = terms.mask
            lam, mu = np.outer(problem._lame(u[:1], np.zeros(1, int)), np.ones(len(u)))
            T = np.einsum("q,qi,qbj->qbij", lam, n, g) + np.einsum("q,qbi,qj->qbij", mu, g, n)
            T += np.einsum("q,qbk,qk,ij->qbij", mu, g, n, eye)
            half = np.einsum("q,qa,i,qbij->aibj", w, N, mask, T)
            expected = np.einsum("q,qa,qb,qij->aibj", w, N, N, terms.Q)
            expected -= half + half.transpose(2, 3, 0, 1)
            data = asm.zeros(3)
            weak.add(data, problem, terms)
            found = asm.pattern.matrix(data).whole().toarray()
            np.testing.assert_allclose(found, expected.reshape(found.shape), atol=1e-11)
        heat = Heat(problem.domain, conductivity=3.0).fix("surface", 0.0)
        terms = weak.terms_of(heat, heat.supports[0])
        Q = terms.Q[:, 0, 0]
        F = 3.0 * np.einsum("qac,qc->qa", g, n)
        half = np.einsum("q,qa,qb->ab", w, N, F)
        data = heat.assembly.zeros(1)
        weak.add(data, heat, terms)
        found = heat.assembly.pattern.matrix(data).whole().toarray()
        expected = np.einsum("q,qa,qb->ab", w * Q, N, N) - half - half.T
        np.testing.assert_allclose(found, expected, atol=1e-10)
