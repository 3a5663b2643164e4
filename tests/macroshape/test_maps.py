"""The interface of `SplineMap`: derivatives, extra coordinates, closedness, turned copies."""

import dataclasses
import re

import macro_zoo
import numpy as np
import pytest
import spline_zoo
from macro_zoo import ZOO, parameters

from ilattice import macroshape as ms
from ilattice.bspline import BSpline
from ilattice.errors import InputError, PrecisionWarning
from ilattice.macroshape import SplineMap

ALL = pytest.mark.parametrize("volume", ZOO.values(), ids=ZOO)


@ALL
def test_jet_is_x_jacobian_and_hessian(volume):
    u = parameters(volume, 20)
    x, J, H = volume.jet(u)
    assert (x.shape, J.shape, H.shape) == ((28, 3), (28, 3, 3), (28, 3, 3, 3))
    np.testing.assert_allclose(x, volume.x(u), atol=1e-13)
    np.testing.assert_allclose(J, volume.jacobian(u), atol=1e-11)
    np.testing.assert_allclose(H, volume.hessian(u), atol=1e-9)
    assert len(volume.jet(u, 1)) == 2


@ALL
def test_derivatives_are_those_of_differences(volume):
    lo, hi = volume.domain
    u = lo + (0.1 + 0.8 * np.random.default_rng(1).random((40, 3))) * (hi - lo)
    breaks = [volume.spline.breaks(k) for k in range(3)]
    for k in range(3):
        u = u[np.abs(u[:, k, None] - breaks[k]).min(axis=1) > 1e-3]
    assert len(u) > 20
    size = np.ptp(volume.bounds)
    for k in range(3):
        step = np.zeros(3)
        step[k] = 1e-5 * (hi - lo)[k]
        ahead, back = volume.jet(u + step, 1), volume.jet(u - step, 1)
        rate = [(a - b) / (2 * step[k]) for a, b in zip(ahead, back, strict=True)]
        np.testing.assert_allclose(volume.jacobian(u)[:, :, k], rate[0], atol=1e-6 * size)
        np.testing.assert_allclose(volume.hessian(u)[..., k], rate[1], atol=3e-5 * size)


@ALL
def test_bounds_hold_the_image(volume):
    x = volume.x(parameters(volume, 2000))
    lo, hi = volume.bounds
    slack = 1e-12 * np.ptp(volume.bounds)
    assert (x >= lo - slack).all()
    assert (x <= hi + slack).all()


@ALL
def test_flipping_turns_the_handedness_and_keeps_the_points(volume):
    for axis in range(3):
        turned = volume.flipped(axis)
        u = parameters(volume, 30)
        back = u.copy()
        back[:, axis] = volume.domain[:, axis].sum() - u[:, axis]
        np.testing.assert_allclose(turned.x(back), volume.x(u), atol=1e-12)
        assert turned.orientation == -volume.orientation
        assert turned.closed == volume.closed


@ALL
def test_fixing_the_orientation_gives_right_handed_maps(volume):
    fixed = volume.fix_orientation()
    assert fixed.orientation == 1
    assert (fixed is volume) == (volume.orientation == 1)
    assert np.linalg.det(fixed.jacobian(parameters(fixed, 50))).min() > 0


@ALL
def test_permuting_reorders_the_parameters(volume):
    turned = volume.permuted((2, 0, 1))
    u = parameters(volume, 30)
    np.testing.assert_allclose(turned.x(u[:, [2, 0, 1]]), volume.x(u), atol=1e-13)
    assert turned.orientation == volume.orientation
    assert volume.permuted((1, 0, 2)).orientation == -volume.orientation
    assert turned.closed == tuple(volume.closed[i] for i in (2, 0, 1))


@ALL
def test_info_is_plain_data(volume):
    import json

    info = json.loads(json.dumps(volume.info))
    assert info["orientation"] == volume.orientation
    assert info["certificate"] == "VALID"
    assert info["volume"] == pytest.approx(volume.volume())
    assert info["extra"] == list(volume.names)


@ALL
def test_volume_agrees_with_the_flux_of_position_through_the_faces(volume):
    """Divergence theorem: 3 V is the flux of x; seams of closed directions cancel."""
    nodes, weights = np.polynomial.legendre.leggauss(20)
    sites, rules = [], []
    for k in range(3):
        b = volume.spline.breaks(k)
        half = 0.5 * np.diff(b)
        sites.append((half[:, None] * (nodes + 1) + b[:-1, None]).ravel())
        rules.append(np.outer(half, weights).ravel())
    flux = 0.0
    for axis in range(3):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        for end, sign in enumerate((-1, 1)):
            a, b = np.meshgrid(sites[i], sites[j], indexing="ij")
            u = np.empty((a.size, 3))
            u[:, axis], u[:, i], u[:, j] = volume.domain[end, axis], a.ravel(), b.ravel()
            x, J = volume.jet(u, 1)
            normal = np.cross(J[:, :, i], J[:, :, j])
            flux += sign * np.outer(rules[i], rules[j]).ravel() @ (x * normal).sum(axis=1)
    assert volume.volume(points=16) == pytest.approx(abs(flux) / 3, rel=1e-11)
    assert volume.volume() == pytest.approx(abs(flux) / 3, rel=1e-7)


def test_outside_the_domain_is_an_error_unless_asked_for():
    volume = ms.box((1, 2, 3))
    with pytest.raises(InputError, match="outside the domain"):
        volume.x([[1.5, 0.5, 0.5]])
    np.testing.assert_allclose(volume.x([[1.5, 0.5, 0.5]], extrapolate="extend"), [[1.5, 1, 1.5]])
    np.testing.assert_allclose(volume.x([[1.5, 0.5, 0.5]], extrapolate="clamp"), [[1, 1, 1.5]])
    np.testing.assert_allclose(
        volume.jacobian([[1.5, 0.5, 0.5]], extrapolate="extend")[0], np.diag([1, 2, 3])
    )


def test_closed_directions_are_found_by_their_geometry():
    assert ms.torus().closed == (True, False, False)
    assert ms.torus(form="arcs").closed == (True, False, False)
    assert ms.torus(form="exact").permuted((1, 2, 0)).closed == (False, False, True)
    assert ms.cylinder_shell(angle=6.28).closed == (False, False, False)
    assert ms.box().closed == (False, False, False)
    s = ms.torus(form="arcs").spline
    c = s.c.copy()
    c[-1, 0, 0, 2] += 1e-9
    assert SplineMap(BSpline(s.t, c, s.k)).closed == (False, False, False)


def test_extra_coordinates_do_not_disturb_the_geometry():
    plain, rich = ms.torus(), ZOO["seven coordinates"]
    u = parameters(plain, 100)
    np.testing.assert_array_equal(rich.x(u), plain.x(u))
    assert rich.names == ("r", "g", "b", "d")
    expected = np.stack([np.full(108, 0.1), u[:, 1], np.ones(108), np.full(108, 0.05)], axis=1)
    np.testing.assert_allclose(rich.extra(u), expected, atol=1e-12)
    assert plain.extra(u).shape == (108, 0)
    assert rich.flipped(1).names == rich.names
    np.testing.assert_allclose(rich.flipped(1).extra(u)[:, 1], 1 - u[:, 1], atol=1e-12)


@ALL
def test_functions_in_the_spline_space_are_reproduced(volume):
    """The map's own x, y, z, fed back as functions of the parameters."""
    names = {"p": 0, "q": 1, "s": 2}
    rich = volume.with_extra(**{n: lambda u, i=i: volume.x(u)[:, i] for n, i in names.items()})
    u = parameters(volume, 100)
    np.testing.assert_allclose(rich.extra(u)[:, -3:], volume.x(u), atol=1e-11)
    assert rich.names[-3:] == ("p", "q", "s")


@pytest.mark.parametrize("name", sorted(set(spline_zoo.ZOO) - {"repeated knots"}))
def test_splines_of_every_kind_are_maps(name):
    spline, names = spline_zoo.ZOO[name]
    volume = SplineMap(spline, names=names)
    u = parameters(volume, 100)
    rich = volume.with_extra(p=lambda u: volume.x(u)[:, 2])
    np.testing.assert_allclose(rich.extra(u)[:, -1], volume.x(u)[:, 2], atol=1e-12)
    back = volume.domain.sum(axis=0) - u
    turned = volume.flipped(0).flipped(1).flipped(2)
    np.testing.assert_allclose(turned.x(back), volume.x(u), atol=1e-12)
    np.testing.assert_allclose(turned.extra(back), volume.extra(u), atol=1e-12)
    assert volume.closed == spline.periodic


def test_functions_need_knots_without_jumps():
    volume = SplineMap(spline_zoo.ZOO["repeated knots"][0])
    with pytest.raises(InputError, match="heat must be coefficients"):
        volume.with_extra(heat=lambda u: u[:, 0])
    assert volume.with_extra(heat=1.0).names == ("heat",)


def wave(u):
    return 3.0 + np.sin(6.0 * u[:, 0])


def test_functions_that_the_map_cannot_follow_are_warned_of():
    """The chord of sin 6u from 0 to 1 is off by most of the range; the remedy is the named one."""
    with pytest.warns(PrecisionWarning, match=r"^heat is interpolated") as found:
        ms.box().with_extra(even=1.0, flat=lambda u: 0 * u[:, 0] + 1 / 3, heat=wave)
    (warning,) = found
    assert warning.filename == __file__
    u = np.linspace(0.0, 1.0, 2001)
    off = np.abs(np.sin(6.0 * u) - np.sin(6.0) * u).max() / np.ptp(np.sin(6.0 * u))
    percent = float(re.search(r"([\d.]+) %", str(warning.message))[1])
    assert percent == pytest.approx(100 * off, abs=1.0)


def test_maps_with_more_coefficients_follow():
    box = ms.box().with_extra(old=0.5)
    knots = np.linspace(0.0, 1.0, 9)[1:-1]
    finer = SplineMap(box.spline.elevate(0, 2).insert_knots(0, knots), names=box.names)
    rich = finer.with_extra(heat=wave)  # warnings are errors
    u = parameters(box, 200)
    np.testing.assert_allclose(rich.x(u), box.x(u), atol=1e-14)
    assert rich.names == ("old", "heat")
    np.testing.assert_allclose(rich.extra(u)[:, 1], wave(u), atol=0.01 * 2.0)


def test_a_seam_is_a_jump_for_functions_that_do_not_repeat():
    torus = ms.torus()
    with pytest.warns(PrecisionWarning, match="repeat in closed directions"):
        torus.with_extra(heat=lambda u: u[:, 0])
    torus.with_extra(heat=lambda u: np.sin(np.pi * u[:, 0]) ** 2)


def test_coefficients_of_extra_coordinates_are_taken_as_they_are():
    c = np.random.default_rng(0).random((2, 2, 2))
    volume = ms.box().with_extra(heat=c)
    np.testing.assert_array_equal(volume.spline.c[..., 3], c)
    assert volume.with_extra() is volume


def test_default_names_count_the_extra_coordinates():
    s = ms.box().with_extra(a=1, b=2).spline
    assert SplineMap(s).names == ("e0", "e1")
    assert "e0" in repr(SplineMap(s))


@pytest.mark.parametrize("names", [("a",), ("a", "a"), ("x", "b"), ("a", "b c"), ("a", 1)])
def test_bad_names_are_refused(names):
    s = ms.box().with_extra(a=1, b=2).spline
    with pytest.raises(InputError, match="names must be 2 different words"):
        SplineMap(s, names=names)


@pytest.mark.parametrize(
    "value", [np.zeros((2, 2)), np.zeros((2, 2, 3)), np.nan, "red", lambda _: np.zeros(3)]
)
def test_bad_extra_coordinates_are_refused(value):
    with pytest.raises(InputError, match="heat"):
        ms.box().with_extra(heat=value)


def test_a_name_that_is_taken_is_refused():
    with pytest.raises(InputError, match="names"):
        ms.box().with_extra(d=1).with_extra(d=2)


def test_what_is_no_volume_in_space_is_refused():
    line = [0.0, 0, 1, 1]
    for bad in (
        BSpline([line] * 3, np.zeros((2, 2, 2, 2)), 1),
        BSpline([line] * 3, np.zeros((2, 2, 2)), 1),
        macro_zoo.patch(),
        np.zeros((2, 2, 2, 3)),
        None,
    ):
        with pytest.raises(InputError, match="spline must be a BSpline with 3 parameters"):
            SplineMap(bad)
    with pytest.raises(InputError, match="degrees of at least 1"):
        SplineMap(BSpline([line, line, [0, 1, 2]], np.zeros((2, 2, 2, 3)), (1, 1, 0)))


@pytest.mark.parametrize("order", [(0, 1), (0, 0, 1), (1, 2, 3), None])
def test_bad_permutations_are_refused(order):
    with pytest.raises(InputError, match=r"order must be a (permutation|list)"):
        ms.box().permuted(order)


@pytest.mark.parametrize("axis", [-1, 3, "u"])
def test_bad_axes_are_refused(axis):
    with pytest.raises(InputError, match="axis"):
        ms.box().flipped(axis)


def test_maps_are_immutable():
    volume = ms.box()
    with pytest.raises(dataclasses.FrozenInstanceError):
        volume.spline = None
    with pytest.raises(ValueError, match="read-only"):
        volume.bounds[0, 0] = 1


@pytest.mark.parametrize("ending", [".npz", ".json", ".itd"])
def test_saving_and_loading_keeps_a_map(tmp_path, ending):
    volume = ZOO["seven coordinates"]
    volume.save(tmp_path / f"v{ending}")
    again = ms.load(tmp_path / f"v{ending}")
    u = parameters(volume, 50)
    np.testing.assert_allclose(again.x(u), volume.x(u), atol=1e-12)
    np.testing.assert_allclose(again.extra(u), volume.extra(u), atol=1e-12)
    assert again.closed == volume.closed


@ALL
def test_volumes_of_boxes_add_up_to_that_of_the_map(volume):
    lo, hi = volume.domain
    parts = [[0.0, 0.23, 0.61, 1.0], [0.0, 0.4, 1.0], [0.0, 1.0]]
    planes = [a + (b - a) * np.array(t) for a, b, t in zip(lo, hi, parts, strict=True)]
    found = volume.box_volumes(planes)
    assert found.shape == (3, 2, 1)
    assert abs(found.sum()) == pytest.approx(volume.volume(), rel=1e-8)  # rational ones
    part = volume.box_volumes([planes[0][1:3], *planes[1:]])
    np.testing.assert_allclose(part, found[1:2], rtol=1e-9)


def test_bends_are_where_derivatives_jump():
    knots = [[0, 0, 0, 0.3, 0.3, 0.6, 1, 1, 1], [0, 0, 0.7, 1, 1], [0, 0, 1, 1]]
    c = np.zeros((6, 3, 2, 3))
    c[..., 0] = np.array([0, 0.1, 0.3, 0.8, 0.9, 1.0])[:, None, None]
    c[..., 1], c[..., 2] = np.arange(3.0)[:, None], np.arange(2.0)
    through = SplineMap(BSpline(knots, c, (2, 1, 1)))
    assert [list(through.bends(a)) for a in range(3)] == [[0.3], [0.7], []]


@pytest.mark.parametrize(
    "planes",
    [None, [[0, 1]] * 2, [[0, 1], [0, 1], [1, 0]], [[0, 1], [0, 1], [0, 2]], [[0], [0], [0]]],
)
def test_planes_that_make_no_boxes_are_refused(planes):
    with pytest.raises(InputError, match="planes"):
        ms.box().box_volumes(planes)
