"""What must hold whoever calls: terminals, pipes, pickles, numbers that are none, file formats."""

import copy
import os
import pickle
import re
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from spline_zoo import ZOO

import ilattice as il
from ilattice import cli
from ilattice.errors import FormatError, GeometryError, InputError
from ilattice.sdf import job

MAIN = [sys.executable, "-m", "ilattice"]
PATH = {"PYTHONPATH": os.pathsep.join(sys.path)}


# --- the command line -----------------------------------------------------------------------------


@pytest.mark.parametrize("coding", ["ascii", "latin-1"])
def test_terminals_of_any_encoding(coding):
    environment = {**os.environ, **PATH, "PYTHONIOENCODING": coding}
    for words in (["info", "box"], ["sdf", "γύρος"], ["info", "кино.xml"]):
        done = subprocess.run(
            [*MAIN, *words], env=environment, capture_output=True, timeout=300, check=False
        )
        assert b"Traceback" not in done.stderr
        assert done.returncode == {"box": 0, "γύρος": 2, "кино.xml": 1}[words[1]]
        assert done.stderr.count(b"\n") == (words[1] != "box")


@pytest.mark.parametrize("words", [["sdf", "-h"], ["tiles"], ["info", "box"]])
def test_whoever_reads_may_stop_reading(words):
    environment = {**os.environ, **PATH, "PYTHONUNBUFFERED": "1"}
    child = subprocess.Popen(
        [*MAIN, *words], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    child.stdout.close()
    _, err = child.communicate(timeout=300)
    assert (child.returncode, err) == (0, b"")


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["sdf", "sphere", "-o", "."], 1),
        (["sdf", "sphere", "-o", "no/a.stl"], 1),
        (["sdf", "sphere", "-o", "a.xyz"], 1),
        (["sdf", "missing.stl"], 1),
        (["sdf", "@missing"], 1),
        (["sdf", "@/dev/zero"], 1),
        (["sdf", "sphere", "x^2+1"], 1),
        (["sdf", "sphere", "erode", "5"], 1),
        (["sdf", "gyriod"], 2),
        (["sdf", "sphere", "-s"], 2),
        (["sdf", "sphere", "-s", "nan"], 2),
        (["sdf", "sphere", "--set", "t=1"], 2),
        (["sdf", "sphere", "-o", "x.stl", "--report", "x.stl"], 2),
        (["sdf", "x" * 6000], 2),
        (["sdf", "sphere", "rotate", "1" * 6000, "0,0,1"], 2),
        (["sdf", "sphere", "-o", "n" * 6000 + "/a.stl"], 1),
        (["info", "i" * 6000], 2),
        (["info", "missing.xml"], 1),
        (["info", "missing.xml#3"], 1),
        (["info", "no/missing"], 1),
        (["build", "--tile", "gyroid", "--through", "missing.xml", "--repeat", "1", "1", "1",
          "--thickness", "0.1", "-o", "a.stl"], 1),
        (["slice", "--tile", "gyroid", "--through", "missing.xml", "--repeat", "1", "1", "1",
          "--thickness", "0.1", "--layer", "0.1", "-o", "a.cli"], 1),
        (["sdf", "missing.stl", "--set", "t=1", "-o", "a.stl"], 2),
        (["demo", "--out", "/proc/no"], 1),
        (["demo", "--out", ""], 2),
        (["sdf", "a\x07\x1b[31m.stl"], 1),
        (["info", "a\x07\nb.xml"], 1),
        (["build", "--tile", "gyroid", "--through", "box", "--repeat", "1", "1", "1",
          "--thickness", "0.1", "-o", "a.stl", "--report", "./a.stl"], 2),
        (["build", "--tile", "gyroid", "--through", "box", "--repeat", "1", "1", "1",
          "--thickness", "0.1", "-o", "a.stl", "a.stl"], 2),
    ],
)  # fmt: skip
def test_exit_codes_tell_files_and_geometry_from_words(words, code, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    assert cli.main(words) == code
    out, err = capfd.readouterr()
    assert out == ""
    assert re.fullmatch(r"ilattice: error: [^\n]{5,1000}\n", err)
    assert err[:-1].isprintable()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("words", ["box log(x)", "box sqrt(-1-x^2)", "sphere erode 5"])
def test_errors_show_numbers_as_numbers(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(GeometryError) as caught:
        job.run(f"{words} -s 0.1")
    assert not re.search(r"np\.|\binf\b|array\(", str(caught.value))


def test_names_that_nothing_uses_are_an_error():
    for command, values in (("sphere", {"t": 1}), ("box dilate t", {"t": 0.1, "T2": 0.3})):
        with pytest.raises(InputError, match="does not use that name"):
            il.sdf.parse(command, **values)
    for command in ("gyroid dilate '2*t' box", "t", "box rotate t 0,0,1", "'x^2+y^2+z^2-t'"):
        value = "sphere" if command == "t" else 0.3
        assert np.isfinite(il.sdf.parse(command, t=value)([[0.1, 0.2, 0.3]])).all()


# --- objects --------------------------------------------------------------------------------------


def public_arrays(thing, depth=0):
    if isinstance(thing, np.ndarray):
        yield thing
    elif isinstance(thing, (tuple, list)):
        for item in thing:
            yield from public_arrays(item, depth + 1)
    elif depth < 5 and type(thing).__module__.startswith("ilattice"):
        for name, item in vars(thing).items():
            if not name.startswith("_"):
                yield from public_arrays(item, depth + 1)


@pytest.fixture(scope="module")
def things():
    lattice = il.Lattice("gyroid", through=il.macroshape.torus(major=1.0, width=0.7), repeat=1)
    mesh = il.sdf.mesh(il.fields.sphere(1.0), 0.2)
    found = [*(spline for spline, _ in ZOO.values()), lattice.through, lattice, mesh]
    found += [il.tiles.get("cross"), il.tiles.get("gyroid"), il.tiles.mix("cross", "f", seed=1)]
    found += [il.cutfem.Grid((np.linspace(0, 1, 3),) * 3), mesh.slices(thickness=0.4)]
    return [*found, mesh.slices(thickness=0.4)[1], il.macroshape.box().certificate]


def test_copies_stay_immutable(things):
    for thing in things:
        assert not any(a.flags.writeable for a in public_arrays(thing))
        for other in (copy.deepcopy(thing), pickle.loads(pickle.dumps(thing)), copy.copy(thing)):
            arrays = list(public_arrays(other))
            assert not any(a.flags.writeable for a in arrays)
            assert {a.tobytes() for a in arrays} <= {a.tobytes() for a in public_arrays(thing)}


@pytest.fixture(scope="module")
def results(things):
    """One object of many public classes, also those that are results."""
    lattice = il.Lattice("gyroid", through=il.macroshape.box(), repeat=1)
    wall, ball = lattice.offset(0.1), il.fields.sphere(1.0)
    mesh = il.sdf.mesh(ball, 0.2)
    found = [*things, wall, ball, il.sdf.MeshDistance(mesh)]
    found += [lattice.through.locate([[0.2, 0.3, 0.4]])]
    found += [lattice.offset(0.1, space="parametric"), il.cutfem.quadrature(wall, 4)]
    found += [il.cutfem.mass_properties(wall, 4), il.sdf.Command.read("box gyroid")]
    return found


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
def test_public_objects_are_immutable_and_so_are_their_copies(results):
    for thing in results:
        for other in (thing, copy.deepcopy(thing), pickle.loads(pickle.dumps(thing))):
            name = type(other).__name__
            own = {k: v for k, v in vars(other).items() if k[0] != "_"} if name != "BSpline" else {}
            arrays = [a for v in own.values() for a in (v if isinstance(v, tuple) else [v])]
            arrays = [a for a in arrays if isinstance(a, np.ndarray)]
            assert not any(a.flags.writeable for a in arrays), name
            for attribute in ("foo", *own):
                with pytest.raises(AttributeError):
                    setattr(other, attribute, own.get(attribute))


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
def test_solved_problems_can_be_copied():
    """Factors of matrices cannot be pickled; they are left out, and made again."""
    wall = il.Lattice("gyroid", through=il.macroshape.box(), repeat=1).offset(0.1)
    solid = il.cutfem.Elasticity(wall, 4).clamp("w=0").load(gravity=(0, 0, -1))
    energy = solid.solve().energy
    for other in (pickle.loads(pickle.dumps(solid)), copy.deepcopy(solid)):
        assert other.solve().energy == pytest.approx(energy, rel=1e-9)


def test_what_maps_and_meshes_tell_is_a_copy_or_read_only():
    space = il.macroshape.box()
    space.info["volume"] = -1
    space.info["shape"].clear()
    assert space.info["volume"] == pytest.approx(1.0)
    assert space.info["shape"] == [2, 2, 2]
    field = il.sdf.MeshDistance(il.sdf.mesh(il.fields.sphere(1.0), 0.2))
    for other in (field, pickle.loads(pickle.dumps(field)), copy.deepcopy(field)):
        assert not other.bounds.flags.writeable
        with pytest.raises(AttributeError, match="immutable"):
            del other._mesh


def test_splines_take_no_new_attributes():
    spline = pickle.loads(pickle.dumps(next(iter(ZOO.values()))[0]))
    with pytest.raises(AttributeError, match="immutable"):
        spline.foo = 1
    with pytest.raises(AttributeError, match="immutable"):
        spline.c = spline.c
    with pytest.raises(AttributeError, match="immutable"):
        del spline.c


MASKED = np.ma.masked_greater([[0.1, 0.2, 0.7]], 0.5)
NUMBERS = [  # where a number, or points, are wanted
    lambda v: il.Lattice("gyroid", through=il.macroshape.box(), repeat=v),
    lambda v: il.macroshape.torus(major=v),
    lambda v: il.fields.sphere(v),
    lambda v: il.mesh.contour(il.fields.sphere(1.0), [[-1.0, 0.0, 1.0]] * 3, level=v),
    lambda v: il.fields.shell(il.fields.sphere(1.0), v),
    lambda v: il.macroshape.box((v, 1, 1)),
    lambda v: il.fields.box((1, 1, v)),
]


@pytest.mark.parametrize("work", range(len(NUMBERS)))
@pytest.mark.parametrize(
    "value",
    [True, np.True_, 1 + 1j, "1", b"1", None, [1 + 0j] * 3, np.ma.masked, MASKED, np.nan,
     np.inf, -np.inf, [], {}, object(), np.datetime64("2020-01-01"), 10**400, [[[[]]]]],
    ids=lambda value: repr(value).split(" at ")[0][:20],  # without addresses, and not 400 digits
)  # fmt: skip
def test_what_is_no_number_is_refused(work, value):
    with pytest.raises(InputError) as caught:
        NUMBERS[work](value)
    assert "\n" not in str(caught.value) or "array" in str(caught.value)


@pytest.mark.parametrize(
    "arguments",
    [(None, None, None), ([[0, 0, 1, 1]], [0, 1], np.nan), ([[0, 0, 1, 1]], [0, 1], "1"),
     (5, [0, 1], 1), ([[0, 0, 1, 1]], [0, 1j], 1), ([[0, 0, 1, 1]], "ab", 1),
     ([None], [0, 1], 1), ([[0, 0, 1, 1]], [0, 1], None), ([[0, 0, 1, 1]], [0, 1], 1j),
     ([[0, 0, 1, 1]], [0, 1], [1, 2]), ({}, {}, {}), ("ab", [0, 1], 1)],
    ids=repr,
)  # fmt: skip
def test_constructors_refuse_wrong_types(arguments):
    with pytest.raises(InputError):
        il.BSpline(*arguments)


@pytest.mark.parametrize(
    "f",
    [lambda _: "text", lambda _: None, lambda u: 1j * u[:, 0], lambda u: u, lambda _: [],
     lambda u: np.ma.masked_greater(u[:, 0], 0.3), lambda u: ["a"] * len(u), lambda _: {}],
)  # fmt: skip
def test_callables_that_return_no_numbers_are_refused(f):
    with pytest.raises(InputError):
        il.Lattice(il.Tile(f), through=il.macroshape.box()).implicit([[0.1, 0.2, 0.3]])
    with pytest.raises(InputError):
        il.Lattice("gyroid", through=il.macroshape.box()).offset(f)


# --- 3MF ------------------------------------------------------------------------------------------


def test_3mf_meshes_are_reproducible(tmp_path):
    pytest.importorskip("lib3mf")
    contents = []
    for radius in (1.0, 1.0, 1.1):
        mesh = il.sdf.mesh(il.fields.sphere(radius), 0.2)
        mesh.save(tmp_path / "a.3mf")
        contents.append((tmp_path / "a.3mf").read_bytes())
    assert contents[0] == contents[1]
    assert contents[0] != contents[2]
    with zipfile.ZipFile(tmp_path / "a.3mf") as package:
        names = re.findall(rb'UUID="([^"]+)"', package.read("3D/3dmodel.model"))
    assert len(set(names)) == 3


@pytest.mark.parametrize("normal", [(0, 0, 1), (1, 2, -0.5)])
@pytest.mark.parametrize("kind", ["mesh", "wall"])
def test_slices_in_3mf_stand_in_for_the_part_itself(tmp_path, normal, kind):
    """Programs that do not know of slices read the mesh: it must be the part, not its box."""
    lattice = il.Lattice("gyroid", through=il.macroshape.box((1, 0.9, 1.1)), repeat=1)
    part = lattice.offset(0.11)
    if kind == "mesh":
        part = part.mesh(h=0.06)
    stack = part.slices(thickness=0.5, normal=normal)
    stack.save(tmp_path / "a.3mf")
    with zipfile.ZipFile(tmp_path / "a.3mf") as package:
        text = package.read("3D/3dmodel.model").decode()
    points = re.findall(r'<vertex x="([^"]*)" y="([^"]*)" z="([^"]*)"', text)
    corners = re.findall(r'<triangle v1="([^"]*)" v2="([^"]*)" v3="([^"]*)"', text)
    found = il.mesh.SurfaceMesh(np.array(points, float), np.array(corners, int))
    assert found.is_watertight
    assert found.volume == pytest.approx(part.volume if kind == "mesh" else part.volume(), rel=0.05)
    ends = [stack.bottom, stack.tops[-1]]
    np.testing.assert_allclose(found.bounds[:, 2], ends, atol=0.02)
    with pytest.raises((FormatError, InputError)):
        stack.save(tmp_path / "a.3mf", unit="ell")


# --- threads and compiling ------------------------------------------------------------------------

THREADS = """
import threading, ilattice as il
field, found = il.sdf.parse("box gyroid"), []
def work():
    found.append(len(il.sdf.mesh(field, 0.1).faces))
threads = [threading.Thread(target=work) for _ in range(4)]
[t.start() for t in threads]
[t.join() for t in threads]
print(len(found), len(set(found)), flush=True)
"""
FORKS = """
import multiprocessing, threading, time, ilattice as il
field, stop = il.sdf.parse("box gyroid"), []
def work():
    il.sdf.mesh(field, 0.1)
def loop():
    while not stop: work()
work()
thread = threading.Thread(target=loop)
thread.start()
children = [multiprocessing.get_context("fork").Process(target=work) for _ in range(4)]
for child in children:
    time.sleep(0.03)
    child.start()
for child in children:
    child.join(30)
print([child.exitcode for child in children], flush=True)
[child.kill() for child in children]
stop.append(1)
"""
COMPILE = """
import ilattice.errors, ilattice._validate, numba
for i in range(4):
    exec(f"@numba.njit\\ndef f(x):\\n    return sum([x + j + {i} for j in range(9)])\\nf(1)")
"""


def test_threads_work_at_the_same_time():
    environment = {**os.environ, **PATH}
    environment["NUMBA_NUM_THREADS"] = "2"
    done = subprocess.run(
        [sys.executable, "-c", THREADS], env=environment, capture_output=True, timeout=300,
        check=False, text=True,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, "4 1\n")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs forks")
def test_children_do_not_wait_for_threads_that_they_have_not():
    """Forked while another thread was at work they waited for ever, or were ended."""
    environment = {**os.environ, **PATH}
    environment["NUMBA_NUM_THREADS"] = "2"
    done = subprocess.run(
        [sys.executable, "-c", FORKS], env=environment, capture_output=True, timeout=300,
        check=False, text=True,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, "[0, 0, 0, 0]\n")


LATE = """
import atexit, threading, numpy as np, ilattice as il
field, points = il.sdf.parse("box gyroid"), np.full((100003, 3), 0.3)
def work():
    print(len(field(points)), flush=True)
def wait():
    threading.main_thread().join()
    work()
atexit.register(work)
threading.Thread(target=wait).start()
"""


COMPILING = """
import gc, os, threading, time, ilattice._validate, numba
def work():
    exec("@numba.njit\\ndef f(x):\\n    return sorted([x + j for j in range(9)])\\nf(1)", globals())
thread = threading.Thread(target=work)
thread.start()
while gc.isenabled() and thread.is_alive(): time.sleep(1e-4)
print(gc.isenabled(), flush=True)
child = os.fork()
if child == 0:
    print(gc.isenabled(), flush=True)
    os._exit(0)
os.waitpid(child, 0)
thread.join()
print(gc.isenabled(), flush=True)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs forks")
def test_garbage_is_collected_in_children_forked_while_kernels_were_compiled():
    environment = {**os.environ, **PATH}
    done = subprocess.run(
        [sys.executable, "-c", COMPILING], env=environment, capture_output=True, timeout=300,
        check=False, text=True,
    )  # fmt: skip
    assert (done.returncode, done.stdout.split()) == (0, ["False", "True", "True"])


def test_threads_that_outlive_the_main_one_do_their_work():
    environment = {**os.environ, **PATH, "NUMBA_NUM_THREADS": "2"}
    done = subprocess.run(
        [sys.executable, "-c", LATE], env=environment, capture_output=True, timeout=300,
        check=False, text=True,
    )  # fmt: skip
    assert (done.stderr, done.stdout) == ("", "100003\n100003\n")


@pytest.mark.parametrize(("patience", "lines"), [("0.2", 1), ("inf", 0), ("1000", 0)])
def test_a_line_tells_of_long_compiling(patience, lines):
    environment = {**os.environ, **PATH, "ILATTICE_PATIENCE": patience}
    done = subprocess.run(
        [sys.executable, "-c", COMPILE], env=environment, capture_output=True, timeout=300,
        check=False, text=True,
    )  # fmt: skip
    assert done.returncode == 0
    assert done.stderr.count("\n") == lines
    assert done.stderr.count("compiling kernels, once") == lines
