"""Half-thicknesses with kinks, as text, in space, at scattered points: against what was asked."""

import re
import warnings

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import InputError, PrecisionWarning
from ilattice.offsets.kinks import JumpError, fit_with_kinks
from ilattice.offsets.scattered import Scattered
from ilattice.offsets.thickness import FIT_TOLERANCE, as_thickness

UNIT = np.array([[0.0] * 3, [1.0] * 3])
RNG = np.random.default_rng(71)
A, B, C = RNG.uniform(0.2, 0.8, 3)


@pytest.fixture(scope="module")
def lattice():
    return il.Lattice("schwarz_p", through=il.macroshape.box((3, 2, 1)), repeat=(3, 2, 1))


@pytest.fixture(scope="module")
def bent():
    return il.Lattice("gyroid", through=il.macroshape.torus(), repeat=(8, 2, 2))


ALIGNED = {
    "interp": lambda u: np.interp(u[:, 0], [0, A, 0.7, 1], [0.05, 0.1, 0.02, 0.08]),
    "clip": lambda u: np.clip(0.1 * u[:, 1], 0.03, 0.07),
    "maximum": lambda u: np.maximum(0.05, 0.1 * u[:, 2]),
    "abs": lambda u: 0.05 + 0.1 * np.abs(u[:, 0] - 0.5),
    "several": lambda u: (
        np.maximum(0.05, 0.1 * u[:, 0]) * np.clip(u[:, 1] + 0.2, 0.5, 0.9)
        * (1 + 0.3 * np.abs(u[:, 2] - C))
    ),
    "sqrt": lambda u: 0.02 + 0.1 * np.sqrt(u[:, 1]),
    "narrow": lambda u: 0.03 + 0.05 * np.exp(-(((u[:, 2] - B) / 0.01) ** 2)),
}  # fmt: skip
ACROSS = {
    "cone": lambda u: 0.03 + 0.1 * np.linalg.norm(u - 0.5, axis=1),
    "diagonal": lambda u: 0.03 + 0.1 * np.abs(u[:, 0] - u[:, 1]),
    "plane": lambda u: np.maximum(0.03, u @ [0.03, 0.05, 0.07] - 0.05),
}


def off(spline, f):
    """Largest error at random points, and at points close to places where kinks are."""
    rng = np.random.default_rng(9)
    u = rng.random((20_000, 3))
    u[:5000] = 0.5 + 0.02 * (u[:5000] - 0.5)
    u[5000:8000, 0] = A + 1e-4 * (u[5000:8000, 0] - 0.5)
    u[8000:11000, 2] = B + 1e-3 * (u[8000:11000, 2] - 0.5)
    return np.max(np.abs(spline(u) - f(u)) / np.maximum(f(u), 0.01 * f(u).max()))


@pytest.mark.parametrize("name", ALIGNED)
def test_kinks_between_planes_are_fitted_like_smooth_functions(lattice, name):
    f = ALIGNED[name]
    t = as_thickness(f, lattice)
    assert off(t.outer, f) < 10 * FIT_TOLERANCE
    assert t.deviation < 10 * FIT_TOLERANCE


@pytest.mark.parametrize("name", ACROSS)
def test_the_error_of_a_fit_is_found_where_it_is(name):
    f = ACROSS[name]
    spline, found = fit_with_kinks(f, UNIT, 1e-7)
    assert off(spline, f) < 1.3 * found.relative
    assert found.relative < 0.02
    at = found.u[None]
    value = np.abs(spline(at) - f(at)) / f(at)
    assert value == pytest.approx(found.relative, rel=1e-6)


@pytest.mark.parametrize("name", ["cone", "diagonal", "interp"])
def test_meshes_and_slices_go_by_what_was_asked_where_the_fit_is_off(lattice, name):
    f = (ALIGNED | ACROSS)[name]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PrecisionWarning)
        wall = lattice.offset(f)
        mesh = wall.mesh(h=0.06)
    data = mesh.point_data
    on = (data["side"] != 0) & (data["unconverged"] == 0)
    u = np.stack([data[k] for k in "uvw"], axis=1)[on]
    error = np.abs(np.abs(lattice.distance(u)) - f(u)) / f(u)
    assert np.percentile(error, 99) < 1e-5
    assert wall.thickness_error(mesh).relative < 1e-5


def test_fits_that_are_off_are_told_and_jumps_are_refused(lattice):
    with pytest.warns(PrecisionWarning, match=r"off by 0\.\d+ % of it at u = .*quadrature"):
        wall = lattice.offset(ACROSS["diagonal"])
    assert 1e-3 < wall.thickness.deviation < 0.05
    with pytest.raises(InputError, match=r"d jumps from 0\.05 to 0\.08 .*by a ramp"):
        lattice.offset(lambda u: np.where(u[:, 0] < A, 0.05, 0.08))
    with pytest.raises(InputError, match="jumps or varies too fast"):
        lattice.offset(lambda u: np.where(u[:, 0] + 0.7 * u[:, 1] < A, 0.05, 0.08))
    with pytest.raises(JumpError):
        fit_with_kinks(lambda u: np.where(u[:, 2] < B, 0.05, 0.0502), UNIT, 1e-7)


def test_sides_may_vanish_behind_a_kink(lattice):
    """Next to it the values are small, and no jumps, however much they differ from zero there."""
    sides = 0.04, lambda u: np.maximum(0.0, 0.1 * (u[:, 0] - A))
    wall = lattice.offset(sides)
    u = RNG.random((2000, 3))
    np.testing.assert_allclose(wall.thickness.outer(u), sides[1](u), atol=1e-6)
    mesh = wall.mesh(h=0.06)
    data = mesh.point_data
    on = (data["side"] > 0) & (data["unconverged"] == 0)
    u = np.stack([data[k] for k in "uvw"], axis=1)[on]
    assert (u[:, 0] < A).any()
    assert (u[:, 0] > A).any()
    np.testing.assert_allclose(np.abs(lattice.distance(u)), sides[1](u), atol=1e-6)
    with pytest.raises(JumpError):
        fit_with_kinks(lambda u: np.where(u[:, 2] < B, 0.0, 0.02), UNIT, 1e-7)
    with pytest.raises(InputError, match="both sides vanish"):
        lattice.offset((0.0, sides[1]))


def test_scaling_to_a_density_keeps_kinks(lattice):
    f = ALIGNED["interp"]
    wall = lattice.offset(f, relative_density=0.25)
    u = RNG.random((50, 3))
    ratio = wall.thickness.at(u, np.ones(50)) / f(u)
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-12)
    np.testing.assert_allclose(wall.thickness.outer(u) / f(u), ratio[0], rtol=1e-4)


def test_properties_of_tiles_may_have_kinks():
    tile = il.tiles.schwarz_p().with_properties(t=lambda u: 0.03 + 0.04 * np.abs(u[:, 0] - 0.37))
    lattice = il.Lattice(tile, through=il.macroshape.box((2, 1, 1)), repeat=(2, 1, 1))
    f = il.lattice.offset  # the property jumps from tile to tile: 0.37 and 0.63 from the kink
    with pytest.raises(InputError, match=r"d jumps from 0\.05"):
        f(lattice, "t")
    tile = tile.with_properties(t=lambda u: 0.03 + 0.04 * np.abs(u[:, 0] - 0.5))
    lattice = il.Lattice(tile, through=il.macroshape.box((2, 1, 1)), repeat=(2, 1, 1))
    u = RNG.random((500, 3))
    asked = 0.03 + 0.04 * np.abs(np.mod(2 * u[:, 0], 1) - 0.5)
    np.testing.assert_allclose(as_thickness("t", lattice).outer(u), asked, atol=1e-6)


# ------------------------------------------------------------------------------ equations


@pytest.mark.parametrize(
    ("text", "f"),
    [
        (
            "max(0.05, 0.1*u) + 0.01*v",
            lambda u, _: np.maximum(0.05, 0.1 * u[:, 0]) + 0.01 * u[:, 1],
        ),
        ("0.05 + 0.01*abs(z)", lambda _, x: 0.05 + 0.01 * np.abs(x[:, 2])),
        ("0.04 + 0.001*X*y", lambda _, x: 0.04 + 0.001 * x[:, 0] * x[:, 1]),
        ("1e-1/2", lambda u, _: np.full(len(u), 0.05)),
    ],
)
def test_texts_are_equations_in_parameters_or_in_space(bent, text, f):
    if "X" in text:
        text = f"({text}) + 0.03"
    u = RNG.random((300, 3))
    asked = f(u, bent.through.x(u)) + 0.03 * ("X" in text)
    t = as_thickness(text, bent)
    np.testing.assert_allclose(t.at(u, np.ones(300)), asked, rtol=1e-12)
    np.testing.assert_allclose(t.outer(u), asked, rtol=2e-4)


def test_fields_are_functions_of_space_and_equations_of_what_they_name(bent):
    u = RNG.random((200, 3))
    x = bent.through.x(u)
    ball = il.fields.sphere(1.0)  # |x| - 1
    size = np.linalg.norm(x, axis=1)
    near = as_thickness(il.fields.scale(ball, 1.0), bent, size=100.0)
    np.testing.assert_allclose(near.at(u, np.ones(200)), size - 1, rtol=1e-12)
    own = il.fields.equation("0.05 + 0.02*w", variables=("u", "v", "w"))
    np.testing.assert_allclose(as_thickness(own, bent).outer(u), 0.05 + 0.02 * u[:, 2], rtol=1e-5)


@pytest.mark.parametrize(
    ("d", "match"),
    [
        ("0.05 + 0.01*u*x", "mixes u, v, w"),
        ("0.05 + q", r"it is no equation \(.*'q'.*, and the lattice has no property"),
        (il.fields.equation("0.05 + a", variables=("a", "b", "c")), "is an equation in a;"),
        (
            il.fields.union(
                il.fields.equation("0.1*u", variables=("u", "v", "w")), il.fields.sphere(1.0)
            ),
            "mixes u, v, w",
        ),
    ],
)
def test_other_equations_are_refused(bent, d, match):
    with pytest.raises(InputError, match=match):
        bent.offset(d)


def test_a_name_of_a_property_wins_over_an_equation():
    through = il.macroshape.box((1, 1, 1)).with_extra(u=0.07)
    t = as_thickness("u", il.Lattice("schwarz_p", through=through))
    np.testing.assert_allclose(t.outer(RNG.random((9, 3))), 0.07)


# ------------------------------------------------------------------------------ scattered data


def test_scattered_values_are_interpolated_in_space(bent):
    rng = np.random.default_rng(3)
    u = rng.random((80, 3))
    x = bent.through.x(u)

    def f(x):
        return 0.08 + 0.01 * np.sin(x[:, 0]) + 0.005 * x[:, 2]

    with pytest.warns(
        PrecisionWarning, match=r"stands for d is off by [\d.]+ % .* go by it"
    ) as told:
        wall = bent.offset(points=x, values=f(x))
    t = wall.thickness
    np.testing.assert_allclose(t.outer(u), f(x), rtol=1e-2)
    number = float(re.search(r"off by ([\d.]+) %", str(told[0].message)).group(1)) / 100
    anywhere, asked = rng.random((20_000, 3)), Scattered(bent, x, f(x))
    off = np.abs(t.outer(anywhere) / asked(anywhere) - 1).max()
    assert off > 2e-3
    assert off < 1.1 * number < 2.0 * off
    assert np.median(np.abs(t.outer(u) / f(x) - 1)) < 1e-3
    other = rng.random((500, 3))
    values = t.outer(other)
    assert values.min() > 0.98 * f(x).min()
    assert values.max() < 1.02 * f(x).max()
    assert np.abs(values - f(bent.through.x(other))).max() < 0.01


def test_scattered_values_are_refused_or_told_where_they_say_too_little(bent):
    rng = np.random.default_rng(4)
    x = bent.through.x(0.3 * rng.random((200, 3)))
    with pytest.warns(PrecisionWarning, match=r"\d\d% of the part is farther from all points"):
        bent.offset(points=x, values=np.full(200, 0.1))
    for points, values, match in (
        (x, np.full(199, 0.1), r"must be as many.*\(200, 3\) and \(199,\)"),
        (x, np.linspace(-0.1, 0.1, 200), r"values\[0\] is -0\.1"),
        (x[[0, 1, 0]], [0.1, 0.1, 0.2], "is there twice, with values 0.2 and 0.1"),
    ):
        with pytest.raises(InputError, match=match):
            bent.offset(points=points, values=values)
    with pytest.raises(InputError, match="together, in place of d"):
        bent.offset(0.1, points=x, values=np.full(200, 0.1))
    with pytest.raises(InputError, match="for offsets in space"):
        bent.offset(0.1, space="parametric", points=x)
