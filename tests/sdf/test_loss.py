"""Meshes of fields that have lost, or gained, a part of the volume: told or refused."""

import re
import warnings

import numpy as np
import pytest

import ilattice as il
from ilattice import cli
from ilattice.errors import GeometryError, InputError, PrecisionWarning
from ilattice.mesh.measure import triangle_quality
from ilattice.mesh.sampled import volumes
from ilattice.sdf import _parting as parting
from ilattice.sdf.meshing import mesh, plan

F = il.fields


def shells(rng, n=3):
    """Spherical shells far enough apart, as a field, and their volume."""
    parts, volume = [], 0.0
    for k in range(n):
        radius, t = rng.uniform(0.5, 0.9), rng.uniform(0.02, 0.06)
        centre = (2.3 * k + rng.uniform(-0.1, 0.1), *rng.uniform(-0.5, 0.5, 2))
        parts.append(F.translate(F.shell(F.sphere(radius), t), centre))
        volume += 4 / 3 * np.pi * ((radius + t / 2) ** 3 - (radius - t / 2) ** 3)
    return F.union(*parts), volume


def strangers(field):
    """The same as a callable that tells nothing of itself."""
    return F.from_callable(lambda p: field(p), bounds=field.bounds)


def test_volumes_at_random_points_are_within_their_errors():
    rng = np.random.default_rng(0)
    z = []
    for k in range(20):
        field, exact = shells(rng, 1)
        field = strangers(field) if k % 2 else field
        found = list(volumes(field, field.bounds, np.ptp(field.bounds, axis=0), None, 0.005))
        assert (np.diff([v.error for v in found]) < 0.0).all()
        assert found[-1].error < 0.02 * exact
        z += [(v.volume - exact) / v.error for v in found]
    assert np.abs(z).max() < 4.0
    assert np.sqrt(np.mean(np.square(z))) < 1.2


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("known", [True, False])
def test_shells_as_thin_as_the_spacing_are_refused(seed, known):
    """Most of them used to be lost without a word."""
    rng = np.random.default_rng(seed)
    field, exact = shells(rng)
    field = field if known else strangers(field)
    h = rng.uniform(0.08, 0.15)
    with pytest.raises(GeometryError, match=r"% less than the solid .* try a spacing of"):
        mesh(field, h)
    with pytest.warns(PrecisionWarning, match=r"% less than the solid"):
        found = mesh(field, h, allow_loss=True)
    assert found.volume < 0.95 * exact


@pytest.mark.parametrize("seed", range(6))
def test_volumes_that_are_told_are_within_the_errors_told(seed):
    field, exact = shells(np.random.default_rng(seed))
    with pytest.raises(GeometryError, match="less than the solid") as refused:
        mesh(field, 0.15)
    told = re.search(r"\((\S+) \+- (\S+) at random points", str(refused.value))
    volume, error = map(float, told.groups())
    assert 0.0 < error <= 0.03 * exact  # of one digit
    assert abs(volume - exact) <= 1.5 * error


@pytest.mark.parametrize("seed", range(4))
def test_slits_thinner_than_the_spacing_are_refused(seed):
    rng = np.random.default_rng(seed)
    walls = F.shell(F.translate(F.sphere(5.0), (5.0, *rng.uniform(-0.5, 0.5, 2))), 0.05)
    slit = [F.translate(walls, (x + rng.uniform(0, 0.1), 0.0, 0.0)) for x in (-0.4, 0.0, 0.4)]
    solid = F.difference(F.box(0.5), F.union(*slit))
    with pytest.raises(GeometryError, match=r"% more than the solid"):
        mesh(solid, rng.uniform(0.15, 0.2))


@pytest.mark.parametrize("shape", ["torus", "mirrored", "perturbed"])
def test_walls_through_maps_are_compared(shape):
    box = il.macroshape.box((2.0, 1.3, 0.9))
    through = il.macroshape.torus() if shape == "torus" else box
    if shape != "torus":
        s = box.spline
        c = s.c * (np.array([-1.0, 1.0, 1.0]) if shape == "mirrored" else 1.0)
        c = c + 0.02 * np.random.default_rng(1).standard_normal(c.shape)
        through = il.macroshape.SplineMap(il.BSpline(s.t, c, s.k))
    lattice = il.Lattice("gyroid", through=through, repeat=(5, 2, 1))
    wall = lattice.offset(0.016)
    with pytest.raises(GeometryError, match=r"% less than the solid"):
        il.sdf.mesh(wall.field, 0.04, through=through)
    thick = lattice.offset(0.06)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = il.sdf.mesh(thick.field, 0.025, through=through)
    assert found.volume == pytest.approx(thick.volume(), rel=0.02)


def test_tolerances_plans_and_commands_compare_too(tmp_path, capsys):
    field = F.shell(F.sphere(1.0), 0.05)
    with pytest.raises(GeometryError, match="less than the solid"):
        plan(field, 0.2).mesh()
    words = ["sdf", "sphere", "shell", "0.05", "-s", "0.2", "-o", str(tmp_path / "a.ply")]
    assert cli.main(words) == 1
    assert "less than the solid" in capsys.readouterr().err
    assert cli.main([*words, "--allow-loss"]) == 0
    assert "less than the solid" in capsys.readouterr().err
    assert (tmp_path / "a.ply").exists()


@pytest.mark.parametrize("scale", [1e300, 1e60, 1e-60])
def test_solids_whose_volume_overflows_are_refused(scale):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(InputError, match="use other units of length"):
            mesh(F.scale(F.box(1.0), scale))


# --- triangles that cross -------------------------------------------------------------------------


def trimmed_wing():
    """A wall with a bore, thinner than the spacing next to the trailing edge."""
    wing, f = il.macroshape.wing(), il.fields
    size, middle = np.ptp(wing.bounds, axis=0).min(), wing.x([wing.domain.mean(axis=0)])[0]
    wall = il.Lattice("schwarz_p", through=wing, repeat=(4, 1, 1), spans_per_tile=10)
    bore = f.translate(f.rotate(f.cylinder(0.11 * size), 0.8, (1, 2, 0.3)), middle)
    part = f.difference(wall.offset(0.06 * size).field, f.pull_back(bore, wing))
    return part, 0.05 * size, wing


def test_triangles_that_cross_in_thin_maps_are_parted():
    part, h, wing = trimmed_wing()
    with warnings.catch_warnings():
        warnings.simplefilter("error", PrecisionWarning)
        mesh = il.sdf.mesh(part, h, through=wing)
    assert mesh.self_intersections == 0  # 57 if not parted
    assert mesh.is_watertight


def test_triangles_that_are_not_parted_are_told_of(monkeypatch):
    monkeypatch.setattr(parting, "BACK", ())
    part, h, wing = trimmed_wing()
    with pytest.warns(PrecisionWarning, match="pairs of triangles cross") as told:
        mesh = il.sdf.mesh(part, h, through=wing)
    assert int(str(told[0].message).split()[0]) == mesh.self_intersections > 0


NESTED = (
    "box scale 4,4,4 sphere scale 5,5,5 p-surface scale 4,4,4 d-surface scale 3.75,3.75,3.75 "
    "gyroid scale 1.25,1.25,1.25"
)


def test_vertices_of_slivers_that_cannot_be_removed_go_back():
    mesh = il.sdf.mesh(il.sdf.parse(NESTED), 0.08)
    assert triangle_quality(mesh.vertices, mesh.faces).min() > 1e-3  # six without area otherwise
    assert mesh.self_intersections == 0


def test_slivers_are_left_where_others_would_cross(monkeypatch):
    field = il.sdf.parse(NESTED)
    asked = []
    real = parting.remove_slivers

    def told(*args, spared=None, **keywords):
        asked.append(0 if spared is None else spared.sum())
        return real(*args, spared=spared, **keywords)

    monkeypatch.setattr(parting, "remove_slivers", told)
    assert il.sdf.mesh(field, 0.09).self_intersections == 0
    assert asked[0] == 0 < asked[-1] < 100  # 9 pairs if all slivers were removed


def test_vertices_go_back_the_shorter_way_around():
    rng = np.random.default_rng(0)
    axes = [np.linspace(-0.5, 2.0, 7), np.linspace(3.0, 3.5, 4), np.linspace(0.0, 1.0, 5)]
    lo, hi = np.array([(a[0], a[-1]) for a in axes]).T
    a, b = lo + (hi - lo) * rng.random((2, 50, 3))
    half = parting._between(a, b, 0.5, axes, np.array([True, False, True]))
    turn = 2.0 * np.pi * (np.stack([a, b, half]) - lo) / (hi - lo)
    first, last, middle = np.exp(1j * turn)
    around = first + last  # the mean of two places of a circle points to the middle of the way
    np.testing.assert_allclose(middle[:, ::2], (around / np.abs(around))[:, ::2], atol=1e-9)
    np.testing.assert_allclose(half[:, 1], 0.5 * (a + b)[:, 1])
