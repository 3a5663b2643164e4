"""What is told of volumes that meshes lose, by random points and by the exact volume."""

from types import SimpleNamespace

import numpy as np
import pytest

import ilattice as il
from ilattice.mesh.loss import NEAR, REFUSED, TOLD, loss_of
from ilattice.offsets import solid
from ilattice.offsets import wall as walls
from ilattice.offsets.volume_points import Estimate

#: Walls, of which more random points are taken than it would take the exact volume to be faster.
MANY = 64
WALLS = {
    "thick": lambda: offset("gyroid", il.macroshape.torus(), (4, 1, 1), 0.15),
    "varying": lambda: offset("iwp", il.macroshape.box(), (1, 1, 1), lambda u: 0.02 + u[:, 0] / 50),
    "one-sided": lambda: offset("schwarz_p", il.macroshape.duck(), (2, 1, 1), (0.0, 0.2)),
    "struts": lambda: offset("sc_struts", il.macroshape.box(), (1, 1, 1), (np.inf, 0.02)),
}
#: What meshes have more of the volume, next to what is told and refused, and between.
PARTS = (-0.2, -0.06, -0.028, -0.0102, -0.004, 0.006, 0.0098, 0.035, 0.0503)
KINDS = ("nothing", "told", "refused")


def offset(tile, through, repeat, d):
    return il.Lattice(tile, through=through, repeat=repeat).offset(d)


def told(wall, part, whole, **options):
    """What is told of a mesh of a wall with edges of its thickness."""
    h = wall.least_thickness
    mesh = SimpleNamespace(volume=(1.0 + part) * whole, longest=h)
    given = {"sheets": False, "exactly": False, "default": False, **options}
    return loss_of(wall, given.pop("h", h), mesh, **given)


def kind(loss):
    if loss is None:
        return KINDS[0]
    return KINDS[1 + (abs(loss.part) > REFUSED)]


@pytest.fixture
def exact(monkeypatch):
    """How often the exact volume was asked for; many points are taken first."""
    monkeypatch.setattr(walls, "PER_CELL", MANY)
    asked, volumes = [], walls.volumes
    for module in (walls, solid):
        monkeypatch.setattr(
            module, "volumes", lambda *a, **more: (asked.append(1), volumes(*a, **more))[1]
        )
    return asked


@pytest.mark.parametrize("name", WALLS)
def test_what_is_told_by_random_points_is_what_the_exact_volume_tells(name, exact):
    wall, same = WALLS[name](), WALLS[name]()
    whole = same.volume()
    by_points = 0
    for part in PARTS:
        for name in ("_estimates", "_filled"):
            wall.__dict__.pop(name, None)
        wall._known.clear()
        exact.clear()
        loss, expected = told(wall, part, whole), told(same, part, whole)
        assert kind(loss) == kind(expected)
        assert kind(expected) == KINDS[(abs(part) > TOLD) + (abs(part) > REFUSED)]
        if loss is not None:
            assert loss.part == pytest.approx(part, rel=0.1)
            assert ("about" in loss.message) != bool(exact)
        by_points += not exact
    assert by_points >= 5


def test_the_exact_volume_is_asked_for_next_to_what_is_told_only(exact):
    wall = WALLS["thick"]()
    whole = WALLS["thick"]().volume()
    exact.clear()
    for part in (0.002, -0.03, 0.2):
        told(wall, part, whole)
    assert exact == []
    assert len(wall._estimates) > 1  # of the part that is told a tenth has to be known
    assert told(wall, 1.0005 * TOLD, whole) is not None
    assert exact == [1]
    assert told(wall, 0.9995 * TOLD, whole) is None
    assert "about" not in told(wall, -0.03, whole).message  # as it is known now
    assert exact == [1]


@pytest.mark.parametrize("default", [False, True])
def test_less_is_told_of_short_edges_that_are_given(default):
    wall, same = WALLS["thick"](), WALLS["thick"]()
    h, whole = 0.4 * wall.least_thickness, same.volume()
    for part in (0.8, 1.2, 1.8, 2.2):
        loss = told(wall, 0.01 * part, whole, h=h, default=default)
        assert (loss is None) == (0.01 * part < (TOLD if default else NEAR))


def test_what_is_told_is_known_to_a_tenth(monkeypatch):
    """By estimates that are off by up to three standard errors."""
    wall, rng = WALLS["thick"](), np.random.default_rng(4)

    def estimated(_wall, error):
        error = min(error, 0.02)
        return Estimate(1.0 + error * rng.uniform(-3.0, 3.0), error, 1)

    monkeypatch.setattr(type(wall), "_estimated", estimated)
    for part in rng.uniform(-0.5, 0.5, 300):
        part = np.sign(part) * max(abs(part), 1.5 * TOLD)
        if abs(abs(part) - REFUSED) < 0.1 * REFUSED:
            continue
        loss = told(wall, part, 1.0)
        assert kind(loss) == ("refused" if abs(part) > REFUSED else "told")
        assert loss.part == pytest.approx(part, rel=0.1)


def test_exact_distances_change_what_random_points_tell():
    """Of a spline of few spans: by exact distances the mesh has lost nothing."""
    lattice = il.Lattice("primitive", through=il.macroshape.box(), spans_per_tile=4)
    wall = lattice.offset((np.inf, -0.2))
    changed = wall._rounded.volume
    whole = wall._volume
    assert changed > 0.05 * whole
    wall._known.clear()
    assert told(wall, changed / whole, whole, exactly=True) is None
    loss = told(wall, changed / whole, whole, exactly=False)
    assert kind(loss) == "refused"


def test_exact_distances_are_not_asked_for_before_they_matter(monkeypatch):
    wall = WALLS["thick"]()
    monkeypatch.setattr(type(wall), "_rounded", property(lambda _: pytest.fail("asked")))
    estimates = iter([Estimate(1.0, 0.01, 1), Estimate(1.03, 1e-3, 1)])
    monkeypatch.setattr(type(wall), "_estimated", lambda *_: next(estimates))
    assert told(wall, 0.03, 1.0, exactly=True) is None


def test_exact_distances_add_to_what_is_nearly_told_of_short_edges(monkeypatch):
    wall, asked = WALLS["thick"](), []
    h = 0.4 * wall.least_thickness
    rounded = SimpleNamespace(volume=-0.01)
    monkeypatch.setattr(type(wall), "_rounded", property(lambda _: (asked.append(1), rounded)[1]))
    monkeypatch.setattr(type(wall), "_estimated", lambda *_: Estimate(1.0, 0.0, 0))
    assert told(wall, 0.017, 1.0, h=h, exactly=True) is None
    assert asked == []
    assert told(wall, 0.019, 1.0, h=h, exactly=True).part == pytest.approx(1.019 / 0.99 - 1.0)
    assert told(wall, 0.0095, 1.0, h=h, exactly=True, default=True) is None
    assert asked == [1]
