"""Contouring against a naive one, independent counts, and solids with known measures."""

import naive_contouring
import numba
import numpy as np
import pytest
from naive_contouring import Naive

from ilattice.bspline import BSpline
from ilattice.errors import GeometryError, InputError
from ilattice.mesh import _tracer, contouring, measure
from ilattice.mesh._grid import Grid
from ilattice.mesh._samplers import sampler_for
from ilattice.mesh.contouring import (
    ON_CAP,
    ON_LOWER,
    contour,
    contour_arrays,
    contour_blocks,
    split_quads,
)
from ilattice.tiles.trig import TrigField

GYROID = TrigField.parse("sum[cosX sinY]")
DIAMOND = TrigField.parse("cosX cosY cosZ - sinX sinY sinZ")
PRIMITIVE = TrigField.parse("sum[cosX]")


class Samples:
    """A field that only knows its values at the points of a grid: the nearest one counts."""

    def __init__(self, values, axes):
        self.values, self.axes = values, axes

    def __call__(self, p):
        at = [np.searchsorted((a[1:] + a[:-1]) / 2, p[:, i]) for i, a in enumerate(self.axes)]
        return self.values[tuple(at)]


def noise(rng, shape, share, wrap=(False,) * 3):
    """Random values, `share` of them negative, equal on the planes that `wrap` joins."""
    values = np.where(rng.random(shape) < share, -1.0, 1.0) * rng.uniform(0.1, 1.0, shape)
    for a in np.flatnonzero(wrap):
        values = np.moveaxis(values, a, 0)
        values[-1] = values[0]
        values = np.moveaxis(values, 0, a)
    return values


def uneven(rng, n):
    return np.cumsum(rng.uniform(0.5, 1.5, n))


def sphere(p):
    return np.linalg.norm(p - (0.03, -0.02, 0.01), axis=1) - 0.7


def cube_axes(n, low=-1.0, high=1.0):
    return [np.linspace(low, high, n)] * 3


def assert_closed(faces, n_vertices):
    """Closed, oriented manifold without idle vertices; its Euler number."""
    t = measure.topology(faces, n_vertices)
    assert (t.open_edges, t.nonmanifold_edges, t.twisted_edges) == (0, 0, 0)
    assert t.fans == t.vertices == n_vertices
    return t.vertices - t.edges + t.faces


# --- the reference implementation and independent counts ---


@pytest.mark.parametrize("slab", [1, 10**6])
@pytest.mark.parametrize("wrap", [(0, 0, 0), (1, 0, 0), (0, 1, 1), (1, 1, 1)])
def test_random_signs_agree_with_the_reference_implementation(monkeypatch, slab, wrap):
    monkeypatch.setattr(_tracer, "SLAB", slab)
    rng = np.random.default_rng(sum(wrap) + slab)
    for n in (4, 9, 11):
        shape = (n, rng.integers(4, 12), rng.integers(4, 6))
        values = noise(rng, shape, rng.uniform(0.2, 0.8), wrap)
        axes = [uneven(rng, m) for m in shape]
        c = contour_arrays(Samples(values, axes), axes, wrap=wrap, place="linear")
        naive = Naive(values < 0, wrap)
        place = {
            (cell, patch): naive.position(cell, patch, values, 0.0, axes)
            for cell, patches in naive.patches.items()
            for patch in patches
        }
        theirs = np.array([[place[v] for v in quad] for quad in naive.quads()])
        ours = c.vertices[np.stack([*c.faces[::2].T, c.faces[1::2, 2]], axis=1)]
        assert len(c.vertices) == len(place)
        assert ours.shape == theirs.shape
        assert_same_cycles(ours, theirs)
        assert assert_closed(c.faces, len(c.vertices)) == naive.euler()


def assert_same_cycles(ours, theirs):
    """Both hold the same quads (n, 4, 3): any order, any first corner, one sense."""
    kept = []
    for quads in (ours, theirs):
        quads = np.round(quads, 4)
        key = quads @ np.array([1.0, np.pi, np.e])
        first = np.argmin(key, axis=1)
        turned = np.take_along_axis(quads, ((first[:, None] + np.arange(4)) % 4)[..., None], axis=1)
        flat = turned.reshape(len(quads), 12)
        kept.append(flat[np.lexsort(np.round(flat, 3).T)])
    away = np.abs(kept[0] - kept[1]).max(axis=1)
    assert (away > 1e-3).mean() < 0.02  # ties of rounding may swap neighbours in the order


def corner_groups():
    """For each pattern of a cell: pieces of its inside, and whether face diagonals hang together.

    Corners that share an edge of the cell are joined, by hand, from the definition.
    """
    pieces = np.zeros(256, int)
    joined = np.zeros((256, 8, 8), bool)
    for code in range(256):
        group = {c: {c} for c in range(8) if code >> c & 1}
        for c in group:
            for bit in (1, 2, 4):
                if c ^ bit in group and group[c] is not group[c ^ bit]:
                    both = group[c] | group[c ^ bit]
                    for member in both:
                        group[member] = both
        pieces[code] = len({id(g) for g in group.values()})
        for c, g in group.items():
            joined[code, c, list(g)] = True
    return pieces, joined


PIECES, JOINED = corner_groups()


def euler_of_signs(inside):
    """Euler number of the surface around samples that are inside, and the number of faces where
    two cells that both join the diagonal corners of the inside let it cross the face as one."""
    s = np.pad(inside, 1).astype(int)
    n = np.array(s.shape) - 1

    def shifted(d):
        return s[tuple(slice(o, o + m) for o, m in zip(d, n, strict=True))]

    code = sum(shifted((c >> 2, c >> 1 & 1, c & 1)) << c for c in range(8))
    solid = PIECES[code].sum() - s.sum()
    bridges = 0
    for a in range(3):
        b, c = (d for d in range(3) if d != a)
        lines = np.moveaxis(s, a, 0)
        solid += (lines[1:] | lines[:-1]).sum()
        p = np.moveaxis(s, (a, b, c), (0, 1, 2))
        ring = ((0, 0), (1, 0), (1, 1), (0, 1))
        q = [p[:, i : i - 1 or None, j : j - 1 or None] for i, j in ring]
        changes = sum((q[i] != q[i - 1]).astype(int) for i in range(4))
        solid -= np.where(changes == 4, 2, (q[0] | q[1] | q[2] | q[3])).sum()
        first, second = 4 >> b, 4 >> c
        cells = np.moveaxis(code, (a, b, c), (0, 1, 2))
        low, high = cells[:-1], cells[1:]
        crossed = changes[1:-1] == 4
        for d in ((0, first + second), (first, second)):
            top = [x + (4 >> a) for x in d]
            bridges += (crossed & JOINED[low, top[0], top[1]] & JOINED[high, d[0], d[1]]).sum()
    return 2 * (solid + bridges), bridges


def test_noise_of_any_density_is_closed_and_has_the_counted_euler_number():
    rng = np.random.default_rng(5)
    bridges = 0
    for share in np.linspace(0.1, 0.9, 25):
        values = noise(rng, (26, 25, 24), share)
        axes = [uneven(rng, n) for n in values.shape]
        c = contour_arrays(Samples(values, axes), axes, place="linear")
        euler = assert_closed(c.faces, len(c.vertices))
        expected, found = euler_of_signs(values < 0)
        assert euler == expected
        assert measure.volume_and_area(c.vertices, c.faces)[0] > 0
        bridges += found
    assert bridges > 100  # the configuration that is not a manifold without care was there


def test_every_pattern_of_a_single_cell_is_closed():
    axes = [np.array([0.0, 1.0])] * 3
    for code in range(1, 256):
        inside = np.array([code >> c & 1 for c in range(8)], bool).reshape(2, 2, 2)
        c = contour_arrays(Samples(np.where(inside, -1.0, 1.0), axes), axes, place="linear")
        assert assert_closed(c.faces, len(c.vertices)) == euler_of_signs(inside)[0]


def test_gyroid_in_a_box_has_two_triangles_for_every_point_of_flying_edges():
    """And the same Euler number, on the same samples: the outermost ones lie inside the box."""
    import pyvista as pv

    axes = cube_axes(61, 0.013, 2.013)
    sampled = [a.copy() for a in axes]
    for a in sampled:
        a[[0, -1]] += 0.15 * (a[1] - a[0]) * np.array([1.0, -1.0])
    for level in (0.0, (-0.5, 0.5)):
        mesh = contour(GYROID, axes, level=level)
        values = GYROID.grid(sampled) if level == 0.0 else np.abs(GYROID.grid(sampled)) - 0.5
        values = np.pad(values, 1, constant_values=1.0)
        image = pv.ImageData(dimensions=values.shape)
        image["f"] = values.ravel(order="F")
        surface = image.contour([0.0], scalars="f", method="flying_edges")
        t = measure.topology(surface.regular_faces, surface.n_points)
        assert len(mesh.faces) == 2 * surface.n_points
        assert mesh.euler == t.vertices - t.edges + t.faces
        assert mesh.is_watertight


# --- known solids ---


@pytest.mark.parametrize(("place", "order"), [("linear", 1.8), ("refine", 1.8)])
def test_sphere_converges_with_second_order(place, order):
    exact = np.array([4 / 3 * np.pi * 0.7**3, 4 * np.pi * 0.7**2])
    sizes = np.array([17, 33, 65])
    error = []
    for n in sizes:
        c = contour_arrays(sphere, cube_axes(n), place=place)
        assert assert_closed(c.faces, len(c.vertices)) == 2
        error.append(np.abs(np.array(measure.volume_and_area(c.vertices, c.faces)) / exact - 1))
    slope = -np.polyfit(np.log(sizes), np.log(error), 1)[0]
    assert (slope > order).all()
    assert (error[-1] < 3e-3).all()


def test_refined_vertices_lie_on_the_level_set():
    axes = cube_axes(25)
    for field in (sphere, GYROID):
        linear = contour_arrays(field, axes, level=0.1, place="linear")
        refined = contour_arrays(field, axes, level=0.1)
        miss = [
            np.quantile(np.abs(field(c.vertices[c.kind & ON_CAP == 0]) - 0.1), 0.95)
            for c in (linear, refined)
        ]
        assert miss[1] < 1e-4 * (2 / 24)
        assert miss[1] < 0.01 * miss[0]


def test_torus_has_genus_one():
    def torus(p):
        return np.hypot(np.hypot(p[:, 0], p[:, 1]) - 0.6, p[:, 2]) - 0.25

    mesh = contour(torus, cube_axes(30))
    assert mesh.genus == 1
    assert mesh.volume == pytest.approx(2 * np.pi**2 * 0.6 * 0.25**2, rel=0.01)


def test_uneven_and_anisotropic_planes_keep_measures():
    rng = np.random.default_rng(2)
    axes = [np.concatenate([[-1.0], np.sort(rng.uniform(-1, 1, n)), [1.0]]) for n in (70, 60, 90)]
    mesh = contour(sphere, axes)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 0.7**3, rel=0.01)
    mesh = contour(sphere, [np.linspace(-1, 1, n) for n in (120, 30, 9)])
    assert mesh.euler == 2
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 0.7**3, rel=0.03)


def test_two_levels_bound_a_shell():
    mesh = contour(sphere, cube_axes(40), level=(-0.15, 0.1))
    assert mesh.components == 2
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * (0.8**3 - 0.55**3), rel=5e-3)
    c = contour_arrays(sphere, cube_axes(40), level=(-0.15, 0.1))
    lower = c.kind & ON_LOWER != 0
    for side, value in ((lower, -0.15), (~lower, 0.1)):
        miss = np.abs(sphere(c.vertices[side]) - value)
        assert np.quantile(miss, 0.98) < 1e-5
        assert miss.max() < 0.05 * (2 / 39)


def test_volume_of_the_boxed_gyroid_sheet():
    mesh = contour(GYROID, cube_axes(101), level=(-0.3, 0.3))
    assert mesh.volume == pytest.approx(8 * 0.193448125, rel=2e-3)
    assert np.percentile(mesh.quality, 1) >= 0.5
    assert mesh.quality.min() > 0.1


@pytest.mark.parametrize("field", [GYROID, DIAMOND, PRIMITIVE])
@pytest.mark.parametrize("shift", [0.0, 0.137])
def test_triangles_are_well_shaped(field, shift):
    axes = cube_axes(49, shift, 2.0 + shift)
    for level in (0.0, (-0.3, 0.3)):
        quality = contour(field, axes, level=level).quality
        assert np.percentile(quality, 1) >= 0.3
        assert quality.min() > 1e-3


# --- caps ---


def test_solid_that_fills_the_box_is_the_box():
    axes = [np.array([0.0, 0.5, 1.0]), np.linspace(-1, 2, 4), np.linspace(3, 5, 12)]
    mesh = contour(lambda p: np.full(len(p), -1.0), axes)
    assert mesh.volume == pytest.approx(1 * 3 * 2, rel=1e-12)
    assert mesh.area == pytest.approx(2 * (3 + 2 + 6), rel=1e-12)
    assert mesh.euler == 2
    corners = np.array([[x, y, z] for x in (0, 1) for y in (-1, 2) for z in (3, 5)], float)
    assert (corners[:, None] == mesh.vertices[None]).all(axis=2).any(axis=1).all()


def test_caps_of_a_half_space_are_sharp():
    normal = np.array([0.48, 0.6, 0.64])
    mesh = contour(lambda p: p @ normal - 0.1, cube_axes(14))
    corner, p, q = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    n = np.cross(p - corner, q - corner)
    n /= np.linalg.norm(n, axis=1)[:, None]
    known = np.concatenate([np.eye(3), -np.eye(3), normal[None]])
    aligned = (n @ known.T).max(axis=1) > 1 - 1e-6
    areas = measure.triangle_quality(mesh.vertices, mesh.faces)
    assert aligned.mean() > 0.95
    assert areas.min() > 0
    rng = np.random.default_rng(0)
    exact = 8 * np.mean(rng.uniform(-1, 1, (400_000, 3)) @ normal < 0.1)
    assert mesh.volume == pytest.approx(exact, rel=3e-3)


def test_kind_tells_the_faces_of_the_domain():
    c = contour_arrays(GYROID, cube_axes(31))
    for bit, (axis, end) in enumerate((a, e) for a in range(3) for e in (-1.0, 1.0)):
        on_face = c.vertices[:, axis] == end
        assert on_face.any()
        assert np.array_equal(c.kind >> bit & 1 == 1, on_face)
    caps = c.kind & ON_CAP != 0
    assert (GYROID(c.vertices[caps]) < 0.3).all()
    assert (c.kind[caps] & 63 != 0).all()


def test_without_caps_the_wall_ends_on_the_faces():
    axes = cube_axes(31)
    closed = contour_arrays(GYROID, axes, level=(-0.4, 0.4))
    c = contour_arrays(GYROID, axes, level=(-0.4, 0.4), caps=False)
    assert not (c.kind & ON_CAP).any()
    assert len(np.unique(c.faces)) == len(c.vertices)
    t = measure.topology(c.faces, len(c.vertices))
    assert t.open_edges > 0
    assert t.nonmanifold_edges == t.fans - t.vertices == t.twisted_edges == 0
    ends = np.unique(measure.faulty_edges(c.faces, len(c.vertices)))
    assert (c.kind[ends] & 63 != 0).all()
    kept = closed.kind & ON_CAP == 0
    assert np.array_equal(c.vertices, closed.vertices[kept])
    flat = (c.kind[c.faces[:, 0]] & c.kind[c.faces[:, 1]] & c.kind[c.faces[:, 2]] & 63) != 0
    assert not flat.any()
    with pytest.raises(GeometryError):
        contour(lambda p: np.full(len(p), -1.0), axes, caps=False)


# --- closed directions ---


@pytest.mark.parametrize(("field", "euler"), [(PRIMITIVE, -4), (GYROID, -8), (DIAMOND, -16)])
def test_one_periodic_cell_has_its_euler_number(field, euler):
    axes = cube_axes(25, 0.03, 1.03)
    c = contour_arrays(field, axes, wrap=True)
    assert assert_closed(c.faces, len(c.vertices)) == euler
    assert (c.vertices >= 0.03).all()
    assert (c.vertices < 1.03).all()
    assert not c.kind.any()


@pytest.mark.parametrize("n", [9, 17, 20, 22])
def test_the_seam_leaves_no_trace(monkeypatch, n):
    monkeypatch.setattr(_tracer, "SLAB", 1)
    start = 3 / (n - 1)
    plain = [np.linspace(0, 1, n), np.linspace(0, 1, 12), np.linspace(0, 1, 21)]
    moved = [a + start if i == 0 else a for i, a in enumerate(plain)]
    wrap = (True, False, False)
    a = contour_arrays(GYROID, plain, wrap=wrap, level=0.21)
    b = contour_arrays(GYROID, moved, wrap=wrap, level=0.21)
    assert_closed(a.faces, len(a.vertices))
    known, faces = [], []
    for c in (a, b):
        c.vertices[:, 0] = np.mod(c.vertices[:, 0], 1.0)
        order = np.lexsort(np.round(c.vertices, 6).T)
        known.append(c.vertices[order])
        place = np.argsort(order)[c.faces]
        faces.append({tuple(np.roll(f, -np.argmin(f))) for f in place.tolist()})
    assert np.allclose(*known, atol=1e-5)
    assert len(faces[0] ^ faces[1]) < 0.005 * len(a.faces)  # but for ties between diagonals


# --- one result ---


def test_streamed_pieces_are_the_mesh(monkeypatch):
    axes = [np.linspace(0, 1, n) for n in (40, 33, 25)]
    whole = contour_arrays(GYROID, axes)
    monkeypatch.setattr(_tracer, "SLAB", 1)
    pieces = list(contour_blocks(GYROID, axes))
    assert len(pieces) > 3
    assert np.array_equal(np.concatenate([p.vertices for p in pieces]), whole.vertices)
    assert np.array_equal(np.concatenate([p.faces for p in pieces]), whole.faces)
    assert np.array_equal(np.concatenate([p.kind for p in pieces]), whole.kind)
    starts = np.cumsum([0] + [len(p.vertices) for p in pieces])[:-1]
    assert [p.first_vertex for p in pieces] == starts.tolist()
    for p in pieces:  # faces name vertices of this piece and earlier ones only
        assert p.faces.max() < p.first_vertex + len(p.vertices)


def test_arrays_grow_beyond_what_was_reserved(monkeypatch):
    axes = (np.linspace(-1, 1, 40),) * 3
    whole = contour_arrays(sphere, axes)
    monkeypatch.setattr(_tracer, "SLAB", 1)
    monkeypatch.setattr(contouring, "RESERVE", 6000)
    grown = contour_arrays(sphere, axes)
    assert len(whole.kind) < 6000 < whole.faces.nbytes, "some arrays grow, one shrinks"
    for name in ("vertices", "faces", "kind"):
        np.testing.assert_array_equal(getattr(grown, name), getattr(whole, name))


@pytest.mark.threads
@pytest.mark.parametrize("wrap", [False, True])
def test_any_number_of_threads_gives_the_same_bytes(wrap):
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("one thread only")
    axes = cube_axes(45, 0.0, 1.0)
    before = numba.get_num_threads()
    found = []
    for threads in (1, 2):
        numba.set_num_threads(threads)
        found.append(contour_arrays(GYROID, axes, level=(-0.3, 0.2), wrap=wrap))
    numba.set_num_threads(before)
    for name in ("vertices", "faces", "kind"):
        assert getattr(found[0], name).tobytes() == getattr(found[1], name).tobytes()


def test_single_precision_and_progress():
    seen = []
    axes = cube_axes(20)
    c = contour_arrays(GYROID, axes, dtype=np.float32, progress=lambda *a: seen.append(a))
    d = contour_arrays(GYROID, axes)
    assert c.vertices.dtype == np.float32
    assert c.faces.dtype == np.int32
    assert np.allclose(c.vertices, d.vertices, atol=1e-6)
    assert seen[-1][1] == seen[-1][2]


# --- how fields are read ---


def assert_alike(a, b, atol):
    """The same surface, but for rounding: faces may differ where two diagonals are equally good."""
    assert np.array_equal(a.kind, b.kind)
    assert a.faces.shape == b.faces.shape
    assert np.abs(a.vertices - b.vertices).max() < atol


def test_trigonometric_fields_are_read_like_any_callable():
    axes = [np.linspace(0.01, 1.3, n) for n in (30, 25, 40)]
    field = TrigField(DIAMOND.coef, DIAMOND.factor, period=(1.0, 0.8, 1.2)) + 0.1
    for level in (0.05, (-0.2, 0.3)):
        a = contour_arrays(field, axes, level=level, place="linear")
        b = contour_arrays(lambda p: field(p), axes, level=level, place="linear")
        assert_alike(a, b, 1e-6)


@pytest.fixture(scope="module")
def splines():
    rng = np.random.default_rng(3)

    def spline(n, k, values):
        knots = [
            np.r_[[0.0] * j, np.linspace(0, 1, m - j + 1), [1.0] * j]
            for m, j in zip(n, k, strict=True)
        ]
        return BSpline(tuple(knots), values, k)

    s = spline((9, 8, 10), (2, 3, 1), rng.normal(size=(9, 8, 10)))
    d = spline((4, 4, 4), (2, 1, 2), rng.uniform(0.1, 0.4, (4, 4, 4)))
    return s, d


def test_splines_are_read_like_any_callable(splines):
    s, d = splines
    rng = np.random.default_rng(6)
    axes = [np.concatenate([[0], np.sort(rng.random(n)), [1]]) for n in (30, 20, 25)]
    for options in ({"level": 0.1}, {"level": (-0.2, 0.3)}, {"level": (-1, 1), "scale": d}):
        a = contour_arrays(s, axes, place="linear", **options)
        if "scale" in options:
            options["scale"] = lambda p: d(p)
        b = contour_arrays(lambda p: s(p), axes, place="linear", **options)
        assert_alike(a, b, 1e-5)


def test_periodic_splines_are_read_across_the_seam():
    rng = np.random.default_rng(4)
    c = rng.normal(size=(11, 12, 8))
    c[:, -3:] = c[:, :3]
    c[-2:] = c[:2]
    t = ((np.arange(14) - 2) / 9, (np.arange(16) - 3) / 9, np.r_[0, 0, np.linspace(0, 1, 7), 1, 1])
    s = BSpline(t, c, (2, 3, 2), periodic=(True, True, False))
    axes = [np.linspace(0, 1, n) for n in (26, 31, 20)]
    wrap = (True, True, False)
    a = contour_arrays(s, axes, wrap=wrap, place="linear")
    b = contour_arrays(lambda p: s(p), axes, wrap=wrap, place="linear")
    assert_closed(a.faces, len(a.vertices))
    assert_alike(a, b, 1e-4)


def test_splines_are_pruned_by_their_coefficients():
    n = 24
    knots = np.r_[0, np.linspace(0, 1, n), 1]
    plane = np.add.outer(np.add.outer(knots[1:-1], knots[1:-1]), knots[1:-1]) - 1.5
    s = BSpline((knots,) * 3, plane, (1, 1, 1))
    two = BSpline(((0, 0, 1, 1),) * 3, np.full((2, 2, 2), 2.0), (1, 1, 1))
    axes = cube_axes(70, 0.0, 1.0)
    for scale in (None, two):
        level = (-np.inf, 0.0) if scale is None else (-0.05, 0.05)
        sampler = sampler_for(s, Grid.checked(axes, False), level, scale)
        assert sampler.active(2, 7)[:, 1:-1, 1:-1].mean() < 0.7
    mesh = contour(s, axes, level=(-0.05, 0.05), scale=two)
    other = contour(lambda p: s(p), axes, level=(-0.1, 0.1))
    assert mesh.faces.shape == other.faces.shape
    assert np.abs(mesh.vertices - other.vertices).max() < 1e-5


class Counting:
    """A field that counts its evaluations."""

    def __init__(self, **attributes):
        self.points = 0
        for name, value in attributes.items():
            setattr(self, name, value)

    def __call__(self, p):
        self.points += len(p)
        return sphere(p)


def sphere_range(lo, hi):
    c = np.array((0.03, -0.02, 0.01))
    near = np.linalg.norm(np.maximum(np.maximum(lo - c, c - hi), 0), axis=1)
    far = np.linalg.norm(np.maximum(np.abs(lo - c), np.abs(hi - c)), axis=1)
    return np.stack((near, far), axis=1) - 0.7


def test_bounds_prune_blocks_without_changing_the_result():
    axes = cube_axes(89)
    plain = Counting()
    whole = contour_arrays(plain, axes, place="linear")
    assert plain.points == 89**3
    for attributes in ({"range": staticmethod(sphere_range)}, {"lipschitz": 1.0}):
        field = Counting(**attributes)
        c = contour_arrays(field, axes, place="linear")
        assert field.points < 0.4 * plain.points
        assert np.array_equal(c.vertices, whole.vertices)
        assert np.array_equal(c.faces, whole.faces)


@pytest.mark.parametrize("wrap", [False, True])
def test_every_grid_point_is_evaluated_once(monkeypatch, wrap):
    monkeypatch.setattr(_tracer, "SLAB", 1)
    field = Counting()
    n = 27
    contour_arrays(field, cube_axes(n), wrap=wrap, place="linear")
    assert field.points == (n - wrap) ** 3


def test_fields_with_grids_are_evaluated_by_planes():
    class Gridded(Counting):
        planes = 0

        def grid(self, axes):
            self.planes += 1
            xyz = np.meshgrid(*axes, indexing="ij")
            p = np.stack([a.ravel() for a in xyz], axis=1)
            return sphere(p).reshape(xyz[0].shape)

    axes = cube_axes(20)
    field = Gridded()
    c = contour_arrays(field, axes, place="linear")
    assert (field.points, field.planes) == (0, 20)
    assert np.array_equal(c.vertices, contour_arrays(sphere, axes, place="linear").vertices)


# --- hard fields ---


def test_zeros_on_grid_points_are_outside_and_harmless():
    rng = np.random.default_rng(9)
    axes = [np.arange(12.0)] * 3
    values = rng.integers(-1, 2, (12, 12, 12)).astype(float)
    c = contour_arrays(Samples(values, axes), axes, place="linear")
    assert assert_closed(c.faces, len(c.vertices)) == euler_of_signs(values < 0)[0]
    assert measure.triangle_quality(c.vertices, c.faces).min() > 1e-4
    box = contour(lambda p: np.abs(p - 5.0).max(axis=1) - 3.0, axes)
    assert 165 < box.volume < 216  # its edges lie in the domain: they are bevelled
    assert box.quality.min() > 0.1


def test_infinite_values_are_samples_like_any_other():
    def field(p):
        f = sphere(p)
        return np.where(f > 0.2, np.inf, np.where(f < -0.2, -np.inf, f))

    with np.errstate(invalid="ignore"):  # seen where the kernels run as plain Python
        mesh = contour(field, cube_axes(9))
    assert mesh.euler == 2
    assert np.isfinite(mesh.vertices).all()


def test_sheets_thinner_than_a_cell_stay_closed():
    for t in (0.02, 0.1, 0.25):
        c = contour_arrays(GYROID, cube_axes(25, 0.02, 1.02), level=(-t, t))
        assert_closed(c.faces, len(c.vertices))


def crossing_pairs(c):
    cgal = pytest.importorskip("igl.copyleft.cgal")
    faces = c.faces.astype(np.int64)
    return len(cgal.remesh_self_intersections(c.vertices, faces, detect_only=True)[2])


def test_resolved_surfaces_do_not_intersect_themselves():
    rng = np.random.default_rng(0)
    for field in (GYROID, DIAMOND, PRIMITIVE):
        for level in (0.0, (-0.4, 0.4)):
            axes = [np.linspace(0, 1, 21) + shift for shift in rng.random(3)]
            assert crossing_pairs(contour_arrays(field, axes, level=level)) == 0


@pytest.mark.parametrize("share", [0.15, 0.5, 0.8])
def test_noise_with_vertices_in_the_mean_does_not_intersect_itself(share):
    rng = np.random.default_rng(8)
    values = noise(rng, (14, 15, 13), share)
    axes = [uneven(rng, n) for n in values.shape]
    assert crossing_pairs(contour_arrays(Samples(values, axes), axes, place="linear")) == 0


def test_diagonals_can_be_chosen_again():
    c = contour_arrays(GYROID, [np.linspace(0, 1, n) for n in (40, 20, 30)])
    bent = c.vertices * (3.0, 0.5, 1.0)
    faces = c.faces.copy()
    split_quads(bent, faces)
    assert (faces != c.faces).any()
    before, after = (
        measure.triangle_quality(bent, f).reshape(-1, 2).min(axis=1) for f in (c.faces, faces)
    )
    assert after.mean() > before.mean()
    assert assert_closed(faces, len(bent)) == assert_closed(c.faces, len(bent))


# --- bad input ---


def test_no_surface_names_the_range_of_the_field():
    with pytest.raises(GeometryError, match=r"below -5.*\[-3, 3\]"):
        contour(PRIMITIVE, cube_axes(25, 0.0, 1.0), level=-5.0)
    with pytest.raises(GeometryError, match=r"between 4 and 5"):
        contour(PRIMITIVE, cube_axes(25), level=(4, 5))


def test_nan_is_refused_with_its_place():
    def field(p):
        f = sphere(p)
        f[np.argmin(f)] = np.nan
        return f

    with pytest.raises(GeometryError, match="NaN at"):
        contour(field, cube_axes(9))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"axes": [np.linspace(0, 1, 5)] * 2}, "three 1-D arrays"),
        ({"axes": [np.linspace(0, 1, 5)] * 2 + [np.array([0.0, 1.0, 1.0])]}, "must increase"),
        ({"axes": [np.linspace(0, 1, 5)] * 2 + [np.array([0.0])]}, "at least 2 planes"),
        ({"axes": [np.array([0.0, 0.5, 1.0])] * 3, "wrap": True}, "at least 4 planes"),
        ({"axes": [np.array([0.0, np.nan])] * 3}, "finite"),
        ({"level": (0.3, 0.1)}, "lower, upper"),
        ({"level": np.inf}, "finite"),
        ({"place": "nearest"}, "place"),
        ({"dtype": np.int32}, "dtype"),
        ({"dtype": "?!"}, "dtype"),
        ({"wrap": (True, False)}, "wrap"),
        ({"field": 3.0}, "callable"),
        ({"field": lambda p: np.zeros((len(p), 2))}, "values for"),
    ],
)
def test_bad_input_is_refused(change, message):
    arguments = {"field": sphere, "axes": cube_axes(6)} | change
    with pytest.raises(InputError, match=message):
        contour(**arguments)


def test_scale_must_be_positive():
    with pytest.raises(GeometryError, match="scale must be positive"):
        contour(sphere, cube_axes(6), level=(-1, 1), scale=lambda p: p[:, 0])


def test_the_twin_alone_counts_the_euler_number_of_a_ball_and_a_ring():
    solid = np.zeros((5, 5, 5), bool)
    solid[1:4, 1:4, 1:4] = True
    assert Naive(solid).euler() == 2
    solid[2, 2, 1:4] = False
    assert Naive(solid).euler() == 0
    assert naive_contouring.padded(solid, (True, False, False)).shape == (4, 7, 7)
