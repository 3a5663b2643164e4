"""Flips, refinement, holes, relaxation, embedding, box splines, fracture."""

import numpy as np
import pytest
from scipy.signal import convolve
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

import ilattice as il
from ilattice.cost import CornerSharing, _refining, boxspline, flips, refinement, shaping
from ilattice.cost.embedding import overlaps
from ilattice.cost.fracture import fracture
from ilattice.errors import ConvergenceError, GeometryError, InputError


def sets_of(k):
    return {frozenset(s) for s in k.simplices.tolist()}


# ------------------------------------------------------------------------------ refinement


@pytest.mark.parametrize(("dim", "part"), [(2, 0.75), (3, 0.5)])
def test_r0_keeps_the_deficit_and_a_part_of_the_mass(dim, part):
    k = il.cost.kagome(5, dim=dim)
    for _ in range(2):
        fine = k.refined().check()
        assert fine.mass == pytest.approx(part * k.mass, rel=1e-12)
        assert fine.deficit == k.deficit
        assert len(fine.edges) == (dim + 1) * len(k.edges)
        assert np.ptp(fine.lengths) < 1e-12
        assert set(np.unique(fine.valence)) == {dim, 2 * dim}
        k = fine
    first = il.cost.kagome(5, dim=dim).refined()
    assert first.rank == len(first.edges)


def test_a_refined_tetrahedron_is_isostatic_and_local_refinement_free():
    one = il.cost.kagome(2).refined()
    assert (len(one.positions), one.rank) == (10, 24)
    k = il.cost.kagome(4).stiffened()
    some = k.refined(where=lambda x: x[:, 2] < 0.4)
    assert len(k.simplices) < len(some.simplices) < 4 * len(k.simplices)
    assert some.check().is_rigid()
    with pytest.raises(InputError, match="True or False for each of 26"):
        k.refined(where=np.arange(26))


def test_r1_takes_corners_of_voids():
    k = il.cost.kagome(6, dim=2)
    voids = refinement.voids(k)
    assert len(voids) == 10
    assert {len(f) for f in voids} == {6}
    fine = k.refined("R1").check()
    corner = k.mass / len(k.simplices) / 4.0
    kept = len(k.simplices) - len({_refining._triangle_of(k, a, b) for f in voids
                                   for a, b in zip(f, np.roll(f, 1), strict=True)})  # fmt: skip
    assert fine.mass == pytest.approx(60 * corner + kept * 4 * corner, rel=1e-12)
    assert fine.is_embedded()
    assert fine.deficit == k.deficit
    with pytest.raises(InputError, match="use R0 in space"):
        il.cost.kagome(3).refined("R1")


def parts_of(k):
    """Number of parts that hang together."""
    n = len(k.positions)
    graph = csr_array((np.ones(len(k.edges)), k.edges.T), shape=(n, n))
    return connected_components(graph, directed=False)[0]


def test_r1_keeps_the_deficit_and_the_whole_together_wherever_it_is():
    rng = np.random.default_rng(4)
    k = il.cost.kagome(7, dim=2)
    bars = finer = 0
    for _ in range(40):
        p, r = rng.uniform(0.1, 0.9, 2), rng.uniform(0.2, 0.6)
        fine = k.refined("R1", where=lambda c: np.linalg.norm(c - p, axis=1) < r)  # noqa: B023
        assert fine.check().deficit == k.deficit
        assert parts_of(fine) == 1
        assert fine.is_embedded()
        bars += len(fine.bars) > 0
        finer += len(fine.simplices) > len(k.simplices)
    assert min(bars, finer) > 10
    whole = k.refined("R1")
    assert whole.perturbed(0.05).rank == len(whole.edges)
    again = whole.refined("R1").check()
    assert (again.deficit, parts_of(again)) == (k.deficit, 1)
    assert len(again.simplices) > 1.5 * len(whole.simplices)


def test_kagome_structures_in_place_of_tetrahedra_keep_minimal_rigidity():
    k = il.cost.kagome(3).perturbed(0.1).stiffened()
    new = refinement.substituted(k, [1, 4], 3).check()
    assert new.deficit == 0
    assert len(new.simplices) == len(k.simplices) + 2 * 9
    assert new.perturbed(0.02).is_rigid()


# ------------------------------------------------------------------------------ flips


def test_a_flip_twice_is_nothing_and_keeps_the_graph_in_order():
    k = il.cost.kagome(4)
    v = int(np.flatnonzero(k.incidence[:, 1] >= 0)[5])
    a, b = flips.options(k, v)[4]
    assert len(flips.options(k, v)) == 9
    once = flips.flipped(k, v, (a, b), kind="graph")
    assert sets_of(once) != sets_of(k)
    back = (a, b) if a in once.simplices[once.incidence[v, 0]] else (b, a)
    assert sets_of(flips.flipped(once, v, back, kind="graph")) == sets_of(k)


@pytest.mark.parametrize(("dim", "kind"), [(2, "graph"), (3, "graph"), (2, "cost"), (3, "cost")])
def test_many_flips_keep_all_conditions(dim, kind):
    k = il.cost.kagome(6, dim=dim)
    r = flips.randomised(k, 10_000 if kind == "graph" else 1500, seed=1, kind=kind).check()
    assert len(sets_of(r) - sets_of(k)) > 10
    before, after = (np.sort((s.incidence >= 0).sum(axis=1)) for s in (k, r))
    assert np.array_equal(before, after)
    assert kind == "graph" or r.is_embedded()
    again = flips.randomised(k, 10_000 if kind == "graph" else 1500, seed=1, kind=kind)
    assert np.array_equal(r.simplices, again.simplices)


def lattice(n):
    """Vertices and triangles of a triangular lattice; coordinates are whole numbers, sheared."""
    at = [(i, j) for i in range(n + 1) for j in range(n + 1 - i)]
    name = {p: i for i, p in enumerate(at)}
    up = [(name[i, j], name[i + 1, j], name[i, j + 1]) for i, j in at if i + j < n]
    down = [(name[i + 1, j], name[i + 1, j + 1], name[i, j + 1]) for i, j in at if i + j < n - 1]
    return np.array(at, float), [*up, *down]


def test_midpoints_of_flipped_triangulations_are_flipped_midpoints():
    """Equation (1), on a lattice: no position moves; a flip is possible where it is convex."""
    x, triangles = lattice(6)
    shear = np.array([[1.0, 0.0], [0.5, np.sqrt(0.75)]])
    rng = np.random.default_rng(0)
    tried = made = 0
    while made < 60:
        k = il.cost.midpoint(x @ shear, triangles)
        edges = {}
        for t, row in enumerate(triangles):
            for i in range(3):
                edges.setdefault(frozenset((row[i], row[i - 1])), []).append(t)
        inner = [e for e in sorted(edges, key=sorted) if len(edges[e]) == 2]
        pair = inner[rng.integers(len(inner))]
        p, q = sorted(pair)
        s, t = edges[pair]
        r, o = (next(c for c in triangles[i] if c not in pair) for i in (s, t))
        side = [
            np.linalg.det([x[b] - x[a], x[c] - x[a]])
            for a, b, c in ((r, o, p), (r, o, q), (p, q, r), (p, q, o))
        ]
        convex = side[0] * side[1] < 0
        v = int(np.argmin(np.linalg.norm(k.positions - (0.5 * (x[p] + x[q])) @ shear, axis=1)))
        tried += 1
        assert flips.is_balanced(k, v) == convex
        if not convex:
            with pytest.raises(GeometryError, match=r"flat or overlaps another one|is none, or"):
                flips.flipped(k, v)
            continue
        made += 1
        new = flips.flipped(k, v)
        triangles = [row for i, row in enumerate(triangles) if i not in (s, t)]
        triangles += [(r, o, p), (r, o, q)]
        other = il.cost.midpoint(x @ shear, triangles)
        places = [
            {frozenset(tuple(c) for c in np.round(m.positions[s], 9).tolist()) for s in m.simplices}
            for m in (new, other)
        ]
        assert places[0] == places[1]
    assert tried > made


def test_modified_flips_move_the_vertex_to_the_new_midpoint():
    x = np.array([(0.0, 0.0), (2.0, 0.1), (1.7, 1.5), (0.2, 1.1)])
    k = il.cost.midpoint(x, [(0, 1, 2), (0, 2, 3)])
    v = int(np.flatnonzero(k.incidence[:, 1] >= 0)[0])
    new = flips.flipped(k, v, kind="modified")
    np.testing.assert_allclose(new.positions[v], 0.5 * (x[1] + x[3]), atol=1e-14)
    other = il.cost.midpoint(x, [(1, 2, 3), (1, 3, 0)])
    assert new.mass == pytest.approx(other.mass, rel=1e-12)


def test_flips_towards_a_distribution_find_it():
    k = il.cost.kagome(8, dim=2)
    free = flips.randomised(k, 1500, seed=2)
    short = flips.randomised(free, 3000, seed=3, target=lambda e: e**2)
    assert short.lengths.mean() < 0.95 * free.lengths.mean()
    assert short.check().is_embedded()


def test_flips_that_are_none_are_refused():
    k = il.cost.kagome(4)
    edge = int(np.flatnonzero(k.incidence[:, 1] < 0)[0])
    with pytest.raises(InputError, match="swap must be given in space"):
        flips.flipped(k, 5)
    with pytest.raises(GeometryError, match="is none, or simplices would then share"):
        flips.flipped(k, edge, (0, 1))
    plane = il.cost.kagome(4, dim=2)
    edge = int(np.flatnonzero(plane.incidence[:, 1] < 0)[0])
    with pytest.raises(GeometryError, match="has one triangle only"):
        flips.flipped(plane, edge)


def test_balanced_vertices_in_space():
    k = il.cost.kagome(4)
    inner = int(np.flatnonzero((k.incidence >= 0).all(axis=1))[0])
    assert flips.is_balanced(k, inner)
    x = k.positions.copy()
    x[inner] += 2.0 * (x[inner] - k.positions.mean(axis=0)) + 0.1
    assert not flips.is_balanced(k.moved(x), inner)


# ------------------------------------------------------------------------------ positions


def test_a_hole_becomes_nearly_a_circle():
    """In units in which edges of the triangulation are 2: the figures of the specification."""
    k = il.cost.kagome(12, dim=2)
    unit = k.lengths.mean()
    middle = k.positions.mean(axis=0)
    places = np.array([k.positions[f].mean(axis=0) for f in refinement.voids(k)])
    near = places[np.argmin(np.linalg.norm(places - middle, axis=1))]
    before = shaping.void_areas(k).max() / unit**2
    assert before == pytest.approx(6 * np.sqrt(3) / 4)
    hole = shaping.opened(k, near, sweeps=300).check()
    big = max(refinement.voids(hole), key=len)
    assert len(big) == 12
    r = np.linalg.norm(hole.positions[big] - hole.positions[big].mean(axis=0), axis=1)
    assert r.max() / r.min() < 1.05
    assert refinement.area(hole, big) / unit**2 > 5.0 / 0.65 * before
    assert hole.is_embedded()
    assert set(np.unique(hole.valence)) == {2, 4}
    with pytest.raises(GeometryError, match="is in no void"):
        shaping.opened(k, (9.0, 9.0))


def test_relaxation_ends_where_sweeps_lead():
    k = flips.randomised(il.cost.kagome(5, dim=2), 200, seed=4)
    np.testing.assert_allclose(
        shaping.relaxed(k).positions, shaping.relaxed(k, sweeps=4000).positions, atol=1e-9
    )


def test_lengths_that_are_asked_for_are_reached_or_refused():
    k = il.cost.kagome(4, dim=2)
    there = k.moved(
        k.positions + 0.02 * np.random.default_rng(0).standard_normal(k.positions.shape)
    )
    held = k.incidence[:, 1] < 0
    there = k.moved(np.where(held[:, None], k.positions, there.positions))
    found = shaping.with_lengths(k, there.lengths)
    np.testing.assert_allclose(found.lengths, there.lengths, rtol=1e-9)
    with pytest.raises(ConvergenceError, match="lengths are off by up to"):
        shaping.with_lengths(k, 10.0)


@pytest.mark.parametrize("dim", [2, 3])
def test_overlaps_agree_with_linear_programs(dim):
    """Two simplices overlap if a point is inside both: the largest slack of a linear program."""
    from scipy.optimize import linprog

    rng = np.random.default_rng(dim)
    for _ in range(60):
        x = rng.random((2 * (dim + 1), dim))
        x[dim + 1 :] += 0.6 * rng.random(dim)
        k = CornerSharing(x, np.arange(2 * (dim + 1)).reshape(2, -1))
        A = []
        for s in k.simplices:
            M = np.linalg.inv(np.vstack([x[s].T, np.ones(dim + 1)]))
            A.append(np.column_stack([-M[:, :dim], np.ones(dim + 1), M[:, dim]]))
        A = np.vstack(A)
        found = linprog([0] * dim + [-1], A[:, :-1], A[:, -1], bounds=[(None, None)] * (dim + 1))
        slack = -found.fun
        if abs(slack) > 1e-6:
            assert (len(overlaps(k)) == 1) == (slack > 0)


# ------------------------------------------------------------------------------ box splines


@pytest.mark.parametrize(
    ("dim", "size", "unit", "counts"),
    [
        (2, 19, 16, {10: 1, 6: 6, 2: 6, 1: 6}),
        (3, 65, 32, {18: 1, 10: 8, 8: 6, 4: 12, 2: 24, 1: 14}),
    ],
)
def test_masks_and_averages(dim, size, unit, counts):
    at, taps = boxspline.mask(dim)
    assert len(taps) == size
    assert taps.sum() == 2**dim
    values, number = np.unique(unit * taps, return_counts=True)
    assert dict(zip(values.astype(int), number, strict=True)) == counts
    rng = np.random.default_rng(0)
    c = rng.standard_normal((5,) * dim)
    dense = np.zeros(np.ptp(at, axis=0) + 1)
    dense[tuple((at - at.min(axis=0)).T)] = taps
    wide = np.pad(c, 3, constant_values=-1.0)
    spread = np.zeros([2 * n - 1 for n in wide.shape])
    spread[(slice(None, None, 2),) * dim] = wide
    naive = convolve(spread, dense, mode="same", method="direct")
    inner = tuple(slice(6, 6 + 9) for _ in range(dim))
    np.testing.assert_allclose(boxspline.subdivided(c), naive[inner], atol=1e-14)


def test_a_box_spline_of_a_structure_is_solid_around_its_vertices():
    k = il.cost.kagome(4)
    fine = boxspline.samples(k, 2)
    at = tuple(4 * k.origin.integers[:, :3].T)
    assert fine[at].min() > fine.mean()
    np.testing.assert_allclose(boxspline.subdivided(np.full((4, 4), -1.0)), -1.0, atol=1e-15)


# ------------------------------------------------------------------------------ fracture


def test_edges_break_at_their_strength_one_after_the_other():
    k = il.cost.kagome(4, dim=2).stiffened()
    k = k.with_bars(il.cost.stiffening.candidates(k, np.arange(len(k.positions)),
                                                  2.1 * k.lengths.mean(), k.bars)[:12])  # fmt: skip
    low = k.positions[:, 1] < 1e-9
    top = int(np.argmax(k.positions[:, 1]))
    f = np.zeros_like(k.positions)
    f[top] = (0.3, -1.0)
    found = fracture(k, f, supports=low, strength=2.0, steps=12)
    whole = k.stress(f, supports=low, stiffness=1.0)
    assert found.broken[0] == np.argmax(np.abs(whole.bars))
    assert found.load[0] == pytest.approx(2.0 / np.abs(whole.bars).max())
    assert len(set(found.broken.tolist())) == len(found.broken)
    compliance = found.displacement / found.load
    assert (np.diff(compliance) > -1e-12).all()
    assert found.path.shape == (len(found.broken), 2)


def test_fractures_are_those_of_a_dense_oracle():
    """Edges taken away one by one, each state by a dense stiffness matrix."""
    rng = np.random.default_rng(7)
    k = il.cost.kagome(4, dim=2).perturbed(0.2, seed=3).stiffened()
    near = il.cost.stiffening.candidates(
        k, np.arange(len(k.positions)), 2.1 * k.lengths.mean(), k.bars
    )
    k = k.with_bars(near[::2])
    e, x = k.edges, k.positions
    EA, strength = rng.uniform(0.5, 2.0, len(e)), rng.uniform(0.2, 1.0, len(e))
    held = x[:, 1] < 0.2
    f = rng.standard_normal(x.shape)
    found = fracture(k, f, supports=held, stiffness=EA, strength=strength, steps=10)
    assert len(found.broken) > 3
    free = np.flatnonzero(np.repeat(~held, 2))
    way = x[e[:, 0]] - x[e[:, 1]]
    R = np.zeros((len(e), *x.shape))
    R[np.arange(len(e)), e[:, 0]], R[np.arange(len(e)), e[:, 1]] = way, -way
    R = R.reshape(len(e), -1) / k.lengths[:, None]
    there = EA / k.lengths
    for i, b in enumerate(found.broken):
        K = R.T @ (there[:, None] * R)
        u = np.zeros(f.size)
        u[free] = np.linalg.solve(K[np.ix_(free, free)], f.ravel()[free])
        part = np.abs(there * (R @ u)) / strength
        assert np.argmax(part) == b
        assert found.load[i] == pytest.approx(1.0 / part.max(), rel=1e-3)
        work = found.load[i] * (f.ravel() @ u) / np.linalg.norm(f[~held])
        assert found.displacement[i] == pytest.approx(work, rel=1e-3)
        there[b] = 0.0


def test_planar_flips_of_layers_are_flips_of_the_stack():
    """Every vertex keeps to two tetrahedra, or has none, wherever the layers are flipped."""
    rng = np.random.default_rng(1)
    layer = il.cost.kagome(6, dim=2)
    n = len(layer.positions)
    shifts = rng.uniform(-0.02, 0.02, (4, 2))
    layers = np.stack([
        np.column_stack([layer.positions + shift, np.full(n, z)])
        for shift, z in zip(shifts, (0.0, 0.2, 0.45, 0.6), strict=True)
    ])  # fmt: skip
    stack = il.cost.stacked(layer, layers)
    inner = np.flatnonzero(layer.valence == 4)
    assert len(inner) == 45
    for v in rng.choice(inner, 8, replace=False).tolist():
        k = il.cost.flips.layer_flipped(layer, layers, v).check()
        assert len(k.simplices) == len(stack.simplices)
        assert set(np.unique(k.valence)) == {3, 6}
        assert k.is_embedded()
        flat = il.cost.flips.flipped(layer, v)
        apex = np.sort(k.simplices, axis=1)[:, :3]
        found = {tuple(np.round(t, 9)) for t in k.positions[apex][:, :, :2].mean(axis=1)}
        triangles = flat.positions[flat.simplices].mean(axis=1)
        wanted = {tuple(np.round(t + s, 9)) for s in shifts for t in triangles}
        assert found <= wanted  # the bases of tetrahedra are triangles of the flipped layer
    with pytest.raises(il.errors.GeometryError, match="one triangle only"):
        il.cost.flips.layer_flipped(layer, layers, 0)


def test_fractures_refuse_what_makes_no_sense():
    k = il.cost.kagome(3).stiffened()
    low, f = k.positions[:, 2] < 0.3, np.zeros_like(k.positions)
    f[-1, 2] = -1.0
    with pytest.raises(InputError, match="strength must be one positive number or one per edge"):
        fracture(k, f, supports=low, strength=np.ones(3))
    for loads, held in ((1.0 * low[:, None] + 0 * f, low), (f, np.arange(28))):
        with pytest.raises(InputError, match="free"):
            fracture(k, loads, supports=held)
    more = f + 5.0 * low[:, None]
    a, b = (fracture(k, loads, supports=low, steps=3) for loads in (f, more))
    np.testing.assert_allclose(a.displacement, b.displacement, rtol=1e-9)


def test_vertices_may_be_held_twice():
    k = il.cost.kagome(3)
    once, twice = (shaping.relaxed(k, fixed=f).positions for f in ([0, 1], [0, 1, 1, 0]))
    np.testing.assert_allclose(once, twice, atol=1e-14)
