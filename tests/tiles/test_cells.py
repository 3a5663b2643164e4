import inspect

import numpy as np
import pytest
from conformance import check_field

import ilattice as il
from ilattice.errors import GeometryError, InputError
from ilattice.tiles.cells import CELLS, entities

NAMES = [r.name for r in CELLS]
POINTS = np.random.default_rng(8).random((400, 3))


@pytest.mark.parametrize("row", CELLS, ids=lambda r: r.name)
def test_periodic_cells_repeat_exactly(row):
    tile = il.tiles[row.name]
    assert tile.name == row.name
    assert tile.source
    faces = row.faces if isinstance(row.faces, dict) else dict.fromkeys("xyz", row.faces)
    assert tile.periodic == tuple(faces[axis] == "periodic" for axis in "xyz")
    for axis in range(3):
        low, high = POINTS.copy(), POINTS.copy()
        low[:, axis], high[:, axis] = 0.0, 1.0
        jump = np.abs(tile(low) - tile(high)).max()
        assert (jump <= 1e-14) == tile.periodic[axis]


STRUTS = [r.name for r in CELLS if (r.lines or r.nodes) and not r.rings and r.faces == "periodic"]


@pytest.mark.parametrize("name", STRUTS)
def test_struts_are_those_of_all_cells_around(name):
    """The field is the least over whole cells around, without tree or pruning."""
    row = il.tiles.row(name)
    groups = [e for e in entities(row) if isinstance(e, il.tiles.Group)]
    ends = np.array([m.points for g in groups for m in g.members])
    u = POINTS[:100]
    shifts = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    a = (ends[:, 0] + shifts[:, None]).reshape(-1, 3)
    along = np.tile(ends[:, 1] - ends[:, 0], (27, 1))
    t = np.einsum("nsi,si->ns", u[:, None] - a, along) / np.sum(along**2, axis=1)
    foot = a + np.clip(t, 0, 1)[..., None] * along
    slow = np.linalg.norm(u[:, None] - foot, axis=2).min(axis=1) - row.radius
    tile = il.tiles.get(name, blend=0.0)
    np.testing.assert_allclose(tile(u), slow, rtol=0, atol=1e-14)


# Struts per cell and the cells of space around them: counted by hand or in the literature.
@pytest.mark.parametrize(
    ("name", "length"),
    [
        ("cross", 3.0),
        ("sc_struts", 3.0),
        ("bcc_struts", 4 * 3**0.5),
        ("fcc_struts", 6 * 2**0.5),
        ("octet", 24 * 0.5**0.5),
        ("kelvin", 24 * 0.5**1.5),
        ("diamond_struts", 16 * 3**0.5 / 4),
        ("cuboctahedron", 12 * 0.5**0.5),
        ("kagome", 48 * 0.5**1.5),
        ("pyramidal", 4 * 1.5**0.5),
    ],
)
def test_total_length_of_struts(name, length):
    members = [m for group in entities(il.tiles.row(name)) for m in group.members]
    total = sum(np.linalg.norm(np.diff(m.points, axis=0), axis=1).sum() for m in members)
    assert total == pytest.approx(length, rel=1e-12)


@pytest.mark.parametrize("name", ["octet", "kelvin", "kagome", "diamond_struts", "fcc_plates"])
def test_thin_cells_fill_what_their_members_do(name):
    """Volume of thin struts or plates, by samples, against length or area times section."""
    row = il.tiles.row(name)
    r = 0.01
    tile = il.tiles.get(name, radius=r, blend=0.0)
    p = np.random.default_rng(0).random((200_000, 3))
    filled = (tile(p) < 0).mean()
    if row.plates:
        corners = [np.array(p) for p in row.plates]
        members = sum(0.5 * np.linalg.norm(np.cross(b - a, c - a)) for a, b, c in corners)
        expected = 2 * r * members
    else:
        ends = [m.points for g in entities(row) for m in g.members]
        expected = np.pi * r**2 * sum(np.linalg.norm(b - a) for a, b in ends)
    assert filled == pytest.approx(expected, rel=0.12)


def test_hexagons_are_regular():
    row = il.tiles.row("hexagonal_honeycomb")
    walls = [m.corners[:2] for g in entities(row) for m in g.members]
    length = np.array([np.linalg.norm(b - a) for a, b in walls])
    assert length.sum() == pytest.approx(6 / 3**0.5)
    tile = il.tiles.honeycomb(radius=0.05, blend=0.0)
    np.testing.assert_allclose(tile.cell, np.diag([1, 3**0.5, 1]))
    centre = np.array([[0.0, 0.5, 0.3], [0.5, 0.0, 0.9]])
    np.testing.assert_allclose(tile(centre), 0.5 - 0.05, rtol=0, atol=1e-14)


def test_struts_in_one_line_have_no_bulge():
    # Octet and Kagome: two lines in each of six directions; re-entrant: two posts, eight struts.
    for name, lines in (("octet", 12), ("kagome", 12), ("re_entrant", 10)):
        assert len(entities(il.tiles.row(name))) == lines
    for name in ("octet", "cross", "chiral", "re_entrant"):
        sharp, smooth = (il.tiles.get(name, blend=b) for b in (0.0, 0.02))
        gap = sharp(POINTS) - smooth(POINTS)
        assert gap.min() >= -1e-15
        assert gap.max() <= 0.01
    line = np.stack([np.linspace(0, 1, 201), np.full(201, 0.5), np.full(201, 0.45)], axis=1)
    away = np.abs(line[:, 0] - 0.5) > 0.35
    cross = il.tiles.cross(radius=0.1)
    np.testing.assert_allclose(cross(line)[away], -0.05, rtol=0, atol=1e-15)


@pytest.mark.parametrize("name", ["octet", "chiral", "hexagonal_honeycomb", "curve_and_surface"])
def test_cells_conform(name):
    field = il.tiles[name].field
    check_field(field, np.random.default_rng(4), points=60, rtol=1e-4)


def test_radius_thickness_and_blend():
    by_radius, by_thickness = il.tiles.octet(radius=0.06), il.tiles.octet(thickness=0.12)
    np.testing.assert_array_equal(by_radius(POINTS), by_thickness(POINTS))
    thin, thick = (il.tiles.get("cross", radius=r, blend=0.0)(POINTS) for r in (0.05, 0.1))
    np.testing.assert_allclose(thin - thick, 0.05, atol=1e-15)
    closed = il.tiles.cross(faces="closed")
    assert closed([[1.0, 0.5, 0.5]])[0] == 0.0
    with pytest.raises(InputError, match="give one of them"):
        il.tiles.octet(radius=0.1, thickness=0.1)
    with pytest.raises(InputError, match="radius"):
        il.tiles.octet(radius=-1)
    with pytest.raises(GeometryError, match="fills the cell"):
        il.tiles.octet(radius=0.4)
    with pytest.raises(InputError, match="no level"):
        il.tiles.get("octet", level=0.1)
    with pytest.raises(InputError, match="no radius"):
        il.tiles.get("gyroid", radius=0.1)


def test_cells_are_in_the_catalogue():
    assert set(NAMES) <= set(il.tiles)
    assert il.tiles["Octet-Truss"].name == "octet"
    assert "auxetic" in il.tiles
    assert "default 0.05" in il.tiles.octet.__doc__
    assert "radius" in str(inspect.signature(il.tiles.octet))
    assert il.tiles.ten_arms().field.repeats == (True, True, True)
    assert len(entities(il.tiles.row("ten_arms"))) == 10


def test_ten_arms_meet_the_tolerance_of_a_fit():
    tile = il.tiles.ten_arms()
    spline = tile.fit(tol=1e-3)
    assert max(spline.field.shape) <= 64 + 3
    f, s = tile(POINTS), spline(POINTS)
    near = np.abs(f) < 0.01
    assert near.sum() > 10
    assert np.abs(s - f)[near].max() < 1.1e-3
