"""Counts, incidences and positions of corner-sharing structures, against brute force."""

from itertools import product
from math import comb

import numpy as np
import pytest
from cost_zoo import EIGHT, OCTAHEDRON, octahedron
from scipy.spatial import Delaunay

import ilattice as il
from ilattice.cost import CornerSharing
from ilattice.errors import GeometryError, InputError


def by_force(level, dim):
    """Simplices of the untrimmed structure as sets of integer tuples, by trying all tuples."""
    total = 2 * level + dim - 2
    tuples = [
        (*c, total - sum(c)) for c in product(range(total + 2), repeat=dim) if sum(c) <= total + 1
    ]
    out = set()
    for base in tuples:
        for sign in (1, -1):
            c = (*base[:-1], base[-1] + sign)
            if min(c) > 0 and all(x % 2 for x in c):
                out.add(frozenset(
                    tuple(x - sign * (i == j) for i, x in enumerate(c)) for j in range(dim + 1)
                ))  # fmt: skip
    if dim == 3:  # the corner tetrahedra go
        out = {s for s in out if max(max(v) for v in s) < 2 * level - 1}
    return out


@pytest.mark.parametrize("level", range(3, 14))
def test_counts_in_space(level):
    k = il.cost.kagome(level).check()
    T = comb(level + 2, 3) - 4 + comb(level + 1, 3)
    assert len(k.positions) == 4 * comb(level + 2, 3) - 12
    assert (len(k.simplices), len(k.edges)) == (T, 6 * T)
    i = k.origin.integers
    assert (i.sum(axis=1) == 2 * level + 1).all()
    assert ((i % 2 == 0).sum(axis=1) == 1).all()
    assert i.max() < 2 * level - 1
    assert len(np.unique(i, axis=0)) == len(i)
    N = comb(level + 1, 2) - 3
    on_face = (i == 0).any(axis=1)
    assert ((i == 0).sum(axis=0) == N).all()
    corner = ~on_face & (k.valence == 3)
    assert corner.sum() == 4
    assert (k.valence[on_face] == 3).all()
    assert (k.incidence[on_face, 1] < 0).all()
    inner = ~on_face & ~corner
    assert (k.valence[inner] == 6).all()
    assert (k.incidence[inner] >= 0).all()
    assert k.deficit == 6 * N
    assert np.ptp(k.lengths) < 1e-12 * k.lengths.mean()
    assert k.lengths.mean() == pytest.approx(np.sqrt(2.0) / (2 * level + 1), rel=1e-12)


@pytest.mark.parametrize("level", [2, 3, 5, 10])
def test_counts_in_the_plane(level):
    k = il.cost.kagome(level, dim=2).check()
    assert len(k.positions) == 3 * comb(level + 1, 2)
    assert len(k.simplices) == level**2
    assert (k.incidence[:, 1] < 0).sum() == 3 * level == (k.valence == 2).sum()
    assert k.deficit == 3 * level - 3
    assert np.ptp(k.lengths) < 1e-12


@pytest.mark.parametrize(("level", "dim"), [(n, 3) for n in range(2, 9)] + [(7, 2)])
def test_closed_formulas_find_what_brute_force_finds(level, dim):
    k = il.cost.kagome(level, dim=dim)
    i = k.origin.integers
    found = {frozenset(tuple(int(x) for x in i[v]) for v in s) for s in k.simplices}
    assert len(found) == len(k.simplices)
    assert found == by_force(level, dim)


def test_midpoints_of_random_meshes_have_the_exact_part_of_the_volume():
    rng = np.random.default_rng(3)
    for d, part in ((3, 1 / 27), (2, 1 / 4)):
        p = rng.random((150, d)) * np.array([1.0, 30.0, 1e-3][:d])
        cells = Delaunay(p / np.array([1.0, 30.0, 1e-3][:d])).simplices
        k = il.cost.midpoint(p, cells)
        whole = np.abs(CornerSharing(p, cells).volumes)
        np.testing.assert_allclose(np.abs(k.volumes), part * whole, rtol=1e-10)
        assert set(np.unique(k.valence)) == {d, 2 * d}
        assert len(k.simplices) == len(cells)


@pytest.mark.parametrize(("level", "counts"), [(3, (188, 80, 78)), (5, (880, 408, 186))])
def test_eight_kagome_structures_make_an_octahedron(level, counts):
    k = octahedron(level).check()
    assert (len(k.positions), len(k.simplices), k.deficit) == counts
    assert il.cost.kagome(level).joined().deficit == il.cost.kagome(level).deficit


def test_joins_ask_the_mesh_and_not_the_coordinates():
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    turn[:, 0] *= np.sign(np.linalg.det(turn))
    k = il.cost.fill(1e-9 * OCTAHEDRON @ turn.T + 1.0, EIGHT, resolution=3).joined()
    assert len(k.positions) == 188
    x, tets = il.cost.divided_box((2, 1, 2))
    assert CornerSharing(x, tets).volumes.sum() == pytest.approx(1.0)
    k = il.cost.fill(x, tets, resolution=3).joined().check()
    assert k.is_embedded()


def test_layers_of_a_kagome_structure_are_kagome_structures():
    k = il.cost.kagome(6)
    i = k.origin.integers
    for c, level in ((1, 6), (3, 5), (5, 4)):
        inside = i[i[:, 3] == c][:, :3]
        plane = il.cost.kagome(level, dim=2).origin.integers
        missing = {tuple(v) for v in plane.tolist()} - {tuple(v) for v in inside.tolist()}
        assert len(missing) == (6 if c == 1 else 0)
        assert {tuple(v) for v in inside.tolist()} <= {tuple(v) for v in plane.tolist()}


def test_stacks_of_layers_make_tetrahedra():
    layer = il.cost.kagome(5, dim=2)
    z = np.array([0.0, 0.16, 0.31, 0.5])
    x = np.stack([np.column_stack([layer.positions, np.full(len(layer.positions), h)]) for h in z])
    k = il.cost.stacked(layer, x)
    up, down = comb(6, 2), comb(5, 2)
    assert len(k.simplices) == 2 * (up + down + up)
    assert k.is_embedded()
    assert set(np.unique(k.valence)) == {3, 6}


def test_bad_structures_are_refused_by_number():
    x = np.random.default_rng(0).random((9, 3))
    with pytest.raises(GeometryError, match="vertex 0 is shared by 3 simplices"):
        CornerSharing(x, [(0, 1, 2, 3), (0, 4, 5, 6), (0, 7, 8, 1)]).check()
    with pytest.raises(GeometryError, match=r"simplices\[1\] \[4, 5, 5, 6\] has a vertex twice"):
        CornerSharing(x[:7], [(0, 1, 2, 3), (4, 5, 5, 6)]).check()
    with pytest.raises(GeometryError, match="simplices 0 and 1 share 2 vertices"):
        CornerSharing(x[:6], [(0, 1, 2, 3), (0, 1, 4, 5)]).check()
    with pytest.raises(GeometryError, match="vertex 8 is in no simplex"):
        CornerSharing(x, [(0, 1, 2, 3), (4, 5, 6, 7)]).check()
    with pytest.raises(GeometryError, match=r"bars\[0\] \[0, 1\] is there twice"):
        CornerSharing(x[:4], [(0, 1, 2, 3)], [(0, 1)]).check()
    with pytest.raises(InputError, match=r"simplices\[0\] .* from 0 to 8"):
        CornerSharing(x, [(0, 1, 2, 9)])
    flat = [(0, 1, 2, 3), (0, 1, 2, 4), (0, 1, 2, 5)]
    with pytest.raises(
        GeometryError, match=r"face \[0, 1, 2\] is shared by 3 simplices, \[0, 1, 2"
    ):
        il.cost.midpoint(x[:6], flat)
    with pytest.raises(GeometryError, match=r"simplices\[1\] .* is inverted"):
        il.cost.fill(OCTAHEDRON, [EIGHT[0], (*EIGHT[1][:2], *EIGHT[1][:1:-1])], resolution=3)
    with pytest.raises(InputError, match="resolution must be a whole number from 2"):
        il.cost.kagome(1)
    levels = [3, 4] + [3] * 6
    with pytest.raises(GeometryError, match="simplices 0 and 1 share a face, but have resolutions"):
        il.cost.fill(OCTAHEDRON, EIGHT, resolution=levels).joined()


def test_affine_maps_change_nothing_but_positions():
    k = il.cost.kagome(4).stiffened()
    rng = np.random.default_rng(5)
    A, b = rng.standard_normal((3, 3)), rng.standard_normal(3)
    A[:, 0] *= np.sign(np.linalg.det(A))
    moved = k.mapped(lambda x: x @ A.T + b)
    assert np.array_equal(moved.edges, k.edges)
    assert moved.rank == k.rank == 3 * len(k.positions) - 6
    corners = il.cost.kagome(2).positions * 0 + np.vstack([np.zeros(3), np.eye(3)])
    linear = il.cost.BernsteinSimplex(1, (corners @ A.T + b)[[0, 1, 2, 3]], corners)
    np.testing.assert_allclose(linear(k.positions), k.positions @ A.T + b, atol=1e-14)
    straight = il.cost.BernsteinSimplex.straight(corners, 4)
    np.testing.assert_allclose(straight(k.positions), k.positions, atol=1e-14)


def test_maps_that_fold_or_end_are_refused():
    k = il.cost.kagome(3)
    with pytest.raises(GeometryError, match="inverts 10 of 10 simplices: numbers"):
        k.mapped(lambda x: x * np.array([1.0, 1.0, -1.0]))
    with pytest.raises(InputError, match="outside of the domain"):
        k.moved(k.positions + 0.5).mapped(il.macroshape.box())
    duck = il.macroshape.duck()
    fitted = k.moved(3.0 * k.positions - 1.0).fitted(duck.domain).mapped(duck)
    np.testing.assert_allclose(
        fitted.positions, duck.x(k.fitted(duck.domain).positions), atol=1e-12
    )


def test_quadratic_maps_have_the_multinomial_factor():
    """p(x, y) = (x² - y, x y + 3), which a quadratic triangle represents exactly."""
    corners = np.array([(0.2, -0.1), (1.3, 0.4), (0.1, 0.9)])

    def p(x):
        return np.column_stack([x[:, 0] ** 2 - x[:, 1], x[:, 0] * x[:, 1] + 3.0])

    alpha = il.cost.mapping.exponents(2, 2)
    ends = [[np.repeat(np.arange(3), a)[i] for i in range(2)] for a in alpha]
    u, v = corners[[e[0] for e in ends]], corners[[e[1] for e in ends]]
    blossom = np.column_stack([
        u[:, 0] * v[:, 0] - 0.5 * (u[:, 1] + v[:, 1]),
        0.5 * (u[:, 0] * v[:, 1] + u[:, 1] * v[:, 0]) + 3.0,
    ])  # fmt: skip
    x = np.random.default_rng(0).random((20, 2))
    found = il.cost.BernsteinSimplex(2, blossom, corners)(x)
    np.testing.assert_allclose(found, p(x), atol=1e-13)


@pytest.mark.parametrize("dim", [2, 3])
def test_barycentric_coordinates_give_points_back(dim):
    rng = np.random.default_rng(dim)
    corners, x = rng.standard_normal((dim + 1, dim)), rng.standard_normal((7, dim))
    through = il.cost.BernsteinSimplex.straight(corners, 2)
    xi = through.barycentric(x)
    np.testing.assert_allclose(xi.sum(axis=1), 1.0, atol=1e-13)
    np.testing.assert_allclose(xi @ corners, x, atol=1e-12)
    np.testing.assert_allclose(through.barycentric(corners), np.eye(dim + 1), atol=1e-13)
    with pytest.raises(InputError, match=rf"x must have shape \(n, {dim}\)"):
        through.barycentric(np.zeros((2, dim + 1)))


def test_maps_of_simplices_end_at_their_faces():
    C = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    through = il.cost.BernsteinSimplex(1, 2.0 * C, C)
    inside = il.cost.kagome(3, corners=C).mapped(through)
    np.testing.assert_allclose(inside.positions, 2.0 * il.cost.kagome(3, corners=C).positions)
    with pytest.raises(InputError, match="outside of the simplex of the map"):
        il.cost.kagome(3, corners=2.0 * C + 0.3).mapped(through)


def test_flat_simplices_of_meshes_are_named():
    x = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 0, 1]]
    with pytest.raises(GeometryError, match=r"simplices\[1\] .* is flat"):
        il.cost.midpoint(x, [[0, 1, 2, 4], [0, 1, 2, 3]])
    layer = il.cost.kagome(3, dim=2)
    flat = np.pad(layer.positions, ((0, 0), (0, 1)))
    with pytest.raises(GeometryError, match="is flat"):
        il.cost.stacked(layer, [flat, flat])
