"""Columns of numbers: orders, delimiters, what is missing."""

import contextlib

import numpy as np
import pytest

from ilattice.errors import FormatError, InputError
from ilattice.io import read_columns


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_columns_come_in_the_order_asked_for(tmp_path, delimiter):
    rng = np.random.default_rng(0)
    table = rng.standard_normal((50, 4)) * 10.0 ** rng.integers(-9, 9, (50, 4))
    rows = [delimiter.join(map(repr, row)) for row in table.tolist()]
    text = "# made by hand\n\n" + delimiter.join(["Z", '"x"', "d", " y"])
    path = tmp_path / "points.csv"
    path.write_text("\ufeff" + text + "\r\n" + "\r\n".join(rows), "utf-8")
    np.testing.assert_array_equal(read_columns(path, ("x", "y", "z", "D")), table[:, [1, 3, 0, 2]])
    np.testing.assert_array_equal(read_columns(path), table[:, [1, 3, 0]])


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("x,y,z\n1,2,3\n1,nan,3\n", "line 3: y is nan"),
        ("x,y,z\n1,2,3\n\n# a note\n1,2\n", "line 5: z is missing"),
        ("x,y,z\n1,2,inf\n", "line 2: z is inf"),
        ("x,y,z\n" + "1,two,3\n" * 9, "line 4: y is two and 6 more"),
        ("x,y\n1,2\n", "no column 'z': its columns are x, y"),
        ("x,y,z,X\n1,2,3,4\n", "2 columns 'x'"),
        ("x,y,z\n", "no line of names and lines"),
        ("", "no line of names"),
        ('x,y,z\n"1,2,3\n', "y is missing"),
    ],
)
def test_what_is_missing_is_named_by_its_line(tmp_path, text, told):
    path = tmp_path / "bad.csv"
    path.write_text(text, "utf-8")
    with pytest.raises(FormatError, match=told):
        read_columns(path)


def test_odd_files_and_names(tmp_path):
    with pytest.raises(FormatError):
        read_columns(tmp_path / "none.csv")
    (tmp_path / "b.csv").write_bytes(b"x,y\n\xff\xfe,2\n")
    with pytest.raises(FormatError, match="UTF-8"):
        read_columns(tmp_path / "b.csv")
    (tmp_path / "c.csv").write_bytes(b"x,y\n" + b"1" * 200_000 + b",2\n")
    with pytest.raises(FormatError):
        read_columns(tmp_path / "c.csv", ("x",))
    (tmp_path / "d.csv").write_bytes(b"x,y\n1,2\n")
    for bad in ((), "xy", 3):
        with pytest.raises(InputError, match="names"):
            read_columns(tmp_path / "d.csv", bad)
    for seed in range(200):
        rng = np.random.default_rng(seed)
        data = bytearray(b"x,y,z\n0.5,1,2\n3,4e-3,5\n")
        for at in rng.integers(0, len(data), 3):
            data[at] = rng.integers(256)
        (tmp_path / "e.csv").write_bytes(bytes(data))
        with contextlib.suppress(FormatError):
            assert np.isfinite(read_columns(tmp_path / "e.csv")).all()


@pytest.mark.parametrize("row", ["1,5,2,0,0,6", "1,2,3,4,5", "1,2,3,4,,x"])
def test_rows_with_more_fields_than_names_are_refused(row, tmp_path):
    """Decimal commas between commas: nothing may be read one column off."""
    path = tmp_path / "a.csv"
    path.write_text(f"x,y,z,d\n0,0,0,1\n{row}\n", encoding="utf-8")
    with pytest.raises(FormatError, match=r"line 3: [56] fields for 4 names"):
        read_columns(path, ("x", "y", "z", "d"))


def test_empty_fields_at_the_end_and_odd_numbers(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("x,d\n0,1,\n2,3\n", encoding="utf-8")
    assert read_columns(path, ("x", "d")).tolist() == [[0, 1], [2, 3]]
    path.write_text("x,d\n0,4_0\n", encoding="utf-8")
    with pytest.raises(FormatError, match="line 2: d is 4_0"):
        read_columns(path, ("x", "d"))
