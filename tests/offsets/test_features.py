"""Least walls and gaps: exact values of the Schwarz P cell, and what they mean."""

import numpy as np
import pytest
from scipy.optimize import brentq

import ilattice as il
from ilattice.errors import GeometryError, InputError
from ilattice.topology import features
from ilattice.topology.critical import critical_points
from ilattice.topology.critical_point import CriticalPoint

PINCH = np.sqrt(2.0) / 6.0  # half-thickness at which the pores of the Schwarz P cell close


@pytest.fixture(scope="module")
def schwarz_p():
    return il.Lattice("schwarz_p", through=il.macroshape.box(), spans_per_tile=8)


@pytest.mark.parametrize("d", [0.05, 0.2])
def test_the_narrowest_gap_of_schwarz_p_is_its_throat(schwarz_p, d):
    gap = schwarz_p.offset(d).minimum_gap()
    assert gap.size == pytest.approx(2.0 * (PINCH - d), abs=1e-8)
    assert gap.kind == "neck"
    assert sorted(np.abs(gap.x - 0.5).round(6)) == [0.0, 0.0, 0.5]


def test_the_gap_ends_where_the_topology_changes():
    lattice = il.Lattice("iwp", through=il.macroshape.box((1.0, 1.2, 0.9)), spans_per_tile=6)
    gap = lattice.offset(0.05).minimum_gap()
    within = np.stack([gap.u - 0.15, gap.u + 0.15]).clip(0.0, 1.0)
    nearby = critical_points(lattice, 0.05, 0.05 + 0.6 * gap.size, within=within)
    assert 0.05 + 0.5 * gap.size == pytest.approx(nearby[0].value, abs=1e-8)


def test_walls_are_as_thick_as_asked(schwarz_p):
    assert schwarz_p.offset(0.1).minimum_thickness().size == pytest.approx(0.2, rel=1e-12)
    least = schwarz_p.offset((0.02, lambda u: 0.03 + 0.02 * u[:, 0])).minimum_thickness()
    assert least.size == pytest.approx(0.05, rel=1e-6)
    assert least.kind == "wall"
    assert least.x[0] == 0.0


def test_a_pore_that_has_just_closed_is_a_thin_web(schwarz_p):
    d = PINCH + 1e-3
    wall = schwarz_p.offset(d)
    web = wall.minimum_thickness()
    assert web.kind == "web"
    along = np.where(np.abs(web.u - 0.5) > 0.4, np.sign(0.5 - web.u), 0.0)  # the axis of the pore

    def beyond(t):
        return np.abs(schwarz_p.distance((web.u + t * along)[None])[0]) - d

    assert web.size == pytest.approx(2.0 * brentq(beyond, 0.0, 0.2), rel=1e-2)


@pytest.mark.filterwarnings("ignore:through. det J comes down to 0")
def test_webs_where_faces_collapse_have_a_size():
    """Directions that the map flattens lead nowhere; they used to end in LinAlgError."""
    c = np.stack(np.meshgrid(*[[0.0, 1.0]] * 3, indexing="ij"), axis=-1) * [1.03, 0.97, 1.21]
    c[:, :, 1, 0] = 0.47
    wedge = il.SplineMap(il.BSpline([[0.0, 0.0, 1.0, 1.0]] * 3, c, 1))
    lattice = il.Lattice("gyroid", through=wedge)
    u = np.array([0.37, 0.56, 1.0])
    s = float(lattice.distance(u[None])[0])
    wall = lattice.offset(abs(s) + 0.05)
    side = 1 if s > 0 else -1
    web = CriticalPoint(abs(s), u, wedge.x(u[None])[0], side, feet=2, on=(0, 0, 1))
    size = features._room(wall, web, 0.3)
    assert 0.049 < size < 0.3
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.inv(wedge.jacobian(u[None])[0])


def test_walls_that_cannot_be_made_are_refused(schwarz_p):
    assert schwarz_p.offset(0.1, least_gap=0.27, least_wall=0.2).thickness.constant
    with pytest.raises(GeometryError, match=r"least gap is 0\.2714 .*least_gap=0\.28; make the"):
        schwarz_p.offset(0.1, least_gap=0.28)
    with pytest.raises(GeometryError, match=r"least wall is 0\.2 .*least_wall=0\.21"):
        schwarz_p.offset(0.1, least_wall=0.21)


@pytest.mark.parametrize("name", ["least_wall", "least_gap"])
@pytest.mark.parametrize("limit", [np.nan, np.inf, -2.0, "a", [0.1, 0.2]])
def test_limits_that_are_none_are_refused_before_any_work(name, limit):
    fresh = il.Lattice("schwarz_p", through=il.macroshape.box((1.0, 1.0, 1.0)))
    with pytest.raises(InputError, match=name):
        fresh.offset(0.1, **{name: limit})
    assert fresh._cache == {}


def test_features_of_what_has_none(schwarz_p):
    full = schwarz_p.offset(0.44).minimum_gap()
    assert (full.size, full.kind, str(full)) == (np.inf, "none", "none")
    with pytest.raises(InputError, match="solids"):
        schwarz_p.offset((np.inf, 0.1)).minimum_thickness()
    with pytest.raises(InputError, match="parametric"):
        schwarz_p.offset(0.1, space="parametric").minimum_gap()
    with pytest.raises(InputError, match="not for parametric"):
        schwarz_p.offset(0.1, space="parametric", least_gap=0.1)
