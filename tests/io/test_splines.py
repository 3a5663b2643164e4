import os
from pathlib import Path

import numpy as np
import pytest
from spline_zoo import ZOO, make, sites

from ilattice import macroshape
from ilattice.bspline import BSpline
from ilattice.errors import FormatError, InputError
from ilattice.io import splines
from ilattice.io._patches import clamped
from ilattice.macroshape import SplineMap, hexahedron

DATA = Path(__file__).parents[1] / "data"
ENDINGS = list(splines.FORMATS)
CUBES = DATA / "gismo" / "cube.xml"


def same(a: np.ndarray, b: np.ndarray, tol: float = 1e-12) -> bool:
    return a.shape == b.shape and np.abs(a - b).max() <= tol * max(np.abs(a).max(), 1)


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("kind", ZOO)
def test_round_trip(tmp_path, ending, kind):
    spline, names = ZOO[kind]
    path = tmp_path / f"a{ending}"
    splines.save(SplineMap(spline, names=names), path)
    back = macroshape.load(path)
    u = sites(spline)
    assert back.names == names
    assert np.array_equal(back.spline.domain, spline.domain)
    assert back.spline.k == spline.k
    assert (back.spline.weights is None) == (spline.weights is None)
    assert same(back.spline(u), spline(u))
    if ending in (".npz", ".json", ".itd"):
        assert back.spline.periodic == spline.periodic
        assert all(map(np.array_equal, back.spline.t, spline.t))
        assert same(back.spline.c, spline.c, 0 if ending != ".itd" else 1e-15)
    else:
        assert back.spline.periodic == (False, False, False)
        for t, k, closed in zip(back.spline.t, spline.k, spline.periodic, strict=True):
            assert not closed or (t[: k + 1] == t[0]).all()


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("kind", ["mixed degrees", "rational", "repeated knots", "left-handed"])
def test_clamped_splines_come_back_bit_by_bit(tmp_path, ending, kind):
    spline, _ = ZOO[kind]
    splines.save(spline, tmp_path / f"a{ending}")
    back = splines.read_patches(tmp_path / f"a{ending}")[0].spline
    assert all(map(np.array_equal, back.t, spline.t))
    if ending != ".itd":  # multiplies coordinates by weights
        assert np.array_equal(back.c, spline.c)
    if spline.weights is not None:
        assert np.array_equal(back.weights, spline.weights)


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("rational", [False, True])
@pytest.mark.parametrize(
    ("k", "n", "m"), [((3,), (6,), 3), ((2, 1), (5, 4), 3), ((2, 2), (3, 5), 2)]
)
def test_curves_and_surfaces_round_trip(tmp_path, ending, rational, k, n, m):
    spline = make(k, n, m, rational=rational)
    path = tmp_path / f"a{ending}"
    splines.save(spline, path)
    (patch,) = splines.list_patches(path)
    assert patch.kind == ["curve", "surface"][len(k) - 1]
    assert patch.index is None
    u = sites(spline)
    assert same(patch.spline(u), spline(u))
    with pytest.raises(FormatError, match=f"no spline volume; it holds: {patch.kind}"):
        macroshape.load(path)


@pytest.mark.parametrize("ending", ENDINGS)
def test_scalar_splines(tmp_path, ending):
    spline = make((2, 2, 2), (4, 4, 4), 0)
    splines.save(spline, tmp_path / f"a{ending}")
    (patch,) = splines.read_patches(tmp_path / f"a{ending}")
    u = sites(spline)
    assert same(patch.spline(u).reshape(-1), spline(u))
    assert patch.spline.m == (0 if ending in (".npz", ".json") else 1)
    with pytest.raises(FormatError, match="cannot be a map to space"):
        macroshape.load(tmp_path / f"a{ending}")


@pytest.mark.parametrize("ending", [".xml", ".itd", ".npz", ".json"])
def test_degree_zero(tmp_path, ending):
    spline = BSpline(
        [[0.0, 1, 3], [0, 0, 1, 1], [0, 1]], np.arange(12.0).reshape(2, 2, 1, 3), (0, 1, 0)
    )
    splines.save(spline, tmp_path / f"a{ending}")
    back = splines.read_patches(tmp_path / f"a{ending}")[0].spline
    assert np.array_equal(back.c, spline.c)


def test_what_a_format_cannot_hold_is_refused_before_writing(tmp_path):
    flat = BSpline([[0.0, 1], [0, 0, 1, 1], [0, 1]], np.zeros((1, 2, 1, 3)), (0, 1, 0))
    with pytest.raises(InputError, match="elevate"):
        splines.save(flat, tmp_path / "a.mesh")
    with pytest.raises(InputError, match="at most 9"):
        splines.save(make((1, 1, 1), (2, 2, 2), 10), tmp_path / "a.itd")
    with pytest.raises(InputError, match="SplineMap or a BSpline"):
        splines.save("spline", tmp_path / "a.itd")
    with pytest.raises(FormatError, match=r"ending '\.stl'"):
        splines.save(flat, tmp_path / "a.stl")
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("ending", ENDINGS)
def test_an_interrupted_save_leaves_the_old_file(tmp_path, ending, monkeypatch):
    path = tmp_path / f"a{ending}"
    splines.save(ZOO["trilinear"][0], path)
    before = path.read_bytes()

    def interrupt(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        splines.save(ZOO["rational"][0], path)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == [path.name]


@pytest.mark.parametrize("ending", ENDINGS)
def test_reading_what_is_not_there(tmp_path, ending):
    with pytest.raises(FormatError, match="cannot be read"):
        macroshape.load(tmp_path / f"nothing{ending}")
    (tmp_path / f"empty{ending}").touch()
    with pytest.raises(FormatError, match=f"empty{ending}"):
        macroshape.load(tmp_path / f"empty{ending}")


def test_unknown_endings_name_the_known_ones():
    with pytest.raises(FormatError, match=r"\.mesh is MFEM NURBS mesh"):
        macroshape.load("volume.step")


def test_a_file_of_several_patches_wants_a_choice():
    with pytest.raises(InputError, match=r"7 volumes.*: volume 0 .*(; volume.*){5}; volume 6 "):
        macroshape.load(CUBES)


def test_patches_are_chosen_by_index_although_ids_repeat():
    patches = splines.read_patches(CUBES)
    assert [p.index for p in patches] == list(range(7))
    assert {p.info["id"] for p in patches} == {"1"}
    for i, patch in enumerate(patches):
        expected = patch.spline.c
        assert np.array_equal(macroshape.load(CUBES, i).spline.c, expected)
        assert np.array_equal(macroshape.load(f"{CUBES}#{i}").spline.c, expected)
        assert np.array_equal(macroshape.load(CUBES, str(i)).spline.c, expected)
    assert not np.array_equal(patches[1].spline.c, patches[2].spline.c)


def test_patches_are_chosen_by_name():
    path = DATA / "irit" / "volumes.itd"
    assert macroshape.load(path, "SLAB").spline.shape == (3, 2, 2)
    assert macroshape.load(f"{path}#BLOCK").spline.shape == (2, 2, 2)
    with pytest.raises(InputError, match="near: SLAB"):
        macroshape.load(path, "SLUB")


@pytest.mark.parametrize("choice", [7, -1, "7", "no such name", 1.5, True])
def test_choices_that_do_not_exist(choice):
    with pytest.raises(InputError, match="patch"):
        macroshape.load(CUBES, choice)


def test_a_file_name_with_the_mark_is_taken_whole(tmp_path):
    splines.save(ZOO["trilinear"][0], tmp_path / "a#1.xml")
    assert macroshape.load(tmp_path / "a#1.xml").spline.shape == (2, 2, 2)


def test_names_that_a_text_format_cannot_keep(tmp_path):
    spline = make((1, 1, 1), (2, 2, 2), 4)
    path = tmp_path / "a.json"
    splines.save(SplineMap(spline, names=("größe",)), path)
    assert macroshape.load(path).names == ("größe",)


def test_descriptions():
    lines = [str(p) for p in splines.list_patches(DATA / "irit" / "volumes.itd")]
    assert lines[1] == (
        "volume 1 'QUARTER': 3 x 2 x 2 control points of degree (2, 1, 1), 3 coordinates, rational"
    )
    assert lines[2].endswith("7 coordinates, periodic")
    assert lines[3].startswith("curve 'EDGE': 3 control points")


def test_load_is_the_door_of_the_macro_shapes(tmp_path):
    from ilattice import macroshape

    corners = [(i, j, k) for k in (0, 1) for j in (0, 1) for i in (0, 2)]
    shape = hexahedron(np.array(corners, dtype=float))
    shape.save(tmp_path / "a.itd")
    assert macroshape.load(tmp_path / "a.itd").volume() == pytest.approx(shape.volume(), rel=1e-14)


@pytest.mark.parametrize(
    "kind", ["unclamped", "closed rational", "closed linear", "repeated knots"]
)
def test_clamping_keeps_the_function(kind):
    spline, _ = ZOO[kind]
    ends = clamped(spline)
    for t, k, n in zip(ends.t, ends.k, ends.shape, strict=True):
        assert (t[: k + 1] == t[0]).all()
        assert (t[n:] == t[-1]).all()
    assert np.array_equal(ends.domain, spline.domain)
    u = sites(spline)
    assert same(ends(u), spline(u), 1e-13)
