"""The command ``ilattice shell``."""

import json

import pytest

import ilattice as il
from ilattice import cli


def test_it_makes_a_wall_and_a_report(tmp_path, capfd):
    mesh, report = tmp_path / "s.stl", tmp_path / "s.json"
    words = ["shell", "--topology", "topo_19_rrr", "--position", "0.1", "--derivative", "1.5"]
    more = ["--density", "0.4", "--n", "12", "--h", "0.1", "-o", str(mesh), "--report", str(report)]
    assert cli.main([*words, *more]) == 0
    out = capfd.readouterr().out
    data = json.loads(report.read_text())
    assert data["genus"] == 3
    assert data["density"] == pytest.approx(0.4, abs=1e-3)
    assert il.mesh.load(mesh).volume == pytest.approx(0.4, rel=0.02)
    assert f"area  {data['area']:.6g}\n" in out
    assert all(f"wrote  {path}\n" in out for path in (mesh, report))


def test_without_a_topology_it_lists_them(capfd):
    assert cli.main(["shell"]) == 0
    lines = capfd.readouterr().out.splitlines()
    assert len(lines) == 20
    assert any(line.startswith("topo_19 ") and "6 nodes in 1 loop" in line for line in lines)


def test_without_a_wall_files_hold_the_surface(tmp_path, capfd):
    file = tmp_path / "s.vtp"
    words = ["shell", "--topology", "topo_1_rrr", "--position", "0.1", "0.1", "0.1", "--n", "10"]
    assert cli.main([*words, "-o", str(file)]) == 0
    assert f"wrote  {file}\n" in capfd.readouterr().out


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        (["--topology", "topo_99"], 2, "near names"),
        (["--topology", "topo_19_trr"], 1, "t along x"),
        (["--topology", "c19", "-o", "s.doc"], 1, "endings"),
        (["--topology", "c19", "-o", "no/s.stl"], 1, "directory"),
        (["--topology", "c19", "--position", "1.5"], 2, "position"),
        (["--topology", "c19", "--derivative", "-1"], 2, "derivative"),
        (["--topology", "c19", "--density", "0.2", "--thickness", "1"], 2, "either"),
        (["--topology", "c1", "--derivative", "5"], 1, "cross on face"),
        (["--topology", "c19", "--repeat", "0"], 2, "repeat"),
        (["--topology", "c19", "--method", "magic"], 2, "method"),
        (["--topology", "c19", "--n", "12.5"], 2, "--n"),
        (["--topology", "c19", "--n", "8", "--density", "0.3", "--repeat", "1.6"], 2, "--repeat"),
        (["--topology", ""], 2, "topology"),
        (["--density", "0.3"], 2, "--topology is missing"),
        (["-o", "s.stl", "--report", "s.json"], 2, "--topology is missing"),
    ],
)
def test_wrong_words_end_in_one_line(words, code, told, capfd):
    assert cli.main(["shell", *words]) == code
    err = capfd.readouterr().err
    assert told in err
    assert err.count("\n") == 1
