"""Parts that nothing holds: not drawn, not probed, not loaded, and told."""

import re
import warnings

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import GeometryError, InputError, PrecisionWarning

pytestmark = pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")


@pytest.fixture(scope="module")
def bars():
    """Two bars beside each other, of which one is held."""
    f = il.fields
    gap = f.difference(f.box((2.0, 1.0, 0.5)), f.box((3.0, 0.2, 1.0)))
    problem = il.cutfem.Elasticity(
        gap, (8, 10, 4), domain=[[-2, -1, -0.5], [2, 1, 0.5]], young=10.0, strength=1.0, degree=1
    )
    return problem.clamp(lambda x: (x[:, 0] < -2 + 1e-9) & (x[:, 1] < 0))


@pytest.fixture(scope="module")
def chipped():
    """A gyroid in a box: its lone corners hang on nothing, and touch cells of the rest."""
    box = il.macroshape.box((20.0, 10, 10))
    wall = il.Lattice("gyroid", through=box, repeat=(2, 1, 1)).offset(0.8)
    problem = il.cutfem.Elasticity(wall, (12, 6, 6), young=3500.0, strength=5.0, degree=1)
    return problem.clamp("u=0").load(force=(0, 0, -20.0), on="u=1").solve()


def test_chips_are_neither_drawn_nor_probed(chipped, tmp_path):
    problem = chipped.problem
    loose = problem.domain.parts.seen(problem.parts[1])
    assert len(loose) == 1
    volume, middle = problem.domain.parts.measure(int(loose[0]))
    mesh, whole = chipped.surface(1.0), problem.domain.wall.mesh(1.0, polish=False)
    assert mesh.components == whole.components - 1
    assert whole.volume - mesh.volume == pytest.approx(volume, rel=0.15)
    assert np.linalg.norm(mesh.vertices - middle, axis=1).min() > 1.5
    solid = chipped.to_pyvista("solid").points
    assert np.linalg.norm(solid - middle, axis=1).min() > 1.5
    with pytest.raises(InputError, match="outside of the solid"):
        chipped.at([middle])
    assert chipped.at([middle], outside="nan").inside.tolist() == [False]
    chipped.report(tmp_path / "a.html", pictures=False)
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "class='caution'>Left out, because nothing holds them: 1 part" in text


def test_loads_on_what_is_left_out_are_refused(bars):
    def away(x):
        return (x[:, 0] > 2 - 1e-9) & (x[:, 1] > 0)

    for load in ({"force": (0, 0, -1.0)}, {"moment": (0, 0, -1.0)}, {"pressure": 1.0}):
        with pytest.raises(GeometryError, match="held by nothing, and is left out"):
            bars.load(**load, on=away).solve()
    heat = il.cutfem.Heat(bars.domain, conductivity=1.0).fix("y < -0.99999", 0.0)
    with pytest.raises(GeometryError, match="held by nothing"):
        heat.flux(away, 1.0).solve()


def test_loads_of_which_a_part_is_left_out_come_with_a_warning(bars):
    for load, said in (({"force": (0, 0, -1e-3)}, "acts on the rest"),
                       ({"pressure": 1e-3}, "is not there")):  # fmt: skip
        with pytest.warns(PrecisionWarning, match=f"50 % of the area .* {said}"):
            solved = bars.load(**load, on="x > 1.999999").solve()
    force = sum(bars.load(force=(0, 0, -1e-3), on="x > 1.999999").solve().reactions.values())
    np.testing.assert_allclose(force, [0, 0, 1e-3], atol=1e-9)
    assert solved.energy > 0


def test_solutions_without_loads_have_reports(bars, tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        solved = bars.solve()
    assert solved.safety_factor == np.inf
    solved.report(tmp_path / "a.html", pictures=False)
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    number = r"(-?[0-9.]+)"
    told = re.search(rf"\(from \(-2, {number}, {number}\) to \(-2, {number}, {number}\)\)", text)
    points = np.array(told.groups(), float)  # the outermost points of the end
    np.testing.assert_allclose(points, [-1.0, -0.5, -0.2, 0.5], atol=0.06)
    assert len(repr(solved)) < 100
