"""Meshes of tiles whose neighbours do not fit: bars end at the faces between them."""

import warnings

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import GeometryError, PrecisionWarning
from ilattice.mesh import wall_mesh

SOLID = (np.inf, 0.0)


def three_bars(faces="open"):
    points = [(0, 0.3, 0.4), (1, 0.7, 0.6), (0.5, 0, 0.2), (0.4, 1, 1)]
    return il.tiles.struts(points, [(0, 1), (2, 3), (1, 2)], 0.084, faces=faces)


def cylinder(p, a, b, radius, lo, hi):
    """How far points are outside of a bar that is cut where its tile ends, along z."""
    way = (b - a) / np.linalg.norm(b - a)
    beside = p - a - np.outer((p - a) @ way, way)
    return np.max([np.linalg.norm(beside, axis=1) - radius, lo - p[:, 2], p[:, 2] - hi], axis=0)


@pytest.mark.parametrize("h", [0.03, 0.02, 0.011])
def test_ends_between_tiles_are_flat(h):
    """They had spikes of 2.3 edges at any length."""
    tile = il.tiles.skeleton([[(0.3, 0.4, 0), (0.6, 0.5, 1)]], radius=0.1)
    wall = il.Lattice(tile, through=il.macroshape.box((1, 1, 2)), repeat=(1, 1, 2)).offset(SOLID)
    mesh = wall.mesh(h=h)
    a, b, up = np.array([0.3, 0.4, 0]), np.array([0.6, 0.5, 1]), np.array([0, 0, 1.0])
    parts = [cylinder(mesh.vertices, a + k * up, b + k * up, 0.1, k, k + 1) for k in (0, 1)]
    assert np.abs(np.minimum(*parts)).max() < 1e-9
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(wall.volume(), rel=0.015)
    assert (np.abs(mesh.vertices[:, 2] - 1.0) < 1e-9).sum() > 10  # of the ends
    told, side = mesh.point_data["signed_distance"], mesh.point_data["side"]
    assert np.abs(told[side != 0]).max() < 1e-9


def test_distances_on_caps_are_lengths_in_space():
    tile = il.tiles.skeleton([[(0.3, 0.4, 0), (0.6, 0.5, 1)]], radius=0.1)
    for size in (1e-4, 1.0, 300.0):
        box = il.macroshape.box((size, size, 2 * size))
        wall = il.Lattice(tile, through=box, repeat=(1, 1, 2)).offset(SOLID)
        mesh = wall.mesh(h=0.03 * size)
        told, side = mesh.point_data["signed_distance"], mesh.point_data["side"]
        assert told[side == 0].min() == pytest.approx(-0.1 * size, rel=0.2)


@pytest.mark.parametrize("faces", ["open", "closed"])
@pytest.mark.parametrize(
    ("through", "repeat"),
    [("torus", (6, 1, 1)), ("torus", (12, 1, 1)), ("cylinder_shell", (6, 1, 1))],
)
def test_bars_that_end_in_rings(through, repeat, faces):
    """Where a ring begins, the mesh was open, and had edges of up to 28 triangles."""
    shape = getattr(il.macroshape, through)()
    wall = il.Lattice(three_bars(faces), through=shape, repeat=repeat).offset(SOLID)
    mesh = wall.mesh()
    assert mesh.is_watertight
    assert mesh.is_oriented
    assert mesh.self_intersections == 0
    u = np.random.default_rng(0).random((200_000, 3)) * np.ptp(shape.domain, axis=0)
    u += shape.domain[0]
    weight = np.abs(np.linalg.det(shape.jacobian(u))) * np.ptp(shape.domain, axis=0).prod()
    inside = weight * (wall.distance(u) < 0.0)
    error = inside.std() / np.sqrt(len(u))
    assert abs(mesh.volume - inside.mean()) < 4.0 * error + 0.015 * mesh.volume


@pytest.mark.parametrize("closed", [False, True])
def test_bounds_hold_on_faces_between_tiles(closed):
    through = il.macroshape.torus() if closed else il.macroshape.box((3, 2, 2))
    field = il.Lattice(three_bars(), through=through, repeat=(3, 2, 2)).offset(SOLID).distance
    rng = np.random.default_rng(1)
    lo, hi = field.domain
    planes = np.stack([rng.integers(1, n, 300, endpoint=True) / n for n in (3, 2, 2)], axis=1)
    on = rng.random((300, 3)) < 0.5
    top = lo + (hi - lo) * np.where(on, planes, rng.random((300, 3)))
    low = np.maximum(top - (hi - lo) * rng.uniform(0.0, 0.2, (300, 3)), lo)
    bounds = field.range(low, top)
    corners = np.stack([low, top])
    for pick in np.ndindex(2, 2, 2):
        values = field(np.stack([corners[s, :, a] for a, s in enumerate(pick)], axis=1))
        assert (values >= bounds[:, 0] - 1e-12).all()
        assert (values <= bounds[:, 1] + 1e-12).all()


def test_other_tiles_that_do_not_fit_are_told():
    tile = il.Tile(lambda u: np.hypot(u[:, 0] - 0.3 - 0.3 * u[:, 2], u[:, 1] - 0.5) - 0.15)
    lattice = il.Lattice(tile, through=il.macroshape.box((1, 1, 2)), repeat=(1, 1, 2))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        lattice.offset(SOLID).mesh(h=0.05)
    assert any("do not meet along w" in str(w.message) for w in told)


def test_meshes_that_are_not_closed_are_refused(monkeypatch):
    made = wall_mesh.without_specks

    def holed(x, repair, volumes):
        found = made(x, repair, volumes)
        return found._replace(faces=found.faces[1:])

    monkeypatch.setattr(wall_mesh, "without_specks", holed)
    wall = il.Lattice("gyroid", through=il.macroshape.box((1, 1, 1))).offset(0.1)
    with pytest.raises(GeometryError, match="not closed: 3 edges have one triangle"):
        wall.mesh(h=0.08)
    with pytest.warns(PrecisionWarning, match="not closed"):
        wall.mesh(h=0.08, allow_loss=True)
