"""Mesh files: round trips, files of other writers, and damaged files."""

import random
import re
import struct
import time
import tracemalloc
import warnings

import meshes
import numpy as np
import pytest
import pyvista as pv
import trimesh
import wounds

import ilattice as il
from ilattice.errors import FormatError, PrecisionWarning
from ilattice.io import _polygons, registry
from ilattice.mesh import SurfaceMesh

ENDINGS = sorted(registry.READERS)
COUNT = 1200
QUADS = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]


@pytest.fixture
def ring():
    return SurfaceMesh(*meshes.torus(12, 6))


def triangles(mesh):
    """Corners of all triangles, whatever their numbers."""
    return np.asarray(mesh.vertices)[mesh.faces]


def written(tmp_path, ending, content):
    path = tmp_path / f"a{ending}"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


# --- whole files ------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", ENDINGS)
def test_what_is_saved_is_loaded(ring, tmp_path, ending):
    ring.save(tmp_path / f"a{ending.upper()}")
    other = il.mesh.load(tmp_path / f"a{ending.upper()}")
    assert isinstance(other, SurfaceMesh)
    tol = 1e-6 if ending == ".stl" else 0
    np.testing.assert_allclose(triangles(other), triangles(ring), rtol=0, atol=tol)
    assert len(other.vertices) == len(ring.vertices)
    assert other.is_watertight
    assert other.genus == 1


@pytest.mark.parametrize("ending", [".off", ".obj", ".ply"])
def test_faces_keep_their_numbers(ring, tmp_path, ending):
    ring.save(tmp_path / f"a{ending}")
    np.testing.assert_array_equal(SurfaceMesh.load(tmp_path / f"a{ending}").faces, ring.faces)


@pytest.mark.parametrize("ending", [".obj", ".ply", ".stl"])
@pytest.mark.parametrize("binary", [True, False])
def test_files_of_vtk(ring, tmp_path, ending, binary):
    ring.to_pyvista().save(
        tmp_path / f"a{ending}", **({} if ending == ".obj" else {"binary": binary})
    )
    other = il.mesh.load(tmp_path / f"a{ending}")
    np.testing.assert_allclose(triangles(other), triangles(ring), rtol=0, atol=1e-5)
    assert other.is_watertight


@pytest.mark.parametrize("options", [{"encoding": "ascii"}, {"vertex_normal": True}])
def test_ply_files_of_trimesh(ring, tmp_path, options):
    path = written(tmp_path, ".ply", trimesh.exchange.ply.export_ply(ring.to_trimesh(), **options))
    np.testing.assert_allclose(triangles(il.mesh.load(path)), triangles(ring), rtol=0, atol=1e-6)


@pytest.mark.parametrize("kind", ["stl_ascii", "off", "obj"])
def test_text_files_of_trimesh(ring, tmp_path, kind):
    ring.to_trimesh().export(tmp_path / "a", file_type=kind)
    other = il.mesh.load(tmp_path / "a", format=kind[:3])
    np.testing.assert_allclose(triangles(other), triangles(ring), rtol=0, atol=1e-6)
    assert other.is_watertight


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("mixed", [False, True])
def test_ply_of_both_byte_orders_with_foreign_columns(tmp_path, order, mixed):
    v, _ = meshes.cube()
    polygons = [*QUADS[:5], [1, 3, 7], [1, 7, 5]] if mixed else QUADS
    name = "little" if order == "<" else "big"
    head = (
        f"ply\nformat binary_{name}_endian 1.0\ncomment by hand\nelement note 2\n"
        "property list uchar short words\nelement vertex 8\nproperty uchar red\n"
        "property float x\nproperty double t\nproperty float y\nproperty float z\n"
        f"element face {len(polygons)}\nproperty short label\n"
        "property list uint16 uint32 vertex_index\nproperty float32 area\nend_header\n"
    )
    body = struct.pack(f"{order}Bhh", 2, 7, 8) + struct.pack(f"{order}B", 0)
    for x, y, z in v:
        body += struct.pack(f"{order}Bfdff", 9, x, 0.5, y, z)
    for p in polygons:
        body += struct.pack(f"{order}hH{len(p)}If", -1, len(p), *p, 0.25)
    mesh = il.mesh.load(written(tmp_path, ".ply", head.encode() + body))
    assert mesh.vertices.dtype == np.float32
    np.testing.assert_array_equal(mesh.vertices, v)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(1)
    assert len(mesh.faces) == 12


def test_polygons_of_obj_and_off(tmp_path):
    v, _ = meshes.cube()
    rows = "".join(f"v {x} {y} {z} 1.0\n" for x, y, z in v)
    faces = "".join("f " + " ".join(f"{i - 8}//1" for i in q) + "\n" for q in QUADS[:3])
    faces += "".join("f " + " ".join(f"{i + 1}/2/3" for i in q[:2]) + " \\\n" for q in QUADS[3:4])
    faces += " ".join(f"{i + 1}" for i in QUADS[3][2:]) + " # end\n"
    faces += "".join("f " + " ".join(f"{i + 1}" for i in q) + "\r\n" for q in QUADS[4:])
    obj = f"# cube\nmtllib a.mtl\no cube\n{rows}vt 0 0\nvn 0 0 1\ns off\n{faces}l 1 2\n"
    off = "COFF # cube\n\n8 6 12\n" + "".join(f"{x} {y} {z} 255 0 0\n" for x, y, z in v)
    off += "".join("4 " + " ".join(map(str, q)) + " 0.5 0.5 0.5\n" for q in QUADS)
    for ending, text in ((".obj", obj), (".off", off), (".off", off.replace("# cube\n\n", ""))):
        mesh = il.mesh.load(written(tmp_path, ending, text))
        np.testing.assert_array_equal(mesh.vertices, v)
        assert mesh.is_watertight
        assert mesh.volume == pytest.approx(1)


def test_stl_text_of_any_shape(tmp_path):
    v, f = meshes.cube()
    text = "\n SOLID part\n"
    for a, b, c in v[f].tolist():
        loop = " ".join("VERTEX " + " ".join(map(repr, p)) for p in (a, b, c))
        text += f"facet normal 0 0 0 OUTER  LOOP {loop} endloop endfacet\n"
    mesh = il.mesh.load(written(tmp_path, ".stl", text + "endsolid part\n"))
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(1)


def test_binary_stl_may_call_itself_solid(ring, tmp_path):
    ring.save(tmp_path / "a.stl")
    data = (tmp_path / "a.stl").read_bytes()
    mesh = il.mesh.load(written(tmp_path, ".stl", b"solid" + data[5:]))
    assert len(mesh.faces) == len(ring.faces)


def test_points_are_welded_in_their_order():
    points = np.array([[2, 0, 0], [1, 5, 0], [2, 0, -0.0], [0, 0, 0], [1, 5, 0.0]])
    vertices, number = _polygons.welded(points)
    np.testing.assert_array_equal(vertices, [[2, 0, 0], [1, 5, 0], [0, 0, 0]])
    np.testing.assert_array_equal(number, [0, 1, 0, 2, 1])
    assert not np.signbit(vertices).any()


def test_polygons_become_fans():
    sizes, corners = np.array([3, 2, 4, 0]), np.arange(9)
    found = np.concatenate(list(_polygons.fans(sizes, corners)))
    assert found.tolist() == [[0, 1, 2], [5, 6, 7], [5, 7, 8]]
    assert _polygons.count_triangles(sizes) == 3


def test_polygons_of_any_size_become_fans_in_blocks(monkeypatch):
    rng = np.random.default_rng(5)
    sizes = rng.integers(0, 30, 400)
    corners = rng.integers(0, 99, sizes.sum())
    parts = np.split(corners, np.cumsum(sizes)[:-1])
    expected = [[p[0], p[i], p[i + 1]] for p in parts for i in range(1, len(p) - 1)]
    for block in (7, 1 << 16):
        monkeypatch.setattr(_polygons, "_BLOCK", block)
        found = np.concatenate(list(_polygons.fans(sizes, corners)))
        np.testing.assert_array_equal(found, expected)


def test_collapsed_triangles_are_dropped_with_a_warning(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 1 3\n"
    with pytest.warns(PrecisionWarning, match="1 of 2 triangles") as caught:
        mesh = il.mesh.load(written(tmp_path, ".obj", text))
    assert caught[0].filename == __file__
    assert mesh.faces.tolist() == [[0, 1, 2]]


def test_a_part_from_a_file_is_a_field(tmp_path):
    SurfaceMesh(*meshes.cube()).save(tmp_path / "part.stl")
    field = il.sdf.MeshDistance(il.mesh.load(tmp_path / "part.stl"), strict=True)
    np.testing.assert_allclose(field([[0.5, 0.5, 0.75], [0.5, 0.5, 3]]), [-0.25, 2])


# --- damaged files ----------------------------------------------------------------------------

PLY = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(f"property float {c}\n" for c in "xyz")
FACE = "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
AFTER = FACE.replace("end_header", "element edge 2\nproperty int a\nend_header")
POINTS = "0 0 0\n1 0 0\n0 1 0\n"


@pytest.mark.parametrize(
    ("ending", "text", "message"),
    [
        (".obj", "v 0 0\n", "line 1: found '0 0'; expected coordinates"),
        (".obj", "v 0 0 nan\n", "line 1: .*expected coordinates"),
        (".obj", "v 0 0 0\nf 1 2 0\n", "line 2: found '0'; expected a corner"),
        (".obj", "v 0 0 0\nf 1 2 3\n", r"triangle 0 has the corners \[0, 1, 2\]"),
        (".obj", "v 0 0 0\n", "holds no triangles"),
        (".obj", "v 0 0 0\nf 1 1 1\n", "holds no triangles"),
        (".off", "", "expected 'OFF'"),
        (".off", "OFF BINARY\n", "only the text form"),
        (".off", "OFF\n3 1\n" + POINTS, "as many lines"),
        (".off", "OFF\n3 -1 0\n" + POINTS, "as many lines"),
        (".off", "OFF\n3 1 0\n" + POINTS + "3 0 1\n", "line 6: expected 3 corners"),
        (".off", "OFF\n3 1 0\n" + POINTS + "3 0 1 x\n", "line 6: .*expected corners"),
        (".ply", "plx\n", "has no header"),
        (".ply", PLY.replace("ascii", "asci") + FACE, "line 2"),
        (".ply", PLY.replace("float x", "float w") + FACE + POINTS + "3 0 1 2\n", "x, y and z"),
        (".ply", PLY.replace("format", "comment") + FACE + POINTS, "no known format"),
        (".ply", PLY + FACE.replace("indices", "list") + POINTS + "3 0 1 2\n", "has no faces"),
        (".ply", PLY + FACE.replace("int v", "float v") + POINTS + "3 0 1 2\n", "whole numbers"),
        (".ply", PLY + FACE + POINTS + "3 0 1 2.5\n", "line 13: found '2.5' in 'face'"),
        (".ply", PLY + FACE + POINTS + "-1 0 1 2\n", "13: .*'-1' in 'face'; expected the length"),
        (".ply", PLY + FACE + POINTS + "3 0 1 2\n3 0 2 1\n", "line 14: holds more than"),
        (".ply", PLY + FACE + POINTS + "3 0 1 2\nx\n", "line 14: holds more than"),
        (".ply", PLY + AFTER + POINTS + "3 0 1 2\n7\n8.5\n", "line 17: found '8.5' in 'edge'"),
        (".ply", PLY + AFTER + POINTS + "3 0 1 2\n7\n", "claims 2 of 'edge', more than fit"),
        (".ply", PLY + PLY[21:] + FACE + POINTS, "twice"),
        (".ply", PLY + FACE + POINTS + "3 0 1\n", "ends within 'face'"),
        (".ply", PLY.replace("vertex 3", "vertex 9") + FACE + POINTS, "more than fit"),
        (".ply", PLY + FACE + POINTS.replace("1 0 0", "1 inf 0") + "3 0 1 2\n", "'inf'"),
        (".stl", "x" * 200, "cut short"),
        (".stl", "solid\nfacet\nouter loop\nvertex 0 0 0\nendloop", "line 3: .*three vertices"),
        (".stl", "solid outer loop" + " vertex 0 0 x" * 3 + " endloop", "'x'"),
        (".stl", "solid a\nendsolid a\n", "holds no triangles"),
    ],
)  # fmt: skip
def test_errors_say_where_and_what(tmp_path, ending, text, message):
    path = written(tmp_path, ending, text)
    with pytest.raises(FormatError, match=message) as error:
        il.mesh.load(path)
    assert path.name in str(error.value)


def test_binary_coordinates_must_be_finite(ring, tmp_path):
    for ending, at in ((".stl", 84 + 16), (".ply", -1 - 13 * len(ring.faces) - 8)):
        ring.save(tmp_path / f"a{ending}")
        data = bytearray((tmp_path / f"a{ending}").read_bytes())
        data[at : at + 8] = b"\xff" * 8
        with pytest.raises(FormatError, match="nan"):
            il.mesh.load(written(tmp_path, ending, bytes(data)))


@pytest.mark.parametrize("order", "<>")
def test_binary_files_hold_what_their_headers_claim(tmp_path, order):
    """Also after the faces: what is cut short there, or goes on, is a damaged file."""
    name = {"<": "little", ">": "big"}[order]
    head = (PLY + AFTER).replace("format ascii", f"format binary_{name}_endian").encode()
    body = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], order + "f4").tobytes() + b"\3"
    body += np.array([0, 1, 2, 7, 8], order + "i4").tobytes()
    mesh = il.mesh.load(written(tmp_path, ".ply", head + body + b" \r\n"))
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2]])
    for damaged, message in (
        (body[:-1], "more than fit|ends within"),
        (body[:-8], "more than fit|ends within"),
        (body + b"\0", "1 bytes more than its header"),
    ):
        with pytest.raises(FormatError, match=message):
            il.mesh.load(written(tmp_path, ".ply", head + damaged))


def test_unknown_endings_are_refused(tmp_path):
    with pytest.raises(FormatError, match=r"\.obj, \.off, \.ply, \.stl"):
        il.mesh.load(tmp_path / "a.step")
    with pytest.raises(FormatError, match="cannot be read"):
        il.mesh.load(tmp_path / "missing.stl")


def seeds(ending, tmp_path):
    """Small good files of one format."""
    mesh = SurfaceMesh(*meshes.cube())
    mesh.save(tmp_path / f"seed{ending}")
    out = [(tmp_path / f"seed{ending}").read_bytes()]
    if ending == ".stl":
        out.append(trimesh.exchange.stl.export_stl_ascii(mesh.to_trimesh()).encode())
    if ending == ".ply":
        for binary in (True, False):
            mesh.to_pyvista().save(tmp_path / "seed.ply", binary=binary)
            out.append((tmp_path / "seed.ply").read_bytes())
        little = out[0].partition(b"end_header\n")
        records = np.frombuffer(little[2][: 8 * 24], "<f8").astype(">f8").tobytes()
        faces = np.frombuffer(little[2][8 * 24 :], [("n", "u1"), ("c", "<i4", 3)])
        swapped = faces.astype([("n", "u1"), ("c", ">i4", 3)]).tobytes()
        head = little[0].replace(b"little", b"big")
        out.append(head + little[1] + records + swapped)
    return out


def attempt(path):
    """The mesh, or the `FormatError`; any other error is passed on."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PrecisionWarning)
            return il.mesh.load(path)
    except FormatError as e:
        return e


@pytest.mark.parametrize("ending", ENDINGS)
def test_damaged_files(tmp_path, ending):
    rng = random.Random(f"ilattice {ending}")
    good = seeds(ending, tmp_path)
    for data in good:
        assert attempt(written(tmp_path, ending, data)).is_watertight
    refused = slowest = 0.0
    for _ in range(COUNT):
        path = written(tmp_path, ending, wounds.mutated(rng.choice(good), rng))
        start = time.process_time()
        outcome = attempt(path)
        slowest = max(slowest, time.process_time() - start)
        if isinstance(outcome, FormatError):
            assert path.name in str(outcome)
            refused += 1
        else:
            assert len(SurfaceMesh(outcome.vertices, outcome.faces).faces) > 0
    assert slowest < 2.0
    assert COUNT / 4 < refused < COUNT


@pytest.mark.parametrize("ending", ENDINGS)
def test_claims_take_no_memory(tmp_path, ending):
    good = seeds(ending, tmp_path)
    tracemalloc.start()
    for data in good:
        for claim in (b"1000000000000", b"999999999", b"2000000"):
            for m in re.finditer(rb"(?<![\w.])\d+(?![\w.])", data):
                attempt(written(tmp_path, ending, data[: m.start()] + claim + data[m.end() :]))
        for at in range(0, len(data) - 4, 5):
            claim = b"\xff\xff\xff\x7f"
            attempt(written(tmp_path, ending, data[:at] + claim + data[at + 4 :]))
    assert tracemalloc.get_traced_memory()[1] < 4e6
    tracemalloc.stop()


@pytest.mark.parametrize(
    ("ending", "text"),
    [
        (".obj", "f " * 100_000),
        (".obj", "v 0 0 0\n" * 100_000),
        (".off", "OFF\n" + "# \n" * 100_000),
        (".stl", "solid" + " outer loop" * 50_000),
        (".stl", "solid" + " outer" * 100_000),
        (".ply", "ply\n" + "comment\n" * 100_000),
        (
            ".ply",
            "ply\nformat ascii 1.0\n" + "element vertex 1000000000\n" * 20_000 + "end_header\n",
        ),
        (".ply", "ply\n" + "end_header" * 100_000),
    ],
)
def test_long_nonsense_ends_soon(tmp_path, ending, text):
    path = written(tmp_path, ending, text)
    start = time.process_time()
    assert isinstance(attempt(path), FormatError)
    assert time.process_time() - start < 3.0


def test_vtk_reads_the_same(ring, tmp_path):
    ring.save(tmp_path / "a.ply")
    theirs = pv.read(tmp_path / "a.ply")
    ours = il.mesh.load(tmp_path / "a.ply")
    np.testing.assert_allclose(ours.vertices, theirs.points, rtol=0, atol=1e-6)
