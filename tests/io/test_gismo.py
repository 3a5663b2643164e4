import base64
import re
from pathlib import Path

import numpy as np
import pytest

from ilattice import macroshape
from ilattice.errors import FormatError
from ilattice.io import splines

DATA = Path(__file__).parents[1] / "data" / "gismo"


def det(spline, count=9):
    lo, hi = spline.domain
    axes = [np.linspace(a, b, count) for a, b in zip(lo, hi, strict=True)]
    return np.linalg.det(spline.grid(axes, 1)[1])


def test_cylinder_is_round_and_left_handed():
    shape = macroshape.load(DATA / "cylinder.xml")
    lo, hi = shape.domain
    u = np.random.default_rng(0).uniform(lo, hi, (200, 3))
    for v, radius in ((0.0, 0.5), (1.0, 1.0)):
        u[:, 1] = v
        x = shape.x(u)
        assert np.abs(np.hypot(x[:, 0], x[:, 1]) - radius).max() < 1e-12
    assert np.ptp(shape.x(u)[:, 2]) > 3
    assert shape.closed == (True, False, False)
    assert det(shape.spline).max() < 0
    assert shape.orientation == -1


def test_g_shape():
    shape = macroshape.load(DATA / "GshapedVolume.xml")
    assert shape.spline.shape == (9, 3, 3)
    assert shape.spline.k == (2, 2, 2)
    assert shape.spline.t[0][3] == 0.142857142857
    assert np.array_equal(shape.spline.c[0, 0, 0], [0.737, 0.631, 0])
    assert np.array_equal(shape.spline.c[8, 0, 0], [0.474, 0.384, 0])
    assert np.array_equal(shape.spline.c[0, 1, 0], [0.795, 0.667, 0])
    assert np.array_equal(shape.spline.c[0, 0, 1], [0.737, 0.631, 0.5])
    assert shape.orientation == -1


def test_fichera_has_seven_patches_of_both_orientations():
    patches = splines.read_patches(DATA / "fichera.xml")
    signs = [np.sign(det(p.spline)) for p in patches]
    assert [int(s.flat[0]) for s in signs] == [1, 1, 1, -1, -1, -1, -1]
    assert all((s == s.flat[0]).all() for s in signs)
    corners = {tuple(c) for p in patches for c in p.spline.c.reshape(-1, 3)}
    assert len(corners) == 26  # of the 27 of a cube, one is missing
    assert [p.info["id"] for p in patches] == [str(i) for i in range(7)]


def test_cubes_fill_a_cube_of_three():
    patches = splines.read_patches(DATA / "cube.xml")
    volume = 0.0
    points, weights = np.polynomial.legendre.leggauss(3)
    axes = [0.5 * (points + 1)] * 3
    for p in patches:
        d = np.linalg.det(p.spline.grid(axes, 1)[1])
        volume += abs(np.einsum("ijk,i,j,k", d, weights, weights, weights)) / 8
    assert volume == pytest.approx(27, rel=1e-13)


TEXT = (DATA / "cylinder.xml").read_text()


def read(tmp_path, text):
    path = tmp_path / "a.xml"
    path.write_text(text)
    return splines.list_patches(path)


def test_base64_fractions_and_uniform_knots(tmp_path):
    expected = read(tmp_path, TEXT)[0].spline
    coded = base64.b64encode(expected.weights.T.ravel().tobytes()).decode()
    text = re.sub(r"<weights>[^<]*", f'<weights format="B64Float64">{coded}\n', TEXT)
    text = text.replace("0.5 0.5 4.0", "1/2 +1/2 8/2")
    text = text.replace(
        '<KnotVector degree="1">0.0 0.0 1.0 1.0</KnotVector>',
        '<KnotVector degree="1" mode="uniform" csize="2"/>',
    )
    found = read(tmp_path, text)[0].spline
    assert np.array_equal(found.weights, expected.weights)
    assert np.array_equal(found.c, expected.c)
    assert all(map(np.array_equal, found.t, expected.t))
    single = base64.b64encode(expected.weights.T.ravel().astype("<f4").tobytes()).decode()
    text = re.sub(r"<weights>[^<]*", f'<weights format="B64Float32">{single}', TEXT)
    assert np.abs(read(tmp_path, text)[0].spline.weights - expected.weights).max() < 1e-7


def test_nearly_equal_knots_are_made_equal(tmp_path):
    text = TEXT.replace("1.0 1.0 2.0 2.0", "1.0 1.0000000001 2.0 1.9999999999")
    assert np.array_equal(read(tmp_path, text)[0].spline.t[0], [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4])


def test_comments_and_labels(tmp_path):
    text = (
        "<!-- one --><!-- two\n-->\n <?xml version='1.0' encoding='utf-8'?>\n<!-- three -->" + TEXT
    )
    text = text.replace('"TensorNurbs3"', '"TensorNurbs3" label="ring"')
    text = text.replace("0.5 0.5 4.0", "0.5 <!-- here\n --> 0.5 4.0")
    assert read(tmp_path, text)[0].name == "ring"


def test_other_geometries_are_skipped_and_named(tmp_path):
    text = '<xml><Geometry type="TensorTHBSpline3" id="0"/></xml>'
    assert read(tmp_path, text) == []
    with pytest.raises(FormatError, match=r"TensorTHBSpline3 in line 1 \(not supported\)"):
        macroshape.load(tmp_path / "a.xml")


BOMB = """<?xml version="1.0"?>
<!DOCTYPE xml [<!ENTITY a "0 0 0 0 0 0"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>
<xml>&b;</xml>"""


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda _: BOMB, "line 2: a document type is not allowed"),
        (lambda s: s.replace("<xml>", "<!DOCTYPE xml SYSTEM '/etc/passwd'><xml>"), "document type"),
        (lambda s: s.replace("<xml>", "<xml>&a;"), "line 1: not well-formed"),
        (lambda s: s[: len(s) // 2], "not well-formed"),
        (lambda _: "<xml>" + "<a>" * 200, "more than 64 deep"),
        (lambda s: s.replace("xml>", "svg>"), "root element is <svg>"),
        (
            lambda s: s.replace("0.5 4.0", "0.5 x", 1),
            "line 17: <coefs>: found 'x'; expected numbers",
        ),
        (lambda s: s.replace("0.5 4.0", "0.5 nan", 1), "found 'nan'"),
        (lambda s: s.replace("0.5 4.0", "0.5 1/0", 1), "found '1/0'"),
        (
            lambda s: s.replace("0.5 4.0", "0.5", 1),
            "line 17: <coefs>: found 107 numbers; expected 108",
        ),
        (lambda s: s.replace("geoDim", "dim"), "no attribute 'geoDim'"),
        (lambda s: s.replace('geoDim="3"', 'geoDim="1000000000000"'), "geoDim is '1000000000000'"),
        (
            lambda s: s.replace('degree="2"', 'degree="9"'),
            "degree is '9'; expected a whole number from 0 to 8",
        ),
        (lambda s: s.replace('degree="2"', 'degree="-2"'), "line 7: <KnotVector>: degree is '-2'"),
        (lambda s: s.replace("0.0 1.0 1.0 2.0", "0.0 2.0 1.0 2.0"), "knots must not decrease"),
        (lambda s: s.replace("1.0 0.707", "-1.0 0.707", 1), "weights must be positive"),
        (lambda s: s.replace('index="1"', 'index="2"'), "index is 2; expected 1"),
        (lambda s: s.replace("weights>", "weight>"), "holds 0 elements <weights>"),
        (lambda s: s.replace("0.0 0.0 1.0 1.0</K", "0.0 0.0 0.0 0.0</K"), "must bound a domain"),
        (lambda s: s.replace("0.5 4.0", "0.5 1e200", 1), "not above 1e"),
        (lambda s: s.replace("0.0 0.0 1.0 1.0<", "0 0 1e-150 1e-150<"), "at least 1e-100 apart"),
        (
            lambda s: s.replace(
                "</xml>", "<MultiPatch><patches type='id_range'>0 9</patches></MultiPatch></xml>"
            ),
            "ids 0 to 9: not every one",
        ),
        (
            lambda s: s.replace(
                "</xml>", "<MultiPatch><patches type='id_index'>5</patches></MultiPatch></xml>"
            ),
            "id '5' names no Geometry",
        ),
        (lambda s: s.replace("<weights>", "<weights format='B64Float64'>"), "no b64float64 data"),
        (lambda s: s.replace("<weights>", "<weights format='zip'>"), "format is 'zip'"),
    ],
)
def test_what_is_wrong_is_said(tmp_path, change, message):
    text = change(TEXT)
    assert text != TEXT
    with pytest.raises(FormatError, match=re.escape(message)) as caught:
        read(tmp_path, text)
    assert "a.xml, line " in str(caught.value)
