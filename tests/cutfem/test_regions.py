"""Loads and supports on parts of the boundary in space, and resultants."""

import numpy as np
import pytest

import ilattice as il
from ilattice.cutfem import Elasticity, Heat
from ilattice.cutfem.regions import as_place
from ilattice.errors import GeometryError, InputError, PrecisionWarning

pytestmark = pytest.mark.filterwarnings("ignore:.*energy:ilattice.errors.PrecisionWarning")


@pytest.fixture(scope="module")
def bar():
    """A bar of 4 x 1 x 1, cut by no grid plane, on cells that do not fit it."""
    body = il.fields.translate(il.fields.box((2.0, 0.5, 0.5)), (2.03, 0.48, 0.51))
    grid = il.cutfem.cut(body, (14, 5, 5), domain=[[-0.2, -0.2, -0.2], [4.3, 1.2, 1.2]])
    return il.cutfem.Elasticity(grid, young=100.0, poisson=0.0, degree=2)


@pytest.fixture(scope="module")
def wall():
    through = il.macroshape.torus(major=3.0, width=1.4)
    return il.Lattice("schwarz_p", through=through, repeat=(8, 1, 1), spans_per_tile=6).offset(0.12)


def total(problem, about):
    """Sum and moment of the forces on the functions, by the reaction of rigid fields."""
    asm, f = problem.assembly, problem.forces()
    x = asm.coordinates - about
    return f.sum(axis=0), np.cross(x, f).sum(axis=0)


def test_regions_in_space_are_held_and_loaded_like_faces(bar):
    """A tension test: the ends are named by where they are."""
    held = bar.clamp("x < 0.030001", components="n").clamp("y < -0.019999", components="n")
    solved = (
        held.clamp("z < 0.010001", components="n")
        .load(force=(7.0, 0, 0), on=lambda x: x[:, 0] > 4.029999)
    ).solve()  # fmt: skip
    at = solved.at([[4.02, 0.3, 0.8], [2.03, 0.7, 0.3]])
    np.testing.assert_allclose(at.displacement[:, 0], [7 / 100 * 3.99, 7 / 100 * 2.0], rtol=1e-6)
    np.testing.assert_allclose(at.stress[:, 0], 7.0, rtol=1e-6)
    held = solved.reactions
    assert set(held) == {"x < 0.030001", "y < -0.019999", "z < 0.010001"}
    np.testing.assert_allclose(held["x < 0.030001"], [-7.0, 0, 0], atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_resultants_are_exact_on_any_region(wall, seed):
    """Random half-spaces through a curved wall: the sums are what was asked for."""
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=3), rng.uniform(0.5, 2.0)
    force, moment = rng.normal(size=(2, 3))
    problem = il.cutfem.Elasticity(wall, (24, 4, 4), degree=1).clamp("v=0")

    def region(x):
        return x @ a > b

    f, _ = total(problem.load(force=force, on=region), np.zeros(3))
    np.testing.assert_allclose(f, force, rtol=1e-9, atol=1e-12)
    f, m = total(problem.load(moment=moment, on=region), np.zeros(3))
    np.testing.assert_allclose(f, 0.0, atol=1e-9)
    # degree 1 in a curved map reproduces turns to second order in the cells
    np.testing.assert_allclose(m, moment, rtol=0.05, atol=0.05 * np.abs(moment).max())


def test_moments_bend_a_bar(bar):
    """Euler-Bernoulli is exact at Poisson's ratio 0: curvature M / (E I)."""
    M = 0.7
    held = bar.clamp("x < 0.030001")
    solved = held.load(moment=(0, M, 0), on=[[4.029999, -9, -9], [9, 9, 9]]).solve()
    tip = solved.at([[4.0, 0.48, 0.51]]).displacement[0, 2]
    assert tip == pytest.approx(-M * (4.0 - 0.03) ** 2 / (2 * 100 / 12), rel=2e-3)
    force = held.load(force=(0, 0, -0.2), on="x > 4.029999").load(
        force=(0, 0, 0.1), on="x > 4.029999"
    )
    np.testing.assert_allclose(force.forces().sum(axis=0), [0, 0, -0.1], atol=1e-9)


def test_names_are_narrowed_and_areas_known(wall):
    problem = il.cutfem.Elasticity(wall, (24, 4, 4), degree=1)
    half = problem.clamp("w=0", where="x > 0")
    whole = problem.domain.boundary("w=0").weights.sum()
    part = problem.domain.boundary(half.supports[0].on).weights.sum()
    assert part == pytest.approx(whole / 2, rel=0.02)
    assert str(half.supports[0].on) == "w=0 where x > 0"
    everything = problem.domain.boundary("boundary").weights.sum()
    names = ["v=0", "v=1", "w=0", "w=1", "surface"]
    sums = sum(problem.domain.boundary(name).weights.sum() for name in names)
    assert everything == pytest.approx(sums, rel=1e-12)
    twice = half.spring("x > 0", 1.0).spring("x > 0", 2.0)
    assert [str(s.on) for s in twice.springs] == ["x > 0", "x > 0 (2)"]


def test_heat_flows_between_regions(bar):
    heat = il.cutfem.Heat(bar.domain, conductivity=2.0).fix("x < 0.030001", 1.0)
    solved = heat.fix([[4.029999, -9, -9], [9, 9, 9]], 3.0).solve()
    assert solved.at([[2.03, 0.5, 0.5]]).temperature[0] == pytest.approx(2.0, rel=1e-6)
    assert sum(solved.inflow.values()) == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize(
    ("act", "error", "match"),
    [
        (lambda p: p.clamp("x > 9"), GeometryError, r"no surface there; the nearest is 4.97 away"),
        (lambda p: p.clamp(lambda x: x[:, 0] > 9), GeometryError, "the surface reaches from"),
        (lambda p: p.clamp("x = 9"), InputError, "on must be one of"),
        (lambda p: p.clamp("x > y*y"), InputError, "not linear"),
        (lambda p: p.clamp(lambda x: x[:, 0]), InputError, "returns n booleans"),
        (lambda p: p.clamp(lambda _: True), InputError, "returns n booleans"),
        (lambda p: p.clamp("x > 1", where="y > 0"), InputError, "where narrows"),
        (lambda p: p.clamp("x > 1", method="strong"), InputError, "only whole end faces.*nitsche"),
        (lambda p: p.load(force=(1, 0, 0)), InputError, "need a place"),
        (lambda p: p.load(force=1.0, on="x > 1"), InputError, "force"),
        (lambda p: p.load(gravity=(1, 0, 0), on=lambda x: x[:, 0] > 1), InputError, "place"),
    ],
)
def test_what_makes_no_sense_is_refused(bar, act, error, match):
    with pytest.raises(error, match=match):
        act(bar)


def test_areas_of_regions_are_known_and_told():
    """Edges pass through cells without dividing them: 17 % of a load were lost without a word."""
    bar = lambda u: -np.ones(len(u))  # noqa: E731
    rng = np.random.default_rng(3)
    u, off, told = rng.random((200_000, 3)), [], []
    for k in range(30):
        n, (a, b) = int(rng.integers(3, 9)), rng.uniform(0.15, 0.85, 2)
        away = rng.standard_normal(2)
        conditions = (
            lambda x, a=a, b=b: (x[:, 1] - a) ** 2 + (x[:, 2] - b) ** 2 < 0.09,
            lambda x, a=a: x[:, 1] < a,
            lambda x, a=a, b=b, d=away: d[0] * (x[:, 1] - a) + d[1] * (x[:, 2] - b) < 0,
        )
        problem = il.cutfem.Elasticity(bar, (2, n, n), domain=[[0, 0, 0], [4, 1, 1]])
        region = as_place("u=1", conditions[k % 3])
        true = conditions[k % 3](u).mean()
        found = problem.domain.boundary(region).weights.sum()
        off.append(abs(found / true - 1))
        told.append(problem.domain.area_error(region))
    off, told = np.array(off), np.array(told)
    assert (off > 0.01).sum() > 8
    assert (off < 1.5 * told + 0.01).all()
    assert np.median(told[off > 0.01] / off[off > 0.01]) < 2.0
    problem = il.cutfem.Elasticity(bar, (4, 2, 2), domain=[[0, 0, 0], [4, 1, 1]]).clamp("u=0")
    for act in (
        lambda: problem.load(traction=(1, 0, 0), on="u=1", where="y < 0.3"),
        lambda: problem.spring("u=1", 1.0, where=lambda x: x[:, 1] < 0.3),
        lambda: problem.clamp("u=1", where="y < 0.3"),
    ):
        with pytest.warns(PrecisionWarning, match="y < 0.3: its area is off|lambda: its area"):
            act()
    problem.load(force=(1, 0, 0), on="u=1", where="y < 0.3")
    problem.load(traction=(1, 0, 0), on="u=1", where="y < 0.5")


def test_conditions_that_hold_on_the_surface_alone_are_not_blamed():
    grid = il.cutfem.cut(
        il.fields.cylinder(0.4), (6, 6, 4), domain=[[-0.5, -0.5, 0], [0.5, 0.5, 1]]
    )
    problem = il.cutfem.Elasticity(grid).clamp("w=0")
    problem.load(pressure=1.0, on=lambda x: np.abs(np.hypot(x[:, 0], x[:, 1]) - 0.4) < 1e-6)


def test_places_without_area_and_temperatures_that_are_not_there_are_told():
    bare = il.cutfem.Elasticity(il.fields.box(1.0), 3)
    with pytest.raises(GeometryError, match="ends of its own bounds"):
        bare.clamp("u=0")
    whole = lambda u: -np.ones(len(u))  # noqa: E731
    heat = il.cutfem.Heat(whole, (2, 2, 2), domain=[[0, 0, 0], [2, 1, 1]])
    warm = heat.fix("u=0", 0.0).fix("u=1", 4.0).solve()
    bar = il.cutfem.Elasticity(whole, (5, 2, 2), domain=[[0, 0, 0], [4, 1, 1]], expansion=1e-3)
    with pytest.raises(InputError, match="temperature: the solution of heat has none at"):
        bar.clamp("u=0").load(temperature=warm).solve()


def test_supports_that_contradict_where_regions_overlap_are_refused():
    """They were averaged without a word."""
    whole = lambda u: -np.ones(len(u))  # noqa: E731
    bar = il.cutfem.Elasticity(whole, (4, 2, 2), domain=[[0, 0, 0], [4, 1, 1]])
    for first in ("x < 0.001", "u=0"):
        held = bar.clamp(first).load(force=(0, 0, 1), on="u=1")
        with pytest.raises(InputError, match="contradict each other"):
            held.clamp("x < 0.002", value=(1, 0, 0)).solve()
        held.clamp("x < 0.002").clamp("y < 0.001", value=(0, 0, 0)).solve()
        held.clamp("u=1", value=(1, 0, 0), where="z > 0.5").solve()


def two_bars():
    """Two bars beside each other, of which a support at x = -2 that ends at y = 0 holds one."""
    f = il.fields
    solid = f.difference(f.box((2.0, 1.0, 0.5)), f.box((3.0, 0.2, 1.0)))
    box = [[-2.0, -1.0, -0.5], [2.0, 1.0, 0.5]]
    both = Elasticity(solid, (8, 10, 4), domain=box, young=10.0, degree=1)
    return both.clamp(lambda x: (x[:, 0] < -2 + 1e-9) & (x[:, 1] < 0.0))


@pytest.mark.filterwarnings("ignore:left out", "ignore:the cells are too coarse")
@pytest.mark.parametrize("load", [{"force": (0, 0, -1.0)}, {"pressure": 1.0}])
def test_loads_on_parts_that_nothing_holds_are_not_lost_without_a_word(load):
    end = lambda x: (x[:, 0] > 2 - 1e-9) & (x[:, 1] > 0.0)  # noqa: E731
    with pytest.raises(GeometryError, match=f"{next(iter(load))} on .*held by nothing .1 part"):
        two_bars().load(**load, on=end).solve()
    both = two_bars().load(**load, on="x > 1.999999")
    with pytest.warns(PrecisionWarning, match="50 % of its area is on parts that were left out"):
        got = sum(both.solve().reactions.values())
    whole = [1.0 * 0.8 / 2 * 2, 0.0, 0.0] if "pressure" in load else [0.0, 0.0, 1.0]
    np.testing.assert_allclose(got, whole, atol=1e-6)


@pytest.mark.filterwarnings("ignore:left out", "ignore:the cells are too coarse")
def test_heat_into_parts_that_nothing_holds_is_not_lost_without_a_word():
    warm = Heat(two_bars().domain.cut, None).fix("x < -1.999999 and y < 0", 0.0)
    with pytest.raises(GeometryError, match=r"flux on .*held by nothing"):
        warm.flux(lambda x: (x[:, 0] > 2 - 1e-9) & (x[:, 1] > 0.0), 1.0).solve()


def test_temperatures_are_those_at_the_same_points_of_space():
    """From a solution in another box, where it is x + 1, against that function."""
    full, unit = (lambda u: -np.ones(len(u))), [[0.0] * 3, [1.0] * 3]

    def warm(lo, hi):
        room = il.macroshape.box(lo=lo, hi=hi)
        heat = Heat(full, (5, 3, 3), domain=unit, through=room)
        return heat.fix("u=0", lo[0] + 1.0).fix("u=1", hi[0] + 1.0).solve()

    solid = Elasticity(
        full, (6, 2, 2), domain=unit, through=il.macroshape.box((4.0, 1.0, 1.0)), young=10.0,
        poisson=0.0, expansion=1e-3,
    )  # fmt: skip
    for name in ("u=0", "v=0", "w=0"):
        solid = solid.clamp(name, components="n")
    hot = solid.load(temperature=warm((-1.0, -1.3, -1.1), (9.0, 2.0, 2.7))).solve()
    x = np.array([[0.7, 0.2, 0.4], [2.3, 0.6, 0.1], [3.9, 0.5, 0.5]])
    wanted = solid.load(temperature=lambda x: x[:, 0] + 1.0).solve().at(x).displacement
    np.testing.assert_allclose(hot.at(x).displacement, wanted, rtol=1e-6, atol=1e-12)
    with pytest.raises(InputError, match="the solution of heat has none at"):
        solid.load(temperature=warm((-1.0, -1.3, -1.1), (2.2, 2.0, 2.7))).solve()
