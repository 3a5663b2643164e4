"""Built-in shapes: sizes, exact circles, stated deviations, handedness, bad arguments."""

import numpy as np
import pytest
from macro_zoo import parameters

from ilattice import macroshape as ms
from ilattice.errors import InputError
from ilattice.macroshape import Status

SHAPES = {
    "identity": (ms.identity(), (2, 2, 2), (1, 1, 1)),
    "box": (ms.box((1, 2, 3)), (2, 2, 2), (1, 1, 1)),
    "tapered": (ms.tapered(), (2, 2, 2), (1, 1, 1)),
    "torus": (ms.torus(), (13, 2, 2), (3, 1, 1)),
    "arcs": (ms.torus(form="arcs"), (13, 2, 2), (3, 1, 1)),
    "exact": (ms.torus(form="exact"), (9, 2, 2), (2, 1, 1)),
    "shell": (ms.cylinder_shell(), (9, 2, 2), (2, 1, 1)),
    "duck": (ms.duck(), (10, 6, 4), (2, 2, 2)),
    "wing": (ms.wing(), (4, 2, 10), (3, 1, 2)),
}


@pytest.mark.parametrize(("volume", "shape", "degrees"), SHAPES.values(), ids=SHAPES)
def test_sizes_degrees_and_handedness(volume, shape, degrees):
    assert volume.spline.shape == shape
    assert volume.spline.k == degrees
    assert volume.certificate.status is Status.VALID
    assert volume.orientation == 1
    np.testing.assert_array_equal(volume.domain, [[0, 0, 0], [1, 1, 1]])


# ------------------------------------------------------------------------------ boxes


def test_identity_and_affine_maps_are_what_they_say():
    u = np.random.default_rng(0).random((50, 3))
    np.testing.assert_allclose(ms.identity().x(u), u, atol=1e-15)
    a, b = np.array([[1, 2, 0], [0, 1, 3], [1, 0, 1.0]]), np.array([1.0, 2, 3])
    volume = ms.affine(a, b)
    np.testing.assert_allclose(volume.x(u), u @ a.T + b, atol=1e-14)
    np.testing.assert_allclose(volume.jacobian(u), np.broadcast_to(a, (50, 3, 3)), atol=1e-14)
    assert np.abs(volume.hessian(u)).max() < 1e-14
    assert volume.volume() == pytest.approx(np.linalg.det(a))
    assert ms.affine(np.diag([1, 1, -1])).orientation == -1


def test_boxes_by_lengths_and_by_corners():
    np.testing.assert_allclose(ms.box((1, 2, 3)).bounds, [[0, 0, 0], [1, 2, 3]])
    np.testing.assert_allclose(ms.box(2, lo=(1, 1, 1)).bounds, [[1, 1, 1], [3, 3, 3]])
    np.testing.assert_allclose(ms.box(lo=-1, hi=(1, 2, 3)).bounds, [[-1, -1, -1], [1, 2, 3]])
    assert ms.box(lo=-1, hi=(1, 2, 3)).volume() == pytest.approx(24)


def test_hexahedron_corners_are_in_the_order_of_finite_elements():
    corners = np.random.default_rng(0).random((8, 3)) * 0.2
    order = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    corners += order
    volume = ms.hexahedron(corners)
    np.testing.assert_allclose(volume.x(order), corners, atol=1e-15)
    again = ms.hexahedron(volume.spline.c)
    np.testing.assert_array_equal(again.spline.c, volume.spline.c)


def test_the_levels_of_the_tapered_box_are_flat():
    volume = ms.tapered(base=2.0, top=0.5, height=3.0)
    u = parameters(volume, 200)
    x = volume.x(u)
    np.testing.assert_allclose(x[:, 2], 3 * u[:, 2], atol=1e-14)
    side = 2 - 1.5 * u[:, 2]
    np.testing.assert_allclose(x[:, :2], (u[:, :2] - 0.5) * side[:, None], atol=1e-14)
    assert volume.volume() == pytest.approx(3 * (4 + 1 + 0.25) / 3)  # frustum of a pyramid


# ------------------------------------------------------------------------------ rings


@pytest.mark.parametrize(
    ("form", "least", "most"),
    [("periodic", -4.4726e-4, 0), ("arcs", 0, 2.7253e-4), ("exact", 0, 0)],
)
def test_radius_errors_of_the_torus(form, least, most):
    volume = ms.torus(3.0, 2.0, form=form)
    u = np.full((4001, 3), 0.25)
    u[:, 0] = np.linspace(0, 1, 4001)
    for w, radius in ((0.0, 2.0), (1.0, 4.0)):
        u[:, 2] = w
        x = volume.x(u)
        error = np.hypot(x[:, 0], x[:, 1]) / radius - 1
        assert error.min() == pytest.approx(least, abs=2e-8)
        assert error.max() == pytest.approx(most, abs=2e-8)
        np.testing.assert_allclose(x[:, 2], -0.5, atol=1e-15)


def test_periodic_radius_errors_fall_with_the_fourth_power():
    errors = []
    for spans in (10, 20, 40):
        u = np.zeros((500, 3))
        u[:, 0] = np.linspace(0, 1, 500)
        x = ms.torus(2.0, 1.0, spans=spans).x(u)
        errors.append(np.abs(np.hypot(x[:, 0], x[:, 1]) / 1.5 - 1).max())
    slopes = -np.diff(np.log2(errors))
    assert slopes.min() > 3.9
    assert errors[-1] < 2e-6


@pytest.mark.parametrize(("form", "smooth"), [("periodic", 2), ("arcs", 1), ("exact", 1)])
def test_smoothness_at_the_seam(form, smooth):
    """The periodic form is C² there, the arcs and the rational form are C¹ only."""
    volume = ms.torus(form=form)
    for w in (0.0, 0.3, 1.0):
        ends = volume.jet([[0.0, 0.5, w], [1 - 1e-13, 0.5, w]])
        jumps = [float(np.abs(a[1] - a[0]).max()) for a in ends]
        assert max(jumps[: smooth + 1]) < 1e-9
        if smooth < 2:
            assert jumps[2] > 1


def test_the_seam_of_the_arcs_is_exact():
    c = ms.torus(form="arcs").spline.c
    np.testing.assert_array_equal(c[0], c[-1])
    c = ms.cylinder_shell().spline.c
    np.testing.assert_array_equal(c[0], c[-1])


def test_torus_speed_is_nearly_even():
    """Ratio of fastest to slowest along the circle: 1.0013 periodic, 1.079 in arcs."""
    for form, ratio in (("periodic", 1.0013), ("arcs", 1.079)):
        u = np.full((2000, 3), 0.5)
        u[:, 0] = np.linspace(0, 1, 2000)
        speed = np.linalg.norm(ms.torus(form=form).jacobian(u)[:, :, 0], axis=1)
        assert speed.max() / speed.min() == pytest.approx(ratio, abs=5e-4)


def test_torus_certificates():
    assert ms.torus(3, 2).certificate.bound == pytest.approx(50.2, abs=0.05)
    assert ms.torus(3, 2, form="arcs").certificate.bound == pytest.approx(49.1, abs=0.1)
    assert ms.torus(4, 2, form="exact").volume() == pytest.approx(2 * np.pi * 4 * 4, rel=1e-10)


def test_directions_of_the_torus():
    J = ms.torus().jacobian([[0.0, 0.5, 0.5]])[0]
    np.testing.assert_allclose(J[:, 1], [0, 0, 2], atol=1e-12)
    np.testing.assert_allclose(J[:, 2], [2, 0, 0], atol=1e-12)
    assert J[1, 0] == pytest.approx(8 * np.pi, rel=1e-3)


@pytest.mark.parametrize("angle", [0.1, 1.0, np.pi / 2, 2.0, np.pi, 5.0, 2 * np.pi])
def test_shells_are_exact(angle):
    volume = ms.cylinder_shell(1.0, 2.5, 0.7, angle)
    u = parameters(volume, 300)
    x = volume.x(u)
    np.testing.assert_allclose(np.hypot(x[:, 0], x[:, 1]), 1 + 1.5 * u[:, 2], rtol=1e-14)
    np.testing.assert_allclose(x[:, 2], 0.7 * u[:, 1], atol=1e-15)
    end = volume.x([[1.0, 0.0, 0.0]])[0]
    np.testing.assert_allclose(end, [np.cos(angle), np.sin(angle), 0], atol=1e-14)
    assert volume.volume() == pytest.approx(0.5 * angle * (2.5**2 - 1) * 0.7, rel=1e-10)
    assert volume.closed[0] == (angle == 2 * np.pi)


# ------------------------------------------------------------------------------ duck and wing


def test_the_duck_is_that_of_its_table():
    volume = ms.duck()
    c = volume.certificate
    assert c.bound == pytest.approx(0.3236, abs=1e-4)
    assert c.scaled == pytest.approx(0.41, abs=0.005)
    np.testing.assert_allclose(
        volume.bounds, [[-2.35, -1.04, -0.73], [2.61, 1.04, 2.48]], atol=0.006
    )
    grid = [np.linspace(0, 1, 25)] * 3
    det = np.linalg.det(volume.geometry.grid(grid, 1)[1])
    assert det.mean() == pytest.approx(7.57, abs=0.005)  # of nodes, not the volume
    assert det.max() == pytest.approx(21.9, abs=0.05)
    assert volume.volume() == pytest.approx(7.978, abs=0.001)
    assert ms.duck(2.0).volume() == pytest.approx(8 * volume.volume())


@pytest.mark.parametrize(("kappa", "least"), [(0, 0.712), (0.5, 0.50), (0.9, 0.253), (1, 0.174)])
def test_rounder_ducks(kappa, least):
    assert ms.duck(squircle=kappa).certificate.bound == pytest.approx(least, abs=5e-4)


def test_the_duck_runs_along_its_body_first():
    x = ms.duck().x([[0, 0.5, 0.5], [1, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 1, 0.5]])
    assert x[1, 0] - x[0, 0] > 4.5
    np.testing.assert_allclose(x[3, [0, 2]], x[2, [0, 2]], atol=1e-12)
    assert x[3, 1] > 0 > x[2, 1]
    J = ms.duck().jacobian([[0.4, 0.5, 0.5]])[0]
    assert J[2, 2] > 0


def test_the_wing_is_that_of_its_table():
    volume = ms.wing()
    assert volume.certificate.bound == pytest.approx(1.764e-4, abs=1e-7)
    u = np.zeros((101, 3))
    u[:, 0] = np.linspace(0, 1, 101)
    upper, lower = volume.x(u + np.array([0, 1, 0])), volume.x(u)
    half = 0.5 * (upper[:, 2] - lower[:, 2])
    x = upper[:, 0]
    naca = 0.6 * (0.2969 * np.sqrt(x) - 0.126 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1015 * x**4)
    assert np.abs(half - naca).max() == pytest.approx(0.004, abs=2e-4)
    np.testing.assert_allclose(lower[:, 0], x, atol=1e-15)


def test_planform_of_the_wing():
    volume = ms.wing(span=5, chord=2, tip=0.5, sweep=0.3, dihedral=0.1, twist=0.2, thinning=0.5)
    nose, tail = volume.x([[0, 0.5, 1], [1, 0.5, 1]])
    assert np.linalg.norm(tail - nose) == pytest.approx(1.0)
    assert nose[1] == pytest.approx(-5)
    quarter = nose + 0.25 * (tail - nose)
    np.testing.assert_allclose(quarter, [0.5 + 5 * np.tan(0.3), -5, 5 * np.tan(0.1)], atol=1e-12)
    assert nose[2] - tail[2] == pytest.approx(np.sin(0.2))
    root, tip = (np.ptp(volume.x([[0.6, 0, w], [0.6, 1, w]]), axis=0) for w in (0.0, 1.0))
    assert np.linalg.norm(tip) / np.linalg.norm(root) == pytest.approx(0.25)


# ------------------------------------------------------------------------------ bad arguments


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: ms.affine(np.eye(2)), "matrix"),
        (lambda: ms.affine(np.ones((3, 3))), "matrix"),
        (lambda: ms.affine(np.eye(3), (1, 2)), "offset"),
        (lambda: ms.affine(np.full((3, 3), np.nan)), "matrix"),
        (lambda: ms.box((1, -1, 1)), "lengths"),
        (lambda: ms.box(lo=0, hi=(1, 0, 1)), "hi"),
        (lambda: ms.hexahedron(np.zeros((7, 3))), "corners"),
        (lambda: ms.hexahedron("cube"), "corners"),
        (lambda: ms.tapered(base=0), "base"),
        (lambda: ms.tapered(top=-1), "top"),
        (lambda: ms.tapered(height=np.inf), "height"),
        (lambda: ms.cylinder_shell(r0=0), "r0"),
        (lambda: ms.cylinder_shell(r0=2, r1=2), "r1"),
        (lambda: ms.cylinder_shell(angle=7), "angle"),
        (lambda: ms.cylinder_shell(angle=0), "angle"),
        (lambda: ms.torus(major=-1), "major"),
        (lambda: ms.torus(major=1, width=2), "width"),
        (lambda: ms.torus(form="round"), "form"),
        (lambda: ms.torus(form=["arcs"]), "form"),
        (lambda: ms.torus(spans=3), "spans"),
        (lambda: ms.torus(spans="10"), "spans"),
        (lambda: ms.duck(scale=0), "scale"),
        (lambda: ms.duck(squircle=1.5), "squircle"),
        (lambda: ms.duck(squircle="round"), "squircle"),
        (lambda: ms.wing(span=0), "span"),
        (lambda: ms.wing(tip=0), "tip"),
        (lambda: ms.wing(thickness=-0.1), "thickness"),
        (lambda: ms.wing(thinning=1), "thinning"),
        (lambda: ms.wing(sweep=2), "sweep"),
        (lambda: ms.wing(twist=np.nan), "twist"),
    ],
)
def test_bad_arguments_are_named(make, name):
    with pytest.raises(InputError, match=f"^{name}"):
        make()
