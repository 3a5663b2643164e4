"""The command line: every command end to end, and every error one line with its exit code."""

import json
import re
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

import ilattice as il
from ilattice import __version__, _job, _warmup, cli

BUILD = {
    "--tile": ["schwarz_p"],
    "--through": ["box"],
    "--repeat": ["1", "1", "1"],
    "--thickness": ["0.1 + 0.02*cos(2*pi*u)"],
    "--h": ["0.07"],
}


def words(**changes):
    options = BUILD | {f"--{name}": value for name, value in changes.items()}
    return ["build", *(w for name, values in options.items() if values for w in [name, *values])]


def fails(arguments, code, capfd):
    assert cli.main(arguments) == code
    out, err = capfd.readouterr()
    assert out == ""
    assert err.startswith("ilattice: error: ")
    assert err.count("\n") == 1
    return err


def test_thicknesses_are_numbers_or_fields():
    assert _job.half_thickness(0.2) == 0.2
    assert _job.half_thickness("1/8") == 0.125
    assert isinstance(_job.half_thickness("1/8"), float)
    p = np.array([[0.25, 0.5, 1.0]])
    np.testing.assert_allclose(_job.half_thickness("0.1 + 0.09*(1 - cos(2*pi*u))")(p), 0.19)
    np.testing.assert_array_equal(_job.half_thickness("0*u")(p), [0.0])


def test_build_writes_all_files_and_the_report(tmp_path, capfd):
    files = [tmp_path / name for name in ("a.stl", "a.vtp", "a.ply")]
    report = tmp_path / "a.json"
    code = cli.main([*words(report=[str(report)]), "-o", *map(str, files)])
    out, err = capfd.readouterr()
    assert (code, err) == (0, "")
    assert all(file.stat().st_size > 1000 for file in files)
    data = json.loads(report.read_text())
    assert data["watertight"] is True
    assert 0.15 < data["volume"] < 0.9
    assert data["area"] > 4
    assert data["components"] == 1
    assert data["faces"] == 2 * (data["vertices"] - 2 + 2 * data["genus"])
    assert set(data["thickness_error"]) == {"max", "p99", "rms", "relative", "missing"}
    assert data["thickness_error"]["missing"] == 0.0
    assert data["wall_volume"] is None  # edges are short enough
    assert 0 < data["thickness_error"]["rms"] <= data["thickness_error"]["max"] < 0.01
    assert data["closest_points"]["queries"] > 1000
    assert 0 < data["closest_points"]["mean_iterations"] < 40
    assert data["closest_points"]["fallbacks"] == 0
    assert list(data["stages"]) == ["volume", "distance", "mesh", "thickness error", "write"]
    assert all(stage["seconds"] >= 0 for stage in data["stages"].values())
    assert f"genus  {data['genus']}\n" in out
    assert "watertight  yes\n" in out
    assert f"rms {data['thickness_error']['rms']:.6g}" in out
    assert all(f"wrote  {path}\n" in out for path in [*files, report])


def test_features_of_the_wall_are_reported(tmp_path, capfd):
    report = tmp_path / "a.json"
    arguments = words(thickness=["0.1"], report=[str(report)])
    assert cli.main([*arguments, "--features", "-o", str(tmp_path / "a.stl")]) == 0
    data = json.loads(report.read_text())
    gap = data["minimum_gap"]
    assert gap["size"] == pytest.approx(2 * (2**0.5 / 6 - 0.1), abs=1e-6)
    assert gap["kind"] == "neck"
    assert len(gap["at"]) == 3
    assert data["minimum_thickness"]["size"] == pytest.approx(0.2)
    out = capfd.readouterr().out
    assert "minimum gap  0.271405 (neck)\n" in out
    assert "minimum thickness  0.2 (wall)\n" in out


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tile": ["gyroit"]}, "gyroid"),
        ({"tile": ["gyroid,iwq"]}, "iwp"),
        ({"seed": ["-1"]}, "seed"),
        ({"through": ["tours"]}, "torus"),
        ({"repeat": ["1", "0", "1"]}, "repeat"),
        ({"repeat": ["1", "x", "1"]}, "--repeat"),
        ({"repeat": ["2.6", "1", "1"]}, "--repeat"),
        ({"thickness": ["0.1+"]}, "0.1+"),
        ({"thickness": ["-0.1"]}, "-0.1"),
        ({"thickness": ["u + x"]}, "mixes u, v, w"),
        ({"thickness": ["u + q"]}, "unknown name 'q'"),
        ({"thickness": ["1/(u - u)"]}, "must be finite, but is inf at [0"),
        ({"thickness": ["1/0"]}, "not a finite number"),
        ({"thickness": ["os.system('true')"]}, "os.system"),
        ({"tol": ["0"]}, "tol"),
        ({"h": ["-1"]}, "h"),
        ({"tile": None}, "--tile"),
        ({"wall": ["0.1"]}, "--wall"),
    ],
)
def test_wrong_input_is_one_line_and_code_2(changes, message, tmp_path, capfd):
    target = tmp_path / "a.stl"
    err = fails([*words(**changes), "-o", str(target)], 2, capfd)
    assert message in err
    assert not target.exists()


def test_several_tiles_follow_each_other_or_are_drawn(tmp_path, capfd):
    report = tmp_path / "a.json"
    found = {}
    for seed in (None, ["4"]):
        changes = {"tile": ["gyroid, schwarz_p"], "repeat": ["2", "1", "1"], "seed": seed}
        arguments = words(**changes, thickness=["0.07"], report=[str(report)])
        assert cli.main([*arguments, "-o", str(tmp_path / "a.ply")]) == 0
        found[seed is None] = json.loads(report.read_text())
    capfd.readouterr()
    assert all(data["watertight"] for data in found.values())
    assert [found[key]["input"]["seed"] for key in (True, False)] == [None, 4]
    assert abs(found[True]["volume"] - found[False]["volume"]) > 1e-3


def test_tiles_follow_each_other_along_the_first_open_direction():
    torus = il.macroshape.torus()
    weight = _job.cell("gyroid,iwp,diamond", torus).weight
    u = np.array([[0.3, v, 0.4] for v in (1 / 3, 0.5, 2 / 3)])
    expected = [[0.5, 0.5, 0], [0, 1, 0], [0, 0.5, 0.5]]
    np.testing.assert_allclose(weight(u), expected, atol=0.05)
    assert isinstance(_job.cell("gyroid", torus), il.Tile)
    assert _job.cell("gyroid", torus, seed=1).weight is None


def test_slice_writes_layers(tmp_path, capfd):
    files = [tmp_path / name for name in ("a.cli", "a.svg", "a.3mf")]
    arguments = ["slice", *words()[1:], "--layer", "0.25", "--rough", "-o", *map(str, files)]
    assert cli.main(arguments) == 0
    out, err = capfd.readouterr()
    assert err == ""
    assert out.startswith("4 layers from 0 to 1\n")
    assert all(f"wrote  {path}\n" in out for path in files)
    assert files[1].read_text().count("<g ") == 4


def test_thin_walls_are_whole_and_their_reports_have_both_volumes(tmp_path, capfd):
    report = tmp_path / "a.json"
    thin = words(thickness=["0.002"], h=["0.04"], report=[str(report)])
    assert cli.main([*thin, "-o", str(tmp_path / "a.stl")]) == 0
    assert "of the wall" in capfd.readouterr().out
    data = json.loads(report.read_text())
    assert data["components"] == 1
    assert data["volume"] == pytest.approx(data["wall_volume"], rel=0.01)


def test_slices_have_their_own_endings(tmp_path, capfd):
    target = tmp_path / "a.stl"
    err = fails(["slice", *words()[1:], "--layer", "0.25", "-o", str(target)], 1, capfd)
    assert ".cli" in err
    err = fails(["slice", *words()[1:], "--layer", "0", "-o", str(tmp_path / "a.cli")], 2, capfd)
    assert "layer" in err


def test_warnings_are_lines_too(tmp_path, capfd):
    arguments = ["slice", *words(h=["0.12"])[1:], "--layer", "0.25", "--rough"]
    assert cli.main([*arguments, "-o", str(tmp_path / "a.cli")]) == 0
    err = capfd.readouterr().err
    assert err.startswith("ilattice: warning: h=0.12 is coarse")
    assert err.count("\n") == 1


@pytest.mark.parametrize("joined", [False, True])
def test_the_old_name_of_through_works_with_a_warning(joined, tmp_path, capfd):
    arguments = ["slice", *words(h=["0.1"], thickness=["0.2"])[1:], "--layer", "0.3", "--rough"]
    at = arguments.index("--through")
    old = list(arguments)
    old[at : at + 2] = [f"--map={arguments[at + 1]}"] if joined else ["--map", arguments[at + 1]]
    files = tmp_path / "new.cli", tmp_path / "old.cli"
    for command, file in zip((arguments, old), files, strict=True):
        capfd.readouterr()
        assert cli.main([*command, "-o", str(file)]) == 0
    assert "--map is called --through now" in capfd.readouterr().err
    assert files[0].read_bytes() == files[1].read_bytes()


def test_a_missing_directory_is_noticed_before_the_work(tmp_path, capfd, monkeypatch):
    monkeypatch.setattr("ilattice._job.volume", lambda _: pytest.fail("worked in vain"))
    err = fails([*words(), "-o", str(tmp_path / "no" / "a.stl")], 1, capfd)
    assert "directory" in err


def test_an_unknown_ending_is_noticed_before_the_work(tmp_path, capfd, monkeypatch):
    monkeypatch.setattr("ilattice._job.volume", lambda _: pytest.fail("worked in vain"))
    assert ".doc" in fails([*words(), "-o", str(tmp_path / "a.doc")], 1, capfd)


def test_a_file_that_is_no_volume_is_code_1(tmp_path, capfd):
    path = tmp_path / "volume.xml"
    path.write_text("<xml></xml>")
    assert "volume.xml" in fails(["info", str(path)], 1, capfd)


@pytest.mark.parametrize(
    ("error", "code"), [(MemoryError(), 1), (KeyboardInterrupt(), 130), (OSError(28, "full"), 1)]
)
def test_what_happens_to_anybody_is_one_line(error, code, capfd, monkeypatch):
    def stop(*_args, **_options):
        raise error

    monkeypatch.setattr("ilattice._job.build", stop)
    fails([*words(), "-o", "a.stl"], code, capfd)


def test_tiles_lists_the_catalogue(capfd):
    assert cli.main(["tiles"]) == 0
    lines = capfd.readouterr().out.splitlines()
    assert len(lines) > 25
    assert any(line.startswith("primitive ") and "schwarz_p" in line for line in lines)


@pytest.mark.parametrize("name", ["torus", "duck", "wing", "box", "tapered", "cylinder_shell"])
def test_info_tells_size_and_certificate(name, capfd):
    assert cli.main(["info", name]) == 0
    out = capfd.readouterr().out
    assert "VALID, right-handed" in out
    assert "volume" in out


def test_unknown_command_and_version(capfd):
    assert "bild" in fails(["bild"], 2, capfd)
    assert cli.main(["--version"]) == 0
    assert capfd.readouterr().out.strip() == __version__


def test_demo_leaves_its_files(tmp_path, capfd):
    assert cli.main(["demo", "--out", str(tmp_path / "new" / "demo"), "--h", "0.12"]) == 0
    assert "torus.stl" in capfd.readouterr().out
    folder = tmp_path / "new" / "demo"
    names = {"torus.stl", "torus.vtp", "macroshape.vtu", "torus.png", "report.json"}
    assert {path.name for path in folder.iterdir()} == names
    assert all(path.stat().st_size > 500 for path in folder.iterdir())
    data = json.loads((folder / "report.json").read_text())
    assert data["watertight"] is True
    assert data["components"] == 1
    assert {Path(file).name for file in data["files"]} == names


def test_warmup_says_how_long_it_took(capfd, monkeypatch):
    """Without its jobs, which are done before all tests, and take minutes."""
    for name in ("walls", "solids", "structures", "words"):
        monkeypatch.setattr(_warmup, name, lambda *_: None)
    monkeypatch.setattr(_warmup, "aside", lambda _: nullcontext())
    assert cli.main(["warmup"]) == 0
    out, err = capfd.readouterr()
    assert re.fullmatch(r"all kernels are compiled \(\d+ s\)\n", out)
    assert err == ""


def test_the_package_runs_as_a_module():
    done = subprocess.run(
        [sys.executable, "-m", "ilattice", "--version"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0
    assert __version__ in done.stdout
    done = subprocess.run([sys.executable, "-m", "ilattice", "sdf", "no-such-solid"], check=False,
                          capture_output=True, text=True)  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.startswith("ilattice: error: ")


@pytest.mark.parametrize("h", ["0", "nan", "inf", "-1"])
def test_lengths_are_refused_before_any_work(h, tmp_path, monkeypatch, capsys):
    """It took as long as all distances, and left a folder."""
    monkeypatch.chdir(tmp_path)
    part = ["--tile", "gyroid", "--through", "box", "--repeat", "1", "1", "1", "--thickness", "0.1"]
    started = []
    monkeypatch.setattr(il.Lattice, "offset", lambda *_, **__: started.append(1))
    for words in (
        ["demo", "--h", h],
        ["build", *part, "-o", "a.stl", "--h", h],
        ["slice", *part, "--layer", "0.1", "-o", "a.svg", "--h", h],
        ["slice", *part, "--layer", h, "-o", "a.svg"],
    ):
        assert cli.main(words) == 2
        assert capsys.readouterr().err.count("\n") == 1
    assert not started
    assert not list(tmp_path.iterdir())


def test_a_closed_standard_error_is_no_error(tmp_path, monkeypatch, capfd):
    """It ended in an error of the progress bar, and messages went to the output."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "stderr", None)
    words = ["sphere", "dilate", "t", "-s", "0.2", "-o", "a.ply", "--set", "t=0,0.1"]
    assert cli.main(["sdf", *words]) == 0
    assert len(list(tmp_path.glob("a_*.ply"))) == 2
    capfd.readouterr()
    assert cli.main(["sdf", "nonsense"]) == 2
    assert capfd.readouterr().out == ""


def test_homogenize_tells_moduli_and_writes_its_files(tmp_path, capfd):
    report, sphere = tmp_path / "r.json", tmp_path / "s.vtp"
    part = ["homogenize", "--tile", "gyroid", "--density", "0.8", "--cells", "6"]
    assert cli.main([*part, "--report", str(report), "--sphere", str(sphere)]) == 0
    out = capfd.readouterr().out
    data = json.loads(report.read_text())
    assert data["symmetry"] == "cubic"
    assert data["density"] == pytest.approx(0.8, abs=1e-3)
    assert 0.5 < data["E_x"] < 0.8
    assert f"bulk modulus  {data['K']:.6g}\n" in out
    assert "symmetry  cubic\n" in out
    assert sphere.stat().st_size > 1000
    assert all(f"wrote  {path}\n" in out for path in (report, sphere))


def test_homogenize_takes_voxels(tmp_path, capfd):
    layers = np.zeros((4, 4, 4), np.uint8)
    layers[2:] = 1
    np.save(tmp_path / "f.npy", layers)
    words = ["homogenize", "--voxels", str(tmp_path / "f.npy"), "--poisson", "0"]
    assert cli.main([*words, "--young", "1", "3"]) == 0
    assert "Young's moduli  1.5, 2, 2\n" in capfd.readouterr().out


def test_bands_are_tables_and_pictures(tmp_path, capfd):
    files = [tmp_path / name for name in ("b.csv", "b.json", "b.png")]
    part = ["bands", "--tile", "gyroid", "--density", "0.9", "--cells", "4", "--path", "GX"]
    assert cli.main([*part, "--steps", "2", "--count", "3", "-o", *map(str, files)]) == 0
    out = capfd.readouterr().out
    assert "wave vectors  3\n" in out
    assert all(f"wrote  {path}\n" in out for path in files)
    assert len(files[0].read_text().splitlines()) == 4
    assert len(json.loads(files[1].read_text())["omega"][0]) == 3
    assert files[2].read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        (["homogenize"], 2, "either --tile"),
        (["homogenize", "--tile", "gyroid", "--cells", "6.7"], 2, "--cells"),
        (["cost", "kagome", "--resolution", "2.5", "-o", "k.vtp"], 2, "--resolution"),
        (["homogenize", "--tile", "gyroid", "--voxels", "f.npy"], 2, "either --tile"),
        (["homogenize", "--tile", "gyroit"], 2, "gyroid"),
        (["homogenize", "--tile", "gyroid", "--density", "2"], 2, "relative_density"),
        (["homogenize", "--tile", "gyroid", "--density", "0.2", "--thickness", "1"], 2, "either"),
        (["homogenize", "--tile", "gyroid", "--young", "1", "2"], 2, "young"),
        (["homogenize", "--voxels", "no.npy"], 1, "no.npy"),
        (["homogenize", "--voxels", "no.npy", "--density", "0.3"], 2, "are for tiles"),
        (["homogenize", "--voxels", "no.npy", "--cells", "5"], 2, "--cells are for tiles"),
        (["homogenize", "--tile", "gyroid", "--sphere", "s.doc"], 1, "endings"),
        (["homogenize", "--tile", "gyroid", "--report", "no/r.json"], 1, "directory"),
        (["bands", "--tile", "gyroid"], 2, "--output"),
        (["bands", "--tile", "gyroid", "-o", "b.doc"], 1, "endings"),
        (["bands", "--tile", "gyroid", "-o", "b.csv", "b.csv"], 2, "twice"),
        (["bands", "--tile", "gyroid", "-o", "b.csv", "--path", "GQ"], 2, "'Q'"),
        (["bands", "--tile", "gyroid", "-o", "b.csv", "--count", "0"], 2, "count"),
        (
            ["bands", "--tile", "gyroid", "--density", ".5", "--mass", "-1", "-o", "b.csv"],
            2,
            "--mass must be one number, zero or more",
        ),
    ],
)
def test_wrong_words_of_cells_are_one_line(words, code, told, tmp_path, capfd, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert told in fails(words, code, capfd)
    assert not list(tmp_path.iterdir())
