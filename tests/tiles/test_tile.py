import copy
import pickle

import numpy as np
import pytest
from conformance import check_field

import ilattice as il
from ilattice._field import ABILITIES
from ilattice.bspline import BSpline
from ilattice.errors import ConvergenceError, GeometryError, InputError, PrecisionWarning
from ilattice.tiles import Tile, TrigField
from ilattice.tiles.tpms import ROWS

RNG = np.random.default_rng(0)


def ball(u):
    """Smooth, not periodic: a ball about a point off the centre."""
    return np.sum((u - np.array([0.4, 0.5, 0.55])) ** 2, axis=1) - 0.09


def wavy(u):
    """Periodic in x only."""
    return np.cos(2 * np.pi * u[:, 0]) * u[:, 1] + u[:, 2] ** 2 - 0.4


def spline(c=None, k=2, **options):
    c = RNG.normal(size=(5, 6, 7)) if c is None else c
    t = [np.concatenate([[0.0] * k, np.linspace(0, 1, n - k + 1), [1.0] * k]) for n in c.shape[:3]]
    return BSpline(t, c, k, **options)


# ---------------------------------------------------------------------------------- fields


@pytest.mark.parametrize(
    "tile",
    [
        pytest.param(lambda: il.tiles.gyroid(level=0.2), id="trig"),
        pytest.param(lambda: Tile(spline(), level=0.1), id="spline"),
        pytest.param(lambda: Tile(ball).fit(tol=1e-5), id="fitted"),
        pytest.param(lambda: Tile(TrigField.parse("cosX", period=0.7)), id="trig of odd period"),
    ],
)
def test_tiles_conform(tile):
    made = tile()
    made_of_spline = isinstance(made.field, BSpline)
    field = _WithBreaks(made) if made_of_spline else made
    check_field(field, np.random.default_rng(1), converges=not made_of_spline)


class _WithBreaks:
    """A tile that tells the suite where the knots of its field are."""

    def __init__(self, tile):
        self._tile = tile
        self.breaks = tile.field.breaks

    def __call__(self, u):
        return self._tile(u)

    def __getattr__(self, name):
        if name in ABILITIES and not self._tile.has(name):
            raise AttributeError(name)
        return getattr(self._tile, name)


def test_a_callable_tile_conforms_up_to_its_tolerance():
    tile = Tile(wavy)
    rng = np.random.default_rng(2)
    p = rng.random((300, 3))
    np.testing.assert_array_equal(tile(p), wavy(p))
    f, g, hess = tile.jet(p)
    X, y, z = 2 * np.pi * p[:, 0], p[:, 1], p[:, 2]
    exact = np.stack([-2 * np.pi * np.sin(X) * y, np.cos(X), 2 * z], axis=1)
    np.testing.assert_allclose(f, wavy(p), atol=2e-5)
    np.testing.assert_allclose(g, exact, atol=1e-3)
    np.testing.assert_allclose(hess[:, 2, 2], 2.0, atol=0.02)
    axes = [rng.random(4), rng.random(5), rng.random(6)]
    q = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    np.testing.assert_array_equal(tile.grid(axes), wavy(q).reshape(4, 5, 6))
    assert tile.grid(axes, np.float32).dtype == np.float32
    assert np.isinf(tile.range([[0, 0, 0]], [[1, 1, 1]])).all()
    with pytest.raises(InputError, match="lo <= hi"):
        tile.range([[1, 1, 1]], [[0, 0, 0]])


def test_kernel_fields_are_trigonometric_or_splines():
    gyroid = il.tiles.gyroid()
    assert gyroid.kernel_field is gyroid.field
    p = RNG.random((50, 3))
    for tile in (
        il.tiles.gyroid(level=0.3),
        Tile(spline(), level=0.2),
        Tile(TrigField.parse("cosX cosY", period=0.5), level=0.1),
    ):
        assert isinstance(tile.kernel_field, type(tile.field))
        np.testing.assert_allclose(tile.kernel_field(p), tile(p), atol=1e-14)
    for field in (TrigField.parse("cosX", period=0.7), gyroid.field.placed(2.3 * np.eye(3))):
        tile = Tile(field)
        assert isinstance(tile.kernel_field, BSpline)
        np.testing.assert_allclose(tile.kernel_field(p), tile(p), atol=3e-5)


def test_a_rational_field_gets_a_spline_without_weights():
    tile = Tile(spline(weights=RNG.uniform(0.8, 1.2, (5, 6, 7))), tol=1e-2)
    p = RNG.random((500, 3))
    assert tile.kernel_field.weights is None
    np.testing.assert_allclose(tile.kernel_field(p), tile(p), atol=1.5e-2)


def test_a_kink_is_reported_where_derivatives_are_needed():
    tile = Tile(lambda u: np.abs(u[:, 2] - 0.43) - 0.2, name="slab")
    assert tile([[0, 0, 0.43]])[0] == -0.2
    with pytest.warns(PrecisionWarning, match=r"slab.*deviates by 0\.00"):
        _ = tile.kernel_field
    _ = tile.kernel_field  # told once


def test_tol_of_the_stand_in():
    coarse, fine = Tile(wavy, tol=1e-3), Tile(wavy, tol=1e-6)
    p = RNG.random((2000, 3))
    errors = [np.abs(t.kernel_field(p) - wavy(p)).max() for t in (coarse, fine)]
    assert errors[0] < 1e-3
    assert errors[1] < 2e-6
    assert coarse.kernel_field.shape[0] < fine.kernel_field.shape[0]


# ------------------------------------------------------------------------------------ fits


@pytest.mark.parametrize("tol", [1e-3, 1e-5])
def test_a_fit_meets_its_tolerance_at_points_of_its_own(tol):
    gyroid = il.tiles.gyroid(level=0.2)
    tile = gyroid.fit(tol=tol)
    assert isinstance(tile.field, BSpline)
    assert tile.level == 0.0
    assert tile.field.periodic == (True, True, True)
    assert (tile.name, tile.source) == (gyroid.name, gyroid.source)
    p = np.random.default_rng(3).random((5000, 3))
    assert np.abs(tile(p) - gyroid(p)).max() <= 1.1 * tol
    bounds = tile.range([[0.2, 0.3, 0.4]], [[0.3, 0.4, 0.5]])
    assert bounds.shape == (1, 2)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_fits_of_the_catalogue_meet_their_tolerance_at_fresh_points(row):
    tile, tol = il.tiles[row.name], 2e-3 * (row.range[1] - row.range[0])
    p = np.random.default_rng(5).random((20_000, 3))
    p[::4, 0] = np.round(p[::4, 0])  # on faces, too
    assert np.abs(tile.fit(tol=tol)(p) - tile(p)).max() <= tol


def test_from_callable():
    tile = Tile.from_callable(ball, tol=1e-6, name="ball", degree=2)
    assert (tile.name, tile.field.k) == ("ball", (2, 2, 2))
    p = RNG.random((500, 3))
    np.testing.assert_allclose(tile(p), ball(p), atol=1e-6)
    with pytest.raises(ConvergenceError, match="spans"):
        Tile.from_callable(lambda u: np.abs(u[:, 0] - 0.43) - 0.1, tol=1e-6, max_spans=16)
    with pytest.raises(InputError, match="tol"):
        Tile(ball).fit(tol=-1)


@pytest.mark.parametrize(
    ("field", "want"),
    [
        (ball, (False, False, False)),
        (wavy, (True, False, False)),
        (lambda u: np.sin(np.pi * u[:, 0]) - 0.5, (False, True, True)),  # values agree, slopes not
        (lambda u: np.sin(6 * np.pi * u).sum(axis=1), (True, True, True)),
        (lambda u: (u[:, 0] - 0.5) ** 3 + 0.01 * u[:, 1], (False, False, True)),  # slopes agree
    ],
)
def test_periodicity_is_found_out(field, want):
    assert Tile(field).periodic == want


def test_periodicity_of_known_fields():
    assert il.tiles.gyroid().periodic == (True, True, True)
    assert Tile(TrigField.parse("cosX cosY", period=1 / 3)).periodic == (True, True, True)
    assert Tile(TrigField.parse("cosX", period=0.7)).periodic == (False, True, True)


# ----------------------------------------------------------------------------------- verbs


def test_with_level_and_properties():
    tile = il.tiles["f"]
    assert tile.with_level(0.0).singular_at_zero
    moved = tile.with_level(0.3)
    assert not moved.singular_at_zero
    p = RNG.random((20, 3))
    np.testing.assert_allclose(moved(p), tile(p) - 0.3)
    np.testing.assert_allclose(moved.jet(p)[1], tile.jet(p)[1])
    with pytest.raises(GeometryError, match="no zero set"):
        tile.with_level(1.5)
    red = tile.with_properties(red=lambda u: u[:, 0])
    both = red.with_properties(stiffness=ball)
    assert set(both.properties) == {"red", "stiffness"}
    assert not tile.properties
    with pytest.raises(TypeError):
        both.properties["blue"] = ball
    with pytest.raises(InputError, match="red"):
        tile.with_properties(red=0.5)


def test_cells():
    np.testing.assert_array_equal(il.tiles.gyroid().cell, np.eye(3))
    cell = il.tiles["q_star"].cell
    lengths = np.linalg.norm(cell, axis=0)
    np.testing.assert_allclose(lengths, 1.0)
    assert np.degrees(np.arccos(cell[:, 0] @ cell[:, 1])) == pytest.approx(120)


def test_tiles_are_immutable_and_can_be_copied():
    tile = il.tiles.gyroid(level=0.1)
    with pytest.raises(AttributeError):
        tile.level = 2.0
    with pytest.raises(ValueError, match="read-only"):
        tile.bounds[0, 0] = 1.0
    p = RNG.random((9, 3))
    for again in (pickle.loads(pickle.dumps(tile)), copy.deepcopy(tile)):
        np.testing.assert_array_equal(again(p), tile(p))
        assert again.name == tile.name
        with pytest.raises(TypeError):
            again.properties["x"] = 1
    assert repr(tile) == "Tile('gyroid', TrigField, level=0.1)"


# ---------------------------------------------------------------------------------- errors


@pytest.mark.parametrize(
    "field",
    [
        lambda u: 1.0 + u[:, 0],
        lambda u: -np.ones(len(u)),
        lambda u: np.cos(2 * np.pi * u[:, 0]) ** 2,
        TrigField.parse("cosX + 1.5"),
        spline(1.0 + np.arange(210.0).reshape(5, 6, 7)),
    ],
    ids=["positive", "negative", "touching", "trig", "spline"],
)
def test_a_tile_without_zero_set_is_refused(field):
    with pytest.raises(GeometryError, match=r"has no zero set.*run from"):
        Tile(field)


def test_small_features_are_found():
    """A ball that falls between the samples of the first look, not of the second."""
    assert Tile(lambda u: np.sum((u - 0.328) ** 2, axis=1) - 0.02**2).name == "custom"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Tile(3.0), "field must be"),
        (lambda: Tile(il.tiles.gyroid()), "field must be"),
        (lambda: Tile(lambda u: u), "shape"),
        (lambda: Tile(lambda u: 0.0), "shape"),  # noqa: ARG005
        (lambda: Tile(lambda u: np.full(len(u), np.nan)), "finite"),
        (lambda: Tile(spline(RNG.normal(size=(5, 6, 7, 2)))), "scalar spline"),
        (lambda: Tile(BSpline([[0.0, 0.0, 2.0, 2.0]] * 3, np.ones((2, 2, 2)), 1)), "domain"),
        (lambda: Tile(ball, level=[1, 2]), "level"),
        (lambda: Tile(ball, tol=0.0), "tol"),
        (lambda: il.tiles.gyroid()([[0.0, 0.0]]), "shape"),
        (lambda: il.tiles.gyroid().grid([[0.0]]), "axes"),
        (lambda: Tile(ball).grid([[0.0]] * 3, int), "dtype"),
        (lambda: Tile(ball).grid([[0.0]] * 3, np.float16), "dtype"),
    ],
)
def test_bad_input_is_named(make, message):
    with pytest.raises(InputError, match=message):
        make()
