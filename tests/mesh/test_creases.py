"""Sharp edges of contours: solids with planes, spheres and caps, whose volumes are known."""

import numpy as np
import pytest

import ilattice as il
from ilattice import fields
from ilattice.mesh import SurfaceMesh, contour
from ilattice.mesh.contouring import contour_arrays
from ilattice.mesh.creases import sharpened

TILTED = fields.rotate(fields.box(0.6), 0.7, (1.0, 2.0, 0.5))


def planes(n, size=1.13):
    return (np.linspace(-size, size, n),) * 3


def sharp(field, axes, corners=None):
    raw = contour_arrays(field, axes)
    found = sharpened(raw, field, axes, corners)
    return SurfaceMesh(found.vertices, found.faces)


def raw_volume(raw):
    return SurfaceMesh(raw.vertices, raw.faces).volume


@pytest.mark.parametrize("n", [24, 25, 30, 41])
def test_tilted_boxes_are_sharp(n):
    axes = planes(n)
    box = sharp(TILTED, axes)
    assert box.is_watertight
    assert box.self_intersections == 0
    assert box.genus == 0
    chamfered = contour(TILTED, axes)
    assert abs(box.volume - 1.2**3) < 0.06 * abs(chamfered.volume - 1.2**3)
    assert abs(box.area - 6 * 1.2**2) < 0.1 * abs(chamfered.area - 6 * 1.2**2)


def test_edges_of_spheres_converge_with_the_square_of_the_spacing():
    ball = fields.sphere(1.0)
    lens = fields.intersection(ball, fields.translate(ball, (0.9, 0.3, 0.2)))
    d = np.sqrt(0.94)
    volume = np.pi * (4 + d) * (2 - d) ** 2 / 12
    errors = [abs(sharp(lens, planes(n)).volume / volume - 1) for n in (16, 32, 64)]
    slope = np.polyfit(np.log([16, 32, 64]), np.log(errors), 1)[0]
    assert slope < -1.8
    assert errors[-1] < 2e-3


def test_edges_end_at_caps_and_stay_on_them():
    slope = np.array([0.3, 0.2, 1.0])
    wedge = fields.intersection(
        fields.half_space(slope, 0.1), fields.half_space(np.array([0.8, -1.0, 0.3]), 0.2)
    )
    axes = planes(14, 1.0)
    found = sharp(wedge, axes)
    raw = contour_arrays(wedge, axes)
    x = np.asarray(found.vertices)
    for a, sides in enumerate(((-1.0, 1.0), (-1.0, 1.0), (-1.0,))):
        for bit, side in enumerate(sides, 1):
            on = (raw.kind >> (2 * a)) & 3 == bit
            assert on.any()
            np.testing.assert_array_equal(x[on, a], side)
    u = (np.indices((200,) * 3).reshape(3, -1).T + 0.5) / 100 - 1
    assert found.volume == pytest.approx(8 * (wedge(u) < 0).mean(), rel=5e-4)
    assert abs(raw_volume(raw) - found.volume) > 5e-3
    assert found.is_watertight


class Within:
    """A field that is known in the unit cube only: the intersection of two halves of space."""

    bounds = np.array([[0.0] * 3, [1.0] * 3])
    normal = np.array([[-0.32, 0.92, 0.23], [-0.2, -0.81, -0.55]])
    level = normal @ np.full(3, 0.5)

    def __call__(self, p):
        return self.jet(p, 0)[0]

    def jet(self, p, order=1):
        assert ((p >= 0.0) & (p <= 1.0)).all()
        both = p @ self.normal.T - self.level
        side = both.argmax(axis=1)
        jets = both.max(axis=1), self.normal[side], np.zeros((len(p), 3, 3))
        return jets[: order + 1]


def test_creases_next_to_faces_of_the_domain_stay_within():
    part = sharp(Within(), (np.linspace(0.0, 1.0, 12),) * 3)
    assert part.is_watertight
    assert part.vertices.min() == 0.0
    assert part.vertices.max() == 1.0


def test_smooth_surfaces_stay_as_they_are():
    ball = fields.sphere(1.0)
    raw = contour_arrays(ball, planes(30))
    found = sharpened(raw, ball, planes(30))
    np.testing.assert_array_equal(found.vertices, raw.vertices)
    np.testing.assert_array_equal(found.faces, raw.faces)


@pytest.mark.filterwarnings("ignore:the mesh with spacing")  # coarse
def test_tight_surfaces_beside_creases_are_met():  # their tangent planes meet beside them
    h = 0.05
    for seed in range(4):
        rng = np.random.default_rng(seed)
        ring = fields.rotate(fields.torus(0.5, 0.07), rng.uniform(0, 3), rng.standard_normal(3))
        ball = fields.translate(fields.sphere(0.12), rng.uniform(-0.5, 0.5, 3))
        bar = fields.capsule(rng.uniform(-0.6, 0.6, 3), rng.uniform(-0.6, 0.6, 3), 0.06)
        solid = fields.union(ring, ball, bar)
        mesh = il.sdf.mesh(solid, h, allow_loss=True)
        assert mesh.is_watertight
        assert mesh.self_intersections == 0
        assert np.abs(solid(mesh.vertices)).max() < 0.05 * h


@pytest.mark.parametrize("field", [fields.sphere(1.0), TILTED])
def test_a_mesh_becomes_itself_on_the_same_grid(field):
    axes = planes(20)
    first = sharp(field, axes)
    distance = il.sdf.MeshDistance(first)
    corners = np.asarray(first.vertices)
    again = np.asarray(sharp(distance, axes, corners).vertices)
    nearest = np.linalg.norm(corners[:, None] - again[None], axis=2).min(axis=0)
    assert np.median(nearest) == 0.0
    assert np.percentile(nearest, 97) < 1e-9


def test_without_corners_meshes_wear():
    axes = planes(20)
    first = sharp(fields.sphere(1.0), axes)
    again = sharp(il.sdf.MeshDistance(first), axes)
    assert again.volume < first.volume * (1 - 1e-5)


def test_the_side_is_right_next_to_slivers():
    first = sharp(TILTED, planes(20))
    assert first.quality.min() < 1e-9
    p = np.random.default_rng(5).uniform(-1.5, 1.5, (20_000, 3))
    true = TILTED(p)
    clear = np.abs(true) > 0.01
    assert ((il.sdf.MeshDistance(first)(p) < 0) == (true < 0))[clear].all()


@pytest.mark.parametrize("on_grid", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_straight_and_curved_edges_are_sharp_wherever_the_grid_is(seed, on_grid):
    """Of two vertices that cut an edge off one is on the surface; beside holes quads are hollow."""
    rng = np.random.default_rng(seed)
    shift = np.zeros(3) if on_grid else rng.uniform(-0.3, 0.3, 3)
    half = np.array([3.0, 2.5, 1.0]) if on_grid else rng.uniform((2.5, 2, 0.9), (3.5, 2.5, 1.3))
    base = il.fields.union(
        il.fields.box(half), il.fields.translate(il.fields.box((0.6, 1.0, 2.0)), (-2.0, 0.0, 1.5))
    )
    hole = il.fields.translate(il.fields.cylinder(rng.uniform(0.7, 1.2)), (1.0, 0.2, 0.0))
    solid = il.fields.translate(il.fields.difference(base, hole), shift)
    h = 0.25 if on_grid else rng.uniform(0.2, 0.3)
    mesh = il.sdf.mesh(solid, h)
    assert mesh.is_watertight
    assert np.abs(solid(mesh.vertices)).max() < 0.05 * h
    off = np.abs(solid(mesh.vertices[mesh.faces].mean(axis=1))) > 0.05 * h
    assert off.sum() <= 40  # at corners where three planes meet in one cell
