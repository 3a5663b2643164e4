"""Loose parts in reports, and walls that fill the part."""

import json
import warnings

import numpy as np
import pytest

import ilattice as il
from ilattice import cli
from ilattice.errors import PrecisionWarning
from ilattice.mesh.regions import islands_of


def balls(*sizes):
    """Balls of some radii, apart."""
    solid = [
        il.fields.translate(il.fields.sphere(r), (2.3 * i, 0.1 * i, 0)) for i, r in enumerate(sizes)
    ]
    return il.fields.union(*solid)


def test_islands_are_counted_with_their_volume_and_small_ones_told():
    mesh = il.sdf.mesh(balls(1.0, 0.9, 0.2), 0.05)
    with pytest.warns(PrecisionWarning, match=r"1 loose chip .*0\.4[4-7] % of the volume"):
        found = islands_of(mesh)
    assert found["islands"] == 2
    assert found["islands_volume"] == pytest.approx(4 / 3 * np.pi * (0.9**3 + 0.2**3), rel=0.01)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # two balls of about the same size are meant
        assert islands_of(il.sdf.mesh(balls(1.0, 0.9), 0.1))["islands"] == 1
        hollow = il.sdf.mesh(il.fields.shell(il.fields.sphere(1.0), 0.2), 0.1)
        assert islands_of(hollow) == {"islands": 0, "islands_volume": 0.0}


def test_the_command_sdf_counts_and_removes_islands(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = ["sphere", "sphere", "scale", "0.2", "translate", "1.7,0,0", "union", "-s", "0.06"]
    assert cli.main(["sdf", *words, "-o", "a.ply", "--report", "a.json"]) == 0
    report = json.loads((tmp_path / "a.json").read_text())
    assert report["islands"] == 1
    assert "loose chip" in capsys.readouterr().err
    assert cli.main(["sdf", *words, "-o", "b.ply", "--remove-islands", "--report", "b.json"]) == 0
    assert json.loads((tmp_path / "b.json").read_text())["islands"] == 0
    assert il.mesh.load("b.ply").components == 1
    assert "loose" not in capsys.readouterr().err


def test_the_command_build_counts_and_removes_islands(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = ["build", "--tile", "gyroid", "--through", "box", "--repeat", "1", "1", "1",
             "--thickness", "0.06", "-o", "a.stl", "--h", "0.05", "--report", "a.json"]  # fmt: skip
    reports = []
    for extra in ([], ["--remove-islands"]):
        assert cli.main([*words, *extra]) == 0
        reports.append(json.loads((tmp_path / "a.json").read_text()))
        assert il.mesh.load("a.stl").components == reports[-1]["components"]
        assert "islands  " in capsys.readouterr().out
    whole, kept = reports
    assert whole["islands"] == whole["components"] - 1 > 0
    assert (kept["islands"], kept["components"]) == (0, 1)
    assert kept["volume"] == pytest.approx(whole["volume"] - whole["islands_volume"], rel=1e-9)


def test_a_wall_that_fills_the_part_is_told():
    lattice = il.Lattice("gyroid", through=il.macroshape.box((7, 5, 9)), repeat=(3, 2, 3))
    wall = lattice.offset(lambda u: 2.0 + 0.3 * u[:, 0])
    with pytest.warns(PrecisionWarning, match="the wall fills the part"):
        mesh = wall.mesh(h=0.5)
    assert mesh.volume == pytest.approx(7 * 5 * 9)
    assert wall.thickness_error(mesh).count == 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        lattice.offset(0.4).mesh(h=0.12)


def test_point_data_has_half_and_full_thickness():
    lattice = il.Lattice("schwarz_p", through=il.macroshape.box((2, 1, 1)), repeat=(2, 1, 1))
    mesh = lattice.offset((0.04, lambda u: 0.05 + 0.03 * u[:, 0])).mesh(h=0.05)
    data, u = mesh.point_data, mesh.point_data["u"]
    outer = 0.05 + 0.03 * u
    np.testing.assert_allclose(data["thickness"], outer + 0.04, rtol=1e-5)
    half = np.where(data["side"] < 0, 0.04, outer)
    np.testing.assert_allclose(data["half_thickness"], half, rtol=1e-5)
    symmetric = lattice.offset("0.06+0.01*v").mesh(h=0.05).point_data
    np.testing.assert_allclose(symmetric["thickness"], 2 * symmetric["half_thickness"], rtol=1e-12)
    np.testing.assert_allclose(symmetric["half_thickness"], 0.06 + 0.01 * symmetric["v"], rtol=1e-6)
    assert "thickness" not in lattice.offset((np.inf, 0.05)).mesh(h=0.1).point_data
