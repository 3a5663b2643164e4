"""Meshes that arrive in blocks give the same files as whole ones."""

import meshes
import numpy as np
import psutil
import pytest

from ilattice import io
from ilattice.errors import FormatError, GeometryError, InputError, PrecisionWarning
from ilattice.io import ply
from ilattice.mesh import SurfaceMesh

VERTICES, FACES = meshes.torus(24, 12)


def slabs(vertices=VERTICES, faces=FACES, width=48):
    """Blocks of vertices; each brings the faces that it completes."""
    done = np.zeros(len(faces), bool)
    for lo in range(0, len(vertices), width):
        ready = (faces < lo + width).all(axis=1) & ~done
        done |= ready
        yield vertices[lo : lo + width], faces[ready]


def in_order_of_slabs():
    return np.concatenate([faces for _, faces in slabs()])


def test_streamed_stl_equals_the_whole_one(tmp_path):
    """The ring closes: its last faces name vertices of the first block."""
    SurfaceMesh(VERTICES, in_order_of_slabs()).save(tmp_path / "whole.stl")
    counts = io.write_stream(tmp_path / "a.stl", slabs())
    assert counts == (len(VERTICES), len(FACES))
    assert (tmp_path / "a.stl").read_bytes() == (tmp_path / "whole.stl").read_bytes()


def test_streamed_ply_equals_the_whole_one_but_for_its_header(tmp_path):
    SurfaceMesh(VERTICES, in_order_of_slabs()).save(tmp_path / "whole.ply")
    io.write_stream(tmp_path / "a.ply", slabs())
    streamed, whole = ((tmp_path / f"{n}.ply").read_bytes() for n in ("a", "whole"))
    (head, body), (other_head, other_body) = (
        raw.split(b"end_header\n", 1) for raw in (streamed, whole)
    )
    assert body == other_body
    lines, other = (
        [x for x in h.decode().splitlines() if not x.startswith("comment")]
        for h in (head, other_head)
    )
    assert lines == other


def test_streamed_ply_keeps_point_data(tmp_path):
    import pyvista as pv
    import trimesh

    with io.StreamedMeshWriter(tmp_path / "a.ply", precision="single") as writer:
        for vertices, faces in slabs():
            data = dict(zip("rgb", (vertices.T + 3) / 6, strict=True))
            writer.append(vertices, faces, data | {"height": vertices[:, 2]})
    assert (writer.vertex_count, writer.face_count) == (len(VERTICES), len(FACES))
    mesh = trimesh.load_mesh(tmp_path / "a.ply", process=False, maintain_order=True)
    assert mesh.is_watertight
    np.testing.assert_allclose(mesh.vertices, VERTICES, rtol=1e-6, atol=1e-7)
    shown = np.rint(np.clip((VERTICES + 3) / 6, 0, 1) * 255)
    np.testing.assert_array_equal(pv.read(tmp_path / "a.ply").point_data["RGB"], shown)


def test_faces_must_name_vertices_that_are_there(tmp_path):
    (tmp_path / "a.stl").write_text("old")
    with pytest.raises(InputError, match="names vertex 288, there are 288 so far"):
        io.write_stream(tmp_path / "a.stl", [(VERTICES, FACES + 1)])
    with pytest.raises(InputError, match="names vertex -1"):
        io.write_stream(tmp_path / "a.ply", [(VERTICES, FACES - 1)])
    assert (tmp_path / "a.stl").read_text() == "old"
    assert len(list(tmp_path.iterdir())) == 1


def test_wrong_calls_are_refused(tmp_path):
    with pytest.raises(FormatError, match=r"\.stl or \.ply"):
        io.StreamedMeshWriter(tmp_path / "a.obj")
    with pytest.raises(InputError, match="single precision"):
        io.StreamedMeshWriter(tmp_path / "a.stl", precision="double")
    with pytest.raises(InputError, match="inside of 'with"):
        io.StreamedMeshWriter(tmp_path / "a.stl").append(VERTICES, FACES)
    with pytest.raises(InputError, match=r"vertices must have shape"):
        io.write_stream(tmp_path / "a.stl", [(VERTICES.ravel(), FACES)])
    with (
        pytest.raises(InputError, match="no point data"),
        io.StreamedMeshWriter(tmp_path / "a.stl") as writer,
    ):
        writer.append(VERTICES, FACES, {"a": VERTICES})
    writer = io.StreamedMeshWriter(tmp_path / "a.ply")
    with writer:
        writer.append(VERTICES, FACES)
        with pytest.raises(InputError, match="names and types of the first block"):
            writer.append(VERTICES, FACES, {"a": VERTICES})
    (tmp_path / "a.ply").unlink()
    with (
        pytest.raises(InputError, match=r"has 287 rows for 288"),
        io.StreamedMeshWriter(tmp_path / "a.ply") as writer,
    ):
        writer.append(VERTICES, FACES, {"a": VERTICES[1:]})
    with (
        pytest.raises(InputError, match="too many or too long names"),
        io.StreamedMeshWriter(tmp_path / "a.ply") as writer,
    ):
        writer.append(VERTICES, FACES, {"a" * 5000: VERTICES})
    with pytest.raises(GeometryError, match="no triangles"):
        io.write_stream(tmp_path / "a.ply", [])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("ending", [".stl", ".ply"])
def test_an_interrupt_between_blocks_leaves_the_old_file(tmp_path, ending):
    (tmp_path / f"a{ending}").write_text("old")

    def interrupted():
        yield VERTICES, FACES
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        io.write_stream(tmp_path / f"a{ending}", interrupted())
    assert (tmp_path / f"a{ending}").read_text() == "old"
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("ending", [".stl", ".ply"])
def test_a_full_disk_between_blocks_is_told(tmp_path, ending):
    def full():
        yield VERTICES, FACES
        raise OSError(28, "No space left on device")

    with pytest.raises(FormatError, match="disk is full"):
        io.write_stream(tmp_path / f"a{ending}", full())
    assert list(tmp_path.iterdir()) == []


def test_a_block_may_be_reused_by_its_producer(tmp_path):
    """STL keeps copies of the latest vertices."""
    buffer = np.empty((len(VERTICES) // 2, 3), np.float32)

    def halves():
        buffer[:] = VERTICES[: len(buffer)]
        yield buffer, np.zeros((0, 3), int)
        buffer[:] = VERTICES[len(buffer) :]
        yield buffer, FACES

    io.write_stream(tmp_path / "a.stl", halves())
    SurfaceMesh(VERTICES, FACES).save(tmp_path / "whole.stl")
    assert (tmp_path / "a.stl").read_bytes() == (tmp_path / "whole.stl").read_bytes()


def test_streamed_stl_tells_of_collapsed_triangles(tmp_path):
    vertices, faces = meshes.cube((1e6, 0.0, 0.0), 1e-3)
    with pytest.warns(PrecisionWarning, match="8 triangles collapse"):
        io.write_stream(tmp_path / "a.stl", [(vertices, faces)])


@pytest.mark.parametrize("ending", [".stl", ".ply"])
def test_memory_does_not_grow_with_the_number_of_blocks(tmp_path, ending):
    vertices, faces = meshes.torus(250, 100)
    process = psutil.Process()
    peaks = []

    def many(n):
        for i in range(n):
            yield vertices, faces + i * len(vertices)
            peaks.append(process.memory_info().rss)

    io.write_stream(tmp_path / f"a{ending}", many(40))
    written = (tmp_path / f"a{ending}").stat().st_size
    assert written > 5e7
    assert max(peaks) - peaks[2] < 0.2 * written


def test_header_can_hold_the_largest_counts():
    vertex, face = ply.VertexRecords(VERTICES, {}, None), ply.FaceRecords()
    sizes = {len(ply.header(vertex.dtype, n, face.dtype, 2 * n, 4096)) for n in (1, 2**31 - 1)}
    assert sizes == {4096}
