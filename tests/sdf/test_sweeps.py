"""Sweeps: tables that lose nothing, whoever kills, changes or repeats them."""

import csv
import os
import random
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import ilattice as il
from ilattice import cli
from ilattice.errors import FormatError, InputError
from ilattice.io import table
from ilattice.io.table import Table, digest
from ilattice.sdf import job

KILLS = int(os.environ.get("ILATTICE_KILLS", "6"))
SWEEP = "sphere dilate t -s 0.2 -o a.ply"


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def everything(folder):
    return {p.name: p.read_bytes() for p in folder.iterdir()}


# --- refused before any work --------------------------------------------------------------------


@pytest.mark.parametrize("content", ["x,y,z,measured\n1,2,3,4\n", "", "t,command\n0,a\n", "\0\xff"])
@pytest.mark.parametrize("option", ["--table a.csv", ""])
def test_tables_of_others_are_left_alone(here, content, option):
    (here / "a.csv").write_text(content, "latin-1")
    if not content:  # nothing to lose
        assert len(job.run(f"{SWEEP} --set t=0,0.1 {option}")["rows"]) == 2
        return
    before = everything(here)
    with pytest.raises(FormatError, match=r"'a\.csv' is not one of this sweep.*name another file"):
        job.run(f"{SWEEP} --set t=0,0.1 {option}")
    assert everything(here) == before


@pytest.mark.parametrize("name", ["F", "gyroid", "S", "Box", "p-surface", "scale", "PI", "x"])
def test_words_of_the_language_stand_for_nothing_else(here, name):
    with pytest.raises(InputError, match="no meaning yet"):
        job.run(f"box {name} -s 0.2 -o a.ply --set {name}=0.1,0.2")
    if name.isidentifier():
        with pytest.raises(InputError, match="has a meaning already"):
            il.sdf.parse(f"box {name}", **{name: "sphere"})
    assert not list(here.iterdir())


def test_capitals_make_no_other_name():
    with pytest.raises(InputError, match="capitals"):
        job.run("sphere dilate T -s 0.2 -o a.ply --set T=0.2 --set t=1")
    with pytest.raises(InputError, match="same name"):
        il.sdf.parse("sphere dilate T+t", T=0.2, t=0.1)
    with pytest.raises(InputError, match="capitals"):
        il.fields.equation("T + t", names={"T": 0.2, "t": 0.1})
    with pytest.raises(InputError, match="has a meaning already"):
        il.fields.equation("x + a", names={"a": 0.2, "X": 0.1})
    assert il.fields.equation("T*x", names={"T": 3.0})([[2.0, 0.0, 0.0]]) == 6.0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--set t=1/4,1*4", "'t=1/4' and 't=1\\*4' would both write"),
        ("--set t=0.1,0.2,0.1", "would both write 'a_t=0.1.ply'"),
        ("--set t=0.1,,0.2", "there is nothing between two commas"),
        ("--set t=0.1,", "there is nothing between two commas"),
        ("--set t=1 --set rr=2", "'rr' stands for a value"),
        ("--set t=1 --set volume=1,2", "'volume' is a column of the table"),
        ("--set t=1 --set command=1", "'command' is a column of the table"),
        ("--table b.csv", "--table is for the rows of a sweep"),
        ("--set t=1 --table a_t=1.ply", "-o and --table name the same file"),
        ("--set t=1 --report a_t=1.ply", "--report and -o name the same file"),
        ("--set t=1 --report a.csv", "--report and --table name the same file"),
        ("--report a.ply", "-o and --report name the same file"),
        ("--report ./b/../a.ply", "-o and --report name the same file"),
        (f"--set t=1,{'1' * 300}", "would be too long"),
    ],
)
def test_what_would_be_lost_is_refused_before_any_work(here, words, message):
    (here / "b").mkdir()
    with pytest.raises(InputError, match=message):
        job.run(f"sphere dilate {'t' if 't=' in words else '1'} -s 0.2 -o a.ply {words}")
    assert [p.name for p in here.iterdir()] == ["b"]


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("sphere dilate t -s 0.2 --set t=0,0.1", "box dilate t -s 0.2 --set t=0.1"),
        ("sphere dilate t -s 0.2 --set t=0,0.1", "sphere dilate t -s 0.15 --set t=0.2,0.1"),
        ("sphere dilate t -s 0.2 --set t=1/4", "sphere dilate t -s 0.2 --set t=1*4"),
    ],
)
@pytest.mark.parametrize("way", ["", "./b/../"])
def test_meshes_of_other_rows_are_not_overwritten(here, first, second, way):
    (here / "b").mkdir()
    job.run(f"{first} -o a.ply --table t.csv")
    before = {p.name: p.read_bytes() for p in here.iterdir() if p.is_file()}
    with pytest.raises(InputError, match=r"is the file of another row of 't\.csv'.*choose another"):
        job.run(f"{second} -o {way}a.ply --table t.csv")
    assert {p.name: p.read_bytes() for p in here.iterdir() if p.is_file()} == before
    job.run(f"{second} -o c.ply --table t.csv")
    for path in here.glob("a_*"):
        path.unlink()
    job.run(f"{second} -o a.ply --table t.csv")  # nothing to lose any more


@pytest.mark.parametrize("other", ["sphere dilate t -s 0.2", "box dilate t -s 0.2"])
def test_files_of_another_table_are_not_overwritten(here, other):
    """They used to be, as no table knows of the rows of another one."""
    job.run(f"{SWEEP} --set t=0,0.1 --table one.csv")
    before = everything(here)
    with pytest.raises(InputError, match=r"'a_t=0\.1\.ply' is there, and of no row of 'two\.csv'"):
        job.run(f"{other} -o a.ply --set t=0.3,0.1 --table two.csv")
    assert everything(here) == before


def test_files_that_appear_during_a_sweep_are_not_overwritten(here):
    def another(_, done, __):
        if done == 1:
            (here / "a_t=0.1.ply").write_text("of somebody else")

    with pytest.raises(InputError, match=r"'a_t=0\.1\.ply' is there"):
        job.run(f"{SWEEP} --set t=0,0.1", progress=another)
    assert (here / "a_t=0.1.ply").read_text() == "of somebody else"
    assert [r["t"] for r in rows(here / "a.csv")] == ["0"]
    assert not list(here.glob(".*"))


def test_another_output_is_written_too(here):
    """Rows were taken for done whatever -o said."""
    job.run(f"{SWEEP} --set t=0,0.1 --table t.csv")
    before = everything(here)
    found = job.run("sphere dilate t -s 0.2 -o b.ply --set t=0,0.1 --table t.csv")
    assert [r["file"] for r in found["rows"]] == ["b_t=0.ply", "b_t=0.1.ply"]
    assert [r["file"] for r in rows(here / "t.csv")] == ["b_t=0.ply", "b_t=0.1.ply"]
    for t in ("0", "0.1"):
        assert everything(here)[f"b_t={t}.ply"] == before[f"a_t={t}.ply"]


@pytest.mark.parametrize("step", ["append", "replace"])
def test_runs_that_end_between_file_and_row_do_not_bar_the_next(here, monkeypatch, step):
    job.run(f"{SWEEP} --set t=0,0.1")
    calm = everything(here)
    for path in here.iterdir():
        path.unlink()

    def die(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Table if step == "append" else table, step, die)
        with pytest.raises(KeyboardInterrupt):
            job.run(f"{SWEEP} --set t=0,0.1")
    assert not list(here.glob("*.ply"))
    job.run(f"{SWEEP} --set t=0,0.1")
    assert everything(here) == calm


@pytest.mark.skipif(sys.platform == "win32", reason="needs limits of the file size")
def test_a_table_that_outgrows_a_limit_says_so_and_stays_whole(here):
    import resource

    job.run(f"{SWEEP} --set t=0,0.1")
    before = (here / "a.csv").read_bytes()
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    with Table("a.csv", ["t"], job.MEASURES) as table:
        resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) + 10, old[1]))
        try:
            with pytest.raises(FormatError, match=r"larger than files may be here"):
                table.append({"t": "0.5", "command": "c"})
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, old)
        assert (here / "a.csv").read_bytes() == before


@pytest.mark.parametrize(
    "words", ["p.stl -s 0.2", "@p.stl", "part --set part=p.stl", "p.stl t --set t=box"]
)
def test_pipes_are_no_input_and_are_called_so(here, words, capsys):
    os.mkfifo(here / "p.stl")
    assert cli.main(["sdf", *words.split()]) == 1
    assert "is not a regular file" in capsys.readouterr().err


@pytest.mark.parametrize("words", [[""], ["box", ""], ["", "-s", "0.5"], [" "]])
def test_empty_words_are_an_error(words, capsys):
    assert cli.main(["sdf", *words]) == 2
    assert "neither a name nor a file" in capsys.readouterr().err


@pytest.mark.parametrize("words", ["-o a.ply --report part.stl", "-o part_t=1.stl --report a.json"])
def test_reports_and_runs_do_not_overwrite_what_is_read(here, words):
    il.sdf.mesh(il.fields.sphere(1.0), 0.2).save("part.stl")
    il.sdf.mesh(il.fields.sphere(1.0), 0.2).save("part_t=1.stl")
    if "t=1" in words:
        words, name = "-o part.stl --set t=1", "part_t=1.stl"
    else:
        words, name = f"{words} --set t=1", "part.stl"
    before = everything(here)
    with pytest.raises(InputError, match="name the same file"):
        job.run(f"{name} dilate t -s 0.2 {words}")
    assert everything(here) == before


# --- rows are kept, and right ---------------------------------------------------------------------


def test_rows_of_other_commands_are_kept(here):
    job.run(f"{SWEEP} --set t=0,0.1")
    before = (here / "a.csv").read_bytes()
    job.run("box dilate t -s 0.2 -o b.ply --table a.csv --set t=0,0.2")
    job.run("sphere dilate t -s 0.15 -o c.ply --table a.csv --set t=0")
    after = (here / "a.csv").read_bytes()
    assert after.startswith(before)
    assert [r["t"] for r in rows(here / "a.csv")] == ["0", "0.1", "0", "0.2", "0"]
    assert job.run(f"{SWEEP} --set t=0,0.1")["rows"][1]["t"] == "0.1"
    assert (here / "a.csv").read_bytes() == after


def test_known_rows_are_returned_as_they_were_measured():
    first = job.run(f"{SWEEP} --set t=0,0.1")["rows"]
    assert job.run(f"{SWEEP} --set t=0,0.1")["rows"] == first


def test_an_interrupted_resume_loses_no_row(here):
    job.run(f"{SWEEP} --set t=0,0.1,0.2")

    def interrupt(*_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        job.run(f"{SWEEP} --set t=0.3,0,0.1,0.2", progress=interrupt)
    assert [r["t"] for r in rows(here / "a.csv")] == ["0", "0.1", "0.2", "0.3"]


def test_changed_inputs_are_computed_anew(here):
    volumes = []
    for radius in (1.0, 2.0, 2.0, 1.0):
        axes = [np.linspace(-2.2, 2.2, 23)] * 3
        il.mesh.contour(il.fields.sphere(radius), axes).save("part.stl")
        volumes.append(
            [r["volume"] for r in job.run("part.stl dilate t -s 0.2 --set t=0,0.1")["rows"]]
        )
    assert volumes[1][0] == pytest.approx(8 * volumes[0][0], rel=0.1)
    assert volumes[2] == volumes[1]
    assert volumes[3] == volumes[0]
    assert [r["t"] for r in rows(here / "out.csv")] == ["0", "0.1"]  # one row for each run
    assert [float(r["volume"]) for r in rows(here / "out.csv")] == volumes[3]


def test_failures_that_pass_leave_no_trace(here, monkeypatch):
    """A run fails for a while; made again, its row stands where it would have stood."""
    job.run(f"{SWEEP} --set t=0,0.1,0.2")
    calm = (here / "a.csv").read_bytes()
    for path in here.iterdir():
        path.unlink()
    mesh, fails = job.mesh, [True, False, True]

    def full(*arguments, **options):
        if fails.pop():
            raise FormatError("the disk is full")
        return mesh(*arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(job, "mesh", full)
        found = job.run(f"{SWEEP} --set t=0,0.1,0.2")["rows"]
    assert [r["message"] for r in found] == ["the disk is full", "", "the disk is full"]
    failed = (here / "a.csv").read_bytes()

    def interrupt(_, done, __):
        if done == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):  # before the rows are put in their places
        job.run(f"{SWEEP} --set t=0,0.1,0.2", progress=interrupt)
    assert (here / "a.csv").read_bytes().startswith(failed)
    job.run(f"{SWEEP} --set t=0,0.1,0.2")
    assert (here / "a.csv").read_bytes() == calm
    assert not list(here.glob(".*"))


def test_a_sweep_without_any_row_leaves_no_table(here, monkeypatch):
    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(job, "mesh", stop)
    with pytest.raises(KeyboardInterrupt):
        job.run(f"{SWEEP} --set t=0")
    assert not list(here.iterdir())


def test_one_sweep_at_a_time_writes_to_a_table(here):
    pytest.importorskip("fcntl")
    refused = []

    def another(_, done, __):
        with pytest.raises(FormatError, match="another sweep is writing to it; wait") as caught:
            job.run(f"{SWEEP} --set t=0,0.1")
        refused.append((done, str(caught.value)))

    job.run(f"{SWEEP} --set t=0,0.1", progress=another)
    assert [done for done, _ in refused] == [1, 2]
    whole = (here / "a.csv").read_bytes()
    job.run(f"{SWEEP} --set t=0,0.1")
    assert (here / "a.csv").read_bytes() == whole


def test_equal_sweeps_at_a_time_write_every_row_once(here):
    pytest.importorskip("fcntl")
    program = (
        "import sys; from ilattice import cli; sys.exit(cli.main(['sdf', *sys.argv[1].split()]))"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", program, f"{SWEEP} --set t=0,0.1,0.2,0.3"]
    children = [
        subprocess.Popen(command, env=environment, stderr=subprocess.PIPE) for _ in range(3)
    ]
    errors = [child.communicate(timeout=300)[1] for child in children]
    for child, error in zip(children, errors, strict=True):
        assert child.returncode == (1 if b"another sweep" in error else 0)
    assert any(child.returncode == 0 for child in children)
    assert [r["t"] for r in rows(here / "a.csv")] == ["0", "0.1", "0.2", "0.3"]
    assert not list(here.glob(".*"))


@pytest.mark.parametrize("mend", ["crlf", "mark", "both"])
def test_tables_from_spreadsheets_are_refused_with_the_reason(here, mend):
    job.run(f"{SWEEP} --set t=0,0.1")
    data = (here / "a.csv").read_bytes()
    if mend != "mark":
        data = data.replace(b"\n", b"\r\n")
    if mend != "crlf":
        data = b"\xef\xbb\xbf" + data
    (here / "a.csv").write_bytes(data)
    with pytest.raises(FormatError, match=r"byte order mark or .*CRLF.*save it as plain UTF-8"):
        job.run(f"{SWEEP} --set t=0,0.1")
    assert (here / "a.csv").read_bytes() == data


def test_loose_parts_are_in_the_table(here):
    job.run("sphere sphere translate 3,0,0 union dilate t -s 0.2 -o a.ply --set t=0,2")
    assert [r["islands"] for r in rows(here / "a.csv")] == ["1", "0"]


def test_the_output_of_a_row_is_what_was_written(here):
    job.run(f"{SWEEP} --set t=0,0.1")
    whole = everything(here)
    (here / "a_t=0.ply").write_text("something else")
    (here / "a_t=0.1.ply").unlink()
    job.run(f"{SWEEP} --set t=0,0.1")
    assert everything(here) == whole


def test_values_may_be_files():
    for name, radius in (("p.stl", 1.0), ("q.stl", 0.5)):
        il.sdf.mesh(il.fields.sphere(radius), 0.1).save(name)
    found = job.run("part -s 0.1 --set part=p.stl,q.stl")["rows"]
    assert found[0]["inputs"] == digest("p.stl")
    assert found[1]["inputs"] == digest("q.stl")
    assert found[0]["volume"] > 6 * found[1]["volume"]


# --- killed at any moment -------------------------------------------------------------------------


def test_any_prefix_of_a_table_is_completed_to_the_same_bytes(here):
    path, results = here / "t.csv", ("volume",)
    runs = [{"a": f"{i}/7", "b": 'w "x", y', "volume": i / 7, "command": "c\nd"} for i in range(9)]

    def fill():
        with Table(path, ("a", "b"), results) as table:
            for run in runs:
                table.append({**run, "version": "1"})

    fill()
    whole = path.read_bytes()
    for cut in [*range(0, len(whole), 7), len(whole)]:
        path.write_bytes(whole[:cut])
        fill()
        assert path.read_bytes() == whole


def test_killed_sweeps_end_with_the_same_table(here):
    """The process is stopped at random moments and started again until it is done."""
    command = "sphere dilate t -o a.stl -s 0.11 --set t=0,.01,.02,.03,.04,.05,-5"
    (here / "calm").mkdir()
    (here / "wild").mkdir()
    os.chdir(here / "calm")
    start = time.perf_counter()
    assert job.run(command)["rows"][-1]["message"]
    span = time.perf_counter() - start
    rng, kills = random.Random(17), 0
    program = (
        "import sys; from ilattice.sdf import job, mesh, parse; import ilattice.io.ply; "
        "print('go', flush=True); job.run(sys.argv[1])"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    while kills < KILLS:
        child = subprocess.Popen(
            [sys.executable, "-c", program, command],
            cwd=here / "wild", env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        child.stdout.readline()
        time.sleep(rng.uniform(0, span if kills % 4 else 0.3 * span))
        child.send_signal(
            rng.choice([signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
        )
        kills += child.wait() != 0
        child.stdout.close()
        if kills and rng.random() < 0.2:
            for path in (here / "wild").glob("a*"):
                path.unlink()
    os.chdir(here / "wild")
    job.run(command)
    calm, wild = everything(here / "calm"), everything(here / "wild")
    assert wild == calm


def test_lines_that_somebody_has_edited_are_named(here):
    job.run(f"{SWEEP} --set t=0,0.1")
    text = (here / "a.csv").read_text()
    (here / "a.csv").write_text(text + "more,of,this\n")
    with pytest.raises(FormatError, match=r"line 4: is no row of \d+ columns"):
        job.run(f"{SWEEP} --set t=0,0.1")


# --- reports, names and inputs ------------------------------------------------------------------


def test_a_resumed_sweep_has_the_report_of_one_that_was_not(here):
    words = f"{SWEEP} --set t=0,0.1,-0.05 --report r.json"
    job.run(words)
    whole = (here / "r.json").read_bytes()
    lines = (here / "a.csv").read_bytes().splitlines(keepends=True)
    (here / "a.csv").write_bytes(b"".join(lines[:3]))
    job.run(words)
    assert (here / "r.json").read_bytes() == whole


def test_names_of_files_need_not_be_text(here):
    name = os.fsdecode(b"o_\xff.stl")
    found = job.run(["sphere", "dilate", "t", "-s", "0.2", "--set", "t=0", "-o", name])
    assert all((here / row["file"]).stat().st_size for row in found["rows"])


def test_tables_are_the_same_in_every_locale(here):
    """Names in UTF-8 are bytes to a process that runs in the locale C."""
    program = "import sys; from ilattice import cli; sys.exit(cli.main(sys.argv[1:]))"
    words = ["sdf", "sphere", "dilate", "t", "-s", "0.2", "--set", "t=0", "-o", "ö.ply"]
    path = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    plain = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    tables = []
    for environment in (path | plain, path | {"PYTHONUTF8": "1"}):
        command = [sys.executable, "-c", program, *words]
        done = subprocess.run(command, env=environment, capture_output=True, timeout=300)
        assert done.returncode == 0, done.stderr
        tables.append((here / "\u00f6.csv").read_bytes())
    assert tables[0] == tables[1]
    assert "\u00f6_t=0.ply" in tables[0].decode()


def test_a_run_does_not_write_over_its_input(here):
    job.run("sphere -s 0.2 -o in.stl")
    (here / "same.stl").symlink_to("in.stl")
    before = (here / "in.stl").read_bytes()
    for output in ("in.stl", "same.stl"):
        with pytest.raises(InputError, match="name the same file"):
            job.run(f"in.stl dilate 0.1 -s 0.2 -o {output}")
    assert (here / "in.stl").read_bytes() == before


def test_nothing_is_written_over_the_words(here):
    (here / "w.txt").write_text("sphere -s 0.2")
    for words in ("--report w.txt", "--report ./w.txt", "dilate t --set t=1 --table w.txt"):
        with pytest.raises((InputError, FormatError), match="name the same file"):
            job.run(f"@w.txt {words} -o a.ply")
    assert (here / "w.txt").read_text() == "sphere -s 0.2"
    assert job.run("@w.txt -o a.ply")["files"] == ["a.ply"]


def test_a_sweep_of_which_no_run_succeeds_fails(here, capsys):
    assert (
        cli.main(["sdf", "sphere", "erode", "t", "-s", "0.2", "-o", "a.ply", "--set", "t=3,4"]) == 1
    )
    assert "none of the 2 runs" in capsys.readouterr().err
    assert len(rows(here / "a.csv")) == 2


# --- where a table is ---------------------------------------------------------------------------


def test_files_of_rows_are_seen_from_the_table(here, monkeypatch):
    """A file of the same name in another working directory is not that of the row."""
    job.run(f"{SWEEP} --set t=0.1")
    (here / "w").mkdir()
    (here / "w" / "a_t=0.1.ply").write_text("precious")
    monkeypatch.chdir(here / "w")
    with pytest.raises(FormatError, match="is there, and of no row"):
        job.run(f"{SWEEP} --set t=0.1 --table ../a.csv")
    assert (here / "w" / "a_t=0.1.ply").read_text() == "precious"
    before = (here / "a.csv").read_bytes()
    command = SWEEP.replace("a.ply", "../a.ply")
    found = job.run(f"{command} --set t=0.1 --table ../a.csv")["rows"]
    assert found[0]["file"] == os.path.join("..", "a_t=0.1.ply")
    assert (here / "a.csv").read_bytes() == before
    job.run(f"{SWEEP.replace('a.ply', 'b.ply')} --set t=0.2 --table ../a.csv")
    assert rows(here / "a.csv")[1]["file"] == os.path.join("w", "b_t=0.2.ply")


def test_a_row_without_its_end_of_line_is_kept(here):
    job.run(f"{SWEEP} --set t=0.1")
    job.run("box dilate t -s 0.2 -o b.ply --set t=0.1,0.2 --table a.csv")
    whole = (here / "a.csv").read_bytes()
    (here / "a.csv").write_bytes(whole[:-1])
    job.run(f"{SWEEP} --set t=0.1")
    assert (here / "a.csv").read_bytes() == whole
    (here / "a.csv").write_bytes(whole[:-1])
    job.run(f"{SWEEP} --set t=0.3 --table a.csv")
    assert (here / "a.csv").read_bytes().startswith(whole)
    assert len(rows(here / "a.csv")) == 4
    for cut in (2, 20, 40):  # what is not whole is made again
        (here / "a.csv").write_bytes(whole[:-cut])
        (here / "b_t=0.2.ply").unlink()
        job.run("box dilate t -s 0.2 -o b.ply --set t=0.1,0.2 --table a.csv")
        assert (here / "a.csv").read_bytes() == whole


@pytest.mark.parametrize("content", [b"", b"t", b"t,volume,area"])
def test_a_refused_sweep_leaves_the_beginning_of_a_table(here, content):
    (here / "a.csv").write_bytes(content)
    (here / "a_t=0.1.ply").write_text("precious")
    before = everything(here)
    with pytest.raises(FormatError, match="of no row"):
        job.run(f"{SWEEP} --set t=0.1")
    assert everything(here) == before
    (here / "a.csv").unlink()
    with pytest.raises(FormatError, match="of no row"):
        job.run(f"{SWEEP} --set t=0.1")
    assert [p.name for p in here.iterdir()] == ["a_t=0.1.ply"]


def test_a_table_is_a_regular_file(here):
    with pytest.raises(FormatError, match="is not a regular file"):
        job.run(f"{SWEEP} --set t=0.1 --table /dev/null")
    assert not list(here.iterdir())


def test_digests_can_be_checked_by_others(here):
    import hashlib

    job.run(f"{SWEEP} --set t=0.1")
    found = rows(here / "a.csv")[0]
    data = (here / found["file"]).read_bytes()
    assert hashlib.sha256(data).hexdigest().startswith(found["output"])
