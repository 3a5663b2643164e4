"""Commands from words to files: the shapes of the paper, reports, sweeps, and the command line."""

import csv
import json
import warnings

import numpy as np
import pytest

import ilattice as il
from ilattice import cli
from ilattice.errors import FormatError, GeometryError, InputError, PrecisionWarning
from ilattice.sdf import job
from ilattice.sdf.meshing import mesh, plan

TAU = 2 * np.pi


def solid_volume(command, n=60):
    """Volume by counting points of a fine grid about the solid."""
    field = il.sdf.parse(command)
    lo, hi = field.bounds
    axes = [lo[k] + (np.arange(n) + 0.5) * (hi[k] - lo[k]) / n for k in range(3)]
    p = np.stack([a.ravel() for a in np.meshgrid(*axes, indexing="ij")], axis=1)
    return (field(p) <= 0).mean() * np.prod(hi - lo)


PAPER = [  # every command of the paper, coarser
    ("sphere", 0.06, 4 * np.pi / 3),
    ("sphere scale 2,2,2", 0.12, 32 * np.pi / 3),
    ("cylinder box", 0.06, 2 * np.pi),
    ("x+y+z-1 box", 0.06, 8 - 4 / 3),
    ("box gyroid shell 2*0.35", 2 / 40, None),
    ("box scale 4,4,4 sphere scale 4,4,4 gyroid scale 4,4,4", 8 / 50, None),
    ("box scale 4,4,4 sphere scale 5,5,5 p-surface scale 4,4,4", 8 / 60, None),
    ("box scale 4,4,4 sphere scale 5,5,5 p-surface scale 4,4,4 d-surface scale 3.75,3.75,3.75 "
     "gyroid scale 1.25,1.25,1.25", 8 / 80, None),
    ("gyroid dilate 0.35 box", 0.05, None),
    ("gyroid complement erode 0.35 box", 0.05, None),
    ("gyroid dilate 0.1 shell '2*abs(0.3)' box", 0.05, None),
]  # fmt: skip


@pytest.mark.parametrize(("command", "h", "volume"), PAPER)
def test_commands_of_the_paper_make_watertight_solids(command, h, volume):
    found = mesh(il.sdf.parse(command), h)
    assert found.is_watertight
    assert found.is_oriented
    expected = solid_volume(command) if volume is None else volume
    assert found.volume == pytest.approx(expected, rel=0.01 if volume else 0.08)


@pytest.mark.parametrize("name", ["D", "P", "IWP", "Neovius", "C(Y)", "Lidinoid", "FRD"])
@pytest.mark.parametrize("how", ["dilate xi", "shell '2*xi'"])
def test_the_showcase_of_the_paper(name, how):
    xi = 0.35 if name != "FRD" else 0.55
    command = ["box", name, *how.replace("'", "").split()]
    with warnings.catch_warnings():  # of shells thinner than the spacing most is lost
        warnings.simplefilter("ignore", PrecisionWarning)
        found = mesh(il.sdf.parse(command, xi=xi), 2 / 40, allow_loss=True)
    assert found.is_watertight
    assert np.allclose(found.bounds, [[-1] * 3, [1] * 3])


def test_meshes_are_intersected_and_united(tmp_path):
    axes = [np.linspace(-2.5, 2.5, 41)] * 3
    il.mesh.contour(il.fields.sphere(2.0), axes).save(tmp_path / "mesh1.ply")
    il.mesh.contour(il.fields.box(1.5), axes).save(tmp_path / "mesh2.ply")
    words = [str(tmp_path / "mesh1.ply"), "gyroid", "intersection", str(tmp_path / "mesh2.ply")]
    found = mesh(il.sdf.parse([*words, "p-surface", "intersection", "union"]), 0.1)
    assert found.is_watertight
    np.testing.assert_allclose(found.bounds, [[-2] * 3, [2] * 3], atol=0.1)


def test_faces_of_boxes_are_exact():
    found = mesh(il.sdf.parse("box scale 1,2,0.5 translate 0.1,0,0 sphere scale 5"), 0.3)
    assert found.volume == pytest.approx(8.0, rel=1e-12)
    np.testing.assert_allclose(found.bounds, [[-0.9, -2, -0.5], [1.1, 2, 0.5]], atol=1e-15)


def test_the_mesh_of_a_tolerance_keeps_it():
    found = mesh(il.sdf.parse("sphere"), tol=2e-3)
    middle = found.vertices[found.faces].mean(axis=1)
    assert np.percentile(np.abs(1 - np.linalg.norm(middle, axis=1)), 90) <= 2e-3
    assert len(mesh(il.sdf.parse("sphere"), tol=5e-5).faces) > 3 * len(found.faces)


@pytest.mark.parametrize(
    ("command", "error", "message"),
    [
        ("gyroid", InputError, "no end along x, y, z"),
        ("cylinder", InputError, "no end along z"),
        ("sphere sphere translate 5,0,0", GeometryError, "empty"),
        ("sphere 'x^2 + 1'", GeometryError, "ranges over"),
        ("sphere 'log(x)'", GeometryError, "NaN"),
        ("sphere -s 0", InputError, "-s at word 3 '0'"),
        ("sphere -s 1,2", InputError, "-s at word 3"),
        ("sphere -s x", InputError, "without x"),
        ("sphere -s 1e-9", InputError, "planes"),
        ("sphere gyroid -s 2/20000", InputError, "GB"),
        ("sphere --tol 0.1 -s 1", InputError, "either"),
        ("sphere -s 1 -s 2", InputError, "twice"),
        ("sphere -s", InputError, "must follow"),
        ("sphere --set x=1", InputError, "--set at word 3"),
        ("sphere --set a", InputError, "--set"),
        ("sphere -o a.xyz", FormatError, ".ply"),
        ("sphere -o nowhere/a.ply", InputError, "no directory"),
        ("sphere --memory 0.1 -s 2/400", InputError, "allowed are 0.1 GB"),
    ],
)
def test_what_cannot_be_meshed_says_why(command, error, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error) as caught:
        job.run(command)
    assert message in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_the_estimate_is_right_within_a_few_percent():
    for command in ("sphere", "box gyroid shell 0.6"):
        part = plan(il.sdf.parse(command), 2 / 60)
        assert part.triangles() == pytest.approx(len(part.mesh().faces), rel=0.1)


def test_the_command_line_writes_mesh_and_report(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    words = [
        "sdf",
        "-s",
        "2/20",
        "box",
        "sphere",
        "difference",
        "--report",
        "r.json",
        "-o",
        "a.stl",
    ]
    assert cli.main(words) == 0
    assert "wrote  a.stl" in capfd.readouterr().out
    report = json.loads((tmp_path / "r.json").read_text())
    assert report["watertight"] is True
    assert report["command"] == ["box", "sphere", "difference"]
    assert report["volume"] == pytest.approx(8 - 4 * np.pi / 3, rel=0.02)
    before = (tmp_path / "a.stl").read_bytes()
    assert cli.main(words) == 0
    assert (tmp_path / "a.stl").read_bytes() == before


def test_the_default_output_is_a_ply_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["sdf", "sphere", "-s=0.2"]) == 0
    assert il.mesh.load("out.ply").is_watertight


def test_a_dry_run_writes_nothing(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["sdf", "--dry-run", "sphere", "dilate", "0.1", "-s", "0.1"]) == 0
    out = capfd.readouterr().out
    assert out.startswith("dilate offset 0.1\n  sphere\n")
    assert "[25, 25, 25]" in out
    assert not list(tmp_path.iterdir())


def test_a_dry_run_of_a_sweep_describes_its_first_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    report = job.run("sphere dilate a --set a=0.1,0.2 --dry-run -s 0.1")
    assert report["runs"] == 2
    assert report["grid"] == job.run("sphere dilate 0.1 --dry-run -s 0.1")["grid"]
    assert not list(tmp_path.iterdir())


def test_slices_of_a_solid(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    job.run("sphere --slices 0.25 -s 0.1 -o a.svg")
    assert (tmp_path / "a.svg").read_text().count("<g ") == 8
    with pytest.raises(FormatError):
        job.run("sphere --slices 0.25 -o a.stl")


def test_sweeps_fill_a_table_and_go_on_after_an_interruption(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    command = "shape dilate a box scale 2 -s 0.2 --set a=0.1,0.2 --set shape=sphere,gyroid -o s.stl"
    rows = job.run(command)["rows"]
    assert [(r["a"], r["shape"]) for r in rows] == [
        ("0.1", "sphere"), ("0.1", "gyroid"), ("0.2", "sphere"), ("0.2", "gyroid"),
    ]  # fmt: skip
    assert float(rows[0]["volume"]) == pytest.approx(4 / 3 * np.pi * 1.1**3, rel=0.05)
    table = (tmp_path / "s.csv").read_bytes()
    with (tmp_path / "s.csv").open() as file:
        assert [r["watertight"] for r in csv.DictReader(file)] == ["True"] * 4
    made = {p: p.stat().st_mtime_ns for p in tmp_path.glob("*.stl")}
    assert len(made) == 4
    lost = tmp_path / "s_a=0.2_shape=sphere.stl"
    lost.unlink()
    job.run(command)
    assert (tmp_path / "s.csv").read_bytes() == table
    again = {p for p, t in made.items() if p.stat().st_mtime_ns != t}
    assert again == {lost}


def test_a_sweep_of_other_slices_makes_them_anew(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for thickness, layers, name in ((0.5, 4, "a"), (0.25, 8, "b")):
        job.run(f"sphere scale a --set a=1 --slices {thickness} -s 0.2 -o {name}.svg --table t.csv")
        assert (tmp_path / f"{name}_a=1.svg").read_text().count("<g ") == layers
    with pytest.raises(InputError, match="is the file of another row"):
        job.run("sphere scale a --set a=1 --slices 0.1 -s 0.2 -o b.svg --table t.csv")


def test_failures_of_a_sweep_are_rows_of_the_table(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rows = job.run("sphere 'x^2 + a' -s 0.2 --set a=-0.1,5")["rows"]
    assert [bool(r["message"]) for r in rows] == [False, True]
    assert rows[1]["file"] == ""


@pytest.mark.parametrize(("words", "code"), [(["gyriod"], 2), (["sphere", "x^2+1"], 1), ([], 0)])
def test_exit_codes(words, code, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["sdf", *words]) == code
    out, err = capfd.readouterr()
    assert bool(err) == (code > 0)
    assert bool(out) == (code == 0)


def test_round_trips_do_not_wear_meshes_out(tmp_path):
    field, h = il.sdf.parse("box sphere gyroid"), 2 / 24
    true = il.sdf.MeshDistance(mesh(field, h / 4))
    errors, found, path = [], mesh(field, h), tmp_path / "a.ply"
    for _ in range(9):
        x = np.asarray(found.vertices, float)
        errors.append(np.abs(true(np.concatenate([x, x[found.faces].mean(axis=1)]))))
        found.save(path)
        found = mesh(il.sdf.parse([str(path)]), h)
        assert found.is_watertight
    assert all(e.max() < 1.5 * errors[0].max() for e in errors)
    assert all(np.sqrt((e**2).mean()) < 1.5 * np.sqrt((errors[0] ** 2).mean()) for e in errors)
    assert errors[0].max() < 0.6 * h


HIERARCHY = (  # Figure 5 of the paper, smaller
    ("box scale 1.2", "sphere scale 1.5"),
    ("p-surface scale 4 translate 2,2,2",),
    ("d-surface scale 3.75",),
    ("gyroid scale 1.25",),
)


def test_hierarchies_may_be_meshed_step_by_step(tmp_path):
    """Each step from the file of the one before; against the parts divided by their slopes."""
    h, path, words = 4 / 50, tmp_path / "a.ply", []
    for step in HIERARCHY:
        before = [str(path)] if words else []
        found = mesh(il.sdf.parse([*before, *" ".join(step).split()]), h)
        found.save(path)
        words += step
        assert found.is_watertight
    direct = mesh(il.sdf.parse(" ".join(words)), h)
    parts = [il.fields.normalize(il.sdf.parse(word)) for word in words]
    errors = []
    for made in (direct, found):
        x = np.asarray(made.vertices, float)
        points = np.concatenate([x, x[made.faces].mean(axis=1)])
        errors.append(np.abs(np.max([part(points) for part in parts], axis=0)))
    assert found.volume == pytest.approx(direct.volume, rel=0.05)
    for size in (np.max, lambda e: np.sqrt((e**2).mean())):
        assert size(errors[1]) < 2 * size(errors[0])
