"""Loads and supports on parts of the boundary in space, and resultants."""

import numpy as np
import pytest

import ilattice as il
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
        (lambda p: p.load(gravity=3), InputError, "gravity must be a vector of 3"),
        (lambda p: p.load(body=1.0), InputError, "body must be a vector of 3"),
        (lambda p: p.load(traction=3, on="x > 1"), InputError, "traction must be a vector of 3"),
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


@pytest.mark.parametrize("size", [0.1, 0.01])
def test_conditions_far_from_the_origin_pick_what_they_say(size):
    """The end of a bar at a million: its area, by a condition, a box and a flat box."""
    at = 1e6
    box = il.macroshape.box(lo=(at, 0, 0), hi=(at + size, 0.1 * size, 0.1 * size))
    full = lambda u: -np.ones(len(u))  # noqa: E731
    problem = il.cutfem.Elasticity(full, (10, 2, 2), domain=[[0, 0, 0], [1, 1, 1]], through=box)
    end = at + size
    places = (f"x > {at + 0.9995 * size!r}", [[at + 0.9995 * size, -1, -1], [end + 1, 1, 1]],
              [[end, 0, 0], [end, 0.1 * size, 0.1 * size]],
              f"x > np.float64({at + 0.9995 * size!r})")  # fmt: skip
    for place in places:
        on = problem.load(traction=(1.0, 0, 0), on=place).loads[0].on
        assert problem.domain.boundary(on).weights.sum() == pytest.approx(0.01 * size**2, rel=1e-6)


def test_boxes_whose_corners_are_swapped_are_told_of():
    problem = il.cutfem.Elasticity(il.fields.box(1.0), 4, domain=[[-1.0] * 3, [1.0] * 3], degree=1)
    with pytest.raises(InputError, match="first corner of a box must be below"):
        problem.clamp([[1, 0, 0], [0.5, 1, 1]])


def test_rigid_places_that_share_points_with_supports_are_told_of():
    full = lambda u: -np.ones(len(u))  # noqa: E731
    problem = il.cutfem.Elasticity(full, 4, domain=[[0, 0, 0], [1, 1, 1]], degree=1).clamp("u=0")
    for place in ("v=0", "x < 1e-9"):
        with pytest.raises(InputError, match="cannot move: it shares points"):
            problem.rigid(place, force=(1, 0, 0)).solve()
    with pytest.raises(InputError, match="rigid connection on u=1 cannot move"):
        problem.rigid("u=1").rigid("v=1", force=(1, 0, 0)).solve()


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
def test_heat_takes_parts_of_places():
    full = lambda u: -np.ones(len(u))  # noqa: E731
    heat = il.cutfem.Heat(full, 4, domain=[[0, 0, 0], [1, 1, 1]], degree=1)
    solved = heat.fix("u=0", 0.0, where="y < 0.5").flux("u=1", 2.0, where="z > 0.5").solve()
    assert sum(solved.inflow.values()) == pytest.approx(-1.0, rel=1e-6)
    mixed = heat.convection("u=0", 3.0, around=1.0, where="y < 0.5").solve()
    assert mixed.at([[0.5, 0.5, 0.5]]).temperature[0] == pytest.approx(1.0)
    for result in (solved, heat.fix("u=0", 1.0).evolve(1.0, steps=3)):
        assert len(repr(result)) < 150


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
def test_temperatures_of_other_maps_go_by_places_in_space():
    """Heat in a larger box: x + 1; a bar in it grows by the integral, or is refused beyond."""
    full, unit = lambda u: -np.ones(len(u)), [[0, 0, 0], [1, 1, 1]]
    bar = il.macroshape.box((4.0, 1.0, 1.0))
    solid = il.cutfem.Elasticity(full, (6, 2, 2), domain=unit, through=bar, young=10.0,
                                 poisson=0.0, expansion=1e-3)  # fmt: skip
    for face in ("u=0", "v=0", "w=0"):
        solid = solid.clamp(face, components="n")
    for end, there in ((9.0, True), (2.0, False)):
        box = il.macroshape.box(lo=(-1.0, -1.0, -1.0), hi=(end, 2.0, 2.0))
        heat = il.cutfem.Heat(full, (5, 3, 3), domain=unit, through=box)
        hot = heat.fix("u=0", 0.0).fix("u=1", end + 1.0).solve()
        if not there:
            with pytest.raises(InputError, match="solution of heat has none at"):
                solid.load(temperature=hot).solve()
            continue
        found = [
            solid.load(temperature=t).solve().at([[4, 0.5, 0.5]]).displacement[0]
            for t in (hot, lambda x: x[:, 0] + 1.0)
        ]
        np.testing.assert_allclose(found[0], found[1], rtol=1e-7)
        assert found[0][0] == pytest.approx(1e-3 * (4 + 8), rel=0.02)


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
@pytest.mark.parametrize("by", [1e-5, 1.0])
def test_frequencies_of_free_bars_go_with_their_size(by):
    """As small in its units as a bar of 100 micrometres in metres is."""
    full = lambda u: -np.ones(len(u))  # noqa: E731
    bar = il.macroshape.box((10 * by, 0.6 * by, 0.4 * by))
    problem = il.cutfem.Elasticity(full, (12, 2, 2), domain=[[0, 0, 0], [1, 1, 1]], through=bar,
                                   young=2.1e11, density=7850.0)  # fmt: skip
    modes = il.cutfem.natural_modes(problem, 8)
    euler = (
        4.7300407**2 / (2 * np.pi * (10 * by) ** 2) * np.sqrt(2.1e11 * (0.4 * by) ** 2 / 12 / 7850)
    )
    assert modes.frequencies[6] == pytest.approx(euler, rel=0.01)
    assert len(repr(modes)) < 150
