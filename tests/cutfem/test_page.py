"""Pages about analyses: numbers, doubts and pictures in one file."""

import base64
import io
import re

import numpy as np
import pytest
from PIL import Image

import ilattice as il
from ilattice.errors import FormatError


def rod(**options):
    def field(u):
        return (u[:, :2] ** 2).sum(axis=1) - 0.25

    domain = [[-0.6, -0.6, 0], [0.6, 0.6, 4]]
    return il.cutfem.Elasticity(field, 4, domain=domain, degree=2, **options)


def rows(text):
    return dict(re.findall(r"<tr><th>(.*?)</th><td>(.*?)</td></tr>", text))


def test_pages_hold_the_numbers_and_nothing_from_elsewhere(tmp_path):
    solution = (
        rod(young=3.0, poisson=0.2, strength=9.0)
        .clamp("w=0", components="z").clamp("w=0", components="xy", method="nitsche")
        .load(traction=(0, 0, 2.0), on="w=1")
        .load(force=(0, 0, 0.5), on="z > 3.2 and x < 9")
        .solve()
    )  # fmt: skip
    path = tmp_path / "rod.html"
    solution.report(path)
    text = path.read_text(encoding="utf-8")
    assert "http" not in text
    assert "src='data:image/png;base64," in text
    told = rows(text)
    assert float(told["compliance"]) == pytest.approx(solution.compliance, rel=1e-4)
    assert float(told["volume"]) == pytest.approx(np.pi, rel=1e-4)
    assert float(told["young"]) == 3.0
    by_rules = float(told["error of the energy by integration"].removesuffix(" %")) / 100
    assert by_rules == pytest.approx(solution.report.integration_error, rel=0.05)
    assert 1e-9 < by_rules < 1e-3
    assert told["load 2"] == "force (0, 0, 0.5) at z &gt; 3.2 and x &lt; 9"
    assert told["support 1"] == "w=0: z = (0, 0, 0), exactly"
    assert told["support 2"].endswith("weakly")
    reaction = [float(v) for v in told["w=0"].strip("()").split(", ")]
    np.testing.assert_allclose(reaction[2], -2.0 * np.pi / 4 - 0.5, rtol=1e-3)
    assert float(told["safety factor"]) == pytest.approx(solution.safety_factor, rel=1e-4)
    pictures = re.findall(r"base64,([^']*)'", text)
    images = [np.asarray(Image.open(io.BytesIO(base64.b64decode(p)))) for p in pictures]
    assert len(images) == 3  # stress from two sides, and the margin
    assert min(np.ptp(image) for image in images) > 100


def test_pages_say_what_a_function_of_points_may_hide(tmp_path):
    told = {}
    ball = il.fields.sphere(0.7)
    for name, field in (("tree", ball), ("points", lambda u: ball(u))):
        body = il.cutfem.Elasticity(field, 4, domain=[[-1] * 3, [1] * 3], degree=1)
        with pytest.warns(il.errors.PrecisionWarning, match="too coarse"):
            solution = body.spring("surface", 1.0).load(gravity=(0, 0, -1)).solve()
        solution.report(tmp_path / f"{name}.html", pictures=False)
        text = (tmp_path / f"{name}.html").read_text(encoding="utf-8")
        told[name] = rows(text).get("specks and voids that a function of points may hide", "")
        assert (solution.report.unseen > 0.0) == (name == "points")
    assert told["tree"] == ""
    assert re.fullmatch(r"up to 0\.\d+ cells", told["points"])


def test_doubts_stand_first(tmp_path):
    weak = rod(strength=0.5).clamp("w=0").load(traction=(1.0, 0, 0), on="w=1")
    with pytest.warns(il.errors.PrecisionWarning):
        solution = weak.solve()
    solution.report(tmp_path / "weak.html", pictures=False)
    text = (tmp_path / "weak.html").read_text(encoding="utf-8")
    assert text.index("size of the cells") < text.index("The material yields") < text.index("<h2>")
    assert "<img" not in text
    sound = rod().clamp("w=0", components="z").clamp("w=0", components="xy", method="nitsche")
    sound.load(traction=(0, 0, 1.0), on="w=1").solve().report(tmp_path / "a.htm", pictures=False)
    assert "class='caution'" not in (tmp_path / "a.htm").read_text(encoding="utf-8")


def test_pages_of_heat_and_wrong_arguments(tmp_path):
    def field(u):
        return (u[:, :2] ** 2).sum(axis=1) - 0.25

    heat = il.cutfem.Heat(field, 4, domain=[[-0.6, -0.6, 0], [0.6, 0.6, 4]], conductivity=4.0)
    solution = heat.fix("w=0", 1.0).flux("w=1", 2.0).solve()
    solution.report(tmp_path / "heat.html", pictures=False)
    told = rows((tmp_path / "heat.html").read_text(encoding="utf-8"))
    assert float(told["conductivity"]) == 4.0
    assert float(told["w=0"]) == pytest.approx(-2.0 * np.pi / 4, rel=1e-3)
    for bad in ("heat.pdf", "heat"):
        with pytest.raises(FormatError, match="html"):
            solution.report(tmp_path / bad)
        assert not (tmp_path / bad).exists()
    with pytest.raises(FormatError):
        solution.report(tmp_path / "no" / "folder.html", pictures=False)
    assert solution.report.discretization_error < 1e-6
    assert "_result" not in repr(solution.report)
