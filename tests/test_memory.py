"""What does not fit is refused before any work, with the numbers, in one line."""

import re
import time
import tracemalloc
import warnings

import numpy as np
import pytest

import ilattice as il
from ilattice import _memory, cli
from ilattice.errors import ConvergenceError, FormatError, InputError, PrecisionWarning

BOX = il.macroshape.box()
BALL = il.fields.sphere(1.0)
UNIT = [[-1.0] * 3, [1.0] * 3]


@pytest.fixture(scope="module")
def wall():
    return il.Lattice("gyroid", through=BOX, repeat=1).offset(0.1)


def many(*repeat, tile="gyroid", **options):
    return il.Lattice(tile, through=BOX, repeat=repeat, **options)


MIXED = il.tiles.mix("gyroid", "diamond", seed=1)
CASES = {  # those that end in numbers of bytes
    "mesh": lambda w: w.mesh(h=1.3e-6),
    "tiles": lambda _: many(311, 290, 305).offset(1e-4),
    "a row of tiles": lambda _: many(1, 999_999, 1).offset(0.1),
    "spans": lambda _: many(1, 1, 1, spans_per_tile=10**7).offset(0.1),
    "mixture": lambda _: many(99999, 99999, 99999, tile=MIXED).offset(0.1),
    "parametric": lambda _: many(3000, 2999, 3001).offset(0.1, space="parametric"),
    "closest": lambda _: many(99999, 99998, 99997).closest([[0.2, 0.3, 0.4]]),
    "elasticity": lambda w: il.cutfem.Elasticity(w, 10**5),
    "heat of a field": lambda _: il.cutfem.Heat(BALL, (10**5, 10**6, 10**5), domain=UNIT),
    "mass": lambda w: il.cutfem.mass_properties(w, 99_999),
    "cut": lambda w: il.cutfem.cut(w, 10**7),
    "contour": lambda _: il.mesh.contour(BALL, [np.linspace(-1, 1, 2 * 10**5)] * 3),
    "slices": lambda w: w.slices(thickness=0.1, h=1.7e-5),
    "sweep": lambda _: many(1, 1, 1).topology_sweep([0.05, 0.1], h=1e-6),
}  # fmt: skip
OTHERS = {
    "planes of a mesh": (lambda w: w.mesh(h=1e-12), "makes 1e[+]12 planes along u; at most"),
    "no width": (lambda w: w.mesh(h=1e-320), "planes along u; at most"),
    "layers": (lambda w: w.slices(thickness=1e-12), "makes 1e[+]12 layers"),
    "no layers": (lambda w: w.slices(thickness=1e-320), "layers of a part"),
    "thin layers": (lambda w: w.slices(thickness=1e-5), "at most 50000 are allowed: use a thick"),
    "large grids": (
        lambda _: il.sdf.mesh(BALL, 1e-5, memory=1e9), r"needs about .* of memory, .* are free: t"
    ),
    "repeat": (lambda _: many(1e18, 1, 1), "whole numbers from 1 to"),
    "cells": (lambda w: il.cutfem.cut(w, 10**12), "whole numbers from 1 to"),
    "memory": (lambda _: il.sdf.mesh(BALL, 0.1, memory=1e-9), "23 x 23 x 23.*0.3 GB.* 1e-09 GB"),
    "tol": (lambda _: il.sdf.mesh(BALL, tol=1e-12), "finer grid than is allowed.*GB; allowed are"),
    "tol of kinks": (lambda _: il.sdf.mesh(il.sdf.parse("box gyroid"), tol=1e-9), "finer grid"),
}  # fmt: skip


def refused(work, message):
    tracemalloc.start()
    start = time.process_time()
    try:
        with pytest.raises(InputError, match=message) as caught:
            work()
        assert tracemalloc.get_traced_memory()[1] < 500e6
    finally:
        tracemalloc.stop()
    assert time.process_time() - start < 2.0
    assert "\n" not in str(caught.value)


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
@pytest.mark.parametrize("name", CASES)
def test_memory_is_estimated_before_the_work(name, wall):
    remedy = r"needs about [\d.e+]+ .?B of memory, [\d.]+ .?B are free: (use|take) "
    refused(lambda: CASES[name](wall), remedy)


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
@pytest.mark.parametrize("name", OTHERS)
def test_sizes_that_are_absurd_are_refused_with_the_number(name, wall):
    refused(lambda: OTHERS[name][0](wall), OTHERS[name][1])


def test_what_is_free_counts_limits_of_the_machine_and_of_the_process(monkeypatch):
    assert 1e8 < _memory.available() < 1e14
    for source, limit in (("_machine", 3e9), ("_group", 2e9), ("_own", 1e9)):
        monkeypatch.setattr(_memory, source, lambda limit=limit: iter([int(limit)]))
        assert _memory.available() == pytest.approx(limit, abs=1)
        _memory.need(0.99 * limit, "work", "do less")
        told = f"work needs about {1.01 * limit / 1e9:.3g} GB of memory, "
        with pytest.raises(InputError, match=re.escape(told)):
            _memory.need(1.01 * limit, "work", "do less")
    for source in ("_machine", "_group", "_own"):
        monkeypatch.setattr(_memory, source, lambda: iter([]))
    assert _memory.available() == _memory.UNKNOWN
    with pytest.raises(InputError, match="more than 1e15 TB"):
        _memory.need(float("inf"), "work", "do less")


def test_tolerances_out_of_reach_are_refused_after_one_look(monkeypatch):
    """No finer spline is begun; the message has what would do."""
    monkeypatch.setattr("ilattice.offsets.tolerance.interpolated", lambda *_: pytest.fail("began"))
    with pytest.raises(
        ConvergenceError, match=r"spans per tile, .*B of memory, .* free; .*use tol"
    ) as e:
        many(1, 1, 1).offset(0.1, tol=1e-12)
    monkeypatch.undo()
    enough = float(re.search(r"use tol >= (\S+)", str(e.value))[1])
    assert 1e-9 < enough < 1e-3


@pytest.mark.filterwarnings("ignore:the mesh with spacing")
def test_coarse_grids_of_solids_are_told():
    for spacing in (1.5, 5.0, 1e6):
        with pytest.warns(PrecisionWarning, match="is coarse for a solid .* at most 0.1"):
            il.sdf.mesh(BALL, spacing, allow_loss=True)


def test_advice_for_coarse_meshes_comes_from_the_part(wall):
    """Edges of 1e9 are those of the coarsest grid."""
    thin = wall.lattice.offset(0.03)
    advice = []
    for h in (1e9, 1e3):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            thin.mesh(h=h, allow_loss=True)
        texts = " ".join(str(w.message) for w in caught)
        advice += [float(x) for x in re.findall(r"use h <= ([\d.e+-]+)", texts)]
    assert len(advice) >= 2
    assert max(advice) < 1.0


def test_large_files_are_refused_by_what_is_free(tmp_path, monkeypatch):
    (tmp_path / "a.off").write_bytes(b"OFF\n" + b" " * 40_000_000)
    monkeypatch.setattr(_memory, "available", lambda: 100_000_000)
    with pytest.raises(InputError, match="160 MB of memory, 100 MB are free"):
        il.mesh.load(tmp_path / "a.off")
    monkeypatch.undo()
    with pytest.raises(FormatError, match="numbers of vertices"):
        il.mesh.load(tmp_path / "a.off")


def test_too_many_tiles_on_the_command_line_are_one_line(tmp_path, capfd):
    words = [
        "build",
        "--tile",
        "gyroid",
        "--through",
        "box",
        "--repeat",
        "99999",
        "99999",
        "99999",
        "--thickness",
        "0.1",
        "-o",
    ]
    assert cli.main([*words, str(tmp_path / "a.stl")]) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert re.fullmatch(r"ilattice: error: [^\n]*TB of memory[^\n]*use fewer tiles[^\n]*\n", err)


# --- copies of what is handed in ------------------------------------------------------------------


class Sharing:
    """Something that NumPy takes for an array, and that keeps it."""

    def __init__(self, a):
        self.a = a

    def __array__(self, dtype=None, copy=None):
        return self.a


class SharingList(list, Sharing):
    """A list that is taken for an array, too."""


def kinds_of(a):
    """What splines may be made of, and the arrays behind that."""
    for source in (
        a.copy(),
        np.asfortranarray(a),
        a.astype(np.float32),
        a[:, ::-1].copy()[:, ::-1],
    ):
        listed = SharingList(a.tolist())
        listed.a = source
        fixed = source.view()
        fixed.flags.writeable = False
        yield from ((source, source), (source, fixed), (source, Sharing(source)), (source, listed))
        yield source, source.tolist()
        if source.flags.c_contiguous:
            yield source, memoryview(source)


def test_splines_share_no_memory_with_what_they_were_made_of():
    a = np.random.default_rng(5).random((4, 3))
    for source, given in kinds_of(a):
        spline = il.BSpline([[0, 0, 0.3, 0.6, 1, 1]], given, 1)
        before = spline.c.copy()
        assert not np.shares_memory(source, spline.c)
        source[0] = 7.0
        np.testing.assert_array_equal(spline.c, before)
        assert not spline.c.flags.writeable


@pytest.mark.parametrize("writeable", [True, False])
@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_large_input_is_copied_once(writeable, kind):
    c = np.random.default_rng(6).random((200_000, 3)).astype(kind)
    c.flags.writeable = writeable
    t = [0.0, *np.linspace(0, 1, len(c)), 1.0]
    tracemalloc.start()
    spline = il.BSpline([t], c, 1)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1.2 * (spline.c.nbytes + 2 * spline.t[0].nbytes)


def test_loading_takes_less_than_six_times_the_file(tmp_path):
    """So that ten million triangles, half a gigabyte, take less than three."""
    n = 300
    a = np.arange(n) * 2 * np.pi / n
    p, q = (v.ravel() for v in np.meshgrid(a, a, indexing="ij"))
    x = np.stack([(3 + np.cos(q)) * np.cos(p), (3 + np.cos(q)) * np.sin(p), np.sin(q)], axis=1)
    i, j = (v.ravel() for v in np.meshgrid(range(n), range(n), indexing="ij"))
    at = [((i + di) % n) * n + (j + dj) % n for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1))]
    faces = np.concatenate([np.stack([at[0], at[1], at[2]], 1), np.stack([at[0], at[2], at[3]], 1)])
    path = tmp_path / "a.stl"
    il.SurfaceMesh(x, faces).save(path)
    il.mesh.load(path)  # compiled
    tracemalloc.start()
    found = il.mesh.load(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(found.vertices) == n * n
    assert peak < 5.6 * path.stat().st_size


@pytest.mark.filterwarnings("ignore:the volume of the field is known")
def test_rules_of_thin_parts_are_estimated_while_they_are_made(monkeypatch):
    rng = np.random.default_rng(4)
    x = rng.uniform(0.2, 3.8, (12, 3))
    thin = il.cost.Beams(x, [(i, i + 1) for i in range(11)], np.full((11, 2), 0.05))
    cut = il.cutfem.cut(thin, 4, domain=[[0, 0, 0], [4, 4, 4]])
    points = len(cut.volume())
    monkeypatch.setattr(_memory, "SMALL", 0)
    monkeypatch.setattr(_memory, "available", lambda: 20 * points)
    with pytest.raises(InputError, match=r"a rule of about \de\+0\d points.*fewer cells") as told:
        cut.volume()
    said = float(re.search(r"about (\S+) points", str(told.value))[1])
    assert 0.3 * points < said < 3.0 * points
