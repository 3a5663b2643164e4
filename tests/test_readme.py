"""The README does what it says: its programs run, its command lines are understood."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.figure import Figure

import ilattice as il
from ilattice import cli
from ilattice.lattice import ParametricWall
from ilattice.mesh import SliceStack

TEXT = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
PROGRAM, VARIATIONS, SEARCH = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
LINES = [line for line in TEXT.splitlines() if line.startswith("ilattice ")]


def test_the_shortest_program_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    exec(PROGRAM.replace("h=0.05", "h=0.12"), {})
    assert {path.name for path in tmp_path.iterdir()} == {"torus.stl", "torus.vtp"}
    assert "257 ThicknessReport" in capsys.readouterr().out


@pytest.mark.filterwarnings("ignore:the mesh with h=")  # coarse
def test_the_variations_are_one_line_each(tmp_path):
    file = tmp_path / "part.xml"
    il.macroshape.box().save(file)
    assert "[0.03, 0.14]" in VARIATIONS
    text = VARIATIONS.replace("[0.03, 0.14]", "[0.8, 1.6]")
    lines = [line.split("  #")[0] for line in text.splitlines()]
    torus = il.macroshape.torus()
    names = {
        "il": il,
        "np": np,
        "torus": torus,
        "lattice": il.Lattice("gyroid", through=il.macroshape.box(9.0)),
        "x": 9.0 * np.indices((3, 3, 3)).reshape(3, -1).T / 2.0,
        "d": np.linspace(0.1, 0.3, 27),
        "nodes": [(0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (1.0, 0.0, 0.0)],
        "edges": [(0, 1), (0, 2)],
        "radii": 0.1,
    }
    results = [
        eval(line.replace('"part.xml"', repr(str(file))).replace("...", "u[:, 0] - 0.5"), names)
        for line in lines
    ]
    pyplot.close("all")
    kinds = [*[il.Wall] * 6, ParametricWall, il.SplineMap]
    kinds += [il.Tile, il.Tile, il.Tile, il.Tile, il.SurfaceMesh, il.Tile]
    kinds += [Figure, SliceStack, il.SplineMap, il.tiles.Mixture, il.SplineMap]
    assert [type(result) for result in results] == kinds


def test_pictures_are_there():
    pictures = re.findall(r"!\[.*?\]\((.*?)\)", TEXT)
    assert pictures
    for name in pictures:
        assert (Path(__file__).parents[1] / name).is_file()


def test_the_search_of_a_density_finds_it():
    names = {"il": il}
    exec(SEARCH, names)
    assert names["density"](names["level"]) == pytest.approx(0.6, abs=1e-3)


NUMBERS = ("E_x", "E_y", "E_z", "nu_xy", "nu_xz", "nu_yz", "G_yz", "G_xz", "G_xy", "K", "zener")
CELL = dict.fromkeys((*NUMBERS, "density", "error"), 1.0)
CELL |= {"symmetry": "cubic", "k": [], "errors": [], "gaps": [], "files": []}


@pytest.mark.parametrize("line", LINES)
def test_the_command_lines_are_understood(line, monkeypatch):
    called = []
    for name in ("build", "describe", "catalogue"):
        monkeypatch.setattr(f"ilattice._job.{name}", lambda *a, **k: called.append((a, k)) or [])
    empty = {"layers": 0, "from": 0.0, "to": 0.0, "files": []}
    monkeypatch.setattr("ilattice._job.slices", lambda **k: called.append(k) or empty)
    monkeypatch.setattr("ilattice.sdf.job.run", lambda words, **_: called.append(words) or {})
    for name in ("homogenize", "bands"):
        found = f"ilattice.homogenize.job.{name}"
        monkeypatch.setattr(found, lambda **k: called.append(k) or CELL)
    if line.startswith("ilattice sdf") and "part.stl" not in line:
        assert il.sdf.Command.read(shlex.split(line)[2:]).items
    monkeypatch.setattr("ilattice.cli._summary", lambda _: None)
    assert cli.main(shlex.split(line)[1:]) == 0
    assert len(called) == 1


def test_there_are_three_commands_and_the_command_lines():
    commands = re.findall(r"^python3 -m venv .*", TEXT, re.MULTILINE)
    assert ["demo" in c for c in commands] == [True, False, False]
    assert ["pytest" in c for c in commands] == [False, True, False]
    assert ["sphinx" in c for c in commands] == [False, False, True]
    assert len(LINES) == 13
