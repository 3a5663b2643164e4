"""The Jacobian certificate against sampling, known volumes and real files."""

import warnings
from importlib import import_module
from pathlib import Path

import macro_zoo
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from macro_zoo import ZOO, parameters

from ilattice import macroshape as ms
from ilattice.bspline import BSpline
from ilattice.errors import GeometryError, InputError, PrecisionWarning
from ilattice.macroshape import SplineMap, Status, certify, check_map
from ilattice.macroshape import _bernstein as bern

DATA = Path(__file__).parents[1] / "data"
CUBE = np.array(
    [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)],
    dtype=float,
)


def folded_cube():
    corners = CUBE.copy()
    corners[6] = 0.2
    return ms.hexahedron(corners)


def bent_line(z, degree):
    """The unit cube with a polynomial along w, Bernstein coefficients `z`."""
    c = np.moveaxis(np.indices((2, 2, degree + 1)).astype(float), 0, -1)
    c[..., 2] = z
    t = [[0, 0, 1, 1], [0, 0, 1, 1], [0] * (degree + 1) + [1] * (degree + 1)]
    return SplineMap(BSpline(t, c, (1, 1, degree)))


# ------------------------------------------------------------------------------ bounds


@pytest.mark.parametrize("volume", ZOO.values(), ids=ZOO)
def test_bounds_hold_and_are_tight(volume):
    c = certify(volume)
    assert c.status is Status.VALID
    det = c.orientation * np.linalg.det(volume.jacobian(parameters(volume, 20_000)))
    scale = np.abs(det).max()
    assert det.min() >= c.bound - 1e-12 * scale
    assert det.max() <= c.largest + 1e-12 * scale
    assert c.bound == pytest.approx(c.orientation * c.worst_det, rel=2e-3)
    assert det.min() >= c.orientation * c.worst_det - 2e-3 * scale
    there = np.linalg.det(volume.jacobian(c.worst_u[None]))[0]
    assert there == pytest.approx(c.worst_det, rel=1e-9)
    np.testing.assert_allclose(volume.x(c.worst_u[None])[0], c.worst_x, atol=1e-12)
    assert len(c.singular_u) == 0


@given(
    seed=st.integers(0, 10_000),
    k=st.tuples(*[st.integers(1, 4)] * 3),
    spans=st.tuples(*[st.integers(1, 3)] * 3),
    amount=st.sampled_from([0.05, 0.2, 0.4, 1.0]),
    rational=st.booleans(),
)
@settings(max_examples=40)
def test_status_agrees_with_dense_sampling(seed, k, spans, amount, rational):
    n = tuple(a + b for a, b in zip(k, spans, strict=True))
    volume = macro_zoo.perturbed(n, k, amount, seed=seed, rational=rational)
    c = certify(volume)
    grid = [np.linspace(0, 1, 21)] * 3
    det = c.orientation * np.linalg.det(volume.geometry.grid(grid, 1)[1])
    assert c.status is not Status.UNDECIDED
    assert det.min() >= c.bound - 1e-12 * c.largest
    assert det.max() <= c.largest * (1 + 1e-12)
    if c.status is Status.VALID:
        assert c.bound > 0
    else:
        there = np.linalg.det(volume.jacobian(c.worst_u[None], extrapolate="clamp"))[0]
        assert c.orientation * c.worst_det < 0 < det.max()
        if not _on_inner_knot(volume, c.worst_u):
            assert there == pytest.approx(c.worst_det, rel=1e-7, abs=1e-9 * c.largest)


def _on_inner_knot(volume, u):
    """Where derivatives of C⁰ maps have two values, and the worst may be the other one."""
    inner = [volume.spline.breaks(k)[1:-1] for k in range(3)]
    return any(np.isclose(u[k], inner[k]).any() for k in range(3))


def test_the_polynomials_are_det_j():
    for volume in (macro_zoo.perturbed((4, 3, 5), (3, 2, 4), 0.3), ms.duck()):
        cells = volume.spline.to_bezier()
        net = cells.coefficients
        points = np.moveaxis(net.reshape(-1, *net.shape[3:]), -1, 1)
        values = bern.sampled(bern.determinant(points), (3, 3, 3))[0]
        ends = [b[:2] for b in cells.breaks]
        grid = [np.linspace(a, b, 3) for a, b in ends]
        det = np.linalg.det(volume.geometry.grid(grid, 1)[1]) * np.prod([b - a for a, b in ends])
        inner = (slice(0, 2),) * 3  # the right ends belong to the next element
        np.testing.assert_allclose(values[inner], det[inner], rtol=1e-11)


def test_the_rational_polynomials_are_det_j():
    volume = macro_zoo.perturbed((3, 4, 2), (2, 3, 1), 0.3, rational=True)
    w = volume.spline.weights
    points = np.moveaxis(volume.spline.c, -1, 0) * w
    upper = bern.homogeneous_determinant(np.concatenate([w[None], points])[None])
    lower = bern.fourth_power(w[None])
    upper, lower = (bern.sampled(bern.plain(a), (5, 5, 5))[0] for a in (upper, lower))
    grid = [np.linspace(0, 1, 5)] * 3
    np.testing.assert_allclose(
        upper / lower, np.linalg.det(volume.geometry.grid(grid, 1)[1]), rtol=1e-11
    )
    raised = bern.plain(bern.elevated(bern.scaled(w[None])))
    np.testing.assert_allclose(bern.sampled(raised, (4, 4, 4)), bern.sampled(w[None], (4, 4, 4)))


def test_halves_are_the_same_polynomial():
    c = np.random.default_rng(0).standard_normal((3, 4, 3, 5))
    whole = bern.sampled(c, (5, 5, 5))
    parts = bern.sampled(bern.halves(c), (3, 3, 3)).reshape(3, 2, 2, 2, 3, 3, 3)
    np.testing.assert_allclose(parts[:, 0, 0, 0], whole[:, :3, :3, :3], atol=1e-13)
    np.testing.assert_allclose(parts[:, 1, 0, 1], whole[:, 2:, :3, 2:], atol=1e-13)


# ------------------------------------------------------------------------------ anchors


def test_a_cube_with_one_corner_pushed_through_is_invalid():
    c = certify(folded_cube())
    assert c.status is Status.INVALID
    assert c.worst_det == pytest.approx(-1.4, abs=1e-12)
    np.testing.assert_allclose(c.worst_u, [1, 1, 1])
    np.testing.assert_allclose(c.worst_x, [0.2, 0.2, 0.2])
    assert c.scaled < 0
    assert str(c).startswith("INVALID, right-handed: least det J -1.4 at u = (1, 1, 1)")


def test_the_scaled_jacobian_of_a_box_is_one_and_of_a_shear_its_sine():
    assert certify(ms.box((1, 20, 300))).scaled == pytest.approx(1)
    shear = ms.affine([[1, np.cos(0.3), 0], [0, np.sin(0.3), 0], [0, 0, 1]])
    assert certify(shear).scaled == pytest.approx(np.sin(0.3))


@pytest.mark.parametrize("shift", [0.0, 1e3, 1e6])
@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_size_and_place_do_not_matter(size, shift):
    s = ms.duck().spline
    c = certify(BSpline(s.t, size * (s.c + shift), s.k))
    assert c.status is Status.VALID
    assert c.worst_det == pytest.approx(0.3236 * size**3, rel=1e-3)


def test_a_fold_inside_an_element_is_found():
    """det J is positive at all corners of the only element, and negative in its middle."""
    volume = bent_line([0.0, 1.2, -0.2, 1.0], 3)
    corners = np.linalg.det(volume.jacobian(parameters(volume, 0)))
    assert corners.min() > 0
    c = certify(volume)
    assert c.status is Status.INVALID
    assert c.worst_u[2] == pytest.approx(0.5, abs=0.05)


def test_touching_zero_inside_is_undecided_at_the_place():
    """z = 4 (w - 1/2)³ + 1/2 and the same about 0.3: det J = 12 (w - w0)² touches zero."""
    volume = bent_line([0.0, 1.0, 0.0, 1.0], 3)
    c = certify(volume)
    assert c.status is Status.UNDECIDED
    np.testing.assert_allclose(c.singular_u[:, 2], 0.5)
    w0 = 0.3
    z = [-(w0**3), w0**2 - w0**3, -w0 + 2 * w0**2 - w0**3, (1 - w0) ** 3]
    c = certify(bent_line(z, 3))
    assert c.status is Status.UNDECIDED
    assert c.worst_u[2] == pytest.approx(0.3, abs=0.05)
    assert -1e-2 < c.bound <= 0 <= c.worst_det < 1e-2


def test_almost_touching_zero_is_decided():
    decided = {1e-5: Status.VALID, 1e-11: Status.VALID, -1e-5: Status.INVALID}
    for gap, status in (*decided.items(), (-1e-10, Status.UNDECIDED)):
        assert certify(bent_line([0.0, 1.0 - gap, gap, 1.0], 3)).status is status


@pytest.mark.parametrize(
    "volume",
    [
        ms.torus(form="arcs"),
        ms.duck(),
        folded_cube(),
        macro_zoo.perturbed((4, 4, 4), (3, 3, 3), 1.0),
    ],
)
def test_certificates_of_mirrored_maps_are_mirrored(volume):
    c, mirrored = certify(volume), certify(volume.flipped())
    assert mirrored.status is c.status
    assert mirrored.orientation == -c.orientation
    assert mirrored.worst_det == pytest.approx(-c.worst_det, rel=1e-6)
    assert mirrored.bound == pytest.approx(c.bound, rel=1e-6)
    assert mirrored.largest == pytest.approx(c.largest, rel=1e-6)
    assert mirrored.scaled == pytest.approx(c.scaled, rel=1e-6)
    assert mirrored.depth == c.depth


def test_a_large_volume_is_certified_in_batches(monkeypatch):
    module = import_module("ilattice.macroshape.certify")
    whole = certify(ms.duck())
    monkeypatch.setattr(module, "_BATCH", 1000)
    parts = certify(ms.duck())
    assert (parts.worst_det, parts.bound, parts.scaled) == (
        whole.worst_det,
        whole.bound,
        whole.scaled,
    )


# ------------------------------------------------------------------------------ files and doors


def test_a_left_handed_file_is_valid():
    volume = ms.load(DATA / "gismo" / "cylinder.xml")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        c = check_map(volume)
    assert (c.status, c.orientation) == (Status.VALID, -1)
    assert c.worst_det < 0
    assert volume.info["orientation"] == -1
    assert volume.closed == (True, False, False)


def test_a_file_with_doubled_control_points_warns_of_the_places():
    volume = ms.load(DATA / "gismo" / "GshapedVolume.xml")
    assert volume.certificate.status is Status.UNDECIDED
    assert volume.orientation == -1
    with pytest.warns(PrecisionWarning, match=r"vanishes at u = \(0\.857143, 0, 0\)"):
        check_map(volume)
    places = volume.certificate.singular_u
    np.testing.assert_allclose(places[:, 0], 6 / 7)
    assert {tuple(p) for p in places[:, 1:]} == {(0, 0), (0, 1), (1, 0), (1, 1)}
    assert np.abs(np.linalg.det(volume.jacobian(places))).max() < 1e-12
    fixed = volume.fix_orientation()
    assert fixed.orientation == 1
    assert len(fixed.certificate.singular_u) == 4


@pytest.mark.parametrize("patch", range(7))
def test_patches_of_both_orientations_are_valid(patch):
    volume = ms.load(DATA / "gismo" / "fichera.xml", patch)
    assert volume.certificate.status is Status.VALID
    det = np.linalg.det(volume.jacobian(parameters(volume, 10)))
    assert volume.orientation == np.sign(det[0])


def test_a_folded_map_is_refused_with_its_place():
    with pytest.raises(
        GeometryError, match=r"part is folded.*-1\.4 at u = \(1, 1, 1\), x = \(0\.2"
    ):
        check_map(folded_cube(), name="part")


def test_a_flat_map_is_refused():
    corners = CUBE.copy()
    corners[:, 2] = 3 * corners[:, 0]
    flat = ms.hexahedron(corners)
    assert (flat.certificate.status, flat.orientation) == (Status.INVALID, 0)
    with pytest.raises(GeometryError, match="flat"):
        check_map(flat)
    with pytest.raises(GeometryError, match="flat"):
        check_map(ms.hexahedron(np.ones((8, 3))))


@pytest.mark.parametrize("size", [1e-200, 1e-120, 1e90, 1e300])
def test_units_in_which_volumes_are_no_numbers_are_refused(size):
    with pytest.raises(InputError, match="use other units of length"):
        check_map(ms.box((size, 2 * size, size)))


def test_a_torn_map_is_refused_with_its_place():
    c = np.moveaxis(np.indices((4, 2, 2)).astype(float), 0, -1)
    t = [[0, 0, 0.5, 0.5, 1, 1], [0, 0, 1, 1], [0, 0, 1, 1]]
    torn = SplineMap(BSpline(t, c, 1))
    assert torn.certificate.status is Status.VALID
    with pytest.raises(GeometryError, match=r"torn at u = 0\.5"):
        check_map(torn)
    c[2:, ..., 0] -= 1
    check_map(SplineMap(BSpline(t, c, 1)))  # the sides agree: nothing is torn


def test_a_collapsed_edge_is_usable_with_a_warning():
    wedge = CUBE.copy()
    wedge[[3, 7]] = wedge[[0, 4]]
    with pytest.warns(PrecisionWarning, match="vanishes"):
        c = check_map(ms.hexahedron(wedge))
    assert c.status is Status.UNDECIDED
    assert c.orientation == 1
    assert c.bound == 0


def test_a_volume_that_touches_its_axis_is_usable_with_a_warning():
    t = [0, 0, 1, 1]
    section = BSpline([t, t], [[(0, 0, 0), (1, 0, 0)], [(0, 0, 1), (1, 0, 1)]], 1)
    cylinder = ms.revolve(section)
    assert cylinder.volume() == pytest.approx(np.pi, rel=1e-9)
    with pytest.warns(PrecisionWarning, match="vanishes"):
        check_map(cylinder)


def test_a_volume_that_crosses_its_axis_is_refused():
    t = [0, 0, 1, 1]
    section = BSpline([t, t], [[(-0.2, 0, 0), (1, 0, 0)], [(-0.2, 0, 1), (1, 0, 1)]], 1)
    with pytest.raises(GeometryError, match="folded"):
        check_map(ms.revolve(section))
