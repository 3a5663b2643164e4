"""Mesh files read back by independent readers, and what must not happen to files on a disk."""

import errno
import io as std_io
import os
import random
import struct
import subprocess
import sys
import time
import warnings
import zipfile
from pathlib import Path

import meshes
import numpy as np
import pytest
import pyvista as pv
import trimesh

import ilattice as il
from ilattice import io
from ilattice.errors import FormatError, GeometryError, InputError, PrecisionWarning
from ilattice.io import _mesh, ply, registry, splines, threemf
from ilattice.mesh import SurfaceMesh

SAVES_KILLED = int(os.environ.get("ILATTICE_KILLS", "3"))
MESH_ENDINGS = [".3mf", ".obj", ".off", ".ply", ".stl", ".vtp"]


@pytest.fixture(scope="module")
def ring():
    """Torus with colours, a scalar, a vector and numbers of its faces."""
    vertices, faces = meshes.torus(24, 12)
    colour = (vertices - vertices.min(0)) / np.ptp(vertices, axis=0)
    data = dict(zip("rgb", colour.T, strict=True))
    data |= {"signed distance": vertices[:, 2] / 3, "normal": vertices * [1, 2, 3]}
    return SurfaceMesh(vertices, faces, data, {"number": np.arange(len(faces))})


def bytes_of_colours(mesh):
    return np.rint(np.stack([mesh.point_data[c] for c in "rgb"], 1) * 255).astype(np.uint8)


def as_float32(a):
    return np.asarray(a).astype(np.float32).astype(np.float64)


# --- formats ----------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", [".stl", ".ply", ".obj", ".off", ".3mf"])
def test_trimesh_reads_a_watertight_mesh_of_the_same_volume(ring, tmp_path, ending):
    ring.save(tmp_path / f"a{ending}")
    other = trimesh.load_mesh(tmp_path / f"a{ending}")
    assert other.is_watertight
    assert other.volume == pytest.approx(ring.volume, rel=1e-6)
    assert (len(other.vertices), len(other.faces)) == (len(ring.vertices), len(ring.faces))


@pytest.mark.parametrize("ending", [".stl", ".ply", ".obj", ".vtp"])
def test_pyvista_reads_the_same_triangles(ring, tmp_path, ending):
    ring.save(tmp_path / f"a{ending.upper()}")
    other = pv.read(tmp_path / f"a{ending.upper()}")
    corners = other.points[other.regular_faces]
    np.testing.assert_allclose(corners, ring.vertices[ring.faces], rtol=1e-6, atol=1e-7)


def test_stl_is_50_bytes_per_triangle_with_outward_normals(tmp_path):
    mesh = SurfaceMesh(*meshes.sphere(2))
    mesh.save(tmp_path / "a.stl")
    raw = (tmp_path / "a.stl").read_bytes()
    assert len(raw) == 84 + 50 * len(mesh.faces)
    assert not raw.startswith(b"solid")
    assert struct.unpack("<I", raw[80:84])[0] == len(mesh.faces)
    numbers = np.frombuffer(raw[84:], dtype=[("f", "<f4", 12), ("attribute", "<u2")])["f"]
    corners = mesh.vertices[mesh.faces]
    np.testing.assert_array_equal(numbers[:, 3:].reshape(-1, 3, 3), corners.astype(np.float32))
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    np.testing.assert_allclose(numbers[:, :3], outward, atol=1e-6)


def test_files_of_several_blocks_equal_files_of_one(ring, tmp_path, monkeypatch):
    for ending in (".stl", ".ply", ".obj", ".off"):
        ring.save(tmp_path / f"one{ending}")
    whole = _mesh.blocks
    for module in ("stl", "ply", "obj", "off"):
        monkeypatch.setattr(f"ilattice.io.{module}.blocks", lambda n, *_: whole(n, 7))
    for ending in (".stl", ".ply", ".obj", ".off"):
        ring.save(tmp_path / f"many{ending}")
        one, many = ((tmp_path / f"{n}{ending}").read_bytes() for n in ("one", "many"))
        assert one == many


def ply_parts(path):
    """Header lines, vertex records and face records; written from the format's description."""
    raw = path.read_bytes()
    end = raw.index(b"end_header\n") + len(b"end_header\n")
    lines = raw[:end].decode("ascii").splitlines()
    kinds = {"uchar": "u1", "short": "<i2", "int": "<i4", "float": "<f4", "double": "<f8"}
    layout, counts = {}, {}
    for words in (line.split() for line in lines):
        if words[0] == "element":
            element = words[1]
            counts[element], layout[element] = int(words[2]), []
        elif words[:2] == ["property", "list"]:
            assert words[2:] == ["uchar", "int", "vertex_indices"]
            layout[element] += [("count", "u1"), ("corners", "<i4", (3,))]
        elif words[0] == "property":
            layout[element].append((words[2], kinds[words[1]]))
    vertex = np.frombuffer(raw, np.dtype(layout["vertex"]), counts["vertex"], end)
    face = np.frombuffer(raw, np.dtype(layout["face"]), counts["face"], end + vertex.nbytes)
    assert end + vertex.nbytes + face.nbytes == len(raw)
    return lines, vertex, face


def test_ply_keeps_all_data_exactly(ring, tmp_path):
    ring.save(tmp_path / "a.ply")
    _, vertex, face = ply_parts(tmp_path / "a.ply")
    for i, name in enumerate("xyz"):
        np.testing.assert_array_equal(vertex[name], ring.vertices[:, i])
        np.testing.assert_array_equal(vertex[f"normal_{i}"], ring.point_data["normal"][:, i])
    for i, name in enumerate(("red", "green", "blue")):
        np.testing.assert_array_equal(vertex[name], bytes_of_colours(ring)[:, i])
    np.testing.assert_array_equal(vertex["signed_distance"], ring.point_data["signed distance"])
    assert (face["count"] == 3).all()
    np.testing.assert_array_equal(face["corners"], ring.faces)
    np.testing.assert_array_equal(face["number"], ring.cell_data["number"])
    assert {"r", "g", "b"}.isdisjoint(vertex.dtype.names)


def test_ply_in_single_precision_is_smaller(ring, tmp_path):
    ring.save(tmp_path / "a.ply", precision="single")
    _, vertex, _ = ply_parts(tmp_path / "a.ply")
    assert vertex.dtype["x"] == vertex.dtype["signed_distance"] == np.float32
    np.testing.assert_array_equal(vertex["x"], ring.vertices[:, 0].astype(np.float32))
    with pytest.raises(InputError, match="precision"):
        ring.save(tmp_path / "b.ply", precision="half")


@pytest.mark.parametrize("names", [("a b", "a_b"), ("x",), ("größe",), ("a_0", "a")])
def test_ply_refuses_names_that_it_cannot_hold(tmp_path, names):
    data = {name: np.zeros((8, 2)) if name == "a" else np.zeros(8) for name in names}
    mesh = SurfaceMesh(*meshes.cube(), data)
    with pytest.raises(InputError, match="rename"):
        mesh.save(tmp_path / "a.ply")


def test_ply_counts_vertices_in_32_bits():
    with pytest.raises(FormatError, match="2147483647 vertices, not 2147483648"):
        ply.check_count(2**31)


def test_trimesh_and_vtk_see_the_colours(ring, tmp_path):
    for ending in (".ply", ".obj"):
        ring.save(tmp_path / f"a{ending}")
        other = trimesh.load_mesh(tmp_path / f"a{ending}", process=False, maintain_order=True)
        shown = other.visual.vertex_colors[:, :3].astype(int)
        assert np.abs(shown - bytes_of_colours(ring)).max() <= 1  # OBJ has four digits
    ring.save(tmp_path / "a.vtp")
    other = pv.read(tmp_path / "a.vtp")
    np.testing.assert_array_equal(other.point_data["RGB"], bytes_of_colours(ring))


def test_colours_are_clipped_and_bytes_pass_as_they_are():
    half = np.array([-0.2, 0.5, 1.7])
    ends = _mesh.colours({"r": half, "g": half, "b": np.array([7, 8, 9], np.uint8)})
    np.testing.assert_array_equal(ends, [[0, 0, 7], [128, 128, 8], [255, 255, 9]])
    assert _mesh.colours({"r": half, "g": half}) is None
    with pytest.raises(InputError, match="one number per vertex"):
        _mesh.colours({"r": np.zeros((3, 1)), "g": half, "b": half})


def test_text_formats_give_every_bit_back(tmp_path):
    vertices = np.random.default_rng(0).normal(size=(8, 3)) * 10.0 ** np.arange(-4, 4)[:, None]
    mesh = SurfaceMesh(vertices, meshes.CUBE_FACES)
    mesh.save(tmp_path / "a.obj")
    mesh.save(tmp_path / "a.off")
    obj = (tmp_path / "a.obj").read_text().splitlines()
    points = [line.split()[1:] for line in obj if line.startswith("v ")]
    np.testing.assert_array_equal(np.array(points, float), vertices)
    off = (tmp_path / "a.off").read_text().splitlines()
    assert off[:2] == ["OFF", "8 12 0"]
    np.testing.assert_array_equal(np.array([s.split() for s in off[2:10]], float), vertices)
    np.testing.assert_array_equal(np.array([s.split()[1:] for s in off[10:]], int), mesh.faces)


# --- 3MF --------------------------------------------------------------------------------------


def read_3mf(path):
    """Unit, vertices, faces, corner colours (F, 3, 4) or None; through lib3mf."""
    import lib3mf

    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromFile(str(path))
    assert reader.GetWarningCount() == 0
    objects = model.GetMeshObjects()
    assert objects.MoveNext()
    part = objects.GetCurrentMeshObject()
    assert part.IsValid()
    assert part.IsManifoldAndOriented()
    vertices = np.array([list(v.Coordinates) for v in part.GetVertices()])
    faces = np.array([list(t.Indices) for t in part.GetTriangleIndices()])
    groups = model.GetColorGroups()
    colours = None
    if groups.MoveNext():
        group = groups.GetCurrentColorGroup()
        palette = {}
        for number in group.GetAllPropertyIDs():
            c = group.GetColor(number)
            palette[number] = (c.Red, c.Green, c.Blue, c.Alpha)
        colours = np.array(
            [[palette[i] for i in t.PropertyIDs] for t in part.GetAllTriangleProperties()]
        )
    return model.GetUnit(), vertices, faces, colours


def test_3mf_keeps_geometry_colours_and_unit(ring, tmp_path):
    import lib3mf

    ring.save(tmp_path / "a.3mf", unit="inch")
    unit, vertices, faces, colours = read_3mf(tmp_path / "a.3mf")
    assert unit == lib3mf.ModelUnit.Inch
    np.testing.assert_allclose(vertices, ring.vertices, rtol=1.2e-7, atol=1e-7)
    np.testing.assert_array_equal(faces, ring.faces)
    np.testing.assert_array_equal(colours[..., :3], bytes_of_colours(ring)[ring.faces])
    assert (colours[..., 3] == 255).all()


def test_3mf_is_in_millimetres_by_default_without_colours(tmp_path):
    import lib3mf

    SurfaceMesh(*meshes.cube()).save(tmp_path / "a.3mf")
    unit, _, _, colours = read_3mf(tmp_path / "a.3mf")
    assert unit == lib3mf.ModelUnit.MilliMeter
    assert colours is None


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1e4])
def test_3mf_of_any_size_keeps_single_precision(tmp_path, scale):
    vertices, faces = meshes.torus(24, 12)
    SurfaceMesh(vertices * scale, faces).save(tmp_path / "a.3mf", unit="meter")
    _, read, _, _ = read_3mf(tmp_path / "a.3mf")
    np.testing.assert_allclose(read, vertices * scale, atol=2e-7 * 2.7 * scale)


def test_3mf_palette_is_coarser_when_there_are_too_many_colours():
    rng = np.random.default_rng(0)
    colour = rng.integers(0, 256, size=(100_000, 3), dtype=np.uint8)
    palette, number = threemf._palette(colour)
    assert len(palette) <= 32**3
    assert np.abs(palette[number].astype(int) - colour).max() <= 5
    palette, number = threemf._palette(colour[:1000])
    np.testing.assert_array_equal(palette[number], colour[:1000])


def test_3mf_without_lib3mf_names_the_extra(ring, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "lib3mf", None)
    with pytest.raises(FormatError, match=r"ilattice\[print\]"):
        ring.save(tmp_path / "a.3mf")
    assert list(tmp_path.iterdir()) == []


def test_3mf_refuses_unknown_units(ring, tmp_path):
    with pytest.raises(InputError, match=r"'mm' is unknown; choose .*millimeter"):
        ring.save(tmp_path / "a.3mf", unit="mm")


# --- the registry -----------------------------------------------------------------------------


def of_kind(kind, name="Thing", **attributes):
    """A class that declares what it is to writers."""
    return type(name, (), {"file_kind": kind, **attributes})


def test_every_ending_of_the_registry_has_a_writer():
    for kind, formats in registry.WRITERS.items():
        for ending in formats:
            assert callable(io.registry.writer_of(of_kind(kind)(), f"a{ending}"))
    assert io.endings(SurfaceMesh(*meshes.cube())) == sorted([*MESH_ENDINGS, ".png"])
    assert set(registry.WRITERS["spline"]) == set(splines.FORMATS)


def test_unknown_endings_types_and_options_are_refused(ring, tmp_path):
    with pytest.raises(FormatError, match=r"'\.step'; choose one of \.3mf, \.obj"):
        ring.save(tmp_path / "a.step")
    with pytest.raises(FormatError, match="ending ''"):
        ring.save(tmp_path / "a")
    with pytest.raises(InputError, match=r"a dict cannot be saved: .* no file_kind; .*, mesh,"):
        io.save({}, tmp_path / "a.stl")
    with pytest.raises(InputError, match=r"option 'unit' is unknown.*known: precision"):
        ring.save(tmp_path / "a.ply", unit="inch")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["SurfaceMesh", "SolidMesh", "SplineMap", "BSpline", "SliceStack"])
def test_names_of_classes_mean_nothing(ring, tmp_path, name):
    foreign = type(name, (), dict.fromkeys(("vertices", "faces", "spline", "names")))()
    assert io.endings(foreign) == []
    with pytest.raises(InputError, match=f"a {name} cannot be saved"):
        io.save(foreign, tmp_path / "a.vtu")
    for write in (io.save_bezier_vtu, splines.save):
        with pytest.raises(InputError, match=f"must be a SplineMap.*{name}"):
            write(foreign, tmp_path / "a.json")
    for kind in ("Mesh", "", 3, None, ["mesh"]):
        with pytest.raises(InputError, match="cannot be saved"):
            io.save(of_kind(kind, vertices=ring.vertices, faces=ring.faces)(), tmp_path / "a.ply")
    with pytest.raises(InputError, match="a type cannot be saved"):
        io.save(SurfaceMesh, tmp_path / "a.ply")
    assert list(tmp_path.iterdir()) == []


def test_subclasses_are_saved_as_what_they_inherit(ring, tmp_path):
    class Part(SurfaceMesh):
        """A mesh of somebody else."""

    Part(ring.vertices, ring.faces).save(tmp_path / "a.ply")
    np.testing.assert_array_equal(io.read_mesh(tmp_path / "a.ply").vertices, ring.vertices)
    torus = il.macroshape.torus(1.0, 0.7)
    io.save(type("Shape", (il.SplineMap,), {})(torus.spline), tmp_path / "a.json")
    found = il.macroshape.load(tmp_path / "a.json")
    np.testing.assert_array_equal(found.spline.c, torus.spline.c)


@pytest.mark.parametrize("ending", MESH_ENDINGS)
def test_classes_join_by_declaring_their_kind(ring, tmp_path, ending):
    """To the same bytes as the mesh itself, also of arrays in Fortran's order."""
    arrays = {"vertices": np.asfortranarray(ring.vertices), "faces": np.asfortranarray(ring.faces)}
    other = of_kind("mesh", point_data=ring.point_data, cell_data=ring.cell_data, **arrays)()
    for name, mesh in (("ring", ring), ("other", other)):
        io.save(mesh, tmp_path / f"{name}{ending}")
    assert (tmp_path / f"other{ending}").read_bytes() == (tmp_path / f"ring{ending}").read_bytes()


@pytest.mark.parametrize("ending", [*MESH_ENDINGS, ".png"])
def test_meshes_that_were_read_are_saved_as_they_are(ring, tmp_path, ending):
    ring.save(tmp_path / "a.off")
    read = io.read_mesh(tmp_path / "a.off")
    assert io.endings(read) == io.endings(ring)
    bare = SurfaceMesh(ring.vertices, ring.faces)
    for name, mesh in (("read", read), ("bare", bare)):
        io.save(mesh, tmp_path / f"{name}{ending}")
    assert (tmp_path / f"read{ending}").read_bytes() == (tmp_path / f"bare{ending}").read_bytes()


@pytest.mark.parametrize("ending", [*MESH_ENDINGS, ".png"])
@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"faces": np.array([[0, 1, 8]])}, "faces must name vertices from 0 to 7, got 0 to 8"),
        ({"faces": np.array([[0, 1, -1]])}, "got -1 to 1"),
        ({"faces": np.array([[0.0, 1.0, 2.0]])}, r"faces must be an array \(n, 3\) of integers"),
        ({"faces": np.array([[0, 1, 2, 3]])}, "faces must be an array"),
        ({"vertices": [[0.0, 0.0, 0.0]]}, r"vertices must be an array \(n, 3\) of reals"),
    ],
)
def test_arrays_that_are_no_mesh_are_refused(tmp_path, ending, wrong, message):
    vertices, faces = meshes.cube()
    arrays = {"vertices": np.array(vertices, float), "faces": np.array(faces), **wrong}
    with pytest.raises(InputError, match=message):
        io.save(of_kind("mesh", point_data={}, cell_data={}, **arrays)(), tmp_path / f"a{ending}")
    assert list(tmp_path.iterdir()) == []


def test_the_format_can_be_named(ring, tmp_path):
    ring.save(tmp_path / "a.dat", format="off")
    assert (tmp_path / "a.dat").read_text().startswith("OFF\n")


@pytest.mark.parametrize("ending", [*MESH_ENDINGS, ".png"])
def test_an_empty_mesh_is_not_written(tmp_path, ending):
    empty = SurfaceMesh(np.zeros((4, 3)), np.zeros((0, 3), int))
    with pytest.raises(GeometryError, match="no triangles"):
        empty.save(tmp_path / f"a{ending}")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("ending", [".stl", ".3mf"])
def test_triangles_lost_to_single_precision_are_told(tmp_path, ending):
    vertices, faces = meshes.cube((1e6, 0.0, 0.0), 1e-3)
    with pytest.warns(PrecisionWarning, match="8 triangles collapse") as caught:
        SurfaceMesh(vertices, faces).save(tmp_path / f"a{ending}")
    assert caught[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        SurfaceMesh(vertices, faces).save(tmp_path / "a.ply")


# --- disks ------------------------------------------------------------------------------------


class FullDisk(std_io.FileIO):
    """File on a disk that is full after 100 bytes."""

    def write(self, data):
        if self.tell() + len(data) > 100:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(data)


@pytest.fixture
def old(tmp_path):
    """A folder with old files of all formats."""
    for ending in [*MESH_ENDINGS, ".png"]:
        (tmp_path / f"a{ending}").write_bytes(b"old")
    return tmp_path


def assert_untouched(folder, ending):
    assert (folder / f"a{ending}").read_bytes() == b"old"
    assert not [p for p in folder.iterdir() if p.name.startswith(".")]


@pytest.mark.parametrize("ending", [".stl", ".ply", ".png"])
def test_a_full_disk_leaves_the_old_file(ring, old, monkeypatch, ending):
    monkeypatch.setattr("ilattice._files.open", lambda p, *_, **__: FullDisk(p, "w"), raising=False)
    with pytest.raises(FormatError, match="the disk is full"):
        ring.save(old / f"a{ending}")
    assert_untouched(old, ending)


@pytest.fixture(scope="session")
def small_disk(tmp_path_factory):
    """A file system of 256 kB, if this process may mount one."""
    folder = tmp_path_factory.mktemp("small")
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(folder)]
    try:
        done = subprocess.run(mount, capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        done = False
    if not done:
        pytest.skip("may not mount a small file system")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.parametrize("ending", [*MESH_ENDINGS, ".png"])
def test_a_really_full_disk_leaves_the_old_file(small_disk, ending, capfd):
    vertices, faces = meshes.torus(100, 60)
    large = SurfaceMesh(vertices, faces, dict(zip("rgb", vertices.T, strict=True)))
    (small_disk / f"a{ending}").write_bytes(b"old")
    filler = small_disk / "filler"
    filler.write_bytes(b"0" * 230_000)
    with pytest.raises(FormatError, match="the disk is full"):
        large.save(small_disk / f"a{ending}")
    assert_untouched(small_disk, ending)
    filler.unlink()
    SurfaceMesh(*meshes.cube()).save(small_disk / f"a{ending}")
    assert (small_disk / f"a{ending}").stat().st_size > 100
    (small_disk / f"a{ending}").unlink()
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("ending", [*MESH_ENDINGS, ".png"])
def test_unwritable_paths_are_told(ring, tmp_path, ending):
    with pytest.raises(InputError, match="no directory"):
        ring.save(tmp_path / "missing" / f"a{ending}")
    (tmp_path / f"a{ending}").mkdir()
    with pytest.raises(InputError, match="is a directory"):
        ring.save(tmp_path / f"a{ending}")


@pytest.mark.parametrize(
    ("ending", "where"),
    [
        (".stl", "ilattice.io.stl.triangle_records"),
        (".ply", "ilattice.io.ply.FaceRecords.block"),
        (".obj", "ilattice.io.obj.point_lines"),
        (".off", "ilattice.io.off.point_lines"),
        (".3mf", "ilattice.io.threemf._decimals"),
        (".vtp", "ilattice.io.vtk._check"),
    ],
)
def test_an_interrupted_save_leaves_the_old_file(ring, old, monkeypatch, ending, where):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(where, interrupt)
    with pytest.raises(KeyboardInterrupt):
        ring.save(old / f"a{ending}")
    assert_untouched(old, ending)


def test_files_replace_old_ones(ring, old):
    for ending in MESH_ENDINGS:
        ring.save(old / f"a{ending}")
        assert (old / f"a{ending}").stat().st_size > 1000
    assert zipfile.is_zipfile(old / "a.3mf")


def test_temporary_files_of_killed_processes_are_removed_by_the_next_save(tmp_path):
    """Not those of processes that are still writing, and no other files."""
    program = (
        "import sys, time; from ilattice._files import atomic_path\n"
        "with atomic_path(sys.argv[1]) as p: print(p, flush=True); time.sleep(60)"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    children = [
        subprocess.Popen(
            [sys.executable, "-c", program, tmp_path / "a.ply"],
            stdout=subprocess.PIPE, text=True, env=environment,
        )
        for _ in range(3)
    ]  # fmt: skip
    names = [Path(child.stdout.readline().strip()) for child in children]
    other = tmp_path / ".a.tmp.ply"
    other.touch()
    for name in (".a.tmp0123abcd.ply", "..a.tmp0123abcd.tmpwxyz_890.ply"):  # of killed sweeps
        (tmp_path / name).touch()
    for child in children[1:]:
        child.kill()
        child.wait()
    assert all(name.exists() for name in names)
    il.sdf.mesh(il.fields.sphere(1.0), 0.2).save(tmp_path / "a.ply")
    assert [name.exists() for name in names] == [True, False, False]
    assert {p.name for p in tmp_path.iterdir()} == {"a.ply", other.name, names[0].name}
    children[0].kill()
    children[0].wait()
    for child in children:
        child.stdout.close()
    il.sdf.mesh(il.fields.sphere(1.0), 0.2).save(tmp_path / "a.ply")
    assert {p.name for p in tmp_path.iterdir()} == {"a.ply", ".a.tmp.ply"}


KILLED = """
import itertools, sys
import numpy as np, ilattice as il
a, b = (il.sdf.mesh(il.fields.sphere(r), 0.2 * r) for r in (1.0, 1.5))
if sys.argv[1] in (".json", ".xml"):
    a, b = il.macroshape.torus(1.0, 0.7), il.macroshape.torus(2.0, 0.9)
ending = sys.argv[1]
a.save("old" + ending), b.save("new" + ending), a.save("a" + ending)
print("go", flush=True)
for i in itertools.count():
    (b, a)[i % 2].save("a" + ending)
"""


@pytest.mark.parametrize("ending", [".stl", ".3mf", ".json"])
def test_killed_saves_leave_the_old_file_or_the_new_one(ending, tmp_path):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    rng = random.Random(f"kills {ending}")
    for _ in range(SAVES_KILLED):
        child = subprocess.Popen(
            [sys.executable, "-c", KILLED, ending],
            cwd=tmp_path, env=environment, stdout=subprocess.PIPE,
        )  # fmt: skip
        assert child.stdout.readline() == b"go\n"
        time.sleep(rng.uniform(0.0, 0.1))
        child.kill()
        child.wait()
        child.stdout.close()
        old, new = ((tmp_path / f"{name}{ending}").read_bytes() for name in ("old", "new"))
        assert old != new
        assert (tmp_path / f"a{ending}").read_bytes() in (old, new)
    part = il.macroshape.box() if ending == ".json" else il.sdf.mesh(il.fields.sphere(1.0), 0.2)
    part.save(tmp_path / f"a{ending}")
    assert {p.name for p in tmp_path.iterdir()} == {f"{n}{ending}" for n in ("a", "old", "new")}


@pytest.mark.parametrize("ending", ["stl", "3mf", "ply"])
def test_sizes_that_a_format_does_not_hold_are_refused(tmp_path, ending):
    """Infinite corners, or all of them zero, are no part."""
    if ending == "3mf":
        pytest.importorskip("lib3mf")
    options = {"precision": "single"} if ending == "ply" else {}
    ball = il.sdf.mesh(il.fields.sphere(1.0), 0.2)
    path = tmp_path / f"a.{ending}"
    for scale in (1e39, 1e200, *([1e-11, 1e10] if ending == "3mf" else ())):
        mesh = il.mesh.SurfaceMesh(ball.vertices * scale, ball.faces)
        with pytest.raises(FormatError, match="holds coordinates from"):
            mesh.save(path, **options)
        assert not list(tmp_path.iterdir())
    il.mesh.SurfaceMesh(ball.vertices * 1e-7, ball.faces).save(path, **options)
    if ending != "3mf":
        assert il.mesh.load(path).volume == pytest.approx(ball.volume * 1e-21, rel=1e-6)


@pytest.mark.parametrize("name", ["a.stl", "a.3mf"])
def test_rounding_of_parts_far_away_is_told(name, tmp_path):
    """Single precision at a million: six hundredths, a large part of an edge of a tenth."""
    import ilattice as il

    if name.endswith("3mf"):
        pytest.importorskip("lib3mf")
    ball = il.mesh.contour(lambda x: (x**2).sum(axis=1) - 1, [np.linspace(-1.2, 1.2, 17)] * 3)
    ball.save(tmp_path / name)
    far = il.SurfaceMesh(ball.vertices + np.array([1e6, 0, 0]), ball.faces)
    with pytest.warns(il.errors.PrecisionWarning, match=r"vertices move by up to 0\.0[23]"):
        far.save(tmp_path / name)


@pytest.mark.parametrize("ending", [".3mf", ".obj", ".ply", ".vtp"])
def test_colours_that_are_no_numbers_are_refused(tmp_path, ending):
    vertices, faces = meshes.sphere(1)
    grey = np.full(len(vertices), 0.5)
    data = {"r": np.where(np.arange(len(vertices)) == 3, np.nan, 0.2), "g": grey, "b": grey}
    with pytest.raises(InputError, match=f"not finite at 1 of {len(vertices)} vertices"):
        SurfaceMesh(vertices, faces, data).save(tmp_path / f"a{ending}")
    assert not list(tmp_path.iterdir())
