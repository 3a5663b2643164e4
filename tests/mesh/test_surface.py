"""`SurfaceMesh` against shapes with known measures, reference implementations and trimesh."""

import pickle

import meshes
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ilattice.errors import GeometryError, InputError
from ilattice.mesh import SurfaceMesh, measure


def mesh_of(*parts):
    return SurfaceMesh(*meshes.joined(*parts))


# --- reference implementations ----------------------------------------------------------------


def naive_edges(faces):
    """Dictionary: undirected edge -> list of (face, direction)."""
    edges = {}
    for f, corners in enumerate(faces.tolist()):
        for j in range(3):
            a, b = corners[j], corners[(j + 1) % 3]
            edges.setdefault((min(a, b), max(a, b)), []).append((f, a < b))
    return edges


def naive_fans(faces):
    """Number of groups of faces around each vertex that hang together by edges at the vertex."""
    fans = 0
    for v in np.unique(faces):
        near = [f for f in range(len(faces)) if v in faces[f]]
        links = [
            (i, j)
            for i, f in enumerate(near)
            for j, g in enumerate(near)
            if len(set(faces[f]) & set(faces[g])) >= 2
        ]
        i, j = np.array(links).T
        fans += connected_components(coo_array((np.ones(len(i)), (i, j)), [len(near)] * 2))[0]
    return fans


def naive_topology(faces):
    edges = naive_edges(faces)
    pairs = [(f, g) for uses in edges.values() for f, _ in uses for g, _ in uses]
    f, g = np.array(pairs).T
    graph = coo_array((np.ones(len(f)), (f, g)), shape=[len(faces)] * 2)
    components, labels = connected_components(graph)
    counts = [len(uses) for uses in edges.values()]
    return measure.Topology(
        vertices=len(np.unique(faces)),
        edges=len(edges),
        faces=len(faces),
        open_edges=sum(n == 1 for n in counts),
        nonmanifold_edges=sum(n > 2 for n in counts),
        twisted_edges=sum(
            len(uses) > 1 and 2 * sum(up for _, up in uses) != len(uses) for uses in edges.values()
        ),
        fans=naive_fans(faces),
        components=components,
        labels=labels,
    )


def naive_quality(vertices, faces):
    out = []
    for a, b, c in vertices[faces]:
        area = 0.5 * np.linalg.norm(np.cross(b - a, c - a))
        squares = sum(np.sum(side**2) for side in (b - a, c - b, a - c))
        out.append(4 * np.sqrt(3) * area / squares)
    return np.array(out)


@st.composite
def triangle_soups(draw):
    """Faces on few vertices: open, crowded and twisted edges, pinched vertices."""
    n = draw(st.integers(3, 8))
    corner = st.lists(st.integers(0, n - 1), min_size=3, max_size=3, unique=True)
    return n, np.array(draw(st.lists(corner, min_size=1, max_size=24)))


@given(triangle_soups())
def test_topology_equals_its_reference_implementation(soup):
    n, faces = soup
    fast, naive = measure.topology(faces, n), naive_topology(faces)
    assert fast[:-1] == naive[:-1]
    np.testing.assert_array_equal(fast.labels, naive.labels)


@given(triangle_soups())
def test_faulty_edges_are_those_without_two_faces(soup):
    n, faces = soup
    naive = {edge for edge, uses in naive_edges(faces).items() if len(uses) != 2}
    fast = measure.faulty_edges(faces, n)
    assert {(min(e), max(e)) for e in fast.tolist()} == naive
    assert len(fast) == len(naive)


def test_vertices_of_many_faces_take_the_long_sort():
    """Bipyramid: the two tips, one of them vertex 0, belong to 200 faces each."""
    n = 200
    rim = 1 + np.arange(n)
    following = 1 + (np.arange(n) + 1) % n
    top = np.stack([np.zeros(n, int), rim, following], axis=1)
    bottom = np.stack([np.full(n, n + 1), following, rim], axis=1)
    faces = np.random.default_rng(0).permutation(np.concatenate([top, bottom]))
    t = measure.topology(faces, n + 2)
    assert t[:-1] == (n + 2, 3 * n, 2 * n, 0, 0, 0, n + 2, 1)


# --- measures ---------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [(float, int), (np.float32, np.int32)])
def test_cube_has_its_measures_in_both_precisions(kind):
    vertices, faces = meshes.cube((3.0, -2.0, 1.0), 2.0)
    mesh = SurfaceMesh(vertices.astype(kind[0]), faces.astype(kind[1]))
    assert mesh.vertices.dtype == kind[0]
    assert mesh.faces.dtype == kind[1]
    assert mesh.volume == pytest.approx(8.0, rel=1e-15)
    assert mesh.area == pytest.approx(24.0, rel=1e-15)
    np.testing.assert_array_equal(mesh.bounds, [[3, -2, 1], [5, 0, 3]])
    assert (mesh.euler, mesh.genus, mesh.components) == (2, 0, 1)
    np.testing.assert_allclose(mesh.quality, np.sqrt(3) / 2, rtol=1e-15)


def test_volume_and_area_converge_to_those_of_the_torus():
    volume, area = 2 * np.pi**2 * 2.0 * 0.7**2, 4 * np.pi**2 * 2.0 * 0.7
    errors = []
    for n in (32, 64, 128):
        mesh = SurfaceMesh(*meshes.torus(n, n // 2))
        errors.append([1 - mesh.volume / volume, 1 - mesh.area / area])
    rates = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(rates, 2.0, atol=0.05)
    assert np.abs(errors[-1]).max() < 2.1e-3


def test_measures_agree_with_trimesh():
    mesh = SurfaceMesh(*meshes.torus())
    other = mesh.to_trimesh()
    assert mesh.volume == pytest.approx(other.volume, rel=1e-12)
    assert mesh.area == pytest.approx(other.area, rel=1e-12)
    assert mesh.euler == other.euler_number


def test_volume_far_from_the_origin_keeps_its_digits():
    vertices, faces = meshes.torus()
    far = vertices + 1e8
    near = far - far[0]  # exact, as the numbers are alike
    volumes = [SurfaceMesh(v, faces).volume for v in (far, near)]
    assert volumes[0] == pytest.approx(volumes[1], rel=1e-13)


def test_single_precision_meshes_are_measured_in_double():
    vertices, faces = meshes.torus()
    narrow = (vertices + 100.0).astype(np.float32)
    single, double = SurfaceMesh(narrow, faces), SurfaceMesh(narrow.astype(float), faces)
    assert single.volume == pytest.approx(double.volume, rel=1e-13)
    assert single.area == pytest.approx(double.area, rel=1e-13)
    np.testing.assert_allclose(single.quality, double.quality, rtol=1e-13)


def test_inward_faces_have_negative_volume():
    vertices, faces = meshes.cube()
    assert SurfaceMesh(vertices, faces[:, ::-1]).volume == pytest.approx(-1.0)


def test_quality_equals_its_reference_implementation():
    rng = np.random.default_rng(1)
    vertices, faces = rng.normal(size=(50, 3)), np.arange(48).reshape(16, 3)
    mesh = SurfaceMesh(vertices, faces)
    np.testing.assert_allclose(mesh.quality, naive_quality(vertices, faces), rtol=1e-12)
    assert mesh.quality.max() <= 1.0


def test_quality_of_degenerate_triangles_is_zero():
    line = SurfaceMesh(np.array([[0.0, 0, 0], [1, 0, 0], [3, 0, 0]]), [[0, 1, 2]])
    point = SurfaceMesh(np.zeros((3, 3)), [[0, 1, 2]])
    assert line.quality[0] == point.quality[0] == 0.0


# --- topology ---------------------------------------------------------------------------------


def test_genus_adds_up_over_components():
    far = meshes.cube((10.0, 0, 0))
    ring = meshes.torus()
    mesh = mesh_of(ring, meshes.sphere(), far, ring)
    assert (mesh.components, mesh.genus, mesh.euler) == (4, 2, 4)
    sizes = [len(ring[1]), 512, 12, len(ring[1])]
    np.testing.assert_array_equal(mesh.component_labels, np.repeat(np.arange(4), sizes))


def test_open_mesh_counts_its_open_edges_and_has_no_volume():
    vertices, faces = meshes.cube()
    mesh = SurfaceMesh(vertices, faces[1:])
    assert (mesh.open_edges, mesh.nonmanifold_edges) == (3, 0)
    assert not mesh.is_watertight
    assert mesh.is_oriented
    assert {frozenset(e) for e in mesh.faulty_edges().tolist()} == {
        frozenset(e) for e in ((0, 2), (2, 3), (3, 0))
    }
    with pytest.raises(GeometryError, match="3 open edges encloses no volume"):
        _ = mesh.volume
    with pytest.raises(GeometryError, match="closed oriented surface"):
        _ = mesh.genus
    assert mesh.area == pytest.approx(5.5)


def test_two_cubes_glued_along_an_edge_are_not_manifold():
    vertices, faces = meshes.joined(meshes.cube(), meshes.cube((1.0, 1.0, 0.0)))
    faces[faces == 8] = 3
    faces[faces == 12] = 7
    mesh = SurfaceMesh(vertices, faces)
    assert (mesh.open_edges, mesh.nonmanifold_edges, mesh.components) == (0, 1, 1)
    assert not mesh.is_watertight
    np.testing.assert_array_equal(np.sort(mesh.faulty_edges()), [[3, 7]])


def test_two_cubes_that_touch_in_a_vertex_are_two_parts_of_genus_zero():
    vertices, faces = meshes.joined(meshes.cube(), meshes.cube((1.0, 1.0, 1.0)))
    faces[faces == 8] = 7
    mesh = SurfaceMesh(vertices, faces)
    assert mesh.is_watertight
    assert (mesh.nonmanifold_vertices, mesh.components, mesh.genus) == (1, 2, 0)
    assert mesh.euler == 3


def test_a_flipped_face_is_noticed():
    vertices, faces = meshes.cube()
    faces[4] = faces[4, ::-1]
    mesh = SurfaceMesh(vertices, faces)
    assert mesh.is_watertight
    assert not mesh.is_oriented
    assert mesh.topology.twisted_edges == 3
    with pytest.raises(GeometryError, match="3 wrongly oriented"):
        _ = mesh.genus


def test_an_empty_mesh_is_allowed_but_not_watertight():
    mesh = SurfaceMesh(np.zeros((0, 3)), np.zeros((0, 3), int))
    assert (mesh.euler, mesh.components, mesh.area) == (0, 0, 0.0)
    assert not mesh.is_watertight
    with pytest.raises(GeometryError, match="no bounds"):
        _ = mesh.bounds


# --- door, immutability, verbs ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (np.zeros((4, 2)), [[0, 1, 2]], r"shape \(V, 3\), got \(4, 2\)"),
        ([[0.0, 0, 0], [1, 0, np.nan], [0, 1, 0]], [[0, 1, 2]], "index \\(1, 2\\)"),
        ("abc", [[0, 1, 2]], "array of real numbers"),
        (np.zeros((3, 3)), [[0.0, 1.0, 2.0]], "faces must be integers"),
        (np.zeros((3, 3)), [[0, 1, 2], [0, 1, 3]], "face 1 is"),
        (np.zeros((3, 3)), [[0, 1, 1]], "three different vertices"),
        (np.zeros((3, 3)), [[0, 1, -1]], "face 0 is"),
        (np.zeros((3, 3)), [0, 1, 2], r"shape \(3,\)"),
    ],
)
def test_bad_tables_are_refused(vertices, faces, message):
    with pytest.raises(InputError, match=message):
        SurfaceMesh(vertices, faces)


@pytest.mark.parametrize("data", [{"a": np.zeros(7)}, {"a": "text"}, {1: np.zeros(8)}, [1, 2]])
def test_bad_data_are_refused(data):
    with pytest.raises(InputError, match="point_data"):
        SurfaceMesh(*meshes.cube(), data)


def test_arrays_are_copied_and_read_only():
    vertices, faces = meshes.cube()
    height = vertices[:, 2].copy()
    mesh = SurfaceMesh(vertices, faces, {"height": height})
    vertices[:] = height[:] = faces[:] = 0
    assert mesh.volume == pytest.approx(1.0)
    assert mesh.point_data["height"].max() == 1.0
    with pytest.raises(ValueError, match="read-only"):
        mesh.vertices[0] = 1.0
    with pytest.raises(TypeError, match="item assignment"):
        mesh.point_data["height"] = vertices
    with pytest.raises(AttributeError):
        mesh.faces = faces


def test_adopt_takes_the_arrays_without_a_copy():
    vertices, faces = meshes.cube()
    mesh = SurfaceMesh._adopt(vertices, faces)
    assert mesh.vertices is vertices
    assert not vertices.flags.writeable
    assert mesh.volume == pytest.approx(1.0)


def test_meshes_can_be_sent_to_other_processes():
    mesh = SurfaceMesh(*meshes.cube(), {"a": np.arange(8)}, {"b": np.arange(12)})
    copy = pickle.loads(pickle.dumps(mesh))
    np.testing.assert_array_equal(copy.vertices, mesh.vertices)
    np.testing.assert_array_equal(copy.point_data["a"], np.arange(8))
    np.testing.assert_array_equal(copy.cell_data["b"], np.arange(12))


def test_with_point_data_adds_and_replaces():
    mesh = SurfaceMesh(*meshes.cube(), {"a": np.zeros(8), "b": np.ones(8)})
    assert mesh.euler == 2
    new = mesh.with_point_data(a=np.arange(8), c=np.zeros((8, 3)))
    assert list(new.point_data) == ["a", "b", "c"]
    assert new.point_data["a"][7] == 7
    assert mesh.point_data["a"][7] == 0
    assert new.topology is mesh.topology
    with pytest.raises(InputError, match=r"point_data\['a'\].*\(8,\)"):
        mesh.with_point_data(a=np.zeros(9))


def test_select_keeps_a_component_with_its_data():
    vertices, faces = meshes.joined(meshes.sphere(1), meshes.cube((5.0, 0, 0)))
    mesh = SurfaceMesh(vertices, faces, {"x": vertices[:, 0]}, {"f": np.arange(len(faces))})
    part = mesh.select(mesh.component_labels == 1)
    assert part.volume == pytest.approx(1.0)
    assert len(part.vertices) == 8
    np.testing.assert_array_equal(part.point_data["x"], part.vertices[:, 0])
    np.testing.assert_array_equal(part.cell_data["f"], np.arange(32, 44))
    with pytest.raises(InputError, match="mask of shape"):
        mesh.select([0, 1])


def test_repr_names_sizes_and_data():
    mesh = SurfaceMesh(*meshes.cube(), {"thickness": np.zeros(8)})
    assert repr(mesh) == "SurfaceMesh(8 vertices, 12 faces, data: thickness)"


# --- exits ------------------------------------------------------------------------------------


def test_to_pyvista_and_to_trimesh_keep_everything():
    vertices, faces = meshes.torus(12, 8)
    data = np.arange(len(vertices), dtype=np.float32)
    mesh = SurfaceMesh(vertices, faces, {"a": data}, {"b": faces[:, 0]})
    poly, tri = mesh.to_pyvista(), mesh.to_trimesh()
    np.testing.assert_array_equal(poly.points, vertices)
    np.testing.assert_array_equal(poly.regular_faces, faces)
    np.testing.assert_array_equal(poly.point_data["a"], data)
    np.testing.assert_array_equal(poly.cell_data["b"], faces[:, 0])
    np.testing.assert_array_equal(tri.faces, faces)
    np.testing.assert_array_equal(tri.vertex_attributes["a"], data)
    np.testing.assert_array_equal(tri.face_attributes["b"], faces[:, 0])
    poly.points[:] = 0.0  # a copy: the mesh stays as it is
    assert mesh.area == pytest.approx(tri.area)


def test_screenshot_shows_the_mesh(tmp_path):
    from PIL import Image

    ring = SurfaceMesh(*meshes.torus(), {"height": meshes.torus()[0][:, 2]})
    ring.screenshot(tmp_path / "ring.png", size=(320, 240), view=(0.0, 90.0))
    pixels = np.asarray(Image.open(tmp_path / "ring.png")).astype(int)
    assert pixels.shape == (240, 320, 3)
    filled = (pixels.sum(axis=2) < 3 * 255).mean()
    ring_of_picture = np.pi * (120 / 1.05) ** 2 * (1 - (1.3 / 2.7) ** 2) / (240 * 320)
    assert filled == pytest.approx(ring_of_picture, rel=0.15)
    assert pixels[120, 160].sum() == 3 * 255  # one looks through the hole
    with pytest.raises(InputError, match="height"):
        ring.screenshot(tmp_path / "ring.png", scalars="depth")


@pytest.mark.parametrize(
    ("view", "shown"),
    [("front", "xz"), ("back", "Xz"), ("left", "Yz"), ("right", "yz"), ("top", "xy"),
     ("bottom", "xY")],
)  # fmt: skip
def test_views_are_called_by_name(tmp_path, view, shown):
    """A red, a green and a blue cube far along x, y and z; capitals point left or down."""
    from PIL import Image

    cubes = [meshes.cube(5.0 * np.eye(3)[a] - 0.5) for a in range(3)]
    vertices, faces = (np.concatenate(a) for a in zip(*cubes, strict=True))
    faces += np.repeat(8 * np.arange(3), len(cubes[0][1]))[:, None]
    colours = dict(zip("rgb", np.repeat(np.eye(3), 8, axis=1), strict=True))
    mesh = SurfaceMesh(vertices, faces, colours)
    mesh.screenshot(tmp_path / "a.png", size=(200, 200), view=view, background="black")
    pixels = np.asarray(Image.open(tmp_path / "a.png")).astype(int)
    right, up = ("xyz".index(c.lower()) for c in shown)
    place = []
    for a in (right, up):
        rows, columns = np.nonzero(pixels[..., a] > 2 * np.delete(pixels, a, axis=2).max(axis=2))
        place.append(np.array([columns.mean(), -rows.mean()]))
    away = place[0] - place[1]
    sign = [1 if c.islower() else -1 for c in shown]
    np.testing.assert_allclose(away / np.abs(away), [sign[0], -sign[1]])
    assert abs(away[0] / away[1]) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"view": "above"}, "view must be .* or one of front, back, .*top"),
        ({"view": 3}, "view"),
        ({"view": (0.0, np.nan)}, "view"),
        ({"view": ("a", "b")}, "view"),
        ({"view": [[1], [2, 3]]}, "view"),
        ({"size": -3}, "size"),
        ({"size": (320, 0)}, "size"),
        ({"size": (320.5, 240)}, "size"),
        ({"zoom": 0.0}, "zoom"),
    ],
)
def test_pictures_refuse_what_they_cannot_show(tmp_path, options, message):
    with pytest.raises(InputError, match=message):
        SurfaceMesh(*meshes.cube()).screenshot(tmp_path / "a.png", **options)
    assert not (tmp_path / "a.png").exists()


def test_plot_passes_its_options_on(monkeypatch):
    import pyvista as pv

    seen = {}
    monkeypatch.setattr(pv.Plotter, "show", lambda self, **kw: seen.update(kw, shown=self))
    SurfaceMesh(*meshes.cube()).plot(color="red", cpos="xy", off_screen=True)
    (actor,) = seen.pop("shown").actors.values()
    assert actor.prop.color == "red"
    assert actor.mapper.dataset.n_cells == 12
    assert seen == {"cpos": "xy"}


@pytest.mark.parametrize(
    "spoil",
    [lambda v: v + 1j, lambda v: v > 0, lambda v: np.ma.masked_array(v, mask=v > 0),
     lambda v: v.astype(str)],
)  # fmt: skip
def test_vertices_are_real_numbers_without_masks(spoil):
    """Imaginary parts and masks used to be dropped."""
    vertices = np.array([[0.1, 0, 0], [1, 0.2, 0], [0, 1, 0.3], [0, 0, 1]])
    faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]
    assert SurfaceMesh(vertices, faces).volume > 0
    with pytest.raises(InputError, match="real numbers"):
        SurfaceMesh(spoil(vertices), faces)
