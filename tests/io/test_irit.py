import re
from pathlib import Path

import numpy as np
import pytest

from ilattice import macroshape
from ilattice.errors import FormatError
from ilattice.io import splines
from ilattice.macroshape import SplineMap

PATH = Path(__file__).parents[1] / "data" / "irit" / "volumes.itd"
TEXT = PATH.read_text()


def read(tmp_path, text):
    path = tmp_path / "a.itd"
    path.write_text(text)
    return splines.list_patches(path)


def test_everything_in_the_file_is_listed():
    patches = splines.list_patches(PATH)
    assert [p.name for p in patches] == ["SLAB", "QUARTER", "", "EDGE", "SKIN", "BLOCK"]
    assert [p.index for p in patches] == [0, 1, 2, None, None, 3]
    assert patches[0].info == {"COLOR": "4"}
    assert [p.name for p in splines.read_patches(PATH)] == ["SLAB", "QUARTER", "", "BLOCK"]


def test_orders_and_first_direction_fastest():
    slab = macroshape.load(PATH, 0)
    assert slab.spline.k == (1, 1, 1)
    assert slab.spline.t[0].tolist() == [0, 0, 1, 3, 3]
    u = np.random.default_rng(0).uniform(0, 1, (20, 3)) * [3, 1, 1]
    assert np.abs(slab.x(u) - u).max() < 1e-15


def test_projective_points_are_divided_by_their_weight():
    quarter = macroshape.load(PATH, "QUARTER")
    assert quarter.spline.k == (2, 1, 1)
    assert quarter.spline.weights[1, 0, 0] == 0.7071067811865476
    assert np.array_equal(quarter.spline.c[1, 0, 0], [1, 1, 0])
    u = np.random.default_rng(0).uniform(0, 1, (50, 3))
    x = quarter.x(u)
    assert np.abs(np.hypot(x[:, 0], x[:, 1]) - 1 - u[:, 1]).max() < 1e-14


def test_periodic_knots_and_seven_coordinates():
    ring = macroshape.load(PATH, 2)
    assert ring.spline.periodic == (True, False, False)
    assert ring.spline.shape == (6, 2, 2)
    assert ring.domain[:, 0].tolist() == [0, 4]
    assert ring.closed == (True, False, False)
    assert ring.spline.m == 7
    u = np.array([[0, 0, 0], [4, 0, 0], [1.5, 1, 1.0]])
    assert np.array_equal(ring.x(u[:1]), [[0.5, 0.5, 0]])  # mean of the first two
    assert np.array_equal(ring.x(u[:1]), ring.x(u[1:2]))
    assert np.allclose(ring.extra(u)[2], [1, 1, 1, 0.175])


def test_names_survive(tmp_path):
    ring = macroshape.load(PATH, 2)
    named = SplineMap(ring.spline, names=("r", "g", "b", "d"))
    splines.save(named, tmp_path / "a.itd")
    assert '[COORDINATES "r,g,b,d"]' in (tmp_path / "a.itd").read_text()
    assert macroshape.load(tmp_path / "a.itd").names == ("r", "g", "b", "d")


def test_a_geometry_needs_no_object(tmp_path):
    text = "[CURVE BEZIER 2 E1 [0] [1]]"
    assert read(tmp_path, text)[0].spline.c.tolist() == [[0], [1]]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: s[:900], "line "),
        (lambda s: s + "]", "line 52: found ']'; expected '['"),
        (lambda s: "x" + s, "line 1: found 'x'"),
        (lambda s: s.replace("[OBJECT EDGE", "[OBJECT EDGE EDGE"), "found 'EDGE'; expected '['"),
        (lambda s: s.replace("3 2 2 2 2 2 E3", "3 2 2 2 2 E3"), "found 'E3'; expected order"),
        (
            lambda s: s.replace("3 2 2 2 2 2 E3", "3 2 2 2 2 2 Q3"),
            "line 4: found 'Q3'; expected a point",
        ),
        (
            lambda s: s.replace("3 2 2 2 2 2 E3", "4 2 2 2 2 2 E3"),
            "line 5: found ']'; expected knots",
        ),
        (lambda s: s.replace("3 2 2 2 2 2 E3", "1000000 1000000 2 2 2 2 E3"), "cannot fit"),
        (
            lambda s: s.replace("3 2 2 2 2 2 E3", "-3 2 2 2 2 2 E3"),
            "found '-3'; expected number of",
        ),
        (
            lambda s: s.replace("3 2 2 2 2 2 E3", "3 2 2 11 2 2 E3"),
            "line 4: found '11'; expected order",
        ),
        (lambda s: s.replace("3 2 2 2 2 2 E3", "3 2 2 2 2 2 E9"), "in control points; expected"),
        (lambda s: s.replace("[KV 0 0 1 3 3]", "[KV 0 0 5 3 3]"), "knot 4 is 3 after 5"),
        (lambda s: s.replace("[KV 0 0 1 3 3]", "[KV 0 0 1 3 nan]"), "line 5: found 'nan'"),
        (lambda s: s.replace("[KV 0 0 1 3 3]", "[KVX 0 0 1 3 3]"), "found 'KVX'; expected 'KV'"),
        (lambda s: s.replace("[KVP -2", "[KVP -3"), "not periodic"),
        (lambda s: s.replace("[1 1 0]", "[1 1]"), "in control points; expected"),
        (lambda s: s.replace("[1 1 0]", "[1 1 a]"), "line 9: found 'a' in control points"),
        (lambda s: s.replace("[1 1 0 0]", "[0 1 0 0]"), "weights must be positive"),
        (lambda s: s.replace('"steel # 1"', '"steel # 1'), "never closed"),
        (lambda _: "", "is empty"),
        (lambda s: s.replace("[OBJECT\n", '[OBJECT [COORDINATES "a,b"]\n'), "2 names"),
    ],
)
def test_what_is_wrong_is_said(tmp_path, change, message):
    text = change(TEXT)
    assert text != TEXT
    with pytest.raises(FormatError, match=re.escape(message)) as caught:
        read(tmp_path, text)
    assert "a.itd" in str(caught.value)
