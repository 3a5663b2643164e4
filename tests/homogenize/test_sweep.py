"""Sweeps: tables that go on to the same bytes, executors, fits, what is refused."""

import csv
import pickle
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from multiprocessing import get_context
from types import ModuleType

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import FormatError, InputError, PrecisionWarning
from ilattice.homogenize import elastic, sweep
from ilattice.homogenize.rows import RESULTS, Rows

pytestmark = pytest.mark.filterwarnings("ignore:the cells are too coarse")
RADII = [0.3, 0.2]
MODULE = sys.modules["ilattice.homogenize.sweep"]


def ball(radius):
    """A void in a cube; a solid without one would be refused."""
    if radius > 0.7:
        raise InputError(f"radius {radius} leaves nothing")
    return il.fields.complement(il.fields.translate(il.fields.sphere(radius), (0.5, 0.5, 0.5)))


def dent(radius):
    flat = il.fields.equation(f"((x - 0.5)/{radius})^2 + (y - 0.5)^2 + (z - 0.5)^2 - 0.15")
    return il.fields.complement(flat)


def thing():
    return il.fields.sphere(0.2)


def test_rows_are_those_of_single_cells(tmp_path):
    table = tmp_path / "t.csv"
    with pytest.warns(PrecisionWarning, match=r"1 of 3 rows .* radius=0.9: radius 0.9 leaves no"):
        rows = sweep(ball, radius=[0.3, 0.9, 0.2], cells=4, table=table)
    eff = elastic(ball(0.3), 4)
    assert rows["K"][0] == eff.K
    assert rows["E_x"][0] == eff.E((1, 0, 0))
    assert rows["E"][0] == pytest.approx(eff.nearest("isotropic")[3, 3] * 2 * (1 + rows["nu"][0]))
    assert rows["bulk"][0] == eff.margins["bulk"]
    assert rows[0]["radius"] == 0.3
    assert [r["message"] for r in rows] == ["", "radius 0.9 leaves nothing", ""]
    assert len(rows.failed) == 1
    assert np.isnan(rows["E"][1])
    with open(table) as file:
        written = list(csv.DictReader(file))
    assert [r["cell"] for r in written] == [f"{__name__}.ball"] * 3
    assert float(written[0]["K"]) == eff.K
    bulk, shear = eff.bounds.bulk[1], eff.bounds.shear[1]
    assert rows["E_most"][0] == pytest.approx(9 * bulk * shear / (3 * bulk + shear))
    assert rows["percolates"] == ["uvw", "", "uvw"]
    again = pickle.loads(pickle.dumps(rows))
    assert repr(again[2]) == repr(rows[2])


def test_a_sweep_that_was_stopped_ends_with_the_same_bytes(tmp_path):
    first, second = tmp_path / "a.csv", tmp_path / "b.csv"
    options = {"radius": RADII, "cells": 3}
    whole = sweep([ball, dent], table=first, **options)

    def stop(_label, done, _total):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sweep([ball, dent], table=second, progress=stop, **options)
    assert second.read_bytes() == b"".join(first.read_bytes().splitlines(True)[:3])
    with open(second, "ab") as file:
        file.write(b"ball,0.9,0.1")  # killed while it wrote
    with ThreadPoolExecutor(2) as threads:
        rows = sweep([ball, dent], table=second, executor=threads, **options)
    assert second.read_bytes() == first.read_bytes()
    assert [repr(dict(r)) for r in rows] == [repr(dict(r)) for r in whole]


def test_what_is_known_is_not_computed_again(tmp_path, monkeypatch):
    table = tmp_path / "t.csv"
    sweep(ball, radius=[0.3], cells=4, table=table)
    before = table.read_bytes()
    monkeypatch.setattr(MODULE, "elastic", lambda *_, **__: pytest.fail("again"))
    assert len(sweep(ball, radius=[0.3], cells=4, table=table)) == 1
    assert table.read_bytes() == before
    with pytest.raises(pytest.fail.Exception, match="again"):
        sweep(ball, radius=[0.3], cells=5, table=table)
    with pytest.raises(FormatError, match="not one of this sweep"):
        sweep(ball, side=[0.3], cells=4, table=table)
    assert table.read_bytes() == before


@pytest.mark.slow
def test_processes_make_the_same_table(tmp_path):
    first, second = tmp_path / "a.csv", tmp_path / "b.csv"
    options = {"relative_density": [0.8, 0.9], "cells": 4}
    sweep("gyroid", table=first, **options)
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as processes:
        sweep("gyroid", table=second, executor=processes, **options)
    assert second.read_bytes() == first.read_bytes()


def made(density, E, name="a"):
    empty = dict.fromkeys(RESULTS, "")
    rows = (
        {"cell": name, **empty, "density": d, "E": e, "message": ""}
        for d, e in zip(density, E, strict=True)
    )
    return Rows(tuple(rows))


def test_fits_are_least_squares_of_logarithms():
    density = np.array([0.1, 0.2, 0.3, 0.4])
    exact = made(density, 0.7 * density**2).fit("E")
    assert exact.coefficient == pytest.approx(0.7)
    assert exact.exponent == pytest.approx(2.0)
    assert exact.exponent_interval == pytest.approx((2.0, 2.0))
    assert exact.deviation < 1e-12
    rng = np.random.default_rng(1)
    inside = 0
    for _ in range(300):
        fit = made(density, 0.7 * density**2 * np.exp(0.1 * rng.standard_normal(4))).fit()
        inside += fit.exponent_interval[0] < 2.0 < fit.exponent_interval[1]
    assert inside / 300 == pytest.approx(0.95, abs=0.04)
    two = made(density[:2], density[:2]).fit()
    assert two.exponent == pytest.approx(1.0)
    assert two.exponent_interval == (-np.inf, np.inf)
    with pytest.raises(InputError, match="two densities"):
        made(density[:1], density[:1]).fit()
    with pytest.raises(InputError, match="no row has 'b'"):
        made(density, density).fit(cell="b")
    with pytest.raises(InputError, match="quantity must be one of"):
        made(density, density).fit("e")
    assert len(made(density, density).plot().axes[0].lines) == 2


def test_rows_of_tiles_are_found_by_all_their_names():
    density = np.array([0.1, 0.2, 0.4])
    rows = made(density, 0.3 * density**1.7, il.tiles.get("P").name)
    for name in ("P", "schwarz_p"):
        assert rows.fit(cell=name).exponent == pytest.approx(1.7)


def test_columns_go_to_files(tmp_path):
    with pytest.warns(PrecisionWarning, match="1 of 2 rows have no results"):
        rows = sweep(ball, radius=[0.3, 0.9], cells=4, options={"estimate": False})
    rows.save(tmp_path / "t.csv")
    with open(tmp_path / "t.csv", newline="") as file:
        written = list(csv.DictReader(file))
    assert [float(r["radius"]) for r in written] == [0.3, 0.9]
    assert float(written[0]["E"]) == rows["E"][0]
    assert written[1]["E"] == ""
    assert written[1]["message"] == rows[1]["message"] != ""
    for name in ("t.txt", "t"):
        with pytest.raises(FormatError, match=r"must end in \.csv or \.parquet"):
            rows.save(tmp_path / name)
    parquet = pytest.importorskip("pyarrow.parquet", reason="pip install pyarrow")
    rows.save(tmp_path / "t.parquet")
    table = parquet.read_table(tmp_path / "t.parquet").to_pydict()
    assert table["E"] == [rows["E"][0], None]
    assert table["radius"] == [0.3, 0.9]
    assert table["percolates"] == ["uvw", ""]


def test_without_pyarrow_there_is_a_remedy(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    rows = made(np.array([0.1, 0.2]), np.array([0.1, 0.2]))
    with pytest.raises(FormatError, match=r"pip install pyarrow; or save a \.csv"):
        rows.save(tmp_path / "t.parquet")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("cells", "options", "told"),
    [
        (lambda: 0, {}, "has no name that a row could have; give a function"),
        (partial(lambda a: a, 1), {}, "has no name"),
        ([], {}, "cells: none"),
        (["gyroid", "gyroid"], {}, "'gyroid' is there twice"),
        ("gyroit", {}, "gyroit"),
        (3, {}, "cells"),
        ("gyroid", {"E": [1.0]}, "'E' is a column of the table"),
        ("gyroid", {"relative_density": []}, "relative_density has no values"),
        ("gyroid", {"relative_density": [0.3, 0.3]}, "has a value twice"),
        ("gyroid", {"relative_density": [np.nan]}, "must be numbers or texts"),
        ("gyroid", {"options": {"phases": thing}}, "phases must be numbers or texts in a sweep"),
        ("gyroid", {"executor": 3}, "interface of concurrent.futures"),
        ("gyroid", {"options": 3}, "options must be a dict .*, got 3"),
    ],
)
def test_wrong_arguments(cells, options, told):
    with pytest.raises(InputError, match=told):
        sweep(cells, **options)


def test_processes_that_fork_and_cells_that_cannot_travel_are_refused():
    with (
        ProcessPoolExecutor(1, mp_context=get_context("fork")) as processes,
        pytest.raises(InputError, match="processes that fork hang"),
    ):
        sweep(thing, executor=processes)
    tile = il.Tile(lambda u: u[:, 0] - 0.5, name="own")
    with (
        ProcessPoolExecutor(1, mp_context=get_context("spawn")) as processes,
        pytest.raises(InputError, match="'own' cannot be sent to another process"),
    ):
        sweep(tile, executor=processes)


def blocks(fill):
    return np.random.default_rng(1).random((4, 4, 4)) < fill


def broken(fill):
    return fill / 0.0


def test_what_functions_raise_is_told_in_their_rows():
    with pytest.warns(PrecisionWarning, match="2 of 2 rows have no results"):
        rows = sweep([broken, ball], fill=0.5)
    assert (
        rows[0]["message"] == f"{__name__}.broken raised ZeroDivisionError: float division by zero"
    )
    assert "ball raised TypeError" in rows[1]["message"]
    assert "'fill'" in rows[1]["message"]
    with pytest.warns(PrecisionWarning, match="voxels has no option 'degree'"):
        sweep(blocks, fill=0.5, options={"degree": 1})


@pytest.mark.filterwarnings("ignore::ilattice.errors.PrecisionWarning")
@pytest.mark.parametrize(
    ("column", "value"),
    [("E", "abc"), ("E", "True"), ("E", "nan"), ("K", "1e400"), ("E_x", "-5"), ("G", ""),
     ("nu", ""), ("bulk", "nan"), ("percolates", "uvx")],
)  # fmt: skip
def test_results_of_tables_that_are_none_are_refused(tmp_path, column, value):
    table, options = tmp_path / "t.csv", {"estimate": False}
    rows = sweep(blocks, fill=[0.5, 0.6], options=options, table=table)
    again = sweep(blocks, fill=[0.5, 0.6], options=options, table=table)  # errors are NaN in it
    np.testing.assert_array_equal(again["E"], rows["E"])
    with open(table, newline="") as file:
        lines = list(csv.DictReader(file))
    lines[1][column] = value
    with open(table, "w", newline="") as file:
        out = csv.DictWriter(file, list(lines[0]), lineterminator="\n")
        out.writeheader()
        out.writerows(lines)
    before = table.read_bytes()
    with pytest.raises(FormatError, match=rf"row of .*fill=0.6: {column} is '{value}'"):
        sweep(blocks, fill=[0.5, 0.6], options=options, table=table)
    assert table.read_bytes() == before


def test_processes_that_cannot_import_a_cell_are_told_of(monkeypatch):
    here = ModuleType("module_of_this_process")
    exec("def cell():\n    return 3\n", vars(here))
    monkeypatch.setitem(sys.modules, here.__name__, here)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as processes:
        for _ in range(2):
            with pytest.raises(
                InputError, match=r"executor.*could not import|executor takes no more"
            ):
                sweep(here.cell, executor=processes)
