"""Distances to meshes against extended precision, whole numbers and libigl."""

import warnings
from fractions import Fraction

import conformance
import igl
import meshes
import naive_mesh_distance as naive
import numba
import numpy as np
import pytest

import ilattice as il
from ilattice.errors import GeometryError, InputError, PrecisionWarning
from ilattice.mesh import SurfaceMesh, contour
from ilattice.sdf import MeshDistance
from ilattice.sdf._triangles import normals_and_areas, twins


def skewed():
    """Torus under a shear and a flattening."""
    v, f = meshes.torus(16, 8)
    return v @ np.array([[1, 0, 0], [30, 1, 0], [-20, 5, 1e-2]]), f


def needles(count=24, height=1e-6):
    """A lens of two fans, a million times as wide as thick."""
    angle = np.arange(count) * 2 * np.pi / count
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)
    i, j = np.arange(count), (np.arange(count) + 1) % count
    top, bottom = np.stack([i, j, 0 * i + count], 1), np.stack([j, i, 0 * i + count + 1], 1)
    return np.concatenate([ring, [[0, 0, height], [0, 0, -height]]]), np.concatenate([top, bottom])


def squashed():
    """Lens of triangles a million times as long as wide."""
    v, f = needles(24, 1e-3)
    return v * [1, 1e-6, 1], f


def capped(height):
    """Cube whose faces are split by a vertex `height` from one side: slivers, flat for 0."""
    v, f = meshes.cube()
    a, b, c = np.moveaxis(v[f], 1, 0)
    middle = len(v) + np.arange(len(f))
    i, j, k = f.T
    parts = [[i, j, middle], [j, k, middle], [k, i, middle]]
    faces = np.concatenate([np.stack(part, 1) for part in parts])
    return np.concatenate([v, a + 0.3 * (b - a) + height * (c - a)]), faces


def spiky():
    """Sphere with spikes of all lengths, flattened."""
    v, f = meshes.sphere(2)
    v[::7] *= np.random.default_rng(5).uniform(1, 1e3, (len(v[::7]), 1))
    return v * [1, 1, 1e-3], f


ZOO = {
    "cube": meshes.cube(),
    "torus": meshes.torus(12, 6),
    "skewed": skewed(),
    "needles": needles(),
    "squashed": squashed(),
    "spiky": spiky(),
    "slivers": capped(1e-6),
    "hairs": capped(1e-12),
    "flat triangles": capped(0.0),
}


def distance(part, **options):
    return MeshDistance(SurfaceMesh(*part), **options)


def near(vertices, faces, rng, count):
    """Points at large, and at distances of all sizes from corners, edges and faces."""
    corners = vertices[faces]
    extent = np.ptp(vertices, axis=0).max()
    points = [rng.uniform(vertices.min(0) - extent / 5, vertices.max(0) + extent / 5, (count, 3))]
    for size in (1e-1, 1e-3, 1e-5, 1e-7, 1e-9):
        pick = rng.integers(len(faces), size=(3, count))
        weights = rng.dirichlet((1, 1, 1), count)
        t = rng.uniform(size=(count, 1))
        points += [
            corners[pick[0], 0],
            (1 - t) * corners[pick[1], 1] + t * corners[pick[1], 2],
            np.einsum("nj,njc->nc", weights, corners[pick[2]]),
        ]
        for p in points[-3:]:
            p += size * rng.normal(size=p.shape)
    return np.concatenate(points)


@pytest.fixture(params=ZOO)
def part(request):
    return ZOO[request.param]


# --- values and sides -------------------------------------------------------------------------


def test_distances_are_those_of_extended_precision(part):
    points = near(*part, np.random.default_rng(1), 20)
    field = distance(part)
    expected, _ = naive.distance(points, *part)
    np.testing.assert_allclose(np.abs(field(points)), expected, atol=1e-14 * field._scale)


def test_sides_are_those_of_whole_numbers(part):
    points = near(*part, np.random.default_rng(2), 8)
    inside = naive.inside(points, *part)
    np.testing.assert_array_equal(distance(part)(points) < 0, inside)


@pytest.mark.parametrize("kind", ["cube", "torus", "skewed", "needles", "squashed"])
def test_agrees_with_libigl(kind):
    v, f = ZOO[kind]
    points = near(v, f, np.random.default_rng(3), 300)
    ours = distance((v, f))(points)
    # by winding numbers: libigl's own pseudonormals take some wrong sides of "skewed"; of "spiky"
    # and "slivers" even its distances are off, by more than 1e-6
    theirs, *_ = igl.signed_distance(points, v, f, igl.SIGNED_DISTANCE_TYPE_WINDING_NUMBER)
    np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)


def test_sharp_edges_are_told_by_winding():
    v, f = needles(7, 1e-9)
    points = v[:7] * (1 + 1e-12 + 1e-6 * np.arange(7)[:, None])
    field = distance((v, f))
    assert (field(points) > 0).all()
    assert (field(0.999 * v[:7]) < 0).all()


# --- feet -------------------------------------------------------------------------------------


def test_feet_lie_on_their_triangles_at_the_distance(part):
    field = distance(part)
    points = near(*part, np.random.default_rng(4), 10)
    feet, faces, signed = field.closest(points)
    scale = field._scale
    gap = np.linalg.norm(points - feet, axis=1)
    np.testing.assert_allclose(gap, np.abs(signed), atol=1e-14 * scale)
    v, f = part
    for foot, face in zip(feet, faces, strict=True):
        assert naive.distance(foot[None], v, f[face][None])[0] < 1e-14 * scale


def test_the_least_number_wins_in_any_order():
    v, f = meshes.cube()
    field = distance((v, f))
    points = np.array([[-1, -1, -1], [2, 2, 2], [0.5, 0.5, -0.3], [2, 0.2, 0.2]])
    _, faces, _ = field.closest(points)
    for point, face in zip(points[:3], faces, strict=False):
        d = [naive.distance(point[None], v, triangle[None])[0][0] for triangle in f]
        assert face == np.flatnonzero(np.isclose(d, min(d), rtol=0, atol=1e-15))[0]
    for order in ([3, 2, 1, 0], [2, 0, 3, 1]):
        np.testing.assert_array_equal(field.closest(points[order]).faces, faces[order])


def test_order_of_points_changes_no_bit():
    v, f = meshes.torus(12, 6)
    points = near(v, f, np.random.default_rng(6), 100)
    field, order = distance((v, f)), np.random.default_rng(7).permutation(len(points))
    np.testing.assert_array_equal(field(points)[order], field(points[order]))


def test_points_on_the_mesh_are_at_distance_zero():
    v, f = meshes.torus(12, 6)
    feet, faces, d = distance((v, f)).closest(v)
    assert (d == 0).all()
    np.testing.assert_array_equal(feet, v)
    assert [f.tolist().index(row) for row in f[faces].tolist()] == faces.tolist()
    assert all(i in f[face] for i, face in enumerate(faces))


# --- as a field -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "box",
    [
        ((1.1, 1.1, 1.1), (2, 2, 2)),
        ((0.2, 1.1, 1.1), (0.8, 2, 2)),
        ((0.3, 0.2, 1.2), (0.7, 0.8, 2)),
        ((0.4, 0.3, 0.1), (0.5, 0.4, 0.2)),
    ],
    ids=["corner", "edge", "face", "inside"],
)
def test_is_a_smooth_field_off_its_kinks(box):
    field = distance(meshes.cube())
    conformance.check_field(field, np.random.default_rng(8), box=box, points=60)
    assert np.linalg.norm(field.jet(np.mean(box, axis=0)[None], 1)[1]) == pytest.approx(1)


def test_curvature_inside_is_that_of_the_reentrant_edge():
    v, f = SHELL
    field = distance((v, f))
    box = ((0.25, 0.3, 0.3), (0.33, 0.33, 0.33))  # in the wall, off an inner corner's faces
    conformance.check_field(field, np.random.default_rng(8), box=box, points=60, converges=False)


def test_is_a_bounded_field_everywhere():
    field, rng = distance(meshes.sphere(2)), np.random.default_rng(9)
    box = 1.5 * field.bounds
    conformance.check_values(field, rng.uniform(*box, (200, 3)), exact=True)
    conformance.check_bad_points(field)
    conformance.check_threads(field, rng, box)
    conformance.check_range(field, rng, box, converges=True)


def test_gradients_on_the_mesh_are_normals():
    v, f = meshes.sphere(2)
    middles = v[f].mean(axis=1)
    normals, _ = normals_and_areas(v[f])
    value, gradient, hessian = distance((v, f)).jet(np.concatenate([middles, v]))
    np.testing.assert_allclose(value, 0, atol=1e-15)
    np.testing.assert_allclose(gradient[: len(f)], normals, atol=1e-12)
    assert (np.einsum("ni,ni->n", gradient[len(f) :], v) > 0.9).all()
    assert (hessian[len(f) :] == 0).all()


def test_gradients_within_rounding_of_an_edge_are_those_of_a_face_next_to_it():
    """Of a flat square of two triangles: directions to its diagonal are noise there."""
    x = 0.3 * np.array([[0.0, 0, 0], [1, 0, 0.2], [1, 1, 0.5], [0, 1, 0.3]]) + [5.0, 3.0, 4.0]
    square = SurfaceMesh(x, [[0, 1, 2], [0, 2, 3]])
    normal = np.cross(x[1] - x[0], x[2] - x[0])
    normal /= np.linalg.norm(normal)
    with pytest.warns(PrecisionWarning):
        field = MeshDistance(square)
    t = np.random.default_rng(2).uniform(0.05, 0.95, (200, 1))
    p = x[0] + t * (x[2] - x[0])
    value, gradient = field.jet(p, 1)
    assert (value != 0.0).any()
    assert np.abs(value).max() < 1e-14
    np.testing.assert_allclose(np.abs(gradient @ normal), 1.0, atol=1e-9)


def test_bounding_box_holds_what_is_below_a_level():
    field = distance(meshes.cube((1, 2, 3), 2.0))
    np.testing.assert_array_equal(field.bounds, [[1, 2, 3], [3, 4, 5]])
    np.testing.assert_array_equal(field.bounding_box(0.5), [[0.5, 1.5, 2.5], [3.5, 4.5, 5.5]])
    np.testing.assert_array_equal(field.bounding_box(-0.5), field.bounds)
    with pytest.raises(InputError, match="level"):
        field.bounding_box(np.nan)


def test_contours_are_offset_meshes():
    axes = [np.linspace(-1.4, 1.4, 22)] * 3
    field = distance(meshes.sphere(2))
    mesh = contour(field, axes, level=0.25)
    assert mesh.is_watertight
    assert mesh.genus == 0
    np.testing.assert_allclose(field(mesh.vertices), 0.25, atol=1e-3)


# --- meshes that bound no solid ---------------------------------------------------------------

OUTER, INNER = meshes.cube(), meshes.cube((0.4, 0.4, 0.4), 0.2)
SHELL = meshes.joined(OUTER, (INNER[0], INNER[1][:, ::-1]))


def test_a_cavity_is_no_fault():
    field = distance(SHELL, strict=True)
    assert not field.faults
    np.testing.assert_allclose(field([[0.5, 0.5, 0.5], [0.2, 0.5, 0.5]]), [0.1, -0.2])


def faulty(kind):
    v, f = meshes.sphere(2)
    match kind:
        case "open":
            return (v, f[1:]), "3 open, 0 non-manifold and 0 wrongly oriented edges, and 0 edges"
        case "twisted":
            f[5] = f[5, ::-1]
            return (v, f), "0 open, 0 non-manifold and 3 wrongly oriented edges, and 0 edges"
        case "touching":
            v, f = meshes.joined(meshes.cube(), meshes.cube((1, 1, 0)))
            return welded(v, f), "0 open, 1 non-manifold"
    return meshes.joined(
        (v, f), (v + np.array([0.9, 0.1, 0.2]), f)
    ), "0 open, 0 non-manifold and 0 wrong"


def welded(v, f):
    unique, number = np.unique(v, axis=0, return_inverse=True)
    return unique, number[f]


@pytest.mark.parametrize("kind", ["open", "twisted", "touching", "crossing"])
def test_faults_are_counted_warned_of_and_refused(kind):
    part, message = faulty(kind)
    with pytest.warns(PrecisionWarning, match=message):
        field = distance(part)
    assert field.faults
    assert message in repr(field)
    assert (field.faults.crossings > 0) == (kind == "crossing")
    with pytest.raises(GeometryError, match=message):
        distance(part, strict=True)


@pytest.mark.parametrize("kind", ["open", "twisted", "touching", "crossing"])
def test_sides_of_faulty_meshes_are_those_of_the_winding_number(kind):
    (v, f), _ = faulty(kind)
    with pytest.warns(PrecisionWarning):
        field = distance((v, f))
    points = np.random.default_rng(10).uniform(v.min(0) - 0.3, v.max(0) + 0.3, (2000, 3))
    number = igl.winding_number(v, f, points)
    np.testing.assert_allclose(field.winding_number(points), number, atol=1e-9)
    sure = np.abs(number - 0.5) > 1e-6
    np.testing.assert_array_equal((field(points) < 0)[sure], (number > 0.5)[sure])
    assert 100 < (number > 0.5).sum() < 1900
    if kind == "crossing":
        assert number.max() > 1.5


def test_bounds_hold_where_the_sign_jumps():
    (v, f), _ = faulty("open")
    f = f[(v[f][:, :, 2] < 0.3).all(axis=1)]
    with pytest.warns(PrecisionWarning):
        field = distance((v, f))
    box = np.array([[-1.2, -1.2, -0.2], [1.2, 1.2, 1.2]])
    conformance.check_range(field, np.random.default_rng(11), box, converges=False)


def test_meshes_inside_out_are_turned():
    v, f = meshes.torus(12, 6)
    points = near(v, f, np.random.default_rng(12), 30)
    with pytest.warns(PrecisionWarning, match="inside out"):
        turned = distance((v, f[:, ::-1]))
    right = distance((v, f))
    np.testing.assert_allclose(turned(points), right(points), atol=1e-15)
    for ours, theirs in zip(turned.jet(points[:30]), right.jet(points[:30]), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-9 * np.abs(theirs).max())
    np.testing.assert_allclose(turned.jet(v, 1)[1], -normals_of_first_faces(turned, v), atol=1e-12)
    with pytest.raises(GeometryError, match="inside out"):
        distance((v, f[:, ::-1]), strict=True)


def normals_of_first_faces(field, points):
    mesh = field.mesh
    return normals_and_areas(mesh.vertices[mesh.faces])[0][field.closest(points).faces]


def test_bad_meshes_and_arguments_are_refused():
    v, f = meshes.cube()
    with pytest.raises(GeometryError, match="no triangles"):
        distance((v, f[:0]))
    for scale in (1e120, 1e-120):
        with pytest.raises(GeometryError, match="scale it"):
            distance((scale * v, f))
    with pytest.raises(InputError, match="SurfaceMesh"):
        MeshDistance((v, f))
    with pytest.raises(InputError, match="lo <= hi"):
        distance((v, f)).range([[0, 0, 0]], [[1, 1, 1], [2, 2, 2]])


def test_vertices_without_a_triangle_do_not_count():
    v, f = meshes.cube()
    field = distance((np.concatenate([v, [[9, 9, 9]]]), f))
    np.testing.assert_array_equal(field.bounds, [[0, 0, 0], [1, 1, 1]])
    assert field([[9, 9, 9]])[0] == pytest.approx(8 * 3**0.5)


def test_single_precision_meshes_are_taken_as_they_are():
    v, f = meshes.sphere(1)
    narrow = v.astype(np.float32)
    points = np.random.default_rng(13).uniform(-2, 2, (50, 3))
    expected = distance((narrow.astype(float), f))(points)
    np.testing.assert_array_equal(distance((narrow, f.astype(np.int32)))(points), expected)


# --- tree and triangles -----------------------------------------------------------------------


@pytest.mark.parametrize("ratio", [1.0, 0.5])
def test_trees_of_many_equal_or_ever_smaller_parts(ratio):
    tetra = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    parts = [(tetra * ratio**i, faces) for i in range(200)]
    part = meshes.joined(*parts)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PrecisionWarning)
        field = distance(part)
    box, link = field._box, field._link
    leaves = link[:, 2] > 0
    assert link[leaves, 2].sum() == len(part[1])
    assert link[leaves, 2].max() <= 4
    assert sorted(field._number) == list(range(len(part[1])))
    for child in (np.flatnonzero(~leaves) + 1, link[~leaves, 0]):
        assert (box[child, :3] >= box[~leaves, :3]).all()
        assert (box[child, 3:] <= box[~leaves, 3:]).all()
    points = np.random.default_rng(14).uniform(-0.5, 1.5, (40, 3))
    expected, _ = naive.distance(points, *part)
    np.testing.assert_allclose(np.abs(field(points)), expected, atol=1e-15)


@pytest.mark.threads
def test_any_number_of_threads_gives_the_same_faulty_sides():
    (v, f), _ = faulty("open")
    with pytest.warns(PrecisionWarning):
        field = distance((v, f))
    points = np.random.default_rng(15).uniform(-1.2, 1.2, (3000, 3))
    many, threads = field(points), numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        one = field(points)
    finally:
        numba.set_num_threads(threads)
    np.testing.assert_array_equal(one, many)


@pytest.mark.parametrize("height", [1e-3, 1e-9, 1e-15])
def test_normals_of_slivers_are_right_to_the_last_digits(height):
    rng = np.random.default_rng(16)
    corners = rng.normal(size=(50, 3, 3))
    corners[:, 2] = 0.3 * corners[:, 0] + 0.7 * corners[:, 1] + height * corners[:, 2]
    normals, areas = normals_and_areas(corners)
    for triangle, normal, area in zip(corners, normals, areas, strict=True):
        a, b, c = ([Fraction(x) for x in corner] for corner in triangle.tolist())
        u, v = ([p - q for p, q in zip(x, a, strict=True)] for x in (b, c))
        w = [u[i - 2] * v[i - 1] - u[i - 1] * v[i - 2] for i in range(3)]
        exact = np.array([float(x) for x in w])
        np.testing.assert_allclose(normal, exact / np.linalg.norm(exact), atol=2e-15)
        assert area == pytest.approx(np.linalg.norm(exact) / 2, rel=1e-14)


def test_flat_triangles_have_no_normal():
    normals, areas = normals_and_areas(np.array([[[0, 0, 0], [1, 1, 1], [3, 3, 3.0]]]))
    assert not normals.any()
    assert not areas.any()


def test_twins_share_the_side():
    _, f = meshes.torus(12, 6)
    for j, beyond in enumerate(twins(f, f.max() + 1).T):
        for a, b, other in zip(f[:, j], f[:, (j + 1) % 3], f[beyond].tolist(), strict=True):
            assert (b, a) in zip(other, other[1:] + other[:1], strict=True)


@pytest.mark.parametrize("tol", [None, 0.02])
def test_distances_to_meshes_are_meshed_as_they_are(tol):
    ball = il.sdf.mesh(il.fields.translate(il.fields.sphere(0.9), (0.3, -0.2, 0.1)), 0.15)
    again = il.sdf.mesh(MeshDistance(ball), 0.11, tol=tol)
    assert again.is_watertight
    assert again.volume == pytest.approx(ball.volume, rel=0.02)
    with pytest.raises(InputError, match="solid must be a field"):
        il.sdf.mesh(lambda x: x[:, 0], 0.1)
