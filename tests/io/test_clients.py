"""The programs that people open our files with; every test skips where its program is missing.

On Debian: ``apt-get install admesh slic3r prusa-slicer paraview python3-paraview xvfb xauth``.
Slicers and admesh return 0 for broken meshes too, so what they print is read.
"""

import os
import re
import shutil
import subprocess

import meshes
import numpy as np
import pytest

from ilattice import io
from ilattice.bspline import BSpline
from ilattice.macroshape import SplineMap
from ilattice.mesh import SurfaceMesh

pytestmark = pytest.mark.client


def run(*command, tries=1):
    """Standard output of a program, or skip if it is not installed."""
    if shutil.which(command[0]) is None:
        pytest.skip(f"{command[0]} is not installed")
    env = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    for _ in range(tries):
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=300, check=False, env=env
        )
        if done.returncode == 0:
            return done.stdout
    pytest.fail(f"{' '.join(command)}: {done.returncode}\n{done.stdout}\n{done.stderr}")


@pytest.fixture(scope="module")
def part(tmp_path_factory):
    """Two parts, a torus and a ball, 100 mm wide, coloured; and a broken copy of them."""
    folder = tmp_path_factory.mktemp("part")
    vertices, faces = meshes.joined(meshes.torus(60, 30), meshes.sphere(3))
    vertices = vertices * 18.0 + 60.0
    colour = dict(zip("rgb", (vertices.T - vertices.min()) / np.ptp(vertices), strict=True))
    mesh = SurfaceMesh(vertices, faces, colour | {"height": vertices[:, 2]})
    for ending in (".stl", ".3mf", ".obj", ".vtp"):
        mesh.save(folder / f"part{ending}")
    SurfaceMesh(vertices, faces[:-1]).save(folder / "broken.stl")
    return mesh, folder


def information(text):
    return dict(re.findall(r"(\w+) = +(\S+)", text))


@pytest.mark.parametrize("ending", [".stl", ".3mf", ".obj"])
def test_prusa_slicer_finds_a_manifold(part, ending):
    mesh, folder = part
    found = information(run("prusa-slicer", "--info", str(folder / f"part{ending}")))
    assert found["manifold"] == "yes"
    assert "open_edges" not in found
    assert int(found["number_of_facets"]) == len(mesh.faces)
    assert int(found["number_of_parts"]) == mesh.components == 2
    assert float(found["volume"]) == pytest.approx(mesh.volume, rel=1e-4)
    assert float(found["size_x"]) == pytest.approx(np.ptp(mesh.bounds[:, 0]), rel=1e-5)


def test_prusa_slicer_notices_a_hole(part):
    found = information(run("prusa-slicer", "--info", str(part[1] / "broken.stl")))
    assert (found["manifold"], found["open_edges"]) == ("no", "3")


@pytest.mark.parametrize("ending", [".stl", ".3mf"])
def test_prusa_slicer_slices(part, ending):
    mesh, folder = part
    out = folder / f"part{ending}.gcode"
    options = ["--center", "100,100", "--layer-height", "0.3", "--nozzle-diameter", "0.4"]
    source = str(folder / f"part{ending}")
    text = run("prusa-slicer", "--export-gcode", *options, "-o", str(out), source)
    assert not re.search("repair|error|warning", text, re.IGNORECASE)
    used = float(re.search(r"filament used \[cm3\] = (\S+)", out.read_text())[1])
    assert 0.15 < used * 1000 / mesh.volume < 1.0  # shells and 20 % infill


def test_slic3r_finds_a_manifold(part):
    mesh, folder = part
    found = information(run("slic3r", "--no-gui", "--info", str(folder / "part.stl")))
    assert found["manifold"] == "yes"
    assert int(found["number_of_parts"]) == 2
    assert float(found["volume"]) == pytest.approx(mesh.volume, rel=1e-4)


def admesh(path):
    """First number after each label of what admesh prints."""
    pairs = re.findall(r"([A-Z]\w+(?: \w+)+?) *: +(\d+)", run("admesh", str(path)))
    return {label: int(number) for label, number in pairs}


def test_admesh_repairs_nothing(part):
    mesh, folder = part
    rows = admesh(folder / "part.stl")
    assert rows["Number of facets"] == len(mesh.faces)
    assert rows["Number of parts"] == 2
    repairs = ("Facets reversed", "Backwards edges", "Facets added", "Normals fixed")
    faults = ("Total disconnected facets", "Degenerate facets", *repairs)
    assert [rows[k] for k in faults] == [0] * 6
    assert admesh(folder / "broken.stl")["Total disconnected facets"] == 3


# --- ParaView ---------------------------------------------------------------------------------

NUMBERS = """
import sys
from paraview import servermanager
from paraview.simple import ExtractSurface, OpenDataFile

reader = OpenDataFile(sys.argv[1])
reader.UpdatePipeline()
info = reader.GetDataInformation()
data = reader.PointData
names = sorted(data.GetArray(i).Name for i in range(data.GetNumberOfArrays()))
print("counts", info.GetNumberOfPoints(), info.GetNumberOfCells(), *names)
if sys.argv[1].endswith(".vtu"):
    surface = ExtractSurface(Input=reader, NonlinearSubdivisionLevel=4)
    surface.UpdatePipeline()
    data = servermanager.Fetch(surface)
    x = [data.GetPoint(i) for i in range(data.GetNumberOfPoints())]
    radius = [(p[0] ** 2 + p[1] ** 2) ** 0.5 for p in x]
    print("radius", len(radius), min(radius), max(radius))
"""

PICTURE = """
import sys
from paraview.simple import *

reader = OpenDataFile(sys.argv[1])
view = GetActiveViewOrCreate("RenderView")
view.ViewSize = [300, 300]
view.OrientationAxesVisibility = 0
shown = Show(reader, view)
shown.NonlinearSubdivisionLevel = 4
shown.SetRepresentationType("Surface")
shown.SetScalarBarVisibility(view, False)
view.UseColorPaletteForBackground = 0
view.Background = [0.0, 0.0, 0.0]
view.InteractionMode = "2D"
ResetCamera(view)
Render(view)
SaveScreenshot(sys.argv[2], view)
"""


@pytest.fixture(scope="module")
def annulus(tmp_path_factory):
    """Exact rational quarter of a tube with radii 1 and 2."""
    path = tmp_path_factory.mktemp("annulus") / "annulus.vtu"
    c = np.zeros((3, 2, 2, 3))
    for j, radius in enumerate((1.0, 2.0)):
        c[:, j, :, :2] = radius * np.array([[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])[:, None]
    c[..., 1, 2] = 1.0
    weights = np.broadcast_to(np.array([1, np.sqrt(0.5), 1])[:, None, None], (3, 2, 2))
    t = ([0, 0, 0, 1, 1, 1], [0, 0, 1, 1], [0, 0, 1, 1])
    io.save(SplineMap(BSpline(t, c, (2, 1, 1), weights=weights)), path)
    return path


def paraview(tmp_path, script, *arguments, display=False):
    file = tmp_path / "script.py"
    file.write_text(script)
    if not display:
        return run("pvpython", str(file), *map(str, arguments))
    if shutil.which("pvbatch") is None:
        pytest.skip("pvbatch is not installed")
    number = str(200 + os.getpid() % 5000)  # two tests on one display end each other
    start = ("xvfb-run", "-n", number, "-s", "-screen 0 800x600x24")
    return run(
        *start, "pvbatch", "--force-offscreen-rendering", str(file), *map(str, arguments), tries=3
    )


def test_paraview_evaluates_rational_volumes_exactly(annulus, tmp_path):
    lines = paraview(tmp_path, NUMBERS, annulus).splitlines()
    assert lines[-2].split() == ["counts", "12", "1", "RationalWeights"]
    count, smallest, largest = map(float, lines[-1].split()[1:])
    assert count > 500
    assert smallest == pytest.approx(1.0, abs=1e-6)
    assert largest == pytest.approx(2.0, abs=1e-6)


def test_paraview_reads_surfaces_with_their_data(part, tmp_path):
    mesh, folder = part
    line = paraview(tmp_path, NUMBERS, folder / "part.vtp").splitlines()[-1].split()
    assert line[1:3] == [str(len(mesh.vertices)), str(len(mesh.faces))]
    assert set(line[3:]) == {"RGB", "r", "g", "b", "height"}


def test_paraview_renders_a_round_annulus(annulus, tmp_path):
    from PIL import Image

    paraview(tmp_path, PICTURE, annulus, tmp_path / "a.png", display=True)
    pixels = np.asarray(Image.open(tmp_path / "a.png").convert("RGB")).astype(int)
    shown = pixels.max(axis=-1) > 30
    rows, columns = np.flatnonzero(shown.any(axis=1)), np.flatnonzero(shown.any(axis=0))
    box = (np.ptp(rows) + 1) * (np.ptp(columns) + 1)
    assert box > 150**2
    assert shown.sum() / box == pytest.approx(np.pi * 3 / 16, rel=0.01)
