"""Files that are made to harm: devices, bombs, claims, and what grows faster than the file."""

import io
import itertools
import json
import os
import random
import struct
import threading
import time
import tracemalloc
import zipfile

import numpy as np
import pytest
import wounds
from spline_zoo import ZOO

import ilattice as il
from ilattice.errors import FormatError, InputError
from ilattice.io import _patches, native, registry, splines
from ilattice.macroshape import SplineMap

COUNT = int(os.environ.get("ILATTICE_MUTANTS", "500"))
HEAD = {"format": "ilattice spline", "version": 1, "index_order": "uvw, last fastest"}
LINE = HEAD | {"degrees": [1], "periodic": [False], "knot_vectors": [[0, 0, 1, 1]]}
SQUARE = """MFEM NURBS mesh v1.0
dimension 2 elements {n}
{elements}
boundary 0 edges 4 0 0 1 0 3 2 0 0 3 0 1 2 vertices 4
knotvectors 1 1 2 0 0 1 1 weights 1 1 1 1
FiniteElementSpace FiniteElementCollection: NURBS1 VDim: {dim} Ordering: 0
{numbers}
"""


def load(path):
    if path.suffix in registry.READERS:
        return il.mesh.load(path)
    return splines.list_patches(path)


def cost(path):
    """Result or error of reading a file, its peak of memory, and the time."""
    tracemalloc.start()
    start = time.process_time()
    try:
        found = load(path)
    except FormatError as e:
        found = e
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return found, peak, time.process_time() - start


# --- what is no regular file ----------------------------------------------------------------------


@pytest.mark.parametrize("ending", sorted([*registry.READERS, *splines.FORMATS]))
@pytest.mark.parametrize("kind", ["zero", "fifo", "folder"])
def test_only_regular_files_are_read(tmp_path, ending, kind):
    path = tmp_path / f"a{ending}"
    if kind == "zero":
        path.symlink_to("/dev/zero")
    elif kind == "fifo":
        os.mkfifo(path)
    else:
        path.mkdir()
    found, peak, _ = cost(path)
    assert isinstance(found, FormatError)
    assert "is not a regular file" in str(found)
    assert peak < 3e6


def test_words_of_a_command_come_from_regular_files_of_bounded_size(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "long").write_bytes(b"sphere " * 400_000)
    (tmp_path / "leaf").write_text("")
    below = "leaf"
    for i in range(8):  # 1000 ** 8 insertions of nothing
        (tmp_path / f"level{i}").write_text(f"@{below} " * 1000)
        below = f"level{i}"
    for name, message in (
        ("/dev/zero", "regular"),
        (tmp_path / "pipe", "regular"),
        (tmp_path / "long", "bytes"),
        (tmp_path / below, "bytes"),
    ):
        done: list[Exception] = []

        def parse(name=name, done=done):
            try:
                il.sdf.parse(f"@{name} sphere")
            except InputError as e:
                done.append(e)

        worker = threading.Thread(target=parse, daemon=True)
        worker.start()
        worker.join(20)
        assert done
        assert message in str(done[0])


# --- archives and JSON ----------------------------------------------------------------------------


def archive(content, method, claim=None):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", method) as package:
        package.writestr("control_points.npy", content)
    data = out.getvalue()
    if claim is not None:
        data = data.replace(struct.pack("<I", len(content)), struct.pack("<I", claim))
    return data


@pytest.mark.parametrize("method", [zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
@pytest.mark.parametrize("claim", [None, 100, 10_000_000])
def test_archives_that_lie_about_sizes_take_no_memory(tmp_path, method, claim):
    (tmp_path / "a.npz").write_bytes(archive(bytes(1 << 26), method, claim))
    found, peak, _ = cost(tmp_path / "a.npz")
    assert isinstance(found, FormatError)
    assert peak < 60e6


def test_damaged_lzma_is_refused(tmp_path):
    rng, path = random.Random(7), tmp_path / "a.npz"
    good = archive(rng.randbytes(3000), zipfile.ZIP_LZMA)
    for _ in range(100):
        data = bytearray(good)
        for _ in range(3):
            data[rng.randrange(60, 2000)] = rng.randrange(256)
        path.write_bytes(data)
        assert isinstance(cost(path)[0], FormatError)


@pytest.mark.parametrize("kind", ["<f2", "|i1", "<f8"])
def test_narrow_numbers_do_not_grow_beyond_the_file(tmp_path, kind):
    arrays = {k: v for k, v in LINE.items() if k != "knot_vectors"}
    np.savez_compressed(
        tmp_path / "a.npz",
        control_points=np.zeros(12_000_000 if kind == "|i1" else 2_000_000, kind),
        knot_vector_0=np.array([0, 0, 1, 1.0]),
        **arrays,
    )
    found, peak, _ = cost(tmp_path / "a.npz")
    assert isinstance(found, FormatError)
    assert peak < 20 * (tmp_path / "a.npz").stat().st_size + 100e6


@pytest.mark.parametrize("odd", ["x" * 3000, None, True, [1, 2], {}, "1", 10**400])
@pytest.mark.parametrize("at", [0, 77_000])
def test_one_odd_entry_among_numbers_costs_nothing(tmp_path, odd, at):
    values = [0] * 150_000
    values[at] = odd
    (tmp_path / "a.json").write_text(json.dumps(LINE | {"control_points": values}))
    found, peak, _ = cost(tmp_path / "a.json")
    assert isinstance(found, FormatError)
    assert len(str(found)) < 400
    assert peak < 20e6


# --- what grew with the square of the file --------------------------------------------------------


def test_attributes_of_an_object_are_kept_once(tmp_path):
    def file(n):
        parts = "".join(f"[A{i} b][CURVE BEZIER 2 E1 [1] [2]]\n" for i in range(n))
        (tmp_path / "a.itd").write_text(f"[OBJECT part {parts}]")
        return cost(tmp_path / "a.itd")

    (small, low, _), (large, high, _) = file(300), file(2400)
    assert len(small) == 300
    assert len(large) == 2400
    assert large[5].info["A2399"] == "b"
    assert high < 12 * low


def test_names_of_coordinates_are_kept_once(tmp_path):
    curves = "[CURVE BEZIER 2 E4 [1 2 3 4] [2 3 4 5]]\n" * 1500
    (tmp_path / "a.itd").write_text(f'[OBJECT part [COORDINATES "{"a" * 20_000}"]\n{curves}]')
    found, peak, _ = cost(tmp_path / "a.itd")
    assert found[1499].names == ("a" * 20_000,)
    assert peak < 20e6


@pytest.mark.parametrize(("n", "dim"), [(2500, 12_000), (40, 12_000)])
def test_a_square_is_not_used_again_and_again(tmp_path, n, dim):
    text = SQUARE.format(
        n=n, dim=dim, elements="1 3 0 1 2 3\n" * n, numbers="1 " * 4 * dim
    )  # fmt: skip
    (tmp_path / "a.mesh").write_text(text)
    found, peak, _ = cost(tmp_path / "a.mesh")
    assert isinstance(found, FormatError)
    assert "share their points more than 16 times" in str(found)
    assert peak < 20 * len(text) + 5e6


# --- small things, many times ---------------------------------------------------------------------

SIZE = 300_000
PLY = (
    "ply\nformat {form} 1.0\nelement vertex {v}\nproperty float x\nproperty float y\n"
    "property float z\nelement face {f}\nproperty list {n} int vertex_indices\nend_header\n"
)
CORNERS = "0 0 1\n1 0 0\n0 1 0\n"
KNOTS = "<Basis><KnotVector degree='1'>0 0 1 1</KnotVector></Basis>"
CURVE = f"<Geometry type='BSpline'>{KNOTS}<coefs geoDim='1'>"
PATCH = "knotvectors 1 1 2 0 0 1 1 dimension 1 controlpoints 1 1 1 1 "
MESH = "MFEM NURBS mesh v1.0\ndimension "


def chain(n):
    """Squares in a row, each of which shares an edge with the next."""
    elements = "".join(f"1 3 {2 * i} {2 * i + 2} {2 * i + 3} {2 * i + 1}\n" for i in range(n))
    edges = "".join(
        f"0 {2 * i} {2 * i + 2}\n1 {2 * i} {2 * i + 1}\n0 {2 * i + 1} {2 * i + 3}\n"
        for i in range(n)
    )
    return (
        f"{MESH}2 elements {n}\n{elements}boundary 0 edges {3 * n + 1}\n{edges}1 {2 * n} "
        f"{2 * n + 1} vertices {2 * n + 2} knotvectors 2 1 2 0 0 1 1 1 2 0 0 1 1 weights "
        + "1 " * (2 * n + 2)
        + "FiniteElementSpace FiniteElementCollection: NURBS1 VDim: 1 Ordering: 0 "
        + "1 " * (2 * n + 2)
    )


def edges(n):
    rows = "".join(f"0 {300 + i} {301 + i} " for i in range(n))
    return (
        f"{MESH}2 elements 1 1 3 0 1 2 3 boundary 0 edges {n} {rows}vertices {n + 302} "
        "knotvectors 1 1 2 0 0 1 1 weights "
    )


MANY = {  # names end in formats; what stands once, and what many times
    "short.off": ("OFF\n", "1\n", ""),
    "long.off": ("OFF\n", "11\n", ""),
    "points.off": ("OFF\n50000 0 0\n", "1 1 1\n", ""),
    "faces.off": (f"OFF\n3 37000 0\n{CORNERS}", "3 0 1 2\n", ""),
    "empty.off": (f"OFF\n3 149000 0\n{CORNERS}3 0 1 2\n", "0\n", ""),
    "polygon.off": (f"OFF\n3 1 0\n{CORNERS}149000 ", "0 1 2 ", ""),
    "wide.off": ("OFF # \U0001f600\n50000 1 0\n", "1 1 1\n", ""),
    "points.obj": ("", "v 1 1 1\n", "f 1 2 3\n"),
    "bare.obj": ("", "v\n", ""),
    "faces.obj": ("v 0 0 1\nv 1 0 0\nv 0 1 0\n", "f 1 2 3\n", ""),
    "edges.obj": ("v 0 0 1\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "f 1\n", ""),
    "polygon.obj": ("v 0 0 1\nv 1 0 0\nv 0 1 0\nf ", "1 2 3 ", ""),
    "facets.stl": (
        "solid\n", "outer loop vertex 10 10 10 vertex 10 11 10 vertex 10 10 11 endloop\n", ""
    ),
    "loops.stl": ("solid\n", "outer loop ", ""),
    "points.ply": (PLY.format(form="ascii", v=33_000, f=1, n="int"), "11 12 13\n", ""),
    "faces.ply": (PLY.format(form="ascii", v=3, f=37_000, n="uchar") + CORNERS, "3 0 1 2\n", ""),
    "empty.ply": (
        PLY.format(form="ascii", v=3, f=140_000, n="uchar") + CORNERS + "3 0 1 2\n", "0\n", ""
    ),
    "polygon.ply": (
        PLY.format(form="ascii", v=3, f=1, n="uint") + CORNERS + "149000 ", "0 1 2 ", ""
    ),
    "words.ply": (PLY.format(form="ascii", v=10**6, f=1, n="uint"), "11 ", ""),
    "elements.xml": ("<xml>", "<a/>", "</xml>"),
    "values.xml": ("<xml>", '<a b="1"/>', "</xml>"),
    "bases.xml": ("<xml><Geometry type='BSpline'>", "<Basis/>", "</Geometry></xml>"),
    "none.xml": ("<xml>", "<Geometry type='X'/>", "</xml>"),
    "numbers.xml": (f"<xml>{CURVE}", "11 ", "</coefs></Geometry></xml>"),
    "parts.xml": (f"<xml>{CURVE}", "1<b/>", "</coefs></Geometry></xml>"),
    "notes.xml": (f"<xml>{CURVE}", "1<!---->", "</coefs></Geometry></xml>"),
    "curves.xml": ("<xml>", f"{CURVE}1 2</coefs></Geometry>", "</xml>"),
    "curves.itd": ("[OBJECT a ", "[CURVE BEZIER 2 E1 [1] [2]]\n", "]"),
    "nested.itd": ("", "[OBJECT ", ""),
    "attributes.itd": ("[OBJECT a ", "[SURFACE X]", "]"),
    "quotes.itd": ("", '""', ""),
    "notes.itd": ("", '"a"#\n', ""),
    "points.itd": ("[OBJECT a [CURVE BEZIER 74000 E1 ", "[1] ", "]]"),
    "elements.mesh": (f"{MESH}2 elements 24000 ", "1 3 0 1 2 3 ", ""),
    "words.mesh": (f"{MESH}2 ", "11 ", ""),
    "patches.mesh": (
        f"{MESH}1 elements 4200 {'1 1 0 1 ' * 4200}boundary 0 edges 0 vertices 2 patches ",
        PATCH, "",
    ),
    "chain.mesh": (chain(3500), " ", ""),
    "edges.mesh": (edges(18_000), " ", ""),
    "lists.json": ("[", "[],", "1]"),
    "objects.json": ("[", '{"a":1},', "1]"),
    "rows.json": ('{"control_points": [', "[1],", "1]}"),
}  # fmt: skip


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
@pytest.mark.parametrize("name", MANY)
def test_memory_is_in_proportion_to_the_file(tmp_path, name, monkeypatch):
    monkeypatch.setattr(_patches, "MANY", 0)
    monkeypatch.setattr(native, "_FEW", 0)
    head, unit, tail = MANY[name]
    text = head + unit * ((SIZE - len(head) - len(tail)) // len(unit)) + tail
    path = tmp_path / f"a{name[name.index('.') :]}"
    path.write_text(text, encoding="utf-8")
    assert cost(path)[1] < 20 * len(text) + 4e6


def test_wide_letters_do_not_add_to_many_numbers(tmp_path):
    """One letter outside of the basic plane makes all letters of a text four bytes wide."""
    text = json.dumps(LINE | {"names": ["\U0001f600"]}, ensure_ascii=False)
    text = text[:-1] + ', "control_points": [' + "0," * 1_000_000 + "0]}"
    (tmp_path / "a.json").write_text(text, encoding="utf-8")
    found, peak, _ = cost(tmp_path / "a.json")
    assert isinstance(found, FormatError)
    assert peak < 18 * len(text)


# --- damaged at random ----------------------------------------------------------------------------


def good_files(ending, tmp_path):
    path = tmp_path / f"good{ending}"
    if ending in registry.READERS:
        for field, h in (("box", 1.0), ("sphere", 0.2)):
            il.sdf.mesh(il.sdf.parse(field), h).save(path)
            yield path.read_bytes()
        return
    for kind in ("trilinear", "closed rational", "rational material", "repeated knots"):
        spline, names = ZOO[kind]
        splines.save(SplineMap(spline, names=names), path)
        yield path.read_bytes()


def repacked(data, rng):
    """The archive wounded, or packed anew in some way with a wound in one of its members."""
    if rng.random() < 0.3:
        return wounds.mutated(data, rng)
    out = io.BytesIO()
    methods = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA)
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(out, "w") as new:
        names = old.namelist()
        chosen = rng.choice(names)
        for name in names:
            content = old.read(name)
            method = rng.choice(methods) if rng.random() < 0.1 else zipfile.ZIP_DEFLATED
            content = wounds.mutated(content, rng) if name == chosen else content
            new.writestr(name, content, compress_type=method)
    packed = out.getvalue()
    return wounds.mutated(packed, rng) if rng.random() < 0.2 else packed


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize("ending", [".npz", ".json", ".off"])
def test_damaged_files_end_in_our_errors_and_take_little(tmp_path, ending):
    rng, path = random.Random(f"damage {ending}"), tmp_path / f"a{ending}"
    good = list(good_files(ending, tmp_path))
    refused = longest = 0
    tracemalloc.start()
    for _ in itertools.repeat(None, COUNT):
        data = (repacked if ending == ".npz" else wounds.mutated)(rng.choice(good), rng)
        path.write_bytes(data)
        tracemalloc.reset_peak()
        try:
            load(path)
        except FormatError as e:
            refused += 1
            longest = max(len(str(e)), longest)
        assert tracemalloc.get_traced_memory()[1] < 20 * len(data) + 100e6
    tracemalloc.stop()
    assert 0 < refused <= COUNT
    assert longest <= 1000
