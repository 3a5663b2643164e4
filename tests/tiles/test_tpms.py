"""Every row of the catalogue against its equation typed out, and against slow measures."""

import naive_tpms as naive
import numpy as np
import pytest
from conformance import check_field
from scipy.optimize import minimize

from ilattice.tiles import TrigField, row
from ilattice.tiles.tpms import ROWS

NAMES = sorted(r.name for r in ROWS)
FIELDS = {n: TrigField.parse(row(n).equation) for n in NAMES}

# Bound of the gradient with sine and cosine modes summed apart, and largest gradient in the cell.
GRADIENTS = {
    "gyroid": (26.66, 10.88),
    "diamond": (21.77, 10.88),
    "primitive": (18.85, 10.88),
    "iwp": (91.01, 32.65),
    "neovius": (100.1, 43.98),
    "c_y": (106.1, 32.93),
    "lidinoid": (99.49, 32.65),
    "octo": (23.53, 10.10),
    "frd": (162.1, 55.33),
    "s": (46.17, 15.35),
    "p_c_p": (18.47, 7.39),
    "split_p": (76.53, 22.74),
    "f": (10.88, 6.28),
    "c_d": (125.0, 53.41),
    "g_prime": (46.17, 13.61),
    "g_prime2": (284.2, 72.67),
    "d_prime": (37.54, 15.80),
    "k": (28.73, 10.70),
    "c_s": (319.8, 108.8),
    "y": (106.1, 45.50),
    "pm_y": (63.91, 25.90),
    "c_pm_y": (63.91, 21.77),
    "c_i2y": (145.7, 36.43),
    "w": (84.30, 36.79),
    "q_star": (71.78, 27.84),
    "c_g": (318.4, 90.03),
    "slotted_p": (213.0, 65.28),
}


def grid_of(name, n, cells=1):
    a = naive.samples(n, cells)
    return FIELDS[name].grid((a, a, a)) - row(name).level


def test_the_reference_implementation_knows_the_same_surfaces():
    assert sorted(naive.EQUATIONS) == NAMES
    assert len(NAMES) == len(ROWS) >= 27 + 8 + 5


@pytest.mark.parametrize("name", NAMES)
def test_fields_are_the_equations_typed_out(name):
    p = np.random.default_rng(7).uniform(-2, 2, (400, 3))
    value, gradient = naive.value(name, p), naive.gradient(name, p)
    f, g = FIELDS[name].jet(p, 1)
    np.testing.assert_allclose(f, value, rtol=0, atol=1e-13 * np.abs(value).max())
    np.testing.assert_allclose(g, gradient, rtol=0, atol=1e-13 * np.abs(gradient).max())
    np.testing.assert_allclose(FIELDS[name](p), value, rtol=0, atol=1e-13 * np.abs(value).max())


@pytest.mark.parametrize("name", NAMES)
def test_fields_conform(name):
    check_field(FIELDS[name], np.random.default_rng(0), points=60)


@pytest.mark.parametrize("name", NAMES)
def test_declared_symmetry(name):
    assert naive.symmetry(FIELDS[name]) == row(name).symmetry


@pytest.mark.parametrize("name", NAMES)
def test_declared_cyclic_symmetry_and_prisms(name):
    p = np.random.default_rng(0).random((20, 3))
    f = FIELDS[name](p)
    assert np.allclose(f, FIELDS[name](p[:, [1, 2, 0]]), atol=1e-10) == row(name).cyclic
    up = FIELDS[name](p + np.array([0.0, 0.0, 0.37]))
    assert np.allclose(f, up, atol=1e-10) == row(name).prismatic


def test_the_brute_force_finds_broken_equations():
    """Neovius without its parentheses, and C(D) with two signs of the last pair swapped."""
    neovius = TrigField.parse("4 cosX cosY cosZ + 3cosX + cosY + cosZ")
    assert naive.symmetry(neovius)[0] == 16
    c_d = TrigField.parse(
        "cos(3X+Y) cosZ - sin(3X-Y) sinZ + cos(X+3Y) cosZ + sin(X-3Y) sinZ"
        " + cos(X+Y) cos3Z - sin(X-Y) sin3Z"
    )
    assert naive.symmetry(c_d)[0] < 48


def test_q_star_is_hexagonal():
    """Six-fold screw axis with steps of a third in the cell of the tile; half a cell flips f."""
    from ilattice.tiles import get

    tile = get("q_star")
    assert tile.hexagonal
    field = tile.field.placed(np.linalg.inv(tile.cell))
    p = np.random.default_rng(0).uniform(-1, 1, (50, 3))
    angle = np.pi / 3
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    q = p.copy()
    q[:, :2] = p[:, :2] @ turn
    steps = [k for k in range(6) if np.allclose(field(q + np.array([0, 0, k / 6])), field(p))]
    assert steps in ([2], [4])
    np.testing.assert_allclose(field(p + np.array([0, 0, 0.5])), -field(p), atol=1e-12)
    assert not np.allclose(tile.field(q + np.array([0, 0, steps[0] / 6])), tile.field(p), atol=0.1)


@pytest.mark.parametrize("name", NAMES)
def test_declared_range(name):
    """Extreme samples, polished: the declared range is met and never left."""
    field, (low, high) = FIELDS[name], row(name).range
    a = naive.samples(32)
    values = field.grid((a, a, a))
    corners = np.stack(np.meshgrid(a, a, a, indexing="ij"), axis=-1).reshape(-1, 3)
    for sign, want in ((1.0, low), (-1.0, high)):
        start = corners[np.argmin(sign * values)][None]
        best = minimize(
            lambda p, s=sign: s * field(p[None])[0],
            start[0],
            jac=lambda p, s=sign: s * field.jet(p[None], 1)[1][0],
            tol=1e-12,
        )
        assert sign * best.fun == pytest.approx(want, abs=2e-6 * (high - low))


@pytest.mark.parametrize("name", NAMES)
def test_declared_volume_fraction(name):
    """Cells are weighed by the linear part of f, so 80³ samples give three digits."""
    n = 80
    a = naive.samples(n)
    p = np.stack(np.meshgrid(a, a, a, indexing="ij"), axis=-1).reshape(-1, 3)
    f, g = FIELDS[name].jet(p, 1)
    inside = np.clip(0.5 - n * (f - row(name).level) / (1e-9 + np.abs(g).sum(axis=1)), 0, 1)
    assert inside.mean() == pytest.approx(row(name).volume_fraction, abs=1e-3)


@pytest.mark.parametrize("name", [r.name for r in ROWS if r.euler is not None and r.name != "c_d"])
def test_declared_euler_number(name):
    assert naive.surface_euler(grid_of(name, 60) <= 0) == row(name).euler


def test_c_d_has_many_thin_handles():
    assert naive.surface_euler(grid_of("c_d", 100) <= 0) == row("c_d").euler


def test_surfaces_without_euler_number_are_singular():
    for r in ROWS:
        assert (r.euler is None) <= r.singular_at_zero


@pytest.mark.parametrize("name", ["gyroid", "neovius", "octo", "c_s", "bcc", "w", "honeycomb_iwp"])
def test_declared_area(name):
    """Marching cubes at two resolutions, extrapolated."""
    from skimage.measure import marching_cubes, mesh_surface_area

    areas = []
    for n in (40, 80):
        a = (np.arange(n + 1) + 0.37) / n
        volume = FIELDS[name].grid((a, a, a)) - row(name).level
        vertices, faces, *_ = marching_cubes(volume, 0.0, spacing=(1 / n,) * 3)
        areas.append(mesh_surface_area(vertices, faces))
    area = (4 * areas[1] - areas[0]) / 3
    assert area == pytest.approx(row(name).area, rel=0.02 if name == "w" else 2e-3)


@pytest.mark.parametrize("name", NAMES)
def test_declared_connectedness(name):
    """Pieces on a torus of two cells a side."""
    inside = grid_of(name, 24, cells=2) <= 0
    pieces = max(naive.components(inside), naive.components(~inside))
    assert (pieces > 1) == row(name).disconnected


@pytest.mark.parametrize("name", NAMES)
def test_declared_singularity(name):
    """Points driven to level zero: somewhere there the gradient (almost) vanishes, or nowhere."""
    field = FIELDS[name]
    p = np.random.default_rng(0).random((8000, 3))
    for _ in range(20):
        f, g = field.jet(p, 1)
        step = -(f / (np.sum(g * g, axis=1) + 1e-30))[:, None] * g
        length = np.linalg.norm(step, axis=1, keepdims=True)
        p = p + step * np.minimum(1.0, 0.05 / np.maximum(length, 1e-30))
    f, g = field.jet(p, 1)
    size = np.linalg.norm(g[np.abs(f) < 1e-9 * np.ptp(row(name).range)], axis=1)
    assert len(size) > 4000
    assert (size.min() < 0.02 * size.max()) == row(name).singular_at_zero


@pytest.mark.parametrize("name", sorted(GRADIENTS))
def test_gradient_bounds(name):
    """The sum over complex modes is at most that over sines and cosines, and both are bounds."""
    field, (split, largest) = FIELDS[name], GRADIENTS[name]
    waves, amplitude = field.modes()
    apart = (np.abs(amplitude.real) + np.abs(amplitude.imag)) @ np.linalg.norm(waves, axis=1)
    assert 2 * np.pi * apart == pytest.approx(split, rel=1e-3)
    if name in ("c_y", "y", "q_star"):  # sines and cosines of one wave, whose modes add up
        assert field.lipschitz < 0.95 * split
    else:
        assert field.lipschitz == pytest.approx(split, rel=1e-3)
    a = naive.samples(36)
    p = np.stack(np.meshgrid(a, a, a, indexing="ij"), axis=-1).reshape(-1, 3)
    size = np.linalg.norm(field.jet(p, 1)[1], axis=1).max()
    assert size == pytest.approx(largest, rel=0.02)
    assert size <= field.lipschitz


def test_known_relations_between_rows():
    p = np.random.default_rng(0).random((50, 3))
    f = {n: field(p) for n, field in FIELDS.items()}
    X, Y, Z = np.cos(2 * np.pi * p.T)
    np.testing.assert_allclose(f["w"], -2 * (X - Y) * (Y - Z) * (Z - X), atol=1e-13)
    np.testing.assert_allclose(
        f["g_prime"] - 0.32, f["lidinoid"] - 0.3 + naive.A(*(2 * np.pi * p.T))
    )
    np.testing.assert_allclose(f["p_j"] - f["f"] * 4, f["primitive"], atol=1e-13)
    left = TrigField.parse("sum[sinX cosY]")
    np.testing.assert_allclose(left(p[:, [1, 0, 2]]), f["gyroid"], atol=1e-13)
