"""Which splines analyses take when nobody says."""

import numpy as np
import pytest

import ilattice as il
from ilattice.cutfem.choosing import FEW, MANY, MANY_OF_WALLS, degree_for

BOX = [[0.0] * 3, [1.0] * 3]


def block(n: int, **options: object) -> il.cutfem.Elasticity:
    """A cube that fills all cells."""
    return il.cutfem.Elasticity(lambda u: -np.ones(len(u)), n, domain=BOX, **options)


@pytest.fixture(scope="module")
def struts() -> il.cutfem.CutGrid:
    lattice = il.Lattice("diamond", through=il.macroshape.box(), repeat=(3, 3, 3))
    return il.cutfem.cut(lattice.offset((np.inf, 0.0)), 24)


def count(solid: il.cutfem.CutGrid) -> int:
    return int((solid.status <= 0).sum())


def test_thick_solids_have_degree_two_and_large_ones_degree_one() -> None:
    assert block(8).domain.degree == 2
    middle = block(24)
    assert FEW < count(middle.domain.cut) < MANY
    assert middle.domain.degree == 2
    large = block(40)
    assert count(large.domain.cut) > MANY
    assert (large.domain.degree, large.domain.q, large.domain.stabilization) == (1, 2, "void")


def test_struts_of_a_few_cells_have_degree_one_and_walls_degree_two(
    struts: il.cutfem.CutGrid,
) -> None:
    assert FEW < count(struts) < MANY
    assert degree_for(struts, True)[0] == 1
    lattice = il.Lattice("gyroid", through=il.macroshape.box(), repeat=(3, 3, 3))
    wall = il.cutfem.cut(lattice.offset(0.02), 24)
    assert FEW < count(wall) < MANY
    assert degree_for(wall, True)[0] == 2
    assert il.cutfem.Elasticity(wall).domain.degree == 2
    assert il.cutfem.Heat(wall).domain.degree == 1  # heat does not bend it
    finer = il.cutfem.cut(lattice.offset(0.02), 44)
    assert MANY < count(finer) < MANY_OF_WALLS
    assert (degree_for(finer, True)[0], degree_for(finer, False)[0]) == (2, 1)
    finest = il.cutfem.cut(lattice.offset(0.02), 52)
    assert count(finest) > MANY_OF_WALLS
    assert degree_for(finest, True)[0] == 1


def test_networks_in_stretched_cells_have_degree_two(monkeypatch: pytest.MonkeyPatch) -> None:
    def network(long: float) -> il.cutfem.CutGrid:
        lattice = il.Lattice("diamond", through=il.macroshape.box((long, 1, 1)), repeat=(3, 3, 3))
        return il.cutfem.cut(lattice.offset((np.inf, 0.0), space="parametric"), 24)

    long, usual = network(4.0), network(2.0)
    assert FEW < count(long) < MANY
    assert degree_for(long, True) == (2, f"100 % of {count(long):,} cells are stretched")
    assert degree_for(long, False)[0] == degree_for(usual, True)[0] == 1  # heat does not bend it
    monkeypatch.setattr("ilattice.cutfem.choosing.MANY", count(long) - 1)
    assert degree_for(long, True) == (1, f"{count(long):,} cells are many")
    flat = il.cutfem.Grid((np.linspace(0.0, 1.0, 25),) * 2 + (np.linspace(0.0, 4.0, 25),))
    tile = il.cutfem.cut(lambda u: np.cos(2 * np.pi * u).sum(axis=1) + 1.0, flat)
    monkeypatch.setattr("ilattice.cutfem.choosing.MANY", MANY)
    monkeypatch.setattr("ilattice.cutfem.choosing.FEW", 1000)
    assert "stretched" in degree_for(tile, True)[1]


@pytest.mark.parametrize("law", [il.cutfem.Elasticity, il.cutfem.Heat])
def test_what_is_given_is_kept(struts: il.cutfem.CutGrid, law: type) -> None:
    assert law(struts).domain.degree == 1
    for degree in (1, 2, 3):
        assert law(struts, degree=degree).domain.degree == degree
    for given in (
        {"smoothness": 0}, {"smoothness": 1}, {"q": 3}, {"stabilization": "ghost"},
        {"weight": 1e-3},
    ):  # fmt: skip
        domain = law(struts, **given).domain
        assert domain.degree == 2
        assert not domain.chosen
        assert all(getattr(domain, name) == value for name, value in given.items())


def test_materials_that_keep_volume_and_phases_have_degree_two(struts: il.cutfem.CutGrid) -> None:
    assert il.cutfem.Elasticity(struts, poisson=0.49).domain.degree == 2
    assert il.cutfem.Elasticity(struts, poisson=0.49, degree=1).domain.degree == 1
    assert il.cutfem.Elasticity(struts, phases="u - 0.51").domain.degree == 2


def test_cells_that_repeat_have_degree_two() -> None:
    tile = il.tiles["diamond"]
    cell = il.homogenize.elastic.__globals__["ElasticCell"](tile, 24)
    assert count(cell.domain.cut) > FEW
    assert cell.domain.degree == 2


def test_reports_say_which_and_why(struts: il.cutfem.CutGrid) -> None:
    problem = il.cutfem.Heat(struts).fix("w=0", 0.0).fix("w=1", 1.0)
    with pytest.warns(il.errors.PrecisionWarning, match="take finer cells"):
        report = problem.solve().report
    assert report.splines.startswith("degree 1, smoothness 0 (chosen: ")
    assert f"{count(struts):,} cells are cut" in report.splines
    held = block(4, degree=2, poisson=0.0).clamp("w=0", components="z")
    small = held.clamp("u=0", components="xy").load(body=(0, 0, 1.0)).solve().report
    assert small.splines == "degree 2, smoothness 1"


def test_studies_refuse_degrees_that_differ(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ilattice.cutfem.choosing.MANY", 300)

    def build(n: tuple[int, int, int]) -> il.cutfem.HeatSolution:
        cube = il.cutfem.Heat(lambda u: -np.ones(len(u)), n, domain=BOX)
        return cube.fix("w=0", 0.0).source(1.0).solve()

    monkeypatch.setattr("ilattice.cutfem.choosing.FEW", 100)
    with pytest.raises(il.errors.InputError, match="another degree"):
        il.cutfem.refinement_study(build, [4, 6, 8], {"stored": lambda s: s.stored})


def test_degrees_are_checked() -> None:
    for wrong in ("two", 0, 4, 2.0, True, None):
        with pytest.raises(il.errors.InputError, match="degree"):
            block(4, degree=wrong)
