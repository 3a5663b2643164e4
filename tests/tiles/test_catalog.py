import importlib
import inspect
import subprocess
import sys

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import GeometryError, InputError
from ilattice.tiles import catalog
from ilattice.tiles.cells import CELLS
from ilattice.tiles.tpms import ROWS


def test_subscript_attribute_and_function_give_the_same_tile():
    p = np.random.default_rng(0).random((20, 3))
    f = il.tiles["primitive"](p)
    for tile in (il.tiles.schwarz_p(), il.tiles.primitive(), catalog.get("P"), il.tiles.P()):
        assert isinstance(tile, il.Tile)
        assert tile.name == "primitive"
        np.testing.assert_array_equal(tile(p), f)


@pytest.mark.parametrize("r", [*ROWS, *CELLS], ids=lambda r: r.name)
def test_every_name_and_alias_is_found_in_any_spelling(r):
    for name in (r.name, *r.aliases):
        for spelling in (name, name.upper(), name.lower(), name.replace("_", "-"), f" {name} "):
            assert il.tiles[spelling].name == r.name
    assert r.name.isidentifier()
    assert r.source


def test_no_two_rows_share_a_name():
    rows = (*ROWS, *CELLS)
    keys = [k for r in rows for k in {catalog._key(n) for n in (r.name, *r.aliases)}]
    assert len(keys) == len(set(keys))


@pytest.mark.parametrize(
    ("alias", "name"),
    [
        ("G", "gyroid"),
        ("p-surface", "primitive"),
        ("D-Surface", "diamond"),
        ("I-WP", "iwp"),
        ("Fischer-Koch S", "s"),
        ("C(I2\N{MINUS SIGN}Y**)", "c_i2y"),
        ("±Y", "pm_y"),
        ("G'2", "g_prime2"),
        ("lidinoid_nodal", "lidinoid"),
    ],
)
def test_names_of_the_literature(alias, name):
    assert il.tiles[alias].name == name


@pytest.mark.parametrize(("typo", "near"), [("gyriod", "gyroid"), ("neovus", "neovius")])
def test_an_unknown_name_lists_near_ones(typo, near):
    with pytest.raises(InputError, match=f"{typo}.*near names: {near}"):
        _ = il.tiles[typo]
    with pytest.raises(AttributeError, match=f"{typo}.*{near}"):
        getattr(il.tiles, typo)
    assert typo not in il.tiles


@pytest.mark.parametrize("bad", [3, None, ("gyroid",)])
def test_a_name_must_be_a_string(bad):
    with pytest.raises(InputError, match="must be a string"):
        il.tiles[bad]
    assert bad not in il.tiles


def test_the_module_lists_its_contents():
    assert list(il.tiles) == il.tiles.names() == sorted(r.name for r in (*ROWS, *CELLS))
    assert "gyroid" in il.tiles
    assert {"Tile", "gyroid", "schwarz_p", "names"} <= set(dir(il.tiles))
    assert all(callable(getattr(il.tiles, n)) for n in dir(il.tiles))
    for name in ("__path__", "__wrapped__"):
        assert hasattr(il.tiles, name) == (name == "__path__")


def test_functions_document_themselves():
    make = il.tiles.schwarz_p
    assert make.__name__ == "schwarz_p"
    assert "sum[cosX]" in make.__doc__
    assert str(inspect.signature(make)).startswith("(*, level: float | None = None)")


@pytest.mark.parametrize("name", [r.name for r in ROWS])
def test_levels_shift_and_are_checked_against_the_range(name):
    low, high = il.tiles.row(name).range
    p = np.random.default_rng(0).random((30, 3))
    equation = il.tiles.get(name, level=0.5 * (low + high))
    assert equation.level == pytest.approx(0.5 * (low + high))
    tile = getattr(il.tiles, name)(level=low + 0.25 * (high - low))
    np.testing.assert_allclose(tile(p) - equation(p), 0.25 * (high - low), rtol=1e-9)
    for level in (low, high, high + 1, low - 1):
        with pytest.raises(GeometryError, match="run from"):
            il.tiles.get(name, level=level)
    default = il.tiles[name]
    assert default.level == il.tiles.row(name).level
    assert default.singular_at_zero == (il.tiles.row(name).singular_at_zero and default.level == 0)


@pytest.mark.parametrize("bad", ["high", np.nan, [0.0, 0.1]])
def test_a_level_is_one_number(bad):
    with pytest.raises(InputError, match="level"):
        il.tiles.gyroid(level=bad)


def test_flags_reach_the_tile():
    assert il.tiles["f"].singular_at_zero
    assert il.tiles["f"].disconnected
    assert not il.tiles.f(level=0.2).singular_at_zero
    assert il.tiles["q_star"].hexagonal
    assert il.tiles["q_star"].level != 0
    assert il.tiles["gyroid"].symmetric
    assert not il.tiles["honeycomb_iwp"].symmetric
    assert "Cesogen" in il.tiles["gyroid"].source


def test_importing_expands_no_equation():
    code = (
        "import ilattice.tiles as t, ilattice.tiles.catalog as c;"
        "assert c._field.cache_info().currsize == 0; t['G']; t['gyroid'];"
        "assert c._field.cache_info().currsize == 1"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_module_survives_a_reload():
    assert importlib.import_module("ilattice.tiles") is il.tiles
    assert type(il.tiles).__name__ == "_Catalog"
