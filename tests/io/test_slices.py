"""Written slices, read back by naive readers and by lib3mf."""

import re
import struct
import zipfile
from itertools import chain
from xml.etree import ElementTree

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import FormatError, InputError
from ilattice.tiles.trig import TrigField

RINGS = TrigField([1.0, 1.0, 0.6], [[1, 0, 0], [0, 1, 0], [0, 0, 0]])  # upright tubes


@pytest.fixture(scope="module")
def stack():
    lattice = il.Lattice(il.Tile(RINGS), through=il.macroshape.box((2.0, 1.0, 0.3)))
    return lattice.offset(0.05).slices([-0.1, 0.1, 0.2], h=0.05, polish=False)


def expected(stack):
    return [[loop for outer, holes in s.polygons for loop in (outer, *holes)] for s in stack]


def same(found, wanted, tol):
    assert [len(layer) for layer in found] == [len(layer) for layer in wanted]
    for a, b in zip(chain(*found), chain(*wanted), strict=True):
        assert a.shape == b.shape
        assert np.abs(a - b).max() < tol


def test_the_fixture_has_empty_layers_outer_contours_and_holes(stack):
    assert [len(s.polygons) for s in stack] == [0, 1, 1]
    assert stack[1].holes >= 1


# --- CLI --------------------------------------------------------------------------------------


def read_ascii(text):
    head, body = text.split("$$GEOMETRYSTART\n")
    assert head.startswith("$$HEADERSTART\n$$ASCII\n")
    assert body.endswith("$$GEOMETRYEND\n")
    layers = []
    for line in body.splitlines()[:-1]:
        name, values = re.fullmatch(r"\$\$([A-Z]+)/(.*)", line).groups()
        numbers = [float(v) for v in values.split(",")]
        if name == "LAYER":
            layers.append((numbers[0], []))
        else:
            assert name == "POLYLINE"
            points = np.array(numbers[3:]).reshape(-1, 2)
            assert numbers[2] == len(points)
            layers[-1][1].append((int(numbers[1]), points))
    return head, layers


def read_binary(data):
    head, body = data.split(b"$$HEADEREND")
    at, layers = 0, []
    while at < len(body):
        (command,) = struct.unpack_from("<H", body, at)
        if command == 127:
            layers.append((struct.unpack_from("<f", body, at + 2)[0], []))
            at += 6
        else:
            assert command == 130
            _, direction, n = struct.unpack_from("<iii", body, at + 2)
            points = np.frombuffer(body, "<f4", 2 * n, at + 14).reshape(-1, 2)
            layers[-1][1].append((direction, points.astype(float)))
            at += 14 + 8 * n
    return head.decode() + "$$HEADEREND", layers


@pytest.mark.parametrize("binary", [True, False])
def test_cli_holds_closed_polylines_and_a_zero_layer(stack, tmp_path, binary):
    path = tmp_path / "a.cli"
    stack.save(path, binary=binary, unit="centimeter")
    data = path.read_bytes()
    head, layers = read_binary(data) if binary else read_ascii(data.decode())
    assert "$$UNITS/10\n" in head
    assert "$$LAYERS/4\n" in head
    assert "$$VERSION/200\n" in head
    box = [float(v) for v in re.search(r"DIMENSION/(.*)", head)[1].split(",")]
    np.testing.assert_allclose(box, [0, 0, -0.3, 2, 1, 0.2], atol=1e-9)
    np.testing.assert_allclose([z for z, _ in layers], [stack.bottom, *stack.tops], atol=1e-6)
    assert layers[0][1] == []
    for _, polylines in layers:
        for direction, p in polylines:
            assert (p[0] == p[-1]).all()
            x, y = p.T
            assert direction == int(x[:-1] @ y[1:] - x[1:] @ y[:-1] > 0)
    found = [[p[:-1] for _, p in polylines] for _, polylines in layers[1:]]
    same(found, expected(stack), 2e-7 if binary else 1e-7)


# --- SVG --------------------------------------------------------------------------------------


def read_svg(text):
    root = ElementTree.fromstring(text)
    space = "{http://www.w3.org/2000/svg}"
    assert root.tag == f"{space}svg"
    layers = []
    for group in root.findall(f"{space}g"):
        path = group.find(f"{space}path")
        assert path.get("fill-rule") == "evenodd"
        assert group.get("transform") == "scale(1,-1)"
        loops = re.findall(r"M([^Z]*)Z", path.get("d"))
        layers.append([np.array(re.split("[ ,]", p), float).reshape(-1, 2) for p in loops])
    return root, layers


def test_svg_has_one_layer_per_slice(stack, tmp_path):
    stack.save(tmp_path / "a.svg", unit="inch")
    root, layers = read_svg((tmp_path / "a.svg").read_text())
    same(layers, expected(stack), 1e-7)
    assert root.get("width") == f"{25.4 * 2.08:.6g}mm"
    x, y, width, height = map(float, root.get("viewBox").split())
    assert (x, width) == pytest.approx((-0.04, 2.08))
    assert (-y, height) == pytest.approx((1.04, 1.08))


def test_svg_of_one_slice(stack):
    _, layers = read_svg(stack[1].to_svg())
    same(layers, expected(stack)[1:2], 1e-7)
    _, layers = read_svg(stack[0].to_svg())
    assert layers == [[]]


# --- 3MF --------------------------------------------------------------------------------------


def test_3mf_is_read_by_lib3mf(stack, tmp_path):
    lib3mf = pytest.importorskip("lib3mf")
    path = tmp_path / "a.3mf"
    stack.save(path, unit="inch")
    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromFile(str(path))
    assert reader.GetWarningCount() == 0
    assert model.GetUnit() == lib3mf.ModelUnit.Inch
    objects = model.GetMeshObjects()
    assert objects.MoveNext()
    part = objects.GetCurrentMeshObject()
    assert part.IsManifoldAndOriented()
    assert part.GetSlicesMeshResolution() == lib3mf.SlicesMeshResolution.Lowres
    slices = part.GetSliceStack()
    assert slices.GetBottomZ() == pytest.approx(stack.bottom)
    found = []
    for i in range(slices.GetSliceCount()):
        s = slices.GetSlice(i)
        assert s.GetZTop() == pytest.approx(stack.tops[i])
        points = np.array([list(v.Coordinates) for v in s.GetVertices()]).reshape(-1, 2)
        loops = [list(s.GetPolygonIndices(j)) for j in range(s.GetPolygonCount())]
        assert all(loop[0] == loop[-1] for loop in loops)
        found.append([points[loop[:-1]] for loop in loops])
    same(found, expected(stack), 3e-7)  # lib3mf holds single precision


def test_3mf_is_the_same_every_time(stack, tmp_path):
    for name in "ab":
        stack.save(tmp_path / f"{name}.3mf")
    assert (tmp_path / "a.3mf").read_bytes() == (tmp_path / "b.3mf").read_bytes()
    with zipfile.ZipFile(tmp_path / "a.3mf") as package:
        assert package.testzip() is None


@pytest.mark.parametrize("ending", ["cli", "3mf"])
def test_files_end_at_the_top_of_the_part(stack, tmp_path, ending):
    path = tmp_path / f"a.{ending}"
    layers = stack.part.slices(thickness=0.08, h=0.05, polish=False)
    if ending == "cli":
        layers.save(path, binary=False)
        tops = [z for z, _ in read_ascii(path.read_text())[1]][1:]
    else:
        layers.save(path)
        with zipfile.ZipFile(path) as package:
            text = package.read("3D/3dmodel.model").decode()
        tops = [float(z) for z in re.findall(r'ztop="([^"]*)"', text)]
        assert max(float(z) for z in re.findall(r'<vertex .* z="([^"]*)"', text)) == tops[-1]
    np.testing.assert_allclose(tops, [0.08, 0.16, 0.24, 0.3], atol=1e-7)


# --- all --------------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", ["cli", "svg", "3mf"])
def test_what_fails_leaves_nothing(stack, tmp_path, ending, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    with pytest.raises(InputError, match="furlong"):
        stack.save(tmp_path / f"a.{ending}", unit="furlong")
    monkeypatch.setattr(type(stack.slicer), "outline", stop)
    with pytest.raises(KeyboardInterrupt):
        stack.save(tmp_path / f"a.{ending}")
    assert list(tmp_path.iterdir()) == []


def test_other_endings_are_refused(stack, tmp_path):
    with pytest.raises(FormatError, match=r"\.3mf, \.cli, \.svg"):
        stack.save(tmp_path / "a.stl")
