"""Loads, supports and materials that are functions: what cells do not see of them is told.

The reference is the same function under a rule of ten points per direction, cell by cell.
"""

import re
import warnings
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import ilattice as il
from ilattice.cutfem import Elasticity, Heat, sampling
from ilattice.errors import InputError, PrecisionWarning
from ilattice.quadrature.rules import in_space

#: Numbers on coarse grids are what is tested here.
pytestmark = pytest.mark.filterwarnings("ignore:the cells are too coarse")

BOX = [[0, 0, 0], [4, 1, 1]]


def whole(u):
    return -np.ones(len(u))


def ball(u):
    return ((u - [2.0, 0.45, 0.5]) ** 2 * [0.1, 1, 1]).sum(axis=1) - 0.4**2


def along(f):
    """Vectors along x."""
    return lambda x: np.stack([f(x), 0 * x[:, 0], 0 * x[:, 0]], axis=1)


def rule_of(cut, place, q):
    if place == "volume":
        return in_space(cut.volume(q))
    return in_space(cut.surface(q) if place == "surface" else cut.face(place, q))


def lost(cut, place, q, f):
    """Part of the size of a function that a rule is off by, cell by cell."""
    rule, fine = rule_of(cut, place, q), rule_of(cut, place, 10)
    off = rule.integrate_cells(f(rule.points)) - fine.integrate_cells(f(fine.points))
    return np.linalg.norm(off, axis=1).sum() / fine.integrate(
        np.linalg.norm(f(fine.points), axis=1)
    )


PLACES = [(whole, "volume"), (whole, "u=1"), (ball, "volume"), (ball, "surface")]


@pytest.mark.parametrize("mapped", [False, True])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("solid", "place"), PLACES)
def test_what_is_lost_is_what_a_better_rule_finds(solid, place, seed, mapped):
    rng = np.random.default_rng([11, seed, mapped])
    through = il.macroshape.duck() if mapped else None
    domain = BOX if through is None else through.domain
    low, high = np.asarray(domain, float)
    field = (lambda u: solid((u - low) / (high - low) * [4, 1, 1])) if mapped else solid
    problem = Elasticity(field, (5, 2, 3), domain=domain, through=through)
    cut, asm = problem.domain.cut, problem.assembly
    size = np.ptp(asm.coordinates, axis=0).max()
    for waves in (0.1, 0.8, 3.0, 6.0, 11.0, 23.0):
        k = rng.standard_normal(3)
        k *= 2 * np.pi * waves / size / np.linalg.norm(k)
        f = along(lambda x, k=k: 1.0 + np.sin(x @ k + 1.0))
        denser = partial(problem.domain.denser, place * (place != "volume"))
        found = sampling.unseen(asm, rule_of(cut, place, 4), denser, f)
        wanted = lost(cut, place, 4, f)
        assert found == pytest.approx(wanted, abs=0.01 + 0.25 * wanted)


def wave(x):
    """Twelve waves on eight cells, of which rules of four points see a quarter."""
    return np.sin(2 * np.pi * 12 / 4 * x[:, 0]) ** 2


def all_of(f):
    """The same in all directions."""
    return lambda x: np.repeat(f(x)[:, None], 3, axis=1)


def stripes(x):
    return 1e2 * (np.abs(x[:, 1] - 0.25) < 0.005)


def sin(x):
    return 1.5 + np.sin(40 * x[:, 1])


BAR = Elasticity(whole, (8, 2, 2), domain=BOX, expansion=1e-3, density=lambda x: 0.1 + wave(x))
HELD = BAR.clamp("u=0")
WARM = Heat(whole, (8, 2, 2), domain=BOX).fix("u=0", 0.0)
FORCED = HELD.load(body=(0, 0, 1.0))
BALL = Elasticity(ball, (8, 2, 2), domain=BOX).clamp("x<1", method="nitsche")
UNSEEN = {
    "body": HELD.load(body=along(wave)),
    "gravity": HELD.load(gravity=along(wave)),
    "density": HELD.load(gravity=(0, 0, 1.0)),
    "temperature": HELD.load(temperature=wave),
    "traction on u=1": HELD.load(traction=along(stripes), on="u=1"),
    "pressure on v=1": HELD.load(pressure=wave, on="v=1"),
    "pressure on surface": BALL.load(pressure=lambda x: 1 + np.sin(60 * x[:, 0]), on="surface"),
    "source": WARM.source(wave),
    "flux on u=1": WARM.flux("u=1", stripes),
    "stiffness on u=1": FORCED.spring("u=1", all_of(sin)),
    "value on u=1": FORCED.spring("u=1", 1.0, value=along(sin)),
    "value on u=1 ": FORCED.clamp("u=1", value=along(sin), method="nitsche"),
    "value on u=1  ": FORCED.clamp("u=1", value=along(sin)),
    "value on u=1   ": WARM.fix("u=1", sin),
    "transfer on u=1": WARM.convection("u=1", sin, around=1.0),
    "value on v=1": WARM.convection("v=1", 1.0, around=wave),
}


@pytest.mark.parametrize("name", UNSEEN)
def test_functions_that_cells_do_not_see_are_told_or_refused(name):
    match = f"{name.strip()} jumps or waves .*% of it"
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        try:
            UNSEEN[name].solve()
        except InputError as e:
            seen.append(warnings.WarningMessage(PrecisionWarning(str(e)), PrecisionWarning, "", 0))
    told = [str(w.message) for w in seen]
    assert any(re.match(match, text) for text in told), told


def test_what_is_half_lost_is_refused_with_the_number():
    """The resultant was 0.518 instead of 2, with an error of 3.5e-5, and 0 instead of 1."""
    with pytest.raises(InputError, match=r"body jumps or waves .* about 74 % of it would be lost"):
        HELD.load(body=along(wave)).solve()
    with pytest.raises(InputError, match=r"traction on u=1 jumps .* would be lost"):
        HELD.load(traction=along(stripes), on="u=1").solve()
    one = BALL.load(body=along(lambda x: 1e2 * (np.abs(x[:, 0] - 2.25) < 0.005)))
    with pytest.raises(InputError, match="body jumps"):
        one.solve()


MASSES = {
    "density": lambda f: il.cutfem.natural_modes(
        Elasticity(whole, (8, 2, 2), domain=BOX, density=f).clamp("u=0"), 2
    ),
    "capacity": lambda f: (
        Heat(whole, (8, 2, 2), domain=BOX, capacity=f).fix("u=0", 0.0).evolve(0.1, steps=2)
    ),
    "initial": lambda f: WARM.evolve(0.1, steps=2, initial=f),
}


@pytest.mark.parametrize("name", MASSES)
def test_masses_and_starts_that_cells_do_not_see_are_told_or_refused(name):
    with pytest.raises(InputError, match=f"{name} jumps or waves .*would be lost"):
        MASSES[name](lambda x: 1e-3 + 1e2 * (np.abs(x[:, 0] - 2.25) < 0.005))
    with pytest.warns(PrecisionWarning, match=f"{name} jumps or waves .* about"):
        MASSES[name](lambda x: 1.0 + 0.3 * np.sin(2 * np.pi * 9.3 * (x[:, 0] + x[:, 1])))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "the cells are too coarse")
        MASSES[name](lambda x: 2.0 + np.sin(x[:, 0]) + x[:, 2])
        MASSES[name](1.0)


def test_functions_that_cells_see_are_not_told():
    def smooth(x):
        return 1.0 + 0.5 * np.sin(2.0 * x[:, 0] + x[:, 1]) + x[:, 2] ** 3

    body = Elasticity(ball, (8, 3, 3), domain=BOX, density=smooth, expansion=1e-3)
    body = body.clamp("x<1.5").spring("surface", all_of(smooth), value=along(smooth))
    body = body.load(body=along(smooth), gravity=along(smooth), temperature=smooth)
    bar = Elasticity(whole, (6, 3, 3), domain=BOX).clamp("u=0", value=along(smooth))
    bar = bar.load(traction=along(smooth), on="u=1").load(pressure=smooth, on="v=1", where="x<2")
    warm = Heat(ball, (8, 3, 3), domain=BOX, degree=1).convection("surface", smooth, around=smooth)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "the cells are too coarse")
        for problem in (body, bar, warm.source(smooth)):
            assert np.isfinite(problem.solve().coefficients).all()


def test_a_spot_in_one_of_many_cells_is_found():
    """All of the heat comes from a thirtieth of one cell."""
    block = Heat(whole, 14, domain=[[0] * 3, [1] * 3], degree=1, q=2).fix("u=0", 0.0)
    spot = block.source(lambda x: np.exp(-400 * ((x - [0.41, 0.55, 0.63]) ** 2).sum(axis=1) * 20))
    with pytest.raises(InputError, match="source jumps or waves"):
        spot.solve()


def test_a_thin_soft_layer_in_a_cell_is_told():
    """The energy was 2 instead of 7, and the estimate 0."""
    soft = Elasticity(
        whole, (4, 2, 2), domain=BOX, young=lambda x: np.where(abs(x[:, 0] - 2.5) < 0.005, 1e-3, 1)
    )
    with pytest.warns(PrecisionWarning, match="young jumps or waves"):
        assert soft.clamp("u=0").matrix.shape


def test_functions_of_the_points_of_a_rule_alone_are_taken():
    """Such as tractions by normals that are known there."""
    rule = BALL.domain.edge(BALL.assembly, "surface")
    pushed = BALL.load(traction=lambda x: -rule.normals + 0 * x, on="surface")
    wanted = BALL.load(pressure=1.0, on="surface")
    np.testing.assert_allclose(pushed.forces(), wanted.forces(), atol=1e-12)
    assert pushed.solve().energy == pytest.approx(wanted.solve().energy, rel=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_many_points_of_two_heights_do_not_tell_of_higher_powers(seed):
    """Rounding told them apart in cells of hundreds of points, and smooth sources were refused."""
    rng = np.random.default_rng([21, seed])
    axis, many, low = rng.integers(3), 200, rng.uniform(-100, 100, 3)
    box = np.array([low, low + rng.uniform(0.5, 2.0, 3)])
    problem = Heat(whole, (3, 2, 2), domain=box)
    rule = problem.domain.cut.volume(1)
    t = rng.random((many, 3))
    t[:, axis] = np.where(np.arange(many) % 2, 0.21132486540518713, 0.7886751345948129)
    t[:, axis] += 1e-13 * rng.standard_normal(many)
    boxes = rule.grid.boxes(rule.cells)
    rule = replace(
        rule,
        points=(boxes[:, None, :3] + t * boxes[:, None, 3:]).reshape(-1, 3),
        weights=np.repeat(rule.weights / many, many),
        offsets=np.arange(len(boxes) + 1) * many,
    )
    k = rng.standard_normal(3)
    f = along(lambda x: 1.0 + 0.3 * np.sin((x - low) @ k))
    asm, denser = problem.assembly, partial(problem.domain.denser, "")
    assert sampling.unseen(asm, in_space(rule), denser, f) < 0.3
