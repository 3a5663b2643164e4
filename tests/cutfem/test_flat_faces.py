"""Faces that no curvature tells apart: boxes along the axes, anywhere, and what they share."""

import itertools

import numpy as np
import pytest

import ilattice as il


def block(low, high):
    """A box between two corners."""
    low, high = np.asarray(low), np.asarray(high)
    return il.fields.translate(il.fields.box(tuple(0.5 * (high - low))), tuple(0.5 * (low + high)))


def joined(boxes):
    """Volume of the union of boxes (n, 2, 3), and area of its faces by direction and side (3, 2).

    By the grid that all their planes make.
    """
    boxes = np.asarray(boxes)
    planes = [np.unique(boxes[:, :, a]) for a in range(3)]
    full = np.zeros([len(x) + 1 for x in planes], bool)
    for low, high in boxes:
        part = [slice(*(np.searchsorted(x, (low[a], high[a])) + 1)) for a, x in enumerate(planes)]
        full[tuple(part)] = True
    size = [np.concatenate([[0], np.diff(x), [0]]) for x in planes]
    volume = np.einsum("ijk,i,j,k->", full, *size)
    areas = np.zeros((3, 2))
    for a in range(3):
        step = np.diff(full.astype(int), axis=a)
        others = [s for b, s in enumerate(size) if b != a]
        for side, sign in enumerate((1, -1)):
            areas[a, side] = np.einsum("ijk,j,k->", np.moveaxis(step == sign, a, 0), *others)
    return volume, areas


def measured(rule):
    """Area by direction and side of the normals (3, 2)."""
    areas = np.zeros((3, 2))
    axis = np.abs(rule.normals).argmax(axis=1)
    assert np.allclose(np.abs(rule.normals).max(axis=1), 1.0, atol=1e-9)
    for a, side in itertools.product(range(3), range(2)):
        out = rule.normals[:, a] > 0 if side else rule.normals[:, a] < 0
        areas[a, side] = rule.weights[(axis == a) & out].sum()
    return areas


@pytest.mark.parametrize("seed", range(12))
def test_boxes_have_the_area_of_all_their_faces(seed):
    """A quarter of it was lost where rounding tilts faces that stand upright on all columns."""
    rng = np.random.default_rng(seed)
    scale, shift = 10.0 ** rng.uniform(-3, 3), rng.uniform(-1, 1, 3) * rng.choice([0, 3, 300])
    low = rng.uniform(-0.9, 0.0, (rng.integers(1, 4), 3))
    boxes = scale * (np.stack([low, low + rng.uniform(0.5, 0.9, low.shape)], 1) + shift)
    solid = block(*boxes[0])
    for other in boxes[1:]:
        solid = il.fields.union(solid, block(*other))
    domain = scale * (np.array([[-1.0] * 3, [1.0] * 3]) + shift)
    cut = il.cutfem.cut(solid, tuple(rng.integers(3, 8, 3)), domain=domain)
    volume, areas = joined(boxes)
    slack = 1e-9 if abs(shift).max() < 10 else 1e-7
    assert cut.volume(2).weights.sum() == pytest.approx(volume, rel=slack)
    assert measured(cut.surface(2)) == pytest.approx(areas, rel=slack, abs=slack * scale**2)


@pytest.mark.parametrize("seed", range(4))
def test_blocks_whose_faces_lie_on_planes_of_the_grid(seed):
    rng = np.random.default_rng(seed)
    shift = rng.uniform(-1, 1, 3) * rng.choice([0, 3, 300])
    cells = rng.integers(4, 8, 3)
    domain = np.array([[-1.0] * 3, [1.0] * 3]) + shift
    at = np.sort(np.stack([rng.choice(np.arange(1, n), 2, False) for n in cells], 1), axis=0)
    box = domain[0] + 2.0 * at / cells
    cut = il.cutfem.cut(block(*box), tuple(cells), domain=domain)
    volume, areas = joined([box])
    assert cut.volume(2).weights.sum() == pytest.approx(volume, rel=1e-9)
    assert measured(cut.surface(2)) == pytest.approx(areas, rel=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_tilted_boxes_are_closed_by_their_faces(seed):
    """The integral of x n over the faces is the volume; rules for roots at tangents are not exact.

    Faces that are steep along no direction of the grid count as tangents, if they are curved.
    """
    rng = np.random.default_rng([23, seed])
    for _ in range(6):
        half, axis, shift = rng.uniform(0.3, 0.9, 3), rng.standard_normal(3), rng.normal(0, 3, 3)
        box = il.fields.rotate(il.fields.box(tuple(half)), rng.uniform(-2, 2), tuple(axis))
        reach = np.linalg.norm(half) * rng.uniform(1.01, 1.2, (2, 3))
        rule = il.cutfem.quadrature(
            il.fields.translate(box, tuple(shift)), tuple(rng.integers(2, 6, 3)), q=2,
            kind="surface", domain=[shift - reach[0], shift + reach[1]],
        )  # fmt: skip
        closed = rule.points.T @ (rule.weights[:, None] * rule.normals)
        np.testing.assert_allclose(closed, 8 * half.prod() * np.eye(3), atol=2e-11)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_two_planes_as_one_polynomial_take_no_more_than_a_shell(seed, sign):
    """Boxes had to be as small as what is between the planes: 6 million points at 0.06 cells."""
    rng = np.random.default_rng(seed)
    n = rng.standard_normal(3)
    n /= np.linalg.norm(n)
    cells = rng.integers(4, 9, 3)
    low = float(rng.uniform(-0.2, 0.2))
    high = low + 10.0 ** rng.uniform(-2.5, -0.3) * 2.0 / cells.max()
    domain = [[-1.0] * 3, [1.0] * 3]
    pair = (lambda x: low - x @ n, lambda x: x @ n - high)
    shell = il.cutfem.cut(pair, tuple(cells), domain=domain)
    one = il.cutfem.cut(
        lambda x: sign * (x @ n - low) * (x @ n - high), tuple(cells), domain=domain
    )  # fmt: skip
    volume = shell.volume(3).weights.sum()
    found = one.volume(3)
    expected = volume if sign > 0 else 8.0 - volume
    assert found.weights.sum() == pytest.approx(expected, rel=1e-10)
    assert len(found) < (3 * len(shell.volume(3)) if sign > 0 else 6 * 27 * cells.prod())
    assert one.surface(3).weights.sum() == pytest.approx(shell.surface(3).weights.sum(), rel=1e-9)
    normals = one.surface(3).normals
    away = np.where(one.surface(3).points @ n > 0.5 * (low + high), sign, -sign)
    np.testing.assert_allclose(normals, away[:, None] * n, atol=1e-6)
    for name in ("u=0", "v=1", "w=1"):
        area = shell.face(name, 3).weights.sum()
        expected = area if sign > 0 else 4.0 - area
        assert one.face(name, 3).weights.sum() == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("text", "cells", "width"),
    [
        ("sin(2*pi*x)*sin(2*pi*y)", (4, 4, 2), 1.0),
        ("cos(2*pi*x/0.7)*cos(2*pi*(y-0.35)/0.7)", (8, 4, 3), 0.7),
        ("sin(2*pi*x/3)+0*y", (6, 2, 2), 3.0),
    ],
)
def test_waves_that_vanish_on_planes_of_the_grid_are_cut_nowhere(text, cells, width):
    """Bounds of waves end a rounding beyond zero: cells were halved for minutes."""
    grid = il.cutfem.cut(il.fields.equation(text), cells, domain=[[0.0] * 3, [width] * 3])
    assert grid.error == 0.0
    assert grid.volume(2).integrate() == pytest.approx(0.5 * width**3, rel=1e-12)


@pytest.mark.parametrize("radius", [0.05, 0.02])
def test_flat_powers_keep_what_is_small(radius):
    """The bounds of x^8 end near zero in the whole cell."""
    ball = il.fields.equation(f"x^8+y^8+z^8-{radius}^8")
    grid = il.cutfem.cut(ball, 3, domain=[[-1.5] * 3, [1.5] * 3])
    half = np.linspace(0, 1, 201)
    exact = (
        8
        * radius**3
        * np.trapezoid(
            [np.trapezoid(np.maximum(1 - x**8 - half**8, 0) ** 0.125, half) for x in half], half
        )
    )
    assert grid.volume(4).integrate() == pytest.approx(exact, rel=0.02)
