import io
import json
import pickle
import tracemalloc
import zipfile

import numpy as np
import pytest
from spline_zoo import ZOO, make

from ilattice import macroshape
from ilattice.errors import FormatError
from ilattice.io import splines
from ilattice.macroshape import SplineMap

SPLINE, NAMES = ZOO["colour and thickness"]


@pytest.fixture
def content(tmp_path):
    path = tmp_path / "good.json"
    splines.save(SplineMap(SPLINE, names=NAMES), path)
    return json.loads(path.read_text())


def test_json_is_what_the_docstring_says(content):
    assert content["format"] == "ilattice spline"
    assert content["version"] == 1
    assert content["degrees"] == [2, 2, 1]
    assert content["names"] == ["r", "g", "b", "d"]
    assert content["weights"] is None
    assert np.array_equal(content["control_points"], SPLINE.c)
    assert [len(t) for t in content["knot_vectors"]] == [7, 6, 4]


def test_npz_is_read_by_numpy_alone(tmp_path):
    spline = make((2, 1, 1), (5, 3, 2), 3, rational=True)
    splines.save(spline, tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as data:
        assert np.array_equal(data["control_points"], spline.c)
        assert np.array_equal(data["weights"], spline.weights)
        assert data["knot_vector_0"].shape == (8,)


def test_arrays_of_another_order_or_type_are_understood(tmp_path):
    splines.save(SPLINE, tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as data:
        arrays = dict(data)
    arrays["control_points"] = np.asfortranarray(arrays["control_points"].astype(">f8"))
    arrays["degrees"] = arrays["degrees"].astype(np.uint8)
    np.savez_compressed(tmp_path / "b.npz", **arrays)
    back = splines.read_patches(tmp_path / "b.npz")[0].spline
    assert np.array_equal(back.c, SPLINE.c)
    assert back.k == SPLINE.k


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("format", "mesh", "key 'format': found 'mesh'"),
        ("version", 2, "key 'version': found 2; expected 1"),
        ("version", True, "key 'version'"),
        ("index_order", "wvu", "key 'index_order'"),
        ("degrees", [2, 2], "key 'degrees'"),
        ("degrees", [2, 2, 1.5], "key 'degrees'"),
        ("degrees", [2, 2, -1], "degree"),
        ("degrees", [2, 2, 2], "knots"),
        ("degrees", None, "key 'degrees'"),
        ("periodic", [0, 0, 0], "key 'periodic'"),
        ("periodic", [True, False, False], "periodic"),
        ("names", ["a"], "1 names for 7 components"),
        ("names", "rgbd", "key 'names'"),
        ("names", [1, 2, 3, 4], "key 'names'"),
        ("control_points", None, "key 'control_points'"),
        ("control_points", [], "must not be empty"),
        ("control_points", [[1, 2], [3]], "key 'control_points'"),
        ("control_points", [["1"]], "expected an array of numbers"),
        ("control_points", [[1e200]], "not above"),
        ("control_points", [10**400], "key 'control_points'"),
        ("weights", [1, 2], "weights"),
        ("weights", [[-1]], "weights must be positive"),
        ("knot_vectors", [[0, 1e-200], [0, 1], [0, 1]], "at least 1e-100 apart"),
        ("knot_vectors", [], "knot vectors: expected one to three"),
        ("knot_vectors", [[0, 1], [1, 0], 3], "knot vector"),
    ],
)
def test_what_is_wrong_is_said(tmp_path, content, key, value, message):
    content[key] = value
    path = tmp_path / "a.json"
    path.write_text(json.dumps(content))
    with pytest.raises(FormatError, match=message) as caught:
        macroshape.load(path)
    assert "a.json" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"a": 1,\n }', "line 2: no JSON"),
        ("[1]", "line 1: expected an object"),
        ('{"control_points": [NaN]}', "number NaN is not finite"),
        ("[" * 100_000, "no JSON that can be read"),
        ("1" * 5000, "no JSON that can be read"),
    ],
)
def test_malformed_json(tmp_path, text, message):
    path = tmp_path / "a.json"
    path.write_text(text)
    with pytest.raises(FormatError, match=message):
        macroshape.load(path)


def archive(tmp_path, **members: bytes):
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in members.items():
            file.writestr(f"{name}.npy", data)
    return path


def npy(array, allow_pickle=False):
    stream = io.BytesIO()
    np.lib.format.write_array(stream, array, allow_pickle=allow_pickle)
    return stream.getvalue()


def test_nothing_is_unpickled(tmp_path):
    class Trap:
        def __reduce__(self):
            return (open, (str(tmp_path / "trap"), "w"))

    data = npy(np.array([Trap()], dtype=object), allow_pickle=True)
    with pytest.raises(FormatError, match="no array of numbers"):
        macroshape.load(archive(tmp_path, control_points=data))
    with pytest.raises(FormatError, match=r"entry 'control_points\.npy'"):
        macroshape.load(archive(tmp_path, control_points=pickle.dumps(Trap())))
    assert not (tmp_path / "trap").exists()


def test_claimed_sizes_take_no_memory(tmp_path):
    data = npy(np.zeros(4))
    data = data.replace(b"(4,)", b"(4000000000000,)").replace(b" " * 13 + b"\n", b" \n")
    path = archive(tmp_path, control_points=data)
    tracemalloc.start()
    with pytest.raises(FormatError, match="does not fit"):
        macroshape.load(path)
    assert tracemalloc.get_traced_memory()[1] < 5e6
    tracemalloc.stop()


def test_an_archive_that_expands_out_of_proportion(tmp_path):
    path = archive(tmp_path, control_points=npy(np.zeros(10_000_000)))
    tracemalloc.start()
    with pytest.raises(FormatError, match="expands more than 5 times"):
        macroshape.load(path)
    assert tracemalloc.get_traced_memory()[1] < 5e6
    tracemalloc.stop()


WRONG = {
    "format": ['"mesh"', "1"],
    "version": ["2", "true"],
    "index_order": ['"wvu"'],
    "degrees": ["[2, 2]", "[2, 2, 1.5]", "[99, 2, 1]", '"x"'],
    "periodic": ["[false]", "3"],
    "names": ['["r"]', '"r"', "[1]"],
    "control_points": ["[[1], [2, 3]]", '["a"]', "[]", "[1, 2, NaN]", "[-Infinity]", "[1e300]"],
    "weights": ["[-1]", '"w"', "[[1], 2]"],
    "knot_vectors": ["[]", "[[0, 0, 1], [2], [1, 0]]", '[["a"], [0], [1]]'],
}


@pytest.mark.parametrize(("key", "value"), [(k, v) for k, values in WRONG.items() for v in values])
def test_errors_in_json_name_the_line(tmp_path, content, key, value):
    rng = np.random.default_rng(len(value) + 7 * len(key))
    keys = list(content)
    rng.shuffle(keys)
    lines = ["{"]
    where = 0
    for name in keys:
        lines += [""] * int(rng.integers(0, 4))
        lines.append(f'"{name}" : {value if name == key else json.dumps(content[name])},')
        where = len(lines) if name == key else where
    lines[-1] = lines[-1][:-1]
    (tmp_path / "a.json").write_text("\n".join([*lines, "}"]))
    with pytest.raises(FormatError, match=f"a.json, line {where}: "):
        splines.list_patches(tmp_path / "a.json")


@pytest.mark.parametrize("bad", ["[" * 5000, '{"a":' * 5000, "1" * 5000])
def test_what_no_reader_of_json_can_take_has_a_line(tmp_path, bad):
    (tmp_path / "a.json").write_text(f'{{\n\n"a": [1, {{}}, [2]],\n"b": {bad}')
    with pytest.raises(FormatError, match=r"a.json, line 4"):
        splines.list_patches(tmp_path / "a.json")


def test_a_key_that_is_missing_has_the_line_of_the_object(tmp_path, content):
    del content["weights"], content["degrees"]
    (tmp_path / "a.json").write_text(json.dumps(content))
    with pytest.raises(FormatError, match=r"a\.json, line 1: key 'degrees'"):
        splines.list_patches(tmp_path / "a.json")
