"""Channels out of voids: topology, volume by counting points, the exact wall around them."""

from functools import cache

import numpy as np
import pytest

import ilattice as il
from ilattice.errors import GeometryError, InputError
from ilattice.mesh import vent, venting
from ilattice.mesh.regions import topology_of
from ilattice.mesh.venting import channel_field, channels


@cache
def wall_of(repeat=(1, 1, 1), d=0.3):
    """Schwarz P: from d = 0.236 of a tile on, its pores are closed."""
    box = il.macroshape.box(tuple(map(float, repeat)))
    return il.Lattice("schwarz_p", through=box, repeat=repeat).offset(d)


def test_a_void_is_opened_by_a_round_channel_and_the_wall_stays_exact():
    wall = wall_of()
    closed, mesh = wall.mesh(0.06), vent(wall, 0.2, h=0.06)
    assert topology_of(closed).betti == (1, 0, 1)
    assert topology_of(mesh).betti == (1, 0, 0)
    assert mesh.is_watertight
    assert mesh.self_intersections == 0
    assert wall.thickness_error(mesh).relative_max < 1e-6
    assert np.percentile(mesh.quality, 1) >= 0.3

    (a, b), x = channels(closed, 0.1)[0], mesh.vertices
    axis = (b - a) / np.linalg.norm(b - a)
    away = np.linalg.norm(np.cross(x - a, axis), axis=1)
    faces = (np.minimum(x, 1.0 - x) < 1e-9).any(axis=1)
    inner = (mesh.point_data["side"] == 0) & ~faces
    assert inner.sum() > 20
    off = np.abs(away[inner] - 0.1)  # next to the edge at the wall vertices may cut the corner
    assert np.quantile(off, 0.9) < 1e-9
    assert off.max() < 0.25 * 0.06

    p = np.random.default_rng(1).random((400_000, 3))
    left = (wall.field(p) < 0) & ~(
        channel_field(wall.lattice.through, np.array([[a, b]]), 0.1)(p) > 0
    )
    assert mesh.volume == pytest.approx(left.mean(), abs=2e-3)
    assert closed.volume - mesh.volume > 5e-3


def test_every_void_has_its_channel():
    mesh = vent(wall_of((2, 1, 1)), 0.2, h=0.06)
    assert topology_of(wall_of((2, 1, 1)).mesh(0.06)).betti == (1, 0, 2)
    assert topology_of(mesh).betti == (1, 0, 0)


def test_a_wall_without_voids_is_only_meshed():
    wall = wall_of(d=0.1)
    np.testing.assert_array_equal(vent(wall, 0.2, h=0.06).vertices, wall.mesh(0.06).vertices)


def test_channels_are_bounded_and_have_slopes_also_through_a_map():
    torus = il.macroshape.torus(2.0, 1.5)
    ends = torus.x(np.array([[0.1, 0.2, 0.3], [0.15, 0.9, 0.8], [0.6, 0.5, 0.5], [0.62, 0.1, 0.9]]))
    field = channel_field(torus, ends.reshape(2, 2, 3), 0.2)
    rng = np.random.default_rng(2)
    lo = 0.9 * rng.random((500, 3))
    hi = lo + 0.1 * rng.random((500, 3))
    bound = field.range(lo, hi)
    for t in rng.random((20, 500, 3)):
        value = field(lo + t * (hi - lo))
        assert ((bound[:, 0] <= value) & (value <= bound[:, 1])).all()
    assert (bound[:, 1] < 0.0).mean() > 0.3
    u, step = 0.05 + 0.9 * rng.random((200, 3)), 1e-6
    value, gradient = field.jet(u, 1)
    ahead = np.stack([field(u + step * e) - value for e in np.eye(3)], axis=1) / step
    np.testing.assert_allclose(gradient, ahead, atol=1e-3)
    x = torus.x(u)
    t = np.linspace(0.0, 1.0, 2001)[:, None, None]
    dense = [
        np.linalg.norm(a + t * (b - a) - x, axis=2).min(axis=0) for a, b in ends.reshape(2, 2, 3)
    ]
    np.testing.assert_allclose(value, 0.2 - np.min(dense, axis=0), atol=1e-3)


def test_voids_that_stay_closed_are_an_error(monkeypatch):
    aside = np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, 0.1]]])
    monkeypatch.setattr(venting, "channels", lambda *_: aside)
    with pytest.raises(GeometryError, match="1 of 1 voids are still closed"):
        vent(wall_of(), 0.2, h=0.06)


@pytest.mark.filterwarnings("ignore:.* is far from .* of the surfaces")  # voids are small
@pytest.mark.parametrize(
    ("diameter", "h", "message"),
    [
        (0.0, None, "diameter"),
        (None, None, "diameter must be one number above zero, got None"),
        (10, None, "diameter=10 is too large for the part"),
        (np.nan, None, "diameter"),
        (0.1, 0.05, "h <= 0.0333"),
        (0.2, 0, "h"),
    ],
)
def test_bad_input_is_named(diameter, h, message):
    with pytest.raises(InputError, match=message):
        vent(wall_of(), diameter, h=h)


def test_a_mesh_is_no_wall():
    with pytest.raises(InputError, match=r"wall must be a Wall, .*got SurfaceMesh"):
        vent(wall_of(d=0.1).mesh(0.06), 0.1)
